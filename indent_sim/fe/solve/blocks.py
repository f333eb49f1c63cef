"""The tangent of a problem in blocks of its fields, each over a space of its own: what a Krylov method multiplies by.

    | A    B_1  B_2 |     A over the displacement, in point blocks; B_k between it and a field beside it (a pressure q,
    | B_1' C_1      |     the multiplier lam), C_k of that field alone. Symmetric, and the fields beside the
    | B_2'      C_2 |     displacement do not meet.

Rows and columns of the fields are scaled so that every residual is a force: lam by the contact's stiffness, q by E.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.body import held, zero
from indent_sim.fe.problem import Problem
from indent_sim.fe.terms.strain import Strain

SURFACE = 3.0  # E*/h_contact: how stiff the body itself is to the shortest waves of its surface


class Stiffness:
    """The tangent over the displacements of a space: of matter once where it is linear, of contact every time."""

    def __init__(self, problem: Problem, space: Any, kind: str):
        """kind: PETSc's type of matrix."""
        self._bcs = _bcs(problem, space)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        matter = [term for term in problem.terms if term is not problem.contact]
        self._matter, self._contact = (_form(problem, terms, ("u", test), ("u", trial))
                                       for terms in (matter, [problem.contact]))  # fmt: skip
        self.matrix = fem_petsc.create_matrix(self._matter, kind)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._constant: PETSc.Mat | None = None
        if problem.scene.physics.small_strain:
            self._assemble_matter()
            self._constant = self.matrix.copy()

    def assemble(self) -> None:
        """Fill `matrix` at the present solution; rows and columns of what is held are those of the identity."""
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


class Beside:
    """A field beside the displacement: its free dofs, its blocks B and C, and S that stands for C - B' A^-1 B.

    S = share C - factor M, with the mass M of the field. A pressure has C - M/(2 mu). For the multiplier, whose C is
    -1/eps times the mass of the open surface, what is in contact has -M/(eps + s), with the stiffness s that the body
    itself shows to waves as short as an element.
    """

    def __init__(self, problem: Problem, name: str):
        self.problem, self.name = problem, name
        self._term, self._mass = _origin(problem, name)
        unknowns = problem.unknowns
        space, displacements = unknowns.own_space(name), unknowns.own_space("u")
        first, last = space.dofmap.index_map.local_range
        places = unknowns.places(name)[: last - first]
        is_free = ~np.isin(places, problem.body.constrained)
        self.places = places[is_free]
        self.weight = problem.weights[name]
        self._free = PETSc.IS().createGeneral((first + np.flatnonzero(is_free)).astype(np.int32), problem.comm)
        u, test, trial = ufl.TestFunction(displacements), ufl.TestFunction(space), ufl.TrialFunction(space)
        self._bcs = _bcs(problem, displacements)
        self._forms = [_form(problem, [self._term], *way) for way in
                       ((("u", u), (name, trial)), ((name, test), (name, trial)))]  # fmt: skip
        self._whole = [fem_petsc.create_matrix(form) for form in self._forms]
        mass = fem_petsc.assemble_matrix(fem.form(self._mass(test * trial)))
        mass.assemble()
        self._M = mass.createSubMatrix(self._free, self._free)
        low, high = self._whole[0].getOwnershipRange()
        self._all = PETSc.IS().createStride(high - low, low, 1, problem.comm)
        self.B: Any = None
        self.C: Any = None
        self.assemble()
        self._S = self._M.copy()

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

    def schur(self) -> PETSc.Mat:
        """S at the present solution, negative definite."""
        share, factor = self._coefficients()
        self._M.copy(self._S, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._S.scale(-factor * self.weight**2)
        self._S.axpy(share, self.C, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return self._S

    def _coefficients(self) -> tuple[float, float]:
        if isinstance(self._term, Strain):
            E, nu = self._term.region.material.constants
            return 1.0, (1 + nu) / E
        scene = self.problem.scene
        own = SURFACE * scene.physics.material.E_star / scene.sizes.h_contact
        return own / (self._term.stiffness + own), 1 / (self._term.stiffness + own)


def _origin(problem: Problem, name: str) -> tuple[Any, Any]:
    """The term that couples a field to the displacement, and the integral of a density over where the field lives."""
    body = problem.body
    if name == "lam":
        return problem.contact, body.over_contact
    strain = next(strain for strain in problem.strains if body.pressures.get(strain.region) == name)
    return strain, lambda density: body.over_region(density, strain.region)


def _bcs(problem: Problem, space: Any) -> list[Any]:
    """What holds the displacements of a space at zero."""
    supports, pins = held(space, problem.body_mesh)
    return [zero(space.sub(c), dofs) for c, dofs in supports + pins]


def _form(problem: Problem, terms: Sequence[Any], test: tuple[str, Any], trial: tuple[str, Any]) -> Any:
    """The tangent of some terms between two fields."""
    ways = (problem.unknowns.variation(*test), problem.unknowns.variation(*trial))
    return fem.form(compat.differentiated(reduce(add, (term.work(*ways)[1] for term in terms))))
