"""Fluid in the pores of a body: Biot's equations, with the drained law's strain energy beside them.

The pressure p [pressure] of the fluid is counted from the bath's, p_b: above zero it pushes fluid
out. With the growth e of the volume (tr eps, at finite strain J - 1) and the content zeta = alpha e
+ storage (p + p_b) of fluid per undeformed volume, a stage of length dt that sets out from the
content zeta* adds

    int [ -alpha (p + p_b) e - storage (p + p_b)^2/2 + p zeta* - dt/2 grad p . m grad p ] dV  -
    dt/2 sum_i g_i p_i^2

to the potential: its slopes along u and p are equilibrium and the balance of fluid, zeta - zeta* =
dt div(m grad p). m is the mobility (at finite strain that of the step's begin), g_i the conductance
of the surface at a vertex i, so g_i p_i [length^3/time] flows out there. zeta* enters by its
integrals over the vertices' functions: what has left and what is there add up to round-off. Where
no time passes nothing flows, and the body is undrained.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body, Field, TimeLevel, symbolic_copy
from indent_sim.fe.surface import barycentric, cell_heights, facet_nodes
from indent_sim.fe.terms.contact.multiplier import sum_nodal_contributions
from indent_sim.fe.terms.term import SDIRK2_GAMMA, Stage, Term
from indent_sim.mesh.model_domain import Region
from indent_sim.model.drainage import Conductance
from indent_sim.scene.scene import Scene

FIELD_NAME = "pore"
# Conductance of an open vertex in that of its own cells: p is 1e-8 of what it would be there.
# Forces are equal to 1e-7 from 1e6 on, and to 1e10 no digit is lost.
OPEN_CONDUCTANCE_FACTOR = 1e8
# What passes a vertex in a step in which the tip closes it, over what has passed it in the first
# stage of that step: it is taken to drain for half of the step. With the 1 + sqrt 2 of an open
# vertex the pore pressure had a spike of half the modulus in that row, and forces of a gel that
# swells against a sphere were up to 3 % too large, in steps a fourth of which leave 0.1 %. With
# half of the step they are within 1.4 % at all times: late rows are nearer (3 -> 0.9 %, 1 -> 0.2
# %), the early ones farther (0.4 -> 0.8 and 1.4 %). Measured on one scene alone,
# configs/swelling_gel.yaml, per_doubling 4 beside 16.
CLOSING_STEP_FRACTION = 1 / (2 * SDIRK2_GAMMA)


def fields(scene: Scene) -> list[Field]:
    """The pressure p of all permeable regions, continuous between them.

    A volume of fluid that is missing pushes what is around it: it is worth the stiffest region's E.
    """
    stiffest_E = max(region.material.constants.E for region in scene.physics.domain.regions)
    return (
        [Field(FIELD_NAME, 1, domain=regions, weight=stiffest_E)]
        if (regions := scene.physics.permeable_regions)
        else []
    )


class Flow(Term):
    """The fluid inside: what it does to the body, how much of it is where, and how it flows."""

    is_bulk = True
    field_names = (FIELD_NAME,)
    has_memory = True
    has_flow = True

    def __init__(self, body: Body):
        self.body = body
        self._laws = {
            region: symbolic_copy(region.material, body.mesh)
            for region in body.scene.physics.permeable_regions
        }
        self._bath_pressures, self._bath_pressures_before = (
            {region: fem.Constant(body.mesh, 0.0) for region in self._laws} for _ in range(2)
        )
        self.has_constant_tangent = body.scene.physics.small_strain
        pressure = body.now.fields[FIELD_NAME]
        now = body.now
        self.energy = sum(
            body.region_integral(
                law.flow.storage * (pressure + self._bath_pressures[region]) ** 2 / 2, region
            )
            for region, law in self._laws.items()
        )
        self._content_form, self._content_form_before = (
            fem.form(self._vertex_content(moment, baths))
            for moment, baths in (
                (now, self._bath_pressures),
                (body.before, self._bath_pressures_before),
            )
        )
        self._vector = compat.create_vector(self._content_form, body.unknowns.space)
        self._step_start_content = self._stage_start_content = self._stage_end_content = np.zeros(
            body.unknowns.owned_count
        )  # int zeta of each vertex's function

    def _displacement_gradient(self, region: Region, moment: TimeLevel) -> Expr:
        return self.body.scene.physics.domain.kinematics.displacement_gradient(
            moment.fields["u"], self.body.X
        )

    def _vertex_content(self, moment: TimeLevel, baths: dict[Region, fem.Constant]) -> ufl.Form:
        """int zeta of each vertex's function [length^3], a UFL form."""
        test = self.body.unknowns.split_fields(self.body.now.test)[FIELD_NAME]
        form = 0
        for region in self._laws:
            form += self.body.region_integral(
                self._fluid_content(region, moment, baths) * test, region
            )
        return form

    def _fluid_content(
        self, region: Region, moment: TimeLevel, baths: dict[Region, fem.Constant]
    ) -> Expr:
        return self._laws[region].fluid_content(
            self._displacement_gradient(region, moment), moment.fields[FIELD_NAME] + baths[region]
        )

    def potential(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """The share of a stage in the potential, but for p zeta*."""
        form = 0
        pressure_gradient = self.body.scene.physics.domain.kinematics.space_vector(
            ufl.grad(now.fields[FIELD_NAME])
        )
        for region, law in self._laws.items():
            H = self._displacement_gradient(region, now)
            p = now.fields[FIELD_NAME] + self._bath_pressures[region]
            flux = ufl.dot(
                law.nominal_permeability(self._displacement_gradient(region, before)),
                pressure_gradient,
            )
            density = (
                -law.flow.alpha * p * law.volume_growth(H)
                - law.flow.storage * p**2 / 2
                - dt / 2 * ufl.dot(pressure_gradient, flux)
            )
            form += self.body.region_integral(density, region)
        return form

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Its slope along now.test, a UFL form."""
        return ufl.derivative(self.potential(now, before, dt), now.function, now.test)

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the content that the stage sets out from to the rows of p."""
        b.array[:] += self._stage_start_content

    def begin_stage(self, stage: Stage) -> None:
        """Set out from the content of the last accepted state, and beyond it by what the first
        stage has changed.
        """
        self._update_bath_pressures(self._bath_pressures, self.body.now)
        if not stage.extrapolation_factor:
            self._update_bath_pressures(self._bath_pressures_before, self.body.before)
            self._step_start_content = self._stage_end_content = self._assemble(
                self._content_form_before
            )
        self._stage_start_content = self._step_start_content + stage.extrapolation_factor * (
            self._stage_end_content - self._step_start_content
        )

    def _update_bath_pressures(self, baths: dict[Region, fem.Constant], moment: TimeLevel) -> None:
        for region, bath in baths.items():
            bath.value = self.body.scene.physics.bath_pressure(region, float(moment.t.value))

    def end_stage(self, stage: Stage) -> None:
        """Keep the content of the stage's equilibrium."""
        self._stage_end_content = self._assemble(self._content_form)

    def _assemble(self, form: fem.Form) -> np.ndarray:
        with self._vector.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._vector, form)
        self._vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return np.array(self._vector.array_r)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """p (facets, points) at reference-facet points of the contact surface [pressure], from the
        bath's.
        """
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        nodes = facet_nodes(self.body.mesh, space, self.body.body_mesh.surfaces["top"])
        return (
            self.body.local_array()[self.body.unknowns.dofs(FIELD_NAME)[nodes]]
            @ barycentric(points).T
        )

    def largest_pressure(self) -> float:
        """The largest pressure [pressure] of this rank's vertices, from the bath's (collective).

        Where a film beside a drained face is thinner than the elements, p goes to and fro beside
        it: it is p (1 - (-0.268)^k) at the k-th vertex inside, 1.27 times what is right at the
        first. The mean F p of a vertex, weighted by its function, is right there, and 2 F p - F F p
        as well but for 1.1 at the first, while it differs from a smooth p by the fourth power of
        the elements alone.
        """
        mass, areas = self._vertex_mass
        p = mass.createVecRight()
        p.array[:] = self.body.local_array()[self.body.unknowns.dofs(FIELD_NAME)[: len(p.array)]]
        mean_pressure = mass * p
        mean_pressure.pointwiseDivide(mean_pressure, areas)
        mean_of_mean = mass * mean_pressure
        mean_of_mean.pointwiseDivide(mean_of_mean, areas)
        smoothed_pressure = 2 * mean_pressure.array_r - mean_of_mean.array_r
        for vector in (p, mean_pressure, mean_of_mean):
            vector.destroy()
        return float(np.max(smoothed_pressure[self._is_permeable], initial=-np.inf))

    @cached_property
    def _vertex_mass(self) -> tuple[PETSc.Mat, PETSc.Vec]:
        """The integrals of two vertices' functions, and of one; 1 at vertices outside of all
        permeable regions.
        """
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        product = ufl.TestFunction(space) * ufl.TrialFunction(space)
        mass = fem_petsc.assemble_matrix(
            fem.form(sum(self.body.region_integral(product, region) for region in self._laws))
        )
        mass.assemble()
        ones = mass.createVecRight()
        ones.set(1.0)
        row_sums = mass * ones
        self._is_permeable = row_sums.array_r > 0
        row_sums.array[:] = np.where(self._is_permeable, row_sums.array_r, 1.0)
        return mass, row_sums

    def corner_pressures(self) -> np.ndarray:
        """p (cells, corners) of this rank's cells [pressure], from the bath's."""
        dofs = compat.cell_dofs(self.body.unknowns.collapsed_space(FIELD_NAME).dofmap)
        return self.body.local_array()[self.body.unknowns.dofs(FIELD_NAME)[dofs]]

    def content_in(self, region: Region) -> Expr:
        """zeta [1] of a region, a UFL scalar; 0 without pores."""
        return (
            self._fluid_content(region, self.body.now, self._bath_pressures)
            if region in self._laws
            else ufl.as_ufl(0.0)
        )

    def pressure_in(self, region: Region) -> Expr:
        """alpha (p + p_b) [pressure], which the total stress has less than the drained law's; 0
        without pores.
        """
        if region not in self._laws:
            return ufl.as_ufl(0.0)
        return self._laws[region].flow.alpha * (
            self.body.now.fields[FIELD_NAME] + self._bath_pressures[region]
        )

    def vertex_content_values(self) -> np.ndarray:
        """Fluid at this rank's vertices beyond that at rest in a bath without pressure [length^3]."""
        return self._assemble(self._content_form)


class ContactSeal(Term):
    """The surface of a body with fluid: a conductance at each vertex, which the tip changes where
    it touches.
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
        self.depends_on_contact = drainage.surface != drainage.tip
        self._in_contact = fem.Function(space)  # 1 where the last accepted state touches the tip
        self._total_outflow = fem.Function(
            space
        )  # what has flowed out at each vertex since rest [length^3]
        self.history = (self._in_contact, self._total_outflow)
        self._is_touching = np.zeros(len(top), dtype=bool)
        self._visited_contacts = set[bytes]()
        self._step_outflow = np.zeros(
            self._owned_count
        )  # in the step to the present state [length^3]
        self.is_frozen = self._is_tried = False
        self._extrapolation_factor = 0.0
        self._was_touching = self._is_touching
        self._step_outflow_before = self._step_outflow
        self.tangent_version = 0

    def _vertex_conductances(self) -> np.ndarray:
        """int k |grad|^2 of each vertex's function [length^3/(pressure time)]."""
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
        matrix = fem_petsc.assemble_matrix(fem.form(sum(forms)))
        matrix.assemble()
        diagonal = np.zeros(len(self._pressure_dofs))
        diagonal[: self._owned_count] = matrix.getDiagonal().array_r
        matrix.destroy()
        return diagonal

    def _surface_conductance(self, surface: str, boundary: str | Conductance) -> np.ndarray:
        """The conductance of a surface at each vertex [length^3/(pressure time)]."""
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        if isinstance(boundary, Conductance):
            area = fem_petsc.assemble_vector(
                fem.form(self.body.surface_integral(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            conductance = np.zeros(len(self._pressure_dofs))
            conductance[: self._owned_count] = boundary.conductance * area.array_r
            return np.where(
                self._open_conductance > 0, conductance, 0.0
            )  # beside what is not permeable nothing flows
        nodes = facet_nodes(self.body.mesh, space, self._surface_facets(surface))
        facet_counts = sum_nodal_contributions(
            self.body.x, self._pressure_dofs[nodes], np.ones(nodes.shape)
        )[self._pressure_dofs]
        return np.where((facet_counts > 0) & (boundary == "drained"), self._open_conductance, 0.0)

    def _surface_facets(self, surface: str) -> np.ndarray:
        return self.body.body_mesh.surfaces.get(surface, np.empty(0, dtype=np.int32))

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> None:
        """None: a vertex is no form."""

    @property
    def _conductance(self) -> np.ndarray:
        return np.where(self._is_touching, self._contact_conductance, self._free_conductance)[
            : self._owned_count
        ]

    @property
    def _outflow_rate(self) -> np.ndarray:
        """g_i p_i of this rank's own vertices [length^3/time]."""
        return self._conductance * self.body.local_array()[self._pressure_dofs[: self._owned_count]]

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add -dt g_i p_i, but for what is taken back."""
        b.array[self._pressure_dofs[: self._owned_count]] -= (
            float(self.body.dt.value) * self._outflow_rate - self._retracted_outflow
        )

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add -dt g_i."""
        values = self._conductance
        dt = float(self.body.dt.value)
        for i in np.flatnonzero(values):
            row = self._pressure_dofs[i : i + 1].astype(np.int32)
            A.setValuesLocal(row, row, np.array([-dt * values[i]]), addv=PETSc.InsertMode.ADD)

    @property
    def _retracted_outflow(self) -> np.ndarray:
        """What of the outflow of the first stage the second one extrapolates, at this rank's own
        vertices that the tip has closed in between: there it did not go on [length^3].
        """
        closed = (self._is_touching & ~self._was_touching)[: self._owned_count]
        return np.where(
            closed,
            (self._extrapolation_factor - CLOSING_STEP_FRACTION) * self._step_outflow_before,
            0.0,
        )

    def freeze(self) -> None:
        """From here on all stages of a step, and all tries of it, have one contact: that of the
        last accepted state until `look` is told another.
        """
        self.is_frozen = True

    def begin_stage(self, stage: Stage) -> None:
        """A step begins with the contact of the last accepted state."""
        self._extrapolation_factor = stage.extrapolation_factor
        self._was_touching = self._is_touching
        self._step_outflow_before = self._step_outflow
        if not stage.extrapolation_factor:
            self._was_touching = np.ones_like(self._is_touching)
            self._step_outflow_before = 0.0 * self._step_outflow
        if self._is_tried:
            return
        if not stage.extrapolation_factor:
            self._set_contact(self._in_contact.x.array > 0.5)
        self._visited_contacts = {self._is_touching.tobytes()}
        self._is_tried = self.is_frozen

    def update_contact(self, touching: np.ndarray) -> bool:
        """Take the corners (facets, corners) of the contact surface that touch the tip now; whether
        another equilibrium is to be found (collective). Not where they come back to what they
        were in this stage: then two sets exclude each other, by an element at the edge, and
        either will do.
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
        """Count what leaves: of the first of two stages by its share in the step."""
        self._step_outflow = (
            stage.extrapolation_factor * self._step_outflow_before
            + stage.dt * self._outflow_rate
            - self._retracted_outflow
        )

    def accept(self) -> None:
        """The step is done: what has left and what touches is remembered."""
        self._total_outflow.x.array[: self._owned_count] += self._step_outflow
        self._in_contact.x.array[:] = self._is_touching
        self._is_tried = False

    def drained_surface_table(self) -> np.ndarray:
        """What drained faces hold back while nothing flows: the table (vertices, 2) of all ranks,
        in one order, of the height of the elements at each vertex [length], and of p^2 times its
        area [pressure^2 length^2] of the part that is modelled (collective). A vertex that lets
        out less than its own cells let through holds no pressure at the face, and has no area.
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
                fem.form(body.surface_integral(surface, ufl.TestFunction(space)))
            )
            area.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            areas[: self._owned_count] += area.array_r
            area.destroy()
            nodes = facet_nodes(body.mesh, space, facets)
            cell_heights_at_nodes = np.repeat(
                cell_heights(body.mesh, facets)[:, None], nodes.shape[1], axis=1
            )
            heights += sum_nodal_contributions(
                body.x, self._pressure_dofs[nodes], cell_heights_at_nodes
            )[self._pressure_dofs] / np.maximum(
                sum_nodal_contributions(body.x, self._pressure_dofs[nodes], np.ones(nodes.shape))[
                    self._pressure_dofs
                ],
                1.0,
            )
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
        """What has left the body since rest [length^3], this rank's share."""
        is_mid_step = float(self.body.now.t.value) != float(self.body.before.t.value)
        return float(
            self._total_outflow.x.array[: self._owned_count].sum()
            + is_mid_step * self._step_outflow.sum()
        )
