"""Bodies that drain through faces of every kind, loaded by ramps and jumps from 1e-7 to 10 of the time that fluid takes
through the contact, and what is right for each: series, limits, bounds.

`python tests/early_times.py --seed 1 --count 60` runs as many random scenes and prints how often a force is inside its
error bar, how often `accuracy` is met, and how wide the bars are.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import log, pi
from pathlib import Path
from typing import Any

import numpy as np
from exact_time import confined_modulus, confined_ramp
from scipy.optimize import brentq
from scipy.special import j0, j1, jn_zeros

from indent_sim.config.scene_file import from_mapping
from indent_sim.run.chain import simulate
from indent_sim.theory.surface.drainage import drained_length

QUIET = {"fields": "none", "surface": "none", "plot": False}
TERMS = 4000  # of the disc's series: at D t = 5e-8 a^2 the last has fallen by e^-8
EARLY = 1e-2  # D t/h^2 of a column, up to which it is a half-space to e^-100
FIRST_ORDER = 2e-5  # D t/a^2 up to which a contact on a layer has lost what a film takes, to a tenth of that


@dataclass(frozen=True)
class EarlyScene:
    """A scene, what kind it is, and the least and the largest right force of each row."""

    kind: str
    mapping: dict[str, Any]
    low: list[float]
    high: list[float]


@lru_cache(maxsize=8)
def _disc_terms(nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Roots x of (1 - nu) x J0(x) = (1 - 2 nu) J1(x) and the amplitudes A of `exact_time.unconfined_force`."""
    ends = [0.0, *jn_zeros(1, TERMS)]

    def equation(x: float) -> float:
        return float((1 - nu) * x * j0(x) - (1 - 2 * nu) * j1(x))

    x = np.array([brentq(equation, low + 1e-9, high, xtol=1e-13) for low, high in pairwise(ends)])
    return x, (1 - nu) * (1 - 2 * nu) / (1 + nu) / ((1 - nu) ** 2 * x**2 - (1 - 2 * nu))


def disc_ramp(E: float, nu: float, D: float, a: float, eps: float, T: float, t: float) -> float:
    """Force on a disc of radius a between sealed frictionless plates, its side drained, whose strain grows evenly to
    eps in the time T and stays: the integral of Armstrong, Lai & Mow's response to a step."""
    x, A = _disc_terms(nu)
    rates = x**2 * D / a**2

    def ramp(s: float) -> float:
        if s <= 0:
            return 0.0
        return s + float(np.sum(A * -np.expm1(-rates * s) / rates))

    return pi * a**2 * E * eps / T * (ramp(t) - ramp(t - T))


def column_ramp(E: float, nu: float, D: float, h: float, depth: float, T: float, t: float) -> float:
    """Pressure on the drained top of a confined column whose shortening grows evenly to `depth` in T and stays."""
    M = confined_modulus(E, nu)

    def ramp(s: float) -> float:
        if s <= 0:
            return 0.0
        if D * s / h**2 < EARLY:
            return 2 * M * depth / T * float(np.sqrt(s / (pi * D)))
        return confined_ramp(E, nu, D / M, h, depth / T, s)

    return ramp(t) - ramp(t - T)


class Drawn:
    """One scene after another, from a seed; lengths and moduli are of the order of 1, and D is 1."""

    def __init__(self, seed: int):
        self.draw = np.random.default_rng(seed)

    def spread(self, low: float, high: float) -> float:
        return float(np.exp(self.draw.uniform(np.log(low), np.log(high))))

    def either(self, *choices: Any) -> Any:
        return choices[int(self.draw.integers(len(choices)))]

    def material(self) -> dict[str, Any]:
        nu = float(self.draw.uniform(0.0, 0.4))
        return {"model": "linear_elastic", "E": self.spread(0.1, 10.0), "nu": nu, "flow": {"diffusivity": 1.0}}

    def times(self, T: float) -> list[float]:
        """Two rows on the way and two in the hold after it."""
        return [float(f"{share * T:.9g}") for share in (0.5, 1.0, 1.3, 2.0)]

    def history(self, T: float, depth: float) -> dict[str, Any]:
        return {"history": [[0, 0], [T, depth], [3 * T, depth]], "times": self.times(T)}

    def disc(self) -> EarlyScene:
        """Compressed between sealed plates, its side drained."""
        material, a, h = self.material(), self.spread(0.3, 2.0), 1.0
        T, depth = a * a * self.spread(1e-7, 10.0), 0.01 * h
        mapping = {
            "body": {"shape": "cylinder", "radius": a, "height": h, "base": "roller", "sides": "free"},
            "material": material,
            "indenter": {"shape": "flat_punch", "radius": a},
            "drainage": {"surface": "sealed", "tip": "sealed", "base": "sealed", "sides": "drained"},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        right = [disc_ramp(material["E"], material["nu"], 1.0, a, depth / h, T, t) for t in mapping["loading"]["times"]]
        return EarlyScene("disc", mapping, right, right)

    def column(self) -> EarlyScene:
        """Confined by rollers, drained under the tip or at its base."""
        material, a, h = self.material(), self.spread(0.1, 0.5), 1.0
        T, depth = self.spread(1e-4, 10.0), 0.01 * h
        tip, base = self.either(("drained", "sealed"), ("sealed", "drained"))
        mapping = {
            "body": {"shape": "cylinder", "radius": a, "height": h, "base": "roller", "sides": "roller"},
            "material": material,
            "indenter": {"shape": "flat_punch", "radius": a},
            "drainage": {"surface": "sealed", "tip": tip, "base": base, "sides": "sealed"},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        pressures = [
            column_ramp(material["E"], material["nu"], 1.0, h, depth, T, t) for t in mapping["loading"]["times"]
        ]
        right = [pi * a * a * p for p in pressures]
        return EarlyScene("column", mapping, right, right)

    def layer(self) -> EarlyScene:
        """A paraboloid, ball or cone on a layer that drains under and beside it, so quickly that only a film drains:
        what that takes from the undrained force is known to a third of itself."""
        material, R, h = self.material(), self.spread(0.3, 3.0), 1.0
        shape, a = self.either("paraboloid", "cone"), self.spread(0.1, 0.4)
        angle = 80.0
        depth = a * a / R if shape == "paraboloid" else pi / 2 * a / float(np.tan(np.radians(angle)))
        tip = {"shape": shape, "R": R} if shape == "paraboloid" else {"shape": shape, "half_angle": angle}
        T = a * a * self.spread(1e-7, FIRST_ORDER)
        mapping = {
            "body": {"shape": "layer", "height": h, "base": self.either("fixed", "roller")},
            "material": material,
            "indenter": tip,
            "drainage": {"surface": "drained", "tip": "drained", "base": "sealed", "sides": "sealed"},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        dense = material | {"nu": 0.5, "E": 1.5 * material["E"] / (1 + material["nu"])}
        dense.pop("flow")
        share = (0.5, 1.0, 1.0, 1.0)
        elastic = {"material": dense, "loading": {"deltas": [0.5 * depth, depth]}, "solver": {"method": "theory"}}
        undrained = _forces(mapping | elastic)
        forces = [undrained[0], undrained[1], undrained[1], undrained[1]]
        growth = log(undrained[1] / undrained[0]) / log(2.0)  # dlnF/dlndelta
        M = confined_modulus(material["E"], material["nu"])
        low, high = [], []
        for force, part, t in zip(forces, share, mapping["loading"]["times"], strict=True):
            radius = a * (part**0.5 if shape == "paraboloid" else part)
            lost = 9 / 8 * force / (pi * radius**2 * part * depth * M)
            lost *= float(drained_length(1.0, np.array([t]), np.array([min(t, T)]))[0]) * max(growth - 0.5, 1.0)
            low.append(force * (1 - 1.3 * lost))
            high.append(force * (1 - 0.5 * lost))
        return EarlyScene("layer", mapping, low, high)


def _forces(mapping: dict[str, Any]) -> list[float]:
    kept = {key: value for key, value in mapping.items() if key != "drainage"}
    with tempfile.TemporaryDirectory() as folder:
        return [state.force for state in simulate(from_mapping(kept), directory=Path(folder) / "o").states]


def early_scenes(seed: int, count: int) -> Iterator[EarlyScene]:
    """So many random scenes, of the three kinds in turn."""
    drawn = Drawn(seed)
    kinds: tuple[Callable[[], EarlyScene], ...] = (drawn.disc, drawn.column, drawn.layer)
    for k in range(count):
        yield kinds[k % len(kinds)]()


@dataclass(frozen=True)
class Judged:
    """The rows of a scene: error and bar of each force, relative, and whether the run said that it missed an
    accuracy."""

    errors: list[float]
    bars: list[float]
    is_missed: bool


def judged(scene: EarlyScene, accuracy: float | None = None, mesh: dict[str, Any] | None = None) -> Judged:
    """The scene solved with error bars, or to an accuracy."""
    more: dict[str, Any] = {"accuracy": accuracy} if accuracy else {}
    more |= {"mesh": mesh} if mesh else {}
    with tempfile.TemporaryDirectory() as folder:
        found = simulate(from_mapping(scene.mapping | more), directory=Path(folder) / "o", error_bars=not accuracy)
    rows = list(zip(found.states, scene.low, scene.high, strict=True))
    errors = [max(low - row.force, row.force - high, 0.0) / high for row, low, high in rows]
    bars = [(row.force_error or 0.0) / abs(row.force) for row, _, _ in rows]
    return Judged(errors, bars, any("accuracy not reached" in one for one in found.report["warnings"]))


def main() -> None:
    """Run random scenes and print the rates."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--accuracy", type=float)
    parser.add_argument("--mesh", type=float, help="h_contact, over the contact radius: a mesh that is given")
    asked = parser.parse_args()
    inside = rows = met = 0
    over: list[float] = []
    for k, scene in enumerate(early_scenes(asked.seed, asked.count)):
        mesh = {"h_contact": 0.1 * scene.mapping["body"].get("radius", 0.3)} if asked.mesh else None
        found = judged(scene, asked.accuracy, mesh)
        held = [error <= bar for error, bar in zip(found.errors, found.bars, strict=True)]
        inside, rows = inside + sum(held), rows + len(held)
        over += [bar / max(error, 1e-6) for error, bar in zip(found.errors, found.bars, strict=True)]
        met += max(found.errors) <= (asked.accuracy or 0.0) or found.is_missed
        T = scene.mapping["loading"]["times"][1]
        numbers = " ".join(f"{e:.1e}/{b:.1e}" for e, b in zip(found.errors, found.bars, strict=True))
        print(k, scene.kind, f"T {T:.1e}", numbers, "missed" if found.is_missed else "", flush=True)
    print(f"inside {inside} of {rows}, accuracy met or missed in words {met} of {asked.count}", end="; ")
    print(f"median bar over error {np.median(over):.2g}")


if __name__ == "__main__":
    main()
