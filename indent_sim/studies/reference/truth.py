"""References of a study: theory, its finest run, a number, or another result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.scene_file import Place
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results import reader
from indent_sim.results.measured.measurement import curve_parts
from indent_sim.results.reader import Results
from indent_sim.studies.cases import Case
from indent_sim.studies.study_file import StudyFile

SAME_DEPTH = 1e-9  # relative
MOST_DEPTHS = 200  # at which theory is asked
DEPTH_FACTOR = 1.3  # times an expected depth the one found may be
PEAK_RADII = 200  # at which theory's pressure is looked at for its peak
ALONE = (
    "every run asks a question of its own and is compared with no other; curves.csv "
    "and curves.png have the curves"
)
BY_APPROACH = "of the history that is compared with, the rows of its approach count"
NAN = math.nan


@dataclass(frozen=True)
class Answer:
    """Force, contact radius and peak pressure at given depths, in the user's units; NaN where
    unknown.

    `between`: the depths asked for are found, not prescribed, and lie near those known rather than
    on them. `measured`: they are those of a measured curve, between any two of which it is
    straight.
    """

    delta: np.ndarray
    force: np.ndarray
    a: np.ndarray
    p_max: np.ndarray
    between: bool = field(default=False, kw_only=True)
    measured: bool = field(default=False, kw_only=True)

    def at(self, delta: float) -> tuple[float, float, float]:
        """(force, a, p_max) at a depth, if need be by power laws between those known; NaN when it
        is not known.
        """
        columns = self.force, self.a, self.p_max
        if self.measured:
            return tuple(
                float(np.interp(delta, self.delta, column, NAN, NAN)) for column in columns
            )  # type: ignore[return-value]
        if self.between:
            return tuple(_power_law(delta, self.delta, column) for column in columns)  # type: ignore[return-value]
        match = np.flatnonzero(np.isclose(self.delta, delta, rtol=SAME_DEPTH, atol=0))[-1:]
        return tuple(float(column[match[0]]) if len(match) else NAN for column in columns)  # type: ignore[return-value]


def _power_law(x: float, known: np.ndarray, values: np.ndarray) -> float:
    """The value at x of the power law through the two nearest of the known points; NaN where there
    are no two.
    """
    near = [i for i in np.argsort(np.abs(known - x)) if known[i] > 0 and values[i] > 0]
    other = next(
        (i for i in near if not np.isclose(known[i], known[near[0]], rtol=SAME_DEPTH, atol=0)), None
    )
    if x <= 0 or other is None:
        return NAN
    slope = np.log(values[other] / values[near[0]]) / np.log(known[other] / known[near[0]])
    return float(values[near[0]] * (x / known[near[0]]) ** slope)


class Truth:
    """The answer that belongs to each case; `name` says what it is, `notes` what to know about it."""

    def __init__(self, study: StudyFile, cases: Sequence[Case]):
        self.notes: tuple[str, ...] = ()
        # cases ask a question each
        self._wanted = study.compare_to
        self._apart = bool(study.members)
        self._answers: dict[str, Answer] = {}
        self._file: Answer | None = None
        self._finest: dict[
            str, Case
        ] = {}  # the run that answers each problem, where runs are compared with such
        where = study.compare_place
        if self._wanted != "finest" and any(
            case.prospect.scene.is_time_dependent for case in cases
        ):
            raise _error(
                where,
                "rows are compared by depth, and a history passes one several times",
                "leave it out",
            )
        if self._wanted == "theory":
            self._take_theory(cases, where)
        elif isinstance(self._wanted, float):
            if any(case.prospect.has_prescribed_forces for case in cases):
                raise _error(
                    where,
                    "forces are prescribed, and depths found",
                    "give theory, finest or a result",
                )
        elif not isinstance(self._wanted, str):
            try:
                found = _read(self._wanted, cases)
                self._file = of_results(found)
                self.notes = (
                    (BY_APPROACH,)
                    if "t" in found.table and not found.report.get(reader.MEASURED)
                    else ()
                )
            except UsageError as error:
                raise _error(
                    where,
                    str(error),
                    "give a result folder, its force_indentation.csv or a measured curve",
                ) from None
            missing = [
                case for case in cases if math.isnan(_for(case, self._file).at(case.depth)[0])
            ]
            if missing:
                raise _error(
                    where, f"has no depth {missing[0].depth:g}, the last of {missing[0].words}"
                )

    @property
    def name(self) -> str:
        """What is compared with, in words."""
        if isinstance(self._wanted, float):
            return f"{self._wanted:g}"
        if len(self._finest) == 1:
            return f"finest: {next(iter(self._finest.values())).words}"
        return self._wanted if isinstance(self._wanted, str) else self._wanted.name

    @property
    def references(self) -> set[str]:
        """The runs, by id, that others are compared with."""
        return {case.id for case in self._finest.values()}

    def reference(self, case: Case) -> str | None:
        """What a case is compared with: the id of a run, theory, a force or the name of a result;
        None for nothing.
        """
        if self._wanted == "finest":
            return self._finest[case.problem].id if case.problem in self._finest else None
        return self.name if self.answer(case) else None

    def find_finest(self, cases: Sequence[Case], done: Mapping[str, Results]) -> None:
        """Where the finest run is the reference: choose it, for every problem the study asks about.

        It has the most unknowns, and among such the least penetration: what a penalty lets sink in
        is no answer.
        """
        if self._wanted != "finest":
            return
        asked: dict[str, list[Case]] = {}
        comparable = (
            case for case in cases if case.id in done and not case.prospect.scene.is_time_dependent
        )  # by depth
        for case in sorted(comparable, key=lambda case: _fineness(case, done)):
            asked.setdefault(case.problem, []).append(case)  # the finest comes last
        # none is its own answer
        self._finest = {
            problem: runs[-1]
            for problem, runs in asked.items()
            if len({run.id for run in runs}) > 1
        }
        self._answers = {problem: of_results(done[run.id]) for problem, run in self._finest.items()}
        if asked and not self._finest and not self._apart:
            self.notes = (ALONE,)
        if len(self._finest) == 1:
            (run,) = self._finest.values()
            unknowns = done[run.id].report.get("dofs") or "no"
            self.notes = (
                f"compared with the finest run, {run.words}: {unknowns} "
                f"unknowns{_sunk(done[run.id])}",
            )

    def answer(self, case: Case) -> Answer | None:
        """What the case is compared with; None when there is nothing."""
        if isinstance(self._wanted, float):
            return Answer(*(np.array([value]) for value in (case.depth, self._wanted, NAN, NAN)))
        answer = self._file or self._answers.get(case.problem)
        return _for(case, answer) if answer else None

    def _take_theory(self, cases: Sequence[Case], where: Place) -> None:
        for case in cases:
            answer = self._answers.get(case.problem) or of_theory(case)
            if answer is None:
                raise _error(
                    where, f"there is no theory for {case.words}", "compare_to: finest always works"
                )
            self._answers[case.problem] = answer
        inexact = next(
            (case.prospect.scene for case in cases if not case.prospect.scene.exact_theory), None
        )
        if inexact is not None:
            why = "; ".join(inexact.theory_differences)
            self.notes = (
                f"theory is not exact for this body ({why}): the errors include the difference",
            )


def _for(case: Case, answer: Answer) -> Answer:
    """The answer as a case needs it, whose depths may be found, not prescribed."""
    return dataclasses.replace(answer, between=case.prospect.has_prescribed_forces)


def of_theory(case: Case) -> Answer | None:
    """Layer theory at the depths of a case, of very many at some, and around those to expect; None
    without theory.
    """
    scene = case.prospect.scene
    depths = [delta for delta in scene.physics.deltas if delta > 0]
    depths = depths[:: -max(1, len(depths) // MOST_DEPTHS)][::-1]  # the last among them
    if case.prospect.has_prescribed_forces and depths:
        around = np.geomspace(
            min(depths) / DEPTH_FACTOR,
            min(max(depths) * DEPTH_FACTOR, scene.physics.body.height),
            MOST_DEPTHS,
        )
        depths = [float(depth) for depth in around]
    curve = (
        (scene.plan.theory.solutions_at_depths(depths) if scene.plan.theory else None)
        if depths
        else []
    )
    if curve is None:
        return None
    scales = scene.physics.scales
    L = scales.length
    D = scales.depth
    P = scales.pressure
    F = scales.force
    open_depths = sorted({delta for delta in scene.physics.deltas if delta <= 0})
    rows = [(s.delta * D, s.force * F, s.a * L, _peak(s) * P) for s in curve]
    rows += [(delta * D, 0.0, 0.0, 0.0) for delta in open_depths]  # out of contact: nothing
    return Answer(*np.array(rows).T)


def _read(path: Path, cases: Sequence[Case]) -> Results:
    """A result or a measured curve, which is taken in the units of the cases; UsageError for a
    result in others.
    """
    found = reader.read(path)
    if not cases:
        return found
    units = cases[0].prospect.config.units
    scene = Results(
        Path("the study"), {}, {"units": {"length": units.length, "force": units.force}}
    )
    both = reader.convert_to_common_units([scene, found])
    reader.refuse_different_units(both, "run that scene in the units of the study")
    return both[1]


def of_results(found: Results) -> Answer:
    """The table of a result, by depth, of a history its approach; of a measured curve the same in
    order of depth.
    """
    unknown = np.full(len(found), NAN)
    if "t" in found.table and not found.report.get(reader.MEASURED):
        rows = curve_parts(found["delta"])["approach"]
        return Answer(
            *(found.table.get(name, unknown)[rows] for name in ("delta", "force", "a", "p_max"))
        )
    if found.report.get(reader.MEASURED):
        rows = curve_parts(found["delta"])["approach"]
        order = np.argsort(found["delta"][rows], kind="stable")
        known = (found["delta"][rows][order], found["force"][rows][order])
        return Answer(*known, unknown[rows], unknown[rows], measured=True)
    return Answer(found["delta"], found["force"], found["a"], found.table.get("p_max", unknown))


def _peak(solution: Any) -> float:
    """The largest pressure; NaN where it is infinite (a sharp edge or apex)."""
    inside = solution.a * np.linspace(0, 1, PEAK_RADII + 1)
    with np.errstate(all="ignore"):
        p = np.asarray(solution.pressure(inside), dtype=float)
    steep = p[:-1].max() > 1.5 * p[2:-2].max()
    return NAN if not np.isfinite(p).all() or steep else float(p.max())


def _fineness(case: Case, done: Mapping[str, Results]) -> tuple[Any, ...]:
    """Sorts cases from coarse to fine, and among equal meshes those into which the tip sinks least
    last.
    """
    scene = case.prospect.scene
    found = done[case.id]
    dofs = found.report.get("dofs", 0) if scene.is_meshed else math.inf
    return dofs, -_penetration(found), -scene.sizes.h_contact, -case.index


def _penetration(found: Results) -> float:
    """How far the tip sinks in at the last row [length]; 0 where nobody knows."""
    column = found.table.get("penetration", np.zeros(1))
    return float(np.nan_to_num(column[-1])) if len(column) else 0.0


def _sunk(found: Results) -> str:
    """The same in words."""
    return f", penetration {_penetration(found):.2g} at its last row"


def _error(where: Place, problem: str, remedy: str = "") -> ConfigError:
    return ConfigError("compare_to", problem, remedy, *where)
