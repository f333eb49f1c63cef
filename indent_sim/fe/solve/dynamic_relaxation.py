"""Dynamic relaxation: finds the stable state to which an adhesive body relaxes after a snap."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from indent_sim.fe.solve.newton import Newton
from indent_sim.fe.terms.contact.viscous_regularization import ViscousRegularization


def dynamic_relaxation(newton: Newton, regularization: ViscousRegularization) -> bool:
    """Let an adhesive body relax at the problem's depth, starting from its present state.

    The surface moves against a viscous drag, in implicit steps

        u_k+1 = argmin  Pi(u; delta) + drag/2 int |u - u_k|^2 dGamma   next to u_k .

    The energy decreases in each step, as it does after a snap, so that the steps lead to the stable
    state whose basin of attraction contains the initial state. The initial drag is above the
    curvature work/range^2 of the attraction, so that a step has a single minimum. The change of the
    displacement from one step to the next gives the curvature of the energy along the path, which
    is negative at first and positive near the stable state. The drag is omitted as soon as the body
    is stiffer than the drag.

    Returns
    -------
    bool
        True if a stable equilibrium was found; otherwise the state is restored.
    """
    problem = newton.problem
    law = newton.problem.law.adhesion
    assert law and law.range
    state_before = problem.trial_state()
    drag = 2.0 * law.work / law.range**2
    traction = 0.0
    # The drag of a step is at most this many times that of the step before.
    drag_increase = 3.0
    # Snaps took 15 to 40 steps.
    for _ in range(60):
        # A rough solution is sufficient for a step on the way to the stable state
        distance = _relaxation_step(newton, regularization, drag, 1e-4)
        if distance is None:
            drag = drag_increase * drag
            traction = 0.0
            continue
        unstable_curvature = drag - traction / distance if traction and distance else 0.0
        if (
            -unstable_curvature > drag
            and _relaxation_step(newton, regularization, 0.0, 0.0) is not None
        ):
            return True
        traction = drag * distance
        # The drag must exceed the negative curvature for a minimum to exist; the factor 3 allows
        # for the growth of this curvature in the next step.
        drag = min(max(0.5 * drag, 3.0 * unstable_curvature), drag_increase * drag)
    problem.set_trial_state(state_before)
    return False


def _relaxation_step(
    newton: Newton, regularization: ViscousRegularization, drag: float, rtol: float
) -> float | None:
    """Solve one relaxation step with the given drag; return its largest displacement [length].

    Returns None and restores the solution if no stable solution was found.
    """
    problem = newton.problem
    start = newton.problem.x.copy()
    regularization.set_drag(drag)
    # Steps of snaps took one to eight iterations.
    has_converged = newton.solve(rtol, 12) and newton.is_stable
    regularization.set_drag(0.0)
    if not has_converged:
        problem.body.set_solution(start)
        return None
    displacement_dofs = problem.unknowns.dofs("u")
    increment = (problem.x - start).array[
        displacement_dofs[displacement_dofs < problem.unknowns.owned_count]
    ]
    return float(problem.comm.allreduce(np.abs(increment).max(initial=0.0), op=MPI.MAX))
