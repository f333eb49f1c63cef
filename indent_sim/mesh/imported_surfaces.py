"""Surfaces of an imported mesh: boundary facets selected by name or by orientation."""

from __future__ import annotations

import numpy as np

from indent_sim.mesh.grid import boundary_facets, unit_normals
from indent_sim.mesh.mesh_file import (
    CELL_KINDS,
    MeshFile,
    format_midpoint,
    mesh_file_error,
    named_simplices,
)
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.process.errors import MeshFileError

# Deviation from a plane, relative to the size of the body, and vertical component of a unit normal
# up to which faces count as level or vertical.
LEVEL_TOLERANCE = 1e-9
SURFACE_KEYS = {"top": "contact", "base": "base", "sides": "sides"}
ORIENTATIONS = {"top": "faces up", "base": "faces down and is horizontal", "sides": "is vertical"}


def find_surfaces(
    file: MeshFile,
    body: MeshFromFile,
    points: np.ndarray,
    cells: np.ndarray,
    used_points: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the facets (k, dim) of the surfaces top, base and sides, and of the axis as r_min.

    A surface that is named in the scene file is found by its name; any other surface is found by
    the orientation of the remaining facets.

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
        If a name is missing, or facets are unsuitable for their surface.
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

    `opposite` (k,) is the corner of each facet's cell opposite to the facet.
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
    """Return the indices of the outer facets that have the orientation of a surface.

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
        If there are no such facets, or facets of the base are at different heights.
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
        remedy = f"name it {_naming_advice(key, corners.shape[1])}"
        raise MeshFileError(f"body.surfaces.{key}", problem, remedy)
    return rows


def _naming_advice(name: str, dim: int) -> str:
    """Return the text of a message that explains how to name a surface in gmsh."""
    facets, cells = {2: ("Curve", "Surface"), 3: ("Surface", "Volume")}[dim]
    return (
        f'in gmsh: Physical {facets}("{name}") = {{...}}; and Physical {cells}("body") = '
        f"{{...}}; then save the mesh"
    )


def _facets_by_name(
    file: MeshFile, name: str, surface: str, outer_facets: np.ndarray, used_points: np.ndarray
) -> np.ndarray:
    """Return the indices of the outer facets of a surface that has a name in the file.

    The name is the name of a group of facets, or of a set of points that contains all corners of
    the facets. `used_points` are the numbers of the body's points in the file.

    Raises
    ------
    ConfigError
        If there are no such facets, or some are inside the body.
    """
    dim = outer_facets.shape[1]
    key = f"body.surfaces.{SURFACE_KEYS[surface]}"
    if not file.point_sets and not any(dim - 1 in group for group in file.groups.values()):
        problem = f"the file has no named {CELL_KINDS[dim - 1]} and thus no '{name}'"
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
    facets = np.sort(file.cells[dim - 1][named_simplices(file, name, dim - 1, key)], axis=1)
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
    """Raise ConfigError if contact facets do not face up, or if facets of the base face up."""
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
        rules = {
            "top": (
                "z points up and the tip comes from above: the contact surface must face up "
                "everywhere"
            ),
            "base": "z points up: a base must face down or sideways",
        }
        raise mesh_file_error(problem, rules[surface], f"body.surfaces.{SURFACE_KEYS[surface]}")


def _refuse_overhang(name: str | None, corners: np.ndarray) -> None:
    """Raise ConfigError if a part of the contact surface lies above another part."""
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
