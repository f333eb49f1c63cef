"""Strain energy of a region: virtual work, stress and volume ratio."""

from __future__ import annotations

from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_expression, compile_form
from indent_sim.fe.measured_constants import VOLUME_DEGREE
from indent_sim.fe.symbolic_constants import symbolic_copy
from indent_sim.fe.terms.inverted_elements import InvertedElements
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.variation import variations
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field, TimeLevel
from indent_sim.mesh.model_domain import Region
from indent_sim.model.materials import Material
from indent_sim.scene.scene import Scene


def pressure_fields(scene: Scene) -> list[Field]:
    """Return the pressure field q of each region with a mixed formulation.

    Displacement and pressure are Taylor-Hood elements, which do not lock in volume.

    Every region has its own field because the pressure jumps between materials. The residual of q
    is a volume; it is weighted with the largest Young's modulus of all regions, because an error of
    the volume of one region loads adjacent regions.
    """
    regions = scene.physics.domain.regions
    E = max(region.material.constants.E for region in regions)
    mixed = [(f"q{k}", region) for k, region in enumerate(regions) if region.formulation == "mixed"]
    return [
        Field(name, DISPLACEMENT_ORDER - 1, domain=(region,), weight=E) for name, region in mixed
    ]


class CellSample(NamedTuple):
    """Fields of a region whose means over points represent a cell.

    Attributes
    ----------
    points : ndarray, (points, dim)
        Points of the reference cell.
    weights : ndarray, (points,)
        Weights of the points, whose sum is 1.
    stress : Expr
        Cauchy stress (3, 3) [pressure].
    psi : Expr
        Strain energy density [pressure].
    plastic_strain : Expr or None
        Equivalent plastic strain; None in a region that does not yield.
    """

    points: np.ndarray
    weights: np.ndarray
    stress: Expr
    psi: Expr
    plastic_strain: Expr | None = None


class StrainEnergy(Term):
    """Strain energy int psi dOmega of a region.

    H is the displacement gradient, F = I + H.

    Attributes
    ----------
    nominal_stress : Expr
        First Piola-Kirchhoff stress P = dpsi/dH (3, 3) [pressure], a UFL tensor.
    stress : Expr
        Cauchy stress P F^T/J (3, 3) [pressure], a UFL tensor; P itself at small strain.
    psi : Expr
        Strain energy density [pressure], a UFL scalar.
    J : Expr
        Volume ratio det F, a UFL scalar.
    E_star : float
        Current plane-strain modulus [pressure], which decreases if the material relaxes.
    """

    is_bulk = True
    psi: Expr

    def __init__(self, body: Body, region: Region):
        self.body = body
        self.region = region
        scene = body.scene
        fields = body.now.fields
        self.has_constant_tangent = region.material.is_small_strain
        self.E_star = region.material.E_star
        self.field_names = tuple(
            field.name for field in pressure_fields(scene) if field.domain == (region,)
        )
        material = symbolic_copy(region.material, body.mesh)
        self._H = H = ufl.variable(
            scene.physics.domain.kinematics.displacement_gradient(fields["u"], body.X)
        )
        q = fields[self.field_names[0]] if self.field_names else None
        self._energy_density, potential = self._energy_densities(
            material, H, None if q is None else ufl.variable(q)
        )
        F = ufl.Identity(3) + H
        self.nominal_stress = self.stress = self._stress_of(potential, H)
        if not region.material.is_small_strain:
            self.stress = self.nominal_stress * F.T / ufl.det(F)
        self.J = ufl.det(F)
        self.energy = body.region_integral(self._energy_density, region)

    def _energy_densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """Return the potential density for the virtual work, and for evaluation at any point.

        The two differ if the potential has coefficients at quadrature points.
        """
        self.psi = material.energy(H) if q is None else material.mixed_energy(H, q)
        return self.psi, self.psi

    def _stress_of(self, potential: Expr, H: Expr) -> Expr:
        """Return the first Piola-Kirchhoff stress (3, 3) for the potential density at any point."""
        return ufl.diff(potential, H)

    @property
    def cell_sample(self) -> CellSample:
        """The fields that represent a cell: the fields at its centroid."""
        dim = self.body.body_mesh.dim
        centroid = np.full((1, dim), 1 / (dim + 1))
        return CellSample(centroid, np.ones(1), self.stress, self.psi)

    @cached_property
    def cells(self) -> np.ndarray:
        """Cells (n,) of the region that this rank owns."""
        body = self.body
        number = self.body.scene.physics.domain.regions.index(self.region)
        owned = body.mesh.topology.index_map(body.body_mesh.dim).size_local
        return np.flatnonzero(body.body_mesh.regions[:owned] == number).astype(np.int32)

    def predict_modulus(self, start_depth: float, depth: float) -> None:
        """Set `E_star` to the modulus expected at the end of a step; constant for elastic laws.

        Parameters
        ----------
        start_depth : float
            Depth at the beginning of the step [length].
        depth : float
            Depth at the end of the step [length].
        """

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """First variation of the energy along `now.test`, a UFL form."""
        return self.body.region_integral(variations(self._energy_density, now)[0], self.region)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Second variation of the energy along `now.test` and `now.trial`, a UFL form."""
        return self.body.region_integral(variations(self._energy_density, now)[1], self.region)

    @cached_property
    def _energy_form(self) -> fem.Form:
        return compile_form(self.energy)

    def value(self) -> float:
        """Strain energy of the region [energy], this rank's part in the model domain."""
        return float(fem.assemble_scalar(self._energy_form))

    def find_inverted_elements(self) -> InvertedElements | None:
        """Find the smallest J = det F and the largest principal stretch (collective).

        Both are evaluated at the quadrature points. Returns None at small strain.
        """
        body = self.body
        if self.region.material.is_small_strain:
            return None
        dim = body.body_mesh.dim
        points, _ = compat.quadrature_rule(compat.CELL_NAMES[dim], VOLUME_DEGREE[dim])
        F = ufl.Identity(3) + self._H
        values = ufl.as_vector(
            [*(F[i, k] for i in range(3) for k in range(3)), *(body.X[k] for k in range(dim))]
        )
        table = compat.evaluate_expression(
            compile_expression(values, points), body.mesh, self.cells
        ).reshape(-1, 9 + dim)
        extremes = InvertedElements(np.inf, (np.inf,) * dim, 0.0, (np.inf,) * dim)
        if len(table):
            gradients = table[:, :9].reshape(-1, 3, 3)
            X = table[:, 9:]
            J = np.linalg.det(gradients)
            stretches = np.linalg.norm(gradients, ord=2, axis=(1, 2))
            smallest_J = int(np.argmin(J))
            largest_stretch = int(np.argmax(stretches))
            positions = tuple(map(float, X[smallest_J])), tuple(map(float, X[largest_stretch]))
            extremes = InvertedElements(
                float(J[smallest_J]), positions[0], float(stretches[largest_stretch]), positions[1]
            )
        return reduce(InvertedElements.merge_extremes, body.comm.allgather(extremes))

    @cached_property
    def _inverted_measure_form(self) -> fem.Form:
        inverted = ufl.conditional(ufl.lt(self.J, 0.0), 1.0, 0.0)
        return compile_form(inverted * self.body.region_measure(self.region))

    def inverted_size(self) -> float:
        """Size of the part with inverted elements, J < 0 [length] (collective).

        It is the dim-th root of the area or volume of this part.
        """
        measure = self.body.comm.allreduce(
            fem.assemble_scalar(self._inverted_measure_form), op=MPI.SUM
        )
        return float(measure ** (1 / self.body.body_mesh.dim))
