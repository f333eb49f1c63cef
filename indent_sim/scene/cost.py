"""Cost of a run: cells, unknowns, memory and processor seconds, before anything is meshed.

Counts come from the integral of 1/size^dim over the modelled part. The constants below were fitted on this program
(`make bench` prints prediction beside measurement for every scene of configs/): one core of about 2020, OpenBLAS, forms
compiled before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from indent_sim.mesh.meshed import MeshedPart
from indent_sim.mesh.part import Part
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import UNIT_BALLS, Inclusion

CELLS = {2: 2.63, 3: 5.8}  # per size^dim
NODES = {2: 2.12, 3: 1.65}  # per cell
VERTICES = {2: 0.55, 3: 0.25}  # per cell
FACETS, ON_FACET = {2: 1.0, 3: 2.3}, 2.1  # facets per size^(dim - 1), nodes per facet
CANDIDATES = 3.0  # elements between the fine patch and the rim of the surface that is condensed

THEORY, PER_ROW = 0.5, 0.005  # s: of a run without a mesh, and of each of its rows
START = 1.05  # s: imports, gmsh, writing
COMPANIONS = 0.5  # of what a run costs beyond that: its two companions on coarser meshes, and another mesh now and then
PROCESS = 1.7e8  # bytes
MOST_CANDIDATES = 5000  # nodes that a body is condensed to: beyond it the dense matrices are gigabytes
DENSE = 64.0  # bytes per pair of candidates: of the dense matrices of a condensed body, eight at a time


@dataclass(frozen=True)
class Work:
    """What is done with the unknowns: solver, formulation, steps, whether contact is nonlinear beyond its edge, and
    whether there is friction, which has as many directions as the mesh."""

    method: str  # condensed | newton
    mixed: bool
    steps: int
    nonlinear: bool
    rough: bool = False

    @property
    def iterations(self) -> float:
        """Linear solves of the whole path: few a step on a fine path, more at the beginning."""
        return (4.0 if self.nonlinear else 1.5) * self.steps + 10.0


@dataclass(frozen=True)
class Cost:
    """Predicted size of a run: cells, dofs, memory [bytes], processor time of the whole process [s]."""

    cells: float
    dofs: float
    memory: float
    seconds: float

    @property
    def with_error_bars(self) -> Cost:
        """The same run together with its companions."""
        return replace(self, seconds=self.seconds + COMPANIONS * (self.seconds - START))


def cost(sizes: Sizes, part: Part, work: Work) -> Cost:
    """Predict what a scene will cost."""
    dim, cells = part.dim, _cells(sizes, part)
    dofs = cells * (NODES[dim] * dim + (VERTICES[dim] if work.mixed else 0.0))
    memory = PROCESS + (6e3 * dofs if dim == 2 else 900.0 * dofs**1.25)
    if work.method == "condensed":
        n = candidates(sizes, part) * (dim if work.rough else 1)
        memory += DENSE * n**2
        solve = _condensed(dim, n, dofs, work)
    else:
        solve = _newton(dim, dofs, work)
    return Cost(cells, dofs, float(memory), float(START + 3e-5 * cells + solve))


def _cells(sizes: Sizes, part: Part) -> float:
    if isinstance(part, MeshedPart):
        return float(len(part.piece.grid.cells) * 2 ** (part.dim * (sizes.refinements or 0)))
    dim, sectors, height = part.dim, _sectors(sizes, part), part.height
    reach = max(abs(end - sizes.axis[0]) for end in part.extent[0])
    r_max = reach if dim == 2 else float(np.sqrt(part.area * 4 / pi / sectors))
    r, wr = _log_grid(r_max, sizes.smallest)
    z, wz = _log_grid(height, sizes.smallest)
    density = 1 / sizes.at(r[:, None], z[None, :]) ** dim
    around = float((density * (_ring(r, dim, sectors) * wr)[:, None] * wz[None, :]).sum())
    return CELLS[dim] * (around + sum(_elements_of(*one, sizes, part) for one in sizes.inclusions))


def _elements_of(inclusion: Inclusion, inside: float, sizes: Sizes, part: Part) -> float:
    """Elements in an inclusion and in the shells around it, by size^dim, beyond those that would be there without it;
    a mirror image counts for its own part."""
    dim = part.dim
    spread = np.concatenate([[0.0], np.geomspace(inside / 4, part.longest, 200)])
    size = np.minimum(inside + sizes.grading * (spread[1:] + spread[:-1]) / 2, sizes.h_far)
    spans = inclusion.spans if dim == 3 else [((axis,), inclusion.half(axis)) for axis in (0, 2)]
    volume = np.prod([UNIT_BALLS[len(axes)] * (half + spread) ** len(axes) for axes, half in spans], axis=0)
    shares = part.copies * (2 if part.symmetry == "axisymmetric" else 1)
    *across, z = inclusion.center
    r = np.linalg.norm([c - axis for c, axis in zip(across, (*sizes.axis, 0.0), strict=False)])
    there = sizes.at(np.array(r), np.array(-z))
    beyond = [np.maximum(1 / h**dim - 1 / there**dim, 0.0) for h in (inside, size)]
    return float(volume[0] * beyond[0] + (np.diff(volume) * beyond[1]).sum()) / shares


def candidates(sizes: Sizes, part: Part) -> float:
    """How many nodes of the surface may come into contact: the order of a condensed body's dense matrices."""
    dim = part.dim
    r, wr = _log_grid(sizes.patch + CANDIDATES * sizes.h_contact, sizes.smallest)
    size = sizes.at(r, np.zeros_like(r)) ** (dim - 1)
    return ON_FACET * FACETS[dim] * float((_ring(r, dim, _sectors(sizes, part)) * wr / size).sum())


def _condensed(dim: int, n: float, dofs: float, work: Work) -> float:
    """One factorisation, one solve for each of n candidates on the surface, and small dense systems [s]."""
    body = 1e-5 * dofs if dim == 2 else 1.5e-5 * dofs + 1.5e-9 * dofs**2 + 2.5e-9 * n * dofs ** (4 / 3)
    return body + work.iterations * (3e-4 + 3e-11 * n**3)


def _newton(dim: int, dofs: float, work: Work) -> float:
    """Assembly and factorisation of the whole body at every iteration [s]."""
    return work.iterations * (7e-3 * (dofs / 1750) ** 1.6 if dim == 2 else 3.2e-9 * dofs**2)


def _ring(r: np.ndarray, dim: int, sectors: float) -> np.ndarray:
    """What a distance r from the tip's axis weighs: an arc, or both sides."""
    return pi / 2 * sectors * r if dim == 3 else np.full_like(r, sectors)


def _sectors(sizes: Sizes, part: Part) -> float:
    """Quarters of a full turn about the tip's axis that the modelled part contains; sides in two dimensions."""
    return float(np.prod([_sides(ends, c) for ends, c in zip(part.extent[:-1], sizes.axis, strict=False)]))


def _sides(ends: tuple[float, float], c: float) -> float:
    low, high = ends
    return 1.0 if min(abs(c - low), abs(high - c)) <= 1e-9 * (high - low) else 2.0


def _log_grid(length: float, smallest: float) -> tuple[np.ndarray, np.ndarray]:
    edges = np.concatenate([[0.0], np.geomspace(min(smallest, length) / 4, length, 200)])
    return (edges[1:] + edges[:-1]) / 2, np.diff(edges)
