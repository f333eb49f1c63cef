"""Tables of a result folder: rows of the force table and blocks of the surface table.

Each row is appended to the force table in one write, since rewriting the table at every step would
take a time proportional to the square of the number of steps. A kill can leave an incomplete last
line, and readers ignore a last line without a newline. All other files are replaced as a whole,
except surface.csv with `surface: all`, which is appended to as well. A step counts as done when its
row of force_indentation.csv is complete: the other files of a step are written before its row, and
readers ignore steps without a row.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Collection, Sequence
from functools import cache
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.model.state import (
    DERIVED_COLUMNS,
    ERROR_COLUMNS,
    KRYLOV_COLUMNS,
    PLASTIC_COLUMNS,
    REACTION_COLUMNS,
    REACTION_PREFIX,
    SLIDE_COLUMNS,
    STATE_COLUMNS,
    UNLOADING_COLUMNS,
    State,
    Surface,
)
from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import write_atomically

SURFACE = "surface.csv"
EXPERIMENT = "experiment.csv"
DYNAMIC = "dynamic.csv"
WORD_COLUMNS = ("branch",)  # Columns that contain words instead of numbers.
INTEGER_COLUMNS = ("step", "newton_iterations", *KRYLOV_COLUMNS)
# Columns that may be empty in histories, because a solution on the elastic curve of a body need not
# give them.
UNKNOWN_IN_TIME = ("delta", "z", "a", "penetration", "energy", "calibration_error")
MAY_BE_EMPTY = {"p_max", *DERIVED_COLUMNS, *PLASTIC_COLUMNS, *UNLOADING_COLUMNS, *ERROR_COLUMNS}
# Columns of the surface table that may be empty: theory gives no u_x, the pressure below a sharp
# apex or edge is infinite, and beyond the end of a tip there is no gap.
SURFACE_MAY_BE_EMPTY = ("u_x", "pressure", "gap")
# Columns that every version of this program has written.
SURFACE_COLUMNS = ("step", "x", "y", "u_x", "u_y", "u_z", "gap", "pressure")
SURFACE_HEADER = (*SURFACE_COLUMNS, "z")
# The shear traction is written with friction, the pore pressure with fluid in the pores.
OPTIONAL_SURFACE_COLUMNS = ("shear", "pore_pressure")


def force_row(state: State, columns: tuple[str, ...]) -> bytes:
    """Return the line of a state in the force table."""
    values, writers, reactions = _column_writers(columns)
    cells = [write(value) for write, value in zip(writers, values(state), strict=True)]
    cells += [_cell_text(state.column(name)) for name in reactions]
    return (",".join(cells) + "\n").encode()


@cache
def _column_writers(
    columns: tuple[str, ...],
) -> tuple[Callable[[State], tuple[Any, ...]], tuple[Callable[[Any], str], ...], tuple[str, ...]]:
    """Return a getter of a state's values, a formatter for each, and the reaction columns.

    The reactions are the last columns of the table.
    """
    value_columns = tuple(name for name in columns if name not in REACTION_COLUMNS)
    writers = tuple(
        _integer_text if name in INTEGER_COLUMNS else _cell_text for name in value_columns
    )
    return attrgetter(*value_columns), writers, columns[len(value_columns) :]


def force_columns(scene_columns: Sequence[str]) -> tuple[str, ...]:
    """Return all columns of the force table in order.

    The table of a body that yields has a contact area and an unloading stiffness in place of
    DERIVED_COLUMNS.

    Parameters
    ----------
    scene_columns
        Columns that not every scene has.
    """
    derived = () if "contact_area" in scene_columns else DERIVED_COLUMNS
    return order_columns((*STATE_COLUMNS, *derived, *scene_columns))


def order_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Order the columns of the force table.

    The time t comes after the step, the slide after the depth, and support reactions at the end.
    """
    time = [name for name in columns if name == "t"]
    slide = [name for name in columns if name in SLIDE_COLUMNS]
    reactions = [name for name in columns if name in REACTION_COLUMNS]
    placed = {*time, *slide, *reactions}
    first, depth, *middle_columns = (name for name in columns if name not in placed)
    return (first, *time, depth, *slide, *middle_columns, *reactions)


def parse_state(names: tuple[str, ...], line: bytes, unknown: Collection[str] = ()) -> State | None:
    """Parse a line of the force table.

    Parameters
    ----------
    names
        Columns of the table.
    line
        The line, without its newline.
    unknown
        Columns that may be empty in this run, in addition to MAY_BE_EMPTY.

    Returns
    -------
    State or None
        None if the line is incomplete, or contains values that are impossible for a solution.
    """
    cells = line.decode("ascii", "replace").split(",")
    if len(cells) != len(names):
        return None
    try:
        named_cells = zip(names, cells, strict=True)
        values: dict[str, Any] = {name: _parse_cell(name, cell) for name, cell in named_cells}
        empty = {name for name, value in values.items() if value != value}
    # An integer with hundreds of digits overflows a floating-point number.
    except (ValueError, OverflowError):
        return None
    if any(value in (math.inf, -math.inf) for value in values.values()):
        return None
    if not empty <= MAY_BE_EMPTY.union(unknown, UNKNOWN_IN_TIME if "t" in names else ()):
        return None
    reactions = {
        name.removeprefix(REACTION_PREFIX): values.pop(name)
        for name in names
        if name in REACTION_COLUMNS
    }
    return State(**values, reactions=reactions or None)


def _parse_cell(name: str, cell: str) -> float | str:
    """Parse the cell of a column: a word, an integer or a number."""
    if name in WORD_COLUMNS:
        return cell
    return parse_integer(cell) if name in INTEGER_COLUMNS else parse_number(cell)


def parse_number(cell: str) -> float:
    """Parse a number; an empty cell is NaN.

    ValueError is raised for texts that Python accepts as numbers but other programs do not, such as
    1_000.
    """
    if "_" in cell or not cell.isascii():
        raise ValueError(f"{cell!r} is not a number")
    return float(cell) if cell.strip() else math.nan


def parse_integer(cell: str) -> int:
    """Parse a non-negative integer; raise ValueError for anything else."""
    if not cell.strip().isdecimal() or not cell.isascii():
        raise ValueError(f"{cell!r} is not a whole number")
    return int(cell)


def surface_block(step: int, surface: Surface) -> bytes:
    """Return the lines of a step in the surface table; NaN is written as an empty cell."""
    optional_columns = [
        values
        for name in OPTIONAL_SURFACE_COLUMNS
        if (values := getattr(surface, name)) is not None
    ]
    table = np.column_stack(
        [
            surface.x,
            surface.y,
            surface.u,
            surface.gap,
            surface.pressure,
            surface.z,
            *optional_columns,
        ]
    )
    text = io.BytesIO()
    np.savetxt(text, table, fmt=f"{step:d}," + ",".join(["%.17g"] * table.shape[1]))
    return text.getvalue().replace(b"nan", b"")


def surface_header(surface: Surface) -> bytes:
    """Return the first line of the surface table."""
    optional_names = [
        name for name in OPTIONAL_SURFACE_COLUMNS if getattr(surface, name) is not None
    ]
    return (",".join((*SURFACE_HEADER, *optional_names)) + "\n").encode()


def csv_table(items: Sequence[Any]) -> bytes:
    """Return a CSV table with one row per dataclass and one column per field.

    A field that is None in every item has no column.
    """
    names = [
        name for name in vars(items[0]) if any(getattr(item, name) is not None for item in items)
    ]
    rows = ([getattr(item, name) for name in names] for item in items)
    lines = (",".join(map(_cell_text, values)) for values in rows)
    return ("\n".join([",".join(names), *lines]) + "\n").encode()


def surface_blocks(path: Path) -> dict[int, bytes]:
    """Return the lines of each step in a surface table; empty if there is no table."""
    lines = path.read_bytes().splitlines(keepends=True)[1:] if path.exists() else []
    return {int(step): b"".join(block) for step, block in groupby(lines, _line_step)}


def drop_later_blocks(path: Path, steps: int) -> None:
    """Remove the lines of a surface table after the first `steps` steps, and a partial last line.

    Lines of an older version of this program get empty cells for missing columns. UsageError is
    raised if the file is not a surface table.
    """
    if not path.exists():
        return
    data = path.read_bytes()
    head, *lines = data[: data.rfind(b"\n") + 1].splitlines() or [b""]
    try:
        names = [name for name in head.decode().split(",") if name]
    except UnicodeDecodeError:
        problem = f"{path} is not a table: its first line is not text"
        raise UsageError(problem, "remove it and leave --resume out", str(path)) from None
    missing = [name for name in SURFACE_HEADER if name not in names]
    empty_cells = b"," * len(missing)
    kept_lines = [
        ",".join([*names, *missing]).encode(),
        *(line + empty_cells for line in lines if _line_step(line) <= steps),
    ]
    if (table := b"".join(line + b"\n" for line in kept_lines)) != data:
        write_atomically(path, table)


def _integer_text(value: float) -> str:
    """Format an integer of the table."""
    return str(int(value))


def _cell_text(value: float | str | None) -> str:
    """Format a number so that it is read back exactly; empty for None and NaN."""
    if value is None or value != value:
        return ""
    return value if isinstance(value, str) else f"{value:.17g}"


def _line_step(line: bytes) -> float:
    """Return the step of a line of the surface table; infinite if it has none."""
    try:
        return int(line.split(b",", 1)[0])
    except ValueError:
        return float("inf")
