"""The stability map in short: cells of configs/studies/extremes, against theory of that body.

A force within 0.5 % is right; any other must be covered by the error that the scene states. The
whole map is docs/stability.md.
"""

from __future__ import annotations

from typing import Any

import pytest
from scenes import ELASTIC, force, scene, solve

from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import Scene

TOLERANCE = 0.005
WIDE = {"shape": "cylinder", "radius": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"}
PUNCH = {"shape": "flat_punch", "radius": 0.1}
H = 0.01034  # ten elements in the contact radius at the depth 0.01


def layer(
    body: dict[str, Any] = WIDE, *, nu: float = 0.3, R: float = 1.0, **sections: Any
) -> Scene:
    """A layer between frictionless walls under a paraboloid, or with other sections."""
    tip = {"indenter": {"shape": "paraboloid", "R": R}}
    return scene(body, material=ELASTIC | {"nu": nu}, **tip | sections)


def stiffness(name: str, multiple: float, h: float = H) -> dict[str, Any]:
    """A method whose stiffness is a multiple of E*/h, and its mesh."""
    key = "gamma" if name == "nitsche" else "epsilon_n"
    return {"contact": {"method": name, key: multiple / (1 - 0.3**2) / h}, "mesh": {"h_contact": h}}


def once(delta: float) -> dict[str, Any]:
    """Loading to a depth in one increment."""
    return {"loading": {"delta": delta, "steps": 1}}


def error(base: Scene) -> float:
    """Force over that of exact theory minus 1, at the last depth."""
    theory = base.plan.theory.solution_at_depth(base.physics.deltas[-1])
    assert base.plan.theory.is_exact
    return solve(base)[-1].force / (theory.force * base.physics.scales.force) - 1


RIGHT: dict[str, Any] = {
    "incompressible, contact ten thicknesses wide": lambda: layer(
        WIDE | {"radius": 20.0}, nu=0.5, R=100.0, contact={"method": "active_set"}, **once(0.4)
    ),
    "nearly incompressible, three thicknesses": lambda: layer(
        WIDE | {"radius": 20.0}, nu=0.4999, R=100.0, **once(0.05)
    ),
    "depth of 1e-8 radii": lambda: layer(**once(1e-8)),
    "a layer of a hundredth of the radius": lambda: layer(
        WIDE | {"radius": 1.0, "height": 0.01}, **once(1e-4)
    ),
    "a contact of 3e-8 thicknesses": lambda: layer(R=0.1, **once(1e-14)),
    "a needle of one degree": lambda: layer(
        indenter={"shape": "cone", "half_angle": 1.0}, **once(1e-6)
    ),
    "a thousand radii thick": lambda: layer(WIDE | {"radius": 4e3, "height": 1e3}, **once(1.0)),
    "most of the thickness at once": lambda: layer(contact={"method": "penalty"}, **once(0.9)),
    "far too soft": lambda: layer(**stiffness("augmented_lagrangian", 1e-4)),
    "far too stiff": lambda: layer(**stiffness("augmented_lagrangian", 1e6)),
    "soft uzawa": lambda: layer(**stiffness("uzawa", 1e-2)),
    "stiff nitsche": lambda: layer(**stiffness("nitsche", 1e5)),
    "a punch up to the wall": lambda: layer(indenter=PUNCH | {"radius": 3.99}, **once(1e-3)),
    "a punch with a rounded edge": lambda: layer(
        indenter=PUNCH | {"edge_radius": 0.01}, contact={"method": "active_set"}, **once(1e-3)
    ),
    "released and pressed again": lambda: layer(loading={"deltas": [0.3, -1.0, 0.3]}),
    "a last contact of a thousandth of the first": lambda: layer(loading={"deltas": [0.3, 1e-6]}),
    "the same with a penalty": lambda: layer(
        loading={"deltas": [0.3, 1e-6]}, contact={"method": "penalty"}
    ),
    "a penalty on a thin incompressible layer": lambda: layer(
        WIDE | {"radius": 20.0}, nu=0.5, R=100.0, contact={"method": "penalty"}, **once(0.06)
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_right(name: str) -> None:
    assert abs(error(RIGHT[name]())) < TOLERANCE


FLAGGED: dict[str, Any] = {
    "a soft penalty": (lambda: layer(**stiffness("penalty", 1.0)), "too low"),
    "a far too soft penalty": (lambda: layer(**stiffness("penalty", 1e-4)), "too low"),
    "a penalty on a far thinner one": (
        lambda: layer(
            WIDE | {"radius": 20.0}, nu=0.5, R=100.0, contact={"method": "penalty"}, **once(0.4)
        ),
        "too low",
    ),
    "one and a half elements": (
        lambda: layer(contact={"method": "active_set"}, mesh={"h_contact": 0.069}),
        "only 1.5",
    ),
    "a coarse punch": (
        lambda: layer(indenter=PUNCH, mesh={"h_contact": 0.1}, **once(1e-3)),
        "at the punch's edge",
    ),
    "a stiff penalty on a squeezed layer": (
        lambda: layer(
            WIDE | {"radius": 20.0},
            nu=0.5,
            R=100.0,
            mesh={"h_contact": 0.3},
            **once(0.5),
            contact={"method": "penalty", "epsilon_n": 1.1e3 / (1 - 0.5**2) / 0.3},
        ),
        "too low",
    ),
    "a last depth that the mesh cannot see": (
        lambda: layer(loading={"deltas": [0.3, 1e-6]}, mesh={"h_contact": 0.0647}),
        "in the smallest one",
    ),
}


@pytest.mark.parametrize("name", FLAGGED)
def test_not_right_and_says_so(name: str) -> None:
    """A wrong force is covered by the stated error, and a warning names the reason."""
    make, words = FLAGGED[name]
    base = make()
    assert TOLERANCE < abs(error(base)) <= base.plan.prediction["force_error"]
    assert any(words in warning for warning in base.plan.warnings)


def test_a_penalty_deep_in_soft_rubber_states_enough() -> None:
    """The stated error of a penalty deep in soft rubber covers the true one.

    The rest of the layer stiffens, so that the tip sinks in farther than at small strain.
    Reference: a multiplier.
    """
    deep = {
        "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.4999},
        "indenter": {"shape": "sphere", "R": 1.0},
        "loading": {"delta": 0.7, "steps": 3},
        "mesh": {"h_contact": 0.06, "h_far": 0.3},
    }
    body = WIDE | {"radius": 2.0}
    penalty = scene(body, contact={"method": "penalty", "epsilon_n": 2e3}, **deep)
    lost = 1 - force(penalty) / force(scene(body, **deep))
    assert TOLERANCE < lost <= penalty.plan.prediction["force_error"]


def test_a_multiplier_at_finite_strain_bears_a_huge_stiffness() -> None:
    """An augmented Lagrangian with 1e6 E*/h gives the force of `auto`.

    Softer contacts lead to it, because the first increment would otherwise diverge.
    """
    sections = {
        "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "sphere", "R": 1.0},
        "loading": {"delta": 0.1, "steps": 2},
    }
    stiff = {"method": "augmented_lagrangian", "epsilon_n": 3.208e7}
    assert (
        abs(force(scene(WIDE, contact=stiff, **sections)) / force(scene(WIDE, **sections)) - 1)
        < TOLERANCE
    )


def test_elements_too_small_for_the_body_are_refused() -> None:
    """Elements too small for gmsh are refused, and a smaller body is accepted."""
    needle = {"shape": "cone", "half_angle": 1.0}
    with pytest.raises(ConfigError, match="use a smaller body"):
        layer(indenter=needle, **once(1e-9))
    layer(WIDE | {"radius": 4e-3, "height": 1e-3}, indenter=needle, **once(1e-9))


def test_a_curved_wall_in_three_dimensions() -> None:
    """A polygonal wall in three dimensions keeps an incompressible body within 0.5 % of theory."""
    walled = WIDE | {"radius": 1.0}
    assert (
        abs(
            force(layer(walled, nu=0.5, R=10.0, mesh={"symmetry": "quarter"}, **once(0.02)))
            / force(layer(walled, nu=0.5, R=10.0, **once(0.02)))
            - 1
        )
        < TOLERANCE
    )


def test_an_incompressible_body_held_on_all_sides_has_no_room() -> None:
    """A confined incompressible body refuses depths that cover its whole top.

    A paraboloid covers a disc of radius W at the depth W^2/(4 R), since the mean height stays 0.
    """
    with pytest.raises(ConfigError, match="is impossible for an incompressible body"):
        layer(WIDE | {"radius": 1.0}, nu=0.5, R=25.0, **once(0.0101))
    assert layer(WIDE | {"radius": 1.0}, nu=0.5, R=25.0, **once(0.0099)).physics.deltas == (0.0099,)
    assert layer(WIDE | {"radius": 1.0}, nu=0.4999, R=25.0, **once(0.0101)).physics.deltas == (
        0.0101,
    )
    assert layer(
        WIDE | {"radius": 1.0, "sides": "free"}, nu=0.5, R=25.0, **once(0.0101)
    ).physics.deltas == (0.0101,)


SIDES = {
    "cylinder": {"shape": "cylinder", "radius": 0.5, "height": 1.0, "sides": "fixed"},
    "strip": {"shape": "strip", "width": 1.0, "height": 1.0, "sides": {"x_max": "fixed"}},
    "box": {"shape": "box", "size": [3.0, 1.0, 1.0], "sides": {"y_min": "fixed"}},
}
BLUNT = {"shape": "paraboloid", "R": 1.25}  # meets all of these at 0.5^2/(2 R) = 0.1


@pytest.mark.parametrize("gap", ["reference", "current"])
@pytest.mark.parametrize("body", SIDES.values(), ids=SIDES)
def test_no_tip_moves_the_top_of_a_fixed_side(body: dict[str, Any], gap: str) -> None:
    """A tip that reaches the top of a fixed side is refused.

    u_z = 0 there, so that the surface would have to jump. The force grew with every refinement,
    while its error bar stayed a fifth of that.
    """
    scene = {"indenter": BLUNT, "contact": {"method": "auto", "gap": gap}}
    with pytest.raises(
        ConfigError, match=r"at the depth 0\.1 the tip touches the upper edge of a fixed side"
    ) as refused:
        layer(body, **scene, **once(0.101))
    assert refused.value.exit_code == 3 and refused.value.key == "loading"
    assert layer(body, **scene, **once(0.099)).physics.deltas[-1] > 0
    assert layer(body | {"sides": "free"}, **scene, **once(0.101)).physics.deltas[-1] > 0
    punch = {"indenter": {"shape": "flat_punch", "radius": 0.49}}
    assert layer(body, **punch, **once(0.101)).physics.deltas[-1] > 0


@pytest.mark.parametrize("center", [0.5, 0.4])
def test_a_tip_beside_the_middle_meets_one_side_first(center: float) -> None:
    """A tip off the middle meets the nearer fixed side at (1 - center)^2/(2 R)."""
    strip, tip = SIDES["strip"], BLUNT | {"center": [center]}
    meets = (1 - center) ** 2 / 2.5
    assert layer(strip, indenter=tip, **once(0.99 * meets)).physics.deltas[-1] > 0
    with pytest.raises(ConfigError, match="upper edge of a fixed side"):
        layer(strip, indenter=tip, **once(1.01 * meets))


@pytest.mark.parametrize(
    ("solver", "h"), [("condensed", H), ("newton", H), ("condensed", 5 * H), ("condensed", H / 3)]
)
def test_the_stiffness_of_an_augmented_lagrangian_is_no_matter_of_effort(
    solver: str, h: float
) -> None:
    """From 1e-2 to 1e2 E*/h the iterations at most double, with 2, 10 or 30 elements in contact."""
    spent = [
        solve(layer(solver={"method": solver}, **stiffness("augmented_lagrangian", m, h)))[
            -1
        ].newton_iterations
        for m in (1e-2, 0.1, 1.0, 10.0, 1e2)
    ]
    assert max(spent) <= 2 * min(spent)


def test_units_are_no_matter_of_effort() -> None:
    """Nanometres and terapascals take the iterations of kilometres and pascals."""
    states = [
        solve(
            scene(
                WIDE | {"radius": 4 * L, "height": L},
                material=ELASTIC | {"E": E},
                indenter={"shape": "paraboloid", "R": L},
                **once(0.01 * L),
            )
        )[-1]
        for L, E in ((1e-9, 1e12), (1e3, 1.0))
    ]
    assert states[0].newton_iterations == states[1].newton_iterations
    assert states[0].force / (1e12 * 1e-18) == pytest.approx(
        states[1].force / 1e6, rel=1e-9
    )  # 12 digits of the mesh
