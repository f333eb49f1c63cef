"""Import of a mesh file as a body: its cells, surfaces and regions are identified and checked."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from indent_sim.mesh.grid import (
    Grid,
    boundary_facets,
    is_flat,
    iterate_facets,
    row_slices,
    sort_and_match_rows,
    unit_normals,
)
from indent_sim.mesh.imported_mesh import (
    BoundaryCells,
    ImportedMesh,
    boundary_cells_of,
    edge_keys,
    oriented,
    unique_edges,
)
from indent_sim.mesh.mesh_file import (
    MeshFile,
    MeshFileVersion,
    find_mesh_file,
    format_midpoint,
    mesh_file_error,
    read_mesh_file,
)
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.materials import Material
from indent_sim.process.errors import MeshFileError

# Deviation from a plane, relative to the size of the body, and vertical component of a unit normal
# up to which faces count as level or vertical.
LEVEL_TOLERANCE = 1e-9
Regions = tuple[str | None, ...]  # Names of regions; None stands for cells of no named region.
CELL_KINDS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
REMESH_ADVICE = "mesh the body again"
SURFACE_KEYS = {"top": "contact", "base": "base", "sides": "sides"}
ORIENTATION_RULES = {
    "top": "z points up and the tip comes from above: the contact surface must face up everywhere",
    "base": "z points up: a base must face down or sideways",
}
ORIENTATIONS = {"top": "faces up", "base": "faces down and is level", "sides": "is vertical"}


def import_mesh(folder: str, body: MeshFromFile, material: Material | None) -> ImportedMesh:
    """Import the mesh of a body.

    Parameters
    ----------
    folder : str
        Folder of the scene file, to which the path of the mesh file is relative.
    body : MeshFromFile
        The body in the scene file.
    material : Material or None
        Material of cells that belong to no region.

    Returns
    -------
    ImportedMesh
        The mesh in the units and the position of the file.

    Raises
    ------
    ConfigError
        If the file cannot be read, or does not match the body in the scene file.
    """
    regions = (*(body.regions or ()), *([None] if material else []))
    return _import_cached(find_mesh_file(folder, body.file), replace(body, regions=None), regions)


@lru_cache(maxsize=1)
def _import_cached(version: MeshFileVersion, body: MeshFromFile, regions: Regions) -> ImportedMesh:
    """Return the mesh of a version of a file, which is read once for all scenes that use it."""
    return read_mesh_file(version, partial(build_imported_mesh, body=body, regions=regions))


def import_boundary_cells(
    folder: str, body: MeshFromFile, material: Material | None
) -> BoundaryCells:
    """Import the boundary cells of a body, with a reference to its full mesh; see `import_mesh`."""
    return boundary_cells_of(import_mesh(folder, body, material))


def build_imported_mesh(file: MeshFile, body: MeshFromFile, regions: Regions) -> ImportedMesh:
    """Return the mesh that the cells, surfaces and named regions of a file make up.

    Parameters
    ----------
    file : MeshFile
        Contents of the file.
    body : MeshFromFile
        The body in the scene file.
    regions : tuple of str or None
        Names of the regions; None if cells of no named region are allowed.

    Returns
    -------
    ImportedMesh
        The mesh without points that belong to no cell.

    Raises
    ------
    ConfigError
        If a name, a surface or the dimension of the cells does not match the scene file.
    MeshFileError
        If cells are flat, inverted or not connected.
    """
    dim = 3 if body.kinematics == "3d" else 2
    _check_cell_dimension(file, dim)
    is_used = np.zeros(len(file.points), dtype=bool)
    is_used[file.cells[dim]] = True
    used_points = np.flatnonzero(is_used)
    cells = (np.cumsum(is_used) - 1)[file.cells[dim]]
    points = _body_coordinates(file.points[used_points], dim, body)
    _refuse_tangled_cells(points, cells)
    region_names, region_numbers = _number_regions(file, regions, dim, len(cells))
    surfaces = _find_surfaces(file, body, points, cells, used_points)
    grid = Grid(points, oriented(points, cells), region_numbers, surfaces)
    midside_nodes = _midside_nodes(file, used_points, cells)
    return ImportedMesh(
        grid,
        region_names,
        midside_nodes,
        _hash_arrays(points, grid.cells, region_numbers, *surfaces.values(), *midside_nodes),
    )


def _check_cell_dimension(file: MeshFile, dim: int) -> None:
    """Raise ConfigError if the file has no cells of a dimension, or cells of a higher one."""
    if dim in file.cells and not (dim == 2 and 3 in file.cells):
        return
    cell_kinds = " and ".join(CELL_KINDS[cell_dim] for cell_dim in sorted(file.cells)) or "no cells"
    problem = (
        f"the file has {cell_kinds}, and a body in {dim} dimensions is made of {CELL_KINDS[dim]}"
    )
    if max(file.cells, default=0) > 1:
        # The file has a body, but of another dimension than the scene file says.
        remedy = "use 3d for tetrahedra, axisymmetric or plane_strain for triangles"
        raise mesh_file_error(problem, remedy, "body.kinematics")
    raise mesh_file_error(problem, "mesh the interior of the body", "body.file")


def _hash_arrays(*arrays: np.ndarray) -> str:
    """Return a fingerprint of the shapes and contents of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _body_coordinates(points: np.ndarray, dim: int, body: MeshFromFile) -> np.ndarray:
    """Return the coordinates (n, dim) of points in the dimensions of the body.

    Points within rounding of the axis of revolution are moved onto it.

    Raises
    ------
    ConfigError
        If the points of a section are not in one plane, or have negative radii.
    """
    size = float(np.ptp(points, axis=0).max())
    key = "body.kinematics"
    if dim == 3:
        return points
    if np.ptp(points[:, 2]) > LEVEL_TOLERANCE * size:
        problem = "the triangles do not lie in one plane z = const of the file"
        remedy = "write (r, z) or (x, z) of a section as (x, y) of the file"
        raise mesh_file_error(problem, remedy, key)
    section = np.ascontiguousarray(points[:, :2])
    if body.kinematics == "axisymmetric":
        if (least_radius := section[:, 0].min()) < -LEVEL_TOLERANCE * size:
            remedy = "the axis is r = 0, which is x = 0 of the file; the body lies at r >= 0"
            raise mesh_file_error(f"points of the section have r = {least_radius:g}", remedy, key)
        section[np.abs(section[:, 0]) <= LEVEL_TOLERANCE * size, 0] = 0.0
    return section


def _refuse_tangled_cells(points: np.ndarray, cells: np.ndarray) -> None:
    """Raise MeshFileError if cells are flat, overlap their neighbours, or are not connected."""
    chunks = row_slices(len(cells))
    is_flat_cell = np.concatenate([is_flat(points, cells[chunk]) for chunk in chunks])
    flat_cells = cells[is_flat_cell]
    if len(flat_cells):
        location = format_midpoint(points[flat_cells[0]])
        raise mesh_file_error(
            f"{len(flat_cells)} cells have no volume, the first at {location}", REMESH_ADVICE
        )
    folded_facets = np.concatenate(
        [
            _folded_facets(points, cells[cell, corner], facets)
            for facets, cell, corner in iterate_facets(cells)
        ]
    )
    if len(folded_facets):
        location = format_midpoint(points[folded_facets[0]])
        problem = (
            f"{len(folded_facets)} cells are inverted: they overlap a neighbour, the first at "
            f"{location}"
        )
        raise mesh_file_error(problem, REMESH_ADVICE)
    component_count = len(np.unique(_connected_points(cells, len(points))))
    if component_count > 1:
        raise mesh_file_error(
            f"the mesh is in {component_count} pieces that share no points",
            "merge double points (gmsh: Coherence)",
        )


def _folded_facets(points: np.ndarray, opposite: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return the facets whose two cells lie on the same side of them.

    `opposite` (k,) is the corner of a facet's cell that is not on the facet; a facet inside the
    mesh occurs twice.

    Raises
    ------
    MeshFileError
        If three cells share a facet.
    """
    order, is_shared = sort_and_match_rows(np.sort(facets, axis=1))
    if (is_shared[1:] & is_shared[:-1]).any():
        shared = facets[order[1:-1][is_shared[1:] & is_shared[:-1]][0]]
        raise mesh_file_error(
            f"three cells share the facet at {format_midpoint(points[shared])}", REMESH_ADVICE
        )
    first_facet = order[:-1][is_shared]
    second_facet = order[1:][is_shared]
    both_corners = [
        points[np.column_stack([facets[first_facet], opposite[facet]])]
        for facet in (first_facet, second_facet)
    ]
    # The sign of a determinant tells on which side of the facet its cell lies.
    determinants = [
        np.linalg.det(cell_corners[:, 1:] - cell_corners[:, :1]) for cell_corners in both_corners
    ]
    return np.asarray(facets[first_facet][determinants[0] * determinants[1] >= 0])


def _connected_points(cells: np.ndarray, count: int) -> np.ndarray:
    """Return for every point the lowest number of a point that it is connected to (count,)."""
    label = np.arange(count)
    while True:
        smallest_label = label[cells].min(axis=1)
        new_label = label.copy()
        for k in range(cells.shape[1]):
            np.minimum.at(new_label, cells[:, k], smallest_label)
        new_label = new_label[new_label]
        if np.array_equal(new_label, label):
            return label
        label = new_label


def _number_regions(
    file: MeshFile, names: Regions, dim: int, count: int
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the regions, and the number of each cell's region (count,).

    Cells of no named region belong to a last one with the name "".

    Raises
    ------
    ConfigError
        If a name is missing, cells belong to two regions, or cells have no material.
    """
    region_names = tuple(name for name in names if name is not None)
    region_numbers = np.full(count, -1, dtype=np.int32)
    for number, name in enumerate(region_names):
        key = f"body.regions.{name}"
        cells = _named_simplices(file, name, dim, key)
        if (is_assigned := region_numbers[cells] >= 0).any():
            first_region = region_names[region_numbers[cells][is_assigned][0]]
            problem = f"{is_assigned.sum()} cells belong to this region and to {first_region}"
            raise mesh_file_error(problem, "assign each cell to one region", key)
        region_numbers[cells] = number
    is_unassigned = region_numbers < 0
    if not is_unassigned.any():
        return region_names, region_numbers
    if None not in names:
        problem = f"{is_unassigned.sum()} cells belong to no region, and the scene has no material"
        raise mesh_file_error(problem, file.names_text, "body.regions")
    region_numbers[is_unassigned] = len(region_names)
    return (*region_names, ""), region_numbers


def _named_simplices(file: MeshFile, name: str, dim: int, key: str) -> np.ndarray:
    """Return the indices of the simplices of a dimension in a named group; ConfigError if none."""
    if name not in file.groups:
        raise mesh_file_error(f"the file has no group '{name}'", file.names_text, key)
    if dim not in file.groups[name]:
        kinds = " and ".join(CELL_KINDS[group_dim] for group_dim in sorted(file.groups[name]))
        raise mesh_file_error(
            f"'{name}' is a group of {kinds}, and {CELL_KINDS[dim]} are needed here",
            file.names_text,
            key,
        )
    return file.groups[name][dim]


def _find_surfaces(
    file: MeshFile,
    body: MeshFromFile,
    points: np.ndarray,
    cells: np.ndarray,
    used_points: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the facets (k, dim) of the surfaces top, base and sides, and of the axis as r_min.

    Surfaces with a name in the scene file are found by it, all others by the orientation of the
    remaining facets.

    Parameters
    ----------
    file : MeshFile
        Contents of the file.
    body : MeshFromFile
        The body in the scene file.
    points, cells : numpy.ndarray
        Coordinates (n, dim) [length] and cells (m, dim + 1) of the body.
    used_points : numpy.ndarray
        Numbers (n,) of the points in the file.

    Returns
    -------
    dict
        Facets by the name of the surface.

    Raises
    ------
    ConfigError
        If a name is missing, or facets are not what the surface needs.
    """
    outer_facets, opposite = boundary_facets(cells)
    vertical_component = _vertical_components(points, outer_facets, opposite)
    is_on_axis = (points[outer_facets][:, :, 0] == 0).all(axis=1) & (
        body.kinematics == "axisymmetric"
    )
    surface_facets = {}
    is_taken = is_on_axis.copy()
    given_names = {surface: getattr(body.surfaces, key) for surface, key in SURFACE_KEYS.items()}
    for surface in sorted(given_names, key=lambda surface: given_names[surface] is None):
        name = given_names[surface]
        key = f"body.surfaces.{SURFACE_KEYS[surface]}"
        if name is None and surface == "sides" and body.sides in ("free", "auto"):
            continue
        is_named = name is not None
        free_component = np.where(is_taken, np.nan, vertical_component)
        rows = (
            _facets_by_name(file, name, surface, outer_facets, used_points)
            if is_named
            else _facets_by_orientation(surface, free_component, points[outer_facets])
        )
        if (is_taken & ~is_on_axis)[rows].any():
            raise mesh_file_error(
                f"'{name}' shares facets with another surface",
                "assign each facet to one surface",
                key,
            )
        is_taken[rows] = True
        surface_facets[surface] = outer_facets[rows]
        _check_orientation(surface, name, vertical_component[rows], points[outer_facets[rows]])
    _refuse_overhang(body.surfaces.contact, points[surface_facets["top"]])
    axis_facets = {"r_min": outer_facets[is_on_axis]} if body.kinematics == "axisymmetric" else {}
    return {
        surface: surface_facets[surface] for surface in SURFACE_KEYS if surface in surface_facets
    } | axis_facets


def _vertical_components(
    points: np.ndarray, outer_facets: np.ndarray, opposite: np.ndarray
) -> np.ndarray:
    """Return the vertical component of the outer unit normals of facets (k,).

    `opposite` (k,) is the corner of each facet's cell that is not on the facet.
    """
    normal_vectors = unit_normals(points[outer_facets])
    inward_vectors = points[opposite] - points[outer_facets[:, 0]]
    return np.where(
        (normal_vectors * inward_vectors).sum(axis=1) > 0,
        -normal_vectors[:, -1],
        normal_vectors[:, -1],
    )


def _facets_by_orientation(
    surface: str, vertical_component: np.ndarray, corners: np.ndarray
) -> np.ndarray:
    """Return the rows of the outer facets that belong to a surface by their orientation.

    Parameters
    ----------
    surface : str
        top | base | sides.
    vertical_component : numpy.ndarray
        Vertical component of the outer unit normals (k,); NaN for facets of another surface.
    corners : numpy.ndarray
        Corners of the facets (k, dim, dim) [length].

    Returns
    -------
    numpy.ndarray
        Indices of the facets.

    Raises
    ------
    MeshFileError
        If there are none, or those of the base are not at one height.
    """
    rows = np.flatnonzero(
        {
            "top": vertical_component > LEVEL_TOLERANCE,
            "base": vertical_component < -LEVEL_TOLERANCE,
            "sides": np.abs(vertical_component) <= LEVEL_TOLERANCE,
        }[surface]
    )
    heights = corners[rows][..., -1] if surface == "base" else np.zeros(1)
    if len(rows) == 0 or np.ptp(heights) > LEVEL_TOLERANCE * np.ptp(corners, axis=(0, 1)).max():
        key = SURFACE_KEYS[surface]
        problem = f"is not given, and no single part of the boundary {ORIENTATIONS[surface]}"
        raise MeshFileError(f"body.surfaces.{key}", problem, _naming_advice(key, corners.shape[1]))
    return rows


def _naming_advice(name: str, dim: int) -> str:
    """Return how a surface is named in gmsh, for messages."""
    facets, cells = {2: ("Curve", "Surface"), 3: ("Surface", "Volume")}[dim]
    return (
        f'in gmsh: Physical {facets}("{name}") = {{...}}; and Physical {cells}("body") = '
        f"{{...}}; then save the mesh"
    )


def _facets_by_name(
    file: MeshFile, name: str, surface: str, outer_facets: np.ndarray, used_points: np.ndarray
) -> np.ndarray:
    """Return the rows of the outer facets of a surface with a name in the file.

    The name is that of a group of facets, or of a set of points that contains all corners of the
    facets. `used_points` are the numbers of the body's points in the file.

    Raises
    ------
    ConfigError
        If there are no such facets, or some are inside the body.
    """
    dim = outer_facets.shape[1]
    key = f"body.surfaces.{SURFACE_KEYS[surface]}"
    if not file.point_sets and not any(dim - 1 in group for group in file.groups.values()):
        problem = f"the file names no {CELL_KINDS[dim - 1]}, so it has no '{name}'"
        remedy = (
            f"leave the key out if this surface {ORIENTATIONS[surface]}, or name it "
            f"{_naming_advice(name, dim)}"
        )
        raise MeshFileError(key, problem, remedy)
    if name in file.point_sets and dim - 1 not in file.groups.get(name, {}):
        rows = np.flatnonzero(np.isin(used_points[outer_facets], file.point_sets[name]).all(axis=1))
        if len(rows) == 0:
            raise mesh_file_error(
                f"no outer facet has all its corners in the set '{name}'", file.names_text, key
            )
        return rows
    facets = np.sort(file.cells[dim - 1][_named_simplices(file, name, dim - 1, key)], axis=1)
    all_facets = np.concatenate([np.sort(used_points[outer_facets], axis=1), facets])
    outer_keys, named_keys = np.split(
        np.unique(all_facets, axis=0, return_inverse=True)[1].ravel(), [len(outer_facets)]
    )
    if (is_inside := ~np.isin(named_keys, outer_keys)).any():
        problem = (
            f"{is_inside.sum()} facets of '{name}' are not on the boundary of the body, the first "
            f"at {format_midpoint(file.points[facets[is_inside][0]])}"
        )
        raise mesh_file_error(problem, "name facets of the boundary only", key)
    return np.flatnonzero(np.isin(outer_keys, named_keys))


def _check_orientation(
    surface: str, name: str | None, vertical_component: np.ndarray, corners: np.ndarray
) -> None:
    """Raise ConfigError if contact facets do not face up, or facets of the base do."""
    is_wrong = {
        "top": vertical_component <= LEVEL_TOLERANCE,
        "base": vertical_component > LEVEL_TOLERANCE,
    }.get(surface, np.zeros(len(vertical_component), dtype=bool))
    if is_wrong.any():
        if surface == "base":
            direction = "up"
        elif (vertical_component[is_wrong] < -LEVEL_TOLERANCE).any():
            direction = "down"
        else:
            direction = "sideways"
        problem = (
            f"{is_wrong.sum()} facets of '{name}' face {direction}, the first at "
            f"{format_midpoint(corners[is_wrong][0])}"
        )
        raise mesh_file_error(
            problem, ORIENTATION_RULES[surface], f"body.surfaces.{SURFACE_KEYS[surface]}"
        )


def _refuse_overhang(name: str | None, corners: np.ndarray) -> None:
    """Raise ConfigError if a part of the contact surface lies above another one."""
    plan_corners = corners[..., :-1]
    centroids = plan_corners.mean(axis=1)
    lower_bounds = plan_corners.min(axis=1)
    upper_bounds = plan_corners.max(axis=1)
    order = np.argsort(centroids[:, 0])
    first_candidate, last_candidate = (
        np.searchsorted(centroids[order, 0], bounds[:, 0])
        for bounds in (lower_bounds, upper_bounds)
    )
    for facet in range(len(plan_corners)):
        neighbours = order[first_candidate[facet] : last_candidate[facet]]
        neighbours = neighbours[
            (
                (centroids[neighbours] >= lower_bounds[facet])
                & (centroids[neighbours] <= upper_bounds[facet])
            ).all(axis=1)
            & (neighbours != facet)
        ]
        if len(neighbours) == 0:
            continue
        first_corner = plan_corners[facet, 0]
        edges = (plan_corners[facet, 1:] - plan_corners[facet, 0]).T
        barycentric_coordinates = np.linalg.solve(edges, (centroids[neighbours] - first_corner).T)
        is_overlapping = (barycentric_coordinates > LEVEL_TOLERANCE).all(axis=0) & (
            barycentric_coordinates.sum(axis=0) < 1 - LEVEL_TOLERANCE
        )
        if is_overlapping.any():
            surface_text = f"'{name}'" if name else "the contact surface"
            location = format_midpoint(corners[facet])
            problem = f"parts of {surface_text} lie above one another at {location}"
            remedy = "name the upper part only: a contact surface has one height at each position"
            raise mesh_file_error(problem, remedy, "body.surfaces.contact")


def _midside_nodes(
    file: MeshFile, used_points: np.ndarray, cells: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (k, 2) and positions (k, dim) [length] of the cells' midside nodes.

    They are empty unless every edge of the cells has one. `used_points` are the numbers of the
    body's points in the file.
    """
    dim = cells.shape[1] - 1
    (edges, nodes) = file.midside_nodes
    is_inside = np.isin(edges, used_points).all(axis=1)
    midside_edges, first_rows = np.unique(
        np.sort(np.searchsorted(used_points, edges[is_inside]), axis=1), axis=0, return_index=True
    )
    is_complete = (
        len(midside_edges)
        and np.isin(edge_keys(unique_edges(cells)), edge_keys(midside_edges)).all()
    )
    if not is_complete:
        return np.empty((0, 2), dtype=np.int64), np.empty((0, dim))
    return midside_edges, file.points[nodes[is_inside][first_rows]][:, :dim]
