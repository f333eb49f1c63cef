"""A single run of a study, repeated with a result folder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.results.result_files import STUDY
from indent_sim.run import pipeline
from indent_sim.studies import study_file, study_folder
from indent_sim.studies.cases import Case, CaseBuilder
from indent_sim.studies.row_file import ROWS_FOLDER, RowIndex
from indent_sim.studies.settings_checksum import SettingsChecksum
from indent_sim.studies.study_file import RunRequest, StudyFile

# Largest number of digits of the index of a row in study.csv; the id of a run has 16 digits.
MAX_NUMBER_DIGITS = 9
ID_LENGTH = 16


def execute_run(
    study_input: Path | str | Mapping[str, Any], name: str, *, output: Path | None = None
) -> Path:
    """Perform one run of a study and return its result folder.

    Parameters
    ----------
    study_input
        Path of a study file, or a dictionary with its structure.
    name
        Name of the run, its id, or the number of its row in study.csv.
    output
        Folder of the study; by default the folder that the study file names.

    Raises
    ------
    UsageError
        The study has no such run.
    IndentSimError
        The run has failed.
    """
    study = study_file.read(study_input)
    directory = output or study.directory
    case = _find_case(study, directory, name)
    options: dict[str, Any] = {"names": [case.name], "resume": True, "shared": True}
    with study_folder.open_study_folder(directory, **options) as folder:
        if not (directory / STUDY).exists():
            record = {"title": study.title, "study": str(study.path), "keys": study.keys}
            folder.write_record(**record, compare_to=str(study.compare_to))
        run_folder = folder.run_folder(case.name)
        pipeline.simulate(case.planned_run.config, directory=run_folder, overwrite=True)
    return run_folder


def _find_case(study: StudyFile, directory: Path, name: str) -> Case:
    """Return the case with a name, an id or a row number; raise UsageError if there is none."""
    build_case = CaseBuilder(study.common_settings)
    for index, request in _candidates(study, directory, name):
        case = build_case(index, request)
        if _is_number(name) or case.id == _id_of(name):
            return case
    raise UsageError(
        f"the study has no run {name}",
        "give a name of the column run of study.csv, or the number of its row",
    )


def _candidates(study: StudyFile, directory: Path, name: str) -> Iterator[tuple[int, RunRequest]]:
    """Yield the requests, with their indices, that may be the run with the given name."""
    requests = enumerate(study.iterate_requests())
    if _is_number(name):
        yield from islice(requests, max(0, int(name) - 1), max(0, int(name)))
        return
    run_id = _id_of(name)
    if len(run_id) != ID_LENGTH or not set(run_id) <= set("0123456789abcdef"):
        return
    if study.keeps_all_runs:
        yield from requests
        return
    settings = RowIndex(directory / ROWS_FOLDER).settings_of(int(run_id, 16))
    checksum = SettingsChecksum(study)
    yield from (
        (index, request)
        for index, request in requests
        if settings and checksum(request) in settings
    )


def _is_number(name: str) -> bool:
    """Return whether a name is the number of a row."""
    return name.isdecimal() and len(name) <= MAX_NUMBER_DIGITS


def _id_of(name: str) -> str:
    """Return the id of a run, which ends its name."""
    return name.rpartition("-")[2]
