"""Checks of a mesh file on its way to the body that it stands for: names, cells and surfaces found,
or refused.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from indent_sim.mesh.body_from_file import Piece, Skin, edges_of, keys_of, righted, skin_of
from indent_sim.mesh.grid import Grid, boundary_of, facets_of, is_flat, lots, normals, same_rows
from indent_sim.mesh.mesh_file import Found, MeshFile, find, place_of, read, refused
from indent_sim.model.body import MeshFromFile
from indent_sim.model.materials import Material
from indent_sim.process.errors import MeshFileError

# of the body, or of a unit normal: what a level face or an upright wall may depart from that
LEVEL = 1e-9
Regions = tuple[str | None, ...]  # by name; None: of the cells without one
KIND = {1: "lines", 2: "triangles", 3: "tetrahedra"}
ANEW = "mesh the body anew"
SURFACE_KEYS = {"top": "contact", "base": "base", "sides": "sides"}
UPWARDS = {
    "top": "the tip comes from above: z is up, and the surface hangs over nowhere",
    "base": "z is up: a base faces down or sideways",
}
FACING = {"top": "faces up", "base": "faces down and is level", "sides": "is upright"}


def piece_in(folder: str, body: MeshFromFile, material: Material | None) -> Piece:
    """The body that the cells, surfaces and regions of a file below a folder make; `material`: of
    cells of no region.

    ConfigError where they make none.
    """
    regions = (*(body.regions or ()), *([None] if material else []))
    return _piece(find(folder, body.file), replace(body, regions=None), regions)


@lru_cache(maxsize=1)
def _piece(found: Found, body: MeshFromFile, regions: Regions) -> Piece:
    """The piece of this version of a file, read once however often the scene is resolved."""
    return read(found, partial(piece_of, body=body, regions=regions))


def skin_in(folder: str, body: MeshFromFile, material: Material | None) -> Skin:
    """The skin of the body of a file, which holds the whole."""
    return skin_of(piece_in(folder, body, material))


def piece_of(file: MeshFile, body: MeshFromFile, regions: Regions) -> Piece:
    """The body that a file's cells, surfaces and named regions make, None being that of all other
    cells; ConfigError where they make none.
    """
    dim = 3 if body.kinematics == "3d" else 2
    if dim not in file.cells or (dim == 2 and 3 in file.cells):
        has = " and ".join(KIND[found] for found in sorted(file.cells)) or "no cells"
        is_body = max(file.cells, default=0) > 1  # of another kind than the scene says
        remedy = (
            "3d for tetrahedra, axisymmetric or plane_strain for triangles"
            if is_body
            else "mesh its inside"
        )
        problem = f"the file has {has}, and a body in {dim} dimensions is made of {KIND[dim]}"
        raise refused(problem, remedy, "body.kinematics" if is_body else "body.file")
    is_used = np.zeros(len(file.points), dtype=bool)
    is_used[file.cells[dim]] = True
    used = np.flatnonzero(is_used)
    cells = (np.cumsum(is_used) - 1)[file.cells[dim]]
    points = _in_dimensions(file.points[used], dim, body)
    _refuse_tangled(points, cells)
    names, region = _regions(file, regions, dim, len(cells))
    surfaces = _surfaces(file, body, points, cells, used)
    grid = Grid(points, righted(points, cells), region, surfaces)
    middles = _middles(file, used, cells)
    return Piece(
        grid, names, middles, _hash(points, grid.cells, region, *surfaces.values(), *middles)
    )


def _hash(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _in_dimensions(points: np.ndarray, dim: int, body: MeshFromFile) -> np.ndarray:
    """The coordinates of the body's own dimensions; points of the axis exactly on it."""
    size = float(np.ptp(points, axis=0).max())
    key = "body.kinematics"
    if dim == 3:
        return points
    if np.ptp(points[:, 2]) > LEVEL * size:
        problem = "the triangles do not lie in one plane z = const of the file"
        raise refused(problem, "a section has (r, z) or (x, z) in the file's (x, y)", key)
    section = np.ascontiguousarray(points[:, :2])
    if body.kinematics == "axisymmetric":
        if (nearest := section[:, 0].min()) < -LEVEL * size:
            remedy = "the axis is r = 0, the file's x = 0, and the body beyond it"
            raise refused(f"points of the section have r = {nearest:g}", remedy, key)
        section[np.abs(section[:, 0]) <= LEVEL * size, 0] = 0.0
    return section


def _refuse_tangled(points: np.ndarray, cells: np.ndarray) -> None:
    """ConfigError for cells without volume, that overlap their neighbours, or that hang together in
    no one piece.
    """
    if len(
        flat := cells[np.concatenate([is_flat(points, cells[some]) for some in lots(len(cells))])]
    ):
        raise refused(
            f"{len(flat)} cells have no volume, the first at {place_of(points[flat[0]])}", ANEW
        )
    folded = np.concatenate(
        [_folded(points, cells[cell, corner], facets) for facets, cell, corner in facets_of(cells)]
    )
    if len(folded):
        where = place_of(points[folded[0]])
        raise refused(
            f"{len(folded)} cells are inverted: they overlap a neighbour, the first at {where}",
            ANEW,
        )
    if (pieces := len(np.unique(_connected(cells, len(points))))) > 1:
        raise refused(
            f"the mesh is in {pieces} pieces that share no points",
            "merge double points (gmsh: Coherence)",
        )


def _folded(points: np.ndarray, opposite: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Those facets whose two cells, by the corner `opposite` of each, are on the same side;
    ConfigError for a third.
    """
    order, same = same_rows(np.sort(facets, axis=1))
    if (same[1:] & same[:-1]).any():
        shared = facets[order[1:-1][same[1:] & same[:-1]][0]]
        raise refused(f"three cells share the facet at {place_of(points[shared])}", ANEW)
    first = order[:-1][same]
    second = order[1:][same]
    corners = [
        points[np.column_stack([facets[first], opposite[number]])] for number in (first, second)
    ]
    sides = [
        np.linalg.det(around[:, 1:] - around[:, :1]) for around in corners
    ]  # of the facet, by sign
    return np.asarray(facets[first][sides[0] * sides[1] >= 0])


def _connected(cells: np.ndarray, count: int) -> np.ndarray:
    """For every point the first point that it hangs together with (count,)."""
    label = np.arange(count)
    while True:
        least = label[cells].min(axis=1)
        found = label.copy()
        for k in range(cells.shape[1]):
            np.minimum.at(found, cells[:, k], least)
        found = found[found]
        if np.array_equal(found, label):
            return label
        label = found


def _regions(
    file: MeshFile, names: Regions, dim: int, count: int
) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of the regions and the number of each cell's; "" is what has no region of its own."""
    own = tuple(name for name in names if name is not None)
    found = np.full(count, -1, dtype=np.int32)
    for number, name in enumerate(own):
        key = f"body.regions.{name}"
        cells = _group(file, name, dim, key)
        if (twice := found[cells] >= 0).any():
            other = own[found[cells][twice][0]]
            raise refused(
                f"{twice.sum()} cells are of this region and of {other}",
                "give each cell one region",
                key,
            )
        found[cells] = number
    rest = found < 0
    if rest.any() and None not in names:
        problem = f"{rest.sum()} cells are of no region, and the scene has no material"
        raise refused(problem, file.names, "body.regions")
    found[rest] = len(own)
    return (*own, "") if rest.any() else own, found


def _group(file: MeshFile, name: str, dim: int, key: str) -> np.ndarray:
    """The simplices of a dimension that have a name."""
    if name not in file.groups:
        raise refused(f"the file has no group '{name}'", file.names, key)
    if dim not in file.groups[name]:
        kinds = " and ".join(KIND[found] for found in sorted(file.groups[name]))
        raise refused(
            f"'{name}' is a group of {kinds}, and {KIND[dim]} are needed here", file.names, key
        )
    return file.groups[name][dim]


def _surfaces(
    file: MeshFile, body: MeshFromFile, points: np.ndarray, cells: np.ndarray, used: np.ndarray
) -> dict[str, np.ndarray]:
    """The facets (k, dim) of top, base and sides, by name or else by where they face, and of the
    axis as r_min.
    """
    outside, opposite = boundary_of(cells)
    normal = normals(points[outside])
    inwards = points[opposite] - points[outside[:, 0]]
    up = np.where(
        (normal * inwards).sum(axis=1) > 0, -normal[:, -1], normal[:, -1]
    )  # of the outer normals
    on_axis = (points[outside][:, :, 0] == 0).all(axis=1) & (body.kinematics == "axisymmetric")
    found = {}
    taken = on_axis.copy()
    wanted = {surface: getattr(body.surfaces, key) for surface, key in SURFACE_KEYS.items()}
    for surface in sorted(wanted, key=lambda surface: wanted[surface] is None):
        name = wanted[surface]
        key = f"body.surfaces.{SURFACE_KEYS[surface]}"
        if name is None and surface == "sides" and body.sides in ("free", "auto"):
            continue
        named = name is not None
        rest = np.where(taken, np.nan, up)
        rows = (
            _rows_of(file, name, surface, outside, used)
            if named
            else _facing(surface, rest, points[outside])
        )
        if (taken & ~on_axis)[rows].any():
            raise refused(
                f"'{name}' shares facets with another surface", "give each facet one", key
            )
        taken[rows] = True
        found[surface] = outside[rows]
        _check_place(surface, name, up[rows], points[outside[rows]])
    _refuse_layers(body.surfaces.contact or f"what {FACING['top']}", points[found["top"]])
    axis = {"r_min": outside[on_axis]} if body.kinematics == "axisymmetric" else {}
    return {surface: found[surface] for surface in SURFACE_KEYS if surface in found} | axis


def _facing(surface: str, up: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Which of the outer facets are a surface by their normals' vertical component `up`, NaN of
    those of another.
    """
    rows = np.flatnonzero(
        {"top": up > LEVEL, "base": up < -LEVEL, "sides": np.abs(up) <= LEVEL}[surface]
    )
    heights = corners[rows][..., -1] if surface == "base" else np.zeros(1)
    if len(rows) == 0 or np.ptp(heights) > LEVEL * np.ptp(corners, axis=(0, 1)).max():
        key = SURFACE_KEYS[surface]
        problem = f"is not given, and no one part of the outside {FACING[surface]}"
        raise MeshFileError(f"body.surfaces.{key}", problem, _how_to_name(key, corners.shape[1]))
    return rows


def _how_to_name(name: str, dim: int) -> str:
    facets, cells = {2: ("Curve", "Surface"), 3: ("Surface", "Volume")}[dim]
    return (
        f'in gmsh: Physical {facets}("{name}") = {{...}}; and Physical {cells}("body") = '
        f"{{...}}; then save the mesh"
    )


def _rows_of(
    file: MeshFile, name: str, surface: str, outside: np.ndarray, used: np.ndarray
) -> np.ndarray:
    """Which of the outer facets have a name: as a group of facets, or with all their corners in a
    set of points.
    """
    dim = outside.shape[1]
    key = f"body.surfaces.{SURFACE_KEYS[surface]}"
    if not file.corners and not any(dim - 1 in group for group in file.groups.values()):
        remedy = (
            f"leave the key out where that {FACING[surface]}, or name it {_how_to_name(name, dim)}"
        )
        raise MeshFileError(
            key, f"the file names no {KIND[dim - 1]}, so it has no '{name}'", remedy
        )
    if name in file.corners and dim - 1 not in file.groups.get(name, {}):
        rows = np.flatnonzero(np.isin(used[outside], file.corners[name]).all(axis=1))
        if len(rows) == 0:
            raise refused(
                f"no outer facet has all its corners in the set '{name}'", file.names, key
            )
        return rows
    facets = np.sort(file.cells[dim - 1][_group(file, name, dim - 1, key)], axis=1)
    both = np.concatenate([np.sort(used[outside], axis=1), facets])
    own, named = np.split(np.unique(both, axis=0, return_inverse=True)[1].ravel(), [len(outside)])
    if (inside := ~np.isin(named, own)).any():
        where = (
            "not on the outside of the body, the first at "
            f"{place_of(file.points[facets[inside][0]])}"
        )
        raise refused(
            f"{inside.sum()} facets of '{name}' are {where}", "name outer facets alone", key
        )
    return np.flatnonzero(np.isin(own, named))


def _check_place(surface: str, name: str | None, up: np.ndarray, corners: np.ndarray) -> None:
    """The tip comes from above: contact faces up, the base does not."""
    wrong = {"top": up <= LEVEL, "base": up > LEVEL}.get(surface, np.zeros(len(up), dtype=bool))
    if wrong.any():
        faces = "up" if surface == "base" else "down" if (up[wrong] < -LEVEL).any() else "sideways"
        problem = (
            f"{wrong.sum()} facets of '{name}' face {faces}, the first at "
            f"{place_of(corners[wrong][0])}"
        )
        raise refused(problem, UPWARDS[surface], f"body.surfaces.{SURFACE_KEYS[surface]}")


def _refuse_layers(name: str, corners: np.ndarray) -> None:
    """ConfigError where one part of the contact surface lies above another."""
    plan = corners[..., :-1]
    middles = plan.mean(axis=1)
    low = plan.min(axis=1)
    high = plan.max(axis=1)
    order = np.argsort(middles[:, 0])
    begin, end = (np.searchsorted(middles[order, 0], edge[:, 0]) for edge in (low, high))
    for facet in range(len(plan)):
        near = order[begin[facet] : end[facet]]
        near = near[
            ((middles[near] >= low[facet]) & (middles[near] <= high[facet])).all(axis=1)
            & (near != facet)
        ]
        if len(near) == 0:
            continue
        first = plan[facet, 0]
        edges = (plan[facet, 1:] - plan[facet, 0]).T
        shares = np.linalg.solve(edges, (middles[near] - first).T)
        if ((shares > LEVEL).all(axis=0) & (shares.sum(axis=0) < 1 - LEVEL)).any():
            remedy = "name the upper one alone: the contact surface has one height at each place"
            problem = f"parts of '{name}' lie above one another at {place_of(corners[facet])}"
            raise refused(problem, remedy, "body.surfaces.contact")


def _middles(file: MeshFile, used: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The midside nodes of the cells, edges (k, 2) and places (k, dim), where every edge of theirs
    has one.
    """
    dim = cells.shape[1] - 1
    (edges, nodes) = file.middles
    inside = np.isin(edges, used).all(axis=1)
    own, first = np.unique(
        np.sort(np.searchsorted(used, edges[inside]), axis=1), axis=0, return_index=True
    )
    complete = len(own) and np.isin(keys_of(edges_of(cells)), keys_of(own)).all()
    places = file.points[nodes[inside][first]][:, :dim]
    return (own, places) if complete else (np.empty((0, 2), dtype=np.int64), np.empty((0, dim)))
