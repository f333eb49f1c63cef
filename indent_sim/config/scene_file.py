"""Reader and writer of scene files in strict YAML, with overrides and located errors."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import NoneType
from typing import Any

from pydantic import ValidationError

from indent_sim.config import key_types, schema, strict_yaml
from indent_sim.config.messages import MAX_PROBLEMS, MORE_ERRORS, config_error
from indent_sim.config.quantities import convert_quantities
from indent_sim.config.scene_sections import Source
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import MAX_BYTES, MAX_DEPTH, KeyPath, key_path, key_text
from indent_sim.model.loading import STEPPED_KEYS, Loading
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError
from indent_sim.process.regular_files import open_regular_file

# Sections that only a study has.
STUDY_SECTIONS = {"base", "vary"}
# Pattern of dotted keys such as body.layers[0].material.E.
KEY_PATTERN = re.compile(r"\w+(\[\d+\])*(\.\w+(\[\d+\])*)*")
SCALARS = {NoneType, bool, int, float, str}
# Sections of a file.
Document = dict[str, Any]
SceneInput = str | os.PathLike[str] | Mapping[str, Any] | Config
# Texts as after --set, or values by dotted keys.
Overrides = Sequence[str] | Mapping[str, Any]
# Quantities as given, and as numbers in the units of the scene.
Quantities = dict[KeyPath, tuple[str, float]]
# File, or the name that stands for it, and line.
SourceLocation = tuple[str, int | None]


def load(path: SceneInput, overrides: Overrides = ()) -> Config:
    """Return the config of a scene file, or of a dictionary, with some keys replaced.

    Parameters
    ----------
    path
        A file, nested dictionaries with the structure of a file, or a config that is to be changed.
    overrides
        Values by dotted keys, {"contact.method": "penalty"}, or texts in the form of the option
        `--set`, such as "contact.method=penalty".

    Raises
    ------
    UsageError
        If the file cannot be read.
    ConfigError
        If the scene has errors.
    """
    if isinstance(path, Config):
        return _apply_overrides(to_mapping(path), path.source, overrides)
    if isinstance(path, Mapping):
        return config_from_mapping(path, overrides)
    document, source = read_document(path)
    return _apply_overrides(document, source, overrides)


def load_result_config(path: str | os.PathLike[str]) -> Config:
    """Return the config of a result, which may contain keys of earlier versions.

    The errors are those of `load`.
    """
    document, source = read_document(path)
    for name, key in schema.REMOVED_KEYS:
        section = document.get(name)
        if isinstance(section, dict) and (value := section.pop(key, None)) and name == "experiment":
            _migrate_key(document, key, value)
    return _validate(document, source)


def _migrate_key(document: Document, key: str, value: Any) -> None:
    """Move a key of an earlier version from `experiment` to its present section.

    A history replaces the loading; a relaxation is moved to every material.
    """
    if schema.MOVED_KEYS[key] == "loading":
        document["loading"] = {key: value}
    else:
        body = document.get("body") or {}
        owners = (document, *(body.get("layers") or ()), *(body.get("inclusions") or ()))
        laws = [owner["material"] for owner in owners if owner.get("material")]
        for law in (*laws, *(body.get("regions") or {}).values()):
            law[key] = value
    if not document.get("experiment"):
        document.pop("experiment", None)


def loads(text: str, name: str = "", overrides: Overrides = ()) -> Config:
    """Return the config of a YAML text; `name` is its name in errors."""
    document, source = _parse_document(text, name)
    return _apply_overrides(document, source, overrides)


def is_study(document: Mapping[str, Any]) -> bool:
    """Return whether a document is a study: a scene with variations, or a list of cases."""
    return document.keys() >= STUDY_SECTIONS or "cases" in document


def read_document(path: str | os.PathLike[str]) -> tuple[Document, Source]:
    """Return the unchecked sections of a YAML file and the position of every key.

    The errors are those of `load`.
    """
    name = os.fspath(path)
    content = _read_content(name)
    try:
        return _parse_document(content.decode("utf-8-sig"), name)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ConfigError(
            "", "the file is not UTF-8 text", "save the file as UTF-8", name, line
        ) from None


def _parse_document(text: str, name: str) -> tuple[Document, Source]:
    """Return the sections of a YAML text and the position of every key."""
    document, lines = strict_yaml.parse(text, name)
    if not isinstance(document, dict):
        problem = (
            "the file is empty" if document is None else "a scene consists of sections (key: value)"
        )
        raise ConfigError("", problem, "see docs/config.md", name, lines.get((), 1))
    return document, Source(name, {path: (name, line) for path, line in lines.items()})


def config_from_mapping(data: Mapping[str, Any], overrides: Overrides = ()) -> Config:
    """Return the config of nested mappings, lists, numbers and dataclasses.

    The mappings have the structure of a file. Numbers and arrays of numpy are allowed. See `load`
    for `overrides`.
    """
    return _apply_overrides(plain_document(data), Source(), overrides)


def plain_document(data: Mapping[str, Any]) -> Document:
    """Return nested mappings, lists, numbers and dataclasses as the document of a file."""
    document = _plain_value(data, ())
    if not isinstance(document, dict):
        raise ConfigError("", "a scene consists of sections")
    return document


def config_with_settings(
    document: Mapping[str, Any], source: Source, settings: Iterable[tuple[str, Any, SourceLocation]]
) -> Config:
    """Return the config of a document after replacement of some keys.

    Parameters
    ----------
    document, source
        Sections of a file and the positions of its keys; both remain unchanged.
    settings
        Dotted key, value, and position of the value in a file. The last setting of a key is used.
    """
    new_document = copy.deepcopy(dict(document))
    new_source = dataclasses.replace(source, locations=dict(source.locations))
    for key, value, place in settings:
        _set_key(new_document, new_source, key_path(key), copy.deepcopy(value), place)
    return _validate(new_document, new_source)


def quantities_of(
    document: Mapping[str, Any], settings: Iterable[tuple[str, Any, SourceLocation]]
) -> Quantities:
    """Return the quantities of a document after replacement of some keys.

    The parameters are those of `config_with_settings`. Each quantity is returned as it was given,
    and as a number in the units of the document. Raises ConfigError for an invalid unit.
    """
    new_document = copy.deepcopy(dict(document))
    new_source = Source()
    for key, value, place in settings:
        _set_key(new_document, new_source, key_path(key), copy.deepcopy(value), place)
    return convert_quantities(new_document)[1]


def locate_error(where: Config | Source, error: ConfigError) -> ConfigError:
    """Return an error with file and line of its key or of the enclosing section."""
    source = where.source if isinstance(where, Config) else where
    if isinstance(error, ConfigErrors):
        errors = [locate_error(source, part) for part in error.errors]
        return ConfigErrors(sorted(errors, key=lambda part: part.line or math.inf))
    if error.file:
        return error
    file, line = source.location(key_path(error.key)) if error.key else (source.name, None)
    return dataclasses.replace(error, file=file, line=line)


def to_yaml(config: Config) -> str:
    """Return the complete config, including defaults, as YAML that loads to an equal config."""
    return strict_yaml.dump(to_mapping(config))


def to_mapping(config: Config, keys: Iterable[str] | None = None) -> Document:
    """Return the config, or some of its keys, as nested mappings like a file."""
    values = {name: getattr(config, name) for name in keys or schema.allowed_keys_at((), {})}
    data = {name: _document_value(value) for name, value in values.items() if value is not None}
    if config.center is not None and "indenter" in data:
        data["indenter"]["center"] = list(config.center)
    if config.tilt and "indenter" in data:
        data["indenter"] |= {"tilt": config.tilt, "tilt_towards": config.tilt_towards}
    return data


def _section_document(item: Any) -> Document:
    """Return a dataclass as the section of a file, without keys that are None."""
    unused: set[str] = set()
    if isinstance(item, Loading):
        unused = {
            *([] if {*STEPPED_KEYS} & {*item.given_path_keys} else ["steps"]),
            *([] if item.prescribed_history else ["times"]),
        }
    values = {
        name: getattr(item, name) for name in schema.file_order(type(item)) if name not in unused
    }
    return {name: _document_value(value) for name, value in values.items() if value is not None}


def _document_value(value: Any) -> Any:
    """Return the value of a field as it is written in a file, with one word for equal walls."""
    kind: Any = type(value)
    if kind in SCALARS:
        return value
    if dataclasses.is_dataclass(value):
        section = _section_document(value)
        is_walls = bool(key_types.allowed_words(kind))
        if is_walls and len(set(section.values())) <= 1:
            return next(iter(section.values()))
        return section
    if isinstance(value, dict):
        return {name: _document_value(part) for name, part in value.items()}
    return [_document_value(part) for part in value] if isinstance(value, tuple) else value


def _read_content(name: str) -> bytes:
    """Return the bytes of a file; raise UsageError if it cannot be read."""
    try:
        with open_regular_file(name) as stream:
            content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"cannot read the config {name}: {reason}", file=name) from None
    if len(content) > MAX_BYTES:
        raise ConfigError(
            "", f"the file is longer than {MAX_BYTES} bytes", "this is not a scene", name
        )
    return content


def _apply_overrides(document: Document, source: Source, overrides: Overrides) -> Config:
    """Return the config of a document with overrides, or raise all its errors."""
    if isinstance(overrides, Mapping):
        return config_with_settings(
            document, source, [_check_setting(key, value) for key, value in overrides.items()]
        )
    set_paths: set[KeyPath] = set()
    errors: list[ConfigError] = []
    for text in overrides:
        try:
            path = _apply_override(document, source, text)
            if path in set_paths:
                raise ConfigError(key_text(path), "given twice with --set", "keep one", "--set")
            set_paths.add(path)
        except ConfigError as error:
            errors.append(error)
    try:
        config = _validate(document, source)
    except ConfigError as error:
        raise ConfigErrors.combine([*errors, *_independent_errors(errors, error)]) from None
    if errors:
        raise ConfigErrors.combine(errors)
    return config


def collect_errors(
    first: ConfigError, config: Config, check: Callable[[Config], object]
) -> ConfigError:
    """Return the first error of a config, combined with the errors that remain after its repair.

    Parameters
    ----------
    first
        Error that `check` raised for the config.
    config
        Config with the error.
    check
        Function that raises ConfigError for a config with errors.
    """
    parse_again = partial(_parse_config, source=config.source)
    return _collect_document_errors(
        first, to_mapping(config), config.source, lambda document: check(parse_again(document))
    )


def _collect_document_errors(
    first: ConfigError, document: Document, source: Source, check: Callable[[Any], object]
) -> ConfigError:
    """Return the errors of a document, including those that remain after repair of the first error.

    An invalid key is replaced by the key that was probably meant, or removed. All errors have
    positions.
    """
    document = copy.deepcopy(document)
    source = dataclasses.replace(source, locations=dict(source.locations))
    errors: list[ConfigError] = []
    new_errors = first.errors
    while new_errors and len(errors) < MAX_PROBLEMS:
        errors += [locate_error(source, mistake) for mistake in new_errors]
        if not all(_repair_key(document, source, mistake) for mistake in new_errors):
            break
        try:
            check(document)
            break
        except ConfigError as error:
            new_errors = _independent_errors(errors, error)
    if len(errors) > MAX_PROBLEMS:
        errors = [*errors[:MAX_PROBLEMS], MORE_ERRORS]
    return locate_error(source, ConfigErrors.combine(errors))


def _independent_errors(
    earlier_errors: Sequence[ConfigError], error: ConfigError
) -> list[ConfigError]:
    """Return the errors that do not result from the removal of keys with earlier errors.

    The returned errors concern other sections and keys, and do not request a key that was removed.
    """
    earlier_paths = [
        path[:-1] if path[-1] in schema.TAG_KEYS else path
        for path in (key_path(earlier.key) for earlier in earlier_errors)
        if path
    ]
    errors_with_path = [
        (part, key_path(part.key))
        for part in error.errors
        if not _is_consequence(earlier_errors, part)
    ]
    return [
        part
        for part, path in errors_with_path
        if not any(path[: len(old)] == old[: len(path)] for old in earlier_paths)
    ]


def _is_consequence(earlier_errors: Sequence[ConfigError], error: ConfigError) -> bool:
    """Return whether the remedy of an error requests the key of an earlier error."""
    words = re.split(r"[\s,;]+", error.remedy)
    return any(
        earlier.key and not earlier.suggestion and earlier.key in words
        for earlier in earlier_errors
    )


def _repair_key(document: Document, source: Source, error: ConfigError) -> bool:
    """Replace an invalid key or value by the probable intended one, or remove it.

    Returns True if that was possible.
    """
    path = key_path(error.key)
    section = schema.node_at(path[:-1], document).value
    if not path or not isinstance(section, dict) or path[-1] not in section:
        return False
    value = section.pop(path[-1])
    if error.suggestion and isinstance(value, str):
        section[path[-1]] = error.suggestion
    elif error.suggestion and error.suggestion not in section:
        section[error.suggestion] = value
        new_path = (*path[:-1], error.suggestion)
        inner_paths = [old for old in source.locations if old[: len(path)] == path]
        source.locations.update(
            {(*new_path, *old[len(path) :]): source.locations[old] for old in inner_paths}
        )
    return True


def _check_setting(key: str, value: Any) -> tuple[str, Any, SourceLocation]:
    """Return a setting for `config_with_settings`; raise ConfigError for an invalid key."""
    if not (
        isinstance(key, str) and KEY_PATTERN.fullmatch(key) and len(key_path(key)) <= MAX_DEPTH
    ):
        raise ConfigError("", f"{key!r} is not a key", "write it with dots, e.g. contact.method")
    return key, _plain_value(value, key_path(key)), ("", None)


def _apply_override(document: Document, source: Source, text: str) -> KeyPath:
    """Set one key of the document and record the source of the value."""
    # Largest number of characters of a --set that a message repeats.
    max_characters = 80
    shortened_text = text if len(text) <= max_characters else f"{text[:max_characters]}..."
    label = f"--set {shortened_text}"
    key, equals, value = text.partition("=")
    if not equals or not KEY_PATTERN.fullmatch(key.strip()):
        raise ConfigError(
            "", "is not key=value", "write for example --set contact.method=penalty", label
        )
    path = key_path(key.strip())
    if len(path) > MAX_DEPTH:
        raise ConfigError(
            key_text(path[:3]), f"has {len(path)} parts", f"use at most {MAX_DEPTH}", label
        )
    try:
        parsed, _ = strict_yaml.parse(value, label)
    except ConfigError as error:
        raise dataclasses.replace(error, key=key_text(path), line=None) from None
    _set_key(document, source, path, parsed, (label, None))
    return path


def _set_key(
    document: Document, source: Source, path: KeyPath, value: Any, place: SourceLocation
) -> None:
    """Set the value of a key and record its position."""
    section = _parent_section(document, source, path, place)
    section[path[-1]] = value
    inner_paths = [known_path for known_path in source.locations if known_path[: len(path)] == path]
    for inner_path in inner_paths:
        del source.locations[inner_path]
    source.locations[path] = place


def _parent_section(
    document: Document, source: Source, path: KeyPath, place: SourceLocation
) -> Any:
    """Return the mapping or list that contains the last part of a key path.

    Missing sections are created.
    """
    section: Any = document
    for depth, part in enumerate(path, start=1):
        if isinstance(part, int) and not (isinstance(section, list) and part < len(section)):
            size = f"has {len(section)} items" if isinstance(section, list) else "is not a list"
            raise ConfigError(
                key_text(path),
                f"{key_text(path[: depth - 1])} {size}",
                "items are counted from [0]",
                *place,
            )
        if isinstance(part, str) and not isinstance(section, dict):
            key = key_text(path[: depth - 1])
            example = f"{key}={{{path[-1]}: ...}}"
            raise ConfigError(
                key_text(path),
                f"{key} is not a section",
                f"set the whole section: {example}",
                *place,
            )
        if depth == len(path):
            break
        if isinstance(section, dict) and part not in section:
            source.locations[path[:depth]] = place
            section[part] = {}
        section = section[part]
    return section


def _validate(document: Document, source: Source) -> Config:
    """Return the config of a document, or raise all its errors with their positions."""
    if is_study(document):
        problem = "this is a study, not a scene"
        remedy = f"run it with `indent-sim study {source.name or 'FILE'}`"
        raise ConfigError(
            "", problem, remedy, *source.location(("vary" if "vary" in document else "cases",))
        )
    try:
        return _parse_config(document, source)
    except ConfigError as error:
        raise _collect_document_errors(
            error, document, source, partial(_parse_config, source=source)
        ) from None


def _parse_config(document: Document, source: Source) -> Config:
    """Return the config of a document, or raise its first errors without positions."""
    try:
        document, quantities = convert_quantities(document)
        source = dataclasses.replace(source, quantities=quantities)
        # Strict pydantic accepts a list for a tuple and a mapping for a dataclass only from JSON.
        config = Config.model_validate_json(json.dumps(_config_fields(document)))
        if "steps" in document["loading"] and not {*STEPPED_KEYS} & {
            *config.loading.given_path_keys
        }:
            path_key = config.loading.given_path_keys[0]
            owner = "force" if "force" in path_key else "delta"
            verb = "are" if path_key.endswith("s") else "is"
            raise ConfigError(
                "loading.steps",
                f"applies only to a single {owner}, which is divided into equal steps, but "
                f"{path_key} {verb} given",
                "remove one of them",
            )
    except ValidationError as error:
        raise config_error(error, document) from None
    config._source = source
    return config


def _config_fields(document: Document) -> Document:
    """Return the document with the structure of Config.

    `PLACEMENT_KEYS` are fields of Config, not of the tip. Default tags are added, and a word such
    as "fixed" for all walls is expanded to every wall.
    """
    for name in schema.PLACEMENT_KEYS:
        if name in document:
            raise ConfigError(name, "unknown key", "it belongs in indenter")
    fields = _complete_defaults(schema.node_at((), document))
    tip = fields.get("indenter")
    if isinstance(tip, dict):
        fields |= {name: tip.pop(name) for name in schema.PLACEMENT_KEYS if name in tip}
    return fields


def _complete_defaults(node: schema.SchemaNode) -> Any:
    """Return the value of a YAML node with its missing tags filled in.

    A single word that applies to all walls is replaced by one entry for each wall.
    """
    value = node.value
    if (
        isinstance(value, str)
        and node.tag is None
        and node.section_type is not None
        and key_types.shared_field_type(node.section_type)
    ):
        return dict.fromkeys(key_types.field_names(node.section_type), value)
    if isinstance(value, dict):
        section = {part.path[-1]: _complete_defaults(part) for part in node.children()}
        if node.tag and node.tag_value is not None:
            return {node.tag: node.tag_value} | section
        return section
    if isinstance(value, list):
        return [_complete_defaults(item) for item in node.children()]
    return value


def _plain_value(value: Any, path: KeyPath) -> Any:
    """Return a value converted to the mappings, lists and scalars of a file."""
    if len(path) > MAX_DEPTH:
        raise ConfigError(key_text(path[:3]), f"nested deeper than {MAX_DEPTH} levels")
    # Arrays and scalars of numpy become lists and numbers.
    if hasattr(value, "tolist"):
        value = value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = _section_document(value)
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ConfigError(key_text(path), f"a key must be a word, got {key!r}")
        return {key: _plain_value(part, (*path, key)) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain_value(part, (*path, index)) for index, part in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(key_text(path), f"{value} is not a finite number")
    if isinstance(value, str) and strict_yaml.UNWRITABLE.search(value):
        raise ConfigError(key_text(path), "the text contains a character that no file can have")
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise ConfigError(key_text(path), f"a {type(value).__name__} is not a value of a scene")
