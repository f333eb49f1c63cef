"""Homogeneous compression of a prism between two frictionless planes: a plate on a flat top.

The plate moves down by delta, the base is fixed, and every side is either free or slides along a
wall. The stretch along z is then 1 - delta/h everywhere, free sides have no traction, and the force
is the nominal stress times the undeformed area. This is exact at any strain.

delta, force, stress and pressure are > 0 in compression. Any consistent units.
Sources: Holzapfel (2000), Nonlinear Solid Mechanics, section 6.2, for the stresses of principal
stretches; Gent & Lindley (1959) and Gent & Meinecke (1970) for bonded blocks (`bonded_modulus`).
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

# Step of finite differences in logarithmic strain. The five-point formula has a truncation error of
# DIFFERENCE_STEP^4/30 times the fifth derivative, 3e-14 of a modulus, and a rounding error of
# 1e-16/DIFFERENCE_STEP of a modulus: stresses have ten digits at strains above 1e-3.
DIFFERENCE_STEP = 1e-3
# Strain energy psi(l1, l2, l3) [F/L^2] of the principal stretches, the last one along z.
Energy = Callable[[float, float, float], float]


class Bar(Protocol):
    """Response of a bar to the compressive strain e = delta/h along its axis."""

    def stress(self, strain: float) -> float:
        """Return the nominal pressure [F/L^2] on the ends, > 0 in compression."""

    def energy(self, strain: float) -> float:
        """Return the strain energy per undeformed volume [F/L^2]."""

    def tangent_modulus(self, strain: float) -> float:
        """Return the derivative of stress with respect to strain [F/L^2]."""

    def area_ratio(self, strain: float) -> float:
        """Return the ratio of the deformed to the undeformed area of the ends."""


@dataclass(frozen=True)
class LinearBar:
    """Bar at small strain with stress = modulus e and constant area of the ends."""

    modulus: float

    def stress(self, strain: float) -> float:
        """Return the stress, modulus times strain [F/L^2]."""
        return self.modulus * strain

    def energy(self, strain: float) -> float:
        """Return the energy density, modulus times strain^2/2 [F/L^2]."""
        return self.modulus * strain**2 / 2

    def tangent_modulus(self, strain: float) -> float:
        """Return the constant modulus [F/L^2]."""
        return self.modulus

    def area_ratio(self, strain: float) -> float:
        """Return 1, because the area does not change at small strain."""
        return 1.0


@dataclass(frozen=True)
class HyperelasticBar:
    """Bar at finite strain, from the strain energy as a function of the principal stretches.

    The Kirchhoff stresses tau_i = d psi/d ln l_i vanish in free lateral directions, which
    determines the stretches in these directions; the nominal stress along the bar is tau_3/l_3
    (Holzapfel 2000, section 6.2).

    Parameters
    ----------
    psi
        Strain energy [F/L^2] of the principal stretches.
    is_incompressible
        Whether the product of the stretches is 1; psi is then only evaluated for such stretches.
    confined_directions
        Number of lateral directions without strain: 0, 1 or 2.
    """

    psi: Energy
    is_incompressible: bool
    confined_directions: int = 0

    def stress(self, strain: float) -> float:
        """Return the nominal pressure [F/L^2]; raises ValueError if there is no equilibrium."""
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
        """Return the strain energy per undeformed volume [F/L^2]."""
        axial_strain = math.log1p(-strain)
        return self._energy(self._lateral_strain(axial_strain), axial_strain)

    def tangent_modulus(self, strain: float) -> float:
        """Return the derivative of stress with respect to strain by a central difference."""
        step = 1e-4 * (1 - strain)
        return (self.stress(strain + step) - self.stress(strain - step)) / (2 * step)

    def area_ratio(self, strain: float) -> float:
        """Return the product of the two lateral stretches."""
        free_directions = 2 - self.confined_directions
        return math.exp(free_directions * self._lateral_strain(math.log1p(-strain)))

    def _energy(self, lateral_strain: float, axial_strain: float) -> float:
        """Return psi [F/L^2] for logarithmic strains in the free directions and along the bar."""
        lateral_stretch = math.exp(lateral_strain)
        return float(
            self.psi(
                lateral_stretch,
                lateral_stretch if self.confined_directions == 0 else 1.0,
                math.exp(axial_strain),
            )
        )

    def _lateral_strain(self, axial_strain: float) -> float:
        """Return the logarithmic strain in the free directions for which their stress is zero."""
        if self.confined_directions == 2:
            if self.is_incompressible and axial_strain != 0:
                raise ValueError("an incompressible body between side walls cannot be compressed")
            return 0.0
        if self.is_incompressible:
            return -axial_strain / (2 - self.confined_directions)
        # This import takes 0.2 s, which other scenes need not spend.
        from scipy.optimize import newton

        def slope(lateral_strain: float) -> float:
            return _first_derivative(lambda e: self._energy(e, axial_strain), lateral_strain)

        def curvature(lateral_strain: float) -> float:
            value = _second_derivative(lambda e: self._energy(e, axial_strain), lateral_strain)
            if not value > 0:
                raise ArithmeticError("the strain energy is not convex")
            return value

        try:
            return float(newton(slope, 0.0, fprime=curvature, tol=1e-13))
        except (ArithmeticError, RuntimeError) as error:
            raise ValueError(
                "the material has no equilibrium at the stretch "
                f"{math.exp(axial_strain):.4g} along z"
            ) from error


def _first_derivative(function: Callable[[float], float], x: float) -> float:
    """Return the first derivative of a function at x by the five-point formula."""
    near_difference = function(x + DIFFERENCE_STEP) - function(x - DIFFERENCE_STEP)
    far_difference = function(x + 2 * DIFFERENCE_STEP) - function(x - 2 * DIFFERENCE_STEP)
    return (8 * near_difference - far_difference) / (12 * DIFFERENCE_STEP)


def _second_derivative(function: Callable[[float], float], x: float) -> float:
    """Return the second derivative of a function at x by the three-point formula."""
    return (
        function(x + DIFFERENCE_STEP) - 2 * function(x) + function(x - DIFFERENCE_STEP)
    ) / DIFFERENCE_STEP**2


@dataclass(frozen=True)
class Compression:
    """Load curve of a homogeneously compressed prism.

    Parameters
    ----------
    bar
        Stress and strain energy of the prism as functions of the strain.
    height
        Undeformed height [L].
    area
        Undeformed area of the top [L^2]; width [L] in plane strain.
    dimensions
        Number of dimensions of the top: 2, or 1 in plane strain.
    max_area_ratio
        Ratio of the area of the tip to the undeformed area of the top; if the area of the top grows
        by a larger factor, the body bulges past the edge of the tip.
    """

    bar: Bar
    height: float
    area: float
    dimensions: int = 2
    max_area_ratio: float = math.inf

    @property
    def tip(self) -> Tip:
        """Flat punch of the size of the top, whose contact radius does not depend on the depth."""
        return flat_punch(self._radius(self.area))

    def solutions_at_depths(self, deltas: Sequence[float]) -> list[Solution]:
        """Return one Solution for each depth [L]; depths <= 0 have no contact.

        Raises
        ------
        ValueError
            If a depth is not less than the height, if the bar has no equilibrium there, or if the
            top bulges past the edge of the tip.
        """
        return [
            self._solution_at_depth(delta) if delta > 0 else no_contact(delta) for delta in deltas
        ]

    def solutions_at_forces(self, forces: Sequence[float]) -> list[Solution]:
        """Return one Solution for each force [F]; forces <= 0 have no contact.

        Raises the same errors as `solutions_at_depths`.
        """
        return self.solutions_at_depths(
            [self.depth_of_force(force) if force > 0 else 0.0 for force in forces]
        )

    def depth_of_force(self, force: float) -> float:
        """Return the depth [L] of a force [F] > 0; raises ValueError if there is no such depth."""
        start = min(
            force * self.height / (self.bar.tangent_modulus(0.0) * self.area), 0.5 * self.height
        )
        return increasing_root(
            lambda delta: self._solution_at_depth(delta).force, force, start, self.height
        )

    def solutions_up_to(self, deepest: Solution, count: int) -> list[Solution]:
        """Return `count` solutions at equally spaced depths up to the solution `deepest`."""
        return self.solutions_at_depths(list(deepest.delta * np.arange(1, count + 1) / count))

    def _solution_at_depth(self, delta: float) -> Solution:
        """Return the Solution at a depth [L] > 0."""
        strain = delta / self.height
        if not strain < 1:
            raise ValueError(
                f"the depth {delta:g} is not less than the height {self.height:g} of the body"
            )
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
        """Return the radius [L] of a disc of given area [L^2]; half the width in plane strain."""
        return math.sqrt(area / math.pi) if self.dimensions == 2 else area / 2


def _uniform_pressure(a: float, p: float, x: np.ndarray) -> np.ndarray:
    """Return the uniform pressure p at distances x <= a, and 0 beyond."""
    return np.where(np.abs(np.asarray(x, dtype=float)) <= a, p, 0.0)[()]


def _uniform_displacement(u: float, x: np.ndarray) -> np.ndarray:
    """Return the uniform displacement u at all positions x."""
    return np.full_like(np.asarray(x, dtype=float), u)[()]


def bonded_modulus(E: float, bulk_modulus: float, shape_factor: float, dimensions: int) -> float:
    """Return the apparent modulus E_c [F/L^2] of a nearly incompressible block between two plates.

        1/E_c = 1/(E (1 + 2 S^2)) + 1/K        of a disc, S = R/(2 t),
        1/E_c = 1/(4/3 E (1 + S^2)) + 1/K      of a long strip, S = width/(2 t).

    The block has the thickness t and is bonded to two rigid plates. A block of height h that is
    bonded at the base and slides along the plate corresponds to half of a block of thickness t = 2
    h.

    Parameters
    ----------
    E, bulk_modulus
        Young's modulus and bulk modulus K [F/L^2]; K may be infinite.
    shape_factor
        Ratio S of the loaded area to the area that is free to bulge.
    dimensions
        2 for a disc, 1 for a long strip.

    Sources: Gent & Lindley (1959), Proc. Inst. Mech. Eng. 173, 111; Gent & Meinecke (1970), Polym.
    Eng. Sci. 10, 48, for the sum of compliances.
    """
    if dimensions == 2:
        isochoric_modulus = E * (1 + 2 * shape_factor**2)
    else:
        isochoric_modulus = 4 / 3 * E * (1 + shape_factor**2)
    if not math.isfinite(bulk_modulus):
        return isochoric_modulus
    return 1 / (1 / isochoric_modulus + 1 / bulk_modulus)
