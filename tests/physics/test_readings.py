"""Stiffness, area and E_hertz of rows against theory, force differences and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

import pytest
from scenes import ELASTIC, PARABOLOID, STRIP, WALLED, scene, solve

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.derived_quantities import DerivedQuantities, hertz_fit

SHALLOW = {"delta": 0.01, "steps": 3}


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_stiffness_of_a_condensed_layer_is_the_flat_punchs(nu: float) -> None:
    """The stiffness dF/d(delta) of a condensed layer is that of exact theory to 0.1 %.

    Measured from six elements in the contact radius on, the median error is 0.03 %.
    """
    base = scene(WALLED, material=ELASTIC | {"nu": nu}, loading=SHALLOW)
    assert base.solver.method == "condensed" and base.plan.theory
    for state in solve(base):
        found = base.plan.theory.solution_at_depth(state.delta)
        assert found and state.stiffness == pytest.approx(found.stiffness, rel=1e-3)


@pytest.mark.parametrize("method", ["augmented_lagrangian", "penalty", "active_set", "nitsche"])
@pytest.mark.parametrize("solver", ["newton", "condensed"])
def test_stiffness_by_the_tangent_is_the_slope_of_the_meshs_force(method: str, solver: str) -> None:
    """The stiffness by the tangent is the difference quotient of the force to 0.1 %.

    In plane strain no flat punches replace the tangent. Over 2e-5 of the depth the points in
    contact are the same, so the quotient itself is good to 1e-5 with the solver's tolerance of
    1e-10.
    """
    if (method, solver) == ("nitsche", "condensed"):
        return
    depths = {"deltas": [0.01 * (1 - 1e-5), 0.01, 0.01 * (1 + 1e-5)]}
    base = scene(
        STRIP,
        f"contact.method={method}",
        f"solver.method={solver}",
        "mesh.h_contact=0.03",
        loading=depths,
    )
    low, state, high = solve(base)
    assert state.stiffness == pytest.approx(
        (high.force - low.force) / (high.delta - low.delta), rel=1e-3
    )
    assert state.area == pytest.approx(2 * state.a) and math.isnan(state.E_hertz or 0.0)


def test_a_multiplier_that_moves_outside_of_newton_has_no_tangent() -> None:
    base = scene(STRIP, "contact.method=uzawa", "solver.method=newton", "mesh.h_contact=0.03")
    assert math.isnan(solve(base)[-1].stiffness or 0.0)


def test_a_half_space_reads_its_own_modulus() -> None:
    """E_hertz of a half-space is its modulus, by theory to rounding and by a mesh to 0.3 %."""
    body = {"shape": "half_space"}
    assert list(pipeline.states(scene(body)))[-1].E_hertz == pytest.approx(1.0, rel=1e-12)
    meshed = solve(scene(body, "solver.method=condensed"))[-1]
    assert meshed.E_hertz == pytest.approx(1.0, rel=3e-3)
    assert meshed.area == pytest.approx(math.pi * meshed.a**2)


@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_the_modulus_of_a_half_space_is_within_its_error_bar(nu: float, tmp_path: Path) -> None:
    """E_hertz of a meshed half-space differs from E = 1 by no more than the force's bar.

    E_hertz is the force divided by an exact one, so its relative error is that of the force.
    """
    config = config_from_mapping(
        {
            "body": {"shape": "half_space"},
            "material": ELASTIC | {"nu": nu},
            "indenter": PARABOLOID,
            "loading": SHALLOW,
            "solver": {"method": "condensed"},
            "output": {"plot": False},
        }
    )
    for state in pipeline.simulate(config, directory=tmp_path / "out", error_bars=True).states:
        assert state.force_error and state.E_hertz
        assert abs(state.E_hertz - 1.0) <= state.force_error / state.force


@pytest.mark.parametrize("rounding", [-1e-14, 2e-16])
def test_a_force_of_zero_reads_no_modulus(rounding: float) -> None:
    """E_hertz is nan where an attraction balances the contact force at a positive depth.

    The force found there is rounding of either sign; a force of 1e-3 at the same depth has a
    modulus.
    """
    base = scene(
        WALLED, contact={"adhesion": {"work": 1e-4, "range": 1e-2}}, loading={"forces": [0.0, 1e-3]}
    )
    balanced = State(1, 3e-3, rounding, 0.05, nan, 0.0, nan, 1, 0.0, stiffness=1.0)
    assert math.isnan(DerivedQuantities(base).complete_state(balanced).E_hertz or 0.0)
    assert DerivedQuantities(base).complete_state(replace(balanced, step=2, force=1e-3)).E_hertz


def test_a_fit_to_an_exact_curve_is_off_by_nothing() -> None:
    """A Hertz fit to theory's half-space is off by exactly 0 %: theory is the fitted formula."""
    whole = scene({"shape": "half_space"}, "loading.steps=3")
    fit = hertz_fit(whole, list(pipeline.states(whole)))
    assert fit and fit["percent"] == 0.0 and fit["E"] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("body", "tip", "nu", "delta", "within"),
    [
        (
            {"shape": "cap", "base_radius": 1.0, "height": 0.6, "base": "fixed"},
            {"shape": "plate"},
            0.3,
            0.4,
            0.02,
        ),
        (
            {"shape": "cylinder", "radius": 2.9, "height": 1.0, "sides": "roller"},
            {"shape": "paraboloid", "R": 20.0},
            0.5,
            0.099,
            0.08,
        ),
    ],
)
def test_the_stiffness_where_no_punch_moves_the_last_nodes(
    body: dict[str, Any], tip: dict[str, Any], nu: float, delta: float, within: float
) -> None:
    """The stiffness is the difference quotient of forces over 1 % of the depth.

    The bodies have a rim that is held, or are sealed and incompressible. The quotient is good to
    1e-4 of the stiffness. The element at the edge of contact, which is in contact or not, is worth
    2 %, and four times as much beside the wall of a sealed body, where the stiffness grows without
    bound.
    """
    depths = {"deltas": [0.995 * delta, delta, 1.005 * delta]}
    base = scene(body, material=ELASTIC | {"nu": nu}, indenter=tip, loading=depths)
    before, state, after = solve(base)
    slope = (after.force - before.force) / (after.delta - before.delta)
    assert state.stiffness == pytest.approx(slope, rel=within)
