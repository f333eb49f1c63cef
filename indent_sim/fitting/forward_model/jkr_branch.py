"""Stable branch of an adhesive tip in the JKR limit, and its derivatives by the parameters.

    delta = delta_1 - q,   F = A (F_1 - K q),   x = delta + C F,   q^2 = 4 pi a w/(A K')

The contact radius a parametrizes the branch. Depth delta_1 and force F_1 are those without
adhesion, K(a) is the stiffness of a flat punch and K' its derivative, w the work of adhesion, A the
factor of all moduli and C the compliance of the spring (Johnson 1985, sec. 5.5). At a displacement
x of the base, a parameter changes the force by dF - (dF/dx) dx, with the changes dF and dx at
constant contact radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from indent_sim.fitting.forward_model.elastic_load_curve import PunchTable


@dataclass(frozen=True)
class JkrBranch:
    """Force over the displacement of the base, linear between the contacts of given radii.

    The branch ends at pull-off: a sample beyond it has the force at pull-off. Beyond the largest
    contact the force is continued linearly.

    Attributes
    ----------
    punches
        Flat punches of all contact radii (m,), also of unstable contacts.
    scale
        Factor A of all moduli.
    work
        Work of adhesion at the largest contact [force/length].
    work_exponent
        Exponent m of the work of adhesion at other contacts, work (radius/largest radius)^m.
    compliance
        Compliance C of the spring [length/force].
    """

    punches: PunchTable
    scale: float
    work: float
    work_exponent: float
    compliance: float

    @cached_property
    def _shift(self) -> np.ndarray:
        """Difference q (m,) of the depths without and with adhesion [length]."""
        work = self.work * np.exp(self.work_exponent * self.punches.log_radius)
        squares = 4.0 * np.pi * self.punches.radius * work / (self.scale * self.punches.slope)
        shift: np.ndarray = np.sqrt(squares)
        return shift

    @cached_property
    def contacts(self) -> np.ndarray:
        """Displacements of the base [length] and forces [force] of all contacts (2, m)."""
        force = self.scale * (self.punches.force - self.punches.stiffness * self._shift)
        return np.array([self.punches.depth - self._shift + self.compliance * force, force])

    @cached_property
    def _first_stable(self) -> int:
        """Index of the first stable contact, at pull-off.

        If fewer than two of the contacts are stable, because the adhesion is strong, it is the
        index of the last but one, so that the branch has two points.
        """
        unstable_points = np.flatnonzero(np.diff(self.contacts[0]) <= 0)
        first_stable = int(unstable_points[-1]) + 1 if len(unstable_points) else 0
        return min(first_stable, self.contacts.shape[1] - 2)

    @property
    def largest_displacement(self) -> float:
        """Displacement of the base at the largest contact [length]."""
        return float(self.contacts[0, -1])

    def is_in_contact(self, x: np.ndarray) -> np.ndarray:
        """Return True for the displacements (..., n) from x = 0 until pull-off."""
        has_touched = np.logical_or.accumulate(x >= 0.0, axis=-1)
        is_in_contact: np.ndarray = has_touched & (x >= self.contacts[0, self._first_stable])
        return is_in_contact

    def force(self, x: np.ndarray) -> np.ndarray:
        """Return the forces at displacements (..., n) of the base."""
        displacement, force = self.contacts[:, self._first_stable :]
        rise = max(displacement[-1] - displacement[-2], 1e-300)
        stiffness = (force[-1] - force[-2]) / rise
        beyond = np.maximum(x - displacement[-1], 0.0)
        forces: np.ndarray = np.interp(x, displacement, force) + stiffness * beyond
        return forces

    def derivatives(self, x: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Return the derivatives of the force by k parameters, and -dF/dx as the last row.

        Parameters
        ----------
        x
            Displacements (n,) of the base [length].
        changes
            Changes (k, 2, m) of displacement and force of all contacts by each parameter.
        """
        displacement, force = self.contacts[:, self._first_stable :]
        rises = np.diff(displacement)
        # The last two contacts are unstable if no contact is stable.
        rises[rises <= 0.0] = math.inf
        line = np.clip(np.searchsorted(displacement, x, "right") - 1, 0, len(rises) - 1)
        u = np.maximum((x - displacement[line]) / rises[line], 0.0)
        slope = np.where(x < displacement[0], 0.0, np.diff(force)[line] / rises[line])
        begin = line + self._first_stable
        at_x = (1.0 - u) * changes[..., begin] + u * changes[..., begin + 1]
        return np.vstack([at_x[:, 1] - slope * at_x[:, 0], -slope])

    def change_by_modulus(self) -> np.ndarray:
        """Return the change (2, m) of displacement and force by ln A."""
        return self._change(-0.5 * self._shift, self.contacts[1])

    def change_by_work(self) -> np.ndarray:
        """Return the change (2, m) of displacement and force by ln w."""
        return self._change(0.5 * self._shift)

    def change_by_work_exponent(self) -> np.ndarray:
        """Return the change (2, m) of displacement and force by the exponent of the radius."""
        return self._change(0.5 * self._shift * self.punches.log_radius)

    def change_by_compliance(self) -> np.ndarray:
        """Return the change (2, m) of displacement and force by C."""
        return np.array([self.contacts[1], np.zeros_like(self.contacts[1])])

    def _change(self, shift: np.ndarray, force: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the change (2, m) due to one of q, and to one of the force at constant q."""
        force_change = force - self.scale * self.punches.stiffness * shift
        return np.array([self.compliance * force_change - shift, force_change])
