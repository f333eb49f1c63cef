"""The strain energy of a material: its virtual work, stress and volume ratio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from indent_sim.fe import compat
from indent_sim.fe.body import DEGREE, Body, symbolic
from indent_sim.fe.terms.variation import variations
from indent_sim.mesh.part import Region
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class Crushed:
    """The smallest volume ratio J in the body, and the undeformed point that has it [length]."""

    J: float
    X: tuple[float, ...]

    def words(self, scene: Scene) -> str:
        """J and the place, in the user's lengths."""
        place = ", ".join(f"{x * scene.physics.scales.length:.4g}" for x in self.X)
        return f", where J is smallest, {self.J:.3g}, at ({', '.join(scene.physics.part.kinematics.axes)}) = ({place})"


class Strain:
    """int psi dOmega of a region's material.

    nominal_stress P = dpsi/dH and stress (Cauchy, P F^T/J; P itself at small strain) are UFL tensors (3, 3) [pressure],
    psi [pressure] and J = det F UFL scalars.
    """

    def __init__(self, body: Body, region: Region):
        self.body, self.region = body, region
        scene, fields = body.scene, body.unknowns.fields
        material = symbolic(region.material, body.mesh)
        H = ufl.variable(scene.physics.part.kinematics.gradient(fields["u"], body.X))
        q = fields[body.pressures[region]] if region in body.pressures else None
        self.psi = material.energy(H) if q is None else material.mixed_energy(H, ufl.variable(q))
        F = ufl.Identity(3) + H
        self.nominal_stress = self.stress = ufl.diff(self.psi, H)
        if not region.material.small_strain:
            self.stress = self.nominal_stress * F.T / ufl.det(F)
        self.J = ufl.det(F)
        self.energy = body.over_region(self.psi, region)

    @cached_property
    def cells(self) -> np.ndarray:
        """This rank's own cells in the region (n,)."""
        return self.body.cells_of(self.region)

    def work(self, test: Any, trial: Any) -> tuple[Any, Any]:
        """First and second variation of the energy, as UFL forms."""
        first, second = variations(self.psi, self.body.unknowns.solution, test, trial)
        return self.body.over_region(first, self.region), self.body.over_region(second, self.region)

    def least_volume_ratio(self) -> Crushed | None:
        """The smallest J = det F at the quadrature points, and where (collective); none at small strain."""
        body = self.body
        if self.region.material.small_strain:
            return None
        dim = body.body_mesh.dim
        points, _ = compat.quadrature(compat.CELLS[dim], DEGREE[dim])
        values = ufl.as_vector([self.J, *(body.X[k] for k in range(dim))])
        cells = self.cells
        table = compat.evaluate(fem.Expression(values, points), body.mesh, cells).reshape(-1, 1 + dim)
        least = tuple(map(float, table[np.argmin(table[:, 0])])) if len(table) else (np.inf,) * (1 + dim)
        J, *X = min(body.comm.allgather(least))
        return Crushed(J, tuple(X))

    @cached_property
    def _inverted(self) -> Any:
        inverted = ufl.conditional(ufl.lt(self.J, 0.0), 1.0, 0.0)
        return fem.form(inverted * self.body.section(self.region))

    def inside_out(self) -> float:
        """Size [length] of the region in which J < 0: the dim-th root of its measure (collective)."""
        measure = self.body.comm.allreduce(fem.assemble_scalar(self._inverted), op=MPI.SUM)
        return float(measure ** (1 / self.body.body_mesh.dim))
