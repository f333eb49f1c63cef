"""Results made up for tests: states, fields, result folders, and titles that are hard to print."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from indent_sim.model.state import State, Surface
from indent_sim.model.tips import Sphere
from indent_sim.results.field_arrays import ARRAYS
from indent_sim.results.reader import Results
from indent_sim.results.tip_geometry import tip_mesh
from indent_sim.results.writer import ResultFolder


def a_result(kind: str = "axisymmetric", steps: int = 5, error: bool = False, **report) -> Results:
    """Results as read from a folder, of a contact whose curves are Hertz's."""
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


THIRD = 1 / 3


def a_state(step: int, **values) -> State:
    """A state with a surface of two nodes; `values` replace its fields."""
    surface = Surface(
        x=np.array([0.0, 0.1]),
        y=np.zeros(2),
        u=np.array([[0, 0, -0.1], [0, 0, -0.05]]),
        gap=np.array([0.0, 0.2]),
        pressure=np.array([THIRD, 0.0]),
        z=np.zeros(2),
    )
    state = State(
        step, 0.1 * step, THIRD * step, 0.2, 1.5, 1e-5, 0.01, 4, 0.1 * step, surface=surface
    )
    return replace(state, **values)


def write_run(target: Path, steps: int = 2, **options) -> None:
    """Write a result folder with rows 1 to `steps`."""
    with ResultFolder(target, "title: x\n", **options) as run:
        for step in range(1, steps + 1):
            run.append(a_state(step))


def names(path: Path) -> set[str]:
    """Names of the entries of a folder."""
    return {entry.name for entry in path.iterdir()}


FILES = {"force_indentation.csv", "surface.csv", "config.yaml", "run.json"}
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, -1.0], [0.0, -1.0]])
CELLS = np.array([[0, 1, 2], [0, 2, 3]])
REGIONS = np.array([0, 1])
TIP = tip_mesh(Sphere(R=1.0), (0.0,), 0.5, "axisymmetric", 1)
BODY = (POINTS, CELLS, REGIONS, TIP)


def some_fields(step: int, points: int = 4, cells: int = 2, dim: int = 2) -> dict[str, np.ndarray]:
    """Fields of a step with distinct numbers in every array."""
    counts, sizes = {"Node": points, "Cell": cells}, {"displacement": (dim,), "stress": (3, 3)}
    shapes = {
        name: (counts[center], *sizes.get(name, size)) for name, (center, _, size) in ARRAYS.items()
    }
    return {
        name: step * np.arange(np.prod(shape, dtype=float)).reshape(shape)
        for name, shape in shapes.items()
    }


TITLES = [
    "[/x] [kPa]",
    "$\\frac{1$",
    "two $ signs $",
    r"\$",
    "_hidden",
    "\x1b[2J\x07",
    "a\nb",
    "\u202etfel",
    "ä 漢 🙂",
]
