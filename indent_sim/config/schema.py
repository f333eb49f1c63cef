"""Schema of the scene file: its sections with their keys, types, ranges and defaults.

The dataclasses of `model` are the schema of body, material, indenter, contact and loading; those of
this module are the schema of the other sections. Reader, error messages, JSON Schema and
docs/config.md are all derived from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Len, Lt, MinLen
from pydantic import BaseModel, ConfigDict, PrivateAttr, model_validator

from indent_sim.config import number_limits
from indent_sim.config.body_checks import (
    cap_errors,
    inclusion_errors,
    key_of_inclusion,
    key_of_layer,
    layer_errors,
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
from indent_sim.config.material_checks import flow_errors, material_errors, relaxation_errors
from indent_sim.config.mesh_checks import accuracy_errors, mesh_file_errors
from indent_sim.config.path_checks import directory_errors
from indent_sim.config.strict_yaml import KeyPath
from indent_sim.config.tip_checks import (
    center_errors,
    contact_errors,
    experiment_errors,
    tip_errors,
)
from indent_sim.model.body import AnyBody
from indent_sim.model.contact import AutoContact, Contact
from indent_sim.model.drainage import Drainage
from indent_sim.model.experiment import Experiment
from indent_sim.model.layers import Layer
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.tips import Indenter
from indent_sim.model.units import LENGTH, Auto, Coordinate, Length, PositiveInt, TaggedBy
from indent_sim.process.errors import ConfigErrors

# Largest relative tolerance of the residual. The contact force of every row must equal the
# reactions to 1e-8 (run/single_run.py); with a larger tolerance, which would save one iteration, a
# row could fail this check.
MAX_RTOL = 1e-9
# Largest number of uniform refinements of a mesh from a file. Six of them divide a cell of a
# two-dimensional mesh into 4096.
MAX_REFINEMENTS = 6
LINEAR_ELEMENTS_GONE = (
    "linear elements were removed: with as many unknowns quadratic ones give a force ten "
    "times as accurate"
)
# States of the load path that are written.
KeptStates = Literal["none", "last", "all"]
AccuracyPreset = Literal["fast", "balanced", "accurate"]
# Keys that were once in `experiment`, and their present sections.
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
# Keys that select the dataclass of a section, at any depth.
TAG_KEYS = {"shape", "model", "method"}
# Checks of a config, in the order in which their errors are reported.
CONSISTENCY_CHECKS = (
    cap_errors,
    layer_errors,
    surface_tension_errors,
    inclusion_errors,
    material_errors,
    flow_errors,
    contact_errors,
    load_path_errors,
    center_errors,
    tip_errors,
    history_errors,
    relaxation_errors,
    experiment_errors,
    accuracy_errors,
    mesh_file_errors,
    directory_errors,
)


@dataclass(frozen=True)
class Units:
    """Units of plain numbers, by name.

    Quantities with a unit of their own are converted to them.
    """

    length: str = ""
    force: str = ""


@dataclass(frozen=True)
class MeshSettings:
    """Element sizes [length] and the part of the body that is modelled."""

    h_contact: Length | Auto = "auto"
    h_axis: Length | None = None
    h_edge: Length | None = None
    h_corner: Length | None = None
    h_film: Length | None = None
    h_inclusions: Annotated[tuple[Annotated[float, Gt(0)], ...], Len(1, 50), LENGTH] | None = None
    h_layers: Annotated[tuple[Annotated[float, Gt(0)], ...], Len(1, 50), LENGTH] | None = None
    h_far: Length | Auto = "auto"
    grading: Annotated[float, Gt(0), Le(1)] | Auto = "auto"
    order: Annotated[Literal[2], LINEAR_ELEMENTS_GONE] = 2
    refinements: Annotated[int, Ge(0), Le(MAX_REFINEMENTS)] | None = None
    symmetry: Literal["auto", "axisymmetric", "plane_strain", "quarter", "half", "full"] = "auto"


@dataclass(frozen=True)
class SolverSettings:
    """Solution of the equations.

    PETSc's own options are [the environment's](how_do_i.md#tune-petsc).
    """

    method: Literal["auto", "theory", "condensed", "newton"] = "auto"
    linear: Literal["auto", "direct", "iterative"] = "auto"
    rtol: Annotated[float, Gt(0), Le(MAX_RTOL)] = MAX_RTOL
    max_iterations: PositiveInt = 50


@dataclass(frozen=True)
class OutputSettings:
    """Output of a run, and its folder."""

    directory: Annotated[str, MinLen(1)] | None = None
    fields: Literal["auto", "none", "last", "all"] = "auto"
    nodal_stress: bool = False
    surface: KeptStates = "last"
    reactions: bool = False
    plot: bool = True


@dataclass(frozen=True)
class Source:
    """Source of every key of a config: file and line, or the `--set` that gave it.

    All sources are equal: two configs with the same values are equal, wherever they were written.
    """

    name: str = field(default="", compare=False)
    locations: dict[KeyPath, tuple[str, int | None]] = field(
        default_factory=dict, compare=False, repr=False
    )
    # Quantities as given, and as numbers in the units of the scene.
    quantities: dict[KeyPath, tuple[str, float]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def location(self, path: KeyPath) -> tuple[str, int | None]:
        """Return file and line of a key, or of the nearest section around it."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.locations:
                return self.locations[path[:end]]
        return self.name, None


class Config(BaseModel):
    """Checked scene file with its defaults; every "auto" is still undecided."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, revalidate_instances="always"
    )

    title: str = ""
    units: Units = Units()
    body: Annotated[AnyBody, TaggedBy("shape")]
    # Required unless every layer or region has its own material.
    material: Annotated[Material | None, TaggedBy("model")] = None
    indenter: Annotated[Indenter, TaggedBy("shape")]
    # The key in a file is `indenter.center`.
    center: Annotated[tuple[Coordinate, ...], LENGTH] | None = None
    contact: Annotated[Contact, TaggedBy("method")] = AutoContact()
    drainage: Drainage | None = None
    loading: Loading
    experiment: Experiment | None = None
    mesh: MeshSettings = MeshSettings()
    accuracy: Annotated[float, Gt(0), Lt(1)] | AccuracyPreset | None = None
    solver: SolverSettings = SolverSettings()
    output: OutputSettings = OutputSettings()

    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def source(self) -> Source:
        """Source of every key."""
        return self._source

    @property
    def initial_bath(self) -> float:
        """Value of the bath in the undeformed state."""
        if not self.drainage:
            return 0.0
        history = self.loading.prescribed_history
        return self.drainage.bath_at(history.points[0][0] if history else 0.0)

    @property
    def instrument(self) -> Experiment:
        """Experiment of the scene; an empty one if the file has none."""
        return self.experiment or Experiment()

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Layers of the body from the top, each with its material; at least one."""
        given = self.body.layers or (Layer(getattr(self.body, "height", None)),)
        return tuple(
            dataclasses.replace(layer, material=layer.material or self.material) for layer in given
        )

    def material_key(self, layer: int) -> str:
        """Return the key of the material of a layer."""
        has_material = self.body.layers is not None and self.body.layers[layer].material is not None
        return f"body.layers[{layer}].material" if has_material else "material"

    def materials(self) -> Iterator[tuple[str, Material]]:
        """Yield every given material with its key."""
        keyed_materials = [("material", self.material)]
        keyed_materials += [
            (f"{key_of_layer(k)}.material", layer.material)
            for k, layer in enumerate(self.body.layers or ())
        ]
        keyed_materials += [
            (f"body.regions.{name}", region_material)
            for name, region_material in (getattr(self.body, "regions", None) or {}).items()
        ]
        inclusions = enumerate(self.body.inclusions or ())
        keyed_materials += [
            (f"{key_of_inclusion(k)}.material", inclusion.material) for k, inclusion in inclusions
        ]
        yield from ((key, material) for key, material in keyed_materials if material is not None)

    @model_validator(mode="after")
    def _check_consistency(self) -> Config:
        """Raise ConfigErrors with all contradictions between keys."""
        given = {name: part for name in sections() if (part := getattr(self, name)) is not None}
        errors = number_limits.limit_errors(given)
        if not errors:
            errors = [error for check in CONSISTENCY_CHECKS for error in check(self)]
        if errors:
            raise ConfigErrors.combine(errors)
        return self


@cache
def section_tags() -> dict[str, str]:
    """Return the tag key of every section that has one: body -> shape."""
    return {
        name: tag for name, hint in field_types(Config).items() if (tag := tag_of(hint)) is not None
    }


@cache
def sections() -> dict[str, tuple[type, ...]]:
    """Return the sections of the file in order, with the dataclasses that each may be."""
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
        """Key that selects the dataclass of this section; None if there is no choice."""
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
        """Return the node of a key, or of an item of a list."""
        value = self.value[part] if has_part(self.value, part) else None
        path = (*self.path, part)
        kind = self.section_type
        if path == ("indenter", "center"):
            return SchemaNode(path, field_types(Config)["center"], None, value)
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
        """Yield the nodes of all values inside this one."""
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
            return tuple(name for name in field_names(Config) if name != "center")
        names = file_order(self.section_type) if dataclasses.is_dataclass(self.section_type) else ()
        return (*names, "center") if self.path == ("indenter",) else names


def node_at(path: KeyPath, document: Any) -> SchemaNode:
    """Return the node of a key path in a document."""
    node = SchemaNode((), Config, None, document)
    for part in path:
        node = node.child(part)
    return node


def allowed_keys_at(path: KeyPath, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys that a section of the document may have; the path of the root is ()."""
    return node_at(path, document).allowed_keys()


@cache
def file_order(kind: Any) -> tuple[str, ...]:
    """Return the fields of a dataclass in the order of a file: the tag first."""
    tags = [
        name
        for name in TAG_KEYS & set(field_names(kind))
        if len(get_args(field_types(kind)[name])) == 1
    ]
    return tuple(sorted(field_names(kind), key=lambda name: name not in tags))


def has_part(value: Any, part: str | int) -> bool:
    """Return whether a section has a key, or a list an item of this number."""
    if isinstance(value, (list, tuple)):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, Mapping) and part in value
