"""Sanity checks of rows: theory's states pass, and every kind of wrong state is found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.row_warnings import (
    long_step_warnings,
    lost_contact_warnings,
    oscillating_pressure_warnings,
    underresolved_rows,
)
from indent_sim.run.sanity_checks import CONTACT_RULES, GENERAL_RULES, violated_bound
from indent_sim.scene.expected_error import error_text
from indent_sim.scene.measured_constants import SUDDEN_BATH_RATIO
from indent_sim.scene.scene import Scene, resolve

BODIES: dict[str, Any] = {
    "layer": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "half_space": {"shape": "half_space"},
    "strip": {"shape": "strip", "width": 4.0, "height": 1.0, "sides": "roller"},
}
TIPS: dict[str, Any] = {
    "paraboloid": {"shape": "paraboloid", "R": 1.0},
    "sphere": {"shape": "sphere", "R": 0.5},
    "cone": {"shape": "cone", "half_angle": 70.0},
    "flat_punch": {"shape": "flat_punch", "radius": 0.3},
}
ELASTIC = {"model": "linear_elastic", "E": 2.0, "nu": 0.3}
RUBBER = {"model": "neo_hookean", "E": 3.0, "nu": 0.4}


def scene(body: Any = "layer", tip: str = "sphere", **sections: Any) -> Scene:
    given = {
        "body": BODIES[body] if isinstance(body, str) else body,
        "indenter": TIPS[tip],
        "material": ELASTIC,
        "loading": {"delta": 0.1, "steps": 2},
    } | sections
    return resolve(config_from_mapping(given))


def theorys(base: Scene, delta: float, step: int = 1) -> State:
    """Theory's state at a depth in the user's units."""
    found = (
        base.plan.theory.solution_at_depth(delta / base.physics.scales.length)
        if base.plan.theory
        else None
    )
    assert found is not None
    p_max = float(found.pressure(0.0))
    state = State(
        step,
        found.delta,
        found.force,
        found.a,
        p_max,
        0.0,
        found.energy,
        5,
        0.1,
        reaction=found.force,
    )
    return state.to_user_units(base.physics.scales)


# ---- nothing is said against what is true


@pytest.mark.parametrize("tip", TIPS)
@pytest.mark.parametrize("body", BODIES)
def test_theory_itself(body: str, tip: str) -> None:
    """Theory's states pass every check, pressed in from 1e-8 and unloaded again."""
    path = [-0.01, 1e-8, 1e-4, 0.05, 0.1, 0.02, 0.0, -0.01]
    base, earlier = scene(body, tip, loading={"deltas": path}), list[State]()
    for step, delta in enumerate(path, start=1):
        state = theorys(base, delta, step)
        assert violated_bound(base, state, PreviousRows(earlier)) is None
        earlier.append(state)


@pytest.mark.parametrize(
    ("sections", "change"),
    [
        (
            {"contact": {"method": "penalty", "epsilon_n": 10.0}},
            {"force": 0.6, "energy": 0.7},
        ),  # a soft penalty
        ({"mesh": {"h_contact": 0.5}}, {"force": 1.5, "a": 1.4}),  # half an element in contact
        ({"material": RUBBER}, {"force": 3.0, "energy": 3.0}),  # which stiffens
        ({}, {"newton_iterations": 0}),  # foretold to the last digit, as of a flat punch
    ],
)
def test_what_coarse_or_soft_models_do(sections: dict[str, Any], change: dict[str, float]) -> None:
    base = scene(**sections)
    before, state = theorys(base, 0.05), theorys(base, 0.1, step=2)
    changed = replace(
        state, **{name: factor * getattr(state, name) for name, factor in change.items()}
    )
    assert violated_bound(base, changed, PreviousRows([before])) is None


@pytest.mark.parametrize("tip", ["sphere", "cone", "flat_punch"])
def test_first_touch_on_a_mesh_for_the_deepest_contact(tip: str) -> None:
    """A contact of 1e-6 to 1e-5 of the path's force may be missed, a larger one may not.

    Quadrature points may miss it on a mesh for the deepest contact.
    """
    base = scene(tip=tip, loading={"deltas": [1e-8, 0.01, 0.1]})
    missed = [replace(theorys(base, delta), force=0.0, a=0.0, energy=0.0) for delta in (1e-8, 0.01)]
    assert violated_bound(base, missed[0], PreviousRows()) is None
    assert "there is no force" in (violated_bound(base, missed[1], PreviousRows()) or "")


# ---- each kind of wrong state

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "nan": ({"a": float("nan")}, "not finite: a"),
    "pulls": ({"force": -0.6}, "the force is -0.6, tensile without adhesion"),
    "from afar": ({"delta": -0.02}, "the tip is above the body"),
    "no force": ({"force": 0.0}, "there is no force"),
    "no contact": ({"a": 0.0}, "there is no contact radius"),
    "a plate": ({"a": 1.9}, "exceeds the radius 0.5 at which the surface of the tip ends"),
    "went through": ({"overlap": 0.09}, "lies 0.09 inside the tip"),
    "beside its contact": ({"x_contact": 1.2}, "the force acts at 1.2, outside the contact"),
    "energy": ({"energy": 0.02}, "but the work of a force that grew to"),
    "no energy": ({"energy": -0.001}, "the energy is -0.001"),
    "half of theory's": ({"force": 0.03, "energy": 0.001}, "but that of layer theory is"),
    "twice theory's": ({"force": 0.2}, "but that of layer theory is"),
    "too narrow a bar": (
        {"force": 0.07, "force_error": 1e-5},
        "outside the error bar 1e-05",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_state(name: str) -> None:
    change, said = WRONG[name]
    base = scene()
    assert said in (
        violated_bound(base, replace(theorys(base, 0.1), **change), PreviousRows()) or ""
    )


def test_every_rule_is_tried() -> None:
    """Every check of a single state is tried here.

    Those of a path are tried below, and those of a tip that slides and of a soft tip in
    tests/physics/test_slide.py and test_soft_tips_at_finite_strain.py.
    """
    base = scene()
    states = [replace(theorys(base, 0.1), **change) for change, _ in WRONG.values()]
    tried = {
        rule
        for rule in GENERAL_RULES + CONTACT_RULES
        if any(rule(base, state, PreviousRows()) for state in states)
    }
    # The rules of a path, of yield and of a soft tip
    assert len({*GENERAL_RULES, *CONTACT_RULES} - tried) == 8


METAL = {"model": "linear_elastic", "E": 2.0, "nu": 0.3, "plasticity": {"yield_stress": 0.02}}


def test_work_of_a_body_that_yields() -> None:
    """Rows whose work is stored and dissipated pass; a tenth of it missing is found."""
    base = scene(material=METAL, mesh={"h_contact": 0.02}, loading={"delta": 0.1, "steps": 20})
    rows = []
    for step in range(1, 21):
        state = theorys(base, 0.005 * step, step)
        rows.append(
            replace(state, energy=0.3 * state.energy, plastic_dissipation=0.7 * state.energy)
        )
    *earlier, last = rows
    assert violated_bound(base, last, PreviousRows(earlier)) is None
    assert last.plastic_dissipation
    lost = replace(last, plastic_dissipation=0.8 * last.plastic_dissipation)
    found = violated_bound(base, lost, PreviousRows(earlier))
    assert found and "plastic flow" in found


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"plastic_dissipation": 0.5}, "dissipated by plastic flow"),
        ({"force": 0.8, "delta": 1.1}, "fell while the tip went deeper"),
        ({"force": 1.2, "delta": 0.95}, "grew while the tip went out"),
        ({"force": 3.0, "delta": 1.01}, "that of an elastic body"),
    ],
)
def test_rules_of_a_body_that_yields(change: dict[str, float], words: str) -> None:
    """After in and out again; each number is a factor of the number of the last row."""
    loading = {"deltas": [0.01, 0.02, 0.019, 0.0192, 0.03]}
    base = scene(body="half_space", tip="paraboloid", material=METAL, loading=loading, mesh={})
    first = replace(theorys(base, 0.02), plastic_dissipation=1e-4)
    second = replace(theorys(base, 0.019, 2), plastic_dissipation=1e-4)
    rows = PreviousRows([first, second])
    third = replace(second, step=3, delta=second.delta * 1.001, force=second.force * 1.001)
    assert violated_bound(base, third, rows) is None
    wrong = {name: factor * getattr(second, name) for name, factor in change.items()}
    assert words in (violated_bound(base, replace(third, **wrong), rows) or "")


def test_a_tip_above_its_imprint() -> None:
    """After a larger depth a body that yields need not touch the tip."""
    base = scene(material=METAL, mesh={"h_contact": 0.02}, loading={"deltas": [0.1, 0.05]})
    free = replace(theorys(base, 0.05, 2), force=0.0, a=0.0, newton_iterations=0)
    assert violated_bound(base, free, PreviousRows([theorys(base, 0.1)])) is None
    assert violated_bound(base, free, PreviousRows([theorys(base, 0.02)])) is not None


def test_a_tip_on_the_top_of_a_fixed_side() -> None:
    """A tip that meets a fixed side, at r^2/(2 R) = 0.125, is found in a row under load control.

    No plan knows the depth of a prescribed force.
    """
    body = {"shape": "cylinder", "radius": 0.5, "height": 2.0, "sides": "fixed"}
    base = scene(tip="paraboloid", body=body, loading={"force": 0.01, "steps": 1})
    state = State(1, 0.124, 0.01, 0.4, 0.1, 0.0, 0.0005, 5, 0.1, reaction=0.01)
    assert violated_bound(base, state, PreviousRows()) is None
    assert "from the depth 0.125 on the tip touches the upper edge" in (
        violated_bound(base, replace(state, delta=0.126), PreviousRows()) or ""
    )


def test_nothing_solved() -> None:
    base = scene()
    first, second = theorys(base, 0.05), theorys(base, 0.1, step=2)
    still = replace(second, newton_iterations=0, force=first.force, energy=first.energy)
    assert "no iteration was done" in (violated_bound(base, still, PreviousRows([first])) or "")
    assert "no iteration was done" in (
        violated_bound(base, replace(first, newton_iterations=0), PreviousRows()) or ""
    )


@pytest.mark.parametrize("material", [None, RUBBER])
@pytest.mark.parametrize("depths", [(0.09, 0.1), (0.1, 0.09)], ids=["pressed", "let go of"])
def test_a_force_that_falls_with_depth(
    material: dict[str, Any] | None, depths: tuple[float, float]
) -> None:
    """A force that falls by 10 % with the depth is found, unless error bars are as wide."""
    base = scene(**({"material": material} if material else {}))
    force = theorys(base, 0.1).force
    forces = {0.09: force, 0.1: 0.9 * force}
    states = [
        replace(theorys(base, delta, step=k), force=forces[delta])
        for k, delta in enumerate(depths, start=1)
    ]
    assert "but it must grow with the depth" in (
        violated_bound(base, states[1], PreviousRows(states[:1])) or ""
    )
    excused = [replace(state, force_error=0.3 * force) for state in states]
    assert violated_bound(base, excused[1], PreviousRows(excused[:1])) is None


def test_a_law_that_softens_may_give_way() -> None:
    """The force may fall with the depth beyond Drucker's stability, of which the plan warns."""
    soft = {"model": "yeoh", "C10": 1.0, "C20": -1.0, "nu": 0.3}
    base = scene(material=soft, loading={"delta": 0.4, "steps": 2})
    assert any("loses its stability" in warning for warning in base.plan.warnings)
    first, second = (theorys(base, delta) for delta in (0.3, 0.4))
    assert (
        violated_bound(base, replace(second, force=0.8 * first.force), PreviousRows([first]))
        is None
    )


def test_theory_says_little_where_the_body_is_another() -> None:
    """Theory of an infinite layer is no bound for a pillar under a punch nearly as wide."""
    base = scene(tip="flat_punch", body={"shape": "cylinder", "radius": 0.35, "height": 4.0})
    state = theorys(base, 0.1)
    assert (
        violated_bound(
            base,
            replace(state, force=0.05 * state.force, energy=0.05 * state.energy),
            PreviousRows(),
        )
        is None
    )


# ---- contacts that the mesh does not resolve

DRAINING: dict[str, Any] = {
    "material": ELASTIC | {"flow": {"diffusivity": 1.0}},
    "loading": {"history": [[0, 0], [1, 0.1], [2, 0.1]]},
    "mesh": {"h_contact": 0.02},
}
SWELLING: dict[str, Any] = {
    "material": {
        "model": "gel",
        "G": 1.0,
        "n_omega": 1e-3,
        "chi": 0.6,
        "stretch": 1.4,
        "flow": {"diffusivity": 1.0},
    },
    "drainage": {"bath": 0.0},
}


def rows_of(radii: list[float], delta: float = 0.0, force: float = 1.0) -> list[State]:
    """Rows of one force and depth with contact radii in elements of 0.02."""
    return [
        State(k, delta, force, 0.02 * n, 1.0, 0.0, 1.0, 5, 0.1)
        for k, n in enumerate(radii, start=1)
    ]


def test_rows_of_a_history_whose_contact_is_small() -> None:
    base = scene(**DRAINING)
    assert underresolved_rows(base, rows_of([2.0, 5.0])) == []
    (said,) = underresolved_rows(base, rows_of([0.5, 1.8, 2.0, 5.0], delta=0.1))
    assert (
        said.startswith("2 rows from step 1 on have at most 1.8 elements")
        and "about 2 % to tens of per cent" in said
    )
    (said,) = underresolved_rows(base, rows_of([5.0, 1.0]))
    assert (
        said.startswith("step 2 has at most 1 elements")
        and "about 7 %" in said
        and "mesh.h_axis" in said
    )
    assert underresolved_rows(base, [replace(row, force=0.0) for row in rows_of([0.5, 1.0])]) == []


def test_a_contact_that_a_gel_closes_needs_more_elements() -> None:
    base = scene(**DRAINING | SWELLING)
    (said,) = underresolved_rows(base, rows_of([2.0, 5.0, 8.0]))
    assert said.startswith("2 rows from step 1 on have at most 5 elements") and "about 7 %" in said
    assert (
        underresolved_rows(base, rows_of([2.0, 5.0, 8.0], delta=0.1)) == []
    )  # pressed in: the tip is wider at this depth


def test_what_was_said_beforehand_is_not_said_again() -> None:
    base = scene(mesh={"h_contact": 0.2})
    assert any(doubt.key == "elements" for doubt in base.plan.model_warnings)
    assert underresolved_rows(base, rows_of([0.5])) == []


# ---- pressures that alternate, steps that are too long


def test_rough_pressures_are_said_once_with_their_size() -> None:
    base, smooth = scene(), rows_of([5.0, 5.0, 5.0])
    assert (
        oscillating_pressure_warnings(base, smooth)
        == oscillating_pressure_warnings(base, [replace(row, roughness=0.029) for row in smooth])
        == []
    )
    (said,) = oscillating_pressure_warnings(
        base, [replace(row, roughness=r) for row, r in zip(smooth, (0.01, 0.05, 0.12), strict=True)]
    )
    assert (
        said.startswith("2 rows from step 2 on")
        and "by 5 to 12 % of its peak, most in step 3" in said
    )
    assert "mesh.h_contact" in said
    (said,) = oscillating_pressure_warnings(base, [replace(smooth[0], roughness=0.3)])
    assert said.startswith("step 1:") and "30 % of its peak" in said


def even_rows(steps: int, stick: float) -> list[State]:
    """Rows under a paraboloid in even increments, with a relative stick radius."""
    radii = [5.0 * (k / steps) ** 0.5 for k in range(1, steps + 1)]
    return [replace(row, stick_radius=stick * row.a, dissipation=1.0) for row in rows_of(radii)]


def test_a_long_step_with_friction_says_what_it_costs() -> None:
    """Few increments with friction are warned of, with the error of stick radius and heat.

    In one increment from rest the stick radius is 2.2 times and the heat a quarter of Spence's.
    """
    base = scene(contact={"friction": 0.1})
    (said,) = long_step_warnings(base, even_rows(1, 0.1))
    assert said.startswith("step 1 changes the contact radius by up to 100 %")
    assert said.count("its own size or more") == 2
    (said,) = long_step_warnings(base, even_rows(4, 0.3))
    assert said.startswith("2 rows from step 1 on") and "stick_radius" in said


def test_ten_steps_are_short_enough_unless_little_slips() -> None:
    base = scene(contact={"friction": 0.3})
    assert long_step_warnings(base, even_rows(10, 0.5)) == []
    (said,) = long_step_warnings(base, even_rows(10, 0.9))
    assert (
        "dissipation by its own size or more" in said
        and "stick_radius may be wrong by about 22 %" in said
    )
    for contact in ({}, {"friction": "stick"}):  # nothing slips that is reported
        assert long_step_warnings(scene(contact=contact), even_rows(1, 0.1)) == []


def test_a_punch_touches_at_once() -> None:
    """A flat punch needs no more increments, because its contact does not grow."""
    flat = scene(contact={"friction": 0.3}, indenter={"shape": "flat_punch", "radius": 0.1})
    assert long_step_warnings(flat, even_rows(1, 0.5)) == []


# ---- baths that come within a time


def missing_rise(ramp: float, t: float) -> float:
    """Relative deficit of a gel's rise at a time after its bath began to change evenly.

    The bath is a sum of 20 000 sudden parts, each of which makes the surface rise with the root of
    time.
    """
    parts = ramp * (np.arange(20_000) + 0.5) / 20_000
    return 1.0 - float(np.sqrt(np.maximum(t - parts, 0.0)).mean()) / t**0.5


@pytest.mark.parametrize("ramp", [0.05, 0.2, 1.0, 1.9])
def test_rows_while_a_bath_comes_are_said(ramp: float) -> None:
    """Rows soon after a bath changes are warned of, with the missing share of the rise."""
    base = scene(**DRAINING | SWELLING | {"drainage": {"bath": 0.0, "bath_ramp": ramp}})
    (said,) = (doubt.message for doubt in base.plan.model_warnings if doubt.key == "bath")
    early = [t for t in base.physics.path.times if 0 < t < SUDDEN_BATH_RATIO * ramp]
    lost = dict.fromkeys(error_text(missing_rise(ramp, t)) for t in (max(early), min(early)))
    assert said.startswith(
        f"rows up to t = {max(early):.3g}: the bath changes over a time of {ramp:.3g}"
    )
    assert f"has risen less than after a sudden change, by {' to '.join(lost)};" in said
    assert not any(doubt.key == "bath" for doubt in scene(**DRAINING).plan.model_warnings)


SHRINKING: dict[str, Any] = {
    "material": {"model": "gel", "G": 1.0, "n_omega": 0.01, "chi": 0.2}
    | {"flow": {"diffusivity": 1.0}},
    "drainage": {"bath": [[0, 0], [1, -0.3]]},
}


def rows_in_time(*rows: tuple[float, float, float | None]) -> list[State]:
    """Rows of (t, delta, clearance), in contact where there is no clearance."""
    return [
        State(
            step,
            delta,
            *((0.0,) * 5 if clearance is not None else (1.0, 0.2, 1.0, 0.0, 1.0)),
            1,
            0.0,
            t=t,
            branch="hold",
            clearance=clearance,
        )
        for step, (t, delta, clearance) in enumerate(rows, start=1)
    ]


def test_a_tip_that_a_shrinking_gel_has_left_is_told_when_and_how_deep() -> None:
    """A warning says between which rows contact was lost, and how deep the surface then is."""
    base = scene(**SHRINKING, loading={"history": [[0, 0], [1, 0.05], [100, 0.05]]})
    touching = (0.5, 0.025, None)
    (said,) = lost_contact_warnings(
        base, rows_in_time(touching, (1.0, 0.05, 0.3), (10.0, 0.05, 0.78), (100.0, 0.05, 0.7))
    )
    assert said.startswith("3 rows from step 2 on have no contact and zero force")
    assert "between t = 0.5 and t = 1;" in said and "depth of 0.83 (t = 10)" in said
    (said,) = lost_contact_warnings(base, rows_in_time((0.5, 0.025, 0.1)))
    assert said.startswith("step 1 has") and "the beginning of the history and t = 0.5" in said


def test_a_tip_that_has_not_come_or_goes_has_not_lost_contact() -> None:
    """No contact is lost above the surface, on the way out, or under a prescribed force."""
    base = scene(**SHRINKING, loading={"history": [[0, 0], [1, 0.05], [100, 0.05]]})
    assert lost_contact_warnings(base, rows_in_time((0.5, -0.1, 0.1), (1.0, 0.05, None))) == []
    away = [replace(row, branch="retract") for row in rows_in_time((2.0, 0.01, 0.1))]
    assert lost_contact_warnings(base, away) == []
    weight = scene(**SHRINKING, loading={"force_history": [[0, 0], [1, 0.05], [100, 0.05]]})
    assert lost_contact_warnings(weight, rows_in_time((0.5, 0.025, 0.1))) == []
    (again,) = lost_contact_warnings(
        base, rows_in_time((0.5, -0.1, None), (1.0, -0.1, 0.2))
    )  # swollen, then shrunk
    assert "depth of 0.1 " in again
