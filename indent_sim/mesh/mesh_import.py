"""Import of a mesh file as a body, with checks of its cells, regions and midside nodes."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from indent_sim.mesh.grid import Grid, is_flat, iterate_facets, row_slices, sort_and_match_rows
from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.imported_surfaces import LEVEL_TOLERANCE, find_surfaces
from indent_sim.mesh.mesh_file import (
    CELL_KINDS,
    MeshFile,
    MeshFileVersion,
    find_mesh_file,
    format_midpoint,
    mesh_file_error,
    named_simplices,
    read_mesh_file,
)
from indent_sim.mesh.simplices import edge_keys, oriented, unique_edges
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.materials import Material

Regions = tuple[str | None, ...]  # Names of regions; None stands for cells of no named region.
REMESH_ADVICE = "mesh the body again"


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
    """Return the mesh of a version of a file, cached for all scenes that use it."""
    return read_mesh_file(version, partial(build_imported_mesh, body=body, regions=regions))


def build_imported_mesh(file: MeshFile, body: MeshFromFile, regions: Regions) -> ImportedMesh:
    """Return the imported mesh with the cells, surfaces and named regions of a file.

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
    surfaces = find_surfaces(file, body, points, cells, used_points)
    grid = Grid(points, oriented(points, cells), region_numbers, surfaces)
    midside_nodes = _midside_nodes(file, used_points, cells)
    return ImportedMesh(
        grid,
        region_names,
        midside_nodes,
        _hash_arrays(points, grid.cells, region_numbers, *surfaces.values(), *midside_nodes),
    )


def _check_cell_dimension(file: MeshFile, dim: int) -> None:
    """Raise ConfigError if the file has no cells of a dimension, or cells of a higher dimension."""
    if dim in file.cells and not (dim == 2 and 3 in file.cells):
        return
    cell_kinds = " and ".join(CELL_KINDS[cell_dim] for cell_dim in sorted(file.cells)) or "no cells"
    problem = (
        f"the file has {cell_kinds}, but a body in {dim} dimensions is made of {CELL_KINDS[dim]}"
    )
    if max(file.cells, default=0) > 1:
        # The file has a body, but of another dimension than the scene file says.
        remedy = "use 3d for tetrahedra, axisymmetric or plane_strain for triangles"
        raise mesh_file_error(problem, remedy, "body.kinematics")
    raise mesh_file_error(problem, "mesh the interior of the body", "body.file")


def _hash_arrays(*arrays: np.ndarray) -> str:
    """Return a hash of the shapes and contents of arrays."""
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
            remedy = "move the section to r >= 0: the axis of revolution is x = 0 of the file"
            raise mesh_file_error(f"points of the section have r = {least_radius:g}", remedy, key)
        section[np.abs(section[:, 0]) <= LEVEL_TOLERANCE * size, 0] = 0.0
    return section


def _refuse_tangled_cells(points: np.ndarray, cells: np.ndarray) -> None:
    """Raise MeshFileError if cells are flat, overlap adjacent cells, or are not connected."""
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
            f"{len(folded_facets)} cells are inverted and overlap an adjacent cell, the first at "
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
    """Return the facets whose two cells lie on the same side of the facet.

    `opposite` (k,) is the corner of the cell opposite to the facet; an interior facet occurs twice.

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
    """Return, for each point, the lowest number of all points connected to it (count,)."""
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

    Cells of no named region are assigned to a last region with the name "".

    Raises
    ------
    ConfigError
        If a name is missing, cells belong to two regions, or cells have no material.
    """
    region_names = tuple(name for name in names if name is not None)
    region_numbers = np.full(count, -1, dtype=np.int32)
    for number, name in enumerate(region_names):
        key = f"body.regions.{name}"
        cells = named_simplices(file, name, dim, key)
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


def _midside_nodes(
    file: MeshFile, used_points: np.ndarray, cells: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (k, 2) and positions (k, dim) [length] of the cells' midside nodes.

    Both are empty unless every edge of the cells has a midside node. `used_points` are the numbers
    of the body's points in the file.
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
