"""Geometry of a tip for pictures and ParaView: section lines and surface meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indent_sim.model.tilted_tip import TiltedTip
from indent_sim.model.tips import Indenter, RegularPyramid, Sphere, max_radius

# Half-width of the section of a tilted tip, in multiples of that of the picture: the section,
# turned by the tilt, fills the picture.
DRAWN_WIDTH = 1.6
# Height of this section in multiples of the width. Above it a vertical plane across the tilt misses
# the tip.
DRAWN_HEIGHT = 1e3
SectionCurve = tuple[np.ndarray, np.ndarray]  # Distance from the axis s, and height z [length].


@dataclass(frozen=True)
class TipGeometry:
    """Mesh of a tip at first contact, with its apex at z = 0.

    Attributes
    ----------
    points
        Points (n, 3) [length].
    cells
        Numbers of the points of each line (m, 2) or triangle (m, 3).
    contacts_per_body
        Number of equal contacts of the body. It is 2 for a ball between two tips: one half of the
        ball is modelled, and each tip moves by half of the depth.
    slide_axis
        Horizontal axis along which the tip slides: 0 (x) or 1 (y).
    """

    points: np.ndarray
    cells: np.ndarray
    contacts_per_body: int = 1
    slide_axis: int = 0

    def displacement(
        self, delta: float, slide: float = 0.0, lift: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Return the displacement (n, 3) [length] of the tip at a depth and a slide.

        `lift` is the displacement (n,) of the points of a soft tip towards its holder.
        """
        displacement = np.zeros((len(self.points), 3))
        displacement[:, 2] = lift - delta / self.contacts_per_body
        displacement[:, self.slide_axis] += slide
        return displacement


def half_section(
    tip: Indenter, width: float, degrees: float = 0.0, points: int = 160
) -> SectionCurve:
    """Return the section (s, z) of the tip in a half-plane, beginning at the apex.

    A sphere is returned as a whole if it fits into the width. A tip of finite radius has a vertical
    side.

    Parameters
    ----------
    tip
        The tip.
    width
        Largest distance s from the axis [length].
    degrees
        Angle of the half-plane from the x axis.
    points
        Number of points of the smooth part.
    """
    if isinstance(tip, Sphere):
        angles = np.linspace(0, np.pi if width >= tip.R else np.arcsin(width / tip.R), points)
        return tip.R * np.sin(angles), tip.R * (1 - np.cos(angles))
    end = min(width, max_radius(tip))
    # Points close to each other draw the sharp or rounded edges of a tip.
    refined_radii = [
        np.linspace(radius, radius + across, points // 4)
        for radius, across in tip.slope_discontinuities()
    ]
    s = np.unique(np.concatenate([np.linspace(0, end, points), *refined_radii]))
    s = s[(s >= 0) & (s <= end)]
    x = s * np.cos(np.radians(degrees))
    y = s * np.sin(np.radians(degrees))
    z = np.asarray(tip.height(x, y), dtype=float)
    return (np.append(s, end), np.append(z, z[-1] + width)) if max_radius(tip) <= width else (s, z)


def section(tip: Indenter, width: float, degrees: float = 0.0) -> SectionCurve:
    """Return the section (s, z) [length] of the tip in a vertical plane, from left to right.

    `degrees` is the angle of the plane from the x axis, `width` the largest distance from the axis.
    """
    if isinstance(tip, TiltedTip):
        return _tilted_section(tip, width, degrees)
    (left, below) = half_section(tip, width, degrees + 180)
    (right, above) = half_section(tip, width, degrees)
    return np.concatenate([-left[:0:-1], right]), np.concatenate([below[:0:-1], above])


def _tilted_section(tip: TiltedTip, width: float, degrees: float) -> SectionCurve:
    """Return the section (s, z) [length] of a tilted tip in a vertical plane through its center."""
    angle = np.radians(degrees)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])
    if np.isclose(np.sin(angle - np.radians(tip.towards)), 0.0, atol=1e-12):
        # The plane contains the axis of the tip, whose own section is turned in it.
        s, z = section(tip.upright, DRAWN_WIDTH * width, degrees)
        points = tip.space_coordinates(s[:, None] * axis + z[:, None] * np.array([0.0, 0.0, 1.0]))
        return points @ axis, points[:, 2]
    s = np.linspace(-width, width, 320)
    z = np.asarray(tip.height(s * axis[0], s * axis[1]), dtype=float)
    is_below = z < DRAWN_HEIGHT * width
    return s[is_below], z[is_below]


def tip_mesh(
    tip: Indenter, center: tuple[float, ...], width: float, kinematics: str, contacts_per_body: int
) -> TipGeometry:
    """Return the mesh of a tip up to a distance from its axis.

    The mesh is the half section (axisymmetric), the whole section (plane strain), or the surface
    (3D).

    Parameters
    ----------
    tip
        The tip.
    center
        Position of the apex, (x,) or (x, y) [length].
    width
        Largest distance from the axis [length].
    kinematics
        "axisymmetric", "plane_strain" or "three_dimensional".
    contacts_per_body
        Number of equal contacts of the body.
    """
    if kinematics == "three_dimensional":
        points, cells = _tip_surface(tip.upright, width)
        if isinstance(tip, TiltedTip):
            points = tip.space_coordinates(points)
        return TipGeometry(points + np.array([*center, 0.0]), cells, contacts_per_body)
    s, z = half_section(tip, width) if kinematics == "axisymmetric" else section(tip, width)
    points = np.column_stack([s + (*center, 0.0)[0], np.zeros(len(s)), z])
    ends = np.arange(len(s))
    return TipGeometry(points, np.column_stack([ends[:-1], ends[1:]]), contacts_per_body)


def _tip_surface(tip: Indenter, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the tip's surface as triangles between sections about its axis.

    The edges of a pyramid are among the sections.
    """
    edges, begin = (2 * tip.faces, tip.rotation) if isinstance(tip, RegularPyramid) else (1, 0.0)
    sections_per_turn = 96
    points_per_section = 40
    section_count = -(-sections_per_turn // edges) * edges
    angles = begin + 360 * np.arange(section_count) / section_count
    sections = [half_section(tip, width, angle, points_per_section) for angle in angles]
    rings = len(sections[0][0])
    angled_sections = zip(np.radians(angles), sections, strict=True)
    points = [
        np.column_stack([s * np.cos(angle), s * np.sin(angle), z])
        for angle, (s, z) in angled_sections
    ]
    first_points = rings * np.arange(section_count)[:, None]
    section_points = (first_points + np.arange(rings - 1)[None, :]).ravel()
    next_points = (section_points + rings) % (rings * section_count)
    triangles = [
        (section_points, section_points + 1, next_points + 1),
        (section_points, next_points + 1, next_points),
    ]
    return np.concatenate(points), np.concatenate(
        [np.column_stack(corners) for corners in triangles]
    )


def plot_width(tip: Indenter, a: float, delta: float) -> float:
    """Return the distance from the axis to which a tip is drawn [length].

    This distance is larger than the contact radius a and the depth. A tip that is not much wider is
    drawn as a whole.
    """
    contact_width = 2.5 * max(a, abs(delta))
    if max_radius(tip) < 2 * contact_width:
        return max(contact_width, 1.0001 * max_radius(tip))
    return contact_width
