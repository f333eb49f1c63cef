"""Grid -> distributed dolfinx mesh with named surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import dolfinx
import numpy as np

from indent_sim.fe import compat
from indent_sim.mesh.grid import Grid
from indent_sim.model.body import Cylinder
from indent_sim.scene.scene import Scene

ON_PLANE = 1e-9  # of a body whose coordinates are near 1 and rounded to 12 digits
OF_ELEMENT = 1e-3  # the smallest: less than what lies between a plane and the next nodes


@dataclass(frozen=True)
class BodyMesh:
    """The distributed mesh; `surfaces` maps each named plane to its facets on this rank."""

    mesh: Any
    dim: int
    surfaces: dict[str, np.ndarray]
    hash: str
    near: float  # what is closer to a plane or a point lies on it [length]

    @cached_property
    def comm(self) -> Any:
        """The communicator of the mesh."""
        return self.mesh.comm

    @property
    def facet_dim(self) -> int:
        """Topological dimension of a facet."""
        return self.dim - 1

    def vertices_at(self, point: tuple[float, ...]) -> np.ndarray:
        """Local vertices at a point."""
        target = np.asarray(point)[:, None]

        def close(x: np.ndarray) -> np.ndarray:
            return np.all(np.abs(x[: self.dim] - target) < self.near, axis=0)

        return dolfinx.mesh.locate_entities(self.mesh, 0, close)


def distribute(grid: Grid | None, scene: Scene, comm: Any) -> BodyMesh:
    """Spread a grid that rank 0 holds over all ranks and find the named surfaces."""
    dim = scene.kinematics.dim
    if grid is None:
        points, cells = np.empty((0, dim)), np.empty((0, dim + 1), dtype=np.int64)
    else:
        points, cells = grid.points, grid.cells
    mesh = compat.create_mesh(comm, cells, points, dim)
    fingerprint = comm.bcast(grid.hash if grid is not None else None, root=0)
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    mesh.topology.create_connectivity(0, dim)
    near = min(ON_PLANE, OF_ELEMENT * scene.sizes.finest)
    return BodyMesh(mesh, dim, _surfaces(mesh, scene, near), fingerprint, near)


def _surfaces(mesh: Any, scene: Scene, near: float) -> dict[str, np.ndarray]:
    """Facets on each face of the modelled block: x_min, x_max, (y_min, y_max,) base, top; the curved wall r_max."""
    surfaces = {}
    for axis, (name, bounds) in enumerate(zip(scene.kinematics.axes, scene.extent, strict=True)):
        ends = ("base", "top") if name == "z" else (f"{name}_min", f"{name}_max")
        for end, value in zip(ends, bounds, strict=True):

            def on_plane(x: np.ndarray, axis: int = axis, value: float = value) -> np.ndarray:
                return np.abs(x[axis] - value) < near

            surfaces[end] = dolfinx.mesh.locate_entities_boundary(mesh, mesh.topology.dim - 1, on_plane)
    if isinstance(scene.body, Cylinder) and scene.kinematics.dim == 3:
        planes = np.concatenate(list(surfaces.values()))
        surfaces["r_max"] = np.setdiff1d(_curved_wall(mesh, scene.body.radius), planes)
    return surfaces


def _curved_wall(mesh: Any, radius: float) -> np.ndarray:
    """Facets with every corner on r = radius; between corners they lie inside it by their sagitta."""

    def on_wall(x: np.ndarray) -> np.ndarray:
        return np.abs(np.hypot(x[0], x[1]) - radius) < ON_PLANE * max(radius, 1.0)

    return dolfinx.mesh.locate_entities_boundary(mesh, mesh.topology.dim - 1, on_wall)
