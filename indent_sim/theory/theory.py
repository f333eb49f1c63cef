"""Theory: the contact of a body under a tip at any depth, worked out once, and the usual formulas
beside it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from math import ceil, inf
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.theory.compression import Compression
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import ForceCurve, depth_of_force
from indent_sim.theory.solution import SOLUTION_ERRORS, Solution

if TYPE_CHECKING:
    from indent_sim.theory.adhesion import Jkr

MAX_KEPT_SOLUTIONS = 100  # solutions that a theory remembers
THEORY_ERROR = 1e-8  # of theory's numbers, stated: ten times what was measured
TENSION_CHECK_DEPTHS = (
    10  # depths of a path at which it is asked whether theory's tip would have to pull
)


@dataclass(frozen=True)
class Theory:
    """Theory of a body under a tip on its axis, at small strain but where it `is_finite`; `exact`
    when the body is the theory's own.

    `why` says what the finite body has that the theory has not. `error`: of its numbers, relative.
    `pull`: the share of the force that the tip would have to pull with, where that alone keeps it
    from being exact. `formulas`: force [pressure length^2] at a depth [length] by the usual
    formulas for such a body. A depth is worked out once and remembered.
    """

    name: str
    is_exact: bool
    reason: str
    contact: ContactCurve | Compression = field(repr=False)
    error: float = THEORY_ERROR
    formulas: Mapping[str, ForceCurve] = field(default_factory=dict, repr=False)
    tension_fraction: float = 0.0
    is_finite_strain: bool = False  # of finite strain, its contact tested at the deformed point
    _jkr_of_work: dict[float, Jkr | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _solution_of_depth: dict[float, Solution | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _expected_solutions: dict[float, Solution | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution] | None:
        """One Solution (force, a, pressure) per depth, or None where the theory ends (contact meets
        the wall).
        """
        if len(self._solution_of_depth) > MAX_KEPT_SOLUTIONS:
            self._solution_of_depth.clear()
        new_depths = [delta for delta in deltas if delta not in self._solution_of_depth]
        with contextlib.suppress(*SOLUTION_ERRORS):
            self._solution_of_depth.update(
                zip(new_depths, self.contact.solutions_at_depths(new_depths), strict=True)
            )
        solutions = [
            solution for delta in deltas if (solution := self._solution_of_depth.get(delta))
        ]
        return solutions if len(solutions) == len(deltas) else None

    def expect_depths(self, deltas: Sequence[float]) -> None:
        """Depths that will be asked for one by one: the first of them finds all at once."""
        self._expected_solutions.clear()
        self._expected_solutions.update(dict.fromkeys(deltas))

    def solution_at_depth(self, delta: float) -> Solution | None:
        """The Solution at one depth, or None."""
        if delta in self._expected_solutions:
            if self._expected_solutions[delta] is None and (
                path_solutions := self.solutions_at_depths(list(self._expected_solutions))
            ):
                self._expected_solutions.update(
                    zip(self._expected_solutions, path_solutions, strict=True)
                )
            if solution := self._expected_solutions[delta]:
                return solution
            self._expected_solutions.clear()  # theory ends before the last of them
        solutions = self.solutions_at_depths([delta])
        self._solution_of_depth.setdefault(delta, None)
        return solutions[0] if solutions else None

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution] | None:
        """One Solution per force, or None where the theory ends before one of them."""
        with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
            return self.contact.solutions_at_forces(forces)
        return None

    def depth_of_force(self, force: float, deepest: float) -> float | None:
        """The depth at which theory's force is this one, `deepest` at most; None when theory ends
        before.
        """
        with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
            return min(self.contact.depth_of_force(force), deepest)
        deepest_solution = self.solution_at_depth(deepest)
        return deepest if deepest_solution and deepest_solution.force <= force else None

    def checked_for_tension(self, deltas: Sequence[float]) -> Theory:
        """The same theory, no longer exact where its tip would have to pull at one of the depths."""
        if (
            not self.is_exact
            or isinstance(self.contact, Compression)
            or len(self.contact.scaled_stack.layers) == 1
        ):
            return self
        sampled_depths = sorted(
            delta
            for delta in {*deltas[:: ceil(len(deltas) / TENSION_CHECK_DEPTHS)], max(deltas)}
            if delta > 0
        )
        solutions = self.solutions_at_depths(sampled_depths)  # each sets out from the last
        if solutions is None:  # theory ends before the deepest, and knows none beyond its end
            solutions = [
                solution
                for solution in takewhile(bool, map(self.solution_at_depth, sampled_depths))
                if solution
            ]
        tension_fraction = max(map(self.contact.tension_fraction, solutions), default=0.0)
        if not tension_fraction:
            return self
        reason = (
            f"theory's tip would pull with {100 * tension_fraction:.1g} % of the force to keep its "
            "contact whole"
        )
        return replace(
            self,
            is_exact=False,
            reason=reason,
            tension_fraction=tension_fraction,
            error=max(self.error, tension_fraction),
        )

    def covers_path(self, deepest: float, largest_force: float | None) -> bool:
        """Whether theory goes as far as a path to this depth, or to the largest force where forces
        are prescribed.
        """
        if largest_force is not None:
            return largest_force <= 0 or self.depth_of_force(largest_force, inf) is not None
        return deepest <= 0 or self.solution_at_depth(deepest) is not None

    def formula_value(self, name: str, delta: float, force: float | None = None) -> float | None:
        """Force at a depth by a usual formula or, where a force is given, its depth, near this one;
        None: no such.
        """
        formula = self.formulas[name]
        value = formula(delta) if force is None else depth_of_force(formula, force, delta)
        return value if value is not None and np.isfinite(value) else None

    def jkr(self, work: float) -> Jkr | None:
        """The tip if it adheres without range, which keeps what it has found; None where theory
        does not know that.
        """
        if work in self._jkr_of_work:
            return self._jkr_of_work[work]
        from indent_sim.theory.adhesion import (
            Jkr,  # with scipy's searches, which no other scene needs
        )
        from indent_sim.theory.punches import LayerPunches

        jkr = Jkr(LayerPunches(self.contact), work) if isinstance(self.contact, Layer) else None
        return self._jkr_of_work.setdefault(work, jkr)
