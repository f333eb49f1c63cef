"""Young's modulus and Poisson's ratio from any two constants of an isotropic material."""

from __future__ import annotations

import math
from collections.abc import Callable

ISOTROPIC_CONSTANTS = ("E", "nu", "mu", "kappa", "lame_lambda")
# Stability conditions of pairs of constants from whose ranges stability does not follow.
STABILITY_CONDITIONS = {
    frozenset({"mu", "lame_lambda"}): "lame_lambda > -2 mu/3",
    frozenset({"kappa", "lame_lambda"}): "lame_lambda < kappa",
    frozenset({"nu", "lame_lambda"}): "lame_lambda/nu > 0",
}
# E and nu from each pair of constants.
YOUNG_AND_POISSON: dict[tuple[str, ...], Callable[[float, float], tuple[float, float]]] = {
    ("E", "nu"): lambda E, nu: (E, nu),
    ("E", "mu"): lambda E, mu: (E, E / (2 * mu) - 1),
    ("E", "kappa"): lambda E, kappa: (E, (3 * kappa - E) / (6 * kappa)),
    ("E", "lame_lambda"): lambda E, lam: (
        E,
        2 * lam / (E + lam + math.sqrt(E * E + 9 * lam * lam + 2 * E * lam)),
    ),
    ("nu", "mu"): lambda nu, mu: (2 * mu * (1 + nu), nu),
    ("nu", "kappa"): lambda nu, kappa: (3 * kappa * (1 - 2 * nu), nu),
    ("nu", "lame_lambda"): lambda nu, lam: (
        (lam * (1 + nu) * (1 - 2 * nu) / nu if nu else math.nan),
        nu,
    ),
    ("mu", "kappa"): lambda mu, K: (
        9 * K * mu / (3 * K + mu),
        (3 * K - 2 * mu) / (2 * (3 * K + mu)),
    ),
    ("mu", "lame_lambda"): lambda mu, lam: (
        mu * (3 * lam + 2 * mu) / (lam + mu),
        lam / (2 * (lam + mu)),
    ),
    ("kappa", "lame_lambda"): lambda K, lam: (
        9 * K * (K - lam) / (3 * K - lam),
        lam / (3 * K - lam),
    ),
}


def young_and_poisson(given: dict[str, float]) -> tuple[float, float]:
    """Return E and nu of an isotropic material from exactly two of its constants.

    Formulas: Slaughter (2002), The Linearized Theory of Elasticity, table 5.1.

    Parameters
    ----------
    given : dict
        Two of E, nu, mu, kappa, lame_lambda by name; moduli in [pressure].

    Raises
    ------
    ValueError
        If not exactly two constants are given, or the material would be unstable.
    """
    if len(given) != 2:
        raise ValueError(
            f"needs exactly two of {', '.join(ISOTROPIC_CONSTANTS)}; got "
            f"{', '.join(given) or 'none'}"
        )
    names = tuple(name for name in ISOTROPIC_CONSTANTS if name in given)
    if names not in YOUNG_AND_POISSON:
        raise ValueError(f"unknown isotropic constants {', '.join(given)}")
    try:
        E, nu = YOUNG_AND_POISSON[names](*(given[name] for name in names))
    except ZeroDivisionError:
        E = math.nan
        nu = math.nan
    if not (math.isfinite(E) and E > 0 and -1 < nu <= 0.5):
        result = f"E = {E:g} and nu = {nu:g}" if math.isfinite(E) else "no E"
        condition = STABILITY_CONDITIONS.get(frozenset(given), "")
        requirement = "a stable material has E > 0 and -1 < nu <= 0.5" + (
            f", and therefore {condition}" if condition else ""
        )
        raise ValueError(f"these constants give {result}; {requirement}")
    return E, nu
