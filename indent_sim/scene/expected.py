"""Element sizes from the expected contact."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.algebra import cos, tan
from indent_sim.model.body import Body
from indent_sim.model.contact import ContactLaw, Penalty
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.tips import STEM, Cone, FlatPunch, Indenter, Paraboloid, Profile, Pyramid, Sphere, reach
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.theory import half_space, layer, profiles, strip
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution

TELLING = 0.005  # of the force: a smaller error is not worth a warning

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
        return self._module is strip

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
    module = strip if body.shape == "strip" else layer
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


def layer_tip(tip: Indenter) -> profiles.Tip | None:
    """The tip as layer theory sees it; a pyramid as the cone of equal sections."""
    match tip:
        case Paraboloid(R=R):
            return profiles.paraboloid(R)
        case Sphere(R=R):
            return profiles.sphere(R)
        case Cone(half_angle=angle, tip_radius=radius):
            return profiles.cone(angle, radius)
        case FlatPunch(radius=radius, edge_radius=edge):
            return profiles.flat_punch(radius, edge)
        case Pyramid(half_angle=angle, tip_radius=radius):
            return profiles.cone(float(np.degrees(np.arctan(tip.roundness * np.tan(np.radians(angle))))), radius)
        case Profile(points=points, tip_radius=0.0):
            return profiles.piecewise_linear(points)
        case Profile(points=points):
            breaks = {round(edge, 15) for c, w, _ in tip.corners() for edge in (c - w, c + w)}
            return profiles.profile(tip.slope, reach=points[-1][0], breaks=sorted(b for b in breaks if b > 0))


def _strip_tip(tip: Indenter) -> Any:
    match tip:
        case Paraboloid(R=R):
            return strip.paraboloid(R)
        case Sphere(R=R):
            return strip.sphere(R)
        case Cone(half_angle=angle, tip_radius=0.0):
            return strip.cone(angle)
        case FlatPunch(radius=radius, edge_radius=0.0):
            return strip.flat_punch(radius)
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

DEEPEST = 0.9  # of the thickness: there no force is expected to find its depth
MOST_FORCES = 3  # at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
MOST_SUNK = 1.5  # mean pressures over epsilon_n that a penalty takes from the depth, at most
DEEPER = 1.5  # power of the share of the thickness that is left: how a penalty sinks further at finite strain, measured
STEEPEST = 3.0  # d ln F/d ln delta at most: a paraboloid on a thin incompressible layer
SMALL = 0.05  # characteristic strain up to which forces of small strain are good to some per cent: a/R = 0.25
SEVERAL = 0.002  # of the force: between the equilibria of one mesh with active_set, over 1, 3 and 6 steps
ABSURD = 100.0  # depth over the radius of a tip's end: a needle, or a mistake
SAME_PLACE = 1e-9  # of a length


def depths_of(path: LoadPath, theory: Oracle | None, tip: Indenter, material: Material, height: float, scales: Scales
              ) -> tuple[float, ...]:  # fmt: skip
    """The requested depths, or those to expect at the requested forces, within DEEPEST of the body's height.

    ConfigError when theory says that a linear body does not bear the largest force.
    """
    if path.control == "depth":
        return path.values
    deepest, force = DEEPEST * height, max(path.values) * scales.force
    depths = _depths_at(path.values, theory, tip, material.E_star, scales.dim, deepest)
    if material.small_strain and theory and max(depths) > (1 - 1e-6) * deepest:
        problem = f"a force of {force:g} would press the tip to {DEEPEST:.0%} of the body's thickness or deeper"
        raise ConfigError("loading", problem, "use a smaller force")
    return depths


def _depths_at(forces: Sequence[float], theory: Oracle | None, tip: Indenter, E_star: float, dim: int, deepest: float
               ) -> tuple[float, ...]:  # fmt: skip
    """From theory, or from the tip's section where there is none or it ends; between MOST_FORCES by power laws."""
    pushed = np.unique([force for force in forces if force > 0])
    some = pushed if len(pushed) <= MOST_FORCES else np.geomspace(pushed[0], pushed[-1], MOST_FORCES)
    depths = []
    for force in map(float, some):
        start = section_depth(tip, force, E_star, dim)
        found = theory.depth(force, start, deepest) if theory else None
        depths.append(float(f"{found or min(start, deepest / 2):.9g}"))  # the same in all units, and so is the mesh
    return tuple(
        float(np.exp(np.interp(np.log(force), np.log(some), np.log(depths)))) if force > 0 else 0.0 for force in forces
    )


def prediction_of(path: LoadPath, theory: Oracle | None, tip: Indenter, material: Material, delta: float, a: float,
                  scales: Scales) -> dict[str, float]:  # fmt: skip
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and by the half-space
    formula, in the user's units."""
    prediction = {"a": a * scales.length}
    if path.control == "force":
        closed = half_space_depth(tip, max(path.values), material.E_star) if scales.dim == 3 else None
        half_space = {"delta_half_space": closed[1] * scales.length} if closed else {}
        return prediction | {"delta": delta * scales.length} | half_space
    solution = theory.at(delta) if theory and delta > 0 else None
    if solution:
        prediction["force"] = solution.force * scales.force
    closed = half_space_force(tip, delta, material.E_star) if scales.dim == 3 else None
    if closed:
        prediction["force_half_space"] = closed[1] * scales.force
    return prediction


def characteristic_strain(tip: Indenter, delta: float, a: float) -> tuple[float, str]:
    """The strain beside a contact and the formula that gave it.

    0.2 times the tip's slope at the contact's edge (Tabor 1951 for a ball, Johnson 1985, 6.3 for a cone, whatever its
    depth), a pyramid as the cone of equal sections. A punch has no slope: 0.3 delta/a, which is the same share of
    the mean pressure 2 E* delta/(pi a) as 0.2 a/R is of a ball's 4 E* a/(3 pi R), within 1 %.
    """
    match tip:
        case Paraboloid(R=R) | Sphere(R=R) if a < R or isinstance(tip, Paraboloid):
            return 0.2 * a / R, "0.2 a/R"
        case Cone(half_angle=angle, tip_radius=radius) if a > radius * cos(angle):
            return 0.2 / tan(angle), "0.2 cot(half_angle)"
        case Cone(tip_radius=radius):
            return 0.2 * a / radius, "0.2 a/tip_radius"
        case Pyramid(half_angle=angle, roundness=roundness):
            return 0.2 / (roundness * tan(angle)), "0.2 cot(half_angle of the cone of equal sections)"
        case Profile() if a < reach(tip):
            return 0.2 * tip.slope(a), "0.2 times the slope at the contact's edge"
    return 0.3 * delta / a, "0.3 delta/a"


def tip_warnings(tip: Indenter, gap: str, delta: float, a: float) -> list[str]:
    """That a tip ends inside the contact, and what the model makes of it."""
    end, warnings = reach(tip), list[str]()
    is_beyond = a >= end or (isinstance(tip, Sphere) and delta > end)
    if delta <= 0 or isinstance(tip, FlatPunch) or not is_beyond:
        return []
    if gap == "reference":
        warnings.append("deeper than the tip has a shape: where it ends the contact ends like under a punch")
    elif isinstance(tip, Sphere):
        warnings.append(f"deeper than the ball's radius: it is whole but for a stem within {STEM:g} degrees of its top")
    else:
        warnings.append("deeper than the profile is high: the body may slip around its end")
    if delta > ABSURD * end:
        warnings.append(f"the depth is {delta / end:.3g} times the radius at which the tip ends: are both in one unit?")
    return warnings
def peakless(body: Body, tip: Indenter, center: tuple[float, ...], sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements shrink, as it does
    while they are larger than the arc that rounds one.
    """
    for r, width in tip.creases() if a > 0 else []:
        size = float(sizes.at(np.array(r), np.array(0.0)))
        is_touched = r <= a + size or tip.height(r, 0.0) <= 0
        if is_touched and width < size and r < body.reach(center) * (1 - SAME_PLACE):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
    return ""


def penalty_loss(contact: ContactLaw, material: Material, theory: Oracle | None, delta: float, a: float) -> float:
    """The share of the force, at most, that a penalty costs at a depth; 0 for the other methods.

    The body feels only the depth s that the penetration leaves: s + c p(s)/epsilon_n = delta with the mean pressure p,
    and 1 - F(s)/F(delta) is lost; by theory, or as on a half-space under a paraboloid where there is none. c, the
    integral of p dp/dF over p, is 0.69 for a cone and 0.75 for a paraboloid on a half-space, and for a paraboloid on a
    thin layer 1 when it is compressible and 1.5 when not.
    """
    if not isinstance(contact, Penalty) or delta <= 0:
        return 0.0
    sunk = MOST_SUNK * (1.0 if material.small_strain else (1.0 - delta) ** -DEEPER) / contact.stiffness
    force, pressure = _carried(theory, material, delta, a, np.ones(1))
    if (quick := STEEPEST * sunk * float(pressure[0]) / delta) < TELLING:
        return quick  # a theory of many depths takes its time
    s = np.array([1e-6, 1e-3, 0.03, 0.2, 0.5, 0.8, 0.95, 1.0])
    force, pressure = _carried(theory, material, delta, a, s)
    felt = np.interp(np.log(delta), np.log(s * delta + sunk * pressure), np.log(force))
    return float(1 - np.exp(felt) / force[-1])


def _carried(theory: Oracle | None, material: Material, delta: float, a: float, s: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Force (in any unit) and mean pressure at parts s of a depth."""
    curve = theory.curve(list(s * delta)) if theory else None
    if theory and curve:
        force, radius = np.array([solution.force for solution in curve]), np.array([solution.a for solution in curve])
        return force, force / (2 * radius if theory.is_plane else pi * radius**2)
    E, nu = material.constants
    confined = E * (1 - nu) / ((1 + nu) * max(1 - 2 * nu, 1e-4)) * s  # of a body in contact from wall to wall
    return s**1.5, delta * np.maximum(4 / (3 * pi) * material.E_star / a * np.sqrt(s), confined)


def has_several_equilibria(contact: ContactLaw, gap: str) -> bool:
    """Whether more than one set of nodes in contact may be in equilibrium: nodal pressures on a deformed surface."""
    return gap == "current" and contact.multiplier == "nodal"
