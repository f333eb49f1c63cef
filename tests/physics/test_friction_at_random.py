"""Random scenes with friction or adhesion: numbers of increments agree within error bars."""

from __future__ import annotations

from itertools import combinations, count, islice
from math import isfinite, nan, pi, radians, tan
from random import Random
from typing import Any

import numpy as np
import pytest
from scenes import scene, solve

from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import CoarserRun, coarser_scene
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.error_estimation.step_refinement import step_refinement
from indent_sim.scene.scene import Scene

SCENES, STICKY = 5, 5  # 20 s of CPU each; 120 and 80 told no more of the bars
READ = ("force", "a", "p_max", "stick_radius")  # off the row itself; heat is that since rest


class Drawn:
    """A random scene with the depths at which its tip turns.

    The sections are those that all its numbers of increments share.
    """

    def __init__(self, number: int):
        self.draw = Random(3000 + number)
        nu = self.draw.choice([0.0, 0.3, 0.45, 0.5])
        self.tip, self.a, self.depth = self._tip(0.05 * 4 ** self.draw.random())
        self.sections: dict[str, Any] = {
            "body": self._body(),
            "material": {
                "model": self.draw.choice([*["linear_elastic"] * 4, "neo_hookean"]),
                "E": 1.0,
                "nu": nu,
            },
            "indenter": self.tip,
            "contact": self._contact(nu),
            "mesh": {"h_contact": self.a / self.draw.uniform(5, 9)},
        }
        self.back = self.draw.choice(
            [0.0, 0.0, self.draw.uniform(0.2, 0.8)]
        )  # share of the depth it comes back to

    def _tip(self, a: float) -> tuple[dict[str, Any], float, float]:
        """A tip, its contact radius, and about the depth of that radius."""
        cone, round_tip = self.draw.uniform(75, 87), a**2
        sharp: dict[str, Any] = {"shape": "flat_punch", "radius": a}
        return self.draw.choice(
            [
                ({"shape": "paraboloid", "R": 1.0}, a, round_tip),
                ({"shape": "sphere", "R": 1.0}, a, round_tip),
                ({"shape": "cone", "half_angle": cone}, a, pi / 2 * a * tan(radians(90 - cone))),
                (sharp, a, 0.05 * a),
                (sharp | {"edge_radius": 0.2 * a}, a, 0.05 * a),
            ]
        )

    def _body(self) -> dict[str, Any]:
        height, sides = self.draw.uniform(0.15, 1.0), self.draw.choice(["roller", "free", "fixed"])
        return self.draw.choice(
            [
                {"shape": "half_space"},
                {
                    "shape": "cylinder",
                    "radius": 2.0,
                    "height": 2.0,
                    "base": "fixed",
                    "sides": sides,
                },
                {
                    "shape": "cylinder",
                    "radius": 2.0,
                    "height": height,
                    "base": "fixed",
                    "sides": sides,
                },
                {"shape": "strip", "width": 4.0, "height": height, "base": "fixed", "sides": sides},
                {"shape": "cap", "base_radius": 2.0, "height": 1.0},
            ]
        )

    def _contact(self, nu: float) -> dict[str, Any]:
        friction = self.draw.choice(["stick", *[10 ** self.draw.uniform(-1.5, 0)] * 3])
        method = self.draw.choice(["augmented_lagrangian", "augmented_lagrangian", "penalty"])
        return {"method": method, "friction": friction}

    def adhesive(self) -> Drawn | None:
        """The scene with adhesion in place of friction, over 0.3 to 1 of JKR's pull-off depth.

        None where JKR does not cover it or elements do not resolve the adhesion.
        """
        tip, material = (
            self.sections["indenter"],
            self.sections["material"] | {"model": "linear_elastic"},
        )
        if self.sections["body"]["shape"] == "strip" or tip["shape"] not in (
            "paraboloid",
            "sphere",
        ):
            return None
        work = 10 ** self.draw.uniform(-4.3, -3.3)
        way = (pi**2 * (work * (1 - material["nu"] ** 2)) ** 2) ** (1 / 3)
        contact = {"adhesion": {"work": work, "range": way * self.draw.uniform(0.3, 1.0)}}
        self.sections |= {"contact": contact, "material": material}
        try:
            self.scene(1)
        except ConfigError:
            return None
        return self

    def scene(self, steps: int) -> Scene:
        """The scene with so many increments to each of its turning points."""
        part = np.linspace(0, 1, steps + 1)[1:]
        back = 1 - (1 - self.back) * part if self.back else []
        return scene(
            loading={"deltas": [float(self.depth * x) for x in (*part, *back)]}, **self.sections
        )


def judged(base: Scene) -> list[State]:
    """Rows of a scene with their error bars."""
    ratio, other = coarser_scene(base)
    companion = CoarserRun(ratio, solve(other), other)
    bars = ErrorBars(base, companion, None, step_refinement(companion, solve))
    return [bars.add_error_estimate(state) for state in solve(base)]


def sticky(number: int) -> Drawn:
    """The adhesive scene of this number."""
    there = (one for k in count(SCENES) if (one := Drawn(k).adhesive()))
    return next(islice(there, number, None))


def found(base: Scene) -> dict[str, tuple[float, float]]:
    """Numbers of the last row and the dissipation since rest, each with its error.

    p_max under an edge or an apex may have no error, because coarser meshes may not know it.
    """
    rows = judged(base)
    last, is_round = rows[-1], not base.physics.indenter.slope_discontinuities()
    known = [
        name for name in READ if name != "p_max" or is_round or isfinite(last.p_max_error or nan)
    ]
    numbers = {name: (getattr(last, name), getattr(last, f"{name}_error")) for name in known}
    lost, unsure = (
        sum(getattr(row, name) for row in rows) for name in ("dissipation", "dissipation_error")
    )
    return numbers | {"dissipation": (lost, unsure)}


@pytest.mark.verify
@pytest.mark.parametrize("number", range(SCENES))
def test_a_row_does_not_depend_on_its_steps(number: int) -> None:
    """Results with 1, 4 and 16 increments per branch agree within the sum of their error bars."""
    agree([found(Drawn(number).scene(steps)) for steps in (1, 4, 16)])


@pytest.mark.verify
@pytest.mark.parametrize("number", range(STICKY))
def test_a_row_of_a_tip_that_adheres_does_not_either(number: int) -> None:
    """Force and radius of an adhesive tip agree for 1, 4 and 16 increments.

    The tip may snap in on the way, and hold on farther out.
    """
    drawn = sticky(number)
    lasts = [judged(drawn.scene(steps))[-1] for steps in (1, 4, 16)]
    agree([{"force": (row.force, row.force_error), "a": (row.a, row.a_error)} for row in lasts])


def agree(rows: list[dict[str, tuple[Any, Any]]]) -> None:
    for one, other in combinations(rows, 2):
        for name in one.keys() & other.keys():
            (value, error), (beside_it, its_error) = one[name], other[name]
            assert abs(value - beside_it) <= error + its_error, name
