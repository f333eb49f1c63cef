"""Choices of a scene for the model, the mesh and the time steps, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from indent_sim.config.strict_yaml import key_text
from indent_sim.mesh.imported_domain import ImportedDomain
from indent_sim.mesh.model_domain import Region
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.measured_constants import LOCKING_POISSON_RATIO
from indent_sim.process.errors import ConfigError
from indent_sim.scene.diffusion_times import DiffusionTimes, drained_face_size
from indent_sim.scene.history_path import first_step
from indent_sim.scene.peak_pressure import infinite_pressure_reason
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import MeshResolution, target_error

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


@dataclass(frozen=True)
class Choice:
    """Decision of the program, or of the user, with its reason."""

    key: str
    value: str | float | int
    why: str


Choices = list[Choice]


def model_choices(setup: ProblemSetup) -> Choices:
    """Return the choices of body, symmetry, kinematics, strain, load control and constraints."""
    physics = setup.physics
    domain = physics.domain
    body = f"{physics.body.shape}, height {physics.scales.length:.4g}"
    pinned = (
        "on a roller base and with free sides the body could move as a rigid body, which pins "
        "prevent; the run checks that the reactions of the pins vanish"
    )
    if domain.rests_on_flat:
        pinned = (
            "the point at half of the height on the axis is held by a soft spring, which "
            "permits the motion of the body"
        )
    resting = (
        "two contacts, coupled by the compliance of the body, each with its own radius; the flat "
        "is rigid and without friction, and delta is the approach of tip and flat"
    )
    kind = "linear elastic" if physics.small_strain else "hyperelastic"
    plastic = f", and yields{_onset_text(setup)}" if physics.yields else ""
    strain = ("small" if physics.small_strain else "finite", f"the material is {kind}{plastic}")
    force_reason = (
        "forces are prescribed: the depth of each force is found by load control, which assumes "
        "that the force increases with the depth"
    )
    return [
        *([Choice("body", body, setup.truncation.why)] if setup.truncation else []),
        Choice("symmetry", domain.symmetry, setup.domain_reason),
        Choice("kinematics", domain.kinematics.name, domain.kinematics.reason),
        Choice("strain", *strain),
        *([Choice("control", "force", force_reason)] if physics.path.control == "force" else []),
        *(
            [Choice("surface", "held", _surface_membrane_reason(physics))]
            if physics.is_drop
            else []
        ),
        *([Choice("pins", len(domain.pins), pinned)] if domain.pins else []),
        *([Choice("body.base", "unbonded", resting)] if domain.rests_on_flat else []),
    ]


def _onset_text(setup: ProblemSetup) -> str:
    """Return the end of a sentence on the depth at which the body yields; "" if it is unknown."""
    onset = setup.yielding.onset if setup.yielding else None
    if onset is None:
        return ""
    if onset.delta == 0:
        return " from the first contact on, since the tip is sharp"
    depth = onset.delta * setup.physics.scales.depth
    return f" from the depth {depth:.4g} on (Hertz and von Mises)"


def side_force_choices(physics: ProblemDefinition) -> Choices:
    """Return the side forces that have no column in the result table, with the reasons."""
    own_wall = (
        "the roller wall through the tip is a mirror plane, and the mirror image of the body "
        "exerts the opposite side force; all other forces are those on the body without its image"
    )
    part = "zero by symmetry: a mirror plane of body and tip is normal to this axis"
    return [
        Choice(f"side_force_{axis}", "none", own_wall if is_own_wall else part)
        for axis, is_own_wall in physics.missing_side_forces.items()
    ]


def _surface_membrane_reason(physics: ProblemDefinition) -> str:
    """Return the reason for the membrane that stabilizes the surface of a drop in its plane."""
    number = f"gamma/(mu R) = {physics.drop_number:.3g}: surface tension dominates the elasticity"
    return (
        f"{number}; a membrane of stiffness 0.001 gamma keeps the surface nodes apart and adds up "
        "to 0.05 % to the force"
    )


def quantities(config: Config) -> Choices:
    """Return the quantities that were given with units, converted to the units of the scene."""
    scene_units = f"{config.units.length} and {config.units.force}"
    stated_quantities = [
        (key_text(path), value, text) for path, (text, value) in config.source.quantities.items()
    ]
    return [
        Choice(key, value, f"given as {text}; the units of the scene are {scene_units}")
        for key, value, text in stated_quantities
    ]


def formulations(setup: ProblemSetup) -> Choices:
    """Return the element formulation of each region: displacement or mixed."""
    regions = setup.physics.domain.regions
    return [_formulation(region, len(regions) == 1) for region in regions]


def _formulation(region: Region, is_alone: bool) -> Choice:
    """Return the formulation of a region; `is_alone` is True if the body has no other region."""
    key = "material" if is_alone or region.name == "body" else f"body.{region.name}.material"
    key = f"body.{region.name}" if region.name.startswith("regions.") else key
    nu = region.softest_constants.nu
    sign = ">=" if region.formulation == "mixed" else "<"
    state_text = "" if region.material.is_isotropic else "compressibility equivalent to "
    if region.min_shear_fraction < 1:
        state_text = "after relaxation of the shear modulus "
    why = (
        "as given"
        if region.material.formulation != "auto"
        else f"{state_text}nu = {nu:.6g} {sign} {LOCKING_POISSON_RATIO:g}"
    )
    return Choice(f"{key}.formulation", region.formulation, why)


def theory_choices(config: Config, setup: ProblemSetup) -> Choices:
    """Return the choices of a scene that is solved by theory."""
    physics = setup.physics
    domain = physics.domain
    target = target_error(config.accuracy)
    peak_reason = infinite_pressure_reason(physics.indenter, setup.a) if setup.max_depth > 0 else ""
    accuracy_text = "the theory is more accurate than requested"
    return [
        Choice("kinematics", domain.kinematics.name, setup.domain_reason),
        Choice("strain", "small", "the material is linear elastic"),
        *(
            [Choice("control", "force", "forces are prescribed: theory finds the depth of each")]
            if physics.path.control == "force"
            else []
        ),
        Choice("contact.gap", "reference", "the theory evaluates the gap at the undeformed point"),
        *([Choice("p_max", "empty", peak_reason)] if peak_reason else []),
        *([Choice("accuracy", target, accuracy_text)] if target is not None else []),
        Choice("output.fields", "none", "theory solves the scene without a mesh"),
    ]


def mesh(
    config: Config, setup: ProblemSetup, sizes: Sizes, fineness: MeshResolution | None
) -> Choices:
    """Return the element sizes as choices, each with its origin.

    Parameters
    ----------
    config : Config
        The scene file.
    setup : ProblemSetup
        The nondimensional problem.
    sizes : Sizes
        The chosen element sizes, nondimensional.
    fineness : MeshResolution or None
        The mesh resolution that the requested `accuracy` requires; None without `accuracy`.

    Returns
    -------
    list of Choice
        Sizes in the user's unit of length.
    """
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
            mesh_text += "; order 2: its midside nodes become vertices of the first refinement"
        refinement_reason = "as given" if settings.refinements else "the mesh is not refined"
        refinements_choice = Choice(
            "mesh.refinements",
            sizes.refinements or 0,
            "chosen for the given accuracy; each refinement halves every edge"
            if fineness
            else refinement_reason,
        )
        size_choice = Choice(
            "mesh.h_contact",
            sizes.h_contact * L,
            f"size of the facets of the mesh; {elements_text}",
        )
        return [
            Choice("body.file", imported_mesh.hash, mesh_text),
            *choices,
            refinements_choice,
            size_choice,
        ]
    auto = (
        "from accuracy"
        if fineness
        else "auto: discretisation error of at most 0.3 % of the force at the last step"
    )
    contact_reason = "as given" if settings.h_contact != "auto" else auto
    far_reason = (
        "as given"
        if settings.h_far != "auto"
        else f"the element size grows by {sizes.grading:.3g} per unit distance up to this value"
    )
    base_reason = "contact with the flat below: as many elements as in the contact with the tip"
    contact = ("h_contact", f"{contact_reason}; {elements_text}")
    axis = (
        "h_axis",
        "element sizes grow from this value at the axis to h_contact at the edge of the deepest "
        "contact",
    )
    reasons = (
        contact,
        axis,
        ("h_far", far_reason),
        ("h_base", base_reason),
        ("h_edge", "the pressure is singular at the sharp edge of the punch"),
        (
            "h_corner",
            "bonded corners, or a narrow gap between contact and side, affect the contact: element "
            "sizes grow with the distance from them",
        ),
        (
            "h_film",
            "at drained faces the pore pressure changes within a boundary layer of thickness "
            "(D t)^(1/2) at the first rows",
        ),
    )
    named_sizes = [(f"mesh.{name}", getattr(sizes, name), why) for name, why in reasons]
    choices += [Choice(key, h * L, why) for key, h, why in named_sizes if h is not None]
    if sizes.inclusions:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.inclusions)
        why = (
            "as given"
            if settings.h_inclusions
            else "chosen for the effect of each inclusion on the force; element sizes grow "
            "with the distance from it"
        )
        choices.append(Choice("mesh.h_inclusions", sizes_text, why))
    if sizes.coatings:
        sizes_text = ", ".join(f"{h * L:.4g}" for _, h in sizes.coatings)
        why = (
            "as given"
            if settings.h_layers
            else (
                "chosen for the thickness of each coating; element sizes grow from this "
                "value on both sides"
            )
        )
        choices.append(Choice("mesh.h_layers", sizes_text, why))
    return choices


def follows_history(config: Config, setup: ProblemSetup, solver: Choice) -> bool:
    """True if the load path is a history that does not follow from an elastic curve."""
    return setup.history is not None and (
        bool(config.contact.reason_no_elastic_curve) or solver.value == "newton"
    )


def time_steps(setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes) -> Choices:
    """Return choices of the first time step and the relaxation times; empty for an elastic body."""
    if not physics.is_time_dependent or setup.history is None:
        return []
    reasons = []
    if physics.permeable_regions:
        times = DiffusionTimes.compute(setup, physics, drained_face_size(physics, sizes))
        reasons.append(
            f"diffusion takes {times.contact:.3g} over the contact radius, {times.height:.3g} over "
            "the height of the body"
        )
    if relaxing := [
        t
        for region in physics.domain.regions
        if region.relaxation_series
        for t in region.relaxation_series.times
    ]:
        reasons.append(
            f"the shear modulus relaxes in times of {min(relaxing):.3g} to {max(relaxing):.3g}"
        )
    if physics.creeps:
        reasons.append(
            "a hundredth of the shortest segment of the history, because the body creeps"
        )
    method = physics.time_integration
    if method == "exponentials":
        method = "exact integration of the Prony exponentials"
    reasons.append(
        f"in every segment of the history {setup.steps_per_doubling} steps of this length, then as "
        f"many of twice the length, and so on; time integration: {method}"
    )
    first = first_step(setup, physics, drained_face_size(physics, sizes))
    if setup.history.has_jumps and not physics.path.has_jumps:
        reasons.append(
            "this body has no equilibrium directly after a jump, before fluid has left it: the "
            "jump takes place within the first time step"
        )
    choices_made: Choices = [Choice("time.first_step", float(f"{first:.4g}"), "; ".join(reasons))]
    if physics.bath_ramp:
        given_as = (
            "as given"
            if physics.drainage.bath_ramp != "auto"
            else "1/75 of the time of diffusion over the contact radius (or height, if smaller)"
        )
        reason = (
            f"{given_as}; a sudden change of the bath is applied linearly over this time, since "
            "Newton's method finds no equilibrium for an instantaneous one"
        )
        choices_made.append(Choice("drainage.bath_ramp", float(f"{physics.bath_ramp:.4g}"), reason))
    return choices_made


def refuse_reactions(config: Config, why: str) -> None:
    """Raise ConfigError if reactions are requested; `why` explains why they do not exist."""
    if config.output.reactions:
        raise ConfigError("output.reactions", f"no reactions can be written: {why}", "leave it out")


def refuse_nodal_stress(config: Config, has_fields: bool) -> None:
    """Raise ConfigError if nodal stresses are requested but no fields are written."""
    if config.output.nodal_stress and not (has_fields and config.output.fields != "none"):
        raise ConfigError("output.nodal_stress", "this run writes no fields", "leave it out")
