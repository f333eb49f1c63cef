"""Indentation of a linear poroelastic body (Biot), solved by Laplace transform for a flat punch.

The fluid content is alpha e + storage p, the flux -permeability grad p and the stress 2 G eps +
lambda e - alpha p, with the volume strain e and the pore pressure p. Just after a sudden load no
fluid has flowed, and the body responds like an elastic body with the same G and the undrained
Poisson's ratio nu_u. In the drained limit p = 0, and Poisson's ratio is nu.

Between these limits, the force at a constant depth is computed for a flat punch of radius a on a
half-space whose surface is drained or sealed everywhere. In Laplace space (s in D/a^2, lengths in
a), with r = (nu_u - nu)/(1 - nu) and gamma^2 = k^2 + s,

    phi(x) - int_0^1 K(x, y) phi(y) dy = 1,    F/F(0+) = (1 - r)/s int_0^1 phi dx,
    K(x, y) = (2/pi) int_0^inf (1 - 1/(1 + r q/(1 - r))) cos kx cos ky dk,
    q = (gamma - k)/(gamma + k)           for a drained surface,
    q = 1 - 2 k^2/(gamma (gamma + k))     for a sealed one.

delta and force are > 0 in indentation, p > 0 in compressed fluid. Any consistent units, and any
unit of time [T].
Sources: Biot (1941), J. Appl. Phys. 12, 155; Agbezuge & Deresiewicz (1974), Israel J. Technol. 12,
322; Weideman (2006), SIAM J. Numer. Anal. 44, 2342, for Talbot's contour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np

from indent_sim.theory.half_space import check_nu
from indent_sim.theory.measured_constants import (
    DRAINAGE_RAMP_FRACTIONS,
    DRAINAGE_STEP_FRACTIONS,
    DRAINAGE_TIMES,
)
from indent_sim.theory.quadrature import Nodes, gauss_legendre, join_nodes
from indent_sim.theory.solution import require_positive

SurfaceDrainage = Literal["drained", "sealed"]
CONTACT_POINTS = 64  # Gauss points of the integral equation.
# Times tau = D t/a^2 below which 1 - g = sqrt(tau) (A - B ln tau) is used: the boundary layers are
# too thin for these points. A and B are those of the two sample times.
SHORT_TIME = 1e-3
SHORT_TIME_SAMPLES = SHORT_TIME, 4.0 * SHORT_TIME


@dataclass(frozen=True)
class PorousSolid:
    """Constants of a linear poroelastic body.

    Attributes
    ----------
    E, nu
        Young's modulus [F/L^2] and Poisson's ratio of the drained body.
    permeability
        Permeability over the viscosity of the fluid [L^4/(F T)].
    alpha
        Biot's coefficient, 1 for incompressible grains.
    storage
        Storage coefficient 1/M [L^2/F], 0 if grains and fluid are incompressible.

    Raises
    ------
    ValueError
        Unless E > 0, permeability > 0, -1 < nu < 0.5, 0 < alpha <= 1 and storage >= 0.
    """

    E: float
    nu: float
    permeability: float
    alpha: float = 1.0
    storage: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError if a constant is outside its range."""
        require_positive(E=self.E, permeability=self.permeability, alpha=self.alpha)
        check_nu(self.nu)
        if not (self.nu < 0.5 and self.alpha <= 1.0 and 0.0 <= self.storage < math.inf):
            given = f"nu = {self.nu!r}, alpha = {self.alpha!r}, storage = {self.storage!r}"
            raise ValueError(
                "a poroelastic body needs a drained nu < 0.5, alpha <= 1 and storage >= 0, got "
                f"{given}"
            )

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E/(2 (1 + nu)) [F/L^2], the same drained and undrained."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def confined_modulus(self) -> float:
        """Drained oedometric modulus M_c = 2 G (1 - nu)/(1 - 2 nu) [F/L^2]."""
        return 2.0 * self.shear_modulus * (1.0 - self.nu) / (1.0 - 2.0 * self.nu)

    @property
    def diffusivity(self) -> float:
        """Diffusivity D = permeability/(alpha^2/M_c + storage) [L^2/T] of the fluid content."""
        return self.permeability / (self.alpha**2 / self.confined_modulus + self.storage)

    @property
    def undrained_bulk_modulus(self) -> float:
        """Undrained bulk modulus K_u = K + alpha^2/storage [F/L^2], infinite for storage = 0."""
        drained = self.E / (3.0 * (1.0 - 2.0 * self.nu))
        return drained + self.alpha**2 / self.storage if self.storage else math.inf

    @property
    def undrained_nu(self) -> float:
        """Undrained Poisson's ratio nu_u = (3 K_u - 2 G)/(2 (3 K_u + G)), 1/2 for storage = 0."""
        ratio = self.shear_modulus / self.undrained_bulk_modulus
        return (3.0 - 2.0 * ratio) / (2.0 * (3.0 + ratio))

    @property
    def undrained_E(self) -> float:
        """Undrained Young's modulus E_u = 2 G (1 + nu_u) [F/L^2]."""
        return 2.0 * self.shear_modulus * (1.0 + self.undrained_nu)


def paraboloid_fraction_remaining(
    tau: float, tip: SurfaceDrainage, loading: Literal["step", "ramp"]
) -> float:
    """Return the approximate (F - F(inf))/(F(0+) - F(inf)) of a paraboloid, from 1 to 0.

    ln(fraction/(1 - fraction)) is interpolated and extrapolated linearly in ln tau from the table
    of `measured_constants`. The error is 0.02 up to tau = 0.1 and 0.1 beyond, for nu = 0 to 0.4 and
    a/h = 0.05 to 0.5.

    Parameters
    ----------
    tau
        D t/a^2, where t is the time after a step to a constant depth, or the duration of a ramp;
        for a ramp the fraction at its end is returned.
    tip
        "drained" if fluid can pass through the surface of the tip, otherwise "sealed".
    loading
        "step" or "ramp": how the depth is applied.
    """
    if tau <= 0.0 or math.isinf(tau):
        return float(tau <= 0.0)
    table = DRAINAGE_STEP_FRACTIONS if loading == "step" else DRAINAGE_RAMP_FRACTIONS
    fractions = np.array(table[tip])
    x = np.log(DRAINAGE_TIMES)
    y = np.log(fractions / (1.0 - fractions))
    k = int(np.clip(np.searchsorted(x, math.log(tau)), 1, len(x) - 1))
    log_odds = y[k - 1] + (y[k] - y[k - 1]) * (math.log(tau) - x[k - 1]) / (x[k] - x[k - 1])
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))


@lru_cache(maxsize=4096)
def poroelastic_fraction_remaining(
    tau: float, nu: float, undrained_nu: float = 0.5, surface: SurfaceDrainage = "drained"
) -> float:
    """Return g = (F - F(inf))/(F(0+) - F(inf)) of a flat punch on a half-space, from 1 to 0.

    The result is accurate to eight digits for tau >= 1e-3, and to three digits for shorter times.

    Parameters
    ----------
    tau
        Time D t/a^2 after a step to a constant depth.
    nu, undrained_nu
        Drained and undrained Poisson's ratio.
    surface
        "drained" or "sealed": condition of the whole surface, also under the punch.

    Raises
    ------
    ValueError
        Unless tau >= 0 and -1 < nu < undrained_nu <= 0.5.
    """
    check_nu(nu)
    if not (tau >= 0.0 and nu < undrained_nu <= 0.5):
        raise ValueError(
            "the flat punch needs tau >= 0 and nu < undrained_nu <= 0.5, got "
            f"{tau!r}, {nu!r}, {undrained_nu!r}"
        )
    if tau == 0.0 or math.isinf(tau):
        return float(tau == 0.0)
    if tau < SHORT_TIME:
        return _short_time_fraction(tau, nu, undrained_nu, surface)
    r = (undrained_nu - nu) / (1.0 - nu)
    # 24 points give twelve digits; half of them are conjugates of the others.
    points, weights = _talbot_contour(24)
    ratio = (
        sum(
            (w * _laplace_transform(z / tau, r, surface)).real
            for z, w in zip(points, weights, strict=True)
        )
        / tau
    )
    return (ratio - (1.0 - r)) / r


def _short_time_fraction(
    tau: float, nu: float, undrained_nu: float, surface: SurfaceDrainage
) -> float:
    """Return g at a short time from the asymptotic form 1 - g = sqrt(tau) (A - B ln tau).

    Fluid has left only a thin boundary layer; the logarithm is due to the infinite pressure at the
    edge of the punch.
    """
    slopes = [
        (1.0 - poroelastic_fraction_remaining(t, nu, undrained_nu, surface)) / math.sqrt(t)
        for t in SHORT_TIME_SAMPLES
    ]
    log_slope = (slopes[1] - slopes[0]) / math.log(SHORT_TIME_SAMPLES[1] / SHORT_TIME_SAMPLES[0])
    return 1.0 - math.sqrt(tau) * (slopes[0] + log_slope * math.log(tau / SHORT_TIME_SAMPLES[0]))


@lru_cache
def _talbot_contour(count: int) -> Nodes:
    """Return points z of the upper half of Talbot's contour and weights w (Weideman 2006).

    The inverse Laplace transform of F is f(t) = Re sum w F(z/t)/t.
    """
    angle = (2.0 * np.arange(count // 2) + 1.0) * math.pi / count
    a = 0.5017
    b = 0.6407
    c = 0.6122
    d = 0.2645
    z = count * (a * angle / np.tan(b * angle) - c + 1j * d * angle)
    slope = count * (a / np.tan(b * angle) - a * b * angle / np.sin(b * angle) ** 2 + 1j * d)
    return z, 2.0 * np.exp(z) * slope / (1j * count)


@lru_cache
def _wave_nodes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return wavenumbers k, quadrature weights, and cos(k x) (points, k) at contact points x."""
    # Largest wavenumber k [1/a] and end of the first panel: the integrand decays like k^-6 once its
    # first two terms for large k are subtracted.
    max_wavenumber = 120.0
    first_panel = 1e-6
    edges = [
        0.0,
        *np.geomspace(
            first_panel, max_wavenumber, math.ceil(math.log(max_wavenumber / first_panel, 3.0))
        ),
    ]
    parts = [
        # Wide panels, in which cos(k x) oscillates, have more Gauss points.
        gauss_legendre(low, high, 24 + math.ceil(0.7 * (high - low)))
        for low, high in pairwise(edges)
    ]
    k, weights = join_nodes(parts)
    return k, weights, np.cos(np.outer(gauss_legendre(0.0, 1.0, CONTACT_POINTS)[0], k))


def _laplace_transform(s: complex, r: float, surface: SurfaceDrainage) -> complex:
    """Return the Laplace transform of F/F(0+) at s [D/a^2] by Nystrom's method.

    The first two terms of the integrand for large k are subtracted. Their transform is known in
    closed form and has a kink at x = y, whose quadrature error is corrected on the diagonal.
    """
    x, w = gauss_legendre(0.0, 1.0, CONTACT_POINTS)
    k, weights, cosines = _wave_nodes()
    contrast = r / (1.0 - r)
    root = np.sqrt(s)
    first, second = _large_wavenumber_coefficients(contrast, surface)
    wave_share = s / (k * k + s)
    remainder = (
        _compliance_deficit(k, s, contrast, surface) - first * wave_share - second * wave_share**2
    )

    def kernel(z: np.ndarray) -> np.ndarray:
        """Return 1/pi times the integral over k of the subtracted terms multiplied by cos kz."""
        return root * (first / 2.0 + second / 4.0 * (1.0 + root * z)) * np.exp(-root * z)

    def integral(z: np.ndarray) -> np.ndarray:
        """Return the integral of `kernel` from 0 to z."""
        return (first + second) / 2.0 * (
            1.0 - np.exp(-root * z)
        ) - second / 4.0 * root * z * np.exp(-root * z)

    near_kernel = kernel(np.abs(x[:, None] - x)) * w
    smooth_kernel = (
        2.0 / math.pi * (cosines * (remainder * weights)) @ cosines.T + kernel(x[:, None] + x)
    ) * w
    # The diagonal makes the integral of this kernel exact for a constant phi.
    diagonal_correction = integral(x) + integral(1.0 - x) - near_kernel.sum(axis=1)
    phi = np.linalg.solve(
        np.eye(CONTACT_POINTS) - smooth_kernel - near_kernel - np.diag(diagonal_correction),
        np.ones(CONTACT_POINTS),
    )
    return complex((1.0 - r) / s * (w @ phi))


def _compliance_deficit(
    k: np.ndarray, s: complex, contrast: float, surface: SurfaceDrainage
) -> np.ndarray:
    """Return 1 - 1/(1 + contrast q) at k: the relative reduction of the drained compliance."""
    gamma = np.sqrt(k * k + s)
    if surface == "drained":
        q = s / (gamma + k) ** 2
    else:
        q = s * (1.0 + k / (gamma + k)) / (gamma * (gamma + k))
    return contrast * q / (1.0 + contrast * q)


def _large_wavenumber_coefficients(
    contrast: float, surface: SurfaceDrainage
) -> tuple[float, float]:
    """Return two coefficients of the expansion of `_compliance_deficit` in s/(k^2 + s)."""
    if surface == "drained":
        return contrast / 4.0, contrast / 8.0 - contrast**2 / 16.0
    return 3.0 * contrast / 4.0, contrast / 8.0 - 9.0 * contrast**2 / 16.0
