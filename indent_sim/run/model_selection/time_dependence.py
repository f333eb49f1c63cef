"""Effects of drainage and of relaxation in shear on the force, and their elastic limits.

The scene is solved along its history, and its elastic limits at the depth of the row with the
largest force, all on one mesh and without friction. The limits of the effect `drainage` are the
drained and the undrained body, those of `rate` the unrelaxed and the relaxed body. An effect is
100 (F/F_first - 1), with the force F of the scene and F_first of the first limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

from indent_sim.config.scene_sections import MeshSettings, OutputSettings, SolverSettings
from indent_sim.config.schema import Config
from indent_sim.model.contact import AugmentedLagrangian
from indent_sim.model.drainage import Drainage
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.state import State
from indent_sim.process.errors import NotConverged
from indent_sim.run.model_selection.effects import Effect, solve_effect
from indent_sim.run.model_selection.variant_solver import VariantSolver
from indent_sim.run.model_selection.variants import (
    change_materials,
    drained_law,
    instantaneous_law,
    replace_sections,
    rounded_law,
    undrained_law,
)
from indent_sim.run.pipeline import states
from indent_sim.scene.elastic_limit_laws import relaxed_law
from indent_sim.scene.prescribed_history import remaining_modulus_fraction
from indent_sim.scene.problem_definition import largest_diffusivity
from indent_sim.scene.scene import Scene, resolve

# Longest run of a scene for its requirements [s].
MAX_SECONDS = 600.0
# Forces that agree to this relative tolerance count as equal. The first row of the largest force
# is used, because a prescribed force is often held.
FORCE_TOLERANCE = 1e-6
# Fluid does not flow any more after this multiple of the diffusion time H^2/D.
EQUILIBRATION_FACTOR = 1e3
# Smaller pressures of a bath, relative to E, are zero.
NEGLIGIBLE_BATH_PRESSURE = 1e-9
# First and second elastic limit of each effect.
LIMITS = {"drainage": ("drained", "undrained"), "rate": ("unrelaxed", "relaxed")}


@dataclass(frozen=True)
class ElasticLimit:
    """An elastic limit of a time-dependent body.

    Attributes
    ----------
    effect
        Name of the effect that it neglects.
    name
        Name of the limit.
    percent
        100 (F/F_limit - 1) with the force F of the scene and F_limit of the limit [per cent]; None
        if it is unknown.
    """

    effect: str
    name: str
    percent: float | None

    @property
    def neglected_effect(self) -> Effect:
        """The effect that a model of this elastic body neglects."""
        return Effect(
            self.effect, self.percent, self.percent, self.percent, f"the {self.name} body"
        )


class TimeDependentEffects:
    """Effects of time on the force of a scene; every force is computed once.

    Attributes
    ----------
    config, physics
        The scene and its nondimensional problem.
    has_bath
        A bath swells or shrinks the body, which then has no elastic limits.
    """

    def __init__(self, config: Config, scene: Scene):
        self.config = config
        self.physics = scene.physics
        pressures = [
            region.material.bath_pressure(p)
            for region in scene.physics.permeable_regions
            for p in self._baths
        ]
        self.has_bath = any(abs(pressure) > NEGLIGIBLE_BATH_PRESSURE for pressure in pressures)
        self._solver = VariantSolver(self.config, scene)
        self._cache = dict[tuple[str, ...], float]()

    @property
    def _baths(self) -> tuple[float, ...]:
        """Values of the bath, between which it always lies."""
        return self.physics.drainage.bath_values

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The effects "drainage" and "rate", if the body drains or relaxes in shear."""
        rows = []
        if self.physics.permeable_regions:
            rows.append(solve_effect("drainage", self._drainage_effect))
        if self.physics.relaxing_regions:
            rows.append(solve_effect("rate", self._rate_effect))
        return tuple(rows)

    @property
    def nearest_limits(self) -> tuple[ElasticLimit, ...]:
        """The limit of each effect whose force is nearest to that of the scene."""
        return tuple(
            min(elastic_limits(effect), key=lambda limit: limit.neglected_effect.max_change)
            for effect in self.effects
        )

    @property
    def elastic_variant(self) -> Config:
        """The scene with the elastic laws of the nearest limits."""
        variant = self._replace_laws(
            self.config, tuple(limit.name for limit in self.nearest_limits)
        )
        loading = replace(variant.loading, per_doubling=None)
        return replace_sections(
            variant, loading=loading, output=replace(variant.output, fields="auto")
        )

    @property
    def variant_at_depth(self) -> Config:
        """The elastic variant in a single step to the depth of the largest force."""
        try:
            loading = Loading(delta=self._largest_force_row.delta, steps=1)
        except NotConverged:
            loading = Loading(delta=max(self.physics.deltas) * self.physics.scales.depth, steps=1)
        return replace_sections(self.elastic_variant, loading=loading)

    def _drainage_effect(self) -> Effect:
        """The force of the scene relative to its drained body."""
        if self.has_bath:
            return self._swelling_effect()
        source = (
            "the scene relative to its drained body, the range up to its undrained body"
            f"{self._row_text}"
        )
        change = self._largest_force_row.force / self._limit_force("drained") - 1
        return _make_effect(
            "drainage",
            change,
            self._limit_force("undrained") / self._limit_force("drained") - 1,
            source,
        )

    def _swelling_effect(self) -> Effect:
        """The force relative to swelling equilibrium in the bath of the row, at the same depth."""
        source = (
            "the scene relative to its swelling equilibrium, the range from the body before any "
            f"flow{self._row_text}"
        )
        equilibrated = self._equilibrated_force
        instantaneous = self._limit_force("undrained") if self._largest_force_row.delta > 0 else 0.0
        if not equilibrated > 0:
            raise NotConverged("the force in swelling equilibrium is not positive")
        return _make_effect(
            "drainage",
            self._largest_force_row.force / equilibrated - 1,
            instantaneous / equilibrated - 1,
            source,
        )

    def _rate_effect(self) -> Effect:
        """The force of the scene, or of its drained body, relative to its unrelaxed body."""
        source = (
            "the scene relative to its unrelaxed body, the range down to its relaxed body"
            f"{self._row_text}"
        )
        drained_limit = ("drained",) if self.physics.permeable_regions else ()
        force = (
            self._limit_force(*drained_limit) if drained_limit else self._largest_force_row.force
        )
        unrelaxed_force = self._limit_force(*drained_limit, "unrelaxed")
        return _make_effect(
            "rate",
            force / unrelaxed_force - 1,
            self._limit_force(*drained_limit, "relaxed") / unrelaxed_force - 1,
            source,
        )

    @property
    def _row_text(self) -> str:
        """Text on the row of the largest force, to be appended to the source of an effect."""
        row = self._largest_force_row
        friction_text = ", without friction" if self._solver.friction_or_adhesion else ""
        return (
            f", at t = {row.t:.4g}, delta = {row.delta:.4g}, on one mesh{friction_text}"
            f"{self._solver.stand_in_text}"
        )

    @cached_property
    def _transient_scene(self) -> Config:
        """The scene on the stand-in for its body, up to the last rise of its load path.

        Contact, solver and output have default settings. The element size at the contact is that
        of the scene, and its mesh otherwise has default settings.
        """
        config = self.config
        default_sections = {
            "contact": AugmentedLagrangian(gap=config.contact.gap),
            "solver": SolverSettings(),
            "output": OutputSettings(),
        }
        loading = (
            replace(config.loading, times="auto")
            if self.has_bath
            else _cut_after_last_rise(config.loading)
        )
        transient = replace_sections(
            config,
            **default_sections,
            indenter=self._solver.tip,
            accuracy=None,
            experiment=None,
            loading=loading,
        )
        transient = self._solver.replace_body(transient)
        scene = resolve(transient)
        if self._solver.has_imported_mesh:
            return transient
        h_contact = scene.sizes.h_contact * scene.physics.scales.length
        return replace_sections(transient, mesh=MeshSettings(h_contact=h_contact))

    @cached_property
    def _largest_force_row(self) -> State:
        """The first row of the largest force; NotConverged if the force is not positive."""
        rows = _solve_rows(self._transient_scene)
        max_force = max(row.force for row in rows)
        min_force = max_force - FORCE_TOLERANCE * abs(max_force)
        largest_row = next(row for row in rows if row.force >= min_force)
        if not largest_row.force > 0:
            raise NotConverged("the largest force is not positive")
        return largest_row

    def _limit_force(self, *limits: str) -> float:
        """Force of the body with the laws of limits, at the row of the largest force.

        A body that still depends on time follows the history up to this row.
        """
        if limits not in self._cache:
            config = self._replace_laws(self._transient_scene, limits)
            is_time_dependent = any(law.is_time_dependent for _, law in config.materials())
            loading = (
                self._loading_to_row()
                if is_time_dependent
                else Loading(delta=self._largest_force_row.delta, steps=1)
            )
            self._cache[limits] = _solve_rows(replace_sections(config, loading=loading))[-1].force
        return self._cache[limits]

    @cached_property
    def _equilibrated_force(self) -> float:
        """Force in swelling equilibrium, at the depth and in the bath of the largest force."""
        t = self._largest_force_row.t
        delta = self._largest_force_row.delta
        drainage = self._transient_scene.drainage or Drainage()
        duration = (
            EQUILIBRATION_FACTOR * self.physics.body.height**2 / largest_diffusivity(self.physics)
        )
        hold = Loading(history=((0.0, delta), (duration, delta)), times=(duration,), per_doubling=2)
        constant_bath = replace(drainage, bath=drainage.bath_at(t or 0.0))
        scene = replace_sections(self._transient_scene, loading=hold, drainage=constant_bath)
        return _solve_rows(scene)[-1].force

    def _replace_laws(self, config: Config, limits: tuple[str, ...]) -> Config:
        """A scene with the material laws of limits."""
        history = self.config.loading.prescribed_history

        def relax(law: Material) -> Material:
            """The law with the modulus that remains at the end of the history."""
            return relaxed_law(law.canonical(), remaining_modulus_fraction(law.relaxation, history))

        limit_laws = {
            "drained": drained_law,
            "undrained": undrained_law,
            "unrelaxed": instantaneous_law,
            "relaxed": relax,
        }

        def replace_law(law: Material) -> Material:
            """The law in all limits."""
            for limit in limits:
                law = rounded_law(limit_laws[limit](law))
            return law

        laws = [replace_law(law) for _, law in config.materials()]
        drainage = config.drainage if any(law.flow for law in laws) else None
        per_doubling = (
            config.loading.per_doubling if any(law.is_time_dependent for law in laws) else None
        )
        return change_materials(
            config,
            replace_law,
            drainage=drainage,
            loading=replace(config.loading, per_doubling=per_doubling),
        )

    def _loading_to_row(self) -> Loading:
        """Depth history up to the row of the largest force; NotConverged for prescribed forces."""
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


def _make_effect(name: str, change: float, limit_change: float, source: str) -> Effect:
    """An effect from the relative force changes of the scene and of the second limit."""
    low, high = sorted((0.0, 100 * limit_change))
    return Effect(name, 100 * change, low, high, source)


def elastic_limits(effect: Effect) -> tuple[ElasticLimit, ElasticLimit]:
    """First and second limit of an effect "drainage" or "rate", compared with the scene."""
    first, second = LIMITS[effect.name]
    if effect.percent is None or effect.low is None or effect.high is None:
        return ElasticLimit(effect.name, first, None), ElasticLimit(effect.name, second, None)
    range_end = effect.low if effect.low < 0 else effect.high
    second_percent = None
    if range_end > -100:
        second_percent = 100 * ((100 + effect.percent) / (100 + range_end) - 1)
    return (
        ElasticLimit(effect.name, first, effect.percent),
        ElasticLimit(effect.name, second, second_percent),
    )


def _cut_after_last_rise(loading: Loading) -> Loading:
    """A loading in time up to the last rise of its value, after which the force is not larger."""
    (quantity,) = loading.given_path_keys
    points = getattr(loading, quantity)
    rises = [
        k
        for k, (previous, following) in enumerate(pairwise(points), start=1)
        if following[1] > previous[1]
    ]
    end = max(rises, default=0) + 1
    # A jump at the beginning is followed by a hold, without which there is no time.
    while points[end - 1][0] == points[0][0]:
        end += 1
    return replace(loading, times="auto", **{quantity: points[:end]})  # type: ignore[arg-type]


def _solve_rows(config: Config) -> list[State]:
    """The rows of a scene; NotConverged if it takes too long, or one of them does not converge."""
    scene = resolve(config)
    seconds = scene.plan.prediction.get("seconds", 0.0)
    if seconds > MAX_SECONDS:
        raise NotConverged(
            f"the run would take about {seconds:.2g} s; run the scene and its elastic limits "
            "instead"
        )
    rows = list(states(scene, with_surface=False))
    if not rows[-1].converged:
        raise NotConverged(rows[-1].reason)
    return rows
