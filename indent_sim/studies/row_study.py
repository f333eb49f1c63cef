"""Execution of a study without result folders: its shards, and the table that merges them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from indent_sim.process.errors import NotConverged, UsageError
from indent_sim.process.limits import write_error
from indent_sim.process.usage import machine_memory
from indent_sim.results.result_files import Report
from indent_sim.studies import many_runs_picture, study_folder
from indent_sim.studies import shard as shards
from indent_sim.studies.finished_study import Study, read_study
from indent_sim.studies.row_file import ROWS_FOLDER, gather_lock, row_files
from indent_sim.studies.row_table import RowCounts, RowTable
from indent_sim.studies.study_file import StudyFile

# Largest number of rows of a table that is read back into memory.
MAX_ROWS_IN_MEMORY = 10_000


def _units(study: StudyFile) -> dict[str, str]:
    """Return the units of the results of a study, if its scene names units."""
    units = study.base.get("units")
    if not isinstance(units, dict):
        return {}
    length = units.get("length", "")
    force = units.get("force", "")
    return {"force": force, "a": length, "penetration": length, "p_max": f"{force}/{length}²"}


def _write_table(study: StudyFile, directory: Path) -> RowCounts:
    """Write the table of a study and its curves; return the numbers of rows."""
    try:
        return RowTable(study, directory).write()
    except OSError as error:
        raise write_error(directory, error) from error


def execute_row_study(
    study: StudyFile,
    directory: Path,
    *,
    resume: bool,
    shard: tuple[int, int] | None,
    jobs: int,
    overwrite: bool,
    gather: bool,
    tell: Callable[[str], None],
) -> Study:
    """Compute the missing rows of a study, and write its table; a shard writes no table.

    The parameters are those of `execute_study`.
    """
    memory = jobs * shards.check_first_points(study)
    if jobs > 1 and memory > (available := machine_memory() / 1e6):
        raise UsageError(
            f"{jobs} runs at a time need about {memory:.3g} MB, this machine has {available:.3g} "
            "MB: use fewer --jobs"
        )
    keeps_rows = resume or gather or shard is not None
    if not (keeps_rows or overwrite) and row_files(directory / ROWS_FOLDER):
        raise UsageError(
            f"{directory} contains the rows of an earlier study",
            "--resume keeps them, --overwrite deletes them, or choose another --output",
            str(directory),
        )
    options = {"resume": keeps_rows, "shared": gather or shard is not None}
    with study_folder.open_study_folder(directory, overwrite=overwrite, **options) as folder:
        record: Report = {"title": study.title, "study": str(study.path), "keys": study.keys}
        record |= {"compare_to": study.compare_to, "runs": study.run_folders}
        if not gather:
            folder.write_record(**record)
            if not keeps_rows:
                shards.delete_rows(directory)
                folder.delete_other_runs()
            shards.compute_rows(
                study,
                directory,
                shard=shard or (1, 1),
                jobs=jobs,
                lock=folder.lock_descriptor,
                tell=tell,
            )
        if shard is not None:
            return Study(directory, study.title, study.keys, str(study.compare_to), [])
        with gather_lock(directory / ROWS_FOLDER):
            counts = _write_table(study, directory)
        folder.write_record(**record, counts=counts.as_json(), units=_units(study))
    if counts.done:
        many_runs_picture.draw_pictures(directory)
    if not counts.done and not gather:
        raise NotConverged(
            f"no run of this study has a result; reason of the first run: {counts.first_reason}"
        )
    if counts.total <= MAX_ROWS_IN_MEMORY:
        return read_study(directory)
    return Study(
        directory, study.title, study.keys, str(study.compare_to), [], counts=counts.as_json()
    )
