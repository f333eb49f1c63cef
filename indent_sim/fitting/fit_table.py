"""Tables of a fit: fit.csv with a row per curve, and one table per curve with its fits."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import PlottedCurve, quantity_kind
from indent_sim.results.pictures.axes import unit_label

FIRST_COLUMNS = ("curve", "status", "reason", "explained", "cause")
LAST_COLUMNS = (
    "contact_point",
    "contact_point_low",
    "contact_point_high",
    "force_max",
    "depth",
    "rms_percent",
    "n",
    "n_effective",
    "drift_percent",
    "hertz_E",
)
# Kinds of the columns of fit.csv and map.csv that are not those of a key, for `unit_label`.
COLUMN_KINDS = {
    "contact_point": "length",
    "contact_point_low": "length",
    "contact_point_high": "length",
    "height": "length",
    "thickness": "length",
    "depth": "length",
    "force_max": "force",
    "baseline": "force",
    "slope": "line",
    "hertz_E": "pressure",
}
PERCENT_COLUMNS = ("rms_percent", "drift_percent")
PLOTTED_COLUMNS = ("delta", "force", "fit", "residual")
MODEL_PREFIX = "fit_"
Entry = Mapping[str, Any]


def table_of_fits(entries: Sequence[Entry], keys: Sequence[str]) -> str:
    """Return fit.csv: status, reason, cause, varied keys with intervals, and residuals.

    drift_percent is the relative difference between two values of the first key, fitted to half the
    depth and to the whole depth. Cells without a value are empty.
    """
    text = io.StringIO()
    table = csv.DictWriter(text, fit_columns(keys), lineterminator="\n", restval="")
    table.writeheader()
    for entry in entries:
        table.writerow(_fit_row(entry, keys))
    return text.getvalue()


def column_units(columns: Iterable[str], keys: Sequence[str], config: Config) -> dict[str, str]:
    """Return the units of the columns of fit.csv or map.csv, without dimensionless columns.

    Parameters
    ----------
    columns
        Names of the columns.
    keys
        Varied keys of the scene.
    config
        The scene.
    """
    scene_units = {"length": config.units.length, "force": config.units.force}
    kinds: dict[str, str] = dict(COLUMN_KINDS)
    for key in keys:
        kinds |= {f"{key}{end}": quantity_kind(config, key) or "" for end in ("", "_low", "_high")}
    if keys:
        kinds |= {f"statistical_{end}": kinds[keys[0]] for end in ("low", "high")}
    units = {name: unit_label(kinds[name], scene_units) for name in columns if kinds.get(name)}
    units |= {name: "%" for name in PERCENT_COLUMNS if name in columns}
    return {name: unit for name, unit in units.items() if unit}


def fit_columns(keys: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of fit.csv."""
    key_columns = (f"{key}{end}" for key in keys for end in ("", "_low", "_high"))
    return (*FIRST_COLUMNS, *key_columns, *LAST_COLUMNS)


def _fit_row(entry: Entry, keys: Sequence[str]) -> dict[str, Any]:
    row: dict[str, Any] = {name: entry.get(name, "") for name in ("curve", "status", "reason")}
    if entry["status"] != "done":
        return row
    row |= {"explained": str(entry["explained"]).lower(), "cause": " ".join(entry["cause"])}
    for key in keys:
        interval = entry["parameters"][key]
        row |= {
            key: interval["value"],
            f"{key}_low": interval["low"],
            f"{key}_high": interval["high"],
        }
    contact_point = entry["contact_point"]
    residual = entry["residual"]
    row |= {
        "contact_point": contact_point["value"],
        "contact_point_low": contact_point["low"],
        "contact_point_high": contact_point["high"],
    }
    row |= {
        "force_max": entry["force_max"],
        "depth": entry["depth"],
        "rms_percent": residual["percent"],
    }
    row |= {
        "n": residual["n"],
        "n_effective": residual["n_effective"],
        "drift_percent": modulus_drift(entry, keys),
    }
    return row | {"hertz_E": (entry["hertz"] or {}).get("E", "")}


def modulus_drift(entry: Entry, keys: Sequence[str]) -> float | str:
    """Return the change of the first key [%] if only half the depth is fitted; "" if unknown."""
    windows = entry["window"]
    if not keys or windows[0]["upper"] != 0.5 or not windows[-1][keys[0]]:
        return ""
    return float(100 * (windows[0][keys[0]] / windows[-1][keys[0]] - 1))


def table_of_curve(curve: PlottedCurve) -> str:
    """Return curves/NAME.csv: depth, force without baseline, fit and residual.

    Further columns are `fit_MODEL` for each better alternative model, and the time `t` from first
    contact if the force depends on time.
    """
    columns = [
        curve.delta,
        curve.force,
        curve.fit,
        curve.force - curve.fit,
        *curve.alternative_fits.values(),
    ]
    columns += [curve.t] if curve.t is not None else []
    lines = (
        ",".join(f"{float(value):.10g}" for value in row) for row in zip(*columns, strict=True)
    )
    titles = [
        *PLOTTED_COLUMNS,
        *(f"{MODEL_PREFIX}{name}" for name in curve.alternative_fits),
        *(["t"] if curve.t is not None else []),
    ]
    return "\n".join([",".join(titles), *lines, ""])


def read_curve_table(text: str) -> PlottedCurve:
    """Return the curve that `table_of_curve` has written; raise ValueError for other text."""
    head, *rows = csv.reader(io.StringIO(text))
    if tuple(head[: len(PLOTTED_COLUMNS)]) != PLOTTED_COLUMNS or not rows:
        raise ValueError("not the table of a fitted curve")
    columns = dict(zip(head, np.array(rows, dtype=float).T, strict=True))
    alternative_fits = {
        name.removeprefix(MODEL_PREFIX): column
        for name, column in columns.items()
        if name.startswith(MODEL_PREFIX)
    }
    return PlottedCurve(
        columns["delta"], columns["force"], columns["fit"], alternative_fits, columns.get("t")
    )
