"""A piece from a mesh file as the body that is modelled: where the tip touches it first, how it is
held, its sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from indent_sim.mesh.body_from_file import Piece, halved, parts_of
from indent_sim.mesh.grid import Grid, boundary_of, normals, same_rows
from indent_sim.mesh.mesh_file import place_of, refused
from indent_sim.mesh.modelled_part import Part, Pins, Point, Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Layer, Meshed, MeshFromFile, shares_of
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter

# of the body, or of a facet: what a level face may depart from that, and how far beside it is still
# on it
LEVEL = 1e-9
# how the highest place is looked for: facets are halved, and so many kept
BISECTIONS = 40
FACETS_KEPT = 64
KINDS: dict[str, Kinematics] = {
    "axisymmetric": Axisymmetric(),
    "plane_strain": PlaneStrain(),
    "3d": ThreeDimensional(),
}


@dataclass(frozen=True)
class MeshedPart(Part):
    """A part whose mesh is there: no outline, a piece. `normals`: the axis that each surface is
    normal to, or None.
    """

    piece: Piece = field(kw_only=True, repr=False, compare=False)
    normals: Mapping[str, int | None] = field(kw_only=True)

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """(min, max) along each axis [length]."""
        points = self.piece.grid.points
        return tuple(zip(points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True))

    @property
    def file_hash(self) -> str:
        """Fingerprint of all that was taken from the file."""
        return self.piece.hash

    @property
    def largest(self) -> float:
        """The longest edge of a cell [length]."""
        return self.piece.size.longest_edge

    def facet_near(self, center: Point, begin: float, end: float) -> float:
        """The size of contact facets [length] between two distances from a tip's axis, or of the
        nearest to them.

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

    def sag(self, center: Point, radius: float, refinements: int = 0) -> float:
        """How far contact facets within a radius of the tip's axis are from the arc through their
        corners [length].

        Facets of the size h that meet at the angle t follow a radius of h/t, and their middles are
        h t/8 inside it.
        """
        size = self.facet_near(center, 0.0, radius) / self._halves(refinements)
        return self.turn(center, radius, refinements) * size / 8

    def _halves(self, refinements: int) -> int:
        """How many straight facets a facet becomes whose midside nodes, on the curved surface, are
        corners then.
        """
        return 2 if refinements and len(self.piece.middles[0]) else 1

    def turn(self, center: Point, radius: float, refinements: int = 0) -> float:
        """The mean angle [radians] at which contact facets within a radius of the tip's axis meet."""
        facets = self.piece.grid.surfaces["top"]
        corners = self.piece.corners("top")
        across = normals(corners)
        across = np.where(across[:, -1:] < 0, -across, across)
        ridges = np.sort(
            np.concatenate([np.delete(facets, k, axis=1) for k in range(self.dim)]), axis=1
        )
        order, same = same_rows(ridges)
        one = order[:-1][same] % len(facets)
        other = order[1:][same] % len(facets)
        near = (
            np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1).min(
                axis=1
            )
            <= radius
        )
        met = near[one] | near[other]
        angles = np.arccos(np.clip((across[one] * across[other]).sum(axis=1), -1.0, 1.0))[met]
        return float(angles.mean()) / self._halves(refinements) if met.any() else 0.0

    def normal(self, surface: str) -> int | None:
        """The component of u that a roller holds on a surface; None where no one axis is normal to
        it.
        """
        return self.normals[surface]

    def mirrors(self, center: Point) -> set[str]:
        """The faces of roller sides that lie in a plane through the tip's axis, at an end of the
        body, as x_min.
        """
        found: set[str] = set()
        for surface, axis in self.normals.items():
            if (
                axis is None
                or self.supports.get(surface) != "roller"
                or not surface.startswith("sides_")
            ):
                continue
            end = end_under(self.piece, center, axis)
            if end and _through(self.piece.corners(surface), self.piece, center, axis).any():
                found.add(f"{'xy'[axis]}_{end}")
        return found


def under_axis(piece: Piece, center: tuple[float, ...]) -> int:
    """The region that the axis of a tip meets first; ConfigError where it passes the contact
    surface by.
    """
    corners = piece.corners("top")
    inside = np.flatnonzero((shares_of(corners, center) >= -LEVEL).all(axis=1))
    if len(inside) == 0:
        low = corners[..., :-1].min(axis=(0, 1))
        high = corners[..., :-1].max(axis=(0, 1))
        spans = " x ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
        problem = (
            f"{list(center)[: piece.dim - 1]} is not above the contact surface, which spans {spans}"
        )
        raise refused(problem, "put the tip's axis over it", "indenter.center")
    facet = piece.grid.surfaces["top"][inside[0]]
    cell = np.flatnonzero(np.isin(piece.grid.cells, facet).sum(axis=1) == piece.dim)[0]
    return int(piece.grid.regions[cell])


def first_touch(tip: Indenter, piece: Piece, center: tuple[float, ...]) -> float:
    """How high [length] the apex of a tip is that comes down along its axis and touches: the
    largest z - f.

    A quadratic mesh is touched where its curved facets are, though only a refined one has them.
    """
    piece = halved(piece) if len(piece.middles[0]) else piece
    corners = piece.corners("top")
    at = np.pad(np.asarray(center), (0, 2))[:2]
    shares = shares_of(corners, center)
    below = (shares >= -LEVEL).all(axis=1)
    highest = float((shares * corners[..., -1]).sum(axis=1)[below].max())  # right under the apex
    for _ in range(BISECTIONS):
        corners, _ = parts_of(list(np.moveaxis(corners, 1, 0)), lambda a, b: (a + b) / 2)
        x, y = np.moveaxis(np.pad(corners[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2] - at, -1, 0)
        room = (corners[..., -1] - tip.height(x, y)).max(axis=1)
        highest = max(highest, float(room.max()))
        corners = corners[np.argsort(room)[-FACETS_KEPT:]]
    return highest


def end_under(piece: Piece, center: Point, axis: int) -> str:
    """Which end of a piece along a horizontal axis lies right under a tip's axis: min, max, or ""
    for none.
    """
    along = piece.grid.points[:, axis]
    near = LEVEL * float(np.ptp(piece.grid.points, axis=0).max())
    if abs(float(along.min()) - center[axis]) <= near:
        return "min"
    return "max" if abs(float(along.max()) - center[axis]) <= near else ""


def _through(corners: np.ndarray, piece: Piece, center: Point, axis: int) -> np.ndarray:
    """Which facets (k, n, dim) lie in the plane normal to a horizontal axis through a tip's axis
    (k,).
    """
    near = LEVEL * float(np.ptp(piece.grid.points, axis=0).max())
    return np.asarray((np.abs(corners[..., axis] - center[axis]) <= near).all(axis=-1))


def refuse_forgotten_mirrors(piece: Piece, source: MeshFromFile, center: Point) -> None:
    """Ask how a face is held that lies in a plane through the tip's axis, where the scene does not
    say it.

    Half of a symmetric body needs a roller there; forgotten it cost a third of the force without a
    word. ConfigError.
    """
    if source.sides != "auto" or source.kinematics == "axisymmetric":
        return
    outside, _ = boundary_of(piece.grid.cells)
    corners = piece.grid.points[outside]
    for axis in range(piece.dim - 1):
        facets = (
            _through(corners, piece, center, axis)
            if end_under(piece, center, axis)
            else np.zeros(1, dtype=bool)
        )
        if facets.any():
            plane = f"{'xy'[axis]} = {center[axis]:.4g}"
            problem = (
                f"{facets.sum()} facets lie in the plane {plane} through the tip's axis: are they "
                "a mirror plane?"
            )
            remedy = (
                "sides: roller where the body goes on as its mirror image, sides: free where it "
                "ends"
            )
            raise refused(problem, remedy, "body.sides")


def body_of(
    piece: Piece, source: MeshFromFile, center: tuple[float, ...], material: Material
) -> Meshed:
    """What the scene must know of a piece that lies with its first touch at z = 0; `material`:
    under the tip.
    """
    top = piece.grid.surfaces["top"]
    rim, _ = boundary_of(top)
    if source.kinematics == "axisymmetric":
        rim = rim[piece.grid.points[rim[:, 0], 0] > 0]  # the axis is no end
    for axis in range(piece.dim - 1) if source.sides == "roller" else ():  # nor is a mirror plane
        if end_under(piece, center, axis):
            sides = piece.grid.surfaces["sides"]
            mirror = np.unique(sides[_through(piece.grid.points[sides], piece, center, axis)])
            rim = rim[~np.isin(rim, mirror).all(axis=1)]
    fixed = [name for name in ("base", "sides") if getattr(source, name) == "fixed"]
    held = [piece.grid.surfaces[name].ravel() for name in fixed if name in piece.grid.surfaces]
    clamped = np.intersect1d(top, np.concatenate([np.empty(0, dtype=top.dtype), *held]))
    ends = (piece.grid.points[rim], piece.grid.points[clamped])
    layers = (Layer(piece.height, material),)
    supports = source.base, "free" if source.sides == "auto" else source.sides
    return Meshed(piece.height, center, piece.corners("top"), *ends, layers, *supports, source.dim)


def part_of(piece: Piece, source: MeshFromFile, regions: tuple[Region, ...]) -> MeshedPart:
    """The piece as it is modelled: whole, with its supports and the pins that they leave room for."""
    supports: dict[str, str] = {"base": source.base}
    normals: dict[str, int | None] = {"top": None, "base": piece.dim - 1}
    surfaces = dict(piece.grid.surfaces)
    if source.base == "roller" and (wrong := ~_level(piece, "base", piece.dim - 1)).any():
        where = (
            f"the first at {place_of(piece.corners('base')[wrong][0])}: a roller would let "
            "them through it"
        )
        problem = f"{wrong.sum()} facets of '{source.named.base}' are not level, {where}"
        raise refused(problem, "base: fixed", "body.base")
    if "r_min" in surfaces:
        supports["r_min"] = "roller"
        normals["r_min"] = 0
    if source.sides == "fixed":
        supports["sides"] = "fixed"
        normals["sides"] = None
    elif source.sides == "roller":
        for axis, facets in _upright(piece, source).items():
            name = f"sides_{axis}"
            surfaces[name] = facets
            supports[name] = "roller"
            normals[name] = axis
    placed = replace(piece, grid=replace(piece.grid, surfaces=surfaces))
    symmetry = source.kinematics if source.kinematics == "axisymmetric" else "full"
    kind = KINDS[source.kinematics]
    height = piece.height
    part = MeshedPart(
        kind, symmetry, 1, (), height, regions, supports, piece=placed, normals=normals
    )
    return replace(part, pins=_pins(part))


def _level(piece: Piece, surface: str, axis: int) -> np.ndarray:
    """Which facets of a surface are normal to an axis (k,)."""
    size = float(np.ptp(piece.grid.points, axis=0).max())
    return np.asarray(np.ptp(piece.corners(surface)[..., axis], axis=1) <= LEVEL * size)


def _upright(piece: Piece, source: MeshFromFile) -> dict[int, np.ndarray]:
    """The facets of roller sides by the horizontal axis that they are normal to; ConfigError for
    any other.
    """
    facets = {}
    rest = np.ones(len(piece.grid.surfaces["sides"]), dtype=bool)
    for axis in range(piece.dim - 1):
        here = _level(piece, "sides", axis) & rest
        rest &= ~here
        if here.any():
            facets[axis] = piece.grid.surfaces["sides"][here]
    if rest.any():
        where = (
            f"the first at {place_of(piece.corners('sides')[rest][0])}: no roller can guide them"
        )
        problem = f"{rest.sum()} facets of '{source.named.sides}' are normal to no axis, {where}"
        raise refused(
            problem,
            "sides: fixed or free, or a round body as an axisymmetric section",
            "body.sides",
        )
    return facets


def _pins(part: MeshedPart) -> Pins:
    """Point constraints that take the rigid modes which a roller base leaves, and nothing else."""
    if part.kinematics.name == "axisymmetric" or "fixed" in part.supports.values():
        return ()
    held = {part.normal(surface) for surface in part.supports if surface != "base"}
    points = part.piece.grid.points[np.unique(part.piece.grid.surfaces["base"])]
    pins = [
        (tuple(map(float, points[0])), axis) for axis in range(part.dim - 1) if axis not in held
    ]
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
