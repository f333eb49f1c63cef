"""Loops of a cone from published formulas, for tests of fits without finite elements.

The functions of Dao et al. (2001), Acta Mater. 49, 3899, for a cone of 70.3 degrees, with a power
law of unloading; and curves as an instrument records them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.cone_loop import (
    RECOVERY_FRACTIONS,
    ConeLoop,
    Metal,
    metal_of,
)
from indent_sim.fitting.forward_model.parameters import number_at
from indent_sim.results.measured.measurement import MeasuredCurve

NU = 0.3
KEYS = ("material.E", "material.plasticity.yield_stress")


def published_loop(metal: Metal) -> ConeLoop:
    """Return the loop of a metal; C and S are within some 3 % of finite elements."""
    E_star = metal.E / (1 - NU**2)
    stress = metal.yield_stress * (1 + 0.033 * metal.ratio) ** metal.n
    x = math.log(E_star / stress)
    C = stress * (-1.131 * x**3 + 13.635 * x**2 - 30.594 * x + 29.267)
    n = metal.n
    S = E_star * (
        (-1.40557 * n**3 + 0.77526 * n**2 + 0.15830 * n - 0.06831) * x**3
        + (17.93006 * n**3 - 9.22091 * n**2 - 2.37733 * n + 0.86295) * x**2
        + (-79.99715 * n**3 + 40.55620 * n**2 + 9.00157 * n - 2.54543) * x
        + (122.65069 * n**3 - 63.88418 * n**2 - 9.58936 * n + 6.20045)
    )
    # The exponent depends slightly on hardening, so that a loop has more than two numbers.
    m = 1.25 + 0.3 * n
    return ConeLoop(C / metal.E, S / C, m, (1 - RECOVERY_FRACTIONS) ** m)


def loop_of_angle(metal: Metal, half_angle: float) -> ConeLoop:
    """Return the loop of a cone of another half angle, made up of that of 70.3 degrees.

    The representative strain is 0.105 cot(half angle) (Bucaille et al. 2003, Acta Mater. 51, 1663):
    the metal is replaced by a perfect one of the same flow stress at this strain, by way of the
    published functions at a yield stress that gives it at 0.033. C grows with the square of the
    tangent, S/h with the tangent.
    """
    tangent = math.tan(math.radians(half_angle)) / math.tan(math.radians(70.3))
    strain = 0.033 / tangent
    factor = ((1 + strain * metal.ratio) / (1 + 0.033 * metal.ratio)) ** metal.n
    loop = published_loop(Metal(metal.E, metal.yield_stress * factor, metal.n))
    return replace(loop, curvature=loop.curvature * tangent**2, stiffness=loop.stiffness / tangent)


def solved_by_formula(config: Config, depth: float) -> ConeLoop:
    """Stand in for the run of `cone_loop.solve_cone_loop`."""
    return loop_of_angle(metal_of(config), number_at(config, "indenter.half_angle"))


def recorded(
    loop: ConeLoop,
    E: float,
    draw: np.random.Generator,
    noise: float = 0.003,
    points: int = 400,
    contact_point: float = 0.05,
    compliance: float = 0.0,
) -> MeasuredCurve:
    """Return a loop to 1 um with a baseline, white noise of the force, and unloading.

    With the compliance of a frame [um/mN] the lengths are displacements of its base.
    """
    up = np.linspace(-0.3, 1.0, points)
    down = loop.depths_of(np.linspace(1.0, 0.0, points // 2 + 1)[1:], 1.0)
    force = np.concatenate([loop.loading(E, up), loop.unloading(E, down, 1.0)])
    x = np.concatenate([up, down]) + contact_point + compliance * force
    force = force + noise * force.max() * draw.standard_normal(len(force))
    return MeasuredCurve(
        "loop",
        force,
        **{"z" if compliance else "delta": x},
        units={"length": "um", "force": "mN"},
        parts={"approach": slice(0, points), "retract": slice(points, len(force))},
    )
