"""Model domain of an imported mesh: first contact with the tip, supports and facet sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from indent_sim.mesh.grid import Grid, boundary_facets, sort_and_match_rows, unit_normals
from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.mesh_file import format_midpoint, mesh_file_error
from indent_sim.mesh.model_domain import ModelDomain, Pins, Point, Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.mesh.uniform_refinement import refined_once, split_at_midpoints
from indent_sim.model.imported_body import ImportedBody, MeshFromFile, barycentric_coordinates
from indent_sim.model.kinematics import Axisymmetric, Kinematics, PlaneStrain, ThreeDimensional
from indent_sim.model.layers import Layer
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter

# Deviation from a plane, relative to the size of the body, up to which a face counts as level; and
# a barycentric coordinate down to minus this value counts as inside its facet.
LEVEL_TOLERANCE = 1e-9


@dataclass(frozen=True)
class ImportedDomain(ModelDomain):
    """Model domain whose mesh is read from a file; it has no outline.

    Attributes
    ----------
    mesh
        The imported mesh, with the surfaces of the domain.
    normal_axes
        Axis to which each surface is normal; None if there is no such axis.
    """

    mesh: ImportedMesh = field(kw_only=True, repr=False, compare=False)
    normal_axes: Mapping[str, int | None] = field(kw_only=True)

    @property
    def extent(self) -> tuple[tuple[float, float], ...]:
        """Smallest and largest coordinate along each axis [length]."""
        points = self.mesh.grid.points
        return tuple(zip(points.min(axis=0).tolist(), points.max(axis=0).tolist(), strict=True))

    @property
    def file_hash(self) -> str:
        """Hash of all data that were taken from the file."""
        return self.mesh.hash

    @property
    def longest_edge(self) -> float:
        """Length of the longest edge of a cell [length]."""
        return self.mesh.statistics.longest_edge

    def facet_size_near(self, center: Point, inner_radius: float, outer_radius: float) -> float:
        """Return the geometric mean size of the contact facets in a ring around the tip's axis.

        Parameters
        ----------
        center : tuple of float
            Horizontal position of the tip's axis [length].
        inner_radius, outer_radius : float
            Radii of the ring [length]; if it contains no facet, the nearest facets are used.

        Returns
        -------
        float
            Facet size [length]; for a triangle, the edge of an equilateral triangle of equal area.
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
        """Return the mean distance of contact facets from the arc through their corners [length].

        Facets of size h that meet at an angle t approximate an arc of radius h/t, and their
        midpoints lie h * t/8 inside it.

        Parameters
        ----------
        center : tuple of float
            Horizontal position of the tip's axis [length].
        radius : float
            Radius around the axis within which facets are considered [length].
        refinements : int, optional
            Number of uniform refinements of the mesh.
        """
        size = self.facet_size_near(center, 0.0, radius) / self._facet_divisions(refinements)
        return self.facet_angle(center, radius, refinements) * size / 8

    def _facet_divisions(self, refinements: int) -> int:
        """Return the number of straight facets that replace one facet after refinement.

        The number is 2 for a quadratic mesh, whose midside nodes lie on the curved surface and
        become corners, and 1 for a linear mesh, because the parts of a straight facet stay in its
        plane.
        """
        return 2 if refinements and len(self.mesh.midside_nodes[0]) else 1

    def facet_angle(self, center: Point, radius: float, refinements: int = 0) -> float:
        """Return the mean angle [radians] between adjacent contact facets near the tip.

        The parameters are those of `facet_sagitta`. The angle is 0 if no facet is within the
        radius.
        """
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
        distances = np.linalg.norm(corners[..., :-1] - np.asarray(center[: self.dim - 1]), axis=-1)
        is_near = distances.min(axis=1) <= radius
        is_adjacent = is_near[first_facet] | is_near[second_facet]
        if not is_adjacent.any():
            return 0.0
        cosines = (normal_vectors[first_facet] * normal_vectors[second_facet]).sum(axis=1)
        angles = np.arccos(np.clip(cosines, -1.0, 1.0))[is_adjacent]
        return float(angles.mean()) / self._facet_divisions(refinements)

    def normal_component(self, surface: str) -> int | None:
        """Return the displacement component that a roller on a surface constrains.

        The result is None if the surface is not normal to an axis.
        """
        return self.normal_axes[surface]

    def mirror_walls(self, center: Point) -> set[str]:
        """Return the names, such as x_min, of roller sides in a plane through the tip's axis."""
        walls: set[str] = set()
        for surface, axis in self.normal_axes.items():
            is_roller_side = self.supports.get(surface) == "roller" and surface.startswith("sides_")
            if axis is None or not is_roller_side:
                continue
            end = end_at_axis(self.mesh, center, axis)
            corners = self.mesh.facet_corners(surface)
            if end and _is_in_axis_plane(corners, self.mesh, center, axis).any():
                walls.add(f"{'xy'[axis]}_{end}")
        return walls


def region_under_axis(mesh: ImportedMesh, center: tuple[float, ...]) -> int:
    """Return the number of the region below the tip's apex.

    Raises
    ------
    ConfigError
        If the tip's axis does not meet the contact surface.
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
        raise mesh_file_error(problem, "choose a position above it", "indenter.center")
    facet = mesh.grid.surfaces["top"][inside_facets[0]]
    cell = np.flatnonzero(np.isin(mesh.grid.cells, facet).sum(axis=1) == mesh.dim)[0]
    return int(mesh.grid.regions[cell])


def first_contact_height(tip: Indenter, mesh: ImportedMesh, center: tuple[float, ...]) -> float:
    """Return the height [length] of a tip's apex at first contact.

    This height is the largest z - f over the contact surface, where z is the height of the surface
    and f the height of the tip above the apex. It is found by bisection of the facets with the
    largest value.

    Parameters
    ----------
    tip : Indenter
        The tip, in the length unit of the mesh.
    mesh : ImportedMesh
        The mesh. A quadratic mesh is refined once, because its midside nodes lie on the curved
        surface.
    center : tuple of float
        Horizontal position of the tip's axis [length].

    Returns
    -------
    float
        Height of the apex [length].
    """
    mesh = refined_once(mesh) if len(mesh.midside_nodes[0]) else mesh
    corners = mesh.facet_corners("top")
    axis_position = np.pad(np.asarray(center), (0, 2))[:2]
    barycentric = barycentric_coordinates(corners, center)
    is_under_axis = (barycentric >= -LEVEL_TOLERANCE).all(axis=1)
    # The surface right under the apex, which need not be near a corner, is the first candidate.
    largest_height = float((barycentric * corners[..., -1]).sum(axis=1)[is_under_axis].max())
    # The search for first contact bisects all edges this many times, and keeps this many facets
    # each time.
    bisection_count = 40
    facets_kept = 64
    for _ in range(bisection_count):
        corners, _ = split_at_midpoints(list(np.moveaxis(corners, 1, 0)), lambda a, b: (a + b) / 2)
        x, y = np.moveaxis(
            np.pad(corners[..., :-1], ((0, 0), (0, 0), (0, 1)))[..., :2] - axis_position, -1, 0
        )
        facet_heights = (corners[..., -1] - tip.height(x, y)).max(axis=1)
        largest_height = max(largest_height, float(facet_heights.max()))
        corners = corners[np.argsort(facet_heights)[-facets_kept:]]
    return largest_height


def end_at_axis(mesh: ImportedMesh, center: Point, axis: int) -> str:
    """Return which end of a mesh lies under the tip's axis: "min", "max", or "" for no end.

    `axis` is the number of the horizontal axis along which the mesh ends.
    """
    coordinates = mesh.grid.points[:, axis]
    tolerance = LEVEL_TOLERANCE * float(np.ptp(mesh.grid.points, axis=0).max())
    if abs(float(coordinates.min()) - center[axis]) <= tolerance:
        return "min"
    return "max" if abs(float(coordinates.max()) - center[axis]) <= tolerance else ""


def _is_in_axis_plane(
    corners: np.ndarray, mesh: ImportedMesh, center: Point, axis: int
) -> np.ndarray:
    """Return which facets lie in the plane through the tip's axis that is normal to `axis` (k,).

    `corners` are the corners of the facets (k, n, dim) [length].
    """
    tolerance = LEVEL_TOLERANCE * float(np.ptp(mesh.grid.points, axis=0).max())
    return np.asarray((np.abs(corners[..., axis] - center[axis]) <= tolerance).all(axis=-1))


def refuse_forgotten_mirrors(mesh: ImportedMesh, source: MeshFromFile, center: Point) -> None:
    """Check that the scene gives the support of every face in a plane through the tip's axis.

    The face may be the mirror plane of half a body, which needs a roller. If it is left free by
    mistake, the force is too small by up to a third.

    Raises
    ------
    ConfigError
        If there is such a face and `body.sides` is "auto".
    """
    if source.sides != "auto" or source.kinematics == "axisymmetric":
        return
    outer_facets, _ = boundary_facets(mesh.grid.cells)
    corners = mesh.grid.points[outer_facets]
    for axis in range(mesh.dim - 1):
        if not end_at_axis(mesh, center, axis):
            continue
        is_in_plane = _is_in_axis_plane(corners, mesh, center, axis)
        if is_in_plane.any():
            plane = f"{'xy'[axis]} = {center[axis]:.4g}"
            problem = (
                f"{is_in_plane.sum()} facets lie in the plane {plane} through the tip's axis, "
                "which may be a mirror plane of the body"
            )
            remedy = (
                "set sides: roller if the mesh is half of a symmetric body, and sides: free if the "
                "body ends there"
            )
            raise mesh_file_error(problem, remedy, "body.sides")


def imported_body(
    mesh: ImportedMesh, source: MeshFromFile, center: tuple[float, ...], material: Material
) -> ImportedBody:
    """Return the body of an imported mesh that has been moved to its first contact at z = 0.

    Parameters
    ----------
    mesh : ImportedMesh
        The mesh, translated to first contact.
    source : MeshFromFile
        The body in the scene file.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    material : Material
        The material below the tip.

    Returns
    -------
    ImportedBody
        The body with contact facets, edges of the contact surface, and fixed points.
    """
    top_facets = mesh.grid.surfaces["top"]
    boundary_edges, _ = boundary_facets(top_facets)
    # The contact surface ends neither at the axis of revolution nor at a mirror plane.
    if source.kinematics == "axisymmetric":
        boundary_edges = boundary_edges[mesh.grid.points[boundary_edges[:, 0], 0] > 0]
    for axis in range(mesh.dim - 1) if source.sides == "roller" else ():
        if end_at_axis(mesh, center, axis):
            sides = mesh.grid.surfaces["sides"]
            mirror_points = np.unique(
                sides[_is_in_axis_plane(mesh.grid.points[sides], mesh, center, axis)]
            )
            boundary_edges = boundary_edges[~np.isin(boundary_edges, mirror_points).all(axis=1)]
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
    """Return the model domain of an imported mesh, with supports and pins.

    Parameters
    ----------
    mesh : ImportedMesh
        The nondimensional mesh.
    source : MeshFromFile
        The body in the scene file.
    regions : tuple of Region
        Material and formulation of each region of the mesh.

    Returns
    -------
    ImportedDomain
        The whole mesh, without symmetry reduction.

    Raises
    ------
    ConfigError
        If a roller support has facets that are normal to no axis.
    """
    supports: dict[str, str] = {"base": source.base}
    normal_axes: dict[str, int | None] = {"top": None, "base": mesh.dim - 1}
    surfaces = dict(mesh.grid.surfaces)
    if source.base == "roller":
        _check_roller_base(mesh, source)
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
    kinematics_by_name: dict[str, Kinematics] = {
        "axisymmetric": Axisymmetric(),
        "plane_strain": PlaneStrain(),
        "3d": ThreeDimensional(),
    }
    kinematics = kinematics_by_name[source.kinematics]
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


def _check_roller_base(mesh: ImportedMesh, source: MeshFromFile) -> None:
    """Raise ConfigError if a facet of a roller base is not horizontal."""
    is_tilted = ~_is_level(mesh, "base", mesh.dim - 1)
    if is_tilted.any():
        location = format_midpoint(mesh.facet_corners("base")[is_tilted][0])
        problem = (
            f"{is_tilted.sum()} facets of '{source.surface_names.base}' are not horizontal, the "
            f"first at {location}, and a roller base constrains u_z only"
        )
        raise mesh_file_error(problem, "use base: fixed", "body.base")


def _is_level(mesh: ImportedMesh, surface: str, axis: int) -> np.ndarray:
    """Return a mask (k,) of the facets of a surface that are normal to an axis."""
    size = float(np.ptp(mesh.grid.points, axis=0).max())
    return np.asarray(
        np.ptp(mesh.facet_corners(surface)[..., axis], axis=1) <= LEVEL_TOLERANCE * size
    )


def _roller_facets(mesh: ImportedMesh, source: MeshFromFile) -> dict[int, np.ndarray]:
    """Return the facets of roller sides, keyed by the horizontal axis normal to them.

    Raises
    ------
    ConfigError
        If a facet is not normal to an axis.
    """
    facets = {}
    is_unassigned = np.ones(len(mesh.grid.surfaces["sides"]), dtype=bool)
    for axis in range(mesh.dim - 1):
        is_normal = _is_level(mesh, "sides", axis) & is_unassigned
        is_unassigned &= ~is_normal
        if is_normal.any():
            facets[axis] = mesh.grid.surfaces["sides"][is_normal]
    if is_unassigned.any():
        location = format_midpoint(mesh.facet_corners("sides")[is_unassigned][0])
        problem = (
            f"{is_unassigned.sum()} facets of '{source.surface_names.sides}' are not normal to a "
            f"coordinate axis, the first at {location}, as a roller requires"
        )
        remedy = "use sides: fixed or free, or mesh a round body as an axisymmetric section"
        raise mesh_file_error(problem, remedy, "body.sides")
    return facets


def _pins(domain: ImportedDomain) -> Pins:
    """Return point constraints of the rigid-body modes that a roller base does not prevent."""
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
    if domain.dim == 3 and not held_axes:
        # The rotation about z is free, too.
        offsets = points - points[0]
        farthest = int(np.argmax(np.abs(offsets[:, 0]) + np.abs(offsets[:, 1])))
        axis = int(abs(offsets[farthest, 0]) >= abs(offsets[farthest, 1]))
        pins.append((tuple(map(float, points[farthest])), axis))
    return tuple(pins)


def refine_domain(domain: ImportedDomain, sizes: Sizes) -> Grid:
    """Return the mesh of a domain after the number of uniform refinements in `sizes`."""
    mesh = domain.mesh.full_mesh
    for _ in range(sizes.refinements or 0):
        mesh = refined_once(mesh)
    return mesh.grid
