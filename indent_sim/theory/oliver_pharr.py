"""Hardness and modulus from the unloading curve of an indentation test (Oliver and Pharr).

Symbols of ISO 14577-1: h is the depth [L] from first contact, F > 0 the pushing force [F]. Any
consistent units; a pressure is [F/L^2]. ValueError is raised for numbers without meaning.

Sources: Oliver & Pharr (1992), J. Mater. Res. 7, 1564; ISO 14577-1; Pharr & Bolshakov (2002),
J. Mater. Res. 17, 2660.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from indent_sim.theory.half_space import check_nu
from indent_sim.theory.solution import require_positive

# Young's modulus [Pa] and Poisson's ratio [-] of diamond: Oliver & Pharr (1992), ISO 14577-1.
DIAMOND_E = 1141e9
DIAMOND_NU = 0.07
# Exponents of the contact depth in the area function A = sum C_k h_c^p_k: Oliver & Pharr (1992).
AREA_EXPONENTS = (2.0, 1.0, 0.5, 0.25, 0.125)
# Confidence of the intervals whose half-widths are the stated errors.
CONFIDENCE = 0.95
# Smallest number of samples of a fit: two more than the three parameters of the power law.
MIN_SAMPLES = 5


def contact_depth(h_max: float, F_max: float, S: float, epsilon: float) -> float:
    """Return the contact depth h_c = h_max - epsilon F_max/S [L].

    epsilon is 0.75 for a paraboloid, 2 (pi - 2)/pi = 0.727 for a cone, and 1 for a flat punch.
    """
    require_positive(S=S)
    return h_max - epsilon * F_max / S


def reduced_modulus(S: float, area: float, beta: float) -> float:
    """Return the reduced modulus E_r = sqrt(pi) S/(2 beta sqrt(A)) [F/L^2].

    beta is 1 for a circular contact of a body of revolution.
    """
    require_positive(area=area, beta=beta)
    return sqrt(pi) * S / (2.0 * beta * sqrt(area))


def area_of_stiffness(S: float, E_r: float, beta: float) -> float:
    """Return the area pi (S/(2 beta E_r))^2 of a contact of known reduced modulus [L^2]."""
    require_positive(S=S, E_r=E_r, beta=beta)
    return pi * (S / (2.0 * beta * E_r)) ** 2


def area_function(h_c: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Return the areas (n,) [L^2] at contact depths (n,) [L] by the powers of AREA_EXPONENTS."""
    return np.asarray(_area_powers(h_c) @ coefficients)


def fit_area_function(h_c: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return the coefficients (5,) of an area function by least squares of relative differences.

    No coefficient is negative, so that the area increases with the contact depth.

    Parameters
    ----------
    h_c, area
        Contact depths [L] and areas [L^2] of measurements (n,), all positive.
    """
    from scipy.optimize import nnls

    relative = _area_powers(h_c) / np.asarray(area)[:, None]
    # Columns of unit length keep the least squares well conditioned in any unit of length.
    sizes = np.linalg.norm(relative, axis=0)
    return np.asarray(nnls(relative / sizes, np.ones(len(relative)))[0] / sizes)


def _area_powers(h_c: np.ndarray) -> np.ndarray:
    """Return the powers (n, 5) of contact depths (n,) in the area function."""
    return np.asarray(h_c)[:, None] ** np.array(AREA_EXPONENTS)


def indentation_modulus(E_r: float, nu: float, tip_E_star: float = math.inf) -> float:
    """Return E_IT from 1/E_r = (1 - nu^2)/E_IT + 1/E_i* [F/L^2].

    Parameters
    ----------
    E_r
        Reduced modulus [F/L^2].
    nu
        Poisson's ratio of the sample [-].
    tip_E_star
        Plane-strain modulus E_i* = E_i/(1 - nu_i^2) of the tip [F/L^2]; infinite if it is rigid.
    """
    require_positive(E_r=E_r)
    check_nu(nu)
    compliance = 1.0 / E_r - 1.0 / tip_E_star
    if not compliance > 0:
        raise ValueError(
            f"the reduced modulus {E_r:.4g} is not below the plane-strain modulus "
            f"{tip_E_star:.4g} of the tip"
        )
    return (1.0 - nu**2) / compliance


def epsilon_of_exponent(m: float) -> float:
    """Return epsilon of an elastic contact whose unloading curve has the exponent m [-].

    epsilon = m (1 - 2 (m - 1) Gamma(m/(2 (m - 1)))/(sqrt(pi) Gamma(1/(2 (m - 1))))), with the
    limit 1 for m = 1 (Pharr & Bolshakov 2002).
    """
    if not m >= 1:
        raise ValueError(f"the exponent m = {m!r} is less than 1")
    # Below this distance from 1 the limit is correct to four digits.
    if m - 1 < 1e-9:
        return 1.0
    inverse = 1.0 / (2.0 * (m - 1.0))
    ratio = math.exp(math.lgamma(m * inverse) - math.lgamma(inverse))
    return m * (1.0 - 2.0 * (m - 1.0) * ratio / sqrt(pi))


@dataclass(frozen=True)
class UnloadingFit:
    """Power law F = B (h - h_f)^m of the upper part of an unloading curve.

    Attributes
    ----------
    h_max
        Depth at which unloading starts [L].
    force
        Force of the power law at h_max [F].
    stiffness
        Contact stiffness S = dF/dh of the power law at h_max [F/L].
    exponent
        Exponent m [-].
    covariance
        Covariance (3, 3) of force, stiffness and exponent.
    residual
        Root mean square of the differences in force [F].
    samples
        Number of samples.
    """

    h_max: float
    force: float
    stiffness: float
    exponent: float
    covariance: np.ndarray
    residual: float
    samples: int

    @property
    def h_f(self) -> float:
        """Depth at which the force of the power law vanishes, h_max - m F/S [L]."""
        return self.h_max - self.exponent * self.force / self.stiffness

    @property
    def h_f_deviation(self) -> float:
        """Standard deviation of h_f [L]."""
        F = self.force
        S = self.stiffness
        m = self.exponent
        gradient = np.array([-m / S, m * F / S**2, -F / S])
        return float(np.sqrt(max(gradient @ self.covariance @ gradient, 0.0)))

    @property
    def B(self) -> float:
        """Factor B of the power law [F/L^m]."""
        return float(self.force / (self.h_max - self.h_f) ** self.exponent)

    @property
    def coverage_factor(self) -> float:
        """Half-width of the interval of CONFIDENCE over the standard deviation (Student's t)."""
        from scipy.stats import t

        return float(t.ppf(0.5 + CONFIDENCE / 2, self.samples - 3))

    def work_below(self, force: float) -> float:
        """Return the work of the power law from a force down to zero [F L]."""
        m = self.exponent
        recovery = (self.h_max - self.h_f) * (force / self.force) ** (1.0 / m)
        return force * recovery / (m + 1.0)


def fit_unloading(
    h: np.ndarray, F: np.ndarray, h_max: float, F_noise: float = 0.0, h_noise: float = 0.0
) -> UnloadingFit:
    """Fit the power law to samples of an unloading curve by least squares.

    The parameters are the force, the stiffness S and the exponent m at h_max, on which the samples
    depend almost independently of each other: F(h) = F_0 (1 - S (h_max - h)/(m F_0))^m. The squares
    of the differences in force are divided by their variance F_noise^2 + (F' h_noise)^2, so that
    scatter of the depth does not reduce the stiffness of a steep curve. F' is the slope between the
    curve at the depth and at the force of the sample, which is bounded: with the tangent, a power
    law that ends above all samples with an infinite slope would fit best. The covariance is
    increased by (1 + rho)/(1 - rho) for residuals whose correlation from sample to sample is
    rho > 0.

    Parameters
    ----------
    h, F
        Depths [L] and forces [F] of the samples (n,), with n >= MIN_SAMPLES.
    h_max
        Depth at which unloading starts [L].
    F_noise, h_noise
        Standard deviations of force [F] and depth [L]; only their ratio matters.

    Raises
    ------
    ValueError
        If there are too few samples, or no power law fits them.
    """
    from scipy.optimize import least_squares

    if len(h) < MIN_SAMPLES:
        raise ValueError(f"{len(h)} samples, but the power law needs at least {MIN_SAMPLES}")
    length = float(np.ptp(h))
    size = float(np.max(F))
    require_positive(length=length, size=size)
    x = (h_max - h) / length
    y = F / size
    y_noise = F_noise / size
    x_noise = h_noise / length
    # Without noise all differences in force have the same weight.
    scale = math.hypot(y_noise, x_noise) or 1.0
    y_weight = y_noise / scale if y_noise or x_noise else 1.0
    x_weight = x_noise / scale

    def residuals(parameters: np.ndarray) -> np.ndarray:
        force, stiffness, m = parameters
        base = np.maximum(1.0 - stiffness * x / (m * force), 1e-12)
        difference = y - force * base**m
        # Slope between the points of the power law at the depth and at the force of a sample.
        distance = x - m * force / stiffness * (1.0 - (np.maximum(y, 0.0) / force) ** (1.0 / m))
        tangent = stiffness * base ** (m - 1.0)
        slope = np.divide(difference, distance, out=tangent, where=np.abs(distance) > 1e-9)
        return np.asarray(difference / np.hypot(y_weight, x_weight * slope))

    starts = [start for m in (1.0, 1.25, 1.5, 2.0, 3.0) if (start := _start(x, y, m)) is not None]
    if not starts:
        raise ValueError("the force does not decrease with the depth")
    best = min(starts, key=lambda start: float(np.sum(residuals(start) ** 2)))
    fit = least_squares(
        residuals,
        best,
        bounds=([1e-3, 1e-6, 0.1], [10.0, 1e6, 20.0]),
        x_scale=np.maximum(np.abs(best), 1e-3),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=500,
    )
    if fit.status == 0:
        raise ValueError("the fit of the power law does not converge")
    force, stiffness, m = map(float, fit.x)
    units = np.array([size, size / length, 1.0])
    base = np.maximum(1.0 - stiffness * x / (m * force), 0.0)
    return UnloadingFit(
        h_max,
        force * size,
        stiffness * size / length,
        m,
        _covariance(fit.jac, fit.fun) * np.outer(units, units),
        size * float(np.sqrt(np.mean((y - force * base**m) ** 2))),
        len(h),
    )


def _start(x: np.ndarray, y: np.ndarray, m: float) -> np.ndarray | None:
    """Return force, stiffness and exponent from the line through y^(1/m); None if it rises."""
    slope, intercept = np.polyfit(x, np.maximum(y, 0.0) ** (1.0 / m), 1)
    if not (slope < 0 and intercept > 0):
        return None
    force = intercept**m
    return np.array([force, -slope * m * force / intercept, m])


def _covariance(jacobian: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Return the covariance of least squares with residuals that may be correlated."""
    n, parameters = jacobian.shape
    square = float(residuals @ residuals)
    correlation = float(residuals[:-1] @ residuals[1:]) / square if square > 0 else 0.0
    # At the upper bound of the correlation about one independent residual remains.
    bounded = min(max(correlation, 0.0), 1.0 - 2.0 / n)
    factor = (1.0 + bounded) / (1.0 - bounded)
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    return np.asarray(inverse * square / (n - parameters) * factor)
