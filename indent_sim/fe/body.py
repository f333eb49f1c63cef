"""The body: unknown fields, how they are held, the measures of its volume and surfaces."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.mesh import BodyMesh
from indent_sim.fe.observe.surface import QUADRATURE_DEGREE, Trace, facet_nodes
from indent_sim.mesh.part import Part, Region
from indent_sim.scene.scene import Scene

ORDER = 2  # of the displacement
# Of the quadrature of the volume, by dimension. In three dimensions four points a cell, exact for the strain energy of
# linear bodies; in hyperelastic ones they change the force by a thirtieth of what the mesh does (test_hyperelastic.py),
# and 14 points cost three times as much. In two the weight r, and u_r/r, ask for more.
DEGREE = {2: 4, 3: 2}
WALL_DEGREE = 2 * ORDER


class Unknowns:
    """Space, solution and dof numbering; `fields` maps the name of each unknown to its UFL expression.

    u has ORDER, the pressures of mixed regions one less, one each because they jump between materials, lam the order
    given by `multiplier`, 0 for none, tau that of u and one component for each horizontal axis, where it is asked for.
    They are on the whole body, but constrained to zero off their region or surface.
    """

    def __init__(self, mesh: Any, *, pressures: Sequence[str], multiplier: int, shear: bool = False):
        dim = mesh.geometry.dim
        elements = {"u": compat.lagrange(dim, ORDER, dim)}
        elements |= {name: compat.lagrange(dim, ORDER - 1) for name in pressures}
        if multiplier:
            elements["lam"] = compat.lagrange(dim, multiplier)
        if shear:
            elements["tau"] = compat.lagrange(dim, ORDER, None if dim == 2 else dim - 1)
        self.names = tuple(elements)
        self.dim = dim
        alone = len(elements) == 1
        element = elements["u"] if alone else compat.mixed(*elements.values())
        self.space = compat.function_space(mesh, element)
        self.solution = fem.Function(self.space)
        self.x = compat.vector(self.solution)
        self.fields = self.of(self.solution)

    def of(self, function: Any) -> dict[str, Any]:
        """The fields of any function of the space, by their names."""
        parts = (function,) if len(self.names) == 1 else ufl.split(function)
        return dict(zip(self.names, parts, strict=True))

    def variation(self, name: str, argument: Any) -> Any:
        """A test or trial function of one field alone as a variation of the whole solution."""
        if len(self.names) == 1:
            return argument
        parts = {field: [0.0] * (self.dim if field == "u" else 1) for field in self.names}
        parts[name] = [argument[k] for k in range(self.dim)] if name == "u" else [argument]
        return ufl.as_vector(list(chain.from_iterable(parts.values())))

    def subspace(self, name: str, component: int | None = None) -> Any:
        """The part of the space that holds a field, or one component of it."""
        space = self.space if len(self.names) == 1 else self.space.sub(self.names.index(name))
        return space if component is None else space.sub(component)

    @cached_property
    def _collapsed(self) -> dict[str, tuple[Any, np.ndarray]]:
        """For each field a space of its own, and the place of its dofs in the solution's local array."""
        if len(self.names) == 1:
            size = len(self.solution.x.array)
            return {"u": (self.space, np.arange(size))}
        found = {name: self.subspace(name).collapse() for name in self.names}
        return {name: (space, np.asarray(places)) for name, (space, places) in found.items()}

    def own_space(self, name: str) -> Any:
        """A space of the field alone."""
        return self._collapsed[name][0]

    def places(self, name: str) -> np.ndarray:
        """Where the dofs of the field's own space stand in the solution's local array."""
        return self._collapsed[name][1]

    def components(self, name: str) -> dict[int | None, np.ndarray]:
        """`places` of each component of the field, None for that of a scalar."""
        size = {"u": self.dim, "tau": self.dim - 1}.get(name, 1)
        places = self.places(name)
        return {c: places[c::size] for c in range(size)} if size > 1 else {None: places}

    def displacement_places(self, nodes: np.ndarray) -> np.ndarray:
        """Indices (..., dim) into the local array of the displacement components at nodes of u's own space."""
        return self.places("u")[nodes[..., None] * self.dim + np.arange(self.dim)]

    @property
    def owned(self) -> int:
        """Number of dofs that this rank owns; they come first in its local array."""
        dofmap = self.space.dofmap
        return dofmap.index_map.size_local * dofmap.index_map_bs

    @property
    def total(self) -> int:
        """Number of dofs on all ranks."""
        dofmap = self.space.dofmap
        return dofmap.index_map.size_global * dofmap.index_map_bs

    def dofs_on(self, name: str, component: int | None, dim: int, entities: np.ndarray) -> np.ndarray:
        """Local dofs of a field on facets, cells or vertices, of whatever rank they are (collective)."""
        topology = self.space.mesh.topology
        topology.create_connectivity(dim, topology.dim)  # newer dolfinx wants it for the cells of a region, too
        return fem.locate_dofs_topological(self.subspace(name, component), dim, entities)


def held_sides(part: Part) -> list[tuple[int, str]]:
    """Each component of the displacement that a support holds, and its surface."""
    sides: list[tuple[int, str]] = []
    for surface, support in part.supports.items():
        normal = part.normal(surface)  # a curved wall has none and is guided weakly
        components = {"fixed": list(range(part.dim)), "roller": [] if normal is None else [normal]}.get(support, [])
        sides += [(c, surface) for c in components]
    return sides


def held(space: Any, body_mesh: BodyMesh) -> tuple[list[tuple[int, np.ndarray]], list[tuple[int, np.ndarray]]]:
    """What supports and pins hold at zero in a space of displacements: component and local dofs (collective)."""
    part, dim, surfaces = body_mesh.part, body_mesh.facet_dim, body_mesh.surfaces
    sides = held_sides(part)
    supports = [(c, fem.locate_dofs_topological(space.sub(c), dim, surfaces[side])) for c, side in sides]
    pins = [(c, fem.locate_dofs_topological(space.sub(c), 0, body_mesh.vertices_at(point))) for point, c in part.pins]
    return supports, pins


def zero(space: Any, dofs: np.ndarray) -> Any:
    """Hold dofs of a space at zero."""
    return fem.dirichletbc(PETSc.ScalarType(0), dofs.astype(np.int32), space)


CONTACT, WALL = 1, 2  # facet tags: the top surface, the curved wall of a cylinder in three dimensions


def symbolic(item: Any, mesh: Any) -> Any:
    """The same dataclass with every real number a `Constant`: a changed value never recompiles a kernel.

    Whole numbers count something (faces of a pyramid) and decide the formula itself.
    """

    def constant(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(constant, value))
        if dataclasses.is_dataclass(value):
            return symbolic(value, mesh)
        return fem.Constant(mesh, value) if isinstance(value, float) else value

    return dataclasses.replace(item, **{f.name: constant(getattr(item, f.name)) for f in dataclasses.fields(item)})


class Body:
    """The unknown fields of a scene's body on a mesh, what is held, and the measures of its volume and surfaces."""

    def __init__(self, scene: Scene, body_mesh: BodyMesh, *, multiplier: int = 0, shear: bool = False):
        self.scene = scene
        self.body_mesh = body_mesh
        self.mesh = body_mesh.mesh
        self.comm = body_mesh.comm
        regions = scene.physics.part.regions
        self.pressures = {region: f"q{k}" for k, region in enumerate(regions) if region.formulation == "mixed"}
        pressures = list(self.pressures.values())
        self.unknowns = Unknowns(self.mesh, pressures=pressures, multiplier=multiplier, shear=shear)
        self.x = self.unknowns.x
        self.X = ufl.SpatialCoordinate(self.mesh)
        self.weight = scene.physics.part.kinematics.weight(self.X)
        self.trace = self._build_trace()
        self._tag_facets()
        self._tag_cells()
        self._constrain()

    def _tag_cells(self) -> None:
        regions = self.body_mesh.regions.astype(np.int32)
        cells = np.arange(len(regions), dtype=np.int32)
        self._cell_tags = dolfinx_mesh.meshtags(self.mesh, self.body_mesh.dim, cells, regions)

    def _tag_facets(self) -> None:
        empty = np.empty(0, dtype=np.int32)
        parts = {tag: self.body_mesh.surfaces.get(name, empty) for tag, name in ((CONTACT, "top"), (WALL, "r_max"))}
        facets = np.concatenate(list(parts.values()))
        tags = np.repeat(np.array(list(parts), dtype=np.int32), [len(part) for part in parts.values()])
        order = np.argsort(facets)
        self._facet_tags = dolfinx_mesh.meshtags(self.mesh, self.body_mesh.facet_dim, facets[order], tags[order])

    def over_region(self, density: Any, region: Region) -> Any:
        """The integral of a density over a region, as a UFL form; without `weight` over its section."""
        return density * self.weight * self.section(region)

    def section(self, region: Region) -> Any:
        """The measure of a region of the mesh."""
        metadata = {"quadrature_degree": DEGREE[self.body_mesh.dim]}
        regions = self.scene.physics.part.regions
        if len(regions) == 1:
            return ufl.dx(domain=self.mesh, metadata=metadata)
        return ufl.dx(regions.index(region), domain=self.mesh, subdomain_data=self._cell_tags, metadata=metadata)

    def cells_of(self, region: Region) -> np.ndarray:
        """This rank's own cells in a region (n,)."""
        owned = self.mesh.topology.index_map(self.body_mesh.dim).size_local
        number = self.scene.physics.part.regions.index(region)
        return np.flatnonzero(self.body_mesh.regions[:owned] == number).astype(np.int32)

    def over_contact(self, integrand: Any) -> Any:
        """The integral of an expression over the contact surface, as a UFL form."""
        return integrand * self.weight * self._surface(CONTACT, QUADRATURE_DEGREE[self.body_mesh.dim])

    def over_wall(self, integrand: Any) -> Any:
        """The integral of an expression over the curved wall of a cylinder in three dimensions, as a UFL form."""
        return integrand * self._surface(WALL, WALL_DEGREE)

    def _surface(self, tag: int, degree: int) -> Any:
        metadata = {"quadrature_degree": degree}
        return ufl.ds(tag, domain=self.mesh, subdomain_data=self._facet_tags, metadata=metadata)

    def _build_trace(self) -> Trace:
        space = self.unknowns.own_space("u")
        nodes = facet_nodes(self.mesh, space, self.body_mesh.surfaces["top"])
        coordinates = space.tabulate_dof_coordinates()[:, : self.body_mesh.dim]
        dofs = self.unknowns.displacement_places(nodes)
        return Trace(nodes, coordinates[nodes], dofs)

    # ---- what is held ------------------------------------------------------------------------------------------

    def _constrain(self) -> None:
        unknowns, part, body_mesh = self.unknowns, self.scene.physics.part, self.body_mesh
        displacement = unknowns.subspace("u")
        supported, pins = held(displacement, body_mesh)
        self.bcs = [zero(displacement.sub(c), dofs) for c, dofs in supported + pins]
        self.supports = _owned([dofs for _, dofs in supported + pins], unknowns.owned)
        self.z_supports = _owned([dofs for c, dofs in supported if c == part.dim - 1], unknowns.owned)
        self.pinned = _owned([dofs for _, dofs in pins], unknowns.owned)
        self.constrained, self.active_dofs = self.supports, unknowns.total
        if len(part.regions) > 1:
            for region, name in self.pressures.items():
                cells = np.flatnonzero(body_mesh.regions == part.regions.index(region)).astype(np.int32)
                self._confine(name, unknowns.dofs_on(name, None, body_mesh.dim, cells))
        top = (body_mesh.facet_dim, body_mesh.surfaces["top"])
        if "lam" in unknowns.names:
            self._confine("lam", unknowns.dofs_on("lam", None, *top))
        if "tau" in unknowns.names:
            self._confine("tau", unknowns.dofs_on("tau", None, *top))
            self._hold_shear()

    def _confine(self, name: str, dofs: np.ndarray) -> None:
        """A field lives on these dofs; its others are held at zero and cost nothing."""
        for component, places in self.unknowns.components(name).items():
            self._hold(name, component, np.setdiff1d(places, dofs))

    def _hold_shear(self) -> None:
        """tau is zero wherever its component of u is held: the modes of tau that do no work there would be free, and
        make a wrong force of a residual that has converged."""
        unknowns, body_mesh = self.unknowns, self.body_mesh
        for component, surface in held_sides(body_mesh.part):
            if component < body_mesh.dim - 1:
                along = component if body_mesh.dim == 3 else None
                facets = body_mesh.surfaces[surface]
                self._hold("tau", along, unknowns.dofs_on("tau", along, body_mesh.facet_dim, facets))

    def _hold(self, name: str, component: int | None, dofs: np.ndarray) -> None:
        """Hold dofs of a field that has no supports."""
        self.bcs.append(zero(self.unknowns.subspace(name, component), dofs))
        own = np.setdiff1d(dofs[dofs < self.unknowns.owned], self.constrained)
        self.constrained = np.union1d(self.constrained, own)
        self.active_dofs -= self.comm.allreduce(len(own), op=MPI.SUM)

    # ---- the state ---------------------------------------------------------------------------------------------

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


def _owned(groups: list[np.ndarray], owned: int) -> np.ndarray:
    if not groups:
        return np.empty(0, dtype=np.int64)
    dofs = np.unique(np.concatenate(groups))
    return dofs[dofs < owned]
