"""The config that reproduces a run: every "auto" replaced by what it became, in the user's units."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from indent_sim.config.scene_file import to_mapping
from indent_sim.config.schema import Config, KeptStates, allowed_keys_at
from indent_sim.config.strict_yaml import leaf_values
from indent_sim.model.drainage import Drainage
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.results.folder import MESH_FILE
from indent_sim.scene.problem_setup import remove_unused_material
from indent_sim.scene.scene import Scene


def explicit_config(config: Config, scene: Scene) -> Config:
    """The same scene with nothing left to decide: it gives the same mesh and the same numbers."""
    config = remove_unused_material(config, scene.physics.domain)
    gap = scene.physics.gap
    output = dataclasses.replace(config.output, fields=written_fields(config, scene))
    solver = _replace_auto(config.solver, method=scene.solver.method, linear=scene.solver.linear)
    decided: dict[str, Any] = {
        "center": config.center or config.body.center,
        "accuracy": None,
        "solver": solver,
    }
    decided |= {"output": output, "contact": _replace_auto(config.contact, gap=gap)}
    if scene.physics.bath_ramp:
        decided["drainage"] = _replace_auto(
            config.drainage or Drainage(), bath_ramp=scene.physics.bath_ramp
        )
    if scene.is_meshed:
        decided |= _material_sections(config, scene) | {
            "contact": _contact_section(config, scene),
            "mesh": _mesh_section(config, scene),
        }
    return config.model_copy(update=decided)


def written_fields(config: Config, scene: Scene) -> KeptStates:
    """The steps whose fields are written: where the config does not say, those of a mesh."""
    scene_default: KeptStates = (
        "last" if scene.is_meshed and scene.history_on_curve is None else "none"
    )
    return scene_default if config.output.fields == "auto" else config.output.fields


def automatic_keys(config: Config, decided: Config) -> list[str]:
    """The keys that the program decided, as in `mesh.h_contact`; `center` stands in the indenter."""
    is_other = {
        name: getattr(config, name) is not getattr(decided, name)
        for name in allowed_keys_at((), {})
    }
    changed = [
        name for name, is_replaced in is_other.items() if is_replaced or name == "indenter"
    ]  # which has the center
    given_values, decided_values = (
        dict(leaf_values(to_mapping(version, changed))) for version in (config, decided)
    )
    return [key for key, value in decided_values.items() if given_values.get(key) != value]


def _material_sections(config: Config, scene: Scene) -> dict[str, Any]:
    """The material, and those of layers and inclusions, with the formulation that each region has."""
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
    """Layers, or inclusions, with the formulation that each has."""
    pairs = zip(items, formulations, strict=True)
    return tuple(
        dataclasses.replace(item, material=_replace_auto(item.material, formulation=formulation))
        for item, formulation in pairs
    )


def _imported_mesh_sections(config: Config, body: MeshFromFile, scene: Scene) -> dict[str, Any]:
    """The materials by name, and the copy of the mesh in the result folder."""
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


def _replace_auto(section: Any, **decided: Any) -> Any:
    """A section with its "auto"s replaced; what was given stays, to the last digit."""
    return dataclasses.replace(
        section, **{k: v for k, v in decided.items() if getattr(section, k, None) == "auto"}
    )


def _mesh_section(config: Config, scene: Scene) -> Any:
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
    law = scene.physics.scales.to_user_units(scene.physics.contact)
    settings = config.contact
    if not isinstance(
        settings, type(law)
    ):  # a law of its kind with all that the other says of it too
        shared = {f.name for f in dataclasses.fields(law)} - {"method"}
        settings = type(law)(
            **{name: value for name, value in vars(settings).items() if name in shared}
        )
    return _replace_auto(settings, **vars(law) | {"gap": scene.physics.gap})
