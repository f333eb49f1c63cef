"""Fits of a map: many curves of one scene, whose modulus is fitted in blocks of curves.

1. Every curve is rejected for a reason, or fitted by ordinary least squares.
2. The baselines of many curves give the noise of the instrument (`pooled_noise`).
3. Every curve is fitted again with weights W that follow from this noise. The covariance of its
   parameters is D V D' with D = (J'WJ)^-1 J'W, for the covariance V of the noise.
4. The residuals are tested for a trend, and the fit to half the depth is compared.

Curves are rejected for the same reasons as single curves (`estimate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.special import fdtrc

from indent_sim.fitting.forward_model.elastic_load_curve import TabulatedLoadCurve
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.inference.baseline import CONTACT_MARGIN
from indent_sim.fitting.inference.depth_range_fits import MIN_DEVIATION_RATIO
from indent_sim.fitting.inference.estimate import (
    MAX_BASELINE_DEPTHS,
    MAX_PILOT_SAMPLES,
    MAX_SATURATED,
    MAX_UNCERTAINTY_FACTOR,
    MIN_BASELINE_FRACTION,
    MIN_CONTACT_POINTS,
    MIN_POINTS,
    MIN_SIGNAL_TO_NOISE,
    SATURATED_FRACTION,
    SIGNAL_BLOCKS,
    CurveModel,
    OriginOptions,
    Samples,
)
from indent_sim.fitting.inference.initial_guess import fit_trials
from indent_sim.fitting.inference.least_squares import minimize_squares
from indent_sim.fitting.inference.model_assessment import (
    MAX_DEPTH_Z,
    MIN_SHAPE_P,
    SUSPICIOUS_DEPTH_Z,
    SUSPICIOUS_SHAPE_P,
    trend_cosines,
)
from indent_sim.fitting.inference.noise import NORMAL_95, WHITE, solve_normal_equations
from indent_sim.fitting.inference.pooled_noise import (
    MAX_BASELINE_SAMPLES,
    MIN_BASELINE_SAMPLES,
    MIN_BASELINES,
    PooledNoise,
    estimate_pooled_noise,
)

# Number of curves that are fitted at once. Their samples fit into the cache of a processor.
BATCH_SIZE = 64
# Number of neighbouring curves in a block. Results are written after each block, at which a killed
# fit continues, and processes fit different blocks. A batch has curves of one block only, so that
# numbers depend neither on kills nor on the number of processes.
BLOCK_SIZE = 1024
# The number of samples is rounded to a multiple of this, so that many curves are equally long.
LENGTH_STEP = 32
# Relative change of the sums of squares at which the fits of a map end.
MAP_TOLERANCE = 1e-6
# The same for fits to a part of the depth: some hundredths of a standard deviation.
DEPTH_RANGE_TOLERANCE = 1e-5

# Largest number of steps by ordinary least squares. Only noise without a contact needs more.
INITIAL_ROUNDS = 12
# Damping of the first step of a fit that begins at the solution for other weights or samples.
NEARLY_UNDAMPED = 1e-6

REASONS = (
    "",
    "not a curve: a number is missing",
    "too few points",
    "no contact: the depth does not change",
    "no contact: the force does not change",
    "saturated: many points at the largest force",
    "no contact: the force does not rise with the depth",
    "no contact: the force does not rise above its noise",
    "no contact: too few points in contact",
    "no contact: no fit was found",
    "the modulus is known to a factor of more than 4 only",
    "the contact is too deep for the thickness or for the solved scene",
    "the bare substrate: the tip does not indent it",
)
ReadSamples = Callable[[int], Samples]
FITTED = 0
INCOMPLETE = 1
FEW_POINTS = 2
CONSTANT_DEPTH = 3
CONSTANT_FORCE = 4
SATURATED = 5
NOT_RISING = 6
NOISY = 7
FEW_IN_CONTACT = 8
NO_FIT = 9
UNCERTAIN = 10
TOO_DEEP = 11
BARE_SUBSTRATE = 12


@dataclass
class PixelFits:
    """Results of the curves of a map, in arrays (N,); NaN for rejected curves.

    Attributes
    ----------
    reason
        Index of REASONS; 0 for a fitted curve.
    theta, theta_sd
        Logarithm of the modulus, and its standard deviation.
    contact_point, contact_point_sd
        Displacement at first contact [length].
    level, slope
        Baseline at the contact point [force], and its slope [force/length].
    max_force, depth
        Largest fitted force [force]; depth without the spring's deflection [length].
    travel
        Displacement of the base from first contact to the deepest sample [length].
    rms
        Root mean square of the residuals [force].
    p_shape
        Probability that the residuals have their trend by chance.
    half_theta, half_z
        Theta of the fit to half the depth, and its difference in standard deviations.
    low_theta, high_theta
        Smallest and largest theta of the fits to parts of the depth.
    point_count
        Number of fitted samples.
    """

    reason: np.ndarray
    theta: np.ndarray
    theta_sd: np.ndarray
    contact_point: np.ndarray
    contact_point_sd: np.ndarray
    level: np.ndarray
    slope: np.ndarray
    max_force: np.ndarray
    depth: np.ndarray
    travel: np.ndarray
    rms: np.ndarray
    p_shape: np.ndarray
    half_theta: np.ndarray
    half_z: np.ndarray
    low_theta: np.ndarray
    high_theta: np.ndarray
    point_count: np.ndarray

    @classmethod
    def empty(cls, count: int) -> PixelFits:
        """Return results without any fit."""
        arrays = _empty_arrays(cls, count, ("reason", "point_count"))
        return cls(**arrays)

    @property
    def is_fitted(self) -> np.ndarray:
        """True for the curves that were fitted (N,)."""
        is_fitted: np.ndarray = self.reason == FITTED
        return is_fitted

    @property
    def is_explained(self) -> np.ndarray:
        """True for the curves that the scene explains (N,)."""
        has_trend = self.p_shape < MIN_SHAPE_P
        is_depth_dependent = np.abs(self.half_z) > MAX_DEPTH_Z
        explained: np.ndarray = self.is_fitted & ~has_trend & ~is_depth_dependent
        return explained


@dataclass
class InitialFits:
    """Fits of the curves of a map by ordinary least squares, in arrays (N, ...).

    Attributes
    ----------
    theta, contact_point, level, slope
        The parameters of the same names of `PixelFits`.
    depth, travel
        Depth without the spring's deflection, and with it [length].
    near_count
        Number of samples at the end of the curve that are fitted.
    baseline_count
        Number of samples before contact.
    """

    theta: np.ndarray
    contact_point: np.ndarray
    level: np.ndarray
    slope: np.ndarray
    depth: np.ndarray
    travel: np.ndarray
    near_count: np.ndarray
    baseline_count: np.ndarray

    @classmethod
    def empty(cls, count: int) -> InitialFits:
        """Return results without any fit."""
        return cls(**_empty_arrays(cls, count, ("near_count", "baseline_count")))

    def parameters(self, curves: np.ndarray) -> np.ndarray:
        """Return the parameters (b, 4) of some curves: theta, contact point, baseline and slope.

        The baseline is its value at the contact point.
        """
        columns = (self.theta, self.contact_point, self.level, self.slope)
        return np.stack([column[curves] for column in columns], axis=-1)


def _empty_arrays(cls: type, count: int, integers: Sequence[str]) -> dict[str, np.ndarray]:
    """Return an array (count,) for each field of a class: zeros for integers, else NaN."""
    return {
        entry.name: np.zeros(count, dtype=np.int32)
        if entry.name in integers
        else np.full(count, math.nan)
        for entry in fields(cls)
    }


@dataclass(frozen=True)
class MapModel:
    """Scene of a map.

    Attributes
    ----------
    forward_model
        Forces of the scene. The only parameter, a modulus, scales the force.
    origin
        Options of contact point and baseline.
    load_curves
        Load curves of the pixels, if they differ.
    rows
        Row of the table of load curves for each curve (N,).
    """

    forward_model: ForwardModel
    origin: OriginOptions = field(default_factory=OriginOptions)
    load_curves: TabulatedLoadCurve | None = None
    rows: np.ndarray | None = None

    @property
    def max_depth(self) -> float:
        """Largest depth of the load curves [length]."""
        if self.load_curves is not None:
            return self.load_curves.max_depth
        return self.forward_model.max_depth

    def curve_model(self, curves: np.ndarray, samples: Samples) -> CurveModel:
        """Return the fitting model of some of the map's curves."""
        model = self.forward_model
        if self.load_curves is not None and self.rows is not None:
            model = model.replace_load_curves(self.load_curves, self.rows[curves])
        return CurveModel(model, samples, self.origin)


class MapFitter:
    """Fit of all curves of a map.

    Parameters
    ----------
    read
        Function that returns the approach of a curve, in order of time, in the units of the scene.
    count
        Number N of curves.
    model
        The scene; it may be replaced after the first pass.
    """

    def __init__(self, read: ReadSamples, count: int, model: MapModel):
        self.read = read
        self.count = count
        self.model = model
        self.fits = PixelFits.empty(count)
        self.initial = InitialFits.empty(count)

    @property
    def blocks(self) -> list[np.ndarray]:
        """Indices of the curves of each block."""
        firsts = range(0, self.count, BLOCK_SIZE)
        return [np.arange(first, min(first + BLOCK_SIZE, self.count)) for first in firsts]

    def state(self, curves: np.ndarray) -> dict[str, np.ndarray]:
        """Return the results of some curves as arrays by name."""
        return {
            f"{part}.{name}": values[curves]
            for part, results in (("fits", self.fits), ("initial", self.initial))
            for name, values in vars(results).items()
        }

    def restore(self, curves: np.ndarray, state: Mapping[str, np.ndarray]) -> None:
        """Set the results of some curves to those that `state` has returned."""
        for name, values in state.items():
            part, _, column = name.partition(".")
            getattr(getattr(self, part), column)[curves] = values

    def fit_initially(self) -> None:
        """Reject curves without a contact, and fit all other curves by ordinary least squares."""
        for block in self.blocks:
            self.fit_block_initially(block)

    def fit_block_initially(self, block: np.ndarray) -> None:
        """Fit the curves of a block that are not rejected yet; see `fit_initially`."""
        block = block[self.fits.is_fitted[block]]
        with np.errstate(all="ignore"):
            for first in range(0, len(block), BATCH_SIZE):
                for curves, samples in self._equally_long(block[first : first + BATCH_SIZE]):
                    self._fit_batch_initially(curves, samples)

    def estimate_noise(self) -> PooledNoise | None:
        """Return the noise of the map, or None if too few curves have long baselines.

        Baselines end a fifth of the depth before first contact.
        """
        max_baselines = 500
        baseline_counts = self.initial.baseline_count
        candidates = np.flatnonzero(baseline_counts >= MIN_BASELINE_SAMPLES)
        if len(candidates) < MIN_BASELINES:
            return None
        counts = baseline_counts[candidates]
        # The common length is that which half of the curves reach, or which enough curves reach.
        m = min(int(np.median(counts)), MAX_BASELINE_SAMPLES)
        if np.count_nonzero(counts >= m) < MIN_BASELINES:
            m = int(np.sort(counts)[-MIN_BASELINES])
        usable = candidates[counts >= m]
        chosen = usable[
            np.linspace(0, len(usable) - 1, min(max_baselines, len(usable))).astype(int)
        ]
        baselines = []
        for curve in chosen:
            end = baseline_counts[curve]
            baselines.append(self.read(int(curve)).force[end - m : end])
        return estimate_pooled_noise(np.array(baselines))

    def reject(self, is_rejected: np.ndarray, reason: int) -> None:
        """Reject curves (N,) that have not been rejected yet."""
        self.fits.reason[self.fits.is_fitted & is_rejected] = reason

    @property
    def initial_depths(self) -> np.ndarray:
        """Depths of the first pass without the spring's deflection (N,) [length]; may be NaN."""
        return np.where(self.fits.is_fitted, self.initial.depth, math.nan)

    @property
    def initial_contact_points(self) -> np.ndarray:
        """Contact points by ordinary least squares (N,) [length]; NaN for rejected curves."""
        return self.initial.contact_point

    def fit(self, noise: PooledNoise) -> None:
        """Fit all curves with the noise of the map."""
        for block in self.blocks:
            self.fit_block(block, noise)

    def fit_block(self, block: np.ndarray, noise: PooledNoise) -> None:
        """Fit the curves of a block with the noise of the map."""
        with np.errstate(all="ignore"):
            for curves in self._batches_of_equal_length(block):
                count = int(self.initial.near_count[curves[0]])
                _, samples = next(self._equally_long(curves, count))
                self._fit_batch(curves, samples, noise)

    def _equally_long(
        self, curves: Iterable[int], last: int | None = None
    ) -> Iterator[tuple[np.ndarray, Samples]]:
        """Yield groups of curves of equal length; `last` limits them to their last samples."""
        groups: dict[int, list[tuple[int, Samples]]] = {}
        for curve in curves:
            samples = self.read(int(curve))
            groups.setdefault(len(samples), []).append((int(curve), samples))
        if last is not None:
            groups = {last: [pair for group in groups.values() for pair in group]}
        for group in groups.values():
            start = 0 if last is None else -last
            yield (
                np.array([curve for curve, _ in group]),
                Samples(
                    np.stack([samples.x[start:] for _, samples in group]),
                    np.stack([samples.force[start:] for _, samples in group]),
                ),
            )

    def _fit_batch_initially(self, curves: np.ndarray, samples: Samples) -> None:
        reasons = reasons_without_signal(samples)
        self.fits.reason[curves] = reasons
        is_kept = reasons == FITTED
        curves = curves[is_kept]
        if not len(curves):
            return
        samples = samples.select_curves(is_kept)
        pilot = samples.block_means(MAX_PILOT_SAMPLES)
        model = self.model.curve_model(curves, pilot)
        p = initial_parameters(model)
        is_rising = np.isfinite(p).all(axis=-1)
        self.fits.reason[curves[~is_rising]] = NOT_RISING
        curves = curves[is_rising]
        if not len(curves):
            return
        samples = samples.select_curves(is_rising)
        model = model.select(np.flatnonzero(is_rising))
        p, squares = minimize_squares(
            model, p[is_rising], WHITE, INITIAL_ROUNDS, tolerance=MAP_TOLERANCE
        )
        self.fits.reason[curves[~np.isfinite(squares)]] = NO_FIT
        for column, values in zip(
            ("theta", "contact_point", "level", "slope"),
            _absolute_baseline_parameters(model, p).T,
            strict=True,
        ):
            getattr(self.initial, column)[curves] = values
        c = p[:, 1, None]
        depth = samples.x.max(axis=-1, keepdims=True) - c
        max_force = model.contact_force(p).max(axis=-1)
        rms = np.sqrt((model.residual(p) ** 2).mean(axis=-1))
        self.fits.reason[curves[max_force < MIN_SIGNAL_TO_NOISE * rms]] = NOISY
        deflection = model.forward_model.experiment.compliance * max_force
        self.initial.travel[curves] = depth[:, 0]
        self.initial.depth[curves] = depth[:, 0] - deflection
        margin = np.maximum(
            MAX_BASELINE_DEPTHS * depth,
            MIN_BASELINE_FRACTION * np.ptp(samples.x, axis=-1, keepdims=True),
        )
        n = samples.x.shape[-1]
        near_counts = np.count_nonzero(samples.x > c - margin, axis=-1)
        rounded = LENGTH_STEP * np.ceil(near_counts / LENGTH_STEP).astype(int)
        self.initial.near_count[curves] = np.minimum(rounded, LENGTH_STEP * (n // LENGTH_STEP))
        self.initial.baseline_count[curves] = np.argmax(
            samples.x > c - CONTACT_MARGIN * depth, axis=-1
        )

    def _batches_of_equal_length(self, block: np.ndarray) -> Iterator[np.ndarray]:
        fitted = block[self.fits.is_fitted[block]]
        counts = self.initial.near_count[fitted]
        for count in np.unique(counts):
            same = fitted[counts == count]
            for first in range(0, len(same), BATCH_SIZE):
                yield same[first : first + BATCH_SIZE]

    def _fit_batch(self, curves: np.ndarray, samples: Samples, noise: PooledNoise) -> None:
        """Fit curves with the noise of the map, and assess the fits."""
        model = self.model.curve_model(curves, samples)
        initial = _relative_baseline_parameters(model, self.initial.parameters(curves))
        fit = _fit_weighted(model, initial, noise)
        absolute = _absolute_baseline_parameters(model, fit.p)
        max_force = np.abs(model.contact_force(fit.p)).max(axis=-1)
        compliance = model.forward_model.experiment.compliance
        p_shape = _shape_probability(model, fit, noise)
        halves = _fit_depth_range(model, fit, noise, 0.5)
        thetas = [fit.p[:, 0], halves.theta]
        # The fits to other parts of the depth are computed for suspicious curves only.
        suspicious = np.flatnonzero(
            (p_shape < SUSPICIOUS_SHAPE_P) | (np.abs(halves.z) > SUSPICIOUS_DEPTH_Z)
        )
        if len(suspicious):
            for fraction in (0.7, 0.9):
                theta = np.full(len(curves), math.nan)
                theta[suspicious] = _fit_depth_range(
                    model.select(suspicious), fit.select(suspicious), noise, fraction
                ).theta
                thetas.append(theta)
        results = {
            "theta": fit.p[:, 0],
            "theta_sd": fit.sd[:, 0],
            "contact_point": fit.p[:, 1],
            "contact_point_sd": fit.sd[:, 1],
            "level": absolute[:, 2],
            "slope": absolute[:, 3],
            "max_force": max_force,
            "depth": samples.x.max(axis=-1) - fit.p[:, 1] - compliance * max_force,
            "travel": samples.x.max(axis=-1) - fit.p[:, 1],
            "rms": np.sqrt((fit.rows[:, -1] ** 2).mean(axis=-1)),
            "p_shape": p_shape,
            "half_theta": halves.theta,
            "half_z": halves.z,
            "low_theta": np.nanmin(thetas, axis=0),
            "high_theta": np.nanmax(thetas, axis=0),
            "point_count": np.full(len(curves), samples.x.shape[-1]),
        }
        for name, values in results.items():
            getattr(self.fits, name)[curves] = values
        in_contact = np.count_nonzero(samples.x > fit.p[:, 1, None], axis=-1)
        self._reject(curves, in_contact)

    def _reject(self, curves: np.ndarray, in_contact: np.ndarray) -> None:
        """Reject fits without a clear contact, or with an uncertain modulus."""
        fits = self.fits
        # Relative excess of the depth over the solved one, up to which the load curve may be
        # continued as a power law.
        depth_tolerance = 0.02
        max_depth = (1.0 + depth_tolerance) * self.model.max_depth
        uncertainty = NORMAL_95 * fits.theta_sd[curves]
        for reason, is_rejected in (
            (UNCERTAIN, ~(uncertainty < math.log(MAX_UNCERTAINTY_FACTOR))),
            (TOO_DEEP, fits.depth[curves] > max_depth),
            (NOISY, fits.max_force[curves] < MIN_SIGNAL_TO_NOISE * fits.rms[curves]),
            (FEW_IN_CONTACT, in_contact < MIN_CONTACT_POINTS),
            (NO_FIT, ~np.isfinite(fits.theta[curves])),
        ):
            fits.reason[curves[is_rejected]] = reason


@dataclass(frozen=True)
class WeightedFit:
    """Fits of a batch of curves with the noise of a map.

    Attributes
    ----------
    p
        Parameters (b, 4): theta, c, b0, b1.
    sd
        Standard deviations of theta and c (b, 2).
    rows
        Derivatives and residuals (b, 5, n), see `CurveModel.linearize`.
    solver
        D (b, n), with which theta changes by D r for residuals r.
    variance
        Variance of the noise (b,).
    """

    p: np.ndarray
    sd: np.ndarray
    rows: np.ndarray
    solver: np.ndarray
    variance: np.ndarray

    def select(self, curves: np.ndarray) -> WeightedFit:
        """Return the fits of some curves."""
        return WeightedFit(
            self.p[curves],
            self.sd[curves],
            self.rows[curves],
            self.solver[curves],
            self.variance[curves],
        )


def _fit_weighted(
    model: CurveModel, p: np.ndarray, noise: PooledNoise, tolerance: float = MAP_TOLERANCE
) -> WeightedFit:
    """Fit curves with the weights W, and compute the covariance for the noise V itself."""
    n = model.samples.x.shape[-1]
    metric = noise.metric(n)
    p, _ = minimize_squares(model, p, metric, tolerance=tolerance, initial_damping=NEARLY_UNDAMPED)
    rows = model.linearize(p)
    J = rows[:, :-1]
    norms = np.sqrt((J * J).sum(axis=-1))
    norms = np.where(norms > 0, norms, 1.0)
    scaled = np.concatenate([J / norms[..., None], rows[:, -1:]], axis=1)
    solution = solve_normal_equations(metric.gram(scaled))
    variance = solution.residual_squares / max(n - p.shape[-1], 1)
    solvers = solution.covariance[:, :2] @ metric.apply(scaled[:, :-1]) / norms[:, :2, None]
    sd = np.sqrt(noise.variances(solvers) * variance[:, None])
    return WeightedFit(p, sd, rows, solvers[:, 0], variance)


def _shape_probability(model: CurveModel, fit: WeightedFit, noise: PooledNoise) -> np.ndarray:
    """Return the probabilities (b,) of an F test of eight cosines over the contact."""
    samples = model.samples
    n = samples.x.shape[-1]
    c = fit.p[:, 1, None]
    cosines = trend_cosines(samples.x, c, samples.x.max(axis=-1, keepdims=True) - c)
    J = fit.rows[:, :-1]
    columns = np.concatenate([J, cosines], axis=1)
    norms = np.sqrt((columns * columns).sum(axis=-1, keepdims=True))
    scaled = np.concatenate([columns / np.where(norms > 0, norms, 1.0), fit.rows[:, -1:]], axis=1)
    gram = noise.metric(n).gram(scaled)
    p = J.shape[1]
    m = cosines.shape[1]
    without, with_cosines = (
        solve_normal_equations(gram, count).residual_squares for count in (p, p + m)
    )
    degrees_of_freedom = n - p - m
    explained = np.maximum(without - with_cosines, 0.0) / m
    residual = np.maximum(with_cosines, 1e-300) / degrees_of_freedom
    probability: np.ndarray = fdtrc(m, degrees_of_freedom, explained / residual)
    return probability


@dataclass(frozen=True)
class DepthRangeFits:
    """Fits to a part of the depth: theta (b,) and z scores (b,), NaN where it is too short."""

    theta: np.ndarray
    z: np.ndarray


def _fit_depth_range(
    model: CurveModel, fit: WeightedFit, noise: PooledNoise, depth_fraction: float
) -> DepthRangeFits:
    """Fit the samples up to a fraction of the depth.

    The difference of the two estimates is (D_part - D) r for the noise r, with D as in the module,
    from which the variance of the difference follows. D_part is zero outside the part.
    """
    x = model.samples.x
    b, n = x.shape
    c = fit.p[:, 1, None]
    is_inside = x - c <= depth_fraction * (x.max(axis=-1, keepdims=True) - c)
    ends = n - np.argmax(is_inside[:, ::-1], axis=-1)
    in_contact = np.count_nonzero(is_inside & (x > c), axis=-1)
    # Coarser steps of the length than for whole curves, so that a block has few different lengths.
    step = 2 * LENGTH_STEP
    lengths = step * (ends // step)
    theta = np.full(b, math.nan)
    z = np.full(b, math.nan)
    for length in np.unique(lengths[(in_contact >= MIN_CONTACT_POINTS) & (lengths > 0)]):
        rows = np.flatnonzero((lengths == length) & (in_contact >= MIN_CONTACT_POINTS))
        columns = ends[rows, None] - length + np.arange(length)
        part_samples = Samples(
            x[rows[:, None], columns], model.samples.force[rows[:, None], columns]
        )
        part_model = replace(model.select(rows), samples=part_samples)
        initial = _relative_baseline_parameters(
            part_model, _absolute_baseline_parameters(model.select(rows), fit.p[rows])
        )
        part = _fit_weighted(part_model, initial, noise, DEPTH_RANGE_TOLERANCE)
        difference = -fit.solver[rows]
        np.put_along_axis(
            difference,
            columns,
            np.take_along_axis(difference, columns, axis=1) + part.solver,
            axis=1,
        )
        sd = np.sqrt(noise.variances(difference) * fit.variance[rows])
        sd = np.maximum(sd, MIN_DEVIATION_RATIO * part.sd[:, 0])
        theta[rows] = part.p[:, 0]
        z[rows] = (part.p[:, 0] - fit.p[rows, 0]) / np.maximum(sd, 1e-300)
    return DepthRangeFits(theta, z)


def reasons_without_signal(samples: Samples) -> np.ndarray:
    """Return the reasons (b,) for which curves are rejected before a fit."""
    x = samples.x
    force = samples.force
    n = x.shape[-1]
    reasons = np.zeros(len(x), dtype=int)
    if n < MIN_POINTS:
        return np.full(len(x), FEW_POINTS)
    is_complete = (np.isfinite(x) & np.isfinite(force)).all(axis=-1)
    x = np.where(is_complete[:, None], x, 0.0)
    force = np.where(is_complete[:, None], force, 0.0)
    span = np.ptp(force, axis=-1)
    is_largest = force >= force.max(axis=-1, keepdims=True) - 1e-12 * span[:, None]
    noise = 1.48 * np.median(np.abs(np.diff(force, axis=-1)), axis=-1) / math.sqrt(2.0)
    means = Samples(x, force).block_means(SIGNAL_BLOCKS).force
    rise = np.ptp(means, axis=-1)
    required_rise = 3.0 * noise + 6.0 * noise / math.sqrt(n / SIGNAL_BLOCKS)
    for reason, is_rejected in (
        (NOISY, rise < required_rise),
        (SATURATED, is_largest.sum(axis=-1) > max(SATURATED_FRACTION * n, MAX_SATURATED)),
        (CONSTANT_FORCE, ~(span > 0)),
        (CONSTANT_DEPTH, ~(np.ptp(x, axis=-1) > 0)),
        (INCOMPLETE, ~is_complete),
    ):
        reasons[is_rejected] = reason
    return reasons


def initial_parameters(model: CurveModel) -> np.ndarray:
    """Return initial guesses (b, 4) of modulus, contact point and baseline.

    They are NaN where the force does not rise.
    """
    pilot_samples = 100
    trial_count = 40
    forward_model = model.forward_model
    pilot = model.samples.block_means(pilot_samples)
    if model.origin.contact_point is None:
        contact_points = np.percentile(pilot.x, np.linspace(2.0, 97.0, trial_count), axis=-1).T
    else:
        contact_points = np.full((len(pilot.x), 1), model.origin.contact_point)
    far_count = max(3, pilot.x.shape[-1] // 10)
    far = np.argsort(pilot.x, axis=-1, kind="stable")[:, :far_count]
    level = np.median(np.take_along_axis(pilot.force, far, axis=-1), axis=-1, keepdims=True)
    depth = pilot.x - forward_model.experiment.compliance * (pilot.force - level)
    f = forward_model.unit_forces(depth[:, None] - contact_points[..., None])
    fits = fit_trials(pilot.x, pilot.force, f, model.origin.has_slope, has_scale=True)
    best = np.argmin(fits.squares, axis=-1)[:, None]
    amplitude, b0, b1, c = (
        np.take_along_axis(values, best, axis=-1)[:, 0]
        for values in (fits.amplitude, fits.level, fits.slope, contact_points)
    )
    is_valid = np.isfinite(np.take_along_axis(fits.squares, best, axis=-1)[:, 0])
    theta = forward_model.initial_coordinates[0] + np.log(np.where(is_valid, amplitude, 1.0))
    parameters = np.stack([theta, c, b0, b1], axis=-1)
    return np.where(is_valid[:, None], parameters, math.nan)


def _absolute_baseline_parameters(model: CurveModel, p: np.ndarray) -> np.ndarray:
    """Return parameters (b, 4) with the baseline as its value and slope at the contact point.

    The columns are theta, contact point c, baseline at c and slope [force/length].
    """
    x = model.samples.x
    slope = p[:, 3] / np.maximum(np.ptp(x, axis=-1), 1e-300)
    level = p[:, 2] + slope * (p[:, 1] - x.mean(axis=-1))
    return np.stack([p[:, 0], p[:, 1], level, slope], axis=-1)


def _relative_baseline_parameters(model: CurveModel, absolute: np.ndarray) -> np.ndarray:
    """Return the parameters (b, 4) of a model; the inverse of `_absolute_baseline_parameters`."""
    x = model.samples.x
    theta, c, level, slope = absolute.T
    b0 = level + slope * (x.mean(axis=-1) - c)
    return np.stack([theta, c, b0, slope * np.ptp(x, axis=-1)], axis=-1)
