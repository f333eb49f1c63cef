"""A scene file -> Config and back: strict YAML, overrides, errors that name file, line and key."""

from __future__ import annotations

import copy
import dataclasses
import errno
import json
import math
import os
import re
import stat
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import NoneType
from typing import Any

from pydantic import ValidationError

from indent_sim.config import key_types, schema, strict_yaml
from indent_sim.config.messages import AND_MORE, MOST_PROBLEMS, in_words
from indent_sim.config.quantities import converted
from indent_sim.config.schema import Config, Source
from indent_sim.config.strict_yaml import MAX_BYTES, MAX_DEPTH, KeyPath, key_path, key_text
from indent_sim.model.loading import STEPPED_KEYS, Loading
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError

OF_A_STUDY = {"base", "vary"}  # sections that no scene has
KEY_PATTERN = re.compile(r"\w+(\[\d+\])*(\.\w+(\[\d+\])*)*")  # as in body.layers[0].material.E
SCALARS = {NoneType, bool, int, float, str}
MOST_SET_LETTERS = 80  # most characters of a --set that are told
Document = dict[str, Any]  # sections as a file has them
Given = str | os.PathLike[str] | Mapping[str, Any] | Config  # a scene, or what says it
Changes = Sequence[str] | Mapping[str, Any]  # as after --set, or values by dotted keys
Quantities = dict[KeyPath, tuple[str, float]]  # as given, and as numbers in the units of the scene
Place = tuple[str, int | None]  # file (or what stands for it) and line


def load(path: Given, overrides: Changes = ()) -> Config:
    """The config of a scene file, or of mappings shaped like one, with some keys replaced.

    Parameters
    ----------
    path
        A file, mappings shaped like one, or a config that is to be changed.
    overrides
        Words as after `--set`, "contact.method=penalty", or values by their dotted keys, {"contact.method": "penalty"}.

    Raises
    ------
    UsageError
        When the file cannot be read.
    ConfigError
        For anything wrong in it.
    """
    if isinstance(path, Config):
        return _overridden(to_mapping(path), path.source, overrides)
    if isinstance(path, Mapping):
        return from_mapping(path, overrides)
    document, source = read_document(path)
    return _overridden(document, source, overrides)


def load_older(path: str | os.PathLike[str]) -> Config:
    """The config of a result, whose version may have known keys that are gone; errors as of `load`."""
    document, source = read_document(path)
    for name, key in schema.GONE:
        section = document.get(name)
        if isinstance(section, dict) and (value := section.pop(key, None)) and name == "experiment":
            _move(document, key, value)
    return _validated(document, source)


def _move(document: Document, key: str, value: Any) -> None:
    """Put what stood in `experiment` where it has moved to: a history in place of the loading, a
    relaxation to every material.
    """
    if schema.MOVED[key] == "loading":
        document["loading"] = {key: value}
    else:
        body = document.get("body") or {}
        owners = (document, *(body.get("layers") or ()), *(body.get("inclusions") or ()))
        laws = [owner["material"] for owner in owners if owner.get("material")]
        for law in (*laws, *(body.get("regions") or {}).values()):
            law[key] = value
    if not document.get("experiment"):
        document.pop("experiment", None)


def loads(text: str, name: str = "", overrides: Changes = ()) -> Config:
    """The config of YAML text; `name` stands for it in errors."""
    document, source = _document(text, name)
    return _overridden(document, source, overrides)


def is_study(document: Mapping[str, Any]) -> bool:
    """Whether a document is a study: one scene that is varied, or a list of cases."""
    return document.keys() >= OF_A_STUDY or "cases" in document


def read_document(path: str | os.PathLike[str]) -> tuple[Document, Source]:
    """A YAML file of sections as it stands, unchecked, and where every key stands; errors as of
    `load`.
    """
    name = os.fspath(path)
    content = _content(name)
    try:
        return _document(content.decode("utf-8-sig"), name)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ConfigError("", "not UTF-8 text", "save the file as UTF-8", name, line) from None


def _document(text: str, name: str) -> tuple[Document, Source]:
    document, lines = strict_yaml.parse(text, name)
    if not isinstance(document, dict):
        problem = (
            "the file is empty" if document is None else "a scene is made of sections (key: value)"
        )
        raise ConfigError("", problem, "see docs/config.md", name, lines.get((), 1))
    return document, Source(name, {path: (name, line) for path, line in lines.items()})


def from_mapping(data: Mapping[str, Any], overrides: Changes = ()) -> Config:
    """The config of nested mappings, lists, numbers (numpy's too) and dataclasses, shaped like the
    file.
    """
    return _overridden(plain(data), Source(), overrides)


def plain(data: Mapping[str, Any]) -> Document:
    """Nested mappings, lists, numbers (numpy's too) and dataclasses as the document of a file."""
    document = _plain(data, ())
    if not isinstance(document, dict):
        raise ConfigError("", "a scene is made of sections")
    return document


def varied(
    document: Mapping[str, Any], source: Source, settings: Iterable[tuple[str, Any, Place]]
) -> Config:
    """The config of a document in which some keys are replaced: (dotted key, value, where that was
    written).

    The document and its source stay as they are; a key given twice takes the last value.
    """
    changed = copy.deepcopy(dict(document))
    where = dataclasses.replace(source, places=dict(source.places))
    for key, value, place in settings:
        _replace(changed, where, key_path(key), copy.deepcopy(value), place)
    return _validated(changed, where)


def quantities_of(
    document: Mapping[str, Any], settings: Iterable[tuple[str, Any, Place]]
) -> Quantities:
    """The quantities of a document in which some keys are replaced, as they are given and as
    numbers in its units; ConfigError for one that is none.
    """
    changed = copy.deepcopy(dict(document))
    where = Source()
    for key, value, place in settings:
        _replace(changed, where, key_path(key), copy.deepcopy(value), place)
    return converted(changed)[1]


def located(where: Config | Source, error: ConfigError) -> ConfigError:
    """The same error with the file and line of its key, or of the nearest section around it."""
    source = where.source if isinstance(where, Config) else where
    if isinstance(error, ConfigErrors):
        found = [located(source, one) for one in error.errors]
        return ConfigErrors(sorted(found, key=lambda one: one.line or math.inf))
    if error.file:
        return error
    file, line = source.place(key_path(error.key)) if error.key else (source.name, None)
    return dataclasses.replace(error, file=file, line=line)


def to_yaml(config: Config) -> str:
    """The whole config, defaults included, as YAML that loads to an equal config, to the last
    digit.
    """
    return strict_yaml.dump(to_mapping(config))


def to_mapping(config: Config, keys: Iterable[str] | None = None) -> Document:
    """The config, or these of its keys, as nested mappings, shaped and ordered like the file."""
    values = {name: getattr(config, name) for name in keys or schema.keys_at((), {})}
    data = {name: _given(value) for name, value in values.items() if value is not None}
    if config.center is not None and "indenter" in data:
        data["indenter"]["center"] = list(config.center)
    return data


def _section(item: Any) -> Document:
    """A dataclass as the section of a file; what is not given is left out."""
    unused: set[str] = set()
    if isinstance(item, Loading):
        unused = {
            *([] if {*STEPPED_KEYS} & {*item.given_path_keys} else ["steps"]),
            *([] if item.prescribed_history else ["times"]),
        }
    values = {
        name: getattr(item, name) for name in schema.file_order(type(item)) if name not in unused
    }
    return {name: _given(value) for name, value in values.items() if value is not None}


def _given(value: Any) -> Any:
    """A field's value as a file gives it; equal walls are one word."""
    kind: Any = type(value)
    if kind in SCALARS:
        return value
    if dataclasses.is_dataclass(value):
        section = _section(value)
        is_walls = bool(key_types.words_of(kind))
        return (
            section
            if not is_walls or len(set(section.values())) > 1
            else next(iter(section.values()))
        )
    if isinstance(value, dict):
        return {name: _given(part) for name, part in value.items()}
    return [_given(part) for part in value] if isinstance(value, tuple) else value


def _content(name: str) -> bytes:
    try:
        # at once, a pipe too, which would wait for its writer
        with open(
            name, "rb", opener=lambda path, flags: os.open(path, flags | os.O_NONBLOCK)
        ) as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise OSError(errno.EINVAL, "not a regular file")
            content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"cannot read the config {name}: {reason}", file=name) from None
    if len(content) > MAX_BYTES:
        raise ConfigError("", f"longer than {MAX_BYTES} bytes", "this is no scene", name)
    return content


def _overridden(document: Document, source: Source, overrides: Changes) -> Config:
    if isinstance(overrides, Mapping):
        return varied(document, source, [_setting(key, value) for key, value in overrides.items()])
    seen: set[KeyPath] = set()
    wrong: list[ConfigError] = []
    for text in overrides:
        try:
            path = _override(document, source, text)
            if path in seen:
                raise ConfigError(key_text(path), "given twice with --set", "keep one", "--set")
            seen.add(path)
        except ConfigError as error:
            wrong.append(error)
    try:
        config = _validated(document, source)
    except ConfigError as error:
        raise ConfigErrors.combine([*wrong, *_beside(wrong, error)]) from None
    if wrong:
        raise ConfigErrors.combine(wrong)
    return config


def told_together(
    first: ConfigError, config: Config, check: Callable[[Config], object]
) -> ConfigError:
    """A mistake that `check` finds in a config, and those that it finds where this one is left out."""
    again = partial(_checked, source=config.source)
    return _and_others(
        first, to_mapping(config), config.source, lambda document: check(again(document))
    )


def _and_others(
    first: ConfigError, document: Document, source: Source, check: Callable[[Any], object]
) -> ConfigError:
    """The first mistake of a document, and those that are left where it is mended or left out, with
    their places.
    """
    document = copy.deepcopy(document)
    source = dataclasses.replace(source, places=dict(source.places))
    found: list[ConfigError] = []
    new = first.errors
    while new and len(found) < MOST_PROBLEMS:
        found += [located(source, one) for one in new]
        if not all(_mended(document, source, one) for one in new):
            break
        try:
            check(document)
            break
        except ConfigError as error:
            new = _beside(found, error)
    if len(found) > MOST_PROBLEMS:
        found = [*found[:MOST_PROBLEMS], AND_MORE]
    return located(source, ConfigErrors.combine(found))


def _beside(found: Sequence[ConfigError], error: ConfigError) -> list[ConfigError]:
    """The errors about other keys than those found already, the sections around them and the keys
    in them; not what asks for one of them, which was there before it was left out.
    """
    known = [
        path[:-1] if path[-1] in schema.TAGS else path
        for path in (key_path(one.key) for one in found)
        if path
    ]
    paths = [(one, key_path(one.key)) for one in error.errors if not _asks_for(found, one)]
    return [
        one for one, path in paths if not any(path[: len(old)] == old[: len(path)] for old in known)
    ]


def _asks_for(found: Sequence[ConfigError], error: ConfigError) -> bool:
    words = re.split(r"[\s,;]+", error.remedy)
    return any(one.key and not one.suggestion and one.key in words for one in found)


def _mended(document: Document, source: Source, error: ConfigError) -> bool:
    """Put the word that was meant in the place of a wrong one, or take it out; whether that could
    be done.
    """
    path = key_path(error.key)
    section = schema.spot_at(path[:-1], document).value
    if not path or not isinstance(section, dict) or path[-1] not in section:
        return False
    value = section.pop(path[-1])
    if error.suggestion and isinstance(value, str):
        section[path[-1]] = error.suggestion
    elif error.suggestion and error.suggestion not in section:
        section[error.suggestion] = value
        meant = (*path[:-1], error.suggestion)
        inside = [old for old in source.places if old[: len(path)] == path]
        source.places.update({(*meant, *old[len(path) :]): source.places[old] for old in inside})
    return True


def _setting(key: str, value: Any) -> tuple[str, Any, Place]:
    """A value that a notebook gives to a dotted key; ConfigError for a key that is none."""
    if not (
        isinstance(key, str) and KEY_PATTERN.fullmatch(key) and len(key_path(key)) <= MAX_DEPTH
    ):
        raise ConfigError("", f"{key!r} is no key", "write it with dots, e.g. contact.method")
    return key, _plain(value, key_path(key)), ("", None)


def _override(document: Document, source: Source, text: str) -> KeyPath:
    """Sets one key of the document and notes where it came from."""
    label = f"--set {text if len(text) <= MOST_SET_LETTERS else text[:MOST_SET_LETTERS] + '...'}"
    key, equals, value = text.partition("=")
    if not equals or not KEY_PATTERN.fullmatch(key.strip()):
        raise ConfigError(
            "", "is not key=value", "write for example --set contact.method=penalty", label
        )
    path = key_path(key.strip())
    if len(path) > MAX_DEPTH:
        raise ConfigError(
            key_text(path[:3]), f"a key of {len(path)} parts", f"{MAX_DEPTH} at most", label
        )
    try:
        parsed, _ = strict_yaml.parse(value, label)
    except ConfigError as error:
        raise dataclasses.replace(error, key=key_text(path), line=None) from None
    _replace(document, source, path, parsed, (label, None))
    return path


def _replace(document: Document, source: Source, path: KeyPath, value: Any, place: Place) -> None:
    section = _section_of(document, source, path, place)
    section[path[-1]] = value
    for inside in [known for known in source.places if known[: len(path)] == path]:
        del source.places[inside]
    source.places[path] = place


def _section_of(document: Document, source: Source, path: KeyPath, place: Place) -> Any:
    """The mapping or list that holds the last part of a key path; sections that are missing are
    made.
    """
    section: Any = document
    for depth, part in enumerate(path, start=1):
        if isinstance(part, int) and not (isinstance(section, list) and part < len(section)):
            size = f"has {len(section)} items" if isinstance(section, list) else "is not a list"
            raise ConfigError(
                key_text(path), f"{key_text(path[: depth - 1])} {size}", "count from [0]", *place
            )
        if isinstance(part, str) and not isinstance(section, dict):
            key = key_text(path[: depth - 1])
            rest = f"{key}={{{path[-1]}: ...}}"
            raise ConfigError(
                key_text(path), f"{key} is not a section", f"set it whole: {rest}", *place
            )
        if depth == len(path):
            break
        if isinstance(section, dict) and part not in section:
            source.places[path[:depth]] = place
            section[part] = {}
        section = section[part]
    return section


def _validated(document: Document, source: Source) -> Config:
    if is_study(document):
        problem = "this is a study, not a scene"
        remedy = f"indent-sim study {source.name or 'FILE'}"
        raise ConfigError(
            "", problem, remedy, *source.place(("vary" if "vary" in document else "cases",))
        )
    try:
        return _checked(document, source)
    except ConfigError as error:
        raise _and_others(error, document, source, partial(_checked, source=source)) from None


def _checked(document: Document, source: Source) -> Config:
    """The config of a document; ConfigError without a place for the first kind of mistakes in it."""
    try:
        document, quantities = converted(document)
        source = dataclasses.replace(source, quantities=quantities)
        # json, because strict pydantic takes a list for a tuple and a mapping for a dataclass only
        # from there
        config = Config.model_validate_json(json.dumps(_as_fields(document)))
        if "steps" in document["loading"] and not {*STEPPED_KEYS} & {
            *config.loading.given_path_keys
        }:
            given = config.loading.given_path_keys[0]
            of = "force" if "force" in given else "delta"
            are = "are" if given.endswith("s") else "is"
            raise ConfigError(
                "loading.steps",
                f"belongs to {of}, and {given} {are} given",
                "remove one of them",
            )
    except ValidationError as error:
        raise in_words(error, document) from None
    config._source = source
    return config


def _as_fields(document: Document) -> Document:
    """The document in the shape of Config: `center` beside the tip, default tags and walls written
    out.
    """
    if "center" in document:
        raise ConfigError("center", "unknown key", "it belongs in indenter")
    fields = _completed(schema.spot_at((), document))
    if isinstance(fields.get("indenter"), dict) and "center" in fields["indenter"]:
        fields["center"] = fields["indenter"].pop("center")
    return fields


def _completed(spot: schema.Spot) -> Any:
    """The value of a place with default tags written out, and one word written out for all walls
    that it stands for.
    """
    value = spot.value
    if (
        isinstance(value, str)
        and spot.tag is None
        and spot.kind is not None
        and key_types.common(spot.kind)
    ):
        return dict.fromkeys(key_types.field_names(spot.kind), value)
    if isinstance(value, dict):
        value = {part.path[-1]: _completed(part) for part in spot.parts()}
        return {spot.tag: spot.choice} | value if spot.tag and spot.choice is not None else value
    return [_completed(part) for part in spot.parts()] if isinstance(value, list) else value


def _plain(value: Any, path: KeyPath) -> Any:
    """Anything a notebook may hand over, as the mappings, lists and scalars of a file."""
    if len(path) > MAX_DEPTH:
        raise ConfigError(key_text(path[:3]), f"nested deeper than {MAX_DEPTH} levels")
    if hasattr(value, "tolist"):  # numpy
        value = value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = _section(value)
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ConfigError(key_text(path), f"a key must be a word, got {key!r}")
        return {key: _plain(part, (*path, key)) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part, (*path, index)) for index, part in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(key_text(path), f"{value} is not a finite number")
    if isinstance(value, str) and strict_yaml.UNWRITABLE.search(value):
        raise ConfigError(key_text(path), "text holds a character no file can hold")
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise ConfigError(key_text(path), f"a {type(value).__name__} cannot stand in a scene")
