"""The multiplier lam [pressure] of a contact potential, as nodal values on the contact surface."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import DISPLACEMENT_ORDER, Body, Field
from indent_sim.fe.surface import facet_nodes, interpolate_from_midpoints
from indent_sim.scene.scene import Scene


def multiplier_field(scene: Scene, order: int) -> Field:
    """The unknown multiplier lam on the contact surface."""
    return Field("lam", order, domain="top", weight=stiffness_scale(scene))


def stiffness_scale(scene: Scene) -> float:
    """Pressure per length that compares gaps with pressures: the contact law's own, or
    E*/h_contact.
    """
    return float(
        getattr(
            scene.physics.contact,
            "stiffness",
            scene.physics.material.E_star / scene.sizes.h_contact,
        )
    )


class SurfaceMultiplier:
    """lam on the contact surface: an unknown of the body, or a function of the displacement's
    order.
    """

    def __init__(self, body: Body):
        # its values at the nodes (facets, nodes) stand at `_places` in the local array of `vector`
        self.lam: Expr
        self._trace = body.trace
        facets = body.body_mesh.surfaces["top"]
        if "lam" in body.unknowns.names:
            nodes = facet_nodes(body.mesh, body.unknowns.collapsed_space("lam"), facets)
            self.lam = body.now.fields["lam"]
            self.vector = body.x
            self._node_dofs = body.unknowns.dofs("lam")[nodes]
        else:
            space = compat.function_space(
                body.mesh, compat.lagrange_element(body.body_mesh.dim, DISPLACEMENT_ORDER)
            )
            self.lam = fem.Function(space)
            self.vector = compat.petsc_vector(self.lam)
            self._node_dofs = facet_nodes(body.mesh, space, facets)

    def values_at_points(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure]."""
        return self._trace.interpolate(self._nodal_values()[..., None], points)[..., 0]

    def smooth_values_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles."""
        if not self._trace.has_ripples:
            return self.values_at_points(points)
        nodal = interpolate_from_midpoints(
            self._nodal_values(),
            lambda values: sum_nodal_contributions(self.vector, self._node_dofs, values)[
                self._node_dofs
            ],
        )
        return self._trace.interpolate(nodal[..., None], points)[..., 0]

    def set_nodal_values(self, nodal: np.ndarray) -> None:
        """Set the values at the nodes of the facets (facets, nodes) [pressure] (collective)."""
        total, count = (
            sum_nodal_contributions(self.vector, self._node_dofs, values)
            for values in (nodal, np.ones_like(nodal))
        )
        with self.vector.localForm() as local:
            local.array[count > 0] = total[count > 0] / count[count > 0]

    def _nodal_values(self) -> np.ndarray:
        with self.vector.localForm() as local:
            return local.array[self._node_dofs]


def sum_nodal_contributions(
    vector: PETSc.Vec, node_dofs: np.ndarray, nodal: np.ndarray
) -> np.ndarray:
    """Contributions (facets, nodes) summed over facets and ranks that share a node, as the local
    array of `vector`.
    """
    work = vector.duplicate()
    with work.localForm() as local:
        local.set(0.0)
        np.add.at(local.array, node_dofs, nodal)
    work.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    work.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    with work.localForm() as local:
        summed = np.array(local.array)
    work.destroy()  # left to Python, those of several ranks stay until the end
    return summed
