"""Result folder: the claim to write it, its lock, and how a new one takes the place of an old one.

A run writes into a hidden staging folder beside its target and becomes the target by renaming, so
that readers see the old folder or the new one, never half of one. `.lock` inside the folder is held
while the run lives (the kernel lets go of it when the run is killed) and moves with the rename.

A folder is this program's when its run.json or its `.lock` says so; whatever says nothing of the
kind is never moved, written or deleted, wherever it stands and whatever it is called. Links are not
followed when writing. What a folder holds is asked of `held` alone.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from indent_sim.process.errors import IndentSimError, UsageError
from indent_sim.process.limits import write_error

PROGRAM = "indent-sim"
LOCK = ".lock"
HIDDEN_NAMES = {LOCK, ".staging", ".old"}
REPORT = "run.json"
TABLE = "force_indentation.csv"
CONFIG = "config.yaml"
# in the folder of a study
STUDY = "study.json"
RUNS = "runs"
FIT = "fit.json"  # in the folder of a fit
CRATE = "ro-crate-metadata.json"  # what an archive of research data reads
MESH_FILE = "body.msh"  # the mesh of a body that came from a file
RESULT_FILES = {
    REPORT,
    TABLE,
    CONFIG,
    MESH_FILE,
    "surface.csv",
    "fields.xdmf",
    "tip.xdmf",
    "checkpoint.h5",
}
RESULT_FILES |= {
    "experiment.csv",
    "dynamic.csv",
    "force_indentation.png",
    "experiment.png",
    "report.html",
    CRATE,
}
RESULT_FILES |= {"fields.h5"}  # of version 0.1.0
# What begins a file of ours that anybody might have under that name; nobody else writes the rest of
# RESULT_FILES there
PICTURE_SIGNATURE = b"Software\0indent-sim"
# Written by runs, in place of what has that name
RUN_FILE_SIGNATURES = {
    "force_indentation.png": PICTURE_SIGNATURE,
    "experiment.png": PICTURE_SIGNATURE,
    "experiment.csv": b",branch",
}
CRATE_SIGNATURE = "RO-Crate of indent-sim"
FILE_SIGNATURES = RUN_FILE_SIGNATURES | {
    "report.html": b'content="indent-sim ',
    CRATE: CRATE_SIGNATURE.encode(),
}
FIELDS_FOLDER = "fields"  # a folder inside, and what in it is ours, finished or not
FIELD_FILE = re.compile(r"(mesh|step-\d+)\.h5|\.(mesh|step-\d+)\.h5\.new")
LOCK_SIGNATURE = b"indent-sim\n"  # how a lock begins that this program made
MAX_RESULT_BYTES = 10**9  # of a file that is read back
RESERVED_BYTES = (
    64 * 1024
)  # bytes in the lock file, given back on a full disk so that run.json can say so
KeptStates = Literal["none", "last", "all"]  # states of which a file keeps something
Report = dict[
    str, Any
]  # what run.json or study.json says: numbers, words, lists and mappings of them


def write_atomically(path: Path, content: str | bytes | Iterable[str], sync: bool = True) -> None:
    """Replace a file by new content, which may come in parts, at once: a reader or a kill sees the
    old file or the new one.
    """
    parts: Iterable[str | bytes] = [content] if isinstance(content, str | bytes) else content
    temporary = _temporary_path(path)
    try:
        with open(_open_new(temporary), "wb") as file:
            for part in parts:
                file.write(part.encode() if isinstance(part, str) else part)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink()
        raise


def _open_new(path: Path) -> int:
    """A new file opened for writing, in place of one of a write that was killed, or of a link to
    somewhere else.
    """
    for _ in range(2):
        with suppress(FileExistsError):
            return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        path.unlink(missing_ok=True)
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def _temporary_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def sync_to_disk(path: Path) -> None:
    """Wait until the disk has a file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def append_atomically(path: Path, data: bytes, sync: bool = True, tail: bytes = b"") -> None:
    """Append in one write, or not at all: what a full disk cut off is taken back.

    The file ends in `tail`, still.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    try:
        size = os.fstat(descriptor).st_size
        try:
            if os.pwrite(descriptor, data + tail, size - len(tail)) != len(data + tail):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        except OSError:
            os.pwrite(descriptor, tail, size - len(tail))
            os.ftruncate(descriptor, size)
            raise
        if sync:
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def read_regular_file(path: Path) -> bytes:
    """The bytes of a regular file; OSError when it is something else, which might never end, or
    longer than 1 GB.
    """
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        data = file.read(MAX_RESULT_BYTES + 1)
    if len(data) > MAX_RESULT_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data


def read_report(folder: Path, name: str = REPORT) -> Report:
    """The run.json of a folder as it stands; empty when there is none or it is not this program's,
    UsageError when it may not be read.
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
    """What a folder holds; nothing where there is none, or only what a run or a study that was
    killed at once left.

    UsageError when it is no folder, or cannot be read.
    """
    if _is_absent(folder):
        return "nothing"
    names = entry_names(
        folder,
        (
            name
            for name in HIDDEN_NAMES
            if is_own_folder(folder / name) or _is_own_lock(folder / name)
        ),
    )
    if read_report(folder):
        return "run"
    if read_report(folder, STUDY):
        return "study"
    if read_report(folder, FIT):
        return "fit"
    is_begun = (
        names <= {LOCK, RUNS}
        and not entry_names(folder / RUNS, ())
        and not (folder / RUNS).is_symlink()
    )
    lock = folder / LOCK  # in which a run killed right then has written nothing; a study never does
    is_empty = not os.path.lexists(lock) or (lock.is_file() and lock.stat().st_size == 0)
    return "nothing" if not names or (is_begun and is_empty) else "other"


def _is_absent(path: Path) -> bool:
    """Whether nothing stands at this path."""
    try:
        os.lstat(path)
    except FileNotFoundError:
        return True
    except OSError:  # somebody may know
        return False
    return False


def is_own_file(path: Path) -> bool:
    """Whether a file with the name of one of ours is ours."""
    with suppress(OSError):
        sign = FILE_SIGNATURES.get(path.name, PICTURE_SIGNATURE if path.suffix == ".png" else b"")
        return not path.is_symlink() and sign in read_regular_file(path)[:1000]
    return False


def is_own_folder(folder: Path) -> bool:
    """Whether this program made a folder: its lock or its run.json says so."""
    return (
        folder.is_dir()
        and not folder.is_symlink()
        and (_is_own_lock(folder / LOCK) or bool(read_report(folder)))
    )


def delete_own_files(folder: Path) -> None:
    """Delete this program's files in a folder of its own, what says so last; the folder too when
    nothing is left.
    """
    for name in (".staging", ".old"):
        if is_own_folder(folder / name):
            delete_own_files(folder / name)
    _delete_own_fields(folder / FIELDS_FOLDER)
    names = sorted(RESULT_FILES, key=lambda name: name == REPORT)
    for path in (
        [folder / name for name in names]
        + [_temporary_path(folder / name) for name in names]
        + [folder / LOCK]
    ):
        if path.name not in FILE_SIGNATURES or is_own_file(path):
            _unlink_file(path)
    with suppress(OSError):
        folder.rmdir()


def _unlink_file(path: Path) -> None:
    if path.is_symlink() or path.is_file():
        path.unlink()


def field_files(fields: Path) -> list[Path]:
    """This program's files in a folder of fields, none where that is a link or no folder."""
    if fields.is_symlink() or not fields.is_dir():
        return []
    return [path for path in fields.iterdir() if FIELD_FILE.fullmatch(path.name)]


def _delete_own_fields(fields: Path) -> None:
    """Delete this program's files in a folder of fields, and the folder when nothing else is in it;
    a link alone.
    """
    for path in [*field_files(fields), *([fields] if fields.is_symlink() else [])]:
        _unlink_file(path)
    with suppress(OSError):
        fields.rmdir()


def refuse_links(folder: Path) -> None:
    """UsageError when one of the files that a run would go on writing is a link, or no file: it may
    be anything.
    """
    fields = folder / FIELDS_FOLDER
    if os.path.lexists(fields) and (fields.is_symlink() or not fields.is_dir()):
        raise UsageError(f"{fields} is a link, or no folder: nothing is written through it")
    for path in [*(folder / name for name in sorted(RESULT_FILES | {LOCK})), *field_files(fields)]:
        with suppress(FileNotFoundError):
            file_status = path.lstat()
            if not stat.S_ISREG(file_status.st_mode) or file_status.st_nlink > 1:
                raise UsageError(f"{path} is a link, or no file: nothing is written through it")


def has_rows(folder: Path) -> bool:
    """Whether the folder's force table holds at least one complete row."""
    with suppress(OSError):
        return read_regular_file(folder / TABLE).count(b"\n") > 1
    return False


class OutputFolder:
    """The right to write one result folder: a locked staging folder that becomes the target.

    may_replace: raises UsageError when the run in a folder is not to be replaced; by default each
    is. Raises UsageError, and leaves nothing behind, when the target is foreign, unwritable, in
    use, or not to be replaced.
    """

    def __init__(self, target: Path, may_replace: Callable[[Path], None] = lambda folder: None):
        self._check_replaceable = may_replace
        self._lock_descriptor = -1
        self.is_in_place = False
        self._created_parents: list[Path] = []
        try:
            if target.is_symlink() and not target.exists():
                raise UsageError(f"{target} is a link to nothing")
            self.target = Path(os.path.realpath(target))
            parent = self.target.parent
            name = self.target.name
            can_stage_beside = not self.target.is_dir() or os.access(parent, os.W_OK | os.X_OK)
            self.path = (
                parent / f".{name}.staging" if can_stage_beside else self.target / ".staging"
            )
            self._old_folder = parent / f".{name}.old" if can_stage_beside else self.target / ".old"
            self._refuse_occupied_names()
            self._refuse_target()
            self._make_parents(self.target.parent)
            self._create_staging_folder()
            self._recover_interrupted_rename()
            self._refuse_target()
        except (OSError, IndentSimError) as error:
            self.abandon()
            raise (write_error(target, error) if isinstance(error, OSError) else error) from error
        self.replaces_results = has_rows(self.target)

    def resume_in_place(self) -> None:
        """Go on in the target itself, with the run that is there, in place of a staging folder."""
        refuse_links(self.target)
        try:
            descriptor = _open_locked(self.target / LOCK, self.target)
            _sign_lock(descriptor)
            for name in RESULT_FILES:  # of a write that was killed
                _temporary_path(self.target / name).unlink(missing_ok=True)
            for path in field_files(self.target / FIELDS_FOLDER):
                if path.name.startswith("."):
                    path.unlink()
        except OSError as error:
            raise write_error(self.target, error) from error
        staging = self.path
        old_lock = self._lock_descriptor
        self.path = self.target
        self._lock_descriptor = descriptor
        self.is_in_place = True
        shutil.rmtree(staging, ignore_errors=True)
        os.close(old_lock)

    def rename_into_place(self) -> None:
        """Give the staging folder its target's name; an old folder goes, but files that are not
        ours stay.
        """
        self._refuse_target()
        # renaming a folder under somebody's feet would leave them in a deleted one
        if self._old_folder.parent != self.target and self.target not in (
            here := Path.cwd(),
            *here.parents,
        ):
            try:
                if self.target.is_dir() and any(self.target.iterdir()):
                    os.rename(self.target, self._old_folder)
                os.rename(self.path, self.target)
            except OSError as error:
                if error.errno not in (errno.EBUSY, errno.EXDEV, errno.EPERM, errno.EACCES):
                    raise
                # a mounted folder cannot be renamed, nor one of somebody else in /tmp
                self._rename_entries()
        else:
            self._rename_entries()
        self.path = self.target
        self.is_in_place = True
        self._created_parents = []
        self._delete_old()

    def abandon(self) -> None:
        """Give the claim up and leave everything as it was found."""
        if not self.is_in_place and self._lock_descriptor >= 0:
            shutil.rmtree(self.path, ignore_errors=True)
        self.release_lock()
        for folder in reversed(self._created_parents):
            with suppress(OSError):
                folder.rmdir()
        self._created_parents.clear()

    def release_lock(self) -> None:
        """Let go of the lock; what is written stays."""
        if self._lock_descriptor >= 0:
            if _is_same_file(self._lock_descriptor, self.path / LOCK):
                with suppress(OSError):
                    (self.path / LOCK).unlink()
            os.close(self._lock_descriptor)
            self._lock_descriptor = -1

    def free_reserved_space(self) -> None:
        """Free the lock file's bytes on a full disk."""
        if self._lock_descriptor >= 0:
            with suppress(OSError):
                os.ftruncate(self._lock_descriptor, len(LOCK_SIGNATURE))

    def _make_parents(self, folder: Path) -> None:
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        writable_folders = (
            [self.target, self.target / FIELDS_FOLDER] if self.target.is_dir() else [folder]
        )
        if not all(
            os.access(place, os.W_OK | os.X_OK) for place in writable_folders if place.is_dir()
        ):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
        for folder in reversed(missing):
            folder.mkdir()
            self._created_parents.append(folder)

    def _create_staging_folder(self) -> None:
        for _ in range(20):  # another run may publish or clean up between two of these lines
            with suppress(FileExistsError):
                self.path.mkdir()
            with suppress(FileNotFoundError):
                descriptor = _open_locked(self.path / LOCK, self.target)
                if _is_same_file(descriptor, self.path / LOCK):
                    break
                os.close(descriptor)
        else:
            raise UsageError(f"{self.target} is in use by another run")
        self._lock_descriptor = descriptor
        for entry in [
            entry for entry in self.path.iterdir() if entry.name != LOCK
        ]:  # of a killed run
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink()
        _sign_lock(descriptor)

    def _refuse_occupied_names(self) -> None:
        """Nobody else's folder is used, whatever it is called."""
        for path in (self.path, self._old_folder):
            unused = path == self.path and not path.is_symlink() and folder_kind(path) == "nothing"
            if os.path.lexists(path) and not (is_own_folder(path) or unused):
                raise UsageError(
                    f"{path} is in the way and was not made by {PROGRAM}; choose another --output"
                )

    def _refuse_target(self) -> None:
        if (
            not self._old_folder.is_dir()
        ):  # else a run was killed while it took the place of an old one
            refuse_foreign(self.target)
            self._check_replaceable(self.target)
        with suppress(OSError):  # no lock, or not ours to open
            os.close(_open_locked(self.target / LOCK, self.target, 0))

    def _recover_interrupted_rename(self) -> None:
        """Finish or undo what a run killed amid `publish` left; run.json leaves first and comes
        last.
        """
        if not self._old_folder.is_dir():
            return
        if (self.target / REPORT).exists():
            self._delete_old()
        elif not self.target.exists() or not _is_own_lock(
            self._old_folder / LOCK
        ):  # it was renamed whole
            if self.target.exists():  # what stands there now came later
                refuse_foreign(self.target)
                self.target.rmdir()
            os.rename(self._old_folder, self.target)
        else:
            if not (self._old_folder / REPORT).exists():  # the target was empty before
                for name in RESULT_FILES:
                    (self.target / name).unlink(missing_ok=True)
                _delete_own_fields(self.target / FIELDS_FOLDER)
            if (self._old_folder / FIELDS_FOLDER).is_dir():
                _delete_own_fields(self.target / FIELDS_FOLDER)
            for entry in self._old_folder.iterdir():
                if entry.name != LOCK:
                    os.replace(entry, self.target / entry.name)
            delete_own_files(self._old_folder)

    def _rename_entries(self) -> None:
        new_old_folder = self.path / ".old"  # that it is ours must be said before it has its name
        new_old_folder.mkdir()
        (new_old_folder / LOCK).write_bytes(LOCK_SIGNATURE)
        os.rename(new_old_folder, self._old_folder)
        for entry in sorted(self.target.iterdir(), key=lambda entry: entry.name != REPORT):
            if entry.name not in HIDDEN_NAMES:
                shutil.move(entry, self._old_folder / entry.name)
        for entry in sorted(self.path.iterdir(), key=lambda entry: entry.name == REPORT):
            shutil.move(entry, self.target / entry.name)
        shutil.rmtree(self.path, ignore_errors=True)

    def _delete_old(self) -> None:
        if not self._old_folder.is_dir():
            return
        _delete_own_fields(self._old_folder / FIELDS_FOLDER)  # what is left of it is not ours
        _move_missing(self._old_folder, self.target, foreign_files(self._old_folder))
        if (self._old_folder / FIELDS_FOLDER).is_dir():
            _move_missing(
                self._old_folder / FIELDS_FOLDER,
                self.target / FIELDS_FOLDER,
                entry_names(self._old_folder / FIELDS_FOLDER, ()),
            )
        delete_own_files(self._old_folder)


def foreign_files(folder: Path) -> set[str]:
    """The names of what stands in a result folder and is not ours."""
    names = entry_names(folder, HIDDEN_NAMES)
    return {
        name
        for name in names
        if name not in RESULT_FILES or (name in FILE_SIGNATURES and not is_own_file(folder / name))
    }


def _move_missing(source: Path, target: Path, names: Iterable[str]) -> None:
    """Move entries of a folder into another, but for those whose names it has."""
    for name in names:
        if not os.path.lexists(target / name):
            shutil.move(source / name, target / name)


def refuse_foreign(
    target: Path, kind: str = "run", written: Iterable[str] = RUN_FILE_SIGNATURES
) -> None:
    """UsageError where a run (a study) would take the place of what is not ours."""
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
    for path in (target / name for name in written):
        if os.path.lexists(path) and not is_own_file(path):
            problem = f"{path} was not made by {PROGRAM}, and would be replaced"
            raise UsageError(problem, "move it, or choose another --output", str(path))


def config_file_entries(file: str, folder: Path) -> dict[str, str]:
    """How run.json names the config file of a run: by its path, and as seen from the folder; both
    may move together.
    """
    path = os.path.realpath(file)
    return (
        {"config": path, "config_from_here": os.path.relpath(path, os.path.realpath(folder))}
        if file
        else {}
    )


def is_same_config_file(theirs: Report, ours: Report, folder: Path) -> bool:
    """Whether two runs are of one config file, by what their run.json say; a run that names no file
    is of any.
    """
    their_request = theirs.get("asked")
    our_request = ours.get("asked")
    if not (
        isinstance(their_request, dict)
        and isinstance(our_request, dict)
        and "config" in their_request
        and "config" in our_request
    ):
        return True
    return any(
        their_request.get(name) == path
        for name, path in config_file_entries(our_request["config"], folder).items()
    )


def _is_own_lock(lock: Path) -> bool:
    with (
        suppress(OSError),
        open(os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file,
    ):
        return (
            stat.S_ISREG(os.fstat(file.fileno()).st_mode)
            and file.read(len(LOCK_SIGNATURE)) == LOCK_SIGNATURE
        )
    return False


def _sign_lock(descriptor: int) -> None:
    """Say in a lock that it is this program's, with its ballast behind."""
    os.pwrite(descriptor, LOCK_SIGNATURE.ljust(RESERVED_BYTES, b"\0"), 0)


def entry_names(path: Path, excluded: Iterable[str]) -> set[str]:
    """Names in a folder, none when there is no folder; UsageError when it is something else or
    cannot be read.
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


def _open_locked(path: Path, target: Path, flags: int = os.O_CREAT) -> int:
    """An open, locked file; UsageError when another process, which writes the target, holds it."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | flags, 0o644)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise UsageError(f"{target} is in use by another run") from None
    except OSError:
        pass  # a file system without locks: go on without
    return descriptor


def _is_same_file(descriptor: int, path: Path) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    return False
