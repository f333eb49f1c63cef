"""The scene file described for readers and editors: docs/config.md, docs/symbols.md and the JSON Schema.

Everything is taken from the schema and the glossary; `python -m indent_sim.reference` writes the pages.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

from pydantic.json_schema import GenerateJsonSchema

from indent_sim import schema
from indent_sim.hints import common, core, describe, field_names, hints, kinds_of
from indent_sim.model.quantities import Unit, unit_of
from indent_sim.schema import Config
from indent_sim.symbols import lookup, symbols_markdown

DIMENSIONS = {Unit(1, 0): "length", Unit(0, 1): "pressure", Unit(-1, 1): "pressure/length"}


def json_schema() -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the scene file, for editors and other programs."""
    found = Config.model_json_schema(schema_generator=_Generator)
    center = found["properties"].pop("center")
    for kind in schema.sections()["indenter"]:
        found["$defs"][kind.__name__]["properties"]["center"] = center
    lists = [{"required": [way], "not": {"required": ["steps"]}} for way in ("deltas", "forces")]
    one_of = [{"required": ["delta"]}, {"required": ["force"]}, *lists]
    found["$defs"]["Loading"]["oneOf"] = one_of
    return {"$schema": GenerateJsonSchema.schema_dialect, **found, "title": "indent-sim scene"}


def config_markdown() -> str:
    """docs/config.md."""
    parts = [
        "# The scene file\n\nGenerated from the schema by `python -m indent_sim.reference`.\n",
        "YAML 1.2; any consistent system of units. z is up, the undeformed surface is z = 0.\n"
        "A section without a default is required. Unknown and repeated keys are errors.\n",
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
        return _described(found, schema["cls"], _section_of(schema["cls"]))

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
        if dataclasses.is_dataclass(core(hints(kind)[name])) and section:
            _allow_one_word(entry, hints(kind)[name])
    tag = schema.tags().get(section)
    if tag and kind is not type(Config.model_fields[section].default):
        found["properties"][tag].pop("default")
        found["required"] = [tag, *found.get("required", ())]
    return found


def _allow_one_word(entry: dict[str, Any], hint: Any) -> None:
    words = get_args(common(core(hint)))
    entry["anyOf"] = [{"enum": list(words), "type": "string"}, {"$ref": entry.pop("$ref")}]
    entry["default"] = next(iter(entry["default"].values()))


def _section_of(kind: type) -> str:
    return next((name for name, kinds in schema.sections().items() if kind in kinds), "")


def _section_row(name: str) -> list[str]:
    field = Config.model_fields[name]
    if name not in schema.sections():
        return [f"`{name}`", _shown(field.default), _meaning(name)]
    default = "**required**" if field.is_required() else _shown_section(name)
    return [f"[`{name}`](#{name})", default, _meaning(name)]


def _shown_section(name: str) -> str:
    tag = schema.tags().get(name)
    return f"`{tag}: {getattr(Config.model_fields[name].default, tag)}`" if tag else "as below"


def _kind_markdown(section: str, kind: type) -> str:
    tag = schema.tags().get(section)
    rows = [_key_row(section, kind, name) for name in schema.file_order(kind) if name != tag]
    if section == "indenter":
        rows.append(["`center`", describe(hints(Config)["center"]), "", "length", _meaning("center")])
    table = _table(["key", "value", "default", "unit", "meaning"], rows)
    text = f"{inspect.cleandoc(kind.__doc__ or '')}\n\n{table}"
    values = {k: value for value, k in kinds_of(hints(Config)[section], tag).items()} if tag else {}
    return f"### `{tag}: {values[kind]}`\n\n{text}" if tag else text


def _key_row(section: str, kind: type, name: str) -> list[str]:
    hint = hints(kind)[name]
    unit, symbol = unit_of(hint), lookup(name, section)
    dimension = DIMENSIONS[unit] if unit else symbol.dimension if symbol else ""
    shown = "" if dimension in ("word", "1") else dimension
    return [f"`{name}`", describe(hint), _default(kind, name), shown, _meaning(name, section)]


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
