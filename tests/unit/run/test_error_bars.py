"""Error bars from companion runs, on synthetic curves of known error."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import (
    REFINEMENT_RATIO,
    CoarserRun,
    coarsen_scene,
    coarser_scene,
)
from indent_sim.run.error_estimation.error_bars import (
    MIN_ERROR_FRACTION,
    PEAK_ERROR,
    PRESSURE_ORDER,
    ErrorBars,
)
from indent_sim.run.error_estimation.error_budget import SAFETY_FACTOR, ErrorBudget
from indent_sim.run.error_estimation.refinement import RefinementLevel
from indent_sim.scene.measured_constants import (
    ERROR_CONSTANT,
    ORDER_OF_CONVERGENCE,
    RADIUS_ERROR,
)
from indent_sim.scene.resolution import PRESETS, error_decay, required_elements
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.theory import Theory

SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 4},
}
EXACT = {1: 2e-4, 2: 6e-4, 3: 1.0e-3, 4: 1.6e-3}
ERROR = 1e-3  # of the finest curve, relative


def scene(**sections: Any) -> Scene:
    return resolve(config_from_mapping(SCENE | sections))


def states(error: float, steps: range = range(1, 5), flip: int = 0) -> list[State]:
    """States whose forces are wrong by a relative error, of opposite sign at the step `flip`."""
    return [
        State(
            k,
            0.0025 * k,
            EXACT[k] * (1 - error if k == flip else 1 + error),
            0.05 * k**0.5,
            0,
            0,
            0,
            1,
            0.0,
        )
        for k in steps
    ]


def companion(rate: float = ORDER_OF_CONVERGENCE, ratio: float = REFINEMENT_RATIO) -> CoarserRun:
    return CoarserRun(ratio, states(ERROR * ratio**rate))


def with_theory(base: Scene, theory: Theory | None) -> Scene:
    return replace(base, plan=replace(base.plan, theory=theory))


def bars_of(
    base: Scene, run: list[State], other: CoarserRun, soft: list[State] | None = None
) -> np.ndarray:
    """Error bars of synthetic curves, for a scene without reference theory."""
    bars = ErrorBars(with_theory(base, None), other, soft)
    return np.array([bars.add_error_estimate(state).force_error for state in run])


def test_a_bar_holds_an_error_that_falls_as_expected() -> None:
    """The error bar of a force that converges as h^q is SAFETY_FACTOR times its error.

    This is Roache's grid convergence index, for any ratio of the meshes, coarser or finer.
    """
    for ratio in (REFINEMENT_RATIO, 1.3, 2.5, 0.5):
        relative = bars_of(scene(accuracy=0.001), states(ERROR), companion(ratio=ratio)) / np.array(
            [*EXACT.values()]
        )
        assert relative == pytest.approx(SAFETY_FACTOR * ERROR, rel=1e-9)


def test_an_accidental_crossing_gives_no_tiny_bar() -> None:
    """Where run and companion cross by accident, the lower bound keeps the error inside the bar.

    Both are wrong by the median error of such elements at that step.
    """
    base = scene(accuracy=0.01)
    assert base.plan.resolution is not None
    wrong = 0.1 * ERROR_CONSTANT[2] * base.plan.resolution.n**-ORDER_OF_CONVERGENCE
    crossing = [
        replace(state, force=EXACT[2] * (1 + wrong)) if state.step == 2 else state
        for state in states(8 * wrong)
    ]
    bars = bars_of(base, states(wrong), CoarserRun(REFINEMENT_RATIO, crossing))
    assert bars[1] > wrong * EXACT[2] and bars[0] > 2 * bars[1] * EXACT[1] / EXACT[2]


def test_meshes_that_agree_leave_the_error_of_their_elements() -> None:
    """If both meshes agree, the bars of force, radius and p_max are their lower bounds.

    The bounds depend on the elements in the contact radius and not on the ratio of the meshes.
    """
    same = [replace(state, p_max=2.0) for state in states(0.0)]
    for ratio in (REFINEMENT_RATIO, 2.0, 0.5):
        judge = ErrorBars(with_theory(scene(), None), CoarserRun(ratio, same))
        for found in map(judge.add_error_estimate, same):
            h = float(scene().sizes.size_at(np.array(found.a), np.zeros(())))
            n = found.a / h
            assert found.force_error == pytest.approx(
                MIN_ERROR_FRACTION * ERROR_CONSTANT[2] * error_decay(n) * found.force
            )
            assert found.a_error == pytest.approx(RADIUS_ERROR * h)
            assert found.p_max_error == pytest.approx(2.0 * PEAK_ERROR * n**-PRESSURE_ORDER)


@pytest.mark.parametrize("shape", ["flat_punch", "paraboloid"])
def test_a_sharp_edge_in_three_dimensions_is_told_by_its_elements(shape: str) -> None:
    """Under a sharp punch in three dimensions the bar is a quarter of the edge elements over a.

    All meshes end at the edge and are off in the same way, so that they agree. A section and a tip
    without an edge have no such part.
    """
    tip = {"shape": shape} | ({"radius": 0.3} if shape == "flat_punch" else {"R": 1.0})
    solid = {"shape": "box", "size": [3.0, 3.0, 1.0]}
    rows = [replace(state, a=0.3) for state in states(0.0)]
    section, box = (
        scene(indenter=tip, **body)
        for body in ({}, {"body": solid, "mesh": {"symmetry": "quarter"}})
    )
    in_section, in_box = (
        bars_of(one, rows, CoarserRun(REFINEMENT_RATIO, rows))[-1] / EXACT[4]
        for one in (section, box)
    )
    sizes = box.sizes
    if shape == "flat_punch":
        assert sizes.punch_edge and sizes.h_edge
        assert in_box == pytest.approx(
            0.25 * sizes.edge_refinement_factor * sizes.h_edge / sizes.punch_edge
            + sizes.corner_error
        )
        assert section.sizes.h_edge and in_section < 0.25 * section.sizes.h_edge / 0.3
    else:
        assert sizes.punch_edge is None
        n = 0.3 / float(sizes.size_at(np.array(0.3), np.zeros(())))
        assert in_box == pytest.approx(
            MIN_ERROR_FRACTION * ERROR_CONSTANT[3] * error_decay(n) + sizes.corner_error
        )


def test_corners_that_are_left_coarse_come_on_top() -> None:
    """The error of corners that no companion refines is added to the bar.

    The body is an incompressible box, bonded at its base and free at its sides.
    """
    soft = {"model": "linear_elastic", "E": 1.0, "nu": 0.4999}
    base = scene(body={"shape": "box", "size": [2.0, 2.0, 1.0]}, material=soft)
    cost = base.sizes.corner_error
    assert cost > 3e-4
    clean = replace(base, sizes=replace(base.sizes, corner_error=0.0))
    on_top = [bars_of(one, states(ERROR), companion()) for one in (base, clean)]
    assert on_top[0] - on_top[1] == pytest.approx(
        cost * np.array([state.force for state in states(ERROR)])
    )


def test_the_companion_of_a_run_is_coarser_or_its_last_attempt() -> None:
    """The companion is a coarser run, or the attempt before a refined run.

    A mesh from a file has only other levels of refinement.
    """
    base, before = scene(accuracy=0.001), scene(accuracy=0.01)
    ratio, other = coarser_scene(base)
    assert ratio == REFINEMENT_RATIO and other.sizes.h_contact == pytest.approx(
        REFINEMENT_RATIO * base.sizes.h_contact
    )
    ratio, other = coarser_scene(base, before)
    assert other is before and ratio == pytest.approx(before.sizes.h_contact / base.sizes.h_contact)
    for level, (ratio, found) in {2: (2.0, 1), 1: (2.0, 0), 0: (0.5, 1)}.items():
        of_file = replace(base, sizes=replace(base.sizes, refinements=level))
        assert (
            coarser_scene(of_file)[0] == ratio
            and coarser_scene(of_file)[1].sizes.refinements == found
        )


def test_no_bar_is_narrower_than_the_distance_from_exact_theory() -> None:
    """The bar is at least the distance from exact theory, and ignores theory that is not exact."""
    least = (
        MIN_ERROR_FRACTION * ERROR_CONSTANT[2] * error_decay(required_elements(0.01, 2)) * 1.2
    )  # a little fewer elements in the first contact
    base = scene(accuracy=0.01)
    assert base.plan.theory is not None
    exact = np.array(
        [
            solution.force
            for solution in base.plan.theory.solutions_at_depths([0.0025 * k for k in EXACT]) or []
        ]
    )
    wrong = [replace(state, force=1.05 * F) for state, F in zip(states(0.0), exact, strict=True)]
    inexact = with_theory(base, replace(base.plan.theory, differences=("another body",)))
    for judge, low, high in (
        (base, 0.05, 0.05),
        (inexact, 0.0, least),
        (base.replace_physics(gap="current"), 0.0, least),
    ):
        bars = ErrorBars(judge, CoarserRun(REFINEMENT_RATIO, wrong))
        found = np.array([bars.add_error_estimate(state).force_error for state in wrong]) / exact
        assert np.all(found >= low * (1 - 1e-9)) and np.all(found <= high * (1 + 1e-9))


def test_rows_with_few_elements_have_bars_of_their_own_error() -> None:
    """On a uniform mesh the first rows, with few elements, have wider bars that hold the error."""
    base = scene(mesh={"h_contact": 0.01, "h_far": 0.25})
    law = [float((a / 0.01) ** -ORDER_OF_CONVERGENCE) for a in (0.05 * k**0.5 for k in EXACT)]

    def walked(ratio: float) -> list[State]:
        share = [1 + 0.1 * error * ratio**ORDER_OF_CONVERGENCE for error in law]
        return [
            replace(state, force=state.force * s)
            for state, s in zip(states(0.0), share, strict=True)
        ]

    bars = bars_of(base, walked(1.0), CoarserRun(REFINEMENT_RATIO, walked(REFINEMENT_RATIO)))
    over = bars / (0.1 * np.array(law) * np.array(list(EXACT.values())))
    assert np.all(over > 1) and np.all(over < 6)


def test_a_step_that_a_companion_did_not_reach_has_no_bar() -> None:
    short = CoarserRun(REFINEMENT_RATIO, states(ERROR, range(1, 3)))
    bars = bars_of(scene(accuracy=0.01), states(0.0), short)
    assert np.isfinite(bars[:2]).all() and np.isnan(bars[2:]).all()


def test_out_of_contact_there_is_no_error() -> None:
    nothing = [replace(state, delta=-state.delta, force=0.0, a=0.0) for state in states(0.0)]
    assert not bars_of(scene(), nothing, CoarserRun(REFINEMENT_RATIO, nothing)).any()


def test_a_contact_that_no_mesh_finds_has_less_force_than_a_deeper_one() -> None:
    """The bar of a missed contact is the force at the next depth with one."""
    missed = [
        replace(state, force=0.0, a=0.0) if state.step < 2 else state for state in states(0.0)
    ]
    coarse = [
        replace(state, force=0.0, a=0.0) if state.step < 3 else state for state in states(0.0)
    ]
    judge = ErrorBars(scene(), CoarserRun(REFINEMENT_RATIO, coarse))
    first = judge.add_error_estimate(missed[0])
    assert (first.force_error, first.a_error) == (coarse[2].force, coarse[2].a)
    nowhere = [replace(state, force=0.0, a=0.0) for state in states(0.0)]
    assert np.isnan(bars_of(scene(), nowhere, CoarserRun(REFINEMENT_RATIO, nowhere))).all()


def test_radius_and_peak_have_bars_of_their_own() -> None:
    """p_max has SAFETY_FACTOR times its error as bar, and a radius a share of an element.

    A p_max that no mesh knows has no bar.
    """
    base = scene()
    exact = states(0.0)

    def off(ratio: float) -> list[State]:
        return [replace(state, p_max=1 + 0.01 * ratio**2) for state in exact]

    judge = ErrorBars(base, CoarserRun(REFINEMENT_RATIO, off(REFINEMENT_RATIO)))
    for state in off(1.0):
        found = judge.add_error_estimate(state)
        assert found.p_max_error == pytest.approx(SAFETY_FACTOR * 0.01)
        assert found.a_error == pytest.approx(RADIUS_ERROR * base.sizes.surface_size(state.a))
    sharp = [replace(state, p_max=float("nan")) for state in exact]
    assert np.isnan(
        ErrorBars(base, CoarserRun(REFINEMENT_RATIO, sharp))
        .add_error_estimate(sharp[0])
        .p_max_error
    )


def test_the_error_of_a_depth_is_that_of_its_force_over_the_slope() -> None:
    base = scene(loading={"forces": list(EXACT.values())})
    found = ErrorBars(base, companion()).add_error_estimate(states(ERROR)[1])
    slope = (EXACT[3] - EXACT[1]) / (2 * 0.0025)  # by the chord; the curve is nearly straight there
    assert found.delta_error == pytest.approx(found.force_error / slope, rel=0.2)
    assert ErrorBars(scene(), companion()).add_error_estimate(states(ERROR)[1]).delta_error is None
    # At a depth where the force does not increase its error says nothing about the depth.
    above = replace(states(ERROR)[1], delta=-0.001)
    assert np.isnan(ErrorBars(base, companion()).add_error_estimate(above).delta_error)


def test_the_error_of_a_penalty_is_extrapolated() -> None:
    """The error by a penalty follows from half the stiffness, because 1/F is linear in 1/epsilon_n.

    Body and penalty act as two springs in series, and the force is 2 % low.
    """
    low = 0.02
    own, soft = (
        [replace(s, force=s.force / (1 + k * low / (1 - low))) for s in states(0.0)] for k in (1, 2)
    )
    judge = ErrorBars(scene(contact={"method": "penalty"}), CoarserRun(REFINEMENT_RATIO, own), soft)
    for state in own:
        judge.add_error_estimate(state)
    found = [budget.enforcement for budget in judge.budgets]
    assert found == pytest.approx(
        [EXACT[k] - state.force for k, state in enumerate(own, 1)], rel=1e-9
    )


def test_a_companion_with_a_softer_penalty_says_more_than_the_error() -> None:
    """The error of enforcement takes the stiffness of the companion's own penalty into account.

    The companion of a refined run is the attempt before it, whose penalty had a third of the
    stiffness.
    """
    base, low = scene(contact={"method": "penalty"}), 0.02
    law = base.physics.contact
    before = base.replace_physics(contact=replace(law, epsilon_n=law.stiffness / 3))
    own, soft = (
        [replace(s, force=s.force / (1 + k * low / (1 - low))) for s in states(0.0)] for k in (1, 2)
    )
    same, other = (CoarserRun(REFINEMENT_RATIO, own, at) for at in (base, before))
    whole, third = (ErrorBars(base, one, soft) for one in (same, other))
    for state in own:
        whole.add_error_estimate(state), third.add_error_estimate(state)
    assert [b.enforcement for b in third.budgets] == pytest.approx(
        [b.enforcement / 3 for b in whole.budgets]
    )
    assert whole.budgets[0].enforcement > 0.019 * own[0].force


def test_with_prescribed_forces_the_depths_differ_and_say_the_same() -> None:
    """Error bars under load control equal those under depth control for F = c delta^1.5."""
    depths = {k: (EXACT[k] / 1.6) ** (2 / 3) for k in EXACT}

    def walked(error: float, control: str) -> list[State]:
        shift = (1 + error) ** (-2 / 3) if control == "force" else 1.0
        high = 1.0 if control == "force" else 1 + error
        return [
            State(k, depths[k] * shift, EXACT[k] * high, 0.05 * k**0.5, 0, 0, 0, 1, 0.0)
            for k in EXACT
        ]

    by_depth, by_force = (
        bars_of(
            scene(accuracy=0.01),
            walked(ERROR, control),
            CoarserRun(
                REFINEMENT_RATIO, walked(ERROR * REFINEMENT_RATIO**ORDER_OF_CONVERGENCE, control)
            ),
        )
        for control in ("depth", "force")
    )
    assert by_force == pytest.approx(
        by_depth, rel=0.02
    )  # one is relative to the wrong force, 1 + ERROR q^RATE


DRAINING: dict[str, Any] = {
    "material": SCENE["material"] | {"flow": {"diffusivity": 1.0}},
    "loading": {"history": [[0, 0], [0.1, 0.01]], "times": [0.025, 0.05, 0.075, 0.1]},
}


def test_films_are_counted_once() -> None:
    """A known film error on both meshes is counted once, beside the mesh's lower bound."""
    lost = {1.0: 0.01, REFINEMENT_RATIO: 0.023}  # relative, by the size of the elements

    def film_error(state: State, coarser: float = 1.0) -> float:
        return lost[coarser] * EXACT[state.step]

    film: Any = SimpleNamespace(force_error=film_error)
    base = with_theory(scene(**DRAINING), None)
    bars = ErrorBars(
        base, CoarserRun(REFINEMENT_RATIO, states(-lost[REFINEMENT_RATIO])), film_error=film
    )
    alike = ErrorBars(base, CoarserRun(REFINEMENT_RATIO, states(-lost[1.0])))
    for state in states(-lost[1.0]):
        bars.add_error_estimate(state)
        alike.add_error_estimate(state)
    for budget, equal in zip(bars.budgets, alike.budgets, strict=True):
        assert budget.film == pytest.approx(lost[1.0] * EXACT[budget.step], rel=1e-12)
        assert budget.discretisation == pytest.approx(equal.discretisation, rel=1e-9)


def test_a_bath_that_comes_in_twice_the_time_says_what_its_ramp_costs() -> None:
    """A bath ramp of twice the time changes the force by the error of the ramp, of first order."""
    base = with_theory(scene(**DRAINING), None)
    bars = ErrorBars(
        base, CoarserRun(REFINEMENT_RATIO, states(0.0)), slow_bath_states=states(-0.02)
    )
    for state in states(0.0):
        bars.add_error_estimate(state)
        assert bars.budgets[-1].bath == pytest.approx(
            SAFETY_FACTOR * 0.02 * EXACT[state.step], rel=1e-9
        )


def test_a_coarser_scene_is_coarser_everywhere() -> None:
    base = scene(accuracy=0.001, indenter={"shape": "flat_punch", "radius": 0.5})
    larger = coarsen_scene(base, 1.6)
    r, z = np.meshgrid(np.linspace(0, 2, 41), np.linspace(0, 1, 21))
    assert np.all(larger.sizes.size_at(r, z) >= base.sizes.size_at(r, z))
    assert larger.sizes.h_contact == pytest.approx(1.6 * base.sizes.h_contact)


# ---- what accuracy chooses


def test_presets_and_their_order() -> None:
    """Ten times the accuracy takes 10^(1/q) times the elements in the contact radius."""
    assert scene(accuracy="accurate").sizes == scene(accuracy=PRESETS["accurate"]).sizes
    assert required_elements(1e-4, 2) / required_elements(1e-3, 2) == pytest.approx(
        10 ** (1 / ORDER_OF_CONVERGENCE)
    )


def test_every_step_sees_the_same_number_of_elements() -> None:
    """The element size at the edge of every contact on the path is the same share of its radius."""
    base = scene(accuracy=0.01, loading={"delta": 0.01, "steps": 20})
    assert base.plan.resolution is not None and base.plan.theory is not None
    radii = np.array(
        [solution.a for solution in base.plan.theory.solutions_at_depths(base.physics.deltas)]
    )
    share = base.sizes.size_at(radii, np.zeros_like(radii)) / radii * base.plan.resolution.n
    assert share == pytest.approx(1.0, rel=1e-6)


def test_a_penalty_left_open_is_stiff_enough() -> None:
    soft, stiff = (
        scene(accuracy=accuracy, contact={"method": "penalty"}) for accuracy in (0.01, 0.001)
    )
    laws = soft.physics.contact, stiff.physics.contact
    assert isinstance(laws[0], Penalty) and isinstance(laws[1], Penalty)
    assert laws[1].stiffness > 4 * laws[0].stiffness


@pytest.mark.parametrize("key", ["h_contact", "h_far", "h_axis", "h_edge", "grading"])
def test_accuracy_and_sizes_contradict_each_other(key: str) -> None:
    with pytest.raises(ConfigError, match=f"mesh.{key}: cannot be combined with accuracy"):
        config_from_mapping(SCENE | {"accuracy": 0.01, "mesh": {key: 0.01}})


@pytest.mark.parametrize("accuracy", [0.0, 1.0, -0.01, "best", True])
def test_accuracies_that_are_none(accuracy: Any) -> None:
    with pytest.raises(ConfigError) as caught:
        config_from_mapping(SCENE | {"accuracy": accuracy})
    assert caught.value.key == "accuracy"


@pytest.mark.parametrize(
    ("mesh", "key"),
    [
        ({"h_contact": 0.01, "h_axis": 0.02}, "h_axis"),
        ({"h_contact": 0.01, "h_edge": 0.005}, "h_edge"),
        ({"h_axis": 0.01}, "h_axis"),
    ],
)
def test_sizes_that_do_not_fit_the_scene(mesh: dict[str, float], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        scene(mesh=mesh)
    assert caught.value.key == f"mesh.{key}"


@pytest.mark.parametrize(
    ("paths", "said"),
    [((0.02, 0.05), "single increment from"), ((0.001, 0.05), "more loading.steps")],
)
def test_more_steps_are_advised_where_they_help(paths: tuple[float, float], said: str) -> None:
    """More increments are advised, except for the error of the first one."""
    base = scene(accuracy=0.01, contact={"method": "auto", "friction": "stick"})
    rows = states(0.0, range(1, 3))
    budgets = [
        ErrorBudget(row.step, 0.0, 0.0, 0.0, path=path * row.force)
        for row, path in zip(rows, paths, strict=True)
    ]
    attempt = RefinementLevel(base)
    attempt.assess(lambda elements: base, rows, SimpleNamespace(budgets=budgets, companion=None))  # type: ignore[arg-type]
    assert said in attempt.failure and attempt.next_level is None
