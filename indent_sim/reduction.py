"""Model only what the scene requires: which part of the body stands for the whole, and how it is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose

from indent_sim.errors import ConfigError
from indent_sim.model.body import Body, Box, Cylinder, Strip
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional

Extent = tuple[tuple[float, float], ...]
Pins = tuple[tuple[tuple[float, ...], int], ...]


@dataclass(frozen=True)
class Reduction:
    """The modelled part: its kinematics, extent and supports; `copies` of it make the body."""

    kinematics: Kinematics
    symmetry: str
    copies: int
    extent: Extent
    supports: Mapping[str, str]
    why: str

    @property
    def pins(self) -> Pins:
        """Point constraints (point, component) that take the rigid modes the supports leave, and nothing else."""
        if self.kinematics.name == "axisymmetric" or "fixed" in self.supports.values():
            return ()
        corner = tuple(low for low, _ in self.extent)
        held = {
            axis for axis in "xy" if "roller" in (self.supports.get(f"{axis}_min"), self.supports.get(f"{axis}_max"))
        }
        horizontal = self.kinematics.axes[:-1]
        pins = [(corner, component) for component, axis in enumerate(horizontal) if axis not in held]
        if len(horizontal) == 2 and not held:  # the turn about z is free too
            pins.append(((self.extent[0][1], *corner[1:]), 1))
        return tuple(pins)


def reduce(body: Body, center: tuple[float, ...], wanted: str) -> Reduction:
    """Choose the symmetric part to model; `wanted` is `mesh.symmetry`.

    Raises ConfigError when the scene does not have the symmetry that is asked for.
    """
    if isinstance(body, Cylinder):
        return _cylinder(body, center, wanted)
    if isinstance(body, Strip):
        return _strip(body, center, wanted)
    return _box(body, center, wanted)


def _refuse(wanted: str, why: str, remedy: str) -> ConfigError:
    return ConfigError("mesh.symmetry", f"'{wanted}' does not fit this scene: {why}", remedy)


def _cylinder(body: Cylinder, center: tuple[float, ...], wanted: str) -> Reduction:
    if wanted not in ("auto", "axisymmetric"):
        raise _refuse(wanted, "a cylinder is modelled axisymmetrically", "use 'auto' or 'axisymmetric'")
    if any(abs(c) > 1e-12 * body.radius for c in center):
        raise ConfigError("indenter.center", "a tip off the axis of a cylinder is not modelled", "use [0, 0] or a box")
    supports = {"base": body.base, "r_max": body.sides, "r_min": "roller"}
    extent = ((0.0, body.radius), (-body.height, 0.0))
    return Reduction(Axisymmetric(), "axisymmetric", 1, extent, supports, "tip of revolution on the axis of a cylinder")


def _strip(body: Strip, center: tuple[float, ...], wanted: str) -> Reduction:
    if wanted not in ("auto", "plane_strain", "half", "full"):
        raise _refuse(wanted, "a strip is modelled in plane strain", "use 'auto', 'half' or 'full'")
    symmetric = _middle(center[0], body.width) and body.sides.x_min == body.sides.x_max
    supports = {"base": body.base, "x_min": body.sides.x_min, "x_max": body.sides.x_max}
    if wanted == "half" and not symmetric:
        raise _refuse(wanted, "tip or side conditions are not symmetric about the middle", "use 'auto' or 'full'")
    if wanted == "full" or not symmetric:
        why = "plane strain, asked for whole" if wanted == "full" else "plane strain, not symmetric about the tip"
        extent = ((0.0, body.width), (-body.height, 0.0))
        return Reduction(PlaneStrain(), "full", 1, extent, supports, why)
    extent = ((center[0], body.width), (-body.height, 0.0))
    why = "plane strain, tip and sides symmetric about the middle"
    return Reduction(PlaneStrain(), "half", 2, extent, {**supports, "x_min": "roller"}, why)


def _box(body: Box, center: tuple[float, ...], wanted: str) -> Reduction:
    if wanted not in ("auto", "quarter", "half", "full"):
        raise _refuse(wanted, "a box is modelled in three dimensions", "use 'auto', 'quarter', 'half' or 'full'")
    sides = body.sides
    mirrored = {
        "x": _middle(center[0], body.size[0]) and sides.x_min == sides.x_max,
        "y": _middle(center[1], body.size[1]) and sides.y_min == sides.y_max,
    }
    cuts = _cuts(wanted, [axis for axis, symmetric in mirrored.items() if symmetric])
    supports = {"base": str(body.base)} | {side: getattr(sides, side) for side in ("x_min", "x_max", "y_min", "y_max")}
    extent = [(0.0, body.size[0]), (0.0, body.size[1]), (-body.size[2], 0.0)]
    for axis in cuts:
        component = "xy".index(axis)
        extent[component] = (center[component], body.size[component])
        supports[f"{axis}_min"] = "roller"
    symmetry = ("full", "half", "quarter")[len(cuts)]
    about = f"symmetric about {' and '.join(cuts)}" if cuts else "no symmetry used"
    return Reduction(ThreeDimensional(), symmetry, 2 ** len(cuts), tuple(extent), supports, f"tip and sides: {about}")


def _cuts(wanted: str, symmetric: list[str]) -> list[str]:
    needed = {"auto": len(symmetric), "full": 0, "half": 1, "quarter": 2}[wanted]
    if needed > len(symmetric):
        have = f"only about the mid-plane of {symmetric[0]}" if symmetric else "about no mid-plane"
        raise _refuse(wanted, f"tip and side conditions are symmetric {have}", "use 'auto'")
    return symmetric[:needed]


def _middle(c: float, width: float) -> bool:
    return isclose(c, width / 2, rel_tol=1e-12)
