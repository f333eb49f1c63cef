#!/usr/bin/env python3
"""Makes docs/api.md, config.md, symbols.md, scenes.md and files.md from schema and sources.

usage: scripts/reference_pages.py [FOLDER]

The pages are written into FOLDER, which is docs/ by default.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import inspect
import itertools
import re
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args, get_origin

from generated_page import ROOT

sys.path.insert(0, str(ROOT))

from api_page import api_page

from indent_sim.config import key_types, schema
from indent_sim.config.key_types import (
    allowed_words,
    bare_type,
    describe_type,
    field_names,
    field_types,
    tag_of,
    union_members,
    untagged_sections,
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
        "api.md": api_page(),
        "config.md": config_page(),
        "symbols.md": symbols_page(),
        "scenes.md": scenes_page(),
        "files.md": files_page(),
    }


def config_page() -> str:
    """Return docs/config.md: every section with its alternatives, and every key once."""
    section_rows = [_section_row(name) for name in schema.allowed_keys_at((), {})]
    parts = [
        "# The scene file\n\nGenerated from the schema by `scripts/reference_pages.py`.\n",
        "A scene is a file in YAML 1.2, in any consistent system of units. z is up, the\n"
        "undeformed surface is z = 0. If the scene has a section `units`, a number may have a\n"
        "unit of its own, `2.5 um`, `1 kPa`, `3 nN`, `70 deg`, and is converted to those of the\n"
        "section; times are converted to seconds. Unknown and repeated keys are errors.\n",
        "In a section with alternatives one key chooses the alternative: `shape`, `model` or\n"
        "`method`. The keys of all alternatives are in one table below them; its column `of`\n"
        "says which alternatives have a key. Sections inside sections follow at the end.\n",
        _table(["section", "default", "meaning"], section_rows),
    ]
    for section, kinds in schema.sections().items():
        parts += [f"## {section}\n", *_section_parts(section, kinds)]
    parts.append("## Sections inside sections\n")
    for name, kinds in _inner_sections().items():
        parts += [f"### Section {name}\n", *_inner_section_parts(name, kinds)]
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


def _section_parts(section: str, kinds: tuple[type, ...]) -> list[str]:
    """Return the texts of a section: its alternatives and the table of their keys."""
    tag = schema.section_tags().get(section)
    rows = _key_rows(section, kinds, tag)
    if section == "indenter":
        center = describe_type(field_types(Config)["center"])
        rows.append(["`center`", "all", center, "", "length", _meaning("center")])
    if tag is None:
        return [f"{_description(kinds[0])}\n", _key_table(rows)]
    parts = [f"### `{tag}: {_word(kind, tag)}`\n\n{_description(kind)}\n" for kind in kinds]
    return [*parts, f"### Keys of {section}\n", _key_table(rows)]


def _inner_section_parts(name: str, kinds: tuple[type, ...]) -> list[str]:
    """Return the texts of a section inside others: its meaning and the table of its keys."""
    common_keys = set.intersection(*(set(field_names(kind)) for kind in kinds))
    tag = next(iter(common_keys & schema.TAG_KEYS), None)
    if tag is None:
        rows = _key_rows(name, kinds[:1], tag)
        return ["\n\n".join(map(_description, kinds)) + "\n", _key_table(rows)]
    words = key_types.join_words([_word(kind, tag) for kind in kinds])
    rows = [[f"`{tag}`", "all", words, REQUIRED, "", _meaning(tag)]]
    meaning = _meaning(name)
    text = f"{meaning[0].upper()}{meaning[1:]}.\n"
    return [text, _key_table(rows + _key_rows(name, kinds, tag))]


def _inner_sections() -> dict[str, tuple[type, ...]]:
    """Return the sections inside sections by name, each with the dataclasses that it may be."""
    found: dict[str, tuple[type, ...]] = {}
    owners = [kind for kinds in schema.sections().values() for kind in kinds]
    while owners:
        hints = itertools.chain.from_iterable(field_types(kind).items() for kind in owners)
        inner = [(_inner_name(name, hint), _inner_kinds(hint)) for name, hint in hints]
        owners = []
        for name, kinds in inner:
            new_kinds = [kind for kind in kinds if kind not in found.get(name, ())]
            found[name] = (*found.get(name, ()), *new_kinds)
            owners += new_kinds
    return {name: kinds for name, kinds in found.items() if kinds}


def _inner_kinds(hint: Any) -> tuple[type, ...]:
    """Return the dataclasses of a key that is a section, or a list of sections, of its own."""
    bare = bare_type(hint)
    item = get_args(bare)[0] if get_origin(bare) is tuple else hint
    is_word_alone = bool(allowed_words(item)) and not untagged_sections(hint)
    if tag_of(hint) or is_word_alone:
        return ()
    members = [bare_type(member) for member in union_members(item)]
    return tuple(member for member in members if dataclasses.is_dataclass(member))


def _inner_name(name: str, hint: Any) -> str:
    """Return the name of a section inside others; one that may replace a word has its own."""
    replacing = untagged_sections(hint)
    return replacing[0].lower() if replacing else name


def _key_rows(section: str, kinds: tuple[type, ...], tag: str | None) -> list[list[str]]:
    """Return a row for each key of a section with the alternatives that have it.

    Parameters
    ----------
    section : str
        Name of the section.
    kinds : tuple of dataclasses
        Its alternatives.
    tag : str or None
        Key that chooses an alternative; None if there is only one.
    """
    words = {kind: _word(kind, tag) if tag else "" for kind in kinds}
    keys = [name for kind in kinds for name in schema.file_order(kind) if name != tag]
    rows = []
    for name in dict.fromkeys(keys):
        owners = {word: kind for kind, word in words.items() if name in field_names(kind)}
        values = {word: _value(name, field_types(kind)[name]) for word, kind in owners.items()}
        defaults = {word: _default(kind, name) for word, kind in owners.items()}
        among = _among(list(owners), list(words.values()))
        texts = [_merged(values), _merged(defaults), _dimension(name, section)]
        rows.append([f"`{name}`", among, *texts, _meaning(name, section)])
    return rows


def _among(owners: list[str], everything: list[str]) -> str:
    """Return which alternatives have a key, in the fewest words."""
    others = [word for word in everything if word not in owners]
    if not others:
        return "all"
    if len(others) < len(owners):
        return f"all but {key_types.join_words(others, 'and')}"
    return key_types.join_words(owners, "and")


def _merged(texts: dict[str, str]) -> str:
    """Return the most frequent text, and each other one behind the alternatives that have it."""
    frequent, *others = (text for text, _ in Counter(texts.values()).most_common())
    parts = [frequent or "none" if others else frequent]
    for text in others:
        words = [word for word, own_text in texts.items() if own_text == text]
        parts.append(f"{key_types.join_words(words, 'and')}: {text or 'none'}")
    return "; ".join(parts)


def _value(name: str, hint: Any) -> str:
    """Return the values of a key in words, with a link if they are sections."""
    text = describe_type(hint)
    bare = bare_type(hint)
    if get_origin(bare) is dict:
        return text.replace("a section", "sections as [`material`](#material)")
    if tag_of(hint):
        return f"a section as [`{name}`](#{name})"
    if not _inner_kinds(hint):
        return text
    link = f"#section-{_inner_name(name, hint)}"
    return re.sub(r"\bsections?\b", rf"[\g<0>]({link})", text)


def _key_table(rows: list[list[str]]) -> str:
    """Return the table of keys; without the column `of` if all alternatives have all keys."""
    head = ["key", "of", "value", "default", "unit", "meaning"]
    if all(among == "all" for _, among, *_ in rows):
        head.remove("of")
        rows = [[key, *texts] for key, _, *texts in rows]
    return _table(head, rows)


def _description(kind: type) -> str:
    """Return the docstring of a dataclass without the list of its attributes."""
    return inspect.cleandoc(kind.__doc__ or "").split("\n\nAttributes\n")[0]


def _word(kind: type, tag: str) -> str:
    """Return the word that chooses a dataclass among the alternatives of a section."""
    return str(get_args(field_types(kind)[tag])[0])


def _dimension(name: str, section: str) -> str:
    """Return the unit of a key by the table of symbols."""
    symbol = lookup(name, section)
    return symbol.dimension if symbol and symbol.dimension not in NO_UNIT else ""


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
        "A quantity has the same name in YAML, Python and CSV. z is up, the undeformed surface is "
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
        "Each scene answers one\n"
        "question and runs without changes by `indent-sim run`.\n",
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
