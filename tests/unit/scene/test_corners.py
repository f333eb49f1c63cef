"""Corner singularities: which ones a contact feels, their mesh, and the sizes given to gmsh."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, ELASTIC, STRIP, WALLED, scene

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.mesh.model_domain import Side
from indent_sim.mesh.size_formulas import size_formula
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import coarsen_scene
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.corner_singularities import corners
from indent_sim.scene.scene import resolve

SOFT = {"model": "linear_elastic", "E": 1.0, "nu": 0.4999}
PLATE = {"shape": "flat_punch", "radius": 1.0}
MIXED = {**STRIP, "width": 2.0, "sides": {"x_min": "fixed", "x_max": "free"}}
WIDE = {"shape": "paraboloid", "R": 5.0}
DEEP = {"delta": 0.1, "steps": 1}


def corners_of(
    body: dict[str, Any], tip: dict[str, Any], **sections: Any
) -> set[tuple[float, float]]:
    return set(scene(body, material=SOFT, indenter=tip, loading=DEEP, **sections).sizes.corners)


@pytest.mark.parametrize("sections", [{}, {"accuracy": 0.01}], ids=["automatic", "accuracy"])
def test_wide_contacts_feel_corners_where_a_fixed_face_meets_a_free_one(
    sections: dict[str, Any],
) -> None:
    punch = {"shape": "flat_punch", "radius": 0.8}
    assert corners_of(CYLINDER, PLATE, **sections) == {(1.0, 1.0)}  # the base
    assert corners_of({**CYLINDER, "sides": "fixed"}, punch, **sections) == {(1.0, 0.0)}  # the top
    assert corners_of({**CYLINDER, "sides": "roller"}, punch, **sections) == set()  # a mirror
    assert corners_of({**CYLINDER, "base": "roller"}, PLATE, **sections) == set()
    assert corners_of(MIXED, punch, **sections) == {(1.0, 0.0), (1.0, 1.0)}


def test_small_contacts_on_large_bodies_feel_none() -> None:
    for body in (CYLINDER, {**CYLINDER, "sides": "fixed"}, STRIP, WALLED):
        assert scene(body).sizes.corners == scene(body, accuracy=0.01).sizes.corners == ()


def test_given_sizes_are_left_alone() -> None:
    found = scene(CYLINDER, material=SOFT, indenter=PLATE, mesh={"h_contact": 0.1}).sizes
    assert found.corners == () and found.h_corner is None


def test_coarse_corners_are_doubted() -> None:
    """Coarse elements at a corner are warned of where the mesh is fine elsewhere.

    Elements of a quarter of the height cost 0.53 % of the force.
    """
    coarse = scene(CYLINDER, material=SOFT, indenter=PLATE, mesh={"h_contact": 0.02, "h_far": 0.25})
    assert any("corners" in said for said in coarse.plan.warnings)
    for quiet in (scene(CYLINDER, material=SOFT, indenter=PLATE), scene(CYLINDER), scene(BOX)):
        assert not any("corners" in said for said in quiet.plan.warnings)


def test_a_gap_beside_the_contact_has_as_many_elements_as_the_contact() -> None:
    base = scene(
        {**CYLINDER, "sides": "roller"},
        material=SOFT,
        accuracy=0.01,
        indenter={"shape": "paraboloid", "R": 20.0},
        loading={"delta": 0.01249, "steps": 1},
    )
    assert base.plan.theory is not None and base.plan.resolution is not None
    gap = 1.0 - base.plan.theory.solution_at_depth(0.01249).a  # type: ignore[union-attr]
    assert gap < 0.1 and base.sizes.corners == ((1.0, 0.0),)
    assert base.sizes.h_corner == pytest.approx(gap / base.plan.resolution.n, rel=1e-6)


def test_corners_shrink_with_the_accuracy_and_grow_in_companions() -> None:
    coarse, fine = (
        scene(CYLINDER, material=SOFT, indenter=PLATE, accuracy=target).sizes
        for target in (0.01, 0.001)
    )
    assert coarse.h_corner and fine.h_corner and fine.h_corner < coarse.h_corner / 5
    base = scene(CYLINDER, material=SOFT, indenter=PLATE, accuracy=0.001)
    assert coarsen_scene(base, 1.6).sizes.h_corner == pytest.approx(
        1.6 ** (2.5 / 1.2) * fine.h_corner
    )


def test_what_refined_corners_still_cost_is_known() -> None:
    """The error of refined corners is a tenth of the allowed error, by design.

    A companion run does not show it, because its elements at corners are hardly larger.
    """
    base = scene(CYLINDER, material=SOFT, indenter=PLATE, accuracy=0.001)
    physics, fineness = base.physics, base.plan.resolution
    assert fineness is not None and base.sizes.h_corner is not None
    felt = corners(physics.domain, physics.center, base.sizes.a, 0.4999, base.sizes.punch_edge)
    assert base.sizes.corner_error == pytest.approx(
        max(corner.error(base.sizes.h_corner) for corner in felt)
    )
    assert base.sizes.corner_error == pytest.approx(0.1 * fineness.error, rel=1e-6)


@pytest.mark.parametrize("sections", [{}, {"accuracy": 0.01}], ids=["automatic", "accuracy"])
def test_the_resolved_config_has_the_same_sizes(sections: dict[str, Any]) -> None:
    config = config_from_mapping(
        {"body": CYLINDER, "material": SOFT, "indenter": PLATE, "loading": DEEP} | sections
    )
    first = resolve(config)
    again = resolve(explicit_config(config, first))
    assert again.sizes == first.sizes and first.sizes.h_corner is not None


def test_a_size_of_corners_that_are_not_there_is_refused() -> None:
    given = {"h_contact": 0.1, "h_corner": 0.01}
    for body, mesh in (
        (WALLED, given),
        (BOX, given),
        (CYLINDER, {"h_corner": 0.01}),
        (CYLINDER, {"h_contact": 0.1, "h_corner": 0.2}),
    ):
        with pytest.raises(ConfigError, match="h_corner"):
            scene(body, mesh=mesh)


def test_in_three_dimensions_edges_stay_coarse_and_the_bars_know() -> None:
    """In three dimensions edges are not refined, and their error is part of the error bar."""
    wide, far = (
        scene(
            BOX, material=SOFT, indenter=WIDE, loading={"delta": delta, "steps": 1}, accuracy=0.01
        ).sizes
        for delta in (0.1, 1e-4)
    )
    assert wide.corner_error > 1e-3 > 1e-4 > far.corner_error
    assert wide.corners == far.corners == ()


@pytest.mark.parametrize("body", [CYLINDER, MIXED, {**CYLINDER, "sides": "fixed"}])
def test_gmsh_is_told_the_same_sizes(body: dict[str, Any]) -> None:
    """The size formula for gmsh, evaluated at random points, is the size function of numpy."""
    base = scene(
        body, material=SOFT, indenter={"shape": "flat_punch", "radius": 0.7}, accuracy=0.01
    )
    formula = size_formula(base.sizes, 2).replace("^", "**")
    draw = np.random.default_rng(3)
    x, y = (
        draw.uniform(*base.physics.domain.extent[0], 200),
        draw.uniform(*base.physics.domain.extent[1], 200),
    )
    found = eval(formula, {"Abs": np.abs, "Sqrt": np.sqrt, "x": x, "y": y})
    assert found == pytest.approx(
        base.sizes.size_at(np.abs(x - base.physics.center[0]), -y), rel=1e-9
    )


def test_a_body_that_overhangs_its_base_has_a_notch_there() -> None:
    """A cap that overhangs its base has a notch there, for every nu and support.

    An edge of at most a right angle is singular where it is bonded and nu > 0.
    """
    found = {}
    for angle, base, nu in product((60, 150), ("fixed", "roller"), (0.0, 0.3)):
        body = {"shape": "cap", "base_radius": 1.0, "contact_angle": angle, "base": base}
        part = scene(body, material=ELASTIC | {"nu": nu}).physics.domain
        found[angle, base, nu] = corners(part, (0.0, 0.0), 0.1, nu)
    notches = set(product((150,), ("fixed", "roller"), (0.0, 0.3)))
    assert {key for key, corner in found.items() if corner} == notches | {(60, "fixed", 0.3)}
    (notch,) = found[150, "roller", 0.0]
    assert (notch.r, notch.depth) == (pytest.approx(1 / np.tan(np.radians(75))), 1.0)  # in heights


@pytest.mark.parametrize("angle", [60, 90, 150])
def test_what_a_corner_at_the_foot_costs_knows_no_unit_of_length(angle: float) -> None:
    """The error of a corner at a cap's base scales with the body and is at most 10 %.

    10 % was the largest measured, with elements as large as the corner's distance.
    """
    body = {"shape": "cap", "base_radius": 1.0, "contact_angle": angle}
    part = scene(body, material=SOFT).physics.domain
    twice = replace(part, **{name: _doubled(getattr(part, name)) for name in ("outline", "height")})
    for a in (0.01, 0.1, 0.9):
        (one,), (other,) = (
            corners(piece, (0.0, 0.0), a * k, 0.4999) for piece, k in ((part, 1), (twice, 2))
        )
        assert (other.r, other.distance) == pytest.approx((2 * one.r, 2 * one.distance), rel=1e-9)
        assert other.error_constant == pytest.approx(one.error_constant, rel=1e-9)
        assert 0 < one.error_constant <= 0.1


def _doubled(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_doubled, value))
    if isinstance(value, Side):
        points = {name: getattr(value, name) for name in ("start", "end", "center")}
        return replace(value, **{name: point and _doubled(point) for name, point in points.items()})
    return 2 * value


def test_a_corner_within_half_a_height_of_the_contact_does_not_fade() -> None:
    """Within half a height of the contact the error of a corner does not depend on its distance."""
    body = {"shape": "cap", "base_radius": 1.0, "contact_angle": 60}
    part = scene(body, material=SOFT).physics.domain
    (at,) = corners(part, (0.0, 0.0), 1.0, 0.4999)
    near, far, beyond = (
        corners(part, (0.0, 0.0), at.r - gap * part.height, 0.4999)[0] for gap in (0.1, 0.45, 1.0)
    )
    assert (
        near.error_constant == far.error_constant > beyond.error_constant > 0
    )  # all of them wider than the corner is deep
