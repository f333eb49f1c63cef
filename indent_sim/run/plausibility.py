"""Plausibility of rows: bounds on an elastic body that hold whatever the mesh and the method.

The tip only pushes, so nothing pulls, and a tip pressed into a flat body touches it. The force grows with the depth
and is the derivative of the energy Pi, so 0 <= Pi <= force delta. The surface stays below the tip, also where contact
is not looked for. The force is theory's where theory is exact, and of one order with it where it is nearly so. None of
this says how accurate a row is.
A tip that adheres may pull, and where it lets go or snaps in the force is no derivative: there only the rest is asked.
Where fluid flows, or shear relaxes, depth and force are of a time: rules that compare them are left out.
A rough surface gives back less than was put in: its forces are compared while the tip goes in, never on the way back.

Each rule is a function of the scene, a converged state and the states before it (in the user's units) to a sentence, or
to None where it has nothing against the state. They are wide enough for coarse meshes and soft penalties.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import isfinite, isnan

from indent_sim.model.contact import Nitsche, Penalty
from indent_sim.model.state import State
from indent_sim.scene.doubts import force_doubt, penalty_loss
from indent_sim.scene.given import end_of_sides
from indent_sim.scene.scene import Scene
from indent_sim.scene.theories import relative_tip
from indent_sim.theory.solution import Solution

FORCE_NOISE = 1e-6  # of the largest force so far: what round-off and the supports' tolerance may leave of none
SAME = 1e-6  # of a depth: closer ones may have one solution to the solver's tolerance
FIRST_TOUCH = 1e-5  # of the path's largest force: a row with less to expect may lie between two points of its mesh
LINEAR_FALL, FALL = 1e-3, 0.02  # of the force, with greater depth: convex problems solved to 1e-7; kinks of the others
WORK_SLACK = 0.02  # of force delta: what the contact term of a multiplier adds to the energy on a coarse mesh
SUNK = 0.1, 0.5  # of the depth, of an element: twice what a contact of one element was seen to sink in
# Of the depth. A contact group that ends beside the contact costs force: 0.02 % where the tip is 2e-4 inside the next
# facets, 0.4 % at 8e-3, 4 % at 6e-2, 20 % at 0.2, measured (axisymmetric and plane; both gaps). Where it does not: 0
INTRUDED = 1e-3
PENETRATIONS = 2.0  # of a law that lets the tip sink in: between its quadrature points it may be somewhat more
# Factors from theory: the same problem; a half-space at small strain instead of the body's
SAME_PROBLEM_FACTOR, HALF_SPACE_FACTOR = 1.5, 10.0
HALF_SPACE_CONTACT = 0.3  # of the thickness and of the way to the rim: a contact up to this feels little of them
PILLAR_HEIGHT = 10.0  # ways to the rim: a thicker body is a pillar, whose own shortening counts
SHALLOW = 0.1  # of the contact radius: up to this depth no law stiffens by a factor
THEORY_FORCE_ERROR = 1e-4  # of theory's force: its own error

Rule = Callable[[Scene, State, Sequence[State]], "str | None"]
Rules = tuple[Rule, ...]


def contradiction(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """What cannot be true of a converged state after others on its path, None where nothing is known against it.

    The states are in the user's units.
    """
    rules = ALWAYS if _is_first_touch(scene, state) or not scene.is_meshed else ALWAYS + WHEN_PRESSED
    evolves, snaps = scene.physics.evolves, scene.physics.contact.may_snap
    unknown = {*(OF_TIPS_THAT_PUSH if snaps else ()), *(OF_ELASTIC_BODIES if evolves else ())}
    hold = [rule for rule in rules if rule not in unknown]
    return next((said for rule in hold if (said := rule(scene, state, earlier))), None)


def _is_no_number(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """Depth, force, contact radius and energy are finite; p_max is infinite in truth under a sharp tip."""
    names = ("delta", "force", "a", *(("energy",) if scene.is_meshed and not scene.physics.relaxing else ()))
    wrong = [name for name in names if not isfinite(getattr(state, name))]
    return f"{', '.join(wrong)} is not a number" if wrong else None


def _pulls(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """force >= 0."""
    if state.force >= 0 or state.force >= -_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and nothing holds on to the tip"


def _pushes_from_afar(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """No force above the body."""
    if state.delta >= 0 or state.force <= _noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, and the tip is above the body"


def _touches_nothing(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """force > 0 and a > 0 where delta > 0: the body was flat, and the tip stands over it."""
    if (state.force > 0 or scene.physics.contact.may_snap) and state.a > 0:
        return None
    missed = "no force" if state.force <= 0 else "no contact radius"
    mesh = f"the mesh (h_contact = {scene.sizes.h_contact * scene.physics.scales.length:.3g})"
    words = "it went through, or the contact lies between two points of"
    return f"the tip is {state.delta:.6g} deep in the body and finds {missed}: {words} {mesh}"


def _is_wider_than_tip(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """a up to the radius at which the tip ends, and an element to either side."""
    end, L = scene.physics.indenter.radius_at(scene.physics.body.height), scene.physics.scales.length
    if state.a <= (end + 2 * scene.sizes.h_contact) * L:
        return None
    return f"the contact radius {state.a:.6g} is beyond the tip, which ends at {end * L:.6g}"


def _stands_on_a_side(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """delta <= f at the top of a fixed side, which no force moves."""
    end = end_of_sides(scene.physics.body, scene.physics.indenter, scene.physics.center) * scene.physics.scales.depth
    if state.delta <= end * (1 + SAME):
        return None
    return f"the tip is on the top of a fixed side from {end:.6g} on, and the force there has no bound"


def _stands_still(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """A new depth is another solution: of no iteration, only where the one foretold was right and the force another."""
    before = earlier[-1] if earlier else None
    is_new = before is None or abs(state.delta - before.delta) > SAME * abs(state.delta)
    moved = abs(state.force - before.force) if before and (before.force > 0 or scene.physics.contact.may_snap) else 0.0
    is_other = moved > FORCE_NOISE * SAME * abs(state.force)
    if state.newton_iterations > 0 or not is_new or is_other:
        return None
    return "nothing was solved for this depth, and the force is that of another"


def _overlaps(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """No facet of the deformed surface lies inside the tip, but for what a coarse mesh or a penalty lets it sink in."""
    allowed = max(SUNK[0] * state.delta, SUNK[1] * scene.sizes.h_contact * scene.physics.scales.length)
    if state.overlap <= allowed + _sunk(scene, state):
        return None
    return f"a facet of the surface lies {state.overlap:.3g} inside the tip, which went through it"


def _is_inside_the_skin(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """No part of the surface that contact is not looked for on lies inside the tip."""
    if state.intrusion <= INTRUDED * state.delta + _sunk(scene, state):
        return None
    why = "a side of the body has come to the tip, or the contact group of a mesh file ends too early"
    where = "inside the surface beside the contact surface, where nothing keeps it out"
    return f"the tip is {state.intrusion:.3g} {where}: {why}"


def _energy_is_not_its_work(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """0 <= Pi <= force delta, as of any force that grows with the depth."""
    work = state.force * state.delta
    is_its_work = -WORK_SLACK * work <= state.energy <= (1 + WORK_SLACK) * work
    if is_its_work or _may_soften(scene):
        return None
    if scene.physics.has_friction and any(one.delta > state.delta for one in earlier):
        return None
    return f"the energy is {state.energy:.6g}, and a force that grew to {state.force:.6g} did {work:.6g} at most"


def _falls(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """force <= force at a greater depth, within the error bars of both where there are any."""
    if scene.physics.has_friction and any(later.delta < one.delta for one, later in pairwise((*earlier, state))):
        return None  # friction gives less back
    fall = LINEAR_FALL if scene.physics.small_strain and scene.physics.gap == "reference" else FALL
    shallower = max((o for o in earlier if o.delta < state.delta), key=lambda o: o.force - _bar(o), default=state)
    deeper = min((o for o in earlier if o.delta > state.delta), key=lambda o: o.force + _bar(o), default=state)
    for shallow, deep in ((shallower, state), (state, deeper)):
        lost = shallow.force - deep.force - _bar(shallow) - _bar(deep)
        lost -= fall * abs(shallow.force)
        if lost > 0 and lost > _noise(scene, state, earlier) and not _may_soften(scene):  # many rows: cheapest first
            forces = f"{shallow.force:.6g} at delta = {shallow.delta:.6g} and {deep.force:.6g} at {deep.delta:.6g}"
            return f"the force is {forces}, where it must be larger"
    return None


def _is_not_theorys(scene: Scene, state: State, earlier: Sequence[State]) -> str | None:
    """The force is theory's within the error bar where theory is exact, and within a factor where it is nearly so."""
    theory, scales = scene.plan.theory, scene.physics.scales
    solution = theory.at(state.delta / scales.depth) if theory else None
    if theory is None or solution is None or solution.force <= 0:
        return None
    expected = solution.force * scales.force
    lowest, highest = _range(scene, solution)
    said = f"the force is {state.force:.6g}, and {theory.name}"
    if not lowest * expected <= state.force <= highest * expected:
        return f"{said} expects {expected:.6g}"
    if not scene.exact_theory or state.force_error is None or isnan(state.force_error):
        return None
    if abs(state.force - expected) <= state.force_error + THEORY_FORCE_ERROR * expected:
        return None
    return f"{said}, exact for this body, {expected:.6g}: the error bar {state.force_error:.3g} does not hold it"


ALWAYS: Rules = (_is_no_number, _overlaps, _pulls, _pushes_from_afar, _is_wider_than_tip, _falls, _stands_on_a_side)
WHEN_PRESSED: Rules = (_touches_nothing, _is_inside_the_skin, _stands_still, _energy_is_not_its_work, _is_not_theorys)
OF_TIPS_THAT_PUSH: Rules = (_pulls, _falls, _energy_is_not_its_work, _is_not_theorys)
# What takes time lets a force fall in a hold, and what was pressed in may not have come back yet, or swells
OF_ELASTIC_BODIES: Rules = (_pushes_from_afar, _falls, _touches_nothing, _energy_is_not_its_work, _is_not_theorys)


def _is_first_touch(scene: Scene, state: State) -> bool:
    """Whether E* radius_at(depth) depth, of the order of the force, is next to none beside that of the whole path."""
    depth, deepest = state.delta / scene.physics.scales.depth, max(scene.physics.deltas)
    if depth <= 0 or deepest <= depth:
        return depth <= 0
    radius_at = relative_tip(scene.physics.indenter, scene.physics.body).radius_at
    return depth * radius_at(depth) <= FIRST_TOUCH * deepest * radius_at(deepest)


def _noise(scene: Scene, state: State, earlier: Sequence[State]) -> float:
    """A force that is none [force]: beside those so far, or beside one that presses an element in as deep."""
    scales, h = scene.physics.scales, scene.sizes.h_contact
    pressed = scene.physics.material.E_star * h ** (scales.dim - 2) * abs(state.delta) / scales.depth * scales.force
    return FORCE_NOISE * max(pressed, *(abs(other.force) for other in earlier), 0.0)


def _sunk(scene: Scene, state: State) -> float:
    """How far the contact law lets the tip sink in [length]."""
    return PENETRATIONS * state.penetration if isinstance(scene.physics.contact, Penalty | Nitsche) else 0.0


def _bar(state: State) -> float:
    return state.force_error if state.force_error and isfinite(state.force_error) else 0.0


def _may_soften(scene: Scene) -> bool:
    """Whether the law is no longer stable at the strains to expect: then a force may fall."""
    return any(doubt.key == "stability" for doubt in scene.plan.doubts)


def _range(scene: Scene, theory: Solution) -> tuple[float, float]:
    """Least and largest force over theory's that may be true, mesh and penalty included."""
    coarse = 1 + force_doubt(scene.sizes, theory.a, scene.physics.material.constants.nu)
    left = 1 - penalty_loss(scene.physics.contact, scene.physics.material, scene.plan.theory, theory.delta, theory.a)
    if scene.exact_theory:
        return left / (SAME_PROBLEM_FACTOR * coarse), SAME_PROBLEM_FACTOR * coarse
    height, rim = scene.physics.body.height, scene.physics.body.rim_distance(scene.physics.center)
    feels_a_half_space = theory.a <= HALF_SPACE_CONTACT * min(height, rim) and height <= PILLAR_HEIGHT * rim
    if scene.physics.body.inclusions or scene.physics.part.skins or not feels_a_half_space:  # skins bend as shells
        return 0.0, float("inf")
    may_stiffen = not scene.physics.small_strain and theory.delta > SHALLOW * theory.a
    return left / (HALF_SPACE_FACTOR * coarse), float("inf") if may_stiffen else HALF_SPACE_FACTOR * coarse
