"""Fields of a state at the vertices and cells of the grid, gathered in the order of the grid."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from indent_sim.fe import compat
from indent_sim.fe.kernel_cache import compile_expression
from indent_sim.fe.postprocessing import contact_sample
from indent_sim.fe.postprocessing.nodal_stress import NodalStress, total_stress
from indent_sim.model.gel import Gel


class Fields:
    """Fields of a solution, which `gather` returns by name.

    At vertices:

    * `displacement` (points, dim) [length];
    * `pressure`, with friction also `shear` (points,) [pressure], averaged over the facets of a
      vertex as in the surface table;
    * `pore_pressure` (points,) [pressure], with pore fluid;
    * `nodal_stress` (points, 3, 3) and `nodal_von_mises` (points,) [pressure], on request. With
      them, a vertex on an interface has one row for each adjacent region in all vertex fields, in
      the order of `mesh.grid.split_at_interfaces`.

    At the centroids of cells; in plastic regions, the means over the cells:

    * `stress` (cells, 3, 3), the total Cauchy stress [pressure], `von_mises` (cells,) and
      `principal_stresses` (cells, 3), the largest first;
    * `energy_density` (cells,) of the drained law per undeformed volume [pressure];
    * `J` (cells,), det(I + grad u);
    * `fluid_content` (cells,) per undeformed volume, with pore fluid;
    * `swelling` (cells,), the volume ratio from the dry state, with a gel;
    * `plastic_strain` (cells,), the equivalent plastic strain, in a body that yields.

    Parameters
    ----------
    body : WholeBody
        Body at the current state.
    nodal_stress : bool
        Whether the fields at vertices contain the stress.
    """

    def __init__(self, body: Any, nodal_stress: bool = False):
        self.body = body
        self._nodal_stress = NodalStress(body) if nodal_stress else None

    @property
    def optional_names(self) -> tuple[str, ...]:
        """Names of the optional fields that this body has, such as the pore pressure."""
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
            *(name for name, term in kinds.items() if term is not None),
            *(["swelling"] if gels else []),
            *(["plastic_strain"] if self.body.scene.physics.yields else []),
            *nodal,
        )

    @cached_property
    def _compiled_expressions(self) -> list[tuple[fem.Expression, np.ndarray, np.ndarray]]:
        """Expression of the values of each region, weights of its points, and cells."""
        expressions = []
        for strain in self.body.strain_energies:
            sample = strain.cell_sample
            values = ufl.as_vector(self._cell_expressions(strain, sample))
            expression = compile_expression(values, sample.points)
            expressions.append((expression, sample.weights, strain.cells))
        return expressions

    def _cell_expressions(self, strain: Any, sample: Any) -> list[Any]:
        """UFL scalars: stress, J, psi and, if present, fluid content or plastic strain."""
        fluid = self.body.fluid
        stress = sample.stress if fluid is None else total_stress(self.body, strain)
        content = [] if fluid is None else [fluid.content_in(strain.region)]
        plastic_strain = [] if sample.plastic_strain is None else [sample.plastic_strain]
        components = [stress[i, j] for i, j in np.ndindex(3, 3)]
        return [*components, strain.J, sample.psi, *content, *plastic_strain]

    def gather(self) -> dict[str, np.ndarray] | None:
        """Gather the fields on rank 0; None on other ranks (collective)."""
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
        # The grid is that of the body, which comes before a soft tip on the same mesh.
        counts = self.body.body_mesh.body_counts or (mesh.topology.index_map(0).size_global, None)
        point_count, cell_count = counts
        stress, cell_scalars = np.split(_sort_to_grid(cells, cell_values)[:cell_count], [9], axis=1)
        # A body with pore fluid does not yield
        last_name = "plastic_strain" if self.body.scene.physics.yields else "fluid_content"
        # Midpoints of curved cells come after the vertices
        dim = self.body.body_mesh.dim
        displacement, fluid = np.split(_sort_to_grid(nodes, u)[:point_count], [dim], axis=1)
        tractions = [
            _nodal_means(touched_nodes, column, len(displacement)) for column in surface_tractions.T
        ]
        nodal = {
            "displacement": displacement,
            **dict(zip(("pressure", "shear"), tractions, strict=False)),
            **dict(zip(("pore_pressure",), fluid.T, strict=False)),
        }
        if averaged_stress is not None:
            origin, nodal_stress = averaged_stress
            nodal = {name: values[origin] for name, values in nodal.items()}
            nodal |= _nodal_stress_fields(nodal_stress)
        return {
            **nodal,
            **_stress_fields(stress.reshape(-1, 3, 3)),
            **dict(
                zip(
                    ("swelling", "J", "energy_density", last_name),
                    cell_scalars.T,
                    strict=False,
                )
            ),
        }

    @property
    def _vertex_dofs(self) -> np.ndarray:
        """Block dofs (cells, dim + 1) of the displacement at the corners of this rank's cells."""
        dofs = compat.cell_dofs(self.body.unknowns.collapsed_space("u").dofmap)
        return dofs[:, : self.body.body_mesh.dim + 1]  # a cell's vertices come first

    def _vertex_values(self) -> np.ndarray:
        """Displacement and, with pore fluid, pore pressure of vertices (points, dim or dim + 1)."""
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
        """Contact pressure and, with friction, shear traction at the corners of contact facets.

        Returns
        -------
        points : ndarray of int, (n,)
            Grid points of the corners.
        tractions : ndarray, (n, 1 or 2)
            Tractions at the corners [pressure].
        """
        body = self.body
        dim = self.body.body_mesh.dim
        corners = body.trace.node_points()[:dim]
        node = np.zeros(self._vertex_dofs.max(initial=0) + 1, dtype=np.int64)
        node[self._vertex_dofs] = np.asarray(body.mesh.geometry.input_global_indices)[
            compat.geometry_dofs(body.mesh)
        ]
        tractions = contact_sample.tractions(
            body, contact_sample.sample_contact(body, corners), corners
        )
        return node[body.trace.nodes[:, :dim]].ravel(), tractions.reshape(-1, tractions.shape[-1])

    def _cell_values(self) -> np.ndarray:
        """Values of this rank's cells (cells, 12 or 13).

        They are the stress, the swelling, J and psi, followed by the fluid content or the
        equivalent plastic strain of a body that has one.
        """
        width = 11 + (self.body.fluid is not None) + self.body.scene.physics.yields
        values = np.zeros((len(self.body.mesh.topology.original_cell_index), 1 + width))
        for (expression, weights, cells), strain in zip(
            self._compiled_expressions, self.body.strain_energies, strict=True
        ):
            values_at_points = compat.evaluate_expression(expression, self.body.mesh, cells)
            values_of_region = np.einsum(
                "p,cpv->cv", weights, values_at_points.reshape(len(cells), len(weights), -1)
            )
            swelling = strain.region.material.swelling_ratio(values_of_region[:, 9])
            values_with_swelling = np.insert(values_of_region, 9, swelling, axis=1)
            values[cells, : values_with_swelling.shape[1]] = values_with_swelling
        return values


def _nodal_stress_fields(stress: np.ndarray) -> dict[str, np.ndarray]:
    """Return the nodal stress (points, 3, 3) and its von Mises stress, keyed by field name."""
    return {"nodal_stress": stress, "nodal_von_mises": _stress_fields(stress)["von_mises"]}


def _stress_fields(stress: np.ndarray) -> dict[str, np.ndarray]:
    """Return a stress (n, 3, 3), its principal values and its von Mises stress, by field name.

    The von Mises stress is sqrt(3/2 s : s) with the deviator s; principal values are in descending
    order.
    """
    principal = np.linalg.eigvalsh((stress + np.swapaxes(stress, 1, 2)) / 2)[:, ::-1]
    deviator = principal - principal.mean(axis=1, keepdims=True)
    von_mises = np.sqrt(1.5 * (deviator**2).sum(axis=1))
    return {"stress": stress, "von_mises": von_mises, "principal_stresses": principal}


def _sort_to_grid(grid_numbers: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Reorder rows to the grid's numbering: row `grid_numbers[k]` of the result is `rows[k]`."""
    table = np.zeros((grid_numbers.max() + 1, rows.shape[1]))
    table[grid_numbers] = rows
    return table


def _nodal_means(node_numbers: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """Mean (size,) of the values at each node; 0 at nodes without values."""
    count = np.bincount(node_numbers, minlength=size)
    return np.bincount(node_numbers, values, size) / np.maximum(count, 1)
