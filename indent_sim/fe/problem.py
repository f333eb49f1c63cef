"""Scene and mesh -> the sum of the terms of the virtual work, its tangent, and what can be measured on a solution.

    Pi(u, q, lam; delta) = int psi dOmega + int potential(g, lam) dGamma

residual = dPi, tangent = d(dPi), force = dPi/d(delta). Nothing here knows mechanics: the terms do. Friction
has a virtual work and no potential, and adds it to dPi.
"""

from __future__ import annotations

from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.body import Body
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.terms.friction import Friction
from indent_sim.fe.terms.matter import matter, strains_of
from indent_sim.fe.terms.multiplier import multiplier_order
from indent_sim.fe.terms.nodal import NodalContact
from indent_sim.fe.terms.strain import Crushed
from indent_sim.fe.terms.traction import Traction
from indent_sim.scene.scene import Scene


class Problem:
    """The boundary value problem of a scene on a mesh: the body's own terms and the contact term of its method."""

    def __init__(self, scene: Scene, body_mesh: BodyMesh):
        self.scene, self.law, self.body_mesh = scene, scene.physics.contact, body_mesh
        has_friction = bool(self.law.friction)
        self.body = body = Body(scene, body_mesh, multiplier=multiplier_order(scene), shear=has_friction)
        self.mesh, self.comm, self.trace = body.mesh, body.comm, body.trace
        self.unknowns, self.x = body.unknowns, body.x
        self.delta = fem.Constant(self.mesh, 0.0)
        terms = matter(body)
        self.strains = strains_of(terms)
        self.contact = self._contact()
        self.nodal_displacement, self.local_array = body.nodal_displacement, body.local_array
        self.multiplier_at, self.pressure_at = self.contact.multiplier_at, self.contact.pressure_at
        terms += [self.contact] if isinstance(self.contact, Traction) else []
        self.friction = self._friction() if has_friction else None
        works = [*terms, self.friction] if self.friction else terms
        test, trial = ufl.TestFunction(body.unknowns.space), ufl.TrialFunction(body.unknowns.space)
        self.terms = terms
        residuals, self._tangents = zip(*(term.work(test, trial) for term in works), strict=True)
        self._residual = fem.form(reduce(add, residuals))
        self._energy = fem.form(reduce(add, (term.energy for term in terms)))
        self.b = compat.create_vector(self._residual, body.unknowns.space)

    @cached_property
    def _tangent(self) -> Any:
        return fem.form(reduce(add, self._tangents))

    def create_tangent(self) -> PETSc.Mat:
        """The matrix that `assemble_tangent` fills."""
        return fem_petsc.create_matrix(self._tangent)

    def _contact(self) -> Traction | NodalContact:
        if self.law.multiplier == "nodal":
            return NodalContact(self.body, self.delta)
        return Traction(self.body, self.strains[0], self.delta)

    def _friction(self) -> Friction:
        assert isinstance(self.contact, Traction)
        return Friction(self.body, self.contact, self.delta)

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return float(self.delta.value)

    @property
    def stiffness_scale(self) -> float:
        """Pressure per length that compares gaps with pressures: the law's own, or E*/h_contact."""
        return float(getattr(self.law, "stiffness", self.scene.physics.material.E_star / self.scene.sizes.h_contact))

    @cached_property
    def row_weights(self) -> np.ndarray:
        """Factors that turn the rows of each field (force, volume, length) into forces, for measuring residuals."""
        weights = np.ones(self.unknowns.owned)
        for name in self.unknowns.names[1:]:
            places = self.unknowns.places(name)
            weights[places[places < self.unknowns.owned]] = self.weights[name]
        return weights

    @cached_property
    def weights(self) -> dict[str, float]:
        """The factor of each field beside the displacement that turns its rows into forces.

        A volume that an incompressible region lacks pushes what is around it: it is worth the stiffest region's E.
        """
        E = max(region.material.constants.E for region in self.scene.physics.part.regions)
        return dict.fromkeys(self.body.pressures.values(), E) | dict.fromkeys(("lam", "tau"), self.stiffness_scale)

    # ---- what is observed of it ----------------------------------------------------------------------------

    def least_volume_ratio(self) -> Crushed | None:
        """The smallest J and where it is (collective); none at small strain."""
        found = [crushed for strain in self.strains if (crushed := strain.least_volume_ratio())]
        return min(found, key=lambda crushed: crushed.J, default=None)

    @property
    def has_symmetric_tangent(self) -> bool:
        """Whether the tangent is a second derivative of the potential."""
        return self.friction is None and self.contact.has_symmetric_tangent

    def soften(self, factor: float) -> None:
        """Multiply the stiffness of the contact law; 1 makes it the law's own again."""
        assert isinstance(self.contact, Traction)
        self.contact.soften(factor)
        if self.friction:
            self.friction.soften(factor)

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        if self.friction:
            self.friction.depart()

    def begin_solve(self) -> None:
        """Forget what the last solve has remembered."""
        if isinstance(self.contact, NodalContact):
            self.contact.begin_solve()

    # ---- algebra for the solver -----------------------------------------------------------------------------

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """dPi at the current solution, reactions included."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        if isinstance(self.contact, NodalContact):
            self.contact.add_residual(b)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """d(dPi) at the current solution, with identity rows for the constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent, self.body.bcs)
        if isinstance(self.contact, NodalContact):
            A.assemble(PETSc.Mat.AssemblyType.FLUSH)
            self.contact.add_tangent(A)
        A.assemble()

    def snapshot(self) -> list[PETSc.Vec]:
        """Copies of everything that makes a state: the solution and, where there is one, the frozen multiplier."""
        return [vector.copy() for vector in self._state_vectors()]

    def restore(self, state: list[PETSc.Vec]) -> None:
        """Put a snapshot (or a combination of snapshots) back."""
        for vector, values in zip(self._state_vectors(), state, strict=True):
            values.copy(vector)
            vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def _state_vectors(self) -> list[PETSc.Vec]:
        return [self.x, *self.contact.vectors]

    def is_admissible(self) -> bool:
        """Whether J > 0, and any other limit of the law is kept, at every quadrature point: the energy is a number.

        Residual and tangent do not show it: the derivative of ln J is as good for J < 0.
        """
        return self.scene.physics.small_strain or bool(np.isfinite(self._sum(self._energy)))

    def inside_out(self) -> float:
        """Size [length] of the region in which J < 0 (collective)."""
        return max(strain.inside_out() for strain in self.strains)

    # ---- measurements ---------------------------------------------------------------------------------------

    def _sum(self, form: Any) -> float:
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def force(self) -> float:
        """Virtual work of pressing deeper, dPi/d(delta), of the whole body."""
        if self.friction:
            return float(self.thrust()[-1])
        return self.scene.physics.part.copies * self.comm.allreduce(self.contact.force(), op=MPI.SUM)

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks."""
        assert self.friction
        return self.friction.room_at(points)

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) [pressure]."""
        assert self.friction
        return self.friction.shear_at(points)

    def thrust(self) -> np.ndarray:
        """Force on the tip along each axis, of the whole body; across a mirror plane it is that of the part."""
        assert self.friction
        return self.scene.physics.part.copies * self.comm.allreduce(self.friction.thrust(), op=MPI.SUM)

    def dissipation(self) -> float:
        """What friction dissipates on the way to the present state from the one before, in the whole body."""
        if not self.friction:
            return 0.0
        return self.scene.physics.part.copies * self.comm.allreduce(self.friction.dissipation(), op=MPI.SUM)

    def energy(self) -> float:
        """Pi of the whole body: strain plus contact energy."""
        return self.scene.physics.part.copies * self._sum(self._energy)

    def reactions(self) -> tuple[float, float]:
        """z-reaction of all supports, and the largest reaction of the pins that only remove rigid modes."""
        self.assemble_residual(self.b)
        values = self.b.array_r
        vertical = self.comm.allreduce(float(values[self.body.z_supports].sum()), op=MPI.SUM)
        stray = self.comm.allreduce(float(np.abs(values[self.body.pinned]).max(initial=0.0)), op=MPI.MAX)
        return self.scene.physics.part.copies * vertical, self.scene.physics.part.copies * stray
