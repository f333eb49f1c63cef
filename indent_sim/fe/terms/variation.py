"""Variations of an energy density that depends on the displacement through few scalars.

For psi = phi(s_1, s_2, ...) the chain rule gives

    d psi = phi_i ds_i,    d(d psi) = phi_ij ds_i ds_j + phi_i d(ds_i),

where the derivatives of phi do not depend on the test functions. For a phi with many terms, such as
Ogden's, the compiled kernel then has a tenth of the code of a direct variation.
"""

from __future__ import annotations

import ufl
from ufl.classes import Coefficient, Expr, Variable

from indent_sim.fe.unknowns import TimeLevel


def variations(psi: Expr, now: TimeLevel) -> tuple[Expr, Expr]:
    """Return the first variation of psi along `now.test` and the second along `now.trial`."""
    scalars = _scalar_variables(psi)
    solution = now.function
    test = now.test
    trial = now.trial
    if scalars is None:
        first = ufl.derivative(psi, solution, test)
        return first, ufl.derivative(first, solution, trial)
    slopes = [ufl.diff(psi, s) for s in scalars]
    scalar_variations = [ufl.derivative(s, solution, test) for s in scalars]
    first = sum(
        slope * scalar_variation
        for slope, scalar_variation in zip(slopes, scalar_variations, strict=True)
    )
    second = sum(
        slope * ufl.derivative(scalar_variation, solution, trial)
        for slope, scalar_variation in zip(slopes, scalar_variations, strict=True)
    )
    for slope, scalar_variation in zip(slopes, scalar_variations, strict=True):
        second += sum(
            ufl.diff(slope, s) * scalar_variation * ufl.derivative(s, solution, trial)
            for s in scalars
        )
    return first, second


def _scalar_variables(psi: Expr) -> list[Expr] | None:
    """Return the scalar UFL variables of psi; None if psi also depends on the unknowns directly."""
    variables: dict[Expr, Expr] = {}
    pending = [psi]
    visited = set()
    while pending:
        node = pending.pop()
        if id(node) in visited:
            continue
        visited.add(id(node))
        if isinstance(node, Coefficient) or (isinstance(node, Variable) and node.ufl_shape):
            return None
        if isinstance(node, Variable):
            variables[node.label()] = node
        else:
            pending += node.ufl_operands
    return list(variables.values())
