"""What scripts/bench and scripts/make_scaling_page make of known rows.

Measuring the rows takes an hour.
"""

from __future__ import annotations

import re
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import SimpleNamespace

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
BENCH = SCRIPTS / "bench"


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
        "| GetFEM 5.4 | augmented Lagrangian | P2 | 0.005 | 12361 | +0.01 % | 0.26 % | "
        "37 | 4.5 | 93 | reference |"
    ) in text
    monkeypatch.setattr(side_by_side, "PICTURE", tmp_path / "programs.png")
    side_by_side.draw(rows)
    assert (tmp_path / "programs.png").stat().st_size > 20_000


def test_a_source_of_error_names_the_cheapest_run_under_the_target():
    from sources import LAST, Source, line

    source = Source("far mesh", "", lambda row: True, LAST, ("mesh.h_far",))
    runs = [(1.0, 0.02, 1.0), (0.5, -0.0004, 3.0), (0.2, 0.0009, 2.0)]
    rows = [
        {"status": "done", "mesh.h_far": h, LAST: error, "cpu_s": cpu} for h, error, cpu in runs
    ]
    assert line(source, rows) == ["far mesh", "h_far 1", "2 %", "h_far 0.2", "0.09 %", "2"]
    assert line(source, rows[:1])[3] == "not reached; h_far 1"


def test_every_slot_of_the_page_has_its_filler():
    slots = set(re.findall(r"\$(\w+)", (BENCH / "page.md").read_text(encoding="utf-8")))
    program = (BENCH / "__main__.py").read_text(encoding="utf-8")
    assert slots and [slot for slot in slots if f'"{slot}"' not in program] == []


def test_the_scaling_page_measures_what_it_has_not_kept(tmp_path, monkeypatch):
    loader = SourceFileLoader("make_scaling_page", str(SCRIPTS / "make_scaling_page"))
    page = module_from_spec(spec_from_loader(loader.name, loader))
    monkeypatch.setitem(sys.modules, loader.name, page)
    monkeypatch.setattr(sys, "path", list(sys.path))
    loader.exec_module(page)
    runs = []

    def measured(config, *settings, ranks, PETSC_OPTIONS, **environment):
        runs.append((config, *settings, ranks))
        log = (
            "PCSetUp  3 1.0 2.0e+00 1.0 0.0\nKSPSolve 9 1.0 6.0e+00 1.2 1.0\nKSPSetUp 9 1.0 "
            "1.0e+00 1.2 1.0\n"
        )
        Path(PETSC_OPTIONS.partition(":")[2]).write_text(log, "utf-8")
        audit = {"newton_iterations": 40} | (
            {"krylov_iterations": 300} if settings[-1].endswith("iterative") else {}
        )
        report = {
            "dofs": 20000,
            "audit": audit,
            "timings": {"mesh": 1.0, "assemble": 2.0, "solve": 9.0 / ranks},
        }
        return SimpleNamespace(cpu=12.0, wall=13.0, memory=500.0, force=[1.0, 2.0], report=report)

    monkeypatch.setattr(page, "measure", measured)
    monkeypatch.setattr(page, "ROOT", tmp_path)
    monkeypatch.setattr(
        page,
        "prediction",
        lambda row: {"dofs": 2e4 * row.shrink, "seconds": 10.0, "memory_MB": 400.0},
    )
    for name, place in (("PAGE", "scaling.md"), ("KEPT", "kept")):
        monkeypatch.setattr(page, name, tmp_path / place)
    page.main(1e6)
    assert len(set(runs)) == len(page.ROWS)
    once = len(runs)
    assert once == len(page.ROWS) + 2 * (page.TRIES - 1)  # of the pair that is compared
    text = (tmp_path / "scaling.md").read_text("utf-8")
    assert (
        "$" not in text
        and "| 20000 | iterative | 2 | 12 |" in text
        and "| 6.5 | 8 | 40 | 300 |" in text
    )
    (tmp_path / "kept" / "linear_elastic-1.6-iterative-2.json").unlink()
    page.main(1e6, is_kept=True)
    assert len(runs) == once
    page.main(1e6)
    assert len(runs) == once + 1
