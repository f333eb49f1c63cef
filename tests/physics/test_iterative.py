"""The iterative linear solver: the forces of factorizations, and few iterations on fine meshes."""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import BOX, ELASTIC, meshed, scene, solve

from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.iterative import Iterative
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.derived_quantities import DerivedQuantities
from indent_sim.run.error_estimation.coarser_run import CoarserRun, coarser_scene
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.error_estimation.no_slip_runs import solve_no_slip_effect
from indent_sim.run.single_run import backend
from indent_sim.scene.no_slip_effect import NoSlipEffect
from indent_sim.scene.scene import Scene

# What is left of the residual, seen through the stiffness: force and reaction agree to 1e-8 by the
# audit already
SAME = 1e-8
MESH = {"h_contact": 0.16, "h_far": 0.9}  # the two are one discrete problem, on whatever mesh
FINER = {"mesh": {"h_contact": 0.08, "h_far": 0.6}, "loading": {"delta": 0.02, "steps": 2}}
PRESSED = {"delta": 0.04, "steps": 2}
CUBE = {"shape": "box", "size": [1.0, 1.0, 1.0], "base": "fixed", "sides": "roller"}
NEO_HOOKEAN = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
RUBBER = {"model": "mooney_rivlin", "C10": 0.3, "C01": 0.1, "nu": 0.5}
BALL = {"indenter": {"shape": "sphere", "R": 0.5}, "loading": {"delta": 0.05, "steps": 2}}
STACK = [{"thickness": 0.2, "material": ELASTIC | {"E": 20.0, "nu": 0.4999}}, {"thickness": 0.8}]
ALONG_Z = {
    "model": "transversely_isotropic",
    "E": 1.0,
    "nu": 0.3,
    "E_z": 5.0,
    "nu_z": 0.2,
    "G_z": 1.0,
}
NUCLEUS = {
    "shape": "ball",
    "center": [1.0, 1.0, -0.4],
    "radius": 0.2,
    "material": ELASTIC | {"E": 10.0, "nu": 0.4999},
}

SCENES: dict[str, dict[str, Any]] = {
    "linear": {},
    "nearly incompressible": {"material": ELASTIC | {"nu": 0.4999}},
    "incompressible": {"material": ELASTIC | {"nu": 0.5}},
    "penalty": {"contact": {"method": "penalty"}},
    "uzawa": {"contact": {"method": "uzawa"}},
    "gap at the deformed point": {"contact": {"method": "auto", "gap": "current"}},
    "held by pins": {"body": BOX | {"base": "roller"}},
    "whole, off centre": {"indenter": {"shape": "paraboloid", "R": 1.0, "center": [1.1, 0.9]}},
    "stiff layer, mixed": {"body": BOX | {"layers": STACK}},
    "between weak walls": {
        "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0, "sides": "roller"},
        "indenter": {"shape": "paraboloid", "R": 1.0, "center": [0.1, 0.0]},
    },
    "stiffer along z": {"material": ALONG_Z},
    "neo-Hookean": BALL | {"body": CUBE, "material": NEO_HOOKEAN},
    "neo-Hookean, mixed": BALL | {"body": CUBE, "material": NEO_HOOKEAN | {"nu": 0.4999}},
    "unloading": {"loading": {"deltas": [0.02, 0.03, 0.01]}},
    "forces prescribed": {"loading": {"forces": [0.003, 0.006]}},
    "a soft ball inside": {
        "body": BOX | {"inclusions": [NUCLEUS | {"material": ELASTIC | {"E": 0.001, "nu": 0.5}}]},
        "mesh": {"h_contact": 0.1, "h_far": 0.6},
        "loading": {"delta": 0.03, "steps": 2},
    },
    "rubber": BALL | {"body": CUBE | {"sides": "free"}, "material": RUBBER},
}


def on(linear: str, sections: dict[str, Any]) -> Scene:
    """A scene on a small mesh by Newton's method with this linear solver."""
    given = {"body": BOX, "mesh": MESH, "loading": PRESSED} | sections
    return scene(given.pop("body"), solver={"method": "newton", "linear": linear}, **given)


# each has a like of it among the others: rubber and inclusions the mixed layer, the penalty Uzawa,
# the way back forces
LONG = {
    "neo-Hookean, mixed",
    "rubber",
    "a soft ball inside",
    "whole, off centre",
    "nearly incompressible",
    "penalty",
    "unloading",
    "held by pins",
}
# Finer meshes ask the multigrid, not the scene: one of each kind of unknowns, contact and path
ON_FINER_MESHES = (
    "linear",
    "incompressible",
    "uzawa",
    "stiff layer, mixed",
    "neo-Hookean, mixed",
    "unloading",
)


@pytest.mark.parametrize(
    ("name", "sections"),
    [
        *(
            pytest.param(name, {}, marks=[pytest.mark.verify] * (name in LONG), id=name)
            for name in SCENES
        ),
        *(
            pytest.param(name, FINER, marks=pytest.mark.verify, id=f"{name}, finer")
            for name in ON_FINER_MESHES
        ),
    ],
)
def test_the_force_is_that_of_a_factorisation(name: str, sections: dict[str, Any]) -> None:
    direct, iterative = (
        solve(on(linear, sections | SCENES[name])) for linear in ("direct", "iterative")
    )
    assert [state.force for state in iterative] == pytest.approx(
        [state.force for state in direct], rel=SAME
    )
    assert all(state.krylov_iterations for state in iterative)
    assert all(state.krylov_iterations is None for state in direct)


STIFF: dict[str, dict[str, Any]] = {
    "penalty": {"contact": {"method": "penalty", "epsilon_n": 1e6}},
    "augmented Lagrangian": {"contact": {"method": "augmented_lagrangian", "epsilon_n": 1e6}},
    "nearly incompressible": {
        "contact": {"method": "augmented_lagrangian", "epsilon_n": 1e5},
        "material": ELASTIC | {"nu": 0.4999},
    },
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.verify] * (name != "penalty")) for name in STIFF]
)
def test_force_and_stiffness_of_a_stiff_contact_are_those_of_a_factorisation(name: str) -> None:
    """Force and stiffness of a stiff contact are those of a factorization.

    The stiffness is solved until the energy of the residual is 1e-9. Judged by a norm of forces,
    which such a contact dominates, it was 1 to 10 per cent wrong.
    """
    sections = {
        "mesh": {"h_contact": 0.1, "h_far": 0.6},
        "loading": {"delta": 0.03, "steps": 1},
    } | STIFF[name]
    direct, iterative = (solve(on(linear, sections))[-1] for linear in ("direct", "iterative"))
    assert iterative.force == pytest.approx(direct.force, rel=SAME)
    assert iterative.stiffness == pytest.approx(direct.stiffness, rel=SAME)


def test_error_bars_are_those_of_factorisations() -> None:
    """Error bars are those of factorizations.

    They are differences of forces of about a hundredth, and the forces agree to 1e-8.
    """
    bars = []
    for linear in ("direct", "iterative"):
        base = on(
            linear,
            {"mesh": {"h_contact": 0.15, "h_far": 0.8}, "loading": {"delta": 0.04, "steps": 1}},
        )
        ratio, other = coarser_scene(base)
        bars.append(
            ErrorBars(base, CoarserRun(ratio, solve(other), other))
            .add_error_estimate(solve(base)[-1])
            .force_error
        )
    assert bars[0] and bars[1] == pytest.approx(bars[0], rel=1e-5)


def test_what_no_slip_would_change_is_solved_by_a_factorisation(monkeypatch: Any) -> None:
    """The no-slip effect is solved by a factorization, and not stated where memory is too small.

    The iterative solver does not support friction.
    """
    sections = {"mesh": {"h_contact": 0.2, "h_far": 0.8}, "loading": {"delta": 0.06, "steps": 1}}
    ways = ({"linear": "iterative"}, {"method": "condensed"})
    direct, iterative = (scene(BOX, **sections, solver=way) for way in reversed(ways))

    def found(base: Scene) -> NoSlipEffect | None:
        return solve_no_slip_effect(
            CoarserRun(1.0, solve(base), base), lambda other: list(pipeline.states(other))
        )

    expected, stick = found(direct), found(iterative)
    assert expected and stick and stick.percent == pytest.approx(expected.percent, rel=1e-6)
    monkeypatch.setattr("indent_sim.run.error_estimation.no_slip_runs.machine_memory", lambda: 1e8)
    assert found(iterative) is None


LARGE: dict[str, dict[str, Any]] = {
    "linear": {},
    "nearly incompressible": {"material": ELASTIC | {"nu": 0.4999}},
    "incompressible": {"material": ELASTIC | {"nu": 0.5}},
    "neo-Hookean": {
        "body": CUBE,
        "material": NEO_HOOKEAN,
        "indenter": {"shape": "sphere", "R": 0.25},
    },
}


@pytest.mark.verify
@pytest.mark.parametrize(
    ("name", "shrink"), [*((name, 1.0) for name in LARGE), ("nearly incompressible", 2.1)]
)
def test_the_force_is_that_of_a_factorisation_on_large_meshes(name: str, shrink: float) -> None:
    """The force is that of a factorization on meshes of 20 000 and 80 000 unknowns.

    Linear bodies are compared condensed, with another formulation of the contact.
    """
    h = (0.02 if name == "neo-Hookean" else 0.0185) / shrink
    mesh = {"h_contact": h, "h_far": 8 * h}
    given = {"body": BOX, "loading": {"delta": 0.01, "steps": 1}} | LARGE[name]
    direct, iterative = (
        solve(scene(**given, mesh=mesh, solver={"linear": linear}))[-1]
        for linear in ("direct", "iterative")
    )
    assert iterative.force == pytest.approx(direct.force, rel=SAME)


def krylov_per_newton(states: list[State]) -> float:
    """Mean number of Krylov iterations per linear system of a path."""
    return sum(state.krylov_iterations or 0 for state in states) / sum(
        state.newton_iterations for state in states
    )


def test_a_finer_mesh_takes_no_more_iterations() -> None:
    """Krylov iterations per Newton iteration grow by at most 30 % with eight times the unknowns.

    Multigrid bounds the count; the rest of the growth comes from the edge of the contact.
    """
    coarse, fine = (
        solve(on("iterative", {"mesh": {"h_contact": h, "h_far": 5 * h}})) for h in (0.1, 0.05)
    )
    assert krylov_per_newton(fine) <= 1.3 * krylov_per_newton(coarse)


def test_a_stiff_base_takes_no_more_iterations() -> None:
    """A contrast of layers does not raise the number of iterations.

    It once took ten times as many.
    """
    layers = [{"thickness": 0.5}, {"thickness": 0.5, "material": ELASTIC | {"E": 1e4}}]
    one, two = (solve(on("iterative", {"body": BOX | body})) for body in ({}, {"layers": layers}))
    assert krylov_per_newton(two) <= 1.3 * krylov_per_newton(one)


def test_every_iteration_is_counted() -> None:
    """All Krylov iterations are counted, those of the stiffness in its row."""
    base = on("iterative", {})
    walk = backend().create_load_stepper(base, meshed(base))
    readings = DerivedQuantities(base, walk.equilibrium)
    states = [
        readings.complete_state(state)
        for state in walk.states(base.physics.path, lambda step: False)
    ]
    assert (
        sum(state.krylov_iterations or 0 for state in states) == walk.equilibrium.statistics.krylov
    )


def test_a_worn_preconditioner_is_built_anew_before_a_step_fails(monkeypatch: Any) -> None:
    """An outdated preconditioner is rebuilt before an increment fails."""
    from indent_sim.fe.solve.multigrid import Multigrid

    base = on("iterative", {})
    walk, worn, apply, renew = (
        backend().create_load_stepper(base, meshed(base)),
        [False],
        Multigrid.apply,
        Multigrid.rebuild,
    )
    monkeypatch.setattr(
        Multigrid, "apply", lambda self, r, u: u.set(0.0) if worn[0] else apply(self, r, u)
    )
    monkeypatch.setattr(
        Multigrid, "rebuild", lambda self: (worn.__setitem__(0, False), renew(self))
    )
    found = []
    for state in walk.states(base.physics.path, lambda step: False):
        worn[0] = True
        found.append(state)
    assert [state.converged for state in found] == [True, True]
    assert [state.substeps for state in found] == [1, 1]


def test_multigrid_on_the_linear_elements(monkeypatch: Any) -> None:
    """Where linear elements are too many for a factorization, multigrid gives the same force.

    It takes at most 1.5 times the iterations.
    """
    from indent_sim.fe.solve import multigrid

    factored = solve(on("iterative", {}))
    monkeypatch.setattr(multigrid, "LARGEST_FACTORED", 0)
    aggregated = solve(on("iterative", {}))
    assert aggregated[-1].force == pytest.approx(factored[-1].force, rel=SAME)
    assert krylov_per_newton(aggregated) <= 1.5 * krylov_per_newton(factored)


def test_multigrid_renewed_is_multigrid_built_anew() -> None:
    """An updated multigrid cycle is one built anew, on all levels, after the contact has spread.

    The difference is that of the estimated spectrum of the smoother; a cycle of old levels differs
    by a half.
    """
    from indent_sim.fe import solver
    from indent_sim.fe.solve.blocks import DisplacementStiffness
    from indent_sim.fe.solve.multigrid import Multigrid

    base = on("iterative", {"contact": {"method": "penalty", "epsilon_n": 1e4}})
    problem = solver.create_equilibrium(base, meshed(base)).problem
    fine = DisplacementStiffness(problem, problem.unknowns.collapsed_space("u"), "sbaij")

    def cycle(multigrid: Multigrid) -> np.ndarray:
        load, found = fine.matrix.createVecs()
        load.array[:] = np.cos(np.arange(len(load.array)))
        multigrid.rebuild()
        multigrid.apply(load, found)
        return np.array(found.array_r)

    fine.assemble()
    old = Multigrid(problem, fine)
    untouched = cycle(old)
    problem.delta.value = 0.1
    fine.assemble()
    new = cycle(Multigrid(problem, fine))
    assert np.linalg.norm(cycle(old) - new) < 1e-2 * np.linalg.norm(new)
    assert np.linalg.norm(untouched - new) > 0.1 * np.linalg.norm(new)


def test_a_system_that_is_not_solved_is_no_step(monkeypatch: Any) -> None:
    """A path whose linear system is not solved ends with that reason, and has no such row."""
    from indent_sim.fe.solve import iterative

    monkeypatch.setattr(iterative, "MAX_KRYLOV_ITERATIONS", 1)
    state = list(pipeline.states(on("iterative", {})))[-1]
    assert not state.converged and "a linear system was not solved within" in state.reason
    assert "; solver.linear: direct may help" in state.reason


def test_the_discretisation_does_not_know_the_linear_solver() -> None:
    one, other = (on(linear, {}) for linear in ("direct", "iterative"))
    assert one.physics == other.physics and one.sizes == other.sizes
    assert meshed(one).hash == meshed(other).hash
    assert replace(one.solver, linear="iterative") == other.solver


@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_nothing_of_a_solution_stays(linear: str) -> None:
    """No problem and no solver outlives a solution.

    Python does not see circular references through PETSc, and a process may run a thousand scenes.
    """
    solve(on(linear, {}))
    gc.collect()
    assert not [one for one in gc.get_objects() if isinstance(one, Problem | Iterative)]
