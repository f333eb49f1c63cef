"""The equilibrium of a whole body at a depth, by the scene's contact method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.path.equilibrium import SolverStatistics, state_reactions
from indent_sim.fe.postprocessing import measurements
from indent_sim.fe.postprocessing.fields import WholeBody
from indent_sim.fe.problem import Problem, Snapshot
from indent_sim.fe.solve.contact_algorithms import contact_algorithm, dynamic_relaxation
from indent_sim.fe.solve.dof_numbering import DofNumbering
from indent_sim.fe.solve.extrapolation import lagrange_weights, predict_trial_pressure
from indent_sim.fe.solve.newton import Newton, approach_factors, finest_tolerance
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.scene_terms import BulkTerms, ContactTerms, bulk_terms, contact_terms
from indent_sim.fe.terms.term import Stage
from indent_sim.model.load_path import LoadPath
from indent_sim.model.tips import pass_through_depth

MOST_SEAL_UPDATES = 6  # of vertices under a tip that seals, in one stage
# Depths that are tried for the force of a stage between, and how near it is: rows do not tell then
# where they set out
MOST_STAGE_SOLVES = 8
STAGE_FORCE_TOLERANCE = 1e-9
# of the contact radius; the singular edge of a punch has J < 0 in 0.003 of it, which no force feels
LARGEST_INVERTED_FRACTION = 0.2


class BodyEquilibrium:
    """A problem on the whole mesh and the algorithm that solves it; see `path.Equilibrium`."""

    def __init__(self, body: Body):
        self.bulk_terms = bulk = bulk_terms(body)
        self.contact_terms = contact = contact_terms(body, bulk.strain_energies[0])
        self.problem = problem = Problem(body, [*bulk, *contact])
        self.observed_body = SolvedBody(body, bulk, contact)
        self.scene = scene = body.scene
        self.has_memory = problem.has_memory
        self.newton = Newton(problem)
        self._stage_count = 0  # found so far
        self._extrapolation_states: Sequence[
            Snapshot
        ] = ()  # states that lead on to what is solved next
        self._prescribed_force = (
            None if problem.law.may_snap_through else _force_over_time(scene.physics.path)
        )
        self._force_slope = 0.0  # of the force over depth, at the last stage between
        self._algorithm = self._sealing_algorithm(contact_algorithm(self.newton, contact))
        self.snapshot = problem.snapshot
        self.restore = problem.restore
        self._contact_radius = scene.plan.prediction["a"] / scene.physics.scales.length
        self._largest_inverted_size = LARGEST_INVERTED_FRACTION * self._contact_radius
        self._deepest_penetration = pass_through_depth(scene.physics.indenter)
        if (
            problem.law.multiplier == "stress"
        ):  # other zeros of Nitsche's residual lie about an element deep in the tip
            self._deepest_penetration = min(self._deepest_penetration, scene.sizes.h_contact / 2)

    @property
    def statistics(self) -> SolverStatistics:
        """What was solved so far; no iterations of linear solves where systems are factored."""
        seal = self.bulk_terms.seal
        seal_changes = seal.tangent_version if seal else 0
        return SolverStatistics(
            self.newton.iterations, self.newton.krylov_iterations, self._stage_count, seal_changes
        )

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self.newton.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.problem.force()

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent (collective)."""
        return self.newton.stiffness()

    def tighten_tolerance(self) -> float:
        """Converge as far as round-off lets, and say how well a force can be met then, relative.
        The vertices that the tip seals stand still from here on, until `is_settled` is asked:
        with them the force would jump.
        """
        if self.bulk_terms.seal:
            self.bulk_terms.seal.freeze()
        self.newton.rtol = min(self.newton.rtol, finest_tolerance(self.problem))
        return 10 * finest_tolerance(self.problem)

    def is_seal_consistent(self) -> bool:
        """Whether the tip seals the surface where it touches it; else it does from here on."""
        seal = self.bulk_terms.seal
        return seal is None or not seal.update_contact(
            measurements.touching_corners(self.observed_body)
        )

    def accept(self) -> float:
        """Take the present equilibrium as the one that the next step sets out from; what was lost
        in this [energy].
        """
        dissipation = self.problem.dissipation()
        self.problem.accept()
        self.newton.accept()
        return dissipation

    def solve(self, depth: float, dt: float = 0.0) -> bool:
        """True when converged to a state that a body can have, in every stage; else the unknowns
        are as they were.
        """
        start_depth = self.problem.body.accepted_depth
        state_before = self.problem.trial_state()
        earlier_states = self._extrapolation_states
        self._extrapolation_states = ()
        for stage in self.problem.stages(dt):
            is_last = stage.end_fraction == 1.0
            if earlier_states and dt:
                self._set_extrapolated_state(
                    start_depth + stage.end_fraction * (depth - start_depth), earlier_states
                )
            self.problem.begin_stage(stage)
            if not (
                self._find_equilibrium(depth, self._algorithm)
                if is_last
                else self._solve_stage(start_depth, depth, stage.end_fraction)
            ):
                self.problem.set_trial_state(state_before)
                return False
            self.problem.end_stage(stage)
            self._stage_count += 1
        return True

    def _solve_stage(self, start_depth: float, depth: float, fraction: float) -> bool:
        """True when found before the end of a step, at the share of it: where the depth is straight
        in time, or where forces are prescribed, the force. A depth that goes with the root of
        time, as after a sudden force, is not.
        """
        delta = start_depth + fraction * (depth - start_depth)
        earlier_tries = list[tuple[float, float]]()
        target_force = (
            self._prescribed_force(float(self.problem.body.now.t.value))
            if self._prescribed_force
            else 0.0
        )
        if not self._find_equilibrium(delta, self._algorithm):
            return False
        if target_force <= 0:
            return True
        for _ in range(MOST_STAGE_SOLVES):
            missing_force = target_force - self.force
            if abs(missing_force) <= STAGE_FORCE_TOLERANCE * target_force:
                return True
            earlier_tries = [*earlier_tries[-1:], (missing_force, delta)]
            if (
                len(earlier_tries) > 1
                and (
                    force_slope := (earlier_tries[0][0] - missing_force)
                    / (delta - earlier_tries[0][1])
                )
                > 0
            ):
                self._force_slope = force_slope
            force_slope = (
                self._force_slope or 2 * self.scene.physics.material.E_star * self._contact_radius
            )
            delta += missing_force / force_slope
            if not self._find_equilibrium(delta, self._algorithm):
                break
        return self._find_equilibrium(
            start_depth + fraction * (depth - start_depth), self._algorithm
        )

    def _sealing_algorithm(self, algorithm: Callable[[], bool]) -> Callable[[], bool]:
        """The algorithm with the surface sealed where that very equilibrium touches the tip: found,
        looked at, found again, until nothing changes.
        """
        seal = self.bulk_terms.seal
        if seal is None:
            return algorithm

        def find() -> bool:
            for _ in range(0 if seal.is_frozen else MOST_SEAL_UPDATES - 1):
                if not algorithm():
                    return False
                if self.is_seal_consistent():
                    return True
            return algorithm()

        return find

    def relax_to_stable_state(self, depth: float, dt: float = 0.0) -> bool:
        """True when found where the body comes to rest at a depth, let go of in the present state,
        and then what `dt` makes of that; else as `solve`. A snap takes no time.
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
        """Let the contact be as stiff as what the tip touches is at a depth, at this moment."""
        strain_energy = self.bulk_terms.strain_energies[0]
        strain_energy.predict_modulus(self.problem.body.accepted_depth, depth)
        self.problem.follow_modulus(strain_energy.E_star / self.scene.physics.material.E_star)

    def _impossibility(self) -> str:
        if not self.problem.is_admissible():
            return "Newton ends in a state with J <= 0, or beyond the law's limit"
        if self.problem.law.may_snap_through and not self.newton.is_stable:
            return "Newton ends in a state that is not stable"
        if self.scene.physics.gap == "reference":
            return ""
        if measurements.penetration(self.observed_body) > self._deepest_penetration:
            return "Newton ends where the tip has passed through the surface"
        if (
            self.scene.physics.small_strain
            and self.observed_body.inverted_size() > self._largest_inverted_size
        ):
            return (
                "the linear body turns inside out (J < 0), and only a hyperelastic one has a "
                "deformed surface then"
            )
        return ""

    @cached_property
    def _numberings(self) -> list[list[DofNumbering]]:
        """For each array of a state the numbering of each of its fields: the unknowns, what is
        frozen, the history.
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
        """Whether the modulus of what the tip touches changes with time."""
        return self.scene.physics.domain.regions[0].relaxation_series is not None

    def pack(self, state: Snapshot) -> list[np.ndarray]:
        """A state as arrays on rank 0, for a checkpoint, in an order that does not know the ranks
        (collective).
        """
        arrays = [*(vector.array_r for vector in state.unknowns), *state.history]
        pairs = zip(arrays, self._numberings, strict=True)
        packed = [field.gather(values) for values, fields in pairs for field in fields]
        return [*packed, np.array([state.modulus_ratio])] if self._has_relaxation else packed

    def unpack(self, depth: float, arrays: Sequence[np.ndarray], t: float = 0.0) -> Snapshot | None:
        """The state of packed arrays, which all ranks have (collective); None when they are none of
        this problem.
        """
        state = replace(self.snapshot(), depth=depth, t=t)
        numbering = self._numberings
        shapes: list[tuple[int, ...]] = [field.shape for fields in numbering for field in fields]
        shapes += [(1,)] if self._has_relaxation else []
        if [np.shape(values) for values in arrays] != shapes:
            return None
        if self._has_relaxation:
            *arrays, modulus_ratio = arrays
            state = replace(state, modulus_ratio=float(modulus_ratio[0]))
        remaining_arrays = iter(arrays)
        for values, fields in zip(
            [*(v.array for v in state.unknowns), *state.history], numbering, strict=True
        ):
            for field in fields:
                field.scatter(next(remaining_arrays), values)
        return state

    def extrapolate(self, depth: float, earlier: Sequence[Snapshot]) -> None:
        """Take the unknowns that earlier states lead to expect at a depth as the present ones; in
        the next `solve` at the depth of each of its stages.
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
        if (
            trial_pressure is not None
        ):  # the multiplier changes where the guess is in contact and this is not, or the reverse
            assert isinstance(self.contact_terms.pressure, Traction)
            (lam, gap) = self._nodal_contact()
            stiffness = stiffness_scale(self.scene)
            is_consistent = (lam > stiffness * gap) == (trial_pressure > 0)
            self.contact_terms.pressure.surface_multiplier.set_nodal_values(
                np.where(is_consistent, lam, trial_pressure + stiffness * gap)
            )

    @cached_property
    def _can_predict_contact(self) -> bool:
        """Whether lam can say what is in contact next: not by another stiffness, nor with
        attraction in the gap.
        """
        law = self.scene.physics.contact
        return (
            law.multiplier == "unknown"
            and not law.may_snap_through
            and not approach_factors(law, self.scene)
        )

    def _predicted_trial_pressure(self, earlier: Sequence[Snapshot], depth: float) -> np.ndarray:
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
        """lam [pressure] and gap [length] at the nodes of the contact surface's facets (facets,
        nodes).
        """
        points = self.observed_body.trace.node_points()
        return self.contact_terms.pressure.multiplier_at(points), measurements.gap(
            self.observed_body, points
        )

    def state_values(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
        energy = (
            nan if self.scene.physics.relaxing_regions else self.problem.energy()
        )  # what relaxes has stored none
        values: dict[str, Any] = {"force": self.force, "energy": energy}
        support_reactions, values["stray_reaction"] = self.problem.reactions()
        values |= state_reactions(self.scene.physics.domain, support_reactions)
        for name, axis in self.scene.physics.side_force_axes.items():
            values[f"side_force_{name}"] = self.problem.side_force(axis)
        body = self.problem.body
        values["intrusion"] = measurements.penetration_outside_contact_surface(
            self.observed_body, body.noncontact_trace, body.local_array()
        )
        values |= self._fluid_values()
        return values | measurements.contact_values(self.observed_body)

    def _fluid_values(self) -> dict[str, Any]:
        """What has left the whole body or moved in it, what is neither there nor gone, and the
        largest pressure; of a sudden step what its drained faces are about to lose.
        """
        flow = self.bulk_terms.flow
        seal = self.bulk_terms.seal
        comm = self.problem.comm
        if flow is None or seal is None:
            return {}
        content = flow.vertex_content_values()
        local_sums = (seal.total_outflow(), content.sum(), np.abs(content).sum())
        outflow, content_change, moved = (
            self.problem.sum_over_body(float(mine)) for mine in local_sums
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


class SolvedBody(WholeBody):
    """The whole body at the present solution, for measurements, the surface table and the fields."""

    def __init__(self, body: Body, bulk: BulkTerms, contact: ContactTerms):
        super().__init__(body, bulk.strain_energies, contact.friction, bulk.flow)
        self.multiplier_at = contact.pressure.multiplier_at
        self.pressure_at = contact.pressure.pressure_at
        self._delta = body.now.delta

    @property
    def depth(self) -> float:
        """delta [length]."""
        return float(self._delta.value)

    def inverted_size(self) -> float:
        """Size [length] of the region in which J < 0 (collective)."""
        return max(strain.inverted_size() for strain in self.strain_energies)


def _force_over_time(path: LoadPath) -> Callable[[float], float] | None:
    """The force that is asked for [force] at a time since the path's begin; None of a path that
    asks for none.
    """
    if path.control == "depth" or path.start_time is None:
        return None
    forces, times = zip(
        *(place for step in range(1, len(path.values) + 1) for place in path.segment(step)),
        strict=True,
    )
    return lambda t: float(np.interp(t, times, forces))
