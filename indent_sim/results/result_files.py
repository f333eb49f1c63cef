"""Names and ownership of the files of result folders, studies and fits.

A folder belongs to this program if its run.json or `.lock` has the signature of the program.
Foreign files and folders are never moved, written or deleted, and links are not followed when
writing.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from indent_sim.process.errors import UsageError
from indent_sim.process.regular_files import open_regular_file
from indent_sim.results.atomic_files import read_regular_file, temporary_path

PROGRAM = "indent-sim"
LOCK = ".lock"
HIDDEN_NAMES = {LOCK, ".staging", ".old"}
REPORT = "run.json"
TABLE = "force_indentation.csv"
CONFIG = "config.yaml"
# The folder of a study has these two entries, the folder of a fit the others.
STUDY = "study.json"
RUNS = "runs"
FIT = "fit.json"
CURVES_FOLDER = "curves"
REPORT_PAGE = "report.html"  # report of a run, a study or a fit as HTML page
CRATE = "ro-crate-metadata.json"  # metadata for archives of research data
MESH_FILE = "body.msh"  # mesh of a body that was read from a file
OLD_FIELDS_FILE = "fields.h5"  # fields as version 0.1.0 wrote them, all in one file
RESULT_FILES = {
    REPORT,
    TABLE,
    CONFIG,
    MESH_FILE,
    "surface.csv",
    "fields.xdmf",
    "tip.xdmf",
    "checkpoint.h5",
    "experiment.csv",
    "dynamic.csv",
    "force_indentation.png",
    "experiment.png",
    REPORT_PAGE,
    CRATE,
    OLD_FIELDS_FILE,
}
# Files with common names are recognised by a signature at their beginning. Other programs do not
# write files with the other names of RESULT_FILES.
PICTURE_SIGNATURE = b"Software\0indent-sim"
# Signatures of the files that a run writes.
RUN_FILE_SIGNATURES = {
    "force_indentation.png": PICTURE_SIGNATURE,
    "experiment.png": PICTURE_SIGNATURE,
    "experiment.csv": b",branch",
}
CRATE_SIGNATURE = "RO-Crate of indent-sim"
FILE_SIGNATURES = RUN_FILE_SIGNATURES | {
    REPORT_PAGE: b'content="indent-sim ',
    CRATE: CRATE_SIGNATURE.encode(),
}
# Names of files of this program in the folder of fields; the second form is that of unfinished
# files.
FIELDS_FOLDER = "fields"
FIELD_FILE = re.compile(r"(mesh|step-\d+)\.h5|\.(mesh|step-\d+)\.h5\.new")
LOCK_SIGNATURE = b"indent-sim\n"  # Signature at the beginning of the lock files of this program.
KeptStates = Literal["none", "last", "all"]
Report = dict[str, Any]  # Content of run.json, study.json or fit.json.


def read_report(folder: Path, name: str = REPORT) -> Report:
    """Read the run.json of a folder without checking its entries.

    Parameters
    ----------
    folder
        A folder of results.
    name
        The file: run.json, study.json or fit.json.

    Returns
    -------
    dict
        The content of the file; empty if there is no such file, or if it was not written by this
        program.

    Raises
    ------
    UsageError
        If the file exists but must not be read.
    """
    try:
        report = json.loads(read_regular_file(folder / name))
    except PermissionError as error:
        raise UsageError(
            f"cannot read {folder / name}: {error.strerror}", file=str(folder / name)
        ) from error
    except (OSError, ValueError, RecursionError):
        return {}
    return report if isinstance(report, dict) and report.get("program") == PROGRAM else {}


def folder_kind(folder: Path) -> Literal["nothing", "run", "study", "fit", "other"]:
    """Return the kind of content of a folder: a run, a study, a fit, nothing, or other files.

    "nothing" means a missing or empty folder, and for a folder that contains only the lock, the
    empty runs/ or curves/, or the unfinished fit.json of a run, study or fit that was killed at its
    start.

    Raises
    ------
    UsageError
        The path is not a folder, or cannot be read.
    """
    if _is_absent(folder):
        return "nothing"
    names = entry_names(
        folder,
        (
            name
            for name in HIDDEN_NAMES
            if is_own_folder(folder / name) or is_own_lock(folder / name)
        ),
    )
    if read_report(folder):
        return "run"
    if read_report(folder, STUDY):
        return "study"
    if read_report(folder, FIT):
        return "fit"
    is_begun = names <= {LOCK, RUNS, CURVES_FOLDER, temporary_path(folder / FIT).name} and not any(
        entry_names(folder / name, ()) or (folder / name).is_symlink()
        for name in (RUNS, CURVES_FOLDER)
    )
    # A run that is killed as it begins leaves an empty lock; a study always leaves an empty one.
    lock = folder / LOCK
    is_empty = not os.path.lexists(lock) or (lock.is_file() and lock.stat().st_size == 0)
    return "nothing" if not names or (is_begun and is_empty) else "other"


def _is_absent(path: Path) -> bool:
    """Return whether nothing exists at this path."""
    try:
        os.lstat(path)
    except FileNotFoundError:
        return True
    except OSError:  # The path may exist in a folder that cannot be read.
        return False
    return False


def is_own_file(path: Path) -> bool:
    """Return whether this program wrote a file, by the signature in its first 1000 bytes."""
    with suppress(OSError):
        sign = FILE_SIGNATURES.get(path.name, PICTURE_SIGNATURE if path.suffix == ".png" else b"")
        return not path.is_symlink() and sign in read_regular_file(path)[:1000]
    return False


def is_own_folder(folder: Path) -> bool:
    """Return whether this program made a folder, by its lock or its run.json."""
    return (
        folder.is_dir()
        and not folder.is_symlink()
        and (is_own_lock(folder / LOCK) or bool(read_report(folder)))
    )


def delete_own_files(folder: Path) -> None:
    """Delete this program's files in a folder, and the folder if it is then empty.

    run.json and the lock, which mark the folder as belonging to this program, are deleted last.
    """
    for name in (".staging", ".old"):
        if is_own_folder(folder / name):
            delete_own_files(folder / name)
    delete_own_fields(folder / FIELDS_FOLDER)
    names = sorted(RESULT_FILES, key=lambda name: name == REPORT)
    for path in (
        [folder / name for name in names]
        + [temporary_path(folder / name) for name in names]
        + [folder / LOCK]
    ):
        if path.name not in FILE_SIGNATURES or is_own_file(path):
            _unlink_file(path)
    with suppress(OSError):
        folder.rmdir()


def _unlink_file(path: Path) -> None:
    """Delete a file or a link, but not a folder."""
    if path.is_symlink() or path.is_file():
        path.unlink()


def field_files(fields: Path) -> list[Path]:
    """Return this program's files in a folder of fields; empty if it is a link or not a folder."""
    if fields.is_symlink() or not fields.is_dir():
        return []
    return [path for path in fields.iterdir() if FIELD_FILE.fullmatch(path.name)]


def delete_own_fields(fields: Path) -> None:
    """Delete this program's files in a folder of fields, and the folder if it is then empty.

    A link in place of the folder is deleted, but not its target.
    """
    for path in [*field_files(fields), *([fields] if fields.is_symlink() else [])]:
        _unlink_file(path)
    with suppress(OSError):
        fields.rmdir()


def refuse_links(folder: Path) -> None:
    """Raise UsageError if a file to which a run would append is a link, or not a regular file.

    A link may point to any file outside of the result folder.
    """
    fields = folder / FIELDS_FOLDER
    if os.path.lexists(fields) and (fields.is_symlink() or not fields.is_dir()):
        raise UsageError(
            f"{fields} is a link, or is not a folder, so that nothing is written to it"
        )
    for path in [*(folder / name for name in sorted(RESULT_FILES | {LOCK})), *field_files(fields)]:
        with suppress(FileNotFoundError):
            file_status = path.lstat()
            if not stat.S_ISREG(file_status.st_mode) or file_status.st_nlink > 1:
                raise UsageError(
                    f"{path} is a link, or is not a file, so that nothing is written to it"
                )


def has_rows(folder: Path) -> bool:
    """Return whether the force table of a folder has at least one complete row."""
    with suppress(OSError):
        return read_regular_file(folder / TABLE).count(b"\n") > 1
    return False


def foreign_files(folder: Path) -> set[str]:
    """Return the names of the entries of a result folder that this program did not write."""
    names = entry_names(folder, HIDDEN_NAMES)
    return {
        name
        for name in names
        if name not in RESULT_FILES or (name in FILE_SIGNATURES and not is_own_file(folder / name))
    }


def refuse_foreign(
    target: Path, kind: str = "run", written_names: Iterable[str] = RUN_FILE_SIGNATURES
) -> None:
    """Raise UsageError if a run, study or fit would replace files that it did not write.

    Parameters
    ----------
    target
        The result folder.
    kind
        Kind of the results that may be replaced: "run", "study" or "fit".
    written_names
        Names of files to be written that other programs might use as well.
    """
    if _is_absent(target):
        return
    kind_found = folder_kind(target)
    if kind_found not in ("nothing", kind):
        problem_text = (
            "is not empty and was not made by"
            if kind_found == "other"
            else f"holds a {kind_found} of"
        )
        raise UsageError(f"{target} {problem_text} {PROGRAM}", "choose another --output")
    for path in (target / name for name in written_names):
        if os.path.lexists(path) and not is_own_file(path):
            problem = f"{path} was not made by {PROGRAM}, and would be replaced"
            raise UsageError(problem, "move it, or choose another --output", str(path))


def config_file_entries(file: str, folder: Path) -> dict[str, str]:
    """Return the entries of run.json that name the config file of a run.

    The entries are the absolute path of the config file, and its path relative to the result
    folder, which remains valid if both are moved together. The result is empty for a run without a
    config file.
    """
    if not file:
        return {}
    path = os.path.realpath(file)
    try:
        from_folder = os.path.relpath(path, os.path.realpath(folder))
    except ValueError:
        from_folder = path  # The two paths are on different drives of Windows.
    return {"config": path, "config_from_here": from_folder}


def is_same_config_file(old_report: Report, new_report: Report, folder: Path) -> bool:
    """Return whether two runs have the same config file; True if a run names no config file.

    Parameters
    ----------
    old_report, new_report
        The run.json of the previous and of the new run.
    folder
        The result folder.
    """
    old_options = old_report.get("asked")
    new_options = new_report.get("asked")
    if not (
        isinstance(old_options, dict)
        and isinstance(new_options, dict)
        and "config" in old_options
        and "config" in new_options
    ):
        return True
    return any(
        old_options.get(name) == path
        for name, path in config_file_entries(new_options["config"], folder).items()
    )


def is_own_lock(lock: Path) -> bool:
    """Return whether a lock file begins with this program's signature."""
    with (
        suppress(OSError),
        open_regular_file(lock, links=False) as file,
    ):
        return file.read(len(LOCK_SIGNATURE)) == LOCK_SIGNATURE
    return False


def entry_names(path: Path, excluded: Iterable[str]) -> set[str]:
    """Return the names in a folder except the excluded ones; empty if there is no folder.

    Raises
    ------
    UsageError
        The path is not a folder, or cannot be read.
    """
    try:
        if not path.exists():
            return set()
        if not path.is_dir():
            raise UsageError(f"{path} is not a folder")
        return {entry.name for entry in path.iterdir()} - set(excluded)
    except OSError as error:
        raise UsageError(
            f"cannot read {path}: {error.strerror or error}", file=str(path)
        ) from error
