"""An incompressible body held on all sides: what the tip takes of its room must come up beside the tip."""

from __future__ import annotations

import numpy as np

from indent_sim.model.body import Body
from indent_sim.model.indenters import Indenter
from indent_sim.model.materials import Material

POINTS = 400  # along each axis; midpoints, so that the mean of a paraboloid is good to 1e-5


def deepest(body: Body, material: Material, tip: Indenter, center: tuple[float, ...]) -> float:
    """The depth [length] at which the tip would cover the whole top; infinity for a body that can give way.

    The volume under the undeformed top stays what it is, so the surface's mean height stays 0, and under a tip that
    touches it everywhere that is the tip's mean height minus the depth. The force grows beyond all bounds before.
    """
    _, nu = material.constants
    if nu < 0.5 or not is_held(body):
        return float("inf")
    x, y = _top(body)
    along_x, along_y = (*center, 0.0)[:2]
    return float(np.mean(tip.height(x - along_x, y - along_y)))


def is_held(body: Body) -> bool:
    """Whether no side lets the body out."""
    sides = body.sides
    each = [sides] if isinstance(sides, str) else list(vars(sides).values())
    return "free" not in each


def _top(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Points of the top surface, each standing for an equal area."""
    middles = (np.arange(POINTS) + 0.5) / POINTS
    match body.shape:
        case "cylinder":
            r, angle = body.radius * np.sqrt(middles)[:, None], 2 * np.pi * middles[None, :]
            return r * np.cos(angle), r * np.sin(angle)
        case "strip":
            return body.width * middles, np.zeros(POINTS)
    return body.size[0] * middles[:, None], body.size[1] * middles[None, :]
