"""Half-widths of the error bars of a run's rows, from one run on a coarser mesh.

Elements of the size h give a number f, elements of the size q h the number f_q. If the error falls
as h^p with the convergence rate p, Richardson extrapolation gives the error |f_q - f|/(q^p - 1) of
f. Roache's grid convergence index multiplies it by the factor of safety 3 if only two meshes are
known, since nothing then tests the assumed order. Two meshes may agree by accident (which elements
touch changes from step to step, and the difference passes through zero). Therefore every bar has a
lower bound: a fraction of the error that a mesh of this resolution has in general.

    force    max(SAFETY_FACTOR |F_q - F|/(q^p - 1), MIN_ERROR_FRACTION C n^-p F', edge F')
             + corners F', with F' = |F| + SAFETY_FACTOR F_a, C = ERROR_CONSTANT and
             p = ORDER_OF_CONVERGENCE
    a        RADIUS_ERROR times the element in which the contact ends
    p_max    max(SAFETY_FACTOR |p_q - p|/(q^2 - 1), PEAK_ERROR n^-2 p), 2 = PRESSURE_ORDER

n is the number of elements in the contact radius of the row (for p_max beneath a punch's rounded
edge in the part on the arc), F_a the adhesive force (see `ErrorBars._jkr_adhesive_force`). The rule
has eight numbers: the refinement ratio q, SAFETY_FACTOR, ORDER_OF_CONVERGENCE, MIN_ERROR_FRACTION,
RADIUS_ERROR, PRESSURE_ORDER, PEAK_ERROR, and EDGE_ERROR of `model_warnings` for the edge of a sharp
punch in three dimensions or a contact that ends where the tip's slope jumps. ERROR_CONSTANT is the
one by which `accuracy` chooses its meshes. Errors that do not depend on the mesh are added, each
measured by an auxiliary run or known in advance: see `ErrorBudget`. The bar of a force is never
narrower than its distance from a theory that is exact for the body. `scripts/make_error_bar_table`
measures coverage and width with and without each number of the rule.

Roache, J. Fluids Eng. 116, 405 (1994); Annu. Rev. Fluid Mech. 29, 123 (1997), whose safety factors
are 3 for two grids and 1.25 for three; Verification and Validation in Computational Science and
Engineering (Hermosa, 1998).
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, pi, sqrt
from typing import Any

import numpy as np

from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.model.tips import flat_radius
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    States,
    StatesByStep,
    states_by_step,
)
from indent_sim.run.error_estimation.error_budget import (
    SAFETY_FACTOR,
    ErrorBudget,
    grid_convergence_index,
    ridge_pressure,
)
from indent_sim.run.error_estimation.film_error import FilmError
from indent_sim.run.error_estimation.step_refinement import StepRefinement, value_difference
from indent_sim.scene.expected_error import FORCE_DEPTH_EXPONENT, edge_error
from indent_sim.scene.measured_constants import EDGE_ERROR, ERROR_CONSTANT, ORDER_OF_CONVERGENCE
from indent_sim.scene.resolution import error_decay
from indent_sim.scene.scene import Scene

# Lower bound of the error, relative to ERROR_CONSTANT n^-ORDER_OF_CONVERGENCE (see `resolution`).
MIN_ERROR_FRACTION = 0.2
RADIUS_ERROR = 0.09  # error of the contact radius, relative to the element where the contact ends
PRESSURE_ORDER = 2.0  # order of convergence of p_max: that of the stresses of quadratic elements
PEAK_ERROR = 0.2  # lower bound of the error of p_max, relative to n^-PRESSURE_ORDER p_max


class ErrorBars:
    """Estimates the errors of one row after another by comparison with the coarser run.

    Where forces are prescribed, the error of the force is that at the depth of the row, and the
    error of the depth follows from it by the slope of the curve.

    Parameters
    ----------
    scene
        The scene of the run.
    companion
        The coarser run.
    soft
        The coarser run with half the penalty stiffness, where there is a penalty.
    ways
        The coarser run in its own and in halved increments, where they matter.
    film
        Error by drainage films on the mesh of the run, for a body that drains.
    bath
        The coarser run with a bath that rises for twice as long, where a bath rises.
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
            warning.force_error
            for warning in scene.plan.model_warnings
            if warning.key == "truncation"
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
        # The coarser run may be a previous refinement level with another penalty stiffness.
        self._stiffness_ratio = 1.0
        if isinstance(law, Penalty) and isinstance(coarse_law, Penalty):
            self._stiffness_ratio = law.stiffness / coarse_law.stiffness

    def add_error_estimate(self, state: State) -> State:
        """Return the state with its error estimates; NaN where the coarser run lacks the step."""
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

    # ---- force

    def _force_error_parts(self, state: State) -> dict[str, float]:
        """Parts of the error of the force [force], named as in `ErrorBudget`."""
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
        """Error of the force by the mesh [force].

        Errors that are known relative to a force are relative to its compressive and its adhesive
        part, which counts SAFETY_FACTOR times: its rim moves from element to element.
        """
        force = abs(state.force) + SAFETY_FACTOR * self._jkr_adhesive_force(state)
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
        # np.max, unlike max, returns NaN if any of its arguments is NaN.
        return (
            float(np.max([estimate, min_error, edge, discontinuity_error]))
            + self._sizes.corner_error * force
        )

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
        adhesion = self._scales.to_user_units(self._physics.contact).adhesion
        if adhesion is None:
            return 0.0
        modulus = self._physics.material.E_star * self._scales.pressure
        if self._scales.dim == 2:
            return sqrt(2 * pi * adhesion.work * modulus * state.a)
        return sqrt(8 * pi * adhesion.work * modulus * state.a**3)

    def _slope_discontinuity_error(self, state: State) -> float:
        """Relative error of a contact that ends within an element of the tip's slope discontinuity.

        The contact of elements that end there is narrower or wider than the true one, as at the
        edge of a sharp punch: the error is EDGE_ERROR times the ratio of their size and the radius.
        Under profiles and rounded punches errors of 0.02 to 0.1 of that ratio were measured
        (tests/physics/test_accuracy.py). Elements at the edge of a sharp punch are refined.
        """
        tip = self._physics.indenter
        a = state.a / self._scales.length
        error = 0.0
        for r, width in tip.slope_discontinuities():
            is_punch_edge = width == 0 and self._sizes.punch_edge is not None
            if r > 0 and not is_punch_edge and abs(a - r) <= (size := self._sizes.surface_size(r)):
                error = max(error, EDGE_ERROR * size / r)
        return error

    def _elements_in_radius(self, state: State) -> float:
        """Elements in the contact radius, without the refinement near an edge or a corner."""
        regular_sizes = replace(self._sizes, corners=(), punch_edge=None)
        return regular_sizes.elements_in_contact(state.a / self._scales.length)

    def _force_difference(self, step: int) -> float:
        """Distance of the coarser run's force at the same depth; NaN if the step is missing."""
        run_states = self._run_states
        coarse_states = self._coarse_states
        if step not in run_states or step not in coarse_states:
            return nan
        state = run_states[step]
        coarse_state = coarse_states[step]
        # The curve of a time-dependent row contains no other row to interpolate from.
        if self._physics.is_time_dependent:
            return self._transient_force_difference(state, coarse_state)
        return abs(interpolate_force(coarse_state, state.delta, coarse_states) - state.force)

    def _transient_force_difference(self, state: State, coarse_state: State) -> float:
        """Force difference of a time-dependent row, by the linearised force at its depth.

        The error by drainage films is known on both meshes and is a part of its own.
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
        """Relative error by the penalty stiffness: 1/F is linear in 1/epsilon_n."""
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
        """Relative error by the truncation of a half-space and by flat facets of a curved surface.

        Facets reduce the effective depth by their sagitta.
        """
        facet_error = (
            FORCE_DEPTH_EXPONENT * self._sag * self._scales.depth / state.delta
            if state.delta > 0
            else 0.0
        )
        return self._truncation + facet_error

    def _theory_distance(self, state: State) -> float:
        """|F - F_theory| [force] where theory is exact for the body at this depth, else 0."""
        if self._scene.exact_theory is None or state.delta <= 0:
            return 0.0
        solution = self._scene.theory_solution(state.delta / self._scales.depth)
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _depth_error(self, state: State, error: float) -> float | None:
        """Error of a computed depth from that of the force; None where depths are prescribed."""
        if not self._has_prescribed_forces:
            return None
        slope = self._force_slope(state)
        return error / slope if slope > 0 else error

    def _force_slope(self, state: State) -> float:
        """Slope dF/ddelta of the coarser run.

        For a time-dependent body, at fixed time, the larger one of the slope of a paraboloid, F ~
        delta^1.5, and of a flat punch on a half-space.
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

    # ---- contact radius, pressure, stick radius, dissipation

    def _secondary_names(self, state: State) -> list[str]:
        """Columns other than the force that the row has."""
        # Columns other than the force that have error bars.
        columns = ("a", "p_max", "stick_radius", "dissipation")
        return [name for name in columns if getattr(state, name) is not None]

    def _secondary_error(self, state: State, name: str) -> float:
        """Error of a number other than the force."""
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
        """Error of a number other than the force by the mesh."""
        L = self._scales.length
        end_element = self._sizes.surface_size(state.a / L) * L if state.a > 0 else 0.0
        if name == "a":
            return RADIUS_ERROR * end_element
        value = abs(getattr(state, name))
        min_error = RADIUS_ERROR * end_element / state.a * value if state.a > 0 else 0.0
        if name == "p_max":
            # The pressure is that of the element that closed last, which no other mesh shares.
            if self._physics.is_closed_by_swelling(state.delta / self._scales.depth, state.a / L):
                return nan
            min_error = (
                PEAK_ERROR * self._relative_peak_size(state, end_element) ** PRESSURE_ORDER * value
            )
        difference = value_difference(self._coarse_states, self._run_states, state.step, name)
        estimate = grid_convergence_index(difference, self.coarser_run.ratio, PRESSURE_ORDER)
        return float(np.max([estimate, min_error]))  # NaN if either is

    def _relative_peak_size(self, state: State, end_element: float) -> float:
        """Ratio of the element at the end of the contact and the width that carries the peak.

        The width is the contact radius, or its part on the arc where the contact ends at a punch's
        rounded edge.

        Parameters
        ----------
        state
            The row [user's units].
        end_element
            Size of the element at the end of the contact [length].
        """
        if state.a <= 0:
            return 0.0
        width = state.a
        if self._sizes.punch_edge is not None:
            width -= flat_radius(self._physics.indenter) * self._scales.length
        return end_element / max(width, min(end_element, state.a))

    def _secondary_penalty_error(self, step: int, name: str) -> float:
        """Error of a number by the penalty stiffness; it is linear in 1/epsilon_n."""
        if self._soft_states is None:
            return 0.0
        return (
            value_difference(self._coarse_states, self._soft_states, step, name)
            / self._stiffness_ratio
        )

    # ---- load increments and time steps

    def _step_error(self, state: State, name: str) -> float:
        """Error of a number by the load increments or time steps.

        For a prescribed force it follows from the error of the depth.
        """
        if self._step_refinement is None:
            return 0.0
        if name == "force" and self._has_prescribed_forces:
            return self._step_refinement.error(state, "delta") * self._force_slope(state)
        unresolved_error = (
            self._long_step_error(state, name) if self._physics.contact.may_slip else 0.0
        )
        return self._step_refinement.error(state, name) + unresolved_error

    def _bath_error(self, state: State, name: str) -> float:
        """Error of a number by the finite time in which a suddenly applied bath rises.

        A bath that rises for twice as long changes a number as much as this one does, once it has
        risen. For a prescribed force the error follows from that of the depth.
        """
        if self._bath_states is None:
            return 0.0
        if name == "force" and self._has_prescribed_forces:
            return (
                SAFETY_FACTOR
                * value_difference(self._coarse_states, self._bath_states, state.step, "delta")
                * self._force_slope(state)
            )
        return SAFETY_FACTOR * value_difference(
            self._coarse_states, self._bath_states, state.step, name
        )

    def _long_step_error(self, state: State, name: str) -> float:
        """Error of the slip by a long increment that halving the increment may not show.

        It is the relative change of the contact radius in the increment, for the dissipation (per
        area) the square of it. Neither is known after one increment from rest.
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
        """Length that an element cannot resolve of a stick zone narrower than itself [length]."""
        r = stick / self._scales.length
        return max(self._sizes.surface_size(r) - r, 0.0) / 2 * self._scales.length

    # ---- contact between the points of the mesh

    def _is_contact_missed(self, state: State) -> bool:
        """True if the depth is so small that no integration point is in contact."""
        return state.delta > 0 and state.force == 0 and not self._physics.is_time_dependent

    def _missed_contact_parts(self, state: State) -> dict[str, float]:
        """The error budget of such a row."""
        return {"discretisation": self._shallowest_value(state, "force")}

    def _shallowest_value(self, state: State, name: str) -> float:
        """Value of the shallowest contact on the coarser mesh at this depth or deeper.

        It is an upper bound of a number that grows with the depth; NaN if there is none.
        """
        deeper_states = (
            coarse_state
            for coarse_state in self._coarse_states.values()
            if coarse_state.delta >= state.delta and coarse_state.force > 0
        )
        shallowest = min(deeper_states, key=lambda coarse_state: coarse_state.delta, default=None)
        return float(getattr(shallowest, name)) if shallowest else nan


class TheoryBars:
    """Error bars of a scene that theory solves: the stated error of the theory, for every number.

    Where the theoretical contact contains tension, contact radius and pressure are unknown.
    """

    coarser_run: CoarserRun | None = None

    def __init__(self, scene: Scene):
        assert scene.plan.theory is not None
        self.budgets: list[ErrorBudget] = []
        self._error = scene.plan.theory.error
        self._has_prescribed_forces = scene.physics.path.control == "force"
        self._contact_error = 1.0 if scene.plan.theory.tension_fraction else self._error

    def add_error_estimate(self, state: State) -> State:
        """Return the state with its error estimates."""
        force = self._error * abs(state.force)
        contact = self._contact_error
        self.budgets.append(ErrorBudget(state.step, theory=force))
        depth = self._error * abs(state.delta) if self._has_prescribed_forces else None
        estimated = replace(state, a_error=contact * state.a, p_max_error=contact * state.p_max)
        return replace(estimated, force_error=force, delta_error=depth)


AnyErrorBars = ErrorBars | TheoryBars


def _relative_change(old: float, new: float) -> float:
    """Absolute change relative to the larger of two lengths."""
    return abs(new - old) / (max(old, new) or 1.0)


def interpolate_force(state: State, delta: float, curve: StatesByStep) -> float:
    """Force of a curve at a depth near one of its states, F (delta/delta_state)^m.

    m is the slope dlnF/dlndelta there. At the depth of the state the force is exactly that of the
    state.

    Parameters
    ----------
    state
        The state near the depth.
    delta
        The depth [length].
    curve
        The states of the curve by step.
    """
    if state.delta == delta or state.delta <= 0 or delta <= 0:
        return state.force
    return float(state.force * (delta / state.delta) ** _log_slope(state, curve))


def _log_slope(state: State, curve: StatesByStep) -> float:
    """Slope dlnF/dlndelta between the neighbours of a state; 1.5, a paraboloid's, without any."""
    neighbours = [curve[k] for k in (state.step - 1, state.step, state.step + 1) if k in curve]
    first = min(neighbours, key=lambda s: s.delta)
    last = max(neighbours, key=lambda s: s.delta)
    if first.force <= 0 or first.delta <= 0 or last.delta <= first.delta:
        return 1.5
    return float(np.log(last.force / first.force) / np.log(last.delta / first.delta))
