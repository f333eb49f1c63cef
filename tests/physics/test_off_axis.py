"""Cylinders in three dimensions: against the axisymmetric model, and with tips off the axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from scenes import CYLINDER, ELASTIC, PARABOLOID, WALLED, force, meshed, scene, solve

from indent_sim.fe import solver
from indent_sim.fe.terms.weak_roller import WeakRollerBC
from indent_sim.process.errors import ConfigError

DEEP = {"loading": {"delta": 0.09, "steps": 1}}
COARSE = 0.1  # h_contact: three elements in the contact radius of 0.33


@pytest.mark.parametrize("sides", ["free", "roller", "fixed"])
@pytest.mark.parametrize("base", ["fixed", "roller"])
def test_quarter_against_axisymmetric(base: str, sides: str) -> None:
    """A quarter of a cylinder has the axisymmetric force, to 0.5 %.

    This is the error of three elements in the radius; the polygonal wall encloses 0.7 % less than
    the circle, which changes the force by at most 0.1 %.
    """
    body = (WALLED if sides == "roller" else CYLINDER) | {"base": base, "sides": sides}
    flat = scene(body, **DEEP)
    whole = scene(body, mesh={"h_contact": COARSE, "symmetry": "quarter"}, **DEEP)
    assert flat.physics.domain.symmetry == "axisymmetric"
    assert (whole.physics.domain.symmetry, whole.physics.domain.symmetry_factor) == ("quarter", 4)
    assert force(whole) == pytest.approx(force(flat), rel=5e-3)


@pytest.mark.parametrize("symmetry", ["half", pytest.param("full", marks=pytest.mark.verify)])
def test_parts_of_a_cylinder_on_rollers(symmetry: str) -> None:
    """Half and full models on rollers are held by pins without reaction and agree to 0.5 %."""
    body = CYLINDER | {"base": "roller"}
    part, quarter = (
        scene(body, mesh={"h_contact": 0.15, "symmetry": s}, **DEEP) for s in (symmetry, "quarter")
    )
    assert len(part.physics.domain.pins) == {"half": 1, "full": 3}[symmetry]
    assert force(part) == pytest.approx(force(quarter), rel=5e-3)


def test_full_cylinder_between_rollers_may_turn() -> None:
    """A full cylinder between rollers has one pin, against rotation about z, without reaction."""
    base = scene(
        WALLED | {"radius": 1.0, "base": "roller"},
        mesh={"h_contact": 0.2, "symmetry": "full"},
        **DEEP,
    )
    assert len(base.physics.domain.pins) == 1
    assert solve(base)[-1].force > 0


def test_off_axis_is_on_axis_in_a_wide_cylinder() -> None:
    """A tip off the axis of a wide cylinder has the force of one on it, to 0.5 %.

    Four thicknesses from the rim the layer is infinite to 1e-4; the rest is the mesh.
    """
    wide = CYLINDER | {"radius": 6.0}
    beside = scene(
        wide, indenter=PARABOLOID | {"center": [0.0, -2.0]}, mesh={"h_contact": COARSE}, **DEEP
    )
    assert (beside.physics.domain.symmetry, beside.physics.domain.symmetry_factor) == ("half", 2)
    assert force(beside) == pytest.approx(force(scene(wide, **DEEP)), rel=5e-3)


@pytest.mark.verify
def test_off_axis_without_a_mirror_plane() -> None:
    """A tip off both coordinate axes takes the whole cylinder, with the force of the half model."""
    body = CYLINDER | {"radius": 1.5, "sides": "roller"}
    whole, half = (
        scene(body, indenter=PARABOLOID | {"center": center}, mesh={"h_contact": COARSE}, **DEEP)
        for center in ([0.3, 0.4], [0.5, 0.0])
    )
    assert (whole.physics.domain.symmetry, half.physics.domain.symmetry) == ("full", "half")
    assert force(whole) == pytest.approx(force(half), rel=5e-3)


def test_the_rim_is_softer_than_the_middle() -> None:
    """The force at half of the radius of a free cylinder is more than 1 % lower."""
    thick = CYLINDER | {"radius": 1.0, "height": 1.0}
    beside = scene(
        thick, indenter=PARABOLOID | {"center": [0.5, 0.0]}, mesh={"h_contact": COARSE}, **DEEP
    )
    assert force(beside) < 0.99 * force(scene(thick, **DEEP))


@pytest.mark.parametrize("h", [0.15, pytest.param(COARSE, marks=pytest.mark.verify)])
def test_a_curved_roller_wall_is_stiff_enough_and_not_too_stiff(h: float) -> None:
    """Ten times the stiffness of a weak roller wall changes a near tip's force by < 2e-4.

    Neither does the wall yield, nor does the normal that turns inside a facet lock the surface.
    """
    body = WALLED | {"radius": 1.0}
    base = scene(body, indenter=PARABOLOID | {"center": [0.5, 0.0]}, mesh={"h_contact": h}, **DEEP)
    assert [choice for choice in base.plan.choices if choice.key == "wall"]
    stiffer = base.replace_physics(wall_stiffness=10 * base.physics.wall_stiffness)
    assert force(stiffer) == pytest.approx(force(base), rel=2e-4)


def test_a_curved_wall_at_finite_strain_feels_how_far_it_moves_out() -> None:
    """A curved wall at finite strain resists |X + u| - |X| and no rotation.

    Rotation by 0.5 about the axis costs nothing, and a stretch by 0.1 what it costs at small
    strain.
    """
    energies = []
    for model in ("linear_elastic", "neo_hookean"):
        body = WALLED | {"radius": 1.0}
        sections = {"material": ELASTIC | {"model": model}, "solver": {"method": "newton"}}
        base = scene(body, mesh={"h_contact": 0.2, "h_far": 0.5, "symmetry": "full"}, **sections)
        problem = solver.create_equilibrium(base, meshed(base)).problem
        X, wall = (
            problem.unknowns.collapsed_space("u").tabulate_dof_coordinates(),
            WeakRollerBC(problem.body),
        )
        turn = np.array(
            [[np.cos(0.5), -np.sin(0.5), 0.0], [np.sin(0.5), np.cos(0.5), 0.0], [0.0, 0.0, 1.0]]
        )
        for image in (X @ turn.T, X * [1.1, 1.1, 1.0]):
            x = problem.x.copy()
            x.array[problem.unknowns.dofs("u")] = (image - X).ravel()
            problem.body.set_solution(x)
            energies.append(fem.assemble_scalar(fem.form(wall.energy)))
    _, small, turned, stretched = energies
    assert stretched == pytest.approx(small, rel=1e-12)
    assert abs(turned) < 1e-12 * stretched


def test_condensed_and_newton_agree_beside_the_axis() -> None:
    """The condensed and the full body agree with a weak wall and a tip off the axis, to 1e-9."""
    body = WALLED | {"radius": 1.0}
    tip = PARABOLOID | {"center": [0.4, 0.0]}
    forces = [
        force(scene(body, indenter=tip, mesh={"h_contact": 0.2}, solver={"method": method}, **DEEP))
        for method in ("condensed", "newton")
    ]
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)


@pytest.mark.parametrize(
    ("indenter", "symmetry", "fragment"),
    [
        (PARABOLOID | {"center": [0.3, 0.0]}, "axisymmetric", "not the cylinder's axis"),
        ({"shape": "pyramid", "half_angle": 70}, "axisymmetric", "a pyramid is not axisymmetric"),
        (PARABOLOID | {"center": [0.3, 0.0]}, "quarter", "symmetric only about"),
        (PARABOLOID | {"center": [0.3, 0.2]}, "half", "about no mid-plane"),
        ({"shape": "pyramid", "half_angle": 70, "rotation": 20}, "half", "about no mid-plane"),
        (PARABOLOID, "plane_strain", "not infinitely long"),
    ],
)
def test_wrong_symmetry_is_refused(indenter: dict[str, Any], symmetry: str, fragment: str) -> None:
    with pytest.raises(ConfigError, match=fragment):
        scene(CYLINDER, indenter=indenter, mesh={"symmetry": symmetry})


def test_a_tip_outside_the_cylinder_is_refused() -> None:
    with pytest.raises(ConfigError, match="outside"):
        scene(CYLINDER, indenter=PARABOLOID | {"center": [0.8, 0.8]})
