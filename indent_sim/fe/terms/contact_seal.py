"""Boundary conditions of the pore fluid: drained, sealed or leaky vertices, and the contact seal.

The outflow is the sum over the surface vertices sum_i g_i p_i, with a conductance g_i
[length^3/(pressure time)] of each vertex; see `flow` for the corresponding part of the potential.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.facet_values import cell_heights, facet_nodes
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.measured_constants import OPEN_CONDUCTANCE_FACTOR
from indent_sim.fe.nodal_assembly import sum_nodal_contributions
from indent_sim.fe.terms.flow import FIELD_NAME
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.time_integration import SDIRK2_GAMMA, Stage
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.model.drainage import Conductance


class ContactSeal(Term):
    """Outflow through the surface of a porous body, which changes where the tip is in contact.

    Attributes
    ----------
    depends_on_contact : bool
        Whether contact with the tip changes the conductance of the surface.
    is_frozen : bool
        Whether the seal is the same in all stages and trials of a step, see `freeze`.
    tangent_version : int
        Number of changes of the seal; each changes the tangent.
    """

    has_memory = True

    def __init__(self, body: Body):
        self.body = body
        space = body.unknowns.collapsed_space(FIELD_NAME)
        drainage = body.scene.physics.drainage
        self._owned_count = space.dofmap.index_map.size_local
        self._pressure_dofs = body.unknowns.dofs(FIELD_NAME)
        self._surface_nodes = facet_nodes(body.mesh, space, body.body_mesh.surfaces["top"])
        self._open_conductance = OPEN_CONDUCTANCE_FACTOR * self._vertex_conductances()
        top = np.isin(np.arange(len(self._pressure_dofs)), self._surface_nodes)
        wall_conductance = np.zeros(len(top))
        for name in body.scene.physics.drained_walls:
            wall_conductance = np.maximum(
                wall_conductance, self._surface_conductance(name, "drained")
            )
        wall_conductance = np.maximum(
            wall_conductance, self._surface_conductance("base", drainage.base)
        )
        self._free_conductance, self._contact_conductance = (
            wall_conductance + top * self._surface_conductance("top", kind)
            for kind in (drainage.surface, drainage.tip)
        )
        self._is_on_top = top
        self._covers_top = body.scene.physics.is_porous_column
        self.depends_on_contact = drainage.surface != drainage.tip
        # 1 where the accepted state is in contact, and the outflow since rest [length^3]
        self._in_contact = fem.Function(space)
        self._total_outflow = fem.Function(space)
        self.history = (self._in_contact, self._total_outflow)
        self._is_touching = np.zeros(len(top), dtype=bool)
        self._visited_contacts = set[bytes]()
        # Outflow in the current step [length^3]
        self._step_outflow = np.zeros(self._owned_count)
        self.is_frozen = self._is_tried = False
        self._extrapolation_factor = 0.0
        self._was_touching = self._is_touching
        self._step_outflow_before = self._step_outflow
        self.tangent_version = 0

    def _vertex_conductances(self) -> np.ndarray:
        """Conductance of the cells at each vertex for the pore fluid [length^3/(pressure time)].

        It is the integral of k |grad N|^2 with the permeability k and the shape function N of the
        vertex.
        """
        body = self.body
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        slopes = ufl.dot(ufl.grad(ufl.TestFunction(space)), ufl.grad(ufl.TrialFunction(space)))
        flows = [
            (region, flow)
            for region in body.scene.physics.permeable_regions
            if (flow := region.material.flow)
        ]
        permeabilities = [
            (region, fem.Constant(body.mesh, flow.permeability)) for region, flow in flows
        ]
        forms = [body.region_integral(k * slopes, region) for region, k in permeabilities]
        matrix = fem_petsc.assemble_matrix(compile_form(sum(forms)))
        matrix.assemble()
        diagonal = np.zeros(len(self._pressure_dofs))
        diagonal[: self._owned_count] = matrix.getDiagonal().array_r
        matrix.destroy()
        return diagonal

    def _surface_conductance(self, surface: str, boundary: str | Conductance) -> np.ndarray:
        """Conductance of a surface at each vertex [length^3/(pressure time)].

        Parameters
        ----------
        surface : str
            Name of the surface.
        boundary : str or Conductance
            `drained`, `sealed`, or a conductance per area.
        """
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        if isinstance(boundary, Conductance):
            area = fem_petsc.assemble_vector(
                compile_form(self.body.surface_integral(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            conductance = np.zeros(len(self._pressure_dofs))
            conductance[: self._owned_count] = boundary.conductance * area.array_r
            # Nothing flows out of impermeable regions
            return np.where(self._open_conductance > 0, conductance, 0.0)
        nodes = facet_nodes(self.body.mesh, space, self._surface_facets(surface))
        facet_counts = sum_nodal_contributions(
            self.body.x, self._pressure_dofs[nodes], np.ones(nodes.shape)
        )[self._pressure_dofs]
        return np.where((facet_counts > 0) & (boundary == "drained"), self._open_conductance, 0.0)

    def _surface_facets(self, surface: str) -> np.ndarray:
        return self.body.body_mesh.surfaces.get(surface, np.empty(0, dtype=np.int32))

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> None:
        """Return None, because `add_residual` assembles the outflow, a sum over vertices."""

    @property
    def _conductance(self) -> np.ndarray:
        return np.where(self._is_touching, self._contact_conductance, self._free_conductance)[
            : self._owned_count
        ]

    @property
    def _outflow_rate(self) -> np.ndarray:
        """Outflow rate g_i p_i at the vertices that this rank owns [length^3/time]."""
        return self._conductance * self.body.local_array()[self._pressure_dofs[: self._owned_count]]

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the outflow of the stage, -dt g_i p_i, minus `_retracted_outflow`."""
        b.array[self._pressure_dofs[: self._owned_count]] -= (
            float(self.body.dt.value) * self._outflow_rate - self._retracted_outflow
        )

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the derivative -dt g_i of the outflow to the diagonal of the tangent."""
        values = self._conductance
        dt = float(self.body.dt.value)
        for i in np.flatnonzero(values):
            row = self._pressure_dofs[i : i + 1].astype(np.int32)
            A.setValuesLocal(row, row, np.array([-dt * values[i]]), addv=PETSc.InsertMode.ADD)

    @property
    def _retracted_outflow(self) -> np.ndarray:
        """Part of the first stage's outflow that the second stage must not extrapolate [length^3].

        It is non-zero at vertices that the tip has covered between the stages, where the outflow
        has stopped.
        """
        closed = (self._is_touching & ~self._was_touching)[: self._owned_count]
        # A vertex that the tip closes in a step is assumed to drain for half of it. With the factor
        # 1 + sqrt 2 of an open vertex the pore pressure of that row had a spike of half the
        # modulus, and forces of a gel that swells against a sphere were up to 3 % too large, while
        # steps a fourth as long left 0.1 %. With half of the step they are within 1.4 % at all
        # times: late rows are more accurate (3 -> 0.9 %, 1 -> 0.2 %), early rows less (0.4 -> 0.8
        # and 1.4 %). Measured only on configs/swelling_gel.yaml, per_doubling 4 compared with 16.
        half_step = 1 / (2 * SDIRK2_GAMMA)
        return np.where(
            closed, (self._extrapolation_factor - half_step) * self._step_outflow_before, 0.0
        )

    def freeze(self) -> None:
        """Keep the seal unchanged in all stages and trials of a step from now on.

        The seal corresponds to the contact of the accepted state until `update_contact` changes it.
        """
        self.is_frozen = True

    def begin_stage(self, stage: Stage) -> None:
        """Start a step with the seal of the accepted state."""
        self._extrapolation_factor = stage.extrapolation_factor
        self._was_touching = self._is_touching
        self._step_outflow_before = self._step_outflow
        if not stage.extrapolation_factor:
            self._was_touching = np.ones_like(self._is_touching)
            self._step_outflow_before = 0.0 * self._step_outflow
        if self._is_tried:
            return
        if not stage.extrapolation_factor:
            self._set_contact(self._contact_at_start())
        self._visited_contacts = {self._is_touching.tobytes()}
        self._is_tried = self.is_frozen

    def _contact_at_start(self) -> np.ndarray:
        """Return the contact vertices with which the equilibrium iteration of a step starts.

        The contact vertices of the accepted state are returned. If the tip covers the whole top and
        has not touched it yet, all vertices of the top are returned, because in a body with sealed
        walls the tangent is singular as long as no fluid can leave through the tip.
        """
        in_contact = self._in_contact.x.array > 0.5
        if self._covers_top and not self.body.comm.allreduce(bool(in_contact.any()), op=MPI.LOR):
            return self._is_on_top
        return in_contact

    def update_contact(self, touching: np.ndarray) -> bool:
        """Update the seal to the contact of the current equilibrium (collective).

        Parameters
        ----------
        touching : ndarray of bool, (facets, corners)
            Corners of the contact facets that are in contact.

        Returns
        -------
        bool
            Whether the seal has changed, so that the equilibrium must be solved again. A seal that
            recurs within the stage is not set again, because two seals that differ by one element
            at the contact edge may alternate, and either is accurate enough.
        """
        if not self.depends_on_contact:
            return False
        is_touching = (
            sum_nodal_contributions(
                self.body.x, self._pressure_dofs[self._surface_nodes], touching.astype(float)
            )[self._pressure_dofs]
            > 0
        )
        is_new = self.body.comm.allreduce(
            is_touching.tobytes() not in self._visited_contacts, op=MPI.LOR
        )
        if is_new:
            self._set_contact(is_touching)
            self._visited_contacts.add(is_touching.tobytes())
        return bool(is_new)

    def _set_contact(self, is_touching: np.ndarray) -> None:
        self.tangent_version += int(
            self.body.comm.allreduce(bool((is_touching != self._is_touching).any()), op=MPI.LOR)
        )
        self._is_touching = is_touching

    def end_stage(self, stage: Stage) -> None:
        """Add the outflow of a stage to that of the step, with the weights of SDIRK2."""
        self._step_outflow = (
            stage.extrapolation_factor * self._step_outflow_before
            + stage.dt * self._outflow_rate
            - self._retracted_outflow
        )

    def accept(self) -> None:
        """Store the contact and add the outflow of the step to the total."""
        self._total_outflow.x.array[: self._owned_count] += self._step_outflow
        self._in_contact.x.array[:] = self._is_touching
        self._is_tried = False

    def drained_surface_table(self) -> np.ndarray:
        """Return element heights and squared pore pressures at the surface vertices (collective).

        The table is used to estimate the effect of drained surfaces on a state without flow. The
        second column is zero at vertices whose conductance is smaller than the conductance of their
        cells, because such a surface does not prescribe the pressure.

        Returns
        -------
        ndarray, (vertices, 2)
            Height of the elements at each surface vertex [length], and p^2 times the area of the
            vertex [pressure^2 length^2], of all ranks, ordered by global vertex number.
        """
        body = self.body
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        vertex_numbers = np.asarray(
            space.dofmap.index_map.local_to_global(
                np.arange(len(self._pressure_dofs), dtype=np.int32)
            )
        )
        heights = np.zeros(len(vertex_numbers))
        areas = np.zeros(len(vertex_numbers))
        drainage = body.scene.physics.drainage
        drainage_of_surface = {"top": drainage.surface, "base": drainage.base}
        drainage_of_surface |= dict.fromkeys(body.scene.physics.drained_walls, "drained")
        for surface in drainage_of_surface:
            facets = self._surface_facets(surface)
            area = fem_petsc.assemble_vector(
                compile_form(body.surface_integral(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            areas[: self._owned_count] += area.array_r
            area.destroy()
            nodes = facet_nodes(body.mesh, space, facets)
            cell_heights_at_nodes = np.repeat(
                cell_heights(body.mesh, facets)[:, None], nodes.shape[1], axis=1
            )
            summed_heights, facet_counts = (
                sum_nodal_contributions(body.x, self._pressure_dofs[nodes], values)[
                    self._pressure_dofs
                ]
                for values in (cell_heights_at_nodes, np.ones(nodes.shape))
            )
            heights += summed_heights / np.maximum(facet_counts, 1.0)
        p = body.local_array()[self._pressure_dofs[: self._owned_count]]
        is_draining = (
            self._conductance
            > self._open_conductance[: self._owned_count] / OPEN_CONDUCTANCE_FACTOR
        )
        local_rows = np.column_stack(
            [
                heights[: self._owned_count],
                np.where(is_draining, areas[: self._owned_count], 0.0) * p**2,
            ]
        )
        is_on_surface = areas[: self._owned_count] > 0
        parts = body.comm.allgather(
            (vertex_numbers[: self._owned_count][is_on_surface], local_rows[is_on_surface])
        )
        table = np.concatenate([rows for _, rows in parts])
        return table[np.argsort(np.concatenate([numbers for numbers, _ in parts]), kind="stable")]

    def total_outflow(self) -> float:
        """Outflow since the state of rest [length^3], this rank's part in the model domain."""
        is_mid_step = float(self.body.now.t.value) != float(self.body.before.t.value)
        return float(
            self._total_outflow.x.array[: self._owned_count].sum()
            + is_mid_step * self._step_outflow.sum()
        )
