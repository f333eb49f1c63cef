"""Elastic laws as strain-energy densities; UFL differentiates them to stress and tangent.

A material is a frozen dataclass with its constants and an `energy`. Its numbers may be floats or UFL
constants: the formulas do not care.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from indent_sim.model.quantities import AnyModulus, Modulus, PoissonRatio

Formulation = Literal["auto", "displacement", "mixed"]
ISOTROPIC_CONSTANTS = ("E", "nu", "mu", "kappa", "lame_lambda")


@dataclass(frozen=True)
class LinearElastic:
    """Isotropic Hooke's law at small strain, psi = mu eps:eps + lame_lambda/2 (tr eps)^2 (notes 2.1-2.4).

    Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure] say it.
    """

    model: Literal["linear_elastic"] = "linear_elastic"
    E: Modulus | None = None
    nu: PoissonRatio | None = None
    mu: Modulus | None = None
    kappa: Modulus | None = None
    lame_lambda: AnyModulus | None = None
    formulation: Formulation = "auto"

    def canonical(self) -> LinearElastic:
        """The same material said by E and nu; ValueError when it is not said by exactly two constants."""
        given = {name: getattr(self, name) for name in ISOTROPIC_CONSTANTS if getattr(self, name) is not None}
        E, nu = young_and_poisson(given)
        return LinearElastic(E=E, nu=nu, formulation=self.formulation)

    @property
    def constants(self) -> tuple[float, float]:
        """E [pressure] and nu of a canonical material."""
        assert self.E is not None and self.nu is not None
        return self.E, self.nu

    @property
    def E_star(self) -> float:
        """Plane-strain modulus E/(1 - nu^2) [pressure] of a canonical material."""
        E, nu = self.constants
        return E / (1 - nu * nu)

    @property
    def shear_modulus(self) -> Any:
        """mu = E / (2 (1 + nu)) [pressure]."""
        return self.E / (2 * (1 + self.nu))  # type: ignore[operator]

    @property
    def inverse_lambda(self) -> Any:
        """1/lame_lambda = (1 + nu)(1 - 2 nu)/(E nu) [1/pressure]; 0 when incompressible."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (self.E * self.nu)  # type: ignore[operator]

    def energy(self, H: Any) -> Any:
        """Strain-energy density psi [pressure] of the displacement gradient H (3x3)."""
        from ufl import inner, sym, tr

        eps = sym(H)
        return self.shear_modulus * inner(eps, eps) + tr(eps) ** 2 / (2 * self.inverse_lambda)

    def mixed_energy(self, H: Any, q: Any) -> Any:
        """psi = mu eps:eps + q tr eps - q^2/(2 lame_lambda), stationary at q = lame_lambda tr eps [pressure]."""
        from ufl import inner, sym, tr

        eps = sym(H)
        return self.shear_modulus * inner(eps, eps) + q * tr(eps) - q * q * self.inverse_lambda / 2

    def stress(self, H: Any) -> Any:
        """Cauchy stress sigma = lame_lambda tr(eps) I + 2 mu eps [pressure] of the displacement gradient H (3x3)."""
        from ufl import tr

        return self.mixed_stress(H, tr(H) / self.inverse_lambda)

    def mixed_stress(self, H: Any, q: Any) -> Any:
        """sigma = q I + 2 mu eps [pressure]."""
        from ufl import Identity, sym

        return q * Identity(3) + 2 * self.shear_modulus * sym(H)


Material = LinearElastic


def young_and_poisson(given: dict[str, float]) -> tuple[float, float]:
    """E and nu from exactly two isotropic constants.

    Everything passes through E = 9 kappa mu / (3 kappa + mu) and its kin (Slaughter 2002, table 5.1).
    Raises ValueError when not exactly two are given, or when they belong to no stable material.
    """
    if len(given) != 2:
        raise ValueError(f"needs exactly two of {', '.join(ISOTROPIC_CONSTANTS)}; got {', '.join(given) or 'none'}")
    try:
        E, nu = _from_two(given)
    except ZeroDivisionError:
        E, nu = math.nan, math.nan
    if not (math.isfinite(E) and E > 0 and -1 < nu <= 0.5):
        raise ValueError(
            f"these constants give E = {E:g} and nu = {nu:g}; a stable material has E > 0 and -1 < nu <= 0.5"
        )
    return E, nu


def _from_two(given: dict[str, float]) -> tuple[float, float]:
    match given:
        case {"E": E, "nu": nu}:
            return E, nu
        case {"E": E, "mu": mu}:
            return E, E / (2 * mu) - 1
        case {"E": E, "kappa": kappa}:
            return E, (3 * kappa - E) / (6 * kappa)
        case {"E": E, "lame_lambda": lam}:
            root = math.sqrt(E * E + 9 * lam * lam + 2 * E * lam)
            return E, 2 * lam / (E + lam + root)
        case {"nu": nu, "mu": mu}:
            return 2 * mu * (1 + nu), nu
        case {"nu": nu, "kappa": kappa}:
            return 3 * kappa * (1 - 2 * nu), nu
        case {"nu": nu, "lame_lambda": lam}:
            return (lam * (1 + nu) * (1 - 2 * nu) / nu if nu else math.nan), nu
        case {"mu": mu, "kappa": kappa}:
            return 9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))
        case {"mu": mu, "lame_lambda": lam}:
            return mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
        case {"kappa": kappa, "lame_lambda": lam}:
            return 9 * kappa * (kappa - lam) / (3 * kappa - lam), lam / (3 * kappa - lam)
    raise ValueError(f"unknown isotropic constants {', '.join(given)}")
