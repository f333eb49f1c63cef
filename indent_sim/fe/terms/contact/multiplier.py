"""The multiplier lam [pressure] of a contact potential, as nodal values on the contact surface."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import ORDER, Body, Field
from indent_sim.fe.observe.surface import facet_nodes, from_midpoints
from indent_sim.scene.scene import Scene


def multiplier(scene: Scene, order: int) -> Field:
    """The unknown multiplier lam on the contact surface."""
    return Field("lam", order, where="top", weight=stiffness_scale(scene))


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


class SurfaceField:
    """lam on the contact surface: an unknown of the body, or a function of the displacement's
    order.
    """

    def __init__(self, body: Body):
        # its values at the nodes (facets, nodes) stand at `_places` in the local array of `vector`
        self.lam: Expr
        self._trace = body.trace
        facets = body.body_mesh.surfaces["top"]
        if "lam" in body.unknowns.names:
            nodes = facet_nodes(body.mesh, body.unknowns.own_space("lam"), facets)
            self.lam = body.now.fields["lam"]
            self.vector = body.x
            self._places = body.unknowns.places("lam")[nodes]
        else:
            space = compat.function_space(body.mesh, compat.lagrange(body.body_mesh.dim, ORDER))
            self.lam = fem.Function(space)
            self.vector = compat.vector(self.lam)
            self._places = facet_nodes(body.mesh, space, facets)

    def at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure]."""
        return self._trace.values(self._nodal()[..., None], points)[..., 0]

    def smooth_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles."""
        if not self._trace.ripples:
            return self.at(points)
        nodal = from_midpoints(
            self._nodal(), lambda values: sums(self.vector, self._places, values)[self._places]
        )
        return self._trace.values(nodal[..., None], points)[..., 0]

    def fill(self, nodal: np.ndarray) -> None:
        """Set the values at the nodes of the facets (facets, nodes) [pressure] (collective)."""
        total, count = (
            sums(self.vector, self._places, values) for values in (nodal, np.ones_like(nodal))
        )
        with self.vector.localForm() as local:
            local.array[count > 0] = total[count > 0] / count[count > 0]

    def _nodal(self) -> np.ndarray:
        with self.vector.localForm() as local:
            return local.array[self._places]


def sums(vector: PETSc.Vec, places: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Contributions (facets, nodes) summed over facets and ranks that share a node, as the local
    array of `vector`.
    """
    work = vector.duplicate()
    with work.localForm() as local:
        local.set(0.0)
        np.add.at(local.array, places, nodal)
    work.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    work.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    with work.localForm() as local:
        found = np.array(local.array)
    work.destroy()  # left to Python, those of several ranks stay until the end
    return found
