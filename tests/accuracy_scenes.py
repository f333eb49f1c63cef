"""Scenes whose exact force is known, on which `accuracy` and error bars are judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmark_forces import CUBE as CUBE_FORCE
from benchmark_forces import CYLINDER_STEPS as FORCES
from scipy.optimize import brentq, least_squares

from indent_sim.config.schema import Config
from indent_sim.scene.scene import resolve

QUIET = {"fields": "none", "surface": "none", "plot": False}
WIDE = 2.0  # radius of the wall over height, or over the contact radius where that is larger


@dataclass(frozen=True)
class Case:
    """A tip pressed into a layer of height 1 up to a contact radius near `a`.

    The path has `steps` equal steps.
    """

    tip: str
    a: float
    nu: float
    base: str = "fixed"
    shape: str = "cylinder"
    steps: int = 5

    def __str__(self) -> str:
        return f"{self.tip}, a/h {self.a:g}, nu {self.nu:g}, {self.base}, {self.shape}"

    def mapping(self) -> dict[str, Any]:
        wall = WIDE * max(1.0, self.a)
        sides = {"base": self.base, "sides": "roller", "height": 1.0}
        size = {"radius": wall} if self.shape == "cylinder" else {"width": 2 * wall}
        R = max(1.0, 5 * self.a**2)
        tip = {
            "paraboloid": {"R": R},
            "sphere": {"R": R},
            "cone": {"half_angle": 85},
            "flat_punch": {"radius": self.a},
        }
        return {
            "body": {"shape": self.shape} | size | sides,
            "material": {"model": "linear_elastic", "E": 1.0, "nu": self.nu},
            "indenter": {"shape": self.tip} | tip[self.tip],
            "loading": {"delta": self.depth(tip[self.tip]), "steps": self.steps},
            "output": QUIET,
        }

    def depth(self, tip: dict[str, Any]) -> float:
        """The depth at which sections of the tip are about `a` wide, in a thick or a thin layer."""
        sink = 0.6 if self.a > 0.5 else 1.0  # a thin layer's surface follows the tip
        if self.tip == "cone":
            return sink * 1.57 * self.a * np.tan(np.radians(5))
        return 0.01 * min(1.0, self.a) if self.tip == "flat_punch" else sink * self.a**2 / tip["R"]


def exact_forces(config: Config) -> np.ndarray:
    """The force of every step, by theory."""
    scene = resolve(config)
    assert scene.plan.theory is not None
    solutions = scene.plan.theory.solutions_at_depths(scene.physics.deltas) or []
    return np.array([solution.force for solution in solutions]) * scene.physics.scales.force


def drawn(count: int, seed: int = 7) -> list[Case]:
    """Random scenes, none of which was used to choose a constant of `accuracy`."""
    draw = np.random.default_rng(seed)
    return [
        Case(
            tip=str(draw.choice(["paraboloid", "sphere", "cone", "flat_punch"])),
            a=float(np.exp(draw.uniform(np.log(0.01), np.log(3.5)))),
            nu=float(draw.choice([0.0, 0.1, 0.2, 0.3, 0.4, 0.45, 0.47, 0.49, 0.4999])),
            base=str(draw.choice(["fixed", "roller"])),
            shape="strip" if draw.random() < 0.15 else "cylinder",
            steps=int(draw.integers(1, 9)),
        )
        for _ in range(count)
    ]


CUBE: dict[str, Any] = Case("paraboloid", 0.1, 0.3).mapping() | {
    "body": {"shape": "box", "size": [2.0, 2.0, 1.0]},
    "loading": {"delta": 0.01, "steps": 10},
}
DEPTHS = np.arange(1, 11) * 1e-3


def forces_on_a_finite_body(k_0: float, k_2: float) -> np.ndarray:
    """Hertz' force at DEPTHS on a body of finite size (E = 1, nu = 0.3).

    At a distance r from the axis the body sinks by F (k_0 - k_2 (r^2 + s^2)) less than a half-space
    does. F acts at distances s from the axis, with s^2 = 2 a^2/5 in the mean: what is far away acts
    smoothly.
    """
    E_star = 1 / (1 - 0.3**2)

    def excess(force: float, depth: float) -> float:
        curvature = 1 + 2 * k_2 * force
        a = (0.75 * force / E_star / curvature) ** (1 / 3)
        return float(a**2 * curvature - depth - force * (k_0 - 0.4 * k_2 * a**2))

    return np.array([brentq(excess, 1e-8, 3e-3, args=(depth,)) for depth in DEPTHS])


def cube_forces() -> np.ndarray:
    """Forces of the whole cube at DEPTHS.

    k_2 follows from the cylinder's independent forces, and k_0 from the cube's last one
    (test_hertz.py). Half of k_2 more or less would change the first force by 8e-5 of it.
    """
    _, k_2 = least_squares(lambda k: forces_on_a_finite_body(*k) / FORCES - 1, [0.4, 0.2]).x
    k_0 = brentq(lambda k: forces_on_a_finite_body(k, k_2)[-1] / CUBE_FORCE - 1, 0.3, 0.5)
    return forces_on_a_finite_body(k_0, k_2)


FEW = [
    Case("paraboloid", 0.1, 0.3),
    Case("cone", 1.0, 0.45),
    Case("flat_punch", 0.5, 0.3, "roller"),
    Case("sphere", 3.0, 0.4999),
    Case("paraboloid", 0.1, 0.3, shape="strip"),
]
