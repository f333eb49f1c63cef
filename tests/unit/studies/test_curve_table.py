"""Names of the curves of a study."""

from __future__ import annotations

from typing import Any

import pytest
from made_results import a_result

from indent_sim.studies.curve_table import CurveGroups, RunCurve

RUBBER, LINEAR = (
    {"model": model, "E": 1.0, "nu": 0.3} for model in ("neo_hookean", "linear_elastic")
)


def names(*values: dict[str, Any]) -> list[str]:
    keys = tuple(dict.fromkeys(key for one in values for key in one))
    return CurveGroups(tuple(RunCurve(one, a_result()) for one in values), keys).curve_names()


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([{"body.height": "5 um"}, {"body.height": 10.0}], ["height 5 um", "height 10"]),
        (
            [{"material": RUBBER}, {"material": LINEAR}],
            ["model neo_hookean", "model linear_elastic"],
        ),
        (
            [{"loading": "{delta: 1.0}"}, {"loading": "{delta: 2.0}"}],
            ["delta 1", "delta 2"],
        ),  # read back from a table
        ([{"material": RUBBER}, {"material": RUBBER}], ["model neo_hookean, E 1, nu 0.3"] * 2),
        (
            [{"contact.friction": 0.1}, {"contact.friction": "stick"}],
            ["friction 0.1", "friction stick"],
        ),
        (
            [{"contact.method": "uzawa", "solver.method": "newton"}],
            ["contact.method uzawa, solver.method newton"],
        ),
    ],
    ids=[
        "numbers",
        "sections",
        "sections as text",
        "equal sections",
        "words",
        "two keys that end alike",
    ],
)
def test_curves_are_named_by_what_differs(
    values: list[dict[str, Any]], expected: list[str]
) -> None:
    assert names(*values) == expected
