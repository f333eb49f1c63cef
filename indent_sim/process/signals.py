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

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(KeyboardInterrupt):
    """SIGINT, SIGTERM or SIGHUP arrived; exit code 128 + signal."""

    def __init__(self, number: int):
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number = number
        self.exit_code = 128 + number

    def __reduce__(self) -> tuple[type[Interrupted], tuple[int]]:
        return Interrupted, (self.number,)  # other ranks learn of it


# Signals belong to the process, and so do
_raised_signals: list[int] = []  # those that raised Stopped
_deferred_signals: list[
    list[int]
] = []  # those that arrived in each of the blocks that hold them back
_interruptible_ranks: list[int] = []  # and the ranks of the blocks in which they raise it


def raise_pending_signal() -> None:
    """Raise Stopped when a signal has arrived whose exception somebody swallowed; to be called now
    and then.
    """
    if _raised_signals:
        raise Interrupted(_raised_signals[0])


@contextmanager
def reraise_signal() -> Iterator[None]:
    """Stopped again, where a library turned what was raised in its callbacks into an error of its
    own.
    """
    try:
        yield
    except Exception:
        raise_pending_signal()
        raise


@contextmanager
def raise_on_signals(rank: int = 0) -> Iterator[None]:
    """SIGNALS raise Stopped on rank 0, which keeps what there is and takes the others along.

    A SIGHUP that is ignored stays so: that is what `nohup` asks for.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        if _deferred_signals:
            _deferred_signals[-1].append(number)
            return
        _raised_signals.append(number)
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # who presses Ctrl-C again means it
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # mpirun and batch systems repeat themselves
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        raise Interrupted(number)

    def lost(raised: Any) -> None:
        if not isinstance(raised.exc_value, Interrupted):  # else `check` will say so
            old_hook(raised)

    _raised_signals.clear()
    # of what is raised while a process forks, or in a __del__
    old_hook = sys.unraisablehook
    sys.unraisablehook = lost
    handler: Any = stop if rank == 0 else signal.SIG_IGN
    handled_signals = [
        number
        for number in STOP_SIGNALS
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
    ]
    old_handlers = {number: signal.signal(number, handler) for number in handled_signals}
    _interruptible_ranks.append(rank)
    try:
        with reraise_signal():
            yield
            raise_pending_signal()
    finally:
        _interruptible_ranks.pop()
        _raised_signals.clear()
        sys.unraisablehook = old_hook
        for number, old in old_handlers.items():
            signal.signal(number, old)


def die_with_parent(parent: int) -> None:
    """Ask Linux to kill this forked process when its parent is killed: nobody would read what it
    computes.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        signal.raise_signal(signal.SIGKILL)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Hold back the signals that stop a run until the block is done, so that no file is left half
    written.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    handler_defers = (
        _interruptible_ranks and not _raised_signals
    )  # then what handles them holds them back itself: thousands of rows are quick
    signals = (
        []
        if handler_defers
        else [s for s in STOP_SIGNALS if signal.getsignal(s) not in (None, signal.SIG_IGN)]
    )
    old_handlers = {
        number: signal.signal(number, lambda got, frame: arrived.append(got)) for number in signals
    }
    _deferred_signals.append(arrived)
    try:
        yield
    finally:
        _deferred_signals.pop()
        for number, handler in old_handlers.items():
            signal.signal(number, handler)
        for first_signal in arrived[:1]:
            signal.raise_signal(first_signal)
