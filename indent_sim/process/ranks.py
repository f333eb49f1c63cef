"""MPI ranks: what rank 0 does alone, its failures shared over a communicator."""

from __future__ import annotations

import os
import time
from array import array
from collections.abc import Callable
from math import inf
from typing import Any, TypeVar

# How many ranks there are and which one this is, as mpirun and srun tell it before MPI is up
RANK_COUNT_VARIABLES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")
RANK_VARIABLES = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "MPI_LOCALRANKID")
RANK_TIMEOUT = 10.0  # s that a rank which failed waits for the others
T = TypeVar("T")


class SerialComm:
    """The communicator of a process without others: what needs no MPI does not load it."""

    rank = 0
    size = 1

    def bcast(self, value: Any, root: int = 0) -> Any:
        """The value itself."""
        return value

    def allgather(self, value: Any) -> list[Any]:
        """The value itself."""
        return [value]


class FailureConsensus:
    """Where ranks find out which of them failed (collective): on a communicator of its own, which
    what the others wait for does not disturb.
    """

    def __init__(self, comm: Any):
        self._comm = comm.Dup() if comm.size > 1 else None

    def all_ranks_failed(self) -> bool:
        """Whether every rank gets here, having failed, before patience ends."""
        return self.count_failures(1) is not None

    def count_failures(self, own_failures: int) -> int | None:
        """How many ranks get here having failed (`own_failures`: 1 of this one, or 0), once all do.

        None where this one has and others do not come before its patience ends: they wait for it
        elsewhere, for ever.
        """
        send_buffer = array("i", [own_failures])
        total = array("i", [own_failures])
        if self._comm is None:
            return total[0]
        request = self._comm.Iallreduce(send_buffer, total)
        deadline = time.monotonic() + (RANK_TIMEOUT if own_failures else inf)
        while not request.Test():
            if time.monotonic() > deadline:
                return None
            time.sleep(1e-3)
        return total[0]

    def free(self) -> None:
        """Give the communicator back (collective)."""
        if self._comm is not None:
            self._comm.Free()


def is_parallel() -> bool:
    """Whether this process was started as one of several ranks."""
    return any(os.environ.get(name, "1") not in ("", "0", "1") for name in RANK_COUNT_VARIABLES)


def is_root() -> bool:
    """Whether this process was started as rank 0; every process is that no launcher numbered."""
    return all(os.environ.get(name, "0") in ("", "0") for name in RANK_VARIABLES)


def run_on_root(comm: Any, action: Callable[..., T], *args: Any) -> T | None:
    """Do something on rank 0 alone; its exception is raised on every rank, its result stays on rank
    0.
    """
    result = None
    failure = None
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
