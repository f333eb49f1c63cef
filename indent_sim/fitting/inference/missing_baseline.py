"""Curves without a baseline: those that begin in contact, and those that begin with a toe.

A fit of contact point, level and slope would mistake the beginning of the contact for a tilted
baseline. For a curve with too few samples before contact, level and slope of the baseline are 0. If
the force rises before contact in a curved way (a toe, due to a rough or frayed surface), the
baseline is that of the samples far from the body, and the toe is left out, as in the toe
compensation of compression tests.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from indent_sim.fitting.inference.estimate import Estimate, OriginOptions, Samples
from indent_sim.fitting.inference.model_assessment import MIN_SHAPE_P, find_residual_trend

# Smallest number of samples before contact that count as a baseline.
MIN_BASELINE_POINTS = 20
# The force rises before contact if the mean rise exceeds this many standard errors of white noise,
# and this many standard deviations of the baseline, whose noise may be slow. With these numbers no
# noisy baseline is mistaken for a toe in tests/unit/fitting/test_missing_baseline.py.
CLEAR_RISE = 10.0
CLEAR_NOISE = 5.0
# A fitted baseline that rises over the range of a curve by more than this fraction of the contact
# force is the beginning of the contact.
STEEP_BASELINE = 0.5
# A known baseline is discarded if its residuals exceed those of a free baseline by more than this
# factor.
MAX_RMS_RATIO = 1.2
# A toe is left out up to this fraction of the largest force. Fits with the other two fractions give
# the error of this choice.
TOE_FORCE = 0.3
OTHER_TOE_FORCES = (0.2, 0.4)


@dataclass(frozen=True)
class KnownBaseline:
    """Baseline that is not fitted.

    Attributes
    ----------
    origin
        Options of the contact point and the baseline, with the known baseline.
    samples
        The samples without the toe.
    note
        Sentence for the report that states this baseline.
    other_samples
        Two selections of samples, which leave out a smaller and a larger toe.
    """

    origin: OriginOptions
    samples: Samples
    note: str
    other_samples: tuple[Samples, ...] = ()

    def fits(self, known: Estimate, free: Estimate) -> bool:
        """Return whether the known baseline fits the curve as well as a free one does."""
        return self.origin.has_slope or known.rms < MAX_RMS_RATIO * free.rms


def known_baseline(samples: Samples, estimate: Estimate) -> KnownBaseline | None:
    """Return a baseline that is assumed and not fitted; None if the curve has a baseline.

    Parameters
    ----------
    samples
        The curve.
    estimate
        Fit with a free level and slope.
    """
    origin = estimate.model.origin
    if origin.contact_point is not None or origin.level is not None:
        return None
    order = np.argsort(samples.x, kind="stable")
    x = samples.x[order]
    force = samples.force[order]
    # Second differences are free of the slope of the contact.
    noise = 1.48 * float(np.median(np.abs(np.diff(samples.force, 2)))) / np.sqrt(6.0)
    count = int(np.count_nonzero(x < estimate.contact_point))
    # A baseline that rises by a larger fraction of the force is the beginning of the contact.
    is_steep = float(estimate.p[-1]) > STEEP_BASELINE * estimate.max_force
    if count < MIN_BASELINE_POINTS or is_steep:
        known = _zero_baseline(origin, x, force, noise)
        note = (
            "no baseline: the curve begins in contact. The level and the slope of the baseline "
            "are assumed to be 0; if the force out of contact is not 0, give --level X, or "
            "--contact-point X"
        )
        return KnownBaseline(known, samples, note) if known else None
    if not origin.has_slope:
        return None
    return _baseline_before_toe(estimate, samples, x[:count], force[:count], noise)


def _zero_baseline(
    origin: OriginOptions, x: np.ndarray, force: np.ndarray, noise: float
) -> OriginOptions | None:
    """Return options with a force of zero out of contact, for a curve that begins in contact.

    The result is None if the force does not rise at the beginning of the curve.
    """
    # In contact the force rises from the first sample on: compare the first samples with the next
    # ones.
    m = max(MIN_BASELINE_POINTS, len(x) // 20)
    rise = float(force[m : 2 * m].mean() - force[:m].mean())
    # A difference of two means above this many standard errors is not noise.
    clear = 4.0
    if rise < clear * noise * np.sqrt(2.0 / m):
        return None
    return replace(origin, has_slope=False, level=0.0)


def _baseline_before_toe(
    estimate: Estimate, samples: Samples, x: np.ndarray, force: np.ndarray, noise: float
) -> KnownBaseline | None:
    """Return the baseline of a curve with a toe, by the samples far from the body.

    Parameters
    ----------
    estimate
        The fit.
    samples
        The curve.
    x, force
        Samples before contact (m,), sorted by x.
    noise
        Standard deviation of white noise [force].
    """
    half = len(x) // 2
    if not (noise > 0 and x[half] > x[0]):
        return None
    slope, level, square_sum = _line(x[:half], force[:half])
    distance = float(x[half:].mean() - x[:half].mean())
    rise = float((force[half:] - level - slope * x[half:]).mean())
    error = noise * np.sqrt(1 / half + 1 / (len(x) - half) + distance**2 / square_sum)
    slow_noise = float(np.std(force[:half] - level - slope * x[:half]))
    if rise < max(CLEAR_RISE * error, CLEAR_NOISE * slow_noise):
        return None
    # Slow noise may rise as well; then the scene explains the curve, and there is no toe.
    if find_residual_trend(estimate).shape > MIN_SHAPE_P:
        return None
    # The toe may begin already in the half of the samples that is farther from the body.
    far = max(half // 2, MIN_BASELINE_POINTS // 2)
    slope, level, square_sum = _line(x[:far], force[:far])
    # Standard deviation of the tilt of a baseline over the range of a curve, relative to its force.
    usual_tilt = 0.01
    # The slope of few samples is uncertain: it is shrunk towards 0, its usual value.
    usual = usual_tilt * estimate.max_force / float(np.ptp(estimate.model.samples.x))
    shrinkage = usual**2 / (usual**2 + noise**2 / square_sum)
    level += (1.0 - shrinkage) * slope * float(x[:far].mean())
    slope *= shrinkage
    contact_force = samples.force - level - slope * samples.x
    is_far = samples.x <= x[far - 1]
    without_toe, *others = (
        samples.select(is_far | (contact_force > fraction * estimate.max_force))
        for fraction in (TOE_FORCE, *OTHER_TOE_FORCES)
    )
    return KnownBaseline(
        replace(estimate.model.origin, level=level, slope=slope),
        without_toe,
        "before contact the force rises gradually, which a straight baseline cannot describe (a "
        f"toe): the baseline is that of the {far} samples farthest from the body, {level:.3g} + "
        f"{slope:.3g} x, and the toe, up to {100 * TOE_FORCE:.0f} % of the force, is left out; "
        "--no-slope fits all samples",
        tuple(others),
    )


def _line(x: np.ndarray, force: np.ndarray) -> tuple[float, float, float]:
    """Return slope and intercept of the least-squares line, and the sum of (x - mean(x))^2."""
    centre = float(x.mean())
    square_sum = max(float(((x - centre) ** 2).sum()), 1e-300)
    slope = float(((x - centre) * force).sum()) / square_sum
    return slope, float(force.mean()) - slope * centre, square_sum
