"""Frictionless contact of two bodies at finite strain: the body's surface on that of a soft tip.

The gap of a point x = (r, z) of the body's contact surface is its vertical distance from the tip's
deformed meridian z_2(r), whose frame moves down by the depth,

    g = z_2(r) - delta - z,   dg = N_2 du_2z - s N_2 du_2r + s du_r - du_z,   s = dz_2/dr.

The variation of the gap contains the displacement of the tip at the place opposite to the point,
which no UFL form can express. With the multiplier lam, an unknown field on the surface, the
potential is that of the augmented Lagrangian method: int (<lam - epsilon g>^2 - lam^2)/(2 epsilon)
dGamma. The pressure <lam - epsilon g> is the vertical traction on the undeformed surface of the
body, and

    d(dg) = dx W + W dx + (z_2'' - s r_2'') dx dx,
    dx = (du_r - N_2 du_2r)/r_2',   W = N_2' (du_2z - s du_2r)

is the second variation of the gap, with x the coordinate along a segment of the meridian and ' the
derivative with respect to it. Source: Wriggers, Computational Contact Mechanics (2006), 9.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.nodal_assembly import sum_nodal_contributions
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.shape_functions import shape_functions
from indent_sim.fe.terms.contact.meridian import Meridian, MeridianPoints
from indent_sim.fe.terms.contact.multiplier import SurfaceMultiplier
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.mesh.two_bodies import TIP_PREFIX
from indent_sim.model.contact import AugmentedLagrangian

# Undeformed radius up to which the surface of a tip may be touched, relative to that of the tip:
# near the equator of a ball its deformed surface is no graph over the radius.
MAX_RADIUS_FRACTION = 0.9
# Local degrees of freedom of a point: r and z of three nodes of the body, then of the tip.
BODY_R = [0, 2, 4]
BODY_Z = [1, 3, 5]
TIP_R = [6, 8, 10]
TIP_Z = [7, 9, 11]


@dataclass(frozen=True)
class PointContact:
    """Contact at the quadrature points of the contact surface, (n,) each.

    Attributes
    ----------
    opposite : MeridianPoints
        The points of the tip opposite to the quadrature points.
    gap : ndarray
        Gap g [length]; infinite beyond the end of the tip.
    lam : ndarray
        Multiplier [pressure].
    pressure : ndarray
        Vertical traction <lam - epsilon g> [pressure].
    """

    opposite: MeridianPoints
    gap: np.ndarray
    lam: np.ndarray
    pressure: np.ndarray


class SoftTipContact(Term):
    """Contact of the body with a soft tip at finite strain, assembled in numpy."""

    field_names = ("lam",)
    couples_surfaces = True

    def __init__(self, body: Body):
        self.body = body
        law = body.scene.physics.contact
        assert isinstance(law, AugmentedLagrangian)
        assert law.epsilon_n != "auto"
        self._law_stiffness = float(law.epsilon_n)
        self.surface_multiplier = SurfaceMultiplier(body)
        self._stiffness = self._law_stiffness
        self._curvature_is_limited = False
        self.begin_solve()
        tip = body.surface_trace(TIP_PREFIX + "top")
        self.meridian = Meridian(tip.X, tip.dofs, MAX_RADIUS_FRACTION * float(tip.X[..., 0].max()))
        self._tip_dofs = self.meridian.dofs.reshape(len(self.meridian.dofs), 6)
        points, weights = contact_quadrature(2)
        trace = body.trace
        self._facets, self._points = (
            values.ravel()
            for values in np.meshgrid(
                np.arange(len(trace.nodes)), np.arange(len(points)), indexing="ij"
            )
        )
        self._N = shape_functions(points)[self._points]
        areas = 2 * np.pi * trace.positions(points)[..., 0] * trace.measures(points)
        self._areas = (areas * weights).ravel()
        self._u_dofs = trace.dofs.reshape(len(trace.nodes), 6)
        self._lam_dofs = self.surface_multiplier.node_dofs
        self._is_constrained = (
            sum_nodal_contributions(
                body.x, body.constrained_dofs, np.ones(len(body.constrained_dofs))
            )
            > 0
        )

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> None:
        """Return None, because `add_residual` assembles the residual without a UFL form."""

    def begin_solve(self) -> None:
        """Discard the segments of the tip at which the points were in the previous solve."""
        self._kept_segments: np.ndarray | None = None

    def limit_curvature(self, *, is_limited: bool) -> None:
        """Switch the limit of the pressure in the second variation of the gap on or off.

        See `Traction.tangent`.
        """
        self._curvature_is_limited = is_limited

    def scale_stiffness(self, factor: float) -> None:
        """Set the augmented Lagrangian's stiffness to `factor` times its value in the law."""
        self._stiffness = factor * self._law_stiffness

    def _evaluate(self) -> PointContact:
        """Evaluate the contact at the quadrature points in the present state."""
        solution = self.body.local_array()
        trace = self.body.trace
        x = np.einsum("pn,pnd->pd", self._N, (trace.X + solution[trace.dofs])[self._facets])
        opposite = Meridian.points_at(
            self.meridian.positions(solution), x[:, 0], self._kept_segments
        )
        self._kept_segments = opposite.segments
        depth = float(self.body.now.delta.value)
        gap = np.where(opposite.is_inside, opposite.height - depth - x[:, 1], np.inf)
        lam = np.einsum("pn,pn->p", self._N, solution[self._lam_dofs[self._facets]])
        return PointContact(opposite, gap, lam, np.maximum(lam - self._stiffness * gap, 0.0))

    def _gap_variation(self, contact: PointContact) -> np.ndarray:
        """Return the variation dg (points, 12) for the degrees of freedom of body and tip."""
        opposite = contact.opposite
        slope = opposite.slope[:, None]
        variation = np.zeros((len(slope), 12))
        variation[:, BODY_R] = slope * self._N
        variation[:, BODY_Z] = -self._N
        variation[:, TIP_R] = -slope * opposite.N
        variation[:, TIP_Z] = opposite.N
        return variation

    def _second_variation(self, contact: PointContact) -> np.ndarray:
        """Return the second variation of the gap (points, 12, 12)."""
        opposite = contact.opposite
        slope = opposite.slope[:, None]
        shift = np.zeros((len(slope), 12))
        shift[:, BODY_R] = self._N
        shift[:, TIP_R] = -opposite.N
        shift /= opposite.tangent[:, :1]
        change = np.zeros_like(shift)
        change[:, TIP_Z] = opposite.slopes
        change[:, TIP_R] = -slope * opposite.slopes
        bend = opposite.curvature[:, 1] - slope[:, 0] * opposite.curvature[:, 0]
        mixed = np.einsum("pi,pj->pij", shift, change)
        return np.asarray(
            mixed + mixed.transpose(0, 2, 1) + np.einsum("p,pi,pj->pij", bend, shift, shift)
        )

    def _local_dofs(self, contact: PointContact) -> np.ndarray:
        """Return the local degrees of freedom (points, 12) of body and tip."""
        return np.hstack([self._u_dofs[self._facets], self._tip_dofs[contact.opposite.segments]])

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add -int p dg to the displacement rows and int (p - lam)/epsilon to the rows of lam."""
        contact = self._evaluate()
        touches = contact.pressure > 0
        traction = (self._areas * contact.pressure)[touches, None]
        work = -traction * self._gap_variation(contact)[touches]
        misfit = self._areas * (contact.pressure - contact.lam) / self._stiffness
        dofs = np.concatenate(
            [self._local_dofs(contact)[touches].ravel(), self._lam_dofs[self._facets].ravel()]
        )
        values = np.concatenate([work.ravel(), (misfit[:, None] * self._N).ravel()])
        assembled = sum_nodal_contributions(self.body.x, dofs, values)
        b.array[:] += assembled[: self.body.unknowns.owned_count]

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the derivative of `add_residual`; rows of constrained dofs remain identity rows."""
        contact = self._evaluate()
        touches = contact.pressure > 0
        pressure = contact.pressure
        if self._curvature_is_limited:
            pressure = np.minimum(pressure, np.maximum(contact.lam, 0.0))
        variation = self._gap_variation(contact)
        local = np.zeros((len(touches), 15, 15))
        uu = self._stiffness * np.einsum("pi,pj->pij", variation, variation)
        uu -= pressure[:, None, None] * self._second_variation(contact)
        local[:, :12, :12] = uu
        coupling = -np.einsum("pi,pn->pin", variation, self._N)
        local[:, :12, 12:] = coupling
        local[:, 12:, :12] = coupling.transpose(0, 2, 1)
        local[~touches] = 0.0
        mass = np.where(touches, 0.0, -1 / self._stiffness)
        local[:, 12:, 12:] = np.einsum("p,pn,pm->pnm", mass, self._N, self._N)
        local *= self._areas[:, None, None]
        self._insert(A, contact, touches, local)

    def _insert(
        self, A: PETSc.Mat, contact: PointContact, touches: np.ndarray, local: np.ndarray
    ) -> None:
        """Add matrices (points, 15, 15) of the quadrature points, summed over pairs of facets."""
        segments = np.where(touches, contact.opposite.segments, -1)
        pairs, number = np.unique(
            np.column_stack([self._facets, segments]), axis=0, return_inverse=True
        )
        summed = np.zeros((len(pairs), 15, 15))
        np.add.at(summed, number.ravel(), local)
        for (facet, segment), values in zip(pairs, summed, strict=True):
            lam = self._lam_dofs[facet].astype(np.int32)
            if segment < 0:
                A.setValuesLocal(lam, lam, values[12:, 12:], addv=PETSc.InsertMode.ADD)
                continue
            u = np.concatenate([self._u_dofs[facet], self._tip_dofs[segment]])
            # PETSc ignores negative rows and columns.
            free = np.where(self._is_constrained[u], -1, u).astype(np.int32)
            dofs = np.concatenate([free, lam]).astype(np.int32)
            A.setValuesLocal(dofs, dofs, values, addv=PETSc.InsertMode.ADD)

    def force(self) -> float:
        """Vertical force of the pressure, dPi/d(delta) [force]."""
        return float((self._areas * self._evaluate().pressure).sum())

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Multiplier (facets, points), a vertical traction on the undeformed area [pressure]."""
        return self.surface_multiplier.values_at_points(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Normal traction (facets, points) on the undeformed area [pressure].

        The traction is normal to the tip, and its vertical part is the multiplier.
        """
        trace = self.body.trace
        r = trace.interpolate(trace.X + self.body.nodal_displacement(), points)[..., 0]
        slope = self.surface_at(r.ravel()).slope.reshape(r.shape)
        return self.surface_multiplier.smooth_values_at(points) * np.sqrt(1 + slope**2)

    def surface_at(self, r: np.ndarray) -> MeridianPoints:
        """Return the points of the tip's deformed surface at radii r (n,) [length]."""
        return Meridian.points_at(self.meridian.positions(self.body.local_array()), r)

    @property
    def end_radius(self) -> float:
        """Radius at which the part of the tip's surface ends that may be touched [length]."""
        return float(self.meridian.positions(self.body.local_array())[-1, 1, 0])

    def impossibility(self) -> str:
        """Return the reason why the contact is not admissible; "" if it is admissible."""
        contact = self._evaluate()
        touches = contact.pressure > 0
        segments = contact.opposite.segments[touches]
        if not len(segments):
            return ""
        positions = self.meridian.positions(self.body.local_array())
        if segments.max() >= len(positions) - 1:
            return "the contact reaches the end of the soft tip's lower surface"
        if not Meridian.is_graph(positions, float(positions[segments.max(), 1, 0])):
            return "the soft tip's surface folds over below the contact"
        return ""
