"""Half-space formulas: force and depth of a tip on a homogeneous elastic half-space."""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np

from indent_sim.model.tips import (
    Indenter,
    Plate,
    RegularPyramid,
)
from indent_sim.scene.tip_theories import TIP_THEORIES, theory_tip_shape
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.layer import sneddon_force
from indent_sim.theory.roots import ForceCurve, depth_of_force
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.stack import Stack


def half_space_depth(tip: Indenter, force: float, E_star: float) -> tuple[str, float] | None:
    """Return the depth at a force on a homogeneous half-space, with the name of its formula.

    Parameters
    ----------
    tip : Indenter
        The tip.
    force : float
        Force [pressure length^2].
    E_star : float
        Indentation modulus of the half-space [pressure].

    Returns
    -------
    tuple of str and float, or None
        Name and depth [length]; None if there is no formula for the tip.
    """
    start = estimate_depth(tip.radius_at, force, E_star)
    name, force_at = _half_space_formula(tip, start, E_star)
    depth = depth_of_force(force_at, force, start) if force_at else None
    return (name, depth) if depth else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Return the force at a depth on a homogeneous half-space, with the name of its formula.

    Parameters
    ----------
    tip : Indenter
        The tip.
    delta : float
        Depth [length].
    E_star : float
        Indentation modulus of the half-space [pressure].

    Returns
    -------
    tuple of str and float, or None
        Name and force [pressure length^2]; None if there is no formula for the tip, or if the
        formula has no value at this depth.
    """
    name, force_at = _half_space_formula(tip, delta, E_star)
    try:
        return (name, force_at(delta)) if force_at else None
    except SOLUTION_ERRORS:
        return None


def _half_space_formula(
    tip: Indenter, delta: float, E_star: float
) -> tuple[str, ForceCurve | None]:
    """Return the name of the formula and the force curve of a tip on a half-space.

    Without a closed form the force is computed by quadrature, in which lengths are divided by about
    the contact radius at `delta`.
    """
    if not delta > 0:
        return "", None
    name, force_at = _closed_form_formula(tip, E_star)
    if force_at or not name:
        return name, force_at
    shape = theory_tip_shape(tip) if tip.is_axisymmetric else None
    unit = float(2.0 ** np.ceil(np.log2(tip.radius_at(delta))))
    half_space = Stack.half_space(E_star, unit)
    return name, partial(sneddon_force, tip=shape, half_space=half_space) if shape else None


@lru_cache(maxsize=16)  # It is called for every row and every point of a curve.
def _closed_form_formula(tip: Indenter, E_star: float) -> tuple[str, ForceCurve | None]:
    """Return the name of the formula and the closed-form force curve of a tip on a half-space.

    The force curve is None if it needs a quadrature. The name is empty if there is no formula.
    """
    tip_theory = TIP_THEORIES.get(type(tip))
    if (
        tip_theory is None
        or isinstance(tip, Plate)
        or (isinstance(tip, RegularPyramid) and tip.faces != 4)
    ):
        return "", None
    is_rounded = getattr(tip, "tip_radius", 0.0) > 0 or getattr(tip, "edge_radius", 0.0) > 0
    if tip_theory.force is None or is_rounded:
        return "Sneddon (quadrature)", None
    size = {tip_theory.tip_attributes[0]: getattr(tip, tip_theory.tip_attributes[0])}
    return tip_theory.formula_name, partial(tip_theory.force, E_star=E_star, **size)
