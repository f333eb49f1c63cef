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
from indent_sim.fe.discrete_body import held, zero
from indent_sim.fe.problem import Problem
from indent_sim.fe.terms.term import Term

SURFACE_STIFFNESS = (
    10.0  # E*/h_contact: of the body to its surface's shortest waves; 6 and 30 are worse, measured
)


class Stiffness:
    """The tangent over the displacements of a space: of matter once where it is linear, of contact
    every time.
    """

    def __init__(self, problem: Problem, space: fem.FunctionSpace, kind: str):
        """kind: PETSc's type of matrix; of `sbaij` the upper half is kept: multiplying takes as
        long as reading it.
        """
        self._bcs = _bcs(problem, space)
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        dofs = np.concatenate([bc.dof_indices()[0] for bc in self._bcs])
        self.held = dofs[dofs < owned]
        test = ufl.TestFunction(space)
        trial = ufl.TrialFunction(space)
        matter = [term for term in problem.terms if term.is_matter]
        touch = [term for term in problem.terms if not term.is_matter]
        self._matter, self._contact = (
            _form(problem, terms, ("u", test), ("u", trial)) for terms in (matter, touch)
        )
        self.matrix = fem_petsc.create_matrix(self._matter, kind.removeprefix("s"))
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._assemble_matter()
        if kind == "sbaij":
            whole = self.matrix
            self.matrix = self.matrix.convert("sbaij", PETSc.Mat())
            self.matrix.setOption(
                PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True
            )  # of what is assembled from now on
            _discard(whole)
        self._constant = self.matrix.copy() if all(term.is_constant for term in matter) else None

    def assemble(self) -> None:
        """Fill `matrix` at the present solution; rows and columns of what is held are those of the
        identity.
        """
        if self._constant is None:
            self._assemble_matter()
        else:
            self._constant.copy(self.matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        fem_petsc.assemble_matrix(self.matrix, self._contact, self._bcs)
        self.matrix.assemble()

    def _assemble_matter(self) -> None:
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self._matter, self._bcs)
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
        self._term: Any = next(term for term in problem.terms if name in term.fields)
        self._over = partial(problem.body.over, unknowns.kinds[name])
        space = unknowns.own_space(name)
        displacements = unknowns.own_space("u")
        first, last = space.dofmap.index_map.local_range
        places = unknowns.places(name)[: last - first]
        is_free = ~np.isin(places, problem.body.constrained)
        self.places = places[is_free]
        self.weight = unknowns.kinds[name].weight
        self._free = PETSc.IS().createGeneral(
            (first + np.flatnonzero(is_free)).astype(np.int32), problem.comm
        )
        u = ufl.TestFunction(displacements)
        test = ufl.TestFunction(space)
        trial = ufl.TrialFunction(space)
        self._bcs = _bcs(problem, displacements)
        ways = (("u", u), (name, trial)), ((name, test), (name, trial))
        self._forms = [_form(problem, [self._term], *way) for way in ways]
        self._whole = [fem_petsc.create_matrix(form) for form in self._forms]
        self._M = self._product(test * trial)
        self._L = (
            self._product(ufl.dot(self._slope(test), self._slope(trial))) if name == "lam" else None
        )
        low, high = self._whole[0].getOwnershipRange()
        self._all = PETSc.IS().createStride(high - low, low, 1, problem.comm)
        self.B: PETSc.Mat = None
        self.C: PETSc.Mat = None
        self.assemble()
        self._S = self._schur()
        self._ksp = PETSc.KSP().create(problem.comm)
        by_factors(self._ksp)
        self._known, self._found = self._S.createVecs()
        self._known.set(0.0)

    def _slope(self, field: Expr) -> Expr:
        slope = ufl.grad(field)
        n = ufl.FacetNormal(self.problem.mesh)
        return slope - ufl.dot(slope, n) * n

    def _product(self, density: Expr) -> PETSc.Mat:
        """The integral of a density, in units of the scaled rows, between the free dofs."""
        matrix = fem_petsc.assemble_matrix(fem.form(self._over(density)))
        matrix.assemble()
        matrix.scale(self.weight**2)
        return matrix.createSubMatrix(self._free, self._free)

    def assemble(self) -> None:
        """Fill B and C at the present solution."""
        for matrix, form in zip(self._whole, self._forms, strict=True):
            matrix.zeroEntries()
            fem_petsc.assemble_matrix(matrix, form, self._bcs)
            matrix.assemble()
        coupling, own = self._whole
        self.B = coupling.createSubMatrix(self._all, self._free, self.B)
        self.C = own.createSubMatrix(self._free, self._free, self.C)
        self.B.scale(self.weight)
        self.C.scale(self.weight**2)

    def factor(self) -> None:
        """Factor S at the present solution."""
        now = self._schur()
        now.copy(
            self._S, PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        )  # a new matrix would be analysed anew
        self._ksp.setOperators(self._S)
        self._ksp.setUp()
        _discard(now)

    def solve(self, known: PETSc.Vec, found: PETSc.Vec) -> None:
        """S^-1 known; what stands in S after the field is its own affair."""
        self._known.array[: len(self.places)] = known.array_r
        self._ksp.solve(self._known, self._found)
        found.array[:] = self._found.array_r[: len(self.places)]

    def _schur(self) -> PETSc.Mat:
        if self._L:
            S = self._of_multiplier()
        else:
            E, nu = self._term.region.material.constants
            S = self._M.copy()
            S.scale(-(1 + nu) / E)
            S.axpy(1.0, self.C, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        S.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return S

    def _of_multiplier(self) -> PETSc.Mat:
        """S as the Schur complement in [[C - alpha M_A/eps, M_A], [M_A, eps/(1 - alpha) (M + gamma
        L)]].
        """
        eps = self._term.stiffness
        scene = self.problem.scene
        E_star = scene.physics.material.E_star
        s = SURFACE_STIFFNESS * E_star / scene.sizes.h_contact
        q = np.sqrt(1 + s / eps)
        same = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        gamma = q * (q + 1) ** 2 * (E_star / (2 * s)) ** 2
        M_A = self._M.copy()
        own = self._M.copy()
        waves = self._M.copy()
        M_A.axpy(eps, self.C, same)
        own.scale(-1 / eps)
        own.axpy((1 - 1 / q**2) / eps, M_A, same)  # C - alpha M_A/eps, with M_A = M + eps C
        waves.axpy(gamma, self._L, same)
        waves.scale(eps / (1 - 1 / q**2))
        blocks = PETSc.Mat().createNest([[own, M_A], [M_A, waves]], comm=M_A.comm)
        S = PETSc.Mat()
        blocks.convert("aij", S)
        _discard(blocks, own, M_A, waves)
        return S


def _discard(*matrices: PETSc.Mat) -> None:
    """Free matrices now: left to Python, those of several ranks stay until the end."""
    for matrix in matrices:
        matrix.destroy()


def by_factors(ksp: PETSc.KSP, kind: str = "cholesky") -> None:
    """Factor a solver's systems by MUMPS: `cholesky` (L D L^T) is half the work of `lu`, for
    symmetric ones.
    """
    ksp.setType("preonly")
    ksp.getPC().setType(kind)
    ksp.getPC().setFactorSolverType("mumps")


def _bcs(problem: Problem, space: fem.FunctionSpace) -> list[fem.DirichletBC]:
    supports, pins = held(space, problem.body.body_mesh)
    return [zero(space.sub(c), dofs) for c, dofs in supports + pins]


def _form(
    problem: Problem, terms: Sequence[Term], test: tuple[str, Expr], trial: tuple[str, Expr]
) -> fem.Form:
    unknowns = problem.unknowns
    body = problem.body
    now = replace(body.now, test=unknowns.variation(*test), trial=unknowns.variation(*trial))
    return fem.form(
        compat.differentiated(reduce(add, (term.tangent(now, now, body.dt) for term in terms)))
    )
