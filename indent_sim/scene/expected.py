"""Expected results: contact radius and force, what slip and adhesion make of them, whether the pressure has a peak."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, log, pi

import numpy as np

from indent_sim.mesh.modelled_part import Part
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Dome
from indent_sim.model.contact import Friction
from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.scene.given import Given, Physics
from indent_sim.scene.theories import half_space_depth, half_space_force
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.surface import no_slip
from indent_sim.theory.surface.no_slip import Rubbed

PROFILE_POWERS: dict[type, float] = {Paraboloid: 2.0, Sphere: 2.0, Cone: 1.0, FlatPunch: inf}  # of the tip's profile
SIDE_WALL_ROOM = 2.0  # thicknesses, or contact radii, to the side walls of a layer that feels them little
NEGLIGIBLE_PERCENT = 1.0  # per cent that stick changes: less is not worth a sentence
REACH_ROUNDING = 1e-9  # of a length
PULLS = 6.0  # edge elements in the rim that would pull, at most: Newton goes round in a circle from 5 on, measured
NEARLY_STICK = 5.0  # the friction that stands for stick then: 0.05 % of the force less, measured at nu = 0
SURE = 0.3  # Poisson's ratio from which on the facets of a solid, which cross the edge, do not see it: at 0.1 they do


def prediction_of(given: Given) -> dict[str, float]:
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and by the formulas for
    the half-space and for films, or of a tip that adheres by JKR, in the user's units."""
    physics, delta, tip = given.physics, given.deepest, given.relative
    scales, theory, largest, E_star = physics.scales, given.theory, physics.largest_force, physics.material.E_star
    asked, unit = ("force", scales.force) if largest is None else ("delta", scales.depth)
    found: dict[str, float | None] = {}
    if given.swelling:  # no elastic body at that depth has the force of a gel that rises against its tip
        return {"a": given.a * scales.length}
    if given.attraction:
        with suppress(*UNSOLVED):
            contact = given.jkr and given.jkr.stable(*((delta,) if largest is None else (largest, inf)))
            found[f"{asked}_JKR"] = getattr(contact, asked, None)
    else:
        closed, solution = None, given.solution(delta) if delta > 0 else None
        found[asked] = delta if largest is not None else solution.force if solution else None
        if scales.dim == 3:
            closed = half_space_force(tip, delta, E_star) if largest is None else half_space_depth(tip, largest, E_star)
        found[f"{asked}_half_space"] = closed[1] if closed else None
        if theory and delta > 0:
            found |= {f"{asked}_{name}": theory.formula_at(name, delta, largest) for name in theory.formulas}
    known = {name: value * unit for name, value in found.items() if value is not None}
    return {"a": given.a * scales.length} | known


@dataclass(frozen=True)
class Stick:
    """What pure stick instead of no friction would change the deepest force by [per cent]: between low and high, and
    the number itself where it is known; None where only the like at small strain is known to tell. source says from
    what."""

    percent: float | None
    low: float | None
    high: float | None
    source: str

    @property
    def is_telling(self) -> bool:
        """Whether it may be worth a sentence."""
        return self.low is None or self.high is None or max(abs(self.low), abs(self.high)) >= NEGLIGIBLE_PERCENT

    @property
    def words(self) -> str:
        """The same as a sentence."""
        if self.low is None or self.high is None:
            return f"pure stick instead of no friction may change this force noticeably: {self.source}"
        low, high = f"{self.low:+z.1f}", f"{self.high:+z.1f}"
        between = f"between {low} and {high}" if low != high else low
        change = f"{between} % ({self.source})"
        if self.percent is not None:
            change = f"{self.percent:+z.1f} % ({f'{between}; ' if low != high else ''}{self.source})"
        return f"pure stick instead of no friction would change this force by {change}"


def stick(given: Given, physics: Physics, linear: str = "direct") -> Stick | None:
    """What no slip would change at the deepest contact: exactly on a half-space, a range of the map of bonded layers
    elsewhere; None where neither knows the scene, or where nothing slips without friction as it is.

    At finite strain, or with the gap at the deformed point, there is no number, and only a sentence where the like of
    it at small strain tells. physics, linear: the scene's own, and how error bars would solve its linear systems.
    """
    takes_path = physics.contact.has_memory or physics.evolves
    found = None if takes_path or given.deepest <= 0 else _at_small_strain(given)
    if found is None or physics.is_linear:
        return found
    is_solvable = not physics.part.pins and linear != "iterative"
    source = f"it could at small strain, and here the change may be larger{'; --error-bars solves it' * is_solvable}"
    return Stick(None, None, None, source) if found.is_telling else None


def _at_small_strain(given: Given) -> Stick | None:
    physics, a = given.physics, given.a
    part, tip, power = physics.part, physics.indenter, power_of(physics.indenter)
    if power is None or not _is_plain(part) or part.kinematics.name == "plane_strain" or a <= 0:
        return None
    nu, rim = physics.material.constants.nu, physics.body.rim_distance(physics.center)
    if given.is_half_space:
        percent = 100 * (no_slip.force_ratio(nu, power) - 1)
        return Stick(percent, percent, percent, f"half-space, exact{' for the paraboloid' * isinstance(tip, Sphere)}")
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
    """What is known of a tip that adheres before it does: the cohesive zone beside its contact [length], the elements
    in it, a round tip's Tabor number and Maugis' lambda, and the largest pull [force], None where nobody knows it:
    without range (JKR) on a linear body like this one, and by Maugis-Dugdale on a half-space, if that is alike."""

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
    """n of a profile f = B r^n, infinite for a punch; None for a tip that has another, or a rounded apex or edge."""
    is_sharp = not any(getattr(tip, name, 0.0) > 0 for name in ("tip_radius", "edge_radius"))
    return PROFILE_POWERS.get(type(tip)) if is_sharp else None


def rubbed(given: Given, physics: Physics, friction: Friction) -> Rubbed | None:
    """What friction makes of the deepest contact of a half-space; None where that is not known: for other tips, other
    matter, a path that turns back on its way there, or more friction than the theory bears."""
    values, power = physics.path.values, power_of(given.physics.indenter)
    if not (given.is_half_space and physics.is_linear and given.deepest > 0 and physics.has_friction):
        return None
    turns_back = any(later < earlier for earlier, later in pairwise(values[: values.index(max(values)) + 1]))
    if power is None or not _is_plain(physics.part) or turns_back:
        return None
    from indent_sim.theory.surface import coulomb  # with scipy's functions, which no other scene needs

    with suppress(ValueError):
        return coulomb.rubbed(physics.material.constants.nu, friction, power)
    return None


def rubbed_words(friction: Friction, found: Rubbed) -> str:
    """The same as a sentence."""
    what, where = "no slip", ""
    if found.sticks < 1.0:
        what, where = f"friction {friction:g}", f", and the surface sticks within {found.sticks:.2g} of its radius"
    return f"{what} changes this force by {100 * (found.force - 1):+.1f} %{where} (half-space, exact)"


def pulling_rim(tip: Indenter, nu: float, sizes: Sizes, dim: int) -> float:
    """Width d = 2 a exp(-pi^2/ln(3 - 4 nu)) of the rim under a sharp edge in which a stuck surface would pull [length].

    2e-4 a at nu = 0, 1e-7 a at 0.3; 0 where the elements do not see it. Those that do have no equilibrium that both
    sticks without a bound and pushes. dim: of the mesh.
    """
    if getattr(tip, "edge_radius", 1.0) > 0 or sizes.edge is None or sizes.h_edge is None or nu >= 0.5:
        return 0.0
    rim = 2 * sizes.edge * exp(-(pi**2) / log(3 - 4 * nu))
    return rim if sizes.h_edge <= PULLS * rim or (dim == 3 and nu < SURE) else 0.0


def infinite_pressure(tip: Indenter, a: float) -> str:
    """Why the pressure of a contact of radius a [length] has no largest value; empty where it has one."""
    where = next((r for r, width in tip.creases() if width == 0 and r <= a), None)
    return "" if where is None else f"the pressure at the tip's sharp {'edge' if where else 'apex'} is infinite"


def peakless(physics: Physics, sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements shrink, as it does
    while they are larger than the arc that rounds one.
    """
    body, tip = physics.body, physics.indenter
    for r, width in tip.creases() if a > 0 else []:
        size = float(sizes.at(np.array(r), np.array(0.0)))
        is_touched = r <= a + size or (tip.height(r, 0.0) <= 0 and not isinstance(body, Dome))
        if is_touched and width < size and r < body.reach(physics.center) * (1 - REACH_ROUNDING):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
    return ""
