"""A sharp tip under a gap at the deformed point: its normal must be continuous, so it gets a radius of its own."""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass
from typing import Any

from indent_sim.model.body import Body
from indent_sim.model.indenters import Cone, FlatPunch, Indenter, Profile, Pyramid
from indent_sim.model.materials import Material
from indent_sim.oracle import oracle

SHARE = 1e-3  # of the expected contact radius: the radius that a sharp apex or edge gets


@dataclass(frozen=True)
class Blunting:
    """The tip with its new radius, the key and value of it [length], and how that changes the force (None: unknown)."""

    tip: Indenter
    key: str
    radius: float
    force_change: float | None

    @property
    def why(self) -> str:
        """The reason in words."""
        reason = f"gap: current needs a normal everywhere; {SHARE:g} of the expected contact radius"
        if self.force_change is None:
            return reason
        return f"{reason}, changes the force by {self.force_change:+.1g} by layer theory"


def blunted(tip: Indenter, a: float, body: Body, material: Material, center: tuple[float, ...], delta: float
            ) -> Blunting | None:  # fmt: skip
    """A sharp cone, pyramid, profile or punch with a small radius; None for a tip that is smooth already."""
    key = "edge_radius" if isinstance(tip, FlatPunch) else "tip_radius"
    if not isinstance(tip, Cone | Pyramid | FlatPunch | Profile) or getattr(tip, key) > 0:
        return None
    radius = float(f"{SHARE * a:.12g}")
    changes: dict[str, Any] = {key: radius}
    smooth = dataclasses.replace(tip, **changes)
    forces = [_force(one, body, material, center, delta) for one in (tip, smooth)]
    change = forces[1] / forces[0] - 1 if forces[0] and forces[1] else None
    return Blunting(smooth, f"indenter.{key}", radius, change)


def _force(tip: Indenter, body: Body, material: Material, center: tuple[float, ...], delta: float) -> float | None:
    theory = oracle(body, material, tip, center)
    with contextlib.suppress(ArithmeticError):
        solution = theory.at(delta) if theory and delta > 0 else None
        return solution.force if solution else None
    return None
