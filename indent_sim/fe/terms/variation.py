"""Variations of an energy density that depends on the displacement by way of a few scalars only.

With psi = phi(s_1, s_2, ...) the derivatives of phi are numbers at a point, whatever the test
functions are:

    d psi = phi_i ds_i,    d(d psi) = phi_ij ds_i ds_j + phi_i d(ds_i).

A phi of many terms, as Ogden's with its roots and powers, then costs kernels a tenth of the code
that it costs when every one of its terms is varied.
"""

from __future__ import annotations

import ufl
from ufl.classes import Coefficient, Expr, Variable

from indent_sim.fe.discrete_body import Moment


def variations(psi: Expr, now: Moment) -> tuple[Expr, Expr]:
    """The first variation of psi along now.test, and the second one along now.test and now.trial."""
    scalars = _scalars(psi)
    solution = now.function
    test = now.test
    trial = now.trial
    if scalars is None:
        first = ufl.derivative(psi, solution, test)
        return first, ufl.derivative(first, solution, trial)
    slopes = [ufl.diff(psi, s) for s in scalars]
    ways = [ufl.derivative(s, solution, test) for s in scalars]
    first = sum(slope * way for slope, way in zip(slopes, ways, strict=True))
    second = sum(
        slope * ufl.derivative(way, solution, trial)
        for slope, way in zip(slopes, ways, strict=True)
    )
    for slope, way in zip(slopes, ways, strict=True):
        second += sum(
            ufl.diff(slope, s) * way * ufl.derivative(s, solution, trial) for s in scalars
        )
    return first, second


def _scalars(psi: Expr) -> list[Expr] | None:
    """The scalar variables that psi is written in; None if it depends on an unknown in another way."""
    found: dict[Expr, Expr] = {}
    rest = [psi]
    seen = set()
    while rest:
        part = rest.pop()
        if id(part) in seen:
            continue
        seen.add(id(part))
        if isinstance(part, Coefficient) or (isinstance(part, Variable) and part.ufl_shape):
            return None
        if isinstance(part, Variable):
            found[part.label()] = part
        else:
            rest += part.ufl_operands
    return list(found.values())
