"""Fields of a state: values at the vertices and cells of the grid, gathered on rank 0 in the grid's
own order.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, reduce
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from indent_sim.fe import compat
from indent_sim.fe.postprocessing import measurements
from indent_sim.fe.postprocessing.nodal_stress import NodalStress, total_stress
from indent_sim.model.gel import Gel


class WholeBody:
    """A whole body at the present state, whose fields can be read off. strains: of each region
    stress (3, 3) [pressure], J and psi [pressure] in UFL, and its cells on this rank; fluid: the
    term of what its pores hold, None without any.
    """

    def __init__(self, body: Any, strain_energies: Sequence[Any], friction: Any, fluid: Any = None):
        self.scene = body.scene
        self.comm = body.comm
        self.trace = body.trace
        self.body_mesh = body.body_mesh
        self.mesh = body.mesh
        self.unknowns = body.unknowns
        self.strain_energies = strain_energies
        self.friction = friction
        self.nodal_displacement = body.nodal_displacement
        self.local_array = body.local_array
        self.dofs = body.active_dof_count
        self.fluid = fluid

    @property
    def E_star(self) -> float:
        """Plane-strain modulus of what the tip touches, at this moment [pressure]."""
        return float(self.strain_energies[0].E_star)

    def find_inverted_elements(self) -> Any:
        """Where the body is deformed most, see `terms.strain.Crushed` (collective); None at small
        strain.
        """
        inverted = [
            crushed
            for strain in self.strain_energies
            if (crushed := strain.find_inverted_elements())
        ]
        return reduce(lambda one, other: one.merge_extremes(other), inverted) if inverted else None


class Fields:
    """The fields of a solution by name.

    At the vertices displacement (points, dim) [length], pressure and with friction shear (points,),
    the mean of the facets that meet, as in the surface table, and with fluid its pore_pressure. At
    the cells' centroids stress (cells, 3, 3) (Cauchy, of solid and fluid together), von_mises,
    principal_stresses (cells, 3) from the largest, energy_density per undeformed volume [pressure]
    (of the drained law), J = det(I + grad u), with fluid its fluid_content per undeformed volume,
    and with a gel swelling, J from the dry state. A quadratic displacement is shown by its values
    at the vertices. With `nodal_stress`, that and nodal_von_mises at the vertices.
    """

    def __init__(self, body: Any, nodal_stress: bool = False):
        self.body = body
        self._nodal_stress = NodalStress(body) if nodal_stress else None

    @property
    def optional_names(self) -> tuple[str, ...]:
        """Names of those that not every body has."""
        kinds = {
            "shear": self.body.friction,
            "pore_pressure": self.body.fluid,
            "fluid_content": self.body.fluid,
        }
        gels = [
            strain
            for strain in self.body.strain_energies
            if isinstance(strain.region.material, Gel)
        ]
        nodal = ("nodal_stress", "nodal_von_mises") if self._nodal_stress else ()
        return (
            *(name for name, there in kinds.items() if there is not None),
            *(["swelling"] if gels else []),
            *nodal,
        )

    @cached_property
    def _expressions(self) -> list[tuple[fem.Expression, np.ndarray]]:
        centroid = np.full((1, self.body.body_mesh.dim), 1 / (self.body.body_mesh.dim + 1))
        return [
            (fem.Expression(ufl.as_vector(self._cell_expressions(s)), centroid), s.cells)
            for s in self.body.strain_energies
        ]

    def _cell_expressions(self, strain: Any) -> list[Any]:
        """Stress, J, psi and, where there is fluid, its content: UFL scalars."""
        stress = total_stress(self.body, strain)
        fluid = self.body.fluid
        content = [] if fluid is None else [fluid.content_in(strain.region)]
        return [*(stress[i, j] for i, j in np.ndindex(3, 3)), strain.J, strain.psi, *content]

    def gather(self) -> dict[str, np.ndarray] | None:
        """The fields on rank 0, None on the others."""
        mesh = self.body.mesh
        nodes = mesh.geometry.input_global_indices
        cells = mesh.topology.original_cell_index
        local_values = (
            nodes,
            self._vertex_values(),
            *self._tractions(),
            cells,
            self._cell_values(),
        )
        parts: Any = self.body.comm.gather(local_values, root=0)
        averaged_stress = (
            self._nodal_stress.gather_averages(mesh.topology.index_map(0).size_global)
            if self._nodal_stress
            else None
        )
        if parts is None:
            return None
        nodes, u, touched_nodes, surface_tractions, cells, cell_values = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        stress, cell_scalars = np.split(_sort_to_grid(cells, cell_values), [9], axis=1)
        # those of curved cells are last
        dim = self.body.body_mesh.dim
        point_count = mesh.topology.index_map(0).size_global
        displacement, fluid = np.split(_sort_to_grid(nodes, u)[:point_count], [dim], axis=1)
        tractions = [
            _nodal_means(touched_nodes, column, len(displacement)) for column in surface_tractions.T
        ]
        return {
            "displacement": displacement,
            **dict(zip(("pressure", "shear"), tractions, strict=False)),
            **dict(zip(("pore_pressure",), fluid.T, strict=False)),
            **_stress_fields(stress.reshape(-1, 3, 3)),
            **dict(
                zip(
                    ("swelling", "J", "energy_density", "fluid_content"),
                    cell_scalars.T,
                    strict=False,
                )
            ),
            **({} if averaged_stress is None else _nodal_stress_fields(averaged_stress)),
        }

    @property
    def _vertex_dofs(self) -> np.ndarray:
        """The displacement's block dofs (cells, dim + 1) at the corners of this rank's cells."""
        dofs = compat.cell_dofs(self.body.unknowns.collapsed_space("u").dofmap)
        return dofs[:, : self.body.body_mesh.dim + 1]  # vertices come first in a cell

    def _vertex_values(self) -> np.ndarray:
        """The displacement and, where there is fluid, its pressure (points, dim or dim + 1)."""
        body = self.body
        corners = compat.geometry_dofs(self.body.mesh)
        values = np.zeros(
            (len(body.mesh.geometry.x), body.body_mesh.dim + (body.fluid is not None))
        )
        dim = body.body_mesh.dim
        values[corners, :dim] = body.local_array()[
            body.unknowns.displacement_dofs(self._vertex_dofs)
        ]
        if body.fluid is not None:
            values[corners, dim] = body.fluid.corner_pressures()
        return values

    def _tractions(self) -> tuple[np.ndarray, np.ndarray]:
        """The grid's points (n,) at corners of contact facets; the pressure, with friction shear,
        there (n, 1 or 2).
        """
        body = self.body
        dim = self.body.body_mesh.dim
        corners = body.trace.node_points()[:dim]
        node = np.zeros(self._vertex_dofs.max(initial=0) + 1, dtype=np.int64)
        node[self._vertex_dofs] = np.asarray(body.mesh.geometry.input_global_indices)[
            compat.geometry_dofs(body.mesh)
        ]
        tractions = measurements.tractions(
            body, measurements.sample_contact(body, corners), corners
        )
        return node[body.trace.nodes[:, :dim]].ravel(), tractions.reshape(-1, tractions.shape[-1])

    def _cell_values(self) -> np.ndarray:
        """Stress, swelling, J, psi and, where there is fluid, its content (cells, 12 or 13)."""
        width = 11 + (self.body.fluid is not None)
        values = np.zeros((len(self.body.mesh.topology.original_cell_index), 1 + width))
        for (expression, cells), strain in zip(
            self._expressions, self.body.strain_energies, strict=True
        ):
            values_of_region = compat.evaluate_expression(
                expression, self.body.mesh, cells
            ).reshape(-1, width)
            values[cells] = np.insert(
                values_of_region,
                9,
                strain.region.material.swelling_ratio(values_of_region[:, 9]),
                axis=1,
            )
        return values


def _nodal_stress_fields(stress: np.ndarray) -> dict[str, np.ndarray]:
    """A stress at the vertices (points, 3, 3), and its von Mises stress."""
    return {"nodal_stress": stress, "nodal_von_mises": _stress_fields(stress)["von_mises"]}


def _stress_fields(stress: np.ndarray) -> dict[str, np.ndarray]:
    """A stress (n, 3, 3), its principal values from the largest, and sqrt(3/2 s:s) of its deviator
    s.
    """
    principal = np.linalg.eigvalsh((stress + np.swapaxes(stress, 1, 2)) / 2)[:, ::-1]
    deviator = principal - principal.mean(axis=1, keepdims=True)
    von_mises = np.sqrt(1.5 * (deviator**2).sum(axis=1))
    return {"stress": stress, "von_mises": von_mises, "principal_stresses": principal}


def _sort_to_grid(grid_numbers: np.ndarray, rows: np.ndarray) -> np.ndarray:
    table = np.zeros((grid_numbers.max() + 1, rows.shape[1]))
    table[grid_numbers] = rows
    return table


def _nodal_means(node_numbers: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    count = np.bincount(node_numbers, minlength=size)
    return np.bincount(node_numbers, values, size) / np.maximum(count, 1)
