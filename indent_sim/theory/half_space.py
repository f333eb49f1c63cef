"""Frictionless indentation of an elastic half-space: closed forms, each named after what it returns.

Conventions: delta > 0 pushes in, force and pressure > 0 push, E_star = E/(1-nu^2). Any consistent units;
below [L] is a length, [F] a force. Functions of delta take plain numbers; pressures take a number or an
array r and return the same shape, zero outside the contact. ValueError: a length or modulus that is not >
0, an angle outside (0, 90) degrees.

Sources: Hertz (1882); Sneddon (1965), Int. J. Eng. Sci. 3, 47; Johnson, Contact Mechanics (1985), ch. 3-5.
"""

from __future__ import annotations

import math

import numpy as np

from indent_sim.theory.solution import require_positive

PYRAMID_CONSTANT = 0.73762  # +- 2e-5; the often quoted 0.7453 is 1 % high


def E_star(E: float, nu: float) -> float:
    """Plane-strain modulus E/(1 - nu^2) [F/L^2]; raises ValueError unless E > 0 and -1 < nu <= 0.5."""
    require_positive(E=E)
    if not -1.0 < nu <= 0.5:
        raise ValueError(f"nu must lie in (-1, 0.5], got {nu!r}")
    return E / (1.0 - nu**2)


def transverse_modulus(E: float, E_z: float, nu: float, nu_z: float, G_z: float) -> float:
    """M [F/L^2], which stands for E* where the material is transversely isotropic about the axis z of the tip.

    M = 2 sqrt((C11 C33 - C13^2)/C11 / (1/C44 + 2/(sqrt(C11 C33) + C13))), finite for an incompressible one too.
    E, nu in the plane; nu_z = -eps_plane/eps_z under sigma_z; G_z = C44. Raises ValueError unless the strain energy
    is positive: E, E_z, G_z > 0, -1 < nu < 1, D = 1 - nu - 2 nu_z^2 E/E_z >= 0 (to rounding).
    Sources: Elliott (1949), Proc. Camb. Phil. Soc. 45, 621; Delafargue & Ulm (2004), Int. J. Solids Struct. 41, 7351.
    """
    require_positive(E=E, E_z=E_z, G_z=G_z)
    D = 1.0 - nu - 2.0 * nu_z**2 * E / E_z
    if not (-1.0 < nu < 1.0 and D >= -1e-14):
        raise ValueError(f"E = {E!r}, E_z = {E_z!r}, nu = {nu!r}, nu_z = {nu_z!r} are no elastic material")
    D = max(D, 0.0)
    plane = E_z + 2.0 * nu_z**2 * E / (1.0 + nu + D)  # C33 - C13^2/C11
    mean = math.sqrt(0.5 * E * E_z * (1.0 - nu) * (1.0 + D / (1.0 + nu)))  # D sqrt(C11 C33)
    return 2.0 * math.sqrt(plane / (1.0 / G_z + 2.0 * D / (mean + nu_z * E)))


# --- paraboloid f(r) = r^2/(2R) ---


def paraboloid_contact_radius(delta: float, R: float) -> float:
    """Contact radius a = sqrt(R delta) [L]; 0 for delta <= 0 (Hertz 1882)."""
    require_positive(R=R)
    return math.sqrt(R * max(delta, 0.0))


def paraboloid_force(delta: float, R: float, E_star: float) -> float:
    """Force F = 4/3 E* sqrt(R) delta^(3/2) [F]; 0 for delta <= 0 (Hertz 1882)."""
    require_positive(R=R, E_star=E_star)
    return 4.0 / 3.0 * E_star * math.sqrt(R) * max(delta, 0.0) ** 1.5


def paraboloid_peak_pressure(delta: float, R: float, E_star: float) -> float:
    """Pressure on the axis p0 = 2 E* a/(pi R) [F/L^2] (Hertz 1882)."""
    require_positive(E_star=E_star)
    return 2.0 * E_star * paraboloid_contact_radius(delta, R) / (math.pi * R)


def paraboloid_pressure(r, delta: float, R: float, E_star: float):
    """Pressure p(r) = 2 E*/(pi R) sqrt(a^2 - r^2) [F/L^2], 0 outside; shape of r (Hertz 1882)."""
    require_positive(E_star=E_star)
    v = _chord(r, paraboloid_contact_radius(delta, R))
    return (2.0 * E_star / (math.pi * R) * v)[()]


# --- sphere f(r) = R - sqrt(R^2 - r^2) ---


def sphere_contact_radius(delta: float, R: float) -> float:
    """Contact radius a of an exact sphere [L], from delta = a/2 ln((R+a)/(R-a)); a < R (Sneddon 1965)."""
    return R * math.tanh(_sphere_angle(delta, R))


def sphere_force(delta: float, R: float, E_star: float) -> float:
    """Force of an exact sphere F = E*/2 [(a^2+R^2) ln((R+a)/(R-a)) - 2aR] [F] (Sneddon 1965)."""
    require_positive(E_star=E_star)
    t = _sphere_angle(delta, R)
    q = math.tanh(t)
    if q < 0.3:  # the three terms cancel to third order, so sum what is left of their series
        bracket = sum(q ** (2 * n + 1) * (1.0 / (2 * n + 1) + 1.0 / (2 * n - 1)) for n in range(1, 18))
    else:
        bracket = (1.0 + q * q) * t - q
    return E_star * R**2 * bracket


def sphere_pressure(r, delta: float, R: float, E_star: float):
    """Pressure of an exact sphere [F/L^2], 0 outside; shape of r.

    p(r) = (E*/pi) ∫_r^a g'(t)/sqrt(t^2 - r^2) dt with g(t) = t artanh(t/R) (Sneddon 1965). The rational
    part of g' integrates in closed form, the artanh part by Gauss quadrature in sqrt(t^2 - r^2).
    """
    require_positive(E_star=E_star)
    a = sphere_contact_radius(delta, R)
    v = _chord(r, a)
    r = np.minimum(np.abs(np.asarray(r, dtype=float)), a)
    u, w = np.polynomial.legendre.leggauss(64)
    s: np.ndarray = 1.0 - 0.25 * (1.0 + u) ** 2  # graded to s = 1, where t may near R
    share = 0.5 * (1.0 + u) * w
    t = np.maximum(np.hypot(r[..., None], v[..., None] * s), 1e-300)
    smooth = v * np.sum(share * np.arctanh(np.minimum(t / R, 1.0 - 1e-16)) / t, axis=-1)
    depth = np.sqrt((R - r) * (R + r))
    ratio = np.divide(v, depth, out=np.zeros_like(v), where=v > 0.0)
    rational = np.where(v > 0.0, R / depth * np.arctanh(np.minimum(ratio, 1.0 - 1e-16)), 0.0)
    return (E_star / math.pi * (smooth + rational))[()]


def _sphere_angle(delta: float, R: float) -> float:
    """Root t of t tanh(t) = delta/R, where a = R tanh(t): free of cancellation at any depth."""
    require_positive(R=R)
    d = max(delta, 0.0) / R
    if d == 0.0:
        return 0.0
    t = math.sqrt(d) if d < 1.0 else d
    for _ in range(50):
        step = (t * math.tanh(t) - d) / (math.tanh(t) + t * (1.0 - math.tanh(t) ** 2))
        t -= step
        if abs(step) <= 4e-16 * t:
            break
    return t


# --- cone f(r) = r cot(alpha), flat punch, square pyramid ---


def cone_contact_radius(delta: float, half_angle: float) -> float:
    """Contact radius a = 2/pi delta tan(alpha) [L], alpha in degrees from axis to flank (Sneddon 1965)."""
    return 2.0 / math.pi * max(delta, 0.0) * _tangent(half_angle)


def cone_force(delta: float, half_angle: float, E_star: float) -> float:
    """Force F = 2/pi E* tan(alpha) delta^2 [F], alpha in degrees from axis to flank (Sneddon 1965)."""
    require_positive(E_star=E_star)
    return 2.0 / math.pi * E_star * _tangent(half_angle) * max(delta, 0.0) ** 2


def cone_pressure(r, delta: float, half_angle: float, E_star: float):
    """Pressure p(r) = E*/2 cot(alpha) arcosh(a/r) [F/L^2], infinite at r = 0, 0 outside; shape of r."""
    require_positive(E_star=E_star)
    a = cone_contact_radius(delta, half_angle)
    r = np.minimum(np.abs(np.asarray(r, dtype=float)), a)
    ratio = np.divide(a, r, out=np.full_like(r, np.inf if a > 0.0 else 1.0), where=r > 0.0)
    return (0.5 * E_star / _tangent(half_angle) * np.arccosh(ratio))[()]


def flat_punch_force(delta: float, radius: float, E_star: float) -> float:
    """Force F = 2 E* a delta of a flat circular punch of radius a [F] (Sneddon 1965)."""
    require_positive(radius=radius, E_star=E_star)
    return 2.0 * E_star * radius * max(delta, 0.0)


def flat_punch_pressure(r, delta: float, radius: float, E_star: float):
    """Pressure p(r) = E* delta/(pi sqrt(a^2 - r^2)) [F/L^2], infinite at the edge, 0 outside; shape of r."""
    require_positive(radius=radius, E_star=E_star)
    r = np.abs(np.asarray(r, dtype=float))
    v = _chord(r, radius)
    p = np.divide(E_star * max(delta, 0.0) / math.pi, v, out=np.full_like(v, np.inf), where=v > 0.0)
    return np.where((r > radius) | (delta <= 0.0), 0.0, p)[()]


def square_pyramid_force(delta: float, half_angle: float, E_star: float) -> float:
    """Force F = C E* tan(beta) delta^2 [F], C = 0.73762(2), beta in degrees between axis and face.

    C is a boundary-element result; the contact is a rounded square, so no closed form exists.
    """
    require_positive(E_star=E_star)
    return PYRAMID_CONSTANT * E_star * _tangent(half_angle) * max(delta, 0.0) ** 2


# --- line contact (plane strain, force per unit length) ---


def line_contact_half_width(force: float, R: float, E_star: float) -> float:
    """Half-width a = sqrt(4 F' R/(pi E*)) [L] under the force per length F' (Johnson 1985, sect. 4.2).

    No depth appears: the displacement of a plane-strain half-space is known only up to a constant.
    """
    require_positive(R=R, E_star=E_star)
    return math.sqrt(4.0 * max(force, 0.0) * R / (math.pi * E_star))


def line_contact_force(a: float, R: float, E_star: float) -> float:
    """Force per length F' = pi E* a^2/(4R) [F/L] that opens the half-width a >= 0 (Johnson 1985)."""
    require_positive(R=R, E_star=E_star)
    return math.pi * E_star * max(a, 0.0) ** 2 / (4.0 * R)


def line_contact_peak_pressure(force: float, R: float, E_star: float) -> float:
    """Pressure in the middle p0 = 2F'/(pi a) = E* a/(2R) [F/L^2] (Johnson 1985)."""
    return E_star * line_contact_half_width(force, R, E_star) / (2.0 * R)


def line_contact_pressure(x, force: float, R: float, E_star: float):
    """Pressure p(x) = E*/(2R) sqrt(a^2 - x^2) [F/L^2], 0 outside; shape of x (Johnson 1985)."""
    v = _chord(x, line_contact_half_width(force, R, E_star))
    return (E_star / (2.0 * R) * v)[()]


def _chord(r, a: float) -> np.ndarray:
    """sqrt(a^2 - r^2) without cancellation near the edge, 0 outside."""
    r = np.abs(np.asarray(r, dtype=float))
    return np.sqrt(np.maximum(a - r, 0.0) * (a + r))


def _tangent(half_angle: float) -> float:
    if not 0.0 < half_angle < 90.0:
        raise ValueError(f"half_angle must lie in (0, 90) degrees, got {half_angle!r}")
    return math.tan(math.radians(half_angle))
