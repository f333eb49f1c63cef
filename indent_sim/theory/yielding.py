"""Contact of a body that yields: onset of yield, contact radius and pressure of a rigid tip.

The body is elastic and perfectly plastic or hardens isotropically, after von Mises. p0 is the
largest contact pressure, sigma_y the yield stress, tan(beta) the slope of the tip at the contact
edge, and sigma_r the flow stress at the plastic strain 0.2 tan(beta) (Tabor). Any consistent units;
[L] is a length and [F] a force.

Sources: Johnson (1985), Contact Mechanics, 3.4, 4.2 and 6.3; Tabor (1951), The Hardness of Metals;
Dao, Chollacoop, Van Vliet, Venkatesh & Suresh (2001), Acta Mater. 49, 3899.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import exp, log, pi

import numpy as np

from indent_sim.theory.half_space import check_nu
from indent_sim.theory.measured_constants import (
    PRESSURE_OFFSET,
    ROUND_CONTACT_HEIGHTS,
    ROUND_STRAIN_RATIOS,
    SHARP_CONTACT_HEIGHTS,
    SHARP_STRAIN_RATIOS,
)
from indent_sim.theory.solution import require_positive

# Largest mean pressure, divided by the flow stress: rigid-plastic indentation.
RIGID_PLASTIC_PRESSURE = 2.7
# Half-angle [degrees] of the cone with the cross-sections of a Berkovich pyramid, for which the
# functions of Dao et al. were computed, and the difference that they allow.
DAO_HALF_ANGLE = 70.3
DAO_ANGLE_TOLERANCE = 0.5
# Poisson's ratio of their runs, and the difference that they allow.
DAO_NU = 0.3
DAO_NU_TOLERANCE = 0.05
# Largest exponent of power-law hardening of their runs.
DAO_MAX_EXPONENT = 0.5
# Range of ln(E*/sigma_0.033) of their runs.
DAO_RANGE = (3.2, 6.7)
# Relative error of their functions [-].
DAO_ERROR = 0.03
# Plastic strain at which Dao et al. take the flow stress as the representative one.
DAO_STRAIN = 0.033


@dataclass(frozen=True)
class Onset:
    """Contact at the onset of yield.

    Attributes
    ----------
    delta
        Depth [L].
    force
        Force [F].
    a
        Contact radius [L].
    """

    delta: float
    force: float
    a: float


def onset_pressure(nu: float) -> float:
    """Return p0/sigma_y at the onset of yield below a Hertzian contact.

    The von Mises stress is largest on the axis below the surface, or for small nu at the edge of
    the contact. ValueError is raised unless -1 < nu <= 0.5.
    """
    check_nu(nu)
    z = np.linspace(0.0, 2.0, 2001)
    for _ in range(3):
        stress = np.abs(_axis_stress(z, nu))
        top = int(np.argmax(stress))
        z = np.linspace(z[max(top - 1, 0)], z[min(top + 1, len(z) - 1)], 101)
    edge_stress = (1 - 2 * nu) / np.sqrt(3.0)
    return float(1 / max(stress.max(), edge_stress))


def _axis_stress(z: np.ndarray, nu: float) -> np.ndarray:
    """Return (sigma_r - sigma_z)/p0 on the axis at depths z, in contact radii (Johnson 3.45)."""
    axial = 1 / (1 + z**2)
    angle = np.arctan2(1.0, z)
    return axial - (1 + nu) * (1 - z * angle) + axial / 2


def sphere_onset(R: float, E_star: float, nu: float, yield_stress: float) -> Onset:
    """Return the contact of a sphere of radius R [L] and a half-space at the onset of yield.

    Parameters
    ----------
    R
        Radius [L]; of two spheres, 1/R = 1/R_1 + 1/R_2.
    E_star
        Contact modulus [F/L^2].
    nu
        Poisson's ratio of the body [-].
    yield_stress
        Yield stress of the body [F/L^2].
    """
    require_positive(R=R, E_star=E_star, yield_stress=yield_stress)
    p0 = onset_pressure(nu) * yield_stress
    a = pi * p0 * R / (2 * E_star)
    return Onset(a * a / R, 2 / 3 * p0 * pi * a * a, a)


@dataclass(frozen=True)
class YieldingSolid:
    """Elastic-plastic solid: constants of elasticity and flow stress.

    Attributes
    ----------
    E
        Young's modulus [F/L^2].
    nu
        Poisson's ratio [-].
    flow_stress
        Function that returns the yield stress [F/L^2] at an equivalent plastic strain.
    hardening_modulus
        Function that returns the derivative of the flow stress [F/L^2].
    """

    E: float
    nu: float
    flow_stress: Callable[[float], float]
    hardening_modulus: Callable[[float], float]

    @property
    def E_star(self) -> float:
        """E/(1 - nu^2) [F/L^2]."""
        return self.E / (1 - self.nu**2)

    @cached_property
    def yield_stress(self) -> float:
        """Flow stress before any plastic strain [F/L^2]."""
        return float(self.flow_stress(0.0))

    def strain_ratio(self, slope: float) -> float:
        """Return E tan(beta)/sigma_r, the ratio of imposed strain and elastic strain at yield.

        `slope` is tan(beta), and sigma_r is the flow stress at the representative strain 0.2
        tan(beta).
        """
        return self.E * slope / self.flow_stress(0.2 * slope)

    def hardening_exponent(self, slope: float) -> float:
        """Return d ln sigma/d ln(alpha + sigma_y/E), which is n for power-law hardening.

        It is evaluated at the representative strain alpha = 0.2 `slope`.
        """
        alpha = 0.2 * slope
        total = alpha + self.yield_stress / self.E
        return float(self.hardening_modulus(alpha) * total / self.flow_stress(alpha))

    @property
    def power_law_exponent(self) -> float | None:
        """Exponent n of power-law hardening; 0 without hardening, None for other hardening laws."""
        exponents = [self.hardening_exponent(slope) for slope in (0.05, 0.5, 5.0)]
        digits = 9  # that round-off leaves
        is_power_law = max(exponents) - min(exponents) < 10.0**-digits
        return round(exponents[0], digits) if is_power_law else None

    def contact_height(self, slope: float, *, is_round: bool) -> float:
        """Return the height of the tip at the contact edge above its apex, divided by the depth.

        It is below 1 where the surface sinks in and above 1 where it piles up. From the value of an
        elastic half-space it grows with the strain ratio. It falls with hardening, by 20 % for n =
        1, as measured on cones.
        """
        strain_ratios, heights = (
            (ROUND_STRAIN_RATIOS, ROUND_CONTACT_HEIGHTS)
            if is_round
            else (SHARP_STRAIN_RATIOS, SHARP_CONTACT_HEIGHTS)
        )
        height = float(np.interp(log(self.strain_ratio(slope)), np.log(strain_ratios), heights))
        return max(heights[0], height * (1 - 0.2 * self.hardening_exponent(slope)))

    def mean_pressure(self, slope: float) -> float:
        """Return the mean contact pressure [F/L^2] of a contact that yields.

        The result is the pressure in Johnson's expanding cavity plus a measured multiple of the
        flow stress, but at most the mean pressure of rigid-plastic indentation.
        """
        ratio = self.strain_ratio(slope) + 4 * (1 - 2 * self.nu)
        cavity = 2 / 3 * (1 + log(ratio / (6 * (1 - self.nu))))
        relative = min(cavity + PRESSURE_OFFSET, RIGID_PLASTIC_PRESSURE)
        return float(relative * self.flow_stress(0.2 * slope))

    # ---- functions of Dao et al. for a cone of 70.3 degrees

    @property
    def _dao_argument(self) -> float:
        """Return ln(E*/sigma_0.033) with the flow stress at a plastic strain of 0.033."""
        return log(self.E_star / self.flow_stress(DAO_STRAIN))

    def dao_obstacle(self, half_angle: float) -> str:
        """Return why the functions of Dao et al. are not valid for a cone; "" if they are valid.

        `half_angle` is in degrees.
        """
        if abs(half_angle - DAO_HALF_ANGLE) > DAO_ANGLE_TOLERANCE:
            return f"the half-angle is not {DAO_HALF_ANGLE:g} degrees"
        if (n := self.power_law_exponent) is None or n > DAO_MAX_EXPONENT:
            return f"hardening is not a power law with n <= {DAO_MAX_EXPONENT:g}"
        if abs(self.nu - DAO_NU) > DAO_NU_TOLERANCE:
            return f"nu is not {DAO_NU:g}"
        if not DAO_RANGE[0] <= self._dao_argument <= DAO_RANGE[1]:
            low, high = (exp(limit) for limit in DAO_RANGE)
            return f"E*/sigma_0.033 is not between {low:.2g} and {high:.2g}"
        return ""

    def dao_curvature(self) -> float:
        """Return F/delta^2 [F/L^2] of the cone during loading, with the relative error 3 %."""
        x = self._dao_argument
        pi_1 = ((-1.131 * x + 13.635) * x - 30.594) * x + 29.267
        return float(pi_1 * self.flow_stress(DAO_STRAIN))

    def dao_stiffness(self, n: float) -> float:
        """Return the stiffness at the beginning of unloading over the depth [F/L^2], within 3 %.

        `n` is the exponent of power-law hardening.
        """
        x = self._dao_argument
        cubic = ((-1.40557 * n + 0.77526) * n + 0.15830) * n - 0.06831
        square = ((17.93006 * n - 9.22091) * n - 2.37733) * n + 0.86295
        linear = ((-79.99715 * n + 40.55620) * n + 9.00157) * n - 2.54543
        constant = ((122.65069 * n - 63.88418) * n - 9.58936) * n + 6.20045
        return self.E_star * (((cubic * x + square) * x + linear) * x + constant)
