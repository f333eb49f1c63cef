"""Sanity checks of rows: bounds that hold for every elastic body, mesh and method.

Without adhesion the force is not tensile, and a tip below the undeformed surface is in contact. The
force grows with the depth and is the derivative of the potential energy Pi of the body, hence 0 <=
Pi <= F delta. The surface stays outside the tip, also where no contact is modelled. The force
agrees with theory if theory is exact, and in its order of magnitude if theory is approximate. These
bounds do not measure the accuracy of a row; `underresolved_rows` names rows whose contact has too
few elements.

Some bounds do not apply to every scene. With adhesion the force may be tensile, and it jumps where
the tip snaps in or off. With flow or relaxation depth and force depend on time, and rules that
compare rows are left out. With friction a part of the work of loading is dissipated, so that forces
are compared only during loading.

A body that yields stores only a part of the work and keeps an imprint, in which the tip may have no
contact at a smaller depth. In place of the bounds on the energy, and of those by elastic theory,
the balance of work, stored and dissipated energy is then checked during loading, the dissipated
energy does not fall, the force falls only if the depth does, and it is at most that of an elastic
body.

Each rule is a function of the scene, a converged state and the previous rows (in the user's units).
It returns a sentence, or None if the state satisfies it. The bounds are wide enough for coarse
meshes and soft penalties.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import isfinite, isnan

from indent_sim.model.contact import Nitsche, Penalty
from indent_sim.model.state import State
from indent_sim.model.tips import max_radius
from indent_sim.run.measured_constants import MAX_OUTSIDE_PENETRATION, MAX_OVERLAP
from indent_sim.run.previous_rows import PreviousRows, force_interval
from indent_sim.scene.expected_error import expected_force_error, penalty_force_loss
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.theory.solution import Solution

# Force that round-off and the tolerance of the supports may leave where there is none, relative to
# the largest force so far.
FORCE_NOISE = 1e-6
# Relative distance of depths below which two rows may be one solution to the solver's tolerance.
DEPTH_TOLERANCE = 1e-6


Rule = Callable[[Scene, State, PreviousRows], "str | None"]
Rules = tuple[Rule, ...]


def violated_bound(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Return a sentence on the bound that a converged state violates; None if it violates none.

    Parameters
    ----------
    scene
        The scene of the run.
    state
        A converged state [user's units].
    earlier
        The rows before it.
    """
    is_pressed = scene.is_meshed and not _is_at_first_contact(scene, state)
    refinement_remedy = (
        "shorter steps to this depth, a smaller mesh.h_contact or another contact.method may help"
    )
    side_remedy = (
        "contact is modelled on the top face only: use smaller depths, or let the top slide "
        "(contact.friction: 0)"
    )
    for rule in _applicable_rules(
        is_pressed,
        scene.physics.is_time_dependent,
        scene.physics.contact.may_snap_through,
        scene.physics.yields,
    ):
        if violation := rule(scene, state, earlier):
            is_side = rule is _check_outside_penetration and scene.physics.is_compressed
            return f"{violation}; {side_remedy if is_side else refinement_remedy}"
    return None


@cache
def _applicable_rules(
    is_pressed: bool, is_time_dependent: bool, may_snap_through: bool, yields: bool
) -> Rules:
    """Return the rules that apply to a row.

    Parameters
    ----------
    is_pressed
        True if the scene has a mesh and the depth exceeds the depth of first contact.
    is_time_dependent
        True if the force depends on time.
    may_snap_through
        True if the tip may snap in or off.
    yields
        True if the body may yield.
    """
    excluded = {
        *(REPULSIVE_RULES if may_snap_through else ()),
        *(ELASTIC_RULES if is_time_dependent else ()),
        *(RULES_BROKEN_BY_YIELD if yields else YIELD_RULES),
    }
    return tuple(
        rule
        for rule in (GENERAL_RULES + CONTACT_RULES if is_pressed else GENERAL_RULES)
        if rule not in excluded
    )


def _check_finite(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that depth, force, a and (on a mesh, without relaxation) the energy are finite."""
    names = (
        "delta",
        "force",
        "a",
        *(("energy",) if scene.is_meshed and not scene.physics.relaxing_regions else ()),
    )
    infinite_names = [name for name in names if not isfinite(getattr(state, name))]
    return f"not finite: {', '.join(infinite_names)}" if infinite_names else None


def _check_no_tension(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the force is not tensile."""
    if state.force >= 0 or state.force >= -_force_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, tensile without adhesion"


def _check_no_force_above(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the force is not compressive at negative depths."""
    if state.delta >= 0 or state.force <= _force_noise(scene, state, earlier):
        return None
    return f"the force is {state.force:.6g}, but the tip is above the body"


def _check_contact_found(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that there is contact where tip and undeformed body overlap.

    Without snap-through the force must also be compressive there.
    """
    is_touching = (state.force > 0 or scene.physics.contact.may_snap_through) and state.a > 0
    if is_touching or _may_be_in_imprint(scene, state, earlier):
        return None
    missing_text = "no force" if state.force <= 0 else "no contact radius"
    mesh = f"the mesh (h_contact = {scene.sizes.h_contact * scene.physics.scales.length:.3g})"
    cause = "the tip went through the surface, or the contact lies between two nodes of"
    return f"the depth is {state.delta:.6g}, but there is {missing_text}: {cause} {mesh}"


def _check_contact_radius(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the contact exceeds the end of the tip by at most two elements.

    No contact lies higher above the apex than the body's height, unless the body is a gel, which
    swells around the tip.
    """
    tip = scene.physics.indenter
    end = tip.radius_at(scene.physics.body.height)
    if scene.physics.is_swelling:
        end = max_radius(tip)
    L = scene.physics.scales.length
    if state.a <= (end + 2 * scene.sizes.h_contact) * L:
        return None
    return (
        f"the contact radius {state.a:.6g} exceeds the radius {end * L:.6g} at which the surface "
        "of the tip ends"
    )


def _check_resultant(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the force acts within the face of a tilted punch, and within the body."""
    if state.x_contact is None or scene.physics.contact.may_snap_through:
        return None
    L = scene.physics.scales.length
    farthest = scene.physics.body.max_lateral_extent(scene.physics.center)
    farthest = min(farthest, max_radius(scene.physics.indenter)) + 2 * scene.sizes.h_contact
    if abs(state.x_contact) <= farthest * L:
        return None
    return f"the force acts at {state.x_contact:.6g}, outside the contact"


def _check_side_contact(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the tip does not touch the upper edge of a fixed side.

    The exact force of such a contact is infinite.
    """
    end = scene.physics.side_contact_depth * scene.physics.scales.depth
    if state.delta <= end * (1 + DEPTH_TOLERANCE):
        return None
    return (
        f"from the depth {end:.6g} on the tip touches the upper edge of a fixed side, where the "
        "force is unbounded"
    )


def _check_new_solution(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that a new depth has a new solution.

    A solution without iterations is accepted only if the extrapolated state was correct and the
    force differs from that of the previous row.
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
    is_solved = state.newton_iterations > 0 or not is_new or is_other
    if is_solved or _may_be_in_imprint(scene, state, earlier):
        return None
    return "no iteration was done for this depth, and the force is that of the previous depth"


def _check_overlap(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that facets overlap the tip by no more than the mesh or a penalty may cause."""
    allowed = max(
        MAX_OVERLAP[0] * state.delta,
        MAX_OVERLAP[1] * scene.sizes.h_contact * scene.physics.scales.length,
    )
    if state.overlap <= allowed + _allowed_penetration(scene, state):
        return None
    return f"a facet of the surface lies {state.overlap:.3g} inside the tip"


def _check_outside_penetration(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the tip does not penetrate the body outside the contact surface."""
    if state.intrusion <= MAX_OUTSIDE_PENETRATION * state.delta + _allowed_penetration(
        scene, state
    ):
        return None
    cause = (
        "a side of the body touches the tip, or the contact surface of a mesh file ends too early"
    )
    if scene.physics.is_compressed:
        previous_depth = (
            earlier.last.delta if earlier.last and earlier.last.delta < state.delta else 0.0
        )
        cause = (
            f"a side of the body folds against the tip from a depth between {previous_depth:.6g} "
            f"and {state.delta:.6g} on"
        )
    where = "outside the contact surface, where no contact is modelled"
    return f"the tip penetrates the body by {state.intrusion:.3g} {where}: {cause}"


def _check_energy(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that 0 <= Pi <= F delta, which holds if the force grows with the depth.

    A sliding tip also does work by its side force, at most the largest side force times the length
    of the slide.
    """
    side_force = max(
        earlier.largest_side_force, abs(state.side_force_x or 0.0), abs(state.side_force_y or 0.0)
    )
    slide_work = side_force * (earlier.slide_distance + earlier.slide_increment(state))
    work = state.force * state.delta + slide_work
    # The contact term of a multiplier adds up to this fraction of F delta to the energy on a coarse
    # mesh.
    tolerance = 0.02
    is_its_work = -tolerance * work <= state.energy <= (1 + tolerance) * work
    if is_its_work or _may_be_unstable(scene):
        return None
    if scene.physics.has_friction and earlier.max_depth > state.delta:
        return None
    return (
        f"the energy is {state.energy:.6g}, but the work of a force that grew to "
        f"{state.force:.6g} is at most {work:.6g}"
    )


def _check_force_growth(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the force does not decrease with increasing depth, within the error bars."""
    last = earlier.last
    if earlier.slide_distance + earlier.slide_increment(state) > 0:
        return None  # the force at one depth may change as the tip slides
    may_lag = scene.physics.has_friction or scene.physics.yields
    if may_lag and last and (earlier.has_turned or state.delta < last.delta):
        return None  # friction and yield make the force smaller in unloading
    # Largest relative fall of the force with increasing depth: of linear problems, which are solved
    # to 1e-7, and of all others, whose force is not smooth on a mesh.
    max_linear_fall = 1e-3
    max_fall = 0.02
    fall = (
        max_linear_fall
        if scene.physics.small_strain and scene.physics.gap == "reference"
        else max_fall
    )
    row_force = force_interval(state)
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
            return f"the force is {forces}, but it must grow with the depth"
    return None


def _check_side_force(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the side force is at most friction F plus the force on the slope of the tip.

    The bound is for a reference gap, with which the pressure on the body is vertical.
    """
    physics = scene.physics
    law = physics.contact
    name = physics.slide_force_column
    if not name or physics.gap != "reference" or law.is_bonded:
        return None
    side_force = getattr(state, name)
    a = state.a / physics.scales.length
    if side_force is None or not physics.indenter.is_axisymmetric or a <= 0:
        return None
    # Friction shifts the middle of the contact from the axis by less than half its radius.
    steepest = float(physics.indenter.slope(1.5 * a + scene.sizes.h_contact))
    friction = float(law.friction or 0.0)
    allowed = (friction + abs(steepest)) * state.force
    excess = abs(side_force) - allowed * (1 + FORCE_NOISE) - _force_noise(scene, state, earlier)
    if not excess > 0:  # beyond the end of a tip its slope is infinite or not a number
        return None
    return (
        f"the side force is {side_force:.6g}, but friction and the slope of the tip allow at most "
        f"{allowed:.6g}"
    )


def _check_against_theory(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that F/F_theory is in its admissible range.

    If the theory is exact for the body, F must also agree with it within the error bar.
    """
    theory = scene.plan.theory
    scales = scene.physics.scales
    solution = scene.theory_solution(state.delta / scales.depth)
    if theory is None or solution is None or solution.force <= 0:
        return None
    expected = solution.force / scene.physics.mirror_multiplicity * scales.force
    lowest, highest = _force_ratio_range(scene, solution)
    message = f"the force is {state.force:.6g}, but that of {theory.name}"
    if not lowest * expected <= state.force <= highest * expected:
        return f"{message} is {expected:.6g}"
    if not scene.exact_theory or state.force_error is None or isnan(state.force_error):
        return None
    # Relative error of theory's own force.
    theory_force_error = 1e-4
    if abs(state.force - expected) <= state.force_error + theory_force_error * expected:
        return None
    return (
        f"{message}, exact for this body, is {expected:.6g}: outside the error bar "
        f"{state.force_error:.3g}"
    )


def _check_plastic_work(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the work of loading is the sum of stored and dissipated energy, without friction.

    The work is the integral of the force over the rows by trapezoids, whose error is estimated.
    In the first half of the depth the contact may have so few elements that the force jumps.
    """
    is_loading = state.delta > max(earlier.max_depth, 0.0) and not earlier.has_turned
    deepest = scene.physics.max_depth * scene.physics.scales.depth
    is_deepest = state.delta >= deepest * (1 - DEPTH_TOLERANCE)
    if state.plastic_dissipation is None or scene.physics.has_friction or not is_loading:
        return None
    if state.delta < deepest / 2:
        return None
    work, error = earlier.work_to(state)
    total = state.energy + state.plastic_dissipation
    # Tolerance relative to F delta, as in `_check_energy`, and in the deepest row to the work.
    tolerance = 0.02
    reference = work if is_deepest else state.force * state.delta
    if abs(work - total) <= tolerance * reference + error:
        return None
    return (
        f"the work of the tip is {work:.6g}, but the stored energy is {state.energy:.6g} and the "
        f"energy dissipated by plastic flow {state.plastic_dissipation:.6g}"
    )


def _check_soft_tip(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check the parts of depth and energy of a soft tip on the mesh of the body.

    The displacement of the tip must be a part of the depth, and its energy a part of the energy of
    both bodies. During loading the energy of both bodies must equal the work, which is the integral
    of the force over the rows by trapezoids, whose error is estimated.
    """
    if state.tip_sink is None or state.tip_energy is None or not scene.has_two_body_mesh:
        return None
    # Tolerance relative to F delta, as in `_check_energy`.
    tolerance = 0.02
    if not -tolerance * state.delta <= state.tip_sink <= (1 + tolerance) * state.delta:
        return (
            f"the soft tip is pressed in by {state.tip_sink:.6g}, which is not between 0 and "
            "the depth"
        )
    if not -tolerance * state.energy <= state.tip_energy <= (1 + tolerance) * state.energy:
        return (
            f"the energy {state.tip_energy:.6g} of the soft tip is not between 0 and that of "
            f"both bodies, {state.energy:.6g}"
        )
    if state.delta <= max(earlier.max_depth, 0.0) or earlier.has_turned:
        return None
    work, error = earlier.work_to(state)
    if abs(work - state.energy) <= tolerance * state.force * state.delta + error:
        return None
    return f"the work of the tip is {work:.6g}, but the energy of both bodies is {state.energy:.6g}"


def _check_dissipation_growth(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that the energy dissipated by plastic flow does not fall."""
    last = earlier.last
    if last is None or state.plastic_dissipation is None or last.plastic_dissipation is None:
        return None
    noise = FORCE_NOISE * max(last.plastic_dissipation, abs(state.energy))
    if state.plastic_dissipation >= last.plastic_dissipation - noise:
        return None
    return (
        f"the energy dissipated by plastic flow is {state.plastic_dissipation:.6g}, less than "
        f"{last.plastic_dissipation:.6g} in the previous row"
    )


def _check_force_follows_depth(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that force and depth of a body that yields increase and decrease together."""
    last = earlier.last
    if not scene.physics.yields or last is None or earlier.slide_increment(state) > 0:
        return None
    is_deeper = state.delta > last.delta
    if scene.physics.has_friction or state.delta == last.delta:
        return None
    # The force is not smooth on a mesh, as in `_check_force_growth`.
    tolerance = 0.02
    bars = force_interval(state)[2] + force_interval(last)[2]
    wrong_change = (last.force - state.force) if is_deeper else (state.force - last.force)
    allowed = tolerance * abs(last.force) + bars + _force_noise(scene, state, earlier)
    if wrong_change <= allowed:
        return None
    verb = "fell while the tip went deeper" if is_deeper else "grew while the tip went out"
    return f"the force {verb}: {last.force:.6g} at {last.delta:.6g}, {state.force:.6g} here"


def _check_elastic_bound(scene: Scene, state: State, earlier: PreviousRows) -> str | None:
    """Check that a body that yields has at most the force of an elastic one at the same depth.

    The elastic force is that of small-strain theory; with a law of finite strain the force may
    exceed it by a factor.
    """
    theory = scene.plan.theory
    scales = scene.physics.scales
    solution = scene.theory_solution(state.delta / scales.depth)
    if theory is None or solution is None or solution.force <= 0:
        return None
    if not _is_half_space_like(scene, solution):
        return None
    # Friction and the finite strain of the steepest tips increase the elastic force by less.
    finite_strain_factor = 2.0
    mesh_factor = 1 + expected_force_error(scene.sizes, solution.a, scene.physics.largest_nu)
    elastic = solution.force / scene.physics.mirror_multiplicity * scales.force
    if state.force <= finite_strain_factor * mesh_factor * elastic:
        return None
    return f"the force is {state.force:.6g}, but that of an elastic body is {elastic:.6g}"


GENERAL_RULES: Rules = (
    _check_finite,
    _check_overlap,
    _check_no_tension,
    _check_no_force_above,
    _check_contact_radius,
    _check_resultant,
    _check_force_growth,
    _check_side_contact,
)
CONTACT_RULES: Rules = (
    _check_contact_found,
    _check_outside_penetration,
    _check_new_solution,
    _check_energy,
    _check_side_force,
    _check_plastic_work,
    _check_soft_tip,
    _check_dissipation_growth,
    _check_force_follows_depth,
    _check_elastic_bound,
    _check_against_theory,
)
REPULSIVE_RULES: Rules = (
    _check_no_tension,
    _check_force_growth,
    _check_energy,
    _check_against_theory,
)
# Rules for bodies that do not depend on time: the force of a time-dependent one falls in a hold,
# and its surface may not have recovered yet, or may swell.
ELASTIC_RULES: Rules = (
    _check_no_force_above,
    _check_force_growth,
    _check_contact_found,
    _check_energy,
    _check_against_theory,
    _check_force_follows_depth,
)

# Rules that hold only for a body that yields.
YIELD_RULES: Rules = (
    _check_plastic_work,
    _check_dissipation_growth,
    _check_force_follows_depth,
    _check_elastic_bound,
)
# Rules that do not hold for a body that yields.
RULES_BROKEN_BY_YIELD: Rules = (
    _check_energy,
    _check_against_theory,
)


def _may_be_in_imprint(scene: Scene, state: State, earlier: PreviousRows) -> bool:
    """True if the tip may be out of contact in the imprint that a larger depth has left."""
    return scene.physics.yields and state.delta < earlier.max_depth


def _is_at_first_contact(scene: Scene, state: State) -> bool:
    """True if E* radius_at(delta) delta, an estimate of the force, is negligible on the path."""
    depth = state.delta / scene.physics.scales.depth
    deepest = scene.physics.max_depth
    if depth <= 0 or deepest <= depth:
        return depth <= 0
    # The contact of a row whose expected force is a smaller fraction of the path's largest force
    # may lie between two nodes of the mesh.
    first_contact_fraction = 1e-5
    if scene.physics.is_compressed:
        return depth <= first_contact_fraction * deepest
    radius_at = relative_tip(scene.physics.indenter, scene.physics.body).radius_at
    return depth * radius_at(depth) <= first_contact_fraction * deepest * radius_at(deepest)


def _force_noise(scene: Scene, state: State, earlier: PreviousRows) -> float:
    """Return the force that counts as zero [force].

    This force is a fraction of the largest force so far, or of the force of one element at the same
    depth.
    """
    scales = scene.physics.scales
    h = scene.sizes.h_contact
    element_force = (
        scene.physics.material.E_star
        * h ** (scales.dim - 2)
        * abs(state.delta)
        / scales.depth
        * scales.force
    )
    return FORCE_NOISE * max(element_force, earlier.largest_force)


def _allowed_penetration(scene: Scene, state: State) -> float:
    """Return the penetration that the contact law allows [length]."""
    # A penalty lets the tip penetrate somewhat more between its quadrature points than at
    # them.
    penetration_factor = 2.0
    return (
        penetration_factor * state.penetration
        if isinstance(scene.physics.contact, Penalty | Nitsche)
        else 0.0
    )


def _may_be_unstable(scene: Scene) -> bool:
    """True if the material may be unstable at the expected strains, so that the force may fall."""
    return any(warning.key == "stability" for warning in scene.plan.model_warnings)


def _force_ratio_range(scene: Scene, theory: Solution) -> tuple[float, float]:
    """Return the smallest and the largest admissible value of force divided by force of theory."""
    mesh_factor = 1 + expected_force_error(scene.sizes, theory.a, scene.physics.largest_nu)
    force_fraction = 1 - penalty_force_loss(
        scene.physics.contact, scene.physics.material, scene.plan.theory, theory.delta, theory.a
    )
    if scene.exact_theory:
        # Largest ratio of the force and that of theory for the same problem.
        same_problem_factor = 1.5
        highest = same_problem_factor * mesh_factor
        return force_fraction / highest, highest
    if not _is_half_space_like(scene, theory):
        return 0.0, float("inf")
    # No elastic law stiffens by a factor up to this depth, relative to the contact radius.
    max_linear_depth = 0.1
    may_stiffen = not scene.physics.small_strain and theory.delta > max_linear_depth * theory.a
    # Largest ratio of the force and that of a half-space at small strain.
    half_space_factor = 10.0
    lowest = force_fraction / (half_space_factor * mesh_factor)
    return lowest, float("inf") if may_stiffen else half_space_factor * mesh_factor


def _is_half_space_like(scene: Scene, theory: Solution) -> bool:
    """True if the body responds to the contact of theory about like the body of the theory."""
    height = scene.physics.body.height
    lateral_extent = scene.physics.body.lateral_extent(scene.physics.center)
    # A contact up to this fraction of the height and of the lateral extent is close to a
    # half-space's.
    half_space_contact = 0.3
    # A body higher than this many lateral extents is a pillar whose overall shortening
    # matters.
    pillar_height = 10.0
    is_half_space_like = (
        theory.a <= half_space_contact * min(height, lateral_extent)
        and height <= pillar_height * lateral_extent
    )
    # Coatings bend as shells, which no half-space does.
    has_other_parts = scene.physics.body.inclusions or scene.physics.domain.coatings
    return is_half_space_like and not has_other_parts
