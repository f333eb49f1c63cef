"""Cost of a run: cells, unknowns, memory and processor seconds, before anything is meshed.

Counts come from the integrals of 1/size^dim over the modelled part and, in three dimensions, of
1/size^2 over its surface. The constants below were fitted on this program (docs/accuracy.md has
prediction beside measurement for every scene of configs/): one core of about 2020, on which numpy,
scipy, matplotlib, gmsh, dolfinx and petsc4py load in 0.8 s, OpenBLAS, forms compiled before.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from indent_sim.mesh.modelled_part import Part
from indent_sim.mesh.part_from_file import MeshedPart
from indent_sim.mesh.sizes import Film, Sizes
from indent_sim.model.body import Inclusion, Shell

PLANE = {"cells": 2.63, "nodes": 5.58, "vertices": 1.45}  # per size^2
# Per size^3 of the volume, and per size^2 of its surface, where gmsh's elements are as small but
# lie on one side only: within 5 % on 23 boxes, quarters and cylinders of 1 000 to 63 000 cells,
# graded and not
SOLID = {"cells": (4.16, 1.94), "nodes": (5.15, 5.90), "vertices": (0.56, 1.22)}
# facets per size^(dim - 1), nodes per facet
FACETS = {2: 1.0, 3: 2.3}
ON_FACET = 2.1
CONDENSED_RIM = 3.0  # elements between the fine patch and the rim of the surface that is condensed

# s: of a run without a mesh, of each of its rows, and of a row under a tip with breaks, whose
# contact is sought
THEORY_SECONDS = 0.5
PER_ROW = 4e-4
PER_SOUGHT_ROW = 0.03
START_SECONDS = 1.05  # s: imports, gmsh, writing
EACH = (
    0.07  # s: of every further scene of a run, or run of a study, whose process has its libraries
)
EACH_BY_THEORY = 0.003  # s: likewise of one without a mesh
PROCESS = 1.7e8  # bytes
MOST_CANDIDATES = (
    5000  # nodes that a body is condensed to: beyond it the dense matrices are gigabytes
)
INTEGRAL_POINTS = 50  # of an integral over a body, in each direction
# iterations of a linear system, and the time of one per unknown
KRYLOV = 10.0
KRYLOV_SECONDS = 3e-7
KRYLOV_BYTES = 3.3e3  # per unknown of an iterative solver
FRICTION_STEP_TIME = {
    2: 2.2,
    3: 1.0,
}  # by dim: times as long a step of Newton's method takes with friction
EVOLVING_STEP_TIME = (
    1.6  # likewise at finite strain in a body that evolves: 1.3 to 1.9 on three shipped scenes
)
HOLD_SOLVES = 1.2  # linear solves of a step in which the tip stands still
# linear solves where an attracted body touches or lets go: 25 to 150, most at large Maugis numbers
SNAP = 100.0
DENSE = (
    64.0  # bytes per pair of candidates: of the dense matrices of a condensed body, eight at a time
)


@dataclass(frozen=True)
class Work:
    """What is done with the unknowns: solver, formulation, steps, whether contact is nonlinear
    beyond its edge, and whether there is friction, which has as many directions as the mesh; how
    often an attracted body touches or lets go, whether it evolves at finite strain, and the
    further steps of a linear body under a tip that stands still.
    """

    method: str  # condensed | newton
    linear: str  # direct | iterative
    mixed: bool
    steps: int
    nonlinear: bool
    rough: bool = False
    snaps: int = 0
    evolves: bool = False
    still: int = 0

    @property
    def iterations(self) -> float:
        """Linear solves of the whole path: few a step on a fine path, more at the beginning."""
        return (4.0 if self.nonlinear else 1.5) * self.steps + 10.0 + SNAP * self.snaps

    def slower(self, dim: int) -> float:
        """Times as long as of a smooth body that each of them takes."""
        return (FRICTION_STEP_TIME[dim] if self.rough else 1.0) * (
            EVOLVING_STEP_TIME if self.evolves else 1.0
        )


@dataclass(frozen=True)
class Cost:
    """Predicted size of a run: cells, dofs, memory [bytes], processor time of the whole process
    [s].
    """

    cells: float
    dofs: float
    memory: float
    seconds: float


def cost(sizes: Sizes, part: Part, work: Work) -> Cost:
    """Predict what a scene will cost."""
    dim = part.dim
    count = _counts(sizes, part)
    dofs = count["nodes"] * dim + (count["vertices"] if work.mixed else 0.0)
    memory, solve = _needs(sizes, part, work, dofs)
    return Cost(
        count["cells"],
        dofs,
        float(PROCESS + memory),
        float(START_SECONDS + 3e-5 * count["cells"] + solve),
    )


def _needs(sizes: Sizes, part: Part, work: Work, dofs: float) -> tuple[float, float]:
    """Memory [bytes] and processor time [s] of the solution."""
    dim = part.dim
    if (
        work.linear == "iterative"
    ):  # assembly and Krylov iterations at every iteration of Newton's method
        newton = (
            4.0 * (work.steps + 1) * max(1.0, dofs / 2e4) ** 0.13
        )  # the edge crosses more elements a step
        each = (8e-6 if work.nonlinear else 8e-7) + KRYLOV * KRYLOV_SECONDS
        return KRYLOV_BYTES * dofs, dofs * (3e-5 + newton * each)
    if work.method == "newton":  # assembly and factorisation at every iteration
        one = 1.5e-3 + 6e-3 * (dofs / 1750) ** 1.5 if dim == 2 else 2.5e-5 * dofs + 1e-9 * dofs**2
        # no new contact: the last factor will do for most
        held = HOLD_SOLVES * work.still * 3.5e-3 * (dofs / 1750) ** 1.2
        return (
            6e3 * dofs if dim == 2 else 1100.0 * dofs**1.25
        ), work.iterations * one * work.slower(dim) + held
    # one factorisation, one solve for each of n candidates on the surface, and small dense systems
    n = candidates(sizes, part) * (dim if work.rough else 1)
    body = (
        1e-5 * dofs
        if dim == 2
        else 4e-5 * dofs + 4.6e-10 * dofs**2 + 4.5e-3 * n * (dofs / 83e3) ** 1.55
    )
    in_contact = (
        n / 2 if work.rough else n
    )  # its directions are dense together only where it touches
    memory = 6e3 * dofs + DENSE * n**2 if dim == 2 else 780.0 * dofs**1.25
    return memory, body + work.iterations * (3e-4 + 3e-11 * in_contact**3)


def _counts(sizes: Sizes, part: Part) -> dict[str, float]:
    """Cells, nodes of quadratic elements, and vertices of the mesh."""
    if isinstance(part, MeshedPart):
        size = part.piece.size
        fold = 2 ** (part.dim * (sizes.refinements or 0))
        nodes = (
            2 * size.points + size.cells + (0 if part.dim == 2 else size.outside / 2)
        )  # by Euler, holes left out
        return {"cells": size.cells * fold, "nodes": nodes * fold, "vertices": size.points * fold}
    within = sum(_elements_of(*one, sizes, part) for one in sizes.inclusions)
    within += sum(_elements_in(*one, sizes, part) for one in sizes.skins)
    within += sum(_elements_at(film, sizes, part) for film in sizes.films)
    if part.dim == 2:
        area = _inverse_area(sizes, part) + within
        return {name: factor * area for name, factor in PLANE.items()}
    volume, surface = _inverse_sizes(sizes, part)
    return {
        name: inside * (volume + within) + outside * surface
        for name, (inside, outside) in SOLID.items()
    }


def _inverse_area(sizes: Sizes, part: Part) -> float:
    """The integral of 1/size^2 over a section."""
    r, wr = _log_grid(max(abs(end - sizes.axis[0]) for end in part.extent[0]), sizes.smallest)
    z, wz = _log_grid(part.height, sizes.smallest)
    density = 1 / sizes.at(r[:, None], z[None, :]) ** 2
    return float((density * (_ring(r, 2, _sectors(sizes, part)) * wr)[:, None] * wz[None, :]).sum())


def _inverse_sizes(sizes: Sizes, part: Part) -> tuple[float, float]:
    """The integrals of 1/size^3 over a body, and of 1/size^2 over its surface and the interfaces of
    its layers.
    """
    (x, wx), (y, wy) = (
        _both_ways(*ends, c, sizes) for ends, c in zip(part.extent[:-1], sizes.axis, strict=True)
    )
    depth, wz = _log_grid(part.height, sizes.smallest, INTEGRAL_POINTS)
    is_inside = np.all([side.inwards(x[:, None], y[None, :]) >= 0 for side in part.outline], axis=0)
    weight = wx[:, None] * wy[None, :] * is_inside
    r = np.hypot(x[:, None] - sizes.axis[0], y[None, :] - sizes.axis[1])
    volume = sum(
        w * (weight / sizes.at(r, np.array(z)) ** 3).sum() for z, w in zip(depth, wz, strict=True)
    )
    levels = [0.0, part.height, *(-z for z in part.interfaces)]
    surface = sum((weight / sizes.at(r, np.array(z)) ** 2).sum() for z in levels)
    for side in part.outline:
        at, length = side.points(INTEGRAL_POINTS)
        distance = np.hypot(at[:, 0] - sizes.axis[0], at[:, 1] - sizes.axis[1])
        surface += (length * wz[None, :] / sizes.at(distance[:, None], depth[None, :]) ** 2).sum()
    return float(volume), float(surface)


def _both_ways(low: float, high: float, c: float, sizes: Sizes) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights from the tip's axis both ways to the ends."""
    ways = [
        (sign, abs(end - c))
        for sign, end in ((-1, low), (1, high))
        if abs(end - c) > 1e-9 * (high - low)
    ]
    grids = [(sign, *_log_grid(length, sizes.smallest, INTEGRAL_POINTS)) for sign, length in ways]
    return np.concatenate([c + sign * x for sign, x, _ in grids]), np.concatenate(
        [w for _, _, w in grids]
    )


def _elements_of(inclusion: Inclusion, inside: float, sizes: Sizes, part: Part) -> float:
    """Elements in and around an inclusion beyond those without it; a mirror image counts for its
    own part.
    """
    dim = part.dim
    spread = np.concatenate([[0.0], np.geomspace(inside / 4, part.longest, 200)])
    size = np.minimum(inside + sizes.grading * (spread[1:] + spread[:-1]) / 2, sizes.h_far)
    volume = inclusion.swollen(spread, dim)
    shares = part.copies * (2 if part.symmetry == "axisymmetric" else 1)
    *across, z = inclusion.center
    r = np.linalg.norm([c - axis for c, axis in zip(across, (*sizes.axis, 0.0), strict=False)])
    there = sizes.at(np.array(r), np.array(-z))
    beyond = [np.maximum(1 / h**dim - 1 / there**dim, 0.0) for h in (inside, size)]
    return float(volume[0] * beyond[0] + (np.diff(volume) * beyond[1]).sum()) / shares


def _elements_in(skin: Shell, inside: float, sizes: Sizes, part: Part) -> float:
    """Elements in and around a skin beyond those without it, of the section of a cap or ball."""
    spread = np.concatenate([[0.0], np.geomspace(inside / 4, skin.outer, 200)])
    size = np.minimum(inside + sizes.grading * (spread[1:] + spread[:-1]) / 2, sizes.h_far)
    inwards = np.diff(np.maximum(skin.inner - spread, 0.0) ** 2) / -2
    angle = np.arccos(1 - part.height / skin.outer) if part.height < 2 * skin.outer else pi
    areas = np.concatenate([[(skin.outer**2 - skin.inner**2) / 2], inwards]) * angle
    beyond = 1 / np.concatenate([[inside], size]) ** 2 - 1 / sizes.h_far**2
    return float((areas * np.maximum(beyond, 0.0)).sum())


def _elements_at(film: Film, sizes: Sizes, part: Part) -> float:
    """Elements at a drained face of a section beyond those without a film there.

    The integral of 1/(h + grading d)^2 - 1/there^2 over the distance d from the face, as far as it
    is above 0, and over the length s along it from where it is nearest to the tip.
    """
    (x0, z0) = film.side.start
    (x1, z1) = film.side.end
    is_level = film.side.middle is not None or z0 == z1
    length = max(abs(x - sizes.axis[0]) for x in (x0, x1)) if is_level else abs(z1 - z0)
    s, ds = _log_grid(length, film.h)
    depth = 0.0 if film.side.surface == "top" else part.height
    r, z = (
        (s, np.full_like(s, depth)) if is_level else (np.full_like(s, abs(x0 - sizes.axis[0])), s)
    )
    there = sizes.at(r, z)
    growth = sizes.grading
    h = np.minimum(film.h + growth * np.maximum(np.hypot(r, z) - film.reach, 0.0), there)
    across = (1 / h - 1 / there) / growth - (there - h) / (growth * there**2)
    return float((_sectors(sizes, part) if is_level else 1.0) * (across * ds).sum())


def candidates(sizes: Sizes, part: Part) -> float:
    """How many nodes of the surface may come into contact: the order of a condensed body's dense
    matrices.
    """
    dim = part.dim
    r, wr = _log_grid(sizes.patch + CONDENSED_RIM * sizes.h_contact, sizes.smallest)
    size = sizes.at(r, np.zeros_like(r)) ** (dim - 1)
    return ON_FACET * FACETS[dim] * float((_ring(r, dim, _sectors(sizes, part)) * wr / size).sum())


def _ring(r: np.ndarray, dim: int, sectors: float) -> np.ndarray:
    """What a distance r from the tip's axis weighs: an arc, or both sides."""
    return pi / 2 * sectors * r if dim == 3 else np.full_like(r, sectors)


def _sectors(sizes: Sizes, part: Part) -> float:
    """Quarters of a full turn about the tip's axis that the modelled part contains; sides in two
    dimensions.
    """
    on_axes = zip(part.extent[:-1], sizes.axis, strict=False)
    at_end = [min(abs(c - low), abs(high - c)) <= 1e-9 * (high - low) for (low, high), c in on_axes]
    return 2.0 ** at_end.count(False)


def _log_grid(length: float, smallest: float, points: int = 200) -> tuple[np.ndarray, np.ndarray]:
    edges = np.concatenate([[0.0], np.geomspace(min(smallest, length) / 4, length, points)])
    return (edges[1:] + edges[:-1]) / 2, np.diff(edges)
