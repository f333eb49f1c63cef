"""Indentation cycle: loading, hold and unloading of a curve, its noise and its works."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from indent_sim.model.work import Work, work_of_rows
from indent_sim.process.errors import UsageError

# Smallest number of rows from which the noise is estimated; the noise of a shorter curve counts as
# zero.
MIN_ROWS_OF_NOISE = 30
# The largest force and depth must exceed this multiple of their noise.
MIN_SIGNAL_TO_NOISE = 10.0
# If a curve does not return to zero force, its works are completed by the power law, provided that
# its last force is at most this fraction of the largest.
MAX_LAST_FORCE = 0.25


@dataclass(frozen=True)
class IndentationCycle:
    """Rows of a curve in the order of time, and where its hold and its unloading begin.

    Attributes
    ----------
    h
        Depths (n,) [length] from first contact.
    F
        Forces (n,) [force], > 0 pushing.
    start
        Row at which unloading starts: the last row of the hold, or the row of the largest force.
    end
        First row after unloading.
    hold_start
        First row of a hold at constant force; None without a hold.
    F_noise, h_noise
        Standard deviations of the scatter of force and depth from row to row; 0 if unknown.
    notes
        Sentences about rows that were left out.
    """

    h: np.ndarray
    F: np.ndarray
    start: int
    end: int
    hold_start: int | None
    F_noise: float
    h_noise: float
    notes: tuple[str, ...] = ()

    @property
    def h_max(self) -> float:
        """Depth at which unloading starts [length]."""
        return float(self.h[self.start])

    @property
    def F_max(self) -> float:
        """Force at which unloading starts [force]."""
        return float(self.F[self.start])

    @property
    def last_force(self) -> float:
        """Force at the end of unloading [force]; 0 if it is not positive."""
        return max(float(self.F[self.end - 1]), 0.0)

    @property
    def creep(self) -> float | None:
        """Change of depth in the hold, divided by the depth at its beginning, or None."""
        if self.hold_start is None:
            return None
        h_1 = float(self.h[self.hold_start])
        return (self.h_max - h_1) / h_1 if h_1 > 0 else None

    @property
    def total_work(self) -> Work | None:
        """Work of loading and hold; None if the curve begins with unloading or under load."""
        # If the first force is below this fraction of the largest, the work before it is
        # negligible.
        largest_first_force = 0.05
        if self.start == 0 or self.F[0] > largest_first_force * self.F_max:
            return None
        h = self.h[: self.start + 1]
        F = self.F[: self.start + 1]
        if h[0] > 0:
            h = np.concatenate([[0.0], h])
            F = np.concatenate([[0.0], F])
        return work_of_rows(h, F)

    @property
    def unloading_work(self) -> Work:
        """Work that unloading returns until the force vanishes, or until its last row."""
        rows = slice(self.start, self._end_of_contact)
        h = self.h[rows]
        F = self.F[rows]
        if self._end_of_contact < self.end:
            h = np.append(h, self._zero_crossing)
            F = np.append(F, 0.0)
        return work_of_rows(h[::-1], F[::-1])

    @property
    def h_p(self) -> float | None:
        """Depth at which the force of unloading vanishes [length]; None if it never does."""
        if self._end_of_contact < self.end:
            return self._zero_crossing
        # A force below this fraction of the largest one counts as zero.
        vanishing_force = 1e-3
        is_zero = self.last_force <= vanishing_force * self.F_max
        return float(self.h[self.end - 1]) if is_zero else None

    @property
    def _end_of_contact(self) -> int:
        """First row of unloading whose force is not positive; `end` if all forces are positive."""
        negative = np.flatnonzero(self.F[self.start : self.end] <= 0)
        return self.start + int(negative[0]) if len(negative) else self.end

    @property
    def _zero_crossing(self) -> float:
        """Depth at which the force vanishes, interpolated linearly [length]."""
        after = self._end_of_contact
        F_before, F_after = self.F[after - 1 : after + 1]
        h_before, h_after = self.h[after - 1 : after + 1]
        return float(h_before + (h_after - h_before) * F_before / (F_before - F_after))

    def upper_part(self, low: float, high: float) -> slice:
        """Return the rows of unloading from the fraction `high` of the largest force to `low`.

        Raises UsageError if unloading ends above the fraction `low`.
        """
        fraction = self.F[self.start : self.end] / self.F_max
        if fraction.min() > low * (1 + 1e-9):
            raise UsageError(
                f"unloading ends at {fraction.min():.0%} of the largest force, but it is to be "
                f"fitted down to {low:.0%}",
                "choose another part with --top, for example --top "
                f"98:{ceil(100 * fraction.min())}",
            )
        begin = int(np.argmax(fraction <= high))
        last = int(np.flatnonzero(fraction >= low)[-1])
        return slice(self.start + begin, self.start + max(last, begin) + 1)


def indentation_cycle(h: np.ndarray, F: np.ndarray, is_measured: bool = True) -> IndentationCycle:
    """Find hold and unloading in a curve.

    Parameters
    ----------
    h, F
        Depths and forces (n,) in the order of time.
    is_measured
        False for a computed curve, which has no noise.

    Raises
    ------
    UsageError
        If there is no unloading after the largest force, force or depth are not above their noise,
        or the force falls while the depth is held.
    """
    F_noise = noise_of(F) if is_measured else 0.0
    h_noise = noise_of(h) if is_measured else 0.0
    _check_signal("force", float(F.max(initial=0.0)), F_noise)
    peak = int(np.argmax(F))
    _check_signal("depth", float(h[peak]), h_noise)
    hold_start, start = _hold(F, peak, F_noise)
    end = _end_of_unloading(F, start, F_noise)
    notes: tuple[str, ...] = ()
    if end < len(F):
        notes = (
            f"unloading ends at row {end} of {len(F)}: the force rises again, and later rows are "
            "left out",
        )
    cycle = IndentationCycle(h, F, start, end, hold_start, F_noise, h_noise, notes)
    # If the force does not fall below this fraction of the largest one, the curve has no unloading.
    unloaded_fraction = 0.9
    lowest = float(F[start:end].min()) / cycle.F_max
    if lowest > unloaded_fraction:
        raise UsageError(
            f"the curve has no unloading: after the largest force it falls to {lowest:.0%} of it",
            "give a curve with loading and unloading, in the order of time",
        )
    _refuse_relaxation(cycle)
    return cycle


@dataclass(frozen=True)
class CreepRate:
    """Rate of the depth at the end of a hold at constant force.

    Attributes
    ----------
    value
        Mean rate over the last third of the hold [length/time].
    error
        Half-width of the 95 % interval, from the scatter of the samples [length/time].
    relative_stiffness
        Ratio of `value` to the rate of the force at the beginning of unloading [length/force].
        Multiplied by the stiffness S, it is the relative change of S due to creep.
    """

    value: float
    error: float
    relative_stiffness: float


def creep_rate(cycle: IndentationCycle, t: np.ndarray, unloading: slice) -> CreepRate | None:
    """Return the rate of the depth at the end of the hold; None if it is unknown.

    The rate is unknown if the cycle has no hold, or if the hold has too few rows.

    Parameters
    ----------
    cycle
        The cycle.
    t
        Times of its rows (n,).
    unloading
        Rows of unloading from which the rate of the force is taken.
    """
    if cycle.hold_start is None:
        return None
    hold = np.arange(cycle.hold_start, cycle.start + 1)
    duration = float(t[hold[-1]] - t[hold[0]])
    used = hold[t[hold] >= t[hold[-1]] - duration / 3.0]
    # A line needs a third row for its scatter.
    min_rows = 3
    fall = float(np.ptp(cycle.F[unloading]))
    passed = float(np.ptp(t[unloading]))
    if len(used) < min_rows or not (duration > 0 and fall > 0 and passed > 0):
        return None
    rate, error = _line(t[used], cycle.h[used])
    return CreepRate(rate, error, rate * passed / fall)


def _line(t: np.ndarray, h: np.ndarray) -> tuple[float, float]:
    """Return the slope of a regression line and the half-width of its 95 % interval."""
    time = t - t.mean()
    depth = h - h.mean()
    square = float(time @ time)
    if not square > 0:
        raise UsageError("the times of a hold do not increase", "check the column of times")
    rate = float(time @ depth) / square
    residual = depth - rate * time
    return rate, 1.96 * float(np.sqrt(residual @ residual / (len(t) - 2) / square))


@dataclass(frozen=True)
class LowForceHold:
    """Hold at a small constant force during unloading, in which the depth drifts.

    Attributes
    ----------
    rate
        Rate of the depth [length/time].
    error
        Half-width of the 95 % interval of the rate by the scatter of the samples [length/time].
    duration
        Duration of the hold [time].
    force_fraction
        Force of the hold divided by the largest force.
    """

    rate: float
    error: float
    duration: float
    force_fraction: float


def low_force_hold(t: np.ndarray, h: np.ndarray, F: np.ndarray) -> LowForceHold:
    """Return the hold at low force after the largest force, with its drift of the depth.

    The first fifth of the hold, in which the sample still recovers, is left out.

    Parameters
    ----------
    t, h, F
        Times, depths and forces (n,) in the order of time.

    Raises
    ------
    UsageError
        If there is no such hold.
    """
    noise = noise_of(F)
    largest = float(F.max(initial=0.0))
    _check_signal("force", largest, noise)
    after = np.arange(int(np.argmax(F)), len(F))
    # Holds for the drift are at 10 % of the largest force; at more than 30 % the sample recovers.
    low = after[(F[after] > 0.02 * largest) & (F[after] < 0.3 * largest)]
    scatter = max(4 * noise, 2e-3 * largest)
    rows = _longest_plateau(F, low, scatter)
    # Part of the hold that is left out, and smallest number of rows of a hold.
    recovery = 0.2
    min_rows = 20
    # Without a hold, unloading passes the scatter in this fraction of the rows of its low part.
    passing = 2 * scatter / (0.28 * largest) * len(low)
    if len(rows) < max(min_rows, 3 * passing):
        raise UsageError(
            "--drift hold needs a hold at 2 to 30 % of the largest force, after this force was "
            "reached, but the curve has none",
            "give the rate, for example --drift '0.05 nm/s'",
        )
    used = rows[t[rows] >= t[rows[0]] + recovery * (t[rows[-1]] - t[rows[0]])]
    return LowForceHold(
        *_line(t[used], h[used]),
        float(t[rows[-1]] - t[rows[0]]),
        float(np.median(F[rows])) / largest,
    )


def _longest_plateau(F: np.ndarray, rows: np.ndarray, scatter: float) -> np.ndarray:
    """Return the longest run of rows whose forces stay within a scatter of their median."""
    if not len(rows):
        return rows
    # The level at which most forces lie is the middle of the narrowest half-open window of the
    # sorted forces that has the most of them.
    ordered = np.sort(F[rows])
    counts = np.searchsorted(ordered, ordered + 2 * scatter, side="right") - np.arange(len(ordered))
    level = float(ordered[int(np.argmax(counts))]) + scatter
    held = rows[np.abs(F[rows] - level) <= 1.5 * scatter]
    runs = np.split(held, np.flatnonzero(np.diff(held) > 3) + 1)
    return max(runs, key=len)


def noise_of(values: np.ndarray) -> float:
    """Estimate the standard deviation of the white scatter of a smooth sequence of numbers (n,).

    The standard deviation of fourth differences of white noise is sqrt(70) times that of the noise,
    and fourth differences of a smooth curve nearly vanish; the median ignores the corners of the
    curve. Returns 0 for fewer than MIN_ROWS_OF_NOISE numbers.
    """
    if len(values) < MIN_ROWS_OF_NOISE:
        return 0.0
    # The median of |x| of a normal distribution is 0.6745 of its standard deviation.
    return float(np.median(np.abs(np.diff(values, 4)))) / (0.6745 * 70**0.5)


def _check_signal(name: str, largest: float, noise: float) -> None:
    """Raise UsageError unless the largest force or depth is positive and far above its noise."""
    if not largest > 0:
        raise UsageError(
            f"the largest {name} is {largest + 0.0:.4g}, but it must be positive",
            "forces that push and depths into the body are positive; check the columns, the frame "
            "compliance and the drift",
        )
    if largest < MIN_SIGNAL_TO_NOISE * noise:
        raise UsageError(
            f"the largest {name} {largest:.4g} is not above its noise: the rows scatter by "
            f"{noise:.2g}, and at least {MIN_SIGNAL_TO_NOISE:g} times as much is needed"
        )


def _hold(F: np.ndarray, peak: int, noise: float) -> tuple[int | None, int]:
    """Return the first row of a hold at constant force (or None) and the row at which it ends.

    Without a hold the second number is the row of the largest force.
    """
    largest = float(F[peak])
    # Forces this close to the largest one belong to the hold or to the ends of the ramps.
    near = max(0.01 * largest, 6 * noise)
    distance = largest - F
    below = np.flatnonzero(distance > near)
    first = int(below[below < peak][-1]) + 1 if (below < peak).any() else 0
    last = int(below[below > peak][0]) - 1 if (below > peak).any() else len(F) - 1
    rows = np.arange(first, last + 1)
    level = float(np.median(F[rows]))
    scatter = max(3 * noise, 1e-3 * largest)
    held = rows[np.abs(F[rows] - level) <= scatter]
    # In a curve without a hold, two ramps at a constant rate have a fraction of about 2
    # scatter/largest of all rows near the largest force, and those at the rates just below it pass
    # the scatter in `passing` rows; a hold must have more. A ramp that is rounded like a sine has
    # three times as many rows within the scatter as at these rates.
    passing = np.count_nonzero((distance > near) & (distance <= 3 * near)) * scatter / near
    min_rows = max(10.0, min((0.04 + 2 * scatter / largest) * len(F), 5 * passing))
    if len(held) < min_rows:
        return None, peak
    # In a hold the forces scatter around the median. The last row above the median ends it, since
    # later ones belong to unloading.
    return int(held[0]), int(held[F[held] >= level][-1])


def _end_of_unloading(F: np.ndarray, start: int, noise: float) -> int:
    """Return the row after the smallest force before the force rises again."""
    unloading = F[start:]
    lowest = np.minimum.accumulate(unloading)
    # The force rises again if it exceeds the smallest force so far by this much.
    rise = max(0.05 * float(F[start]), 6 * noise)
    again = np.flatnonzero(unloading > lowest + rise)
    stop = int(again[0]) if len(again) else len(unloading)
    if stop == len(unloading):
        return len(F)
    return start + int(np.argmin(unloading[:stop])) + 1


def _refuse_relaxation(cycle: IndentationCycle) -> None:
    """Raise UsageError if the force decreases although the depth is constant or increases.

    This happens if the body relaxes or creeps.
    """
    rows = slice(cycle.start, cycle.end)
    h = cycle.h[rows]
    F = cycle.F[rows]
    is_below_half = cycle.F_max - F >= 0.5 * cycle.F_max
    half = int(np.argmax(is_below_half)) if is_below_half.any() else len(F) - 1
    recovery = float(h[0] - h[half])
    slope = float(F[0] - F[half]) / recovery if recovery > 0 else 0.0
    tolerance = 4 * cycle.h_noise + 1e-4 * cycle.h_max
    # With noise the largest force may come before the deepest row.
    last = int(np.flatnonzero(h >= h.max() - tolerance)[-1])
    fall = float(F[0] - F[last])
    # Fraction of the force that may be lost, in addition to the decrease by unloading within the
    # tolerance of the depth.
    accepted_fall = 0.02
    if fall > accepted_fall * cycle.F_max + 3 * tolerance * slope + 6 * cycle.F_noise:
        raise UsageError(
            f"after its largest value the force falls by {fall / cycle.F_max:.1%} while the depth "
            "does not decrease: the body relaxes or creeps, and the slope is not its stiffness",
            "hold the force before unloading, or unload faster",
        )
