"""A piece from a mesh file as the body that is modelled: where the tip touches it first, how it is
held, its sizes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from indent_sim.mesh.grid import Grid, boundary_facets, sort_and_match_rows, unit_normals
from indent_sim.mesh.imported_mesh import ImportedMesh, refined_once, split_at_midpoints
from indent_sim.mesh.mesh_file import format_midpoint, mesh_file_error
from indent_sim.mesh.model_domain import ModelDomain, Pins, Point, Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.imported_body import ImportedBody, MeshFromFile, barycentric_coordinates
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.layers import Layer
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter

# of the body, or of a facet: what a level face may depart from that, and how far beside it is still
# on it
LEVEL_TOLERANCE = 1e-9
# how the highest place is looked for: facets are halved, and so many kept
BISECTIONS = 40
FACETS_KEPT = 64
KINEMATICS: dict[str, Kinematics] = {
    "axisymmetric": Axisymmetric(),
    "plane_strain": PlaneStrain(),
    "3d": ThreeDimensional(),
}


@dataclass(frozen=True)
class ImportedDomain(ModelDomain):
    """A part whose mesh is there: no outline, a piece. `normals`: the axis that each surface is
    normal to, or None.
    """

    mesh: ImportedMesh = field(kw_only=True, repr=False, compare=False)
    normal_axes: Mapping[str, int | None] = field(kw_only=True)

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """(min, max) along each axis [length]."""
        points = self.mesh.grid.points
        return tuple(zip(points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True))

    @property
    def file_hash(self) -> str:
        """Fingerprint of all that was taken from the file."""
        return self.mesh.hash

    @property
    def longest_edge(self) -> float:
        """The longest edge of a cell [length]."""
        return self.mesh.statistics.longest_edge

    def facet_size_near(self, center: Point, inner_radius: float, outer_radius: float) -> float:
        """The size of contact facets [length] between two distances from a tip's axis, or of the
        nearest to them.

        Of a triangle that of the equilateral one with its area; in the geometric mean.
        """
        corners = self.mesh.facet_corners("top")
        edges = corners[:, 1:] - corners[:, :1]
        facet_measures = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        sizes = facet_measures if self.dim == 2 else np.sqrt(2 / np.sqrt(3) * facet_measures)
        distances = np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1)
        is_inside = (barycentric_coordinates(corners, center) >= -LEVEL_TOLERANCE).all(axis=1)
        nearest_distances = np.where(is_inside, 0.0, distances.min(axis=1))
        excess_distances = np.maximum(
            np.maximum(nearest_distances - outer_radius, inner_radius - distances.max(axis=1)), 0.0
        )
        return float(np.exp(np.log(sizes[excess_distances == excess_distances.min()]).mean()))

    def facet_sagitta(self, center: Point, radius: float, refinements: int = 0) -> float:
        """How far contact facets within a radius of the tip's axis are from the arc through their
        corners [length].

        Facets of the size h that meet at the angle t follow a radius of h/t, and their middles are
        h t/8 inside it.
        """
        size = self.facet_size_near(center, 0.0, radius) / self._facet_divisions(refinements)
        return self.facet_angle(center, radius, refinements) * size / 8

    def _facet_divisions(self, refinements: int) -> int:
        """How many straight facets a facet becomes whose midside nodes, on the curved surface, are
        corners then.
        """
        return 2 if refinements and len(self.mesh.midside_nodes[0]) else 1

    def facet_angle(self, center: Point, radius: float, refinements: int = 0) -> float:
        """The mean angle [radians] at which contact facets within a radius of the tip's axis meet."""
        facets = self.mesh.grid.surfaces["top"]
        corners = self.mesh.facet_corners("top")
        normal_vectors = unit_normals(corners)
        normal_vectors = np.where(normal_vectors[:, -1:] < 0, -normal_vectors, normal_vectors)
        ridges = np.sort(
            np.concatenate([np.delete(facets, k, axis=1) for k in range(self.dim)]), axis=1
        )
        order, is_shared = sort_and_match_rows(ridges)
        first_facet = order[:-1][is_shared] % len(facets)
        second_facet = order[1:][is_shared] % len(facets)
        is_near = (
            np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1).min(
                axis=1
            )
            <= radius
        )
        is_adjacent = is_near[first_facet] | is_near[second_facet]
        angles = np.arccos(
            np.clip(
                (normal_vectors[first_facet] * normal_vectors[second_facet]).sum(axis=1), -1.0, 1.0
            )
        )[is_adjacent]
        return (
            float(angles.mean()) / self._facet_divisions(refinements) if is_adjacent.any() else 0.0
        )

    def normal_component(self, surface: str) -> int | None:
        """The component of u that a roller holds on a surface; None where no one axis is normal to
        it.
        """
        return self.normal_axes[surface]

    def mirror_walls(self, center: Point) -> set[str]:
        """The faces of roller sides that lie in a plane through the tip's axis, at an end of the
        body, as x_min.
        """
        walls: set[str] = set()
        for surface, axis in self.normal_axes.items():
            if (
                axis is None
                or self.supports.get(surface) != "roller"
                or not surface.startswith("sides_")
            ):
                continue
            end = end_at_axis(self.mesh, center, axis)
            if (
                end
                and _is_in_axis_plane(
                    self.mesh.facet_corners(surface), self.mesh, center, axis
                ).any()
            ):
                walls.add(f"{'xy'[axis]}_{end}")
        return walls


def region_under_axis(mesh: ImportedMesh, center: tuple[float, ...]) -> int:
    """The region that the axis of a tip meets first; ConfigError where it passes the contact
    surface by.
    """
    corners = mesh.facet_corners("top")
    inside_facets = np.flatnonzero(
        (barycentric_coordinates(corners, center) >= -LEVEL_TOLERANCE).all(axis=1)
    )
    if len(inside_facets) == 0:
        low = corners[..., :-1].min(axis=(0, 1))
        high = corners[..., :-1].max(axis=(0, 1))
        spans = " x ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
        problem = (
            f"{list(center)[: mesh.dim - 1]} is not above the contact surface, which spans {spans}"
        )
        raise mesh_file_error(problem, "put the tip's axis over it", "indenter.center")
    facet = mesh.grid.surfaces["top"][inside_facets[0]]
    cell = np.flatnonzero(np.isin(mesh.grid.cells, facet).sum(axis=1) == mesh.dim)[0]
    return int(mesh.grid.regions[cell])


def first_contact_height(tip: Indenter, mesh: ImportedMesh, center: tuple[float, ...]) -> float:
    """How high [length] the apex of a tip is that comes down along its axis and touches: the
    largest z - f.

    A quadratic mesh is touched where its curved facets are, though only a refined one has them.
    """
    mesh = refined_once(mesh) if len(mesh.midside_nodes[0]) else mesh
    corners = mesh.facet_corners("top")
    axis_position = np.pad(np.asarray(center), (0, 2))[:2]
    barycentric = barycentric_coordinates(corners, center)
    is_under_axis = (barycentric >= -LEVEL_TOLERANCE).all(axis=1)
    largest_height = float(
        (barycentric * corners[..., -1]).sum(axis=1)[is_under_axis].max()
    )  # right under the apex
    for _ in range(BISECTIONS):
        corners, _ = split_at_midpoints(list(np.moveaxis(corners, 1, 0)), lambda a, b: (a + b) / 2)
        x, y = np.moveaxis(
            np.pad(corners[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2] - axis_position, -1, 0
        )
        facet_heights = (corners[..., -1] - tip.height(x, y)).max(axis=1)
        largest_height = max(largest_height, float(facet_heights.max()))
        corners = corners[np.argsort(facet_heights)[-FACETS_KEPT:]]
    return largest_height


def end_at_axis(mesh: ImportedMesh, center: Point, axis: int) -> str:
    """Which end of a piece along a horizontal axis lies right under a tip's axis: min, max, or ""
    for none.
    """
    coordinates = mesh.grid.points[:, axis]
    tolerance = LEVEL_TOLERANCE * float(np.ptp(mesh.grid.points, axis=0).max())
    if abs(float(coordinates.min()) - center[axis]) <= tolerance:
        return "min"
    return "max" if abs(float(coordinates.max()) - center[axis]) <= tolerance else ""


def _is_in_axis_plane(
    corners: np.ndarray, mesh: ImportedMesh, center: Point, axis: int
) -> np.ndarray:
    """Which facets (k, n, dim) lie in the plane normal to a horizontal axis through a tip's axis
    (k,).
    """
    tolerance = LEVEL_TOLERANCE * float(np.ptp(mesh.grid.points, axis=0).max())
    return np.asarray((np.abs(corners[..., axis] - center[axis]) <= tolerance).all(axis=-1))


def refuse_forgotten_mirrors(mesh: ImportedMesh, source: MeshFromFile, center: Point) -> None:
    """Ask how a face is held that lies in a plane through the tip's axis, where the scene does not
    say it.

    Half of a symmetric body needs a roller there; forgotten it cost a third of the force without a
    word. ConfigError.
    """
    if source.sides != "auto" or source.kinematics == "axisymmetric":
        return
    outer_facets, _ = boundary_facets(mesh.grid.cells)
    corners = mesh.grid.points[outer_facets]
    for axis in range(mesh.dim - 1):
        facets = (
            _is_in_axis_plane(corners, mesh, center, axis)
            if end_at_axis(mesh, center, axis)
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
            raise mesh_file_error(problem, remedy, "body.sides")


def imported_body(
    mesh: ImportedMesh, source: MeshFromFile, center: tuple[float, ...], material: Material
) -> ImportedBody:
    """What the scene must know of a piece that lies with its first touch at z = 0; `material`:
    under the tip.
    """
    top_facets = mesh.grid.surfaces["top"]
    boundary_edges, _ = boundary_facets(top_facets)
    if source.kinematics == "axisymmetric":
        boundary_edges = boundary_edges[
            mesh.grid.points[boundary_edges[:, 0], 0] > 0
        ]  # the axis is no end
    for axis in range(mesh.dim - 1) if source.sides == "roller" else ():  # nor is a mirror plane
        if end_at_axis(mesh, center, axis):
            sides = mesh.grid.surfaces["sides"]
            mirror = np.unique(
                sides[_is_in_axis_plane(mesh.grid.points[sides], mesh, center, axis)]
            )
            boundary_edges = boundary_edges[~np.isin(boundary_edges, mirror).all(axis=1)]
    fixed_surfaces = [name for name in ("base", "sides") if getattr(source, name) == "fixed"]
    fixed_facets = [
        mesh.grid.surfaces[name].ravel() for name in fixed_surfaces if name in mesh.grid.surfaces
    ]
    fixed_points = np.intersect1d(
        top_facets, np.concatenate([np.empty(0, dtype=top_facets.dtype), *fixed_facets])
    )
    boundary_points = (mesh.grid.points[boundary_edges], mesh.grid.points[fixed_points])
    layers = (Layer(mesh.height, material),)
    supports = source.base, "free" if source.sides == "auto" else source.sides
    return ImportedBody(
        mesh.height,
        center,
        mesh.facet_corners("top"),
        *boundary_points,
        layers,
        *supports,
        source.dim,
    )


def imported_domain(
    mesh: ImportedMesh, source: MeshFromFile, regions: tuple[Region, ...]
) -> ImportedDomain:
    """The piece as it is modelled: whole, with its supports and the pins that they leave room for."""
    supports: dict[str, str] = {"base": source.base}
    normal_axes: dict[str, int | None] = {"top": None, "base": mesh.dim - 1}
    surfaces = dict(mesh.grid.surfaces)
    if source.base == "roller" and (is_tilted := ~_is_level(mesh, "base", mesh.dim - 1)).any():
        location = (
            f"the first at {format_midpoint(mesh.facet_corners('base')[is_tilted][0])}: a roller would let "
            "them through it"
        )
        problem = (
            f"{is_tilted.sum()} facets of '{source.surface_names.base}' are not level, {location}"
        )
        raise mesh_file_error(problem, "base: fixed", "body.base")
    if "r_min" in surfaces:
        supports["r_min"] = "roller"
        normal_axes["r_min"] = 0
    if source.sides == "fixed":
        supports["sides"] = "fixed"
        normal_axes["sides"] = None
    elif source.sides == "roller":
        for axis, facets in _roller_facets(mesh, source).items():
            name = f"sides_{axis}"
            surfaces[name] = facets
            supports[name] = "roller"
            normal_axes[name] = axis
    mesh_with_surfaces = replace(mesh, grid=replace(mesh.grid, surfaces=surfaces))
    symmetry = source.kinematics if source.kinematics == "axisymmetric" else "full"
    kinematics = KINEMATICS[source.kinematics]
    height = mesh.height
    domain = ImportedDomain(
        kinematics,
        symmetry,
        1,
        (),
        height,
        regions,
        supports,
        mesh=mesh_with_surfaces,
        normal_axes=normal_axes,
    )
    return replace(domain, pins=_pins(domain))


def _is_level(mesh: ImportedMesh, surface: str, axis: int) -> np.ndarray:
    """Which facets of a surface are normal to an axis (k,)."""
    size = float(np.ptp(mesh.grid.points, axis=0).max())
    return np.asarray(
        np.ptp(mesh.facet_corners(surface)[..., axis], axis=1) <= LEVEL_TOLERANCE * size
    )


def _roller_facets(mesh: ImportedMesh, source: MeshFromFile) -> dict[int, np.ndarray]:
    """The facets of roller sides by the horizontal axis that they are normal to; ConfigError for
    any other.
    """
    facets = {}
    is_unassigned = np.ones(len(mesh.grid.surfaces["sides"]), dtype=bool)
    for axis in range(mesh.dim - 1):
        is_normal = _is_level(mesh, "sides", axis) & is_unassigned
        is_unassigned &= ~is_normal
        if is_normal.any():
            facets[axis] = mesh.grid.surfaces["sides"][is_normal]
    if is_unassigned.any():
        location = f"the first at {format_midpoint(mesh.facet_corners('sides')[is_unassigned][0])}: no roller can guide them"
        problem = f"{is_unassigned.sum()} facets of '{source.surface_names.sides}' are normal to no axis, {location}"
        raise mesh_file_error(
            problem,
            "sides: fixed or free, or a round body as an axisymmetric section",
            "body.sides",
        )
    return facets


def _pins(domain: ImportedDomain) -> Pins:
    """Point constraints that take the rigid modes which a roller base leaves, and nothing else."""
    if domain.kinematics.name == "axisymmetric" or "fixed" in domain.supports.values():
        return ()
    held_axes = {
        domain.normal_component(surface) for surface in domain.supports if surface != "base"
    }
    points = domain.mesh.grid.points[np.unique(domain.mesh.grid.surfaces["base"])]
    pins = [
        (tuple(map(float, points[0])), axis)
        for axis in range(domain.dim - 1)
        if axis not in held_axes
    ]
    if domain.dim == 3 and not held_axes:  # the turn about z is free too
        offsets = points - points[0]
        farthest = int(np.argmax(np.abs(offsets[:, 0]) + np.abs(offsets[:, 1])))
        pins.append(
            (
                tuple(map(float, points[farthest])),
                int(abs(offsets[farthest, 0]) >= abs(offsets[farthest, 1])),
            )
        )
    return tuple(pins)


def refine_domain(domain: ImportedDomain, sizes: Sizes) -> Grid:
    """The part's mesh, each cell halved along every edge as often as `sizes` says."""
    mesh = domain.mesh.full_mesh
    for _ in range(sizes.refinements or 0):
        mesh = refined_once(mesh)
    return mesh.grid
