"""Expected error of the force due to element sizes, penalty and regularized friction.

Every function returns a relative error of the force that is known before the scene is solved.
"""

from __future__ import annotations

from math import pi

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import ContactLaw, Penalty
from indent_sim.model.materials import Material
from indent_sim.scene.measured_constants import EDGE_ERROR, INCOMPRESSIBLE_EDGE_FACTOR
from indent_sim.theory.theory import Theory

# d ln F/d ln delta of a paraboloid on a half-space.
FORCE_DEPTH_EXPONENT = 1.5
# Expected error of the force below which a scene gets no warning.
NEGLIGIBLE_ERROR = 0.005
# Smallest Poisson's ratio of a body that counts as nearly incompressible.
NEARLY_INCOMPRESSIBLE_NU = 0.45


def edge_error(sizes: Sizes) -> float:
    """Bound of the relative error of the force due to the elements at a punch's sharp edge.

    The bound is EDGE_ERROR * h_edge/radius multiplied by the relative sensitivity of the force to
    the radius; 0 without a sharp edge. The force is always too low, since elements that end at the
    edge represent a narrower punch.
    """
    if sizes.punch_edge is None or sizes.h_edge is None:
        return 0.0
    return EDGE_ERROR * sizes.edge_refinement_factor * sizes.h_edge / sizes.punch_edge


def expected_force_error(sizes: Sizes, a: float, nu: float) -> float:
    """Expected relative error of the force due to the elements in the contact radius or at an edge.

    On a layer (axisymmetric, all contact methods) the measured errors were at most 0.3, 0.9, 2.3,
    2.4, 5.5, 15, 20 and 117 % with n = 3, 2, 1.5, 1, 0.7, 0.5, 0.3 and 0.1 elements in the contact
    radius; the formula is 7/n^2 %. Under a punch with a sharp edge it is `edge_error`, which is
    larger for nearly incompressible bodies.

    Parameters
    ----------
    sizes : Sizes
        The element sizes.
    a : float
        Expected contact radius [length].
    nu : float
        Largest Poisson's ratio of the body.

    Returns
    -------
    float
        The error; 0 if the contact is resolved.
    """
    if sizes.punch_edge is not None and sizes.h_edge is not None:
        factor = 1.0 if nu < NEARLY_INCOMPRESSIBLE_NU else INCOMPRESSIBLE_EDGE_FACTOR
        return factor * edge_error(sizes)
    return 0.0 if sizes.is_resolved(a) else 0.07 / sizes.elements_in_contact(a) ** 2


def swelling_force_error(sizes: Sizes, a: float) -> float:
    """Expected relative error of the force on a tip that gets into contact by swelling of a gel.

    `a` is the contact radius [length]. The error is caused by the elements at the contact edge. The
    error was measured on a gel with chi = 0.6 under a ball whose radius is the gel's thickness, on
    three meshes and at six instants, against a mesh whose elements at the axis were six times
    smaller. It was at most 51, 36, 8, 5 and 1 % with n = 2.3, 2.9, 3.7, 4.5 and 6.5 elements in the
    contact radius, which is 2.7/n^3 to 8.6/n^3. The function returns 9/n^3, or 0 under a punch with
    a sharp edge. `tests/physics/test_gel_scenes.py` repeats the measurement on one of the meshes.
    """
    return 0.0 if sizes.punch_edge is not None else 9.0 / sizes.elements_in_contact(a) ** 3


def penalty_force_loss(
    contact: ContactLaw, material: Material, theory: Theory | None, delta: float, a: float
) -> float:
    """Largest share of the force that the penetration of a penalty method can cost at a depth.

    The penetration reduces the depth to s, with s + c * p(s)/epsilon_n = delta and the mean
    pressure p; the lost share is 1 - F(s)/F(delta). F and p are those of the reference theory, or
    of a paraboloid on a half-space if there is none. The factor c is the integral of (local
    pressure) * d(local pressure)/dF over the contact area, divided by p: 0.69 for a cone and 0.75
    for a paraboloid on a half-space; for a paraboloid on a thin layer it is 1 if the layer is
    compressible and 1.5 if not.

    Parameters
    ----------
    contact : ContactLaw
        The contact law.
    material : Material
        The material under the tip.
    theory : Theory or None
        The reference theory.
    delta : float
        The depth [length].
    a : float
        Expected contact radius at that depth [length].

    Returns
    -------
    float
        The share; 0 for other contact laws and without contact.
    """
    if not isinstance(contact, Penalty) or delta <= 0:
        return 0.0
    # Largest reduction of the depth by a penalty, in units of mean pressure/epsilon_n.
    max_penetration_factor = 1.5
    # This penetration grows as a power of 1/(1 - delta/height) at finite strain, with this
    # exponent.
    penetration_exponent = 1.5
    penetration = (
        max_penetration_factor
        * (1.0 if material.is_small_strain else (1.0 - delta) ** -penetration_exponent)
        / contact.stiffness
    )
    force, pressure = _forces_and_pressures(theory, material, delta, a, np.ones(1))
    # Largest d ln F/d ln delta: that of a paraboloid on a thin incompressible layer.
    max_force_exponent = 3.0
    force_loss = max_force_exponent * penetration * float(pressure[0]) / delta
    if force_loss < NEGLIGIBLE_ERROR:
        # The upper bound is sufficient here, since theory would take long at many depths.
        return force_loss
    depth_fractions = np.array([1e-6, 1e-3, 0.03, 0.2, 0.5, 0.8, 0.95, 1.0])
    force, pressure = _forces_and_pressures(theory, material, delta, a, depth_fractions)
    remaining_force = np.interp(
        np.log(delta), np.log(depth_fractions * delta + penetration * pressure), np.log(force)
    )
    return float(1 - np.exp(remaining_force) / force[-1])


def _forces_and_pressures(
    theory: Theory | None, material: Material, delta: float, a: float, depth_fractions: np.ndarray
) -> np.ndarray:
    """Return forces (any unit) and mean pressures at fractions of a depth, by theory or Hertz."""
    curve = (
        theory.solutions_at_depths([float(depth) for depth in depth_fractions * delta])
        if theory
        else None
    )
    if curve:
        force = np.array([solution.force for solution in curve])
        return np.array([force, force / [solution.area for solution in curve]])
    E, nu = material.constants
    # Pressure of a body in contact from wall to wall, by its oedometric modulus.
    confined = E * (1 - nu) / ((1 + nu) * max(1 - 2 * nu, 1e-4)) * depth_fractions
    hertz = 4 / (3 * pi) * material.E_star / a * np.sqrt(depth_fractions)
    return np.array([depth_fractions**1.5, delta * np.maximum(hertz, confined)])


def penalty_friction_loss(stiffness: float) -> float:
    """Share of the effect of friction on the force that is lost by a tangential penalty.

    `stiffness` is epsilon_t a/E*. The share was measured on a layer with nu = 0 and 0.3, with 5 and
    10 elements in the contact radius a and in 1, 4 and 16 steps: 0.79-0.88, 0.30-0.49 and 0.06-0.14
    at stiffnesses of 0.5, 5 and 50.
    """
    return float(1 / (1 + (stiffness / 4) ** 0.8))


def stick_force_change(multiple: float, elements: float) -> float:
    """Relative change of the effect of stick on the force if epsilon_t = `multiple` * E*/h_contact.

    The change is relative to the effect with `multiple` = 1. The change was measured for multiples
    from 0.01 to 1000 on thick bodies with nu = 0 and 0.3 and on thin layers with nu = 0.49 and 0.5:
    0.05-0.06 per decade with 4 to 5 elements in the contact radius, 0.02-0.045 with 8 to 10.
    """
    return float(0.35 / elements * np.log10(multiple))


def error_text(error: float) -> str:
    """Return a relative error of the force as text."""
    if error >= 1:
        return "more than its own size"
    return "tens of per cent" if error >= 0.2 else f"about {float(f'{100 * error:.1g}'):g} %"
