"""Warnings of rows: too few elements, lost contact, oscillating pressure, long increments."""

from __future__ import annotations

from collections.abc import Sequence

from indent_sim.model.state import State
from indent_sim.model.tips import flat_radius
from indent_sim.run.measured_constants import MAX_ROUGHNESS, MAX_STEP_CHANGE
from indent_sim.run.sanity_checks import FORCE_NOISE
from indent_sim.scene.discretisation_warnings import UNDERRESOLVED_ERROR, refinement_advice
from indent_sim.scene.expected_error import error_text, expected_force_error, swelling_force_error
from indent_sim.scene.scene import Scene


def underresolved_rows(scene: Scene, states: Sequence[State]) -> list[str]:
    """Return warnings about rows whose contact has too few elements, unless the plan has warned.

    If forces are prescribed or the contact grows with time, its smallest radius is known only
    after the solution.

    Parameters
    ----------
    scene
        The scene of the run.
    states
        The rows of the run [user's units].

    Returns
    -------
    list of str
        One warning at most.
    """
    is_predicted = any(force_error.key == "elements" for force_error in scene.plan.model_warnings)
    if (
        is_predicted
        or not scene.is_meshed
        or scene.history_on_curve
        or scene.physics.contact.may_snap_through
    ):
        return []
    L = scene.physics.scales.length
    sizes = scene.sizes
    min_force = FORCE_NOISE * max((state.force for state in states), default=0.0)
    force_errors = {
        state.step: _row_force_error(scene, state)
        for state in states
        if state.force > min_force and state.a > 0
    }
    steps = [
        step for step, force_error in force_errors.items() if force_error >= UNDERRESOLVED_ERROR
    ]
    if not steps:
        return []
    max_elements = max(
        sizes.elements_in_contact(scene.physics.full_contact_radius(state.a / L))
        for state in states
        if state.step in steps
    )
    rows = (
        f"step {steps[0]} has"
        if len(steps) == 1
        else f"{len(steps)} rows from step {steps[0]} on have"
    )
    errors = sorted(force_errors[step] for step in steps)
    span = " to ".join(dict.fromkeys(error_text(errors[k]) for k in (0, -1)))
    force_text = f"the force there may be wrong by {span}, pressures by more"
    remedy = refinement_advice(
        sizes, "give mesh.h_contact and a smaller mesh.h_axis, or set accuracy"
    )
    return [
        f"{rows} at most {max_elements:.2g} elements in the contact radius: {force_text}; {remedy}"
    ]


def lost_contact_warnings(scene: Scene, states: Sequence[State]) -> list[str]:
    """Return warnings about rows in which the surface of a shrinking gel has left the tip.

    The force of these rows is zero although the tip is below the undeformed surface, or was in
    contact before. Rows in which the tip retracts are left out. Under prescribed forces the contact
    is never lost.

    Parameters
    ----------
    scene
        The scene of the run.
    states
        The rows of the run [user's units].

    Returns
    -------
    list of str
        One warning at most.
    """
    if scene.physics.path.control == "force" or not scene.physics.is_swelling:
        return []
    lost: list[State] = []
    last_contact = "the beginning of the history"
    contact_text = ""
    has_touched = False
    for state in states:
        if state.a > 0:
            has_touched = True
            last_contact = _time_text(state)
        elif state.clearance is not None and state.branch != "retract":
            if state.delta < 0 and not has_touched:
                continue
            if not lost:
                contact_text = f"between {last_contact} and {_time_text(state)}"
            lost.append(state)
    if not lost:
        return []
    depths = [state.delta + (state.clearance or 0.0) for state in lost]
    rows = (
        f"step {lost[0].step} has"
        if len(lost) == 1
        else f"{len(lost)} rows from step {lost[0].step} on have"
    )
    return [
        f"{rows} no contact and zero force: the gel shrinks away from the tip, and contact was "
        f"lost {contact_text}; the surface below the tip has retreated to a depth of "
        f"{max(depths):.4g} ({_time_text(lost[depths.index(max(depths))])}), and a tip must be "
        "deeper to touch it"
    ]


def _time_text(state: State) -> str:
    """Return the time of a row as text, such as "t = 0.5"."""
    return f"t = {state.t:.4g}"


def oscillating_pressure_warnings(scene: Scene, states: Sequence[State]) -> list[str]:
    """Return warnings about rows whose contact pressure oscillates from node to node.

    Parameters
    ----------
    scene
        The scene of the run.
    states
        The rows of the run, in any units.

    Returns
    -------
    list of str
        One warning at most.
    """
    oscillating = [state for state in states if state.roughness > MAX_ROUGHNESS]
    if not oscillating:
        return []
    worst = max(oscillating, key=lambda state: state.roughness)
    size_text = f"{100 * worst.roughness:.2g} % of its peak"
    rows = f"step {worst.step}: the pressure alternates from node to node by {size_text}"
    if len(oscillating) > 1:
        rows = (
            f"{len(oscillating)} rows from step {oscillating[0].step} on: the pressure alternates "
            "from node to node"
        )
        min_roughness = min(state.roughness for state in oscillating)
        rows = f"{rows}, by {100 * min_roughness:.2g} to {size_text}, most in step {worst.step}"
    return [
        f"{rows}; p_max and `pressure` of the surface have this uncertainty, the force a far "
        f"smaller one; {_smoothing_advice(scene)}"
    ]


def long_step_warnings(scene: Scene, states: Sequence[State]) -> list[str]:
    """Return warnings about load increments that are too long to resolve the slip zone.

    In an increment in which the contact radius grows from a_0 to a, all new contact slips at once.
    The relative error of the stick radius is then about (a - a_0)/a, and the relative error of the
    dissipation is about half of (a - a_0)/(a - stick radius); the error of the force is small. Rows
    with less than half of the largest contact radius are left out, because in every run the contact
    of the first row grows from zero in a single increment.

    Parameters
    ----------
    scene
        The scene of the run, without error bars.
    states
        The rows of the run, in the user's units.

    Returns
    -------
    list of str
        One warning at most.
    """
    if not scene.physics.contact.may_slip or not scene.is_meshed:
        return []
    largest_radius = max((state.a for state in states), default=0.0)
    previous_radius = _radius_of_first_contact(scene) * scene.physics.scales.length
    step_changes: dict[int, tuple[float, float, float]] = {}
    for state in states:
        larger_radius = max(previous_radius, state.a)
        radius_change = abs(state.a - previous_radius) / larger_radius if larger_radius > 0 else 0.0
        slip_fraction = 1 - (state.stick_radius or 0.0) / state.a if state.a > 0 else 0.0
        dissipation_error = (
            min(radius_change / (2 * slip_fraction), 1.0)
            if state.dissipation and slip_fraction > 0
            else 0.0
        )
        if (
            state.a > 0
            and larger_radius >= largest_radius / 2
            and max(radius_change, dissipation_error) > MAX_STEP_CHANGE
        ):
            step_changes[state.step] = (
                radius_change,
                min(radius_change / (1 - radius_change), 1.0) if radius_change < 1 else 1.0,
                dissipation_error,
            )
        previous_radius = state.a
    if not step_changes:
        return []
    radius_change, stick_error, dissipation_error = (
        max(values) for values in zip(*step_changes.values(), strict=True)
    )
    first = next(iter(step_changes))
    rows = (
        f"step {first} changes"
        if len(step_changes) == 1
        else f"{len(step_changes)} rows from step {first} on change"
    )
    error_text = (
        f"stick_radius may be wrong by {_percent_text(stick_error)} there, dissipation by "
        f"{_percent_text(dissipation_error)}; the error of the force is small"
    )
    remedy = "use more loading.steps, or --error-bars to quantify the error"
    return [
        f"{rows} the contact radius by up to {100 * radius_change:.0f} %: {error_text}; {remedy}"
    ]


def _percent_text(error: float) -> str:
    """Return a relative error as text."""
    return "its own size or more" if error >= 0.5 else f"about {100 * error:.0f} %"


def _radius_of_first_contact(scene: Scene) -> float:
    """Return the contact radius at first contact [length]: 0 unless two flat faces meet."""
    physics = scene.physics
    if physics.is_compressed:
        return physics.body.lateral_extent(physics.center)
    return 0.0 if physics.domain.top_radius else flat_radius(physics.indenter)


def _smoothing_advice(scene: Scene) -> str:
    """Return advice that smooths the pressure (decisions 53 and 84)."""
    if scene.physics.yields:
        return _smoothing_advice_of_yield(scene)
    if scene.sizes.rounded_edge_width:
        return refinement_advice(scene.sizes, "a smaller mesh.h_edge helps")
    return refinement_advice(scene.sizes, "a smaller mesh.h_contact helps")


def _smoothing_advice_of_yield(scene: Scene) -> str:
    """Return advice that smooths the pressure on a body that yields (decision 84)."""
    elements = refinement_advice(scene.sizes, "a smaller mesh.h_contact helps")
    locks = any(
        region.material.plasticity
        and region.formulation == "displacement"
        and region.softest_constants.nu > 0
        for region in scene.physics.domain.regions
    )
    formulation = "`formulation: mixed` of the material that yields and " if locks else ""
    return f"{elements}, as do {formulation}shorter load increments"


def _row_force_error(scene: Scene, state: State) -> float:
    """Return the expected relative error of the force at the contact radius of the row."""
    physics = scene.physics
    a = scene.physics.full_contact_radius(state.a / scene.physics.scales.length)
    if physics.is_closed_by_swelling(state.delta / physics.scales.depth, a):
        return swelling_force_error(scene.sizes, a)
    return expected_force_error(scene.sizes, a, physics.largest_nu)
