"""Textbook approximations for films and thin layers, to compare with the exact theory of a `stack`.

Under a contact of radius a [L], a film of thickness t on a substrate has the stiffness of a
half-space with an effective modulus E* [F/L^2]. The formulas interpolate finite element results or
first-order perturbations under a flat punch; for other tips or large ratios of the moduli the error
is up to a factor of two.

delta and force are > 0 while the tip pushes into the body. Any consistent units.
Sources: Gao, Chiu & Lee (1992), Int. J. Solids Struct. 29, 2471, for moduli that differ by less
than a factor of two; Perriot & Barthel (2004), J. Mater. Res. 19, 600, for ratios of 0.01 to 100;
Dimitriadis et al. (2002), Biophys. J. 82, 2798.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from indent_sim.theory.half_space import E_star, paraboloid_force
from indent_sim.theory.solution import Solution, require_positive
from indent_sim.theory.stack import BASE_SUPPORTS, StackLayer

# E* [F/L^2] of a film, a substrate and a contact radius [L].
Modulus = Callable[[StackLayer, StackLayer, float], float]
# Contact with a half-space at a depth [L]; None where the theory ends.
HalfSpaceContact = Callable[[float], Solution | None]


def gao_modulus(film: StackLayer, substrate: StackLayer, a: float) -> float:
    """Return E* = E*_s + (E*_f - E*_s) I0(t/a) [F/L^2] (Gao et al. 1992).

    I0(x) = 2/pi atan x + [(1 - 2 nu) x ln(1 + 1/x^2) - x/(1 + x^2)]/(2 pi (1 - nu)), with Poisson's
    ratio nu of the composite, 1 - nu = (1 - nu_s)(1 - nu_f)/[1 - (1 - I1) nu_f - I1 nu_s] and
    I1(x) = 2/pi atan x + x/pi ln(1 + 1/x^2).

    Parameters
    ----------
    film, substrate
        Layer on top, and the half-space below it.
    a
        Contact radius [L].
    """
    require_positive(a=a, thickness=film.thickness)
    x = film.thickness / a
    log_term = x * math.log1p(1.0 / x**2)
    angle_term = 2.0 / math.pi * math.atan(x)
    I1 = angle_term + log_term / math.pi
    one_minus_nu = (
        (1.0 - film.nu) * (1.0 - substrate.nu) / (1.0 - (1.0 - I1) * film.nu - I1 * substrate.nu)
    )
    film_weight = angle_term + ((2.0 * one_minus_nu - 1.0) * log_term - x / (1.0 + x * x)) / (
        2.0 * math.pi * one_minus_nu
    )
    return film_weight * E_star(film.E, film.nu) + (1.0 - film_weight) * E_star(
        substrate.E, substrate.nu
    )


def perriot_barthel_modulus(film: StackLayer, substrate: StackLayer, a: float) -> float:
    """Return E* = E*_f + (E*_s - E*_f)/(1 + (x0 t/a)^1.27) [F/L^2] (Perriot & Barthel 2004).

    log10 x0 = -0.093 + 0.792 l + 0.05 l^2 with l = log10(E*_s/E*_f).

    Parameters
    ----------
    film, substrate
        Layer on top, and the half-space below it.
    a
        Contact radius [L].
    """
    require_positive(a=a, thickness=film.thickness)
    film_modulus = E_star(film.E, film.nu)
    substrate_modulus = E_star(substrate.E, substrate.nu)
    ratio = math.log10(substrate_modulus / film_modulus)
    x0 = 10.0 ** (-0.093 + 0.792 * ratio + 0.05 * ratio**2)
    return film_modulus + (substrate_modulus - film_modulus) / (
        1.0 + (x0 * film.thickness / a) ** 1.27
    )


def film_force(
    delta: float,
    modulus: Modulus,
    film: StackLayer,
    substrate: StackLayer,
    film_contact: HalfSpaceContact,
) -> float:
    """Return the force [F] on a film at a depth, computed with an effective modulus E*.

    The contact radius is that of a half-space, which does not depend on the modulus.

    Parameters
    ----------
    delta
        Depth [L].
    modulus
        `gao_modulus` or `perriot_barthel_modulus`.
    film, substrate
        Layer on top, and the half-space below it.
    film_contact
        Load curve of the tip on a half-space of the film's material.

    Returns
    -------
    float
        Force [F]; NaN where `film_contact` has no solution.
    """
    solution = film_contact(delta)
    if not solution:
        return math.nan
    return solution.force * modulus(film, substrate, solution.a) / E_star(film.E, film.nu)


def dimitriadis_force(delta: float, R: float, layer: StackLayer, base: str = "fixed") -> float:
    """Return the force [F] of a paraboloid on a thin layer (Dimitriadis et al. 2002).

    Hertz's force is multiplied by a polynomial in x = sqrt(R delta)/h,

        1 - 2 A x/pi + 4 A^2 x^2/pi^2 - 8 (A^3 + 4 pi^2 B/15) x^3/pi^3
          + 16 A (A^3 + 3 pi^2 B/5) x^4/pi^4,

    with A and B functions of nu and the base. For a fixed incompressible layer these coefficients
    give the last term -0.0975 x^4. The paper and other programs have +0.0975 x^4, which is used
    here for nu = 0.5.

    Parameters
    ----------
    delta
        Depth [L].
    R
        Radius of curvature of the tip [L].
    layer
        Layer of thickness h.
    base
        "fixed" (bonded to a rigid base) or "roller" (frictionless).

    Raises
    ------
    ValueError
        For another base.
    """
    nu = layer.nu
    if base not in BASE_SUPPORTS:
        raise ValueError(f"base must be one of {BASE_SUPPORTS}, got {base!r}")
    if base == "fixed":
        A = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1.0 - nu)
        B = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1.0 - nu)
    else:
        A = -0.347 * (3.0 - 2.0 * nu) / (1.0 - nu)
        B = 0.056 * (5.0 - 2.0 * nu) / (1.0 - nu)
    quartic = 16.0 * A / math.pi**4 * (A**3 + 0.6 * math.pi**2 * B)
    if base == "fixed" and nu == 0.5:
        quartic = 0.0975
    x = math.sqrt(R * max(delta, 0.0)) / layer.thickness
    y = 2.0 * A * x / math.pi
    cubic = (A**3 + 4.0 / 15.0 * math.pi**2 * B) * (2.0 * x / math.pi) ** 3
    return paraboloid_force(delta, R, E_star(layer.E, nu)) * (
        1.0 - y + y**2 - cubic + quartic * x**4
    )
