"""The discrete body: unknown fields on a mesh, their constraints, and integrals over the body."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe.constraints import (
    find_support_shares,
    owned_dofs,
    support_and_pin_dofs,
    zero_bc,
)
from indent_sim.fe.facet_values import facet_nodes
from indent_sim.fe.measured_constants import VOLUME_DEGREE
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.quadrature import QUADRATURE_DEGREE
from indent_sim.fe.surface import Trace
from indent_sim.fe.unknowns import DISPLACEMENT_ORDER, Field, TimeLevel, Unknowns
from indent_sim.mesh.model_domain import Region
from indent_sim.scene.scene import Scene


class Body:
    """Unknown fields of a scene's body on a mesh, with their constraints and integral measures.

    Parameters
    ----------
    scene : Scene
        The scene.
    body_mesh : BodyMesh
        Distributed mesh of the model domain.
    additional_fields : sequence of Field
        Fields that the terms of the virtual work need in addition to the displacement.

    Attributes
    ----------
    now, before : TimeLevel
        Current and accepted state.
    dt : fem.Constant
        Length of the current stage [time].
    trace, noncontact_trace : Trace
        Facets of the contact surface, and of the rest of the free surface.
    bcs : list of fem.DirichletBC
        Constraints of the solution.
    support_dofs, pin_dofs, constrained_dofs : ndarray of int
        Owned dofs constrained by supports and pins, by pins alone, and by any constraint.
    support_shares : dict
        Dofs and shares of each support, see `find_support_shares`.
    slide, accepted_slide : float
        Current and accepted horizontal displacement of the tip from where it was pressed in
        [length].
    active_dof_count : int
        Number of dofs on all ranks, not counting constrained dofs of the additional fields.
    """

    def __init__(self, scene: Scene, body_mesh: BodyMesh, additional_fields: Sequence[Field] = ()):
        self.scene = scene
        self.body_mesh = body_mesh
        self.mesh = body_mesh.mesh
        self.comm = body_mesh.comm
        self.unknowns = Unknowns(
            self.mesh,
            [Field("u", DISPLACEMENT_ORDER, axes=tuple(range(body_mesh.dim))), *additional_fields],
        )
        self.x = self.unknowns.x
        self.X = ufl.SpatialCoordinate(self.mesh)
        self.weight = scene.physics.domain.kinematics.integration_weight(self.X)
        self.dt = fem.Constant(self.mesh, 0.0)
        self.slide = 0.0
        self.accepted_slide = 0.0
        self.now = self._create_time_level(self.unknowns.solution)
        self._before: TimeLevel | None = None
        self.trace, self.noncontact_trace = map(
            self._create_trace, (body_mesh.surfaces["top"], body_mesh.noncontact_facets)
        )
        self._create_tags()
        self._constrain_all_fields()

    def _create_time_level(self, function: fem.Function) -> TimeLevel:
        space = self.unknowns.space
        depth = fem.Constant(self.mesh, 0.0)
        t = fem.Constant(self.mesh, 0.0)
        center = [fem.Constant(self.mesh, float(c)) for c in self.scene.physics.center]
        arguments = ufl.TestFunction(space), ufl.TrialFunction(space)
        fields = self.unknowns.split_fields(function)
        return TimeLevel(function, fields, depth, t, center, *arguments)

    @property
    def before(self) -> TimeLevel:
        """Accepted state of the body.

        It is created on first use, because few terms need it.
        """
        self._before = self._before or self._create_time_level(fem.Function(self.unknowns.space))
        return self._before

    @property
    def accepted_depth(self) -> float:
        """Accepted depth [length]; the current depth if no term uses `before`."""
        return float((self._before or self.now).delta.value)

    def slide_tip(self, slide: float) -> None:
        """Set the horizontal displacement of the tip since it was pressed in."""
        self.slide = slide
        for constant, c in zip(
            self.now.center, self.scene.physics.track.position(slide), strict=True
        ):
            constant.value = c

    def begin_stage(self, stage_dt: float, elapsed: float) -> None:
        """Set the time step and the time of a stage.

        Parameters
        ----------
        stage_dt : float
            Length of the stage [time].
        elapsed : float
            Time from the accepted state to the end of the stage [time].
        """
        self.dt.value = stage_dt
        self.now.t.value = float((self._before or self.now).t.value) + elapsed

    def accept(self) -> None:
        """Make the current state the accepted state."""
        self.accepted_slide = self.slide
        if self._before:
            self._before.function.x.array[:] = self.now.function.x.array
            self._before.delta.value = self.now.delta.value
            self._before.t.value = self.now.t.value
            for before, now in zip(self._before.center, self.now.center, strict=True):
                before.value = now.value

    def _create_tags(self) -> None:
        regions = self.body_mesh.regions.astype(np.int32)
        cells = np.arange(len(regions), dtype=np.int32)
        self._cell_tags = dolfinx_mesh.meshtags(self.mesh, self.body_mesh.dim, cells, regions)
        # Tags are part of the compiled kernels. "top" and "r_max" always have the tags 1 and 2, so
        # that bodies with different other surfaces share kernels
        names = dict.fromkeys(["top", "r_max", *sorted(self.body_mesh.surfaces)])
        self._tags = {name: tag for tag, name in enumerate(names, start=1)}
        facets_by_name = [
            self.body_mesh.surfaces.get(name, np.empty(0, dtype=np.int32)) for name in names
        ]
        facets = np.concatenate(facets_by_name)
        order = np.argsort(np.concatenate(facets_by_name))
        tags = np.repeat(
            np.arange(1, len(facets_by_name) + 1, dtype=np.int32),
            [len(part) for part in facets_by_name],
        )
        self._facet_tags = dolfinx_mesh.meshtags(
            self.mesh, self.body_mesh.dim - 1, facets[order], tags[order]
        )

    def region_integral(self, density: Expr, region: Region) -> ufl.Form:
        """UFL form of the integral of a density over a region, times 2 pi r if axisymmetric."""
        return density * self.weight * self.region_measure(region)

    def region_measure(self, region: Region) -> ufl.Measure:
        """UFL measure of a region of the mesh, without the weight of axisymmetry."""
        metadata = {"quadrature_degree": VOLUME_DEGREE[self.body_mesh.dim]}
        regions = self.scene.physics.domain.regions
        if len(regions) == 1:
            return ufl.dx(domain=self.mesh, metadata=metadata)
        return ufl.dx(
            regions.index(region),
            domain=self.mesh,
            subdomain_data=self._cell_tags,
            metadata=metadata,
        )

    def field_domain_integral(self, field: Field, density: Expr) -> ufl.Form:
        """UFL form of the integral of a density over the domain of a field."""
        if isinstance(field.domain, str):
            return self.surface_integral(field.domain, density)
        return reduce(add, (self.region_integral(density, region) for region in field.domain))

    def contact_integral(self, integrand: Expr) -> ufl.Form:
        """UFL form of the integral of an expression over the contact surface."""
        return self.surface_integral("top", integrand, QUADRATURE_DEGREE[self.body_mesh.dim])

    def surface_integral(
        self, name: str, integrand: Expr, degree: int = 2 * DISPLACEMENT_ORDER
    ) -> ufl.Form:
        """UFL form of the integral over a named surface, with a quadrature of a given degree."""
        metadata = {"quadrature_degree": degree}
        measure = ufl.ds(
            self._tags[name], domain=self.mesh, subdomain_data=self._facet_tags, metadata=metadata
        )
        return integrand * self.weight * measure

    def surface_trace(self, name: str) -> Trace:
        """Return the trace of a named surface."""
        return self._create_trace(self.body_mesh.surfaces[name])

    def _create_trace(self, facets: np.ndarray) -> Trace:
        space = self.unknowns.collapsed_space("u")
        nodes = facet_nodes(self.mesh, space, facets)
        X = space.tabulate_dof_coordinates()[:, : self.body_mesh.dim][nodes]
        return Trace(nodes, X, self.unknowns.displacement_dofs(nodes))

    def _constrain_all_fields(self) -> None:
        unknowns = self.unknowns
        body_mesh = self.body_mesh
        displacement = unknowns.subspace("u")
        support_dofs, pin_dofs = support_and_pin_dofs(displacement, body_mesh)
        self.bcs = [zero_bc(displacement.sub(c), dofs) for c, dofs in support_dofs + pin_dofs]
        self.support_dofs = owned_dofs(
            [dofs for _, dofs in support_dofs + pin_dofs], unknowns.owned_count
        )
        self.support_shares = find_support_shares(
            self.scene.physics.domain, unknowns.owned_count, support_dofs
        )
        self.pin_dofs = owned_dofs([dofs for _, dofs in pin_dofs], unknowns.owned_count)
        self.constrained_dofs = self.support_dofs
        self.active_dof_count = unknowns.total_count
        self._prescribed_values: list[tuple[np.ndarray, float]] = []
        for field in unknowns.fields_by_name.values():
            self._constrain_outside_domain(field)
            if field.name != "u":
                self._constrain_at_supports(field)

    def _constrain_outside_domain(self, field: Field) -> None:
        """Constrain a field to zero outside of its domain."""
        if field.domain in ("", self.scene.physics.domain.regions):
            return
        if isinstance(field.domain, str):
            dim = self.body_mesh.dim - 1
            entities = self.body_mesh.surfaces[field.domain]
        else:
            numbers = [self.scene.physics.domain.regions.index(region) for region in field.domain]
            dim = self.body_mesh.dim
            entities = np.flatnonzero(np.isin(self.body_mesh.regions, numbers)).astype(np.int32)
        dofs = self.unknowns.dofs_on(field.name, None, dim, entities)
        for component, component_dofs in self.unknowns.component_dofs(field.name).items():
            self.constrain_dofs(field.name, component, np.setdiff1d(component_dofs, dofs))

    def _constrain_at_supports(self, field: Field) -> None:
        """Set components of a field to zero where the same component of u is constrained.

        At these dofs the component does no work, and would otherwise be undetermined.
        """
        dim = self.body_mesh.dim - 1
        surfaces = self.body_mesh.surfaces
        for component, surface in self.body_mesh.part.constrained_components:
            if component in field.axes:
                field_component = component if len(field.axes) > 1 else None
                self.constrain_dofs(
                    field.name,
                    field_component,
                    self.unknowns.dofs_on(field.name, field_component, dim, surfaces[surface]),
                )

    def constrain_dofs(
        self, name: str, component: int | None, dofs: np.ndarray, value: float = 0.0
    ) -> None:
        """Prescribe a value at local dofs of a field or of one of its components (collective)."""
        self.bcs.append(zero_bc(self.unknowns.subspace(name, component), dofs))
        new_dofs = np.setdiff1d(dofs[dofs < self.unknowns.owned_count], self.constrained_dofs)
        self.constrained_dofs = np.union1d(self.constrained_dofs, new_dofs)
        self.active_dof_count -= self.comm.allreduce(len(new_dofs), op=MPI.SUM)
        if value:
            self._prescribed_values.append((dofs, value))

    def apply_prescribed_values(self) -> None:
        """Write non-zero prescribed values into the solution; Newton steps leave them unchanged."""
        for dofs, value in self._prescribed_values:
            self.local_array()[dofs] = value

    def set_solution(self, x: PETSc.Vec) -> None:
        """Copy a vector into the solution, and update its ghosts."""
        x.copy(self.x)
        self.x.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def local_array(self) -> np.ndarray:
        """Local array of the solution, with ghosts."""
        return self.unknowns.solution.x.array

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim) of the nodes of the contact facets [length]."""
        return self.local_array()[self.trace.dofs]
