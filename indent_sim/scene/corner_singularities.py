"""Corner singularities of body and inclusions near the contact, and gaps between contact and sides.

Where a fixed face meets a free face at a right angle, the stress grows as rho^(lambda - 1) with the
distance rho from the corner. The smallest lambda, 0.595, is that of an incompressible body, and
elements of the size h change the force by a multiple of h^(2 lambda) (Williams 1952, J. Appl. Mech.
19, 526). A refinement that grades away from the corner costs few elements.
Elements at the edge of a punch are chosen in `scene.sizing`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log

from indent_sim.mesh.model_domain import ModelDomain, Side
from indent_sim.model.inclusions import CylinderInclusion
from indent_sim.model.units import round_length
from indent_sim.scene.measured_constants import (
    CORNER_ERROR,
    CORNER_LOGARITHM,
    DECAY_ONSET,
    DECAY_RATE,
    NOTCH_ERROR,
    PLANE_STRAIN_DECAY_RATE,
)

# Exponent 2 lambda of the error of the force.
SINGULARITY_RATE = 1.2


@dataclass(frozen=True)
class Corner:
    """Corner of the body whose stresses are influenced by the contact.

    Attributes
    ----------
    r, depth
        Distance from the tip's axis, and depth below the top [length].
    distance
        Length scale of the stresses at the corner: distance to the contact, or height of the body
        [length].
    error_constant
        Relative error of the force with elements as large as `distance`; 0 without a singularity.
    is_narrow_gap
        True if `distance` is a narrow gap between the contact and a side.
    """

    r: float
    depth: float
    distance: float
    error_constant: float
    is_narrow_gap: bool = False

    def error(self, h: float) -> float:
        """Return a bound of the relative error of the force with elements of size h [length]."""
        return self.error_constant * (h / self.distance) ** SINGULARITY_RATE

    def size(self, error: float, n: float) -> float:
        """Return the element size [length] for a permitted error at the corner.

        A narrow gap is spanned by n elements.
        """
        if self.error_constant:
            size = self.distance * (error / self.error_constant) ** (1 / SINGULARITY_RATE)
        else:
            size = inf
        return min(size, self.distance / n) if self.is_narrow_gap else size


def corners(
    domain: ModelDomain, center: tuple[float, ...], a: float, nu: float, edge: float | None = None
) -> list[Corner]:
    """Return the corners of a model domain that influence a contact.

    Parameters
    ----------
    domain : ModelDomain
        The model domain.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    a : float
        Expected contact radius [length].
    nu : float
        Largest Poisson's ratio of the body.
    edge : float or None
        Radius of the punch's edge at which the contact ends [length]; the edge has a separate
        element size.

    Returns
    -------
    list of Corner
        The corners; in three dimensions the nearest points of the edges.
    """
    inclusion_corners = _inclusion_corners(domain, a)
    if domain.top_arc:
        return _base_edge_corners(domain, domain.top_arc, a, nu) + inclusion_corners
    walls = [
        (domain.supports[surface], round_length(r))
        for surface, r in domain.wall_distances(center).items()
    ]
    # A wall through the axis is a mirror plane, which has no corner.
    side_corners = [
        corner
        for side, r in walls
        if r > 0
        for corner in _side_corners(side, r, domain, a, nu, edge)
    ]
    return side_corners + inclusion_corners


def _load_share(a: float, distance: float, is_plane_strain: bool) -> float:
    """Return the error by a corner at a distance [length], relative to that of a wide contact.

    With the force F of a contact of radius a the energy of the body is F^2/(E a), that near the
    corner F^2/(E distance). In plane strain they are F^2 log(distance/a)/E and F^2/E.
    """
    if a >= distance:
        return 1.0
    if is_plane_strain:
        return 1 / (1 + CORNER_LOGARITHM * log(distance / a))
    return a / distance


def _base_edge_corners(domain: ModelDomain, arc: Side, a: float, nu: float) -> list[Corner]:
    """Return the stress singularity at the rim of the base of a cap or ball; empty if negligible.

    A bonded rim is treated as a right-angled corner of a fixed and a free face. Where the body
    overhangs its base, the rim is a notch, whatever the support. `arc` is the curved top, and `a`
    the radius of the contact [length].
    """
    assert arc.center is not None
    half_height = -arc.center[1]
    r, z = next(side.end for side in domain.outline if side.surface == "base")
    if domain.rests_on_flat and domain.height == 2 * half_height:
        return []
    distance = min(r, -z)
    is_bonded = domain.supports["base"] == "fixed"
    corner_error = 0.0
    if is_bonded:
        decay = exp(-DECAY_RATE * max((r - a) / domain.height - DECAY_ONSET, 0.0))
        corner_error = CORNER_ERROR * (2 * nu) ** 2 * decay
    # A stiff coating distributes the load over at least its own thickness.
    load_width = max(a, -min(domain.interfaces, default=0.0))
    notch_error = NOTCH_ERROR if domain.height > half_height else 0.0
    error_constant = max(corner_error, notch_error) * min(load_width / distance, 1.0)
    return [Corner(round_length(r), -z, distance, error_constant)] if error_constant else []


def _inclusion_corners(domain: ModelDomain, a: float) -> list[Corner]:
    """Return the edges of cylindrical inclusions on the axis of an axisymmetric body.

    The body has a notch of 270 degrees there, which is filled with another material. The stresses
    at an edge extend over its depth, or over the inclusion if that is smaller. The singularity is
    strongest where one of both materials is far stiffer. `a` is the radius of the contact [length].
    """
    if domain.kinematics.name != "axisymmetric":
        return []
    inclusion_corners = []
    for region in domain.regions:
        cylinder = region.inclusion
        if not isinstance(cylinder, CylinderInclusion):
            continue
        E = region.material.constants.E
        E_around = _layer_modulus(domain, cylinder.center[2])
        contrast = abs(E - E_around) / (E + E_around)
        for sign in (-1, 1):
            depth = -cylinder.center[2] + sign * cylinder.half_width(2)
            distance = min(depth, cylinder.min_half_width)
            error_constant = NOTCH_ERROR * contrast * min(a / depth, 1.0) ** 2
            inclusion_corners.append(Corner(cylinder.radius, depth, distance, error_constant))
    return inclusion_corners


def _layer_modulus(domain: ModelDomain, z: float) -> float:
    """Return the Young's modulus of the layer at the height z on the axis [pressure]."""
    layers = [region for region in domain.regions if region.inclusion is None]
    return next(
        (layer.material.constants.E for layer in layers if z >= layer.bottom),
        layers[-1].material.constants.E,
    )


def _side_corners(
    side: str, r: float, domain: ModelDomain, a: float, nu: float, edge: float | None
) -> list[Corner]:
    """Return the corners at both ends of a side at the distance r from the tip's axis.

    The lower corner is singular if the base is bonded and the side free, the upper corner if the
    side is fixed.
    """
    height = domain.height
    # Lower bound of the gap to a side, relative to the distance of the side from the axis: if the
    # expected gap is smaller, the contact may reach the side.
    min_gap_fraction = 0.02
    gap = max(r - a, min_gap_fraction * r if edge is None else 0.0)
    side_corners = []
    is_plane_strain = domain.kinematics.name == "plane_strain"
    decay_rate = PLANE_STRAIN_DECAY_RATE if is_plane_strain else DECAY_RATE
    decay = exp(-decay_rate * max(gap / height - DECAY_ONSET, 0.0))
    corner_error = CORNER_ERROR * (2 * nu) ** 2 * decay
    if (domain.supports["base"], side) == ("fixed", "free"):
        distance = min(r, height)
        error_constant = corner_error * _load_share(a, distance, is_plane_strain)
        side_corners.append(Corner(r, height, distance, error_constant))
    if gap > 0:
        distance = min(gap, height)
        # Gap between contact and side, in contact radii, below which the free surface in
        # it is narrower than the elements of the contact.
        narrow_gap = 0.3
        is_narrow_gap = gap < narrow_gap * a and edge is None
        is_singular = side == "fixed"
        error_constant = (
            corner_error * _load_share(a, distance, is_plane_strain) if is_singular else 0.0
        )
        if error_constant or is_narrow_gap:
            side_corners.append(Corner(r, 0.0, distance, error_constant, is_narrow_gap))
    return side_corners
