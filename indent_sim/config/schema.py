"""Schema of the scene file: its sections with their keys, types, ranges and defaults.

The dataclasses of `model` define the sections body, material, indenter, contact and loading, and
the dataclasses of `scene_sections` define the other sections. Reader, error messages, JSON Schema
and docs/config.md are derived from this schema.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, get_args, get_origin

from pydantic import model_validator

from indent_sim.config import number_limits
from indent_sim.config.body_checks import (
    cap_errors,
    ellipsoid_errors,
    inclusion_errors,
    layer_errors,
    resting_body_errors,
    surface_tension_errors,
)
from indent_sim.config.key_types import (
    bare_type,
    default_of,
    field_names,
    field_types,
    tag_of,
    type_of_tag,
    union_members,
)
from indent_sim.config.loading_checks import history_errors, load_path_errors
from indent_sim.config.material_checks import (
    flow_errors,
    material_errors,
    plasticity_errors,
    relaxation_errors,
)
from indent_sim.config.mesh_checks import accuracy_errors, mesh_file_errors
from indent_sim.config.path_checks import directory_errors
from indent_sim.config.scene_sections import AccuracyPreset as AccuracyPreset
from indent_sim.config.scene_sections import KeptStates as KeptStates
from indent_sim.config.scene_sections import MeshSettings as MeshSettings
from indent_sim.config.scene_sections import OutputSettings as OutputSettings
from indent_sim.config.scene_sections import SceneSections
from indent_sim.config.scene_sections import SolverSettings as SolverSettings
from indent_sim.config.scene_sections import Source as Source
from indent_sim.config.scene_sections import Units as Units
from indent_sim.config.slide_checks import slide_errors
from indent_sim.config.strict_yaml import KeyPath
from indent_sim.config.tip_checks import (
    center_errors,
    contact_errors,
    experiment_errors,
    soft_tip_errors,
    tilt_errors,
    tip_errors,
)
from indent_sim.config.unload_checks import unload_errors
from indent_sim.model.units import FORCE, Unit, UnitRow, unit_of
from indent_sim.process.errors import ConfigErrors

# Keys that earlier versions had in `experiment`, and their present sections.
MOVED_KEYS = {"relaxation": "material", "history": "loading", "force_history": "loading"}
# Problem and remedy of each key that earlier versions had.
REMOVED_KEYS = {
    ("solver", "petsc"): (
        "was removed; the keys of solver are linear, method, rtol and max_iterations",
        "set PETSC_OPTIONS in the environment to tune PETSc",
    ),
    **{
        ("experiment", key): ("has moved", f"write {section}.{key}")
        for key, section in MOVED_KEYS.items()
    },
}
# Fields of Config that belong to the section `indenter` in a file: place and tilt of the tip.
PLACEMENT_KEYS = ("center", "tilt", "tilt_towards")
# Keys that select the dataclass of a section, at any depth.
TAG_KEYS = {"shape", "model", "method"}
# Checks of a config, in the order in which their errors are reported.
CONSISTENCY_CHECKS = (
    cap_errors,
    ellipsoid_errors,
    resting_body_errors,
    layer_errors,
    surface_tension_errors,
    inclusion_errors,
    material_errors,
    plasticity_errors,
    flow_errors,
    contact_errors,
    load_path_errors,
    center_errors,
    tip_errors,
    tilt_errors,
    soft_tip_errors,
    history_errors,
    slide_errors,
    unload_errors,
    relaxation_errors,
    experiment_errors,
    accuracy_errors,
    mesh_file_errors,
    directory_errors,
)


class Config(SceneSections):
    """Validated scene file with defaults; values "auto" are not yet decided."""

    @model_validator(mode="after")
    def _check_consistency(self) -> Config:
        """Return the config if its keys are consistent; raise ConfigErrors otherwise."""
        given = {name: part for name in sections() if (part := getattr(self, name)) is not None}
        errors = number_limits.limit_errors(given)
        if not errors:
            errors = [error for check in CONSISTENCY_CHECKS for error in check(self)]
        if errors:
            raise ConfigErrors.combine(errors)
        return self


@cache
def section_tags() -> dict[str, str]:
    """Return the key by which each section selects an alternative, such as body -> shape."""
    return {
        name: tag for name, hint in field_types(Config).items() if (tag := tag_of(hint)) is not None
    }


@cache
def sections() -> dict[str, tuple[type, ...]]:
    """Return the sections of the file in order, each with its possible dataclasses."""
    types_by_name = {name: union_members(hint) for name, hint in field_types(Config).items()}
    return {
        name: kinds for name, kinds in types_by_name.items() if dataclasses.is_dataclass(kinds[0])
    }


@dataclass(frozen=True)
class SchemaNode:
    """Node of a document: its type by the schema, its default, and its value.

    `type` is None if the schema has no such key; `value` is None if the document has no value.
    """

    path: KeyPath
    type: Any
    default: Any
    value: Any

    @property
    def tag(self) -> str | None:
        """Key that selects the dataclass of this section; None if there are no alternatives."""
        return tag_of(self.type)

    @cached_property
    def tag_value(self) -> Any:
        """Value of the tag in the section, or in its default."""
        default = getattr(self.default, self.tag, None) if self.tag else None
        if isinstance(self.value, Mapping) and self.tag:
            return self.value.get(self.tag, default)
        return default

    @cached_property
    def section_type(self) -> Any:
        """Dataclass of this section; None for a value, or if no dataclass is selected."""
        if not self.path:
            return Config
        return type_of_tag(self.type, self.tag_value) if self.type is not None else None

    def child(self, part: str | int) -> SchemaNode:
        """Return the node of a key of this section, or of an item of this list."""
        value = self.value[part] if has_part(self.value, part) else None
        path = (*self.path, part)
        kind = self.section_type
        if self.path == ("indenter",) and part in PLACEMENT_KEYS:
            name = str(part)
            return SchemaNode(path, field_types(Config)[name], None, value)
        if kind is not None and part in field_names(kind):
            return SchemaNode(
                path, field_types(kind)[str(part)], default_of(kind, str(part)), value
            )
        if kind is not None:
            return SchemaNode(path, None, None, value)
        kinds = [bare_type(member) for member in union_members(self.type)]
        # A list or mapping may be an alternative to a word.
        container = next(
            (kind for kind in kinds if get_origin(kind) in (tuple, dict)), bare_type(self.type)
        )
        item_type = None
        if get_origin(container) is tuple:
            item_type = get_args(container)[0]
        elif get_origin(container) is dict:
            item_type = get_args(container)[1]
        return SchemaNode(path, item_type, None, value)

    def children(self) -> Iterator[SchemaNode]:
        """Yield the nodes of all values inside this node."""
        if isinstance(self.value, Mapping):
            yield from (self.child(key) for key in self.value)
        elif isinstance(self.value, (list, tuple)) and len(self.value):
            # All items of a list have one type.
            item = self.child(0)
            for k, value in enumerate(self.value):
                yield dataclasses.replace(item, path=(*self.path, k), value=value)

    def allowed_keys(self) -> tuple[str, ...]:
        """Return the keys that this section may have."""
        if not self.path:
            return tuple(name for name in field_names(Config) if name not in PLACEMENT_KEYS)
        names = file_order(self.section_type) if dataclasses.is_dataclass(self.section_type) else ()
        return (*names, *PLACEMENT_KEYS) if self.path == ("indenter",) else names


def node_at(path: KeyPath, document: Any) -> SchemaNode:
    """Return the node of a key path in a document."""
    node = SchemaNode((), Config, None, document)
    for part in path:
        node = node.child(part)
    return node


def node_unit(node: SchemaNode, document: Mapping[str, Any]) -> Unit | UnitRow | None:
    """Return the dimension of a node of a document; None without a dimension.

    The end of unloading is a force where forces are prescribed, otherwise a depth.
    """
    loading = document.get("loading")
    is_forced = isinstance(loading, Mapping) and ("force" in loading or "forces" in loading)
    if node.path == ("loading", "unload", "to") and is_forced:
        return FORCE
    return unit_of(node.type)


def allowed_keys_at(path: KeyPath, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys that a section of the document may have; the path of the root is ()."""
    return node_at(path, document).allowed_keys()


def file_order(kind: Any) -> tuple[str, ...]:
    """Return the fields of a dataclass in the order of a file: the tag first."""
    return _file_order(kind)


@cache
def _file_order(kind: Any) -> tuple[str, ...]:
    """Return the result of `file_order` from a cache; mypy regards not every class as hashable."""
    tags = [
        name
        for name in TAG_KEYS & set(field_names(kind))
        if len(get_args(field_types(kind)[name])) == 1
    ]
    return tuple(sorted(field_names(kind), key=lambda name: name not in tags))


def has_part(value: Any, part: str | int) -> bool:
    """Return whether a section has a key, or a list has an item with this index."""
    if isinstance(value, (list, tuple)):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, Mapping) and part in value
