"""Expected contact of a body that yields: contact radius, force and onset of yield."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf, isfinite

from indent_sim.model.body import Body
from indent_sim.model.imported_body import ImportedBody
from indent_sim.model.kinematics import Kinematics
from indent_sim.model.layers import Layer
from indent_sim.model.materials import Material
from indent_sim.model.tips import Cone, Indenter, max_radius
from indent_sim.scene.compression_theory import covers_top
from indent_sim.scene.depth_limits import Center
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.theory.measured_constants import ROUND_CONTACT_HEIGHTS, SHARP_CONTACT_HEIGHTS
from indent_sim.theory.roots import depth_of_force
from indent_sim.theory.theory import Theory
from indent_sim.theory.yielding import (
    Onset,
    YieldingSolid,
    sphere_onset,
)

# Contact radius at the onset of yield, divided by the thickness of the first layer, up to which the
# onset is that of a half-space.
MAX_ONSET_RADIUS = 0.1
# Contact radius of the elastic body, divided by the thickness of the first layer, up to which the
# estimated force holds on a softer substrate: 20 % too large there for a film that is 30 times as
# hard as its substrate, and 70 % at 0.56. Checked: tests/physics/test_yielding_films.py.
MAX_FILM_RADIUS = 0.35
# Iterations of the contact radius, on which the slope of a round tip depends; each reduces its
# error tenfold.
RADIUS_ITERATIONS = 6


@dataclass(frozen=True)
class YieldingContact:
    """Estimated contact radius and force of a tip on a body whose first layer yields.

    It is an estimate within about 20 % of the force and 10 % of the contact radius, and equal to
    the elastic contact before yield. In a film on a softer substrate the force is not known beyond
    shallow depths, see `force_is_known`.

    Attributes
    ----------
    solid : YieldingSolid
        Constants of the first layer.
    tip : Indenter
        The equivalent tip over a flat body.
    theory : Theory or None
        The elastic reference theory.
    elastic_radius : callable
        Expected contact radius [length] of an elastic body as a function of depth [length].
    thickness : float
        Depth [length] below which other layers begin; infinite for a single layer.
    is_supported : bool
        True if no other layer is more compliant than the first or yields at a smaller stress.
    size : float
        Smallest of height and lateral extent of the body and thickness of the first layer [length].
    rim : float
        Largest contact radius that the body allows [length].
    area : callable
        Contact area of a contact radius [length^2], in plane strain the width [length].
    is_published : bool
        True if the functions of Dao et al. are for this tip and body: a sharp cone on a homogeneous
        half-space at finite strain. Friction and the constants of the material are not considered.
    """

    solid: YieldingSolid
    tip: Indenter
    theory: Theory | None = field(repr=False)
    elastic_radius: Callable[[float], float] = field(repr=False)
    thickness: float
    is_supported: bool
    size: float
    rim: float
    area: Callable[[float], float] = field(repr=False)
    is_published: bool

    @property
    def _is_round(self) -> bool:
        """True if the tip is round at its apex."""
        return self.tip.radius_scale(self.tip.radius_at(1e-3 * self.size)) is not None

    def radius(self, delta: float) -> float:
        """Return the expected contact radius at a depth [length].

        Below flat tips, and in layers that are thinner than the contact, the radius of the elastic
        contact is returned. A layer on a stiffer one yields and spreads as a half-space does.
        """
        elastic = self.elastic_radius(delta)
        is_pierced = elastic > self.thickness and not (self.is_supported and delta < self.thickness)
        if delta <= 0 or is_pierced or elastic >= max_radius(self.tip):
            return elastic
        is_round = self.tip.radius_scale(elastic) is not None
        elastic_height = (ROUND_CONTACT_HEIGHTS if is_round else SHARP_CONTACT_HEIGHTS)[0]
        elastic_section = self.tip.radius_at(elastic_height * delta)
        is_held = isfinite(self.thickness) and self.is_supported
        start = min(elastic, elastic_section) if is_held else elastic
        a = start
        for _ in range(RADIUS_ITERATIONS):
            height = self.solid.contact_height(self._slope(delta, a), is_round=is_round)
            a = start * self.tip.radius_at(height * delta) / elastic_section
        return max(elastic, min(a, self.rim, max_radius(self.tip)))

    def force(self, delta: float) -> float:
        """Return the expected force at a depth [pressure length^2], at most the elastic force.

        If the tip touches the whole top, the force is not known, and infinity is returned.
        """
        if delta <= 0:
            return 0.0
        a = self.radius(delta)
        if a >= self.rim:
            return inf
        plastic = self.solid.mean_pressure(self._slope(delta, a)) * self.area(a)
        return min(plastic, self.elastic_force(delta))

    def force_is_known(self, delta: float) -> bool:
        """True if `force` is an estimate of the force at a depth [length], and not only a bound."""
        return self.is_supported or self.elastic_radius(delta) <= MAX_FILM_RADIUS * self.thickness

    def elastic_force(self, delta: float) -> float:
        """Return the force of an elastic body at a depth; infinite if the force is not known."""
        solution = self.theory.solution_at_depth(delta) if self.theory else None
        if solution:
            return solution.force
        formula = half_space_force(self.tip, delta, self.solid.E_star)
        return formula[1] if formula else inf

    def depth_of_force(self, force: float, start: float) -> float | None:
        """Return the expected depth [length] of a force; None if the force is not reached.

        The search begins at the depth `start`.
        """
        return depth_of_force(self.force, force, start)

    def _slope(self, delta: float, a: float) -> float:
        """Return the slope of the tip at the contact edge, or of a cone of the same strain."""
        smallest_slope = 1e-12
        return max(float(5 * self.tip.characteristic_strain(delta, a)[0]), smallest_slope)

    @property
    def onset(self) -> Onset | None:
        """The contact at the onset of yield; None if it is not known.

        The onset is known for round tips on a layer that is thick compared with the contact. Under
        a sharp tip the body yields from the first contact on.
        """
        if self.is_sharp:
            return Onset(0.0, 0.0, 0.0)
        if not self._is_round:
            return None
        R = self.tip.radius_scale(self.tip.radius_at(1e-6 * self.size))
        assert R is not None
        solid = self.solid
        onset = sphere_onset(R, solid.E_star, solid.nu, solid.yield_stress)
        # A tip that is a cone beyond its rounded apex is a sphere up to this radius.
        apex_ends = [width for r, width in self.tip.slope_discontinuities() if r == 0]
        is_local = onset.a <= min([MAX_ONSET_RADIUS * self.size, *apex_ends])
        return onset if is_local else None

    def published_curvature(self) -> float | None:
        """Return F/delta^2 [pressure] of a frictionless cone by Dao et al.; None if not valid."""
        return self.solid.dao_curvature() if self._dao_holds else None

    def published_stiffness(self) -> float | None:
        """Return unloading stiffness/depth [pressure] by Dao et al.; None if not valid."""
        n = self.solid.power_law_exponent
        return self.solid.dao_stiffness(n) if self._dao_holds and n is not None else None

    @property
    def _dao_holds(self) -> bool:
        """True if the functions of Dao et al. are valid for this body without friction."""
        if not self.is_published or not isinstance(self.tip, Cone):
            return False
        return not self.solid.dao_obstacle(float(self.tip.half_angle))

    @property
    def is_sharp(self) -> bool:
        """True if the tip has a sharp apex or edge, below which the elastic stress is infinite."""
        return any(width == 0 for _, width in self.tip.slope_discontinuities())


def yielding_contact(
    theory: Theory | None,
    tip: Indenter,
    body: Body,
    layers: Sequence[Layer],
    center: Center,
    kinematics: Kinematics,
    elastic_radius: Callable[[float], float],
    *,
    is_half_space: bool,
) -> YieldingContact | None:
    """Return the expected contact if the first layer of a body yields below a tip, else None.

    The contact is not known for a plate and for a mesh from a file. `is_half_space` is true if the
    body represents a half-space; the other parameters are those of `expected_radius`.
    """
    material = layers[0].material
    if material is None or material.plasticity is None or isinstance(body, ImportedBody):
        return None
    if tip.radius_at(1.0) == inf or covers_top(tip, body, center):
        return None
    thickness = layers[0].thickness or inf
    lateral_extent = body.lateral_extent(center)
    is_homogeneous = is_half_space and len(layers) == 1 and not body.inclusions
    is_sharp_cone = isinstance(tip, Cone) and tip.tip_radius == 0
    is_metal = not (material.is_small_strain or material.creeps)
    is_published = is_homogeneous and is_sharp_cone and is_metal
    return YieldingContact(
        _yielding_solid(material),
        tip,
        theory,
        elastic_radius,
        thickness if len(layers) > 1 else inf,
        _is_supported([layer.material or material for layer in layers]),
        min(thickness, body.height, lateral_extent or inf),
        max(lateral_extent, 0.05 * body.lateral_extent(body.center)),
        kinematics.contact_area,
        is_published,
    )


def _is_supported(materials: Sequence[Material]) -> bool:
    """True if no material is more compliant than the first or yields at a smaller stress."""
    first, *others = materials
    assert first.plasticity
    yield_stress = first.plasticity.yield_stress
    return all(
        other.E_star >= first.E_star
        and not (other.plasticity and other.plasticity.yield_stress < yield_stress)
        for other in others
    )


def _yielding_solid(material: Material) -> YieldingSolid:
    """Return the constants of a material that yields."""
    E, nu = material.constants
    plasticity = material.plasticity
    assert plasticity
    return YieldingSolid(
        E,
        nu,
        partial(plasticity.flow_stress, E=E),
        partial(plasticity.hardening_modulus, E=E),
    )
