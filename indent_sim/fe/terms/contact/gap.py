"""The gap between the contact surface and the tip, and its derivatives, as UFL expressions."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.symbolic_constants import symbolic_copy
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.model.tips import gap_current, gap_reference


class Gap:
    """Gap g [length] between the contact surface and the tip, g >= 0 where the contact is open.

    The normal dg/dx is the direction of the traction on the body. The reference gap is linear in
    u_z and independent of the horizontal displacement; the current gap depends on the deformed
    point x = X + u.
    """

    def __init__(self, body: Body, time_level: TimeLevel):
        scene = body.scene
        dim = body.body_mesh.dim
        u = time_level.fields["u"]
        tip = symbolic_copy(scene.physics.indenter, body.mesh)
        self._lever_axis = [
            fem.Constant(body.mesh, component) for component in scene.physics.moment_axis
        ]
        self._slides = scene.physics.slides
        self._center = time_level.center
        if self._slides:
            self._center = [ufl.variable(c) for c in time_level.center]
        self._delta = ufl.variable(time_level.delta)
        self._dim = dim
        X = body.X
        self._x = None if scene.physics.gap == "reference" else ufl.variable(X + u)
        horizontal = scene.physics.domain.kinematics.horizontal_position(
            X if self._x is None else self._x, self._center
        )
        self._horizontal = horizontal
        if self._x is None:
            self.g = gap_reference(tip, *horizontal, X[dim - 1] + u[dim - 1], self._delta)
            self.normal = ufl.as_vector([0.0] * (dim - 1) + [-1.0])
        else:
            self.g = gap_current(tip, *horizontal, self._x[dim - 1], self._delta)
            self.normal = ufl.diff(self.g, self._x)

    @property
    def depth_derivative(self) -> Expr:
        """Derivative dg/d(delta); -1 for a reference gap."""
        return ufl.diff(self.g, self._delta)

    def slide_derivative(self, axis: int) -> Expr:
        """Derivative of the gap with respect to the tip's position along a horizontal axis.

        It is minus the slope of the tip along this axis; it is used only if the load path contains
        a slide.
        """
        return ufl.diff(self.g, self._center[axis])

    @property
    def lever(self) -> Expr:
        """Distance of the point from the tip's axis in the direction of the moment [length]."""
        e, g = self._lever_axis
        return e * self._horizontal[0] + g * self._horizontal[1]

    @property
    def tangents(self) -> tuple[Expr, ...]:
        """Unit tangents m_k of the tip, one for each horizontal axis.

        The rotation that takes -e_z to the normal n = grad g/|grad g| takes the axes e_k to

            m_k = e_k - n_k/(1 - n_z) (n - e_z).
        """
        last = self._dim - 1
        axes = [ufl.as_vector([float(i == k) for i in range(self._dim)]) for k in range(self._dim)]
        if self._x is None:
            return tuple(axes[:last])
        n = self.normal / ufl.sqrt(ufl.dot(self.normal, self.normal))
        return tuple(axes[k] - n[k] / (1 - n[last]) * (n - axes[last]) for k in range(last))

    @property
    def hessian(self) -> Expr:
        """Second derivative d2g/dx2 (dim, dim) of the gap [1/length]."""
        if self._x is None:
            return ufl.as_matrix(np.zeros((self._dim,) * 2).tolist())
        return ufl.diff(self.normal, self._x)
