"""Corners of the body beside the contact: where the solution is singular or a wall is near, and how finely they are
meshed.

Where a held face meets a free one at a right angle the stress grows as rho^(lambda - 1) with the distance rho. The
smallest lambda, 0.595, is that of an incompressible body, and the force on elements of the size h is off by
h^(2 lambda) (Williams 1952, J. Appl. Mech. 19, 526). Elements that grow with the distance from the corner cost little.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from indent_sim.mesh.part import Part
from indent_sim.model.units import rounded

POWER = 1.2  # 2 lambda
# Relative error of the force with elements of the size h at a corner at the distance d: FELT (2 nu)^2 (h/d)^POWER, at
# most. Measured on cylinders 0.2 to 8 heights wide under punches of 0.05 to 1 of their radius, nu = 0 to 0.4999
FELT = 0.035
# The same where a body overhangs its base, a notch whatever nu and the support. Measured on caps of contact angles from
# 60 to 170 degrees, elements of 0.01 to 0.3 of the base radius: 0.1 to 1.3 of this, no more than noise up to 90
NOTCH = 0.1
BESIDE, FADING = 0.5, 1.25  # heights between contact and side from which it fades, and how fast: measured likewise
NEAR = 0.3  # of the contact radius: with less between contact and wall the surface there is narrower than the elements
LEAST_GAP = 0.02  # of the distance from the axis to a side: where contact is expected to reach the side itself


@dataclass(frozen=True)
class Corner:
    """A corner at a distance r from the tip's axis and a depth, and the distance [length] that its stresses know.

    share: of the force, the error with elements as large as that distance; 0 where nothing is singular.
    is_near: whether that distance is a narrow gap between the contact and a side.
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
        """The size [length] that costs this relative error of the force, with at least n elements in a narrow gap."""
        singular = self.distance * (error / self.share) ** (1 / POWER) if self.share else float("inf")
        return min(singular, self.distance / n) if self.is_near else singular


def corners(part: Part, center: tuple[float, ...], a: float, nu: float, sharp: bool) -> list[Corner]:
    """Corners that a contact of the radius a [length] may feel; in three dimensions the points of edges next to it.

    sharp: the contact ends at a punch's edge, which has a size of its own.
    """
    if part.dome:
        return _at_foot(part, part.dome, a, nu)
    return [
        corner
        for surface, r in part.distances(center).items()
        if rounded(r) > 0  # 0: a mirror plane
        for corner in _beside(rounded(r), part.height, a, nu, sharp, part.supports["base"], part.supports[surface])
    ]


def _at_foot(part: Part, radius: float, a: float, nu: float) -> list[Corner]:
    """The edge between the base and a curved surface; an acute one is taken for a right angle."""
    r, z = next(side.end for side in part.outline if side.surface == "base")
    distance, is_bonded = min(r, -z), part.supports["base"] == "fixed"
    felt = FELT * (2 * nu) ** 2 * exp(-FADING * max((r - a) / part.height - BESIDE, 0.0)) if is_bonded else 0.0
    share = max(felt, NOTCH if part.height > radius else 0.0) * min(a / distance, 1.0)
    return [Corner(rounded(r), -z, distance, share)] if share else []


def _beside(r: float, height: float, a: float, nu: float, sharp: bool, base: str, side: str) -> list[Corner]:
    """The corners at a side at the distance r from the axis."""
    gap = max(r - a, 0.0 if sharp else LEAST_GAP * r)
    felt = FELT * (2 * nu) ** 2 * exp(-FADING * max(gap / height - BESIDE, 0.0))

    def corner(depth: float, distance: float, is_singular: bool, is_near: bool = False) -> Corner:
        return Corner(r, depth, distance, felt * min(a / distance, 1.0) if is_singular else 0.0, is_near)

    bonded = [corner(height, min(r, height), True)] if (base, side) == ("fixed", "free") else []
    is_near = gap < NEAR * a and not sharp
    above = [corner(0.0, min(gap, height), side == "fixed", is_near)] if gap > 0 else []
    return bonded + [found for found in above if found.share or is_near]
