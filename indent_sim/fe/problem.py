"""Scene and mesh -> one potential, its residual and tangent, and what can be measured on a solution.

    Pi(u, q, lam; delta) = int psi dOmega + int potential(g, lam) dGamma

residual = dPi, tangent = d(dPi), force = dPi/d(delta). Nothing else here knows mechanics.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.body import CONTACT, Body, symbolic
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.observe.surface import QUADRATURE_DEGREE, facet_nodes, from_midpoints
from indent_sim.fe.terms.nodal import NodalContact
from indent_sim.fe.terms.projection import Projection
from indent_sim.model.tips import gap_current, gap_reference
from indent_sim.scene.scene import Scene


class Problem(Body):
    """The boundary value problem of a scene on a mesh: the body and the contact term of its method."""

    def __init__(self, scene: Scene, body_mesh: BodyMesh):
        self.law = scene.contact
        super().__init__(scene, body_mesh, multiplier=self._multiplier_order(scene))
        self.delta = fem.Constant(self.mesh, 0.0)
        self.nodal: NodalContact | None = None
        self._build_forms()

    @staticmethod
    def _multiplier_order(scene: Scene) -> int:
        """The displacement's; of nodal pressures in three dimensions 1, since they live at vertices. 0 for none."""
        match scene.contact.multiplier:
            case "unknown":
                return scene.sizes.order
            case "nodal":
                return scene.sizes.order if scene.kinematics.dim == 2 else 1
        return 0

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return float(self.delta.value)

    @property
    def has_symmetric_tangent(self) -> bool:
        """Whether the tangent is a second derivative of the potential.

        Not if the variation of the body's own stress is dropped (Nitsche, theta = 0), nor if the rows of nodal
        pressures belong to an active set.
        """
        return self.law.multiplier in ("none", "unknown", "frozen")

    @property
    def stiffness_scale(self) -> float:
        """Pressure per length that compares gaps with pressures: the law's own, or E*/h_contact."""
        return float(getattr(self.law, "stiffness", self.scene.material.E_star / self.scene.sizes.h_contact))

    @cached_property
    def row_weights(self) -> np.ndarray:
        """Factors that turn the rows of each field (force, volume, length) into forces, for measuring residuals."""
        weights = np.ones(self.unknowns.owned)
        moduli = {"q": self.scene.material.constants[0], "lam": self.stiffness_scale}
        for name in self.unknowns.names[1:]:
            places = self.unknowns.places(name)
            weights[places[places < self.unknowns.owned]] = moduli[name]
        return weights

    # ---- the potential --------------------------------------------------------------------------------------

    def _build_forms(self) -> None:
        unknowns, X = self.unknowns, self.X
        self._contact_facets = self.surface_measure(CONTACT, QUADRATURE_DEGREE[self.body_mesh.dim])
        delta = ufl.variable(self.delta)
        g, normal = self._gap(X, delta)
        self.multiplier = self._multiplier(normal)
        test = ufl.TestFunction(unknowns.space)
        residual, tangent = self.work()
        energy, force = self.strain_energy, None
        if self.law.multiplier != "nodal":
            law = self._symbolic_law = symbolic(self.law, self.mesh)
            unknown = self.law.multiplier == "unknown"
            g_, lam_ = ufl.variable(g), ufl.variable(self.multiplier) if unknown else self.multiplier
            potential = law.potential(g_, lam_)
            # only what is unknown is varied: a frozen multiplier or the body's own stress (theta = 0) is not
            slope = ufl.diff(potential, g_)
            virtual = slope * ufl.derivative(g, unknowns.solution, test)
            if unknown:
                virtual += ufl.diff(potential, lam_) * ufl.derivative(self.multiplier, unknowns.solution, test)
            push = self.over_contact(virtual)
            residual, tangent = residual + push, tangent + ufl.derivative(push, unknowns.solution)
            energy += self.over_contact(potential)
            force = fem.form(self.over_contact(slope * ufl.diff(g, delta)))
            self.pressure = -slope
        else:
            self.nodal = NodalContact(self, *self._gap_derivatives(X))
        self._residual = fem.form(residual)
        self._tangent = fem.form(tangent)
        self._energy, self._force = fem.form(energy), force
        self.b = compat.create_vector(self._residual, unknowns.space)
        self.A = fem_petsc.create_matrix(self._tangent)

    def over_contact(self, integrand: Any) -> Any:
        """The integral of an expression over the contact surface, as a UFL form."""
        return integrand * self.weight * self._contact_facets

    def _gap(self, X: Any, delta: Any) -> tuple[Any, Any]:
        """The gap and the direction of the traction on the body (dg/dx) at the points of the contact surface."""
        kinematics, dim = self.scene.kinematics, self.body_mesh.dim
        tip = symbolic(self.scene.indenter, self.mesh)
        center = [fem.Constant(self.mesh, float(c)) for c in self.scene.center]
        u = self.unknowns.fields["u"]
        if self.scene.gap == "reference":
            down = ufl.as_vector([0.0] * (dim - 1) + [-1.0])
            return gap_reference(tip, *kinematics.horizontal(X, center), u[dim - 1], delta), down
        x = self._deformed = ufl.variable(X + u)
        g = gap_current(tip, *kinematics.horizontal(x, center), x[dim - 1], delta)
        return g, ufl.diff(g, x)

    def _gap_derivatives(self, X: Any) -> tuple[Any, Any, Any]:
        """g, dg/dx and d2g/dx2 on the contact surface; the reference gap depends on u_z alone, and linearly."""
        g, normal = self._gap(X, self.delta)
        if self.scene.gap == "reference":
            return g, normal, ufl.as_matrix(np.zeros((self.body_mesh.dim,) * 2).tolist())
        return g, normal, ufl.diff(normal, self._deformed)

    def _multiplier(self, normal: Any) -> Any:
        """lam of the potential: zero, an unknown, a given function, or the body's own normal stress."""
        match self.law.multiplier:
            case "unknown":
                return self.unknowns.fields["lam"]
            case "frozen":
                self.frozen = self._surface_function()
                return self.frozen
            case "stress":
                traction = self.scene.kinematics.in_plane(self.nominal_stress[:, 2])
                return ufl.dot(traction, normal)
        return ufl.as_ufl(0.0)

    def _surface_function(self) -> fem.Function:
        """A function of the displacement's order, one component."""
        element = compat.lagrange(self.body_mesh.dim, self.scene.sizes.order)
        return fem.Function(compat.function_space(self.mesh, element))

    def multiplier_at(self, points: np.ndarray) -> np.ndarray:
        """lam (facets, points) at reference-facet points of the contact surface [pressure] (collective).

        Of a law without a multiplier of its own it is the projection of <p_hat>.
        """
        if self.nodal is not None:
            return self.nodal.nodal_pressures() @ self.nodal.basis(points).T
        return self.trace.values(self._nodal_multiplier()[..., None], points)[..., 0]

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """lam as a pressure to be looked at: without its ripples at the vertices of triangles."""
        if self.nodal is not None or not self.trace.ripples:
            return self.multiplier_at(points)
        nodal = from_midpoints(self._nodal_multiplier(), partial(_summed, *self._multiplier_places))
        return self.trace.values(nodal[..., None], points)[..., 0]

    def _nodal_multiplier(self) -> np.ndarray:
        if self.law.multiplier in ("none", "stress"):
            self._projection.update()
        vector, places = self._multiplier_places
        with vector.localForm() as local:
            return local.array[places]

    @cached_property
    def _projection(self) -> Projection:
        return Projection(self, self._surface_function())

    @cached_property
    def _multiplier_places(self) -> tuple[PETSc.Vec, np.ndarray]:
        """The vector that holds the multiplier, and where in its local array its values (facets, nodes) stand."""
        facets = self.body_mesh.surfaces["top"]
        if self.law.multiplier == "unknown":
            nodes = facet_nodes(self.mesh, self.unknowns.own_space("lam"), facets)
            return self.x, self.unknowns.places("lam")[nodes]
        function = self.frozen if self.law.multiplier == "frozen" else self._projection.function
        return compat.vector(function), facet_nodes(self.mesh, function.function_space, facets)

    def soften(self, factor: float) -> None:
        """Multiply the stiffness of the contact law; 1 makes it the law's own again."""
        self._symbolic_law.stiffness.value = factor * self.law.stiffness  # type: ignore[union-attr]

    def begin_solve(self) -> None:
        """Forget what the last solve has remembered."""
        if self.nodal is not None:
            self.nodal.begin_solve()

    # ---- algebra for the solver -----------------------------------------------------------------------------

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """dPi at the current solution, reactions included."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        if self.nodal is not None:
            self.nodal.add_residual(b)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """d(dPi) at the current solution, with identity rows for the constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent, self.bcs)
        if self.nodal is not None:
            A.assemble(PETSc.Mat.AssemblyType.FLUSH)
            self.nodal.add_tangent(A)
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
        return [self.x, compat.vector(self.frozen)] if self.law.multiplier == "frozen" else [self.x]

    def is_admissible(self) -> bool:
        """Whether J > 0, and any other limit of the law is kept, at every quadrature point: the energy is a number.

        Residual and tangent do not show it: the derivative of ln J is as good for J < 0.
        """
        return self.scene.material.small_strain or bool(np.isfinite(self._sum(self._energy)))

    @cached_property
    def _inside_out(self) -> Any:
        inverted = ufl.conditional(ufl.lt(self._volume_ratio, 0.0), 1.0, 0.0)
        return fem.form(inverted * ufl.dx(self.mesh, metadata={"quadrature_degree": 2 * self.scene.sizes.order}))

    def inside_out(self) -> float:
        """Size [length] of the region in which J < 0: the dim-th root of its measure (collective)."""
        return float(self._sum(self._inside_out) ** (1 / self.body_mesh.dim))

    # ---- measurements ---------------------------------------------------------------------------------------

    def _sum(self, form: Any) -> float:
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def force(self) -> float:
        """Virtual work of pressing deeper, dPi/d(delta), of the whole body."""
        part = self.nodal.force() if self.nodal is not None else self._sum(self._force)
        return self.scene.copies * part

    def energy(self) -> float:
        """Pi of the whole body: strain plus contact energy."""
        return self.scene.copies * self._sum(self._energy)

    def reactions(self) -> tuple[float, float]:
        """z-reaction of all supports, and the largest reaction of the pins that only remove rigid modes."""
        self.assemble_residual(self.b)
        values = self.b.array_r
        vertical = self.comm.allreduce(float(values[self.z_supports].sum()), op=MPI.SUM)
        stray = self.comm.allreduce(float(np.abs(values[self.pinned]).max(initial=0.0)), op=MPI.MAX)
        return self.scene.copies * vertical, self.scene.copies * stray


def _summed(vector: PETSc.Vec, places: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Contributions (facets, nodes) summed over the facets and ranks that share a node, laid out as `vector`."""
    work = vector.duplicate()
    with work.localForm() as local:
        local.set(0.0)
        np.add.at(local.array, places, nodal)
    work.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    work.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
    with work.localForm() as local:
        return local.array[places]
