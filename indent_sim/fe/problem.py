"""Scene and mesh -> one potential, its residual and tangent, and what can be measured on a solution.

    Pi(u, ...; delta) = int psi dOmega + int potential(g, ...) dGamma

residual = dPi, tangent = d(dPi), force = dPi/d(delta). Nothing else here knows mechanics.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.surface import QUADRATURE_DEGREE, Trace, facet_nodes
from indent_sim.model.indenters import gap_current, gap_reference
from indent_sim.scene import Scene

CONTACT = 1


def symbolic(item: Any, mesh: Any) -> Any:
    """The same dataclass with every number a `Constant`: a changed value never recompiles a kernel."""
    numbers = {
        f.name: fem.Constant(mesh, float(value))
        for f in dataclasses.fields(item)
        if isinstance(value := getattr(item, f.name), (int, float)) and not isinstance(value, bool)
    }
    return dataclasses.replace(item, **numbers)


class Problem:
    """The boundary value problem of a scene on a mesh: forms, constraints, solution, measurements."""

    def __init__(self, scene: Scene, body_mesh: BodyMesh):
        self.scene = scene
        self.body_mesh = body_mesh
        self.mesh = body_mesh.mesh
        self.comm = body_mesh.comm
        self.delta = fem.Constant(self.mesh, 0.0)
        self._build_spaces()
        self._build_constraints()
        self._build_forms()

    # ---- unknowns -------------------------------------------------------------------------------------------

    def _build_spaces(self) -> None:
        dim, order = self.body_mesh.dim, self.scene.sizes.order
        self.space = compat.function_space(self.mesh, compat.lagrange(dim, order, dim))
        self.solution = fem.Function(self.space)
        self.x = compat.vector(self.solution)
        nodes = facet_nodes(self.mesh, self.space, self.body_mesh.surfaces["top"])
        coordinates = self.space.tabulate_dof_coordinates()[:, :dim]
        self.trace = Trace(nodes, coordinates[nodes], self.component_dofs(nodes), order)

    def component_dofs(self, nodes: np.ndarray) -> np.ndarray:
        """Indices (..., dim) into the local array of the displacement components at block dofs."""
        dim = self.body_mesh.dim
        return nodes[..., None] * dim + np.arange(dim)

    @property
    def displacement_dofmap(self) -> Any:
        """Dofmap of the displacement blocks."""
        return self.space.dofmap

    @property
    def dofs(self) -> int:
        """Number of unknowns, constrained ones included."""
        return self.space.dofmap.index_map.size_global * self.space.dofmap.index_map_bs

    # ---- how the body is held -------------------------------------------------------------------------------

    def _build_constraints(self) -> None:
        axes = self.scene.kinematics.axes
        held: list[tuple[int, np.ndarray]] = []
        for surface, support in self.scene.supports.items():
            if support == "fixed":
                held += [(component, self._facet_dofs(component, surface)) for component in range(len(axes))]
            elif support == "roller":
                normal = axes.index("z" if surface == "base" else surface[0])
                held.append((normal, self._facet_dofs(normal, surface)))
        pins = [(component, self._vertex_dofs(component, point)) for point, component in self.scene.pins]
        self.bcs = [self._zero(component, dofs) for component, dofs in held + pins]
        owned = self.space.dofmap.index_map.size_local * self.space.dofmap.index_map_bs
        self.constrained = _owned([dofs for _, dofs in held + pins], owned)
        self._z_supports = _owned([dofs for component, dofs in held if axes[component] == "z"], owned)
        self._pinned = _owned([dofs for _, dofs in pins], owned)

    def _facet_dofs(self, component: int, surface: str) -> np.ndarray:
        facets = self.body_mesh.surfaces[surface]
        return fem.locate_dofs_topological(self.space.sub(component), self.body_mesh.facet_dim, facets)

    def _vertex_dofs(self, component: int, point: tuple[float, ...]) -> np.ndarray:
        return fem.locate_dofs_topological(self.space.sub(component), 0, self.body_mesh.vertices_at(point))

    def _zero(self, component: int, dofs: np.ndarray) -> Any:
        return fem.dirichletbc(PETSc.ScalarType(0), dofs, self.space.sub(component))

    # ---- the potential --------------------------------------------------------------------------------------

    def _build_forms(self) -> None:
        kinematics, order = self.scene.kinematics, self.scene.sizes.order
        X = ufl.SpatialCoordinate(self.mesh)
        tags = self._contact_tags()
        volume = ufl.dx(metadata={"quadrature_degree": 2 * order})
        contact = ufl.ds(CONTACT, domain=self.mesh, subdomain_data=tags,
                         metadata={"quadrature_degree": QUADRATURE_DEGREE[self.body_mesh.dim]})  # fmt: skip
        material = symbolic(self.scene.material, self.mesh)
        law = symbolic(self.scene.contact, self.mesh)
        weight = kinematics.weight(X)
        H = kinematics.gradient(self.solution, X)
        delta = ufl.variable(self.delta)
        contact_energy = law.potential(self._gap(X, delta))
        Pi = material.energy(H) * weight * volume + contact_energy * weight * contact
        residual = ufl.derivative(Pi, self.solution)
        self.stress = material.stress(H)
        self._residual = fem.form(residual)
        self._tangent = fem.form(ufl.derivative(residual, self.solution))
        self._energy = fem.form(Pi)
        self._force = fem.form(ufl.diff(contact_energy, delta) * weight * contact)
        self.b = compat.create_vector(self._residual, self.space)
        self.A = fem_petsc.create_matrix(self._tangent)

    def _contact_tags(self) -> Any:
        facets = np.sort(self.body_mesh.surfaces["top"])
        values = np.full(len(facets), CONTACT, dtype=np.int32)
        return dolfinx_mesh.meshtags(self.mesh, self.body_mesh.facet_dim, facets, values)

    def _gap(self, X: Any, delta: Any) -> Any:
        kinematics, dim = self.scene.kinematics, self.body_mesh.dim
        tip = symbolic(self.scene.indenter, self.mesh)
        center = [fem.Constant(self.mesh, float(c)) for c in self.scene.center]
        u = self.solution
        if self.scene.gap == "reference":
            return gap_reference(tip, *kinematics.horizontal(X, center), u[dim - 1], delta)
        x = X + u
        return gap_current(tip, *kinematics.horizontal(x, center), x[dim - 1], delta)

    # ---- algebra for the solver -----------------------------------------------------------------------------

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """dPi at the current solution, reactions included."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """d(dPi) at the current solution, with identity rows for the constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent, self.bcs)
        A.assemble()

    def set_solution(self, x: PETSc.Vec) -> None:
        """Take a solver's vector as the solution (owned and ghost values)."""
        x.copy(self.x)
        self.x.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def local_array(self) -> np.ndarray:
        """The solution's dofs on this rank, ghosts included."""
        return self.solution.x.array

    # ---- measurements ---------------------------------------------------------------------------------------

    def _sum(self, form: Any) -> float:
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def force(self) -> float:
        """Virtual work of pressing deeper, dPi/d(delta), of the whole body."""
        return self.scene.copies * self._sum(self._force)

    def energy(self) -> float:
        """Pi of the whole body: strain plus contact energy."""
        return self.scene.copies * self._sum(self._energy)

    def reactions(self) -> tuple[float, float]:
        """z-reaction of all supports, and the largest reaction of the pins that only remove rigid modes."""
        self.assemble_residual(self.b)
        values = self.b.array_r
        vertical = self.comm.allreduce(float(values[self._z_supports].sum()), op=MPI.SUM)
        stray = self.comm.allreduce(float(np.abs(values[self._pinned]).max(initial=0.0)), op=MPI.MAX)
        return self.scene.copies * vertical, self.scene.copies * stray


def _owned(groups: list[np.ndarray], owned: int) -> np.ndarray:
    if not groups:
        return np.empty(0, dtype=np.int64)
    dofs = np.unique(np.concatenate(groups))
    return dofs[dofs < owned]
