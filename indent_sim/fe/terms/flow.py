"""Poroelasticity: Biot's equations of the pore fluid, in addition to the drained strain energy.

The pore pressure p [pressure] is relative to the bath pressure p_b: p > 0 drives fluid out. With
the volume growth e (tr eps, at finite strain J - 1) and the fluid content zeta = alpha e + storage
(p + p_b) per undeformed volume, a stage of length dt that starts from the content zeta* adds

    int [ -alpha (p + p_b) e - storage (p + p_b)^2/2 + p zeta* - dt/2 grad p . m grad p ] dV
    - dt/2 sum_i g_i p_i^2

to the potential. Its derivatives with respect to u and p are equilibrium and the fluid balance,
zeta - zeta* = dt div(m grad p). m is the mobility (at finite strain that at the beginning of the
step) and g_i the conductance of the surface at vertex i, where the outflow is g_i p_i
[length^3/time]; see `contact_seal`. zeta* enters through its integrals with the shape functions of
the vertices, so that content and outflow balance to round-off. If no time passes there is no flow,
and the body is undrained.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.facet_values import facet_nodes
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.shape_functions import barycentric
from indent_sim.fe.symbolic_constants import symbolic_copy
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.time_integration import Stage
from indent_sim.fe.unknowns import Field, TimeLevel
from indent_sim.mesh.model_domain import Region
from indent_sim.scene.scene import Scene

FIELD_NAME = "pore"


def fields(scene: Scene) -> list[Field]:
    """Return the field of the pore pressure p, continuous over all permeable regions.

    The residual of p is a fluid volume; it is weighted with the largest Young's modulus.
    """
    regions = scene.physics.permeable_regions
    if not regions:
        return []
    stiffest_E = max(region.material.constants.E for region in scene.physics.domain.regions)
    return [Field(FIELD_NAME, 1, domain=regions, weight=stiffest_E)]


class Flow(Term):
    """Pore fluid: pore pressure in the total stress, fluid content and flow."""

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
            compile_form(self._vertex_content(level, baths))
            for level, baths in (
                (now, self._bath_pressures),
                (body.before, self._bath_pressures_before),
            )
        )
        self._vector = compat.create_vector(self._content_form, body.unknowns.space)
        # Integrals of zeta with the shape function of each owned dof of p [length^3]
        self._step_start_content = self._stage_start_content = self._stage_end_content = np.zeros(
            body.unknowns.owned_count
        )

    def _displacement_gradient(self, region: Region, level: TimeLevel) -> Expr:
        return self.body.scene.physics.domain.kinematics.displacement_gradient(
            level.fields["u"], self.body.X
        )

    def _vertex_content(self, level: TimeLevel, baths: dict[Region, fem.Constant]) -> ufl.Form:
        """Integrals of zeta with the shape functions of the vertices [length^3], a UFL form."""
        test = self.body.unknowns.split_fields(self.body.now.test)[FIELD_NAME]
        form = 0
        for region in self._laws:
            form += self.body.region_integral(
                self._fluid_content(region, level, baths) * test, region
            )
        return form

    def _fluid_content(
        self, region: Region, level: TimeLevel, baths: dict[Region, fem.Constant]
    ) -> Expr:
        return self._laws[region].fluid_content(
            self._displacement_gradient(region, level), level.fields[FIELD_NAME] + baths[region]
        )

    def potential(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Return the potential of a stage as a UFL form, without the fluid content at its start."""
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
        """Derivative of the potential along `now.test`, a UFL form."""
        return ufl.derivative(self.potential(now, before, dt), now.function, now.test)

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the fluid content zeta* at the start of the stage to the rows of p."""
        b.array[:] += self._stage_start_content

    def begin_stage(self, stage: Stage) -> None:
        """Compute the content zeta* from which the stage starts.

        In the first stage, zeta* is the content of the accepted state; in the second stage of
        SDIRK2 it is extrapolated from the change in the first stage.
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

    def _update_bath_pressures(self, baths: dict[Region, fem.Constant], level: TimeLevel) -> None:
        for region, bath in baths.items():
            bath.value = self.body.scene.physics.bath_pressure(region, float(level.t.value))

    def end_stage(self, stage: Stage) -> None:
        """Store the fluid content at the end of the stage."""
        self._stage_end_content = self._assemble(self._content_form)

    def _assemble(self, form: fem.Form) -> np.ndarray:
        with self._vector.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(self._vector, form)
        self._vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return np.array(self._vector.array_r)

    def pressure_at(self, points: np.ndarray) -> np.ndarray:
        """Pore pressure p (facets, points) on the contact surface, relative to the bath [pressure].

        Parameters
        ----------
        points : ndarray, (points, facet dim)
            Points of the reference facet.
        """
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        nodes = facet_nodes(self.body.mesh, space, self.body.body_mesh.surfaces["top"])
        return (
            self.body.local_array()[self.body.unknowns.dofs(FIELD_NAME)[nodes]]
            @ barycentric(points).T
        )

    def largest_pressure(self) -> float:
        """Largest pore pressure of this rank's vertices, relative to the bath (collective).

        If the boundary layer at a drained face is thinner than the elements, the discrete pressure
        oscillates: at the k-th vertex below the face it is p (1 - (-0.268)^k), which is 1.27 times
        the exact value at the first one. The filtered pressure F p is the mean of p weighted with
        the shape function of a vertex, and is exact at the first vertex. The largest value of 2 F p
        - F F p is returned, which is 1.1 times the exact value at the first vertex and has an error
        of fourth order in the element size for smooth p.
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
        """Mass matrix of the pressure shape functions, and the row sums of this matrix.

        The row sums are set to 1 at vertices outside of all permeable regions.
        """
        space = self.body.unknowns.collapsed_space(FIELD_NAME)
        product = ufl.TestFunction(space) * ufl.TrialFunction(space)
        mass = fem_petsc.assemble_matrix(
            compile_form(sum(self.body.region_integral(product, region) for region in self._laws))
        )
        mass.assemble()
        ones = mass.createVecRight()
        ones.set(1.0)
        row_sums = mass * ones
        self._is_permeable = row_sums.array_r > 0
        row_sums.array[:] = np.where(self._is_permeable, row_sums.array_r, 1.0)
        return mass, row_sums

    def corner_pressures(self) -> np.ndarray:
        """Pore pressure (cells, corners) of this rank's cells, relative to the bath [pressure]."""
        dofs = compat.cell_dofs(self.body.unknowns.collapsed_space(FIELD_NAME).dofmap)
        return self.body.local_array()[self.body.unknowns.dofs(FIELD_NAME)[dofs]]

    def content_in(self, region: Region) -> Expr:
        """Fluid content zeta per undeformed volume of a region, a UFL scalar; 0 without fluid."""
        return (
            self._fluid_content(region, self.body.now, self._bath_pressures)
            if region in self._laws
            else ufl.as_ufl(0.0)
        )

    def pressure_in(self, region: Region) -> Expr:
        """Pore pressure term alpha (p + p_b) of the total stress [pressure]; 0 without pores.

        The total stress is the stress of the drained law minus this term times the identity.
        """
        if region not in self._laws:
            return ufl.as_ufl(0.0)
        return self._laws[region].flow.alpha * (
            self.body.now.fields[FIELD_NAME] + self._bath_pressures[region]
        )

    def vertex_content_values(self) -> np.ndarray:
        """Fluid content of this rank's vertices relative to rest at p + p_b = 0 [length^3]."""
        return self._assemble(self._content_form)
