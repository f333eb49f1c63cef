"""The chain of one run: Config -> Scene -> Grid -> BodyMesh -> State, State, ... -> files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indent_sim.mesh import gmsh
from indent_sim.mesh.piece import Piece
from indent_sim.model.body import MeshFromFile
from indent_sim.model.contact import Penalty
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import EFFORT, ERRORS, State
from indent_sim.model.tips import Indenter
from indent_sim.process.errors import BackendError, ConfigError, VerificationError
from indent_sim.process.limits import spent
from indent_sim.process.ranks import Alone, on_root
from indent_sim.process.signals import unmasked
from indent_sim.process.usage import Clock, memory
from indent_sim.results.reader import checked_report, earlier_run, lost_files
from indent_sim.results.tables import EXPERIMENT
from indent_sim.run.accuracy import Attempt, attempts, entry, refuse_other_bars, unjudged
from indent_sim.run.by_theory import TheoryWalk
from indent_sim.run.error_bars import Bars, Companion, ErrorBars, TheoryBars, beside, softer, sticks, ways
from indent_sim.run.readings import Readings
from indent_sim.run.record import Record
from indent_sim.run.resolved import left_open, mesh_text, resolved
from indent_sim.run.simulation import Progress, Simulation, backend
from indent_sim.run.summary import stages
from indent_sim.scene.given import mapped_skin, piece_of
from indent_sim.scene.scene import Scene, resolve

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, OutputSettings


@dataclass(frozen=True)
class Outcome:
    """A finished run: where it lies, what run.json says (rank 0), and its states in the user's units."""

    directory: Path
    report: dict[str, Any]
    states: list[State]
    resumed_after: int = 0  # this many rows were there already


def simulate(
    config: Config,
    comm: Any = None,
    *,
    directory: Path | None = None,
    progress: Progress | None = None,
    resume: bool = False,
    error_bars: bool = False,
) -> Outcome:
    """Simulate a config and write its result folder (collective over `comm` [this process alone], files by rank 0).

    With `resume` the rows of an earlier run of the same config stay, and the others are computed. With `error_bars`,
    or `accuracy` in the config, every row has its force_error; `accuracy` refines the mesh until it is small enough.
    Raises ConfigError, UsageError, MeshError, NotConverged, VerificationError, BackendError; what was computed
    before a failure is on disk.
    """
    from indent_sim.config.file import located

    comm = comm if comm is not None else Alone()
    target = Path(directory or config.output.directory or "results/run")
    try:
        outcome = Run(config, comm, target, progress, resume, error_bars).outcome()
    except ConfigError as error:
        raise located(config, error) from None
    if config.output.plot:
        on_root(comm, _plot, target)
    return outcome


class Run:
    """One config simulated on one mesh, or on finer and finer ones, into the same folder."""

    def __init__(self, config: Config, comm: Any, target: Path, progress: Progress | None, resume: bool, bars: bool):
        self.config, self.comm, self.target, self.progress = config, comm, target, progress
        self._resume, self._clock = resume, Clock()
        self._before = comm.bcast(on_root(comm, checked_report, target)) if resume else {}
        self._with_bars = bars or config.accuracy is not None or "error_budget" in self._before
        asked = bars or ("error_budget" in self._before and config.accuracy is None)
        self._with_stick = asked or "stick" in self._before
        refuse_other_bars(self._before, config, self._with_bars, target)
        with self._clock.stage("resolve"), spent():
            self._piece = body_from_file(config, comm)

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
        with self._clock.stage("resolve"):
            return resolve(self.config, elements, self._piece)

    def _outcome(self, attempt: Attempt) -> Outcome:
        """Simulate an attempt, with its error bars, and judge it."""
        from indent_sim.config.file import to_yaml

        config, scene, decided = self.config, attempt.scene, resolved(self.config, attempt.scene)
        self.comm = communicator(self.comm, scene)
        resume = self._resume and not attempt.companions  # only the first one
        if resume and (outcome := _finished(self.comm, self.target, to_yaml(decided), scene, decided.output)):
            return outcome
        with Record(self.comm, self.target, to_yaml(decided), surface=config.output.surface, resume=resume,
                    columns=(*scene.physics.columns, *self._columns(scene)),
                    mesh=mesh_text(config, self._piece)) as record, unmasked(), spent():  # fmt: skip
            physics, plan = scene.physics, scene.plan
            said = {"choices": list(plan.choices), "prediction": plan.prediction, "scales": physics.scales,
                    "auto": left_open(config, decided)}  # fmt: skip
            record.note(title=plan.title, units=plan.units, gap=physics.gap, method=scene.method,
                        control=physics.path.control, center=[c * physics.scales.length for c in physics.center],
                        plan=said, warnings=list(plan.warnings), ranks=self.comm.size,
                        memory_before_MB=round(memory(), 1))  # fmt: skip
            bars = self._bars(attempt) if self._with_bars else None
            if bars is not None:
                record.note(error_budget=bars.budgets, accuracy=entry(config, plan.fineness, attempt.tried))
            simulation = Simulation(config, scene, record, self._clock, bars)
            states = simulation.follow(self.progress)
            simulation.experiment()
            simulation.release()
            if bars is not None:
                record.warn(*unjudged(scene, states, bars))
                attempt.judge(self._resolved, states, bars)
                if self._with_stick and attempt.following is None:
                    stick = self._stick(Companion(1.0, states, scene), bars)
                    record.note(stick=stick, timings=stages(self._clock.stages))
            if attempt.missed:
                record.fail(VerificationError(attempt.missed))
        return Outcome(self.target, record.report, states, len(record.earlier.states) if record.earlier else 0)

    def _columns(self, scene: Scene) -> tuple[str, ...]:
        """Columns that apply to the scene: of its linear solver, and of the error bars.

        The depth has one where it is found, not given.
        """
        effort = EFFORT if scene.solver.linear == "iterative" else ()
        finds_depths = scene.physics.path.control == "force"
        bars = ERRORS if self._with_bars else ()
        return (*effort, *(name for name in bars if finds_depths or name != "delta_error"))

    def _bars(self, attempt: Attempt) -> Bars:
        if not attempt.scene.is_meshed:
            return TheoryBars(attempt.scene)
        with self._clock.stage("imports"):
            backend()
        with self._clock.stage("companions"):
            companions = attempt.companions or self._companions(attempt)
            own = companions[0].scene
            soft = self._curve(softer(own)) if own is not None and isinstance(own.physics.contact, Penalty) else None
            return ErrorBars(attempt.scene, companions, soft, ways(companions[0], self._curve))

    def _stick(self, run: Companion, bars: Bars) -> dict[str, Any] | None:
        """What no slip would change of the deepest force: as the plan knows it, or solved beside the run, in three
        dimensions on a coarser mesh."""
        scene = run.scene
        assert scene is not None
        with self._clock.stage("companions"):
            where = run if scene.physics.part.dim == 2 or not bars.companions else bars.companions[0]
            found = sticks(where, self._curve) if scene.is_meshed else scene.plan.stick
        return asdict(found) | {"words": found.words} if found else None

    def _companions(self, attempt: Attempt) -> list[Companion]:
        """Runs beside the first attempt; those of a resumed one begin with its earlier attempts, as before."""
        earlier = [self._resolved(elements) for elements in reversed(attempt.tried)]
        return [Companion(ratio, self._curve(other), other) for ratio, other in beside(attempt.scene, earlier)]

    def _curve(self, scene: Scene) -> list[State]:
        """The states of a scene without surface tables; what one failed to reach is missing."""
        return list(states(scene, self.comm, with_surface=False))


def body_from_file(config: Config, comm: Any) -> Piece | None:
    """The body of the config's mesh file, None where it names none (collective).

    On several ranks rank 0 reads the file, has its arrays mapped, and all know the skin of the body.
    """
    if not isinstance(config.body, MeshFromFile):
        return None
    if comm.size == 1:
        return piece_of(config, config.body)
    skin = on_root(comm, mapped_skin, config, config.body)
    known = comm.bcast(replace(skin, whole=None) if skin else None, root=0)
    return skin or known


def _finished(comm: Any, target: Path, config_yaml: str, scene: Scene, output: OutputSettings) -> Outcome | None:
    """The outcome of a run that came to its end before; UsageError when its rows are of another path.

    It stays as it is; what has become of its files since is among its warnings.
    """
    earlier = comm.bcast(on_root(comm, earlier_run, target, config_yaml))
    if earlier is None:
        return None
    physics, steps = scene.physics, len(scene.physics.deltas)
    depths = [delta * physics.scales.depth for delta in physics.deltas]
    earlier.check(depths if physics.path.control == "depth" else None, steps, target)
    if not earlier.finished(steps):
        return None
    lost = comm.bcast(on_root(comm, lost_files, target, output.surface != "none", output.fields != "none"))
    if scene.experiment is not None and not comm.bcast(on_root(comm, (target / EXPERIMENT).exists)):
        lost = [*lost, EXPERIMENT]
    said = [f"{', '.join(lost)}: missing or damaged since; leave --resume out to compute them again"] if lost else []
    report = earlier.report | {"warnings": [*earlier.report.get("warnings", []), *said]}
    return Outcome(target, report, list(earlier.states), steps)


def states(scene: Scene, comm: Any = None, *, with_surface: bool = True) -> Iterator[State]:
    """Walk a scene without writing anything: one State per requested depth, in the user's units.

    For notebooks and tests; a State that is not converged is the last one.
    """
    comm = communicator(comm if comm is not None else Alone(), scene)
    if not scene.is_meshed:
        walk = TheoryWalk(scene, comm)
        readings = Readings(scene)
        yield from (readings.read(state).in_units(scene.physics.scales)
                    for state in walk.states(scene.physics.path, lambda step: with_surface))  # fmt: skip
        return
    fe = backend()
    mesh = fe.distribute(on_root(comm, gmsh.build, scene.physics.part, scene.sizes), scene.physics.part, comm)
    walk = fe.walk(scene, mesh)
    readings = Readings(scene, walk.equilibrium)
    for state in walk.states(scene.physics.path, lambda step: with_surface):
        yield readings.read(state).in_units(scene.physics.scales)
    del walk, readings  # what dies after the release stays
    fe.release(mesh)


@dataclass(frozen=True)
class CondensedBody:
    """A linear body condensed to its contact surface: thousands of tips and depths, milliseconds each."""

    scene: Scene
    equilibrium: Any

    @property
    def compliance(self) -> Any:
        """`fe.condensed.compliance.Compliance`: u_z = -C F between nodes of the contact surface, without units."""
        return self.equilibrium.contact.compliance

    def states(
        self,
        indenter: Indenter | None = None,
        deltas: Sequence[float] | None = None,
        forces: Sequence[float] | None = None,
    ) -> list[State]:
        """Press another tip, or to other depths or forces, all in the user's units; one State each, without surface
        tables.

        The mesh stays: it must be fine enough for this contact too. ValueError when both depths and forces are given.
        """
        if deltas is not None and forces is not None:
            raise ValueError("give depths or forces, not both")
        changes: dict[str, Any] = {}
        if indenter is not None:
            changes["indenter"] = self.scene.physics.scales.scaled(indenter)
        if deltas is not None:
            values = tuple(delta / self.scene.physics.scales.depth for delta in deltas)
            changes |= {"deltas": values, "path": LoadPath("depth", values)}
        if forces is not None:
            begin = max(*self.scene.physics.deltas, 1e-3 * self.scene.physics.body.height)  # of the search
            values = tuple(force / self.scene.physics.scales.force for force in forces)
            changes |= {"deltas": (begin,) * len(forces), "path": LoadPath("force", values)}
        scene = self.scene.with_physics(**changes)
        equilibrium = self.equilibrium.under(scene)
        readings, states = Readings(scene, equilibrium), backend().Walk(equilibrium).states(scene.physics.path, _never)
        return [readings.read(state).in_units(scene.physics.scales) for state in states]


def condense(scene: Scene, comm: Any = None) -> CondensedBody:
    """Factor a linear scene's body once and condense it (collective); see `CondensedBody`.

    Raises ConfigError when the scene is not one that condenses.
    """
    if scene.solver.method != "condensed":
        raise ConfigError("solver.method", "this scene does not condense", "linear elastic, reference gap, no Nitsche")
    fe = backend()
    comm = comm if comm is not None else mpi().COMM_SELF
    mesh = fe.distribute(on_root(comm, gmsh.build, scene.physics.part, scene.sizes), scene.physics.part, comm)
    return CondensedBody(scene, fe.equilibrium(scene, mesh))


def warm_up() -> None:
    """Load what every run needs, so that the first of many costs no more than the others."""
    gmsh.start()
    backend()


def communicator(comm: Any, scene: Scene) -> Any:
    """The communicator that solves a scene: a mesh is one of MPI, on this process alone as elsewhere."""
    return mpi().COMM_SELF if scene.is_meshed and isinstance(comm, Alone) else comm


def mpi() -> Any:
    """mpi4py's MPI, which is up then; BackendError when it is missing."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise BackendError(f"mpi4py: {error}; `indent-sim doctor` says what is missing") from error
    return MPI


def _never(step: int) -> bool:
    return False


def _plot(directory: Path) -> None:
    from indent_sim.results.pictures import experiment, forces

    forces.plot_run(directory)
    if (directory / EXPERIMENT).exists():
        experiment.plot_experiment(directory)
