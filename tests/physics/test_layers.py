"""Layered bodies by finite elements: exact theory of the same stack, and consistency."""

from __future__ import annotations

import dataclasses
import random
from itertools import product
from typing import Any

import numpy as np
import pytest
from promised_bars import ROWS_OF_A_CLASS
from scenes import ELASTIC, force, grid_of, scene, solve, state_on

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run import pipeline
from indent_sim.scene.scene import Scene, resolve

Layers = list[tuple[float, float, float]]  # thickness, E, nu
WALLED = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"}
DEEP = {"delta": 0.02, "steps": 1}

# theory/stack, tests/unit/theory/test_stack.py: (force, a) in a cylinder with a roller wall at 2,
# paraboloid R = 1
SOFT_ON_STIFF: Layers = [(0.2, 1.0, 0.3), (0.8, 10.0, 0.4)]
STIFF_ON_SOFT: Layers = [(0.2, 10.0, 0.3), (0.8, 1.0, 0.45)]
EXACT = {
    "soft on stiff": (SOFT_ON_STIFF, 8.1685143754e-03, 0.16902340),
    "stiff on soft": (STIFF_ON_SOFT, 1.5984026851e-02, 0.10819224),
}


def layered(layers: Layers, body: dict[str, Any] | None = None, **sections: Any) -> Scene:
    """A scene whose layers all have their own materials."""
    own = [
        {"material": ELASTIC | {"E": E, "nu": nu}} | ({"thickness": h} if h else {})
        for h, E, nu in layers
    ]
    given = {
        "body": (body or WALLED) | {"layers": own},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": DEEP,
    }
    return resolve(config_from_mapping(given | sections))


@pytest.mark.parametrize("solver", ["condensed", "newton"])
@pytest.mark.parametrize("case", EXACT)
def test_two_layers_between_frictionless_walls(case: str, solver: str) -> None:
    """Automatic sizes reproduce the exact force to 0.3 % and the contact radius to 0.2 elements.

    0.3 % is what automatic sizes promise for every body.
    """
    layers, F, a = EXACT[case]
    base = layered(layers, solver={"method": solver})
    assert base.exact_theory is not None
    (state,) = solve(base)
    assert state.force == pytest.approx(F, rel=3e-3)
    assert state.a == pytest.approx(a, abs=0.2 * base.sizes.h_contact * base.physics.scales.length)


@pytest.mark.parametrize("nus", [(0.5, 0.5), (0.5, 0.3), (0.3, 0.5), (0.49, 0.0)])
def test_incompressible_layers_beside_others(nus: tuple[float, float]) -> None:
    """Incompressible layers next to others keep 0.3 % of the exact force.

    Each mixed layer has a pressure of its own, which jumps at the interface.
    """
    base = layered([(0.2, 1.0, nus[0]), (0.8, 5.0, nus[1])])
    theory = base.exact_theory
    assert theory is not None
    assert force(base) == pytest.approx(
        theory.solution_at_depth(base.physics.deltas[-1]).force, rel=3e-3
    )  # type: ignore[union-attr]
    mixed = [region.formulation == "mixed" for region in base.physics.domain.regions]
    assert mixed == [nu >= 0.45 for nu in nus]


@pytest.mark.parametrize("body", ["axisymmetric", "strip", "quarter", "box"])
@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_layers_of_one_material_are_one_body(body: str, nu: float) -> None:
    """Layers of one material have the force of one body on the same mesh, to 1e-9.

    Mixed layers have two pressures where one body has a continuous one; they agree to the 0.1 % of
    the mesh.
    """
    bodies = {
        "axisymmetric": WALLED,
        "strip": {"shape": "strip", "width": 4.0, "height": 1.0},
        "quarter": WALLED,
        "box": {"shape": "box", "size": [2.0, 2.0, 1.0]},
    }
    mesh = {
        "h_contact": 0.1,
        "h_far": 0.3,
        "symmetry": "quarter" if body in ("quarter", "box") else "auto",
    }
    base = layered([(0.4, 1.0, nu), (0.6, 1.0, nu)], bodies[body], mesh=mesh)
    part = base.physics.domain
    whole = dataclasses.replace(part.regions[0], bottom=part.regions[-1].bottom)
    one = base.replace_physics(domain=dataclasses.replace(part, regions=(whole,)))
    grid = grid_of(base)
    assert set(grid.regions) == {0, 1}
    found = [state_on(scene_, grid).force for scene_ in (base, one)]
    assert found[0] == pytest.approx(found[1], rel=1e-9 if nu < 0.45 else 1e-3)


@pytest.mark.parametrize(
    "parts", [["quarter", "half"], pytest.param(["quarter", "full"], marks=pytest.mark.verify)]
)
def test_quarter_half_and_whole_of_a_layered_box(parts: list[str]) -> None:
    """Quarter, half and full models of a layered box agree to 0.5 %.

    They have meshes of their own with four elements in the contact radius.
    """
    box, tip = {"shape": "box", "size": [2.0, 2.0, 1.0]}, {"shape": "paraboloid", "R": 5.0}
    forces = [
        force(
            layered(
                SOFT_ON_STIFF,
                box,
                indenter=tip,
                loading={"delta": 0.05, "steps": 1},
                mesh={"h_contact": 0.11, "symmetry": part},
            )
        )
        for part in parts
    ]
    assert forces[1] == pytest.approx(forces[0], rel=5e-3)


def test_a_coating_on_a_half_space() -> None:
    """An accuracy of 0.1 % is met on a coated half-space, beside the stated truncation."""
    base = layered(
        [(0.05, 10.0, 0.3), (0.0, 1.0, 0.4)],
        {"shape": "half_space"},
        accuracy=0.001,
        solver={"method": "condensed"},
    )
    assert base.plan.theory is not None and base.plan.theory.is_exact
    solution = base.plan.theory.solution_at_depth(base.physics.deltas[-1])
    assert solution is not None
    stated = base.plan.prediction["truncation_error"]
    assert 0 < stated < 1e-3
    assert force(base) == pytest.approx(solution.force * base.physics.scales.force, rel=1e-3)


def test_a_hyperelastic_layer_on_a_linear_one_at_small_strain() -> None:
    """At small strain a hyperelastic layer on a linear one is a linear layer, to 1e-3.

    1e-3 is of the order of the strain at the contact; the depth is 1e-4 of the thickness.
    """
    elastic = ELASTIC | {"E": 1.0, "nu": 0.3}
    layers = [
        {"thickness": 0.3, "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3}},
        {"thickness": 0.7, "material": elastic | {"E": 4.0}},
    ]
    loading = {
        "loading": {"delta": 1e-4, "steps": 1},
        "contact": {"method": "auto", "gap": "reference"},
    }
    finite = scene(WALLED | {"layers": layers}, "material=null", **loading)
    layers[0]["material"] = elastic
    linear = scene(WALLED | {"layers": layers}, "material=null", **loading)
    assert not finite.physics.small_strain and linear.physics.small_strain
    assert force(finite) == pytest.approx(force(linear), rel=1e-3)


STIFF_ON_SOFT = {
    "shape": "half_space",
    "layers": [
        {"thickness": 1.0, "material": ELASTIC | {"E": 100.0}},
        {"material": ELASTIC | {"E": 1.0}},
    ],
}
WIDE_PUNCH = {"shape": "flat_punch", "radius": 1.0}


def test_a_stiff_coating_leaves_the_middle_of_a_punch(tmp_path: Any) -> None:
    """A wide punch on a stiff coating has a contact ring, for which a mesh is chosen.

    The full contact of theory would need tension. Without it the force is lower, by less than the
    tensile share.
    """
    loading = {"delta": 0.05, "steps": 1}
    ring = scene(STIFF_ON_SOFT, "material=null", indenter=WIDE_PUNCH, loading=loading)
    theory = ring.plan.theory
    assert (
        ring.is_meshed
        and theory is not None
        and not theory.is_exact
        and 0.1 < theory.tension_fraction < 0.3
    )
    whole = theory.solution_at_depth(ring.physics.deltas[0])
    assert whole is not None
    share = force(ring) / (whole.force * ring.physics.scales.force)
    assert 1 - theory.tension_fraction < share < 1


def test_theory_asked_for_says_that_it_pulls(tmp_path: Any) -> None:
    """Theory, if requested, states its tension, and its bars hold the mesh's force and radius."""
    given = {
        "body": STIFF_ON_SOFT,
        "indenter": WIDE_PUNCH,
        "loading": {"delta": 0.05, "steps": 1},
        "output": {"plot": False},
    }
    outcomes = {
        method: pipeline.simulate(
            config_from_mapping(given | {"solver": {"method": method}}),
            error_bars=True,
            directory=tmp_path / method,
        )
        for method in ("theory", "auto")
    }
    whole, ring = outcomes["theory"].states[0], outcomes["auto"].states[0]
    assert (
        abs(whole.force - ring.force) <= whole.force_error
        and abs(whole.a - ring.a) <= whole.a_error
    )
    assert whole.a == 1 and ring.a < 0.7


def drawn(count: int, seed: int) -> list[tuple[Layers, dict[str, Any]]]:
    """Random stacks of two or three layers under random tips.

    Layers have 0.02 to 1.6 contact radii, moduli up to 1e3 apart, and nu from 0 to 0.5.
    """
    draw, found = random.Random(seed), []
    for _ in range(count):
        above = [0.15 * 10 ** draw.uniform(-1.7, 0.2) for _ in range(draw.choice([1, 1, 2]))]
        layers = [
            (h, 10 ** draw.uniform(-1.5, 1.5), draw.choice([0.0, 0.2, 0.3, 0.45, 0.49, 0.5]))
            for h in (*above, 1 - sum(above))
        ]
        tip = draw.choice(
            [
                {"shape": "paraboloid", "R": 1.0},
                {"shape": "paraboloid", "R": 4.0},
                {"shape": "cone", "half_angle": 75.0},
                {"shape": "sphere", "R": 1.0},
                {"shape": "flat_punch", "radius": 0.2},
            ]
        )
        found.append((layers, tip))
    return found


@pytest.mark.parametrize("number", [6, pytest.param(20, marks=pytest.mark.verify)])
def test_automatic_sizes_of_stacks_drawn_at_random(number: int) -> None:
    """Automatic sizes keep 0.3 % of the force on random stacks, 1 % under a flat punch.

    No element size follows a layer's thickness; reference is the semi-analytic theory of the stack.
    """
    worst = 0.0
    for layers, tip in drawn(number, seed=4):
        base = layered(layers, indenter=tip)
        theory = base.plan.theory
        assert theory is not None and (theory.is_exact or theory.tension_fraction)
        solution = theory.solution_at_depth(base.physics.deltas[-1])
        assert solution is not None
        error = abs(force(base) / (solution.force * base.physics.scales.force) - 1)
        assert error <= max(
            theory.tension_fraction, 0.01 if tip["shape"] == "flat_punch" else 0.003
        ), (
            layers,
            tip,
        )
        worst = max(worst, error)
    print(f"{number} stacks on automatic sizes: {worst:.2%} at most")


@pytest.mark.verify
def test_accuracy_of_stacks_drawn_at_random(tmp_path: Any) -> None:
    """Random stacks meet their targets, and bars from companion runs have the promised coverage."""
    inside, rows, worst = 0, 0, 0.0
    for number, (target, (layers, tip)) in enumerate(product((0.01, 0.001), drawn(10, seed=9))):
        base = layered(layers, indenter=tip, loading={"delta": 0.02, "steps": 10}, accuracy=target)
        if base.plan.theory and base.plan.theory.tension_fraction:
            continue
        truth = np.array(
            [s.force for s in base.plan.theory.solutions_at_depths(base.physics.deltas)]
        )  # type: ignore[union-attr]
        found, bars = judged(layers, tip, target, tmp_path / str(number))
        errors = np.abs(found / (truth * base.physics.scales.force) - 1)
        assert errors.max() <= target, (layers, tip, errors)
        inside += int((errors <= bars).sum())
        rows, worst = rows + len(errors), max(worst, errors.max())
    print(f"{worst:.2e} at most, {inside / rows:.1%} of {rows} rows inside their bars")
    assert inside >= ROWS_OF_A_CLASS * rows


def judged(
    layers: Layers, tip: dict[str, Any], target: float, place: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Forces of a run with `accuracy` and their relative error bars from companion runs alone."""
    own = [{"thickness": h, "material": ELASTIC | {"E": E, "nu": nu}} for h, E, nu in layers]
    config = config_from_mapping(
        {
            "body": WALLED | {"layers": own},
            "indenter": tip,
            "accuracy": target,
            "loading": {"delta": 0.02, "steps": 10},
            "output": {"plot": False, "fields": "none", "surface": "none"},
        }
    )
    outcome = pipeline.simulate(config, directory=place)
    forces = np.array([state.force for state in outcome.states])
    bars = np.array([budget.estimated for budget in outcome.report["error_budget"]])
    return forces, bars / forces
