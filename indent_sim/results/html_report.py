"""Report of a result: one HTML file that needs nothing beside it, neither network nor other files."""

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

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")  # in a sentence
MAX_TABLE_ROWS = 100  # of a table; more are thinned
REPORT_FILE = "report.html"
REPORT_FORMATS = (".html", ".htm")


@dataclass(frozen=True)
class Picture:
    """A picture as it stands in the page, and what it shows in words."""

    svg: str
    words: str
    broad: bool = False


@dataclass(frozen=True)
class Table:
    """A table of the page; figures: its columns are numbers."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: str = ""
    figures: bool = False


def write(text: str, path: Path) -> None:
    """Write a page into a file; UsageError when that cannot be, NotConverged on a full disk."""
    try:
        write_atomically(path, text)
    except OSError as error:
        raise write_error(path, error) from error


def render_page(**parts: Any) -> str:
    """The page of its parts; whatever is text stays text.

    What only a run has may be missing, and a picture of nothing is left out.
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
    return (
        "".join(sign for sign in text if sign in "\n\t" or sign >= " ") + "\n"
    )  # no control characters


def merge_similar_warnings(warnings: Sequence[str]) -> list[str]:
    """Warnings that differ in nothing but their numbers as one line each, with the range of every
    number.
    """
    similar_lines: dict[str, list[str]] = {}
    for line in dict.fromkeys(warnings):
        similar_lines.setdefault(NUMBER.sub("#", line), []).append(line)
    return [
        lines[0] if len(lines) == 1 else _merge_lines(lines) for lines in similar_lines.values()
    ]


def _merge_lines(lines: Sequence[str]) -> str:
    """Lines that are alike as one."""
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
    """A table of numbers with at most MOST_ROWS of its rows, the first and the last among them."""
    kept_rows = np.linspace(0, len(rows) - 1, min(MAX_TABLE_ROWS, len(rows))).round().astype(int)
    kept = f"{len(kept_rows)} of {len(rows)} rows. " if len(kept_rows) < len(rows) else ""
    return Table(
        title, head, [[value_text(cell) for cell in rows[i]] for i in kept_rows], kept + words, True
    )


def value_text(value: Any) -> str:
    """A value as it is read, not to its last digit; nothing for what there is none of."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value) if value is not None else ""
    return "" if number != number or isinstance(value, bool) else f"{number:.6g}"
