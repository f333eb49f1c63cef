"""A piece from a mesh file as the body that is modelled: where the tip touches it first, how it is held, its sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from indent_sim.mesh.file import place_of, refused
from indent_sim.mesh.grid import Grid, boundary_of
from indent_sim.mesh.part import Part, Pins, Point, Region
from indent_sim.mesh.piece import Piece, halved
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Layer, Meshed, MeshFromFile, shares_of
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter

LEVEL = 1e-9  # of the body, or of a facet: what a level face may depart from that, and how far beside it is still on it
BISECTIONS, CANDIDATES = 40, 64  # how the highest place is looked for: facets are halved, and so many kept
KINEMATICS: dict[str, type[Kinematics]] = {
    "axisymmetric": Axisymmetric, "plane_strain": PlaneStrain, "3d": ThreeDimensional
}  # fmt: skip


@dataclass(frozen=True)
class MeshedPart(Part):
    """A part whose mesh is there: no outline, a piece. `normals`: the axis that each surface is normal to, or None."""

    piece: Piece = field(kw_only=True, repr=False, compare=False)
    normals: Mapping[str, int | None] = field(kw_only=True)

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """(min, max) along each axis [length]."""
        points = self.piece.grid.points
        return tuple(zip(points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True))

    @property
    def largest(self) -> float:
        """The longest edge of a cell [length]."""
        return self.piece.size.longest_edge

    def facet_near(self, center: Point, begin: float, end: float) -> float:
        """The size of contact facets [length] between two distances from a tip's axis, or of the nearest to them.

        Of a triangle that of the equilateral one with its area; in the geometric mean.
        """
        corners = self.piece.corners("top")
        edges = corners[:, 1:] - corners[:, :1]
        measure = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        sizes = measure if self.dim == 2 else np.sqrt(2 / np.sqrt(3) * measure)
        distances = np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1)
        inside = (shares_of(corners, center) >= -LEVEL).all(axis=1)
        nearest = np.where(inside, 0.0, distances.min(axis=1))
        beyond = np.maximum(np.maximum(nearest - end, begin - distances.max(axis=1)), 0.0)
        return float(np.exp(np.log(sizes[beyond == beyond.min()]).mean()))

    def sag(self, center: Point, radius: float) -> float:
        """How far contact facets within a radius of the tip's axis are from the arc through their corners [length].

        Facets of the size h that meet at the angle t follow a radius of h/t, and their middles are h t/8 inside it.
        """
        facets, corners = self.piece.grid.surfaces["top"], self.piece.corners("top")
        normals = upward_normals(corners)
        ridges = np.sort(np.concatenate([np.delete(facets, k, axis=1) for k in range(self.dim)]), axis=1)
        order = np.lexsort(ridges.T)
        same = (ridges[order][1:] == ridges[order][:-1]).all(axis=1)
        one, other = order[:-1][same] % len(facets), order[1:][same] % len(facets)
        near = np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1).min(axis=1) <= radius
        met = near[one] | near[other]
        angles = np.arccos(np.clip((normals[one] * normals[other]).sum(axis=1), -1.0, 1.0))[met]
        return float(angles.mean() * self.facet_near(center, 0.0, radius) / 8) if met.any() else 0.0

    def normal(self, surface: str) -> int | None:
        """The component of u that a roller holds on a surface; None where no one axis is normal to it."""
        return self.normals[surface]


def upward_normals(corners: np.ndarray) -> np.ndarray:
    """The unit normals of segments or triangles (k, n, n), on their upper side."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        normals = np.column_stack([-edges[:, 0, 1], edges[:, 0, 0]])
    else:
        normals = np.cross(edges[:, 0], edges[:, 1])
    upper = np.where(normals[:, -1:] < 0, -1.0, 1.0)
    return np.asarray(upper * normals / np.linalg.norm(normals, axis=1, keepdims=True))


def under_axis(piece: Piece, center: tuple[float, ...]) -> int:
    """The region that the axis of a tip meets first; ConfigError where it passes the contact surface by."""
    corners = piece.corners("top")
    inside = np.flatnonzero((shares_of(corners, center) >= -LEVEL).all(axis=1))
    if len(inside) == 0:
        low, high = corners[..., :-1].min(axis=(0, 1)), corners[..., :-1].max(axis=(0, 1))
        spans = " x ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
        raise refused(f"{list(center)[: piece.dim - 1]} is not above the contact surface, which spans {spans}",
                      "put the tip's axis over it", "indenter.center")  # fmt: skip
    facet = piece.grid.surfaces["top"][inside[0]]
    cell = np.flatnonzero(np.isin(piece.grid.cells, facet).sum(axis=1) == piece.dim)[0]
    return int(piece.grid.regions[cell])


def first_touch(tip: Indenter, piece: Piece, center: tuple[float, ...]) -> float:
    """How high [length] the apex of a tip is that comes down along its axis and touches: the largest z - f.

    A quadratic mesh is touched where its curved facets are, though only a refined one has them.
    """
    piece = halved(piece) if len(piece.middles[0]) else piece
    corners, at = piece.corners("top"), np.pad(np.asarray(center), (0, 2))[:2]
    shares = shares_of(corners, center)
    below = (shares >= -LEVEL).all(axis=1)
    highest = float((shares * corners[..., -1]).sum(axis=1)[below].max())  # right under the apex
    for _ in range(BISECTIONS):
        corners = _parts(corners)
        x, y = np.moveaxis(np.pad(corners[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2] - at, -1, 0)
        room = (corners[..., -1] - tip.height(x, y)).max(axis=1)
        highest = max(highest, float(room.max()))
        corners = corners[np.argsort(room)[-CANDIDATES:]]
    return highest


def _parts(corners: np.ndarray) -> np.ndarray:
    """The halves of segments, or the quarters of triangles (k, n, dim)."""
    middle = {(i, j): (corners[:, i] + corners[:, j]) / 2 for i, j in combinations(range(corners.shape[1]), 2)}
    if corners.shape[1] == 2:
        parts = [(corners[:, 0], middle[0, 1]), (middle[0, 1], corners[:, 1])]
    else:
        parts = [(corners[:, i], *(middle[min(i, j), max(i, j)] for j in range(3) if j != i)) for i in range(3)]
        parts.append(tuple(middle.values()))
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def body_of(piece: Piece, source: MeshFromFile, center: tuple[float, ...], material: Material) -> Meshed:
    """What the scene must know of a piece that lies with its first touch at z = 0; `material`: under the tip."""
    top = piece.grid.surfaces["top"]
    rim, _ = boundary_of(top)
    if source.kinematics == "axisymmetric":
        rim = rim[piece.grid.points[rim[:, 0], 0] > 0]  # the axis is no end
    held = [piece.grid.surfaces[name].ravel() for name in ("base", "sides")
            if name in piece.grid.surfaces and getattr(source, name) == "fixed"]  # fmt: skip
    clamped = np.intersect1d(top, np.concatenate([np.empty(0, dtype=top.dtype), *held]))
    return Meshed(piece.height, center, piece.corners("top"), piece.grid.points[rim], piece.grid.points[clamped],
                  (Layer(piece.height, material),), source.base, source.sides, source.dim)  # fmt: skip


def part_of(piece: Piece, source: MeshFromFile, regions: tuple[Region, ...]) -> MeshedPart:
    """The piece as it is modelled: whole, with its supports and the pins that they leave room for."""
    supports: dict[str, str] = {"base": source.base}
    normals: dict[str, int | None] = {"top": None, "base": piece.dim - 1}
    surfaces = dict(piece.grid.surfaces)
    if source.base == "roller":
        _refuse_slanted(piece, "base", piece.dim - 1, source.surfaces.base)
    if "r_min" in surfaces:
        supports["r_min"], normals["r_min"] = "roller", 0
    if source.sides == "fixed":
        supports["sides"], normals["sides"] = "fixed", None
    elif source.sides == "roller":
        for axis, facets in _upright(piece, source).items():
            name = f"sides_{axis}"
            surfaces[name], supports[name], normals[name] = facets, "roller", axis
    placed = replace(piece, grid=replace(piece.grid, surfaces=surfaces))
    symmetry = source.kinematics if source.kinematics == "axisymmetric" else "full"
    part = MeshedPart(KINEMATICS[source.kinematics](), symmetry, 1, (), piece.height, regions, supports, piece=placed,
                      normals=normals)  # fmt: skip
    return replace(part, pins=_pins(part))


def _level(piece: Piece, surface: str, axis: int) -> np.ndarray:
    """Which facets of a surface are normal to an axis (k,)."""
    size = float(np.ptp(piece.grid.points, axis=0).max())
    return np.asarray(np.ptp(piece.corners(surface)[..., axis], axis=1) <= LEVEL * size)


def _refuse_slanted(piece: Piece, surface: str, axis: int, name: str) -> None:
    if (wrong := ~_level(piece, surface, axis)).any():
        raise refused(f"{wrong.sum()} facets of '{name}' are not level, the first at "
                      f"{place_of(piece.corners(surface)[wrong][0])}: a roller would let them through it",
                      f"{surface}: fixed", f"body.{surface}")  # fmt: skip


def _upright(piece: Piece, source: MeshFromFile) -> dict[int, np.ndarray]:
    """The facets of roller sides by the horizontal axis that they are normal to; ConfigError for any other."""
    facets, rest = {}, np.ones(len(piece.grid.surfaces["sides"]), dtype=bool)
    for axis in range(piece.dim - 1):
        here = _level(piece, "sides", axis) & rest
        rest &= ~here
        if here.any():
            facets[axis] = piece.grid.surfaces["sides"][here]
    if rest.any():
        raise refused(f"{rest.sum()} facets of '{source.surfaces.sides}' are normal to no axis, the first at "
                      f"{place_of(piece.corners('sides')[rest][0])}: no roller can guide them",
                      "sides: fixed or free, or a round body as an axisymmetric section", "body.sides")  # fmt: skip
    return facets


def _pins(part: MeshedPart) -> Pins:
    """Point constraints that take the rigid modes which a roller base leaves, and nothing else."""
    if part.kinematics.name == "axisymmetric" or "fixed" in part.supports.values():
        return ()
    held = {part.normal(surface) for surface in part.supports if surface != "base"}
    points = part.piece.grid.points[np.unique(part.piece.grid.surfaces["base"])]
    pins = [(tuple(map(float, points[0])), axis) for axis in range(part.dim - 1) if axis not in held]
    if part.dim == 3 and not held:  # the turn about z is free too
        away = points - points[0]
        far = int(np.argmax(np.abs(away[:, 0]) + np.abs(away[:, 1])))
        pins.append((tuple(map(float, points[far])), int(abs(away[far, 0]) >= abs(away[far, 1]))))
    return tuple(pins)


def refined(part: MeshedPart, sizes: Sizes) -> Grid:
    """The part's mesh, each cell halved along every edge as often as `sizes` says."""
    piece = part.piece.filled
    for _ in range(sizes.refinements or 0):
        piece = halved(piece)
    return piece.grid
