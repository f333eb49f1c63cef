"""A rigid parabolic roller that moves steadily over a relaxing half-plane, by a quadrature.

The reference solves Hunter's problem (J. Appl. Mech. 28, 611, 1961) without the program: in the
frame of the roller, which moves along x, a material point at x was at x + V s at the time s before.
With the creep compliance J(t) the surface displacement is that of an elastic half-plane under

    q(x) = int_0^infinity p(x + V s) dJ(s)

instead of the pressure p. The pressure is constant in cells, both integrals are exact for each
cell, and the cells in contact are found by an active set.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

CELLS = 400  # in the grid of the contact
TAIL = 12.0  # of the loads q behind the contact, in decay lengths


class SteadyRolling(NamedTuple):
    """Force per length, half of the contact's width, and where the force acts, in front > 0."""

    force: float
    a: float
    x_contact: float


def steady_rolling(
    force: float, R: float, E_star: float, fraction: float, decay: float
) -> SteadyRolling:
    """Solve for a given force per length.

    Parameters
    ----------
    force
        Force per length [force/length].
    R
        Radius of curvature of the roller [length].
    E_star
        Instantaneous contact modulus [pressure].
    fraction
        Fraction g of the modulus that relaxes: E(t)/E(0) = 1 - g + g exp(-t/tau).
    decay
        V tau, the way of the roller in the relaxation time [length].
    """
    # The contact is not wider than that on the relaxed half-plane, but it is shifted.
    reach = 1.6 * np.sqrt(4 * force * R / (np.pi * E_star * (1 - fraction)))
    h = 2 * reach / CELLS
    x = -reach + (np.arange(CELLS) + 0.5) * h
    # J(t) E(0) = 1 + g/(1 - g) (1 - exp(-t/tau_c)) with tau_c = tau/(1 - g)
    retardation = decay / (1 - fraction)
    tail = int(TAIL * retardation / h)
    loads = np.concatenate([x[0] - h * np.arange(tail, 0, -1), x])
    # The share of a cell of p in q at a point behind it decays with the distance.
    distance = x[None, :] - loads[:, None]
    ahead = np.exp(-np.maximum(distance - h / 2, 0) / retardation)
    ahead -= np.exp(-np.maximum(distance + h / 2, 0) / retardation)
    q_of_p = fraction / (1 - fraction) * ahead
    q_of_p += np.isclose(distance, 0)
    sink = log_cells(x[:, None] - loads[None, :], h) @ q_of_p * 2 / (np.pi * E_star)
    active = np.abs(x) < reach / 2
    for _ in range(200):
        n = int(active.sum())
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n] = sink[np.ix_(active, active)]
        matrix[:n, n] = -1.0  # the depth of the roller, to a constant
        matrix[n, :n] = h
        right = np.append(-(x[active] ** 2) / (2 * R), force)
        solution = np.linalg.solve(matrix, right)
        p = np.zeros(CELLS)
        p[active] = solution[:n]
        gap = x**2 / (2 * R) - solution[n] + sink @ p
        changed = active & (p >= 0) | ~active & (gap < 0)
        if (changed == active).all():
            break
        active = changed
    else:
        raise RuntimeError("the contact does not settle")
    return SteadyRolling(force, n * h / 2, float(h * (p @ x) / force))


def log_cells(distance: np.ndarray, h: float) -> np.ndarray:
    """Return -int ln|distance - s| ds over cells of the width h."""

    def antiderivative(s: np.ndarray) -> np.ndarray:
        return s * np.log(np.abs(s)) - s

    return antiderivative(distance - h / 2) - antiderivative(distance + h / 2)
