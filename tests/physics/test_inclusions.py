"""Inclusions: an independent force, unchanged cases, symmetries, and error bars that hold."""

from __future__ import annotations

import dataclasses
import itertools
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from promised_bars import ROWS_OF_A_CLASS
from scenes import CYLINDER, ELASTIC, PARABOLOID, STRIP, WALLED, force, grid_of, scene, state_on

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run import pipeline
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.resolution import coarsened_sizes
from indent_sim.scene.scene import Scene, resolve

STIFF = ELASTIC | {"E": 10.0}
CAP = {"shape": "cap", "base_radius": 2.0, "height": 1.0}
BALL = {"shape": "ball", "radius": 1.0}
VERIFY = pytest.mark.verify
EXACT = (
    2.496297e-2  # force on WALLED with `ball()` at delta = 0.05, by another program, good to 1e-5
)


def ball(place: tuple[float, ...] = (0.0, 0.0, -0.35), material: Any = STIFF) -> dict[str, Any]:
    return {"shape": "ball", "center": list(place), "radius": 0.2, "material": material}


def upright(place: tuple[float, ...] = (0.0, 0.0, -0.35), material: Any = STIFF) -> dict[str, Any]:
    return {
        "shape": "cylinder",
        "center": list(place),
        "radius": 0.2,
        "height": 0.3,
        "material": material,
    }


def brick(place: tuple[float, ...], material: Any = STIFF) -> dict[str, Any]:
    return {"shape": "box", "center": list(place), "size": [0.3, 0.4, 0.2], "material": material}


def egg(place: tuple[float, ...] = (0.0, 0.0, -0.35), material: Any = STIFF) -> dict[str, Any]:
    return {
        "shape": "ellipsoid",
        "center": list(place),
        "semi_axes": [0.3, 0.3, 0.15],
        "material": material,
    }


def given(body: dict[str, Any], *inclusions: dict[str, Any], **sections: Any) -> dict[str, Any]:
    """Mapping of a scene with inclusions under a paraboloid pushed in by 0.05."""
    return {
        "body": body | {"inclusions": list(inclusions)},
        "material": ELASTIC,
        "indenter": PARABOLOID,
        "loading": {"delta": 0.05, "steps": 1},
    } | sections


def included(body: dict[str, Any], *inclusions: dict[str, Any], **sections: Any) -> Scene:
    """The resolved scene of that mapping."""
    return resolve(config_from_mapping(given(body, *inclusions, **sections)))


def without(base: Scene) -> Scene:
    """The scene with the material of its first region alone."""
    part = base.physics.domain
    return base.replace_physics(domain=dataclasses.replace(part, regions=part.regions[:1]))


def test_a_ball_inclusion_at_automatic_sizes() -> None:
    """Automatic sizes keep the promised 0.3 % of the force with a ball inclusion."""
    found = force(included(WALLED, ball()))
    print(f"automatic sizes: {found / EXACT - 1:+.4%}")
    assert found == pytest.approx(EXACT, rel=3e-3)


def test_a_ball_inclusion_to_a_given_accuracy(tmp_path: Path) -> None:
    """An accuracy of 0.1 % is met, and the error bars of all rows hold the error."""
    config = config_from_mapping(
        given(
            WALLED,
            ball(),
            accuracy=0.001,
            output={"plot": False, "fields": "none"},
            loading={"delta": 0.05, "steps": 4},
        )
    )
    states = pipeline.simulate(config, directory=tmp_path / "run").states
    bars = [state.force_error or np.nan for state in states]
    assert all(bar <= 1e-3 * state.force for bar, state in zip(bars, states, strict=True))
    print(f"accuracy 0.001: {states[-1].force / EXACT - 1:+.4%}, bar {bars[-1] / EXACT:.4%}")
    assert abs(states[-1].force - EXACT) <= min(bars[-1], 1e-3 * EXACT)


@pytest.mark.parametrize("depth", [0.22, 0.4])
def test_edges_of_a_soft_cylinder_near_the_contact(tmp_path: Path, depth: float) -> None:
    """The error bar holds the force of finer meshes, extrapolated without refined edges.

    A given h_contact leaves the edges of the inclusion alone, whose error is then proportional to
    the element size: the exponent of a crack-like notch, 2 lambda, is 1.09. The two meshes
    differ by 0.3 % at most, so that the extrapolated force is good to 0.1 %.
    """
    soft = {"model": "linear_elastic", "E": 0.01, "nu": 0.45}
    body = WALLED
    inclusion = upright((0.0, 0.0, -depth), soft)

    def run(**sections: Any) -> Any:
        mapping = given(body, inclusion, output={"plot": False, "fields": "none"}, **sections)
        return pipeline.simulate(
            config_from_mapping(mapping),
            directory=tmp_path / "run",
            overwrite=True,
            error_bars=True,
        ).states[-1]

    coarse, fine = (
        force(included(body, inclusion, mesh={"h_contact": 0.01, "h_inclusions": [h]}))
        for h in (0.008, 0.004)
    )
    extrapolated = fine + (fine - coarse)
    state = run()
    assert fine == pytest.approx(coarse, rel=5e-3)
    assert abs(state.force - extrapolated) <= state.force_error + 1e-3 * extrapolated
    assert state.force == pytest.approx(extrapolated, rel=3e-3)
    given_mesh = run(mesh={"h_contact": 0.02})
    assert abs(given_mesh.force - extrapolated) <= given_mesh.force_error


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        pytest.param(
            body,
            kind,
            marks=[] if kind is ball or body in ("axisymmetric", "quarter") else [VERIFY],
        )
        for body in ("axisymmetric", "strip", "quarter", "cap", "ball", "layer")
        for kind in (ball, upright, egg)
    ],
)
def test_an_inclusion_of_the_bodys_own_matter_changes_nothing(body: str, kind: Any) -> None:
    """An inclusion of the body's own material changes nothing on the same mesh, to 1e-9."""
    bodies = {
        "axisymmetric": WALLED,
        "strip": STRIP,
        "quarter": CYLINDER,
        "cap": CAP,
        "ball": BALL,
        "layer": {"shape": "layer", "height": 1.0},
    }
    place = (2.0 if body == "strip" else 0.0, 0.0, -1.0 if body == "ball" else -0.35)
    mesh = {
        "h_contact": 0.1,
        "h_far": 0.3,
        "h_inclusions": [0.08],
        "symmetry": body if body == "quarter" else "auto",
    }
    own = included(bodies[body], kind(place, ELASTIC), mesh=mesh)
    grid = grid_of(own)
    assert set(grid.regions) == {0, 1}
    assert state_on(own, grid).force == pytest.approx(state_on(without(own), grid).force, rel=1e-9)


@pytest.mark.parametrize(
    "parts", [["quarter"], pytest.param(["half", "full"], marks=pytest.mark.verify)]
)
def test_section_quarter_half_and_whole_agree(parts: list[str]) -> None:
    """Section, quarter, half and full models of an inclusion agree to 0.5 %.

    This is the error of coarse facets of wall and ball.
    """
    body = CYLINDER | {"radius": 1.2, "sides": "roller"}
    mesh = {"h_contact": 0.08, "h_far": 0.4, "grading": 0.5, "h_inclusions": [0.05]}
    section = force(included(body, ball()))
    for part in parts:
        assert force(included(body, ball(), mesh=mesh | {"symmetry": part})) == pytest.approx(
            section, rel=5e-3
        ), part


@pytest.mark.parametrize(
    ("inclusions", "symmetry"),
    [
        ([ball()], "axisymmetric"),
        ([upright(), ball((0.0, 0.0, -0.75))], "axisymmetric"),
        ([brick((0.0, 0.0, -0.35))], "quarter"),
        ([egg(), ball((0.0, 0.0, -0.75))], "axisymmetric"),
        ([egg((0.4, 0.4, -0.35))], "full"),
        ([egg() | {"semi_axes": [0.4, 0.2, 0.2]}], "quarter"),
        ([ball((0.0, 0.5, -0.35))], "half"),
        ([ball((0.3, 0.5, -0.35))], "full"),
        ([ball((0.3, 0.0, -0.35)), ball((-0.3, 0.0, -0.35))], "quarter"),
        ([ball((0.3, 0.0, -0.35)), ball((-0.3, 0.0, -0.35), ELASTIC | {"E": 2.0})], "half"),
    ],
)
def test_the_part_has_the_symmetry_of_its_inclusions(inclusions: list[Any], symmetry: str) -> None:
    """The model domain has the symmetry of its inclusions, and meshes each of them.

    Mirror images count only with equal material. Facets lose 10 % of the volume at two elements in
    a radius.
    """
    mesh = {"h_contact": 0.1, "h_far": 0.4, "h_inclusions": [0.05] * len(inclusions)}
    base = included(WALLED, *inclusions, mesh=mesh)
    part, grid = base.physics.domain, grid_of(base)
    assert part.symmetry == symmetry
    corners = grid.points[grid.cells]
    sizes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / (2 if part.dim == 2 else 6)
    if part.dim == 2:
        sizes *= 2 * np.pi * corners[:, :, 0].mean(axis=1)
    inside = sum(inclusion.volume for inclusion, _ in base.sizes.inclusions)
    assert part.symmetry_factor * sizes[grid.regions > 0].sum() == pytest.approx(inside, rel=0.1)


@pytest.mark.parametrize(
    "body", ["axisymmetric", "strip", "cap", pytest.param("quarter", marks=pytest.mark.verify)]
)
def test_an_ellipsoid_of_equal_semi_axes_is_a_ball(body: str) -> None:
    """An ellipsoid of equal semi-axes gives the force of a ball, on a mesh of its own.

    0.1 % is twice the error at automatic sizes; 0.5 % holds in three dimensions.
    """
    bodies, x = {"strip": STRIP, "cap": CAP}, 2.0 if body == "strip" else 0.0
    round_ = egg((x, 0.0, -0.35)) | {"semi_axes": [0.2, 0.2, 0.2]}
    mesh = {"symmetry": "quarter"} if body == "quarter" else {}
    same = [
        force(included(bodies.get(body, WALLED), one, mesh=mesh))
        for one in (ball((x, 0.0, -0.35)), round_)
    ]
    assert same[1] == pytest.approx(same[0], rel=5e-3 if body == "quarter" else 1e-3)


ELLIPSOIDS = [
    (body, semi_axes, E)
    for body, semi_axes, E in itertools.product(
        ("walled", "strip"), ([0.3, 0.3, 0.1], [0.1, 0.1, 0.3]), (0.1, 10.0, 1000.0)
    )
]


# Each body, either way up and each modulus at least once; all of them in `make verify`
FEW = (2, 3, 7, 11)


@pytest.mark.parametrize(
    "case", [pytest.param(n, marks=[] if n in FEW else [VERIFY]) for n in range(len(ELLIPSOIDS))]
)
def test_an_ellipsoid_at_automatic_sizes(case: int) -> None:
    """Automatic sizes keep 0.3 % of the force with an ellipsoid 0.05 below the surface.

    It is three times as long as thick. The reference has sizes 0.4 times as large.
    """
    body, semi_axes, E = ELLIPSOIDS[case]
    x, z = 2.0 if body == "strip" else 0.0, -0.05 - semi_axes[2]
    one = egg((x, 0.0, z), ELASTIC | {"E": E}) | {"semi_axes": semi_axes}
    base = included({"strip": STRIP, "walled": WALLED}[body], one)
    fine = dataclasses.replace(
        base, sizes=coarsened_sizes(base.sizes, 0.4, base.physics.domain.height)
    )
    found, finer = force(base), force(fine)
    print(f"{body} {semi_axes} E {E:g}: {found / finer - 1:+.3%}")
    assert found == pytest.approx(finer, rel=3e-3)


def test_a_section_and_a_quarter_of_an_ellipsoid_agree() -> None:
    """Section and quarter model of an ellipsoid agree to 0.5 %."""
    body = CYLINDER | {"radius": 1.2, "sides": "roller"}
    mesh = {
        "h_contact": 0.08,
        "h_far": 0.4,
        "grading": 0.5,
        "h_inclusions": [0.05],
        "symmetry": "quarter",
    }
    section = force(included(body, egg()))
    assert force(included(body, egg(), mesh=mesh)) == pytest.approx(section, rel=5e-3)


def test_an_ellipsoid_turned_by_a_right_angle() -> None:
    """Exchanging the semi-axes along x and y in a symmetric body changes 0.3 % at most."""
    body = {"shape": "box", "size": [2.0, 2.0, 1.0]}
    mesh = {"h_contact": 0.08, "h_far": 0.4, "h_inclusions": [0.06]}
    found = [
        force(included(body, egg((1.0, 1.0, -0.35)) | {"semi_axes": axes}, mesh=mesh))
        for axes in ([0.4, 0.2, 0.15], [0.2, 0.4, 0.15])
    ]
    assert found[0] == pytest.approx(found[1], rel=3e-3)


def test_two_inclusions_beside_the_tip_of_a_strip() -> None:
    """The half model of a strip with a mirrored pair has the full model's force, to 0.2 %."""
    pair = [ball((1.7, 0.0, -0.3)), ball((2.3, 0.0, -0.3))]
    half, whole = (
        included(STRIP, *pair, mesh={"symmetry": symmetry}) for symmetry in ("auto", "full")
    )
    assert (half.physics.domain.symmetry, whole.physics.domain.symmetry) == ("half", "full")
    assert force(half) == pytest.approx(force(whole), rel=2e-3)


def test_a_half_space_far_larger_than_its_inclusion() -> None:
    """A half-space with an inclusion has the force on a very large body, to 0.5 %.

    This is what the base of the large body takes away.
    """
    endless = included({"shape": "half_space"}, ball())
    assert endless.physics.body.height * endless.physics.scales.length > 20
    finite = {"shape": "cylinder", "radius": 40.0, "height": 40.0}
    assert force(endless) == pytest.approx(force(included(finite, ball())), rel=5e-3)


def test_matter_of_other_kinds() -> None:
    """At small depth, hyperelastic and incompressible inclusions act as linear elastic ones."""
    loading = {
        "loading": {"delta": 1e-4, "steps": 1},
        "contact": {"method": "auto", "gap": "reference"},
    }
    neo = included(WALLED, ball(material={"model": "neo_hookean", "E": 10.0, "nu": 0.3}), **loading)
    assert not neo.physics.small_strain
    assert force(neo) == pytest.approx(force(included(WALLED, ball(), **loading)), rel=1e-3)
    mixed, near = (
        included(WALLED, ball(material=STIFF | {"nu": nu}), **loading) for nu in (0.5, 0.4499)
    )
    assert [region.formulation for region in mixed.physics.domain.regions] == [
        "displacement",
        "mixed",
    ]
    assert force(mixed) == pytest.approx(force(near), rel=1e-3)


def test_a_scene_in_other_units_is_the_same_scene() -> None:
    """The scene in other units has the same mesh, and the same force to 1e-9."""
    micro = {
        "shape": "ball",
        "center": [0.0, 0.0, -0.35e-6],
        "radius": 0.2e-6,
        "material": STIFF | {"E": 1e4},
    }
    body = {"shape": "cylinder", "radius": 2e-6, "height": 1e-6, "sides": "roller"}
    small = included(
        body,
        micro,
        material=ELASTIC | {"E": 1e3},
        indenter=PARABOLOID | {"R": 1e-6},
        loading={"delta": 0.05e-6, "steps": 1},
    )
    plain = included(WALLED, ball())
    assert grid_of(small).hash == grid_of(plain).hash
    assert force(small) == pytest.approx(1e-9 * force(plain), rel=1e-9)


@pytest.mark.parametrize(
    "body", [WALLED, WALLED | {"layers": [{"thickness": 0.1}, {"thickness": 0.9}]}]
)
def test_a_resolved_scene_is_meshed_the_same(body: dict[str, Any]) -> None:
    """The resolved scene contains the sizes of all inclusions and gives the same mesh."""
    config = config_from_mapping(given(body, ball(), upright((0.0, 0.0, -0.75)), accuracy=0.01))
    first = resolve(config)
    again = resolve(explicit_config(config, first))
    assert grid_of(again).hash == grid_of(first).hash
    assert [h for _, h in again.sizes.inclusions] == [h for _, h in first.sizes.inclusions]


def test_theory_stands_beside_but_is_of_another_body() -> None:
    base = scene(WALLED | {"inclusions": [ball()]})
    assert base.plan.theory is not None and base.exact_theory is None
    assert "the theory does not include inclusions" in base.theory_differences


def drawn(count: int, seed: int) -> list[dict[str, Any]]:
    """Random scenes of one inclusion of any depth, size, modulus and Poisson's ratio."""
    draw, found = random.Random(seed), []
    for number in range(count):
        body = STRIP if number % 4 == 3 else WALLED
        radius, x = draw.uniform(0.05, 0.3), draw.choice([2.0, 2.1, 1.7]) if body is STRIP else 0.0
        z = -(1.05 * radius + draw.uniform(0.02, 0.3))
        matter = ELASTIC | {
            "E": 10 ** draw.uniform(-3, 3),
            "nu": draw.choice([0.0, 0.3, 0.45, 0.5]),
        }
        one = {"shape": "ball", "center": [x, 0.0, z], "radius": radius, "material": matter}
        if draw.random() < 0.5:
            one |= {"shape": "cylinder", "height": draw.uniform(0.5, 1.9) * min(radius, -z, 1 + z)}
        tip = draw.choice(
            [PARABOLOID, {"shape": "cone", "half_angle": 75.0}, {"shape": "sphere", "R": 0.5}]
        )
        material = ELASTIC | {"nu": draw.choice([0.1, 0.3, 0.45, 0.49])}
        found.append(
            given(
                body,
                one,
                indenter=tip,
                material=material,
                loading={"delta": 0.05, "steps": 3},
                output={"plot": False, "fields": "none", "surface": "none"},
            )
        )
    return found


@pytest.mark.verify
def test_error_bars_of_inclusions_drawn_at_random(tmp_path: Path) -> None:
    """Random inclusions meet an accuracy of 0.005, and bars have the promised coverage.

    The reference has an accuracy of 0.0005, whose error is allowed for.
    """
    inside, rows, worst = 0, 0, 0.0
    for number, document in enumerate(drawn(4, seed=3)):
        configs = [
            config_from_mapping(document | {"accuracy": accuracy}) for accuracy in (0.005, 0.0005)
        ]
        runs = [
            pipeline.simulate(config, directory=tmp_path / f"{number}_{k}").states
            for k, config in enumerate(configs)
        ]
        for state, fine in zip(*runs, strict=True):
            error = abs(state.force / fine.force - 1)
            assert error <= 0.005 + 0.0005, document
            inside += error <= (state.force_error or 0.0) / state.force + 0.0005
            rows, worst = rows + 1, max(worst, error)
    print(f"accuracy 0.005: {worst:.2e} at most, {inside} of {rows} rows inside their bars")
    assert inside >= ROWS_OF_A_CLASS * rows
