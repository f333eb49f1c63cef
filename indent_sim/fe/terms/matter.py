"""The terms of a body without contact."""

from __future__ import annotations

from typing import Any

from indent_sim.fe.body import Body
from indent_sim.fe.terms.strain import Strain
from indent_sim.fe.terms.wall import Wall


def matter(body: Body) -> list[Any]:
    """The strain energy, first, and the curved wall where there is one."""
    return [Strain(body), *([Wall(body)] if body.scene.wall_stiffness else [])]
