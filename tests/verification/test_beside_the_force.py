"""Contact radius, largest pressure and depth of a force with their error bars, where layer theory is exact: on layers
between frictionless walls (the scenes of test_accuracy.py)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_accuracy import Case, drawn

from indent_sim.config import from_mapping
from indent_sim.run import run
from indent_sim.scene import resolve
from indent_sim.state import State

RADII = np.append(np.linspace(0, 1, 400, endpoint=False), 1 - np.geomspace(1e-6, 1e-2, 200))  # of a: where peaks are


@dataclass(frozen=True)
class Judged:
    """A number, in units of its exact value, row by row: its true error and its bar."""

    true: np.ndarray
    bar: np.ndarray

    @property
    def held(self) -> float:
        """The share of rows whose bar holds the error."""
        return float(np.mean(self.true <= self.bar))

    @property
    def width(self) -> float:
        """The median of bar over error."""
        return float(np.median(self.bar / self.true))


def theory(case: Case, mapping: dict[str, Any]) -> dict[str, np.ndarray]:
    """delta, force, a and p_max of every step at prescribed depths, all of height and modulus 1."""
    scene = resolve(from_mapping(mapping))
    assert scene.oracle is not None and scene.oracle.exact
    curve = scene.oracle.curve(scene.deltas) or []
    L, P, F = scene.scales.length, scene.scales.pressure, scene.scales.force
    peaks = [float(np.max(solution.pressure(solution.a * RADII))) * P for solution in curve]
    return {"delta": np.array([solution.delta for solution in curve]) * L, "p_max": np.array(peaks),
            "force": np.array([solution.force for solution in curve]) * F,
            "a": np.array([solution.a for solution in curve]) * L}  # fmt: skip


def found(states: list[State], name: str, exact: np.ndarray) -> Judged:
    value, bar = (np.array([getattr(state, key) for state in states]) for key in (name, f"{name}_error"))
    return Judged(np.abs(value / exact - 1), bar / exact)


def judged(case: Case, folder: Path, **sections: Any) -> dict[str, Judged]:
    """Every number of a scene that theory knows: at prescribed depths, and at the forces that belong to them."""
    mapping = case.mapping()
    exact = theory(case, mapping)
    bars = {} if "accuracy" in sections else {"error_bars": True}
    pushed = run(from_mapping(mapping | sections), directory=folder / "depths", **bars).states
    names = {"flat_punch": (), "cone": ("a",)}.get(case.tip, ("a", "p_max"))  # a punch's a is given, its edge sharp
    numbers = {name: found(pushed, name, exact[name]) for name in names}
    forces = {"forces": exact["force"].tolist()}
    pressed = run(from_mapping(mapping | sections | {"loading": forces}), directory=folder / "forces", **bars).states
    return numbers | {"delta": found(pressed, "delta", exact["delta"])}


def together(runs: list[dict[str, Judged]], name: str) -> Judged:
    rows = [numbers[name] for numbers in runs if name in numbers]
    return Judged(np.concatenate([row.true for row in rows]), np.concatenate([row.bar for row in rows]))


def check(runs: list[dict[str, Judged]], share: float) -> None:
    for name in ("a", "p_max", "delta"):
        all_rows = together(runs, name)
        median, most = np.median(all_rows.true), all_rows.true.max()
        print(f"{name}: {len(all_rows.true)} rows, error {median:.1e} in the median, {most:.1e} at most; "
              f"{all_rows.held:.1%} held, bar over error {all_rows.width:.2g}")  # fmt: skip
        assert all_rows.held >= share
        assert all_rows.width <= 5


SIZES: dict[str, dict[str, Any]] = {
    "automatic": {},
    "0.05": {"accuracy": 0.05},
    "0.01": {"accuracy": 0.01},
    "0.001": {"accuracy": 0.001},
    "penalty": {"accuracy": 0.01, "contact": {"method": "penalty"}},
    "uzawa": {"contact": {"method": "uzawa"}},
    "active set": {"contact": {"method": "active_set"}},
}


@pytest.mark.verify
@pytest.mark.parametrize("name", SIZES)
def test_bars_hold_what_stands_beside_the_force(name: str, tmp_path: Path) -> None:
    """Random scenes, none of which chose a constant: 95 % of the rows, and bars five times as wide as the error at
    most, in the median."""
    runs = [judged(case, tmp_path / str(i), **SIZES[name]) for i, case in enumerate(drawn(60, seed=12))]
    check(runs, 0.95)


FEW = [Case("paraboloid", 0.1, 0.3), Case("sphere", 1.0, 0.4999, steps=3), Case("cone", 0.3, 0.45, "roller", steps=3)]


def test_bars_hold_the_numbers_of_a_few_scenes(tmp_path: Path) -> None:
    """One row in twenty may be outside its bar: one of eleven is let go."""
    check([judged(case, tmp_path / str(i), accuracy=0.05) for i, case in enumerate(FEW)], 0.9)
