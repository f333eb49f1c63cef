"""Histories evaluated on the elastic curve, with relaxation, adhesion and a cantilever."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import hypot, inf, isnan, log, nan
from typing import Any

import numpy as np

from indent_sim.model.experiment import Calibration, Experiment
from indent_sim.model.history import History, branch_of
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import Scales
from indent_sim.process.errors import NotConverged
from indent_sim.run.derived_quantities import (
    BothContacts,
    Equilibrium,
    fit_both_contacts,
    punches_of,
)
from indent_sim.run.measured_constants import EDGE_SHIFT, MIN_PULL_OFF_ERROR
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory.adhesion import AdhesiveContact, Jkr
from indent_sim.theory.adhesion_in_series import JkrInSeries
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.elastic_curve import MIN_CURVE_SAMPLES, ElasticCurve
from indent_sim.theory.layer import Layer
from indent_sim.theory.lee_radok_ting import LeeRadokTing, Response
from indent_sim.theory.maugis import maugis_lambda, maugis_pull_off, tabor_number
from indent_sim.theory.punches import Punches, contact_radius
from indent_sim.theory.relaxation_function import Modulus, PowerLaw, ShearRelaxation
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.surface_contact import RelaxingSurface, layer_surface
from indent_sim.theory.viscoelastic_stepping import ViscoelasticTimeStepper

# Number of rows of an experiment without a history.
CURVE_POINTS = 200
# Least sampled depth, relative to the largest; the curve is a power law below it.
MIN_DEPTH_FRACTION = 1e-5
# Number of samples of an elastic curve.
CURVE_SAMPLES = 80
# The curve is sampled slightly beyond the requested depth.
DEPTH_OVERSHOOT = 1.001


@dataclass(frozen=True)
class CurveRow:
    """Row of a history or of an equilibrium curve; undefined quantities are NaN.

    `calibration_error` is the error of the force due to the calibration of the instrument.
    """

    t: float
    z: float
    delta: float
    force: float
    a: float
    branch: str
    a_base: float | None = None
    calibration_error: float | None = None


@dataclass(frozen=True)
class DynamicStiffness:
    """Row of dynamic.csv: in-phase and out-of-phase stiffness of the contact at a frequency."""

    frequency: float
    storage: float
    loss: float


@dataclass(frozen=True)
class HistoryResult:
    """Result of a history or an experiment.

    Attributes
    ----------
    rows
        The rows of the history.
    dynamic
        The rows of dynamic.csv.
    report
        The part `experiment` of run.json.
    time
        The method of a history, for the part `time` of run.json.
    warnings
        Messages of warnings.
    """

    rows: list[CurveRow]
    dynamic: list[DynamicStiffness] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)
    time: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def in_units(self, scales: Scales) -> HistoryResult:
        """Return the result in the user's units."""
        depth = scales.depth
        force = scales.force
        units = {
            "z": depth,
            "delta": depth,
            "force": force,
            "a": scales.length,
            "a_base": scales.length,
            "calibration_error": force,
        }
        units |= {
            "delta_error": depth,
            "maugis_pull_off": force,
            "storage": force / depth,
            "loss": force / depth,
        }
        rows = [CurveRow(**_scale_numbers(vars(row), units)) for row in self.rows]
        dynamic = [DynamicStiffness(**_scale_numbers(vars(row), units)) for row in self.dynamic]
        # Parts of run.json whose numbers have units.
        dimensional_parts = ("adhesion", "cantilever")
        converted = {
            name: _scale_numbers(self.report[name], units)
            for name in dimensional_parts
            if name in self.report
        }
        return replace(self, rows=rows, dynamic=dynamic, report=self.report | converted)


def _scale_numbers(numbers: Mapping[str, Any], units: Mapping[str, float]) -> dict[str, Any]:
    """Return numbers, also in nested dictionaries, multiplied by the units of their names."""
    scaled: dict[str, Any] = {}
    for name, value in numbers.items():
        if isinstance(value, dict):
            scaled[name] = _scale_numbers(value, units)
        elif value and name in units:
            scaled[name] = value * units[name]
        else:
            scaled[name] = value
    return scaled


def relaxation_modulus(law: Relaxation | None) -> Modulus:
    """Return the normalised relaxation modulus G(t)/G(0); it is 1 without relaxation."""
    if law and law.power_law:
        return PowerLaw(law.power_law.exponent, law.power_law.time)
    terms = law.prony if law and law.prony else ()
    return ShearRelaxation(
        tuple(fraction for fraction, _ in terms), tuple(time for _, time in terms)
    )


def evaluate_with_units(scene: Scene, equilibrium: Equilibrium = None) -> HistoryResult:
    """Evaluate history and experiment of a scene, in the user's units; see `evaluate_history`."""
    return evaluate_history(scene, equilibrium).in_units(scene.physics.scales)


def evaluate_history(scene: Scene, equilibrium: Equilibrium = None) -> HistoryResult:
    """Evaluate history and experiment of a scene on its elastic curve, nondimensional.

    Parameters
    ----------
    scene
        The scene.
    equilibrium
        The condensed body; None without a mesh.

    Raises
    ------
    NotConverged
        If the elastic curve does not reach a depth.
    """
    try:
        return _HistoryEvaluation(scene, equilibrium).evaluate()
    except SOLUTION_ERRORS as error:
        raise NotConverged(
            f"{'history' if scene.history_on_curve else 'experiment'}: {error}"
        ) from error


class _HistoryEvaluation:
    """Evaluation of one history, one experiment, or both; nondimensional."""

    def __init__(self, scene: Scene, equilibrium: Equilibrium):
        self.scene = scene
        self.experiment = scene.experiment or Experiment()
        self.history = scene.history_on_curve and scene.history_on_curve.with_row_times_inserted
        self._equilibrium = equilibrium
        self.compliance = self.experiment.compliance
        self.has_prescribed_forces = (
            scene.history_on_curve is not None and scene.history_on_curve.control == "force"
        )
        self.max_depth = max(scene.physics.deltas)
        self.modulus = relaxation_modulus(scene.relaxation)
        # Method by which the rows of a history are computed
        self.method = scene.plan.time.method if scene.plan.time else ""
        self.warnings: list[str] = []
        self._curves: dict[float, ElasticCurve] = {}
        # Punches of tip and flat on a body that adheres to a flat, once `jkr` is computed
        self._both_contacts: BothContacts = None

    @cached_property
    def punches(self) -> Punches:
        """Flat punches of every contact radius on the body, from which the contact follows."""
        return punches_of(self.scene, self._equilibrium)

    @cached_property
    def jkr(self) -> Jkr | None:
        """The adhesive contact of the tip; None without adhesion."""
        adhesion = self.experiment.adhesion
        if adhesion is None:
            return None
        if adhesion.base_work is None:
            return Jkr(self.punches, adhesion.work)
        # The distributions of the forces on both contacts are those of the deepest one.
        self._solve_depth(self._equilibrium, self.max_depth, self.max_depth)
        self._both_contacts = self._equilibrium.both_contacts()
        upper, lower = fit_both_contacts(self.scene, self._both_contacts)
        return JkrInSeries(
            Jkr(upper, adhesion.work),
            Jkr(lower, adhesion.base_work),
            self._both_contacts.shared_compliance,
        )

    def elastic_curve(self, top: float) -> ElasticCurve:
        """The elastic curve up to a depth, computed once."""
        if top not in self._curves:
            self._curves[top] = self._sample_curve(top)
        return self._curves[top]

    def _sample_curve(self, top: float) -> ElasticCurve:
        """Compute samples of the elastic curve by theory, by flat punches, or by equilibria."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None
            solutions = theory.contact.solutions_at_depths(
                _geometric_samples(MIN_DEPTH_FRACTION * top, DEPTH_OVERSHOOT * top)
            )
            return _elastic_curve([(s.delta, s.force, s.a) for s in solutions])
        # The solution at the largest depth condenses the body to as much surface as is needed.
        self._solve_depth(self._equilibrium, top * DEPTH_OVERSHOOT, top)
        try:
            radii = _geometric_samples(
                self.punches.min_radius, contact_radius(self.punches, DEPTH_OVERSHOOT * top)
            )
        except SOLUTION_ERRORS:
            return self._curve_from_equilibria(top)
        samples = [self.punches.punch_of_radius(a) for a in radii]
        return _elastic_curve([(p.delta, p.force, p.a) for p in samples])

    def _solve_depth(self, equilibrium: Equilibrium, depth: float, stated_depth: float) -> None:
        """Solve a body at a depth; raise ValueError if it fails."""
        if not equilibrium.solve(depth):
            failed_depth = stated_depth * self.scene.physics.scales.depth
            raise ValueError(f"the depth {failed_depth:g} was not reached: {equilibrium.failure}")

    def _curve_from_equilibria(self, top: float) -> ElasticCurve:
        """Return the elastic curve through equilibria on the mesh at depths up to `top`."""
        samples: list[tuple[float, float, float]] = []
        # Least number of elements in the contact of a sample.
        min_elements = 2.0
        for delta in _geometric_samples(DEPTH_OVERSHOOT * top, MIN_DEPTH_FRACTION * top):
            if not self._equilibrium.solve(delta):
                break
            numbers = self._equilibrium.state_values()
            if numbers["a"] < min_elements * self.scene.sizes.h_contact:
                break
            samples.append((delta, numbers["force"], numbers["a"]))
        if len(samples) < MIN_CURVE_SAMPLES:
            element_text = (
                f"the contact radius has {min_elements:g} or more elements at only "
                f"{len(samples)} of {CURVE_SAMPLES} depths"
            )
            raise ValueError(f"{element_text}: give a smaller mesh.h_contact")
        return _elastic_curve(samples[::-1])

    def relaxing_surface(self, top: float) -> RelaxingSurface:
        """Return the surface points and compliance for viscoelastic time stepping up to a depth."""
        if not self.scene.is_meshed:
            theory = self.scene.plan.theory
            assert theory is not None and isinstance(theory.contact, Layer)
            return layer_surface(
                theory.contact, theory.contact.solutions_at_depths([DEPTH_OVERSHOOT * top])[0].a
            )
        self._solve_depth(self._equilibrium, top * DEPTH_OVERSHOOT, top)
        x, heights, areas, A = self._equilibrium.contact.weighted_gap_system
        domain = self.scene.physics.domain
        symmetry_factor = self.scene.physics.domain.symmetry_factor
        is_axisymmetric = domain.kinematics.name == "axisymmetric"
        order = np.argsort(x[:, 0]) if is_axisymmetric else np.arange(len(x))
        heights = symmetry_factor * heights[order]
        areas = symmetry_factor * areas[order]
        A = symmetry_factor * A[np.ix_(order, order)]
        if not is_axisymmetric:
            return RelaxingSurface(
                A, heights, areas, is_plane_strain=self.scene.physics.scales.dim == 2
            )
        return RelaxingSurface(
            A, heights, areas, x[order, 0], EDGE_SHIFT[domain.regions[0].formulation]
        )

    def evaluate(self) -> HistoryResult:
        """Evaluate the history and the experiment."""
        rows = self._rows_at_times(self._rows())
        experiment = self.experiment
        report: dict[str, Any] = {"by": "condensed body" if self.scene.is_meshed else "theory"}
        if self.jkr:
            report |= self._adhesion_report(self.jkr)
        if experiment.calibration:
            force, modulus = self._calibration_uncertainty(experiment.calibration)
            report["calibration"] = {"force": force, "modulus": modulus}
            rows = [replace(row, calibration_error=force * abs(row.force)) for row in rows]
        time_report = {"method": self.method} if self.history else {}
        return HistoryResult(
            rows, self._dynamic_stiffness(rows), report, time_report, self.warnings
        )

    def _rows_at_times(self, rows: list[CurveRow]) -> list[CurveRow]:
        """Select the rows at the requested times (the later one at a jump), or all rows."""
        if self.scene.history_on_curve is None or not self.scene.history_on_curve.times:
            return rows
        last = {row.t: row for row in rows}
        return [last[t] for t in self.scene.history_on_curve.times]

    def _rows(self) -> list[CurveRow]:
        """Compute the rows by the method that suits the history, adhesion and relaxation."""
        if self.history is None:
            return self._jkr_curve_rows(self.jkr) if self.jkr else self._elastic_curve_rows()
        rows_by: dict[str, Callable[[History], list[CurveRow]]] = {
            "JKR": self._jkr_history_rows,
            "equilibria": self._quasistatic_rows,
            "quadrature": self._lee_radok_ting_rows,
            "time steps": self._time_stepped_rows,
        }
        return rows_by[self.method](self.history)

    def _elastic_curve_rows(self) -> list[CurveRow]:
        """Return rows of the elastic curve for an experiment without a history."""
        curve = self.elastic_curve(self.max_depth)
        depth_fractions = (np.arange(1, CURVE_POINTS + 1) / CURVE_POINTS) ** 2
        return [
            self._row_on_curve(curve, nan, depth, "stable")
            for depth in map(float, self.max_depth * depth_fractions)
        ]

    def _row_on_curve(self, curve: ElasticCurve, t: float, delta: float, branch: str) -> CurveRow:
        """Return the row of an elastic equilibrium at a depth."""
        contact = AdhesiveContact(
            float(curve.contact_radius(np.array(delta))), delta, float(curve.force(np.array(delta)))
        )
        return self._make_row(t, contact, branch)

    def _make_row(self, t: float, contact: AdhesiveContact | Response, branch: str) -> CurveRow:
        """Return the row of a contact, with the position of the cantilever's base."""
        return CurveRow(
            t,
            contact.delta + self.compliance * contact.force,
            contact.delta,
            contact.force,
            contact.a,
            branch,
        )

    def _quasistatic_rows(self, history: History) -> list[CurveRow]:
        """Return the rows of a history without relaxation: equilibria on the elastic curve."""
        curve = self.elastic_curve(self._max_depth_at(history.largest_value))
        rows = []
        for instant in history.rows:
            value = instant.value
            delta = (
                curve.depth_of_force(value)
                if self.has_prescribed_forces
                else curve.depth_behind_spring(self.compliance, value)
            )
            rows.append(self._row_on_curve(curve, instant.t, delta, instant.branch))
        return rows

    def _max_depth_at(self, largest: float, softest: float = 1.0) -> float:
        """Return an upper bound of the depth at the largest value of a history.

        Parameters
        ----------
        largest
            The largest depth, base position or force.
        softest
            Smallest fraction of the modulus during the history.
        """
        if not self.has_prescribed_forces and not self.compliance:
            return largest
        # The expected depth is that of a half-space; a narrow or round body is softer.
        top = self.max_depth
        for _ in range(60):
            force = softest * float(self.elastic_curve(top).force(np.array(top)))
            if (force if self.has_prescribed_forces else top + self.compliance * force) >= largest:
                return top
            top = 1.3 * top if self.has_prescribed_forces else min(1.3 * top, largest)
        raise ValueError(
            "no depth of the elastic load curve reaches the force "
            f"{largest / softest * self.scene.physics.scales.force:g}"
        )

    def _lee_radok_ting_rows(self, history: History) -> list[CurveRow]:
        """Return rows by Lee-Radok and Ting, or by time stepping if the contact grows again."""
        times, values = zip(*history.points_from_rest, strict=True)
        cycle = LeeRadokTing(self.modulus, times, values, self.elastic_curve(max(values)))
        instants = history.rows
        if cycle.contact_grows_again([instant.t for instant in instants]):
            self.warnings.append(
                "the contact grows again during unloading or a subsequent hold: the history is "
                "solved by time stepping"
            )
            self.method = "time steps"
            return self._time_stepped_rows(history)
        rows = []
        for k, instant in enumerate(instants):
            jumps = k + 1 < len(instants) and instants[k + 1].t == instant.t
            response = cycle.response_at(instant.t, is_after_jump=not jumps)
            rows.append(
                self._make_row(instant.t, replace(response, delta=instant.value), instant.branch)
            )
        return rows

    def _time_stepped_rows(self, history: History) -> list[CurveRow]:
        """Return rows of a relaxing body by time stepping."""
        times, values = map(list, zip(*history.points_from_rest, strict=True))
        surface = self.relaxing_surface(
            self._max_depth_at(
                max(values), remaining_modulus_fraction(self.scene.relaxation, history)
            )
        )
        # Shorter times of a power law, relative to the history, have no effect in time
        # stepping.
        min_time_fraction = 1e-3
        modulus = self.modulus.prony_series(
            min_time_fraction * history.duration / len(times), history.duration
        )
        stepper = ViscoelasticTimeStepper(
            surface, modulus, self.compliance, self.has_prescribed_forces
        )
        segment_branches = [branch_of(*pair) for pair in pairwise(values)]
        # Branch of the segment that ends at each point.
        branches = [segment_branches[0], *segment_branches]
        point = 0
        rows = []
        for response in stepper.responses(times, values, list(history.rows_per_segment)):
            rows.append(self._make_row(response.t, response, branches[point]))
            point += response.t == times[point]
        return rows[len(history.points_from_rest) - len(history.points) :]

    def _jkr_curve_rows(self, jkr: Jkr) -> list[CurveRow]:
        """Return the equilibrium curve with adhesion as a function of the contact radius."""
        pull_off = jkr.pull_off(self.compliance)
        deepest_contact = jkr.stable_equilibrium(self.max_depth)
        assert deepest_contact is not None
        smallest_radius = max(1.001 * jkr.punches.min_radius, 0.02 * pull_off.a)
        radii = smallest_radius * (deepest_contact.a / smallest_radius) ** np.linspace(
            0.0, 1.0, CURVE_POINTS
        )
        contacts = [jkr.equilibrium_at(float(a)) for a in radii]
        rows = [
            self._make_row(nan, contact, "stable" if contact.a >= pull_off.a else "unstable")
            for contact in contacts
        ]
        if not isinstance(jkr, JkrInSeries):
            return rows
        both_radii = map(jkr.radii, contacts)
        return [
            replace(row, a=a, a_base=a_base)
            for row, (a, a_base) in zip(rows, both_radii, strict=True)
        ]

    def _jkr_history_rows(self, history: History) -> list[CurveRow]:
        """Return stable equilibria along a history with adhesion, with snap-in and pull-off."""
        jkr = self.jkr
        assert jkr is not None
        compliance = inf if self.has_prescribed_forces else self.compliance
        pull_off = jkr.pull_off(compliance)
        pull_off_value = (
            pull_off.force
            if self.has_prescribed_forces
            else pull_off.delta + compliance * pull_off.force
        )
        rows = []
        is_touching = False
        stable = jkr.stable_branch(max(instant.value for instant in history.rows), compliance)
        for instant in history.rows:
            t = instant.t
            value = instant.value
            branch = instant.branch
            is_touching = value > pull_off_value if is_touching else value >= jkr.first_contact
            contact = stable(value) if is_touching else None
            separated = (
                CurveRow(t, nan, nan, value, 0.0, branch)
                if self.has_prescribed_forces
                else CurveRow(t, value, value, 0.0, 0.0, branch)
            )
            rows.append(separated if contact is None else self._make_row(t, contact, branch))
        if any(isnan(row.delta) for row in rows):
            self.warnings.append(
                "in some rows the prescribed tensile force exceeds the pull-off force: these rows "
                "have no depth"
            )
        return rows

    def _adhesion_report(self, jkr: Jkr) -> dict[str, Any]:
        """Return the parts `adhesion` and `cantilever` of run.json."""
        by_force = jkr.pull_off(inf)
        by_depth = jkr.pull_off(0.0)
        pull_offs = {
            "force_control": _contact_entry(by_force),
            "depth_control": _contact_entry(by_depth),
        }
        # The depth of the largest tensile force has an error if it comes from a mesh.
        if neighbours := jkr.neighbouring_fits:
            depth_differences = (
                abs(neighbour.pull_off(inf).delta - by_force.delta) for neighbour in neighbours
            )
            pull_offs["force_control"]["delta_error"] = max(
                2 * max(depth_differences), MIN_PULL_OFF_ERROR * abs(by_depth.delta)
            )
        report: dict[str, Any] = {
            "adhesion": {"pull_off": pull_offs, **self._attraction_range_report(jkr.work)}
        }
        if isinstance(jkr, JkrInSeries):
            report["adhesion"] |= self._lost_contact_report(jkr)
        if self.experiment.cantilever:
            jump_in_contact = jkr.stable_equilibrium(jkr.first_contact, self.compliance)
            pull_off = jkr.pull_off(self.compliance)
            jump_out = {"z": pull_off.delta + self.compliance * pull_off.force} | _contact_entry(
                pull_off
            )
            report["cantilever"] = {
                # There is none if the tip tears the body off the flat as soon as it touches it.
                "jump_in": jump_in_contact
                and {"z": jkr.first_contact} | _contact_entry(jump_in_contact),
                "jump_out": jump_out,
            }
        return report

    def _lost_contact_report(self, jkr: JkrInSeries) -> dict[str, Any]:
        """Return the contact that is lost at pull-off, and the error of the sum of two contacts."""
        lost_contact, what = (
            ("base", "the body leaves the flat and stays on the tip")
            if jkr.is_base_weaker
            else ("tip", "the tip leaves the body, which stays on the flat")
        )
        error = self._series_error(jkr)
        words = (
            f"at pull-off {what}; the depth is a sum of two contacts, which is inexact by up to "
            f"{100 * error:.2g} % of the largest depth"
        )
        if jkr.stable_equilibrium(jkr.first_contact, self.compliance) is None:
            self.warnings.append(
                "the tip tears the body off the flat as soon as it touches it: approach and "
                "retraction are those of a body that is held on the flat until it is pressed"
            )
        return {"lost_contact": lost_contact, "series_error": error, "words": words}

    def _series_error(self, jkr: JkrInSeries) -> float:
        """Return the largest error of the depth as a sum of two contacts, over the deepest one.

        It is evaluated at pull-off under force and depth control, at a force of 0 and in the
        deepest contact.
        """
        states = (
            jkr.pull_off(inf),
            jkr.pull_off(0.0),
            jkr.stable_equilibrium(0.0, inf),
            jkr.stable_equilibrium(self.max_depth),
        )
        errors = (
            self._both_contacts.depth_error(*jkr.radii(state), state.force)
            for state in states
            if state is not None
        )
        return max(map(abs, errors)) / self.max_depth

    def _attraction_range_report(self, work: float) -> dict[str, float]:
        """Return the Tabor and Maugis parameters, and the Maugis pull-off force on a half-space.

        The result is empty if the adhesion has no range.
        """
        attraction = self.experiment.adhesion
        physics = self.scene.physics
        if attraction is None or attraction.range is None:
            return {}
        R = relative_tip(physics.indenter, physics.body).R  # type: ignore[union-attr]
        numbers = work, attraction.range, R, physics.material.E_star
        parameter = maugis_lambda(*numbers)
        pull_off = maugis_pull_off(parameter) * np.pi * work * R
        return {
            "tabor": tabor_number(*numbers),
            "maugis_lambda": parameter,
            "maugis_pull_off": pull_off,
        }

    def _calibration_uncertainty(self, calibration: Calibration) -> tuple[float, float]:
        """Return the relative uncertainties of a force and of a modulus due to calibration.

        A force is the spring constant times the deflection. The fitted modulus is F/F_1(R), with
        the force F_1 for unit modulus and the tip radius R.
        """
        radius_exponent = 0.0
        if calibration.R:
            # Relative change of R for the finite difference d ln F/d ln R.
            variation = 0.05
            smaller_force, larger_force = (
                self._force_with_radius(R) for R in (1.0 - variation, 1.0 + variation)
            )
            radius_exponent = log(larger_force / smaller_force) / log(
                (1.0 + variation) / (1.0 - variation)
            )
        return calibration.stiffness, hypot(calibration.stiffness, radius_exponent * calibration.R)

    def _force_with_radius(self, radius_ratio: float) -> float:
        """Return the elastic force at the largest depth for a tip with another radius."""
        theory = self.scene.plan.theory
        tip = self.scene.physics.indenter.scaled(radius_ratio)
        contact = theory.contact if theory else None
        if (
            not self.scene.is_meshed
            and isinstance(contact, ContactCurve)
            and (shape := theory_tip_shape(tip))
        ):
            return replace(contact, tip=shape).solutions_at_depths([self.max_depth])[0].force
        equilibrium = self._equilibrium.reuse_body(self.scene.replace_physics(indenter=tip))
        self._solve_depth(equilibrium, self.max_depth, self.max_depth)
        return float(equilibrium.force)

    def _dynamic_stiffness(self, rows: list[CurveRow]) -> list[DynamicStiffness]:
        """Return the dynamic stiffness of the contact at the end of the history.

        It is the stiffness of the contact times the complex modulus G' + i G'' at each frequency.
        If the contact has been lost by then, the contact at the largest depth is used.
        """
        frequencies = self.experiment.frequencies or ()
        stiffness = 0.0
        a = rows[-1].a
        if frequencies and a > 0:
            curve = self.elastic_curve(self.max_depth)
            depths = np.geomspace(MIN_DEPTH_FRACTION, 1.0, 4000) * curve.deepest
            delta = float(np.interp(a, curve.contact_radius(depths), depths))
            stiffness = float(curve.stiffness(np.array(delta)))
        complex_stiffness = [
            stiffness * self.modulus.complex_modulus(2 * np.pi * f) for f in frequencies
        ]
        return [
            DynamicStiffness(f, K.real, K.imag)
            for f, K in zip(frequencies, complex_stiffness, strict=True)
        ]


def _geometric_samples(first: float, last: float) -> list[float]:
    """Return CURVE_SAMPLES values in geometric progression."""
    return [float(x) for x in np.geomspace(first, last, CURVE_SAMPLES)]


def _elastic_curve(samples: list[tuple[float, float, float]]) -> ElasticCurve:
    """Return the elastic curve through samples of depth, force and contact radius."""
    return ElasticCurve(*np.array(samples, dtype=float).reshape(-1, 3).T)


def _contact_entry(contact: AdhesiveContact) -> dict[str, float]:
    """Return the entry of run.json that describes the contact."""
    return {"delta": contact.delta, "force": contact.force}
