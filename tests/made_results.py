"""Results that nobody computed, in every shape that a picture or a report may meet."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from indent_sim.results.reader import Results


def a_result(kind: str = "axisymmetric", steps: int = 5, error: bool = False, **report) -> Results:
    delta = 1e-5 * np.arange(1, steps + 1)
    a, force = np.sqrt(1e-3 * delta), 1e3 * delta**1.5
    x = np.linspace(0, 3 * a[-1], 40)
    y = np.zeros(40)
    if kind == "three_dimensional":
        x, y = (part.ravel() for part in np.meshgrid(x, x))
    pressure = np.sqrt(np.maximum(1 - (x**2 + y**2) / a[-1] ** 2, 0))
    surface = {"step": np.full(len(x), float(steps)), "x": x, "y": y, "pressure": pressure}
    table = {"step": np.arange(1.0, steps + 1), "delta": delta, "force": force, "a": a}
    if error:
        table["force_error"] = 0.1 * force
    plan = {"choices": [{"key": "kinematics", "value": kind, "why": ""}]}
    theory = {
        "name": "layer theory",
        "delta": delta[-1],
        "force_deviation": 0.001,
        "half_space": {"name": "Hertz", "force": 0.9 * force[-1], "deviation": -0.1},
        "curve": {"delta": delta.tolist(), "force": force.tolist(), "a": a.tolist()},
    }
    units = {"length": "m", "force": "N"}
    facts = {
        "title": "A title",
        "gap": "reference",
        "method": "penalty",
        "units": units,
        "theory": theory,
    }
    return Results(Path("results/one"), table, facts | {"plan": plan} | report, surface)
