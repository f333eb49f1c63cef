"""Search for the few terms of a quotient of two sums that is closest to given values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from indent_sim.studies.closed_formula import DIGITS

# Quantile of the errors by which quotients are compared.
COMPARED_QUANTILE = 0.99
# Smallest value of a denominator at a run or an edge: a smaller one is too close to a pole.
SMALLEST_DENOMINATOR = 0.02
# Share of the square of a possible term that must be independent of the other terms.
INDEPENDENT_SHARE = 1e-7
# Largest number of exchanges of every term, and of solutions with new weights.
MAX_ROUNDS = 20
MAX_SOLUTIONS = 10
# A smaller decrease of the error is noise.
SMALLEST_DECREASE = 1e-3


@dataclass(frozen=True, eq=False)
class Quotient:
    """Quotient of two sums of terms.

    Attributes
    ----------
    above, below
        Indices of the terms of the numerator, and of the denominator without its 1.
    above_coefficients, below_coefficients
        Their coefficients, rounded to DIGITS digits.
    error
        COMPARED_QUANTILE of its relative errors; infinite if its denominator is close to a pole.
    """

    above: np.ndarray
    below: np.ndarray
    above_coefficients: np.ndarray
    below_coefficients: np.ndarray
    error: float

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self.above) + len(self.below)


class TermSearch:
    """Search for the terms of a quotient by orthogonal matching pursuit with exchanges.

    The equations numerator / target - denominator = 1 are linear in the coefficients. They have
    weights, the reciprocals of the denominator of the last solution.

    Parameters
    ----------
    values
        Values of the possible terms, of which the first is the constant; (rows, terms).
    target
        Values of the quotient; (rows,).
    edge_values
        Values of the possible terms at points where the denominator must be positive, too;
        (points, terms).
    has_denominator
        Whether the quotient may have a denominator. Where the terms hardly vary, the search with
        one may find the useless solution numerator = 1 + denominator = 0.
    """

    def __init__(
        self,
        values: np.ndarray,
        target: np.ndarray,
        edge_values: np.ndarray,
        has_denominator: bool,
    ):
        self._count = values.shape[1]
        below = -values[:, 1:] if has_denominator else values[:, :0]
        self._columns = np.hstack([values / target[:, None], below])
        self._edge_values = edge_values
        self._weights = np.ones(len(target))
        self._chosen: list[int] = []
        self._update_products()

    def extended(self) -> Quotient:
        """Choose one more term, exchange terms, and return the quotient."""
        self._chosen.append(self._best_addition(self._chosen)[0])
        self._exchange()
        quotient, weights = self._solution()
        if np.isfinite(quotient.error):
            self._weights = weights
            self._update_products()
        return quotient

    def shortened(self, largest_error: float) -> Quotient:
        """Remove terms as long as the error is at most `largest_error`; return the quotient."""
        quotient = self._solution()[0]
        while len(self._chosen) > 1:
            rests = [
                [*self._chosen[:place], *self._chosen[place + 1 :]]
                for place in range(len(self._chosen))
            ]
            self._chosen = min(rests, key=self._error)
            self._exchange()
            shorter = self._solution()[0]
            if shorter.error > largest_error:
                break
            quotient = shorter
        return quotient

    def _exchange(self) -> None:
        """Exchange one term after another as long as the error decreases."""
        error = self._error(self._chosen)
        for _ in range(MAX_ROUNDS):
            before = error
            for place in range(len(self._chosen)):
                rest = [*self._chosen[:place], *self._chosen[place + 1 :]]
                self._chosen[place], error = self._best_addition(rest)
            if error >= (1 - SMALLEST_DECREASE) * before:
                break

    def _solution(self) -> tuple[Quotient, np.ndarray]:
        """Return the quotient of the chosen terms with the smallest relative error, and weights.

        The equations are divided by the denominator of the previous solution.
        """
        chosen = np.array(self._chosen)
        is_below = chosen >= self._count
        columns = self._columns[:, chosen]
        denominator = 1 / self._weights
        solution = np.zeros(len(chosen))
        for _ in range(MAX_SOLUTIONS):
            weights = 1 / np.maximum(np.abs(denominator), SMALLEST_DENOMINATOR)
            solution = scipy.linalg.lstsq(columns * weights[:, None], weights)[0]
            denominator = 1 - columns[:, is_below] @ solution[is_below]
        solution = np.array([float(f"{value:.{DIGITS}g}") for value in solution])
        denominator = 1 - columns[:, is_below] @ solution[is_below]
        numerator = columns[:, ~is_below] @ solution[~is_below]
        below = chosen[is_below] - self._count + 1
        at_edges = 1 + self._edge_values[:, below] @ solution[is_below]
        smallest = min(denominator.min(), at_edges.min(initial=1.0))
        error = np.inf
        if smallest > SMALLEST_DENOMINATOR:
            errors = np.abs(numerator / denominator - 1)
            error = float(np.quantile(errors, COMPARED_QUANTILE))
        quotient = Quotient(
            chosen[~is_below], below, solution[~is_below], solution[is_below], error
        )
        return quotient, 1 / np.maximum(denominator, SMALLEST_DENOMINATOR)

    def _update_products(self) -> None:
        """Compute the products of the weighted columns, which have length 1, with each other."""
        columns = self._columns * self._weights[:, None]
        columns /= np.linalg.norm(columns, axis=0)
        self._products = columns.T @ columns
        self._projections = columns.T @ self._weights
        self._square = float(self._weights @ self._weights)

    def _error(self, chosen: Sequence[int]) -> float:
        """Return the sum of squares that remains with some columns."""
        inner = self._products[np.ix_(chosen, chosen)]
        coefficients = scipy.linalg.lstsq(inner, self._projections[chosen])[0]
        return max(0.0, self._square - float(self._projections[chosen] @ coefficients))

    def _best_addition(self, chosen: Sequence[int]) -> tuple[int, float]:
        """Return the best further column, and the sum of squares that remains with it."""
        cross = self._products[chosen]
        targets = np.column_stack([cross, self._projections[chosen]])
        coefficients = scipy.linalg.lstsq(self._products[np.ix_(chosen, chosen)], targets)[0]
        squares = 1 - np.einsum("ij,ij->j", cross, coefficients[:, :-1])
        explained = float(self._projections[chosen] @ coefficients[:, -1])
        projections = self._projections - cross.T @ coefficients[:, -1]
        is_independent = squares > INDEPENDENT_SHARE
        gains = np.where(is_independent, projections**2, 0.0) / np.maximum(
            squares, INDEPENDENT_SHARE
        )
        best = int(np.argmax(gains))
        return best, max(0.0, self._square - explained - float(gains[best]))
