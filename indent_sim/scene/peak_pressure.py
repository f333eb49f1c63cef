"""Reasons why the peak pressure of a contact is infinite, or cannot be resolved by a mesh."""

from __future__ import annotations

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import Indenter
from indent_sim.scene.problem_definition import ProblemDefinition


def infinite_pressure_reason(tip: Indenter, a: float) -> str:
    """Return why the pressure of a contact of radius a [length] is unbounded; empty if bounded.

    The pressure is unbounded at a slope discontinuity of the tip that is not rounded.
    """
    r_sharp = next((r for r, width in tip.slope_discontinuities() if width == 0 and r <= a), None)
    if r_sharp is None:
        return ""
    return f"the pressure at the tip's sharp {'edge' if r_sharp else 'apex'} is infinite"


def missing_peak_reason(physics: ProblemDefinition, sizes: Sizes, a: float) -> str:
    """Return why a mesh cannot resolve the largest pressure of a contact; empty if it can.

    Under a sharp apex, corner or edge the pressure is infinite, and its largest value on a mesh
    grows as the elements shrink. The same holds for a rounded corner or edge if the elements are
    larger than the arc.

    Parameters
    ----------
    physics : ProblemDefinition
        The problem.
    sizes : Sizes
        The element sizes.
    a : float
        Contact radius [length].
    """
    body = physics.body
    tip = physics.indenter
    discontinuities = tip.slope_discontinuities() if a > 0 else []
    # Relative tolerance for the radius of an edge at the rim of the body.
    extent_tolerance = 1e-9
    for r, width in discontinuities:
        element_size = float(sizes.size_at(np.array(r), np.array(0.0)))
        is_touched = r <= tip.touching_radius + a + element_size or (
            tip.height(r, 0.0) <= 0 and not isinstance(body, SphericalBody)
        )
        if (
            is_touched
            and width < element_size
            and r < body.max_lateral_extent(physics.center) * (1 - extent_tolerance)
        ):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return (
                f"the pressure at the tip's {kind} depends on the mesh: it grows as elements shrink"
            )
    return ""
