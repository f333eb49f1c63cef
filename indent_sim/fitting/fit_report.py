"""Report of a fit: what every curve says of the scene, its pictures and tables, as the page of a
result.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import from_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import dump
from indent_sim.fitting import fit_picture
from indent_sim.fitting.curve_fit import ENDS, CurveFit, said
from indent_sim.fitting.fit_folder import CURVES_FOLDER, FIT_TABLE
from indent_sim.fitting.fit_table import curve_of_table
from indent_sim.fitting.inference.verdict import Interval
from indent_sim.process.errors import IndentSimError, UsageError, printable
from indent_sim.process.version import VERSION
from indent_sim.results.folder import FIT, PROGRAM, read_regular_file, read_report
from indent_sim.results.html_report import Picture, Table, render_page, thinned_table, value_text
from indent_sim.results.pictures import figures

MOST_PICTURES = 12  # of curves; more are told of in the table
Entry = Mapping[str, Any]
OF_RESIDUAL = "p: the probability of that by accident; a correlation is in samples."
OF_MODELS = (
    "Each is fitted in place of the scene; p: the probability that it is as much "
    "better by accident."
)


def of_fit(folder: Path) -> str:
    """The page of a fit's folder; UsageError when it holds none that can be read."""
    record = read_report(folder, FIT)
    try:
        entries = record["curves"]
        keys = record["vary"]
        document = record["request"]["scene"]
        config = from_mapping(document)
        done = [entry for entry in entries if entry["status"] == "done"]
        parts = _parts(folder, config, entries, done, keys)
    except (KeyError, TypeError, ValueError, AttributeError, IndentSimError) as error:
        raise UsageError(
            f"{folder} holds no fit that can be read: {type(error).__name__} {error}"
        ) from None
    title = (
        f"{record['scene']} fitted to "
        f"{done[0]['curve'] if len(entries) == 1 and done else f'{len(entries)} curves'}"
    )
    counted = f"{len(done)} of {len(entries)} curves fitted" if len(entries) > 1 else ""
    words = [f"varied: {', '.join(keys)}", counted, f"{PROGRAM} {record.get('version', VERSION)}"]
    subtitle = "  ·  ".join(filter(None, words))
    failure = "" if done else "no curve was fitted"
    return render_page(
        title=title, subtitle=subtitle, failure=failure, scene=dump(document), **parts
    )


def _parts(
    folder: Path,
    config: Config,
    entries: Sequence[Entry],
    done: Sequence[Entry],
    keys: Sequence[str],
) -> dict[str, Any]:
    """What stands in the page: numbers, words, pictures, tables, warnings."""
    alone = done[0] if len(entries) == 1 and done else None
    told = (
        [f"{entry['curve']}: {entry['words']}" for entry in done[:MOST_PICTURES]]
        if not alone
        else [alone["words"]]
    )
    told += [
        f"{entry['curve']}: refused, {entry['reason']}"
        for entry in entries
        if entry["status"] != "done"
    ]
    pictures = [*_overview(entries, keys, config), *_pictures(folder, done[:MOST_PICTURES], config)]
    tables = [*(_of_one(alone) if alone else []), _rows(folder)]
    warned = list(dict.fromkeys(line for entry in done for line in entry["warnings"]))
    numbers = _numbers(alone, keys, config) if alone else []
    return {
        "numbers": numbers,
        "said": told,
        "pictures": pictures,
        "tables": tables,
        "warnings": warned,
    }


def _numbers(entry: Entry, keys: Sequence[str], config: Config) -> list[tuple[str, str]]:
    """The parameters of the only curve, with their intervals."""
    found = []
    for key in keys:
        stated = entry["parameters"][key]
        value, low, high = (
            said(key, config, stated[end], Interval(*map(stated.get, ENDS))) for end in ENDS
        )
        found.append((key, f"{value} ({low} to {high})"))
    return found


def _overview(entries: Sequence[Entry], keys: Sequence[str], config: Config) -> Iterator[Picture]:
    if len(entries) > 1 and keys and any(entry["status"] == "done" for entry in entries):
        draw = partial(fit_picture.draw_many, entries, keys, config)
        yield Picture(
            figures.svg_element(draw),
            "The first key of every curve with its 95 % interval",
            broad=True,
        )


def _pictures(folder: Path, done: Sequence[Entry], config: Config) -> Iterator[Picture]:
    """A picture of every curve whose table is there."""
    for entry in done:
        try:
            drawn = curve_of_table(
                read_regular_file(folder / CURVES_FOLDER / f"{entry['curve']}.csv").decode("utf-8")
            )
        except (OSError, ValueError):
            continue
        draw: Callable[[Path], None] = partial(
            fit_picture.draw_curve, CurveFit(dict(entry), drawn), config
        )
        words = (
            f"{printable(entry['curve'])}: the curve and the scene, what is left, and the "
            "fits to a part of the depth"
        )
        yield Picture(figures.svg_element(draw), words, broad=True)


def _of_one(entry: Entry) -> Iterator[Table]:
    """Tables of the only curve: windows, other models, residuals."""
    windows = entry["window"]
    yield thinned_table(
        "Fits to a part of the depth", list(windows[0]), [list(one.values()) for one in windows]
    )
    rows = [[one["name"], one["p"], *_of_model(one)] for one in entry["models"]]
    if rows:
        yield Table(
            "Other models",
            ["model", "p", "value", "95 %", "with"],
            [list(map(value_text, row)) for row in rows],
            OF_MODELS,
        )
    left = [
        [name.replace("_", " "), value_text(value)] for name, value in entry["residual"].items()
    ]
    yield Table("What the fit leaves", ["what", "value"], left, OF_RESIDUAL)


def _of_model(one: Entry) -> list[str]:
    """The first varied key that a model gives, and what it adds."""
    beside = ", ".join(f"{key} = {value_text(value)}" for key, value in one["parameters"].items())
    if "value" not in one:
        return ["", "", beside]
    return [
        value_text(one["value"]),
        f"{value_text(one['low'])} to {value_text(one['high'])}",
        beside,
    ]


def _rows(folder: Path) -> Table:
    try:
        head, *rows = csv.reader(io.StringIO(read_regular_file(folder / FIT_TABLE).decode("utf-8")))
    except (OSError, ValueError):
        head = []
        rows = []
    return thinned_table(f"Rows of {FIT_TABLE}", head, rows)
