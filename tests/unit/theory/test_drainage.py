"""Drainage of a porous body: values of another program, limits, and late times."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from theory_bodies import one_layer

from indent_sim.theory import poroelasticity, profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.poroelasticity import (
    PorousSolid,
    poroelastic_fraction_remaining,
)
from indent_sim.theory.theory import Theory

SURFACES = ("drained", "sealed")
STOKES = PorousSolid(E=1.0, nu=0.2, permeability=0.9)
WALLED: dict[str, Any] = {"tip": profiles.paraboloid(1.0), "h": 1.0, "wall": 2.0}


@pytest.mark.parametrize(
    ("nu", "surface", "tau", "ratio"),
    [(0.2, "drained", 0.1, 0.80510412), (0.3, "sealed", 1.0, 0.82467988)],
)
def test_force_of_a_flat_punch(nu: float, surface: Any, tau: float, ratio: float) -> None:
    """F/F(0+) of a flat punch is that of an integral equation, to its eight printed digits.

    That program uses 96 points and wavenumbers up to 800.
    """
    last = 1 / (2 * (1 - nu))  # F(inf)/F(0+)
    assert last + (1 - last) * poroelastic_fraction_remaining(
        tau, nu, surface=surface
    ) == pytest.approx(ratio, abs=5.1e-9)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.49])
def test_fluid_leaves_and_never_comes_back(nu: float, surface: Any) -> None:
    left = [
        poroelastic_fraction_remaining(tau, nu, surface=surface)
        for tau in (0.0, *np.geomspace(1e-9, 1e9, 19), math.inf)
    ]
    assert left[0] == 1.0 and left[-1] == 0.0
    assert np.all(np.diff(left) < 0)
    assert left[1] > 0.998  # 1e-9 leaves a layer of 3e-5 radii


@pytest.mark.parametrize(("nu", "undrained_nu"), [(0.0, 0.5), (0.2, 0.5), (0.4, 0.5), (0.1, 0.3)])
def test_the_last_of_a_drained_surface_goes_as_one_over_the_root_of_time(
    nu: float, undrained_nu: float
) -> None:
    """At late times the remaining fraction falls as an elementary constant over sqrt(pi tau).

    g -> (1 - r)/(pi r) (1 + (c - 1) atan(sqrt c)/sqrt c)/sqrt(pi tau) with c = r/(1 - r), because
    the kernel is constant for waves much longer than the radius. The next term is of the order
    1/tau.
    """
    r = (undrained_nu - nu) / (1 - nu)
    c = r / (1 - r)
    constant = (1 + (c - 1) * math.atan(math.sqrt(c)) / math.sqrt(c)) / (math.pi * c)
    tau = 1e8
    assert poroelastic_fraction_remaining(tau, nu, undrained_nu) * math.sqrt(
        math.pi * tau
    ) == pytest.approx(constant, rel=1e-7)


@pytest.mark.parametrize("surface", SURFACES)
def test_early_times_join_the_others(surface: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The early-time law and the integral equation agree at three times the change of methods.

    3e-4 is what the early-time law neglects.
    """
    early = poroelastic_fraction_remaining(3e-4, 0.2, surface=surface)
    monkeypatch.setattr(poroelasticity, "SHORT_TIME", 1e-5)
    poroelastic_fraction_remaining.cache_clear()
    assert poroelastic_fraction_remaining(3e-4, 0.2, surface=surface) == pytest.approx(
        early, abs=3e-4
    )
    poroelastic_fraction_remaining.cache_clear()


def test_a_sealed_surface_drains_later() -> None:
    for tau in np.geomspace(1e-6, 1e6, 5):
        assert poroelastic_fraction_remaining(
            tau, 0.2, surface="sealed"
        ) > poroelastic_fraction_remaining(tau, 0.2, surface="drained")


@pytest.mark.parametrize(
    "given", [(-1.0, 0.2, 0.5), (math.nan, 0.2, 0.5), (1.0, 0.5, 0.5), (1.0, 0.3, 0.2)]
)
def test_no_such_time_or_body(given: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError):
        poroelastic_fraction_remaining(*given)


# ---- constants ----


def test_constants_without_storage() -> None:
    """Without storage M_c = E (1 - nu)/((1 + nu)(1 - 2 nu)) = 1/0.9, so that D = 1."""
    assert STOKES.confined_modulus == pytest.approx(1 / 0.9, rel=1e-14)
    assert STOKES.diffusivity == pytest.approx(1.0, rel=1e-14)
    assert STOKES.undrained_nu == 0.5
    assert STOKES.undrained_E == pytest.approx(3 * STOKES.shear_modulus, rel=1e-14)


def test_constants_of_ruhr_sandstone() -> None:
    """The derived constants of Ruhr sandstone are those of Detournay & Cheng (1993), table 3.

    K = 13 GPa, K_u = 30 GPa, nu = 0.12, nu_u = 0.31, M = 41 GPa, alpha = 0.65 and D = 5.3e-3 m^2/s
    at k/viscosity = 2e-13 m^4/(N s), to their two digits.
    """
    solid = PorousSolid(
        E=2 * 13.3e9 * 1.12, nu=0.12, permeability=2e-13, alpha=0.65, storage=1 / 41e9
    )
    assert solid.undrained_bulk_modulus == pytest.approx(30e9, rel=0.02)
    assert solid.undrained_nu == pytest.approx(0.31, abs=0.005)
    assert solid.diffusivity == pytest.approx(5.3e-3, rel=0.02)


@pytest.mark.parametrize(
    "wrong",
    [
        {"nu": 0.5},
        {"alpha": 1.1},
        {"alpha": 0.0},
        {"storage": -1.0},
        {"permeability": 0.0},
        {"E": -1.0},
    ],
)
def test_no_such_solid(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        replace(STOKES, **wrong)


# ---- a tip ----


@pytest.mark.parametrize(
    ("solid", "first"),
    [(STOKES, 0.0075520868), (replace(STOKES, alpha=0.8, storage=0.5), 0.0060289991)],
)
def test_limits_of_a_layer_in_a_cylinder(solid: PorousSolid, first: float) -> None:
    """The limits of a layer are elastic layers with G and nu_u, or nu, of another program.

    A paraboloid of R = 1 on a layer of height 1 between frictionless walls at 2. The tolerance is
    that program's eight printed digits.
    """
    pairs = ((solid.undrained_E, solid.undrained_nu), (solid.E, solid.nu))
    solutions = [
        Theory("layer", one_layer(Layer, E=E, nu=nu, **WALLED)).solution_at_depth(0.02)
        for E, nu in pairs
    ]
    forces = [solution.force for solution in solutions if solution]
    assert forces == pytest.approx([first, 0.0044524888], abs=5.1e-11)
