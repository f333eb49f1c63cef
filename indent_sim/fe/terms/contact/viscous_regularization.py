"""A drag on the contact surface: it holds a body back that is let go of, on the way to where it
comes to rest.
"""

from __future__ import annotations

import ufl
from dolfinx import fem

from indent_sim.fe.discrete_body import Body, TimeLevel
from indent_sim.fe.terms.term import Term


class ViscousRegularization(Term):
    """int drag (u - u_start) . v dGamma; nothing while the drag [pressure/length] is zero."""

    def __init__(self, body: Body):
        self._body = body
        self._drag_coefficient = fem.Constant(body.mesh, 0.0)
        self._start_solution = fem.Function(body.unknowns.space)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the drag, as a UFL form."""
        start, test = (
            self._body.unknowns.split_fields(function)["u"]
            for function in (self._start_solution, now.test)
        )
        return self._body.contact_integral(
            self._drag_coefficient * ufl.dot(now.fields["u"] - start, test)
        )

    def set_drag(self, drag: float) -> None:
        """Hold the surface back where it is by a drag [pressure/length] on its way; 0 for not at
        all.
        """
        self._drag_coefficient.value = drag
        self._start_solution.x.array[:] = self._body.now.function.x.array
