"""Expected results: contact radius and force, what slip and adhesion make of them, whether the
pressure has a peak.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import inf

from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.scene.half_space_formulas import half_space_depth, half_space_force
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.theory.solution import SOLUTION_ERRORS


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
