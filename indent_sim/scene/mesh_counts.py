"""Predicted numbers of cells, nodes and vertices of a mesh, from its element sizes.

The numbers are proportional to the integral of 1/size^dim over the model domain and, in three
dimensions, of 1/size^2 over its surface. The factors were fitted to meshes of gmsh;
tests/physics/test_cost.py compares the counts with meshes.
"""

from __future__ import annotations

from math import pi

import numpy as np

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import DrainedFace, Sizes
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.layers import Coating
from indent_sim.scene.measured_constants import (
    COUNTS_2D,
    COUNTS_3D,
    FACETS_PER_AREA,
    NODES_PER_FACET,
)

INTEGRAL_POINTS = 50  # points of an integral over a body, in each direction


def mesh_counts(sizes: Sizes, domain: ModelDomain) -> dict[str, float]:
    """Return the numbers of cells, nodes of quadratic elements, and vertices of the mesh."""
    if isinstance(domain, ImportedDomain):
        mesh_size = domain.mesh.statistics
        refinement_factor = 2 ** (domain.dim * (sizes.refinements or 0))
        # The number of edges follows from Euler's formula for a body without holes.
        nodes = (
            2 * mesh_size.points
            + mesh_size.cells
            + (0 if domain.dim == 2 else mesh_size.boundary_facets / 2)
        )
        return {
            "cells": mesh_size.cells * refinement_factor,
            "nodes": nodes * refinement_factor,
            "vertices": mesh_size.points * refinement_factor,
        }
    extra_elements = sum(
        _inclusion_elements(*feature, sizes, domain) for feature in sizes.inclusions
    )
    extra_elements += sum(_coating_elements(*feature, sizes, domain) for feature in sizes.coatings)
    extra_elements += sum(_film_elements(film, sizes, domain) for film in sizes.drained_faces)
    if domain.dim == 2:
        area = _inverse_square_integral(sizes, domain) + extra_elements
        return {name: factor * area for name, factor in COUNTS_2D.items()}
    volume, surface = _inverse_size_integrals(sizes, domain)
    return {
        name: inside * (volume + extra_elements) + outside * surface
        for name, (inside, outside) in COUNTS_3D.items()
    }


def _inverse_square_integral(sizes: Sizes, domain: ModelDomain) -> float:
    """Return the integral of 1/size^2 over a section."""
    r, wr = _log_grid(max(abs(end - sizes.axis[0]) for end in domain.extent[0]), sizes.axis_size)
    z, wz = _log_grid(domain.height, sizes.axis_size)
    density = 1 / sizes.size_at(r[:, None], z[None, :]) ** 2
    ring_weight = _ring_weight(r, 2, _sector_count(sizes, domain))
    total = float((density * (ring_weight * wr)[:, None] * wz[None, :]).sum())
    if sizes.track is None:
        return total
    # The section is divided at the track's middle; its length is added between the halves
    return total + sizes.track.length * float((wz / sizes.size_at(np.zeros(1), z) ** 2).sum())


def _inverse_size_integrals(sizes: Sizes, domain: ModelDomain) -> tuple[float, float]:
    """Return the integrals of 1/size^3 over the body and of 1/size^2 over its surfaces.

    The interfaces between layers count as surfaces.
    """
    (x, wx), (y, wy) = (
        _two_sided_grid(*ends, c, sizes)
        for ends, c in zip(domain.extent[:-1], sizes.axis, strict=True)
    )
    depth, wz = _log_grid(domain.height, sizes.axis_size, INTEGRAL_POINTS)
    is_inside = np.all(
        [side.inward_distance(x[:, None], y[None, :]) >= 0 for side in domain.outline], axis=0
    )
    weight = wx[:, None] * wy[None, :] * is_inside
    r = np.hypot(x[:, None] - sizes.axis[0], y[None, :] - sizes.axis[1])
    volume = sum(
        w * (weight / sizes.size_at(r, np.array(z)) ** 3).sum()
        for z, w in zip(depth, wz, strict=True)
    )
    levels = [0.0, domain.height, *(-z for z in domain.interfaces)]
    surface = sum((weight / sizes.size_at(r, np.array(z)) ** 2).sum() for z in levels)
    if sizes.track is not None:
        # The body is divided at the axis, and a prism as long as the track is added
        across = y if sizes.track.axis == 0 else x
        w_across = wy if sizes.track.axis == 0 else wx
        distance = np.abs(across - sizes.axis[1 - sizes.track.axis])
        section = sizes.size_at(distance[:, None], depth[None, :])
        volume += sizes.track.length * (w_across[:, None] * wz[None, :] / section**3).sum()
        surface += sizes.track.length * sum(
            (w_across / sizes.size_at(distance, np.array(z)) ** 2).sum() for z in levels
        )
    for side in domain.outline:
        side_points, length = side.sample_points(INTEGRAL_POINTS)
        distance = np.hypot(side_points[:, 0] - sizes.axis[0], side_points[:, 1] - sizes.axis[1])
        surface += (
            length * wz[None, :] / sizes.size_at(distance[:, None], depth[None, :]) ** 2
        ).sum()
    return float(volume), float(surface)


def _two_sided_grid(
    low: float, high: float, c: float, sizes: Sizes
) -> tuple[np.ndarray, np.ndarray]:
    """Return quadrature points and weights from the tip's axis to the ends at low and high."""
    directions = [
        (sign, abs(end - c))
        for sign, end in ((-1, low), (1, high))
        if abs(end - c) > 1e-9 * (high - low)
    ]
    grids = [
        (sign, *_log_grid(length, sizes.axis_size, INTEGRAL_POINTS)) for sign, length in directions
    ]
    points = np.concatenate([c + sign * x for sign, x, _ in grids])
    return points, np.concatenate([w for _, _, w in grids])


def _inclusion_elements(
    inclusion: Inclusion, h_inside: float, sizes: Sizes, domain: ModelDomain
) -> float:
    """Return the number of elements that refinement inside and around an inclusion adds.

    Mirror images are not counted, since they lie outside the model domain.
    """
    dim = domain.dim
    distances = np.concatenate([[0.0], np.geomspace(h_inside / 4, domain.max_extent, 200)])
    h_around = np.minimum(
        h_inside + sizes.grading * (distances[1:] + distances[:-1]) / 2, sizes.h_far
    )
    volume = inclusion.measure_within_distance(distances, dim)
    domains_sharing = domain.symmetry_factor * (2 if domain.symmetry == "axisymmetric" else 1)
    *horizontal, z = inclusion.center
    r = np.linalg.norm([c - axis for c, axis in zip(horizontal, (*sizes.axis, 0.0), strict=False)])
    h_without = sizes.size_at(np.array(r), np.array(-z))
    extra_densities = [
        np.maximum(1 / h**dim - 1 / h_without**dim, 0.0) for h in (h_inside, h_around)
    ]
    return (
        float(volume[0] * extra_densities[0] + (np.diff(volume) * extra_densities[1]).sum())
        / domains_sharing
    )


def _coating_elements(
    coating: Coating, h_inside: float, sizes: Sizes, domain: ModelDomain
) -> float:
    """Return the number of elements that a coating adds to the section of a cap or ball."""
    distances = np.concatenate([[0.0], np.geomspace(h_inside / 4, coating.outer_radius, 200)])
    h_around = np.minimum(
        h_inside + sizes.grading * (distances[1:] + distances[:-1]) / 2, sizes.h_far
    )
    inwards = np.diff(np.maximum(coating.inner_radius - distances, 0.0) ** 2) / -2
    angle = pi
    if domain.height < 2 * coating.outer_radius:
        angle = np.arccos(1 - domain.height / coating.outer_radius)
    areas = (
        np.concatenate([[(coating.outer_radius**2 - coating.inner_radius**2) / 2], inwards]) * angle
    )
    extra_densities = 1 / np.concatenate([[h_inside], h_around]) ** 2 - 1 / sizes.h_far**2
    return float((areas * np.maximum(extra_densities, 0.0)).sum())


def _film_elements(film: DrainedFace, sizes: Sizes, domain: ModelDomain) -> float:
    """Return the number of elements that refinement at a drained face adds to a section.

    The number is the integral of max(0, 1/(h + grading d)^2 - 1/h_0^2) over the distance d from the
    face and the length s along the face from the point closest to the tip. Here h is the element
    size at the face, and h_0 the element size without this refinement.
    """
    (x0, z0) = film.side.start
    (x1, z1) = film.side.end
    is_level = film.side.center is not None or z0 == z1
    length = max(abs(x - sizes.axis[0]) for x in (x0, x1)) if is_level else abs(z1 - z0)
    s, ds = _log_grid(length, film.h)
    depth = 0.0 if film.side.surface == "top" else domain.height
    if is_level:
        r = s
        z = np.full_like(s, depth)
    else:
        r = np.full_like(s, abs(x0 - sizes.axis[0]))
        z = s
    h_without = sizes.size_at(r, z)
    growth = sizes.grading
    h = np.minimum(film.h + growth * np.maximum(np.hypot(r, z) - film.fine_radius, 0.0), h_without)
    elements_across = (1 / h - 1 / h_without) / growth - (h_without - h) / (growth * h_without**2)
    sectors = _sector_count(sizes, domain) if is_level else 1.0
    return float(sectors * (elements_across * ds).sum())


def candidate_count(sizes: Sizes, domain: ModelDomain) -> float:
    """Return the number of surface nodes that may come into contact.

    Without friction, the dense matrices of the condensed solver have this number of rows.
    """
    dim = domain.dim
    # Elements between the fine patch and the end of the candidate nodes of a condensed body.
    condensed_margin = 3.0
    r, wr = _log_grid(sizes.fine_radius + condensed_margin * sizes.h_contact, sizes.axis_size)
    size = sizes.size_at(r, np.zeros_like(r)) ** (dim - 1)
    ring_weight = _ring_weight(r, dim, _sector_count(sizes, domain))
    facets_on_disk = float((ring_weight * wr / size).sum())
    if sizes.track is not None:
        is_cut_along = _sector_count(sizes, domain) < 4
        across = (1.0 if is_cut_along else 2.0) * float((wr / size).sum())
        facets_on_disk += sizes.track.length * (across if dim == 3 else 1 / sizes.axis_size)
    return NODES_PER_FACET * FACETS_PER_AREA[dim] * facets_on_disk


def _ring_weight(r: np.ndarray, dim: int, sectors: float) -> np.ndarray:
    """Return the length of the arc at the distance r from the tip's axis [length].

    In two dimensions the result is the number of points at this distance.
    """
    return pi / 2 * sectors * r if dim == 3 else np.full_like(r, sectors)


def _sector_count(sizes: Sizes, domain: ModelDomain) -> float:
    """Return the number of quadrants around the tip's axis in the model domain.

    In two dimensions it is the number of halves, 1 or 2.
    """
    on_axes = zip(domain.extent[:-1], sizes.axis, strict=False)
    at_end = [min(abs(c - low), abs(high - c)) <= 1e-9 * (high - low) for (low, high), c in on_axes]
    return 2.0 ** at_end.count(False)


def _log_grid(length: float, smallest: float, points: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Return midpoints and widths of intervals from 0 to `length` in a geometric progression."""
    edges = np.concatenate([[0.0], np.geomspace(min(smallest, length) / 4, length, points)])
    return (edges[1:] + edges[:-1]) / 2, np.diff(edges)
