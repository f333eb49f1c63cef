"""One scene on its way through mesh, problem and load path, every state on disk before the next."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from indent_sim.fe.environment import load_dolfinx
from indent_sim.mesh import gmsh
from indent_sim.mesh.grid import Grid
from indent_sim.model.state import State
from indent_sim.process.errors import BackendError, NotConverged, VerificationError
from indent_sim.process.ranks import Meeting, on_root
from indent_sim.process.signals import uninterrupted
from indent_sim.process.usage import Clock
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.outline import drawn_width, outline
from indent_sim.run.by_theory import TheoryWalk
from indent_sim.run.error_bars import Bars
from indent_sim.run.plausibility import contradiction
from indent_sim.run.readings import Readings
from indent_sim.run.record import Record
from indent_sim.run.resolved import fields_of
from indent_sim.run.summary import stages, summary
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


AUDIT_TOLERANCE = 1e-8  # contact integral against the supports' reactions, relative
# Of the largest force so far: a body let go of has no force to compare with, only what Newton takes for round-off,
# 1e-14 of the largest reactions (fe/solve/newton.py), which over 1e4 nodes adds up to 1e-12 of them at most
AUDIT_FLOOR = 1e-4
MANY_STEPS = 100  # up to here `surface: last` is rewritten at every step, so that a killed run has it too

Progress = Callable[[State, int, int], None]


class Simulation:
    """A scene on its way through mesh, problem and load path; every converged state is on disk before the next."""

    def __init__(self, config: Config, scene: Scene, record: Record, clock: Clock, bars: Bars | None):
        self.bars = bars
        self.output = config.output
        self.scene = scene
        self.record = record
        self._meeting = Meeting(record.comm)
        self.clock = clock
        earlier = record.earlier
        self.states: list[State] = [self._judged(state) for state in earlier.states] if earlier else []
        self._keep_fields = fields_of(config, scene)
        self._kept_steps = scene.physics.path.kept
        self._worst_audit = earlier.worst_audit if earlier else 0.0
        self._next_checkpoint = 0.0  # on the monotonic clock [s]
        self._assemble()

    def _assemble(self) -> None:
        if not self.scene.is_meshed:
            spent = self.states[-1].wall_s if self.states else 0.0
            self._walk: Any = TheoryWalk(self.scene, self.record.comm, self.clock.started - spent)
            self._readings: Any = Readings(self.scene)
            self._fields = self._mesh = None
            return
        record, scene, clock = self.record, self.scene, self.clock
        part = scene.physics.part
        answer: Any = on_root(record.comm, gmsh.begin, part, scene.sizes)  # it is meshed while the libraries load
        with clock.stage("imports"):
            fe = backend()
        with clock.stage("mesh"):
            grid = on_root(record.comm, answer)
            self._mesh = mesh = fe.distribute(grid, part, record.comm)
        with clock.stage("assemble"):
            spent = self.states[-1].wall_s if self.states else 0.0
            self._walk = fe.walk(scene, mesh, clock.started - spent)
        self._readings = Readings(scene, self._walk.equilibrium)
        dofs, versions = self._walk.equilibrium.dofs, fe.versions()
        if grid is not None:  # rank 0, which writes
            size = {"cells": len(grid.cells), "points": len(grid.points)}
            record.note(dofs=dofs, mesh={"hash": mesh.hash} | size, versions=versions | {"gmsh": grid.gmsh})
        self._identity = {"mesh": mesh.hash, "dofs": dofs, "dolfinx": versions["dolfinx"], "order": "of the grid"}
        earlier = (record.earlier.report.get("mesh") or {}).get("hash") if record.earlier else None
        if earlier not in (None, mesh.hash):
            record.warn(f"steps 1 to {len(self.states)} were computed on another mesh (another version of gmsh?)")
        self._take_up()
        wanted = self._keep_fields != "none" and len(self.states) < len(scene.physics.deltas)
        self._fields = fe.Fields(self._walk.equilibrium.observed) if wanted else None
        if self._fields is not None:
            record.open_fields(*self._shown(grid), keep=self._keep_fields, friction=scene.physics.has_friction)

    def _shown(self, grid: Grid | None) -> tuple[Any, ...]:
        """The mesh of the fields and the tip above it, in the user's units, on the rank that has them."""
        if grid is None:
            return ()
        physics, scales = self.scene.physics, self.scene.physics.scales
        tip, center = scales.unscaled(physics.indenter), tuple(c * scales.length for c in physics.center)
        width = drawn_width(tip, self.scene.plan.prediction["a"], max(physics.deltas) * scales.depth)
        drawn = outline(tip, center, width, physics.part.kinematics.name, scales.pieces)
        return grid.points * scales.length, grid.cells, grid.regions, drawn

    def _take_up(self) -> None:
        """Stand where the run that is continued stopped."""
        done = len(self.states)
        if done in (0, len(self.scene.physics.deltas)):
            return
        saved = self.record.read_checkpoint(self._identity)
        with self.clock.stage("resume"):
            if not self._walk.resume(saved.points, self._depths()[saved.step :]):
                depth = f"delta = {self.states[-1].delta:.6g}"
                raise NotConverged(f"the last row's {depth} was not reached again: {self._walk.failure}")

    def _depths(self) -> tuple[float, ...]:
        """The depths of the rows that are there, in the scene's units."""
        if self.scene.physics.path.control == "depth":
            return self.scene.physics.deltas[: len(self.states)]
        return tuple(state.delta / self.scene.physics.scales.depth for state in self.states)

    def _save_checkpoint(self, now: bool = False) -> None:
        """Keep the last equilibria; at most once a second and for a twentieth of the time, unless it must be `now`."""
        began = time.monotonic()
        is_time = self.record.comm.bcast(began >= self._next_checkpoint)  # all ranks give their share of it
        if not self.states or not (now or is_time):
            return
        if points := self._walk.points:
            self.record.save_checkpoint(Checkpoint(len(self.states), points), self._identity)
            ended = time.monotonic()
            self._next_checkpoint = ended + max(1.0, 20 * (ended - began))

    def follow(self, progress: Progress | None) -> list[State]:
        """Walk the load path to its end; NotConverged or VerificationError where it stops before."""
        total, done = len(self.scene.physics.deltas), len(self.states)
        if progress is not None and self.states:
            progress(self.states[-1], done, total)
        try:
            for state in self._timed(self._walk.states(self.scene.physics.path, self._wants_surface, done)):
                if not state.converged:
                    raise NotConverged(f"step {state.step} of {total}: {state.reason}")
                with self.clock.stage("solve"):
                    state = self._readings.read(state)
                self._keep(state.in_units(self.scene.physics.scales), state.step == total)
                if progress is not None:
                    progress(self.states[-1], state.step, total)
        except (NotConverged, KeyboardInterrupt) as end:
            # a signal reaches the ranks one by one: only a failure may be known to all of them
            if self.record.comm.size == 1 or (isinstance(end, NotConverged) and self._meeting.all_arrive()):
                self._save_checkpoint(now=True)
                if self.states and self._keep_fields == "last":
                    self._write_fields(self.states[-1])
            raise
        finally:
            worst = self._worst_audit if self.scene.is_meshed else None
            self.record.note(**summary(self.scene, self.states, self.clock.stages, self.clock.cpu, worst))
        return self.states

    def experiment(self) -> None:
        """Compute and write what the experiment makes of the curve; nothing without one."""
        if self.scene.experiment is None:
            return
        from indent_sim.run.experiment import conduct  # with scipy's searches, which no other scene needs

        with self.clock.stage("experiment"):
            found = conduct(self.scene, self._walk.equilibrium if self.scene.is_meshed else None)
        self.record.write_experiment(found.rows, found.dynamic)
        self.record.note(experiment=found.report, timings=stages(self.clock.stages))
        self.record.warn(*found.warnings)

    def release(self) -> None:
        """Give the memory of the solution back (collective); a process may have many runs before it."""
        self._walk = self._fields = self._readings = None
        self._meeting.free()
        if self._mesh is not None:
            backend().release(self._mesh)

    def _wants_surface(self, step: int) -> bool:
        total = len(self.scene.physics.deltas) if self.scene.is_meshed else MANY_STEPS + 1
        return self.output.surface == "all" or (
            self.output.surface == "last" and (total <= MANY_STEPS or step in self._kept_steps)
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
        if self.scene.is_meshed:
            self._audit(state)
        state = self._judged(state)
        self._refuse_impossible(state)
        if state.newton_iterations > 0:  # out of contact nothing is solved, and no option asked for
            self._walk.equilibrium.refuse_unused_options()
        with self.clock.stage("write"):
            if self._keep_fields == "all" or state.step in self._kept_steps:
                self._write_fields(state)
            self.record.append(state)
            self.states.append(state)
            if not last:
                self._save_checkpoint()

    def _audit(self, state: State) -> None:
        largest = max([abs(state.force), *(abs(earlier.force) for earlier in self.states)])
        size = max(abs(state.force), abs(state.reaction), AUDIT_FLOOR * largest, self._held)
        difference = abs(state.force - state.reaction) / size if size > 0 else 0.0
        stray = state.stray_reaction / size if size > 0 else 0.0
        self._worst_audit = max(self._worst_audit, difference, stray)
        if not max(difference, stray) <= AUDIT_TOLERANCE:
            raise VerificationError(
                f"step {state.step} failed its audit: contact force {state.force:.10g}, reaction of the supports "
                f"{state.reaction:.10g}, largest reaction of the rigid-mode pins {state.stray_reaction:.3g}; "
                f"they must agree to {AUDIT_TOLERANCE:g}"
            )

    @property
    def _held(self) -> float:
        """About what pulls under a tip that adheres [force]: the force may be less, where as much pushes."""
        physics, a = self.scene.physics, self.scene.plan.prediction["a"]
        adhesion = physics.scales.unscaled(physics.contact).adhesion
        return float(adhesion.work * a) if adhesion else 0.0

    def _refuse_impossible(self, state: State) -> None:
        if said := contradiction(self.scene, state, self.states):
            raise VerificationError(
                f"step {state.step}, at delta = {state.delta:.6g}, is a row that cannot be true: {said}; "
                "shorter steps to this depth, a smaller mesh.h_contact or another contact.method may help"
            )

    def _write_fields(self, state: State) -> None:
        if self._fields is None:
            return
        scales = self.scene.physics.scales
        units = {"displacement": scales.length, "J": 1.0}
        self._walk.return_to_row()
        fields = (self._fields.gather() or {}).items()  # rank 0 has them
        self.record.write_fields(state, {name: field * units.get(name, scales.pressure) for name, field in fields})


def backend() -> Any:
    """What solves: `fe.solver`; BackendError when a library is missing."""
    try:
        with uninterrupted():  # a signal inside an import would look like a missing library
            load_dolfinx()
            from indent_sim.fe import solver
    except ImportError as missing:
        raise BackendError(f"{missing}; `indent-sim doctor` says what is missing") from missing
    return solver
