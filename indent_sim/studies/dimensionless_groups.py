"""Dimensionless groups of a study: products of powers of its keys, found from their dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from indent_sim.config.key_dimensions import Dimension

# Powers of keys by their names.
Powers = dict[str, Fraction]
Vector = Sequence[Fraction]
# Largest denominator of a power, which is the quotient of small whole numbers.
MAX_DENOMINATOR = 60


@dataclass(frozen=True)
class Groups:
    """Dimensionless groups, and the product of powers that has the dimension of the result.

    Attributes
    ----------
    varied
        Powers of the keys in each group that varies; a dimensionless key is a group by itself.
    constant
        Powers of the keys in each group that is the same in all runs.
    scale
        Powers of the keys in the scale of the result, a column of the table of the study.
    """

    varied: tuple[Powers, ...]
    constant: tuple[Powers, ...]
    scale: Powers


def find_groups(
    varied: Mapping[str, Dimension], fixed: Mapping[str, Dimension], column: Dimension
) -> Groups:
    """Return the dimensionless groups of varied and fixed keys.

    As many varied keys as possible are eliminated: the groups are formed with fixed keys first and
    with varied keys only for the dimensions that no fixed key has.

    Parameters
    ----------
    varied, fixed
        Dimensions of the keys that vary, and of the fixed keys with a dimension.
    column
        Dimension of the dependent quantity, a column of the table of the study.

    Raises
    ------
    ValueError
        If no product of powers of the keys has the dimension of this column.
    """
    dimensions = {**fixed, **varied}
    repeating: list[str] = []
    for key in [*_preferred_order(fixed), *_preferred_order(varied)]:
        vectors = [_vector(dimensions[name]) for name in [*repeating, key]]
        if _rank(vectors) > len(repeating):
            repeating.append(key)
    basis = [_vector(dimensions[key]) for key in repeating]

    def dimensionless_group(key: str) -> Powers:
        scale = _solve(basis, _vector(dimensions[key]))
        powers = {name: -power for name, power in zip(repeating, scale, strict=True) if power}
        return {key: Fraction(1)} | powers

    scale = _solve(basis, _vector(column))
    return Groups(
        tuple(dimensionless_group(key) for key in varied if key not in repeating),
        tuple(dimensionless_group(key) for key in fixed if key not in repeating),
        {name: power for name, power in zip(repeating, scale, strict=True) if power},
    )


def powers_text(powers: Mapping[str, Fraction | float]) -> str:
    """Return a product of powers as text, such as "loading.delta / indenter.R"."""
    fractions = {
        key: Fraction(power).limit_denominator(MAX_DENOMINATOR) for key, power in powers.items()
    }
    above = [_power_text(key, power) for key, power in fractions.items() if power > 0]
    below = [_power_text(key, -power) for key, power in fractions.items() if power < 0]
    return " / ".join([" ".join(above) or "1", *below])


def _power_text(key: str, power: Fraction) -> str:
    """Return a power of a key as text."""
    return key if power == 1 else f"{key}^{power}"


def _preferred_order(dimensions: Mapping[str, Dimension]) -> list[str]:
    """Return the keys in the order of their elimination: moduli, tip sizes, all other keys."""

    def rank(key: str) -> int:
        _, force, time = dimensions[key]
        if force and not time:
            return 0
        return 1 if key.startswith("indenter.") else 2

    return sorted(dimensions, key=rank)


def _vector(dimension: Dimension) -> list[Fraction]:
    return [Fraction(power) for power in dimension]


def _rank(vectors: Sequence[Vector]) -> int:
    """Return the rank of some vectors, by exact elimination."""
    rows = [list(vector) for vector in vectors]
    rank = 0
    for column in range(len(rows[0]) if rows else 0):
        pivot = next((row for row in rows[rank:] if row[column]), None)
        if pivot is None:
            continue
        rows.remove(pivot)
        rows.insert(rank, pivot)
        for row in rows[rank + 1 :]:
            factor = row[column] / pivot[column]
            row[:] = [a - factor * b for a, b in zip(row, pivot, strict=True)]
        rank += 1
    return rank


def _solve(basis: Sequence[Vector], target: Vector) -> list[Fraction]:
    """Return the coefficients of a vector in an independent basis, or raise ValueError."""
    # Gauss-Jordan elimination of the equations sum_i c_i basis_i = target, one per dimension.
    rows = [[*(vector[i] for vector in basis), target[i]] for i in range(len(target))]
    for column in range(len(basis)):
        pivot = next(row for row in rows[column:] if row[column])
        rows.remove(pivot)
        rows.insert(column, [value / pivot[column] for value in pivot])
        pivot = rows[column]
        for row in rows:
            if row is not pivot and row[column]:
                factor = row[column]
                row[:] = [a - factor * b for a, b in zip(row, pivot, strict=True)]
    if any(row[-1] for row in rows[len(basis) :]):
        raise ValueError("no product of the keys has the dimension of the column")
    return [row[-1] for row in rows[: len(basis)]]
