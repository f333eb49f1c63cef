"""One scene on its way through mesh, problem and load path, every state on disk before the next."""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.fe.environment import load_dolfinx
from indent_sim.model.state import PullOff, State
from indent_sim.process.errors import BackendError, NotConverged, VerificationError
from indent_sim.process.ranks import on_root
from indent_sim.process.signals import uninterrupted
from indent_sim.process.usage import Clock
from indent_sim.results.checkpoint import Checkpoint
from indent_sim.results.outline import Outline, drawn_width, outline
from indent_sim.results.tables import EXPERIMENT
from indent_sim.run.companions.error_bars import Bars
from indent_sim.run.plausibility import Rows, contradiction, foresee
from indent_sim.run.readings import Readings
from indent_sim.run.record import Record
from indent_sim.run.resolved import fields_of
from indent_sim.run.summary import stages, summary
from indent_sim.run.walks.by_curve import CurveWalk
from indent_sim.run.walks.by_theory import TheoryWalk
from indent_sim.scene.scene import Scene

AUDIT_TOLERANCE = 1e-8  # contact integral against the supports' reactions, relative
# Of the largest force so far: a body let go of has no force to compare with, only what Newton takes for round-off,
# 1e-14 of the largest reactions (fe/solve/newton.py), which over 1e4 nodes adds up to 1e-12 of them at most
AUDIT_FLOOR = 1e-4

SWELLING_SCALE = 100.0  # of E height^2, or of E a^2 of a body that only drains, what Newton takes for its reactions
# Of a^2 delta: less fluid than this that moves is none, as in the first moment of a step. AUDIT_TOLERANCE of it is
# 1e-10 of what the tip displaces, as Newton leaves 1e-10 of the reactions; a snap of a porous rubber leaves 2e-11
DISPLACED = 1e-2

Progress = Callable[[State, int, int], None]
Remedies = Callable[
    [int, int], str
]  # of a step that was not reached and the iterations spent: what was tried, in words


class Simulation:
    """A scene on its way through mesh, problem and load path; every converged state is on disk before the next."""

    def __init__(
        self, config: Config, scene: Scene, record: Record, clock: Clock, bars: Bars | None, remedies: Remedies
    ):
        self._remedies = remedies
        self.bars, self.output, self.scene, self.record, self.clock = bars, config.output, scene, record, clock
        earlier = record.earlier
        self.states = list(earlier.states) if earlier else []
        if earlier and (known := earlier.report.get("roughness")):  # which the table of rows does not have
            self.states = [replace(row, roughness=known.get(str(row.step), 0.0)) for row in self.states]
        if bars is not None and scene.history is None:
            self.states = [bars.judged(state) for state in self.states]
        self._rows = Rows(self.states)
        self._pull_off: PullOff | None = None
        self._keep_fields = fields_of(config, scene)
        self._kept_steps = frozenset() if scene.history else scene.physics.path.kept
        audit = (earlier.report.get("audit") or {}) if earlier else {}  # of the rows that are there
        self._worst_audit = float(audit.get("force_against_reaction") or 0.0)
        self._next_checkpoint = 0.0  # on the monotonic clock [s]
        self._walked_to = len(self.states)  # the row at which the walk stands
        self._assemble()

    def _assemble(self) -> None:
        spent = self.states[-1].wall_s if self.states else 0.0
        if not self.scene.is_meshed:
            self._walk: Any = TheoryWalk(self.scene, self.record.comm, self.clock.started - spent)
            self._readings: Any = Readings(self.scene, None, self.record.beside)
            self._fields = self._mesh = None
            self._follow_in_time(spent)
            return
        record, scene, clock = self.record, self.scene, self.clock
        part = scene.physics.part
        answer: Any = on_root(record.comm, scene.begin_grid)  # it is meshed while the libraries load
        with clock.stage("imports"):
            fe = backend()
        with clock.stage("mesh"):
            grid = on_root(record.comm, answer)
            self._mesh = mesh = fe.distribute(grid, part, record.comm)
        with clock.stage("assemble"):
            self._walk = fe.walk(scene, mesh, clock.started - spent)
            self._follow_in_time(spent)
        self._readings = Readings(scene, self._walk.equilibrium, record.beside)
        foresee(scene)
        dofs, versions = self._walk.equilibrium.observed.dofs, fe.versions()
        if grid is not None:  # rank 0, which writes
            size = {"cells": len(grid.cells), "points": len(grid.points)}
            tuned = {"PETSC_OPTIONS": options} if (options := os.environ.get("PETSC_OPTIONS")) else {}
            record.note(dofs=dofs, mesh={"hash": mesh.hash} | size, versions=versions | {"gmsh": grid.gmsh}, **tuned)
        self._identity = {"mesh": mesh.hash, "dofs": dofs, "dolfinx": versions["dolfinx"], "order": "of the grid"}
        if scene.physics.seeks_pull_off:  # a checkpoint without them, of an earlier version, is none
            self._identity["pull_off"] = "rows around the largest pull"
        earlier = (record.earlier.report.get("mesh") or {}).get("hash") if record.earlier else None
        if earlier not in (None, mesh.hash):
            record.warn(f"steps 1 to {len(self.states)} were computed on another mesh (another version of gmsh?)")
        self._take_up()
        self._fields = None
        if self._keep_fields != "none" and len(self.states) < len(scene.physics.deltas):
            self._fields = fe.Fields(self._walk.equilibrium.observed, self.output.nodal_stress)
            told = {f"region {k}": region.name for k, region in enumerate(scene.physics.part.regions)}
            L = scene.physics.scales.length
            shown = () if grid is None else (grid.points * L, grid.cells, grid.regions, self._drawn_tip())
            record.open_fields(*shown, keep=self._keep_fields, more=self._fields.more, told=told)

    def _follow_in_time(self, spent: float) -> None:
        """Take the rows of a history in place of those of its elastic curve, whose error bars they have."""
        if self.scene.history:
            self._walk = CurveWalk(self.scene, self._walk, self.clock.started - spent)

    def _drawn_tip(self) -> Outline:
        """The tip above the mesh of the fields, in the user's units."""
        physics, scales = self.scene.physics, self.scene.physics.scales
        tip, center = scales.unscaled(physics.indenter), tuple(c * scales.length for c in physics.center)
        width = drawn_width(tip, self.scene.plan.prediction["a"], max(physics.deltas) * scales.depth)
        return outline(tip, center, width, physics.part.kinematics.name, scales.pieces)

    def _take_up(self) -> None:
        """Stand where the run that is continued stopped."""
        physics, done = self.scene.physics, len(self.states)
        is_through = done == len(physics.deltas) and not physics.seeks_pull_off
        if done == 0 or is_through or self.scene.history:
            return
        saved = self.record.read_checkpoint(self._identity)
        if physics.path.times:  # the rows since then are walked again, as they were
            with self.clock.stage("resume"):
                self._walk.resume(saved.points, [], saved.step, saved.pull_off_points)
            self._walked_to = saved.step
            return
        legs = [physics.path.leg(step) for step in range(saved.step + 1, done + 1)]  # with the rows that are there
        passed = [place for leg in legs for place in leg]
        if physics.path.control != "depth":  # every step is a row
            passed = [(state.delta / physics.scales.depth, 0.0) for state in self.states[saved.step :]]
        with self.clock.stage("resume"):
            if not self._walk.resume(saved.points, passed, saved.step, saved.pull_off_points):
                depth = f"delta = {self.states[-1].delta:.6g}"
                raise NotConverged(f"the last row's {depth} was not reached again: {self._walk.failure}")

    def _save_checkpoint(self) -> None:
        """Keep the last equilibria; the next time after a second, and twenty times as long as this took."""
        began = time.monotonic()
        if self.states and (points := self._walk.points):
            pulls = self._walk.pull_off_points if self.scene.physics.seeks_pull_off else {}
            self.record.save_checkpoint(Checkpoint(len(self.states), points, pulls), self._identity)
            ended = time.monotonic()
            self._next_checkpoint = ended + max(1.0, 20 * (ended - began))

    @property
    def _total(self) -> int:
        """Rows of the whole run; of a history known once its curve is."""
        return len(self._walk.findings.rows if isinstance(self._walk, CurveWalk) else self.scene.physics.deltas)

    def follow(self, progress: Progress | None) -> list[State]:
        """Walk the load path to its end; NotConverged or VerificationError where it stops before."""
        done = len(self.states)
        try:
            if isinstance(self._walk, CurveWalk):
                with self.clock.stage("solve"):
                    self._walk.solve(self.bars)
            if progress is not None and self.states:
                progress(self.states[-1], done, self._total)
            walked = self._walk.states(self.scene.physics.path, self._wants_surface, min(self._walked_to, done))
            while state := self._next(walked):
                if not state.converged:
                    raise NotConverged(f"step {state.step} of {self._total}: {state.reason}{self._tried(state)}")
                if state.step <= done:
                    continue
                self._keep(state.in_units(self.scene.physics.scales))
                if progress is not None:
                    progress(self.states[-1], state.step, self._total)
            if self.scene.physics.seeks_pull_off:
                with self.clock.stage("pull-off"):
                    self._pull_off = self.record.beside("pull-off", self._find_pull_off, None)
        except (NotConverged, KeyboardInterrupt) as end:
            # a signal reaches the ranks one by one: only a failure may be known to all of them
            if self.record.comm.size == 1 or (isinstance(end, NotConverged) and self.record.end.all_arrive()):
                self._save_checkpoint()
                if self.states and self._keep_fields == "last":
                    self._write_fields(self.states[-1])
            raise
        finally:
            worst = self._worst_audit if self.scene.is_meshed else None
            self._note_time()
            pull_off = self._pull_off
            self.record.note(**summary(self.scene, self.states, self.clock, worst, self.record.alone, pull_off))
        return self.states

    def _find_pull_off(self) -> PullOff | None:
        """Search for the largest pull between the rows; audited, in the user's units, None where there is none."""
        found: PullOff | None = self._walk.find_pull_off()
        if found is None:
            return None
        scales = self.scene.physics.scales
        state = found.state.in_units(scales)
        self._audit(state)
        return PullOff(state, found.error * scales.force, found.equilibria)

    def _tried(self, failed: State) -> str:
        """Which remedies were tried for a row that was not found, in words."""
        spent = failed.newton_iterations + sum(state.newton_iterations for state in self.states)
        with self.clock.stage("remedies"):
            return self._remedies(failed.step, spent)

    def _note_time(self) -> None:
        """Say how a history was followed row by row, the parts before this one included."""
        if not (self.scene.plan.time and self.scene.physics.path.times):
            return
        before = (self.record.earlier.report.get("time") or {}) if self.record.earlier else {}
        before = before if "cuts" in before else {}  # of a run that was killed stages are the planned ones
        done = {name: count + int(before.get(name, 0)) for name, count in self._walk.counts.items()}
        self.record.note(time=self.scene.plan.time.report | done)

    def experiment(self) -> None:
        """Compute and write what the experiment makes of the curve; nothing without one."""
        if not self.scene.is_of_curve:
            return
        from indent_sim.run.experiment import Findings, conduct  # with scipy's searches, which no other scene needs

        if isinstance(self._walk, CurveWalk):
            findings = self._walk.findings.in_units(self.scene.physics.scales)
        else:
            equilibrium = self._walk.equilibrium if self.scene.is_meshed else None
            with self.clock.stage("experiment"):
                findings = self.record.beside(EXPERIMENT, lambda: conduct(self.scene, equilibrium), Findings([]))
        self.record.write_experiment([] if self.scene.history else findings.rows, findings.dynamic)
        said: dict[str, Any] = {"experiment": findings.report} if self.scene.experiment else {}
        if self.scene.plan.time and findings.time:
            said["time"] = self.scene.plan.time.report | findings.time
        self.record.note(**said, timings=stages(self.clock.stages))
        self.record.warn(*findings.warnings)

    def release(self) -> None:
        """Give the memory of the solution back (collective); a process may have many runs before it."""
        self._walk = self._fields = self._readings = None
        if self._mesh is not None:
            backend().release(self._mesh)

    def _wants_surface(self, step: int) -> bool:
        has_few = self.scene.is_meshed and len(self.scene.physics.deltas) <= 100  # then a killed run has its last too
        kept = {"all": True, "last": has_few or step in self._kept_steps}
        return kept.get(self.output.surface, False)

    def _next(self, walked: Iterator[State]) -> State | None:
        with self.clock.stage("solve"):
            state = next(walked, None)
            return self._readings.read(state) if state and self.scene.history is None else state

    def _keep(self, state: State) -> None:
        """Audit a converged state and write it down; the rows of a history follow from a curve that was judged."""
        state = self._walk.with_bars(state) if isinstance(self._walk, CurveWalk) else self._checked(state)
        with self.clock.stage("write"):
            if self._keep_fields == "all" or state.step in self._kept_steps:
                self._write_fields(state)
            self.record.append(state)
            self.states.append(state)
            self._rows.append(state)
            is_time = self.record.comm.bcast(time.monotonic() >= self._next_checkpoint)  # all ranks give their share
            if is_time and state.step < self._total:
                self._save_checkpoint()

    def _checked(self, state: State) -> State:
        """A state with its error bars; VerificationError for one that fails its audit or cannot be true."""
        if self.scene.is_meshed:
            self._audit(state)
        state = state if self.bars is None else self.bars.judged(state)
        if said := self.record.alone("check of its rows", lambda: contradiction(self.scene, state, self._rows), None):
            place = f"step {state.step}, at delta = {state.delta:.6g}"
            raise VerificationError(f"{place}, is a row that cannot be true: {said}")
        return state

    @property
    def judged(self) -> list[State]:
        """The states that the error bars are of: the rows, or those of the elastic curve of a history."""
        return self._walk.judged if isinstance(self._walk, CurveWalk) else self.states

    def _audit(self, state: State) -> None:
        physics, a = self.scene.physics, self.scene.plan.prediction["a"]
        attraction = physics.contact.adhesion and physics.scales.unscaled(physics.contact).adhesion
        pull = attraction.work * a if attraction else 0.0  # about; the force may be less, where as much pushes
        swollen = 0.0  # what supports hold of a body with fluid, with or without a tip
        if physics.permeable:
            swollen = (
                SWELLING_SCALE * physics.scales.force * (1.0 if physics.swells else (a / physics.scales.length) ** 2)
            )
        largest = max(swollen, self._rows.largest_force, abs(state.force))
        size = max(abs(state.force), abs(state.reaction), AUDIT_FLOOR * largest, pull)
        if physics.swells:
            # The supports of a gel hold its swelling, whose nodal reactions cancel in the sum and
            # may exceed the contact force many times. Newton's residual is relative to their norm.
            size = max(size, self._walk.equilibrium.reaction_norm * physics.scales.force)
        difference = abs(state.force - state.reaction) / size if size > 0 else 0.0
        stray = state.stray_reaction / size if size > 0 else 0.0
        self._worst_audit = max(self._worst_audit, difference, stray)
        if not max(difference, stray) <= AUDIT_TOLERANCE:
            said = f"contact force {state.force:.10g}, reaction of the supports {state.reaction:.10g}, largest reaction"
            said += f" of the rigid-mode pins {state.stray_reaction:.3g}; they must agree to {AUDIT_TOLERANCE:g}"
            raise VerificationError(f"step {state.step} failed its audit: {said}")
        self._audit_fluid(state)

    def _audit_fluid(self, state: State) -> None:
        """What has left the body and what is missing in it must be one, beside the most that ever left or moved.

        Rows that an earlier call wrote tell what left, not what moved inside: their table has no column of it."""
        if state.unbalanced == 0:
            return
        a, depth = self.scene.plan.prediction["a"], max(abs(one.delta) for one in (*self.states, state))
        moved = max(max(abs(one.outflow or 0.0), one.moved) for one in (*self.states, state))
        largest = max(moved, DISPLACED * a ** (self.scene.physics.scales.dim - 1) * depth)
        unbalanced = state.unbalanced / largest if largest > 0 else 0.0
        self._worst_audit = max(self._worst_audit, unbalanced)
        if not unbalanced <= AUDIT_TOLERANCE:
            said = f"{state.unbalanced:.3g} of the fluid has neither left nor is there, of {largest:.3g} that moved"
            raise VerificationError(f"step {state.step} failed its audit: {said}")

    def _write_fields(self, state: State) -> None:
        if (observed := self._fields) is None:
            return
        scales = self.scene.physics.scales
        units = {"displacement": scales.length, **dict.fromkeys(("J", "fluid_content", "swelling"), 1.0)}
        self._walk.return_to_row()
        if (found := self.record.beside("fields", lambda: observed.gather() or {}, None)) is None:
            return
        fields = found.items()  # rank 0 has them
        values = {name: field * units.get(name, scales.pressure) for name, field in fields}
        grows = self.scene.physics.path.grows
        self.record.write_fields(state, values, state.delta if state.t is None and grows else state.t)


def kernel_folder() -> Path:
    """Where compiled kernels are kept; dolfinx is loaded for it, as a run loads it."""
    return load_dolfinx()


def backend() -> Any:
    """What solves: `fe.solver`; BackendError when a library is missing."""
    is_new = "indent_sim.fe.solver" not in sys.modules
    try:
        with uninterrupted():  # a signal inside an import would look like a missing library
            load_dolfinx()
            from indent_sim.fe import solver
    except ImportError as missing:
        raise BackendError(f"{missing}; `indent-sim doctor` says what is missing") from missing
    if (
        is_new and not gc.isenabled()
    ):  # a program of one run: libraries stay, and each run ends with a search for garbage
        gc.freeze()
    return solver
