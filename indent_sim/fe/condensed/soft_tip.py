"""A soft tip: the compliance of its surface is added to that of the body.

The tip is a second body, meshed upside down and condensed to its own surface. Its nodes lie at
other radii than those of the body, so that the pressure is transferred by a mortar projection: the
nodal forces F of the body have the pressure N_1 M_11^-1 F, whose nodal forces on the tip are

    F_2 = P F,   P = M_21 M_11^-1,   M_21 = int N_2 N_1 dA.

The resultant and the work of the pressure are conserved, and both surfaces approach each other by

    C = C_1 + P^T C_2 P,

which is all that the contact needs. If the displacement of the tip were interpolated instead, a
finer mesh of the tip would be loaded by point forces, and the force would be 1 % wrong. Source:
Wriggers, Computational Contact Mechanics (2006), 8.4 (mortar method).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from indent_sim.fe.condensed.compliance import Compliance, Condenser, surface_mass_matrix
from indent_sim.fe.condensed.resting_body import RestingBodyCondenser
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.shape_functions import shape_functions
from indent_sim.fe.surface import Trace
from indent_sim.model.body import Cylinder
from indent_sim.model.tip_track import TipTrack

# Gauss points between two neighbouring vertices of both surfaces: products of two quadratic shape
# functions, the radius and a smooth metric are integrated to round-off.
GAUSS_POINTS = 6
# Relative distance of nodes beyond the edge of a tip that is round-off of coordinates.
EDGE_TOLERANCE = 1e-9


class SoftTipCondenser:
    """Condenser of an axisymmetric body and of the soft tip above it.

    The class has all members of `Condenser` that the equilibrium uses. Supports, stored
    displacements and recovered fields are those of the body.

    Parameters
    ----------
    body, tip
        The condensers of body and tip, each in the scales of its scene.
    """

    def __init__(self, body: Condenser | RestingBodyCondenser, tip: Condenser):
        self.body_condenser = body
        self.tip_condenser = tip
        self.facet_rows = body.facet_rows
        self.support_surfaces = body.support_surfaces
        self.strain_energies = body.strain_energies
        self.count_candidates = body.count_candidates
        self.local_displacements = body.local_displacements
        self.recover = body.recover
        scales = body.body.scene.physics.scales
        tip_scales = tip.body.scene.physics.scales
        # The tip's units of length and of compliance, in units of the body.
        self._length_ratio = tip_scales.length / scales.length
        self._compliance_ratio = (scales.pressure * scales.length) / (
            tip_scales.pressure * tip_scales.length
        )
        self._ends_at_edge = isinstance(tip.body.scene.physics.body, Cylinder)
        self._rigid_tip: Compliance | None = None
        self._compliance: Compliance | None = None
        self._tip_compliance: Compliance | None = None
        self._transfer = np.zeros((0, 0))

    def condense(self, radius: float, track: TipTrack, axes: Sequence[int]) -> Compliance:
        """Return the compliance of both surfaces at the nodes of the body near the axis.

        The parameters are those of `Condenser.condense`; the radius is in the body's unit of
        length.
        """
        rigid_tip = self.body_condenser.condense(radius, track, axes)
        if self._compliance is not None and rigid_tip is self._rigid_tip:
            return self._compliance
        # The last facet of the body may end beyond the radius.
        reach = float(rigid_tip.tip_trace.X[..., 0].max()) / self._length_ratio
        self._tip_compliance = self.tip_condenser.condense(reach, TipTrack((0.0, 0.0)), axes)
        self._transfer = self._mortar_projection(rigid_tip, self._tip_compliance.trace)
        C = self._tip_compliance.C * self._compliance_ratio
        self._rigid_tip = rigid_tip
        self._compliance = replace(
            rigid_tip, matrix=rigid_tip.matrix + self._transfer.T @ C @ self._transfer
        )
        return self._compliance

    def _mortar_projection(self, body: Compliance, tip: Trace) -> np.ndarray:
        """Return the mortar projection matrix P (tip nodes, candidates of the body).

        P maps nodal forces on the body to the nodal forces on the tip.
        """
        surface = body.surface
        tip_surface = body.tip_surface
        count = 1 + int(surface.nodes.max())
        r, weight = _projection_points(tip_surface, tip, self._length_ratio)
        N1 = _shape_functions_at(tip_surface, r, 1.0, count)
        N2 = _shape_functions_at(tip, r, self._length_ratio, 1 + int(tip.nodes.max()))
        metric = _surface_metric(tip_surface, r)
        mixed = N2.T @ N1.multiply((2 * math.pi * weight * r * metric)[:, None])
        points, weights = contact_quadrature(surface.dim)
        r_points = surface.positions(points)[..., 0]
        areas = surface.measures(points) * weights * 2 * math.pi * r_points
        mass = surface_mass_matrix(surface, areas)
        forces = np.zeros((count, body.size))
        forces[body.candidates, np.arange(body.size)] = 1.0
        if not self._ends_at_edge:
            return np.asarray(mixed @ splu(mass).solve(forces))
        # The pressure ends in a step at the edge of the tip. Continued beyond it, a part of the
        # force would be lost.
        end = float(tip.X[..., 0].max()) * self._length_ratio
        is_inside = np.all(surface.X[..., 0] <= end * (1 + EDGE_TOLERANCE), axis=1)
        inside = np.unique(surface.nodes[is_inside])
        mass = surface_mass_matrix(surface.select_facets(is_inside), areas[is_inside])
        pressures = splu(csc_matrix(mass[inside][:, inside])).solve(forces[inside])
        return np.asarray(mixed[:, inside] @ pressures)

    def _tip_forces(self, nodal_forces: np.ndarray) -> np.ndarray:
        """Return the nodal forces on the tip from those on the body [force of the body]."""
        return self._transfer @ nodal_forces

    @property
    def observed_dofs(self) -> np.ndarray:
        """Local positions of the displacements of the body's surface; see `Condenser`."""
        return self.body_condenser.observed_dofs

    def tip_sink(self, nodal_forces: np.ndarray) -> float:
        """Return the displacement of the tip's apex towards its holder [length]."""
        assert self._tip_compliance is not None
        trace = self._tip_compliance.trace
        apex = trace.nodes.ravel()[np.argmin(np.abs(trace.X[..., 0]).ravel())]
        row = self._tip_compliance.C[apex] * self._compliance_ratio
        return float(row @ self._tip_forces(nodal_forces))

    def tip_energy(self, nodal_forces: np.ndarray) -> float:
        """Return the strain energy F_2 C_2 F_2/2 of the tip [energy]."""
        assert self._tip_compliance is not None
        forces = self._tip_forces(nodal_forces)
        return float(forces @ self._tip_compliance.C @ forces) * self._compliance_ratio / 2

    def tip_displacement(self, r: np.ndarray, nodal_forces: np.ndarray) -> np.ndarray:
        """Return the displacement of the tip's surface towards its holder at radii r [length].

        The displacement is constant beyond the nodes of the tip that the body may touch, where the
        tip ends or is far from the body.
        """
        assert self._tip_compliance is not None
        trace = self._tip_compliance.trace
        displacement = (
            self._tip_compliance.C * self._compliance_ratio @ self._tip_forces(nodal_forces)
        )
        last = float(trace.X[..., 0].max()) * self._length_ratio
        inside = np.minimum(np.abs(r).ravel(), last)
        values = (
            _shape_functions_at(trace, inside, self._length_ratio, len(displacement)) @ displacement
        )
        return np.asarray(values).reshape(r.shape)


def _vertex_radii(trace: Trace, unit: float) -> np.ndarray:
    """Return the sorted radii of the vertices of a surface."""
    return np.unique(np.round(trace.X[:, :2, 0] * unit, 14))


def _projection_points(body: Trace, tip: Trace, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss points and weights on the common range of radii r of both surfaces.

    The intervals end at the vertices of both meshes.
    """
    radii = [_vertex_radii(body, 1.0), _vertex_radii(tip, unit)]
    end = min(ends[-1] for ends in radii)
    breaks = np.unique(np.concatenate(radii))
    breaks = breaks[breaks <= end]
    x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    half = np.diff(breaks)[:, None] / 2
    middle = (breaks[:-1] + breaks[1:])[:, None] / 2
    return (middle + half * x).ravel(), (half * w).ravel()


def _facets_at(trace: Trace, r: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the facet at each radius and the point's coordinate on its reference facet.

    The radius on a facet is r_0 + b x + c x^2, from its vertices and its midpoint.
    """
    nodes = trace.X[..., 0] * unit
    order = np.argsort(nodes[:, :2].min(axis=1))
    begins = nodes[order, :2].min(axis=1)
    facets = order[np.clip(np.searchsorted(begins, r, side="right") - 1, 0, len(order) - 1)]
    first, second, midpoint = nodes[facets].T
    c = 2 * (first + second - 2 * midpoint)
    b = second - first - c
    root = np.sqrt(np.maximum(b * b + 4 * c * (r - first), 0.0))
    return facets, np.clip(2 * (r - first) / (b + np.copysign(root, b)), 0.0, 1.0)


def _shape_functions_at(trace: Trace, r: np.ndarray, unit: float, count: int) -> csc_matrix:
    """Return the matrix (points, count) of the shape functions of all nodes at radii r."""
    facets, x = _facets_at(trace, r, unit)
    values = shape_functions(np.ascontiguousarray(x[:, None]))
    rows = np.repeat(np.arange(len(r)), values.shape[1])
    return csc_matrix((values.ravel(), (rows, trace.nodes[facets].ravel())), shape=(len(r), count))


def _surface_metric(trace: Trace, r: np.ndarray) -> np.ndarray:
    """Return the length of the surface per unit radius at radii r; it is 1 on a flat top."""
    facets, x = _facets_at(trace, r, 1.0)
    first, second, midpoint = np.moveaxis(trace.X[facets], 1, 0)
    curvature = 2 * (first + second - 2 * midpoint)
    tangent = second - first - curvature + 2 * curvature * x[:, None]
    return np.asarray(np.linalg.norm(tangent, axis=1) / np.abs(tangent[:, 0]))
