"""Contact methods compared: one answer, for any stiffness, from either solver.

HERTZ is the benchmark of test_hertz.py, W = 2 the layer in a frictionless wall of
test_layer_wall.py. References are layer theory and the converged forces of the benchmark; the
agreement of the methods needs none.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_forces import CUBE, CYLINDER_RADII
from benchmark_forces import CYLINDER_STEPS as FORCES
from click.testing import CliRunner
from scenes import BOX, CYLINDER, E_STAR, PARABOLOID, WALLED, scene, solve

from indent_sim.cli import commands
from indent_sim.fe.solve import uzawa
from indent_sim.model.state import State
from indent_sim.run import pipeline

METHODS = ("augmented_lagrangian", "uzawa", "active_set", "nitsche")
SOLVERS = ("condensed", "newton")
TEN_STEPS = {"delta": 0.01, "steps": 10}


def method(name: str, multiple: float | None = None, h: float = 0.01) -> dict[str, Any]:
    """Section `contact` with a stiffness of so many E*/h."""
    if multiple is None:
        return {"method": name}
    return {"method": name, "gamma" if name == "nitsche" else "epsilon_n": multiple * E_STAR / h}


def extrapolated(soft: list[State], stiff: list[State]) -> np.ndarray:
    """Forces for an infinite stiffness, from one and twice that; the error falls as 1/epsilon_n."""
    return np.array([2 * there.force - here.force for here, there in zip(soft, stiff, strict=True)])


# ---- one answer


@pytest.mark.parametrize(
    ("h", "tolerance"), [(0.004, 1.5e-3), pytest.param(0.002, 5e-4, marks=pytest.mark.verify)]
)
def test_methods_agree_on_the_cylinder(h: float, tolerance: float) -> None:
    """All five methods agree with one another and with the converged forces to 0.05 %.

    0.012 and 0.021 % were found. With h_contact = 0.002 sixteen elements are in the first contact
    radius; with thirteen it is 0.046 % there, and with eight 0.15 %.
    """
    assert scene(CYLINDER, mesh={"h_contact": h}).plan.prediction["dofs"] < 6000
    curves = [np.array([state.force for state in hertz(name, h)]) for name in METHODS]
    curves.append(extrapolated(hertz("penalty", h, 50.0), hertz("penalty", h, 100.0)))
    errors = np.array(curves) / FORCES - 1
    assert np.ptp(errors, axis=0).max() < tolerance
    assert np.abs(errors).max() < tolerance


@cache
def hertz(name: str, h: float, multiple: float | None = None, steps: int = 10) -> list[State]:
    """States of HERTZ on the cylinder."""
    loading = TEN_STEPS | {"steps": steps}
    return solve(
        scene(CYLINDER, contact=method(name, multiple, h), loading=loading, mesh={"h_contact": h})
    )


@pytest.mark.parametrize(
    ("h", "names"),
    [
        (0.03, ("augmented_lagrangian", "uzawa", "active_set")),
        pytest.param(0.02, METHODS, marks=pytest.mark.verify),
    ],
)
def test_methods_agree_on_the_cube(h: float, names: tuple[str, ...]) -> None:
    """All methods agree on one mesh of the cube, and with the converged force, to 0.3 %.

    There are three and a half elements in the contact radius.
    """

    def last(contact: dict[str, Any]) -> list[State]:
        return solve(scene(BOX, contact=contact, mesh={"h_contact": h}))

    forces = [last(method(name))[-1].force for name in names]
    forces.append(
        extrapolated(last(method("penalty", 50.0, h)), last(method("penalty", 100.0, h)))[-1]
    )
    assert np.ptp(forces) / CUBE < 3e-3
    assert np.abs(np.array(forces) / CUBE - 1).max() < 3e-3


# ---- against theory

TIPS = {
    "paraboloid": (PARABOLOID, 0.01, 0.004),
    "sphere": ({"shape": "sphere", "R": 1.0}, 0.01, 0.004),
    "cone": ({"shape": "cone", "half_angle": 70}, 0.1, 0.003),
}


def beside_theory(tip: str, name: str) -> tuple[np.ndarray, float, float]:
    """Relative errors of ten forces, and of a and p(0) (cone: p(a/2)) at the last, at W = 2."""
    indenter, delta, h = TIPS[tip]
    base = scene(
        WALLED,
        indenter=indenter,
        contact=method(name),
        mesh={"h_contact": h},
        loading={"delta": delta, "steps": 10},
    )
    assert base.plan.prediction["dofs"] < 6000
    assert base.plan.theory is not None and base.plan.theory.is_exact
    theory, states = base.plan.theory.solutions_at_depths(base.physics.deltas), solve(base)
    assert theory is not None
    forces = np.array(
        [state.force / exact.force - 1 for state, exact in zip(states, theory, strict=True)]
    )
    place = theory[-1].a / 2 if tip == "cone" else 0.0
    surface = states[-1].surface
    pressure = np.interp(place, surface.x, surface.pressure) / theory[-1].pressure(place)
    return forces, states[-1].a / theory[-1].a - 1, pressure - 1


@pytest.mark.parametrize("tip", TIPS)
def test_augmented_lagrangian_against_theory_at_every_step(tip: str) -> None:
    """The augmented Lagrangian has exact theory's force at every row, to 0.03 % (cone 0.1 %).

    h_contact is an eighth of the first radius (cone: a sixth), which leaves 0.01 % (0.03 %) there.
    p(0) to 0.5 % and a to 1 % are derivatives and a fraction of an element.
    """
    forces, radius, pressure = beside_theory(tip, "augmented_lagrangian")
    assert np.abs(forces).max() < (1e-3 if tip == "cone" else 3e-4)
    assert abs(radius) < 0.01
    assert abs(pressure) < 0.005


@pytest.mark.parametrize(
    ("tip", "name"),
    [
        ("paraboloid", "nitsche"),
        ("cone", "active_set"),
        *(
            pytest.param(tip, name, marks=pytest.mark.verify)
            for tip, name in (
                ("paraboloid", "active_set"),
                ("cone", "nitsche"),
                ("sphere", "active_set"),
                ("sphere", "nitsche"),
            )
        ),
    ],
)
def test_active_set_and_nitsche_against_theory(tip: str, name: str) -> None:
    """Active set and Nitsche's method have exact theory's force at every row, to 0.15 %.

    The set of nodal pressures ends at a node, which shows in the first row with eight elements in
    contact, six of the cone's; 0.08 and 0.06 % were found.
    """
    forces, radius, pressure = beside_theory(tip, name)
    assert np.abs(forces).max() < 1.5e-3
    assert abs(radius) < 0.01
    assert abs(pressure) < 0.005


@pytest.mark.parametrize("name", METHODS)
def test_hertz_at_every_step(name: str) -> None:
    """With free sides the augmented Lagrangian is right to 0.03 % and the others to 0.15 %.

    0.05 % were found; the radii have four digits, 0.3 % of the first.
    """
    states = hertz(name, 0.004)
    errors = np.array([state.force for state in states]) / FORCES - 1
    assert np.abs(errors).max() < (3e-4 if name == "augmented_lagrangian" else 1.5e-3)
    assert [state.a for state in states] == pytest.approx(CYLINDER_RADII, rel=0.01)


# ---- the parameter

DECADES = {"augmented_lagrangian": (-3, 0, 3), "uzawa": (0, 1, 3)}
FAR_DECADES = {"augmented_lagrangian": (-6, 6), "uzawa": (5,), "nitsche": (6,), "penalty": (6,)}


def three_steps(name: str, decade: int, solver: str) -> State:
    """Last state of HERTZ with a stiffness of 10^decade E*/h."""
    base = scene(
        CYLINDER,
        contact=method(name, 10.0**decade),
        solver={"method": solver},
        mesh={"h_contact": 0.01},
        loading={"delta": 0.01, "steps": 3},
    )
    return solve(base)[-1]


@pytest.mark.parametrize(
    ("name", "solver"),
    [
        pytest.param(
            name, solver, marks=[pytest.mark.verify] * ((name, solver) == ("uzawa", "newton"))
        )
        for name in DECADES
        for solver in SOLVERS
    ],
)
def test_stiffness_does_not_change_the_answer(name: str, solver: str) -> None:
    """The stiffness of a multiplier method changes the force by at most 0.1 %.

    The quadrature sees the kink of the bracket depending on the stiffness. The penetration is that
    of the mesh: over d decades p/epsilon_n would fall by 10^d, and it falls by less than 10^(d/3).
    """
    states = [three_steps(name, decade, solver) for decade in DECADES[name]]
    forces = np.array([state.force for state in states])
    assert np.ptp(forces) / forces.mean() < 1e-3
    assert np.abs(forces / FORCES[-1] - 1).max() < 1e-3
    depths = [state.penetration for state in states]
    assert max(depths) / min(depths) < 10.0 ** ((max(DECADES[name]) - min(DECADES[name])) / 3)


@pytest.mark.parametrize(
    ("name", "decade", "solver"),
    [
        (name, decade, solver)
        for name, decades in FAR_DECADES.items()
        for decade in decades
        for solver in SOLVERS
        if (name, solver) != ("nitsche", "condensed")
    ],
)
def test_stiffness_far_beyond_what_is_sensible(name: str, decade: int, solver: str) -> None:
    """Extreme stiffnesses still give the force to 0.1 %, through softer contacts.

    Newton's method alone fails at 1e6 E*/h. As many constraints as quadrature points make the
    surface a little too stiff.
    """
    assert three_steps(name, decade, solver).force == pytest.approx(FORCES[-1], rel=1e-3)


def test_a_multiplier_that_does_not_settle_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Uzawa's iteration far below E*/h ends with a reason and without a number."""
    monkeypatch.setattr(uzawa, "MAX_ITERATIONS", 15)
    (state,) = pipeline.states(
        scene(CYLINDER, contact=method("uzawa", 1e-5), mesh={"h_contact": 0.05})
    )
    assert not state.converged
    assert np.isnan(state.force)
    assert "uzawa did not converge" in state.reason and "does not converge" in state.reason


@pytest.mark.parametrize(
    ("name", "multiple", "says"),
    [
        ("nitsche", 1e4, "oscillate"),
        ("penalty", 1e4, "oscillate"),
        ("penalty", 1.0, "too low"),
        ("penalty", 1e-3, "penetrates"),
    ],
)
def test_plan_warns_of_a_stiffness_that_spoils_the_answer(
    name: str, multiple: float, says: str
) -> None:
    warnings = scene(
        CYLINDER, contact=method(name, multiple), mesh={"h_contact": 0.01}
    ).plan.warnings
    assert any(says in warning for warning in warnings)
    plain = scene(CYLINDER, contact=method(name), mesh={"h_contact": 0.01}).plan.warnings
    assert len(warnings) == len(plain) + 1


def test_active_set_has_no_parameter(tmp_path: Path) -> None:
    """A parameter of the active set is refused with exit code 3 and its key."""
    config = tmp_path / "scene.yaml"
    config.write_text(
        "body: {shape: cylinder, radius: 1.0, height: 1.0}\nmaterial: {model: "
        "linear_elastic, E: 1.0, nu: 0.3}\n"
        "indenter: {shape: paraboloid, R: 1.0}\nloading: {delta: 0.01}\n"
        "contact: {method: active_set, epsilon_n: 10.0}\n"
    )
    result = CliRunner().invoke(commands.program, ["plan", str(config)])
    assert result.exit_code == 3
    assert "epsilon_n" in result.output + result.stderr


# ---- work


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", ["augmented_lagrangian", "active_set"])
def test_ten_steps_in_fifty_iterations(name: str, solver: str) -> None:
    """Ten increments take at most 50 iterations and end where one increment does, to 1e-8.

    At h_contact = 0.005 there are twenty elements in the last radius.
    """
    base = {"contact": method(name), "solver": {"method": solver}, "mesh": {"h_contact": 0.005}}
    states = solve(scene(CYLINDER, loading=TEN_STEPS, **base))
    assert sum(state.newton_iterations for state in states) <= 50
    assert solve(scene(CYLINDER, **base))[-1].force == pytest.approx(states[-1].force, rel=1e-8)


@pytest.mark.parametrize(
    ("solver", "finest"),
    [
        ("condensed", 0.0025),
        ("newton", 0.005),
        pytest.param("newton", 0.0025, marks=pytest.mark.verify),
    ],
)
def test_a_step_takes_no_more_iterations_on_a_finer_mesh(solver: str, finest: float) -> None:
    """From the third increment on, two or three iterations suffice on coarse and fine meshes.

    With an extrapolated edge two thirds of its motion off, each halving took one more iteration.
    """
    for h in (0.01, finest):
        states = solve(
            scene(CYLINDER, loading=TEN_STEPS, solver={"method": solver}, mesh={"h_contact": h})
        )
        assert sum(state.newton_iterations for state in states[2:]) <= 2.5 * len(states[2:])


@pytest.mark.parametrize("name", ["uzawa", "nitsche", "penalty"])
def test_one_step_or_ten_by_the_other_methods(name: str) -> None:
    """One increment or ten give the same force to 1e-8, and to 1e-7 by Uzawa's iteration.

    It stops at 1e-8 of its multiplier.
    """
    one, ten = (hertz(name, 0.01, None, steps)[-1].force for steps in (1, 10))
    assert one == pytest.approx(ten, rel=1e-7 if name == "uzawa" else 1e-8)


# ---- smooth results


def rise(r: np.ndarray, pressure: np.ndarray) -> float:
    """Largest rise of the pressure outwards, relative to its peak."""
    p = pressure[np.argsort(r)]
    return float(np.maximum(p - np.minimum.accumulate(p), 0.0).max() / p.max())


@pytest.mark.parametrize("h", [0.01, 0.005])
@pytest.mark.parametrize("name", METHODS)
def test_pressures_on_the_cylinder_do_not_oscillate(name: str, h: float) -> None:
    """Pressures on the cylinder fall outwards, up to 1 % of the peak."""
    surface = hertz(name, h)[-1].surface
    assert rise(surface.x, surface.pressure) < 0.01


@pytest.mark.parametrize(
    ("name", "h"),
    [
        ("augmented_lagrangian", 0.02),
        ("active_set", 0.02),
        pytest.param("nitsche", 0.02, marks=pytest.mark.verify),
        pytest.param("uzawa", 0.02, marks=pytest.mark.verify),
        pytest.param("augmented_lagrangian", 0.01, marks=pytest.mark.verify),
    ],
)
def test_pressures_along_the_axes_of_the_cube_do_not_oscillate(name: str, h: float) -> None:
    """Pressures along the axes of the cube fall outwards, up to 1 % of the peak.

    There are five elements in the radius, as `auto` takes.
    """
    surface = solve(scene(BOX, contact=method(name), mesh={"h_contact": h}))[-1].surface
    x, y = surface.x - 1.0, surface.y - 1.0
    for on_axis, distance in ((np.abs(y) < 1e-9, np.abs(x)), (np.abs(x) < 1e-9, np.abs(y))):
        assert rise(distance[on_axis], surface.pressure[on_axis]) < 0.01


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.verify] * (name in ("uzawa", "nitsche")))
        for name in METHODS
    ],
)
def test_contact_radius_grows_without_stairs(name: str) -> None:
    """The contact radius grows smoothly while the edge passes through elements.

    In eighty small increments the edge crosses two elements. A radius read off at nodes would stay
    for a dozen increments and then jump by half an element; this one is never off by more than a
    twelfth of an element, nor do neighbours differ by more than a tenth.
    """
    h = 0.01
    base = scene(
        WALLED,
        contact=method(name),
        mesh={"h_contact": h},
        loading={"deltas": np.linspace(0.006, 0.01, 81).tolist()},
    )
    theory = base.plan.theory.solutions_at_depths(base.physics.deltas)
    off = (
        np.array([state.a - exact.a for state, exact in zip(solve(base), theory, strict=True)]) / h
    )
    assert np.abs(off).max() < 1 / 12
    assert np.abs(np.diff(off)).max() < 0.05
