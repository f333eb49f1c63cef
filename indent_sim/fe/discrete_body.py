"""The body: unknown fields, how they are held, the measures of its volume and surfaces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import chain
from operator import add
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI
from petsc4py import PETSc
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.surface import QUADRATURE_DEGREE, Trace, facet_nodes
from indent_sim.mesh.model_domain import Region
from indent_sim.mesh.reactions import SurfaceComponent
from indent_sim.scene.scene import Scene

ConstrainedDofs = list[tuple[int, np.ndarray]]  # component and local dofs
DISPLACEMENT_ORDER = 2  # of the displacement
# Of the quadrature of the volume, by dimension. In three dimensions four points a cell, exact for
# the strain energy of linear bodies; in hyperelastic ones they change the force by a thirtieth of
# what the mesh does (test_hyperelastic.py), and 14 points cost three times as much. In two the
# weight r, and u_r/r, ask for more.
VOLUME_DEGREE = {2: 4, 3: 2}


@dataclass(frozen=True)
class Field:
    """An unknown field: continuous piecewise polynomials of an order.

    along: the axes of its components, none of a scalar; where such a component of the displacement
    is held, the field's is too. where: the regions, or the surface, that it lives on; all of the
    body where empty. weight: the factor that turns its rows into forces, by which residuals are
    measured.
    """

    name: str
    order: int
    axes: tuple[int, ...] = ()
    domain: tuple[Region, ...] | str = ""
    weight: float = 1.0


@dataclass(frozen=True)
class TimeLevel:
    """The unknowns at one time: the function that holds them, its fields as UFL expressions, the
    tip's depth [length] and the time [time]; test and trial are the variations of the virtual
    work and of its derivative.
    """

    function: fem.Function
    fields: Mapping[str, Expr]
    delta: fem.Constant
    t: fem.Constant
    test: Expr = None
    trial: Expr = None


class Unknowns:
    """Space, solution and dof numbering of fields, held at zero off what they live on; the first
    one is u.
    """

    def __init__(self, mesh: dolfinx_mesh.Mesh, fields: Sequence[Field]):
        self.fields_by_name = {field.name: field for field in fields}
        self.names = tuple(self.fields_by_name)
        self.dim = mesh.geometry.dim
        elements = [
            compat.lagrange_element(self.dim, field.order, len(field.axes)) for field in fields
        ]
        self.space = compat.function_space(
            mesh, elements[0] if len(elements) == 1 else compat.mixed_element(*elements)
        )
        self.solution = fem.Function(self.space)
        self.x = compat.petsc_vector(self.solution)
        rows = self.space.dofmap.index_map
        width = self.space.dofmap.index_map_bs
        # number of dofs that this rank owns, which come first in its local array, and of those on
        # all ranks
        self.owned_count = rows.size_local * width
        self.total_count = rows.size_global * width

    def split_fields(self, function: Expr) -> dict[str, Expr]:
        """The fields of any function of the space, by their names."""
        parts = (function,) if len(self.names) == 1 else ufl.split(function)
        return dict(zip(self.names, parts, strict=True))

    def variation(self, name: str, argument: Expr) -> Expr:
        """A test or trial function of one field alone as a variation of the whole solution."""
        if len(self.names) == 1:
            return argument
        components_of_fields = {
            field.name: [0.0] * max(len(field.axes), 1) for field in self.fields_by_name.values()
        }
        components_of_fields[name] = (
            [argument[k] for k in range(len(components_of_fields[name]))]
            if argument.ufl_shape
            else [argument]
        )
        return ufl.as_vector(list(chain.from_iterable(components_of_fields.values())))

    def subspace(self, name: str, component: int | None = None) -> fem.FunctionSpace:
        """The part of the space that holds a field, or one component of it."""
        space = self.space if len(self.names) == 1 else self.space.sub(self.names.index(name))
        return space if component is None else space.sub(component)

    @cached_property
    def _collapsed_spaces(self) -> dict[str, tuple[fem.FunctionSpace, np.ndarray]]:
        """For each field a space of its own, and the place of its dofs in the solution's local
        array.
        """
        if len(self.names) == 1:
            return {"u": (self.space, np.arange(len(self.solution.x.array)))}
        collapsed = {name: self.subspace(name).collapse() for name in self.names}
        return {name: (space, np.asarray(places)) for name, (space, places) in collapsed.items()}

    def collapsed_space(self, name: str) -> fem.FunctionSpace:
        """A space of the field alone."""
        return self._collapsed_spaces[name][0]

    def dofs(self, name: str) -> np.ndarray:
        """Where the dofs of the field's own space stand in the solution's local array."""
        return self._collapsed_spaces[name][1]

    def component_dofs(self, name: str) -> dict[int | None, np.ndarray]:
        """`dofs` of each component of the field, None for that of a scalar."""
        dofs = self.dofs(name)
        size = len(self.fields_by_name[name].axes)
        return {c: dofs[c::size] for c in range(size)} if size > 1 else {None: dofs}

    def displacement_dofs(self, nodes: np.ndarray) -> np.ndarray:
        """Indices (..., dim) into the local array of the displacement components at nodes of u's
        own space.
        """
        return self.dofs("u")[nodes[..., None] * self.dim + np.arange(self.dim)]

    def dofs_on(
        self, name: str, component: int | None, dim: int, entities: np.ndarray
    ) -> np.ndarray:
        """Local dofs of a field on facets, cells or vertices, of whatever rank they are
        (collective).
        """
        topology = self.space.mesh.topology
        topology.create_connectivity(
            dim, topology.dim
        )  # newer dolfinx wants it for the cells of a region, too
        return fem.locate_dofs_topological(self.subspace(name, component), dim, entities)


def components(expression: Expr) -> list[Expr]:
    """The components of a vector; of a scalar itself."""
    return [expression[k] for k in range(len(expression))] if expression.ufl_shape else [expression]


def support_and_pin_dofs(
    space: fem.FunctionSpace, body_mesh: BodyMesh
) -> tuple[ConstrainedDofs, ConstrainedDofs]:
    """What supports and pins hold at zero in a space of displacements: component and local dofs
    (collective).
    """
    part = body_mesh.part
    dim = body_mesh.dim - 1
    surfaces = body_mesh.surfaces
    supports = [
        (c, fem.locate_dofs_topological(space.sub(c), dim, surfaces[side]))
        for c, side in part.constrained_components
    ]
    pins = [
        (c, fem.locate_dofs_topological(space.sub(c), 0, body_mesh.vertices_at(point)))
        for point, c in part.pins
    ]
    return supports, pins


def zero_bc(space: fem.FunctionSpace, dofs: np.ndarray) -> fem.DirichletBC:
    """Hold dofs of a space: their rows and columns of a tangent are those of the identity."""
    return compat.zero_bc(dofs, space)


def symbolic_copy(item: Any, mesh: dolfinx_mesh.Mesh) -> Any:
    """The same dataclass with every real number a `Constant`: a changed value never recompiles a
    kernel. Whole numbers count something (faces of a pyramid) and decide the formula itself.
    """

    def constant(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(constant, value))
        if dataclasses.is_dataclass(value):
            return symbolic_copy(value, mesh)
        return fem.Constant(mesh, value) if isinstance(value, float) else value

    return dataclasses.replace(
        item, **{f.name: constant(getattr(item, f.name)) for f in dataclasses.fields(item)}
    )


class Body:
    """The unknown fields of a scene's body on a mesh, what is held, and the measures of its volume
    and surfaces.
    """

    def __init__(self, scene: Scene, body_mesh: BodyMesh, additional_fields: Sequence[Field] = ()):
        """beside: the fields that the terms of the virtual work need beside the displacement."""
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
        self.dt = fem.Constant(self.mesh, 0.0)  # of the step's present stage [time]
        self.now = self._create_time_level(self.unknowns.solution)
        self._before: TimeLevel | None = None
        self.trace, self.noncontact_trace = map(
            self._create_trace, (body_mesh.surfaces["top"], body_mesh.noncontact_facets)
        )
        self._create_tags()
        self._constrain_all()

    def _create_time_level(self, function: fem.Function) -> TimeLevel:
        space = self.unknowns.space
        depth = fem.Constant(self.mesh, 0.0)
        t = fem.Constant(self.mesh, 0.0)
        arguments = ufl.TestFunction(space), ufl.TrialFunction(space)
        return TimeLevel(function, self.unknowns.split_fields(function), depth, t, *arguments)

    @property
    def before(self) -> TimeLevel:
        """The last accepted state; made when a term first asks for it, which few do."""
        self._before = self._before or self._create_time_level(fem.Function(self.unknowns.space))
        return self._before

    @property
    def accepted_depth(self) -> float:
        """The depth that was accepted last [length]; the present one where no term asks for the
        state before.
        """
        return float((self._before or self.now).delta.value)

    def begin_stage(self, stage_dt: float, elapsed: float) -> None:
        """Set out on a part of a step: its time, and when it ends after the last accepted state
        [time].
        """
        self.dt.value = stage_dt
        self.now.t.value = float((self._before or self.now).t.value) + elapsed

    def accept(self) -> None:
        """Make the present state the last accepted one."""
        if self._before:
            self._before.function.x.array[:] = self.now.function.x.array
            self._before.delta.value = self.now.delta.value
            self._before.t.value = self.now.t.value

    def _create_tags(self) -> None:
        regions = self.body_mesh.regions.astype(np.int32)
        cells = np.arange(len(regions), dtype=np.int32)
        self._cell_tags = dolfinx_mesh.meshtags(self.mesh, self.body_mesh.dim, cells, regions)
        # tags are in the kernels: 1 and 2 are those of the same surfaces, whatever others a body
        # has
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
        """The integral of a density over a region, as a UFL form; without `weight` over its
        section.
        """
        return density * self.weight * self.region_measure(region)

    def region_measure(self, region: Region) -> ufl.Measure:
        """The measure of a region of the mesh."""
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
        """The integral of a density over what a field lives on, as a UFL form."""
        if isinstance(field.domain, str):
            return self.surface_integral(field.domain, density)
        return reduce(add, (self.region_integral(density, region) for region in field.domain))

    def contact_integral(self, integrand: Expr) -> ufl.Form:
        """The integral of an expression over the contact surface, as a UFL form."""
        return self.surface_integral("top", integrand, QUADRATURE_DEGREE[self.body_mesh.dim])

    def surface_integral(
        self, name: str, integrand: Expr, degree: int = 2 * DISPLACEMENT_ORDER
    ) -> ufl.Form:
        """The integral of an expression over a named surface, as a UFL form."""
        metadata = {"quadrature_degree": degree}
        measure = ufl.ds(
            self._tags[name], domain=self.mesh, subdomain_data=self._facet_tags, metadata=metadata
        )
        return integrand * self.weight * measure

    def _create_trace(self, facets: np.ndarray) -> Trace:
        nodes = facet_nodes(self.mesh, space := self.unknowns.collapsed_space("u"), facets)
        X = space.tabulate_dof_coordinates()[:, : self.body_mesh.dim][nodes]
        return Trace(nodes, X, self.unknowns.displacement_dofs(nodes))

    def _constrain_all(self) -> None:
        unknowns = self.unknowns
        body_mesh = self.body_mesh
        displacement = unknowns.subspace("u")
        support_dofs, pin_dofs = support_and_pin_dofs(displacement, body_mesh)
        self.bcs = [zero_bc(displacement.sub(c), dofs) for c, dofs in support_dofs + pin_dofs]
        self.support_dofs = _owned_dofs(
            [dofs for _, dofs in support_dofs + pin_dofs], unknowns.owned_count
        )
        self.support_shares = self._find_support_shares(support_dofs)
        self.pin_dofs = _owned_dofs([dofs for _, dofs in pin_dofs], unknowns.owned_count)
        self.constrained_dofs = self.support_dofs
        self.active_dof_count = unknowns.total_count
        self._prescribed_values: list[tuple[np.ndarray, float]] = []
        for field in unknowns.fields_by_name.values():
            self._constrain_outside_domain(field)
            if field.name != "u":
                self._constrain_at_supports(field)

    def _find_support_shares(
        self, support_dofs: ConstrainedDofs
    ) -> dict[SurfaceComponent, tuple[np.ndarray, np.ndarray]]:
        """Own dofs that the support of each surface holds along a component, and its share of what
        holds each dof.

        Where two supports hold a node along one axis, as at the edge of a fixed base between fixed
        sides, each has half of its reaction. On a mirror plane, or the axis, everything comes from
        the image beyond it: a support that reaches it has there none along the normal.
        """
        part = self.scene.physics.domain
        owned = self.unknowns.owned_count
        symmetry_surfaces = {"r_min", *part.mirror_planes}
        groups: dict[SurfaceComponent, np.ndarray] = {}
        support_count = np.zeros(owned)  # that hold each dof
        for (component, surface), (_, dofs) in zip(
            part.constrained_components, support_dofs, strict=True
        ):
            groups[surface, component] = dofs[dofs < owned]
            if surface not in symmetry_surfaces:
                support_count[dofs[dofs < owned]] += 1.0
        support_share = 1 / np.maximum(support_count, 1.0)
        for (surface, _), dofs in groups.items():
            if surface in symmetry_surfaces:
                support_share[dofs] = 0.0
        ones = np.ones(owned)
        return {
            (surface, component): (
                dofs,
                (ones if surface in symmetry_surfaces else support_share)[dofs],
            )
            for (surface, component), dofs in groups.items()
        }

    def _constrain_outside_domain(self, field: Field) -> None:
        """A field is held at zero where it does not live, and costs nothing there."""
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
        """A field along an axis is zero where that component of u is held: it does no work there,
        and would be free.
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
        """Hold local dofs of a field, or of one component of it, at a value (collective)."""
        self.bcs.append(zero_bc(self.unknowns.subspace(name, component), dofs))
        owned_dofs = np.setdiff1d(dofs[dofs < self.unknowns.owned_count], self.constrained_dofs)
        self.constrained_dofs = np.union1d(self.constrained_dofs, owned_dofs)
        self.active_dof_count -= self.comm.allreduce(len(owned_dofs), op=MPI.SUM)
        if value:
            self._prescribed_values.append((dofs, value))

    def apply_prescribed_values(self) -> None:
        """Give the dofs that are held at a value other than zero that value; Newton leaves them
        there.
        """
        for dofs, value in self._prescribed_values:
            self.local_array()[dofs] = value

    def set_solution(self, x: PETSc.Vec) -> None:
        """Take a solver's vector as the solution (owned and ghost values)."""
        x.copy(self.x)
        self.x.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def local_array(self) -> np.ndarray:
        """The solution's dofs on this rank, ghosts included."""
        return self.unknowns.solution.x.array

    def nodal_displacement(self) -> np.ndarray:
        """Displacement (facets, nodes, dim) at the nodes of the contact facets [length]."""
        return self.local_array()[self.trace.dofs]


def _owned_dofs(groups: list[np.ndarray], owned: int) -> np.ndarray:
    dofs = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *groups]))
    return dofs[dofs < owned]
