"""Invariants of the deformation gradient F = 1 + H without loss of digits at small H."""

from __future__ import annotations

from indent_sim.model.algebra import (
    Expr,
    log1p,
    log1p_remainder,
    ufl,
)


def excess_and_log_J(H: Expr) -> tuple[Expr, Expr]:
    """(I1 - 3)/2 - ln J and ln J of F = 1 + H, with all digits of them and of their derivatives
    where H is small.
    """
    excess, growth = excess_and_volume_growth(H)
    return excess, log1p(growth)


def excess_and_volume_growth(H: Expr) -> tuple[Expr, Expr]:
    """(I1 - 3)/2 - ln J and J - 1, likewise."""
    nonlinear_growth = nonlinear_volume_growth(H)  # without tr H, which cancels that of (I1 - 3)/2
    growth = ufl.tr(H) + nonlinear_growth
    return ufl.inner(H, H) / 2 - nonlinear_growth + log1p_remainder(growth), growth


def nonlinear_volume_growth(H: Expr) -> Expr:
    """J - 1 less tr H."""
    return (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2 + ufl.det(H)
