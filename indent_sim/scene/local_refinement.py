"""Local refinement at corners, in inclusions and coatings, and at drained faces."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.sizes import BaseContact, DrainedFace, Sizes
from indent_sim.model.inclusions import Inclusion
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.units import round_length
from indent_sim.process.errors import ConfigError
from indent_sim.scene import boundary_films
from indent_sim.scene.corner_singularities import Corner, corners
from indent_sim.scene.history_path import problem_along_history
from indent_sim.scene.measured_constants import (
    ADHESIVE_ELEMENTS_PER_RADIUS,
    ELEMENTS_ABOVE_INCLUSION,
    ELEMENTS_PER_COATING,
    ELEMENTS_PER_RADIUS,
    FLAT_INCLUSION_FACTOR,
    MAX_INCLUSION_WEIGHT,
    SWELLING_CORNER_SIZE,
)
from indent_sim.scene.path_rows import path_rows
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import FixedSizes, MeshResolution
from indent_sim.theory.contacts_in_series import ContactsInSeries

if TYPE_CHECKING:
    from indent_sim.config.schema import Config

# Permitted relative error of the force due to the element sizes without a requested accuracy.
AUTO_ERROR = 0.003
# Share of the allowed error of the force that the elements in inclusions may cost.
INCLUSION_ERROR_SHARE = 0.25
# Radius of the fine part of the base in expected radii of the contact with the flat below, which is
# wider than expected where the body is compressed.
BASE_PATCH_FACTOR = 1.3


def refine_base_contact(default_sizes: Sizes, setup: ProblemSetup) -> Sizes:
    """Return sizes with as many elements in the contact with a flat below as under the tip."""
    physics = setup.physics
    body = physics.body
    if not isinstance(body, SphericalBody) or not body.rests_on_flat:
        return default_sizes
    adhesive_radii = setup.adhesive_base_radii
    a_base = max([_expected_base_radius(body, setup), *adhesive_radii])
    a_base = min(a_base, 0.9 * body.max_section_radius)
    h = min(a_base * default_sizes.h_contact / setup.a, default_sizes.h_far)
    if adhesive_radii:
        h = min(h, adhesive_radii[0] / ADHESIVE_ELEMENTS_PER_RADIUS)
    radius = min(BASE_PATCH_FACTOR * a_base + 2 * h, body.max_section_radius)
    depth = physics.domain.height
    return replace(
        default_sizes, base_contact=BaseContact(depth, round_length(radius), round_length(h))
    )


def _expected_base_radius(body: SphericalBody, setup: ProblemSetup) -> float:
    """Return the expected radius of the contact with the flat below [length].

    The base of a cap stays in contact nearly everywhere. Without a theory, half of the approach
    flattens the underside of a ball.
    """
    if not body.is_whole:
        return body.base_edge[0]
    theory = setup.theory
    solution = setup.solution(setup.max_depth) if setup.max_depth > 0 else None
    if solution and theory and isinstance(theory.contact, ContactsInSeries):
        return theory.contact.lower_solution(solution.force).a
    return max((body.apex_radius * max(setup.max_depth, 0.0) / 2) ** 0.5, setup.a)


def refine_corners(
    default_sizes: Sizes,
    setup: ProblemSetup,
    fixed_sizes: FixedSizes,
    resolution: MeshResolution | None,
) -> Sizes:
    """Return sizes that decrease towards the corners that influence the contact, in two dimensions.

    In three dimensions this refinement would cost too much. The field `corner_error` of the result
    estimates the error of the force due to the elements at corners, with and without refinement. A
    coarser mesh does not show this error, since the elements at a corner are never larger than the
    elements in the contact.
    """
    physics = setup.physics
    near_corners = nearby_corners(physics, default_sizes, setup.a) if setup.max_depth > 0 else []
    if fixed_sizes.h_corner and (physics.domain.dim == 3 or not near_corners):
        where = (
            "corners of a bonded base, edges of cylindrical inclusions and narrow gaps next to the "
            "contact in two dimensions"
        )
        raise ConfigError(
            "mesh.h_corner", f"applies only to {where}, but this scene has none", "leave it out"
        )
    if resolution:
        error = resolution.error
        n = resolution.n
    else:
        error = AUTO_ERROR
        n = setup.a / default_sizes.h_contact
    h = fixed_sizes.h_corner
    is_size_free = resolution is not None or fixed_sizes.h_contact is None
    if physics.domain.dim == 2 and h is None and is_size_free:
        h = needed_corner_size(default_sizes, near_corners, error, n)
        if h is not None and physics.is_swelling:
            h = max(h, SWELLING_CORNER_SIZE * default_sizes.h_contact)
    return sizes_with_corners(default_sizes, near_corners, h)


def nearby_corners(physics: ProblemDefinition, sizes: Sizes, a: float) -> list[Corner]:
    """Return the corners of a body that influence a contact of the radius a [length]."""
    contact_end = a if physics.is_compressed else sizes.punch_edge
    return corners(physics.domain, physics.center, a, physics.largest_nu, contact_end)


def needed_corner_size(
    default_sizes: Sizes, near_corners: list[Corner], error: float, n: float
) -> float | None:
    """Return the element size at corners [length] for an error; None if no refinement is needed.

    Parameters
    ----------
    default_sizes, near_corners
        The element sizes without refinement, and the corners.
    error
        Permitted relative error of the force.
    n
        Number of elements across a narrow gap.
    """
    # Share of the allowed error of the force that the elements at corners may cost.
    corner_error = 0.1 * error
    if all(
        corner.size(corner_error, n) >= _size_at(default_sizes, corner) for corner in near_corners
    ):
        return None
    return min(corner.size(corner_error, n) for corner in near_corners)


def sizes_with_corners(default_sizes: Sizes, near_corners: list[Corner], h: float | None) -> Sizes:
    """Return sizes with elements of size h [length] at corners, and the error that remains.

    Without h there is no refinement.
    """
    sizes = default_sizes
    if h is not None:
        points = tuple(sorted({(corner.r, round_length(corner.depth)) for corner in near_corners}))
        h_corner = min(round_length(h), default_sizes.h_contact)
        sizes = replace(default_sizes, corners=points, h_corner=h_corner)
    errors = (corner.error(_size_at(sizes, corner)) for corner in near_corners)
    return replace(sizes, corner_error=max(errors, default=0.0))


def _size_at(sizes: Sizes, corner: Corner) -> float:
    """Return the element size at a corner [length]."""
    return float(sizes.size_at(np.array(corner.r), np.array(corner.depth)))


def refine_inclusions(
    default_sizes: Sizes, config: Config, setup: ProblemSetup, resolution: MeshResolution | None
) -> Sizes:
    """Return sizes with smaller elements in inclusions.

    Flat facets of size h inscribed in a round inclusion of radius R omit (h/R)^2/4 of its volume.
    """
    inclusions = [region.inclusion for region in setup.physics.domain.regions if region.inclusion]
    error = INCLUSION_ERROR_SHARE * (resolution.error if resolution else AUTO_ERROR)
    given_sizes = config.mesh.h_inclusions
    inclusion_sizes = [
        inclusion.min_half_width / _elements_in_inclusion(inclusion, setup, error)
        for inclusion in inclusions
    ]
    if given_sizes:
        inclusion_sizes = [h / setup.physics.scales.length for h in given_sizes]
    return replace(
        default_sizes,
        inclusions=tuple(zip(inclusions, map(round_length, inclusion_sizes), strict=True)),
    )


def refine_coatings(
    default_sizes: Sizes, config: Config, setup: ProblemSetup, resolution: MeshResolution | None
) -> Sizes:
    """Return sizes with smaller elements in the coatings of a cap or ball.

    If an accuracy is requested, the number of elements across a coating increases in proportion to
    the number of elements in the contact radius.
    """
    coatings = setup.physics.domain.coatings
    given_sizes = config.mesh.h_layers
    L = setup.physics.scales.length
    refinement_factor = max(1.0, (resolution.n if resolution else 0.0) / ELEMENTS_PER_RADIUS[2])
    if given_sizes:
        coating_sizes = [h / L for h in given_sizes]
    else:
        coating_sizes = [
            coating.thickness / (ELEMENTS_PER_COATING * refinement_factor) for coating in coatings
        ]
    return replace(
        default_sizes, coatings=tuple(zip(coatings, map(round_length, coating_sizes), strict=True))
    )


def refine_films(
    default_sizes: Sizes,
    setup: ProblemSetup,
    fixed_sizes: FixedSizes,
    resolution: MeshResolution | None,
) -> Sizes:
    """Return sizes with smaller elements at drained faces if the first increments need them.

    After a short time only a thin boundary layer has drained. In three dimensions this refinement
    would cost too much.
    """
    physics = setup.physics
    is_size_free = (
        resolution is not None or fixed_sizes.h_contact is None or fixed_sizes.h_film is not None
    )
    drains = (
        physics.permeable_regions
        and physics.domain.dim == 2
        and setup.history is not None
        and setup.max_depth > 0
    )
    if not (is_size_free and drains):
        return default_sizes
    # Share of the allowed error of the force that the boundary layers at drained faces may cost.
    film_error_share = 0.5
    max_fraction = film_error_share * resolution.error if resolution else AUTO_ERROR
    faces, h_film = _film_sizes(setup, default_sizes, fixed_sizes.h_film, max_fraction)
    return replace(default_sizes, drained_faces=faces, h_film=h_film if faces else None)


def _film_sizes(
    setup: ProblemSetup, default_sizes: Sizes, given_size: float | None, max_fraction: float
) -> tuple[tuple[DrainedFace, ...], float]:
    """Return the drained faces that need smaller elements, and the size at a face under the tip.

    Parameters
    ----------
    setup : ProblemSetup
        The problem setup, with a history.
    default_sizes : Sizes
        The element sizes without this refinement.
    given_size : float or None
        The element size at drained faces from the config [length]; None: chosen from
        `max_fraction`.
    max_fraction : float
        Allowed relative error of the force due to the boundary layers.
    """
    assert setup.history is not None
    physics = setup.physics
    a = setup.a
    D = boundary_films.smallest_diffusivity(setup.physics)
    path = problem_along_history(setup, physics, default_sizes.h_contact).path
    rows = path_rows(path)
    faces = boundary_films.drained_faces(setup, min(path.times) - (path.start_time or 0.0))
    h_film = given_size
    if h_film is None:
        fraction_per_length = boundary_films.force_fraction_per_length(setup)
        # Smallest element size at a drained face in contact radii: smaller ones change
        # the force by less than 1e-4.
        min_film_size = 1e-3
        h_film = round_length(
            boundary_films.film_element_size(
                rows, max_fraction, D, fraction_per_length, default_sizes.h_far, min_film_size * a
            )
        )
    films = []
    for side in physics.domain.outline:
        if side.surface not in faces:
            continue
        distance = faces[side.surface]
        h = h_film / boundary_films.distance_weight(setup, distance) ** 0.5
        nearest = 0.0
        if side.surface != "top":
            nearest = distance + (a if side.surface != "base" else 0.0)
        if h < default_sizes.h_far:
            fine_radius = round_length(nearest + default_sizes.fine_radius)
            films.append(DrainedFace(side, round_length(h), fine_radius))
    return tuple(films), h_film


def _elements_in_inclusion(inclusion: Inclusion, setup: ProblemSetup, error: float) -> float:
    """Return the number of elements in half an inclusion's thickness for an error of the force.

    The error is the fraction of the inclusion that flat facets omit, multiplied by the share of the
    inclusion in the strain energy below a point force.
    """
    physics = setup.physics
    dim = physics.domain.dim
    # Smallest and largest number of elements in half the thickness of an inclusion.
    min_elements, max_elements = {2: (2.0, 30.0), 3: (2.0, 6.0)}[dim]
    x, *y = physics.center
    d = max(float(inclusion.distance((x, y[0] if y else 0.0, 0.0))), inclusion.min_half_width)
    if physics.body.dim == 2:
        inclusion_weight = 8 * inclusion.half_width(0) * inclusion.half_width(2) / d**2
    else:
        inclusion_weight = 2 * inclusion.volume * setup.a / d**4
    elements = (min(inclusion_weight, MAX_INCLUSION_WEIGHT) / (4 * error)) ** 0.5
    elements *= 1.0 if inclusion.is_curved_where_thinnest(dim) else FLAT_INCLUSION_FACTOR
    cover_thickness = -inclusion.center[2] - inclusion.half_width(2)
    elements = max(elements, inclusion.min_half_width / cover_thickness, min_elements)
    elements = min(elements, max_elements)
    if not physics.domain.top_radius:
        return elements
    cover_elements = ELEMENTS_ABOVE_INCLUSION * (INCLUSION_ERROR_SHARE * AUTO_ERROR / error) ** 0.5
    return max(elements, cover_elements * inclusion.min_half_width / cover_thickness)
