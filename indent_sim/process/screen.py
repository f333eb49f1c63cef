"""Tables that fit a screen, as text and as HTML: what a notebook shows of an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from indent_sim.process.errors import printable

# of a table, and of one of its cells
MOST_LINES = 20
MOST_LETTERS = 60
LEFT_OUT = "…"


@dataclass(frozen=True)
class Shown:
    """A heading, a table below it, of whose rows the first and the last are shown, and what stands
    below.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    below: str = ""

    @property
    def text(self) -> str:
        """As plain text, its columns aligned."""
        cells = [list(self.head), *self._cells()]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)] if self.rows else []
        lines = [
            "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
            for row in cells
        ]
        told = [self.title, *(lines if widths else []), self.below]
        return "\n".join(line.rstrip() for line in told if line)

    @property
    def html(self) -> str:
        """As an HTML table."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.head)
        rows = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self._cells()]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        below = f"<p>{escape(self.below)}</p>" if self.below else ""
        table = (
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
        )
        return f"<p><b>{escape(printable(self.title))}</b></p>{table}{below}"

    def _cells(self) -> list[list[str]]:
        """The rows that are shown, as words; a row of dots for those that are not."""
        count = len(self.rows)
        if count <= MOST_LINES:
            return [[cell(value) for value in row] for row in self.rows]
        half = MOST_LINES // 2
        shown = [[cell(value) for value in row] for row in (*self.rows[:half], *self.rows[-half:])]
        return [*shown[:half], [LEFT_OUT] * len(self.head), *shown[half:]]


def cell(value: Any) -> str:
    """A value in a cell: numbers to six digits, nothing for what is not known, long words
    shortened.
    """
    if value is None or value != value:
        return ""
    said = f"{value:.6g}" if isinstance(value, float) else printable(str(value))
    return said if len(said) <= MOST_LETTERS else f"{said[: MOST_LETTERS - 1]}{LEFT_OUT}"
