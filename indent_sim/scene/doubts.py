"""Doubts of model, contact law and mesh: a warning and the relative error of the force that it stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import inf, pi
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.part_from_file import MeshedPart
from indent_sim.mesh.sizes import DOUBTFUL_ELEMENTS, Sizes
from indent_sim.model import stability
from indent_sim.model.algebra import cos, tan
from indent_sim.model.contact import ContactLaw, Nitsche, Penalty
from indent_sim.model.materials import LOCKING, Material
from indent_sim.model.tips import (
    STEM,
    Cone,
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Profile,
    RegularPyramid,
    Sphere,
    reach,
)
from indent_sim.scene.boundary_films import late_rows
from indent_sim.scene.given import ATTRACTION_REACH, Durations, Given, Physics, drained_face_size, unused_material
from indent_sim.scene.theories import half_space_force
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

PER_DEPTH = 1.5  # per cent of force for a per cent of depth, of a paraboloid
NEGLIGIBLE_ERROR = 0.005  # of the force: a smaller error is not worth a warning
UNRESOLVED = 0.02  # of the force: a contact in less than two elements
STIFFEST = 1e3  # E*/h of a penalty: beyond it the pressures oscillate
STIFFNESS_ROUNDING = 1e-9  # of a stiffness that was chosen to be just this large
SMALL = 0.05  # characteristic strain up to which forces of small strain are good to some per cent: a/R = 0.25
SEVERAL = 0.002  # of the force: between the equilibria of one mesh with active_set, over 1, 3 and 6 steps
ABSURD = 100.0  # depth over the radius of a tip's end: a needle, or a mistake
HARDLY = 0.45  # Poisson ratio from which a body is said to hardly compress
# What elements at a punch's sharp edge cost the force at most, over their size per radius: measured 0.09 to 0.22 on 25
# quarter cylinders (see scripts/make_error_bar_table), and 0.65 on sections from that Poisson ratio on
EDGE, HARDLY_KEENER = 0.25, 2.6
MOST_SUNK = 1.5  # mean pressures over epsilon_n that a penalty takes from the depth, at most
# Power of the share of the thickness that is left: how a penalty sinks further at finite strain, measured
SINKING_POWER = 1.5
JKR_RIGHT = 0.01  # of the pull-off force: by so much Maugis' may differ where the JKR limit is said to be right
DRAINED_LOCKING, LOCKED_ERROR = 0.495, 0.01  # nu of a drained gel, and of the force what it costs without a pressure
BATH_IS_SUDDEN = 10.0  # times what it takes to come: then a gel has risen by 2.6 % less than after a sudden one
SEALING_ELEMENTS = 10.0  # in the contact, under a tip that seals
LOST = 0.05  # of what friction adds to the force: a smaller share is not worth a warning
FREE = 0.3  # friction up to which the edge slips: steps of a tenth of the path need no second pass (0.01 %, measured)
STEEPEST_FORCE = 3.0  # d ln F/d ln delta at most: a paraboloid on a thin incompressible layer
VERIFIED_CONTRAST = 1001.0  # of moduli, up to which random stacks were held to theory


@dataclass(frozen=True)
class Doubt:
    """A reason not to trust the force, in words, and the relative error of the last row's force that it stands for.

    words: empty where the error is too small to be worth any. force_error: 0 where it is not known.
    """

    key: str
    words: str
    force_error: float = 0.0


HELD_SURFACE = 5e-4  # of the force, what a membrane that holds the surface of a drop in its plane adds at most
TENSE = 30.0  # contact radii, gamma/E* from which p_max is off by more than its bar, by 5 % at 200
NO_CONTACT = Doubt("no_contact", "the tip never reaches the body: every depth is <= 0")


def doubts(given: Given, law: ContactLaw, gap: str, sizes: Sizes) -> tuple[Doubt, ...]:
    """All that speaks against the model, the contact method and the mesh of a scene at its deepest contact."""
    if given.deepest <= 0:
        return () if given.attraction else (NO_CONTACT,)
    of_contact = (*_of_contact(given, law, gap, sizes), *_of_friction(given, law, sizes))
    truncated = [Doubt("truncation", "", given.truncation.error)] if given.truncation else []
    return (*of_theory(given, gap), *of_contact, *_of_mesh(given, sizes), *_of_facets(given, sizes), *truncated)


def of_theory(given: Given, gap: str = "reference") -> tuple[Doubt, ...]:
    """All that speaks against the model, whatever solves it."""
    if given.deepest <= 0:
        return tuple(_of_reach(given)) if given.attraction else (NO_CONTACT,)
    return (*_of_model(given), *_of_tip(given, gap), *_of_reach(given), *_of_adhesion(given))


def of_fluid(given: Given, physics: Physics, sizes: Sizes) -> Iterator[Doubt]:
    """All that speaks against how fluid leaves the body, and how that is resolved."""
    if not physics.permeable or given.history is None:
        return
    drainage, durations = physics.drainage, Durations.of(given, physics, drained_face_size(physics, sizes))
    if {drainage.surface, drainage.tip, drainage.base} == {"sealed"} and not physics.drained_walls:
        yield Doubt("sealed", "every surface is sealed: no fluid leaves the body, it only flows inside")
    elements = given.a / sizes.h_contact
    if drainage.surface == "drained" and drainage.tip == "sealed" and elements < 0.99 * SEALING_ELEMENTS:
        problem = f"the tip seals {elements:.2g} elements, and where that ends is known to one"
        remedy = f"from {SEALING_ELEMENTS:g} on that is 2 % of what relaxes; use a smaller mesh.h_contact"
        yield Doubt("sealing", f"{problem}: {remedy}")
    stiffest = max((one.material.constants.nu for one in physics.permeable if one.formulation != "mixed"), default=0.0)
    if stiffest > DRAINED_LOCKING:
        problem = f"nu = {stiffest:g} of the drained gel: elements without a pressure of its network"
        yield Doubt("locking", f"{problem} are 1 % too stiff at 0.4999", LOCKED_ERROR)
    if given.is_half_space and given.history.span > durations.wall:
        yield Doubt("diffusion", "fluid feels the walls of the finite body that stands for the half-space")
    begin = given.history.points[0][0]
    if given.deepest > 0 and not physics.swells and (late := late_rows(given, physics, sizes, NEGLIGIBLE_ERROR)):
        thick = f"elements of {late.h * physics.scales.length:.2g} at the drained {late.face} are thicker than what"
        low = f"the force is up to {in_words(late.worst)} low"
        words = f"rows up to t = {physics.path.times[late.until]:.3g}: {thick} has drained there by then, and {low}"
        yield Doubt("early", f"{words}; {how_to_refine(sizes, 'give a smaller mesh.h_film')}", late.at_last)
    if physics.creases:
        yield Doubt("creases", f"{physics.creases}: rows may be lost, and those that are found are of a smooth surface")
    if drainage.bath_ramp != "auto" and not physics.swells:
        yield Doubt("bath_ramp", "drainage.bath_ramp has no effect: the bath is that in which the body is at rest")
    ramp = physics.bath_ramp
    if soon := [t - begin for t in physics.path.times if 0 < t - begin < BATH_IS_SUDDEN * ramp]:
        less = " to ".join(dict.fromkeys(in_words(_less_swollen(ramp, t)) for t in (max(soon), min(soon))))
        rows = f"rows up to t = {begin + max(soon):.3g}: the bath comes within {ramp:.3g}"
        yield Doubt(
            "bath",
            f"{rows}, and of a sudden one the gel would have risen more there, by {less}; "
            "use a smaller drainage.bath_ramp",
        )


def _less_swollen(ramp: float, t: float) -> float:
    """How much less a gel has risen at t, relative, when its bath came evenly within `ramp`: the rise goes with the
    root of the time, 2/3 (t^3/2 - (t - ramp)^3/2)/ramp in place of t^1/2."""
    return 1.0 - 2.0 / 3.0 * (t**1.5 - max(t - ramp, 0.0) ** 1.5) / (ramp * t**0.5)


def of_material(config: Config, given: Given) -> tuple[Doubt, ...]:
    """That the section `material` is of no use."""
    words = unused_material(config, given.physics.part)
    return (Doubt("material", words),) if words else ()


def of_whole_contact(given: Given) -> tuple[Doubt, ...]:
    """What theory's contact has that none has that is pushed alone."""
    if not (given.theory and given.theory.pull):
        return ()
    words = f"{given.theory.why}; pushed alone, the body has a smaller one and feels less: only a mesh knows how much"
    return (Doubt("pull", words, given.theory.pull),)


def _of_model(given: Given) -> Iterator[Doubt]:
    """Where the scene needs more than was asked for."""
    physics = given.physics
    body, material, tip, delta, a = physics.body, physics.material, physics.indenter, given.deepest, given.a
    strain, formula = characteristic_strain(given.relative, delta, a)
    if physics.is_compressed:
        strain, formula = delta / body.height, "delta/height"
    if physics.small_strain and strain > SMALL:
        yield Doubt("small_strain", f"strains near {formula} = {strain:.2g}: small strain is no longer a good model")
    if isinstance(tip, Paraboloid) and delta > 0.1 * tip.R:
        words = "depth beyond R/10: a sphere of this R would feel at least 1 % less than the paraboloid"
        yield Doubt("paraboloid", words)
    if physics.small_strain and delta > 0.1 * body.height and not physics.is_compressed:  # or it is said twice
        share = f"depth is {delta / body.height:.0%} of the thickness"
        yield Doubt("small_strain", f"{share}: small strain is no longer a good model")
    if a > 0.8 * body.rim_distance(physics.center) and not physics.is_compressed:
        yield Doubt("rim", "the contact comes close to the edge of the body")
    if (nu := physics.most_locked) >= LOCKING:
        yield Doubt("locking", f"nu = {nu:g} with displacement elements: pressures oscillate, forces are too high")
    for words in stability.instabilities(material, stability.largest_strain(given.relative, a, delta, body.height)):
        yield Doubt("stability", words)
    solution = given.solution(delta) if body.dim == 3 else None
    closed = half_space_force(given.relative, delta, material.E_star)
    if solution and closed and abs(1 - closed[1] / solution.force) >= 0.01:
        thin = "for a contact this large the body is not thick enough"
        cause = "the body is layered" if len(given.layers) > 1 else thin
        cause = "its surface is under tension" if physics.surface_tension else cause
        yield Doubt("half_space", f"{closed[0]}, half-space, does not apply: {cause}")


def _of_tip(given: Given, gap: str) -> Iterator[Doubt]:
    """That a tip ends inside the contact, and what the model makes of it."""
    tip, delta, end = given.physics.indenter, given.deepest, reach(given.physics.indenter)
    if isinstance(tip, FlatPunch) or not (given.a >= end or (isinstance(tip, Sphere) and delta > end)):
        return
    words = "deeper than the profile is high: the body may slip around its end"
    if gap == "reference":
        words = "deeper than the tip has a shape: where it ends the contact ends like under a punch"
    elif isinstance(tip, Sphere):
        words = f"deeper than the ball's radius: it is whole but for a stem within {STEM:g} degrees of its top"
    yield Doubt("tip_end", words)
    if delta > ABSURD * end:
        words = f"the depth is {delta / end:.3g} times the radius at which the tip ends: are both in one unit?"
        yield Doubt("units", words)


def _of_reach(given: Given) -> Iterator[Doubt]:
    """That an attraction is felt where the body ends."""
    rim = given.physics.body.rim_distance(given.physics.center)
    if given.attraction is None or not given.attraction.range or rim >= reach(given.relative):
        return
    if (gaps := float(given.relative.height(rim, 0.0)) / given.attraction.range) < ATTRACTION_REACH:
        end = f"the body ends where the tip's gap is {gaps:.2g} ranges of the attraction"
        yield Doubt("adhesion_rim", f"adhesion: {end}: what a wider one would feel there is left out")


def _of_adhesion(given: Given) -> Iterator[Doubt]:
    """That the attraction's range is too long for the JKR limit, by Maugis-Dugdale on a half-space."""
    limit = given.jkr_limit
    if limit is None or limit.range is None or not isinstance(given.relative, Paraboloid | Sphere | Hyperboloid):
        return
    from indent_sim.theory.surface.adhesion import maugis_lambda, maugis_pull_off, tabor  # with scipy's searches

    parameters = limit.work, limit.range, given.relative.R, given.physics.material.E_star
    shape = maugis_pull_off(maugis_lambda(*parameters))
    if abs(shape / -1.5 - 1) > JKR_RIGHT:
        range_ = f"at a Tabor number of {tabor(*parameters):.3g} its range is not short"
        holds = f"on a half-space it holds with {-shape:.4g} pi work R (Maugis-Dugdale), in the JKR limit with 1.5"
        yield Doubt("adhesion", f"adhesion: {range_}: {holds}")


def _of_contact(given: Given, law: ContactLaw, gap: str, sizes: Sizes) -> Iterator[Doubt]:
    """What the contact method, and a stiffness given in the config, do to the answer."""
    material, theory = given.physics.material, given.theory
    # nodal pressures on a deformed surface
    if gap == "current" and law.multiplier == "nodal":
        several = "several sets of nodes may be in equilibrium, which one is found depends on the steps"
        words = f"{law.method} with gap: current: {several}, and their forces differ by {in_words(SEVERAL)}"
        yield Doubt("several_equilibria", words, SEVERAL)
    stiffest = (1 + STIFFNESS_ROUNDING) * STIFFEST * material.E_star / sizes.h_contact
    if isinstance(law, Penalty | Nitsche) and law.stiffness > stiffest:
        yield Doubt("stiffness", "a stiffness beyond 1000 E*/h_contact: the pressures oscillate")
    if isinstance(law, Penalty):
        lost, at_last = _deepest_and_last(given, lambda delta, a: penalty_loss(law, material, theory, delta, a))
        words = f"penalty: the tip sinks into the body, the force is up to {100 * lost:.2g} % too low at this epsilon_n"
        yield Doubt("penalty", words if lost >= NEGLIGIBLE_ERROR else "", at_last)


def _of_friction(given: Given, law: ContactLaw, sizes: Sizes) -> Iterator[Doubt]:
    """What epsilon_t does to what friction adds to the force, which nothing knows before it is solved."""
    if law.is_conservative:
        return
    assert law.epsilon_t != "auto"
    multiple, elements = law.epsilon_t * sizes.h_contact / given.physics.material.E_star, given.a / sizes.h_contact
    if isinstance(law, Penalty):
        share = slipped_back(multiple * elements)
        lost = f"about {share:.0%} of what friction adds to the force is lost at this epsilon_t"
        words = f"penalty: the surface gives way by t/epsilon_t: {lost}"
    else:
        share = abs(shifted(multiple, elements)) if law.friction == "stick" or law.friction > FREE else 0.0
        change = f"{share:.0%} {'more' if multiple > 1 else 'less'} to the force than at 1, the most accurate"
        words = f"epsilon_t is {multiple:.2g} E*/h_contact: on these elements friction adds about {change}"
    if share >= LOST:
        yield Doubt("friction", words)


def slipped_back(stiffness: float) -> float:
    """The share of what friction adds that a penalty loses; stiffness: epsilon_t a/E*.

    Measured on a layer, nu 0 and 0.3, 5 and 10 elements in a, 1, 4 and 16 steps: 0.79-0.88, 0.30-0.49 and 0.06-0.14 at
    0.5, 5 and 50.
    """
    return float(1 / (1 + (stiffness / 4) ** 0.8))


def shifted(multiple: float, elements: float) -> float:
    """The share of itself that is added to what stick adds by an epsilon_t of `multiple` E*/h_contact.

    Measured at 0.01 to 1000 on thick bodies of nu 0 and 0.3 and thin layers of nu 0.49 and 0.5: 0.05-0.06 a decade with
    4 to 5 elements in the contact radius, 0.02-0.045 with 8 to 10.
    """
    return float(0.35 / elements * np.log10(multiple))


def _of_mesh(given: Given, sizes: Sizes) -> Iterator[Doubt]:
    """What coarse elements will do to the results."""
    if (flat := given.elastocapillary_length / given.a) > TENSE:
        step = f"gamma/E* is {flat:.2g} contact radii: the pressure ends with a step"
        yield Doubt("p_max", f"{step}, where p_max of a mesh is up to 5 % too large; the force is not")
    if given.physics.is_drop:
        yield Doubt("drop", "", HELD_SURFACE)
    moduli = [region.material.constants.E for region in given.physics.part.regions]
    if max(moduli) > VERIFIED_CONTRAST * min(moduli):
        words = f"moduli {max(moduli) / min(moduli):.0e} times apart: sizes are known to suit up to 1000 times"
        yield Doubt("contrast", f"{words}; ask for an accuracy, and compare")
    if sizes.corner_error >= NEGLIGIBLE_ERROR:
        high = f"the force may be too high by up to {in_words(sizes.corner_error)}"
        remedy = "use smaller sizes everywhere, or leave them to the program"
        words = f"coarse elements at corners that the contact feels: {high}; {remedy}"
        yield Doubt("corners", words, sizes.corner_error)
    nu, a = given.physics.largest_nu, given.a
    likely, at_last = _deepest_and_last(given, lambda delta, a: force_doubt(sizes, a, nu))
    shallowest = _radius(given, min((delta for delta in given.physics.deltas if delta > 0), default=given.deepest))
    words = ""
    if sizes.edge is not None and sizes.h_edge is not None and likely >= NEGLIGIBLE_ERROR:
        finer = how_to_refine(sizes, "give a smaller h_contact or h_edge")
        low = f"the force may be too low by {in_words(likely)}; {finer}"
        words = f"elements of {sizes.h_edge / sizes.edge:.2g} radii at the punch's edge: {low}"
    elif not sizes.is_enough(a):
        finer = how_to_refine(sizes, f"give h_contact at most {1 / DOUBTFUL_ELEMENTS:.2g} of the contact radius")
        wrong = f"the force may be wrong by {in_words(likely)}, a by up to 5 %; {finer}"
        words = f"only {a / sizes.h_contact:.2g} elements in the expected contact radius: {wrong}"
    elif not sizes.is_enough(shallowest) and (there := force_doubt(sizes, shallowest, nu)) >= UNRESOLVED:
        few = f"only {shallowest / sizes.h_contact:.2g} of them are in the contact radius"
        wrong = f"the force there may be wrong by {in_words(there)}"
        words = f"the elements suit the deepest contact; at the shallowest {few}, and {wrong}"
    if words or at_last:
        yield Doubt("elements", words, at_last)


def how_to_refine(sizes: Sizes, smaller: str) -> str:
    """How to get smaller elements; those of a mesh from a file can only be halved."""
    return smaller if sizes.refinements is None else "refine it: mesh.refinements"


def _of_facets(given: Given, sizes: Sizes) -> Iterator[Doubt]:
    """That flat facets from a file stand for a curved surface, inside which they are: the tip is less deep."""
    physics = given.physics
    if not isinstance(physics.part, MeshedPart):
        return
    sag = physics.part.sag(physics.center, given.a, sizes.refinements or 0)
    if (error := PER_DEPTH * sag / given.deepest) >= NEGLIGIBLE_ERROR:
        inside = f"they lie up to {sag * physics.scales.length:.2g} inside it, {in_words(error)} of the force"
        yield Doubt("facets", f"flat facets under the tip: if they stand for a curved surface {inside}")


def _deepest_and_last(given: Given, error: Callable[[float, float], float]) -> tuple[float, float]:
    """A relative error(depth, contact radius) at the deepest contact and at the last row, where there is contact."""
    last = given.physics.deltas[-1]
    known = {delta: error(delta, _radius(given, delta)) for delta in {given.deepest, last} if delta > 0}
    return known[given.deepest], known.get(last, 0.0)


def _radius(given: Given, delta: float) -> float:
    """The contact radius [length] to expect at a depth: of a tip that adheres JKR's, infinite where nobody knows it."""
    if given.attraction is None:
        return given.radius(delta)
    with suppress(*UNSOLVED):
        if given.jkr and (found := given.jkr.stable(delta)):
            return max(found.a, given.radius(delta))
    return inf


def in_words(error: float) -> str:
    """A relative error of the force in words."""
    if error >= 1:
        return "more than its own size"
    return "tens of per cent" if error >= 0.2 else f"about {100 * error:.1g} %"


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
        case RegularPyramid(half_angle=angle, roundness=roundness):
            return 0.2 / (roundness * tan(angle)), "0.2 cot(half_angle of the cone of equal sections)"
        case Profile() | Hyperboloid() if a < reach(tip):
            return 0.2 * tip.slope(a), "0.2 times the slope at the contact's edge"
    return 0.3 * delta / a, "0.3 delta/a"


def edge_error(sizes: Sizes) -> float:
    """The relative error of the force by the elements at a punch's sharp edge, at most; 0 where there is none.

    EDGE h_edge/radius, times how keenly the force feels the radius. The force is always too low: elements that end at
    the edge stand for a punch that is narrower.
    """
    if sizes.edge is None or sizes.h_edge is None:
        return 0.0
    return EDGE * sizes.keenness * sizes.h_edge / sizes.edge


def force_doubt(sizes: Sizes, a: float, nu: float) -> float:
    """The relative error of the force to fear on this mesh with the expected contact radius a; 0 for none.

    Measured on a layer (axisymmetric, all methods): at most 0.3, 0.9, 2.3, 2.4, 5.5, 15, 20 and
    117 % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements: below 7/n^2 %. A punch's sharp edge: below a quarter
    of the size of its elements over its radius (axisymmetric and in three dimensions), 0.65 of it where the body
    hardly compresses; times `keenness`.
    """
    if sizes.edge is not None and sizes.h_edge is not None:
        return (1.0 if nu < HARDLY else HARDLY_KEENER) * edge_error(sizes)
    return 0.0 if sizes.is_enough(a) else 0.07 / sizes.elements(a) ** 2


def swelling_doubt(sizes: Sizes, a: float) -> float:
    """The same of a contact that a gel closes as it swells, whose force is that of the last elements that it closed.

    Measured on a gel of chi 0.6 under a ball of one height, on three meshes at six times, against elements a sixth as
    long at the axis: at most 51, 36, 8, 5 and 1 % with n = 2.3, 2.9, 3.7, 4.5 and 6.5 elements in the contact radius,
    which is 2.7/n^3 to 8.6/n^3. `tests/physics/test_gel_scenes.py` measures one of the meshes again.
    """
    return 0.0 if sizes.edge is not None else 9.0 / sizes.elements(a) ** 3


def penalty_loss(contact: ContactLaw, material: Material, theory: Theory | None, delta: float, a: float) -> float:
    """The share of the force, at most, that a penalty costs at a depth; 0 for the other methods.

    The body feels only the depth s that the penetration leaves: s + c p(s)/epsilon_n = delta with the mean pressure p,
    and 1 - F(s)/F(delta) is lost; by theory, or as on a half-space under a paraboloid where there is none. c, the
    integral of p dp/dF over p, is 0.69 for a cone and 0.75 for a paraboloid on a half-space, and for a paraboloid on a
    thin layer 1 when it is compressible and 1.5 when not.
    """
    if not isinstance(contact, Penalty) or delta <= 0:
        return 0.0
    sunk = MOST_SUNK * (1.0 if material.small_strain else (1.0 - delta) ** -SINKING_POWER) / contact.stiffness
    force, pressure = _carried(theory, material, delta, a, np.ones(1))
    if (quick := STEEPEST_FORCE * sunk * float(pressure[0]) / delta) < NEGLIGIBLE_ERROR:
        return quick  # a theory of many depths takes its time
    s = np.array([1e-6, 1e-3, 0.03, 0.2, 0.5, 0.8, 0.95, 1.0])
    force, pressure = _carried(theory, material, delta, a, s)
    felt = np.interp(np.log(delta), np.log(s * delta + sunk * pressure), np.log(force))
    return float(1 - np.exp(felt) / force[-1])


def _carried(theory: Theory | None, material: Material, delta: float, a: float, s: np.ndarray) -> np.ndarray:
    """Force (in any unit) and mean pressure at parts s of a depth."""
    curve = theory.curve([float(depth) for depth in s * delta]) if theory else None
    if curve:
        force = np.array([solution.force for solution in curve])
        return np.array([force, force / [solution.area for solution in curve]])
    E, nu = material.constants
    confined = E * (1 - nu) / ((1 + nu) * max(1 - 2 * nu, 1e-4)) * s  # of a body in contact from wall to wall
    hertz = 4 / (3 * pi) * material.E_star / a * np.sqrt(s)
    return np.array([s**1.5, delta * np.maximum(hertz, confined)])
