"""The experiment of a scene: what one solved curve determines, with adhesion, in time, behind a spring."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from math import hypot, inf, isnan, nan
from typing import Any

import numpy as np

from indent_sim.model.experiment import Experiment, Relaxation
from indent_sim.process.errors import NotConverged
from indent_sim.run.readings import punches_of
from indent_sim.scene.given import remaining
from indent_sim.scene.scene import Scene
from indent_sim.scene.theories import relative_tip
from indent_sim.theory.layer import Layer
from indent_sim.theory.surface.adhesion import Contact, Jkr, maugis_lambda, maugis_pull_off, tabor
from indent_sim.theory.surface.punches import Punches, radius_at
from indent_sim.theory.surface.relaxation import LEAST_SAMPLES, ElasticCurve, Modulus, OneCycle, PowerLaw, Prony
from indent_sim.theory.surface.stepping import StepByStep, Surface, layer_surface

POINTS = 200  # of an equilibrium curve, and of a history at least; at most as many more
SHALLOWEST = 1e-5  # of the deepest depth: a power law below
SAMPLES = 80  # of an elastic curve
FEW = 2.0  # elements that a contact must have to be one of them
DEEPER = 1.001  # of what is asked for: the curve is known up to there
# By so many distances of nodes contact ends beyond where the edge pressure of nodal punches changes its sign: measured
# against theory on layers of nu = 0 ... 0.5, 0.14 to 0.18 and 0.04 to 0.08
EDGE = {"displacement": 0.16, "mixed": 0.06}
SHORTEST = 1e-3  # of a history: shorter times of a power law do not matter where it is stepped through


@dataclass(frozen=True)
class Row:
    """One row of experiment.csv; NaN where there is none."""

    t: float
    z: float
    delta: float
    force: float
    a: float
    branch: str
    force_error: float | None = None


@dataclass(frozen=True)
class Dynamic:
    """One row of dynamic.csv: in-phase and out-of-phase stiffness of the contact at a frequency."""

    frequency: float
    storage: float
    loss: float


@dataclass(frozen=True)
class Findings:
    """What an experiment comes to, in the user's units: the rows of its tables, its part of run.json, and warnings."""

    rows: list[Row]
    dynamic: list[Dynamic] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def conduct(scene: Scene, equilibrium: Any = None) -> Findings:
    """The experiment of a scene that has one, and whose body is condensed where it is meshed.

    NotConverged where the curve that it needs has no such depth.
    """
    assert scene.experiment is not None
    with _unreached():
        return _Conduct(scene, scene.experiment, equilibrium).findings()


@contextmanager
def _unreached() -> Iterator[None]:
    try:
        yield
    except (ValueError, ArithmeticError) as error:
        raise NotConverged(f"experiment: {error}") from error


def modulus_of(law: Relaxation) -> Modulus:
    """E(t)/E(0) of a relaxation law."""
    if law.power_law is not None:
        return PowerLaw(law.power_law.exponent, law.power_law.time)
    fractions, times = zip(*(law.prony or ()), strict=True)
    return Prony(fractions, times)


class _Conduct:
    """One experiment, in the scene's units until its findings."""

    def __init__(self, scene: Scene, experiment: Experiment, equilibrium: Any):
        self.scene, self.experiment, self._equilibrium = scene, experiment, equilibrium
        scales = scene.physics.scales
        self.D, self.L, self.F = scales.depth, scales.length, scales.force
        self.compliance = experiment.compliance * self.F / self.D
        unit = self.F if experiment.force_history else self.D
        self.points = [(t, value / unit) for t, value in experiment.points]
        self.is_put_at_rest = bool(self.points) and self.points[0][1] > 0  # by a jump that is no row
        if self.is_put_at_rest:
            self.points = [(self.points[0][0], 0.0), *self.points]
        self.deepest = max([scene.asked, *scene.physics.deltas])
        self.is_stepped = experiment.is_stepped  # or found to have to be
        self.warnings: list[str] = []

    # ---- what is known of the body -------------------------------------------------------------------------------

    @cached_property
    def punches(self) -> Punches:
        return punches_of(self.scene, self._equilibrium)

    @cached_property
    def jkr(self) -> Jkr:
        assert self.experiment.adhesion is not None
        scales = self.scene.physics.scales
        return Jkr(self.punches, self.experiment.adhesion.work / (scales.pressure * scales.length))

    @property
    def modulus(self) -> Modulus:
        law = self.experiment.relaxation
        return modulus_of(law) if law else Prony((), ())

    def curve_to(self, top: float) -> ElasticCurve:
        """The elastic curve up to a depth, by theory, by flat punches, or by equilibria of the condensed body."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None
            found = theory.contact.curve(_samples(SHALLOWEST * top, DEEPER * top))
            return _curve([s.delta for s in found], [s.force for s in found], [s.a for s in found])
        if not self._equilibrium.solve(top * DEEPER):  # which condenses to as much surface as is needed
            raise ValueError(f"the depth {top * self.D:g} was not reached: {self._equilibrium.failure}")
        try:
            radii = _samples(self.punches.smallest, radius_at(self.punches, DEEPER * top))
        except (ValueError, ArithmeticError):
            return self._solved(top)
        samples = [self.punches.at(a) for a in radii]
        return _curve([p.delta for p in samples], [p.force for p in samples], radii)

    def _solved(self, top: float) -> ElasticCurve:
        """The same by equilibria at depths at which some elements touch."""
        found, h = [], self.scene.sizes.h_contact
        for delta in _samples(DEEPER * top, SHALLOWEST * top):
            if not self._equilibrium.solve(delta):
                break
            numbers = self._equilibrium.numbers()
            if numbers["a"] < FEW * h:
                break
            found.append((delta, numbers["force"], numbers["a"]))
        if len(found) < LEAST_SAMPLES:
            few = f"the contact has {FEW:g} elements at {len(found)} of {SAMPLES} depths"
            raise ValueError(f"{few}: give a smaller mesh.h_contact")
        return _curve(*map(list, zip(*reversed(found), strict=True)))

    def depth_of(self, force: float) -> float:
        """A depth with this force at least, from the deepest one on."""
        top = self.deepest
        for _ in range(60):
            if float(self.curve_to(top).force(np.array(top))) >= force:
                return top
            top *= 1.3
        raise ValueError(f"the force {force * self.F:g} was not reached")

    def surface(self, top: float) -> Surface:
        """The surface up to the contact at a depth, for stepping in time."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None and isinstance(theory.contact, Layer)
            return layer_surface(theory.contact, theory.contact.curve([DEEPER * top])[0].a)
        if not self._equilibrium.solve(top * DEEPER):
            raise ValueError(f"the depth {top * self.D:g} was not reached: {self._equilibrium.failure}")
        x, heights, areas, A = self._equilibrium.contact.weighted
        part, copies = self.scene.physics.part, self.scene.physics.part.copies
        order = np.argsort(x[:, 0]) if part.kinematics.name == "axisymmetric" else np.arange(len(x))
        heights, areas, A = copies * heights[order], copies * areas[order], copies * A[np.ix_(order, order)]
        if part.kinematics.name != "axisymmetric":
            return Surface(A, heights, areas, is_plane=self.scene.physics.scales.dim == 2)
        return Surface(A, heights, areas, x[order, 0], EDGE[part.regions[0].formulation])

    # ---- the findings --------------------------------------------------------------------------------------------

    def findings(self) -> Findings:
        found = self.experiment
        rows = self._rows()
        report: dict[str, Any] = {"by": "theory" if not self.scene.is_meshed else "condensed body"}
        if found.adhesion:
            report |= self._adhesion()
        if found.relaxation and self.points:
            report["relaxation"] = {"method": "time steps" if self.is_stepped else "quadrature"}
        if found.calibration:
            force, modulus = self._uncertain()
            report["calibration"] = {"force": force, "modulus": modulus}
            rows = [Row(**(vars(row) | {"force_error": force * abs(row.force)})) for row in rows]
        dynamic = self._dynamic(rows)
        return Findings([self._in_units(row) for row in rows], dynamic, report, self.warnings)

    def _in_units(self, row: Row) -> Row:
        error = None if row.force_error is None else row.force_error * self.F
        return Row(row.t, row.z * self.D, row.delta * self.D, row.force * self.F, row.a * self.L, row.branch, error)

    def _rows(self) -> list[Row]:
        if not self.points:
            return self._equilibria()
        if self.experiment.adhesion:
            return self._adhesive()
        if self.is_stepped:
            return self._stepped()
        return self._cycle() if self.experiment.relaxation else self._elastic()

    def _equilibria(self) -> list[Row]:
        """The whole equilibrium curve by the contact radius, without a history."""
        top = self.deepest
        if not self.experiment.adhesion:
            curve = self.curve_to(top)
            depths = [top * (k / POINTS) ** 2 for k in range(1, POINTS + 1)]
            return [self._row(nan, d, float(curve.force(np.array(d))), float(curve.a(np.array(d))), "stable")
                    for d in depths]  # fmt: skip
        last, deep = self.jkr.pull_off(self.compliance), self.jkr.stable(top)
        assert deep is not None
        low = max(1.001 * self.punches.smallest, 0.02 * last.a)
        radii = low * (deep.a / low) ** np.linspace(0.0, 1.0, POINTS)
        return [self._of(nan, self.jkr.at(float(a)), "stable" if a >= last.a else "unstable") for a in radii]

    def _of(self, t: float, contact: Contact, branch: str) -> Row:
        return self._row(t, contact.delta, contact.force, contact.a, branch)

    def _row(self, t: float, delta: float, force: float, a: float, branch: str) -> Row:
        return Row(t, delta + self.compliance * force, delta, force, a, branch)

    def _times(self) -> list[tuple[float, float, str]]:
        """Times, values and branches: every point of the history and, between them, enough for a curve."""
        (t, value), found = self.points[0], []
        if not self.is_put_at_rest:
            found.append((t, value, _branch(value, self.points[1][1])))
        for ((t0, v0), (t1, v1)), rows in zip(pairwise(self.points), self._rows_between(), strict=True):
            branch = _branch(v0, v1)
            found += [(t0 + (t1 - t0) * k / rows, v0 + (v1 - v0) * k / rows, branch) for k in range(1, rows)]
            found.append((t1, v1, branch))
        return found

    def _rows_between(self) -> list[int]:
        """Rows of each piece of the history: its share of the time, or of the pieces if that is more; a jump: 1."""
        spans = np.diff([t for t, _ in self.points])
        share = np.maximum(spans / spans.sum(), 1.0 / len(spans))
        return [max(1, round(POINTS * part)) if span > 0 else 1 for part, span in zip(share, spans, strict=True)]

    def _elastic(self) -> list[Row]:
        """Every point an equilibrium of the elastic curve."""
        largest = max(value for _, value in self.points)
        of_force = bool(self.experiment.force_history)
        curve = self.curve_to(self.depth_of(largest) if of_force else self._deepest_way(largest))
        rows = []
        for t, value, branch in self._times():
            delta = curve.depth(value) if of_force else curve.depth_behind(self.compliance, value)
            force, a = float(curve.force(np.array(delta))), float(curve.a(np.array(delta)))
            rows.append(self._row(t, delta, force, a, branch))
        return rows

    def _deepest_way(self, z: float) -> float:
        """The depth that a base's way z may come to."""
        return min(z, self.deepest) if self.compliance else z

    def _cycle(self) -> list[Row]:
        """Lee-Radok and Ting; stepping where the contact turns out to grow again."""
        times, values = zip(*self.points, strict=True)
        cycle = OneCycle(self.modulus, times, values, self.curve_to(max(values)))
        wanted = self._times()
        if cycle.regrows([t for t, *_ in wanted]):
            self.warnings.append("the contact grows again while the tip retracts or is held after it: stepped in time")
            self.is_stepped = True
            return self._stepped()
        rows = []
        for k, (t, value, branch) in enumerate(wanted):
            jumps = k + 1 < len(wanted) and wanted[k + 1][0] == t
            found = cycle.at(t, after=not jumps)
            rows.append(self._row(t, value, found.force, found.a, branch))
        return rows

    def _stepped(self) -> list[Row]:
        times, values = map(list, zip(*self.points, strict=True))
        largest, of_force = max(values), bool(self.experiment.force_history)
        softest = remaining(self.experiment)
        top = self.depth_of(largest / softest) if of_force else self._deepest_way(largest)
        span = times[-1] - times[0]
        modulus = self.modulus.prony(SHORTEST * span / len(times), span)
        stepper = StepByStep(self.surface(top), modulus, self.compliance, of_force)
        ways = [_branch(*pair) for pair in pairwise(values)]
        branches, point, rows = [ways[0], *ways], 0, []  # of the piece that ends at each point
        for found in stepper.responses(times, values, self._rows_between()):
            rows.append(self._row(found.t, found.delta, found.force, found.a, branches[point]))
            point += found.t == times[point]
        return rows[1:] if self.is_put_at_rest else rows

    # ---- adhesion ------------------------------------------------------------------------------------------------

    def _adhesive(self) -> list[Row]:
        """Stable equilibria as the history passes: the tip snaps in at first touch and comes off where it must."""
        of_force = bool(self.experiment.force_history)
        compliance = inf if of_force else self.compliance
        last = self.jkr.pull_off(compliance)
        comes_off = last.force if of_force else last.delta + compliance * last.force
        rows, touches, wanted = [], False, self._times()
        stable = self.jkr.branch(max(value for _, value, _ in wanted), compliance)
        for t, value, branch in wanted:
            touches = value > comes_off if touches else value >= 0.0
            contact = stable(value) if touches else None
            if contact is not None:
                rows.append(self._of(t, contact, branch))
            elif of_force:
                rows.append(Row(t, nan, nan, value, 0.0, branch))
            else:
                rows.append(Row(t, value, value, 0.0, 0.0, branch))
        if any(isnan(row.delta) for row in rows):
            self.warnings.append("the force pulls harder than adhesion holds: while it does there is no depth")
        return rows

    def _adhesion(self) -> dict[str, Any]:
        """The parts `adhesion` and `cantilever` of run.json."""
        assert self.experiment.adhesion is not None
        held = {name: self._said(self.jkr.pull_off(c), ("delta", "force"))
                for name, c in (("force_control", inf), ("depth_control", 0.0))}  # fmt: skip
        report: dict[str, Any] = {"adhesion": {"pull_off": held, **self._range()}}
        if self.experiment.cantilever:
            snapped, last = self.jkr.stable(0.0, self.compliance), self.jkr.pull_off(self.compliance)
            assert snapped is not None  # no spring lets go before z < 0
            names = ("z", "delta", "force")
            report["cantilever"] = {"jump_in": self._said(snapped, names) | {"z": 0.0},
                                    "jump_out": self._said(last, names)}  # fmt: skip
        return report

    def _said(self, contact: Contact, names: Sequence[str]) -> dict[str, float]:
        row = self._in_units(self._of(nan, contact, ""))
        return {name: getattr(row, name) for name in names}

    def _range(self) -> dict[str, float]:
        """Tabor and Maugis numbers, and the pull-off force that the latter gives on a half-space."""
        adhesion, physics = self.experiment.adhesion, self.scene.physics
        assert adhesion is not None
        if adhesion.range is None:
            return {}
        scales = physics.scales
        R = relative_tip(physics.indenter, physics.body).R * self.L  # type: ignore[union-attr]
        E_star = physics.material.E_star * scales.pressure
        given = adhesion.work, adhesion.range, R, E_star
        parameter = maugis_lambda(*given)
        shape = maugis_pull_off(parameter)
        return {"tabor": tabor(*given), "maugis_lambda": parameter,
                "maugis_pull_off": shape * np.pi * adhesion.work * R}  # fmt: skip

    # ---- the instrument ------------------------------------------------------------------------------------------

    def _uncertain(self) -> tuple[float, float]:
        """Relative uncertainties of a force, k times a deflection, and of a modulus fitted to it, E ~ F/R^(1/2)."""
        assert self.experiment.calibration is not None
        given = self.experiment.calibration
        return given.stiffness, hypot(given.stiffness, 0.5 * given.R)

    def _dynamic(self, rows: list[Row]) -> list[Dynamic]:
        """K(a) (G' + i G'') of the contact that the history ends with, or of the deepest one."""
        if not self.experiment.frequencies:
            return []
        a = rows[-1].a
        stiffness = 0.0
        if a > 0:
            curve = self.curve_to(self.deepest)
            depths = np.geomspace(SHALLOWEST, 1.0, 4000) * curve.deepest
            delta = float(np.interp(a, curve.a(depths), depths))
            stiffness = float(curve.stiffness(np.array(delta))) * self.F / self.D
        found = [(f, stiffness * self.modulus.complex(2 * np.pi * f)) for f in self.experiment.frequencies]
        return [Dynamic(f, K.real, K.imag) for f, K in found]


def _samples(first: float, last: float) -> list[float]:
    return [float(x) for x in np.geomspace(first, last, SAMPLES)]


def _curve(delta: Sequence[float], force: Sequence[float], a: Sequence[float]) -> ElasticCurve:
    return ElasticCurve(*(np.array(values, dtype=float) for values in (delta, force, a)))


def _branch(before: float, after: float) -> str:
    return "hold" if before == after else "approach" if after > before else "retract"

