"""Variants of one scene that the table of effects compares."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import atan, degrees, inf, isfinite, log, radians, tan
from typing import Any

from indent_sim.config.scene_sections import MeshSettings, Source
from indent_sim.config.schema import Config
from indent_sim.model.body import Cylinder
from indent_sim.model.body_base import Support
from indent_sim.model.contact import AugmentedLagrangian
from indent_sim.model.experiment import Experiment
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.loading import Loading
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.spherical_bodies import CurvedBody
from indent_sim.model.tips import Cone, Indenter, Plate, RegularPyramid, Sphere
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import NotConverged
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.jkr_limit import JkrLimit
from indent_sim.run.model_selection.variant_solver import VariantSolver, is_fully_automatic
from indent_sim.run.model_selection.variants import (
    change_materials,
    half_space_variant,
    replace_sections,
)
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import increasing_root

# Load increments of variants with friction or adhesion. The force with friction then has an error
# of 0.1 %. The force with adhesion does not depend on the path, and its error cancels in a ratio.
PATH_STEPS = {"friction": 20, "adhesion": 2}


class SceneVariants:
    """Variants of a scene at its largest depth, and their forces, in the user's units.

    Bodies and tips that need a three-dimensional mesh are replaced by axisymmetric ones, called
    stand-ins.

    Attributes
    ----------
    config, scene
        The scene.
    tolerance, percent
        Smallest change of the force that is significant, relative and in per cent.
    solver
        Solves the variants.
    delta
        Largest depth [length].
    materials, is_isotropic
        All materials of the scene; True if all of them are isotropic.
    friction_or_adhesion, friction
        Friction and adhesion of the contact law by key (empty without both); the friction
        coefficient.
    compliance
        Compliance of cantilever and frame [length/force].
    known_no_slip
        Effect of no slip if it is known from theory.
    has_cylinder_stand_in
        True if a box, or a cylinder under an off-axis tip, is replaced by a cylinder that ends at
        the nearest side.
    tip, tip_name, rounding_key
        The tip (for a pyramid, the cone with the same cross-sections); the name of its shape in
        texts; the key that rounds its apex or edge, empty if there is none.
    stand_in_text
        Text on the stand-ins for the source of an effect; empty without stand-ins.
    """

    def __init__(
        self,
        config: Config,
        scene: Scene,
        tolerance: float = 0.01,
        solver: VariantSolver | None = None,
    ):
        self.config = config
        self.scene = scene
        self.tolerance = tolerance
        self.percent = 100 * tolerance
        self.solver = solver or VariantSolver()
        self.delta = max(scene.physics.deltas) * scene.physics.scales.depth
        self.is_plane_strain = config.body.dim == 2
        self.is_half_space = isinstance(config.body, HalfSpace)
        self.is_spherical = isinstance(config.body, CurvedBody)
        self.materials = [material.canonical() for _, material in config.materials()]
        self.is_isotropic = all(material.is_isotropic for material in self.materials)
        laws = (material.relaxation for _, material in config.materials())
        self.relaxation: Relaxation | None = next(laws, None)
        contact = {name: getattr(config.contact, name, None) for name in PATH_STEPS}
        self.friction_or_adhesion = {name: value for name, value in contact.items() if value}
        self.friction = self.friction_or_adhesion.get("friction")
        self.compliance = config.experiment.compliance if config.experiment else 0.0
        stick = scene.plan.stick
        self.known_no_slip = stick if stick and stick.percent is not None else None
        is_off_axis = isinstance(config.body, Cylinder) and any(config.center or ())
        self.has_cylinder_stand_in = isinstance(config.body, Box) or is_off_axis
        tip: Any = config.indenter
        self.tip_name = tip.shape.replace("_", " ")
        stand_ins = (
            ["a cylinder that ends at the nearest side"] if self.has_cylinder_stand_in else []
        )
        if isinstance(tip, RegularPyramid):
            stand_ins.append("a cone of equal cross-sections")
            half_angle = degrees(atan(tip.equivalent_radius_ratio * tan(radians(tip.half_angle))))
            tip = Cone(half_angle, tip.tip_radius)
        if config.tilt and not isinstance(tip, Sphere):
            stand_ins.append("an upright tip")
        self.tip: Indenter = tip
        self.stand_in_text = f" (approximated by {' and '.join(stand_ins)})" if stand_ins else ""
        keys = ("edge_radius", "tip_radius")
        self.rounding_key = next((key for key in keys if hasattr(tip, key)), "")

    def rounded_tip(self, radius: float) -> Indenter:
        """Return the tip with another rounding radius of its apex or edge [length]."""
        changes: dict[str, Any] = {self.rounding_key: radius}
        return replace(self.tip, **changes)

    @property
    def tip_radius(self) -> float | None:
        """Radius of a round tip or of a hyperboloid [length]; None for other tips.

        The radius is that of the sphere through the apex and the section of the tip at the largest
        depth.
        """
        return self.tip.radius_scale(self.tip.radius_at(self.delta))

    @cached_property
    def side_supports(self) -> tuple[Support, ...]:
        """Supports of the sides of a cylinder or box; empty for other bodies.

        If no stand-in can have the supports of the body, free and fixed sides are returned, whose
        effects are bounds.
        """
        match self.config.body:
            case Cylinder(sides=sides):
                if sides != "roller" or not self.has_cylinder_stand_in:
                    return (sides,)
                return ("free", "fixed")
            case Box(sides=sides):
                supports = {sides.x_min, sides.x_max, sides.y_min, sides.y_max}
                return (supports.pop(),) if supports in ({"free"}, {"fixed"}) else ("free", "fixed")
        return ()

    @cached_property
    def single_step_scene(self) -> Config:
        """Scene in a single step to the largest depth, with default contact and mesh."""
        config = self.config
        loading = Loading(delta=self.delta, steps=1)
        config = change_materials(
            config, variants.instantaneous_law, loading=loading, experiment=None
        )
        scene = Config(
            body=config.body,
            material=config.material,
            indenter=self.tip,
            center=config.center,
            loading=loading,
        )
        scene._source = Source(config.source.name)
        return scene

    @cached_property
    def _stand_in_scene(self) -> Config:
        """The single-step scene with a stand-in for its body, see `replace_body`."""
        return self.replace_body(self.single_step_scene)

    def replace_body(self, scene: Config) -> Config:
        """Return a scene with a stand-in for its body that needs no three-dimensional mesh.

        A box is replaced by a cylinder that ends at its nearest side. Inclusions that are not
        axisymmetric about the tip are removed.
        """
        body = scene.body
        is_axisymmetric = all(
            inclusion.is_axisymmetric_about((0.0, 0.0)) for inclusion in body.inclusions or ()
        )
        if isinstance(body, Box | Cylinder):
            # Positions of inclusions have no meaning in a cylinder about another axis.
            keeps_inclusions = is_axisymmetric and not self.has_cylinder_stand_in
            cylinder = Cylinder(
                body.lateral_extent(self.config.center or body.center),
                body.height,
                base=body.base,
                sides=self.side_supports[0],
                layers=body.layers,
                inclusions=body.inclusions if keeps_inclusions else None,
                surface_tension=body.surface_tension,
            )
            return replace_sections(scene, body=cylinder, center=None)
        center = scene.center if isinstance(body, Strip | MeshFromFile) else None
        if not is_axisymmetric and body.dim == 3:
            body = replace(body, inclusions=None)  # type: ignore[arg-type]
        return replace_sections(scene, body=body, center=center)

    @cached_property
    def linear_scene(self) -> Config:
        """The single-step scene with the stand-in for its body and linear elastic materials."""
        return variants.change_laws(self._stand_in_scene, variants.linear_law)

    @cached_property
    def plain_scene(self) -> Config:
        """The linear scene without inclusions."""
        return variants.remove_inclusions(self.linear_scene)

    @cached_property
    def hyperelastic_scene(self) -> Config:
        """Single-step scene with the stand-in for its body and finite-strain laws.

        The laws are those of the scene if they are for finite strain, otherwise neo-Hookean laws.
        """
        return variants.change_laws(self._stand_in_scene, variants.hyperelastic_law)

    @cached_property
    def layer_scene(self) -> Config | None:
        """Plain scene without side walls; None if the body is not a layer or half-space."""
        if isinstance(self.plain_scene.body, HalfSpace):
            return half_space_variant(self.plain_scene)
        if isinstance(self.plain_scene.body, Cylinder | InfiniteLayer):
            return variants.layer_variant(self.plain_scene)
        return None

    @cached_property
    def half_space_scene(self) -> Config | None:
        """Scene on a half-space of the material under the tip; None in plane strain.

        The curvature of a spherical body is added to that of the tip.
        """
        body = self.config.body
        tip = self.tip
        contacts = 1
        if body.dim == 2:
            return None
        if isinstance(body, CurvedBody):
            tip = relative_tip(tip, body.spherical_body)
            contacts = body.spherical_body.contacts_per_body
        elif not isinstance(body, MeshFromFile):
            return half_space_variant(self.plain_scene)
        return replace_sections(
            self.plain_scene,
            body=HalfSpace(surface_tension=self.plain_scene.body.surface_tension),
            material=self.touched_material,
            indenter=tip,
            center=None,
            loading=Loading(delta=self.delta / contacts, steps=1),
        )

    @property
    def touched_material(self) -> LinearElastic:
        """The linear elastic material that the tip touches."""
        physics = self.scene.physics
        E, nu = physics.material.constants
        return LinearElastic(E=float(f"{E * physics.scales.pressure:.12g}"), nu=nu)

    def replace_tip(self, tip: Indenter) -> Config:
        """Return the linear elastic scene without inclusions (`plain_scene`) with another tip."""
        return replace_sections(self.plain_scene, indenter=tip)

    def with_rigid_tip(self, config: Config) -> Config:
        """Return a scene with the same tip of a rigid material."""
        tip: Any = config.indenter
        # Only a soft plate has a radius.
        end = {"radius": None} if isinstance(tip, Plate) else {}
        rigid_tip = replace(tip, material=None, thickness=None, **end)
        return replace_sections(config, indenter=rigid_tip)

    def planned_force(self, config: Config) -> float:
        """Return the force of a scene at its largest depth by theory, even if it is not exact.

        Raises ValueError without a theory.
        """
        scene = resolve(config)
        solution = scene.theory_solution(max(scene.physics.deltas))
        if solution is None:
            raise ValueError("there is no theory of this scene")
        return solution.force * scene.physics.scales.force

    def replace_plain_body(self, **changes: Any) -> Config:
        """Return the linear elastic scene (`plain_scene`) with changed attributes of its body."""
        return replace_sections(self.plain_scene, body=replace(self.plain_scene.body, **changes))

    def meshed_variant(self, config: Config, **contact: Any) -> Config:
        """Return a variant that is solved on the common mesh of all variants, not by theory.

        Parameters
        ----------
        config
            The variant.
        **contact
            Settings of the contact law. With friction or adhesion the load is applied in several
            steps.
        """
        steps = max((count for name, count in PATH_STEPS.items() if contact.get(name)), default=1)
        sections: dict[str, Any] = {}
        if not isinstance(self.config.body, MeshFromFile):
            sections["mesh"] = MeshSettings(h_contact=self._h_contact)
        if steps > 1:
            sections["loading"] = Loading(delta=self.delta, steps=steps)
        return replace_sections(config, contact=AugmentedLagrangian(**contact), **sections)

    def contact_variant(self, **contact: Any) -> Config:
        """Return the linear scene on the common mesh, with settings of the contact law."""
        return self.meshed_variant(self.linear_scene, **contact)

    @cached_property
    def _h_contact(self) -> float:
        """Element size at the contact in the common mesh [length]."""
        contact = AugmentedLagrangian(adhesion=self.config.contact.adhesion)
        scene = resolve(replace_sections(self.linear_scene, contact=contact))
        return scene.sizes.h_contact * scene.physics.scales.length

    def history_variant(self, *part_names: str) -> Config:
        """Return the linear scene along its history, with the named parts of its experiment only.

        A scene without a history is loaded at a constant rate to the largest depth.

        Parameters
        ----------
        *part_names
            Parts of the experiment that are kept, or "relaxation"; all others are removed.
        """
        loading = self.config.loading
        experiment = self.config.experiment
        ramp = Loading(history=((0.0, 0.0), (1.0, self.delta)))
        kept_parts = {
            name: part for name in part_names if (part := getattr(experiment, name, None))
        }
        relaxation = self.relaxation if "relaxation" in part_names else None
        return change_materials(
            self.linear_scene,
            lambda material: replace(material, relaxation=relaxation),
            loading=replace(loading, times="auto") if loading.prescribed_history else ramp,
            experiment=Experiment(**kept_parts) if kept_parts else None,
        )

    @cached_property
    def theory_variant(self) -> Config | None:
        """First scene of plain, layer and half-space scene that theory solves, or None."""
        for candidate in (self.plain_scene, self.layer_scene, self.half_space_scene):
            if candidate is not None and self.solver.theory_scene(candidate) is not None:
                return candidate
        return None

    @property
    def _theory_scene(self) -> Scene | None:
        """The theory variant as a scene; None if there is no theory variant."""
        return self.solver.theory_scene(self.theory_variant) if self.theory_variant else None

    @cached_property
    def scene_force(self) -> float:
        """Force of the linear scene; raise NotConverged if it is not positive."""
        force = self.solver.force(self.linear_scene)
        if not 0 < force < inf:
            raise NotConverged("the force at the deepest row is not positive")
        return force

    def force_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Return the ratio of the forces of two variants.

        Both are solved by theory if it is exact for both, otherwise on the same mesh. Histories are
        compared at the row of the largest force.

        Parameters
        ----------
        with_effect, without_effect
            The variants.

        Raises
        ------
        NotConverged
            If a variant cannot be solved, or the force without the effect is not positive.
        """
        if with_effect.loading.prescribed_history:
            return self._history_ratio(with_effect, without_effect)
        pair = (with_effect, without_effect)
        if any(self.solver.theory_scene(variant) is None for variant in pair):
            with_effect, without_effect = (
                self.meshed_variant(variant) if is_fully_automatic(variant) else variant
                for variant in pair
            )
        return _positive_ratio(self.solver.force(with_effect), self.solver.force(without_effect))

    def theory_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Return the ratio of forces as `force_ratio`, for one of many values of a parameter.

        Raises
        ------
        NotConverged
            If theory does not solve the variant without the effect: many meshes would take too
            long.
        """
        if self.solver.theory_scene(without_effect) is None:
            raise NotConverged("there is no theory of this body")
        return self.force_ratio(with_effect, without_effect)

    def _history_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Return the ratio of the forces of two histories at the row of the largest force.

        If forces are prescribed, the ratio is relative to the elastic force at the depth of this
        row.
        """
        rows = self.solver.history(with_effect).rows
        top_row = max(rows, key=lambda row: row.force)
        # If all forces are tensile, the deepest row is compared.
        if not (top_row.force > 0 and top_row.a > 0):
            top_row = max(rows, key=lambda row: row.delta)
        if with_effect.loading.force_history:
            elastic_force = self.solver.force(self._linear_scene_at(top_row.delta))
            return _positive_ratio(top_row.force, elastic_force)
        reference_row = min(
            self.solver.history(without_effect).rows,
            key=lambda row: (abs(row.t - top_row.t), -row.force),
        )
        return _positive_ratio(top_row.force, reference_row.force)

    def _linear_scene_at(self, delta: float) -> Config:
        """Return the linear scene in a single step to another depth [length]."""
        return replace_sections(self.linear_scene, loading=Loading(delta=delta, steps=1))

    def _force_at_depth(self, delta: float) -> float:
        """Return the force of the linear scene at a depth [length].

        The force is scaled from the force at the largest depth with the load curve of the theory,
        or with a power law through two forces if there is no theory.
        """
        depth_ratio = delta / self.delta
        scene = self._theory_scene
        theory = scene and scene.plan.theory
        if scene and theory:
            deepest = scene.physics.deltas[-1]
            solution = theory.solution_at_depth(depth_ratio * deepest)
            deepest_solution = theory.solution_at_depth(deepest)
            if solution and deepest_solution:
                return self.scene_force * solution.force / deepest_solution.force
        # Without theory, the exponent of the load curve follows from the force at this fraction of
        # the depth.
        fraction = 0.9
        nearby_scene = self._linear_scene_at(fraction * self.delta)
        force_ratio = self.solver.force(nearby_scene) / self.scene_force
        return self.scene_force * depth_ratio ** (log(force_ratio) / log(fraction))

    @cached_property
    def tolerated_depth_error(self) -> float:
        """Return the error of the depth that changes the force by the tolerance [length]."""
        force_fraction = 1 - self.tolerance
        # Hertz: the force grows with the depth to the power 3/2.
        initial_depth = self.delta * force_fraction ** (2 / 3)
        depth = increasing_root(
            lambda depth: self._force_at_depth(depth) / self.scene_force,
            force_fraction,
            initial_depth,
            1.01 * self.delta,
        )
        return self.delta - depth

    @cached_property
    def jkr_limit(self) -> JkrLimit | None:
        """The JKR limit of the theory variant; None if its contact is not circular."""
        scene = self._theory_scene
        contact = scene and scene.plan.theory and scene.plan.theory.contact
        return JkrLimit(scene, contact) if scene and isinstance(contact, Layer) else None

    @cached_property
    def radius_exponent(self) -> float:
        """Exponent n = d ln F/d ln R for the tip's radius; 0 for a tip without radius."""
        if self.tip_radius is None:
            return 0.0
        # Relative change of the size of the tip for the derivative of the force.
        change = 0.02
        larger_tip = self.tip.scaled(1 + change)
        ratio = self.force_ratio(self.replace_tip(larger_tip), self.plain_scene)
        return log(ratio) / log(1 + change)


def _positive_ratio(numerator: float, denominator: float) -> float:
    """Return the ratio of forces; raise NotConverged if the denominator is not positive."""
    if not (isfinite(numerator) and 0 < denominator < inf):
        raise NotConverged("the force without the effect is not positive")
    return numerator / denominator
