"""Transfer of objects between processes: by a pipe, and large arrays by a mapped temporary file.

The pages of a mapped file are read when they are used and can be released again, so an array may be
larger than the memory of the process. The file has no name: the system removes it even if a process
is killed.
"""

from __future__ import annotations

import os
import pickle
from itertools import accumulate, pairwise
from mmap import ACCESS_READ, mmap
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from tempfile import TemporaryFile, gettempdir
from typing import Any

# Every array in the file begins at a multiple of so many bytes.
BUFFER_ALIGNMENT = 64


def send(pipe: Connection, value: Any, mapped: bool = False) -> None:
    """Send an object that can be pickled.

    Parameters
    ----------
    pipe
        One end of a pipe.
    value
        The object.
    mapped
        Send its arrays by a file in TMPDIR.

    Raises
    ------
    OSError
        If there is no space for the file; the pipe stays as it was.
    ConnectionError
        If the other end of the pipe is closed.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append if mapped else None)
    sizes = [buffer.raw().nbytes for buffer in buffers]
    if not any(sizes):
        pipe.send(sizes)
        pipe.send_bytes(pickled)
        return
    with TemporaryFile() as file:
        try:
            for buffer, size in zip(buffers, sizes, strict=True):
                file.write(buffer.raw())
                file.write(bytes(-size % BUFFER_ALIGNMENT))
            file.flush()
        except OSError as error:
            raise OSError(error.errno, error.strerror, gettempdir()) from error
        pipe.send(sizes)
        pipe.send_bytes(pickled)
        send_handle(pipe, file.fileno(), None)


def receive(pipe: Connection) -> Any:
    """Receive an object; its mapped arrays are read-only.

    Raises EOFError or ConnectionError if the other end of the pipe is closed.
    """
    sizes = pipe.recv()
    pickled = pipe.recv_bytes()
    return pickle.loads(
        pickled, buffers=_map_buffers(recv_handle(pipe), sizes) if any(sizes) else sizes
    )


def _map_buffers(file: int, sizes: list[int]) -> list[memoryview]:
    """The buffers of the given sizes [bytes] in a mapped file, which is closed."""
    try:
        file_view = memoryview(mmap(file, 0, access=ACCESS_READ))
    finally:
        os.close(file)
    offsets = accumulate((size + -size % BUFFER_ALIGNMENT for size in sizes), initial=0)
    return [
        file_view[begin : begin + size]
        for (begin, _), size in zip(pairwise(offsets), sizes, strict=True)
    ]
