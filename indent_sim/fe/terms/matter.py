"""The terms of a body without contact."""

from __future__ import annotations

from typing import Any

from indent_sim.fe.body import Body
from indent_sim.fe.terms.strain import Strain
from indent_sim.fe.terms.wall import Wall


def matter(body: Body) -> list[Any]:
    """The strain energy of each region, first of the one under the tip, and the curved wall where there is one."""
    strains = [Strain(body, region) for region in body.scene.physics.part.regions]
    return [*strains, *([Wall(body)] if body.scene.physics.wall_stiffness else [])]
