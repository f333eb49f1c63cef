"""Expected results: depths at given forces, contact radius and force, and whether the pressure has a peak."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, log, pi

import numpy as np

from indent_sim.mesh.part import Part
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Body, Dome
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.symbols import ADHERENCE
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.scene.theories import Theory, half_space_depth, half_space_force, section_depth
from indent_sim.theory.surface import no_slip
from indent_sim.theory.surface.no_slip import Rubbed

DEEPEST = 0.9  # of the thickness: there no force is expected to find its depth
MOST_FORCES = 3  # at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
POWERS: dict[type, float] = {Paraboloid: 2.0, Sphere: 2.0, Cone: 1.0, FlatPunch: inf}  # of the tip's profile
ROOM = 2.0  # thicknesses, or contact radii, to the side walls of a layer that feels them little
TELLING = 1.0  # per cent that stick changes: less is not worth a sentence
SAME_PLACE = 1e-9  # of a length


def depths_of(path: LoadPath, theory: Theory | None, tip: Indenter, material: Material, height: float, scales: Scales
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


def _depths_at(forces: Sequence[float], theory: Theory | None, tip: Indenter, E_star: float, dim: int, deepest: float
               ) -> tuple[float, ...]:  # fmt: skip
    """From theory, or from the tip's section where there is none or it ends; between MOST_FORCES by power laws."""
    pushed = np.unique([force for force in forces if force > 0])
    some = pushed if len(pushed) <= MOST_FORCES else np.geomspace(pushed[0], pushed[-1], MOST_FORCES)
    depths = []
    for force in map(float, some):
        start = section_depth(tip, force, E_star, dim)
        found = theory.depth(force, deepest) if theory else None
        depths.append(float(f"{found or min(start, deepest / 2):.9g}"))  # the same in all units, and so is the mesh
    return tuple(
        float(np.exp(np.interp(np.log(force), np.log(some), np.log(depths)))) if force > 0 else 0.0 for force in forces
    )


def prediction_of(path: LoadPath, theory: Theory | None, tip: Indenter, material: Material, delta: float, a: float,
                  scales: Scales) -> dict[str, float]:  # fmt: skip
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and by the formulas for
    the half-space and for films, in the user's units."""
    asked, unit = ("delta", scales.depth) if path.control == "force" else ("force", scales.force)
    found: dict[str, float | None] = {}
    if path.control == "force":
        largest: float | None = max(path.values)
        found[asked] = delta
        closed = half_space_depth(tip, max(path.values), material.E_star) if scales.dim == 3 else None
    else:
        largest, solution = None, theory.at(delta) if theory and delta > 0 else None
        found[asked] = solution.force if solution else None
        closed = half_space_force(tip, delta, material.E_star) if scales.dim == 3 else None
    found[f"{asked}_half_space"] = closed[1] if closed else None
    for name in theory.formulas if theory and delta > 0 else ():
        found[f"{asked}_{name}"] = theory.formula_at(name, delta, largest)  # type: ignore[union-attr]
    return {"a": a * scales.length} | {name: value * unit for name, value in found.items() if value is not None}


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
        return self.low is None or self.high is None or max(abs(self.low), abs(self.high)) >= TELLING

    @property
    def words(self) -> str:
        """The same as a sentence."""
        if self.low is None or self.high is None:
            return f"pure stick instead of no friction may change this force noticeably: {self.source}"
        low, high = f"{self.low:+z.1f}", f"{self.high:+z.1f}"
        between = f"between {low} and {high}" if low != high else low
        if self.percent is None:
            change = f"{between} % ({self.source})"
        elif low == high:
            change = f"{self.percent:+z.1f} % ({self.source})"
        else:
            change = f"{self.percent:+z.1f} % ({between}; {self.source})"
        return f"pure stick instead of no friction would change this force by {change}"


def stick(part: Part, tip: Indenter, a: float, rim: float, *, is_half_space: bool, is_linear: bool,
          is_solvable: bool = True) -> Stick | None:  # fmt: skip
    """What no slip would change at a contact of radius a, `rim` away from the side walls [length]: exactly on a
    half-space, a range of the map of bonded layers elsewhere; None where neither knows the scene.

    is_linear: at small strain, the gap at the undeformed point; any other scene has no number, and only a sentence
    where the like of it at small strain tells. is_solvable: whether error bars would solve it.
    """
    found = _at_small_strain(part, tip, a, rim, is_half_space)
    if is_linear or found is None:
        return found
    source = BEYOND + (SOLVED if is_solvable else "")
    return Stick(None, None, None, source) if found.is_telling else None


BEYOND = "it could at small strain, and here the change may be larger"
SOLVED = "; --error-bars solves it"


def _at_small_strain(part: Part, tip: Indenter, a: float, rim: float, is_half_space: bool) -> Stick | None:
    """What no slip would change at small strain, the gap at the undeformed point."""
    power = power_of(tip)
    if power is None or not _is_plain(part) or part.kinematics.name == "plane_strain" or a <= 0:
        return None
    nu = part.regions[0].material.constants.nu
    if is_half_space:
        percent = 100 * (no_slip.force_ratio(nu, power) - 1)
        return Stick(percent, percent, percent, _exact(tip))
    if part.supports.get("base") != "fixed" or rim < ROOM * max(part.height, a):
        return None
    found = no_slip.layer_range(nu, a / part.height, power)
    if found is None:
        return None
    low, high = (100 * (ratio - 1) for ratio in found)
    return Stick(None, low, high, "map of bonded layers at small strain")


def _is_plain(part: Part) -> bool:
    """Whether a body is of one isotropic material."""
    return len(part.regions) == 1 and part.regions[0].material.is_isotropic


def _exact(tip: Indenter) -> str:
    return "half-space, exact for the paraboloid" if isinstance(tip, Sphere) else "half-space, exact"


@dataclass(frozen=True)
class Adherence:
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
        numbers = ((symbol.meaning, getattr(self, symbol.name)) for symbol in ADHERENCE)
        return "; ".join(f"{words} {number:.4g}" for words, number in numbers if number is not None)


def power_of(tip: Indenter) -> float | None:
    """n of a profile f = B r^n, infinite for a punch; None for a tip that has another, or a rounded apex or edge."""
    is_sharp = not any(getattr(tip, name, 0.0) > 0 for name in ("tip_radius", "edge_radius"))
    return POWERS.get(type(tip)) if is_sharp else None


def rubbed(part: Part, tip: Indenter, friction: float | str, path: LoadPath) -> Rubbed | None:
    """What friction makes of the deepest contact of a half-space; None where that is not known: for other tips, other
    matter, a path that turns back on its way there, or more friction than the theory bears."""
    power, nu = power_of(tip), part.regions[0].material.constants.nu
    way_in = path.values[: path.values.index(max(path.values)) + 1]
    turns_back = any(later < earlier for earlier, later in pairwise(way_in))
    if power is None or not _is_plain(part) or turns_back:
        return None
    from indent_sim.theory.surface import coulomb  # with scipy's functions, which no other scene needs

    try:
        return coulomb.rubbed(nu, friction, power)  # type: ignore[arg-type]
    except ValueError:
        return None


def rubbed_words(friction: float | str, found: Rubbed) -> str:
    """The same as a sentence."""
    slips = found.sticks < 1.0
    what = f"friction {friction:g}" if slips else "no slip"
    where = f", and the surface sticks within {found.sticks:.2g} of its radius" if slips else ""
    return f"{what} changes this force by {100 * (found.force - 1):+.1f} %{where} (half-space, exact)"


PULLS = 6.0  # edge elements in the rim that would pull, at most: Newton goes round in a circle from 5 on, measured
NEARLY_STICK = 5.0  # the friction that stands for stick then: 0.05 % of the force less, measured at nu = 0
SURE = 0.3  # Poisson's ratio from which on the facets of a solid, which cross the edge, do not see it: at 0.1 they do


def pulling_rim(tip: Indenter, nu: float, sizes: Sizes, dim: int) -> float:
    """Width d = 2 a exp(-pi^2/ln(3 - 4 nu)) of the rim under a sharp edge in which a stuck surface would pull [length].

    2e-4 a at nu = 0, 1e-7 a at 0.3; 0 where the elements do not see it. Those that do have no equilibrium that both
    sticks without a bound and pushes. dim: of the mesh.
    """
    is_sharp = getattr(tip, "edge_radius", 1.0) == 0
    if not is_sharp or sizes.edge is None or sizes.h_edge is None or nu >= 0.5:
        return 0.0
    rim = 2 * sizes.edge * exp(-(pi**2) / log(3 - 4 * nu))
    return rim if sizes.h_edge <= PULLS * rim or (dim == 3 and nu < SURE) else 0.0


def infinite_pressure(tip: Indenter, a: float) -> str:
    """Why the pressure of a contact of radius a [length] has no largest value; empty where it has one."""
    where = next((r for r, width in tip.creases() if width == 0 and r <= a), None)
    return "" if where is None else f"the pressure at the tip's sharp {'edge' if where else 'apex'} is infinite"


def peakless(body: Body, tip: Indenter, center: tuple[float, ...], sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements shrink, as it does
    while they are larger than the arc that rounds one.
    """
    for r, width in tip.creases() if a > 0 else []:
        size = float(sizes.at(np.array(r), np.array(0.0)))
        is_touched = r <= a + size or (tip.height(r, 0.0) <= 0 and not isinstance(body, Dome))
        if is_touched and width < size and r < body.reach(center) * (1 - SAME_PLACE):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
    return ""
