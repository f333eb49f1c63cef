"""Reference theories: of every tip, for prescribed forces, and evaluated only once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.body import Cylinder
from indent_sim.model.layers import Layer
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import (
    Cone,
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Pyramid,
    Sphere,
    max_radius,
)
from indent_sim.model.walled_bodies import Strip, StripSides
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.reference_theory import half_space_theory, layer_theory, relative_tip
from indent_sim.scene.scene import Scene, resolve
from indent_sim.scene.tip_theories import TIP_THEORIES, theory_tip_shape
from indent_sim.theory.contact_curve import ContactCurve
from indent_sim.theory.solution import Solution

GEL = LinearElastic(E=1.0, nu=0.3)
CYLINDER = Cylinder(2.0, 1.0, sides="roller")
STRIP = Strip(4.0, 1.0, sides=StripSides("roller", "roller"))
SHARP = {
    "paraboloid": Paraboloid(1.0),
    "sphere": Sphere(0.5),
    "cone": Cone(60.0),
    "flat_punch": FlatPunch(0.3),
}
OTHERS = {
    "blunt_cone": Cone(60.0, 0.1),
    "hyperboloid": Hyperboloid(0.2, 50.0),
    "rounded_punch": FlatPunch(0.3, 0.05),
    "pyramid": Pyramid(60.0),
    "profile": Profile(((0.0, 0.0), (0.1, 0.01), (0.5, 0.2))),
}
SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"deltas": [0.002, 0.02, 0.01]},
}


def scene(**sections: Any) -> Scene:
    """A paraboloid on a layer between frictionless walls; the middle of three depths is deepest."""
    return resolve(config_from_mapping(SCENE | sections))


def test_every_tip_is_in_the_table() -> None:
    """Every tip has a theory; a tip without one would have to be listed here."""
    assert set(get_args(Indenter)) - set(TIP_THEORIES) == set()


@pytest.mark.parametrize("tip", [*SHARP.values(), *OTHERS.values()], ids=[*SHARP, *OTHERS])
def test_theory_sees_the_tip_end_where_it_ends(tip: Indenter) -> None:
    shape = theory_tip_shape(tip)
    assert shape is not None
    assert max_radius(tip) == (shape.punch_radius or shape.max_radius)


@pytest.mark.parametrize("tip", SHARP.values(), ids=SHARP)
def test_layer_and_closed_form_agree_on_a_half_space(tip: Indenter) -> None:
    """Sneddon's integral of a tip gives the closed formula of its force."""
    theory, closed = (
        half_space_theory(tip, [Layer(None, GEL)]),
        half_space_force(tip, 0.01, GEL.E_star),
    )
    assert theory and closed and (solution := theory.solution_at_depth(0.01))
    assert solution.force == pytest.approx(closed[1], rel=1e-6)  # the layer adds about a/h = 1e-7


@pytest.mark.parametrize("body", [CYLINDER, STRIP], ids=["cylinder", "strip"])
@pytest.mark.parametrize("tip", SHARP.values(), ids=SHARP)
@pytest.mark.parametrize("delta", [1e-4, 0.05])
def test_the_depth_of_a_force_is_that_depth(
    tip: Indenter, body: Cylinder | Strip, delta: float
) -> None:
    theory = layer_theory(body, [Layer(body.height, GEL)], tip, body.center)
    assert theory and theory.is_exact and (solution := theory.solution_at_depth(delta))
    # both are searched to 1e-11 of the contact's size
    assert theory.depth_of_force(solution.force, 0.9) == pytest.approx(delta, rel=1e-9)


@pytest.mark.parametrize("delta", [1e-6, 1e-3, 0.1, 10.0])
def test_hyperboloid_on_a_half_space(delta: float) -> None:
    """A hyperboloid on a half-space has the force of Sneddon's integral by hand.

    F = E* cot [(a^2 - b^2) arctan(a/b) + a b] and delta = a cot arctan(a/b) with b = R cot. The
    terms cancel to (a/b)^3, here to 1e-9 of them at most: hence 1e-6; elsewhere 1e-9 is theory's
    own error.
    """
    R, slope = 0.2, 1 / np.tan(np.radians(50))
    theory = half_space_theory(Hyperboloid(R, 50.0), [Layer(None, GEL)], 2 * np.sqrt(R * delta))
    found = theory.solution_at_depth(delta) if theory and theory.is_exact else None
    assert found
    a, b = found.a, R * slope
    assert a * slope * np.arctan(a / b) == pytest.approx(delta, rel=1e-9)
    force = GEL.E_star * slope * ((a**2 - b**2) * np.arctan(a / b) + a * b)
    assert found.force == pytest.approx(force, rel=1e-6 if delta < 1e-4 else 1e-9)


def test_the_deepest_point_and_the_end_of_theory() -> None:
    theory = layer_theory(CYLINDER, [Layer(CYLINDER.height, GEL)], Sphere(0.05), CYLINDER.center)
    assert theory
    assert theory.depth_of_force(1e9, 0.9) is None or theory.solution_at_depth(
        0.9
    )  # the contact would be wider than the ball
    assert theory.depth_of_force(1e-6, 1e-6) == 1e-6


def test_plane_strain_knows_sharp_tips_alone() -> None:
    for name in ("blunt_cone", "rounded_punch", "profile"):  # a pyramid over a strip is no scene
        assert layer_theory(STRIP, [Layer(STRIP.height, GEL)], OTHERS[name], STRIP.center) is None


def test_half_space_forces_of_blunt_tips() -> None:
    """A tiny rounding leaves a cone's force, and a large one gives that of a sphere.

    A rounding of 1e-6 of the depth changes less than 1e-5.
    """
    found, closed = (
        half_space_force(Cone(60.0, 1e-7), 0.1, 1.0),
        half_space_force(Cone(60.0), 0.1, 1.0),
    )
    assert found and closed and found[1] == pytest.approx(closed[1], rel=1e-5)
    found, closed = (
        half_space_force(Cone(60.0, 2.0), 0.1, 1.0),
        half_space_force(Sphere(2.0), 0.1, 1.0),
    )
    assert found and closed and found[1] == pytest.approx(closed[1], rel=1e-10)
    assert half_space_force(Pyramid(60.0, faces=3), 0.1, 1.0) is None


@pytest.mark.parametrize(
    "sections",
    [
        {},
        {"contact": {"method": "penalty"}},
        {"accuracy": "fast"},
        {"contact": {"method": "penalty", "epsilon_n": 3.0}},
        {"body": {"shape": "half_space"}},
        {"material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3}},
    ],
    ids=["plain", "penalty", "accuracy", "soft", "half_space", "hyperelastic"],
)
def test_theory_solves_the_same_depths_once(
    monkeypatch: pytest.MonkeyPatch, sections: dict[str, Any]
) -> None:
    """Sizes, choices, warnings and prediction of one scene ask for the same contacts."""
    solved: Counter[tuple[ContactCurve, tuple[float, ...]]] = Counter()
    solve = ContactCurve.solutions_at_depths

    def counted(curve: ContactCurve, deltas: Sequence[float]) -> list[Solution]:
        solved[curve, tuple(deltas)] += 1
        return solve(curve, deltas)

    monkeypatch.setattr(ContactCurve, "solutions_at_depths", counted)
    found = scene(**sections)
    theory = found.plan.theory
    assert theory and set(solved.values()) == {1}
    depths = [deltas for curve, deltas in solved if curve == theory.contact]
    # A penalty that costs much wants eight contacts at the deepest depth and at the last one.
    assert 0 < sum(map(len, depths)) <= 3 + 2 * 8
    assert all(map(theory.solutions_at_depths, depths))
    assert set(solved.values()) == {1}


@pytest.mark.parametrize(
    ("tip", "R"),
    [(Paraboloid(1.0), 2 / 3), (Sphere(1.0), 2 / 3), (Plate(), 2.0), (FlatPunch(0.1), 2.0)],
)
def test_curvatures_add_over_a_round_body(tip: Indenter, R: float) -> None:
    """The relative curvature is the sum of those of tip and spherical body.

    A sharp tip keeps its own, and so does every tip over a flat top.
    """
    dome = SphericalBody(2.0, 1.0, "cap")
    assert relative_tip(tip, dome) == Paraboloid(pytest.approx(R))  # type: ignore[arg-type]
    assert relative_tip(tip, CYLINDER) is tip and relative_tip(Cone(70.0), dome) == Cone(70.0)


@pytest.mark.parametrize("shape", ["cap", "ball"])
def test_theory_of_a_round_body_is_never_exact(shape: Any) -> None:
    """Theory of a spherical body is Hertz with relative curvature, and is not exact.

    A contact of 1e-3 feels as much of the layer, hence 0.2 %.
    """
    body = SphericalBody(1e3, 1.0, "cap") if shape == "cap" else SphericalBody(1.0, 2.0, "ball")
    tip: Indenter = Paraboloid(1.0)
    theory = layer_theory(body, [Layer(body.height, GEL)], tip, body.center)
    closed = half_space_force(relative_tip(tip, body), 1e-6, GEL.E_star)
    assert (
        theory and not theory.is_exact and closed and (solution := theory.solution_at_depth(1e-6))
    )
    assert solution.force == pytest.approx(closed[1], rel=2e-3)
