"""Axisymmetric shapes of tips for the layer theory, and closed-form forces on a half-space."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from indent_sim.model import tips
from indent_sim.model.tilted_tip import TiltedTip
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
    """Theory of one kind of tip.

    Attributes
    ----------
    shape
        Function that returns the axisymmetric shape from the attributes of a tip.
    tip_attributes
        Names of the attributes that `shape` takes; the first one is the size of the tip.
    formula_name
        Name of the force formula.
    force
        Function force(delta, size, E_star) of a sharp tip on a half-space; None without a closed
        form.
    """

    shape: Callable[..., profiles.Tip]
    tip_attributes: tuple[str, ...] = ()
    formula_name: str = ""
    force: Callable[..., float] | None = None


# Function that returns the rounding arcs of a profile: radial position of the middle of an arc,
# half of its width [length], and change of slope.
RoundingArcs = Callable[[], Sequence[tuple[float, float, float]]]


def _piecewise_linear_tip(
    points: Sequence[Sequence[float]],
    tip_radius: float,
    slope: profiles.Shape,
    rounding_arcs: RoundingArcs,
) -> profiles.Tip:
    """Return the shape of a piecewise linear profile, whose corners may be rounded by arcs."""
    if tip_radius == 0.0:
        return profiles.piecewise_linear(points)
    arc_ends = {
        round(end, 15)
        for middle, half_width, _ in rounding_arcs()
        for end in (middle - half_width, middle + half_width)
    }
    return profiles.tip_from_slope(
        slope,
        max_radius=points[-1][0],
        slope_discontinuities=sorted(end for end in arc_ends if end > 0),
    )


PYRAMID_THEORY = TipTheory(
    profiles.equivalent_cone,
    ("half_angle", "equivalent_radius_ratio", "tip_radius"),
    "a square pyramid on a half-space",
    half_space.square_pyramid_force,
)
TIP_THEORIES: dict[type, TipTheory] = {
    Paraboloid: TipTheory(profiles.paraboloid, ("R",), "Hertz", half_space.paraboloid_force),
    Sphere: TipTheory(profiles.sphere, ("R",), "Sneddon (sphere)", half_space.sphere_force),
    tips.Cone: TipTheory(
        profiles.cone, ("half_angle", "tip_radius"), "Sneddon (cone)", half_space.cone_force
    ),
    tips.Hyperboloid: TipTheory(profiles.hyperboloid, ("R", "half_angle")),
    FlatPunch: TipTheory(
        profiles.flat_punch,
        ("radius", "edge_radius"),
        "Sneddon (flat punch)",
        half_space.flat_punch_force,
    ),
    Plate: TipTheory(profiles.flat_plate),
    **dict.fromkeys((tips.Pyramid, tips.Berkovich, tips.Vickers, tips.CubeCorner), PYRAMID_THEORY),
    Profile: TipTheory(_piecewise_linear_tip, ("points", "tip_radius", "slope", "rounding_arcs")),
}


def theory_tip_shape(tip: Indenter, dim: int = 3) -> profiles.Tip | None:
    """Return the axisymmetric shape of a tip for layer theory; None if there is no shape.

    A tilted tip has the shape of the upright tip with sections of equal area, or of equal width in
    plane strain (`dim` 2).
    """
    if isinstance(tip, TiltedTip):
        equivalent = tip.equivalent_tip(dim)
        return None if equivalent is None else theory_tip_shape(equivalent)
    tip_theory = TIP_THEORIES.get(type(tip))
    if tip_theory is None:
        return None
    with contextlib.suppress(ValueError):
        return tip_theory.shape(*(getattr(tip, name) for name in tip_theory.tip_attributes))
    return None
