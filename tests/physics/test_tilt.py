"""Tilted tips: closed forms in plane strain, boundary elements for cones, and symmetries.

The closed forms are for a half-plane and a half-space, and were derived from the integral equation
of a frictionless contact (Johnson 1985, 2.7 and 5.2). The forces of cones are those of a boundary
element method of its own (piecewise constant pressure on squares), whose error is below 0.3 %.
"""

from __future__ import annotations

from math import cos, pi, radians, sin, tan
from pathlib import Path
from typing import Any

import pytest
import tilted_cone_elements
from scenes import E_STAR, ELASTIC, scene, solve

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.run.pipeline import simulate

# A strip that is half as deep as wide: the contacts are 1/80 of its depth, so that contact and
# moment are those of a half-plane. The depth of a half-plane is not defined, that of a strip is.
STRIP = {"shape": "strip", "width": 44.0, "height": 22.0, "base": "fixed", "sides": "free"}
FREE_BOX = {"shape": "box", "size": [20.0, 20.0, 10.0], "base": "fixed", "sides": "free"}


@pytest.mark.parametrize("towards", [0, 180])
@pytest.mark.parametrize("tilt", [2.0, 4.0])
def test_a_tilted_wedge(tilt: float, towards: int) -> None:
    """Slopes s_1 and s_2 on both sides: the pressure ends at zero on both.

    The apex divides the contact as cos(angle) with angle = pi s_2/(s_1 + s_2).
    """
    tip = {"shape": "cone", "half_angle": 85.0, "tilt": tilt, "tilt_towards": towards}
    state = solve(
        scene(STRIP, indenter=tip, loading={"delta": 0.05, "steps": 1}, mesh={"h_contact": 0.01})
    )[-1]
    steep = 1 / tan(radians(85 - tilt))
    flat = 1 / tan(radians(85 + tilt))
    angle = pi * steep / (steep + flat)
    half_width = 2 * state.force / (E_STAR * (steep + flat) * sin(angle))
    middle = -half_width * cos(angle)
    assert state.a == pytest.approx(half_width, rel=0.01)
    assert state.moment == pytest.approx(state.force * middle / 2, rel=0.005)


@pytest.mark.parametrize("tilt", [0.05, 0.3, 1.0])
def test_a_tilted_punch_in_plane_strain(tilt: float) -> None:
    """In full contact M = pi/4 E* tan(tilt); lifted, the contact ends at zero pressure on one side.

    The half width of a lifted contact is L = 2 F/(pi E* tan(tilt)), and F acts L/2 inside the edge.
    """
    tip = {"shape": "flat_punch", "radius": 1.0, "tilt": tilt}
    state = solve(
        scene(STRIP, indenter=tip, loading={"force": 0.01, "steps": 1}, mesh={"h_contact": 0.05})
    )[-1]
    slope = tan(radians(tilt))
    half_width = min(2 * state.force / (pi * E_STAR * slope), 1.0)
    full_moment = pi / 4 * E_STAR * slope
    moment = full_moment if half_width == 1 else state.force * (1 - half_width / 2)
    # Measured: 5e-4 of the moment (6e-4 with the finite strip), 1e-3 of the width.
    assert state.moment == pytest.approx(moment, rel=2e-3)
    assert state.a == pytest.approx(half_width, rel=5e-3)


@pytest.mark.parametrize("towards", [0.0, 180.0])
@pytest.mark.parametrize("tilt", [0.05, 1.0])
def test_the_pressed_edge_of_a_tilted_punch_has_no_peak(tilt: float, towards: float) -> None:
    """A tilted punch touches with its sharp edge, where the pressure is infinite."""
    tip = {"shape": "flat_punch", "radius": 1.0, "tilt": tilt, "tilt_towards": towards}
    loading = {"force": 0.01, "steps": 1}
    state = solve(scene(STRIP, indenter=tip, loading=loading, mesh={"h_contact": 0.2}))[-1]
    assert state.a > 0
    assert state.p_max != state.p_max


@pytest.mark.parametrize("tilt", [2.0, 4.0])
def test_the_moment_is_within_its_error_estimate(tilt: float, tmp_path: Path) -> None:
    """The moment of a wedge against the closed form, at a force that the run has found."""
    tip = {"shape": "cone", "half_angle": 85.0, "tilt": tilt}
    sections = {"body": STRIP, "material": ELASTIC, "indenter": tip}
    config = config_from_mapping(sections | {"loading": {"delta": 0.01, "steps": 2}}, ())
    outcome = simulate(config, directory=tmp_path / "out", error_bars=True)
    steep = 1 / tan(radians(85 - tilt))
    flat = 1 / tan(radians(85 + tilt))
    angle = pi * steep / (steep + flat)
    for state in outcome.states:
        half_width = 2 * state.force / (E_STAR * (steep + flat) * sin(angle))
        moment = -half_width * cos(angle) * state.force / 2
        assert abs(state.moment - moment) <= state.moment_error + 1e-4 * moment
        assert state.moment_error <= 0.1 * moment
        assert state.x_contact_error == pytest.approx(
            state.x_contact * state.moment_error / state.moment
        )


@pytest.mark.verify
def test_a_tilted_punch_in_three_dimensions() -> None:
    """On a half-space P = 2 E* a d and M = 4/3 E* a^3 tan(tilt), with the depth d of the middle.

    The box adds 4.6 % to the force at this size; the edge of the punch takes 1.6 % of the force and
    three times as much of the moment, which grows as a^3.
    """
    tilt = 0.1
    tip = {"shape": "flat_punch", "radius": 1.0, "tilt": tilt}
    upright, tilted = (
        solve(scene(FREE_BOX, indenter=tip | {"tilt": angle}, loading=loading))[-1]
        for angle, loading in (
            (0.0, {"delta": 0.01, "steps": 1}),
            (tilt, {"delta": 0.01 + sin(radians(tilt)), "steps": 1}),
        )
    )
    moment = 4 / 3 * E_STAR * tan(radians(tilt))
    assert tilted.force == pytest.approx(upright.force, rel=0.01)
    assert tilted.moment == pytest.approx(moment, rel=0.08)


def cone_force(tilt: float, per_radius: float = 5.0) -> State:
    """Return the state under a cone of 70 degrees in a box of 20 x 20 x 10 at the depth 0.2."""
    tip = {"shape": "cone", "half_angle": 70.0, "tilt": tilt}
    size = 2 / pi * 0.2 * tan(radians(70)) / per_radius
    return solve(
        scene(
            FREE_BOX,
            indenter=tip,
            loading={"delta": 0.2, "steps": 1},
            mesh={"h_contact": size, "symmetry": "half"},
        )
    )[-1]


def test_elements_give_the_force_of_an_upright_cone() -> None:
    """The reference of the next test gives F = 2/pi E* tan(half_angle) delta^2, to 4e-6."""
    upright = tilted_cone_elements.cone_force(70.0, 0.0, 256)
    assert upright == pytest.approx(2 / pi * tan(radians(70)), rel=2e-5)


@pytest.mark.verify
@pytest.mark.parametrize("tilt", [5.0, 10.0, 15.0])
def test_a_tilted_cone(tilt: float) -> None:
    """The force over that of an upright cone is that of boundary elements on a half-space.

    The box adds up to 4 % more to the wider contact of the largest tilt than to the upright one.
    """
    upright = cone_force(0.0)
    tilted = cone_force(tilt)
    box = {5.0: 0.01, 10.0: 0.02, 15.0: 0.05}[tilt]
    ratio = tilted_cone_elements.force_ratio(70.0, tilt)
    assert tilted.force / upright.force == pytest.approx(ratio, rel=box)
    assert tilted.x_contact > 0
    assert tilted.side_force_x is None


def test_a_tilted_sphere_is_a_sphere() -> None:
    """A tilt turns a sphere into itself: the scene stays axisymmetric."""
    body = {"shape": "cylinder", "radius": 3.0, "height": 2.0}
    upright, tilted = (
        scene(body, indenter={"shape": "sphere", "R": 1.0} | tilt) for tilt in ({}, {"tilt": 20.0})
    )
    assert tilted.physics == upright.physics
    assert solve(tilted)[-1].force == solve(upright)[-1].force


@pytest.mark.parametrize(
    "tip",
    [
        {"shape": "cone", "half_angle": 70.0, "tip_radius": 0.05},
        {"shape": "flat_punch", "radius": 0.3, "edge_radius": 0.1},
        {"shape": "paraboloid", "R": 1.0},
    ],
)
def test_tilts_to_both_sides_are_mirror_images(tip: dict[str, Any]) -> None:
    """At finite strain force and moment of opposite tilts agree, and the side force balances.

    The meshes of the two sides are not mirror images, which changes the force by 1e-4. Moving the
    tip sideways does not change the energy of a body that is the same everywhere, so that the side
    force is as small as the effect of its walls; it equals the reactions to their tolerance.
    """
    here, there = (
        solve(
            scene(
                {"shape": "strip", "width": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"},
                material={"model": "neo_hookean", "E": 1.0, "nu": 0.3},
                indenter=tip | {"tilt": 12.0, "tilt_towards": towards},
                loading={"delta": 0.06, "steps": 1},
                mesh={"h_contact": 0.04},
            )
        )[-1]
        for towards in (0, 180)
    )
    assert here.force == pytest.approx(there.force, rel=1e-3)
    assert here.moment == pytest.approx(there.moment, rel=5e-3)
    assert abs(here.side_force_x) <= 1e-3 * here.force
    reactions = sum(value for name, value in here.reactions.items() if name.endswith("_x"))
    assert reactions == pytest.approx(here.side_force_x, abs=1e-7 * here.force)


def test_a_tilted_tip_near_a_wall_is_pushed_aside() -> None:
    """Beside a fixed wall the side force is not zero, and equals the reactions of the supports."""
    state = solve(
        scene(
            {"shape": "strip", "width": 2.0, "height": 1.0, "base": "fixed", "sides": "fixed"},
            material={"model": "neo_hookean", "E": 1.0, "nu": 0.3},
            indenter={"shape": "paraboloid", "R": 1.0, "tilt": 12.0, "center": [0.5]},
            loading={"delta": 0.05, "steps": 1},
            mesh={"h_contact": 0.05},
        )
    )[-1]
    reactions = sum(value for name, value in state.reactions.items() if name.endswith("_x"))
    assert reactions == pytest.approx(state.side_force_x, abs=1e-7 * state.force)
    assert abs(state.side_force_x) > 1e-3 * state.force


@pytest.mark.parametrize("gap", ["reference", "current"])
def test_a_tilted_tip_slides(gap: str) -> None:
    """Without friction a slide along a wide body changes nothing: force, moment and side force.

    The moment is about the place of the tip. The mesh changes the force by 1e-3, the walls, which
    the tip approaches by 0.25 of 22, by as much.
    """
    states = solve(
        scene(
            STRIP,
            indenter={"shape": "cone", "half_angle": 85.0, "tilt": 4.0},
            loading={"delta": 0.2, "steps": 1, "slide": {"to": [0.25], "steps": 1}},
            contact={"gap": gap},
            mesh={"h_contact": 0.2},
        )
    )
    before, after = states
    assert after.force == pytest.approx(before.force, rel=5e-3)
    assert after.moment == pytest.approx(before.moment, rel=1e-2)
    assert abs(after.side_force_x) <= 5e-3 * after.force


def test_condensed_and_whole_body_agree() -> None:
    """Force and moment do not depend on the way the scene is solved, a tolerance of 1e-8."""
    tip = {"shape": "cone", "half_angle": 80.0, "tilt": 5.0, "tilt_towards": 180.0}
    condensed, whole = (
        solve(scene(STRIP, indenter=tip, loading={"delta": 0.2, "steps": 1}, solver=settings))[-1]
        for settings in ({"method": "condensed"}, {"method": "newton"})
    )
    assert condensed.force == pytest.approx(whole.force, rel=1e-8)
    assert condensed.moment == pytest.approx(whole.moment, rel=1e-7)


def test_a_current_gap_at_small_slope_is_the_reference_gap() -> None:
    """A wedge of 89 degrees: both gaps agree to the order of the slope, and so do the moments."""
    tip = {"shape": "cone", "half_angle": 89.0, "tilt": 0.4}
    reference, current = (
        solve(
            scene(
                STRIP,
                indenter=tip,
                loading={"delta": 0.02, "steps": 1},
                contact={"gap": gap},
                mesh={"h_contact": 0.1},
            )
        )[-1]
        for gap in ("reference", "current")
    )
    assert current.force == pytest.approx(reference.force, rel=0.02)
    assert current.moment == pytest.approx(reference.moment, rel=0.04)
    # The pressure pushes the tip back from where it leans.
    assert current.side_force_x is not None and reference.side_force_x is None


def test_half_of_a_tilted_scene_is_modelled() -> None:
    """The plane of the tilt is a mirror plane of tip and body, whichever axis it contains."""
    for towards, plane in ((0.0, "y"), (90.0, "x"), (180.0, "y")):
        tip = {"shape": "cone", "half_angle": 70.0, "tilt": 10.0, "tilt_towards": towards}
        for body in (FREE_BOX, {"shape": "cylinder", "radius": 10.0, "height": 10.0}):
            domain = scene(body, indenter=tip).physics.domain
            assert (domain.symmetry, domain.mirror_axes) == ("half", (plane,))
    oblique = {"shape": "cone", "half_angle": 70.0, "tilt": 10.0, "tilt_towards": 30.0}
    assert scene(FREE_BOX, indenter=oblique).physics.domain.symmetry == "full"


def test_the_fine_patch_follows_the_contact() -> None:
    """Middle and reach of the contact that the mesh expects are those of the solution."""
    tip = {"shape": "cone", "half_angle": 70.0, "tilt": 10.0}
    body = FREE_BOX | {"size": [8.0, 8.0, 4.0]}
    base = scene(body, indenter=tip, loading={"delta": 0.3, "steps": 1})
    state = solve(base)[-1]
    surface = state.surface
    assert surface is not None
    x = surface.x[surface.pressure > 0] - 4.0
    middle = float(x.max() + x.min()) / 2
    reach = float(x.max() - x.min()) / 2
    h = base.sizes.h_contact * base.physics.scales.length
    expected = (base.sizes.axis[0] * base.physics.scales.length) - 4.0
    assert middle == pytest.approx(expected, abs=h)
    assert reach == pytest.approx(base.sizes.elongation * state.a, abs=1.5 * h)
