#!/usr/bin/env python3
"""Makes docs/config.md, symbols.md, scenes.md and files.md from schema, symbols, scenes and sources.

usage: scripts/reference_pages.py [FOLDER]
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from indent_sim.config import key_types, schema  # noqa: E402
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
from indent_sim.config.schema import Config  # noqa: E402
from indent_sim.model.symbols import GROUPS, lookup  # noqa: E402

UNLESS = {
    "material": "**required** unless every layer, or region of a mesh file, has its own",
}


def config_markdown() -> str:
    """docs/config.md."""
    parts = [
        "# The scene file\n\nGenerated from the schema by `scripts/reference_pages.py`.\n",
        "YAML 1.2; any consistent system of units. z is up, the undeformed surface is z = 0. Where `units` are given,\n"
        "numbers may carry units of their own, `2.5 um`, `1 kPa`, `3 nN`, `70 deg`, and are converted to those, times\n"
        "to seconds.\n"
        "Unknown and repeated keys are errors.\n",
        _table(
            ["section", "default", "meaning"], map(_section_row, schema.allowed_keys_at((), {}))
        ),
    ]
    for section, kinds in schema.sections().items():
        parts.append(f"## {section}\n")
        parts += [_kind_markdown(section, kind) for kind in kinds]
    return "\n".join(parts)


def _section_row(name: str) -> list[str]:
    field = Config.model_fields[name]
    if name not in schema.sections():
        return [f"`{name}`", _shown(field.default), _meaning(name)]
    tag = schema.section_tags().get(name)
    chosen = f"`{tag}: {getattr(field.default, tag, '')}`" if tag else "as below"
    default = (
        "**required**" if field.is_required() else chosen if field.default is not None else "none"
    )
    return [f"[`{name}`](#{name})", UNLESS.get(name, default), _meaning(name)]


def _kind_markdown(section: str, kind: type) -> str:
    tag = schema.section_tags().get(section)
    rows = [
        row
        for name in schema.file_order(kind)
        if name != tag
        for row in _key_rows(section, kind, name)
    ]
    if section == "indenter":
        rows.append(
            [
                "`center`",
                describe_type(field_types(Config)["center"]),
                "",
                "length",
                _meaning("center"),
            ]
        )
    table = _table(["key", "value", "default", "unit", "meaning"], rows)
    text = f"{inspect.cleandoc(kind.__doc__ or '')}\n\n{table}"
    values = (
        {k: value for value, k in types_by_tag(field_types(Config)[section], tag).items()}
        if tag
        else {}
    )
    return f"### `{tag}: {values[kind]}`\n\n{text}" if tag else text


def _key_rows(section: str, kind: type, name: str, outside: str = "") -> list[list[str]]:
    """The row of a key, and those of the keys inside where it is a section or a list of them."""
    hint = field_types(kind)[name]
    is_list = get_origin(bare_type(hint)) is tuple
    item = (
        get_args(bare_type(hint))[0]
        if is_list
        else None
        if allowed_words(hint) or tag_of(hint)
        else hint
    )
    within = f"{outside}{name}[]." if is_list else f"{outside}{name}."
    symbol = lookup(name, section)
    shown = symbol.dimension if symbol and symbol.dimension not in ("word", "1") else ""
    value = f"a section as [`{name}`](#{name})" if tag_of(hint) and outside else describe_type(hint)
    own = [f"`{outside}{name}`", value, _default(kind, name), shown, _meaning(name, section)]
    return [own, *_rows_inside(name, item, within)]


def _rows_inside(name: str, item: Any, within: str) -> Iterator[list[str]]:
    """The rows of the keys of an item, each once: of all kinds that it may be, after the key that chooses."""
    tag, kinds = (
        tag_of(item),
        [
            bare_type(part)
            for part in union_members(item)
            if dataclasses.is_dataclass(bare_type(part))
        ],
    )
    if tag:
        yield [
            f"`{within}{tag}`",
            key_types.join_words(list(types_by_tag(item, tag))),
            "**required**",
            "",
            _meaning(tag),
        ]
    owners = {key: kind for kind in kinds for key in field_names(kind) if key != tag}
    for key, kind in owners.items():
        yield from _key_rows(name, kind, key, within)


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    lines = [
        head,
        ["---"] * len(head),
        *([cell.replace("|", r"\|") for cell in row] for row in rows),
    ]
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


def symbols_markdown() -> str:
    """docs/symbols.md."""
    parts = [
        "# Symbols\n\nGenerated from `indent_sim/model/symbols.py` by `scripts/reference_pages.py`.\n",
        "One name per thing, in YAML, Python and CSV alike. z is up, the undeformed surface is z = 0.\n",
    ]
    for title, group in GROUPS.items():
        rows = [
            f"| `{s.name}` | {f'${s.latex}$' if s.latex else ''} | {s.meaning} | {s.dimension} |"
            for s in group
        ]
        head = ["| name | symbol | meaning | dimension |", "|---|---|---|---|"]
        parts.append("\n".join([f"## {title}\n", *head, *rows]) + "\n")
    return "\n".join(parts)


def scenes_markdown() -> str:
    """docs/scenes.md: the scenes in configs/, each with the comment at its head."""
    parts = [
        "# Shipped scenes\n\n"
        "Generated from the first lines of each scene by `scripts/reference_pages.py`. Each answers one question and\n"
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
    """The comment at the head of a scene file, as one paragraph."""
    lines = scene.read_text(encoding="utf-8").splitlines()
    return " ".join(
        line.lstrip("# ") for line in itertools.takewhile(lambda line: line.startswith("#"), lines)
    )


def files_markdown() -> str:
    """docs/files.md: every module of the package with the first line of its docstring."""
    parts = [
        "# The files of the package\n\nGenerated from the sources by `scripts/reference_pages.py`.\n"
    ]
    package = ROOT / "indent_sim"
    folders = sorted({path.parent for path in package.rglob("*.py")})
    for folder in folders:
        name = folder.relative_to(ROOT).as_posix()
        parts.append(f"## {name}\n\n{_first_line(folder / '__init__.py')}\n")
        modules = sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")
        if modules:
            rows = [[f"`{path.name}`", _first_line(path)] for path in modules]
            parts.append(_table(["file", "content"], rows))
    return "\n".join(parts)


def _first_line(module: Path) -> str:
    docstring = ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or ""
    paragraph = docstring.split("\n\n")[0]
    return " ".join(paragraph.split()).replace("|", "\\|")


def pages() -> dict[str, str]:
    """The pages by their names in docs/."""
    return {
        "config.md": config_markdown(),
        "symbols.md": symbols_markdown(),
        "scenes.md": scenes_markdown(),
        "files.md": files_markdown(),
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs"
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")
