"""Contact fields at points of the contact surface: gap, trial pressure, pressure and tractions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from indent_sim.fe.measured_constants import EDGE_STIFFNESS_FACTOR, EDGE_TENSION_FACTOR
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.surface import Trace
from indent_sim.model.tips import gap_current, gap_reference
from indent_sim.scene.scene import Scene

# Pressures below this fraction of E* are round-off
PRESSURE_ROUNDOFF = 1e-8


class ObservedBody(Protocol):
    """State of a body whose contact can be evaluated.

    Attributes
    ----------
    scene : Scene
        The scene.
    comm : MPI.Comm
        Communicator.
    trace : Trace
        Facets of the contact surface.
    friction : object or None
        `shear_at(points)` is the tangential multiplier tau (facets, points, axes) [pressure].
        `stick_margin_at(points)` is friction p - |t_hat| (facets, points) [pressure], >= 0 where
        the surface sticks; only `contact_values` needs this method. `CondensedState` has this
        method; the whole body that is recovered for tables and fields does not.
    fluid : object or None
        `pressure_at(points)` is the pore pressure (facets, points) relative to the bath [pressure].
    """

    scene: Scene
    comm: Any
    trace: Trace
    friction: Any
    fluid: Any

    @property
    def depth(self) -> float:
        """Indentation depth delta [length]."""

    @property
    def E_star(self) -> float:
        """Current plane-strain modulus of the region under the tip [pressure]."""

    @property
    def tip_center(self) -> tuple[float, ...]:
        """Horizontal position of the tip's axis [length]."""

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim) of the contact surface [length]."""

    def tip_displacement(self, r: np.ndarray) -> np.ndarray:
        """Displacement of a soft tip's surface towards its holder at radii [length]."""

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Contact multiplier lam (facets, points) [pressure]."""

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Contact pressure (facets, points) without oscillations of the multiplier [pressure]."""


@dataclass(frozen=True)
class ContactSample:
    """Contact fields at points of the contact facets.

    Attributes
    ----------
    X, u : ndarray, (facets, points, dim)
        Undeformed position and displacement [length].
    gap : ndarray, (facets, points)
        Gap g, >= 0 open [length].
    trial_pressure : ndarray, (facets, points)
        Nominal trial pressure p_hat, < 0 out of contact [pressure].
    pressure : ndarray, (facets, points)
        Pressure, < 0 only by the attraction of an adhesive tip; per undeformed area with a
        reference gap, per deformed area with a current gap [pressure].
    area_ratio : ndarray, (facets, points), or float
        Deformed area divided by undeformed area.
    """

    X: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    trial_pressure: np.ndarray
    pressure: np.ndarray
    area_ratio: Any


def sample_contact(body: ObservedBody, points: np.ndarray) -> ContactSample:
    """Evaluate the contact fields at points (n, dim - 1) of each contact facet of this rank."""
    scene = body.scene
    trace = body.trace
    nodal = body.nodal_displacement()
    X = trace.positions(points)
    u = trace.interpolate(nodal, points)
    gap = gap_of_displacement(body, trace, points, u)
    trial_pressure = body.multiplier_at(points) - _edge_stiffness(body) * gap
    pressure = np.where(trial_pressure > 0, np.maximum(body.pressure_at(points), 0.0), 0.0)
    if adhesion := scene.physics.contact.adhesion:
        pressure = pressure - adhesion.attraction(gap)
    area_ratio = _area_ratio(body, nodal, points, X, u) if scene.physics.gap == "current" else 1.0
    return ContactSample(X, u, gap, trial_pressure, pressure / area_ratio, area_ratio)


def touching_corners(body: ObservedBody) -> np.ndarray:
    """Mask (facets, corners) of the corners of contact facets that are in contact.

    The criterion is the same as for the contact radius: p_hat > 0, up to round-off.
    """
    trial_pressure = sample_contact(body, body.trace.node_points()[: body.trace.dim]).trial_pressure
    return np.asarray(trial_pressure > PRESSURE_ROUNDOFF * body.E_star)


def _edge_stiffness(body: ObservedBody) -> np.ndarray:
    """Stiffness (facets, 1) [pressure/length] in the trial pressure that locates the contact edge.

    Multiplier and gap are combined, because the multiplier oscillates outside of the contact and
    the gap is noisy inside. A surface tension gamma adds a part of gamma/h^2, the stiffness of a
    membrane over the length h of a facet.
    """
    physics = body.scene.physics
    sizes = body.trace.facet_sizes[:, None]
    stiffness = EDGE_STIFFNESS_FACTOR[physics.domain.regions[0].formulation] * body.E_star / sizes
    return stiffness + EDGE_TENSION_FACTOR * physics.surface_tension / sizes**2


def gap(body: ObservedBody, points: np.ndarray) -> np.ndarray:
    """Gap g (facets, points) at points of each contact facet of this rank, >= 0 open [length]."""
    return gap_of_displacement(
        body, body.trace, points, body.trace.interpolate(body.nodal_displacement(), points)
    )


def smallest_gap(body: ObservedBody) -> float:
    """Smallest vertical distance of the tip above the contact surface [length] (collective)."""
    physics = body.scene.physics
    trace = body.trace
    points = np.vstack([contact_quadrature(trace.dim)[0], trace.node_points()])
    X = body.trace.positions(points)
    u = body.trace.interpolate(body.nodal_displacement(), points)
    positions = components_first(X if physics.gap == "reference" else X + u)
    height = physics.indenter.height(
        *physics.domain.kinematics.horizontal_position(positions, body.tip_center)
    )
    g = height - body.depth - (X[..., -1] + u[..., -1])
    return float(body.comm.allreduce(float(g.min(initial=np.inf)), op=MPI.MIN))


def gap_of_displacement(
    body: ObservedBody, trace: Trace, points: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Gap g (facets, points) at points of a trace [length].

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    trace : Trace
        Facets.
    points : ndarray, (points, dim - 1)
        Points of the reference facet.
    u : ndarray, (facets, points, dim)
        Displacement at the points [length].
    """
    physics = body.scene.physics
    X = trace.positions(points)

    def horizontal_position(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return physics.domain.kinematics.horizontal_position(components_first(x), body.tip_center)

    if physics.gap == "current" and physics.indenter.elastic_part:
        r, _ = horizontal_position(X + u)
        tip_height = physics.indenter.height(r, 0.0 * r) + body.tip_displacement(r)
        return tip_height - body.depth - X[..., -1] - u[..., -1]
    if physics.gap == "current":
        x, y = horizontal_position(X + u)
        return gap_current(physics.indenter, x, y, X[..., -1] + u[..., -1], body.depth)
    x, y = horizontal_position(X)
    gap = gap_reference(physics.indenter, x, y, X[..., -1], 0.0) - body.depth - u[..., -1]
    return gap + body.tip_displacement(x) if physics.indenter.elastic_part else gap


def _area_ratio(
    body: ObservedBody, nodal: np.ndarray, points: np.ndarray, X: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Deformed area divided by undeformed area (facets, points)."""
    trace = body.trace
    area_before, area_after = (
        _tangent_measure(trace.tangents(positions, points))
        for positions in (trace.X, trace.X + nodal)
    )
    if body.scene.physics.domain.kinematics.name != "axisymmetric":
        return area_after / area_before
    # The limit of u_r/r on the axis is du_r/dr, so that both stretches of the surface are equal; r
    # is round-off there and not exactly 0
    radius = X[..., 0]
    is_off_axis = radius > 1e-9 * area_before
    hoop_stretch = np.where(
        is_off_axis, 1 + u[..., 0] / np.where(is_off_axis, radius, 1.0), area_after / area_before
    )
    return area_after / area_before * hoop_stretch


def _tangent_measure(tangents: np.ndarray) -> np.ndarray:
    """Length of one tangent, or area of the parallelogram of two tangents."""
    if tangents.shape[-1] == 1:
        return np.linalg.norm(tangents[..., 0], axis=-1)
    return np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)


def tractions(body: ObservedBody, sample: ContactSample, points: np.ndarray) -> np.ndarray:
    """Pressure and, with friction, shear traction of the contact facets.

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    sample : ContactSample
        Contact fields at the points.
    points : ndarray, (points, dim - 1)
        Points of the reference facet.

    Returns
    -------
    ndarray, (facets, points, 1 or 2)
        Tractions per undeformed area with a reference gap, per deformed area with a current gap
        [pressure].
    """
    if not body.friction:
        return sample.pressure[..., None]
    tau = body.friction.shear_at(points)
    shear = tau[..., 0] if body.trace.dim == 2 else np.linalg.norm(tau, axis=-1)
    return np.stack(
        [sample.pressure, np.where(sample.trial_pressure > 0, shear, 0.0) / sample.area_ratio],
        axis=-1,
    )


def max_over_ranks(body: ObservedBody, *numbers: float) -> list[float]:
    """Maximum of each number over all ranks (collective)."""
    largest = np.array(numbers, dtype=float)
    if body.comm.size > 1:
        body.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    return list(map(float, largest))


def min_over_ranks(body: ObservedBody, *numbers: float) -> list[float]:
    """Minimum of each number over all ranks (collective)."""
    return [-number for number in max_over_ranks(body, *(-number for number in numbers))]


def components_first(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (*, axes) with the axis of components first (axes, *)."""
    return vectors.transpose(vectors.ndim - 1, *range(vectors.ndim - 1))
