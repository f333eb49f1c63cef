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
from indent_sim.model.measured_constants import SWELLING_ROUNDING
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    Auto,
    Modulus,
)


class ConfinedSwelling(NamedTuple):
    """Swelling equilibrium of a gel in a bath between fixed side walls.

    Attributes
    ----------
    stretch
        Stretch along the free axis, relative to the reference state.
    lateral_stress
        Nominal stress across the free axis [pressure], < 0 in compression.
    """

    stretch: float
    lateral_stress: float


@dataclass(frozen=True, kw_only=True)
class Gel(ElasticLaw):
    """Polymer network swollen by a solvent (Flory & Rehner 1943).

    In the reference state the gel has swollen freely by the stretch l from the dry state. G = N kT
    [pressure] is the modulus of the dry network of N chains per volume; n_omega = n = N Omega [1],
    Omega the volume of a solvent molecule; chi [1] is Flory's parameter. With J0 = l^3, a = J0/(J0
    - 1), e = J - 1, r(x) = x - ln(1 + x), and J and I1 of the deformation from the reference state,
    the energy per volume of the reference state is

        psi = (G/l)((I1 - 3)/2 - ln J) - G (1/l - 1/J0) r(e)
              + G/(n J0) {(J0 - 1)[r(e) - r(a e) + a e (ln(1 + a e) - ln(1 + e))]
                          - (chi/J0) e^2/(1 + e)}.

    This is the energy of the drained body. The total stress is the stress from psi plus -p J F^-T,
    where p [pressure] is G/n times the difference of the solvent's chemical potential [kT] from
    that of free swelling. At J <= 1/J0 no solvent is left, and psi is NaN.

    stretch "auto" is the stretch of free swelling in the first bath. flow.diffusivity
    [length^2/time] is the diffusivity of the solvent; without flow the gel is always in equilibrium
    with the bath in which it has swollen freely. Source: Hong, Zhao, Zhou & Suo (2008), J. Mech.
    Phys. Solids 56, 1779.
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
        """Return the same gel with the flow defined by the permeability of the reference state.

        The stretch must be a number; see `with_free_swelling`. Raises ValueError if the free
        swelling is unstable.
        """
        if self.stretch == "auto":
            return self
        if not (self.stretch > 1 and 3 * self._swelling_stiffness > self.n_omega):
            raise ValueError(
                f"the free swelling of a gel with chi = {self.chi:g} by a stretch of "
                f"{self.stretch:g} is unstable; give a smaller stretch or a smaller chi"
            )
        if not (self.flow and self.flow.diffusivity):
            return self
        initial_permeability = self.permeability(1.0, self.flow.diffusivity)
        return replace(
            self, flow=replace(self.flow, diffusivity=None, permeability=initial_permeability)
        )

    def with_free_swelling(self, bath: float) -> Self:
        """Return the same gel with "auto" replaced by the stretch of free swelling in a bath.

        `bath` is the chemical potential of the solvent in the bath [kT].
        """
        if self.stretch != "auto":
            return self
        return replace(self, stretch=self.free_swelling_stretch(bath))

    def free_swelling_potential(self, stretch: Expr) -> Expr:
        """Return the chemical potential [kT] of a bath in which the free-swelling stretch is l.

        mu(l) = n (1/l - 1/J0) + ln(1 - 1/J0) + 1/J0 + chi/J0^2.
        """
        J0 = stretch**3
        network = self.n_omega * (1 / stretch - 1 / J0)
        return network + log1p(-1 / J0) + 1 / J0 + self.chi / J0**2

    def free_swelling_stretch(self, bath: float) -> float:
        """Return the smallest free-swelling stretch l > 1 in a bath (chemical potential [kT]).

        Raises ValueError if there is no such stretch.
        """
        stretch_increment = _first_root(
            lambda growth: float(self.free_swelling_potential(1 + growth)) - bath,
            STRETCH_INCREMENTS,
        )
        if stretch_increment is None:
            raise ValueError(
                f"no free swelling is in equilibrium with a bath of the chemical potential "
                f"{bath:g} kT; use a bath below 0, or another chi"
            )
        return 1 + stretch_increment

    def bath_pressure(self, bath: float) -> float:
        """Return p_b = (G/n)(mu_bath - mu(l)) [pressure] for the chemical potential of a bath [kT].

        p_b is > 0 if the gel swells, and 0 in the bath in which it has swollen freely.
        """
        excess_potential = bath - self.free_swelling_potential(self._l)
        if abs(excess_potential) > SWELLING_ROUNDING:
            return float(self.G / self.n_omega * excess_potential)
        return 0.0

    def confined_swelling(self, bath_pressure: float) -> ConfinedSwelling:
        """Return the swelling equilibrium between fixed side walls in a bath.

        The argument is the pressure p_b [pressure] of the bath. The walls keep the gel at the width
        of the reference state, so that it swells along one free axis only. Raises ValueError if
        there is no equilibrium.
        """
        if bath_pressure == 0:
            return ConfinedSwelling(1.0, 0.0)

        def residual_stress(growth: float) -> float:
            network_stress = self.shear_modulus * growth * (2 + growth) / (1 + growth)
            return float(network_stress + self.swelling_stress(growth)) - bath_pressure

        dry_limit = 1 - 1 / self._J0
        if bath_pressure > 0:
            increments = STRETCH_INCREMENTS
        else:
            increments = tuple(-dry_limit * t / (1 + t) for t in STRETCH_INCREMENTS)
        stretch_increment = _first_root(residual_stress, increments)
        if stretch_increment is None:
            raise ValueError(
                "no swelling between fixed side walls is in equilibrium with a bath pressure of "
                f"{bath_pressure:g}"
            )
        return ConfinedSwelling(
            1 + stretch_increment, -self.shear_modulus * stretch_increment * (2 + stretch_increment)
        )

    def confined_stiffness(self, stretch: Expr) -> Expr:
        """Return the derivative [pressure] of the axial stress with respect to the stretch.

        The side walls are fixed as in `confined_swelling`. If the derivative is negative, the gel
        separates into a dilute and a dense phase.
        """
        J0 = self._J0
        mixing_terms = (
            J0 / (J0 * stretch - 1)
            - 1 / stretch
            - 1 / (J0 * stretch**2)
            - 2 * self.chi / (J0**2 * stretch**3)
        )
        volume_terms = self.G / self.n_omega * mixing_terms
        network_terms = self.G * (1 / self._l - 1 / J0) / stretch**2
        return self.shear_modulus * (1 + 1 / stretch**2) + volume_terms - network_terms

    def permeability(self, J: Expr, diffusivity: Expr) -> Expr:
        """Return k = D n (1 - 1/(J0 J))/G [length^2/(pressure time)].

        D is the diffusivity of the solvent [length^2/time].
        """
        return diffusivity * self.n_omega / self.G * (1 - 1 / (self._J0 * J))

    def permeability_ratio(self, J: Expr) -> Expr:
        """Return the permeability divided by that of the reference state.

        This ratio equals the volume fraction of the solvent divided by that in the reference state.
        """
        return (1 - 1 / (self._J0 * J)) / (1 - 1 / self._J0)

    def swelling_ratio(self, J: Expr) -> Expr:
        """Return J0 J, the ratio of the volume to that of the dry network."""
        return self._J0 * J

    @property
    def _l(self) -> Expr:
        """Stretch l of free swelling."""
        return self.stretch

    @property
    def _J0(self) -> Expr:
        """Volume ratio J0 = l^3 of free swelling."""
        return self._l**3

    @property
    def shear_modulus(self) -> Expr:
        """Shear modulus G/l of the reference state [pressure]."""
        return self.G / self._l

    @property
    def _swelling_stiffness(self) -> Expr:
        """Constant s = 1/(l^2 (J0 - 1)) + n/l^2 - 2 chi/l^5 = (lambda + mu) n l/G."""
        return (1 / (self._J0 - 1) + self.n_omega - 2 * self.chi / self._J0) / self._l**2

    @property
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu = 1/2 - n/(2 s) of the drained gel.

        s = 1/(l^2 (J0 - 1)) + n/l^2 - 2 chi/l^5.
        """
        nu = 0.5 - self.n_omega / (2 * self._swelling_stiffness)
        return Constants(2 * self.shear_modulus * (1 + nu), nu)

    @property
    def volumetric_compliance(self) -> Expr:
        """Inverse 1/lambda [1/pressure] of lambda = (G/l)(s/n - 1); see `constants` for s."""
        return 1 / (self.shear_modulus * (self._swelling_stiffness / self.n_omega - 1))

    def energy(self, H: Expr) -> Expr:
        """Return psi [pressure] of H (3 x 3) without loss of digits at small H."""
        excess, growth = excess_and_volume_growth(H)
        return self.shear_modulus * excess + self._swelling_energy(growth)

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """Return the strain energy density [pressure] for principal stretches."""
        J = l1 * l2 * l3
        excess = (l1 * l1 + l2 * l2 + l3 * l3 - 3) / 2 - math.log(J)
        return float(self.shear_modulus * excess + self._swelling_energy(J - 1))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return psi - lambda e^2/2 and e = J - 1."""
        excess, e = excess_and_volume_growth(H)
        remaining_energy = self._swelling_energy(e) - e * e / (2 * self.volumetric_compliance)
        return self.shear_modulus * excess + remaining_energy, e

    def _swelling_energy(self, e: Expr) -> Expr:
        """Return psi [pressure] without its first term, (G/l)((I1 - 3)/2 - ln J)."""
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
        """Return the derivative [pressure] of the swelling energy with respect to e = J - 1.

        The derivative is the isotropic Cauchy stress due to mixing and to the change of volume.
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


# Values of stretch - 1 between which a root is searched.
STRETCH_INCREMENTS = tuple(10 ** (k / 20) for k in range(-240, 241))


def _first_root(function: Callable[[float], float], points: Iterable[float]) -> float | None:
    """Return the first root of a function between 0 and the successive `points`, or None.

    The relative error is 1e-15.
    """
    # This import takes 0.2 s, which bodies without a gel need not spend.
    from scipy.optimize import brentq

    previous_point = 0.0
    previous_value = None
    for point in points:
        value = function(point)
        if previous_value is not None and (value >= 0) != (previous_value >= 0):
            return float(brentq(function, previous_point, point, xtol=1e-16 * abs(point)))
        previous_point = point
        previous_value = value
    return None
