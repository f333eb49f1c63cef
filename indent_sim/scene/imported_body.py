"""Imported bodies: reading a mesh file, positioning below the tip, materials of the regions."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from indent_sim.mesh import imported_domain, mesh_import
from indent_sim.mesh.imported_mesh import ImportedMesh, boundary_cells_of
from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.imported_body import ImportedBody, MeshFromFile
from indent_sim.model.materials import Material
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.regions import choose_formulation, instantaneous_law, least_shear_fraction

if TYPE_CHECKING:
    from indent_sim.config.schema import Config


def position_imported_mesh(
    config: Config, source: MeshFromFile, imported_mesh: ImportedMesh
) -> tuple[ImportedBody, ImportedMesh]:
    """Translate an imported mesh so that first contact with the tip is at z = 0.

    Parameters
    ----------
    config : Config
        The scene file.
    source : MeshFromFile
        The body of the scene file.
    imported_mesh : ImportedMesh
        The mesh in the position of the file.

    Returns
    -------
    ImportedBody
        The body with its material below the tip.
    ImportedMesh
        The translated mesh.

    Raises
    ------
    ConfigError
        If the hash of the mesh differs from the one in the scene file, the tip's axis does not meet
        it, or it ends in a plane through the tip's axis for which the scene file gives no support.
    """
    center = config.center or source.center
    if source.hash not in (None, imported_mesh.hash):
        problem = f"'{source.file}' is not the mesh of this scene: its hash is {imported_mesh.hash}"
        remedy = "use the mesh file of this scene, or leave the hash out"
        raise ConfigError("body.hash", problem, remedy)
    imported_mesh = imported_mesh.with_leading_region(
        imported_domain.region_under_axis(imported_mesh, center)
    )
    imported_domain.refuse_forgotten_mirrors(imported_mesh, source, center)
    placed_mesh = imported_mesh.translated_to_contact(
        imported_domain.first_contact_height(config.tip, imported_mesh, center)
    )
    _, material = _region_materials(placed_mesh, config)[0]
    body = imported_domain.imported_body(placed_mesh, source, center, material)
    return body, placed_mesh


def read_imported_mesh(config: Config, comm: Any) -> ImportedMesh | None:
    """Read the mesh file of a scene; None if its body has no mesh file (collective).

    On several ranks, rank 0 reads the file and the other ranks receive the boundary cells.
    """
    source = config.body
    if not isinstance(source, MeshFromFile):
        return None
    if comm.size == 1:
        return read_mesh_file(config, source)
    boundary_cells = run_on_root(comm, lambda: boundary_cells_of(read_mesh_file(config, source)))
    shared_cells = comm.bcast(
        replace(boundary_cells, unplaced_mesh=None) if boundary_cells else None, root=0
    )
    return boundary_cells or shared_cells


def read_mesh_file(config: Config, source: MeshFromFile) -> ImportedMesh:
    """Read a mesh file, whose path is relative to the folder of the scene file."""
    return mesh_import.import_mesh(os.path.dirname(config.source.name), source, config.material)


def _region_materials(imported_mesh: ImportedMesh, config: Config) -> list[tuple[str, Material]]:
    """Return scene key and material of every region of a mesh, in the order of the regions."""
    regions = getattr(config.body, "regions", None) or {}
    region_laws = {name: (f"body.regions.{name}", material) for name, material in regions.items()}
    laws = [
        region_laws.get(name, ("material", config.material)) for name in imported_mesh.region_names
    ]
    return [
        (key, instantaneous_law(config, material)) for key, material in laws if material is not None
    ]


def imported_model_domain(
    config: Config, imported_mesh: ImportedMesh, scales: Scales
) -> tuple[ModelDomain, str]:
    """Return the model domain of an imported mesh, and the reason for its symmetry.

    Parameters
    ----------
    config : Config
        The scene file.
    imported_mesh : ImportedMesh
        The translated mesh.
    scales : Scales
        Scales of the nondimensional problem.
    """
    assert isinstance(config.body, MeshFromFile)
    materials = [
        (key, scales.nondimensionalize(material))
        for key, material in _region_materials(imported_mesh, config)
    ]
    names = [f"regions.{name}" if name else "body" for name in imported_mesh.region_names]
    shear_fractions = [least_shear_fraction(config, law) for _, law in materials]
    regions = tuple(
        Region(
            name,
            law,
            choose_formulation(key, law, shear_fraction),
            0.0,
            min_shear_fraction=shear_fraction,
        )
        for name, (key, law), shear_fraction in zip(names, materials, shear_fractions, strict=True)
    )
    domain = imported_domain.imported_domain(
        imported_mesh.scaled_by_length(scales.length), config.body, regions
    )
    surfaces_text = (
        ""
        if config.body.surface_names == config.body.surfaces
        else "; surfaces without a name are identified by their normals"
    )
    return domain, f"an imported mesh is modelled without symmetry reduction{surfaces_text}"
