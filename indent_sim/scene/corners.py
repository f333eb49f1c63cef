"""Corners of the body beside the contact: where the solution is singular or a wall is near, and how
finely they are meshed.

Where a held face meets a free one at a right angle the stress grows as rho^(lambda - 1) with the
distance rho. The smallest lambda, 0.595, is that of an incompressible body, and the force on
elements of the size h is off by h^(2 lambda) (Williams 1952, J. Appl. Mech. 19, 526). Elements that
grow with the distance from the corner cost little.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from indent_sim.mesh.modelled_part import Part
from indent_sim.model.units import rounded

POWER = 1.2  # 2 lambda
# Relative error of the force with elements of size h at a corner at distance d: CORNER_ERROR (2
# nu)^2 (h/d)^POWER, at most. Measured on cylinders 0.2 to 8 heights wide under punches of 0.05 to 1
# of their radius, nu = 0 to 0.4999
CORNER_ERROR = 0.035
# The same where a body overhangs its base, a notch whatever nu and the support. Measured on caps of
# contact angles from 60 to 170 degrees, elements of 0.01 to 0.3 of the base radius: 0.1 to 1.3 of
# this, no more than noise up to 90
NOTCH = 0.1
# heights between contact and side from which it fades, and how fast: measured likewise
BESIDE = 0.5
FADING = 1.25
# Of the contact radius: with less between contact and wall the surface there is narrower than the
# elements
NARROW_GAP = 0.3
# of the distance from the axis to a side: where contact is expected to reach the side itself
LEAST_GAP = 0.02


@dataclass(frozen=True)
class Corner:
    """A corner at a distance r from the tip's axis and a depth, and the distance [length] that its
    stresses know.

    share: of the force, the error with elements as large as that distance; 0 where nothing is
    singular. is_near: whether that distance is a narrow gap between the contact and a side.
    """

    r: float
    depth: float
    distance: float
    share: float
    is_near: bool = False

    def error(self, h: float) -> float:
        """The relative error of the force, at most, with elements of the size h [length]."""
        return self.share * (h / self.distance) ** POWER

    def size(self, error: float, n: float) -> float:
        """The size [length] that costs this relative error of the force, with at least n elements
        in a narrow gap.
        """
        singular = (
            self.distance * (error / self.share) ** (1 / POWER) if self.share else float("inf")
        )
        return min(singular, self.distance / n) if self.is_near else singular


def corners(
    part: Part, center: tuple[float, ...], a: float, nu: float, edge: float | None = None
) -> list[Corner]:
    """Corners that a contact of the radius a [length] may feel; in three dimensions the points of
    edges next to it. edge: radius of the punch's edge at which the contact ends, which has a
    size of its own.
    """
    if part.dome:
        return _at_foot(part, part.dome, a, nu)
    walls = [(part.supports[surface], rounded(r)) for surface, r in part.distances(center).items()]
    return [
        corner for side, r in walls if r > 0 for corner in _beside(side, r, part, a, nu, edge)
    ]  # 0: a mirror plane


def _at_foot(part: Part, radius: float, a: float, nu: float) -> list[Corner]:
    """The edge between the base and a curved surface; an acute one is taken for a right angle."""
    r, z = next(side.end for side in part.outline if side.surface == "base")
    distance = min(r, -z)
    is_bonded = part.supports["base"] == "fixed"
    felt = (
        CORNER_ERROR * (2 * nu) ** 2 * exp(-FADING * max((r - a) / part.height - BESIDE, 0.0))
        if is_bonded
        else 0.0
    )
    wide = max(
        a, -min(part.interfaces, default=0.0)
    )  # stiff skins hand on all that is less wide than they are thick
    share = max(felt, NOTCH if part.height > radius else 0.0) * min(wide / distance, 1.0)
    return [Corner(rounded(r), -z, distance, share)] if share else []


def _beside(
    side: str, r: float, part: Part, a: float, nu: float, edge: float | None
) -> list[Corner]:
    """At the ends of a side at the distance r: at the base where that is bonded and the side free,
    and at the top.
    """
    height = part.height
    gap = max(r - a, LEAST_GAP * r if edge is None else 0.0)
    found = []
    felt = CORNER_ERROR * (2 * nu) ** 2 * exp(-FADING * max(gap / height - BESIDE, 0.0))
    if (part.supports["base"], side) == ("fixed", "free"):
        distance = min(r, height)
        found.append(Corner(r, height, distance, felt * min(a / distance, 1.0)))
    if gap > 0:
        distance = min(gap, height)
        is_near = gap < NARROW_GAP * a and edge is None
        share = felt * min(a / distance, 1.0) if side == "fixed" else 0.0
        found += [Corner(r, 0.0, distance, share, is_near)] if share or is_near else []
    return found
