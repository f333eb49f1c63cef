"""Friction of the contact surface on the tip: Coulomb's law, or no slip at all, by the augmented Lagrangian.

The tangential traction on the body along the unit tangents m_k of the tip (Alart & Curnier 1991),

    t_hat = tau - epsilon_t s,    t = t_hat where |t_hat| <= friction p (stick), friction p t_hat/|t_hat| (slip),

with p = <p_hat> the pressure, t = 0 out of contact, and no bound for stick. The slip s of the body along the tip is

    s_k = u_k - u0_k                                        reference gap, the tip moves along z alone
    s_k = m_k . (u - u0 + (delta - delta0) e_z)             current gap

(a penalty has the tau of the last equilibrium instead: of s it gives way by (tau - t)/epsilon_t, which comes back, and
slips by the rest, (t - t_hat)/epsilon_t) since the points stuck at u0 and delta0: those of the last equilibrium for
what was in contact then, see `Anchor` of `model.contact` for what was not. There is no potential: the virtual work is

    - int t . ds    and, for the multiplier,    int (t - tau)/epsilon_t . dtau,

and its derivative is not symmetric. Nothing is kept at quadrature points: the multipliers carry the history.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from indent_sim.fe.body import Body
from indent_sim.fe.observe.surface import FacetValues, contact_quadrature, facet_nodes
from indent_sim.fe.terms.gap import Gap
from indent_sim.fe.terms.traction import Traction

AT_ONCE = 1e-6  # of a step's depth: a gap this small at its beginning is closed from then on, as under a flat punch
# A point that comes into contact while a gap `widest` closes elsewhere has gone TOUCHED (gap/widest)^CLOSING of its way
# through the step when it touches, as if it were smooth. In self-similar contact of a paraboloid without slip the share
# rises from 0 at the old edge of contact to about 2/3 at the new one; these two leave the least error of the force over
# half-spaces and layers, stick and Coulomb's law.
TOUCHED, CLOSING = 0.63, 1 / 3
UNBOUNDED = 1e30  # [pressure] no traction that sticks is as large
ROUNDOFF = 1e-30  # [pressure^2] added to |t|^2, whose root has no slope at zero


class Friction:
    """The tangential traction of a contact that sticks or slips, its history and its work."""

    def __init__(self, body: Body, normal: Traction, delta: fem.Constant):
        """normal: the term of the normal pressure, which bounds this one."""
        self.body, self._normal, self._delta = body, normal, delta
        self._law: Any = body.scene.physics.contact
        mesh, space = body.mesh, body.unknowns.space
        self._old, self._start = fem.Function(space), fem.Function(space)
        self._old_depth, self._start_depth = fem.Constant(mesh, 0.0), fem.Constant(mesh, 0.0)
        self._widest = fem.Constant(mesh, 1.0)
        self._holds_new = fem.Constant(mesh, 1.0)  # 0: what is new in contact slips freely
        self._epsilon_t = fem.Constant(mesh, float(self._law.epsilon_t))
        self._tangents = normal.gap.tangents
        opening = self._opening()
        is_new = ufl.conditional(ufl.gt(opening, AT_ONCE * abs(delta - self._old_depth)), 1.0, 0.0)
        self._closed = ufl.conditional(ufl.gt(normal.trial_pressure, 0.0), is_new * opening, 0.0)
        self._slip = self._slips(is_new * self._way(opening))
        self._tau = _vector(body.unknowns.fields["tau"])
        tau = self._tau if self._law.multiplier == "unknown" else _vector(body.unknowns.of(self._old)["tau"])
        trial = tau - self._epsilon_t * self._slip
        self._room = self._bound() - _length(trial)
        holds = ufl.conditional(ufl.gt(normal.trial_pressure, 0.0), 1 - is_new * (1 - self._holds_new), 0.0)
        self._t = holds * self._projected(trial)
        self._slid = (trial - self._t) / self._epsilon_t
        self._expressions: dict[tuple[str, bytes], FacetValues] = {}
        self._dissipation = fem.form(body.over_contact(self._rubbed(opening)))
        self._thrust = [fem.form(body.over_contact(self._push(axis))) for axis in range(body.body_mesh.dim)]

    def _opening(self) -> Any:
        """The gap at the last equilibrium [length], below zero where the surface was in contact."""
        law, old = self._normal.symbolic_law, self.body.unknowns.of(self._old)
        gap = Gap(self.body, self._old_depth, old["u"])
        return -law.trial_pressure(gap.g, old.get("lam", 0.0)) / law.stiffness

    def _way(self, opening: Any) -> Any:
        """How much of its way to the start that it is given a new point of contact had gone when it touched."""
        return TOUCHED * ufl.max_value(0.0, ufl.min_value(opening / self._widest, 1.0)) ** CLOSING

    def _slips(self, way: Any) -> Any:
        """s_k [length] since the points stuck, `way` from the last equilibrium to the start."""
        unknowns, dim = self.body.unknowns, self.body.body_mesh.dim
        old, start = unknowns.of(self._old)["u"], unknowns.of(self._start)["u"]
        moved = unknowns.fields["u"] - old - way * (start - old)
        if self.body.scene.physics.gap == "current":
            sunk = self._delta - self._old_depth - way * (self._start_depth - self._old_depth)
            moved += ufl.as_vector([0.0] * (dim - 1) + [sunk])
        return ufl.as_vector([ufl.dot(m, moved) for m in self._tangents])

    def _bound(self) -> Any:
        """friction p [pressure]; beyond all tractions for stick."""
        if self._law.friction == "stick":
            return ufl.as_ufl(UNBOUNDED)
        return self._normal.symbolic_law.friction * self._normal.pressure

    def _projected(self, trial: Any) -> Any:
        """t_hat where it is within the bound, else the part of it that is."""
        if self._law.friction == "stick":
            return trial
        return ufl.conditional(ufl.ge(self._room, 0.0), trial, trial + self._room / _length(trial) * trial)

    def _rubbed(self, opening: Any) -> Any:
        """What slip turns into heat [pressure length]: t . (t_hat - t)/epsilon_t, the way of what slips against its
        traction, with friction (p + p_old)/2 in place of friction p. Never negative, and 0 at what sticks."""
        law, normal = self._normal.symbolic_law, self._normal
        before = law.stiffness * ufl.max_value(0.0, -opening)
        slips = ufl.And(ufl.gt(normal.trial_pressure, 0.0), ufl.lt(self._room, 0.0))
        share = ufl.conditional(slips, (normal.pressure + before) / (2 * normal.pressure), 0.0)
        return share * ufl.dot(self._t, self._slid)

    def _push(self, axis: int) -> Any:
        """The traction on the tip along an axis [pressure]: that of the pressure and that of friction."""
        along = ufl.as_vector([m[axis] for m in self._tangents])
        return -self._normal.pressure * self._normal.gap.normal[axis] - ufl.dot(self._t, along)

    def work(self, test: Any, trial: Any) -> tuple[Any, Any]:
        """Virtual work of the traction, of its multiplier, and their derivative, as UFL forms."""
        ways, unknowns = self.body.unknowns.of(test), self.body.unknowns
        slips = ufl.as_vector([ufl.dot(m, ways["u"]) for m in self._tangents])
        virtual = ufl.dot((self._t - self._tau) / self._epsilon_t, _vector(ways["tau"])) - ufl.dot(self._t, slips)
        rub = self.body.over_contact(virtual)
        return rub, ufl.derivative(rub, unknowns.solution, trial)

    # ---- history -------------------------------------------------------------------------------------------------

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        self._old.x.array[:] = self.body.local_array()
        self._old_depth.value = self._delta.value

    def stick_where_it_was(self) -> None:
        """What comes into contact sticks where it was at the step's beginning: `implicit`."""
        self._start.x.array[:] = self._old.x.array
        self._start_depth.value, self._holds_new.value = self._old_depth.value, 1.0

    def let_new_slip(self) -> None:
        """What comes into contact slips freely: `glue`."""
        self.stick_where_it_was()
        self._holds_new.value = 0.0

    def stick_on_the_way(self) -> None:
        """What comes into contact sticks on its way from the step's beginning to the present state (collective)."""
        closed = self._at("closed", self._closed, contact_quadrature(self.body.body_mesh.dim)[0])()
        widest = self.body.comm.allreduce(float(closed.max(initial=0.0)), op=MPI.MAX)
        self._widest.value = widest or 1.0
        self._start.x.array[:] = self.body.local_array()
        self._start_depth.value, self._holds_new.value = self._delta.value, 1.0

    # ---- measurements --------------------------------------------------------------------------------------------

    def soften(self, factor: float) -> None:
        """Multiply epsilon_t; 1 makes it the law's own again."""
        self._epsilon_t.value = factor * self._law.epsilon_t

    def dissipation(self) -> float:
        """What slip turns into heat in the step to the present state [energy], this rank's share of the modelled part.

        With friction (p + p_old)/2: Coulomb's bound grows on the way, and with that of the step's end alone the sum is
        only of first order in the steps."""
        return 0.0 if self._law.friction == "stick" else float(fem.assemble_scalar(self._dissipation))

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure] at reference-facet points of the contact surface (collective
        the first time)."""
        return self._at("room", self._room, points)()[..., 0]

    def _at(self, name: str, expression: Any, points: np.ndarray) -> FacetValues:
        """An expression at points of the contact surface, compiled once (collective the first time)."""
        key = name, points.tobytes()
        if key not in self._expressions:
            facets = self.body.body_mesh.surfaces["top"]
            self._expressions[key] = FacetValues(self.body.mesh, facets, expression, points)
        return self._expressions[key]

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) at reference-facet points of the contact surface [pressure]."""
        body = self.body
        nodes = facet_nodes(body.mesh, body.unknowns.own_space("tau"), body.body_mesh.surfaces["top"])
        places = np.stack([places[nodes] for places in body.unknowns.components("tau").values()], axis=-1)
        return body.trace.values(body.local_array()[places], points)

    def thrust(self) -> np.ndarray:
        """Force on the tip along each axis [force], this rank's share of the modelled part."""
        return np.array([fem.assemble_scalar(form) for form in self._thrust])


def _vector(tau: Any) -> Any:
    return tau if tau.ufl_shape else ufl.as_vector([tau])


def _length(t: Any) -> Any:
    return ufl.sqrt(ufl.dot(t, t) + ROUNDOFF)
