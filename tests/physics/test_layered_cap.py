"""Coated caps and bonded balls against finite elements of high degree (layered_cap.py)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import layered_ball
import layered_cap
import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.run.pipeline import simulate

KNOWN = 3e-5  # of the force, what the reference knows: 1e-5 from the series of a layered ball
AUTOMATIC = 0.001  # of the force at automatic sizes; 0.06 % was found


@dataclass(frozen=True)
class Round:
    """A cap, or a ball, with a core of E = 1 and the reference's contact radius a.

    The height of a ball is twice its radius.
    """

    R: float
    height: float
    base: str
    layers: list[layered_cap.Layer]
    tip: float  # radius of a paraboloid
    a: float

    def reference(self, degree: int = layered_cap.DEGREE) -> layered_cap.Contact:
        heights: Callable[[np.ndarray], np.ndarray] = lambda r: r**2 / (2 * self.tip)  # noqa: E731
        return layered_cap.contact(
            self.a, self.R, self.height, self.layers, heights, self.base, degree
        )

    def row(self, delta: float, folder: Path, **sections: Any) -> State:
        """Row of the program at a depth, with error bars."""
        layers: list[dict[str, Any]] = [
            {"thickness": t, "material": elastic(*m)} for t, m in self.layers[:-1]
        ]
        cap = {
            "shape": "cap",
            "base_radius": float(np.sqrt(self.height * (2 * self.R - self.height))),
        }
        is_ball = self.height == 2 * self.R
        body = {"shape": "ball", "radius": self.R} if is_ball else cap | {"height": self.height}
        given = {
            "body": body | {"base": self.base, "layers": [*layers, {}]},
            "material": elastic(*self.layers[-1][1]),
        }
        given |= {
            "indenter": {"shape": "paraboloid", "R": self.tip},
            "loading": {"delta": delta, "steps": 1},
        }
        given |= {"contact": {"gap": "reference"}, "output": {"plot": False, "fields": "none"}}
        return simulate(
            config_from_mapping(given | sections), directory=folder, error_bars=True
        ).states[-1]


def elastic(E: float, nu: float) -> dict[str, Any]:
    return {"model": "linear_elastic", "E": E, "nu": nu}


def drawn(count: int, seed: int) -> list[Round]:
    """Random caps and balls with one or two coatings.

    Flat and overhanging caps are bonded or on rollers. Coatings have 1/100 to 1/8 of the height or
    radius and are five times softer to fifty times stiffer than the core.
    """
    draw, bodies = np.random.default_rng(seed), []
    for k in range(count):
        height = float(draw.uniform(0.4, 1.6))
        R = (1 + height**2) / (2 * height)
        if k % 3 == 2:
            R, height = 1.0, 2.0
        size, skins = min(R, height), int(draw.integers(1, 3))
        thick = [float(t) for t in np.exp(draw.uniform(np.log(0.01), np.log(0.12), skins)) * size]
        stiff = [float(np.exp(draw.uniform(np.log(0.2), np.log(50)))) for _ in thick]
        nu = [float(draw.uniform(0.2, 0.48)) for _ in range(skins + 1)]
        a, tip = float(draw.uniform(0.08, 0.25)) * size, float(draw.uniform(0.3, 2))
        layers = [*zip(thick, zip(stiff, nu, strict=False), strict=True), (0.0, (1.0, nu[-1]))]
        bodies.append(Round(R, height, "roller" if k % 3 == 1 else "fixed", layers, tip, a))
    return bodies


QUICK = (
    0,
    1,
)  # caps, glued and on rollers; a glued ball in `make verify`, and with a nucleus below
BODIES = [
    pytest.param(one, marks=[] if k in QUICK else [pytest.mark.verify])
    for k, one in enumerate(drawn(9, 5))
]


@pytest.mark.parametrize("skin", [None, (0.1, (10.0, 0.3)), (0.01, (0.2, 0.45))])
def test_half_a_ball_on_rollers_is_the_series(skin: layered_cap.Layer | None) -> None:
    """A hemisphere on rollers under a plate is half of a ball between plates, to 3e-5.

    This is the accuracy of the series.
    """
    core = (0.0, (1.0, 0.3))
    found = layered_cap.contact(
        0.15, 1.0, 1.0, [skin, core] if skin else [core], lambda r: 0 * r, "roller"
    )
    shells = [(1.0, skin[1]), (1.0 - skin[0], core[1])] if skin else [(1.0, core[1])]
    series = layered_ball.contact(2 * found.delta, shells, lambda r: 0 * r)
    assert found.force == pytest.approx(series.force, rel=KNOWN)
    assert found.a == pytest.approx(series.a, rel=1e-3)  # of a force that is stationary


@pytest.mark.parametrize("k", [0, pytest.param(2, marks=pytest.mark.verify)])
def test_degrees_of_the_elements_agree(k: int) -> None:
    """Elements of two degrees give points on one curve for a bonded cap and ball, to 3e-5.

    The depths differ by 2e-4 at most, and the slope of the curve is Hertz's to some per cent.
    """
    body = drawn(3, 5)[k]
    low, high = body.reference(), body.reference(degree=layered_cap.DEGREE + 2)
    assert low.delta == pytest.approx(high.delta, rel=2e-4)
    assert low.force / high.force == pytest.approx((low.delta / high.delta) ** 1.5, abs=KNOWN)


@pytest.mark.parametrize("body", BODIES)
def test_force_and_contact_radius_of_automatic_sizes(body: Round, tmp_path: Path) -> None:
    """Automatic sizes keep 0.1 % of the force; force and radius lie inside their bars."""
    exact = body.reference()
    row = body.row(exact.delta, tmp_path)
    assert row.force_error and row.a_error
    off = abs(row.force - exact.force)
    assert off <= AUTOMATIC * exact.force and off <= row.force_error + KNOWN * exact.force
    assert abs(row.a - exact.a) <= row.a_error + 1e-3 * exact.a  # what the reference's edge knows


NUCLEI = [
    pytest.param((0.6, 0.3), 20.0, "fixed", marks=pytest.mark.verify),
    pytest.param((0.3, 0.6), 20.0, "roller", marks=pytest.mark.verify),
    ((0.6, 0.35), 0.1, "roller"),
    ((0.35, 0.6), 5.0, "fixed"),
]


@pytest.mark.parametrize(("semi_axes", "E", "base"), NUCLEI)
def test_a_ball_with_an_ellipsoid_in_its_middle(
    semi_axes: tuple[float, float], E: float, base: str, tmp_path: Path
) -> None:
    """Automatic sizes keep 0.1 % of the force on a ball with a nucleus, inside the error bar.

    Nuclei are flat and tall, stiff and soft; balls are bonded or between two tips.
    """
    core, (across, along) = (1.0, 0.4), semi_axes
    nucleus = (semi_axes, (E, 0.3))

    def tip(r: np.ndarray) -> np.ndarray:
        return r**2 / (2 * 1.5)

    height, ways = (
        (2.0, 1) if base == "fixed" else (1.0, 2)
    )  # between two tips half of the ball, on rollers
    exact = layered_cap.contact(0.2, 1.0, height, [(0.0, core)], tip, base, nucleus=nucleus)
    ball = {"shape": "ball", "radius": 1.0, "base": base}
    inside = {"shape": "ellipsoid", "center": [0, 0, -1.0], "semi_axes": [across, across, along]}
    given = {
        "body": ball | {"inclusions": [inside | {"material": elastic(*nucleus[1])}]},
        "material": elastic(*core),
    }
    given |= {"indenter": {"shape": "paraboloid", "R": 1.5}, "contact": {"gap": "reference"}}
    given |= {
        "loading": {"delta": ways * exact.delta, "steps": 1},
        "output": {"plot": False, "fields": "none"},
    }
    row = simulate(config_from_mapping(given), directory=tmp_path, error_bars=True).states[-1]
    assert row.force_error
    off = abs(row.force - exact.force)
    assert off <= AUTOMATIC * exact.force and off <= row.force_error + KNOWN * exact.force


@pytest.mark.verify
@pytest.mark.parametrize("body", drawn(3, 6))
def test_accuracy_of_a_thousandth_is_met(body: Round, tmp_path: Path) -> None:
    exact = body.reference()
    row = body.row(exact.delta, tmp_path, accuracy=0.001)
    assert abs(row.force - exact.force) <= (0.001 + KNOWN) * exact.force
