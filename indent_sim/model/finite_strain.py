"""Invariants of the deformation gradient F = 1 + H without loss of digits at small H."""

from __future__ import annotations

from indent_sim.model.algebra import (
    Expr,
    log1p,
    log1p_remainder,
    ufl,
)


def excess_and_log_J(H: Expr) -> tuple[Expr, Expr]:
    """Return (I1 - 3)/2 - ln J and ln J of F = 1 + H.

    The values and their derivatives lose no digits where H is small.
    """
    excess, growth = excess_and_volume_growth(H)
    return excess, log1p(growth)


def excess_and_volume_growth(H: Expr) -> tuple[Expr, Expr]:
    """Return (I1 - 3)/2 - ln J and J - 1 of F = 1 + H, without loss of digits where H is small."""
    # tr H occurs in (I1 - 3)/2 and in ln J and cancels, so that only the nonlinear part of the
    # volume change remains.
    nonlinear_growth = nonlinear_volume_growth(H)
    growth = ufl.tr(H) + nonlinear_growth
    return ufl.inner(H, H) / 2 - nonlinear_growth + log1p_remainder(growth), growth


def nonlinear_volume_growth(H: Expr) -> Expr:
    """Return J - 1 - tr H, the part of the volume change that is nonlinear in H."""
    return (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2 + ufl.det(H)
