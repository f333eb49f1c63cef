"""Tips in theory: their axisymmetric shape and their closed-form force on a half-space."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from indent_sim.model import tips
from indent_sim.model.tips import (
    FlatPunch,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Sphere,
)
from indent_sim.theory import half_space, profiles


@dataclass(frozen=True)
class TipTheory:
    """What theory knows of a kind of tip: its shape, and force(delta, size, E_star) of a sharp one
    on a half-space.

    takes: what the shape takes of the tip, by name; the first is the size. half_space: whose
    formula the force is.
    """

    shape: Callable[..., profiles.Tip]
    tip_attributes: tuple[str, ...] = ()
    formula_name: str = ""
    force: Callable[..., float] | None = None


SlopeJumps = Callable[
    [], Sequence[tuple[float, float, float]]
]  # of a profile: radius, half of the width, and jump


def _piecewise_linear_tip(
    points: Sequence[Sequence[float]],
    tip_radius: float,
    slope: profiles.Shape,
    slope_jumps: SlopeJumps,
) -> profiles.Tip:
    if tip_radius == 0.0:
        return profiles.piecewise_linear(points)
    slope_discontinuities = {
        round(edge, 15) for c, w, _ in slope_jumps() for edge in (c - w, c + w)
    }
    return profiles.tip_from_slope(
        slope,
        max_radius=points[-1][0],
        slope_discontinuities=sorted(b for b in slope_discontinuities if b > 0),
    )


PUNCH_FORMULA = ("Sneddon (flat punch)", half_space.flat_punch_force)

SQUARE_PYRAMID_FORMULA = ("a square pyramid on a half-space", half_space.square_pyramid_force)

PYRAMID_THEORY = TipTheory(
    profiles.equivalent_cone,
    ("half_angle", "equivalent_radius_ratio", "tip_radius"),
    *SQUARE_PYRAMID_FORMULA,
)

TIP_THEORIES: dict[type, TipTheory] = {
    Paraboloid: TipTheory(profiles.paraboloid, ("R",), "Hertz", half_space.paraboloid_force),
    Sphere: TipTheory(profiles.sphere, ("R",), "Sneddon (sphere)", half_space.sphere_force),
    tips.Cone: TipTheory(
        profiles.cone, ("half_angle", "tip_radius"), "Sneddon (cone)", half_space.cone_force
    ),
    tips.Hyperboloid: TipTheory(profiles.hyperboloid, ("R", "half_angle")),
    FlatPunch: TipTheory(profiles.flat_punch, ("radius", "edge_radius"), *PUNCH_FORMULA),
    Plate: TipTheory(profiles.flat_plate),
    **dict.fromkeys((tips.Pyramid, tips.Berkovich, tips.Vickers, tips.CubeCorner), PYRAMID_THEORY),
    Profile: TipTheory(_piecewise_linear_tip, ("points", "tip_radius", "slope", "rounding_arcs")),
}


def theory_tip_shape(tip: Indenter) -> profiles.Tip | None:
    """The tip as layer theory sees it; None for one that it does not know."""
    tip_theory = TIP_THEORIES.get(type(tip))
    with contextlib.suppress(ValueError):
        return (
            tip_theory.shape(*(getattr(tip, name) for name in tip_theory.tip_attributes))
            if tip_theory
            else None
        )
    return None
