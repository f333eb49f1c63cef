"""Indentation of a linear porous body full of fluid (Biot), between the sudden load and the drained
rest.

Fluid content alpha e + storage p, flux -permeability grad p, stress 2 G eps + lambda e - alpha p.
At once nothing flows: the force is that of an elastic body with the same G and the undrained
Poisson ratio; at last p = 0 and nu is the drained one. What a held depth loses between the two is
here that of a flat punch of radius a on a half-space, drained or sealed over all its surface: in
Laplace space (s in D/a^2, lengths in a), with r = (nu_u - nu)/(1 - nu) and gamma^2 = k^2 + s,

    phi(x) - int_0^1 K(x, y) phi(y) dy = 1,    F/F(0+) = (1 - r)/s int_0^1 phi dx, K = (2/pi)
    int_0^inf (1 - 1/(1 + r q/(1 - r))) cos kx cos ky dk, q = (gamma - k)/(gamma + k) of a drained
    surface,   1 - 2 k^2/(gamma (gamma + k)) of a sealed one.

delta > 0 pushes in, force > 0 pushes, p > 0 in compressed fluid. Any consistent units, any unit of
time. Sources: Biot (1941), J. Appl. Phys. 12, 155; Agbezuge & Deresiewicz (1974), Israel J.
Technol. 12, 322; Talbot's contour by Weideman (2006), SIAM J. Numer. Anal. 44, 2342.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from indent_sim.theory.half_space import check_nu
from indent_sim.theory.quadrature import Nodes, gauss_legendre, join_nodes
from indent_sim.theory.solution import require_positive
from indent_sim.theory.theory import Theory

SurfaceDrainage = Literal["drained", "sealed"]
CONTOUR_POINTS = (
    24  # points of Talbot's contour, of which half are conjugates of the others: 12 digits
)
CONTACT_POINTS = 64  # of the integral equation
# largest k [1/a], and the first panel in it: what is subtracted leaves k^-6
MAX_WAVENUMBER = 120.0
FIRST_PANEL = 1e-6
# Gauss points of a panel, and more of them for each unit of the phase k x
WAVE_POINTS = 24
WAVE_PHASE_POINTS = 0.7
# a^2/D: before it 1 - g = sqrt(tau)(A - B ln tau), of boundary layers too thin for these points
SHORT_TIME = 1e-3
SHORT_TIME_SAMPLES = SHORT_TIME, 4.0 * SHORT_TIME  # times that give A and B
# (F - F(inf))/(F(0+) - F(inf)) of a paraboloid at D t/a^2 = AT after it was pressed in at once, and
# at the end of a ramp as long, by what the tip lets through: finite elements, a/h = 0.16, nu = 0.2,
# the surface beside the tip drained
TABULATED_TIMES = (0.01, 0.1, 1.0, 10.0, 100.0)
STEP_FRACTIONS = {
    "sealed": (0.964, 0.745, 0.228, 0.0369, 1e-3),
    "drained": (0.792, 0.498, 0.182, 0.0355, 1e-3),
}
RAMP_FRACTIONS = {
    "sealed": (0.980, 0.865, 0.462, 0.1417, 0.0225),
    "drained": (0.873, 0.671, 0.3455, 0.1196, 0.0199),
}


@dataclass(frozen=True)
class PorousSolid:
    """Constants of a linear porous body: drained E [F/L^2] and nu, permeability over viscosity
    [L^4/(F T)], Biot's alpha and the storage 1/M [L^2/F]; 1 and 0 where grains and fluid are
    incompressible.

    ValueError unless E > 0, permeability > 0, -1 < nu < 0.5, 0 < alpha <= 1 and storage >= 0.
    """

    E: float
    nu: float
    permeability: float
    alpha: float = 1.0
    storage: float = 0.0

    def __post_init__(self) -> None:
        require_positive(E=self.E, permeability=self.permeability, alpha=self.alpha)
        check_nu(self.nu)
        if not (self.nu < 0.5 and self.alpha <= 1.0 and 0.0 <= self.storage < math.inf):
            given = f"nu = {self.nu!r}, alpha = {self.alpha!r}, storage = {self.storage!r}"
            raise ValueError(
                f"a porous body has a drained nu < 0.5, alpha <= 1 and storage >= 0, got {given}"
            )

    @property
    def shear_modulus(self) -> float:
        """G = E/(2 (1 + nu)) [F/L^2], drained and undrained."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def confined_modulus(self) -> float:
        """M_c = 2 G (1 - nu)/(1 - 2 nu) [F/L^2], drained."""
        return 2.0 * self.shear_modulus * (1.0 - self.nu) / (1.0 - 2.0 * self.nu)

    @property
    def diffusivity(self) -> float:
        """D = permeability/(alpha^2/M_c + storage) [L^2/T] of the fluid content."""
        return self.permeability / (self.alpha**2 / self.confined_modulus + self.storage)

    @property
    def undrained_bulk_modulus(self) -> float:
        """K_u = K + alpha^2/storage [F/L^2]; infinite without storage."""
        drained = self.E / (3.0 * (1.0 - 2.0 * self.nu))
        return drained + self.alpha**2 / self.storage if self.storage else math.inf

    @property
    def undrained_nu(self) -> float:
        """nu_u = (3 K_u - 2 G)/(2 (3 K_u + G)); 1/2 without storage."""
        ratio = self.shear_modulus / self.undrained_bulk_modulus
        return (3.0 - 2.0 * ratio) / (2.0 * (3.0 + ratio))

    @property
    def undrained_E(self) -> float:
        """E_u = 2 G (1 + nu_u) [F/L^2]."""
        return 2.0 * self.shear_modulus * (1.0 + self.undrained_nu)


class DrainageTimes(NamedTuple):
    """a^2/D and H^2/D [T]: what the fluid needs over a contact radius, and over the height of the
    body.
    """

    contact: float
    height: float


@dataclass(frozen=True)
class PoroelasticContact:
    """A tip on a porous body pressed in at once and held: by its elastic theories with the
    undrained constants and with the drained ones, and the flat punch's g between them.
    """

    solid: PorousSolid
    undrained: Theory
    drained: Theory
    surface: SurfaceDrainage = "drained"

    def limit_forces(self, delta: float) -> tuple[float, float] | None:
        """Force at once and at last [F] at a depth [L]; None where theory ends."""
        undrained_solution = self.undrained.solution_at_depth(delta)
        drained_solution = self.drained.solution_at_depth(delta)
        return (
            (undrained_solution.force, drained_solution.force)
            if undrained_solution and drained_solution
            else None
        )

    def diffusion_times(self, delta: float, height: float) -> DrainageTimes | None:
        """The times that matter at a depth [L] on a body of that height [L]; None where theory
        ends.
        """
        solution = self.undrained.solution_at_depth(delta)
        D = self.solid.diffusivity
        return DrainageTimes(solution.a**2 / D, height**2 / D) if solution else None

    def force(self, delta: float, t: float) -> float | None:
        """The force [F] a time t [T] after the tip was pressed in; None where theory ends.

        That of a half-space: over a thin layer fluid has other ways to go.
        """
        limits = self.limit_forces(delta)
        solution = self.undrained.solution_at_depth(delta)
        if limits is None or solution is None:
            return None
        tau = self.solid.diffusivity * t / solution.a**2 if solution.a > 0.0 else math.inf
        return limits[1] + (limits[0] - limits[1]) * poroelastic_fraction_remaining(
            tau, self.solid.nu, self.solid.undrained_nu, self.surface
        )


def paraboloid_fraction_remaining(
    tau: float, tip: SurfaceDrainage, loading: Literal["step", "ramp"]
) -> float:
    """About what is left of F(0+) - F(inf) of a paraboloid at tau = D t/a^2 after a sudden depth
    that is held, or at the end of a ramp of that length: from 1 to 0.

    Within 0.02 of it up to tau = 0.1, else 0.1, for nu = 0 to 0.4 and a/h = 0.05 to 0.5. Between
    and beyond what was computed ln(left/(1 - left)) is straight over ln tau.
    """
    if tau <= 0.0 or math.isinf(tau):
        return float(tau <= 0.0)
    fractions = np.array((STEP_FRACTIONS if loading == "step" else RAMP_FRACTIONS)[tip])
    x = np.log(TABULATED_TIMES)
    y = np.log(fractions / (1.0 - fractions))
    k = int(np.clip(np.searchsorted(x, math.log(tau)), 1, len(x) - 1))
    log_odds = y[k - 1] + (y[k] - y[k - 1]) * (math.log(tau) - x[k - 1]) / (x[k] - x[k - 1])
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))


@lru_cache(maxsize=4096)
def poroelastic_fraction_remaining(
    tau: float, nu: float, undrained_nu: float = 0.5, surface: SurfaceDrainage = "drained"
) -> float:
    """g = (F - F(inf))/(F(0+) - F(inf)) of a flat punch on a porous half-space at tau = D t/a^2:
    from 1 to 0.

    8 digits from tau = 1e-3 on, 3 before. ValueError unless tau >= 0 and -1 < nu < undrained_nu <=
    0.5.
    """
    check_nu(nu)
    if not (tau >= 0.0 and nu < undrained_nu <= 0.5):
        raise ValueError(
            f"needs tau >= 0 and nu < undrained_nu <= 0.5, got {tau!r}, {nu!r}, {undrained_nu!r}"
        )
    if tau == 0.0 or math.isinf(tau):
        return float(tau == 0.0)
    if tau < SHORT_TIME:
        return _short_time_fraction(tau, nu, undrained_nu, surface)
    r = (undrained_nu - nu) / (1.0 - nu)
    points, weights = _talbot_contour(CONTOUR_POINTS)
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
    """The fluid has left a thin layer alone; the punch's edge, whose pressure is infinite, brings
    the logarithm.
    """
    slopes = [
        (1.0 - poroelastic_fraction_remaining(t, nu, undrained_nu, surface)) / math.sqrt(t)
        for t in SHORT_TIME_SAMPLES
    ]
    per_log = (slopes[1] - slopes[0]) / math.log(SHORT_TIME_SAMPLES[1] / SHORT_TIME_SAMPLES[0])
    return 1.0 - math.sqrt(tau) * (slopes[0] + per_log * math.log(tau / SHORT_TIME_SAMPLES[0]))


@lru_cache
def _talbot_contour(count: int) -> Nodes:
    """Points z of the upper half of Talbot's contour and weights: f(t) = Re sum w F(z/t)/t
    (Weideman 2006).
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
    """Wavenumbers k, their weights, and cos(k x) at the points of the equation."""
    edges = [
        0.0,
        *np.geomspace(
            FIRST_PANEL, MAX_WAVENUMBER, math.ceil(math.log(MAX_WAVENUMBER / FIRST_PANEL, 3.0))
        ),
    ]
    parts = [
        gauss_legendre(low, high, WAVE_POINTS + math.ceil(WAVE_PHASE_POINTS * (high - low)))
        for low, high in pairwise(edges)
    ]
    k, weights = join_nodes(parts)
    return k, weights, np.cos(np.outer(gauss_legendre(0.0, 1.0, CONTACT_POINTS)[0], k))


def _laplace_transform(s: complex, r: float, surface: SurfaceDrainage) -> complex:
    """Laplace transform of F/F(0+) at s [D/a^2]."""
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
        """(1/pi) int_0^inf of what was subtracted, times cos kz."""
        return root * (first / 2.0 + second / 4.0 * (1.0 + root * z)) * np.exp(-root * z)

    def integral(z: np.ndarray) -> np.ndarray:
        """int_0^z kernel."""
        return (first + second) / 2.0 * (
            1.0 - np.exp(-root * z)
        ) - second / 4.0 * root * z * np.exp(-root * z)

    near_kernel = kernel(np.abs(x[:, None] - x)) * w
    smooth_kernel = (
        2.0 / math.pi * (cosines * (remainder * weights)) @ cosines.T + kernel(x[:, None] + x)
    ) * w
    diagonal_correction = (
        integral(x) + integral(1.0 - x) - near_kernel.sum(axis=1)
    )  # what the points miss of a constant, all on the diagonal
    phi = np.linalg.solve(
        np.eye(CONTACT_POINTS) - smooth_kernel - near_kernel - np.diag(diagonal_correction),
        np.ones(CONTACT_POINTS),
    )
    return complex((1.0 - r) / s * (w @ phi))


def _compliance_deficit(
    k: np.ndarray, s: complex, contrast: float, surface: SurfaceDrainage
) -> np.ndarray:
    """1 - 1/(1 + contrast q): by how much less a wave finds the surface compliant than when
    drained.
    """
    gamma = np.sqrt(k * k + s)
    q = (
        s / (gamma + k) ** 2
        if surface == "drained"
        else s * (1.0 + k / (gamma + k)) / (gamma * (gamma + k))
    )
    return contrast * q / (1.0 + contrast * q)


def _large_wavenumber_coefficients(
    contrast: float, surface: SurfaceDrainage
) -> tuple[float, float]:
    """First and second coefficient of `_softer` in powers of s/(k^2 + s)."""
    if surface == "drained":
        return contrast / 4.0, contrast / 8.0 - contrast**2 / 16.0
    return 3.0 * contrast / 4.0, contrast / 8.0 - 9.0 * contrast**2 / 16.0
