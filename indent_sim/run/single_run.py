"""Solution of one scene on one mesh: every state is on disk before the next one is computed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fe.dolfinx_loading import load_dolfinx
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import PullOff, State
from indent_sim.process.errors import (
    BackendError,
    NotConverged,
    SolverMissing,
    VerificationError,
)
from indent_sim.process.installation import installed_solver_packages, missing_solver_text
from indent_sim.process.ranks import run_on_root
from indent_sim.process.signals import defer_signals
from indent_sim.process.usage import Clock
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.tip_geometry import TipGeometry, plot_width, tip_mesh
from indent_sim.run.error_estimation.error_bars import AnyErrorBars
from indent_sim.run.explicit_config import written_fields
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.run_output import RunOutput
from indent_sim.run.sanity_checks import violated_bound
from indent_sim.run.solvers.load_path import RowSolver, row_solver
from indent_sim.run.solvers.semi_analytic import SemiAnalyticSolver
from indent_sim.run.summary import rounded_timings, summary
from indent_sim.scene.scene import Scene

# Largest relative imbalance of a row: between contact force and reactions of the supports, of the
# reactions of constraints against rigid motion, and of the fluid volume.
AUDIT_TOLERANCE = 1e-8

Progress = Callable[[State, int, int], None]
# Called with a row that did not converge and the Newton iterations spent; returns a report of the
# remedies that were tried.
Remedies = Callable[[State, int], str]


class SingleRun:
    """Solution of the load path of a scene; each state is written before the next one is solved.

    Parameters
    ----------
    config
        The config of the scene.
    scene
        The scene that is solved.
    run_output
        The open result folder.
    clock
        Measures the stages of the run.
    error_bars
        Error estimate of the rows; None if none was requested.
    remedies
        Function that tries remedies when a step does not converge.
    """

    def __init__(
        self,
        config: Config,
        scene: Scene,
        run_output: RunOutput,
        clock: Clock,
        error_bars: AnyErrorBars | None,
        remedies: Remedies,
    ):
        self._remedies = remedies
        self.error_bars = error_bars
        self.output_settings = config.output
        self.scene = scene
        self.run_output = run_output
        self.clock = clock
        previous_run = run_output.earlier
        self.states = list(previous_run.states) if previous_run else []
        # The table of rows has no columns for the roughness of the pressure and for the
        # clearance of a gel; run.json has them.
        if previous_run and (roughness := previous_run.report.get("roughness")):
            self.states = [
                replace(row, roughness=roughness.get(str(row.step), 0.0)) for row in self.states
            ]
        if error_bars is not None and scene.history_on_curve is None:
            self.states = [error_bars.add_error_estimate(state) for state in self.states]
        if previous_run and (clearance := previous_run.report.get("clearance")):
            self.states = [
                replace(row, clearance=clearance.get(str(row.step))) for row in self.states
            ]
        self._previous_rows = PreviousRows(self.states)
        self._pull_off: PullOff | None = None
        self._fields_to_write = written_fields(config, scene)
        self._steps_always_written = (
            frozenset() if scene.history_on_curve else scene.physics.path.retained_rows
        )
        audit = (previous_run.report.get("audit") or {}) if previous_run else {}
        self._largest_imbalance = float(audit.get("force_against_reaction") or 0.0)
        self._next_checkpoint = 0.0  # time on the monotonic clock [s]
        self._first_step = len(self.states)  # number of rows that the solver has already passed
        self._set_up()

    def _set_up(self) -> None:
        """Mesh the scene, create the solver, restore an earlier run and open the field file."""
        earlier_seconds = self.states[-1].wall_s if self.states else 0.0
        if not self.scene.is_meshed:
            self._solver: Any = SemiAnalyticSolver(
                self.scene, self.run_output.comm, self.clock.started - earlier_seconds
            )
            self._fields = self._mesh = None
            self._row_solver: Any = self._create_row_solver(earlier_seconds)
            return
        run_output = self.run_output
        scene = self.scene
        clock = self.clock
        # Gmsh meshes in its own process while the libraries load.
        mesh_task: Any = run_on_root(run_output.comm, scene.start_meshing)
        with clock.stage("imports"):
            fe = backend()
        with clock.stage("mesh"):
            grid = run_on_root(run_output.comm, mesh_task)
            self._mesh = mesh = fe.distribute_scene(scene, grid, run_output.comm)
        with clock.stage("assemble"):
            self._solver = fe.create_load_stepper(scene, mesh, clock.started - earlier_seconds)
        self._row_solver = self._create_row_solver(earlier_seconds)
        dofs = self._solver.equilibrium.observed_body.dofs
        versions = fe.versions()
        if grid is not None:  # only rank 0 has it, which writes
            mesh_size = {"cells": len(grid.cells), "points": len(grid.points)}
            petsc_options = (
                {"PETSC_OPTIONS": options} if (options := os.environ.get("PETSC_OPTIONS")) else {}
            )
            run_output.add_entries(
                dofs=dofs,
                mesh={"hash": mesh.hash} | mesh_size,
                versions=versions | {"gmsh": grid.gmsh_version},
                **petsc_options,
            )
        # A checkpoint can be continued only if these entries agree with those of its run. `order`:
        # vectors are stored in the order of the grid's points. `pull_off`: the checkpoint contains
        # the rows around the largest tensile force, which those of older versions lack.
        self._checkpoint_compatibility = {
            "mesh": mesh.hash,
            "dofs": dofs,
            "dolfinx": versions["dolfinx"],
            "order": "of the grid",
        }
        if scene.physics.searches_pull_off:
            self._checkpoint_compatibility["pull_off"] = "rows around the largest pull"
        previous_mesh_hash = (
            (run_output.earlier.report.get("mesh") or {}).get("hash")
            if run_output.earlier
            else None
        )
        if previous_mesh_hash not in (None, mesh.hash):
            run_output.add_warnings(
                f"steps 1 to {len(self.states)} were computed on another mesh (another version of "
                "gmsh?)"
            )
        self._resume()
        self._fields = None
        if self._fields_to_write != "none" and len(self.states) < len(scene.physics.deltas):
            self._fields = fe.Fields(
                self._solver.equilibrium.observed_body, self.output_settings.nodal_stress
            )
            field_metadata = {
                f"region {k}": region.name for k, region in enumerate(scene.physics.domain.regions)
            }
            run_output.open_fields(
                *self._field_mesh(grid),
                keep=self._fields_to_write,
                extra_arrays=self._fields.optional_names,
                information=field_metadata,
            )

    def _create_row_solver(self, earlier_seconds: float) -> RowSolver:
        """Return the solver of the rows."""
        return row_solver(
            self.scene,
            self._solver,
            self.run_output.optional_output,
            self.clock.started - earlier_seconds,
        )

    def _field_mesh(self, grid: Any) -> tuple[Any, ...]:
        """Return mesh and tip of the field file, in the user's units; empty without a grid."""
        if grid is None:
            return ()
        drawn = grid.separate_regions() if self.output_settings.nodal_stress else grid
        points = drawn.points * self.scene.physics.scales.length
        return points, drawn.cells, drawn.regions, self._drawn_tip_geometry()

    def _drawn_tip_geometry(self) -> TipGeometry:
        """Return the surface of the tip for the field file, in the user's units."""
        physics = self.scene.physics
        scales = self.scene.physics.scales
        tip = scales.to_user_units(physics.indenter)
        center = tuple(c * scales.length for c in physics.center)
        width = plot_width(tip, self.scene.plan.prediction["a"], max(physics.deltas) * scales.depth)
        tip_geometry = tip_mesh(
            tip, center, width, physics.domain.kinematics.name, scales.contacts_per_body
        )
        return replace(tip_geometry, slide_axis=physics.track.axis)

    def _resume(self) -> None:
        """Restore the solver at the last row of the run that is continued."""
        physics = self.scene.physics
        row_count = len(self.states)
        is_complete = row_count == len(physics.deltas) and not physics.searches_pull_off
        if row_count == 0 or is_complete or self.scene.history_on_curve:
            return
        saved = self.run_output.read_checkpoint(self._checkpoint_compatibility)
        # Time-dependent rows after the checkpoint are solved again to restore the internal
        # variables.
        if physics.path.times:
            with self.clock.stage("resume"):
                self._solver.resume(saved.equilibria, [], saved.step, saved.pull_off_points)
            self._first_step = saved.step
            return
        path = self._path
        points_passed = [
            (*point, slide)
            for step in range(saved.step + 1, row_count + 1)
            for point, slide in zip(path.segment(step), path.segment_slides(step), strict=True)
        ]
        # The depths of prescribed forces are known from the rows.
        if physics.path.control != "depth":
            points_passed = [
                (state.delta / physics.scales.depth, 0.0, physics.path.slide(state.step))
                for state in self.states[saved.step :]
            ]
        with self.clock.stage("resume"):
            if not self._solver.resume(
                saved.equilibria, points_passed, saved.step, saved.pull_off_points
            ):
                depth = f"delta = {self.states[-1].delta:.6g}"
                raise NotConverged(
                    f"cannot resume: the equilibrium of the last finished row, {depth}, could not "
                    f"be recomputed: {self._solver.failure}"
                )

    @property
    def _path(self) -> LoadPath:
        """The load path; if unloading depths are searched for, it has those of finished rows."""
        physics = self.scene.physics
        if not physics.searches_unloading_depths:
            return physics.path
        return physics.path.with_first_values(
            [state.delta / physics.scales.depth for state in self.states]
        )

    def _save_checkpoint(self) -> None:
        """Save the last equilibria.

        The next checkpoint follows after at least a second and 20 times the duration of this one.
        """
        start_time = time.monotonic()
        if self.states and (points := self._row_solver.points):
            pulls = self._solver.pull_off_points if self.scene.physics.searches_pull_off else {}
            self.run_output.save_checkpoint(
                Checkpoint(len(self.states), points, pulls), self._checkpoint_compatibility
            )
            end_time = time.monotonic()
            self._next_checkpoint = end_time + max(1.0, 20 * (end_time - start_time))

    def solve_path(self, progress: Progress | None) -> list[State]:
        """Solve the load path and return its states in the user's units.

        Raises
        ------
        NotConverged, VerificationError
            If the path ends early.
        """
        row_count = len(self.states)
        try:
            with self.clock.stage("solve"):
                self._row_solver.prepare(self.error_bars)
            if progress is not None and self.states:
                progress(self.states[-1], row_count, self._row_solver.row_count)
            solved_states = self._row_solver.states(
                self._path, self._wants_surface, min(self._first_step, row_count)
            )
            while state := self._next_state(solved_states):
                if not state.converged:
                    remedies_text = self._remedies_text(state)
                    step_text = f"step {state.step} of {self._row_solver.row_count}"
                    raise NotConverged(f"{step_text}: {state.reason}{remedies_text}")
                if state.step <= row_count:
                    continue
                self._record_state(state.to_user_units(self.scene.physics.scales))
                if progress is not None:
                    progress(self.states[-1], state.step, self._row_solver.row_count)
            if self.scene.physics.searches_pull_off:
                with self.clock.stage("pull-off"):
                    self._pull_off = self.run_output.optional_output(
                        "pull-off", self._find_pull_off, None
                    )
        except (NotConverged, KeyboardInterrupt) as end:
            # Saving is collective. A signal reaches ranks at different places; only a failure to
            # converge can be known to all of them.
            if self.run_output.comm.size == 1 or (
                isinstance(end, NotConverged)
                and self.run_output.failure_consensus.all_ranks_failed()
            ):
                self._save_checkpoint()
                if self.states and self._fields_to_write == "last":
                    self._write_fields(self.states[-1])
            raise
        finally:
            largest_imbalance = self._largest_imbalance if self.scene.is_meshed else None
            self._note_time_stepping()
            pull_off = self._pull_off
            self.run_output.add_entries(
                **summary(
                    self.scene,
                    self.states,
                    self.clock,
                    largest_imbalance,
                    self.run_output.rank_optional_output,
                    pull_off,
                )
            )
        return self.states

    def _find_pull_off(self) -> PullOff | None:
        """Search for the largest tensile force between rows; return None if there is none.

        The result is in the user's units, and its balance of forces has been checked.
        """
        pull_off: PullOff | None = self._solver.find_pull_off()
        if pull_off is None:
            return None
        scales = self.scene.physics.scales
        state = pull_off.state.to_user_units(scales)
        self._check_force_balance(state)
        return PullOff(state, pull_off.error * scales.force, pull_off.equilibria)

    def _remedies_text(self, failed: State) -> str:
        """Return a text on the remedies that were tried for a step that did not converge."""
        iterations = failed.newton_iterations + sum(
            state.newton_iterations for state in self.states
        )
        with self.clock.stage("remedies"):
            return self._remedies(failed, iterations)

    def _note_time_stepping(self) -> None:
        """Add the numbers of time steps and cutbacks, including earlier calls, to run.json."""
        if not (self.scene.plan.time and self.scene.physics.path.times):
            return
        previous_counts = (
            (self.run_output.earlier.report.get("time") or {}) if self.run_output.earlier else {}
        )
        # The run.json of a killed run contains only the planned stages, no counts.
        previous_counts = previous_counts if "cuts" in previous_counts else {}
        counts = {
            name: count + int(previous_counts.get(name, 0))
            for name, count in self._solver.counts.items()
        }
        self.run_output.add_entries(time=self.scene.plan.time.report | counts)

    def write_experiment(self) -> None:
        """Evaluate the experiment or history on the elastic curve, and write its results."""
        if not self.scene.uses_elastic_curve:
            return
        with self.clock.stage("experiment"):
            history_result = self._row_solver.experiment()
        self.run_output.write_experiment(history_result.rows, history_result.dynamic)
        entries: dict[str, Any] = (
            {"experiment": history_result.report} if self.scene.experiment else {}
        )
        if self.scene.plan.time and history_result.time:
            entries["time"] = self.scene.plan.time.report | history_result.time
        self.run_output.add_entries(**entries, timings=rounded_timings(self.clock.stages))
        self.run_output.add_warnings(*history_result.warnings)

    def release(self) -> None:
        """Free the memory of the solution (collective), for further runs in the same process."""
        self._solver = self._fields = self._row_solver = None
        if self._mesh is not None:
            backend().release(self._mesh)

    def _wants_surface(self, step: int) -> bool:
        """True if the surface table of a step is computed."""
        # All tables are computed if there are few rows, so that a killed run has its last one, too.
        has_few_rows = self.scene.is_meshed and len(self.scene.physics.deltas) <= 100
        is_written = {"all": True, "last": has_few_rows or step in self._steps_always_written}
        return is_written.get(self.output_settings.surface, False)

    def _next_state(self, solved_states: Iterator[State]) -> State | None:
        """Solve the next row of the load path; return None after the last one."""
        with self.clock.stage("solve"):
            return next(solved_states, None)

    def _record_state(self, state: State) -> None:
        """Check a converged state and write it."""
        state = self._row_solver.finish_row(state, self._check_state)
        with self.clock.stage("write"):
            if self._fields_to_write == "all" or state.step in self._steps_always_written:
                self._write_fields(state)
            self.run_output.append(state)
            self.states.append(state)
            self._previous_rows.append(state)
            # Saving is collective, so rank 0 decides for all.
            is_due = self.run_output.comm.bcast(time.monotonic() >= self._next_checkpoint)
            if is_due and state.step < self._row_solver.row_count:
                self._save_checkpoint()

    def _check_state(self, state: State) -> State:
        """Add the error estimate to a state; raise VerificationError if a check fails."""
        if self.scene.is_meshed:
            self._check_force_balance(state)
        state = state if self.error_bars is None else self.error_bars.add_error_estimate(state)
        if violation := self.run_output.rank_optional_output(
            "sanity check of the rows",
            lambda: violated_bound(self.scene, state, self._previous_rows),
            None,
        ):
            step_text = f"step {state.step}, at delta = {state.delta:.6g}"
            raise VerificationError(f"{step_text}, is physically impossible: {violation}")
        return state

    @property
    def states_with_errors(self) -> list[State]:
        """The states with error estimates: the rows, or the elastic curve of a history."""
        return self._row_solver.states_with_errors(self.states)

    def _check_force_balance(self, state: State) -> None:
        """Check the force balance of a row, and its fluid balance.

        The contact force must equal the reactions of the supports, and the reactions of constraints
        against rigid motion must vanish.
        """
        physics = self.scene.physics
        a = self.scene.plan.prediction["a"]
        attraction = (
            physics.contact.adhesion and physics.scales.to_user_units(physics.contact).adhesion
        )
        # Order of magnitude of the adhesive force. Repulsive and adhesive parts of the contact
        # force may cancel, so that their sum is no scale for the imbalance.
        tensile_force = attraction.work * a if attraction else 0.0
        # Supports of a body with fluid have reactions even without a tip.
        fluid_reactions = 0.0
        if physics.permeable_regions:
            # Reactions of the supports due to fluid, relative to E height^2 for a swelling gel and
            # to E a^2 for a body that only drains. Newton's method measures its residual against
            # the same scale.
            relative_reactions = 100.0
            fluid_reactions = (
                relative_reactions
                * physics.scales.force
                * (1.0 if physics.is_swelling else (a / physics.scales.length) ** 2)
            )
        largest = max(fluid_reactions, self._previous_rows.largest_force, abs(state.force))
        # Lower bound of the force scale, relative to the largest force so far. A body without
        # contact has no force to compare with; Newton's method treats 1e-14 of the largest
        # reactions as round-off (fe/solve/newton.py), which adds up to at most 1e-12 of them over
        # 1e4 nodes.
        min_force_scale = 1e-4
        force_scale = max(
            abs(state.force), abs(state.reaction), min_force_scale * largest, tensile_force
        )
        if physics.is_swelling:
            # The supports of a gel hold its swelling, whose nodal reactions cancel in the sum and
            # may exceed the contact force many times. Newton's residual is relative to their norm.
            reaction_norm = self._solver.equilibrium.reaction_norm * physics.scales.force
            force_scale = max(force_scale, reaction_norm)
        difference = abs(state.force - state.reaction) / force_scale if force_scale > 0 else 0.0
        pin_fraction = state.stray_reaction / force_scale if force_scale > 0 else 0.0
        lateral_fraction = state.lateral_imbalance / force_scale if force_scale > 0 else 0.0
        worst_fraction = max(difference, pin_fraction, lateral_fraction)
        self._largest_imbalance = max(self._largest_imbalance, worst_fraction)
        if not worst_fraction <= AUDIT_TOLERANCE:
            raise VerificationError(
                f"step {state.step} violates the force balance (tolerance {AUDIT_TOLERANCE:g} of "
                f"the force scale {force_scale:.3g}): contact force {state.force:.10g}, reactions "
                f"of the supports {state.reaction:.10g}; largest reaction of the constraints "
                f"against rigid motion {state.stray_reaction:.3g}, which must vanish; horizontal "
                f"forces that do not balance {state.lateral_imbalance:.3g}"
            )
        self._check_fluid_balance(state)

    def _check_fluid_balance(self, state: State) -> None:
        """Check the fluid balance: fluid that left the body against the loss of fluid content.

        The difference is relative to the largest fluid volume that left the body or moved inside it
        in any row so far. Rows of an earlier call contribute only the volume that left, since the
        table has no column for the moved volume.
        """
        if state.unbalanced == 0:
            return
        a = self.scene.plan.prediction["a"]
        depth = max(abs(row.delta) for row in (*self.states, state))
        moved = max(max(abs(row.outflow or 0.0), row.moved) for row in (*self.states, state))
        # Lower bound of the reference volume, relative to a^2 delta. Smaller volumes occur only
        # immediately after a step load, where their relative error has no meaning.
        # AUDIT_TOLERANCE of it is 1e-10 of the displaced volume, and Newton's method leaves 1e-10
        # of the reactions; a snap-through of a porous rubber leaves 2e-11.
        min_fluid_fraction = 1e-2
        largest = max(moved, min_fluid_fraction * a ** (self.scene.physics.scales.dim - 1) * depth)
        unbalanced = state.unbalanced / largest if largest > 0 else 0.0
        self._largest_imbalance = max(self._largest_imbalance, unbalanced)
        if not unbalanced <= AUDIT_TOLERANCE:
            raise VerificationError(
                f"step {state.step} does not conserve the fluid volume: outflow and loss of fluid "
                f"content differ by {state.unbalanced:.3g}, more than {AUDIT_TOLERANCE:g} of the "
                f"displaced volume {largest:.3g}"
            )

    def _write_fields(self, state: State) -> None:
        """Write the fields of a state in the user's units."""
        if (fields_output := self._fields) is None:
            return
        scales = self.scene.physics.scales
        units = {
            "displacement": scales.length,
            **dict.fromkeys(("J", "fluid_content", "swelling", "plastic_strain"), 1.0),
        }
        self._solver.restore_row()
        if (
            gathered := self.run_output.optional_output(
                "fields", lambda: fields_output.gather() or {}, None
            )
        ) is None:
            return
        fields = gathered.items()  # empty except on rank 0
        values = {name: field * units.get(name, scales.pressure) for name, field in fields}
        if lens := self.scene.physics.indenter.elastic_part:
            tip = self._drawn_tip_geometry()
            x = tip.points / scales.length
            r = np.abs(x[:, 0] - self.scene.physics.center[0])
            # The holder above the elastic part is rigid.
            is_elastic = x[:, 2] <= lens.thickness
            lift = fields_output.body.tip_displacement(r) * scales.length
            values["tip_lift"] = np.where(is_elastic, lift, 0.0)
        grows = self.scene.physics.path.is_increasing
        self.run_output.write_fields(
            state, values, state.delta if state.t is None and grows else state.t
        )


def kernel_folder() -> Path:
    """Return the folder of the compiled finite-element kernels; dolfinx is imported as in a run."""
    return load_dolfinx()


def require_solver() -> None:
    """Raise SolverMissing if no part of the solver of scenes on a mesh is installed."""
    if not installed_solver_packages():
        raise SolverMissing(missing_solver_text())


def backend() -> Any:
    """Return the module `fe.solver`; raise BackendError if a library is missing."""
    require_solver()
    try:
        # A signal inside an import would look like a missing library.
        with defer_signals():
            load_dolfinx()
            from indent_sim.fe import solver
    except ImportError as missing:
        raise BackendError(f"{missing}; `indent-sim doctor` lists what is missing") from missing
    return solver
