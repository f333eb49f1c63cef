"""Signals that stop a run, as an exception, so that an interrupted run keeps its results."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


def _known_signals(*names: str) -> tuple[signal.Signals, ...]:
    """Return the named signals that exist on this system."""
    return tuple(signal.Signals[name] for name in names if name in signal.Signals.__members__)


# Windows has no SIGHUP, and sends SIGBREAK when the window of a console is closed.
STOP_SIGNALS = _known_signals("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
# If one of these signals has ended a process, it was stopped from outside, or used too much time or
# memory.
MACHINE_SIGNALS = _known_signals("SIGHUP", "SIGINT", "SIGBUS", "SIGKILL", "SIGTERM", "SIGXCPU")


class Interrupted(KeyboardInterrupt):
    """A signal of STOP_SIGNALS was received; the exit code is 128 + the number of the signal."""

    def __init__(self, number: int):
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number = number
        self.exit_code = 128 + number

    def __reduce__(self) -> tuple[type[Interrupted], tuple[int]]:
        # The exception is pickled to tell other ranks.
        return Interrupted, (self.number,)


# Signals belong to the whole process, and so does this state: the signals that raised Interrupted
# in the outermost block of `raise_on_signals`.
_raised_signals: list[int] = []
# Signals that arrived in each of the nested blocks of `defer_signals`.
_deferred_signals: list[list[int]] = []
# Ranks of the nested blocks of `raise_on_signals`.
_interruptible_ranks: list[int] = []


def raise_pending_signal() -> None:
    """Raise Interrupted if a library has suppressed the exception of a signal.

    Long calculations call this function between their steps.
    """
    if _raised_signals:
        raise Interrupted(_raised_signals[0])


@contextmanager
def reraise_signal() -> Iterator[None]:
    """Context manager that raises Interrupted if a library has replaced it by its own error.

    PETSc, for example, raises its own error if a callback has raised an exception.
    """
    try:
        yield
    except Exception:
        raise_pending_signal()
        raise


@contextmanager
def raise_on_signals(rank: int = 0) -> Iterator[None]:
    """Context manager in which a signal of STOP_SIGNALS raises Interrupted.

    Only rank 0 is interrupted; it writes its results and ends the other ranks, which ignore the
    signals. An ignored SIGHUP stays ignored, as `nohup` requires.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        """Raise Interrupted, unless signals are deferred."""
        if _deferred_signals:
            _deferred_signals[-1].append(number)
            return
        _raised_signals.append(number)
        # A second Ctrl-C ends the process at once, while mpirun and batch systems repeat SIGTERM
        # without such an intention.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        for repeated in STOP_SIGNALS[1:]:
            signal.signal(repeated, signal.SIG_IGN)
        raise Interrupted(number)

    def report_unraisable(unraisable: Any) -> None:
        """Report an exception that Python cannot raise, unless it is Interrupted.

        Interrupted is raised later by `raise_pending_signal`.
        """
        if not isinstance(unraisable.exc_value, Interrupted):
            old_hook(unraisable)

    _raised_signals.clear()
    # Python cannot raise an exception that occurs in a __del__.
    old_hook = sys.unraisablehook
    sys.unraisablehook = report_unraisable
    handler: Any = interrupt if rank == 0 else signal.SIG_IGN
    handled_signals = [
        number
        for number in STOP_SIGNALS
        if number.name != "SIGHUP" or signal.getsignal(number) != signal.SIG_IGN
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
        for number, old_handler in old_handlers.items():
            signal.signal(number, old_handler)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Context manager that defers STOP_SIGNALS to its end, so that files are written completely."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    # The handler of `raise_on_signals` defers signals itself. Without changing handlers, thousands
    # of rows are written quickly.
    handler_defers = _interruptible_ranks and not _raised_signals
    signals = (
        []
        if handler_defers
        else [s for s in STOP_SIGNALS if signal.getsignal(s) not in (None, signal.SIG_IGN)]
    )
    old_handlers = {
        number: signal.signal(number, lambda number, frame: arrived.append(number))
        for number in signals
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


def ignore_stop_signals() -> None:
    """Make this process ignore STOP_SIGNALS, which the process that started it handles."""
    if hasattr(signal, "pthread_sigmask"):
        # Blocked signals stay blocked whatever handlers a library installs.
        signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
        return
    for number in STOP_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
