"""Error messages of a scene file: pydantic's findings as key, problem and remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from indent_sim.config import key_types, schema
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError, ConfigErrors

MOST_PROBLEMS = 20  # of one file that are told
AND_MORE = ConfigError("", "and more errors like these")

_MISSING = {"missing", "missing_argument", "missing_keyword_only_argument"}
_UNKNOWN = {"extra_forbidden", "unexpected_keyword_argument"}
_NO_SECTION = {"dict_type", "dataclass_type", "model_type", "dataclass_exact_type"}


def in_words(error: ValidationError, document: Mapping[str, Any]) -> ConfigError:
    """One ConfigError (ConfigErrors when there are several) for what pydantic found in the
    document.
    """
    groups: dict[KeyPath, list[Any]] = {}
    for found in error.errors(include_url=False, include_input=False)[: 100 * MOST_PROBLEMS]:
        groups.setdefault(document_path(found, document), []).append(found)
    for path in list(_echoes(groups, document)):
        groups.pop(path, None)
    problems = [
        _in_words(path, found, document) for path, found in list(groups.items())[:MOST_PROBLEMS]
    ]
    if len(groups) > MOST_PROBLEMS:
        problems.append(AND_MORE)
    return ConfigErrors.combine(problems)


def _echoes(groups: dict[KeyPath, list[Any]], document: Mapping[str, Any]) -> Iterator[KeyPath]:
    """Keys whose error only repeats another: the misspelt key that is missing, the list with wrong
    items, the section that is no word either.
    """
    for path, (found, *_) in groups.items():
        is_section = key_types.unnamed_sections(schema.spot_at(path, document).type)
        if is_section and any(other[:-1] == path for other in groups):
            yield path
        yield from (path[:k] for k, part in enumerate(path) if isinstance(part, int))
        if not path or isinstance(path[-1], int):
            continue
        if found["type"] in _UNKNOWN:
            meant = (*path[:-1], closest(path[-1], schema.keys_at(path[:-1], document)) or "")
            if meant in groups and groups[meant][0]["type"] in _MISSING:
                yield meant


def document_path(found: Any, document: Mapping[str, Any]) -> KeyPath:
    """The key path in the file of one pydantic error: without union tags and the names of classes
    that pydantic gives to sections which may stand in place of a word, `center` back in its
    section.
    """
    location = found["loc"]
    if location[:1] == ("center",):
        location = ("indenter", "", *location)  # the tag, which pydantic names after every choice
    spot = schema.spot_at((), document)
    is_tag = False
    for part in location:
        if is_tag:
            is_tag = False
            continue
        if part in key_types.unnamed_sections(spot.type):
            continue
        inner = spot.inside(part)
        if inner.value is None and not schema.holds(spot.value, part):
            is_key = found["type"] in _MISSING | _UNKNOWN and isinstance(spot.value, Mapping)
            return inner.path if is_key else spot.path
        spot = inner
        is_tag = inner.tag is not None
    return spot.path


def closest(word: Any, choices: tuple[str, ...]) -> str | None:
    """The choice that was probably meant."""
    folded = {str(choice).lower(): str(choice) for choice in reversed(choices)}
    match = get_close_matches(str(word).lower(), folded, n=1, cutoff=0.6)
    return folded[match[0]] if match else None


def shown(value: Any) -> str:
    """A value as the file has it, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _in_words(path: KeyPath, found: list[Any], document: Mapping[str, Any]) -> ConfigError:
    types = {error["type"] for error in found}
    if types & _UNKNOWN:
        return _unknown_key(path, document)
    if types & _MISSING:
        return _missing_key(path, document)
    if types & {"union_tag_invalid", "union_tag_not_found"}:
        return _wrong_kind(path, document)
    if types & _NO_SECTION:
        return _no_section(path, document)
    if "finite_number" in types:
        return ConfigError(key_text(path), "is too large a number")
    spot = schema.spot_at(path, document)
    return ConfigError(key_text(path), found[0]["msg"]) if spot.type is None else _wrong_value(spot)


def _unknown_key(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    if path in schema.GONE:
        return ConfigError(key_text(path), *schema.GONE[path])
    *parents, key = path
    section = schema.spot_at(tuple(parents), document)
    valid = section.keys()
    if others := _variants_with(str(key), section, valid):
        owners = key_types.listed(others, "and")
        problem = (
            f"the chosen {section.tag} '{section.choice}' has no parameter '{key}' (it "
            f"belongs to {owners})"
        )
        return ConfigError(key_text(path), problem, f"remove it; valid here: {', '.join(valid)}")
    if match := closest(key, valid):
        return ConfigError(
            key_text(path), f"unknown key, did you mean '{match}'?", suggestion=match
        )
    if homes := [name for name in schema.sections() if not section.path and key in _all_keys(name)]:
        return ConfigError(key_text(path), "unknown key", f"it belongs in {' or '.join(homes)}")
    return ConfigError(key_text(path), "unknown key", f"valid here: {', '.join(valid)}")


def _missing_key(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    spot = schema.spot_at(path, document)
    if spot.tag or spot.kind is not None:
        return ConfigError(key_text(path), "this section is missing", _give(spot))
    return ConfigError(key_text(path), "missing", f"give {key_types.describe(spot.type)}")


def _wrong_kind(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    spot = schema.spot_at(path, document)
    tag = str(spot.tag)
    kinds = tuple(key_types.kinds_of(spot.type, str(spot.tag)))
    key = key_text((*path, tag))
    remedy = f"choose one of {', '.join(kinds)}"
    if spot.choice is None:
        return ConfigError(key, "missing", remedy)
    match = closest(spot.choice, kinds) if isinstance(spot.choice, str) else None
    guess = f", did you mean '{match}'?" if match else ""
    name = next(part for part in reversed(path) if isinstance(part, str))
    return ConfigError(
        key, f"there is no {name} {shown(spot.choice)}{guess}", remedy, suggestion=match or ""
    )


def _no_section(path: KeyPath, document: Mapping[str, Any]) -> ConfigError:
    spot = schema.spot_at(path, document)
    if key_types.words_of(spot.type) and spot.value is not None:
        return _wrong_value(spot)
    empty = spot.value is None
    problem = (
        "this section is empty" if empty else f"must be a section of keys, got {shown(spot.value)}"
    )
    return ConfigError(key_text(path), problem, _give(spot))


def _wrong_value(spot: schema.Spot) -> ConfigError:
    path = spot.path
    hint = spot.type
    value = spot.value
    allowed = key_types.describe(hint)
    if type(value) in (int, float):
        allowed = allowed.removeprefix("a number ")
    if type(value) is int:
        allowed = allowed.removeprefix("a whole number ")
    match = closest(value, key_types.words_of(hint)) if isinstance(value, str) else None
    remedy = f"did you mean '{match}'?" if match else key_types.remedy_of(hint)
    return ConfigError(
        key_text(path), f"must be {allowed}, got {shown(value)}", remedy, suggestion=match or ""
    )


def _give(spot: schema.Spot) -> str:
    if spot.tag:
        return f"give {spot.tag}: one of {', '.join(key_types.kinds_of(spot.type, spot.tag))}"
    keys = spot.keys()
    return f"its keys are {', '.join(keys)}" if keys else ""


def _variants_with(key: str, section: schema.Spot, valid: tuple[str, ...]) -> list[str]:
    """The other choices of a section that know this key."""
    if section.tag is None or key.lower() in map(str.lower, valid):
        return []
    kinds = key_types.kinds_of(section.type, section.tag)
    return [value for value, kind in kinds.items() if key in key_types.field_names(kind)]


def _all_keys(section: str) -> set[str]:
    if section == "units":
        return set()
    own = {name for kind in schema.sections()[section] for name in key_types.field_names(kind)}
    return own | {"center"} if section == "indenter" else own
