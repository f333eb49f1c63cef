"""The Lagrange multiplier lam [pressure] as nodal values on the contact surface."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.facet_values import facet_nodes
from indent_sim.fe.kernel_cache import create_function_space
from indent_sim.fe.nodal_assembly import sum_nodal_contributions
from indent_sim.fe.shape_functions import interpolate_from_midpoints
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field
from indent_sim.scene.scene import Scene


def multiplier_field(scene: Scene, order: int) -> Field:
    """The unknown multiplier lam as a Lagrange field of the given order on the contact surface."""
    return Field("lam", order, domain="top", weight=stiffness_scale(scene))


def stiffness_scale(scene: Scene) -> float:
    """Stiffness [pressure/length] that converts gaps into pressures, for the scaling of equations.

    This stiffness is the penalty stiffness of the contact law, or E*/h_contact for a law without
    penalty.
    """
    return float(
        getattr(
            scene.physics.contact,
            "stiffness",
            scene.physics.material.E_star / scene.sizes.h_contact,
        )
    )


class SurfaceMultiplier:
    """Lagrange multiplier on the contact surface.

    The multiplier is an unknown of the body, or a separate function of the same order as the
    displacement.

    Attributes
    ----------
    lam : Expr
        The multiplier as a UFL expression [pressure].
    vector : PETSc.Vec
        Vector that stores its nodal values.
    """

    def __init__(self, body: Body):
        self.lam: Expr
        self._trace = body.trace
        facets = body.body_mesh.surfaces["top"]
        if "lam" in body.unknowns.names:
            nodes = facet_nodes(body.mesh, body.unknowns.collapsed_space("lam"), facets)
            self.lam = body.now.fields["lam"]
            self.vector = body.x
            self.node_dofs = body.unknowns.dofs("lam")[nodes]
        else:
            space = create_function_space(
                body.mesh, compat.lagrange_element(body.body_mesh.dim, DISPLACEMENT_ORDER)
            )
            self.lam = fem.Function(space)
            self.vector = compat.petsc_vector(self.lam)
            self.node_dofs = facet_nodes(body.mesh, space, facets)

    def values_at_points(self, points: np.ndarray) -> np.ndarray:
        """The multiplier (facets, points) at points of the reference facet [pressure]."""
        return self._trace.interpolate(self._nodal_values()[..., None], points)[..., 0]

    def smooth_values_at(self, points: np.ndarray) -> np.ndarray:
        """The multiplier (facets, points) without oscillations [pressure] (collective).

        On triangles the multiplier oscillates at the vertices; `interpolate_from_midpoints`
        replaces the vertex values by means of midpoint values.
        """
        if not self._trace.has_ripples:
            return self.values_at_points(points)
        nodal = interpolate_from_midpoints(
            self._nodal_values(),
            lambda values: sum_nodal_contributions(self.vector, self.node_dofs, values)[
                self.node_dofs
            ],
        )
        return self._trace.interpolate(nodal[..., None], points)[..., 0]

    def set_nodal_values(self, nodal: np.ndarray) -> None:
        """Set nodal values (facets, nodes), averaged at shared nodes [pressure] (collective)."""
        total, count = (
            sum_nodal_contributions(self.vector, self.node_dofs, values)
            for values in (nodal, np.ones_like(nodal))
        )
        with self.vector.localForm() as local:
            local.array[count > 0] = total[count > 0] / count[count > 0]

    def _nodal_values(self) -> np.ndarray:
        with self.vector.localForm() as local:
            return local.array[self.node_dofs]
