"""Scenes of the verification tests, and functions that solve them."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.mesh import gmsh
from indent_sim.mesh.grid import Grid
from indent_sim.model.contact import Penalty
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.model_selection import variant_solver
from indent_sim.run.previous_rows import PreviousRows
from indent_sim.run.sanity_checks import violated_bound
from indent_sim.scene.scene import Scene, resolve

CYLINDER = {"shape": "cylinder", "radius": 1.0, "height": 1.0, "base": "fixed", "sides": "free"}
WALLED = CYLINDER | {"radius": 2.0, "sides": "roller"}  # a layer in a frictionless cylinder, W = 2
STRIP = {"shape": "strip", "width": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"}
BOX = {"shape": "box", "size": [2.0, 2.0, 1.0], "base": "fixed", "sides": "free"}

ELASTIC = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
PARABOLOID = {"shape": "paraboloid", "R": 1.0}
E_STAR = 1.0 / (1 - 0.3**2)  # of ELASTIC
ONE_STEP = {"delta": 0.01, "steps": 1}
PENALTY = {"method": "penalty"}


def scene(body: dict[str, Any], *overrides: str, **sections: Any) -> Scene:
    """ELASTIC under a PARABOLOID pushed in by 0.01 in one step.

    `sections` replace whole sections of that.
    """
    given = {
        "body": body,
        "material": ELASTIC,
        "indenter": PARABOLOID,
        "loading": ONE_STEP,
    } | sections
    return resolve(config_from_mapping(given, overrides))


def placed(sections: dict[str, Any]) -> dict[str, Any]:
    """Sections of a scene with `relaxation` and the history moved out of `experiment`.

    Tests write them there for short; they belong in the material and in place of the loading.
    """
    given = dict(sections)
    experiment = dict(given.pop("experiment", {}))
    is_moved = {"relaxation", "history", "force_history"} & {*experiment}
    if "relaxation" in experiment:
        given, body = copy.deepcopy(given), copy.deepcopy(given["body"])
        parts = [given, *(body.get("layers") or []), *(body.get("inclusions") or [])]
        for part in (part for part in parts if "material" in part):
            part["material"] = part["material"] | {"relaxation": experiment["relaxation"]}
        given["body"] = body
        del experiment["relaxation"]
    path = {key: experiment.pop(key) for key in ("history", "force_history") if key in experiment}
    kept = (
        {"experiment": experiment}
        if experiment or ("experiment" in sections and not is_moved)
        else {}
    )
    return given | ({"loading": path} if path else {}) | kept


def with_penalty(base: Scene, epsilon_n: float) -> Scene:
    """The same scene by the penalty method of this stiffness [E/height of the body]."""
    return base.replace_physics(contact=Penalty(epsilon_n=epsilon_n))


def grid_of(base: Scene) -> Grid:
    """The mesh of a scene as gmsh makes it."""
    return gmsh.build_mesh(base.physics.domain, base.sizes)


def meshed(base: Scene) -> Any:
    """The mesh of a scene as the solver takes it, on this process alone."""
    from mpi4py import MPI

    from indent_sim.fe import solver

    return solver.distribute_scene(base, grid_of(base), MPI.COMM_SELF)


def solve(base: Scene) -> list[State]:
    """All states of a scene in the user's units, every one converged, audited and possible."""
    states = list(pipeline.states(base))
    assert len(states) == len(base.physics.deltas)
    largest = max(abs(state.force) for state in states)
    attraction = base.physics.scales.to_user_units(base.physics.contact).adhesion
    for k, state in enumerate(states):
        assert state.converged, state.reason
        assert_audited(state, largest, attraction.work * state.a if attraction else 0.0)
        assert violated_bound(base, state, PreviousRows(states[:k])) is None
    return states


def solved(base: Scene) -> list[State]:
    """The states of `solve`, computed once for all tests that compare with this scene.

    Tests that change how scenes are solved must not use it.
    """
    identity = pickle.dumps((base.physics, base.sizes, base.solver))
    if identity not in _solved:
        _solved[identity] = solve(base)
    return _solved[identity]


_solved: dict[bytes, list[State]] = {}


def force(base: Scene) -> float:
    """The force at the last depth."""
    return solve(base)[-1].force


def assert_audited(state: State, largest: float, pull: float = 0.0) -> None:
    """Assert that the supports take the force of the contact.

    Newton's tolerance of 1e-10 leaves at most 1e-8 of the force, or of the attraction of a tip that
    adheres while as much pushes. A body that is let go of has no force of its own, so there 1e-14
    of the largest force of the path is round-off.
    """
    tolerance = 1e-8 * max(abs(state.force), pull) + 1e-14 * largest
    assert abs(state.force - state.reaction) <= tolerance
    assert state.stray_reaction <= tolerance


def state_on(base: Scene, grid: Any) -> Any:
    """Last state of a scene on a given grid.

    All cells belong to the first region where the scene has only one.
    """
    from mpi4py import MPI

    from indent_sim.fe import solver

    part = base.physics.domain
    regions = np.minimum(grid.regions, len(part.regions) - 1)
    mesh = solver.distribute(dataclasses.replace(grid, regions=regions), part, MPI.COMM_SELF)
    *_, last = solver.create_load_stepper(base, mesh).states(base.physics.path, lambda step: False)
    return last.to_user_units(base.physics.scales)


def count_solutions(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Scenes that `require` solves from now on, in words: problem, elements, solver, history."""
    solved: list[str] = []

    def wrap(solve: Any) -> Any:
        def wrapped(scene: Scene, **options: Any) -> Any:
            parts = ("physics", "sizes", "solver", "experiment", "history_on_curve", "relaxation")
            solved.append(" ".join(repr(getattr(scene, part)) for part in parts))
            return solve(scene, **options)

        return wrapped

    for name in ("states", "condense"):
        monkeypatch.setattr(variant_solver, name, wrap(getattr(variant_solver, name)))
    return solved
