"""Half-widths of the error bars of a run's rows, from one companion on a coarser mesh.

Elements of the size h give a number f, elements of q h the number f_q. Where the error falls as
h^p, Richardson's extrapolation says that f is off by |f_q - f|/(q^p - 1), and Roache's grid
convergence index takes SAFETY = 3 of it where two meshes alone are known, since nothing then tests
whether the error falls so. Two meshes may agree by accident (which elements touch changes from step
to step, and the difference passes through zero): so no bar is narrower than a floor, a share of the
error that so many elements in a contact radius have cost in general.

    force    max(SAFETY |F_q - F|/(q^RATE - 1), FLOOR CONSTANT n^-RATE |F|, edge) + corners
    a        RADIUS times the element in which the contact ends
    p_max    max(SAFETY |p_q - p|/(q^PRESSURE_RATE - 1), PEAK n^-PRESSURE_RATE p)

with n elements in the contact radius of the row (for p_max beneath a punch's rounded edge in its
part on the arc). The rule has eight numbers: the ratio q of the meshes, SAFETY, RATE, FLOOR,
RADIUS, PRESSURE_RATE, PEAK, and that of an edge, of a sharp punch in three dimensions or of a
contact that ends where the tip's slope jumps (`doubts.EDGE`). CONSTANT is that by which `accuracy`
chooses its meshes. To this come the parts that no mesh shows, each measured by a run of its own or
known beforehand: see `Budget`. No bar of a force is narrower than its distance from a theory that
is exact for the body. `scripts/make_error_bar_table` measures coverage and width with and without
each number of the rule.

Roache, J. Fluids Eng. 116, 405 (1994); Annu. Rev. Fluid Mech. 29, 123 (1997), whose safety factors
are 3 for two grids and 1.25 for three; Verification and Validation in Computational Science and
Engineering (Hermosa, 1998).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import acosh, inf, nan
from typing import Any

import numpy as np

from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.model.tips import flat_radius
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    States,
    StatesByStep,
    halve_increments,
    states_by_step,
)
from indent_sim.run.error_estimation.film_error import FilmError
from indent_sim.scene.expected_error import EDGE_ERROR, FORCE_DEPTH_EXPONENT, edge_error
from indent_sim.scene.resolution import ERROR_CONSTANT, ORDER_OF_CONVERGENCE, error_decay
from indent_sim.scene.scene import Scene

# ---- the numbers of the rule: docs/accuracy.md has coverage and width with and without each
# ------------------------

SAFETY_FACTOR = 3.0  # Roache's, where two meshes alone are known
# of CONSTANT n^-RATE, from which `accuracy` chooses n elements in a contact radius (see `fineness`)
MIN_ERROR_FRACTION = 0.2
RADIUS_ERROR = 0.09  # of the element where the contact ends, to which the radius is read off
# of the largest pressure: quadratic elements have stresses of order 2
PRESSURE_ORDER = 2.0
PEAK_ERROR = 0.2

SECONDARY_COLUMNS = (
    "a",
    "p_max",
    "stick_radius",
    "dissipation",
)  # numbers beside the force that have bars


@dataclass(frozen=True)
class ErrorBudget:
    """What makes up the half-width of the error bar of a row's force [force].

    discretisation: the mesh. enforcement: the penalty's stiffness. truncation: the finite body that
    stands for a half-space, or flat facets for a curved surface. theory: the distance from a theory
    that is exact for this body. path: with friction the steps of the path. time: of a body that
    evolves the steps in time. film: of a body that drains, the films beside its drained faces.
    bath: of a gel, the time that a sudden bath takes to come.
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
        return {
            name: value for name, value in asdict(self).items() if name not in ("step", "theory")
        }

    @property
    def estimated(self) -> float:
        """The sum of the parts [force]."""
        return sum(self.parts.values())

    @property
    def total(self) -> float:
        """The half-width [force]: the sum of the parts, but never less than what exact theory knows
        to be wrong.
        """
        return self.theory if self.theory > self.estimated else self.estimated


def grid_convergence_index(difference: float, ratio: float, rate: float) -> float:
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
    return SAFETY_FACTOR * difference / abs(ratio**rate - 1)


def ridge_pressure(turn: float, refinements: int) -> float:
    """Return the largest excess pressure over E* at the ridges of a faceted mesh that stands for a
    curved surface.

    Two facets that meet at the angle theta are a cone of the slope theta/2 to a tip that is flat
    there, whose pressure grows as E* theta/4 arccosh(l/r) towards the ridge (Sneddon 1965, Int. J.
    Eng. Sci. 3, 47; Johnson, Contact Mechanics, 5.2). l is the length of a facet, and no pressure
    is read off nearer than a quarter of an element, so that this is the most. On meshes of caps
    under balls and plates, refined one to three times, p_max was 0.57 to 0.67, 0.67 to 0.72 and
    0.83 to 0.87 of E* theta too large, where this says 0.69, 0.87 and 1.04.

    Parameters
    ----------
    turn
        The angle theta [radians]; 0 where nothing is faceted.
    refinements
        How often each facet has been halved.
    """
    return turn / 4 * acosh(4.0 * 2.0**refinements)


@dataclass(frozen=True)
class StepRefinement:
    """The path of a scene with friction, or of a body that evolves, in its own steps and in steps
    half as long.
    """

    full_steps: StatesByStep
    half_steps: StatesByStep

    def error(self, state: State, name: str) -> float:
        """The error of a number of a step: SAFETY times what steps half as long change; NaN without
        such a step.

        Twice that change is Richardson's error of first order, 2.6 times that of order 0.7, with
        which a path converges whose new contact sticks where its step began.
        """
        return SAFETY_FACTOR * _value_difference(self.full_steps, self.half_steps, state.step, name)


def step_refinement(
    base_run: CoarserRun, follow: Callable[[Scene], States]
) -> StepRefinement | None:
    """What the steps of a path may cost, by a run and steps half as long; None where it does not
    matter.
    """
    finer = halve_increments(base_run.scene) if base_run.scene else None
    if base_run.scene is None or finer is None:
        return None
    half_step_states = follow(finer)
    full_step_states = [
        replace(
            last,
            step=last.step // 2,
            dissipation=(first.dissipation or 0.0) + (last.dissipation or 0.0),
        )
        for first, last in zip(half_step_states[::2], half_step_states[1::2], strict=False)
    ]
    return StepRefinement(base_run.states_by_step, states_by_step(full_step_states))


class ErrorBars:
    """Judges one row after another against the companion's curve.

    Where forces are prescribed and depths found, the error of the force is that at the row's depth,
    and the error of the depth what the curve makes of it.

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
        companion: CoarserRun,
        soft: States | None = None,
        ways: StepRefinement | None = None,
        film: FilmError | None = None,
        bath: States | None = None,
    ):
        self.budgets: list[ErrorBudget] = []
        self.coarser_run = companion
        self._step_refinement = ways
        self._film_error = film
        self._bath_states = None if bath is None else states_by_step(bath)
        self._coarse_states = companion.states_by_step
        self._soft_states = None if soft is None else states_by_step(soft)
        self._run_states: StatesByStep = {}
        self._scene = scene
        self._physics = scene.physics
        self._sizes = scene.sizes
        self._scales = scene.physics.scales
        self._has_prescribed_forces = scene.physics.path.control == "force"
        self._truncation = sum(
            doubt.force_error for doubt in scene.plan.model_warnings if doubt.key == "truncation"
        )
        domain = scene.physics.domain
        contact_place = scene.physics.center, scene.sizes.a, scene.sizes.refinements or 0
        self._sag = domain.facet_sagitta(*contact_place)
        ridge_excess = ridge_pressure(
            domain.facet_angle(*contact_place), scene.sizes.refinements or 0
        )
        self._ridge_pressure_error = (
            scene.physics.material.E_star * ridge_excess * self._scales.pressure
        )
        law = scene.physics.contact
        coarse_law = (companion.scene or scene).physics.contact
        self._stiffness_ratio = (
            1.0  # than its companion, whose penalty may be that of an earlier attempt
        )
        if isinstance(law, Penalty) and isinstance(coarse_law, Penalty):
            self._stiffness_ratio = law.stiffness / coarse_law.stiffness

    def add_error_estimate(self, state: State) -> State:
        """The state with its error bars; NaN where the companion has no such step."""
        self._run_states[state.step] = state
        force_parts = (
            self._missed_contact_parts(state)
            if self._is_contact_missed(state)
            else self._force_error_parts(state)
        )
        budget = ErrorBudget(state.step, theory=self._theory_distance(state), **force_parts)
        self.budgets.append(budget)
        errors: dict[str, Any] = {
            f"{name}_error": self._secondary_error(state, name)
            for name in self._secondary_names(state)
        }
        return replace(
            state,
            force_error=budget.total,
            delta_error=self._depth_error(state, budget.total),
            **errors,
        )

    # ---- the force
    # ---------------------------------------------------------------------------------------------------

    def _force_error_parts(self, state: State) -> dict[str, float]:
        """The parts of the force's error [force], as `Budget` names them; one line each."""
        force = abs(state.force)
        return {
            "discretisation": self._discretisation_error(state),
            "enforcement": self._penalty_error(state.step) * force,
            "truncation": self._geometry_error(state) * force,
            "path": 0.0 if self._physics.is_time_dependent else self._step_error(state, "force"),
            "time": self._step_error(state, "force") if self._physics.is_time_dependent else 0.0,
            "film": self._film_error.force_error(state) if self._film_error else 0.0,
            "bath": self._bath_error(state, "force"),
        }

    def _discretisation_error(self, state: State) -> float:
        """What the mesh costs the force."""
        force = abs(state.force)
        dim = self._physics.domain.dim
        estimate = grid_convergence_index(
            self._force_difference(state.step), self.coarser_run.ratio, ORDER_OF_CONVERGENCE
        )
        min_error = (
            MIN_ERROR_FRACTION
            * ERROR_CONSTANT[dim]
            * error_decay(self._elements_in_radius(state))
            * force
        )
        edge = edge_error(self._sizes) * force if dim == 3 else 0.0
        discontinuity_error = self._slope_discontinuity_error(state) * force
        return (
            float(np.max([estimate, min_error, edge, discontinuity_error]))
            + self._sizes.corner_error * force
        )  # NaN where one is

    def _slope_discontinuity_error(self, state: State) -> float:
        """The relative error of a contact that ends within an element of a circle where the tip's
        slope jumps.

        Elements that end there stand for a contact that is narrower or wider, as at the edge of a
        sharp punch: EDGE times their size over the radius. Under profiles and rounded punches 0.02
        to 0.1 of that ratio was measured (tests/physics/test_accuracy.py). At a sharp punch's own
        edge elements are refined.
        """
        tip = self._physics.indenter
        a = state.a / self._scales.length
        error = 0.0
        for r, width in tip.slope_discontinuities():
            ends_here = width == 0 and self._sizes.punch_edge is not None
            if r > 0 and not ends_here and abs(a - r) <= (size := self._sizes.surface_size(r)):
                error = max(error, EDGE_ERROR * size / r)
        return error

    def _elements_in_radius(self, state: State) -> float:
        """Elements in the contact radius, as they were chosen from an accuracy: not those near an
        edge or a corner.
        """
        regular_sizes = replace(self._sizes, corners=(), punch_edge=None)
        return regular_sizes.elements_in_contact(state.a / self._scales.length)

    def _force_difference(self, step: int) -> float:
        """How far the companion's force is from the run's at the same depth; NaN where one has no
        such step.
        """
        run_states = self._run_states
        coarse_states = self._coarse_states
        if step not in run_states or step not in coarse_states:
            return nan
        state = run_states[step]
        coarse_state = coarse_states[step]
        if self._physics.is_time_dependent:  # no other row is on its curve
            return self._transient_force_difference(state, coarse_state)
        return abs(interpolate_force(coarse_state, state.delta, coarse_states) - state.force)

    def _transient_force_difference(self, state: State, coarse_state: State) -> float:
        """The same of a row in time, which has a curve of its own.

        What the films beside drained faces take from the force is known on both meshes, and has a
        part of the bar.
        """
        difference = (
            coarse_state.force
            - state.force
            - (coarse_state.delta - state.delta) * self._force_slope(state)
        )
        if self._film_error:
            difference += self._film_error.force_error(
                state, self.coarser_run.ratio
            ) - self._film_error.force_error(state)
        return abs(difference)

    def _penalty_error(self, step: int) -> float:
        """The relative error of a penalty, whose 1/force is linear in 1/epsilon_n from stiff to
        soft.
        """
        if self._soft_states is None:
            return 0.0
        stiff_state = self._coarse_states.get(step)
        soft_state = self._soft_states.get(step)
        if stiff_state is None or soft_state is None:
            return nan
        soft_force = interpolate_force(soft_state, stiff_state.delta, self._soft_states)
        if stiff_state.force == soft_force:
            return 0.0
        inverse = 2 - stiff_state.force / soft_force if soft_force else -1.0
        return abs(1 / inverse - 1) / self._stiffness_ratio if inverse > 0 else inf

    def _geometry_error(self, state: State) -> float:
        """The relative error of a body that stands for a half-space, or of facets by which a tip is
        less deep.
        """
        faceted = (
            FORCE_DEPTH_EXPONENT * self._sag * self._scales.depth / state.delta
            if state.delta > 0
            else 0.0
        )
        return self._truncation + faceted

    def _theory_distance(self, state: State) -> float:
        """|F - F_theory| where theory is exact for the body [force]; 0 where it is not, or ends
        before this depth.
        """
        theory = self._scene.exact_theory
        solution = (
            theory.solution_at_depth(state.delta / self._scales.depth)
            if theory and state.delta > 0
            else None
        )
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _depth_error(self, state: State, error: float) -> float | None:
        """The error of a depth that was found, from that of the force; None where depths are given."""
        if not self._has_prescribed_forces:
            return None
        slope = self._force_slope(state)
        return error / slope if slope > 0 else error

    def _force_slope(self, state: State) -> float:
        """dF/ddelta of the companion; of a body that evolves at its time: a paraboloid's power of
        the depth, or that of the contact on a half-space, whichever is more.
        """
        if self._physics.is_time_dependent:
            contact_stiffness = self._physics.material.E_star * self._scales.pressure
            contact_stiffness *= 2 * state.a if self._scales.dim == 3 else 1.0
            return max(
                contact_stiffness,
                FORCE_DEPTH_EXPONENT * state.force / state.delta if state.delta > 0 else 0.0,
            )
        if state.delta <= 0:
            return 0.0
        return (
            _log_slope(self._coarse_states.get(state.step, state), self._coarse_states)
            * state.force
            / state.delta
        )

    # ---- the numbers beside the force
    # --------------------------------------------------------------------------------

    def _secondary_names(self, state: State) -> list[str]:
        return [name for name in SECONDARY_COLUMNS if getattr(state, name) is not None]

    def _secondary_error(self, state: State, name: str) -> float:
        """The error of a number beside the force."""
        if self._is_contact_missed(state):
            return self._shallowest_value(state, name)
        value = abs(getattr(state, name))
        contributions = [
            self._secondary_mesh_error(state, name),
            self._secondary_penalty_error(state.step, name),
            self._geometry_error(state) * value,
            self._step_error(state, name),
            self._bath_error(state, name),
            self._ridge_pressure_error if name == "p_max" and value > 0 else 0.0,
        ]
        return sum(contributions)

    def _secondary_mesh_error(self, state: State, name: str) -> float:
        """What the mesh costs a number beside the force."""
        L = self._scales.length
        end_element = self._sizes.surface_size(state.a / L) * L if state.a > 0 else 0.0
        if name == "a":
            return RADIUS_ERROR * end_element
        value = abs(getattr(state, name))
        min_error = RADIUS_ERROR * end_element / state.a * value if state.a > 0 else 0.0
        if name == "p_max":
            if self._physics.is_closed_by_swelling(state.delta / self._scales.depth, state.a / L):
                return (
                    nan  # the pressure of the element that closed last, which no other mesh shares
                )
            min_error = (
                PEAK_ERROR * self._relative_peak_size(state, end_element) ** PRESSURE_ORDER * value
            )
        difference = _value_difference(self._coarse_states, self._run_states, state.step, name)
        estimate = grid_convergence_index(difference, self.coarser_run.ratio, PRESSURE_ORDER)
        return float(np.max([estimate, min_error]))  # NaN where one is

    def _relative_peak_size(self, state: State, end_element: float) -> float:
        """The size at_end [length] of the element where the contact ends, over the width of what
        bears the peak.

        That is the contact radius. Where the contact ends at a punch's rounded edge, it is the part
        that lies on the arc.
        """
        if state.a <= 0:
            return 0.0
        width = state.a
        if self._sizes.punch_edge is not None:
            width -= flat_radius(self._physics.indenter) * self._scales.length
        return end_element / max(width, min(end_element, state.a))

    def _secondary_penalty_error(self, step: int, name: str) -> float:
        """What a penalty takes from a number, which is as linear in 1/epsilon_n."""
        if self._soft_states is None:
            return 0.0
        return (
            _value_difference(self._coarse_states, self._soft_states, step, name)
            / self._stiffness_ratio
        )

    # ---- the path
    # ----------------------------------------------------------------------------------------------------

    def _step_error(self, state: State, name: str) -> float:
        """What the steps of the path may cost a number, in a force of the depth that prescribed
        forces have found.
        """
        if self._step_refinement is None:
            return 0.0
        if name == "force" and self._has_prescribed_forces:
            return self._step_refinement.error(state, "delta") * self._force_slope(state)
        unseen = self._long_step_error(state, name) if self._physics.contact.may_slip else 0.0
        return self._step_refinement.error(state, name) + unseen

    def _bath_error(self, state: State, name: str) -> float:
        """What it costs a number, in a force of the depth that is found, that a sudden bath takes
        some time to come.

        A bath that takes twice as long changes a number by as much as this one does, as soon as it
        is all there.
        """
        if self._bath_states is None:
            return 0.0
        if name == "force" and self._has_prescribed_forces:
            return (
                SAFETY_FACTOR
                * _value_difference(self._coarse_states, self._bath_states, state.step, "delta")
                * self._force_slope(state)
            )
        return SAFETY_FACTOR * _value_difference(
            self._coarse_states, self._bath_states, state.step, name
        )

    def _long_step_error(self, state: State, name: str) -> float:
        """What halves of a step that is long beside its contact may not show of where and how far
        the surface slips.

        All of it may differ in the share of the contact radius that the step adds or takes, of the
        dissipation, which is one of the area, in the square of that share. After one step from rest
        neither is known.
        """
        previous = self._run_states.get(state.step - 1)
        value = getattr(state, name)
        radius_change = _relative_change(previous.a if previous else 0.0, state.a)
        if name == "dissipation":
            return float(radius_change**2 * value)
        if name == "stick_radius":
            stick = (previous.stick_radius if previous else None) or 0.0
            narrow_stick = self._unresolved_stick(value) if state.a > 0 else 0.0
            return float(max(radius_change, _relative_change(stick, value)) * value + narrow_stick)
        return 0.0

    def _unresolved_stick(self, stick: float) -> float:
        """What an element may not show of a place that sticks and is narrower than itself [length]."""
        r = stick / self._scales.length
        return max(self._sizes.surface_size(r) - r, 0.0) / 2 * self._scales.length

    # ---- a contact that no point of the mesh notices
    # -----------------------------------------------------------------

    def _is_contact_missed(self, state: State) -> bool:
        """Whether the tip is pressed in so little that no point of the mesh notices."""
        return state.delta > 0 and state.force == 0 and not self._physics.is_time_dependent

    def _missed_contact_parts(self, state: State) -> dict[str, float]:
        return {"discretisation": self._shallowest_value(state, "force")}

    def _shallowest_value(self, state: State, name: str) -> float:
        """A number of the companion's shallowest contact from this depth on, where what grows with
        it is more.
        """
        deeper_states = (
            coarse_state
            for coarse_state in self._coarse_states.values()
            if coarse_state.delta >= state.delta and coarse_state.force > 0
        )
        shallowest = min(deeper_states, key=lambda coarse_state: coarse_state.delta, default=None)
        return float(getattr(shallowest, name)) if shallowest else nan


class TheoryBars:
    """The error bars of a scene that theory solves: its own stated error, of every number.

    Where its tip would have to pull, contact radius and pressure are not known at all.
    """

    coarser_run: CoarserRun | None = None

    def __init__(self, scene: Scene):
        assert scene.plan.theory is not None
        self.budgets: list[ErrorBudget] = []
        self._error = scene.plan.theory.error
        self._has_prescribed_forces = scene.physics.path.control == "force"
        self._contact_error = 1.0 if scene.plan.theory.tension_fraction else self._error

    def add_error_estimate(self, state: State) -> State:
        """The state with its error bars."""
        force = self._error * abs(state.force)
        contact = self._contact_error
        self.budgets.append(ErrorBudget(state.step, theory=force))
        depth = self._error * abs(state.delta) if self._has_prescribed_forces else None
        estimated = replace(state, a_error=contact * state.a, p_max_error=contact * state.p_max)
        return replace(estimated, force_error=force, delta_error=depth)


AnyErrorBars = ErrorBars | TheoryBars


def _relative_change(old: float, new: float) -> float:
    """How much of the larger of two lengths a step adds or takes."""
    return abs(new - old) / (max(old, new) or 1.0)


def _value_difference(first: StatesByStep, second: StatesByStep, step: int, name: str) -> float:
    """How far a number of a step is apart on two curves; NaN where one has no such step."""
    if step not in first or step not in second:
        return nan
    return float(abs(getattr(second[step], name) - getattr(first[step], name)))


def interpolate_force(state: State, delta: float, curve: StatesByStep) -> float:
    """The force of a curve at a depth near one of its states: force (delta/its depth)^m, m the
    slope of their logs.

    At the state's own depth it is the state's force, to the last digit.
    """
    if state.delta == delta or state.delta <= 0 or delta <= 0:
        return state.force
    return float(state.force * (delta / state.delta) ** _log_slope(state, curve))


def _log_slope(state: State, curve: StatesByStep) -> float:
    """dlnF/dlndelta between the states beside one; that of a paraboloid where there are none."""
    neighbours = [curve[k] for k in (state.step - 1, state.step, state.step + 1) if k in curve]
    first = min(neighbours, key=lambda s: s.delta)
    last = max(neighbours, key=lambda s: s.delta)
    if first.force <= 0 or first.delta <= 0 or last.delta <= first.delta:
        return 1.5
    return float(np.log(last.force / first.force) / np.log(last.delta / first.delta))
