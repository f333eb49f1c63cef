"""The config that reproduces a run: every "auto" replaced by what it became, in the user's units."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

from indent_sim.config.file import to_mapping
from indent_sim.config.schema import Config, When
from indent_sim.mesh.meshed import MeshedPart
from indent_sim.mesh.piece import Piece, Skin, as_msh
from indent_sim.model.body import MeshFromFile
from indent_sim.results.folder import MESH
from indent_sim.scene.given import with_used_material
from indent_sim.scene.scene import Scene

OWN = ("h_axis", "h_edge", "h_corner")  # sizes that a scene may have or not


def resolved(config: Config, scene: Scene) -> Config:
    """The same scene with nothing left to decide: it gives the same mesh and the same numbers."""
    config = with_used_material(config, scene.physics.part)
    decided: dict[str, Any] = {
        "center": config.center or config.body.center,
        "accuracy": None,
        "solver": _decided(config.solver, method=scene.solver.method, linear=scene.solver.linear),
        "output": dataclasses.replace(config.output, fields=fields_of(config, scene)),
        "contact": _decided(config.contact, gap=scene.physics.gap),
    }
    return config.model_copy(update=decided | (_of_mesh(config, scene) if scene.is_meshed else {}))


def fields_of(config: Config, scene: Scene) -> When:
    """The steps whose fields are written: where the config does not say, those of a mesh."""
    wanted = config.output.fields
    if wanted != "auto":
        return wanted
    return "last" if scene.is_meshed else "none"


def _of_mesh(config: Config, scene: Scene) -> dict[str, Any]:
    return {
        **_materials(config, scene),
        "contact": _contact(config, scene),
        "mesh": _mesh(config, scene),
    }


def mesh_text(config: Config, piece: Piece | None) -> Iterable[str]:
    """What the file `MESH` of a result folder has to say, on rank 0; nothing where the body is meshed here."""
    if piece is None or not isinstance(config.body, MeshFromFile):
        return ()
    whole = piece.whole if isinstance(piece, Skin) else piece
    return as_msh(whole, config.body) if whole is not None else ()


def left_open(config: Config, decided: Config) -> list[str]:
    """The keys that the program decided, as in `mesh.h_contact`; `center` stands in the indenter."""
    before, after = to_mapping(config), to_mapping(decided)
    return [
        f"{section}.{key}"
        for section, part in after.items()
        if isinstance(part, dict)
        for key, value in part.items()
        if before[section].get(key) != value
    ]


def _materials(config: Config, scene: Scene) -> dict[str, Any]:
    """The material, and those of layers and inclusions, with the formulation that each region has."""
    if isinstance(config.body, MeshFromFile) and isinstance(scene.physics.part, MeshedPart):
        return _of_file(config, config.body, scene.physics.part)
    formulations = [region.formulation for region in scene.physics.part.regions]
    count, body = len(config.layers), config.body
    if body.inclusions:
        body = dataclasses.replace(body, inclusions=_all_decided(body.inclusions, formulations[count:]))
    if body.layers is None:
        return {"material": _decided(config.material, formulation=formulations[0]), "body": body}
    layers = _all_decided(config.layers, formulations[:count])
    return {"material": None, "body": dataclasses.replace(body, layers=layers)}


def _all_decided(items: Sequence[Any], formulations: Sequence[str]) -> tuple[Any, ...]:
    """Layers, or inclusions, with the formulation that each has."""
    return tuple(dataclasses.replace(item, material=_decided(item.material, formulation=formulation))
                 for item, formulation in zip(items, formulations, strict=True))  # fmt: skip


def _of_file(config: Config, body: MeshFromFile, part: MeshedPart) -> dict[str, Any]:
    """The materials by name, and the copy of the mesh in the result folder."""
    formulations = dict(zip(part.piece.names, (region.formulation for region in part.regions), strict=True))
    regions = {name: _decided(own, formulation=formulations[name]) for name, own in (body.regions or {}).items()}
    rest = config.material and _decided(config.material, formulation=formulations.get("", "auto"))
    copy = dataclasses.replace(body, file=MESH, hash=part.piece.hash, regions=regions or None)
    return {"body": copy, "material": rest}


def _decided(section: Any, **found: Any) -> Any:
    """A section with its "auto"s replaced; what was given stays, to the last digit."""
    auto = {name: value for name, value in found.items() if getattr(section, name, None) == "auto"}
    return dataclasses.replace(section, **auto)


def _mesh(config: Config, scene: Scene) -> Any:
    if scene.sizes.refinements is not None:
        return dataclasses.replace(config.mesh, refinements=scene.sizes.refinements)
    sizes, L = scene.sizes, scene.physics.scales.length
    mesh = _decided(config.mesh, h_contact=sizes.h_contact * L, h_far=sizes.h_far * L, grading=sizes.grading,
                    symmetry=scene.physics.part.symmetry)  # fmt: skip
    if sizes.inclusions and mesh.h_inclusions is None:
        mesh = dataclasses.replace(mesh, h_inclusions=tuple(h * L for _, h in sizes.inclusions))
    if config.mesh.h_contact != "auto":
        return mesh
    own = {name: length * L for name in OWN if (length := getattr(sizes, name))}
    return dataclasses.replace(mesh, **own)


def _contact(config: Config, scene: Scene) -> Any:
    law = scene.physics.scales.unscaled(scene.physics.contact)
    given = config.contact if isinstance(config.contact, type(law)) else _of_kind(type(law), config.contact)
    return _decided(given, **vars(law) | {"gap": scene.physics.gap})


def _of_kind(kind: type[Any], given: Any) -> Any:
    """A law of a kind with all that another says of it too."""
    shared = {f.name for f in dataclasses.fields(kind)} - {"method"}
    return kind(**{name: value for name, value in vars(given).items() if name in shared})
