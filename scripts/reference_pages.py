#!/usr/bin/env python3
"""Makes docs/config.md, symbols.md, scenes.md and files.md from the schema and the sources.

usage: scripts/reference_pages.py [FOLDER]

The pages are written into FOLDER, which is docs/ by default.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import inspect
import itertools
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from generated_page import ROOT

sys.path.insert(0, str(ROOT))

from indent_sim.config import key_types, schema
from indent_sim.config.key_types import (
    allowed_words,
    bare_type,
    describe_type,
    field_names,
    field_types,
    tag_of,
    types_by_tag,
    union_members,
)
from indent_sim.config.schema import Config
from indent_sim.model.symbols import GROUPS, lookup

REQUIRED = "**required**"
# Defaults of sections that the schema cannot express.
SECTION_DEFAULTS = {
    "material": "**required** unless every layer, or region of a mesh file, has its own",
}
# Dimensions that are not shown as a unit.
NO_UNIT = ("word", "1")


def pages() -> dict[str, str]:
    """Return the text of every page by its name in docs/."""
    return {
        "config.md": config_page(),
        "symbols.md": symbols_page(),
        "scenes.md": scenes_page(),
        "files.md": files_page(),
    }


def config_page() -> str:
    """Return docs/config.md: all keys of a scene file."""
    section_rows = [_section_row(name) for name in schema.allowed_keys_at((), {})]
    parts = [
        "# The scene file\n\nGenerated from the schema by `scripts/reference_pages.py`.\n",
        "YAML 1.2; any consistent system of units. z is up, the undeformed surface is z = 0. "
        "Where `units` are given,\n"
        "numbers may carry units of their own, `2.5 um`, `1 kPa`, `3 nN`, `70 deg`, and are "
        "converted to those, times\n"
        "to seconds.\n"
        "Unknown and repeated keys are errors.\n",
        _table(["section", "default", "meaning"], section_rows),
    ]
    for section, kinds in schema.sections().items():
        parts.append(f"## {section}\n")
        parts += [_kind_text(section, kind) for kind in kinds]
    return "\n".join(parts)


def _section_row(name: str) -> list[str]:
    """Return the row of a section or of a key outside of all sections."""
    field = Config.model_fields[name]
    if name not in schema.sections():
        return [f"`{name}`", _shown_value(field.default), _meaning(name)]
    return [f"[`{name}`](#{name})", _section_default(name), _meaning(name)]


def _section_default(name: str) -> str:
    """Return the default of a section in words."""
    if name in SECTION_DEFAULTS:
        return SECTION_DEFAULTS[name]
    field = Config.model_fields[name]
    if field.is_required():
        return REQUIRED
    if field.default is None:
        return "none"
    tag = schema.section_tags().get(name)
    return f"`{tag}: {getattr(field.default, tag, '')}`" if tag else "as below"


def _kind_text(section: str, kind: type) -> str:
    """Return the part of a page on one type of a section: its docstring and its keys."""
    tag = schema.section_tags().get(section)
    rows = []
    for name in schema.file_order(kind):
        if name != tag:
            rows += _key_rows(section, kind, name)
    if section == "indenter":
        value = describe_type(field_types(Config)["center"])
        rows.append(["`center`", value, "", "length", _meaning("center")])
    table = _table(["key", "value", "default", "unit", "meaning"], rows)
    text = f"{inspect.cleandoc(kind.__doc__ or '')}\n\n{table}"
    if not tag:
        return text
    tagged_types = types_by_tag(field_types(Config)[section], tag)
    (word,) = [word for word, tagged_type in tagged_types.items() if tagged_type is kind]
    return f"### `{tag}: {word}`\n\n{text}"


def _key_rows(section: str, kind: type, name: str, prefix: str = "") -> list[list[str]]:
    """Return the row of a key, and the rows of the keys inside if it is a section or a list.

    Parameters
    ----------
    section : str
        The section of the key.
    kind : type
        The dataclass that has the key as a field.
    name : str
        The key.
    prefix : str
        The keys outside of this one, such as "layers[].".
    """
    hint = field_types(kind)[name]
    symbol = lookup(name, section)
    unit = symbol.dimension if symbol and symbol.dimension not in NO_UNIT else ""
    value = describe_type(hint)
    if tag_of(hint) and prefix:
        value = f"a section as [`{name}`](#{name})"
    key = f"{prefix}{name}"
    row = [f"`{key}`", value, _default(kind, name), unit, _meaning(name, section)]
    return [row, *_inner_rows(name, hint, key)]


def _inner_rows(name: str, hint: Any, key: str) -> Iterator[list[str]]:
    """Yield the rows of the keys inside a section or a list of sections.

    Each key comes once, for all types that the section may have, after the key that chooses the
    type. A section with a heading of its own on the page has no rows here.
    """
    if get_origin(bare_type(hint)) is tuple:
        item = get_args(bare_type(hint))[0]
        prefix = f"{key}[]."
    elif allowed_words(hint) or tag_of(hint):
        return
    else:
        item = hint
        prefix = f"{key}."
    tag = tag_of(item)
    members = [bare_type(member) for member in union_members(item)]
    kinds = [member for member in members if dataclasses.is_dataclass(member)]
    if tag:
        words = key_types.join_words(list(types_by_tag(item, tag)))
        yield [f"`{prefix}{tag}`", words, REQUIRED, "", _meaning(tag)]
    owners = {
        field_name: kind for kind in kinds for field_name in field_names(kind) if field_name != tag
    }
    for field_name, kind in owners.items():
        yield from _key_rows(name, kind, field_name, prefix)


def _default(kind: Any, name: str) -> str:
    """Return the default of a field as it is shown."""
    (field,) = [field for field in dataclasses.fields(kind) if field.name == name]
    if field.default_factory is not dataclasses.MISSING:
        return _shown_value(field.default_factory())
    if field.default is dataclasses.MISSING:
        return REQUIRED
    return _shown_value(field.default)


def _shown_value(value: Any) -> str:
    """Return a default value as it is shown; that of a dataclass is its first field."""
    if dataclasses.is_dataclass(value):
        value = getattr(value, field_names(value)[0])
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return "" if value in (None, "") else f"`{value}`"


def _meaning(name: str, section: str = "") -> str:
    """Return the meaning of a key by the table of symbols."""
    symbol = lookup(name, section)
    return symbol.meaning if symbol else ""


def symbols_page() -> str:
    """Return docs/symbols.md: all names with their meaning and dimension."""
    parts = [
        "# Symbols\n\n"
        "Generated from `indent_sim/model/symbols.py` by `scripts/reference_pages.py`.\n",
        "One name per thing, in YAML, Python and CSV alike. z is up, the undeformed surface is "
        "z = 0.\n",
    ]
    for title, group in GROUPS.items():
        lines = [
            f"## {title}\n",
            "| name | symbol | meaning | dimension |",
            "|---|---|---|---|",
        ]
        for symbol in group:
            latex = f"${symbol.latex}$" if symbol.latex else ""
            lines.append(f"| `{symbol.name}` | {latex} | {symbol.meaning} | {symbol.dimension} |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def scenes_page() -> str:
    """Return docs/scenes.md: the scenes in configs/, each with the comment at its head."""
    parts = [
        "# Shipped scenes\n\n"
        "Generated from the first lines of each scene by `scripts/reference_pages.py`. "
        "Each answers one question and\n"
        "runs as it is by `indent-sim run`.\n",
    ]
    for heading, folder in (
        ("Scenes", "configs"),
        ("Scenes of the contact notes", "configs/notes"),
    ):
        scenes = sorted((ROOT / folder).glob("*.yaml"))
        rows = [[f"`{folder}/{scene.name}`", _head_comment(scene)] for scene in scenes]
        parts += [f"## {heading}\n", _table(["scene", "what it shows"], rows)]
    return "\n".join(parts)


def _head_comment(scene: Path) -> str:
    """Return the comment at the head of a scene file as one paragraph."""
    lines = scene.read_text(encoding="utf-8").splitlines()
    comment = itertools.takewhile(lambda line: line.startswith("#"), lines)
    return " ".join(line.lstrip("# ") for line in comment)


def files_page() -> str:
    """Return docs/files.md: every module of the package with the first line of its docstring."""
    parts = [
        "# The files of the package\n\n"
        "Generated from the sources by `scripts/reference_pages.py`.\n"
    ]
    package = ROOT / "indent_sim"
    for folder in sorted({path.parent for path in package.rglob("*.py")}):
        name = folder.relative_to(ROOT).as_posix()
        parts.append(f"## {name}\n\n{_first_line(folder / '__init__.py')}\n")
        modules = sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")
        if modules:
            rows = [[f"`{path.name}`", _first_line(path)] for path in modules]
            parts.append(_table(["file", "content"], rows))
    return "\n".join(parts)


def _first_line(module: Path) -> str:
    """Return the first paragraph of a module's docstring as the text of a table cell."""
    docstring = ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or ""
    paragraph = docstring.split("\n\n")[0]
    return " ".join(paragraph.split()).replace("|", "\\|")


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head)]
    for row in rows:
        lines.append([cell.replace("|", r"\|") for cell in row])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs", metavar="FOLDER")
    folder = parser.parse_args().folder
    for page_name, page_text in pages().items():
        (folder / page_name).write_text(page_text, encoding="utf-8")
