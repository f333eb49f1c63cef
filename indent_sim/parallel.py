"""One rank acts, all ranks know: results and failures of rank 0 shared over a communicator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


def on_root(comm: Any, action: Callable[..., T], *args: Any) -> T | None:
    """Do something on rank 0 alone; its exception is raised on every rank, its result stays on rank 0."""
    result, failure = None, None
    if comm.rank == 0:
        try:
            result = action(*args)
        except BaseException as error:
            if comm.size == 1:
                raise
            failure = error
    failure = comm.bcast(failure, root=0)
    if failure is not None:
        raise failure
    return result
