"""Measured curves of a text table: forces, depths and times with their units, and their parts."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.process.errors import printable
from indent_sim.results.measured.column_roles import (
    Column,
    ColumnRoles,
    find_roles,
)
from indent_sim.results.measured.column_titles import (
    OUTWARD_NAMES,
    ColumnTitle,
    unit_and_kind,
    unit_factor,
)
from indent_sim.results.measured.delimited_text import (
    SEGMENT_COMMENT,
    TextRows,
    decode,
    read_rows,
)
from indent_sim.results.measured.header_calibration import Calibration, read_calibration
from indent_sim.results.measured.measurement import (
    APPROACH_WORDS,
    DIMENSIONS,
    RETRACT_WORDS,
    SENSITIVITY_KEY,
    SEPARATION_NOTE,
    STIFFNESS_KEY,
    MeasuredCurve,
    NoCurve,
    Uncalibrated,
    curve_parts,
    curve_parts_by_name,
    segment_word,
)
from indent_sim.results.measured.text_layout import TextLayout, detect_layout, is_comment

# Times that restart more often than this are not times since the beginning of each segment.
MAX_RESTARTS = 8
Values = dict[str, np.ndarray]


@dataclass(frozen=True)
class _Rows:
    """Complete rows of a table: values by role, an optional column of words, and the marks.

    The marks are lines of words, each with the number of rows above it.
    """

    values: Values
    words: np.ndarray | None
    marks: tuple[tuple[int, str], ...]


def read_text_curves(
    path: Path,
    data: bytes,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
    stiffness: float | None = None,
    sensitivity: str | None = None,
) -> list[MeasuredCurve]:
    """Read the curves of a text file in its own units; forces from deflections are in newtons.

    Parameters
    ----------
    path
        The file; the curves get its name.
    data
        Its content.
    columns
        Words of --columns: ROLE=COLUMN, or titles or numbers (from 1) of the columns of depth,
        force and time. By default the columns are found by their titles or units.
    given
        Units by kind, "length", "force", "time" and "deflection", for columns whose titles have
        none.
    stiffness
        Spring constant of the cantilever [N/m], for a column of deflections.
    sensitivity
        Length per voltage such as 50 nm/V, for a column of deflections in volts.

    Raises
    ------
    NoCurve
        If the file is not a table of numbers; the message gives the reason and the line.
    ConfigError
        A column or a role of `columns` does not exist, or the text of the sensitivity is not valid.
    """
    text = decode(data)
    layout = detect_layout(text)
    roles = find_roles(layout, columns, str(path))
    calibration = read_calibration(layout.head).replace_given(stiffness, sensitivity)
    quantities = _Quantities(layout, roles, calibration, dict(given or {}), str(path))
    used = [*roles.approach.items(), *(roles.retract or {}).items()]
    word_column = next((column.index for role, column in used if role == "part"), None)
    indices = sorted({column.index for role, column in used if role != "part"})
    table = read_rows(text, layout, indices, word_column)
    if not len(table.numbers):
        raise NoCurve("no line of numbers")
    tables = _separate_tables(table, layout)
    curves = [quantities.curve(part, indices) for part in tables]
    if len(curves) == 1:
        return [quantities.measured_curve(path.stem, *curves[0])]
    return [quantities.measured_curve(f"{path.stem}-{k}", *curve) for k, curve in enumerate(curves)]


class _Quantities:
    """Conversion of the columns of a table to depths, displacements, forces and times.

    Parameters
    ----------
    layout
        Layout of the table.
    roles
        Roles of its columns.
    calibration
        Calibration of the cantilever.
    given
        Units by kind for columns whose titles have none.
    file
        Name of the file, for messages.

    Raises
    ------
    NoCurve
        If a unit is unknown, or the calibration is missing.
    """

    def __init__(
        self,
        layout: TextLayout,
        roles: ColumnRoles,
        calibration: Calibration,
        given: dict[str, str],
        file: str,
    ):
        self._layout = layout
        self._roles = roles
        self._calibration = calibration
        self._given = given
        self._file = file
        self._notes = [*layout.notes, *roles.notes]
        self.units = {kind: given.get(kind, "") for kind in set(DIMENSIONS.values())}
        for role in ("t", "separation", "delta", "z", "force"):
            title = self._title(roles.approach.get(role))
            if title is not None and title.kind:
                self.units[title.kind] = title.unit
        if "deflection" in roles.approach:
            self.units["force"] = "N"
        sides = [side for side in (roles.approach, roles.retract) if side]
        # Columns of the approach, or of the whole curve, and those of the retraction.
        self._sides = [
            {
                role: (column.index, self._factor(role, column))
                for role, column in side.items()
                if role != "part"
            }
            for side in sides
        ]
        self.stiffness = self._stiffness_of_header()

    def curve(self, table: TextRows, indices: Sequence[int]) -> tuple[_Rows, dict[str, slice]]:
        """Return the rows of a table as a curve, and its parts if the columns determine them."""
        places = {index: k for k, index in enumerate(indices)}
        rows = [
            _complete_rows(
                {
                    role: factor * table.numbers[:, places[index]]
                    for role, (index, factor) in side.items()
                },
                table,
                len(self._sides) > 1,
            )
            for side in self._sides
        ]
        if len(rows) == 1:
            whole, invalid_count = rows[0]
            if invalid_count:
                self._note(f"{invalid_count} rows that lack a number are left out")
            return whole, {}
        approach, retract = (one.values for one, _ in rows)
        roles = approach.keys() & retract.keys()
        values = {role: np.concatenate([approach[role], retract[role]]) for role in roles}
        count = len(next(iter(approach.values())))
        total = len(next(iter(values.values())))
        parts = {"approach": slice(0, count), "retract": slice(count, total)}
        return _Rows(values, None, ()), parts

    def measured_curve(self, name: str, rows: _Rows, parts: dict[str, slice]) -> MeasuredCurve:
        """Return a curve with its parts; the rows must be in the order of time."""
        notes: list[str] = []
        values = dict(rows.values)
        if "separation" in values:
            values.setdefault("delta", -values.pop("separation"))
            values.pop("separation", None)
            notes.append("the depth is the negative of the tip-sample separation")
        words = _part_words(rows, self._layout)
        for role in ("delta", "z"):
            if role in values:
                notes += self._turn_inwards(values, role)
        # The displacement of the base is controlled and therefore smooth; the depth contains the
        # noise of the force.
        abscissa = values.get("z", values.get("delta"))
        assert abscissa is not None
        order, time_note = _order_of_time(values.get("t"), words is not None or bool(parts))
        notes += time_note
        if order is not None:
            values = {role: column[order] for role, column in values.items()}
            abscissa = abscissa[order]
        if "t" in values:
            values["t"] = _continued_times(values["t"])
        if not parts and words is not None:
            parts, part_notes = _parts_by_words(words)
            notes += part_notes
        if not parts:
            parts = curve_parts(abscissa, is_timed="t" in values)
        return MeasuredCurve(
            name,
            parts=parts,
            units=self.units,
            notes=tuple(dict.fromkeys([*self._notes, *notes])),
            stiffness=self.stiffness if "z" in values else None,
            is_abscissa_guessed=self._roles.is_abscissa_guessed,
            **values,  # type: ignore[arg-type]
        )

    def _note(self, note: str) -> None:
        """Add a sentence about an assumption."""
        self._notes.append(note)

    def _title(self, column: Column | None) -> ColumnTitle | None:
        """Return the title of a column, None if it has none."""
        return self._layout.titles[column.index] if column and self._layout.titles else None

    def _name(self, column: Column) -> str:
        """Return the name of a column for messages."""
        title = self._title(column)
        return f"column '{title.text}'" if title else f"column {column.index + 1}"

    def _factor(self, role: str, column: Column) -> float:
        """Return the factor from the numbers of a column to the curve's unit."""
        if role == "deflection":
            return column.sign * self._force_factor(column)
        kind = DIMENSIONS.get(role, "length")
        title = self._title(column)
        if title is not None and title.unknown_unit and not self._given.get(kind):
            raise NoCurve(
                f"the unit '{title.unknown_unit}' of {self._name(column)} is unknown: "
                f"give the unit with --units {kind}=..."
            )
        if title is not None and title.kind and title.unit != self.units[kind]:
            ratio = unit_factor(title.unit, kind) / unit_factor(self.units[kind], kind)
            return column.sign * ratio
        return float(column.sign)

    def _force_factor(self, column: Column) -> float:
        """Return the factor [N] from the numbers of a column of deflections to forces."""
        calibration = self._calibration
        title = self._title(column)
        unit, kind = (title.unit, title.kind) if title is not None else ("", "")
        if not kind:
            unit, kind = self._given_deflection_unit(column)
        missing = []
        if calibration.stiffness is None:
            missing.append(("spring constant", STIFFNESS_KEY))
        if kind != "length" and calibration.sensitivity is None:
            missing.append(("sensitivity", SENSITIVITY_KEY.format(unit=unit)))
        if missing:
            names = ", ".join(name for name, _ in missing)
            keys = ", ".join(key for _, key in missing)
            raise Uncalibrated(
                f"{self._name(column)} is a deflection in {unit}: lacks {names}: {keys}", self._file
            )
        self._notes += calibration.notes
        assert calibration.stiffness is not None
        source = f"{calibration.stiffness:.4g} N/m ({calibration.stiffness_source})"
        if kind == "length":
            self._note(f"force from {self._name(column)} by {source}")
            return calibration.stiffness * unit_factor(unit, kind)
        assert calibration.sensitivity is not None
        if kind != calibration.signal:
            raise Uncalibrated(
                f"{self._name(column)} is in {unit}, but the given sensitivity is that of another "
                f"signal: give one per {unit}, as in {SENSITIVITY_KEY.format(unit=unit)}",
                self._file,
            )
        # Currents of detectors are usually given in nanoamperes.
        factor, signal = (1e9, "V") if kind == "voltage" else (1.0, "nA")
        self._note(
            f"force from {self._name(column)} by {factor * calibration.sensitivity:.4g} nm/"
            f"{signal} ({calibration.sensitivity_source}) and {source}"
        )
        return calibration.stiffness * calibration.sensitivity * unit_factor(unit, kind)

    def _given_deflection_unit(self, column: Column) -> tuple[str, str]:
        """Return unit and kind of a deflection whose title has no unit, as the user gives them."""
        unit, kind = unit_and_kind(self._given.get("deflection", ""))
        if kind not in ("length", "voltage", "current"):
            raise NoCurve(
                f"the deflection in {self._name(column)} has no unit: give it with "
                "--units deflection=nm or --units deflection=V"
            )
        return unit, kind

    def _stiffness_of_header(self) -> float | None:
        """Return the spring constant of the header in the units of the curve, None if unknown."""
        calibration = self._calibration
        k = calibration.stiffness
        if k is None or "z" not in self._roles.approach or calibration.stiffness_source == "scene":
            if "z" in self._roles.approach:
                self._notes += calibration.notes
            return None
        if not (self.units["length"] and self.units["force"]):
            return None
        self._notes += calibration.notes
        self._note(f"the spring constant of the header, {k:.4g} N/m, is used")
        return (
            k
            * unit_factor(self.units["length"], "length")
            / unit_factor(self.units["force"], "force")
        )

    def _turn_inwards(self, values: Values, role: str) -> list[str]:
        """Turn an abscissa so that it increases inwards; return a sentence if that is a guess."""
        column = self._roles.approach.get(role)
        title = self._title(column)
        is_outward = title is not None and title.name.startswith(OUTWARD_NAMES)
        falls = _falls_on_contact(values[role], values["force"])
        if falls is None:
            falls = is_outward
        if not falls:
            if is_outward:
                return [f"'{title.text}' increases towards the body"]  # type: ignore[union-attr]
            return []
        values[role] = -values[role]
        if is_outward:
            return []
        if self._roles.is_abscissa_guessed and column is not None:
            return [SEPARATION_NOTE.replace("column 1", self._name(column))]
        if role == "z":
            return ["z decreases towards the body: its sign is reversed"]
        return ["the depth decreases while the force rises: its sign is reversed"]


def _falls_on_contact(x: np.ndarray, force: np.ndarray) -> bool | None:
    """Return whether an abscissa decreases towards the body; None if the force does not show it.

    The body is at the end of the abscissa at which the force deviates more from its median,
    provided that this force is above the median.
    """
    if len(x) < 2:
        return None
    # Number of rows that suffice to find the direction.
    enough = 20_000
    step = len(x) // enough + 1
    order = np.argsort(x[::step], kind="stable")
    sorted_force = force[::step][order]
    # The force at each end is the mean of a twentieth of the rows.
    end_count = max(len(order) // 20, 1)
    middle = float(np.median(sorted_force))
    low = float(sorted_force[:end_count].mean()) - middle
    high = float(sorted_force[-end_count:].mean()) - middle
    is_low = abs(low) > abs(high)
    return is_low if max(low, high, key=abs) > 0 else None


def _complete_rows(values: Values, table: TextRows, is_paired: bool) -> tuple[_Rows, int]:
    """Return the rows that have all numbers, and the number of the other rows.

    Raises NoCurve if more than half of the rows are incomplete, unless the table also has columns
    of another part of the curve, which may be longer.
    """
    table_columns = np.column_stack(list(values.values()))
    is_complete = np.isfinite(table_columns).all(axis=1)
    # A larger number is not a measurement, whatever its unit.
    largest_measured = 1e100
    with np.errstate(invalid="ignore"):
        is_complete &= (np.abs(table_columns) < largest_measured).all(axis=1)
    count = len(is_complete)
    invalid_count = int(np.count_nonzero(~is_complete))
    # Largest fraction of the rows that may lack a number.
    max_invalid_fraction = 0.5
    is_too_incomplete = invalid_count > max_invalid_fraction * count
    if invalid_count == count or (is_too_incomplete and not is_paired):
        raise NoCurve(f"{invalid_count} of {count} rows lack a number")
    if "deflection" in values:
        values["force"] = values.pop("deflection")
    values = {name: np.ascontiguousarray(column[is_complete]) for name, column in values.items()}
    words = None if table.words is None else table.words[is_complete]
    complete_above = np.concatenate([[0], np.cumsum(is_complete)])
    marks = tuple((int(complete_above[min(row, count)]), line) for row, line in table.marks)
    return _Rows(values, words, marks), invalid_count


def _separate_tables(table: TextRows, layout: TextLayout) -> list[TextRows]:
    """Return the tables of a file whose titles are repeated between curves.

    Titles above the segments of a curve do not separate curves.
    """
    begins = [
        row
        for row, line in table.marks
        if layout.title_line and line == layout.title_line.strip() and row > 0
    ]
    if not begins or any(_segment_word(line) for _, line in table.marks):
        return [table]
    ends = [0, *begins, len(table.numbers)]
    return [
        TextRows(
            table.numbers[a:b],
            None if table.words is None else table.words[a:b],
            tuple((row - a, line) for row, line in table.marks if a < row < b),
        )
        for a, b in itertools.pairwise(ends)
        if b > a
    ]


def _segment_word(line: str) -> str:
    """Return the word in a line that names a part of a curve; "" if there is none."""
    match = SEGMENT_COMMENT.match(line.strip())
    if match:
        return match["word"].lower()
    if is_comment(line):
        return ""
    # Smallest number of letters of a word in a line between rows that names a segment.
    min_word_length = 6
    for word in re.findall(r"[^\W\d_]+", line.lower()):
        if word in (*APPROACH_WORDS, *RETRACT_WORDS) and len(word) >= min_word_length:
            return str(word)
    return ""


def _part_words(rows: _Rows, layout: TextLayout) -> np.ndarray | None:
    """Return for each row (rows,) the word of the file that names its part of the curve.

    Such words are approach and retract, for instance. None if the file has no such words.
    """
    if rows.words is not None:
        return rows.words
    named = [(row, word) for row, line in rows.marks if (word := _segment_word(line))]
    if not named:
        return None
    # A line of titles that names all parts does not begin one of them.
    above = [line for line in layout.head if line != layout.title_line]
    first = next((word for line in reversed(above) if (word := _segment_word(line))), "approach")
    count = len(next(iter(rows.values.values())))
    words = np.full(count, first, dtype=object)
    for row, word in named:
        words[row:] = word
    return words


def _parts_by_words(words: np.ndarray) -> tuple[dict[str, slice], list[str]]:
    """Return the parts that the words name, and sentences about assumptions."""
    distinct = set(words.tolist())
    if len(distinct) == 1 and not next(iter(distinct)).strip("0123456789. "):
        return {}, []
    try:
        parts = curve_parts_by_name(words)
    except NoCurve:
        return {}, [
            f"the column of segments has {len(distinct)} values such as "
            f"'{printable(str(words[0]))[:20]}', none of which names a part such as the approach: "
            "the curve is divided at its turning point"
        ]
    changes = int(np.count_nonzero(words[1:] != words[:-1]))
    notes = []
    if changes + 1 > len({segment_word(word) for word in distinct}):
        notes.append("segments are repeated: the first approach is taken")
    return parts, notes


def _order_of_time(
    t: np.ndarray | None, has_parts: bool
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Return the order that sorts the rows by time (None if they are sorted), and notes.

    If the times restart a few times, they are counted in each segment, and the segments follow each
    other.
    """
    if t is None or len(t) < 2 or has_parts:
        return None, ()
    restarts = int(np.count_nonzero(np.diff(t) < 0))
    if restarts <= MAX_RESTARTS:
        return None, ()
    return np.argsort(t, kind="stable"), ("the rows are sorted by time",)


def _continued_times(t: np.ndarray) -> np.ndarray:
    """Return times without restarts: the times of each segment continue those of the last one."""
    steps = np.diff(t)
    restarts = np.flatnonzero(steps < 0)
    if not len(restarts) or len(restarts) > MAX_RESTARTS:
        return t
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    shifted = t.copy()
    for row in map(int, restarts):
        shifted[row + 1 :] += shifted[row] + step - shifted[row + 1]
    return shifted
