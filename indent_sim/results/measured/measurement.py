"""Measured curve as arrays: depth, force and time, its parts, and its units."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError, UsageError, printable

CurvePart = Literal["approach", "hold", "retract", "both", "all"]
Abscissa = Literal["delta", "z"]
DIMENSIONS = {"delta": "length", "z": "length", "force": "force", "t": "time"}
SI = {"length": "m", "force": "N", "time": "s"}
# Parts of a curve, by the words for them in files.
APPROACH_WORDS = (
    *("approach", "appr", "extend", "extension", "ex", "loading", "load", "trace"),
    *("forward", "fwd", "compress", "compression"),
)
HOLD_WORDS = ("hold", "pause", "dwell", "intermediate")
RETRACT_WORDS = (
    *("retract", "retraction", "retr", "rt", "unloading", "unload", "withdraw", "retrace"),
    *("backward", "bwd", "recover", "recovery"),
)
PART_WORDS = {
    **dict.fromkeys(APPROACH_WORDS, "approach"),
    **dict.fromkeys(HOLD_WORDS, "hold"),
    **dict.fromkeys(RETRACT_WORDS, "retract"),
}
SEPARATION_NOTE = "column 1 falls while the force rises: it is taken as the tip-sample separation"
SENSITIVITY_KEY = "--sensitivity '50 nm/{unit}'"
STIFFNESS_KEY = "--set experiment.cantilever.stiffness=..."


class NoCurve(UsageError):
    """Error: a file or a part of it contains no measured curve; the message gives the reason."""

    prefix = "not a curve: "

    def __init__(self, why: str, file: str = ""):
        super().__init__(printable(f"{self.prefix}{why}"), file=file)


class Uncalibrated(NoCurve):
    """Error: a file of voltages lacks the calibration for their conversion to forces."""

    prefix = ""


@dataclass(frozen=True)
class MeasuredCurve:
    """Measured force curve, in the order of time.

    Attributes
    ----------
    name
        Name of the curve.
    force
        Force (n,) [force], > 0 when the tip pushes.
    delta
        Indentation depth (n,) [length], > 0 inwards; None if unknown.
    z
        Displacement of the base (n,) [length], increasing towards the body; None if unknown. Either
        delta or z is known.
    t
        Times (n,) [time], or None.
    stiffness
        Spring constant of the cantilever [force/length], if the file contains it.
    parts
        Rows of approach, hold and retract, as far as they exist.
    units
        Names of the units of length, force and time; "" if the file has no units.
    notes
        Sentences about assumptions that were made when the file was read.
    is_abscissa_guessed
        True if nothing in the file says that `delta` is a depth. If the scene has a spring, `delta`
        is then taken as the displacement of the base.
    """

    name: str
    force: np.ndarray
    delta: np.ndarray | None = None
    z: np.ndarray | None = None
    t: np.ndarray | None = None
    stiffness: float | None = None
    parts: Mapping[str, slice] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    is_abscissa_guessed: bool = False

    def __len__(self) -> int:
        return len(self.force)

    def available_abscissa(self, preferred: Abscissa) -> Abscissa:
        """Return the preferred abscissa, "delta" or "z", or the other one if it is missing."""
        alternative: Abscissa = "z" if preferred == "delta" else "delta"
        return preferred if getattr(self, preferred) is not None else alternative

    def abscissa_values(self, along: Abscissa) -> np.ndarray:
        """Return the values of an abscissa, "delta" or "z" (n,) [length]."""
        return cast(np.ndarray, getattr(self, along))

    def reinterpret_depth(self) -> MeasuredCurve:
        """Return the curve with its guessed depth reinterpreted as the displacement of the base."""
        as_separation = SEPARATION_NOTE.partition(":")[2]
        as_height = as_separation.replace("separation", "height of the base")
        notes = tuple(note.replace(as_separation, as_height) for note in self.notes)
        return replace(self, z=self.delta, delta=None, notes=notes, is_abscissa_guessed=False)

    def part(self, name: CurvePart) -> MeasuredCurve:
        """Return the rows of one part; a hold includes the preceding approach.

        The part "both" consists of approach and retraction, without a hold between them; they are
        the parts of the returned curve. Raises NoCurve if the curve has no such part.
        """
        if name == "all":
            return self
        if name == "both":
            sides = self.part("approach"), self.part("retract")
            ends = np.cumsum([0, *map(len, sides)]).tolist()
            rows = np.concatenate(
                [np.arange(len(self))[self.parts[side]] for side in ("approach", "retract")]
            )
            return replace(
                self._select_rows(rows),
                parts={"approach": slice(*ends[:2]), "retract": slice(*ends[1:])},
            )
        if name not in self.parts:
            part_names = ", ".join(self.parts)
            raise NoCurve(f"{self.name} has no {name}, only {part_names}")
        rows = self.parts[name]
        return self._select_rows(slice(0, rows.stop) if name == "hold" else rows)

    def _select_rows(self, rows: slice | np.ndarray) -> MeasuredCurve:
        """Return a copy of the curve restricted to some of its rows, with `parts` empty."""
        cut = {
            name: None if (values := getattr(self, name)) is None else values[rows]
            for name in DIMENSIONS
        }
        return replace(self, parts={}, **cut)  # type: ignore[arg-type]

    def convert_units(self, units: Mapping[str, str]) -> MeasuredCurve:
        """Return the curve in the units of a scene, with times in seconds.

        Numbers without a unit are assumed to be in the scene's units. ConfigError is raised if the
        curve has a unit of a kind for which the scene has no unit.
        """
        wanted = dict(units) | {"time": "s"}
        factors = {
            kind: _unit_ratio(kind, self.units.get(kind, ""), wanted.get(kind, ""))
            for kind in DIMENSIONS.values()
        }
        present_columns = {
            name: values for name in DIMENSIONS if (values := getattr(self, name)) is not None
        }
        columns = {
            name: values * factors[DIMENSIONS[name]] for name, values in present_columns.items()
        }
        stiffness = self.stiffness and self.stiffness * factors["force"] / factors["length"]
        guesses = tuple(
            f"the file has no unit of {kind}: {wanted[kind]} is assumed, the unit of the scene"
            for kind in ("length", "force")
            if self.units.get(kind) == "" and wanted.get(kind)
        )
        return replace(  # type: ignore[arg-type]
            self, **columns, stiffness=stiffness, units=wanted, notes=(*self.notes, *guesses)
        )


def _unit_ratio(kind: str, curve_unit: str, wanted_unit: str) -> float:
    """Return the factor from the curve's unit to the wanted one; 1 if the curve has no unit."""
    if not curve_unit or curve_unit == wanted_unit:
        return 1.0
    if not wanted_unit:
        remedy = "add units: {length: um, force: nN} to the scene"
        raise ConfigError(
            "units",
            f"the curve has the {kind} in {curve_unit}, and the scene has no unit for it",
            remedy,
        )
    return si_factor(curve_unit, kind) / si_factor(wanted_unit, kind)


def curve_parts(x: np.ndarray, is_timed: bool = False) -> dict[str, slice]:
    """Return the rows of approach, hold and retract, from depths in the order of the file.

    A path on which the depth only decreases is an approach in reverse order, as in files sorted by
    z, unless the rows are in the order of time.

    Parameters
    ----------
    x
        Depths or displacements of the base (n,), increasing inwards.
    is_timed
        Whether the rows are known to be in the order of time.
    """
    n = len(x)
    span = float(np.ptp(x))
    if n < 2 or not span > 0:
        return {"approach": slice(0, n)}
    deepest = int(np.argmax(x))
    top = float(x.max())
    # If the path goes back by less than this fraction of its range, it has no retraction.
    min_retraction = 0.1
    # The path begins at the largest depth, which then decreases.
    if top - x[0] < min_retraction * span:
        far = int(np.argmin(x))
        if not _is_path(x):
            return {"approach": slice(0, n)}
        if float(x[far:].max() - x[far]) > min_retraction * span:
            return {"retract": slice(0, far), "approach": slice(far, n)}
        return {"retract" if is_timed else "approach": slice(0, n)}
    # Rows whose depth is within this fraction of the range from the largest depth may be a hold. A
    # path at a constant rate in and out has 2 % of its rows there; five times as many rows, and at
    # least ten, are a hold.
    plateau_width = 0.01
    min_hold_fraction = 0.1
    min_hold_rows = 10
    high = np.flatnonzero(x > top - plateau_width * span)
    first = int(high[0])
    last = int(high[-1]) + 1
    if len(high) > max(min_hold_fraction * n, min_hold_rows):
        parts = {"approach": slice(0, first + 1), "hold": slice(first + 1, last)}
    else:
        parts = {"approach": slice(0, deepest + 1)}
        last = deepest + 1
    if last < n and top - x[last:].min() > min_retraction * span:
        return parts | {"retract": slice(last, n)}
    if "hold" in parts:
        return parts | {"hold": slice(first + 1, n)}
    return {"approach": slice(0, n)}


def _is_path(x: np.ndarray) -> bool:
    """Return whether depths (n,) change systematically, and are not noise around one depth."""
    # The means of this many blocks span most of the range of a path, but only a part of the range
    # of noise.
    block_count = 20
    min_span = 0.6
    means = [float(block.mean()) for block in np.array_split(x, block_count) if len(block)]
    return max(means) - min(means) > min_span * float(np.ptp(x))


def segment_word(name: str) -> str:
    """Return a segment's name in lower case without a leading number: 1-Compress is compress."""
    return re.sub(r"^\d+\W+(?=\w)", "", name.strip().lower())


def curve_parts_by_name(names: np.ndarray) -> dict[str, slice]:
    """Return the rows of approach, hold and retract, from a column of names or numbers.

    Parameters
    ----------
    names
        One per row: approach, extend, hold, pause, retract, ... or two numbers in order of time.

    Raises
    ------
    NoCurve
        If a name is unknown.
    """
    changes = np.flatnonzero(names[1:] != names[:-1]) + 1
    ends = [0, *map(int, changes), len(names)]
    parts: dict[str, slice] = {}
    distinct_names = {str(name) for name in names[ends[:-1]]}
    by_number = dict(zip(sorted(distinct_names), ("approach", "retract"), strict=False))
    for begin, end in itertools.pairwise(ends):
        word = segment_word(str(names[begin]))
        part = PART_WORDS.get(word) or (
            by_number.get(str(names[begin])) if len(distinct_names) <= 2 else None
        )
        if part is None:
            raise NoCurve(
                f"'{word}' is not a part of a curve; the parts are approach, hold, retract"
            )
        if part not in parts:
            parts[part] = slice(begin, end)
        elif parts[part].stop == begin:
            parts[part] = slice(parts[part].start, end)
    return parts
