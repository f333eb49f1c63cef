"""Unknown fields of a body with their function space, degrees of freedom and time levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.kernel_cache import create_function_space
from indent_sim.mesh.model_domain import Region

# Polynomial order of the displacement
DISPLACEMENT_ORDER = 2


@dataclass(frozen=True)
class Field:
    """An unknown field of continuous piecewise polynomials.

    Attributes
    ----------
    name : str
        Name of the field.
    order : int
        Polynomial order.
    axes : tuple of int
        Axes of the components, empty for a scalar. A component is constrained where the
        displacement along the same axis is constrained.
    domain : tuple of Region or str
        Regions, or name of the surface, on which the field is defined; empty for the whole body.
    weight : float
        Factor that converts the residual of the field into forces.
    """

    name: str
    order: int
    axes: tuple[int, ...] = ()
    domain: tuple[Region, ...] | str = ""
    weight: float = 1.0


@dataclass(frozen=True)
class TimeLevel:
    """The unknowns at the end (`now`) or at the beginning (`before`) of a step.

    Attributes
    ----------
    function : fem.Function
        Solution vector.
    fields : mapping of str to Expr
        Fields of the solution as UFL expressions.
    delta : fem.Constant
        Indentation depth [length].
    t : fem.Constant
        Time [time].
    center : list of fem.Constant
        Horizontal position of the tip's axis [length].
    test, trial : Expr
        Test and trial functions: variations for the virtual work and for its derivative.
    """

    function: fem.Function
    fields: Mapping[str, Expr]
    delta: fem.Constant
    t: fem.Constant
    center: list[fem.Constant]
    test: Expr = None
    trial: Expr = None


class Unknowns:
    """Function space, solution vector and dof numbering of all fields; u is the first field.

    Attributes
    ----------
    owned_count : int
        Number of dofs that this rank owns; they come first in the local array.
    total_count : int
        Number of dofs of all ranks.
    """

    def __init__(self, mesh: dolfinx_mesh.Mesh, fields: Sequence[Field]):
        self.fields_by_name = {field.name: field for field in fields}
        self.names = tuple(self.fields_by_name)
        self.dim = mesh.geometry.dim
        elements = [
            compat.lagrange_element(self.dim, field.order, len(field.axes)) for field in fields
        ]
        self.space = create_function_space(
            mesh, elements[0] if len(elements) == 1 else compat.mixed_element(*elements)
        )
        self.solution = fem.Function(self.space)
        self.x = compat.petsc_vector(self.solution)
        rows = self.space.dofmap.index_map
        width = self.space.dofmap.index_map_bs
        self.owned_count = rows.size_local * width
        self.total_count = rows.size_global * width

    def split_fields(self, function: Expr) -> dict[str, Expr]:
        """Return the fields of a function of the mixed space as UFL expressions, by name."""
        parts = (function,) if len(self.names) == 1 else ufl.split(function)
        return dict(zip(self.names, parts, strict=True))

    def variation(self, name: str, argument: Expr) -> Expr:
        """Extend a test or trial function of one field by zeros to the mixed space."""
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
        """Return the subspace of a field, or of one of its components."""
        space = self.space if len(self.names) == 1 else self.space.sub(self.names.index(name))
        return space if component is None else space.sub(component)

    @cached_property
    def _collapsed_spaces(self) -> dict[str, tuple[fem.FunctionSpace, np.ndarray]]:
        """Collapsed space of each field, and the positions of its dofs in the local solution."""
        if len(self.names) == 1:
            return {"u": (self.space, np.arange(len(self.solution.x.array)))}
        collapsed = {name: self.subspace(name).collapse() for name in self.names}
        # dolfinx 0.11 returns a list of arrays of dofs.
        return {name: (space, np.ravel(dofs)) for name, (space, dofs) in collapsed.items()}

    def collapsed_space(self, name: str) -> fem.FunctionSpace:
        """Function space of the field alone."""
        return self._collapsed_spaces[name][0]

    def dofs(self, name: str) -> np.ndarray:
        """Positions of the dofs of the field's collapsed space in the local solution array."""
        return self._collapsed_spaces[name][1]

    def component_dofs(self, name: str) -> dict[int | None, np.ndarray]:
        """Return the local positions of the dofs of each component; the key of a scalar is None."""
        dofs = self.dofs(name)
        size = len(self.fields_by_name[name].axes)
        return {c: dofs[c::size] for c in range(size)} if size > 1 else {None: dofs}

    def displacement_dofs(self, nodes: np.ndarray) -> np.ndarray:
        """Positions (..., dim) of the displacement dofs of nodes in the local solution array."""
        return self.dofs("u")[nodes[..., None] * self.dim + np.arange(self.dim)]

    def dofs_on(
        self, name: str, component: int | None, dim: int, entities: np.ndarray
    ) -> np.ndarray:
        """Local dofs of a field, owned or ghosts, on mesh entities of a dimension (collective).

        Parameters
        ----------
        name : str
            Name of the field.
        component : int or None
            Component of a vector field, None for all.
        dim : int
            Dimension of the entities.
        entities : ndarray of int
            Local numbers of the entities.
        """
        topology = self.space.mesh.topology
        # Newer versions of dolfinx need this connectivity for cells, too
        topology.create_connectivity(dim, topology.dim)
        return fem.locate_dofs_topological(self.subspace(name, component), dim, entities)


def components(expression: Expr) -> list[Expr]:
    """Components of a UFL vector, or the scalar itself, as a list."""
    return [expression[k] for k in range(len(expression))] if expression.ufl_shape else [expression]
