"""Summary of a run in run.json: comparison with theory, force balance, cost."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from indent_sim.model.state import PullOff, State
from indent_sim.model.symbols import PULL_OFF
from indent_sim.process.usage import Clock, peak_memory
from indent_sim.run.derived_quantities import hertz_fit
from indent_sim.run.measured_constants import MAX_ROUGHNESS
from indent_sim.run.run_output import OptionalOutput
from indent_sim.run.theory_comparison import theory_comparison
from indent_sim.run.work_and_loops import energy_balance
from indent_sim.run.yield_comparison import onset_entry
from indent_sim.scene.predictions import ExpectedAdhesion
from indent_sim.scene.scene import Scene


def summary(
    scene: Scene,
    states: list[State],
    clock: Clock,
    worst_audit: float | None,
    optional_output: OptionalOutput,
    pull_off: PullOff | None = None,
) -> dict[str, Any]:
    """Return the last entries of run.json: theory, force balance, timings [s], peak memory [MB].

    Parameters
    ----------
    scene
        The scene of the run.
    states
        The rows of the run [user's units].
    clock
        The timings (wall and CPU) of the stages of the run.
    worst_audit
        Largest relative imbalance of forces and of fluid in a row; None without a mesh.
    optional_output
        Evaluates entries; a failure is reported and does not stop the run.
    pull_off
        The largest tensile force between rows; None if it was not searched for.
    """
    krylov = [state.krylov_iterations for state in states if state.krylov_iterations is not None]
    expected = scene.plan.adhesion
    # Theory and Hertz fit describe elastic equilibria only.
    is_time_dependent = scene.history_on_curve is not None or scene.physics.is_time_dependent
    # Energy is dissipated in snap-in and pull-off, relaxation and drainage.
    balance = (
        None
        if expected or is_time_dependent
        else energy_balance(states, scene.physics.slide_force_column)
    )
    audit = {"force_against_reaction": worst_audit, "energy_by_trapezoid": balance}
    audit["newton_iterations"] = sum(state.newton_iterations for state in states)
    if krylov:
        audit["krylov_iterations"] = sum(krylov)
    audit["substeps"] = sum(state.substeps for state in states)
    entries = {
        "theory": None
        if is_time_dependent
        else optional_output(
            "theory", lambda: theory_comparison(scene, states, optional_output), None
        )
    }
    if onset := optional_output("onset of yield", lambda: onset_entry(scene, states), None):
        entries["onset_of_yield"] = onset
    if expected:
        entries["adhesion"] = optional_output(
            "adhesion", lambda: adhesion_entry(expected, states, pull_off), {}
        )
    fitted = (
        None
        if is_time_dependent
        else optional_output("Hertz fit", lambda: hertz_fit(scene, states), None)
    )
    entries |= {"hertz": fitted, "audit": audit}
    if states and states[-1].reactions is not None:
        entries["reactions"] = _reactions_by_support(states[-1])
    if roughness := {
        str(state.step): state.roughness for state in states if state.roughness > MAX_ROUGHNESS
    }:
        entries["roughness"] = roughness
    if clearance := {
        str(state.step): state.clearance for state in states if state.clearance is not None
    }:
        entries["clearance"] = clearance
    timings = {"timings": rounded_timings(clock.stages), "cpu_timings": rounded_timings(clock.cpu)}
    return entries | timings | {"peak_memory_MB": round(peak_memory(), 1)}


def _reactions_by_support(state: State) -> dict[str, Any]:
    """Return the step of a row and its reactions [force] as {support: {axis: force}}."""
    supports: dict[str, Any] = {}
    for name, force in (state.reactions or {}).items():
        support, axis = name.rsplit("_", 1)
        supports.setdefault(support, {})[axis] = force
    return {"step": state.step} | supports


def rounded_timings(seconds: Mapping[str, float]) -> dict[str, float]:
    """Return the durations [s] of the stages of a run, rounded for run.json."""
    return {name: round(value, 4) for name, value in seconds.items()}


def row_of_interest(states: Sequence[State], is_force_prescribed: bool) -> State:
    """Return the row with the largest force, or the last row if no force is positive.

    If several rows have this force, the first one is returned; under prescribed forces the deepest
    row is returned, which is the last row of a creep test.
    """
    largest_force = max(state.force for state in states)
    if not largest_force > 0:
        return states[-1]
    # Forces count as equal up to this relative difference, which exceeds the tolerance of the
    # solver.
    tolerance = 1e-6
    largest_rows = [state for state in states if state.force >= (1 - tolerance) * largest_force]
    return (
        max(largest_rows, key=lambda state: state.delta) if is_force_prescribed else largest_rows[0]
    )


def expected_pull_offs(adhesion_report: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return meaning and value of each pull-off force predicted by the adhesion report."""
    return [
        (symbol.meaning, force)
        for symbol in PULL_OFF
        if (force := adhesion_report.get(symbol.name)) is not None
    ]


def adhesion_entry(
    expected: ExpectedAdhesion, states: Sequence[State], pull_off: PullOff | None
) -> dict[str, Any]:
    """Return the entry `adhesion` of run.json: predictions, largest tensile force, pull-off.

    Parameters
    ----------
    expected
        The predictions [user's units].
    states
        The rows [user's units].
    pull_off
        The largest tensile force between rows [user's units]; None if it was not searched for.
    """
    most_tensile = min(
        (state for state in states if state.force < 0), key=lambda state: state.force, default=None
    )
    row = (
        {"step": most_tensile.step, "delta": most_tensile.delta, "force": most_tensile.force}
        if most_tensile
        else None
    )
    return dataclasses.asdict(expected) | {
        "largest_pull": row,
        "pull_off": pull_off and _pull_off_entry(pull_off),
    }


def _pull_off_entry(pull_off: PullOff) -> dict[str, Any]:
    """Return the entry of run.json that describes a pull-off."""
    return {
        "delta": pull_off.state.delta,
        "force": pull_off.state.force,
        "error": pull_off.error if isfinite(pull_off.error) else None,
        "equilibria": pull_off.equilibria,
        "newton_iterations": pull_off.state.newton_iterations,
    }
