"""One source of error at a time: how large it gets, and what it costs to bring it under the target."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from markdown import number, size, table

from indent_sim.config.strict_yaml import short_yaml

TARGET = 0.001
WORST, LAST = "force_error_worst", "force_error_vs"

Row = dict[str, Any]


@dataclass(frozen=True)
class Source:
    """The rows of a study in which one error varies, which error that is, and the keys that tell the rows apart."""

    name: str
    study: str
    mine: Callable[[Row], bool]
    error: str
    keys: tuple[str, ...]


SOURCES = (
    Source(
        "near mesh",
        "mesh",
        lambda row: plain(row) and row["mesh.h_far"] == 0.05,
        WORST,
        ("mesh.h_contact",),
    ),
    Source(
        "far mesh",
        "mesh",
        lambda row: plain(row) and row["mesh.h_contact"] == 0.0025,
        WORST,
        ("mesh.h_far",),
    ),
    Source(
        "enforcement: penalty",
        "mesh",
        lambda row: row["contact.method"] == "penalty",
        WORST,
        ("stiffness",),
    ),
    Source(
        "load step, linear",
        "mesh",
        lambda row: bool(row["loading.steps"]),
        LAST,
        ("loading.steps",),
    ),
    Source(
        "truncated half-space", "truncation", lambda row: True, LAST, ("body.radius", "body.height")
    ),
    Source(
        "small for finite strain",
        "model",
        lambda row: row["indenter"]["shape"] == "sphere",
        LAST,
        ("material",),
    ),
    Source(
        "paraboloid for sphere",
        "model",
        lambda row: row["material"]["model"] != "linear_elastic" and not row["loading.steps"],
        LAST,
        ("indenter",),
    ),
    Source(
        "load step, finite strain",
        "model",
        lambda row: bool(row["loading.steps"]),
        LAST,
        ("loading.steps",),
    ),
)


def plain(row: Row) -> bool:
    """Whether nothing but the mesh sizes is varied."""
    return not any(row[key] for key in ("contact.method", "loading.steps"))


def sources(rows: dict[str, Sequence[Row]]) -> str:
    """A line for each source; `rows` are those of the studies by their names."""
    names = ["source", "at its largest", "error", "under 0.1 % with", "error", "CPU s"]
    return table(names, [line(source, rows[source.study]) for source in SOURCES])


def line(source: Source, rows: Sequence[Row]) -> list[str]:
    """The largest error, and the cheapest run under the target; where none is, the best."""
    found = [row for row in rows if row["status"] == "done" and source.mine(row)]
    largest = max(found, key=lambda row: abs(row[source.error]))
    good = [row for row in found if abs(row[source.error]) < TARGET]
    best = (
        min(good, key=lambda row: row["cpu_s"])
        if good
        else min(found, key=lambda row: abs(row[source.error]))
    )
    told = label(best, source.keys) if good else f"not reached; {label(best, source.keys)}"
    errors = [size(row[source.error]) for row in (largest, best)]
    return [
        source.name,
        label(largest, source.keys),
        errors[0],
        told,
        errors[1],
        number(best["cpu_s"], 2),
    ]


def label(row: Row, keys: Sequence[str]) -> str:
    """The keys that matter of a row, in words."""
    return ", ".join(spoken(key, row[key]) for key in keys)


def spoken(key: str, value: Any) -> str:
    """A key and its value; a section by its kind."""
    if isinstance(value, dict):
        return str(value.get("model") or value.get("shape"))
    return (
        f"epsilon_n {number(value, 2)} E*/h"
        if key == "stiffness"
        else f"{key.split('.')[-1]} {short_yaml(value)}"
    )
