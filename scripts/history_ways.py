#!/usr/bin/env python3
"""Compares ways to solve a history of a relaxing body: forces, errors and CPU, as Markdown tables.

usage: python scripts/history_ways.py

The ways are the quadrature of Lee, Radok and Ting on the elastic curve, time steps on the surface
compliance with nodal pressures (both are in the package), and time steps in which each step is a
contact of the condensed body by its own contact method, u = C F + free (`MemoryContact`, only
here). The numbers of steps are those of long steps; short ones at the beginning of each segment are
added. Errors are the largest of the force over the history, relative to the largest force; of a
force history they are those of the depth.
"""

from __future__ import annotations

import ast
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.condensed.contact import CondensedContact, ContactState
from indent_sim.fe.condensed.placed_tip import PlacedTip
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.run import history_on_curve
from indent_sim.run.history_on_curve import _HistoryEvaluation
from indent_sim.run.pipeline import condense
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.lee_radok_ting import LeeRadokTing
from indent_sim.theory.relaxation_function import ShearRelaxation
from indent_sim.theory.viscoelastic_stepping import ViscoelasticTimeStepper

# Times, and forces or depths at these times, (2, n).
Samples = np.ndarray
# Number of long steps that the time stepper of the package takes, and those that replace it.
STEPS = 2000
STEP_COUNTS = (125, 500, 2000)
# Element size in the contact of the finer meshes [R]; the contact radius is about 0.12 R.
FINE_SIZE = 0.001
SOLID = {"prony": [[0.5, 1.0]]}
SERIES = {"prony": [[0.3, 0.1], [0.2, 1.0], [0.2, 10.0]]}
POWER_LAW = {"power_law": {"exponent": 0.2, "time": 1.0}}
HOLD = [[0, 0], [0.5, 0.02], [3.0, 0.02]]
CYCLE = [[0, 0], [0.5, 0.02], [2.0, 0.02], [2.5, 0.0]]
SINE = [[0.05 * k, 0.01 * (1 - math.cos(0.05 * k * math.pi))] for k in range(121)]
CREEP = [[0, 0], [0.5, 1e-3], [3.0, 1e-3]]
HALF_SPACE = {"shape": "half_space"}
LAYER = {"shape": "layer", "height": 0.5, "base": "fixed"}
# Name, body, relaxation, key and points of a history.
HISTORIES = {
    "hold, standard solid, half-space": (HALF_SPACE, SOLID, "history", HOLD),
    "hold, power law, layer": (LAYER, POWER_LAW, "history", HOLD),
    "cycle, 3 terms, layer": (LAYER, SERIES, "history", CYCLE),
    "cycle, power law, half-space": (HALF_SPACE, POWER_LAW, "history", CYCLE),
    "sine, standard solid, layer": (LAYER, SOLID, "history", SINE),
    "force, standard solid, layer": (LAYER, SOLID, "force_history", CREEP),
}


def scene_of(name: str, method: str, h_contact: float | None = None) -> Scene:
    """Return the scene of a history, solved by theory or on a mesh."""
    body, relaxation, key, points = HISTORIES[name]
    return resolve(
        config_from_mapping(
            {
                "title": name,
                "body": body,
                "material": {
                    "model": "linear_elastic",
                    "E": 1.0,
                    "nu": 0.45,
                    "relaxation": relaxation,
                },
                "indenter": {"shape": "paraboloid", "R": 1.0},
                "loading": {key: points},
                "solver": {"method": method},
                **({"mesh": {"h_contact": h_contact}} if h_contact else {}),
            }
        )
    )


class CoarserTimeStepper(ViscoelasticTimeStepper):
    """The time stepper of the package with another number of steps."""

    step_factor = 1.0

    def _steps_of_segment(self, start: float, end: float) -> list[tuple[float, float]]:
        """Return the steps (end, length) of a segment, longer than those of the package."""
        factor = self.step_factor
        span = end - start
        longest_step = min(factor * max(span / 150, self._longest_step), span)
        dt = min(longest_step, factor * min(self._relaxation_times, default=span) / 20.0)
        dt = longest_step / 2.0 ** np.ceil(np.log2(longest_step / dt))
        steps: list[tuple[float, float]] = []
        t = start
        kink_steps = max(2, round(40 / factor))
        while dt < longest_step and t + kink_steps * dt < end:
            steps += [(t + dt * k, dt) for k in range(1, kink_steps + 1)]
            t = steps[-1][0]
            dt = 2.0 * dt
        count = max(1, round((end - t) / longest_step))
        dt = (end - t) / count
        return [*steps, *((t + dt * k, dt) for k in range(1, count)), (end, dt)]

    def all_steps(
        self, times: list[float], values: list[float]
    ) -> Iterator[tuple[float, float, float]]:
        """Yield the steps of a history as (time, length, value), from the first time on."""
        self._longest_step = (times[-1] - times[0]) / STEPS
        yield times[0], 0.0, values[0]
        for (t0, v0), (t1, v1) in pairwise(zip(times, values, strict=True)):
            steps = self._steps_of_segment(t0, t1) if t1 > t0 else [(t1, 0.0)]
            for end, dt in steps:
                fraction = (end - t0) / (t1 - t0) if t1 > t0 else 1.0
                yield end, dt, v0 + (v1 - v0) * fraction


class LoweredTip(PlacedTip):
    """A tip above a surface with a free displacement, which acts as if the tip were lower."""

    def __init__(self, contact: CondensedContact, forces: np.ndarray):
        super().__init__(contact.compliance, contact.scene)
        N, _, _ = contact.quadrature
        free = contact.compliance.C @ forces
        points = contact_quadrature(contact.compliance.trace.dim)[0]
        self._quadrature_heights = self.heights(points) - free[contact.nodes] @ N.T

    @property
    def quadrature_heights(self) -> np.ndarray:  # type: ignore[override]
        """Heights above the displaced surface at the contact quadrature points [length]."""
        return self._quadrature_heights


class MemoryContact:
    """Contact of a relaxing condensed body: u = (C/alpha) F + free, free = -(C/alpha) H.

    H are the nodal forces that the memory retains, and F those of the step; each step is solved by
    the contact method of the scene.
    """

    def __init__(self, contact: CondensedContact, modulus: ShearRelaxation):
        self._contact = contact
        self._compliance = contact.compliance
        self._modulus = modulus
        self._branch_forces = np.zeros((len(modulus.times), contact.compliance.size))
        self._elastic_forces = np.zeros(contact.compliance.size)
        self._state: ContactState | None = None
        self._alpha = 0.0

    def force(self, dt: float, delta: float) -> float:
        """Advance by dt to the depth delta; return the force of the model domain."""
        fractions = np.array(self._modulus.fractions)
        x = dt / np.array(self._modulus.times)
        decay = np.exp(-x)
        weights = fractions * np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
        alpha = self._modulus.long_term + float(weights.sum())
        retained = decay @ self._branch_forces - float(weights.sum()) * self._elastic_forces
        contact = self._contact_of(alpha)
        contact.tip = LoweredTip(contact, retained)
        if not contact.solve(delta):
            raise RuntimeError(contact.failure)
        self._state = contact.state
        elastic_forces = (contact.F - retained) / alpha
        change = elastic_forces - self._elastic_forces
        self._branch_forces = decay[:, None] * self._branch_forces + weights[:, None] * change
        self._elastic_forces = elastic_forces
        return contact.tip_force

    def _contact_of(self, alpha: float) -> CondensedContact:
        """Return the contact on the compliance C/alpha, at the last forces."""
        if alpha != self._alpha:
            scaled = replace(self._compliance, matrix=self._compliance.matrix / alpha)
            self._contact = CondensedContact(scaled, self._contact.scene)
            self._alpha = alpha
        if self._state:
            self._contact.restore(self._state)
        return self._contact


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return a result and its CPU time [s]."""
    start = time.process_time()
    return function(), time.process_time() - start


class Comparison:
    """One history, solved by theory or on a mesh in every way, beside its exact values."""

    def __init__(self, name: str, method: str, h_contact: float | None = None):
        self.name = name
        self.scene = scene_of(name, method, h_contact)
        self.body_seconds = 0.0
        equilibrium: Any = None
        if self.scene.is_meshed:
            body, self.body_seconds = timed(lambda: condense(self.scene))
            equilibrium = body.equilibrium
        self.evaluation = _HistoryEvaluation(self.scene, equilibrium)
        self.equilibrium = equilibrium
        history = self.evaluation.history
        assert history is not None
        self.history = history
        points = history.points_from_rest
        self.times = [t for t, _ in points]
        self.values = [value for _, value in points]
        shortest = 1e-3 * history.duration / len(points)
        self.prony = self.evaluation.modulus.prony_series(shortest, history.duration)
        self.is_force = history.control == "force"

    def _in_units(self, times: ArrayLike, values: ArrayLike) -> Samples:
        """Return times and forces, or depths of a force, in the user's units."""
        scales = self.scene.physics.scales
        return np.array([times, values]) * [
            [1.0],
            [scales.depth if self.is_force else scales.force],
        ]

    @property
    def max_depth(self) -> float:
        """The largest depth [length]; of a force, of the relaxed modulus."""
        return self.evaluation._max_depth_at(max(self.values), 0.5)

    def by_the_package(self) -> tuple[Samples, float]:
        """Return the rows of the package and their CPU time."""
        result, seconds = timed(self.evaluation.evaluate)
        values = [row.delta if self.is_force else row.force for row in result.rows]
        return self._in_units([row.t for row in result.rows], values), seconds

    def by_nodal_pressures(self, steps: int) -> tuple[Samples, float]:
        """Return the responses of the package's time stepper and its CPU time."""
        surface = self.evaluation.relaxing_surface(self.max_depth)
        stepper = CoarserTimeStepper(surface, self.prony, 0.0, self.is_force)
        stepper.step_factor = STEPS / steps
        rows = list(self.history.rows_per_segment)
        found, seconds = timed(lambda: list(stepper.responses(self.times, self.values, rows)))
        values = [response.delta if self.is_force else response.force for response in found]
        return self._in_units([response.t for response in found], values), seconds

    def by_contact_method(self, steps: int) -> tuple[Samples, float]:
        """Return the forces of the condensed body by its contact method, and the CPU time."""
        surface = self.evaluation.relaxing_surface(self.max_depth)
        stepper = CoarserTimeStepper(surface, self.prony)
        stepper.step_factor = STEPS / steps
        body = MemoryContact(self.equilibrium.contact, self.prony)
        factor = self.scene.physics.domain.symmetry_factor
        found, seconds = timed(
            lambda: [
                (t, factor * body.force(dt, delta))
                for t, dt, delta in stepper.all_steps(self.times, self.values)
            ]
        )
        times, forces = zip(*found, strict=True)
        return self._in_units(times, forces), seconds

    def error(self, found: Samples, theory: Comparison) -> float:
        """Return the largest difference from exact values, relative to the largest of them.

        The values of a sine are compared at its points, with four times as many steps.
        """
        if self.history.has_reloading:
            fine, _ = theory.by_nodal_pressures(4 * STEPS)
            exact = fine[1, np.isin(fine[0], self.times)]
            values = found[1, np.isin(found[0], self.times)]
        else:
            values = found[1, found[0] > 0]
            exact = theory.exact_values(found[0, found[0] > 0])
        return float(np.abs(values - exact).max() / np.abs(exact).max())

    def exact_values(self, times: np.ndarray) -> np.ndarray:
        """Return the exact forces, or depths of a force, by Lee, Radok and Ting at times > 0."""
        curve = self.evaluation.elastic_curve(self.max_depth)
        if not self.is_force:
            cycle = LeeRadokTing(self.evaluation.modulus, self.times, self.values, curve)
            return self._in_units(times, [cycle.response_at(t).force for t in times])[1]
        # A growing contact: F_el(delta(t)) = int J(t - s) dF(s), with the creep compliance
        # J = 2 - exp(-t/2) of the solid with the modulus (1 + exp(-t))/2.
        end = self.times[1]
        late = np.maximum(times - end, 0.0)
        forces = 2 * (times - late + np.exp(-times / 2) - np.exp(-late / 2)) * self.values[1] / end
        return self._in_units(times, [curve.depth_of_force(force) for force in forces])[1]


def lines(name: str, method: str, h_contact: float | None = None) -> Iterator[str]:
    """Yield the lines of the table for one history, solved by theory or on a mesh."""
    theory = Comparison(name, "theory")
    comparison = Comparison(name, method, h_contact)
    points = len(comparison.evaluation.relaxing_surface(comparison.max_depth).areas)

    def cell(solution: tuple[Samples, float]) -> str:
        found, seconds = solution
        return f"{comparison.error(found, theory):.1e}, {seconds:.3f} s"

    def line(way: str, cells: Sequence[str]) -> str:
        body = f"{method}, {points}"
        if comparison.scene.is_meshed:
            body += f", {comparison.body_seconds:.2f} s"
        return f"| {name} | {body} | {way} | {' | '.join(cells)} |"

    today = cell(comparison.by_the_package())
    ways = {"nodal pressures": comparison.by_nodal_pressures}
    if method == "condensed" and not comparison.is_force:
        ways["contact method"] = comparison.by_contact_method
    yield line(f"package: {comparison.evaluation.method}", [today, *[""] * len(STEP_COUNTS)])
    for way, solve in ways.items():
        yield line(way, ["", *(cell(solve(steps)) for steps in STEP_COUNTS)])


def line_counts() -> Iterator[str]:
    """Yield the rows of a table of lines: of files, and of their functions and classes."""
    package = Path(history_on_curve.__file__).parents[1]
    parts: dict[Path, tuple[str, ...]] = {
        package / "run/history_on_curve.py": (
            "_lee_radok_ting_rows",
            "_time_stepped_rows",
            "relaxing_surface",
        ),
        package / "theory/lee_radok_ting.py": (),
        package / "theory/viscoelastic_stepping.py": (),
        Path(__file__): ("LoweredTip", "MemoryContact"),
    }
    for path, names in parts.items():
        source = path.read_text()
        yield f"| {path.name} | {len(source.splitlines())} |"
        sizes = {
            node.name: (node.end_lineno or 0) - node.lineno + 1
            for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.FunctionDef | ast.ClassDef)
        }
        yield from (f"| {path.name}, {name} | {sizes[name]} |" for name in names)


def main() -> None:
    """Print the tables."""
    steps = " | ".join(f"{count} steps" for count in STEP_COUNTS)
    print(f"| history | solver, points, condensation | way | rows of the package | {steps} |")
    print("|---|---|---|" + "---|" * (1 + len(STEP_COUNTS)))
    scenes = [(name, method, None) for method in ("theory", "condensed") for name in HISTORIES]
    for scene in (*scenes, ("cycle, 3 terms, layer", "condensed", FINE_SIZE)):
        for line in lines(*scene):
            print(line, flush=True)
    print("\n| part | lines |\n|---|--:|")
    print("\n".join(line_counts()))


if __name__ == "__main__":
    main()
