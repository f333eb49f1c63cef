"""Least squares by the Levenberg-Marquardt method, for many curves at once.

    minimize r'V^-1 r,   (A + damping diag A) step = g,   A = J'V^-1 J,   g = J'V^-1 r

Every curve has a separate damping, and is iterated until its sum of squares has converged. Source:
Marquardt (1963), Journal of the Society for Industrial and Applied Mathematics 11, 431.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable

# Relative change of the sum of squares at which the iteration ends.
SQUARES_TOLERANCE = 1e-9


class Metric(Protocol):
    """Inverse covariance V^-1 of the residuals, up to a factor."""

    def gram(self, X: np.ndarray) -> np.ndarray:
        """Return X'V^-1 X (..., c, c); the c columns of X are stored as rows (..., c, n)."""


class Regression(Protocol):
    """Model of one curve, or of a batch of curves, with parameters p (B, p)."""

    @property
    def has_analytic_derivatives(self) -> bool:
        """True if derivatives take hardly longer than residuals."""

    @property
    def shortens_steps(self) -> bool:
        """True if steps beyond the minimum along them are shortened."""

    def select(self, curves: np.ndarray) -> Regression:
        """Return the model of some curves of a batch."""

    def residual(self, p: np.ndarray) -> np.ndarray:
        """Return the residuals (B, n)."""

    def linearize(self, p: np.ndarray) -> np.ndarray:
        """Return the derivatives of the modelled forces and the residuals (B, p + 1, n)."""

    def clip_to_bounds(self, p: np.ndarray) -> np.ndarray:
        """Return the parameters within their bounds."""

    def limit_step(self, step: np.ndarray) -> np.ndarray:
        """Return a step (B, p), shortened where it is too long."""


def minimize_squares(
    model: Regression,
    p: np.ndarray,
    metric: Metric,
    rounds: int = 40,
    tolerance: float | None = None,
    initial_damping: float = 1e-3,
) -> tuple[np.ndarray, np.ndarray]:
    """Minimize the weighted sum of squares of every curve.

    Parameters
    ----------
    model : Regression
        Model of the curves.
    p : ndarray, shape (B, p)
        Initial guesses.
    metric : Metric
        Weights of the squares.
    rounds : int
        Largest number of accepted steps of a curve.
    tolerance : float, optional
        Relative change of the sum of squares at which the iteration ends.
    initial_damping : float
        Damping of the first step.

    Returns
    -------
    p : ndarray, shape (B, p)
        The parameters.
    squares : ndarray, shape (B,)
        The weighted sums of squares; infinite for a curve whose forces are not finite.
    """
    tolerance = SQUARES_TOLERANCE if tolerance is None else tolerance
    # Factors of the damping after a rejected and after an accepted step, and number of rejected
    # steps after which a curve counts as converged.
    increase = 6.0
    decrease = 0.2
    smallest_damping = 1e-9
    max_rejections = 8
    p = model.clip_to_bounds(p)
    gram = _gram(model, p, metric)
    damping = np.full(len(p), initial_damping)
    rejections = np.zeros(len(p), dtype=int)
    acceptances = np.zeros(len(p), dtype=int)
    active = np.flatnonzero(np.isfinite(gram).all(axis=(-2, -1)))
    while len(active):
        step = _damped_step(gram[active], damping[active])
        # A step of the linear model reduces the squares by between one and two times this.
        expected_drop = (step * gram[active, :-1, -1]).sum(axis=-1)
        is_worthwhile = expected_drop >= tolerance * gram[active, -1, -1]
        active = active[is_worthwhile]
        if not len(active):
            break
        step = step[is_worthwhile]
        part = model.select(active)
        trial = part.clip_to_bounds(p[active] + part.limit_step(step))
        squares = gram[active, -1, -1]
        trial_gram = _trial_gram(part, trial, metric, squares)
        if model.shortens_steps:
            _shorten_steps(part, p[active], gram[active], trial, trial_gram, metric)
        drop = squares - trial_gram[:, -1, -1]
        is_better = drop > 0.0
        p[active[is_better]] = trial[is_better]
        gram[active[is_better]] = trial_gram[is_better]
        # A step along a valley that is not smooth may gain next to nothing of what is expected.
        has_gained = is_better & (drop >= tolerance * squares)
        improved = active[has_gained]
        rejected = active[~has_gained]
        damping[improved] = np.maximum(decrease * damping[improved], smallest_damping)
        damping[rejected] *= increase
        rejections[rejected] += 1
        rejections[improved] = 0
        acceptances[improved] += 1
        is_active = (acceptances[active] < rounds) & (rejections[active] < max_rejections)
        active = active[is_active]
    return p, gram[:, -1, -1]


def _shorten_steps(
    model: Regression,
    p: np.ndarray,
    gram: np.ndarray,
    trial: np.ndarray,
    trial_gram: np.ndarray,
    metric: Metric,
) -> None:
    """Replace trials beyond the minimum of the squares along their steps by this minimum.

    It is that of the parabola through the squares and their slope at p and the squares at the
    trial. Without it steps across a narrow valley, as of the contact point, alternate between its
    sides. `trial` and `trial_gram` are changed.
    """
    # A step is shortened if the minimum is before this fraction of it, and not to less than the
    # other fraction.
    longest = 0.7
    shortest = 0.1
    change = trial - p
    slope = (change * gram[:, :-1, -1]).sum(axis=-1)
    curvature = trial_gram[:, -1, -1] - gram[:, -1, -1] + 2.0 * slope
    curves = np.flatnonzero((slope > 0.0) & (slope < longest * curvature))
    if not len(curves):
        return
    fraction = np.maximum(slope[curves] / curvature[curves], shortest)[:, None]
    shortened = p[curves] + fraction * change[curves]
    shortened_gram = _gram(model.select(curves), shortened, metric)
    is_better = shortened_gram[:, -1, -1] < trial_gram[curves, -1, -1]
    trial[curves[is_better]] = shortened[is_better]
    trial_gram[curves[is_better]] = shortened_gram[is_better]


def _trial_gram(
    model: Regression, p: np.ndarray, metric: Metric, squares: np.ndarray
) -> np.ndarray:
    """Return the weighted Gram matrix of Jacobian and residuals of trial parameters.

    It is infinite where the sum of squares does not fall.

    Derivatives that are difference quotients are expensive: they are computed only where the
    squares fall.
    """
    if model.has_analytic_derivatives:
        return _gram(model, p, metric)
    gram = np.full((len(p), p.shape[-1] + 1, p.shape[-1] + 1), np.inf)
    for k, row in enumerate(p):
        curve = model.select(np.array([k]))
        try:
            r = curve.residual(row[None])
        except ForwardModelUnavailable:
            continue
        if metric.gram(r[..., None, :])[0, 0, 0] < squares[k]:
            gram[k] = _gram(curve, row[None], metric)[0]
    return gram


def _gram(model: Regression, p: np.ndarray, metric: Metric) -> np.ndarray:
    """Return the weighted Gram matrix (B, p + 1, p + 1) of Jacobian and residuals.

    It is infinite where there is no finite solution.
    """
    try:
        gram = metric.gram(model.linearize(p))
    except ForwardModelUnavailable:
        if len(p) == 1:
            return np.full((1, p.shape[-1] + 1, p.shape[-1] + 1), np.inf)
        rows = np.arange(len(p))[:, None]
        return np.concatenate([_gram(model.select(row), p[row], metric) for row in rows])
    is_finite = np.isfinite(gram).all(axis=(-2, -1), keepdims=True)
    return np.where(is_finite, gram, np.inf)


def _damped_step(gram: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Return the steps (B, p) of equations that are scaled to a unit diagonal."""
    A = gram[..., :-1, :-1]
    diagonal = np.diagonal(A, axis1=-2, axis2=-1)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = A / (scale[..., :, None] * scale[..., None, :])
    scaled += damping[:, None, None] * np.eye(A.shape[-1])
    gradient = gram[..., :-1, -1] / scale
    step: np.ndarray = np.linalg.solve(scaled, gradient[..., None])[..., 0] / scale
    return step
