"""Opening of regular files only: not of pipes, whose reading may never end, nor of links."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

# Characters that the name of a file cannot contain.
FORBIDDEN_IN_NAMES = '/<>:"\\|?*' if os.name == "nt" else "/"
# Flags of os.open that some systems do not have; there they are 0. With O_NONBLOCK a pipe is opened
# without waiting for its other end.
_NO_WAIT: int = getattr(os, "O_NONBLOCK", 0)
_NO_LINK: int = getattr(os, "O_NOFOLLOW", 0)
# Windows changes line ends of files that are not opened as binary ones.
_BINARY: int = getattr(os, "O_BINARY", 0)


def open_descriptor(path: Path, flags: int, mode: int = 0o644) -> int:
    """Open a file that is not a link, with flags of os.open, and return its descriptor."""
    if not _NO_LINK and os.path.islink(path):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    return os.open(path, flags | _NO_WAIT | _NO_LINK | _BINARY, mode)


def refuse_irregular(descriptor: int, path: str | Path) -> None:
    """Raise OSError, and close the descriptor, if it does not refer to a regular file."""
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind):
        return
    os.close(descriptor)
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "not a regular file", str(path))


def open_regular_file(path: str | Path, *, links: bool = True) -> BinaryIO:
    """Open a regular file for reading; raise OSError for a pipe, a device or a folder.

    Reading from these might never end. A link is opened unless `links` is false.
    """
    descriptor = (
        os.open(path, os.O_RDONLY | _NO_WAIT | _BINARY)
        if links
        else open_descriptor(Path(path), os.O_RDONLY)
    )
    refuse_irregular(descriptor, path)
    return os.fdopen(descriptor, "rb")


def write_at(descriptor: int, data: bytes | memoryview, position: int) -> int:
    """Write bytes at a position of an open file, and return how many were written."""
    os.lseek(descriptor, position, os.SEEK_SET)
    return os.write(descriptor, data)
