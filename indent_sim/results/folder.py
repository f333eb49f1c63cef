"""Result folder: the claim to write it, its lock, and how a new one takes the place of an old one.

A run writes into a hidden staging folder beside its target and becomes the target by renaming, so that
readers see the old folder or the new one, never half of one. `.lock` inside the folder is held while the run
lives (the kernel lets go of it when the run is killed) and moves with the rename.

A folder is this program's when its run.json or its `.lock` says so; whatever says nothing of the kind is never moved,
written or deleted, wherever it stands and whatever it is called. Links are not followed when writing.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError

PROGRAM = "indent-sim"
LOCK = ".lock"
HIDDEN = {LOCK, ".staging", ".old"}
REPORT, TABLE, CONFIG = "run.json", "force_indentation.csv", "config.yaml"
MESH = "body.msh"  # the mesh of a body that came from a file
FILES = {REPORT, TABLE, CONFIG, MESH, "surface.csv", "experiment.csv", "dynamic.csv", "fields.xdmf", "tip.xdmf",
         "force_indentation.png", "experiment.png", "report.html", "checkpoint.h5",
         "fields.h5"}  # the last one of version 0.1.0  # fmt: skip
FIELDS = "fields"  # a folder inside, and what in it is ours, finished or not
FIELD_FILE = re.compile(r"(mesh|step-\d+)\.h5|\.(mesh|step-\d+)\.h5\.new")
MARK = b"indent-sim\n"  # how a lock begins that this program made
MOST_BYTES = 10**9  # of a file that is read back
BALLAST = 64 * 1024  # bytes in the lock file, given back on a full disk so that run.json can say so


def write_atomically(path: Path, content: str | bytes | Iterable[str], sync: bool = True) -> None:
    """Replace a file by new content, which may come in parts, at once: a reader or a kill sees the old file or the new
    one."""
    parts: Iterable[str | bytes] = [content] if isinstance(content, str | bytes) else content
    temporary = _temporary(path)
    try:
        temporary.unlink(missing_ok=True)  # of a write that was killed, or a link to somewhere else
        with open(temporary, "xb") as file:
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


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def append_whole(path: Path, data: bytes, sync: bool = True, tail: bytes = b"") -> None:
    """Append in one write, or not at all: what a full disk cut off is taken back. The file ends in `tail`, still."""
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
    """The bytes of a regular file; OSError when it is something else, which might never end, or longer than 1 GB."""
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data


def read_report(folder: Path) -> dict[str, Any]:
    """The run.json of a folder as it stands; empty when there is none or it is not this program's."""
    try:
        report = json.loads(content(folder / REPORT))
    except (OSError, ValueError, RecursionError):
        return {}
    return report if isinstance(report, dict) and report.get("program") == PROGRAM else {}


def is_ours(folder: Path) -> bool:
    """Whether this program made a folder: its lock or its run.json says so."""
    return folder.is_dir() and not folder.is_symlink() and (_is_marked(folder / LOCK) or bool(read_report(folder)))


def discard(folder: Path) -> None:
    """Delete this program's files in a folder of its own, what says so last; the folder too when nothing is left."""
    for name in (".staging", ".old"):
        if is_ours(folder / name):
            discard(folder / name)
    _discard_fields(folder / FIELDS)
    names = sorted(FILES, key=lambda name: name == REPORT)
    for path in [folder / name for name in names] + [_temporary(folder / name) for name in names] + [folder / LOCK]:
        if path.is_symlink() or path.is_file():
            path.unlink()
    with suppress(OSError):
        folder.rmdir()


def field_files(fields: Path) -> list[Path]:
    """This program's files in a folder of fields, none where that is a link or no folder."""
    if fields.is_symlink() or not fields.is_dir():
        return []
    return [path for path in fields.iterdir() if FIELD_FILE.fullmatch(path.name)]


def _discard_fields(fields: Path) -> None:
    """Delete this program's files in a folder of fields, and the folder when nothing else is in it; a link alone."""
    for path in [*field_files(fields), *([fields] if fields.is_symlink() else [])]:
        if path.is_symlink() or path.is_file():
            path.unlink()
    with suppress(OSError):
        fields.rmdir()


def refuse_links(folder: Path) -> None:
    """UsageError when one of the files that a run would go on writing is a link, or no file: it may be anything."""
    fields = folder / FIELDS
    if os.path.lexists(fields) and (fields.is_symlink() or not fields.is_dir()):
        raise UsageError(f"{fields} is a link, or no folder: nothing is written through it")
    for path in [*(folder / name for name in sorted(FILES | {LOCK})), *field_files(fields)]:
        with suppress(FileNotFoundError):
            found = path.lstat()
            if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
                raise UsageError(f"{path} is a link, or no file: nothing is written through it")


def has_rows(folder: Path) -> bool:
    """Whether the folder's force table holds at least one complete row."""
    try:
        return content(folder / TABLE).count(b"\n") > 1
    except OSError:
        return False


class Claim:
    """The right to write one result folder: a locked staging folder that becomes the target.

    Raises UsageError, and leaves nothing behind, when the target is foreign, unwritable or in use.
    """

    def __init__(self, target: Path):
        self._parents: list[Path] = []
        self._lock = -1
        self.published = False
        try:
            self._choose_places(target)
            self._refuse_in_the_way()
            self._refuse()
            self._make_parents(self.target.parent)
            self._stage()
            self._recover()
            self._refuse()
        except (OSError, UsageError) as error:
            self.drop()
            if isinstance(error, UsageError):
                raise
            raise UsageError(f"cannot write {target}: {error.strerror or error}") from error
        self.replaces_results = has_rows(self.target)

    def _choose_places(self, target: Path) -> None:
        self.target = _real(target)
        parent = self.target.parent
        beside = not self.target.is_dir() or os.access(parent, os.W_OK | os.X_OK)
        self.path = parent / f".{self.target.name}.staging" if beside else self.target / ".staging"
        self._old = parent / f".{self.target.name}.old" if beside else self.target / ".old"

    def adopt(self) -> None:
        """Go on in the target itself, with the run that is there, in place of a staging folder."""
        refuse_links(self.target)
        try:
            descriptor = _lock(self.target / LOCK)
            if descriptor is None:
                raise UsageError(f"{self.target} is in use by another run")
            _mark(descriptor)
            for name in FILES:  # of a write that was killed
                _temporary(self.target / name).unlink(missing_ok=True)
            for path in field_files(self.target / FIELDS):
                if path.name.startswith("."):
                    path.unlink()
        except OSError as error:
            raise UsageError(f"cannot write {self.target}: {error.strerror or error}") from error
        staging, held = self.path, self._lock
        self.path, self._lock, self.published = self.target, descriptor, True
        shutil.rmtree(staging, ignore_errors=True)
        os.close(held)

    def publish(self) -> None:
        """Give the staging folder its target's name; an old folder goes, but files that are not ours stay."""
        self._refuse()
        if self._old.parent != self.target and not _is_working_directory(self.target):
            try:
                self._rename_folder()
            except OSError as error:
                if error.errno not in (errno.EBUSY, errno.EXDEV):
                    raise
                self._rename_entries()  # a mounted folder cannot be renamed
        else:
            self._rename_entries()
        self.path, self.published = self.target, True
        self._parents.clear()
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
        if not os.access(folder, os.W_OK | os.X_OK) and not self.target.is_dir():
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
        for folder in reversed(missing):
            folder.mkdir()
            self._parents.append(folder)

    def _stage(self) -> None:
        for _ in range(20):  # another run may publish or clean up between two of these lines
            with suppress(FileExistsError):
                self.path.mkdir()
            try:
                descriptor = _lock(self.path / LOCK)
            except FileNotFoundError:
                continue
            if descriptor is None:
                raise UsageError(f"{self.target} is in use by another run")
            if _is_same(descriptor, self.path / LOCK):
                break
            os.close(descriptor)
        else:
            raise UsageError(f"{self.target} is in use by another run")
        self._lock = descriptor
        for entry in self.path.iterdir():  # of a killed run
            if entry.name != LOCK:
                _delete(entry)
        _mark(descriptor)

    def _refuse_in_the_way(self) -> None:
        """Nobody else's folder is used, whatever it is called."""
        for path in (self.path, self._old):
            if os.path.lexists(path) and not (is_ours(path) or (path == self.path and _is_unused(path))):
                raise UsageError(f"{path} is in the way and was not made by {PROGRAM}; choose another --output")

    def _refuse(self) -> None:
        if not self._old.is_dir():  # else a run was killed while it took the place of an old one
            _refuse_foreign(self.target)
        _refuse_locked(self.target)

    def _recover(self) -> None:
        """Finish or undo what a run killed amid `publish` left; run.json leaves first and comes last."""
        if not self._old.is_dir():
            return
        if (self.target / REPORT).exists():
            self._delete_old()
        elif not self.target.exists():
            os.rename(self._old, self.target)
        elif not _is_marked(self._old / LOCK):  # it was renamed whole: what stands there now came later
            _refuse_foreign(self.target)
            self.target.rmdir()
            os.rename(self._old, self.target)
        else:
            if not (self._old / REPORT).exists():  # the target was empty before
                for name in FILES:
                    (self.target / name).unlink(missing_ok=True)
                _discard_fields(self.target / FIELDS)
            if (self._old / FIELDS).is_dir():
                _discard_fields(self.target / FIELDS)
            for entry in self._old.iterdir():
                if entry.name != LOCK:
                    os.replace(entry, self.target / entry.name)
            discard(self._old)

    def _rename_folder(self) -> None:
        if self.target.is_dir() and any(self.target.iterdir()):
            os.rename(self.target, self._old)
        os.rename(self.path, self.target)

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
        _discard_fields(self._old / FIELDS)  # what is left of it is not ours
        _move_new(self._old, self.target, FILES | HIDDEN)
        if (self._old / FIELDS).is_dir():
            _move_new(self._old / FIELDS, self.target / FIELDS, ())
        discard(self._old)


def _move_new(source: Path, target: Path, apart_from: Collection[str]) -> None:
    """Move the entries of a folder into another that has none of their names."""
    for entry in source.iterdir():
        if entry.name not in apart_from and not os.path.lexists(target / entry.name):
            shutil.move(entry, target / entry.name)


def _real(target: Path) -> Path:
    if target.is_symlink() and not target.exists():
        raise UsageError(f"{target} is a link to nothing")
    return Path(os.path.realpath(target))


def _refuse_foreign(target: Path) -> None:
    hidden = {name for name in HIDDEN if is_ours(target / name) or _is_marked(target / name)}
    if contents(target, hidden) and not read_report(target) and not _is_unused(target):
        raise UsageError(f"{target} is not empty and was not made by {PROGRAM}; choose another --output")


def _is_unused(folder: Path) -> bool:
    """Whether a folder holds at most a lock in which nothing is written yet, as a run killed right then leaves it."""
    names = contents(folder, ()) if not folder.is_symlink() else {""}
    return not names or (names == {LOCK} and (folder / LOCK).is_file() and (folder / LOCK).stat().st_size == 0)


def _is_marked(lock: Path) -> bool:
    """Whether a lock was made by this program."""
    try:
        found = lock.lstat()
        with open(os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            return stat.S_ISREG(found.st_mode) and file.read(len(MARK)) == MARK
    except OSError:
        return False


def _mark(descriptor: int) -> None:
    """Say in a lock that it is this program's, with its ballast behind."""
    os.pwrite(descriptor, MARK.ljust(BALLAST, b"\0"), 0)


def contents(path: Path, apart_from: Iterable[str]) -> set[str]:
    """Names in a folder, none when there is no folder; UsageError when it is something else or cannot be read."""
    try:
        if not path.exists():
            return set()
        if not path.is_dir():
            raise UsageError(f"{path} is not a folder")
        return {entry.name for entry in path.iterdir()} - set(apart_from)
    except OSError as error:
        raise UsageError(f"cannot use {path}: {error.strerror or error}") from error


def _refuse_locked(folder: Path) -> None:
    try:
        descriptor = _lock(folder / LOCK, 0)
    except OSError:
        return  # no lock, or not ours to open
    if descriptor is None:
        raise UsageError(f"{folder} is in use by another run")
    os.close(descriptor)


def _lock(path: Path, flags: int = os.O_CREAT) -> int | None:
    """An open, locked file; None when another process holds it."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | flags, 0o644)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError:
        pass  # a file system without locks: go on without
    return descriptor


def _is_same(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _is_working_directory(folder: Path) -> bool:
    """Renaming a folder under somebody's feet would leave them in a deleted one."""
    here = Path.cwd()
    return folder == here or folder in here.parents


def _delete(entry: Path) -> None:
    if entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry, ignore_errors=True)
    else:
        entry.unlink()
