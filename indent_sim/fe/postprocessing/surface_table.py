"""Surface table of a state: positions, displacements, gap and tractions of the surface nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from indent_sim.fe.postprocessing.contact_sample import ObservedBody, sample_contact, tractions
from indent_sim.model.state import Surface
from indent_sim.model.tips import gap_under_tip


def surface_table(body: ObservedBody) -> Surface | None:
    """Gather the surface table of the nodes, sorted by (x, y), on rank 0; None on other ranks."""
    sample = sample_contact(body, body.trace.node_points())
    dim = body.trace.dim
    traction = tractions(body, sample, body.trace.node_points())
    pore_columns = (
        [] if body.fluid is None else [body.fluid.pressure_at(body.trace.node_points())[..., None]]
    )
    columns = np.concatenate(
        [sample.X, sample.u, sample.gap[..., None], *pore_columns, traction], axis=-1
    )
    parts: Any = body.comm.gather(columns.reshape(-1, columns.shape[-1]), root=0)
    if parts is None:
        return None
    table = np.concatenate(parts)
    # Facets share nodes. Nodes closer than this are the same: 1e-10 of the body's height, and less
    # than the smallest element
    tolerance = min(1e-10, 1e-3 * body.scene.sizes.min_size)
    keys = np.round(table[:, : dim - 1] / tolerance)
    _, first_rows, row_of_node, node_count = np.unique(
        keys, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    row_of_node = row_of_node.ravel()
    X, u, gap = np.split(table[first_rows, : 2 * dim + 1], [dim, 2 * dim], axis=1)
    fluid = {"pore_pressure": table[first_rows, 2 * dim + 1]} if pore_columns else {}
    X[np.abs(X) < 1e-12] = 0.0  # the axis is at 0, without round-off
    gap = gap_under_tip(body.scene.physics.indenter, gap[:, 0])
    # The deformed area is discontinuous between facets, so tractions are averaged at their nodes
    pressure, *shear = (
        np.bincount(row_of_node, column) / node_count
        for column in table[:, 2 * dim + 1 + len(pore_columns) :].T
    )
    zero = np.zeros(len(first_rows))
    if dim == 2:
        spatial = np.column_stack([u[:, 0], zero, u[:, 1]])
        return Surface(X[:, 0], zero, spatial, gap, pressure, X[:, 1], *shear, **fluid)
    return Surface(X[:, 0], X[:, 1], u, gap, pressure, X[:, 2], *shear, **fluid)
