"""Frictionless indentation of an elastic half-space: the force at a depth in closed form.

Sign convention: delta and force are > 0 while the tip pushes into the body. E_star = E/(1 - nu^2).
Any consistent units; [L] is a length and [F] a force. ValueError is raised for a length or modulus
that is not > 0 and for an angle outside (0, 90) degrees.

Sources: Hertz (1882); Sneddon (1965), Int. J. Eng. Sci. 3, 47.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from indent_sim.theory.measured_constants import PYRAMID_CONSTANT
from indent_sim.theory.roots import depth_of_force
from indent_sim.theory.solution import require_positive, tangent_of_half_angle

# Coefficients of q^(2n + 1) in (1 + q^2) artanh(q) - q, from the highest power down.
SPHERE_SERIES = tuple(1.0 / (2 * n + 1) + 1.0 / (2 * n - 1) for n in range(17, 0, -1))


def E_star(E: float, nu: float) -> float:
    """Return E/(1 - nu^2) [F/L^2]; raises ValueError unless E > 0 and -1 < nu <= 0.5."""
    require_positive(E=E)
    check_nu(nu)
    return E / (1.0 - nu**2)


def paraboloid_force(delta: float, R: float, E_star: float) -> float:
    """Hertz's force F = 4/3 E* sqrt(R) delta^(3/2) [F] under f = r^2/(2R); 0 for delta <= 0."""
    require_positive(R=R, E_star=E_star)
    return 4.0 / 3.0 * E_star * math.sqrt(R) * max(delta, 0.0) ** 1.5


def sphere_force(delta: float, R: float, E_star: float) -> float:
    """Sneddon's force F = E*/2 [(a^2+R^2) ln((R+a)/(R-a)) - 2aR] [F] under an exact sphere."""
    require_positive(E_star=E_star)
    t = _sphere_angle(delta, R)
    q = math.tanh(t)
    if q < 0.3:
        # The terms of the closed form cancel to third order in q, so that its power series is
        # summed instead.
        square = q * q
        bracket = 0.0
        for coefficient in SPHERE_SERIES:
            bracket = bracket * square + coefficient
        bracket *= q * square
    else:
        bracket = (1.0 + q * q) * t - q
    return E_star * R**2 * bracket


def _sphere_angle(delta: float, R: float) -> float:
    """Return the root t of t tanh(t) = delta/R, where a = R tanh(t), accurate to round-off."""
    require_positive(R=R)
    d = max(delta, 0.0) / R
    if d == 0.0:
        return 0.0
    # This import takes 0.2 s, which other scenes need not spend.
    from scipy.optimize import brentq

    # t/(1 + t) < tanh(t) < min(t, 1) brackets the root, with a margin for rounding.
    low = 0.99 * max(d, math.sqrt(d))
    high = 1.01 * 0.5 * (d + math.sqrt(d * (d + 4.0)))
    return float(brentq(lambda t: t * math.tanh(t) - d, low, high, xtol=1e-16 * low))


def cone_force(delta: float, half_angle: float, E_star: float) -> float:
    """Sneddon's force F = 2/pi E* tan(alpha) delta^2 [F]; alpha in degrees from axis to flank."""
    require_positive(E_star=E_star)
    return 2.0 / math.pi * E_star * tangent_of_half_angle(half_angle) * max(delta, 0.0) ** 2


def flat_punch_force(delta: float, radius: float, E_star: float) -> float:
    """Sneddon's force F = 2 E* a delta [F] under a flat circular punch of radius a."""
    require_positive(radius=radius, E_star=E_star)
    return 2.0 * E_star * radius * max(delta, 0.0)


def square_pyramid_force(delta: float, half_angle: float, E_star: float) -> float:
    """Force F = C E* tan(beta) delta^2 [F] of a square pyramid; beta in degrees from axis to face.

    C = 0.73762(2) is a boundary-element result, because no closed form exists for the contact area,
    which is a square with curved sides.
    """
    require_positive(E_star=E_star)
    return PYRAMID_CONSTANT * E_star * tangent_of_half_angle(half_angle) * max(delta, 0.0) ** 2


def estimate_depth(radius_at: Callable[[float], float], force: float, E_star: float) -> float:
    """Estimate the depth [L] of a force under any tip, by solving force = E* r(depth) depth.

    Parameters
    ----------
    radius_at
        Function that returns the radius r [L] of the tip's section at a height above the apex.
    """
    force_scale = max(force, 0.0) / E_star
    start = math.sqrt(force_scale)
    return depth_of_force(lambda depth: radius_at(depth) * depth, force_scale, start) or start


def check_nu(nu: float) -> None:
    """Raise ValueError unless -1 < nu <= 0.5."""
    if not -1.0 < nu <= 0.5:
        raise ValueError(f"nu must lie in (-1, 0.5], got {nu!r}")
