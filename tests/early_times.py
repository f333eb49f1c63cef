"""Random scenes in time and their right forces: draining bodies, relaxing shear, and gels.

Fluid leaves through faces of every kind, on ramps of 1e-7 to 10 of the time that it takes through
the contact. Shear relaxes by sums of exponentials and by power laws, also towards an incompressible
body. The right forces follow from series, limits, bounds and the principle of correspondence. For a
gel, and for a contact that drains for long, only a finer mesh in shorter steps is a reference; it
is solved with `--finer`, otherwise such rows are only counted.

`python tests/early_times.py --seed 1 --count 60` runs so many random scenes and prints a table: how
often a force and the largest pressure are inside their error bars, how often `accuracy` is met, how
wide the bars are, and how many gels end with rows.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from math import log, pi
from pathlib import Path
from typing import Any

import numpy as np
from exact_time import confined_modulus, confined_ramp
from scipy.optimize import brentq
from scipy.special import j0, j1, jn_zeros

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.model.gel import Gel
from indent_sim.model.state import State
from indent_sim.process.errors import NotConverged, VerificationError
from indent_sim.run.error_estimation.coarser_run import (
    REFINEMENT_RATIO,
    coarsen_scene,
    halve_increments,
)
from indent_sim.run.pipeline import simulate, states
from indent_sim.scene.problem_definition import CREASING_STRETCH
from indent_sim.scene.scene import resolve
from indent_sim.theory.drained_layer import drained_length

QUIET = {"fields": "none", "surface": "none", "plot": False}
TERMS = 4000  # of the disc's series: at D t = 5e-8 a^2 the last has fallen by e^-8
# of a ramp: straight pieces of an elastic curve that goes with a power of 3/2 are off by 1e-4 at
# half of it
PARTS = 200
EARLY = 1e-2  # D t/h^2 of a column, up to which it is a half-space to e^-100
FIRST_ORDER = (
    2e-5  # D t/a^2 up to which a contact on a layer has lost what a film takes, to a tenth of that
)


@dataclass(frozen=True)
class EarlyScene:
    """A scene, its kind, and the least and the largest right force of each row.

    `peaks` has the least and the largest right `p_max` of each row, or None where it is not known.
    A scene whose only reference is a finer one has no bounds at all.
    """

    kind: str
    mapping: dict[str, Any]
    low: list[float]
    high: list[float]
    peaks: list[tuple[float, float]] | None = None


@lru_cache(maxsize=8)
def _disc_terms(nu: float) -> tuple[np.ndarray, np.ndarray]:
    """Roots x of (1 - nu) x J0(x) = (1 - 2 nu) J1(x) and the amplitudes A of
    `exact_time.unconfined_force`.
    """
    ends = [0.0, *jn_zeros(1, TERMS)]

    def equation(x: float) -> float:
        return float((1 - nu) * x * j0(x) - (1 - 2 * nu) * j1(x))

    x = np.array([brentq(equation, low + 1e-9, high, xtol=1e-13) for low, high in pairwise(ends)])
    return x, (1 - nu) * (1 - 2 * nu) / (1 + nu) / ((1 - nu) ** 2 * x**2 - (1 - 2 * nu))


def disc_ramp(E: float, nu: float, D: float, a: float, eps: float, T: float, t: float) -> float:
    """Force on a disc between sealed frictionless plates whose side is drained, after a ramp.

    The strain of the disc of radius a grows evenly to eps in the time T and stays. The force is the
    integral of Armstrong, Lai & Mow's response to a step.
    """
    x, A = _disc_terms(nu)
    rates = x**2 * D / a**2

    def ramp(s: float) -> float:
        if s <= 0:
            return 0.0
        return s + float(np.sum(A * -np.expm1(-rates * s) / rates))

    return pi * a**2 * E * eps / T * (ramp(t) - ramp(t - T))


def column_ramp(E: float, nu: float, D: float, h: float, depth: float, T: float, t: float) -> float:
    """Pressure on the drained top of a confined column after a ramp.

    Its shortening grows evenly to `depth` in the time T and stays.
    """
    M = confined_modulus(E, nu)

    def ramp(s: float) -> float:
        if s <= 0:
            return 0.0
        if D * s / h**2 < EARLY:
            return 2 * M * depth / T * float(np.sqrt(s / (pi * D)))
        return confined_ramp(E, nu, D / M, h, depth / T, s)

    return ramp(t) - ramp(t - T)


class Drawn:
    """Random poroelastic scenes from a seed, of lengths and moduli of the order of 1 and D = 1."""

    def __init__(self, seed: int):
        self.draw = np.random.default_rng(seed)

    def spread(self, low: float, high: float) -> float:
        return float(np.exp(self.draw.uniform(np.log(low), np.log(high))))

    def either(self, *choices: Any) -> Any:
        return choices[int(self.draw.integers(len(choices)))]

    def material(self) -> dict[str, Any]:
        nu = float(self.draw.uniform(0.0, 0.4))
        return {
            "model": "linear_elastic",
            "E": self.spread(0.1, 10.0),
            "nu": nu,
            "flow": {"diffusivity": 1.0},
        }

    def times(self, T: float) -> list[float]:
        """Times of two rows on the way in and two in the hold after it."""
        return [float(f"{share * T:.9g}") for share in (0.5, 1.0, 1.3, 2.0)]

    def history(self, T: float, depth: float) -> dict[str, Any]:
        return {"history": [[0, 0], [T, depth], [3 * T, depth]], "times": self.times(T)}

    def disc(self) -> EarlyScene:
        """A disc compressed between sealed plates, its side drained."""
        material, a, h = self.material(), self.spread(0.3, 2.0), 1.0
        T, depth = a * a * self.spread(1e-7, 10.0), 0.01 * h
        mapping = {
            "body": {
                "shape": "cylinder",
                "radius": a,
                "height": h,
                "base": "roller",
                "sides": "free",
            },
            "material": material,
            "indenter": {"shape": "flat_punch", "radius": a},
            "drainage": {
                "surface": "sealed",
                "tip": "sealed",
                "base": "sealed",
                "sides": "drained",
            },
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        right = [
            disc_ramp(material["E"], material["nu"], 1.0, a, depth / h, T, t)
            for t in mapping["loading"]["times"]
        ]
        return EarlyScene("disc", mapping, right, right)

    def column(self) -> EarlyScene:
        """A column confined by rollers, drained under the tip or at its base."""
        material, a, h = self.material(), self.spread(0.1, 0.5), 1.0
        T, depth = self.spread(1e-4, 10.0), 0.01 * h
        tip, base = self.either(("drained", "sealed"), ("sealed", "drained"))
        mapping = {
            "body": {
                "shape": "cylinder",
                "radius": a,
                "height": h,
                "base": "roller",
                "sides": "roller",
            },
            "material": material,
            "indenter": {"shape": "flat_punch", "radius": a},
            "drainage": {"surface": "sealed", "tip": tip, "base": base, "sides": "sealed"},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        pressures = [
            column_ramp(material["E"], material["nu"], 1.0, h, depth, T, t)
            for t in mapping["loading"]["times"]
        ]
        right = [pi * a * a * p for p in pressures]
        return EarlyScene("column", mapping, right, right, [(p, p) for p in pressures])

    def layer(self) -> EarlyScene:
        """A paraboloid, ball or cone on a layer, pressed in so quickly that only a film drains.

        The layer drains under and beside the tip. What the film takes from the undrained force is
        known to a third of itself.
        """
        material, R, h = self.material(), self.spread(0.3, 3.0), 1.0
        shape, a = self.either("paraboloid", "cone"), self.spread(0.1, 0.4)
        angle = 80.0
        depth = (
            a * a / R if shape == "paraboloid" else pi / 2 * a / float(np.tan(np.radians(angle)))
        )
        tip = (
            {"shape": shape, "R": R}
            if shape == "paraboloid"
            else {"shape": shape, "half_angle": angle}
        )
        T = a * a * self.spread(1e-7, FIRST_ORDER)
        mapping = {
            "body": {"shape": "layer", "height": h, "base": self.either("fixed", "roller")},
            "material": material,
            "indenter": tip,
            "drainage": {
                "surface": "drained",
                "tip": "drained",
                "base": "sealed",
                "sides": "sealed",
            },
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        dense = material | {"nu": 0.5, "E": 1.5 * material["E"] / (1 + material["nu"])}
        dense.pop("flow")
        share = (0.5, 1.0, 1.0, 1.0)
        elastic = {
            "material": dense,
            "loading": {"deltas": [0.5 * depth, depth]},
            "solver": {"method": "theory"},
        }
        undrained = _forces(mapping | elastic)
        forces = [undrained[0], undrained[1], undrained[1], undrained[1]]
        growth = log(undrained[1] / undrained[0]) / log(2.0)  # dlnF/dlndelta
        M = confined_modulus(material["E"], material["nu"])
        low, high = [], []
        for force, part, t in zip(forces, share, mapping["loading"]["times"], strict=True):
            radius = a * (part**0.5 if shape == "paraboloid" else part)
            lost = 9 / 8 * force / (pi * radius**2 * part * depth * M)
            lost *= float(drained_length(1.0, np.array([t]), np.array([min(t, T)]))[0]) * max(
                growth - 0.5, 1.0
            )
            low.append(force * (1 - 1.3 * lost))
            high.append(force * (1 - 0.5 * lost))
        return EarlyScene("layer", mapping, low, high)

    def relaxation(self) -> tuple[dict[str, Any], Callable[[float], float]]:
        """A law of relaxation in shear, and the integral of G(t)/G from 0 to a time.

        One or two exponentials that leave 0.3 to 1e-4 of the modulus, or a power law.
        """
        if self.draw.random() < 0.25:
            n, tau = float(self.draw.uniform(0.05, 0.4)), self.spread(0.03, 3.0)
            law: dict[str, Any] = {"power_law": {"exponent": n, "time": tau}, "of": "shear"}
            return law, lambda t: tau**n * max(t, 0.0) ** (1 - n) / (1 - n)
        rest, share = self.spread(1e-4, 0.3), float(self.draw.uniform(0.2, 1.0))
        terms = [
            [share * (1 - rest), self.spread(0.03, 0.3)],
            [(1 - share) * (1 - rest), self.spread(0.3, 3.0)],
        ]
        terms = [[g, tau] for g, tau in terms if g > 0]

        def integral(t: float) -> float:
            left = 1 - sum(g for g, _ in terms)
            return (
                left * t - sum(g * tau * float(np.expm1(-t / tau)) for g, tau in terms)
                if t > 0
                else 0.0
            )

        return {"prony": terms, "of": "shear"}, integral

    def relaxing_column(self) -> EarlyScene:
        """A relaxing column confined by rollers.

        Its modulus is kappa + 4/3 G(t), of which kappa stays.
        """
        E, nu = self.spread(0.1, 10.0), float(self.draw.uniform(0.0, 0.49))
        law, integral = self.relaxation()
        a, depth, T = self.spread(0.1, 0.5), 0.01, self.spread(1e-3, 10.0)
        mapping = {
            "body": {
                "shape": "cylinder",
                "radius": a,
                "height": 1.0,
                "base": "roller",
                "sides": "roller",
            },
            "material": {"model": "linear_elastic", "E": E, "nu": nu, "relaxation": law},
            "indenter": {"shape": "flat_punch", "radius": a},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        kappa, G = E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))
        pressures = [
            depth / T * (kappa * min(t, T) + 4 / 3 * G * (integral(t) - integral(t - T)))
            for t in mapping["loading"]["times"]
        ]
        right = [pi * a * a * p for p in pressures]
        return EarlyScene("relaxing column", mapping, right, right, [(p, p) for p in pressures])

    def relaxing_contact(self) -> EarlyScene:
        """A ball on an incompressible relaxing layer.

        By correspondence F(t) = int psi(t - s) dF_el(delta(s)), since the contact grows (Lee &
        Radok 1960), and so the pressure at each radius. What was pressed last has relaxed least:
        where the ball goes in as slowly as shear relaxes, the pressure is largest near the rim of
        contact.
        """
        E, R, a = self.spread(0.1, 10.0), self.spread(0.3, 3.0), self.spread(0.1, 0.4)
        law, integral = self.relaxation()
        depth, T = a * a / R, self.spread(1e-3, 10.0)
        material = {"model": "linear_elastic", "E": E, "nu": 0.5}
        mapping = {
            "body": {"shape": "layer", "height": 1.0, "base": self.either("fixed", "roller")},
            "material": material | {"relaxation": law},
            "indenter": {"shape": "paraboloid", "R": R},
            "loading": self.history(T, depth),
            "output": QUIET,
        }
        shares = np.linspace(0.0, 1.0, PARTS + 1)[1:]
        curve = {
            "loading": {"deltas": [float(depth * share) for share in shares]},
            "solver": {"method": "theory"},
        }
        elastic_scene = mapping | curve | {"material": material}
        del elastic_scene["output"]
        elastic = list(states(elastic_scene))
        surfaces = [row.surface for row in elastic]
        pressures = np.array([surface.pressure for surface in surfaces if surface])

        def relaxed(values: list[float], t: float) -> float:
            """The integral over straight pieces of the elastic value."""
            steps, ends = np.diff([0.0, *values]), [0.0, *(T * shares)]
            means = [(integral(t - s0) - integral(t - s1)) / (s1 - s0) for s0, s1 in pairwise(ends)]
            return float(np.dot(steps, means))

        times = mapping["loading"]["times"]
        right = [relaxed([row.force for row in elastic], t) for t in times]
        peaks = [max(relaxed(list(at_radius), t) for at_radius in pressures.T) for t in times]
        return EarlyScene("relaxing contact", mapping, right, right, [(p, p) for p in peaks])

    def contact(self) -> EarlyScene:
        """A ball or cone on a body that drains through some of its faces, at any speed.

        Its only reference is a finer run.
        """
        material, R, a = self.material(), self.spread(0.3, 3.0), self.spread(0.1, 0.4)
        shape = self.either("paraboloid", "cone")
        depth = a * a / R if shape == "paraboloid" else pi / 2 * a / float(np.tan(np.radians(80.0)))
        body = {"shape": "cylinder", "radius": float(self.draw.uniform(1.0, 3.0)), "height": 1.0}
        mapping = {
            "body": body
            | {
                "base": self.either("fixed", "roller"),
                "sides": self.either("roller", "free", "fixed"),
            },
            "material": material,
            "indenter": {"shape": shape, "R": R}
            if shape == "paraboloid"
            else {"shape": shape, "half_angle": 80.0},
            "drainage": {
                "surface": self.either("drained", "sealed"),
                "tip": self.either("drained", "sealed"),
                "base": self.either("drained", "sealed"),
                "sides": self.either("drained", "sealed", "auto"),
            },
            "loading": self.history(a * a * self.spread(1e-7, 10.0), depth),
            "output": QUIET,
        }
        return EarlyScene("contact", mapping, [], [])

    def swelling_law(self) -> dict[str, Any]:
        """A gel whose free swelling is stable, and whose skin swells too little to crease.

        A third of those drawn would crease, and lose rows.
        """
        while True:
            law = {"G": self.spread(0.3, 3), "n_omega": self.spread(1e-3, 1e-2)}
            law |= {
                "chi": float(self.draw.uniform(0.2, 0.65)),
                "stretch": float(self.draw.uniform(1.2, 1.7)),
            }
            gel = Gel(**law)
            try:
                gel.canonical()
            except ValueError:
                continue
            if gel.confined_swelling(gel.bath_pressure(0.0)).stretch <= CREASING_STRETCH:
                return {"model": "gel"} | law

    def gel(self) -> EarlyScene:
        """A gel that swells in its pure solvent under a tip that stands still or comes."""
        body = {"shape": "cylinder", "radius": float(self.draw.uniform(1.5, 3)), "height": 1.0}
        body |= {"base": self.either("fixed", "roller"), "sides": self.either("roller", "free")}
        material = self.swelling_law()
        tips: list[dict[str, Any]] = [
            {"shape": "sphere", "R": self.spread(0.5, 2)},
            {"shape": "paraboloid", "R": self.spread(0.5, 2)},
            {"shape": "cone", "half_angle": float(self.draw.uniform(60, 80)), "tip_radius": 0.1},
            {
                "shape": "hyperboloid",
                "R": self.spread(0.3, 1),
                "half_angle": float(self.draw.uniform(45, 75)),
            },
            {
                "shape": "flat_punch",
                "radius": float(self.draw.uniform(0.3, 0.8)),
                "edge_radius": 0.05,
            },
        ]
        depth, ramp = (
            float(self.either(0.0, float(self.draw.uniform(0.02, 0.15)))),
            self.spread(0.3, 30),
        )
        points = [[0, 0], [ramp, depth], [300, depth]] if depth else [[0, 0], [300, 0]]
        mapping = {
            "body": body,
            "material": material | {"flow": {"diffusivity": 1.0}},
            "drainage": {"tip": self.either("sealed", "drained"), "bath": 0.0},
            "indenter": self.either(*tips),
            "loading": {"history": points, "times": [2, 60, 300], "per_doubling": 2},
            "output": QUIET,
        }
        return EarlyScene("gel", mapping, [], [])


def _forces(mapping: dict[str, Any]) -> list[float]:
    return [state.force for state in _rows(mapping)]


def _rows(mapping: dict[str, Any]) -> list[State]:
    """The rows of an elastic scene."""
    kept = {key: value for key, value in mapping.items() if key != "drainage"}
    with tempfile.TemporaryDirectory() as folder:
        return list(simulate(config_from_mapping(kept), directory=Path(folder) / "o").states)


KINDS = ("disc", "column", "layer", "relaxing column", "relaxing contact", "contact", "gel")


def early_scenes(seed: int, count: int, kinds: Sequence[str] = KINDS) -> Iterator[EarlyScene]:
    """Random scenes, of all kinds in turn."""
    drawn = Drawn(seed)
    for k in range(count):
        yield getattr(drawn, kinds[k % len(kinds)].replace(" ", "_"))()


@dataclass(frozen=True)
class Judged:
    """Errors of the rows of a scene beside their bars.

    The error and the bar of each force, relative, and of each p_max that is known; whether the run
    said that it missed an accuracy; and why it ended before its last row, if it did.
    """

    errors: list[float]
    bars: list[float]
    is_missed: bool
    peak_errors: list[float] = field(default_factory=list)
    peak_bars: list[float] = field(default_factory=list)
    lost: str = ""

    @property
    def held(self) -> list[bool]:
        """Whether each force is inside its bar."""
        return [error <= bar for error, bar in zip(self.errors, self.bars, strict=True)]

    @property
    def peaks_held(self) -> list[bool]:
        """Whether each p_max is inside its bar."""
        return [error <= bar for error, bar in zip(self.peak_errors, self.peak_bars, strict=True)]


def judged(
    scene: EarlyScene,
    accuracy: float | None = None,
    mesh: dict[str, Any] | None = None,
    *,
    finer: bool = False,
) -> Judged:
    """Solve a scene with error bars, or to an accuracy.

    `finer` says whether scenes without bounds are judged by the rows of a finer one; otherwise they
    are only solved.
    """
    more: dict[str, Any] = {"accuracy": accuracy} if accuracy else {}
    more |= {"mesh": mesh} if mesh else {}
    config = config_from_mapping(scene.mapping | more)
    has_bars = bool(scene.low) or finer  # what is not judged needs none
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = simulate(
                config, directory=Path(folder) / "o", error_bars=has_bars and not accuracy
            )
        except (NotConverged, VerificationError) as end:
            return Judged([], [], False, lost=str(end))
    said = any("accuracy not reached" in one for one in found.report["warnings"])
    if not has_bars:
        return Judged([], [], said)
    low, high, peaks = scene.low, scene.high, scene.peaks
    rows = found.states
    if not low:
        right = finer_rows(config)
        low = high = [row.force for row in right]
        peaks = [(row.p_max, row.p_max) for row in right]
        # A finer run that ends early judges the rows that it has.
        rows = rows[: len(right)]
    forces = [
        (row.force, row.force_error, *ends) for row, *ends in zip(rows, low, high, strict=True)
    ]
    maxima = [
        (row.p_max, row.p_max_error, *ends) for row, ends in zip(rows, peaks or (), strict=False)
    ]
    maxima = [one for one in maxima if one[0] == one[0]]
    return Judged(*_errors_and_bars(forces), said, *_errors_and_bars(maxima))


def _errors_and_bars(
    rows: Sequence[tuple[float, float | None, float, float]],
) -> tuple[list[float], list[float]]:
    """Relative error and half-width of each value.

    Each row has a value, its bar, and the least and the largest right value. The right value of a
    row is zero where a gel has shrunk away from the tip; such a row is not judged.
    """
    judged = [row for row in rows if row[3]]
    errors = [max(low - value, value - high, 0.0) / high for value, _, low, high in judged]
    return errors, [(bar or 0.0) / high for _, bar, _, high in judged]


def finer_rows(config: Config) -> list[State]:
    """The rows of a scene in time on elements 5/8 as large, in steps half as long.

    Its bath comes in an eighth of the time.
    """
    scene = resolve(config)
    fine = coarsen_scene(
        scene.replace_physics(bath_ramp=scene.physics.bath_ramp / 8), 1 / REFINEMENT_RATIO
    )
    halved = halve_increments(fine)
    assert halved is not None
    return [row for row in states(halved, with_surface=False) if row.converged][1::2]


def main() -> None:
    """Run random scenes and print each, and a table of the rates."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--accuracy", type=float)
    parser.add_argument(
        "--mesh", type=float, help="h_contact, over the contact radius: a mesh that is given"
    )
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS)
    parser.add_argument(
        "--finer",
        action="store_true",
        help="judge scenes without bounds by finer meshes in shorter steps",
    )
    asked = parser.parse_args()
    found: dict[str, list[Judged]] = {kind: [] for kind in asked.kinds}
    for k, scene in enumerate(early_scenes(asked.seed, asked.count, asked.kinds)):
        mesh = (
            {"h_contact": asked.mesh * scene.mapping["body"].get("radius", 0.3)}
            if asked.mesh
            else None
        )
        one = judged(scene, asked.accuracy, mesh, finer=asked.finer)
        found[scene.kind].append(one)
        T = scene.mapping["loading"]["history"][1][0]
        numbers = " ".join(f"{e:.1e}/{b:.1e}" for e, b in zip(one.errors, one.bars, strict=True))
        peaks = " ".join(
            f"{e:.1e}/{b:.1e}" for e, b in zip(one.peak_errors, one.peak_bars, strict=True)
        )
        print(
            k,
            scene.kind,
            f"T {T:.1e}",
            numbers,
            f"p {peaks}",
            one.lost,
            "missed" * one.is_missed,
            flush=True,
        )
    print(table(found, asked.accuracy))


def table(found: dict[str, list[Judged]], accuracy: float | None) -> str:
    """A Markdown table of the rates of each kind of scene."""
    lines = [
        "| scenes | number | with all rows | force inside its bar | median bar/error | "
        "p_max inside its bar | met |",
        "|---|---|---|---|---|---|---|",
    ]
    whole = [one for kind in found.values() for one in kind]
    for name, some in [*found.items(), ("all", whole)]:
        held = [is_held for one in some for is_held in one.held]
        peaks = [is_held for one in some for is_held in one.peaks_held]
        over = [
            bar / max(error, 1e-6)
            for one in some
            for error, bar in zip(one.errors, one.bars, strict=True)
        ]
        met = (
            [max(one.errors, default=0.0) <= accuracy or one.is_missed for one in some]
            if accuracy
            else []
        )
        ended = sum(not one.lost for one in some)
        middle = f"{np.median(over):.2g}" if over else ""
        cells = [name, str(len(some)), str(ended), _rate(held), middle, _rate(peaks), _rate(met)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _rate(held: Sequence[bool]) -> str:
    return f"{sum(held)} of {len(held)}" if held else ""


if __name__ == "__main__":
    main()
