"""The tension of the contact surface, and the pressure inside that balances it at rest."""

from __future__ import annotations

from functools import reduce
from operator import add

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.terms.term import Term
from indent_sim.model.hyperelasticity import NeoHookean

SURFACE_DEGREE = 6  # of the quadrature: squares of slopes, and at finite strain the root of them

# Of gamma, that holds the surface of a drop in its plane; it adds 0.45 times itself to the force.
# Measured on a ball between plates, 10 to 20 elements in the contact radius: without it no row is
# found below mu = 1.7e-3 gamma/R, with 3e-4 three of four are at 1e-3, with 1e-3 all of them, and
# three of four at 1e-4 (tests/physics/test_drops.py)
MEMBRANE_STIFFNESS = 1e-3


class SurfaceTension(Term):
    """gamma (A - A0) - (2 gamma/R)(V - V0), less its slope at rest; R the radius of a spherical
    top, a flat one has no pressure. A is the area of the whole contact surface, touched or not,
    V the body's volume.

    So rest is an equilibrium, also on facets that are no sphere: what is left of the slope there,
    and at a rim that nothing holds, is a load that the reference state bears. With H the
    displacement gradient, N the undeformed normal and P = 1 - N N, the area of a part grows by
    sqrt(1 + e), e = 2 tr PH + m, m = tr(P H^T H P) + det C of C = P (H + H^T + H^T H) P, and sqrt(1
    + e) - 1 - tr PH = m/2 - e^2/(2 (1 + sqrt(1 + e))^2) has no first order. At small strain it is
    the second order of that: gamma/2 |grad_s u_n|^2 on a flat surface.

    A tension does not hold the points of a surface in its plane, and of a drop, gamma/(mu R) >> 1,
    nothing else does: what a mesh makes of the curvature, which jumps at the edge of contact,
    pushes them along until elements fold. So a drop has a membrane of the shear modulus `firmness`
    gamma [force/length] on its surface, stress-free at rest, firmness gamma [(tr C_s - 2)/2 - ln
    J_s], C_s = P (1 + H)^T (1 + H) P, J_s its area ratio. On the way to an equilibrium it may be
    firmer, and the body with it by as much, over R: see `solve.algorithms.through_firmer_bodies`.
    """

    is_bulk = True
    has_membrane = False

    def __init__(self, body: Body):
        physics = body.scene.physics
        self.has_constant_tangent = physics.small_strain
        kinematics = physics.domain.kinematics
        H = kinematics.displacement_gradient(body.now.fields["u"], body.X)
        gamma = fem.Constant(body.mesh, physics.surface_tension)
        N = kinematics.space_vector(ufl.FacetNormal(body.mesh))
        P = ufl.Identity(3) - ufl.outer(N, N)
        area_growth = _linearized_area_growth(H, P) if physics.small_strain else _area_growth(H, P)
        self._membrane_stiffness = fem.Constant(body.mesh, MEMBRANE_STIFFNESS)
        self.has_membrane = physics.is_drop
        if self.has_membrane:
            area_growth += self._membrane_stiffness * _membrane_energy(H, P)
        self.energy = body.surface_integral("top", gamma * area_growth, SURFACE_DEGREE)
        if physics.domain.top_radius:
            pressure = 2 * gamma / fem.Constant(body.mesh, physics.domain.top_radius)
            volume_growth = (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2  # of J - 1 - tr H
            volume_growth = volume_growth if physics.small_strain else volume_growth + ufl.det(H)
            parts = (
                body.region_integral(pressure * volume_growth, region)
                for region in physics.domain.regions
            )
            self.energy = self.energy - reduce(add, parts)
        if self.has_membrane:
            shear_energy, _ = NeoHookean(E=3.0, nu=0.5).energy_parts(H)  # of mu = 1
            added_shear_energy = (
                (self._membrane_stiffness - fem.Constant(body.mesh, MEMBRANE_STIFFNESS))
                * pressure
                / 2
                * shear_energy
            )
            self.energy += reduce(
                add,
                (
                    body.region_integral(added_shear_energy, region)
                    for region in physics.domain.regions
                ),
            )

    def set_membrane_stiffness(self, stiffness: float) -> None:
        """Hold the surface of a drop by so much of gamma in its plane, and the body by as much,
        over R, more.
        """
        self._membrane_stiffness.value = stiffness


def _membrane_energy(H: Expr, P: Expr) -> Expr:
    """(tr C_s - 2)/2 - ln J_s of a surface."""
    C, e = _surface_strain(H, P)
    return ufl.tr(C) / 2 - ufl.ln(1 + e) / 2


def _surface_strain(H: Expr, P: Expr) -> tuple[Expr, Expr]:
    """C = C_s - P, and e = J_s^2 - 1."""
    stretched = P * H.T * H * P
    C = P * (H + H.T) * P + stretched
    return C, ufl.tr(C) + (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2


def _area_growth(H: Expr, P: Expr) -> Expr:
    """How much more an area grows than by tr PH, of itself."""
    stretched = P * H.T * H * P
    C = P * (H + H.T) * P + stretched
    m = ufl.tr(stretched) + (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    e = 2 * ufl.tr(P * H) + m
    return m / 2 - e**2 / (2 * (1 + ufl.sqrt(1 + e)) ** 2)


def _linearized_area_growth(H: Expr, P: Expr) -> Expr:
    """The same to second order in H: |N.HP|^2/2 + ((tr A)^2 - tr A^2)/2, A = PHP."""
    A = P * H * P
    tilt = H * P - A
    return (ufl.inner(tilt, tilt) + ufl.tr(A) ** 2 - ufl.tr(A * A)) / 2
