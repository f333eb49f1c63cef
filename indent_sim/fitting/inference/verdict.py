"""Verdict: whether a scene explains a curve, and the interval that is stated for each parameter.

It does not where the residuals have a shape, where a window's fit moves, where the contact is
noisier than the baseline, or where another model is better. The interval is then widened until
nothing contradicts it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from indent_sim.fitting.inference.estimate import Estimate, Model, deviation
from indent_sim.fitting.inference.models import Other
from indent_sim.fitting.inference.noise import NORMAL_95, averaged, f_test, gain
from indent_sim.fitting.inference.windows import Window

# that a shape is looked for with, from so many depths before contact on
COSINES = 8
BEFORE = 0.35
NEAR_CONTACT = 0.2  # depths before first touch that are no baseline
# points before contact, of a baseline that tells its noise
FEWEST_BEFORE_CONTACT = 40
LEAST_EFFECTIVE = 8.0
# Where other models are asked
SUSPECT_SHAPE = 1e-2
SUSPECT_POWER = 1e-2
SUSPECT_SNAP = 1e-3
SUSPECT_Z = 2.5
SUSPECT_BASELINE = 1e-3
# where the scene does not explain the curve
WRONG_SHAPE = 1e-3
WRONG_Z = 3.5
WRONG_BASELINE = 1e-4
NAMED = 1e-3
MEDIAN_TO_DEVIATION = 1.4826  # of normal numbers
NEGLIGIBLE = 1e-5  # of the largest force: residuals that say nothing
UNKNOWN_FACTOR = 3.0  # an interval beyond it is none


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Verdict:
    """A fit judged: what the residuals, windows and other models say of it.

    uncertain: half-widths of each coordinate from the mesh and from calibration (k,), added in
    quadrature.
    """

    estimate: Estimate
    windows: list[Window]
    p_shape: float
    p_baseline: float | None
    others: list[Other] = field(default_factory=list)
    uncertain: tuple[float, ...] = ()

    @property
    def named(self) -> list[Other]:
        """The models that are better than the scene's by more than accident."""
        return [one for one in self.others if one.p < NAMED]

    @cached_property
    def cause(self) -> list[str]:
        """What stands against the scene: names of models, and shape, window, baseline; nothing
        where the residuals are those of arithmetic, as of a curve that was simulated.
        """
        if self.estimate.rms < NEGLIGIBLE * self.estimate.rise:
            return []
        moved = any(self._moves(k) for k in range(self.estimate.model.size))
        noisy = self.p_baseline is not None and self.p_baseline < WRONG_BASELINE
        told = {"shape": self.p_shape < WRONG_SHAPE, "window": moved, "baseline": noisy}
        return [*(one.name for one in self.named), *(name for name, is_so in told.items() if is_so)]

    def _moves(self, k: int) -> bool:
        """Whether a window's value lies too far off, or its own interval misses that of the whole
        curve.
        """
        low, high = self._uncertain(k, *self.statistical(k))
        for window in self.windows:
            own_low, own_high = window.interval(k)
            if abs(window.z[k]) > WRONG_Z or own_high < low or own_low > high:
                return True
        return False

    @property
    def explained(self) -> bool:
        """Whether nothing stands against the scene."""
        return not self.cause

    def statistical(self, k: int) -> tuple[float, float]:
        """The interval of a coordinate by noise alone."""
        return self.estimate.interval(k)

    def interval(self, k: int) -> tuple[float, float]:
        """The stated interval of a coordinate: with mesh and calibration; spanning all windows and
        the named models where the scene does not explain the curve.
        """
        low, high = self.statistical(k)
        if not self.explained:
            low = min([low, *(float(window.theta[k]) for window in self.windows)])
            high = max([high, *(float(window.theta[k]) for window in self.windows)])
            for other in self.named:
                other_low, other_high = other.estimate.interval(k)
                low = min(low, other_low)
                high = max(high, other_high)
        low, high = self._uncertain(k, low, high)
        least, most = self.estimate.model.forces.parameters[k].bounds
        return max(low, least), min(high, most)

    def _uncertain(self, k: int, low: float, high: float) -> tuple[float, float]:
        """An interval with mesh and calibration in quadrature."""
        value = float(self.estimate.theta[k])
        more = self.uncertain[k] if self.uncertain else 0.0
        return value - math.hypot(value - low, more), value + math.hypot(high - value, more)

    def stated(self, k: int) -> Interval:
        """Value and interval of a varied key, in the scene's units."""
        one = self.estimate.model.forces.parameters[k]
        ends = (one.value(end) for end in self.interval(k))
        return Interval(one.value(float(self.estimate.theta[k])), *ends)

    @property
    def identifiable(self) -> bool:
        """Whether every parameter is known to a factor of three and lies inside its range."""
        keys = range(self.estimate.model.size)
        return not any(self.estimate.at_bound(k) or self._factor(k) > UNKNOWN_FACTOR for k in keys)

    def _factor(self, k: int) -> float:
        stated = self.stated(k)
        ends = (abs(stated.high), abs(stated.value), abs(stated.low))
        if self.estimate.model.forces.parameters[k].is_linear or min(ends) == 0:
            return 1.0
        return max(ends[0] / ends[1], ends[1] / ends[2])


@dataclass(frozen=True)
class Bends:
    """Probabilities that the residuals bend so by accident: in any shape, along another power of
    the depth, and in a fall between two samples, as where a tip snaps in.
    """

    shape: float
    power: float
    snap: float


def is_suspect(windows: Sequence[Window], bends: Bends, p_baseline: float | None) -> bool:
    """Whether other models are worth asking."""
    moves = any(np.any(np.abs(window.z) > SUSPECT_Z) for window in windows)
    noisy = p_baseline is not None and p_baseline < SUSPECT_BASELINE
    bent = bends.shape < SUSPECT_SHAPE or bends.power < SUSPECT_POWER or bends.snap < SUSPECT_SNAP
    return moves or noisy or bent


def bends_of(estimate: Estimate) -> Bends:
    """F tests of eight cosines in the contact, and of the one direction F ln(delta/depth), in which
    thickness, adhesion and other tips bend a curve, where eight waves may see nothing.

    The noise is found with and without the cosines; of the shape the larger probability counts,
    since either may take one for the other. The power is tested beside them: it only asks.
    """
    model = estimate.model
    p = estimate.ordinary
    J = model.jacobian(p)[:, model.free]
    r = model.residual(p)
    c = estimate.contact_point
    x = model.samples.x
    begin = c - BEFORE * estimate.depth
    end = float(x.max())
    u = np.clip((x - begin) / (end - begin), 0.0, 1.0)
    waves = np.column_stack(
        [np.where(x >= begin, np.cos(np.pi * k * u), 0.0) for k in range(1, COSINES + 1)]
    )
    beside = averaged(np.column_stack([J, waves]), r).likeliest
    shape = max(gain(J, waves, r, noise) for noise in {beside, estimate.found.likeliest})
    snap = 1.0 if model.forces.adheres else _snap(model.samples.force[np.argsort(x, kind="stable")])
    return Bends(shape, gain(J, _along_power(model, p)[:, None], r, beside), snap)


def _snap(force: np.ndarray) -> float:
    """The probability of the largest fall between two samples (n,) in order of depth, their median
    being that of noise.

    Slow noise, which hides the attraction before and after it, does not hide the fall itself.
    """
    changes = np.diff(force)
    deviation = MEDIAN_TO_DEVIATION * float(np.median(np.abs(changes)))
    if not deviation > 0:  # a curve of few digits, or none at all
        return 1.0
    return min(
        1.0, 0.5 * len(changes) * math.erfc(-float(changes.min()) / deviation / math.sqrt(2.0))
    )


def _along_power(model: Model, p: np.ndarray) -> np.ndarray:
    """F ln(delta/depth): by which a force changes with the exponent of the depth."""
    force = model.contact(p)
    delta = model.samples.x - p[model.size] - model.forces.experiment.compliance * force
    return force * np.log(np.maximum(delta / max(float(delta.max()), 1e-300), 1e-9))  # type: ignore[no-any-return]


def baseline_of(estimate: Estimate) -> float | None:
    """The probability that the contact is as noisy as the baseline by accident; None where the
    baseline is short.
    """
    model = estimate.model
    r = estimate.residual
    c = estimate.contact_point
    x = model.samples.x
    before = (
        x < c - NEAR_CONTACT * estimate.depth
    )  # a tip that snaps in is missed by its model there
    n = int(np.count_nonzero(before))
    m = int(np.count_nonzero(~before))
    if n < FEWEST_BEFORE_CONTACT or not m:
        return None
    line = np.column_stack([np.ones(n), x[before] - x[before].mean()])
    found = averaged(line, r[before])
    if n / found.likeliest.samples < LEAST_EFFECTIVE:
        return None
    inside = float(r[~before] @ found.likeliest.whitened(r[~before])[0])
    return f_test(inside, m, found.s2 * (n - 2), n - 2)


def tied(estimate: Estimate) -> list[float]:
    """Half width of each coordinate over that with all other varied keys known."""
    size = estimate.model.size
    others = [[j for j in range(size) if j != k] for k in range(size)]
    pairs = (
        (deviation(estimate, k), deviation(estimate, k, known)) for k, known in enumerate(others)
    )
    return [whole / max(alone, 1e-300) for whole, alone in pairs]


def shifted(estimate: Estimate, change: np.ndarray) -> np.ndarray:
    """By how much the coordinates move where the modelled force is off by `change` (n,)."""
    model = estimate.model
    noise = estimate.found.likeliest
    J = model.jacobian(estimate.p)[:, model.free]
    VJ = noise.whitened(J)[0]
    return np.abs(np.linalg.lstsq(J.T @ VJ, VJ.T @ change, rcond=1e-13)[0][: model.size])


def half_widths(estimate: Estimate, mesh: float, calibration: float) -> tuple[float, ...]:
    """What a relative error of the force, from the mesh and from calibration at one standard
    deviation, adds, and what its steps in time miss.
    """
    force = estimate.model.contact(estimate.p)
    model = estimate.model
    of = shifted(estimate, math.hypot(mesh, NORMAL_95 * calibration) * force)
    samples = model.samples
    of_steps = shifted(
        estimate, model.forces.missed(estimate.theta, samples.x - estimate.contact_point, samples.t)
    )
    return tuple(np.hypot(of, of_steps).tolist())
