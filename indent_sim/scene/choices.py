"""Choices of a scene: model, gap, contact law, tip, solver and mesh, each with its reason."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, fields, replace
from math import inf, pi
from typing import TYPE_CHECKING, Any

from indent_sim.config.strict_yaml import key_text
from indent_sim.mesh.modelled_part import Region
from indent_sim.mesh.part_from_file import MeshedPart
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Endless, MeshFromFile
from indent_sim.model.contact import Adhesion, Anchor, AugmentedLagrangian, AutoContact, Contact, ContactLaw, Penalty
from indent_sim.model.experiment import Experiment
from indent_sim.model.materials import LOCKING
from indent_sim.model.tips import FlatPunch, Indenter, Plate, reach
from indent_sim.model.units import rounded
from indent_sim.process.errors import ConfigError
from indent_sim.scene.cost import DENSE, MOST_CANDIDATES, Cost
from indent_sim.scene.doubts import FREE, NEGLIGIBLE_ERROR, STIFFEST, penalty_loss
from indent_sim.scene.expected import NEARLY_STICK, ExpectedAdhesion, infinite_pressure, pulling_rim
from indent_sim.scene.fineness import Fineness, target_of
from indent_sim.scene.given import Durations, Given, Physics, drained_face_size, first_step
from indent_sim.scene.theories import NO_INCLUSIONS, first_of, layer_theory, shape_of
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.theory import MOST_KEPT

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

FORCE_WHY = "forces are given: each depth is found from the curve force(depth), which has one depth for a force"
THEORY_FORCE_WHY = "forces are given: theory finds the depth of each"
SIDEWAYS = "pushes sideways, and nothing holds this body there (roller base, free sides)"
EDGE_WHY = "the pressure is singular at the punch's sharp edge"
AXIS_WHY = "sizes grow from this at the axis to h_contact where the deepest contact ends"
FILM_WHY = "at drained faces the fluid's pressure changes within a film as thin as (D t)^(1/2) at the first rows"
CORNER_WHY = "the contact feels bonded corners or the gap up to a side: sizes grow from this with the distance"
GAP_WHY = {
    "reference": "linear elastic: Hertz' own problem, tested at the undeformed point",
    "current": "finite strain: tested at the deformed point, pressure along the tip's normal",
}
FOR_WHOLE = "solver.linear: iterative is for the whole body"
WORTH_SECONDS = 2.0  # of a factorisation, which never fails, that iterations must save to be chosen
CLEARLY = 0.8  # of a factorisation's seconds, below which iterations are chosen: a prediction is no better
FREE_WHY = "new contact sticks where its step began"
ON_ITS_WAY = "new contact sticks where it touches on its way through the step, found in a pass without friction for it"
NEEDLE = 1e3  # depth over a tip's radius beyond which a deformed body cannot be followed around it
COARSEST = 1.5  # elements over the cohesive zone: coarser ones jump from node to node, measured
PULL_OFF_DIFFERENCE = 0.05  # of the largest pull without range: up to this difference a body pulls as a half-space does
# Beyond these a system takes so many iterations that some are not solved: 7 at nu 0.45 without a pressure, 25 at 0.495,
# 56 at 0.499, too many at 0.4999; 7 in a contact of 3e5 E*/h_contact, 10 and more steps of Newton's in one of 9e5
NEARLY_LOCKED, RIGID = 0.495, 3e5
# Measured on a half and a quarter of a rubber cylinder: no equilibrium within 23 iterations, however short the step;
# linear bodies take twice the iterations of free walls (83 instead of 45)
STIFF_WALL = "a curved roller wall that is held weakly, at finite strain, has steps that iterations do not find"
JKR_WHY = "the JKR limit: exact for this body where the attraction's range is short"
TING_WHY = "Lee & Radok while the contact grows, Ting while it shrinks: exact for one body or layers that relax alike"
STEP_WHY = "contact stepped in time on the compliance, to 1e-4: the history is no single cycle of depths"
AS_WIDE_WHY = "the punch is as wide as the body: a plane, whose edge does not cut into a rim that bulges"
UNITS = "check work, R and E: are they in the same units?"
QUASI_WHY = "every point an equilibrium of the elastic curve"
SPREAD, FILLED = 500.0, 0.95  # of a mesh: between its contacts that come off and the deepest; of the way to the rim
BLUNTING = 1e-3  # of the expected contact radius: the radius that a sharp apex or edge gets


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


Choices = list[Choice]


def model(given: Given) -> Choices:
    """What of the body is modelled, and how."""
    physics = given.physics
    part = physics.part
    body = f"{physics.body.shape}, height {physics.scales.length:.4g}"
    pinned = "roller base and free sides leave rigid modes; reactions audited to be zero"
    strain = ("small", "the material is linear elastic") if physics.small_strain else ("finite", "it is hyperelastic")
    return [
        *([Choice("body", body, given.truncation.why)] if given.truncation else []),
        Choice("symmetry", part.symmetry, given.part_why),
        Choice("kinematics", part.kinematics.name, part.kinematics.why),
        Choice("strain", *strain),
        *([Choice("control", "force", FORCE_WHY)] if physics.path.control == "force" else []),
        *([Choice("surface", "held", _held_surface(physics))] if physics.is_drop else []),
        *([Choice("pins", len(part.pins), pinned)] if part.pins else []),
    ]


def _held_surface(physics: Physics) -> str:
    """Why the surface of a drop is held in its plane."""
    number = f"gamma/(mu R) = {physics.drop_number:.3g}: little but its tension holds the surface"
    return f"{number}, whose points a membrane of 0.001 gamma keeps apart, which adds up to 0.05 % to the force"


def quantities(config: Config) -> Choices:
    """Quantities that carried units of their own, as they are in the scene's."""
    own = f"{config.units.length} and {config.units.force}"
    given = [(key_text(path), value, text) for path, (text, value) in config.source.quantities.items()]
    return [Choice(key, value, f"given as {text}; the scene is in {own}") for key, value, text in given]


def formulations(given: Given) -> Choices:
    """Displacements alone, or with a pressure, in each region."""
    regions = given.physics.part.regions
    return [_formulation(region, len(regions) == 1) for region in regions]


def _formulation(region: Region, is_alone: bool) -> Choice:
    key = "material" if is_alone or region.name == "body" else f"body.{region.name}.material"
    key = f"body.{region.name}" if region.name.startswith("regions.") else key
    nu, sign = region.softest.nu, ">=" if region.formulation == "mixed" else "<"
    like = "" if region.material.is_isotropic else "as compressible as "
    like = "its shear relaxes to " if region.least_share < 1 else like
    why = "as given" if region.material.formulation != "auto" else f"{like}nu = {nu:.6g} {sign} {LOCKING:g}"
    return Choice(f"{key}.formulation", region.formulation, why)


def gap(wanted: Contact, given: Given) -> tuple[str, Choice]:
    """Where the gap is tested, at the undeformed or the deformed point. ConfigError for a gap at the deformed point
    that has no answer: a body that slides away, a needle."""
    physics, end = given.physics, reach(given.physics.indenter)
    auto = "reference" if physics.small_strain else "current"
    chosen = auto if wanted.gap == "auto" else wanted.gap
    if chosen == "current" and given.deepest > NEEDLE * end:
        outcome = "gap: current cannot tell how a body gives way to such a needle"
        problem = f"the depth is {given.deepest / end:.3g} times the radius at which the tip ends: {outcome}"
        raise ConfigError("indenter", problem, "give both in the same unit of length")
    if chosen == "current" and physics.part.pins and not physics.is_compressed:
        remedy = "fix the base, hold a side, use gap: reference, or put the tip in the middle and use symmetry"
        raise ConfigError("contact.gap", f"'current' {SIDEWAYS}", remedy)
    return chosen, Choice("contact.gap", chosen, "as given" if wanted.gap != "auto" else GAP_WHY[chosen])


def contact(wanted: Contact, given: Given, sizes: Sizes, fineness: Fineness | None) -> tuple[ContactLaw, Choice]:
    """The contact method and its stiffness [pressure/length, without units]; ConfigError for one that is too soft."""
    scales, unit = given.physics.scales, given.physics.material.E_star / sizes.h_contact
    law: Any = replace(scales.scaled(wanted), gap="auto")  # the scene says which gap
    why = "as given"
    if isinstance(law, AutoContact):
        why = "auto: no penetration to pay for, smooth pressures, fewest iterations"
        law = AugmentedLagrangian(friction=law.friction, epsilon_t=law.epsilon_t, adhesion=law.adhesion)
    name = next((f.name for f in fields(law) if f.name in ("epsilon_n", "gamma")), None)
    if name is None:
        return law, Choice("contact", law.method, why)
    value: Any = getattr(law, name)
    source = f"{name} {'auto' if value == 'auto' else 'as given'}"
    if value == "auto":
        value = rounded(_stiffness(law, given, sizes, fineness))
    multiple, smallest = value / unit, getattr(law, "smallest_multiple", 0.0)
    if multiple < smallest * (1 - 1e-9):
        problem = f"is {multiple:.2g} E*/h_contact; below {smallest:g} E*/h_contact {law.method} gives wrong forces"
        remedy = f"at least {smallest * unit * scales.stiffness:.4g}, or auto ({law.auto_multiple:g} E*/h_contact)"
        raise ConfigError(f"contact.{name}", problem, remedy)
    law = replace(law, **{name: value})
    law = law if law.is_conservative else _with_tangential(law, unit, scales.stiffness)
    why = f"{why}; {source}: {value / unit:.3g} E*/h_contact"
    return law, Choice("contact", f"{law.method}, {name} = {value * scales.stiffness:.6g}", why)


def friction(law: ContactLaw, given: Given, sizes: Sizes) -> tuple[ContactLaw, Anchor, Choices]:
    """The law, with friction for stick where no surface that only pushes sticks, where new contact is taken to have
    touched, and what to say of friction; nothing where there is none.

    ConfigError for a scene that friction was never verified in.
    """
    physics, coefficient = given.physics, law.friction
    if not coefficient:
        return law, "implicit", []
    on_its_way = [Choice("contact.friction", coefficient, ON_ITS_WAY)]
    if physics.part.pins:
        problem = f"does not fit this scene: it {SIDEWAYS}"
        remedy = "fix the base, hold a side, or put the tip in the middle and use symmetry"
        raise ConfigError("contact.friction", problem, remedy)
    if not isinstance(coefficient, str):
        if coefficient <= FREE:
            return law, "implicit", [Choice("contact.friction", coefficient, FREE_WHY)]
        return law, "mid", on_its_way
    rim = pulling_rim(physics.indenter, physics.material.constants.nu, sizes, physics.part.dim)
    if not rim:
        return law, "mid", on_its_way
    why = f"stands for stick: {rim * physics.scales.length:.2g} beside the sharp edge a surface that sticks would pull"
    law = replace(law, friction=NEARLY_STICK)  # type: ignore[arg-type]
    return law, "mid", [Choice("contact.friction", NEARLY_STICK, why)]


def adhesion(law: ContactLaw, given: Given, sizes: Sizes) -> tuple[ExpectedAdhesion | None, Choices]:
    """What to say of a tip that adheres, the number of elements in its cohesive zone; nothing where none does.
    ConfigError for a range that the elements do not resolve, and for plane strain, where it was never verified."""
    found = law.adhesion
    if found is None:
        return None, []
    if given.physics.body.dim == 2:
        problem = "was never verified in plane strain"
        raise ConfigError("contact.adhesion", problem, "use an axisymmetric or a three-dimensional body")
    L, E_star, h = given.physics.scales.length, given.physics.material.E_star, sizes.h_contact
    smallest = found.resolved_by(h / COARSEST, E_star) * L
    if found.range is None:
        remedy = f"at least {smallest:.3g} where h_contact = {h * L:.3g}; its limit 0 is experiment.adhesion"
        raise ConfigError("contact.adhesion.range", "is missing: the distance over which the attraction acts", remedy)
    zone = found.zone(E_star)
    if h > COARSEST * zone * (1 + 1e-9):
        needed = f"as those of {COARSEST:g} times its size at most do"
        problem = f"has a cohesive zone of {zone * L:.3g}, and elements of {h * L:.3g} do not resolve it, {needed}"
        remedy = f"a range of at least {smallest:.3g}, or mesh.h_contact of at most {COARSEST * zone * L:.3g}"
        raise ConfigError("contact.adhesion.range", problem, remedy)
    expected = _expected_adhesion(found, given, zone, h)
    return expected, [Choice("contact.adhesion", found.range * L, expected.words)]


def _expected_adhesion(found: Adhesion, given: Given, zone: float, h: float) -> ExpectedAdhesion:
    """What is known of this attraction beforehand; zone, h [length]: of its cohesive zone, of the elements there."""
    from indent_sim.theory.surface.adhesion import maugis_lambda, maugis_pull_off, tabor  # with scipy's searches

    L, F, R = given.physics.scales.length, given.physics.scales.force, getattr(given.relative, "R", None)
    pull = None
    with contextlib.suppress(*UNSOLVED):
        pull = given.jkr.pull_off(inf).force if given.jkr else None
    expected = ExpectedAdhesion(zone * L, zone / h, jkr_pull_off=pull and pull * F)
    if R is None:
        return expected
    assert found.range is not None
    numbers, unit = (found.work, found.range, R, given.physics.material.E_star), pi * found.work * R
    is_alike = pull is not None and abs(pull / (-1.5 * unit) - 1) <= PULL_OFF_DIFFERENCE
    dugdale = maugis_pull_off(maugis_lambda(*numbers)) * unit * F if is_alike else None
    return replace(expected, tabor=tabor(*numbers), maugis_lambda=maugis_lambda(*numbers), maugis_pull_off=dugdale)


def _with_tangential(law: Any, unit: float, stiffness: float) -> Any:
    """The law with its epsilon_t, auto being epsilon_n; ConfigError where the surface slips that should stick."""
    law = replace(law, epsilon_t=law.stiffness) if law.epsilon_t == "auto" else law
    least = law.smallest_tangential
    if law.epsilon_t >= least * unit * (1 - 1e-9):
        return law
    given = ", or auto (epsilon_n)" if law.epsilon_t != law.stiffness else ""
    outcome = f"{law.method} loses friction, or does not converge"
    problem = f"is {law.epsilon_t / unit:.2g} E*/h_contact; below {least:g} E*/h_contact {outcome}"
    raise ConfigError("contact.epsilon_t", problem, f"at least {least * unit * stiffness:.4g}{given}")


def _stiffness(law: Any, given: Given, sizes: Sizes, fineness: Fineness | None) -> float:
    """The epsilon_n or gamma that `auto` stands for [pressure/length, without units]."""
    unit = given.physics.material.E_star / sizes.typical
    usual = float(law.auto_multiple * unit)
    if not isinstance(law, Penalty):
        return usual
    if fineness is not None:  # the penalty's error must fit into what is asked for
        return min(fineness.penalty, STIFFEST * unit)
    depths = {delta for delta in (given.deepest, given.physics.deltas[-1]) if delta > 0}
    law = replace(law, epsilon_n=usual)
    lost = [penalty_loss(law, given.physics.material, given.theory, delta, given.radius(delta)) for delta in depths]
    return min(usual * max(1.0, max(lost, default=0.0) / NEGLIGIBLE_ERROR), STIFFEST * unit)


def solver(config: Config, given: Given, physics: Physics, nodes: float) -> Choice:
    """What solves the scene; ConfigError for one that cannot.

    A linear body under a frictionless tip with a reference gap is one compliance; anything else is not.
    The compliance is dense: beyond MOST_CANDIDATES nodes that may come into contact it is not made.
    """
    wanted, law = config.solver.method, physics.contact
    size = f"{nodes:.2g} nodes may come into contact: the dense matrices need {DENSE * nodes**2 / 1e9:.2g} GB"
    obstacle = first_of(
        (not physics.small_strain, "the material is not linear"),
        (physics.gap == "current", "the gap at the deformed point makes the problem nonlinear"),
        (bool(law.uncondensed), law.uncondensed),
        (bool(physics.permeable), "the fluid's pressure lives inside the body"),
        (bool(physics.relaxing), "its shear relaxes, and its bulk modulus does not"),
        (config.solver.linear == "iterative", FOR_WHOLE),
        (nodes > MOST_CANDIDATES, f"about {size} (at most {MOST_CANDIDATES} nodes are condensed to)"),
    )
    if wanted == "condensed" and obstacle:
        raise ConfigError("solver.method", f"'condensed' does not fit this scene: {obstacle}", "use 'newton'")
    if wanted != "auto":
        return Choice("solver.method", wanted, "as given")
    why = obstacle or "linear body, reference gap: one factorisation serves every step"
    if given.truncation and (unlike := against_theory(config, given)) != why:
        why = f"{why}; not theory: {unlike}"
    return Choice("solver.method", "newton" if obstacle else "condensed", why)


def against_iterative(config: Config, physics: Physics, sizes: Sizes) -> str:
    """Why the linear systems of a scene are not solved iteratively; empty where they can be."""
    law, locked = physics.contact, physics.most_locked
    rigid = getattr(law, "stiffness", 0.0) * sizes.h_contact / physics.material.E_star
    return first_of(
        (physics.part.dim == 2, "axisymmetric and plane bodies are factored"),
        (bool(law.unsymmetric), law.unsymmetric),
        (bool(physics.permeable), "its preconditioner does not know the pressure of the fluid"),
        (bool(physics.relaxing), "a body whose shear relaxes is factored, each length of a step anew"),
        (law.multiplier in ("stress", "nodal"), f"{law.method} has a tangent that is not symmetric"),
        (locked > NEARLY_LOCKED, f"formulation: displacement at nu = {locked:g} needs too many iterations"),
        (rigid > RIGID, f"a contact of {rigid:.2g} E*/h_contact needs too many iterations"),
        (bool(physics.wall_stiffness) and not physics.small_strain, STIFF_WALL),
        (config.solver.method == "condensed", "solver.method: condensed factors the body once"),
    )


def linear(config: Config, physics: Physics, sizes: Sizes, direct: Cost, iterative: Cost, room: float) -> Choice:
    """How linear systems are solved, at these costs and with `room` for them [bytes]. ConfigError for an iterative
    solver that does not know the scene."""
    wanted, obstacle = config.solver.linear, against_iterative(config, physics, sizes)
    if wanted == "iterative" and obstacle:
        raise ConfigError("solver.linear", f"'iterative' does not fit this scene: {obstacle}", "use 'direct'")
    if wanted != "auto":
        return Choice("solver.linear", wanted, "as given")
    if obstacle:
        return Choice("solver.linear", "direct", obstacle)
    effort = [f"about {cost.seconds:.2g} s and {cost.memory / 1e9:.2g} GB" for cost in (direct, iterative)]
    is_worth_it = direct.seconds - iterative.seconds > WORTH_SECONDS
    is_cheaper = is_worth_it and iterative.seconds < CLEARLY * direct.seconds
    is_needed = direct.memory > room >= iterative.memory
    chosen = "iterative" if is_cheaper or is_needed else "direct"
    return Choice("solver.linear", chosen, f"factored {effort[0]}, iteratively {effort[1]}")


def theory(config: Config, given: Given) -> Choice | None:
    """That theory solves the scene, and why; None where a mesh does. ConfigError where theory is asked for in vain."""
    wanted = config.solver.method
    if wanted != "theory" and not (wanted == "auto" and isinstance(config.body, Endless)):
        return None
    obstacle = against_theory(config, given)
    if wanted == "theory" and obstacle:
        raise ConfigError("solver.method", f"'theory' does not fit this scene: {obstacle}", "use 'auto'")
    if obstacle or given.theory is None:
        return None
    good = "too large a force" if given.theory.pull else f"exact but for {given.theory.error:.0e} of the force"
    why = f"{given.theory.why}: {good}, nothing is meshed"
    return Choice("solver.method", "theory", f"as given; {why}" if wanted == "theory" else why)


def against_theory(config: Config, given: Given) -> str:
    """Why theory cannot give what a scene asks for; empty where it can."""
    if unlike := unlike_theory(config):
        return unlike
    known, target = given.theory, target_of(config.accuracy)
    if known is None:
        has_shape = shape_of(given.physics.indenter) is not None
        return "theory knows no layers with nu < 0" if has_shape else "theory does not know this tip"
    if not known.exact and not (known.pull and config.solver.method == "theory"):
        return known.why
    if target is not None and target < known.error:
        return f"theory is good to {known.error:.0e} of the force, and accuracy asks for {target:g}"
    if given.physics.path.control == "depth" and len(given.physics.deltas) <= MOST_KEPT:
        known.expect(given.physics.deltas)  # of which this is one
    if not known.reaches(given.deepest, given.physics.largest_force):
        return "theory ends before the deepest contact: at a wall, at the tip's end, or at 100 thicknesses"
    return ""


def unlike_theory(config: Config) -> str:
    """What a config asks for that no theory has, as far as it can be told at a look; empty where there is nothing."""
    materials, law = [layer.material for layer in config.layers if layer.material], config.contact
    solver = replace(config.solver, method="auto")
    return first_of(
        (isinstance(config.body, MeshFromFile), "theory does not know a body meshed elsewhere"),
        (not all(material.small_strain for material in materials), "the material is not linear"),
        (any(material.flow for _, material in config.materials()), "theory knows no fluid in the pores"),
        (any(material.relaxes_in_shear for _, material in config.materials()), "theory knows no shear that relaxes"),
        (bool(config.body.inclusions), NO_INCLUSIONS),
        (not config.indenter.of_revolution, f"a {config.indenter.shape} is no tip of revolution"),
        (law.gap == "current", "theory tests the gap at the undeformed point"),
        (not isinstance(law, AutoContact), f"contact.method: {law.method} is for a mesh"),
        (bool(law.beyond_theory), f"theory knows no {law.beyond_theory}"),
        (solver != type(solver)(), "linear, rtol and max_iterations of solver are for a mesh"),
        (config.mesh != type(config.mesh)(), "the settings of mesh are for one"),
        (any(material.formulation != "auto" for material in materials), "material.formulation is for a mesh"),
        (config.output.fields in ("last", "all"), f"output.fields: {config.output.fields} asks for a mesh"),
    )


def needs_mesh(config: Config) -> bool:
    """Whether a config cannot do without a mesh, as far as it can be told at a look."""
    is_for_theory = isinstance(config.body, Endless) or config.solver.method == "theory"
    return config.solver.method in ("condensed", "newton") or not is_for_theory or bool(unlike_theory(config))


def by_theory(config: Config, given: Given) -> Choices:
    """What theory solves, and what of it is written."""
    physics = given.physics
    part, target = physics.part, target_of(config.accuracy)
    peak = infinite_pressure(physics.indenter, given.a) if given.deepest > 0 else ""
    good = "theory is better than that"
    return [
        Choice("kinematics", part.kinematics.name, given.part_why),
        Choice("strain", "small", "the material is linear elastic"),
        *([Choice("control", "force", THEORY_FORCE_WHY)] if physics.path.control == "force" else []),
        Choice("contact.gap", "reference", "theory tests the gap at the undeformed point"),
        *([Choice("p_max", "empty", peak)] if peak else []),
        *([Choice("accuracy", target, good)] if target is not None else []),
        Choice("output.fields", "none", "there is no mesh to write them on"),
    ]


def mesh(config: Config, given: Given, sizes: Sizes, fineness: Fineness | None) -> Choices:
    """The element sizes, and where each comes from."""
    L, a, wanted = given.physics.scales.length, given.a, config.mesh
    per_radius = f"{a / sizes.h_contact:.3g} elements in the expected contact radius {a * L:.4g}"
    choices = [Choice("accuracy", fineness.target, fineness.why(L))] if fineness else []
    if isinstance(given.physics.part, MeshedPart):
        piece = given.physics.part.piece
        found = f"{piece.size.cells} cells, {piece.size.points} points"
        if len(piece.middles[0]):
            found += "; order 2: its midside nodes are the new corners of the first refinement"
        own = "as given" if wanted.refinements else "the mesh as it is"
        refined = Choice("mesh.refinements", sizes.refinements or 0, "each halves every edge" if fineness else own)
        finest = Choice("mesh.h_contact", sizes.h_contact * L, f"the facets' own; {per_radius}")
        return [Choice("body.file", piece.hash, found), *choices, refined, finest]
    auto = "from accuracy" if fineness else "auto: at most 0.3 % of the force at the last step"
    chosen = "as given" if wanted.h_contact != "auto" else auto
    far = "as given" if wanted.h_far != "auto" else f"sizes grow by {sizes.grading:.3g} per unit distance up to this"
    contact, axis = ("h_contact", f"{chosen}; {per_radius}"), ("h_axis", AXIS_WHY)
    reasons = (contact, axis, ("h_far", far), ("h_edge", EDGE_WHY), ("h_corner", CORNER_WHY), ("h_film", FILM_WHY))
    each = [(f"mesh.{name}", getattr(sizes, name), why) for name, why in reasons]
    choices += [Choice(key, h * L, why) for key, h, why in each if h is not None]
    if sizes.inclusions:
        inside = ", ".join(f"{h * L:.4g}" for _, h in sizes.inclusions)
        why = "as given" if wanted.h_inclusions else "by what the force feels of each; sizes grow from this around them"
        choices.append(Choice("mesh.h_inclusions", inside, why))
    if sizes.skins:
        inside = ", ".join(f"{h * L:.4g}" for _, h in sizes.skins)
        why = "as given" if wanted.h_layers else "by the thickness of each skin; sizes grow from this on both sides"
        choices.append(Choice("mesh.h_layers", inside, why))
    return choices


def follows_whole(config: Config, given: Given, solver: Choice) -> bool:
    """Whether a history is followed row by row on the whole body: no curve determines it."""
    return given.history is not None and (bool(config.contact.beyond_curve) or solver.value == "newton")


def steps(given: Given, physics: Physics, sizes: Sizes) -> Choices:
    """How long what flows and relaxes takes, and in which steps it is followed; nothing where the body is elastic."""
    if not physics.evolves or given.history is None:
        return []
    why = []
    if physics.permeable:
        times = Durations.of(given, physics, drained_face_size(physics, sizes))
        why.append(f"fluid takes {times.contact:.3g} through the contact, {times.height:.3g} through the body")
    if relaxing := [t for region in physics.part.regions if region.relaxing for t in region.relaxing.times]:
        why.append(f"shear relaxes in {min(relaxing):.3g} to {max(relaxing):.3g}")
    method = "SDIRK2" if physics.permeable else "the exponentials' own"
    why.append(f"{given.per_doubling} of each length in every piece of the history, then twice as long; {method}")
    first = first_step(given, physics, drained_face_size(physics, sizes))
    if given.history.jumps and not physics.path.jumps:
        why.append("a jump on this column has no equilibrium at once: the step after it begins before it")
    found: Choices = [Choice("time.first_step", float(f"{first:.4g}"), "; ".join(why))]
    if physics.bath_ramp:
        given_as = (
            "as given" if physics.drainage.bath_ramp != "auto" else "a 75th of what fluid takes through the contact"
        )
        words = f"a sudden bath comes evenly within this time, since at once it has no equilibrium: {given_as}"
        found.append(Choice("drainage.bath_ramp", float(f"{physics.bath_ramp:.4g}"), words))
    return found


def curve(config: Config, given: Given, solver: Choice, follows_whole: bool = False) -> Choices:
    """How what is computed from the elastic curve is, an experiment, a history, or why a history is not; ConfigError
    where a curve does not determine what is asked for."""
    if given.experiment is None and given.history is None:
        return []
    if follows_whole:
        why = solver.why if solver.value == "newton" else config.contact.beyond_curve
        _refuse_in_time(given, why)
        return [Choice("time", "steps", f"row by row on the body: {why}")]
    _refuse_curve(config, given, solver, "experiment" if given.experiment else f"loading.{config.loading.given[0]}")
    choices = [Choice("experiment.adhesion", "JKR", JKR_WHY)] if given.jkr_limit else []
    if given.history:
        why = STEP_WHY if given.is_stepped else TING_WHY if given.relaxation else QUASI_WHY
        choices.append(Choice("time", "curve", JKR_WHY if given.jkr_limit else why))
    return choices


def refuse_reactions(config: Config, why: str) -> None:
    """ConfigError where reactions are asked for and nothing says them: `why` not."""
    if config.output.reactions:
        raise ConfigError("output.reactions", f"true: there are none to write: {why}", "leave it out")


def refuse_nodal_stress(config: Config, has_fields: bool) -> None:
    """ConfigError where stresses at the nodes are asked for and no fields are written."""
    if config.output.nodal_stress and not (has_fields and config.output.fields != "none"):
        raise ConfigError("output.nodal_stress", "true: this run writes no fields", "leave it out")


def _refuse_in_time(given: Given, why: str) -> None:
    """ConfigError for what is made of a curve."""
    if given.relaxation:
        problem = f"all: is for the curve of a linear, frictionless body: {why}"
        raise ConfigError("material.relaxation.of", problem, "of: shear, or leave out what stands against the curve")
    if made := next((name for name, part in vars(given.experiment or Experiment()).items() if part), None):
        problem = f"is made of a curve, and this body is followed row by row: {why}"
        raise ConfigError(f"experiment.{made}", problem, "leave one of the two out")


def _refuse_curve(config: Config, given: Given, solver: Choice, key: str) -> None:
    physics = given.physics
    if given.history and config.output.fields in ("last", "all"):
        problem = f"{config.output.fields}: a history is followed on the elastic curve, which has no fields"
        raise ConfigError("output.fields", problem, "leave it out")
    if config.contact.beyond_curve:
        problem = "is determined by the curve of a tip without friction and adhesion, and contact has some"
        raise ConfigError(key, problem, "leave one of the two out")
    if solver.value == "newton":
        problem = f"needs a linear body whose compliance is known, and this scene is solved whole: {solver.why}"
        raise ConfigError(key, problem, "solver.method: condensed or theory says what stands against it")
    if given.jkr_limit and physics.part.kinematics.name != "axisymmetric":
        problem = f"the JKR limit is that of a disc, and this scene is {physics.part.kinematics.name.replace('_', ' ')}"
        raise ConfigError("experiment.adhesion", problem, "put the tip on the axis of a round body")
    if given.jkr_limit and not given.held_radii:
        problem = "the contact that adheres so is wider than theory reaches, or there is none at that depth"
        raise ConfigError("experiment.adhesion", problem, UNITS)
    if given.jkr_limit and solver.value == "condensed" and given.held_radii:
        _refuse_unlike_contacts(given, *given.held_radii)
    if given.is_stepped and solver.value == "theory" and physics.body.dim == 2:
        problem = "a strip that relaxes under this history is stepped in time on the compliance of a mesh"
        raise ConfigError("material.relaxation", problem, "use solver.method: condensed")


def _refuse_unlike_contacts(given: Given, smallest: float, largest: float) -> None:
    """ConfigError where no mesh holds the contacts with adhesion, from where the tip comes off to the deepest."""
    L, rim = given.physics.scales.length, given.physics.body.rim_distance(given.physics.center)
    if largest > FILLED * rim:
        problem = f"pulls the body around the tip to a radius of {largest * L:.3g}, its rim being at {rim * L:.3g}"
        raise ConfigError("experiment.adhesion.work", problem, UNITS)
    if largest > SPREAD * smallest:
        problem = f"lets the tip come off at a radius of {smallest * L:.3g}, far below the deepest, {largest * L:.3g}"
        raise ConfigError("experiment.adhesion.work", problem, "do not go as deep, or solver.method: theory")


def tip(config: Config, given: Given, gap: str) -> tuple[Indenter, Choices]:
    """The tip, with a small radius at a sharp apex or edge where the gap needs a normal everywhere; a plate in place of
    a punch that is as wide as the body."""
    if isinstance(given.physics.indenter, Plate) and isinstance(config.indenter, FlatPunch):
        return given.physics.indenter, [Choice("indenter.shape", "plate", AS_WIDE_WHY)]
    physics, body = given.physics, given.physics.body
    sharp, key = physics.indenter, "edge_radius" if isinstance(physics.indenter, FlatPunch) else "tip_radius"
    if gap == "reference" or getattr(sharp, key, 1.0) > 0:
        return sharp, []
    radius = rounded(BLUNTING * given.a)
    smooth = replace(sharp, **{key: radius})  # type: ignore[arg-type]
    theories = [layer_theory(body, given.layers, one, physics.center) for one in (sharp, smooth)]
    known = [found for one in theories if one and given.deepest > 0 and (found := one.at(given.deepest))]
    change = ""
    if len(known) == 2 and all(one.force for one in known):
        change = f", changes the force by {known[1].force / known[0].force - 1:+.1g} by layer theory"
    why = f"gap: current needs a normal everywhere; {BLUNTING:g} of the expected contact radius{change}"
    return smooth, [Choice(f"indenter.{key}", radius * physics.scales.length, why)]
