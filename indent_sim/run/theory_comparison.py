"""Comparison of a run with theory and with half-space formulas."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.model.state import State
from indent_sim.model.tips import Sphere
from indent_sim.run.derived_quantities import hertz_forces
from indent_sim.run.run_output import OptionalOutput
from indent_sim.run.yield_comparison import has_yielded, published_comparison
from indent_sim.scene.half_space_formulas import half_space_depth, half_space_force
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import FRICTION_WHY, YIELD_WHY, Scene
from indent_sim.theory.no_slip import FRICTIONLESS
from indent_sim.theory.solution import SOLUTION_ERRORS, Solution
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.theory.adhesion import AdhesiveContact  # loads scipy.optimize

FORMULA_POINTS = 50  # points of the stored curve of a formula


def theory_comparison(
    scene: Scene, states: list[State], optional_output: OptionalOutput | None = None
) -> dict[str, Any] | None:
    """Compare a run with small-strain theory at the largest depth; None without theory.

    Theory is evaluated at the depth of the run, or at its force if forces are prescribed, with the
    friction of the scene if its effect is known. `force_deviation` or `delta_deviation` is run /
    theory - 1; `exact` is true if the theory is exact for the body. With adhesion the comparison is
    with JKR theory, and for a body that has yielded with the functions of Dao et al., where these
    hold.

    Parameters
    ----------
    scene
        The scene of the run.
    states
        The rows of the run [user's units].
    optional_output
        Evaluates entries; a failure is reported and does not stop the run.
    """
    if scene.plan.adhesion:
        return _jkr_comparison(scene, states)
    if has_yielded(states):
        return published_comparison(scene, states)
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
    # The theoretical depth of the force counts only if it is less than the height of the body.
    if scene.physics.path.control == "force":
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
    # Points of the stored curve of theory.
    theory_points = 20
    # Without a mesh the rows are the curve of theory.
    curve = theory.contact.solutions_up_to(solution, theory_points) if scene.is_meshed else []
    friction_text = ""
    if FRICTION_WHY in scene.theory_differences:
        friction_text = " with friction" if correction else " without friction"
    remarks = [*differences, *_edge_remarks(scene, deepest), *_mirror_notes(scene)]
    why = "; ".join(remarks) or theory.reason
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


def _edge_remarks(scene: Scene, state: State) -> list[str]:
    """Return a remark if the edge of the body cuts off a part of the contact."""
    physics = scene.physics
    if physics.is_compressed:
        return []
    edge_distance = physics.body.lateral_extent(physics.center) * physics.scales.length
    return (
        ["the edge of the body cuts off a part of the contact"] if state.a > edge_distance else []
    )


def _mirror_notes(scene: Scene) -> list[str]:
    """Return a note if the force of theory is divided between the contact and mirror images."""
    fraction_names = {2: "half", 4: "a quarter"}
    return (
        [
            f"{fraction_names[scene.physics.mirror_multiplicity]} of the force of the contact "
            "with its mirror images"
        ]
        if scene.physics.mirror_multiplicity > 1
        else []
    )


def _contact_numbers(
    contact: Solution | AdhesiveContact, D: float, F: float, L: float
) -> dict[str, float]:
    """Return depth, force and radius of a contact in the user's units."""
    return {"delta": contact.delta * D, "force": contact.force * F, "a": contact.a * L}


def _curve_columns(
    curve: Sequence[Solution | AdhesiveContact], D: float, F: float, L: float
) -> dict[str, list[float]]:
    """Return columns of depth, force and radius of a curve in the user's units."""
    rows = [_contact_numbers(contact, D, F, L) for contact in curve]
    return {name: [row[name] for row in rows] for name in ("delta", "force", "a")}


def _formula_comparisons(scene: Scene, theory: Theory, state: State) -> list[dict[str, Any]]:
    """Compare the run with formulas for films and thin layers at a state's depth or force."""
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


def _jkr_comparison(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """Return the JKR limit at the largest depth and its stable branch; None if not defined."""
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
    """Return the differences between the problem and the theory, which may include friction."""
    known_friction = FRICTION_WHY if scene.plan.friction else ""
    # A body that has yielded is not compared with elastic theory.
    ignored = (known_friction, YIELD_WHY)
    sphere_reason = (
        ("the theory's effect of friction is that under a paraboloid",)
        if known_friction and isinstance(scene.physics.indenter, Sphere)
        else ()
    )
    return (*(why for why in scene.theory_differences if why not in ignored), *sphere_reason)


def _half_space_comparison(scene: Scene, state: State) -> dict[str, Any] | None:
    """Compare the run with the half-space formula at the depth or force of a state."""
    if scene.physics.scales.dim == 2:
        return None
    D = scene.physics.scales.depth
    F = scene.physics.scales.force / scene.physics.mirror_multiplicity
    E_star = scene.physics.contact_modulus
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
    # `hertz_forces` does not count mirror images, and takes the tip as rigid.
    unit_force = scene.physics.scales.force * E_star / scene.physics.material.E_star
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
