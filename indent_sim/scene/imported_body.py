"""Bodies from mesh files: reading, positioning below the tip, materials of their regions."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from indent_sim.mesh import imported_domain, mesh_import
from indent_sim.mesh.imported_mesh import BoundaryCells, ImportedMesh
from indent_sim.mesh.model_domain import ModelDomain, Region
from indent_sim.model.body import (
    ImportedBody,
    MeshFromFile,
)
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
    """The body that a file has, lowered so that the tip first touches it at z = 0."""
    center = config.center or source.center
    if source.hash not in (None, imported_mesh.hash):
        remedy = "find the mesh that this scene was made with, or leave the hash out"
        raise ConfigError(
            "body.hash", f"'{source.file}' holds another mesh, {imported_mesh.hash}", remedy
        )
    imported_mesh = imported_mesh.with_leading_region(
        imported_domain.region_under_axis(imported_mesh, center)
    )
    imported_domain.refuse_forgotten_mirrors(imported_mesh, source, center)
    placed_mesh = imported_mesh.translated_to_contact(
        imported_domain.first_contact_height(config.indenter, imported_mesh, center)
    )
    return imported_domain.imported_body(
        placed_mesh, source, center, _region_materials(placed_mesh, config)[0][1]
    ), placed_mesh


def read_imported_mesh(config: Config, comm: Any) -> ImportedMesh | None:
    """The body of the config's mesh file, None where it names none (collective).

    On several ranks rank 0 reads the file, has its arrays mapped, and all know the skin of the
    body.
    """
    if not isinstance(config.body, MeshFromFile):
        return None
    if comm.size == 1:
        return read_mesh_file(config, config.body)
    boundary_cells = run_on_root(comm, _read_boundary_cells, config, config.body)
    shared_cells = comm.bcast(
        replace(boundary_cells, unplaced_mesh=None) if boundary_cells else None, root=0
    )
    return boundary_cells or shared_cells


def read_mesh_file(config: Config, source: MeshFromFile) -> ImportedMesh:
    """The body as its file, beside the scene's, has it."""
    return mesh_import.import_mesh(os.path.dirname(config.source.name), source, config.material)


def _read_boundary_cells(config: Config, source: MeshFromFile) -> BoundaryCells:
    """The skin of that body, read in the process that meshes; of the whole this one has arrays that
    lie in a file.
    """
    from indent_sim.mesh import gmsh

    failure_text = f"'{source.file}' could not be read"
    folder = os.path.dirname(config.source.name)
    return gmsh.call_in_mesher(
        failure_text, mesh_import.import_boundary_cells, folder, source, config.material
    )()


def _region_materials(imported_mesh: ImportedMesh, config: Config) -> list[tuple[str, Material]]:
    """The materials of a piece's regions with the keys where they stand, in their order."""
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
    assert isinstance(config.body, MeshFromFile)
    materials = [
        (key, scales.nondimensionalize(material))
        for key, material in _region_materials(imported_mesh, config)
    ]
    names = [f"regions.{name}" if name else "body" for name in imported_mesh.region_names]
    named_laws = zip(names, materials, strict=True)
    shear_fractions = [least_shear_fraction(config, law) for _, law in materials]
    regions = tuple(
        Region(
            name,
            law,
            choose_formulation(key, law, shear_fraction),
            0.0,
            min_shear_fraction=shear_fraction,
        )
        for (name, (key, law)), shear_fraction in zip(named_laws, shear_fractions, strict=True)
    )
    domain = imported_domain.imported_domain(
        imported_mesh.scaled_by_length(scales.length), config.body, regions
    )
    surfaces_text = (
        ""
        if config.body.surface_names == config.body.surfaces
        else ", its surfaces without a name by where they face"
    )
    return domain, f"a mesh from a file is modelled as it is{surfaces_text}"
