"""Execution of a study: checks, runs, table and pictures."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.process.usage import duration_text, machine_memory
from indent_sim.results.reader import Results
from indent_sim.results.result_files import Report
from indent_sim.studies import cases as case_list
from indent_sim.studies import (
    curve_table,
    row_study,
    study_file,
    study_folder,
    study_picture,
    study_table,
)
from indent_sim.studies.cases import Case
from indent_sim.studies.finished_study import Study
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.reference.reference_solution import ReferenceSolution
from indent_sim.studies.study_folder import StudyFolder
from indent_sim.studies.worker import ExitStatus, Job, run_jobs

ReportLine = Callable[[str], None]


def execute_study(
    study_input: Path | str | Mapping[str, Any],
    *,
    output: Path | None = None,
    resume: bool = False,
    shard: tuple[int, int] | None = None,
    jobs: int = 1,
    overwrite: bool = False,
    gather: bool = False,
    tell: ReportLine = lambda line: None,
) -> Study:
    """Run a study and write its table and pictures.

    Parameters
    ----------
    study_input
        Path of a study file, or a dictionary with its structure.
    output
        Folder of the study; by default the folder that the study file names.
    resume
        Keep finished runs and continue interrupted ones.
    shard
        (i, n): perform every n-th run, beginning with the i-th (counted from 1), and write no
        table.
    jobs
        Number of runs at the same time, each in its own process.
    overwrite
        Replace finished runs that are not part of this study.
    gather
        Write the table of the runs that exist, without performing any.
    tell
        Function that is called with each line of progress.

    Returns
    -------
    Study
        The study; a failed run is a row of its table.

    Raises
    ------
    UsageError, ConfigError, BackendError
        If an error is found before the first run.
    NotConverged
        If no run gave a result.
    """
    study = study_file.read(study_input)
    if gather and (shard is not None or overwrite):
        raise UsageError("--gather merges all shards; leave out --shard and --overwrite")
    if not study.keeps_all_runs:
        directory = output or study.directory
        return row_study.execute_row_study(
            study,
            directory,
            resume=resume,
            shard=shard,
            jobs=jobs,
            overwrite=overwrite,
            gather=gather,
            tell=tell,
        )
    resolved_cases = cases, _ = case_list.resolve_cases(study)
    scoreboard.check_published_rows(study.named_cases, cases)
    reference = ReferenceSolution(study, cases)
    shard_index, shard_count = shard or (1, 1)
    shard_cases = case_list.unique_cases(cases)[shard_index - 1 :: shard_count]
    largest_memories = sorted(
        (case.planned_run.plan.prediction.get("memory_MB", 0.0) for case in shard_cases),
        reverse=True,
    )[:jobs]
    available = machine_memory() / 1e6
    if jobs > 1 and sum(largest_memories) > available:
        need = f"{len(largest_memories)} runs at a time need about {sum(largest_memories):.3g} MB"
        raise UsageError(f"{need}, this machine has {available:.3g} MB: use fewer --jobs")
    finished = Study(
        output or study.directory, study.title, study.keys, reference.name, [], reference.notes
    )
    names = [case.name for case in shard_cases]
    options = {"resume": resume or gather, "shared": shard is not None, "overwrite": overwrite}
    folder = study_folder.open_study_folder(finished.directory, names=names, **options)
    with folder as open_folder:
        record: Report = {"title": study.title, "study": str(study.path), "keys": study.keys}
        record |= {"left_out": study.left_out_count()} if study.conditions else {}
        open_folder.write_record(**record, compare_to=reference.name)
        if shard is not None:
            _run_cases(shard_cases, open_folder, jobs, tell)
            return finished
        try:
            if not gather:
                _run_cases(shard_cases, open_folder, jobs, tell)
        finally:
            ended_runs = ((case.id, open_folder.ended_results(case.name)) for case in shard_cases)
            results_by_id = {name: results for name, results in ended_runs if results is not None}
            folders = {case.id: open_folder.run_folder(case.name).name for case in shard_cases}
            rows = study_table.rows(study, resolved_cases, results_by_id, reference, folders)
            scoreboard_rows = scoreboard.rows(study.named_cases, cases, results_by_id)
            finished = replace(
                finished,
                rows=rows,
                notes=reference.notes,
                scoreboard=scoreboard_rows,
                compared_with=reference.name,
            )
            open_folder.write_record(**record, compare_to=reference.name)
            open_folder.write_file(study_folder.STUDY_TABLE, study_table.write(rows))
            if scoreboard_rows:
                open_folder.write_file(study_folder.SCOREBOARD, study_table.write(scoreboard_rows))
            open_folder.write_file(
                study_folder.CURVES,
                curve_table.write(curve_table.rows(shard_cases, study.keys, results_by_id)),
            )
        _draw_pictures(finished, shard_cases, results_by_id)
        if len(finished.failures) == len(rows):
            raise NotConverged(
                f"no run of this study has a result; reason of the first run: {rows[0]['reason']}"
            )
    return finished


def _draw_pictures(
    study: Study, cases: Sequence[Case], results_by_id: Mapping[str, Results]
) -> None:
    """Draw the pictures of a finished study into its folder."""
    directory = study.directory
    keys = study.keys
    title = study.title
    # The scenes of a study with published values have nothing in common, so that their curves have
    # no common axes.
    comparable_cases = [] if study.scoreboard else cases
    curve_groups = curve_table.group_case_curves(comparable_cases, keys, results_by_id)
    study_picture.draw_cost(
        study.rows, keys, title, study.compared_with, directory / study_folder.STUDY_PICTURE
    )
    study_picture.draw_curves(curve_groups, title, directory / study_folder.CURVES_PICTURE)
    study_picture.draw_scoreboard(
        study.scoreboard, title, directory / study_folder.SCOREBOARD_PICTURE
    )


def _run_cases(
    cases: Sequence[Case],
    folder: StudyFolder,
    worker_count: int,
    tell: ReportLine,
) -> None:
    """Perform the runs in parallel, except those finished before a resumed study."""
    pending_cases = {
        case.name: case
        for case in cases
        if not (folder.is_resumed and folder.is_finished(case.name))
    }
    if len(pending_cases) < len(cases):
        tell(f"{len(cases) - len(pending_cases)} of {len(cases)} runs are finished already")
    start_time = time.monotonic()
    total_seconds = sum(map(_expected_seconds, pending_cases.values()))
    remaining_seconds = total_seconds
    jobs = {
        name: Job(
            case.planned_run.config,
            case.planned_run.scene.is_meshed,
            folder.run_folder(name),
            folder.is_resumed,
        )
        for name, case in pending_cases.items()
    }
    ended_jobs = run_jobs(jobs, worker_count, folder.lock_descriptor)
    for count, (name, ending) in enumerate(ended_jobs, start=1):
        if ending[0]:
            folder.record_failure(name, *ending)
        remaining_seconds -= _expected_seconds(pending_cases[name])
        # The runs so far calibrate the predicted seconds of the others.
        expected_time = (
            (time.monotonic() - start_time)
            * remaining_seconds
            / (total_seconds - remaining_seconds)
        )
        remaining_text = (
            f"  about {duration_text(expected_time)} left" if count < len(pending_cases) else ""
        )
        outcome = _outcome_text(folder.ended_results(name), ending)
        label = pending_cases[name].label
        tell(f"run {count}/{len(pending_cases)}  {label}  {outcome}{remaining_text}")
    folder.delete_other_runs()


def _outcome_text(results: Results | None, ending: ExitStatus) -> str:
    """Return the force and the CPU time of a run, or the reason for its failure, as text."""
    code, reason = ending
    if code or results is None:
        return f"failed ({code}): {reason}"
    force = results["force"][study_table.representative_row(results)]
    seconds = sum(results.report.get("cpu_timings", {}).values())
    return f"force {force:.6g}  {seconds:.2f} s"


def _expected_seconds(case: Case) -> float:
    """Return the predicted CPU time [s] of a run, including its error estimate."""
    return case.planned_run.study_seconds()
