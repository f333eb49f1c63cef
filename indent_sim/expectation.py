"""What to expect of a scene before it is run: forces from theory, and where the model asked for is a poor one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi

import numpy as np

from indent_sim.errors import ConfigError
from indent_sim.model import stability
from indent_sim.model.algebra import cos, tan
from indent_sim.model.body import Body
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.model.indenters import STEM, Cone, FlatPunch, Indenter, Paraboloid, Profile, Pyramid, Sphere, reach
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import LOCKING, Material
from indent_sim.oracle import Oracle, half_space_depth, half_space_force, section_depth
from indent_sim.sizing import TELLING, Sizes, in_words
from indent_sim.state import Scales

DEEPEST = 0.9  # of the thickness: there no force is expected to find its depth
MOST_FORCES = 3  # at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
MOST_SUNK = 1.5  # mean pressures over epsilon_n that a penalty takes from the depth, at most
DEEPER = 1.5  # power of the share of the thickness that is left: how a penalty sinks further at finite strain, measured
STEEPEST = 3.0  # d ln F/d ln delta at most: a paraboloid on a thin incompressible layer
SMALL = 0.05  # characteristic strain up to which forces of small strain are good to some per cent: a/R = 0.25
SEVERAL = 0.002  # of the force: between the equilibria of one mesh with active_set, over 1, 3 and 6 steps
ABSURD = 100.0  # depth over the radius of a tip's end: a needle, or a mistake
UNRESOLVED = 0.02  # of the force: a contact in less than two elements


def depths_of(path: LoadPath, theory: Oracle | None, tip: Indenter, material: Material, height: float, scales: Scales
              ) -> tuple[float, ...]:  # fmt: skip
    """The requested depths, or those to expect at the requested forces, within DEEPEST of the body's height.

    ConfigError when theory says that a linear body does not bear the largest force.
    """
    if path.control == "depth":
        return path.values
    deepest, force = DEEPEST * height, max(path.values) * scales.force
    depths = _depths_at(path.values, theory, tip, material.E_star, scales.dim, deepest)
    if material.small_strain and theory and max(depths) > (1 - 1e-6) * deepest:
        problem = f"a force of {force:g} would press the tip to {DEEPEST:.0%} of the body's thickness or deeper"
        raise ConfigError("loading", problem, "use a smaller force")
    return depths


def _depths_at(forces: Sequence[float], theory: Oracle | None, tip: Indenter, E_star: float, dim: int, deepest: float
               ) -> tuple[float, ...]:  # fmt: skip
    """From theory, or from the tip's section where there is none or it ends; between MOST_FORCES by power laws."""
    pushed = np.unique([force for force in forces if force > 0])
    some = pushed if len(pushed) <= MOST_FORCES else np.geomspace(pushed[0], pushed[-1], MOST_FORCES)
    depths = []
    for force in map(float, some):
        start = section_depth(tip, force, E_star, dim)
        found = theory.depth(force, start, deepest) if theory else None
        depths.append(float(f"{found or min(start, deepest / 2):.9g}"))  # the same in all units, and so is the mesh
    return tuple(
        float(np.exp(np.interp(np.log(force), np.log(some), np.log(depths)))) if force > 0 else 0.0 for force in forces
    )


def prediction_of(path: LoadPath, theory: Oracle | None, tip: Indenter, material: Material, delta: float, a: float,
                  scales: Scales) -> dict[str, float]:  # fmt: skip
    """Expected contact radius, and force (or depth, if forces are prescribed) by layer theory and by the half-space
    formula, in the user's units."""
    prediction = {"a": a * scales.length}
    if path.control == "force":
        closed = half_space_depth(tip, max(path.values), material.E_star) if scales.dim == 3 else None
        half_space = {"delta_half_space": closed[1] * scales.length} if closed else {}
        return prediction | {"delta": delta * scales.length} | half_space
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


def characteristic_strain(tip: Indenter, delta: float, a: float) -> tuple[float, str]:
    """The strain beside a contact and the formula that gave it.

    0.2 times the tip's slope at the contact's edge (Tabor 1951 for a ball, Johnson 1985, 6.3 for a cone, whatever its
    depth), a pyramid as the cone of equal sections. A punch has no slope: 0.3 delta/a, which is the same share of
    the mean pressure 2 E* delta/(pi a) as 0.2 a/R is of a ball's 4 E* a/(3 pi R), within 1 %.
    """
    match tip:
        case Paraboloid(R=R) | Sphere(R=R) if a < R or isinstance(tip, Paraboloid):
            return 0.2 * a / R, "0.2 a/R"
        case Cone(half_angle=angle, tip_radius=radius) if a > radius * cos(angle):
            return 0.2 / tan(angle), "0.2 cot(half_angle)"
        case Cone(tip_radius=radius):
            return 0.2 * a / radius, "0.2 a/tip_radius"
        case Pyramid(half_angle=angle, roundness=roundness):
            return 0.2 / (roundness * tan(angle)), "0.2 cot(half_angle of the cone of equal sections)"
        case Profile() if a < reach(tip):
            return 0.2 * tip.slope(a), "0.2 times the slope at the contact's edge"
    return 0.3 * delta / a, "0.3 delta/a"


def tip_warnings(tip: Indenter, gap: str, delta: float, a: float) -> list[str]:
    """That a tip ends inside the contact, and what the model makes of it."""
    end, warnings = reach(tip), list[str]()
    is_beyond = a >= end or (isinstance(tip, Sphere) and delta > end)
    if delta <= 0 or isinstance(tip, FlatPunch) or not is_beyond:
        return []
    if gap == "reference":
        warnings.append("deeper than the tip has a shape: where it ends the contact ends like under a punch")
    elif isinstance(tip, Sphere):
        warnings.append(f"deeper than the ball's radius: it is whole but for a stem within {STEM:g} degrees of its top")
    else:
        warnings.append("deeper than the profile is high: the body may slip around its end")
    if delta > ABSURD * end:
        warnings.append(f"the depth is {delta / end:.3g} times the radius at which the tip ends: are both in one unit?")
    return warnings


def penalty_loss(contact: ContactLaw, material: Material, theory: Oracle | None, delta: float, a: float) -> float:
    """The share of the force, at most, that a penalty costs at a depth; 0 for the other methods.

    The body feels only the depth s that the penetration leaves: s + c p(s)/epsilon_n = delta with the mean pressure p,
    and 1 - F(s)/F(delta) is lost; by theory, or as on a half-space under a paraboloid where there is none. c, the
    integral of p dp/dF over p, is 0.69 for a cone and 0.75 for a paraboloid on a half-space, and for a paraboloid on a
    thin layer 1 when it is compressible and 1.5 when not.
    """
    if not isinstance(contact, Penalty) or delta <= 0:
        return 0.0
    sunk = MOST_SUNK * (1.0 if material.small_strain else (1.0 - delta) ** -DEEPER) / contact.stiffness
    force, pressure = _carried(theory, material, delta, a, np.ones(1))
    if (quick := STEEPEST * sunk * float(pressure[0]) / delta) < TELLING:
        return quick  # a theory of many depths takes its time
    s = np.array([1e-6, 1e-3, 0.03, 0.2, 0.5, 0.8, 0.95, 1.0])
    force, pressure = _carried(theory, material, delta, a, s)
    felt = np.interp(np.log(delta), np.log(s * delta + sunk * pressure), np.log(force))
    return float(1 - np.exp(felt) / force[-1])


def _carried(theory: Oracle | None, material: Material, delta: float, a: float, s: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Force (in any unit) and mean pressure at parts s of a depth."""
    curve = theory.curve(list(s * delta)) if theory else None
    if theory and curve:
        force, radius = np.array([solution.force for solution in curve]), np.array([solution.a for solution in curve])
        return force, force / (2 * radius if theory.is_plane else pi * radius**2)
    E, nu = material.constants
    confined = E * (1 - nu) / ((1 + nu) * max(1 - 2 * nu, 1e-4)) * s  # of a body in contact from wall to wall
    return s**1.5, delta * np.maximum(4 / (3 * pi) * material.E_star / a * np.sqrt(s), confined)


def stated_error(contact: ContactLaw, gap: str, material: Material, sizes: Sizes, theory: Oracle | None, delta: float,
                 a: float) -> float:  # fmt: skip
    """The relative error of the force at a depth that the program warns of; 0 when it knows of none."""
    if delta <= 0:
        return 0.0
    several = SEVERAL if has_several_equilibria(contact, gap) else 0.0
    return several + penalty_loss(contact, material, theory, delta, a) + sizes.force_doubt(a, material.constants[1])


def has_several_equilibria(contact: ContactLaw, gap: str) -> bool:
    """Whether more than one set of nodes in contact may be in equilibrium: nodal pressures on a deformed surface."""
    return gap == "current" and contact.multiplier == "nodal"


def shallow_doubts(sizes: Sizes, material: Material, deltas: Sequence[float], radius: Callable[[float], float]
                   ) -> list[str]:  # fmt: skip
    """That the shallowest contact is smaller than an element, when the deepest one is not."""
    inside = [delta for delta in deltas if delta > 0]
    a = radius(min(inside)) if inside else 0.0
    if not inside or sizes.is_enough(a) or not sizes.is_enough(radius(max(inside))):
        return []
    doubt = sizes.force_doubt(a, material.constants[1])
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
