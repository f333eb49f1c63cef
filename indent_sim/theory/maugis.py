"""Adhesion of a paraboloid on a half-space between the DMT and JKR limits (Maugis-Dugdale).

The force is > 0 in compression, < 0 in tension. Lengths [L], forces [F], work of adhesion [F/L].
Source: Maugis (1992), J. Colloid Interface Sci. 150, 243.
"""

from __future__ import annotations

import math

from scipy.optimize import minimize_scalar

from indent_sim.theory.solution import require_positive

LAMBDA_PER_TABOR = 2.0 * (9.0 / (16.0 * math.pi)) ** (1.0 / 3.0)  # equal to 1.1272


def tabor_number(work: float, attraction_range: float, R: float, E_star: float) -> float:
    """Return the Tabor number (R work^2/(E*^2 range^3))^(1/3) of an attraction with a range [L].

    JKR theory is accurate for Tabor numbers above about 5.
    """
    require_positive(work=work, range=attraction_range, R=R, E_star=E_star)
    return (R * work**2 / (E_star**2 * attraction_range**3)) ** (1.0 / 3.0)


def maugis_lambda(work: float, attraction_range: float, R: float, E_star: float) -> float:
    """Return Maugis' parameter lambda = 2 (work/range) (R/(pi work (4E*/3)^2))^(1/3).

    lambda is 1.127 times the Tabor number.
    """
    return LAMBDA_PER_TABOR * tabor_number(work, attraction_range, R, E_star)


def maugis_pull_off(parameter: float) -> float:
    """Return the pull-off force under force control, divided by pi work R.

    The result is -2 for lambda -> 0 (DMT) and -3/2 for lambda -> infinity (JKR). At the ends of the
    range that is computed, lambda = 1e-10 and 1e5, these limits are reached to 1e-10.
    """
    require_positive(parameter=parameter)
    # Parameters beyond which rounding does not separate the edges of the attraction and of the
    # contact.
    parameter_range = (1e-10, 1e5)
    parameter = min(max(parameter, parameter_range[0]), parameter_range[1])
    search_options = {"bounds": (-25.0, 25.0), "method": "bounded", "options": {"xatol": 1e-9}}
    return float(
        minimize_scalar(lambda x: _maugis_force(1.0 + math.exp(x), parameter), **search_options).fun
    )


def _maugis_force(m: float, parameter: float) -> float:
    """Return force/(pi work R) of a contact whose attraction ends at m times the contact radius."""
    root = math.sqrt(m * m - 1.0)
    angle = math.acos(1.0 / m)
    square = 0.5 * parameter * ((m * m - 2.0) * angle + root)
    linear = 4.0 / 3.0 * parameter**2 * (root * angle - m + 1.0)
    A = 2.0 / (linear + math.sqrt(linear**2 + 4.0 * square))
    return A**3 - parameter * A**2 * (root + m * m * angle)
