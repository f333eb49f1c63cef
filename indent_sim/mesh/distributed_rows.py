"""Rows of a table divided among the ranks: one slice on each, about as long as every other, in
their order.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Comm = Any  # a communicator of mpi4py


def scatter_rows(comm: Comm, table: np.ndarray | None) -> np.ndarray:
    """This rank's slice of a table (n, ...) that rank 0 can read, sent one after the other
    (collective).

    A table in a file is never in memory as a whole.
    """
    (count, *row_shape), dtype = comm.bcast(
        (table.shape, table.dtype.str) if table is not None else None, root=0
    )
    slice_ends = _slice_ends(comm, count)
    if table is None:
        local_rows = np.empty(
            (slice_ends[comm.rank + 1] - slice_ends[comm.rank], *row_shape), dtype=dtype
        )
        comm.Recv(local_rows, source=0)
        return local_rows
    for rank in range(
        1, comm.size
    ):  # gmsh's own arrays have a type, though of floats, that mpi4py does not know
        comm.Send(
            np.ascontiguousarray(table[slice_ends[rank] : slice_ends[rank + 1]]).view(dtype),
            dest=rank,
        )
    return table[: slice_ends[1]]


def fetch_rows(comm: Comm, local_rows: np.ndarray, row_numbers: np.ndarray) -> np.ndarray:
    """Rows by their numbers in a table whose slices are `local_rows`, from the ranks that have them
    (collective).
    """
    slice_ends = _slice_ends(comm, comm.allreduce(len(local_rows)))
    owner = np.searchsorted(slice_ends, row_numbers, side="right") - 1
    order = np.argsort(owner, kind="stable")
    requested_rows = np.split(
        row_numbers[order], np.searchsorted(owner[order], np.arange(1, comm.size))
    )
    received_rows = comm.alltoall(
        [local_rows[rows - slice_ends[comm.rank]] for rows in comm.alltoall(requested_rows)]
    )
    fetched_rows = np.empty((len(row_numbers), *local_rows.shape[1:]), dtype=local_rows.dtype)
    fetched_rows[order] = np.concatenate(received_rows)
    return fetched_rows


def _slice_ends(comm: Comm, count: int) -> np.ndarray:
    """The row at which the slice of each rank begins, and the end of the last (ranks + 1,)."""
    return np.arange(comm.size + 1) * count // comm.size
