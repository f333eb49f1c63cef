"""The whole of a study: read and check it, do its runs, write its table and picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.process.errors import NotConverged
from indent_sim.results import reader
from indent_sim.study import cases as case_list
from indent_sim.study import file, folder, picture, table, verdict
from indent_sim.study.cases import Case, Refusal
from indent_sim.study.file import StudyFile
from indent_sim.study.folder import StudyFolder
from indent_sim.study.table import Row
from indent_sim.study.truth import Comparison
from indent_sim.study.worker import Ending, Run, Worker

Tell = Callable[[str], None]


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
        return verdict.counts(self.rows)

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
    tell: Tell = lambda line: None,
) -> Study:
    """Do the study of a file. `shard` (i, n): do every n-th run from the i-th on, and write no table.

    A run that fails is a row. Raises UsageError, ConfigError (before any run), BackendError; NotConverged when
    no run at all gave a result.
    """
    study = file.read(path)
    cases, refusals = (case_list.of(study), []) if study.tolerance is None else case_list.sorted_out(study)
    against = Comparison(study, cases)
    directory, meshes = output or study.directory, any(case.scene.is_meshed for case in cases)
    with folder.opened(directory, resume=resume, shared=shard is not None) as place, Worker(meshes) as worker:
        place.write_record(title=study.title, study=str(study.path), keys=study.keys, compare_to=against.name)
        conduct = _Conduct(place, worker, tell)
        if shard is not None:
            conduct(case_list.sharded(case_list.unique(cases), shard))
            return Study(directory, study.title, study.keys, against.name, [], against.notes)
        try:
            conduct(case_list.unique(cases))
        finally:
            finished = Study(directory, study.title, study.keys, against.name,
                             _rows(study, cases, refusals, against, place), against.notes)  # fmt: skip
            place.write(folder.TABLE, table.write(finished.rows))
        _conclude(finished)
    return finished


class _Conduct:
    """Does runs one after another, those left out that have ended before."""

    def __init__(self, place: StudyFolder, run: Run, tell: Tell):
        self.place, self.run, self.tell = place, run, tell

    def __call__(self, cases: Sequence[Case]) -> None:
        waiting = [case for case in cases if not self.place.is_finished(case.id)]
        if len(waiting) < len(cases):
            self.tell(f"{len(cases) - len(waiting)} of {len(cases)} runs are there already")
        for count, case in enumerate(waiting, start=1):
            ending = self.run(case.config, self.place.run(case.id))
            if ending[0]:
                self.place.fail(case.id, *ending)
            self.place.forget_old()
            self.tell(f"run {count}/{len(waiting)}  {case.words}  {self._told(case, ending)}")

    def _told(self, case: Case, ending: Ending) -> str:
        code, reason = ending
        if code:
            return f"failed ({code}): {reason}"
        found = reader.read_run(self.place.run(case.id))
        seconds = sum(found.report.get("cpu_timings", {}).values())
        return f"force {found['force'][-1]:.6g}  {seconds:.2f} s"


def _rows(study: StudyFile, cases: Sequence[Case], refusals: Sequence[Refusal], against: Comparison,
          place: StudyFolder) -> list[Row]:  # fmt: skip
    ended = [case.id for case in case_list.unique(cases) if place.has_ended(case.id)]
    done = {name: reader.read_run(place.run(name)) for name in ended}
    return table.rows(cases, study.keys, done, against, refusals, study.tolerance)


def _conclude(study: Study) -> None:
    picture.draw(study.rows, study.keys, study.title, study.compared_with, study.directory / folder.PICTURE)
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
