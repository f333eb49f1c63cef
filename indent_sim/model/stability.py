"""Stability of hyperelastic laws: Drucker's condition in uniaxial, biaxial and planar deformation.

The energy psi of an incompressible body is a function of two principal logarithmic strains (the
third is minus their sum), and its gradient consists of differences of Kirchhoff stresses. d tau : d
eps > 0 for every increment (Drucker, Hill) means that its second derivative is positive definite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from indent_sim.model.algebra import Expr
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import Fung, Gent, Hencky, NeoHookean
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter

# Principal logarithmic strains (e1, e2) over e at a stretch exp(e).
DEFORMATION_MODES: dict[str, tuple[float, float]] = {
    "uniaxial": (1.0, -0.5),
    "equibiaxial": (1.0, 1.0),
    "planar": (1.0, 0.0),
}


@dataclass(frozen=True)
class StabilityLoss:
    """Stretch of a classical deformation beyond which a law is unstable."""

    mode: str
    stretch: float

    def __str__(self) -> str:
        kind = "tension" if self.stretch > 1 else "compression"
        return f"{self.mode} {kind} to a stretch of {self.stretch:.3g}"


def stability_losses(psi: Callable[[Expr, Expr, Expr], Expr], strain: float) -> list[StabilityLoss]:
    """Return the first loss of stability of each deformation, in tension and compression.

    Parameters
    ----------
    psi : Callable
        Isochoric energy [pressure] of three principal stretches with product one.
    strain : float
        Largest logarithmic strain; stretches are from exp(-strain) to exp(strain).
    """
    loss_points = []
    for mode, direction in DEFORMATION_MODES.items():
        for sign in (1.0, -1.0):
            strains = sign * strain * np.arange(1, 201) / 200
            is_unstable = ~_is_stable(psi, strains * direction[0], strains * direction[1])
            if is_unstable.any():
                loss_points.append(
                    StabilityLoss(mode, float(np.exp(strains[np.argmax(is_unstable)])))
                )
    return loss_points


def largest_strain(tip: Indenter, a: float, delta: float, height: float) -> float:
    """Return the expected order of magnitude of the largest logarithmic strain, at most 2.

    The result is the largest of three estimates: the tip's slope at the contact edge, the depth
    divided by the contact radius, and the mean compression of the body.
    """
    inner_radius = 0.99 * a
    slope = float(tip.height(a, 0.0) - tip.height(inner_radius, 0.0)) / (a - inner_radius)
    return float(np.clip(max(slope, delta / a, -np.log1p(-min(delta / height, 0.9))), 0.0, 2.0))


def instability_warnings(material: Material, strain: float) -> list[str]:
    """Return a warning for each deformation in which the law becomes unstable within `strain`."""
    # Fung's psi is a convex increasing function of I1 - 3, which is convex in logarithmic strains;
    # Hencky's is the sum of their squares. The stability of a gel is that of its free swelling.
    if isinstance(material, LinearElastic | TransverselyIsotropic | Fung | Hencky | Gel):
        return []
    if isinstance(material, NeoHookean):
        return _auxetic_instability(material, strain)
    limit = " near Gent's limit I1 - 3 = Jm" if isinstance(material, Gent) else ""
    warning = f"{material.model} loses its stability (Drucker)"
    strain_note = _strain_range_note(strain)
    return [
        f"{warning} in {loss}{limit}; {strain_note}"
        for loss in stability_losses(material.energy_of_stretches, strain)
    ]


def _auxetic_instability(material: NeoHookean, strain: float) -> list[str]:
    """Return a warning, in a list, if a neo-Hookean law with nu < 0 may become unstable.

    psi is convex in the logarithmic strains e if sum exp(-2 e) < (2 nu - 1)/nu.
    """
    nu = material.constants.nu
    if nu >= 0 or 3 * float(np.exp(2 * strain)) < (2 * nu - 1) / nu:
        return []
    loss = StabilityLoss("all-round", float(np.sqrt(3 * nu / (2 * nu - 1))))
    warning = f"{material.model} with nu < 0 loses its stability (Drucker) in {loss}"
    return [f"{warning}; {_strain_range_note(strain)}"]


def _strain_range_note(strain: float) -> str:
    """Return the end of a warning, which states the expected range of stretches."""
    return f"stretches here may reach exp(+-{strain:.2g})"


def _is_stable(
    psi: Callable[[Expr, Expr, Expr], Expr], e1: np.ndarray, e2: np.ndarray
) -> np.ndarray:
    """Return whether the smallest second derivative of psi is positive; False where psi is NaN."""
    # psi is smooth, and the relative error of the finite differences, 1e-6, does not matter.
    step = 1e-3

    def energy_at(i: Expr, j: Expr) -> np.ndarray:
        a = e1 + i * step
        b = e2 + j * step
        return psi(np.exp(a), np.exp(b), np.exp(-a - b))

    def second_difference(i: Expr, j: Expr) -> np.ndarray:
        return energy_at(i, j) - 2 * energy_at(0, 0) + energy_at(-i, -j)

    with np.errstate(all="ignore"):
        first, second, mixed = (
            second_difference(1, 0),
            second_difference(0, 1),
            (second_difference(1, 1) - second_difference(1, -1)) / 4,
        )
        direction = np.arctan2(2 * mixed, first - second) / 2 + np.pi / 2
        is_beyond_numbers = np.isposinf(
            energy_at(1, 0) + energy_at(-1, 0) + energy_at(0, 1) + energy_at(0, -1)
        )
        # An eigenvalue has a rounding error of about 1e-8 of the sum of both.
        return is_beyond_numbers | (
            second_difference(np.cos(direction), np.sin(direction)) > -1e-8 * (first + second)
        )
