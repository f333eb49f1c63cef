"""The strain energy of a material: its virtual work, stress and volume ratio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import (
    DISPLACEMENT_ORDER,
    VOLUME_DEGREE,
    Body,
    Field,
    TimeLevel,
    symbolic_copy,
)
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.variation import variations
from indent_sim.mesh.model_domain import Region
from indent_sim.model.materials import Material
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class InvertedElements:
    """The smallest volume ratio J and the largest principal stretch in the body, and the undeformed
    points that have them [length].
    """

    J: float
    X: tuple[float, ...]
    stretch: float
    X_stretched: tuple[float, ...]

    def message(self, scene: Scene) -> str:
        """Both and their places, in the user's lengths."""
        axes = ", ".join(scene.physics.domain.kinematics.axes)

        def place(X: tuple[float, ...]) -> str:
            return ", ".join(f"{x * scene.physics.scales.length:.4g}" for x in X)

        stretched = f"the largest stretch, {self.stretch:.3g}, is at ({place(self.X_stretched)})"
        return (
            f", where J is smallest, {self.J:.3g}, at ({axes}) = ({place(self.X)}) and {stretched}"
        )

    def merge_extremes(self, second: InvertedElements) -> InvertedElements:
        """The smaller J of two places or regions and the larger stretch."""
        J, X = min((self.J, self.X), (second.J, second.X))
        stretch, X_stretched = max(
            (self.stretch, self.X_stretched), (second.stretch, second.X_stretched)
        )
        return InvertedElements(J, X, stretch, X_stretched)


def pressure_fields(scene: Scene) -> list[Field]:
    """The pressure q of each mixed region, one each because they jump between materials.

    A volume that an incompressible region lacks pushes what is around it: it is worth the stiffest
    region's E.
    """
    regions = scene.physics.domain.regions
    E = max(region.material.constants.E for region in regions)
    mixed = [(f"q{k}", region) for k, region in enumerate(regions) if region.formulation == "mixed"]
    return [
        Field(name, DISPLACEMENT_ORDER - 1, domain=(region,), weight=E) for name, region in mixed
    ]


class StrainEnergy(Term):
    """int psi dOmega of a region's material. nominal_stress P = dpsi/dH and stress (Cauchy, P
    F^T/J; P itself at small strain) are UFL tensors (3, 3) [pressure], psi [pressure] and J =
    det F UFL scalars.

    E_star [pressure] is the plane-strain modulus of the moment: the stress over the strain.
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
        self.nominal_stress = self.stress = ufl.diff(potential, H)
        if not region.material.is_small_strain:
            self.stress = self.nominal_stress * F.T / ufl.det(F)
        self.J = ufl.det(F)
        self.energy = body.region_integral(self._energy_density, region)

    def _energy_densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """The potential of the virtual work, per volume, and the same as it can be read off at any
        point of a cell.
        """
        self.psi = material.energy(H) if q is None else material.mixed_energy(H, q)
        return self.psi, self.psi

    @cached_property
    def cells(self) -> np.ndarray:
        """This rank's own cells in the region (n,)."""
        body = self.body
        number = self.body.scene.physics.domain.regions.index(self.region)
        owned = body.mesh.topology.index_map(body.body_mesh.dim).size_local
        return np.flatnonzero(body.body_mesh.regions[:owned] == number).astype(np.int32)

    def predict_modulus(self, start_depth: float, depth: float) -> None:
        """Take the modulus that a step to a depth is expected to end with.

        Parameters
        ----------
        began : float
            Depth [length] at the step's begin.
        depth : float
            Depth [length] that the tip is at now.
        """

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """First variation of the energy, as a UFL form."""
        return self.body.region_integral(variations(self._energy_density, now)[0], self.region)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Its second variation."""
        return self.body.region_integral(variations(self._energy_density, now)[1], self.region)

    def find_inverted_elements(self) -> InvertedElements | None:
        """The smallest J = det F and the largest principal stretch at the quadrature points, and
        where (collective); none at small strain.
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
            fem.Expression(values, points), body.mesh, self.cells
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
        return fem.form(inverted * self.body.region_measure(self.region))

    def inverted_size(self) -> float:
        """Size [length] of the region in which J < 0: the dim-th root of its measure (collective)."""
        measure = self.body.comm.allreduce(
            fem.assemble_scalar(self._inverted_measure_form), op=MPI.SUM
        )
        return float(measure ** (1 / self.body.body_mesh.dim))
