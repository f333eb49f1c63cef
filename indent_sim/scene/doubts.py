"""Where the model or the mesh is a poor one for what is asked: words and a relative error of the force."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from indent_sim.mesh.sizes import ENOUGH, Sizes
from indent_sim.model import stability
from indent_sim.model.body import Body
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.model.materials import LOCKING, Material
from indent_sim.model.tips import Indenter, Paraboloid
from indent_sim.scene.expected import (
    SEVERAL,
    SMALL,
    TELLING,
    Oracle,
    characteristic_strain,
    half_space_force,
    has_several_equilibria,
    penalty_loss,
)
from indent_sim.scene.sizing import HARDLY


def in_words(error: float) -> str:
    """A relative error of the force in words."""
    if error >= 1:
        return "more than there is of it"
    return "tens of per cent" if error >= 0.2 else f"about {100 * error:.1g} %"
UNRESOLVED = 0.02  # of the force: a contact in less than two elements


def warnings_of(body: Body, material: Material, tip: Indenter, center: tuple[float, ...], delta: float, a: float,
                theory: Oracle | None, formulation: str) -> list[str]:  # fmt: skip
    """Where the scene needs more than was asked for, a sentence each."""
    if delta <= 0:
        return ["the tip never reaches the body: every depth is <= 0"]
    warnings = []
    strain, formula = characteristic_strain(tip, delta, a)
    if material.small_strain and strain > SMALL:
        warnings.append(f"strains near {formula} = {strain:.2g}: small strain is no longer a good model")
    if isinstance(tip, Paraboloid) and delta > 0.1 * tip.R:
        warnings.append("depth beyond R/10: a sphere of this R would feel at least 1 % less than the paraboloid")
    if material.small_strain and delta > 0.1 * body.height:
        warnings.append(f"depth is {delta / body.height:.0%} of the thickness: small strain is no longer a good model")
    if a > 0.8 * body.rim_distance(center):
        warnings.append("the contact comes close to the edge of the body")
    if formulation == "displacement" and material.constants[1] >= LOCKING:
        warnings.append(
            f"nu = {material.constants[1]:g} with displacement elements: pressures oscillate, forces are too high"
        )
    warnings += stability.doubts(material, stability.reach(tip, a, delta, body.height))
    return warnings + _half_space_warning(tip, material, delta, theory, body)


def stated_error(contact: ContactLaw, gap: str, material: Material, sizes: Sizes, theory: Oracle | None, delta: float,
                 a: float) -> float:  # fmt: skip
    """The relative error of the force at a depth that the program warns of; 0 when it knows of none."""
    if delta <= 0:
        return 0.0
    several = SEVERAL if has_several_equilibria(contact, gap) else 0.0
    return several + penalty_loss(contact, material, theory, delta, a) + force_doubt(sizes, a, material.constants[1])


def shallow_doubts(sizes: Sizes, material: Material, deltas: Sequence[float], radius: Callable[[float], float]
                   ) -> list[str]:  # fmt: skip
    """That the shallowest contact is smaller than an element, when the deepest one is not."""
    inside = [delta for delta in deltas if delta > 0]
    a = radius(min(inside)) if inside else 0.0
    if not inside or sizes.is_enough(a) or not sizes.is_enough(radius(max(inside))):
        return []
    doubt = force_doubt(sizes, a, material.constants[1])
    if doubt < UNRESOLVED:
        return []
    return [
        f"the elements suit the deepest contact; at the shallowest only {a / sizes.h_contact:.2g} of them are in the "
        f"contact radius, and the force there may be wrong by {in_words(doubt)}"
    ]


def contact_warnings(contact: ContactLaw, gap: str, material: Material, sizes: Sizes, theory: Oracle | None,
                     delta: float, a: float) -> list[str]:  # fmt: skip
    """What the contact method, and a stiffness given in the config, do to the answer at the deepest contact."""
    doubts, sinking = [], penalty_loss(contact, material, theory, delta, a)
    if has_several_equilibria(contact, gap):
        doubts.append(f"{contact.method} with gap: current: several sets of nodes may be in equilibrium, which one is "
                      f"found depends on the steps, and their forces differ by {in_words(SEVERAL)}")  # fmt: skip
    if isinstance(contact, (Penalty, Nitsche)) and contact.stiffness > 1e3 * material.E_star / sizes.h_contact:
        doubts.append("a stiffness beyond 1000 E*/h_contact: the pressures oscillate")
    if sinking >= TELLING:
        lost = f"the force is up to {100 * sinking:.2g} % too low at this epsilon_n"
        doubts.append(f"penalty: the tip sinks into the body, {lost}")
    return doubts


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


def force_doubt(sizes: Sizes, a: float, nu: float) -> float:
    """The relative error of the force to fear on this mesh with the expected contact radius a; 0 for none.

    Measured on a layer (axisymmetric, all methods): at most 0.3, 0.9, 2.3, 2.4, 5.5, 15, 20 and
    117 % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements: below 7/n^2 %. A punch's sharp edge: below a quarter
    of the size of its elements over its radius (axisymmetric and in three dimensions), 0.65 of it where the body
    hardly compresses; times `keenness`.
    """
    if sizes.edge is not None and sizes.h_edge is not None:
        return (0.25 if nu < HARDLY else 0.65) * sizes.keenness * sizes.h_edge / sizes.edge
    return 0.0 if sizes.is_enough(a) else 0.07 / sizes.elements(a) ** 2


def resolution_doubts(sizes: Sizes, a: float, nu: float) -> list[str]:
    """What too few elements in the expected contact radius a will do to the results, in words.

    Measured on HERTZ (axisymmetric, strip, cube) with n = 0.7 to 20 elements in a: a is wrong by up to 5 %.
    """
    likely, doubts = force_doubt(sizes, a, nu), []
    if sizes.corner_error >= TELLING:
        doubts.append(
            "coarse elements at corners that the contact feels: the force may be too high by up to "
            f"{in_words(sizes.corner_error)}; use smaller sizes everywhere, or leave them to the program"
        )
    if sizes.edge is not None and sizes.h_edge is not None:
        of_radius = f"elements of {sizes.h_edge / sizes.edge:.2g} radii at the punch's edge"
        if likely >= TELLING:
            doubts.append(
                f"{of_radius}: the force may be too low by {in_words(likely)}; give a smaller h_contact or h_edge"
            )
        return doubts
    if not sizes.is_enough(a):
        doubts.append(
            f"only {a / sizes.h_contact:.2g} elements in the expected contact radius: the force may be wrong by "
            f"{in_words(likely)}, a by up to 5 %; give h_contact at most {1 / ENOUGH:.2g} of the contact radius"
        )
    return doubts
