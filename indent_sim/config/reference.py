"""The scene file described for readers and editors: docs/config.md, docs/symbols.md and the JSON Schema.

Everything is taken from the schema and the glossary; `python -m indent_sim.config.reference` writes the pages.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic.json_schema import GenerateJsonSchema

from indent_sim.config import key_types, schema
from indent_sim.config.key_types import core, describe, field_names, hints, kinds_of, members, tag_of, words_of
from indent_sim.config.schema import Config
from indent_sim.model.symbols import lookup, symbols_markdown

QUANTITY_SCHEMA = {"type": "string", "pattern": r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*[A-Za-zµ°]"}

UNLESS = {
    "material": "**required** unless every layer, or region of a mesh file, has its own",
    "loading": "**required** unless `experiment` has a history",
}


def json_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the scene file, for editors and other programs."""
    found = Config.model_json_schema(schema_generator=_Generator)
    center = found["properties"].pop("center")
    for kind in schema.sections()["indenter"]:
        found["$defs"][kind.__name__]["properties"]["center"] = center
    lists = [{"required": [way], "not": {"required": ["steps"]}} for way in ("deltas", "forces")]
    one_of = [{"required": ["delta"]}, {"required": ["force"]}, *lists]
    found["$defs"]["Loading"]["oneOf"] = one_of
    sections = {kind.__name__: section for section, kind in _kinds()}
    for kind, definition in found["$defs"].items():
        for name, value in definition.get("properties", {}).items():
            symbol = lookup(name, sections.get(kind, ""))
            if symbol and symbol.dimension not in ("1", "word"):
                definition["properties"][name] = _with_units(value)
    return {"$schema": GenerateJsonSchema.schema_dialect, **found, "title": "indent-sim scene"}


def _with_units(value: dict[str, Any]) -> dict[str, Any]:
    """The schema of a number with a dimension, which may be a quantity with its unit, or of a list of such."""
    if "anyOf" in value:
        return value | {"anyOf": [_with_units(part) for part in value["anyOf"]]}
    if value.get("type") == "array":
        return value | {key: _with_units(value[key]) for key in ("items",) if key in value}
    if value.get("type") != "number":
        return value
    about = {key: value.pop(key) for key in ("description", "default") if key in value}
    return about | {"anyOf": [value, QUANTITY_SCHEMA]}


def config_markdown() -> str:
    """docs/config.md."""
    parts = [
        "# The scene file\n\nGenerated from the schema by `python -m indent_sim.config.reference`.\n",
        "YAML 1.2; any consistent system of units. z is up, the undeformed surface is z = 0. Where `units` are given,\n"
        "numbers may carry units of their own, `2.5 um`, `1 kPa`, `3 nN`, `70 deg`, and are converted to those, times\n"
        "to seconds.\n"
        "Unknown and repeated keys are errors.\n",
        _table(["section", "default", "meaning"], map(_section_row, schema.keys_at((), {}))),
    ]
    for section, kinds in schema.sections().items():
        parts.append(f"## {section}\n")
        parts += [_kind_markdown(section, kind) for kind in kinds]
    return "\n".join(parts)


class _Generator(GenerateJsonSchema):
    """pydantic's schema with the glossary's descriptions, required tags and walls as one word."""

    def dataclass_schema(self, schema: Any) -> Any:
        found = super().dataclass_schema(schema)
        section = next((section for section, kind in _kinds() if kind is schema["cls"]), "")
        return _described(found, schema["cls"], section)

    def model_schema(self, schema: Any) -> Any:
        return _described(super().model_schema(schema), Config, "")


def _described(found: Any, kind: Any, section: str) -> Any:
    for name, entry in found["properties"].items():
        entry.pop("title", None)
        if entry.get("default", "") is None:
            del entry["default"]
        if symbol := lookup(name, section):
            unit = "" if symbol.dimension in ("word", "1") else f" [{symbol.dimension}]"
            entry["description"] = symbol.meaning + unit
        hint = core(hints(kind)[name])
        if section and words_of(hint) and dataclasses.is_dataclass(hint):
            words = list(get_args(key_types.common(hint)))
            entry["anyOf"] = [{"enum": words, "type": "string"}, {"$ref": entry.pop("$ref")}]
            entry["default"] = next(iter(entry["default"].values()))
    tag = schema.tags().get(section)
    if tag and kind is not type(Config.model_fields[section].default):
        found["properties"][tag].pop("default")
        found["required"] = [tag, *found.get("required", ())]
    return found


def _kinds() -> Iterator[tuple[str, type]]:
    """The sections with the dataclasses that each may be, then the sections inside of these."""
    outer = [(section, kind) for section, kinds in schema.sections().items() for kind in kinds]
    yield from outer
    for _, owner in outer:
        for name, hint in hints(owner).items():
            yield from ((name, core(part)) for part in members(hint) if dataclasses.is_dataclass(core(part)))


def _section_row(name: str) -> list[str]:
    field = Config.model_fields[name]
    if name not in schema.sections():
        return [f"`{name}`", _shown(field.default), _meaning(name)]
    tag = schema.tags().get(name)
    chosen = f"`{tag}: {getattr(field.default, tag, '')}`" if tag else "as below"
    default = "**required**" if field.is_required() else chosen if field.default is not None else "none"
    return [f"[`{name}`](#{name})", UNLESS.get(name, default), _meaning(name)]


def _kind_markdown(section: str, kind: type) -> str:
    tag = schema.tags().get(section)
    rows = [row for name in schema.file_order(kind) if name != tag for row in _key_rows(section, kind, name)]
    if section == "indenter":
        rows.append(["`center`", describe(hints(Config)["center"]), "", "length", _meaning("center")])
    table = _table(["key", "value", "default", "unit", "meaning"], rows)
    text = f"{inspect.cleandoc(kind.__doc__ or '')}\n\n{table}"
    values = {k: value for value, k in kinds_of(hints(Config)[section], tag).items()} if tag else {}
    return f"### `{tag}: {values[kind]}`\n\n{text}" if tag else text


def _key_rows(section: str, kind: type, name: str, outside: str = "") -> list[list[str]]:
    """The row of a key, and those of the keys inside where it is a section or a list of them."""
    hint = hints(kind)[name]
    is_list = get_origin(core(hint)) is tuple
    item = get_args(core(hint))[0] if is_list else None if words_of(hint) or tag_of(hint) else hint
    within = f"{outside}{name}[]." if is_list else f"{outside}{name}."
    symbol = lookup(name, section)
    shown = symbol.dimension if symbol and symbol.dimension not in ("word", "1") else ""
    value = f"a section as [`{name}`](#{name})" if tag_of(hint) and outside else describe(hint)
    own = [f"`{outside}{name}`", value, _default(kind, name), shown, _meaning(name, section)]
    return [own, *_rows_inside(name, item, within)]


def _rows_inside(name: str, item: Any, within: str) -> Iterator[list[str]]:
    """The rows of the keys of an item, each once: of all kinds that it may be, after the key that chooses."""
    tag, kinds = tag_of(item), [core(part) for part in members(item) if dataclasses.is_dataclass(core(part))]
    if tag:
        yield [f"`{within}{tag}`", key_types.listed(list(kinds_of(item, tag))), "**required**", "", _meaning(tag)]
    owners = {key: kind for kind in kinds for key in field_names(kind) if key != tag}
    for key, kind in owners.items():
        yield from _key_rows(name, kind, key, within)


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *([cell.replace("|", r"\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _default(kind: Any, name: str) -> str:
    field = next(f for f in dataclasses.fields(kind) if f.name == name)
    if field.default_factory is not dataclasses.MISSING:
        return _shown(field.default_factory())
    return "**required**" if field.default is dataclasses.MISSING else _shown(field.default)


def _shown(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        value = getattr(value, field_names(value)[0])
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return "" if value in (None, "") else f"`{value}`"


def _meaning(name: str, section: str = "") -> str:
    symbol = lookup(name, section)
    return symbol.meaning if symbol else ""


def pages() -> dict[str, str]:
    """The generated pages of docs/ by file name."""
    return {"config.md": config_markdown(), "symbols.md": symbols_markdown()}


def main() -> None:
    """Write the generated pages into the folder named on the command line [docs]."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs")
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
