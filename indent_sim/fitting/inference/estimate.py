"""Estimate: one model on one curve, its contact point and baseline unknown.

    F_i = b0 + b1 (x_i - mean)/range + f(x_i - c; theta) + noise

Ordinary least squares finds the parameters, their noise the intervals; the fit is repeated in the
likeliest noise unless that forgives residuals: a long correlation forgives any.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from indent_sim.fitting.inference.noise import NORMAL_95, WHITE, Averaged, Noise, averaged, inverse
from indent_sim.fitting.scene_curve.lattice import NoTable
from indent_sim.fitting.scene_curve.scene_forces import SceneForces

FEWEST_POINTS = 30
FEWEST_PUSHING = 20
# of the points at the largest force
SATURATED_SHARE = 0.02
MOST_SATURATED = 5
BLOCKS = 50  # of a curve, whose means tell a contact from noise
WORST_FACTOR = 4.0  # a modulus known to a larger factor is not known
LEAST_RISE = 4.0  # rms of the residuals: a smaller rise is noise
# block means
MOST_PILOT = 400
MOST_MEANS = 1500
# contact points that are tried, between these percentiles of x
CONTACTS = 80
CONTACT_PERCENTILES = (2.0, 97.0)
# depths before contact that count, and share of the range at least
BASELINE_KEPT = 1.5
LEAST_BASELINE = 0.02
# of a fit, in coordinates and of the contact point in depths
FIT_ROUNDS = 40
LARGEST_STEP = 1.0
LARGEST_SHIFT = 0.3
SETTLED_SQUARES = (
    1e-6  # relative change of the sum of squares: with n samples n 1e-6 of a deviation squared
)
WORSE = 1.1  # of the rms: a fit in correlated noise that leaves more forgives residuals
OFFSETS = (
    0.0,
    -1.2,
    1.2,
    -2.4,
    2.4,
)  # of a parameter's coordinate from the scene's own, where fits begin
LINEAR_OFFSETS = (0.0, -0.1, 0.1)
BEGINNINGS = 3  # that are followed to their end
AT_BOUND = 1e-6
# samples by which a contact point is moved, and rounds
SNAPS = (-3, -2, -1, 0, 1, 2, 3)
SNAP_ROUNDS = 6
MOST_SNAPS = 5
CLEAR_SNAP = 5.0  # deviations of the noise: a snap-in that shows between which samples it lies


class Refused(Exception):
    """A curve that tells nothing of the parameters; the message says why."""


@dataclass(frozen=True)
class Samples:
    """A curve as a fit sees it: x [length], force [force], t [s] or None, each (n,), in order of
    time.
    """

    x: np.ndarray
    force: np.ndarray
    t: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.x)

    def where(self, chosen: np.ndarray) -> Samples:
        """Some of the samples."""
        return Samples(
            self.x[chosen], self.force[chosen], None if self.t is None else self.t[chosen]
        )

    def means(self, most: int) -> Samples:
        """Means of blocks of neighbours, so many at most."""
        if len(self) <= most:
            return self
        size = math.ceil(len(self) / most)
        first = (
            len(self) % size
        )  # at equal times they stay so: what is left over goes with the baseline
        x, force = (one[first:].reshape(-1, size).mean(axis=1) for one in (self.x, self.force))
        return Samples(
            x, force, None if self.t is None else self.t[first:].reshape(-1, size).mean(axis=1)
        )


@dataclass(frozen=True)
class Origin:
    """Whether contact point and slope of the baseline are fitted: a number is a contact point that
    is known.
    """

    contact_point: float | None = None
    has_slope: bool = True


@dataclass(frozen=True)
class Model:
    """Forces of a scene on a baseline, of the parameters [theta..., c, b0, b1] (p,), at some
    samples.

    held: coordinates that are not fitted.
    """

    forces: SceneForces
    samples: Samples
    origin: Origin = field(default_factory=Origin)
    held: frozenset[int] = frozenset()

    @property
    def size(self) -> int:
        """How many coordinates theta the forces have."""
        return len(self.forces.parameters)

    @cached_property
    def _slope(self) -> np.ndarray:
        x = self.samples.x
        return (x - x.mean()) / max(float(np.ptp(x)), 1e-300)

    @property
    def free(self) -> np.ndarray:
        """Which parameters are fitted (p,)."""
        free = np.ones(self.size + 3, dtype=bool)
        free[self.size] = self.origin.contact_point is None
        free[-1] = self.origin.has_slope
        free[list(self.held)] = False
        return free

    def contact(self, p: np.ndarray) -> np.ndarray:
        """The forces without the baseline."""
        theta = p[: self.size]
        c = p[self.size]
        return self.forces(theta, self.samples.x - c, self.samples.t)

    def baseline(self, p: np.ndarray) -> np.ndarray:
        """b0 + b1 (x - mean)/range."""
        return p[-2] + p[-1] * self._slope

    def residual(self, p: np.ndarray) -> np.ndarray:
        """Measured less modelled forces (n,)."""
        return self.samples.force - self.baseline(p) - self.contact(p)

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """Derivatives of the modelled forces by all parameters (n, p), by central differences."""
        columns = [self._along(p, k, 1e-4) for k in range(self.size)]
        columns.append(self._along(p, self.size, 1e-5 * self.forces.deepest))
        columns[-1] = np.where(self._snaps(p, 1e-5 * self.forces.deepest), 0.0, columns[-1])
        J = np.column_stack([*columns, np.ones(len(self.samples)), self._slope])
        return J * self.free

    def _along(self, p: np.ndarray, k: int, h: float) -> np.ndarray:
        step = np.zeros(len(p))
        step[k] = h
        low = self._inside(p - step)
        high = self._inside(p + step)
        return (self.contact(high) - self.contact(low)) / max(high[k] - low[k], 1e-300)

    def _snaps(self, p: np.ndarray, h: float) -> np.ndarray:
        """Which samples lie as near to where a tip snaps in: no derivative knows of that."""
        return self.forces.adheres & (np.abs(self.samples.x - p[self.size]) <= h)  # type: ignore[no-any-return]

    @property
    def spacing(self) -> float:
        """The distance of samples [length]."""
        return float(np.median(np.abs(np.diff(self.samples.x))))

    def _inside(self, p: np.ndarray) -> np.ndarray:
        """The parameters, none beyond its bounds."""
        low, high = self.forces.bounds
        return np.concatenate([np.clip(p[: self.size], low, high), p[self.size :]])

    def fitted(
        self, p: np.ndarray, noise: Noise = WHITE, rounds: int = FIT_ROUNDS
    ) -> tuple[np.ndarray, float]:
        """The least squares of the residuals in a noise from these parameters on, by
        Levenberg-Marquardt.
        """
        p = self._inside(p)
        damping = 1e-3
        r = self.residual(p)
        J = self.jacobian(p)
        size = _norm(r, noise)
        for _ in range(rounds):
            VJ = noise.whitened(J)[0]
            A = J.T @ VJ
            g = VJ.T @ r
            if not (np.isfinite(A).all() and np.isfinite(g).all()):
                raise ValueError("the forces are no numbers")
            scale = np.sqrt(np.where(np.diag(A) > 0, np.diag(A), 1.0))
            A = A / np.outer(scale, scale)
            g = g / scale
            done = True
            for _ in range(8):
                step = np.linalg.solve(A + damping * np.eye(len(g)), g) / scale
                new = self._inside(p + self._shortened(step))
                try:
                    r_new = self.residual(new)
                    smaller = _norm(r_new, noise)
                except NoTable:
                    smaller = math.inf
                if smaller < size:
                    done = size - smaller < SETTLED_SQUARES * size
                    p = new
                    r = r_new
                    size = smaller
                    damping = max(0.2 * damping, 1e-9)
                    break
                damping *= 6.0
            if done:
                break
            J = self.jacobian(p)
        return p, size

    def _shortened(self, step: np.ndarray) -> np.ndarray:
        depth = max(float(np.ptp(self.samples.x)), 1e-300)
        longest = max(
            [
                *np.abs(step[: self.size]) / LARGEST_STEP,
                abs(step[self.size]) / (LARGEST_SHIFT * depth),
                1.0,
            ]
        )
        return step / longest


def _norm(r: np.ndarray, noise: Noise) -> float:
    value = float(r @ noise.whitened(r)[0])
    return value if math.isfinite(value) else math.inf


@dataclass(frozen=True)
class Estimate:
    """A model fitted to a curve: parameters p [theta..., c, b0, b1], those by ordinary least
    squares, and the noise.

    profiles: intervals of coordinates that are too wide for a parabola.
    """

    model: Model
    p: np.ndarray
    ordinary: np.ndarray
    found: Averaged
    profiles: dict[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def theta(self) -> np.ndarray:
        """The coordinates of the varied keys."""
        return self.p[: self.model.size]

    @property
    def contact_point(self) -> float:
        """x at first touch [length]."""
        return float(self.p[self.model.size])

    @property
    def depth(self) -> float:
        """The way from first touch to the deepest sample [length]."""
        return float(self.model.samples.x.max()) - self.contact_point

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured less fitted forces."""
        return self.model.residual(self.p)

    @property
    def rms(self) -> float:
        """Of the residuals [force]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def rise(self) -> float:
        """The largest fitted force of the contact [force]."""
        return float(np.abs(self.model.contact(self.p)).max())

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the parameters."""
        return self.found.sd

    def interval(self, k: int) -> tuple[float, float]:
        """The 95 % interval of a varied key's coordinate, within its bounds."""
        low, high = self.model.forces.parameters[k].bounds
        half = NORMAL_95 * float(self.sd[k])
        begin, end = self.profiles.get(
            k, (float(self.theta[k]) - half, float(self.theta[k]) + half)
        )
        return max(low, begin), min(high, end)

    def at_bound(self, k: int) -> bool:
        """Whether a varied key ended at a bound of its range."""
        low, high = self.model.forces.parameters[k].bounds
        value = float(self.theta[k])
        return min(value - low, high - value) < AT_BOUND


def estimated(model: Model, start: np.ndarray) -> Estimate:
    """The estimate of a model from these parameters on."""
    ordinary = _beside_snaps(model, model.fitted(start)[0])
    found = averaged_at(model, ordinary)
    if found.likeliest == WHITE:
        return Estimate(model, ordinary, ordinary, found)
    general, _ = model.fitted(ordinary, found.likeliest)
    if _rms(model, general) > WORSE * _rms(model, ordinary):
        return Estimate(model, ordinary, ordinary, found)
    return Estimate(model, general, ordinary, averaged_at(model, general))


def _beside_snaps(model: Model, p: np.ndarray) -> np.ndarray:
    """The parameters with the contact point between the samples where it leaves least: a tip that
    snaps in makes the sum of squares jump at each of them, and descents end there.
    """
    if not model.forces.adheres or model.origin.contact_point is not None:
        return p
    held = replace(model, held=model.held | {model.size})
    size = math.inf
    for _ in range(MOST_SNAPS):
        moved = [p + shift * model.spacing * np.eye(len(p))[model.size] for shift in SNAPS]
        best, least = min(
            (held.fitted(one, rounds=SNAP_ROUNDS) for one in moved), key=lambda found: found[1]
        )
        if least >= size * (1 - SETTLED_SQUARES):
            break
        p, size = model.fitted(best)
    return p


def averaged_at(model: Model, p: np.ndarray, noises: list[Noise] | None = None) -> Averaged:
    """What the residuals at these parameters say of the fitted ones; of those that are known
    nothing varies.
    """
    free = model.free
    found = averaged(model.jacobian(p)[:, free], model.residual(p), noises)
    covariance = np.zeros((len(free), len(free)))
    step = np.zeros(len(free))
    covariance[np.ix_(free, free)] = found.covariance
    step[free] = found.step
    return replace(found, covariance=_beside_snap(covariance, model, p, found.s2), step=step)


def _beside_snap(covariance: np.ndarray, model: Model, p: np.ndarray, s2: float) -> np.ndarray:
    """The covariance where a tip snaps in and tells the contact point to a sample's distance d:
    deviation d/sqrt(3), since the least squares end at either of two samples.
    """
    if not model.free[model.size] or _snap_of(model, p) < CLEAR_SNAP * math.sqrt(s2):
        return covariance
    along = covariance[model.size]
    return covariance - np.outer(along, along) / (model.spacing**2 / 3.0 + along[model.size])


def _snap_of(model: Model, p: np.ndarray) -> float:
    """The force with which a tip snaps in [force]; 0 of one that does not adhere."""
    if not model.forces.adheres:
        return 0.0
    theta = p[: model.size]
    touch = np.array([0.0])
    return abs(float(model.forces.rigid(theta)(touch)[0]))


def deviation(estimate: Estimate, k: int, known: Sequence[int] = ()) -> float:
    """Standard deviation of a coordinate in the likeliest noise, s sqrt((J'V^-1 J)^-1_kk); infinite
    where nothing depends on it. known: the varied keys that are not fitted beside it.
    """
    model = replace(estimate.model, held=estimate.model.held | set(known))
    free = model.free
    noise = estimate.found.likeliest
    J = model.jacobian(estimate.p)
    scale = np.sqrt((J * J).sum(axis=0))
    if not scale[k] > 0:
        return math.inf if free[k] else 0.0
    J = J[:, free] / np.where(scale > 0, scale, 1.0)[free]
    inverted, _ = inverse(J.T @ noise.whitened(J)[0])
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = (
        estimate.found.s2 * inverted / np.outer(scale[free], scale[free])
    )
    return math.sqrt(
        max(float(_beside_snap(covariance, model, estimate.p, estimate.found.s2)[k, k]), 0.0)
    )


def _rms(model: Model, p: np.ndarray) -> float:
    return float(np.sqrt(np.mean(model.residual(p) ** 2)))


def refuse_hopeless(samples: Samples) -> None:
    """Refused for a curve that no scene is worth fitting to."""
    n = len(samples)
    force = samples.force
    if n < FEWEST_POINTS:
        raise Refused(f"{n} points" if n != 1 else "1 point")
    for name, values in (("depth", samples.x), ("force", force)):
        if not np.ptp(values) > 0:
            raise Refused(f"no contact: the {name} does not change")
    most = int(np.count_nonzero(force >= force.max() - 1e-12 * np.ptp(force)))
    if most > max(SATURATED_SHARE * n, MOST_SATURATED):
        raise Refused(f"saturated: {most} points at the largest force")
    block = n / BLOCKS
    means = samples.means(BLOCKS).force
    noise = 1.48 * float(np.median(np.abs(np.diff(force)))) / math.sqrt(2.0)
    if np.ptp(means) < 3.0 * noise + 6.0 * noise / math.sqrt(block):
        raise Refused("no contact: the force does not rise above its noise")


def beginnings(forces: SceneForces, samples: Samples, origin: Origin) -> list[np.ndarray]:
    """Parameters from which a fit may begin, the likeliest first: contact points and coordinates
    that are tried, with the baseline and the size of the force solved for.
    """
    few = samples.means(MOST_PILOT)
    wanted = (
        np.percentile(few.x, np.linspace(*CONTACT_PERCENTILES, CONTACTS))
        if origin.contact_point is None
        else []
    )
    contacts = [origin.contact_point] if origin.contact_point is not None else list(wanted)
    softness = forces.experiment.compliance
    depth = few.x - softness * (few.force - far_level(few))
    found = [_begun(forces, theta, few, depth, contacts, origin) for theta in _tried(forces)]
    ordered = sorted((one for one in found if one), key=lambda one: one[0])
    return [p for _, p in ordered[:BEGINNINGS]]


def far_level(samples: Samples) -> float:
    """The force of the tenth of the samples that is farthest from the body."""
    far = np.argsort(samples.x, kind="stable")[: max(3, len(samples) // 10)]
    return float(np.median(samples.force[far]))


def _tried(forces: SceneForces) -> list[np.ndarray]:
    """The scene's own coordinates, and those with one of the shape's or the experiment's moved."""
    start = forces.start
    tried = [start]
    for k, one in enumerate(forces.parameters):
        if one.role != "scale":
            for offset in (LINEAR_OFFSETS if one.is_linear else OFFSETS)[1:]:
                moved = start.copy()
                moved[k] = float(np.clip(start[k] + offset, *one.bounds))
                tried.append(moved)
    return tried


def _begun(
    forces: SceneForces,
    theta: np.ndarray,
    few: Samples,
    depth: np.ndarray,
    contacts: Sequence[float],
    origin: Origin,
) -> tuple[float, np.ndarray] | None:
    """The best contact point for some coordinates, as (residual, parameters); None where there is
    none.
    """
    best: tuple[float, np.ndarray] | None = None
    line = (few.x - few.x.mean()) / max(float(np.ptp(few.x)), 1e-300)
    scaling = forces.scaling
    try:
        of = forces.rigid(theta)
    except NoTable:
        return None
    for c in contacts:
        f = of(depth - c)
        if not np.any(f):
            continue
        columns = [np.ones(len(f)), *([line] if origin.has_slope else [])]
        known = [*columns, f] if scaling is not None else columns
        right = few.force if scaling is not None else few.force - f
        solution, *_ = np.linalg.lstsq(np.column_stack(known), right, rcond=None)
        amplitude = float(solution[-1]) if scaling is not None else 1.0
        left = float(np.sum((right - np.column_stack(known) @ solution) ** 2))
        if amplitude > 0 and (best is None or left < best[0]):
            moved = theta.copy()
            if scaling is not None:
                moved[scaling] += math.log(amplitude)
            slope = float(solution[1]) if origin.has_slope else 0.0
            best = left, np.array([*moved, c, float(solution[0]), slope])
    return best


def fit(
    forces: SceneForces, samples: Samples, origin: Origin, near: Estimate | None = None
) -> Estimate:
    """The best estimate of a scene's parameters on a curve; Refused with the reason where it tells
    nothing of them.

    near: an estimate of almost the same forces on this curve, from which alone the fit begins.
    """
    few = Model(forces, samples.means(MOST_PILOT), origin)
    starts = (
        beginnings(forces, samples, origin) if near is None else [rebased(near.model, few, near.p)]
    )
    if not starts:
        other = Samples(samples.x, -samples.force, samples.t)
        turned = (
            " (it falls: one that pushes in counts > 0)"
            if beginnings(forces, other, origin)
            else ""
        )
        raise Refused(f"no contact: the force does not rise with the depth{turned}")
    followed = [_followed(few, start) for start in starts]
    best = min((one for one in followed if one), key=lambda one: one[1], default=None)
    if best is None:
        raise Refused("no contact: no fit was found")
    close = nearby(samples, float(best[0][len(forces.parameters)]))
    if len(close) < FEWEST_POINTS:
        raise Refused(f"no contact: {len(close)} points in contact")
    model = Model(forces, close, origin)
    estimate = estimated(model, rebased(few, model, best[0]))
    _refuse_weak(estimate)
    return estimate


def _followed(model: Model, start: np.ndarray) -> tuple[np.ndarray, float] | None:
    try:
        return model.fitted(start)
    except (NoTable, ValueError, np.linalg.LinAlgError):
        return None


def nearby(samples: Samples, c: float) -> Samples:
    """The samples in contact and beside it; a long baseline would drown the contact and fit its own
    waves.
    """
    depth = float(samples.x.max()) - c
    span = float(np.ptp(samples.x))
    return samples.where(samples.x > c - max(BASELINE_KEPT * depth, LEAST_BASELINE * span)).means(
        MOST_MEANS
    )


def rebased(old: Model, new: Model, p: np.ndarray) -> np.ndarray:
    """The same line of the baseline in the mean and range of other samples."""
    span = float(np.ptp(old.samples.x))
    spans = float(np.ptp(new.samples.x))
    slope = p[-1] / max(span, 1e-300)
    level = p[-2] + slope * (float(new.samples.x.mean()) - float(old.samples.x.mean()))
    return np.array([*p[:-2], level, slope * spans])


def _refuse_weak(estimate: Estimate) -> None:
    within = int(np.count_nonzero(estimate.model.samples.x > estimate.contact_point))
    if within < FEWEST_PUSHING:
        raise Refused(f"no contact: {within} points in contact")
    if estimate.rise < LEAST_RISE * estimate.rms:
        raise Refused("no contact: the force does not rise above its noise")
    for k, one in enumerate(estimate.model.forces.parameters):
        factor = (
            math.exp(min(NORMAL_95 * float(estimate.sd[k]), 100.0)) if one.role == "scale" else 1.0
        )
        if factor > WORST_FACTOR:
            raise Refused(f"{one.key} is known to a factor of {factor:.2g} only")
