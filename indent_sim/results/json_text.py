"""Conversion of numbers, dataclasses and arrays to strict JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np


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
    text = json.dumps(json_data(value), indent=indent, allow_nan=False, ensure_ascii=False)
    # A file name that is not valid UTF-8 has lone surrogates, which UTF-8 cannot represent.
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def json_data(value: Any) -> Any:
    """Return a value as data for JSON; numbers that are not finite become None."""
    text = json.dumps(value, default=_plain_data)
    return json.loads(text, parse_constant=lambda name: None)


def _plain_data(value: Any) -> Any:
    """Return an object of an unknown type as a type that the module json supports."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, set | frozenset):
        return list(value)
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return str(value)
