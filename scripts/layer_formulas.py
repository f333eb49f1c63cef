#!/usr/bin/env python3
"""Compares formulas for a sphere on a thin bonded layer with layer theory: a Markdown table.

usage: python scripts/layer_formulas.py [FOLDER]

The last rows are those of the closed formula and of the surrogate of the shipped study of this
layer, whose results are in FOLDER; without it the study is computed, in a minute of CPU.

Published formulas: Dimitriadis et al. (2002), Biophys. J. 82, 2798; Garcia & Garcia (2018),
Biophys. J. 114, 2923; Long, Hall, Wu & Hui (2011), Biophys. J. 101, 643. All forces are those of
E = R = 1, at 20 thicknesses from R/10 to 20 R and 24 depths from R/1000 to R/2.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import indent_sim
from indent_sim import studies
from indent_sim.theory import profiles
from indent_sim.theory.films import dimitriadis_force
from indent_sim.theory.half_space import E_star, paraboloid_force
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer

ROOT = Path(__file__).resolve().parents[1]
STUDY = ROOT / "configs/studies/surrogate/sphere_on_layer.yaml"
# Force at a depth, a thickness and Poisson's ratio.
Formula = Callable[[float, float, float], float]
# Thicknesses [R] and depths [R] at which the forces are compared.
HEIGHTS = np.geomspace(0.1, 20.0, 20)
DEPTHS = np.geomspace(0.001, 0.5, 24)
POISSON_RATIOS = (0.3, 0.5)
# Whether a depth and a thickness are in a range.
Range = Callable[[float, float], bool]
# Largest values of (R delta)^(1/2)/h of the rows, and the range of deeper contacts.
LARGEST_ARGUMENTS = (0.2, 0.5, 1.0)
DEEP_RANGE = "0.3 <= R/h <= 12.7, delta/h <= min(0.6, R/h)"


def hertz(delta: float, nu: float) -> float:
    """Return Hertz's force."""
    return paraboloid_force(delta, 1.0, E_star(1.0, nu))


def dimitriadis(delta: float, height: float, nu: float) -> float:
    """Return the force of Dimitriadis et al. (2002)."""
    return dimitriadis_force(delta, 1.0, StackLayer(height, 1.0, nu))


def garcia(delta: float, height: float, nu: float) -> float:
    """Return the force of Garcia & Garcia (2018), printed for nu = 0.5."""
    x = math.sqrt(delta) / height
    series = 1 + 1.133 * x + 1.497 * x**2 + 1.469 * x**3 + 0.755 * x**4
    return hertz(delta, nu) * series if nu == 0.5 else math.nan


def long_force(delta: float, height: float, nu: float) -> float:
    """Return the force of Long et al. (2011), for nu = 0.5."""
    w = (delta / height**2) ** 1.5
    alpha = 10.05 - 0.63 * math.sqrt(height) * (3.1 + height**2)
    beta = 4.8 - 4.23 * height**2
    quotient = (1 + 1.15 * w ** (1 / 3) + alpha * w + beta * w**2) / (1 + 2.3 * w)
    return hertz(delta, nu) * quotient if nu == 0.5 else math.nan


def closed_formula(text: str, delta: float, height: float, nu: float) -> float:
    """Return the force of a closed formula, which are statements of Python."""
    names: dict[str, Any] = {
        "material": SimpleNamespace(E=1.0, nu=nu),
        "indenter": SimpleNamespace(R=1.0),
        "body": SimpleNamespace(height=height),
        "loading": SimpleNamespace(delta=delta),
    }
    exec(text, names)
    return float(names["force"])


def surrogate_force(surrogate: Any, delta: float, height: float, nu: float) -> float:
    """Return the force of a surrogate."""
    return float(surrogate({"material.nu": nu, "body.height": height, "loading.delta": delta}))


def formulas_of_study(folder: Path) -> dict[str, Formula]:
    """Return the closed formula and the surrogate of the shipped study."""
    path = folder / "surrogate-force.json"
    if not path.exists():
        studies.execute_study(STUDY, output=folder)
        studies.make_surrogate(STUDY, "force", output=folder)
    surrogate = indent_sim.surrogate(path)
    entry = surrogate.information["formula"]
    return {
        f"closed formula, {entry['coefficients']} coefficients": partial(
            closed_formula, entry["python"]
        ),
        "surrogate": partial(surrogate_force, surrogate),
    }


def is_deep(delta: float, height: float) -> bool:
    """Return whether a point is in the range of deeper contacts."""
    return 0.3 <= 1 / height <= 12.7 and delta / height <= min(0.6, 1 / height)


def is_shallow(largest: float, delta: float, height: float) -> bool:
    """Return whether a sphere is like a paraboloid, and (R delta)^(1/2)/h at most `largest`."""
    return math.sqrt(delta) / height <= largest and delta <= 0.1


def exact_forces(nu: float) -> dict[tuple[float, float], float]:
    """Return the forces of layer theory for a sphere by depth and thickness."""
    forces = {}
    for height in HEIGHTS:
        depths = [delta for delta in DEPTHS if delta < 0.9 * height]
        layer = Layer.from_stack(
            profiles.sphere(1.0), Stack((StackLayer(height, 1.0, nu),), "fixed"), None
        )
        for delta, solution in zip(depths, layer.solutions_at_depths(depths), strict=True):
            forces[delta, height] = solution.force
    return forces


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as temporary:
        print_table(Path(sys.argv[1] if len(sys.argv) > 1 else temporary))


def print_table(folder: Path) -> None:
    """Print the table, with the formula of the study in a folder."""
    formulas: dict[str, Formula] = {
        "Dimitriadis": dimitriadis,
        "Garcia": garcia,
        "Long": long_force,
    } | formulas_of_study(folder)
    ranges: dict[str, Range] = {
        f"(R delta)^(1/2)/h <= {largest:g}, delta <= R/10": partial(is_shallow, largest)
        for largest in LARGEST_ARGUMENTS
    }
    ranges[DEEP_RANGE] = is_deep
    print("| formula | nu | range | points | median error | largest error |")
    print("|---|---|---|---|---|---|")
    for nu in POISSON_RATIOS:
        exact = exact_forces(nu)
        for name, formula in formulas.items():
            for range_text, is_inside in ranges.items():
                points = [point for point in exact if is_inside(*point)]
                errors = [abs(formula(*point, nu) / exact[point] - 1) for point in points]
                if not math.isnan(errors[0]):
                    print(
                        f"| {name} | {nu:g} | {range_text} | {len(points)} "
                        f"| {100 * np.median(errors):.3g} % | {100 * max(errors):.3g} % |"
                    )


if __name__ == "__main__":
    main()
