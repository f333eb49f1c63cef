"""Histories on the whole body: time changes nothing in a body that does not depend on time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import ELASTIC, WALLED, scene, solve

from indent_sim.model.load_path import LoadPath
from indent_sim.model.loading import Loading
from indent_sim.model.state import State
from indent_sim.run.pipeline import states

RUBBER = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
BACK = [[0, 0], [1, 0.02], [4, 0.02], [5, 0.005]]
COARSE = {"h_contact": 0.04}
SCENES: dict[str, dict[str, Any]] = {
    "friction": {"material": ELASTIC, "contact": {"friction": 0.2}},
    "rubber": {"material": RUBBER},
    "adhesion": {"material": ELASTIC, "contact": {"adhesion": {"work": 2e-3, "range": 0.05}}},
}


def found(state: State) -> tuple[float | None, ...]:
    """Columns of a row without its time."""
    return (
        state.delta,
        state.force,
        state.a,
        state.p_max,
        state.energy,
        state.newton_iterations,
        state.dissipation,
    )


@pytest.mark.parametrize(
    "name", ["friction", "rubber", pytest.param("adhesion", marks=pytest.mark.verify)]
)
def test_rows_are_those_of_the_same_depths(name: str) -> None:
    """Rows of a history are those of the same depths without time, to the last digit.

    There are twenty rows in each moving segment, one for the hold and one at rest.
    """
    timed = scene(WALLED, mesh=COARSE, loading={"history": BACK}, **SCENES[name])
    depths = [0.0, *np.linspace(0.001, 0.02, 20), 0.02, *np.linspace(0.02, 0.005, 21)[1:]]
    assert timed.physics.path.values == pytest.approx(depths, rel=1e-12, abs=1e-15)
    same = [delta * timed.physics.scales.depth for delta in timed.physics.path.values]
    plain = scene(WALLED, mesh={"h_contact": 0.04}, loading={"deltas": same}, **SCENES[name])
    one, other = list(states(timed)), list(states(plain))
    assert [state.branch for state in one] == ["approach"] * 21 + ["hold"] + ["retract"] * 20
    assert [state.t for state in one][::10] == pytest.approx([0, 0.5, 1, 4.45, 4.95], rel=1e-12)
    assert [found(state) for state in one] == [found(state) for state in other]


def test_rows_at_some_times_are_among_all_of_them() -> None:
    """Rows at some times have friction and dissipation of the whole path."""
    every = solve(scene(WALLED, mesh=COARSE, loading={"history": BACK}, **SCENES["friction"]))
    loading = {"history": BACK, "times": [0.5, 4.0, 4.5]}
    some = list(states(scene(WALLED, mesh=COARSE, loading=loading, **SCENES["friction"])))
    at = {state.t: state for state in every}
    assert [state.force for state in some] == [at[state.t].force for state in some]
    lost = np.cumsum([state.dissipation for state in every])
    lossy = np.cumsum([state.dissipation for state in some])
    assert lossy == pytest.approx([lost[every.index(at[state.t])] for state in some], rel=1e-12)


def test_forces_in_time() -> None:
    """Forces of a force_history are met, and are those of forces without time."""
    history = [[0, 0], [1, 2e-3], [2, 1e-3]]
    timed = scene(WALLED, mesh=COARSE, loading={"force_history": history}, material=RUBBER)
    rows = list(states(timed))
    assert [row.force for row in rows[1:]] == pytest.approx(
        [*np.linspace(1e-4, 2e-3, 20), *np.linspace(1.95e-3, 1e-3, 20)], rel=1e-8
    )
    assert rows[-1].t == 2 and rows[-1].branch == "retract"


def test_half_steps_pass_the_same_turns() -> None:
    """The path of halved increments contains the rows and turns of the path."""
    history = Loading(history=((0, 0), (1, 0.02), (2, 0.01)), times=(0.5, 1.5)).prescribed_history  # type: ignore[arg-type]
    assert history is not None
    path = history.path
    fine = path.with_halved_increments()
    assert fine.values[1::2] == path.values

    def length(path: LoadPath) -> float:
        values = [
            0.0,
            *(value for step in range(1, len(path.values) + 1) for value, _ in path.segment(step)),
        ]
        return float(np.abs(np.diff(values)).sum())

    assert length(fine) == pytest.approx(length(path), rel=1e-12) == pytest.approx(0.025, rel=1e-12)


def test_a_jump_is_walked_as_a_depth() -> None:
    """A jump from rest is the increment to that depth, and has only the row after it."""
    jump = scene(WALLED, mesh=COARSE, loading={"history": [[0, 0.01], [1, 0.01]]}, material=RUBBER)
    rows = list(states(jump))
    assert [(row.t, row.branch) for row in rows] == [(0, "approach"), (1, "hold")]
    (there,) = solve(
        scene(WALLED, mesh=COARSE, loading={"delta": 0.01, "steps": 1}, material=RUBBER)
    )
    assert rows[0].force == there.force and rows[1].force == pytest.approx(there.force, rel=1e-9)
