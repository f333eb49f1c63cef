"""Homogeneous compression of a prism between two planes that let it slide: the theory of a plate on
a flat top.

The plate moves down by delta, the base stays, every side is either free or slides along a wall.
Then the stretch along z is 1 - delta/h everywhere, the sides that are free carry no traction, and
the force is the nominal stress times the undeformed area. This is exact at any strain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from indent_sim.theory.profiles import Tip, flat_punch
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.solution import Solution, no_contact

# Step of the differences, in logarithmic strain. The five-point formula errs by STEP^4/30 of the
# fifth derivative, 3e-14 of a modulus, and by 1e-16/STEP of one in rounding: stresses have ten
# digits from a strain of 1e-3 on
DIFFERENCE_STEP = 1e-3
# logarithmic strain left by Newton's method, and its rounds at most
STRAIN_TOLERANCE = 1e-13
MAX_NEWTON_STEPS = 50
TANGENT_STEP = 1e-4  # of the strain over which the tangent modulus is a difference
# psi(l1, l2, l3) [F/L^2]: the strain energy of the principal stretches, the last one along z
Energy = Callable[[float, float, float], float]


class Bar(Protocol):
    """What a bar does at a strain e = delta/h along its axis."""

    def stress(self, strain: float) -> float:
        """Nominal pressure [F/L^2] on its ends, > 0 in compression."""

    def energy(self, strain: float) -> float:
        """Strain energy per undeformed volume [F/L^2]."""

    def tangent_modulus(self, strain: float) -> float:
        """d stress/d strain [F/L^2]."""

    def area_ratio(self, strain: float) -> float:
        """Area of its ends over that at rest."""


@dataclass(frozen=True)
class LinearBar:
    """A bar at small strain: stress = modulus e, and its ends keep their area."""

    modulus: float

    def stress(self, strain: float) -> float:
        """Modulus times strain [F/L^2]."""
        return self.modulus * strain

    def energy(self, strain: float) -> float:
        """Modulus strain^2/2 [F/L^2]."""
        return self.modulus * strain**2 / 2

    def tangent_modulus(self, strain: float) -> float:
        """The modulus [F/L^2]."""
        return self.modulus

    def area_ratio(self, strain: float) -> float:
        """Small strain does not change the area."""
        return 1.0


@dataclass(frozen=True)
class HyperelasticBar:
    """A bar at finite strain, by the strain energy of its principal stretches.

    Parameters
    ----------
    psi
        Strain energy of the principal stretches [F/L^2].
    is_incompressible
        Whether the product of the stretches is one; psi may be anything for others then.
    held
        How many of the two directions across the bar keep their length: 0, 1 or 2.

    Of the Kirchhoff stresses tau_i = d psi/d ln l_i those across a free direction are zero, which
    determines the stretch there; the nominal stress along the bar is tau_3/l_3 (Holzapfel 2000,
    Nonlinear Solid Mechanics, 6.2).
    """

    psi: Energy
    is_incompressible: bool
    confined_directions: int = 0

    def stress(self, strain: float) -> float:
        """Nominal pressure [F/L^2]; ValueError where the bar has no equilibrium."""
        axial_strain = math.log1p(-strain)
        if self.is_incompressible:
            slope = _first_derivative(
                lambda e: self._energy(self._lateral_strain(e), e), axial_strain
            )
        else:
            lateral_strain = self._lateral_strain(axial_strain)
            slope = _first_derivative(lambda e: self._energy(lateral_strain, e), axial_strain)
        return -slope / math.exp(axial_strain)

    def energy(self, strain: float) -> float:
        """Strain energy per undeformed volume [F/L^2]."""
        axial_strain = math.log1p(-strain)
        return self._energy(self._lateral_strain(axial_strain), axial_strain)

    def tangent_modulus(self, strain: float) -> float:
        """d stress/d strain [F/L^2]."""
        step = TANGENT_STEP * (1 - strain)
        return (self.stress(strain + step) - self.stress(strain - step)) / (2 * step)

    def area_ratio(self, strain: float) -> float:
        """Product of the two stretches across the bar."""
        free_directions = 2 - self.confined_directions
        return math.exp(free_directions * self._lateral_strain(math.log1p(-strain)))

    def _energy(self, lateral_strain: float, axial_strain: float) -> float:
        """psi [F/L^2] at logarithmic strains of the free directions and along the bar."""
        lateral_stretch = math.exp(lateral_strain)
        return float(
            self.psi(
                lateral_stretch,
                lateral_stretch if self.confined_directions == 0 else 1.0,
                math.exp(axial_strain),
            )
        )

    def _lateral_strain(self, axial_strain: float) -> float:
        """The logarithmic strain of the free directions."""
        if self.confined_directions == 2:
            if self.is_incompressible and axial_strain != 0:
                raise ValueError("an incompressible body between walls cannot be compressed")
            return 0.0
        if self.is_incompressible:
            return -axial_strain / (2 - self.confined_directions)
        lateral_strain = 0.0
        for _ in range(MAX_NEWTON_STEPS):
            slope = _first_derivative(lambda e: self._energy(e, axial_strain), lateral_strain)
            curvature = _second_derivative(lambda e: self._energy(e, axial_strain), lateral_strain)
            if not (curvature > 0 and math.isfinite(slope)):
                break
            lateral_strain -= slope / curvature
            if abs(slope) <= STRAIN_TOLERANCE * curvature:
                return lateral_strain
        raise ValueError("the bar has no equilibrium at this strain")


def _first_derivative(function: Callable[[float], float], x: float) -> float:
    """First derivative by the five-point formula."""
    near_difference = function(x + DIFFERENCE_STEP) - function(x - DIFFERENCE_STEP)
    far_difference = function(x + 2 * DIFFERENCE_STEP) - function(x - 2 * DIFFERENCE_STEP)
    return (8 * near_difference - far_difference) / (12 * DIFFERENCE_STEP)


def _second_derivative(function: Callable[[float], float], x: float) -> float:
    """Second derivative by three points."""
    return (
        function(x + DIFFERENCE_STEP) - 2 * function(x) + function(x - DIFFERENCE_STEP)
    ) / DIFFERENCE_STEP**2


@dataclass(frozen=True)
class Compression:
    """A prism of one bar's law between planes.

    Parameters
    ----------
    bar
        What it does at a strain.
    height
        Height at rest [L].
    area
        Area of its top at rest [L^2]; in plane strain its width [L].
    dimensions
        2, or 1 in plane strain: how many of the top's directions are measured.
    widest
        Area of the top over that at rest, up to which it stays on the tip: a punch has an edge.
    """

    bar: Bar
    height: float
    area: float
    dimensions: int = 2
    max_area_ratio: float = math.inf

    @property
    def tip(self) -> Tip:
        """A flat punch as large as the top: its contact does not grow with the depth."""
        return flat_punch(self._radius(self.area))

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """One Solution per depth [L], none for a depth <= 0.

        Raises
        ------
        ValueError
            Where a depth is beyond the height, the bar has no equilibrium there, or the top bulges past the tip.
        """
        return [
            self._solution_at_depth(delta) if delta > 0 else no_contact(delta) for delta in deltas
        ]

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """One Solution per force [F], none for a force <= 0; errors as `curve`."""
        return self.solutions_at_depths(
            [self.depth_of_force(force) if force > 0 else 0.0 for force in forces]
        )

    def depth_of_force(self, force: float) -> float:
        """The depth [L] at which the force is this one [F] > 0; ValueError where there is none."""
        start = min(
            force * self.height / (self.bar.tangent_modulus(0.0) * self.area), 0.5 * self.height
        )
        return increasing_root(
            lambda delta: self._solution_at_depth(delta).force, force, start, self.height
        )

    def solutions_up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Solutions at even steps of the depth up to a known one."""
        return self.solutions_at_depths(list(deepest.delta * np.arange(1, count + 1) / count))

    def _solution_at_depth(self, delta: float) -> Solution:
        strain = delta / self.height
        if not strain < 1:
            raise ValueError(f"the depth {delta:g} is beyond the height {self.height:g}")
        area_ratio = self.bar.area_ratio(strain)
        if area_ratio > self.max_area_ratio:
            raise ValueError(f"at the depth {delta:g} the top bulges past the edge of the tip")
        area = self.area * area_ratio
        force = self.area * self.bar.stress(strain)
        a = self._radius(area)
        p = force / area
        energy = self.area * self.height * self.bar.energy(strain)
        stiffness = self.area / self.height * self.bar.tangent_modulus(strain)
        fields = partial(_uniform_pressure, a, p), partial(_uniform_displacement, -delta)
        return Solution(delta, force, a, area, energy, stiffness, *fields, peak_pressure=lambda: p)

    def _radius(self, area: float) -> float:
        """Radius [L] of the disc of an area [L^2]; in plane strain half of the width."""
        return math.sqrt(area / math.pi) if self.dimensions == 2 else area / 2


def _uniform_pressure(a: float, p: float, x: np.ndarray) -> np.ndarray:
    """The pressure p within the distance a, none beyond."""
    return np.where(np.abs(np.asarray(x, dtype=float)) <= a, p, 0.0)[()]


def _uniform_displacement(u: float, x: np.ndarray) -> np.ndarray:
    """The same displacement everywhere."""
    return np.full_like(np.asarray(x, dtype=float), u)[()]


def bonded_modulus(E: float, bulk_modulus: float, shape_factor: float, dimensions: int) -> float:
    """Apparent modulus [F/L^2] of a nearly incompressible block bonded to two rigid plates.

        1/E_c = 1/(E (1 + 2 S^2)) + 1/K        of a disc, S = R/(2 t)
        1/E_c = 1/(4/3 E (1 + S^2)) + 1/K      of a long strip, S = width/(2 t)

    Parameters
    ----------
    E, bulk_modulus
        Young's modulus and bulk modulus K [F/L^2].
    shape_factor
        S, loaded area over the area free to bulge. A block of height h that is bonded at its base alone and slides
        along the plate is half of one of the thickness t = 2 h.
    dimensions
        2 for a disc, 1 for a long strip.

    Source: Gent & Lindley (1959), Proc. Inst. Mech. Eng. 173, 111; the sum of compliances: Gent &
    Meinecke (1970), Polym. Eng. Sci. 10, 48.
    """
    shear_modulus = (
        E * (1 + 2 * shape_factor**2) if dimensions == 2 else 4 / 3 * E * (1 + shape_factor**2)
    )
    return (
        1 / (1 / shear_modulus + 1 / bulk_modulus) if math.isfinite(bulk_modulus) else shear_modulus
    )
