"""The body: unknown fields, how they are held, the measures of its volume and surfaces."""

from __future__ import annotations

import dataclasses
from functools import cached_property
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
from indent_sim.scene.scene import Scene

ORDER = 2  # of the displacement
DEGREE = 2 * ORDER  # of the quadrature of the volume and of the wall


class Unknowns:
    """Space, solution and dof numbering; `fields` maps the name of each unknown to its UFL expression.

    u has ORDER, q (mixed formulation) one less, lam (on the whole body, but constrained to zero
    off the contact surface) the order given by `multiplier`, 0 for none.
    """

    def __init__(self, mesh: Any, *, body_pressure: bool, multiplier: int):
        dim = mesh.geometry.dim
        elements = {"u": compat.lagrange(dim, ORDER, dim)}
        if body_pressure:
            elements["q"] = compat.lagrange(dim, ORDER - 1)
        if multiplier:
            elements["lam"] = compat.lagrange(dim, multiplier)
        self.names = tuple(elements)
        self.dim = dim
        alone = len(elements) == 1
        element = elements["u"] if alone else compat.mixed(*elements.values())
        self.space = compat.function_space(mesh, element)
        self.solution = fem.Function(self.space)
        self.x = compat.vector(self.solution)
        parts = (self.solution,) if alone else ufl.split(self.solution)
        self.fields = dict(zip(self.names, parts, strict=True))

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

    def facet_dofs(self, name: str, component: int | None, facet_dim: int, facets: np.ndarray) -> np.ndarray:
        """Local dofs of a field on facets, of whatever rank the facets are (collective)."""
        return fem.locate_dofs_topological(self.subspace(name, component), facet_dim, facets)

    def zero(self, name: str, component: int | None, dofs: np.ndarray) -> Any:
        """Hold dofs of a field at zero."""
        return fem.dirichletbc(PETSc.ScalarType(0), dofs.astype(np.int32), self.subspace(name, component))

CONTACT, WALL = 1, 2  # facet tags: the top surface, the curved wall of a cylinder in three dimensions


def symbolic(item: Any, mesh: Any) -> Any:
    """The same dataclass with every real number a `Constant`: a changed value never recompiles a kernel.

    Whole numbers count something (faces of a pyramid) and decide the formula itself.
    """

    def constant(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(constant, value))
        return fem.Constant(mesh, value) if isinstance(value, float) else value

    return dataclasses.replace(item, **{f.name: constant(getattr(item, f.name)) for f in dataclasses.fields(item)})


class Body:
    """The unknown fields of a scene's body on a mesh, what is held, and the measures of its volume and surfaces."""

    def __init__(self, scene: Scene, body_mesh: BodyMesh, *, multiplier: int = 0):
        self.scene = scene
        self.body_mesh = body_mesh
        self.mesh = body_mesh.mesh
        self.comm = body_mesh.comm
        mixed = any(region.formulation == "mixed" for region in scene.physics.part.regions)
        self.unknowns = Unknowns(self.mesh, body_pressure=mixed, multiplier=multiplier)
        self.x = self.unknowns.x
        self.X = ufl.SpatialCoordinate(self.mesh)
        self.weight = scene.physics.part.kinematics.weight(self.X)
        self.trace = self._build_trace()
        self._tag_facets()
        self._constrain()

    def _tag_facets(self) -> None:
        empty = np.empty(0, dtype=np.int32)
        parts = {tag: self.body_mesh.surfaces.get(name, empty) for tag, name in ((CONTACT, "top"), (WALL, "r_max"))}
        facets = np.concatenate(list(parts.values()))
        tags = np.repeat(np.array(list(parts), dtype=np.int32), [len(part) for part in parts.values()])
        order = np.argsort(facets)
        self._facet_tags = dolfinx_mesh.meshtags(self.mesh, self.body_mesh.facet_dim, facets[order], tags[order])

    def over_volume(self, density: Any) -> Any:
        """The integral of a density over the body, as a UFL form."""
        return density * self.weight * ufl.dx(metadata={"quadrature_degree": DEGREE})

    def over_contact(self, integrand: Any) -> Any:
        """The integral of an expression over the contact surface, as a UFL form."""
        return integrand * self.weight * self._surface(CONTACT, QUADRATURE_DEGREE[self.body_mesh.dim])

    def over_wall(self, integrand: Any) -> Any:
        """The integral of an expression over the curved wall of a cylinder in three dimensions, as a UFL form."""
        return integrand * self._surface(WALL, DEGREE)

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
        held: list[tuple[int, np.ndarray]] = []
        for surface, support in part.supports.items():
            normal = part.normal(surface)  # a curved wall has none and is guided weakly
            components = {"fixed": list(range(part.dim)), "roller": [] if normal is None else [normal]}.get(support, [])
            facets = body_mesh.surfaces[surface]
            held += [(c, unknowns.facet_dofs("u", c, body_mesh.facet_dim, facets)) for c in components]
        pins = [(c, self._vertex_dofs(c, point)) for point, c in part.pins]
        self.bcs = [unknowns.zero("u", c, dofs) for c, dofs in held + pins]
        self.supports = _owned([dofs for _, dofs in held + pins], unknowns.owned)
        self.z_supports = _owned([dofs for c, dofs in held if c == part.dim - 1], unknowns.owned)
        self.pinned = _owned([dofs for _, dofs in pins], unknowns.owned)
        self.constrained, self.active_dofs = self.supports, unknowns.total
        if "lam" in unknowns.names:
            self._confine_multiplier()

    def _vertex_dofs(self, component: int, point: tuple[float, ...]) -> np.ndarray:
        return self.unknowns.facet_dofs("u", component, 0, self.body_mesh.vertices_at(point))

    def _confine_multiplier(self) -> None:
        """The multiplier lives on the contact surface; its other dofs are held at zero and cost nothing."""
        unknowns = self.unknowns
        on_top = unknowns.facet_dofs("lam", None, self.body_mesh.facet_dim, self.body_mesh.surfaces["top"])
        off = np.setdiff1d(unknowns.places("lam"), on_top)
        self.bcs.append(unknowns.zero("lam", None, off))
        self.constrained = np.union1d(self.supports, off[off < unknowns.owned])
        idle = self.comm.allreduce(int((off < unknowns.owned).sum()), op=MPI.SUM)
        self.active_dofs = unknowns.total - idle

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
