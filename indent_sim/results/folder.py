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
from indent_sim.process.limits import unwritable

PROGRAM = "indent-sim"
LOCK = ".lock"
HIDDEN = {LOCK, ".staging", ".old"}
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
PICTURE_SIGN = b"Software\0indent-sim"
# Written by runs, in place of what has that name
WRITTEN = {
    "force_indentation.png": PICTURE_SIGN,
    "experiment.png": PICTURE_SIGN,
    "experiment.csv": b",branch",
}
CRATE_SIGN = "RO-Crate of indent-sim"
SIGNS = WRITTEN | {"report.html": b'content="indent-sim ', CRATE: CRATE_SIGN.encode()}
FIELDS_FOLDER = "fields"  # a folder inside, and what in it is ours, finished or not
FIELD_FILE = re.compile(r"(mesh|step-\d+)\.h5|\.(mesh|step-\d+)\.h5\.new")
MARK = b"indent-sim\n"  # how a lock begins that this program made
MOST_RESULT_BYTES = 10**9  # of a file that is read back
BALLAST = 64 * 1024  # bytes in the lock file, given back on a full disk so that run.json can say so
Keep = Literal["none", "last", "all"]  # states of which a file keeps something
Report = dict[
    str, Any
]  # what run.json or study.json says: numbers, words, lists and mappings of them


def write_atomically(path: Path, content: str | bytes | Iterable[str], sync: bool = True) -> None:
    """Replace a file by new content, which may come in parts, at once: a reader or a kill sees the
    old file or the new one.
    """
    parts: Iterable[str | bytes] = [content] if isinstance(content, str | bytes) else content
    temporary = _temporary(path)
    try:
        with open(_created(temporary), "wb") as file:
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


def _created(path: Path) -> int:
    """A new file opened for writing, in place of one of a write that was killed, or of a link to
    somewhere else.
    """
    for _ in range(2):
        with suppress(FileExistsError):
            return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        path.unlink(missing_ok=True)
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def wait_for_disk(path: Path) -> None:
    """Wait until the disk has a file."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def append_whole(path: Path, data: bytes, sync: bool = True, tail: bytes = b"") -> None:
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


def content(path: Path) -> bytes:
    """The bytes of a regular file; OSError when it is something else, which might never end, or
    longer than 1 GB.
    """
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        data = file.read(MOST_RESULT_BYTES + 1)
    if len(data) > MOST_RESULT_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data


def read_report(folder: Path, name: str = REPORT) -> Report:
    """The run.json of a folder as it stands; empty when there is none or it is not this program's,
    UsageError when it may not be read.
    """
    try:
        report = json.loads(content(folder / name))
    except PermissionError as error:
        raise UsageError(
            f"cannot read {folder / name}: {error.strerror}", file=str(folder / name)
        ) from error
    except (OSError, ValueError, RecursionError):
        return {}
    return report if isinstance(report, dict) and report.get("program") == PROGRAM else {}


def held(folder: Path) -> Literal["nothing", "run", "study", "fit", "other"]:
    """What a folder holds; nothing where there is none, or only what a run or a study that was
    killed at once left.

    UsageError when it is no folder, or cannot be read.
    """
    if _is_nothing(folder):
        return "nothing"
    names = contents(
        folder, (name for name in HIDDEN if is_ours(folder / name) or _is_marked(folder / name))
    )
    if read_report(folder):
        return "run"
    if read_report(folder, STUDY):
        return "study"
    if read_report(folder, FIT):
        return "fit"
    begun = (
        names <= {LOCK, RUNS}
        and not contents(folder / RUNS, ())
        and not (folder / RUNS).is_symlink()
    )
    lock = folder / LOCK  # in which a run killed right then has written nothing; a study never does
    is_empty = not os.path.lexists(lock) or (lock.is_file() and lock.stat().st_size == 0)
    return "nothing" if not names or (begun and is_empty) else "other"


def _is_nothing(path: Path) -> bool:
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
        sign = SIGNS.get(path.name, PICTURE_SIGN if path.suffix == ".png" else b"")
        return not path.is_symlink() and sign in content(path)[:1000]
    return False


def is_ours(folder: Path) -> bool:
    """Whether this program made a folder: its lock or its run.json says so."""
    return (
        folder.is_dir()
        and not folder.is_symlink()
        and (_is_marked(folder / LOCK) or bool(read_report(folder)))
    )


def discard(folder: Path) -> None:
    """Delete this program's files in a folder of its own, what says so last; the folder too when
    nothing is left.
    """
    for name in (".staging", ".old"):
        if is_ours(folder / name):
            discard(folder / name)
    _discard_fields(folder / FIELDS_FOLDER)
    names = sorted(RESULT_FILES, key=lambda name: name == REPORT)
    for path in (
        [folder / name for name in names]
        + [_temporary(folder / name) for name in names]
        + [folder / LOCK]
    ):
        if path.name not in SIGNS or is_own_file(path):
            _unlink(path)
    with suppress(OSError):
        folder.rmdir()


def _unlink(path: Path) -> None:
    if path.is_symlink() or path.is_file():
        path.unlink()


def field_files(fields: Path) -> list[Path]:
    """This program's files in a folder of fields, none where that is a link or no folder."""
    if fields.is_symlink() or not fields.is_dir():
        return []
    return [path for path in fields.iterdir() if FIELD_FILE.fullmatch(path.name)]


def _discard_fields(fields: Path) -> None:
    """Delete this program's files in a folder of fields, and the folder when nothing else is in it;
    a link alone.
    """
    for path in [*field_files(fields), *([fields] if fields.is_symlink() else [])]:
        _unlink(path)
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
            found = path.lstat()
            if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
                raise UsageError(f"{path} is a link, or no file: nothing is written through it")


def has_rows(folder: Path) -> bool:
    """Whether the folder's force table holds at least one complete row."""
    with suppress(OSError):
        return content(folder / TABLE).count(b"\n") > 1
    return False


class Claim:
    """The right to write one result folder: a locked staging folder that becomes the target.

    may_replace: raises UsageError when the run in a folder is not to be replaced; by default each
    is. Raises UsageError, and leaves nothing behind, when the target is foreign, unwritable, in
    use, or not to be replaced.
    """

    def __init__(self, target: Path, may_replace: Callable[[Path], None] = lambda folder: None):
        self._may_replace = may_replace
        self._lock = -1
        self.published = False
        self._parents: list[Path] = []
        try:
            if target.is_symlink() and not target.exists():
                raise UsageError(f"{target} is a link to nothing")
            self.target = Path(os.path.realpath(target))
            parent = self.target.parent
            name = self.target.name
            beside = not self.target.is_dir() or os.access(parent, os.W_OK | os.X_OK)
            self.path = parent / f".{name}.staging" if beside else self.target / ".staging"
            self._old = parent / f".{name}.old" if beside else self.target / ".old"
            self._refuse_in_the_way()
            self._refuse()
            self._make_parents(self.target.parent)
            self._stage()
            self._recover()
            self._refuse()
        except (OSError, IndentSimError) as error:
            self.drop()
            raise (unwritable(target, error) if isinstance(error, OSError) else error) from error
        self.replaces_results = has_rows(self.target)

    def adopt(self) -> None:
        """Go on in the target itself, with the run that is there, in place of a staging folder."""
        refuse_links(self.target)
        try:
            descriptor = _lock(self.target / LOCK, self.target)
            _mark(descriptor)
            for name in RESULT_FILES:  # of a write that was killed
                _temporary(self.target / name).unlink(missing_ok=True)
            for path in field_files(self.target / FIELDS_FOLDER):
                if path.name.startswith("."):
                    path.unlink()
        except OSError as error:
            raise unwritable(self.target, error) from error
        staging = self.path
        claimed = self._lock
        self.path = self.target
        self._lock = descriptor
        self.published = True
        shutil.rmtree(staging, ignore_errors=True)
        os.close(claimed)

    def publish(self) -> None:
        """Give the staging folder its target's name; an old folder goes, but files that are not
        ours stay.
        """
        self._refuse()
        # renaming a folder under somebody's feet would leave them in a deleted one
        if self._old.parent != self.target and self.target not in (
            here := Path.cwd(),
            *here.parents,
        ):
            try:
                if self.target.is_dir() and any(self.target.iterdir()):
                    os.rename(self.target, self._old)
                os.rename(self.path, self.target)
            except OSError as error:
                if error.errno not in (errno.EBUSY, errno.EXDEV, errno.EPERM, errno.EACCES):
                    raise
                # a mounted folder cannot be renamed, nor one of somebody else in /tmp
                self._rename_entries()
        else:
            self._rename_entries()
        self.path = self.target
        self.published = True
        self._parents = []
        self._delete_old()

    def drop(self) -> None:
        """Give the claim up and leave everything as it was found."""
        if not self.published and self._lock >= 0:
            shutil.rmtree(self.path, ignore_errors=True)
        self.release()
        for folder in reversed(self._parents):
            with suppress(OSError):
                folder.rmdir()
        self._parents.clear()

    def release(self) -> None:
        """Let go of the lock; what is written stays."""
        if self._lock >= 0:
            if _is_same(self._lock, self.path / LOCK):
                with suppress(OSError):
                    (self.path / LOCK).unlink()
            os.close(self._lock)
            self._lock = -1

    def give_ballast(self) -> None:
        """Free the lock file's bytes on a full disk."""
        if self._lock >= 0:
            with suppress(OSError):
                os.ftruncate(self._lock, len(MARK))

    def _make_parents(self, folder: Path) -> None:
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        places = [self.target, self.target / FIELDS_FOLDER] if self.target.is_dir() else [folder]
        if not all(os.access(place, os.W_OK | os.X_OK) for place in places if place.is_dir()):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
        for folder in reversed(missing):
            folder.mkdir()
            self._parents.append(folder)

    def _stage(self) -> None:
        for _ in range(20):  # another run may publish or clean up between two of these lines
            with suppress(FileExistsError):
                self.path.mkdir()
            with suppress(FileNotFoundError):
                descriptor = _lock(self.path / LOCK, self.target)
                if _is_same(descriptor, self.path / LOCK):
                    break
                os.close(descriptor)
        else:
            raise UsageError(f"{self.target} is in use by another run")
        self._lock = descriptor
        for entry in [
            entry for entry in self.path.iterdir() if entry.name != LOCK
        ]:  # of a killed run
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink()
        _mark(descriptor)

    def _refuse_in_the_way(self) -> None:
        """Nobody else's folder is used, whatever it is called."""
        for path in (self.path, self._old):
            unused = path == self.path and not path.is_symlink() and held(path) == "nothing"
            if os.path.lexists(path) and not (is_ours(path) or unused):
                raise UsageError(
                    f"{path} is in the way and was not made by {PROGRAM}; choose another --output"
                )

    def _refuse(self) -> None:
        if not self._old.is_dir():  # else a run was killed while it took the place of an old one
            refuse_foreign(self.target)
            self._may_replace(self.target)
        with suppress(OSError):  # no lock, or not ours to open
            os.close(_lock(self.target / LOCK, self.target, 0))

    def _recover(self) -> None:
        """Finish or undo what a run killed amid `publish` left; run.json leaves first and comes
        last.
        """
        if not self._old.is_dir():
            return
        if (self.target / REPORT).exists():
            self._delete_old()
        elif not self.target.exists() or not _is_marked(self._old / LOCK):  # it was renamed whole
            if self.target.exists():  # what stands there now came later
                refuse_foreign(self.target)
                self.target.rmdir()
            os.rename(self._old, self.target)
        else:
            if not (self._old / REPORT).exists():  # the target was empty before
                for name in RESULT_FILES:
                    (self.target / name).unlink(missing_ok=True)
                _discard_fields(self.target / FIELDS_FOLDER)
            if (self._old / FIELDS_FOLDER).is_dir():
                _discard_fields(self.target / FIELDS_FOLDER)
            for entry in self._old.iterdir():
                if entry.name != LOCK:
                    os.replace(entry, self.target / entry.name)
            discard(self._old)

    def _rename_entries(self) -> None:
        begun = self.path / ".old"  # that it is ours must be said before it has its name
        begun.mkdir()
        (begun / LOCK).write_bytes(MARK)
        os.rename(begun, self._old)
        for entry in sorted(self.target.iterdir(), key=lambda entry: entry.name != REPORT):
            if entry.name not in HIDDEN:
                shutil.move(entry, self._old / entry.name)
        for entry in sorted(self.path.iterdir(), key=lambda entry: entry.name == REPORT):
            shutil.move(entry, self.target / entry.name)
        shutil.rmtree(self.path, ignore_errors=True)

    def _delete_old(self) -> None:
        if not self._old.is_dir():
            return
        _discard_fields(self._old / FIELDS_FOLDER)  # what is left of it is not ours
        _move_new(self._old, self.target, guests(self._old))
        if (self._old / FIELDS_FOLDER).is_dir():
            _move_new(
                self._old / FIELDS_FOLDER,
                self.target / FIELDS_FOLDER,
                contents(self._old / FIELDS_FOLDER, ()),
            )
        discard(self._old)


def guests(folder: Path) -> set[str]:
    """The names of what stands in a result folder and is not ours."""
    names = contents(folder, HIDDEN)
    return {
        name
        for name in names
        if name not in RESULT_FILES or (name in SIGNS and not is_own_file(folder / name))
    }


def _move_new(source: Path, target: Path, names: Iterable[str]) -> None:
    """Move entries of a folder into another, but for those whose names it has."""
    for name in names:
        if not os.path.lexists(target / name):
            shutil.move(source / name, target / name)


def refuse_foreign(target: Path, kind: str = "run", written: Iterable[str] = WRITTEN) -> None:
    """UsageError where a run (a study) would take the place of what is not ours."""
    if _is_nothing(target):
        return
    found = held(target)
    if found not in ("nothing", kind):
        said = "is not empty and was not made by" if found == "other" else f"holds a {found} of"
        raise UsageError(f"{target} {said} {PROGRAM}", "choose another --output")
    for path in (target / name for name in written):
        if os.path.lexists(path) and not is_own_file(path):
            problem = f"{path} was not made by {PROGRAM}, and would be replaced"
            raise UsageError(problem, "move it, or choose another --output", str(path))


def asked_from(file: str, folder: Path) -> dict[str, str]:
    """How run.json names the config file of a run: by its path, and as seen from the folder; both
    may move together.
    """
    path = os.path.realpath(file)
    return (
        {"config": path, "config_from_here": os.path.relpath(path, os.path.realpath(folder))}
        if file
        else {}
    )


def is_of_file(theirs: Report, ours: Report, folder: Path) -> bool:
    """Whether two runs are of one config file, by what their run.json say; a run that names no file
    is of any.
    """
    there = theirs.get("asked")
    here = ours.get("asked")
    if not (
        isinstance(there, dict)
        and isinstance(here, dict)
        and "config" in there
        and "config" in here
    ):
        return True
    return any(there.get(name) == path for name, path in asked_from(here["config"], folder).items())


def _is_marked(lock: Path) -> bool:
    with (
        suppress(OSError),
        open(os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file,
    ):
        return stat.S_ISREG(os.fstat(file.fileno()).st_mode) and file.read(len(MARK)) == MARK
    return False


def _mark(descriptor: int) -> None:
    """Say in a lock that it is this program's, with its ballast behind."""
    os.pwrite(descriptor, MARK.ljust(BALLAST, b"\0"), 0)


def contents(path: Path, apart_from: Iterable[str]) -> set[str]:
    """Names in a folder, none when there is no folder; UsageError when it is something else or
    cannot be read.
    """
    try:
        if not path.exists():
            return set()
        if not path.is_dir():
            raise UsageError(f"{path} is not a folder")
        return {entry.name for entry in path.iterdir()} - set(apart_from)
    except OSError as error:
        raise UsageError(
            f"cannot read {path}: {error.strerror or error}", file=str(path)
        ) from error


def _lock(path: Path, target: Path, flags: int = os.O_CREAT) -> int:
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


def _is_same(descriptor: int, path: Path) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    return False
