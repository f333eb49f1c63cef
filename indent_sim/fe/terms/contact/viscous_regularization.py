"""Viscous drag on the contact surface, for dynamic relaxation to a stable state."""

from __future__ import annotations

import ufl
from dolfinx import fem

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import TimeLevel


class ViscousRegularization(Term):
    """Viscous drag on the surface with the virtual work int drag (u - u_start) . v dGamma."""

    def __init__(self, body: Body):
        self._body = body
        self._drag_coefficient = fem.Constant(body.mesh, 0.0)
        self._start_solution = fem.Function(body.unknowns.space)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the drag, a UFL form."""
        start, test = (
            self._body.unknowns.split_fields(function)["u"]
            for function in (self._start_solution, now.test)
        )
        return self._body.contact_integral(
            self._drag_coefficient * ufl.dot(now.fields["u"] - start, test)
        )

    def set_drag(self, drag: float) -> None:
        """Set the drag coefficient [pressure/length] and take the current solution as u_start."""
        self._drag_coefficient.value = drag
        self._start_solution.x.array[:] = self._body.now.function.x.array
