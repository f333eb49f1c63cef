"""What one elastic curve determines: the rows of a history, with adhesion, relaxing, behind a
spring.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import hypot, inf, isnan, log, nan
from typing import Any

import numpy as np

from indent_sim.model.experiment import Calibration, Experiment
from indent_sim.model.loading import History, branch_of
from indent_sim.model.materials import Relaxation
from indent_sim.model.units import Scales
from indent_sim.process.errors import NotConverged
from indent_sim.run.readings import Equilibrium, punches_of
from indent_sim.scene.problem_setup import needs_time_stepping, remaining_modulus_fraction
from indent_sim.scene.reference_theory import relative_tip, theory_tip_shape
from indent_sim.scene.scene import Scene
from indent_sim.theory.layer import Layer
from indent_sim.theory.march import LayerContact
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.surface import relaxation
from indent_sim.theory.surface.adhesion import Contact, Jkr, maugis_lambda, maugis_pull_off, tabor
from indent_sim.theory.surface.punches import FittedPunches, Punches, radius_at
from indent_sim.theory.surface.relaxation import LEAST_SAMPLES, ElasticCurve, Modulus, OneCycle
from indent_sim.theory.surface.stepping import RelaxingSurface, StepByStep, layer_surface

CURVE_POINTS = 200  # of an equilibrium curve
SHALLOWEST = 1e-5  # of the deepest depth: a power law below
CURVE_SAMPLES = 80  # of an elastic curve
FEWEST_IN_CONTACT = 2.0  # elements that a contact must have to be one of them
DEPTH_OVERSHOOT = 1.001  # of what is asked for: the curve is known up to there
# By so many distances of nodes contact ends beyond where the edge pressure of nodal punches changes
# its sign: measured against theory on layers of nu = 0 ... 0.5, 0.14 to 0.18 and 0.04 to 0.08
EDGE_SHIFT = {"displacement": 0.16, "mixed": 0.06}
# Of the depth at pull-off by depth: least error of that by force on a mesh, measured: 0.0019
LEAST_PULL_OFF_ERROR = 0.002
EXPONENT_VARIATION = 0.05  # of the tip's radius, for the exponent of the force
IN_UNITS = ("adhesion", "cantilever")  # parts of run.json whose numbers have units
SHORTEST_TIME = (
    1e-3  # of a history: shorter times of a power law do not matter where it is stepped through
)


@dataclass(frozen=True)
class Row:
    """One row of a history, or of an equilibrium curve, NaN where there is none; its error is the
    instrument's.
    """

    t: float
    z: float
    delta: float
    force: float
    a: float
    branch: str
    calibration_error: float | None = None


@dataclass(frozen=True)
class Dynamic:
    """One row of dynamic.csv: in-phase and out-of-phase stiffness of the contact at a frequency."""

    frequency: float
    storage: float
    loss: float


@dataclass(frozen=True)
class Findings:
    """What a curve determines: the rows, those of dynamic.csv, the parts `experiment` and `time` of
    run.json, and warnings.
    """

    rows: list[Row]
    dynamic: list[Dynamic] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)
    time: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def in_units(self, scales: Scales) -> Findings:
        """The same in the user's units, of which the scales are the scene's."""
        depth = scales.depth
        force = scales.force
        units = {
            "z": depth,
            "delta": depth,
            "force": force,
            "a": scales.length,
            "calibration_error": force,
        }
        units |= {
            "delta_error": depth,
            "maugis_pull_off": force,
            "storage": force / depth,
            "loss": force / depth,
        }
        rows = [Row(**_measured(vars(row), units)) for row in self.rows]
        dynamic = [Dynamic(**_measured(vars(row), units)) for row in self.dynamic]
        measured = {
            name: _measured(self.report[name], units) for name in IN_UNITS if name in self.report
        }
        return replace(self, rows=rows, dynamic=dynamic, report=self.report | measured)


def _measured(numbers: Mapping[str, Any], units: Mapping[str, float]) -> dict[str, Any]:
    """Numbers by name, or parts with such numbers, times the unit of their name."""
    return {
        name: _measured(one, units)
        if isinstance(one, dict)
        else one * units[name]
        if one and name in units
        else one
        for name, one in numbers.items()
    }


def modulus_of(law: Relaxation | None) -> Modulus:
    """G(t) of a relaxation; 1 of a body that does not relax."""
    if law and law.power_law:
        return relaxation.PowerLaw(law.power_law.exponent, law.power_law.time)
    terms = law.prony if law and law.prony else ()
    return relaxation.Prony(
        tuple(fraction for fraction, _ in terms), tuple(time for _, time in terms)
    )


def conduct(scene: Scene, equilibrium: Equilibrium = None) -> Findings:
    """What the elastic curve of a scene determines, in the user's units; see `followed`."""
    return followed(scene, equilibrium).in_units(scene.physics.scales)


def followed(scene: Scene, equilibrium: Equilibrium = None) -> Findings:
    """What the elastic curve of a scene determines, without units: the rows of its history, its
    experiment.

    The body is condensed where it is meshed. NotConverged where the curve that is needed has no
    such depth.
    """
    try:
        return _Evaluation(scene, equilibrium).findings()
    except UNSOLVED as error:
        raise NotConverged(
            f"{'history' if scene.history_on_curve else 'experiment'}: {error}"
        ) from error


class _Evaluation:
    """One history, experiment or both, without units."""

    def __init__(self, scene: Scene, equilibrium: Equilibrium):
        self.scene = scene
        self.experiment = scene.experiment or Experiment()
        self.history = scene.history_on_curve and scene.history_on_curve.through_its_times
        self._equilibrium = equilibrium
        self.compliance = self.experiment.compliance
        self.of_force = (
            scene.history_on_curve is not None and scene.history_on_curve.control == "force"
        )
        self.deepest = max(scene.physics.deltas)
        self.modulus = modulus_of(scene.relaxation)
        self.is_stepped = needs_time_stepping(
            scene.history_on_curve, scene.relaxation, self.compliance
        )  # or found to have to be
        self.warnings: list[str] = []
        self._curves: dict[float, ElasticCurve] = {}

    @cached_property
    def punches(self) -> Punches:
        return punches_of(self.scene, self._equilibrium)

    @cached_property
    def jkr(self) -> Jkr | None:
        """The contact of a tip that adheres; None for one that does not."""
        adhesion = self.experiment.adhesion
        return Jkr(self.punches, adhesion.work) if adhesion else None

    def curve_to(self, top: float) -> ElasticCurve:
        """The elastic curve up to a depth, worked out once."""
        if top not in self._curves:
            self._curves[top] = self._sampled(top)
        return self._curves[top]

    def _sampled(self, top: float) -> ElasticCurve:
        """That curve by theory, by flat punches, or by equilibria of the condensed body."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None
            solutions = theory.contact.curve(_samples(SHALLOWEST * top, DEPTH_OVERSHOOT * top))
            return _curve([(s.delta, s.force, s.a) for s in solutions])
        self._press(
            self._equilibrium, top * DEPTH_OVERSHOOT, top
        )  # which condenses to as much surface as is needed
        try:
            radii = _samples(self.punches.smallest, radius_at(self.punches, DEPTH_OVERSHOOT * top))
        except UNSOLVED:
            return self._solved(top)
        samples = [self.punches.at(a) for a in radii]
        return _curve([(p.delta, p.force, p.a) for p in samples])

    def _press(self, equilibrium: Equilibrium, depth: float, named: float) -> None:
        """Solve a body at a depth; ValueError where it fails."""
        if not equilibrium.solve(depth):
            deep = named * self.scene.physics.scales.depth
            raise ValueError(f"the depth {deep:g} was not reached: {equilibrium.failure}")

    def _solved(self, top: float) -> ElasticCurve:
        """The same by equilibria at depths at which some elements touch."""
        samples: list[tuple[float, float, float]] = []
        for delta in _samples(DEPTH_OVERSHOOT * top, SHALLOWEST * top):
            if not self._equilibrium.solve(delta):
                break
            numbers = self._equilibrium.numbers()
            if numbers["a"] < FEWEST_IN_CONTACT * self.scene.sizes.h_contact:
                break
            samples.append((delta, numbers["force"], numbers["a"]))
        if len(samples) < LEAST_SAMPLES:
            few = (
                f"the contact has {FEWEST_IN_CONTACT:g} elements at {len(samples)} of "
                f"{CURVE_SAMPLES} depths"
            )
            raise ValueError(f"{few}: give a smaller mesh.h_contact")
        return _curve(samples[::-1])

    def surface(self, top: float) -> RelaxingSurface:
        """The surface up to the contact at a depth, for stepping in time."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None and isinstance(theory.contact, Layer)
            return layer_surface(theory.contact, theory.contact.curve([DEPTH_OVERSHOOT * top])[0].a)
        self._press(self._equilibrium, top * DEPTH_OVERSHOOT, top)
        x, heights, areas, A = self._equilibrium.contact.weighted
        part = self.scene.physics.domain
        copies = self.scene.physics.domain.copies
        is_round = part.kinematics.name == "axisymmetric"
        order = np.argsort(x[:, 0]) if is_round else np.arange(len(x))
        heights = copies * heights[order]
        areas = copies * areas[order]
        A = copies * A[np.ix_(order, order)]
        if not is_round:
            return RelaxingSurface(A, heights, areas, is_plane=self.scene.physics.scales.dim == 2)
        return RelaxingSurface(
            A, heights, areas, x[order, 0], EDGE_SHIFT[part.regions[0].formulation]
        )

    def findings(self) -> Findings:
        """What the experiment comes to, without units."""
        rows = self._asked(self._rows())
        given = self.experiment
        report: dict[str, Any] = {"by": "condensed body" if self.scene.is_meshed else "theory"}
        if self.jkr:
            report |= self._adhesion(self.jkr)
        if given.calibration:
            force, modulus = self._uncertain(given.calibration)
            report["calibration"] = {"force": force, "modulus": modulus}
            rows = [replace(row, calibration_error=force * abs(row.force)) for row in rows]
        return Findings(rows, self._dynamic(rows), report, self._time(), self.warnings)

    def _time(self) -> dict[str, Any]:
        """The part `time` of run.json; empty without a history."""
        if self.history is None:
            return {}
        method = (
            "time steps"
            if self.is_stepped
            else "quadrature"
            if self.scene.relaxation
            else "equilibria"
        )
        why = next(choice.why for choice in self.scene.plan.choices if choice.key == "time")
        return {"way": "curve", "method": "JKR" if self.jkr else method, "why": why}

    def _asked(self, rows: list[Row]) -> list[Row]:
        """Those at the times of the history, at a jump the one after it; all where it names none."""
        if self.scene.history_on_curve is None or not self.scene.history_on_curve.times:
            return rows
        last = {row.t: row for row in rows}
        return [last[t] for t in self.scene.history_on_curve.times]

    def _rows(self) -> list[Row]:
        if self.history is None:
            return self._jkr_curve(self.jkr) if self.jkr else self._curve()
        if self.jkr:
            return self._jkr_history(self.jkr, self.history)
        if self.is_stepped:
            return self._stepped(self.history)
        return self._cycle(self.history) if self.scene.relaxation else self._elastic(self.history)

    def _curve(self) -> list[Row]:
        """The elastic curve, without a history."""
        curve = self.curve_to(self.deepest)
        shares = (np.arange(1, CURVE_POINTS + 1) / CURVE_POINTS) ** 2
        return [
            self._on(curve, nan, depth, "stable") for depth in map(float, self.deepest * shares)
        ]

    def _on(self, curve: ElasticCurve, t: float, delta: float, branch: str) -> Row:
        contact = Contact(
            float(curve.a(np.array(delta))), delta, float(curve.force(np.array(delta)))
        )
        return self._row(t, contact, branch)

    def _row(self, t: float, contact: Contact | relaxation.Response, branch: str) -> Row:
        return Row(
            t,
            contact.delta + self.compliance * contact.force,
            contact.delta,
            contact.force,
            contact.a,
            branch,
        )

    def _elastic(self, history: History) -> list[Row]:
        """Every point an equilibrium of the elastic curve."""
        curve = self.curve_to(self._deepest_at(history.largest))
        rows = []
        for instant in history.instants:
            value = instant.value
            delta = (
                curve.depth(value) if self.of_force else curve.depth_behind(self.compliance, value)
            )
            rows.append(self._on(curve, instant.t, delta, instant.branch))
        return rows

    def _deepest_at(self, largest: float, softest: float = 1.0) -> float:
        """The depth that the largest value of a history may lead to, in a body that keeps a share
        of its modulus.
        """
        if not self.of_force and not self.compliance:
            return largest
        top = (
            self.deepest
        )  # to expect: a narrow or round body lets the tip in farther than a half-space
        for _ in range(60):
            force = softest * float(self.curve_to(top).force(np.array(top)))
            if (force if self.of_force else top + self.compliance * force) >= largest:
                return top
            top = 1.3 * top if self.of_force else min(1.3 * top, largest)
        raise ValueError(
            f"the force {largest / softest * self.scene.physics.scales.force:g} was not reached"
        )

    def _cycle(self, history: History) -> list[Row]:
        """Lee-Radok and Ting; stepping where the contact turns out to grow again."""
        times, values = zip(*history.from_rest, strict=True)
        cycle = OneCycle(self.modulus, times, values, self.curve_to(max(values)))
        wanted = history.instants
        if cycle.regrows([instant.t for instant in wanted]):
            self.warnings.append(
                "the contact grows again while the tip retracts or is held after it: stepped in "
                "time"
            )
            self.is_stepped = True
            return self._stepped(history)
        rows = []
        for k, instant in enumerate(wanted):
            jumps = k + 1 < len(wanted) and wanted[k + 1].t == instant.t
            response = cycle.at(instant.t, after=not jumps)
            rows.append(
                self._row(instant.t, replace(response, delta=instant.value), instant.branch)
            )
        return rows

    def _stepped(self, history: History) -> list[Row]:
        times, values = map(list, zip(*history.from_rest, strict=True))
        surface = self.surface(
            self._deepest_at(
                max(values), remaining_modulus_fraction(self.scene.relaxation, history)
            )
        )
        modulus = self.modulus.prony(SHORTEST_TIME * history.span / len(times), history.span)
        stepper = StepByStep(surface, modulus, self.compliance, self.of_force)
        ways = [branch_of(*pair) for pair in pairwise(values)]
        # of the piece that ends at each point
        branches = [ways[0], *ways]
        point = 0
        rows = []
        for response in stepper.responses(times, values, list(history.pieces)):
            rows.append(self._row(response.t, response, branches[point]))
            point += response.t == times[point]
        return rows[len(history.from_rest) - len(history.points) :]

    def _jkr_curve(self, jkr: Jkr) -> list[Row]:
        """The whole equilibrium curve by the contact radius, without a history."""
        last = jkr.pull_off(self.compliance)
        deep = jkr.stable(self.deepest)
        assert deep is not None
        low = max(1.001 * self.punches.smallest, 0.02 * last.a)
        radii = low * (deep.a / low) ** np.linspace(0.0, 1.0, CURVE_POINTS)
        return [
            self._row(nan, jkr.at(float(a)), "stable" if a >= last.a else "unstable") for a in radii
        ]

    def _jkr_history(self, jkr: Jkr, history: History) -> list[Row]:
        """Stable equilibria as the history passes: the tip snaps in at first touch and comes off
        where it must.
        """
        compliance = inf if self.of_force else self.compliance
        last = jkr.pull_off(compliance)
        comes_off = last.force if self.of_force else last.delta + compliance * last.force
        rows = []
        touches = False
        stable = jkr.branch(max(instant.value for instant in history.instants), compliance)
        for instant in history.instants:
            t = instant.t
            value = instant.value
            branch = instant.branch
            touches = value > comes_off if touches else value >= 0.0
            contact = stable(value) if touches else None
            off = (
                Row(t, nan, nan, value, 0.0, branch)
                if self.of_force
                else Row(t, value, value, 0.0, 0.0, branch)
            )
            rows.append(off if contact is None else self._row(t, contact, branch))
        if any(isnan(row.delta) for row in rows):
            self.warnings.append(
                "the force pulls harder than adhesion holds: while it does there is no depth"
            )
        return rows

    def _adhesion(self, jkr: Jkr) -> dict[str, Any]:
        """The parts `adhesion` and `cantilever` of run.json."""
        by_force = jkr.pull_off(inf)
        by_depth = jkr.pull_off(0.0)
        held = {"force_control": _said(by_force), "depth_control": _said(by_depth)}
        if isinstance(
            self.punches, FittedPunches
        ):  # of a mesh, which knows where the force is least up to an error
            apart = (
                abs(Jkr(other, jkr.work).pull_off(inf).delta - by_force.delta)
                for other in self.punches.beside
            )
            held["force_control"]["delta_error"] = max(
                2 * max(apart), LEAST_PULL_OFF_ERROR * abs(by_depth.delta)
            )
        report: dict[str, Any] = {"adhesion": {"pull_off": held, **self._range(jkr.work)}}
        if self.experiment.cantilever:
            snapped = jkr.stable(0.0, self.compliance)
            last = jkr.pull_off(self.compliance)
            assert snapped is not None  # no spring lets go before z < 0
            out = {"z": last.delta + self.compliance * last.force} | _said(last)
            report["cantilever"] = {"jump_in": {"z": 0.0} | _said(snapped), "jump_out": out}
        return report

    def _range(self, work: float) -> dict[str, float]:
        """Tabor and Maugis numbers, and the pull-off force that the latter gives on a half-space."""
        given = self.experiment.adhesion
        physics = self.scene.physics
        if given is None or given.range is None:
            return {}
        R = relative_tip(physics.indenter, physics.body).R  # type: ignore[union-attr]
        numbers = work, given.range, R, physics.material.E_star
        parameter = maugis_lambda(*numbers)
        pull_off = maugis_pull_off(parameter) * np.pi * work * R
        return {"tabor": tabor(*numbers), "maugis_lambda": parameter, "maugis_pull_off": pull_off}

    def _uncertain(self, given: Calibration) -> tuple[float, float]:
        """Relative uncertainties of a force, k times a deflection, and of a modulus fitted to it, E
        ~ F/F_1(R).
        """
        of_R = 0.0
        if given.R:
            less, more = (
                self._force(R) for R in (1.0 - EXPONENT_VARIATION, 1.0 + EXPONENT_VARIATION)
            )
            of_R = log(more / less) / log((1.0 + EXPONENT_VARIATION) / (1.0 - EXPONENT_VARIATION))
        return given.stiffness, hypot(given.stiffness, of_R * given.R)

    def _force(self, share: float) -> float:
        """The elastic force at the deepest depth with the tip's radius times a share."""
        theory = self.scene.plan.theory
        tip = self.scene.physics.indenter
        tip = replace(tip, R=share * tip.R)  # type: ignore[arg-type, call-arg, union-attr]
        contact = theory.contact if theory else None
        if (
            not self.scene.is_meshed
            and isinstance(contact, LayerContact)
            and (shape := theory_tip_shape(tip))
        ):
            return replace(contact, tip=shape).curve([self.deepest])[0].force
        other = self._equilibrium.under(self.scene.replace_physics(indenter=tip))
        self._press(other, self.deepest, self.deepest)
        return float(other.force)

    def _dynamic(self, rows: list[Row]) -> list[Dynamic]:
        """K(a) (G' + i G'') of the contact that the history ends with, or of the deepest one."""
        frequencies = self.experiment.frequencies or ()
        stiffness = 0.0
        a = rows[-1].a
        if frequencies and a > 0:
            curve = self.curve_to(self.deepest)
            depths = np.geomspace(SHALLOWEST, 1.0, 4000) * curve.deepest
            delta = float(np.interp(a, curve.a(depths), depths))
            stiffness = float(curve.stiffness(np.array(delta)))
        complex_stiffness = [stiffness * self.modulus.complex(2 * np.pi * f) for f in frequencies]
        return [
            Dynamic(f, K.real, K.imag) for f, K in zip(frequencies, complex_stiffness, strict=True)
        ]


def _samples(first: float, last: float) -> list[float]:
    return [float(x) for x in np.geomspace(first, last, CURVE_SAMPLES)]


def _curve(samples: list[tuple[float, float, float]]) -> ElasticCurve:
    return ElasticCurve(*np.array(samples, dtype=float).reshape(-1, 3).T)


def _said(contact: Contact) -> dict[str, float]:
    return {"delta": contact.delta, "force": contact.force}
