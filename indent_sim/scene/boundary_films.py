"""Boundary layers at drained faces: error of the force on thicker elements, and sizes to avoid it.

At a time t after a load, the pore fluid has drained from a boundary layer of thickness (D t)^(1/2)
at every drained face, and the rest of the body is undrained. Elements thicker than this layer
overestimate the drained length by E (`excess_length` of `theory.drained_layer`). Let p be the
undrained pressure at a depth delta. By Betti's reciprocity, fluid of the volume dV that drains at
the face lowers the force by (dp/ddelta) dV, so that the error of the force is

    dF = 1/2 d/ddelta int p^2 E/M dA,      1/M = alpha^2/M_c + storage,

where M_c is the confined (oedometric) modulus. Under a tip, p is about the contact pressure; on an
incompressible half-space it is equal to it. The relative error of the force is `per_length` E with

    per_length = c m F/(A delta M),        c = 1/2 dln(F^2/A)/dln(delta),

where m = 9/8, and c is 1 on a half-space and up to 5/2 on a thin layer. Under a
paraboloid on a half-space this is 6 G/(pi M_c a). For faces farther from the contact it is smaller
by at least the factor (a/distance)^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.drainage import Conductance
from indent_sim.scene.depth_limits import RIM_TOLERANCE
from indent_sim.scene.limiting_elastic_laws import undrained_law
from indent_sim.scene.path_rows import PathRow, path_rows
from indent_sim.scene.problem_definition import ProblemDefinition, is_undrained_incompressible
from indent_sim.scene.problem_setup import ProblemSetup

# Smallest depth or force of a row, relative to the largest one, for which the error by boundary
# layers is considered.
MIN_VALUE_FRACTION = 0.05


def smallest_diffusivity(physics: ProblemDefinition) -> float:
    """Return the smallest diffusivity D [length^2/time] of the regions with pore fluid."""
    return min(region.material.diffusivity for region in physics.permeable_regions)


def largest_inverse_modulus(physics: ProblemDefinition) -> float:
    """Return the largest 1/M = permeability/D [1/pressure] of the regions with pore fluid.

    1/M is the volume of drained fluid per volume of the body and per pore pressure.
    """
    flows = [
        (region.material.flow, region.material.diffusivity) for region in physics.permeable_regions
    ]
    return max(flow.permeability / D for flow, D in flows if flow and flow.permeability)


def film_force_fraction(
    row: PathRow, h: float, diffusivity: float, fraction_per_length: float | None
) -> float:
    """Return the error of a row's force due to the boundary layer of a drained face under the tip.

    Parameters
    ----------
    row : PathRow
        The row.
    h : float
        Element size at the face [length].
    diffusivity : float
        Diffusivity D [length^2/time].
    fraction_per_length : float or None
        Value of `force_fraction_per_length`. None for a column, which is compressed by the drained
        volume only, so that force and drained volume have the same relative error.

    Returns
    -------
    float
        Error divided by the largest force.
    """
    excess = float(row.excess_length(np.array([h]), diffusivity)[0])
    if fraction_per_length is not None:
        return fraction_per_length * excess
    drained = row.drained_length(diffusivity)
    return excess / drained if drained else 0.0


def force_fraction_per_length(setup: ProblemSetup) -> float | None:
    """Return the relative error of the force per `excess_length` [1/length] at the largest depth.

    The error is that due to a drained face under the tip. It follows from the reference theory, or
    from a half-space if the depth is beyond the range of the theory. The result is None for a
    column that is compressed only by drainage.
    """
    if is_undrained_incompressible(setup.physics):
        return None
    physics = setup.physics
    delta = setup.max_depth
    theory = setup.theory_for_materials(undrained_law)
    # Ratio of the two depths from which the difference quotient is formed.
    depth_ratio = 0.9
    solutions = theory.solutions_at_depths([depth_ratio * delta, delta]) if theory else None
    # Mean square of the pressure below a paraboloid over the square of its mean.
    mean_square_factor = 9 / 8
    if not solutions:
        pressure = undrained_law(physics.material).E_star * delta / (2 * setup.a)
        return mean_square_factor * pressure / delta * largest_inverse_modulus(physics)
    lower_value, upper_value = (solution.force**2 / solution.area for solution in solutions)
    growth_exponent = log(upper_value / lower_value) / (-2 * log(depth_ratio))
    return (
        growth_exponent
        * mean_square_factor
        * solutions[1].force
        / (solutions[1].area * delta)
        * largest_inverse_modulus(physics)
    )


def drained_faces(setup: ProblemSetup, earliest: float) -> dict[str, float]:
    """Return the faces with a drained boundary layer, each with its distance to the contact.

    A face with a finite conductance has no boundary layer until the drained thickness exceeds
    permeability/conductance. The free surface beside a sealed tip has no boundary layer either: its
    undrained pore pressure is almost zero, and 10 elements per contact radius resolve the drainage
    around the edge of the contact to 0.2 % of the force.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    earliest : float
        Time of the first row [time].

    Returns
    -------
    dict
        Distances [length] by the name of the face.
    """
    physics = setup.physics
    drainage = physics.drainage
    domain = physics.domain
    face_distances = {}
    if _is_drained(physics, drainage.tip, earliest):
        face_distances["top"] = 0.0
    if _is_drained(physics, drainage.base, earliest):
        face_distances["base"] = domain.height
    distances = domain.wall_distances(physics.center)
    return face_distances | {
        wall: max(distances[wall] - setup.a, 0.0) for wall in physics.drained_walls
    }


def _is_drained(physics: ProblemDefinition, kind: str | Conductance, earliest: float) -> bool:
    """True if a surface has the pressure of the bath from the first row on."""
    if not isinstance(kind, Conductance):
        return kind == "drained"
    permeability = max(
        region.material.flow.permeability or 0.0
        for region in physics.permeable_regions
        if region.material.flow
    )
    return kind.conductance * (smallest_diffusivity(physics) * earliest) ** 0.5 > permeability


def distance_weight(setup: ProblemSetup, distance: float) -> float:
    """Return the weight of the boundary-layer error of a face at a distance [length].

    The weight is the error due to this face divided by the error due to a face under the tip. It is
    1 if the tip covers the body, because the pressure is then uniform.
    """
    a = setup.a
    rim_distance = setup.physics.body.lateral_extent(setup.physics.center)
    return 1.0 if distance <= a or a >= (1 - RIM_TOLERANCE) * rim_distance else (a / distance) ** 2


@dataclass(frozen=True)
class UnresolvedFilm:
    """Thin drained boundary layer at a drained face that the elements do not resolve.

    Attributes
    ----------
    face
        Name of the face.
    h
        Element size at the face [length].
    last_row
        Index (from 0) of the last row with an error of the force that is not negligible.
    max_error, last_row_error
        Largest error of all rows and error of the last row, divided by the largest force.
    """

    face: str
    h: float
    last_row: int
    max_error: float
    last_row_error: float


def unresolved_film(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes, negligible: float
) -> UnresolvedFilm | None:
    """Return the unresolved boundary layer with the largest error of the force.

    Such a layer at a drained face, in which the pore pressure changes, is thinner than the
    elements. The result is None if the mesh resolves all of these layers.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup.
    physics : ProblemDefinition
        The problem with its load path.
    sizes : Sizes
        Element sizes.
    negligible : float
        Error, divided by the largest force, up to which a layer counts as resolved.

    Returns
    -------
    UnresolvedFilm or None
        The boundary layer with the largest error.
    """
    rows = path_rows(physics.path)
    D = smallest_diffusivity(physics)
    fraction_per_length = force_fraction_per_length(setup)
    earliest = min(physics.path.times) - (physics.path.start_time or 0.0)
    films: list[UnresolvedFilm] = []
    for face, distance in drained_faces(setup, earliest).items():
        h = element_size_at_face(setup, physics, sizes, face, distance)
        weight = distance_weight(setup, distance)
        errors = [
            weight * film_force_fraction(row, h, D, fraction_per_length)
            if row.value >= MIN_VALUE_FRACTION
            else 0.0
            for row in rows
        ]
        unresolved_rows = [k for k, error in enumerate(errors) if error > negligible]
        if unresolved_rows:
            films.append(UnresolvedFilm(face, h, unresolved_rows[-1], max(errors), errors[-1]))
    return max(films, key=lambda film: film.max_error, default=None)


def element_size_at_face(
    setup: ProblemSetup, physics: ProblemDefinition, sizes: Sizes, face: str, distance: float
) -> float:
    """Return the element size [length] at a drained face, at the point closest to the contact."""
    film = next((film for film in sizes.drained_faces if film.side.surface == face), None)
    nearest_point = {"top": (0.0, 0.0), "base": (0.0, physics.domain.height)}.get(
        face, (distance + setup.a, 0.0)
    )
    h = float(sizes.size_at(*map(np.array, nearest_point)))
    return min(film.h, h) if film else h


def film_element_size(
    rows: Sequence[PathRow],
    max_fraction: float,
    diffusivity: float,
    fraction_per_length: float | None,
    largest_size: float,
    smallest_size: float,
) -> float:
    """Return the largest element size at a face under the tip for a permitted error of the force.

    Parameters
    ----------
    rows : sequence of PathRow
        Rows of the path.
    max_fraction : float
        Permitted error due to the boundary layer, divided by the largest force.
    diffusivity : float
        Diffusivity D [length^2/time].
    fraction_per_length : float or None
        Value of `force_fraction_per_length`.
    largest_size, smallest_size : float
        Bounds of the size [length].

    Returns
    -------
    float
        Element size [length].
    """
    relevant_rows = [
        row
        for row in rows
        if row.value >= MIN_VALUE_FRACTION and row.drained_length(diffusivity) > 0
    ]
    # Largest number of rows from which the element size is determined.
    max_rows = 100
    relevant_rows = sorted(
        relevant_rows, key=lambda row: row.drained_length(diffusivity) / row.changes.sum()
    )[:max_rows]

    def excess_error(h: float) -> float:
        errors = (
            film_force_fraction(row, h, diffusivity, fraction_per_length) for row in relevant_rows
        )
        return max(errors, default=0.0) - max_fraction

    if excess_error(largest_size) <= 0:
        return largest_size
    if excess_error(smallest_size) >= 0:
        return smallest_size
    # This import takes 0.2 s, which scenes without a fluid need not spend.
    from scipy.optimize import brentq

    log_size = brentq(
        lambda log_h: excess_error(exp(log_h)), log(smallest_size), log(largest_size), xtol=1e-9
    )
    return exp(log_size)
