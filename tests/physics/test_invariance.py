"""Invariance under units, modulus, increments and rigid motions; energy is work."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scenes import (
    BOX,
    CYLINDER,
    E_STAR,
    ELASTIC,
    PARABOLOID,
    PENALTY,
    STRIP,
    WALLED,
    grid_of,
    meshed,
    scene,
    solve,
    with_penalty,
)

from indent_sim.model.state import State

SAME = 1e-9  # the same equations but for round-off, which their solution amplifies by less than 1e5
NUMBERS = ("delta", "force", "a", "p_max", "penetration", "energy", "reaction")
COARSE = {"mesh": {"h_contact": 0.03}}
COARSE_BOX = {"mesh": {"h_contact": 0.1}, "loading": {"delta": 0.04, "steps": 2}}


def numbers(state: State) -> list[float]:
    """All numbers of a state."""
    return [getattr(state, name) for name in NUMBERS]


# ---- units

SHAPES = {
    "axisymmetric": (CYLINDER, COARSE | {"loading": {"delta": 0.01, "steps": 3}}),
    "current_gap": (CYLINDER, COARSE | {"contact": {"method": "auto", "gap": "current"}}),
    "penalty": (CYLINDER, COARSE | {"contact": PENALTY}),
    "newton": (CYLINDER, COARSE | {"solver": {"method": "newton"}}),
    "plane_strain": (STRIP, COARSE | {"loading": {"delta": 0.01, "steps": 3}}),
    "box": (BOX, COARSE_BOX),
}
LENGTHS = ("radius", "height", "width", "size", "R", "delta", "h_contact")
UNITS = {
    "nm_GPa": (1e9, 1e-9),
    "km_Pa": (1e-3, 1.0),
    "feet_psi": (3.280839895013123, 1 / 6894.757293168),
}


def in_other_units(section: dict[str, Any], length: float) -> dict[str, Any]:
    """Section of a config with its lengths in other units."""

    def converted(value: Any) -> Any:
        return [part * length for part in value] if isinstance(value, list) else value * length

    return {key: converted(value) if key in LENGTHS else value for key, value in section.items()}


@pytest.fixture(params=SHAPES, scope="module")
def reference(
    request: pytest.FixtureRequest,
) -> tuple[dict[str, Any], dict[str, Any], list[State], str]:
    """A scene in metres with E = 5 Pa: body, other sections, states and mesh."""
    body, sections = SHAPES[request.param]
    sections = sections | {"material": ELASTIC | {"E": 5.0}}
    base = scene(body, **sections)
    return body, sections, solve(base), grid_of(base).hash


@pytest.mark.parametrize("units", UNITS)
def test_units_do_not_matter(reference: Any, units: str) -> None:
    """Other units give the same mesh, the same iterations, and the same converted numbers."""
    body, sections, expected, mesh = reference
    length, pressure = UNITS[units]
    converted = {name: in_other_units(part, length) for name, part in sections.items()}
    converted["material"] = ELASTIC | {"E": 5.0 * pressure}
    converted["indenter"] = in_other_units(PARABOLOID, length)
    converted.setdefault("loading", {"delta": 0.01 * length, "steps": 1})
    other = scene(in_other_units(body, length), **converted)
    assert grid_of(other).hash == mesh
    force = pressure * length ** (1 if body["shape"] == "strip" else 2)
    scales = [length, force, length, pressure, length, force * length, force]
    for here, there in zip(expected, solve(other), strict=True):
        assert there.newton_iterations == here.newton_iterations
        assert np.divide(numbers(there), scales) == pytest.approx(numbers(here), rel=SAME)


@pytest.mark.parametrize("factor", [1e-6, 1e12])
def test_forces_are_proportional_to_the_modulus(reference: Any, factor: float) -> None:
    """Forces are proportional to the modulus from 5 uPa to 5 TPa."""
    body, sections, expected, _ = reference
    states = solve(scene(body, **sections | {"material": ELASTIC | {"E": 5.0 * factor}}))
    scales = [1.0, factor, 1.0, factor, 1.0, factor, factor]
    for here, there in zip(expected, states, strict=True):
        assert there.newton_iterations == here.newton_iterations
        assert np.divide(numbers(there), scales) == pytest.approx(numbers(here), rel=SAME)


# ---- the path


@pytest.mark.parametrize("shape", SHAPES)
def test_one_step_or_ten(shape: str) -> None:
    """One increment or ten give the same numbers without friction, to 1e-8.

    This is a hundred times Newton's tolerance.
    """
    body, sections = SHAPES[shape]
    depth = sections.get("loading", {"delta": 0.01})["delta"]
    once, many = (
        solve(scene(body, **sections | {"loading": {"delta": depth, "steps": n}}))[-1]
        for n in (1, 10)
    )
    assert many.force == pytest.approx(once.force, rel=1e-8)
    assert many.energy == pytest.approx(once.energy, rel=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_force_is_the_derivative_of_the_energy(shape: str) -> None:
    """The force is the central difference of the energy, to 1e-5.

    The difference over delta (1 +- 1e-3) has an error of 1e-7; the second derivative of the
    discrete energy jumps where a quadrature point comes into contact.
    """
    body, sections = SHAPES[shape]
    depth = sections.get("loading", {"delta": 0.01})["delta"]
    path = [depth * (1 - 1e-3), depth, depth * (1 + 1e-3)]
    before, here, after = solve(scene(body, **sections | {"loading": {"deltas": path}}))
    assert (after.energy - before.energy) / (path[2] - path[0]) == pytest.approx(
        here.force, rel=1e-5
    )


def test_flat_punch_is_linear() -> None:
    """The force of a flat punch is proportional to the depth, to Newton's tolerance."""
    base = scene(
        WALLED,
        indenter={"shape": "flat_punch", "radius": 0.5},
        mesh={"h_contact": 0.05},
        loading={"delta": 0.01, "steps": 4},
    )
    forces = np.array([state.force for state in solve(base)])
    assert forces / forces[-1] == pytest.approx(np.array([0.25, 0.5, 0.75, 1.0]), rel=SAME)


def test_gap_and_depth_scale_together() -> None:
    """A tip a hundred times blunter and shallower has the same contact and 1 % of the force.

    Small strain with the reference gap is homogeneous.
    """
    mesh = {"mesh": {"h_contact": 0.02}}
    sharp = with_penalty(scene(CYLINDER, **mesh), 1e4 * E_STAR)
    blunt = scene(
        CYLINDER, indenter=PARABOLOID | {"R": 100.0}, loading={"delta": 1e-4, "steps": 1}, **mesh
    )
    blunt = dataclasses.replace(with_penalty(blunt, 1e4 * E_STAR), sizes=sharp.sizes)
    one, other = solve(sharp)[-1], solve(blunt)[-1]
    assert 100 * other.force == pytest.approx(one.force, rel=SAME)
    assert other.a == pytest.approx(one.a, rel=SAME)


# ---- rigid motions


def rigid_motions(dim: int, axisymmetric: bool, X: np.ndarray) -> list[np.ndarray]:
    """All infinitesimal rigid motions (n, dim); those along the axis if axisymmetric."""
    shifts = [np.tile(direction, (len(X), 1)) for direction in np.eye(dim)]
    if axisymmetric:
        return shifts[1:]
    turns = []
    for i in range(dim):
        for j in range(i):
            turn = np.zeros_like(X)
            turn[:, i], turn[:, j] = X[:, j], -X[:, i]
            turns.append(turn)
    return shifts + turns


@pytest.mark.parametrize(
    ("body", "symmetry"),
    [(CYLINDER, "auto"), (STRIP, "full"), (BOX, "full")],
    ids=["axisymmetric", "plane_strain", "box"],
)
def test_rigid_motions_strain_nothing(body: dict[str, Any], symmetry: str) -> None:
    """Rigid motions cause no force at any dof and no energy, to round-off."""
    from indent_sim.fe import solver

    mesh = {"h_contact": 0.25, "h_far": 0.5, "symmetry": symmetry}
    base = scene(body, contact=PENALTY, mesh=mesh, solver={"method": "newton"})
    problem = solver.create_equilibrium(base, meshed(base)).problem
    problem.delta.value = -10.0  # a turn by 1 must not lift the body into the tip
    dim = base.physics.domain.kinematics.dim
    X = problem.unknowns.collapsed_space("u").tabulate_dof_coordinates()[:, :dim]
    for motion in rigid_motions(dim, base.physics.domain.symmetry == "axisymmetric", X):
        x = problem.x.copy()
        x.array[problem.unknowns.dofs("u")] = motion.ravel()
        problem.body.set_solution(x)
        problem.assemble_residual(problem.b)
        assert np.abs(problem.b.array).max() < 1e-12
        assert abs(problem.energy()) < 1e-12


@pytest.mark.parametrize("x", [3.3, 4.9])
def test_place_on_a_long_strip_does_not_matter(x: float) -> None:
    """The position on a long strip does not matter, to 2e-3.

    The ends of a bonded layer eight thicknesses long change less than 1e-3, and the mesh as much.
    """
    long = STRIP | {"width": 8.0}
    at_x, middle = (
        solve(scene(long, mesh={"h_contact": 0.01}, indenter=PARABOLOID | {"center": [c]}))[-1]
        for c in (x, 4.0)
    )
    assert at_x.force == pytest.approx(middle.force, rel=2e-3)
    assert at_x.a == pytest.approx(middle.a, abs=0.01 / 3)
