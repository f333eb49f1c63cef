"""Planned runs: identity, cost and mistakes of a config."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.run.planned_run import PlannedRun, plan_with_cost

SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 4.0, "height": 2.0},
    "material": {"model": "linear_elastic", "E": 3.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.04, "steps": 2},
}


def of(**changes: Any) -> PlannedRun:
    return PlannedRun.resolve(config_from_mapping(SCENE | changes))


def test_titles_have_no_part_in_an_identity_and_numbers_have() -> None:
    assert (
        of(title="one").identity
        == of().identity
        != of(loading={"delta": 0.04, "steps": 3}).identity
    )


def test_depths_and_units_are_the_users() -> None:
    prospect = of(contact={"method": "penalty"})
    assert prospect.depths == pytest.approx([0.02, 0.04]) and not prospect.has_prescribed_forces
    assert prospect.modulus == pytest.approx(3.0)
    assert prospect.stiffness == pytest.approx(100.0, rel=0.5)  # of the penalty's own choice
    assert prospect.stiffness_unit > 0 and of(loading={"force": 0.1}).has_prescribed_forces


def test_error_bars_cost_seconds() -> None:
    alone = of()
    assert alone.add_estimation_cost() is alone
    assert (
        alone.add_estimation_cost(error_bars=True).plan.prediction["seconds"]
        > alone.plan.prediction["seconds"]
    )


def test_a_plan_tells_all_mistakes_at_once() -> None:
    """A plan reports all mistakes of a scene, where resolving it reports the first one."""
    config = config_from_mapping(
        SCENE | {"solver": {"method": "theory"}, "loading": {"delta": 3.0, "steps": 1}}
    )
    with pytest.raises(ConfigError) as first:
        PlannedRun.resolve(config)
    with pytest.raises(ConfigError) as told:
        plan_with_cost(config)
    assert str(first.value.errors[0].problem) in str(told.value)
    assert not isinstance(first.value, ConfigErrors)


def test_what_was_left_out_is_not_asked_for() -> None:
    """Mistakes that follow from another one are not reported with it.

    A history that never touches is the one mistake, and the time of relaxation is not asked for.
    """
    relaxing = {
        "model": "linear_elastic",
        "E": 3.0,
        "nu": 0.3,
        "relaxation": {"prony": [[0.5, 1.0]]},
    }
    away: dict[str, Any] = {"material": relaxing, "loading": {"history": [[0, 0], [1, -0.1]]}}
    with pytest.raises(ConfigError) as told:
        plan_with_cost(config_from_mapping(SCENE | away))
    assert [one.key for one in told.value.errors] == ["loading.history"]
    with pytest.raises(ConfigError) as told:
        plan_with_cost(config_from_mapping(SCENE | away | {"drainage": {"tip": "sealed"}}))
    assert {one.key for one in told.value.errors} == {"loading.history", "drainage"}
