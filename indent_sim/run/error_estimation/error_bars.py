"""Error estimates (half-widths of error bars) of the rows of a run, from a run on a coarser mesh.

Let f be a result with elements of size h, and f_q with elements of size q h. If the error falls
as h^r with the order of convergence r, Richardson extrapolation gives the error
|f_q - f|/(q^r - 1) of f. Roache's grid convergence index multiplies it by the factor of safety 3 if
only two meshes are known, since nothing then tests the assumed order. Two meshes may agree by
coincidence: the set of elements in contact changes from step to step, and the difference passes
through zero. Therefore every estimate has a lower bound, a fraction of the error that a mesh of
this resolution has in general.

F is the force, F_a the adhesive force (see `ErrorBars._jkr_adhesive_force`) and
F' = |F| + SAFETY_FACTOR F_a the force to which relative errors refer. n is the number of elements
in the contact radius of the row; for p_max under the rounded edge of a punch it is the number of
elements in the part of the contact on the arc. C is ERROR_CONSTANT, r is ORDER_OF_CONVERGENCE for
the force and PRESSURE_ORDER = 2 for p_max. `edge` is the relative error due to the sharp edge of a
punch or to a contact that ends where the slope of the tip jumps, and `corners` the relative error
due to bonded corners. The errors due to the mesh are

    force    max(SAFETY_FACTOR |F_q - F|/(q^r - 1), MIN_ERROR_FRACTION C n^-r F', edge F')
             + corners F'
    a        RADIUS_ERROR times the size of the element in which the contact ends
    p_max    max(SAFETY_FACTOR |p_q - p_max|/(q^r - 1), PEAK_ERROR n^-r p_max)

The estimate has eight empirical constants: the refinement ratio q, SAFETY_FACTOR,
ORDER_OF_CONVERGENCE, MIN_ERROR_FRACTION, RADIUS_ERROR, PRESSURE_ORDER, PEAK_ERROR, and EDGE_ERROR
of `scene.measured_constants` for `edge` in three dimensions. ERROR_CONSTANT is also used to choose
the mesh for a requested `accuracy`. Errors that do not depend on the mesh are added; each is
computed by an auxiliary run or known in advance, see `ErrorBudget`. The estimate for a force is at
least its distance from a theory that is exact for the body. `scripts/make_error_bar_table` measures
coverage and width of the error bars with and without each of these constants.

Roache, J. Fluids Eng. 116, 405 (1994); Annu. Rev. Fluid Mech. 29, 123 (1997), whose safety factors
are 3 for two grids and 1.25 for three; Verification and Validation in Computational Science and
Engineering (Hermosa, 1998).
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, nan, pi, sqrt
from typing import Any

import numpy as np

from indent_sim.model.algebra import tan
from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.model.tilted_tip import TiltedTip
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
from indent_sim.run.error_estimation.unloading_rows import (
    depth_without_force,
    unloading_force,
)
from indent_sim.scene.expected_error import FORCE_DEPTH_EXPONENT, edge_error
from indent_sim.scene.measured_constants import (
    EDGE_ERROR,
    ERROR_CONSTANT,
    MAX_YIELD_INCREMENT_ERROR,
    MOMENT_ERROR_RATIO,
    ORDER_OF_CONVERGENCE,
    RADIUS_ERROR,
)
from indent_sim.scene.resolution import error_decay
from indent_sim.scene.scene import Scene

# Lower bound of the error, relative to ERROR_CONSTANT n^-ORDER_OF_CONVERGENCE (see `resolution`).
MIN_ERROR_FRACTION = 0.2
PRESSURE_ORDER = 2.0  # order of convergence of p_max: that of the stresses of quadratic elements
PEAK_ERROR = 0.2  # lower bound of the error of p_max, relative to n^-PRESSURE_ORDER p_max


class ErrorBars:
    """Error estimates of rows by comparison with a run on a coarser mesh.

    If forces are prescribed, the error of the force is estimated at the depth of the row, and the
    error of the depth follows from it by the slope of the load curve.

    Parameters
    ----------
    scene
        The scene of the run.
    coarser_run
        The coarser run.
    half_penalty_states
        The coarser run with half the penalty stiffness; None without a penalty.
    step_refinement
        The coarser run with its increments and with halved increments; None if the result is
        independent of the increments.
    film_error
        Error due to thin drained boundary layers that the mesh does not resolve; None for a body
        without drainage.
    slow_bath_states
        The coarser run with twice the duration of the ramp that replaces a sudden change of the
        bath; None without such a ramp.
    """

    def __init__(
        self,
        scene: Scene,
        coarser_run: CoarserRun,
        half_penalty_states: States | None = None,
        step_refinement: StepRefinement | None = None,
        film_error: FilmError | None = None,
        slow_bath_states: States | None = None,
    ):
        self.budgets: list[ErrorBudget] = []
        self.coarser_run = coarser_run
        self._step_refinement = step_refinement
        self._film_error = film_error
        self._bath_states = None if slow_bath_states is None else states_by_step(slow_bath_states)
        self._coarse_states = coarser_run.states_by_step
        self._soft_states = (
            None if half_penalty_states is None else states_by_step(half_penalty_states)
        )
        self._run_states: StatesByStep = {}
        # Errors of the side force along a slide, by row [force]
        self._slide_force_errors: dict[int, float] = {}
        self._scene = scene
        self._physics = scene.physics
        self._sizes = scene.sizes
        self._scales = scene.physics.scales
        self._has_prescribed_forces = scene.physics.path.control == "force"
        # The error due to an artificial outer boundary is known in advance and stated in a warning.
        self._truncation = sum(
            warning.force_error
            for warning in scene.plan.model_warnings
            if warning.key == "truncation"
        )
        domain = scene.physics.domain
        contact_place = scene.physics.center, scene.sizes.a, scene.sizes.refinements or 0
        # An imported mesh approximates a curved surface by flat facets. They lie below it by the
        # sagitta, which reduces the depth, and the pressure is too large at the edges between them.
        self._sagitta = domain.facet_sagitta(*contact_place)
        ridge_excess = ridge_pressure(
            domain.facet_angle(*contact_place), scene.sizes.refinements or 0
        )
        self._ridge_pressure_error = (
            scene.physics.material.E_star * ridge_excess * self._scales.pressure
        )
        law = scene.physics.contact
        coarse_law = (coarser_run.scene or scene).physics.contact
        # The coarser run may be a previous refinement level with another penalty stiffness.
        self._stiffness_ratio = 1.0
        if isinstance(law, Penalty) and isinstance(coarse_law, Penalty):
            self._stiffness_ratio = law.stiffness / coarse_law.stiffness

    def add_error_estimate(self, state: State) -> State:
        """Return the state with its error estimates, NaN where the coarser run lacks the step."""
        self._run_states[state.step] = state
        force_parts = (
            self._missed_contact_parts(state)
            if self._is_contact_missed(state)
            else self._force_error_parts(state)
        )
        budget = ErrorBudget(state.step, theory=self._theory_distance(state), **force_parts)
        self.budgets.append(budget)
        errors: dict[str, Any] = {
            f"{name}_error": self._error_of_other_column(state, name)
            for name in self._other_columns(state)
        }
        if name := self._physics.slide_force_column:
            self._slide_force_errors[state.step] = errors.get(f"{name}_error", 0.0)
            if state.dissipation is not None:
                errors["dissipation_error"] += self._error_of_slide_dissipation(state)
        return replace(
            state,
            force_error=budget.total,
            delta_error=self._depth_error(state, budget.total),
            residual_depth_error=self._residual_depth_error(state),
            **errors,
            **self._moment_errors(state, budget.total),
        )

    # ---- force

    def _force_error_parts(self, state: State) -> dict[str, float]:
        """Return the parts of the error of the force [force], named as in `ErrorBudget`."""
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
        """Return the error of the force due to the mesh [force].

        Relative errors are multiplied by |F| + SAFETY_FACTOR F_a with the contact force F and the
        adhesive force F_a: the edge of an adhesive contact moves from element to element, so that
        both opposing parts of F have errors even if F = 0.
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
            + self._corner_error(state) * force
        )

    def _corner_error(self, state: State) -> float:
        """Return the relative error of the force due to the elements at corners.

        The corners of a soft tip change its part of the depth, the `tip_sink`.
        """
        tip_scene = self._scene.tip_scene
        if tip_scene is None or state.tip_sink is None or state.delta <= 0:
            return self._sizes.corner_error
        tip_share = state.tip_sink / state.delta
        body_error = self._sizes.corner_error * (1 - tip_share)
        return body_error + tip_scene.sizes.corner_error * tip_share

    def _jkr_adhesive_force(self, state: State) -> float:
        """Return the adhesive part of the contact force in the JKR limit [force], >= 0.

        The result is 0 without adhesion. A flat contact of radius a whose edge has the energy
        release rate K_I^2/(2 E*) = w carries the tensile force (8 pi w E* a^3)^(1/2), in plane
        strain (2 pi w E* a)^(1/2) per length. An adhesion with a finite range has a smaller force.
        The contact force is a compressive part minus this adhesive part.

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
        """Return the relative error of a contact that ends near a slope discontinuity of the tip.

        The error is 0 unless the contact ends within an element of the discontinuity. The computed
        contact is then narrower or wider than the exact contact, as at the edge of a sharp punch:
        the error is EDGE_ERROR times the ratio of element size and radius. Under profiles and
        rounded punches errors of 0.02 to 0.1 times this ratio were measured
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
        """Return the number of elements in the contact radius without refinement at its edge."""
        regular_sizes = replace(self._sizes, corners=(), punch_edge=None)
        return regular_sizes.elements_in_contact(state.a / self._scales.length)

    def _force_difference(self, step: int) -> float:
        """Return the difference of the forces on both meshes at the same depth.

        The result is NaN if the coarser run lacks the step.
        """
        run_states = self._run_states
        coarse_states = self._coarse_states
        if step not in run_states or step not in coarse_states:
            return nan
        state = run_states[step]
        coarse_state = coarse_states[step]
        # Rows of a time-dependent scene cannot be interpolated in the depth: each has another time.
        if self._physics.is_time_dependent:
            return self._transient_force_difference(state, coarse_state)
        unloading = self._physics.path.unloading
        if unloading and step > unloading.start and self._physics.searches_unloading_depths:
            coarse_force = unloading_force(coarse_states, unloading, state.delta)
            return abs(coarse_force - state.force)
        return abs(interpolate_force(coarse_state, state.delta, coarse_states) - state.force)

    def _transient_force_difference(self, state: State, coarse_state: State) -> float:
        """Return the difference of the forces on both meshes for a time-dependent row.

        Both forces refer to the same depth: a difference of the depths is corrected with the slope
        of the load curve. The errors due to drainage films are estimated separately, and both
        forces are corrected for them.
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
        """Return the relative error due to the penalty, assuming 1/F linear in 1/epsilon_n."""
        if self._soft_states is None:
            return 0.0
        stiff_state = self._coarse_states.get(step)
        soft_state = self._soft_states.get(step)
        if stiff_state is None or soft_state is None:
            return nan
        soft_force = interpolate_force(soft_state, stiff_state.delta, self._soft_states)
        if stiff_state.force == soft_force:
            return 0.0
        # The compliances of body and penalty are in series: 1/F is linear in 1/epsilon_n. With
        # F_soft at half the stiffness, extrapolation to infinite stiffness gives
        # F_stiff/F_rigid = 2 - F_stiff/F_soft.
        stiff_over_rigid = 2 - stiff_state.force / soft_force if soft_force else -1.0
        if stiff_over_rigid <= 0:
            return inf
        return abs(1 / stiff_over_rigid - 1) / self._stiffness_ratio

    def _geometry_error(self, state: State) -> float:
        """Return the relative error of the force due to domain truncation and to flat facets.

        Facets reduce the effective depth by their sagitta.
        """
        facet_error = (
            FORCE_DEPTH_EXPONENT * self._sagitta * self._scales.depth / state.delta
            if state.delta > 0
            else 0.0
        )
        return self._truncation + facet_error

    def _theory_distance(self, state: State) -> float:
        """Return |F - F_theory| [force]; 0 unless theory is exact for the body at this depth."""
        if self._scene.exact_theory is None or state.delta <= 0:
            return 0.0
        solution = self._scene.theory_solution(state.delta / self._scales.depth)
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _depth_error(self, state: State, error: float) -> float | None:
        """Return the error of a computed depth: force error divided by the load curve's slope.

        The result is None if depths are prescribed, and NaN (unknown) if the force does not
        increase with the depth.
        """
        if not self._has_prescribed_forces:
            return None
        slope = self._force_slope(state)
        if slope > 0:
            return error / slope
        return nan if error > 0 else 0.0

    def _force_slope(self, state: State) -> float:
        """Return the slope dF/ddelta at a row, from neighbouring rows of the coarser run.

        For a time-dependent body it is the slope at fixed time, estimated as the larger of the
        slopes of a paraboloid, F ~ delta^1.5, and of a flat punch on a half-space.
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

    # ---- moment of a tip that is tilted or slides

    def _moment_errors(self, state: State, force_error: float) -> dict[str, Any]:
        """Return the errors of moment and `x_contact` of a tip that is tilted or slides, else {}.

        The moment grows with a higher power of the contact radius than the force, so that its
        relative error is MOMENT_ERROR_RATIO times that of the force. It is at least the grid
        convergence index of the moment itself, and at least the effect of an error of the contact's
        ends. The moment of a tip that slides changes its sign and has the error of its largest
        value; it depends on the side force and therefore also has an error due to the load
        increments.
        """
        if state.moment is None or state.x_contact is None:
            return {}
        kind = "edge" if self._sizes.punch_edge is not None else "other"
        relative = force_error / abs(state.force) if state.force else nan
        difference = value_difference(self._coarse_states, self._run_states, state.step, "moment")
        if self._physics.is_time_dependent or self._has_prescribed_forces:
            # The rows of the two meshes then also differ in depth.
            difference = 0.0
        estimate = grid_convergence_index(difference, self.coarser_run.ratio, ORDER_OF_CONVERGENCE)
        L = self._scales.length
        end_element = self._sizes.surface_size(state.a / L) * L
        # If one end of the contact moves by its error, its middle moves by half of it.
        min_error = abs(state.force) * RADIUS_ERROR * end_element / 2
        moment = abs(state.moment)
        path_error = 0.0
        if self._physics.slides:
            moment = max(abs(row.moment or 0.0) for row in self._run_states.values())
            path_error = self._step_error(state, "moment")
        scaled = MOMENT_ERROR_RATIO[kind] * relative * moment
        error = float(np.max([scaled, estimate, min_error])) + path_error
        if state.delta <= 0:
            error = 0.0
        place_error = error / abs(state.force) if state.force else 0.0
        return {"moment_error": error, "x_contact_error": place_error}

    # ---- contact radius, pressure, stick radius, dissipation

    @property
    def _side_forces(self) -> tuple[str, ...]:
        """Columns of the side forces, which have error estimates if the tip slides."""
        physics = self._physics
        return tuple(f"side_force_{name}" for name in physics.side_force_axes if physics.slides)

    def _other_columns(self, state: State) -> list[str]:
        """Return the columns of the row that have error estimates, except the force."""
        columns = ("a", "p_max", "stick_radius", "dissipation", *self._side_forces)
        return [name for name in columns if getattr(state, name) is not None]

    def _error_of_other_column(self, state: State, name: str) -> float:
        """Return the error of a quantity other than the force."""
        if self._is_contact_missed(state):
            return self._value_at_next_deeper_row(state, name)
        value = abs(getattr(state, name))
        if name in self._side_forces and state.stick_radius == 0:
            # In full slip the side force is the coefficient of friction times the force, and the
            # force of the pressure on the slope of the tip.
            friction = float(self._physics.contact.friction)
            return (
                friction * self.budgets[-1].total
                + self._step_error(state, name)
                + self._slope_force_error(state, name)
            )
        contributions = [
            self._mesh_error_of_other_column(state, name),
            self._penalty_error_of_other_column(state.step, name),
            self._geometry_error(state) * value,
            self._step_error(state, name),
            self._bath_error(state, name),
            self._ridge_pressure_error if name == "p_max" and value > 0 else 0.0,
            self._oscillation_error(state) if name == "p_max" else 0.0,
        ]
        return sum(contributions)

    def _mesh_error_of_other_column(self, state: State, name: str) -> float:
        """Return the error of a quantity other than the force due to the mesh."""
        L = self._scales.length
        end_element = self._sizes.surface_size(state.a / L) * L if state.a > 0 else 0.0
        if name == "a":
            return RADIUS_ERROR * end_element
        value = abs(getattr(state, name))
        if name in self._side_forces:
            # A side force that changes its sign has the error of the largest side force.
            value = max(value, self._largest_side_force(state))
        min_error = RADIUS_ERROR * end_element / state.a * value if state.a > 0 else 0.0
        if name in self._side_forces:
            min_error = max(min_error, self._unbalanced_slope_force(state, end_element))
        if name == "p_max":
            # With contact closed by swelling, p_max occurs in the element that came into contact
            # last. Its position relative to the contact edge differs from mesh to mesh, so that
            # the difference of two meshes is no error estimate.
            if self._physics.is_closed_by_swelling(state.delta / self._scales.depth, state.a / L):
                return nan
            min_error = (
                PEAK_ERROR
                * self._element_size_over_peak_width(state, end_element) ** PRESSURE_ORDER
                * value
            )
        difference = value_difference(self._coarse_states, self._run_states, state.step, name)
        estimate = grid_convergence_index(difference, self.coarser_run.ratio, PRESSURE_ORDER)
        return float(np.max([estimate, min_error]))  # NaN if either of the two is NaN

    def _oscillation_error(self, state: State) -> float:
        """Return the error of p_max by the oscillation of the pressure between two meshed bodies.

        The nodes of one surface lie anywhere on the elements of the other one.
        """
        return state.roughness * state.p_max if self._scene.has_two_body_mesh else 0.0

    def _element_size_over_peak_width(self, state: State, end_element: float) -> float:
        """Return the element size at the contact edge divided by the width of the pressure peak.

        The width of the peak is the contact radius, or the part of the radius on the arc if the
        contact ends at a punch's rounded edge.

        Parameters
        ----------
        state
            The row [user's units].
        end_element
            Size of the element at the contact edge [length].
        """
        if state.a <= 0:
            return 0.0
        width = state.a
        if self._sizes.punch_edge is not None:
            width -= flat_radius(self._physics.indenter) * self._scales.length
        return end_element / max(width, min(end_element, state.a))

    def _penalty_error_of_other_column(self, step: int, name: str) -> float:
        """Return the error of a quantity due to the penalty, a power of 1/epsilon_n.

        The error is linear in 1/epsilon_n, except for the contact radius a under a surface tension
        gamma: the pressure of a penalty then ends within (gamma/epsilon_n)^(1/2) of the contact
        edge, which is the error of a.
        """
        if self._soft_states is None:
            return 0.0
        order = 0.5 if name == "a" and self._physics.surface_tension else 1.0
        difference = value_difference(self._coarse_states, self._soft_states, step, name)
        return difference / (2**order - 1) / self._stiffness_ratio**order

    def _residual_depth_error(self, state: State) -> float | None:
        """Return the error of the residual depth [length]; NaN in rows without it.

        None if the scene has no residual depth. The depth that the body recovers has at least the
        relative error that the mesh causes in the force.
        """
        unloading = self._physics.path.unloading
        if unloading is None or state.residual_depth is None:
            return None
        if state.residual_depth != state.residual_depth:
            return nan
        if not self._physics.yields:
            return 0.0
        coarse, own = (
            depth_without_force(states, unloading)
            for states in (self._coarse_states, self._run_states)
        )
        estimate = grid_convergence_index(
            abs(coarse - own), self.coarser_run.ratio, ORDER_OF_CONVERGENCE
        )
        top = self._run_states.get(unloading.start)
        if top is None or not top.force:
            return nan
        discretisation = self.budgets[unloading.start - 1].discretisation
        min_error = discretisation / top.force * (top.delta - state.residual_depth)
        path = self._step_refinement
        return float(np.max([estimate, min_error])) + (
            path.residual_depth_error(unloading) if path else 0.0
        )

    # ---- a tip that slides

    def _largest_side_force(self, state: State) -> float:
        """Return the largest side force that friction allows at a row [force].

        If the surface sticks it is the largest side force of all rows.
        """
        law = self._physics.contact
        if law.may_slip:
            return float(law.friction) * abs(state.force)
        name = self._physics.slide_force_column
        return max(abs(getattr(row, name) or 0.0) for row in self._run_states.values())

    def _unbalanced_slope_force(self, state: State, end_element: float) -> float:
        """Return the error of the side force due to an error of the contact's ends [force].

        If one end of the contact moves by its error, the middle of the contact moves by half of it.
        The force then acts where the slope of the tip equals the slope at the edge times the ratio
        of this displacement to the radius.
        """
        tip = self._physics.indenter
        if state.a <= 0:
            return 0.0
        slope = float(abs(tip.slope(state.a / self._scales.length)))
        if isinstance(tip, TiltedTip):
            slope += float(tan(tip.tilt))
        shift = RADIUS_ERROR * end_element / 2
        # Beyond the end of a tip its slope is infinite or not a number.
        return abs(state.force) * slope * shift / state.a if isfinite(slope) else 0.0

    def _slope_force_error(self, state: State, name: str) -> float:
        """Return the error of the force of the pressure on the slope of the tip [force]."""
        L = self._scales.length
        end_element = self._sizes.surface_size(state.a / L) * L if state.a > 0 else 0.0
        min_error = self._unbalanced_slope_force(state, end_element)
        difference = value_difference(self._coarse_states, self._run_states, state.step, name)
        estimate = grid_convergence_index(difference, self.coarser_run.ratio, PRESSURE_ORDER)
        return float(np.max([estimate, min_error]))

    def _error_of_slide_dissipation(self, state: State) -> float:
        """Return the error of the dissipation due to the error of the side force Q [energy].

        The elastic energy of the shear, Q^2/(2 k), is not dissipated. The error of this energy is
        (Q/k) times the error of Q at the beginning and the end of the row. k is the slope of the
        side force over the slide in the first row in which the tip slides.
        """
        name = self._physics.slide_force_column
        slides = (row for row in self._run_states.values() if row.x and getattr(row, name))
        first = min(slides, key=lambda row: row.step, default=None)
        if first is None or not self._physics.contact.may_slip:
            return 0.0
        compliance = abs(first.x / getattr(first, name))
        errors = (self._slide_force_errors.get(step, 0.0) for step in (state.step - 1, state.step))
        return float(compliance * abs(getattr(state, name)) * sum(errors))

    # ---- load increments and time steps

    def _step_error(self, state: State, name: str) -> float:
        """Return the error of a quantity due to the load increments or time steps.

        The error of a prescribed force is the error of the depth times the slope of the load curve.
        """
        if self._step_refinement is None:
            return 0.0
        if name == "force" and self._has_prescribed_forces:
            depth_error = self._step_refinement.error(state, "delta") * self._force_slope(state)
            return max(depth_error, self._first_increments_error(state))
        unresolved_error = (
            self._long_step_error(state, name) if self._physics.contact.may_slip else 0.0
        )
        refined_error = self._step_refinement.error(state, name) + unresolved_error
        if name == "force" and self._physics.yields:
            return max(refined_error, self._first_increments_error(state))
        return refined_error

    def _first_increments_error(self, state: State) -> float:
        """Return a lower bound of the force error [force] in the first rows of a body that yields.

        There the contact on the coarser mesh has too few elements to show the error of the
        increments. A plate has full contact from the first row on, and before yield there is no
        such error.
        """
        if self._physics.is_compressed or not state.plastic_dissipation:
            return 0.0
        previous = self._run_states.get(state.step - 1)
        turns = self._physics.path.turns
        is_divided = turns and turns[state.step - 1] and not self._physics.path.times
        previous_depth = previous.delta if previous else 0.0
        if is_divided:
            previous_depth = turns[state.step - 1][-1] * self._scales.depth
        increment = state.delta - previous_depth
        if increment <= 0 or state.delta <= 0:
            return 0.0
        fraction = min(increment / state.delta, 1.0)
        return MAX_YIELD_INCREMENT_ERROR * fraction * abs(state.force)

    def _bath_error(self, state: State, name: str) -> float:
        """Return the error of a quantity due to the finite duration of the bath ramp.

        After the ramp, the effect of the ramp is linear in its duration T: the change from T to 2 T
        is an estimate of the change from 0 to T. The error of a prescribed force is the error of
        the depth times the slope of the load curve.
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
        """Return the error of the stick radius or the dissipation due to a long increment.

        The error of other results is 0. Halving the increment may not show this error. With the
        relative change c of the contact radius in the increment, which is 1 from no contact, the
        relative error of the dissipation is c^2. The relative error of the stick radius is the
        larger one of c and the relative change of the stick radius; for a stick zone narrower than
        an element `_unresolved_stick` is added.
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
        """Return the error [length] of the radius of a stick zone that is narrower than an element.

        The error is half of the difference between the element size and the radius.
        """
        r = stick / self._scales.length
        return max(self._sizes.surface_size(r) - r, 0.0) / 2 * self._scales.length

    # ---- contact smaller than the distance of the integration points

    def _is_contact_missed(self, state: State) -> bool:
        """True if no integration point is in contact because the depth is so small.

        The result is False for a time-dependent body, and for a body that yields and was pressed
        deeper before, because the tip has then lost contact with the imprint.
        """
        has_imprint = self._physics.yields and any(
            row.force > 0 and row.delta > state.delta for row in self._run_states.values()
        )
        is_free = state.delta > 0 and state.force == 0
        return is_free and not self._physics.is_time_dependent and not has_imprint

    def _missed_contact_parts(self, state: State) -> dict[str, float]:
        """Return the parts of the error of the force [force] for a row whose contact was missed."""
        return {"discretisation": self._value_at_next_deeper_row(state, "force")}

    def _value_at_next_deeper_row(self, state: State, name: str) -> float:
        """Return the value of the coarser run's shallowest row that is at least as deep as `state`.

        Only rows in contact are considered. The value is an upper bound of a quantity that grows
        with the depth; it is NaN if there is no such row.
        """
        deeper_states = (
            coarse_state
            for coarse_state in self._coarse_states.values()
            if coarse_state.delta >= state.delta and coarse_state.force > 0
        )
        shallowest = min(deeper_states, key=lambda coarse_state: coarse_state.delta, default=None)
        return float(getattr(shallowest, name)) if shallowest else nan


class TheoryBars:
    """Error estimates of a scene that is solved by theory: the error of the theory itself.

    If the contact pressure of the theory is tensile somewhere, contact radius and pressure have an
    error of 100 %.
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
    """Return the absolute change of a length, relative to the larger of the two lengths."""
    return abs(new - old) / (max(old, new) or 1.0)


def interpolate_force(state: State, delta: float, curve: StatesByStep) -> float:
    """Return the force of a curve at a depth near one of its states, from a power law.

    The power law is F (delta/delta_state)^m, where m is the slope dlnF/dlndelta of the curve at the
    state. At the depth of the state, the result is exactly its force.

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
    """Return the slope dlnF/dlndelta between the neighbouring rows of a state; 1.5 if undefined.

    Rows between which the tip has slid are not on one curve of force and depth.
    """
    neighbours = [
        curve[k]
        for k in (state.step - 1, state.step, state.step + 1)
        if k in curve and curve[k].x == state.x
    ]
    first = min(neighbours, key=lambda s: s.delta)
    last = max(neighbours, key=lambda s: s.delta)
    if first.force <= 0 or first.delta <= 0 or last.delta <= first.delta:
        return 1.5
    return float(np.log(last.force / first.force) / np.log(last.delta / first.delta))
