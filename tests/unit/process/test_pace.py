"""Progress estimate: duration of increments and the remaining time, on a simulated clock."""

from __future__ import annotations

import pytest

from indent_sim.process import usage
from indent_sim.process.usage import ProgressEstimate, duration_text


def test_a_step_has_its_own_time_and_the_rest_that_of_the_steps_so_far(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The remaining time is estimated from all increments but the first one.

    The first increment includes meshing and compilation.
    """
    clock = iter([0.0, 60.0, 62.0, 66.0, 69.0])
    monkeypatch.setattr(usage.time, "monotonic", lambda: next(clock))
    pace = ProgressEstimate(last_step_end=next(clock))
    assert [pace.record_step(left) for left in (3, 2, 1, 0)] == [
        (60, ""),
        (2, "4 s left"),
        (4, "3 s left"),
        (3, ""),
    ]


@pytest.mark.parametrize(
    ("seconds", "words"), [(3.4, "3 s"), (119, "119 s"), (600, "10 min"), (9000, "2.5 h")]
)
def test_a_time_is_told_in_the_unit_that_fits(seconds: float, words: str) -> None:
    assert duration_text(seconds) == words
