"""Mesh resolution for a requested accuracy, its scaling, and the error to expect.

One number determines the discretisation: the number n of elements in the contact radius of every
step. All element sizes follow from it so that no part of the mesh dominates the error. Inside the
largest contact the element sizes are proportional to the distance from the axis, because the edges
of smaller contacts lie there. The far size falls as 1/n, the grading outside the contact as
n^-GRADING_EXPONENT, and the size at a punch's edge as n^-ORDER_OF_CONVERGENCE. The error of the
force then falls as n^-ORDER_OF_CONVERGENCE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from indent_sim.mesh.sizes import Sizes
from indent_sim.scene.corner_singularities import SINGULARITY_RATE
from indent_sim.scene.measured_constants import (
    COLUMN_GRADING_ERROR,
    EDGE_SIZE_FACTOR,
    ERROR_CONSTANT,
    ORDER_OF_CONVERGENCE,
)

PRESETS = {"fast": 0.05, "balanced": 0.01, "accurate": 0.001}
# Growth of the element size per unit distance without a requested accuracy.
GRADING = 0.2
MAX_ELEMENTS = 1000.0
# The relative error of the strain energy on graded elements is proportional to grading^4.
GRADING_EXPONENT = ORDER_OF_CONVERGENCE / 4
MAX_GRADING = 0.5


@dataclass(frozen=True)
class FixedSizes:
    """Element sizes [length] and grading that are given by the config or an accuracy.

    A size that is None is chosen by the program.
    """

    h_contact: float | None = None
    h_axis: float | None = None
    h_edge: float | None = None
    h_corner: float | None = None
    h_film: float | None = None
    h_far: float | None = None
    grading: float | None = None


@dataclass(frozen=True)
class MeshResolution:
    """Number of elements in the contact radius for a requested relative error of the force.

    Attributes
    ----------
    target : float
        The requested relative error.
    n : float
        Number of elements in every contact radius from `smallest_radius` to `largest_radius`.
    smallest_radius, largest_radius : float
        Contact radii of the steps [length].
    penalty_error_coefficient : float
        Relative error of the force caused by a penalty at the worst step, multiplied by the penalty
        stiffness epsilon_n [pressure/length].
    dim : int
        Dimension of the mesh.
    stiffness_given : bool
        True if the config gives the penalty stiffness; the mesh cannot reduce the error of a given
        stiffness.
    refinements : int
        Number of uniform refinements of an imported mesh.
    is_draining_column : bool
        True if fluid flows in a body whose top is covered by the tip.
    """

    target: float
    n: float
    smallest_radius: float
    largest_radius: float
    penalty_error_coefficient: float
    dim: int
    stiffness_given: bool = False
    refinements: int = 0
    is_draining_column: bool = False

    @property
    def error(self) -> float:
        """Expected relative error of the force due to the mesh."""
        return float(ERROR_CONSTANT[self.dim] * self.n**-ORDER_OF_CONVERGENCE)

    @property
    def penalty_stiffness(self) -> float:
        """Penalty stiffness epsilon_n [pressure/length] with the permitted error of the penalty."""
        # Share of the permitted error that the penalty may cause if the program chooses its
        # stiffness.
        enforcement_error_share = 0.2
        return self.penalty_error_coefficient / (
            enforcement_error_share * min(self.error, self.target)
        )

    def why(self, length: float) -> str:
        """Return the reason for the resolution as text; `length` is the user's unit of length."""
        radii = " to ".join(
            f"{radius * length:.3g}"
            for radius in sorted({self.smallest_radius, self.largest_radius})
        )
        elements_text = (
            f"{self.n:.3g} elements in the contact radius of every step ({radii}), from the "
            "measured relation of elements and error"
        )
        return (
            f"{elements_text}; the mesh is refined until the estimated error is within the accuracy"
        )

    def sizes(
        self,
        height: float,
        width: float,
        edge: float | None,
        curvature_radius: float | None,
        edge_refinement: float,
    ) -> FixedSizes:
        """Return the element sizes for a body.

        Parameters
        ----------
        height, width : float
            Height and largest width of the body [length].
        edge : float or None
            Radius of a punch's sharp edge [length].
        curvature_radius : float or None
            Radius of a curved wall or top [length].
        edge_refinement : float
            Sensitivity of the force to the radius of the punch, see `Sizes.edge_refinement_factor`.

        Returns
        -------
        FixedSizes
            The element sizes; the sizes at corners and in boundary layers are None.
        """
        n = self.n
        # Largest element size at the contact in thicknesses of the layer divided by n.
        thin_layer_factor = 4.0
        h_contact = min(self.largest_radius / n, height * min(1.0, thin_layer_factor / n))
        h_axis = h_edge = None
        if edge is None:
            h_axis = min(self.smallest_radius / n, h_contact)
        else:
            h_edge = min(
                edge * EDGE_SIZE_FACTOR[self.dim] * n**-ORDER_OF_CONVERGENCE / edge_refinement,
                h_contact,
            )
        # h_far n divided by the larger of height and width.
        far_size_factor = {2: 2.0, 3: 1.25}
        h_far = max(
            h_contact,
            min(
                far_size_factor[self.dim] / n * max(height, width),
                (curvature_radius or float("inf")) / n,
            ),
        )
        # Grading times n^GRADING_EXPONENT.
        grading_factor = {2: 1.0, 3: 0.6}
        grading = min(MAX_GRADING, grading_factor[self.dim] * n**-GRADING_EXPONENT)
        if self.is_draining_column:
            # Share of the expected error that the grading of a draining column may cost.
            grading_error_share = 0.5
            grading = min(grading, (grading_error_share * self.error / COLUMN_GRADING_ERROR) ** 0.5)
        return FixedSizes(
            h_contact=h_contact, h_axis=h_axis, h_edge=h_edge, h_far=h_far, grading=grading
        )


def target_error(accuracy: float | str | None) -> float | None:
    """Return the relative error of a requested accuracy, which can also be the name of a preset."""
    return PRESETS[accuracy] if isinstance(accuracy, str) else accuracy


def error_decay(n: float) -> float:
    """Return the error with n elements in the contact radius, up to a constant factor."""
    # With fewer elements in the contact radius the error no longer falls as
    # n^-ORDER_OF_CONVERGENCE.
    saturation_elements = 2.0
    return float((n**4 + saturation_elements**4) ** (-ORDER_OF_CONVERGENCE / 4))


def required_elements(
    target: float, dim: int, is_confined: bool = False, anisotropy: float = 1.0
) -> float:
    """Return the number of elements in the contact radius of every step for a requested error.

    Parameters
    ----------
    target : float
        The relative error of the force.
    dim : int
        Dimension of the mesh.
    is_confined : bool
        True if the contact is at least as wide as the thickness of a nearly incompressible layer.
    anisotropy : float
        Factor of an anisotropic body (`anisotropy_factor`).
    """
    # Factor of the elements in the contact radius on a confined layer that is nearly
    # incompressible, whose force scatters more from mesh to mesh.
    confined_layer_factor = 1.6
    factor = confined_layer_factor if is_confined else 1.0
    elements = factor * (ERROR_CONSTANT[dim] / target) ** (1 / ORDER_OF_CONVERGENCE)
    # Smallest number of elements in the contact radius; much coarser meshes are useless.
    min_elements = {2: 5.0, 3: 4.6}
    return min(anisotropy * max(elements, min_elements[dim]), MAX_ELEMENTS)


def anisotropy_factor(decay: tuple[float, float]) -> float:
    """Return the factor by which an anisotropic body needs more elements in the contact radius.

    A surface pressure of one wavenumber causes a displacement that decays with the depth. `decay`
    holds the slowest and the fastest rate of this decay, relative to an isotropic body. The error
    is about proportional to the fastest rate, or to 1/(slowest rate) if this is larger.
    """
    slow, fast = decay
    return float(max(1 / slow, fast, 1.0) ** (1 / ORDER_OF_CONVERGENCE))


def resolution_from_contacts(
    target: float, n: float, contacts: Sequence[tuple[float, float, float]], dim: int
) -> MeshResolution:
    """Return the mesh resolution with n elements in the contact radius.

    Parameters
    ----------
    target : float
        Relative error of the force.
    n : float
        Elements in the contact radius.
    contacts : sequence of (float, float, float)
        Depth [length], expected contact radius [length] and mean pressure [pressure] of the
        shallowest and the deepest step in contact.
    dim : int
        Dimension of the mesh.
    """
    largest_radius = max(a for _, a, _ in contacts)
    # Smallest contact radius with n elements, relative to the largest one.
    min_resolved_radius = {2: 0.01, 3: 0.2}
    smallest_radius = max(min(a for _, a, _ in contacts), min_resolved_radius[dim] * largest_radius)
    # d ln F/d ln delta of a paraboloid: a penalty takes the mean pressure/epsilon_n from the
    # depth.
    penalty_error_factor = 1.5
    coefficient = max(penalty_error_factor * pressure / delta for delta, _, pressure in contacts)
    return MeshResolution(target, n, smallest_radius, largest_radius, coefficient, dim)


def coarsened_sizes(sizes: Sizes, ratio: float, height: float, *, is_column: bool = False) -> Sizes:
    """Return the element sizes of a mesh that is coarser by a ratio > 1, or finer by a ratio < 1.

    Each size changes by a power of the ratio, so that all parts of the error change by the same
    factor.

    Parameters
    ----------
    sizes : Sizes
        The element sizes of a mesh.
    ratio : float
        New element size at the contact divided by the present one.
    height : float
        Height of the body [length]; no element is larger.
    is_column : bool
        True if fluid flows in a body whose top is covered by the tip.
    """
    # The error of a draining column is proportional to grading^2.
    column_grading_exponent = ORDER_OF_CONVERGENCE / 2
    grading_exponent = column_grading_exponent if is_column else GRADING_EXPONENT
    h_contact = min(ratio * sizes.h_contact, height)
    coatings = tuple(
        (coating, min(ratio * h, max(coating.thickness, h))) for coating, h in sizes.coatings
    )
    # Exponent of the element size at a drained face in the error by its boundary layer, once that
    # is resolved.
    film_error_order = 2.0
    films = tuple(
        replace(film, h=min(ratio ** (ORDER_OF_CONVERGENCE / film_error_order) * film.h, h_contact))
        for film in sizes.drained_faces
    )
    inclusions = [
        (inclusion, min(ratio ** (ORDER_OF_CONVERGENCE / 2) * h, inclusion.min_half_width))
        for inclusion, h in sizes.inclusions
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
        and min(ratio ** (ORDER_OF_CONVERGENCE / film_error_order) * sizes.h_film, h_contact),
        inclusions=tuple(inclusions),
        coatings=coatings,
        base_contact=sizes.base_contact
        and replace(sizes.base_contact, h=min(ratio * sizes.base_contact.h, height)),
    )


def refined_sizes(sizes: Sizes, refinements: int) -> Sizes:
    """Return the element sizes of an imported mesh after a number of uniform refinements."""
    ratio = 2.0 ** ((sizes.refinements or 0) - refinements)
    return replace(
        sizes,
        h_contact=ratio * sizes.h_contact,
        h_far=ratio * sizes.h_far,
        h_edge=sizes.h_edge and ratio * sizes.h_edge,
        fine_radius=sizes.fine_radius + 2 * (ratio - 1) * sizes.h_contact,
        refinements=refinements,
    )
