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

from indent_sim.fe.discrete_body import ORDER, Body, Field, Moment, symbolic
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import SurfaceField, multiplier
from indent_sim.fe.terms.contact.projection import Projection
from indent_sim.fe.terms.strain import Strain
from indent_sim.fe.terms.term import Term
from indent_sim.scene.scene import Scene


def fields(scene: Scene) -> list[Field]:
    """The multiplier, where it is an unknown."""
    return [multiplier(scene, ORDER)] if scene.physics.contact.multiplier == "unknown" else []


class Traction(Term):
    """The tip's push on the contact surface by the potential of the scene's contact law."""

    def __init__(self, body: Body, strain: Strain):
        self.body = body
        self.gap = Gap(body, body.now)
        self.law = body.scene.physics.contact
        self._lam = self._multiplier(strain)
        self._is_unknown = self.law.multiplier == "unknown"
        self.fields = ("lam",) if self._is_unknown else ()
        self.frozen = (self.field.lam,) if self.law.multiplier == "frozen" else ()
        self.has_memory = self.law.may_snap
        self.has_symmetric_tangent = self.law.multiplier != "stress"  # whose variation is dropped
        self.symbolic_law = symbolic(self.law, body.mesh)
        g = ufl.variable(self.gap.g)
        lam = ufl.variable(self._lam) if self._is_unknown else self._lam
        potential = self.symbolic_law.potential(g, lam)
        self._slope = ufl.diff(potential, g)
        # p_hat, above zero in contact, and <p_hat> [pressure] as UFL expressions
        self.trial_pressure = self.symbolic_law.trial_pressure(self.gap.g, self._lam)
        self.pressure = -self._slope
        self._along_lam = ufl.diff(potential, lam) if self._is_unknown else None
        self.energy = body.over_contact(potential)
        self._thrust = fem.form(body.over_contact(self._slope * self.gap.rate))

    def _multiplier(self, strain: Strain) -> Expr:
        """lam in the potential: an unknown, a given function, the body's own normal stress, or
        zero.
        """
        match self.law.multiplier:
            case "unknown" | "frozen":
                return self.field.lam
            case "stress":
                kinematics = self.body.scene.physics.part.kinematics
                N = kinematics.in_space(ufl.FacetNormal(self.body.mesh))
                return ufl.dot(kinematics.in_plane(strain.nominal_stress * N), self.gap.normal)
        return ufl.as_ufl(0.0)

    @cached_property
    def field(self) -> SurfaceField:
        """lam as it is read: the multiplier, or where the law has none of its own the projection of
        the pressure.
        """
        return SurfaceField(self.body)

    @cached_property
    def projection(self) -> Projection:
        """The pressure's projection on the multiplier's functions; its memory is `field`'s."""
        return Projection(self.body, self.pressure, self.field.lam)

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the pressure, as a UFL form."""
        virtual = self._slope * ufl.derivative(self.gap.g, now.function, now.test)
        if self._is_unknown:
            virtual += self._along_lam * ufl.derivative(self._lam, now.function, now.test)
        return self.body.over_contact(virtual)

    def force(self) -> float:
        """Virtual work of pressing deeper [force], this rank's share of the modelled part."""
        return float(fem.assemble_scalar(self._thrust))

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
        return self._projected().at(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles
        (collective).
        """
        return self._projected().smooth_at(points)

    def _projected(self) -> SurfaceField:
        if self.law.multiplier in ("none", "stress"):
            self.projection.update()
        return self.field
