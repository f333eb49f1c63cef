"""Atomic writing of files: no reader ever sees a partial change, even after a kill."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from indent_sim.process.regular_files import open_descriptor, open_regular_file, write_at


def write_atomically(path: Path, content: str | bytes | Iterable[str], sync: bool = True) -> None:
    """Replace a file atomically, so that it has either the old or the new content at any time.

    Parameters
    ----------
    path
        The file.
    content
        Bytes, text, or parts of a text.
    sync
        Wait until the content is on the disk.
    """
    parts: Iterable[str | bytes] = [content] if isinstance(content, str | bytes) else content
    temporary = temporary_path(path)
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
    """Open a new file for writing; a link or the incomplete file of a killed run is replaced."""
    for _ in range(2):
        with suppress(FileExistsError):
            return open_descriptor(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        path.unlink(missing_ok=True)
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def temporary_path(path: Path) -> Path:
    """Return the temporary path, in the same folder, for the new content of a file."""
    return path.with_name(f".{path.name}.new")


def overwrite_in_place(path: Path, content: bytes) -> None:
    """Overwrite a file without using additional space on the disk.

    Blanks fill the file up to its present length. Raises OSError if the content is longer.
    """
    with open(path, "r+b", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        if len(content) > size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        file.write(content.ljust(size))


def sync_to_disk(path: Path) -> None:
    """Flush a file to the disk (fsync)."""
    # Windows flushes only files that are open for writing.
    descriptor = open_descriptor(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def append_atomically(path: Path, data: bytes, sync: bool = True, tail: bytes = b"") -> None:
    """Append to a file in one write, which is undone if the disk is full.

    Parameters
    ----------
    path
        The file; it is created if it does not exist.
    data
        Bytes to add.
    sync
        Wait until the bytes are on the disk.
    tail
        Bytes at the end of the file, which also stay at its end; `data` is inserted before them.
    """
    descriptor = open_descriptor(path, os.O_WRONLY | os.O_CREAT, 0o666)
    try:
        size = os.fstat(descriptor).st_size
        try:
            if write_at(descriptor, data + tail, size - len(tail)) != len(data + tail):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        except OSError:
            write_at(descriptor, tail, size - len(tail))
            os.ftruncate(descriptor, size)
            raise
        if sync:
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def read_regular_file(path: Path) -> bytes:
    """Return the bytes of a regular file of at most 1 GB, otherwise raise OSError.

    Reading from a pipe or a device might never end.
    """
    # A longer file is not read: it would fill the memory.
    max_bytes = 10**9
    with open_regular_file(path) as file:
        data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data
