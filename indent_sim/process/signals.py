"""SIGINT, SIGTERM and SIGHUP as an exception, so that a run keeps what it has and says how it
ended.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stopped(KeyboardInterrupt):
    """SIGINT, SIGTERM or SIGHUP arrived; exit code 128 + signal."""

    def __init__(self, number: int):
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number = number
        self.exit_code = 128 + number

    def __reduce__(self) -> tuple[type[Stopped], tuple[int]]:
        return Stopped, (self.number,)  # other ranks learn of it


# Signals belong to the process, and so do
_arrived: list[int] = []  # those that raised Stopped
_held: list[list[int]] = []  # those that arrived in each of the blocks that hold them back
_stoppable: list[int] = []  # and the ranks of the blocks in which they raise it


def check() -> None:
    """Raise Stopped when a signal has arrived whose exception somebody swallowed; to be called now
    and then.
    """
    if _arrived:
        raise Stopped(_arrived[0])


@contextmanager
def unmasked() -> Iterator[None]:
    """Stopped again, where a library turned what was raised in its callbacks into an error of its
    own.
    """
    try:
        yield
    except Exception:
        check()
        raise


@contextmanager
def stoppable(rank: int = 0) -> Iterator[None]:
    """SIGNALS raise Stopped on rank 0, which keeps what there is and takes the others along.

    A SIGHUP that is ignored stays so: that is what `nohup` asks for.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        if _held:
            _held[-1].append(number)
            return
        _arrived.append(number)
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # who presses Ctrl-C again means it
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # mpirun and batch systems repeat themselves
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        raise Stopped(number)

    def lost(raised: Any) -> None:
        if not isinstance(raised.exc_value, Stopped):  # else `check` will say so
            tell_lost(raised)

    _arrived.clear()
    # of what is raised while a process forks, or in a __del__
    tell_lost = sys.unraisablehook
    sys.unraisablehook = lost
    handler: Any = stop if rank == 0 else signal.SIG_IGN
    wanted = [
        number
        for number in SIGNALS
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
    ]
    before = {number: signal.signal(number, handler) for number in wanted}
    _stoppable.append(rank)
    try:
        with unmasked():
            yield
            check()
    finally:
        _stoppable.pop()
        _arrived.clear()
        sys.unraisablehook = tell_lost
        for number, old in before.items():
            signal.signal(number, old)


def die_with(parent: int) -> None:
    """Ask Linux to kill this forked process when its parent is killed: nobody would read what it
    computes.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        signal.raise_signal(signal.SIGKILL)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back the signals that stop a run until the block is done, so that no file is left half
    written.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    knows = (
        _stoppable and not _arrived
    )  # then what handles them holds them back itself: thousands of rows are quick
    signals = (
        [] if knows else [s for s in SIGNALS if signal.getsignal(s) not in (None, signal.SIG_IGN)]
    )
    before = {
        number: signal.signal(number, lambda got, frame: arrived.append(got)) for number in signals
    }
    _held.append(arrived)
    try:
        yield
    finally:
        _held.pop()
        for number, handler in before.items():
            signal.signal(number, handler)
        for again in arrived[:1]:
            signal.raise_signal(again)
