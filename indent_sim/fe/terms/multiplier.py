"""The multiplier lam [pressure] of a contact potential, as nodal values on the contact surface."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.body import ORDER, Body
from indent_sim.fe.observe.surface import facet_nodes, from_midpoints
from indent_sim.scene.scene import Scene


def multiplier_order(scene: Scene) -> int:
    """Order of the unknown multiplier: the displacement's; 1 for nodal pressures in three dimensions, since they live
    at vertices; 0 where the multiplier is no unknown."""
    match scene.physics.contact.multiplier:
        case "unknown":
            return ORDER
        case "nodal":
            return ORDER if scene.physics.part.kinematics.dim == 2 else 1
    return 0


class SurfaceField:
    """lam on the contact surface, an unknown beside the displacement or a function of its order."""

    def __init__(self, body: Body, lam: Any, vector: PETSc.Vec, places: np.ndarray):
        """lam: its UFL expression; places (facets, nodes): where its values stand in the local array of `vector`."""
        self.lam, self.vector, self._trace, self._places = lam, vector, body.trace, places

    def at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure]."""
        return self._trace.values(self._nodal()[..., None], points)[..., 0]

    def smooth_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles."""
        if not self._trace.ripples:
            return self.at(points)
        nodal = from_midpoints(self._nodal(), partial(_summed, self.vector, self._places))
        return self._trace.values(nodal[..., None], points)[..., 0]

    def fill(self, nodal: np.ndarray) -> None:
        """Set the values at the nodes of the facets (facets, nodes) [pressure] (collective)."""
        total, count = (_sums(self.vector, self._places, values) for values in (nodal, np.ones_like(nodal)))
        with self.vector.localForm() as local:
            local.array[count > 0] = total[count > 0] / count[count > 0]

    def _nodal(self) -> np.ndarray:
        with self.vector.localForm() as local:
            return local.array[self._places]


def unknown_field(body: Body) -> SurfaceField:
    """lam as an unknown of the body's own space."""
    nodes = facet_nodes(body.mesh, body.unknowns.own_space("lam"), body.body_mesh.surfaces["top"])
    return SurfaceField(body, body.unknowns.fields["lam"], body.x, body.unknowns.places("lam")[nodes])


def given_field(body: Body) -> SurfaceField:
    """lam as a function of the displacement's order that somebody else fills."""
    space = compat.function_space(body.mesh, compat.lagrange(body.body_mesh.dim, ORDER))
    function, facets = fem.Function(space), body.body_mesh.surfaces["top"]
    return SurfaceField(body, function, compat.vector(function), facet_nodes(body.mesh, space, facets))


def _summed(vector: PETSc.Vec, places: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Contributions (facets, nodes) summed over the facets and ranks that share a node, at these nodes."""
    return _sums(vector, places, nodal)[places]


def _sums(vector: PETSc.Vec, places: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """The same laid out as the local array of `vector`."""
    work = vector.duplicate()
    with work.localForm() as local:
        local.set(0.0)
        np.add.at(local.array, places, nodal)
    work.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    work.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    with work.localForm() as local:
        return np.asarray(local.array.copy())
