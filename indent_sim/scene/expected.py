"""Expected results: contact radius and force, what slip and adhesion make of them, whether the
pressure has a peak.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import exp, inf, isfinite, log, pi
from typing import Any

import numpy as np

from indent_sim.mesh.modelled_part import Part
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Dome
from indent_sim.model.contact import Friction
from indent_sim.model.materials import Material
from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.scene.given import Durations, Given, Physics, fastest, remaining
from indent_sim.scene.theories import half_space_depth, half_space_force, relaxed, undrained
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.surface import no_slip
from indent_sim.theory.surface.drainage import paraboloid_left
from indent_sim.theory.surface.no_slip import Rubbed

PROFILE_POWERS: dict[type, float] = {
    Paraboloid: 2.0,
    Sphere: 2.0,
    Cone: 1.0,
    FlatPunch: inf,
}  # of the tip's profile
SIDE_WALL_ROOM = (
    2.0  # thicknesses, or contact radii, to the side walls of a layer that feels them little
)
NEGLIGIBLE_PERCENT = 1.0  # per cent that stick changes: less is not worth a sentence
NEARLY = 2.0  # per cent from an elastic limit: up to this a body is said to be one
# contact radii in a height, up to which what is left of a paraboloid's force is that of the table
MOST_LIKE = 0.6
RAMP_POINTS = 1000  # of the integral over a ramp
REACH_ROUNDING = 1e-9  # of a length
# edge elements in the rim that would pull, at most: Newton goes round in a circle from 5 on,
# measured
PULLS = 6.0
NEARLY_STICK = (
    5.0  # the friction that stands for stick then: 0.05 % of the force less, measured at nu = 0
)
# Poisson's ratio from which on the facets of a solid, which cross the edge, do not see it: at 0.1
# they do
SURE = 0.3


def prediction_of(given: Given) -> dict[str, float]:
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and
    by the formulas for the half-space and for films, or of a tip that adheres by JKR, in the
    user's units.
    """
    physics = given.physics
    delta = given.deepest
    tip = given.relative
    scales = physics.scales
    theory = given.theory
    E_star = physics.material.E_star
    largest = None if physics.largest_force is None else physics.seen * physics.largest_force
    asked, unit = (
        ("force", scales.force / physics.seen) if largest is None else ("delta", scales.depth)
    )
    found: dict[str, float | None] = {}
    if (
        given.swelling
    ):  # no elastic body at that depth has the force of a gel that rises against its tip
        return {"a": given.a * scales.length}
    if given.attraction:
        with suppress(*UNSOLVED):
            contact = given.jkr and given.jkr.stable(
                *((delta,) if largest is None else (largest, inf))
            )
            found[f"{asked}_JKR"] = getattr(contact, asked, None)
    else:
        closed = None
        solution = given.solution(delta) if delta > 0 else None
        if not physics.evolves:  # else `InTime` says it
            found[asked] = delta if largest is not None else solution.force if solution else None
        if scales.dim == 3:
            closed = (
                half_space_force(tip, delta, E_star)
                if largest is None
                else half_space_depth(tip, largest, E_star)
            )
        found[f"{asked}_half_space"] = closed[1] if closed else None
        if theory and delta > 0:
            found |= {
                f"{asked}_{name}": theory.formula_at(name, delta, largest)
                for name in theory.formulas
            }
    known = {name: value * unit for name, value in found.items() if value is not None}
    ell = given.elastocapillary_length
    return (
        {"a": given.a * scales.length}
        | ({"elastocapillary_length": ell * scales.length} if ell else {})
        | known
    )


@dataclass(frozen=True)
class Stick:
    """What pure stick instead of no friction would change the deepest force by [per cent]: between
    low and high, and the number itself where it is known; None where only the like at small
    strain is known to tell. source says from what.
    """

    percent: float | None
    low: float | None
    high: float | None
    source: str

    @property
    def is_telling(self) -> bool:
        """Whether it may be worth a sentence."""
        return (
            self.low is None
            or self.high is None
            or max(abs(self.low), abs(self.high)) >= NEGLIGIBLE_PERCENT
        )

    @property
    def remark(self) -> str:
        """The sentence where it may be worth one."""
        return self.words if self.is_telling else ""

    @property
    def words(self) -> str:
        """The same as a sentence."""
        if self.low is None or self.high is None:
            return (
                f"pure stick instead of no friction may change this force noticeably: {self.source}"
            )
        low = f"{self.low:+z.1f}"
        high = f"{self.high:+z.1f}"
        between = f"between {low} and {high}" if low != high else low
        change = f"{between} % ({self.source})"
        if self.percent is not None:
            change = (
                f"{self.percent:+z.1f} % ({f'{between}; ' if low != high else ''}{self.source})"
            )
        return f"pure stick instead of no friction would change this force by {change}"


@dataclass(frozen=True)
class InTime:
    """What is known of a scene that is followed in time before it is, in the user's units.

    way: curve | steps, by which method and why. D [length^2/time]: of the fluid, None without.
    times [time]: what it needs through the contact (a^2/D), the body (H^2/D) and an element
    (h_contact^2/D), the longest `relaxation`, the `way_in` to the largest value, and the whole
    `history`. stages: equilibria of a run that cuts no step. limits: the largest force, or the
    depth of the largest force prescribed, `undrained` and `drained`, and where something relaxes
    `unrelaxed` and `relaxed`; None where theory does not know it. about: the force between them
    that is expected. words: the cheapest elastic model of the scene, if there is one.
    """

    way: str
    method: str
    why: str
    D: float | None
    times: dict[str, float]
    stages: int | None
    limits: dict[str, float | None]
    about: float | None
    words: str

    @property
    def report(self) -> dict[str, Any]:
        """As run.json has it."""
        return {name: value for name, value in vars(self).items() if name != "about"}

    def prediction(self, asked: str) -> dict[str, float]:
        """Its limits as predictions of what is asked for, force or delta."""
        said = {
            f"{asked}_{name}": value for name, value in self.limits.items() if value is not None
        }
        return ({} if self.about is None else {asked: self.about}) | said


def followed(given: Given, physics: Physics, h_contact: float | None, why: str) -> InTime | None:
    """What is known of the scene in time; None where no time passes. h_contact [length] of a mesh;
    why: of its way.
    """
    history = given.history
    if history is None:
        return None
    times = {"way_in": history.way_in, "history": history.span}
    D = None
    if physics.permeable and h_contact is not None:
        D = fastest(physics) * physics.scales.length**2
        fluid = Durations.of(given, physics, h_contact)
        times |= {"contact": fluid.contact, "height": fluid.height, "element": fluid.element}
        times = {name: t for name, t in times.items() if isfinite(t)}
    if relaxations := _relaxations(given, physics):
        times["relaxation"] = max(relaxations)
    passages = [found for find in (_drains, _relaxes) if (found := find(given, physics))]
    limits = {name: value for one in passages for name, value in one.limits(given).items()}
    words = "; ".join(one.words(times) for one in passages)
    about = passages[0].about(given) if len(passages) == 1 else None
    way, stages = ("steps", _stages(physics)) if physics.path.times else ("curve", None)
    return InTime(way, _method(given, physics), why, D, times, stages, limits, about, words)


def _stages(physics: Physics) -> int:
    """Equilibria of a path in time: two of each step in which fluid flows, one of a jump."""
    t = 0.0
    found = 0
    for step in range(1, len(physics.path.values) + 1):
        for _, end in physics.path.leg(step):
            found += 2 if physics.permeable and end > t else 1
            t = end
    return found


def _method(given: Given, physics: Physics) -> str:
    """By what a scene goes from one row of its history to the next."""
    if not physics.path.times:
        return (
            "time steps" if given.is_stepped else "quadrature" if given.relaxation else "equilibria"
        )
    if physics.permeable:
        return "SDIRK2"
    return "exponentials" if physics.relaxing else "equilibria"


def _relaxations(given: Given, physics: Physics) -> list[float]:
    """The times of all terms that relax."""
    laws = [given.relaxation, *(region.material.relaxation for region in physics.relaxing)]
    return [time for law in laws if law for _, time in law.prony or ()]


@dataclass(frozen=True)
class _Passage:
    """What a body passes from one elastic limit to another: their names with the law of each, its
    slowest time by name, what is left of the difference at the end of the way in, and at the end
    of the history; None where nobody knows.
    """

    first: tuple[str, Callable[[Material], Material]]
    last: tuple[str, Callable[[Material], Material]]
    slowest: tuple[str, str]
    left: float | None
    left_at_end: float | None
    ratio: float  # of the first force to the last one, at a depth

    def limits(self, given: Given) -> dict[str, float | None]:
        """The force at the deepest point, or the depth of the largest force [user's units], of
        both.
        """
        return {name: _limit(given, law) for name, law in (self.first, self.last)}

    def about(self, given: Given) -> float | None:
        """The force to expect at the end of the way in [user's units]."""
        first, last = self.limits(given).values()
        if None in (first, last, self.left) or given.physics.path.control == "force":
            return None
        return last + self.left * (first - last)  # type: ignore[operator]

    def words(self, times: Mapping[str, float]) -> str:
        """The cheapest elastic model, at the end of the way in and of the history."""
        (name, said) = self.slowest
        t = times["way_in"]
        share = f", {t / times[name]:.2g} of {said}" if times.get(name) else ""
        found = f"the way in takes {t:.3g}{share}: {self._model(self.left)}"
        if self.left_at_end is not None and self.left_at_end != self.left:
            found += f"; at the end of the history {self._model(self.left_at_end)}"
        return found

    def _model(self, left: float | None) -> str:
        if left is None:
            return "`require` solves which elastic body that is near"
        below = 100 * (1 - 1 / self.ratio) * (1 - left)
        above = 100 * (self.ratio - 1) * left
        if min(below, above) > NEARLY:
            beside = (
                f"{_percent(below)} below the {self.first[0]} force, {_percent(above)} above the "
                f"{self.last[0]}"
            )
            return f"neither, about {beside}"
        name, percent = (self.first[0], below) if below < above else (self.last[0], above)
        return f"{name}, within about {percent:.1g} %"


def _percent(change: float) -> str:
    return f"{change:.2g} %" if change < 99.5 else f"{change:.0f} %"


def _drains(given: Given, physics: Physics) -> _Passage | None:
    """From undrained to drained, by what is left under a paraboloid on a layer (`paraboloid_left`)."""
    if not physics.permeable or given.swelling:
        return None
    assert given.history is not None
    own = physics.material
    tip = physics.drainage.tip
    power = power_of(physics.indenter)
    has_one = len(physics.part.regions) == 1 and physics.scales.dim == 3
    is_like = power in (1.0, 2.0) and has_one and given.a <= MOST_LIKE * physics.body.height
    left = at_end = None
    if is_like and physics.drainage.surface == "drained" and (tip == "sealed" or tip == "drained"):
        through = fastest(physics) / given.a**2
        left = paraboloid_left(through * given.history.way_in, tip, "ramp")
        at_end = min(left, paraboloid_left(through * given.history.rest_after, tip, "step"))
    stiff = undrained(own)
    laws = ("undrained", undrained), ("drained", lambda material: replace(material, flow=None))
    return _Passage(*laws, ("contact", "a^2/D"), left, at_end, stiff.E_star / own.E_star)


def _relaxes(given: Given, physics: Physics) -> _Passage | None:
    """From unrelaxed to relaxed, by what is left under a tip whose force grows as depth^1.5 in an
    incompressible half-space.
    """
    law = given.relaxation or next(
        (region.material.relaxation for region in physics.relaxing), None
    )
    if law is None or given.history is None:
        return None
    history = given.history
    rest = remaining(law, given.history)
    terms = law.prony or ()
    left = at_end = None
    if total := sum(fraction for fraction, _ in terms):
        shares = [fraction / total * _ramped(history.way_in / time) for fraction, time in terms]
        left = sum(shares)
        at_end = sum(
            one * exp(-history.rest_after / time)
            for one, (_, time) in zip(shares, terms, strict=True)
        )
    own = physics.material
    soft = partial(relaxed, left=rest)
    ratio = 1 / rest if given.relaxation else own.E_star / soft(own).E_star
    laws = ("unrelaxed", lambda material: material), ("relaxed", soft)
    return _Passage(*laws, ("relaxation", "the longest relaxation"), left, at_end, ratio)


def _ramped(x: float) -> float:
    """int_0^1 exp(-x (1 - s)) d(s^1.5): what a term leaves of the force at the end of a ramp of x
    times its time.
    """
    s = (np.arange(RAMP_POINTS) + 0.5) / RAMP_POINTS
    return float(np.exp(-x * (1 - s)) @ np.diff(np.linspace(0, 1, RAMP_POINTS + 1) ** 1.5))


def _limit(given: Given, change: Callable[[Material], Material]) -> float | None:
    """The force at the deepest point, or the depth of the largest force, of a body whose laws are
    changed so.
    """
    assert given.history is not None
    theory = given.theory_with(change)
    scales = given.physics.scales
    if theory is None or given.history.largest <= 0:
        return None
    if given.history.control == "force":
        depth = theory.depth(given.history.largest, given.physics.body.height)
        return None if depth is None else depth * scales.depth
    solution = theory.at(given.deepest)
    return solution.force * scales.force if solution else None


def stick(given: Given, physics: Physics, linear: str = "direct") -> Stick | None:
    """What no slip would change at the deepest contact: exactly on a half-space, a range of the map
    of bonded layers elsewhere; None where neither knows the scene, or where nothing slips
    without friction as it is.

    At finite strain, or with the gap at the deformed point, there is no number, and only a sentence
    where the like of it at small strain tells. physics, linear: the scene's own, and how error bars
    would solve its linear systems.
    """
    found = None if physics.takes_path or given.deepest <= 0 else _at_small_strain(given)
    if found is None or physics.is_linear:
        return found
    is_solvable = not physics.part.pins and linear != "iterative"
    source = (
        "it could at small strain, and here the change may be "
        f"larger{'; --error-bars solves it' * is_solvable}"
    )
    return Stick(None, None, None, source) if found.is_telling else None


def _at_small_strain(given: Given) -> Stick | None:
    physics = given.physics
    a = given.a
    part = physics.part
    tip = physics.indenter
    power = power_of(physics.indenter)
    if (
        power is None
        or physics.surface_tension
        or not _is_plain(part)
        or part.kinematics.name == "plane_strain"
        or a <= 0
    ):
        return None
    nu = physics.material.constants.nu
    rim = physics.body.rim_distance(physics.center)
    if given.is_half_space:
        percent = 100 * (no_slip.force_ratio(nu, power) - 1)
        return Stick(
            percent,
            percent,
            percent,
            f"half-space, exact{' for the paraboloid' * isinstance(tip, Sphere)}",
        )
    if part.supports.get("base") != "fixed" or rim < SIDE_WALL_ROOM * max(part.height, a):
        return None
    found = no_slip.layer_range(nu, a / part.height, power)
    if found is None:
        return None
    low, high = (100 * (ratio - 1) for ratio in found)
    return Stick(None, low, high, "map of bonded layers at small strain")


def _is_plain(part: Part) -> bool:
    return len(part.regions) == 1 and part.regions[0].material.is_isotropic


@dataclass(frozen=True)
class ExpectedAdhesion:
    """What is known of a tip that adheres before it does: the cohesive zone beside its contact
    [length], the elements in it, a round tip's Tabor number and Maugis' lambda, and the largest
    pull [force], None where nobody knows it: without range (JKR) on a linear body like this one,
    and by Maugis-Dugdale on a half-space, if that is alike.
    """

    cohesive_zone: float
    elements: float
    tabor: float | None = None
    maugis_lambda: float | None = None
    jkr_pull_off: float | None = None
    maugis_pull_off: float | None = None

    @property
    def words(self) -> str:
        """The same as the reason of a choice."""
        numbers = ((symbol.meaning, getattr(self, symbol.name)) for symbol in ADHESION_SYMBOLS)
        return "; ".join(f"{words} {number:.4g}" for words, number in numbers if number is not None)


def power_of(tip: Indenter) -> float | None:
    """n of a profile f = B r^n, infinite for a punch; None for a tip that has another, or a rounded
    apex or edge.
    """
    is_sharp = not any(getattr(tip, name, 0.0) > 0 for name in ("tip_radius", "edge_radius"))
    return PROFILE_POWERS.get(type(tip)) if is_sharp else None


def rubbed(given: Given, physics: Physics, friction: Friction) -> Rubbed | None:
    """What friction makes of the deepest contact of a half-space; None where that is not known: for
    other tips, other matter, a path that turns back on its way there, or more friction than the
    theory bears.
    """
    values = physics.path.values
    power = power_of(given.physics.indenter)
    if not (
        given.is_half_space and physics.is_linear and given.deepest > 0 and physics.has_friction
    ):
        return None
    turns_back = any(
        later < earlier for earlier, later in pairwise(values[: values.index(max(values)) + 1])
    )
    if power is None or not _is_plain(physics.part) or turns_back:
        return None
    from indent_sim.theory.surface import (
        coulomb as coulomb_friction,
    )  # with scipy's functions, which no other scene needs

    with suppress(ValueError):
        return coulomb_friction.rubbed(physics.material.constants.nu, friction, power)
    return None


def rubbed_words(physics: Physics, found: Rubbed) -> str:
    """The same as a sentence."""
    what = "no slip"
    where = ""
    if found.sticks < 1.0:
        what = f"friction {physics.contact.friction:g}"
        where = f", and the surface sticks within {found.sticks:.2g} of its radius"
    return (
        f"{what} changes this force by {100 * (found.force - 1):+.1f} %{where} (half-space, exact)"
    )


def pulling_rim(tip: Indenter, nu: float, sizes: Sizes, dim: int) -> float:
    """Width d = 2 a exp(-pi^2/ln(3 - 4 nu)) of the rim under a sharp edge in which a stuck surface
    would pull [length].

    2e-4 a at nu = 0, 1e-7 a at 0.3; 0 where the elements do not see it. Those that do have no
    equilibrium that both sticks without a bound and pushes. dim: of the mesh.
    """
    if (
        getattr(tip, "edge_radius", 1.0) > 0
        or sizes.edge is None
        or sizes.h_edge is None
        or nu >= 0.5
    ):
        return 0.0
    rim = 2 * sizes.edge * exp(-(pi**2) / log(3 - 4 * nu))
    return rim if sizes.h_edge <= PULLS * rim or (dim == 3 and nu < SURE) else 0.0


def infinite_pressure(tip: Indenter, a: float) -> str:
    """Why the pressure of a contact of radius a [length] has no largest value; empty where it has
    one.
    """
    where = next((r for r, width in tip.creases() if width == 0 and r <= a), None)
    return (
        ""
        if where is None
        else f"the pressure at the tip's sharp {'edge' if where else 'apex'} is infinite"
    )


def peakless(physics: Physics, sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one
    does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements
    shrink, as it does while they are larger than the arc that rounds one.
    """
    body = physics.body
    tip = physics.indenter
    for r, width in tip.creases() if a > 0 else []:
        size = float(sizes.at(np.array(r), np.array(0.0)))
        is_touched = r <= a + size or (tip.height(r, 0.0) <= 0 and not isinstance(body, Dome))
        if is_touched and width < size and r < body.reach(physics.center) * (1 - REACH_ROUNDING):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return (
                f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
            )
    return ""
