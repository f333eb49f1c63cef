"""History table: the force of a body that drains, or whose shear relaxes, along the way of one
measured curve.

    F(x, t) = scale G(t) x^p,   G = F_run/delta_run^p

The scene is run along the way of the tip as it was measured, at the nodes of a lattice of its
parameters; x is the depth and t the time from first touch on, p the exponent of the elastic force
at the deepest. Where a fit moves first touch by little, depth enters by the power alone; where by
more, the way is another, and so is the table.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indent_sim.config.scene_file import from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.scene_curve.lattice import NUMBERS, Lattice, NoTable
from indent_sim.fitting.scene_curve.parameters import Parameter
from indent_sim.process.errors import ConfigError
from indent_sim.run.planned_run import PlannedRun
from indent_sim.run.simulate import states

CORNER = 0.003  # of the deepest: by as much a measured way may miss its corners
SHALLOW_CONTACT = (
    0.05  # of the deepest: contacts of few elements, whose G is taken from deeper ones
)
# times in every piece of a way, from so much of its length on
TIMES_OF_PIECE = 40
EARLIEST = 1e-4
JUDGED_FINER = 2  # times shorter steps, by which those of a table are judged
# of the lattice: 3e-4 of the force of a draining layer
RUN_NODES = 4
LOG_RUN_STEP = 0.4
LINEAR_RUN_STEP = 0.05
LARGEST_DRAINED_NU = 0.45  # of a body that drains, whose diffusivity loses its sense at 0.5


def remembers(config: Config) -> bool:
    """Whether the force depends on the way in time so that it has to be run along it; ConfigError
    for a gel.
    """
    for key, law in config.materials():
        if law.model == "gel":
            raise ConfigError(
                f"{key}.model", "a fit does not follow a gel that swells", "fit a body that drains"
            )
    return any(
        law.flow or (law.relaxation and law.relaxation.of != "all") for _, law in config.materials()
    )


@dataclass(frozen=True)
class MeasuredWay:
    """The way of the tip from first touch on: corners (t [s], delta [length]), straight between
    them.
    """

    corners: tuple[tuple[float, float], ...]

    @property
    def deepest(self) -> float:
        """The largest depth [length]."""
        return max(delta for _, delta in self.corners)

    @property
    def times(self) -> np.ndarray:
        """Times (n,) at which a smooth force is known well by its values: graded after every
        corner.
        """
        t = np.unique([t for t, _ in self.corners])
        share = np.geomspace(EARLIEST, 1.0, TIMES_OF_PIECE)
        return np.unique(
            np.concatenate(
                [t[:1], *(a + (b - a) * share for a, b in itertools.pairwise(t.tolist()))]
            )
        )


def way_of(t: np.ndarray, delta: np.ndarray, blur: float = 0.0) -> MeasuredWay:
    """The way through samples at times (n,) and depths (n,), of which those before first touch are
    < 0.

    Its corners are those of Douglas and Peucker that miss no sample by 0.3 % of the deepest, or by
    `blur` [length]. NoTable without depth.
    """
    first = int(np.argmax(delta > 0))
    if not delta[first] > 0 or first == len(t) - 1:
        raise NoTable("the curve has no way in contact")
    t = t[first:] - touched(t, delta)
    delta = np.maximum(delta[first:], 0.0)
    begin = [
        (0.0, 0.0),
        *([(0.0, float(delta[0]))] if t[0] <= 0 else []),
    ]  # held from its first sample on: a jump
    t, delta = (t, delta) if t[0] <= 0 else (np.append(0.0, t), np.append(0.0, delta))
    kept = {0, len(t) - 1}
    open_pieces = [(0, len(t) - 1)]
    while open_pieces:
        i, j = open_pieces.pop()
        off = np.abs(delta[i : j + 1] - np.interp(t[i : j + 1], t[[i, j]], delta[[i, j]]))
        if off.max() > max(CORNER * delta.max(), blur):
            k = i + int(np.argmax(off))
            kept.add(k)
            open_pieces += [(i, k), (k, j)]
    corners = [(float(t[k]), float(delta[k])) for k in sorted(kept)]
    return MeasuredWay(tuple([*begin, *corners[1:]]))


def touched(t: np.ndarray, delta: np.ndarray) -> float:
    """The time of first touch: between the samples at which the depth becomes > 0; of the first
    where it is.
    """
    first = int(np.argmax(delta > 0))
    if first == 0:
        return float(t[0])
    (t_0, t_1) = t[first - 1 : first + 1]
    (below, above) = delta[first - 1 : first + 1]
    return float(t_0 + (t_1 - t_0) * -below / (above - below))


class HistoryTable:
    """G(t) of a scene along a way, over its shape parameters.

    power: the exponent p of the depth. NoTable where the scene has no solution along the way.
    """

    def __init__(self, config: Config, shape: Sequence[Parameter], way: MeasuredWay, power: float):
        self.way = way
        self.power = power

        def solve(scene: Config) -> np.ndarray:
            return _gains(scene, way, power)

        self.lattice = Lattice(
            config, [_spaced(one) for one in shape], solve(config), solve, RUN_NODES
        )

    def gain(self, theta: Sequence[float], t: np.ndarray) -> np.ndarray:
        """G [force/length^p] at times (n,) after first touch, at coordinates of the shape
        parameters.
        """
        known = self.way.times
        return _smooth(known, self.lattice.at(theta), np.clip(t, known[0], known[-1]))

    def missed(self, scene: Config, theta: Sequence[float], t: np.ndarray) -> np.ndarray:
        """What G lacks of a run of the scene, which has these coordinates, in steps of half the
        length.
        """
        known = self.way.times
        off = _gains(scene, self.way, self.power, JUDGED_FINER) - self.lattice.at(theta)
        return np.interp(t, known, off)

    @property
    def first(self) -> float:
        """G of the scene as it stands where the way is first at its deepest."""
        t = next(t for t, delta in self.way.corners if delta >= (1 - 2 * CORNER) * self.way.deepest)
        return float(np.interp(t, self.way.times, self.lattice.first))


def _spaced(parameter: Parameter) -> Parameter:
    """A parameter on the lattice of runs."""
    if not parameter.is_linear:
        return replace(parameter, step=LOG_RUN_STEP)
    return replace(parameter, step=LINEAR_RUN_STEP, high=min(parameter.high, LARGEST_DRAINED_NU))


def _gains(config: Config, way: MeasuredWay, power: float, finer: int = 1) -> np.ndarray:
    """G at the way's times, of a run in steps that are so many times shorter."""
    document: dict[str, Any] = to_mapping(config)
    document.pop("experiment", None)
    document["loading"] = {"history": [list(corner) for corner in way.corners]}
    if finer > 1 or config.loading.per_doubling:
        document["loading"]["per_doubling"] = finer * config.loading.steps_per_doubling
    try:
        found = list(states(PlannedRun.resolve(from_mapping(document)).scene, with_surface=False))
    except NUMBERS as error:
        raise NoTable(str(error)) from error
    if not found or not found[-1].converged:
        raise NoTable(
            f"the measured way was not followed: {found[-1].reason if found else 'no row'}"
        )
    t, delta, force = np.array([(one.t, one.delta, one.force) for one in found], dtype=float).T
    used = delta > SHALLOW_CONTACT * way.deepest
    used[:-1] &= np.diff(t) > 0  # of a jump the row after it
    known = way.times
    return _smooth(
        t[used], force[used] / delta[used] ** power, np.clip(known, t[used][0], t[used][-1])
    )


def _smooth(t: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Between points by cubics without overshoot."""
    from scipy.interpolate import (
        PchipInterpolator,
    )  # a tenth of a second to import, which other fits need not spend

    return PchipInterpolator(t, values)(at)  # type: ignore[no-any-return]
