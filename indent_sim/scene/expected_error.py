"""Expected error of the force by the elements, the penalty and the regularized friction."""

from __future__ import annotations

from math import pi

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import ContactLaw, Penalty
from indent_sim.model.materials import Material
from indent_sim.theory.theory import Theory

FORCE_DEPTH_EXPONENT = 1.5  # per cent of force for a per cent of depth, of a paraboloid

NEGLIGIBLE_ERROR = 0.005  # of the force: a smaller error is not worth a warning

NEARLY_INCOMPRESSIBLE_NU = 0.45  # Poisson ratio from which a body is said to hardly compress

# What elements at a punch's sharp edge cost the force at most, over their size per radius: measured
# 0.09 to 0.22 on 25 quarter cylinders (see scripts/make_error_bar_table), and 0.65 on sections from
# that Poisson ratio on
EDGE_ERROR = 0.25

INCOMPRESSIBLE_EDGE_FACTOR = 2.6

MAX_PENETRATION_FACTOR = (
    1.5  # mean pressures over epsilon_n that a penalty takes from the depth, at most
)

# Power of the share of the thickness that is left: how a penalty sinks further at finite strain,
# measured
PENETRATION_EXPONENT = 1.5

MAX_FORCE_EXPONENT = 3.0  # d ln F/d ln delta at most: a paraboloid on a thin incompressible layer


def edge_error(sizes: Sizes) -> float:
    """The relative error of the force by the elements at a punch's sharp edge, at most; 0 where
    there is none.

    EDGE h_edge/radius, times how keenly the force feels the radius. The force is always too low:
    elements that end at the edge stand for a punch that is narrower.
    """
    if sizes.punch_edge is None or sizes.h_edge is None:
        return 0.0
    return EDGE_ERROR * sizes.edge_refinement_factor * sizes.h_edge / sizes.punch_edge


def expected_force_error(sizes: Sizes, a: float, nu: float) -> float:
    """The relative error of the force to fear on this mesh with the expected contact radius a; 0
    for none.

    Measured on a layer (axisymmetric, all methods): at most 0.3, 0.9, 2.3, 2.4, 5.5, 15, 20 and 117
    % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements: below 7/n^2 %. A punch's sharp edge:
    below a quarter of the size of its elements over its radius (axisymmetric and in three
    dimensions), 0.65 of it where the body hardly compresses; times `keenness`.
    """
    if sizes.punch_edge is not None and sizes.h_edge is not None:
        return (1.0 if nu < NEARLY_INCOMPRESSIBLE_NU else INCOMPRESSIBLE_EDGE_FACTOR) * edge_error(
            sizes
        )
    return 0.0 if sizes.is_resolved(a) else 0.07 / sizes.elements_in_contact(a) ** 2


def swelling_force_error(sizes: Sizes, a: float) -> float:
    """The same of a contact that a gel closes as it swells, whose force is that of the last
    elements that it closed.

    Measured on a gel of chi 0.6 under a ball of one height, on three meshes at six times, against
    elements a sixth as long at the axis: at most 51, 36, 8, 5 and 1 % with n = 2.3, 2.9, 3.7, 4.5
    and 6.5 elements in the contact radius, which is 2.7/n^3 to 8.6/n^3.
    `tests/physics/test_gel_scenes.py` measures one of the meshes again.
    """
    return 0.0 if sizes.punch_edge is not None else 9.0 / sizes.elements_in_contact(a) ** 3


def penalty_force_loss(
    contact: ContactLaw, material: Material, theory: Theory | None, delta: float, a: float
) -> float:
    """The share of the force, at most, that a penalty costs at a depth; 0 for the other methods.

    The body feels only the depth s that the penetration leaves: s + c p(s)/epsilon_n = delta with
    the mean pressure p, and 1 - F(s)/F(delta) is lost; by theory, or as on a half-space under a
    paraboloid where there is none. c, the integral of p dp/dF over p, is 0.69 for a cone and 0.75
    for a paraboloid on a half-space, and for a paraboloid on a thin layer 1 when it is compressible
    and 1.5 when not.
    """
    if not isinstance(contact, Penalty) or delta <= 0:
        return 0.0
    penetration = (
        MAX_PENETRATION_FACTOR
        * (1.0 if material.is_small_strain else (1.0 - delta) ** -PENETRATION_EXPONENT)
        / contact.stiffness
    )
    force, pressure = _forces_and_pressures(theory, material, delta, a, np.ones(1))
    if (
        force_loss := MAX_FORCE_EXPONENT * penetration * float(pressure[0]) / delta
    ) < NEGLIGIBLE_ERROR:
        return force_loss  # a theory of many depths takes its time
    depth_fractions = np.array([1e-6, 1e-3, 0.03, 0.2, 0.5, 0.8, 0.95, 1.0])
    force, pressure = _forces_and_pressures(theory, material, delta, a, depth_fractions)
    remaining_force = np.interp(
        np.log(delta), np.log(depth_fractions * delta + penetration * pressure), np.log(force)
    )
    return float(1 - np.exp(remaining_force) / force[-1])


def _forces_and_pressures(
    theory: Theory | None, material: Material, delta: float, a: float, depth_fractions: np.ndarray
) -> np.ndarray:
    """Force (in any unit) and mean pressure at parts s of a depth."""
    curve = (
        theory.solutions_at_depths([float(depth) for depth in depth_fractions * delta])
        if theory
        else None
    )
    if curve:
        force = np.array([solution.force for solution in curve])
        return np.array([force, force / [solution.area for solution in curve]])
    E, nu = material.constants
    confined = (
        E * (1 - nu) / ((1 + nu) * max(1 - 2 * nu, 1e-4)) * depth_fractions
    )  # of a body in contact from wall to wall
    hertz = 4 / (3 * pi) * material.E_star / a * np.sqrt(depth_fractions)
    return np.array([depth_fractions**1.5, delta * np.maximum(hertz, confined)])


def penalty_friction_loss(stiffness: float) -> float:
    """The share of what friction adds that a penalty loses; stiffness: epsilon_t a/E*.

    Measured on a layer, nu 0 and 0.3, 5 and 10 elements in a, 1, 4 and 16 steps: 0.79-0.88,
    0.30-0.49 and 0.06-0.14 at 0.5, 5 and 50.
    """
    return float(1 / (1 + (stiffness / 4) ** 0.8))


def stick_force_change(multiple: float, elements: float) -> float:
    """The share of itself that is added to what stick adds by an epsilon_t of `multiple`
    E*/h_contact.

    Measured at 0.01 to 1000 on thick bodies of nu 0 and 0.3 and thin layers of nu 0.49 and 0.5:
    0.05-0.06 a decade with 4 to 5 elements in the contact radius, 0.02-0.045 with 8 to 10.
    """
    return float(0.35 / elements * np.log10(multiple))


def error_text(error: float) -> str:
    """A relative error of the force in words."""
    if error >= 1:
        return "more than its own size"
    return "tens of per cent" if error >= 0.2 else f"about {100 * error:.1g} %"
