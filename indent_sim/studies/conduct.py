"""The whole of a study: read and check it, do its runs, write its table and picture."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.process.screen import Shown
from indent_sim.process.usage import duration, machine_memory
from indent_sim.results.folder import Report, read_regular_file, read_report
from indent_sim.results.reader import Results, data_frame
from indent_sim.run import simulate
from indent_sim.studies import cases as case_list
from indent_sim.studies import curve_table, picture, study_file, study_folder, study_table
from indent_sim.studies.cases import Case
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.reference.truth import Truth
from indent_sim.studies.study_folder import StudyFolder
from indent_sim.studies.study_table import Row
from indent_sim.studies.worker import Ending, Job, Load, Workers

TELLING = (
    "status",
    "force",
    "a",
    "p_max",
    "force_error_vs",
    "cpu_s",
    "verdict",
)  # columns that a notebook shows
Tell = Callable[[str], None]


if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False)
class Study:
    """A study that was carried out: where it lies, its table, and what to choose.

    rows: empty for a shard, whose part of the runs is all it does. scoreboard: of `cases` with
    published values.
    """

    directory: Path
    title: str
    keys: tuple[str, ...]
    compared_with: str
    rows: Sequence[Row]
    notes: tuple[str, ...] = ()
    scoreboard: Sequence[Row] = ()

    @property
    def recommendations(self) -> list[str]:
        """For 5 %, 1 % and 0.1 % of the force, what to choose; with a tolerance the count of each
        verdict.
        """
        if any(self.verdicts.values()):
            return [", ".join(f"{count} {name}" for name, count in self.verdicts.items())]
        return study_table.recommendations(self.rows, self.keys)

    @property
    def verdicts(self) -> dict[str, int]:
        """How many rows are right, flagged, refused and wrong; all 0 without a tolerance."""
        return study_table.counts(self.rows)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of its table."""
        return tuple(self.rows[0]) if self.rows else ()

    def __getitem__(self, column: str) -> np.ndarray:
        """A column of its table: numbers, NaN where one is not known, or words."""
        values = [row[column] for row in self.rows]
        is_number = all(isinstance(value, (int, float, type(None))) for value in values)
        return np.array(
            [np.nan if value is None else value for value in values],
            dtype=float if is_number else object,
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return self._shown().text

    def _repr_html_(self) -> str:
        return self._shown().html

    def _shown(self) -> Shown:
        """What a notebook shows: the varied keys and what came of them."""
        names = [
            name
            for name in (*self.keys, *TELLING)
            if any(row.get(name) is not None for row in self.rows)
        ]
        rows = [[row[name] for name in names] for row in self.rows]
        done = sum(row["status"] == "done" for row in self.rows)
        return Shown(
            f"{self.title}: {done} of {len(rows)} runs done",
            names,
            rows,
            "; ".join(self.recommendations),
        )

    def to_pandas(self) -> pandas.DataFrame:
        """Its table as a DataFrame; BackendError without pandas."""
        return data_frame({name: self[name] for name in self.columns})

    @property
    def failures(self) -> list[Row]:
        """The rows without an answer."""
        return [row for row in self.rows if row["status"] != "done"]


def carry_out(
    given: Path | str | Mapping[str, Any],
    *,
    output: Path | None = None,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
    jobs: int = 1,
    overwrite: bool = False,
    tell: Tell = lambda line: None,
) -> Study:
    """Do the study of a file, or of mappings shaped like one. `shard` (i, n): do every n-th run
    from the i-th on, and write no table.

    `jobs` runs are done at the same time, each in a process of its own. A run that fails is a row.
    Finished runs that the study does not ask for are replaced with `overwrite` alone, and kept with
    `resume`. Raises UsageError, ConfigError (before any run), BackendError; NotConverged when no
    run at all gave a result.
    """
    study = study_file.read(given)
    asked = cases, _ = case_list.asked_for(study)
    scoreboard.check(study.members, cases)
    against = Truth(study, cases)
    first, every = shard or (1, 1)
    mine = case_list.unique(cases)[first - 1 :: every]
    largest = sorted(
        (case.prospect.plan.prediction.get("memory_MB", 0.0) for case in mine), reverse=True
    )[:jobs]
    available = machine_memory() / 1e6
    if jobs > 1 and sum(largest) > available:
        need = f"{len(largest)} runs at a time need about {sum(largest):.3g} MB"
        raise UsageError(f"{need}, this machine has {available:.3g}: fewer --jobs")
    finished = Study(
        output or study.directory, study.title, study.keys, against.name, [], against.notes
    )
    load = (
        simulate.warm_up if any(case.prospect.scene.is_meshed for case in cases) else lambda: None
    )
    names = [case.name for case in mine]
    how = {"resume": resume, "shared": shard is not None, "overwrite": overwrite}
    folder = study_folder.opened(finished.directory, names=names, **how)
    with folder as place:
        place.write_record(
            title=study.title, study=str(study.path), keys=study.keys, compare_to=against.name
        )
        if shard is not None:
            _do(mine, place, jobs, load, tell)
            return finished
        try:
            _do(mine, place, jobs, load, tell)
        finally:
            ended = ((case.id, place.ended(case.name)) for case in mine)
            done = {name: results for name, results in ended if results is not None}
            folders = {case.id: place.run(case.name).name for case in mine}
            rows = study_table.rows(study, asked, done, against, folders)
            board = scoreboard.rows(study.members, cases, done)
            finished = replace(
                finished,
                rows=rows,
                notes=against.notes,
                scoreboard=board,
                compared_with=against.name,
            )
            place.write_record(
                title=study.title, study=str(study.path), keys=study.keys, compare_to=against.name
            )
            place.write(study_folder.STUDY_TABLE, study_table.write(rows))
            if board:
                place.write(study_folder.SCOREBOARD, study_table.write(board))
            place.write(
                study_folder.CURVES, curve_table.write(curve_table.rows(mine, study.keys, done))
            )
        _draw(finished, mine, done)
        if len(finished.failures) == len(rows):
            raise NotConverged(
                f"no run of this study gave a result; the first: {rows[0]['reason']}"
            )
    return finished


def _draw(study: Study, cases: Sequence[Case], done: Mapping[str, Results]) -> None:
    """Draw a study that has its table into its folder."""
    where = study.directory
    keys = study.keys
    title = study.title
    of_one_kind = (
        [] if study.scoreboard else cases
    )  # scenes with published values have no depths and forces to compare
    families = curve_table.families(of_one_kind, keys, done)
    picture.draw(study.rows, keys, title, study.compared_with, where / study_folder.STUDY_PICTURE)
    picture.draw_curves(families, title, where / study_folder.CURVES_PICTURE)
    picture.draw_scoreboard(study.scoreboard, title, where / study_folder.SCOREBOARD_PICTURE)


def read_back(folder: Path) -> Study:
    """The study of a folder, as it was carried out; UsageError when it holds none, or one without
    its table.
    """
    record = read_report(folder, study_folder.RECORD)
    table = folder / study_folder.STUDY_TABLE
    board: list[Row] = []
    try:
        rows = study_table.read(read_regular_file(table).decode("utf-8"))
        if (folder / study_folder.SCOREBOARD).exists():
            board = scoreboard.read(
                read_regular_file(folder / study_folder.SCOREBOARD).decode("utf-8")
            )
        keys = tuple(map(str, record["keys"]))
        if not rows or not {"status", "verdict", *keys} <= rows[0].keys():
            raise ValueError("it lacks what a study has")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(
            f"{folder} holds no study that can be read: {error}", file=str(folder)
        ) from None
    return Study(
        folder,
        str(record.get("title")),
        keys,
        str(record.get("compare_to")),
        rows,
        scoreboard=board,
    )


def _do(cases: Sequence[Case], place: StudyFolder, at_once: int, load: Load, tell: Tell) -> None:
    """Do the runs, so many at once, those left out that have ended before."""
    waiting = {
        case.name: case for case in cases if not (place.keeps and place.is_finished(case.name))
    }
    if len(waiting) < len(cases):
        tell(f"{len(cases) - len(waiting)} of {len(cases)} runs are there already")
    began = time.monotonic()
    effort = sum(map(_effort, waiting.values()))
    left = effort
    jobs = {
        name: Job(case.prospect, place.run(name), place.keeps) for name, case in waiting.items()
    }
    with Workers(at_once, jobs, load) as workers:
        for count, (name, ending) in enumerate(workers.done(jobs), start=1):
            if ending[0]:
                place.fail(name, *ending)
            left -= _effort(waiting[name])
            spent = (time.monotonic() - began) * left / (effort - left)
            remains = f"  about {duration(spent)} left" if count < len(waiting) else ""
            told = _told(place.ended(name), ending)
            tell(f"run {count}/{len(waiting)}  {waiting[name].words}  {told}{remains}")
    place.forget_others()


def _told(found: Results | None, ending: Ending) -> str:
    code, reason = ending
    if code or found is None:
        return f"failed ({code}): {reason}"
    force = found["force"][study_table.answer_row(found)]
    seconds = sum(found.report.get("cpu_timings", {}).values())
    return f"force {force:.6g}  {seconds:.2f} s"


def _effort(case: Case) -> float:
    """The seconds that a run is expected to take, its companions among them."""
    return case.prospect.study_seconds()


def as_json(study: Study) -> Report:
    """A study as one JSON object."""
    names = (
        "directory",
        "title",
        "compared_with",
        "rows",
        "recommendations",
        "notes",
        "verdicts",
        "scoreboard",
    )
    pareto = [row["index"] for row in study_table.pareto(study.rows)]
    return {name: getattr(study, name) for name in names} | {"pareto": pareto}
