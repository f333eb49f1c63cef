"""Random scenes with friction at finite strain, and how rough their contact pressure is.

A pressure that oscillates from node to node is an error of the elements: `p_max` and the pressures
of the surface are as uncertain. A run warns of it by `State.roughness`, the deviation from a
quadratic over neighbouring facets. A second measure, `alternation`, does not use facets: it
compares the pressure at each node of a section with a cubic through two nodes on either side.

`python tests/rubber_with_friction.py --seed 1 --count 60` solves as many scenes and prints a line
for each: both measures, whether a run would warn, and what it took.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.process.errors import IndentSimError
from indent_sim.run import pipeline
from indent_sim.run.measured_constants import MAX_ROUGHNESS
from indent_sim.run.row_warnings import oscillating_pressure_warnings
from indent_sim.scene.scene import Scene, resolve

# Where a pressure need not be smooth: so many nodes beside the rim of contact and beside a crease
# of the tip. Three facets, the two that a run leaves out and the one that it looks at, have six
# nodes more than their vertices
MARGIN = 6
# A pressure of +A and -A in turn differs from the cubic through its neighbours by 8/3 A: the cubic
# has the weights -1/6, 4/6, 4/6 and -1/6 where nodes are equally far apart, and 1 + 8/6 + 2/6 = 8/3
OF_AMPLITUDE = 8 / 3


def drawn(seed: int, number: int) -> dict[str, Any]:
    """Return the mapping of a random scene with friction at finite strain.

    Parameters
    ----------
    seed, number
        Which scene: the same two numbers give the same scene.
    """
    draw = Random(f"rubber with friction {seed} {number}")
    radius = 10 ** draw.uniform(-0.5, 0.5)
    height = radius * 10 ** draw.uniform(-0.3, 1.0)
    tip, a, depth = _tip(draw, radius, height)
    return {
        "body": _body(draw, a, height),
        "material": _rubber(draw),
        "indenter": tip,
        "contact": {
            "method": draw.choice(["augmented_lagrangian", "augmented_lagrangian", "penalty"]),
            "friction": "stick" if draw.random() < 0.15 else round(10 ** draw.uniform(-1.3, 0), 3),
        },
        "loading": {"delta": depth, "steps": draw.randint(2, 6)},
        "mesh": {} if draw.random() < 0.6 else {"h_contact": a / draw.uniform(5, 12)},
        "output": {"fields": "none", "surface": "all", "plot": False},
    }


def _tip(draw: Random, radius: float, height: float) -> tuple[dict[str, Any], float, float]:
    """A tip, the approximate radius of its contact, and its depth.

    The radius is a tenth to four tenths of the smaller length.
    """
    share = draw.uniform(0.1, 0.4)
    ball = {"shape": draw.choice(["sphere", "paraboloid"]), "R": radius}
    edge = draw.uniform(0.1, 0.5)
    punch = {"shape": "flat_punch", "radius": radius, "edge_radius": edge * radius}
    cone = {
        "shape": "cone",
        "half_angle": draw.uniform(60, 80),
        "tip_radius": draw.uniform(0.1, 0.5) * radius,
    }
    depth = share * min(radius, height)
    a_of_ball = (radius * depth) ** 0.5
    return draw.choice(
        [
            (ball, a_of_ball, depth),
            (ball, a_of_ball, depth),
            (punch, radius, depth),
            (cone, 1.5 * radius * share + 0.3 * radius, depth),
        ]
    )


def _body(draw: Random, a: float, height: float) -> dict[str, Any]:
    """A layer, a strip or a cap that is a few contact radii wide."""
    wide = a * draw.uniform(4, 8)
    sides = draw.choice(["free", "roller", "fixed"])
    base = draw.choice(["fixed", "fixed", "roller"])
    layer = {"shape": "cylinder", "radius": wide, "height": height, "base": base, "sides": sides}
    strip = {"shape": "strip", "width": 2 * wide, "height": height, "base": "fixed", "sides": sides}
    cap = {"shape": "cap", "base_radius": wide, "height": wide * draw.uniform(0.4, 0.9)}
    return draw.choice([layer, layer, layer, strip, cap])


def _rubber(draw: Random) -> dict[str, Any]:
    """A hyperelastic law from compressible to nearly or fully incompressible."""
    nu = draw.choice([0.3, 0.4, 0.45, 0.49, 0.499, 0.5])
    return draw.choice(
        [
            {"model": "neo_hookean", "E": 1.0, "nu": nu},
            {"model": "mooney_rivlin", "C10": 0.1, "C01": draw.uniform(0.02, 0.15), "nu": nu},
            {"model": "gent", "mu": 0.35, "nu": nu, "Jm": draw.uniform(10, 50)},
        ]
    )


def alternation(scene: Scene, state: State) -> float:
    """Return the amplitude of the node-to-node oscillation of a section's pressure, over its peak.

    It is 0 where the contact has too few nodes away from its rim and from creases of the tip. Nodes
    at which elements change their size are judged too: a smooth pressure differs from the cubic
    there by the fourth power of the size.
    """
    surface = state.surface
    assert surface is not None
    order = np.argsort(surface.x)
    x, p = surface.x[order], surface.pressure[order]
    inner = np.flatnonzero(p > 0)
    if len(inner) < 2 * MARGIN:
        return 0.0
    is_told = np.zeros(len(x), dtype=bool)
    is_told[inner[0] + (0 if inner[0] == 0 else MARGIN) : inner[-1] + 1 - MARGIN] = True
    touched = np.abs(x + surface.u[order, 0]) / scene.physics.scales.length
    for radius, width in scene.physics.indenter.slope_discontinuities():
        for circle in (radius, radius + width):
            place = int(np.searchsorted(touched, circle))
            is_told[max(0, place - MARGIN) : place + MARGIN] = False
    worst = 0.0
    for i in range(2, len(x) - 2):
        if is_told[i - 2 : i + 3].all():
            near = [i - 2, i - 1, i + 1, i + 2]
            expected = float(np.polyval(np.polyfit(x[near] - x[i], p[near], 3), 0.0))
            worst = max(worst, abs(float(p[i]) - expected) / OF_AMPLITUDE)
    return worst / float(p.max())


@dataclass(frozen=True)
class Judged:
    """The roughest row of a scene by both measures, and the warnings of a run."""

    roughness: float
    alternation: float
    warnings: list[str]


def judged(mapping: dict[str, Any]) -> Judged:
    """Solve a scene and measure how rough the pressure of its rows is."""
    scene = resolve(config_from_mapping(mapping, ()))
    rows = [state for state in pipeline.states(scene) if state.converged]
    return Judged(
        max(state.roughness for state in rows),
        max(alternation(scene, state) for state in rows),
        oscillating_pressure_warnings(scene, rows),
    )


def main() -> None:
    """Print a line for each of the scenes, and how many are rough, warned of, and unsolved."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    asked = parser.parse_args()
    found: list[Judged] = []
    for number in range(asked.count):
        mapping = drawn(asked.seed, number)
        started = time.process_time()
        material = mapping["material"]
        words = f"{mapping['body']['shape']:9s}{mapping['indenter']['shape']:11s}"
        words += f"{material['model']:14s}nu {material['nu']:<6g} "
        words += f"friction {mapping['contact']['friction']!s:6s}"
        try:
            one = judged(mapping)
        except IndentSimError as error:
            print(f"{number:3d} {words} {type(error).__name__}: {str(error)[:120]}", flush=True)
            continue
        found.append(one)
        said = "warned" if one.warnings else ""
        sizes = f"roughness {one.roughness:.4f} alternation {one.alternation:.4f} {said:6s}"
        print(f"{number:3d} {words} {sizes} {time.process_time() - started:.1f} s", flush=True)
    silent = sum(one.alternation > MAX_ROUGHNESS and not one.warnings for one in found)
    warned = sum(bool(one.warnings) for one in found)
    print(
        f"{len(found)} of {asked.count} scenes have rows, {warned} are warned of, "
        f"{silent} are rough without a word"
    )


if __name__ == "__main__":
    main()
