"""`accuracy` and the error bars where a bonded corner, a free edge or a wall beside the contact rules the force."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from indent_sim.config import Config, from_mapping
from indent_sim.run import run, states
from indent_sim.scene import Scene, resolve
from indent_sim.theory import layer, plane_strain
from indent_sim.theory.solution import Solution

QUIET = {"fields": "none", "surface": "none", "plot": False}
WALLS = {"roller": ("roller", "roller"), "free": ("free", "free"), "fixed": ("fixed", "fixed"), "one": ("fixed", "free")}


@dataclass(frozen=True)
class Case:
    """A tip pressed into a body of height 1 and the half-width `wide`, until contact takes about the share `reach` of
    that: by the theory of a layer that ends at roller walls."""

    tip: str
    wide: float
    reach: float
    nu: float
    sides: str
    shape: str = "cylinder"
    base: str = "fixed"
    steps: int = 1

    def __str__(self) -> str:
        return (f"{self.tip}, {self.shape} {self.wide:.3g} wide, contact {self.reach:.3g} of it, nu {self.nu:g}, "
                f"{self.base} base, sides {self.sides}, {self.steps} steps")  # fmt: skip

    @property
    def indenter(self) -> dict[str, Any]:
        a = self.reach * self.wide
        own = {"paraboloid": {"R": 20 * a}, "sphere": {"R": 20 * a}, "cone": {"half_angle": 88.0},
               "flat_punch": {"radius": a}}  # fmt: skip
        return {"shape": self.tip} | own[self.tip]

    def mapping(self) -> dict[str, Any]:
        walls = WALLS[self.sides]
        size = {"radius": self.wide, "sides": walls[0]} if self.shape == "cylinder" else {
            "width": 2 * self.wide, "sides": dict(zip(("x_min", "x_max"), walls, strict=True))}  # fmt: skip
        return {
            "body": {"shape": self.shape, "height": 1.0, "base": self.base} | size,
            "material": {"model": "linear_elastic", "E": 1.0, "nu": self.nu},
            "indenter": self.indenter,
            "loading": {"delta": self.depth(), "steps": self.steps},
            "output": QUIET,
        }

    def depth(self) -> float:
        """Where contact ends at `reach`."""
        a = self.reach * self.wide
        if self.tip == "flat_punch":
            return 0.001 * min(1.0, a)
        own = dict(self.indenter)
        module: Any = layer if self.shape == "cylinder" else plane_strain
        tip = getattr(tips_of(module), own.pop("shape"))(*own.values())

        def excess(delta: float) -> float:
            try:
                found: Solution = module.indent(tip, delta, E=1.0, nu=self.nu, h=1.0, base=self.base, wall=self.wide)
            except ValueError:  # contact meets the wall
                return self.wide - a
            return found.a - a

        scale = a * 0.05
        return float(brentq(excess, 1e-4 * scale, 10 * scale, xtol=1e-12, rtol=1e-12))


def tips_of(module: Any) -> Any:
    from indent_sim.theory import tips

    return tips if module is layer else plane_strain


def drawn(count: int, seed: int) -> list[Case]:
    """Scenes drawn at random, a third of them with a contact within 5 % of a side."""
    draw = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        shape = "strip" if draw.random() < 0.3 else "cylinder"
        sides = str(draw.choice(["roller", "free", "fixed", "one"], p=[0.25, 0.4, 0.2, 0.15]))
        shape = "strip" if sides == "one" else shape
        near = draw.random() < 1 / 3
        found.append(Case(
            tip=str(draw.choice(["paraboloid", "sphere", "cone", "flat_punch"], p=[0.3, 0.15, 0.15, 0.4])),
            wide=float(np.exp(draw.uniform(np.log(0.5), np.log(6.0)))),
            reach=round(float(draw.uniform(0.95, 0.99) if near else draw.uniform(0.2, 0.95)), 4),
            nu=float(draw.choice([0.3, 0.45, 0.49, 0.4999])), sides=sides, shape=shape,
            base="fixed" if sides != "roller" or draw.random() < 0.7 else "roller", steps=int(draw.integers(1, 5)),
        ))  # fmt: skip
    return found


def graded(config: Config, n: float) -> Scene:
    """The scene on a mesh that shrinks to nothing towards every corner and edge, whether its contact feels them."""
    base = resolve(config, n)
    (low, high), (bottom, top) = base.extent
    ends = {abs(end - base.center[0]) for end in (low, high)} - {0.0}
    every = tuple((r, depth) for r in sorted(ends) for depth in (0.0, top - bottom))
    sizes = replace(base.sizes, corners=every, h_corner=1e-7, grading=4.0 / n, h_far=4.0 / n,
                    h_edge=base.sizes.h_edge and 1e-7)  # fmt: skip
    return replace(base, sizes=sizes)


def true_forces(config: Config, n: float = 30.0) -> np.ndarray:
    """The force of every step: by exact theory, where the body is its own, else on a graded mesh."""
    scene = resolve(config)
    if scene.oracle is not None and scene.oracle.exact and (found := scene.oracle.curve(scene.deltas)):
        return np.array([solution.force for solution in found]) * scene.scales.force
    return np.array([state.force for state in states(graded(config, n), with_surface=False)])
