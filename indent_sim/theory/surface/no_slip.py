"""No slip between a tip and an elastic half-space: what it adds to the force of frictionless contact.

Under a tip f = B r^n each increment of the depth is that of a bonded flat punch of the present radius a, so the force
grows by dF = 4 mu a ln(3 - 4 nu)/(1 - 2 nu) d delta, and the surface beside a punch of radius a moves by the share
W(r/a) of its depth,

    W(q) = 4 (1 - nu)/(pi sqrt(3 - 4 nu)) int_0^1 cos(theta ln((1 + t)/(1 - t)))/sqrt(q^2 - t^2) dt,
    theta = ln(3 - 4 nu)/(2 pi),   W(1) = 1,

so that delta = alpha a^n with B = alpha n int_0^1 (1 - W(1/s)) s^(n-1) ds. At nu = 1/2 all of this is frictionless.

Sources: Mossakovskii (1963), J. Appl. Math. Mech. 27, 627; Spence (1968), Proc. R. Soc. A 305, 55.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad
from scipy.special import hyp2f1

FAR = 20.0  # of the hyperbolic angle whose tanh is t: beyond it 1/cosh^2 is below 1e-17 of its peak


def force_ratio(nu: float, power: float = math.inf) -> float:
    """Force without slip over the frictionless one at the same depth under f = B r^power; infinite: a flat punch.

    (1 - nu) ln(3 - 4 nu)/(1 - 2 nu) times the ratio of the contact radii, to 1e-10. Raises ValueError unless
    -1 < nu <= 0.5 and power >= 1.
    """
    if not -1.0 < nu <= 0.5:
        raise ValueError(f"nu must lie in (-1, 0.5], got {nu!r}")
    if not power >= 1.0:
        raise ValueError(f"power must be at least 1, got {power!r}")
    return punch_ratio(nu) * (1.0 if math.isinf(power) else radius_ratio(nu, power))


def punch_ratio(nu: float) -> float:
    """Force of a bonded flat punch over that of a frictionless one, (1 - nu) ln(3 - 4 nu)/(1 - 2 nu)."""
    e = 1.0 - 2.0 * nu
    return (1.0 + e) / 2.0 * (math.log1p(2.0 * e) / e if e > 0.0 else 2.0)


def radius_ratio(nu: float, power: float) -> float:
    """Contact radius without slip over the frictionless one at the same depth under f = B r^power."""
    return float((_sinking(nu, power) / _sinking(0.5, power)) ** (1.0 / power))


def displacement_beside_punch(q: float, nu: float) -> float:
    """W(q), the depth of the surface at q >= 1 radii from the axis of a bonded flat punch over the punch's own."""
    theta = math.log(3.0 - 4.0 * nu) / (2.0 * math.pi)

    def slope(y: float) -> float:  # t = tanh y; q^2 - t^2 without cancellation
        return math.cos(2.0 * theta * y) / math.cosh(y) / math.sqrt((q * q - 1.0) * math.cosh(y) ** 2 + 1.0)

    return _factor(nu) * float(quad(slope, 0.0, 2.0 * FAR, limit=200, epsabs=1e-13)[0])


def _factor(nu: float) -> float:
    return 4.0 * (1.0 - nu) / (math.pi * math.sqrt(3.0 - 4.0 * nu))


def _sinking(nu: float, n: float) -> float:
    """int_0^1 (1 - W(1/s)) s^(n-1) ds = B/(n alpha), the integral over s in closed form."""
    theta = math.log(3.0 - 4.0 * nu) / (2.0 * math.pi)

    def part(y: float) -> float:  # t = tanh y
        t = np.tanh(y)
        over_s = hyp2f1(0.5, (n + 1.0) / 2.0, (n + 3.0) / 2.0, t * t) / (n + 1.0)
        return float(math.cos(2.0 * theta * y) * over_s / math.cosh(y) ** 2)

    return 1.0 / n - _factor(nu) * float(quad(part, 0.0, FAR, limit=200, epsabs=1e-13)[0])
