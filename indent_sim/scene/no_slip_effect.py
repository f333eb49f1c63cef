"""Effect of no slip and of friction on the force, estimated before the scene is solved."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, log, pi

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import Friction
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.scene.measured_constants import MAX_RIM_ELEMENTS
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory import no_slip
from indent_sim.theory.no_slip import FrictionCorrection


@dataclass(frozen=True)
class NoSlipEffect:
    """Relative change of the force at the largest depth if the contact has no slip.

    The reference is a contact without friction.

    Attributes
    ----------
    percent : float or None
        The change [%] if it is known exactly.
    low, high : float or None
        Range of the change [%]; None if it is known only for small strain and the strains are
        finite.
    source : str
        Text on the origin of these numbers.
    """

    percent: float | None
    low: float | None
    high: float | None
    source: str

    @property
    def is_noticeable(self) -> bool:
        """True if the change may be 1 % or more, so that it is reported."""
        negligible_percent = 1.0
        return (
            self.low is None
            or self.high is None
            or max(abs(self.low), abs(self.high)) >= negligible_percent
        )

    @property
    def remark(self) -> str:
        """Return the sentence on the change if it is noticeable, otherwise an empty string."""
        return self.sentence if self.is_noticeable else ""

    @property
    def sentence(self) -> str:
        """Return a sentence that states the change."""
        if self.low is None or self.high is None:
            return f"no slip instead of no friction may change this force noticeably: {self.source}"
        low = f"{self.low:+z.1f}"
        high = f"{self.high:+z.1f}"
        range_text = f"between {low} and {high}" if low != high else low
        change = f"{range_text} % ({self.source})"
        if self.percent is not None:
            details = f"{range_text}; {self.source}" if low != high else self.source
            change = f"{self.percent:+z.1f} % ({details})"
        return f"pure stick instead of no friction would change this force by {change}"


def no_slip_effect(
    setup: ProblemSetup, physics: ProblemDefinition, linear: str = "direct"
) -> NoSlipEffect | None:
    """Return the effect of no slip at the largest depth; None if unknown or without slip.

    The effect is exact on a half-space. For other bodies it is a range interpolated from computed
    bonded layers (`theory.no_slip`). At finite strain, or with the gap evaluated at the deformed
    point, no number is known; an effect is returned only if the effect at small strain is
    noticeable.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    physics : ProblemDefinition
        The problem with all its choices.
    linear : str
        Linear solver of the runs for error estimates, "direct" or "iterative".
    """
    effect = (
        None if physics.is_path_dependent or setup.max_depth <= 0 else _small_strain_effect(setup)
    )
    if effect is None or physics.is_linear:
        return effect
    is_solvable = not physics.domain.pins and linear != "iterative"
    source = "at small strain the change is noticeable, and it may be larger here"
    if is_solvable:
        source += "; --error-bars computes it"
    return NoSlipEffect(None, None, None, source) if effect.is_noticeable else None


def _small_strain_effect(setup: ProblemSetup) -> NoSlipEffect | None:
    """Return the effect of no slip at small strain; None if it is not known from theory."""
    physics = setup.physics
    a = setup.a
    domain = physics.domain
    tip = physics.indenter
    power = profile_exponent(physics.indenter)
    if (
        power is None
        or tip.elastic_part
        or physics.surface_tension
        or not _is_homogeneous_isotropic(domain)
        or domain.kinematics.name == "plane_strain"
        or a <= 0
    ):
        return None
    nu = physics.material.constants.nu
    lateral_extent = physics.body.lateral_extent(physics.center)
    if setup.is_half_space:
        percent = 100 * (no_slip.force_ratio(nu, power) - 1)
        source = "half-space, exact"
        if isinstance(tip, Sphere):
            source += " for the paraboloid"
        return NoSlipEffect(percent, percent, percent, source)
    # Distance of the side walls, in thicknesses of the layer and contact radii, from which on
    # they hardly change the force.
    min_wall_distance = 2.0
    min_extent = min_wall_distance * max(domain.height, a)
    if domain.supports.get("base") != "fixed" or lateral_extent < min_extent:
        return None
    ratios = no_slip.layer_force_range(nu, a / domain.height, power)
    if ratios is None:
        return None
    low, high = (100 * (ratio - 1) for ratio in ratios)
    return NoSlipEffect(None, low, high, "interpolated from bonded layers at small strain")


def _is_homogeneous_isotropic(domain: ModelDomain) -> bool:
    """True if the body is one region of an isotropic material."""
    return len(domain.regions) == 1 and domain.regions[0].material.is_isotropic


def profile_exponent(tip: Indenter) -> float | None:
    """Return the exponent n of the tip's profile f = B r^n; infinity for a punch.

    The exponent is None for any other profile, and for a rounded apex or edge.
    """
    is_sharp = not any(getattr(tip, name, 0.0) > 0 for name in ("tip_radius", "edge_radius"))
    # Exponent n of the profile f = B r^n of a tip; infinite for a flat punch.
    exponents: dict[type, float] = {
        Paraboloid: 2.0,
        Sphere: 2.0,
        Cone: 1.0,
        FlatPunch: inf,
    }
    return exponents.get(type(tip)) if is_sharp else None


def friction_correction(
    setup: ProblemSetup, physics: ProblemDefinition, friction: Friction
) -> FrictionCorrection | None:
    """Return the effect of Coulomb friction on the contact with a half-space at the largest depth.

    The result is None for other tips and bodies, for a path that unloads before its largest depth,
    and for a coefficient of friction beyond the range of the theory.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    physics : ProblemDefinition
        The problem with its load path.
    friction : float or "stick"
        The coefficient of friction.
    """
    values = physics.path.values
    power = profile_exponent(setup.physics.indenter)
    if not (
        setup.is_half_space and physics.is_linear and setup.max_depth > 0 and physics.has_friction
    ):
        return None
    has_unloading = any(
        later < earlier for earlier, later in pairwise(values[: values.index(max(values)) + 1])
    )
    if power is None or not _is_homogeneous_isotropic(physics.domain) or has_unloading:
        return None
    # This import loads scipy, which other scenes do not need.
    from indent_sim.theory import friction as coulomb_friction

    with suppress(ValueError):
        return coulomb_friction.friction_correction(physics.material.constants.nu, friction, power)
    return None


def friction_sentence(physics: ProblemDefinition, correction: FrictionCorrection) -> str:
    """Return a sentence on the change of the force by friction."""
    cause = "no slip"
    stick_text = ""
    if correction.sticks < 1.0:
        cause = f"friction {physics.contact.friction:g}"
        stick_text = (
            f", and the surface sticks within {correction.sticks:.2g} of the contact radius"
        )
    return (
        f"{cause} changes this force by {100 * (correction.force - 1):+.1f} %{stick_text} "
        "(half-space, exact)"
    )


def tensile_rim_width(tip: Indenter, nu: float, sizes: Sizes, dim: int) -> float:
    """Return the width of the rim under a sharp edge where a sticking contact would be tensile.

    The oscillating singularity of the bonded punch of radius a makes the contact pressure tensile
    within d = 2 a exp(-pi^2/ln(3 - 4 nu)) [length] of the edge: 2e-4 a at nu = 0, 1e-7 a at
    nu = 0.3. On elements that resolve this rim, a contact with stick and without tension has no
    equilibrium. The result is 0 if the elements do not resolve the rim.

    Parameters
    ----------
    tip : Indenter
        The tip.
    nu : float
        Poisson's ratio under the tip.
    sizes : Sizes
        The element sizes.
    dim : int
        Dimension of the mesh, 2 or 3.
    """
    if (
        getattr(tip, "edge_radius", 1.0) > 0
        or sizes.punch_edge is None
        or sizes.h_edge is None
        or nu >= 0.5
    ):
        return 0.0
    rim_width = 2 * sizes.punch_edge * exp(-(pi**2) / log(3 - 4 * nu))
    # Tetrahedra, whose facets cross the edge, resolve the rim only below this Poisson's ratio; at
    # nu = 0.1 they do.
    max_resolved_nu = 0.3
    is_resolved = sizes.h_edge <= MAX_RIM_ELEMENTS * rim_width or (
        dim == 3 and nu < max_resolved_nu
    )
    return rim_width if is_resolved else 0.0
