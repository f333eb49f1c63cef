"""The element-size field, in numpy and in the language of gmsh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from indent_sim.mesh.model_domain import Side
from indent_sim.model.inclusions import EllipsoidInclusion, Inclusion
from indent_sim.model.layers import Coating

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


def size_formula(sizes: Sizes, dim: int) -> str:
    """The element size at (x, y[, z]) as a gmsh MathEval expression (gmsh has no min or max there)."""
    number = "{:.12g}".format
    x, y = (*map(number, sizes.axis), "")[:2]
    r = f"Sqrt((x-({x}))^2+(y-({y}))^2)"
    depth = "Abs(z)"
    if dim == 2:
        r = f"Abs(x-({x}))"
        depth = "Abs(y)"
    outside_distance = _positive_part(f"({r}-{number(sizes.fine_radius)})")
    contact_size = number(sizes.h_contact)
    if sizes.h_axis is not None:
        contact_size = _minimum(
            contact_size, _maximum(number(sizes.h_axis), f"{number(sizes.size_slope)}*{r}")
        )
    size = f"{contact_size}+{number(sizes.grading)}*Sqrt({outside_distance}^2+{depth}^2)"
    for radius, point_depth, point_size in sizes.refinement_points:
        distance = f"Sqrt(({r}-{number(radius)})^2+({depth}-{number(point_depth)})^2)"
        size = _minimum(size, f"{number(point_size)}+{number(sizes.grading)}*{distance}")
    if sizes.rounded_edge_width and sizes.h_edge is not None:
        edge_center, edge_half_width = map(number, sizes._rounded_edge)
        edge_distance = _positive_part(f"(Abs({r}-({edge_center}))-{edge_half_width})")
        size = _minimum(
            size,
            f"{number(sizes.h_edge)}+{number(sizes.grading)}*Sqrt({edge_distance}^2+{depth}^2)",
        )
    return _minimum(size, number(sizes.h_far))


def inclusion_formula(inclusion: Inclusion, inner_size: float, grading: float, dim: int) -> str:
    """The element size that an inclusion wants: the one inside it, growing with
    `Inclusion.distance`, of an ellipsoid to first order.
    """
    number = "{:.12g}".format
    names = ("x", "0", "y") if dim == 2 else ("x", "y", "z")
    if isinstance(inclusion, EllipsoidInclusion):
        offsets = [
            f"({name}-({number(c)}))" for name, c in zip(names, inclusion.center, strict=True)
        ]
        scaled_offsets = list(zip(offsets, inclusion.semi_axes, strict=True))
        rho, gradient = (
            "+".join(f"({d}/{number(s**n)})^2" for d, s in scaled_offsets) for n in (1, 2)
        )
        distance = f"Sqrt({rho})*{_positive_part(f'(Sqrt({rho})-1)')}/Sqrt({gradient}+1e-30)"
        return f"{number(inner_size)}+{number(grading)}*{distance}"
    squared_distances = []
    for axes, half in inclusion.spans:
        squares = "+".join(f"({names[axis]}-({number(inclusion.center[axis])}))^2" for axis in axes)
        squared_distances.append(f"{_positive_part(f'(Sqrt({squares})-{number(half)})')}^2")
    return f"{number(inner_size)}+{number(grading)}*Sqrt({'+'.join(squared_distances)})"


def coating_formula(coating: Coating, inner_size: float, grading: float) -> str:
    """The element size that a skin wants in a section: the one inside it, growing with the distance
    from it.
    """
    number = "{:.12g}".format
    rho = f"Sqrt(x^2+(y-({number(coating.center[2])}))^2)"
    distance = f"{_positive_part(f'({rho}-{number(coating.outer_radius)})')}+{_positive_part(f'({number(coating.inner_radius)}-{rho})')}"
    return f"{number(inner_size)}+{number(grading)}*({distance})"


def drained_face_formula(face: DrainedFace, axis: float, grading: float) -> str:
    """The element size that a drained face wants in a section, of a tip whose axis is at x =
    `axis`.
    """
    number = "{:.12g}".format
    if face.side.center is not None:
        x, y = map(number, face.side.center)
        distance = f"Abs({number(face.side.radius)}-Sqrt((x-({x}))^2+(y-({y}))^2))"
    else:
        (x0, y0) = face.side.start
        (x1, y1) = face.side.end
        length = float(np.hypot(x1 - x0, y1 - y0))
        along_x = number((x1 - x0) / length)
        along_y = number((y1 - y0) / length)
        distance = f"Abs(({along_x})*(y-({number(y0)}))-({along_y})*(x-({number(x0)})))"
    outside_distance = _positive_part(
        f"(Sqrt((x-({number(axis)}))^2+y^2)-{number(face.fine_radius)})"
    )
    return f"{number(face.h)}+{number(grading)}*({distance}+{outside_distance})"


def _positive_part(a: str) -> str:
    return f"(0.5*({a}+Abs({a})))"


def _maximum(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})+Abs(({a})-({b}))))"


def _minimum(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})-Abs(({a})-({b}))))"
