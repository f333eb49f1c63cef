"""HTML report: a single self-contained page with texts, tables and pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.result_files import PROGRAM

# A number in a sentence, but not the digits of a name.
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")


@dataclass(frozen=True)
class Picture:
    """Picture in the HTML page.

    Attributes
    ----------
    svg
        The picture as SVG; empty if the picture is left out.
    words
        Caption of the picture.
    broad
        True if the picture takes the whole width of the page.
    """

    svg: str
    words: str
    broad: bool = False


@dataclass(frozen=True)
class Table:
    """Table in the HTML page.

    Attributes
    ----------
    title
        Title above the table.
    head, rows
        Column titles, and cells.
    words
        A sentence about the table.
    figures
        True if the columns are numbers, which are aligned to the right.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: str = ""
    figures: bool = False


def write(text: str, path: Path) -> None:
    """Write a page to a file; raise UsageError if that fails, NotConverged on a full disk."""
    try:
        write_atomically(path, text)
    except OSError as error:
        raise write_error(path, error) from error


def render_page(**parts: Any) -> str:
    """Render the page from its parts; texts are escaped.

    The parts `numbers`, `said`, `scene`, `chosen`, `pictures` and `warnings` exist only for runs
    and may be missing.
    """
    from jinja2 import Environment, StrictUndefined

    parts = {"numbers": [], "said": [], "scene": "", "chosen": ""} | parts
    parts["pictures"] = [picture for picture in parts.get("pictures", ()) if picture.svg]
    parts["warnings"] = merge_similar_warnings(parts.get("warnings", ()))
    source = (files("indent_sim.results") / "report.html").read_text(encoding="utf-8")
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True
    ).from_string(source)
    text = template.render(program=PROGRAM, version=VERSION, **parts)
    # HTML does not allow control characters, which titles of a scene may contain.
    return "".join(sign for sign in text if sign in "\n\t" or sign >= " ") + "\n"


def merge_similar_warnings(warnings: Sequence[str]) -> list[str]:
    """Merge warnings that differ only in numbers into one with the range of each number."""
    similar_lines: dict[str, list[str]] = {}
    for line in dict.fromkeys(warnings):
        similar_lines.setdefault(NUMBER.sub("#", line), []).append(line)
    return [
        lines[0] if len(lines) == 1 else _merge_lines(lines) for lines in similar_lines.values()
    ]


def _merge_lines(lines: Sequence[str]) -> str:
    """Merge lines that differ only in their numbers into one line."""
    numbers = [
        sorted(set(column), key=float) for column in zip(*map(NUMBER.findall, lines), strict=True)
    ]
    ranges = (
        column[0] if len(column) == 1 else f"{column[0]} to {column[-1]}" for column in numbers
    )
    return f"{NUMBER.sub(lambda _: next(ranges), lines[0])} ({len(lines)} such warnings)"


def thinned_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[object]], words: str = ""
) -> Table:
    """Return a table of numbers with at most 100 evenly spaced rows.

    Parameters
    ----------
    title, head
        Title of the table, and titles of its columns.
    rows
        All rows; the first and the last are kept.
    words
        A sentence about the table.
    """
    # Largest number of rows that are shown.
    max_rows = 100
    kept_rows = np.linspace(0, len(rows) - 1, min(max_rows, len(rows))).round().astype(int)
    row_count_text = f"{len(kept_rows)} of {len(rows)} rows. " if len(kept_rows) < len(rows) else ""
    return Table(
        title,
        head,
        [[value_text(cell) for cell in rows[i]] for i in kept_rows],
        row_count_text + words,
        True,
    )


def value_text(value: Any) -> str:
    """Return a value as text with up to 6 digits; empty for None, NaN and booleans."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value) if value is not None else ""
    return "" if number != number or isinstance(value, bool) else f"{number:.6g}"
