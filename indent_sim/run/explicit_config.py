"""Explicit config of a run, with every "auto" replaced by its value in the user's units."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from indent_sim.config.scene_file import to_mapping
from indent_sim.config.scene_sections import KeptStates
from indent_sim.config.schema import Config, allowed_keys_at
from indent_sim.config.strict_yaml import leaf_values
from indent_sim.model.drainage import Drainage
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.results.result_files import MESH_FILE
from indent_sim.scene.regions import remove_unused_material
from indent_sim.scene.scene import Scene


def explicit_config(config: Config, scene: Scene) -> Config:
    """Return the config with every decision of the program; it gives the same mesh and results."""
    config = remove_unused_material(config, scene.physics.domain)
    gap = scene.physics.gap
    output = dataclasses.replace(config.output, fields=written_fields(config, scene))
    solver = _replace_auto(config.solver, method=scene.solver.method, linear=scene.solver.linear)
    sections: dict[str, Any] = {
        "center": config.center or config.body.center,
        "accuracy": None,
        "solver": solver,
    }
    sections |= {"output": output, "contact": _replace_auto(config.contact, gap=gap)}
    if scene.physics.bath_ramp:
        sections["drainage"] = _replace_auto(
            config.drainage or Drainage(), bath_ramp=scene.physics.bath_ramp
        )
    if scene.is_meshed:
        sections |= _material_sections(config, scene) | {
            "contact": _contact_section(config, scene),
            "mesh": _mesh_section(config, scene),
        }
    return config.model_copy(update=sections)


def written_fields(config: Config, scene: Scene) -> KeptStates:
    """Return the steps whose fields are written; by default the last one of a meshed scene."""
    scene_default: KeptStates = (
        "last" if scene.is_meshed and scene.history_on_curve is None else "none"
    )
    return scene_default if config.output.fields == "auto" else config.output.fields


def automatic_keys(config: Config, decided: Config) -> list[str]:
    """Return the keys that the program decided, such as `mesh.h_contact` or `indenter.center`."""
    is_section_replaced = {
        name: getattr(config, name) is not getattr(decided, name)
        for name in allowed_keys_at((), {})
    }
    # The center belongs to the section of the indenter.
    changed = [
        name
        for name, is_replaced in is_section_replaced.items()
        if is_replaced or name == "indenter"
    ]
    given_values, decided_values = (
        dict(leaf_values(to_mapping(version, changed))) for version in (config, decided)
    )
    return [key for key, value in decided_values.items() if given_values.get(key) != value]


def _material_sections(config: Config, scene: Scene) -> dict[str, Any]:
    """Return the material sections with the formulation of each region."""
    if isinstance(config.body, MeshFromFile):
        return _imported_mesh_sections(config, config.body, scene)
    formulations = [region.formulation for region in scene.physics.domain.regions]
    count = len(config.layers)
    body = config.body
    if body.inclusions:
        body = dataclasses.replace(
            body, inclusions=_set_formulations(body.inclusions, formulations[count:])
        )
    if body.layers is None:
        return {
            "material": _replace_auto(config.material, formulation=formulations[0]),
            "body": body,
        }
    layers = _set_formulations(config.layers, formulations[:count])
    return {"material": None, "body": dataclasses.replace(body, layers=layers)}


def _set_formulations(items: Sequence[Any], formulations: Sequence[str]) -> tuple[Any, ...]:
    """Return layers or inclusions with the given formulations."""
    pairs = zip(items, formulations, strict=True)
    return tuple(
        dataclasses.replace(item, material=_replace_auto(item.material, formulation=formulation))
        for item, formulation in pairs
    )


def _imported_mesh_sections(config: Config, body: MeshFromFile, scene: Scene) -> dict[str, Any]:
    """Return the materials by region, and the path of the copied mesh file in the result folder."""
    domain = scene.physics.domain
    formulations = {region.name: region.formulation for region in domain.regions}
    region_laws = {
        name: _replace_auto(law, formulation=formulations[f"regions.{name}"])
        for name, law in (body.regions or {}).items()
    }
    default_material = config.material and _replace_auto(
        config.material, formulation=formulations.get("body", "auto")
    )
    sides = "free" if body.sides == "auto" else body.sides
    copy = dataclasses.replace(
        body,
        sides=sides,
        file=MESH_FILE,
        surfaces=body.surface_names,
        hash=domain.file_hash,
        regions=region_laws or None,
    )
    return {"body": copy, "material": default_material}


def _replace_auto(section: Any, **values: Any) -> Any:
    """Replace the values "auto" of a section; values given by the user are unchanged."""
    return dataclasses.replace(
        section, **{k: v for k, v in values.items() if getattr(section, k, None) == "auto"}
    )


def _mesh_section(config: Config, scene: Scene) -> Any:
    """Return the section `mesh` with the element sizes of the scene."""
    if scene.sizes.refinements is not None:
        return dataclasses.replace(config.mesh, refinements=scene.sizes.refinements)
    sizes = scene.sizes
    L = scene.physics.scales.length
    h_contact = sizes.h_contact * L
    h_far = sizes.h_far * L
    symmetry = scene.physics.domain.symmetry
    mesh = _replace_auto(
        config.mesh, h_contact=h_contact, h_far=h_far, grading=sizes.grading, symmetry=symmetry
    )
    if sizes.inclusions and mesh.h_inclusions is None:
        mesh = dataclasses.replace(mesh, h_inclusions=tuple(h * L for _, h in sizes.inclusions))
    if sizes.coatings:
        mesh = _replace_auto(mesh, h_layers=tuple(h * L for _, h in sizes.coatings))
    if config.mesh.h_contact != "auto":
        return mesh
    local_sizes = {
        name: length * L
        for name in ("h_axis", "h_edge", "h_corner", "h_film")
        if (length := getattr(sizes, name))
    }
    return dataclasses.replace(mesh, **local_sizes)


def _contact_section(config: Config, scene: Scene) -> Any:
    """Return the section `contact` with the contact law of the scene."""
    law = scene.physics.scales.to_user_units(scene.physics.contact)
    settings = config.contact
    # The program chose another contact law: it takes over the settings that both laws have.
    if not isinstance(settings, type(law)):
        shared = {f.name for f in dataclasses.fields(law)} - {"method"}
        settings = type(law)(
            **{name: value for name, value in vars(settings).items() if name in shared}
        )
    return _replace_auto(settings, **vars(law) | {"gap": scene.physics.gap})
