"""MPI ranks: work done on rank 0 only, and agreement of all ranks on failures."""

from __future__ import annotations

import os
import time
from array import array
from collections.abc import Callable
from math import inf
from typing import Any, TypeVar

# Time for which a rank that has failed waits for the others [s].
RANK_TIMEOUT = 10.0
T = TypeVar("T")


class SerialComm:
    """Communicator of a single process, so that runs by theory need not load MPI."""

    rank = 0
    size = 1

    def bcast(self, value: Any, root: int = 0) -> Any:
        """Return the value itself."""
        return value

    def allgather(self, value: Any) -> list[Any]:
        """Return a list that contains the value."""
        return [value]


class FailureConsensus:
    """Counts the failed ranks; the result is known to all ranks (collective).

    The object uses a duplicate of the communicator, so that pending messages of other calls do not
    interfere.
    """

    def __init__(self, comm: Any):
        self._comm = comm.Dup() if comm.size > 1 else None

    def all_ranks_failed(self) -> bool:
        """Return True if all other ranks also make this call within RANK_TIMEOUT."""
        return self.count_failures(1) is not None

    def count_failures(self, own_failures: int) -> int | None:
        """Return the number of failed ranks, after all ranks have called this method.

        Parameters
        ----------
        own_failures
            1 if this rank has failed, otherwise 0.

        Returns
        -------
        int or None
            The number; None if this rank has failed and other ranks do not call within
            RANK_TIMEOUT, because they wait for this rank in another collective call.
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
        """Free the communicator (collective)."""
        if self._comm is not None:
            self._comm.Free()


def is_parallel() -> bool:
    """True if this process was started as one of several ranks."""
    # mpirun and srun pass the number of ranks by these variables, before MPI is initialized.
    variables = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")
    return any(os.environ.get(name, "1") not in ("", "0", "1") for name in variables)


def is_root() -> bool:
    """True if this process was started as rank 0, or without a launcher."""
    # mpirun and srun pass the own rank by these variables, before MPI is initialized.
    variables = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "MPI_LOCALRANKID")
    return all(os.environ.get(name, "0") in ("", "0") for name in variables)


def environment_without_launcher() -> dict[str, str]:
    """Return environment variables for a child process that is not an MPI rank."""
    # Prefixes of all variables by which mpirun and srun address their processes. A child process
    # must not register with the launcher, which would abort the whole job when the process is
    # stopped.
    launcher_prefixes = (
        "SLURM_",
        "PMI_",
        "PMIX_",
        "PRTE_MCA_ess",
        "OMPI_COMM_",
        "OMPI_UNIVERSE_",
        "OMPI_MCA_orte_",
        "OMPI_MCA_ess",
    )
    return {
        name: value for name, value in os.environ.items() if not name.startswith(launcher_prefixes)
    }


def run_on_root(comm: Any, action: Callable[..., T], *args: Any) -> T | None:
    """Call a function on rank 0 only (collective).

    Parameters
    ----------
    comm
        Communicator.
    action
        The function.
    *args
        Its arguments.

    Returns
    -------
    object or None
        The result of the function on rank 0, None on other ranks. An exception is raised on all
        ranks.
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
