"""One big first step, and one back: against the same depths along a path of many small steps.

Scenes drawn at random over tips x gap x material (and bodies, methods, depths from 1e-6 to 3 tip radii), on coarse
meshes: what a mesh costs is the same along both paths. Every row is right (the forces agree to AGREE), covered (they
agree within the error that the program states), or refused with a reason (exit 3 or 5). Never anything else: no
negative force, no force that falls as the tip goes deeper.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import pytest

from indent_sim import run
from indent_sim.config import from_mapping
from indent_sim.errors import ConfigError
from indent_sim.scene import Scene, resolve
from indent_sim.sizing import TELLING
from indent_sim.state import State

AGREE = 1e-6  # of the force: Newton stops at 1e-9 of it, and Uzawa's multiplier at 1e-8
PER_RADIUS = {2: 4.0, 3: 2.0}  # elements in a contact radius, by dimension: both paths are on the same mesh
STRIDE = 0.1  # of the tip's radius, along the fine path
FEWEST, MOST = 4, 16  # steps of it
SPATIAL = 25  # every so many scenes are in three dimensions: dear

SHARP_PROFILE = [[0, 0], [0.2, 0.0], [0.6, 0.1], [1.5, 1.0]]
EDGES = [0.01, 0.1, 0.3, 0.7, 0.99]
TIPS: dict[str, Callable[[random.Random], dict[str, Any]]] = {
    "paraboloid": lambda pick: {"R": 1.0},
    "sphere": lambda pick: {"R": 1.0},
    "cone": lambda pick: {"half_angle": pick.uniform(20, 85)},
    "blunt_cone": lambda pick: {"half_angle": pick.uniform(20, 85), "tip_radius": 10 ** pick.uniform(-3, 0)},
    "flat_punch": lambda pick: {"radius": 1.0},
    "round_punch": lambda pick: {"radius": 1.0, "edge_radius": pick.choice(EDGES)},
    "pyramid": lambda pick: {"half_angle": pick.uniform(40, 80), "tip_radius": pick.choice([0.0, 0.2])},
    "profile": lambda pick: {"points": SHARP_PROFILE},
    "smooth_profile": lambda pick: {"points": [[0, 0], [0.3, 0.05], [1.5, 1.0]], "tip_radius": 0.3},
}
SHAPES = {"blunt_cone": "cone", "round_punch": "flat_punch", "smooth_profile": "profile"}
IN_SPACE = "pyramid"  # the one that is no body of revolution
MATERIALS: dict[str, dict[str, Any]] = {
    "linear": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "linear_stiff": {"model": "linear_elastic", "E": 1.0, "nu": 0.4999},
    "neo_hookean": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
    "neo_hookean_stiff": {"model": "neo_hookean", "E": 1.0, "nu": 0.49},
    "mooney_rivlin": {"model": "mooney_rivlin", "C10": 0.1, "C01": 0.05, "nu": 0.45},
    "yeoh": {"model": "yeoh", "C10": 0.15, "C30": 0.001, "nu": 0.45},
    "ogden": {"model": "ogden", "mu": [0.3], "alpha": [2.5], "nu": 0.45},
    "gent": {"model": "gent", "mu": 0.3, "Jm": 30.0, "nu": 0.45},
    "arruda_boyce": {"model": "arruda_boyce", "mu": 0.3, "lambda_m": 3.0, "nu": 0.45},
}
METHODS = ["auto"] * 8 + ["augmented_lagrangian", "penalty", "uzawa", "active_set", "nitsche"]


@dataclass(frozen=True)
class Verdict:
    """What became of a scene: right, covered, refused, or WRONG."""

    outcome: str
    words: str


def scenes(count: int, seed: int = 12) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and config of random scenes, the same for the same seed: every tip x gap x material in turn."""
    pick = random.Random(seed)
    strata = sorted(product(TIPS.keys() - {IN_SPACE}, ("reference", "current"), MATERIALS))
    pick.shuffle(strata)
    for number in range(count):
        tip, gap, material = strata[number % len(strata)]
        in_space = number % SPATIAL == SPATIAL - 1
        tip = pick.choice([IN_SPACE, tip]) if in_space else tip
        depth = pick.uniform(0.3, 3.0) if number % 2 else 10 ** pick.uniform(-6, -0.5)
        height = depth / pick.uniform(0.2, 0.8) if depth > 0.5 else pick.uniform(1.0, 4.0)
        body = _body(pick, in_space, height)
        method = pick.choice(METHODS)
        indenter: dict[str, Any] = {"shape": SHAPES.get(tip, tip)} | TIPS[tip](pick)
        if body["shape"] == "strip" and pick.random() < 0.5:
            body["base"], indenter["center"] = "fixed", _beside(body, pick)
        yield f"{number}-{tip}-{gap}-{material}-{body['shape']}-{method}-{depth:.3g}", {
            "body": body, "material": MATERIALS[material], "indenter": indenter,
            "contact": {"method": method, "gap": gap}, "loading": {"deltas": [depth, depth / 2]},
        }  # fmt: skip


def _body(pick: random.Random, in_space: bool, height: float) -> dict[str, Any]:
    shape = "box" if in_space else pick.choices(["cylinder", "strip"], [5, 1])[0]
    wide = pick.uniform(3.0, 6.0)
    held = {"base": pick.choice(["fixed", "roller"]), "sides": pick.choice(["free", "roller", "fixed"])}
    return {"cylinder": {"shape": "cylinder", "radius": wide, "height": height},
            "strip": {"shape": "strip", "width": 2 * wide, "height": height},
            "box": {"shape": "box", "size": [2 * wide, 2 * wide, height]}}[shape] | held  # fmt: skip


def _beside(body: dict[str, Any], pick: random.Random) -> list[float]:
    """A place up to a tenth of the width beside the middle."""
    return [body["width"] * pick.uniform(0.4, 0.6)]


def coarse(config: dict[str, Any]) -> Scene:
    """The scene on a coarse mesh; in three dimensions one that is cheap."""
    planned = resolve(from_mapping(config))
    h = planned.prediction["a"] / PER_RADIUS[planned.kinematics.dim]
    return resolve(from_mapping(config | {"mesh": {"h_contact": float(f"{h:.3g}")}, "solver": {"max_iterations": 25}}))


def judged(config: dict[str, Any]) -> Verdict:
    """One step to the depth and one back to its half, against the fine path."""
    try:
        scene = coarse(config)
    except ConfigError as refusal:
        return Verdict("refused", str(refusal))
    big = list(run.states(scene, with_surface=False))
    if not big[0].converged:
        return Verdict("refused" if big[0].reason else "WRONG", big[0].reason)
    depth = config["loading"]["deltas"][0]
    steps = min(max(FEWEST, 2 * round(depth / STRIDE / 2)), MOST if scene.kinematics.dim == 2 else FEWEST)
    path = [depth * k / steps for k in range(1, steps + 1)]
    fine = list(run.states(coarse_along(scene, path), with_surface=False))
    return _compared(scene, big, fine, steps)


def coarse_along(scene: Scene, deltas: list[float]) -> Scene:
    """The same scene and mesh along another path."""
    from dataclasses import replace

    return replace(scene, deltas=tuple(delta / scene.scales.length for delta in deltas))


def _compared(scene: Scene, big: list[State], fine: list[State], steps: int) -> Verdict:
    stated = max(scene.prediction["force_error"], TELLING)
    worst, words = "right", []
    forces = [state.force for state in fine if state.converged]
    if any(force < 0 for force in forces + [state.force for state in big if state.converged]):
        return Verdict("WRONG", f"negative force {forces} {[s.force for s in big]}")
    for state, place in zip(big, (steps, steps // 2), strict=False):
        if not state.converged:
            words.append(state.reason[:200])
            continue
        if len(forces) < place:
            worst = "unjudged"
            words.append(f"fine path ends at step {len(forces)} of {steps}: {fine[-1].reason}; big {state.force:.6g} after {forces[-1:]}")
            continue
        other = forces[place - 1]
        difference = abs(state.force - other) / max(abs(other), 1e-300)
        words.append(f"{state.force:.9g} for {other:.9g} ({difference:.1e}), stated {stated:.1e} pen/h {state.penetration/scene.scales.length/scene.sizes.h_contact:.2g} fine {fine[place-1].penetration/scene.scales.length/scene.sizes.h_contact:.2g}")
        if difference > max(AGREE, stated):
            return Verdict("WRONG", "; ".join(words))
        worst = "covered" if difference > AGREE else worst
    falls = [(a, b) for a, b in zip(forces, forces[1:], strict=False) if b < a * (1 - 1e-6)]
    if falls:
        return Verdict("FALLS", f"{falls[:3]}; " + "; ".join(words))
    return Verdict(worst, "; ".join(words))
