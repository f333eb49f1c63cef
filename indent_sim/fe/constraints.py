"""Constrained degrees of freedom of the displacement: supports and pins."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from indent_sim.fe import compat
from indent_sim.fe.mesh import BodyMesh
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.reactions import SurfaceComponent

# Component and local dofs of each constraint
ConstrainedDofs = list[tuple[int, np.ndarray]]


def support_and_pin_dofs(
    space: fem.FunctionSpace, body_mesh: BodyMesh
) -> tuple[ConstrainedDofs, ConstrainedDofs]:
    """Find the dofs of a displacement space that supports and pins constrain (collective).

    Returns
    -------
    supports, pins : ConstrainedDofs
        Component and local dofs of each support and of each pin.
    """
    part = body_mesh.part
    dim = body_mesh.dim - 1
    surfaces = body_mesh.surfaces
    supports = [
        (c, fem.locate_dofs_topological(space.sub(c), dim, surfaces[side]))
        for c, side in part.constrained_components
    ]
    pins = [
        (c, fem.locate_dofs_topological(space.sub(c), 0, body_mesh.vertices_at(point)))
        for point, c in part.pins
    ]
    return supports, pins


def zero_bc(space: fem.FunctionSpace, dofs: np.ndarray) -> fem.DirichletBC:
    """Homogeneous Dirichlet condition on given dofs of a function space."""
    return compat.zero_bc(dofs, space)


def find_support_shares(
    part: ModelDomain, owned_count: int, support_dofs: ConstrainedDofs
) -> dict[SurfaceComponent, tuple[np.ndarray, np.ndarray]]:
    """Divide the reaction of each constrained dof among the supports that constrain it.

    Two supports that constrain a node along the same axis, such as a fixed base and fixed sides at
    their common edge, are each assigned half of the reaction of this node. On a mirror plane or the
    axis, the normal reaction is attributed to the symmetry condition alone.

    Parameters
    ----------
    part : ModelDomain
        Model domain with its supports.
    owned_count : int
        Number of dofs that this rank owns.
    support_dofs : ConstrainedDofs
        Dofs of each support, in the order of `part.constrained_components`.

    Returns
    -------
    dict
        Owned dofs of each surface and component, and the share of each dof's reaction.
    """
    symmetry_surfaces = {"r_min", *part.mirror_planes}
    groups: dict[SurfaceComponent, np.ndarray] = {}
    support_count = np.zeros(owned_count)
    for (component, surface), (_, dofs) in zip(
        part.constrained_components, support_dofs, strict=True
    ):
        groups[surface, component] = dofs[dofs < owned_count]
        if surface not in symmetry_surfaces:
            support_count[dofs[dofs < owned_count]] += 1.0
    support_share = 1 / np.maximum(support_count, 1.0)
    for (surface, _), dofs in groups.items():
        if surface in symmetry_surfaces:
            support_share[dofs] = 0.0
    ones = np.ones(owned_count)
    return {
        (surface, component): (
            dofs,
            (ones if surface in symmetry_surfaces else support_share)[dofs],
        )
        for (surface, component), dofs in groups.items()
    }


def owned_dofs(groups: list[np.ndarray], owned_count: int) -> np.ndarray:
    """Return the sorted unique dofs of all groups that this rank owns."""
    dofs = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *groups]))
    return dofs[dofs < owned_count]
