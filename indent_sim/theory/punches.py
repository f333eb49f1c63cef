"""Flat punches of every radius, which determine the load curve of a linear axisymmetric body.

Let K(a) be the force per depth of a flat punch of radius a that is bonded to the surface. The force
of a smooth tip with the contact radius a at the depth delta is

    F = K(a) delta - P(a),      P' = K' delta_1,      dF/ddelta = K(a),

where delta_1(a) is the depth of this contact without adhesion. The energy release rate at its edge
is G = (delta - delta_1)^2 K'(a)/(4 pi a). This is exact for every linear, frictionless,
axisymmetric body.

delta and force are > 0 in indentation. Lengths [L], forces [F].
Sources: Barthel (2008), J. Phys. D 41, 163001; Popov & Hess (2015), Method of Dimensionality
Reduction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import cheb2poly

from indent_sim.theory.layer import Layer
from indent_sim.theory.profiles import Tip
from indent_sim.theory.quadrature import gauss_legendre
from indent_sim.theory.roots import increasing_root

FIT_DEGREE = 7  # Degree of the polynomials of the radius that are fitted to ln K and ln P.
QUADRATURE_POINTS = 32  # Gauss points of the integral of g over each smooth piece of the tip.


@dataclass(frozen=True)
class Punch:
    """Flat punch of one radius, and the contact of the tip with the same radius.

    Attributes
    ----------
    a
        Radius of punch and contact [L].
    delta, force
        Depth delta_1 [L] and force [F] of the tip's contact without adhesion.
    stiffness, stiffness_slope
        Stiffness K [F/L] of the punch, and dK/da [F/L^2].
    """

    a: float
    delta: float
    force: float
    stiffness: float
    stiffness_slope: float


class Punches(Protocol):
    """Flat punches of any radius from `min_radius` to `max_radius` [L] on the body under a tip."""

    min_radius: float
    max_radius: float

    def punch_of_radius(self, a: float) -> Punch:
        """Return the punch of radius a [L]."""


def contact_radius(punches: Punches, delta: float, start_radius: float = 0.0) -> float:
    """Return the contact radius [L] of the tip at a depth [L] > 0 without adhesion.

    Parameters
    ----------
    punches
        Flat punches of the body.
    delta
        Depth [L].
    start_radius
        Radius [L] at which the search starts; 0 means a tenth of the largest radius.

    Raises
    ------
    ValueError
        If the contact radius is above the largest radius or below half the smallest radius.
    """
    start = start_radius if 0.0 < start_radius < punches.max_radius else 0.1 * punches.max_radius
    radius = increasing_root(
        lambda a: punches.punch_of_radius(a).delta, delta, start, punches.max_radius
    )
    if radius < 0.5 * punches.min_radius:
        raise ValueError(
            f"the contact radius {radius:g} is smaller than {punches.min_radius:g}, the smallest "
            "of the load curve"
        )
    return radius


class LayerPunches:
    """Flat punches of a layer theory, with the accuracy of the theory.

    The linear solution phi_1 for unit depth gives K = 2 E* h ∫ phi_1 and K' = 2 E* phi_1(a)^2.
    """

    def __init__(self, contact: Layer):
        self._layer = contact
        self.min_radius = 0.0
        self.max_radius = contact.max_size() * contact.h

    def punch_of_radius(self, a: float) -> Punch:
        """Return the punch of radius a [L]."""
        layer = self._layer
        h = layer.h
        E_star = layer.E_star
        linear = layer.linear_solution(a / layer.h)
        force = (
            2.0
            * E_star
            * h**2
            * float(
                linear.weights
                @ (linear.indentation_of_radius * linear.unit_depth - linear.tip_shape)
            )
        )
        stiffness = 2.0 * E_star * h * float(linear.weights @ linear.unit_depth)
        return Punch(
            a,
            linear.indentation_of_radius * h,
            force,
            stiffness,
            2.0 * E_star * linear.unit_depth_edge**2,
        )


class FittedPunches:
    """Flat punches fitted to the stiffness K and the force P that were computed on a mesh.

    Polynomials of the radius are fitted to ln K/K_0 and ln P/P_0, where K_0 = 2 E* a and P_0 = 2 E*
    ∫_0^a g are the values of a half-space, so that the ratios are smooth for any tip.

    Parameters
    ----------
    a
        Radii (n,) [L] in ascending order.
    K, P
        Stiffness [F/L] and force [F] of `punches` at these radii (n,).
    tip
        Profile of the tip.
    E_star
        E* of the half-space [F/L^2].
    degree
        Degree of the polynomials.

    Raises
    ------
    ValueError
        For fewer than six radii, or if no polynomial fits the data closely enough.
    """

    def __init__(
        self,
        a: np.ndarray,
        K: np.ndarray,
        P: np.ndarray,
        tip: Tip,
        E_star: float,
        degree: int = FIT_DEGREE,
    ):
        self._arguments = a, K, P, tip, E_star
        self._nodes = gauss_legendre(0.0, 1.0, QUADRATURE_POINTS)
        self._tip = tip
        self._E_star = E_star
        # The Abel transform g ends with the tip.
        a, K, P = (values[a < tip.max_radius] for values in (a, K, P))
        P_0 = np.array([self._half_space_force(radius) for radius in a])
        # Radii on the flat part of a punch with a rounded edge have P = 0.
        is_curved = 1e-9 * P_0.max(initial=0.0) < P_0
        # Radii that a fit needs.
        fewest_radii = 6
        if np.count_nonzero(is_curved) < fewest_radii:
            raise ValueError(
                f"{np.count_nonzero(is_curved)} contact radii are too few for a fit, which needs "
                f"{fewest_radii} or more"
            )
        # A punch that is pushed has a positive stiffness and force. Where a facet at the end of the
        # surface makes one negative, this radius and the larger ones are left out.
        is_negative = is_curved & ((K <= 0.0) | (P <= 0.0))
        is_curved &= ~np.logical_or.accumulate(is_negative)
        a = a[is_curved]
        K = K[is_curved]
        P = P[is_curved]
        P_0 = P_0[is_curved]
        log_ratios = np.log([K / (2.0 * E_star * a), P / P_0])
        n = len(a)
        misfit = math.inf
        # Towards the wall of an incompressible body K grows without bound: no polynomial
        # approximates it there, so that the largest radii are left out one part after the other
        # until the misfit is 1 %.
        while misfit > 0.01:
            if n < fewest_radii:
                raise ValueError(
                    "the stiffness of flat punches is too irregular for a fit: give a smaller "
                    "mesh.h_contact"
                )
            # Every radius is uncertain by the same part of an element, so that the relative error
            # is inversely proportional to the radius.
            weights = a[:n] / a[n - 1]
            power = min(degree, n // 2)
            ln_K, ln_P = (
                Chebyshev.fit(a[:n], values[:n], power, w=weights) for values in log_ratios
            )
            fits = zip((ln_K, ln_P), log_ratios, strict=True)
            misfit = max(np.max(weights * np.abs(fit(a[:n]) - values[:n])) for fit, values in fits)
            used_count = n
            n = int(0.95 * n)
        self.min_radius = float(a[0])
        self.max_radius = float(a[used_count - 1])
        # Both polynomials and their derivatives are evaluated together, for every row at several
        # radii.
        self._begin, self._scale = ln_K.mapparms()
        series = [
            cheb2poly(polynomial.coef) for polynomial in (ln_K, ln_P, ln_K.deriv(), ln_P.deriv())
        ]
        self._series = np.stack(
            [np.pad(polynomial, (0, len(ln_K.coef) - len(polynomial))) for polynomial in series],
            axis=1,
        )
        self._powers = np.arange(len(self._series))

    @property
    def neighbouring_fits(self) -> list[FittedPunches]:
        """Fits to the same data by polynomials of one degree lower and one degree higher."""
        return [
            FittedPunches(*self._arguments, degree) for degree in (FIT_DEGREE - 1, FIT_DEGREE + 1)
        ]

    def _half_space_force(self, a: float) -> float:
        """Return P_0(a) = 2 E* ∫_0^a g [F]."""
        if not self._tip.slope_discontinuities:
            s, w = self._nodes
            return 2.0 * self._E_star * a * float(w @ self._tip.g(a * s))
        ends = [0.0, *(b for b in self._tip.slope_discontinuities if b < a), a]
        pieces = (gauss_legendre(low, high, QUADRATURE_POINTS) for low, high in pairwise(ends))
        return 2.0 * self._E_star * sum(float(w @ self._tip.g(x)) for x, w in pieces)

    def punch_of_radius(self, a: float) -> Punch:
        """Return the punch of radius a [L]."""
        unit = 2.0 * self._E_star
        P_0 = self._half_space_force(a)
        log_K, log_P, dK, dP = (
            (self._begin + self._scale * a) ** self._powers @ self._series
        ).tolist()
        ratio_K = math.exp(log_K)
        ratio_P = math.exp(log_P)
        K = unit * a * ratio_K
        slope = unit * ratio_K * (1.0 + a * dK)
        P = P_0 * ratio_P
        delta = ratio_P * (unit * float(self._tip.g(np.array(a))) + P_0 * dP) / slope
        return Punch(a, delta, K * delta - P, K, slope)
