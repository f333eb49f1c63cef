"""Roughness of the contact pressure: how far it alternates from node to node of the elements.

A smooth pressure is nearly quadratic on a facet and those beside it. What alternates between
vertices and midpoints, or from one facet to the next, is not: it is what remains at a facet's nodes
when the quadratic polynomial is taken away that fits the nodes of the facet and of its neighbours
best, by least squares. A contact that opens over an element or two inside counts as rough, too.
Where a pressure need not be smooth nothing is said: at the rim of contact, and where the slope or
the curvature of the tip jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.model.tips import Indenter

SAME = 1e-9  # of the extent of the surface: nodes closer to each other are one
# Facets between one that is looked at and the rim of contact or a crease, by the nodes of a facet: those beside it are
# part of its patch. A ball on a cube (three elements in the contact radius, no friction) is 0.08 rough with two of
# them, where the elements that the rim crosses smear the pressure
RINGS = {3: 2, 6: 3}
# Facets of a hole inside the contact that counts as an oscillation, by the nodes of a facet: under
# a rounded punch with friction two elements in a row opened (depth 0.24 thicknesses, nu 0.49, two
# steps), and the force was 1.6 % too small
HOLE = {3: 4, 6: 12}


@dataclass(frozen=True)
class Patches:
    """Every facet with the facets that share a side with it, and what is left there of a pressure that is no quadratic.

    Attributes
    ----------
    nodes
        A number for each place (facets, read), of those nodes of a facet at which a pressure is read.
    members
        The facet itself and its neighbours (patches, 1 + sides), of the facets that have one at each side.
    remainders
        Matrices (patches, read, (1 + sides) read) from the pressures at the nodes of the members to what a quadratic
        does not explain of them at the nodes of the facet itself.
    """

    nodes: np.ndarray
    members: np.ndarray
    remainders: np.ndarray


def patches_of(X: np.ndarray) -> Patches:
    """The patches of a contact surface.

    Parameters
    ----------
    X
        Places of the nodes of its facets (facets, nodes, dim) [length], vertices first, then midpoints.
    """
    dim = X.shape[2]
    read, sides = _read(X), X[:, :dim] if dim == 2 else X[:, dim:]
    members = _members(_numbered(sides))
    near = read[members]
    patch = near.reshape(len(members), near.shape[1] * near.shape[2], dim)
    count = read.shape[1]
    fits = _quadratics(patch, X[members[:, 0], :dim])
    smooth = fits[:, :count] @ np.linalg.pinv(fits)
    remainders = np.broadcast_to(np.eye(count, patch.shape[1]), smooth.shape) - smooth
    return Patches(_numbered(read), members, remainders)


def _read(nodal: np.ndarray) -> np.ndarray:
    """The nodes at which a pressure is read: those of a triangle that are no vertex (see `from_midpoints`)."""
    return nodal if nodal.shape[1] == 3 else nodal[:, 3:]


def _numbered(X: np.ndarray) -> np.ndarray:
    """A number (...) for each different place (..., dim)."""
    places = X.reshape(-1, X.shape[-1])
    if not len(places):
        return np.zeros(X.shape[:-1], dtype=np.int64)
    extent = float(np.ptp(places, axis=0).max()) or 1.0
    _, numbers = np.unique(np.round(places / (SAME * extent)), axis=0, return_inverse=True)
    return np.asarray(numbers).reshape(X.shape[:-1])


def _members(sides: np.ndarray) -> np.ndarray:
    """Facets that have a neighbour at each of their sides (facets, sides), and these neighbours."""
    count = sides.shape[1]
    order = np.argsort(sides, axis=None, kind="stable")
    numbers = sides.ravel()[order]
    is_pair = numbers[1:] == numbers[:-1]
    first, second = order[:-1][is_pair], order[1:][is_pair]
    beside = np.full(sides.size, -1)
    beside[first], beside[second] = second // count, first // count
    beside = beside.reshape(sides.shape)
    inner = np.flatnonzero((beside >= 0).all(axis=1))
    return np.column_stack([inner, beside[inner]])


def _quadratics(patch: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """The monomials up to the second degree (patches, nodes, monomials) along each facet, about its middle."""
    middle = vertices.mean(axis=1, keepdims=True)
    along = vertices[:, 1:] - vertices[:, :1]
    size = np.linalg.norm(along[:, 0], axis=-1)[:, None]
    first = along[:, 0] / size
    s = np.einsum("fnd,fd->fn", patch - middle, first) / size
    if vertices.shape[2] == 2:
        return np.stack([np.ones_like(s), s, s * s], axis=-1)
    across = along[:, 1] - np.einsum("fd,fd->f", along[:, 1], first)[:, None] * first
    second = across / np.linalg.norm(across, axis=-1)[:, None]
    t = np.einsum("fnd,fd->fn", patch - middle, second) / size
    return np.stack([np.ones_like(s), s, t, s * s, s * t, t * t], axis=-1)


def roughness(
    patches: Patches, pressure: np.ndarray, touches: np.ndarray, distance: np.ndarray, tip: Indenter
) -> float:
    """Return the amplitude [pressure] of the contact pressure's oscillation from node to node.

    It is 0 where the contact is too small for a facet away from its rim and from creases of the
    tip.

    Parameters
    ----------
    patches
        Those of the surface.
    pressure
        At the nodes of its facets (facets, nodes) [pressure].
    touches
        Which of these nodes are in contact (facets, nodes).
    distance
        How far they are from the tip's axis, where the tip is touched (facets, nodes) [length].
    tip
        Whose creases are left out.
    """
    rings = RINGS[pressure.shape[1]]
    is_closed = np.asarray(touches.all(axis=1))
    is_inner = _without_holes(is_closed, distance, patches.members, HOLE[pressure.shape[1]])
    is_inner &= ~_is_creased(distance, tip)
    told = np.zeros(len(patches.members), dtype=bool)
    for _ in range(rings):
        told = is_inner[patches.members].all(axis=1)
        is_inner = np.zeros_like(is_inner)
        is_inner[patches.members[told, 0]] = True
    if not told.any():
        return 0.0
    values, nodes = _read(pressure), patches.nodes
    total = np.bincount(nodes.ravel(), values.ravel())
    count = np.bincount(nodes.ravel())
    mean = (total / np.maximum(count, 1))[nodes]  # the deformed area has a kink between facets
    near = mean[patches.members[told]].reshape(int(told.sum()), -1, 1)
    return float(np.abs(patches.remainders[told] @ near).max())


def _without_holes(is_inner: np.ndarray, distance: np.ndarray, members: np.ndarray, most: int) -> np.ndarray:
    """Return which facets are in contact or in a small hole of it (facets,).

    A hole is a connected set of facets without contact that does not reach the farthest facet. A
    contact that opens over so few elements inside oscillates as one whose pressure alternates from
    node to node.

    Parameters
    ----------
    is_inner
        Which facets are in contact at all of their nodes (facets,).
    distance
        How far their nodes are from the tip's axis (facets, nodes) [length].
    members
        See `Patches`.
    most
        Number of facets of the largest hole that is filled.
    """
    is_open = ~is_inner
    nearest = distance.min(axis=1)
    if not (nearest[is_open] < nearest[is_inner].max(initial=0.0)).any():
        return is_inner
    # Imported here, as few contacts are no full circle
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.stack([np.repeat(members[:, 0], members.shape[1] - 1), members[:, 1:].ravel()])
    pairs = pairs[:, is_open[pairs].all(axis=0)]
    count = len(is_inner)
    graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels[is_open], minlength=count)
    is_outside = labels == labels[nearest.argmax()]
    return is_inner | ((sizes[labels] <= most) & ~is_outside)


def _is_creased(distance: np.ndarray, tip: Any) -> np.ndarray:
    """Which facets (facets,) a circle crosses at which the slope or the curvature of a tip jumps."""
    nearest, farthest = distance.min(axis=1), distance.max(axis=1)
    found = np.zeros(len(distance), dtype=bool)
    for radius, width in tip.creases():
        for circle in {radius, radius + width}:
            found |= (nearest <= circle) & (circle <= farthest)
    return found
