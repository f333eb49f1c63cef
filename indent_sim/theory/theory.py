"""Reference theory of a body under a tip: solutions at depths or forces, and textbook formulas."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import takewhile
from math import ceil, inf
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.theory.compression import Compression
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.contacts_in_series import ContactsInSeries
from indent_sim.theory.layer import Layer
from indent_sim.theory.measured_constants import THEORY_ERROR
from indent_sim.theory.roots import ForceCurve, depth_of_force
from indent_sim.theory.solution import SOLUTION_ERRORS, Solution

if TYPE_CHECKING:
    from indent_sim.theory.adhesion import Jkr


@dataclass(frozen=True)
class Theory:
    """Reference theory of a body under a tip, with textbook formulas for comparison.

    Strains are small unless `is_finite_strain`.

    Attributes
    ----------
    contact
        Load curve of the theory.
    scope
        Sentence on the body and the tip that the theory describes exactly.
    differences
        Differences between the scene and the theory; empty if the theory is exact for the scene.
    error
        Relative error of the results of the theory.
    formulas
        Textbook formulas by name: functions that return the force [pressure length^2] at a depth
        [length].
    tension_fraction
        Resultant of the tensile part of the contact pressure, divided by the force; given only if
        this tension is the sole reason why the theory is inexact.
    """

    name: str
    contact: ContactCurve | Compression | ContactsInSeries = field(repr=False)
    scope: str = ""
    differences: tuple[str, ...] = ()
    error: float = THEORY_ERROR
    formulas: Mapping[str, ForceCurve] = field(default_factory=dict, repr=False)
    tension_fraction: float = 0.0
    is_finite_strain: bool = False

    @property
    def is_exact(self) -> bool:
        """Whether the theory describes exactly the body and the tip of the scene."""
        return not self.differences

    @property
    def reason(self) -> str:
        """All differences between the scene and the theory, or why there are none."""
        return "; ".join(self.differences) or self.scope

    def add_differences(self, *differences: str) -> Theory:
        """Return the theory with further differences between the scene and the theory."""
        return replace(self, differences=self.differences + differences)

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution] | None:
        """Return one Solution for each depth, or None if a depth is beyond the range of the theory.

        The range ends where the contact would reach a side wall or the end of the tip.
        """
        solutions = _solutions_at_depths(self.contact, tuple(deltas))
        return None if solutions is None else list(solutions)

    def solution_at_depth(self, delta: float) -> Solution | None:
        """Return the Solution at one depth, or None beyond the range of the theory."""
        solutions = _solutions_at_depths(self.contact, (delta,))
        return solutions[0] if solutions else None

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution] | None:
        """Return one Solution for each force; None if a force is beyond the range of the theory."""
        with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
            return self.contact.solutions_at_forces(forces)
        return None

    def depth_of_force(self, force: float, deepest: float) -> float | None:
        """Return the depth of a force, at most `deepest`; None outside the range of the theory."""
        with contextlib.suppress(*SOLUTION_ERRORS), np.errstate(all="ignore"):
            return min(self.contact.depth_of_force(force), deepest)
        deepest_solution = self.solution_at_depth(deepest)
        return deepest if deepest_solution and deepest_solution.force <= force else None

    def checked_for_tension(self, deltas: Sequence[float]) -> Theory:
        """Return the theory, marked as inexact if its pressure is tensile at one of the depths.

        Only about ten of the depths are checked.
        """
        if (
            not self.is_exact
            or isinstance(self.contact, Compression | ContactsInSeries)
            or len(self.contact.scaled_stack.layers) == 1
        ):
            return self
        sampled_depths = sorted(
            delta for delta in {*deltas[:: ceil(len(deltas) / 10)], max(deltas)} if delta > 0
        )
        solutions = self.solutions_at_depths(sampled_depths)
        if solutions is None:
            # The theory ends before the deepest depth: check those that it reaches.
            solutions = [
                solution
                for solution in takewhile(bool, map(self.solution_at_depth, sampled_depths))
                if solution
            ]
        tension_fraction = max(map(self.contact.tension_fraction, solutions), default=0.0)
        if not tension_fraction:
            return self
        difference = (
            "the theory assumes tensile contact pressure with a resultant of "
            f"{float(f'{100 * tension_fraction:.1g}'):g} % of the force"
        )
        return replace(
            self.add_differences(difference),
            tension_fraction=tension_fraction,
            error=max(self.error, tension_fraction),
        )

    def covers_path(self, deepest: float, largest_force: float | None) -> bool:
        """Return whether the largest prescribed depth or force is in the range of the theory."""
        if largest_force is not None:
            return largest_force <= 0 or self.depth_of_force(largest_force, inf) is not None
        return deepest <= 0 or self.solution_at_depth(deepest) is not None

    def formula_value(self, name: str, delta: float, force: float | None = None) -> float | None:
        """Return the force at a depth by a textbook formula, or the depth of a given force.

        The search for the depth of a force begins at `delta`. Returns None if there is no finite
        value.
        """
        formula = self.formulas[name]
        value = formula(delta) if force is None else depth_of_force(formula, force, delta)
        return value if value is not None and np.isfinite(value) else None

    def jkr(self, work: float) -> Jkr | None:
        """Return the JKR contact for a work of adhesion, or None if it cannot be computed."""
        return _jkr(self.contact, work) if isinstance(self.contact, Layer) else None


@lru_cache(maxsize=100)
def _solutions_at_depths(
    contact: ContactCurve | Compression | ContactsInSeries, deltas: tuple[float, ...]
) -> tuple[Solution, ...] | None:
    """Return one Solution for each depth, or None if a depth is beyond the theory (cached)."""
    with contextlib.suppress(*SOLUTION_ERRORS):
        return tuple(contact.solutions_at_depths(deltas))
    return None


@lru_cache(maxsize=16)
def _jkr(contact: Layer, work: float) -> Jkr:
    """Return the JKR contact for a work of adhesion."""
    # Imported here because only adhesive scenes need scipy.optimize.
    from indent_sim.theory.adhesion import Jkr
    from indent_sim.theory.punches import LayerPunches

    return Jkr(LayerPunches(contact), work)
