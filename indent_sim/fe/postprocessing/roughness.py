"""Roughness of the contact pressure: the amplitude of its oscillation from node to node.

A smooth pressure is nearly quadratic on a facet and its neighbours. The roughness is the largest
difference, at the nodes of a facet, between the pressure and the quadratic polynomial that fits the
nodes of the facet and its neighbours best, by least squares. It is large if the pressure oscillates
between vertices and midpoints or from facet to facet, or if one or two elements inside the contact
are open. It is not assessed where the pressure need not be smooth: at the edge of the contact, and
where the slope or the curvature of the tip is discontinuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.fe.measured_constants import LARGEST_HOLE, RIM_RINGS
from indent_sim.model.tips import Indenter


@dataclass(frozen=True)
class Patches:
    """Patches of facets with their neighbours, and the matrices of their quadratic fits.

    Attributes
    ----------
    nodes : ndarray of int, (facets, n)
        Numbers of the nodes of each facet at which a pressure is evaluated.
    members : ndarray of int, (patches, 1 + sides)
        Each facet that has a neighbour at every side, followed by these neighbours.
    remainders : ndarray, (patches, n, (1 + sides) n)
        Matrices that map the pressures at the nodes of a patch to the residuals of the quadratic
        fit at the nodes of its first facet.
    """

    nodes: np.ndarray
    members: np.ndarray
    remainders: np.ndarray


def build_patches(X: np.ndarray) -> Patches:
    """Build the patches of a contact surface.

    Parameters
    ----------
    X : ndarray, (facets, nodes, dim)
        Positions of the nodes of the facets [length], vertices first, then midpoints.
    """
    dim = X.shape[2]
    reading_nodes = _reading_nodes(X)
    sides = X[:, :dim] if dim == 2 else X[:, dim:]
    members = _patch_members(_node_numbers(sides))
    member_nodes = reading_nodes[members]
    patch = member_nodes.reshape(len(members), member_nodes.shape[1] * member_nodes.shape[2], dim)
    count = reading_nodes.shape[1]
    monomials = _quadratic_monomials(patch, X[members[:, 0], :dim])
    quadratic_fit = monomials[:, :count] @ np.linalg.pinv(monomials)
    remainders = np.broadcast_to(np.eye(count, patch.shape[1]), quadratic_fit.shape) - quadratic_fit
    return Patches(_node_numbers(reading_nodes), members, remainders)


def _reading_nodes(nodal: np.ndarray) -> np.ndarray:
    """Return the values at the nodes from which the roughness is computed.

    On triangles these are only the midpoints of the edges.

    See `interpolate_from_midpoints`.
    """
    return nodal if nodal.shape[1] == 3 else nodal[:, 3:]


def _node_numbers(X: np.ndarray) -> np.ndarray:
    """Return an integer for each position (*, dim); equal positions have equal integers."""
    points = X.reshape(-1, X.shape[-1])
    if not len(points):
        return np.zeros(X.shape[:-1], dtype=np.int64)
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    # Nodes closer than 1e-9 of the extent of the surface are the same
    _, numbers = np.unique(np.round(points / (1e-9 * extent)), axis=0, return_inverse=True)
    return np.asarray(numbers).reshape(X.shape[:-1])


def _patch_members(sides: np.ndarray) -> np.ndarray:
    """Facets with a neighbour at every side, followed by the neighbours (patches, 1 + sides)."""
    count = sides.shape[1]
    order = np.argsort(sides, axis=None, kind="stable")
    numbers = sides.ravel()[order]
    is_pair = numbers[1:] == numbers[:-1]
    first = order[:-1][is_pair]
    second = order[1:][is_pair]
    neighbours = np.full(sides.size, -1)
    neighbours[first] = second // count
    neighbours[second] = first // count
    neighbours = neighbours.reshape(sides.shape)
    inner_facets = np.flatnonzero((neighbours >= 0).all(axis=1))
    return np.column_stack([inner_facets, neighbours[inner_facets]])


def _quadratic_monomials(patch: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Quadratic monomials (patches, nodes, monomials) in local coordinates of each patch.

    Parameters
    ----------
    patch : ndarray, (patches, nodes, dim)
        Positions of the nodes of the patches [length].
    vertices : ndarray, (patches, dim, dim)
        Vertices of the facet, whose centre is the origin of the coordinates [length].
    """
    middle = vertices.mean(axis=1, keepdims=True)
    edges = vertices[:, 1:] - vertices[:, :1]
    length = np.linalg.norm(edges[:, 0], axis=-1)[:, None]
    first = edges[:, 0] / length
    s = np.einsum("fnd,fd->fn", patch - middle, first) / length
    if vertices.shape[2] == 2:
        return np.stack([np.ones_like(s), s, s * s], axis=-1)
    normal_part = edges[:, 1] - np.einsum("fd,fd->f", edges[:, 1], first)[:, None] * first
    second = normal_part / np.linalg.norm(normal_part, axis=-1)[:, None]
    t = np.einsum("fnd,fd->fn", patch - middle, second) / length
    return np.stack([np.ones_like(s), s, t, s * s, s * t, t * t], axis=-1)


def roughness(
    patches: Patches, pressure: np.ndarray, touches: np.ndarray, distance: np.ndarray, tip: Indenter
) -> float:
    """Amplitude of the contact pressure's oscillation from node to node [pressure].

    The result is 0 if no facet of the contact is far enough from the contact edge and from slope
    discontinuities of the tip.

    Parameters
    ----------
    patches : Patches
        Patches of the surface.
    pressure : ndarray, (facets, nodes)
        Pressure at the nodes of the facets [pressure].
    touches : ndarray of bool, (facets, nodes)
        Nodes in contact.
    distance : ndarray, (facets, nodes)
        Distance of the nodes from the tip's axis [length].
    tip : Indenter
        The tip.

    Returns
    -------
    float
        Amplitude [pressure].
    """
    rings = RIM_RINGS[pressure.shape[1]]
    is_inner = _fill_holes(
        np.asarray(touches.all(axis=1)), distance, patches.members, LARGEST_HOLE[pressure.shape[1]]
    )
    is_inner &= ~_crosses_discontinuity(distance, tip)
    is_assessed = np.zeros(len(patches.members), dtype=bool)
    for _ in range(rings):
        is_assessed = is_inner[patches.members].all(axis=1)
        is_inner = np.zeros_like(is_inner)
        is_inner[patches.members[is_assessed, 0]] = True
    if not is_assessed.any():
        return 0.0
    values = _reading_nodes(pressure)
    nodes = patches.nodes
    total = np.bincount(nodes.ravel(), values.ravel())
    count = np.bincount(nodes.ravel())
    # The deformed area is discontinuous between facets, so pressures are averaged at shared nodes
    mean = (total / np.maximum(count, 1))[nodes]
    patch_values = mean[patches.members[is_assessed]].reshape(int(is_assessed.sum()), -1, 1)
    return float(np.abs(patches.remainders[is_assessed] @ patch_values).max())


def _fill_holes(
    is_inner: np.ndarray, distance: np.ndarray, members: np.ndarray, largest_hole: int
) -> np.ndarray:
    """Mask (facets,) of the facets in contact or in a small hole of the contact.

    A hole is a connected set of open facets that does not contain the facet farthest from the axis.
    A small hole is caused by an oscillation of the pressure, which must not be excluded.

    Parameters
    ----------
    is_inner : ndarray of bool, (facets,)
        Facets in contact at all nodes.
    distance : ndarray, (facets, nodes)
        Distance of the nodes from the tip's axis [length].
    members : ndarray of int
        See `Patches`.
    largest_hole : int
        Number of facets of the largest hole that is filled.
    """
    is_open = ~is_inner
    nearest_distance = distance.min(axis=1)
    if not (nearest_distance[is_open] < nearest_distance[is_inner].max(initial=0.0)).any():
        return is_inner
    # Imported here, because this is needed only if the contact has open facets inside.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.stack([np.repeat(members[:, 0], members.shape[1] - 1), members[:, 1:].ravel()])
    pairs = pairs[:, is_open[pairs].all(axis=0)]
    count = len(is_inner)
    graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels[is_open], minlength=count)
    is_outside = labels == labels[nearest_distance.argmax()]
    return is_inner | ((sizes[labels] <= largest_hole) & ~is_outside)


def _crosses_discontinuity(distance: np.ndarray, tip: Any) -> np.ndarray:
    """Mask (facets,) of the facets at discontinuities of the tip's slope or curvature."""
    nearest = distance.min(axis=1)
    farthest = distance.max(axis=1)
    is_crossed = np.zeros(len(distance), dtype=bool)
    for radius, width in tip.slope_discontinuities():
        for circle in {radius, radius + width}:
            is_crossed |= (nearest <= circle) & (circle <= farthest)
    return is_crossed
