"""Element sizes as expressions for gmsh's MathEval field, which has neither min nor max.

The expressions equal `sizes.Sizes.size_at`, with nondimensional lengths. Source: Gmsh Reference
Manual, section on mesh size fields.
"""

from __future__ import annotations

import numpy as np

from indent_sim.mesh.sizes import DrainedFace, Sizes
from indent_sim.model.inclusions import EllipsoidInclusion, Inclusion
from indent_sim.model.layers import Coating
from indent_sim.model.tip_track import TipTrack


def size_formula(sizes: Sizes, dim: int) -> str:
    """Return the element size at (x, y[, z]) as a MathEval expression, see `Sizes.size_at`."""
    number = "{:.12g}".format
    x, y = (*map(number, sizes.axis), "")[:2]
    r = f"Sqrt((x-({x}))^2+(y-({y}))^2)"
    depth = "Abs(z)"
    if dim == 2:
        r = f"Abs(x-({x}))"
        depth = "Abs(y)"
    patch_distance = r if sizes.track is None else _track_distance(sizes.track, dim)
    outside_distance = _positive_part(f"({patch_distance}-{number(sizes.fine_radius)})")
    contact_size = number(sizes.h_contact)
    if sizes.h_axis is not None:
        axis_size = _maximum(number(sizes.h_axis), f"{number(sizes.size_slope)}*{patch_distance}")
        contact_size = _minimum(contact_size, axis_size)
    size = f"{contact_size}+{number(sizes.grading)}*Sqrt({outside_distance}^2+{depth}^2)"
    for radius, point_depth, point_size in sizes.refinement_points:
        distance = f"Sqrt(({r}-{number(radius)})^2+({depth}-{number(point_depth)})^2)"
        size = _minimum(size, f"{number(point_size)}+{number(sizes.grading)}*{distance}")
    if below := sizes.base_contact:
        outside_base = _positive_part(f"({r}-{number(below.radius)})")
        distance = f"Sqrt({outside_base}^2+({depth}-{number(below.depth)})^2)"
        size = _minimum(size, f"{number(below.h)}+{number(sizes.grading)}*{distance}")
    if sizes.rounded_edge_width and sizes.h_edge is not None:
        edge_center, edge_half_width = map(number, sizes._rounded_edge)
        edge_distance = _positive_part(f"(Abs({r}-({edge_center}))-{edge_half_width})")
        size = _minimum(
            size,
            f"{number(sizes.h_edge)}+{number(sizes.grading)}*Sqrt({edge_distance}^2+{depth}^2)",
        )
    return _minimum(size, number(sizes.h_far))


def _track_distance(track: TipTrack, dim: int) -> str:
    """Return the distance from the track of a sliding tip as a MathEval expression."""
    number = "{:.12g}".format
    middle = track.center[track.axis] + (track.low + track.high) / 2
    coordinate = f"Abs({'xy'[track.axis]}-({number(middle)}))"
    beyond_end = _positive_part(f"({coordinate}-{number(track.length / 2)})")
    if dim == 2:
        return beyond_end
    across = 1 - track.axis
    return f"Sqrt({beyond_end}^2+({'xy'[across]}-({number(track.center[across])}))^2)"


def inclusion_formula(inclusion: Inclusion, inner_size: float, grading: float, dim: int) -> str:
    """Return the element size required by an inclusion as a MathEval expression.

    Outside the inclusion the size grows with the distance from the inclusion (to first order for an
    ellipsoid).
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
    """Return the element size required by a coating in a section as a MathEval expression."""
    number = "{:.12g}".format
    rho = f"Sqrt(x^2+(y-({number(coating.center[2])}))^2)"
    outside = _positive_part(f"({rho}-{number(coating.outer_radius)})")
    inside = _positive_part(f"({number(coating.inner_radius)}-{rho})")
    return f"{number(inner_size)}+{number(grading)}*({outside}+{inside})"


def drained_face_formula(face: DrainedFace, axis: float, grading: float) -> str:
    """Return the element size required by a drained face in a section as a MathEval expression.

    `axis` is the x coordinate of the tip's axis.
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
    """Return a MathEval expression for max(a, 0)."""
    return f"(0.5*({a}+Abs({a})))"


def _maximum(a: str, b: str) -> str:
    """Return a MathEval expression for max(a, b)."""
    return f"(0.5*(({a})+({b})+Abs(({a})-({b}))))"


def _minimum(a: str, b: str) -> str:
    """Return a MathEval expression for min(a, b)."""
    return f"(0.5*(({a})+({b})-Abs(({a})-({b}))))"
