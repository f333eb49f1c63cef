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
from indent_sim.theory.layer import Layer
from indent_sim.theory.march import LayerContact
from indent_sim.theory.roots import Curve, depth_of
from indent_sim.theory.solution import UNSOLVED, Solution

if TYPE_CHECKING:
    from indent_sim.theory.surface.adhesion import Jkr

MOST_KEPT = 100  # solutions that a theory remembers
OWN_ERROR = 1e-8  # of theory's numbers, stated: ten times what was measured
SAMPLED = 10  # depths of a path at which it is asked whether theory's tip would have to pull


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
    exact: bool
    why: str
    contact: LayerContact | Compression = field(repr=False)
    error: float = OWN_ERROR
    formulas: Mapping[str, Curve] = field(default_factory=dict, repr=False)
    pull: float = 0.0
    is_finite: bool = False  # of finite strain, its contact tested at the deformed point
    _adhering: dict[float, Jkr | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _known: dict[float, Solution | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _path: dict[float, Solution | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def curve(self, deltas: Sequence[float]) -> list[Solution] | None:
        """One Solution (force, a, pressure) per depth, or None where the theory ends (contact meets
        the wall).
        """
        if len(self._known) > MOST_KEPT:
            self._known.clear()
        new = [delta for delta in deltas if delta not in self._known]
        with contextlib.suppress(*UNSOLVED):
            self._known.update(zip(new, self.contact.curve(new), strict=True))
        solutions = [solution for delta in deltas if (solution := self._known.get(delta))]
        return solutions if len(solutions) == len(deltas) else None

    def expect(self, deltas: Sequence[float]) -> None:
        """Depths that will be asked for one by one: the first of them finds all at once."""
        self._path.clear()
        self._path.update(dict.fromkeys(deltas))

    def at(self, delta: float) -> Solution | None:
        """The Solution at one depth, or None."""
        if delta in self._path:
            if self._path[delta] is None and (found := self.curve(list(self._path))):
                self._path.update(zip(self._path, found, strict=True))
            if known := self._path[delta]:
                return known
            self._path.clear()  # theory ends before the last of them
        solutions = self.curve([delta])
        self._known.setdefault(delta, None)
        return solutions[0] if solutions else None

    def under(self, forces: Sequence[float]) -> list[Solution] | None:
        """One Solution per force, or None where the theory ends before one of them."""
        with contextlib.suppress(*UNSOLVED), np.errstate(all="ignore"):
            return self.contact.under(forces)
        return None

    def depth(self, force: float, deepest: float) -> float | None:
        """The depth at which theory's force is this one, `deepest` at most; None when theory ends
        before.
        """
        with contextlib.suppress(*UNSOLVED), np.errstate(all="ignore"):
            return min(self.contact.depth(force), deepest)
        last = self.at(deepest)
        return deepest if last and last.force <= force else None

    def along(self, deltas: Sequence[float]) -> Theory:
        """The same theory, no longer exact where its tip would have to pull at one of the depths."""
        if (
            not self.exact
            or isinstance(self.contact, Compression)
            or len(self.contact.scaled.plies) == 1
        ):
            return self
        some = sorted(
            delta for delta in {*deltas[:: ceil(len(deltas) / SAMPLED)], max(deltas)} if delta > 0
        )
        found = self.curve(some)  # each sets out from the last
        if found is None:  # theory ends before the deepest, and knows none beyond its end
            found = [solution for solution in takewhile(bool, map(self.at, some)) if solution]
        pull = max(map(self.contact.tension, found), default=0.0)
        if not pull:
            return self
        why = (
            f"theory's tip would pull with {100 * pull:.1g} % of the force to keep its "
            "contact whole"
        )
        return replace(self, exact=False, why=why, pull=pull, error=max(self.error, pull))

    def reaches(self, deepest: float, largest_force: float | None) -> bool:
        """Whether theory goes as far as a path to this depth, or to the largest force where forces
        are prescribed.
        """
        if largest_force is not None:
            return largest_force <= 0 or self.depth(largest_force, inf) is not None
        return deepest <= 0 or self.at(deepest) is not None

    def formula_at(self, name: str, delta: float, force: float | None = None) -> float | None:
        """Force at a depth by a usual formula or, where a force is given, its depth, near this one;
        None: no such.
        """
        formula = self.formulas[name]
        found = formula(delta) if force is None else depth_of(formula, force, delta)
        return found if found is not None and np.isfinite(found) else None

    def jkr(self, work: float) -> Jkr | None:
        """The tip if it adheres without range, which keeps what it has found; None where theory
        does not know that.
        """
        if work in self._adhering:
            return self._adhering[work]
        from indent_sim.theory.surface.adhesion import (
            Jkr,
        )  # with scipy's searches, which no other scene needs
        from indent_sim.theory.surface.punches import LayerPunches

        jkr = Jkr(LayerPunches(self.contact), work) if isinstance(self.contact, Layer) else None
        return self._adhering.setdefault(work, jkr)
