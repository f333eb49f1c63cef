"""Surface tension of the top surface and the internal pressure that balances it."""

from __future__ import annotations

from functools import reduce
from operator import add

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.measured_constants import MEMBRANE_STIFFNESS
from indent_sim.fe.terms.term import Term
from indent_sim.model.hyperelasticity import NeoHookean


class SurfaceTension(Term):
    """Surface energy gamma (A - A0) - (2 gamma/R)(V - V0), minus its first variation at rest.

    A is the area of the whole top surface, in contact or not, V the volume of the body and R the
    radius of a spherical top; a flat top has no internal pressure. The first variation is
    subtracted so that the reference state is an equilibrium, also on facets that only approximate a
    sphere and at an unsupported rim.

    With the displacement gradient H, the undeformed normal N and P = I - N N, the area of a surface
    element grows by the factor sqrt(1 + e), where

        e = 2 tr(PH) + m,   m = tr(P H^T H P) + det C,   C = P (H + H^T + H^T H) P,

    and sqrt(1 + e) - 1 - tr(PH) = m/2 - e^2/(2 (1 + sqrt(1 + e))^2) has no first-order part. At
    small strain its second-order part is used, which is gamma/2 |grad_s u_n|^2 on a flat surface.

    Surface tension does not resist tangential displacements of surface points. In a drop, where
    gamma/(mu R) >> 1, the elastic resistance is small too, and the discretised curvature, which
    jumps at the contact edge, moves the points until elements fold. The surface of a drop therefore
    has a membrane with the shear modulus s gamma [force/length], where s is the membrane stiffness.
    The membrane energy

        s gamma [(tr C_s - 2)/2 - ln J_s],   C_s = P (I + H)^T (I + H) P,

    with the area ratio J_s is stress-free at rest. During the solution s may be larger than
    MEMBRANE_STIFFNESS; the excess times gamma/R is then added to the shear modulus of the body,
    see `membrane_continuation` in `fe.solve`.
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
        # The integrand has squares of slopes, at finite strain their square root
        self.energy = body.surface_integral("top", gamma * area_growth, 6)
        if physics.domain.top_radius:
            pressure = 2 * gamma / fem.Constant(body.mesh, physics.domain.top_radius)
            # J - 1 - tr H, at small strain to second order
            volume_growth = (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2
            volume_growth = volume_growth if physics.small_strain else volume_growth + ufl.det(H)
            parts = (
                body.region_integral(pressure * volume_growth, region)
                for region in physics.domain.regions
            )
            self.energy = self.energy - reduce(add, parts)
        if self.has_membrane:
            # E = 3 and nu = 0.5 give the shear modulus 1
            shear_energy, _ = NeoHookean(E=3.0, nu=0.5).energy_parts(H)
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
        """Set the shear modulus of the membrane, and the shear modulus that it adds to the body.

        Parameters
        ----------
        stiffness : float
            Shear modulus of the membrane divided by gamma; MEMBRANE_STIFFNESS adds nothing to the
            body.
        """
        self._membrane_stiffness.value = stiffness


def _membrane_energy(H: Expr, P: Expr) -> Expr:
    """Membrane energy (tr C_s - 2)/2 - ln J_s per undeformed area and shear modulus."""
    C, e = _surface_strain(H, P)
    return ufl.tr(C) / 2 - ufl.ln(1 + e) / 2


def _surface_strain(H: Expr, P: Expr) -> tuple[Expr, Expr]:
    """Strain C = C_s - P of a surface, and e = J_s^2 - 1."""
    stretched = P * H.T * H * P
    C = P * (H + H.T) * P + stretched
    return C, ufl.tr(C) + (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2


def _area_growth(H: Expr, P: Expr) -> Expr:
    """Relative growth of a surface element, without the first-order part tr(PH)."""
    stretched = P * H.T * H * P
    C = P * (H + H.T) * P + stretched
    m = ufl.tr(stretched) + (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    e = 2 * ufl.tr(P * H) + m
    return m / 2 - e**2 / (2 * (1 + ufl.sqrt(1 + e)) ** 2)


def _linearized_area_growth(H: Expr, P: Expr) -> Expr:
    """Second-order part |N.HP|^2/2 + ((tr A)^2 - tr A^2)/2, A = PHP, of `_area_growth`."""
    A = P * H * P
    tilt = H * P - A
    return (ufl.inner(tilt, tilt) + ufl.tr(A) ** 2 - ufl.tr(A * A)) / 2
