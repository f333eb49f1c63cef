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
    """Name and depth of a tip on a half-space at a force; None for the tips that nobody has a
    formula for.
    """
    start = estimate_depth(tip.radius_at, force, E_star)
    name, force_at = _half_space_formula(tip, start, E_star)
    depth = depth_of_force(force_at, force, start) if force_at else None
    return (name, depth) if depth else None


def half_space_force(tip: Indenter, delta: float, E_star: float) -> tuple[str, float] | None:
    """Name and force of a tip on a half-space (Hertz, Sneddon); None for the tips that nobody has a
    formula for.
    """
    name, force_at = _half_space_formula(tip, delta, E_star)
    try:
        return (name, force_at(delta)) if force_at else None
    except SOLUTION_ERRORS:
        return None


def _half_space_formula(
    tip: Indenter, delta: float, E_star: float
) -> tuple[str, ForceCurve | None]:
    """Name and force of a tip on a half-space near a depth; by quadrature where it has no closed
    form.
    """
    if not delta > 0:
        return "", None
    name, force_at = _closed_form_formula(tip, E_star)
    if force_at or not name:
        return name, force_at
    shape = theory_tip_shape(tip) if tip.is_axisymmetric else None
    unit = float(2.0 ** np.ceil(np.log2(tip.radius_at(delta))))  # about the contact radius
    half_space = Stack.half_space(E_star, unit)
    return name, partial(sneddon_force, tip=shape, half_space=half_space) if shape else None


@lru_cache(maxsize=16)  # every row and every point of a curve asks
def _closed_form_formula(tip: Indenter, E_star: float) -> tuple[str, ForceCurve | None]:
    """Name and force of a tip on a half-space; no force where it takes a quadrature, no name where
    nobody knows it.
    """
    tip_theory = TIP_THEORIES.get(type(tip))
    if (
        tip_theory is None
        or isinstance(tip, Plate)
        or (isinstance(tip, RegularPyramid) and tip.faces != 4)
    ):
        return "", None
    if (
        tip_theory.force is None
        or getattr(tip, "tip_radius", 0.0) > 0
        or getattr(tip, "edge_radius", 0.0) > 0
    ):
        return "Sneddon (quadrature)", None
    first_attribute = {tip_theory.tip_attributes[0]: getattr(tip, tip_theory.tip_attributes[0])}
    return tip_theory.formula_name, partial(tip_theory.force, E_star=E_star, **first_attribute)
