"""The tip's work is what the body stores and what friction dissipates.

dPi = F ddelta - dissipation.
"""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from half_space_friction import A, rough
from scenes import PARABOLOID, scene, solve

from indent_sim.run.work_and_loops import energy_balance


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_dissipation_is_the_work_of_a_cycle(friction: float) -> None:
    """The dissipation of a cycle is the area of its loop to 3 %.

    With twenty steps each way the loop's area is 1.3 % of the work done on the way in, so the
    trapezoidal rule knows it to 3 %: 0.9 and 1.6 % were reached, and 0.2 and 0.4 % with forty
    steps.
    """
    depths = np.linspace(0.0, A**2, 21)
    path = [*depths[1:], *depths[-2::-1]]
    states = rough(friction, 0.0, {"deltas": list(map(float, path))}, mesh={"h_contact": A / 8})
    force, delta = (
        np.array([0.0, *values]) for values in ([state.force for state in states], path)
    )
    work = np.cumsum(np.diff(delta) * (force[1:] + force[:-1]) / 2)
    lost = np.cumsum([state.dissipation for state in states])
    assert lost[-1] == pytest.approx(work[-1], rel=0.03)
    assert states[-1].energy == pytest.approx(0.0, abs=1e-12 * work[19])
    assert states[19].energy + lost[19] == pytest.approx(
        work[19], rel=2e-3
    )  # of the rule on the way in
    assert energy_balance(states[:20]) == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize(
    "tip",
    [
        pytest.param(PARABOLOID, marks=pytest.mark.verify),
        {"shape": "cone", "half_angle": 70.0, "tip_radius": 0.1},
    ],
)
def test_energy_of_a_tip_that_adheres_at_finite_strain(tip: dict[str, object]) -> None:
    """With adhesion at finite strain the energy between two depths is the work of the tip.

    The depths are between jumps, the gap is that of the deformed point, and the work is Simpson's
    rule on 8 intervals.
    """
    body = {"shape": "cylinder", "radius": 3.0, "height": 1.5, "base": "fixed", "sides": "roller"}
    material = {"model": "neo_hookean", "E": 1.0, "nu": 0.4}
    depths = np.linspace(0.0, 0.12, 9)
    adhesion = {"work": 0.01, "range": 0.05}
    rows = solve(
        scene(
            body,
            material=material,
            indenter=tip,
            contact={"adhesion": adhesion},
            mesh={"h_contact": 0.04},
            loading={"deltas": [-0.05, *map(float, depths)]},
        )
    )[1:]
    simpson = np.array([1, 4, 2, 4, 2, 4, 2, 4, 1]) * (depths[1] - depths[0]) / 3
    work = float(simpson @ [row.force for row in rows])
    scale = (
        0.01 * pi * 0.3**2
    )  # the work of adhesion of the contact: what pushes and what pulls cancel in part
    assert rows[-1].energy - rows[0].energy == pytest.approx(work, abs=1e-3 * scale)
