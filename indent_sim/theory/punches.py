"""Bonded flat punches of every radius: the one function of a linear axisymmetric body that its load
curve is made of.

With K(a) the force per depth of a flat punch of radius a that cannot lift off, a smooth tip that
touches a circle of radius a at the depth delta is pushed with

    F = K(a) delta - P(a),      P' = K' delta_1,      dF/ddelta = K(a),

delta_1(a) being the depth at which it does so without adhesion, and the energy release rate of its
edge is G = (delta - delta_1)^2 K'(a)/(4 pi a). Exact for every linear, frictionless, axisymmetric
body.

delta > 0 pushes in, force > 0 pushes. Lengths [L], forces [F]. Sources: Barthel (2008), J. Phys. D
41, 163001; Popov & Hess (2015), Method of Dimensionality Reduction.
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

FIT_DEGREE = 7  # of ln K and ln P over the radius: 3 and 7 are worse on noisy curves, 9 much
MAX_MISFIT = 0.01  # of K and P: fits that miss one by more are of fewer radii
FEWEST_RADII = 6  # that a fit needs at least
FLAT_TIP_FORCE = 1e-9  # of P at the largest radius: less is that of a flat part of the tip
QUADRATURE_POINTS = 32  # points of the integral of g on each smooth piece of the tip


@dataclass(frozen=True)
class Punch:
    """One contact radius a [L]: the tip's depth delta_1 [L] and force [F] there without adhesion,
    the punch's stiffness K [F/L] and its slope dK/da [F/L^2].
    """

    a: float
    delta: float
    force: float
    stiffness: float
    stiffness_slope: float


class Punches(Protocol):
    """The punches of a tip and a body, at any radius between `smallest` and `largest` [L]."""

    min_radius: float
    max_radius: float

    def punch_of_radius(self, a: float) -> Punch:
        """The punch of radius a [L]."""


def contact_radius(punches: Punches, delta: float, start_radius: float = 0.0) -> float:
    """Contact radius [L] of the tip at a depth [L] > 0, without adhesion, sought from one `start_radius`
    it. ValueError where it would be beyond `largest`, or below half of `smallest`, of which
    nothing is known.
    """
    start = start_radius if 0.0 < start_radius < punches.max_radius else 0.1 * punches.max_radius
    radius = increasing_root(
        lambda a: punches.punch_of_radius(a).delta, delta, start, punches.max_radius
    )
    if radius < 0.5 * punches.min_radius:
        raise ValueError(f"the contact radius {radius:g} is smaller than those that are known")
    return radius


class LayerPunches:
    """Punches of a layer theory, to its own digits: K = 2 E* h int one, K' = 2 E* one(a)^2 of its
    linear solutions.
    """

    def __init__(self, contact: Layer):
        self._layer = contact
        self.min_radius = 0.0
        self.max_radius = contact.max_size() * contact.h

    def punch_of_radius(self, a: float) -> Punch:
        """The punch of radius a [L]."""
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
    """Punches of a body that is known by K and P at some radii only, as from a mesh.

    Fitted are ln K/K_0 and ln P/P_0 as polynomials of the radius, K_0 = 2 E* a and P_0 = 2 E*
    int_0^a g being those of the tip on a half-space: what is left is smooth, whatever the tip.
    radii a, K, P (n,); g the tip's Abel transform. ValueError for less than `FEWEST_RADII` radii.
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
        a, K, P = (
            values[a < tip.max_radius] for values in (a, K, P)
        )  # beyond its end g is unknown
        P_0 = np.array([self._half_space_force(radius) for radius in a])
        is_curved = (
            FLAT_TIP_FORCE * P_0.max(initial=0.0) < P_0
        )  # a punch's rounded edge begins somewhere
        if np.count_nonzero(is_curved) < FEWEST_RADII:
            raise ValueError(
                f"{np.count_nonzero(is_curved)} radii are too few to be smoothed, at least "
                f"{FEWEST_RADII}"
            )
        a = a[is_curved]
        K = K[is_curved]
        P = P[is_curved]
        P_0 = P_0[is_curved]
        log_ratios = np.log([K / (2.0 * E_star * a), P / P_0])
        n = len(a)
        misfit = math.inf
        # towards the wall of a sealed body K grows without bound, and no polynomial follows
        while misfit > MAX_MISFIT:
            if n < FEWEST_RADII:
                raise ValueError("the punches are too rough to be smoothed")
            # what is wrong is a part of an element everywhere
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
        # both and their derivatives in one: every row asks for several radii
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
        """By polynomials of the degrees beside its own."""
        return [
            FittedPunches(*self._arguments, degree) for degree in (FIT_DEGREE - 1, FIT_DEGREE + 1)
        ]

    def _half_space_force(self, a: float) -> float:
        """P_0(a) = 2 E* int_0^a g [F]."""
        if not self._tip.slope_discontinuities:
            s, w = self._nodes
            return 2.0 * self._E_star * a * float(w @ self._tip.g(a * s))
        ends = [0.0, *(b for b in self._tip.slope_discontinuities if b < a), a]
        pieces = (gauss_legendre(low, high, QUADRATURE_POINTS) for low, high in pairwise(ends))
        return 2.0 * self._E_star * sum(float(w @ self._tip.g(x)) for x, w in pieces)

    def punch_of_radius(self, a: float) -> Punch:
        """The punch of radius a [L]."""
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
