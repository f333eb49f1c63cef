"""Simulation of one scene: Config -> Scene -> Grid -> BodyMesh -> State, State, ... -> files."""

from __future__ import annotations

import logging
import sys
import time
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import SceneInput, load, to_yaml
from indent_sim.config.scene_sections import OutputSettings
from indent_sim.config.schema import Config
from indent_sim.fe.dolfinx_loading import load_mpi
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import ERROR_COLUMNS, KRYLOV_COLUMNS, STATE_COLUMNS, State
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import BackendError, ConfigError, UsageError, VerificationError
from indent_sim.process.limits import translate_resource_errors
from indent_sim.process.ranks import SerialComm, run_on_root
from indent_sim.process.signals import reraise_signal
from indent_sim.process.usage import Clock, current_memory
from indent_sim.results.memory_folder import MemoryFolder
from indent_sim.results.previous_run import missing_files, previous_run, resumable_report
from indent_sim.results.reader import Results, read
from indent_sim.results.result_files import config_file_entries, read_report
from indent_sim.results.tables import EXPERIMENT
from indent_sim.results.writer import ResultFolder
from indent_sim.run.derived_quantities import Equilibrium
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    coarser_scene,
    double_bath_ramp,
    halve_penalty,
)
from indent_sim.run.error_estimation.error_bars import AnyErrorBars, ErrorBars, TheoryBars
from indent_sim.run.error_estimation.error_request import (
    ErrorRequest,
    check_same_request,
    error_request_of,
)
from indent_sim.run.error_estimation.film_error import estimate_film_error
from indent_sim.run.error_estimation.no_slip_runs import no_slip_base_run, solve_no_slip_effect
from indent_sim.run.error_estimation.predicted_cost import predict_total_cost
from indent_sim.run.error_estimation.refinement import (
    RefinementLevel,
    accuracy_entry,
    adaptive_refinement,
    forceless_row_warnings,
)
from indent_sim.run.error_estimation.step_refinement import step_refinement
from indent_sim.run.explicit_config import automatic_keys, explicit_config
from indent_sim.run.planned_run import collect_scene_errors
from indent_sim.run.remedies import has_remedies, remedies, try_remedies
from indent_sim.run.row_warnings import (
    long_step_warnings,
    lost_contact_warnings,
    oscillating_pressure_warnings,
    underresolved_rows,
)
from indent_sim.run.run_output import (
    Comm,
    FolderType,
    OptionalOutput,
    RunOutput,
    optional_output_after_run,
)
from indent_sim.run.single_run import Progress, SingleRun, backend, require_solver
from indent_sim.run.solvers.hereditary_integral import ERROR_SOURCES
from indent_sim.run.solvers.load_path import LoadPathSolver, row_solver
from indent_sim.run.solvers.semi_analytic import SemiAnalyticSolver
from indent_sim.run.summary import rounded_timings
from indent_sim.scene.imported_body import read_imported_mesh
from indent_sim.scene.resolution import target_error
from indent_sim.scene.scene import Mesher, Scene, resolve, start_mesher

Floats = Sequence[float]
log = logging.getLogger("indent_sim")


@dataclass(frozen=True, repr=False)
class Outcome:
    """Result of a finished run.

    Attributes
    ----------
    directory
        The result folder.
    report
        Content of run.json (on rank 0).
    states
        The rows, in the user's units.
    resumed_after
        Number of rows that an earlier call had already computed.
    """

    directory: Path
    report: dict[str, Any]
    states: list[State]
    resumed_after: int = 0

    def __repr__(self) -> str:
        """Return the folder, the number of rows and the last row."""
        last_row = f", the last one: {self.states[-1]}" if self.states else ""
        return f"<Outcome in {self.directory}: {len(self.states)} rows{last_row}>"


def simulate(
    given: SceneInput,
    comm: Comm = None,
    *,
    scene: Scene | None = None,
    directory: Path | str | None = None,
    progress: Progress | None = None,
    resume: bool = False,
    error_bars: bool = False,
    overwrite: bool = False,
) -> Outcome:
    """Simulate a scene and write its result folder.

    Collective over `comm`; rank 0 writes the files. Everything computed before a failure stays on
    disk.

    Parameters
    ----------
    given
        A config, or the file or dictionary that contains one.
    comm
        MPI communicator; by default this process alone.
    scene
        The scene that `resolve` makes of the config, if it is already known.
    directory
        Result folder; by default that of the config.
    progress
        Function that is called after every row with its state, its number and the number of rows.
    resume
        Keep the rows of an earlier run of the same config and compute only the missing rows.
    error_bars
        Estimate the errors of every row. With `accuracy` in the config, errors are always
        estimated, and the mesh is refined until the estimated error of the force is small enough.
    overwrite
        Replace the rows of another config or the finished run of another scene. A finished run of
        the same scene is always replaced when the new run is finished.

    Raises
    ------
    ConfigError, UsageError, MeshError, NotConverged, VerificationError, BackendError
    """
    comm = comm if comm is not None else SerialComm()
    config = config_of(given)
    target = Path(directory or config.output.directory or "results/run")
    try:
        outcome = SimulationDriver(
            config, scene, comm, target, progress, resume, error_bars, overwrite
        ).run()
    except ConfigError as error:
        raise collect_scene_errors(error, config) from None
    if config.output.plot:
        run_on_root(comm, _plot, target, outcome.report)
    return outcome


def simulate_in_memory(config: Config, scene: Scene, name: str = "run") -> Results:
    """Simulate a scene without writing files, and return its rows and its run.json.

    The rows are those that `simulate` writes: the same checks, error estimates and warnings apply.
    A failure of the scene is not raised, but recorded in the report.

    Parameters
    ----------
    config
        The config of the scene.
    scene
        The scene that `resolve` makes of the config.
    name
        Path by which the results are named; nothing is written there.

    Raises
    ------
    UsageError, BackendError
        The cause of the failure is the environment and not this scene.
    """
    folders: list[MemoryFolder] = []

    def open_folder(*arguments: Any, **options: Any) -> MemoryFolder:
        folders.append(MemoryFolder(*arguments, **options))
        return folders[-1]

    target = Path(name)
    driver = SimulationDriver(
        config, scene, SerialComm(), target, None, False, False, True, open_folder
    )
    try:
        driver.run()
    except (UsageError, BackendError):
        # The next run would end in the same way.
        raise
    except Exception as error:
        # A refinement level that fails before its first row does not replace an earlier level.
        with_rows = [folder for folder in folders if folder.states] or folders
        if with_rows:
            return with_rows[-1].results()
        return MemoryFolder.failed(target, error)
    return folders[-1].results()


class SimulationDriver:
    """Simulation of one config on one or on successively finer meshes, into the same folder."""

    def __init__(
        self,
        config: Config,
        scene: Scene | None,
        comm: Comm,
        target: Path,
        progress: Progress | None,
        resume: bool,
        error_bars: bool,
        overwrite: bool,
        folder_type: FolderType = ResultFolder,
    ):
        self.config = config
        self.comm = comm
        self.target = target
        self.progress = progress
        self._scene = scene
        self._resume = resume
        self._overwrite = overwrite
        self._folder_type = folder_type
        self._clock = Clock()
        self._previous_report = (
            comm.bcast(run_on_root(comm, resumable_report, target)) if resume else {}
        )
        previous_request = error_request_of(self._previous_report)
        self._request = ErrorRequest(
            error_bars or previous_request.error_bars, target_error(config.accuracy)
        )
        if self._previous_report:
            check_same_request(previous_request, self._request, target)
        self._optional_output = OptionalOutput()
        with self._clock.stage("resolve"), translate_resource_errors():
            self._imported_mesh = read_imported_mesh(config, comm)

    def run(self) -> Outcome:
        """Run all refinement levels and return the outcome of the last level.

        Raises
        ------
        VerificationError
            If the last level is less accurate than requested.
        """
        accuracy_report = self._previous_report.get("accuracy") or {}
        for level in adaptive_refinement(
            self._resolve_scene, accuracy_report.get("elements"), accuracy_report.get("tried", ())
        ):
            outcome = self._run_level(level)
        if level.failure:
            raise VerificationError(level.failure)
        return outcome

    def _resolve_scene(self, elements: float | None) -> Scene:
        """Return the scene with `elements` in the contact radius; None for the default number."""
        # A given scene is not reused with an imported mesh: its file may have changed since.
        if elements is None and self._scene is not None and self._imported_mesh is None:
            return self._scene
        with self._clock.stage("resolve"):
            return resolve(self.config, elements, self._imported_mesh)

    def _run_level(self, level: RefinementLevel) -> Outcome:
        """Simulate one refinement level, estimate its errors and assess them."""
        config = self.config
        scene = level.scene
        explicit = explicit_config(self.config, level.scene)
        self.comm = communicator(self.comm, scene)
        # Only the first level of this call continues an earlier run.
        resume = self._resume and level.coarser_run is None
        scene_with_cost = (
            scene if level.coarser_run else predict_total_cost(scene, self._request.error_bars)
        )
        report = self._initial_report(scene, explicit, scene_with_cost.plan.prediction)
        config_yaml = to_yaml(explicit)
        if resume and (
            outcome := self._finished_outcome(config_yaml, scene, explicit.output, report)
        ):
            return outcome
        columns = (*scene.columns, *self._optional_columns(scene))
        body = config.body
        mesh = (
            self._imported_mesh.msh_text(body)
            if self._imported_mesh and isinstance(body, MeshFromFile)
            else ()
        )
        folder_options = {"columns": columns, "guard": not self._overwrite, "resume": resume}
        new_output = RunOutput(
            self.comm,
            self.target,
            config_yaml,
            report,
            folder_type=self._folder_type,
            surface=config.output.surface,
            mesh=mesh,
            **folder_options,
        )
        with new_output as run_output, reraise_signal(), translate_resource_errors():
            plan = scene.plan
            self._optional_output = run_output.optional_output
            error_bars = self._error_bars(level) if self._request.has_error_bars else None
            if error_bars is not None:
                run_output.add_entries(
                    error_budget=error_bars.budgets,
                    accuracy=accuracy_entry(config, plan.resolution, level.previous_resolutions),
                )
            single_run = SingleRun(
                config,
                scene,
                run_output,
                self._clock,
                error_bars,
                partial(self._try_remedies, scene),
            )
            states = single_run.solve_path(self.progress)
            single_run.write_experiment()
            states_with_errors = single_run.states_with_errors
            single_run.release()
            run_output.add_warnings(
                *lost_contact_warnings(scene, states),
                *oscillating_pressure_warnings(scene, states_with_errors),
            )
            if error_bars is None:
                run_output.add_warnings(
                    *underresolved_rows(scene, states), *long_step_warnings(scene, states)
                )
            else:
                run_output.add_warnings(
                    *forceless_row_warnings(scene, states_with_errors, error_bars)
                )
                level.assess(self._resolve_scene, states_with_errors, error_bars)
                if self._request.error_bars and level.next_level is None:
                    own_run = CoarserRun(1.0, states_with_errors, scene)
                    no_slip = self._optional_output(
                        "no-slip effect",
                        lambda: self._no_slip_effect(own_run, error_bars),
                        None,
                    )
                    run_output.add_entries(
                        stick=no_slip, timings=rounded_timings(self._clock.stages)
                    )
            if level.failure:
                run_output.mark_failed(VerificationError(level.failure))
        return Outcome(
            self.target,
            run_output.report,
            states,
            len(run_output.earlier.states) if run_output.earlier else 0,
        )

    def _try_remedies(self, scene: Scene, failed: State, iterations: int) -> str:
        """Try remedies for a path that ended early; return a text with the results.

        The text is empty if there is no remedy, or if several processes solve the scene.
        """
        if self.comm.size > 1 or not has_remedies(scene):
            return ""
        solve_states = partial(states, with_surface=False)
        dofs = scene.cost.dofs
        return try_remedies(
            remedies(self.config, scene), failed, iterations, dofs, resolve, solve_states
        )

    def _finished_outcome(
        self, config_yaml: str, scene: Scene, output: OutputSettings, initial_report: dict[str, Any]
    ) -> Outcome | None:
        """Return the outcome of an earlier run if that run is complete; None otherwise.

        Missing or damaged files of the earlier run are reported among its warnings.
        """
        comm = self.comm
        target = self.target
        earlier = comm.bcast(run_on_root(comm, previous_run, target, config_yaml, initial_report))
        if earlier is None:
            return None
        physics = scene.physics
        steps = len(earlier.states if scene.history_on_curve else scene.physics.deltas)
        depths = [delta * physics.scales.depth for delta in physics.deltas]
        if physics.searches_unloading_depths and physics.path.unloading:
            depths = depths[: physics.path.unloading.start]
        has_known_depths = physics.path.control == "depth" and scene.history_on_curve is None
        earlier.check(depths if has_known_depths else None, steps, target)
        if earlier.report.get("status") != "done" or len(earlier.states) != steps:
            return None
        surface = "none" if scene.history_on_curve else output.surface
        absent_files = comm.bcast(run_on_root(comm, missing_files, target, surface, output.fields))
        is_reported_missing = EXPERIMENT in (earlier.report.get("missing") or ())
        has_table = scene.experiment is not None and scene.history_on_curve is None
        if has_table and not (
            is_reported_missing or comm.bcast(run_on_root(comm, (target / EXPERIMENT).exists))
        ):
            absent_files = [*absent_files, EXPERIMENT]
        advice = "missing or damaged; run again without --resume to recompute them"
        absence_warnings = [f"{', '.join(absent_files)}: {advice}"] if absent_files else []
        report = earlier.report | {
            "warnings": [*earlier.report.get("warnings", []), *absence_warnings]
        }
        return Outcome(target, report, list(earlier.states), steps)

    def _initial_report(
        self, scene: Scene, explicit: Config, prediction: dict[str, float]
    ) -> dict[str, Any]:
        """Return the entries of run.json that are known before the solution."""
        physics = scene.physics
        plan = scene.plan
        request = asdict(self._request) | config_file_entries(self.config.source.name, self.target)
        report = {
            "asked": request,
            "title": plan.title,
            "units": plan.units,
            "gap": physics.gap,
            "method": scene.method,
        }
        center = [c * physics.scales.length for c in physics.center]
        auto = automatic_keys(self.config, explicit)
        planned = {
            "choices": list(plan.choices),
            "prediction": prediction,
            "scales": physics.scales.report,
            "auto": auto,
        }
        if plan.time and physics.path.times:
            report["time"] = plan.time.report
        report |= {
            "control": physics.path.control,
            "center": center,
            **({"slide_axis": "xy"[physics.track.axis]} if physics.slides else {}),
            "plan": planned,
            "warnings": list(plan.warnings),
        }
        return report | {"ranks": self.comm.size, "memory_before_MB": round(current_memory(), 1)}

    def _optional_columns(self, scene: Scene) -> tuple[str, ...]:
        """Return the columns of linear solver, error estimates and reactions of supports."""
        krylov_columns = KRYLOV_COLUMNS if scene.solver.linear == "iterative" else ()
        prescribed = {"delta"} if scene.physics.path.control == "depth" else set()
        columns = (
            ERROR_SOURCES.values()
            if scene.history_on_curve
            else (*STATE_COLUMNS, *scene.physics.columns)
        )
        columns_with_errors = (
            {*columns} - prescribed if self._request.has_error_bars else set[str]()
        )
        if not scene.physics.slides:
            columns_with_errors -= {"side_force_x", "side_force_y"}
        errors = (
            name for name in ERROR_COLUMNS if name.removesuffix("_error") in columns_with_errors
        )
        reactions = scene.reaction_columns if self.config.output.reactions else ()
        return (*krylov_columns, *errors, *reactions)

    def _error_bars(self, level: RefinementLevel) -> AnyErrorBars:
        """Solve the auxiliary runs of the error estimate and set up the error bars."""
        if not level.scene.is_meshed:
            return TheoryBars(level.scene)
        with self._clock.stage("imports"):
            backend()
        with self._clock.stage("companions"):
            coarser_run = level.coarser_run
            if coarser_run is None:
                # A resumed run compares itself with the previous level, as before its interruption.
                previous_scene = (
                    self._resolve_scene(level.previous_resolutions[-1])
                    if level.previous_resolutions
                    else None
                )
                ratio, coarse_scene = coarser_scene(level.scene, previous_scene)
                coarser_run = CoarserRun(ratio, self._elastic_states(coarse_scene), coarse_scene)
            soft_scene = halve_penalty(coarser_run.scene) if coarser_run.scene else None
            soft_states = self._elastic_states(soft_scene) if soft_scene else None
            half_steps = step_refinement(coarser_run, self._elastic_states)
            slow_bath_scene = double_bath_ramp(coarser_run.scene) if coarser_run.scene else None
            bath_states = self._elastic_states(slow_bath_scene) if slow_bath_scene else None
            film = estimate_film_error(level.scene, self._elastic_states)
            return ErrorBars(level.scene, coarser_run, soft_states, half_steps, film, bath_states)

    def _no_slip_effect(self, run: CoarserRun, error_bars: AnyErrorBars) -> dict[str, Any] | None:
        """Return the change of the largest force if nothing slips, from the plan or by solution."""
        assert run.scene is not None
        with self._clock.stage("companions"):
            planned_effect = run.scene.plan.stick
            effect = (
                solve_no_slip_effect(
                    no_slip_base_run(run, error_bars.coarser_run), self._elastic_states
                )
                if run.scene.is_meshed
                else planned_effect
            )
        return asdict(effect) | {"words": effect.sentence} if effect else None

    def _elastic_states(self, scene: Scene) -> list[State]:
        """Solve the elastic part of an auxiliary scene, without surface tables.

        The states up to the first failure are returned; the list is empty if the run fails at the
        beginning.
        """
        elastic_scene = replace(scene, history_on_curve=None)
        total = len(elastic_scene.physics.deltas)

        def solve_all() -> list[State]:
            solved = []
            last_log = time.monotonic()
            # Seconds between progress messages of an auxiliary run.
            log_interval = 30.0
            for state in states(elastic_scene, self.comm, with_surface=False):
                solved.append(state)
                if (now := time.monotonic()) - last_log > log_interval:
                    log.info("auxiliary run of the error estimate: step %d/%d", len(solved), total)
                    last_log = now
            return solved

        return self._optional_output("an auxiliary run of the error estimate", solve_all, [])


def states(
    given: Scene | SceneInput,
    comm: Comm = None,
    *,
    with_surface: bool = True,
    mesher: Mesher = Scene.grid,
) -> Iterator[State]:
    """Solve a scene without writing files, and yield one State per requested depth or force.

    On one process the memory of the solution is released when the iterator is exhausted or closed;
    on several ranks only when it is exhausted.

    Parameters
    ----------
    given
        A scene, or the config, file or dictionary that contains one.
    comm
        MPI communicator; by default this process alone.
    with_surface
        Compute the table of the contact surface of every state.
    mesher
        Makes the grid of the scene.

    Yields
    ------
    State
        In the user's units. The last one is not converged if the path could not be solved to its
        end.
    """
    scene = given if isinstance(given, Scene) else resolve(config_of(given))
    comm = communicator(comm if comm is not None else SerialComm(), scene)
    optional_output = OptionalOutput(comm)
    fe = backend() if scene.is_meshed else None
    mesh = fe and fe.distribute_scene(scene, run_on_root(comm, mesher, scene), comm)
    solver: Any = fe.create_load_stepper(scene, mesh) if fe else SemiAnalyticSolver(scene, comm)
    rows = row_solver(scene, solver, optional_output)
    rows.prepare()
    is_complete = False
    try:
        for state in rows.states(scene.physics.path, lambda step: with_surface):
            yield state.to_user_units(scene.physics.scales)
        is_complete = True
    finally:
        # PETSc does not free objects that are destroyed after the release.
        del solver, rows
        # Several ranks release together, and a rank that stops early does not know whether the
        # others do. At interpreter shutdown PETSc is finalized before the last Python objects.
        if is_complete or (comm.size == 1 and not sys.is_finalizing()):
            optional_output.consensus.free()
            if fe:
                fe.release(mesh)


@dataclass(frozen=True)
class CondensedBody:
    """Linear body condensed to its contact surface, for fast solutions with other tips."""

    scene: Scene
    equilibrium: Equilibrium

    @property
    def compliance(self) -> Any:
        """Nodal compliance C of the contact surface, u_z = -C F, nondimensional."""
        return self.equilibrium.contact.compliance

    def states(
        self,
        indenter: Indenter | None = None,
        deltas: Floats | None = None,
        forces: Floats | None = None,
    ) -> list[State]:
        """Solve the contact for another tip, other depths or other forces, without surface tables.

        The mesh is unchanged; it must be fine enough for the new contact too.

        Parameters
        ----------
        indenter
            The tip [user's units]; by default the tip of the scene.
        deltas
            Depths [length]; by default the path of the scene.
        forces
            Prescribed forces [force], instead of depths.

        Returns
        -------
        list of State
            One per depth or force, in the user's units.

        Raises
        ------
        ValueError
            If both depths and forces are given.
        """
        if deltas is not None and forces is not None:
            raise ValueError("give depths or forces, not both")
        scene = self.scene
        physics = self.scene.physics
        scales = self.scene.physics.scales
        if indenter is not None:
            scene = scene.replace_physics(indenter=scales.nondimensionalize(indenter))
        if deltas is not None:
            values = tuple(delta / scales.depth for delta in deltas)
            scene = scene.replace_physics(deltas=values, path=LoadPath("depth", values))
        if forces is not None:
            # The search for the depth of a force starts here.
            first_depth = max(*physics.deltas, 1e-3 * physics.body.height)
            values = tuple(force / scales.force for force in forces)
            scene = scene.replace_physics(
                deltas=(first_depth,) * len(forces), path=LoadPath("force", values)
            )
        equilibrium = self.equilibrium.reuse_body(scene)
        solver = LoadPathSolver(scene, backend().LoadStepper(equilibrium))
        states = solver.states(scene.physics.path, lambda step: False)
        return [state.to_user_units(scene.physics.scales) for state in states]


def condense(scene: Scene, comm: Comm = None) -> CondensedBody:
    """Factorize the stiffness matrix of a linear body and condense it to the contact surface.

    The function is collective over `comm`, which by default is this process alone. It raises
    ConfigError if the solver method of the scene is not "condensed".
    """
    if scene.solver.method != "condensed":
        raise ConfigError(
            "solver.method",
            "this scene cannot be condensed",
            "static condensation needs a linear elastic body, the reference gap, and a contact "
            "method other than nitsche",
        )
    fe = backend()
    comm = comm if comm is not None else mpi().COMM_SELF
    while _released_meshes:
        fe.release(_released_meshes.pop())
    mesh = fe.distribute_scene(scene, run_on_root(comm, scene.grid), comm)
    body = CondensedBody(scene, fe.create_equilibrium(scene, mesh))
    # Garbage collectors of several ranks do not drop the body at the same time.
    if comm.size == 1:
        weakref.finalize(body, _released_meshes.append, mesh).atexit = False
    return body


# Meshes of condensed bodies that no longer exist; the next `condense` frees their PETSc objects.
_released_meshes: list[Any] = []


def warm_up() -> None:
    """Import the libraries that every run needs, so that the first of many runs is not slower."""
    start_mesher()
    backend()


def config_of(given: SceneInput) -> Config:
    """Return the config from a config, file or dictionary; raise TypeError for a Scene."""
    if isinstance(given, Scene):
        raise TypeError("expected a config, a file or a dictionary, not a resolved Scene")
    return given if isinstance(given, Config) else load(given)


def communicator(comm: Comm, scene: Scene) -> Comm:
    """Return the communicator that solves a scene: COMM_SELF for a mesh on one process."""
    return mpi().COMM_SELF if scene.is_meshed and isinstance(comm, SerialComm) else comm


def mpi() -> Any:
    """Initialise MPI and return mpi4py.MPI.

    Raises
    ------
    SolverMissing
        If the solver is not installed.
    BackendError
        If MPI does not work.
    """
    require_solver()
    try:
        return load_mpi()
    except (ImportError, RuntimeError) as error:
        raise BackendError(f"mpi4py: {error}; `indent-sim doctor` lists what is missing") from error


def _plot(directory: Path, report: dict[str, Any]) -> None:
    """Draw the pictures of a finished run; a failure is a warning."""
    from indent_sim.results.pictures import experiment, figures, panels

    draw = optional_output_after_run(directory, report)
    picture = directory / figures.FORCE_PICTURE
    draw(
        picture.name,
        lambda: panels.draw_results([read(directory, read_report(directory))], picture),
        None,
    )
    if experiment.has_elastic_curve(directory, report):
        draw(experiment.EXPERIMENT_PICTURE, lambda: experiment.draw(directory), None)
