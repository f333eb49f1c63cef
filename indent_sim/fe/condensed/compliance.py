"""A linear body condensed to its contact surface: u_z = -C F, from one factorisation and one block solve.

F are nodal forces pushing down (int p N_j), u_z the nodal displacements there. Everything a frictionless tip does to
a linear body with a reference gap passes through C; every depth, tip and contact method after that is small and dense.
With friction C has rows and columns for the horizontal axes too, after those of the downward one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from indent_sim.fe.body import Body
from indent_sim.fe.observe.surface import Trace
from indent_sim.fe.terms.matter import matter, strains_of
from indent_sim.process.errors import NotConverged

BLOCK = 128  # right-hand sides solved at once
PIVOTING = 200  # per cent more room than foreseen for pivots that wait: layers far apart in stiffness have many


@dataclass(frozen=True)
class Compliance:
    """C (n, n) [1/(pressure length)] between the candidates, nodes of the contact surface; the same on all ranks.

    whole (m n, m n): C, and with friction m - 1 horizontal axes after it; held (m - 1, nodes of the surface): where
    their displacements are held. trace: the facets between the candidates, with `nodes` numbering rows of C; surface:
    all facets of the contact surface, whose node places[i] is candidate i; support and stray (m n,): what a unit force
    at a candidate makes the supports and the rigid-mode pins feel.
    """

    whole: np.ndarray
    held: np.ndarray
    trace: Trace
    surface: Trace
    places: np.ndarray
    support: np.ndarray
    stray: np.ndarray

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.places)

    @property
    def C(self) -> np.ndarray:
        """Downward displacements for downward forces."""
        return self.whole[: self.size, : self.size]


class Condenser:
    """Factors a linear body once and condenses it to as much of its surface as is asked for."""

    def __init__(self, body: Body):
        self.body = body
        terms = matter(body)
        self.strains = strains_of(terms)
        matrix = _stiffness(body, terms)
        self._support_rows = self._row_sum(matrix, body.z_supports)
        self._pin_rows = [self._row_sum(matrix, np.array([pin])) for pin in self._all_pins()]
        matrix.zeroRowsColumnsLocal(body.constrained.astype(np.int32), diag=1.0)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        if not body.pressures:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc = PETSc.PC().create(body.comm)
        self._pc.setOperators(matrix)
        self._pc.setType("cholesky")  # LDL^T when the matrix is symmetric but not positive definite (mixed)
        self._pc.setFactorSolverType("mumps")
        self._pc.setFactorSetUpSolverType()
        self._pc.getFactorMatrix().setMumpsIcntl(14, PIVOTING)
        self._pc.setUp()
        self._refuse_singular()
        self._owned_nodes, self._owned_rows, self._rows = self._number_surface_nodes()
        self._surface = self._whole_surface()
        self._last: Compliance | None = None

    def _refuse_singular(self) -> None:
        """NotConverged where the factorisation failed; MUMPS keeps that to itself, and crashes at the first solve."""
        if failure := self._pc.getFactorMatrix().getMumpsInfog(1):
            why = "is singular to working precision" if failure == -10 else f"was not factored (MUMPS: {failure})"
            raise NotConverged(f"the body's matrix {why}; with larger elements where they are smallest it may be")

    def _all_pins(self) -> list[int]:
        """One entry a pin on every rank: the local dof on its owner, -1 elsewhere."""
        counts = self.body.comm.allgather(len(self.body.pinned))
        mine = iter(self.body.pinned)
        return [
            int(next(mine)) if rank == self.body.comm.rank else -1 for rank, n in enumerate(counts) for _ in range(n)
        ]

    def _row_sum(self, matrix: PETSc.Mat, rows: np.ndarray) -> np.ndarray:
        """The sum of rows of a symmetric matrix, this rank's columns."""
        marks, total = matrix.createVecs()
        marks.array[rows[rows >= 0]] = 1.0
        matrix.mult(marks, total)
        return total.array.copy()

    def _number_surface_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """This rank's own surface nodes, their rows among those of all ranks, and the rows of its facets' nodes.

        The rows are in an order given by the nodes' places.
        """
        body, trace = self.body, self.body.trace
        space = body.unknowns.own_space("u")
        index_map = space.dofmap.index_map
        local, inverse = np.unique(trace.nodes, return_inverse=True)
        keys = np.asarray(index_map.local_to_global(local.astype(np.int32)), dtype=np.int64)
        own = local < index_map.size_local
        coordinates = space.tabulate_dof_coordinates()[local[own], : trace.dim]
        parts = body.comm.allgather((keys[own], coordinates))
        all_keys, X = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
        by_place = np.lexsort(np.round(X[:, ::-1].T, 10))
        by_key = np.argsort(all_keys[by_place])
        rows = by_key[np.searchsorted(all_keys[by_place], keys, sorter=by_key)]
        return local[own], rows[own], rows[inverse].reshape(trace.nodes.shape)

    def _whole_surface(self) -> Trace:
        """The contact surface of all ranks, its facets sorted by place and its nodes numbered by row."""
        trace = self.body.trace
        parts = self.body.comm.allgather((self._rows, trace.X))
        rows, X = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
        order = np.lexsort(np.round(X.mean(axis=1), 10)[:, ::-1].T)
        return Trace(rows[order], X[order], rows[order])

    def candidates(self, reach: float, center: tuple[float, ...]) -> int:
        """How many nodes the facets have that come within `reach` [length] of the tip's axis."""
        return len(np.unique(self._surface.nodes[self._near(reach, center)]))

    def _near(self, reach: float, center: tuple[float, ...]) -> np.ndarray:
        surface = self._surface
        distance = np.linalg.norm(surface.X[..., :-1] - np.asarray(center)[: surface.dim - 1], axis=-1).min(axis=1)
        return np.asarray(distance <= reach)

    def condense(self, reach: float, center: tuple[float, ...], *, shear: bool = False) -> Compliance:
        """The compliance of all facets that come within `reach` [length] of the tip's axis; also along the horizontal
        axes with `shear`."""
        surface, near = self._surface, self._near(reach, center)
        places, nodes = np.unique(surface.nodes[near], return_inverse=True)
        axes = [surface.dim - 1, *range(surface.dim - 1)] if shear else [surface.dim - 1]
        is_same = self._last is not None and np.array_equal(places, self._last.places)
        if self._last is None or not is_same or len(self._last.held) != len(axes) - 1:
            C, support, stray = self._solve(places, axes)
            nodes = nodes.reshape(surface.nodes[near].shape)
            trace = Trace(nodes, surface.X[near], nodes)
            self._last = Compliance((C + C.T) / 2, self._held(axes[1:]), trace, surface, places, support, stray)
        return self._last

    def spread(self, nodal: np.ndarray) -> np.ndarray:
        """Values at the nodes of the whole surface as (facets, nodes) of this rank's facets."""
        return nodal[self._rows]

    def _held(self, axes: Sequence[int]) -> np.ndarray:
        """Whether the displacement along each axis is held (axes, nodes of the whole surface)."""
        dofs = self.body.unknowns.displacement_places(self._owned_nodes)[..., list(axes)]
        held = np.zeros((len(axes), 1 + self._surface.nodes.max(initial=-1)))
        held[:, self._owned_rows] = np.isin(dofs, self.body.constrained).T
        return _summed(self.body.comm, held) > 0

    def _solve(self, places: np.ndarray, axes: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Displacements of the candidates, support and pin reactions for a unit force at each of them: down, and along
        the horizontal axes that follow."""
        body, n = self.body, len(places) * len(axes)
        mine = np.isin(self._owned_rows, places)
        here = np.searchsorted(places, self._owned_rows[mine])
        columns = np.concatenate([here + k * len(places) for k in range(len(axes))])
        dofs = body.unknowns.displacement_places(self._owned_nodes[mine])[..., list(axes)].T.reshape(-1)
        free = ~np.isin(dofs, body.constrained)
        self._placed = (dofs, columns, free)
        C, reactions = np.zeros((n, n)), np.zeros((1 + len(self._pin_rows), n))
        for start in range(0, n, BLOCK):
            stop = min(start + BLOCK, n)
            X = self._block(dofs, columns, free, start, stop)
            C[columns, start:stop] = X[dofs]
            reactions[0, start:stop] = self._support_rows @ X
            reactions[1:, start:stop] = [row @ X for row in self._pin_rows] if self._pin_rows else 0.0
        C, reactions = _summed(body.comm, C), _summed(body.comm, reactions)
        down, along = slice(len(places)), slice(len(places), None)
        C[down, along], C[along, down] = -C[down, along], -C[along, down]  # solved for forces that pull up
        held = _summed(body.comm, np.bincount(columns[~free], minlength=n).astype(float))
        stray = np.abs(reactions[1:]).max(axis=0, initial=0.0)
        return C, np.concatenate([held[down] - reactions[0, down], reactions[0, along]]), stray

    def _block(self, dofs: np.ndarray, columns: np.ndarray, free: np.ndarray, start: int, stop: int) -> np.ndarray:
        """Solutions (this rank's rows) for unit forces at the nodes of columns start..stop."""
        comm, owned = self.body.comm, self.body.unknowns.owned
        sizes = ((owned, PETSc.DETERMINE), (PETSc.DECIDE, stop - start))
        B, X = PETSc.Mat().createDense(sizes, comm=comm), PETSc.Mat().createDense(sizes, comm=comm)
        for matrix in (B, X):
            matrix.setUp()
        here = free & (columns >= start) & (columns < stop)
        B.getDenseArray()[dofs[here], columns[here] - start] = 1.0
        for matrix in (B, X):
            matrix.assemble()
        self._pc.getFactorMatrix().matSolve(B, X)
        solutions: np.ndarray = X.getDenseArray().copy()
        for matrix in (B, X):
            matrix.destroy()  # left to Python they stay until the end: all blocks at once
        return solutions

    def recover(self, nodal_forces: np.ndarray) -> None:
        """Put the whole body's response to forces at the nodes last condensed to into the body's solution."""
        dofs, columns, free = self._placed
        load, response = self.body.x.duplicate(), self.body.x.duplicate()
        load.set(0.0)
        up = np.where(columns < len(self._last.places), -1.0, 1.0) if self._last else 1.0
        load.array[dofs[free]] = (up * nodal_forces[columns])[free]
        self._pc.apply(load, response)
        self.body.set_solution(response)


def _stiffness(body: Body, terms: list[Any]) -> PETSc.Mat:
    """The tangent of the body's terms, constrained dofs included."""
    test, trial = ufl.TestFunction(body.unknowns.space), ufl.TrialFunction(body.unknowns.space)
    matrix = fem_petsc.assemble_matrix(fem.form(reduce(add, (term.work(test, trial)[1] for term in terms))))
    matrix.assemble()
    return matrix


def _summed(comm: Any, values: np.ndarray) -> np.ndarray:
    return values if comm.size == 1 else comm.allreduce(values)
