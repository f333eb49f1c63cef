"""Present state of a condensed contact, in the form that `fe.postprocessing` evaluates."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.shape_functions import (
    interpolate_from_midpoints,
    pressure_shape_functions,
    shape_functions,
)


class CondensedState:
    """Gap, pressure and traction of a condensed contact; the same on every rank."""

    def __init__(self, contact: CondensedContact):
        self.contact = contact
        self.scene = contact.scene
        self.comm = MPI.COMM_SELF
        self.trace = contact.compliance.tip_trace
        self.friction = contact.friction
        self.fluid = None

    @property
    def depth(self) -> float:
        """Indentation depth delta [length]."""
        return self.contact.depth

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""
        return self.scene.physics.track.position(self.contact.slide)

    @property
    def E_star(self) -> float:
        """Contact modulus E* of the body and a soft tip, constant in time [pressure]."""
        return self.scene.physics.contact_modulus

    def tip_displacement(self, r: np.ndarray) -> np.ndarray:
        """Return zero, because this state's displacement includes that of a soft tip."""
        return np.zeros(r.shape)

    def nodal_displacement(self) -> np.ndarray:
        """Return the displacement (facets, nodes, dim) [length] with zero horizontal components.

        The horizontal components are not computed, because the gap of a condensed contact is
        evaluated at undeformed points and depends on the vertical displacement only. With a soft
        tip, the displacement is that of the body relative to the tip. For a body that rests on a
        flat, it includes the rigid motion of the body.
        """
        u = np.zeros(self.trace.X.shape)
        compliance = self.contact.compliance
        forces = self.contact.forces
        u[..., -1] = -(compliance.matrix @ forces.ravel())[: compliance.size][self.trace.nodes]
        if compliance.flat is not None:
            u[..., -1] -= self.motion
        return u

    @property
    def motion(self) -> float:
        """Rigid motion [length] of a body that rests on a flat, in excess of that of its spring."""
        return self.contact.motion

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Return the multiplier lam (facets, points) [pressure]."""
        return (
            self.contact.multiplier[self.contact.candidates][self.trace.nodes]
            @ self.basis(points).T
        )

    def basis(self, points: np.ndarray) -> np.ndarray:
        """Return the multiplier's shape functions (points, nodes) on the reference facet."""
        is_nodal = self.scene.physics.contact.multiplier == "nodal"
        return pressure_shape_functions(points) if is_nodal else shape_functions(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Return the contact pressure for output (facets, points) [pressure].

        On triangles it has no oscillation at the vertices, see `nodal_pressure`.
        """
        return (
            self.nodal_pressure()[self.contact.candidates][self.trace.nodes] @ self.basis(points).T
        )

    def nodal_pressure(self) -> np.ndarray:
        """Return the contact pressure for output at the nodes of the whole surface [pressure].

        Values at the vertices of triangles are interpolated from the midpoints of their edges.
        """
        lam = self.contact.multiplier
        nodes = self.contact.compliance.surface.nodes
        if self.scene.physics.contact.multiplier == "nodal" or not self.trace.has_ripples:
            return lam
        pressure = lam.copy()
        pressure[nodes] = interpolate_from_midpoints(
            lam[nodes], lambda values: np.bincount(nodes.ravel(), values.ravel())[nodes]
        )
        return pressure
