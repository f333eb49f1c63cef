"""Four new users: from an empty folder to what each came for in at most three commands, those of docs/how_do_i.md."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import html_page
import matplotlib.image
import numpy as np
import pytest
from test_tutorials import BLOCK, ROOT, followed

from indent_sim.results.reader import read_run

MOST = 3  # commands


def afm_biologist(folder: Path) -> None:
    """The curve with its error bars, up and down, and a picture of it above the stress in the deformed cell."""
    run = read_run(folder / "results" / "cell")
    assert run["force"] == pytest.approx([0.5, 1, 2, 3, 1, 0]) and run["delta"][1] == pytest.approx(run["delta"][4])
    assert (run["force_error"][:-1] <= 0.02 * run["force"][:-1]).all()  # what the template asks for
    picture = matplotlib.image.imread(folder / "cell.png")
    top, bottom = np.array_split(picture[..., :3], 2)
    assert len(np.unique(bottom.reshape(-1, 3), axis=0)) > 500 and (top.min(axis=(0, 2)) < 0.5).any()  # graded, drawn


def film_engineer(folder: Path) -> None:
    """How far the formula of the half-space is off, and the curve."""
    page = (folder / "results" / "film" / "report.html").read_text(encoding="utf-8")
    html_page.check(page)
    assert re.search(r"of this curve reads E = [\d.]+ GPa \([+-][\d.]+ %", page) and ">force F [mN]<" in page
    assert len(read_run(folder / "results" / "film")) == 20


def gel_researcher(folder: Path) -> None:
    """The stress at three depths as a PDF 170 mm wide."""
    pdf = (folder / "stress.pdf").read_bytes()
    width = float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", pdf)[1])  # type: ignore[index]
    assert pdf.startswith(b"%PDF") and width / 72 * 25.4 == pytest.approx(170, abs=0.1)


def cluster_user(folder: Path) -> None:
    """A table of six runs, and their curves on one page."""
    with open(folder / "results" / "study" / "study.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["done"] * 6
    assert {(row["body.height"], row["material.E"]) for row in rows} == {
        (height, E) for height in ("5 um", "10 um", "20 um") for E in ("1 kPa", "3 kPa")
    }
    page = (folder / "results" / "study" / "report.html").read_text(encoding="utf-8")
    html_page.check(page)
    assert ">height [µm]<" in page and ">E [kPa]<" in page


JOURNEYS = {"cell": afm_biologist, "film": film_engineer, "gel": gel_researcher, "study": cluster_user}


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "arrived"), JOURNEYS.items(), ids=[arrived.__name__ for arrived in JOURNEYS.values()])
def test_three_commands_are_enough(kind: str, arrived: Callable[[Path], None], tmp_path: Path) -> None:
    page = (ROOT / "docs" / "how_do_i.md").read_text(encoding="utf-8")
    block = next(text for _, text in BLOCK.findall(page) if text.startswith(f"indent-sim init {kind}\n"))
    commands = block.splitlines()
    assert len(commands) <= MOST
    followed(commands, tmp_path)
    arrived(tmp_path)
