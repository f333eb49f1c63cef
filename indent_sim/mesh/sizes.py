"""Element sizes of a mesh as a function of position.

`size_formulas` implements the same function as expressions for gmsh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from indent_sim.mesh.model_domain import Side
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.layers import Coating
from indent_sim.model.tip_track import TipTrack

DOUBTFUL_ELEMENTS = 3.0  # Elements per contact radius below which results are unreliable.


@dataclass(frozen=True)
class DrainedFace:
    """Drained face of a section, next to which the pore pressure varies in a thin boundary layer.

    Attributes
    ----------
    side
        The face.
    h
        Size [length] of the elements at the face within `fine_radius` of the point of first
        contact. Elsewhere sizes grow by `grading` of `Sizes`, both along the face and away from it.
    fine_radius
        Distance [length] from the point of first contact.
    """

    side: Side
    h: float
    fine_radius: float


@dataclass(frozen=True)
class BaseContact:
    """Finely meshed part of the base, where the body touches the flat on which it rests.

    Attributes
    ----------
    depth
        Depth of the flat below the apex [length].
    radius
        Radius of the finely meshed part [length].
    h
        Size of its elements [length].
    """

    depth: float
    radius: float
    h: float


@dataclass(frozen=True)
class Sizes:
    """Element sizes of a mesh [length] as a function of position.

    Attributes
    ----------
    h_contact
        Size within `fine_radius` of the tip's axis.
    h_far
        Largest size.
    fine_radius
        Radius of the uniformly refined patch under the tip.
    grading
        Growth of the size per unit distance outside refined regions.
    punch_edge, h_edge
        Radius of a sharp edge of the tip, and the element size there.
    h_axis, a
        Size at the axis and expected contact radius. If `h_axis` is given, the size for r < a is
        h_contact * r/a, but at least `h_axis`, so that contacts of all radii down to a *
        h_axis/h_contact have the same number of elements.
    corners, h_corner
        Corner singularities (r, depth), and the element size there.
    corner_error
        Bound on the relative error of the force due to the elements at the corners.
    inclusions, coatings
        Inclusions and coatings, each with the element size inside it.
    drained_faces, h_film
        Drained faces, and the element size at drained faces next to the contact.
    edge_refinement_factor
        Sensitivity of the force to the radius of a sharp punch, relative to that on a half-space.
    rounded_edge_width
        Width of a punch's rounded edge, if friction at finite strain requires fine elements on the
        whole edge.
    refinements
        Number of uniform refinements of a mesh from a file; None if gmsh meshes the body.
    base_contact
        Contact with a flat below; None if the body does not rest on one.
    axis
        Position (x, y) of the tip's axis, or of the middle of the contact under a tilted tip.
    elongation
        Distance of the edge of the expected contact from `axis`, divided by the contact radius.
    edge_tilt
        Tilt of a flat punch and its direction [degrees], which make its edge an ellipse.
    track
        Track of a tip that slides, from which the distance of the refined patch is measured in
        place of the distance from the axis; None if the tip does not slide.
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
    corner_error: float = 0.0
    inclusions: tuple[tuple[Inclusion, float], ...] = ()
    coatings: tuple[tuple[Coating, float], ...] = ()
    drained_faces: tuple[DrainedFace, ...] = ()
    h_film: float | None = None
    edge_refinement_factor: float = 1.0
    rounded_edge_width: float = 0.0
    refinements: int | None = None
    elongation: float = 1.0
    edge_tilt: tuple[float, float] | None = None
    base_contact: BaseContact | None = None
    axis: tuple[float, ...] = field(kw_only=True)
    track: TipTrack | None = None

    @property
    def typical_size(self) -> float:
        """Geometric mean of the sizes at the axis and at the contact edge [length]."""
        return (
            self.h_contact if self.h_axis is None else float(np.sqrt(self.h_axis * self.h_contact))
        )

    @property
    def axis_size(self) -> float:
        """Element size at the axis [length]."""
        return self.h_axis or self.h_contact

    @property
    def min_size(self) -> float:
        """Smallest element size in the mesh [length]."""
        local_sizes = [
            *(h for _, h in (*self.inclusions, *self.coatings)),
            *(film.h for film in self.drained_faces),
        ]
        return min(
            self.axis_size,
            self.h_edge or self.axis_size,
            self.h_corner or self.axis_size,
            self.h_base or self.axis_size,
            *local_sizes,
        )

    @property
    def h_base(self) -> float | None:
        """Element size in the contact with a flat below [length]; None without such a flat."""
        return self.base_contact.h if self.base_contact else None

    @property
    def refinement_points(self) -> list[tuple[float, float, float]]:
        """Points (r, depth, size) [length] with local refinement: punch edge and corners."""
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
        """Growth of the element size per unit distance from the axis inside the contact."""
        return self.h_contact / self.a

    def size_at(self, r: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return the element size [length] at a distance r from the tip's axis and a depth.

        The refinement at inclusions, coatings and drained faces is not included.
        """
        contact_size: Any = self.h_contact
        if self.h_axis is not None:
            # np.clip would cost ten times as much for a single point.
            contact_size = np.minimum(np.maximum(self.size_slope * r, self.h_axis), self.h_contact)
        size = contact_size + self.grading * np.hypot(np.maximum(r - self.fine_radius, 0.0), depth)
        for radius, point_depth, point_size in self.refinement_points:
            size = np.minimum(
                size, point_size + self.grading * np.hypot(r - radius, depth - point_depth)
            )
        if below := self.base_contact:
            distance = np.hypot(np.maximum(r - below.radius, 0.0), depth - below.depth)
            size = np.minimum(size, below.h + self.grading * distance)
        if self.rounded_edge_width and self.punch_edge is not None and self.h_edge is not None:
            edge_center, edge_half_width = self._rounded_edge
            edge_distance = np.maximum(np.abs(r - edge_center) - edge_half_width, 0.0)
            size = np.minimum(size, self.h_edge + self.grading * np.hypot(edge_distance, depth))
        return np.minimum(size, self.h_far)

    @property
    def _rounded_edge(self) -> tuple[float, float]:
        """Center and half-width [length] of the punch's rounded edge."""
        assert self.punch_edge is not None
        return self.punch_edge - self.rounded_edge_width / 2, self.rounded_edge_width / 2

    def elements_in_contact(self, a: float) -> float:
        """Return the contact radius a divided by the element size at the contact edge."""
        return a / self.surface_size(a)

    def surface_size(self, r: float) -> float:
        """Return the size of surface elements at a distance r from the tip's axis [length]."""
        return float(self.size_at(np.array(r), np.array(0.0)))

    def is_resolved(self, a: float) -> bool:
        """Return whether a contact of radius a has enough elements.

        The contact of a flat punch is always resolved, because its radius is known and the edge is
        refined.
        """
        return self.punch_edge is not None or self.elements_in_contact(a) >= DOUBTFUL_ELEMENTS
