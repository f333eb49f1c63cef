"""A drag on the contact surface: it holds a body back that is let go of, on the way to where it
comes to rest.
"""

from __future__ import annotations

import ufl
from dolfinx import fem

from indent_sim.fe.discrete_body import Body, Moment
from indent_sim.fe.terms.term import Term


class Drag(Term):
    """int drag (u - u_start) . v dGamma; nothing while the drag [pressure/length] is zero."""

    def __init__(self, body: Body):
        self._body = body
        self._drag = fem.Constant(body.mesh, 0.0)
        self._start = fem.Function(body.unknowns.space)

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the drag, as a UFL form."""
        start, way = (self._body.unknowns.of(function)["u"] for function in (self._start, now.test))
        return self._body.over_contact(self._drag * ufl.dot(now.fields["u"] - start, way))

    def hold(self, drag: float) -> None:
        """Hold the surface back where it is by a drag [pressure/length] on its way; 0 for not at
        all.
        """
        self._drag.value = drag
        self._start.x.array[:] = self._body.now.function.x.array
