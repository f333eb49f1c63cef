"""Strict JSON of numbers, dataclasses and arrays, indented so that people can read it."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Mapping
from json.encoder import encode_basestring
from types import NoneType
from typing import Any

import numpy as np

ENCODER = json.JSONEncoder(allow_nan=False, ensure_ascii=False)


def to_json(value: Any, indent: int | None = 2) -> str:
    """Return strict JSON; dataclasses, paths and numpy values become plain data.

    Parameters
    ----------
    value
        Any nesting of mappings, sequences, dataclasses, arrays, paths and numbers. A number that is
        not finite becomes null.
    indent
        Spaces per level; None for one line.
    """
    data = json_data(value)
    text = ENCODER.encode(data) if indent is None else _indented_json(data, "\n", " " * indent)
    # A file name that is not valid UTF-8 has lone surrogates, which UTF-8 cannot represent.
    return re.sub("[\ud800-\udfff]", lambda surrogate: f"\\u{ord(surrogate.group()):04x}", text)


def _indented_json(value: Any, line: str, step: str) -> str:
    """Return JSON with a line per entry of a mapping, and per item of a list of those.

    The standard library's encoder of indented text is slow, because it is written in Python.
    """
    kind = type(value)
    if kind is str:
        return encode_basestring(value)
    if kind is float or kind is int:
        return repr(value)
    inner = line + step
    if kind is dict and value:
        parts = [
            f"{encode_basestring(key)}: {_indented_json(part, inner, step)}"
            for key, part in value.items()
        ]
        return f"{{{inner}{f',{inner}'.join(parts)}{line}}}"
    if kind is list and any(type(part) in (dict, list) for part in value):
        items = f",{inner}".join(_indented_json(part, inner, step) for part in value)
        return f"[{inner}{items}{line}]"
    return ENCODER.encode(value)


def json_data(value: Any) -> Any:
    """Return the value as plain numbers, texts, lists and dictionaries; None if not finite."""
    kind = type(value)
    if kind in (str, int, bool, NoneType):
        return value
    if kind is float:
        return value if math.isfinite(value) else None
    if kind is tuple or kind is list:
        return [json_data(part) for part in value]
    match value:  # Subclasses and rarer types are tried last, because isinstance is slower.
        case Mapping():
            return {str(key): json_data(part) for key, part in value.items()}
        case str() | int():
            return value
        case np.generic() | np.ndarray():
            return json_data(value.tolist())
        case float():
            return json_data(float(value))
        case list() | tuple() | set() | frozenset():
            return [json_data(part) for part in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            part.name: json_data(getattr(value, part.name)) for part in dataclasses.fields(value)
        }
    return str(value)
