"""Plausibility of rows: bounds on an elastic body that hold whatever the mesh and the method.

The tip only pushes, so nothing pulls, and a tip pressed into a flat body touches it. The force
grows with the depth and is the derivative of the energy Pi, so 0 <= Pi <= force delta. The surface
stays below the tip, also where contact is not looked for. The force is theory's where theory is
exact, and of one order with it where it is nearly so. None of this says how accurate a row is;
`unresolved` names the rows whose contact is smaller than elements resolve. A tip that adheres may
pull, and where it lets go or snaps in the force is no derivative: there only the rest is asked.
Where fluid flows, or shear relaxes, depth and force are of a time: rules that compare them are left
out. A rough surface gives back less than was put in: its forces are compared while the tip goes in,
never on the way back.

Each rule is a function of the scene, a converged state and the states before it (in the user's
units) to a sentence, or to None where it has nothing against the state. They are wide enough for
coarse meshes and soft penalties.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from math import inf, isfinite, isnan

import numpy as np

from indent_sim.model.contact import Nitsche, Penalty
from indent_sim.model.state import State
from indent_sim.model.tips import flat_radius
from indent_sim.scene.expected_error import (
    error_text,
    expected_force_error,
    penalty_force_loss,
    swelling_force_error,
)
from indent_sim.scene.model_warnings import UNDERRESOLVED_ERROR, refinement_advice
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import Solution

# of the largest force so far: what round-off and the supports' tolerance may leave of none
FORCE_NOISE = 1e-6
DEPTH_TOLERANCE = 1e-6  # of a depth: closer ones may have one solution to the solver's tolerance
# of the path's largest force: a row with less to expect may lie between two points of its mesh
FIRST_TOUCH_FRACTION = 1e-5
# of the force, with greater depth: convex problems solved to 1e-7; kinks of the others
MAX_LINEAR_FALL = 1e-3
MAX_FALL = 0.02
# of force delta: what the contact term of a multiplier adds to the energy on a coarse mesh
ENERGY_TOLERANCE = 0.02
MAX_OVERLAP = (
    0.1,
    0.5,
)  # of the depth, of an element: twice what a contact of one element was seen to sink in
# Of the depth. A contact group that ends beside the contact costs force: 0.02 % where the tip is
# 2e-4 inside the next facets, 0.4 % at 8e-3, 4 % at 6e-2, 20 % at 0.2, measured (axisymmetric and
# plane; both gaps). Where it does not: 0
MAX_OUTSIDE_PENETRATION = 1e-3
PENETRATION_FACTOR = (
    2.0  # of a law that lets the tip sink in: between its quadrature points it may be somewhat more
)
# Factors from theory: the same problem; a half-space at small strain instead of the body's
SAME_PROBLEM_FACTOR = 1.5
HALF_SPACE_FACTOR = 10.0
HALF_SPACE_CONTACT = (
    0.3  # of the thickness and of the way to the rim: a contact up to this feels little of them
)
PILLAR_HEIGHT = 10.0  # ways to the rim: a thicker body is a pillar, whose own shortening counts
MAX_LINEAR_DEPTH = 0.1  # of the contact radius: up to this depth no law stiffens by a factor
THEORY_FORCE_ERROR = 1e-4  # of theory's force: its own error

# A contact pressure that oscillates from node to node by more than this fraction of p_max is warned
# of. In scenes with a smooth pressure the fraction is 0.002 to 0.02, in a saw-tooth 0.09 to 0.5
# (measured in docs/decisions/0053).
MAX_ROUGHNESS = 0.03
# A stick radius or a dissipation that a long step may have wrong by more than this is warned of.
# Measured with 1, 2, 5, 10 and 40 even steps under a paraboloid (thick layer, nu 0): with friction
# 0.3 the stick radius is 0.24, 0.45, 0.50, 0.52 and 0.54 of the contact radius and all heat 2.4,
# 1.5, 1.07, 1.01 times that of 40 steps; with friction 0.6 it is 0.82, 0.82, 0.85, 0.87 and 0.90 of
# it, and 0.97, 0.60, 0.64, 0.89 times. The last step adds 1, 0.29, 0.11 and 0.05 of the contact
# radius.
MAX_STEP_CHANGE = 0.25

REFINEMENT_REMEDY = (
    "shorter steps to this depth, a smaller mesh.h_contact or another contact.method may help"
)
SIDE_REMEDY = (
    "the top alone is a contact surface: stay above that depth, or let the top slide "
    "(contact.friction: 0)"
)


RowForce = tuple[float, float, float]  # of a row: depth, force, half its bar's width


class PreviousRows:
    """Rows in the order of their path, with what a new one is compared with: it costs the same
    after few and many.
    """

    def __init__(self, states: Iterable[State] = ()):
        self.last: State | None = None
        self.has_turned = False  # back to a smaller depth
        self.max_depth = -inf
        self.largest_force = 0.0
        self._largest_force_row: RowForce | None = None  # that which surely pushes most
        self._columns: np.ndarray = np.empty((3, 64))  # depth, force and half its bar's width
        self._count = 0
        for state in states:
            self.append(state)

    def __len__(self) -> int:
        return self._count

    def append(self, state: State) -> None:
        """Add the next row."""
        if self._count == self._columns.shape[1]:
            self._columns = np.concatenate([self._columns, np.empty_like(self._columns)], axis=1)
        self._columns[:, self._count] = row_force = _row_force(state)
        least_force = row_force[1] - row_force[2]
        if least_force == least_force and (
            self._largest_force_row is None
            or least_force > self._largest_force_row[1] - self._largest_force_row[2]
        ):
            self._largest_force_row = row_force
        self._count += 1
        self.has_turned |= self.last is not None and state.delta < self.last.delta
        self.max_depth = max(self.max_depth, state.delta)
        self.largest_force = max(self.largest_force, abs(state.force))
        self.last = state

    def largest_shallower_force(self, delta: float) -> RowForce | None:
        """That which surely pushes most of the rows that are less deep; None where there is none."""
        if delta > self.max_depth:
            return self._largest_force_row
        depth, force, bar = self._columns[:, : self._count]
        return self._row_at_maximum(force - bar, depth < delta)

    def smallest_deeper_force(self, delta: float) -> RowForce | None:
        """That which surely pushes least of the rows that are deeper; None where there is none."""
        if delta >= self.max_depth:
            return None
        depth, force, bar = self._columns[:, : self._count]
        return self._row_at_maximum(-force - bar, depth > delta)

    def _row_at_maximum(self, value: np.ndarray, where: np.ndarray) -> RowForce | None:
        if not where.any():
            return None
        depth, force, bar = self._columns[:, int(np.argmax(np.where(where, value, -inf)))]
        return float(depth), float(force), float(bar)


def _row_force(state: State) -> RowForce:
    return state.delta, state.force, _error_half_width(state)


Rule = Callable[[Scene, State, PreviousRows], "str | None"]
Rules = tuple[Rule, ...]


def precompute_theory_forces(scene: Scene) -> None:
    """Have theory find the forces that rows will be held to together, where their depths are known."""
    physics = scene.physics
    if scene.plan.theory and physics.path.control == "depth":
        scale = physics.scales.depth
        scene.plan.theory.expect_depths(
            [delta * scale / scale for delta in physics.deltas]
        )  # as rows say their depths


def violated_bound(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """What cannot be true of a converged state after others on its path, None where nothing is
    known against it.

    The states are in the user's units.
    """
    is_pressed = scene.is_meshed and not _is_first_touch(scene, state)
    for rule in _applicable_rules(
        is_pressed, scene.physics.is_time_dependent, scene.physics.contact.may_snap_through
    ):
        if violation := rule(scene, state, earlier):
            is_side = rule is _check_outside_penetration and scene.physics.is_compressed
            return f"{violation}; {SIDE_REMEDY if is_side else REFINEMENT_REMEDY}"
    return None


def underresolved_rows(scene: Scene, states: Sequence[State]) -> list[str]:
    """What to say of rows (in the user's units) whose contact has too few elements; nothing where
    the scene said so beforehand.

    Where the contact grows by itself, in time or under a force, its smallest radius is known only
    now.
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
        sizes, "give mesh.h_contact and a smaller mesh.h_axis, or ask for an accuracy"
    )
    return [
        f"{rows} at most {max_elements:.2g} elements in the contact radius: {force_text}; {remedy}"
    ]


def oscillating_pressure_warnings(scene: Scene, states: Sequence[State]) -> list[str]:
    """Warn of rows whose contact pressure oscillates from node to node (a saw-tooth).

    Parameters
    ----------
    scene
        The scene of the run.
    states
        Its rows, in any units.

    Returns
    -------
    list of str
        One warning at most.
    """
    oscillating = [state for state in states if state.roughness > MAX_ROUGHNESS]
    if not oscillating:
        return []
    worst = max(oscillating, key=lambda state: state.roughness)
    size_text = f"{100 * worst.roughness:.2g} % of p_max"
    rows = f"step {worst.step}: the pressure alternates from node to node by {size_text}"
    if len(oscillating) > 1:
        rows = (
            f"{len(oscillating)} rows from step {oscillating[0].step} on: the pressure alternates from "
            "node to node"
        )
        min_roughness = min(state.roughness for state in oscillating)
        rows = f"{rows}, by {100 * min_roughness:.2g} to {size_text}, most in step {worst.step}"
    return [
        f"{rows}; p_max and `pressure` of the surface are as uncertain, the force far "
        f"less; {_smoothing_advice(scene)}"
    ]


def long_step_warnings(scene: Scene, states: Sequence[State]) -> list[str]:
    """Warn of load increments that are too long to resolve where the surface slips on the tip.

    A step that makes the contact radius grow from a_0 to a takes all that is new in contact to have
    slipped at once. Its stick radius is off by about (a - a_0)/a of itself, its dissipation by half
    of (a - a_0)/(a - stick radius), and the force hardly at all. Rows of less than half of the
    largest contact are left out: the first one is a single step from rest in every run.

    Parameters
    ----------
    scene
        The scene of the run, without error bars.
    states
        Its rows, in the user's units.

    Returns
    -------
    list of str
        One warning at most.
    """
    if not scene.physics.contact.may_slip or not scene.is_meshed:
        return []
    widest = max((state.a for state in states), default=0.0)
    previous_radius = _radius_of_first_contact(scene) * scene.physics.scales.length
    step_changes: dict[int, tuple[float, float, float]] = {}
    for state in states:
        wider = max(previous_radius, state.a)
        radius_change = abs(state.a - previous_radius) / wider if wider > 0 else 0.0
        slips = 1 - (state.stick_radius or 0.0) / state.a if state.a > 0 else 0.0
        heat = min(radius_change / (2 * slips), 1.0) if state.dissipation and slips > 0 else 0.0
        if state.a > 0 and wider >= widest / 2 and max(radius_change, heat) > MAX_STEP_CHANGE:
            step_changes[state.step] = (
                radius_change,
                min(radius_change / (1 - radius_change), 1.0) if radius_change < 1 else 1.0,
                heat,
            )
        previous_radius = state.a
    if not step_changes:
        return []
    radius_change, stick, heat = (max(sizes) for sizes in zip(*step_changes.values(), strict=True))
    first = next(iter(step_changes))
    rows = (
        f"step {first} changes"
        if len(step_changes) == 1
        else f"{len(step_changes)} rows from step {first} on change"
    )
    error_text = (
        f"stick_radius may be wrong by {_percent_text(stick)} there, dissipation by "
        f"{_percent_text(heat)}, the force hardly"
    )
    remedy = "use more loading.steps, or --error-bars, which say how much"
    return [
        f"{rows} the contact radius by up to {100 * radius_change:.0f} %: {error_text}; {remedy}"
    ]


def _percent_text(error: float) -> str:
    """A relative error in words."""
    return "its own size or more" if error >= 0.5 else f"about {100 * error:.0f} %"


def _radius_of_first_contact(scene: Scene) -> float:
    """The contact radius [length] of a tip that just touches: that of its flat face on a flat body,
    otherwise 0.
    """
    physics = scene.physics
    if physics.is_compressed:
        return physics.body.lateral_extent(physics.center)
    return 0.0 if physics.domain.top_radius else flat_radius(physics.indenter)


def _smoothing_advice(scene: Scene) -> str:
    """Name the element size whose reduction makes the contact pressure smoother (measured in
    docs/decisions/0053).
    """
    if scene.sizes.rounded_edge_width:
        return refinement_advice(scene.sizes, "a smaller mesh.h_edge helps")
    return refinement_advice(scene.sizes, "a smaller mesh.h_contact helps")


def _row_force_error(scene: Scene, state: State) -> float:
    """The relative error of the force to fear with the contact radius that was found."""
    physics = scene.physics
    a = scene.physics.full_contact_radius(state.a / scene.physics.scales.length)
    if physics.is_closed_by_swelling(state.delta / physics.scales.depth, a):
        return swelling_force_error(scene.sizes, a)
    return expected_force_error(scene.sizes, a, physics.largest_nu)


@cache
def _applicable_rules(is_pressed: bool, evolves: bool, snaps: bool) -> Rules:
    """Those that hold for a row that is more than a first touch, where fluid flows, where a tip may
    snap.
    """
    unknown = {*(REPULSIVE_RULES if snaps else ()), *(ELASTIC_RULES if evolves else ())}
    return tuple(
        rule
        for rule in (GENERAL_RULES + CONTACT_RULES if is_pressed else GENERAL_RULES)
        if rule not in unknown
    )


def _check_finite(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Depth, force, contact radius and energy are finite; p_max is infinite in truth under a sharp
    tip.
    """
    names = (
        "delta",
        "force",
        "a",
        *(("energy",) if scene.is_meshed and not scene.physics.relaxing_regions else ()),
    )
    infinite_names = [name for name in names if not isfinite(getattr(state, name))]
    return f"{', '.join(infinite_names)} is not a number" if infinite_names else None


def _check_no_tension(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """force >= 0."""
    if state.force >= 0 or state.force >= -_force_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and nothing holds on to the tip"


def _check_no_force_above(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """No force above the body."""
    if state.delta >= 0 or state.force <= _force_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and the tip is above the body"


def _check_contact_found(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """force > 0 and a > 0 where delta > 0: the body was flat, and the tip stands over it."""
    if (state.force > 0 or scene.physics.contact.may_snap_through) and state.a > 0:
        return None
    missing_text = "no force" if state.force <= 0 else "no contact radius"
    mesh = f"the mesh (h_contact = {scene.sizes.h_contact * scene.physics.scales.length:.3g})"
    cause = "it went through, or the contact lies between two points of"
    return f"the tip is {state.delta:.6g} deep in the body and finds {missing_text}: {cause} {mesh}"


def _check_contact_radius(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """a up to the radius at which the tip ends, and an element to either side."""
    end = scene.physics.indenter.radius_at(scene.physics.body.height)
    L = scene.physics.scales.length
    if state.a <= (end + 2 * scene.sizes.h_contact) * L:
        return None
    return f"the contact radius {state.a:.6g} is beyond the tip, which ends at {end * L:.6g}"


def _check_side_contact(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """delta <= f at the top of a fixed side, which no force moves."""
    end = scene.physics.side_contact_depth * scene.physics.scales.depth
    if state.delta <= end * (1 + DEPTH_TOLERANCE):
        return None
    return (
        f"the tip is on the top of a fixed side from {end:.6g} on, and the force there has no bound"
    )


def _check_new_solution(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """A new depth is another solution: of no iteration, only where the one foretold was right and
    the force another.
    """
    previous = earlier.last
    is_new = previous is None or abs(state.delta - previous.delta) > DEPTH_TOLERANCE * abs(
        state.delta
    )
    moved = (
        abs(state.force - previous.force)
        if previous and (previous.force > 0 or scene.physics.contact.may_snap_through)
        else 0.0
    )
    is_other = moved > FORCE_NOISE * DEPTH_TOLERANCE * abs(state.force)
    if state.newton_iterations > 0 or not is_new or is_other:
        return None
    return "nothing was solved for this depth, and the force is that of another"


def _check_overlap(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """No facet of the deformed surface lies inside the tip, but for what a coarse mesh or a penalty
    lets it sink in.
    """
    allowed = max(
        MAX_OVERLAP[0] * state.delta,
        MAX_OVERLAP[1] * scene.sizes.h_contact * scene.physics.scales.length,
    )
    if state.overlap <= allowed + _allowed_penetration(scene, state):
        return None
    return f"a facet of the surface lies {state.overlap:.3g} inside the tip, which went through it"


def _check_outside_penetration(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """No part of the surface that contact is not looked for on lies inside the tip."""
    if state.intrusion <= MAX_OUTSIDE_PENETRATION * state.delta + _allowed_penetration(
        scene, state
    ):
        return None
    cause = (
        "a side of the body has come to the tip, or the contact group of a mesh file ends too early"
    )
    if scene.physics.is_compressed:
        previous_depth = (
            earlier.last.delta if earlier.last and earlier.last.delta < state.delta else 0.0
        )
        cause = (
            f"a side of the body folds up against it from a depth between {previous_depth:.6g} and "
            f"{state.delta:.6g} on"
        )
    where = "inside the surface beside the contact surface, where nothing keeps it out"
    return f"the tip is {state.intrusion:.3g} {where}: {cause}"


def _check_energy(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """0 <= Pi <= force delta, as of any force that grows with the depth."""
    work = state.force * state.delta
    is_its_work = -ENERGY_TOLERANCE * work <= state.energy <= (1 + ENERGY_TOLERANCE) * work
    if is_its_work or _may_be_unstable(scene):
        return None
    if scene.physics.has_friction and earlier.max_depth > state.delta:
        return None
    return (
        f"the energy is {state.energy:.6g}, and a force that grew to {state.force:.6g} "
        f"did {work:.6g} at most"
    )


def _check_force_growth(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """force <= force at a greater depth, within the error bars of both where there are any."""
    last = earlier.last
    if scene.physics.has_friction and last and (earlier.has_turned or state.delta < last.delta):
        return None  # friction gives less back
    fall = (
        MAX_LINEAR_FALL
        if scene.physics.small_strain and scene.physics.gap == "reference"
        else MAX_FALL
    )
    row_force = _row_force(state)
    for shallow, deep in (
        (earlier.largest_shallower_force(state.delta), row_force),
        (row_force, earlier.smallest_deeper_force(state.delta)),
    ):
        if shallow is None or deep is None:
            continue
        force_drop = shallow[1] - deep[1] - shallow[2] - deep[2] - fall * abs(shallow[1])
        if (
            force_drop > 0
            and force_drop > _force_noise(scene, state, earlier)
            and not _may_be_unstable(scene)
        ):
            forces = (
                f"{shallow[1]:.6g} at delta = {shallow[0]:.6g} and {deep[1]:.6g} at {deep[0]:.6g}"
            )
            return f"the force is {forces}, where it must be larger"
    return None


def _check_against_theory(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """The force is theory's within the error bar where theory is exact, and within a factor where
    it is nearly so.
    """
    theory = scene.plan.theory
    scales = scene.physics.scales
    solution = theory.solution_at_depth(state.delta / scales.depth) if theory else None
    if theory is None or solution is None or solution.force <= 0:
        return None
    expected = solution.force / scene.physics.mirror_multiplicity * scales.force
    lowest, highest = _force_ratio_range(scene, solution)
    message = f"the force is {state.force:.6g}, and {theory.name}"
    if not lowest * expected <= state.force <= highest * expected:
        return f"{message} expects {expected:.6g}"
    if not scene.exact_theory or state.force_error is None or isnan(state.force_error):
        return None
    if abs(state.force - expected) <= state.force_error + THEORY_FORCE_ERROR * expected:
        return None
    return (
        f"{message}, exact for this body, {expected:.6g}: the error bar "
        f"{state.force_error:.3g} does not hold it"
    )


GENERAL_RULES: Rules = (
    _check_finite,
    _check_overlap,
    _check_no_tension,
    _check_no_force_above,
    _check_contact_radius,
    _check_force_growth,
    _check_side_contact,
)
CONTACT_RULES: Rules = (
    _check_contact_found,
    _check_outside_penetration,
    _check_new_solution,
    _check_energy,
    _check_against_theory,
)
REPULSIVE_RULES: Rules = (
    _check_no_tension,
    _check_force_growth,
    _check_energy,
    _check_against_theory,
)
# What takes time lets a force fall in a hold, and what was pressed in may not have come back yet,
# or swells
ELASTIC_RULES: Rules = (
    _check_no_force_above,
    _check_force_growth,
    _check_contact_found,
    _check_energy,
    _check_against_theory,
)


def _is_first_touch(scene: Scene, state: State) -> bool:
    """Whether E* radius_at(depth) depth, of the order of the force, is next to none beside that of
    the whole path.
    """
    depth = state.delta / scene.physics.scales.depth
    deepest = scene.physics.max_depth
    if depth <= 0 or deepest <= depth:
        return depth <= 0
    if scene.physics.is_compressed:
        return depth <= FIRST_TOUCH_FRACTION * deepest
    radius_at = relative_tip(scene.physics.indenter, scene.physics.body).radius_at
    return depth * radius_at(depth) <= FIRST_TOUCH_FRACTION * deepest * radius_at(deepest)


def _force_noise(scene: Scene, state: State, earlier: PreviousRows) -> float:
    """A force that is none [force]: beside those so far, or beside one that presses an element in
    as deep.
    """
    scales = scene.physics.scales
    h = scene.sizes.h_contact
    pressed = (
        scene.physics.material.E_star
        * h ** (scales.dim - 2)
        * abs(state.delta)
        / scales.depth
        * scales.force
    )
    return FORCE_NOISE * max(pressed, earlier.largest_force)


def _allowed_penetration(scene: Scene, state: State) -> float:
    """How far the contact law lets the tip sink in [length]."""
    return (
        PENETRATION_FACTOR * state.penetration
        if isinstance(scene.physics.contact, Penalty | Nitsche)
        else 0.0
    )


def _error_half_width(state: State) -> float:
    return state.force_error if state.force_error and isfinite(state.force_error) else 0.0


def _may_be_unstable(scene: Scene) -> bool:
    """Whether the law is no longer stable at the strains to expect: then a force may fall."""
    return any(doubt.key == "stability" for doubt in scene.plan.model_warnings)


def _force_ratio_range(scene: Scene, theory: Solution) -> tuple[float, float]:
    """Least and largest force over theory's that may be true, mesh and penalty included."""
    mesh_factor = 1 + expected_force_error(scene.sizes, theory.a, scene.physics.largest_nu)
    force_fraction = 1 - penalty_force_loss(
        scene.physics.contact, scene.physics.material, scene.plan.theory, theory.delta, theory.a
    )
    if scene.exact_theory:
        return force_fraction / (
            SAME_PROBLEM_FACTOR * mesh_factor
        ), SAME_PROBLEM_FACTOR * mesh_factor
    height = scene.physics.body.height
    rim = scene.physics.body.lateral_extent(scene.physics.center)
    is_half_space_like = (
        theory.a <= HALF_SPACE_CONTACT * min(height, rim) and height <= PILLAR_HEIGHT * rim
    )
    if (
        scene.physics.body.inclusions or scene.physics.domain.coatings or not is_half_space_like
    ):  # skins bend as shells
        return 0.0, float("inf")
    may_stiffen = not scene.physics.small_strain and theory.delta > MAX_LINEAR_DEPTH * theory.a
    return force_fraction / (HALF_SPACE_FACTOR * mesh_factor), float(
        "inf"
    ) if may_stiffen else HALF_SPACE_FACTOR * mesh_factor
