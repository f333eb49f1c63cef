"""Effect of no slip and of friction on the force, known before the scene is solved."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, log, pi

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import Friction
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory import no_slip
from indent_sim.theory.no_slip import FrictionCorrection

PROFILE_EXPONENTS: dict[type, float] = {
    Paraboloid: 2.0,
    Sphere: 2.0,
    Cone: 1.0,
    FlatPunch: inf,
}  # of the tip's profile

MIN_WALL_DISTANCE = (
    2.0  # thicknesses, or contact radii, to the side walls of a layer that feels them little
)

NEGLIGIBLE_PERCENT = 1.0  # per cent that stick changes: less is not worth a sentence

# edge elements in the rim that would pull, at most: Newton goes round in a circle from 5 on,
# measured
MAX_RIM_ELEMENTS = 6.0

STICK_FRICTION = (
    5.0  # the friction that stands for stick then: 0.05 % of the force less, measured at nu = 0
)

# Poisson's ratio from which on the facets of a solid, which cross the edge, do not see it: at 0.1
# they do
MIN_SAFE_NU = 0.3


@dataclass(frozen=True)
class NoSlipEffect:
    """What pure stick instead of no friction would change the deepest force by [per cent]: between
    low and high, and the number itself where it is known; None where only the like at small
    strain is known to tell. source says from what.
    """

    percent: float | None
    low: float | None
    high: float | None
    source: str

    @property
    def is_noticeable(self) -> bool:
        """Whether it may be worth a sentence."""
        return (
            self.low is None
            or self.high is None
            or max(abs(self.low), abs(self.high)) >= NEGLIGIBLE_PERCENT
        )

    @property
    def remark(self) -> str:
        """The sentence where it may be worth one."""
        return self.sentence if self.is_noticeable else ""

    @property
    def sentence(self) -> str:
        """The same as a sentence."""
        if self.low is None or self.high is None:
            return (
                f"pure stick instead of no friction may change this force noticeably: {self.source}"
            )
        low = f"{self.low:+z.1f}"
        high = f"{self.high:+z.1f}"
        between = f"between {low} and {high}" if low != high else low
        change = f"{between} % ({self.source})"
        if self.percent is not None:
            change = (
                f"{self.percent:+z.1f} % ({f'{between}; ' if low != high else ''}{self.source})"
            )
        return f"pure stick instead of no friction would change this force by {change}"


def no_slip_effect(
    setup: ProblemSetup, physics: ProblemDefinition, linear: str = "direct"
) -> NoSlipEffect | None:
    """What no slip would change at the deepest contact: exactly on a half-space, a range of the map
    of bonded layers elsewhere; None where neither knows the scene, or where nothing slips
    without friction as it is.

    At finite strain, or with the gap at the deformed point, there is no number, and only a sentence
    where the like of it at small strain tells. physics, linear: the scene's own, and how error bars
    would solve its linear systems.
    """
    effect = (
        None if physics.is_path_dependent or setup.max_depth <= 0 else _small_strain_effect(setup)
    )
    if effect is None or physics.is_linear:
        return effect
    is_solvable = not physics.domain.pins and linear != "iterative"
    source = (
        "it could at small strain, and here the change may be "
        f"larger{'; --error-bars solves it' * is_solvable}"
    )
    return NoSlipEffect(None, None, None, source) if effect.is_noticeable else None


def _small_strain_effect(setup: ProblemSetup) -> NoSlipEffect | None:
    physics = setup.physics
    a = setup.a
    domain = physics.domain
    tip = physics.indenter
    power = profile_exponent(physics.indenter)
    if (
        power is None
        or physics.surface_tension
        or not _is_homogeneous_isotropic(domain)
        or domain.kinematics.name == "plane_strain"
        or a <= 0
    ):
        return None
    nu = physics.material.constants.nu
    rim = physics.body.lateral_extent(physics.center)
    if setup.is_half_space:
        percent = 100 * (no_slip.force_ratio(nu, power) - 1)
        return NoSlipEffect(
            percent,
            percent,
            percent,
            f"half-space, exact{' for the paraboloid' * isinstance(tip, Sphere)}",
        )
    if domain.supports.get("base") != "fixed" or rim < MIN_WALL_DISTANCE * max(domain.height, a):
        return None
    ratios = no_slip.layer_force_range(nu, a / domain.height, power)
    if ratios is None:
        return None
    low, high = (100 * (ratio - 1) for ratio in ratios)
    return NoSlipEffect(None, low, high, "map of bonded layers at small strain")


def _is_homogeneous_isotropic(domain: ModelDomain) -> bool:
    return len(domain.regions) == 1 and domain.regions[0].material.is_isotropic


def profile_exponent(tip: Indenter) -> float | None:
    """n of a profile f = B r^n, infinite for a punch; None for a tip that has another, or a rounded
    apex or edge.
    """
    is_sharp = not any(getattr(tip, name, 0.0) > 0 for name in ("tip_radius", "edge_radius"))
    return PROFILE_EXPONENTS.get(type(tip)) if is_sharp else None


def friction_correction(
    setup: ProblemSetup, physics: ProblemDefinition, friction: Friction
) -> FrictionCorrection | None:
    """What friction makes of the deepest contact of a half-space; None where that is not known: for
    other tips, other matter, a path that turns back on its way there, or more friction than the
    theory bears.
    """
    values = physics.path.values
    power = profile_exponent(setup.physics.indenter)
    if not (
        setup.is_half_space and physics.is_linear and setup.max_depth > 0 and physics.has_friction
    ):
        return None
    turns_back = any(
        later < earlier for earlier, later in pairwise(values[: values.index(max(values)) + 1])
    )
    if power is None or not _is_homogeneous_isotropic(physics.domain) or turns_back:
        return None
    from indent_sim.theory import (
        friction as coulomb_friction,
    )  # with scipy's functions, which no other scene needs

    with suppress(ValueError):
        return coulomb_friction.friction_correction(physics.material.constants.nu, friction, power)
    return None


def friction_sentence(physics: ProblemDefinition, correction: FrictionCorrection) -> str:
    """The same as a sentence."""
    cause = "no slip"
    stick_text = ""
    if correction.sticks < 1.0:
        cause = f"friction {physics.contact.friction:g}"
        stick_text = f", and the surface sticks within {correction.sticks:.2g} of its radius"
    return (
        f"{cause} changes this force by {100 * (correction.force - 1):+.1f} %{stick_text} "
        "(half-space, exact)"
    )


def tensile_rim_width(tip: Indenter, nu: float, sizes: Sizes, dim: int) -> float:
    """Width d = 2 a exp(-pi^2/ln(3 - 4 nu)) of the rim under a sharp edge in which a stuck surface
    would pull [length].

    2e-4 a at nu = 0, 1e-7 a at 0.3; 0 where the elements do not see it. Those that do have no
    equilibrium that both sticks without a bound and pushes. dim: of the mesh.
    """
    if (
        getattr(tip, "edge_radius", 1.0) > 0
        or sizes.punch_edge is None
        or sizes.h_edge is None
        or nu >= 0.5
    ):
        return 0.0
    rim = 2 * sizes.punch_edge * exp(-(pi**2) / log(3 - 4 * nu))
    return rim if sizes.h_edge <= MAX_RIM_ELEMENTS * rim or (dim == 3 and nu < MIN_SAFE_NU) else 0.0
