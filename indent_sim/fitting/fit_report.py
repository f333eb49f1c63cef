"""HTML report of a fit: sentences, numbers, pictures and tables of its curves."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import dump
from indent_sim.fitting import fit_picture, map_picture
from indent_sim.fitting.curve_fit import INTERVAL_KEYS, CurveFit, format_value
from indent_sim.fitting.fit_folder import FIT_TABLE
from indent_sim.fitting.fit_table import read_curve_table
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.map_folder import read_map
from indent_sim.process.errors import IndentSimError, UsageError, printable
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.html_report import Picture, Table, render_page, thinned_table, value_text
from indent_sim.results.pictures import figures
from indent_sim.results.result_files import CURVES_FOLDER, FIT, PROGRAM, read_report

Entry = Mapping[str, Any]


def fit_page(folder: Path) -> str:
    """Return the HTML page of a fit's folder; raise UsageError if it has no readable fit."""
    record = read_report(folder, FIT)
    if "curves" not in record and record.get("status") in ("running", "interrupted"):
        raise UsageError(
            f"the fit of the map in {folder} is not finished",
            "give the same fit command again; it continues after the last finished block",
        )
    try:
        entries = record["curves"]
        keys = record["vary"]
        document = record["request"]["scene"]
        config = config_from_mapping(document)
        done_entries = [entry for entry in entries if entry["status"] == "done"]
        parts = _page_parts(folder, config, entries, done_entries, keys)
        if "map" in record:
            parts |= _map_parts(folder, config, record, parts)
    except (KeyError, TypeError, ValueError, AttributeError, IndentSimError) as error:
        raise UsageError(
            f"{folder} contains no readable fit: {type(error).__name__} {error}"
        ) from None
    curves_text = f"{len(entries)} curves"
    if "map" in record:
        curves_text = f"a map of {record['map']['curves']} curves"
    if len(entries) == 1 and done_entries:
        curves_text = done_entries[0]["curve"]
    title = f"{record['scene']} fitted to {curves_text}"
    count_text = f"{len(done_entries)} of {len(entries)} curves fitted" if len(entries) > 1 else ""
    subtitle_parts = [
        f"varied: {', '.join(keys)}",
        count_text,
        f"{PROGRAM} {record.get('version', VERSION)}",
    ]
    subtitle = "  ·  ".join(filter(None, subtitle_parts))
    failure = "" if done_entries else "no curve was fitted"
    return render_page(
        title=title, subtitle=subtitle, failure=failure, scene=dump(document), **parts
    )


def _page_parts(
    folder: Path,
    config: Config,
    entries: Sequence[Entry],
    done_entries: Sequence[Entry],
    keys: Sequence[str],
) -> dict[str, Any]:
    """Return the content of the page: numbers, sentences, pictures, tables, warnings."""
    only_entry = done_entries[0] if len(entries) == 1 and done_entries else None
    # Further curves are only in the table.
    max_pictures = 12
    sentences = (
        [f"{entry['curve']}: {entry['words']}" for entry in done_entries[:max_pictures]]
        if not only_entry
        else [only_entry["words"]]
    )
    sentences += [
        f"{entry['curve']}: refused, {entry['reason']}"
        for entry in entries
        if entry["status"] != "done"
    ]
    pictures = [
        *_overview(entries, keys, config),
        *_pictures(folder, done_entries[:max_pictures], config),
    ]
    tables = [*(_single_curve_tables(only_entry) if only_entry else []), _fit_table(folder)]
    warnings = list(dict.fromkeys(line for entry in done_entries for line in entry["warnings"]))
    numbers = _parameter_numbers(only_entry, keys, config) if only_entry else []
    return {
        "numbers": numbers,
        "said": sentences,
        "pictures": pictures,
        "tables": tables,
        "warnings": warnings,
    }


def _map_parts(
    folder: Path, config: Config, record: Entry, parts: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the content of the page of a map, with the pictures of its sampled curves."""
    map_fit = read_map(folder)
    picture = Picture(
        figures.svg_element(partial(map_picture.draw_map, map_fit, config)),
        "The map; the fits of grey pixels were rejected",
        broad=True,
    )
    return {
        "said": [map_fit.words],
        "pictures": [picture, *parts["pictures"][1:]],
        "warnings": record["warnings"],
    }


def _parameter_numbers(entry: Entry, keys: Sequence[str], config: Config) -> list[tuple[str, str]]:
    """Return the parameters of a single curve as text, with their intervals."""
    numbers = []
    for key in keys:
        interval = entry["parameters"][key]
        value, low, high = (
            format_value(key, config, interval[end], Interval(*map(interval.get, INTERVAL_KEYS)))
            for end in INTERVAL_KEYS
        )
        numbers.append((key, f"{value} ({low} to {high})"))
    return numbers


def _overview(entries: Sequence[Entry], keys: Sequence[str], config: Config) -> Iterator[Picture]:
    if len(entries) > 1 and keys and any(entry["status"] == "done" for entry in entries):
        draw = partial(fit_picture.draw_parameter_intervals, entries, keys, config)
        yield Picture(
            figures.svg_element(draw),
            "The first key of every curve with its 95 % interval",
            broad=True,
        )


def _pictures(folder: Path, done_entries: Sequence[Entry], config: Config) -> Iterator[Picture]:
    """Yield a picture of every curve whose table exists."""
    for entry in done_entries:
        try:
            curve = read_curve_table(
                read_regular_file(folder / CURVES_FOLDER / f"{entry['curve']}.csv").decode("utf-8")
            )
        except (OSError, ValueError):
            continue
        draw: Callable[[Path], None] = partial(
            fit_picture.draw_curve, CurveFit(dict(entry), curve), config
        )
        caption = (
            f"{printable(entry['curve'])}: the curve and the scene, the residuals, and the "
            "fits to a part of the depth"
        )
        yield Picture(figures.svg_element(draw), caption, broad=True)


def _single_curve_tables(entry: Entry) -> Iterator[Table]:
    """Yield the tables of a single curve: depth ranges, alternative models, residuals."""
    windows = entry["window"]
    yield thinned_table(
        "Fits to a part of the depth",
        list(windows[0]),
        [list(result.values()) for result in windows],
    )
    rows = [[result["name"], result["p"], *_model_cells(result)] for result in entry["models"]]
    if rows:
        models_note = (
            "Each model is fitted in place of the scene; p is the probability that it fits "
            "better by this much merely by chance."
        )
        yield Table(
            "Other models",
            ["model", "p", "value", "95 %", "with"],
            [list(map(value_text, row)) for row in rows],
            models_note,
        )
    residual_rows = [
        [name.replace("_", " "), value_text(value)] for name, value in entry["residual"].items()
    ]
    residual_note = (
        "p is the probability that such residuals occur by chance; the correlation length "
        "is in samples."
    )
    yield Table("Residuals of the fit", ["quantity", "value"], residual_rows, residual_note)


def _model_cells(model: Entry) -> list[str]:
    """Return table cells of an alternative model: first varied key, and added parameters."""
    added_values = ", ".join(
        f"{key} = {value_text(value)}" for key, value in model["parameters"].items()
    )
    if "value" not in model:
        return ["", "", added_values]
    return [
        value_text(model["value"]),
        f"{value_text(model['low'])} to {value_text(model['high'])}",
        added_values,
    ]


def _fit_table(folder: Path) -> Table:
    try:
        head, *rows = csv.reader(io.StringIO(read_regular_file(folder / FIT_TABLE).decode("utf-8")))
    except (OSError, ValueError):
        head = []
        rows = []
    return thinned_table(f"Rows of {FIT_TABLE}", head, rows)
