"""The condensed body: numbers of the full Newton method, and one factorization for many tips."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import BOX, CYLINDER, ELASTIC, PARABOLOID, STRIP, WALLED, scene, solve

from indent_sim.config.scene_file import load
from indent_sim.fe.condensed import compliance, equilibrium
from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.model.tip_track import TipTrack
from indent_sim.model.tips import Paraboloid, Sphere
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import condense, states
from indent_sim.scene import solver_choices
from indent_sim.scene.scene import Scene, resolve

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
METHODS = ("augmented_lagrangian", "uzawa", "active_set", "penalty")
BODIES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "axisymmetric": (
        CYLINDER,
        {"mesh": {"h_contact": 0.03}, "loading": {"delta": 0.01, "steps": 3}},
    ),
    "plane_strain": (STRIP, {"mesh": {"h_contact": 0.03}, "loading": {"delta": 0.01, "steps": 2}}),
    "box": (
        BOX,
        {"mesh": {"h_contact": 0.15, "h_far": 0.6}, "loading": {"delta": 0.04, "steps": 2}},
    ),
    "mixed": (WALLED, {"mesh": {"h_contact": 0.04}, "material": ELASTIC | {"nu": 0.5}}),
}


def solved_by(method: str, base: Scene) -> Scene:
    """The same scene with another solver."""
    return replace(base, solver=replace(base.solver, method=method))


def assert_condensed_is_newton(base: Scene) -> None:
    """Assert that both solvers give the same force, radius and nodal pressures at every row.

    They solve one discrete problem, so that the difference is what Newton's tolerance of 1e-10
    leaves: 1e-9 of the path's largest pressure, and ten times that for the other columns. Uzawa's
    multiplier stops at 1e-8 of itself.
    """
    pressures = 1e-8 if base.physics.contact.method == "uzawa" else 1e-9
    condensed, newton = (solve(solved_by(solver, base)) for solver in ("condensed", "newton"))
    p_max = max(
        state.surface.pressure.max() for state in newton
    )  # a body let go of has round-off for pressures
    for one, other in zip(condensed, newton, strict=True):
        assert one.force == pytest.approx(other.force, rel=1e-9)
        assert one.a == pytest.approx(other.a, rel=1e-9)
        assert np.abs(one.surface.pressure - other.surface.pressure).max() <= pressures * p_max
        for name in ("p_max", "energy", "reaction"):
            assert getattr(one, name) == pytest.approx(
                getattr(other, name), rel=10 * pressures, nan_ok=True
            ), name
        assert one.penetration == pytest.approx(
            other.penetration, rel=10 * pressures, abs=10 * pressures * one.delta
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("body", BODIES)
def test_condensed_is_newton(body: str, method: str) -> None:
    shape, sections = BODIES[body]
    assert_condensed_is_newton(scene(shape, contact={"method": method}, **sections))


SHIPPED = sorted(path for path in CONFIGS.rglob("*.yaml") if "studies" not in path.parts)


def test_every_linear_config_is_condensed() -> None:
    """Every linear shipped config is condensed, unless it is path-dependent or has no mesh."""
    for path in SHIPPED:
        base = resolve(load(path))
        is_whole = base.is_meshed and base.solver.method != "condensed"
        assert (
            not is_whole
            or base.physics.depends_on_step_size
            or not base.physics.material.is_small_strain
        ), path


# Sharp and round tips, plane strain, a quarter and a half in three dimensions, friction, a mesh
# file, each method
@pytest.mark.verify
@pytest.mark.parametrize(
    "name",
    [
        "flat_punch",
        "plane_strain",
        "hertz_cube",
        "off_axis",
        "thin_gel_stick",
        "part_from_mesh",
        "notes/linear_penalty",
        "notes/linear_active_set",
    ],
)
def test_condensed_is_newton_on_shipped_configs(name: str) -> None:
    assert_condensed_is_newton(resolve(load(CONFIGS / f"{name}.yaml")))


@pytest.mark.parametrize("method", ["augmented_lagrangian", "uzawa", "active_set"])
def test_no_number_knows_the_candidates(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No number depends on the candidate nodes, whether many, all, or too few at first."""
    base = scene(CYLINDER, contact={"method": method}, mesh={"h_contact": 0.02})
    (expected,) = solve(base)
    for margin in (-5.0, 1000.0):
        monkeypatch.setattr(equilibrium, "CANDIDATE_MARGIN", margin)
        (found,) = solve(base)
        assert found.force == pytest.approx(expected.force, rel=1e-12)
        assert (
            np.abs(found.surface.pressure - expected.surface.pressure).max()
            <= 1e-11 * expected.p_max
        )


def test_another_tip_on_the_same_compliance_is_a_run_of_its_own():
    """Another tip on the same compliance gives the numbers of its own scene, to round-off."""
    base = scene(WALLED, "mesh.h_contact=0.02")
    body = condense(base)
    for tip, section in (
        (Sphere(1.0), {"shape": "sphere", "R": 1.0}),
        (Paraboloid(1.0), PARABOLOID),
    ):
        alone = scene(WALLED, "mesh.h_contact=0.02", indenter=section)
        (expected,) = states(type(alone)(**{**vars(alone), "sizes": base.sizes}))
        (found,) = body.states(tip)
        assert found.force == pytest.approx(expected.force, rel=1e-10)
        assert found.a == pytest.approx(expected.a, rel=1e-8)


def test_depths_come_in_the_order_asked_for_and_one_factorisation_serves_them_all():
    body = condense(scene(WALLED, "mesh.h_contact=0.02"))
    compliance = body.compliance
    deep, shallow = body.states(deltas=[0.01, 0.005])
    assert (deep.delta, shallow.delta) == (0.01, 0.005)
    assert deep.force > shallow.force > 0
    assert body.equilibrium.reuse_body(body.scene).contact.compliance is compliance


def test_forces_on_the_same_compliance():
    """Forces on the same compliance give back the depths of these forces.

    Each depth is found within 1e-10.
    """
    body = condense(scene(WALLED, "mesh.h_contact=0.02"))
    depths = [0.01, 0.002, 0.006]
    found = body.states(forces=[state.force for state in body.states(deltas=depths)])
    assert [state.delta for state in found] == pytest.approx(depths, rel=1e-9)
    with pytest.raises(ValueError, match="not both"):
        body.states(deltas=depths, forces=[0.01])


def test_a_scene_that_does_not_condense_is_refused():
    with pytest.raises(ConfigError, match="cannot be condensed"):
        condense(scene(WALLED, contact={"method": "nitsche"}))


def test_a_compliance_that_grows_is_the_one_solved_at_once() -> None:
    """A compliance extended by new nodes is the one solved at once, to round-off.

    Only the columns of the new nodes are solved; the rest follows by symmetry.
    """
    condenser = condense(scene(BOX, "mesh.h_contact=0.05")).equilibrium.condenser
    condenser.condense(0.1, TipTrack((1.0, 1.0)), [2])
    grown = condenser.condense(0.3, TipTrack((1.0, 1.0)), [2])
    at_once = Condenser(condenser.body).condense(0.3, TipTrack((1.0, 1.0)), [2])
    assert grown.size == at_once.size > 50
    for name in ("C", "support_reactions", "pin_reactions"):
        ours, theirs = getattr(grown, name), getattr(at_once, name)
        assert np.abs(ours - theirs).max() <= 1e-12 * max(1.0, np.abs(theirs).max())


def test_memory_does_not_grow_with_the_blocks_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory does not grow with the blocks of right-hand sides that are solved.

    Two matrices of some 60 kB for each of 250 nodes would be 30 MB.
    """
    monkeypatch.setattr(compliance, "BLOCK_SIZE", 1)
    body = condense(scene(WALLED, "mesh.h_contact=0.001")).equilibrium.condenser.body
    again = Condenser(body)
    before = memory_in_use()
    found = again.condense(0.11, TipTrack((0.0,)), [1])
    kept = 16 * found.size * body.unknowns.owned_count
    assert kept > 2e7
    assert memory_in_use() - before < kept / 4


@pytest.mark.parametrize("method", ["condensed", "newton"])
def test_memory_of_a_solution_is_given_back(method: str) -> None:
    """The memory of a solution is released with it.

    Objects that outlive their mesh would stay: 2 MB a run with a compliance, 5 MB with a factor.
    """
    base = solved_by(
        method, scene(WALLED, "mesh.h_contact=0.02", loading={"delta": 0.01, "steps": 1})
    )
    solve(base), solve(base)
    before, runs = memory_in_use(), 5
    for _ in range(runs):
        solve(base)
    assert memory_in_use() - before < 1e6 * runs


def test_memory_of_a_step_is_given_back() -> None:
    """The memory of an increment is released.

    Some twenty vectors of the body, 16 MB over these rows, would stay; a third is room for the
    states.
    """
    base = solved_by(
        "newton", scene(WALLED, "mesh.h_contact=0.01", loading={"delta": 0.01, "steps": 50})
    )
    rows = states(base, with_surface=False)
    for _ in range(10):
        next(rows)
    before = memory_in_use()
    assert sum(state.converged for state in rows) == 40
    assert memory_in_use() - before < 5e6


@pytest.mark.parametrize("taken", [0, 1, 3])
def test_a_walk_that_is_left_early_lets_go_of_its_mesh(taken: int) -> None:
    """The mesh is released once, wherever the iteration over the states is left."""
    from indent_sim.fe import solver

    released = []
    rows = states(
        scene(WALLED, "mesh.h_contact=0.1", loading={"delta": 0.01, "steps": 3}), with_surface=False
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver, "release", released.append)
        next(rows)
        for _ in range(taken):
            next(rows, None)
        rows.close()
    assert len(released) == 1


def memory_in_use() -> int:
    """Resident memory of this process [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_a_contact_too_large_to_condense_is_solved_by_newton_and_says_so() -> None:
    """A contact too large to condense is solved by Newton's method, with size and reason.

    If condensation is requested all the same, the scene is refused.
    """
    fine = {"mesh": {"h_contact": 0.0015, "h_far": 0.5}}
    assert scene(WALLED, **fine).solver.method == "condensed"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver_choices, "MAX_CANDIDATES", 100)
        base = scene(WALLED, **fine)
        assert base.solver.method == "newton"
        (why,) = [choice.why for choice in base.plan.choices if choice.key == "solver.method"]
        assert "nodes may come into contact" in why and "GB" in why
        with pytest.raises(ConfigError, match="nodes may come into contact"):
            scene(WALLED, **fine, solver={"method": "condensed"})


@pytest.mark.parametrize(
    "loading", [{"deltas": [0.001, 0.01]}, {"forces": [4e-5, 1.6e-3]}], ids=["depths", "forces"]
)
def test_a_contact_that_outgrows_what_can_be_condensed_is_no_number(
    loading: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A row whose contact exceeds the largest compliance fails and has no force."""
    monkeypatch.setattr(equilibrium, "CANDIDATE_MARGIN", -7.0)
    base = scene(WALLED, loading=loading, mesh={"h_contact": 0.01})
    monkeypatch.setattr(equilibrium, "MAX_CANDIDATES", 10)
    first, second = states(base)
    assert first.converged
    assert not second.converged and np.isnan(second.force)
    assert "contact extends beyond" in second.reason and "solver.method: newton" in second.reason
    assert "the last equilibrium found is at delta = 0.00" in second.reason


@pytest.mark.verify
def test_bodies_condensed_before_take_no_memory() -> None:
    """Condensed bodies are released entirely.

    Twenty are made after ten that fill the allocator's pools; PETSc's objects alone were 1.5 MB
    each.
    """

    def resident() -> float:
        return (
            int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        )

    base = scene(CYLINDER, mesh={"h_contact": 0.02})
    for _ in range(10):
        condense(base)
    before = resident()
    for _ in range(20):
        condense(base)
    assert resident() - before < 10
