"""A warning and its number are one thing: what is said, stated and budgeted comes from one list."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.file import from_mapping
from indent_sim.run.error_bars import Companion, ErrorBars
from indent_sim.scene.scene import Scene, resolve

SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "penalty": {"contact": {"method": "penalty", "epsilon_n": 30.0}},
    "coarse": {"mesh": {"h_contact": 0.1}},
    "several": {"contact": {"method": "active_set", "gap": "current"}},
    "unloading": {"loading": {"deltas": [0.02, 0.001]}, "mesh": {"h_contact": 0.02}},
    "half_space": {"body": {"shape": "half_space"}, "solver": {"method": "condensed"}},
    "layer": {"body": {"shape": "layer", "height": 1.0}, "solver": {"method": "condensed"}},
    "theory": {"body": {"shape": "half_space"}},
    "corners": {"body": {"shape": "box", "size": [0.6, 0.6, 1.0]}, "mesh": {"h_contact": 0.1},
                "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.49}},
}  # fmt: skip
NUMBERS = {"plain": set(), "penalty": {"penalty"}, "coarse": {"elements"}, "several": {"several_equilibria"},
           "unloading": {"elements"}, "half_space": {"truncation"}, "layer": {"truncation"},
           "theory": set(), "corners": {"corners", "elements"}}  # fmt: skip


def scene(**sections: Any) -> Scene:
    """A paraboloid on a thick cylinder; `sections` replace whole sections of that."""
    given: dict[str, Any] = {
        "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 1},
    }
    return resolve(from_mapping(given | sections))


@pytest.mark.parametrize("name", SCENES)
def test_what_is_stated_is_the_sum_of_what_is_doubted(name: str) -> None:
    found = scene(**SCENES[name])
    assert found.plan.warnings == tuple(doubt.words for doubt in found.plan.doubts if doubt.words)
    assert found.plan.prediction.get("force_error", 0.0) == sum(doubt.force_error for doubt in found.plan.doubts)
    assert {doubt.key for doubt in found.plan.doubts if doubt.force_error} == NUMBERS[name]


def test_a_number_stands_in_its_words() -> None:
    (doubt,) = (doubt for doubt in scene(**SCENES["penalty"]).plan.doubts if doubt.key == "penalty")
    assert f"up to {100 * doubt.force_error:.2g} % too low" in doubt.words


def test_without_contact_only_that_is_said() -> None:
    found = scene(loading={"deltas": [-0.1]}, contact={"method": "active_set", "gap": "current"})
    assert [doubt.key for doubt in found.plan.doubts] == ["no_contact"] and "force_error" not in found.plan.prediction


def test_the_error_budget_has_the_doubt_of_the_finite_body() -> None:
    found = scene(**SCENES["half_space"])
    bars = ErrorBars(found, [Companion(1.6, [], found)])
    (doubt,) = (doubt for doubt in found.plan.doubts if doubt.key == "truncation")
    assert bars._truncation == doubt.force_error == found.plan.prediction["truncation_error"]
