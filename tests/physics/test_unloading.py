"""Paths that turn back: without friction or damage the force depends on the depth alone.

Nothing holds a tip that has left.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, STRIP, assert_audited, meshed, scene, solve

from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError

PATH = [0.005, 0.01, 0.005, 0.0, -0.01, 0.01]
BODIES = {"axisymmetric": (CYLINDER, 0.02), "plane_strain": (STRIP, 0.02), "box": (BOX, 0.15)}
CASES = [(shape, gap, "auto") for shape in BODIES for gap in ("reference", "current")] + [
    ("axisymmetric", "reference", "penalty"),
    ("axisymmetric", "current", "penalty"),
    ("box", "reference", "penalty"),
]


@pytest.fixture(params=CASES, ids="-".join, scope="module")
def states(request: pytest.FixtureRequest) -> list[State]:
    """States of a path in, deeper, back, to first touch, away, and in again."""
    shape, gap, method = request.param
    body, h = BODIES[shape]
    return solve(
        scene(
            body,
            loading={"deltas": PATH},
            contact={"method": method, "gap": gap},
            mesh={"h_contact": h},
        )
    )


def test_same_force_at_the_same_depth(states: list[State]) -> None:
    """Equal depths have equal force, energy and contact radius to 1e-8, whatever came before.

    That is a hundred times Newton's tolerance of 1e-10.
    """
    for first, again in ((0, 2), (1, 5)):
        assert states[again].force == pytest.approx(states[first].force, rel=1e-8)
        assert states[again].energy == pytest.approx(states[first].energy, rel=1e-8)
        assert states[again].a == pytest.approx(states[first].a, rel=1e-8)


def test_out_of_contact_there_is_nothing(states: list[State]) -> None:
    """Out of contact force, radius and energy are zero and all gaps are positive.

    The pressure max(lam - eps g, 0) is exactly zero where lam is Newton's round-off, which only the
    multiplier itself, at the nodes, may show.
    """
    away = states[4]
    assert (away.force, away.a, away.penetration) == (0.0, 0.0, 0.0)
    assert away.p_max < 1e-25
    assert abs(away.energy) < 1e-20
    assert np.all(away.surface.pressure < 1e-25)
    assert np.all(away.surface.gap > 0)


def test_first_touch_has_no_force(states: list[State]) -> None:
    """At depth 0 the apex meets the surface without a force, up to round-off of the largest one."""
    touch = states[3]
    assert abs(touch.force) <= 1e-14 * states[1].force
    assert touch.surface.gap.min() == pytest.approx(0.0, abs=1e-14)


def test_force_rises_with_depth(states: list[State]) -> None:
    """Twice the depth has 1.9 to 3.2 times the force.

    The force goes as delta^1.5 in three dimensions (2.83, more on a layer) and nearly as delta in
    plane strain.
    """
    assert 1.9 < states[1].force / states[0].force < 3.2


def test_a_path_that_never_touches() -> None:
    """A path that never touches has rows of zeros and a warning.

    There is no force that could give a scale.
    """
    base = scene(CYLINDER, loading={"deltas": [-0.01, -0.001, -0.02]}, mesh={"h_contact": 0.05})
    assert any("never reaches" in warning for warning in base.plan.warnings)
    for state in solve(base):
        assert (state.force, state.energy, state.a, state.p_max) == (0.0, 0.0, 0.0, 0.0)


def test_depths_in_any_order_give_the_forces_of_the_sorted_path() -> None:
    """A path whose steps double, jump and repeat has the forces of the sorted path."""
    depths = [0.004, 0.01, 0.001, 0.008, 0.008, 0.002]
    mixed, ordered = (
        {
            state.delta: state.force
            for state in solve(scene(CYLINDER, loading={"deltas": path}, mesh={"h_contact": 0.02}))
        }
        for path in (depths, sorted(set(depths)))
    )
    assert mixed == pytest.approx(ordered, rel=1e-8)


# ---- how the body is held

ON_ROLLERS = {"base": "roller", "sides": "free"}


@pytest.mark.parametrize("place", [0.5, 0.3], ids=["middle", "off_center"])
@pytest.mark.parametrize(("body", "h"), [(STRIP, 0.02), (BOX, 0.2)], ids=["plane_strain", "box"])
def test_pins_carry_nothing(body: dict[str, Any], h: float, place: float) -> None:
    """Pins that stop rigid motions of a body on rollers feel no force, wherever the tip stands.

    Frictionless contact on a body with rollers below and free sides pushes straight down. Every pin
    is at a vertex, as one without would feel nothing either.
    """
    width = body.get("width", 2.0)
    center = [place * width] if body is STRIP else [place * width, 1.0]
    base = scene(
        body | ON_ROLLERS,
        indenter={"shape": "paraboloid", "R": 1.0, "center": center},
        mesh={"h_contact": h, "symmetry": "full"},
    )
    assert len(base.physics.domain.pins) == (1 if body is STRIP else 3)
    body_mesh = meshed(base)  # a pin that found no vertex would feel nothing either
    assert all(len(body_mesh.vertices_at(point)) == 1 for point, _ in base.physics.domain.pins)
    (state,) = solve(base)
    assert_audited(state, state.force)
    assert state.stray_reaction <= 1e-10 * state.force


@pytest.mark.parametrize("body", [STRIP, BOX], ids=["plane_strain", "box"])
def test_no_equilibrium_no_scene(body: dict[str, Any]) -> None:
    """A tip that pushes aside a body which may slide away is refused before any mesh is made.

    The tip is off the middle and has the current gap.
    """
    center = [1.3] if body is STRIP else [1.3, 1.0]
    with pytest.raises(ConfigError, match="no support prevents sliding") as refusal:
        scene(
            body | ON_ROLLERS,
            indenter={"shape": "paraboloid", "R": 1.0, "center": center},
            contact={"method": "auto", "gap": "current"},
            mesh={"h_contact": 0.1},
        )
    assert refusal.value.key == "contact.gap"
    assert refusal.value.remedy


def test_held_by_symmetry_a_body_on_rollers_may_feel_the_current_gap() -> None:
    """A tip in the middle of a body on rollers may have the current gap.

    The sideways pushes cancel there, and the mid-planes are walls.
    """
    base = scene(
        STRIP | ON_ROLLERS, contact={"method": "auto", "gap": "current"}, mesh={"h_contact": 0.02}
    )
    assert not base.physics.domain.pins
    assert solve(base)[-1].force > 0
