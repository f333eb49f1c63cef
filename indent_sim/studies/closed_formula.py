"""Closed formula of a study: a column as a quotient of two short sums of powers of its groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# Significant digits of the coefficients. The stated error is that of the rounded coefficients.
DIGITS = 5


@dataclass(frozen=True)
class Term:
    """Term of a closed formula: a coefficient times powers of the variables.

    Attributes
    ----------
    coefficient
        The coefficient, rounded to DIGITS digits.
    powers
        Power of each variable.
    """

    coefficient: float
    powers: tuple[float, ...]


@dataclass(frozen=True)
class ClosedFormula:
    """Column of a study as factor * numerator / (1 + denominator).

    Attributes
    ----------
    column
        The column.
    variables
        Powers of the keys in each variable: a dimensionless group, or one dimensionless key.
    factor
        Powers of the keys in the factor.
    numerator, denominator
        Terms of the two sums; those of the denominator without its 1.
    error
        Error at held-out runs, see `held_out_error`, and the largest difference from the surrogate
        at "edges" of the range.
    """

    column: str
    variables: tuple[Mapping[str, float], ...]
    factor: Mapping[str, float]
    numerator: tuple[Term, ...]
    denominator: tuple[Term, ...]
    error: Mapping[str, Any]

    def __call__(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the column at values of all keys; (rows,)."""
        points = np.column_stack([product(powers, values) for powers in self.variables])
        quotient = _sum(self.numerator, points) / (1 + _sum(self.denominator, points))
        return product(self.factor, values) * quotient

    @property
    def coefficient_count(self) -> int:
        """Number of fitted coefficients."""
        return len(self.numerator) + len(self.denominator)

    def error_text(self) -> str:
        """Return the error as text."""
        return (
            f"median error {self.error['median']:.2g}, {100 * self.error['quantile']:g} % of points"
            f" are within {self.error['error']:.2g} (relative, at 95 % confidence, "
            f"{self.error['held_out']} held-out runs, the largest error "
            f"{self.error['largest']:.2g}); at the edges of the range the formula differs from the "
            f"surrogate by up to {self.error['edges']:.2g}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the formula as an object for the file of the surrogate."""
        return {
            "factor": self.factor,
            "variables": self.variables,
            "numerator": self.numerator,
            "denominator": self.denominator,
            "error": self.error,
        }


def product(powers: Mapping[str, float], values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return a product of powers of keys; (rows,)."""
    result = np.ones(len(next(iter(values.values()))))
    for key, power in powers.items():
        result = result * values[key] ** power
    return result


def _sum(terms: Sequence[Term], points: np.ndarray) -> np.ndarray:
    """Return a sum of terms at values of the variables (rows, d); (rows,)."""
    total = np.zeros(len(points))
    for term in terms:
        total = total + term.coefficient * np.prod(points ** np.array(term.powers), axis=1)
    return total
