"""Effects of drainage and of shear relaxation on the force, relative to the elastic limits.

The scene is solved along its history. Its elastic limiting cases are solved at the depth of the row
with the largest force. All solutions use the same mesh and no friction. The limits of the effect
`drainage` are the drained and the undrained body; the limits of `rate` are the unrelaxed and the
relaxed body. An effect is 100 (F/F_first - 1), with the force F of the scene and the force F_first
in the first limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

from indent_sim.config.scene_sections import MeshSettings, OutputSettings, SolverSettings
from indent_sim.config.schema import Config
from indent_sim.model.contact import AugmentedLagrangian
from indent_sim.model.drainage import Drainage
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.state import State
from indent_sim.process.errors import NotConverged
from indent_sim.run.model_selection.effects import Cases, Effect, Range, find_effect
from indent_sim.run.model_selection.scene_variants import SceneVariants
from indent_sim.run.model_selection.variants import (
    change_materials,
    drained_law,
    instantaneous_law,
    replace_sections,
    rounded_law,
    undrained_law,
)
from indent_sim.scene.limiting_elastic_laws import relaxed_law
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.scene.problem_definition import largest_diffusivity
from indent_sim.scene.scene import Scene, resolve

TIME_EFFECTS: dict[str, Cases] = {
    "drainage": (
        Range(
            "the force relative to that in swelling equilibrium; the range extends to the force "
            "before any flow{v.row_text}",
            lambda v: v.swelling_range,
            when=lambda v: v.has_bath,
        ),
        Range(
            "the force relative to that of the drained body; the range extends to the force of "
            "the undrained body{v.row_text}",
            lambda v: v.drainage_range,
        ),
    ),
    "rate": (
        Range(
            "the force relative to that of the unrelaxed body; the range extends to the force of "
            "the relaxed body{v.row_text}",
            lambda v: v.relaxation_range,
        ),
    ),
}


class TransientVariants(SceneVariants):
    """Variants of a time-dependent scene; the solver solves each variant once.

    Attributes
    ----------
    has_bath
        True if a bath swells or shrinks the body, which then has no elastic limiting cases.
    """

    def __init__(self, config: Config, scene: Scene, tolerance: float = 0.01):
        super().__init__(config, scene, tolerance)
        self.physics = scene.physics
        # A bath always lies between these values.
        bath_values = scene.physics.drainage.bath_values
        # Smaller pressures of a bath, relative to E, are zero.
        negligible_bath_pressure = 1e-9
        self.has_bath = any(
            abs(region.material.bath_pressure(value)) > negligible_bath_pressure
            for region in scene.physics.permeable_regions
            for value in bath_values
        )

    @cached_property
    def time_effects(self) -> dict[str, Effect]:
        """Return the effect "drainage" of permeable regions and "rate" of relaxing regions."""
        regions: dict[str, Sequence[object]] = {
            "drainage": self.physics.permeable_regions,
            "rate": self.physics.relaxing_regions,
        }
        return {
            name: find_effect(name, cases, self)
            for name, cases in TIME_EFFECTS.items()
            if regions[name]
        }

    @property
    def nearest_limits(self) -> dict[str, Effect]:
        """Return, for each effect, the limiting case whose force is nearest to the scene's force.

        The keys are the names of these limiting cases. The values are the effects that an elastic
        model of the limiting case neglects.
        """
        limits = {}
        for effect in self.time_effects.values():
            changes = limiting_case_changes(effect)
            neglected = [
                Effect(effect.name, change, change, change, f"the {name} body")
                for name, change in changes.items()
            ]
            pairs = zip(changes, neglected, strict=True)
            name, nearest = min(pairs, key=lambda pair: pair[1].max_change)
            limits[name] = nearest
        return limits

    @property
    def elastic_variant(self) -> Config:
        """Return the scene with the elastic laws of the nearest limits."""
        variant = self._replace_laws(self.config, tuple(self.nearest_limits))
        return replace_sections(
            variant,
            loading=replace(variant.loading, per_doubling=None),
            output=replace(variant.output, fields="auto"),
        )

    @property
    def variant_at_depth(self) -> Config:
        """Return the elastic variant, loaded in a single step to the depth of the largest force."""
        try:
            delta = self._largest_force_row.delta
        except NotConverged:
            delta = self.delta
        return replace_sections(self.elastic_variant, loading=Loading(delta=delta, steps=1))

    @property
    def drainage_range(self) -> tuple[float, float, float]:
        """Return (low, high, value) of F/F_drained - 1, the change from the drained body."""
        return _range_of_limits(
            self._largest_force_row.force,
            self._limit_force("drained"),
            self._limit_force("undrained"),
        )

    @property
    def swelling_range(self) -> tuple[float, float, float]:
        """Return (low, high, value) of F/F_swollen - 1, the change from swelling equilibrium.

        The bounds are 0 and the change of the undrained body. All forces are those at the depth,
        and in the bath, of the row with the largest force.
        """
        equilibrated = self._equilibrated_force
        instantaneous = self._limit_force("undrained") if self._largest_force_row.delta > 0 else 0.0
        if not equilibrated > 0:
            raise NotConverged("the force in swelling equilibrium is not positive")
        return _range_of_limits(self._largest_force_row.force, equilibrated, instantaneous)

    @property
    def relaxation_range(self) -> tuple[float, float, float]:
        """Return (low, high, value) of F/F_unrelaxed - 1, the change from the unrelaxed body.

        The bounds are 0 and the change of the relaxed body.

        If the body also drains, all forces are those of the drained body.
        """
        drained = ("drained",) if self.physics.permeable_regions else ()
        return _range_of_limits(
            self._limit_force(*drained) if drained else self._largest_force_row.force,
            self._limit_force(*drained, "unrelaxed"),
            self._limit_force(*drained, "relaxed"),
        )

    @property
    def row_text(self) -> str:
        """Text on time and depth of the row with the largest force, for the source of an effect."""
        row = self._largest_force_row
        friction_text = ", without friction" if self.friction_or_adhesion else ""
        return (
            f", at t = {row.t:.4g}, delta = {row.delta:.4g}, on one mesh{friction_text}"
            f"{self.stand_in_text}"
        )

    @cached_property
    def _transient_scene(self) -> Config:
        """Return the scene with the stand-in for its body, up to the last increase of its load.

        Contact, solver and output have default settings. The mesh has default settings except for
        the element size at the contact, which is taken from the scene.
        """
        config = self.config
        transient = replace_sections(
            config,
            contact=AugmentedLagrangian(gap=config.contact.gap),
            solver=SolverSettings(),
            output=OutputSettings(),
            indenter=self.tip,
            accuracy=None,
            experiment=None,
            loading=(
                replace(config.loading, times="auto")
                if self.has_bath
                else _cut_after_last_rise(config.loading)
            ),
        )
        transient = self.replace_body(transient)
        scene = resolve(transient)
        if isinstance(config.body, MeshFromFile):
            return transient
        h_contact = scene.sizes.h_contact * scene.physics.scales.length
        return replace_sections(transient, mesh=MeshSettings(h_contact=h_contact))

    def _rows(self, config: Config) -> list[State]:
        """Return the rows of a variant; raise NotConverged if a row does not converge."""
        rows = self.solver.rows(config)
        if not rows[-1].converged:
            raise NotConverged(rows[-1].reason)
        return rows

    @cached_property
    def _largest_force_row(self) -> State:
        """Return the first row with the largest force.

        Raises
        ------
        NotConverged
            If the force is not positive.
        """
        rows = self._rows(self._transient_scene)
        max_force = max(row.force for row in rows)
        # Forces that agree to this relative tolerance count as equal. The first row of the largest
        # force is used, because a prescribed force is often held.
        force_tolerance = 1e-6
        min_force = max_force - force_tolerance * abs(max_force)
        largest_row = next(row for row in rows if row.force >= min_force)
        if not largest_row.force > 0:
            raise NotConverged("the largest force is not positive")
        return largest_row

    def _limit_force(self, *limits: str) -> float:
        """Return the force at the row of the largest force, with the laws of limiting cases.

        A body that still depends on time follows the history up to this row.
        """
        config = self._replace_laws(self._transient_scene, limits)
        is_time_dependent = any(law.is_time_dependent for _, law in config.materials())
        loading = (
            self._loading_to_row()
            if is_time_dependent
            else Loading(delta=self._largest_force_row.delta, steps=1)
        )
        return self._rows(replace_sections(config, loading=loading))[-1].force

    @property
    def _equilibrated_force(self) -> float:
        """Return the force in swelling equilibrium, at the depth of the largest force."""
        t = self._largest_force_row.t
        delta = self._largest_force_row.delta
        drainage = self._transient_scene.drainage or Drainage()
        # Fluid does not flow any more after this multiple of the diffusion time H^2/D.
        equilibration_factor = 1e3
        duration = (
            equilibration_factor * self.physics.body.height**2 / largest_diffusivity(self.physics)
        )
        hold = Loading(history=((0.0, delta), (duration, delta)), times=(duration,), per_doubling=2)
        constant_bath = replace(drainage, bath=drainage.bath_at(t or 0.0))
        scene = replace_sections(self._transient_scene, loading=hold, drainage=constant_bath)
        return self._rows(scene)[-1].force

    def _replace_laws(self, config: Config, limits: tuple[str, ...]) -> Config:
        """Return a scene with the material laws of elastic limiting cases."""
        history = self.config.loading.prescribed_history

        def relax(law: Material) -> Material:
            """Return the law with the modulus that remains at the end of the history."""
            return relaxed_law(law.canonical(), remaining_modulus_fraction(law.relaxation, history))

        limit_laws = {
            "drained": drained_law,
            "undrained": undrained_law,
            "unrelaxed": instantaneous_law,
            "relaxed": relax,
        }

        def replace_law(law: Material) -> Material:
            """Return a law in each of the given limits, one after the other."""
            for limit in limits:
                law = rounded_law(limit_laws[limit](law))
            return law

        laws = [replace_law(law) for _, law in config.materials()]
        is_time_dependent = any(law.is_time_dependent for law in laws)
        per_doubling = config.loading.per_doubling if is_time_dependent else None
        return change_materials(
            config,
            replace_law,
            drainage=config.drainage if any(law.flow for law in laws) else None,
            loading=replace(config.loading, per_doubling=per_doubling),
        )

    def _loading_to_row(self) -> Loading:
        """Return the depth history up to the row of the largest force.

        Raises
        ------
        NotConverged
            If forces are prescribed.
        """
        loading = self._transient_scene.loading
        row = self._largest_force_row
        if loading.history is None or row.t is None:
            raise NotConverged(
                "drainage and relaxation of one body cannot be separated under prescribed forces"
            )
        earlier_points = tuple(point for point in loading.history if point[0] <= row.t)
        is_initial_jump = row.t == loading.history[0][0]
        last_point = () if earlier_points[-1][0] == row.t else ((row.t, row.delta),)
        return replace(
            loading,
            history=loading.history if is_initial_jump else (*earlier_points, *last_point),
            times=(row.t,),
        )


def _range_of_limits(force: float, first: float, second: float) -> tuple[float, float, float]:
    """Return (low, high, value) of the relative change of the force from the first limit."""
    low, high = sorted((0.0, second / first - 1))
    return low, high, force / first - 1


def limiting_case_changes(effect: Effect) -> dict[str, float | None]:
    """Return 100 (F/F_limit - 1) for both limits of an effect "drainage" or "rate".

    The keys are the names of the limits. F is the force of the scene, and F_limit the force in the
    limit; unknown values are None.
    """
    # First and second elastic limiting case of each effect.
    limits = {"drainage": ("drained", "undrained"), "rate": ("unrelaxed", "relaxed")}
    first, second = limits[effect.name]
    second_percent = None
    if effect.percent is not None and effect.low is not None and effect.high is not None:
        range_end = effect.low if effect.low < 0 else effect.high
        if range_end > -100:
            second_percent = 100 * ((100 + effect.percent) / (100 + range_end) - 1)
    return {first: effect.percent, second: second_percent}


def _cut_after_last_rise(loading: Loading) -> Loading:
    """Return a loading in time up to the last increase of its value."""
    (quantity,) = loading.given_path_keys
    points = getattr(loading, quantity)
    rises = [k for k, (previous, point) in enumerate(pairwise(points), 1) if point[1] > previous[1]]
    end = max(rises, default=0) + 1
    # A jump at the beginning is followed by a hold, without which there is no time.
    while points[end - 1][0] == points[0][0]:
        end += 1
    return replace(loading, times="auto", **{quantity: points[:end]})  # type: ignore[arg-type]
