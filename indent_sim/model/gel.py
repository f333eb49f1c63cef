"""Flory-Rehner gel: a polymer network swollen by a solvent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, Self

from annotated_types import Gt

from indent_sim.model.algebra import (
    Expr,
    log1p,
    log1p_remainder,
)
from indent_sim.model.elastic_law import Constants, ElasticLaw
from indent_sim.model.finite_strain import excess_and_volume_growth
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    Auto,
    Modulus,
)


class ConfinedSwelling(NamedTuple):
    """What a gel that is held sideways does in a bath, from its reference: stretch along its free
    axis, and nominal stress across [pressure], < 0 where it pushes.
    """

    stretch: float
    lateral_stress: float


@dataclass(frozen=True, kw_only=True)
class Gel(ElasticLaw):
    """A polymer network swollen by a solvent (Flory & Rehner 1943); its reference has swollen
    freely by `stretch` l.

    G = N kT [pressure] is the modulus of the dry network of N chains per volume, n_omega = n = N
    Omega [1], Omega the volume of a solvent molecule, chi [1] Flory's parameter. With J0 = l^3, a =
    J0/(J0 - 1), e = J - 1 and r(x) = x - ln(1 + x), J and I1 of the deformation from the reference,
    per volume of which

        psi = (G/l)((I1 - 3)/2 - ln J) - G (1/l - 1/J0) r(e)
              + G/(n J0) {(J0 - 1)[r(e) - r(a e) + a e (ln(1 + a e) - ln(1 + e))] - (chi/J0) e^2/(1 + e)}.

    It is the energy of the drained body: its stress lacks -p J F^-T, p [pressure] the solvent's
    chemical potential [kT] over that of free swelling, times G/n. At J <= 1/J0 no solvent is left,
    and psi is not a number. stretch: auto: that of free swelling in the first bath.
    flow.diffusivity [length^2/time] is that of the solvent; without flow the gel is always in
    equilibrium with the bath in which it swelled freely. Source: Hong, Zhao, Zhou & Suo (2008), J.
    Mech. Phys. Solids 56, 1779.
    """

    G: Modulus
    n_omega: Annotated[float, Gt(0)]
    chi: float
    stretch: Annotated[float, Gt(1)] | Auto = "auto"
    formulation: Literal["displacement"] = "displacement"
    relaxation: Relaxation | None = None
    flow: Flow | None = None
    model: Literal["gel"] = "gel"

    def canonical(self) -> Self:
        """The same with its flow said by the permeability at rest; ValueError where the free
        swelling is not stable. A stretch that is still "auto" is that of a bath: `swollen_in`.
        """
        if self.stretch == "auto":
            return self
        if not (self.stretch > 1 and 3 * self._swelling_stiffness > self.n_omega):
            raise ValueError(
                f"a gel of chi = {self.chi:g} that has swollen freely by {self.stretch:g} would "
                "shrink by itself;"
                " a smaller stretch, or chi"
            )
        if not (self.flow and self.flow.diffusivity):
            return self
        initial_permeability = self.permeability(1.0, self.flow.diffusivity)
        return replace(
            self, flow=replace(self.flow, diffusivity=None, permeability=initial_permeability)
        )

    def with_free_swelling(self, bath: float) -> Self:
        """The same with the stretch of free swelling in a bath of this chemical potential [kT],
        where it is "auto".
        """
        return (
            replace(self, stretch=self.free_swelling_stretch(bath))
            if self.stretch == "auto"
            else self
        )

    def free_swelling_potential(self, stretch: Expr) -> Expr:
        """mu(l) = n (1/l - 1/J0) + ln(1 - 1/J0) + 1/J0 + chi/J0^2 [kT] of a bath in which it swells
        freely by l.
        """
        J0 = stretch**3
        network = self.n_omega * (1 / stretch - 1 / J0)
        return network + log1p(-1 / J0) + 1 / J0 + self.chi / J0**2

    def free_swelling_stretch(self, bath: float) -> float:
        """The least l > 1 of free swelling in a bath of this chemical potential [kT]; ValueError
        where none is.
        """
        stretch_increment = _first_root(
            lambda growth: float(self.free_swelling_potential(1 + growth)) - bath,
            STRETCH_INCREMENTS,
        )
        if stretch_increment is None:
            raise ValueError(
                f"no free swelling has a bath potential of {bath:g}; a bath below 0, or another chi"
            )
        return 1 + stretch_increment

    def bath_pressure(self, bath: float) -> float:
        """p_b = (G/n)(mu_bath - mu(l)) [pressure] of a bath of this chemical potential [kT]; > 0
        where it swells, and 0 in the bath in which it has swollen freely.
        """
        excess_potential = bath - self.free_swelling_potential(self._l)
        return (
            float(self.G / self.n_omega * excess_potential)
            if abs(excess_potential) > SWELLING_ROUNDING
            else 0.0
        )

    def confined_swelling(self, bath_pressure: float) -> ConfinedSwelling:
        """At rest in a bath of this p_b [pressure] between walls as far apart as it is wide, free
        along one axis; ValueError where there is no such state.
        """
        if bath_pressure == 0:
            return ConfinedSwelling(1.0, 0.0)

        def residual_stress(growth: float) -> float:
            network_stress = self.shear_modulus * growth * (2 + growth) / (1 + growth)
            return float(network_stress + self.swelling_stress(growth)) - bath_pressure

        dry_limit = 1 - 1 / self._J0
        stretch_increment = _first_root(
            residual_stress,
            STRETCH_INCREMENTS
            if bath_pressure > 0
            else [-dry_limit * t / (1 + t) for t in STRETCH_INCREMENTS],
        )
        if stretch_increment is None:
            raise ValueError(f"no swelling between walls has a bath pressure of {bath_pressure:g}")
        return ConfinedSwelling(
            1 + stretch_increment, -self.shear_modulus * stretch_increment * (2 + stretch_increment)
        )

    def permeability(self, J: Expr, diffusivity: Expr) -> Expr:
        """k = D n (1 - 1/(J0 J))/G [length^2/(pressure time)], D the diffusivity of the solvent
        [length^2/time].
        """
        return diffusivity * self.n_omega / self.G * (1 - 1 / (self._J0 * J))

    def permeability_ratio(self, J: Expr) -> Expr:
        """The permeability over that at rest: the solvent's share of the volume, over that at rest."""
        return (1 - 1 / (self._J0 * J)) / (1 - 1 / self._J0)

    def swelling_ratio(self, J: Expr) -> Expr:
        """J0 J, the volume over that of the dry network."""
        return self._J0 * J

    @property
    def _l(self) -> Expr:
        return self.stretch

    @property
    def _J0(self) -> Expr:
        return self._l**3

    @property
    def shear_modulus(self) -> Expr:
        """G/l [pressure]."""
        return self.G / self._l

    @property
    def _swelling_stiffness(self) -> Expr:
        """1/(l^2 (J0 - 1)) + n/l^2 - 2 chi/l^5 = (lambda + mu) n l/G."""
        return (1 / (self._J0 - 1) + self.n_omega - 2 * self.chi / self._J0) / self._l**2

    @property
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu = 1/2 - (n/2)/(1/(l^2 (J0 - 1)) + n/l^2 - 2 chi/l^5), of
        the drained gel.
        """
        nu = 0.5 - self.n_omega / (2 * self._swelling_stiffness)
        return Constants(2 * self.shear_modulus * (1 + nu), nu)

    @property
    def volumetric_compliance(self) -> Expr:
        """1/lambda, lambda = (G/l)(stiffness/n - 1) with the stiffness of `constants` [1/pressure]."""
        return 1 / (self.shear_modulus * (self._swelling_stiffness / self.n_omega - 1))

    def energy(self, H: Expr) -> Expr:
        """psi [pressure] of the displacement gradient H (3 x 3), with all digits where H is small."""
        excess, growth = excess_and_volume_growth(H)
        return self.shear_modulus * excess + self._swelling_energy(growth)

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches."""
        J = l1 * l2 * l3
        excess = (l1 * l1 + l2 * l2 + l3 * l3 - 3) / 2 - math.log(J)
        return float(self.shear_modulus * excess + self._swelling_energy(J - 1))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """psi less stiffness e^2/2, and e = J - 1."""
        excess, e = excess_and_volume_growth(H)
        remaining_energy = self._swelling_energy(e) - e * e / (2 * self.volumetric_compliance)
        return self.shear_modulus * excess + remaining_energy, e

    def _swelling_energy(self, e: Expr) -> Expr:
        """psi without its first term."""
        J0 = self._J0
        a = self._J0 / (self._J0 - 1)
        mixing_terms = (
            log1p_remainder(e) - log1p_remainder(a * e) + a * e * (log1p(a * e) - log1p(e))
        )
        solvent_energy = (J0 - 1) * mixing_terms - self.chi / J0 * e * e / (1 + e)
        return self.G / (self.n_omega * J0) * solvent_energy - self.G * (
            1 / self._l - 1 / J0
        ) * log1p_remainder(e)

    def swelling_stress(self, e: Expr) -> Expr:
        """Its derivative [pressure] along e = J - 1: the Cauchy stress of network and mixing but
        for the shear's.
        """
        J0 = self._J0
        a = self._J0 / (self._J0 - 1)
        relative_growth = e / (1 + e)
        mixing_terms = (
            log1p(a * e)
            - log1p(e)
            - relative_growth / J0
            - self.chi / J0**2 * relative_growth * (2 + e) / (1 + e)
        )
        return (
            self.G / self.n_omega * mixing_terms - self.G * (1 / self._l - 1 / J0) * relative_growth
        )


# [kT] Between two chemical potentials that are the same: that of a free stretch found for a bath is
# off by 3e-16 (300 random gels of chi 0 to 0.7, n_omega 1e-4 to 0.03, baths 0 and -1e-6 to -0.1)
SWELLING_ROUNDING = 1e-14
STRETCH_INCREMENTS = tuple(
    10 ** (k / 20) for k in range(-240, 241)
)  # where a stretch less 1 is looked for


def _first_root(function: Callable[[float], float], points: Iterable[float]) -> float | None:
    """The first change of sign from 0 outwards, to all digits; None where there is none."""
    previous_point = 0.0
    previous_value = None
    for point in points:
        value = function(point)
        if previous_value is not None and (value >= 0) != (previous_value >= 0):
            return _bisect(function, previous_point, point)
        previous_point = point
        previous_value = value
    return None


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """The place between two at which the sign of a function changes."""
    is_high_positive = function(high) >= 0
    while low < (midpoint := (low + high) / 2) < high or high < midpoint < low:
        low, high = (
            (low, midpoint) if (function(midpoint) >= 0) == is_high_positive else (midpoint, high)
        )
    return high
