"""The whole of a study: read and check it, do its runs, write its table and picture."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.process.usage import machine_memory
from indent_sim.results import reader
from indent_sim.results.reader import Results
from indent_sim.study import cases as case_list
from indent_sim.study import curves, file, folder, picture, table
from indent_sim.study.cases import Case
from indent_sim.study.folder import StudyFolder
from indent_sim.study.table import Row
from indent_sim.study.truth import Comparison
from indent_sim.study.worker import Ending, Workers

Tell = Callable[[str], None]
BY_THEORY = 0.2  # s


@dataclass(frozen=True)
class Study:
    """A study that was carried out: where it lies, its table, and what to choose.

    rows: empty for a shard, whose part of the runs is all it does.
    """

    directory: Path
    title: str
    keys: tuple[str, ...]
    compared_with: str
    rows: Sequence[Row]
    notes: tuple[str, ...] = ()

    @property
    def recommendations(self) -> list[str]:
        """For 5 %, 1 % and 0.1 % of the force, what to choose; with a tolerance the count of each verdict."""
        if any(self.verdicts.values()):
            return [", ".join(f"{count} {name}" for name, count in self.verdicts.items())]
        return table.recommendations(self.rows, self.keys)

    @property
    def verdicts(self) -> dict[str, int]:
        """How many rows are right, flagged, refused and wrong; all 0 without a tolerance."""
        return table.counts(self.rows)

    @property
    def failures(self) -> list[Row]:
        """The rows without an answer."""
        return [row for row in self.rows if row["status"] != "done"]


def carry_out(
    path: Path | str,
    *,
    output: Path | None = None,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
    jobs: int = 1,
    tell: Tell = lambda line: None,
) -> Study:
    """Do the study of a file. `shard` (i, n): do every n-th run from the i-th on, and write no table.

    `jobs` runs are done at the same time, each in a process of its own. A run that fails is a row. Raises UsageError,
    ConfigError (before any run), BackendError; NotConverged when no run at all gave a result.
    """
    study = file.read(path)
    cases, refusals = (case_list.of(study), []) if study.tolerance is None else case_list.sorted_out(study)
    against = Comparison(study, cases)
    directory, meshes = output or study.directory, any(case.scene.is_meshed for case in cases)
    mine = case_list.sharded(case_list.unique(cases), shard)
    _refuse_too_many(mine, jobs)
    with folder.opened(directory, resume=resume, shared=shard is not None) as place, Workers(jobs, meshes) as workers:
        place.write_record(title=study.title, study=str(study.path), keys=study.keys, compare_to=against.name)
        conduct = _Conduct(place, workers, tell)
        if shard is not None:
            conduct(mine)
            return Study(directory, study.title, study.keys, against.name, [], against.notes)
        try:
            conduct(mine)
        finally:
            done = _done(mine, place)
            rows = table.rows(cases, study.keys, done, against, refusals, study.tolerance, _names(mine, place))
            finished = Study(directory, study.title, study.keys, against.name, rows, against.notes)
            place.write(folder.TABLE, table.write(rows))
            place.write(folder.CURVES, curves.write(curves.rows(mine, study.keys, done)))
        _conclude(finished, curves.families(mine, study.keys, done))
    return finished


def _refuse_too_many(cases: Sequence[Case], jobs: int) -> None:
    """UsageError when the machine has no memory for so many of the largest runs at a time."""
    largest = sorted((case.scene.plan.prediction.get("memory_MB", 0.0) for case in cases), reverse=True)[:jobs]
    available = machine_memory() / 1e6
    if jobs > 1 and sum(largest) > available:
        raise UsageError(f"{len(largest)} runs at a time need about {sum(largest):.3g} MB, this machine has "
                         f"{available:.3g}: fewer --jobs")  # fmt: skip


class _Conduct:
    """Does runs, as many at a time as there are workers, those left out that have ended before."""

    def __init__(self, place: StudyFolder, workers: Workers, tell: Tell):
        self.place, self.workers, self.tell = place, workers, tell

    def __call__(self, cases: Sequence[Case]) -> None:
        waiting = [case for case in cases if not self.place.is_finished(case.name)]
        if len(waiting) < len(cases):
            self.tell(f"{len(cases) - len(waiting)} of {len(cases)} runs are there already")
        began, effort = time.monotonic(), sum(map(_effort, waiting))
        left = effort
        jobs = ((case, case.config, self.place.run(case.name)) for case in waiting)
        for count, (case, ending) in enumerate(self.workers.done(jobs), start=1):
            if ending[0]:
                self.place.fail(case.name, *ending)
            self.place.forget_old()
            left -= _effort(case)
            remains = _duration((time.monotonic() - began) * left / (effort - left)) if count < len(waiting) else ""
            self.tell(f"run {count}/{len(waiting)}  {case.words}  {self._told(case, ending)}{remains}")

    def _told(self, case: Case, ending: Ending) -> str:
        code, reason = ending
        if code:
            return f"failed ({code}): {reason}"
        found = reader.read_run(self.place.run(case.name))
        seconds = sum(found.report.get("cpu_timings", {}).values())
        return f"force {found['force'][-1]:.6g}  {seconds:.2f} s"


def _effort(case: Case) -> float:
    """The seconds that a run is expected to take; by theory alone a part of one."""
    return float(case.scene.plan.prediction.get("seconds", BY_THEORY))


def _duration(seconds: float) -> str:
    """What remains, in words."""
    minutes, hours = seconds / 60, seconds / 3600
    said = f"{seconds:.0f} s" if minutes < 2 else f"{minutes:.0f} min" if hours < 2 else f"{hours:.1f} h"
    return f"  about {said} left"


def _done(cases: Sequence[Case], place: StudyFolder) -> dict[str, Results]:
    """The results of the runs that have ended, by id."""
    return {case.id: reader.read_run(place.run(case.name)) for case in cases if place.has_ended(case.name)}


def _names(cases: Sequence[Case], place: StudyFolder) -> dict[str, str]:
    return {case.id: place.run(case.name).name for case in cases}


def _conclude(study: Study, families: curves.Families) -> None:
    picture.draw(study.rows, study.keys, study.title, study.compared_with, study.directory / folder.PICTURE)
    picture.draw_curves(families, study.title, study.directory / folder.CURVES_PICTURE)
    if len(study.failures) == len(study.rows):
        first = study.rows[0]
        raise NotConverged(f"no run of this study gave a result; the first: {first['reason']}")


def as_json(study: Study) -> dict[str, Any]:
    """A study as one JSON object."""
    return {
        "directory": study.directory,
        "title": study.title,
        "compared_with": study.compared_with,
        "rows": study.rows,
        "pareto": [row["index"] for row in table.pareto(study.rows)],
        "recommendations": study.recommendations,
        "notes": study.notes,
        "verdicts": study.verdicts,
    }
