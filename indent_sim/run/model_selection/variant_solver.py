"""Forces of a scene and of its variations at the deepest row."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import atan, degrees, inf, isfinite, log, radians, tan
from typing import Any, TypeVar

from indent_sim.config.schema import Config, MeshSettings, Source
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
SECOND_DEPTH_FRACTION = (
    0.9  # of the deepest depth: where a second force says how steep the curve is
)
# Of a path with friction, whose force is good to 0.1 % then; with adhesion: good for the ratio of
# two, and it does not remember
PATH_STEPS = {"friction": 20, "adhesion": 2}


class VariantSolver:
    """The forces of a scene and of its variations at the deepest row, in the user's units.

    `whole` is the scene without friction and adhesion, at small strain and on a round body where
    its own would have to be meshed in three dimensions, its inclusions then left out; `plain` has
    none. Variations change sections of either.
    """

    def __init__(self, config: Config, scene: Scene):
        self.config = config
        self.scene = scene
        self.delta = max(scene.physics.deltas) * scene.physics.scales.depth
        tip: Any = config.indenter
        is_aside = isinstance(config.body, Cylinder) and any(config.center or ())
        self.has_cylinder_stand_in = (
            isinstance(config.body, Box) or is_aside
        )  # by a cylinder up to its nearest side
        self.has_imported_mesh = isinstance(config.body, MeshFromFile)
        self.is_spherical = isinstance(config.body, Cap | Ball)
        self.has_cone_stand_in = isinstance(
            tip, RegularPyramid
        )  # of equal sections, for the pyramid
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
        """What stands for the scene, in words."""
        stand_ins = {
            "a cylinder up to the nearest side": self.has_cylinder_stand_in,
            "the cone of equal sections": self.has_cone_stand_in,
        }
        used = [name for name, is_used in stand_ins.items() if is_used]
        return f" ({', '.join(used)} for it)" if used else ""

    @cached_property
    def side_supports(self) -> tuple[Support, ...]:
        """How the sides of the body, or of its round stand-ins, are held; empty where there are
        none.
        """
        match self.config.body:
            case Cylinder(sides=sides):
                return (
                    (sides,)
                    if sides != "roller" or not self.has_cylinder_stand_in
                    else ("free", "fixed")
                )
            case Box(sides=sides):
                supports = {sides.x_min, sides.x_max, sides.y_min, sides.y_max}
                return (supports.pop(),) if supports in ({"free"}, {"fixed"}) else ("free", "fixed")
        return ()

    @cached_property
    def single_step_scene(self) -> Config:
        """The scene to its deepest row in one step, all but its body, tip and place as usual."""
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
        """That scene on the body that stands for its own."""
        return self.replace_body(self.single_step_scene)

    def replace_body(self, scene: Config) -> Config:
        """A scene of this body; one that only a mesh in three dimensions has is a cylinder up to
        its nearest side.
        """
        body = scene.body
        is_round = all(
            inclusion.is_axisymmetric_about((0.0, 0.0)) for inclusion in body.inclusions or ()
        )
        if isinstance(body, Box | Cylinder):
            inclusions = (
                body.inclusions if is_round and not self.has_cylinder_stand_in else None
            )  # they have their place in the whole
            cylinder = Cylinder(
                body.lateral_extent(self.config.center or body.center), body.height, base=body.base
            )
            cylinder = replace(
                cylinder, sides=self.side_supports[0], layers=body.layers, inclusions=inclusions
            )
            cylinder = replace(cylinder, surface_tension=body.surface_tension)
            return replace_sections(scene, body=cylinder, center=None)
        center = scene.center if isinstance(body, Strip | MeshFromFile) else None
        if not is_round and body.dim == 3:
            body = replace(body, inclusions=None)  # type: ignore[arg-type]
        return replace_sections(scene, body=body, center=center)

    @cached_property
    def linear_scene(self) -> Config:
        """The scene at small strain, its contact the usual one."""
        return change_materials(self._stand_in_scene, variants.linear_law)

    @cached_property
    def plain_scene(self) -> Config:
        """The same without inclusions."""
        return variants.remove_inclusions(self.linear_scene)

    @cached_property
    def hyperelastic_scene(self) -> Config:
        """The same as `whole` with laws of finite strain: its own, or neo-Hookean."""
        return change_materials(self._stand_in_scene, variants.hyperelastic_law)

    @cached_property
    def layer_scene(self) -> Config | None:
        """The plain scene on the layer that its body is without its sides; None where it is no
        layer.
        """
        if isinstance(self.plain_scene.body, HalfSpace):
            return half_space_variant(self.plain_scene)
        return (
            variants.layer_variant(self.plain_scene)
            if isinstance(self.plain_scene.body, Cylinder | InfiniteLayer)
            else None
        )

    def replace_tip(self, tip: Indenter) -> Config:
        """The plain scene under another tip."""
        return replace_sections(self.plain_scene, indenter=tip)

    def meshed_variant(self, config: Config, **contact: Any) -> Config:
        """A variation on the mesh of all of them, whatever theory knows; under friction or adhesion
        in steps.
        """
        steps = max((count for name, count in PATH_STEPS.items() if contact.get(name)), default=1)
        loading_section = {"loading": Loading(delta=self.delta, steps=steps)} if steps > 1 else {}
        mesh = (
            {}
            if isinstance(self.config.body, MeshFromFile)
            else {"mesh": MeshSettings(h_contact=self._h_contact)}
        )
        return replace_sections(
            config, contact=AugmentedLagrangian(**contact), **mesh, **loading_section
        )

    @cached_property
    def friction_or_adhesion(self) -> dict[str, Any]:
        """The friction or the adhesion of the scene, as keys of its contact law."""
        return {
            name: value
            for name in PATH_STEPS
            if (value := getattr(self.config.contact, name, None))
        }

    @cached_property
    def _h_contact(self) -> float:
        contact = AugmentedLagrangian(adhesion=self.config.contact.adhesion)
        scene = resolve(replace_sections(self.linear_scene, contact=contact))
        return scene.sizes.h_contact * scene.physics.scales.length

    def force_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """Force of a variation over that of another: both by theory where that is exact, else both
        on one mesh; with a history at the row of the largest force. NotConverged, with the
        reason, where there is none.
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
        """The ratio, as a function of a parameter, of a variation with it over one that theory
        knows: what is followed far costs no mesh, but for a stretch of it.
        """

        def ratio(x: float) -> float:
            config = variant_at(x)
            if self._exact_theory_scene(without_effect) is None:
                raise NotConverged("no theory of such a body")
            return self.force_ratio(config, without_effect)

        return ratio

    def force(self, config: Config) -> float:
        """Force of a variation: by theory where that is exact, else on a mesh."""
        return self._cached(f"force {config!r}", lambda: self._solve_force(config))

    def _cached(self, name: str, find: Callable[[], T]) -> T:
        """What was found before, or fails as it did; any failure of a variation is a NotConverged
        that says why.
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
        if isinstance(config.body, MeshFromFile) and config.body.kinematics == "3d":
            raise NotConverged("nothing solved in the plane stands for it")
        scene = self._exact_theory_scene(config) or resolve(config)
        seconds = scene.plan.prediction.get("seconds", 0.0)
        if scene.is_meshed and scene.physics.domain.dim == 3 and seconds > 120.0:
            raise NotConverged(
                f"a run in three dimensions, about {seconds:.2g} s: `run` the scene with it and "
                "without"
            )
        *_, last = states(scene, with_surface=False)
        if not last.converged:
            raise NotConverged("did not converge")
        return last.force

    def _exact_theory_scene(self, config: Config) -> Scene | None:
        """The scene of a variation that theory solves exactly."""
        if not _is_fully_automatic(config):
            return None

        def known() -> Scene | None:
            with suppress(ConfigError):
                return resolve(
                    replace_sections(config, solver=replace(config.solver, method="theory"))
                )
            return None

        return self._cached(f"theory {config!r}", known)

    def history_result(self, config: Config) -> HistoryResult:
        """What the history of a variation comes to."""

        def conducted() -> HistoryResult:
            scene = self._exact_theory_scene(config) or resolve(config)
            return evaluate_with_units(
                scene, condense(scene).equilibrium if scene.is_meshed else None
            )

        return self._cached(f"history {config!r}", conducted)

    def _history_ratio(self, with_effect: Config, without_effect: Config) -> float:
        """At the row of the largest force; where forces are prescribed, over the elastic force at
        the depth there.
        """
        rows = self.history_result(with_effect).rows
        top = max(rows, key=lambda row: row.force)
        if not (top.force > 0 and top.a > 0):  # it pulls all the way
            top = max(rows, key=lambda row: row.delta)
        if with_effect.loading.force_history:
            return _positive_ratio(
                top.force,
                self.force(
                    replace_sections(self.linear_scene, loading=Loading(delta=top.delta, steps=1))
                ),
            )
        reference_row = min(
            self.history_result(without_effect).rows,
            key=lambda row: (abs(row.t - top.t), -row.force),
        )
        return _positive_ratio(top.force, reference_row.force)

    @cached_property
    def scene_force(self) -> float:
        """Force of the whole scene."""
        force = self.force(self.linear_scene)
        if not 0 < force < inf:
            raise NotConverged("the tip does not push")
        return force

    @cached_property
    def half_space_scene(self) -> Config | None:
        """The half-space of what the tip touches, under the tip relative to the body's curvature;
        None in the plane.
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
        below = HalfSpace(surface_tension=self.plain_scene.body.surface_tension)
        return replace_sections(
            self.plain_scene,
            body=below,
            material=self.touched_material,
            indenter=tip,
            center=None,
            loading=loading,
        )

    @property
    def touched_material(self) -> LinearElastic:
        """What the tip touches at small strain."""
        physics = self.scene.physics
        E, nu = physics.material.constants
        return LinearElastic(E=float(f"{E * physics.scales.pressure:.12g}"), nu=nu)

    @cached_property
    def theory_variant(self) -> Config | None:
        """The plain scene on the body nearest to its own that theory solves."""
        bodies = (self.plain_scene, self.layer_scene, self.half_space_scene)
        return next(
            (
                candidate
                for candidate in bodies
                if candidate is not None and self._exact_theory_scene(candidate) is not None
            ),
            None,
        )

    @cached_property
    def theory_scene(self) -> Scene | None:
        """That scene."""
        return (
            self._exact_theory_scene(self.theory_variant)
            if self.theory_variant is not None
            else None
        )

    @property
    def theory(self) -> Theory | None:
        """Its theory."""
        return self.theory_scene.plan.theory if self.theory_scene is not None else None

    def force_at_depth(self, delta: float) -> float:
        """Force at a depth: theory's curve, drawn through the deepest force; a power law where
        there is none.
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
    """Whether contact law and mesh are left to the program."""
    return isinstance(config.contact, AutoContact) and config.mesh == MeshSettings()


def _positive_ratio(numerator: float, denominator: float) -> float:
    if not (isfinite(numerator) and 0 < denominator < inf):
        raise NotConverged("without it the tip does not push")
    return numerator / denominator


def history_variant(solver: VariantSolver, *part_names: str) -> Config:
    """The whole scene along its history with these parts of the experiment, or the relaxation,
    alone; without a history it goes straight to the deepest row.
    """
    loading = solver.config.loading
    experiment = solver.config.experiment
    straight = Loading(history=((0.0, 0.0), (1.0, solver.delta)))
    kept_parts = {
        name: part_value for name in part_names if (part_value := getattr(experiment, name, None))
    }
    sections = {
        "loading": replace(loading, times="auto") if loading.prescribed_history else straight
    }
    law = next((material.relaxation for _, material in solver.config.materials()), None)
    relaxation = law if "relaxation" in part_names else None
    return change_materials(
        solver.linear_scene,
        lambda material: replace(material, relaxation=relaxation),
        **sections,
        experiment=Experiment(**kept_parts) if kept_parts else None,
    )
