"""What time makes of the force of a body that drains, or whose shear relaxes, between the elastic
bodies of its limits.

At the row of the largest force, on one mesh and without friction: the scene along its history,
beside elastic bodies at the depth of that row. Drained and undrained are the limits of `drainage`,
unrelaxed and relaxed those of `rate`; an effect is what is over the first of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

from indent_sim.config.schema import Config, MeshSettings, OutputSettings, SolverSettings
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

MAX_SECONDS = 600.0  # s: of a scene that is solved to say what it requires
FORCE_TOLERANCE = 1e-6  # relative: of rows of a prescribed force, of which the first counts
EQUILIBRATION_FACTOR = 1e3  # H^2/D, after which fluid no longer flows
NEGLIGIBLE_BATH_PRESSURE = 1e-9  # of E, the pressure of a bath that is none
LIMITS = {"drainage": ("drained", "undrained"), "rate": ("unrelaxed", "relaxed")}


@dataclass(frozen=True)
class ElasticLimit:
    """An elastic body in place of one that evolves: which effect it leaves out, which limit it is,
    and by how many per cent the scene's force is off its own; None where that is not known.
    """

    effect: str
    name: str
    percent: float | None

    @property
    def waived_effect(self) -> Effect:
        """What a model of that body leaves out."""
        return Effect(
            self.effect, self.percent, self.percent, self.percent, f"the {self.name} body"
        )


class TimeDependentEffects:
    """What time makes of the force of a scene; every force is solved once."""

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
        return self.physics.drainage.bath_values

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Its rows of the table."""
        rows = []
        if self.physics.permeable_regions:
            rows.append(solve_effect("drainage", self._drainage_effect))
        if self.physics.relaxing_regions:
            rows.append(solve_effect("rate", self._rate_effect))
        return tuple(rows)

    @property
    def nearest_limits(self) -> tuple[ElasticLimit, ...]:
        """Of each effect the limit whose force is nearest."""
        return tuple(
            min(elastic_limits(effect), key=lambda limit: limit.waived_effect.max_change)
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
        """The same, at the depth of its largest force alone."""
        try:
            loading = Loading(delta=self._largest_force_row.delta, steps=1)
        except NotConverged:
            loading = Loading(delta=max(self.physics.deltas) * self.physics.scales.depth, steps=1)
        return replace_sections(self.elastic_variant, loading=loading)

    def _drainage_effect(self) -> Effect:
        if self.has_bath:
            return self._swelling_effect()
        source = (
            f"the scene over its drained body, the range up to its undrained one{self._row_text}"
        )
        change = self._largest_force_row.force / self._limit_force("drained") - 1
        return _make_effect(
            "drainage",
            change,
            self._limit_force("undrained") / self._limit_force("drained") - 1,
            source,
        )

    def _swelling_effect(self) -> Effect:
        """Beside what its force becomes in the bath of that row, at that depth."""
        source = (
            "the scene over the same at rest in its bath, the range from before any fluid "
            f"came{self._row_text}"
        )
        equilibrated = self._equilibrated_force
        instantaneous = self._limit_force("undrained") if self._largest_force_row.delta > 0 else 0.0
        if not equilibrated > 0:
            raise NotConverged("at rest in its bath it does not push")
        return _make_effect(
            "drainage",
            self._largest_force_row.force / equilibrated - 1,
            instantaneous / equilibrated - 1,
            source,
        )

    def _rate_effect(self) -> Effect:
        source = (
            "the scene over that of an elastic body, the range down to its relaxed "
            f"one{self._row_text}"
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
        friction_text = ", without friction" if self._solver.friction_or_adhesion else ""
        return (
            f", at t = {self._largest_force_row.t:.4g}, delta = {self._largest_force_row.delta:.4g}, on one "
            f"mesh{friction_text}{self._solver.stand_in_text}"
        )

    @cached_property
    def _transient_scene(self) -> Config:
        """The scene on the body that stands for its own, all but that as usual, as far as its force
        may grow.
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
        h = scene.sizes.h_contact * scene.physics.scales.length
        return (
            transient
            if self._solver.has_imported_mesh
            else replace_sections(transient, mesh=MeshSettings(h_contact=h))
        )

    @cached_property
    def _largest_force_row(self) -> State:
        """The row of the largest force, the first of those."""
        rows = _solve_rows(self._transient_scene)
        largest = max(row.force for row in rows)
        top = next(row for row in rows if row.force >= largest - FORCE_TOLERANCE * abs(largest))
        if not top.force > 0:
            raise NotConverged("the tip does not push")
        return top

    def _limit_force(self, *limits: str) -> float:
        """Force at that row with other laws: of an elastic body at its depth, of one that still
        relaxes on its way.
        """
        if limits not in self._cache:
            config = self._replace_laws(self._transient_scene, limits)
            evolves = any(law.is_time_dependent for _, law in config.materials())
            loading = (
                self._loading_to_row()
                if evolves
                else Loading(delta=self._largest_force_row.delta, steps=1)
            )
            self._cache[limits] = _solve_rows(replace_sections(config, loading=loading))[-1].force
        return self._cache[limits]

    @cached_property
    def _equilibrated_force(self) -> float:
        """Force at the depth of that row when no fluid flows any more in the bath of its time."""
        t = self._largest_force_row.t
        delta = self._largest_force_row.delta
        drainage = self._transient_scene.drainage or Drainage()
        end = EQUILIBRATION_FACTOR * self.physics.body.height**2 / largest_diffusivity(self.physics)
        hold = Loading(history=((0.0, delta), (end, delta)), times=(end,), per_doubling=2)
        bath = replace(drainage, bath=drainage.bath_at(t or 0.0))
        return _solve_rows(replace_sections(self._transient_scene, loading=hold, drainage=bath))[
            -1
        ].force

    def _replace_laws(self, config: Config, limits: tuple[str, ...]) -> Config:
        """A scene of this body with the laws of limits."""
        history = self.config.loading.prescribed_history

        def soft(law: Material) -> Material:
            return relaxed_law(law.canonical(), remaining_modulus_fraction(law.relaxation, history))

        changes = {
            "drained": drained_law,
            "undrained": undrained_law,
            "unrelaxed": instantaneous_law,
            "relaxed": soft,
        }

        def changed(law: Material) -> Material:
            for limit in limits:
                law = rounded_law(changes[limit](law))
            return law

        laws = [changed(law) for _, law in config.materials()]
        drainage = config.drainage if any(law.flow for law in laws) else None
        per_doubling = (
            config.loading.per_doubling if any(law.is_time_dependent for law in laws) else None
        )
        return change_materials(
            config,
            changed,
            drainage=drainage,
            loading=replace(config.loading, per_doubling=per_doubling),
        )

    def _loading_to_row(self) -> Loading:
        """The way to that row of a body whose depth is prescribed."""
        loading = self._transient_scene.loading
        top = self._largest_force_row
        if loading.history is None or top.t is None:
            raise NotConverged(
                "under prescribed forces a body that both drains and relaxes is not taken apart"
            )
        earlier_points = tuple(point for point in loading.history if point[0] <= top.t)
        is_at_once = top.t == loading.history[0][0]
        last_point = () if earlier_points[-1][0] == top.t else ((top.t, top.delta),)
        return replace(
            loading,
            history=loading.history if is_at_once else (*earlier_points, *last_point),
            times=(top.t,),
        )


def _make_effect(name: str, change: float, limit_change: float, source: str) -> Effect:
    """An effect by relative changes of the force: the scene's, and that of the other limit."""
    low, high = sorted((0.0, 100 * limit_change))
    return Effect(name, 100 * change, low, high, source)


def elastic_limits(effect: Effect) -> tuple[ElasticLimit, ElasticLimit]:
    """The scene beside both limits of an effect."""
    first, second = LIMITS[effect.name]
    if effect.percent is None or effect.low is None or effect.high is None:
        return ElasticLimit(effect.name, first, None), ElasticLimit(effect.name, second, None)
    range_end = effect.low if effect.low < 0 else effect.high
    second_percent = (
        100 * ((100 + effect.percent) / (100 + range_end) - 1) if range_end > -100 else None
    )
    return ElasticLimit(effect.name, first, effect.percent), ElasticLimit(
        effect.name, second, second_percent
    )


def _cut_after_last_rise(loading: Loading) -> Loading:
    """A loading in time up to where its value rises for the last time: what follows pushes no
    harder.
    """
    (quantity,) = loading.given_path_keys
    points = getattr(loading, quantity)
    rises = [
        k
        for k, (previous, following) in enumerate(pairwise(points), start=1)
        if following[1] > previous[1]
    ]
    end = max(rises, default=0) + 1
    while points[end - 1][0] == points[0][0]:  # a jump from rest, and what holds it
        end += 1
    return replace(loading, times="auto", **{quantity: points[:end]})  # type: ignore[arg-type]


def _solve_rows(config: Config) -> list[State]:
    """The rows of a scene; NotConverged where it is too long, or ends before its end."""
    scene = resolve(config)
    seconds = scene.plan.prediction.get("seconds", 0.0)
    if seconds > MAX_SECONDS:
        raise NotConverged(f"a run of about {seconds:.2g} s: `run` it, and its limits")
    rows = list(states(scene, with_surface=False))
    if not rows[-1].converged:
        raise NotConverged(rows[-1].reason)
    return rows
