"""Design of a measurement: what a curve of a scene would tell of its parameters, before it is
measured.

From the derivatives J that a fit uses, in white noise of deviation s: covariance s^2 (J'J)^-1 of
the parameters, the contact point and the baseline; where an interval is wide, by profiles as in a
fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import (
    BARELY_DEEPER,
    SOLVED_WIDTHS,
    in_words,
    relative_calibration,
)
from indent_sim.fitting.inference.estimate import BASELINE_KEPT, Estimate, Model, Samples, deviation
from indent_sim.fitting.inference.noise import WHITE, Averaged
from indent_sim.fitting.inference.profile_likelihood import profiled
from indent_sim.fitting.inference.verdict import Interval, Verdict, half_widths, tied
from indent_sim.fitting.scene_curve.history_table import MeasuredWay, remembers, way_of
from indent_sim.fitting.scene_curve.lattice import NoTable
from indent_sim.fitting.scene_curve.parameters import number_at, with_numbers
from indent_sim.fitting.scene_curve.scene_forces import SceneForces, Tables, relaxation_of
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.planned_run import PlannedRun

BASELINE = 1.0  # depths before contact that a designed curve has
BASELINES = (
    0.1,
    0.2,
    0.3,
    0.5,
    0.75,
    1.0,
    BASELINE_KEPT,
)  # depths that are compared, the last what a fit uses at most
ENOUGH = 1.05  # times the deviation of the longest baseline
SHORTEST_WAY_IN = 0.25  # of a history: the time that a baseline before a jump is given
RADII = ("indenter.R", "indenter.radius")
TIED = 2.0  # times a wider interval than with the others known, from which on it is said


@dataclass(frozen=True)
class Help:
    """A change of the scene and the intervals that it would give; none, and the reason, where it
    cannot be.
    """

    change: dict[str, Any]
    parameters: dict[str, Interval]
    reason: str = ""


@dataclass(frozen=True)
class Design:
    """What a measurement would tell: intervals of 95 %, how much wider each is for the others,
    changes that help, and the baseline [depths] beyond which a longer one narrows no interval by
    a twentieth.

    depth [length] and force [force] of the deepest sample, noise [force], samples of the whole
    curve.
    """

    config: Config
    parameters: dict[str, Interval]
    tied: dict[str, float]
    identifiable: bool
    helps: tuple[Help, ...]
    baseline: float
    depth: float
    force: float
    noise: float
    points: int

    def as_json(self) -> dict[str, Any]:
        """The design as one JSON object."""
        found = {
            "scene": self.config.source.name,
            "vary": list(self.parameters),
            "words": self.words,
        } | vars(self)
        stated = {key: asdict(one) for key, one in self.parameters.items()}
        helps = [asdict(one) for one in self.helps]
        found |= {"parameters": stated, "helps": helps}
        return {name: one for name, one in found.items() if name != "config"}

    @property
    def words(self) -> str:
        """What is expected and what is tied, in sentences."""
        if not self.identifiable:
            return (
                f"Not identifiable: {' and '.join(self.parameters)} together, by no better than a "
                "factor of 3."
            )
        said = [f"{in_words(key, self.config, one)}." for key, one in self.parameters.items()]
        wide = [(key, ratio) for key, ratio in self.tied.items() if ratio > TIED]
        said += [
            f"With the others known {key} would be {ratio:.2g} times better known."
            for key, ratio in wide
        ]
        return " ".join(
            [*said, f"A baseline of {self.baseline:g} depths before contact is enough."]
        )


@dataclass(frozen=True)
class _Measurement:
    """A curve to be measured: depth, or way of the base, x [length] and times t [s] from first
    touch on, straight between them, the deepest `depth` [length].
    """

    config: Config
    forces: SceneForces
    depth: float
    x: np.ndarray
    t: np.ndarray

    def model(self, points: int, baseline: float) -> Model:
        """The curve at so many samples at equal times, after a baseline [depths]."""
        top = int(np.argmax(self.x))
        pace = self.x[top] / max(self.t[top] - self.t[0], SHORTEST_WAY_IN * float(np.ptp(self.t)))
        before = baseline * self.depth
        t = np.linspace(self.t[0] - before / pace, self.t[-1], points)
        x = np.where(t < self.t[0], pace * (t - self.t[0]), np.interp(t, self.t, self.x))
        return Model(
            self.forces, Samples(x, np.zeros(points), t - t[0] if self.forces.relaxes else None)
        )

    @property
    def force(self) -> float:
        """The largest force [force]."""
        model = self.model(len(self.t) * 50, 0.0)
        return float(model.contact(self._start).max())

    @property
    def _start(self) -> np.ndarray:
        return np.array([*self.forces.start, 0.0, 0.0, 0.0])

    def estimate(self, points: int, noise: float, baseline: float = BASELINE) -> Estimate:
        """The estimate of such a curve that shows the scene as it stands, in white noise [force]."""
        model = self.model(points, baseline)
        p = self._start
        model = replace(model, samples=replace(model.samples, force=model.contact(p)))
        blind = Estimate(
            model, p, p, Averaged(WHITE, noise**2, np.zeros((len(p), len(p))), np.zeros(len(p)))
        )
        sd = np.array([deviation(blind, k) for k in range(len(p))])
        for key, value in zip(self.forces.keys, sd, strict=False):
            if not np.isfinite(value):
                raise ConfigError(key, "the force does not depend on it", "leave it out of --vary")
        return replace(blind, found=replace(blind.found, covariance=np.diag(sd**2)))


def design(config: Config, keys: Sequence[str], noise: float, points: int) -> Design:
    """What a curve of so many points of a scene would tell of its keys; its last depth is the
    deepest point.

    noise: the deviation of a sample over the largest force, which stays the same force where the
    scene is changed. Half of the points are the baseline. ConfigError for a key or a scene that is
    wrong, NotConverged for a scene that could not be solved.
    """
    with np.errstate(all="ignore"):  # profiles try what overflows
        return _designed(config, keys, noise, points)


def _designed(config: Config, keys: Sequence[str], noise: float, points: int) -> Design:
    tables = Tables()
    try:
        own = _measurement(config, tuple(keys), tables)
    except NoTable as error:
        raise NotConverged(f"the scene could not be solved: {error}") from error
    level = noise * own.force
    estimate = own.estimate(points, level)
    helps = tuple(
        _help(config, change, tuple(keys), (points, level), tables)
        for change in _changes(config, keys)
    )
    shared = dict(zip(keys, tied(estimate), strict=True))
    enough = _baseline(own, points, level)
    verdict = _verdict(own, estimate)
    return Design(
        config,
        _stated(verdict),
        shared,
        verdict.identifiable,
        helps,
        enough,
        own.depth,
        own.force,
        level,
        points,
    )


def _measurement(config: Config, keys: tuple[str, ...], tables: Tables) -> _Measurement:
    """The scene's own path up to its deepest point, held as long as it holds there."""
    for key in keys:
        number_at(config, key)
    if config.loading.force_history:
        raise ConfigError(
            "loading.force_history", "a design follows depths", "give loading.history"
        )
    depth = max(PlannedRun.resolve(config).depths)
    if not depth > 0:
        raise ConfigError("loading", "the tip never touches the body", "give loading.delta > 0")
    way = _way(config)
    path = config.loading.prescribed_history
    try:
        forces = tables.forces(config, keys, SOLVED_WIDTHS * depth, way)
    except (ConfigError, NoTable):
        forces = tables.forces(config, keys, BARELY_DEEPER * depth, way)
    if path is None:
        top = depth + forces.experiment.compliance * float(
            forces.rigid(forces.start)(np.array([depth]))[0]
        )
        return _Measurement(config, forces, depth, np.array([0.0, top]), np.array([0.0, 1.0]))
    t, x = np.array(path.points_from_rest).T
    end = int(np.flatnonzero(x == x.max())[-1]) + 1
    return _Measurement(config, forces, depth, x[:end], t[:end])


def _way(config: Config) -> MeasuredWay | None:
    """The scene's own way, where the force depends on it as a whole."""
    path = config.loading.prescribed_history
    if not remembers(config) or path is None:
        return None
    if config.experiment and config.experiment.compliance:
        raise ConfigError(
            "experiment", "a design of matter with a memory follows the tip", "leave the spring out"
        )
    t, delta = np.array(path.points_from_rest).T
    return way_of(t, delta)


def _verdict(measurement: _Measurement, estimate: Estimate) -> Verdict:
    """The verdict of a fit that the scene explains: intervals by noise, mesh and calibration."""
    forces = measurement.forces
    uncertain = half_widths(
        estimate, forces.error, relative_calibration(measurement.config, forces)
    )
    return Verdict(profiled(estimate), [], 1.0, None, [], uncertain)


def _stated(verdict: Verdict) -> dict[str, Interval]:
    """The intervals of the varied keys."""
    return {key: verdict.stated(k) for k, key in enumerate(verdict.estimate.model.forces.keys)}


def _changes(config: Config, keys: Sequence[str]) -> Iterator[dict[str, Any]]:
    """What an experimenter may change: the depth, the tip's radius, and a hold of a body that
    relaxes.
    """
    path = config.loading.history
    if path:
        yield {"loading.history": [[t, 2.0 * value] for t, value in path]}
    else:
        yield {
            "loading": {
                "delta": 2.0 * max(PlannedRun.resolve(config).depths),
                "steps": config.loading.steps,
            }
        }
    for key in RADII:
        try:
            R = number_at(config, key)
        except ConfigError:
            continue
        yield from ({key: factor * R} for factor in (0.5, 2.0) if key not in keys)
    if path and relaxation_of(config):
        top = max(value for _, value in path)
        way = [
            list(point)
            for point in path[: max(k for k, point in enumerate(path) if point[1] == top) + 1]
        ]
        yield {"loading.history": [*way, [way[-1][0] + (way[-1][0] - way[0][0]), top]]}


def _help(
    config: Config,
    change: dict[str, Any],
    keys: tuple[str, ...],
    of: tuple[int, float],
    tables: Tables,
) -> Help:
    points, level = of
    shown = {"loading.delta": change["loading"]["delta"]} if "loading" in change else change
    try:
        measurement = _measurement(with_numbers(config, change), keys, tables)
        return Help(shown, _stated(_verdict(measurement, measurement.estimate(points, level))))
    except (ConfigError, NotConverged) as error:
        return Help(
            shown,
            {},
            f"{error.key}: {error.problem}" if isinstance(error, ConfigError) else str(error),
        )
    except NoTable as error:
        return Help(shown, {}, str(error))


def _baseline(measurement: _Measurement, points: int, level: float) -> float:
    """The shortest of the baselines that is as good as the longest, at the same distance of
    samples.
    """
    each = points / (1.0 + BASELINE)

    def deviations(baseline: float) -> np.ndarray:
        estimate = measurement.estimate(round(each * (1.0 + baseline)), level, baseline)
        return estimate.sd[: estimate.model.size]

    best = deviations(BASELINES[-1])
    return next(one for one in BASELINES if np.all(deviations(one) <= ENOUGH * best))
