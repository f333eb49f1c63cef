"""Contact values of a row: contact radius, peak pressure, penetration and roughness."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.postprocessing.contact_area import (
    contact_area,
    contact_area_within_step,
    edge_corrected_pressure,
    edge_pressure_step,
    stick_radius,
    whole_face_area,
)
from indent_sim.fe.postprocessing.contact_sample import (
    PRESSURE_ROUNDOFF,
    ContactSample,
    ObservedBody,
    components_first,
    max_over_ranks,
    sample_contact,
)
from indent_sim.fe.postprocessing.penetration import overlap_depth
from indent_sim.fe.postprocessing.roughness import build_patches, roughness
from indent_sim.fe.quadrature import contact_quadrature, evaluation_points, facet_lattice


def contact_values(body: ObservedBody, force: float) -> dict[str, float]:
    """Contact values of the current state (collective).

    Under surface tension the pressure drops to zero in a step, which the mesh smears over several
    elements with oscillating nodal values. The contact edge then follows from the step
    (`contact_area_within_step`), and the peak pressure from means over facets
    (`_peak_of_facet_means`).

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    force : float
        Force on the tip of the whole body [force].

    Returns
    -------
    a : float
        Contact radius sqrt(area/pi) of the region with p_hat > 0, or half its width in plane strain
        [length]. p_hat is interpolated linearly in the simplices into which a facet is divided.
        With a current gap, the region on the deformed surface is projected on the horizontal plane.
        If the whole face of a tip with a sharp edge is in contact, the area of the face is used
        (`whole_face_area`). The radius is 0 for delta <= 0 unless the tip adheres or the body
        swells.
    p_max : float
        Peak pressure over contact quadrature points and nodes [pressure]; NaN where the pressure is
        unbounded (`Scene.has_peak_pressure`).
    penetration : float
        Largest <-g> over the contact quadrature points [length].
    overlap : float
        Largest depth of a whole facet inside the tip's shape, which the gap function may not show;
        0 with a reference gap [length].
    roughness : float
        Amplitude of the pressure's oscillation from node to node, divided by the peak pressure; 0
        where it cannot be assessed (`roughness`), and under sharp tips on bodies that do not yield.
    stick_radius : float
        Radius of the sticking part of the contact [length]; only with friction.
    """
    dim = body.trace.dim
    grid = facet_lattice(dim)[0]
    (quadrature_points, weights) = contact_quadrature(dim)
    sample = sample_contact(body, evaluation_points(dim))
    begin = len(grid)
    end = len(grid) + len(quadrature_points)
    positions = sample.X if body.scene.physics.gap == "reference" else sample.X + sample.u
    lattice_points = sample.X[:, :begin, :-1], positions[:, :begin, :-1]
    trial_pressure = edge_corrected_pressure(
        body, sample.trial_pressure[:, :begin], sample.gap[:, :begin]
    )
    size = whole_face_area(body, lattice_points[0], trial_pressure) or contact_area(
        body, *lattice_points, trial_pressure
    )
    size = contact_area_within_step(body, lattice_points, trial_pressure, size, force)
    if body.depth <= 0 and not _may_touch_unindented(body, sample.pressure):
        size = 0.0  # the computed contact is round-off
    if force <= 0 and body.scene.physics.yields:
        size = 0.0  # the imprint touches at most between the points of the contact
    a = body.scene.physics.domain.kinematics.contact_radius(size)
    pressure = (
        _peak_of_facet_means(
            body, sample.pressure[:, begin:end] @ weights / weights.sum(), size, force
        )
        if body.scene.physics.surface_tension
        else sample.pressure[:, begin:]
    )
    deepest = (-sample.gap[:, begin:end]).max(initial=0.0)
    overlap = overlap_depth(body, sample.X + sample.u, sample.gap)
    # In a body that yields the pressure is bounded under sharp tips, too
    is_assessed = body.scene.has_peak_pressure(a) or body.scene.physics.yields
    roughness_value = (
        _roughness_amplitude(body, sample, positions, end) if a > 0 and is_assessed else 0.0
    )
    peak_pressure, penetration_depth, overlap, roughness_value = max_over_ranks(
        body, pressure.max(initial=0.0), deepest, overlap, roughness_value
    )
    roughness_value = (
        roughness_value / peak_pressure if peak_pressure > PRESSURE_ROUNDOFF * body.E_star else 0.0
    )
    peak_pressure = peak_pressure if body.scene.has_peak_pressure(a) else float("nan")
    values = {
        "a": a,
        "p_max": peak_pressure,
        "penetration": penetration_depth,
        "overlap": overlap,
        "roughness": roughness_value,
    }
    return values | (
        {"stick_radius": stick_radius(body, a, sample, positions, grid)} if body.friction else {}
    )


def _peak_of_facet_means(
    body: ObservedBody, means: np.ndarray, size: float, force: float
) -> np.ndarray:
    """Estimates (facets + 1,) of the peak pressure from the mean pressure of each facet [pressure].

    The mean over a facet of the size h at the apex of a round tip is lower than the peak p by (p -
    p_edge) (h/a)^2/6 if the pressure is p_edge + (p - p_edge) (1 - r^2/a^2)^(1/2), with the step
    p_edge at the contact edge. The last entry is the mean over the contact area, a lower bound of
    the peak; it is the largest entry if the contact is smaller than a facet.
    """
    if not size:
        return means
    a = body.scene.physics.domain.kinematics.contact_radius(size)
    excess = np.maximum(means - edge_pressure_step(body, size, force), 0.0)
    deficits = excess * np.minimum(body.trace.facet_sizes / a, 1.0) ** 2 / 6
    return np.append(means + deficits, force / size)


def _may_touch_unindented(body: ObservedBody, pressure: np.ndarray) -> bool:
    """Return whether there may be contact at delta <= 0 by adhesion or swelling (collective)."""
    physics = body.scene.physics
    if not physics.is_time_dependent:
        return physics.contact.may_snap_through
    largest = body.comm.allreduce(float(pressure.max(initial=0.0)), op=MPI.MAX)
    return bool(largest > PRESSURE_ROUNDOFF * body.E_star)


def _roughness_amplitude(
    body: ObservedBody, sample: ContactSample, positions: np.ndarray, first_node: int
) -> float:
    """Amplitude of the pressure's oscillation on rank 0 [pressure], 0 elsewhere (collective).

    Parameters
    ----------
    body : ObservedBody
        State of the body.
    sample : ContactSample
        Contact fields; the points from number `first_node` on are the nodes of the facets.
    positions : ndarray, (facets, points, dim)
        Positions of the points under the tip [length].
    first_node : int
        Number of the point that is the first node.
    """
    horizontal = body.scene.physics.domain.kinematics.horizontal_position(
        components_first(positions[:, first_node:]), body.tip_center
    )
    nodal: Any = (
        sample.X[:, first_node:],
        sample.pressure[:, first_node:],
        sample.trial_pressure[:, first_node:] > 0,
        np.hypot(*horizontal),
    )
    if body.comm.size > 1:
        gathered = body.comm.gather(nodal, root=0)
        if gathered is None:
            return 0.0
        nodal = [np.concatenate(part) for part in zip(*gathered, strict=True)]
    X, pressure, touches, distance = nodal
    # The surroundings of the contact are needed to distinguish them from a hole inside it
    near_facets = np.flatnonzero(distance.min(axis=1) <= 1.5 * distance[touches].max(initial=0.0))
    return roughness(
        build_patches(X[near_facets]),
        pressure[near_facets],
        touches[near_facets],
        distance[near_facets],
        body.scene.physics.indenter,
    )
