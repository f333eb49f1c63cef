"""SIGINT and SIGTERM as an exception, so that a run keeps what it has and says how it ended."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import FrameType


class Stopped(KeyboardInterrupt):
    """SIGINT or SIGTERM arrived; exit code 128 + signal."""

    def __init__(self, number: int):
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number, self.exit_code = number, 128 + number

    def __reduce__(self) -> tuple[type[Stopped], tuple[int]]:
        return Stopped, (self.number,)  # other ranks learn of it


@contextmanager
def stoppable(rank: int = 0) -> Iterator[Callable[[], None]]:
    """SIGINT and SIGTERM raise Stopped on rank 0, which keeps what there is and takes the others along.

    Yields a check to call now and then: libraries may swallow what is raised in their callbacks, or turn it
    into an error of their own.
    """
    arrived: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        arrived.append(number)
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # who presses Ctrl-C again means it
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # mpirun and batch systems repeat themselves
        raise Stopped(number)

    def check() -> None:
        if arrived:
            raise Stopped(arrived[0])

    handler: Any = stop if rank == 0 else signal.SIG_IGN
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield check
    except Exception:
        check()
        raise
    finally:
        for number, old in before.items():
            signal.signal(number, old)
