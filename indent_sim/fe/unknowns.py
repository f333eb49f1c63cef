"""The unknown fields of a problem side by side in one space: displacement u, body pressure q, multiplier lam."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe import compat


class Unknowns:
    """Space, solution and dof numbering; `fields` maps the name of each unknown to its UFL expression.

    u has the displacement's order, q (mixed formulation) one less, lam (on the whole body, but constrained to zero
    off the contact surface) the order given by `multiplier`, 0 for none.
    """

    def __init__(self, mesh: Any, order: int, *, body_pressure: bool, multiplier: int):
        dim = mesh.geometry.dim
        elements = {"u": compat.lagrange(dim, order, dim)}
        if body_pressure:
            elements["q"] = compat.lagrange(dim, 1)
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
