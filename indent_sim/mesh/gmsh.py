"""Part and element sizes -> Grid; the only file that builds with gmsh."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from indent_sim.mesh.grid import LENGTH_DIGITS, Grid, is_flat, named_surfaces, regions_of_cells
from indent_sim.mesh.modelled_part import Part, Side
from indent_sim.mesh.part_from_file import MeshedPart, refined
from indent_sim.mesh.sizes import (
    Sizes,
    formula_around,
    formula_at_face,
    formula_beside,
    size_formula,
)
from indent_sim.model.body import BallInclusion, CylinderInclusion, EllipsoidInclusion, Inclusion
from indent_sim.process.errors import BackendError, MeshError
from indent_sim.process.forked import Crash, Forked
from indent_sim.process.ranks import is_one_of_several

T = TypeVar("T")
Gmsh = Any  # the module, which is loaded where it meshes alone, or one of its kernels
OTHER_SIZES = (
    1.1,
    0.9,
)  # times h_contact: tried where a part cannot be meshed, so that a message names what helps
OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    "General.NumThreads": 1,
}  # says errors alone
OPTIONS |= {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0}
TILT = (
    1.0,
    -1.0,
    0.0,
    1.0,
)  # about this axis by this angle: seam and poles of a ball lie in no plane of symmetry then
# points nearer to one another may change places by the shift, and then gmsh aborts: seen up to 4
SHAKES = 10.0


def build(part: Part, sizes: Sizes) -> Grid:
    """Mesh a part with elements of these sizes.

    Raises MeshError when gmsh fails or crashes, BackendError when it is missing.
    """
    return begin(part, sizes)()


def begin(part: Part, sizes: Sizes) -> Callable[[], Grid]:
    """Begin to mesh a part in the forked process; what is returned waits for the grid that `build`
    returns.

    A mesh from a file is refined, without gmsh, and by a process alone here.
    """
    if not isinstance(part, MeshedPart):
        return elsewhere("gmsh could not mesh the body", _meshed, part, sizes, terminal=1)
    if not is_one_of_several():
        return partial(refined, part, sizes)
    return elsewhere("the mesh could not be refined", refined, part, sizes)


def elsewhere(
    failure: str, function: Callable[..., T], *arguments: object, **there: object
) -> Callable[[], T]:
    """Begin a call in the forked process, told `there` too; what is returned waits for what it
    gives.

    On several ranks the arrays stay in a temporary file, from which they are divided; a process is
    not forked once MPI may be up, and without room for one this process does it. MeshError where it
    crashes, with `failure` as its words.
    """
    here = partial(function, *arguments)
    if not _mesher.is_up and is_one_of_several():
        return here
    try:
        answer = _mesher.ask(partial(here, **there), mapped=is_one_of_several())
    except OSError:
        return here

    def answered() -> T:
        try:
            return answer()
        except Crash as crash:
            raise MeshError(f"{failure}: its process {crash}") from None

    return answered


def start() -> None:
    """Fork the process that meshes, best before MPI is up; it loads gmsh, which the first mesh
    would wait for.
    """
    with suppress(OSError):
        _mesher.start()


def _meshed(part: Part, sizes: Sizes, terminal: int = 0) -> Grid:
    """The mesh of a part, with a smaller shift where gmsh fails or leaves flat cells; terminal: 1
    where it prints.

    MeshError where none does; it says which other size at the contact was tried and can be meshed.
    """
    try:
        return _shaken(part, sizes, terminal)
    except MeshError as failure:
        words = str(failure)
    for factor in OTHER_SIZES:
        if _can_be_meshed(part, replace(sizes, h_contact=factor * sizes.h_contact), terminal):
            raise MeshError(
                f"{words}; a mesh.h_contact {factor:g} times as large was tried and can be meshed"
            )
    tried = " and ".join(f"{factor:g}" for factor in OTHER_SIZES)
    raise MeshError(
        f"{words}; neither can it with a mesh.h_contact {tried} times as large, which were tried"
    )


def _can_be_meshed(part: Part, sizes: Sizes, terminal: int) -> bool:
    """Whether a part can be meshed with other sizes."""
    try:
        _shaken(part, sizes, terminal)
    except MeshError:
        return False
    return True


def _shaken(part: Part, sizes: Sizes, terminal: int) -> Grid:
    """As `_meshed`, of these sizes alone."""
    failure = MeshError("gmsh left cells without volume")
    for milder in (
        1.0,
        0.1,
        0.01,
    ):  # 4 meshes in 10 of a strip had flat triangles at 1, none at 0.1
        try:
            grid = _generated(part, sizes, milder * _shake(part, sizes), terminal)
        except MeshError as error:
            failure = error
            continue
        if not has_flat_cells(grid):
            return grid
    raise failure


def has_flat_cells(grid: Grid) -> bool:
    """Whether a cell has no volume to speak of."""
    return bool(is_flat(grid.points, grid.cells).any())


def _generated(part: Part, sizes: Sizes, shake: float, terminal: int) -> Grid:
    with _gmsh_session() as gmsh:
        gmsh.option.setNumber("General.Terminal", terminal)
        try:
            draw = _draw_section if part.dim == 2 else _draw_round if part.bend else _draw_box
            draw(gmsh, part, sizes)
            if part.inclusions:
                _draw_inclusions(gmsh, part)
            _prescribe_sizes(gmsh, sizes, part.dim)
            gmsh.option.setNumber("Mesh.RandomFactor", shake)
            gmsh.model.mesh.generate(part.dim)
        except Exception as failure:  # gmsh raises bare Exceptions
            raise MeshError(f"gmsh could not mesh the body: {failure}") from failure
        return _grid(gmsh, part, sizes)


def _load() -> None:
    with _gmsh_session():
        pass


_mesher = Forked(
    lambda call: call(), _load
)  # one for this process, as gmsh is; keeps what gmsh prints for a crash


@contextmanager
def _gmsh_session() -> Iterator[Gmsh]:
    handler = signal.getsignal(
        signal.SIGINT
    )  # importing, initialising and finalising gmsh each take it away
    try:
        import gmsh
    except ImportError as missing:
        raise BackendError(
            f"gmsh is missing ({missing}); install the packages of packages-debian.txt"
        ) from missing
    gmsh.initialize([], False)  # no user configuration: the mesh depends on the scene alone
    try:
        signal.signal(signal.SIGINT, handler)
        for option, value in OPTIONS.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("indent-sim")
        yield gmsh
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, handler)


def _kernel(gmsh: Gmsh, part: Part) -> Gmsh:
    """The built-in CAD kernel, which knows no tolerance; OpenCASCADE where there is something to
    cut out.
    """
    return gmsh.model.occ if part.inclusions else gmsh.model.geo


def _draw_inclusions(gmsh: Gmsh, part: Part) -> None:
    """Cut the inclusions out of what is drawn, as far as they are inside it, and put them in their
    places.
    """
    occ = gmsh.model.occ
    around = gmsh.model.getEntities(part.dim)
    whole = [(part.dim, _shape_of(occ, inclusion, part.dim)) for inclusion in part.inclusions]
    inside, _ = occ.intersect(whole, around, removeTool=False)
    occ.fragment(around, inside)
    occ.synchronize()


def _shape_of(occ: Gmsh, inclusion: Inclusion, dim: int) -> int:
    """The inclusion as a solid; in two dimensions its section y = 0, drawn in (x, y)."""
    (x, y, z) = _rounded(inclusion.center)
    (a, b, c) = _rounded(tuple(map(inclusion.half, range(3))))
    if isinstance(inclusion, EllipsoidInclusion):
        return _ellipsoid(occ, (x, y, z), (a, b, c), dim)
    if isinstance(inclusion, BallInclusion):
        return int(occ.addDisk(x, z, 0.0, a, a) if dim == 2 else occ.addSphere(x, y, z, a))
    if dim == 2:
        return int(occ.addRectangle(x - a, z - c, 0.0, 2 * a, 2 * c))
    if isinstance(inclusion, CylinderInclusion):
        return int(occ.addCylinder(x, y, z - c, 0.0, 0.0, 2 * c, a))
    return int(occ.addBox(x - a, y - b, z - c, 2 * a, 2 * b, 2 * c))


def _ellipsoid(occ: Gmsh, center: tuple[float, ...], halves: tuple[float, ...], dim: int) -> int:
    """A unit disk or ball in its place, stretched: a disk of gmsh's has its longer semi-axis along
    x.

    The ball is tilted first: OpenCASCADE 7.8 does not close a stretched one that is cut along its
    seam or at a pole, as planes of symmetry would.
    """
    (x, y, z) = center
    (a, b, c) = halves
    tag = int(occ.addDisk(x, z, 0.0, 1.0, 1.0) if dim == 2 else occ.addSphere(x, y, z, 1.0))
    place, factors = ((x, z, 0.0), (a, c, 1.0)) if dim == 2 else ((x, y, z), (a, b, c))
    if dim == 3:
        occ.rotate([(dim, tag)], *place, *TILT)
    occ.dilate([(dim, tag)], *place, *factors)
    return tag


def _draw_section(gmsh: Gmsh, part: Part, sizes: Sizes) -> None:
    """The section, its top edge split under the tip's axis and at a punch's edge; lines across it
    part the layers.
    """
    geo = _kernel(gmsh, part)
    split = [
        (_rounded(at), z, side) for side in part.outline for at, z in _corners(part, sizes, side)
    ]
    corners = [corner for corner, _, _ in split]
    middles = [_rounded(side.middle) for side in part.outline if side.middle]
    places = {place: geo.addPoint(*place, 0.0) for place in dict.fromkeys([*corners, *middles])}
    points = [places[corner] for corner in corners]
    pairs = zip(points, points[1:] + points[:1], strict=True)
    lines = [
        geo.addCircleArc(a, places[_rounded(side.middle)], b) if side.middle else geo.addLine(a, b)
        for (a, b), (_, _, side) in zip(pairs, split, strict=True)
    ]
    ends = [
        [k for k, (_, level, _) in enumerate(split) if level == z] for z in part.interfaces
    ]  # right, left
    across = [_face(geo, part, *((corners[k], points[k]) for k in both)) for both in ends]
    # each layer goes along the right side up to its upper interface, across, and down the left side
    edges = zip(
        [0, *(right for right, _ in ends)], [len(corners), *(left for _, left in ends)], strict=True
    )
    for layer, (begin, end) in enumerate(edges):
        floor = [-line for line in reversed(across[layer - 1])] if layer else []
        around = lines[begin:end]
        if layer < len(across):
            right, left = ends[layer]
            around = [*lines[begin:right], *across[layer], *lines[left:end]]
        geo.addPlaneSurface([geo.addCurveLoop([*floor, *around])])
    geo.synchronize()


Corner = tuple[tuple[float, ...], int]  # its place, and its number in gmsh


def _face(geo: Gmsh, part: Part, right: Corner, left: Corner) -> list[int]:
    """The lines of a face between layers, from the right to the left: a straight one, or arcs of a
    quarter at most.
    """
    (begin, first) = right
    (end, last) = left
    if part.dome is None:
        return [geo.addLine(first, last)]
    radius = abs(end[1] + part.dome)
    middle = geo.addPoint(0.0, -part.dome, 0.0)
    if begin[1] >= -part.dome:
        return [geo.addCircleArc(first, middle, last)]
    equator = geo.addPoint(radius, -part.dome, 0.0)
    return [geo.addCircleArc(first, middle, equator), geo.addCircleArc(equator, middle, last)]


def _corners(part: Part, sizes: Sizes, side: Side) -> list[tuple[tuple[float, ...], float | None]]:
    """Where a side of a section begins, and where it is split, there by which interface."""
    if side.surface == "top":
        R = part.dome
        at = reversed(_splits(part, sizes, side.end[0], side.start[0]))
        split = [
            (x, float(-x * x / (R + np.sqrt(R * R - x * x))) if R else side.start[1]) for x in at
        ]
        return [(side.start, None), *((place, None) for place in split)]
    return [(side.start, None), *(part.crossings(side) if side.middle is None else ())]


def _splits(part: Part, sizes: Sizes, x0: float, x1: float) -> list[float]:
    """Where the top edge is split, from left to right, but nowhere within 1e-8 of the body of a
    corner or the axis.
    """
    apart = SHAKES * _shake(part, sizes) * part.longest
    kept = [round(x0, LENGTH_DIGITS), round(x1, LENGTH_DIGITS)]
    for offset in (0.0,) if sizes.edge is None else (0.0, -sizes.edge, sizes.edge):
        x = round(sizes.axis[0] + offset, LENGTH_DIGITS)
        if kept[0] < x < kept[1] and all(abs(x - other) > apart for other in kept):
            kept.append(x)
    return sorted(kept[2:])


def _draw_box(gmsh: Gmsh, part: Part, sizes: Sizes) -> None:
    """A box whose top is split along a punch's edge: elements it crosses would feel a smaller
    punch, each another.
    """
    (x0, x1), (y0, y1), (z0, z1) = map(_rounded, part.extent)
    occ = gmsh.model.occ
    levels = (z0, *(round(z, LENGTH_DIGITS) for z in part.interfaces), z1)
    layers = [
        (3, occ.addBox(x0, y0, low, x1 - x0, y1 - y0, high - low)) for low, high in pairwise(levels)
    ]
    split = layers[:-1]
    if sizes.edge is not None:
        radius = round(sizes.edge, LENGTH_DIGITS)
        disk = occ.addDisk(*sizes.axis, z1, radius, radius)
        below, _ = occ.intersect([(2, disk)], layers[-1:], removeTool=False)
        split = [*split, *below]
    if split:
        occ.fragment(layers[-1:], split)
    occ.synchronize()


def _draw_round(gmsh: Gmsh, part: Part, sizes: Sizes) -> None:
    """The outline with its arcs, drawn on the base and pulled up to the top, layer by layer."""
    geo = _kernel(gmsh, part)
    base = -round(part.height, LENGTH_DIGITS)
    middles = [side.middle for side in part.outline if side.middle]
    places = [*middles, *(side.start for side in part.outline)]
    points = {place: geo.addPoint(*place, base) for place in dict.fromkeys(map(_rounded, places))}

    def line(side: Side) -> int:
        ends = points[_rounded(side.start)], points[_rounded(side.end)]
        return (
            geo.addCircleArc(ends[0], points[_rounded(side.middle)], ends[1])
            if side.middle
            else geo.addLine(*ends)
        )

    face = (2, geo.addPlaneSurface([geo.addCurveLoop([line(side) for side in part.outline])]))
    for low, high in pairwise((base, *(round(z, LENGTH_DIGITS) for z in part.interfaces), 0.0)):
        face = geo.extrude([face], 0.0, 0.0, high - low)[0]
    geo.synchronize()


def _rounded(point: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(round(x, LENGTH_DIGITS) for x in point)


def _prescribe_sizes(gmsh: Gmsh, sizes: Sizes, dim: int) -> None:
    """The smallest of what contact, inclusions, skins and drained faces want, each a field of its
    own: a minimum doubles a formula.
    """
    field = gmsh.model.mesh.field
    tags = []
    around = [formula_around(*one, sizes.grading, dim) for one in sizes.inclusions]
    within = [formula_beside(*one, sizes.grading) for one in sizes.skins]
    beside = [formula_at_face(film, sizes.axis[0], sizes.grading) for film in sizes.films]
    for formula in (size_formula(sizes, dim), *around, *within, *beside):
        tags.append(field.add("MathEval"))
        field.setString(tags[-1], "F", formula)
    least = tags[0] if len(tags) == 1 else field.add("Min")
    if len(tags) > 1:
        field.setNumbers(least, "FieldsList", tags)
    field.setAsBackgroundMesh(least)


def _shake(part: Part, sizes: Sizes) -> float:
    """How far gmsh may shift points, of the body's longest side; more turns cells inside out, or
    gmsh aborts.
    """
    # gmsh's own is 1e-9, by which no four points lie on a circle
    return min(1e-9, 1e-4 * sizes.finest / part.longest)


def _grid(gmsh: Gmsh, part: Part, sizes: Sizes) -> Grid:
    dim = part.dim
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(2 if dim == 2 else 4)
    if len(nodes) == 0:
        raise MeshError("gmsh made no cells")
    used, cells = np.unique(np.asarray(nodes, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    rows = order[np.searchsorted(np.asarray(tags)[order], used)]
    points = np.ascontiguousarray(np.asarray(coordinates).reshape(-1, 3)[rows, :dim])
    cells = np.ascontiguousarray(cells.reshape(-1, dim + 1))
    regions = regions_of_cells(points, cells, part)
    surfaces = named_surfaces(points, cells, part, sizes.finest)
    return Grid(points, cells, regions, surfaces, gmsh.option.getString("General.Version"))
