"""Reference solution of a study: theory, the finest run, a force, or another result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.scene_file import SourceLocation
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results import reader, unit_conversion
from indent_sim.results.measured.measurement import curve_parts
from indent_sim.results.reader import Results
from indent_sim.studies.cases import Case
from indent_sim.studies.study_file import StudyFile

DEPTH_TOLERANCE = 1e-9  # relative


@dataclass(frozen=True)
class ReferenceCurve:
    """Force, contact radius and peak pressure over depth, in the user's units; NaN if unknown.

    Attributes
    ----------
    is_interpolated
        True if the compared run is force controlled. The depths of such a run are results and
        differ slightly from those of the reference, so that power laws interpolate between the
        points of the reference.
    is_measured
        True if the points are a measured curve, which is interpolated linearly.
    """

    delta: np.ndarray
    force: np.ndarray
    a: np.ndarray
    p_max: np.ndarray
    is_interpolated: bool = field(default=False, kw_only=True)
    is_measured: bool = field(default=False, kw_only=True)

    def interpolate(self, delta: float) -> tuple[float, float, float]:
        """Return (force, a, p_max) at a depth, interpolated by power laws if allowed, or NaN."""
        columns = self.force, self.a, self.p_max
        if self.is_measured:
            return tuple(
                float(np.interp(delta, self.delta, column, nan, nan)) for column in columns
            )  # type: ignore[return-value]
        if self.is_interpolated:
            return tuple(  # type: ignore[return-value]
                _interpolate_power_law(delta, self.delta, column) for column in columns
            )
        matching_rows = np.flatnonzero(np.isclose(self.delta, delta, rtol=DEPTH_TOLERANCE, atol=0))[
            -1:
        ]
        return tuple(
            float(column[matching_rows[0]]) if len(matching_rows) else nan for column in columns
        )  # type: ignore[return-value]


def _interpolate_power_law(x: float, known_x: np.ndarray, values: np.ndarray) -> float:
    """Return the value of the power law through the two nearest positive points; may be NaN."""
    nearest = [i for i in np.argsort(np.abs(known_x - x)) if known_x[i] > 0 and values[i] > 0]
    second_index = next(
        (
            i
            for i in nearest
            if not np.isclose(known_x[i], known_x[nearest[0]], rtol=DEPTH_TOLERANCE, atol=0)
        ),
        None,
    )
    if x <= 0 or second_index is None:
        return nan
    slope = np.log(values[second_index] / values[nearest[0]]) / np.log(
        known_x[second_index] / known_x[nearest[0]]
    )
    return float(values[nearest[0]] * (x / known_x[nearest[0]]) ** slope)


class ReferenceSolution:
    """Reference of each case of a study.

    `notes` are remarks for readers of the comparison.
    """

    def __init__(self, study: StudyFile, cases: Sequence[Case]):
        self.notes: tuple[str, ...] = ()
        self._compare_to = study.compare_to
        self._has_named_cases = bool(study.named_cases)
        self._curves: dict[str, ReferenceCurve] = {}
        self._file_curve: ReferenceCurve | None = None
        self._finest_cases: dict[str, Case] = {}  # finest run by problem
        location = study.compare_to_location
        if self._compare_to != "finest" and any(
            case.planned_run.scene.is_time_dependent for case in cases
        ):
            raise _config_error(
                location,
                "rows are compared by depth, but a time history passes a depth several times",
                "leave it out",
            )
        if self._compare_to == "theory":
            self._use_theory(cases, location)
        elif isinstance(self._compare_to, float):
            if any(case.planned_run.has_prescribed_forces for case in cases):
                raise _config_error(
                    location,
                    "a single force cannot be the reference for runs with prescribed forces",
                    "use compare_to: theory, compare_to: finest, or the path of a result",
                )
        elif not isinstance(self._compare_to, str):
            try:
                results = _read_result(self._compare_to, cases)
                self._file_curve = result_curve(results)
                note = (
                    "the reference is a time history: runs are compared with the rows of its "
                    "approach"
                )
                self.notes = (
                    (note,)
                    if "t" in results.table and not results.report.get(reader.MEASURED)
                    else ()
                )
            except UsageError as error:
                raise _config_error(
                    location,
                    str(error),
                    "give a result folder, its force_indentation.csv or a measured curve",
                ) from None
            uncovered_cases = [
                case
                for case in cases
                if math.isnan(
                    _adapt_to_case(case, self._file_curve).interpolate(case.last_depth)[0]
                )
            ]
            if uncovered_cases:
                first_case = uncovered_cases[0]
                raise _config_error(
                    location,
                    f"does not reach the depth {first_case.last_depth:g}, the last one of the run "
                    f"{first_case.label}",
                    "compare with a longer curve, with theory or with finest",
                )

    @property
    def name(self) -> str:
        """Name of the reference in messages, tables and legends."""
        if isinstance(self._compare_to, float):
            return f"{self._compare_to:g}"
        if len(self._finest_cases) == 1:
            return f"finest: {next(iter(self._finest_cases.values())).label}"
        return self._compare_to if isinstance(self._compare_to, str) else self._compare_to.name

    @property
    def reference_ids(self) -> set[str]:
        """Ids of the runs with which other runs are compared."""
        return {case.id for case in self._finest_cases.values()}

    def reference_name(self, case: Case) -> str | None:
        """Return the reference of a case: id of a run, "theory", a force, or the name of a result.

        The result is None if the case has no reference.
        """
        if self._compare_to == "finest":
            finest_case = self._finest_cases.get(case.problem_key)
            return finest_case.id if finest_case else None
        return self.name if self.reference_curve(case) else None

    def choose_finest_cases(
        self, cases: Sequence[Case], results_by_id: Mapping[str, Results]
    ) -> None:
        """Choose the finest run of every problem as its reference, if the study requests this.

        The finest run has the most unknowns, and among equal meshes the smallest penetration, which
        is an error of the penalty method.
        """
        if self._compare_to != "finest":
            return
        cases_by_problem: dict[str, list[Case]] = {}
        comparable_cases = (
            case
            for case in cases
            if case.id in results_by_id and not case.planned_run.scene.is_time_dependent
        )
        for case in sorted(
            comparable_cases, key=lambda case: _resolution_order(case, results_by_id)
        ):
            cases_by_problem.setdefault(case.problem_key, []).append(case)
        # Each list ends with its finest case. A single run has no reference.
        self._finest_cases = {
            problem: candidates[-1]
            for problem, candidates in cases_by_problem.items()
            if len({case.id for case in candidates}) > 1
        }
        self._curves = {
            problem: result_curve(results_by_id[finest_case.id])
            for problem, finest_case in self._finest_cases.items()
        }
        if cases_by_problem and not self._finest_cases and not self._has_named_cases:
            note = (
                "all runs solve different problems and are not compared; curves.csv and curves.png "
                "contain their curves"
            )
            self.notes = (note,)
        if len(self._finest_cases) == 1:
            (finest_case,) = self._finest_cases.values()
            unknowns = results_by_id[finest_case.id].report.get("dofs") or "no"
            self.notes = (
                f"compared with the finest run, {finest_case.label}: {unknowns} "
                f"unknowns{_penetration_text(results_by_id[finest_case.id])}",
            )

    def reference_curve(self, case: Case) -> ReferenceCurve | None:
        """Return the reference of a case; None if the case has no reference."""
        if isinstance(self._compare_to, float):
            return ReferenceCurve(
                *(np.array([value]) for value in (case.last_depth, self._compare_to, nan, nan))
            )
        curve = self._file_curve or self._curves.get(case.problem_key)
        return _adapt_to_case(case, curve) if curve else None

    def _use_theory(self, cases: Sequence[Case], location: SourceLocation) -> None:
        for case in cases:
            curve = self._curves.get(case.problem_key) or theory_curve(case)
            if curve is None:
                raise _config_error(
                    location,
                    f"there is no theory for {case.label}",
                    "compare_to: finest always works",
                )
            self._curves[case.problem_key] = curve
        inexact_scene = next(
            (case.planned_run.scene for case in cases if not case.planned_run.scene.exact_theory),
            None,
        )
        if inexact_scene is not None:
            reasons = "; ".join(inexact_scene.theory_differences)
            self.notes = (
                f"theory is not exact for this body ({reasons}): the errors include the difference",
            )


def _adapt_to_case(case: Case, curve: ReferenceCurve) -> ReferenceCurve:
    """Return the reference curve of a case; it is interpolated if forces are prescribed."""
    return dataclasses.replace(curve, is_interpolated=case.planned_run.has_prescribed_forces)


def theory_curve(case: Case) -> ReferenceCurve | None:
    """Return the curve of the theory at the depths of a case; None if no theory applies.

    At most 200 depths are evaluated. If forces are prescribed, the depths cover a range
    around the predicted ones.
    """
    scene = case.planned_run.scene
    depths = [delta for delta in scene.physics.deltas if delta > 0]
    # Largest number of depths at which the theory is evaluated.
    max_depths = 200
    # the last depth is always included
    depths = depths[:: -max(1, len(depths) // max_depths)][::-1]
    if case.planned_run.has_prescribed_forces and depths:
        # The depth of a prescribed force differs from the predicted one by less than this factor.
        depth_factor = 1.3
        depths_around = np.geomspace(
            min(depths) / depth_factor,
            min(max(depths) * depth_factor, scene.physics.body.height),
            max_depths,
        )
        depths = [float(depth) for depth in depths_around]
    solutions: Sequence[Any] | None = []
    if depths:
        theory = scene.plan.theory
        solutions = theory.solutions_at_depths(depths) if theory else None
    if solutions is None:
        return None
    scales = scene.physics.scales
    L = scales.length
    D = scales.depth
    P = scales.pressure
    F = scales.force
    open_depths = sorted({delta for delta in scene.physics.deltas if delta <= 0})
    rows = [
        (solution.delta * D, solution.force * F, solution.a * L, _peak_pressure(solution) * P)
        for solution in solutions
    ]
    rows += [(delta * D, 0.0, 0.0, 0.0) for delta in open_depths]
    return ReferenceCurve(*np.array(rows).T)


def _read_result(path: Path, cases: Sequence[Case]) -> Results:
    """Return a result, or a measured curve converted to the units of the cases.

    Raises
    ------
    UsageError
        If the result is in other units.
    """
    results = reader.read(path)
    if not cases:
        return results
    units = cases[0].planned_run.config.units
    scene = Results(
        Path("the study"), {}, {"units": {"length": units.length, "force": units.force}}
    )
    scene_and_result = unit_conversion.convert_to_common_units([scene, results])
    unit_conversion.refuse_different_units(
        scene_and_result, "run that scene in the units of the study"
    )
    return scene_and_result[1]


def result_curve(results: Results) -> ReferenceCurve:
    """Return the reference curve of a result: its table, or the approach of a time history.

    The approach of a measured curve is sorted by depth.
    """
    unknown = np.full(len(results), nan)
    if "t" in results.table and not results.report.get(reader.MEASURED):
        rows = curve_parts(results["delta"])["approach"]
        return ReferenceCurve(
            *(results.table.get(name, unknown)[rows] for name in ("delta", "force", "a", "p_max"))
        )
    if results.report.get(reader.MEASURED):
        rows = curve_parts(results["delta"])["approach"]
        order = np.argsort(results["delta"][rows], kind="stable")
        delta_and_force = (results["delta"][rows][order], results["force"][rows][order])
        return ReferenceCurve(*delta_and_force, unknown[rows], unknown[rows], is_measured=True)
    return ReferenceCurve(
        results["delta"], results["force"], results["a"], results.table.get("p_max", unknown)
    )


def _peak_pressure(solution: Any) -> float:
    """Return the largest pressure; NaN where it is infinite (a sharp edge or apex)."""
    # Number of radii at which the pressure of theory is sampled to find its peak.
    peak_radii = 200
    radii = solution.a * np.linspace(0, 1, peak_radii + 1)
    with np.errstate(all="ignore"):
        p = np.asarray(solution.pressure(radii), dtype=float)
    is_unbounded = p[:-1].max() > 1.5 * p[2:-2].max()
    return nan if not np.isfinite(p).all() or is_unbounded else float(p.max())


def _resolution_order(case: Case, results_by_id: Mapping[str, Results]) -> tuple[Any, ...]:
    """Return a sort key from coarse to fine, then from large to small penetration."""
    scene = case.planned_run.scene
    results = results_by_id[case.id]
    dofs = results.report.get("dofs", 0) if scene.is_meshed else math.inf
    return dofs, -_last_penetration(results), -scene.sizes.h_contact, -case.index


def _last_penetration(results: Results) -> float:
    """Return the penetration in the last row [length]; 0 if it is unknown."""
    column = results.table.get("penetration", np.zeros(1))
    return float(np.nan_to_num(column[-1])) if len(column) else 0.0


def _penetration_text(results: Results) -> str:
    """Return the penetration of the last row as text."""
    return f", penetration {_last_penetration(results):.2g} at its last row"


def _config_error(location: SourceLocation, problem: str, remedy: str = "") -> ConfigError:
    return ConfigError("compare_to", problem, remedy, *location)
