"""Patch test: under a flat punch that covers it, a confined body is strained uniformly.

With M the modulus of the layer, h its thickness and the penalty's compliance 1/epsilon_n in series,

    p = delta / (h/M + 1/epsilon_n),   force = p A,   energy = force delta / 2,
    penetration = p / epsilon_n

and the other methods have no compliance of their own, 1/epsilon_n -> 0. M = E (1-nu)/((1+nu)(1-2
nu)) between rollers, E with free sides, E/(1-nu^2) with free sides in plane strain. The solution is
exact and inside every Lagrange space, so that 1e-9 is ten times the solver's tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from patch_scenes import (
    AREA,
    BOX,
    CYLINDER,
    DELTA,
    EPSILON_N,
    EXACT,
    NU,
    STRIP,
    E,
    H,
    covered,
)
from scenes import solve
from scipy.optimize import brentq

from indent_sim.scene.scene import Scene

CONFINED = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))

RADIUS = {"cylinder": 1.5, "strip": 1.5, "box": sqrt(6.0 / pi)}
FREE_MODULUS = {"cylinder": E, "strip": E / (1 - NU**2), "box": E}


def assert_uniform(base: Scene, body: dict[str, Any], modulus: float) -> None:
    """Assert all measured numbers against these formulas."""
    state = solve(base)[-1]
    compliance = 1 / EPSILON_N if base.physics.contact.method == "penalty" else 0.0
    p = DELTA / (H / modulus + compliance)
    F = p * AREA[body["shape"]]
    assert state.force == pytest.approx(F, rel=EXACT)
    assert state.reaction == pytest.approx(F, rel=EXACT)
    assert state.energy == pytest.approx(F * DELTA / 2, rel=EXACT)
    assert state.p_max == pytest.approx(p, rel=EXACT)
    assert state.a == pytest.approx(RADIUS[body["shape"]], rel=EXACT)
    nodes = len(state.surface.x)
    depth = p * compliance
    assert state.penetration == pytest.approx(depth, rel=EXACT, abs=EXACT * DELTA)
    assert state.surface.pressure == pytest.approx(np.full(nodes, p), rel=EXACT)
    assert state.surface.gap == pytest.approx(np.full(nodes, -depth), rel=EXACT, abs=EXACT * DELTA)
    assert state.surface.u[:, 2] == pytest.approx(np.full(nodes, depth - DELTA), rel=EXACT)


@pytest.mark.parametrize("base", ["fixed", "roller"])
@pytest.mark.parametrize("method", ["penalty", "augmented_lagrangian", "nitsche", "active_set"])
@pytest.mark.parametrize("body", [CYLINDER, STRIP, BOX], ids=lambda body: body["shape"])
def test_confined_body(body: dict[str, Any], method: str, base: str) -> None:
    """A confined body is strained uniformly, by every method, on a fixed or roller base."""
    held = body | {"base": base, "sides": "roller"}
    assert_uniform(covered(held, method=method), held, CONFINED)


@pytest.mark.parametrize(
    ("body", "symmetry"),
    [
        (CYLINDER, "auto"),
        (STRIP, "half"),
        (STRIP, "full"),
        (BOX, "quarter"),
        (BOX, "half"),
        (BOX, "full"),
    ],
    ids=lambda value: value if isinstance(value, str) else value["shape"],
)
def test_body_that_bulges_freely(body: dict[str, Any], symmetry: str) -> None:
    """A body with free sides on rollers is strained uniformly, and its pins have no reaction."""
    held = body | {"base": "roller", "sides": "free"}
    base = covered(held, symmetry)
    if symmetry == "full":
        assert base.physics.domain.pins
    assert_uniform(base, held, FREE_MODULUS[body["shape"]])


def test_body_between_two_of_its_walls() -> None:
    """A box between rollers in x and free in y is in plane strain, with E/(1-nu^2)."""
    held = BOX | {
        "base": "roller",
        "sides": {"x_min": "roller", "x_max": "roller", "y_min": "free", "y_max": "free"},
    }
    assert_uniform(covered(held, "full"), held, E / (1 - NU**2))


# ---- Fung's law, uniform at finite strain

FUNG = {"model": "fung", "mu": 1.0, "b": 0.8, "nu": 0.3}


def fung_stresses(*stretches: float) -> np.ndarray:
    """Nominal principal stresses of Fung's law, by hand.

    P_i l_i = mu exp(b (I1bar - 3)) J^(-2/3) (l_i^2 - I1/3) + kappa ln J.
    """
    squares, J = np.square(stretches), np.prod(stretches)
    kappa = 2 * FUNG["mu"] * (1 + FUNG["nu"]) / (3 * (1 - 2 * FUNG["nu"]))
    shrink = J ** (-2 / 3)
    stiff = FUNG["mu"] * np.exp(FUNG["b"] * (shrink * squares.sum() - 3)) * shrink
    return (stiff * (squares - squares.mean()) + kappa * np.log(J)) / stretches


def free(held: Callable[[float], tuple[float, ...]]) -> float:
    """Stretch of the free sides, the first of three, at which they carry no stress."""
    return float(brentq(lambda s: fung_stresses(*held(s))[0], 0.5, 3.0, xtol=1e-15, rtol=1e-15))


@pytest.mark.parametrize("formulation", ["displacement", "mixed"])
@pytest.mark.parametrize("kind", ["uniaxial", "plane", "confined"])
def test_a_pillar_of_fungs_law(kind: str, formulation: str) -> None:
    """A pillar of Fung's law pressed to 0.4 of its height has stress times area, to 1e-8.

    Newton's tolerance of 1e-9 of the reaction is kept in spite of the steep tangent.
    """
    body = {"uniaxial": CYLINDER, "plane": STRIP, "confined": CYLINDER}[kind]
    held = body | {"base": "roller", "sides": "roller" if kind == "confined" else "free"}
    path = {"deltas": [0.15 * H, 0.3 * H, 0.45 * H, 0.6 * H]}
    base = covered(held, "auto", "auto", FUNG | {"formulation": formulation}, path, gap="reference")
    for state in solve(base):
        l = 1 - state.delta / H
        if kind == "uniaxial":
            s = free(lambda s, l=l: (s, s, l))
            P = fung_stresses(s, s, l)[2]
        elif kind == "plane":
            s = free(lambda s, l=l: (s, 1.0, l))
            P = fung_stresses(s, 1.0, l)[2]
        else:
            P = fung_stresses(1.0, 1.0, l)[2]
        assert state.force == pytest.approx(-P * AREA[body["shape"]], rel=1e-8)
