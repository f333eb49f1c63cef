"""Diffusion times, relaxation times and elastic limiting cases of a scene with a history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import exp, isfinite
from typing import Any

import numpy as np

from indent_sim.model.materials import Material
from indent_sim.scene.diffusion_times import DiffusionTimes
from indent_sim.scene.limiting_elastic_laws import relaxed_law, undrained_law
from indent_sim.scene.no_slip_effect import profile_exponent
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.scene.problem_definition import ProblemDefinition, largest_diffusivity
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.poroelasticity import paraboloid_fraction_remaining


@dataclass(frozen=True)
class TimePrediction:
    """Quantities of a time-dependent scene that are known before it is solved, in the user's units.

    Attributes
    ----------
    way : str
        Solution procedure: "steps" for time steps, "curve" for an evaluation on the elastic load
        curve.
    method : str
        Method of the time integration.
    why : str
        Reason for the solution procedure.
    D : float or None
        Largest diffusivity [length^2/time]; None without a fluid.
    times : dict of str to float
        Durations [time]: diffusion through the contact (`contact`, a^2/D), the body (`height`,
        H^2/D) and an element (`element`, h_contact^2/D), the longest relaxation time
        (`relaxation`), the loading to the largest value (`way_in`) and the whole history
        (`history`).
    stages : int or None
        Number of equilibria of a run without cutbacks; None on the elastic load curve.
    limits : dict of str to float or None
        Largest force, or depth at the largest prescribed force, in the elastic limiting cases
        `undrained` and `drained`, or `unrelaxed` and `relaxed`; None without a theory.
    expected : float or None
        Expected value of the quantity in `limits`, between the two limiting cases.
    words : str
        Sentence that names the nearest elastic limiting case at the end of loading and of the
        history; empty without limits.
    """

    way: str
    method: str
    why: str
    D: float | None
    times: dict[str, float]
    stages: int | None
    limits: dict[str, float | None]
    expected: float | None
    words: str

    @property
    def report(self) -> dict[str, Any]:
        """Return the entries for run.json."""
        return {name: value for name, value in vars(self).items() if name != "expected"}

    def prediction(self, quantity: str) -> dict[str, float]:
        """Return the expected value of "force" or "delta" and its values in the limiting cases."""
        limit_values = {
            f"{quantity}_{name}": value for name, value in self.limits.items() if value is not None
        }
        return ({} if self.expected is None else {quantity: self.expected}) | limit_values


def time_prediction(
    setup: ProblemSetup, physics: ProblemDefinition, h_contact: float | None, why: str
) -> TimePrediction | None:
    """Return characteristic times, elastic limits and solution procedure; None without a history.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    physics : ProblemDefinition
        The problem along its history, with its time steps if it has any.
    h_contact : float or None
        Element size at the contact [length]; None without a mesh.
    why : str
        Reason for time steps, or for the evaluation on the elastic load curve.
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
        transition
        for find_transition in (_drainage_transition, _relaxation_transition)
        if (transition := find_transition(setup, physics))
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
        physics.time_integration if physics.path.times else str(setup.curve_method),
        why,
        D,
        times,
        stages,
        limits,
        expected_force,
        description,
    )


def _equilibrium_count(physics: ProblemDefinition) -> int:
    """Return the number of equilibria that the time steps of a history need.

    A time step with fluid flow has two stages; an instantaneous increment has one stage.
    """
    t = 0.0
    count = 0
    for step in range(1, len(physics.path.values) + 1):
        for _, end in physics.path.segment(step):
            count += 2 if physics.permeable_regions and end > t else 1
            t = end
    return count


def _relaxation_times(setup: ProblemSetup, physics: ProblemDefinition) -> list[float]:
    """Return the relaxation times of all Prony series [time]."""
    laws = [setup.relaxation, *(region.material.relaxation for region in physics.relaxing_regions)]
    return [time for law in laws if law for _, time in law.prony or ()]


@dataclass(frozen=True)
class _LimitTransition:
    """Transition of a body from its first to its last elastic limiting case.

    Attributes
    ----------
    first_limit, last_limit
        Pair of the name of the limit and a function that maps a material to its elastic law in this
        limit.
    slowest_time
        Pair of the key of the slowest process in `TimePrediction.times` and its name in words.
    remaining_fraction, final_fraction
        Fraction (F - F_last)/(F_first - F_last) at the end of loading, and at the end of the
        history; None if unknown.
    force_ratio
        Force in the first limit divided by the force in the last limit, at the same depth.
    """

    first_limit: tuple[str, Callable[[Material], Material]]
    last_limit: tuple[str, Callable[[Material], Material]]
    slowest_time: tuple[str, str]
    remaining_fraction: float | None
    final_fraction: float | None
    force_ratio: float

    def limits(self, setup: ProblemSetup) -> dict[str, float | None]:
        """Return force (or depth if forces are prescribed) in both limits [user's units]."""
        return {name: _limit_value(setup, law) for name, law in (self.first_limit, self.last_limit)}

    def expected_force(self, setup: ProblemSetup) -> float | None:
        """Return the expected force at the end of loading [user's units]; None if unknown."""
        first, last = self.limits(setup).values()
        if None in (first, last, self.remaining_fraction) or setup.physics.path.control == "force":
            return None
        return last + self.remaining_fraction * (first - last)  # type: ignore[operator]

    def description(self, times: Mapping[str, float]) -> str:
        """Return text on the nearest limiting case at the end of loading and of the history."""
        (name, time_text) = self.slowest_time
        t = times["way_in"]
        time_ratio_text = f", {t / times[name]:.2g} of {time_text}" if times.get(name) else ""
        limit_text = self._nearest_limit_text(self.remaining_fraction)
        text = f"loading takes {t:.3g}{time_ratio_text}: {limit_text}"
        if self.final_fraction is not None and self.final_fraction != self.remaining_fraction:
            text += f"; at the end of the history {self._nearest_limit_text(self.final_fraction)}"
        return text

    def _nearest_limit_text(self, remaining_fraction: float | None) -> str:
        """Return as text the nearest limiting case, or how far the force is from both cases."""
        if remaining_fraction is None:
            return "`indent-sim require` computes which elastic limiting case is near"
        percent_below = 100 * (1 - 1 / self.force_ratio) * (1 - remaining_fraction)
        percent_above = 100 * (self.force_ratio - 1) * remaining_fraction
        # Difference up to which a body counts as being in a limiting case [%].
        near_limit_percent = 2.0
        if min(percent_below, percent_above) > near_limit_percent:
            limits_text = (
                f"about {_percent_text(percent_below)} below the {self.first_limit[0]} force and "
                f"{_percent_text(percent_above)} above the {self.last_limit[0]} force"
            )
            return f"close to neither limit: {limits_text}"
        name, percent = (
            (self.first_limit[0], percent_below)
            if percent_below < percent_above
            else (self.last_limit[0], percent_above)
        )
        return f"{name}, within about {float(f'{percent:.1g}'):g} %"


def _percent_text(change: float) -> str:
    """Return a relative change in per cent: two significant digits, or an integer above 99."""
    return f"{change:.2g} %" if change < 99.5 else f"{change:.0f} %"


def _drainage_transition(
    setup: ProblemSetup, physics: ProblemDefinition
) -> _LimitTransition | None:
    """Return the transition from undrained to drained; None without a fluid that drains.

    The force decays from the undrained to the drained limit like that of a paraboloid on a
    half-space with a drained surface (`paraboloid_fraction_remaining`). For other tips, bodies and
    drainage the decay is unknown.
    """
    if not physics.permeable_regions or setup.surface_rise:
        return None
    assert setup.history is not None
    material = physics.material
    tip = physics.drainage.tip
    power = profile_exponent(physics.indenter)
    is_single_solid = len(physics.domain.regions) == 1 and physics.scales.dim == 3
    # Contact radius over height up to which the tabulated decay of the force on a half-space is
    # used.
    max_radius_ratio = 0.6
    has_known_decay = (
        power in (1.0, 2.0)
        and is_single_solid
        and setup.a <= max_radius_ratio * physics.body.height
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
    undrained_material = undrained_law(material)
    laws = ("undrained", undrained_law), ("drained", lambda material: replace(material, flow=None))
    return _LimitTransition(
        *laws,
        ("contact", "a^2/D"),
        remaining_fraction,
        final_fraction,
        undrained_material.E_star / material.E_star,
    )


def _relaxation_transition(
    setup: ProblemSetup, physics: ProblemDefinition
) -> _LimitTransition | None:
    """Return the transition from unrelaxed to relaxed; None without relaxation.

    The depth is assumed to grow linearly to its largest value, and the instantaneous force as
    depth^1.5 (paraboloid on an incompressible half-space).
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
    material = physics.material
    relaxed_material = partial(relaxed_law, fraction_remaining=least_modulus)
    ratio = (
        1 / least_modulus
        if setup.relaxation
        else material.E_star / relaxed_material(material).E_star
    )
    laws = ("unrelaxed", lambda material: material), ("relaxed", relaxed_material)
    return _LimitTransition(
        *laws,
        ("relaxation", "the longest relaxation time"),
        remaining_fraction,
        final_fraction,
        ratio,
    )


def _ramp_fraction(x: float) -> float:
    """Return int_0^1 exp(-x (1 - s)) d(s^1.5) for a ramp that lasts x relaxation times.

    The integral is the fraction of a Prony term's force that remains at the end of the ramp.
    """
    # Number of points of the midpoint rule for the integral over a ramp.
    ramp_points = 1000
    s = (np.arange(ramp_points) + 0.5) / ramp_points
    return float(np.exp(-x * (1 - s)) @ np.diff(np.linspace(0, 1, ramp_points + 1) ** 1.5))


def _limit_value(setup: ProblemSetup, law: Callable[[Material], Material]) -> float | None:
    """Return the largest force, or the depth at the largest force, in a limiting case.

    The value is in the user's units, or None if no theory exists. The function `law` maps a
    material to its elastic law in this limit.
    """
    assert setup.history is not None
    theory = setup.theory_for_materials(law)
    scales = setup.physics.scales
    if theory is None or setup.history.largest_value <= 0:
        return None
    if setup.history.control == "force":
        depth = theory.depth_of_force(setup.history.largest_value, setup.physics.body.height)
        return None if depth is None else depth * scales.depth
    solution = theory.solution_at_depth(setup.max_depth)
    return solution.force * scales.force if solution else None
