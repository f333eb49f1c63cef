"""Choices of a scene: model, gap, contact law, tip, solver and mesh, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from indent_sim.config.strict_yaml import key_text
from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.model_domain import Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.materials import LOCKING_POISSON_RATIO
from indent_sim.process.errors import ConfigError
from indent_sim.scene.diffusion_times import DiffusionTimes
from indent_sim.scene.history_path import first_step
from indent_sim.scene.peak_pressure import infinite_pressure_reason
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import MeshResolution, target_error

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

FORCE_WHY = (
    "forces are given: each depth is found from the curve force(depth), which has "
    "one depth for a force"
)
THEORY_FORCE_WHY = "forces are given: theory finds the depth of each"
EDGE_WHY = "the pressure is singular at the punch's sharp edge"
AXIS_WHY = "sizes grow from this at the axis to h_contact where the deepest contact ends"
FILM_WHY = (
    "at drained faces the fluid's pressure changes within a film as thin as (D "
    "t)^(1/2) at the first rows"
)
CORNER_WHY = (
    "the contact feels bonded corners or the gap up to a side: sizes grow from this "
    "with the distance"
)


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


Choices = list[Choice]


def model_choices(setup: ProblemSetup) -> Choices:
    """What of the body is modelled, and how."""
    physics = setup.physics
    domain = physics.domain
    body = f"{physics.body.shape}, height {physics.scales.length:.4g}"
    pinned = "roller base and free sides leave rigid modes; reactions audited to be zero"
    strain = (
        ("small", "the material is linear elastic")
        if physics.small_strain
        else ("finite", "it is hyperelastic")
    )
    return [
        *([Choice("body", body, setup.truncation.why)] if setup.truncation else []),
        Choice("symmetry", domain.symmetry, setup.domain_reason),
        Choice("kinematics", domain.kinematics.name, domain.kinematics.reason),
        Choice("strain", *strain),
        *([Choice("control", "force", FORCE_WHY)] if physics.path.control == "force" else []),
        *(
            [Choice("surface", "held", _surface_membrane_reason(physics))]
            if physics.is_drop
            else []
        ),
        *([Choice("pins", len(domain.pins), pinned)] if domain.pins else []),
    ]


def _surface_membrane_reason(physics: ProblemDefinition) -> str:
    """Why the surface of a drop is held in its plane."""
    number = f"gamma/(mu R) = {physics.drop_number:.3g}: little but its tension holds the surface"
    return (
        f"{number}, whose points a membrane of 0.001 gamma keeps apart, which adds up to "
        "0.05 % to the force"
    )


def quantities(config: Config) -> Choices:
    """Quantities that carried units of their own, as they are in the scene's."""
    scene_units = f"{config.units.length} and {config.units.force}"
    stated_quantities = [
        (key_text(path), value, text) for path, (text, value) in config.source.quantities.items()
    ]
    return [
        Choice(key, value, f"given as {text}; the scene is in {scene_units}")
        for key, value, text in stated_quantities
    ]


def formulations(setup: ProblemSetup) -> Choices:
    """Displacements alone, or with a pressure, in each region."""
    regions = setup.physics.domain.regions
    return [_formulation(region, len(regions) == 1) for region in regions]


def _formulation(region: Region, is_alone: bool) -> Choice:
    key = "material" if is_alone or region.name == "body" else f"body.{region.name}.material"
    key = f"body.{region.name}" if region.name.startswith("regions.") else key
    nu = region.softest_constants.nu
    sign = ">=" if region.formulation == "mixed" else "<"
    state_text = "" if region.material.is_isotropic else "as compressible as "
    state_text = "its shear relaxes to " if region.min_shear_fraction < 1 else state_text
    why = (
        "as given"
        if region.material.formulation != "auto"
        else f"{state_text}nu = {nu:.6g} {sign} {LOCKING_POISSON_RATIO:g}"
    )
    return Choice(f"{key}.formulation", region.formulation, why)


def theory_choices(config: Config, setup: ProblemSetup) -> Choices:
    """What theory solves, and what of it is written."""
    physics = setup.physics
    domain = physics.domain
    target = target_error(config.accuracy)
    peak_reason = infinite_pressure_reason(physics.indenter, setup.a) if setup.max_depth > 0 else ""
    accuracy_text = "theory is better than that"
    return [
        Choice("kinematics", domain.kinematics.name, setup.domain_reason),
        Choice("strain", "small", "the material is linear elastic"),
        *(
            [Choice("control", "force", THEORY_FORCE_WHY)]
            if physics.path.control == "force"
            else []
        ),
        Choice("contact.gap", "reference", "theory tests the gap at the undeformed point"),
        *([Choice("p_max", "empty", peak_reason)] if peak_reason else []),
        *([Choice("accuracy", target, accuracy_text)] if target is not None else []),
        Choice("output.fields", "none", "there is no mesh to write them on"),
    ]


def mesh(
    config: Config, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> Choices:
    """The element sizes, and where each comes from."""
    L = setup.physics.scales.length
    a = setup.a
    settings = config.mesh
    elements_text = f"{a / sizes.h_contact:.3g} elements in the expected contact radius {a * L:.4g}"
    choices = [Choice("accuracy", fineness.target, fineness.why(L))] if fineness else []
    if isinstance(setup.physics.domain, ImportedDomain):
        imported_mesh = setup.physics.domain.mesh
        mesh_text = (
            f"{imported_mesh.statistics.cells} cells, {imported_mesh.statistics.points} points"
        )
        if len(imported_mesh.midside_nodes[0]):
            mesh_text += "; order 2: its midside nodes are the new corners of the first refinement"
        refinement_reason = "as given" if settings.refinements else "the mesh as it is"
        refinements_choice = Choice(
            "mesh.refinements",
            sizes.refinements or 0,
            "each halves every edge" if fineness else refinement_reason,
        )
        size_choice = Choice(
            "mesh.h_contact", sizes.h_contact * L, f"the facets' own; {elements_text}"
        )
        return [
            Choice("body.file", imported_mesh.hash, mesh_text),
            *choices,
            refinements_choice,
            size_choice,
        ]
    auto = "from accuracy" if fineness else "auto: at most 0.3 % of the force at the last step"
    contact_reason = "as given" if settings.h_contact != "auto" else auto
    far_reason = (
        "as given"
        if settings.h_far != "auto"
        else f"sizes grow by {sizes.grading:.3g} per unit distance up to this"
    )
    contact = ("h_contact", f"{contact_reason}; {elements_text}")
    axis = ("h_axis", AXIS_WHY)
    reasons = (
        contact,
        axis,
        ("h_far", far_reason),
        ("h_edge", EDGE_WHY),
        ("h_corner", CORNER_WHY),
        ("h_film", FILM_WHY),
    )
    named_sizes = [(f"mesh.{name}", getattr(sizes, name), why) for name, why in reasons]
    choices += [Choice(key, h * L, why) for key, h, why in named_sizes if h is not None]
    if sizes.inclusions:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.inclusions)
        why = (
            "as given"
            if settings.h_inclusions
            else "by what the force feels of each; sizes grow from this around them"
        )
        choices.append(Choice("mesh.h_inclusions", sizes_text, why))
    if sizes.coatings:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.coatings)
        why = (
            "as given"
            if settings.h_layers
            else "by the thickness of each skin; sizes grow from this on both sides"
        )
        choices.append(Choice("mesh.h_layers", sizes_text, why))
    return choices


def is_followed_on_body(config: Config, setup: ProblemSetup, solver: Choice) -> bool:
    """Whether a history is followed row by row on the whole body: no curve determines it."""
    return setup.history is not None and (
        bool(config.contact.reason_no_elastic_curve) or solver.value == "newton"
    )


def time_steps(setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes) -> Choices:
    """How long what flows and relaxes takes, and in which steps it is followed; nothing where the
    body is elastic.
    """
    if not physics.is_time_dependent or setup.history is None:
        return []
    reasons = []
    if physics.permeable_regions:
        times = DiffusionTimes.compute(setup, physics, sizes.h_contact)
        reasons.append(
            f"fluid takes {times.contact:.3g} through the contact, {times.height:.3g} through "
            "the body"
        )
    if relaxing := [
        t
        for region in physics.domain.regions
        if region.relaxation_series
        for t in region.relaxation_series.times
    ]:
        reasons.append(f"shear relaxes in {min(relaxing):.3g} to {max(relaxing):.3g}")
    method = "SDIRK2" if physics.permeable_regions else "the exponentials' own"
    reasons.append(
        f"{setup.steps_per_doubling} of each length in every piece of the history, then twice "
        f"as long; {method}"
    )
    first = first_step(setup, physics, sizes.h_contact)
    if setup.history.has_jumps and not physics.path.has_jumps:
        reasons.append(
            "a jump on this column has no equilibrium at once: the step after it begins before it"
        )
    choices_made: Choices = [Choice("time.first_step", float(f"{first:.4g}"), "; ".join(reasons))]
    if physics.bath_ramp:
        given_as = (
            "as given"
            if physics.drainage.bath_ramp != "auto"
            else "a 75th of what fluid takes through the contact"
        )
        reason = (
            "a sudden bath comes evenly within this time, since at once it has no "
            f"equilibrium: {given_as}"
        )
        choices_made.append(Choice("drainage.bath_ramp", float(f"{physics.bath_ramp:.4g}"), reason))
    return choices_made


def refuse_reactions(config: Config, why: str) -> None:
    """ConfigError where reactions are asked for and nothing says them: `why` not."""
    if config.output.reactions:
        raise ConfigError(
            "output.reactions", f"true: there are none to write: {why}", "leave it out"
        )


def refuse_nodal_stress(config: Config, has_fields: bool) -> None:
    """ConfigError where stresses at the nodes are asked for and no fields are written."""
    if config.output.nodal_stress and not (has_fields and config.output.fields != "none"):
        raise ConfigError("output.nodal_stress", "true: this run writes no fields", "leave it out")
