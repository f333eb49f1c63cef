"""Assembly of nodal contributions that are computed in numpy."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc


def sum_nodal_contributions(
    vector: PETSc.Vec, node_dofs: np.ndarray, nodal: np.ndarray
) -> np.ndarray:
    """Sum contributions of facets over all facets and ranks that share a node (collective).

    Parameters
    ----------
    vector : PETSc.Vec
        Ghosted vector whose layout is used; it does not change.
    node_dofs : ndarray of int, (facets, nodes)
        Positions of the nodes in the local array of `vector`.
    nodal : ndarray, (facets, nodes)
        Contributions.

    Returns
    -------
    ndarray
        The sums, as a local array of `vector` with ghosts.
    """
    work = vector.duplicate()
    with work.localForm() as local:
        local.set(0.0)
        np.add.at(local.array, node_dofs, nodal)
    work.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    work.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    with work.localForm() as local:
        summed = np.array(local.array)
    # PETSc keeps vectors of several ranks that Python collects until the end of the program
    work.destroy()
    return summed
