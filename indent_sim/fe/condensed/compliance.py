"""A linear body condensed to its contact surface: u_z = -C F, from one factorisation and one block
solve.

F are nodal forces pushing down (int p N_j), u_z the nodal displacements there. Everything a
frictionless tip does to a linear body with a reference gap passes through C; every depth, tip and
contact method after that is small and dense. With friction C has rows and columns for the
horizontal axes too, after those of the downward one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.observe.surface import Trace
from indent_sim.fe.terms.scene_terms import matter_of
from indent_sim.fe.terms.wall import Wall
from indent_sim.mesh.grid import lots
from indent_sim.mesh.reactions import Surface
from indent_sim.process.errors import NotConverged
from indent_sim.process.usage import machine_memory

MOST_SEEN = 4_000_000  # displacements beside the contact, for all unit forces, that are kept
BLOCK = 128  # right-hand sides solved at once; MUMPS takes 32, a seventh slower, unless told

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
Own = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Compliance:
    """C (n, n) [1/(pressure length)] between the candidates, nodes of the contact surface; the same
    on all ranks.

    whole (m n, m n): C, and with friction m - 1 horizontal axes after it; held (m - 1, nodes of the
    surface): where their displacements are held. trace: the facets between the candidates, with
    `nodes` numbering rows of C; surface: all facets of the contact surface, whose node places[i] is
    candidate i; support (surfaces, m n) and stray (m n,): the reactions of the condenser's
    `bearing` surfaces to a unit force at a candidate, and the largest of the rigid-mode pins; seen
    (k, m n): the displacements that it makes at the condenser's `seen` dofs, k = 0 where these are
    not kept.
    """

    whole: np.ndarray
    support: np.ndarray
    stray: np.ndarray
    seen: np.ndarray
    held: np.ndarray
    trace: Trace
    surface: Trace
    places: np.ndarray

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.places)

    @property
    def C(self) -> np.ndarray:
        """Downward displacements for downward forces."""
        return self.whole[: self.size, : self.size]


class Condenser:
    """Factors a linear body once and condenses it to as much of its surface as is asked for.

    Of several ranks each factors the whole body and solves for its share of the unit forces; where
    there is no memory for that, all ranks factor it together and solve for every one. rows (facets,
    nodes): of this rank's facets, in the surface's nodes.
    """

    def __init__(self, body: Body):
        self.body = body
        matter = matter_of(body)
        self.strains = matter.strains
        self._is_whole = body.comm.size > 1 and _fits_every_rank(body)
        self._comm = (
            MPI.COMM_SELF if self._is_whole else body.comm
        )  # of the ranks that solve together
        tangents = [term.tangent(body.now, body.now, body.dt) for term in matter]
        matrix = fem_petsc.assemble_matrix(fem.form(reduce(add, tangents)))
        matrix.assemble()
        self.bearing, self._support_rows = self._rows_of_supports(matrix, matter.walls)
        self._pin_rows = [self._row_sum(matrix, np.array([pin])) for pin in self._all_pins()]
        matrix.zeroRowsColumnsLocal(body.constrained.astype(np.int32), diag=1.0)
        if self._is_whole:
            everything = PETSc.IS().createStride(matrix.getSize()[0], 0, 1, MPI.COMM_SELF)
            matrix = matrix.createSubMatrices([everything], [everything])[0]
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        if body.unknowns.names == ("u",) and not (
            matter.tension and body.scene.physics.part.dome
        ):  # it pushes there
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc = PETSc.PC().create(self._comm)
        self._pc.setOperators(matrix)
        self._pc.setType(
            "cholesky"
        )  # LDL^T when the matrix is symmetric but not positive definite (mixed)
        self._pc.setFactorSolverType("mumps")
        self._pc.setFactorSetUpSolverType()
        # layers far apart in stiffness have many pivots that wait: 200 per cent more room than
        # foreseen
        for option, value in ((14, 200), (27, BLOCK)):
            self._pc.getFactorMatrix().setMumpsIcntl(option, value)
        self._pc.setUp()
        if failure := self._pc.getFactorMatrix().getMumpsInfog(
            1
        ):  # MUMPS keeps it, and crashes at the first solve
            why = (
                "is singular to working precision"
                if failure == -10
                else f"was not factored (MUMPS: {failure})"
            )
            raise NotConverged(
                f"the body's matrix {why}; with larger elements where they are smallest it may be"
            )
        # where it is looked whether the tip lies inside a surface; several ranks ask the whole body
        beside = np.unique(np.concatenate([body.skin.dofs.ravel(), body.trace.dofs.ravel()]))
        self.seen = beside if body.comm.size == 1 else beside[:0]
        self._owned_nodes, self._owned_rows, self.rows = self._number_surface_nodes()
        self._surface = self._whole_surface()
        self._last: Compliance | None = None
        self._forces_go: tuple[Compliance, Own] | None = None

    def _all_pins(self) -> list[int]:
        """One entry a pin on every rank: the local dof on its owner, -1 elsewhere."""
        counts = self.body.comm.allgather(len(self.body.pinned))
        mine = iter(self.body.pinned)
        ranks = np.repeat(np.arange(len(counts)), counts)
        return [int(next(mine)) if rank == self.body.comm.rank else -1 for rank in ranks]

    def _rows_of_supports(
        self, matrix: PETSc.Mat, walls: Sequence[Wall]
    ) -> tuple[tuple[Surface, ...], list[np.ndarray]]:
        """The surfaces that supports bear on, and for each what unit displacements add to its
        reaction.
        """
        rows = {
            of: self._row_sum(matrix, dofs, shares)
            for of, (dofs, shares) in self.body.bearing.items()
        }
        for wall in walls:
            rows |= {of: self._values_for_solver(row) for of, row in wall.rows().items()}
        return tuple(rows), list(rows.values())

    def _row_sum(
        self, matrix: PETSc.Mat, rows: np.ndarray, shares: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """Sum rows of the symmetric stiffness matrix, each weighted by its share: the reaction to
        unit displacements.

        The entries of the sum are those of the degrees of freedom that this rank solves for.
        """
        marks, total = matrix.createVecs()
        marks.array[rows[rows >= 0]] = shares
        matrix.mult(marks, total)
        return self._values_for_solver(total.array.copy())

    def _values_for_solver(self, row: np.ndarray) -> np.ndarray:
        """Values at this rank's own degrees of freedom; at those of all ranks where each rank
        solves the whole body.
        """
        return np.concatenate(self.body.comm.allgather(row)) if self._is_whole else row

    def _number_surface_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """This rank's own surface nodes, their rows among all by their places, and the rows of its
        facets' nodes.
        """
        body = self.body
        trace = self.body.trace
        space = body.unknowns.own_space("u")
        index_map = space.dofmap.index_map
        local, inverse = np.unique(trace.nodes, return_inverse=True)
        numbers = np.asarray(index_map.local_to_global(local.astype(np.int32)), dtype=np.int64)
        coordinates = space.tabulate_dof_coordinates()[local, : trace.dim]
        parts = body.comm.allgather((numbers, coordinates))
        everyone, first = np.unique(np.concatenate([p[0] for p in parts]), return_index=True)
        X = np.concatenate([p[1] for p in parts])[first]
        row = np.argsort(np.lexsort(np.round(X[:, ::-1].T, 10)))
        begin, end = index_map.local_range
        own = (begin <= everyone) & (
            everyone < end
        )  # of these some may lie on facets of other ranks alone
        rows = row[np.searchsorted(everyone, numbers)]
        return everyone[own] - begin, row[own], rows[inverse].reshape(trace.nodes.shape)

    def _whole_surface(self) -> Trace:
        """The contact surface of all ranks, its facets sorted by place and its nodes numbered by
        row.
        """
        trace = self.body.trace
        parts = self.body.comm.allgather((self.rows, trace.X))
        rows = np.concatenate([p[0] for p in parts])
        X = np.concatenate([p[1] for p in parts])
        order = np.lexsort(np.round(X.mean(axis=1), 10)[:, ::-1].T)
        return Trace(rows[order], X[order], rows[order])

    def candidates(self, reach: float, center: tuple[float, ...]) -> int:
        """How many nodes the facets have that come within `reach` [length] of the tip's axis."""
        return len(np.unique(self._surface.nodes[self._near(reach, center)]))

    def _near(self, reach: float, center: tuple[float, ...]) -> np.ndarray:
        surface = self._surface
        distance = np.linalg.norm(
            surface.X[..., :-1] - np.asarray(center)[: surface.dim - 1], axis=-1
        ).min(axis=1)
        return np.asarray(distance <= reach)

    def condense(self, reach: float, center: tuple[float, ...], axes: Sequence[int]) -> Compliance:
        """The compliance, along these axes, of the facets within `reach` [length] of the tip's
        axis, or of more.
        """
        surface = self._surface
        near = self._near(reach, center)
        places, nodes = np.unique(surface.nodes[near], return_inverse=True)
        if self._last is not None and len(self._last.held) != len(axes) - 1:
            self._last = None
        if self._last is None or not np.isin(places, self._last.places).all():
            nodes = nodes.reshape(surface.nodes[near].shape)
            trace = Trace(nodes, surface.X[near], nodes)
            held = self._held(axes[1:])
            self._last = Compliance(*self._columns(places, axes), held, trace, surface, places)
        return self._last

    def _held(self, axes: Sequence[int]) -> np.ndarray:
        """Whether the displacement along each axis is held (axes, nodes of the whole surface)."""
        dofs = self.body.unknowns.displacement_places(self._owned_nodes)[..., list(axes)]
        held = np.zeros((len(axes), 1 + self._surface.nodes.max(initial=-1)))
        held[:, self._owned_rows] = np.isin(dofs, self.body.constrained).T
        return _summed(self.body.comm, held) > 0

    def _columns(self, places: np.ndarray, axes: Sequence[int]) -> Columns:
        """C, what unit forces make supports and pins feel, and the displacements that are `seen`;
        nodes condensed to before are not solved for again.
        """
        n = len(places) * len(axes)
        known = self._last
        own, dofs, is_free = self._solved(places, axes)
        up = np.where(
            np.arange(n) < len(places), -1.0, 1.0
        )  # a force down is solved for as one that pulls up
        C = np.zeros((n, n))
        stray = np.zeros(n)
        support = self._on_held_nodes(own, up, n)
        if len(self.seen) * n > MOST_SEEN:
            self.seen = self.seen[:0]
        seen = np.zeros((len(self.seen), n))
        old = np.tile(np.isin(places, () if known is None else known.places), len(axes))
        if known is not None:
            there = np.tile(np.isin(known.places, places), len(axes))
            C[np.ix_(old, old)] = known.whole[np.ix_(there, there)]
            support[:, old], stray[old] = known.support[:, there], known.stray[there]
            seen[:, old] = known.seen[: len(seen), there]
        solved = np.zeros_like(support)
        columns = np.flatnonzero(~old)
        if self._is_whole:
            columns = np.array_split(columns, self.body.comm.size)[self.body.comm.rank]
        for block in (columns[some] for some in lots(len(columns), BLOCK)):
            found, borne, stray[block], moved = self._block(own, dofs[block], is_free[block], n)
            C[:, block], seen[:, block] = up[:, None] * found * up[block], moved * up[block]
            solved[:, block] = borne * up[block]
        if self._is_whole:
            parts = C[:, ~old], solved[:, ~old], stray[~old]
            C[:, ~old], solved[:, ~old], stray[~old] = (
                _summed(self.body.comm, part) for part in parts
            )
        support[:, ~old] += solved[:, ~old]
        C[np.ix_(~old, old)] = C[np.ix_(old, ~old)].T
        if not np.isfinite(C).all():  # the same on all ranks
            raise NotConverged("the body's response to forces on its surface is not a number")
        return (C + C.T) / 2, support, stray, seen

    def _on_held_nodes(self, own: Own, up: np.ndarray, n: int) -> np.ndarray:
        """What forces at nodes that are held put on their supports right away (surfaces, n): minus
        the force.
        """
        places, columns, _ = own
        found = np.zeros((len(self.bearing), n))
        for row, surface in enumerate(self.bearing):
            if surface not in self.body.bearing:  # a wall that holds no node
                continue
            dofs, shares = self.body.bearing[surface]
            share = np.zeros(self.body.unknowns.owned)
            share[dofs] = shares
            found[row, columns] = -up[columns] * self._values_for_solver(share)[places]
        return _summed(self._comm, found)

    def _solved(
        self, places: np.ndarray, axes: Sequence[int]
    ) -> tuple[Own, np.ndarray, np.ndarray]:
        """This rank's local dofs, columns and which are free, axis by axis; numbers among all
        unknowns, which free.
        """
        mine = np.isin(self._owned_rows, places)
        n = len(places) * len(axes)
        here = np.searchsorted(places, self._owned_rows[mine])
        columns = np.concatenate([here + k * len(places) for k in range(len(axes))])
        local = self.body.unknowns.displacement_places(self._owned_nodes[mine])[
            ..., list(axes)
        ].T.reshape(-1)
        free = ~np.isin(local, self.body.constrained)
        numbers, is_free = np.zeros((2, n), dtype=np.int32)
        numbers[columns] = local + self.body.x.getOwnershipRange()[0]
        is_free[columns] = free
        dofs = _summed(self.body.comm, numbers)
        all_free = _summed(self.body.comm, is_free) > 0
        return (
            ((dofs, np.arange(n), all_free) if self._is_whole else (local, columns, free)),
            dofs,
            all_free,
        )

    def _block(self, own: Own, dofs: np.ndarray, is_free: np.ndarray, n: int) -> Columns:
        """Displacements at n columns, reactions of the supports, largest one of the pins, for unit
        forces at dofs; and the displacements that are `seen`.
        """
        comm = self._comm
        (local, columns, _) = own
        rows = self._pc.getOperators()[0].getLocalSize()[0]
        X = PETSc.Mat().createDense(((rows, PETSc.DETERMINE), (PETSc.DECIDE, len(dofs))), comm=comm)
        X.setUp()
        X.assemble()
        self._pc.getFactorMatrix().matSolve(
            _unit_forces(comm, dofs, is_free, self.body.unknowns.total), X
        )
        solutions = X.getDenseArray()
        C = np.zeros((n, len(dofs)))
        seen = solutions[self.seen]
        C[columns] = solutions[local]
        reactions = _summed(
            comm, np.array([row @ solutions for row in (*self._support_rows, *self._pin_rows)])
        )
        X.destroy()  # left to Python they stay until the end: all blocks at once
        supports, pins = np.split(reactions, [len(self.bearing)])
        return _summed(comm, C), supports, np.abs(pins).max(axis=0, initial=0.0), seen

    def _pushed(self, compliance: Compliance) -> Own:
        """Where this rank's share of the nodal forces goes; every row asks for it, a compliance
        alone decides it.
        """
        if self._forces_go is None or self._forces_go[0] is not compliance:
            axes = [compliance.surface.dim - 1, *range(len(compliance.held))]
            self._forces_go = compliance, self._solved(compliance.places, axes)[0]
        return self._forces_go[1]

    def beside(self, compliance: Compliance, nodal_forces: np.ndarray) -> np.ndarray | None:
        """The body's local array under forces at the nodes of a compliance, where it is `seen` and
        zero elsewhere; None where that is not kept.
        """
        if not len(self.seen):
            return None
        found = np.zeros(len(self.body.local_array()))
        found[self.seen] = compliance.seen @ nodal_forces
        return found

    def recover(self, compliance: Compliance, nodal_forces: np.ndarray) -> None:
        """Put the whole body's response to forces at the nodes of a compliance into the body's
        solution.
        """
        dofs, columns, free = self._pushed(compliance)
        load, response = self._pc.getOperators()[0].createVecs()
        up = np.where(columns < len(compliance.places), -1.0, 1.0)
        load.array[dofs[free]] = (up * nodal_forces[columns])[free]
        self._pc.apply(load, response)
        solution = self.body.x.duplicate()
        solution.array = response.array[
            slice(*self.body.x.getOwnershipRange()) if self._is_whole else slice(None)
        ]
        self.body.set_solution(solution)


def _fits_every_rank(body: Body) -> bool:
    predicted = body.scene.plan.prediction.get("memory_MB", math.inf)
    smallest = body.comm.allreduce(machine_memory(), MPI.MIN)  # on several nodes
    return bool(predicted * 1e6 * body.comm.size <= smallest)


def _unit_forces(comm: MPI.Comm, dofs: np.ndarray, is_free: np.ndarray, total: int) -> PETSc.Mat:
    """Unit forces at some dofs, a column each; sparse, so that MUMPS leaves out the factors that
    they do not reach.
    """
    here = comm.rank == 0
    sizes = ((len(dofs) if here else 0, PETSc.DETERMINE), (total if here else 0, PETSc.DETERMINE))
    starts = np.concatenate([[0], np.cumsum(is_free)]) if here else np.zeros(1)
    reached = dofs[is_free] if here else dofs[:0]
    rows = PETSc.Mat().createAIJ(
        sizes, csr=(starts.astype(np.int32), reached, np.ones(len(reached))), comm=comm
    )
    return PETSc.Mat().createTranspose(rows)


def _summed(comm: MPI.Comm, values: np.ndarray) -> np.ndarray:
    return values if comm.size == 1 else comm.allreduce(values)
