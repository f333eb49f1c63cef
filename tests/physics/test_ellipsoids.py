"""Ellipsoids of revolution: between two tips, bonded, and at rest on a rigid flat."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.run.pipeline import states
from indent_sim.scene.scene import Scene, resolve

LAW = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
E_STAR = 1.0 / (1 - 0.3**2)
PLATE = {"shape": "plate"}
SPHERE = {"shape": "sphere", "R": 1 / 3}


def ellipsoid(height: float, base: str = "unbonded") -> dict[str, Any]:
    return {"shape": "ellipsoid", "radius": 1.0, "height": height, "base": base}


def scene_of(body: dict[str, Any], **sections: Any) -> Scene:
    document = {"material": LAW, "indenter": SPHERE, "loading": {"delta": 0.0267}, **sections}
    return resolve(config_from_mapping({"body": body, **document}))


def last_row(body: dict[str, Any], **sections: Any) -> State:
    return list(states(scene_of(body, **sections), with_surface=False))[-1]


def hertz_depth(force: float, R: float) -> float:
    return float((0.75 * force / (E_STAR * R**0.5)) ** (2 / 3))


@pytest.mark.parametrize("base", ["unbonded", "roller", "fixed"])
def test_an_ellipsoid_with_equal_axes_is_a_ball(base: str) -> None:
    """The same circle gives the same mesh, and with it the same numbers.

    An ellipse that differs from it by 5e-8 is drawn in another way; the force changes by 2e-8.
    """
    ball = last_row({"shape": "ball", "radius": 1.0, "base": base})
    assert last_row(ellipsoid(2.0, base)).force == ball.force
    nearly = last_row(ellipsoid(2.0000001, base))
    assert nearly.force == pytest.approx(ball.force, rel=1e-6)
    assert nearly.a == pytest.approx(ball.a, rel=1e-5)
    assert (nearly.a_base or 0.0) == pytest.approx(ball.a_base or 0.0, rel=1e-5)


@pytest.mark.parametrize("height", [1.0, 4.0])
def test_small_contacts_are_two_hertz_contacts_in_series(height: float) -> None:
    """The apexes have the radius of curvature radius^2/(height/2).

    The contacts displace each other by a share of about a/R: the difference is 7e-4 and -3e-4 here,
    and 10^0.5 times as large at ten times the approach.
    """
    R = 2 / height
    row = last_row(ellipsoid(height), loading={"delta": 2e-6}, mesh={"h_contact": 3e-5})
    upper = hertz_depth(row.force, 1 / (3 + 1 / R))
    lower = hertz_depth(row.force, R)
    assert upper + lower == pytest.approx(row.delta, rel=1e-3)
    assert row.base_approach == pytest.approx(lower, rel=1.5e-3)
    assert row.a_base == pytest.approx((lower * R) ** 0.5, rel=5e-3)


@pytest.mark.parametrize("height", [0.5, 4.0])
def test_an_ellipsoid_under_a_plate_is_half_of_it_by_symmetry(height: float) -> None:
    """Plate above and flat below: the mid-plane is a mirror plane, which another mesh has.

    At an approach of 5 % of the height the contact is a quarter of the width; measured: force
    4e-5, radius 1.3e-3.
    """
    delta = 0.05 * height
    scene: dict[str, Any] = {
        "indenter": PLATE,
        "loading": {"delta": delta},
        "mesh": {"h_contact": 0.01},
    }
    resting = last_row(ellipsoid(height), **scene)
    half = last_row(ellipsoid(height, "roller"), **scene)
    assert resting.a > 0.2
    assert resting.force == pytest.approx(half.force, rel=5e-4)
    assert resting.energy == pytest.approx(half.energy, rel=5e-4)
    assert resting.a_base == pytest.approx(half.a, rel=3e-3)
    assert resting.base_approach == pytest.approx(delta / 2, rel=1e-3)


def test_a_soft_tip_presses_an_ellipsoid() -> None:
    """A tip of 1e8 times the modulus is the rigid one; its expected radius changes the mesh."""
    hard = {"model": "linear_elastic", "E": 1e8, "nu": 0.3}
    soft = last_row(ellipsoid(1.5), indenter={**SPHERE, "material": hard})
    assert soft.force == pytest.approx(last_row(ellipsoid(1.5)).force, rel=1e-6)


def test_a_hyperelastic_ellipsoid_between_plates_is_linear_at_first() -> None:
    """The difference is that of the strain, a/R = 0.02: 5.8e-3 of the force at a/R = 0.06."""
    law = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
    scene: dict[str, Any] = {"indenter": PLATE, "loading": {"delta": 4e-4}}
    finite = last_row(ellipsoid(4.0, "roller"), material=law, **scene)
    linear = last_row(ellipsoid(4.0, "roller"), **scene)
    assert finite.force == pytest.approx(linear.force, rel=3e-3)


@pytest.mark.verify
@pytest.mark.parametrize(("height", "tip"), [(0.25, SPHERE), (10.0, PLATE)])
def test_flat_and_slender_ellipsoids_are_meshed_well_enough(
    height: float, tip: dict[str, Any]
) -> None:
    """The default mesh against one twice as fine by another contact method: 0.5 % of the force."""
    scene = scene_of(ellipsoid(height), indenter=tip, loading={"delta": 0.01 * height})
    row = list(states(scene, with_surface=False))[-1]
    fine = {"h_contact": scene.sizes.h_contact * scene.physics.scales.length / 2}
    right = last_row(
        ellipsoid(height),
        indenter=tip,
        loading={"delta": 0.01 * height},
        mesh=fine,
        contact={"method": "active_set"},
    )
    assert row.force == pytest.approx(right.force, rel=5e-3)
    assert row.a_base == pytest.approx(right.a_base, rel=0.02)
