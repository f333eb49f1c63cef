"""Half-widths of the error bars of a run's rows, from one companion on a coarser mesh.

Elements of the size h give a number f, elements of q h the number f_q. Where the error falls as h^p, Richardson's
extrapolation says that f is off by |f_q - f|/(q^p - 1), and Roache's grid convergence index takes SAFETY = 3 of it
where two meshes alone are known, since nothing then tests whether the error falls so. Two meshes may agree by accident
(which elements touch changes from step to step, and the difference passes through zero): so no bar is narrower than a
floor, a share of the error that so many elements in a contact radius have cost in general.

    force    max(SAFETY |F_q - F|/(q^RATE - 1), FLOOR CONSTANT n^-RATE F', edge F') + corners F',
             F' = |F| + SAFETY F_a
    a        RADIUS times the element in which the contact ends
    p_max    max(SAFETY |p_q - p|/(q^PRESSURE_RATE - 1), PEAK n^-PRESSURE_RATE p)

with n elements in the contact radius of the row (for p_max beneath a punch's rounded edge in its
part on the arc), and the adhesive force F_a (see `ErrorBars._jkr_adhesive_force`). The rule has
eight numbers: the ratio q of the meshes, SAFETY, RATE, FLOOR, RADIUS, PRESSURE_RATE, PEAK, and that
of an edge, of a sharp punch in three dimensions or of a contact that ends where the tip's slope
jumps (`doubts.EDGE`). CONSTANT is that by which `accuracy` chooses its meshes. To this come the
parts that no mesh shows, each measured by a run of its own or known beforehand: see `Budget`. No
bar of a force is narrower than its distance from a theory that is exact for the body.
`scripts/make_error_bar_table` measures coverage and width with and without each number of the rule.

Roache, J. Fluids Eng. 116, 405 (1994); Annu. Rev. Fluid Mech. 29, 123 (1997), whose safety factors are 3 for two grids
and 1.25 for three; Verification and Validation in Computational Science and Engineering (Hermosa, 1998).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import acosh, inf, nan, pi, sqrt
from typing import Any

import numpy as np

from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.model.tips import flat_radius
from indent_sim.run.companions.companion import Companion, Curve, States, curve_of, in_half_steps
from indent_sim.run.companions.drained_film import DrainedFilm
from indent_sim.scene.doubts import EDGE, PER_DEPTH, edge_error
from indent_sim.scene.fineness import CONSTANT, RATE, fading
from indent_sim.scene.scene import Scene

# ---- the numbers of the rule: docs/accuracy.md has coverage and width with and without each ------------------------

SAFETY = 3.0  # Roache's, where two meshes alone are known
FLOOR = 0.2  # of CONSTANT n^-RATE, from which `accuracy` chooses n elements in a contact radius (see `fineness`)
RADIUS = 0.09  # of the element where the contact ends, to which the radius is read off
PRESSURE_RATE, PEAK = 2.0, 0.2  # of the largest pressure: quadratic elements have stresses of order 2

BESIDE = ("a", "p_max", "stick_radius", "dissipation")  # numbers beside the force that have bars


@dataclass(frozen=True)
class Budget:
    """What makes up the half-width of the error bar of a row's force [force].

    discretisation: the mesh. enforcement: the penalty's stiffness. truncation: the finite body that stands for a
    half-space, or flat facets for a curved surface. theory: the distance from a theory that is exact for this body.
    path: with friction the steps of the path. time: of a body that evolves the steps in time. film: of a body that
    drains, the films beside its drained faces. bath: of a gel, the time that a sudden bath takes to come.
    """

    step: int
    discretisation: float = 0.0
    enforcement: float = 0.0
    truncation: float = 0.0
    theory: float = 0.0
    path: float = 0.0
    time: float = 0.0
    film: float = 0.0
    bath: float = 0.0

    @property
    def parts(self) -> dict[str, float]:
        """Everything that is estimated, which adds up."""
        return {name: part for name, part in asdict(self).items() if name not in ("step", "theory")}

    @property
    def estimated(self) -> float:
        """The sum of the parts [force]."""
        return sum(self.parts.values())

    @property
    def total(self) -> float:
        """The half-width [force]: the sum of the parts, but never less than what exact theory knows to be wrong."""
        return self.theory if self.theory > self.estimated else self.estimated


def grid_convergence(difference: float, ratio: float, rate: float) -> float:
    """The error of a number by Roache's grid convergence index: SAFETY difference/|ratio^rate - 1|.

    Parameters
    ----------
    difference
        How far the number is from that with sizes (or steps) `ratio` times as large [any unit].
    ratio
        Below 1 where the companion is finer.
    rate
        Of the error, which falls as h^rate.
    """
    return SAFETY * difference / abs(ratio**rate - 1)


def ridge_pressure(turn: float, refinements: int) -> float:
    """Return the largest excess pressure over E* at the ridges of a faceted mesh that stands for a
    curved surface.

    Two facets that meet at the angle theta are a cone of the slope theta/2 to a tip that is flat there, whose pressure
    grows as E* theta/4 arccosh(l/r) towards the ridge (Sneddon 1965, Int. J. Eng. Sci. 3, 47; Johnson, Contact
    Mechanics, 5.2). l is the length of a facet, and no pressure is read off nearer than a quarter of an element, so
    that this is the most. On meshes of caps under balls and plates, refined one to three times, p_max was 0.57 to 0.67,
    0.67 to 0.72 and 0.83 to 0.87 of E* theta too large, where this says 0.69, 0.87 and 1.04.

    Parameters
    ----------
    turn
        The angle theta [radians]; 0 where nothing is faceted.
    refinements
        How often each facet has been halved.
    """
    return turn / 4 * acosh(4.0 * 2.0**refinements)


@dataclass(frozen=True)
class Ways:
    """The path of a scene with friction, or of a body that evolves, in its own steps and in steps half as long."""

    own: Curve
    finer: Curve

    def error(self, state: State, name: str) -> float:
        """The error of a number of a step: SAFETY times what steps half as long change; NaN without such a step.

        Twice that change is Richardson's error of first order, 2.6 times that of order 0.7, with which a path converges
        whose new contact sticks where its step began.
        """
        return SAFETY * _difference(self.own, self.finer, state.step, name)


def ways(run: Companion, follow: Callable[[Scene], States]) -> Ways | None:
    """What the steps of a path may cost, by a run and steps half as long; None where it does not matter."""
    finer = in_half_steps(run.scene) if run.scene else None
    if run.scene is None or finer is None:
        return None
    halves = follow(finer)
    kept = [
        replace(last, step=last.step // 2, dissipation=(first.dissipation or 0.0) + (last.dissipation or 0.0))
        for first, last in zip(halves[::2], halves[1::2], strict=False)
    ]
    return Ways(run.curve, curve_of(kept))


class ErrorBars:
    """Judges one row after another against the companion's curve.

    Where forces are prescribed and depths found, the error of the force is that at the row's depth, and the error of
    the depth what the curve makes of it.

    Parameters
    ----------
    scene
        The scene of the run.
    companion
        The same scene on another mesh.
    soft
        The companion with half the penalty's stiffness, where there is a penalty.
    ways
        The companion's path in its own steps and in steps half as long, where they matter.
    film
        What the films beside drained faces cost on the run's own mesh, of a body that drains.
    bath
        The companion in a bath that takes twice as long to come, of a body whose bath comes.
    """

    def __init__(
        self,
        scene: Scene,
        companion: Companion,
        soft: States | None = None,
        ways: Ways | None = None,
        film: DrainedFilm | None = None,
        bath: States | None = None,
    ):
        self.budgets: list[Budget] = []
        self.companion = companion
        self._ways = ways
        self._film = film
        self._bath = None if bath is None else curve_of(bath)
        self._coarse = companion.curve
        self._soft = None if soft is None else curve_of(soft)
        self._run: Curve = {}
        self._scene = scene
        self._physics = scene.physics
        self._sizes = scene.sizes
        self._scales = scene.physics.scales
        self._finds_depths = scene.physics.path.control == "force"
        self._truncation = sum(doubt.force_error for doubt in scene.plan.doubts if doubt.key == "truncation")
        part = scene.physics.part
        near = scene.physics.center, scene.sizes.a, scene.sizes.refinements or 0
        self._sag = part.sag(*near)
        sharpened = ridge_pressure(part.turn(*near), scene.sizes.refinements or 0)
        self._ridged = scene.physics.material.E_star * sharpened * self._scales.pressure
        own, theirs = scene.physics.contact, (companion.scene or scene).physics.contact
        self._stiffer = 1.0  # than its companion, whose penalty may be that of an earlier attempt
        if isinstance(own, Penalty) and isinstance(theirs, Penalty):
            self._stiffer = own.stiffness / theirs.stiffness

    def judged(self, state: State) -> State:
        """The state with its error bars; NaN where the companion has no such step."""
        self._run[state.step] = state
        parts = self._missing(state) if self._is_missed(state) else self._parts(state)
        budget = Budget(state.step, theory=self._from_theory(state), **parts)
        self.budgets.append(budget)
        bars: dict[str, Any] = {f"{name}_error": self._beside_force(state, name) for name in self._known(state)}
        return replace(state, force_error=budget.total, delta_error=self._of_depth(state, budget.total), **bars)

    # ---- the force ---------------------------------------------------------------------------------------------------

    def _parts(self, state: State) -> dict[str, float]:
        """The parts of the force's error [force], as `Budget` names them; one line each."""
        force = abs(state.force)
        return {
            "discretisation": self._discretisation(state),
            "enforcement": self._enforcement(state.step) * force,
            "truncation": self._misshapen(state) * force,
            "path": 0.0 if self._physics.evolves else self._path(state, "force"),
            "time": self._path(state, "force") if self._physics.evolves else 0.0,
            "film": self._film.error(state) if self._film else 0.0,
            "bath": self._of_bath(state, "force"),
        }

    def _discretisation(self, state: State) -> float:
        """What the mesh costs the force.

        Errors that are known relative to a force are relative to its compressive and its adhesive
        part, which counts SAFETY times: its rim moves from element to element.
        """
        force = abs(state.force) + SAFETY * self._jkr_adhesive_force(state)
        dim = self._physics.part.dim
        said = grid_convergence(self._off(state.step), self.companion.ratio, RATE)
        least = FLOOR * CONSTANT[dim] * fading(self._elements(state)) * force
        edge = edge_error(self._sizes) * force if dim == 3 else 0.0
        crease = self._at_a_crease(state) * force
        return float(np.max([said, least, edge, crease])) + self._sizes.corner_error * force  # NaN where one is

    def _jkr_adhesive_force(self, state: State) -> float:
        """Adhesive part of the contact force in the limit of JKR [force], >= 0; 0 without adhesion.

        A flat contact of radius a whose edge has the energy release rate K_I^2/(2 E*) = w carries
        the tensile force (8 pi w E* a^3)^(1/2), in plane strain (2 pi w E* a)^(1/2) per length. An
        adhesion with a finite range has a smaller one. The contact force is the difference between
        a compressive part and this one; where it passes zero, the errors of the two parts do not.

        Johnson, Kendall, Roberts, Proc. R. Soc. A 324, 301 (1971); Maugis, J. Colloid Interface
        Sci. 150, 243 (1992). Coverage with and without it: scripts/make_error_bar_table --only
        adhesion.
        """
        adhesion = self._scales.unscaled(self._physics.contact).adhesion
        if adhesion is None:
            return 0.0
        modulus = self._physics.material.E_star * self._scales.pressure
        if self._scales.dim == 2:
            return sqrt(2 * pi * adhesion.work * modulus * state.a)
        return sqrt(8 * pi * adhesion.work * modulus * state.a**3)

    def _at_a_crease(self, state: State) -> float:
        """The relative error of a contact that ends within an element of a circle where the tip's slope jumps.

        Elements that end there stand for a contact that is narrower or wider, as at the edge of a sharp punch: EDGE
        times their size over the radius. Under profiles and rounded punches 0.02 to 0.1 of that ratio was measured
        (tests/physics/test_accuracy.py). At a sharp punch's own edge elements are refined.
        """
        tip = self._physics.indenter
        a = state.a / self._scales.length
        error = 0.0
        for r, width in tip.creases():
            ends_here = width == 0 and self._sizes.edge is not None
            if r > 0 and not ends_here and abs(a - r) <= (size := self._sizes.on_surface(r)):
                error = max(error, EDGE * size / r)
        return error

    def _elements(self, state: State) -> float:
        """Elements in the contact radius, as they were chosen from an accuracy: not those near an edge or a corner."""
        chosen = replace(self._sizes, corners=(), edge=None)
        return chosen.elements(state.a / self._scales.length)

    def _off(self, step: int) -> float:
        """How far the companion's force is from the run's at the same depth; NaN where one has no such step."""
        run, coarse = self._run, self._coarse
        if step not in run or step not in coarse:
            return nan
        own, other = run[step], coarse[step]
        if self._physics.evolves:  # no other row is on its curve
            return self._off_in_time(own, other)
        return abs(force_at(other, own.delta, coarse) - own.force)

    def _off_in_time(self, own: State, other: State) -> float:
        """The same of a row in time, which has a curve of its own.

        What the films beside drained faces take from the force is known on both meshes, and has a part of the bar.
        """
        more = other.force - own.force - (other.delta - own.delta) * self._slope(own)
        if self._film:
            more += self._film.error(own, self.companion.ratio) - self._film.error(own)
        return abs(more)

    def _enforcement(self, step: int) -> float:
        """The relative error of a penalty, whose 1/force is linear in 1/epsilon_n from stiff to soft."""
        if self._soft is None:
            return 0.0
        own, soft = self._coarse.get(step), self._soft.get(step)
        if own is None or soft is None:
            return nan
        low = force_at(soft, own.delta, self._soft)
        if own.force == low:
            return 0.0
        inverse = 2 - own.force / low if low else -1.0
        return abs(1 / inverse - 1) / self._stiffer if inverse > 0 else inf

    def _misshapen(self, state: State) -> float:
        """The relative error of a body that stands for a half-space, or of facets by which a tip is less deep."""
        faceted = PER_DEPTH * self._sag * self._scales.depth / state.delta if state.delta > 0 else 0.0
        return self._truncation + faceted

    def _from_theory(self, state: State) -> float:
        """|F - F_theory| where theory is exact for the body [force]; 0 where it is not, or ends before this depth."""
        theory = self._scene.exact_theory
        solution = theory.at(state.delta / self._scales.depth) if theory and state.delta > 0 else None
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _of_depth(self, state: State, error: float) -> float | None:
        """The error of a depth that was found, from that of the force; None where depths are given."""
        if not self._finds_depths:
            return None
        slope = self._slope(state)
        return error / slope if slope > 0 else error

    def _slope(self, state: State) -> float:
        """dF/ddelta of the companion; of a body that evolves at its time: a paraboloid's power of the depth, or that of
        the contact on a half-space, whichever is more."""
        if self._physics.evolves:
            of_contact = self._physics.material.E_star * self._scales.pressure
            of_contact *= 2 * state.a if self._scales.dim == 3 else 1.0
            return max(of_contact, PER_DEPTH * state.force / state.delta if state.delta > 0 else 0.0)
        if state.delta <= 0:
            return 0.0
        return _exponent(self._coarse.get(state.step, state), self._coarse) * state.force / state.delta

    # ---- the numbers beside the force --------------------------------------------------------------------------------

    def _known(self, state: State) -> list[str]:
        return [name for name in BESIDE if getattr(state, name) is not None]

    def _beside_force(self, state: State, name: str) -> float:
        """The error of a number beside the force."""
        if self._is_missed(state):
            return self._beyond(state, name)
        value = abs(getattr(state, name))
        parts = [
            self._by_mesh(state, name),
            self._soft_difference(state.step, name),
            self._misshapen(state) * value,
            self._path(state, name),
            self._of_bath(state, name),
            self._ridged if name == "p_max" and value > 0 else 0.0,
        ]
        return sum(parts)

    def _by_mesh(self, state: State, name: str) -> float:
        """What the mesh costs a number beside the force."""
        L = self._scales.length
        at_end = self._sizes.on_surface(state.a / L) * L if state.a > 0 else 0.0
        if name == "a":
            return RADIUS * at_end
        value = abs(getattr(state, name))
        least = RADIUS * at_end / state.a * value if state.a > 0 else 0.0
        if name == "p_max":
            if self._physics.is_closed_by_swelling(state.delta / self._scales.depth, state.a / L):
                return nan  # the pressure of the element that closed last, which no other mesh shares
            least = PEAK * self._coarseness_of_peak(state, at_end) ** PRESSURE_RATE * value
        off = _difference(self._coarse, self._run, state.step, name)
        said = grid_convergence(off, self.companion.ratio, PRESSURE_RATE)
        return float(np.max([said, least]))  # NaN where one is

    def _coarseness_of_peak(self, state: State, at_end: float) -> float:
        """The size at_end [length] of the element where the contact ends, over the width of what bears the peak.

        That is the contact radius. Where the contact ends at a punch's rounded edge, it is the part that lies on the
        arc.
        """
        if state.a <= 0:
            return 0.0
        width = state.a
        if self._sizes.edge is not None:
            width -= flat_radius(self._physics.indenter) * self._scales.length
        return at_end / max(width, min(at_end, state.a))

    def _soft_difference(self, step: int, name: str) -> float:
        """What a penalty takes from a number, which is as linear in 1/epsilon_n."""
        if self._soft is None:
            return 0.0
        return _difference(self._coarse, self._soft, step, name) / self._stiffer

    # ---- the path ----------------------------------------------------------------------------------------------------

    def _path(self, state: State, name: str) -> float:
        """What the steps of the path may cost a number, in a force of the depth that prescribed forces have found."""
        if self._ways is None:
            return 0.0
        if name == "force" and self._finds_depths:
            return self._ways.error(state, "delta") * self._slope(state)
        unseen = self._unseen(state, name) if self._physics.contact.slips else 0.0
        return self._ways.error(state, name) + unseen

    def _of_bath(self, state: State, name: str) -> float:
        """What it costs a number, in a force of the depth that is found, that a sudden bath takes some time to come.

        A bath that takes twice as long changes a number by as much as this one does, as soon as it is all there.
        """
        if self._bath is None:
            return 0.0
        if name == "force" and self._finds_depths:
            return SAFETY * _difference(self._coarse, self._bath, state.step, "delta") * self._slope(state)
        return SAFETY * _difference(self._coarse, self._bath, state.step, name)

    def _unseen(self, state: State, name: str) -> float:
        """What halves of a step that is long beside its contact may not show of where and how far the surface slips.

        All of it may differ in the share of the contact radius that the step adds or takes, of the dissipation, which
        is one of the area, in the square of that share. After one step from rest neither is known.
        """
        before, value = self._run.get(state.step - 1), getattr(state, name)
        moved = _share(before.a if before else 0.0, state.a)
        if name == "dissipation":
            return float(moved**2 * value)
        if name == "stick_radius":
            stick = (before.stick_radius if before else None) or 0.0
            narrow = self._unresolved(value) if state.a > 0 else 0.0
            return float(max(moved, _share(stick, value)) * value + narrow)
        return 0.0

    def _unresolved(self, stick: float) -> float:
        """What an element may not show of a place that sticks and is narrower than itself [length]."""
        r = stick / self._scales.length
        return max(self._sizes.on_surface(r) - r, 0.0) / 2 * self._scales.length

    # ---- a contact that no point of the mesh notices -----------------------------------------------------------------

    def _is_missed(self, state: State) -> bool:
        """Whether the tip is pressed in so little that no point of the mesh notices."""
        return state.delta > 0 and state.force == 0 and not self._physics.evolves

    def _missing(self, state: State) -> dict[str, float]:
        return {"discretisation": self._beyond(state, "force")}

    def _beyond(self, state: State, name: str) -> float:
        """A number of the companion's shallowest contact from this depth on, where what grows with it is more."""
        deeper = (other for other in self._coarse.values() if other.delta >= state.delta and other.force > 0)
        shallowest = min(deeper, key=lambda other: other.delta, default=None)
        return float(getattr(shallowest, name)) if shallowest else nan


class TheoryBars:
    """The error bars of a scene that theory solves: its own stated error, of every number.

    Where its tip would have to pull, contact radius and pressure are not known at all.
    """

    companion: Companion | None = None

    def __init__(self, scene: Scene):
        assert scene.plan.theory is not None
        self.budgets: list[Budget] = []
        self._error, self._finds_depths = scene.plan.theory.error, scene.physics.path.control == "force"
        self._of_contact = 1.0 if scene.plan.theory.pull else self._error

    def judged(self, state: State) -> State:
        """The state with its error bars."""
        force, contact = self._error * abs(state.force), self._of_contact
        self.budgets.append(Budget(state.step, theory=force))
        depth = self._error * abs(state.delta) if self._finds_depths else None
        found = replace(state, a_error=contact * state.a, p_max_error=contact * state.p_max)
        return replace(found, force_error=force, delta_error=depth)


Bars = ErrorBars | TheoryBars


def _share(before: float, after: float) -> float:
    """How much of the larger of two lengths a step adds or takes."""
    return abs(after - before) / (max(before, after) or 1.0)


def _difference(one: Curve, other: Curve, step: int, name: str) -> float:
    """How far a number of a step is apart on two curves; NaN where one has no such step."""
    if step not in one or step not in other:
        return nan
    return float(abs(getattr(other[step], name) - getattr(one[step], name)))


def force_at(state: State, delta: float, curve: Curve) -> float:
    """The force of a curve at a depth near one of its states: force (delta/its depth)^m, m the slope of their logs.

    At the state's own depth it is the state's force, to the last digit.
    """
    if state.delta == delta or state.delta <= 0 or delta <= 0:
        return state.force
    return float(state.force * (delta / state.delta) ** _exponent(state, curve))


def _exponent(state: State, curve: Curve) -> float:
    """dlnF/dlndelta between the states beside one; that of a paraboloid where there are none."""
    beside = [curve[k] for k in (state.step - 1, state.step, state.step + 1) if k in curve]
    first, last = min(beside, key=lambda s: s.delta), max(beside, key=lambda s: s.delta)
    if first.force <= 0 or first.delta <= 0 or last.delta <= first.delta:
        return 1.5
    return float(np.log(last.force / first.force) / np.log(last.delta / first.delta))
