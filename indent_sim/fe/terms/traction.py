"""The contact term of a law with a potential: int potential(g, lam) dGamma.

Its derivative along the gap is minus the pressure <lam - stiffness g>, along the tip's normal. Only what is unknown is
varied: a frozen multiplier or the body's own stress (Nitsche, theta = 0) is not.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe.body import Body, symbolic
from indent_sim.fe.terms.gap import Gap
from indent_sim.fe.terms.multiplier import SurfaceField, given_field, unknown_field
from indent_sim.fe.terms.projection import Projection
from indent_sim.fe.terms.strain import Strain


class Traction:
    """The tip's push on the contact surface by the potential of the scene's contact law."""

    def __init__(self, body: Body, strain: Strain, delta: fem.Constant):
        self.body, self.gap = body, Gap(body, delta)
        self.law = body.scene.physics.contact
        self._lam = self._multiplier(strain)
        self._is_unknown = self.law.multiplier == "unknown"
        self.symbolic_law = symbolic(self.law, body.mesh)
        g, lam = ufl.variable(self.gap.g), ufl.variable(self._lam) if self._is_unknown else self._lam
        potential = self.symbolic_law.potential(g, lam)
        self._slope = ufl.diff(potential, g)
        self._along_lam = ufl.diff(potential, lam) if self._is_unknown else None
        self.energy = body.over_contact(potential)
        self._thrust = fem.form(body.over_contact(self._slope * self.gap.rate))

    def _multiplier(self, strain: Strain) -> Any:
        """lam in the potential: an unknown, a given function, the body's own normal stress, or zero."""
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
        """lam as it is read: the multiplier, or where the law has none of its own the projection of the pressure."""
        return unknown_field(self.body) if self.law.multiplier == "unknown" else given_field(self.body)

    @cached_property
    def projection(self) -> Projection:
        """The pressure's projection on the multiplier's functions; its memory is `field`'s."""
        return Projection(self.body, -self._slope, self.field.lam)

    @property
    def trial_pressure(self) -> Any:
        """p_hat [pressure] as a UFL expression: above zero in contact."""
        return self.symbolic_law.trial_pressure(self.gap.g, self._lam)

    @property
    def pressure(self) -> Any:
        """<p_hat> [pressure] as a UFL expression."""
        return -self._slope

    def work(self, test: Any, trial: Any) -> tuple[Any, Any]:
        """Virtual work of the pressure and its derivative, as UFL forms."""
        solution = self.body.unknowns.solution
        virtual = self._slope * ufl.derivative(self.gap.g, solution, test)
        if self._is_unknown:
            virtual += self._along_lam * ufl.derivative(self._lam, solution, test)
        push = self.body.over_contact(virtual)
        return push, ufl.derivative(push, solution, trial)

    @property
    def vectors(self) -> list[PETSc.Vec]:
        """What of the state is not among the body's unknowns: a frozen multiplier."""
        return [self.field.vector] if self.law.multiplier == "frozen" else []

    @property
    def has_symmetric_tangent(self) -> bool:
        """Whether the tangent is a second derivative: not where the variation of the body's stress is dropped."""
        return self.law.multiplier != "stress"

    def force(self) -> float:
        """Virtual work of pressing deeper [force], this rank's share of the modelled part."""
        return float(fem.assemble_scalar(self._thrust))

    @property
    def stiffness(self) -> float:
        """The law's stiffness as it is now, softened or not [pressure/length]."""
        return float(self.symbolic_law.stiffness.value)  # type: ignore[union-attr]

    def soften(self, factor: float) -> None:
        """Multiply the stiffness of the contact law; 1 makes it the law's own again."""
        self.symbolic_law.stiffness.value = factor * self.law.stiffness  # type: ignore[union-attr]

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure] (collective)."""
        self._project()
        return self.field.at(points)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles (collective)."""
        self._project()
        return self.field.smooth_at(points)

    def _project(self) -> None:
        if self.law.multiplier in ("none", "stress"):
            self.projection.update()
