"""Rows of two results side by side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.process.errors import VerificationError
from indent_sim.results.reader import COMPARED, read

SHOWN = 10  # differences told one by one


@dataclass(frozen=True)
class Comparison:
    """Two force tables side by side, matched by step: one (a, b) pair per step and column.

    worst: largest relative difference of each column; differences: what differs, in words; empty when equal.
    """

    steps: tuple[int, ...]
    pairs: dict[str, np.ndarray]
    worst: dict[str, float]
    differences: tuple[str, ...]

    def check(self) -> None:
        """Raise VerificationError when the two differ."""
        if self.differences:
            more = len(self.differences) - SHOWN
            told = [*self.differences[:SHOWN], *([f"and {more} more"] if more > 0 else [])]
            raise VerificationError("the two differ\n" + "\n".join(told))


def compare(first: Path | str, second: Path | str, rtol: float = 1e-6) -> Comparison:
    """Compare delta, force and a of two results row by row.

    Two numbers agree when |x - y| <= rtol max(|x|, |y|, 1e-6 largest of the column): a force of 1e-18 out of
    contact is a zero. NaN agrees with NaN alone.
    """
    A, B = read(first), read(second)
    differences = [
        f"step {step:g} is in {here.path} alone"
        for here, there in ((A, B), (B, A))
        for step in np.setdiff1d(here["step"], there["step"])
    ]
    steps, of_A, of_B = np.intersect1d(A["step"], B["step"], return_indices=True)
    if not len(steps):
        differences.append("the two have no step in common")
    pairs = {name: np.column_stack([A[name][of_A], B[name][of_B]]) for name in COMPARED}
    worst = {}
    for name, pair in pairs.items():
        relative = _relative_difference(pair)
        worst[name] = float(relative.max(initial=0.0))
        differences += [
            f"step {steps[i]:g}: {name} {pair[i, 0]:.10g} and {pair[i, 1]:.10g} differ by {relative[i]:.2g}"
            for i in np.flatnonzero(~(relative <= rtol))
        ]
    return Comparison(tuple(int(step) for step in steps), pairs, worst, tuple(differences))


def _relative_difference(pair: np.ndarray) -> np.ndarray:
    """|x - y| over the larger of the two or 1e-6 of the largest in the column; infinite when one is NaN."""
    finite = np.abs(pair[np.isfinite(pair)])
    floor = 1e-6 * finite.max(initial=0.0)
    size = np.maximum(np.abs(pair).max(axis=1), floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.abs(pair[:, 0] - pair[:, 1]) / size
    same = (pair[:, 0] == pair[:, 1]) | np.isnan(pair).all(axis=1)
    return np.where(same, 0.0, np.where(np.isfinite(relative), relative, np.inf))
