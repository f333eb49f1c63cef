"""Load path of a problem that follows the prescribed history, with its time steps."""

from __future__ import annotations

from dataclasses import replace
from math import inf

from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.history import History
from indent_sim.model.load_path import LoadPath
from indent_sim.process.errors import ConfigError
from indent_sim.scene.depth_limits import expected_depths
from indent_sim.scene.diffusion_times import DiffusionTimes
from indent_sim.scene.measured_constants import ELEMENT_DRAINAGE_FACTOR, STEPS_TO_ROW
from indent_sim.scene.prescribed_history import prony_series
from indent_sim.scene.problem_definition import (
    ProblemDefinition,
    has_drained_surface,
    is_undrained_incompressible,
    largest_diffusivity,
)
from indent_sim.scene.problem_setup import ProblemSetup

# A sudden change of the bath at finite strain is applied over this many first steps, since Newton's
# method does not find a surface layer that swells at once.
RAMP_STEPS = 8.0
# A tip that slides needs this many contact radii for `steps_per_doubling` time steps.
SLIDE_FRACTION = 0.5
# The first step is at least this part of the shortest segment of a history.
MIN_STEP_FRACTION = 1e-3
# First step of a body that creeps, relative to the shortest segment of its history: a choice, with
# which some 30 steps divide a hold. `--error-bars` estimates the error of the steps.
CREEP_STEP_FRACTION = 1e-2


def problem_along_history(
    setup: ProblemSetup, physics: ProblemDefinition, h_contact: float
) -> ProblemDefinition:
    """Return the problem whose load path is the history.

    The path of `physics` is replaced, since it only leads to the largest depth of the history.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup, with a history.
    physics : ProblemDefinition
        The problem with the choices for its mesh.
    h_contact : float
        Element size at the contact [length].

    Returns
    -------
    ProblemDefinition
        The same problem with its time steps.

    Raises
    ------
    ConfigError
        If the body cannot be compressed because no fluid drains, or if a row is requested at a jump
        at which the body has no equilibrium.
    """
    assert setup.history is not None
    path = setup.history.path
    if physics.is_time_dependent:
        physics = replace(physics, domain=_expand_relaxation(physics, setup.history))
        physics = replace(physics, bath_ramp=bath_ramp_time(setup, physics))
        path = setup.history.time_stepped_path(
            first_step(setup, physics, h_contact),
            setup.steps_per_doubling,
            SLIDE_FRACTION * setup.a / setup.steps_per_doubling,
        )
        if is_undrained_incompressible(physics) and not has_drained_surface(physics):
            problem = (
                "no fluid leaves the pores, and the tip covers the top of a body that is held on "
                "all other sides"
            )
            remedy = (
                "drain the tip, the base or the sides, free the sides, or give the material a "
                "flow.storage"
            )
            raise ConfigError("drainage", f"{problem}: the body cannot be compressed", remedy)
        if path.has_jumps and is_undrained_incompressible(physics):
            path = _remove_jumps(
                path, "loading.force_history" if path.control == "force" else "loading.history"
            )
    return replace(physics, path=path, deltas=_depths_along(setup, path))


def row_depths(setup: ProblemSetup, follows_history: bool) -> tuple[float, ...]:
    """Return the expected depths [length] of the output rows that a scene requests.

    A history without `times` requests no rows. If it is solved by time stepping, every time step is
    an output row; the result is then empty, and `row_warnings` assesses the rows after the
    solution. If it is evaluated on the elastic curve, the depths of the points of the curve are
    returned.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    follows_history : bool
        True if the load path is the history, which is solved step by step.
    """
    if setup.history and setup.history.times:
        return tuple(
            min(delta, setup.max_depth) for delta in _depths_along(setup, setup.history.path)
        )
    return () if follows_history else setup.physics.deltas


def _depths_along(setup: ProblemSetup, path: LoadPath) -> tuple[float, ...]:
    """Return the expected depth [length] at each value of a path."""
    physics = setup.physics
    return expected_depths(
        path,
        setup.theory,
        setup.relative_tip,
        physics.material,
        physics.body.height,
        physics.scales,
        physics.mirror_multiplicity,
    )


def bath_ramp_time(setup: ProblemSetup, physics: ProblemDefinition) -> float:
    """Return the time over which a change of a gel's bath is applied linearly [time].

    The time is given by the key `drainage.bath_ramp`. For `auto` at finite strain it is L^2/(75 D),
    where D is the largest diffusivity and L the smaller of the expected contact radius and the
    body's height; it does not depend on the mesh. It is 0 if the bath does not swell or shrink the
    body, and for an instantaneous change.
    """
    if not physics.is_swelling:
        return 0.0
    if physics.drainage.bath_ramp != "auto":
        return physics.drainage.bath_ramp
    if physics.small_strain:
        return 0.0
    # Elements of a tenth of the contact radius just drain in a step of h^2/(ELEMENT_DRAINAGE_FACTOR
    # D).
    ramp_fraction = RAMP_STEPS / ELEMENT_DRAINAGE_FACTOR / 10**2
    return ramp_fraction * min(setup.a, physics.body.height) ** 2 / largest_diffusivity(physics)


def _remove_jumps(path: LoadPath, key: str) -> LoadPath:
    """Return the path without jumps of the prescribed value.

    Raises
    ------
    ConfigError
        If a jump is at a requested time, or if there are no other rows.
    """
    requested_jumps = path.sudden_rows if path.turns else ()
    if requested_jumps or len(path.sudden_rows) == len(path.values):
        time_text = f" at t = {path.times[requested_jumps[0] - 1]:g}" if requested_jumps else ""
        problem = (
            f"jumps{time_text}, and this body cannot be compressed before fluid has drained: there "
            "is no equilibrium at that time"
        )
        raise ConfigError(key, problem, "ask for a later time, or replace the jump by a ramp")
    return path.without_sudden_rows()


def first_step(setup: ProblemSetup, physics: ProblemDefinition, h_contact: float) -> float:
    """Return the first time step of a segment of the history [time].

    The time step resolves diffusion, relaxation and the ramp of a bath. h_contact is the element
    size at the contact [length].
    """
    assert setup.history is not None
    if physics.creeps:
        return CREEP_STEP_FRACTION * setup.history.shortest_segment
    times = [
        t
        for region in physics.domain.regions
        if region.relaxation_series
        for t in region.relaxation_series.times
    ]
    # Number of first time steps of a segment in the shortest relaxation time.
    steps_per_relaxation_time = 20.0
    shortest = max(
        min(times, default=inf) / steps_per_relaxation_time,
        MIN_STEP_FRACTION * setup.history.shortest_segment,
    )
    if not physics.permeable_regions:
        return shortest
    shortest = min(shortest, setup.history.shortest_time_to_row / STEPS_TO_ROW)
    first = DiffusionTimes.compute(setup, physics, h_contact).first_step(shortest)
    return min(first, physics.bath_ramp / RAMP_STEPS) if physics.bath_ramp else first


def _expand_relaxation(physics: ProblemDefinition, history: History) -> ModelDomain:
    """Return the model domain with the relaxation laws of its regions as Prony series."""

    def with_prony_series(region: Region) -> Region:
        law = region.material.relaxation
        # Shortest relaxation time of the series, relative to the first step.
        shortest_time_fraction = 1e-2
        shortest = shortest_time_fraction * MIN_STEP_FRACTION * history.shortest_segment
        return (
            replace(region, relaxation_series=prony_series(law, shortest, history.duration))
            if law
            else region
        )

    return replace(physics.domain, regions=tuple(map(with_prony_series, physics.domain.regions)))
