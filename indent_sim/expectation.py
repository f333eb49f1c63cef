"""What to expect of a scene before it is run: forces from theory, and where the model asked for is a poor one."""

from __future__ import annotations

from math import pi

from indent_sim.model import stability
from indent_sim.model.body import Body
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.model.indenters import Indenter, Paraboloid, Profile, Sphere
from indent_sim.model.materials import LOCKING, Material
from indent_sim.oracle import Oracle, half_space_force
from indent_sim.state import Scales


def prediction_of(theory: Oracle | None, tip: Indenter, material: Material, delta: float, a: float, scales: Scales
                  ) -> dict[str, float]:  # fmt: skip
    """Expected contact radius, and force by layer theory and by the half-space formula, in the user's units."""
    prediction = {"a": a * scales.length}
    solution = theory.at(delta) if theory and delta > 0 else None
    if solution:
        prediction["force"] = solution.force * scales.force
    closed = half_space_force(tip, delta, material.E_star) if scales.dim == 3 else None
    if closed:
        prediction["force_half_space"] = closed[1] * scales.force
    return prediction


def warnings_of(body: Body, material: Material, tip: Indenter, center: tuple[float, ...], delta: float, a: float,
                theory: Oracle | None, formulation: str) -> list[str]:  # fmt: skip
    """Where the scene needs more than was asked for, a sentence each."""
    if delta <= 0:
        return ["the tip never reaches the body: every depth is <= 0"]
    warnings = []
    R = tip.R if isinstance(tip, (Paraboloid, Sphere)) else None
    if material.small_strain and R and 0.2 * a / R > 0.05:
        warnings.append(f"strains near 0.2 a/R = {0.2 * a / R:.2g}: small strain is no longer a good model")
    if isinstance(tip, Paraboloid) and delta > 0.1 * tip.R:
        warnings.append("depth beyond R/10: a sphere of this R would feel at least 1 % less than the paraboloid")
    if material.small_strain and delta > 0.1 * body.height:
        warnings.append(f"depth is {delta / body.height:.0%} of the thickness: small strain is no longer a good model")
    if isinstance(tip, Profile) and tip.radius_at(delta) >= tip.points[-1][0]:
        warnings.append("deeper than the profile is high: where it ends the contact may end like under a punch")
    if a > 0.8 * body.rim_distance(center):
        warnings.append("the contact comes close to the edge of the body")
    if formulation == "displacement" and material.constants[1] >= LOCKING:
        warnings.append(
            f"nu = {material.constants[1]:g} with displacement elements: pressures oscillate, forces are too high"
        )
    warnings += stability.doubts(material, stability.reach(tip, a, delta, body.height))
    return warnings + _half_space_warning(tip, material, delta, theory, body)


def contact_warnings(contact: ContactLaw, unit: float, elements: float) -> list[str]:
    """What a stiffness given in the config does to the answer; unit = E*/h_contact, elements in the contact radius."""
    if isinstance(contact, (Penalty, Nitsche)) and contact.stiffness > 1e3 * unit:
        return ["a stiffness beyond 1000 E*/h_contact: the pressures oscillate"]
    soft = 1.5 / pi * unit / (contact.stiffness * elements) if isinstance(contact, Penalty) else 0.0
    if soft > 0.3:
        return ["penalty: at this epsilon_n the tip sinks into the body"]
    return [f"penalty: the force is about {soft:.0%} too low at this epsilon_n"] if soft > 0.01 else []


def _half_space_warning(
    tip: Indenter, material: Material, delta: float, theory: Oracle | None, body: Body
) -> list[str]:
    solution = theory.at(delta) if theory and body.shape != "strip" else None
    closed = half_space_force(tip, delta, material.E_star)
    if not (solution and closed):
        return []
    low = 1 - closed[1] / solution.force
    if abs(low) < 0.01:
        return []
    return [f"{closed[0]}, half-space, does not apply: for a contact this large the body is not thick enough"]
