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

from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import DrainedFace, Sizes
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.layers import Coating

COUNTS_2D = {"cells": 2.63, "nodes": 5.58, "vertices": 1.45}  # per size^2
# Per size^3 of the volume, and per size^2 of its surface, where gmsh's elements are as small but
# lie on one side only: within 5 % on 23 boxes, quarters and cylinders of 1 000 to 63 000 cells,
# graded and not
COUNTS_3D = {"cells": (4.16, 1.94), "nodes": (5.15, 5.90), "vertices": (0.56, 1.22)}
# facets per size^(dim - 1), nodes per facet
FACETS_PER_AREA = {2: 1.0, 3: 2.3}
NODES_PER_FACET = 2.1
CONDENSED_MARGIN = (
    3.0  # elements between the fine patch and the rim of the surface that is condensed
)

# s: of a run without a mesh, of each of its rows, and of a row under a tip with breaks, whose
# contact is sought
THEORY_SECONDS = 0.5
SECONDS_PER_ROW = 4e-4
SECONDS_PER_SEARCHED_ROW = 0.03
START_SECONDS = 1.05  # s: imports, gmsh, writing
SECONDS_PER_RUN = (
    0.07  # s: of every further scene of a run, or run of a study, whose process has its libraries
)
SECONDS_PER_THEORY_RUN = 0.003  # s: likewise of one without a mesh
PROCESS_MEMORY = 1.7e8  # bytes
MAX_CANDIDATES = (
    5000  # nodes that a body is condensed to: beyond it the dense matrices are gigabytes
)
INTEGRAL_POINTS = 50  # of an integral over a body, in each direction
# iterations of a linear system, and the time of one per unknown
KRYLOV_ITERATIONS = 10.0
KRYLOV_SECONDS = 3e-7
KRYLOV_BYTES = 3.3e3  # per unknown of an iterative solver
FRICTION_STEP_FACTOR = {
    2: 2.2,
    3: 1.0,
}  # by dim: times as long a step of Newton's method takes with friction
TIME_DEPENDENT_STEP_FACTOR = (
    1.6  # likewise at finite strain in a body that evolves: 1.3 to 1.9 on three shipped scenes
)
HOLD_SOLVES = 1.2  # linear solves of a step in which the tip stands still
# linear solves where an attracted body touches or lets go: 25 to 150, most at large Maugis numbers
SNAP_SOLVES = 100.0
DENSE_BYTES = (
    64.0  # bytes per pair of candidates: of the dense matrices of a condensed body, eight at a time
)


@dataclass(frozen=True)
class SolverWork:
    """What is done with the unknowns: solver, formulation, steps, whether contact is nonlinear
    beyond its edge, and whether there is friction, which has as many directions as the mesh; how
    often an attracted body touches or lets go, whether it evolves at finite strain, and the
    further steps of a linear body under a tip that stands still.
    """

    method: str  # condensed | newton
    linear: str  # direct | iterative
    is_mixed: bool
    steps: int
    is_nonlinear: bool
    has_friction: bool = False
    snaps: int = 0
    is_time_dependent: bool = False
    holding_steps: int = 0

    @property
    def linear_solves(self) -> float:
        """Linear solves of the whole path: few a step on a fine path, more at the beginning."""
        return (4.0 if self.is_nonlinear else 1.5) * self.steps + 10.0 + SNAP_SOLVES * self.snaps

    def step_time_factor(self, dim: int) -> float:
        """Times as long as of a smooth body that each of them takes."""
        return (FRICTION_STEP_FACTOR[dim] if self.has_friction else 1.0) * (
            TIME_DEPENDENT_STEP_FACTOR if self.is_time_dependent else 1.0
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


def predict_cost(sizes: Sizes, domain: ModelDomain, work: SolverWork) -> Cost:
    """Predict what a scene will cost."""
    dim = domain.dim
    count = _mesh_counts(sizes, domain)
    dofs = count["nodes"] * dim + (count["vertices"] if work.is_mixed else 0.0)
    memory, solve = _memory_and_seconds(sizes, domain, work, dofs)
    return Cost(
        count["cells"],
        dofs,
        float(PROCESS_MEMORY + memory),
        float(START_SECONDS + 3e-5 * count["cells"] + solve),
    )


def _memory_and_seconds(
    sizes: Sizes, domain: ModelDomain, work: SolverWork, dofs: float
) -> tuple[float, float]:
    """Memory [bytes] and processor time [s] of the solution."""
    dim = domain.dim
    if (
        work.linear == "iterative"
    ):  # assembly and Krylov iterations at every iteration of Newton's method
        newton = (
            4.0 * (work.steps + 1) * max(1.0, dofs / 2e4) ** 0.13
        )  # the edge crosses more elements a step
        seconds_per_dof = (8e-6 if work.is_nonlinear else 8e-7) + KRYLOV_ITERATIONS * KRYLOV_SECONDS
        return KRYLOV_BYTES * dofs, dofs * (3e-5 + newton * seconds_per_dof)
    if work.method == "newton":  # assembly and factorisation at every iteration
        seconds_per_solve = (
            1.5e-3 + 6e-3 * (dofs / 1750) ** 1.5 if dim == 2 else 2.5e-5 * dofs + 1e-9 * dofs**2
        )
        # no new contact: the last factor will do for most
        holding_seconds = HOLD_SOLVES * work.holding_steps * 3.5e-3 * (dofs / 1750) ** 1.2
        return (
            6e3 * dofs if dim == 2 else 1100.0 * dofs**1.25
        ), work.linear_solves * seconds_per_solve * work.step_time_factor(dim) + holding_seconds
    # one factorisation, one solve for each of n candidates on the surface, and small dense systems
    n = candidate_count(sizes, domain) * (dim if work.has_friction else 1)
    body_seconds = (
        1e-5 * dofs
        if dim == 2
        else 4e-5 * dofs + 4.6e-10 * dofs**2 + 4.5e-3 * n * (dofs / 83e3) ** 1.55
    )
    in_contact = (
        n / 2 if work.has_friction else n
    )  # its directions are dense together only where it touches
    memory = 6e3 * dofs + DENSE_BYTES * n**2 if dim == 2 else 780.0 * dofs**1.25
    return memory, body_seconds + work.linear_solves * (3e-4 + 3e-11 * in_contact**3)


def _mesh_counts(sizes: Sizes, domain: ModelDomain) -> dict[str, float]:
    """Cells, nodes of quadratic elements, and vertices of the mesh."""
    if isinstance(domain, ImportedDomain):
        mesh_size = domain.mesh.statistics
        refinement_factor = 2 ** (domain.dim * (sizes.refinements or 0))
        nodes = (
            2 * mesh_size.points
            + mesh_size.cells
            + (0 if domain.dim == 2 else mesh_size.boundary_facets / 2)
        )  # by Euler, holes left out
        return {
            "cells": mesh_size.cells * refinement_factor,
            "nodes": nodes * refinement_factor,
            "vertices": mesh_size.points * refinement_factor,
        }
    extra_elements = sum(
        _inclusion_elements(*feature, sizes, domain) for feature in sizes.inclusions
    )
    extra_elements += sum(_coating_elements(*feature, sizes, domain) for feature in sizes.coatings)
    extra_elements += sum(_film_elements(film, sizes, domain) for film in sizes.drained_faces)
    if domain.dim == 2:
        area = _inverse_square_integral(sizes, domain) + extra_elements
        return {name: factor * area for name, factor in COUNTS_2D.items()}
    volume, surface = _inverse_size_integrals(sizes, domain)
    return {
        name: inside * (volume + extra_elements) + outside * surface
        for name, (inside, outside) in COUNTS_3D.items()
    }


def _inverse_square_integral(sizes: Sizes, domain: ModelDomain) -> float:
    """The integral of 1/size^2 over a section."""
    r, wr = _log_grid(max(abs(end - sizes.axis[0]) for end in domain.extent[0]), sizes.axis_size)
    z, wz = _log_grid(domain.height, sizes.axis_size)
    density = 1 / sizes.size_at(r[:, None], z[None, :]) ** 2
    return float(
        (
            density * (_ring_weight(r, 2, _sector_count(sizes, domain)) * wr)[:, None] * wz[None, :]
        ).sum()
    )


def _inverse_size_integrals(sizes: Sizes, domain: ModelDomain) -> tuple[float, float]:
    """The integrals of 1/size^3 over a body, and of 1/size^2 over its surface and the interfaces of
    its layers.
    """
    (x, wx), (y, wy) = (
        _two_sided_grid(*ends, c, sizes)
        for ends, c in zip(domain.extent[:-1], sizes.axis, strict=True)
    )
    depth, wz = _log_grid(domain.height, sizes.axis_size, INTEGRAL_POINTS)
    is_inside = np.all(
        [side.inward_distance(x[:, None], y[None, :]) >= 0 for side in domain.outline], axis=0
    )
    weight = wx[:, None] * wy[None, :] * is_inside
    r = np.hypot(x[:, None] - sizes.axis[0], y[None, :] - sizes.axis[1])
    volume = sum(
        w * (weight / sizes.size_at(r, np.array(z)) ** 3).sum()
        for z, w in zip(depth, wz, strict=True)
    )
    levels = [0.0, domain.height, *(-z for z in domain.interfaces)]
    surface = sum((weight / sizes.size_at(r, np.array(z)) ** 2).sum() for z in levels)
    for side in domain.outline:
        side_points, length = side.sample_points(INTEGRAL_POINTS)
        distance = np.hypot(side_points[:, 0] - sizes.axis[0], side_points[:, 1] - sizes.axis[1])
        surface += (
            length * wz[None, :] / sizes.size_at(distance[:, None], depth[None, :]) ** 2
        ).sum()
    return float(volume), float(surface)


def _two_sided_grid(
    low: float, high: float, c: float, sizes: Sizes
) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights from the tip's axis both ways to the ends."""
    directions = [
        (sign, abs(end - c))
        for sign, end in ((-1, low), (1, high))
        if abs(end - c) > 1e-9 * (high - low)
    ]
    grids = [
        (sign, *_log_grid(length, sizes.axis_size, INTEGRAL_POINTS)) for sign, length in directions
    ]
    return np.concatenate([c + sign * x for sign, x, _ in grids]), np.concatenate(
        [w for _, _, w in grids]
    )


def _inclusion_elements(
    inclusion: Inclusion, h_inside: float, sizes: Sizes, domain: ModelDomain
) -> float:
    """Elements in and around an inclusion beyond those without it; a mirror image counts for its
    own part.
    """
    dim = domain.dim
    distances = np.concatenate([[0.0], np.geomspace(h_inside / 4, domain.max_extent, 200)])
    h_around = np.minimum(
        h_inside + sizes.grading * (distances[1:] + distances[:-1]) / 2, sizes.h_far
    )
    volume = inclusion.measure_within_distance(distances, dim)
    domains_sharing = domain.symmetry_factor * (2 if domain.symmetry == "axisymmetric" else 1)
    *horizontal, z = inclusion.center
    r = np.linalg.norm([c - axis for c, axis in zip(horizontal, (*sizes.axis, 0.0), strict=False)])
    h_without = sizes.size_at(np.array(r), np.array(-z))
    extra_densities = [
        np.maximum(1 / h**dim - 1 / h_without**dim, 0.0) for h in (h_inside, h_around)
    ]
    return (
        float(volume[0] * extra_densities[0] + (np.diff(volume) * extra_densities[1]).sum())
        / domains_sharing
    )


def _coating_elements(
    coating: Coating, h_inside: float, sizes: Sizes, domain: ModelDomain
) -> float:
    """Elements in and around a skin beyond those without it, of the section of a cap or ball."""
    distances = np.concatenate([[0.0], np.geomspace(h_inside / 4, coating.outer_radius, 200)])
    h_around = np.minimum(
        h_inside + sizes.grading * (distances[1:] + distances[:-1]) / 2, sizes.h_far
    )
    inwards = np.diff(np.maximum(coating.inner_radius - distances, 0.0) ** 2) / -2
    angle = (
        np.arccos(1 - domain.height / coating.outer_radius)
        if domain.height < 2 * coating.outer_radius
        else pi
    )
    areas = (
        np.concatenate([[(coating.outer_radius**2 - coating.inner_radius**2) / 2], inwards]) * angle
    )
    extra_densities = 1 / np.concatenate([[h_inside], h_around]) ** 2 - 1 / sizes.h_far**2
    return float((areas * np.maximum(extra_densities, 0.0)).sum())


def _film_elements(film: DrainedFace, sizes: Sizes, domain: ModelDomain) -> float:
    """Elements at a drained face of a section beyond those without a film there.

    The integral of 1/(h + grading d)^2 - 1/there^2 over the distance d from the face, as far as it
    is above 0, and over the length s along it from where it is nearest to the tip.
    """
    (x0, z0) = film.side.start
    (x1, z1) = film.side.end
    is_level = film.side.center is not None or z0 == z1
    length = max(abs(x - sizes.axis[0]) for x in (x0, x1)) if is_level else abs(z1 - z0)
    s, ds = _log_grid(length, film.h)
    depth = 0.0 if film.side.surface == "top" else domain.height
    r, z = (
        (s, np.full_like(s, depth)) if is_level else (np.full_like(s, abs(x0 - sizes.axis[0])), s)
    )
    h_without = sizes.size_at(r, z)
    growth = sizes.grading
    h = np.minimum(film.h + growth * np.maximum(np.hypot(r, z) - film.fine_radius, 0.0), h_without)
    elements_across = (1 / h - 1 / h_without) / growth - (h_without - h) / (growth * h_without**2)
    return float((_sector_count(sizes, domain) if is_level else 1.0) * (elements_across * ds).sum())


def candidate_count(sizes: Sizes, domain: ModelDomain) -> float:
    """How many nodes of the surface may come into contact: the order of a condensed body's dense
    matrices.
    """
    dim = domain.dim
    r, wr = _log_grid(sizes.fine_radius + CONDENSED_MARGIN * sizes.h_contact, sizes.axis_size)
    size = sizes.size_at(r, np.zeros_like(r)) ** (dim - 1)
    return (
        NODES_PER_FACET
        * FACETS_PER_AREA[dim]
        * float((_ring_weight(r, dim, _sector_count(sizes, domain)) * wr / size).sum())
    )


def _ring_weight(r: np.ndarray, dim: int, sectors: float) -> np.ndarray:
    """What a distance r from the tip's axis weighs: an arc, or both sides."""
    return pi / 2 * sectors * r if dim == 3 else np.full_like(r, sectors)


def _sector_count(sizes: Sizes, domain: ModelDomain) -> float:
    """Quarters of a full turn about the tip's axis that the modelled part contains; sides in two
    dimensions.
    """
    on_axes = zip(domain.extent[:-1], sizes.axis, strict=False)
    at_end = [min(abs(c - low), abs(high - c)) <= 1e-9 * (high - low) for (low, high), c in on_axes]
    return 2.0 ** at_end.count(False)


def _log_grid(length: float, smallest: float, points: int = 200) -> tuple[np.ndarray, np.ndarray]:
    edges = np.concatenate([[0.0], np.geomspace(min(smallest, length) / 4, length, points)])
    return (edges[1:] + edges[:-1]) / 2, np.diff(edges)
