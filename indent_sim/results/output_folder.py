"""Output folder of a run: its lock, and how it replaces an older result folder.

A run writes into a hidden staging folder beside its target. The staging folder is then renamed to
the target, so that readers see either the old or the complete new folder. The file `.lock` inside
the folder is locked during the run (the kernel releases the lock if the run is killed).
`result_files` decides which files belong to this program.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from indent_sim.process.errors import IndentSimError, UsageError
from indent_sim.process.file_locks import OPEN_FILES_CAN_MOVE, lock_file, release_lock
from indent_sim.process.limits import write_error
from indent_sim.process.regular_files import open_descriptor, refuse_irregular, write_at
from indent_sim.results.atomic_files import temporary_path
from indent_sim.results.result_files import (
    FIELDS_FOLDER,
    HIDDEN_NAMES,
    LOCK,
    LOCK_SIGNATURE,
    PROGRAM,
    REPORT,
    RESULT_FILES,
    delete_own_fields,
    delete_own_files,
    entry_names,
    field_files,
    folder_kind,
    foreign_files,
    has_rows,
    is_own_folder,
    is_own_lock,
    refuse_foreign,
    refuse_links,
)


class OutputFolder:
    """Exclusive right to write one result folder: a locked staging folder that becomes the target.

    Parameters
    ----------
    target
        The result folder.
    may_replace
        Function that is called with an existing folder and raises UsageError if it must not be
        replaced. By default every folder of this program may be replaced.

    Raises
    ------
    UsageError
        If the target was not made by this program, cannot be written, is in use, or must not be
        replaced. No files are left behind.
    """

    def __init__(self, target: Path, may_replace: Callable[[Path], None] = lambda folder: None):
        self._check_replaceable = may_replace
        self._lock_descriptor = -1
        self.is_in_place = False
        self._created_parents: list[Path] = []
        try:
            if target.is_symlink() and not target.exists():
                raise UsageError(f"{target} is a broken link")
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
        """Continue the run in the target folder itself, without a staging folder."""
        refuse_links(self.target)
        try:
            descriptor = _open_locked(self.target / LOCK, self.target)
            _sign_lock(descriptor)
            # A run that was killed while it wrote may have left a temporary file.
            for name in RESULT_FILES:
                temporary_path(self.target / name).unlink(missing_ok=True)
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
        release_lock(old_lock, lambda: shutil.rmtree(staging, ignore_errors=True))

    def rename_into_place(self) -> None:
        """Rename the staging folder to the target, and keep foreign files of an old folder."""
        self._refuse_target()
        if not OPEN_FILES_CAN_MOVE:
            self._close_lock()
            # Such a system cannot rename a folder to the name of an existing folder, even an empty
            # one.
            with suppress(OSError):
                self.target.rmdir()
        # The working directory and its parents must not be renamed and deleted.
        if self._old_folder.parent != self.target and self.target not in (
            working_directory := Path.cwd(),
            *working_directory.parents,
        ):
            try:
                if self.target.is_dir() and any(self.target.iterdir()):
                    os.rename(self.target, self._old_folder)
                os.rename(self.path, self.target)
            except OSError as error:
                if error.errno not in (errno.EBUSY, errno.EXDEV, errno.EPERM, errno.EACCES):
                    raise
                # A mount point cannot be renamed, nor a folder of another user in /tmp.
                self._rename_entries()
        else:
            self._rename_entries()
        self.path = self.target
        self.is_in_place = True
        self._created_parents = []
        if self._lock_descriptor < 0:
            self._lock_descriptor = _open_locked(self.path / LOCK, self.target)
        self._delete_old()

    def abandon(self) -> None:
        """Release the folder and restore its state before the run."""
        if not self.is_in_place and self._lock_descriptor >= 0:
            staging = self.path
            release_lock(self._lock_descriptor, lambda: shutil.rmtree(staging, ignore_errors=True))
            self._lock_descriptor = -1
        self.release_lock()
        for folder in reversed(self._created_parents):
            with suppress(OSError):
                folder.rmdir()
        self._created_parents.clear()

    def release_lock(self) -> None:
        """Release the lock; the written files stay."""
        if self._lock_descriptor < 0:
            return
        if _is_same_file(self._lock_descriptor, self.path / LOCK):
            release_lock(self._lock_descriptor, (self.path / LOCK).unlink)
            self._lock_descriptor = -1
        self._close_lock()

    def _close_lock(self) -> None:
        """Close the lock file, which ends the lock."""
        if self._lock_descriptor >= 0:
            os.close(self._lock_descriptor)
            self._lock_descriptor = -1

    def _make_parents(self, folder: Path) -> None:
        """Create the missing parents of the target, and check that its folder can be written."""
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
        """Create and lock the staging folder; delete the files that a killed run has left in it."""
        # Another run may rename or delete the folder between two of these steps; they are then
        # repeated.
        for _ in range(20):
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
        # Other entries were left by a killed run.
        for entry in [entry for entry in self.path.iterdir() if entry.name != LOCK]:
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink()
        _sign_lock(descriptor)

    def _refuse_occupied_names(self) -> None:
        """Raise UsageError if another program's file has the name of a temporary folder."""
        for path in (self.path, self._old_folder):
            unused = path == self.path and not path.is_symlink() and folder_kind(path) == "nothing"
            if os.path.lexists(path) and not (is_own_folder(path) or unused):
                raise UsageError(
                    f"{path} is the place of a temporary folder, but it exists and was not made "
                    f"by {PROGRAM}; choose another --output"
                )

    def _refuse_target(self) -> None:
        """Raise UsageError if the target is foreign, in use, or not to be replaced."""
        # If the old folder still exists, a run was killed while it replaced the target, which may
        # then contain files of both runs.
        if not self._old_folder.is_dir():
            refuse_foreign(self.target)
            self._check_replaceable(self.target)
        # No process holds a lock if there is no lock file, or if it must not be opened.
        with suppress(OSError):
            os.close(_open_locked(self.target / LOCK, self.target, 0))

    def _recover_interrupted_rename(self) -> None:
        """Finish or undo a replacement during which a run was killed.

        run.json is moved out of the target first and into it last, so that its location shows the
        progress of the replacement.
        """
        if not self._old_folder.is_dir():
            return
        if (self.target / REPORT).exists():
            self._delete_old()
        # The old folder still has its own lock unless the entries were moved one by one.
        elif not self.target.exists() or not is_own_lock(self._old_folder / LOCK):
            if self.target.exists():  # Since then an empty folder was created at the target.
                refuse_foreign(self.target)
                self.target.rmdir()
            os.rename(self._old_folder, self.target)
        else:
            # If there is no old run.json, the target was empty and its entries are of the new run.
            if not (self._old_folder / REPORT).exists():
                for name in RESULT_FILES:
                    (self.target / name).unlink(missing_ok=True)
                delete_own_fields(self.target / FIELDS_FOLDER)
            if (self._old_folder / FIELDS_FOLDER).is_dir():
                delete_own_fields(self.target / FIELDS_FOLDER)
            for entry in self._old_folder.iterdir():
                if entry.name != LOCK:
                    os.replace(entry, self.target / entry.name)
            delete_own_files(self._old_folder)

    def _rename_entries(self) -> None:
        """Replace the target's entries one by one, if the folder itself cannot be renamed."""
        # The folder gets its lock, which marks it as one of this program, before it gets its name.
        new_old_folder = self.path / ".old"
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
        """Delete the replaced folder, after moving its foreign entries to the target."""
        if not self._old_folder.is_dir():
            return
        delete_own_fields(self._old_folder / FIELDS_FOLDER)  # Only foreign files remain in it.
        _move_missing(self._old_folder, self.target, foreign_files(self._old_folder))
        if (self._old_folder / FIELDS_FOLDER).is_dir():
            _move_missing(
                self._old_folder / FIELDS_FOLDER,
                self.target / FIELDS_FOLDER,
                entry_names(self._old_folder / FIELDS_FOLDER, ()),
            )
        delete_own_files(self._old_folder)


def _move_missing(source: Path, target: Path, names: Iterable[str]) -> None:
    """Move entries of a folder into another one, except those whose names exist there."""
    for name in names:
        if not os.path.lexists(target / name):
            shutil.move(source / name, target / name)


def _sign_lock(descriptor: int) -> None:
    """Write the signature into a lock file, which marks its folder as one of this program."""
    write_at(descriptor, LOCK_SIGNATURE, 0)


def _open_locked(path: Path, target: Path, flags: int = os.O_CREAT) -> int:
    """Open and lock a file; raise UsageError if another process has locked it."""
    descriptor = open_descriptor(path, os.O_RDWR | flags)
    refuse_irregular(descriptor, path)
    try:
        lock_file(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        raise UsageError(f"{target} is in use by another run") from None
    return descriptor


def _is_same_file(descriptor: int, path: Path) -> bool:
    """Return whether an open file is still the file at this path."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    return False
