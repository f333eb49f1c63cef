"""Locks of files, which the operating system releases when a process ends, also if it is killed."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from contextlib import suppress

# Windows neither renames nor deletes a file, or a folder that contains it, while it is open.
OPEN_FILES_CAN_MOVE = sys.platform != "win32"


def lock_file(descriptor: int, *, shared: bool = False, wait: bool = False) -> None:
    """Lock an open file until its descriptor is closed.

    Some file systems, and Python in a browser, have no locks; the function then does nothing.

    Parameters
    ----------
    descriptor
        Descriptor of the file, opened for reading and writing.
    shared
        Allow other processes to hold shared locks at the same time; otherwise no other process can
        lock the file.
    wait
        Wait while another process has locked the file.

    Raises
    ------
    BlockingIOError
        If another process has locked the file, and `wait` is false.
    """
    try:
        _system_lock(descriptor, shared, wait)
    except BlockingIOError:
        raise
    except (ImportError, OSError):
        pass


def release_lock(descriptor: int, delete: Callable[[], object]) -> None:
    """Close a locked file, and call the function that deletes it while it is still locked.

    Where open files cannot be deleted, it is deleted after it has been closed. A file that cannot
    be deleted remains.
    """
    if not OPEN_FILES_CAN_MOVE:
        os.close(descriptor)
    with suppress(OSError):
        delete()
    if OPEN_FILES_CAN_MOVE:
        os.close(descriptor)


if sys.platform == "win32":

    class _Overlapped(ctypes.Structure):
        """OVERLAPPED of the Windows API: the offset of the locked byte."""

        _fields_ = (
            ("Internal", ctypes.c_void_p),
            ("InternalHigh", ctypes.c_void_p),
            ("Offset", ctypes.c_uint32),
            ("OffsetHigh", ctypes.c_uint32),
            ("hEvent", ctypes.c_void_p),
        )

    def _system_lock(descriptor: int, shared: bool, wait: bool) -> None:
        """Lock one byte far beyond the end of the file, so that the file can still be read."""
        import msvcrt

        error_lock_violation = 33
        fail_immediately = 1
        exclusive_lock = 2
        flags = (0 if shared else exclusive_lock) | (0 if wait else fail_immediately)
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        handle = ctypes.c_void_p(msvcrt.get_osfhandle(descriptor))
        place = ctypes.byref(_Overlapped(OffsetHigh=2**30))
        if not kernel.LockFileEx(handle, flags, 0, 1, 0, place):
            code = ctypes.get_last_error()
            if code == error_lock_violation:
                raise BlockingIOError(code, "the file is locked")
            raise ctypes.WinError(code)

else:

    def _system_lock(descriptor: int, shared: bool, wait: bool) -> None:
        """Lock the whole file by flock."""
        import fcntl

        mode = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        fcntl.flock(descriptor, mode if wait else mode | fcntl.LOCK_NB)
