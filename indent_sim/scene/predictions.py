"""Expected results: contact radius and force, what slip and adhesion make of them, whether the
pressure has a peak.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import exp, inf, isfinite, log, pi
from typing import Any

import numpy as np

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import Friction
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Sphere
from indent_sim.scene.problem_setup import (
    DiffusionTimes,
    ProblemDefinition,
    ProblemSetup,
    largest_diffusivity,
    remaining_modulus_fraction,
)
from indent_sim.scene.reference_theory import (
    half_space_depth,
    half_space_force,
    relaxed_law,
    undrained_law,
)
from indent_sim.theory import no_slip
from indent_sim.theory.no_slip import FrictionCorrection
from indent_sim.theory.poroelasticity import paraboloid_fraction_remaining
from indent_sim.theory.solution import SOLUTION_ERRORS

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
NEAR_LIMIT_PERCENT = 2.0  # per cent from an elastic limit: up to this a body is said to be one
# contact radii in a height, up to which what is left of a paraboloid's force is that of the table
MAX_RADIUS_RATIO = 0.6
RAMP_POINTS = 1000  # of the integral over a ramp
EXTENT_TOLERANCE = 1e-9  # of a length
# edge elements in the rim that would pull, at most: Newton goes round in a circle from 5 on,
# measured
MAX_RIM_ELEMENTS = 6.0
STICK_FRICTION = (
    5.0  # the friction that stands for stick then: 0.05 % of the force less, measured at nu = 0
)
# Poisson's ratio from which on the facets of a solid, which cross the edge, do not see it: at 0.1
# they do
MIN_SAFE_NU = 0.3


def prediction_of(setup: ProblemSetup) -> dict[str, float]:
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and
    by the formulas for the half-space and for films, or of a tip that adheres by JKR, in the
    user's units.
    """
    physics = setup.physics
    delta = setup.max_depth
    tip = setup.relative_tip
    scales = physics.scales
    theory = setup.theory
    E_star = physics.material.E_star
    largest = (
        None
        if physics.largest_force is None
        else physics.mirror_multiplicity * physics.largest_force
    )
    quantity, unit = (
        ("force", scales.force / physics.mirror_multiplicity)
        if largest is None
        else ("delta", scales.depth)
    )
    values: dict[str, float | None] = {}
    if (
        setup.surface_rise
    ):  # no elastic body at that depth has the force of a gel that rises against its tip
        return {"a": setup.a * scales.length}
    if setup.attraction:
        with suppress(*SOLUTION_ERRORS):
            contact = setup.jkr and setup.jkr.stable_equilibrium(
                *((delta,) if largest is None else (largest, inf))
            )
            values[f"{quantity}_JKR"] = getattr(contact, quantity, None)
    else:
        half_space_formula = None
        solution = setup.solution(delta) if delta > 0 else None
        if not physics.is_time_dependent:  # else `InTime` says it
            values[quantity] = (
                delta if largest is not None else solution.force if solution else None
            )
        if scales.dim == 3:
            half_space_formula = (
                half_space_force(tip, delta, E_star)
                if largest is None
                else half_space_depth(tip, largest, E_star)
            )
        values[f"{quantity}_half_space"] = half_space_formula[1] if half_space_formula else None
        if theory and delta > 0:
            values |= {
                f"{quantity}_{name}": theory.formula_value(name, delta, largest)
                for name in theory.formulas
            }
    converted = {name: value * unit for name, value in values.items() if value is not None}
    elastocapillary_length = setup.elastocapillary_length
    return (
        {"a": setup.a * scales.length}
        | (
            {"elastocapillary_length": elastocapillary_length * scales.length}
            if elastocapillary_length
            else {}
        )
        | converted
    )


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


@dataclass(frozen=True)
class TimePrediction:
    """What is known of a scene that is followed in time before it is, in the user's units.

    way: curve | steps, by which method and why. D [length^2/time]: of the fluid, None without.
    times [time]: what it needs through the contact (a^2/D), the body (H^2/D) and an element
    (h_contact^2/D), the longest `relaxation`, the `way_in` to the largest value, and the whole
    `history`. stages: equilibria of a run that cuts no step. limits: the largest force, or the
    depth of the largest force prescribed, `undrained` and `drained`, and where something relaxes
    `unrelaxed` and `relaxed`; None where theory does not know it. about: the force between them
    that is expected. words: the cheapest elastic model of the scene, if there is one.
    """

    way: str
    method: str
    why: str
    D: float | None
    times: dict[str, float]
    stages: int | None
    limits: dict[str, float | None]
    about: float | None
    words: str

    @property
    def report(self) -> dict[str, Any]:
        """As run.json has it."""
        return {name: value for name, value in vars(self).items() if name != "about"}

    def prediction(self, quantity: str) -> dict[str, float]:
        """Its limits as predictions of what is asked for, force or delta."""
        limit_values = {
            f"{quantity}_{name}": value for name, value in self.limits.items() if value is not None
        }
        return ({} if self.about is None else {quantity: self.about}) | limit_values


def time_prediction(
    setup: ProblemSetup, physics: ProblemDefinition, h_contact: float | None, why: str
) -> TimePrediction | None:
    """What is known of the scene in time; None where no time passes. h_contact [length] of a mesh;
    why: of its way.
    """
    history = setup.history
    if history is None:
        return None
    times = {"way_in": history.loading_duration, "history": history.duration}
    D = None
    if physics.permeable_regions and h_contact is not None:
        D = largest_diffusivity(physics) * physics.scales.length**2
        diffusion_times = DiffusionTimes.compute(setup, physics, h_contact)
        times |= {
            "contact": diffusion_times.contact,
            "height": diffusion_times.height,
            "element": diffusion_times.element,
        }
        times = {name: t for name, t in times.items() if isfinite(t)}
    if relaxations := _relaxation_times(setup, physics):
        times["relaxation"] = max(relaxations)
    transitions = [
        candidate
        for find in (_drainage_transition, _relaxation_transition)
        if (candidate := find(setup, physics))
    ]
    limits = {
        name: value
        for transition in transitions
        for name, value in transition.limits(setup).items()
    }
    description = "; ".join(transition.description(times) for transition in transitions)
    expected_force = transitions[0].expected_force(setup) if len(transitions) == 1 else None
    evaluation, stages = (
        ("steps", _equilibrium_count(physics)) if physics.path.times else ("curve", None)
    )
    return TimePrediction(
        evaluation,
        _time_method(setup, physics),
        why,
        D,
        times,
        stages,
        limits,
        expected_force,
        description,
    )


def _equilibrium_count(physics: ProblemDefinition) -> int:
    """Equilibria of a path in time: two of each step in which fluid flows, one of a jump."""
    t = 0.0
    count = 0
    for step in range(1, len(physics.path.values) + 1):
        for _, end in physics.path.segment(step):
            count += 2 if physics.permeable_regions and end > t else 1
            t = end
    return count


def _time_method(setup: ProblemSetup, physics: ProblemDefinition) -> str:
    """By what a scene goes from one row of its history to the next."""
    if not physics.path.times:
        return (
            "time steps"
            if setup.uses_time_stepping
            else "quadrature"
            if setup.relaxation
            else "equilibria"
        )
    if physics.permeable_regions:
        return "SDIRK2"
    return "exponentials" if physics.relaxing_regions else "equilibria"


def _relaxation_times(setup: ProblemSetup, physics: ProblemDefinition) -> list[float]:
    """The times of all terms that relax."""
    laws = [setup.relaxation, *(region.material.relaxation for region in physics.relaxing_regions)]
    return [time for law in laws if law for _, time in law.prony or ()]


@dataclass(frozen=True)
class _LimitTransition:
    """What a body passes from one elastic limit to another: their names with the law of each, its
    slowest time by name, what is left of the difference at the end of the way in, and at the end
    of the history; None where nobody knows.
    """

    first_limit: tuple[str, Callable[[Material], Material]]
    last_limit: tuple[str, Callable[[Material], Material]]
    slowest_time: tuple[str, str]
    remaining_fraction: float | None
    final_fraction: float | None
    force_ratio: float  # of the first force to the last one, at a depth

    def limits(self, setup: ProblemSetup) -> dict[str, float | None]:
        """The force at the deepest point, or the depth of the largest force [user's units], of
        both.
        """
        return {name: _limit_value(setup, law) for name, law in (self.first_limit, self.last_limit)}

    def expected_force(self, setup: ProblemSetup) -> float | None:
        """The force to expect at the end of the way in [user's units]."""
        first, last = self.limits(setup).values()
        if None in (first, last, self.remaining_fraction) or setup.physics.path.control == "force":
            return None
        return last + self.remaining_fraction * (first - last)  # type: ignore[operator]

    def description(self, times: Mapping[str, float]) -> str:
        """The cheapest elastic model, at the end of the way in and of the history."""
        (name, time_text) = self.slowest_time
        t = times["way_in"]
        time_ratio_text = f", {t / times[name]:.2g} of {time_text}" if times.get(name) else ""
        text = f"the way in takes {t:.3g}{time_ratio_text}: {self._nearest_limit_text(self.remaining_fraction)}"
        if self.final_fraction is not None and self.final_fraction != self.remaining_fraction:
            text += f"; at the end of the history {self._nearest_limit_text(self.final_fraction)}"
        return text

    def _nearest_limit_text(self, remaining_fraction: float | None) -> str:
        if remaining_fraction is None:
            return "`require` solves which elastic body that is near"
        percent_below = 100 * (1 - 1 / self.force_ratio) * (1 - remaining_fraction)
        percent_above = 100 * (self.force_ratio - 1) * remaining_fraction
        if min(percent_below, percent_above) > NEAR_LIMIT_PERCENT:
            limits_text = (
                f"{_percent_text(percent_below)} below the {self.first_limit[0]} force, {_percent_text(percent_above)} above the "
                f"{self.last_limit[0]}"
            )
            return f"neither, about {limits_text}"
        name, percent = (
            (self.first_limit[0], percent_below)
            if percent_below < percent_above
            else (self.last_limit[0], percent_above)
        )
        return f"{name}, within about {percent:.1g} %"


def _percent_text(change: float) -> str:
    return f"{change:.2g} %" if change < 99.5 else f"{change:.0f} %"


def _drainage_transition(
    setup: ProblemSetup, physics: ProblemDefinition
) -> _LimitTransition | None:
    """From undrained to drained, by what is left under a paraboloid on a layer (`paraboloid_fraction_remaining`)."""
    if not physics.permeable_regions or setup.surface_rise:
        return None
    assert setup.history is not None
    touched_material = physics.material
    tip = physics.drainage.tip
    power = profile_exponent(physics.indenter)
    is_single_solid = len(physics.domain.regions) == 1 and physics.scales.dim == 3
    has_known_decay = (
        power in (1.0, 2.0)
        and is_single_solid
        and setup.a <= MAX_RADIUS_RATIO * physics.body.height
    )
    remaining_fraction = final_fraction = None
    if (
        has_known_decay
        and physics.drainage.surface == "drained"
        and (tip == "sealed" or tip == "drained")
    ):
        diffusion_rate = largest_diffusivity(physics) / setup.a**2
        remaining_fraction = paraboloid_fraction_remaining(
            diffusion_rate * setup.history.loading_duration, tip, "ramp"
        )
        final_fraction = min(
            remaining_fraction,
            paraboloid_fraction_remaining(
                diffusion_rate * setup.history.hold_duration, tip, "step"
            ),
        )
    undrained_material = undrained_law(touched_material)
    laws = ("undrained", undrained_law), ("drained", lambda material: replace(material, flow=None))
    return _LimitTransition(
        *laws,
        ("contact", "a^2/D"),
        remaining_fraction,
        final_fraction,
        undrained_material.E_star / touched_material.E_star,
    )


def _relaxation_transition(
    setup: ProblemSetup, physics: ProblemDefinition
) -> _LimitTransition | None:
    """From unrelaxed to relaxed, by what is left under a tip whose force grows as depth^1.5 in an
    incompressible half-space.
    """
    law = setup.relaxation or next(
        (region.material.relaxation for region in physics.relaxing_regions), None
    )
    if law is None or setup.history is None:
        return None
    history = setup.history
    least_modulus = remaining_modulus_fraction(law, setup.history)
    terms = law.prony or ()
    remaining_fraction = final_fraction = None
    if total := sum(fraction for fraction, _ in terms):
        term_fractions = [
            fraction / total * _ramp_fraction(history.loading_duration / time)
            for fraction, time in terms
        ]
        remaining_fraction = sum(term_fractions)
        final_fraction = sum(
            term_fraction * exp(-history.hold_duration / time)
            for term_fraction, (_, time) in zip(term_fractions, terms, strict=True)
        )
    touched_material = physics.material
    relaxed_material = partial(relaxed_law, left=least_modulus)
    ratio = (
        1 / least_modulus
        if setup.relaxation
        else touched_material.E_star / relaxed_material(touched_material).E_star
    )
    laws = ("unrelaxed", lambda material: material), ("relaxed", relaxed_material)
    return _LimitTransition(
        *laws, ("relaxation", "the longest relaxation"), remaining_fraction, final_fraction, ratio
    )


def _ramp_fraction(x: float) -> float:
    """int_0^1 exp(-x (1 - s)) d(s^1.5): what a term leaves of the force at the end of a ramp of x
    times its time.
    """
    s = (np.arange(RAMP_POINTS) + 0.5) / RAMP_POINTS
    return float(np.exp(-x * (1 - s)) @ np.diff(np.linspace(0, 1, RAMP_POINTS + 1) ** 1.5))


def _limit_value(setup: ProblemSetup, change: Callable[[Material], Material]) -> float | None:
    """The force at the deepest point, or the depth of the largest force, of a body whose laws are
    changed so.
    """
    assert setup.history is not None
    theory = setup.theory_for_materials(change)
    scales = setup.physics.scales
    if theory is None or setup.history.largest_value <= 0:
        return None
    if setup.history.control == "force":
        depth = theory.depth_of_force(setup.history.largest_value, setup.physics.body.height)
        return None if depth is None else depth * scales.depth
    solution = theory.solution_at_depth(setup.max_depth)
    return solution.force * scales.force if solution else None


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


@dataclass(frozen=True)
class ExpectedAdhesion:
    """What is known of a tip that adheres before it does: the cohesive zone beside its contact
    [length], the elements in it, a round tip's Tabor number and Maugis' lambda, and the largest
    pull [force], None where nobody knows it: without range (JKR) on a linear body like this one,
    and by Maugis-Dugdale on a half-space, if that is alike.
    """

    cohesive_zone: float
    elements: float
    tabor: float | None = None
    maugis_lambda: float | None = None
    jkr_pull_off: float | None = None
    maugis_pull_off: float | None = None

    @property
    def description(self) -> str:
        """The same as the reason of a choice."""
        numbers = ((symbol.meaning, getattr(self, symbol.name)) for symbol in ADHESION_SYMBOLS)
        return "; ".join(
            f"{meaning} {number:.4g}" for meaning, number in numbers if number is not None
        )


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
    return f"{cause} changes this force by {100 * (correction.force - 1):+.1f} %{stick_text} (half-space, exact)"


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


def infinite_pressure_reason(tip: Indenter, a: float) -> str:
    """Why the pressure of a contact of radius a [length] has no largest value; empty where it has
    one.
    """
    where = next((r for r, width in tip.slope_discontinuities() if width == 0 and r <= a), None)
    return (
        ""
        if where is None
        else f"the pressure at the tip's sharp {'edge' if where else 'apex'} is infinite"
    )


def missing_peak_reason(physics: ProblemDefinition, sizes: Sizes, a: float) -> str:
    """Why no mesh knows the largest pressure of a contact of radius a [length]; empty where one
    does.

    Under a sharp apex, corner or edge it is infinite, and what a mesh finds grows as its elements
    shrink, as it does while they are larger than the arc that rounds one.
    """
    body = physics.body
    tip = physics.indenter
    for r, width in tip.slope_discontinuities() if a > 0 else []:
        element_size = float(sizes.size_at(np.array(r), np.array(0.0)))
        is_touched = r <= a + element_size or (
            tip.height(r, 0.0) <= 0 and not isinstance(body, SphericalBody)
        )
        if (
            is_touched
            and width < element_size
            and r < body.max_lateral_extent(physics.center) * (1 - EXTENT_TOLERANCE)
        ):
            where = "apex" if r == 0 else "edge"
            kind = f"sharp {where}" if width == 0 else f"{where} (rounded by less than an element)"
            return (
                f"the pressure at the tip's {kind} is the mesh's own: it grows as elements shrink"
            )
    return ""
