"""Peak pressure: whether a contact has one, and whether a mesh can resolve it."""

from __future__ import annotations

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import Indenter
from indent_sim.scene.problem_definition import ProblemDefinition

EXTENT_TOLERANCE = 1e-9  # of a length


def infinite_pressure_reason(tip: Indenter, a: float) -> str:
    """Why the pressure of a contact of radius a [length] has no largest value; empty where it has
    one.
    """
    where = next((r for r, width in tip.slope_discontinuities() if width == 0 and r <= a), None)
    return (
        ""
        if where is None
        else f"the pressure at the tip's sharp {'edge' if where else 'apex'} is infinite"
    )


def missing_peak_reason(physics: ProblemDefinition, sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one
    does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements
    shrink, as it does while they are larger than the arc that rounds one.
    """
    body = physics.body
    tip = physics.indenter
    for r, width in tip.slope_discontinuities() if a > 0 else []:
        element_size = float(sizes.size_at(np.array(r), np.array(0.0)))
        is_touched = r <= a + element_size or (
            tip.height(r, 0.0) <= 0 and not isinstance(body, SphericalBody)
        )
        if (
            is_touched
            and width < element_size
            and r < body.max_lateral_extent(physics.center) * (1 - EXTENT_TOLERANCE)
        ):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return (
                f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
            )
    return ""
