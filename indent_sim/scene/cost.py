"""Predicted cost of a run before meshing: cells, unknowns, memory and processor time.

The constants were fitted to runs of this program on one core of a computer of about 2020, with
OpenBLAS and compiled forms. The import of numpy, scipy, matplotlib, gmsh, dolfinx and petsc4py
takes 0.8 s on it. docs/accuracy.md compares prediction and measurement for every scene of
configs/.
"""

from __future__ import annotations

from dataclasses import dataclass

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.measured_constants import (
    FRICTION_STEP_FACTOR,
    KRYLOV_BYTES,
    KRYLOV_ITERATIONS,
    KRYLOV_SECONDS,
    PROCESS_MEMORY,
    START_SECONDS,
    TIME_DEPENDENT_STEP_FACTOR,
    YIELD_SOLVES,
    YIELD_STEP_FACTOR,
)
from indent_sim.scene.mesh_counts import candidate_count, mesh_counts

# Largest number of nodes that may come into contact for which a body is condensed; with more nodes
# its dense matrices would need gigabytes.
MAX_CANDIDATES = 5000
# Memory of the dense matrices of a condensed body per pair of candidates [bytes]: eight matrices.
DENSE_BYTES = 64.0


@dataclass(frozen=True)
class SolverWork:
    """Properties of the solution on which the cost of the solver depends.

    Attributes
    ----------
    method : str
        "condensed" or "newton".
    linear : str
        "direct" or "iterative".
    is_mixed : bool
        True if the pressure is an independent unknown.
    steps : int
        Number of load increments.
    is_nonlinear : bool
        True if there is a nonlinearity other than the contact condition.
    has_friction : bool
        True with friction, which acts in as many directions as the mesh has.
    snaps : int
        Number of jumps into and out of adhesive contact.
    is_time_dependent : bool
        True if the body is time-dependent at finite strain.
    holding_steps : int
        Number of further steps of a linear body in which the tip is at rest.
    least_solves : float
        Smallest number of linear solves of the path, for any number of steps.
    yields : bool
        True if the body may yield.
    """

    method: str
    linear: str
    is_mixed: bool
    steps: int
    is_nonlinear: bool
    has_friction: bool = False
    snaps: int = 0
    is_time_dependent: bool = False
    holding_steps: int = 0
    least_solves: float = 0.0
    yields: bool = False

    @property
    def linear_solves(self) -> float:
        """Expected number of linear solves for the whole path.

        A fine path needs few solves per step, but more at its beginning.
        """
        # Number of linear solves of a snap into or out of adhesive contact. 25 to 150 were
        # observed, most at large Maugis parameters.
        snap_solves = 100.0
        solves_per_step = 4.0 if self.is_nonlinear else 1.5
        if self.yields:
            solves_per_step = YIELD_SOLVES
        solves = solves_per_step * self.steps + 10.0 + snap_solves * self.snaps
        return max(solves, self.least_solves)

    def step_time_factor(self, dim: int) -> float:
        """Return the factor by which friction, time dependence and yield slow down a solve."""
        friction_factor = FRICTION_STEP_FACTOR[dim] if self.has_friction else 1.0
        yield_factor = YIELD_STEP_FACTOR if self.yields else 1.0
        time_factor = TIME_DEPENDENT_STEP_FACTOR if self.is_time_dependent else 1.0
        return friction_factor * time_factor * yield_factor


@dataclass(frozen=True)
class Cost:
    """Predicted cost of a run: cells, unknowns, memory [bytes] and processor time [s]."""

    cells: float
    dofs: float
    memory: float
    seconds: float


def predict_cost(sizes: Sizes, domain: ModelDomain, work: SolverWork) -> Cost:
    """Predict the cost of meshing and solving a scene."""
    dim = domain.dim
    count = mesh_counts(sizes, domain)
    dofs = count["nodes"] * dim + (count["vertices"] if work.is_mixed else 0.0)
    memory, solve = _memory_and_seconds(sizes, domain, work, dofs)
    return Cost(
        count["cells"],
        dofs,
        float(PROCESS_MEMORY + memory),
        float(START_SECONDS + 3e-5 * count["cells"] + solve),
    )


def add_tip_cost(body: Cost, tip: Cost) -> Cost:
    """Return the cost of a body and a soft tip on the same mesh, from the costs of both alone."""
    return Cost(
        body.cells + tip.cells,
        body.dofs + tip.dofs,
        body.memory + tip.memory - PROCESS_MEMORY,
        body.seconds + tip.seconds - START_SECONDS,
    )


def _memory_and_seconds(
    sizes: Sizes, domain: ModelDomain, work: SolverWork, dofs: float
) -> tuple[float, float]:
    """Return memory [bytes] and processor time [s] of the solution, for a number of unknowns."""
    if work.linear == "iterative":
        return _iterative_cost(work, dofs)
    if work.method == "newton":
        return _newton_cost(domain.dim, work, dofs)
    return _condensed_cost(sizes, domain, work, dofs)


def _iterative_cost(work: SolverWork, dofs: float) -> tuple[float, float]:
    """Return memory [bytes] and time [s] of all Newton iterations with a Krylov solver."""
    # The contact edge crosses more elements per step on a finer mesh.
    newton = 4.0 * (work.steps + 1) * max(1.0, dofs / 2e4) ** 0.13
    seconds_per_dof = (8e-6 if work.is_nonlinear else 8e-7) + KRYLOV_ITERATIONS * KRYLOV_SECONDS
    return KRYLOV_BYTES * dofs, dofs * (3e-5 + newton * seconds_per_dof)


def _newton_cost(dim: int, work: SolverWork, dofs: float) -> tuple[float, float]:
    """Return memory [bytes] and time [s] of all Newton iterations, each with a factorisation."""
    # Number of linear solves of a step in which the tip is at rest.
    hold_solves = 1.2
    # While the tip is at rest no points come into contact, and most steps reuse the last
    # factorisation.
    holding_seconds = hold_solves * work.holding_steps * 3.5e-3 * (dofs / 1750) ** 1.2
    if dim == 2:
        memory = 6e3 * dofs
        seconds_per_solve = 1.5e-3 + 6e-3 * (dofs / 1750) ** 1.5
    else:
        memory = 1100.0 * dofs**1.25
        seconds_per_solve = 2.5e-5 * dofs + 1e-9 * dofs**2
    solve_seconds = work.linear_solves * seconds_per_solve * work.step_time_factor(dim)
    return memory, solve_seconds + holding_seconds


def _condensed_cost(
    sizes: Sizes, domain: ModelDomain, work: SolverWork, dofs: float
) -> tuple[float, float]:
    """Return memory [bytes] and time [s] of one factorisation and of all linear systems.

    The linear systems are those of the whole body and the dense ones of the candidate nodes.
    """
    dim = domain.dim
    # Candidate nodes times displacement components per node.
    n = candidate_count(sizes, domain) * (dim if work.has_friction else 1)
    if dim == 2:
        memory = 6e3 * dofs + DENSE_BYTES * n**2
        body_seconds = 1e-5 * dofs
    else:
        memory = 780.0 * dofs**1.25
        body_seconds = 4e-5 * dofs + 4.6e-10 * dofs**2 + 4.5e-3 * n * (dofs / 83e3) ** 1.55
    # The directions of friction are coupled in the dense systems only where the tip touches.
    n_contact = n / 2 if work.has_friction else n
    return memory, body_seconds + work.linear_solves * (3e-4 + 3e-11 * n_contact**3)
