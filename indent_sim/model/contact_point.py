"""Coulomb friction at one point of the contact surface, also where contact begins or ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from indent_sim.model.algebra import Expr, macaulay, maximum, minimum, sqrt, where_less
from indent_sim.model.measured_constants import CLOSING_EXPONENT, CLOSING_FRACTION

# Components of a vector: a sequence, or the first axis of an array.
Vector = Expr
# Number [pressure^2] added to |t|^2, because the root has no derivative at zero.
TRACTION_FLOOR = 1e-30


@dataclass(frozen=True)
class CoulombPoint:
    """Coulomb's law at a point of the contact surface.

    The traction is t = t_hat where |t_hat| <= friction p (stick), and friction p t_hat/|t_hat|
    elsewhere (slip).

    Attributes
    ----------
    friction
        Coefficient of friction, or "stick".
    p
        Contact pressure, >= 0 [pressure].
    trial_traction
        Trial traction t_hat, one component for each axis [pressure].
    """

    friction: Expr
    p: Expr
    trial_traction: Vector

    @cached_property
    def trial_magnitude(self) -> Expr:
        """Magnitude |t_hat| [pressure], regularized so that it is > 0."""
        return length(self.trial_traction)

    @cached_property
    def slip_limit(self) -> Expr:
        """Slip limit friction p [pressure]; a very large number for "stick"."""
        return friction_bound(self.friction, self.p)

    @cached_property
    def stick_margin(self) -> Expr:
        """Stick margin friction p - |t_hat| [pressure], >= 0 at a point that sticks."""
        return self.slip_limit - self.trial_magnitude

    @cached_property
    def traction_ratio(self) -> Expr:
        """Ratio t/t_hat of the return mapping, which is 1 at a point that sticks."""
        return (
            1.0
            if isinstance(self.friction, str)
            else where_less(self.stick_margin, 0.0, self.slip_limit / self.trial_magnitude, 1.0)
        )

    def dissipation(self, t: Vector, slip: Vector, previous_pressure: Expr) -> Expr:
        """Return the frictional dissipation of an increment per area [pressure length], >= 0.

        The dissipation is t . slip, and 0 at a point that sticks. The slip limit is evaluated with
        the mean pressure (p + previous_pressure)/2, because the pressure changes during the
        increment; with the final pressure the sum over increments would be only first-order
        accurate.

        Parameters
        ----------
        t : Vector
            Tangential traction at the end of the increment [pressure].
        slip : Vector
            Slip during the increment [length].
        previous_pressure : Expr
            Contact pressure at the beginning of the increment [pressure].
        """
        mean_ratio = (self.p + previous_pressure) / (2 * maximum(self.p, TRACTION_FLOOR))
        return where_less(self.stick_margin, 0.0, mean_ratio, 0.0) * macaulay(dot(t, slip))


def friction_bound(friction: Expr, p: Expr) -> Expr:
    """Return the slip limit friction p [pressure] for p >= 0; a very large number for "stick"."""
    return 1e30 + 0.0 * p if isinstance(friction, str) else friction * p


def dissipation_on_separation(
    friction: Expr, previous_pressure: Expr, slip: Vector, step_fraction: Expr
) -> Expr:
    """Return the dissipation per area of a point that slips until separation [pressure length].

    The pressure is assumed to decrease linearly from `previous_pressure` to 0 during the slip.

    Parameters
    ----------
    friction : Expr
        Coefficient of friction, or "stick".
    previous_pressure : Expr
        Contact pressure at the beginning of the increment [pressure].
    slip : Vector
        Slip during the whole increment [length].
    step_fraction : Expr
        Fraction of the increment that remained at separation.
    """
    return friction_bound(friction, previous_pressure) / 2 * (1 - step_fraction) * length(slip)


def is_new_contact(initial_gap: Expr, depth_increment: Expr) -> Expr:
    """Return 1 if the gap [length] was open at the beginning of an increment, and 0 if not.

    A gap below 1e-6 times the depth increment [length] counts as closed, because the gap under a
    flat punch is zero up to round-off.
    """
    return where_less(1e-6 * abs(depth_increment), initial_gap, 1.0, 0.0)


def passed_gap(initial_gap: Expr, is_new: Expr, trial_pressure: Expr, stiffness: Expr) -> Expr:
    """Return the gap [length] closed or opened at points that changed contact; 0 at other points.

    Parameters
    ----------
    initial_gap : Expr
        Gap at the beginning of the increment, < 0 in contact [length].
    is_new : Expr
        1 at a point that was open at the beginning of the increment (`is_new_contact`), otherwise
        0.
    trial_pressure : Expr
        Trial multiplier at the end of the increment, > 0 in contact [pressure].
    stiffness : Expr
        Contact stiffness [pressure/length].
    """
    final_gap = where_less(initial_gap, 0.0, -trial_pressure / stiffness, 0.0)
    return where_less(0.0, trial_pressure, is_new * initial_gap, final_gap)


def step_fraction_at_contact(passed_gap: Expr, largest_gap: Expr) -> Expr:
    """Return the fraction of the load increment before a point came into contact.

    For a point that lost contact, it is the fraction of the increment after the separation. The
    estimate is CLOSING_FRACTION * (passed_gap/largest_gap)^CLOSING_EXPONENT.

    Parameters
    ----------
    passed_gap : Expr
        Gap that the point closed or opened in the increment [length]; see `passed_gap`.
    largest_gap : Expr
        Largest passed gap of all points [length].
    """
    return (
        CLOSING_FRACTION * maximum(0.0, minimum(passed_gap / largest_gap, 1.0)) ** CLOSING_EXPONENT
    )


def dot(a: Vector, b: Vector) -> Expr:
    """Return the scalar product of two vectors."""
    return sum(x * y for x, y in zip(a, b, strict=True))


def length(t: Vector) -> Expr:
    """Return the length of a vector, regularized so that it is > 0."""
    return sqrt(dot(t, t) + TRACTION_FLOOR)
