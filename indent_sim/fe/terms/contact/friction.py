"""Friction of the contact surface on the tip: Coulomb's law, or no slip at all, by the augmented
Lagrangian.

The tangential traction on the body along the unit tangents m_k of the tip (Alart & Curnier 1991),

    t_hat = tau - epsilon_t s,    t = t_hat where |t_hat| <= friction p (stick), friction p
    t_hat/|t_hat| (slip),

with p = <p_hat> the pressure, t = 0 out of contact, and no bound for stick. The slip s of the body
along the tip is

    s_k = u_k - u0_k                                        reference gap, the tip moves along z
    alone s_k = m_k . (u - u0 + (delta - delta0) e_z)             current gap

(a penalty has the tau of the last equilibrium instead: of s it gives way by (tau - t)/epsilon_t,
which comes back, and slips by the rest, (t - t_hat)/epsilon_t) since the points stuck at u0 and
delta0: those of the last equilibrium for what was in contact then, see `Anchor` of `model.contact`
for what was not. There is no potential: the virtual work is

    - int t . ds    and, for the multiplier,    int (t - tau)/epsilon_t . dtau,

and its derivative is not symmetric. Nothing is kept at quadrature points: the multipliers carry the
history.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import ORDER, Body, Field, Moment, components
from indent_sim.fe.observe.surface import FacetValues, contact_quadrature, facet_nodes
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.term import Term
from indent_sim.model.algebra import maximum, where_less
from indent_sim.model.contact import (
    Anchor,
    CoulombPoint,
    dot,
    heat_of_leaving,
    is_new_contact,
    passed_gap,
    way_gone,
)
from indent_sim.scene.scene import Scene


def fields(scene: Scene) -> list[Field]:
    """The tangential traction tau, along each horizontal axis."""
    if scene.physics.contact.is_conservative:
        return []
    along = tuple(range(scene.physics.part.dim - 1))
    return [Field("tau", ORDER, along=along, where="top", weight=stiffness_scale(scene))]


class Friction(Term):
    """The tangential traction of a contact that sticks or slips, its history and its work."""

    fields = ("tau",)
    has_memory = True
    has_symmetric_tangent = False

    def __init__(self, body: Body, normal: Traction):
        """normal: the term of the normal pressure, which bounds this one."""
        self.body = body
        self._normal = normal
        self._law: Any = body.scene.physics.contact
        self._is_implicit = body.scene.physics.anchor == "implicit" and not self._law.is_bonded
        self._start = fem.Function(body.unknowns.space)
        self._start_depth = fem.Constant(body.mesh, 0.0)
        self._widest = fem.Constant(body.mesh, 1.0)
        self._holds_new = fem.Constant(body.mesh, 1.0)  # 0: what is new in contact slips freely
        self._epsilon_t = fem.Constant(body.mesh, float(self._law.epsilon_t))
        self._tangents = normal.gap.tangents
        self._expressions: dict[tuple[str, bytes], FacetValues] = {}
        now = body.now
        before = body.before
        law = normal.symbolic_law
        p_hat = normal.trial_pressure
        opening = (
            -law.trial_pressure(Gap(body, before).g, before.fields.get("lam", 0.0)) / law.stiffness
        )
        is_new = is_new_contact(opening, now.delta - before.delta)
        self._passed = passed_gap(opening, is_new, p_hat, law.stiffness)
        way_in = is_new * way_gone(opening, self._widest)
        self._tau = components(now.fields["tau"])
        tau = self._tau if self._law.multiplier == "unknown" else components(before.fields["tau"])
        trial = [
            tau_k - self._epsilon_t * slip
            for tau_k, slip in zip(tau, self._slips(way_in), strict=True)
        ]
        self._point = point = CoulombPoint(law.friction, normal.pressure, trial)
        holds = where_less(0.0, p_hat, 1 - is_new * (1 - self._holds_new), 0.0)
        self._t = [holds * point.share * t_hat for t_hat in trial]
        slid = self._gives_way(trial)
        moved = self._slips(0.0)
        p_before = law.stiffness * maximum(0.0, -opening)
        if (
            self._is_implicit
        ):  # a new point slips from where it touched, not from where its step began
            slid = [one + way_in * u for one, u in zip(slid, moved, strict=True)]
        heat = point.heat(self._t, slid, p_before)
        if self._is_implicit:
            way_out = way_gone(self._passed, self._widest)
            heat += where_less(
                0.0, p_hat, 0.0, heat_of_leaving(law.friction, p_before, moved, way_out)
            )
        self._dissipation = fem.form(body.over_contact(heat))
        last = body.body_mesh.dim - 1
        pushes = [
            -normal.pressure * normal.gap.normal[axis] - self._along(axis) for axis in range(last)
        ]
        self._side_forces = [fem.form(body.over_contact(push)) for push in pushes]
        is_level = (
            body.scene.physics.gap == "reference"
        )  # the traction along a level tip does not push it up
        self._lift = None if is_level else fem.form(body.over_contact(-self._along(last)))

    def _slips(self, way: Expr | float) -> list[Expr]:
        """s_k [length] since the points stuck, `way` from the last equilibrium to the start."""
        now = self.body.now
        before = self.body.before
        dim = self.body.body_mesh.dim
        old = before.fields["u"]
        start = self.body.unknowns.of(self._start)["u"]
        moved = now.fields["u"] - old - way * (start - old)
        if self.body.scene.physics.gap == "current":
            sunk = now.delta - before.delta - way * (self._start_depth - before.delta)
            moved += ufl.as_vector([0.0] * (dim - 1) + [sunk])
        return [ufl.dot(m, moved) for m in self._tangents]

    def _gives_way(self, tau: list[Expr]) -> list[Expr]:
        """(tau - t)/epsilon_t [length]."""
        return [(tau_k - t) / self._epsilon_t for tau_k, t in zip(tau, self._t, strict=True)]

    def _along(self, axis: int) -> Expr:
        return dot(self._t, [m[axis] for m in self._tangents])

    def work(self, now: Moment, before: Moment, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the traction and of its multiplier, as a UFL form."""
        ways = self.body.unknowns.of(now.test)
        slips = [ufl.dot(m, ways["u"]) for m in self._tangents]
        virtual = -dot(self._gives_way(self._tau), components(ways["tau"])) - dot(self._t, slips)
        return self.body.over_contact(virtual)

    def hold_new(self, anchor: Anchor) -> None:
        """Say where what comes into contact sticks; see `solve.anchor` (collective)."""
        if anchor == "mid":
            self._find_widest()
        start = self.body.now if anchor == "mid" else self.body.before
        self._start.x.array[:] = start.function.x.array
        self._start_depth.value = start.delta.value
        self._holds_new.value = float(anchor != "glue")

    def _find_widest(self) -> None:
        passed = self._at("passed", self._passed, contact_quadrature(self.body.body_mesh.dim)[0])()
        self._widest.value = (
            self.body.comm.allreduce(float(passed.max(initial=0.0)), op=MPI.MAX) or 1.0
        )

    def scale_stiffness(self, factor: float) -> None:
        """Set the tangential penalty stiffness to `factor` times the epsilon_t of the contact law."""
        self._epsilon_t.value = factor * self._law.epsilon_t

    def dissipation(self) -> float:
        """What slip turns into heat in the step to the present state [energy], this rank's share
        (collective).
        """
        if self._is_implicit:
            self._find_widest()
        return 0.0 if self._law.is_bonded else float(fem.assemble_scalar(self._dissipation))

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks
        (collective at first).
        """
        return self._at("room", self._point.room, points)()[..., 0]

    def _at(self, name: str, expression: Expr, points: np.ndarray) -> FacetValues:
        key = name, points.tobytes()
        if key not in self._expressions:
            facets = self.body.body_mesh.surfaces["top"]
            self._expressions[key] = FacetValues(self.body.mesh, facets, expression, points)
        return self._expressions[key]

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) at reference-facet points of the contact surface [pressure]."""
        body = self.body
        nodes = facet_nodes(
            body.mesh, body.unknowns.own_space("tau"), body.body_mesh.surfaces["top"]
        )
        places = np.stack(
            [places[nodes] for places in body.unknowns.components("tau").values()], axis=-1
        )
        return body.trace.values(body.local_array()[places], points)

    def force(self) -> float:
        """The virtual work of pressing deeper [force], this rank's share of the modelled part."""
        return float(fem.assemble_scalar(self._lift)) if self._lift else 0.0

    def side_force(self, axis: int) -> float:
        """Force on the tip along a horizontal axis [force], of pressure and friction, this rank's
        share.
        """
        return float(fem.assemble_scalar(self._side_forces[axis]))
