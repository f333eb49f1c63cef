"""JSON Schema of the scene file, derived from `schema` and the table of symbols."""

from __future__ import annotations

import copy
import dataclasses
import inspect
from collections.abc import Iterator
from typing import Any, get_args

from pydantic.json_schema import GenerateJsonSchema

from indent_sim.config import key_types, schema
from indent_sim.config.key_types import (
    allowed_words,
    bare_type,
    field_types,
    types_by_tag,
    union_members,
)
from indent_sim.config.schema import Config
from indent_sim.model.loading import PATH_KEYS, STEPPED_KEYS
from indent_sim.model.symbols import lookup


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the scene file, for editors and other programs."""
    document = Config.model_json_schema(schema_generator=_SchemaGenerator)
    placement = {name: document["properties"].pop(name) for name in schema.PLACEMENT_KEYS}
    for kind in schema.sections()["indenter"]:
        document["$defs"][kind.__name__]["properties"] |= copy.deepcopy(placement)
    # The number of steps belongs to a single depth or force.
    unstepped_paths = [
        {"required": [path_key], "not": {"required": ["steps"]}}
        for path_key in PATH_KEYS
        if path_key not in STEPPED_KEYS
    ]
    one_of = [{"required": ["delta"]}, {"required": ["force"]}, *unstepped_paths]
    document["$defs"]["Loading"]["oneOf"] = one_of
    sections = {kind.__name__: section for section, kind in sections_and_kinds()}
    for kind, definition in document["$defs"].items():
        for name, value in definition.get("properties", {}).items():
            symbol = lookup(name, sections.get(kind, ""))
            if symbol and symbol.dimension not in ("1", "word"):
                definition["properties"][name] = _allow_quantities(value)
    return {"$schema": GenerateJsonSchema.schema_dialect, **document, "title": "indent-sim scene"}


def _allow_quantities(value: dict[str, Any]) -> dict[str, Any]:
    """Extend the JSON Schema of a number with a dimension by text such as "2.5 um"."""
    if "anyOf" in value:
        return value | {"anyOf": [_allow_quantities(part) for part in value["anyOf"]]}
    if value.get("type") == "array":
        return value | {key: _allow_quantities(value[key]) for key in ("items",) if key in value}
    if value.get("type") != "number":
        return value
    metadata = {key: value.pop(key) for key in ("description", "default") if key in value}
    # Schema of a number with a unit, e.g. "2.5 um".
    quantity_schema = {
        "type": "string",
        "pattern": r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*[A-Za-zµ°]",
    }
    return metadata | {"anyOf": [value, quantity_schema]}


class _SchemaGenerator(GenerateJsonSchema):
    """JSON Schema generator that adds descriptions, required tags and short forms.

    In a short form, one word such as "fixed" sets all fields of a section, e.g. all walls of a box.
    """

    def dataclass_schema(self, schema: Any) -> Any:
        """Return the JSON Schema of a section."""
        definition = super().dataclass_schema(schema)
        section = next(
            (section for section, kind in sections_and_kinds() if kind is schema["cls"]), ""
        )
        return _add_descriptions(definition, schema["cls"], section)

    def model_schema(self, schema: Any) -> Any:
        """Return the JSON Schema of the whole file."""
        return _add_descriptions(super().model_schema(schema), Config, "")


def _add_descriptions(definition: Any, kind: Any, section: str) -> Any:
    """Return the JSON Schema of a dataclass with descriptions, without titles and null defaults."""
    for name, entry in definition["properties"].items():
        entry.pop("title", None)
        if entry.get("default", "") is None:
            del entry["default"]
        if symbol := lookup(name, section):
            unit = "" if symbol.dimension in ("word", "1") else f" [{symbol.dimension}]"
            entry["description"] = symbol.meaning + unit
        hint = bare_type(field_types(kind)[name])
        if section and allowed_words(hint) and dataclasses.is_dataclass(hint):
            words = list(get_args(key_types.shared_field_type(hint)))
            entry["anyOf"] = [{"enum": words, "type": "string"}, {"$ref": entry.pop("$ref")}]
            entry["default"] = next(iter(entry["default"].values()))
    tag = schema.section_tags().get(section)
    if tag and kind is not type(Config.model_fields[section].default):
        definition["properties"][tag].pop("default")
        definition["required"] = [tag, *definition.get("required", ())]
    return definition


def section_alternatives(section: str) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Yield the alternatives of a section, such as the shapes of a body.

    Yields
    ------
    choice
        Value of the section's tag.
    summary
        First line of the documentation of the alternative.
    keys
        Name, allowed values, unit and meaning of each key.
    """
    tag = schema.section_tags()[section]
    for choice, kind in types_by_tag(field_types(Config)[section], tag).items():
        keys = []
        for name in schema.file_order(kind):
            if name != tag and (symbol := lookup(name, section)):
                unit = f"[{symbol.dimension}]" if symbol.dimension not in ("word", "1") else ""
                keys.append(
                    [name, key_types.describe_type(field_types(kind)[name]), unit, symbol.meaning]
                )
        yield choice, inspect.cleandoc(kind.__doc__ or "").split("\n")[0], keys


def sections_and_kinds() -> Iterator[tuple[str, type]]:
    """Yield each section with each of its possible dataclasses, then their inner sections."""
    outer = [(section, kind) for section, kinds in schema.sections().items() for kind in kinds]
    yield from outer
    for _, owner in outer:
        for name, hint in field_types(owner).items():
            for member in union_members(hint):
                if dataclasses.is_dataclass(bare_type(member)):
                    yield name, bare_type(member)
