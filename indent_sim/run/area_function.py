"""Area functions of tips: the projected contact area as a function of the contact depth."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path

import numpy as np

from indent_sim.config.quantities import convert_quantity, si_factor
from indent_sim.model.tips import (
    Berkovich,
    Cone,
    FlatPunch,
    Indenter,
    Plate,
    Profile,
    Sphere,
    Vickers,
)
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.measured.measurement import NoCurve
from indent_sim.results.measured.text_layout import TextLayout, detect_layout

IDEAL_TIPS: dict[str, Indenter] = {"berkovich": Berkovich(), "vickers": Vickers()}


@dataclass(frozen=True)
class AreaFunction:
    """Projected area of the contact at a contact depth h_c.

    Attributes
    ----------
    words
        Description for the user.
    function
        Area [length^2] at a depth [length].
    smallest, largest
        Range of depths [length] in which the function is known.
    tip
        The tip whose section is the area; None for other area functions.
    """

    words: str
    function: Callable[[float], float]
    smallest: float = 0.0
    largest: float = inf
    tip: Indenter | None = None

    def __call__(self, h_c: float) -> float:
        """Return the area [length^2]; raise UsageError outside the range of the function."""
        if not self.smallest <= h_c <= self.largest:
            raise UsageError(
                f"the contact depth {h_c:.4g} is outside the range of the area function "
                f"({self.words}), which is {self.smallest:.4g} to {self.largest:.4g}",
                "give an area function for this depth with --area",
            )
        area = self.function(h_c)
        if not area > 0:
            raise UsageError(
                f"the area function ({self.words}) is {area:.4g} at the contact depth {h_c:.4g}"
            )
        return area


def area_of_tip(tip: Indenter, words: str = "") -> AreaFunction:
    """Return the area of the section of a tip at the height h_c above its apex.

    Raises ConfigError for a plate, which has no section.
    """
    if isinstance(tip, Plate):
        raise ConfigError("indenter.shape", "a plate has no area function", "give --area")
    text = words or f"section of the scene's tip ({tip.shape})"
    if isinstance(tip, FlatPunch):
        # The contact depth of a flat punch is 0; by round-off or noise it may be negative.
        area = pi * tip.radius**2
        return AreaFunction(text, lambda h_c: area, -inf, inf, tip)
    largest = inf
    if isinstance(tip, Sphere):
        largest = tip.R
    elif isinstance(tip, Profile):
        largest = tip.points[-1][1]
    return AreaFunction(text, lambda h_c: pi * tip.radius_at(h_c) ** 2, 0.0, largest, tip)


def area_from_text(text: str, units: Mapping[str, str]) -> AreaFunction:
    """Return the area function of "berkovich", "vickers", a cone's half angle, or a file.

    Parameters
    ----------
    text
        The word, the angle between axis and flank in degrees, or the path of a table.
    units
        Units of the curve; a table with units is converted to them.

    Raises
    ------
    ConfigError
        If the text is none of these.
    UsageError
        If the file is not a table of depths and areas.
    """
    if text in IDEAL_TIPS:
        tip = IDEAL_TIPS[text]
        factor = pi * tip.radius_at(1.0) ** 2
        return area_of_tip(tip, f"ideal {text.capitalize()} tip, A = {factor:.5g} h_c^2")
    if Path(text).exists():
        return _area_of_file(Path(text), units)
    try:
        half_angle = convert_quantity("--area", text, "degrees", {})
    except ConfigError:
        raise ConfigError(
            "--area",
            f"'{text}' is neither a file nor a tip",
            "give berkovich, vickers, a half angle in degrees, or the file of a table",
        ) from None
    # A cone of this half angle would be a needle or a plate.
    if not 1 < half_angle < 89:
        raise ConfigError(
            "--area", f"the half angle {half_angle:g} is not between 1 and 89 degrees"
        )
    return area_of_tip(Cone(half_angle), f"cone of half angle {half_angle:g} degrees")


def _area_of_file(path: Path, units: Mapping[str, str]) -> AreaFunction:
    """Return the area function of a table with columns of contact depth and area.

    sqrt(area) is interpolated linearly, which is exact for a cone and for a pyramid.
    """
    try:
        text = read_regular_file(path).decode("utf-8-sig").replace("\r\n", "\n")
        layout = detect_layout(text)
        table = np.array(
            [
                [layout.number(cell) for cell in layout.cells(line.strip())]
                for line in text.split("\n")[layout.first_row :]
                if line.strip() and line.lstrip()[0] not in "#%"
            ]
        )
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}", file=str(path)) from None
    except NoCurve as error:
        problem = error.problem.removeprefix(error.prefix)
        raise UsageError(f"{path} is not an area function: {problem}", file=str(path)) from None
    except UnicodeDecodeError:
        raise UsageError(
            f"{path} is not an area function: not UTF-8 text", file=str(path)
        ) from None
    except ValueError as error:
        raise UsageError(f"{path} is not an area function: {error}", file=str(path)) from None
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise UsageError(
            f"{path} is not an area function: it must have two columns, contact depth and area, "
            "and at least two rows",
            file=str(path),
        )
    h_c, area = (
        column * factor
        for column, factor in zip(table.T, _factors(path, layout, units), strict=True)
    )
    if not (
        np.isfinite(table).all()
        and (np.diff(h_c) > 0).all()
        and (np.diff(area) > 0).all()
        and h_c[0] >= 0
        and area[0] >= 0
    ):
        raise UsageError(
            f"{path} is not an area function: depths and areas must be finite, not negative, and "
            "increase from row to row",
            file=str(path),
        )
    return AreaFunction(
        f"table {path.name}",
        lambda depth: float(np.interp(depth, h_c, np.sqrt(area)) ** 2),
        float(h_c[0]),
        float(h_c[-1]),
    )


def _unit_in_brackets(title: str) -> str:
    """Return the unit at the end of a title such as h_c [nm] or A (nm^2); "" without a unit."""
    match = re.fullmatch(r".*[\[(]([^\])]*)[\])]\s*", title)
    return match[1].strip() if match else ""


def _factors(path: Path, layout: TextLayout, units: Mapping[str, str]) -> tuple[float, float]:
    """Return the factors from the units of a table to those of the curve; 1 if it has no units."""
    if not layout.titles:
        return 1.0, 1.0
    depth_unit, area_unit = (_unit_in_brackets(title.text) for title in layout.titles[:2])
    if not depth_unit and not area_unit:
        return 1.0, 1.0
    if not (depth_unit and area_unit and units.get("length")):
        raise UsageError(
            f"{path}: the unit of the contact depth is {depth_unit or 'not given'}, that of the "
            f"area {area_unit or 'not given'}, and that of lengths in the measured curve "
            f"{units.get('length') or 'not given'}; give all three or none",
            "write titles such as 'depth [nm],area [nm^2]'",
            str(path),
        )
    length = si_factor(units["length"], "length")
    return si_factor(depth_unit, "length") / length, si_factor(area_unit, "area") / length**2
