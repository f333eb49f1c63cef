"""One large first increment and one back, against the same depths along many small ones.

Random scenes over tips, gaps and materials (and bodies, methods, depths from 1e-6 to 3 tip radii)
on coarse meshes, whose error is the same along both paths. Every row is right (the forces agree to
AGREE), covered (they agree within the stated error), or refused with exit code 3 or 5; and no
sanity check contradicts a right row.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise, product
from pathlib import Path
from typing import Any

import pytest
from scenes import E_STAR, ELASTIC, WALLED, force

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run import pipeline
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.sanity_checks import violated_bound
from indent_sim.scene.expected_error import NEGLIGIBLE_ERROR
from indent_sim.scene.scene import Scene, resolve

AGREE = 1e-6  # of the force: Newton stops at 1e-9 of it, and Uzawa's multiplier at 1e-8
PER_RADIUS = {
    2: 4.0,
    3: 2.0,
}  # elements in a contact radius, by dimension: both paths are on the same mesh
STRIDE = 0.1  # of the tip's radius, along the fine path
FEWEST, MOST = 4, 16  # steps of it
SPATIAL = 25  # every so many scenes are in three dimensions: dear

SHARP_PROFILE = [[0, 0], [0.2, 0.0], [0.6, 0.1], [1.5, 1.0]]
EDGES = [0.01, 0.1, 0.3, 0.7, 0.99]
TIPS: dict[str, Callable[[random.Random], dict[str, Any]]] = {
    "paraboloid": lambda pick: {"R": 1.0},
    "sphere": lambda pick: {"R": 1.0},
    "cone": lambda pick: {"half_angle": pick.uniform(20, 85)},
    "blunt_cone": lambda pick: {
        "half_angle": pick.uniform(20, 85),
        "tip_radius": 10 ** pick.uniform(-3, 0),
    },
    "flat_punch": lambda pick: {"radius": 1.0},
    "round_punch": lambda pick: {"radius": 1.0, "edge_radius": pick.choice(EDGES)},
    "pyramid": lambda pick: {
        "half_angle": pick.uniform(40, 80),
        "tip_radius": pick.choice([0.0, 0.2]),
    },
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
WORST = ("WRONG", "FALSE ALARM", "unjudged", "covered", "right")


@dataclass(frozen=True)
class Verdict:
    """Outcome of a scene, and its reason."""

    outcome: str
    words: str


def scenes(count: int, seed: int = 12) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and config of random scenes: every tip, gap and material in turn."""
    pick = random.Random(seed)
    strata = sorted(product(TIPS.keys() - {IN_SPACE}, ("reference", "current"), MATERIALS))
    pick.shuffle(strata)
    for number in range(count):
        tip, gap, material = strata[number % len(strata)]
        space_coordinates = number % SPATIAL == SPATIAL - 1
        tip = pick.choice([IN_SPACE, tip]) if space_coordinates else tip
        depth = pick.uniform(0.3, 3.0) if number % 2 else 10 ** pick.uniform(-6, -0.5)
        height = depth / pick.uniform(0.2, 0.8) if depth > 0.5 else pick.uniform(1.0, 4.0)
        body = _body(pick, space_coordinates, height)
        method = pick.choice(METHODS)
        indenter: dict[str, Any] = {"shape": SHAPES.get(tip, tip)} | TIPS[tip](pick)
        if body["shape"] == "strip" and pick.random() < 0.5:
            body["base"], indenter["center"] = "fixed", _beside(body, pick)
        yield (
            f"{number}-{tip}-{gap}-{material}-{body['shape']}-{method}-{depth:.3g}",
            {
                "body": body,
                "material": MATERIALS[material],
                "indenter": indenter,
                "contact": {"method": method, "gap": gap},
                "loading": {"deltas": [depth, depth / 2]},
            },
        )


def _body(pick: random.Random, space_coordinates: bool, height: float) -> dict[str, Any]:
    shape = "box" if space_coordinates else pick.choices(["cylinder", "strip"], [5, 1])[0]
    wide = pick.uniform(3.0, 6.0)
    held = {
        "base": pick.choice(["fixed", "roller"]),
        "sides": pick.choice(["free", "roller", "fixed"]),
    }
    return {
        "cylinder": {"shape": "cylinder", "radius": wide, "height": height},
        "strip": {"shape": "strip", "width": 2 * wide, "height": height},
        "box": {"shape": "box", "size": [2 * wide, 2 * wide, height]},
    }[shape] | held


def _beside(body: dict[str, Any], pick: random.Random) -> list[float]:
    """Position up to a tenth of the width off the middle."""
    return [body["width"] * pick.uniform(0.4, 0.6)]


def coarse(config: dict[str, Any]) -> Scene:
    """The scene on a coarse mesh, which is cheap in three dimensions."""
    planned = resolve(config_from_mapping(config))
    h = planned.plan.prediction["a"] / PER_RADIUS[planned.physics.domain.dim]
    return resolve(
        config_from_mapping(
            config | {"mesh": {"h_contact": float(f"{h:.3g}")}, "solver": {"max_iterations": 25}}
        )
    )


def along(scene: Scene, deltas: Sequence[float]) -> list[State]:
    """States of the same scene and mesh along another path."""
    path = tuple(delta / scene.physics.scales.length for delta in deltas)
    return list(
        pipeline.states(
            scene.replace_physics(deltas=path, path=LoadPath("depth", path)), with_surface=False
        )
    )


def judged(config: dict[str, Any]) -> Verdict:
    """Verdict on one increment to the depth and one back to its half."""
    try:
        scene = coarse(config)
    except ConfigError as refusal:
        return Verdict("refused", str(refusal))
    depth, half = config["loading"]["deltas"]
    big = along(scene, [depth, half])
    if not big[0].converged:
        return Verdict("refused" if big[0].reason else "WRONG", big[0].reason)
    steps = min(
        max(FEWEST, 2 * round(depth / STRIDE / 2)),
        MOST if scene.physics.domain.dim == 2 else FEWEST,
    )
    fine = along(scene, [depth * k / steps for k in range(1, steps + 1)])
    pairs = [(big[0], fine[-1])]
    if len(big) == 2 and big[1].converged and len(fine) >= steps // 2:
        pairs.append((big[1], fine[steps // 2 - 1]))
    stated = max(
        scene.plan.prediction.get("force_error", 0.0), NEGLIGIBLE_ERROR
    )  # what is smaller is not worth a warning
    verdicts = [compared(*pair, stated) for pair in pairs]
    if said := contradicted(scene, big) or contradicted(scene, fine):
        verdicts.append(Verdict("FALSE ALARM", said))
    return min(verdicts, key=lambda verdict: WORST.index(verdict.outcome))


def contradicted(scene: Scene, states: Sequence[State]) -> str | None:
    """Sanity check that contradicts one of the states of a path."""
    depths = tuple(state.delta / scene.physics.scales.length for state in states)
    there = scene.replace_physics(deltas=depths, path=LoadPath("depth", depths))
    said = (
        violated_bound(there, state, PreviousRows(states[:k]))
        for k, state in enumerate(states)
        if state.converged
    )
    return next(filter(None, said), None)


def compared(big: State, fine: State, stated: float) -> Verdict:
    """Verdict on a row against the same depth of the fine path."""
    if not fine.converged:
        return Verdict("unjudged", f"{big.force:.9g}, but the fine path ends: {fine.reason}")
    difference = abs(big.force - fine.force) / max(abs(fine.force), 1e-300)
    words = f"{big.force:.9g} for {fine.force:.9g}: {difference:.1e}, stated {stated:.1e}"
    if min(big.force, fine.force) <= 0 or difference > max(AGREE, stated):
        return Verdict("WRONG", words)
    return Verdict("covered" if difference > AGREE else "right", words)


@pytest.mark.stress
@pytest.mark.parametrize("part", range(2))
def test_ten_first_steps(part: int) -> None:
    """Of ten random scenes none is wrong, and at least two of three are right or covered."""
    found = dict[str, Verdict]()
    for name, config in islice(scenes(400), 100 + part, 400, 30):
        found[name] = verdict = judged(config)
        print(f"{verdict.outcome:12s}{name}  {verdict.words}", flush=True)
    counts = Counter(verdict.outcome for verdict in found.values())
    print(dict(counts))
    assert not [
        name for name, verdict in found.items() if verdict.outcome in ("WRONG", "FALSE ALARM")
    ]
    assert counts["right"] + counts["covered"] >= 7


@pytest.mark.parametrize(
    "number", [47, 77, *(pytest.param(k, marks=pytest.mark.verify) for k in (5, 15))]
)
def test_some_of_them(number: int) -> None:
    """Deep first increments of a profile, a round punch, a ball and a cone are right or covered."""
    name, config = next(islice(scenes(number + 1), number, None))
    assert judged(config).outcome in ("right", "covered"), name


GEL = Path(__file__).parents[2] / "configs" / "gel.yaml"


@pytest.fixture(scope="module")
def gel() -> Scene:
    return resolve(load(GEL, ["loading={delta: 1.85, steps: 1}"]))


def test_a_ball_does_not_tunnel(gel: Scene) -> None:
    """A sphere at 1.85 R in one increment has the force of ten increments.

    As `run configs/gel.yaml --set "loading={delta: 1.85, steps: 1}"`.
    """
    (once,) = along(gel, [1.85])
    ten = along(gel, [0.185 * k for k in range(1, 11)])
    assert once.force == pytest.approx(ten[-1].force, rel=AGREE)
    assert all(before.force < after.force for before, after in pairwise(ten))
    assert once.force == pytest.approx(
        20.66, rel=2e-3
    )  # on any mesh: 0.3 % at most, what two meshes differ by


@pytest.mark.verify
@pytest.mark.parametrize("delta", [2.2, 2.64])
def test_a_ball_beyond_its_diameter(gel: Scene, delta: float) -> None:
    """A sphere beyond its diameter has more force than at 1.85 R, in one increment or in 11.

    It once came out at the other side, with a force of 0. At 2.64 R the gel has closed over the
    ball, up to its stem, which is no penetration.
    """
    (once,), fine = along(gel, [delta]), along(gel, [delta / 11 * k for k in range(1, 12)])
    assert once.force == pytest.approx(fine[-1].force, rel=AGREE)
    assert once.force > 21
    assert violated_bound(gel, once, PreviousRows()) is None


def test_the_depth_of_a_deep_ball_is_found() -> None:
    """Under force control a deep sphere is found in one increment, with that force at its depth."""
    pressed = resolve(load(GEL, ["loading={force: 20.66, steps: 1}"]))
    (state,) = pipeline.states(pressed, with_surface=False)
    assert state.converged and state.delta == pytest.approx(1.85, rel=2e-3)  # two meshes again
    (again,) = along(pressed, [state.delta])
    assert again.force == pytest.approx(state.force, rel=AGREE)


@pytest.mark.parametrize("steps", [pytest.param(1, marks=pytest.mark.verify), 14])
def test_a_linear_body_that_turns_inside_out_is_refused(steps: int) -> None:
    """A linear body whose elements invert around a punch is refused, in any unit of length.

    From 0.65 radii on the force fell to a tenth. The share of inverted elements is relative to the
    contact radius.
    """
    config = {
        "body": {"shape": "cylinder", "radius": 2e3, "height": 1.2e3},
        "contact": {"method": "auto", "gap": "current"},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "mesh": {"h_contact": 120.0, "h_far": 400.0},
        "indenter": {"shape": "flat_punch", "radius": 551.0, "edge_radius": 165.0},
        "loading": {"delta": 900.0, "steps": steps},
    }
    *rows, last = pipeline.states(resolve(config_from_mapping(config)), with_surface=False)
    assert all(before.force < after.force for before, after in pairwise(rows))
    assert (
        not last.converged and "inverted (J < 0)" in last.reason and "hyperelastic" in last.reason
    )


NEEDLES: dict[str, dict[str, Any]] = {
    "sphere": {"shape": "sphere", "R": 1e-6},
    "flat_punch": {"shape": "flat_punch", "radius": 1e-6},
    "profile": {"shape": "profile", "points": [[0, 0], [1e-6, 1e-6]]},
}


@pytest.mark.parametrize("tip", NEEDLES.values(), ids=NEEDLES)
def test_a_tip_deep_beyond_its_end_is_a_punch(tip: dict[str, Any]) -> None:
    """A tip pressed in far beyond its end is a flat punch, F = 2 E* R (delta - O(R)).

    R/delta is 1e-4, and the mesh costs 0.1 % at the edge. Beyond 1000 R it was taken for a plate.
    """
    deep = {
        "body": WALLED,
        "material": ELASTIC,
        "indenter": tip,
        "loading": {"delta": 0.01, "steps": 1},
    }
    scene = resolve(config_from_mapping(deep))
    assert force(scene) == pytest.approx(2 * E_STAR * 1e-6 * 0.01, rel=3e-3)
    if tip["shape"] != "flat_punch":
        assert "the same unit" in " ".join(scene.plan.warnings)
    with pytest.raises(ConfigError, match="unit of length"):
        resolve(config_from_mapping(deep | {"contact": {"method": "auto", "gap": "current"}}))


def test_a_contact_is_no_wider_than_its_ball() -> None:
    """The contact radius of a ball deeper than its radius ends at the equator, R = 1.

    A thousandth is allowed for the facets.
    """
    states = list(
        pipeline.states(
            resolve(load(GEL, ("loading={deltas: [0.9, 1.4, 1.85]}",))), with_surface=False
        )
    )
    a = [state.a for state in states]
    assert 0.9 < a[0] < a[1] <= 1.001 and a[2] <= 1.001
