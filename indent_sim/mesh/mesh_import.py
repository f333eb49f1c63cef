"""Checks of a mesh file on its way to the body that it stands for: names, cells and surfaces found,
or refused.
"""

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

# of the body, or of a unit normal: what a level face or an upright wall may depart from that
LEVEL_TOLERANCE = 1e-9
Regions = tuple[str | None, ...]  # by name; None: of the cells without one
CELL_KINDS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
REMESH_ADVICE = "mesh the body anew"
SURFACE_KEYS = {"top": "contact", "base": "base", "sides": "sides"}
ORIENTATION_RULES = {
    "top": "the tip comes from above: z is up, and the surface hangs over nowhere",
    "base": "z is up: a base faces down or sideways",
}
ORIENTATIONS = {"top": "faces up", "base": "faces down and is level", "sides": "is upright"}


def import_mesh(folder: str, body: MeshFromFile, material: Material | None) -> ImportedMesh:
    """The body that the cells, surfaces and regions of a file below a folder make; `material`: of
    cells of no region.

    ConfigError where they make none.
    """
    regions = (*(body.regions or ()), *([None] if material else []))
    return _import_cached(find_mesh_file(folder, body.file), replace(body, regions=None), regions)


@lru_cache(maxsize=1)
def _import_cached(version: MeshFileVersion, body: MeshFromFile, regions: Regions) -> ImportedMesh:
    """The piece of this version of a file, read once however often the scene is resolved."""
    return read_mesh_file(version, partial(build_imported_mesh, body=body, regions=regions))


def import_boundary_cells(
    folder: str, body: MeshFromFile, material: Material | None
) -> BoundaryCells:
    """The skin of the body of a file, which holds the whole."""
    return boundary_cells_of(import_mesh(folder, body, material))


def build_imported_mesh(file: MeshFile, body: MeshFromFile, regions: Regions) -> ImportedMesh:
    """The body that a file's cells, surfaces and named regions make, None being that of all other
    cells; ConfigError where they make none.
    """
    dim = 3 if body.kinematics == "3d" else 2
    if dim not in file.cells or (dim == 2 and 3 in file.cells):
        found_kinds = (
            " and ".join(CELL_KINDS[found_dim] for found_dim in sorted(file.cells)) or "no cells"
        )
        is_body = max(file.cells, default=0) > 1  # of another kind than the scene says
        remedy = (
            "3d for tetrahedra, axisymmetric or plane_strain for triangles"
            if is_body
            else "mesh its inside"
        )
        problem = f"the file has {found_kinds}, and a body in {dim} dimensions is made of {CELL_KINDS[dim]}"
        raise mesh_file_error(problem, remedy, "body.kinematics" if is_body else "body.file")
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


def _hash_arrays(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _body_coordinates(points: np.ndarray, dim: int, body: MeshFromFile) -> np.ndarray:
    """The coordinates of the body's own dimensions; points of the axis exactly on it."""
    size = float(np.ptp(points, axis=0).max())
    key = "body.kinematics"
    if dim == 3:
        return points
    if np.ptp(points[:, 2]) > LEVEL_TOLERANCE * size:
        problem = "the triangles do not lie in one plane z = const of the file"
        raise mesh_file_error(problem, "a section has (r, z) or (x, z) in the file's (x, y)", key)
    section = np.ascontiguousarray(points[:, :2])
    if body.kinematics == "axisymmetric":
        if (least_radius := section[:, 0].min()) < -LEVEL_TOLERANCE * size:
            remedy = "the axis is r = 0, the file's x = 0, and the body beyond it"
            raise mesh_file_error(f"points of the section have r = {least_radius:g}", remedy, key)
        section[np.abs(section[:, 0]) <= LEVEL_TOLERANCE * size, 0] = 0.0
    return section


def _refuse_tangled_cells(points: np.ndarray, cells: np.ndarray) -> None:
    """ConfigError for cells without volume, that overlap their neighbours, or that hang together in
    no one piece.
    """
    if len(
        flat_cells := cells[
            np.concatenate([is_flat(points, cells[chunk]) for chunk in row_slices(len(cells))])
        ]
    ):
        raise mesh_file_error(
            f"{len(flat_cells)} cells have no volume, the first at {format_midpoint(points[flat_cells[0]])}",
            REMESH_ADVICE,
        )
    folded_facets = np.concatenate(
        [
            _folded_facets(points, cells[cell, corner], facets)
            for facets, cell, corner in iterate_facets(cells)
        ]
    )
    if len(folded_facets):
        location = format_midpoint(points[folded_facets[0]])
        raise mesh_file_error(
            f"{len(folded_facets)} cells are inverted: they overlap a neighbour, the first at {location}",
            REMESH_ADVICE,
        )
    if (component_count := len(np.unique(_connected_points(cells, len(points))))) > 1:
        raise mesh_file_error(
            f"the mesh is in {component_count} pieces that share no points",
            "merge double points (gmsh: Coherence)",
        )


def _folded_facets(points: np.ndarray, opposite: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Those facets whose two cells, by the corner `opposite` of each, are on the same side;
    ConfigError for a third.
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
        points[np.column_stack([facets[first_facet], opposite[number]])]
        for number in (first_facet, second_facet)
    ]
    sides = [
        np.linalg.det(cell_corners[:, 1:] - cell_corners[:, :1]) for cell_corners in both_corners
    ]  # of the facet, by sign
    return np.asarray(facets[first_facet][sides[0] * sides[1] >= 0])


def _connected_points(cells: np.ndarray, count: int) -> np.ndarray:
    """For every point the first point that it hangs together with (count,)."""
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
    """The names of the regions and the number of each cell's; "" is what has no region of its own."""
    region_names = tuple(name for name in names if name is not None)
    region_numbers = np.full(count, -1, dtype=np.int32)
    for number, name in enumerate(region_names):
        key = f"body.regions.{name}"
        cells = _named_simplices(file, name, dim, key)
        if (is_assigned := region_numbers[cells] >= 0).any():
            first_region = region_names[region_numbers[cells][is_assigned][0]]
            raise mesh_file_error(
                f"{is_assigned.sum()} cells are of this region and of {first_region}",
                "give each cell one region",
                key,
            )
        region_numbers[cells] = number
    is_unassigned = region_numbers < 0
    if is_unassigned.any() and None not in names:
        problem = f"{is_unassigned.sum()} cells are of no region, and the scene has no material"
        raise mesh_file_error(problem, file.names_text, "body.regions")
    region_numbers[is_unassigned] = len(region_names)
    return (*region_names, "") if is_unassigned.any() else region_names, region_numbers


def _named_simplices(file: MeshFile, name: str, dim: int, key: str) -> np.ndarray:
    """The simplices of a dimension that have a name."""
    if name not in file.groups:
        raise mesh_file_error(f"the file has no group '{name}'", file.names_text, key)
    if dim not in file.groups[name]:
        kinds = " and ".join(CELL_KINDS[found_dim] for found_dim in sorted(file.groups[name]))
        raise mesh_file_error(
            f"'{name}' is a group of {kinds}, and {CELL_KINDS[dim]} are needed here",
            file.names_text,
            key,
        )
    return file.groups[name][dim]


def _find_surfaces(
    file: MeshFile, body: MeshFromFile, points: np.ndarray, cells: np.ndarray, used: np.ndarray
) -> dict[str, np.ndarray]:
    """The facets (k, dim) of top, base and sides, by name or else by where they face, and of the
    axis as r_min.
    """
    outer_facets, opposite = boundary_facets(cells)
    normal_vectors = unit_normals(points[outer_facets])
    inward_vectors = points[opposite] - points[outer_facets[:, 0]]
    vertical_component = np.where(
        (normal_vectors * inward_vectors).sum(axis=1) > 0,
        -normal_vectors[:, -1],
        normal_vectors[:, -1],
    )  # of the outer normals
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
            _facets_by_name(file, name, surface, outer_facets, used)
            if is_named
            else _facets_by_orientation(surface, free_component, points[outer_facets])
        )
        if (is_taken & ~is_on_axis)[rows].any():
            raise mesh_file_error(
                f"'{name}' shares facets with another surface", "give each facet one", key
            )
        is_taken[rows] = True
        surface_facets[surface] = outer_facets[rows]
        _check_orientation(surface, name, vertical_component[rows], points[outer_facets[rows]])
    _refuse_overhang(
        body.surfaces.contact or f"what {ORIENTATIONS['top']}", points[surface_facets["top"]]
    )
    axis_facets = {"r_min": outer_facets[is_on_axis]} if body.kinematics == "axisymmetric" else {}
    return {
        surface: surface_facets[surface] for surface in SURFACE_KEYS if surface in surface_facets
    } | axis_facets


def _facets_by_orientation(
    surface: str, vertical_component: np.ndarray, corners: np.ndarray
) -> np.ndarray:
    """Which of the outer facets are a surface by their normals' vertical component `vertical_component`, NaN of
    those of another.
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
        problem = f"is not given, and no one part of the outside {ORIENTATIONS[surface]}"
        raise MeshFileError(f"body.surfaces.{key}", problem, _naming_advice(key, corners.shape[1]))
    return rows


def _naming_advice(name: str, dim: int) -> str:
    facets, cells = {2: ("Curve", "Surface"), 3: ("Surface", "Volume")}[dim]
    return (
        f'in gmsh: Physical {facets}("{name}") = {{...}}; and Physical {cells}("body") = '
        f"{{...}}; then save the mesh"
    )


def _facets_by_name(
    file: MeshFile, name: str, surface: str, outer_facets: np.ndarray, used_points: np.ndarray
) -> np.ndarray:
    """Which of the outer facets have a name: as a group of facets, or with all their corners in a
    set of points.
    """
    dim = outer_facets.shape[1]
    key = f"body.surfaces.{SURFACE_KEYS[surface]}"
    if not file.point_sets and not any(dim - 1 in group for group in file.groups.values()):
        remedy = f"leave the key out where that {ORIENTATIONS[surface]}, or name it {_naming_advice(name, dim)}"
        raise MeshFileError(
            key, f"the file names no {CELL_KINDS[dim - 1]}, so it has no '{name}'", remedy
        )
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
        location = (
            "not on the outside of the body, the first at "
            f"{format_midpoint(file.points[facets[is_inside][0]])}"
        )
        raise mesh_file_error(
            f"{is_inside.sum()} facets of '{name}' are {location}", "name outer facets alone", key
        )
    return np.flatnonzero(np.isin(outer_keys, named_keys))


def _check_orientation(
    surface: str, name: str | None, vertical_component: np.ndarray, corners: np.ndarray
) -> None:
    """The tip comes from above: contact faces up, the base does not."""
    is_wrong = {
        "top": vertical_component <= LEVEL_TOLERANCE,
        "base": vertical_component > LEVEL_TOLERANCE,
    }.get(surface, np.zeros(len(vertical_component), dtype=bool))
    if is_wrong.any():
        faces = (
            "up"
            if surface == "base"
            else "down"
            if (vertical_component[is_wrong] < -LEVEL_TOLERANCE).any()
            else "sideways"
        )
        problem = (
            f"{is_wrong.sum()} facets of '{name}' face {faces}, the first at "
            f"{format_midpoint(corners[is_wrong][0])}"
        )
        raise mesh_file_error(
            problem, ORIENTATION_RULES[surface], f"body.surfaces.{SURFACE_KEYS[surface]}"
        )


def _refuse_overhang(name: str, corners: np.ndarray) -> None:
    """ConfigError where one part of the contact surface lies above another."""
    plan_corners = corners[..., :-1]
    centroids = plan_corners.mean(axis=1)
    lower_bounds = plan_corners.min(axis=1)
    upper_bounds = plan_corners.max(axis=1)
    order = np.argsort(centroids[:, 0])
    first_candidate, last_candidate = (
        np.searchsorted(centroids[order, 0], edge[:, 0]) for edge in (lower_bounds, upper_bounds)
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
        if (
            (barycentric_coordinates > LEVEL_TOLERANCE).all(axis=0)
            & (barycentric_coordinates.sum(axis=0) < 1 - LEVEL_TOLERANCE)
        ).any():
            remedy = "name the upper one alone: the contact surface has one height at each place"
            problem = (
                f"parts of '{name}' lie above one another at {format_midpoint(corners[facet])}"
            )
            raise mesh_file_error(problem, remedy, "body.surfaces.contact")


def _midside_nodes(
    file: MeshFile, used_points: np.ndarray, cells: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The midside nodes of the cells, edges (k, 2) and places (k, dim), where every edge of theirs
    has one.
    """
    dim = cells.shape[1] - 1
    (edges, nodes) = file.midside_nodes
    is_inside = np.isin(edges, used_points).all(axis=1)
    midside_edges, first = np.unique(
        np.sort(np.searchsorted(used_points, edges[is_inside]), axis=1), axis=0, return_index=True
    )
    is_complete = (
        len(midside_edges)
        and np.isin(edge_keys(unique_edges(cells)), edge_keys(midside_edges)).all()
    )
    positions = file.points[nodes[is_inside][first]][:, :dim]
    return (
        (midside_edges, positions)
        if is_complete
        else (np.empty((0, 2), dtype=np.int64), np.empty((0, dim)))
    )
