"""Frictionless indentation of an elastic layer, axisymmetric, to near machine precision in milliseconds.

The pressure is written as an Abel integral over phi, which turns the mixed boundary conditions into
    phi(x) - (2/pi) ∫_0^a phi(t) K(x, t) dt = (E*/pi) (delta - g(x)),  0 <= x <= a,
F = 2 pi ∫ phi, energy U = pi ∫ phi (delta - g), p(r) = phi(a)/sqrt(a^2-r^2) - ∫_r^a phi'(t)/sqrt(t^2-r^2) dt.
K is analytic, so a Gauss-Legendre Nystrom rule converges exponentially. For a given contact radius a
everything is linear: phi = delta phi_1 - phi_g, and phi(a) = 0 (smooth tips) gives delta(a); a root search
inverts that.

Small strain, gap at the reference radius. delta > 0 pushes in; force, pressure > 0 push. Any consistent
units.
Sources: Lebedev & Ufliand (1958), PMM 22, 442; Hayes et al. (1972), J. Biomech. 5, 541.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from indent_sim.theory.abel import contact_nodes, tip_pressure
from indent_sim.theory.hankel import Kernel, axisymmetric_kernel, gauss
from indent_sim.theory.march import LayerContact
from indent_sim.theory.profiles import Tip
from indent_sim.theory.solution import Solution


@dataclass(frozen=True)
class _Linear:
    """The two linear solutions at one contact radius, phi = delta one - shape, in units of h and E*/pi.

    one, shape and g at the quadrature points (weights w); *_modes are the amplitudes of the kernel's modes.
    """

    w: np.ndarray
    g: np.ndarray
    one: np.ndarray
    shape: np.ndarray
    one_edge: float
    shape_edge: float
    one_modes: np.ndarray
    shape_modes: np.ndarray
    kernel: Kernel

    @property
    def touch(self) -> float:
        """Depth at which phi vanishes at the edge: the depth of a smooth tip with this contact radius."""
        return self.shape_edge / self.one_edge


class Layer(LayerContact):
    """A layer under a tip of revolution; with a wall, a cylinder of that radius."""

    def profile(self, x: np.ndarray) -> np.ndarray:
        """g [h] of the tip."""
        return self.tip.g(x * self.h) / self.h

    def at(self, a: float) -> _Linear:
        """Solve the integral equation for unit depth and for the tip's shape at the contact radius a [h].

        The tip may have corners, phi - delta + g never has: only that smooth part is unknown, on a few Gauss
        points, while the tip enters through moments taken on its own finer points.
        """
        kernel = axisymmetric_kernel(a, self.nu, self.base, self.wall)
        x, w = gauss(0.0, a, self._smooth_count(a))
        B = kernel.basis(x)
        fine, fine_w = contact_nodes(a, [b / self.h for b in self.tip.breaks], self._tip_count(a))
        at_tip = kernel.basis(np.append(fine, a))
        g = self.profile(np.append(fine, a))
        source = np.column_stack([np.ones_like(g), g])

        factor = (2.0 / math.pi) * kernel.weight[:, None]
        direct = factor * (at_tip[:, :-1] @ (fine_w[:, None] * source[:-1]))
        project = factor * (B * w)
        modes = direct + project @ np.linalg.solve(np.eye(x.size) - B.T @ project, B.T @ direct)
        phi = source + at_tip.T @ modes
        return _Linear(
            fine_w,
            g[:-1],
            phi[:-1, 0],
            phi[:-1, 1],
            float(phi[-1, 0]),
            float(phi[-1, 1]),
            modes[:, 0],
            modes[:, 1],
            kernel,
        )

    def _smooth_count(self, a: float) -> int:
        # exponential convergence: the kernel is analytic 2h off the axis, singular where the contact meets
        # a wall
        return 20 + math.ceil(5.0 * a + 12.0 * math.sqrt(a / max(self.wall - a, 1e-4 * a)))

    def _tip_count(self, a: float) -> int:
        # the tip's own singularity is where it ends, next to the last panel
        last_panel = a - max((b / self.h for b in self.tip.breaks if b / self.h < a), default=0.0)
        rim = math.sqrt(last_panel / max(self.tip.reach / self.h - a, 1e-4 * last_panel))
        return self._smooth_count(a) + math.ceil(12.0 * rim)

    def solution(self, delta: float, a: float) -> Solution:
        """Turn the linear solutions at the contact radius a [h] into physical quantities."""
        depth, lin = delta / self.h, self.at(a)
        phi = depth * lin.one - lin.shape
        edge = depth * lin.one_edge - lin.shape_edge if self.tip.edge is not None else 0.0
        return Solution(
            delta=float(delta),
            force=2.0 * self.E_star * self.h**2 * float(lin.w @ phi),
            a=float(a * self.h),
            area=math.pi * (a * self.h) ** 2,
            energy=self.E_star * self.h**3 * float(lin.w @ (phi * (depth - lin.g))),
            stiffness=2.0 * self.E_star * self.h * float(lin.w @ lin.one),
            pressure=partial(_pressure, self, lin, a, edge, depth * lin.one_modes - lin.shape_modes),
        )


def indent(tip: Tip, delta: float, **body: Any) -> Solution:
    """Equilibrium of a layer under `tip` pushed in by delta [L]; no contact for delta <= 0.

    body: E, nu, thickness h, base, and wall, the radius [L] of a frictionless side wall (the body is then a cylinder);
    see `LayerContact.of` and, for the errors, `LayerContact.curve`.
    """
    return Layer.of(tip, **body).curve([delta])[0]


def _pressure(layer: Layer, lin: _Linear, a: float, edge: float, modes: np.ndarray, r) -> np.ndarray:
    """p(r) [F/L^2] from phi = delta - g + psi: the edge, the tip and the layer each add one Abel integral."""
    r = np.abs(np.asarray(r, dtype=float)) / layer.h
    flat = np.atleast_1d(r).ravel()
    inside = flat < a
    radius = flat[inside]
    chord = np.sqrt((a - radius) * (a + radius))
    value = edge / chord + _tip_part(layer, a, radius) + _layer_part(lin, a, modes, radius, chord)
    p = np.where((flat == a) & (edge > 0.0), np.inf, 0.0)
    p[inside] = layer.E_star / math.pi * value
    return p.reshape(r.shape)[()]


def _layer_part(lin: _Linear, a: float, modes: np.ndarray, r: np.ndarray, chord: np.ndarray) -> np.ndarray:
    """-∫_r^a psi'(t)/sqrt(t^2-r^2) dt; psi is even and analytic: t^2 = r^2 + chord^2 s^2 regularises it."""
    degree = 24 + math.ceil(8.0 * a)
    curvature = np.polynomial.Chebyshev.interpolate(
        lambda t: modes @ lin.kernel.slope_over_x(t), degree, domain=[0.0, a]
    )
    s, w = gauss(0.0, 1.0, 24 + math.ceil(4.0 * a))
    t = np.hypot(r[:, None], chord[:, None] * s)
    return -chord * (curvature(t) @ w)


def _tip_part(layer: Layer, a: float, r: np.ndarray) -> np.ndarray:
    """∫_r^a g'(t)/sqrt(t^2-r^2) dt, the half-space pressure of the tip; nothing for a flat one."""
    if layer.tip.edge is not None:
        return np.zeros_like(r)
    return tip_pressure(layer.profile, r, a, [b / layer.h for b in layer.tip.breaks], layer.tip.corner > 0.0)
