"""Error messages for a scene file: conversion of pydantic's errors to key, problem and remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from indent_sim.config import key_types, schema
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError, ConfigErrors

# Largest number of errors of one file that are reported.
MAX_PROBLEMS = 20
MORE_ERRORS = ConfigError("", "and more errors")

# Types of pydantic's errors.
_MISSING_TYPES = {"missing", "missing_argument", "missing_keyword_only_argument"}
_UNKNOWN_TYPES = {"extra_forbidden", "unexpected_keyword_argument"}
_NO_SECTION_TYPES = {"dict_type", "dataclass_type", "model_type", "dataclass_exact_type"}


def config_error(error: ValidationError, document: Mapping[str, Any]) -> ConfigError:
    """Return pydantic's errors in a document as a ConfigError.

    Several errors are returned as ConfigErrors.
    """
    groups: dict[KeyPath, list[Any]] = {}
    for finding in error.errors(include_url=False, include_input=False)[: 100 * MAX_PROBLEMS]:
        groups.setdefault(document_path(finding, document), []).append(finding)
    for path in list(_repeated_errors(groups, document)):
        groups.pop(path, None)
    problems = [
        _error_at(path, finding, document) for path, finding in list(groups.items())[:MAX_PROBLEMS]
    ]
    if len(groups) > MAX_PROBLEMS:
        problems.append(MORE_ERRORS)
    return ConfigErrors.combine(problems)


def _repeated_errors(
    groups: dict[KeyPath, list[Any]], document: Mapping[str, Any]
) -> Iterator[KeyPath]:
    """Yield keys whose error only repeats another error.

    Such keys are a missing key that was misspelt, a list with invalid items, and a section with
    invalid keys that could also be a word.
    """
    for path, (finding, *_) in groups.items():
        is_section = key_types.untagged_sections(schema.node_at(path, document).type)
        if is_section and any(inner_path[:-1] == path for inner_path in groups):
            yield path
        yield from (path[:k] for k, part in enumerate(path) if isinstance(part, int))
        if not path or isinstance(path[-1], int):
            continue
        if finding["type"] in _UNKNOWN_TYPES:
            valid_keys = schema.allowed_keys_at(path[:-1], document)
            intended_path = (*path[:-1], closest_match(path[-1], valid_keys) or "")
            if intended_path in groups and groups[intended_path][0]["type"] in _MISSING_TYPES:
                yield intended_path


def document_path(finding: Any, document: Mapping[str, Any]) -> KeyPath:
    """Return the key path in the file for an error of pydantic.

    Pydantic's location also contains tags of unions and names of classes, which are left out;
    `PLACEMENT_KEYS`, which are fields of Config, are moved to their section `indenter`.
    """
    location = finding["loc"]
    if location[0:1] and location[0] in schema.PLACEMENT_KEYS:
        # The empty text stands for the tag, which pydantic inserts after every tagged section.
        location = ("indenter", "", *location)
    node = schema.node_at((), document)
    is_tag = False
    for part in location:
        if is_tag:
            is_tag = False
            continue
        if part in key_types.untagged_sections(node.type):
            continue
        inner = node.child(part)
        if inner.value is None and not schema.has_part(node.value, part):
            is_about_key = finding["type"] in _MISSING_TYPES | _UNKNOWN_TYPES
            is_section = isinstance(node.value, Mapping)
            return inner.path if is_about_key and is_section else node.path
        node = inner
        is_tag = inner.tag is not None
    return node.path


def closest_match(word: Any, choices: tuple[str, ...]) -> str | None:
    """Return the most similar choice, ignoring case; None if no choice is similar."""
    folded = {str(choice).lower(): str(choice) for choice in reversed(choices)}
    match = get_close_matches(str(word).lower(), folded, n=1, cutoff=0.6)
    return folded[match[0]] if match else None


def short_repr(value: Any) -> str:
    """Return a value as it is written in the file, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _error_at(path: KeyPath, findings: list[Any], document: Mapping[str, Any]) -> ConfigError:
    """Return the ConfigError for a key from pydantic's errors for this key."""
    types = {error["type"] for error in findings}
    if types & _UNKNOWN_TYPES:
        return _unknown_key_error(path, document)
    if types & _MISSING_TYPES:
        return _missing_key_error(path, document)
    if types & {"union_tag_invalid", "union_tag_not_found"}:
        return _wrong_tag_error(path, document)
    if types & _NO_SECTION_TYPES:
        return _no_section_error(path, document)
    if "finite_number" in types:
        return ConfigError(key_text(path), "is too large a number")
    node = schema.node_at(path, document)
    if node.type is None:
        return ConfigError(key_text(path), findings[0]["msg"])
    error = _wrong_value_error(node)
    key_of_list = f"{path[-1]}s" if path else ""
    is_list = isinstance(node.value, list)
    if is_list and key_of_list in schema.allowed_keys_at(path[:-1], document):
        error.remedy = f"give a list of values as '{key_of_list}'"
    return error


def _unknown_key_error(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    """Return the ConfigError for an unknown key, with the most similar valid key."""
    if path in schema.REMOVED_KEYS:
        return ConfigError(key_text(path), *schema.REMOVED_KEYS[path])
    *parents, key = path
    section = schema.node_at(tuple(parents), document)
    valid = section.allowed_keys()
    if variants := _variants_with_key(str(key), section, valid):
        owners = key_types.join_words(variants, "and")
        problem = (
            f"the chosen {section.tag} '{section.tag_value}' has no parameter '{key}' (it "
            f"belongs to {owners})"
        )
        return ConfigError(key_text(path), problem, f"remove it; valid here: {', '.join(valid)}")
    if match := closest_match(key, valid):
        return ConfigError(
            key_text(path), f"unknown key, did you mean '{match}'?", suggestion=match
        )
    if sections_with_key := [
        name for name in schema.sections() if not section.path and key in _section_keys(name)
    ]:
        return ConfigError(
            key_text(path), "unknown key", f"it belongs in {' or '.join(sections_with_key)}"
        )
    return ConfigError(key_text(path), "unknown key", f"valid here: {', '.join(valid)}")


def _missing_key_error(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    """Return the ConfigError for a missing key or section."""
    node = schema.node_at(path, document)
    if node.tag or node.section_type is not None:
        return ConfigError(key_text(path), "this section is missing", _section_remedy(node))
    return ConfigError(key_text(path), "missing", f"give {key_types.describe_type(node.type)}")


def _wrong_tag_error(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    """Return the ConfigError for a missing or unknown tag."""
    node = schema.node_at(path, document)
    tag = str(node.tag)
    kinds = tuple(key_types.types_by_tag(node.type, str(node.tag)))
    key = key_text((*path, tag))
    remedy = f"choose one of {', '.join(kinds)}"
    if node.tag_value is None:
        return ConfigError(key, "missing", remedy)
    match = closest_match(node.tag_value, kinds) if isinstance(node.tag_value, str) else None
    guess = f", did you mean '{match}'?" if match else ""
    name = next(part for part in reversed(path) if isinstance(part, str))
    return ConfigError(
        key,
        f"there is no {name} {short_repr(node.tag_value)}{guess}",
        remedy,
        suggestion=match or "",
    )


def _no_section_error(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    """Return the ConfigError for a value in place of a section."""
    node = schema.node_at(path, document)
    if key_types.allowed_words(node.type) and node.value is not None:
        return _wrong_value_error(node)
    problem = "this section is empty"
    if node.value is not None:
        problem = f"must be a mapping of keys to values, got {short_repr(node.value)}"
    return ConfigError(key_text(path), problem, _section_remedy(node))


def _wrong_value_error(node: schema.SchemaNode) -> ConfigError:
    """Return the ConfigError for a value that its type does not allow."""
    path = node.path
    hint = node.type
    value = node.value
    allowed = key_types.describe_type(hint)
    if type(value) in (int, float):
        allowed = allowed.removeprefix("a number ")
    if type(value) is int:
        allowed = allowed.removeprefix("a whole number ")
    match = closest_match(value, key_types.allowed_words(hint)) if isinstance(value, str) else None
    remedy = f"did you mean '{match}'?" if match else key_types.remedy_of(hint)
    return ConfigError(
        key_text(path),
        f"must be {allowed}, got {short_repr(value)}",
        remedy,
        suggestion=match or "",
    )


def _section_remedy(node: schema.SchemaNode) -> str:
    """Return a remedy that lists the tags or keys of a section."""
    if node.tag:
        return f"give {node.tag}: one of {', '.join(key_types.types_by_tag(node.type, node.tag))}"
    keys = node.allowed_keys()
    return f"its keys are {', '.join(keys)}" if keys else ""


def _variants_with_key(key: str, section: schema.SchemaNode, valid: tuple[str, ...]) -> list[str]:
    """Return the other alternatives of a section that have this key."""
    if section.tag is None or key.lower() in map(str.lower, valid):
        return []
    kinds = key_types.types_by_tag(section.type, section.tag)
    return [value for value, kind in kinds.items() if key in key_types.field_names(kind)]


def _section_keys(section: str) -> set[str]:
    """Return all keys of a section with any of its tags."""
    if section == "units":
        return set()
    keys = {name for kind in schema.sections()[section] for name in key_types.field_names(kind)}
    return keys | {*schema.PLACEMENT_KEYS} if section == "indenter" else keys
