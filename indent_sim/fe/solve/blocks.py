"""Block structure of the tangent for the Krylov solver.

    | A    B_1  B_2 |     A: displacement, in point blocks; B_k: its coupling with another
    | B_1' C_1      |     field (a pressure q, the multiplier lam); C_k: that field alone.
    | B_2'      C_2 |     Symmetric; the other fields are not coupled with each other.

Every field has a function space of its own. Rows and columns are scaled so that every residual is a
force: by the stiffness of the contact for lam, by E for q.
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
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.measured_constants import SURFACE_STIFFNESS
from indent_sim.fe.problem import Problem
from indent_sim.fe.terms.term import Term


class DisplacementStiffness:
    """Displacement block of the tangent matrix, in a space of linear or quadratic elements.

    The bulk part is assembled once if it is linear, the contact part every time.

    Parameters
    ----------
    problem
        The problem.
    space
        Space of the displacements, quadratic or linear.
    kind
        PETSc's matrix type. "sbaij" stores only the upper half. Storing half of the matrix halves
        the time of a matrix-vector product, which is limited by reading the matrix.
    """

    def __init__(self, problem: Problem, space: fem.FunctionSpace, kind: str):
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
            # The assembly ignores the lower half from now on.
            self.matrix.setOption(PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True)
            _destroy_matrices(full_matrix)
        self._constant_bulk = (
            self.matrix.copy() if all(term.has_constant_tangent for term in bulk) else None
        )

    def assemble(self) -> None:
        """Assemble `matrix` at the present solution, with identity rows for constrained dofs."""
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
    """Blocks of one field other than the displacement, and its Schur complement.

    B couples the field with the displacement and C is the block of the field itself, both
    restricted to the free dofs. S approximates the Schur complement C - B' A^-1 B. For a pressure S
    = C - M/(2 mu) with the mass matrix M of the field.

    For the multiplier C is -(M - M_A)/eps with the mass matrix M_A of the surface in contact, and S
    = C - M_A (K + eps M_A)^-1 M_A with the stiffness K = E* |k|/2 of a half-space under a pressure
    of wavenumber k (Johnson 1985, chapter 13). The factor 1/(eps + E* |k|/2) is approximated by

        (alpha + (1 - alpha)/(1 + gamma k^2))/eps,   alpha = eps/(eps + s),
        s = SURFACE_STIFFNESS E*/h_contact,

    which is exact for k = 0, and for the k at which the factor is the geometric mean of its values
    for K = 0 and K = s. A constant factor needs 1.5 times as many iterations.

    Parameters
    ----------
    problem
        The problem.
    name
        Name of the field: "lam" or a pressure.
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
        self._forms = [
            _tangent_form(problem, [self._term], *arguments_of_block)
            for arguments_of_block in arguments
        ]
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
        """Return the surface gradient (tangential part of the gradient) of a field."""
        gradient = ufl.grad(field)
        n = ufl.FacetNormal(self.problem.mesh)
        return gradient - ufl.dot(gradient, n) * n

    def _assemble_product(self, density: Expr) -> PETSc.Mat:
        """Assemble the bilinear form with the integrand `density` on the free dofs of the field.

        Rows and columns are scaled by the residual weight of the field.
        """
        matrix = fem_petsc.assemble_matrix(compile_form(self._domain_integral(density)))
        matrix.assemble()
        matrix.scale(self.weight**2)
        return matrix.createSubMatrix(self._free_set, self._free_set)

    def assemble(self) -> None:
        """Assemble the coupling block B and the diagonal block C at the present solution."""
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
        """Factor the approximate Schur complement S at the present solution."""
        schur_complement = self._schur_complement()
        # Copied into the same matrix, for which MUMPS keeps its symbolic analysis
        schur_complement.copy(self._S, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._ksp.setOperators(self._S)
        self._ksp.setUp()
        _destroy_matrices(schur_complement)

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve S solution = rhs; values of auxiliary rows of S are discarded."""
        self._rhs.array[: len(self.free_dofs)] = rhs.array_r
        self._ksp.solve(self._rhs, self._solution)
        solution.array[:] = self._solution.array_r[: len(self.free_dofs)]

    def _schur_complement(self) -> PETSc.Mat:
        """Return the approximate Schur complement at the present solution."""
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
        """Return a block matrix whose Schur complement approximates that of the multiplier.

        The matrix is [[C - alpha M_A/eps, M_A], [M_A, eps/(1 - alpha) (M + gamma L)]], with the
        Laplacian L of the surface.
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
    """Free matrices immediately: with several ranks PETSc otherwise keeps them until the end."""
    for matrix in matrices:
        matrix.destroy()


def use_direct_solver(ksp: PETSc.KSP, kind: str = "cholesky") -> None:
    """Make a PETSc solver use a direct factorisation by MUMPS.

    `kind` is "lu", or "cholesky" (L D L^T) for symmetric matrices with half the work.
    """
    ksp.setType("preonly")
    ksp.getPC().setType(kind)
    ksp.getPC().setFactorSolverType("mumps")


def _dirichlet_bcs(problem: Problem, space: fem.FunctionSpace) -> list[fem.DirichletBC]:
    """Return the boundary conditions of supports and pins in a space."""
    supports, pins = support_and_pin_dofs(space, problem.body.body_mesh)
    return [zero_bc(space.sub(c), dofs) for c, dofs in supports + pins]


def _tangent_form(
    problem: Problem, terms: Sequence[Term], test: tuple[str, Expr], trial: tuple[str, Expr]
) -> fem.Form:
    """Return the compiled tangent of terms for test and trial functions of the given fields."""
    unknowns = problem.unknowns
    body = problem.body
    now = replace(body.now, test=unknowns.variation(*test), trial=unknowns.variation(*trial))
    return compile_form(
        compat.expand_derivatives(reduce(add, (term.tangent(now, now, body.dt) for term in terms)))
    )
