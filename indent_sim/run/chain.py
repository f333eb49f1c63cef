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

from indent_sim.config.scene_file import Given, load, to_yaml
from indent_sim.config.schema import Config, OutputSettings
from indent_sim.model.body import MeshFromFile
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import ERROR_COLUMNS, KRYLOV_COLUMNS, STATE_COLUMNS, State
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import BackendError, ConfigError, VerificationError
from indent_sim.process.limits import spent
from indent_sim.process.ranks import Alone, on_root
from indent_sim.process.signals import unmasked
from indent_sim.process.usage import Clock, memory
from indent_sim.results.folder import asked_from, read_report
from indent_sim.results.reader import begun_report, earlier_run, lost_files, read
from indent_sim.results.tables import EXPERIMENT
from indent_sim.run.companions.accuracy import (
    Asked,
    Attempt,
    asked_in,
    attempts,
    entry,
    foreseen,
    refuse_other_bars,
    unjudged,
)
from indent_sim.run.companions.companion import Companion, beside, in_slower_bath, softer
from indent_sim.run.companions.drained_film import film_of
from indent_sim.run.companions.error_bars import Bars, ErrorBars, TheoryBars, ways
from indent_sim.run.companions.remedies import are_tried, remedies, tried
from indent_sim.run.companions.sticking import bearer, sticks
from indent_sim.run.plausibility import long_steps, rough, unresolved
from indent_sim.run.prospect import all_mistakes
from indent_sim.run.readings import Equilibrium, Readings
from indent_sim.run.record import Beside, Comm, Record, amend
from indent_sim.run.resolved import left_open, resolved
from indent_sim.run.simulation import Progress, Simulation, backend
from indent_sim.run.summary import stages
from indent_sim.run.walks.by_curve import BARS, CurveWalk
from indent_sim.run.walks.by_theory import TheoryWalk
from indent_sim.scene.problem_setup import read_imported_mesh
from indent_sim.scene.resolution import target_error
from indent_sim.scene.scene import Mesher, Scene, resolve, start_mesher

Floats = Sequence[float]
TOLD_EVERY = 30.0  # s between lines about a run beside this one
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
    given: Given,
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
    comm = comm if comm is not None else Alone()
    config = config_of(given)
    target = Path(directory or config.output.directory or "results/run")
    try:
        outcome = Run(
            config, scene, comm, target, progress, resume, error_bars, overwrite
        ).outcome()
    except ConfigError as error:
        raise all_mistakes(error, config) from None
    if config.output.plot:
        on_root(comm, _plot, target, outcome.report)
    return outcome


class Run:
    """One config simulated on one mesh, or on finer and finer ones, into the same folder."""

    def __init__(
        self,
        config: Config,
        scene: Scene | None,
        comm: Comm,
        target: Path,
        say: Progress | None,
        resume: bool,
        bars: bool,
        overwrite: bool,
    ):
        self.config = config
        self.comm = comm
        self.target = target
        self.progress = say
        self._scene = scene
        self._resume = resume
        self._overwrite = overwrite
        self._clock = Clock()
        self._before = comm.bcast(on_root(comm, begun_report, target)) if resume else {}
        before = asked_in(self._before)
        self._asked = Asked(bars or before.error_bars, target_error(config.accuracy))
        if self._before:
            refuse_other_bars(before, self._asked, target)
        self._beside = Beside()
        with self._clock.stage("resolve"), spent():
            self._piece = read_imported_mesh(config, comm)

    def outcome(self) -> Outcome:
        """What the last attempt came to; VerificationError when it is not as accurate as asked for."""
        known = self._before.get("accuracy") or {}
        for attempt in attempts(self._resolved, known.get("elements"), known.get("tried", ())):
            outcome = self._outcome(attempt)
        if attempt.missed:
            raise VerificationError(attempt.missed)
        return outcome

    def _resolved(self, elements: float | None) -> Scene:
        """The scene with that many elements in a contact radius, where `accuracy` leaves it open."""
        if (
            elements is None and self._scene is not None and self._piece is None
        ):  # a mesh file may have changed since
            return self._scene
        with self._clock.stage("resolve"):
            return resolve(self.config, elements, self._piece)

    def _outcome(self, attempt: Attempt) -> Outcome:
        """Simulate an attempt, with its error bars, and judge it."""
        config = self.config
        scene = attempt.scene
        decided = resolved(self.config, attempt.scene)
        self.comm = communicator(self.comm, scene)
        resume = self._resume and attempt.companion is None  # only the first one
        whole = scene if attempt.companion else foreseen(scene, self._asked.error_bars)
        said = self._said(scene, decided, whole.plan.prediction)
        text = to_yaml(decided)
        if resume and (outcome := self._finished(text, scene, decided.output, said)):
            return outcome
        columns = (*scene.columns, *self._columns(scene))
        body = config.body
        mesh = self._piece.text(body) if self._piece and isinstance(body, MeshFromFile) else ()
        folder = {"columns": columns, "guard": not self._overwrite, "resume": resume}
        opened = Record(
            self.comm, self.target, text, said, surface=config.output.surface, mesh=mesh, **folder
        )
        with opened as record, unmasked(), spent():
            plan = scene.plan
            self._beside = record.beside
            bars = self._bars(attempt) if self._asked.bars else None
            if bars is not None:
                record.note(
                    error_budget=bars.budgets,
                    accuracy=entry(config, plan.resolution, attempt.tried),
                )
            simulation = Simulation(
                config, scene, record, self._clock, bars, partial(self._remedies, scene)
            )
            states = simulation.follow(self.progress)
            simulation.experiment()
            judged = simulation.judged
            simulation.release()
            record.warn(*rough(scene, judged))
            if bars is None:
                record.warn(*unresolved(scene, states), *long_steps(scene, states))
            else:
                record.warn(*unjudged(scene, judged, bars))
                attempt.judge(self._resolved, judged, bars)
                if self._asked.error_bars and attempt.following is None:
                    run = Companion(1.0, judged, scene)
                    stick = self._beside(
                        "what no slip would change", lambda: self._stick(run, bars), None
                    )
                    record.note(stick=stick, timings=stages(self._clock.stages))
            if attempt.missed:
                record.fail(VerificationError(attempt.missed))
        return Outcome(
            self.target, record.report, states, len(record.earlier.states) if record.earlier else 0
        )

    def _remedies(self, scene: Scene, step: int, spent: int) -> str:
        """What was tried where a path ended early, and how far it came, in words; by one process
        alone.
        """
        if self.comm.size > 1 or not are_tried(scene):
            return ""
        walk = partial(states, with_surface=False)
        return tried(remedies(self.config, scene), step, spent, resolve, walk)

    def _finished(
        self, text: str, scene: Scene, output: OutputSettings, said: dict[str, Any]
    ) -> Outcome | None:
        """The outcome of a run that came to its end before, with what its files lack since among
        its warnings.
        """
        comm = self.comm
        target = self.target
        earlier = comm.bcast(on_root(comm, earlier_run, target, text, said))
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
        lost = comm.bcast(on_root(comm, lost_files, target, surface, output.fields))
        is_said = EXPERIMENT in (earlier.report.get("missing") or ())
        has_table = scene.experiment is not None and scene.history_on_curve is None
        if has_table and not (is_said or comm.bcast(on_root(comm, (target / EXPERIMENT).exists))):
            lost = [*lost, EXPERIMENT]
        again = "missing or damaged since; leave --resume out to compute them again"
        told = [f"{', '.join(lost)}: {again}"] if lost else []
        report = earlier.report | {"warnings": [*earlier.report.get("warnings", []), *told]}
        return Outcome(target, report, list(earlier.states), steps)

    def _said(self, scene: Scene, decided: Config, prediction: dict[str, float]) -> dict[str, Any]:
        """What run.json says from the beginning."""
        physics = scene.physics
        plan = scene.plan
        asked = asdict(self._asked) | asked_from(self.config.source.name, self.target)
        said = {
            "asked": asked,
            "title": plan.title,
            "units": plan.units,
            "gap": physics.gap,
            "method": scene.method,
        }
        center = [c * physics.scales.length for c in physics.center]
        auto = left_open(self.config, decided)
        planned = {
            "choices": list(plan.choices),
            "prediction": prediction,
            "scales": physics.scales,
            "auto": auto,
        }
        if plan.time and physics.path.times:
            said["time"] = plan.time.report
        said |= {
            "control": physics.path.control,
            "center": center,
            "plan": planned,
            "warnings": list(plan.warnings),
        }
        return said | {"ranks": self.comm.size, "memory_before_MB": round(memory(), 1)}

    def _columns(self, scene: Scene) -> tuple[str, ...]:
        """Columns that apply to the scene: of its linear solver, and the error bars of what it
        finds.
        """
        effort = KRYLOV_COLUMNS if scene.solver.linear == "iterative" else ()
        given = {"delta"} if scene.physics.path.control == "depth" else set()
        found = (
            BARS.values() if scene.history_on_curve else (*STATE_COLUMNS, *scene.physics.columns)
        )
        judged = {*found} - given if self._asked.bars else set[str]()
        errors = (name for name in ERROR_COLUMNS if name.removesuffix("_error") in judged)
        reactions = scene.reaction_columns if self.config.output.reactions else ()
        return (*effort, *errors, *reactions)

    def _bars(self, attempt: Attempt) -> Bars:
        if not attempt.scene.is_meshed:
            return TheoryBars(attempt.scene)
        with self._clock.stage("imports"):
            backend()
        with self._clock.stage("companions"):
            companion = attempt.companion
            if companion is None:  # that of a resumed run is its earlier attempt, as before
                earlier = self._resolved(attempt.tried[-1]) if attempt.tried else None
                ratio, other = beside(attempt.scene, earlier)
                companion = Companion(ratio, self._curve(other), other)
            soft = softer(companion.scene) if companion.scene else None
            curve = self._curve(soft) if soft else None
            in_halves = ways(companion, self._curve)
            slower = in_slower_bath(companion.scene) if companion.scene else None
            bath = self._curve(slower) if slower else None
            film = film_of(attempt.scene, self._curve)
            return ErrorBars(attempt.scene, companion, curve, in_halves, film, bath)

    def _stick(self, run: Companion, bars: Bars) -> dict[str, Any] | None:
        """What no slip would change of the deepest force: as the plan knows it, or solved beside
        the run.
        """
        assert run.scene is not None
        with self._clock.stage("companions"):
            known = run.scene.plan.stick
            changed = (
                sticks(bearer(run, bars.companion), self._curve) if run.scene.is_meshed else known
            )
        return asdict(changed) | {"words": changed.sentence} if changed else None

    def _curve(self, scene: Scene) -> list[State]:
        """The elastic states of a scene without surface tables; what one failed to reach is
        missing, all where it ended.
        """
        elastic = replace(scene, history_on_curve=None)
        total = len(elastic.physics.deltas)

        def followed() -> list[State]:
            found = []
            told = time.monotonic()
            for state in states(elastic, self.comm, with_surface=False):
                found.append(state)
                if (now := time.monotonic()) - told > TOLD_EVERY:
                    log.info("beside this run, for its error bars: step %d/%d", len(found), total)
                    told = now
            return found

        return self._beside("a run beside this one", followed, [])


def states(
    given: Scene | Given,
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
    comm = communicator(comm if comm is not None else Alone(), scene)
    beside = Beside(comm)
    fe = backend() if scene.is_meshed else None
    part = scene.physics.domain
    mesh = fe and fe.distribute(on_root(comm, mesher, scene), part, comm)
    walk: Any = fe.walk(scene, mesh) if fe else TheoryWalk(scene, comm)
    readings = Readings(scene, walk.equilibrium if fe else None, beside)
    if scene.history_on_curve:
        walk = CurveWalk(scene, walk)
        walk.solve()
    is_through = False
    try:
        for state in walk.states(scene.physics.path, lambda step: with_surface):
            yield (state if scene.history_on_curve else readings.read(state)).in_units(
                scene.physics.scales
            )
        is_through = True
    finally:
        del walk, readings  # what dies after the release stays
        # Several ranks release together: one that leaves early does not know whether the others do.
        # At the end of the process PETSc is gone before the last of Python's objects are
        if is_through or (comm.size == 1 and not sys.is_finalizing()):
            beside.meeting.free()
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
            scene = scene.replace_physics(indenter=scales.scaled(indenter))
        if deltas is not None:
            values = tuple(delta / scales.depth for delta in deltas)
            scene = scene.replace_physics(deltas=values, path=LoadPath("depth", values))
        if forces is not None:
            begin = max(*physics.deltas, 1e-3 * physics.body.height)  # of the search
            values = tuple(force / scales.force for force in forces)
            scene = scene.replace_physics(
                deltas=(begin,) * len(forces), path=LoadPath("force", values)
            )
        equilibrium = self.equilibrium.under(scene)
        readings = Readings(scene, equilibrium)
        walk = backend().Walk(equilibrium)
        states = walk.states(scene.physics.path, lambda step: False)
        return [readings.read(state).in_units(scene.physics.scales) for state in states]


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
    while _left:
        fe.release(_left.pop())
    mesh = fe.distribute(on_root(comm, scene.grid), scene.physics.domain, comm)
    body = CondensedBody(scene, fe.equilibrium(scene, mesh))
    if comm.size == 1:  # several ranks need not let go of it at the same time
        weakref.finalize(body, _left.append, mesh).atexit = False
    return body


_left: list[
    Any
] = []  # meshes of condensed bodies that are gone: what PETSc keeps of them goes with the next one


def warm_up() -> None:
    """Load what every run needs, so that the first of many costs no more than the others."""
    start_mesher()
    backend()


def config_of(given: Given) -> Config:
    """The config of a scene, however it is given; TypeError for what `resolve` has made of one."""
    if isinstance(given, Scene):
        raise TypeError("give what `load` gives, not what `resolve` made of it")
    return given if isinstance(given, Config) else load(given)


def communicator(comm: Comm, scene: Scene) -> Comm:
    """The communicator that solves a scene: a mesh is one of MPI, on this process alone as
    elsewhere.
    """
    return mpi().COMM_SELF if scene.is_meshed and isinstance(comm, Alone) else comm


def mpi() -> Any:
    """mpi4py's MPI, which is up then; BackendError when it is missing."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise BackendError(f"mpi4py: {error}; `indent-sim doctor` says what is missing") from error
    return MPI


def _plot(directory: Path, report: dict[str, Any]) -> None:
    from indent_sim.results.pictures import canvas, experiment, panels

    draw = amend(directory, report)
    picture = directory / canvas.FORCE_PICTURE
    draw(
        picture.name,
        lambda: panels.draw_results([read(directory, read_report(directory))], picture),
        None,
    )
    if experiment.is_there(directory, report):
        draw(experiment.EXPERIMENT_PICTURE, lambda: experiment.draw(directory), None)
