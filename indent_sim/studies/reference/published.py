"""Published values of a source for a scene, and the corresponding exact values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from indent_sim.config.messages import closest_match
from indent_sim.config.strict_yaml import KeyPath, key_text
from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import RESULT_COLUMNS

PULL_OFF = "pull_off"
QUANTITIES = (*RESULT_COLUMNS, PULL_OFF)


@dataclass(frozen=True)
class PublishedValue:
    """Published value of one row of a scene, in the user's units.

    Attributes
    ----------
    row_key
        Column (delta, t or step) and value that identify the row; None for the last row.
    claimed_kind
        Kind of the value according to the source: "exact", "fit" or "elements".
    claimed_error
        Relative error that the source claims; None if the source states no accuracy. The value is
        then compared without a verdict.
    """

    quantity: str
    value: float
    row_key: tuple[str, float] | None
    claimed_kind: str
    claimed_error: float | None
    source: str


@dataclass(frozen=True)
class ExactValue:
    """Exact value that replaces the theory: a number, or the name of the case that computes it.

    `method` is a text on the method by which the value was obtained.
    """

    method: str
    value: float | None = None
    case: str = ""


def read_published(raw_section: Any, keys: KeyPath) -> PublishedValue:
    """Read and check the section `published` of a case.

    ConfigErrors have no file and line, which the caller adds.
    """
    allowed_keys = ("quantity", "at", "value", "claims", "within", "source")
    required_keys = ("quantity", "value", "claims", "source")
    section = _check_section(raw_section, keys, allowed_keys, required_keys)
    quantity = section["quantity"]
    claims = section["claims"]
    if quantity not in QUANTITIES:
        closest_name = closest_match(str(quantity), QUANTITIES)
        problem = (
            f"is not a column of a result, did you mean '{closest_name}'?"
            if closest_name
            else "is not a column of a result"
        )
        raise _config_error(
            (*keys, "quantity"), problem, f"force, a, p_max, {PULL_OFF}, E_hertz or another column"
        )
    valid_claims = ("exact", "fit", "elements")
    if claims not in valid_claims:
        raise _config_error(
            (*keys, "claims"),
            "must be exact, fit or elements",
            "say what kind of value the source gives",
        )
    claimed_error = (
        _read_number(section, "within", keys) if section.get("within") is not None else None
    )
    if claimed_error is not None and not 0 < claimed_error < 1:
        raise _config_error(
            (*keys, "within"), "must be between 0 and 1", "0.01 if the source claims 1 %"
        )
    if not _read_number(section, "value", keys):
        raise _config_error((*keys, "value"), "must not be 0", "differences are relative to it")
    source = _read_text(section, "source", keys)
    return PublishedValue(
        quantity,
        float(section["value"]),
        _read_row_key(section, keys),
        claims,
        claimed_error,
        source,
    )


def read_exact(raw_section: Any, keys: KeyPath) -> ExactValue:
    """Read and check the section `exact` of a case.

    ConfigErrors have no file and line, which the caller adds.
    """
    allowed_keys = ("value", "case", "by")
    section = _check_section(raw_section, keys, allowed_keys, ("by",))
    if ("value" in section) == ("case" in section):
        raise _config_error(
            keys,
            "must have either value or case",
            "give a number, or the name of a case of this study",
        )
    value = _read_number(section, "value", keys) if "value" in section else None
    if value == 0:
        raise _config_error((*keys, "value"), "must not be 0", "differences are relative to it")
    return ExactValue(
        _read_text(section, "by", keys),
        value,
        _read_text(section, "case", keys) if "case" in section else "",
    )


def _check_section(
    raw_section: Any, keys: KeyPath, valid_keys: tuple[str, ...], required_keys: tuple[str, ...]
) -> Mapping[str, Any]:
    if not isinstance(raw_section, dict):
        raise _config_error(
            keys, "must be a mapping of keys to values", f"its keys are {', '.join(valid_keys)}"
        )
    if unknown := [key for key in raw_section if key not in valid_keys]:
        raise _config_error(
            (*keys, unknown[0]), "unknown key", f"valid here: {', '.join(valid_keys)}"
        )
    if missing := [key for key in required_keys if key not in raw_section]:
        raise _config_error(
            (*keys, missing[0]), "missing", f"this section needs {', '.join(required_keys)}"
        )
    return raw_section


def _read_row_key(section: Mapping[str, Any], keys: KeyPath) -> tuple[str, float] | None:
    row_key = section.get("at")
    if row_key is None:
        return None
    # One of these columns identifies the row of a value.
    row_keys = ("delta", "t", "step")
    if not isinstance(row_key, dict) or len(row_key) != 1 or next(iter(row_key)) not in row_keys:
        raise _config_error(
            (*keys, "at"), "must name one row", "write {delta: 0.01}, {t: 1.5} or {step: 3}"
        )
    name = next(iter(row_key))
    return name, _read_number(row_key, name, (*keys, "at"))


def _read_number(section: Mapping[str, Any], key: str, keys: KeyPath) -> float:
    value = section[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise _config_error((*keys, key), "must be a number, in the units of the scene")
    return float(value)


def _read_text(section: Mapping[str, Any], key: str, keys: KeyPath) -> str:
    value = section[key]
    if not isinstance(value, str) or not value.strip():
        raise _config_error((*keys, key), "must be a text")
    return " ".join(value.split())


def _config_error(keys: KeyPath, problem: str, remedy: str = "") -> ConfigError:
    return ConfigError(key_text(keys), problem, remedy)
