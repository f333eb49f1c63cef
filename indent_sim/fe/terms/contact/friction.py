"""Coulomb friction, or contact without slip, by the augmented Lagrangian method.

The tangential traction t on the body along the unit tangents m_k of the tip is (Alart & Curnier
1991)

    t_hat = tau - epsilon_t s,
    t = t_hat                         where |t_hat| <= friction p   (stick),
    t = friction p t_hat/|t_hat|      elsewhere                     (slip),

with the pressure p = <p_hat> and the multiplier tau; t = 0 out of contact, and t = t_hat without
limit for bonded contact. The slip s of the body along the tip is

    s_k = u_k - u0_k - (x_k - x0_k)                              reference gap,
    s_k = m_k . (u - u0 + (delta - delta0) e_z - (x - x0))       current gap,

with the horizontal position x of the tip. The slip is counted from the slip reference u0, delta0,
x0. For points in contact at the last
equilibrium the reference is that equilibrium; for other points see `SlipReference` in
`model.contact`. A penalty law uses tau of the last equilibrium: the part (tau - t)/epsilon_t of s
is reversible, and the remaining (t - t_hat)/epsilon_t is slip.

Friction has no potential. The virtual work is

    - int t . ds    and, for the multiplier,    int (t - tau)/epsilon_t . dtau,

and its derivative is not symmetric. The path dependence is contained in the multipliers of the last
equilibrium; there are no internal variables at quadrature points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.facet_values import FacetValues, facet_nodes
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.terms.contact.gap import Gap
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field, TimeLevel, components
from indent_sim.model.algebra import maximum, where_less
from indent_sim.model.contact import SlipReference
from indent_sim.model.contact_point import (
    CoulombPoint,
    dissipation_on_separation,
    dot,
    is_new_contact,
    passed_gap,
    step_fraction_at_contact,
)
from indent_sim.scene.scene import Scene


def fields(scene: Scene) -> list[Field]:
    """Return the field of the tangential multiplier tau, one component for each horizontal axis."""
    if scene.physics.contact.is_conservative:
        return []
    along = tuple(range(scene.physics.domain.dim - 1))
    return [
        Field("tau", DISPLACEMENT_ORDER, axes=along, domain="top", weight=stiffness_scale(scene))
    ]


class Friction(Term):
    """Tangential traction of a frictional contact with stick and slip.

    Parameters
    ----------
    body : Body
        Discrete body.
    normal : Traction
        Term of the normal pressure, which bounds the tangential traction.
    """

    field_names = ("tau",)
    has_memory = True
    has_symmetric_tangent = False

    def __init__(self, body: Body, normal: Traction):
        self.body = body
        self._law: Any = body.scene.physics.contact
        self._is_implicit = (
            body.scene.physics.slip_reference == "implicit" and not self._law.is_bonded
        )
        self._slip_start = fem.Function(body.unknowns.space)
        self._slip_start_depth = fem.Constant(body.mesh, 0.0)
        self._slides = body.scene.physics.slides
        self._slip_start_center = [
            fem.Constant(body.mesh, float(c)) for c in body.scene.physics.center
        ]
        self._largest_passed_gap = fem.Constant(body.mesh, 1.0)
        # 0 where points that newly come into contact slip without friction
        self._new_contact_sticks = fem.Constant(body.mesh, 1.0)
        self._epsilon_t = fem.Constant(body.mesh, float(self._law.epsilon_t))
        self._tangents = normal.gap.tangents
        self._expressions: dict[tuple[str, bytes], FacetValues] = {}
        now = body.now
        before = body.before
        law = normal.symbolic_law
        p_hat = normal.trial_pressure
        initial_gap = (
            -law.trial_pressure(Gap(body, before).g, before.fields.get("lam", 0.0)) / law.stiffness
        )
        is_new = is_new_contact(initial_gap, now.delta - before.delta)
        self._passed_gap = passed_gap(initial_gap, is_new, p_hat, law.stiffness)
        touch_fraction = is_new * step_fraction_at_contact(initial_gap, self._largest_passed_gap)
        self._tau = components(now.fields["tau"])
        tau = self._tau if self._law.multiplier == "unknown" else components(before.fields["tau"])
        trial_traction = [
            tau_k - self._epsilon_t * slip
            for tau_k, slip in zip(tau, self._slip(touch_fraction), strict=True)
        ]
        self._coulomb_point = point = CoulombPoint(law.friction, normal.pressure, trial_traction)
        carries_traction = where_less(0.0, p_hat, 1 - is_new * (1 - self._new_contact_sticks), 0.0)
        self._traction = [
            carries_traction * point.traction_ratio * t_hat for t_hat in trial_traction
        ]
        slip_values = self._traction_slip(trial_traction)
        step_slip = self._slip(0.0)
        p_before = law.stiffness * maximum(0.0, -initial_gap)
        if self._is_implicit:
            # A new contact point slips from where it touched, not from where the step began
            slip_values = [
                slip_k + touch_fraction * step_slip_k
                for slip_k, step_slip_k in zip(slip_values, step_slip, strict=True)
            ]
        heat = point.dissipation(self._traction, slip_values, p_before)
        if self._is_implicit:
            leave_fraction = step_fraction_at_contact(self._passed_gap, self._largest_passed_gap)
            heat += where_less(
                0.0,
                p_hat,
                0.0,
                dissipation_on_separation(law.friction, p_before, step_slip, leave_fraction),
            )
        self._dissipation = compile_form(body.contact_integral(heat))
        vertical = body.body_mesh.dim - 1
        # If the tip slides, the term of the pressure contains its own part of the side force.
        pushes = [
            0.0 if self._slides else -normal.pressure * normal.gap.normal[axis]
            for axis in range(vertical)
        ]
        side_tractions = [push - self._traction_component(axis) for axis, push in enumerate(pushes)]
        self._side_force_forms = [
            compile_form(body.contact_integral(push)) for push in side_tractions
        ]
        # The tangents of a reference gap are horizontal, so that friction has no vertical force
        is_reference_gap = body.scene.physics.gap == "reference"
        self._vertical_force_form = (
            None
            if is_reference_gap
            else compile_form(body.contact_integral(-self._traction_component(vertical)))
        )
        self._moment_form = None
        if body.scene.physics.has_moment and not is_reference_gap:
            self._moment_form = compile_form(
                body.contact_integral(-self._traction_component(vertical) * normal.gap.lever)
            )

    def _slip(self, fraction: Expr | float) -> list[Expr]:
        """Slip components s_k [length] from the slip reference.

        Parameters
        ----------
        fraction : Expr or float
            Position of the reference between the last equilibrium (0) and the slip start (1).
        """
        now = self.body.now
        before = self.body.before
        dim = self.body.body_mesh.dim
        displacement_before = before.fields["u"]
        start_displacement = self.body.unknowns.split_fields(self._slip_start)["u"]
        displacement = (
            now.fields["u"]
            - displacement_before
            - fraction * (start_displacement - displacement_before)
        )
        if self.body.scene.physics.gap == "current":
            depth_change = (
                now.delta - before.delta - fraction * (self._slip_start_depth - before.delta)
            )
            displacement += ufl.as_vector([0.0] * (dim - 1) + [depth_change])
        if self._slides:
            tip_motion = [
                now.center[axis]
                - before.center[axis]
                - fraction * (self._slip_start_center[axis] - before.center[axis])
                for axis in range(dim - 1)
            ]
            displacement -= ufl.as_vector([*tip_motion, 0.0])
        return [ufl.dot(m, displacement) for m in self._tangents]

    def _traction_slip(self, tau: list[Expr]) -> list[Expr]:
        """Components of the elastic part of the slip, (tau - t)/epsilon_t [length]."""
        return [(tau_k - t) / self._epsilon_t for tau_k, t in zip(tau, self._traction, strict=True)]

    def _traction_component(self, axis: int) -> Expr:
        return dot(self._traction, [m[axis] for m in self._tangents])

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Virtual work of the traction and of its multiplier, a UFL form."""
        test_fields = self.body.unknowns.split_fields(now.test)
        slips = [ufl.dot(m, test_fields["u"]) for m in self._tangents]
        virtual = -dot(self._traction_slip(self._tau), components(test_fields["tau"])) - dot(
            self._traction, slips
        )
        return self.body.contact_integral(virtual)

    def set_slip_reference(self, slip_reference: SlipReference) -> None:
        """Set the slip reference of new contact points (collective).

        See `fe.solve.slip_reference`.
        """
        if slip_reference == "mid":
            self._find_largest_passed_gap()
        start = self.body.now if slip_reference == "mid" else self.body.before
        self._slip_start.x.array[:] = start.function.x.array
        self._slip_start_depth.value = start.delta.value
        for constant, c in zip(self._slip_start_center, start.center, strict=True):
            constant.value = c.value
        self._new_contact_sticks.value = float(slip_reference != "glue")

    def _find_largest_passed_gap(self) -> None:
        passed = self._facet_values(
            "passed_gap", self._passed_gap, contact_quadrature(self.body.body_mesh.dim)[0]
        )()
        self._largest_passed_gap.value = (
            self.body.comm.allreduce(float(passed.max(initial=0.0)), op=MPI.MAX) or 1.0
        )

    def scale_stiffness(self, factor: float) -> None:
        """Set the tangential penalty stiffness to `factor` times epsilon_t of the contact law."""
        self._epsilon_t.value = factor * self._law.epsilon_t

    def dissipation(self) -> float:
        """Energy dissipated by slip in the current increment, this rank's part (collective)."""
        if self._is_implicit:
            self._find_largest_passed_gap()
        return 0.0 if self._law.is_bonded else float(fem.assemble_scalar(self._dissipation))

    def stick_margin_at(self, points: np.ndarray) -> np.ndarray:
        """Stick margin (facets, points): slip limit minus trial traction [pressure].

        It is >= 0 where points stick. The first call for a set of points is collective.
        """
        return self._facet_values("stick_margin", self._coulomb_point.stick_margin, points)()[
            ..., 0
        ]

    def _facet_values(self, name: str, expression: Expr, points: np.ndarray) -> FacetValues:
        cache_key = name, points.tobytes()
        if cache_key not in self._expressions:
            facets = self.body.body_mesh.surfaces["top"]
            self._expressions[cache_key] = FacetValues(self.body.mesh, facets, expression, points)
        return self._expressions[cache_key]

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """Multiplier tau (facets, points, axes) at reference-facet points [pressure]."""
        body = self.body
        nodes = facet_nodes(
            body.mesh, body.unknowns.collapsed_space("tau"), body.body_mesh.surfaces["top"]
        )
        shear_dofs = np.stack(
            [shear_dofs[nodes] for shear_dofs in body.unknowns.component_dofs("tau").values()],
            axis=-1,
        )
        return body.trace.interpolate(body.local_array()[shear_dofs], points)

    def force(self) -> float:
        """Vertical force of friction on the tip [force], this rank's part in the model domain."""
        return (
            float(fem.assemble_scalar(self._vertical_force_form))
            if self._vertical_force_form
            else 0.0
        )

    def moment(self) -> float:
        """Moment of the vertical force of friction [force length], this rank's part."""
        return float(fem.assemble_scalar(self._moment_form)) if self._moment_form else 0.0

    def side_force(self, axis: int) -> float:
        """Horizontal force on the tip [force], this rank's part.

        It is the force of pressure and friction. If the tip slides, it is the force of friction
        alone, because `Traction` then evaluates that of the pressure.
        """
        return float(fem.assemble_scalar(self._side_force_forms[axis]))
