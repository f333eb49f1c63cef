"""A linear body condensed to its contact surface: u_z = -C F.

F are nodal forces, positive downwards (int p N_j), and u_z the vertical displacements of the same
nodes. The contact problem of a frictionless tip on a linear body with a reference gap depends on
the body through C only. After one factorisation and one block of solutions, every depth, tip and
contact method is a small dense problem. With friction, C has further rows and columns for the
horizontal axes, after those of the vertical axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csc_matrix

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.measured_constants import BLOCK_SIZE
from indent_sim.fe.quadrature import contact_quadrature
from indent_sim.fe.shape_functions import shape_functions
from indent_sim.fe.surface import Trace
from indent_sim.fe.terms.scene_terms import bulk_terms
from indent_sim.fe.terms.weak_roller import WeakRollerBC
from indent_sim.mesh.grid import row_slices
from indent_sim.mesh.reactions import SurfaceComponent
from indent_sim.model.tip_track import TipTrack
from indent_sim.process.errors import NotConverged
from indent_sim.process.usage import machine_memory

ComplianceColumns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
OwnedDofs = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class FlatBelow:
    """Flat on which a body rests, and the spring between the flat and the body.

    Attributes
    ----------
    is_on_flat
        Whether each node of the surface is a node of the contact with the flat.
    signs
        Direction of each candidate's force (n,): 1 downwards under the tip, -1 upwards on the flat.
    spring
        Compliance of the spring [length/force].
    """

    is_on_flat: np.ndarray
    signs: np.ndarray
    spring: float

    def imbalance(self, nodal_forces: np.ndarray) -> float:
        """Return the force on the tip minus that on the flat [force], carried by the spring."""
        return float(self.signs @ nodal_forces)


@dataclass(frozen=True)
class Compliance:
    """Compliance matrix of the candidate nodes of the contact surface, identical on all ranks.

    Attributes
    ----------
    matrix
        Compliance (m n, m n) [length/force] between the n candidates: the vertical axis first and,
        with friction, m - 1 horizontal axes after it.
    support_reactions
        Reactions (surfaces, m n) of the condenser's `support_surfaces` to a unit force at a
        candidate.
    pin_reactions
        Largest reaction (m n,) of the pins that prevent rigid motion to a unit force.
    observed_displacements
        Displacements (k, m n), per unit force, at the k surface dofs outside the candidates. They
        are needed to check that the tip does not penetrate there; k = 0 if the table would be too
        large or several ranks share the body.
    is_constrained
        Whether the displacement along each horizontal axis is prescribed (m - 1, nodes of the
        surface).
    trace
        Facets between the candidates; its `nodes` are rows of C.
    surface
        All facets of the contact surface.
    candidates
        Numbers of the candidates (n,) among the nodes of the surface.
    flat
        Flat on which the body rests; None if it does not. The coordinates of the nodes on the flat
        are those of the body turned upside down.
    """

    matrix: np.ndarray
    support_reactions: np.ndarray
    pin_reactions: np.ndarray
    observed_displacements: np.ndarray
    is_constrained: np.ndarray
    trace: Trace
    surface: Trace
    candidates: np.ndarray
    flat: FlatBelow | None = None

    @property
    def size(self) -> int:
        """Number of candidate nodes n."""
        return len(self.candidates)

    @property
    def C(self) -> np.ndarray:
        """Downward displacements (n, n) of the candidates per unit downward force."""
        return self.matrix[: self.size, : self.size]

    @property
    def rests_on_flat(self) -> np.ndarray | None:
        """Whether each facet of the trace (facets,) may touch the flat; None for a bonded body."""
        if self.flat is None:
            return None
        return np.asarray((self.flat.signs < 0)[self.trace.nodes].all(axis=1))

    @property
    def tip_trace(self) -> Trace:
        """The facets of the trace that the tip may touch."""
        on_flat = self.rests_on_flat
        return self.trace if on_flat is None else self.trace.select_facets(~on_flat)

    @property
    def tip_surface(self) -> Trace:
        """The facets of the surface that the tip may touch."""
        if self.flat is None:
            return self.surface
        return self.surface.select_facets(~self.flat.is_on_flat[self.surface.nodes].all(axis=1))


class Condenser:
    """Factors the stiffness matrix of a linear body once; condenses the body to its surface.

    With several ranks, each rank factors the whole body and solves for its share of the unit
    forces. If the memory does not suffice, all ranks factor the body together and solve for all
    unit forces.

    Attributes
    ----------
    facet_rows
        Nodes (facets, nodes) of this rank's facets, by their numbers in the whole surface.
    is_on_flat
        Whether each node of the whole surface belongs to the base, on which the body rests.

    Parameters
    ----------
    body
        The discrete body.
    base
        Facets of a base that is a second contact surface. All of its nodes are candidates.
    """

    def __init__(self, body: Body, base: Trace | None = None):
        self.body = body
        self._trace = body.trace if base is None else body.trace.join(base)
        bulk = bulk_terms(body)
        self.strain_energies = bulk.strain_energies
        self._solves_whole_body = body.comm.size > 1 and _fits_every_rank(body)
        # Ranks that solve one system together
        self._comm = MPI.COMM_SELF if self._solves_whole_body else body.comm
        tangents = [term.tangent(body.now, body.now, body.dt) for term in bulk]
        matrix = fem_petsc.assemble_matrix(compile_form(reduce(add, tangents)))
        matrix.assemble()
        self.support_surfaces, self._support_rows = self._support_reaction_rows(
            matrix, bulk.rollers
        )
        self._pin_rows = [
            self._sum_rows(matrix, np.array([pin])) for pin in self._pins_of_all_ranks()
        ]
        matrix.zeroRowsColumnsLocal(body.constrained_dofs.astype(np.int32), diag=1.0)
        if self._solves_whole_body:
            all_rows = PETSc.IS().createStride(matrix.getSize()[0], 0, 1, MPI.COMM_SELF)
            matrix = matrix.createSubMatrices([all_rows], [all_rows])[0]
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        # Surface tension on a curved surface may make the matrix indefinite, as a pressure field
        # does
        if body.unknowns.names == ("u",) and not (
            bulk.surface_tension and body.scene.physics.domain.top_radius
        ):
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc = PETSc.PC().create(self._comm)
        self._pc.setOperators(matrix)
        # The matrix of a mixed formulation is indefinite, so that this is LDL^T.
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._pc.setFactorSetUpSolverType()
        # Layers of very different stiffness have many delayed pivots: MUMPS gets 200 per cent more
        # memory than it estimates (ICNTL 14). ICNTL 27 is the number of right-hand sides at once.
        for option, value in ((14, 200), (27, BLOCK_SIZE)):
            self._pc.getFactorMatrix().setMumpsIcntl(option, value)
        self._pc.setUp()
        # MUMPS only stores its error, and would crash at the first solve
        if failure := self._pc.getFactorMatrix().getMumpsInfog(1):
            reason = f"could not be factored (MUMPS error {failure})"
            if failure == -10:
                reason = "is singular to working precision"
            raise NotConverged(
                f"the stiffness matrix of the body {reason}; larger elements where the mesh is "
                "finest may help"
            )
        # Dofs of the surface on which penetration outside the contact surface is checked. With
        # several ranks this array is empty, and the whole body is recovered instead.
        surface_dofs = np.unique(
            np.concatenate([body.noncontact_trace.dofs.ravel(), self._trace.dofs.ravel()])
        )
        self.observed_dofs = surface_dofs if body.comm.size == 1 else surface_dofs[:0]
        self._owned_nodes, self._owned_rows, self.facet_rows = self._number_surface_nodes()
        self._surface = self._gather_surface()
        self.is_on_flat = self._find_nodes_on_flat(len(body.trace.nodes))
        self._last_compliance: Compliance | None = None
        self._force_dofs: tuple[Compliance, OwnedDofs] | None = None

    def _pins_of_all_ranks(self) -> list[int]:
        """Return each pin's local dof on the rank that owns it, and -1 on the other ranks."""
        counts = self.body.comm.allgather(len(self.body.pin_dofs))
        local_pins = iter(self.body.pin_dofs)
        ranks = np.repeat(np.arange(len(counts)), counts)
        return [int(next(local_pins)) if rank == self.body.comm.rank else -1 for rank in ranks]

    def _support_reaction_rows(
        self, matrix: PETSc.Mat, walls: Sequence[WeakRollerBC]
    ) -> tuple[tuple[SurfaceComponent, ...], list[np.ndarray]]:
        """Return the supported surfaces, and for each the row vector that gives its reaction.

        The product of the row and the displacements is the reaction.
        """
        rows = {
            surface: self._sum_rows(matrix, dofs, shares)
            for surface, (dofs, shares) in self.body.support_shares.items()
        }
        for wall in walls:
            rows |= {
                surface: self._values_for_solver(row)
                for surface, row in wall.reaction_rows().items()
            }
        return tuple(rows), list(rows.values())

    def _sum_rows(
        self, matrix: PETSc.Mat, rows: np.ndarray, row_weights: np.ndarray | float = 1.0
    ) -> np.ndarray:
        """Return the weighted sum of rows of the symmetric stiffness matrix.

        The product of this sum and the displacements is a reaction. The result has one entry for
        each degree of freedom that this rank solves for.
        """
        weights, total = matrix.createVecs()
        weights.array[rows[rows >= 0]] = row_weights
        matrix.mult(weights, total)
        return self._values_for_solver(total.array.copy())

    def _values_for_solver(self, row: np.ndarray) -> np.ndarray:
        """Return a row of values at the degrees of freedom that this rank solves for.

        The argument has the values at the dofs that this rank owns. If every rank solves the whole
        body, the result has the values of all ranks.
        """
        return np.concatenate(self.body.comm.allgather(row)) if self._solves_whole_body else row

    def _number_surface_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Number the surface nodes by their coordinates, independent of the number of ranks.

        Returns the surface nodes that this rank owns, their numbers, and the numbers of the nodes
        of this rank's facets.
        """
        body = self.body
        trace = self._trace
        space = body.unknowns.collapsed_space("u")
        index_map = space.dofmap.index_map
        local, inverse = np.unique(trace.nodes, return_inverse=True)
        numbers = np.asarray(index_map.local_to_global(local.astype(np.int32)), dtype=np.int64)
        coordinates = space.tabulate_dof_coordinates()[local, : trace.dim]
        parts = body.comm.allgather((numbers, coordinates))
        all_numbers, first = np.unique(
            np.concatenate([part[0] for part in parts]), return_index=True
        )
        X = np.concatenate([part[1] for part in parts])[first]
        row = np.argsort(np.lexsort(np.round(X[:, ::-1].T, 10)))
        begin, end = index_map.local_range
        # Some of them may belong only to facets of other ranks
        is_owned = (begin <= all_numbers) & (all_numbers < end)
        rows = row[np.searchsorted(all_numbers, numbers)]
        return (
            all_numbers[is_owned] - begin,
            row[is_owned],
            rows[inverse].reshape(trace.nodes.shape),
        )

    def _gather_surface(self) -> Trace:
        """Return the contact surface of all ranks, facets and nodes sorted by their coordinates."""
        trace = self._trace
        parts = self.body.comm.allgather((self.facet_rows, trace.X))
        rows = np.concatenate([part[0] for part in parts])
        X = np.concatenate([part[1] for part in parts])
        order = np.lexsort(np.round(X.mean(axis=1), 10)[:, ::-1].T)
        return Trace(rows[order], X[order], rows[order])

    def _find_nodes_on_flat(self, tip_facets: int) -> np.ndarray:
        """Return a mask of the surface nodes on the facets after this rank's first `tip_facets`."""
        rows = np.concatenate(self.body.comm.allgather(self.facet_rows[tip_facets:].ravel()))
        is_on_flat = np.zeros(1 + self._surface.nodes.max(initial=-1), dtype=bool)
        is_on_flat[rows] = True
        return is_on_flat

    def count_candidates(self, radius: float, track: TipTrack) -> int:
        """Return the number of nodes that may touch the tip or a flat below.

        They are on the facets within a radius [length] of the tip's track, and on a flat below.
        """
        return len(np.unique(self._surface.nodes[self._is_near_track(radius, track)]))

    def _is_near_track(self, radius: float, track: TipTrack) -> np.ndarray:
        """Return a mask of the facets near the tip's track and of all facets on a flat below."""
        surface = self._surface
        is_near = track.distance(surface.X[..., :-1]).min(axis=1) <= radius
        return np.asarray(is_near | self.is_on_flat[surface.nodes].all(axis=1))

    def condense(self, radius: float, track: TipTrack, axes: Sequence[int]) -> Compliance:
        """Return the compliance of the surface nodes on facets near the track of the tip's axis.

        The previous compliance is returned if it already includes all these nodes.

        Parameters
        ----------
        radius, track
            Radius [length] around the track of the tip's axis.
        axes
            Axes of the displacement: the vertical one, and with friction the horizontal ones.
        """
        surface = self._surface
        is_near = self._is_near_track(radius, track)
        candidates, nodes = np.unique(surface.nodes[is_near], return_inverse=True)
        if (
            self._last_compliance is not None
            and len(self._last_compliance.is_constrained) != len(axes) - 1
        ):
            self._last_compliance = None
        if (
            self._last_compliance is None
            or not np.isin(candidates, self._last_compliance.candidates).all()
        ):
            nodes = nodes.reshape(surface.nodes[is_near].shape)
            trace = Trace(nodes, surface.X[is_near], nodes)
            is_constrained = self._find_constrained_nodes(axes[1:])
            self._last_compliance = Compliance(
                *self._compliance_columns(candidates, axes),
                is_constrained,
                trace,
                surface,
                candidates,
            )
        return self._last_compliance

    def _find_constrained_nodes(self, axes: Sequence[int]) -> np.ndarray:
        """Return a mask (axes, nodes) of the surface nodes whose displacement is prescribed."""
        dofs = self.body.unknowns.displacement_dofs(self._owned_nodes)[..., list(axes)]
        is_constrained = np.zeros((len(axes), 1 + self._surface.nodes.max(initial=-1)))
        is_constrained[:, self._owned_rows] = np.isin(dofs, self.body.constrained_dofs).T
        return _sum_over_ranks(self.body.comm, is_constrained) > 0

    def _compliance_columns(self, candidates: np.ndarray, axes: Sequence[int]) -> ComplianceColumns:
        """Return the compliance matrix, support and pin reactions, and observed displacements.

        Systems are solved only for unit forces at candidates that no earlier call has included.
        """
        n = len(candidates) * len(axes)
        cached = self._last_compliance
        owned, dofs, is_free = self._locate_dofs(candidates, axes)
        # A downward force, positive here, points in the negative z direction
        signs = np.where(np.arange(n) < len(candidates), -1.0, 1.0)
        C = np.zeros((n, n))
        pin_reactions = np.zeros(n)
        support_reactions = self._constrained_node_reactions(owned, signs, n)
        # At most 4 million displacements (32 MB) are kept; with more, none.
        if len(self.observed_dofs) * n > 4_000_000:
            self.observed_dofs = self.observed_dofs[:0]
        displacements = np.zeros((len(self.observed_dofs), n))
        is_cached = np.tile(
            np.isin(candidates, () if cached is None else cached.candidates), len(axes)
        )
        if cached is not None:
            is_wanted = np.tile(np.isin(cached.candidates, candidates), len(axes))
            C[np.ix_(is_cached, is_cached)] = cached.matrix[np.ix_(is_wanted, is_wanted)]
            support_reactions[:, is_cached] = cached.support_reactions[:, is_wanted]
            pin_reactions[is_cached] = cached.pin_reactions[is_wanted]
            displacements[:, is_cached] = cached.observed_displacements[
                : len(displacements), is_wanted
            ]
        solved_reactions = np.zeros_like(support_reactions)
        columns = np.flatnonzero(~is_cached)
        if self._solves_whole_body:
            columns = np.array_split(columns, self.body.comm.size)[self.body.comm.rank]
        for block in (columns[rows] for rows in row_slices(len(columns), BLOCK_SIZE)):
            compliance, reactions, pin_reactions[block], block_displacements = self._solve_block(
                owned, dofs[block], is_free[block], n
            )
            C[:, block] = signs[:, None] * compliance * signs[block]
            displacements[:, block] = block_displacements * signs[block]
            solved_reactions[:, block] = reactions * signs[block]
        if self._solves_whole_body:
            parts = C[:, ~is_cached], solved_reactions[:, ~is_cached], pin_reactions[~is_cached]
            C[:, ~is_cached], solved_reactions[:, ~is_cached], pin_reactions[~is_cached] = (
                _sum_over_ranks(self.body.comm, part) for part in parts
            )
        support_reactions[:, ~is_cached] += solved_reactions[:, ~is_cached]
        C[np.ix_(~is_cached, is_cached)] = C[np.ix_(is_cached, ~is_cached)].T
        if not np.isfinite(C).all():  # C is the same on all ranks, so all of them raise
            raise NotConverged("the body's response to forces on its surface is not a number")
        return (C + C.T) / 2, support_reactions, pin_reactions, displacements

    def _constrained_node_reactions(
        self, owned: OwnedDofs, signs: np.ndarray, n: int
    ) -> np.ndarray:
        """Return the support reactions (surfaces, n) to unit forces at constrained nodes.

        Such a force acts on the support directly, so that the reaction is minus the force.
        """
        dof_positions, columns, _ = owned
        reactions = np.zeros((len(self.support_surfaces), n))
        for row, surface in enumerate(self.support_surfaces):
            if surface not in self.body.support_shares:  # weak rollers prescribe no nodal values
                continue
            dofs, shares = self.body.support_shares[surface]
            share = np.zeros(self.body.unknowns.owned_count)
            share[dofs] = shares
            reactions[row, columns] = (
                -signs[columns] * self._values_for_solver(share)[dof_positions]
            )
        return _sum_over_ranks(self._comm, reactions)

    def _locate_dofs(
        self, candidates: np.ndarray, axes: Sequence[int]
    ) -> tuple[OwnedDofs, np.ndarray, np.ndarray]:
        """Return the displacement dofs of the candidates: all vertical ones, then axis by axis.

        Returns, first, the dofs that this rank solves for, as local numbers, columns of the
        compliance matrix and a mask of the unconstrained ones; second, the global numbers of all
        candidate dofs; third, the mask of the unconstrained ones among these.
        """
        is_candidate = np.isin(self._owned_rows, candidates)
        n = len(candidates) * len(axes)
        positions = np.searchsorted(candidates, self._owned_rows[is_candidate])
        columns = np.concatenate([positions + k * len(candidates) for k in range(len(axes))])
        local = self.body.unknowns.displacement_dofs(self._owned_nodes[is_candidate])[
            ..., list(axes)
        ].T.reshape(-1)
        free = ~np.isin(local, self.body.constrained_dofs)
        numbers, is_free = np.zeros((2, n), dtype=np.int32)
        numbers[columns] = local + self.body.x.getOwnershipRange()[0]
        is_free[columns] = free
        dofs = _sum_over_ranks(self.body.comm, numbers)
        all_free = _sum_over_ranks(self.body.comm, is_free) > 0
        return (
            ((dofs, np.arange(n), all_free) if self._solves_whole_body else (local, columns, free)),
            dofs,
            all_free,
        )

    def _solve_block(
        self, owned: OwnedDofs, dofs: np.ndarray, is_free: np.ndarray, n: int
    ) -> ComplianceColumns:
        """Solve for a block of unit forces, one at each of the given dofs.

        Returns the displacements at the n columns of C, the reactions of the supports, the largest
        reaction of the pins, and the displacements at the observed dofs.
        """
        comm = self._comm
        local, columns, _ = owned
        rows = self._pc.getOperators()[0].getLocalSize()[0]
        X = PETSc.Mat().createDense(((rows, PETSc.DETERMINE), (PETSc.DECIDE, len(dofs))), comm=comm)
        X.setUp()
        X.assemble()
        self._pc.getFactorMatrix().matSolve(
            _unit_forces(comm, dofs, is_free, self.body.unknowns.total_count), X
        )
        solutions = X.getDenseArray()
        C = np.zeros((n, len(dofs)))
        displacements = solutions[self.observed_dofs]
        C[columns] = solutions[local]
        reactions = _sum_over_ranks(
            comm, np.array([row @ solutions for row in (*self._support_rows, *self._pin_rows)])
        )
        # PETSc frees objects that Python collects only at the end, so that the matrices of all
        # blocks would stay until then.
        X.destroy()
        supports, pins = np.split(reactions, [len(self.support_surfaces)])
        return (
            _sum_over_ranks(comm, C),
            supports,
            np.abs(pins).max(axis=0, initial=0.0),
            displacements,
        )

    def _find_force_dofs(self, compliance: Compliance) -> OwnedDofs:
        """Return this rank's dofs at which nodal forces act, cached for each compliance."""
        if self._force_dofs is None or self._force_dofs[0] is not compliance:
            axes = [compliance.surface.dim - 1, *range(len(compliance.is_constrained))]
            self._force_dofs = compliance, self._locate_dofs(compliance.candidates, axes)[0]
        return self._force_dofs[1]

    def local_displacements(
        self, compliance: Compliance, nodal_forces: np.ndarray
    ) -> np.ndarray | None:
        """Return this rank's displacements at the observed dofs under nodal forces.

        The local array is zero at all other dofs, because the whole body is not solved. Returns
        None if the displacements at the observed dofs are not stored.

        Parameters
        ----------
        compliance
            The compliance on whose candidates the forces act.
        nodal_forces
            Nodal forces (m n,) [force].
        """
        if not len(self.observed_dofs):
            return None
        displacements = np.zeros(len(self.body.local_array()))
        displacements[self.observed_dofs] = compliance.observed_displacements @ nodal_forces
        return displacements

    def recover(self, compliance: Compliance, nodal_forces: np.ndarray) -> None:
        """Set the solution of the body to its response to nodal forces.

        Parameters
        ----------
        compliance
            The compliance on whose candidates the forces act.
        nodal_forces
            Nodal forces (m n,) [force].
        """
        dofs, columns, free = self._find_force_dofs(compliance)
        load, response = self._pc.getOperators()[0].createVecs()
        signs = np.where(columns < len(compliance.candidates), -1.0, 1.0)
        load.array[dofs[free]] = (signs * nodal_forces[columns])[free]
        self._pc.apply(load, response)
        solution = self.body.x.duplicate()
        solution.array = response.array[
            slice(*self.body.x.getOwnershipRange()) if self._solves_whole_body else slice(None)
        ]
        self.body.set_solution(solution)


def surface_mass_matrix(surface: Trace, weighted_areas: np.ndarray) -> csc_matrix:
    """Return the mass matrix int N_i N_j dA of a contact surface [area].

    Parameters
    ----------
    surface
        All facets of the surface.
    weighted_areas
        Areas (facets, points) that the points of the contact quadrature represent, including their
        weights.
    """
    N = shape_functions(contact_quadrature(surface.dim)[0])
    nodes = surface.nodes
    rows, columns = np.broadcast_arrays(nodes[:, :, None], nodes[:, None, :])
    values = np.einsum("fp,pn,pm->fnm", weighted_areas, N, N).ravel()
    size = 1 + int(nodes.max(initial=-1))
    return csc_matrix((values, (rows.ravel(), columns.ravel())), shape=(size, size))


def _fits_every_rank(body: Body) -> bool:
    """Return whether the memory suffices for one factorisation of the body per rank."""
    predicted_memory = body.scene.plan.prediction.get("memory_MB", math.inf)
    # Ranks on several machines may have different memories
    smallest_memory = body.comm.allreduce(machine_memory(), MPI.MIN)
    return bool(predicted_memory * 1e6 * body.comm.size <= smallest_memory)


def _unit_forces(comm: MPI.Comm, dofs: np.ndarray, is_free: np.ndarray, total: int) -> PETSc.Mat:
    """Return a sparse matrix with one unit force in each column, at the given dofs.

    A sparse right-hand side lets MUMPS skip the parts of the factor that stay zero.
    """
    is_root = comm.rank == 0
    sizes = (
        (len(dofs) if is_root else 0, PETSc.DETERMINE),
        (total if is_root else 0, PETSc.DETERMINE),
    )
    starts = np.concatenate([[0], np.cumsum(is_free)]) if is_root else np.zeros(1)
    free_dofs = dofs[is_free] if is_root else dofs[:0]
    rows = PETSc.Mat().createAIJ(
        sizes, csr=(starts.astype(np.int32), free_dofs, np.ones(len(free_dofs))), comm=comm
    )
    return PETSc.Mat().createTranspose(rows)


def _sum_over_ranks(comm: MPI.Comm, values: np.ndarray) -> np.ndarray:
    """Return the sum of an array over all ranks, on every rank."""
    return values if comm.size == 1 else comm.allreduce(values)
