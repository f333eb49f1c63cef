"""Last lines of a run: its row of interest, the hysteresis loop of a cycle, and units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from indent_sim.cli import terminal
from indent_sim.model.state import State
from indent_sim.run.pipeline import Outcome
from indent_sim.run.summary import row_of_interest

UNITS = {"length": "um", "force": "nN"}


def states(delta: Any, force: Any, t: Any = None) -> list[State]:
    rows = enumerate(zip(delta, force, strict=True), start=1)
    beside = {
        "p_max": 1.0,
        "penetration": 0.0,
        "energy": 0.0,
        "newton_iterations": 1,
        "wall_s": 0.0,
    }
    found = [State(step=step, delta=d, force=f, a=d, **beside) for step, (d, f) in rows]
    return (
        found
        if t is None
        else [State(**vars(one) | {"t": float(at)}) for one, at in zip(found, t, strict=True)]
    )


def last_lines(rows: list[State], **report: Any) -> list[str]:
    return terminal.conclusion_lines(
        Outcome(Path("results/none"), {"units": UNITS, **report}, rows)
    )


def test_the_last_row_of_a_path_that_goes_in_is_the_last_line() -> None:
    assert last_lines(states([0.1, 0.2], [1.0, 3.0])) == [
        "step 2: delta 0.2 um  force 3 nN  a 0.2 um"
    ]


def test_warnings_do_not_stand_below_it() -> None:
    lines = last_lines(states([0.1], [1.0]), warnings=["a strain"])
    assert lines[-2:] == ["warning: a strain", "step 1: delta 0.1 um  force 1 nN  a 0.1 um"]


def test_forces_of_plane_strain_are_per_length() -> None:
    plan = {"choices": [{"key": "kinematics", "value": "plane_strain", "why": ""}]}
    assert last_lines(states([0.1], [1.0]), plan=plan) == [
        "step 1: delta 0.1 um  force 1 nN/um  a 0.1 um"
    ]


def test_a_body_that_relaxes_ends_with_its_largest_force_and_its_loop() -> None:
    """The last lines give the largest force and the area of the hysteresis loop.

    Loading along F = delta and unloading along F = max(0, 2 delta - 1) leave a loop of 1/2 - 1/4,
    which is half of the work of loading.
    """
    way_in = np.linspace(0.0, 1.0, 11)
    out = way_in[-2::-1]
    delta, force = np.append(way_in, out), np.append(way_in, np.maximum(0.0, 2 * out - 1))
    *_, last, loop, top = last_lines(states(delta, force, np.arange(21.0)))
    assert last == "step 21: t 20 s  delta 0 um  force 0 nN  a 0 um"
    assert loop.startswith("hysteresis loop: area 0.25 ±") and loop.endswith(
        "50 % of the work of loading"
    )
    assert top == "largest force, step 11: t 10 s  delta 1 um  force 1 nN  a 1 um"


def test_the_error_of_the_loop_is_that_of_its_lines() -> None:
    """The stated error of the loop's area is that of the trapezoid rule.

    Loading along F = delta^2 has the work 1/3, off by 1/(6 n^2) with n increments; unloading is the
    straight line back from the last row.
    """
    way_in = np.linspace(0.0, 1.0, 11)
    rows = states(np.append(way_in, 0.0), np.append(way_in**2, 0.0), np.arange(12.0))
    rows = [State(**vars(one) | {"force": 0.0 if one.step == 12 else one.force}) for one in rows]
    loop = next(line for line in last_lines(rows) if line.startswith("hysteresis loop"))
    area, error = (float(loop.split(word)[1].split()[0]) for word in ("area", "±"))
    way_back = 0.5  # straight from the last row of the way in, which a jump would not be
    assert area == pytest.approx(1 / 3 - way_back, abs=2 * error) and error == pytest.approx(
        1 / 600, rel=0.3
    )


def test_an_elastic_body_has_no_loop() -> None:
    lines = last_lines(states([0.1, 0.2, 0.15, 0.0], [1.0, 3.0, 1.9, 0.0]))
    assert lines[-1].startswith("largest force, step 2:") and not any(
        "loop" in line for line in lines
    )


def test_of_a_creep_the_deepest_row_of_the_prescribed_force_is_told() -> None:
    rows = states([0.0, 0.1, 0.2, 0.3], [0.0, 1.0, 1.0, 1.0], np.arange(4.0))
    assert last_lines(rows, control="force")[-1].startswith("step 4: t 3 s")
    assert row_of_interest(rows, is_force_prescribed=False).step == 2


ROW_THAT_PULLS = {"step": 1, "delta": -0.1, "force": -1.0}


@pytest.mark.parametrize(
    ("found", "line"),
    [
        (
            None,
            "largest tensile force: -1 nN at delta -0.1 um, step 1; "
            "pull-off force without range (JKR) -0.9 nN",
        ),
        (
            {"delta": -0.11, "force": -1.02, "error": 0.0031, "equilibria": 3},
            "pull-off, searched between rows: force -1.02 nN ± 0.0031 nN at delta -0.11 um; "
            "pull-off force without range (JKR) -0.9 nN",
        ),
        (
            {"delta": -0.11, "force": -1.02, "error": None, "equilibria": 24},
            "pull-off, searched between rows: force -1.02 nN ± an unknown error at delta -0.11 um;"
            " pull-off force without range (JKR) -0.9 nN",
        ),
    ],
)
def test_a_tip_that_adheres_ends_with_its_pull_off(found: dict[str, Any] | None, line: str) -> None:
    adhesion = {"largest_pull": ROW_THAT_PULLS, "pull_off": found, "jkr_pull_off": -0.9}
    assert line in last_lines(states([-0.1], [-1.0]), adhesion=adhesion)


def test_a_printed_outcome_is_one_line() -> None:
    """In a notebook an outcome shows its folder and its last row, not thousands of numbers."""
    outcome = Outcome(Path("results/none"), {"units": UNITS}, states(range(1000), range(1000)))
    assert repr(outcome) == (
        "<Outcome in results/none: 1000 rows, the last one: delta 999  force 999  a 999>"
    )
