"""scripts/bench: what it makes of rows that are known; the rows themselves are measured by `make bench`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[2] / "scripts" / "bench"


@pytest.fixture(autouse=True)
def _bench_is_found(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))


def test_other_programs_are_told_as_they_were_measured(tmp_path, monkeypatch):
    import side_by_side

    rows = side_by_side.peers()
    assert {row["case"] for row in rows} == set(side_by_side.TITLES)
    assert all(row["cpu_s"] > 0 and abs(row["error_last"]) < 0.1 for row in rows)
    text = side_by_side.tables(rows)
    assert (
        "| GetFEM 5.4 | augmented Lagrangian | P2 | 0.005 | 12361 | +0.01 % | 0.26 % | 37 | 4.5 | 93 | reference |"
        in text
    )
    monkeypatch.setattr(side_by_side, "PICTURE", tmp_path / "programs.png")
    side_by_side.draw(rows)
    assert (tmp_path / "programs.png").stat().st_size > 20_000


def test_a_source_of_error_names_the_cheapest_run_under_the_target():
    from sources import LAST, Source, line

    source = Source("far mesh", "", lambda row: True, LAST, ("mesh.h_far",))
    runs = [(1.0, 0.02, 1.0), (0.5, -0.0004, 3.0), (0.2, 0.0009, 2.0)]
    rows = [{"status": "done", "mesh.h_far": h, LAST: error, "cpu_s": cpu} for h, error, cpu in runs]
    assert line(source, rows) == ["far mesh", "h_far 1", "2 %", "h_far 0.2", "0.09 %", "2"]
    assert line(source, rows[:1])[3] == "not reached; h_far 1"


def test_every_slot_of_the_page_has_its_filler():
    slots = set(re.findall(r"\$(\w+)", (BENCH / "page.md").read_text(encoding="utf-8")))
    program = (BENCH / "__main__.py").read_text(encoding="utf-8")
    assert slots and [slot for slot in slots if f'"{slot}"' not in program] == []
