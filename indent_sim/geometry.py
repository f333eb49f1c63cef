"""Scene -> points and cells: the only file that builds with gmsh."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from indent_sim.errors import BackendError, MeshError
from indent_sim.model.body import Cylinder
from indent_sim.scene import Scene
from indent_sim.sizing import Sizes

SHAKE = 1e-9  # of the body, what gmsh shifts points by so that no four of them lie on a circle
SHAKE_OF_ELEMENT = 1e-4
DIGITS = 12  # lengths are rounded to this many digits, so that a scene in nm and in m gives the same mesh


@dataclass(frozen=True)
class Grid:
    """A simplex mesh as arrays: points (n, dim) [length of the scene], cells (m, dim + 1)."""

    points: np.ndarray
    cells: np.ndarray

    @property
    def hash(self) -> str:
        """Fingerprint of the mesh, for the record of a run."""
        digest = hashlib.sha256(np.round(self.points, DIGITS).tobytes() + self.cells.tobytes())
        return digest.hexdigest()[:16]


def build(scene: Scene) -> Grid:
    """Mesh the modelled part of the body, graded from h_contact to h_far.

    Raises MeshError when gmsh fails, BackendError when it is missing.
    """
    with _gmsh_session() as gmsh:
        try:
            _draw(gmsh, scene)
            _prescribe_sizes(gmsh, scene)
            gmsh.option.setNumber("Mesh.RandomFactor", _shake(scene))
            gmsh.model.mesh.generate(scene.kinematics.dim)
        except Exception as failure:  # gmsh raises bare Exceptions
            raise MeshError(f"gmsh could not mesh the body: {failure}") from failure
        return _grid(gmsh, scene.kinematics.dim)


def load() -> None:
    """Import gmsh and start it once, which the first mesh of a process waits for."""
    with _gmsh_session():
        pass


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


def _draw(gmsh: Any, scene: Scene) -> None:
    if scene.kinematics.dim == 2:
        _draw_rectangle(gmsh, scene)
    elif isinstance(scene.body, Cylinder):
        _draw_cylinder(gmsh, scene, round(scene.body.radius, DIGITS))
    else:
        _draw_box(gmsh, scene)


def _rounded(extent: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    return [(round(low, DIGITS), round(high, DIGITS)) for low, high in extent]


def _draw_rectangle(gmsh: Any, scene: Scene) -> None:
    """A rectangle whose top edge is split under the tip's axis and at a punch's edge: contact may end there."""
    (x0, x1), (z0, z1) = _rounded(scene.extent)
    offsets = [0.0] if scene.sizes.edge is None else [-scene.sizes.edge, 0.0, scene.sizes.edge]
    splits = sorted({round(scene.center[0] + offset, DIGITS) for offset in offsets}, reverse=True)
    top = [(x, z1) for x in splits if x0 < x < x1]
    corners = [(x0, z0), (x1, z0), (x1, z1), *top, (x0, z1)]
    geo = gmsh.model.geo
    points = [geo.addPoint(x, z, 0.0) for x, z in corners]
    lines = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.synchronize()


def _draw_box(gmsh: Any, scene: Scene) -> None:
    """A box whose top is split along a punch's edge: elements it crosses would feel a smaller punch, each another."""
    (x0, x1), (y0, y1), (z0, z1) = _rounded(scene.extent)
    occ = gmsh.model.occ
    box = occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)
    if scene.sizes.edge is not None:
        radius = round(scene.sizes.edge, DIGITS)
        disk = occ.addDisk(*scene.center, z1, radius, radius)
        below, _ = occ.intersect([(2, disk)], [(3, box)], removeTool=False)
        occ.fragment([(3, box)], below)
    occ.synchronize()


def _draw_cylinder(gmsh: Any, scene: Scene, radius: float) -> None:
    """The cylinder, or the half or quarter of it on one side of the mirror planes, from arcs of a quarter turn."""
    (x0, _), (y0, _), (z0, z1) = _rounded(scene.extent)
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


def _prescribe_sizes(gmsh: Any, scene: Scene) -> None:
    field = gmsh.model.mesh.field
    tag = field.add("MathEval")
    field.setString(tag, "F", size_formula(scene.sizes, scene.center, scene.kinematics.dim))
    field.setAsBackgroundMesh(tag)


def size_formula(sizes: Sizes, center: tuple[float, ...], dim: int) -> str:
    """The element size at (x, y[, z]) as a gmsh MathEval expression (gmsh has no min or max there)."""
    number = "{:.12g}".format
    if dim == 2:
        r, depth = f"Abs(x-({number(center[0])}))", "Abs(y)"
    else:
        x, y = (number(c) for c in center)
        r, depth = f"Sqrt((x-({x}))^2+(y-({y}))^2)", "Abs(z)"
    outside = _positive(f"({r}-{number(sizes.patch)})")
    near = number(sizes.h_contact)
    if sizes.h_axis is not None:
        near = _smaller(near, _larger(number(sizes.h_axis), f"{number(sizes.slope)}*{r}"))
    size = f"{near}+{number(sizes.grading)}*Sqrt({outside}^2+{depth}^2)"
    for at, below, smallest in sizes.points:
        around = f"Sqrt(({r}-{number(at)})^2+({depth}-{number(below)})^2)"
        size = _smaller(size, f"{number(smallest)}+{number(sizes.grading)}*{around}")
    return _smaller(size, number(sizes.h_far))


def _shake(scene: Scene) -> float:
    """How far gmsh may shift the points of a mesh at random, as a part of the longest side of the body.

    Its own 1e-9, but little beside the smallest element: more turns cells inside out, and then the force is wrong or
    gmsh aborts.
    """
    longest = max(high - low for low, high in scene.extent)
    return min(SHAKE, SHAKE_OF_ELEMENT * scene.sizes.finest / longest)


def _positive(a: str) -> str:
    return f"(0.5*({a}+Abs({a})))"


def _larger(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})+Abs(({a})-({b}))))"


def _smaller(a: str, b: str) -> str:
    return f"(0.5*(({a})+({b})-Abs(({a})-({b}))))"


def _grid(gmsh: Any, dim: int) -> Grid:
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(2 if dim == 2 else 4)
    if len(nodes) == 0:
        raise MeshError("gmsh made no cells")
    used, cells = np.unique(np.asarray(nodes, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    rows = order[np.searchsorted(np.asarray(tags)[order], used)]
    points = np.asarray(coordinates).reshape(-1, 3)[rows, :dim]
    return Grid(np.ascontiguousarray(points), np.ascontiguousarray(cells.reshape(-1, dim + 1)))
