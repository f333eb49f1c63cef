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
from indent_sim.model.body import Drainage
from indent_sim.model.contact import AugmentedLagrangian
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.state import State
from indent_sim.process.errors import NotConverged
from indent_sim.run.chain import states
from indent_sim.run.requirements.bench import Bench
from indent_sim.run.requirements.effects import Effect, solved
from indent_sim.run.requirements.variations import (
    drained,
    elastic,
    rounded_law,
    undrained,
    varied,
    with_matter,
)
from indent_sim.scene.problem_setup import largest_diffusivity, remaining_modulus_fraction
from indent_sim.scene.reference_theory import relaxed_law
from indent_sim.scene.scene import Scene, resolve

LONGEST = 600.0  # s: of a scene that is solved to say what it requires
SAME_FORCE = 1e-6  # relative: of rows of a prescribed force, of which the first counts
RESTED = 1e3  # H^2/D, after which fluid no longer flows
NO_BATH = 1e-9  # of E, the pressure of a bath that is none
LIMITS = {"drainage": ("drained", "undrained"), "rate": ("unrelaxed", "relaxed")}


@dataclass(frozen=True)
class Limit:
    """An elastic body in place of one that evolves: which effect it leaves out, which limit it is,
    and by how many per cent the scene's force is off its own; None where that is not known.
    """

    effect: str
    name: str
    percent: float | None

    @property
    def dropped(self) -> Effect:
        """What a model of that body leaves out."""
        return Effect(
            self.effect, self.percent, self.percent, self.percent, f"the {self.name} body"
        )


class Evolution:
    """What time makes of the force of a scene; every force is solved once."""

    def __init__(self, config: Config, scene: Scene):
        self.config = config
        self.physics = scene.physics
        pressures = [
            one.material.bath_pressure(p)
            for one in scene.physics.permeable_regions
            for p in self._baths
        ]
        self.is_bathed = any(abs(pressure) > NO_BATH for pressure in pressures)
        self._bench = Bench(self.config, scene)
        self._known = dict[tuple[str, ...], float]()

    @property
    def _baths(self) -> tuple[float, ...]:
        return self.physics.drainage.baths

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Its rows of the table."""
        found = []
        if self.physics.permeable_regions:
            found.append(solved("drainage", self._drainage))
        if self.physics.relaxing_regions:
            found.append(solved("rate", self._rate))
        return tuple(found)

    @property
    def nearest(self) -> tuple[Limit, ...]:
        """Of each effect the limit whose force is nearest."""
        return tuple(
            min(limits_of(effect), key=lambda limit: limit.dropped.size) for effect in self.effects
        )

    @property
    def elastic(self) -> Config:
        """The scene with the elastic laws of the nearest limits."""
        found = self._with_laws(self.config, tuple(limit.name for limit in self.nearest))
        loading = replace(found.loading, per_doubling=None)
        return varied(found, loading=loading, output=replace(found.output, fields="auto"))

    @property
    def at_its_depth(self) -> Config:
        """The same, at the depth of its largest force alone."""
        try:
            loading = Loading(delta=self._top.delta, steps=1)
        except NotConverged:
            loading = Loading(delta=max(self.physics.deltas) * self.physics.scales.depth, steps=1)
        return varied(self.elastic, loading=loading)

    def _drainage(self) -> Effect:
        if self.is_bathed:
            return self._swelling()
        words = f"the scene over its drained body, the range up to its undrained one{self._where}"
        own = self._top.force / self._force("drained") - 1
        return _effect(
            "drainage", own, self._force("undrained") / self._force("drained") - 1, words
        )

    def _swelling(self) -> Effect:
        """Beside what its force becomes in the bath of that row, at that depth."""
        words = (
            "the scene over the same at rest in its bath, the range from before any fluid "
            f"came{self._where}"
        )
        rested = self._rested
        at_once = self._force("undrained") if self._top.delta > 0 else 0.0
        if not rested > 0:
            raise NotConverged("at rest in its bath it does not push")
        return _effect("drainage", self._top.force / rested - 1, at_once / rested - 1, words)

    def _rate(self) -> Effect:
        words = (
            "the scene over that of an elastic body, the range down to its relaxed "
            f"one{self._where}"
        )
        dry = ("drained",) if self.physics.permeable_regions else ()
        own = self._force(*dry) if dry else self._top.force
        alone = self._force(*dry, "unrelaxed")
        return _effect("rate", own / alone - 1, self._force(*dry, "relaxed") / alone - 1, words)

    @property
    def _where(self) -> str:
        smooth = ", without friction" if self._bench.in_contact else ""
        return (
            f", at t = {self._top.t:.4g}, delta = {self._top.delta:.4g}, on one "
            f"mesh{smooth}{self._bench.how}"
        )

    @cached_property
    def _whole(self) -> Config:
        """The scene on the body that stands for its own, all but that as usual, as far as its force
        may grow.
        """
        own = self.config
        usual = {
            "contact": AugmentedLagrangian(gap=own.contact.gap),
            "solver": SolverSettings(),
            "output": OutputSettings(),
        }
        loading = (
            replace(own.loading, times="auto") if self.is_bathed else _to_last_rise(own.loading)
        )
        whole = varied(
            own, **usual, indenter=self._bench.tip, accuracy=None, experiment=None, loading=loading
        )
        whole = self._bench.stand_in(whole)
        scene = resolve(whole)
        h = scene.sizes.h_contact * scene.physics.scales.length
        return whole if self._bench.is_from_file else varied(whole, mesh=MeshSettings(h_contact=h))

    @cached_property
    def _top(self) -> State:
        """The row of the largest force, the first of those."""
        rows = _walked(self._whole)
        largest = max(row.force for row in rows)
        top = next(row for row in rows if row.force >= largest - SAME_FORCE * abs(largest))
        if not top.force > 0:
            raise NotConverged("the tip does not push")
        return top

    def _force(self, *limits: str) -> float:
        """Force at that row with other laws: of an elastic body at its depth, of one that still
        relaxes on its way.
        """
        if limits not in self._known:
            config = self._with_laws(self._whole, limits)
            evolves = any(law.evolves for _, law in config.materials())
            loading = self._way_there() if evolves else Loading(delta=self._top.delta, steps=1)
            self._known[limits] = _walked(varied(config, loading=loading))[-1].force
        return self._known[limits]

    @cached_property
    def _rested(self) -> float:
        """Force at the depth of that row when no fluid flows any more in the bath of its time."""
        t = self._top.t
        delta = self._top.delta
        drainage = self._whole.drainage or Drainage()
        end = RESTED * self.physics.body.height**2 / largest_diffusivity(self.physics)
        held = Loading(history=((0.0, delta), (end, delta)), times=(end,), per_doubling=2)
        bath = replace(drainage, bath=drainage.bath_at(t or 0.0))
        return _walked(varied(self._whole, loading=held, drainage=bath))[-1].force

    def _with_laws(self, config: Config, limits: tuple[str, ...]) -> Config:
        """A scene of this body with the laws of limits."""
        history = self.config.loading.in_time

        def soft(law: Material) -> Material:
            return relaxed_law(law.canonical(), remaining_modulus_fraction(law.relaxation, history))

        changes = {
            "drained": drained,
            "undrained": undrained,
            "unrelaxed": elastic,
            "relaxed": soft,
        }

        def changed(law: Material) -> Material:
            for limit in limits:
                law = rounded_law(changes[limit](law))
            return law

        laws = [changed(law) for _, law in config.materials()]
        drainage = config.drainage if any(law.flow for law in laws) else None
        per_doubling = config.loading.per_doubling if any(law.evolves for law in laws) else None
        return with_matter(
            config,
            changed,
            drainage=drainage,
            loading=replace(config.loading, per_doubling=per_doubling),
        )

    def _way_there(self) -> Loading:
        """The way to that row of a body whose depth is prescribed."""
        own = self._whole.loading
        top = self._top
        if own.history is None or top.t is None:
            raise NotConverged(
                "under prescribed forces a body that both drains and relaxes is not taken apart"
            )
        passed = tuple(point for point in own.history if point[0] <= top.t)
        is_at_once = top.t == own.history[0][0]
        there = () if passed[-1][0] == top.t else ((top.t, top.delta),)
        return replace(
            own, history=own.history if is_at_once else (*passed, *there), times=(top.t,)
        )


def _effect(name: str, own: float, other: float, words: str) -> Effect:
    """An effect by relative changes of the force: the scene's, and that of the other limit."""
    low, high = sorted((0.0, 100 * other))
    return Effect(name, 100 * own, low, high, words)


def limits_of(effect: Effect) -> tuple[Limit, Limit]:
    """The scene beside both limits of an effect."""
    first, other = LIMITS[effect.name]
    if effect.percent is None or effect.low is None or effect.high is None:
        return Limit(effect.name, first, None), Limit(effect.name, other, None)
    reached = effect.low if effect.low < 0 else effect.high
    beside = 100 * ((100 + effect.percent) / (100 + reached) - 1) if reached > -100 else None
    return Limit(effect.name, first, effect.percent), Limit(effect.name, other, beside)


def _to_last_rise(loading: Loading) -> Loading:
    """A loading in time up to where its value rises for the last time: what follows pushes no
    harder.
    """
    (way,) = loading.given
    points = getattr(loading, way)
    rises = [
        k for k, (before, after) in enumerate(pairwise(points), start=1) if after[1] > before[1]
    ]
    end = max(rises, default=0) + 1
    while points[end - 1][0] == points[0][0]:  # a jump from rest, and what holds it
        end += 1
    return replace(loading, times="auto", **{way: points[:end]})  # type: ignore[arg-type]


def _walked(config: Config) -> list[State]:
    """The rows of a scene; NotConverged where it is too long, or ends before its end."""
    scene = resolve(config)
    seconds = scene.plan.prediction.get("seconds", 0.0)
    if seconds > LONGEST:
        raise NotConverged(f"a run of about {seconds:.2g} s: `run` it, and its limits")
    rows = list(states(scene, with_surface=False))
    if not rows[-1].converged:
        raise NotConverged(rows[-1].reason)
    return rows
