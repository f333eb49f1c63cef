"""The tangent of a problem in blocks of its fields, each over a space of its own: what a Krylov
method multiplies by.

    | A    B_1  B_2 |     A over the displacement, in point blocks; B_k between it and a field beside it (a pressure q,
    | B_1' C_1      |     the multiplier lam), C_k of that field alone. Symmetric, and the fields beside the
    | B_2'      C_2 |     displacement do not meet.

Rows and columns of the fields are scaled so that every residual is a force: lam by the contact's
stiffness, q by E.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial, reduce
from operator import add
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.constraints import support_and_pin_dofs, zero_bc
from indent_sim.fe.problem import Problem
from indent_sim.fe.terms.term import Term

SURFACE_STIFFNESS = (
    10.0  # E*/h_contact: of the body to its surface's shortest waves; 6 and 30 are worse, measured
)


class DisplacementStiffness:
    """The tangent over the displacements of a space: of matter once where it is linear, of contact
    every time.
    """

    def __init__(self, problem: Problem, space: fem.FunctionSpace, kind: str):
        """kind: PETSc's type of matrix; of `sbaij` the upper half is kept: multiplying takes as
        long as reading it.
        """
        self._bcs = _dirichlet_bcs(problem, space)
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        dofs = np.concatenate([bc.dof_indices()[0] for bc in self._bcs])
        self.constrained_dofs = dofs[dofs < owned]
        test = ufl.TestFunction(space)
        trial = ufl.TrialFunction(space)
        bulk = [term for term in problem.terms if term.is_bulk]
        contact = [term for term in problem.terms if not term.is_bulk]
        self._bulk_form, self._contact_form = (
            _tangent_form(problem, terms, ("u", test), ("u", trial)) for terms in (bulk, contact)
        )
        self.matrix = fem_petsc.create_matrix(self._bulk_form, kind.removeprefix("s"))
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._assemble_bulk()
        if kind == "sbaij":
            full_matrix = self.matrix
            self.matrix = self.matrix.convert("sbaij", PETSc.Mat())
            self.matrix.setOption(
                PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True
            )  # of what is assembled from now on
            _destroy_matrices(full_matrix)
        self._constant_bulk = (
            self.matrix.copy() if all(term.has_constant_tangent for term in bulk) else None
        )

    def assemble(self) -> None:
        """Fill `matrix` at the present solution; rows and columns of what is held are those of the
        identity.
        """
        if self._constant_bulk is None:
            self._assemble_bulk()
        else:
            self._constant_bulk.copy(self.matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        fem_petsc.assemble_matrix(self.matrix, self._contact_form, self._bcs)
        self.matrix.assemble()

    def _assemble_bulk(self) -> None:
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self._bulk_form, self._bcs)
        self.matrix.assemble()


class FieldBlocks:
    """A field beside the displacement: its free dofs, its blocks B and C, and S that stands for C -
    B' A^-1 B.

    With the mass M of the field, a pressure has S = C - M/(2 mu).

    The multiplier, whose C is -(M - M_A)/eps with the mass M_A of the surface in contact, has S = C
    - M_A (K + eps M_A)^-1 M_A with the stiffness K = E* |k|/2 that a half-space shows to waves k of
    its surface. In place of 1/(eps + E* |k|/2) there is

        (alpha + (1 - alpha)/(1 + gamma k^2))/eps,   alpha = eps/(eps + s),   s = SURFACE_STIFFNESS
        E*/h_contact,

    right for long waves and half way to those with K = s. A constant instead takes half as many
    iterations again.
    """

    def __init__(self, problem: Problem, name: str):
        self.problem = problem
        self.name = name
        unknowns = problem.unknowns
        self._term: Any = next(term for term in problem.terms if name in term.field_names)
        self._domain_integral = partial(
            problem.body.field_domain_integral, unknowns.fields_by_name[name]
        )
        space = unknowns.collapsed_space(name)
        displacements = unknowns.collapsed_space("u")
        first, last = space.dofmap.index_map.local_range
        dofs = unknowns.dofs(name)[: last - first]
        is_free = ~np.isin(dofs, problem.body.constrained_dofs)
        self.free_dofs = dofs[is_free]
        self.weight = unknowns.fields_by_name[name].weight
        self._free_set = PETSc.IS().createGeneral(
            (first + np.flatnonzero(is_free)).astype(np.int32), problem.comm
        )
        u = ufl.TestFunction(displacements)
        test = ufl.TestFunction(space)
        trial = ufl.TrialFunction(space)
        self._bcs = _dirichlet_bcs(problem, displacements)
        arguments = (("u", u), (name, trial)), ((name, test), (name, trial))
        self._forms = [_tangent_form(problem, [self._term], *way) for way in arguments]
        self._full_matrices = [fem_petsc.create_matrix(form) for form in self._forms]
        self._mass = self._assemble_product(test * trial)
        self._laplacian = (
            self._assemble_product(
                ufl.dot(self._surface_gradient(test), self._surface_gradient(trial))
            )
            if name == "lam"
            else None
        )
        low, high = self._full_matrices[0].getOwnershipRange()
        self._all_rows = PETSc.IS().createStride(high - low, low, 1, problem.comm)
        self.B: PETSc.Mat = None
        self.C: PETSc.Mat = None
        self.assemble()
        self._S = self._schur_complement()
        self._ksp = PETSc.KSP().create(problem.comm)
        use_direct_solver(self._ksp)
        self._rhs, self._solution = self._S.createVecs()
        self._rhs.set(0.0)

    def _surface_gradient(self, field: Expr) -> Expr:
        gradient = ufl.grad(field)
        n = ufl.FacetNormal(self.problem.mesh)
        return gradient - ufl.dot(gradient, n) * n

    def _assemble_product(self, density: Expr) -> PETSc.Mat:
        """The integral of a density, in units of the scaled rows, between the free dofs."""
        matrix = fem_petsc.assemble_matrix(fem.form(self._domain_integral(density)))
        matrix.assemble()
        matrix.scale(self.weight**2)
        return matrix.createSubMatrix(self._free_set, self._free_set)

    def assemble(self) -> None:
        """Fill B and C at the present solution."""
        for matrix, form in zip(self._full_matrices, self._forms, strict=True):
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, form, self._bcs)
            matrix.assemble()
        coupling, diagonal = self._full_matrices
        self.B = coupling.createSubMatrix(self._all_rows, self._free_set, self.B)
        self.C = diagonal.createSubMatrix(self._free_set, self._free_set, self.C)
        self.B.scale(self.weight)
        self.C.scale(self.weight**2)

    def factor(self) -> None:
        """Factor S at the present solution."""
        schur_complement = self._schur_complement()
        schur_complement.copy(
            self._S, PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        )  # a new matrix would be analysed anew
        self._ksp.setOperators(self._S)
        self._ksp.setUp()
        _destroy_matrices(schur_complement)

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec) -> None:
        """S^-1 known; what stands in S after the field is its own affair."""
        self._rhs.array[: len(self.free_dofs)] = rhs.array_r
        self._ksp.solve(self._rhs, self._solution)
        solution.array[:] = self._solution.array_r[: len(self.free_dofs)]

    def _schur_complement(self) -> PETSc.Mat:
        if self._laplacian:
            S = self._multiplier_schur_complement()
        else:
            E, nu = self._term.region.material.constants
            S = self._mass.copy()
            S.scale(-(1 + nu) / E)
            S.axpy(1.0, self.C, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        S.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return S

    def _multiplier_schur_complement(self) -> PETSc.Mat:
        """S as the Schur complement in [[C - alpha M_A/eps, M_A], [M_A, eps/(1 - alpha) (M + gamma
        L)]].
        """
        eps = self._term.stiffness
        scene = self.problem.scene
        E_star = scene.physics.material.E_star
        s = SURFACE_STIFFNESS * E_star / scene.sizes.h_contact
        q = np.sqrt(1 + s / eps)
        pattern = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        gamma = q * (q + 1) ** 2 * (E_star / (2 * s)) ** 2
        M_A = self._mass.copy()
        diagonal = self._mass.copy()
        surface_waves = self._mass.copy()
        M_A.axpy(eps, self.C, pattern)
        diagonal.scale(-1 / eps)
        diagonal.axpy((1 - 1 / q**2) / eps, M_A, pattern)  # C - alpha M_A/eps, with M_A = M + eps C
        surface_waves.axpy(gamma, self._laplacian, pattern)
        surface_waves.scale(eps / (1 - 1 / q**2))
        blocks = PETSc.Mat().createNest([[diagonal, M_A], [M_A, surface_waves]], comm=M_A.comm)
        S = PETSc.Mat()
        blocks.convert("aij", S)
        _destroy_matrices(blocks, diagonal, M_A, surface_waves)
        return S


def _destroy_matrices(*matrices: PETSc.Mat) -> None:
    """Free matrices now: left to Python, those of several ranks stay until the end."""
    for matrix in matrices:
        matrix.destroy()


def use_direct_solver(ksp: PETSc.KSP, kind: str = "cholesky") -> None:
    """Factor a solver's systems by MUMPS: `cholesky` (L D L^T) is half the work of `lu`, for
    symmetric ones.
    """
    ksp.setType("preonly")
    ksp.getPC().setType(kind)
    ksp.getPC().setFactorSolverType("mumps")


def _dirichlet_bcs(problem: Problem, space: fem.FunctionSpace) -> list[fem.DirichletBC]:
    supports, pins = support_and_pin_dofs(space, problem.body.body_mesh)
    return [zero_bc(space.sub(c), dofs) for c, dofs in supports + pins]


def _tangent_form(
    problem: Problem, terms: Sequence[Term], test: tuple[str, Expr], trial: tuple[str, Expr]
) -> fem.Form:
    unknowns = problem.unknowns
    body = problem.body
    now = replace(body.now, test=unknowns.variation(*test), trial=unknowns.variation(*trial))
    return fem.form(
        compat.expand_derivatives(reduce(add, (term.tangent(now, now, body.dt) for term in terms)))
    )
