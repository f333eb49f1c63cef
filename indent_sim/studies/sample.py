"""Samples of the ranges of a study: Sobol sequences and Latin hypercubes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.config.scene_file import SourceLocation
from indent_sim.config.scene_sections import Source
from indent_sim.process.errors import ConfigError
from indent_sim.studies.parameter_values import ParameterPoint, StiffnessMultiple

SAMPLE_KEYS = ("method", "count", "seed")
SAMPLE_METHODS = ("sobol", "latin_hypercube")
# Largest number of points of a sample. A Latin hypercube is made as a whole, in memory.
MAX_SAMPLE_POINTS = {"sobol": 1_000_000, "latin_hypercube": 100_000}
# Largest number of keys that are sampled together.
MAX_SAMPLED_KEYS = 50


@dataclass(frozen=True)
class SampledRange:
    """Range of a key whose values are sampled.

    Attributes
    ----------
    key, first, last
        The key, and the ends of its range.
    is_logarithmic
        True if the logarithm of the value is uniform.
    is_stiffness
        True if the values are multiples of E*/h_contact.
    location
        File and line of the range.
    """

    key: str
    first: float
    last: float
    is_logarithmic: bool
    is_stiffness: bool
    location: SourceLocation

    def values_at(self, fractions: np.ndarray) -> np.ndarray:
        """Return the values at fractions (0 to 1) of the range."""
        if self.is_logarithmic:
            return np.asarray(self.first * (self.last / self.first) ** fractions)
        return np.asarray(self.first + (self.last - self.first) * fractions)

    def fractions_of(self, values: np.ndarray) -> np.ndarray:
        """Return the fractions of the range at given values; the inverse of `values_at`."""
        if self.is_logarithmic:
            return np.asarray(np.log(values / self.first) / np.log(self.last / self.first))
        return np.asarray((values - self.first) / (self.last - self.first))


@dataclass(frozen=True)
class Sample:
    """Sample of several ranges together.

    Attributes
    ----------
    method
        "sobol": more points continue the sequence; "latin_hypercube": another number of points is
        another sample.
    count, seed
        Number of points, and the seed of the random numbers.
    ranges
        The sampled ranges.
    """

    method: str
    count: int
    seed: int
    ranges: tuple[SampledRange, ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """The sampled keys."""
        return tuple(sampled.key for sampled in self.ranges)

    def points(self) -> Iterator[ParameterPoint]:
        """Yield the points of the sample."""
        left = self.count
        for block in self._blocks():
            columns = [
                _values(sampled, fractions[:left])
                for sampled, fractions in zip(self.ranges, block.T, strict=True)
            ]
            settings = [
                [(sampled.key, value, sampled.location) for value in column]
                for sampled, column in zip(self.ranges, columns, strict=True)
            ]
            yield from zip(*settings, strict=True)
            left -= len(block)
            if left <= 0:
                return

    def _blocks(self) -> Iterator[np.ndarray]:
        """Yield points of the unit cube in blocks; (rows, ranges)."""
        # This import takes a second, which studies without a sample need not spend.
        from scipy.stats import qmc

        dimension = len(self.ranges)
        if self.method == "latin_hypercube":
            yield qmc.LatinHypercube(dimension, seed=self.seed).random(self.count)
            return
        yield from scrambled_blocks(dimension, self.seed)


def scrambled_blocks(dimension: int, seed: int) -> Iterator[np.ndarray]:
    """Yield the points of a scrambled Sobol sequence in the unit cube, in blocks of 1024."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(dimension, seed=seed)
    # The number of points in a block is a power of 2, as a Sobol sequence requires.
    block_size = 1024
    while True:
        yield sequence.random(block_size)


def _values(sampled: SampledRange, fractions: np.ndarray) -> list[float | StiffnessMultiple]:
    """Return the values of a sampled key, rounded like those of ranges that are not sampled."""
    values = [float(f"{value:.12g}") for value in sampled.values_at(fractions).tolist()]
    return [StiffnessMultiple(value) for value in values] if sampled.is_stiffness else list(values)


def read_sample(section: Mapping[str, Any], source: Source) -> Sample:
    """Read the section `sample` of a study; raise ConfigError if it is invalid."""
    if unknown := [key for key in section if key not in SAMPLE_KEYS]:
        raise _sample_error(
            unknown[0], source, "unknown key", f"the keys of a sample are {', '.join(SAMPLE_KEYS)}"
        )
    method = section.get("method", "sobol")
    if method not in SAMPLE_METHODS:
        raise _sample_error("method", source, f"must be {' or '.join(SAMPLE_METHODS)}")
    count = section.get("count")
    seed = section.get("seed", 0)
    if type(count) is not int or not 1 <= count <= MAX_SAMPLE_POINTS[method]:
        raise _sample_error(
            "count", source, f"must be a whole number from 1 to {MAX_SAMPLE_POINTS[method]}"
        )
    if type(seed) is not int or not 0 <= seed < 2**32:
        raise _sample_error("seed", source, "must be a whole number from 0 to 4294967295")
    return Sample(method, count, seed)


def _sample_error(key: str, source: Source, problem: str, remedy: str = "") -> ConfigError:
    """Return the ConfigError for a key of the sample."""
    return ConfigError(f"sample.{key}", problem, remedy, *source.location(("sample", key)))
