"""The tension of the contact surface, and the pressure inside that balances it at rest."""

from __future__ import annotations

from functools import reduce
from operator import add

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.terms.term import Term

SURFACE_DEGREE = 6  # of the quadrature: squares of slopes, and at finite strain the root of them


class SurfaceTension(Term):
    """gamma (A - A0) - (2 gamma/R)(V - V0), less its slope at rest; R the radius of a spherical top, a flat one has no
    pressure. A is the area of the whole contact surface, touched or not, V the body's volume.

    So rest is an equilibrium, also on facets that are no sphere: what is left of the slope there, and at a rim that
    nothing holds, is a load that the reference state bears. With H the displacement gradient, N the undeformed normal
    and P = 1 - N N, the area of a part grows by sqrt(1 + e), e = 2 tr PH + m, m = tr(P H^T H P) + det C of
    C = P (H + H^T + H^T H) P, and sqrt(1 + e) - 1 - tr PH = m/2 - e^2/(2 (1 + sqrt(1 + e))^2) has no first order. At
    small strain it is the second order of that: gamma/2 |grad_s u_n|^2 on a flat surface.
    """

    is_matter = True

    def __init__(self, body: Body):
        physics = body.scene.physics
        self.is_constant = physics.small_strain
        kinematics = physics.part.kinematics
        H = kinematics.gradient(body.now.fields["u"], body.X)
        gamma = fem.Constant(body.mesh, physics.surface_tension)
        N = kinematics.in_space(ufl.FacetNormal(body.mesh))
        P = ufl.Identity(3) - ufl.outer(N, N)
        grown = _grown_linear(H, P) if physics.small_strain else _grown(H, P)
        self.energy = body.over_surface("top", gamma * grown, SURFACE_DEGREE)
        if physics.part.dome:
            pressure = 2 * gamma / fem.Constant(body.mesh, physics.part.dome)
            curved = (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2  # of J - 1 - tr H
            curved = curved if physics.small_strain else curved + ufl.det(H)
            parts = (body.over_region(pressure * curved, region) for region in physics.part.regions)
            self.energy = self.energy - reduce(add, parts)


def _grown(H: Expr, P: Expr) -> Expr:
    """How much more an area grows than by tr PH, of itself."""
    stretched = P * H.T * H * P
    C = P * (H + H.T) * P + stretched
    m = ufl.tr(stretched) + (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    e = 2 * ufl.tr(P * H) + m
    return m / 2 - e**2 / (2 * (1 + ufl.sqrt(1 + e)) ** 2)


def _grown_linear(H: Expr, P: Expr) -> Expr:
    """The same to second order in H: |N.HP|^2/2 + ((tr A)^2 - tr A^2)/2, A = PHP."""
    A = P * H * P
    tilted = H * P - A
    return (ufl.inner(tilted, tilted) + ufl.tr(A) ** 2 - ufl.tr(A * A)) / 2
