"""Contact residual (weak form) of a law with a potential: int potential(g, lam) dGamma.

These laws are the penalty method, the augmented Lagrangian method and Nitsche's method.

The derivative of the potential with respect to the gap is minus the contact pressure <lam -
stiffness g>, which acts along the tip's normal. Only unknowns are varied, not a frozen multiplier
(Uzawa) or the stress of the body (Nitsche's method with theta = 0).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.symbolic_constants import symbolic_copy
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import SurfaceMultiplier, multiplier_field
from indent_sim.fe.terms.contact.projection import PressureProjection
from indent_sim.fe.terms.strain_energy import StrainEnergy
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field, TimeLevel
from indent_sim.model.algebra import macaulay
from indent_sim.scene.scene import Scene


def fields(scene: Scene) -> list[Field]:
    """Return the multiplier field if the contact law has the multiplier as an unknown, else []."""
    return (
        [multiplier_field(scene, DISPLACEMENT_ORDER)]
        if scene.physics.contact.multiplier == "unknown"
        else []
    )


class Traction(Term):
    """Normal contact pressure from the potential of the scene's contact law.

    Attributes
    ----------
    gap : Gap
        Gap at the current solution.
    trial_pressure : Expr
        p_hat [pressure], a UFL expression, > 0 in contact.
    pressure : Expr
        Contact pressure <p_hat>, less the attraction of an adhesive tip [pressure].
    """

    def __init__(self, body: Body, strain_energy: StrainEnergy):
        self.body = body
        self.gap = Gap(body, body.now)
        self.law = body.scene.physics.contact
        self._curvature_is_limited = fem.Constant(body.mesh, 0.0)
        self._lam = self._multiplier_expression(strain_energy)
        self._solves_for_multiplier = self.law.multiplier == "unknown"
        self.field_names = ("lam",) if self._solves_for_multiplier else ()
        self.frozen = (self.surface_multiplier.lam,) if self.law.multiplier == "frozen" else ()
        self.has_memory = self.law.may_snap_through
        # Nitsche's method with theta = 0 does not vary the stress
        self.has_symmetric_tangent = self.law.multiplier != "stress"
        self.symbolic_law = symbolic_copy(self.law, body.mesh)
        g = ufl.variable(self.gap.g)
        lam = ufl.variable(self._lam) if self._solves_for_multiplier else self._lam
        potential = self.symbolic_law.potential(g, lam)
        self._potential_slope = ufl.diff(potential, g)
        self.trial_pressure = self.symbolic_law.trial_pressure(self.gap.g, self._lam)
        self.pressure = -self._potential_slope
        self._multiplier_slope = ufl.diff(potential, lam) if self._solves_for_multiplier else None
        self.energy = body.contact_integral(potential)
        vertical = self._potential_slope * self.gap.depth_derivative
        self._force_form = compile_form(body.contact_integral(vertical))
        physics = body.scene.physics
        self._moment_form = None
        if physics.has_moment:
            self._moment_form = compile_form(body.contact_integral(vertical * self.gap.lever))
        # With friction and without a slide, the term of friction contains the part of the side
        # force that the pressure has.
        is_pushed = physics.slides or (self.law.is_conservative and physics.side_force_axes)
        self._side_force_forms = [
            compile_form(body.contact_integral(-self._potential_slope * self._slope(axis)))
            for axis in range(body.body_mesh.dim - 1)
            if is_pushed
        ]

    def _multiplier_expression(self, strain_energy: StrainEnergy) -> Expr:
        """Return the UFL expression that the contact method uses as multiplier in the potential.

        The multiplier is an unknown, a frozen function, the normal stress of the body, or zero.
        """
        match self.law.multiplier:
            case "unknown" | "frozen":
                return self.surface_multiplier.lam
            case "stress":
                kinematics = self.body.scene.physics.domain.kinematics
                N = kinematics.space_vector(ufl.FacetNormal(self.body.mesh))
                return ufl.dot(
                    kinematics.model_vector(strain_energy.nominal_stress * N), self.gap.normal
                )
        return ufl.as_ufl(0.0)

    @cached_property
    def surface_multiplier(self) -> SurfaceMultiplier:
        """The multiplier, or for a law without multiplier the projection of the pressure."""
        return SurfaceMultiplier(self.body)

    @cached_property
    def projection(self) -> PressureProjection:
        """Projection of the pressure, stored in `surface_multiplier`."""
        return PressureProjection(self.body, self.pressure, self.surface_multiplier.lam)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the pressure along `now.test`, a UFL form."""
        virtual = self._potential_slope * ufl.derivative(self.gap.g, now.function, now.test)
        if self._solves_for_multiplier:
            virtual += self._multiplier_slope * ufl.derivative(self._lam, now.function, now.test)
        return self.body.contact_integral(virtual)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Derivative of the virtual work along `now.trial`, a UFL form.

        The pressure <lam - epsilon_n g> times the tip's curvature is a negative tangential
        stiffness. In an iterate with a large penetration it exceeds the stiffness of the body, and
        Newton's step inverts elements. `limit_curvature` replaces the pressure in this term by the
        multiplier where the multiplier is smaller; the two are equal in equilibrium.
        """
        tangent = super().tangent(now, before, dt)
        if not self._solves_for_multiplier or self.body.scene.physics.gap == "reference":
            return tangent
        variation = ufl.derivative(self.gap.g, now.function, now.test)
        second_variation = ufl.derivative(variation, now.function, now.trial)
        excess = macaulay(macaulay(self.trial_pressure) - macaulay(self._lam))
        return tangent + self.body.contact_integral(
            self._curvature_is_limited * excess * second_variation
        )

    def limit_curvature(self, *, is_limited: bool) -> None:
        """Switch the limit of the pressure in the tangent's curvature term; see `tangent`."""
        self._curvature_is_limited.value = float(is_limited)

    def force(self) -> float:
        """Virtual work per indentation depth [force], this rank's part in the model domain."""
        return float(fem.assemble_scalar(self._force_form))

    def side_force(self, axis: int) -> float:
        """Horizontal force on the tip along an axis, due to the pressure [force], this rank's part.

        If the tip slides, the force is -dPi/dx. The result is 0 if `Friction` includes this force.
        """
        if not self._side_force_forms:
            return super().side_force(axis)
        return float(fem.assemble_scalar(self._side_force_forms[axis]))

    def _slope(self, axis: int) -> Expr:
        """Derivative of the gap with respect to the tip's position along a horizontal axis."""
        if self.body.scene.physics.slides:
            return self.gap.slide_derivative(axis)
        return -self.gap.normal[axis]

    def moment(self) -> float:
        """Moment of the vertical force of the pressure [force length], this rank's part."""
        return float(fem.assemble_scalar(self._moment_form)) if self._moment_form else 0.0

    @property
    def stiffness(self) -> float:
        """Current penalty stiffness [pressure/length], including all continuation factors."""
        return float(self.symbolic_law.stiffness.value)  # type: ignore[union-attr]

    def scale_stiffness(self, factor: float) -> None:
        """Set the penalty stiffness to `factor` times its value in the contact law."""
        self.symbolic_law.stiffness.value = factor * self.law.stiffness  # type: ignore[union-attr]

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """Multiplier (facets, points) at points of the reference facet [pressure] (collective)."""
        return self._projected_multiplier().values_at_points(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Smoothed multiplier (facets, points) for output [pressure] (collective)."""
        return self._projected_multiplier().smooth_values_at(points)

    def _projected_multiplier(self) -> SurfaceMultiplier:
        if self.law.multiplier in ("none", "stress"):
            self.projection.update_multiplier()
        return self.surface_multiplier
