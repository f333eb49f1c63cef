"""Theory of a scene: layer and half-space theory for its tip, and what the body has that theory has not."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from math import ceil, inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.model.body import Body, Dome, Endless, HalfSpace, Meshed
from indent_sim.model.body import Layer as BodyLayer
from indent_sim.model.loading import LoadPath
from indent_sim.model.tips import (
    Berkovich,
    Cone,
    CubeCorner,
    FlatPunch,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Pyramid,
    RegularPyramid,
    Sphere,
    Vickers,
)
from indent_sim.theory import half_space, profiles
from indent_sim.theory.films import dimitriadis_force, gao_modulus, perriot_barthel_modulus
from indent_sim.theory.layer import Layer
from indent_sim.theory.march import LayerContact
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution
from indent_sim.theory.stack import Ply, Stack
from indent_sim.theory.strip import Strip

if TYPE_CHECKING:
    from indent_sim.theory.surface.adhesion import Jkr

MOST_KEPT = 100  # solutions that a theory remembers
OWN_ERROR = 1e-8  # of theory's numbers, stated: ten times what was measured
NO_INCLUSIONS = "theory's body has no inclusions"
CONTRAST, STEEP = 1e4, 2.5  # between moduli from which theory loses digits, and the power: 2e-6 was measured at 1e5

SAMPLED = 10  # depths of a path at which it is asked whether theory's tip would have to pull

Formula = Callable[[float], float]


@dataclass(frozen=True)
class Theory:
    """Small-strain theory of a body under a tip on its axis; `exact` when the body is the theory's own.

    `why` says what the finite body has that the theory has not. `error`: of its numbers, relative. `pull`: the share of
    the force that the tip would have to pull with, where that alone keeps it from being exact. `formulas`: force
    [pressure length^2] at a depth [length] by the usual formulas for such a body. A depth is worked out once and
    remembered.
    """

    name: str
    exact: bool
    why: str
    contact: LayerContact = field(repr=False)
    error: float = OWN_ERROR
    formulas: Mapping[str, Formula] = field(default_factory=dict, repr=False)
    pull: float = 0.0
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

    def along(self, deltas: Sequence[float]) -> Theory:
        """The same theory, no longer exact where its tip would have to pull at one of the depths."""
        if not self.exact or len(self.contact.scaled.plies) == 1:
            return self
        some = {*deltas[:: ceil(len(deltas) / SAMPLED)], max(deltas)}
        found = [solution for delta in some if delta > 0 and (solution := self.at(delta))]
        pull = max(map(self.contact.tension, found), default=0.0)
        if not pull:
            return self
        why = f"theory's tip would pull with {100 * pull:.1g} % of the force to keep its contact whole"
        return replace(self, exact=False, why=why, pull=pull, error=max(self.error, pull))

    def reaches(self, path: LoadPath, deepest: float) -> bool:
        """Whether theory goes as far as a path, whose deepest contact is to be expected at this depth."""
        if path.control == "force":
            return max(path.values) <= 0 or self.depth(max(path.values), inf) is not None
        return deepest <= 0 or self.at(deepest) is not None

    def formula_at(self, name: str, delta: float, force: float | None = None) -> float | None:
        """Force at a depth by a usual formula or, where a force is given, its depth, near this one; None: no such."""
        formula = self.formulas[name]
        found = formula(delta) if force is None else _depth_at(formula, force, delta)
        return found if found is not None and np.isfinite(found) else None


@dataclass(frozen=True)
class KnownTip:
    """What theory knows of a kind of tip: its shape, and force(tip, delta, E_star) of a sharp one on a half-space."""

    shape: Callable[[Any], profiles.Tip]
    half_space: str = ""  # whose formula that is; empty: nobody's
    force: Callable[[Any, float, float], float | None] = lambda tip, delta, E_star: None


def _equal_sections(tip: RegularPyramid) -> profiles.Tip:
    """The cone whose sections are as large as the pyramid's."""
    angle = np.degrees(np.arctan(tip.roundness * np.tan(np.radians(tip.half_angle))))
    return profiles.cone(float(angle), tip.tip_radius)


def _square_pyramid(tip: RegularPyramid, delta: float, E_star: float) -> float | None:
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
    Plate: KnownTip(lambda tip: profiles.plane()),
    **{kind: KnownTip(_equal_sections, "a square pyramid on a half-space", _square_pyramid)
       for kind in (Pyramid, Berkovich, Vickers, CubeCorner)},
    Profile: KnownTip(_of_points),
}  # fmt: skip


def shape_of(tip: Indenter) -> profiles.Tip | None:
    """The tip as layer theory sees it; None for one that it does not know."""
    known = TIPS.get(type(tip))
    with contextlib.suppress(ValueError):
        return known.shape(tip) if known else None
    return None


def theory_of(body: Body, layers: Sequence[BodyLayer], tip: Indenter, center: tuple[float, ...]) -> Theory | None:
    """The theory of a tip on a body, its inclusions left out, or None where there is none."""
    found = half_space_theory(tip, layers) if isinstance(body, HalfSpace) else layer_theory(body, layers, tip, center)
    if found is None or not body.inclusions:
        return found
    return replace(found, exact=False, why=NO_INCLUSIONS if found.exact else f"{found.why}; {NO_INCLUSIONS}")


def layer_theory(body: Body, layers: Sequence[BodyLayer], tip: Indenter, center: tuple[float, ...]) -> Theory | None:
    """The layer theory of a scene, or None where there is none (nu < 0, a tip that theory does not know)."""
    if isinstance(body, Meshed):
        return None
    assert not isinstance(body, HalfSpace)
    if isinstance(body, Dome):
        return _dome_theory(body, layers, tip)
    shape, is_plane = shape_of(tip), body.dim == 2
    stack = stack_of(layers, body.base)
    if shape is None or stack is None or (is_plane and shape.f is None):
        return None
    wall, exact, why = _wall(body, center)
    contact = (Strip if is_plane else Layer).on(shape, stack, wall)
    formulas = {} if is_plane else _layer_formulas(layers, tip, body.base)
    return _isotropic(_theory("layer theory", exact, why, layers, tip, contact, formulas), layers)


def _dome_theory(body: Dome, layers: Sequence[BodyLayer], tip: Indenter) -> Theory | None:
    """Theory of a flat body under the curvatures of tip and dome: a layer as high as a cap, a half-space for a ball."""
    is_cap = body.shape == "cap"
    shape, stack = shape_of(tip), stack_of(layers, body.base if is_cap else None)
    if shape is None or stack is None:
        return None
    contact = Layer.on(profiles.over_dome(shape, body.radius), stack)
    why = "theory's body is flat, and its tip has the curvature of this one relative to the body's"
    return Theory("layer theory" if is_cap else "half-space theory", False, why, contact)


def without_range(theory: Theory | None, work: float) -> Jkr | None:
    """A tip that adheres without range (JKR) on a linear body; None where theory does not know the body or the tip."""
    from indent_sim.theory.surface.adhesion import Jkr  # with scipy's searches, which no other scene needs
    from indent_sim.theory.surface.punches import LayerPunches

    contact = theory.contact if theory else None
    return Jkr(LayerPunches(contact), work) if isinstance(contact, Layer) else None


def adhesive_radii(
    theory: Theory | None, tip: Indenter, layers: Sequence[BodyLayer], work: float, deepest: float,
    largest_force: float | None,
) -> tuple[float, float] | tuple[()]:  # fmt: skip
    """Contact radii [length] of a tip that adheres without range: where it comes off, and at the deepest depth, or at
    the largest force [force] where that is prescribed.

    By theory, or that of a half-space of the first layer; empty where neither knows them.
    """
    jkr = without_range(theory, work)
    if jkr is None:
        beside = half_space_theory(tip, [replace(layers[0], thickness=None)], tip.radius_at(max(deepest, 0.0)) or 1.0)
        jkr = without_range(beside, work)
    with contextlib.suppress(ValueError, ArithmeticError):
        if jkr is not None:
            deep = jkr.stable(max(deepest, 0.0)) if largest_force is None else jkr.stable(max(largest_force, 0.0), inf)
            return (jkr.pull_off().a, deep.a) if deep else ()
    return ()


def relative_tip(tip: Indenter, body: Body) -> Indenter:
    """The tip that leaves the same gap over a flat top: of the curvature 1/R relative to the body's, 1/R + 1/radius.

    A sharp tip is its own: beside its apex the body is flat.
    """
    if not isinstance(body, Dome):
        return tip
    match tip:
        case Paraboloid(R=R) | Sphere(R=R):
            return Paraboloid(1 / (1 / R + 1 / body.radius))
        case Plate() | FlatPunch():
            return Paraboloid(body.radius)
    return tip


def half_space_theory(tip: Indenter, layers: Sequence[BodyLayer], size: float = 1.0) -> Theory | None:
    """Theory of a tip on a half-space, homogeneous or below layers; `size`: about a contact radius [length]."""
    shape, stack = shape_of(tip), stack_of(layers, None, size)
    if shape is None or stack is None:
        return None
    why = "the half-space itself" if len(layers) == 1 else "the layers on the half-space itself"
    formulas = _film_formulas(layers, tip)
    found = _theory("half-space theory", True, why, layers, tip, Layer.on(shape, stack), formulas)
    return found if len(layers) == 1 else _isotropic(found, layers)


def stack_of(layers: Sequence[BodyLayer], base: str | None, size: float = 1.0) -> Stack | None:
    """The layers as theory knows them, on a rigid base, or the last one a half-space where base is None.

    None where theory does not know a material (nu < 0). A homogeneous half-space feels E and nu only as E*.
    """
    plies = [_ply(layer) for layer in layers]
    if base is None and len(plies) == 1:
        E_star = plies[0].E / (1 - plies[0].nu ** 2)
        return Stack((Ply(size, E_star, 0.0), Ply(inf, E_star, 0.0)), None)
    if any(ply.nu < 0 for ply in plies):
        return None
    if base is None:
        plies[-1] = plies[-1]._replace(thickness=inf)
    return Stack(tuple(plies), base)


def _theory(
    name: str, exact: bool, why: str, layers: Sequence[BodyLayer], tip: Indenter, contact: LayerContact,
    formulas: Mapping[str, Formula],
) -> Theory:  # fmt: skip
    if not tip.of_revolution:
        exact, why = False, "theory's tip is the cone of equal sections"
    if not all(layer.material and layer.material.small_strain for layer in layers):
        exact, why = False, "theory is that of small strain"
    moduli = [layer.material.constants.E for layer in layers if layer.material]
    error = OWN_ERROR * max(1.0, max(moduli) / min(moduli) / CONTRAST) ** STEEP
    return Theory(name, exact, why, contact, error, formulas)


def _isotropic(found: Theory, layers: Sequence[BodyLayer]) -> Theory:
    """Theory of layers, whose materials are isotropic: of the same indentation modulus where the body's are not."""
    if all(layer.material and layer.material.is_isotropic for layer in layers):
        return found
    return replace(found, exact=False, why="theory's layers are isotropic")


def _layer_formulas(layers: Sequence[BodyLayer], tip: Indenter, base: str) -> dict[str, Formula]:
    """Dimitriadis, for a paraboloid or a sphere on a single layer."""
    if len(layers) > 1 or not isinstance(tip, Paraboloid | Sphere):
        return {}
    ply = _ply(layers[0])
    return {"Dimitriadis": lambda delta: dimitriadis_force(delta, tip.R, ply, base)}


def _film_formulas(layers: Sequence[BodyLayer], tip: Indenter) -> dict[str, Formula]:
    """Gao and Perriot-Barthel, for one film on a half-space.

    They give the modulus of the half-space that stands for both under a contact radius, which a tip has on a
    half-space of any modulus.
    """
    alone = half_space_theory(tip, layers[:1]) if len(layers) == 2 else None
    if alone is None:
        return {}
    film, substrate = map(_ply, layers)

    def force(modulus: Callable[[Ply, Ply, float], float], delta: float) -> float:
        found = alone.at(delta)
        if found is None:
            return nan
        return found.force * modulus(film, substrate, found.a) / half_space.E_star(film.E, film.nu)

    return {"Gao": partial(force, gao_modulus), "Perriot-Barthel": partial(force, perriot_barthel_modulus)}


def _ply(layer: BodyLayer) -> Ply:
    assert layer.material is not None
    return Ply(layer.thickness or inf, *layer.material.constants)


def _wall(body: Body, center: tuple[float, ...]) -> tuple[float | None, bool, str]:
    """Radius of the roller wall, if the body has the one that theory knows, and what is different otherwise."""
    if isinstance(body, Endless):
        return None, True, "the infinitely wide layer itself"
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
    """Name and depth of a tip on a half-space at a force; None for the tips that nobody has a formula for."""
    start = section_depth(tip, force, E_star, 3)
    closed = half_space_force(tip, start, E_star)
    if closed is None:
        return None
    found = _depth_at(lambda depth: half_space_force(tip, depth, E_star)[1], force, start)  # type: ignore[index]
    return (closed[0], found) if found else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Name and force of a tip on a half-space (Hertz, Sneddon); None for the tips that nobody has a formula for."""
    known = TIPS.get(type(tip))
    if known is None or delta <= 0 or isinstance(tip, Plate):
        return None
    is_blunt = getattr(tip, "tip_radius", 0.0) > 0 or getattr(tip, "edge_radius", 0.0) > 0
    if is_blunt or isinstance(tip, Profile):
        force = _blunt_force(tip, delta, E_star)
        return ("Sneddon (quadrature)", force) if force is not None else None
    force = known.force(tip, delta, E_star)
    return (known.half_space, force) if force is not None else None


@lru_cache(maxsize=MOST_KEPT)
def _blunt_force(tip: Indenter, delta: float, E_star: float) -> float | None:
    """Force of a tip of revolution without a closed form, by Sneddon's integral; None past the end of the tip."""
    shape = shape_of(tip) if tip.of_revolution else None
    if shape is None:
        return None
    unit = float(2.0 ** np.ceil(np.log2(tip.radius_at(delta))))  # about the contact radius
    half_space = Layer.on(shape, Stack((Ply(unit, E_star, 0.0), Ply(inf, E_star, 0.0)), None))
    with contextlib.suppress(ValueError, ArithmeticError):
        return half_space.curve([delta])[0].force
    return None


def _depth_at(force_at: Callable[[float], float], force: float, start: float) -> float | None:
    """The depth at which an increasing force_at(depth) is `force` > 0; None when it is not reached."""
    with contextlib.suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
        return increasing_root(force_at, force, start, 1e15 * start)
    return None
