"""Paths on which contact begins, ends, jumps, or slides to where no mesh line is.

Every method and both solvers are tried. The end of a path must not depend on the path: the
reference is the same depth reached in one step, or the other solver. Errors against theory are
tested elsewhere.
"""

from __future__ import annotations

from typing import Any

import pytest
from benchmark_forces import CYLINDER_STEPS as FORCES
from scenes import BOX, CYLINDER, PARABOLOID, STRIP, scene, solve

from indent_sim.model.state import State

PAIRS = [
    (name, solver)
    for name in ("augmented_lagrangian", "uzawa", "active_set", "nitsche", "penalty")
    for solver in ("condensed", "newton")
    if (name, solver) != ("nitsche", "condensed")
]
LONG = [("uzawa", "newton"), ("penalty", "newton")]
every_method = pytest.mark.parametrize(("name", "solver"), PAIRS)
TIGHT = {
    "uzawa": 1e-6
}  # its multiplier stops at 1e-8 of itself from either side; the others at 1e-10


def walk(
    name: str,
    solver: str,
    deltas: list[float],
    body: dict[str, Any] = CYLINDER,
    h: float = 0.02,
    **sections: Any,
) -> list[State]:
    """The states of a path of depths with a contact method and a solver."""
    return solve(
        scene(
            body,
            contact={"method": name},
            solver={"method": solver},
            loading={"deltas": deltas},
            mesh={"h_contact": h},
            **sections,
        )
    )


@every_method
def test_first_touch_at_a_node(name: str, solver: str) -> None:
    """Depth 0, tiny steps and then the whole depth at once end at the force of one step.

    At depth 0 the tip touches the node on the axis and nothing else: there is no force there, and
    none is negative afterwards.
    """
    states = walk(name, solver, [0.0, 1e-10, 1e-6, 0.01])
    (direct,) = walk(name, solver, [0.01])
    assert states[0].force == pytest.approx(0.0, abs=1e-20)
    assert 0 <= states[1].force <= states[2].force < 1e-8
    assert states[-1].force == pytest.approx(direct.force, rel=TIGHT.get(name, 1e-8))


@every_method
def test_from_no_contact_to_deep_at_once(name: str, solver: str) -> None:
    """From out of contact to a great depth at once has the force of one step from rest.

    The depth is a twentieth of the thickness.
    """
    outside, deep = walk(name, solver, [-0.01, 0.05])
    (direct,) = walk(name, solver, [0.05])
    assert (outside.force, outside.a, outside.p_max) == (0.0, 0.0, 0.0)
    assert deep.force == pytest.approx(direct.force, rel=TIGHT.get(name, 1e-8))
    assert deep.newton_iterations < 60


@every_method
def test_release_and_contact_again(name: str, solver: str) -> None:
    """Equal depths have equal forces after a release, and a released tip has no force.

    The force out of contact and at depth 0 is below 1e-20, where that in contact is 1e-3.
    """
    down, out, half, at_zero, again = walk(name, solver, [0.01, -0.01, 0.005, 0.0, 0.01])
    direct, _ = walk(name, solver, [0.005, 0.01])
    assert again.force == pytest.approx(down.force, rel=TIGHT.get(name, 1e-8))
    assert half.force == pytest.approx(direct.force, rel=TIGHT.get(name, 1e-8))
    assert [out.force, at_zero.force] == pytest.approx([0.0, 0.0], abs=1e-20)


def test_back_and_forth_in_small_steps() -> None:
    """A small step back and forth does not spoil the force at a depth between.

    The two equal depths before it must not be extrapolated.
    """
    down, _, again, between = walk(
        "augmented_lagrangian", "newton", [0.01, 0.0098, 0.01, 0.0099], h=0.03
    )
    assert again.force == pytest.approx(down.force, rel=1e-8)
    assert 0 < between.force < down.force


@pytest.mark.parametrize(
    ("name", "solver"),
    [pytest.param(*pair, marks=[pytest.mark.verify] * (pair in LONG)) for pair in PAIRS],
)
def test_a_punch_back_where_it_began(name: str, solver: str) -> None:
    """A punch back at depth 0 has no force, is found in few solves, and goes on in proportion.

    There every point of the surface is at the kink of the contact law. The force is below 1e-17 of
    the one before. Uzawa needs less than 100 solves, the other methods ten.
    """
    punch = {"shape": "flat_punch", "radius": 0.3, "center": [1.0]}
    down, back, deeper = walk(name, solver, [0.01, 0.0, 0.02], STRIP, 0.05, indenter=punch)
    assert abs(back.force) <= 1e-17 * down.force
    assert back.newton_iterations < 100
    assert deeper.force == pytest.approx(2 * down.force, rel=TIGHT.get(name, 1e-8))


@every_method
def test_two_elements_in_the_contact(name: str, solver: str) -> None:
    """With two elements in the contact, or one and a half, the force is that of theory within 3 %.

    A sixteenth of (h/a)^2 is expected; 2 % is found.
    """
    for state, expected in zip(
        walk(name, solver, [0.005, 0.01], h=0.05), (FORCES[4], FORCES[9]), strict=True
    ):
        assert state.force == pytest.approx(expected, rel=0.03)


SIDEWAYS = {
    "plane_strain": (STRIP, [1.2345], 0.02, [0.005, 0.01]),
    "box": (BOX, [1.2345, 0.8], 0.2, [0.03, 0.06]),
}
LONGER = ("uzawa", "penalty", "active_set")  # in three dimensions in `make verify`


@pytest.mark.parametrize(
    ("where", "name"),
    [
        pytest.param(where, name, marks=[pytest.mark.verify] * (where == "box" and name in LONGER))
        for where in SIDEWAYS
        for name in ("augmented_lagrangian", *LONGER)
    ],
)
def test_tip_off_the_middle(where: str, name: str) -> None:
    """A tip where no mesh line marks its axis has the same force with either solver, to 1e-9."""
    body, center, h, deltas = SIDEWAYS[where]
    tip = PARABOLOID | {"center": center}
    paths = (
        walk(name, solver, deltas, body, h, indenter=tip) for solver in ("condensed", "newton")
    )
    for one, other in zip(*paths, strict=True):
        assert one.force == pytest.approx(other.force, rel=1e-9)


def test_nitsche_off_the_middle_is_the_augmented_lagrangian() -> None:
    """Nitsche's method and the augmented Lagrangian agree to 0.1 % on one mesh.

    That is a tenth of the mesh error of 1 %.
    """
    tip = PARABOLOID | {"center": [1.2345]}
    one, other = (
        walk(name, "newton", [0.01], STRIP, 0.02, indenter=tip)[-1].force
        for name in ("nitsche", "augmented_lagrangian")
    )
    assert one == pytest.approx(other, rel=1e-3)
