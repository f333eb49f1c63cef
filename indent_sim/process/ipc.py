"""An object on its way from one process to another through a pipe; large arrays by a temporary
file, which the other maps.

What is mapped lies in the file until it is looked at, and its pages go back when the memory is
wanted: an array may be larger than what a process has room for. The file has no name, so nothing is
left of it whenever a process is killed.
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

BUFFER_ALIGNMENT = 64  # bytes from one array's begin to the next are a multiple of these


def send(pipe: Connection, value: Any, mapped: bool = False) -> None:
    """Send an object, its arrays by a file in TMPDIR where they are `mapped`; OSError where that
    has no room.
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
    """The object that was sent; arrays that are mapped cannot be written to.

    EOFError where the other end closed.
    """
    sizes = pipe.recv()
    pickled = pipe.recv_bytes()
    return pickle.loads(
        pickled, buffers=_map_buffers(recv_handle(pipe), sizes) if any(sizes) else sizes
    )


def _map_buffers(file: int, sizes: list[int]) -> list[memoryview]:
    try:
        file_view = memoryview(mmap(file, 0, access=ACCESS_READ))
    finally:
        os.close(file)
    offsets = accumulate((size + -size % BUFFER_ALIGNMENT for size in sizes), initial=0)
    return [
        file_view[begin : begin + size]
        for (begin, _), size in zip(pairwise(offsets), sizes, strict=True)
    ]
