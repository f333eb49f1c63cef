"""From a mesh file to the piece that it stands for: names found, cells and surfaces where they belong, or refused."""

from __future__ import annotations

import hashlib

import numpy as np

from indent_sim.mesh.file import MeshFile, place_of, read, refused
from indent_sim.mesh.grid import Grid, boundary_of, facets_of, lots
from indent_sim.mesh.piece import Piece, Skin, edges_of, keys_of, righted, skin_of
from indent_sim.model.body import MeshFromFile

FLAT = 1e-9  # volume of a cell over length^dim: less is none
LEVEL = 1e-9  # of the body, or of a unit normal: what a level face or an upright wall may depart from that
KIND = {1: "lines", 2: "triangles", 3: "tetrahedra"}


def piece_in(folder: str, body: MeshFromFile, has_material: bool) -> Piece:
    """The body that the cells, surfaces and regions of a file below a folder make; see `piece_of`."""
    return piece_of(read(folder, body.file), body, has_material)


def skin_in(folder: str, body: MeshFromFile, has_material: bool) -> Skin:
    """The skin of the body of a file, which holds the whole."""
    return skin_of(piece_in(folder, body, has_material))


def piece_of(file: MeshFile, body: MeshFromFile, has_material: bool) -> Piece:
    """The body that a file's cells, surfaces and regions make; ConfigError where they make none.

    has_material: whether cells of no region have the scene's material.
    """
    dim = 3 if body.kinematics == "3d" else 2
    if dim not in file.cells or (dim == 2 and 3 in file.cells):
        has = " and ".join(KIND[found] for found in sorted(file.cells)) or "no cells"
        raise refused(f"the file has {has}, and a body in {dim} dimensions is made of {KIND[dim]}", "3d for "
                      "tetrahedra, axisymmetric or plane_strain for triangles", "body.kinematics")  # fmt: skip
    is_used = np.zeros(len(file.points), dtype=bool)
    is_used[file.cells[dim]] = True
    used, cells = np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[file.cells[dim]]
    points = _in_dimensions(file.points[used], dim, body)
    _refuse_tangled(points, cells)
    names, regions = _regions(file, body, dim, len(cells), has_material)
    surfaces = _surfaces(file, body, points, cells, used)
    grid = Grid(points, righted(points, cells), regions, surfaces)
    middles = _middles(file, used, cells)
    return Piece(grid, names, middles, _hash(points, grid.cells, regions, *surfaces.values(), *middles))


def _hash(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _in_dimensions(points: np.ndarray, dim: int, body: MeshFromFile) -> np.ndarray:
    """The coordinates of the body's own dimensions; points of the axis exactly on it."""
    size = float(np.ptp(points, axis=0).max())
    if dim == 3:
        return points
    if np.ptp(points[:, 2]) > LEVEL * size:
        raise refused("the triangles do not lie in one plane z = const of the file",
                      "a section has (r, z) or (x, z) in the file's (x, y)", "body.kinematics")  # fmt: skip
    section = np.ascontiguousarray(points[:, :2])
    if body.kinematics == "axisymmetric":
        if section[:, 0].min() < -LEVEL * size:
            raise refused(f"points of the section have r = {section[:, 0].min():g}",
                          "the axis is r = 0, the file's x = 0, and the body beyond it", "body.kinematics")  # fmt: skip
        section[np.abs(section[:, 0]) <= LEVEL * size, 0] = 0.0
    return section


def _refuse_tangled(points: np.ndarray, cells: np.ndarray) -> None:
    """ConfigError for cells without volume, that overlap their neighbours, or that hang together in no one piece."""
    if len(flat := np.concatenate([_flat(points, cells[some]) for some in lots(len(cells))])):
        raise refused(f"{len(flat)} cells have no volume, the first at {place_of(points[flat[0]])}",
                      "mesh the body anew")  # fmt: skip
    folded = np.concatenate([_folded(points, cells[cell, corner], facets) for facets, cell, corner in facets_of(cells)])
    if len(folded):
        raise refused(f"{len(folded)} cells are inverted: they overlap a neighbour, the first at "
                      f"{place_of(points[folded[0]])}", "mesh the body anew")  # fmt: skip
    if (pieces := len(np.unique(_connected(cells, len(points))))) > 1:
        raise refused(f"the mesh is in {pieces} pieces that share no points", "merge double points (gmsh: Coherence)")


def _flat(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Those of the cells that have no volume."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    lengths = np.abs(edges).max(axis=(1, 2))
    return np.asarray(cells[np.abs(np.linalg.det(edges)) <= FLAT * lengths ** points.shape[1]])


def _folded(points: np.ndarray, opposite: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Those facets whose two cells, by the corner `opposite` of each, are on the same side; ConfigError for a third."""
    ascending = np.sort(facets, axis=1)
    order = np.lexsort(ascending.T)
    same = (ascending[order[1:]] == ascending[order[:-1]]).all(axis=1)
    if (same[1:] & same[:-1]).any():
        shared = facets[order[1:-1][same[1:] & same[:-1]][0]]
        raise refused(f"three cells share the facet at {place_of(points[shared])}", "mesh the body anew")
    first, second = order[:-1][same], order[1:][same]
    sides = [_side(points, facets[first], opposite[number]) for number in (first, second)]
    return np.asarray(facets[first][sides[0] * sides[1] >= 0])


def _side(points: np.ndarray, facets: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """On which side of facets, by sign, other points are."""
    corners = points[np.column_stack([facets, opposite])]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]))


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


def _regions(file: MeshFile, body: MeshFromFile, dim: int, count: int, has_material: bool
             ) -> tuple[tuple[str, ...], np.ndarray]:  # fmt: skip
    """The names of the regions and the number of each cell's; "" is what has no region of its own."""
    names = tuple(body.regions or ())
    found = np.full(count, -1, dtype=np.int32)
    for number, name in enumerate(names):
        cells = _group(file, name, dim, f"body.regions.{name}")
        if (twice := found[cells] >= 0).any():
            other = names[found[cells][twice][0]]
            raise refused(f"{twice.sum()} cells are of this region and of {other}", "give each cell one region",
                          f"body.regions.{name}")  # fmt: skip
        found[cells] = number
    rest = found < 0
    if rest.any() and not has_material:
        raise refused(f"{rest.sum()} cells are of no region, and the scene has no material", f"{file.names}",
                      "body.regions")  # fmt: skip
    found[rest] = len(names)
    return (*names, "") if rest.any() else names, found


def _group(file: MeshFile, name: str, dim: int, key: str) -> np.ndarray:
    """The simplices of a dimension that have a name."""
    if name not in file.groups:
        raise refused(f"the file has no group '{name}'", file.names, key)
    if dim not in file.groups[name]:
        kinds = " and ".join(KIND[found] for found in sorted(file.groups[name]))
        raise refused(f"'{name}' is a group of {kinds}, and {KIND[dim]} are needed here", file.names, key)
    return file.groups[name][dim]


def _surfaces(file: MeshFile, body: MeshFromFile, points: np.ndarray, cells: np.ndarray, used: np.ndarray
              ) -> dict[str, np.ndarray]:  # fmt: skip
    """The facets (k, dim) of top, base and sides, and of the axis as r_min; what lies elsewhere is a ConfigError."""
    wanted = {"top": ("contact", body.surfaces.contact), "base": ("base", body.surfaces.base)}
    if body.surfaces.sides is not None:
        wanted["sides"] = ("sides", body.surfaces.sides)
    elif body.sides != "free":
        raise refused(f"'{body.sides}' sides are not named", "give surfaces.sides", "body.sides")
    outside, opposite = boundary_of(cells)
    found: dict[str, np.ndarray] = {}
    taken = np.zeros(len(outside), dtype=bool)
    for surface, (key, name) in wanted.items():
        rows = _rows_of(file, name, f"body.surfaces.{key}", outside, used)
        if taken[rows].any():
            raise refused(f"'{name}' shares facets with another surface", "give each facet one", f"body.surfaces.{key}")
        taken[rows] = True
        found[surface] = outside[rows]
        up = _upward(points, outside[rows], opposite[rows])
        _check_place(surface, name, up, points[outside[rows]])
    _refuse_layers(body.surfaces.contact, points[found["top"]])
    if body.kinematics == "axisymmetric":
        found["r_min"] = outside[(points[outside][:, :, 0] == 0).all(axis=1)]
    return found


def _rows_of(file: MeshFile, name: str, key: str, outside: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Which of the outer facets have a name: as a group of facets, or with all their corners in a set of points."""
    dim = outside.shape[1]
    if name in file.corners and dim - 1 not in file.groups.get(name, {}):
        rows = np.flatnonzero(np.isin(used[outside], file.corners[name]).all(axis=1))
        if len(rows) == 0:
            raise refused(f"no outer facet has all its corners in the set '{name}'", file.names, key)
        return rows
    facets = np.sort(file.cells[dim - 1][_group(file, name, dim - 1, key)], axis=1)
    both = np.concatenate([np.sort(used[outside], axis=1), facets])
    _, inverse = np.unique(both, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    own, named = inverse[: len(outside)], inverse[len(outside) :]
    if (inside := ~np.isin(named, own)).any():
        raise refused(f"{inside.sum()} facets of '{name}' are not on the outside of the body, the first at "
                      f"{place_of(file.points[facets[inside][0]])}", "name outer facets alone", key)  # fmt: skip
    return np.flatnonzero(np.isin(own, named))


def _upward(points: np.ndarray, facets: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """The vertical component of the outer unit normals (k,)."""
    corners = points[facets]
    edges = corners[:, 1:] - corners[:, :1]
    if points.shape[1] == 2:
        normal = np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
    inwards = points[opposite] - corners[:, 0]
    sign = np.where((normal * inwards).sum(axis=1) > 0, -1.0, 1.0)
    return np.asarray(sign * normal[:, -1] / np.linalg.norm(normal, axis=1))


def _check_place(surface: str, name: str, up: np.ndarray, corners: np.ndarray) -> None:
    """The tip comes from above: contact faces up, the base does not."""
    if surface == "top" and (wrong := up <= LEVEL).any():
        faces = "down" if (up[wrong] < -LEVEL).any() else "sideways"
        raise refused(f"{wrong.sum()} facets of '{name}' face {faces}, the first at {place_of(corners[wrong][0])}",
                      "the tip comes from above: z is up, and the surface hangs over nowhere",
                      "body.surfaces.contact")  # fmt: skip
    if surface == "base" and (wrong := up > LEVEL).any():
        raise refused(f"{wrong.sum()} facets of '{name}' face up, the first at {place_of(corners[wrong][0])}",
                      "z is up: a base faces down or sideways", "body.surfaces.base")  # fmt: skip


def _refuse_layers(name: str, corners: np.ndarray) -> None:
    """ConfigError where one part of the contact surface lies above another."""
    plan = corners[..., :-1]
    middles, low, high = plan.mean(axis=1), plan.min(axis=1), plan.max(axis=1)
    order = np.argsort(middles[:, 0])
    begin, end = (np.searchsorted(middles[order, 0], edge[:, 0]) for edge in (low, high))
    for facet in range(len(plan)):
        near = order[begin[facet] : end[facet]]
        near = near[((middles[near] >= low[facet]) & (middles[near] <= high[facet])).all(axis=1) & (near != facet)]
        if len(near) == 0:
            continue
        first, edges = plan[facet, 0], (plan[facet, 1:] - plan[facet, 0]).T
        shares = np.linalg.solve(edges, (middles[near] - first).T)
        if ((shares > LEVEL).all(axis=0) & (shares.sum(axis=0) < 1 - LEVEL)).any():
            raise refused(f"parts of '{name}' lie above one another at {place_of(corners[facet])}",
                          "name the upper one alone: the contact surface has one height at each place",
                          "body.surfaces.contact")  # fmt: skip


def _middles(file: MeshFile, used: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The midside nodes of the cells, edges (k, 2) and places (k, dim), where every edge of theirs has one."""
    dim, (edges, nodes) = cells.shape[1] - 1, file.middles
    inside = np.isin(edges, used).all(axis=1)
    own, first = np.unique(np.sort(np.searchsorted(used, edges[inside]), axis=1), axis=0, return_index=True)
    complete = len(own) and np.isin(keys_of(edges_of(cells)), keys_of(own)).all()
    places = file.points[nodes[inside][first]][:, :dim]
    return (own, places) if complete else (np.empty((0, 2), dtype=np.int64), np.empty((0, dim)))
