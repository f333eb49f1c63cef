"""Forces: a scene as a function of depth and of its parameters, with what its experiment adds.

    F(x, t; theta),   x the depth delta, or with a spring the way z = delta + compliance F of its
    base

Signs as everywhere: x > 0 in, F > 0 pushing; 0 before first touch. Units of the scene, times in
seconds.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from indent_sim.config.scene_file import to_yaml
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.scene_curve.elastic_table import (
    LEAST_RADIUS,
    ElasticLattice,
    ElasticTable,
    elastic_prospect,
)
from indent_sim.fitting.scene_curve.history_table import (
    HistoryTable,
    MeasuredWay,
    remembers,
    touched,
)
from indent_sim.fitting.scene_curve.lattice import NoTable
from indent_sim.fitting.scene_curve.parameters import (
    EXPONENTS,
    FREE_EXPONENT,
    WORK,
    Parameter,
    number_at,
    parameters_of,
    with_numbers,
)
from indent_sim.process.errors import ConfigError
from indent_sim.run.history_on_curve import relaxation_modulus

SAMPLES_OF_WAY = 1500  # of the table of depths behind a spring
SAMPLES_OF_RADIUS = 600  # of the branch of a tip that adheres
# of depths behind a spring in a body that relaxes, relative to the depth
MOST_ROUNDS = 60
SETTLED_DEPTH = 1e-9
NEAR_ZERO = 1e-9  # of the depth, from where on a free power of it goes on as a number
MOST_TABLES = 100
# Contact radii that a height may have: a thicker body is a half-space, a thinner one is solved for
# long
THINNEST_BODY = 0.2
WIDEST_BODY = 20.0
# What relaxation makes, at some times, of the elastic forces there
Relaxed = Callable[[np.ndarray], Callable[[np.ndarray], np.ndarray]]


@dataclass(frozen=True)
class Settings:
    """The experiment at some values of the parameters: work of adhesion, compliance, relaxation."""

    scale: float
    shape: tuple[float, ...]
    work: float
    compliance: float
    relaxed: Relaxed | None
    power: float = 0.0  # of the depth, beside the scene's own


class SceneForces:
    """The force of a scene at depths, or ways of the base, for any values of its varied keys.

    config: the scene; keys: what varies; deepest [length]: of the table; way: of the tip, for
    matter that drains or relaxes in shear. ConfigError for a scene that cannot exist, NoTable for
    one without a solution.
    """

    def __init__(
        self, config: Config, keys: Sequence[str], deepest: float, way: MeasuredWay | None = None
    ):
        self.config = config
        self.keys = tuple(keys)
        self.deepest = deepest
        self.parameters = parameters_of(config, keys, deepest)
        self.experiment = config.instrument
        self.pivot = deepest
        self.adheres = self.experiment.adhesion is not None
        self._shape = [k for k, one in enumerate(self.parameters) if one.role == "shape"]
        shape = [self.parameters[k] for k in self._shape]
        self.history: HistoryTable | None = None
        is_run = remembers(config)
        of_table = [] if is_run else shape
        self.lattice = ElasticLattice(config, of_table, deepest, self.adheres)
        if is_run:
            self.history = _history(config, shape, way, self.lattice.first)
        radius = self.lattice.first.radius
        self.parameters = tuple(_within(one, radius) for one in self.parameters)

    @property
    def start(self) -> np.ndarray:
        """The coordinates of the scene's own values."""
        return np.array([one.theta(one.start) for one in self.parameters])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The least and largest coordinates."""
        low, high = (
            zip(*(one.bounds for one in self.parameters), strict=True)
            if self.parameters
            else ((), ())
        )
        return np.array(low, dtype=float), np.array(high, dtype=float)

    @property
    def scaling(self) -> int | None:
        """Which parameter multiplies the force, if one does."""
        return next((k for k, one in enumerate(self.parameters) if one.role == "scale"), None)

    @property
    def relaxes(self) -> bool:
        """Whether the force depends on time."""
        return self.history is not None or relaxation_of(self.config) is not None

    @property
    def effects(self) -> set[str]:
        """What it has that another model may add: adhesion, relaxation."""
        known = {"adhesion": self.adheres, "relaxation": self.relaxes}
        return {name for name, is_there in known.items() if is_there}

    @property
    def error(self) -> float:
        """Relative error bar of the force, from its mesh."""
        return self.lattice.first.error

    def __call__(self, theta: np.ndarray, x: np.ndarray, t: np.ndarray | None = None) -> np.ndarray:
        """Forces [force] at ways x [length] (n,) and times t (n,), in order of time."""
        at = self._settings(theta)
        if self.relaxes and t is None:
            raise ValueError("a scene that relaxes needs times")
        if self.history is not None and t is not None:
            return self._remembered(self.history, at, x, t)
        table = self.lattice.at(at.shape)
        if self.adheres:
            return self._adhering(table, at, x)
        if at.relaxed is not None and t is not None:
            return self._relaxed(table, at, x, at.relaxed(t))
        if not at.compliance:
            return self._pressed(table, at, x)
        top = max(float(x.max(initial=0.0)), 1e-300)
        deep = min(top, 1.2 * self.deepest) * np.linspace(0.0, 1.0, SAMPLES_OF_WAY) ** 2
        force = self._pressed(table, at, deep)
        return np.where(x > 0, np.interp(x, deep + at.compliance * force, force), 0.0)

    def rigid(self, theta: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """The forces over the depth, without spring and relaxation: where a fit begins."""
        at = self._settings(theta)
        history = self.history
        if history is not None:
            return lambda delta: at.scale * history.first * np.maximum(delta, 0.0) ** history.power
        table = self.lattice.at(at.shape)
        if self.adheres:
            held = replace(at, compliance=0.0, relaxed=None)
            return lambda delta: self._adhering(table, held, delta)
        return lambda delta: self._pressed(table, at, delta)

    def _pressed(self, table: ElasticTable, at: Settings, delta: np.ndarray) -> np.ndarray:
        """The elastic force at depths: the scene's, times another power of the depth."""
        force = at.scale * table.force(delta)
        return force * np.maximum(delta / self.pivot, NEAR_ZERO) ** at.power if at.power else force

    def _remembered(
        self, history: HistoryTable, at: Settings, x: np.ndarray, t: np.ndarray
    ) -> np.ndarray:
        """The force of a body with a memory."""
        if not (x > 0).any():
            return np.zeros(len(x))
        power = history.power + at.power
        way = np.maximum(x, 0.0)
        gain = at.scale * history.gain(at.shape, t - touched(t, x)) * self.pivot**-at.power
        if not at.compliance:
            return gain * way**power  # type: ignore[no-any-return]

        def pushed(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            force = gain * np.maximum(delta, 0.0) ** power
            return force, power * force / np.maximum(delta, NEAR_ZERO * self.deepest)

        return self._behind_spring(way, at.compliance, pushed)

    def missed(self, theta: np.ndarray, x: np.ndarray, t: np.ndarray | None) -> np.ndarray:
        """What the force of a body with a memory lacks of one solved by itself, in shorter steps
        (n,); else nothing.
        """
        history = self.history
        at = self._settings(theta)
        if history is None or t is None or not (x > 0).any():
            return np.zeros(len(x))
        values = {
            one.key: one.value(float(theta[k]))
            for k in self._shape
            for one in (self.parameters[k],)
        }
        off = history.missed(with_numbers(self.config, values), at.shape, t - touched(t, x))
        depth = np.maximum(x - at.compliance * self(theta, x, t), 0.0)
        return at.scale * off * depth**history.power  # type: ignore[no-any-return]

    def _settings(self, theta: np.ndarray) -> Settings:
        values = {
            one.key: one.value(float(x)) for one, x in zip(self.parameters, theta, strict=True)
        }
        scale = math.prod(
            values[one.key] / one.start for one in self.parameters if one.role == "scale"
        )
        adhesion = self.experiment.adhesion
        work = values.get(WORK, adhesion.work if adhesion else 0.0)
        held = self.experiment.cantilever
        frame = self.experiment.frame
        compliance = (
            1.0 / values.get("experiment.cantilever.stiffness", held.stiffness) if held else 0.0
        )
        compliance += values.get("experiment.frame.compliance", frame.compliance) if frame else 0.0
        varied = {one.key: values[one.key] for one in self.parameters if one.role == "relaxation"}
        power = values.get(FREE_EXPONENT, 0.0)
        relaxed = relaxation_of(self.config, varied)
        return Settings(scale, tuple(theta[self._shape]), work, compliance, relaxed, power)

    def with_free_power(self, pivot: float) -> SceneForces:
        """The same scene whose force rises with a free power of the depth beside its own, as under
        another tip; at the depth `pivot` [length] the force is the scene's.
        """
        other = copy.copy(self)
        other.parameters = (
            *self.parameters,
            Parameter(FREE_EXPONENT, 0.0, "power", *EXPONENTS, is_linear=True),
        )
        other.keys = (*self.keys, FREE_EXPONENT)
        other.pivot = pivot
        return other

    def _adhering(self, table: ElasticTable, at: Settings, x: np.ndarray) -> np.ndarray:
        """JKR's stable branch by the contact radius, from first touch at x = 0 until the tip comes
        off.
        """
        assert table.punches is not None
        end = math.log(LEAST_RADIUS)
        ln_a = np.linspace(end, 0.0, SAMPLES_OF_RADIUS)
        logs = [
            np.polynomial.chebyshev.chebval(1.0 - 2.0 * ln_a / end, one) for one in table.punches
        ]
        delta, force, K, slope = np.exp(logs)
        q = np.sqrt(4.0 * np.pi * table.widest * np.exp(ln_a) * at.work / (at.scale * slope))
        delta = delta - q
        force = at.scale * (force - K * q)
        way = delta + at.compliance * force
        falls = np.flatnonzero(np.diff(way) <= 0)
        first = int(falls[-1]) + 1 if len(falls) else 0
        touches = np.logical_or.accumulate(x >= 0.0)
        return np.where(touches & (x >= way[first]), np.interp(x, way[first:], force[first:]), 0.0)

    def _relaxed(
        self,
        table: ElasticTable,
        at: Settings,
        x: np.ndarray,
        relaxed: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """The force of a relaxing body."""
        h = 1e-6 * self.deepest
        if not at.compliance:
            return relaxed(self._pressed(table, at, x))

        def pushed(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            elastic = self._pressed(table, at, delta)
            return relaxed(elastic), (self._pressed(table, at, delta + h) - elastic) / h

        return self._behind_spring(x, at.compliance, pushed)

    def _behind_spring(
        self,
        x: np.ndarray,
        compliance: float,
        pushed: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    ) -> np.ndarray:
        """Forces at ways of a base (n,) behind a spring, by rounds of Newton's kind.

        pushed: force and stiffness at depths, every time by itself.
        """
        delta = x.copy()
        for _ in range(MOST_ROUNDS):
            force, stiffness = pushed(delta)
            change = (x - delta - compliance * force) / (1.0 + compliance * stiffness)
            delta = delta + change
            if np.abs(change).max(initial=0.0) < SETTLED_DEPTH * self.deepest:
                break
        return force


def _history(
    config: Config, shape: Sequence[Parameter], way: MeasuredWay | None, elastic: ElasticTable
) -> HistoryTable:
    """The table along a way, with the exponent of the elastic force at its deepest."""
    if config.experiment and config.experiment.adhesion:
        raise ConfigError(
            "experiment.adhesion",
            "a fit does not follow a tip that adheres in time",
            "leave it out",
        )
    if way is None:
        raise ConfigError(
            "loading",
            "matter that drains, or relaxes in shear, needs a way in time",
            "give a history",
        )
    less, more = elastic.force(np.array([0.95, 1.05]) * way.deepest)
    return HistoryTable(config, shape, way, math.log(more / less) / math.log(1.05 / 0.95))


def _within(parameter: Parameter, radius: float) -> Parameter:
    """A height between those that are worth solving, for a contact of this radius [length]."""
    if parameter.key.rpartition(".")[2] not in ("height", "thickness"):
        return parameter
    thinnest = THINNEST_BODY * radius
    thickest = WIDEST_BODY * radius
    low = max(parameter.low, min(thinnest, 0.99 * parameter.start))
    return replace(parameter, low=low, high=max(thickest, 1.01 * parameter.start))


def relaxation_of(config: Config, values: Mapping[str, float] | None = None) -> Relaxed | None:
    """The relaxation of a scene, with other numbers at some of its keys; None where it does not
    relax.
    """
    law = next((law.relaxation for _, law in config.materials() if law.relaxation), None)
    if law is None:
        return None
    numbers = {_inside(key): value for key, value in (values or {}).items()}
    if own := law.power_law:
        changed = {
            name: numbers.get(("power_law", name), getattr(own, name))
            for name in ("exponent", "time")
        }
        return relaxation_modulus(replace(law, power_law=replace(own, **changed))).force_relaxation
    given = enumerate(law.prony or ())
    terms = tuple(
        tuple(numbers.get(("prony", k, i), value) for i, value in enumerate(term))
        for k, term in given
    )
    return relaxation_modulus(replace(law, prony=terms)).force_relaxation


def is_in_time(config: Config) -> bool:
    """Whether the force of a scene depends on time."""
    return remembers(config) or relaxation_of(config) is not None


def _inside(key: str) -> tuple[str | int, ...]:
    """What of a key lies inside the relaxation of a material, which is the same in all of them."""
    path = key_path(key)
    return tuple(path[path.index("relaxation") + 1 :])


class Tables:
    """The forces of scenes to some depths, made once for all curves that share them."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, tuple[str, ...], float, MeasuredWay | None], SceneForces] = {}

    def forces(
        self, config: Config, keys: tuple[str, ...], deepest: float, way: MeasuredWay | None = None
    ) -> SceneForces:
        """The forces of a scene; NoTable where it does not exist at this depth, ConfigError where
        at none.
        """
        name = to_yaml(config), keys, deepest, way
        if name not in self._known:
            if len(self._known) >= MOST_TABLES:
                self._known.clear()
            self._known[name] = _new(config, keys, deepest, way)
        return self._known[name]


def _new(
    config: Config, keys: tuple[str, ...], deepest: float, way: MeasuredWay | None
) -> SceneForces:
    for key in keys:
        number_at(config, key)
    try:
        return SceneForces(config, keys, deepest, way)
    except ConfigError as error:
        elastic_prospect(config, _own_depth(config))  # wrong whatever the depth
        raise NoTable(
            f"deeper than the scene is made for, {deepest:.4g}: {error.problem}"
        ) from error


def _own_depth(config: Config) -> float:
    """A depth at which the scene itself must exist."""
    loading = config.loading
    return loading.delta or max(loading.deltas or (0.0,)) or 1e-3 * _size(config)


def _size(config: Config) -> float:
    height = getattr(config.body, "height", None)
    return float(height or getattr(config.indenter, "R", None) or 1.0)
