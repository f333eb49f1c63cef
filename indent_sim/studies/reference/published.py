"""Published values: what a source states of a scene, what it claims of that, and how the exact
value is known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from indent_sim.config.messages import closest
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import RESULT_COLUMNS

CLAIMS = ("exact", "fit", "elements")
PULL_OFF = "pull_off"
QUANTITIES = (*RESULT_COLUMNS, PULL_OFF)
PLACES = ("delta", "t", "step")  # what a row is named by
PUBLISHED_KEYS = ("quantity", "at", "value", "claims", "within", "source")
REQUIRED_KEYS = ("quantity", "value", "claims", "source")
EXACT = ("value", "case", "by")


@dataclass(frozen=True)
class Published:
    """A value [user's units] that a source states of a row of a scene.

    at: what names the row, (delta | t | step, number), None for the last; claims: what the source
    says that it is, and within: how far off the exact value, relative, it may be by its own
    account; None where the source says nothing of that, and its value is not judged.
    """

    quantity: str
    value: float
    at: tuple[str, float] | None
    claims: str
    within: float | None
    source: str


@dataclass(frozen=True)
class Exact:
    """How the exact value is known where theory does not: a number, or the run of another case;
    `by` in words.
    """

    by: str
    value: float | None = None
    case: str = ""


def read_published(given: Any, keys: KeyPath) -> Published:
    """The section `published` of a case; ConfigError, without its place, for anything wrong in it."""
    section = _section(given, keys, PUBLISHED_KEYS, REQUIRED_KEYS)
    quantity = section["quantity"]
    claims = section["claims"]
    if quantity not in QUANTITIES:
        near = closest(str(quantity), QUANTITIES)
        said = (
            f"is no number of a result, did you mean '{near}'?"
            if near
            else "is no number of a result"
        )
        raise _error(
            (*keys, "quantity"), said, f"force, a, p_max, {PULL_OFF}, E_hertz or another column"
        )
    if claims not in CLAIMS:
        raise _error(
            (*keys, "claims"),
            "is none of exact, fit, elements",
            "what the source says that its value is",
        )
    within = _number(section, "within", keys) if section.get("within") is not None else None
    if within is not None and not 0 < within < 1:
        raise _error((*keys, "within"), "must be between 0 and 1", "0.01: the source claims 1 %")
    if not _number(section, "value", keys):
        raise _error((*keys, "value"), "must not be 0", "differences are parts of it")
    words = _words(section, "source", keys)
    return Published(
        quantity, float(section["value"]), _place(section, keys), claims, within, words
    )


def read_exact(given: Any, keys: KeyPath) -> Exact:
    """The section `exact` of a case; ConfigError, without its place, for anything wrong in it."""
    section = _section(given, keys, EXACT, ("by",))
    if ("value" in section) == ("case" in section):
        raise _error(
            keys,
            "must have one of value and case",
            "a number, or the name of a case that is run beside",
        )
    value = _number(section, "value", keys) if "value" in section else None
    if value == 0:
        raise _error((*keys, "value"), "must not be 0", "differences are parts of it")
    return Exact(
        _words(section, "by", keys),
        value,
        _words(section, "case", keys) if "case" in section else "",
    )


def _section(
    given: Any, keys: KeyPath, known: tuple[str, ...], needed: tuple[str, ...]
) -> Mapping[str, Any]:
    if not isinstance(given, dict):
        raise _error(keys, "must be a section of keys", f"it has {', '.join(known)}")
    if unknown := [key for key in given if key not in known]:
        raise _error((*keys, unknown[0]), "unknown key", f"valid here: {', '.join(known)}")
    if missing := [key for key in needed if key not in given]:
        raise _error((*keys, missing[0]), "missing", f"needed here: {', '.join(needed)}")
    return given


def _place(section: Mapping[str, Any], keys: KeyPath) -> tuple[str, float] | None:
    at = section.get("at")
    if at is None:
        return None
    if not isinstance(at, dict) or len(at) != 1 or next(iter(at)) not in PLACES:
        raise _error(
            (*keys, "at"), "must name one row", "write {delta: 0.01}, {t: 1.5} or {step: 3}"
        )
    name = next(iter(at))
    return name, _number(at, name, (*keys, "at"))


def _number(section: Mapping[str, Any], key: str, keys: KeyPath) -> float:
    value = section[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise _error((*keys, key), "must be a number, in the units of the scene")
    return float(value)


def _words(section: Mapping[str, Any], key: str, keys: KeyPath) -> str:
    value = section[key]
    if not isinstance(value, str) or not value.strip():
        raise _error((*keys, key), "must be a text")
    return " ".join(value.split())


def _error(keys: KeyPath, problem: str, remedy: str = "") -> ConfigError:
    return ConfigError(key_text(keys), problem, remedy)
