"""Scene -> points and cells; the only file that builds with gmsh."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from indent_sim.mesh.grid import DIGITS, Grid
from indent_sim.mesh.part import Part
from indent_sim.mesh.sizes import size_formula
from indent_sim.model.body import Cylinder
from indent_sim.process.errors import BackendError, MeshError
from indent_sim.process.forked import Crash, Forked
from indent_sim.process.ranks import is_one_of_several
from indent_sim.scene.scene import Scene

SHAKE = 1e-9  # of the body, what gmsh shifts points by so that no four of them lie on a circle
SHAKE_OF_ELEMENT = 1e-4
MILDER = (1.0, 0.1, 0.01)  # of that, in turn: 4 meshes in 10 of a strip had flat triangles at 1, none at 0.1
FLAT = 1e-9  # volume of a cell over length^dim: beside a split at 1e-8 of the body it is 1e-8
SHAKES = 10.0  # points nearer to one another may change places by the shift, and then gmsh aborts: seen up to 4


def build(scene: Scene) -> Grid:
    """Mesh the modelled part of the body, graded from h_contact to h_far.

    Raises MeshError when gmsh fails or crashes, BackendError when it is missing.
    """
    return begin(scene)()


def begin(scene: Scene) -> Callable[[], Grid]:
    """Begin to mesh a scene in the forked process; what is returned waits for the grid that `build` returns.

    On several ranks a process is not forked once MPI may be up, and without room for one this process meshes itself.
    """
    part = Part(scene.kinematics, scene.body, scene.extent, scene.center, scene.sizes)
    if not _mesher.is_up and is_one_of_several():
        return partial(_meshed, part)
    try:
        return partial(_answered, _mesher.ask(part))
    except OSError:
        return partial(_meshed, part)


def start() -> None:
    """Fork the process that meshes, best before MPI is up; it loads gmsh, which the first mesh would wait for."""
    with suppress(OSError):
        _mesher.start()


def _answered(answer: Callable[[], Grid]) -> Grid:
    try:
        return answer()
    except Crash as crash:
        raise MeshError(f"gmsh could not mesh the body: its process {crash}") from None


def _meshed(part: Part, aloud: bool = False) -> Grid:
    """The mesh of a part; gmsh may fail, or leave cells without volume, by its shift: then with a smaller one."""
    failure = MeshError("gmsh left cells without volume; another mesh.h_contact may help")
    for milder in MILDER:
        try:
            grid = _generated(part, milder * _shake(part), aloud)
        except MeshError as error:
            failure = error
            continue
        if not has_flat_cells(grid):
            return grid
    raise failure


def _generated(part: Part, shake: float, aloud: bool) -> Grid:
    with _gmsh_session() as gmsh:
        gmsh.option.setNumber("General.Terminal", int(aloud))
        try:
            _draw(gmsh, part)
            _prescribe_sizes(gmsh, part)
            gmsh.option.setNumber("Mesh.RandomFactor", shake)
            gmsh.model.mesh.generate(part.kinematics.dim)
        except Exception as failure:  # gmsh raises bare Exceptions
            raise MeshError(f"gmsh could not mesh the body: {failure}") from failure
        return _grid(gmsh, part.kinematics.dim)


def _load() -> None:
    """Import gmsh and start it once."""
    with _gmsh_session():
        pass


# One for this process, as gmsh is; what gmsh prints there is kept for the message of a crash
_mesher = Forked(partial(_meshed, aloud=True), _load)


@contextmanager
def _gmsh_session() -> Iterator[Any]:
    handler = signal.getsignal(signal.SIGINT)  # importing, initialising and finalising gmsh each take it away
    try:
        import gmsh
    except ImportError as missing:
        raise BackendError(f"gmsh is missing ({missing}); install the packages of packages-debian.txt") from missing
    gmsh.initialize([], False)  # no user configuration: the mesh depends on the scene alone
    try:
        signal.signal(signal.SIGINT, handler)
        for option, value in (
            ("General.Terminal", 0),
            ("General.Verbosity", 1),  # errors alone
            ("General.NumThreads", 1),
            ("Mesh.MeshSizeExtendFromBoundary", 0),
            ("Mesh.MeshSizeFromPoints", 0),
        ):
            gmsh.option.setNumber(option, value)
        gmsh.model.add("indent-sim")
        yield gmsh
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGINT, handler)


def _draw(gmsh: Any, part: Part) -> None:
    if part.kinematics.dim == 2:
        _draw_rectangle(gmsh, part)
    elif isinstance(part.body, Cylinder):
        _draw_cylinder(gmsh, part, round(part.body.radius, DIGITS))
    else:
        _draw_box(gmsh, part)


def _rounded(extent: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    return [(round(low, DIGITS), round(high, DIGITS)) for low, high in extent]


def _draw_rectangle(gmsh: Any, part: Part) -> None:
    """A rectangle whose top edge is split under the tip's axis and at a punch's edge: contact may end there."""
    (x0, x1), (z0, z1) = _rounded(part.extent)
    top = [(x, z1) for x in reversed(_splits(part, x0, x1))]
    corners = [(x0, z0), (x1, z0), (x1, z1), *top, (x0, z1)]
    geo = gmsh.model.geo
    points = [geo.addPoint(x, z, 0.0) for x, z in corners]
    lines = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.synchronize()


def _splits(part: Part, x0: float, x1: float) -> list[float]:
    """Where the top edge from x0 to x1 is split, from left to right.

    What is nearer to a corner or to the axis than gmsh can tell apart is left to that point: at most 1e-8 of the body,
    which changes the force by as little.
    """
    apart = SHAKES * _shake(part) * _longest(part)
    kept = [x0, x1]
    for offset in (0.0,) if part.sizes.edge is None else (0.0, -part.sizes.edge, part.sizes.edge):
        x = round(part.center[0] + offset, DIGITS)
        if x0 < x < x1 and all(abs(x - other) > apart for other in kept):
            kept.append(x)
    return sorted(kept[2:])


def _draw_box(gmsh: Any, part: Part) -> None:
    """A box whose top is split along a punch's edge: elements it crosses would feel a smaller punch, each another."""
    (x0, x1), (y0, y1), (z0, z1) = _rounded(part.extent)
    occ = gmsh.model.occ
    box = occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)
    if part.sizes.edge is not None:
        radius = round(part.sizes.edge, DIGITS)
        disk = occ.addDisk(*part.center, z1, radius, radius)
        below, _ = occ.intersect([(2, disk)], [(3, box)], removeTool=False)
        occ.fragment([(3, box)], below)
    occ.synchronize()


def _draw_cylinder(gmsh: Any, part: Part, radius: float) -> None:
    """The cylinder, or the half or quarter of it on one side of the mirror planes, from arcs of a quarter turn."""
    (x0, _), (y0, _), (z0, z1) = _rounded(part.extent)
    first = -1 if x0 == 0 and y0 < 0 else 0
    quarters = (2 if x0 < 0 else 1) * (2 if y0 < 0 else 1)
    geo = gmsh.model.geo
    middle = geo.addPoint(0.0, 0.0, z0)
    turns = [[(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][k % 4] for k in range(first, first + quarters + 1)]
    rim = [geo.addPoint(c * radius, s * radius, z0) for c, s in turns[: quarters + (quarters < 4)]]
    ends = rim + rim[:1] if quarters == 4 else rim
    lines = [geo.addCircleArc(a, middle, b) for a, b in pairwise(ends)]
    if quarters < 4:
        lines += [geo.addLine(rim[-1], middle), geo.addLine(middle, rim[0])]
    base = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.extrude([(2, base)], 0.0, 0.0, z1 - z0)
    geo.synchronize()


def _prescribe_sizes(gmsh: Any, part: Part) -> None:
    field = gmsh.model.mesh.field
    tag = field.add("MathEval")
    field.setString(tag, "F", size_formula(part.sizes, part.center, part.kinematics.dim))
    field.setAsBackgroundMesh(tag)


def _shake(part: Part) -> float:
    """How far gmsh may shift the points of a mesh at random, as a part of the longest side of the body.

    Its own 1e-9, but little beside the smallest element: more turns cells inside out, and then the force is wrong or
    gmsh aborts.
    """
    return min(SHAKE, SHAKE_OF_ELEMENT * part.sizes.finest / _longest(part))


def _longest(part: Part) -> float:
    """The longest side of the body [length]."""
    return max(high - low for low, high in part.extent)


def _grid(gmsh: Any, dim: int) -> Grid:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(2 if dim == 2 else 4)
    if len(nodes) == 0:
        raise MeshError("gmsh made no cells")
    used, cells = np.unique(np.asarray(nodes, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    rows = order[np.searchsorted(np.asarray(tags)[order], used)]
    points = np.asarray(coordinates).reshape(-1, 3)[rows, :dim]
    version = gmsh.option.getString("General.Version")
    return Grid(np.ascontiguousarray(points), np.ascontiguousarray(cells.reshape(-1, dim + 1)), version)


def has_flat_cells(grid: Grid) -> bool:
    """Whether a cell has no volume, as a triangle on three points of a straight side."""
    corners = grid.points[grid.cells]
    edges = corners[:, 1:] - corners[:, :1]
    lengths = np.abs(edges).max(axis=(1, 2))
    return bool((np.abs(np.linalg.det(edges)) < FLAT * lengths ** grid.points.shape[1]).any())
