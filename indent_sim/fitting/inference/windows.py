"""Windows: the fit to shallower and shallower parts of a curve, and whether it moves by more than
its noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indent_sim.fitting.inference.estimate import (
    FEWEST_PUSHING,
    Estimate,
    Model,
    averaged_at,
    rebased,
)
from indent_sim.fitting.inference.noise import NORMAL_95
from indent_sim.fitting.scene_curve.lattice import NoTable

WINDOW_DEPTHS = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the depth
LEAST_DEVIATION = 0.1  # of the window's own: of its difference to the whole


@dataclass(frozen=True)
class Window:
    """The ordinary fit to the depths up to a share `upper` of the deepest: coordinates theta (k,),
    their standard deviations, and z, their difference to the whole curve's in standard
    deviations of that difference.
    """

    upper: float
    theta: np.ndarray
    sd: np.ndarray
    z: np.ndarray

    def interval(self, k: int) -> tuple[float, float]:
        """The window's own 95 % interval of a coordinate."""
        half = NORMAL_95 * float(self.sd[k])
        return float(self.theta[k]) - half, float(self.theta[k]) + half


def windows(estimate: Estimate) -> list[Window]:
    """The windows of a fit, the shallowest first; one with too few points in contact is left out.

    Where the scene relaxes a window ends at a share of the time in contact.

    The difference of two ordinary fits is linear in the noise, D = pinv(J_u) - pinv(J) with zeros
    where the window has no rows: its variance is s2 D V D', V and s2 being the noise of the whole.
    """
    model = estimate.model
    p = estimate.ordinary
    free = model.free
    whole = np.linalg.pinv(model.jacobian(p)[:, free])
    progress = _progress(model, float(p[model.size]))
    found = (_window(estimate, whole, upper, progress <= upper) for upper in WINDOW_DEPTHS)
    return [window for window in found if window is not None]


def _progress(model: Model, c: float) -> np.ndarray:
    """How far each sample is from first touch to the deepest one; in time where the scene relaxes,
    and may be held.
    """
    x = model.samples.x
    t = model.samples.t
    if model.forces.relaxes and t is not None and np.any(x > c):
        first = t[np.argmax(x > c)]
        return (t - first) / max(float(t[-1] - first), 1e-300)  # type: ignore[no-any-return]
    return (x - c) / max(float(x.max()) - c, 1e-300)  # type: ignore[no-any-return]


def _window(
    estimate: Estimate, whole: np.ndarray, upper: float, inside: np.ndarray
) -> Window | None:
    model = estimate.model
    free = estimate.model.free
    if np.count_nonzero(inside & (model.samples.x > estimate.contact_point)) < FEWEST_PUSHING:
        return None
    part = Model(model.forces, model.samples.where(inside), model.origin)
    try:
        p, _ = part.fitted(rebased(model, part, estimate.ordinary))
        J = part.jacobian(p)[:, free]
        own = averaged_at(part, p)
    except (NoTable, ValueError, np.linalg.LinAlgError):
        return None
    k = model.size
    D = -whole[:k].copy()
    D[:, inside] += np.linalg.pinv(J)[:k]
    noise = estimate.found
    sd = np.sqrt(np.maximum(noise.s2 * np.einsum("ij,ji->i", D, noise.likeliest.times(D.T)), 0.0))
    sd = np.maximum(sd, LEAST_DEVIATION * own.sd[:k])
    theta = p[:k]
    return Window(
        upper, theta, own.sd[:k], (theta - estimate.ordinary[:k]) / np.where(sd > 0, sd, 1.0)
    )
