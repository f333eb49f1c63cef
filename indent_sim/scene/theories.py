"""Theory of a scene: layer and half-space theory for its tip, and what the body has that theory has not."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from indent_sim.model.body import Body, Meshed
from indent_sim.model.body import Layer as BodyLayer
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Profile, Pyramid, Sphere
from indent_sim.theory import half_space, profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.march import LayerContact
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Ply, Stack
from indent_sim.theory.strip import Strip

MOST_KEPT = 100  # solutions that a theory remembers


@dataclass(frozen=True)
class Theory:
    """Small-strain theory of a body under a tip on its axis; `exact` when the body is the theory's own.

    `why` says what the finite body has that the theory has not. A depth is worked out once and remembered.
    """

    name: str
    exact: bool
    why: str
    contact: LayerContact = field(repr=False)
    _known: dict[float, Solution | None] = field(default_factory=dict, init=False, repr=False, compare=False)

    def curve(self, deltas: Sequence[float]) -> list[Solution] | None:
        """One Solution (force, a, pressure) per depth, or None where the theory ends (contact meets the wall)."""
        if len(self._known) > MOST_KEPT:
            self._known.clear()
        new = [delta for delta in deltas if delta not in self._known]
        with contextlib.suppress(ValueError):
            self._known.update(zip(new, self.contact.curve(new), strict=True))
        solutions = [solution for delta in deltas if (solution := self._known.get(delta))]
        return solutions if len(solutions) == len(deltas) else None

    def at(self, delta: float) -> Solution | None:
        """The Solution at one depth, or None."""
        solutions = self.curve([delta])
        self._known.setdefault(delta, None)
        return solutions[0] if solutions else None

    def depth(self, force: float, deepest: float) -> float | None:
        """The depth at which theory's force is this one, `deepest` at most; None when theory ends before."""
        with contextlib.suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
            return min(self.contact.depth(force), deepest)
        last = self.at(deepest)
        return deepest if last and last.force <= force else None


@dataclass(frozen=True)
class KnownTip:
    """What theory knows of a kind of tip: its shape, and force(tip, delta, E_star) of a sharp one on a half-space."""

    shape: Callable[[Any], profiles.Tip]
    half_space: str = ""  # whose formula that is; empty: nobody's
    force: Callable[[Any, float, float], float | None] = lambda tip, delta, E_star: None


def _equal_sections(tip: Pyramid) -> profiles.Tip:
    """The cone whose sections are as large as the pyramid's."""
    angle = np.degrees(np.arctan(tip.roundness * np.tan(np.radians(tip.half_angle))))
    return profiles.cone(float(angle), tip.tip_radius)


def _square_pyramid(tip: Pyramid, delta: float, E_star: float) -> float | None:
    return half_space.square_pyramid_force(delta, tip.half_angle, E_star) if tip.faces == 4 else None


def _of_points(tip: Profile) -> profiles.Tip:
    if tip.tip_radius == 0.0:
        return profiles.piecewise_linear(tip.points)
    breaks = {round(edge, 15) for c, w, _ in tip.corners() for edge in (c - w, c + w)}
    return profiles.profile(tip.slope, reach=tip.points[-1][0], breaks=sorted(b for b in breaks if b > 0))


TIPS: dict[type, KnownTip] = {
    Paraboloid: KnownTip(lambda tip: profiles.paraboloid(tip.R), "Hertz",
                         lambda tip, delta, E_star: half_space.paraboloid_force(delta, tip.R, E_star)),
    Sphere: KnownTip(lambda tip: profiles.sphere(tip.R), "Sneddon (sphere)",
                     lambda tip, delta, E_star: half_space.sphere_force(delta, tip.R, E_star)),
    Cone: KnownTip(lambda tip: profiles.cone(tip.half_angle, tip.tip_radius), "Sneddon (cone)",
                   lambda tip, delta, E_star: half_space.cone_force(delta, tip.half_angle, E_star)),
    FlatPunch: KnownTip(lambda tip: profiles.flat_punch(tip.radius, tip.edge_radius), "Sneddon (flat punch)",
                        lambda tip, delta, E_star: half_space.flat_punch_force(delta, tip.radius, E_star)),
    Pyramid: KnownTip(_equal_sections, "a square pyramid on a half-space", _square_pyramid),
    Profile: KnownTip(_of_points),
}  # fmt: skip


def shape_of(tip: Indenter) -> profiles.Tip | None:
    """The tip as layer theory sees it; None for one that it does not know."""
    known = TIPS.get(type(tip))
    with contextlib.suppress(ValueError):
        return known.shape(tip) if known else None
    return None


def layer_theory(body: Body, layers: Sequence[BodyLayer], tip: Indenter, center: tuple[float, ...]) -> Theory | None:
    """The layer theory of a scene, or None where there is none (nu < 0, a tip that theory does not know)."""
    if isinstance(body, Meshed):
        return None
    shape, is_plane = shape_of(tip), body.dim == 2
    stack = stack_of(layers, body.base)
    if shape is None or stack is None or (is_plane and shape.f is None):
        return None
    wall, exact, why = _wall(body, center)
    contact = (Strip if is_plane else Layer).on(shape, stack, wall)
    return _theory("layer theory", exact, why, layers, tip, contact)


def half_space_theory(tip: Indenter, layers: Sequence[BodyLayer]) -> Theory | None:
    """Theory of a tip on a half-space, homogeneous or the substrate of layers."""
    shape, stack = shape_of(tip), stack_of(layers, None)
    if shape is None or stack is None:
        return None
    why = "the half-space itself" if len(layers) == 1 else "the layers on the half-space itself"
    return _theory("half-space theory", True, why, layers, tip, Layer.on(shape, stack))


def stack_of(layers: Sequence[BodyLayer], base: str | None) -> Stack | None:
    """The layers as theory knows them, on a rigid base, or the last one a half-space where base is None.

    None where theory does not know a material (nu < 0). A homogeneous half-space feels E and nu only as E*.
    """
    plies = [Ply(layer.thickness or inf, *layer.material.constants) for layer in layers if layer.material]
    if base is None and len(plies) == 1:
        E_star = plies[0].E / (1 - plies[0].nu ** 2)
        return Stack((Ply(1.0, E_star, 0.0), Ply(inf, E_star, 0.0)), None)
    if any(ply.nu < 0 for ply in plies):
        return None
    if base is None:
        plies[-1] = plies[-1]._replace(thickness=inf)
    return Stack(tuple(plies), base)


def _theory(
    name: str, exact: bool, why: str, layers: Sequence[BodyLayer], tip: Indenter, contact: LayerContact
) -> Theory:
    if not tip.of_revolution:
        exact, why = False, "theory's tip is the cone of equal sections"
    if not all(layer.material and layer.material.small_strain for layer in layers):
        exact, why = False, "theory is that of small strain"
    return Theory(name, exact, why, contact)


def _wall(body: Body, center: tuple[float, ...]) -> tuple[float | None, bool, str]:
    """Radius of the roller wall, if the body has the one that theory knows, and what is different otherwise."""
    on_axis = np.allclose(center, body.center, rtol=2e-11, atol=1e-12 * body.height)  # it is rounded to 12 digits
    match body.shape:
        case "cylinder" if on_axis and body.sides == "roller":
            return body.radius, True, "a layer in a frictionless cylinder is this very body"
        case "strip" if on_axis and body.sides.x_min == body.sides.x_max == "roller":
            return body.width / 2, True, "a strip between frictionless walls is this very body"
    return None, False, "theory's layer is infinitely wide"


def section_depth(tip: Indenter, force: float, E_star: float, dim: int) -> float:
    """About the depth at which a half-space gives this force, for any tip: force = E* radius_at(depth) depth.

    In plane strain (dim = 2) force = E* depth.
    """
    size = force / E_star
    if dim == 2:
        return size
    start = float(np.sqrt(size))
    return _depth_at(lambda depth: tip.radius_at(depth) * depth, size, start) or start


def half_space_depth(tip: Indenter, force: float, E_star: float) -> tuple[str, float] | None:
    """Name and depth of the half-space closed form of a tip at a force; None for the tips without one."""
    start = section_depth(tip, force, E_star, 3)
    closed = half_space_force(tip, start, E_star)
    if closed is None:
        return None
    found = _depth_at(lambda depth: half_space_force(tip, depth, E_star)[1], force, start)  # type: ignore[index]
    return (closed[0], found) if found else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Name and force of the half-space closed form of a tip (Hertz, Sneddon); None for the tips without one."""
    known = TIPS.get(type(tip))
    is_blunt = getattr(tip, "tip_radius", 0.0) > 0 or getattr(tip, "edge_radius", 0.0) > 0
    force = known.force(tip, delta, E_star) if known and delta > 0 and not is_blunt else None
    return (known.half_space, force) if known and force is not None else None


def _depth_at(force_at: Callable[[float], float], force: float, start: float) -> float | None:
    """The depth at which an increasing force_at(depth) is `force` > 0; None when it is not reached."""
    with contextlib.suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
        return increasing_root(force_at, force, start, 1e15 * start)
    return None
