"""Cases of a table of effects, by forces in closed form, and variants that are solved once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, sin
from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.process.errors import NotConverged
from indent_sim.run.model_selection import variant_solver
from indent_sim.run.model_selection.effect_table import EFFECTS
from indent_sim.run.model_selection.effects import (
    Absent,
    Cases,
    Comparison,
    Effect,
    Range,
    Threshold,
    Unknown,
    find_effect,
)
from indent_sim.run.model_selection.variant_solver import VariantSolver

HALF_SPACE = config_from_mapping(
    {
        "body": {"shape": "half_space"},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 1},
    }
)


@dataclass
class Spring:
    """Variants of a spring: the force is a stiffness, and a variant is its value."""

    stiffness: float
    tolerance: float = 0.01

    @property
    def percent(self) -> float:
        return 100 * self.tolerance

    def force_ratio(self, with_effect: float, without_effect: float) -> float:
        if not without_effect > 0:
            raise NotConverged("the force without the effect is not positive")
        return with_effect / without_effect


# The stiffness grows with a second spring of stiffness x, which the scene may already have.
SECOND_SPRING: Cases = (
    Absent("a rigid body has no spring", when=lambda v: v.stiffness == inf),
    Unknown(
        "softer than nothing", needs="never for {v.stiffness:g}", when=lambda v: v.stiffness < 0
    ),
    Comparison(
        "twice {v.stiffness:g}",
        lambda v: 2 * v.stiffness,
        lambda v: v.stiffness,
        when=lambda v: v.stiffness != 1,
    ),
    Threshold("in parallel", "spring.x", lambda v, x: 1 + x**2, initial=lambda v: 0.003),
)


def of(stiffness: float, cases: Cases = SECOND_SPRING, tolerance: float = 0.01) -> Effect:
    return find_effect("second_spring", cases, Spring(stiffness, tolerance))


def test_the_first_case_that_applies_gives_the_effect() -> None:
    assert of(inf) == Effect("second_spring", 0.0, 0.0, 0.0, "a rigid body has no spring")
    assert of(-2.0) == Effect(
        "second_spring", None, None, None, "softer than nothing", "never for -2"
    )
    assert of(3.0) == Effect("second_spring", 100.0, 100.0, 100.0, "twice 3")


def test_a_variant_that_is_not_solved_leaves_the_reason() -> None:
    found = of(0.0)
    assert found.percent is None and found.max_change == inf
    assert found.source == "not solved: the force without the effect is not positive"


@pytest.mark.parametrize(("tolerance", "x"), [(0.01, "0.1"), (0.04, "0.2"), (0.0001, "0.01")])
def test_a_threshold_is_the_root_of_the_change(tolerance: float, x: str) -> None:
    """x^2 = tolerance, to the two digits of the text; x is followed until the force has changed by
    half.
    """
    found = of(1.0, tolerance=tolerance)
    assert found.needs == f"above {100 * tolerance:g} % from spring.x = {x}"
    last = float(found.source.removeprefix("in parallel, tried up to "))
    assert 0.5**0.5 < last < 1.5**2 * 0.5**0.5


def test_ranges_beyond_a_threshold_in_which_the_change_is_small_again() -> None:
    """sin(x)/50 is above 1 % from pi/6 to 5 pi/6, and below -1 % from 7 pi/6 to 11 pi/6; three
    digits are given of all but the first.
    """
    wave = Threshold(
        "a wave", "x", lambda v, x: 1 + sin(x) / 50, initial=lambda v: 0.1, max_value=lambda v: 6.2
    )
    found = of(1.0, (wave,))
    assert found.needs == "above 1 % from x = 0.52, except from 2.62 to 3.67 and from 5.76 to 6.2"


def test_a_parameter_stops_where_nothing_is_solved() -> None:
    def ratio(v: Any, x: float) -> float:
        if x > 0.05:
            raise NotConverged("too stiff")
        return 1 + x**2

    found = of(1.0, (Threshold("in parallel", "x", ratio, initial=lambda v: 0.003),))
    assert found.needs == "x: below 1 % at all values that were tried"
    assert found.source.endswith("; beyond that not solved: too stiff")
    last = float(found.source.split("tried up to ")[1].split(";")[0])
    assert 0.05 / 1.1 < last <= 0.05  # steps shrink to factors of less than 1.1


def test_a_range_without_a_number() -> None:
    found = of(1.0, (Range("between springs", lambda v: (-0.1, 0.2, None)),))
    assert (found.percent, found.low, found.high) == (None, -10.0, 20.0)
    assert found.max_change == 20.0


def test_every_row_has_a_case_for_every_scene() -> None:
    """The last case of a row asks for nothing."""
    assert all(cases[-1].when(None) for cases in EFFECTS.values())


def deeper(delta: float) -> Config:
    return HALF_SPACE.model_copy(update={"loading": replace(HALF_SPACE.loading, delta=delta)})


def test_a_variant_is_solved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever result is asked for, and an equal config is the same variant."""
    solved = []
    original = variant_solver.states

    def count(scene: Any, **options: Any) -> Any:
        solved.append(scene)
        return original(scene, **options)

    monkeypatch.setattr(variant_solver, "states", count)
    solver = VariantSolver()
    force = solver.force(HALF_SPACE)
    assert solver.force(deeper(0.01)) == force == solver.rows(HALF_SPACE)[-1].force
    assert len(solved) == 1
    # Hertz: the force grows with the depth to the power 3/2; to the rounding of theory.
    assert solver.force(deeper(0.04)) == pytest.approx(8 * force, rel=1e-9)
    assert len(solved) == 2


def test_a_failure_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    attempts = []

    def fail(scene: Any, **options: Any) -> Any:
        attempts.append(scene)
        raise NotConverged("no equilibrium\n  at any depth")

    monkeypatch.setattr(variant_solver, "states", fail)
    solver = VariantSolver()
    for _ in range(2):
        with pytest.raises(NotConverged, match=r"^no equilibrium at any depth$"):
            solver.force(HALF_SPACE)
    assert len(attempts) == 1
