"""Problem setup: a scene with model domain and theory, before mesh and solver are chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from math import isfinite, log2
from typing import TYPE_CHECKING

from indent_sim.mesh.imported_mesh import ImportedMesh
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.model.adhesion import Adhesion
from indent_sim.model.body import Body
from indent_sim.model.experiment import Experiment, JKRAdhesion
from indent_sim.model.history import History
from indent_sim.model.imported_body import ImportedBody, MeshFromFile
from indent_sim.model.layers import Layer
from indent_sim.model.load_path import LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.spherical_bodies import CurvedBody, SphericalBody
from indent_sim.model.tip_track import TipTrack
from indent_sim.model.tips import FlatPunch, Indenter, Paraboloid, Plate
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.units import Scales, round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene.compression_theory import RADIUS_TOLERANCE, covers_top
from indent_sim.scene.depth_limits import (
    Center,
    check_scene,
    expected_depths,
    expected_radius,
    path_to_max_depth,
)
from indent_sim.scene.domain_truncation import Truncation, expected_depth, truncate
from indent_sim.scene.imported_body import (
    imported_model_domain,
    position_imported_mesh,
    read_mesh_file,
)
from indent_sim.scene.limiting_elastic_laws import relaxed_law, undrained_law
from indent_sim.scene.prescribed_history import (
    CurveMethod,
    curve_method,
    remaining_modulus_fraction,
    time_steps_per_doubling,
)
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.reference_theory import adhesive_radii, relative_tip, theory_of
from indent_sim.scene.regions import (
    Layers,
    elastic_layers,
    inclusion_regions,
    layer_material,
    layer_regions,
    least_shear_fraction,
    round_lengths,
)
from indent_sim.scene.resolution import target_error
from indent_sim.scene.swelling import max_surface_rise, nondimensional_drainage
from indent_sim.scene.symmetry_reduction import reduce
from indent_sim.scene.yield_increments import (
    MAX_INCREMENTS,
    increment_count,
    with_yield_increments,
)
from indent_sim.scene.yielding_contact import YieldingContact, yielding_contact
from indent_sim.theory.solution import Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.theory.adhesion import Jkr


# Gap, in ranges of the attraction, beyond which a thousandth of the work of adhesion remains.
ATTRACTION_CUTOFF = 7.0


@dataclass(frozen=True)
class ProblemSetup:
    """Nondimensional problem before mesh and solver are chosen, with the predictions of theory.

    Attributes
    ----------
    physics : ProblemDefinition
        The problem with the contact conditions of the reference theory.
    truncation : Truncation or None
        The finite body in place of an unbounded body.
    layers : tuple of Layer
        Layers from the top, each with its thickness and material.
    relative_tip : Indenter
        The equivalent tip: over a flat body it has the gap that the real tip has over the curved
        one.
    domain_reason : str
        The reason for the symmetry of the model domain.
    theory : Theory or None
        The reference theory.
    experiment : Experiment or None
        The section `experiment`, nondimensional.
    history : History or None
        The prescribed history, nondimensional. `physics.path` then leads to its largest depth.
    relaxation : Relaxation or None
        Relaxation of the whole body.
    steps_per_doubling : int
        Number of time steps before the step size doubles.
    attraction : Adhesion or None
        Adhesion of the contact law.
    theory_without_tension : Theory or None
        The theory of the same body without surface tension.
    surface_rise : float
        The largest rise of the surface of a gel that swells without load [length].
    expected_radius : callable
        The expected contact radius [length] as a function of depth [length].
    theory_for_materials : callable
        The reference theory of the same scene after a change of the material of every layer.
    yielding : YieldingContact or None
        The expected contact if the first layer yields.
    """

    physics: ProblemDefinition
    truncation: Truncation | None
    layers: Layers
    relative_tip: Indenter
    domain_reason: str
    theory: Theory | None
    experiment: Experiment | None
    history: History | None
    relaxation: Relaxation | None
    steps_per_doubling: int
    attraction: Adhesion | None
    theory_without_tension: Theory | None
    surface_rise: float
    expected_radius: Callable[[float], float] = field(repr=False)
    theory_for_materials: Callable[[Callable[[Material], Material]], Theory | None] = field(
        repr=False
    )
    yielding: YieldingContact | None = None

    @property
    def is_half_space(self) -> bool:
        """True if the body is a half-space or a finite body in place of a half-space."""
        stands_for_one = self.truncation is not None and self.truncation.represents == "half-space"
        return stands_for_one or isinstance(self.physics.body, HalfSpace)

    @property
    def max_depth(self) -> float:
        """The largest depth below the surface of the swollen body [length]."""
        return max(self.physics.deltas) + self.surface_rise

    @property
    def a(self) -> float:
        """Expected contact radius at the largest depth, including adhesion [length]."""
        if self.adhesive_radii and self.max_depth <= 0:
            # Without adhesion there is no contact at this depth.
            return max(self.adhesive_radii)
        return max([self.expected_radius(self.max_depth), *self.adhesive_radii])

    @property
    def elastocapillary_length(self) -> float:
        """Elastocapillary length gamma/E* [length].

        At smaller lengths, surface tension dominates the elasticity.
        """
        return self.physics.surface_tension / self.physics.material.E_star

    @property
    def curve_method(self) -> CurveMethod | None:
        """Method by which the history is evaluated on the elastic curve; None without a history."""
        if self.history is None:
            return None
        return curve_method(self.history, self.relaxation, self.experiment)

    @property
    def jkr_limit(self) -> JKRAdhesion | None:
        """Adhesion of the experiment, evaluated in the JKR limit; None without adhesion."""
        return self.experiment.adhesion if self.experiment else None

    @cached_property
    def adhesive_radii(self) -> tuple[float, float] | tuple[()]:
        """Contact radii [length] in the JKR limit: at pull-off and at the largest depth."""
        jkr_adhesion = self.jkr_limit
        if self.attraction and self.physics.body.dim == 3:
            attraction = self.attraction
            force = self.physics.largest_force
            return adhesive_radii(
                self.theory, self.relative_tip, self.layers, attraction.work, self.max_depth, force
            )
        if jkr_adhesion is None or self.physics.domain.kinematics.name != "axisymmetric":
            return ()
        return adhesive_radii(
            self.theory, self.relative_tip, self.layers, jkr_adhesion.work, self.max_depth, None
        )

    @cached_property
    def adhesive_base_radii(self) -> tuple[float, float] | tuple[()]:
        """Radii [length] of the contact with the flat in the JKR limit, as `adhesive_radii`.

        They are empty for a body that does not adhere to a flat on which it rests.
        """
        body = self.physics.body
        adhesion = self.jkr_limit
        solution = self.solution(self.max_depth) if self.max_depth > 0 else None
        if adhesion is None or adhesion.base_work is None or solution is None:
            return ()
        assert isinstance(body, SphericalBody)
        plate = Paraboloid(body.apex_radius)
        return adhesive_radii(None, plate, self.layers, adhesion.base_work, 0.0, solution.force)

    @cached_property
    def jkr(self) -> Jkr | None:
        """Contact of an adhesive tip in the JKR limit; None if no theory applies."""
        return self.theory.jkr(self.attraction.work) if self.attraction and self.theory else None

    def solution(self, delta: float) -> Solution | None:
        """Return the contact of the reference theory at a depth [length]; None without theory."""
        return self.theory.solution_at_depth(delta) if self.theory else None


def set_up_problem(config: Config, imported_mesh: ImportedMesh | None = None) -> ProblemSetup:
    """Set up the nondimensional problem on the body as given.

    Parameters
    ----------
    config : Config
        The validated scene file.
    imported_mesh : ImportedMesh, optional
        Mesh of the body, if it has already been read from the scene's mesh file.

    Returns
    -------
    ProblemSetup
        The problem before mesh and solver are chosen.

    Raises
    ------
    ConfigError
        If the scene is impossible.
    """
    body = config.body
    if isinstance(body, MeshFromFile):
        meshed_body, imported_mesh = position_imported_mesh(
            config, body, imported_mesh or read_mesh_file(config, body)
        )
        return _set_up(config, meshed_body, meshed_body.layers, None, imported_mesh)
    layers = elastic_layers(config)
    if isinstance(body, CurvedBody):
        spherical_body = body.spherical_body
        (*coatings, core) = layers
        core = replace(
            core,
            thickness=spherical_body.height - sum(layer.thickness or 0.0 for layer in coatings),
        )
        return _set_up(config, spherical_body, (*coatings, core), None, None)
    return _set_up(config, body, layers, None, None)


def truncate_body(config: Config, setup: ProblemSetup) -> ProblemSetup:
    """Replace an unbounded body by a finite one; return other setups unchanged."""
    if not isinstance(config.body, UnboundedBody):
        return setup
    deepest = setup.max_depth
    if setup.adhesive_radii:
        # The body must be large enough for a contact of this radius without adhesion.
        deepest = max(deepest, 2 * float(setup.physics.indenter.height(setup.a, 0.0)))
    if setup.attraction:
        # The attraction acts up to its cut-off distance.
        deepest = max(deepest, 2 * ATTRACTION_CUTOFF * (setup.attraction.range or 0.0))
    states = _layers_in_extreme_states(config)
    depth = deepest * setup.physics.scales.length
    truncation = truncate(config.body, config.tip, states, depth, tension_width_factor(setup))
    return _set_up(config, truncation.body, truncation.layers, truncation, None)


def _layers_in_extreme_states(config: Config) -> list[Layers]:
    """Return the layers in the elastic states between which their materials change with time.

    The first state is drained and unrelaxed. The undrained state and the state with the most
    relaxed shear modulus are less compressible: on a frictionless base, a side wall then affects
    the force from a much larger distance.
    """
    layers = elastic_layers(config)
    states = [layers]
    if any(layer.material and layer.material.flow for layer in layers):
        states.append(
            tuple(
                replace(layer, material=layer.material and undrained_law(layer.material))
                for layer in layers
            )
        )
    shares = [
        least_shear_fraction(config, layer.material) if layer.material else 1.0 for layer in layers
    ]
    if min(shares) < 1:
        softened = [
            replace(layer, material=layer.material and relaxed_law(layer.material, share))
            for layer, share in zip(layers, shares, strict=True)
        ]
        states.append(tuple(softened))
    return states


def tension_width_factor(setup: ProblemSetup) -> float:
    """Return the factor by which a finite body must be wider because of its surface tension.

    The tension increases the force and deforms the surface around the contact over the length
    gamma/E*.
    """
    elastocapillary_length = setup.elastocapillary_length
    theory_without_tension = setup.theory_without_tension
    if not elastocapillary_length or theory_without_tension is None or setup.max_depth <= 0:
        return 1.0
    solution = setup.solution(setup.max_depth)
    reference = theory_without_tension.solution_at_depth(setup.max_depth)
    force = solution.force / reference.force if solution and reference else 1.0
    return max(force, 1.0 + elastocapillary_length / setup.physics.body.height)


def _set_up(
    config: Config,
    whole_body: Body,
    layers: Layers,
    truncation: Truncation | None,
    imported_mesh: ImportedMesh | None,
) -> ProblemSetup:
    """Set up the problem for a finite body, a truncated body or an imported mesh."""
    material = layer_material(layers[0])
    center = whole_body.center if truncation else config.center or whole_body.center
    contacts = whole_body.contacts_per_body if isinstance(whole_body, SphericalBody) else 1
    history = config.loading.prescribed_history
    relaxations = [law.relaxation for _, law in config.materials() if law.relaxation]
    relaxation = next((law for law in relaxations if law.of == "all"), None)
    compliance = config.experiment.compliance if config.experiment else 0.0
    least_modulus_fraction = min(
        (remaining_modulus_fraction(law, history) for law in relaxations), default=1.0
    )
    indenter = _plate_if_covering(_punch_if_soft(config.tip), whole_body, center)
    tip = relative_tip(indenter, whole_body)
    path = (
        path_to_max_depth(history, least_modulus_fraction, compliance, tip, layers)
        if history
        else config.loading.path()
    )
    path = _with_increments(config, path, is_covered=covers_top(indenter, whole_body, center))
    check_scene(whole_body, layers, indenter, center, path, contacts, "loading")
    scales = Scales(
        _length_unit(whole_body, layers, indenter, path),
        material.constants.E,
        whole_body.dim,
        contacts,
    )
    body = scales.nondimensionalize(whole_body)
    tip = scales.nondimensionalize(indenter)
    material = scales.nondimensionalize(material)
    layers = tuple(map(scales.nondimensionalize, layers))
    center = tuple(round_length(c / scales.length) for c in center)
    history = history and history.nondimensionalize(
        scales.control_unit(history.control), scales.length
    )
    path = path.nondimensionalize(scales.control_unit(path.control), scales.length)
    domain, domain_reason = _model_domain(
        config, body, imported_mesh, path.track(center), tip, layers, scales
    )
    whole_body = (
        scales.nondimensionalize(config.body) if isinstance(config.body, UnboundedBody) else body
    )
    tension = scales.nondimensionalize(config.body).surface_tension
    theory = theory_of(whole_body, layers, tip, center, tension)
    relative = relative_tip(tip, body)
    radius = cache(partial(expected_radius, theory, (relative, tip), body, center))
    yielding = yielding_contact(
        theory,
        relative,
        body,
        layers,
        center,
        domain.kinematics,
        radius,
        is_half_space=isinstance(whole_body, HalfSpace),
    )
    deltas = expected_depths(
        path,
        theory,
        relative,
        material,
        body.height,
        scales,
        domain.mirrored_body_count(center),
        yielding.depth_of_force if yielding else None,
    )
    drainage = nondimensional_drainage(config, history, scales)
    physics = ProblemDefinition(
        scales, body, domain, tip, center, path, deltas, surface_tension=tension, drainage=drainage
    )
    attraction = scales.nondimensionalize(config.contact).adhesion
    theory = theory and theory.checked_for_tension(deltas)

    def theory_with(change: Callable[[Material], Material]) -> Theory | None:
        changed = [replace(layer, material=change(layer_material(layer))) for layer in layers]
        return theory_of(whole_body, changed, tip, center, tension)

    experiment = config.experiment and config.experiment.nondimensionalize(scales)
    steps_per_doubling = time_steps_per_doubling(config)
    theory_without_tension = theory_of(whole_body, layers, tip, center) if tension else theory
    expectations = (
        relative,
        domain_reason,
        theory,
        experiment,
        history,
        relaxation,
        steps_per_doubling,
        attraction,
        theory_without_tension,
    )
    return ProblemSetup(
        physics,
        truncation,
        layers,
        *expectations,
        max_surface_rise(drainage, layers),
        cache(yielding.radius) if yielding else radius,
        theory_with,
        yielding,
    )


def _with_increments(config: Config, path: LoadPath, *, is_covered: bool) -> LoadPath:
    """Return the path with the increments that an accuracy requires of a body that yields.

    The stress below a tip that covers the body is uniform, and increments of any length are exact.
    """
    target = target_error(config.accuracy)
    if target is None or not config.yields or is_covered:
        return path
    refined = with_yield_increments(path, target)
    if (count := increment_count(refined)) > MAX_INCREMENTS:
        problem = f"needs {count} load increments, since the body yields"
        raise ConfigError("accuracy", problem, "use a larger one, or --error-bars")
    return refined


def _punch_if_soft(tip: Indenter) -> Indenter:
    """Return a soft plate as an equivalent soft punch; return other tips unchanged."""
    if not isinstance(tip, Plate) or tip.radius is None:
        return tip
    return FlatPunch(tip.radius, material=tip.material, thickness=tip.thickness)


def _plate_if_covering(tip: Indenter, body: Body, center: Center) -> Indenter:
    """Replace a sharp punch that is exactly as wide as a flat top by a plate.

    The edge of the punch would cut into the rim of the body, which bulges at finite strain.
    """
    if not isinstance(tip, FlatPunch) or tip.edge_radius or tip.material:
        return tip
    if not covers_top(tip, body, center):
        return tip
    return (
        Plate() if tip.radius <= body.max_lateral_extent(center) * (1 + RADIUS_TOLERANCE) else tip
    )


def _model_domain(
    config: Config,
    body: Body,
    imported_mesh: ImportedMesh | None,
    track: TipTrack,
    tip: Indenter,
    layers: Layers,
    scales: Scales,
) -> tuple[ModelDomain, str]:
    """Return the model domain of a body, and the reason for its symmetry."""
    if isinstance(body, ImportedBody):
        assert imported_mesh is not None
        return imported_model_domain(config, imported_mesh, scales)
    regions = (*layer_regions(config, layers), *inclusion_regions(config, body, scales))
    slide_axis = "" if track.is_point else "xy"[track.axis]
    return reduce(round_lengths(body), track.center, config.mesh.symmetry, tip, regions, slide_axis)


def _length_unit(body: Body, layers: Sequence[Layer], tip: Indenter, path: LoadPath) -> float:
    """Return the unit of length: height of the body, or about the contact radius.

    The contact radius is rounded to a power of two, so that division by it has no rounding error.
    """
    if isfinite(body.height):
        return body.height
    deepest = max(path.values)
    depth = expected_depth(tip, layers, deepest) if path.control == "force" else abs(deepest)
    return float(2.0 ** round(log2(tip.radius_at(depth or 1.0))))
