"""Rows of a table divided among the ranks: one slice on each, about as long as every other, in
their order.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Comm = Any  # a communicator of mpi4py


def scatter(comm: Comm, table: np.ndarray | None) -> np.ndarray:
    """This rank's slice of a table (n, ...) that rank 0 can read, sent one after the other
    (collective).

    A table in a file is never in memory as a whole.
    """
    (count, *width), kind = comm.bcast(
        (table.shape, table.dtype.str) if table is not None else None, root=0
    )
    ends = _ends(comm, count)
    if table is None:
        mine = np.empty((ends[comm.rank + 1] - ends[comm.rank], *width), dtype=kind)
        comm.Recv(mine, source=0)
        return mine
    for other in range(
        1, comm.size
    ):  # gmsh's own arrays have a type, though of floats, that mpi4py does not know
        comm.Send(np.ascontiguousarray(table[ends[other] : ends[other + 1]]).view(kind), dest=other)
    return table[: ends[1]]


def fetch(comm: Comm, mine: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows by their numbers in a table whose slices are `mine`, from the ranks that have them
    (collective).
    """
    ends = _ends(comm, comm.allreduce(len(mine)))
    owner = np.searchsorted(ends, wanted, side="right") - 1
    order = np.argsort(owner, kind="stable")
    asked = np.split(wanted[order], np.searchsorted(owner[order], np.arange(1, comm.size)))
    answers = comm.alltoall([mine[rows - ends[comm.rank]] for rows in comm.alltoall(asked)])
    found = np.empty((len(wanted), *mine.shape[1:]), dtype=mine.dtype)
    found[order] = np.concatenate(answers)
    return found


def _ends(comm: Comm, count: int) -> np.ndarray:
    """The row at which the slice of each rank begins, and the end of the last (ranks + 1,)."""
    return np.arange(comm.size + 1) * count // comm.size
