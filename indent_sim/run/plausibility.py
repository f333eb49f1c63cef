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
from indent_sim.scene.model_warnings import (
    UNDERRESOLVED_ERROR,
    error_text,
    expected_force_error,
    penalty_force_loss,
    refinement_advice,
    swelling_force_error,
)
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import Solution

# of the largest force so far: what round-off and the supports' tolerance may leave of none
FORCE_NOISE = 1e-6
SAME = 1e-6  # of a depth: closer ones may have one solution to the solver's tolerance
# of the path's largest force: a row with less to expect may lie between two points of its mesh
FIRST_TOUCH = 1e-5
# of the force, with greater depth: convex problems solved to 1e-7; kinks of the others
LINEAR_FALL = 1e-3
FALL = 0.02
# of force delta: what the contact term of a multiplier adds to the energy on a coarse mesh
WORK_SLACK = 0.02
SUNK = (
    0.1,
    0.5,
)  # of the depth, of an element: twice what a contact of one element was seen to sink in
# Of the depth. A contact group that ends beside the contact costs force: 0.02 % where the tip is
# 2e-4 inside the next facets, 0.4 % at 8e-3, 4 % at 6e-2, 20 % at 0.2, measured (axisymmetric and
# plane; both gaps). Where it does not: 0
INTRUDED = 1e-3
PENETRATIONS = (
    2.0  # of a law that lets the tip sink in: between its quadrature points it may be somewhat more
)
# Factors from theory: the same problem; a half-space at small strain instead of the body's
SAME_PROBLEM_FACTOR = 1.5
HALF_SPACE_FACTOR = 10.0
HALF_SPACE_CONTACT = (
    0.3  # of the thickness and of the way to the rim: a contact up to this feels little of them
)
PILLAR_HEIGHT = 10.0  # ways to the rim: a thicker body is a pillar, whose own shortening counts
SHALLOW = 0.1  # of the contact radius: up to this depth no law stiffens by a factor
THEORY_FORCE_ERROR = 1e-4  # of theory's force: its own error

# A contact pressure that oscillates from node to node by more than this fraction of p_max is warned
# of. In scenes with a smooth pressure the fraction is 0.002 to 0.02, in a saw-tooth 0.09 to 0.5
# (measured in docs/decisions/0053).
ROUGH = 0.03
# A stick radius or a dissipation that a long step may have wrong by more than this is warned of.
# Measured with 1, 2, 5, 10 and 40 even steps under a paraboloid (thick layer, nu 0): with friction
# 0.3 the stick radius is 0.24, 0.45, 0.50, 0.52 and 0.54 of the contact radius and all heat 2.4,
# 1.5, 1.07, 1.01 times that of 40 steps; with friction 0.6 it is 0.82, 0.82, 0.85, 0.87 and 0.90 of
# it, and 0.97, 0.60, 0.64, 0.89 times. The last step adds 1, 0.29, 0.11 and 0.05 of the contact
# radius.
LONG_STEP = 0.25

MAY_HELP = (
    "shorter steps to this depth, a smaller mesh.h_contact or another contact.method may help"
)
STAY_ABOVE = (
    "the top alone is a contact surface: stay above that depth, or let the top slide "
    "(contact.friction: 0)"
)


Compared = tuple[float, float, float]  # of a row: depth, force, half its bar's width


class Rows:
    """Rows in the order of their path, with what a new one is compared with: it costs the same
    after few and many.
    """

    def __init__(self, states: Iterable[State] = ()):
        self.last: State | None = None
        self.has_turned = False  # back to a smaller depth
        self.deepest = -inf
        self.largest_force = 0.0
        self._strongest: Compared | None = None  # that which surely pushes most
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
        self._columns[:, self._count] = own = _compared(state)
        pushes = own[1] - own[2]
        if pushes == pushes and (
            self._strongest is None or pushes > self._strongest[1] - self._strongest[2]
        ):
            self._strongest = own
        self._count += 1
        self.has_turned |= self.last is not None and state.delta < self.last.delta
        self.deepest = max(self.deepest, state.delta)
        self.largest_force = max(self.largest_force, abs(state.force))
        self.last = state

    def strongest_above(self, delta: float) -> Compared | None:
        """That which surely pushes most of the rows that are less deep; None where there is none."""
        if delta > self.deepest:
            return self._strongest
        depth, force, bar = self._columns[:, : self._count]
        return self._of_most(force - bar, depth < delta)

    def weakest_below(self, delta: float) -> Compared | None:
        """That which surely pushes least of the rows that are deeper; None where there is none."""
        if delta >= self.deepest:
            return None
        depth, force, bar = self._columns[:, : self._count]
        return self._of_most(-force - bar, depth > delta)

    def _of_most(self, value: np.ndarray, where: np.ndarray) -> Compared | None:
        if not where.any():
            return None
        depth, force, bar = self._columns[:, int(np.argmax(np.where(where, value, -inf)))]
        return float(depth), float(force), float(bar)


def _compared(state: State) -> Compared:
    return state.delta, state.force, _bar(state)


Rule = Callable[[Scene, State, Rows], "str | None"]
Rules = tuple[Rule, ...]


def foresee(scene: Scene) -> None:
    """Have theory find the forces that rows will be held to together, where their depths are known."""
    physics = scene.physics
    if scene.plan.theory and physics.path.control == "depth":
        scale = physics.scales.depth
        scene.plan.theory.expect(
            [delta * scale / scale for delta in physics.deltas]
        )  # as rows say their depths


def contradiction(scene: Scene, state: State, earlier: Rows) -> str | None:
    """What cannot be true of a converged state after others on its path, None where nothing is
    known against it.

    The states are in the user's units.
    """
    is_pressed = scene.is_meshed and not _is_first_touch(scene, state)
    for rule in _rules(is_pressed, scene.physics.is_time_dependent, scene.physics.contact.may_snap):
        if said := rule(scene, state, earlier):
            is_side = rule is _is_inside_the_skin and scene.physics.is_compressed
            return f"{said}; {STAY_ABOVE if is_side else MAY_HELP}"
    return None


def unresolved(scene: Scene, states: Sequence[State]) -> list[str]:
    """What to say of rows (in the user's units) whose contact has too few elements; nothing where
    the scene said so beforehand.

    Where the contact grows by itself, in time or under a force, its smallest radius is known only
    now.
    """
    foreseen = any(doubt.key == "elements" for doubt in scene.plan.model_warnings)
    if foreseen or not scene.is_meshed or scene.history_on_curve or scene.physics.contact.may_snap:
        return []
    L = scene.physics.scales.length
    sizes = scene.sizes
    least = FORCE_NOISE * max((state.force for state in states), default=0.0)
    doubts = {
        state.step: _doubt_of_force(scene, state)
        for state in states
        if state.force > least and state.a > 0
    }
    few = [step for step, doubt in doubts.items() if doubt >= UNDERRESOLVED_ERROR]
    if not few:
        return []
    most = max(
        sizes.elements(scene.physics.full_contact_radius(state.a / L))
        for state in states
        if state.step in few
    )
    rows = f"step {few[0]} has" if len(few) == 1 else f"{len(few)} rows from step {few[0]} on have"
    likely = sorted(doubts[step] for step in few)
    span = " to ".join(dict.fromkeys(error_text(likely[k]) for k in (0, -1)))
    wrong = f"the force there may be wrong by {span}, pressures by more"
    remedy = refinement_advice(
        sizes, "give mesh.h_contact and a smaller mesh.h_axis, or ask for an accuracy"
    )
    return [f"{rows} at most {most:.2g} elements in the contact radius: {wrong}; {remedy}"]


def rough(scene: Scene, states: Sequence[State]) -> list[str]:
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
    found = [state for state in states if state.roughness > ROUGH]
    if not found:
        return []
    worst = max(found, key=lambda state: state.roughness)
    size = f"{100 * worst.roughness:.2g} % of p_max"
    rows = f"step {worst.step}: the pressure alternates from node to node by {size}"
    if len(found) > 1:
        rows = (
            f"{len(found)} rows from step {found[0].step} on: the pressure alternates from "
            "node to node"
        )
        least = min(state.roughness for state in found)
        rows = f"{rows}, by {100 * least:.2g} to {size}, most in step {worst.step}"
    return [
        f"{rows}; p_max and `pressure` of the surface are as uncertain, the force far "
        f"less; {_smoother(scene)}"
    ]


def long_steps(scene: Scene, states: Sequence[State]) -> list[str]:
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
    if not scene.physics.contact.slips or not scene.is_meshed:
        return []
    widest = max((state.a for state in states), default=0.0)
    before = _radius_of_first_contact(scene) * scene.physics.scales.length
    found: dict[int, tuple[float, float, float]] = {}
    for state in states:
        wider = max(before, state.a)
        moved = abs(state.a - before) / wider if wider > 0 else 0.0
        slips = 1 - (state.stick_radius or 0.0) / state.a if state.a > 0 else 0.0
        heat = min(moved / (2 * slips), 1.0) if state.dissipation and slips > 0 else 0.0
        if state.a > 0 and wider >= widest / 2 and max(moved, heat) > LONG_STEP:
            found[state.step] = moved, min(moved / (1 - moved), 1.0) if moved < 1 else 1.0, heat
        before = state.a
    if not found:
        return []
    moved, stick, heat = (max(sizes) for sizes in zip(*found.values(), strict=True))
    first = next(iter(found))
    rows = (
        f"step {first} changes"
        if len(found) == 1
        else f"{len(found)} rows from step {first} on change"
    )
    wrong = (
        f"stick_radius may be wrong by {_about(stick)} there, dissipation by "
        f"{_about(heat)}, the force hardly"
    )
    remedy = "use more loading.steps, or --error-bars, which say how much"
    return [f"{rows} the contact radius by up to {100 * moved:.0f} %: {wrong}; {remedy}"]


def _about(error: float) -> str:
    """A relative error in words."""
    return "its own size or more" if error >= 0.5 else f"about {100 * error:.0f} %"


def _radius_of_first_contact(scene: Scene) -> float:
    """The contact radius [length] of a tip that just touches: that of its flat face on a flat body,
    otherwise 0.
    """
    physics = scene.physics
    if physics.is_compressed:
        return physics.body.rim_distance(physics.center)
    return 0.0 if physics.domain.dome else flat_radius(physics.indenter)


def _smoother(scene: Scene) -> str:
    """Name the element size whose reduction makes the contact pressure smoother (measured in
    docs/decisions/0053).
    """
    if scene.sizes.rubbed:
        return refinement_advice(scene.sizes, "a smaller mesh.h_edge helps")
    return refinement_advice(scene.sizes, "a smaller mesh.h_contact helps")


def _doubt_of_force(scene: Scene, state: State) -> float:
    """The relative error of the force to fear with the contact radius that was found."""
    physics = scene.physics
    a = scene.physics.full_contact_radius(state.a / scene.physics.scales.length)
    if physics.is_closed_by_swelling(state.delta / physics.scales.depth, a):
        return swelling_force_error(scene.sizes, a)
    return expected_force_error(scene.sizes, a, physics.largest_nu)


@cache
def _rules(is_pressed: bool, evolves: bool, snaps: bool) -> Rules:
    """Those that hold for a row that is more than a first touch, where fluid flows, where a tip may
    snap.
    """
    unknown = {*(OF_TIPS_THAT_PUSH if snaps else ()), *(OF_ELASTIC_BODIES if evolves else ())}
    return tuple(
        rule for rule in (ALWAYS + WHEN_PRESSED if is_pressed else ALWAYS) if rule not in unknown
    )


def _is_no_number(scene: Scene, state: State, earlier: Rows) -> str | None:
    """Depth, force, contact radius and energy are finite; p_max is infinite in truth under a sharp
    tip.
    """
    names = (
        "delta",
        "force",
        "a",
        *(("energy",) if scene.is_meshed and not scene.physics.relaxing_regions else ()),
    )
    wrong = [name for name in names if not isfinite(getattr(state, name))]
    return f"{', '.join(wrong)} is not a number" if wrong else None


def _pulls(scene: Scene, state: State, earlier: Rows) -> str | None:
    """force >= 0."""
    if state.force >= 0 or state.force >= -_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and nothing holds on to the tip"


def _pushes_from_afar(scene: Scene, state: State, earlier: Rows) -> str | None:
    """No force above the body."""
    if state.delta >= 0 or state.force <= _noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and the tip is above the body"


def _touches_nothing(scene: Scene, state: State, earlier: Rows) -> str | None:
    """force > 0 and a > 0 where delta > 0: the body was flat, and the tip stands over it."""
    if (state.force > 0 or scene.physics.contact.may_snap) and state.a > 0:
        return None
    missed = "no force" if state.force <= 0 else "no contact radius"
    mesh = f"the mesh (h_contact = {scene.sizes.h_contact * scene.physics.scales.length:.3g})"
    words = "it went through, or the contact lies between two points of"
    return f"the tip is {state.delta:.6g} deep in the body and finds {missed}: {words} {mesh}"


def _is_wider_than_tip(scene: Scene, state: State, earlier: Rows) -> str | None:
    """a up to the radius at which the tip ends, and an element to either side."""
    end = scene.physics.indenter.radius_at(scene.physics.body.height)
    L = scene.physics.scales.length
    if state.a <= (end + 2 * scene.sizes.h_contact) * L:
        return None
    return f"the contact radius {state.a:.6g} is beyond the tip, which ends at {end * L:.6g}"


def _stands_on_a_side(scene: Scene, state: State, earlier: Rows) -> str | None:
    """delta <= f at the top of a fixed side, which no force moves."""
    end = scene.physics.side_contact_depth * scene.physics.scales.depth
    if state.delta <= end * (1 + SAME):
        return None
    return (
        f"the tip is on the top of a fixed side from {end:.6g} on, and the force there has no bound"
    )


def _stands_still(scene: Scene, state: State, earlier: Rows) -> str | None:
    """A new depth is another solution: of no iteration, only where the one foretold was right and
    the force another.
    """
    before = earlier.last
    is_new = before is None or abs(state.delta - before.delta) > SAME * abs(state.delta)
    moved = (
        abs(state.force - before.force)
        if before and (before.force > 0 or scene.physics.contact.may_snap)
        else 0.0
    )
    is_other = moved > FORCE_NOISE * SAME * abs(state.force)
    if state.newton_iterations > 0 or not is_new or is_other:
        return None
    return "nothing was solved for this depth, and the force is that of another"


def _overlaps(scene: Scene, state: State, earlier: Rows) -> str | None:
    """No facet of the deformed surface lies inside the tip, but for what a coarse mesh or a penalty
    lets it sink in.
    """
    allowed = max(
        SUNK[0] * state.delta, SUNK[1] * scene.sizes.h_contact * scene.physics.scales.length
    )
    if state.overlap <= allowed + _sunk(scene, state):
        return None
    return f"a facet of the surface lies {state.overlap:.3g} inside the tip, which went through it"


def _is_inside_the_skin(scene: Scene, state: State, earlier: Rows) -> str | None:
    """No part of the surface that contact is not looked for on lies inside the tip."""
    if state.intrusion <= INTRUDED * state.delta + _sunk(scene, state):
        return None
    why = (
        "a side of the body has come to the tip, or the contact group of a mesh file ends too early"
    )
    if scene.physics.is_compressed:
        since = earlier.last.delta if earlier.last and earlier.last.delta < state.delta else 0.0
        why = (
            f"a side of the body folds up against it from a depth between {since:.6g} and "
            f"{state.delta:.6g} on"
        )
    where = "inside the surface beside the contact surface, where nothing keeps it out"
    return f"the tip is {state.intrusion:.3g} {where}: {why}"


def _energy_is_not_its_work(scene: Scene, state: State, earlier: Rows) -> str | None:
    """0 <= Pi <= force delta, as of any force that grows with the depth."""
    work = state.force * state.delta
    is_its_work = -WORK_SLACK * work <= state.energy <= (1 + WORK_SLACK) * work
    if is_its_work or _may_soften(scene):
        return None
    if scene.physics.has_friction and earlier.deepest > state.delta:
        return None
    return (
        f"the energy is {state.energy:.6g}, and a force that grew to {state.force:.6g} "
        f"did {work:.6g} at most"
    )


def _falls(scene: Scene, state: State, earlier: Rows) -> str | None:
    """force <= force at a greater depth, within the error bars of both where there are any."""
    last = earlier.last
    if scene.physics.has_friction and last and (earlier.has_turned or state.delta < last.delta):
        return None  # friction gives less back
    fall = LINEAR_FALL if scene.physics.small_strain and scene.physics.gap == "reference" else FALL
    own = _compared(state)
    for shallow, deep in (
        (earlier.strongest_above(state.delta), own),
        (own, earlier.weakest_below(state.delta)),
    ):
        if shallow is None or deep is None:
            continue
        lost = shallow[1] - deep[1] - shallow[2] - deep[2] - fall * abs(shallow[1])
        if lost > 0 and lost > _noise(scene, state, earlier) and not _may_soften(scene):
            forces = (
                f"{shallow[1]:.6g} at delta = {shallow[0]:.6g} and {deep[1]:.6g} at {deep[0]:.6g}"
            )
            return f"the force is {forces}, where it must be larger"
    return None


def _is_not_theorys(scene: Scene, state: State, earlier: Rows) -> str | None:
    """The force is theory's within the error bar where theory is exact, and within a factor where
    it is nearly so.
    """
    theory = scene.plan.theory
    scales = scene.physics.scales
    solution = theory.at(state.delta / scales.depth) if theory else None
    if theory is None or solution is None or solution.force <= 0:
        return None
    expected = solution.force / scene.physics.mirror_multiplicity * scales.force
    lowest, highest = _range(scene, solution)
    said = f"the force is {state.force:.6g}, and {theory.name}"
    if not lowest * expected <= state.force <= highest * expected:
        return f"{said} expects {expected:.6g}"
    if not scene.exact_theory or state.force_error is None or isnan(state.force_error):
        return None
    if abs(state.force - expected) <= state.force_error + THEORY_FORCE_ERROR * expected:
        return None
    return (
        f"{said}, exact for this body, {expected:.6g}: the error bar "
        f"{state.force_error:.3g} does not hold it"
    )


ALWAYS: Rules = (
    _is_no_number,
    _overlaps,
    _pulls,
    _pushes_from_afar,
    _is_wider_than_tip,
    _falls,
    _stands_on_a_side,
)
WHEN_PRESSED: Rules = (
    _touches_nothing,
    _is_inside_the_skin,
    _stands_still,
    _energy_is_not_its_work,
    _is_not_theorys,
)
OF_TIPS_THAT_PUSH: Rules = (_pulls, _falls, _energy_is_not_its_work, _is_not_theorys)
# What takes time lets a force fall in a hold, and what was pressed in may not have come back yet,
# or swells
OF_ELASTIC_BODIES: Rules = (
    _pushes_from_afar,
    _falls,
    _touches_nothing,
    _energy_is_not_its_work,
    _is_not_theorys,
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
        return depth <= FIRST_TOUCH * deepest
    radius_at = relative_tip(scene.physics.indenter, scene.physics.body).radius_at
    return depth * radius_at(depth) <= FIRST_TOUCH * deepest * radius_at(deepest)


def _noise(scene: Scene, state: State, earlier: Rows) -> float:
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


def _sunk(scene: Scene, state: State) -> float:
    """How far the contact law lets the tip sink in [length]."""
    return (
        PENETRATIONS * state.penetration
        if isinstance(scene.physics.contact, Penalty | Nitsche)
        else 0.0
    )


def _bar(state: State) -> float:
    return state.force_error if state.force_error and isfinite(state.force_error) else 0.0


def _may_soften(scene: Scene) -> bool:
    """Whether the law is no longer stable at the strains to expect: then a force may fall."""
    return any(doubt.key == "stability" for doubt in scene.plan.model_warnings)


def _range(scene: Scene, theory: Solution) -> tuple[float, float]:
    """Least and largest force over theory's that may be true, mesh and penalty included."""
    coarse = 1 + expected_force_error(scene.sizes, theory.a, scene.physics.largest_nu)
    left = 1 - penalty_force_loss(
        scene.physics.contact, scene.physics.material, scene.plan.theory, theory.delta, theory.a
    )
    if scene.exact_theory:
        return left / (SAME_PROBLEM_FACTOR * coarse), SAME_PROBLEM_FACTOR * coarse
    height = scene.physics.body.height
    rim = scene.physics.body.rim_distance(scene.physics.center)
    feels_a_half_space = (
        theory.a <= HALF_SPACE_CONTACT * min(height, rim) and height <= PILLAR_HEIGHT * rim
    )
    if (
        scene.physics.body.inclusions or scene.physics.domain.skins or not feels_a_half_space
    ):  # skins bend as shells
        return 0.0, float("inf")
    may_stiffen = not scene.physics.small_strain and theory.delta > SHALLOW * theory.a
    return left / (HALF_SPACE_FACTOR * coarse), float(
        "inf"
    ) if may_stiffen else HALF_SPACE_FACTOR * coarse
