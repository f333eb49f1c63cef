"""The contact algorithms: how each method finds the equilibrium at one depth.

A method is one function from a Newton solver to success; what they share is `Newton` and the potential of
`Problem`. Adding one is a function and an entry in ALGORITHMS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from indent_sim.fe.observe import measure
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import linear
from indent_sim.fe.solve.mixing import Mixing
from indent_sim.fe.solve.newton import ROUGHLY, Newton
from indent_sim.fe.terms.traction import Traction
from indent_sim.model.tips import deepest_inside
from indent_sim.scene.scene import Scene

INSIDE_OUT = 0.2  # of the contact radius; the singular edge of a punch has J < 0 in 0.003 of it, which no force feels
UZAWA_TOLERANCE = 1e-8  # last change of the multiplier at E*/h_contact, relative; the force is then good to 1e-7
FINE = 1e-11  # Newton's tolerance where small changes are to be seen: in Uzawa's loop, in the search for a force
NOISE = 1e-17  # relative residual per stiffness [thickness/E]: what round-off in the gaps makes of it
UZAWA_INNER = 1e-2  # of the multiplier's last change: how well the next solve within the loop must know the state
UZAWA_LOOPS = 500
UZAWA_PATIENCE = 60  # loops in which the change must have halved at least once


def settled(scene: Scene) -> float:
    """The last change of Uzawa's multiplier, relative: with a soft stiffness small changes do not mean a small gap."""
    stiffness = scene.contact.stiffness  # type: ignore[union-attr]
    return UZAWA_TOLERANCE * min(1.0, stiffness * scene.sizes.h_contact / scene.material.E_star)


def finest(problem: Problem) -> float:
    """The smallest relative residual that is not noise."""
    return max(FINE, NOISE * problem.stiffness_scale)


class Enforcement:
    """Finds the equilibrium at the problem's delta from its present state by the scene's contact method."""

    def __init__(self, problem: Problem, rtol: float, max_iterations: int, petsc: dict[str, Any]):
        self.problem = problem
        self.newton = Newton(problem, rtol, max_iterations, petsc)
        self._algorithm = ALGORITHMS[problem.law.multiplier](self.newton)
        self._petsc = petsc
        scene = problem.scene
        self._is_linear = scene.material.small_strain
        self._largest_inside_out = INSIDE_OUT * scene.prediction["a"] / scene.scales.length
        self._deepest = deepest_inside(scene.indenter)
        if problem.law.multiplier == "stress":  # other zeros of Nitsche's residual lie about an element deep in the tip
            self._deepest = min(self._deepest, scene.sizes.h_contact / 2)

    @property
    def iterations(self) -> int:
        """Linear solves so far."""
        return self.newton.iterations

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self.newton.failure

    @property
    def force_tolerance(self) -> float:
        """How well a force can be met, relative."""
        return 10 * finest(self.problem)

    def sharpen(self) -> None:
        """Converge as far as round-off lets, so that a force can be met to `force_tolerance`."""
        self.newton.rtol = min(self.newton.rtol, finest(self.problem))

    def solve(self) -> bool:
        """True when converged to a state that a body can have; else the problem's state is as it was."""
        before = self.problem.snapshot()
        if not self._algorithm():
            return False
        self.newton.failure = self._why_impossible()
        if self.newton.failure:
            self.problem.restore(before)
        return not self.newton.failure

    def _why_impossible(self) -> str:
        """Why a body cannot have the present state; "" when it can."""
        if not self.problem.is_admissible():
            return "Newton ends in a state with J <= 0, or beyond the law's limit"
        if self.problem.scene.gap == "reference":
            return ""
        if measure.penetration(self.problem) > self._deepest:
            return "Newton ends where the tip has passed through the surface"
        if self._is_linear and self.problem.inside_out() > self._largest_inside_out:
            return "the linear body turns inside out (J < 0), and only a hyperelastic one has a deformed surface then"
        return ""

    def refuse_unused_options(self) -> None:
        """ConfigError for a `solver.petsc` option that PETSc never asked for: a typing error, or no effect here."""
        linear.refuse_unused(self._petsc)


def enforcement(problem: Problem, **solver: Any) -> Enforcement:
    """The enforcement of a problem's contact method."""
    return Enforcement(problem, **solver)


def _simultaneous(newton: Newton) -> Callable[[], bool]:
    """Nitsche, active set: one semismooth Newton for everything."""
    return newton.solve


def _approaching(newton: Newton) -> Callable[[], bool]:
    """Penalty, augmented Lagrangian: one semismooth Newton, which comes to a stiff contact through softer ones.

    Or at once where those mislead.
    """

    def solve() -> bool:
        before = newton.problem.snapshot()
        if newton.approach() and newton.solve():
            return True
        newton.problem.restore(before)
        return newton.solve()

    return solve


def _uzawa(newton: Newton) -> Callable[[], bool]:
    """Newton with lam frozen, then lam <- projection of <lam - epsilon_n g>, until it stands still.

    On the way to its own stiffness lam is updated too, and a solve need not be finer than what the next update will
    change. The updates are mixed with earlier ones (`mixing`), which changes their number and not where they end:
    at the fixed point lam is the augmented Lagrangian's own, so both methods give the same answer.
    """
    contact = newton.problem.contact
    assert isinstance(contact, Traction)
    projection = contact.projection
    newton.rtol = min(newton.rtol, finest(newton.problem))

    def solve() -> bool:
        problem = newton.problem
        before = problem.snapshot()
        if not newton.approach(projection.update):
            problem.restore(before)
        smallest, since, mixing, rtol = float("inf"), 0, Mixing(problem.comm), ROUGHLY
        for _ in range(UZAWA_LOOPS):
            if not newton.solve(rtol):
                break
            change = projection.update(mixing)
            newton.failure = f"the multiplier does not settle, it still changes by {change:.1e} of itself"
            if change <= settled(problem.scene):
                return newton.solve()
            rtol = max(newton.rtol, min(ROUGHLY, UZAWA_INNER * change))
            smallest, since = (change, 0) if change < smallest / 2 else (smallest, since + 1)
            if since > UZAWA_PATIENCE:
                break
        problem.restore(before)
        return False

    return solve


ALGORITHMS: dict[str, Callable[[Newton], Callable[[], bool]]] = {
    "none": _approaching,
    "unknown": _approaching,
    "stress": _simultaneous,
    "frozen": _uzawa,
    "nodal": _simultaneous,
}
