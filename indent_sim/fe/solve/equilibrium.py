"""Equilibrium of a body on its whole mesh at a depth, by the scene's contact method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.path.equilibrium import lateral_imbalance, moment_values, state_reactions
from indent_sim.fe.path.load_control import ForceDepth, LoadControl
from indent_sim.fe.path.solver_statistics import SolverStatistics
from indent_sim.fe.postprocessing import contact_sample, measurements, penetration
from indent_sim.fe.problem import Problem, Snapshot
from indent_sim.fe.solve.contact_algorithms import contact_algorithm
from indent_sim.fe.solve.dof_numbering import DofNumbering
from indent_sim.fe.solve.dynamic_relaxation import dynamic_relaxation
from indent_sim.fe.solve.extrapolation import lagrange_weights, predict_trial_pressure
from indent_sim.fe.solve.newton import Newton, finest_tolerance
from indent_sim.fe.solve.solved_body import SolvedBody
from indent_sim.fe.solve.stiffness_continuation import approach_factors
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.fe.terms.contact.soft_tip_contact import SoftTipContact
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.scene_terms import bulk_terms, contact_terms
from indent_sim.fe.terms.time_integration import Stage
from indent_sim.mesh.two_bodies import TIP_PREFIX
from indent_sim.model.load_path import LoadPath
from indent_sim.model.tips import pass_through_depth


class BodyEquilibrium:
    """Problem on the whole mesh with its solution algorithm; implements `path.Equilibrium`."""

    def __init__(self, body: Body):
        self.bulk_terms = bulk = bulk_terms(body)
        self.contact_terms = contact = contact_terms(body, bulk.strain_energies[0])
        self.problem = problem = Problem(body, [*bulk, *contact])
        self.observed_body = SolvedBody(body, bulk, contact)
        self.scene = scene = body.scene
        self.has_memory = problem.has_memory
        self.newton = Newton(problem)
        self._stage_count = 0  # equilibria found, stages of time steps included
        # Earlier states from which the next solution is extrapolated
        self._extrapolation_states: Sequence[Snapshot] = ()
        self._prescribed_force = (
            None if problem.law.may_snap_through else _force_over_time(scene.physics.path)
        )
        self._algorithm = self._sealing_algorithm(contact_algorithm(self.newton, contact))
        self.snapshot = problem.snapshot
        self.restore = problem.restore
        self._contact_radius = scene.plan.prediction["a"] / scene.physics.scales.length
        # Finds the depth of a prescribed force at an intermediate stage. With this tolerance a row
        # is independent of the depth at which its increment started.
        self._stage_control = LoadControl(self._force_at_depth, scene.physics.body.height)
        self._stage_control.tolerance = 1e-9
        # The singular edge of a punch makes J < 0 in 0.003 of the contact radius, without any
        # effect on the force.
        self._largest_inverted_size = 0.2 * self._contact_radius
        self._deepest_penetration = pass_through_depth(scene.physics.indenter)
        if problem.law.multiplier == "stress":
            # Nitsche's residual has other zeros with the surface about one element inside the tip
            self._deepest_penetration = min(self._deepest_penetration, scene.sizes.h_contact / 2)

    @property
    def statistics(self) -> SolverStatistics:
        """Solver statistics since the beginning."""
        seal = self.bulk_terms.seal
        seal_changes = seal.tangent_version if seal else 0
        return SolverStatistics(
            self.newton.iterations, self.newton.krylov_iterations, self._stage_count, seal_changes
        )

    @property
    def failure(self) -> str:
        """Reason why the last solve did not converge."""
        return self.newton.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.problem.force()

    @property
    def stiffness(self) -> float:
        """Stiffness dF/ddelta of the whole body at the equilibrium [force/length] (collective).

        For a body that yields it is the stiffness at the beginning of unloading, and the
        equilibrium must have been accepted.
        """
        if not self.scene.physics.yields:
            return self.newton.stiffness()
        self.problem.hold_plastic_flow(is_held=True)
        self.newton.discard_tangent()
        try:
            return self.newton.stiffness()
        finally:
            self.problem.hold_plastic_flow(is_held=False)
            self.newton.discard_tangent()

    def tighten_tolerance(self) -> float:
        """Tighten the tolerance to round-off; return the resulting relative error of a force.

        The contact seal is frozen until `is_seal_consistent` is called, because the force is
        discontinuous where the seal changes.
        """
        if self.bulk_terms.seal:
            self.bulk_terms.seal.freeze()
        self.newton.rtol = min(self.newton.rtol, finest_tolerance(self.problem))
        return 10 * finest_tolerance(self.problem)

    def is_seal_consistent(self) -> bool:
        """Return whether the contact seal agrees with the contact; if not, update the seal."""
        seal = self.bulk_terms.seal
        return seal is None or not seal.update_contact(
            contact_sample.touching_corners(self.observed_body)
        )

    def accept(self) -> float:
        """Accept the present equilibrium; return the energy dissipated in the increment."""
        dissipation = self.problem.dissipation()
        self.problem.accept()
        self.newton.accept()
        return dissipation

    def solve(self, depth: float, dt: float = 0.0, slide: float = 0.0) -> bool:
        """Solve for the equilibrium at a depth after a time step `dt`, stage by stage.

        Parameters
        ----------
        depth
            Indentation depth [length].
        dt
            Time since the last accepted equilibrium [time].
        slide
            Horizontal displacement of the tip [length].

        Returns
        -------
        bool
            True if every stage converged to an admissible state; otherwise the unknowns are
            restored.
        """
        start_depth = self.problem.body.accepted_depth
        state_before = self.problem.trial_state()
        earlier_states = self._extrapolation_states
        self._extrapolation_states = ()
        start_slide = self.problem.body.accepted_slide
        for stage in self.problem.stages(dt):
            is_last = stage.end_fraction == 1.0
            stage_slide = start_slide + stage.end_fraction * (slide - start_slide)
            self.problem.body.slide_tip(slide if is_last else stage_slide)
            if earlier_states and dt:
                self._set_extrapolated_state(
                    start_depth + stage.end_fraction * (depth - start_depth), earlier_states
                )
            self.problem.begin_stage(stage)
            if is_last:
                has_converged = self._find_equilibrium(depth, self._algorithm)
            else:
                has_converged = self._solve_stage(start_depth, depth, stage.end_fraction)
            if not has_converged:
                self.problem.set_trial_state(state_before)
                return False
            self.problem.end_stage(stage)
            self._stage_count += 1
        return True

    def _solve_stage(self, start_depth: float, depth: float, fraction: float) -> bool:
        """Solve an intermediate stage of a time step, which ends at a fraction of the step.

        The depth is linear in time within the step. If forces are prescribed, the stage is solved
        by the secant method for the force at its time, because after a sudden change of the force
        the depth changes as the square root of time. If the secant method fails, the linear depth
        is used.
        """
        linear_depth = start_depth + fraction * (depth - start_depth)
        target_force = (
            self._prescribed_force(float(self.problem.body.now.t.value))
            if self._prescribed_force
            else 0.0
        )
        if target_force > 0 and self._stage_control.find_by_secant(
            target_force,
            linear_depth,
            2 * self.scene.physics.material.E_star * self._contact_radius,
        ):
            return True
        return self._find_equilibrium(linear_depth, self._algorithm)

    def _force_at_depth(self, depth: float) -> ForceDepth:
        """Solve at a depth; return force and depth, with the depth NaN on failure."""
        if not self._find_equilibrium(depth, self._algorithm):
            return nan, nan
        return self.force, depth

    def _sealing_algorithm(self, algorithm: Callable[[], bool]) -> Callable[[], bool]:
        """Return an algorithm that repeats solution and seal update until the seal is unchanged."""
        seal = self.bulk_terms.seal
        if seal is None:
            return algorithm

        def solve() -> bool:
            # The seal stays as it is after five updates.
            for _ in range(0 if seal.is_frozen else 5):
                if not algorithm():
                    return False
                if self.is_seal_consistent():
                    return True
            return algorithm()

        return solve

    def relax_to_stable_state(self, depth: float, dt: float = 0.0) -> bool:
        """Find the stable state at a depth by dynamic relaxation, then make a time step `dt`.

        The snap itself takes no time. Parameters and return value are the same as for `solve`.
        """
        regularization = self.contact_terms.regularization
        instant = Stage(0.0)
        assert regularization
        self.problem.begin_stage(instant)
        if not self._find_equilibrium(
            depth, lambda: dynamic_relaxation(self.newton, regularization)
        ):
            return False
        self.problem.end_stage(instant)
        return dt == 0 or self.solve(depth, dt)

    def _find_equilibrium(self, depth: float, algorithm: Callable[[], bool]) -> bool:
        """Solve at a depth; return False if there is no solution or it is not admissible."""
        state_before = self.problem.trial_state()
        self.problem.delta.value = depth
        self._update_contact_stiffness(depth)
        if not algorithm():
            return False
        if impossibility := self._impossibility():
            self.newton.failure = impossibility
            self.problem.set_trial_state(state_before)
        return not impossibility

    def _update_contact_stiffness(self, depth: float) -> None:
        """Scale the contact stiffness by the present modulus of the material under the tip."""
        strain_energy = self.bulk_terms.strain_energies[0]
        strain_energy.predict_modulus(self.problem.body.accepted_depth, depth)
        self.problem.scale_contact_stiffness(
            strain_energy.E_star / self.scene.physics.material.E_star
        )

    def _impossibility(self) -> str:
        """Return the reason why a converged solution is rejected; "" if it is admissible."""
        if not self.problem.is_admissible():
            return "Newton's method converged to J <= 0 or beyond the limit of the elastic law"
        if self.problem.law.may_snap_through and not self.newton.is_stable:
            return "Newton's method converged to an unstable equilibrium"
        if self.scene.physics.gap == "reference":
            return ""
        if isinstance(self.contact_terms.pressure, SoftTipContact) and (
            reason := self.contact_terms.pressure.impossibility()
        ):
            return reason
        if penetration.penetration(self.observed_body) > self._deepest_penetration:
            return "Newton's method converged with the tip inside the body"
        if (
            self.scene.physics.small_strain
            and self.observed_body.inverted_size() > self._largest_inverted_size
        ):
            return (
                "elements of the linear elastic body are inverted (J < 0): contact on its deformed "
                "surface needs a hyperelastic material"
            )
        return ""

    @cached_property
    def _numberings(self) -> list[list[DofNumbering]]:
        """Dof numberings of the fields that each array of a state contains.

        The arrays are the unknowns, the functions `frozen` of the problem and the internal
        variables, in this order.
        """
        unknowns = self.problem.unknowns
        problem = self.problem
        unknown_numberings = [
            DofNumbering(unknowns.collapsed_space(name), unknowns.dofs(name))
            for name in unknowns.names
        ]
        other_functions = [*problem.frozen, *problem.histories]
        return [
            unknown_numberings,
            *([DofNumbering(f.function_space, np.arange(len(f.x.array)))] for f in other_functions),
        ]

    @property
    def _has_relaxation(self) -> bool:
        """True if the modulus of the material under the tip changes with time."""
        return self.scene.physics.domain.regions[0].relaxation_series is not None

    def pack(self, state: Snapshot) -> list[np.ndarray]:
        """Return a state as arrays on rank 0, independent of the number of ranks (collective)."""
        arrays = [*(vector.array_r for vector in state.unknowns), *state.history]
        pairs = zip(arrays, self._numberings, strict=True)
        packed = [field.gather(values) for values, fields in pairs for field in fields]
        if self._has_relaxation:
            packed.append(np.array([state.modulus_ratio]))
        if self.scene.physics.slides:
            packed.append(np.array([state.slide]))
        return packed

    def unpack(self, depth: float, arrays: Sequence[np.ndarray], t: float = 0.0) -> Snapshot | None:
        """Return the state stored in packed arrays, which all ranks must pass (collective).

        The result is None if the shapes of the arrays do not fit this problem.
        """
        state = replace(self.snapshot(), depth=depth, t=t)
        numbering = self._numberings
        shapes: list[tuple[int, ...]] = [field.shape for fields in numbering for field in fields]
        slides = self.scene.physics.slides
        shapes += [(1,)] * (self._has_relaxation + slides)
        if [np.shape(values) for values in arrays] != shapes:
            return None
        if slides:
            *arrays, slide = arrays
            state = replace(state, slide=float(slide[0]))
        if self._has_relaxation:
            *arrays, modulus_ratio = arrays
            state = replace(state, modulus_ratio=float(modulus_ratio[0]))
        remaining_arrays = iter(arrays)
        for values, fields in zip(
            [*(vector.array for vector in state.unknowns), *state.history], numbering, strict=True
        ):
            for field in fields:
                field.scatter(next(remaining_arrays), values)
        return state

    def extrapolate(self, depth: float, earlier: Sequence[Snapshot]) -> None:
        """Set the unknowns to an extrapolation of earlier states to the given depth.

        If time passes, the next `solve` extrapolates to the depth of each of its stages.
        """
        self._extrapolation_states = earlier
        self._set_extrapolated_state(depth, earlier)

    def _set_extrapolated_state(self, depth: float, earlier: Sequence[Snapshot]) -> None:
        depths = [state.depth for state in earlier]
        trial_pressure = (
            self._predicted_trial_pressure(earlier[-2:], depth)
            if self._can_predict_contact
            else None
        )
        trial_state = [vector.duplicate() for vector in earlier[-1].unknowns]
        for k, vector in enumerate(trial_state):
            vector.set(0.0)
            vector.maxpy(lagrange_weights(depths, depth), [state.unknowns[k] for state in earlier])
        self.problem.delta.value = depth
        self.problem.set_trial_state(trial_state)
        if trial_pressure is not None:
            # The multiplier is corrected where extrapolated fields and extrapolated trial pressure
            # disagree about contact
            assert isinstance(self.contact_terms.pressure, Traction | SoftTipContact)
            lam, gap = self._nodal_contact()
            stiffness = stiffness_scale(self.scene)
            is_consistent = (lam > stiffness * gap) == (trial_pressure > 0)
            self.contact_terms.pressure.surface_multiplier.set_nodal_values(
                np.where(is_consistent, lam, trial_pressure + stiffness * gap)
            )

    @cached_property
    def _can_predict_contact(self) -> bool:
        """True if the active set of the next equilibrium can be predicted from the multiplier.

        This is not possible with stiffness continuation or with adhesion.
        """
        law = self.scene.physics.contact
        return (
            law.multiplier == "unknown"
            and not law.may_snap_through
            and not approach_factors(law, self.scene)
        )

    def _predicted_trial_pressure(self, earlier: Sequence[Snapshot], depth: float) -> np.ndarray:
        """Extrapolate the trial pressure lam - epsilon_n g [pressure] of two states to a depth."""
        trials = []
        for state in earlier:
            self.problem.delta.value = state.depth
            self.problem.set_trial_state(state.unknowns)
            lam, gap = self._nodal_contact()
            trials.append(lam - stiffness_scale(self.scene) * gap)
        largest = self.problem.comm.allreduce(
            max(trial.max(initial=0.0) for trial in trials), op=MPI.MAX
        )
        return predict_trial_pressure(trials, [state.depth for state in earlier], depth, largest)

    def _nodal_contact(self) -> tuple[np.ndarray, np.ndarray]:
        """Multiplier [pressure] and gap [length] at the nodes of the contact facets.

        Both have the shape (facets, nodes).
        """
        points = self.observed_body.trace.node_points()
        return self.contact_terms.pressure.multiplier_at(points), contact_sample.gap(
            self.observed_body, points
        )

    @property
    def reaction_norm(self) -> float:
        """Euclidean norm of the nodal support reactions at the present equilibrium [force].

        The norm of the model domain is multiplied by the symmetry factor.
        """
        return self.scene.physics.domain.symmetry_factor * self.newton.reaction_norm

    def state_values(self) -> dict[str, Any]:
        """Return force, contact, energy and reactions of the present equilibrium."""
        # A relaxing material dissipates, so that no stored energy belongs to its state
        energy = nan if self.scene.physics.relaxing_regions else self.problem.energy()
        values: dict[str, Any] = {"force": self.force, "energy": energy}
        support_reactions, values["stray_reaction"] = self.problem.reactions()
        if isinstance(self.contact_terms.pressure, SoftTipContact):
            values |= self._soft_tip_values()
            support_reactions = {
                support: force
                for support, force in support_reactions.items()
                if not support[0].startswith(TIP_PREFIX)
            }
        values |= state_reactions(self.scene.physics.domain, support_reactions)
        values |= lateral_imbalance(self.scene, support_reactions, self._push_along_slide())
        for name, axis in self.scene.physics.side_force_axes.items():
            values[f"side_force_{name}"] = self.problem.side_force(axis)
        if self.scene.physics.yields:
            values["plastic_dissipation"] = self.problem.plastic_dissipation()
        if self.scene.physics.has_moment:
            values |= moment_values(self.problem.moment(), values["force"])
        body = self.problem.body
        values["intrusion"] = penetration.penetration_outside_contact_surface(
            self.observed_body, body.noncontact_trace, body.local_array()
        )
        values |= self._fluid_values()
        values |= measurements.contact_values(self.observed_body, values["force"])
        if self.scene.physics.is_swelling and values["a"] == 0:
            values["clearance"] = contact_sample.smallest_gap(self.observed_body)
        return values

    def _soft_tip_values(self) -> dict[str, float]:
        """Return the displacement and the energy of a soft tip, keyed by the fields of `State`."""
        return {
            "tip_sink": float(self.observed_body.tip_displacement(np.zeros(1))[0]),
            "tip_energy": self.problem.sum_over_body(self.bulk_terms.strain_energies[-1].value()),
        }

    def _push_along_slide(self) -> float:
        """Horizontal force of the body on the tip along its slide [force]; 0 without a slide.

        With a reference gap it is the force of friction alone, because the pressure on the body is
        vertical.
        """
        physics = self.scene.physics
        if not physics.slides:
            return 0.0
        axis = physics.track.axis
        if physics.gap == "current":
            return self.problem.side_force(axis)
        friction = self.contact_terms.friction
        return self.problem.sum_over_body(friction.side_force(axis)) if friction else 0.0

    def _fluid_values(self) -> dict[str, Any]:
        """Return the results for the pore fluid, keyed by the fields of `State`; {} without flow.

        These are the volume that has left the whole body, the volume that has moved inside it, the
        error of the fluid balance and the largest pore pressure; after a step without duration, the
        table of the drained surface is added.
        """
        flow = self.bulk_terms.flow
        seal = self.bulk_terms.seal
        comm = self.problem.comm
        if flow is None or seal is None:
            return {}
        content = flow.vertex_content_values()
        local_sums = (seal.total_outflow(), content.sum(), np.abs(content).sum())
        outflow, content_change, moved = (
            self.problem.sum_over_body(float(local_sum)) for local_sum in local_sums
        )
        largest = comm.allreduce(flow.largest_pressure(), op=MPI.MAX)
        values = {
            "outflow": outflow,
            "moved": moved,
            "unbalanced": abs(outflow + content_change),
            "pore_pressure_max": largest,
        }
        is_sudden = float(self.problem.body.dt.value) == 0
        return values | ({"drained": seal.drained_surface_table()} if is_sudden else {})


def _force_over_time(path: LoadPath) -> Callable[[float], float] | None:
    """Return the prescribed force [force] as a function of time; None for prescribed depths."""
    if path.control == "depth" or path.start_time is None:
        return None
    forces, times = zip(
        *(point for step in range(1, len(path.values) + 1) for point in path.segment(step)),
        strict=True,
    )
    return lambda t: float(np.interp(t, times, forces))
