"""A tip that slides sideways after it has been pressed in.

The plane strain scenes have nu = 0.5, at which normal and tangential tractions on a half-space are
uncoupled, and a strip that is 22 contact half-widths high.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import frictional_half_space
import numpy as np
import pytest
import relaxing_half_plane
from mpi4py import MPI
from scenes import scene, solve

from indent_sim.config.scene_file import load
from indent_sim.fe.path.load_stepping import LoadStepper
from indent_sim.fe.solver import create_load_stepper, distribute
from indent_sim.model.history import History
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.sanity_checks import violated_bound
from indent_sim.run.work_and_loops import energy_balance, slide_work
from indent_sim.scene.scene import Scene
from indent_sim.studies.study_file import read as read_study

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
A = 0.018  # contact half-width over the radius of the tip
MU = 0.4
DEEP = {"shape": "strip", "width": 44 * A, "height": 22 * A, "base": "fixed", "sides": "free"}
SHALLOW = DEEP | {"width": 12 * A, "height": 6 * A}
COARSE = {"body": SHALLOW, "mesh": {"h_contact": A / 4}, "loading": {"delta": 5e-4, "steps": 2}}
RUBBER = {"model": "linear_elastic", "E": 1.0, "nu": 0.5}
NEO_HOOKEAN = {"model": "neo_hookean", "E": 1.0, "nu": 0.45}
FRICTION = {"friction": MU}
DEPTH = 5.6e-4
SLIP = 6e-4  # a slide of about 1.3 times that to full slip


def slide_scene(
    to: list[float],
    steps: int,
    *overrides: str,
    loading: dict[str, Any] | None = None,
    **sections: Any,
) -> Scene:
    """A parabolic roller on a strip of nu = 0.5 that is pressed in and slides."""
    pressed = loading or {"delta": DEPTH, "steps": 3}
    given = {"material": RUBBER, "contact": FRICTION, "mesh": {"h_contact": A / 12}} | sections
    body: Any = given.pop("body", DEEP)
    sliding = pressed | {"slide": {"to": to, "steps": steps}}
    return scene(body, *overrides, loading=sliding, **given)


@cache
def loop_rows() -> tuple[Scene, list[State]]:
    """Rows of a friction loop: a first stretch, back and forth again."""
    base = slide_scene([SLIP, -SLIP, SLIP], 12)
    return base, solve(base)


def slide_of(state: State) -> float:
    assert state.x is not None
    return state.x


def test_partial_slip_is_that_of_cattaneo_and_mindlin() -> None:
    """The stick zone of the first stretch has c/a = (1 - Q/(mu P))^(1/2) (Cattaneo, Mindlin).

    Elements are a/12: the stick zone's end is known to a fraction of one, 0.02 of a.
    """
    _, states = loop_rows()
    checked = 0
    for row in states[3:15]:
        ratio = abs(row.side_force_x or 0.0) / (MU * row.force)
        if ratio > 0.95:
            continue
        assert (row.stick_radius or 0.0) / row.a == pytest.approx((1 - ratio) ** 0.5, abs=0.02)
        checked += 1
    assert checked >= 5


def test_the_exact_side_force_of_the_scoreboard_is_that_of_boundary_elements() -> None:
    """With 24 cells across the contact it is 8e-4 too large, with 32 and 44 5e-4 and 3e-4.

    The published value is Mindlin's, whose traction has no component across the slide.
    """
    path = CONFIGS / "studies" / "verification" / "published.yaml"
    cases = read_study(path).named_cases
    case = next(one for one in cases if one.name == "Cattaneo-Mindlin, side force")
    assert case.exact and case.exact.value and case.published
    P, slide = 1.777777778e-3, 0.004
    a = (0.75 * P * 0.75) ** (1 / 3)
    full_slip = 3 * MU * P * 1.5 / (16 / 3 * a)
    mindlin = -MU * P * (1 - (1 - slide / full_slip) ** 1.5)
    assert case.published.value == pytest.approx(mindlin, rel=1e-9)
    exact = -frictional_half_space.side_force(P, MU, slide, cells=24)
    assert case.exact.value == pytest.approx(exact, rel=1.2e-3)
    assert case.exact.value == pytest.approx(mindlin, rel=3e-3)


def test_in_full_slip_the_side_force_is_friction_times_the_force() -> None:
    """Against the motion, at both ends of the loop; the slope of the tip adds 1e-5."""
    _, states = loop_rows()
    for row, sign in ((states[14], -1), (states[26], 1), (states[38], -1)):
        assert row.stick_radius == 0.0
        assert row.side_force_x == pytest.approx(sign * MU * row.force, rel=1e-4)


def test_the_dissipation_is_the_area_of_the_loop() -> None:
    """The loop's area, by trapezoids, is the dissipated energy; its corners cost 1 %."""
    _, states = loop_rows()
    loop = states[14:]
    area = slide_work(loop, "side_force_x")
    dissipated = sum(row.dissipation or 0.0 for row in loop[1:])
    assert slide_of(loop[0]) == slide_of(loop[-1])
    assert loop[-1].energy == pytest.approx(loop[0].energy, rel=1e-3)
    assert area == pytest.approx(dissipated, rel=0.01)


def test_the_way_back_is_the_first_stretch_doubled() -> None:
    """Masing's rule: from a turning point Q_0 on, Q(x) = Q_0 - 2 Q_first((x_0 - x)/2).

    The first stretch is interpolated between its rows, whose curvature is 1 % of mu P.
    """
    _, states = loop_rows()
    first = states[2:15]
    back = states[14:27]
    x = [slide_of(row) for row in first]
    Q = [row.side_force_x or 0.0 for row in first]
    for row in back:
        expected = Q[-1] - 2 * np.interp((x[-1] - slide_of(row)) / 2, x, Q)
        assert row.side_force_x == pytest.approx(expected, abs=0.01 * MU * row.force)


def test_rows_of_a_loop_are_within_their_bounds() -> None:
    """All rows pass the sanity checks and the balance of horizontal forces."""
    base, states = loop_rows()
    rows = PreviousRows()
    for row in states:
        assert violated_bound(base, row, rows) is None
        assert row.lateral_imbalance <= 1e-9 * row.force
        rows.append(row)
    doubled = replace(states[14], side_force_x=2 * MU * states[14].force)
    assert "side force" in (violated_bound(base, doubled, PreviousRows(states[:14])) or "")


def test_slides_to_both_sides_are_mirror_images() -> None:
    """Forces of slides along x and -x are equal and opposite, to 0.3 % on an unsymmetric mesh."""
    (right, left) = (solve(slide_scene([side * 2e-4], 2)) for side in (1, -1))
    for one, other in zip(right[3:], left[3:], strict=True):
        assert one.force == pytest.approx(other.force, rel=1e-3)
        assert one.side_force_x == pytest.approx(-(other.side_force_x or 0.0), rel=3e-3)


def test_a_held_force_slides_as_a_held_depth() -> None:
    """With the force of a held depth prescribed, side force and depth are those of that depth.

    At nu = 0.5 the force at held depth changes by 1e-4 as the tip slides.
    """
    by_depth = solve(slide_scene([2e-4], 2))
    force = by_depth[2].force
    by_force = solve(slide_scene([2e-4], 2, loading={"force": force, "steps": 3}))
    for deep, pressed in zip(by_depth[3:], by_force[3:], strict=True):
        assert pressed.force == pytest.approx(force, rel=1e-9)
        assert pressed.delta == pytest.approx(DEPTH, rel=1e-3)
        assert pressed.side_force_x == pytest.approx(deep.side_force_x, rel=2e-3)


def test_the_whole_body_slides_as_the_condensed_one() -> None:
    """Both solvers have the same equations; their tolerances are 1e-7."""
    condensed, whole = (
        solve(slide_scene([1e-4], 2, f"solver.method={method}", **COARSE))
        for method in ("condensed", "newton")
    )
    for one, other in zip(condensed, whole, strict=True):
        for name in ("force", "side_force_x", "energy"):
            scale = one.force if "force" in name else one.energy
            assert getattr(other, name) == pytest.approx(getattr(one, name), abs=1e-6 * scale)
        assert other.dissipation == pytest.approx(one.dissipation, abs=1e-4 * MU * one.force * 1e-4)


def test_without_friction_only_the_slope_of_the_tip_pushes() -> None:
    """On a homogeneous strip nothing changes, but by the distance of the tip from the sides."""
    states = solve(slide_scene([2e-3], 2, contact={}))
    for row in states[3:]:
        assert row.dissipation is None
        assert row.force == pytest.approx(states[2].force, rel=2e-3)
        assert abs(row.side_force_x or 0.0) <= 1e-3 * row.force


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_friction_moves_the_contact_to_the_rear(nu: float) -> None:
    """In full slip on a half-plane x_contact = -8/3 lambda a with tan(pi lambda) = mu beta.

    beta = (1 - 2 nu)/(2 (1 - nu)). A tangential traction lowers the surface ahead of it, so that
    the pressure is (b + x)^(1/2 - lambda) (b - x)^(1/2 + lambda) (Johnson 1985, 8.2), with the axis
    of the tip at 2 lambda a. The strip is 22 a deep, which changes this by 2.3 %.
    """
    material = {"model": "linear_elastic", "E": 1.0, "nu": nu}
    states = solve(slide_scene([8e-4, -8e-4], 4, material=material))
    shift = 8 / 3 * np.arctan(MU * (1 - 2 * nu) / (2 * (1 - nu))) / np.pi
    for row, side in ((states[6], 1), (states[10], -1)):
        assert row.stick_radius == 0.0
        assert row.x_contact == pytest.approx(-side * shift * row.a, rel=0.03)
        assert row.moment == pytest.approx((row.x_contact or 0.0) * row.force)
        # The pressure on the slope x/R of the tip is a part of the side force.
        side_force = -side * MU * row.force - (row.moment or 0.0)
        assert row.side_force_x == pytest.approx(side_force, rel=1e-5)


@pytest.mark.parametrize("solver", ["condensed", "newton"])
def test_the_active_set_method_slides(solver: str) -> None:
    """Nodal pressures give the rows of the augmented Lagrangian, to the elements of a/4: 1e-3.

    The side force without friction is minus the moment over R, the slope of a paraboloid.
    """
    sections = COARSE | {"contact": {}}
    auto = solve(slide_scene([2e-3, 1e-3], 1, **sections))
    options = ("contact.method=active_set", f"solver.method={solver}")
    for row, other in zip(
        solve(slide_scene([2e-3, 1e-3], 1, *options, **sections)), auto, strict=True
    ):
        assert row.force == pytest.approx(other.force, rel=2e-3)
        assert row.energy == pytest.approx(other.energy, rel=2e-3)
        assert row.side_force_x == pytest.approx(-(row.moment or 0.0), abs=1e-9 * row.force)


@cache
def finite_strain_rows() -> list[State]:
    """A cylinder pressed into a neo-Hookean strip that slides; gap at the deformed point."""
    body = {"shape": "strip", "width": 4.0, "height": 1.0, "base": "fixed", "sides": "free"}
    sliding = {"delta": 0.1, "steps": 4, "slide": {"to": [0.12], "steps": 8}}
    return solve(
        scene(
            body,
            indenter={"shape": "sphere", "R": 1.0},
            material=NEO_HOOKEAN,
            contact={"friction": 0.3},
            loading=sliding,
            mesh={"h_contact": 0.06},
        )
    )


def test_energy_balances_at_finite_strain() -> None:
    """Over the slide, energy plus dissipation is the work of the tip, by trapezoids.

    Rows are 0.015 apart, and the force turns within three of them: 1 %.
    """
    states = finite_strain_rows()[3:]
    heat = sum(row.dissipation or 0.0 for row in states[1:])
    work = slide_work(states, "side_force_x")
    assert work > 0 and heat > 0
    assert states[-1].energy - states[0].energy + heat == pytest.approx(work, rel=0.01)
    assert max(row.lateral_imbalance for row in states) <= 1e-6 * states[0].force


def test_the_whole_path_balances() -> None:
    """The energy balance of a run counts the work of the side force; 12 rows: 1 %."""
    assert energy_balance(finite_strain_rows()[3:], "side_force_x") is not None
    _, states = loop_rows()
    assert abs(energy_balance(states[2:], "side_force_x") or 1.0) < 1.0


@pytest.mark.parametrize("method", ["condensed", "newton"])
def test_a_slide_is_resumed_where_it_stopped(method: str) -> None:
    """A path stopped within its slide goes on to the same side force.

    The whole body goes on from packed states, the condensed one solves the rows again.
    """
    base = slide_scene([1.5e-4], 3, f"solver.method={method}", **COARSE)
    path = base.physics.path
    mesh = distribute(base.grid(), base.physics.domain, MPI.COMM_WORLD)

    def stepper() -> LoadStepper:
        return create_load_stepper(base, mesh)

    whole = list(stepper().states(path, lambda step: False))
    stopped = stepper()
    rows = stopped.states(path, lambda step: False)
    for _ in range(3):
        next(rows)
    kept = stopped.points
    assert bool(kept) == (method == "newton")
    passed = [(path.values[k], 0.0, path.slide(k + 1)) for k in range(0 if not kept else 3, 3)]
    goes_on = stepper()
    assert goes_on.resume(kept, passed)
    rest = list(goes_on.states(path, lambda step: False, done=3))
    assert len(rest) == 2
    for row, again in zip(whole[3:], rest, strict=True):
        assert again.x == row.x
        assert again.side_force_x == pytest.approx(row.side_force_x, rel=1e-6)


def test_halved_increments_pass_through_the_same_places() -> None:
    """Halved increments keep every row, and add the places in between."""
    path = LoadPath("depth", (1.0, 1.0, 1.0), slides=(0.0, 0.4, -0.4))
    fine = path.with_halved_increments()
    assert fine.slides == (0.0, 0.0, 0.2, 0.4, 0.0, -0.4)
    assert fine.values == (0.5, 1.0, 1.0, 1.0, 1.0, 1.0)
    assert path.retained_rows == {1, 2, 3}
    assert path.first_rows(2).slides == (0.0, 0.4)


@pytest.mark.verify
def test_partial_slip_on_a_half_model() -> None:
    """In three dimensions c/a = (1 - Q/(mu P))^(1/3), and in full slip Q = mu P.

    Half of a box of 20 a, with elements of a/4: c/a to 0.02, full slip to 0.5 %, because the
    traction has a component across the slide.
    """
    a = 0.05
    box = {"shape": "box", "size": [20 * a, 20 * a, 10 * a], "base": "fixed", "sides": "free"}
    base = scene(
        box,
        material={"model": "linear_elastic", "E": 1.0, "nu": 0.499},
        contact=FRICTION,
        loading={"delta": a**2, "steps": 2, "slide": {"to": [2.2e-3], "steps": 11}},
        mesh={"h_contact": a / 4},
    )
    assert base.physics.domain.symmetry == "half" and base.physics.domain.mirror_axes == ("y",)
    states = solve(base)
    for row in states[2:]:
        ratio = abs(row.side_force_x or 0.0) / (MU * row.force)
        expected = max(1 - ratio, 0.0) ** (1 / 3) if ratio < 0.97 else 0.0
        if 0.1 < ratio < 0.9:
            assert (row.stick_radius or 0.0) / row.a == pytest.approx(expected, abs=0.02)
    assert abs(states[-1].side_force_x or 0.0) == pytest.approx(MU * states[-1].force, rel=5e-3)


def test_error_bars_hold_what_smaller_elements_find(tmp_path: Path) -> None:
    """Bars of a loop hold the side force and the dissipation on elements 2.5 times smaller.

    The row in which the contact begins to slip as a whole has the largest error: the work of the
    side force is stored until then.
    """
    rows = []
    for name, h in (("run", 0.0145), ("fine", 0.0058)):
        config = load(
            CONFIGS / "friction_loop.yaml",
            (
                f"mesh.h_contact={h}",
                "loading={delta: 0.003, steps: 3, slide: {to: [0.006, -0.006], steps: 8}}",
                "output={fields: none, plot: false}",
            ),
        )
        simulate(config, directory=tmp_path / name, error_bars=name == "run")
        rows.append(read(tmp_path / name))
    run, fine = rows
    for name in ("force", "side_force_x", "dissipation", "moment", "x_contact"):
        difference = np.abs(run[name] - fine[name])
        assert (difference <= run[f"{name}_error"] + 1e-12).all(), name
    assert (run["side_force_x_error"][3:] < 0.03 * MU * run["force"][3:]).all()
    assert run["dissipation_error"][3:].sum() < 0.1 * run["dissipation"][3:].sum()


RELAXING = RUBBER | {"relaxation": {"prony": [[0.5, 1.0]], "of": "shear"}}


def rolling_scene(speed: float, end: float, **sections: Any) -> Scene:
    """A roller that is pressed in within 1 and then moves to x = end over a relaxing strip."""
    duration = end / speed
    loading = {
        "history": [[0, 0], [1, 7e-4], [1.1 + duration, 7e-4]],
        "slide_history": [[1.1, 0], [1.1 + duration, end]],
        "per_doubling": 2,
    }
    wide = DEEP | {"width": 2.0, "height": 1.0}
    given: dict[str, Any] = {"body": wide, "material": RELAXING, "contact": {}}
    given["mesh"] = {"h_contact": A / 6}
    return scene(loading=loading, **given | sections)


@pytest.mark.parametrize(
    ("speed", "width"),
    [
        (0.02, 2.0),
        pytest.param(0.005, 2.0, marks=pytest.mark.verify),
        pytest.param(0.06, 6.0, marks=pytest.mark.verify),
    ],
)
def test_hysteresis_is_rolling_friction(speed: float, width: float) -> None:
    """The side force on a relaxing half-plane is that of Hunter (1961), by a quadrature.

    The roller has moved for 5 times the retardation time or more. Measured at 0.02: 1.8 % with
    these time steps, of a/4, and 0.9 % with half of them, on a strip 70 a deep. Elements of half
    the size change it by 0.2 %. At 0.06 the roller goes so far that the side walls of the narrow
    strip make the side force 8 % smaller; on the wide one it is 1.5 % smaller.
    """
    body = DEEP | {"width": width, "height": 1.0}
    (*_, row) = solve(rolling_scene(speed, max(0.12, 10 * speed), body=body))
    exact = relaxing_half_plane.steady_rolling(row.force, 1.0, 4 / 3, 0.5, speed)
    assert row.side_force_x == pytest.approx(-exact.x_contact * row.force, rel=0.03)
    assert row.x_contact == pytest.approx(exact.x_contact, rel=0.03)
    assert row.a == pytest.approx(exact.a, rel=0.02)
    assert row.lateral_imbalance <= 1e-9 * row.force


def test_friction_and_hysteresis_add() -> None:
    """At nu = 0.5 friction leaves the pressure alone, so that both parts of the side force add.

    The strip, 70 a deep, couples them a little.
    """
    sections = {"mesh": {"h_contact": A / 4}}
    (*_, smooth), (*_, rough) = (
        solve(rolling_scene(0.05, 0.06, contact=contact, **sections))
        for contact in ({}, {"friction": 0.3})
    )
    assert rough.force == pytest.approx(smooth.force, rel=0.01)
    hysteresis = (smooth.side_force_x or 0.0) / smooth.force
    assert (rough.side_force_x or 0.0) / rough.force + 0.3 == pytest.approx(hysteresis, rel=0.1)
    assert hysteresis < -2e-3


def test_a_held_force_rolls_as_a_held_depth() -> None:
    """Under the force of a held depth at its end, the ratio of side force to force is the same.

    The force before is larger at a held depth, which the body has not forgotten completely: 3 %.
    """
    sections = {"body": SHALLOW | {"width": 20 * A}, "mesh": {"h_contact": A / 4}}
    (*_, deep) = solve(rolling_scene(0.05, 0.06, **sections))
    loading = {
        "force_history": [[0, 0], [1, deep.force], [2.3, deep.force]],
        "slide_history": [[1.1, 0], [2.3, 0.06]],
        "per_doubling": 2,
        "times": [1.0, 2.3],
    }
    given = {"body": sections["body"], "mesh": sections["mesh"], "material": RELAXING}
    (*_, pressed) = solve(scene(loading=loading, contact={}, **given))
    assert pressed.force == pytest.approx(deep.force, rel=1e-6)
    assert pressed.x == pytest.approx(0.06)
    ratio = (deep.side_force_x or 0.0) / deep.force
    assert (pressed.side_force_x or 0.0) / pressed.force == pytest.approx(ratio, rel=0.05)


def test_a_draining_body_pushes_the_tip_back_at_one_speed() -> None:
    """The side force vanishes on a body that drains at once or not at all, and is < 0 between."""
    sections = {"body": SHALLOW | {"width": 20 * A}, "mesh": {"h_contact": A / 4}}
    ratios = []
    for permeability in (1e-7, 1e-3, 1.0):
        law = {
            "model": "linear_elastic",
            "E": 1.0,
            "nu": 0.2,
            "flow": {"permeability": permeability},
        }
        (*_, row) = solve(rolling_scene(0.05, 0.06, material=law, **sections))
        ratios.append((row.side_force_x or 0.0) / row.force)
    undrained, between, drained = ratios
    assert between < -1e-3
    assert max(abs(undrained), abs(drained)) < 0.3 * abs(between)


def test_a_slide_in_time_is_resumed() -> None:
    """A path stopped within its slide goes on from packed states with the same rows."""
    sections = {"body": SHALLOW | {"width": 20 * A}, "mesh": {"h_contact": A / 3}}
    base = rolling_scene(0.05, 0.03, **sections)
    path = base.physics.path
    mesh = distribute(base.grid(), base.physics.domain, MPI.COMM_WORLD)
    whole = list(create_load_stepper(base, mesh).states(path, lambda step: False))
    stopped = create_load_stepper(base, mesh)
    rows = stopped.states(path, lambda step: False)
    done = next(k for k, row in enumerate(whole, start=1) if slide_of(row) > 0.01)
    for _ in range(done):
        next(rows)
    goes_on = create_load_stepper(base, mesh)
    assert goes_on.resume(stopped.points, [])
    rest = list(goes_on.states(path, lambda step: False, done=done))
    assert len(rest) == len(whole) - done
    for row, again in zip(whole[done:], rest, strict=True):
        assert again.x == row.x
        assert again.side_force_x == pytest.approx(row.side_force_x, rel=1e-5)


def test_halved_increments_of_a_slide_in_time() -> None:
    """Rows at requested times keep the displacements of the points between them."""
    history = History(
        "depth", ((0.0, 0.0), (1.0, 1.0), (3.0, 1.0)), (2.0, 3.0), ((1.0, 0.0), (3.0, 4.0))
    )
    path = history.time_stepped_path(0.5, 1)
    assert path.slides == (2.0, 4.0)
    fine = path.with_halved_increments()
    for step in range(1, len(fine.values) + 1):
        for (_, t), x in zip(fine.segment(step), fine.segment_slides(step), strict=True):
            assert x == pytest.approx(history.slide_at(t))
    assert fine.track((0.0,)).high == 4.0
