"""Model only what the scene requires: which part of the body stands for the whole, and how it is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isclose

from indent_sim.model.body import Body, Box, Cylinder, Strip
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import ConfigError

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
    radius: float | None = None  # of the curved wall r_max, in three dimensions

    @property
    def pins(self) -> Pins:
        """Point constraints (point, component) that take the rigid modes the supports leave, and nothing else."""
        if self.kinematics.name == "axisymmetric" or "fixed" in self.supports.values():
            return ()
        if self.radius is not None:
            return self._round_pins(self.radius)
        corner = tuple(low for low, _ in self.extent)
        held = {
            axis for axis in "xy" if "roller" in (self.supports.get(f"{axis}_min"), self.supports.get(f"{axis}_max"))
        }
        horizontal = self.kinematics.axes[:-1]
        pins = [(corner, component) for component, axis in enumerate(horizontal) if axis not in held]
        if len(horizontal) == 2 and not held:  # the turn about z is free too
            pins.append(((self.extent[0][1], *corner[1:]), 1))
        return tuple(pins)

    def _round_pins(self, radius: float) -> Pins:
        """Without a mirror plane the turn about z is free, even between rollers; along the planes, the shift."""
        at_x, at_y = ((radius, 0.0, self.extent[2][0]), (0.0, radius, self.extent[2][0]))
        cut = [axis for axis in "xy" if f"{axis}_min" in self.supports]
        if self.supports["r_max"] == "roller":
            return () if cut else ((at_x, 1),)
        if not cut:
            return ((at_x, 0), (at_x, 1), (at_y, 0))
        return {"x": ((at_y, 1),), "y": ((at_x, 0),), "xy": ()}["".join(cut)]


def reduce(body: Body, center: tuple[float, ...], wanted: str, tip: Indenter) -> Reduction:
    """Choose the symmetric part to model; `wanted` is `mesh.symmetry`.

    Raises ConfigError when the scene does not have the symmetry that is asked for.
    """
    if isinstance(body, Cylinder):
        return _cylinder(body, center, wanted, tip)
    if isinstance(body, Strip):
        return _strip(body, center, wanted)
    return _box(body, center, wanted, tip)


def _refuse(wanted: str, why: str, remedy: str) -> ConfigError:
    return ConfigError("mesh.symmetry", f"'{wanted}' does not fit this scene: {why}", remedy)


def _mirrors(tip: Indenter, axis: str) -> bool:
    """Whether the tip is its own mirror image about the plane normal to `axis` through its axis."""
    return tip.of_revolution or tip.is_mirrored({"x": 90.0, "y": 0.0}[axis])  # type: ignore[union-attr]


def _cylinder(body: Cylinder, center: tuple[float, ...], wanted: str, tip: Indenter) -> Reduction:
    on_axis = {axis: abs(c) <= 1e-12 * body.radius for axis, c in zip("xy", center, strict=True)}
    obstacle = "" if all(on_axis.values()) else "the tip stands off the cylinder's axis"
    obstacle = obstacle if tip.of_revolution else f"a {tip.shape} is no tip of revolution"
    if wanted == "plane_strain" or (wanted == "axisymmetric" and obstacle):
        raise _refuse(wanted, obstacle or "a cylinder is not infinitely long", "use 'auto', 'half' or 'full'")
    if wanted in ("auto", "axisymmetric") and not obstacle:
        supports = {"base": body.base, "r_max": body.sides, "r_min": "roller"}
        extent = ((0.0, body.radius), (-body.height, 0.0))
        why = "tip of revolution on the axis of a cylinder"
        return Reduction(Axisymmetric(), "axisymmetric", 1, extent, supports, why)
    cuts = _cuts(wanted, [axis for axis in "xy" if on_axis[axis] and _mirrors(tip, axis)])
    low = {axis: 0.0 if axis in cuts else -body.radius for axis in "xy"}
    round_extent = ((low["x"], body.radius), (low["y"], body.radius), (-body.height, 0.0))
    supports = {"base": body.base, "r_max": body.sides, **{f"{axis}_min": "roller" for axis in cuts}}
    symmetry = ("full", "half", "quarter")[len(cuts)]
    why = f"{obstacle or 'three dimensions asked for'}; {_about(cuts)}"
    return Reduction(ThreeDimensional(), symmetry, 2 ** len(cuts), round_extent, supports, why, body.radius)


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


def _box(body: Box, center: tuple[float, ...], wanted: str, tip: Indenter) -> Reduction:
    if wanted not in ("auto", "quarter", "half", "full"):
        raise _refuse(wanted, "a box is modelled in three dimensions", "use 'auto', 'quarter', 'half' or 'full'")
    sides = body.sides
    mirrored = {
        "x": _middle(center[0], body.size[0]) and sides.x_min == sides.x_max and _mirrors(tip, "x"),
        "y": _middle(center[1], body.size[1]) and sides.y_min == sides.y_max and _mirrors(tip, "y"),
    }
    cuts = _cuts(wanted, [axis for axis, symmetric in mirrored.items() if symmetric])
    supports = {"base": str(body.base)} | {side: getattr(sides, side) for side in ("x_min", "x_max", "y_min", "y_max")}
    extent = [(0.0, body.size[0]), (0.0, body.size[1]), (-body.size[2], 0.0)]
    for axis in cuts:
        component = "xy".index(axis)
        extent[component] = (center[component], body.size[component])
        supports[f"{axis}_min"] = "roller"
    symmetry = ("full", "half", "quarter")[len(cuts)]
    why = f"tip and sides: {_about(cuts)}"
    return Reduction(ThreeDimensional(), symmetry, 2 ** len(cuts), tuple(extent), supports, why)


def _about(cuts: list[str]) -> str:
    return f"symmetric about {' and '.join(cuts)}" if cuts else "no symmetry used"


def _cuts(wanted: str, symmetric: list[str]) -> list[str]:
    needed = {"auto": len(symmetric), "full": 0, "half": 1, "quarter": 2}[wanted]
    if needed > len(symmetric):
        have = f"only about the mid-plane of {symmetric[0]}" if symmetric else "about no mid-plane"
        raise _refuse(wanted, f"tip and side conditions are symmetric {have}", "use 'auto'")
    return symmetric[:needed]


def _middle(c: float, width: float) -> bool:
    return isclose(c, width / 2, rel_tol=2e-11)  # both are rounded to 12 digits
