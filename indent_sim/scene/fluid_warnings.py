"""Warnings about the drainage of a scene and its resolution in space and time."""

from __future__ import annotations

from collections.abc import Iterator

from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.boundary_films import (
    drained_faces,
    element_size_at_face,
    smallest_diffusivity,
    unresolved_film,
)
from indent_sim.scene.diffusion_times import DiffusionTimes, drained_face_size
from indent_sim.scene.discretisation_warnings import refinement_advice
from indent_sim.scene.expected_error import NEGLIGIBLE_ERROR, error_text
from indent_sim.scene.measured_constants import (
    DRAINED_LOCKING_NU,
    ELEMENT_DRAINAGE_FACTOR,
    LOCKING_ERROR,
    MIN_SEALED_ELEMENTS,
    SUDDEN_BATH_RATIO,
)
from indent_sim.scene.model_warnings import ModelWarning
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup


def fluid_warnings(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield warnings about the drainage of the fluid and its resolution in space and time."""
    if not physics.permeable_regions or setup.history is None:
        return
    yield from _seal_warnings(setup, physics, sizes)
    yield from _locking_warnings(physics)
    diffusion_times = DiffusionTimes.compute(setup, physics, drained_face_size(physics, sizes))
    if setup.is_half_space and setup.history.duration > diffusion_times.wall:
        yield ModelWarning(
            "diffusion",
            "diffusion reaches the walls of the finite body that replaces the half-space",
        )
    yield from _early_row_warnings(setup, physics, sizes)
    yield from _overshoot_warnings(setup, physics, sizes)
    if physics.creasing_message:
        yield ModelWarning(
            "creases",
            f"{physics.creasing_message}: some increments may not converge, and the computed "
            "surface stays smooth where a real one creases",
        )
    if physics.demixing_message:
        yield ModelWarning("demixing", f"{physics.demixing_message}: equilibria may not be found")
    yield from _bath_warnings(physics, setup.history.points[0][0])


def _seal_warnings(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield warnings about a body without drainage, or a coarse mesh below a sealed tip."""
    drainage = physics.drainage
    if {drainage.surface, drainage.tip, drainage.base} == {"sealed"} and not physics.drained_walls:
        yield ModelWarning(
            "sealed", "every surface is sealed: fluid flows inside the body, but none leaves it"
        )
    elements = setup.a / sizes.h_contact
    if (
        drainage.surface == "drained"
        and drainage.tip == "sealed"
        and elements < 0.99 * MIN_SEALED_ELEMENTS
    ):
        problem = (
            f"the sealed contact has {elements:.2g} elements in its radius, and the mesh resolves "
            "its edge to within one element"
        )
        remedy = (
            f"with {MIN_SEALED_ELEMENTS:g} elements the error is 2 % of the force that relaxes; "
            "use a smaller mesh.h_contact"
        )
        yield ModelWarning("sealing", f"{problem}: {remedy}")


def _locking_warnings(physics: ProblemDefinition) -> Iterator[ModelWarning]:
    """Yield a warning about displacement elements that lock after the body has drained."""
    largest_nu = max(
        (
            region.material.constants.nu
            for region in physics.permeable_regions
            if region.formulation != "mixed"
        ),
        default=0.0,
    )
    if largest_nu > DRAINED_LOCKING_NU:
        message = (
            f"the drained body has nu = {largest_nu:g}, at which displacement elements lock: at "
            "nu = 0.4999 the force is 1 % too large"
        )
        yield ModelWarning("locking", message, LOCKING_ERROR)


def _early_row_warnings(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield a warning about early rows whose drained boundary layer is thinner than an element."""
    if setup.max_depth <= 0 or physics.is_swelling:
        return
    film = unresolved_film(setup, physics, sizes, NEGLIGIBLE_ERROR)
    if not film:
        return
    element_text = (
        f"elements of {film.h * physics.scales.length:.2g} at the drained {film.face} are thicker "
        "than the layer that has drained by then"
    )
    force_text = f"the force is up to {error_text(film.max_error)} too low"
    message = (
        f"rows up to t = {physics.path.times[film.last_row]:.3g}: {element_text}, and {force_text}"
    )
    advice = refinement_advice(sizes, "give a smaller mesh.h_film")
    yield ModelWarning("early", f"{message}; {advice}", film.last_row_error)


def _overshoot_warnings(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes
) -> Iterator[ModelWarning]:
    """Yield a warning about early rows whose pressures overshoot beside a drained rim.

    Where the contact extends to a drained wall, the pore pressure jumps at the wall until an
    element has drained, and pressures linear in an element overshoot beside it. On a disc with a
    drained rim p_max was 5 % and pore_pressure_max 10 % too large, with elements of half the size
    that drains until the first row, p_max was 0.2 % and pore_pressure_max 2 % too large in that
    row. Checked by tests/physics/test_early_times.py.
    """
    if setup.max_depth <= 0 or physics.is_swelling:
        return
    start = physics.path.start_time or 0.0
    earliest = min(physics.path.times) - start
    D = smallest_diffusivity(physics)
    for face, distance in drained_faces(setup, earliest).items():
        if face in ("top", "base") or distance > 0.0:
            continue
        h = element_size_at_face(setup, physics, sizes, face, distance)
        drainage_time = (2.0 * h) ** 2 / (ELEMENT_DRAINAGE_FACTOR * D)
        early_times = [t for t in physics.path.times if 0.0 < t - start < drainage_time]
        if not early_times:
            continue
        resolved = 0.5 * (ELEMENT_DRAINAGE_FACTOR * D * earliest) ** 0.5 * physics.scales.length
        yield ModelWarning(
            "overshoot",
            f"rows up to t = {max(early_times):.3g}: elements at the drained {face} are thicker "
            "than the layer that has drained by then, and pressures overshoot beside it: p_max is "
            "up to 5 % and pore_pressure_max up to 10 % too large; "
            + refinement_advice(sizes, f"mesh.h_film: {resolved:.2g} would resolve all rows"),
        )


def _bath_warnings(physics: ProblemDefinition, start_time: float) -> Iterator[ModelWarning]:
    """Yield warnings about the ramp of a gel's bath if it has no effect or delays swelling."""
    if physics.drainage.bath_ramp != "auto" and not physics.is_swelling:
        yield ModelWarning(
            "bath_ramp",
            "drainage.bath_ramp has no effect: the body starts in equilibrium with this bath",
        )
    ramp = physics.bath_ramp
    early_times = [
        t - start_time for t in physics.path.times if 0 < t - start_time < SUDDEN_BATH_RATIO * ramp
    ]
    if not early_times:
        return
    deficits = (_swelling_deficit(ramp, t) for t in (max(early_times), min(early_times)))
    deficit_text = " to ".join(dict.fromkeys(map(error_text, deficits)))
    rows_text = (
        f"rows up to t = {start_time + max(early_times):.3g}: the bath changes over a time of "
        f"{ramp:.3g}"
    )
    yield ModelWarning(
        "bath",
        f"{rows_text}, so that the gel has risen less than after a sudden change, by "
        f"{deficit_text}; use a smaller drainage.bath_ramp",
    )


def _swelling_deficit(ramp: float, t: float) -> float:
    """Return the relative delay of the swelling of a gel at time t due to the ramp of its bath.

    The delay is 1 minus the rise of the surface divided by the rise after a sudden change. After a
    sudden change the rise is proportional to t^(1/2). If the bath changes linearly over the time
    `ramp`, the rise is proportional to 2/3 (t^(3/2) - (t - ramp)^(3/2))/ramp.
    """
    return 1.0 - 2.0 / 3.0 * (t**1.5 - max(t - ramp, 0.0) ** 1.5) / (ramp * t**0.5)
