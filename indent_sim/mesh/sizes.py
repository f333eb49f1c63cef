"""The element-size field, in numpy and in the language of gmsh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from indent_sim.mesh.model_domain import Side
from indent_sim.model.body import Coating, Inclusion

DOUBTFUL_ELEMENTS = 3.0  # elements per contact radius below which results are doubtful


@dataclass(frozen=True)
class DrainedFace:
    """A drained face of a section, beside which the pressure of the fluid changes within a film.

    Elements at the face have the size h [length], up to a distance `reach` [length] from where the
    tip touches first; from there sizes grow by `grading` along the face and away from it alike.
    """

    side: Side
    h: float
    fine_radius: float


@dataclass(frozen=True)
class Sizes:
    """Element sizes [length].

    h_contact inside `patch` of the tip's `axis` (x, y), growing by `grading` per unit distance
    outside it up to h_far; around a sharp edge at radius `edge` it shrinks to h_edge, from `rubbed`
    inside that radius on, around `corners` (r, depth) to h_corner. Where h_axis is given, sizes
    inside the expected contact radius `a` are the share of it that the distance from the axis is,
    but at least h_axis: so a contact of any radius down to a h_axis/h_contact finds as many
    elements as the last one. inclusions, skins: each with the size inside it, which grows by
    `grading` outside. films: drained faces, with h_film, the size at those next to the contact.
    """

    h_contact: float
    h_far: float
    fine_radius: float
    grading: float = 0.2
    punch_edge: float | None = None
    h_edge: float | None = None
    h_axis: float | None = None
    a: float = 0.0
    corners: tuple[tuple[float, float], ...] = ()
    h_corner: float | None = None
    corner_error: float = 0.0  # of the force, at most, what the elements at corners cost
    inclusions: tuple[tuple[Inclusion, float], ...] = ()
    coatings: tuple[tuple[Coating, float], ...] = ()
    drained_faces: tuple[DrainedFace, ...] = ()
    h_film: float | None = None
    edge_refinement_factor: float = (
        1.0  # how much more than on a far larger body the force feels the radius of a sharp punch
    )
    rounded_edge_width: float = (
        0.0  # width of a punch's rounded edge, where friction at finite strain needs all of it fine
    )
    refinements: int | None = (
        None  # of a mesh from a file, which has these sizes then; None: they are to be meshed
    )
    axis: tuple[float, ...] = field(kw_only=True)

    @property
    def typical_size(self) -> float:
        """Between the sizes at the axis and at the edge of the contact, in the geometric mean
        [length].
        """
        return (
            self.h_contact if self.h_axis is None else float(np.sqrt(self.h_axis * self.h_contact))
        )

    @property
    def axis_size(self) -> float:
        """The size at the axis [length]."""
        return self.h_axis or self.h_contact

    @property
    def min_size(self) -> float:
        """The smallest size anywhere [length]."""
        local_sizes = [
            *(h for _, h in (*self.inclusions, *self.coatings)),
            *(film.h for film in self.drained_faces),
        ]
        return min(
            self.axis_size,
            self.h_edge or self.axis_size,
            self.h_corner or self.axis_size,
            *local_sizes,
        )

    @property
    def refinement_points(self) -> list[tuple[float, float, float]]:
        """(r, depth, size) [length] of the places towards which elements shrink: a punch's edge,
        the felt corners.
        """
        edge_points = (
            []
            if self.punch_edge is None or self.h_edge is None
            else [(self.punch_edge, 0.0, self.h_edge)]
        )
        return edge_points + [
            (r, depth, self.h_corner) for r, depth in self.corners if self.h_corner is not None
        ]

    @property
    def size_slope(self) -> float:
        """Growth of the size per unit distance from the axis, inside the contact, where there is
        one.
        """
        return self.h_contact / self.a

    def size_at(self, r: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The element size [length] at distance r from the tip's axis and a depth, far from
        inclusions, skins and drained faces.
        """
        contact_size: Any = self.h_contact
        if self.h_axis is not None:  # not np.clip, which costs ten times as much for one place
            contact_size = np.minimum(np.maximum(self.size_slope * r, self.h_axis), self.h_contact)
        size = contact_size + self.grading * np.hypot(np.maximum(r - self.fine_radius, 0.0), depth)
        for radius, point_depth, point_size in self.refinement_points:
            size = np.minimum(
                size, point_size + self.grading * np.hypot(r - radius, depth - point_depth)
            )
        if self.rounded_edge_width and self.punch_edge is not None and self.h_edge is not None:
            edge_center, edge_half_width = self._rounded_edge
            edge_distance = np.maximum(np.abs(r - edge_center) - edge_half_width, 0.0)
            size = np.minimum(size, self.h_edge + self.grading * np.hypot(edge_distance, depth))
        return np.minimum(size, self.h_far)

    @property
    def _rounded_edge(self) -> tuple[float, float]:
        """The middle of the rounded edge and half its width [length]."""
        assert self.punch_edge is not None
        return self.punch_edge - self.rounded_edge_width / 2, self.rounded_edge_width / 2

    def elements_in_contact(self, a: float) -> float:
        """How many elements there are in a contact radius a, judged by the one where it ends."""
        return a / self.surface_size(a)

    def surface_size(self, r: float) -> float:
        """The size of the elements of the surface at a distance from the contact's middle."""
        return float(self.size_at(np.array(r), np.array(0.0)))

    def is_resolved(self, a: float) -> bool:
        """Whether a contact of radius a is resolved; a punch's is known before, and its edge
        refined.
        """
        return self.punch_edge is not None or self.elements_in_contact(a) >= DOUBTFUL_ELEMENTS
