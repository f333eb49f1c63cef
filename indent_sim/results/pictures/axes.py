"""Labels of the axes of pictures, and units of the numbers shown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from indent_sim.model.symbols import lookup
from indent_sim.process.errors import UsageError, printable
from indent_sim.results.reader import Results
from indent_sim.results.result_files import Report

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

PREFIX_POWERS = {
    "p": -12,
    "n": -9,
    "u": -6,
    "µ": -6,
    "μ": -6,
    "m": -3,
    "": 0,
    "k": 3,
    "M": 6,
    "G": 9,
}
BASE_UNITS = {"length": "m", "force": "N", "pressure": "Pa", "line": "N/m"}
SHOWN_UNITS = "shown_units"  # Entry of a report: units requested for a picture, by kind.
COLUMN_LABELS = {
    "delta": ("depth δ", "length"),
    "force": ("force F", "force"),
    "a": ("contact radius a", "length"),
    "hardness": ("hardness H", "pressure"),
    "pore_pressure_max": ("largest pore pressure p", "pressure"),
    "p_max": ("largest pressure p", "pressure"),
    "penetration": ("penetration", "length"),
    "x": ("slide x", "length"),
    "side_force_x": ("side force $F_x$", "force"),
    "side_force_y": ("side force $F_y$", "force"),
}


@dataclass(frozen=True)
class Axis:
    """Label of an axis, with the factor and unit of its numbers.

    Attributes
    ----------
    name
        Name of the quantity.
    factor
        Factor by which the numbers of a result are multiplied for the picture.
    unit
        Unit of the numbers shown; "" without a unit.
    """

    name: str
    factor: float = 1.0
    unit: str = ""

    @property
    def label(self) -> str:
        """Label of the axis: its name, and its unit in brackets."""
        return f"{self.name} [{printed_unit(self.unit)}]" if self.unit else self.name

    def __call__(self, values: ArrayLike) -> np.ndarray:
        """Return values in the unit of the axis."""
        return np.asarray(values, dtype=float) * self.factor

    def value_text(self, value: float, digits: int = 4) -> str:
        """Return a value with its unit as text."""
        return f"{float(self(value)):.{digits}g} {printed_unit(self.unit)}".strip()


def printed_unit(unit: str) -> str:
    """Return a unit as it is printed, with a Greek letter in um and uN."""
    parts = picture_text(unit).split("/")
    return "/".join(f"µ{part[1:]}" if part.rstrip("²³") in ("um", "uN") else part for part in parts)


def picture_text(text: str, max_characters: int = 60) -> str:
    """Return a user's text for a picture: on one line, shortened, with dollar signs escaped."""
    text = printable(text)
    text = text if len(text) <= max_characters else f"{text[: max_characters - 1]}…"
    text = text.replace("$", r"\$")
    # Matplotlib leaves names that begin with an underscore out of a legend.
    return f" {text}" if text.startswith("_") else text


def plan_choice(report: Report, key: str) -> str | None:
    """Return the program's choice for a key of the plan; None if the report has no such choice."""
    choices = report.get("plan", {}).get("choices", [])
    return next((str(choice["value"]) for choice in choices if choice.get("key") == key), None)


def is_plane_strain(results: Results) -> bool:
    """Return whether the forces of a result are per unit length."""
    return plan_choice(results.report, "kinematics") == "plane_strain"


def horizontal_axis_name(run: Results) -> str:
    """Return the name of the horizontal axis: r for an axisymmetric body, otherwise x."""
    return "r" if plan_choice(run.report, "kinematics") in (None, "axisymmetric") else "x"


def tip_axis_position(
    runs: Sequence[Results],
    along: Literal[0, 1] = 0,
    slides: Sequence[np.ndarray] | None = None,
) -> tuple[float, str]:
    """Return the position of the tips' axis [length] along x or y, and the axis label.

    For tips at different positions, the coordinate is the distance from each tip's axis, so that
    the position is 0.

    Parameters
    ----------
    runs
        The results in the picture.
    along
        0 for x, 1 for y.
    slides
        For each result, the displacement (x, y) of a tip that slides [length]; 0 if the whole
        argument is None.
    """
    moved = [0.0] * len(runs) if slides is None else [slide[along] for slide in slides]
    places = {
        float([*(run.report.get("center") or [0.0]), 0.0, 0.0][along] + slide)
        for run, slide in zip(runs, moved, strict=True)
    }
    if len(places) == 1:
        return places.pop(), "y" if along else horizontal_axis_name(runs[0])
    return 0.0, "distance from the tip's axis"


def time_axis(runs: Sequence[Results], name: str = "time t") -> Axis:
    """Return the axis of times, in seconds if all results have units."""
    return Axis(
        name, unit="s" if all((run.report.get("units") or {}).get("length") for run in runs) else ""
    )


def time_text(run: Results, t: float) -> str:
    """Return a time with its unit as text, with three significant digits."""
    rounded = float(f"{t:.3g}")
    number = f"{rounded:.0f}" if 1e3 <= abs(rounded) < 1e7 else f"{rounded:g}"
    return f"{number} {time_axis([run]).unit}".strip()


def axis_of_column(column: str, runs: Sequence[Results]) -> Axis:
    """Return the axis of a column of the force table, in the common unit of the results."""
    name, kind = COLUMN_LABELS[column]
    if all(is_plane_strain(run) for run in runs):
        plane_strain_labels = {
            "a": ("contact half-width a", "length"),
            "force": ("force F per length", "line"),
            "side_force_x": ("side force $F_x$ per length", "line"),
        }
        name, kind = plane_strain_labels.get(column, (name, kind))
    return scaled_axis(kind, runs, np.concatenate([run[column] for run in runs]), name)


def scaled_axis(kind: str, runs: Sequence[Results], values: ArrayLike, name: str) -> Axis:
    """Return an axis in the common unit of the results, or in the unit requested for the picture.

    Lengths in m, forces in N, and pressures in SI units get a prefix that is suitable for their
    largest number. Other units of length and force, such as mm, are kept.

    Parameters
    ----------
    kind
        "length", "force", "pressure" or "line" (force per length).
    runs
        The results in the picture.
    values
        The numbers to be shown.
    name
        Name of the quantity.

    Raises
    ------
    UsageError
        If the requested unit is unknown, or the results have no SI units.
    """
    unit = _common_unit(unit_label(kind, run.report.get("units") or {}) for run in runs)
    wanted_unit = _common_unit((run.report.get(SHOWN_UNITS) or {}).get(kind, "") for run in runs)
    power = _power_of_ten(kind, unit)
    if power is None:
        if wanted_unit:
            problem = f"the {kind} of these results has {'the unit ' + unit if unit else 'no unit'}"
            raise UsageError(
                f"{problem}: it cannot be shown in {wanted_unit}; "
                "add units: {length, force} to the scene"
            )
        return Axis(name, 1.0, unit)
    if wanted_unit:
        wanted_power = _prefix_power(wanted_unit, BASE_UNITS[kind])
        if wanted_power is None:
            examples = {
                "length": "nm, um, mm",
                "force": "pN, nN, mN",
                "pressure": "Pa, kPa, MPa",
                "line": "mN/m, N/m",
            }
            raise UsageError(f"{wanted_unit} is not a unit of {kind} such as {examples[kind]}")
        return Axis(name, 10.0 ** (power - wanted_power), wanted_unit)
    is_chosen = unit not in BASE_UNITS.values() and kind in ("length", "force")
    return (
        Axis(name, 1.0, unit)
        if is_chosen
        else _prefixed_axis(kind, power, np.asarray(values, dtype=float), name)
    )


def _common_unit(units: Iterable[str]) -> str:
    """Return the unit that all results have; "" if they differ."""
    distinct_units = set(units)
    return distinct_units.pop() if len(distinct_units) == 1 else ""


def _prefixed_axis(kind: str, power: int, values: np.ndarray, name: str) -> Axis:
    """Return the axis whose prefix brings the largest number between about 0.2 and 200."""
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    size = power + (np.log10(largest) - 0.3 if largest > 0 else 0)
    prefix_power = int(np.clip(3 * np.floor(size / 3 + 1e-9), -12, 9))
    prefix = next(prefix for prefix, of in PREFIX_POWERS.items() if of == prefix_power)
    return Axis(name, 10.0 ** (power - prefix_power), prefix + BASE_UNITS[kind])


def unit_label(kind: str, units: Mapping[str, str]) -> str:
    """Return the unit of a kind of quantity from the units of length and force.

    Parameters
    ----------
    kind
        "length", "force", "line" (force/length), "pressure" or "pressure/length".
    units
        Units of "length" and "force"; either may be missing.
    """
    length = units.get("length", "")
    force = units.get("force", "")
    if kind == "length" or not (length and force):
        return {"length": length, "force": force}.get(kind, "")
    denominators = {
        "force": "",
        "line": f"/{length}",
        "pressure": f"/{length}²",
        "pressure/length": f"/{length}³",
    }
    return f"{force}{denominators[kind]}"


def unit_label_of_key(key: str, run: Results) -> str:
    """Return the unit of a key of the scene such as material.E.

    The unit is "" unless the quantity is a length, force, pressure or pressure per length.
    """
    section, _, name = key.rpartition(".")
    symbol = lookup(name, section.split(".")[0])
    if symbol is None or symbol.dimension not in ("length", "force", "pressure", "pressure/length"):
        return ""
    return unit_label(symbol.dimension, run.report.get("units") or {})


def _power_of_ten(kind: str, unit: str) -> int | None:
    """Return n for a unit of 10^n SI units; None if it is not an SI unit with a prefix."""
    if kind in ("length", "force"):
        return _prefix_power(unit, BASE_UNITS[kind])
    force, _, length = unit.rstrip("²").partition("/")
    force_power = _prefix_power(force, "N")
    length_power = _prefix_power(length, "m")
    if force_power is None or length_power is None:
        return None
    return force_power - (2 if kind == "pressure" else 1) * length_power


def _prefix_power(unit: str, base: str) -> int | None:
    """Return the power of ten of the prefix of a unit; None if there is no such prefix."""
    return PREFIX_POWERS.get(unit[: -len(base)]) if unit.endswith(base) else None
