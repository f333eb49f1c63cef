"""Contact without slip between a tip and an elastic half-space, relative to frictionless contact.

Under a tip f = B r^n each increment of the depth acts like a bonded flat punch of the present
contact radius a. The force grows by dF = 4 mu a ln(3 - 4 nu)/(1 - 2 nu) d delta with the shear
modulus mu, and the surface at a radius r > a moves by the fraction W(r/a) of the punch's
displacement,

    W(q) = 4 (1 - nu)/(pi sqrt(3 - 4 nu)) int_0^1 cos(theta ln((1 + t)/(1 - t)))/sqrt(q^2 - t^2) dt,
    theta = ln(3 - 4 nu)/(2 pi),   W(1) = 1,

so that delta = alpha a^n with B = alpha n int_0^1 (1 - W(1/s)) s^(n-1) ds. At nu = 1/2 the results
are the same as for frictionless contact.

For bonded layers, the ratio of forces is taken from a table of finite element solutions.

delta and force are > 0 in indentation.
Sources: Mossakovskii (1963), J. Appl. Math. Mech. 27, 627; Spence (1968), Proc. R. Soc. A 305, 55.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from indent_sim.theory.half_space import check_nu
from indent_sim.theory.measured_constants import (
    CELL_DIP,
    CELL_PEAK,
    LAYER_FORCE_RATIOS,
    MAPPED_POISSON_RATIOS,
    MAPPED_SLENDERNESS,
)
from indent_sim.theory.quadrature import Nodes, gauss_legendre, join_nodes

POINTS_PER_PANEL = 24


@dataclass(frozen=True)
class FrictionCorrection:
    """Change of a frictionless contact by friction at the same depth.

    Attributes
    ----------
    force, radius
        Factors of the force and of the contact radius.
    sticks
        Radius of the sticking region divided by the contact radius.
    """

    force: float
    radius: float
    sticks: float


FRICTIONLESS = FrictionCorrection(1.0, 1.0, 0.0)


def no_slip_correction(nu: float, power: float = math.inf) -> FrictionCorrection:
    """Return the no-slip correction for f = B r^power; raises the same errors as `force_ratio`."""
    return FrictionCorrection(
        force_ratio(nu, power), 1.0 if math.isinf(power) else radius_ratio(nu, power), 1.0
    )


def force_ratio(nu: float, power: float = math.inf) -> float:
    """Return the ratio of the no-slip force to the frictionless force at the same depth.

    The tip is f = B r^power; an infinite power means a flat punch. The ratio is (1 - nu) ln(3 - 4
    nu)/(1 - 2 nu) times the ratio of the contact radii, accurate to 1e-10.

    Raises
    ------
    ValueError
        Unless -1 < nu <= 0.5 and power >= 1.
    """
    check_parameters(nu, power)
    return punch_ratio(nu) * (1.0 if math.isinf(power) else radius_ratio(nu, power))


def check_parameters(nu: float, power: float) -> None:
    """Raise ValueError unless -1 < nu <= 0.5 and power >= 1."""
    check_nu(nu)
    if not power >= 1.0:
        raise ValueError(f"power must be at least 1, got {power!r}")


def layer_force_range(nu: float, slenderness: float, power: float) -> tuple[float, float] | None:
    """Return bounds on the ratio of no-slip to frictionless force on a bonded layer, from a table.

    The bounds are the extreme ratios at the corners of the table cell that contains the layer, with
    the margins CELL_DIP and CELL_PEAK. Below a slenderness of 0.1 the cell extends to the
    half-space.

    Parameters
    ----------
    nu
        Poisson's ratio of the layer.
    slenderness
        Contact radius divided by the thickness of the layer.
    power
        Exponent of the tip's profile: 1, 2, or infinity for a flat punch.

    Returns
    -------
    tuple of float, or None
        Smallest and largest force ratio; None outside the table.
    """
    is_inside = (
        MAPPED_POISSON_RATIOS[0] <= nu <= MAPPED_POISSON_RATIOS[-1]
        and 0 <= slenderness <= MAPPED_SLENDERNESS[-1]
    )
    if power not in LAYER_FORCE_RATIOS or not is_inside:
        return None
    rows = _neighbouring_lines(MAPPED_POISSON_RATIOS, nu)
    columns = _neighbouring_lines((0.0, *MAPPED_SLENDERNESS), slenderness)
    # The half-space is the limit of small contact radii.
    force_ratios = {
        row: (force_ratio(MAPPED_POISSON_RATIOS[row], power), *LAYER_FORCE_RATIOS[power][row])
        for row in rows
    }
    corners = [force_ratios[row][column] for row in rows for column in columns]
    low = min(corners)
    high = max(corners)
    # The ratios of the map are rounded to three decimals.
    return low - CELL_DIP, high + 1e-3 + CELL_PEAK * (high - 1.0)


def _neighbouring_lines(lines: Sequence[float], value: float) -> list[int]:
    """Return the indices of the grid values next to a value, or the index of an equal value."""
    matching_line = [k for k, line in enumerate(lines) if math.isclose(line, value, rel_tol=1e-9)]
    next_line = int(np.searchsorted(lines, value))
    return matching_line or [next_line - 1, next_line]


def punch_ratio(nu: float) -> float:
    """Return the ratio (1 - nu) ln(3 - 4 nu)/(1 - 2 nu) of bonded to frictionless punch force."""
    e = 1.0 - 2.0 * nu
    return (1.0 + e) / 2.0 * (math.log1p(2.0 * e) / e if e > 0.0 else 2.0)


@lru_cache(maxsize=64)  # All scenes of a study have the same few arguments.
def radius_ratio(nu: float, power: float) -> float:
    """Return the ratio of the no-slip to the frictionless contact radius at the same depth.

    The tip is f = B r^power.
    """
    return float((_sinking_integral(nu, power) / _sinking_integral(0.5, power)) ** (1.0 / power))


def _displacement_factor(nu: float) -> float:
    """Return the prefactor 4 (1 - nu)/(pi sqrt(3 - 4 nu)) of the integral W."""
    return 4.0 * (1.0 - nu) / (math.pi * math.sqrt(3.0 - 4.0 * nu))


def _theta(nu: float) -> float:
    """Return the exponent theta = ln(3 - 4 nu)/(2 pi) of the oscillation at the punch's edge."""
    return math.log(3.0 - 4.0 * nu) / (2.0 * math.pi)


def _sinking_integral(nu: float, n: float) -> float:
    """Return int_0^1 (1 - W(1/s)) s^(n-1) ds = B/(n alpha), in the variable y = artanh(t)."""
    # Integrals over t = tanh(y) end at this y, where 1/cosh^2 is below 1e-17 of its peak.
    max_hyperbolic_angle = 20.0
    y, weights = _panel_nodes(max_hyperbolic_angle)
    integrand = np.cos(2.0 * _theta(nu) * y) * _moment(np.tanh(y), n) / np.cosh(y) ** 2
    return 1.0 / n - _displacement_factor(nu) * float(weights @ integrand)


def _moment(t: np.ndarray, n: float) -> np.ndarray:
    """Return int_0^1 s^n/sqrt(1 - t^2 s^2) ds = int_0^asin(t) sin(w)^n dw / t^(n+1) for all t.

    The substitution w ~ v^2 makes the quadrature accurate also for non-integer exponents n.
    """
    v, weights = gauss_legendre(0.0, 1.0, 2 * POINTS_PER_PANEL)
    end = np.arcsin(t)
    return np.asarray(
        (np.sin(np.outer(end, v * v)) / t[:, None]) ** n @ (2.0 * v * weights) * end / t
    )


def _panel_nodes(end: float) -> Nodes:
    """Return Gauss nodes and weights on [0, end] in panels."""
    # Gauss panels along y: the integrands are analytic up to pi/2 off the real axis, so that only
    # the rounding error remains.
    panel_length = 2.0
    starts = map(float, np.arange(0.0, end, panel_length))
    return join_nodes(
        [gauss_legendre(start, start + panel_length, POINTS_PER_PANEL) for start in starts]
    )
