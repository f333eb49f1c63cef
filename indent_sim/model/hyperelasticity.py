"""Hyperelastic laws: neo-Hookean, and laws with an isochoric energy of invariants or stretches."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

from annotated_types import Gt, Len

from indent_sim.model import algebra
from indent_sim.model.algebra import (
    Expr,
    exp,
    expm1_remainder,
    log1p,
    power_sum,
    ufl,
)
from indent_sim.model.elastic_law import Constants, ElasticLaw, Formulation, TwoConstantLaw
from indent_sim.model.finite_strain import excess_and_log_J
from indent_sim.model.logarithmic_strain import square_of_unimodular
from indent_sim.model.plasticity import Plasticity
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    PRESSURE,
    AnyModulus,
    Modulus,
    PoissonRatio,
)


@dataclass(frozen=True)
class NeoHookean(TwoConstantLaw):
    """Compressible neo-Hookean law, psi = mu/2 (I1 - 3) - mu ln J + lame_lambda/2 (ln J)^2.

    Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure] define
    it.
    """

    model: Literal["neo_hookean"] = "neo_hookean"

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the energy mu/2 (I1 - 3) - mu ln J [pressure], and ln J."""
        excess, log_J = excess_and_log_J(H)
        return self.shear_modulus * excess, log_J

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """Return the strain energy density [pressure] for principal stretches."""
        log_J = math.log(l1 * l2 * l3)
        shear_energy = float(self.shear_modulus) * ((l1 * l1 + l2 * l2 + l3 * l3 - 3) / 2 - log_J)
        E, nu = self.constants
        lame_lambda = E * nu / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else 0.0
        return shear_energy + lame_lambda * log_J * log_J / 2


@dataclass(frozen=True)
class _IsochoricLaw(ElasticLaw):
    """Base class of laws psi = isochoric energy(J^-2/3 C) + kappa/2 (ln J)^2.

    A material is defined by the constants of the law and by either nu or kappa.
    """

    nu: PoissonRatio | None = None
    kappa: Modulus | None = None
    formulation: Formulation = "auto"
    relaxation: Relaxation | None = None
    flow: Flow | None = None

    @property
    @abstractmethod
    def small_strain_mu(self) -> Expr:
        """Shear modulus at small strain [pressure]."""

    @property
    @abstractmethod
    def poynting_coefficient(self) -> Expr:
        """Coefficient k [pressure] of the Poynting effect in simple shear.

        In simple shear by gamma at constant volume the normal stress on the sheared plane is less
        than the mean stress by k gamma^2, to leading order. In the logarithms h_i of stretches
        whose product is one, the energy of any isotropic law begins with mu (h_1^2 + h_2^2 + h_3^2)
        + c h_1 h_2 h_3. In simple shear the h_i are gamma/2, -gamma/2 and 0, and the principal axes
        are turned by gamma/4 from the directions at 45 degrees; k = mu/2 - c/12 follows.
        """

    @abstractmethod
    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Return the isochoric energy [pressure] of a right Cauchy-Green tensor C with det C = 1.

        Parameters
        ----------
        excess : Expr
            tr C/3 - 1.
        square : Expr
            dev C : dev C/6.
        cube : Expr
            det dev C.
        """

    @abstractmethod
    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """Return the isochoric energy [pressure] of principal stretches whose product is one.

        The stretches are floats or arrays.
        """

    def canonical(self) -> Self:
        """Return the same material with nu instead of kappa.

        Raises ValueError unless exactly one of nu and kappa is given.
        """
        if (self.nu is None) == (self.kappa is None):
            raise ValueError("needs exactly one of nu and kappa in addition to its constants")
        mu = self.small_strain_mu
        if not (math.isfinite(mu) and mu > 0):
            raise ValueError(f"the small-strain shear modulus is {mu:g}; it must be > 0")
        if self.kappa is None:
            return replace(self, flow=self.flow_by_permeability)
        nu = (3 * self.kappa - 2 * mu) / (2 * (3 * self.kappa + mu))
        if not nu > -1:
            raise ValueError(
                f"kappa = {self.kappa:g} is too small relative to mu = {mu:g}: "
                "nu would be -1 to all digits"
            )
        material = replace(self, nu=nu, kappa=None)
        return replace(material, flow=material.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu; nu must be set, as it is after `canonical`."""
        assert self.nu is not None
        return Constants(2 * self.small_strain_mu * (1 + self.nu), self.nu)

    @property
    def volumetric_compliance(self) -> Expr:
        """Inverse bulk modulus 3 (1 - 2 nu)/(2 mu (1 + nu)) [1/pressure]; 0 if incompressible."""
        assert self.nu is not None
        return 3 * (1 - 2 * self.nu) / (2 * self.small_strain_mu * (1 + self.nu))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the isochoric energy and ln J.

        The energy is a function of three UFL variables, so that UFL differentiates short
        expressions.
        """
        # tr C/3 = 1 + 2/3 ln J + 2/3 w loses no digit at small strain.
        w, log_J = map(ufl.variable, excess_and_log_J(H))
        strain = H + H.T + H.T * H
        deviator = strain - ufl.tr(strain) / 3 * ufl.Identity(3)
        square = ufl.variable(ufl.inner(deviator, deviator) / 6)
        cube = ufl.variable(ufl.det(deviator))
        isochoric_factor = exp(-2 * log_J / 3)
        excess = isochoric_factor * (2 * w / 3 - expm1_remainder(2 * log_J / 3))
        return self.isochoric_energy(
            excess, isochoric_factor**2 * square, isochoric_factor**3 * cube
        ), log_J

    def mixed_energy(self, H: Expr, q: Expr) -> Expr:
        """Return the mixed energy [pressure] with the field q of `mixed_volumetric_energy`."""
        remaining_energy, log_J = self.energy_parts(H)
        return remaining_energy + self.mixed_volumetric_energy(H, log_J, q)

    def mixed_volumetric_energy(
        self, H: Expr, log_J: Expr, q: Expr, shear_fraction: Expr = 1.0
    ) -> Expr:
        """Return the mixed volumetric energy p ln J - p^2/(2 kappa) with a continuous field q.

        The mean stress is p = q + k (I1 - 3) with k = max(poynting_coefficient, 0), so that q is to
        leading order the normal stress on a surface under a shear gamma, where I1 - 3 = gamma^2.
        This shear jumps between elements, and so does p, while the normal stress, which contact
        prescribes, is continuous. With q = p, the contact pressure under friction would oscillate
        from node to node. For any k, also if the law is incompressible, the energy is stationary
        in q at the solution of the displacement formulation
        (docs/decisions/0048-a-mixed-pressure-that-shear-leaves-alone.md).

        Parameters
        ----------
        H : Expr
            Displacement gradient (3 x 3).
        log_J : Expr
            ln J, as `energy_parts` returns it.
        q : Expr
            Field [pressure], positive in tension.
        shear_fraction : Expr
            Fraction of the shear modulus, and thus of k, that remains after relaxation.

        Returns
        -------
        Expr
            p ln J - p^2/(2 kappa) [pressure] with p = q + shear_fraction k (I1 - 3).
        """
        # I1 - 3, without loss of digits at small H. It is not scaled by J^(-2/3): that is concave
        # in ln J, and Newton's method then failed in uniform shear.
        elongation = ufl.variable(2 * ufl.tr(H) + ufl.inner(H, H))
        # Newton's method did not converge with k < 0, as for Ogden's law with alpha = 9 (sphere,
        # depth 0.4 R).
        k = algebra.maximum(self.poynting_coefficient, 0.0)
        mean_stress = q + shear_fraction * k * elongation
        return mean_stress * log_J - mean_stress * mean_stress * self.volumetric_compliance / 2

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """Return the strain energy density [pressure] for principal stretches."""
        J = l1 * l2 * l3
        isochoric_factor = J ** (-1 / 3)
        isochoric = self.energy_of_stretches(
            l1 * isochoric_factor, l2 * isochoric_factor, l3 * isochoric_factor
        )
        kappa = 1 / float(self.volumetric_compliance) if self.constants.nu < 0.5 else 0.0
        return float(isochoric) + kappa * math.log(J) ** 2 / 2

    def isochoric_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the isochoric energy, independent of the volume change, and ln J."""
        return self.energy_parts(H)

    @property
    def inverse_bulk_modulus(self) -> Expr:
        """Inverse bulk modulus 1/kappa [1/pressure]."""
        return self.volumetric_compliance


@dataclass(frozen=True)
class Hencky(TwoConstantLaw, _IsochoricLaw):
    """Hencky's law, mu dev e : dev e + kappa/2 (ln J)^2 with the logarithmic strain e.

    Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure] define
    it. With `plasticity` it is the law of a metal or a glass, whose elastic strains are small.
    """

    plasticity: Plasticity | None = None
    model: Literal["hencky"] = "hencky"

    @property
    def small_strain_mu(self) -> Expr:
        """Shear modulus mu [pressure]."""
        return self.shear_modulus

    @property
    def poynting_coefficient(self) -> Expr:
        """Coefficient k = mu/2 of the Poynting effect [pressure]."""
        return self.shear_modulus / 2

    @property
    def volumetric_compliance(self) -> Expr:
        """Inverse bulk modulus 3 (1 - 2 nu)/E [1/pressure]; 0 if incompressible."""
        return 3 * (1 - 2 * self.nu) / self.E  # type: ignore[operator]

    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Return mu sum e_i^2 [pressure] with the logarithms e_i of the stretches."""
        return self.shear_modulus * square_of_unimodular(excess, square, cube)

    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """Return mu sum (ln l_i)^2 [pressure]."""
        return self.shear_modulus * sum(algebra.log(stretch) ** 2 for stretch in (l1, l2, l3))


@dataclass(frozen=True)
class _InvariantLaw(_IsochoricLaw):
    """Base class of laws that depend on the modified invariants J^-2/3 I1 and J^-4/3 I2."""

    @property
    def poynting_coefficient(self) -> Expr:
        """Coefficient k = mu/3 [pressure] of a law that depends on I1 alone.

        For a law that depends on I2, 2/3 of the derivative with respect to I2 is added.
        """
        return self.small_strain_mu / 3

    @abstractmethod
    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return the isochoric energy [pressure] of i1 = J^-2/3 I1 - 3 and i2 = J^-4/3 I2 - 3."""

    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Return the isochoric energy [pressure] as a function of the invariants.

        i1 = 3 excess and i2 = 3 (2 excess + excess^2 - square).
        """
        return self.energy_of_invariants(3 * excess, 3 * (excess * (2 + excess) - square))

    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """Return the isochoric energy [pressure] of principal stretches whose product is one."""
        a = l1 * l1
        b = l2 * l2
        c = l3 * l3
        return self.energy_of_invariants(a + b + c - 3, a * b + b * c + c * a - 3)


@dataclass(frozen=True)
class MooneyRivlin(_InvariantLaw):
    """Mooney-Rivlin law, C10 (I1 - 3) + C01 (I2 - 3)."""

    C10: AnyModulus = 0.0
    C01: AnyModulus = 0.0
    model: Literal["mooney_rivlin"] = "mooney_rivlin"

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus 2 (C10 + C01) [pressure]."""
        return 2 * (self.C10 + self.C01)

    @property
    def poynting_coefficient(self) -> Expr:
        """Coefficient k = (2 C10 + 4 C01)/3 of the Poynting effect [pressure]."""
        return (2 * self.C10 + 4 * self.C01) / 3

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return C10 i1 + C01 i2 [pressure]."""
        return self.C10 * i1 + self.C01 * i2


@dataclass(frozen=True, kw_only=True)
class Yeoh(_InvariantLaw):
    """Yeoh law, C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3."""

    C10: Modulus
    C20: AnyModulus = 0.0
    C30: AnyModulus = 0.0
    model: Literal["yeoh"] = "yeoh"

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus 2 C10 [pressure]."""
        return 2 * self.C10

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return C10 i1 + C20 i1^2 + C30 i1^3 [pressure]."""
        return i1 * (self.C10 + i1 * (self.C20 + i1 * self.C30))


@dataclass(frozen=True, kw_only=True)
class Ogden(_IsochoricLaw):
    """Ogden law, sum mu_i/alpha_i (sum of stretches^alpha_i - 3).

    The small-strain shear modulus is sum mu_i alpha_i / 2.
    """

    mu: Annotated[tuple[float, ...], Len(1, 20), PRESSURE]
    alpha: Annotated[tuple[float, ...], Len(1, 20)]
    model: Literal["ogden"] = "ogden"

    def canonical(self) -> Self:
        """Return the same material with nu instead of kappa.

        Raises ValueError unless exactly one of nu and kappa is given, mu and alpha have the same
        length, and every alpha is non-zero.
        """
        if len(self.mu) != len(self.alpha):
            raise ValueError(
                f"mu has {len(self.mu)} entries and alpha has {len(self.alpha)}; they need the "
                "same number"
            )
        if 0 in self.alpha:
            raise ValueError("alpha must not be zero")
        return super().canonical()

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus sum mu_i alpha_i / 2 [pressure]."""
        return sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True)) / 2

    @property
    def poynting_coefficient(self) -> Expr:
        """Coefficient k = sum mu_i alpha_i (6 - alpha_i)/24 of the Poynting effect [pressure].

        The formula follows from k = mu/2 - c/12 with c = sum mu_i alpha_i^2 / 2.
        """
        pairs = zip(self.mu, self.alpha, strict=True)
        return sum(mu * alpha * (6 - alpha) for mu, alpha in pairs) / 24

    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Return sum mu_i/alpha_i (sum of stretches^alpha_i - 3) [pressure].

        At small strain, where this formula loses digits, a series is used.
        """
        distinct_stretch, mean_stretch, spread = algebra.unimodular_stretches(
            1 + excess, square, cube
        )
        energy = 0.0 * excess
        for mu, alpha in zip(self.mu, self.alpha, strict=True):
            energy = energy + mu / alpha * (
                distinct_stretch**alpha + algebra.pair_power_sum(alpha, mean_stretch, spread) - 3
            )
        return algebra.where_less(
            square, algebra.SMALL_DEVIATOR**2 / 6, self._energy_series(excess, square, cube), energy
        )

    def _energy_series(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Return the energy as a series in the deviator of C, for small strain.

        The squared stretches are mean (1 + t_i) with mean = 1 + excess and the eigenvalues t_i of a
        traceless tensor.
        """
        mean = 1 + excess
        energy = 0.0 * excess
        for mu, alpha in zip(self.mu, self.alpha, strict=True):
            growth = alpha / 2 * log1p(excess)
            growth += expm1_remainder(growth)  # mean^(alpha/2) - 1
            energy += (
                mu
                / alpha
                * (
                    3 * growth
                    + (1 + growth) * power_sum(alpha / 2, square / mean**2, cube / mean**3)
                )
            )
        return energy

    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """Return sum mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3) [pressure]."""
        stretches = (l1, l2, l3)
        terms = zip(self.mu, self.alpha, strict=True)
        return sum(
            mu / alpha * (sum(stretch**alpha for stretch in stretches) - 3) for mu, alpha in terms
        )


@dataclass(frozen=True, kw_only=True)
class Gent(_InvariantLaw):
    """Gent law, -mu Jm/2 ln(1 - (I1 - 3)/Jm), with an upper limit Jm of I1 - 3.

    The stiffness becomes infinite as I1 - 3 approaches Jm.
    """

    mu: Modulus
    Jm: Annotated[float, Gt(0)]
    model: Literal["gent"] = "gent"

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus mu [pressure]."""
        return self.mu

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return -mu Jm/2 ln(1 - i1/Jm); NaN beyond the limit, which rejects the Newton step."""
        return -self.mu * self.Jm / 2 * log1p(-i1 / self.Jm)


@dataclass(frozen=True, kw_only=True)
class Fung(_InvariantLaw):
    """Fung law of soft tissue, mu/(2 b) (exp(b (I1 - 3)) - 1), which stiffens exponentially.

    In the limit b -> 0 it equals mooney_rivlin with C10 = mu/2.
    """

    mu: Modulus
    b: Annotated[float, Gt(0)]
    model: Literal["fung"] = "fung"

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus mu [pressure]."""
        return self.mu

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return mu/(2 b) (exp(b i1) - 1) without loss of digits at small b i1."""
        return self.mu / (2 * self.b) * (self.b * i1 + expm1_remainder(self.b * i1))


# Coefficients c_i of psi = mu sum c_i lambda_m^(2-2i) (I1^i - 3^i), from the series of the inverse
# Langevin function (Arruda & Boyce 1993).
LANGEVIN_SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True, kw_only=True)
class ArrudaBoyce(_InvariantLaw):
    """Arruda-Boyce law, mu sum_i c_i lambda_m^(2-2i) (I1^i - 3^i).

    The coefficients c = 1/2, 1/20, 11/1050, 19/7000, 519/673750 come from the series of the inverse
    Langevin function.
    """

    mu: Modulus
    lambda_m: Annotated[float, Gt(1)]
    model: Literal["arruda_boyce"] = "arruda_boyce"

    @property
    def small_strain_mu(self) -> Expr:
        """Small-strain shear modulus, twice the derivative of psi at I1 = 3 [pressure].

        The modulus is mu (1 + 3/(5 lambda_m^2) + 99/(175 lambda_m^4) + ...).
        """
        terms = (
            i * c * 3 ** (i - 1) * self.lambda_m ** (2 - 2 * i)
            for i, c in enumerate(LANGEVIN_SERIES, start=1)
        )
        return 2 * self.mu * sum(terms)

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Return mu sum_i c_i lambda_m^(2-2i) (I1^i - 3^i) [pressure].

        I1^i - 3^i is evaluated as i1 (I1^(i-1) + 3 I1^(i-2) + ... + 3^(i-1)) without loss of
        digits.
        """
        I1 = 3 + i1
        slope = 0.0
        power = 1.0
        for i, c in enumerate(LANGEVIN_SERIES, start=1):
            slope = slope + c * self.lambda_m ** (2 - 2 * i) * power
            power = I1 * power + 3.0**i
        return self.mu * i1 * slope
