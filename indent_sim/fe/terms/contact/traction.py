"""The contact term of a law with a potential: int potential(g, lam) dGamma.

Its derivative along the gap is minus the pressure <lam - stiffness g>, along the tip's normal. Only
what is unknown is varied: a frozen multiplier or the body's own stress (Nitsche, theta = 0) is not.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import DISPLACEMENT_ORDER, Body, Field, TimeLevel, symbolic_copy
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import SurfaceMultiplier, multiplier_field
from indent_sim.fe.terms.contact.projection import PressureProjection
from indent_sim.fe.terms.strain_energy import StrainEnergy
from indent_sim.fe.terms.term import Term
from indent_sim.scene.scene import Scene


def fields(scene: Scene) -> list[Field]:
    """The multiplier, where it is an unknown."""
    return (
        [multiplier_field(scene, DISPLACEMENT_ORDER)]
        if scene.physics.contact.multiplier == "unknown"
        else []
    )


class Traction(Term):
    """The tip's push on the contact surface by the potential of the scene's contact law."""

    def __init__(self, body: Body, strain_energy: StrainEnergy):
        self.body = body
        self.gap = Gap(body, body.now)
        self.law = body.scene.physics.contact
        self._lam = self._multiplier_expression(strain_energy)
        self._solves_for_multiplier = self.law.multiplier == "unknown"
        self.field_names = ("lam",) if self._solves_for_multiplier else ()
        self.frozen = (self.surface_multiplier.lam,) if self.law.multiplier == "frozen" else ()
        self.has_memory = self.law.may_snap_through
        self.has_symmetric_tangent = self.law.multiplier != "stress"  # whose variation is dropped
        self.symbolic_law = symbolic_copy(self.law, body.mesh)
        g = ufl.variable(self.gap.g)
        lam = ufl.variable(self._lam) if self._solves_for_multiplier else self._lam
        potential = self.symbolic_law.potential(g, lam)
        self._potential_slope = ufl.diff(potential, g)
        # p_hat, above zero in contact, and <p_hat> [pressure] as UFL expressions
        self.trial_pressure = self.symbolic_law.trial_pressure(self.gap.g, self._lam)
        self.pressure = -self._potential_slope
        self._multiplier_slope = ufl.diff(potential, lam) if self._solves_for_multiplier else None
        self.energy = body.contact_integral(potential)
        self._force_form = fem.form(
            body.contact_integral(self._potential_slope * self.gap.depth_derivative)
        )

    def _multiplier_expression(self, strain_energy: StrainEnergy) -> Expr:
        """lam in the potential: an unknown, a given function, the body's own normal stress, or
        zero.
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
        """lam as it is read: the multiplier, or where the law has none of its own the projection of
        the pressure.
        """
        return SurfaceMultiplier(self.body)

    @cached_property
    def projection(self) -> PressureProjection:
        """The pressure's projection on the multiplier's functions; its memory is `field`'s."""
        return PressureProjection(self.body, self.pressure, self.surface_multiplier.lam)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the pressure, as a UFL form."""
        virtual = self._potential_slope * ufl.derivative(self.gap.g, now.function, now.test)
        if self._solves_for_multiplier:
            virtual += self._multiplier_slope * ufl.derivative(self._lam, now.function, now.test)
        return self.body.contact_integral(virtual)

    def force(self) -> float:
        """Virtual work of pressing deeper [force], this rank's share of the modelled part."""
        return float(fem.assemble_scalar(self._force_form))

    @property
    def stiffness(self) -> float:
        """The law's stiffness as it is now, softened or not [pressure/length]."""
        return float(self.symbolic_law.stiffness.value)  # type: ignore[union-attr]

    def scale_stiffness(self, factor: float) -> None:
        """Set the penalty stiffness to `factor` times that of the contact law."""
        self.symbolic_law.stiffness.value = factor * self.law.stiffness  # type: ignore[union-attr]

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure]
        (collective).
        """
        return self._projected_multiplier().values_at_points(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles
        (collective).
        """
        return self._projected_multiplier().smooth_values_at(points)

    def _projected_multiplier(self) -> SurfaceMultiplier:
        if self.law.multiplier in ("none", "stress"):
            self.projection.update_multiplier()
        return self.surface_multiplier
