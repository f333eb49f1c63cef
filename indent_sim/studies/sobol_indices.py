"""Sobol indices: shares of the variance of a result that its keys cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.studies.sample import Sample, scrambled_blocks
from indent_sim.studies.study_file import StudyFile
from indent_sim.studies.surrogate import Surrogate

# Number of independently scrambled sequences, whose scatter gives the error, and of blocks of 1024
# points in each.
REPLICATES = 8
BLOCKS = 8
# Student's factor of a 95 % interval for REPLICATES - 1 degrees of freedom.
STUDENT_FACTOR = 2.365
Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices of a function of independent uniform variables; each (variables,).

    Attributes
    ----------
    first
        Share of the variance that a variable causes alone.
    total
        Share of the variance that a variable causes alone or together with others.
    error
        Half-width of the 95 % intervals of both indices.
    """

    first: np.ndarray
    total: np.ndarray
    error: np.ndarray


def sobol_indices(function: Function, dimension: int) -> SobolIndices:
    """Return the Sobol indices of a function of points (rows, dimension) of the unit cube.

    The indices are estimated with the formulas of Saltelli (first) and Jansen (total).
    """
    estimates = np.array([_estimate(function, dimension, seed) for seed in range(REPLICATES)])
    first, total = estimates.mean(axis=0)
    scatter = estimates.std(axis=0, ddof=1) / np.sqrt(REPLICATES)
    return SobolIndices(first, total, STUDENT_FACTOR * scatter.max(axis=0))


def indices_of_study(study: StudyFile, surrogate: Surrogate) -> dict[str, dict[str, float]]:
    """Return the Sobol indices of a surrogate over the ranges of a sampled study, by key.

    The error includes the error of the surrogate.

    Raises
    ------
    UsageError
        The keys are not independent or not all sampled.
    """
    sample = _sample_of(study)

    def function(fractions: np.ndarray) -> np.ndarray:
        values: Mapping[str, np.ndarray] = {
            part.key: part.values_at(column)
            for part, column in zip(sample.ranges, fractions.T, strict=True)
            if part.key in surrogate.ranges
        }
        return surrogate(values)

    indices = sobol_indices(function, len(sample.ranges))
    # If the error of the surrogate has the share q of the variance, it changes the standard
    # deviation that a variable causes by at most sqrt(q), and the whole variance by a share of at
    # most 2 sqrt(q) + q.
    share = float(surrogate.error["variance_share"])
    own_error = 2 * np.sqrt(share * np.abs(indices.total)) + share
    own_error += np.abs(indices.total) * (2 * np.sqrt(share) + share)
    return {
        key: {"first": float(first), "total": float(total), "error": float(error)}
        for key, first, total, error in zip(
            sample.keys, indices.first, indices.total, indices.error + own_error, strict=True
        )
    }


def _sample_of(study: StudyFile) -> Sample:
    """Return the sample of a study; raise UsageError if its keys are not independent."""
    samples = [block.sample for block in study.blocks]
    sample = samples[0] if len(samples) == 1 else None
    if sample is None or study.blocks[0].axes:
        raise UsageError("Sobol indices need a study whose keys are all sampled")
    if study.left_out_count():
        raise UsageError("Sobol indices need independent keys: `where` leaves points out")
    return sample


def _estimate(function: Function, dimension: int, seed: int) -> np.ndarray:
    """Return first and total indices from one scrambled sequence; (2, dimension)."""
    blocks = islice(scrambled_blocks(2 * dimension, seed), BLOCKS)
    points = np.concatenate(list(blocks))
    a = points[:, :dimension]
    b = points[:, dimension:]
    values_a = function(a)
    values_b = function(b)
    mean = (values_a.mean() + values_b.mean()) / 2
    variance = np.concatenate([values_a, values_b]).var()
    estimates = np.zeros((2, dimension))
    if variance == 0:
        return estimates
    for i in range(dimension):
        mixed = a.copy()
        mixed[:, i] = b[:, i]
        difference = function(mixed) - values_a
        estimates[0, i] = np.mean((values_b - mean) * difference) / variance
        estimates[1, i] = np.mean(difference**2) / 2 / variance
    return estimates
