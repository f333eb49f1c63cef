"""The promised coverage of error bars is that measured in docs/accuracy.md."""

from __future__ import annotations

from pathlib import Path

import pytest
from promised_bars import ALL_ROWS, BAR_OVER_ERROR, FEWEST_ROWS, ROWS_OF_A_CLASS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "accuracy.md"


@pytest.fixture(scope="module")
def forces() -> dict[str, list[str]]:
    """Cells of the table of forces by class.

    They are scenes, rows, inside, bar over error, width, worst and idle.
    """
    text = PAGE.read_text(encoding="utf-8")
    table = text.split("`force`, class by class:")[1].split("class by class:")[0]
    lines = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("|")]
    return {name: cells for name, *cells in lines[2:]}


def test_forces_are_inside_their_bars_as_promised(forces: dict[str, list[str]]) -> None:
    """The coverage of all classes, and of each with enough rows, is the promised one.

    No bar is above 20 % where the error is below 1 %.
    """
    judged = {name: cells for name, cells in forces.items() if int(cells[1]) >= FEWEST_ROWS}
    inside = {name: float(cells[2].removesuffix(" %")) / 100 for name, cells in judged.items()}
    assert inside.pop("**all**") >= ALL_ROWS
    assert {name: share for name, share in inside.items() if share < ROWS_OF_A_CLASS} == {}
    assert float(forces["**all**"][3]) <= BAR_OVER_ERROR
    assert forces["**all**"][6] == "0"
