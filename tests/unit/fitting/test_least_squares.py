"""Least squares of many curves: steps that overshoot the minimum."""

from __future__ import annotations

import numpy as np

from indent_sim.fitting.inference.least_squares import minimize_squares


class Valley:
    """Residuals (p, 1 + p^2/2), whose squares are 1 + 2 p^2 near the minimum at 0.

    The method of Gauss and Newton takes half of their curvature, since it neglects the second
    derivatives: its step ends at -p, where the squares are the same.
    """

    has_analytic_derivatives = shortens_steps = True

    def __init__(self) -> None:
        self.evaluations = 0

    def select(self, curves: np.ndarray) -> Valley:
        return self

    def residual(self, p: np.ndarray) -> np.ndarray:
        return np.concatenate([p, 1.0 + 0.5 * p**2], axis=-1)

    def linearize(self, p: np.ndarray) -> np.ndarray:
        """Derivatives of the modelled forces, minus those of the residuals, and the residuals."""
        self.evaluations += len(p)
        derivatives = np.concatenate([-np.ones_like(p), -p], axis=-1)
        return np.stack([derivatives, self.residual(p)], axis=1)

    def clip_to_bounds(self, p: np.ndarray) -> np.ndarray:
        return p

    def limit_step(self, step: np.ndarray) -> np.ndarray:
        return step


class Plain:
    """Metric of white noise."""

    def gram(self, X: np.ndarray) -> np.ndarray:
        return X @ np.swapaxes(X, -1, -2)


def test_a_step_across_a_valley_ends_in_it():
    """Two steps along the parabola of the squares end at the minimum, not at its other side.

    Without it the steps alternate until the damping has grown by a factor of 1000.
    """
    valley = Valley()
    p, squares = minimize_squares(valley, np.array([[0.1], [-0.02]]), Plain())
    # A relative change of the squares of 1e-9, at which it ends, is one of p by 2e-5.
    np.testing.assert_allclose(p, 0.0, atol=2e-5)
    np.testing.assert_allclose(squares, 1.0, rtol=1e-9)
    assert valley.evaluations <= 2 * 6
