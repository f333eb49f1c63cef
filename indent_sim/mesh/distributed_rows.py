"""Rows of a table distributed over the ranks in contiguous slices of nearly equal length."""

from __future__ import annotations

from typing import Any

import numpy as np

Comm = Any  # A communicator of mpi4py.


def scatter_rows(comm: Comm, table: np.ndarray | None) -> np.ndarray:
    """Send each rank its slice of a table (n, *) on rank 0 (collective).

    The slices are sent one after the other, so that a table in a file is never in memory as a
    whole.
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
    for rank in range(1, comm.size):
        # gmsh's float arrays have a type that mpi4py does not know: view them as the numpy type.
        comm.Send(
            np.ascontiguousarray(table[slice_ends[rank] : slice_ends[rank + 1]]).view(dtype),
            dest=rank,
        )
    return table[: slice_ends[1]]


def fetch_rows(comm: Comm, local_rows: np.ndarray, row_numbers: np.ndarray) -> np.ndarray:
    """Return rows of a distributed table by their numbers (collective).

    `local_rows` is this rank's slice of the table.
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
    """Return the first row of each rank's slice, followed by the number of rows (ranks + 1,)."""
    return np.arange(comm.size + 1) * count // comm.size
