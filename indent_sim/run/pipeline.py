"""The chain of one run: Config -> Scene -> Grid -> BodyMesh -> State, State, ... -> files."""

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
from indent_sim.config.schema import Config, OutputSettings
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import ERROR_COLUMNS, KRYLOV_COLUMNS, STATE_COLUMNS, State
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import BackendError, ConfigError, VerificationError
from indent_sim.process.limits import translate_resource_errors
from indent_sim.process.ranks import SerialComm, run_on_root
from indent_sim.process.signals import reraise_signal
from indent_sim.process.usage import Clock, current_memory
from indent_sim.results.folder import config_file_entries, read_report
from indent_sim.results.reader import missing_files, previous_run, read, resumable_report
from indent_sim.results.tables import EXPERIMENT
from indent_sim.run.derived_quantities import DerivedQuantities, Equilibrium
from indent_sim.run.error_estimation.coarser_run import (
    CoarserRun,
    coarser_scene,
    double_bath_ramp,
    halve_penalty,
)
from indent_sim.run.error_estimation.error_bars import (
    AnyErrorBars,
    ErrorBars,
    TheoryBars,
    step_refinement,
)
from indent_sim.run.error_estimation.film_error import estimate_film_error
from indent_sim.run.error_estimation.no_slip_runs import no_slip_base_run, solve_no_slip_effect
from indent_sim.run.error_estimation.refinement import (
    ErrorRequest,
    RefinementLevel,
    accuracy_entry,
    adaptive_refinement,
    check_same_request,
    error_request_of,
    forceless_row_warnings,
    predict_total_cost,
)
from indent_sim.run.explicit_config import automatic_keys, explicit_config
from indent_sim.run.planned_run import collect_scene_errors
from indent_sim.run.remedies import has_remedies, remedies, try_remedies
from indent_sim.run.run_output import Comm, OptionalOutput, RunOutput, optional_output_after_run
from indent_sim.run.sanity_checks import (
    long_step_warnings,
    oscillating_pressure_warnings,
    underresolved_rows,
)
from indent_sim.run.single_run import Progress, SingleRun, backend
from indent_sim.run.solvers.hereditary_integral import ERROR_SOURCES, HereditaryIntegralSolver
from indent_sim.run.solvers.semi_analytic import SemiAnalyticSolver
from indent_sim.run.summary import rounded_timings
from indent_sim.scene.problem_setup import read_imported_mesh
from indent_sim.scene.resolution import target_error
from indent_sim.scene.scene import Mesher, Scene, resolve, start_mesher

Floats = Sequence[float]
LOG_INTERVAL = 30.0  # s between lines about a run beside this one
log = logging.getLogger("indent_sim")


@dataclass(frozen=True)
class Outcome:
    """A finished run: where it lies, what run.json says (rank 0), and its states in the user's
    units.
    """

    directory: Path
    report: dict[str, Any]
    states: list[State]
    resumed_after: int = 0  # this many rows were there already


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
    """Simulate a scene and write its result folder (collective over `comm` [this process alone],
    files by rank 0).

    given: a config, or the file or dictionary that says one. scene: what the config becomes, where
    that is known. With `resume` the rows of an earlier run of the same config stay, and the others
    are computed. With `error_bars`, or `accuracy` in the config, every row has its force_error;
    `accuracy` refines the mesh until it is small enough. Rows of another config file and a finished
    run of another scene are replaced with `overwrite` alone; a finished run of the same scene is
    replaced once this one is done. Raises ConfigError, UsageError, MeshError, NotConverged,
    VerificationError, BackendError; what was computed before a failure is on disk.
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


class SimulationDriver:
    """One config simulated on one mesh, or on finer and finer ones, into the same folder."""

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
    ):
        self.config = config
        self.comm = comm
        self.target = target
        self.progress = progress
        self._scene = scene
        self._resume = resume
        self._overwrite = overwrite
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
        """What the last attempt came to; VerificationError when it is not as accurate as asked for."""
        accuracy_report = self._previous_report.get("accuracy") or {}
        for level in adaptive_refinement(
            self._resolve_scene, accuracy_report.get("elements"), accuracy_report.get("tried", ())
        ):
            outcome = self._run_level(level)
        if level.failure:
            raise VerificationError(level.failure)
        return outcome

    def _resolve_scene(self, elements: float | None) -> Scene:
        """The scene with that many elements in a contact radius, where `accuracy` leaves it open."""
        if (
            elements is None and self._scene is not None and self._imported_mesh is None
        ):  # a mesh file may have changed since
            return self._scene
        with self._clock.stage("resolve"):
            return resolve(self.config, elements, self._imported_mesh)

    def _run_level(self, level: RefinementLevel) -> Outcome:
        """Simulate an attempt, with its error bars, and judge it."""
        config = self.config
        scene = level.scene
        decided = explicit_config(self.config, level.scene)
        self.comm = communicator(self.comm, scene)
        resume = self._resume and level.coarser_run is None  # only the first one
        scene_with_cost = (
            scene if level.coarser_run else predict_total_cost(scene, self._request.error_bars)
        )
        report = self._initial_report(scene, decided, scene_with_cost.plan.prediction)
        config_yaml = to_yaml(decided)
        if resume and (
            outcome := self._finished_outcome(config_yaml, scene, decided.output, report)
        ):
            return outcome
        columns = (*scene.columns, *self._optional_columns(scene))
        body = config.body
        mesh = (
            self._imported_mesh.msh_text(body)
            if self._imported_mesh and isinstance(body, MeshFromFile)
            else ()
        )
        folder = {"columns": columns, "guard": not self._overwrite, "resume": resume}
        opened = RunOutput(
            self.comm,
            self.target,
            config_yaml,
            report,
            surface=config.output.surface,
            mesh=mesh,
            **folder,
        )
        with opened as run_output, reraise_signal(), translate_resource_errors():
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
            run_output.add_warnings(*oscillating_pressure_warnings(scene, states_with_errors))
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
                        "what no slip would change",
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

    def _try_remedies(self, scene: Scene, step: int, iterations: int) -> str:
        """What was tried where a path ended early, and how far it came, in words; by one process
        alone.
        """
        if self.comm.size > 1 or not has_remedies(scene):
            return ""
        solve_states = partial(states, with_surface=False)
        return try_remedies(remedies(self.config, scene), step, iterations, resolve, solve_states)

    def _finished_outcome(
        self, config_yaml: str, scene: Scene, output: OutputSettings, initial_report: dict[str, Any]
    ) -> Outcome | None:
        """The outcome of a run that came to its end before, with what its files lack since among
        its warnings.
        """
        comm = self.comm
        target = self.target
        earlier = comm.bcast(run_on_root(comm, previous_run, target, config_yaml, initial_report))
        if earlier is None:
            return None
        physics = scene.physics
        steps = len(earlier.states if scene.history_on_curve else scene.physics.deltas)
        depths = [delta * physics.scales.depth for delta in physics.deltas]
        is_known = physics.path.control == "depth" and scene.history_on_curve is None
        earlier.check(depths if is_known else None, steps, target)
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
        advice = "missing or damaged since; leave --resume out to compute them again"
        notes = [f"{', '.join(absent_files)}: {advice}"] if absent_files else []
        report = earlier.report | {"warnings": [*earlier.report.get("warnings", []), *notes]}
        return Outcome(target, report, list(earlier.states), steps)

    def _initial_report(
        self, scene: Scene, decided: Config, prediction: dict[str, float]
    ) -> dict[str, Any]:
        """What run.json says from the beginning."""
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
        auto = automatic_keys(self.config, decided)
        planned = {
            "choices": list(plan.choices),
            "prediction": prediction,
            "scales": physics.scales,
            "auto": auto,
        }
        if plan.time and physics.path.times:
            report["time"] = plan.time.report
        report |= {
            "control": physics.path.control,
            "center": center,
            "plan": planned,
            "warnings": list(plan.warnings),
        }
        return report | {"ranks": self.comm.size, "memory_before_MB": round(current_memory(), 1)}

    def _optional_columns(self, scene: Scene) -> tuple[str, ...]:
        """Columns that apply to the scene: of its linear solver, and the error bars of what it
        finds.
        """
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
        errors = (
            name for name in ERROR_COLUMNS if name.removesuffix("_error") in columns_with_errors
        )
        reactions = scene.reaction_columns if self.config.output.reactions else ()
        return (*krylov_columns, *errors, *reactions)

    def _error_bars(self, level: RefinementLevel) -> AnyErrorBars:
        if not level.scene.is_meshed:
            return TheoryBars(level.scene)
        with self._clock.stage("imports"):
            backend()
        with self._clock.stage("companions"):
            coarser_run = level.coarser_run
            if coarser_run is None:  # that of a resumed run is its earlier attempt, as before
                earlier = (
                    self._resolve_scene(level.previous_resolutions[-1])
                    if level.previous_resolutions
                    else None
                )
                ratio, coarse_scene = coarser_scene(level.scene, earlier)
                coarser_run = CoarserRun(ratio, self._elastic_states(coarse_scene), coarse_scene)
            soft_scene = halve_penalty(coarser_run.scene) if coarser_run.scene else None
            soft_states = self._elastic_states(soft_scene) if soft_scene else None
            half_steps = step_refinement(coarser_run, self._elastic_states)
            slow_bath_scene = double_bath_ramp(coarser_run.scene) if coarser_run.scene else None
            bath_states = self._elastic_states(slow_bath_scene) if slow_bath_scene else None
            film = estimate_film_error(level.scene, self._elastic_states)
            return ErrorBars(level.scene, coarser_run, soft_states, half_steps, film, bath_states)

    def _no_slip_effect(self, run: CoarserRun, error_bars: AnyErrorBars) -> dict[str, Any] | None:
        """What no slip would change of the deepest force: as the plan knows it, or solved beside
        the run.
        """
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
        """The elastic states of a scene without surface tables; what one failed to reach is
        missing, all where it ended.
        """
        elastic_scene = replace(scene, history_on_curve=None)
        total = len(elastic_scene.physics.deltas)

        def followed() -> list[State]:
            reached = []
            last_log = time.monotonic()
            for state in states(elastic_scene, self.comm, with_surface=False):
                reached.append(state)
                if (now := time.monotonic()) - last_log > LOG_INTERVAL:
                    log.info("beside this run, for its error bars: step %d/%d", len(reached), total)
                    last_log = now
            return reached

        return self._optional_output("a run beside this one", followed, [])


def states(
    given: Scene | SceneInput,
    comm: Comm = None,
    *,
    with_surface: bool = True,
    mesher: Mesher = Scene.grid,
) -> Iterator[State]:
    """Walk a scene without writing anything: one State per requested depth, in the user's units; on
    the mesh that `mesher` makes of the scene.

    given: a scene, or the config, file or dictionary that says one. For notebooks and tests; a
    State that is not converged is the last one. The memory of the solution is given back at the
    last state, and on one process also where the iterator is closed before, as when a loop over it
    is left.
    """
    scene = given if isinstance(given, Scene) else resolve(config_of(given))
    comm = communicator(comm if comm is not None else SerialComm(), scene)
    optional_output = OptionalOutput(comm)
    fe = backend() if scene.is_meshed else None
    domain = scene.physics.domain
    mesh = fe and fe.distribute(run_on_root(comm, mesher, scene), domain, comm)
    walk: Any = fe.walk(scene, mesh) if fe else SemiAnalyticSolver(scene, comm)
    readings = DerivedQuantities(scene, walk.equilibrium if fe else None, optional_output)
    if scene.history_on_curve:
        walk = HereditaryIntegralSolver(scene, walk)
        walk.solve()
    is_complete = False
    try:
        for state in walk.states(scene.physics.path, lambda step: with_surface):
            yield (
                state if scene.history_on_curve else readings.complete_state(state)
            ).to_user_units(scene.physics.scales)
        is_complete = True
    finally:
        del walk, readings  # what dies after the release stays
        # Several ranks release together: one that leaves early does not know whether the others do.
        # At the end of the process PETSc is gone before the last of Python's objects are
        if is_complete or (comm.size == 1 and not sys.is_finalizing()):
            optional_output.consensus.free()
            if fe:
                fe.release(mesh)


@dataclass(frozen=True)
class CondensedBody:
    """A linear body condensed to its contact surface: thousands of tips and depths, milliseconds
    each.
    """

    scene: Scene
    equilibrium: Equilibrium

    @property
    def compliance(self) -> Any:
        """`fe.condensed.compliance.Compliance`: u_z = -C F between nodes of the contact surface,
        without units.
        """
        return self.equilibrium.contact.compliance

    def states(
        self,
        indenter: Indenter | None = None,
        deltas: Floats | None = None,
        forces: Floats | None = None,
    ) -> list[State]:
        """Press another tip, or to other depths or forces, all in the user's units; one State each,
        without surface tables.

        The mesh stays: it must be fine enough for this contact too. ValueError when both depths and
        forces are given.
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
            first_depth = max(*physics.deltas, 1e-3 * physics.body.height)  # of the search
            values = tuple(force / scales.force for force in forces)
            scene = scene.replace_physics(
                deltas=(first_depth,) * len(forces), path=LoadPath("force", values)
            )
        equilibrium = self.equilibrium.reuse_body(scene)
        readings = DerivedQuantities(scene, equilibrium)
        walk = backend().Walk(equilibrium)
        states = walk.states(scene.physics.path, lambda step: False)
        return [
            readings.complete_state(state).to_user_units(scene.physics.scales) for state in states
        ]


def condense(scene: Scene, comm: Comm = None) -> CondensedBody:
    """Factor a linear scene's body once and condense it (collective); see `CondensedBody`.

    Raises ConfigError when the scene is not one that condenses.
    """
    if scene.solver.method != "condensed":
        raise ConfigError(
            "solver.method",
            "this scene does not condense",
            "linear elastic, reference gap, no Nitsche",
        )
    fe = backend()
    comm = comm if comm is not None else mpi().COMM_SELF
    while _released_meshes:
        fe.release(_released_meshes.pop())
    mesh = fe.distribute(run_on_root(comm, scene.grid), scene.physics.domain, comm)
    body = CondensedBody(scene, fe.equilibrium(scene, mesh))
    if comm.size == 1:  # several ranks need not let go of it at the same time
        weakref.finalize(body, _released_meshes.append, mesh).atexit = False
    return body


_released_meshes: list[
    Any
] = []  # meshes of condensed bodies that are gone: what PETSc keeps of them goes with the next one


def warm_up() -> None:
    """Load what every run needs, so that the first of many costs no more than the others."""
    start_mesher()
    backend()


def config_of(given: SceneInput) -> Config:
    """The config of a scene, however it is given; TypeError for what `resolve` has made of one."""
    if isinstance(given, Scene):
        raise TypeError("give what `load` gives, not what `resolve` made of it")
    return given if isinstance(given, Config) else load(given)


def communicator(comm: Comm, scene: Scene) -> Comm:
    """The communicator that solves a scene: a mesh is one of MPI, on this process alone as
    elsewhere.
    """
    return mpi().COMM_SELF if scene.is_meshed and isinstance(comm, SerialComm) else comm


def mpi() -> Any:
    """mpi4py's MPI, which is up then; BackendError when it is missing."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise BackendError(f"mpi4py: {error}; `indent-sim doctor` says what is missing") from error
    return MPI


def _plot(directory: Path, report: dict[str, Any]) -> None:
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
