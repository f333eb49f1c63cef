"""Fit of a sum of Chebyshev polynomials to runs: coordinates and degrees that need few terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations

import numpy as np
import scipy.linalg

from indent_sim.studies.chebyshev_sum import ChebyshevSum, design_matrix, index_tuples
from indent_sim.studies.surrogate import Coordinate, Surrogate

# Largest number of terms of the polynomial, so that its evaluation stays fast.
MAX_TERMS = 700
MAX_DEGREE = 40
# Number of rows for each term of the polynomial.
ROWS_PER_TERM = 3
# Numbers of terms with which coordinates are compared, and numbers of coordinates that are kept.
COMPARED_TERMS = (100, 300)
COMPARED_COORDINATES = (4, 1)
# Powers of one group by which another one is multiplied.
GROUP_POWERS = (-1.0, -0.5, 0.5, 1.0)
# Difference of the stretch of neighbouring candidates, and its largest value.
STRETCH_STEP = 0.2
MAX_STRETCH = 0.8
# Ratio of the largest degrees of neighbouring candidates, and of their numbers of terms.
DEGREE_RATIO = 1.25
TERMS_RATIO = 0.7
# A smaller decrease of the error is noise.
SMALLEST_DECREASE = 0.02
# Quantile of the errors by which polynomials are compared. The few largest errors, at the corners
# of the range, would hide what other coordinates or degrees improve everywhere else.
COMPARED_QUANTILE = 0.95


@dataclass(frozen=True)
class _Candidate:
    """Candidate polynomial: its coordinates, the ratios of its degrees, and its number of terms."""

    coordinates: tuple[Coordinate, ...]
    ratios: tuple[float, ...]
    terms: int

    @property
    def indices(self) -> np.ndarray:
        """Index tuples of the largest polynomial with these ratios and at most `terms` terms."""
        return _index_tuples_of(self.ratios, self.terms)


def fit_polynomial(
    surrogate: Surrogate, values: Mapping[str, np.ndarray], target: np.ndarray
) -> Surrogate:
    """Return the surrogate with coordinates and a polynomial that are fitted to runs.

    Several sets of coordinates are tried, in which one group is multiplied by a power of another.
    Each set is fitted with its best stretches and degrees, and the sets are compared by the error
    of runs that are left out of the fit. All sets are compared with polynomials of few terms, and
    the best ones again with more terms.

    Parameters
    ----------
    surrogate
        The surrogate with its first groups and its ranges.
    values
        Values of all keys; (rows,).
    target
        Values of the polynomial; (rows,).
    """
    search = _Search(surrogate, values, target)
    first = _Candidate(surrogate.coordinates, (1.0,) * len(surrogate.coordinates), MAX_TERMS)
    candidates = [first, *_combined(first)]
    for terms, count in zip(COMPARED_TERMS, COMPARED_COORDINATES, strict=True):
        refined = [search.refine(search.resized(candidate, terms)) for candidate in candidates]
        candidates = sorted(refined, key=search.error)[:count]
    return search.fit(search.shorten(search.refine(search.resized(candidates[0], MAX_TERMS))))


def with_coefficients(
    surrogate: Surrogate, values: Mapping[str, np.ndarray], target: np.ndarray
) -> Surrogate:
    """Return a surrogate whose polynomial has the coefficients of a fit to runs.

    Parameters
    ----------
    surrogate
        The surrogate; its polynomial has the index tuples.
    values, target
        See `fit_polynomial`.
    """
    points = surrogate.unit_points(surrogate.points_of(values))
    indices = surrogate.polynomial.indices
    coefficients = scipy.linalg.lstsq(design_matrix(points, indices), target)[0]
    return replace(surrogate, polynomial=ChebyshevSum(indices, coefficients))


class _Search:
    """Search for the coordinates and degrees whose polynomial has the smallest error."""

    def __init__(self, surrogate: Surrogate, values: Mapping[str, np.ndarray], target: np.ndarray):
        self._surrogate = surrogate
        self._values = values
        self._target = target

    def resized(self, candidate: _Candidate, terms: int) -> _Candidate:
        """Return a copy of a candidate with `terms` terms, or as many as the runs can determine."""
        return replace(candidate, terms=max(1, min(terms, len(self._target) // ROWS_PER_TERM)))

    def refine(self, best: _Candidate) -> _Candidate:
        """Change ratios and stretches one at a time as long as this reduces the error."""
        error = self.error(best)
        while True:
            candidates = list(_neighbours(best))
            errors = [self.error(candidate) for candidate in candidates]
            if min(errors) >= (1 - SMALLEST_DECREASE) * error:
                return best
            place = int(np.argmin(errors))
            best = candidates[place]
            error = errors[place]

    def shorten(self, candidate: _Candidate) -> _Candidate:
        """Leave out terms that do not reduce the error."""
        error = self.error(candidate)
        while candidate.terms > 1:
            shorter = replace(candidate, terms=int(TERMS_RATIO * candidate.terms))
            if self.error(shorter) > (1 + SMALLEST_DECREASE) * error:
                return candidate
            candidate = shorter
        return candidate

    def fit(self, candidate: _Candidate) -> Surrogate:
        """Return the surrogate with the polynomial of a candidate."""
        surrogate = replace(self._surrogate, coordinates=candidate.coordinates)
        polynomial = ChebyshevSum(candidate.indices, np.zeros(len(candidate.indices)))
        surrogate = replace(surrogate, polynomial=polynomial)
        return with_coefficients(surrogate, self._values, self._target)

    def error(self, candidate: _Candidate) -> float:
        """Return a quantile of the errors of runs that are left out of the fit one at a time."""
        indices = candidate.indices
        # Largest number of runs with which two polynomials are compared.
        rows = min(len(self._target), max(1000, ROWS_PER_TERM * len(indices)))
        surrogate = replace(self._surrogate, coordinates=candidate.coordinates)
        values = {key: column[:rows] for key, column in self._values.items()}
        points = surrogate.unit_points(surrogate.points_of(values))
        target = self._target[:rows]
        q, _ = scipy.linalg.qr(design_matrix(points, indices), mode="economic")
        residuals = target - q @ (q.T @ target)
        leverage = np.einsum("ij,ij->i", q, q)
        errors = np.abs(residuals) / np.maximum(1 - leverage, 1e-6)
        return float(np.quantile(errors, COMPARED_QUANTILE))


def _combined(candidate: _Candidate) -> Iterator[_Candidate]:
    """Yield candidates in which one group is multiplied by a power of another."""
    coordinates = candidate.coordinates
    for i, j in permutations(range(len(coordinates)), 2):
        if not (coordinates[i].is_logarithmic and coordinates[j].is_logarithmic):
            continue
        for power in GROUP_POWERS:
            powers = _product(coordinates[i].powers, coordinates[j].powers, power)
            yield _with_coordinate(candidate, i, replace(coordinates[i], powers=powers))


def _neighbours(candidate: _Candidate) -> Iterator[_Candidate]:
    """Yield candidates with another stretch or another ratio of one coordinate."""
    for i, coordinate in enumerate(candidate.coordinates):
        for step in (-STRETCH_STEP, STRETCH_STEP):
            stretch = round(coordinate.stretch + step, 3)
            if abs(stretch) <= MAX_STRETCH:
                yield _with_coordinate(candidate, i, replace(coordinate, stretch=stretch))
        for factor in (1 / DEGREE_RATIO, DEGREE_RATIO):
            ratios = candidate.ratios
            yield replace(candidate, ratios=(*ratios[:i], factor * ratios[i], *ratios[i + 1 :]))


@cache
def _index_tuples_of(ratios: tuple[float, ...], terms: int) -> np.ndarray:
    """Return the index tuples of the largest polynomial with at most `terms` terms."""

    def indices(factor: float) -> np.ndarray:
        return index_tuples([min(factor * ratio, MAX_DEGREE) for ratio in ratios])

    low = 0.0
    high = 1.0
    while len(indices(high)) <= terms and high * min(ratios) < MAX_DEGREE:
        low = high
        high *= 2
    # Largest relative difference of the degrees from the largest possible ones.
    tolerance = 1e-3
    while high - low > tolerance * high:
        middle = (low + high) / 2
        if len(indices(middle)) <= terms:
            low = middle
        else:
            high = middle
    return indices(low)


def _with_coordinate(candidate: _Candidate, i: int, coordinate: Coordinate) -> _Candidate:
    """Return a copy of a candidate with another i-th coordinate."""
    coordinates = candidate.coordinates
    return replace(candidate, coordinates=(*coordinates[:i], coordinate, *coordinates[i + 1 :]))


def _product(
    first: Mapping[str, float], second: Mapping[str, float], power: float
) -> dict[str, float]:
    """Return the powers of the keys in first * second^power."""
    keys = dict.fromkeys([*first, *second])
    powers = {key: first.get(key, 0.0) + power * second.get(key, 0.0) for key in keys}
    # A power that is round-off is 0.
    return {key: value for key, value in powers.items() if abs(value) > 1e-12}
