"""Sources of error one at a time: how large each gets, and what it costs to reduce it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from markdown import number, size, table

from indent_sim.config.strict_yaml import short_yaml

# Error below which the cheapest run is searched.
TARGET = 0.001
WORST = "force_error_worst"
LAST = "force_error_vs"

Row = dict[str, Any]


@dataclass(frozen=True)
class Source:
    """Source of error.

    Attributes
    ----------
    name
        Name of the source.
    study
        Name of the study that varies it.
    mine
        Whether a row of the study varies this source only.
    error
        Column of the error.
    keys
        Keys that differ between the rows.
    """

    name: str
    study: str
    mine: Callable[[Row], bool]
    error: str
    keys: tuple[str, ...]


def varies_mesh_only(row: Row) -> bool:
    """Return whether nothing but the element sizes is varied."""
    return not any(row[key] for key in ("contact.method", "loading.steps"))


SOURCES = (
    Source(
        "element size at the contact",
        "mesh",
        lambda row: varies_mesh_only(row) and row["mesh.h_far"] == 0.05,
        WORST,
        ("mesh.h_contact",),
    ),
    Source(
        "element size far from the contact",
        "mesh",
        lambda row: varies_mesh_only(row) and row["mesh.h_contact"] == 0.0025,
        WORST,
        ("mesh.h_far",),
    ),
    Source(
        "stiffness of the penalty",
        "mesh",
        lambda row: row["contact.method"] == "penalty",
        WORST,
        ("stiffness",),
    ),
    Source(
        "load steps, linear",
        "mesh",
        lambda row: bool(row["loading.steps"]),
        LAST,
        ("loading.steps",),
    ),
    Source(
        "truncated half-space",
        "truncation",
        lambda row: True,
        LAST,
        ("body.radius", "body.height"),
    ),
    Source(
        "small instead of finite strain",
        "model",
        lambda row: row["indenter"]["shape"] == "sphere",
        LAST,
        ("material",),
    ),
    Source(
        "paraboloid instead of sphere",
        "model",
        lambda row: row["material"]["model"] != "linear_elastic" and not row["loading.steps"],
        LAST,
        ("indenter",),
    ),
    Source(
        "load steps, finite strain",
        "model",
        lambda row: bool(row["loading.steps"]),
        LAST,
        ("loading.steps",),
    ),
)


def sources_table(rows: dict[str, Sequence[Row]]) -> str:
    """Return the table of all sources; `rows` are those of the studies by name."""
    head = [
        "source",
        "setting with the largest error",
        "error",
        "cheapest setting below 0.1 %",
        "error",
        "CPU s",
    ]
    return table(head, [line(source, rows[source.study]) for source in SOURCES])


def line(source: Source, rows: Sequence[Row]) -> list[str]:
    """Return the line of a source: the run with the largest error, and the cheapest good one.

    If no error is below the target, the run with the smallest error takes its place.
    """

    def error(row: Row) -> float:
        return abs(row[source.error])

    finished = [row for row in rows if row["status"] == "done" and source.mine(row)]
    largest = max(finished, key=error)
    good = [row for row in finished if error(row) < TARGET]
    if good:
        best = min(good, key=lambda row: row["cpu_s"])
        settings = keys_text(best, source.keys)
    else:
        best = min(finished, key=error)
        settings = f"not reached; {keys_text(best, source.keys)}"
    return [
        source.name,
        keys_text(largest, source.keys),
        size(largest[source.error]),
        settings,
        size(best[source.error]),
        number(best["cpu_s"], 2),
    ]


def keys_text(row: Row, keys: Sequence[str]) -> str:
    """Return keys of a row with their values as text."""
    return ", ".join(key_text(key, row[key]) for key in keys)


def key_text(key: str, value: Any) -> str:
    """Return a key and its value as text; a section as the name of its type."""
    if isinstance(value, dict):
        return str(value.get("model") or value.get("shape"))
    if key == "stiffness":
        return f"epsilon_n {number(value, 2)} E*/h"
    return f"{key.split('.')[-1]} {short_yaml(value)}"
