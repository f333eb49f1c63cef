"""Predictions by theory before a scene is solved: contact radius, force and pull-off force."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import inf, isfinite

from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.scene.half_space_formulas import half_space_depth, half_space_force
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.solution import SOLUTION_ERRORS


def prediction_of(setup: ProblemSetup) -> dict[str, float]:
    """Return the predictions of the reference theory and of closed formulas in the user's units.

    The keys are the contact radius `a`, the elastocapillary length of a body with surface tension,
    and the force at the largest depth, or `delta` at the largest force if forces are prescribed.
    For a body that yields they are estimates, with depth and force at the onset of yield if these
    are known. The value by theory has the key without a suffix; values by formulas for half-spaces
    and thin layers have keys with a suffix. For an adhesive tip only the JKR limit is given.
    Unknown quantities are left out.
    """
    physics = setup.physics
    delta = setup.max_depth
    tip = setup.relative_tip
    scales = physics.scales
    theory = setup.theory
    E_star = physics.contact_modulus
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
    if setup.surface_rise:
        # No elastic body at that depth has the force of a gel that swells against its tip.
        return {"a": setup.a * scales.length}
    if setup.yielding and delta > 0 and not physics.is_time_dependent:
        force = setup.yielding.force(delta)
        is_known = isfinite(force) and setup.yielding.force_is_known(delta)
        values[quantity] = (delta if largest is not None else force) if is_known else None
    elif physics.yields and not setup.yielding:
        # The elastic theory does not hold, and no estimate replaces it.
        pass
    elif setup.attraction:
        with suppress(*SOLUTION_ERRORS):
            contact = setup.jkr and setup.jkr.stable_equilibrium(
                *((delta,) if largest is None else (largest, inf))
            )
            values[f"{quantity}_JKR"] = getattr(contact, quantity, None)
    else:
        half_space_formula = None
        solution = setup.solution(delta) if delta > 0 else None
        # The value of a time-dependent body is a part of `TimePrediction`.
        if not physics.is_time_dependent:
            if largest is not None:
                values[quantity] = delta
            else:
                values[quantity] = solution.force if solution else None
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
    prediction = {"a": setup.a * scales.length}
    if setup.yielding and (onset := setup.yielding.onset):
        converted["onset_delta"] = onset.delta * scales.depth
        converted["onset_force"] = onset.force * scales.force / physics.mirror_multiplicity
    if elastocapillary_length := setup.elastocapillary_length:
        prediction["elastocapillary_length"] = elastocapillary_length * scales.length
    return prediction | converted


@dataclass(frozen=True)
class ExpectedAdhesion:
    """Quantities of an adhesive contact that are known before the scene is solved.

    Attributes
    ----------
    cohesive_zone : float
        Width of the cohesive zone outside the contact [length].
    elements : float
        Number of elements in the width of the cohesive zone.
    tabor : float or None
        Tabor number of a round tip.
    maugis_lambda : float or None
        Maugis' parameter lambda of a round tip.
    jkr_pull_off : float or None
        Pull-off force in the JKR limit on this body at small strain [force]; None without a theory.
    maugis_pull_off : float or None
        Pull-off force by Maugis-Dugdale on a half-space [force]; None for other bodies.
    """

    cohesive_zone: float
    elements: float
    tabor: float | None = None
    maugis_lambda: float | None = None
    jkr_pull_off: float | None = None
    maugis_pull_off: float | None = None

    @property
    def description(self) -> str:
        """Return the quantities with their meanings as text, for the reason of a choice."""
        numbers = ((symbol.meaning, getattr(self, symbol.name)) for symbol in ADHESION_SYMBOLS)
        return "; ".join(
            f"{meaning} {number:.4g}" for meaning, number in numbers if number is not None
        )
