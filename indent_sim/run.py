"""The chain of one run: Config -> Scene -> Grid -> Problem -> State, State, ... -> Results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indent_sim import geometry
from indent_sim.checkpoint import Checkpoint
from indent_sim.comparison import memory, summary
from indent_sim.earlier import earlier_run
from indent_sim.error_bars import Companion, ErrorBars, beside, softer
from indent_sim.errors import BackendError, ConfigError, NotConverged, VerificationError
from indent_sim.folder import read_report, uninterrupted
from indent_sim.model.contact import Penalty
from indent_sim.model.indenters import Indenter
from indent_sim.model.quantities import scaled
from indent_sim.parallel import on_root
from indent_sim.record import Clock, Record
from indent_sim.refinement import check, entry, pursue, refuse_other_bars, unjudged
from indent_sim.resolved import left_open, resolved
from indent_sim.scene import Scene, resolve
from indent_sim.state import State
from indent_sim.stopping import unmasked

if TYPE_CHECKING:
    from indent_sim.config import Config

AUDIT_TOLERANCE = 1e-8  # contact integral against the supports' reactions, relative
AUDIT_FLOOR = 1e-6  # of the largest force so far: a body let go of has no force to compare with
MANY_STEPS = 100  # up to here `surface: last` is rewritten at every step, so that a killed run has it too
Progress = Callable[[State, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """A finished run: where it lies, what run.json says (rank 0), and its states in the user's units."""

    directory: Path
    report: dict[str, Any]
    states: list[State]
    resumed_after: int = 0  # this many rows were there already


def run(
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
    from indent_sim.config import located

    comm = comm if comm is not None else _alone()
    target = Path(directory or config.output.directory or "results/run")
    attempt = Attempt(config, comm, target, progress, resume, error_bars)
    try:
        outcome = pursue(attempt.resolve, attempt)
    except ConfigError as error:
        raise located(config, error) from None
    if config.output.plot:
        on_root(comm, _plot, target)
    return outcome


class Attempt:
    """One config simulated on one mesh, or on finer and finer ones, into the same folder."""

    def __init__(self, config: Config, comm: Any, target: Path, progress: Progress | None, resume: bool, bars: bool):
        self.config, self.comm, self.target, self.progress = config, comm, target, progress
        self.clock, self.count = Clock(), 0
        self._before = comm.bcast(on_root(comm, read_report, target)) if resume else {}
        self._resume = resume
        self._tried: list[float] = list((self._before.get("accuracy") or {}).get("tried", []))  # elements, in turn
        self._with_bars = bars or config.accuracy is not None or "error_budget" in self._before
        refuse_other_bars(self._before, config, self._with_bars, target)

    def resolve(self, elements: float | None = None) -> Scene:
        """The scene with that many elements in a contact radius, where `accuracy` leaves it open."""
        with self.clock.stage("resolve"):
            return resolve(self.config, elements or (self._before.get("accuracy") or {}).get("elements"))

    def __call__(self, scene: Scene, companions: Sequence[Companion]) -> Outcome:
        """Simulate a scene, with its error bars against companions; without any it makes its own."""
        from indent_sim.config import to_yaml

        config, decided = self.config, resolved(self.config, scene)
        resume = self._resume and self.count == 0
        self.count += 1
        if resume and (outcome := _finished(self.comm, self.target, to_yaml(decided), len(scene.deltas))):
            return outcome
        with Record(self.comm, self.target, to_yaml(decided), surface=config.output.surface, resume=resume,
                    force_error=self._with_bars) as record, unmasked():  # fmt: skip
            record.note(title=scene.title, units=scene.units, gap=scene.gap, method=scene.contact.method,
                        control=scene.path.control,
                        center=[c * scene.scales.length for c in scene.center],
                        plan={"choices": list(scene.choices), "prediction": scene.prediction, "scales": scene.scales,
                              "auto": left_open(config, decided)},
                        warnings=list(scene.warnings), ranks=self.comm.size,
                        memory_before_MB=round(memory(), 1))  # fmt: skip
            bars = self._bars(scene, companions) if self._with_bars else None
            if bars is not None:
                record.note(error_budget=bars.budgets, accuracy=scene.fineness and entry(scene.fineness, self._tried))
            simulation = Simulation(config, scene, record, self.clock, bars)
            states = simulation.follow(self.progress)
            simulation.release()
            if bars is not None:
                record.warn(*unjudged(scene, states, bars))
                self._tried += [scene.fineness.n] if scene.fineness else []
                check(self.resolve, scene, states, bars, len(self._tried))
        return Outcome(self.target, record.report, states, len(record.earlier.states) if record.earlier else 0)

    def _bars(self, scene: Scene, companions: Sequence[Companion]) -> ErrorBars:
        with self.clock.stage("imports"):
            _backend()
        with self.clock.stage("companions"):
            companions = companions or self._companions(scene)
            own = companions[0].scene
            soft = self._curve(softer(own)) if own is not None and isinstance(own.contact, Penalty) else None
            return ErrorBars(scene, companions, soft)

    def _companions(self, scene: Scene) -> list[Companion]:
        """Runs beside the first of this call; those of a resumed one begin with its earlier attempts, as before."""
        earlier = [self.resolve(elements) for elements in reversed(self._tried)]
        return [Companion(ratio, self._curve(other), other) for ratio, other in beside(scene, earlier)]

    def _curve(self, scene: Scene) -> list[State]:
        """The states of a scene without surface tables; what one failed to reach is missing."""
        return list(states(scene, self.comm, with_surface=False))


def _finished(comm: Any, target: Path, config_yaml: str, steps: int) -> Outcome | None:
    """The outcome of a run that came to its end before."""
    earlier = comm.bcast(on_root(comm, earlier_run, target, config_yaml))
    if earlier is None or not earlier.finished(steps):
        return None
    return Outcome(target, earlier.report, list(earlier.states), steps)


def states(scene: Scene, comm: Any = None, *, with_surface: bool = True) -> Iterator[State]:
    """Walk a scene without writing anything: one State per requested depth, in the user's units.

    For notebooks and tests; a State that is not converged is the last one.
    """
    fe = _backend()
    comm = comm if comm is not None else _alone()
    mesh = fe.distribute(on_root(comm, geometry.build, scene), scene, comm)
    for state in fe.walk(scene, mesh).states(scene.path, lambda step: with_surface):
        yield state.in_units(scene.scales)
    fe.release(mesh)


@dataclass(frozen=True)
class CondensedBody:
    """A linear body condensed to its contact surface: thousands of tips and depths, milliseconds each."""

    scene: Scene
    walk: Any

    @property
    def compliance(self) -> Any:
        """`fe.compliance.Compliance`: u_z = -C F between the nodes of the contact surface, in the scene's units."""
        return self.walk.contact.compliance

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
        L, P = self.scene.scales.length, self.scene.scales.pressure
        changes: dict[str, Any] = {}
        if indenter is not None:
            changes["indenter"] = scaled(indenter, L, P)
        if deltas is not None:
            changes |= {"deltas": tuple(delta / L for delta in deltas), "forces": None}
        if forces is not None:
            begin = max(*self.scene.deltas, 1e-3 * self.scene.body.height)  # of the search
            changes |= {"deltas": (begin,) * len(forces)}
            changes |= {"forces": tuple(force / self.scene.scales.force for force in forces)}
        scene = replace(self.scene, **changes)
        walk = self.walk.under(scene)
        return [state.in_units(scene.scales) for state in walk.states(scene.path, lambda step: False)]


def condense(scene: Scene, comm: Any = None) -> CondensedBody:
    """Factor a linear scene's body once and condense it (collective); see `CondensedBody`.

    Raises ConfigError when the scene is not one that condenses.
    """
    from mpi4py import MPI

    if scene.solver["method"] != "condensed":
        raise ConfigError("solver.method", "this scene does not condense", "linear elastic, reference gap, no Nitsche")
    fe = _backend()
    comm = comm or MPI.COMM_SELF
    return CondensedBody(scene, fe.walk(scene, fe.distribute(on_root(comm, geometry.build, scene), scene, comm)))


class Simulation:
    """A scene on its way through mesh, problem and load path; every converged state is on disk before the next."""

    def __init__(self, config: Config, scene: Scene, record: Record, clock: Clock, bars: ErrorBars | None):
        self.bars = bars
        self.output = config.output
        self.scene = scene
        self.record = record
        self.clock = clock
        earlier = record.earlier
        self.states: list[State] = [self._judged(state) for state in earlier.states] if earlier else []
        self._worst_audit = earlier.worst_audit if earlier else 0.0
        self._next_checkpoint = 0.0  # on the monotonic clock [s]
        self._assemble()

    def _assemble(self) -> None:
        record, scene, clock = self.record, self.scene, self.clock
        with clock.stage("imports"):
            fe = _backend()
        with clock.stage("mesh"):
            grid = on_root(record.comm, geometry.build, scene)
            self._mesh = mesh = fe.distribute(grid, scene, record.comm)
        with clock.stage("assemble"):
            spent = self.states[-1].wall_s if self.states else 0.0
            self._walk = fe.walk(scene, mesh, clock.started - spent)
        size = {"cells": len(grid.cells), "points": len(grid.points)} if grid is not None else {}
        record.note(dofs=self._walk.dofs, mesh={"hash": mesh.hash} | size, versions=fe.versions())
        self._identity = {"mesh": mesh.hash, "dofs": self._walk.dofs, "dolfinx": fe.versions()["dolfinx"]}
        earlier = (record.earlier.report.get("mesh") or {}).get("hash") if record.earlier else None
        if earlier not in (None, mesh.hash):
            other = f"steps 1 to {len(self.states)} were computed on another mesh (another version of gmsh?)"
            record.warn(other)
        self._take_up()
        wanted = self.output.fields != "none" and len(self.states) < len(scene.deltas)
        self._fields = fe.Fields(self._walk.observed) if wanted else None
        if self._fields is not None:
            points, cells = (grid.points * scene.scales.length, grid.cells) if grid is not None else (None, None)
            steps = len(scene.deltas) if self.output.fields == "all" else 1
            record("open_fields", points, cells, keep=self.output.fields, steps=steps)

    def _take_up(self) -> None:
        """Stand where the run that is continued stopped."""
        done, comm = len(self.states), self.record.comm
        if done in (0, len(self.scene.deltas)):
            return
        saved = self.record("read_checkpoint", self._identity) if comm.size == 1 else Checkpoint()
        with self.clock.stage("resume"):
            if not self._walk.resume(saved.points, self._depths()[saved.step :]):
                depth = f"delta = {self.states[-1].delta:.6g}"
                raise NotConverged(f"the last row's {depth} was not reached again: {self._walk.failure}")

    def _depths(self) -> tuple[float, ...]:
        """The depths of the rows that are there, in the scene's units."""
        if self.scene.path.control == "depth":
            return self.scene.deltas[: len(self.states)]
        return tuple(state.delta / self.scene.scales.length for state in self.states)

    def _save_checkpoint(self, now: bool = False) -> None:
        """Keep the last equilibria; at most once a second and for a twentieth of the time, unless it must be `now`."""
        began = time.monotonic()
        if not self.states or not (now or began >= self._next_checkpoint):
            return
        if points := self._walk.points:
            self.record("save_checkpoint", Checkpoint(len(self.states), points), self._identity)
            ended = time.monotonic()
            self._next_checkpoint = ended + max(1.0, 20 * (ended - began))

    def follow(self, progress: Progress | None) -> list[State]:
        """Walk the load path to its end; NotConverged or VerificationError where it stops before."""
        total, done = len(self.scene.deltas), len(self.states)
        if progress is not None and self.states:
            progress(self.states[-1], done, total)
        try:
            for state in self._timed(self._walk.states(self.scene.path, self._wants_surface, done)):
                if not state.converged:
                    raise NotConverged(f"step {state.step} of {total}: {state.reason}")
                self._keep(state.in_units(self.scene.scales), state.step == total)
                if progress is not None:
                    progress(self.states[-1], state.step, total)
        except (NotConverged, KeyboardInterrupt) as end:
            # a signal reaches the ranks one by one: only a failure is known to all of them
            if isinstance(end, NotConverged) or self.record.comm.size == 1:
                self._save_checkpoint(now=True)
                self._save_last_fields()
            raise
        finally:
            self.record.note(**summary(self.scene, self.states, self.clock.stages, self.clock.cpu, self._worst_audit))
        return self.states

    def release(self) -> None:
        """Give the memory of the solution back (collective); a process may have many runs before it."""
        self._walk = self._fields = None
        _backend().release(self._mesh)

    def _wants_surface(self, step: int) -> bool:
        total = len(self.scene.deltas)
        return self.output.surface == "all" or (
            self.output.surface == "last" and (total <= MANY_STEPS or step == total)
        )

    def _timed(self, states: Iterator[State]) -> Iterator[State]:
        while True:
            with self.clock.stage("solve"):
                state = next(states, None)
            if state is None:
                return
            yield state

    def _judged(self, state: State) -> State:
        return state if self.bars is None else self.bars.judged(state)

    def _keep(self, state: State, last: bool) -> None:
        """Audit a converged state and write it down."""
        self._audit(state)
        state = self._judged(state)
        if state.newton_iterations > 0:  # out of contact nothing is solved, and no option asked for
            self._walk.refuse_unused_options()
        with self.clock.stage("write"):
            if self.output.fields == "all" or last:
                self._write_fields(state)
            self.record("append", state)
            self.states.append(state)
            if not last:
                self._save_checkpoint()

    def _audit(self, state: State) -> None:
        largest = max([abs(state.force), *(abs(earlier.force) for earlier in self.states)])
        size = max(abs(state.force), abs(state.reaction), AUDIT_FLOOR * largest)
        difference = abs(state.force - state.reaction) / size if size > 0 else 0.0
        stray = state.stray_reaction / size if size > 0 else 0.0
        self._worst_audit = max(self._worst_audit, difference, stray)
        if not max(difference, stray) <= AUDIT_TOLERANCE:
            raise VerificationError(
                f"step {state.step} failed its audit: contact force {state.force:.10g}, reaction of the supports "
                f"{state.reaction:.10g}, largest reaction of the rigid-mode pins {state.stray_reaction:.3g}; "
                f"they must agree to {AUDIT_TOLERANCE:g}"
            )

    def _write_fields(self, state: State) -> None:
        if self._fields is None:
            return
        L, P = self.scene.scales.length, self.scene.scales.pressure
        self._walk.return_to_row()
        displacement, stress, pressure = self._fields.gather() or (None, None, None)
        if displacement is not None and stress is not None and pressure is not None:
            displacement, stress, pressure = displacement * L, stress * P, pressure * P
        self.record("write_fields", state, displacement, stress, pressure)

    def _save_last_fields(self) -> None:
        if self.states and self.output.fields == "last":
            self._write_fields(self.states[-1])


def warm_up() -> None:
    """Load what every run needs, so that the first of many costs no more than the others."""
    _backend()
    geometry.load()


def _alone() -> Any:
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        raise BackendError(f"mpi4py: {error}; `indent-sim doctor` says what is missing") from error
    return MPI.COMM_SELF


def _backend() -> Any:
    try:
        with uninterrupted():  # a signal inside an import would look like a missing library
            from indent_sim.fe import solver
    except ImportError as missing:
        raise BackendError(f"{missing}; `indent-sim doctor` says what is missing") from missing
    return solver


def _plot(directory: Path) -> None:
    from indent_sim import plots

    plots.plot_run(directory)
