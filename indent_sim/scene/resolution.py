"""Element sizes from the accuracy asked for, how they scale, and the error to expect of them.

One number rules the discretisation: the elements n in the contact radius of every step. All else
follows it, so that no part dominates the error: sizes grow with the distance from the axis as the
contact edge passes there, the far size falls as 1/n, their growth outside the contact as n^-EASING,
and towards a punch's edge the elements shrink as n^-RATE. The force then converges as n^-RATE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.corner_singularities import SINGULARITY_RATE

PRESETS = {"fast": 0.05, "balanced": 0.01, "accurate": 0.001}
# The error bar of the force is about CONSTANT n^-RATE at the worst step (by dim), as
# `python -m pytest -m verify tests/physics/test_accuracy.py -s` prints it for every scene
ERROR_CONSTANT = {2: 0.65, 3: 0.33}
ORDER_OF_CONVERGENCE = 2.5
SATURATION_ELEMENTS = 2.0  # with fewer elements than this the error grows no more as n^-RATE
MIN_ELEMENTS = {
    2: 5.0,
    3: 4.6,
}  # elements in the contact radius, by dim: meshes much coarser say nothing
MAX_ELEMENTS = 1000.0
GRADING_FACTOR = {2: 1.0, 3: 0.6}  # grading times n^EASING, by dim
GRADING_EXPONENT = ORDER_OF_CONVERGENCE / 4  # growth^4 is its error of the energy
# In a column that drains no contact lets the pressure of the fluid fade with the depth. That
# pressure is linear in an element, so that grading costs COLUMN_GROWTH grading^2 of the force, of
# which an accuracy allows GROWTH_SHARE of its target. Measured on "Biot, confined ramp" of
# configs/studies/verification/published.yaml (height 1, radius 0.1, at t = 0.1 height^2/D): 7.4e-4
# with a grading of 0.2 and 4.2e-4 with 0.167, 1.2e-5 with elements of 0.01 everywhere
COLUMN_GRADING_EXPONENT = ORDER_OF_CONVERGENCE / 2
COLUMN_GRADING_ERROR = 0.02
GRADING_ERROR_SHARE = 0.5
MAX_GRADING = 0.5
FAR_SIZE_FACTOR = {2: 2.0, 3: 1.25}  # h_far n over the larger of height and width, by dim
# times as many elements where a layer that hardly compresses is squeezed: its force scatters more
CONFINED_LAYER_FACTOR = 1.6
THIN_LAYER_FACTOR = 4.0  # at most this many thicknesses over n
# h_edge n^RATE over the punch's radius, by dim; in three dimensions so that the edge alone
# (`doubts.EDGE` of it) costs no more than CONSTANT n^-RATE: with 3.0 the first mesh missed its
# target, and the second took longer than this one
EDGE_SIZE_FACTOR = {2: 0.3, 3: 1.2}
MIN_RESOLVED_RADIUS = {
    2: 0.01,
    3: 0.2,
}  # contact radius that still gets n elements, of the largest one, by dim
# of the size at a drained face, with which what its film costs falls once the film is resolved
FILM_ERROR_ORDER = 2.0
# per cent of force for a per cent of depth that a penalty of mean pressure / epsilon_n takes
PENALTY_ERROR_FACTOR = 1.5
ENFORCEMENT_ERROR_SHARE = (
    0.2  # share of the error that a penalty may take where its stiffness is left to the program
)


@dataclass(frozen=True)
class FixedSizes:
    """Sizes [length] and grading that the config or an accuracy settles; None: left to `sizing`."""

    h_contact: float | None = None
    h_axis: float | None = None
    h_edge: float | None = None
    h_corner: float | None = None
    h_film: float | None = None
    h_far: float | None = None
    grading: float | None = None


@dataclass(frozen=True)
class MeshResolution:
    """Elements n in every contact radius from `smallest` to `largest` [length], chosen for a
    relative target.

    compliance [pressure/length]: a penalty's relative error is compliance / epsilon_n at the worst
    step.
    """

    target: float
    n: float
    smallest_radius: float
    largest_radius: float
    penalty_error_coefficient: float
    dim: int
    stiffness_given: bool = (
        False  # the user's penalty stiffness, whose error no mesh can make smaller
    )
    refinements: int = 0  # of a mesh from a file, which knows no sizes between
    is_draining_column: bool = False  # whether fluid flows in a body whose top the tip covers

    @property
    def error(self) -> float:
        """The relative error bar to expect of the mesh."""
        return float(ERROR_CONSTANT[self.dim] * self.n**-ORDER_OF_CONVERGENCE)

    @property
    def penalty_stiffness(self) -> float:
        """The epsilon_n [pressure/length] of a penalty that takes its share of the error."""
        return self.penalty_error_coefficient / (
            ENFORCEMENT_ERROR_SHARE * min(self.error, self.target)
        )

    def why(self, length: float) -> str:
        """The reason in words; `length`: the scene's unit in the user's."""
        radii = " to ".join(
            f"{radius * length:.3g}"
            for radius in sorted({self.smallest_radius, self.largest_radius})
        )
        elements_text = (
            f"{self.n:.3g} elements in the contact radius of every step ({radii}), by the "
            "measured trade"
        )
        return f"{elements_text}; the error is estimated, and the mesh refined until it is met"

    def sizes(
        self,
        height: float,
        width: float,
        edge: float | None,
        round_radius: float | None,
        edge_refinement: float,
    ) -> FixedSizes:
        """The sizes for a body of this height and width [length] with an edge, or a curved wall, of
        that radius.
        """
        n = self.n
        h_contact = min(self.largest_radius / n, height * min(1.0, THIN_LAYER_FACTOR / n))
        h_axis = min(self.smallest_radius / n, h_contact) if edge is None else None
        h_edge = (
            min(
                edge * EDGE_SIZE_FACTOR[self.dim] * n**-ORDER_OF_CONVERGENCE / edge_refinement,
                h_contact,
            )
            if edge is not None
            else None
        )
        h_far = max(
            h_contact,
            min(
                FAR_SIZE_FACTOR[self.dim] / n * max(height, width),
                (round_radius or float("inf")) / n,
            ),
        )
        grading = min(MAX_GRADING, GRADING_FACTOR[self.dim] * n**-GRADING_EXPONENT)
        if self.is_draining_column:
            grading = min(grading, (GRADING_ERROR_SHARE * self.error / COLUMN_GRADING_ERROR) ** 0.5)
        return FixedSizes(
            h_contact=h_contact, h_axis=h_axis, h_edge=h_edge, h_far=h_far, grading=grading
        )


def target_error(accuracy: float | str | None) -> float | None:
    """The relative error that a preset stands for."""
    return PRESETS[accuracy] if isinstance(accuracy, str) else accuracy


def error_decay(n: float) -> float:
    """How the error falls with the elements in the contact radius, up to a factor that is the
    scene's own.
    """
    return float((n**4 + SATURATION_ELEMENTS**4) ** (-ORDER_OF_CONVERGENCE / 4))


def required_elements(
    target: float, dim: int, is_confined: bool = False, anisotropy: float = 1.0
) -> float:
    """Elements in the contact radius of every step whose error bar is expected within the target.
    is_confined: a contact as wide as a layer that hardly compresses is thick, or wider. steeper:
    see `steepness`.
    """
    default_elements = (CONFINED_LAYER_FACTOR if is_confined else 1.0) * (
        ERROR_CONSTANT[dim] / target
    ) ** (1 / ORDER_OF_CONVERGENCE)
    return min(anisotropy * max(default_elements, MIN_ELEMENTS[dim]), MAX_ELEMENTS)


def anisotropy_factor(decay: tuple[float, float]) -> float:
    """Times as many elements where the waves of a surface pressure fade so much more slowly or
    faster with the depth than in an isotropic body: the error is about as many times as large.
    """
    slow, fast = decay
    return float(max(1 / slow, fast, 1.0) ** (1 / ORDER_OF_CONVERGENCE))


def resolution_from_contacts(
    target: float, n: float, contacts: Sequence[tuple[float, float, float]], dim: int
) -> MeshResolution:
    """The fineness for a relative target with n elements in the radius. contacts: (depth, expected
    contact radius, mean pressure) of the shallowest and the deepest step in contact.
    """
    largest = max(a for _, a, _ in contacts)
    smallest = max(min(a for _, a, _ in contacts), MIN_RESOLVED_RADIUS[dim] * largest)
    compliance = max(PENALTY_ERROR_FACTOR * pressure / delta for delta, _, pressure in contacts)
    return MeshResolution(target, n, smallest, largest, compliance, dim)


def coarsened_sizes(sizes: Sizes, ratio: float, height: float, *, is_column: bool = False) -> Sizes:
    """Return element sizes that are larger by a ratio, near and far alike, or smaller below 1.

    Each size changes by the power of the ratio with which all errors fall alike.

    Parameters
    ----------
    sizes
        The element sizes of a mesh.
    ratio
        Of the size in the contact to that of `sizes`.
    height
        Of the body [length]; no element is larger.
    is_column
        Whether fluid flows in a body whose top the tip covers.
    """
    grading_exponent = COLUMN_GRADING_EXPONENT if is_column else GRADING_EXPONENT
    h_contact = min(ratio * sizes.h_contact, height)
    coatings = tuple(
        (feature, min(ratio * h, max(feature.thickness, h))) for feature, h in sizes.coatings
    )
    films = tuple(
        replace(film, h=min(ratio ** (ORDER_OF_CONVERGENCE / FILM_ERROR_ORDER) * film.h, h_contact))
        for film in sizes.drained_faces
    )
    inclusions = [
        (feature, min(ratio ** (ORDER_OF_CONVERGENCE / 2) * h, feature.min_half_width))
        for feature, h in sizes.inclusions
    ]
    return replace(
        sizes,
        h_contact=h_contact,
        h_far=max(ratio * sizes.h_far, h_contact),
        grading=min(ratio**grading_exponent * sizes.grading, MAX_GRADING),
        fine_radius=sizes.fine_radius + 2 * (h_contact - sizes.h_contact),
        h_edge=sizes.h_edge and min(ratio**ORDER_OF_CONVERGENCE * sizes.h_edge, h_contact),
        h_axis=sizes.h_axis and min(ratio * sizes.h_axis, h_contact),
        h_corner=sizes.h_corner
        and min(ratio ** (ORDER_OF_CONVERGENCE / SINGULARITY_RATE) * sizes.h_corner, h_contact),
        drained_faces=films,
        h_film=sizes.h_film
        and min(ratio ** (ORDER_OF_CONVERGENCE / FILM_ERROR_ORDER) * sizes.h_film, h_contact),
        inclusions=tuple(inclusions),
        coatings=coatings,
    )


def refined_sizes(sizes: Sizes, refinements: int) -> Sizes:
    """The sizes of the same mesh from a file, refined that often."""
    ratio = 2.0 ** ((sizes.refinements or 0) - refinements)
    h = ratio * sizes.h_contact
    edge = sizes.h_edge
    patch = sizes.fine_radius + 2 * (ratio - 1) * sizes.h_contact
    h_edge = edge and ratio * edge
    return replace(
        sizes,
        h_contact=h,
        h_far=ratio * sizes.h_far,
        h_edge=h_edge,
        fine_radius=patch,
        refinements=refinements,
    )
