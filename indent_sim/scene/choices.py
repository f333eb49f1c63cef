"""Choices of a scene: model, gap, contact law, tip, solver and mesh, each with its reason."""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass
from math import inf, pi
from typing import TYPE_CHECKING, Any

from indent_sim.config.strict_yaml import key_text
from indent_sim.mesh.meshed import MeshedPart
from indent_sim.mesh.part import Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Endless, HalfSpace, MeshFromFile
from indent_sim.model.contact import Anchor, AugmentedLagrangian, AutoContact, Cohesion, Contact, ContactLaw, Penalty
from indent_sim.model.materials import LOCKING
from indent_sim.model.tips import FlatPunch, Indenter, reach
from indent_sim.model.units import rounded
from indent_sim.process.errors import ConfigError
from indent_sim.scene.cost import DENSE, MOST_CANDIDATES, Cost
from indent_sim.scene.doubts import FREE, STIFFEST, TELLING, penalty_loss
from indent_sim.scene.expected import NEARLY_STICK, Adherence, infinite_pressure, pulling_rim
from indent_sim.scene.fineness import Fineness, target_of
from indent_sim.scene.given import Given
from indent_sim.scene.theories import NO_INCLUSIONS, layer_theory, shape_of

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


FORCE_WHY = "forces are given: each depth is found from the curve force(depth), which has one depth for a force"
THEORY_FORCE_WHY = "forces are given: theory finds the depth of each"
CORNER_WHY = "the contact feels bonded corners or the gap up to a side: sizes grow from this with the distance"
PINS_WHY = "roller base and free sides leave rigid modes; reactions audited to be zero"
FEW = 15_000  # unknowns below which a factorisation costs next to nothing and never fails
CLEARLY = 0.8  # of a factorisation's seconds, below which iterations are chosen: a prediction is no better
NEEDLE = 1e3  # depth over a tip's radius beyond which a deformed body cannot be followed around it


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


def model(given: Given) -> list[Choice]:
    """What of the body is modelled, and how."""
    part = given.part
    body = f"{given.body.shape}, height {given.scales.length:.4g}"
    strain = ("small", "the material is linear elastic") if given.small_strain else ("finite", "it is hyperelastic")
    return [
        *([Choice("body", body, given.truncation.why)] if given.truncation else []),
        Choice("symmetry", part.symmetry, given.part_why),
        Choice("kinematics", part.kinematics.name, part.kinematics.why),
        Choice("strain", *strain),
        *([Choice("control", "force", FORCE_WHY)] if given.path.control == "force" else []),
        *([Choice("pins", len(part.pins), PINS_WHY)] if part.pins else []),
    ]


def quantities(config: Config) -> list[Choice]:
    """Quantities that carried units of their own, as they are in the scene's."""
    own = f"{config.units.length} and {config.units.force}"
    return [Choice(key_text(path), value, f"given as {text}; the scene is in {own}")
            for path, (text, value) in config.source.quantities.items()]  # fmt: skip


def formulations(given: Given) -> list[Choice]:
    """Displacements alone, or with a pressure, in each region."""
    regions = given.part.regions
    keys = [_key_of(region, alone=len(regions) == 1) for region in regions]
    return [_formulation(f"{key}.formulation", region) for key, region in zip(keys, regions, strict=True)]


def _key_of(region: Region, alone: bool) -> str:
    """Where the material of a region stands in the scene."""
    if region.name.startswith("regions."):
        return f"body.{region.name}"
    return "material" if alone or region.name == "body" else f"body.{region.name}.material"


def _formulation(key: str, region: Region) -> Choice:
    nu, sign = region.material.constants.nu, ">=" if region.formulation == "mixed" else "<"
    like = "" if region.material.is_isotropic else "as compressible as "
    why = "as given" if region.material.formulation != "auto" else f"{like}nu = {nu:.6g} {sign} {LOCKING:g}"
    return Choice(key, region.formulation, why)


def gap(wanted: Contact, given: Given) -> tuple[str, Choice]:
    """Where the gap is tested, at the undeformed or the deformed point.

    ConfigError for a gap at the deformed point that has no answer: a body that slides away, a needle.
    """
    auto = "reference" if given.small_strain else "current"
    chosen = auto if wanted.gap == "auto" else wanted.gap
    end = reach(given.tip)
    if chosen == "current" and given.deepest > NEEDLE * end:
        raise ConfigError(
            "indenter", f"the depth is {given.deepest / end:.3g} times the radius at which the tip ends: gap: current "
            "cannot tell how a body gives way to such a needle", "give both in the same unit of length",
        )  # fmt: skip
    if chosen == "current" and given.part.pins:
        raise ConfigError(
            "contact.gap", "'current' pushes sideways, and nothing holds this body there (roller base, free sides)",
            "fix the base, hold a side, use gap: reference, or put the tip in the middle and use symmetry",
        )  # fmt: skip
    reasons = {"reference": "linear elastic: Hertz' own problem, tested at the undeformed point",
               "current": "finite strain: tested at the deformed point, pressure along the tip's normal"}  # fmt: skip
    why = "as given" if wanted.gap != "auto" else reasons[chosen]
    return chosen, Choice("contact.gap", chosen, why)


def contact(wanted: Contact, given: Given, sizes: Sizes, fineness: Fineness | None) -> tuple[ContactLaw, Choice]:
    """The contact method and its stiffness [pressure/length, without units]; ConfigError for one that is too soft."""
    if isinstance(wanted, AutoContact):
        law, why = AugmentedLagrangian(), "auto: no penetration to pay for, smooth pressures, fewest iterations"
        law = dataclasses.replace(law, friction=wanted.friction, epsilon_t=given.scales.scaled(wanted).epsilon_t,
                                  adhesion=given.attraction)  # fmt: skip
    else:  # the scene says which gap
        law, why = dataclasses.replace(given.scales.scaled(wanted), gap="auto"), "as given"  # type: ignore[assignment]
    name = next((f.name for f in dataclasses.fields(law) if f.name in ("epsilon_n", "gamma")), None)
    if name is None:
        return law, Choice("contact", law.method, why)
    scales, unit = given.scales, given.material.E_star / sizes.h_contact
    value: Any = getattr(law, name)
    source = f"{name} {'auto' if value == 'auto' else 'as given'}"
    if value == "auto":
        value = rounded(_stiffness(law, given, sizes, fineness))
    _refuse_soft(law, name, value / unit, unit * scales.stiffness)
    law = dataclasses.replace(law, **{name: value})  # type: ignore[arg-type]
    if law.friction and law.epsilon_t == "auto":
        law = dataclasses.replace(law, epsilon_t=value)
    _refuse_slippery(law, unit, scales.stiffness)
    why = f"{why}; {source}: {value / unit:.3g} E*/h_contact"
    return law, Choice("contact", f"{law.method}, {name} = {value * scales.stiffness:.6g}", why)


def friction(law: ContactLaw, given: Given) -> tuple[Anchor, list[Choice]]:
    """Where new contact is taken to have touched, and what to say of friction; nothing where there is none.

    ConfigError for a scene that friction was never verified in.
    """
    if not law.friction:
        return "implicit", []
    beyond = (
        (bool(given.part.pins), "it pushes sideways, and nothing holds this body there (roller base, free sides)",
         "fix the base, hold a side, or put the tip in the middle and use symmetry"),
    )
    for applies, why, remedy in beyond:
        if applies:
            raise ConfigError("contact.friction", f"does not fit this scene: {why}", remedy)
    if law.friction != "stick" and law.friction <= FREE:
        return "implicit", [Choice("contact.friction", law.friction, "new contact sticks where its step began")]
    why = "new contact sticks where it touches on its way through the step, found in a pass without friction for it"
    return "mid", [Choice("contact.friction", law.friction, why)]


def bounded(law: Any, given: Given, sizes: Sizes) -> tuple[Any, list[Choice]]:
    """The law with friction for stick where no surface that only pushes sticks, and what to say of it."""
    rim = pulling_rim(given.tip, given.material.constants.nu, sizes, given.dim) if law.friction == "stick" else 0.0
    if not rim:
        return law, []
    why = f"stands for stick: {rim * given.scales.length:.2g} beside the sharp edge a surface that sticks would pull"
    return dataclasses.replace(law, friction=NEARLY_STICK), [Choice("contact.friction", NEARLY_STICK, why)]


COARSEST = 1.5  # elements over the cohesive zone: coarser ones jump from node to node, measured


def adhesion(law: ContactLaw, given: Given, sizes: Sizes) -> tuple[Adherence | None, list[Choice]]:
    """What to say of a tip that adheres, the number of elements in its cohesive zone; nothing where none does.

    ConfigError for a range that the elements do not resolve, and for plane strain, where it was never verified.
    """
    found = law.adhesion
    if found is None:
        return None, []
    if given.body.dim == 2:
        problem = "was never verified in plane strain"
        raise ConfigError("contact.adhesion", problem, "use an axisymmetric or a three-dimensional body")
    L, E_star, h = given.scales.length, given.material.E_star, sizes.h_contact
    smallest = found.resolved_by(h / COARSEST, E_star) * L
    if found.range is None:
        remedy = f"at least {smallest:.3g} where h_contact = {h * L:.3g}; its limit 0 is experiment.adhesion"
        raise ConfigError("contact.adhesion.range", "is missing: the distance over which the attraction acts", remedy)
    zone = found.zone(E_star)
    if h > COARSEST * zone * (1 + 1e-9):
        problem = (f"has a cohesive zone of {zone * L:.3g}, and elements of {h * L:.3g} do not resolve it, "
                   f"as those of {COARSEST:g} times its size at most do")  # fmt: skip
        remedy = f"a range of at least {smallest:.3g}, or mesh.h_contact of at most {COARSEST * zone * L:.3g}"
        raise ConfigError("contact.adhesion.range", problem, remedy)
    expected = _adherence(found, given, zone, h)
    return expected, [Choice("contact.adhesion", found.range * L, expected.words)]


ALIKE = 0.05  # of the largest pull without range: up to this difference a body pulls as a half-space does


def _adherence(found: Cohesion, given: Given, zone: float, h: float) -> Adherence:
    """What is known of this attraction beforehand; zone, h [length]: of its cohesive zone, of the elements there."""
    from indent_sim.theory.surface.adhesion import maugis_lambda, maugis_pull_off, tabor  # with scipy's searches

    L, F, R = given.scales.length, given.scales.force, getattr(given.relative, "R", None)
    pull = None
    with contextlib.suppress(ValueError, ArithmeticError):
        pull = given.jkr.pull_off(inf).force if given.jkr else None
    expected = Adherence(zone * L, zone / h, jkr_pull_off=pull and pull * F)
    if R is None:
        return expected
    assert found.range is not None
    numbers, unit = (found.work, found.range, R, given.material.E_star), pi * found.work * R
    is_alike = pull is not None and abs(pull / (-1.5 * unit) - 1) <= ALIKE
    dugdale = maugis_pull_off(maugis_lambda(*numbers)) * unit * F if is_alike else None
    return dataclasses.replace(expected, tabor=tabor(*numbers), maugis_lambda=maugis_lambda(*numbers),
                               maugis_pull_off=dugdale)  # fmt: skip


def _stiffness(law: Any, given: Given, sizes: Sizes, fineness: Fineness | None) -> float:
    """The epsilon_n or gamma that `auto` stands for [pressure/length, without units]."""
    unit = given.material.E_star / sizes.typical
    usual = float(law.auto_multiple * unit)
    if not isinstance(law, Penalty):
        return usual
    if fineness is not None:  # the penalty's error must fit into what is asked for
        return min(fineness.penalty, STIFFEST * unit)
    depths = {delta for delta in (given.deepest, given.deltas[-1]) if delta > 0}
    law = dataclasses.replace(law, epsilon_n=usual)
    lost = [penalty_loss(law, given.material, given.theory, delta, given.radius(delta)) for delta in depths]
    return min(usual * max(1.0, max(lost, default=0.0) / TELLING), STIFFEST * unit)


def _refuse_soft(law: Any, name: str, multiple: float, unit: float) -> None:
    """ConfigError for a stiffness with which the method converges to a wrong force."""
    smallest = getattr(law, "smallest_multiple", 0.0)
    if multiple < smallest * (1 - 1e-9):
        raise ConfigError(
            f"contact.{name}",
            f"is {multiple:.2g} E*/h_contact; below {smallest:g} E*/h_contact {law.method} gives wrong forces",
            f"at least {smallest * unit:.4g}, or auto ({law.auto_multiple:g} E*/h_contact)",
        )


def _refuse_slippery(law: Any, unit: float, stiffness: float) -> None:
    """ConfigError for an epsilon_t so soft that the surface slips where it should stick; unit: E*/h_contact, without
    units, whose scale is `stiffness`."""
    if not law.friction or law.epsilon_t >= law.smallest_tangential * unit * (1 - 1e-9):
        return
    given = ", or auto (epsilon_n)" if law.epsilon_t != law.stiffness else ""
    raise ConfigError(
        "contact.epsilon_t",
        f"is {law.epsilon_t / unit:.2g} E*/h_contact; below {law.smallest_tangential:g} E*/h_contact {law.method} "
        "loses friction, or does not converge",
        f"at least {law.smallest_tangential * unit * stiffness:.4g}{given}",
    )


def solver(config: Config, given: Given, law: ContactLaw, gap: str, nodes: float) -> Choice:
    """What solves the scene; ConfigError for one that cannot.

    A linear body under a frictionless tip with a reference gap is one compliance; anything else is not.

    The compliance is dense: beyond MOST_CANDIDATES nodes that may come into contact it is not made.
    """
    wanted = config.solver.method
    size = f"{nodes:.2g} nodes may come into contact: the dense matrices need {DENSE * nodes**2 / 1e9:.2g} GB"
    obstacles = [
        why
        for applies, why in (
            (not given.small_strain, "the material is not linear"),
            (gap == "current", "the gap at the deformed point makes the problem nonlinear"),
            (bool(law.uncondensed), law.uncondensed),
            (config.solver.linear == "iterative", "solver.linear: iterative is for the whole body"),
            (isinstance(law, Penalty) and bool(law.friction), "a penalty with friction is solved on the whole body"),
            (bool(config.solver.petsc), "solver.petsc options are for Newton's linear solves"),
            (nodes > MOST_CANDIDATES, f"about {size} (at most {MOST_CANDIDATES} nodes are condensed to)"),
        )
        if applies
    ]
    if wanted == "condensed" and obstacles:
        raise ConfigError("solver.method", f"'condensed' does not fit this scene: {obstacles[0]}", "use 'newton'")
    if wanted == "auto":
        wanted = "newton" if obstacles else "condensed"
        why = obstacles[0] if obstacles else "linear body, reference gap: one factorisation serves every step"
        if given.truncation and (unlike := against_theory(config, given)) != why:
            why = f"{why}; not theory: {unlike}"
        return Choice("solver.method", wanted, why)
    return Choice("solver.method", wanted, "as given")


# Beyond these a system takes so many iterations that some are not solved: 7 at nu 0.45 without a pressure, 25 at 0.495,
# 56 at 0.499, too many at 0.4999; 7 in a contact of 3e5 E*/h_contact, 10 and more steps of Newton's in one of 9e5
NEARLY_LOCKED, RIGID = 0.495, 3e5


def against_iterative(config: Config, given: Given, law: ContactLaw, sizes: Sizes) -> str:
    """Why the linear systems of a scene are not solved iteratively; empty where they can be."""
    locked = max((region.material.constants.nu for region in given.part.regions
                  if region.formulation == "displacement"), default=0.0)  # fmt: skip
    rigid = getattr(law, "stiffness", 0.0) * sizes.h_contact / given.material.E_star
    reasons = (
        (given.part.dim == 2, "axisymmetric and plane bodies are factored"),
        (bool(law.friction), "friction has a tangent that is not symmetric"),
        (law.adhesion is not None, "adhesion has a tangent that may be indefinite"),
        (law.multiplier in ("stress", "nodal"), f"{law.method} has a tangent that is not symmetric"),
        (locked > NEARLY_LOCKED, f"formulation: displacement at nu = {locked:g} needs too many iterations"),
        (rigid > RIGID, f"a contact of {rigid:.2g} E*/h_contact needs too many iterations"),
        (bool(config.solver.petsc), "solver.petsc options are for PETSc's own solvers, of systems and of steps"),
        (config.solver.method == "condensed", "solver.method: condensed factors the body once"),
    )
    return next((why for applies, why in reasons if applies), "")


def linear(config: Config, given: Given, law: ContactLaw, sizes: Sizes, direct: Cost, iterative: Cost, room: float
           ) -> Choice:  # fmt: skip
    """How linear systems are solved, at these costs and with `room` for them [bytes].

    ConfigError for an iterative solver that does not know the scene.
    """
    wanted, obstacle = config.solver.linear, against_iterative(config, given, law, sizes)
    if wanted == "iterative" and obstacle:
        raise ConfigError("solver.linear", f"'iterative' does not fit this scene: {obstacle}", "use 'direct'")
    if wanted != "auto":
        return Choice("solver.linear", wanted, "as given")
    if obstacle:
        return Choice("solver.linear", "direct", obstacle)
    is_cheaper = direct.dofs >= FEW and iterative.seconds < CLEARLY * direct.seconds
    is_needed = direct.memory > room >= iterative.memory
    chosen = "iterative" if is_cheaper or is_needed else "direct"
    return Choice("solver.linear", chosen, f"factored {_effort(direct)}, iteratively {_effort(iterative)}")


def _effort(cost: Cost) -> str:
    return f"about {cost.seconds:.2g} s and {cost.memory / 1e9:.2g} GB"


def _mesh_of_file(config: Config, part: MeshedPart, given: Given, sizes: Sizes, fineness: Fineness | None
                  ) -> list[Choice]:  # fmt: skip
    """What the file has, how often it is refined, and the sizes that are there then."""
    size, L = part.piece.size, given.scales.length
    found = f"{size.cells} cells, {size.points} points"
    if len(part.piece.middles[0]):
        found += "; order 2: its midside nodes are the new corners of the first refinement"
    why = fineness.why(L) if fineness else "as given" if config.mesh.refinements else "the mesh as it is"
    per_radius = f"{given.a / sizes.h_contact:.3g} elements in the expected contact radius {given.a * L:.4g}"
    return [
        Choice("body.file", part.piece.hash, found),
        *([Choice("accuracy", fineness.target, why)] if fineness else []),
        Choice("mesh.refinements", sizes.refinements or 0, "each halves every edge" if fineness else why),
        Choice("mesh.h_contact", sizes.h_contact * L, f"the facets' own; {per_radius}"),
    ]


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
        return "theory knows no layers with nu < 0" if shape_of(given.tip) else "theory does not know this tip"
    if not known.exact and not (known.pull and config.solver.method == "theory"):
        return known.why
    if target is not None and target < known.error:
        return f"theory is good to {known.error:.0e} of the force, and accuracy asks for {target:g}"
    if not known.reaches(given.path, given.deepest):
        return "theory ends before the deepest contact: at a wall, at the tip's end, or at 100 thicknesses"
    return ""


def unlike_theory(config: Config) -> str:
    """What a config asks for that no theory has, as far as it can be told at a look; empty where there is nothing."""
    materials = [layer.material for layer in config.layers if layer.material]
    solver = dataclasses.replace(config.solver, method="auto")
    reasons = (
        (isinstance(config.body, MeshFromFile), "theory does not know a body meshed elsewhere"),
        (not all(material.small_strain for material in materials), "the material is not linear"),
        (bool(config.body.inclusions), NO_INCLUSIONS),
        (not config.indenter.of_revolution, f"a {config.indenter.shape} is no tip of revolution"),
        (config.contact.gap == "current", "theory tests the gap at the undeformed point"),
        (not isinstance(config.contact, AutoContact), f"contact.method: {config.contact.method} is for a mesh"),
        (bool(config.contact.friction), "theory knows no friction"),
        (config.contact.adhesion is not None, "theory knows no attraction with a range"),
        (solver != type(solver)(), "linear, rtol, max_iterations and petsc of solver are for a mesh"),
        (config.mesh != type(config.mesh)(), "the settings of mesh are for one"),
        (any(material.formulation != "auto" for material in materials), "material.formulation is for a mesh"),
        (config.output.fields in ("last", "all"), f"output.fields: {config.output.fields} asks for a mesh"),
    )
    return next((why for applies, why in reasons if applies), "")


def needs_mesh(config: Config) -> bool:
    """Whether a config cannot do without a mesh, as far as it can be told at a look."""
    is_for_theory = isinstance(config.body, Endless) or config.solver.method == "theory"
    return config.solver.method in ("condensed", "newton") or not is_for_theory or bool(unlike_theory(config))


def by_theory(config: Config, given: Given) -> list[Choice]:
    """What theory solves, and what of it is written."""
    part, target = given.part, target_of(config.accuracy)
    peak = infinite_pressure(given.tip, given.a) if given.deepest > 0 else ""
    good = "theory is better than that"
    return [
        Choice("kinematics", part.kinematics.name, given.part_why),
        Choice("strain", "small", "the material is linear elastic"),
        *([Choice("control", "force", THEORY_FORCE_WHY)] if given.path.control == "force" else []),
        Choice("contact.gap", "reference", "theory tests the gap at the undeformed point"),
        *([Choice("p_max", "empty", peak)] if peak else []),
        *([Choice("accuracy", target, good)] if target is not None else []),
        Choice("output.fields", "none", "there is no mesh to write them on"),
    ]


def mesh(config: Config, given: Given, sizes: Sizes, fineness: Fineness | None) -> list[Choice]:
    """The element sizes, and where each comes from."""
    L, a, wanted = given.scales.length, given.a, config.mesh
    if isinstance(given.part, MeshedPart):
        return _mesh_of_file(config, given.part, given, sizes, fineness)
    per_radius = f"{a / sizes.h_contact:.3g} elements in the expected contact radius {a * L:.4g}"
    auto = "from accuracy" if fineness else "auto: at most 0.3 % of the force at the last step"
    chosen = "as given" if wanted.h_contact != "auto" else auto
    far = "as given" if wanted.h_far != "auto" else f"sizes grow by {sizes.grading:.3g} per unit distance up to this"
    choices = [
        *([Choice("accuracy", fineness.target, fineness.why(L))] if fineness else []),
        Choice("mesh.h_contact", sizes.h_contact * L, f"{chosen}; {per_radius}"),
        *([Choice("mesh.h_axis", sizes.h_axis * L, "sizes grow from this at the axis to h_contact where the deepest "
                  "contact ends")] if sizes.h_axis else []),
        Choice("mesh.h_far", sizes.h_far * L, far),
    ]  # fmt: skip
    if sizes.h_edge is not None:
        choices.append(Choice("mesh.h_edge", sizes.h_edge * L, "the pressure is singular at the punch's sharp edge"))
    if sizes.h_corner is not None:
        choices.append(Choice("mesh.h_corner", sizes.h_corner * L, CORNER_WHY))
    if sizes.inclusions:
        inside = ", ".join(f"{h * L:.4g}" for _, h in sizes.inclusions)
        why = "as given" if wanted.h_inclusions else "by what the force feels of each; sizes grow from this around them"
        choices.append(Choice("mesh.h_inclusions", inside, why))
    return choices


JKR_WHY = "the JKR limit: exact for this body where the attraction's range is short"
TING_WHY = "Lee & Radok while the contact grows, Ting while it shrinks: exact for one body or layers that relax alike"
STEP_WHY = "contact stepped in time on the compliance, to 1e-4: the history is no single cycle of depths"
QUASI_WHY = "every point an equilibrium of the elastic curve"


def experiment(config: Config, given: Given, solver: Choice) -> list[Choice]:
    """How what is computed from the solved curve is; ConfigError where a curve does not determine it."""
    found = given.experiment
    if found is None:
        return []
    _refuse_experiment(config, given, solver)
    choices = [Choice("experiment.adhesion", "JKR", JKR_WHY)] if found.adhesion else []
    if found.relaxation and found.points:
        stepped = found.is_stepped
        choices.append(Choice("experiment.relaxation", "time steps" if stepped else "quadrature",
                              STEP_WHY if stepped else TING_WHY))  # fmt: skip
    elif found.points and not found.adhesion:
        choices.append(Choice("experiment.history", "elastic", QUASI_WHY))
    return choices


def _refuse_experiment(config: Config, given: Given, solver: Choice) -> None:
    assert given.experiment is not None
    if any(getattr(config.contact, name, None) for name in ("friction", "adhesion")):
        problem = "is determined by the curve of a tip without friction and adhesion, and contact has some"
        raise ConfigError("experiment", problem, "leave one of the two out")
    if solver.value == "newton":
        problem = f"needs a linear body whose compliance is known, and this scene is solved whole: {solver.why}"
        raise ConfigError("experiment", problem, "solver.method: condensed or theory says what stands against it")
    if given.experiment.adhesion and given.part.kinematics.name != "axisymmetric":
        problem = f"the JKR limit is that of a disc, and this scene is {given.part.kinematics.name.replace('_', ' ')}"
        raise ConfigError("experiment.adhesion", problem, "put the tip on the axis of a round body")
    if given.experiment.adhesion and not given.adhesive:
        problem = "the contact that adheres so is wider than theory reaches, or there is none at that depth"
        raise ConfigError("experiment.adhesion", problem, "check work, R and E: are they in the same units?")
    if given.experiment.adhesion and solver.value == "condensed" and given.adhesive:
        _refuse_unlike_contacts(given, *given.adhesive)
    if given.experiment.is_stepped and solver.value == "theory" and given.body.dim == 2:
        problem = "a strip that relaxes under this history is stepped in time on the compliance of a mesh"
        raise ConfigError("experiment.relaxation", problem, "use solver.method: condensed")


SPREAD, FILLED = 500.0, 0.95  # of a mesh: between its contacts that come off and the deepest; of the way to the rim


def _refuse_unlike_contacts(given: Given, smallest: float, largest: float) -> None:
    """ConfigError where no mesh holds the contacts with adhesion, from where the tip comes off to the deepest."""
    L, rim = given.scales.length, given.body.rim_distance(given.center)
    if largest > FILLED * rim:
        problem = f"pulls the body around the tip to a radius of {largest * L:.3g}, its rim being at {rim * L:.3g}"
        raise ConfigError("experiment.adhesion.work", problem, "check work, R and E: are they in the same units?")
    if largest > SPREAD * smallest:
        problem = f"lets the tip come off at a radius of {smallest * L:.3g}, far below the deepest, {largest * L:.3g}"
        raise ConfigError("experiment.adhesion.work", problem, "do not go as deep, or solver.method: theory")


BLUNTING = 1e-3  # of the expected contact radius: the radius that a sharp apex or edge gets


def tip(given: Given, gap: str) -> tuple[Indenter, list[Choice]]:
    """The tip, with a small radius at a sharp apex or edge where the gap needs a normal everywhere."""
    sharp, key = given.tip, "edge_radius" if isinstance(given.tip, FlatPunch) else "tip_radius"
    if gap == "reference" or getattr(sharp, key, 1.0) > 0:
        return sharp, []
    radius = rounded(BLUNTING * given.a)
    smooth = dataclasses.replace(sharp, **{key: radius})  # type: ignore[arg-type]
    before, after = (_force(given, one) for one in (sharp, smooth))
    change = f", changes the force by {after / before - 1:+.1g} by layer theory" if before and after else ""
    why = f"gap: current needs a normal everywhere; {BLUNTING:g} of the expected contact radius{change}"
    return smooth, [Choice(f"indenter.{key}", radius * given.scales.length, why)]


def _force(given: Given, tip: Indenter) -> float | None:
    """Layer theory's force of a tip at the deepest point."""
    assert not isinstance(given.body, HalfSpace)  # on which gap: current is solved on a finite body
    theory = layer_theory(given.body, given.layers, tip, given.center)
    with contextlib.suppress(ArithmeticError):
        solution = theory.at(given.deepest) if theory and given.deepest > 0 else None
        return solution.force if solution else None
    return None
