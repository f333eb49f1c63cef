"""Reader of CSV files with a header and columns of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.process.regular_files import open_regular_file
from indent_sim.results import tables
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.tables import EXPERIMENT

LARGEST_NUMBER = 1e150  # Largest number of a table; its square is still a finite double.


def header_of(path: Path) -> list[str]:
    """Return the titles in the first line of a comma-separated file; empty if it cannot be read."""
    try:
        with open_regular_file(path) as file:
            # A longer first line does not belong to a table of results.
            max_header_bytes = 10_000
            line = file.read(max_header_bytes).split(b"\n")[0]
    except OSError:
        return []
    return [name.strip() for name in line.decode("latin-1").split(",")]


def read_table(
    path: Path, needed: Sequence[str], unknown: Sequence[str] = (), words: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Read the columns of a CSV file with a header.

    A last line without a newline is incomplete and ignored. An empty cell is NaN.

    Parameters
    ----------
    path
        The file.
    needed
        Columns that must exist, with finite numbers except in the columns of `unknown`.
    unknown
        Columns that must exist, but whose cells may be empty.
    words
        Columns of text.

    Returns
    -------
    dict
        Columns by name, each (rows,), floats or strings.

    Raises
    ------
    UsageError
        If the file cannot be read or has another format; the message names the line and the column.
    """
    if path.name == EXPERIMENT and not words:
        problem = (
            f"{path} is the table of an experiment, which is drawn as experiment.png in the "
            "result folder"
        )
        raise UsageError(problem, file=str(path))
    try:
        text = read_regular_file(path).decode("utf-8")
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}", file=str(path)) from None
    except ValueError:
        raise UsageError(
            f"{path} is not a table of numbers with a header: not UTF-8 text", file=str(path)
        ) from None
    lines = [line for line in text[: text.rfind("\n") + 1].split("\n") if line.strip()]
    if not lines:
        raise UsageError(f"{path} is empty", file=str(path))
    header = [name.strip() for name in lines[0].split(",")]
    for name in (*needed, *unknown):
        if name not in header:
            raise UsageError(
                f"{path} has no column '{name}': not a table of results", file=str(path)
            )
    if len(set(header)) < len(header):
        raise UsageError(f"{path} has two columns with the same name", file=str(path))
    rows = [
        _parse_row(line, header, words, f"{path}: line {number}")
        for number, line in enumerate(lines[1:], start=2)
    ]
    cells = list(zip(*rows, strict=True)) or [()] * len(header)
    columns = {
        name: np.array(cells[i], dtype=str if name in words else float)
        for i, name in enumerate(header)
    }
    for name in needed:
        if name not in unknown and not np.isfinite(columns[name]).all():
            raise UsageError(
                f"{path}: column '{name}' has a cell that is not a number", file=str(path)
            )
    return columns


def _parse_row(
    line: str, header: Sequence[str], words: Sequence[str], place: str
) -> list[float | str]:
    """Parse one line into numbers and words; `place` is its position in the file for errors."""
    cells = line.split(",")
    if len(cells) != len(header):
        raise UsageError(
            f"{place} has {len(cells)} cells, the header {len(header)}: not a table of numbers"
        )
    named_cells = enumerate(zip(header, cells, strict=True), start=1)
    return [
        cell if name in words else _parse_number(cell, f"{place}, column {n}")
        for n, (name, cell) in named_cells
    ]


def _parse_number(cell: str, place: str) -> float:
    """Parse a number; raise UsageError if it is invalid or larger than LARGEST_NUMBER."""
    try:
        value = tables.parse_number(cell)
    except ValueError:
        raise UsageError(f"{place} is not a number: not a table of numbers") from None
    if abs(value) > LARGEST_NUMBER:
        raise UsageError(f"the value in {place} is larger than {LARGEST_NUMBER:g}")
    return value
