"""Outline of a rigid tip, for pictures and ParaView: its section as a line, its surface as a mesh."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from indent_sim.config.scene_file import load_result_config
from indent_sim.config.schema import Config
from indent_sim.model.body import AnyBody
from indent_sim.model.spherical_bodies import Ball
from indent_sim.model.tips import Indenter, RegularPyramid, Sphere, max_radius
from indent_sim.process.errors import IndentSimError
from indent_sim.results.folder import CONFIG, read_regular_file

SectionCurve = tuple[np.ndarray, np.ndarray]  # (s, z)
# of a surface: sections of a whole turn, and points of each
SECTIONS_PER_TURN = 96
SURFACE_RINGS = 40


@dataclass(frozen=True)
class TipGeometry:
    """A tip as a mesh: points (n, 3) with the apex at first touch, z = 0; cells (m, 2) or (m, 3) of
    points [length].

    A tip at the depth delta stands delta/pieces lower: of a ball between two tips one half is
    modelled.
    """

    points: np.ndarray
    cells: np.ndarray
    contacts_per_body: int = 1

    def displacement(self, delta: float) -> np.ndarray:
        """Its displacement (n, 3) at a depth [length]."""
        return np.tile([0.0, 0.0, -delta / self.contacts_per_body], (len(self.points), 1))


def scene_of(folder: Path) -> Config | None:
    """The scene of a result folder, in the user's units; None where there is none to read."""
    with suppress(OSError):
        written = os.stat(folder / CONFIG)
        return _cached_scene(folder / CONFIG, written.st_mtime_ns, written.st_ino)
    return None


def has_adhesion(folder: Path) -> bool | None:
    """Whether the contact of a result adheres; None where its scene cannot be read."""
    with suppress(OSError):
        if b"adhesion" not in read_regular_file(
            folder / CONFIG
        ):  # as of most, which need not be checked key by key
            return False
    scene = scene_of(folder)
    return getattr(scene.contact, "adhesion", None) is not None if scene else None


@lru_cache(16)  # every panel of a picture asks
def _cached_scene(file: Path, written: int, inode: int) -> Config | None:
    with suppress(IndentSimError, OSError, ValueError):
        return load_result_config(file)
    return None


def contacts_per_body(body: AnyBody) -> int:
    """Equal pieces of a body on top of each other, of which one is modelled."""
    return body.spherical_body.contacts_per_body if isinstance(body, Ball) else 1


def half_section(
    tip: Indenter, width: float, degrees: float = 0.0, points: int = 160
) -> SectionCurve:
    """(s, z) [length] of the tip in the half plane at this angle from x, from the apex out to
    `width`.

    A sphere is drawn whole where it fits, a tip that ends has a vertical side.
    """
    if isinstance(tip, Sphere):
        angles = np.linspace(0, np.pi if width >= tip.R else np.arcsin(width / tip.R), points)
        return tip.R * np.sin(angles), tip.R * (1 - np.cos(angles))
    end = min(width, max_radius(tip))
    refined_radii = [
        np.linspace(radius, radius + across, points // 4)
        for radius, across in tip.slope_discontinuities()
    ]  # no chords there
    s = np.unique(np.concatenate([np.linspace(0, end, points), *refined_radii]))
    s = s[(s >= 0) & (s <= end)]
    x = s * np.cos(np.radians(degrees))
    y = s * np.sin(np.radians(degrees))
    z = np.asarray(tip.height(x, y), dtype=float)
    return (np.append(s, end), np.append(z, z[-1] + width)) if max_radius(tip) <= width else (s, z)


def section(tip: Indenter, width: float, degrees: float = 0.0) -> SectionCurve:
    """(s, z) [length] of the tip in the vertical plane at this angle from x, from left to right."""
    (left, below) = half_section(tip, width, degrees + 180)
    (right, above) = half_section(tip, width, degrees)
    return np.concatenate([-left[:0:-1], right]), np.concatenate([below[:0:-1], above])


def tip_mesh(
    tip: Indenter, center: tuple[float, ...], width: float, kinematics: str, pieces: int
) -> TipGeometry:
    """The tip out to `width` [length]: the half (axisymmetric) or whole section, a surface in three
    dimensions.
    """
    if kinematics == "three_dimensional":
        points, cells = _tip_surface(tip, width)
        return TipGeometry(points + np.array([*center, 0.0]), cells, pieces)
    s, z = half_section(tip, width) if kinematics == "axisymmetric" else section(tip, width)
    points = np.column_stack([s + (*center, 0.0)[0], np.zeros(len(s)), z])
    ends = np.arange(len(s))
    return TipGeometry(points, np.column_stack([ends[:-1], ends[1:]]), pieces)


def _tip_surface(tip: Indenter, width: float) -> tuple[np.ndarray, np.ndarray]:
    """The tip's surface as triangles: sections about its axis, among them the edges of a pyramid."""
    edges, begin = (2 * tip.faces, tip.rotation) if isinstance(tip, RegularPyramid) else (1, 0.0)
    section_count = -(-SECTIONS_PER_TURN // edges) * edges
    angles = begin + 360 * np.arange(section_count) / section_count
    sections = [half_section(tip, width, angle, SURFACE_RINGS) for angle in angles]
    rings = len(sections[0][0])
    angled_sections = zip(np.radians(angles), sections, strict=True)
    points = [
        np.column_stack([s * np.cos(angle), s * np.sin(angle), z])
        for angle, (s, z) in angled_sections
    ]
    here = (rings * np.arange(section_count)[:, None] + np.arange(rings - 1)[None, :]).ravel()
    there = (here + rings) % (rings * section_count)
    triangles = [(here, here + 1, there + 1), (here, there + 1, there)]
    return np.concatenate(points), np.concatenate(
        [np.column_stack(corners) for corners in triangles]
    )


def plot_width(tip: Indenter, a: float, delta: float) -> float:
    """How far out a tip is drawn around a contact of radius a at a depth [length]: beyond both, a
    small tip whole.
    """
    contact_width = 2.5 * max(a, abs(delta))
    return (
        max(contact_width, 1.0001 * max_radius(tip))
        if max_radius(tip) < 2 * contact_width
        else contact_width
    )
