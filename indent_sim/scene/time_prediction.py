"""Time prediction: diffusion times, relaxation times and elastic limits of a scene with history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import exp, isfinite
from typing import Any

import numpy as np

from indent_sim.model.materials import Material
from indent_sim.scene.diffusion_times import DiffusionTimes
from indent_sim.scene.elastic_limit_laws import relaxed_law, undrained_law
from indent_sim.scene.no_slip_effect import profile_exponent
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.scene.problem_definition import ProblemDefinition, largest_diffusivity
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.poroelasticity import paraboloid_fraction_remaining

NEAR_LIMIT_PERCENT = 2.0  # per cent from an elastic limit: up to this a body is said to be one

# contact radii in a height, up to which what is left of a paraboloid's force is that of the table
MAX_RADIUS_RATIO = 0.6

RAMP_POINTS = 1000  # of the integral over a ramp


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
        limit_text = self._nearest_limit_text(self.remaining_fraction)
        text = f"the way in takes {t:.3g}{time_ratio_text}: {limit_text}"
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
                f"{_percent_text(percent_below)} below the {self.first_limit[0]} force, "
                f"{_percent_text(percent_above)} above the "
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
    """Transition from undrained to drained, by `paraboloid_fraction_remaining`."""
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
    relaxed_material = partial(relaxed_law, fraction_remaining=least_modulus)
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
