"""Primal-dual active set method with nodal contact pressures.

The pressure p_h = sum p_i psi_i uses hat functions psi_i of the nodes of the contact surface
(vertices and midpoints in two dimensions, only vertices in three), so that p_i >= 0 implies p_h >=
0 everywhere. The Signorini conditions (KKT conditions of the contact problem) hold at each node,

    weighted gap G_i = int psi_i g dGamma >= 0,   p_i >= 0,   p_i G_i = 0.

The equation of a node is G_i = 0 if it belongs to the active set {p_i - c G_i / int psi_i > 0}, and
p_i = 0 otherwise. Newton's method for these equations is the primal-dual active set method
(Hintermueller, Ito & Kunisch 2002). The factor c influences the iteration but not its solution.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.facet_values import FacetValues, facet_nodes
from indent_sim.fe.nodal_assembly import sum_nodal_contributions
from indent_sim.fe.quadrature import split_quadrature
from indent_sim.fe.shape_functions import pressure_shape_functions, shape_functions
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import multiplier_field
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field, TimeLevel
from indent_sim.scene.scene import Scene

# Number of active sets that may recur before the nodes change one by one; a nonlinear body may
# return to a set once without cycling
MAX_RETURNS = 2


def fields(scene: Scene) -> list[Field]:
    """Return the field of the nodal pressures p_i; in three dimensions only at vertices."""
    if scene.physics.contact.multiplier != "nodal":
        return []
    return [
        multiplier_field(
            scene, DISPLACEMENT_ORDER if scene.physics.domain.kinematics.dim == 2 else 1
        )
    ]


class NodalContact(Term):
    """Contact term with nodal pressures, assembled in numpy."""

    field_names = ("lam",)
    has_symmetric_tangent = False  # an inactive node has p_i = 0 instead of its gap condition

    def __init__(self, body: Body):
        self.body = body
        scene = body.scene
        # The factor c of the active set [pressure/length]
        self._complementarity_factor = scene.physics.material.E_star / scene.sizes.h_contact
        facets = body.body_mesh.surfaces["top"]
        gap = Gap(body, body.now)
        self._points, reference_weights = split_quadrature(body.body_mesh.dim)
        self._N = shape_functions(self._points)
        fields = ufl.as_vector(
            [gap.g, *_scalar_components(gap.normal), *_scalar_components(gap.hessian)]
        )
        self._gap_values = FacetValues(body.mesh, facets, fields, self._points)
        self._lateral_values = self._lateral_facet_values(gap)
        self.lam_dofs = body.unknowns.dofs("lam")[
            facet_nodes(body.mesh, body.unknowns.collapsed_space("lam"), facets)
        ]
        self._psi = self.basis(self._points)
        self._u_dofs = body.trace.dofs
        per_area = scene.physics.domain.kinematics.integration_weight(
            np.moveaxis(body.trace.positions(self._points), -1, 0)
        )
        self._weights = body.trace.measures(self._points) * per_area * reference_weights
        self._active = np.zeros(0, dtype=bool)
        index_map = body.unknowns.space.dofmap.index_map
        lam_dofs = self.lam_dofs.astype(np.int32)
        self._node_numbers = np.asarray(index_map.local_to_global(lam_dofs.ravel())).reshape(
            lam_dofs.shape
        )
        self.begin_solve()
        self._nodal_areas = np.einsum("fp,pn->fn", self._weights, self._psi)
        self._is_constrained = (
            sum_nodal_contributions(
                body.x, body.constrained_dofs, np.ones(len(body.constrained_dofs))
            )
            > 0
        )
        self._summed_areas = sum_nodal_contributions(body.x, self.lam_dofs, self._nodal_areas)[
            self.lam_dofs
        ]

    def _lateral_facet_values(self, gap: Gap) -> FacetValues | None:
        """Return gap, lever arm and slopes at facets for a tilted or sliding tip; None for others.

        The slopes are the derivatives of the gap with respect to the tip's position along the
        horizontal axes. The gap is included because dolfinx numbers the constants of an expression
        before differentiation, and the kernel after it: the derivatives alone may lack constants.
        """
        physics = self.body.scene.physics
        if not physics.has_moment:
            return None
        axes = range(self.body.body_mesh.dim - 1)
        if physics.slides:
            slopes = [gap.slide_derivative(axis) for axis in axes]
        else:
            slopes = [-gap.normal[axis] for axis in axes]
        values = ufl.as_vector([gap.g, gap.lever, *slopes])
        facets = self.body.body_mesh.surfaces["top"]
        return FacetValues(self.body.mesh, facets, values, self._points)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> None:
        """Return None, because `add_residual` assembles the residual without a UFL form."""

    def begin_solve(self) -> None:
        """Discard the active sets recorded in the previous solve."""
        self._visited_sets: list[tuple[int, ...]] = []
        self._return_count = 0
        self._last_active_set: np.ndarray | None = None  # that of the last Newton iteration

    def basis(self, points: np.ndarray) -> np.ndarray:
        """Values (points, nodes) of the hat functions psi_i at points of the reference facet."""
        return pressure_shape_functions(points)[:, : self.lam_dofs.shape[1]]

    def _evaluate_gap(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the gap and its first and second derivatives with respect to position.

        Their shapes are (facets, points), (*, dim) and (*, dim, dim).
        """
        dim = self.body.body_mesh.dim
        values = self._gap_values()
        return (
            values[..., 0],
            values[..., 1 : 1 + dim],
            values[..., 1 + dim :].reshape(*values.shape[:2], dim, dim),
        )

    def nodal_pressures(self) -> np.ndarray:
        """Nodal pressures p_i (facets, nodes) at the current solution [pressure]."""
        return self.body.local_array()[self.lam_dofs]

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add -int p_h dg to the displacement rows and the nodal conditions to the pressure rows.

        The condition is -G_i at an active node and -p_i int psi_i / c at an inactive one.
        """
        g, normal, _ = self._evaluate_gap()
        p = self.nodal_pressures()
        c = self._complementarity_factor
        p_h = p @ self._psi.T
        traction = np.einsum("fp,fpd,pn->fnd", -self._weights * p_h, normal, self._N)
        weighted_gap = np.einsum("fp,fp,pn->fn", self._weights, g, self._psi)
        summed_gap = sum_nodal_contributions(self.body.x, self.lam_dofs, weighted_gap)[
            self.lam_dofs
        ]
        self._active = self._choose_active_set(p - c * summed_gap / self._summed_areas > 0)
        rows = np.where(self._active, -weighted_gap, -p * self._nodal_areas / c)
        dofs = np.concatenate([self._u_dofs.ravel(), self.lam_dofs.ravel()])
        assembled = sum_nodal_contributions(
            self.body.x, dofs, np.concatenate([traction.ravel(), rows.ravel()])
        )
        b.array[:] += assembled[: self.body.unknowns.owned_count]

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the derivative of `add_residual` for the present active set.

        Rows of constrained dofs remain identity rows.
        """
        self._record_active_set()
        _, normal, slope = self._evaluate_gap()
        weights = self._weights
        p_h = self.nodal_pressures() @ self._psi.T
        coupling = -np.einsum("fp,fpd,pn,pm->fndm", weights, normal, self._N, self._psi)
        # A rank may have no facet, and numpy cannot infer a size with -1 in `reshape` then
        size = int(np.prod(self._u_dofs.shape[1:]))
        coupling = coupling.reshape(len(coupling), size, self._psi.shape[1])
        mass = -self._nodal_areas / self._complementarity_factor
        uu = -np.einsum("fp,fpde,pn,pm->fndme", weights * p_h, slope, self._N, self._N).reshape(
            -1, size, size
        )
        u_dofs = self._u_dofs.reshape(len(uu), size)
        for f in range(len(uu)):
            lam = self.lam_dofs[f].astype(np.int32)
            active = self._active[f]
            add = PETSc.InsertMode.ADD
            # PETSc ignores negative rows
            u = np.where(self._is_constrained[u_dofs[f]], -1, u_dofs[f]).astype(np.int32)
            A.setValuesLocal(u, u, uu[f], addv=add)
            A.setValuesLocal(u, lam, coupling[f], addv=add)
            A.setValuesLocal(
                np.where(active, lam, np.int32(-1)),
                u,
                np.ascontiguousarray(coupling[f].T),
                addv=add,
            )
            A.setValuesLocal(lam, lam, np.diag(np.where(active, 0.0, mass[f])), addv=add)

    def _record_active_set(self) -> None:
        """Record the active set of this Newton iteration and count the recurrences."""
        local_hash = hash(np.unique(self._node_numbers[self._active]).tobytes())
        set_hashes = tuple(self.body.comm.allgather(local_hash))
        if (
            self._visited_sets
            and set_hashes != self._visited_sets[-1]
            and set_hashes in self._visited_sets
        ):
            self._return_count += 1
        self._visited_sets.append(set_hashes)
        self._last_active_set = self._active

    def _choose_active_set(self, proposed: np.ndarray) -> np.ndarray:
        """Return the proposed active set, or the last one with one node changed if sets recur.

        Changing only the node with the smallest number prevents cycling (Murty 1974).
        """
        if self._return_count < MAX_RETURNS or self._last_active_set is None:
            return proposed
        changed = self._node_numbers[proposed != self._last_active_set]
        first_changed = self.body.comm.allreduce(
            int(changed.min(initial=np.iinfo(np.int64).max)), op=MPI.MIN
        )
        return np.where(self._node_numbers == first_changed, proposed, self._last_active_set)

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Contact pressure p_h (facets, points) at points of the reference facet [pressure]."""
        return self.nodal_pressures() @ self.basis(points).T

    pressure_at = multiplier_at

    def force(self) -> float:
        """Vertical force of the pressures, -int p_h dg/dz dGamma [force], this rank's part."""
        # The difference from 0.0 is not -0.0 where nothing is in contact
        return 0.0 - float(self._vertical_loads().sum())

    def moment(self) -> float:
        """Moment of the vertical force of the pressures [force length], this rank's part."""
        if self._lateral_values is None:
            return 0.0
        return 0.0 - float((self._vertical_loads() * self._lateral_values()[..., 1]).sum())

    def side_force(self, axis: int) -> float:
        """Horizontal force of the pressures on the tip along an axis [force], this rank's part.

        If the tip slides it is -dPi/dx, which with a reference gap includes the force of the
        pressure on the slope of the tip.
        """
        if self._lateral_values is None:
            return 0.0
        slope = self._lateral_values()[..., 2 + axis]
        p_h = self.nodal_pressures() @ self._psi.T
        return float((self._weights * p_h * slope).sum())

    def _vertical_loads(self) -> np.ndarray:
        """Pressures times dg/dz and weights at the quadrature points (facets, points) [force]."""
        _, normal, _ = self._evaluate_gap()
        p_h = self.nodal_pressures() @ self._psi.T
        return np.asarray(self._weights * p_h * normal[..., -1])


def _scalar_components(expression: Expr) -> list[Expr]:
    return [expression[index] for index in np.ndindex(expression.ufl_shape)]
