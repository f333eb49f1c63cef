"""Paths that turn back: without friction or damage the force depends on the depth alone, and
nothing holds the tip.
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
    """In, deeper, back, first touch, away, and in again; every state converged and audited."""
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
    """A hundred times Newton's tolerance of 1e-10; the way there is forgotten."""
    for first, again in ((0, 2), (1, 5)):
        assert states[again].force == pytest.approx(states[first].force, rel=1e-8)
        assert states[again].energy == pytest.approx(states[first].energy, rel=1e-8)
        assert states[again].a == pytest.approx(states[first].a, rel=1e-8)


def test_out_of_contact_there_is_nothing(states: list[State]) -> None:
    """Clear of the body the pressure is max(lam - eps g, 0), zero exactly where lam is nothing but
    Newton's round-off, which only the multiplier itself, at the nodes, may show.
    """
    away = states[4]
    assert (away.force, away.a, away.penetration) == (0.0, 0.0, 0.0)
    assert away.p_max < 1e-25
    assert abs(away.energy) < 1e-20
    assert np.all(away.surface.pressure < 1e-25)
    assert np.all(away.surface.gap > 0)


def test_first_touch_has_no_force(states: list[State]) -> None:
    """At delta = 0 the apex meets the surface: zero but for round-off of the largest force met."""
    touch = states[3]
    assert abs(touch.force) <= 1e-14 * states[1].force
    assert touch.surface.gap.min() == pytest.approx(0.0, abs=1e-14)


def test_force_rises_with_depth(states: list[State]) -> None:
    """delta^1.5 in three dimensions (2.83 for twice the depth, more on a layer), nearly delta in
    plane strain.
    """
    assert 1.9 < states[1].force / states[0].force < 3.2


def test_a_path_that_never_touches() -> None:
    """Zeros, and a warning; no failure for want of a scale."""
    base = scene(CYLINDER, loading={"deltas": [-0.01, -0.001, -0.02]}, mesh={"h_contact": 0.05})
    assert any("never reaches" in warning for warning in base.plan.warnings)
    for state in solve(base):
        assert (state.force, state.energy, state.a, state.p_max) == (0.0, 0.0, 0.0, 0.0)


def test_depths_in_any_order_give_the_forces_of_the_sorted_path() -> None:
    """As above, on a path whose steps double, jump and repeat."""
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
    """Rollers below and free sides: frictionless contact pushes straight down, so the pins that
    stop the rigid motions feel no force wherever the tip stands. That they feel none is in every
    `solve`; here it is said.
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
    """A tip that pushes sideways off the middle of a body that may slide away: refused before any
    mesh is made.
    """
    center = [1.3] if body is STRIP else [1.3, 1.0]
    with pytest.raises(ConfigError, match="no support holds it there") as refusal:
        scene(
            body | ON_ROLLERS,
            indenter={"shape": "paraboloid", "R": 1.0, "center": center},
            contact={"method": "auto", "gap": "current"},
            mesh={"h_contact": 0.1},
        )
    assert refusal.value.key == "contact.gap"
    assert refusal.value.remedy


def test_held_by_symmetry_a_body_on_rollers_may_feel_the_current_gap() -> None:
    """In the middle the sideways pushes cancel, and the mid-planes are walls."""
    base = scene(
        STRIP | ON_ROLLERS, contact={"method": "auto", "gap": "current"}, mesh={"h_contact": 0.02}
    )
    assert not base.physics.domain.pins
    assert solve(base)[-1].force > 0
