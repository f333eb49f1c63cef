"""Linear elastic laws: isotropic and transversely isotropic."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Gt, Lt

from indent_sim.model.algebra import (
    Expr,
    ufl,
)
from indent_sim.model.elastic_law import Constants, ElasticLaw, Formulation, TwoConstantLaw
from indent_sim.model.plasticity import Plasticity
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.units import (
    Modulus,
)

# Round-off error of a strain energy that is zero.
ENERGY_ROUNDING = 1e-14


@dataclass(frozen=True)
class LinearElastic(TwoConstantLaw):
    """Isotropic Hooke's law at small strain, psi = mu eps:eps + lame_lambda/2 (tr eps)^2.

    Source: notes, equations 2.1-2.4. The law is defined by any two of E [pressure], nu [1], mu
    [pressure], kappa [pressure] and lame_lambda [pressure].
    """

    plasticity: Plasticity | None = None
    model: Literal["linear_elastic"] = "linear_elastic"

    is_small_strain: ClassVar[bool] = True

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the energy mu eps:eps [pressure], and tr eps."""
        eps = ufl.sym(H)
        return self.shear_modulus * ufl.inner(eps, eps), ufl.tr(eps)

    def isochoric_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the isochoric energy mu dev eps : dev eps [pressure], and tr eps."""
        deviator = ufl.dev(ufl.sym(H))
        return self.shear_modulus * ufl.inner(deviator, deviator), ufl.tr(H)

    def mixed_volumetric_energy(
        self, H: Expr, theta: Expr, q: Expr, shear_fraction: Expr = 1.0
    ) -> Expr:
        """Return q theta - q^2/(2 kappa) [pressure] with the mean stress q.

        The bulk modulus does not relax, so that `shear_fraction` has no effect.
        """
        return q * theta - q * q * self.inverse_bulk_modulus / 2

    @property
    def inverse_bulk_modulus(self) -> Expr:
        """Inverse bulk modulus 1/kappa = 3 (1 - 2 nu)/E [1/pressure]."""
        return 3 * (1 - 2 * self.nu) / self.E  # type: ignore[operator]


@dataclass(frozen=True, kw_only=True)
class TransverselyIsotropic(ElasticLaw):
    """Transversely isotropic Hooke's law at small strain with the axis z.

    E and nu are the in-plane constants (across the axis), nu_z = -eps_plane/eps_z under a stress
    sigma_z, and G_z is the shear modulus of planes through the axis.

    With D = 1 - nu - 2 nu_z^2 E/E_z >= 0, d = D/(1 + nu), G = E/(2 (1 + nu)), alpha = 2 nu_z + d
    and the volume measure theta = eps_x + eps_y + alpha eps_z,

        psi = G (eps_x^2 + eps_y^2 + 2 eps_xy^2) + 2 G_z (eps_xz^2 + eps_yz^2)
              + G (alpha - 1)(eps_x + eps_y) eps_z + [E_z + G (alpha^2 - 4 nu_z - d)] eps_z^2/2
              + stiffness theta^2/2,    stiffness = E (1 - d)/(2 D).

    All terms but the last are finite at D = 0 (incompressible). For isotropic constants theta = tr
    eps and stiffness = lame_lambda. Source: Lekhnitskii (1963), Theory of Elasticity of an
    Anisotropic Elastic Body.
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
        """Return the same material with the flow defined by the permeability.

        Raises ValueError if the strain energy is not positive.
        """
        if not self._D >= -ENERGY_ROUNDING:
            largest_nu_z = math.sqrt((1 - self.nu) * self.E_z / (2 * self.E))
            problem = f"nu_z = {self.nu_z:g} makes the strain energy negative for some strains"
            raise ValueError(
                f"{problem}: with these E, E_z and nu it must lie within +-{largest_nu_z:.6g}"
            )
        return replace(self, flow=self.flow_by_permeability)

    @property
    def constants(self) -> Constants:
        """Young's modulus [pressure] and Poisson's ratio of the equivalent isotropic material.

        The equivalent material has the same indentation modulus, and nu = (1 - d)/2 for the same
        compressibility, with the constant d of the class.
        """
        nu = min(max((1 - self._d) / 2, -0.99), 0.5)
        return Constants(self._indentation_modulus * (1 - nu * nu), nu)

    def bar_modulus(self, confined_directions: int) -> float:
        """Return the modulus E_z, E_z/(1 - nu_z^2 E/E_z) or C33 = E_z (1 - nu)/D [pressure]."""
        if confined_directions < 2:
            return self.E_z / (1 - confined_directions * self.nu_z**2 * self.E / self.E_z)
        return self.E_z * (1 - self.nu) / self._D if self._D > ENERGY_ROUNDING else math.inf

    @property
    def _D(self) -> Expr:
        """Constant D = 1 - nu - 2 nu_z^2 E/E_z, which is 0 if the material is incompressible."""
        return 1 - self.nu - 2 * self.nu_z**2 * self.E / self.E_z

    @property
    def _d(self) -> Expr:
        """Constant d = D/(1 + nu) of the energy."""
        return self._D / (1 + self.nu)

    @property
    def decay_rates(self) -> tuple[float, float]:
        """Decay rates below the surface: real parts of two roots s of a biquadratic equation.

        The equation is C33 C44 s^4 - (C11 C33 - C13^2 - 2 C13 C44) s^2 + C11 C44 = 0, and Re s > 0.
        The stiffnesses are multiplied by D, so that they are finite at D = 0.
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
        if not root_difference:
            return mean_root, mean_root + root_difference
        return product / (mean_root + root_difference), mean_root + root_difference

    @property
    def _plane_stiffness(self) -> float:
        """C33 - C13^2/C11 [pressure], which is finite at D = 0."""
        return self.E_z + 2 * self.nu_z**2 * self.E / (1 + self.nu + max(self._D, 0.0))

    @property
    def _indentation_modulus(self) -> float:
        """Indentation modulus M [pressure] along the axis, finite at D = 0.

        M = 2 sqrt((C11 C33 - C13^2)/C11 / (1/C44 + 2/(sqrt(C11 C33) + C13))).

        Source: Elliott (1949), Proc. Camb. Phil. Soc. 45, 621; Delafargue & Ulm (2004), Int. J.
        Solids Struct. 41, 7351.
        """
        E = self.E
        E_z = self.E_z
        nu = self.nu
        nu_z = self.nu_z
        D = max(self._D, 0.0)
        mean = math.sqrt(0.5 * E * E_z * (1 - nu) * (1 + D / (1 + nu)))  # D sqrt(C11 C33)
        return 2 * math.sqrt(self._plane_stiffness / (1 / self.G_z + 2 * D / (mean + nu_z * E)))

    @property
    def volumetric_compliance(self) -> Expr:
        """Inverse volumetric stiffness 2 D/(E (1 - d)) [1/pressure]."""
        return 2 * self._D / (self.E * (1 - self._d))

    def energy_parts(self, H: Expr) -> tuple[Expr, Expr]:
        """Return the energy [pressure] without the term in theta^2, and theta.

        theta is a weighted sum of the normal strains.
        """
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
