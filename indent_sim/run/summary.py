"""Summary of a run for run.json: theory beside it, its audit, its cost."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.model.state import PullOff, State
from indent_sim.model.symbols import PULL_OFF
from indent_sim.model.tips import Sphere
from indent_sim.process.usage import Clock, peak_memory
from indent_sim.run.derived_quantities import hertz_fit, hertz_forces
from indent_sim.run.run_output import OptionalOutput
from indent_sim.run.sanity_checks import MAX_ROUGHNESS
from indent_sim.scene.predictions import ExpectedAdhesion
from indent_sim.scene.reference_theory import half_space_depth, half_space_force, relative_tip
from indent_sim.scene.scene import FRICTION_WHY, Scene
from indent_sim.theory.no_slip import FRICTIONLESS
from indent_sim.theory.solution import SOLUTION_ERRORS, Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.theory.adhesion import AdhesiveContact

FORCE_TOLERANCE = 1e-6  # relative: rows with one force, but for what the solver leaves of it
# of the curves kept for the plot, a formula's and theory's
FORMULA_POINTS = 50
THEORY_POINTS = 20


def summary(
    scene: Scene,
    states: list[State],
    clock: Clock,
    worst_audit: float | None,
    optional_output: OptionalOutput,
    pull_off: PullOff | None = None,
) -> dict[str, Any]:
    """The closing entries of run.json: theory, audit, timings (wall and CPU) [s] and peak memory
    [MB].
    """
    krylov = [state.krylov_iterations for state in states if state.krylov_iterations is not None]
    expected = scene.plan.adhesion
    is_in_time = (
        scene.history_on_curve is not None or scene.physics.is_time_dependent
    )  # what is said of equilibria is not of these
    balance = (
        None if expected or is_in_time else energy_balance(states)
    )  # what snaps, relaxes or drains loses some
    audit = {"force_against_reaction": worst_audit, "energy_by_trapezoid": balance}
    audit["newton_iterations"] = sum(state.newton_iterations for state in states)
    if krylov:
        audit["krylov_iterations"] = sum(krylov)
    audit["substeps"] = sum(state.substeps for state in states)
    entries = {
        "theory": None
        if is_in_time
        else optional_output(
            "theory", lambda: theory_comparison(scene, states, optional_output), None
        )
    }
    if expected:
        entries["adhesion"] = optional_output(
            "adhesion", lambda: adhesion_entry(expected, states, pull_off), {}
        )
    fitted = (
        None if is_in_time else optional_output("Hertz fit", lambda: hertz_fit(scene, states), None)
    )
    entries |= {"hertz": fitted, "audit": audit}
    if states and states[-1].reactions is not None:
        entries["reactions"] = _reactions_by_support(states[-1])
    if roughness := {
        str(state.step): state.roughness for state in states if state.roughness > MAX_ROUGHNESS
    }:
        entries["roughness"] = roughness
    timings = {"timings": rounded_timings(clock.stages), "cpu_timings": rounded_timings(clock.cpu)}
    return entries | timings | {"peak_memory_MB": round(peak_memory(), 1)}


def _reactions_by_support(state: State) -> dict[str, Any]:
    """Return the step of a row, and the force of each support on the body by support and axis
    [force].
    """
    supports: dict[str, Any] = {}
    for name, force in (state.reactions or {}).items():
        support, axis = name.rsplit("_", 1)
        supports.setdefault(support, {})[axis] = force
    return {"step": state.step} | supports


def rounded_timings(seconds: Mapping[str, float]) -> dict[str, float]:
    """Seconds of the stages of a run, as run.json has them."""
    return {name: round(value, 4) for name, value in seconds.items()}


def energy_balance(states: list[State]) -> float | None:
    """Relative difference between int F ddelta (trapezoid rule) and the energy with what friction
    took of it.

    Reported, not judged: on a coarse path the rule itself is wrong by far more than the solution.
    None where there is no energy; a tip that adheres loses some where it jumps, between two rows.
    """
    stored_and_dissipated = (states[-1].energy if states else 0.0) + sum(
        state.dissipation or 0.0 for state in states
    )
    if (
        len(states) < 2
        or stored_and_dissipated == 0
        or stored_and_dissipated != stored_and_dissipated
    ):
        return None
    delta = np.array([0.0, *(state.delta for state in states)])
    force = np.array([0.0, *(state.force for state in states)])
    work = float(np.sum(np.diff(delta) * (force[1:] + force[:-1]) / 2))
    return work / stored_and_dissipated - 1


def row_of_interest(states: Sequence[State], is_force_prescribed: bool) -> State:
    """The row that a run was made for: that of the largest force, the last one where no force
    pushes.

    Of several rows of this force the first, or where forces are prescribed the deepest, as of a
    creep.
    """
    largest_force = max(state.force for state in states)
    if not largest_force > 0:
        return states[-1]
    largest_rows = [
        state for state in states if state.force >= (1 - FORCE_TOLERANCE) * largest_force
    ]
    return (
        max(largest_rows, key=lambda state: state.delta) if is_force_prescribed else largest_rows[0]
    )


@dataclasses.dataclass(frozen=True)
class HysteresisLoop:
    """The loop of force over depth of a path that comes back.

    area [force length]: between the way in and the way back, the work that the tip is not given
    back; error: of the straight lines between rows, estimated; way_in: the work of the way in;
    is_closed: the tip does not push at the end.
    """

    area: float
    error: float
    way_in: float
    is_closed: bool


def hysteresis_loop(states: Sequence[State]) -> HysteresisLoop | None:
    """The loop of a path; None where the tip does not come back.

    The area is that of straight lines through the rows, whose error goes with the square of their
    distance: a third of what leaving out every second row between turning points changes.
    """
    rows = [(state.delta, state.force) for state in states]
    if rows[0][0] > 0:  # the way in begins at first touch
        rows.insert(0, (0.0, 0.0))
    steps = [end[0] - begin[0] for begin, end in pairwise(rows)]
    work = [_work(*step) for step in pairwise(rows)]
    way_in = sum(segment_work for segment_work, step in zip(work, steps, strict=True) if step > 0)
    if min(steps, default=0.0) >= 0 or not way_in > 0:
        return None
    turns = [i for i in range(1, len(steps)) if steps[i - 1] * steps[i] <= 0]
    kept_rows = sorted({*range(0, len(rows), 2), *turns, len(rows) - 1})
    coarse_area = sum(
        _work(rows[begin_row], rows[end_row]) for begin_row, end_row in pairwise(kept_rows)
    )
    is_closed = not (rows[-1][0] > 0 and rows[-1][1] > 0)
    return HysteresisLoop(sum(work), abs(sum(work) - coarse_area) / 3, way_in, is_closed)


def _work(begin: tuple[float, float], end: tuple[float, float]) -> float:
    """The work of a force that is straight between two pairs of depth and force."""
    return (end[0] - begin[0]) * (begin[1] + end[1]) / 2


def expected_pull_offs(adhesion_report: Mapping[str, Any]) -> list[tuple[str, float]]:
    """What is known beforehand of the largest pull, by what a run says of its adhesion: in words,
    and how much.
    """
    return [
        (symbol.meaning, force)
        for symbol in PULL_OFF
        if (force := adhesion_report.get(symbol.name)) is not None
    ]


def theory_comparison(
    scene: Scene, states: list[State], optional_output: OptionalOutput | None = None
) -> dict[str, Any] | None:
    """Small-strain theory beside the deepest state, and its curve over the depths walked; None
    without theory.

    Theory is asked for what the run found: for the force at its depth, or for the depth at the
    force prescribed, with the friction of the scene where that is known. `force_deviation` or
    `delta_deviation` = this run / theory - 1; `exact` when the finite body is the theory's own.
    Beside a tip that adheres it is that of one without range (JKR), with its stable branch.
    """
    if scene.plan.adhesion:
        return _jkr_comparison(scene, states)
    optional_output = optional_output or OptionalOutput()
    theory = scene.plan.theory
    deepest = max(states, key=lambda state: state.delta, default=None)
    if theory is None or deepest is None or deepest.delta <= 0:
        return None
    correction = scene.plan.friction
    friction = correction or FRICTIONLESS
    differences = _theory_differences(scene)
    scales = scene.physics.scales
    D = scales.depth
    L = scales.length * friction.radius
    F = scales.force * friction.force / scene.physics.mirror_multiplicity
    L *= scene.physics.row_contact_radius(1.0)
    depth: float | None = deepest.delta / D
    if scene.physics.path.control == "force":  # theory's at this force, where it is in the body
        depth = theory.depth_of_force(deepest.force / F, scene.physics.body.height)
        depth = depth if depth is not None and depth < scene.physics.body.height else None
    solution = None if depth is None else theory.solution_at_depth(depth)
    if solution is None:
        return None
    numbers = _contact_numbers(solution, D, F, L)
    name = "delta" if scene.physics.path.control == "force" else "force"
    deviation = {
        f"{name_compared}_deviation": getattr(deepest, name_compared) / numbers[name_compared] - 1
        for name_compared in (name, "a")
    }
    curve = (
        theory.contact.solutions_up_to(solution, THEORY_POINTS) if scene.is_meshed else []
    )  # else: the rows
    friction_text = (
        f" {'with' if correction else 'without'} friction"
        if FRICTION_WHY in scene.theory_differences
        else ""
    )
    why = "; ".join([*differences, *_mirror_notes(scene)]) or theory.reason
    entries = {"name": theory.name + friction_text, "exact": not differences, "why": why}
    comparisons: dict[str, Any] = {
        "half_space": optional_output(
            "half-space formula", lambda: _half_space_comparison(scene, deepest), None
        )
    }
    comparisons["formulas"] = optional_output(
        "film formulas", lambda: _formula_comparisons(scene, theory, deepest), []
    )
    return entries | numbers | deviation | comparisons | {"curve": _curve_columns(curve, D, F, L)}


def _mirror_notes(scene: Scene) -> list[str]:
    """That what stands beside a run is a part of the whole contact, where the tip sees the body
    mirrored.
    """
    fraction_names = {2: "half", 4: "a quarter"}
    return (
        [f"{fraction_names[scene.physics.mirror_multiplicity]} of the mirrored contact's"]
        if scene.physics.mirror_multiplicity > 1
        else []
    )


def _contact_numbers(
    contact: Solution | AdhesiveContact, D: float, F: float, L: float
) -> dict[str, float]:
    """Depth, force and radius of a contact in the units D, F and L."""
    return {"delta": contact.delta * D, "force": contact.force * F, "a": contact.a * L}


def _curve_columns(
    curve: Sequence[Solution | AdhesiveContact], D: float, F: float, L: float
) -> dict[str, list[float]]:
    rows = [_contact_numbers(contact, D, F, L) for contact in curve]
    return {name: [row[name] for row in rows] for name in ("delta", "force", "a")}


def _formula_comparisons(scene: Scene, theory: Theory, state: State) -> list[dict[str, Any]]:
    """What the usual formulas for films and thin layers say at the state's depth, or at its force,
    beside the run.
    """
    D = scene.physics.scales.depth
    F = scene.physics.scales.force / scene.physics.mirror_multiplicity
    is_forced = scene.physics.path.control == "force"
    name, unit, force = ("delta", D, state.force / F) if is_forced else ("force", F, None)
    run_value = getattr(state, name)
    predictions = (
        (formula, theory.formula_value(formula, state.delta / D, force))
        for formula in theory.formulas
    )
    values = [
        (formula, value * unit)
        for formula, value in predictions
        if value is not None and run_value != 0
    ]
    return [
        {"name": formula, name: value, "deviation": value / run_value - 1}
        for formula, value in values
    ]


def adhesion_entry(
    expected: ExpectedAdhesion, states: Sequence[State], pull_off: PullOff | None
) -> dict[str, Any]:
    """What was known of the attraction beforehand, the largest pull of a row and that between rows.

    Parameters
    ----------
    expected
        What was known beforehand [user's units].
    states
        The rows [user's units].
    pull_off
        The largest pull between rows [user's units]; None where none was searched for.
    """
    pulled = min(
        (state for state in states if state.force < 0), key=lambda state: state.force, default=None
    )
    row = {"step": pulled.step, "delta": pulled.delta, "force": pulled.force} if pulled else None
    return dataclasses.asdict(expected) | {
        "largest_pull": row,
        "pull_off": pull_off and _pull_off_entry(pull_off),
    }


def _pull_off_entry(pull_off: PullOff) -> dict[str, Any]:
    """A pull-off as run.json has it."""
    return {
        "delta": pull_off.state.delta,
        "force": pull_off.state.force,
        "error": pull_off.error if isfinite(pull_off.error) else None,
        "equilibria": pull_off.equilibria,
        "newton_iterations": pull_off.state.newton_iterations,
    }


def _jkr_comparison(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """The JKR limit beside the deepest state, and its stable branch; None where it is not known or
    has come off.
    """
    jkr = scene.plan.jkr
    scales = scene.physics.scales
    is_forced = scene.physics.path.control == "force"
    deepest = max(states, key=lambda state: state.delta, default=None)
    if jkr is None or deepest is None:
        return None
    L = scales.length * scene.physics.row_contact_radius(1.0)
    F = scales.force / scene.physics.mirror_multiplicity
    D = scales.depth
    target = (deepest.force / F, inf) if is_forced else (deepest.delta / D, 0.0)
    try:
        deepest_contact = jkr.stable_equilibrium(*target)
        pull_off = jkr.pull_off()
        if deepest_contact is None:
            return None
        contacts = map(
            jkr.stable_branch(deepest_contact.delta),
            map(float, np.linspace(pull_off.delta, deepest_contact.delta, FORMULA_POINTS)),
        )
        curve = [contact for contact in contacts if contact]
    except SOLUTION_ERRORS:
        return None
    numbers = _contact_numbers(deepest_contact, D, F, L)
    name = "delta" if is_forced else "force"
    deviation = (
        {f"{name}_deviation": getattr(deepest, name) / numbers[name] - 1} if numbers[name] else {}
    )
    entries = {
        "name": "JKR",
        "exact": False,
        "why": "; ".join([*scene.theory_differences, *_mirror_notes(scene)]),
    }
    deviation |= {"a_deviation": deepest.a / numbers["a"] - 1}
    return entries | numbers | deviation | {"curve": _curve_columns(curve, D, F, L)}


def _theory_differences(scene: Scene) -> tuple[str, ...]:
    """What the problem has that theory, with friction where that is known, has not."""
    known_friction = FRICTION_WHY if scene.plan.friction else ""
    sphere_reason = (
        ("its friction is that of a paraboloid",)
        if known_friction and isinstance(scene.physics.indenter, Sphere)
        else ()
    )
    return (*(why for why in scene.theory_differences if why != known_friction), *sphere_reason)


def _half_space_comparison(scene: Scene, state: State) -> dict[str, Any] | None:
    """The half-space formula's force at the state's depth, or depth at its force, and how that
    differs from the run.
    """
    if scene.physics.scales.dim == 2:
        return None
    D = scene.physics.scales.depth
    F = scene.physics.scales.force / scene.physics.mirror_multiplicity
    E_star = scene.physics.material.E_star
    tip = relative_tip(scene.physics.indenter, scene.physics.body)
    closed = half_space_force(tip, state.delta / D, E_star)
    name = "force"
    unit = F
    if scene.physics.path.control == "force":
        closed = half_space_depth(tip, state.force / F, E_star)
        name = "delta"
        unit = D
    if closed is None or getattr(state, name) == 0:
        return None
    value = closed[1] * unit
    depths = [state.delta / D * n / FORMULA_POINTS for n in range(1, FORMULA_POINTS + 1)]
    curve = [
        (delta, force)
        for delta, force in zip(depths, hertz_forces(scene, depths), strict=True)
        if force
    ]
    unit_force = scene.physics.scales.force  # `hertz_forces` are of the body itself
    columns = {
        "delta": [delta * D for delta, _ in curve],
        "force": [force * unit_force for _, force in curve],
    }
    return {
        "name": closed[0],
        name: value,
        "deviation": value / getattr(state, name) - 1,
        "curve": columns,
    }
