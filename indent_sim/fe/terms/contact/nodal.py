"""The primal-dual active set: nodal pressures that are never negative, weighted gaps that are never
negative.

The pressure p_h = sum p_i psi_i uses hat functions psi_i of the contact surface's nodes (in two
dimensions vertices and midpoints, in three vertices alone), so p_i >= 0 means p_h >= 0 everywhere.
Each node carries one condition,

    weighted gap G_i = int psi_i g dGamma >= 0,   p_i >= 0,   p_i G_i = 0,

and the active set {p_i - c G_i / int psi_i > 0} makes it one equation a node: G_i = 0 or p_i = 0.
Newton on these equations is the primal-dual active set method (Hintermueller, Ito & Kunisch 2002);
c steers it and changes nothing.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import ORDER, Body, Field, Moment
from indent_sim.fe.observe.surface import (
    FacetValues,
    facet_nodes,
    pressure_functions,
    shapes,
    split_quadrature,
)
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import multiplier, sums
from indent_sim.fe.terms.term import Term
from indent_sim.scene.scene import Scene

# active sets that came back before the nodes change one by one; a nonlinear body may need the first
RETURNS = 2


def fields(scene: Scene) -> list[Field]:
    """The nodal pressures: in three dimensions at vertices alone."""
    if scene.physics.contact.multiplier != "nodal":
        return []
    return [multiplier(scene, ORDER if scene.physics.part.kinematics.dim == 2 else 1)]


class NodalContact(Term):
    """The contact term of a body whose multiplier lives at the nodes, assembled in numpy."""

    fields = ("lam",)
    has_symmetric_tangent = False  # the rows of nodal pressures belong to an active set

    def __init__(self, body: Body):
        self.body = body
        scene = body.scene
        self._scale = (
            scene.physics.material.E_star / scene.sizes.h_contact
        )  # c: compares gaps with pressures
        facets = body.body_mesh.surfaces["top"]
        gap = Gap(body, body.now)
        self._points, reference_weights = split_quadrature(body.body_mesh.dim)
        self._N = shapes(self._points)
        fields = ufl.as_vector([gap.g, *_flat(gap.normal), *_flat(gap.slope)])
        self._fields = FacetValues(body.mesh, facets, fields, self._points)
        self.lam_places = body.unknowns.places("lam")[
            facet_nodes(body.mesh, body.unknowns.own_space("lam"), facets)
        ]
        self._psi = self.basis(self._points)
        self._u_places = body.trace.dofs
        per_area = scene.physics.part.kinematics.weight(
            np.moveaxis(body.trace.positions(self._points), -1, 0)
        )
        self._weights = body.trace.measures(self._points) * per_area * reference_weights
        self._active = np.zeros(0, dtype=bool)
        index_map = body.unknowns.space.dofmap.index_map
        places = self.lam_places.astype(np.int32)
        self._numbers = np.asarray(index_map.local_to_global(places.ravel())).reshape(places.shape)
        self.begin_solve()
        self._share = np.einsum("fp,pn->fn", self._weights, self._psi)
        self._held = sums(body.x, body.constrained, np.ones(len(body.constrained))) > 0
        self._unit_weights = sums(body.x, self.lam_places, self._share)[self.lam_places]

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> None:
        """None: the rows of nodal pressures are no form."""

    def begin_solve(self) -> None:
        """Forget the active sets that have been."""
        self._visited: list[tuple[int, ...]] = []
        self._returns = 0
        self._settled: np.ndarray | None = None  # the set of the last Newton step

    def basis(self, points: np.ndarray) -> np.ndarray:
        """The nodal pressures' functions (points, nodes) on the reference facet."""
        return pressure_functions(points)[:, : self.lam_places.shape[1]]

    def _evaluate(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """g (facets, points), dg/dx (.., dim) and d2g/dx2 (.., dim, dim) at the present solution."""
        dim = self.body.body_mesh.dim
        values = self._fields()
        return (
            values[..., 0],
            values[..., 1 : 1 + dim],
            values[..., 1 + dim :].reshape(*values.shape[:2], dim, dim),
        )

    def nodal_pressures(self) -> np.ndarray:
        """p_i (facets, nodes) at the present solution."""
        return self.body.local_array()[self.lam_places]

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add -int p_h dg to the displacement rows; -G_i or -p_i int psi_i / c to the nodes' own
        rows.
        """
        g, normal, _ = self._evaluate()
        p = self.nodal_pressures()
        c = self._scale
        p_h = p @ self._psi.T
        traction = np.einsum("fp,fpd,pn->fnd", -self._weights * p_h, normal, self._N)
        weighted_gap = np.einsum("fp,fp,pn->fn", self._weights, g, self._psi)
        whole_gap = sums(self.body.x, self.lam_places, weighted_gap)[self.lam_places]
        self._active = self._chosen(p - c * whole_gap / self._unit_weights > 0)
        rows = np.where(self._active, -weighted_gap, -p * self._share / c)
        places = np.concatenate([self._u_places.ravel(), self.lam_places.ravel()])
        found = sums(self.body.x, places, np.concatenate([traction.ravel(), rows.ravel()]))
        b.array[:] += found[: self.body.unknowns.owned]

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the derivative of `add_residual`, for the active set found there; constrained rows
        stay identity.
        """
        self._visit()
        _, normal, slope = self._evaluate()
        weights = self._weights
        p_h = self.nodal_pressures() @ self._psi.T
        coupling = -np.einsum("fp,fpd,pn,pm->fndm", weights, normal, self._N, self._psi)
        size = int(
            np.prod(self._u_places.shape[1:])
        )  # a rank may have no facet: numpy cannot infer sizes there
        coupling = coupling.reshape(len(coupling), size, self._psi.shape[1])
        mass = -self._share / self._scale
        uu = -np.einsum("fp,fpde,pn,pm->fndme", weights * p_h, slope, self._N, self._N).reshape(
            -1, size, size
        )
        u_places = self._u_places.reshape(len(uu), size)
        for f in range(len(uu)):
            lam = self.lam_places[f].astype(np.int32)
            active = self._active[f]
            add = PETSc.InsertMode.ADD
            u = np.where(self._held[u_places[f]], -1, u_places[f]).astype(
                np.int32
            )  # PETSc skips negative rows
            A.setValuesLocal(u, u, uu[f], addv=add)
            A.setValuesLocal(u, lam, coupling[f], addv=add)
            A.setValuesLocal(
                np.where(active, lam, np.int32(-1)),
                u,
                np.ascontiguousarray(coupling[f].T),
                addv=add,
            )
            A.setValuesLocal(lam, lam, np.diag(np.where(active, 0.0, mass[f])), addv=add)

    def _visit(self) -> None:
        """Remember the set of this Newton step, and how often one has come back after others."""
        mine = hash(np.unique(self._numbers[self._active]).tobytes())
        visit = tuple(self.body.comm.allgather(mine))
        if self._visited and visit != self._visited[-1] and visit in self._visited:
            self._returns += 1
        self._visited.append(visit)
        self._settled = self._active

    def _chosen(self, wanted: np.ndarray) -> np.ndarray:
        """The wanted set; once sets come back, the last one with its first node changed: no circle
        (Murty 1974).
        """
        if self._returns < RETURNS or self._settled is None:
            return wanted
        changed = self._numbers[wanted != self._settled]
        first = self.body.comm.allreduce(
            int(changed.min(initial=np.iinfo(np.int64).max)), op=MPI.MIN
        )
        return np.where(self._numbers == first, wanted, self._settled)

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """p_h (facets, points) at reference-facet points of the contact surface [pressure]."""
        return self.nodal_pressures() @ self.basis(points).T

    pressure_at = multiplier_at

    def force(self) -> float:
        """-int p_h dg/dz dGamma [force]: the vertical thrust of the pressures, this rank's share."""
        _, normal, _ = self._evaluate()
        p_h = self.nodal_pressures() @ self._psi.T
        return 0.0 - float(
            (self._weights * p_h * normal[..., -1]).sum()
        )  # not -0.0 where nothing is in contact


def _flat(expression: Expr) -> list[Expr]:
    return [expression[index] for index in np.ndindex(expression.ufl_shape)]
