"""The hold of a history, on exponentials and kinks with known half times."""

from __future__ import annotations

from math import isnan, log
from pathlib import Path

import numpy as np
import pytest

from indent_sim.results.reader import Results
from indent_sim.results.relaxation_in_hold import first_hold


def history(t: np.ndarray, force: np.ndarray, branch: list[str]) -> Results:
    return Results(
        Path("run"),
        {"step": np.arange(1.0, len(t) + 1), "t": t, "force": force, "branch": np.array(branch)},
    )


def test_half_of_an_exponential_is_over_after_its_time_times_ln_2() -> None:
    """The half time of a hold with exponential decay of time tau is tau ln 2.

    The force ramps to t = 1, falls from 3 to 1 with tau = 0.2, and is retracted; rows are 0.002
    apart.
    """
    held = np.linspace(0, 4, 2001)[1:]
    t = np.concatenate([[0, 1], 1 + held, [5.5, 6]])
    force = np.concatenate([[0, 3], 1 + 2 * np.exp(-held / 0.2), [0.5, 0]])
    hold = first_hold(history(t, force, ["approach"] * 2 + ["hold"] * 2000 + ["retract"] * 2))
    assert hold is not None and hold.t[0] == 0 and hold.t[-1] == pytest.approx(4.0)
    assert hold.half_time == pytest.approx(0.2 * log(2), rel=1e-4)
    assert hold.remaining_fraction[0] == 1 and hold.remaining_fraction[-1] == 0


def test_a_force_that_rises_has_no_half() -> None:
    hold = first_hold(history(np.arange(7.0), np.arange(7.0), ["approach"] * 2 + ["hold"] * 5))
    assert hold is not None and isnan(hold.half_time)


@pytest.mark.parametrize(
    "branch", [["approach"] * 6, ["hold"] * 6, ["approach", *["hold"] * 3, "retract", "retract"]]
)
def test_without_a_hold_there_is_none(branch: list[str]) -> None:
    assert first_hold(history(np.arange(6.0), np.ones(6), branch)) is None
    assert first_hold(Results(Path("run"), {"step": np.ones(1), "force": np.ones(1)})) is None


def test_unloading_begins_at_the_end_of_a_hold() -> None:
    """Prescribed forces of a hold are equal to 1e-10, and the first of these is the largest."""
    force = np.array([0.0, 1.0, 2.0 + 1e-10, 2.0, 2.0 - 1e-10, 1.5, 0.0])
    results = Results(Path("run"), {"force": force})
    assert results.unloading_row(float(force.max())) == 4
    assert Results(Path("run"), {"force": force[[0, 1, 3, 5]]}).unloading_row(2.0) == 2
