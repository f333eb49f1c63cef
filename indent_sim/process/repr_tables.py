"""Tables that fit on a screen, as text and HTML, for the display of objects in notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from indent_sim.process.errors import printable

# Larger tables and cells are abbreviated.
MAX_ROWS = 20
ELLIPSIS = "…"


@dataclass(frozen=True)
class ReprTable:
    """Table with a title and a footer; of a long table only the first and last rows are shown."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    footer: str = ""

    @property
    def text(self) -> str:
        """The table as plain text with aligned columns."""
        cells = [list(self.header), *self._cells()]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)] if self.rows else []
        lines = [
            "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
            for row in cells
        ]
        blocks = [self.title, *(lines if widths else []), self.footer]
        return "\n".join(line.rstrip() for line in blocks if line)

    @property
    def html(self) -> str:
        """The table as HTML."""
        header_cells = "".join(f"<th>{escape(name)}</th>" for name in self.header)
        rows = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self._cells()]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        footer = f"<p>{escape(self.footer)}</p>" if self.footer else ""
        table = (
            f"<table><thead><tr>{header_cells}</tr></thead><tbody>{body}</tbody></table>"
            if rows
            else ""
        )
        return f"<p><b>{escape(printable(self.title))}</b></p>{table}{footer}"

    def _cells(self) -> list[list[str]]:
        """Return the cells of the shown rows; a row of ellipses replaces the hidden rows."""
        count = len(self.rows)
        if count <= MAX_ROWS:
            return [[cell_text(value) for value in row] for row in self.rows]
        half = MAX_ROWS // 2
        shown = [
            [cell_text(value) for value in row] for row in (*self.rows[:half], *self.rows[-half:])
        ]
        return [*shown[:half], [ELLIPSIS] * len(self.header), *shown[half:]]


def cell_text(value: Any) -> str:
    """Return a value as text: numbers with six digits, long text truncated, None and NaN as ""."""
    if value is None or value != value:
        return ""
    text = f"{value:.6g}" if isinstance(value, float) else printable(str(value))
    max_characters = 60
    if len(text) <= max_characters:
        return text
    return f"{text[: max_characters - 1]}{ELLIPSIS}"
