"""Fit of a closed formula of few coefficients to the runs of a study, and its error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from itertools import product as all_tuples

import numpy as np

from indent_sim.studies.closed_formula import ClosedFormula, Term, product
from indent_sim.studies.edge_points import edge_points
from indent_sim.studies.held_out_error import held_out_error, held_out_mask
from indent_sim.studies.surrogate import Surrogate
from indent_sim.studies.term_search import Quotient, TermSearch

# Largest number of coefficients, and the error with which the search ends: the formula with the
# fewest coefficients within this error is taken.
MAX_COEFFICIENTS = 24
WANTED_ERROR = 0.01
# A formula with a larger error is not printed.
LARGEST_ERROR = 0.05
# Number of runs for each coefficient, largest number of runs to which a formula is fitted, and
# largest number of possible terms.
ROWS_PER_COEFFICIENT = 3
MAX_ROWS = 2000
MAX_CANDIDATES = 600
# Steps and largest values of the powers of a group, from many to few.
POWERS = ((0.5, 2.0), (1.0, 2.0), (1.0, 1.0))
# The same of the factor.
FACTOR_POWERS = (0.5, 4.0)
# Largest power of a dimensionless key.
MAX_KEY_POWER = 4


def fit_closed_formula(
    surrogate: Surrogate, keys: Mapping[str, np.ndarray], column: np.ndarray
) -> ClosedFormula:
    """Fit a closed formula to the runs of a study, with its error at held-out runs.

    The held-out runs are those of the surrogate. They choose nothing.

    Parameters
    ----------
    surrogate
        The surrogate of the same runs, which has the groups.
    keys
        Values of the varied keys; (rows,).
    column
        The positive column; (rows,).
    """
    values = surrogate.values_of({key: keys[key] for key in surrogate.ranges})[0]
    is_held_out = held_out_mask(len(column))
    fitted = {key: array[~is_held_out] for key, array in values.items()}
    formula = _fit(surrogate, fitted, column[~is_held_out])
    held_out = {key: array[is_held_out] for key, array in values.items()}
    errors = np.abs(formula(held_out) / column[is_held_out] - 1)
    varied = {key: held_out[key] for key in surrogate.ranges}
    points = edge_points(surrogate, fitted)
    at_edges = formula(surrogate.values_of(points)[0]) / surrogate(points) - 1
    edges = {"edges": float(np.abs(at_edges).max(initial=0.0))}
    return replace(formula, error=held_out_error(varied, errors) | edges)


def _fit(
    surrogate: Surrogate, values: Mapping[str, np.ndarray], column: np.ndarray
) -> ClosedFormula:
    """Return the formula of fitted runs, whose error is not yet known.

    The column is factor * numerator / (1 + denominator). The factor is the scale of the surrogate
    times the product of powers of its groups that fits best alone. Both sums consist of powers of
    the groups and of the dimensionless keys of the surrogate. Their terms are chosen one after
    another (orthogonal matching pursuit), such that the sum of the squares of the relative errors
    decreases most, and are then exchanged or left out one at a time.
    """
    values = {key: array[:MAX_ROWS] for key, array in values.items()}
    column = column[:MAX_ROWS]
    variables = tuple(coordinate.powers for coordinate in surrogate.coordinates)
    is_group = [coordinate.is_logarithmic for coordinate in surrogate.coordinates]
    scaled = column / product(surrogate.scale, values)
    powers = _candidate_powers(is_group)
    points = np.column_stack([product(group, values) for group in variables])
    leading = _leading_powers(points, is_group, scaled)
    factor = dict(surrogate.scale)
    for group, exponent in zip(variables, leading, strict=True):
        for key, power in group.items():
            factor[key] = factor.get(key, 0.0) + float(exponent) * power
    # Powers of keys are quotients of small whole numbers: a smaller one is round-off of zero.
    factor = {key: power for key, power in factor.items() if abs(power) > 1e-12}
    formula = ClosedFormula(surrogate.column, variables, factor, (), (), {})
    ratio = column / product(factor, values)
    edges = surrogate.values_of(edge_points(surrogate, values))[0]
    quotient = _best_quotient(
        _values_at(powers, variables, values), ratio, _values_at(powers, variables, edges)
    )
    formula = replace(
        formula,
        numerator=_terms(quotient.above_coefficients, powers[quotient.above]),
        denominator=_terms(quotient.below_coefficients, powers[quotient.below]),
    )
    return _prefer_positive_powers(formula, is_group)


def _best_quotient(values: np.ndarray, ratio: np.ndarray, edge_values: np.ndarray) -> Quotient:
    """Return the quotient with the fewest terms within the wanted error, or the most accurate one.

    See `TermSearch` for the parameters.
    """
    searches = [
        TermSearch(values, ratio, edge_values, has_denominator) for has_denominator in (False, True)
    ]
    quotients = []
    for _ in range(max(1, min(MAX_COEFFICIENTS, len(ratio) // ROWS_PER_COEFFICIENT))):
        quotients += [search.extended() for search in searches]
        if min(quotient.error for quotient in quotients) <= WANTED_ERROR:
            break
    quotients += [search.shortened(WANTED_ERROR) for search in searches]
    wanted = [quotient for quotient in quotients if quotient.error <= WANTED_ERROR]
    if wanted:
        return min(wanted, key=lambda quotient: (quotient.count, quotient.error))
    return min(quotients, key=lambda quotient: quotient.error)


def _candidate_powers(is_group: Sequence[bool]) -> np.ndarray:
    """Return powers of up to two groups and one dimensionless key, small powers first."""
    for step, largest in POWERS:
        exponents = np.arange(-largest, largest + step / 2, step)
        powers = _possible_powers(exponents, is_group)
        if len(powers) <= MAX_CANDIDATES:
            break
    return np.array(powers[:MAX_CANDIDATES])


def _possible_powers(
    exponents: np.ndarray, is_group: Sequence[bool], largest_key_power: int = MAX_KEY_POWER
) -> list[tuple[float, ...]]:
    """Return all powers of up to two groups and one dimensionless key, small powers first."""
    groups = [place for place, flag in enumerate(is_group) if flag]
    keys = [place for place, flag in enumerate(is_group) if not flag]
    key_powers = [
        {place: float(power)} for place in keys for power in range(1, largest_key_power + 1)
    ]
    rows = set()
    for places in combinations(groups, min(2, len(groups))):
        for values in all_tuples(exponents, repeat=len(places)):
            chosen = dict(zip(places, map(float, values), strict=True))
            for key_power in ({}, *key_powers):
                row = chosen | key_power
                rows.add(tuple(row.get(place, 0.0) for place in range(len(is_group))))
    return sorted(rows, key=lambda row: (sum(map(abs, row)), row))


def _values_at(
    powers: np.ndarray, variables: Sequence[Mapping[str, float]], values: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the values of candidate terms at values of the keys; (rows, terms)."""
    points = np.column_stack([product(group, values) for group in variables])
    return np.column_stack([np.prod(points**exponents, axis=1) for exponents in powers])


def _leading_powers(points: np.ndarray, is_group: Sequence[bool], scaled: np.ndarray) -> np.ndarray:
    """Return the powers of the groups whose product alone has the smallest relative error.

    Parameters
    ----------
    points
        Values of the variables; (rows, variables).
    is_group
        For each variable whether it is a group, whose power may be any number.
    scaled
        The column divided by its scale; (rows,).
    """
    step, largest = FACTOR_POWERS
    exponents = np.arange(-largest, largest + step / 2, step)
    powers = np.array(_possible_powers(exponents, is_group, largest_key_power=0))
    columns = np.column_stack([np.prod(points**row, axis=1) for row in powers]) / scaled[:, None]
    share = columns.sum(axis=0) ** 2 / (columns**2).sum(axis=0)
    return np.asarray(powers[int(np.argmax(share))])


def _terms(coefficients: np.ndarray, powers: np.ndarray) -> tuple[Term, ...]:
    """Return the terms of a sum, small powers first."""
    order = np.argsort(np.abs(powers).sum(axis=1), kind="stable")
    return tuple(
        Term(float(coefficients[place]), tuple(map(float, powers[place]))) for place in order
    )


def _prefer_positive_powers(formula: ClosedFormula, is_group: Sequence[bool]) -> ClosedFormula:
    """Return the formula with the reciprocals of groups whose powers are mostly negative."""
    terms = (*formula.numerator, *formula.denominator)
    powers = np.array([term.powers for term in terms])
    signs = np.where(np.array(is_group) & (powers.sum(axis=0) < 0), -1.0, 1.0)

    def turned(part: Sequence[Term]) -> tuple[Term, ...]:
        # Adding 0.0 makes a zero of -0.0.
        return tuple(
            replace(term, powers=tuple(map(float, signs * term.powers + 0.0))) for term in part
        )

    variables = tuple(
        {key: float(sign) * power for key, power in group.items()}
        for group, sign in zip(formula.variables, signs, strict=True)
    )
    return replace(
        formula,
        variables=variables,
        numerator=turned(formula.numerator),
        denominator=turned(formula.denominator),
    )
