"""Coulomb friction at one point of the contact surface, and points that change contact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from indent_sim.model.algebra import Expr, macaulay, maximum, minimum, sqrt, where_less

Vector = Expr  # its components: a sequence, or an array whose first axis it is
UNBOUNDED = 1e30  # [pressure] no traction that sticks is as large
TRACTION_FLOOR = 1e-30  # [pressure^2] added to |t|^2, whose root has no slope at zero
# of a step's depth: a gap this small at its beginning is closed from then on, as under a flat punch
CLOSED_GAP = 1e-6
# A point that comes into contact while a gap `widest` closes has gone CLOSED_SHARE
# (gap/widest)^CLOSING of its way through the step when it touches, as if it were smooth. In
# self-similar contact of a paraboloid without slip the share rises from 0 at the old edge of
# contact to about 2/3 at the new one; these two leave the least error of the force over half-spaces
# and layers, stick and Coulomb's law.
CLOSING_FRACTION = 0.63
CLOSING_EXPONENT = 1 / 3


@dataclass(frozen=True)
class CoulombPoint:
    """Coulomb's law at a point: t = t_hat where |t_hat| <= friction p (stick), else friction p
    t_hat/|t_hat| (slip). friction: the coefficient, or `stick`; p: the pressure, >= 0
    [pressure]; t_hat: the trial traction, a component for each axis [pressure].
    """

    friction: Expr
    p: Expr
    trial_traction: Vector

    @cached_property
    def trial_magnitude(self) -> Expr:
        """|t_hat| [pressure], above zero."""
        return length(self.trial_traction)

    @cached_property
    def slip_limit(self) -> Expr:
        """friction p [pressure]; beyond all tractions for stick."""
        return friction_bound(self.friction, self.p)

    @cached_property
    def stick_margin(self) -> Expr:
        """friction p - |t_hat| [pressure], >= 0 at a point that sticks."""
        return self.slip_limit - self.trial_magnitude

    @cached_property
    def traction_ratio(self) -> Expr:
        """t/t_hat: 1 at a point that sticks."""
        return (
            1.0
            if isinstance(self.friction, str)
            else where_less(self.stick_margin, 0.0, self.slip_limit / self.trial_magnitude, 1.0)
        )

    def dissipation(self, t: Vector, slip: Vector, previous_pressure: Expr) -> Expr:
        """What slip turns into heat in a step [pressure length], >= 0: t . slid, 0 at a point that
        sticks. With friction (p + before)/2 in place of friction p, `previous_pressure` the pressure at the
        step's beginning: the bound grows on the way, and with that of the step's end alone the
        sum is only of first order in the steps.
        """
        mean_ratio = (self.p + previous_pressure) / (2 * maximum(self.p, TRACTION_FLOOR))
        return where_less(self.stick_margin, 0.0, mean_ratio, 0.0) * macaulay(dot(t, slip))


def friction_bound(friction: Expr, p: Expr) -> Expr:
    """friction p [pressure] of a pressure p >= 0; beyond all tractions for stick."""
    return UNBOUNDED + 0.0 * p if isinstance(friction, str) else friction * p


def dissipation_on_separation(
    friction: Expr, previous_pressure: Expr, slip: Vector, step_fraction: Expr
) -> Expr:
    """The heat of a point that slips until it leaves, with less and less pressure than `previous_pressure`
    [pressure length].
    """
    return friction_bound(friction, previous_pressure) / 2 * (1 - step_fraction) * length(slip)


def is_new_contact(initial_gap: Expr, depth_increment: Expr) -> Expr:
    """1 where a gap [length] was open at the beginning of a step of depth `depth_increment`, else 0; below
    zero is in contact.
    """
    return where_less(CLOSED_GAP * abs(depth_increment), initial_gap, 1.0, 0.0)


def passed_gap(initial_gap: Expr, is_new: Expr, trial_pressure: Expr, stiffness: Expr) -> Expr:
    """The gap [length] that closed, or opened, during a step at a point that came into contact, or
    left; else 0.
    """
    final_gap = where_less(initial_gap, 0.0, -trial_pressure / stiffness, 0.0)
    return where_less(0.0, trial_pressure, is_new * initial_gap, final_gap)


def step_fraction_at_contact(passed_gap: Expr, largest_gap: Expr) -> Expr:
    """How much of its way through the step a new point had gone when it touched, one that left had
    yet to go.
    """
    return (
        CLOSING_FRACTION * maximum(0.0, minimum(passed_gap / largest_gap, 1.0)) ** CLOSING_EXPONENT
    )


def dot(a: Vector, b: Vector) -> Expr:
    """The sum of the products of components."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def length(t: Vector) -> Expr:
    """The length of a vector, above zero."""
    return sqrt(dot(t, t) + TRACTION_FLOOR)
