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

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.model.units import round_length

SINGULARITY_RATE = 1.2  # 2 lambda
# Relative error of the force with elements of size h at a corner at distance d: CORNER_ERROR (2
# nu)^2 (h/d)^POWER, at most. Measured on cylinders 0.2 to 8 heights wide under punches of 0.05 to 1
# of their radius, nu = 0 to 0.4999
CORNER_ERROR = 0.035
# The same where a body overhangs its base, a notch whatever nu and the support. Measured on caps of
# contact angles from 60 to 170 degrees, elements of 0.01 to 0.3 of the base radius: 0.1 to 1.3 of
# this, no more than noise up to 90
NOTCH_ERROR = 0.1
# heights between contact and side from which it fades, and how fast: measured likewise
DECAY_ONSET = 0.5
DECAY_RATE = 1.25
# Of the contact radius: with less between contact and wall the surface there is narrower than the
# elements
NARROW_GAP = 0.3
# of the distance from the axis to a side: where contact is expected to reach the side itself
MIN_GAP_FRACTION = 0.02


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
    error_constant: float
    is_narrow_gap: bool = False

    def error(self, h: float) -> float:
        """The relative error of the force, at most, with elements of the size h [length]."""
        return self.error_constant * (h / self.distance) ** SINGULARITY_RATE

    def size(self, error: float, n: float) -> float:
        """The size [length] that costs this relative error of the force, with at least n elements
        in a narrow gap.
        """
        singular = (
            self.distance * (error / self.error_constant) ** (1 / SINGULARITY_RATE)
            if self.error_constant
            else float("inf")
        )
        return min(singular, self.distance / n) if self.is_narrow_gap else singular


def corners(
    domain: ModelDomain, center: tuple[float, ...], a: float, nu: float, edge: float | None = None
) -> list[Corner]:
    """Corners that a contact of the radius a [length] may feel; in three dimensions the points of
    edges next to it. edge: radius of the punch's edge at which the contact ends, which has a
    size of its own.
    """
    if domain.top_radius:
        return _base_edge_corners(domain, domain.top_radius, a, nu)
    walls = [
        (domain.supports[surface], round_length(r))
        for surface, r in domain.wall_distances(center).items()
    ]
    return [
        corner
        for side, r in walls
        if r > 0
        for corner in _side_corners(side, r, domain, a, nu, edge)
    ]  # 0: a mirror plane


def _base_edge_corners(domain: ModelDomain, radius: float, a: float, nu: float) -> list[Corner]:
    """The edge between the base and a curved surface; an acute one is taken for a right angle."""
    r, z = next(side.end for side in domain.outline if side.surface == "base")
    distance = min(r, -z)
    is_bonded = domain.supports["base"] == "fixed"
    corner_error = (
        CORNER_ERROR
        * (2 * nu) ** 2
        * exp(-DECAY_RATE * max((r - a) / domain.height - DECAY_ONSET, 0.0))
        if is_bonded
        else 0.0
    )
    load_width = max(
        a, -min(domain.interfaces, default=0.0)
    )  # stiff skins hand on all that is less wide than they are thick
    error_constant = max(corner_error, NOTCH_ERROR if domain.height > radius else 0.0) * min(
        load_width / distance, 1.0
    )
    return [Corner(round_length(r), -z, distance, error_constant)] if error_constant else []


def _side_corners(
    side: str, r: float, domain: ModelDomain, a: float, nu: float, edge: float | None
) -> list[Corner]:
    """At the ends of a side at the distance r: at the base where that is bonded and the side free,
    and at the top.
    """
    height = domain.height
    gap = max(r - a, MIN_GAP_FRACTION * r if edge is None else 0.0)
    corners_found = []
    corner_error = (
        CORNER_ERROR * (2 * nu) ** 2 * exp(-DECAY_RATE * max(gap / height - DECAY_ONSET, 0.0))
    )
    if (domain.supports["base"], side) == ("fixed", "free"):
        distance = min(r, height)
        corners_found.append(Corner(r, height, distance, corner_error * min(a / distance, 1.0)))
    if gap > 0:
        distance = min(gap, height)
        is_narrow_gap = gap < NARROW_GAP * a and edge is None
        error_constant = corner_error * min(a / distance, 1.0) if side == "fixed" else 0.0
        corners_found += (
            [Corner(r, 0.0, distance, error_constant, is_narrow_gap)]
            if error_constant or is_narrow_gap
            else []
        )
    return corners_found
