"""The theory that stands beside a scene: which closed form or layer solution applies, and how exactly."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.model.body import Body
from indent_sim.model.indenters import Cone, FlatPunch, Indenter, Paraboloid, Profile, Pyramid, Sphere
from indent_sim.model.materials import Material
from indent_sim.theory import half_space, layer, plane_strain, tips
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution

MOST_ENDS = 6  # depths tried in vain, for theory ends before them


@dataclass(frozen=True)
class Oracle:
    """Small-strain theory of a body under a tip on its axis; `exact` when the body is the theory's own.

    `why` says what the finite body has that the theory has not.
    """

    name: str
    exact: bool
    why: str
    _module: Any
    _tip: Any
    _body: dict[str, Any]

    @property
    def is_plane(self) -> bool:
        """Whether forces are per unit length and `a` is a half-width."""
        return self._module is plane_strain

    def curve(self, deltas: Sequence[float]) -> list[Solution] | None:
        """One Solution (force, a, pressure) per depth, or None where the theory ends (contact meets the wall)."""
        with contextlib.suppress(ValueError):
            return self._module.curve(self._tip, list(deltas), **self._body)
        return None

    def at(self, delta: float) -> Solution | None:
        """The Solution at one depth, or None."""
        solutions = self.curve([delta])
        return solutions[0] if solutions else None

    def depth(self, force: float, start: float, deepest: float) -> float | None:
        """The depth at which theory's force is this one, searched from `start`, the half-space's.

        `deepest` when the force there is not larger; None when theory ends before (contact meets the wall).
        """
        ends = 0

        def force_at(delta: float) -> float:
            nonlocal ends
            solution = self.at(delta)
            ends += solution is None
            if ends > MOST_ENDS:
                raise ArithmeticError("theory ends before")
            return solution.force if solution else np.inf

        if start > deepest / 2 and (last := self.at(deepest)) and last.force <= force:
            return deepest
        return depth_at(force_at, force, start, deepest)


def oracle(body: Body, material: Material, tip: Indenter, center: tuple[float, ...]) -> Oracle | None:
    """The layer theory of a scene, or None where there is none (nu < 0, a tip that theory does not know)."""
    E, nu = material.canonical().constants
    module = plane_strain if body.shape == "strip" else layer
    with contextlib.suppress(ValueError):
        theory_tip = _theory_tip(tip, module)
        if theory_tip is None or nu < 0:
            return None
        wall, exact, why = _wall(body, center)
        if not tip.of_revolution:
            exact, why = False, "theory's tip is the cone of equal sections"
        if not material.small_strain:
            exact, why = False, "theory is that of small strain"
        arguments = {"E": E, "nu": nu, "h": body.height, "base": body.base, "wall": wall}
        return Oracle("layer theory", exact, why, module, theory_tip, arguments)
    return None


def _wall(body: Body, center: tuple[float, ...]) -> tuple[float | None, bool, str]:
    """Radius of the roller wall, if the body has the one that theory knows, and what is different otherwise."""
    on_axis = np.allclose(center, body.centre, rtol=2e-11, atol=1e-12 * body.height)  # it is rounded to 12 digits
    match body.shape:
        case "cylinder" if on_axis and body.sides == "roller":
            return body.radius, True, "a layer in a frictionless cylinder is this very body"
        case "strip" if on_axis and body.sides.x_min == body.sides.x_max == "roller":
            return body.width / 2, True, "a strip between frictionless walls is this very body"
    return None, False, "theory's layer is infinitely wide"


def _theory_tip(tip: Indenter, module: Any) -> Any:
    return layer_tip(tip) if module is layer else _strip_tip(tip)


def layer_tip(tip: Indenter) -> tips.Tip | None:
    """The tip as layer theory sees it; a pyramid as the cone of equal sections."""
    match tip:
        case Paraboloid(R=R):
            return tips.paraboloid(R)
        case Sphere(R=R):
            return tips.sphere(R)
        case Cone(half_angle=angle, tip_radius=radius):
            return tips.cone(angle, radius)
        case FlatPunch(radius=radius, edge_radius=edge):
            return tips.flat_punch(radius, edge)
        case Pyramid(half_angle=angle, tip_radius=radius):
            return tips.cone(float(np.degrees(np.arctan(tip.roundness * np.tan(np.radians(angle))))), radius)
        case Profile(points=points, tip_radius=0.0):
            return tips.piecewise_linear(points)
        case Profile(points=points):
            breaks = {round(edge, 15) for c, w, _ in tip.corners() for edge in (c - w, c + w)}
            return tips.profile(tip.slope, reach=points[-1][0], breaks=sorted(b for b in breaks if b > 0))


def _strip_tip(tip: Indenter) -> Any:
    match tip:
        case Paraboloid(R=R):
            return plane_strain.paraboloid(R)
        case Sphere(R=R):
            return plane_strain.sphere(R)
        case Cone(half_angle=angle, tip_radius=0.0):
            return plane_strain.cone(angle)
        case FlatPunch(radius=radius, edge_radius=0.0):
            return plane_strain.flat_punch(radius)
    return None


def depth_at(force_at: Callable[[float], float], force: float, start: float, deepest: float) -> float | None:
    """The depth below `deepest` at which an increasing force_at(depth) is `force` > 0; None when it is not reached."""
    with contextlib.suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
        return increasing_root(force_at, force, min(start, deepest / 2), deepest)
    return None


def section_depth(tip: Indenter, force: float, E_star: float, dim: int) -> float:
    """About the depth at which a half-space gives this force, for any tip: force = E* radius_at(depth) depth.

    In plane strain (dim = 2) force = E* depth.
    """
    size = force / E_star
    if dim == 2:
        return size
    start = float(np.sqrt(size))
    return depth_at(lambda depth: tip.radius_at(depth) * depth, size, start, 1e15 * start) or start


def half_space_depth(tip: Indenter, force: float, E_star: float) -> tuple[str, float] | None:
    """Name and depth of the half-space closed form of a tip at a force; None for the tips without one."""
    start = section_depth(tip, force, E_star, 3)
    closed = half_space_force(tip, start, E_star)
    if closed is None:
        return None
    found = depth_at(lambda depth: half_space_force(tip, depth, E_star)[1], force, start, 1e15 * start)  # type: ignore[index]
    return (closed[0], found) if found else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Name and force of the half-space closed form of a tip (Hertz, Sneddon); None for the tips without one."""
    if delta <= 0:
        return None
    match tip:
        case Paraboloid(R=R):
            return "Hertz", half_space.paraboloid_force(delta, R, E_star)
        case Sphere(R=R):
            return "Sneddon (sphere)", half_space.sphere_force(delta, R, E_star)
        case Cone(half_angle=angle, tip_radius=0.0):
            return "Sneddon (cone)", half_space.cone_force(delta, angle, E_star)
        case FlatPunch(radius=radius, edge_radius=0.0):
            return "Sneddon (flat punch)", half_space.flat_punch_force(delta, radius, E_star)
        case Pyramid(half_angle=angle, faces=4, tip_radius=0.0):
            return "a square pyramid on a half-space", half_space.square_pyramid_force(delta, angle, E_star)
    return None
