"""Elastic laws as strain-energy densities; UFL differentiates them to stress and tangent.

A material is a frozen dataclass with its constants, an `energy` of the displacement gradient H
(3x3) and, of the same `parts`, a `mixed_energy` in which a pressure-like field q replaces the
volumetric stiffness (q = lame_lambda tr eps, or lambda ln J, or kappa ln J - k (I1 - 3) at the
solution), so that nu = 0.5 is legal. Its numbers may be floats or UFL constants.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

from annotated_types import Ge, Gt, Le, Len, Lt

from indent_sim.model import algebra
from indent_sim.model.algebra import (
    Expr,
    exp,
    expm1_remainder,
    log1p,
    log1p_remainder,
    power_sum,
    ufl,
)
from indent_sim.model.units import (
    PRESSURE,
    TIME,
    AnyModulus,
    Auto,
    Modulus,
    PoissonRatio,
    Unit,
    UnitRow,
)

Formulation = Literal["auto", "displacement", "mixed"]
LOCKING_POISSON_RATIO = (
    0.45  # Poisson's ratio from which displacement elements lock: see `docs/theory.md`
)
ENERGY_ROUNDING = 1e-14  # of 1, a strain energy that is 0
LEAST_POISSON_RATIO = -0.99  # Poisson's ratio of an isotropic stand-in
ISOTROPIC_CONSTANTS = ("E", "nu", "mu", "kappa", "lame_lambda")


MAX_PRONY_TERMS = 100  # of a relaxation
Time = Annotated[float, Gt(0), TIME]
Fraction = Annotated[float, Ge(0), Lt(1)]
RelaxationTerm = Annotated[tuple[float, ...], Len(2, 2), UnitRow((None, TIME))]


@dataclass(frozen=True)
class PowerLaw:
    """E(t) = E (t/time)^-exponent."""

    exponent: Annotated[float, Gt(0), Lt(1)]
    time: Time


@dataclass(frozen=True)
class Relaxation:
    """G(t) of a law whose own constants are the instantaneous ones: `prony` terms [fraction, time],
    whose fractions sum below 1, or a power law. `of`: all moduli fall alike, nu stays what it is
    | shear: the bulk modulus stays what it is, and at finite strain too.
    """

    prony: Annotated[tuple[RelaxationTerm, ...], Len(1, MAX_PRONY_TERMS)] | None = None
    power_law: PowerLaw | None = None
    of: Literal["all", "shear"] = "all"


class PronySeries(NamedTuple):
    """G(t) = rest + sum fraction exp(-t/time) of a modulus, over that of the law's constants; times
    [time] > 0.
    """

    long_term: float
    fractions: tuple[float, ...]
    times: tuple[float, ...]


@dataclass(frozen=True)
class HolmesMow:
    """Pores that close: permeability ((J - phi0)/(1 - phi0))^alpha exp(M (J^2 - 1)/2), with the
    solid's share phi0 of the volume at rest (Holmes & Mow 1990, J. Biomech. 23, 1145).
    """

    phi0: Annotated[float, Ge(0), Lt(1)]
    alpha: Annotated[float, Ge(0)] = 0.0
    M: Annotated[float, Ge(0)] = 0.0

    def permeability_ratio(self, J: Expr) -> Expr:
        """Of the permeability at rest, at a volume ratio J; not a number where no pore is left."""
        return ((J - self.phi0) / (1 - self.phi0)) ** self.alpha * exp(self.M * (J * J - 1) / 2)


@dataclass(frozen=True)
class Flow:
    """Fluid in the pores of a law whose own constants are those of the drained body (Biot 1941).

    Fluid content per volume zeta = alpha tr eps + storage p, zeta' = div(permeability grad p).
    `permeability`: that of the pores over the viscosity [length^2/(pressure time)]; or
    `diffusivity` [length^2/time], with which pressure evens out while the body is confined,
    permeability/(storage + alpha^2/M_c). alpha [1]: 1 where grains do not change their volume;
    storage [1/pressure]: 0 where, besides, the fluid does not. holmes_mow: how the permeability
    changes at finite strain; without it that of the deformed body stays what it is.
    """

    permeability: Annotated[float, Gt(0), Unit("length^2/(pressure time)")] | None = None
    diffusivity: Annotated[float, Gt(0), Unit("length^2/time")] | None = None
    alpha: Annotated[float, Gt(0), Le(1)] = 1.0
    storage: Annotated[float, Ge(0), Unit("1/pressure")] = 0.0
    holmes_mow: HolmesMow | None = None

    def canonical(self, confined_modulus: float) -> Self:
        """The same said by the permeability; ValueError when not exactly one way of saying it is
        used. confined_modulus: M_c of the drained body [pressure].
        """
        if (self.permeability is None) == (self.diffusivity is None):
            raise ValueError("flow needs exactly one of permeability, diffusivity")
        if not math.isfinite(confined_modulus):
            raise ValueError("nu = 0.5 leaves no pores to drain; give the drained nu, below 0.5")
        if self.diffusivity is None:
            return self
        permeability = self.diffusivity * (self.storage + self.alpha**2 / confined_modulus)
        return replace(self, permeability=permeability, diffusivity=None)


class Constants(NamedTuple):
    """Young's modulus E [pressure] and Poisson's ratio nu at small strain."""

    E: float
    nu: float

    @property
    def E_star(self) -> float:
        """Plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.E / (1 - self.nu * self.nu)


class _Law(ABC):
    """What follows from the small-strain constants E and nu of any law, and from psi = rest +
    stiffness theta^2/2.
    """

    is_small_strain: ClassVar[bool] = False
    is_isotropic: ClassVar[bool] = True
    is_conservative: ClassVar[bool] = (
        True  # the stress is the slope of an energy: strains that come back cost no work
    )
    is_path_dependent: ClassVar[bool] = (
        False  # the stress depends on the strains before as well as on the present one
    )
    relaxation: Relaxation | None
    flow: Flow | None

    @property
    def has_shear_relaxation(self) -> bool:
        """Whether its shear relaxes alone."""
        return self.relaxation is not None and self.relaxation.of == "shear"

    @property
    def is_time_dependent(self) -> bool:
        """Whether a body of it changes with time other than by one common factor."""
        return self.flow is not None or self.has_shear_relaxation

    @property
    @abstractmethod
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu."""

    @property
    def decay_rates(self) -> tuple[float, float]:
        """How fast the two waves exp(-k s z) of a surface pressure of wavenumber k fade, the slower
        first: Re s.
        """
        return 1.0, 1.0

    @property
    def E_star(self) -> float:
        """Small-strain plane-strain modulus E/(1 - nu^2) [pressure]."""
        return self.constants.E_star

    def relaxed_constants(self, shear_fraction: float) -> Constants:
        """Small-strain constants of which a share of the shear modulus is left, and all of the bulk
        modulus.

        Parameters
        ----------
        share : float
            Of the shear modulus mu; 1 leaves the constants as they are.

        Returns
        -------
        Constants
            E = 9 kappa mu'/(3 kappa + mu') [pressure] and nu = (3 kappa - 2 mu')/(2 (3 kappa + mu')),
            mu' = share mu: the less of mu is left, the nearer nu is to 1/2.
        """
        E, nu = self.constants
        if shear_fraction == 1 or nu == 0.5:
            return Constants(shear_fraction * E, nu)
        mu = shear_fraction * E / (2 * (1 + nu))
        kappa = E / (3 * (1 - 2 * nu))
        relaxed_nu = (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))
        return Constants(2 * mu * (1 + relaxed_nu), relaxed_nu)

    @property
    def confined_modulus(self) -> float:
        """Small-strain M_c = E (1 - nu)/((1 + nu)(1 - 2 nu)) [pressure] of a bar between rigid
        walls.
        """
        E, nu = self.constants
        return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else math.inf

    def bar_modulus(self, confined_directions: int) -> float:
        """Small-strain modulus [pressure] of a bar along z that `confined_directions` of the two directions across
        it cannot leave: E, E/(1 - nu^2) or M_c.
        """
        return (self.constants.E, self.E_star, self.confined_modulus)[confined_directions]

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches (floats) at finite strain; of an incompressible law
        their product is one. TypeError for a law of small strain.
        """
        raise TypeError(f"{type(self).__name__} knows no stretches")

    @property
    def diffusivity(self) -> float:
        """Small-strain D = permeability/(storage + alpha^2/M_c) [length^2/time] of its flow, said
        by permeability.
        """
        assert self.flow and self.flow.permeability
        return self.flow.permeability / (
            self.flow.storage + self.flow.alpha**2 / self.confined_modulus
        )

    @property
    def flow_by_permeability(self) -> Flow | None:
        """Its flow, said by the permeability; ValueError where it is not well said."""
        return self.flow and self.flow.canonical(self.confined_modulus)

    def volume_growth(self, H: Expr) -> Expr:
        """Growth e of the volume, per undeformed volume: tr eps at small strain, else J - 1, to all
        digits.
        """
        return ufl.tr(H) if self.is_small_strain else ufl.tr(H) + _nonlinear_volume_growth(H)

    def fluid_content(self, H: Expr, p: Expr) -> Expr:
        """zeta = alpha e + storage p of the fluid per undeformed volume; p [pressure] from that at
        rest.
        """
        assert self.flow
        return self.flow.alpha * self.volume_growth(H) + self.flow.storage * p

    def swelling_ratio(self, J: Expr) -> Expr:
        """The volume over that of the dry body; J where nothing has swollen the body at rest."""
        return J

    def nominal_permeability(self, H: Expr) -> Expr:
        """m (3 x 3) [length^2/(pressure time)] of the nominal flux -m grad p: the permeability at
        small strain, else J k(J) F^-1 F^-T with that of the deformed body, k(J).
        """
        assert self.flow
        if self.is_small_strain:
            return self.flow.permeability * ufl.Identity(3)
        J = 1 + self.volume_growth(H)
        inverse_gradient = ufl.inv(ufl.Identity(3) + H)
        return (
            J
            * self.permeability_ratio(J)
            * self.flow.permeability
            * inverse_gradient
            * inverse_gradient.T
        )

    def permeability_ratio(self, J: Expr) -> Expr:
        """The permeability of the deformed body over that at rest."""
        return (
            self.flow.holmes_mow.permeability_ratio(J) if self.flow and self.flow.holmes_mow else 1
        )

    def bath_pressure(self, bath: float) -> float:
        """The pressure [pressure] of a bath above that at rest."""
        return bath

    @property
    @abstractmethod
    def volumetric_compliance(self) -> Expr:
        """1/stiffness [1/pressure] of the volume-like strain; 0 when incompressible."""

    @abstractmethod
    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """The energy without its volumetric part [pressure], and the volume-like strain theta: tr
        eps, or ln J.
        """

    def energy(self, H: Expr) -> Expr:
        """psi [pressure] of the displacement gradient H (3 x 3)."""
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + theta**2 / (2 * self.volumetric_compliance)

    def mixed_energy(self, H: Expr, q: Expr) -> Expr:
        """The same with q theta - q^2/(2 stiffness) in place of stiffness theta^2/2 [pressure]."""
        remaining_energy, theta = self.energy_parts(H)
        return remaining_energy + q * theta - q * q * self.volumetric_compliance / 2


@dataclass(frozen=True)
class _TwoConstantLaw(_Law):
    """Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure]."""

    E: Modulus | None = None
    nu: PoissonRatio | None = None
    mu: Modulus | None = None
    kappa: Modulus | None = None
    lame_lambda: AnyModulus | None = None
    formulation: Formulation = "auto"
    relaxation: Relaxation | None = None
    flow: Flow | None = None

    def canonical(self) -> Self:
        """The same material said by E and nu; ValueError when it is not said by exactly two
        constants.
        """
        given = {
            name: getattr(self, name)
            for name in ISOTROPIC_CONSTANTS
            if getattr(self, name) is not None
        }
        E, nu = young_and_poisson(given)
        material = replace(self, E=E, nu=nu, mu=None, kappa=None, lame_lambda=None)
        return replace(material, flow=material.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """E [pressure] and nu of a canonical material."""
        assert self.E is not None and self.nu is not None
        return Constants(self.E, self.nu)

    @property
    def shear_modulus(self) -> Expr:
        """mu = E / (2 (1 + nu)) [pressure]."""
        return self.E / (2 * (1 + self.nu))  # type: ignore[operator]

    @property
    def volumetric_compliance(self) -> Expr:
        """1/lame_lambda = (1 + nu)(1 - 2 nu)/(E nu) [1/pressure]; 0 when incompressible."""
        return (1 + self.nu) * (1 - 2 * self.nu) / (self.E * self.nu)  # type: ignore[operator]


@dataclass(frozen=True)
class LinearElastic(_TwoConstantLaw):
    """Isotropic Hooke's law at small strain, psi = mu eps:eps + lame_lambda/2 (tr eps)^2 (notes
    2.1-2.4).

    Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure] say it.
    """

    model: Literal["linear_elastic"] = "linear_elastic"

    is_small_strain: ClassVar[bool] = True

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """mu eps:eps and tr eps."""
        eps = ufl.sym(H)
        return self.shear_modulus * ufl.inner(eps, eps), ufl.tr(eps)

    def isochoric_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """mu dev eps : dev eps, which is free of any change of volume, and tr eps."""
        deviator = ufl.dev(ufl.sym(H))
        return self.shear_modulus * ufl.inner(deviator, deviator), ufl.tr(H)

    def mixed_volumetric_energy(
        self, H: Expr, theta: Expr, q: Expr, shear_fraction: Expr = 1.0
    ) -> Expr:
        """q theta - q^2/(2 kappa) [pressure], whatever share of the shear modulus is left; q is the
        mean stress.
        """
        return q * theta - q * q * self.inverse_bulk_modulus / 2

    @property
    def inverse_bulk_modulus(self) -> Expr:
        """1/kappa = 3 (1 - 2 nu)/E [1/pressure]."""
        return 3 * (1 - 2 * self.nu) / self.E  # type: ignore[operator]


@dataclass(frozen=True, kw_only=True)
class TransverselyIsotropic(_Law):
    """Hooke's law with the axis z: E, nu in the plane across it, nu_z = -eps_plane/eps_z under
    sigma_z, shear G_z.

    With D = 1 - nu - 2 nu_z^2 E/E_z >= 0, d = D/(1 + nu), G = E/(2 (1 + nu)), alpha = 2 nu_z + d
    and the volume-like strain theta = eps_x + eps_y + alpha eps_z, psi = G (eps_x^2 + eps_y^2 + 2
    eps_xy^2) + 2 G_z (eps_xz^2 + eps_yz^2) + G (alpha - 1)(eps_x + eps_y) eps_z + [E_z + G (alpha^2
    - 4 nu_z - d)] eps_z^2/2 + stiffness theta^2/2 with stiffness = E (1 - d)/(2 D). All but the
    last is finite at D = 0; where it is isotropic theta is tr eps and the stiffness lame_lambda.
    Lekhnitskii (1963), Theory of Elasticity of an Anisotropic Elastic Body.
    """

    E: Modulus
    E_z: Modulus
    nu: Annotated[float, Gt(-1), Lt(1)]
    nu_z: float
    G_z: Modulus
    formulation: Formulation = "auto"
    relaxation: Relaxation | None = None
    flow: Flow | None = None
    model: Literal["transversely_isotropic"] = "transversely_isotropic"

    is_small_strain: ClassVar[bool] = True
    is_isotropic: ClassVar[bool] = False

    def canonical(self) -> Self:
        """Itself; ValueError where some strain would have negative energy."""
        if not self._D >= -ENERGY_ROUNDING:
            largest_nu_z = math.sqrt((1 - self.nu) * self.E_z / (2 * self.E))
            problem = f"nu_z = {self.nu_z:g} makes the energy of some strain negative"
            raise ValueError(
                f"{problem}: with these E, E_z and nu it must lie within +-{largest_nu_z:.6g}"
            )
        return replace(self, flow=self.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """E [pressure] and nu of the isotropic material that stands for it: of the same indentation
        modulus, and as compressible, nu = (1 - d)/2.
        """
        nu = min(max((1 - self._d) / 2, LEAST_POISSON_RATIO), 0.5)
        return Constants(self._indentation_modulus * (1 - nu * nu), nu)

    def bar_modulus(self, confined_directions: int) -> float:
        """E_z, E_z/(1 - nu_z^2 E/E_z), or C33 = E_z (1 - nu)/D [pressure]."""
        if confined_directions < 2:
            return self.E_z / (1 - confined_directions * self.nu_z**2 * self.E / self.E_z)
        return self.E_z * (1 - self.nu) / self._D if self._D > ENERGY_ROUNDING else math.inf

    @property
    def _D(self) -> Expr:
        return 1 - self.nu - 2 * self.nu_z**2 * self.E / self.E_z

    @property
    def _d(self) -> Expr:
        return self._D / (1 + self.nu)

    @property
    def decay_rates(self) -> tuple[float, float]:
        """The roots of C33 C44 s^4 - (C11 C33 - C13^2 - 2 C13 C44) s^2 + C11 C44 = 0, multiplied by
        D.
        """
        E = self.E
        E_z = self.E_z
        nu_z = self.nu_z
        G_z = self.G_z
        C11 = E * (1 - nu_z**2 * E / E_z) / (1 + self.nu)
        C33 = E_z * (1 - self.nu)
        C13 = E * nu_z
        product = math.sqrt(C11 / C33)
        mean = (C11 * self._plane_stiffness - 2 * C13 * G_z) / (2 * C33 * G_z)
        mean_root = math.sqrt(max(mean + product, ENERGY_ROUNDING * product) / 2)
        root_difference = math.sqrt(max(mean - product, 0.0) / 2)
        return product / (
            mean_root + root_difference
        ) if root_difference else mean_root, mean_root + root_difference

    @property
    def _plane_stiffness(self) -> float:
        """C33 - C13^2/C11 [pressure]."""
        return self.E_z + 2 * self.nu_z**2 * self.E / (1 + self.nu + max(self._D, 0.0))

    @property
    def _indentation_modulus(self) -> float:
        """M [pressure], finite for D = 0: 2 sqrt((C11 C33 - C13^2)/C11/(1/C44 + 2/(sqrt(C11 C33) +
        C13))).
        """
        # Elliott (1949), Proc. Camb. Phil. Soc. 45, 621; Delafargue & Ulm (2004), Int. J. Solids
        # Struct. 41, 7351
        E = self.E
        E_z = self.E_z
        nu = self.nu
        nu_z = self.nu_z
        D = max(self._D, 0.0)
        mean = math.sqrt(0.5 * E * E_z * (1 - nu) * (1 + D / (1 + nu)))  # D sqrt(C11 C33)
        return 2 * math.sqrt(self._plane_stiffness / (1 / self.G_z + 2 * D / (mean + nu_z * E)))

    @property
    def volumetric_compliance(self) -> Expr:
        """2 D/(E (1 - d)) [1/pressure]."""
        return 2 * self._D / (self.E * (1 - self._d))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """The energy without theta, and theta."""
        eps = ufl.sym(H)
        G = self.E / (2 * (1 + self.nu))
        d = self._d
        alpha = 2 * self.nu_z + d
        plane_strain = eps[0, 0] + eps[1, 1]
        axial_strain = eps[2, 2]
        plane_energy = G * (eps[0, 0] ** 2 + eps[1, 1] ** 2 + 2 * eps[0, 1] ** 2)
        shear_energy = 2 * self.G_z * (eps[0, 2] ** 2 + eps[1, 2] ** 2)
        axial_energy = (
            G * (alpha - 1) * plane_strain * axial_strain
            + (self.E_z + G * (alpha**2 - 4 * self.nu_z - d)) * axial_strain**2 / 2
        )
        return plane_energy + shear_energy + axial_energy, plane_strain + alpha * axial_strain


@dataclass(frozen=True)
class NeoHookean(_TwoConstantLaw):
    """psi = mu/2 (I1 - 3) - mu ln J + lame_lambda/2 (ln J)^2.

    Any two of E [pressure], nu [1], mu [pressure], kappa [pressure], lame_lambda [pressure] say it.
    """

    model: Literal["neo_hookean"] = "neo_hookean"

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """mu/2 (I1 - 3) - mu ln J and ln J."""
        excess, log_J = _excess_and_log_J(H)
        return self.shear_modulus * excess, log_J

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches."""
        log_J = math.log(l1 * l2 * l3)
        shear_energy = float(self.shear_modulus) * ((l1 * l1 + l2 * l2 + l3 * l3 - 3) / 2 - log_J)
        E, nu = self.constants
        lame_lambda = E * nu / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else 0.0
        return shear_energy + lame_lambda * log_J * log_J / 2


def _excess_and_log_J(H: Expr) -> tuple[Expr, Expr]:
    """(I1 - 3)/2 - ln J and ln J of F = 1 + H, with all digits of them and of their derivatives
    where H is small.
    """
    excess, growth = _excess_and_volume_growth(H)
    return excess, log1p(growth)


def _excess_and_volume_growth(H: Expr) -> tuple[Expr, Expr]:
    """(I1 - 3)/2 - ln J and J - 1, likewise."""
    nonlinear_growth = _nonlinear_volume_growth(H)  # without tr H, which cancels that of (I1 - 3)/2
    growth = ufl.tr(H) + nonlinear_growth
    return ufl.inner(H, H) / 2 - nonlinear_growth + log1p_remainder(growth), growth


def _nonlinear_volume_growth(H: Expr) -> Expr:
    """J - 1 less tr H."""
    return (ufl.tr(H) ** 2 - ufl.tr(H * H)) / 2 + ufl.det(H)


@dataclass(frozen=True)
class _IsochoricLaw(_Law):
    """psi = isochoric(J^-2/3 C) + kappa/2 (ln J)^2, with the law's own constants and nu or kappa."""

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
        """k [pressure]: simple shear by gamma at constant volume gives the plane that it shears
        along a normal stress less than the mean stress by k gamma^2, to leading order (Poynting
        effect).

        In the logarithms h_i of stretches whose product is one, the energy of any isotropic law
        begins with mu (h_1^2 + h_2^2 + h_3^2) + c h_1 h_2 h_3. In simple shear they are gamma/2,
        -gamma/2 and 0, and the principal axes lie gamma/4 beside those at 45 degrees, from which k
        = mu/2 - c/12 follows.
        """

    @abstractmethod
    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """Isochoric energy [pressure] of excess = tr C/3 - 1, square = dev C : dev C/6, cube = det
        dev C; det C = 1.
        """

    @abstractmethod
    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """Isochoric energy [pressure] of principal stretches whose product is one (floats or
        arrays).
        """

    def canonical(self) -> Self:
        """The same material said with nu; ValueError when not exactly one of nu and kappa is given."""
        if (self.nu is None) == (self.kappa is None):
            raise ValueError("needs exactly one of nu, kappa beside the law's own constants")
        mu = self.small_strain_mu
        if not (math.isfinite(mu) and mu > 0):
            raise ValueError(f"the small-strain shear modulus is {mu:g}; it must be > 0")
        if self.kappa is None:
            return replace(self, flow=self.flow_by_permeability)
        nu = (3 * self.kappa - 2 * mu) / (2 * (3 * self.kappa + mu))
        if not nu > -1:
            raise ValueError(
                f"kappa = {self.kappa:g} is lost beside mu = {mu:g}: nu is -1 to all digits"
            )
        material = replace(self, nu=nu, kappa=None)
        return replace(material, flow=material.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """Small-strain E [pressure] and nu of a canonical material."""
        assert self.nu is not None
        return Constants(2 * self.small_strain_mu * (1 + self.nu), self.nu)

    @property
    def volumetric_compliance(self) -> Expr:
        """1/kappa = 3 (1 - 2 nu)/(2 mu (1 + nu)) [1/pressure]; 0 when incompressible."""
        return 3 * (1 - 2 * self.nu) / (2 * self.small_strain_mu * (1 + self.nu))  # type: ignore[operator]

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """The isochoric energy and ln J by way of a few scalar variables, through which all
        derivatives can pass.
        """
        w, log_J = map(
            ufl.variable, _excess_and_log_J(H)
        )  # tr C/3 = 1 + 2/3 ln J + 2/3 w: no digit is lost at rest
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
        """The same energy with the q of `mixed_volume`."""
        remaining_energy, log_J = self.energy_parts(H)
        return remaining_energy + self.mixed_volumetric_energy(H, log_J, q)

    def mixed_volumetric_energy(
        self, H: Expr, log_J: Expr, q: Expr, shear_fraction: Expr = 1.0
    ) -> Expr:
        """Energy of the volume with a field q that is the normal stress on a sheared surface, not
        the mean stress.

        The mean stress in sheared material is q + k (I1 - 3), with k the `poynting_coefficient`, or
        0 where that is below 0; to leading order I1 - 3 is gamma^2. Contact holds the normal stress
        of a surface, and the shear gamma along it jumps between elements. A continuous mean stress
        cannot follow, and the pressure became a saw-tooth under friction. The stationary point is
        that of the displacement law whatever k is, also where the law is incompressible
        (docs/decisions/0048-a-mixed-pressure-that-shear-leaves-alone.md).

        Parameters
        ----------
        H : Expr
            Displacement gradient (3 x 3).
        log_J : Expr
            ln J of it, as `parts` gives it.
        q : Expr
            Field [pressure], positive in tension.
        share : Expr
            Of the shear modulus, and so of k, that is left.

        Returns
        -------
        Expr
            p ln J - p^2/(2 kappa) [pressure] with the mean stress p = q + share k (I1 - 3).
        """
        # not scaled by J^(-2/3): that is concave in ln J, and Newton's method then failed in
        # uniform shear
        elongation = ufl.variable(
            2 * ufl.tr(H) + ufl.inner(H, H)
        )  # I1 - 3, with its digits where H is small
        # with k < 0, as of Ogden's law with alpha = 9, Newton's method did not converge (under a
        # ball, depth 0.4 R)
        k = algebra.maximum(self.poynting_coefficient, 0.0)
        mean_stress = q + shear_fraction * k * elongation
        return mean_stress * log_J - mean_stress * mean_stress * self.volumetric_compliance / 2

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches."""
        J = l1 * l2 * l3
        isochoric_factor = J ** (-1 / 3)
        isochoric = self.energy_of_stretches(
            l1 * isochoric_factor, l2 * isochoric_factor, l3 * isochoric_factor
        )
        kappa = 1 / float(self.volumetric_compliance) if self.constants.nu < 0.5 else 0.0
        return float(isochoric) + kappa * math.log(J) ** 2 / 2

    def isochoric_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """The energy that is free of any change of volume, and ln J: its `parts`."""
        return self.energy_parts(H)

    @property
    def inverse_bulk_modulus(self) -> Expr:
        """1/kappa [1/pressure]."""
        return self.volumetric_compliance


@dataclass(frozen=True)
class _InvariantLaw(_IsochoricLaw):
    """Laws of the modified invariants J^-2/3 I1 and J^-4/3 I2."""

    @property
    def poynting_coefficient(self) -> Expr:
        """mu/3, of a law of I1 alone; 2/3 of the slope along I2 more where there is one."""
        return self.small_strain_mu / 3

    @abstractmethod
    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """Isochoric energy [pressure] of i1 = J^-2/3 I1 - 3 and i2 = J^-4/3 I2 - 3."""

    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """As `_Isochoric`: i1 = 3 excess, i2 = 3 (2 excess + excess^2 - square)."""
        return self.energy_of_invariants(3 * excess, 3 * (excess * (2 + excess) - square))

    def energy_of_stretches(self, l1: Expr, l2: Expr, l3: Expr) -> Expr:
        """As `_Isochoric`: I1 and I2 are sums of the squares and of their products."""
        a = l1 * l1
        b = l2 * l2
        c = l3 * l3
        return self.energy_of_invariants(a + b + c - 3, a * b + b * c + c * a - 3)


@dataclass(frozen=True)
class MooneyRivlin(_InvariantLaw):
    """C10 (I1 - 3) + C01 (I2 - 3)."""

    C10: AnyModulus = 0.0
    C01: AnyModulus = 0.0
    model: Literal["mooney_rivlin"] = "mooney_rivlin"

    @property
    def small_strain_mu(self) -> Expr:
        """2 (C10 + C01)."""
        return 2 * (self.C10 + self.C01)

    @property
    def poynting_coefficient(self) -> Expr:
        """(2 C10 + 4 C01)/3."""
        return (2 * self.C10 + 4 * self.C01) / 3

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """C10 i1 + C01 i2."""
        return self.C10 * i1 + self.C01 * i2


@dataclass(frozen=True, kw_only=True)
class Yeoh(_InvariantLaw):
    """C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3."""

    C10: Modulus
    C20: AnyModulus = 0.0
    C30: AnyModulus = 0.0
    model: Literal["yeoh"] = "yeoh"

    @property
    def small_strain_mu(self) -> Expr:
        """2 C10."""
        return 2 * self.C10

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """C10 i1 + C20 i1^2 + C30 i1^3."""
        return i1 * (self.C10 + i1 * (self.C20 + i1 * self.C30))


@dataclass(frozen=True, kw_only=True)
class Ogden(_IsochoricLaw):
    """sum mu_i/alpha_i (sum of stretches^alpha_i - 3); small-strain mu = sum mu_i alpha_i / 2."""

    mu: Annotated[tuple[float, ...], Len(1, 20), PRESSURE]
    alpha: Annotated[tuple[float, ...], Len(1, 20)]
    model: Literal["ogden"] = "ogden"

    def canonical(self) -> Self:
        """As `_Isochoric`; ValueError too when mu and alpha differ in length or an alpha is zero."""
        if len(self.mu) != len(self.alpha):
            raise ValueError(
                f"mu has {len(self.mu)} entries and alpha {len(self.alpha)}; they belong in pairs"
            )
        if 0 in self.alpha:
            raise ValueError("an alpha of zero has no meaning")
        return super().canonical()

    @property
    def small_strain_mu(self) -> Expr:
        """sum mu_i alpha_i / 2."""
        return sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True)) / 2

    @property
    def poynting_coefficient(self) -> Expr:
        """sum mu_i alpha_i (6 - alpha_i)/24, since c = sum mu_i alpha_i^2 / 2."""
        pairs = zip(self.mu, self.alpha, strict=True)
        return sum(mu * alpha * (6 - alpha) for mu, alpha in pairs) / 24

    def isochoric_energy(self, excess: Expr, square: Expr, cube: Expr) -> Expr:
        """sum mu_i/alpha_i (sum of stretches^alpha_i - 3); near rest, where stretches lose digits,
        by a series.
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
        """The squared stretches are mean (1 + t_i) with mean = 1 + excess and the t_i of a
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
        """sum mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3)."""
        stretches = (l1, l2, l3)
        terms = zip(self.mu, self.alpha, strict=True)
        return sum(
            mu / alpha * (sum(stretch**alpha for stretch in stretches) - 3) for mu, alpha in terms
        )


@dataclass(frozen=True, kw_only=True)
class Gent(_InvariantLaw):
    """-mu Jm/2 ln(1 - (I1 - 3)/Jm): stiffens without bound as I1 - 3 comes to Jm."""

    mu: Modulus
    Jm: Annotated[float, Gt(0)]
    model: Literal["gent"] = "gent"

    @property
    def small_strain_mu(self) -> Expr:
        """mu."""
        return self.mu

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """-mu Jm/2 ln(1 - i1/Jm); not a number beyond the limit, which ends a Newton step."""
        return -self.mu * self.Jm / 2 * log1p(-i1 / self.Jm)


@dataclass(frozen=True, kw_only=True)
class Fung(_InvariantLaw):
    """mu/(2 b) (exp(b (I1 - 3)) - 1): tissue, which stiffens exponentially; b -> 0 is mooney_rivlin
    with C10 = mu/2.
    """

    mu: Modulus
    b: Annotated[float, Gt(0)]
    model: Literal["fung"] = "fung"

    @property
    def small_strain_mu(self) -> Expr:
        """mu."""
        return self.mu

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """mu/(2 b) (exp(b i1) - 1), with all digits of a small b i1."""
        return self.mu / (2 * self.b) * (self.b * i1 + expm1_remainder(self.b * i1))


# Series of the inverse Langevin function (Arruda & Boyce 1993): psi = mu sum c_i lambda_m^(2-2i)
# (I1^i - 3^i)
LANGEVIN_SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True, kw_only=True)
class ArrudaBoyce(_InvariantLaw):
    """mu sum_i c_i lambda_m^(2-2i) (I1^i - 3^i), c = 1/2, 1/20, 11/1050, 19/7000, 519/673750."""

    mu: Modulus
    lambda_m: Annotated[float, Gt(1)]
    model: Literal["arruda_boyce"] = "arruda_boyce"

    @property
    def small_strain_mu(self) -> Expr:
        """mu (1 + 3/(5 lambda_m^2) + 99/(175 lambda_m^4) + ...), twice the derivative of psi at I1
        = 3.
        """
        terms = (
            i * c * 3 ** (i - 1) * self.lambda_m ** (2 - 2 * i)
            for i, c in enumerate(LANGEVIN_SERIES, start=1)
        )
        return 2 * self.mu * sum(terms)

    def energy_of_invariants(self, i1: Expr, i2: Expr) -> Expr:
        """mu sum_i c_i lambda_m^(2-2i) (I1^i - 3^i), I1^i - 3^i = i1 (I1^(i-1) + 3 I1^(i-2) + ... +
        3^(i-1)).
        """
        I1 = 3 + i1
        slope = 0.0
        power = 1.0
        for i, c in enumerate(LANGEVIN_SERIES, start=1):
            slope = slope + c * self.lambda_m ** (2 - 2 * i) * power
            power = I1 * power + 3.0**i
        return self.mu * i1 * slope


class ConfinedSwelling(NamedTuple):
    """What a gel that is held sideways does in a bath, from its reference: stretch along its free
    axis, and nominal stress across [pressure], < 0 where it pushes.
    """

    stretch: float
    lateral_stress: float


@dataclass(frozen=True, kw_only=True)
class Gel(_Law):
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
        excess, growth = _excess_and_volume_growth(H)
        return self.shear_modulus * excess + self._swelling_energy(growth)

    def energy_of_bar(self, l1: float, l2: float, l3: float) -> float:
        """psi [pressure] of principal stretches."""
        J = l1 * l2 * l3
        excess = (l1 * l1 + l2 * l2 + l3 * l3 - 3) / 2 - math.log(J)
        return float(self.shear_modulus * excess + self._swelling_energy(J - 1))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """psi less stiffness e^2/2, and e = J - 1."""
        excess, e = _excess_and_volume_growth(H)
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


Material = (
    LinearElastic
    | TransverselyIsotropic
    | NeoHookean
    | MooneyRivlin
    | Yeoh
    | Ogden
    | Gent
    | Fung
    | ArrudaBoyce
    | Gel
)
# Laws that `split`: shear may relax alone
ShearRelaxingLaw = LinearElastic | MooneyRivlin | Yeoh | Ogden | Gent | Fung | ArrudaBoyce

STABILITY_CONDITIONS = {  # of two constants whose numbers do not show what a stable material is
    frozenset({"mu", "lame_lambda"}): "lame_lambda > -2 mu/3",
    frozenset({"kappa", "lame_lambda"}): "lame_lambda < kappa",
    frozenset({"nu", "lame_lambda"}): "lame_lambda of the sign of nu, which is not 0",
}

YOUNG_AND_POISSON: dict[
    tuple[str, ...], Callable[[float, float], tuple[float, float]]
] = {  # E and nu, of each two constants
    ("E", "nu"): lambda E, nu: (E, nu),
    ("E", "mu"): lambda E, mu: (E, E / (2 * mu) - 1),
    ("E", "kappa"): lambda E, kappa: (E, (3 * kappa - E) / (6 * kappa)),
    ("E", "lame_lambda"): lambda E, lam: (
        E,
        2 * lam / (E + lam + math.sqrt(E * E + 9 * lam * lam + 2 * E * lam)),
    ),
    ("nu", "mu"): lambda nu, mu: (2 * mu * (1 + nu), nu),
    ("nu", "kappa"): lambda nu, kappa: (3 * kappa * (1 - 2 * nu), nu),
    ("nu", "lame_lambda"): lambda nu, lam: (
        (lam * (1 + nu) * (1 - 2 * nu) / nu if nu else math.nan),
        nu,
    ),
    ("mu", "kappa"): lambda mu, K: (
        9 * K * mu / (3 * K + mu),
        (3 * K - 2 * mu) / (2 * (3 * K + mu)),
    ),
    ("mu", "lame_lambda"): lambda mu, lam: (
        mu * (3 * lam + 2 * mu) / (lam + mu),
        lam / (2 * (lam + mu)),
    ),
    ("kappa", "lame_lambda"): lambda K, lam: (
        9 * K * (K - lam) / (3 * K - lam),
        lam / (3 * K - lam),
    ),
}


def young_and_poisson(given: dict[str, float]) -> tuple[float, float]:
    """E and nu from exactly two isotropic constants.

    Everything passes through E = 9 kappa mu / (3 kappa + mu) and its kin (Slaughter 2002, table
    5.1). Raises ValueError when not exactly two are given, or when they belong to no stable
    material.
    """
    if len(given) != 2:
        raise ValueError(
            f"needs exactly two of {', '.join(ISOTROPIC_CONSTANTS)}; got "
            f"{', '.join(given) or 'none'}"
        )
    names = tuple(name for name in ISOTROPIC_CONSTANTS if name in given)
    if names not in YOUNG_AND_POISSON:
        raise ValueError(f"unknown isotropic constants {', '.join(given)}")
    try:
        E, nu = YOUNG_AND_POISSON[names](*(given[name] for name in names))
    except ZeroDivisionError:
        E = math.nan
        nu = math.nan
    if not (math.isfinite(E) and E > 0 and -1 < nu <= 0.5):
        result = f"E = {E:g} and nu = {nu:g}" if math.isfinite(E) else "no E"
        condition = STABILITY_CONDITIONS.get(frozenset(given), "")
        requirement = "a stable material has E > 0 and -1 < nu <= 0.5" + (
            f", and so {condition}" if condition else ""
        )
        raise ValueError(f"these constants give {result}; {requirement}")
    return E, nu
