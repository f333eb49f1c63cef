"""Mesh generation with gmsh: from a model domain and element sizes to a Grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from indent_sim.mesh.gmsh_geometry import (
    draw_box,
    draw_extruded,
    draw_inclusions,
    draw_section,
    point_shift,
    prescribe_sizes,
)
from indent_sim.mesh.grid import Grid, is_flat, named_surfaces, regions_of_cells
from indent_sim.mesh.mesher_process import Gmsh, call_in_mesher, gmsh_session
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.process.errors import MeshError


def build_mesh(domain: ModelDomain, sizes: Sizes) -> Grid:
    """Mesh a model domain with elements of the given sizes.

    Raises
    ------
    MeshError
        If gmsh fails or crashes.
    BackendError
        If gmsh is missing.
    """
    return start_meshing(domain, sizes)()


def start_meshing(domain: ModelDomain, sizes: Sizes) -> Callable[[], Grid]:
    """Start to mesh a domain in the mesher process and return a function that waits for the grid.

    A mesh from a file is refined in this process, without gmsh.
    """
    # The mesher process imports this module and needs no imported meshes.
    from indent_sim.mesh.imported_domain import ImportedDomain, refine_domain

    if isinstance(domain, ImportedDomain):
        return partial(refine_domain, domain, sizes)
    return call_in_mesher(mesh_domain, domain, sizes)


def mesh_domain(domain: ModelDomain, sizes: Sizes) -> Grid:
    """Mesh a domain; retry with smaller random shifts of points if gmsh fails or leaves flat cells.

    If the domain cannot be meshed, the MeshError names other sizes at the contact that were tried,
    and whether they can be meshed.
    """
    try:
        return _mesh_with_shifts(domain, sizes)
    except MeshError as failure:
        message = str(failure)
    # Factors of h_contact that are tried where a domain cannot be meshed, to name a remedy.
    size_factors = (1.1, 0.9)
    for factor in size_factors:
        if _can_be_meshed(domain, replace(sizes, h_contact=factor * sizes.h_contact)):
            raise MeshError(
                f"{message}; a mesh.h_contact {factor:g} times as large was tried, with which "
                "the body can be meshed"
            )
    factors = " and ".join(f"{factor:g}" for factor in size_factors)
    raise MeshError(
        f"{message}; a mesh.h_contact {factors} times as large was tried, with which the body "
        "cannot be meshed either"
    )


def _can_be_meshed(domain: ModelDomain, sizes: Sizes) -> bool:
    """Return whether a domain can be meshed with the given sizes."""
    try:
        _mesh_with_shifts(domain, sizes)
    except MeshError:
        return False
    return True


def _mesh_with_shifts(domain: ModelDomain, sizes: Sizes) -> Grid:
    """Mesh a domain with the given sizes, with smaller random shifts after each failure."""
    failure = MeshError("gmsh created cells with zero volume")
    # With the factor 1, 4 of 10 meshes of a strip had flat triangles; with 0.1 none had.
    for shift_factor in (1.0, 0.1, 0.01):
        try:
            grid = _generate_mesh(domain, sizes, shift_factor * point_shift(domain, sizes))
        except MeshError as error:
            failure = error
            continue
        if not has_flat_cells(grid):
            return grid
    raise failure


def has_flat_cells(grid: Grid) -> bool:
    """Return whether any cell has a volume of zero up to round-off."""
    return bool(is_flat(grid.points, grid.cells).any())


def _generate_mesh(domain: ModelDomain, sizes: Sizes, shift: float) -> Grid:
    """Draw a domain in a gmsh session, prescribe its sizes and mesh it."""
    with gmsh_session() as gmsh:
        try:
            if domain.dim == 2:
                draw_section(gmsh, domain, sizes)
            elif domain.wall_radius:
                draw_extruded(gmsh, domain, sizes)
            else:
                draw_box(gmsh, domain, sizes)
            if domain.inclusions:
                draw_inclusions(gmsh, domain)
            prescribe_sizes(gmsh, sizes, domain.dim)
            gmsh.option.setNumber("Mesh.RandomFactor", shift)
            gmsh.model.mesh.generate(domain.dim)
        except Exception as failure:  # gmsh raises bare Exceptions
            raise MeshError(f"gmsh could not mesh the body: {failure}") from failure
        return _extract_grid(gmsh, domain, sizes)


def _extract_grid(gmsh: Gmsh, domain: ModelDomain, sizes: Sizes) -> Grid:
    """Return gmsh's mesh of a domain as a Grid, without points that belong to no cell."""
    dim = domain.dim
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(2 if dim == 2 else 4)
    if len(nodes) == 0:
        raise MeshError("gmsh created no cells")
    used_tags, cells = np.unique(np.asarray(nodes, dtype=np.int64), return_inverse=True)
    order = np.argsort(tags)
    node_rows = order[np.searchsorted(np.asarray(tags)[order], used_tags)]
    points = np.ascontiguousarray(np.asarray(coordinates).reshape(-1, 3)[node_rows, :dim])
    cells = np.ascontiguousarray(cells.reshape(-1, dim + 1))
    regions = regions_of_cells(points, cells, domain)
    surfaces = named_surfaces(points, cells, domain, sizes.min_size)
    return Grid(points, cells, regions, surfaces, gmsh.option.getString("General.Version"))
