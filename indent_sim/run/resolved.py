"""The config that reproduces a run: every "auto" replaced by what it became, in the user's units."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from indent_sim.config.scene_file import to_mapping
from indent_sim.config.schema import Config, When, keys_at
from indent_sim.config.strict_yaml import leaves
from indent_sim.model.body import Drainage, MeshFromFile
from indent_sim.results.folder import MESH_FILE
from indent_sim.scene.problem_setup import remove_unused_material
from indent_sim.scene.scene import Scene


def resolved(config: Config, scene: Scene) -> Config:
    """The same scene with nothing left to decide: it gives the same mesh and the same numbers."""
    config = remove_unused_material(config, scene.physics.domain)
    gap = scene.physics.gap
    output = dataclasses.replace(config.output, fields=fields_of(config, scene))
    solver = _decided(config.solver, method=scene.solver.method, linear=scene.solver.linear)
    decided: dict[str, Any] = {
        "center": config.center or config.body.center,
        "accuracy": None,
        "solver": solver,
    }
    decided |= {"output": output, "contact": _decided(config.contact, gap=gap)}
    if scene.physics.bath_ramp:
        decided["drainage"] = _decided(
            config.drainage or Drainage(), bath_ramp=scene.physics.bath_ramp
        )
    if scene.is_meshed:
        decided |= _materials(config, scene) | {
            "contact": _contact(config, scene),
            "mesh": _mesh(config, scene),
        }
    return config.model_copy(update=decided)


def fields_of(config: Config, scene: Scene) -> When:
    """The steps whose fields are written: where the config does not say, those of a mesh."""
    of_scene: When = "last" if scene.is_meshed and scene.history_on_curve is None else "none"
    return of_scene if config.output.fields == "auto" else config.output.fields


def left_open(config: Config, decided: Config) -> list[str]:
    """The keys that the program decided, as in `mesh.h_contact`; `center` stands in the indenter."""
    is_other = {
        name: getattr(config, name) is not getattr(decided, name) for name in keys_at((), {})
    }
    changed = [
        name for name, other in is_other.items() if other or name == "indenter"
    ]  # which has the center
    before, after = (dict(leaves(to_mapping(one, changed))) for one in (config, decided))
    return [key for key, value in after.items() if before.get(key) != value]


def _materials(config: Config, scene: Scene) -> dict[str, Any]:
    """The material, and those of layers and inclusions, with the formulation that each region has."""
    if isinstance(config.body, MeshFromFile):
        return _of_file(config, config.body, scene)
    formulations = [region.formulation for region in scene.physics.domain.regions]
    count = len(config.layers)
    body = config.body
    if body.inclusions:
        body = dataclasses.replace(
            body, inclusions=_all_decided(body.inclusions, formulations[count:])
        )
    if body.layers is None:
        return {"material": _decided(config.material, formulation=formulations[0]), "body": body}
    layers = _all_decided(config.layers, formulations[:count])
    return {"material": None, "body": dataclasses.replace(body, layers=layers)}


def _all_decided(items: Sequence[Any], formulations: Sequence[str]) -> tuple[Any, ...]:
    """Layers, or inclusions, with the formulation that each has."""
    pairs = zip(items, formulations, strict=True)
    return tuple(
        dataclasses.replace(one, material=_decided(one.material, formulation=form))
        for one, form in pairs
    )


def _of_file(config: Config, body: MeshFromFile, scene: Scene) -> dict[str, Any]:
    """The materials by name, and the copy of the mesh in the result folder."""
    part = scene.physics.domain
    formulations = {region.name: region.formulation for region in part.regions}
    own = {
        name: _decided(law, formulation=formulations[f"regions.{name}"])
        for name, law in (body.regions or {}).items()
    }
    rest = config.material and _decided(
        config.material, formulation=formulations.get("body", "auto")
    )
    sides = "free" if body.sides == "auto" else body.sides
    copy = dataclasses.replace(
        body,
        sides=sides,
        file=MESH_FILE,
        surfaces=body.named,
        hash=part.file_hash,
        regions=own or None,
    )
    return {"body": copy, "material": rest}


def _decided(section: Any, **decided: Any) -> Any:
    """A section with its "auto"s replaced; what was given stays, to the last digit."""
    return dataclasses.replace(
        section, **{k: v for k, v in decided.items() if getattr(section, k, None) == "auto"}
    )


def _mesh(config: Config, scene: Scene) -> Any:
    if scene.sizes.refinements is not None:
        return dataclasses.replace(config.mesh, refinements=scene.sizes.refinements)
    sizes = scene.sizes
    L = scene.physics.scales.length
    near = sizes.h_contact * L
    far = sizes.h_far * L
    symmetry = scene.physics.domain.symmetry
    mesh = _decided(
        config.mesh, h_contact=near, h_far=far, grading=sizes.grading, symmetry=symmetry
    )
    if sizes.inclusions and mesh.h_inclusions is None:
        mesh = dataclasses.replace(mesh, h_inclusions=tuple(h * L for _, h in sizes.inclusions))
    if sizes.skins:
        mesh = _decided(mesh, h_layers=tuple(h * L for _, h in sizes.skins))
    if config.mesh.h_contact != "auto":
        return mesh
    own = {
        name: length * L
        for name in ("h_axis", "h_edge", "h_corner", "h_film")
        if (length := getattr(sizes, name))
    }
    return dataclasses.replace(mesh, **own)


def _contact(config: Config, scene: Scene) -> Any:
    law = scene.physics.scales.unscaled(scene.physics.contact)
    given = config.contact
    if not isinstance(given, type(law)):  # a law of its kind with all that the other says of it too
        shared = {f.name for f in dataclasses.fields(law)} - {"method"}
        given = type(law)(**{name: value for name, value in vars(given).items() if name in shared})
    return _decided(given, **vars(law) | {"gap": scene.physics.gap})
