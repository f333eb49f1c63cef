"""Forces of a scene and of its variants at the deepest row."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import atan, degrees, inf, isfinite, log, radians, tan
from typing import Any, TypeVar

from indent_sim.config.scene_sections import MeshSettings, Source
from indent_sim.config.schema import Config
from indent_sim.model.body import Cylinder
from indent_sim.model.body_base import Support
from indent_sim.model.contact import AugmentedLagrangian, AutoContact
from indent_sim.model.experiment import Experiment
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.loading import Loading
from indent_sim.model.spherical_bodies import Ball, Cap
from indent_sim.model.tips import Cone, Indenter, RegularPyramid
from indent_sim.model.unbounded_bodies import HalfSpace, InfiniteLayer
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, NotConverged
from indent_sim.run.history_on_curve import HistoryResult, evaluate_with_units
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.variants import (
    change_materials,
    half_space_variant,
    replace_sections,
)
from indent_sim.run.pipeline import condense, states
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.solution import SOLUTION_ERRORS
from indent_sim.theory.theory import Theory

T = TypeVar("T")
# Without theory, the exponent of the load curve follows from the force at this fraction of the
# depth.
SECOND_DEPTH_FRACTION = 0.9
# Steps of a path-dependent contact. Friction then has an error of 0.1 % of the force. Adhesion has
# no memory, and its error cancels in a ratio of forces.
PATH_STEPS = {"friction": 20, "adhesion": 2}


class VariantSolver:
    """Solves a scene and its variants for the force at the deepest row, in the user's units.

    Bodies and tips that need a three-dimensional mesh are replaced by axisymmetric ones, the
    stand-ins. Every force is computed once.

    Attributes
    ----------
    config, scene
        The scene.
    delta
        Largest depth [length].
    tip
        The tip, or the cone with the cross-sections of a pyramid.
    has_cylinder_stand_in, has_cone_stand_in
        A box, or a cylinder under an off-axis tip, is replaced by a cylinder that ends at the
        nearest side; a pyramid by a cone.
    has_imported_mesh, is_spherical
        The body is a mesh from a file; it is a cap or a ball.
    materials, is_isotropic
        All materials of the scene; all are isotropic.
    """

    def __init__(self, config: Config, scene: Scene):
        self.config = config
        self.scene = scene
        self.delta = max(scene.physics.deltas) * scene.physics.scales.depth
        tip: Any = config.indenter
        is_off_axis = isinstance(config.body, Cylinder) and any(config.center or ())
        self.has_cylinder_stand_in = isinstance(config.body, Box) or is_off_axis
        self.has_imported_mesh = isinstance(config.body, MeshFromFile)
        self.is_spherical = isinstance(config.body, Cap | Ball)
        self.has_cone_stand_in = isinstance(tip, RegularPyramid)
        half_angle = (
            degrees(atan(tip.equivalent_radius_ratio * tan(radians(tip.half_angle))))
            if self.has_cone_stand_in
            else 0.0
        )
        self.tip: Indenter = Cone(half_angle, tip.tip_radius) if self.has_cone_stand_in else tip
        self.materials = variants.materials(config)
        self.is_isotropic = all(material.is_isotropic for material in self.materials)
        self._cache: dict[str, Any] = {}

    @cached_property
    def stand_in_text(self) -> str:
        """Text on the stand-ins, to be appended to the source of an effect; empty without any."""
        stand_ins = {
            "a cylinder up to the nearest side": self.has_cylinder_stand_in,
            "a cone of equal cross-sections": self.has_cone_stand_in,
        }
        used_names = [name for name, is_used in stand_ins.items() if is_used]
        return f" (approximated by {' and '.join(used_names)})" if used_names else ""

    @cached_property
    def side_supports(self) -> tuple[Support, ...]:
        """Supports of the sides of a cylinder or box; empty for other bodies.

        There are two if a stand-in cannot have the supports of the body: they enclose its effect.
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
        """The scene in a single step to its deepest row, with default contact, mesh and solver."""
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
        """The single-step scene on the stand-in for its body."""
        return self.replace_body(self.single_step_scene)

    def replace_body(self, scene: Config) -> Config:
        """A scene of this body on a stand-in that does not need a three-dimensional mesh.

        A box is replaced by a cylinder up to its nearest side. Inclusions that are not axisymmetric
        about the tip are removed.
        """
        body = scene.body
        is_axisymmetric = all(
            inclusion.is_axisymmetric_about((0.0, 0.0)) for inclusion in body.inclusions or ()
        )
        if isinstance(body, Box | Cylinder):
            # Positions of inclusions have no meaning in a cylinder about another axis.
            inclusions = (
                body.inclusions if is_axisymmetric and not self.has_cylinder_stand_in else None
            )
            cylinder = Cylinder(
                body.lateral_extent(self.config.center or body.center), body.height, base=body.base
            )
            cylinder = replace(
                cylinder, sides=self.side_supports[0], layers=body.layers, inclusions=inclusions
            )
            cylinder = replace(cylinder, surface_tension=body.surface_tension)
            return replace_sections(scene, body=cylinder, center=None)
        center = scene.center if isinstance(body, Strip | MeshFromFile) else None
        if not is_axisymmetric and body.dim == 3:
            body = replace(body, inclusions=None)  # type: ignore[arg-type]
        return replace_sections(scene, body=body, center=center)

    @cached_property
    def linear_scene(self) -> Config:
        """The single-step scene on its stand-in with linear elastic materials."""
        return change_materials(self._stand_in_scene, variants.linear_law)

    @cached_property
    def plain_scene(self) -> Config:
        """The linear scene without inclusions."""
        return variants.remove_inclusions(self.linear_scene)

    @cached_property
    def hyperelastic_scene(self) -> Config:
        """The single-step scene on its stand-in with finite-strain laws, its own or neo-Hookean."""
        return change_materials(self._stand_in_scene, variants.hyperelastic_law)

    @cached_property
    def layer_scene(self) -> Config | None:
        """The plain scene on its body without sides; None if that is not a layer or half-space."""
        if isinstance(self.plain_scene.body, HalfSpace):
            return half_space_variant(self.plain_scene)
        if isinstance(self.plain_scene.body, Cylinder | InfiniteLayer):
            return variants.layer_variant(self.plain_scene)
        return None

    def replace_tip(self, tip: Indenter) -> Config:
        """The plain scene under another tip."""
        return replace_sections(self.plain_scene, indenter=tip)

    def meshed_variant(self, config: Config, **contact: Any) -> Config:
        """A variant that is solved on the common mesh of all variants, and not by theory.

        Parameters
        ----------
        config
            The variant.
        **contact
            Settings of the contact law; friction and adhesion are loaded in several steps.
        """
        steps = max((count for name, count in PATH_STEPS.items() if contact.get(name)), default=1)
        sections: dict[str, Any] = {}
        if not isinstance(self.config.body, MeshFromFile):
            sections["mesh"] = MeshSettings(h_contact=self._h_contact)
        if steps > 1:
            sections["loading"] = Loading(delta=self.delta, steps=steps)
        return replace_sections(config, contact=AugmentedLagrangian(**contact), **sections)

    @cached_property
    def friction_or_adhesion(self) -> dict[str, Any]:
        """Friction or adhesion of the scene, by its key of the contact law; empty without both."""
        return {
            name: value
            for name in PATH_STEPS
            if (value := getattr(self.config.contact, name, None))
        }

    @cached_property
    def _h_contact(self) -> float:
        """Element size at the contact in the common mesh [length]."""
        contact = AugmentedLagrangian(adhesion=self.config.contact.adhesion)
        scene = resolve(replace_sections(self.linear_scene, contact=contact))
        return scene.sizes.h_contact * scene.physics.scales.length

    def force_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Ratio of the forces of two variants.

        Both are solved by theory if that is exact for both, otherwise on the same mesh. Histories
        are compared at the row of the largest force.

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
        if any(
            self._exact_theory_scene(variant) is None for variant in (with_effect, without_effect)
        ):
            with_effect, without_effect = (
                self.meshed_variant(variant) if _is_fully_automatic(variant) else variant
                for variant in (with_effect, without_effect)
            )
        return _positive_ratio(self.force(with_effect), self.force(without_effect))

    def ratio_over_parameter(
        self, without_effect: Config, variant_at: Callable[[float], Config]
    ) -> Callable[[float], float]:
        """Ratio of the forces with and without an effect as a function of its parameter x.

        Theory must solve the variant without the effect, because many values of x are tried.

        Parameters
        ----------
        without_effect
            The variant without the effect.
        variant_at
            The variant with the effect as a function of x.

        Returns
        -------
        callable
            The ratio; it raises NotConverged without a theory or a solution.
        """

        def ratio(x: float) -> float:
            """Ratio of the forces at x."""
            config = variant_at(x)
            if self._exact_theory_scene(without_effect) is None:
                raise NotConverged("there is no theory of this body")
            return self.force_ratio(config, without_effect)

        return ratio

    def force(self, config: Config) -> float:
        """Force of a variant [force]: by theory if that is exact, otherwise on a mesh."""
        return self._cached(f"force {config!r}", lambda: self._solve_force(config))

    def _cached(self, name: str, find: Callable[[], T]) -> T:
        """Result of `find`, which is called once for each name.

        Its failures, except BackendError, are stored as well, and raised as NotConverged.
        """
        if name not in self._cache:
            try:
                self._cache[name] = find()
            except BackendError:
                raise
            except (IndentSimError, *SOLUTION_ERRORS) as error:
                self._cache[name] = NotConverged(
                    " ".join(str(error).split()) or type(error).__name__
                )
        cached_value: T | NotConverged = self._cache[name]
        if isinstance(cached_value, NotConverged):
            raise NotConverged(str(cached_value))
        return cached_value

    def _solve_force(self, config: Config) -> float:
        """Solve a variant."""
        if isinstance(config.body, MeshFromFile) and config.body.kinematics == "3d":
            raise NotConverged("there is no axisymmetric stand-in for a three-dimensional mesh")
        scene = self._exact_theory_scene(config) or resolve(config)
        seconds = scene.plan.prediction.get("seconds", 0.0)
        # A table of effects should not take more than a few minutes.
        if scene.is_meshed and scene.physics.domain.dim == 3 and seconds > 120.0:
            raise NotConverged(
                f"a run in three dimensions would take about {seconds:.2g} s; run the scene with "
                "and without the effect instead"
            )
        *_, last_state = states(scene, with_surface=False)
        if not last_state.converged:
            raise NotConverged("did not converge")
        return last_state.force

    def _exact_theory_scene(self, config: Config) -> Scene | None:
        """The variant solved by theory; None if theory is not exact for it."""
        if not _is_fully_automatic(config):
            return None

        def resolve_by_theory() -> Scene | None:
            """The scene, if the method "theory" accepts it."""
            with suppress(ConfigError):
                return resolve(
                    replace_sections(config, solver=replace(config.solver, method="theory"))
                )
            return None

        return self._cached(f"theory {config!r}", resolve_by_theory)

    def history_result(self, config: Config) -> HistoryResult:
        """Rows and report of the history of a variant."""

        def evaluate() -> HistoryResult:
            """Evaluate the history on the elastic load curve."""
            scene = self._exact_theory_scene(config) or resolve(config)
            return evaluate_with_units(
                scene, condense(scene).equilibrium if scene.is_meshed else None
            )

        return self._cached(f"history {config!r}", evaluate)

    def _history_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Ratio of the forces of two histories at the row of the largest force.

        Under prescribed forces it is relative to the elastic force at the depth of this row.
        """
        rows = self.history_result(with_effect).rows
        top_row = max(rows, key=lambda row: row.force)
        # If all forces are tensile, the deepest row is compared.
        if not (top_row.force > 0 and top_row.a > 0):
            top_row = max(rows, key=lambda row: row.delta)
        if with_effect.loading.force_history:
            elastic_scene = replace_sections(
                self.linear_scene, loading=Loading(delta=top_row.delta, steps=1)
            )
            return _positive_ratio(top_row.force, self.force(elastic_scene))
        reference_row = min(
            self.history_result(without_effect).rows,
            key=lambda row: (abs(row.t - top_row.t), -row.force),
        )
        return _positive_ratio(top_row.force, reference_row.force)

    @cached_property
    def scene_force(self) -> float:
        """Force of the linear scene; NotConverged if it is not positive."""
        force = self.force(self.linear_scene)
        if not 0 < force < inf:
            raise NotConverged("the force at the deepest row is not positive")
        return force

    @cached_property
    def half_space_scene(self) -> Config | None:
        """The scene on a half-space of the material that the tip touches; None in plane strain.

        The curvature of a spherical body is taken into account by the tip.
        """
        body = self.config.body
        tip = self.tip
        contacts = 1
        if body.dim == 2:
            return None
        if isinstance(body, Cap | Ball):
            tip = relative_tip(tip, body.spherical_body)
            contacts = body.spherical_body.contacts_per_body
        elif not isinstance(body, MeshFromFile):
            return half_space_variant(self.plain_scene)
        loading = Loading(delta=self.delta / contacts, steps=1)
        half_space = HalfSpace(surface_tension=self.plain_scene.body.surface_tension)
        return replace_sections(
            self.plain_scene,
            body=half_space,
            material=self.touched_material,
            indenter=tip,
            center=None,
            loading=loading,
        )

    @property
    def touched_material(self) -> LinearElastic:
        """The linear elastic material that the tip touches."""
        physics = self.scene.physics
        E, nu = physics.material.constants
        return LinearElastic(E=float(f"{E * physics.scales.pressure:.12g}"), nu=nu)

    @cached_property
    def theory_variant(self) -> Config | None:
        """The plain scene on its body, a layer or a half-space: the first that theory solves."""
        for candidate in (self.plain_scene, self.layer_scene, self.half_space_scene):
            if candidate is not None and self._exact_theory_scene(candidate) is not None:
                return candidate
        return None

    @cached_property
    def theory_scene(self) -> Scene | None:
        """The theory variant as a scene; None if there is none."""
        if self.theory_variant is None:
            return None
        return self._exact_theory_scene(self.theory_variant)

    @property
    def theory(self) -> Theory | None:
        """Theory of the theory variant; None if there is none."""
        return self.theory_scene.plan.theory if self.theory_scene is not None else None

    def force_at_depth(self, delta: float) -> float:
        """Force of the linear scene at a depth [length], interpolated from that of the deepest row.

        The load curve has the shape of that of theory, or is a power law through two forces.
        """
        if self.theory_scene is not None and self.theory is not None:
            deepest = self.theory_scene.physics.deltas[-1]
            solution = self.theory.solution_at_depth(delta / self.delta * deepest)
            deepest_solution = self.theory.solution_at_depth(deepest)
            if solution and deepest_solution:
                return self.scene_force * solution.force / deepest_solution.force
        nearby_force = self.force(
            replace_sections(
                self.linear_scene,
                loading=Loading(delta=SECOND_DEPTH_FRACTION * self.delta, steps=1),
            )
        )
        return float(
            self.scene_force
            * (delta / self.delta)
            ** (log(nearby_force / self.scene_force) / log(SECOND_DEPTH_FRACTION))
        )


def _is_fully_automatic(config: Config) -> bool:
    """True if the program chooses the contact law and the mesh."""
    return isinstance(config.contact, AutoContact) and config.mesh == MeshSettings()


def _positive_ratio(numerator: float, denominator: float) -> float:
    """Ratio of forces; NotConverged if the denominator is not positive."""
    if not (isfinite(numerator) and 0 < denominator < inf):
        raise NotConverged("the force without the effect is not positive")
    return numerator / denominator


def history_variant(solver: VariantSolver, *part_names: str) -> Config:
    """The linear scene along its history, with some parts of its experiment.

    Parameters
    ----------
    solver
        The scene; if it has no history, it is loaded at a constant rate to the deepest row.
    *part_names
        Parts of the experiment that are kept, or "relaxation"; all others are removed.
    """
    loading = solver.config.loading
    experiment = solver.config.experiment
    ramp = Loading(history=((0.0, 0.0), (1.0, solver.delta)))
    kept_parts = {
        name: part_value for name in part_names if (part_value := getattr(experiment, name, None))
    }
    sections = {"loading": replace(loading, times="auto") if loading.prescribed_history else ramp}
    law = next((material.relaxation for _, material in solver.config.materials()), None)
    relaxation = law if "relaxation" in part_names else None
    return change_materials(
        solver.linear_scene,
        lambda material: replace(material, relaxation=relaxation),
        **sections,
        experiment=Experiment(**kept_parts) if kept_parts else None,
    )
