"""Report of a result: one HTML file that needs nothing beside it, neither network nor other files."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.process.errors import UsageError
from indent_sim.process.limits import unwritable
from indent_sim.process.version import VERSION
from indent_sim.results.folder import (
    CONFIG,
    CRATE,
    CRATE_SIGN,
    FIT,
    PROGRAM,
    STUDY,
    Report,
    content,
    is_own_file,
    read_report,
    write_atomically,
)
from indent_sim.results.pictures import canvas, experiment, history, panels
from indent_sim.results.pictures.axes import axis, choice, in_print, scaled, time_said, unit_of
from indent_sim.results.pictures.history import is_of_body
from indent_sim.results.pictures.panels import Wish
from indent_sim.results.pictures.pressure import strongest_step
from indent_sim.results.reader import Results, read_curve, read_run
from indent_sim.results.tables import EXPERIMENT
from indent_sim.results.writer import to_json
from indent_sim.results.xdmf import kept_steps, read_fields

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")  # in a sentence
MOST_ROWS = 100  # of a table; more are thinned
OF_AUDIT = (
    "The contact force against the supports' reactions, relative, at its worst; from "
    "1e-8 on a row is refused."
)
CAPTIONS = {"force": "Force over depth", "pressure": "Pressure on the surface at the largest force"}
CAPTIONS |= {
    "profile": "Deformed surface and tip",
    "fields": "Von Mises stress in the deformed body",
}
CAPTIONS |= {
    "pore_pressure": "Pressure of the fluid in the pores, above the bath's",
    "film": "Von Mises stress",
}
CAPTIONS |= {"swelling": "Volume over that of the dry gel"}
EXPERIMENT_CAPTION = (
    "In time, or over the branches of an equilibrium curve: force, depth and the way of the base"
)
EXPERIMENT_CAPTION += "; over contact radius, or what follows in time"
HISTORY_CAPTION = "What changes over the time, and the force over a depth that does"
NAME = "report.html"
Entity = dict[str, Any]  # of a crate, as JSON-LD has it
CRATE_PROFILE = "https://w3id.org/ro/crate/1.1"
FORMATS = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".png": "image/png",
}
FORMATS |= {
    ".html": "text/html",
    ".xdmf": "application/xml",
    ".h5": "application/x-hdf5",
    ".msh": "model/mesh",
}
REPORT_FORMATS = (".html", ".htm")


@dataclass(frozen=True)
class Picture:
    """A picture as it stands in the page, and what it shows in words."""

    svg: str
    words: str
    broad: bool = False


@dataclass(frozen=True)
class Table:
    """A table of the page; figures: its columns are numbers."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: str = ""
    figures: bool = False


def write(text: str, path: Path) -> None:
    """Write a page into a file; UsageError when that cannot be, NotConverged on a full disk."""
    try:
        write_atomically(path, text)
    except OSError as error:
        raise unwritable(path, error) from error


def of_run(folder: Path) -> str:
    """The page of one result."""
    results = read_run(folder)
    report = results.report
    if not report:
        raise UsageError(f"{folder} holds no result of {PROGRAM}: there is no run.json")
    failed = report.get("status") not in ("done", "running")
    failure = (
        f"{report.get('status', 'unknown')}: {report.get('reason') or 'no reason given'}"
        if failed
        else ""
    )
    checked = [
        [name.replace("_", " "), short(value)] for name, value in _part(report, "audit").items()
    ]
    audit = Table("Audit", ["what", "value"], checked, OF_AUDIT)
    decided = report.get("plan", {}).get("choices", [])
    reasons = [
        [str(one.get("key", "")), short(one.get("value", "")), str(one.get("why", ""))]
        for one in decided
    ]
    choices = Table("Choices and their reasons", ["what", "choice", "why"], reasons)
    tables = [
        _rows(results),
        *_experiment(results),
        choices,
        *_bars(report),
        audit,
        _provenance(report),
    ]
    words = _part(report, "stick").get("words")
    held = [f"{words[:1].upper()}{words[1:]}."] if words else []
    said = [
        *_theory(results),
        *_hertz(results),
        *_tension(results),
        *held,
        *_largest_pull(results),
        *_pull_off(results),
    ]
    chosen = ", ".join(report.get("plan", {}).get("auto", [])) or "nothing"
    scene = ""
    with suppress(OSError, ValueError):
        scene = content(folder / CONFIG).decode("utf-8")
    beside = {"numbers": _numbers(results), "said": said, "scene": scene, "chosen": chosen}
    seen = {"pictures": _pictures(results), "warnings": report.get("warnings", [])}
    title = report.get("title") or folder.resolve().name
    shown = [table for table in tables if table.rows]
    parts = [choice(report, "kinematics"), report.get("method"), f"{report.get('rows', 0)} rows"]
    parts += [
        f"{PROGRAM} {report.get('version', '')}",
        report.get("finished", report.get("started", "")),
    ]
    subtitle = "  ·  ".join(str(part).replace("_", " ") for part in parts if part)
    return page(title=title, subtitle=subtitle, failure=failure, tables=shown, **seen, **beside)


def page(**parts: Any) -> str:
    """The page of its parts; whatever is text stays text.

    What only a run has may be missing, and a picture of nothing is left out.
    """
    from jinja2 import Environment, StrictUndefined

    parts = {"numbers": [], "said": [], "scene": "", "chosen": ""} | parts
    parts["pictures"] = [one for one in parts.get("pictures", ()) if one.svg]
    parts["warnings"] = gathered(parts.get("warnings", ()))
    source = (files("indent_sim.results") / "report.html").read_text(encoding="utf-8")
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True
    ).from_string(source)
    text = template.render(program=PROGRAM, version=VERSION, **parts)
    return (
        "".join(sign for sign in text if sign in "\n\t" or sign >= " ") + "\n"
    )  # no control characters


def gathered(warnings: Sequence[str]) -> list[str]:
    """Warnings that differ in nothing but their numbers as one line each, with the range of every
    number.
    """
    alike: dict[str, list[str]] = {}
    for line in dict.fromkeys(warnings):
        alike.setdefault(NUMBER.sub("#", line), []).append(line)
    return [lines[0] if len(lines) == 1 else _as_one(lines) for lines in alike.values()]


def _as_one(lines: Sequence[str]) -> str:
    """Lines that are alike as one."""
    numbers = [
        sorted(set(column), key=float) for column in zip(*map(NUMBER.findall, lines), strict=True)
    ]
    ranges = (
        column[0] if len(column) == 1 else f"{column[0]} to {column[-1]}" for column in numbers
    )
    return f"{NUMBER.sub(lambda _: next(ranges), lines[0])} ({len(lines)} such warnings)"


def _numbers(results: Results) -> list[tuple[str, str]]:
    """The deepest row in words, where time passes that of the largest force, or the last one
    without any.
    """
    if not len(results):
        return []
    deepest = int(np.nanargmax(results["delta"]))
    found = []
    unknown = np.full(len(results), np.nan)
    if "t" in results.table:
        force = np.nan_to_num(results["force"])
        deepest = int(np.argmax(force)) if force.any() else len(force) - 1
        found.append(("time t", time_said(results, float(results["t"][deepest]))))
    for name in ("delta", "force", "a"):
        along = axis(name, [results])
        error = results.table.get(f"{name}_error", unknown)[deepest]
        bar = f" ± {float(along(error)):.2g}" if np.isfinite(error) else ""
        found.append(
            (
                along.name,
                f"{float(along(results[name][deepest])):.4g}{bar} {in_print(along.unit)}".strip(),
            )
        )
    peak = results.table.get("p_max", unknown)[deepest]
    if np.isfinite(peak):
        found.append(("largest pressure", scaled("pressure", [results], peak, "p").said(peak)))
    return found


def _theory(results: Results) -> list[str]:
    """What theory and the usual formulas say beside the run."""
    theory = _part(results.report, "theory")
    time = _part(results.report, "time")
    if time:
        words = time.get("words") or ""
        by = f"In time by {time.get('method', 'its elastic curve')}: {time.get('why', '')}."
        return [by, *([f"{words[:1].upper()}{words[1:]}."] if words else [])]
    if not theory:
        return ["No theory is known for this scene."]
    asked = "delta" if "delta_deviation" in theory else "force"
    unit = _unit(results, {"delta": "length", "force": "force"}[asked])
    lines = []
    if f"{asked}_deviation" in theory and results.report.get("method") != "theory":
        exact = "exact for this body" if theory.get("exact") else theory.get("why", "")
        beside = f"this run {theory[f'{asked}_deviation']:+.2%}{f' ({exact})' if exact else ''}"
        lines.append(f"{theory['name']}: {asked} {theory[asked]:.5g} {unit}; {beside}.")
    for formula in filter(None, [theory.get("half_space"), *theory.get("formulas", [])]):
        beside = (
            f"{abs(formula['deviation']):.1%} "
            f"{'below' if formula['deviation'] < 0 else 'above'} this run"
        )
        lines.append(f"{formula['name']}: {asked} {formula[asked]:.5g} {unit}, {beside}.")
    return lines


def _hertz(results: Results) -> list[str]:
    """What a fit of the half-space formula to the curve reads."""
    fit = results.report.get("hertz")
    if not fit:
        return []
    modulus = scaled("pressure", [results], fit["E"], "E").said(fit["E"])
    return [
        f"A Hertz fit of this curve reads E = {modulus} ({fit['percent']:+.3g} "
        f"%{fit.get('against', '')})."
    ]


def _tension(results: Results) -> list[str]:
    """The length below which surface tension holds more of the force than the body does, beside the
    contact.
    """
    expected = _part(results.report, "plan", "prediction")
    length = expected.get("elastocapillary_length")
    a = expected.get("a")
    if not length:
        return []
    beside = f", {length / a:.2g} of the contact radius to expect" if a else ""
    return [
        f"Elastocapillary length gamma/E*: {length:.4g} {_unit(results, 'length')}".rstrip()
        + f"{beside}."
    ]


def _largest_pull(results: Results) -> list[str]:
    """The pull-off of a tip that adheres with a range, or the largest pull of its rows; what is
    known beforehand.
    """
    known = _part(results.report, "adhesion")
    pulled = known.get("largest_pull")
    if not pulled:
        return []
    labels = {"1": ""} | {kind: f" {_unit(results, kind)}".rstrip() for kind in ("force", "length")}
    symbols = [symbol for symbol in ADHESION_SYMBOLS if known.get(symbol.name) is not None]
    numbers = [
        f"{symbol.meaning} {known[symbol.name]:.4g}{labels[symbol.dimension]}" for symbol in symbols
    ]
    beforehand = f"Beforehand: {', '.join(numbers)}."
    searched = known.get("pull_off")
    found = searched or pulled
    place = f"force {found['force']:.5g}{labels['force']}"
    place += f" at delta {found['delta']:.5g}{labels['length']}"
    if not searched:
        return [f"Largest pull: {place}.", beforehand]
    bar = "with an unknown error"
    if (error := searched.get("error")) is not None:
        bar = f"within {error:.2g}{labels['force']} on this mesh"
    return [f"Pull-off: {place}, searched between rows, {bar}.", beforehand]


def _pull_off(results: Results) -> list[str]:
    """Where a tip that adheres comes off."""
    force = _unit(results, "force")
    length = _unit(results, "length")
    told = []
    for how, found in _part(results.report, "experiment", "adhesion", "pull_off").items():
        place = f"force {found['force']:.5g} {force} at delta {found['delta']:.5g} {length}"
        told.append(f"Pull-off under {how.replace('_', ' ')}: {place}.")
    return told


def _part(report: Report, *names: str) -> Report:
    """A mapping in run.json, by the names of those that it is in; empty where there is none."""
    for name in names:
        report = report.get(name) or {}
    return report


def _unit(results: Results, kind: str) -> str:
    return in_print(unit_of(kind, _part(results.report, "units")))


def _experiment(results: Results) -> list[Table]:
    if not (results.path / EXPERIMENT).exists():
        return []
    columns = read_curve(results.path)
    return [
        table_of(f"Rows of {EXPERIMENT}", list(columns), list(zip(*columns.values(), strict=True)))
    ]


def table_of(
    title: str, head: Sequence[str], rows: Sequence[Sequence[object]], words: str = ""
) -> Table:
    """A table of numbers with at most MOST_ROWS of its rows, the first and the last among them."""
    places = np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(int)
    kept = f"{len(places)} of {len(rows)} rows. " if len(places) < len(rows) else ""
    return Table(
        title, head, [[short(cell) for cell in rows[i]] for i in places], kept + words, True
    )


def _pictures(results: Results) -> list[Picture]:
    kept = kept_steps(results.path, results["step"])
    in_time = is_of_body(results.report) and len(results) > 0
    found = [_history(results)] if in_time else []
    there = ["force"] if len(results) and not in_time else []
    there += ["pressure", "profile"] if strongest_step(results) is not None else []
    there += ["fields"] if kept else []
    for what in there:
        drawing = partial(
            panels.draw, [results], Wish((what,), width=110.0)
        )  # mm: readable on a small screen
        found.append(Picture(canvas.element(drawing), CAPTIONS[what]))
    if in_time and len(kept) == len(results):
        found += [_film(results, name) for name in _evolving(results, kept[-1])]
    if experiment.is_there(results.path, results.report):
        found.append(
            Picture(
                canvas.element(partial(experiment.draw, results.path)),
                EXPERIMENT_CAPTION,
                broad=True,
            )
        )
    return found


def _history(results: Results) -> Picture:
    is_broad = len(history.shown(results)) > 1
    return Picture(canvas.element(partial(history.draw, results)), HISTORY_CAPTION, is_broad)


def _evolving(results: Results, step: int) -> list[str]:
    """The fields that tell most of a body in time: of its fluid and its swelling, else the stress."""
    there = read_fields(results.path, step)
    return [name for name in ("pore_pressure", "swelling") if name in there] or ["von_mises"]


def _film(results: Results, name: str) -> Picture:
    drawing = partial(panels.draw, [results], Wish(("film",), (name,), width=240.0))  # mm
    words = f"{CAPTIONS.get(name, CAPTIONS['film'])}, at times of the history"
    return Picture(canvas.element(drawing), words, broad=True)


def _rows(results: Results) -> Table:
    columns = {name: column for name, column in results.table.items() if name != "wall_s"}
    rows = list(zip(*columns.values(), strict=True))
    kinds = [_unit(results, kind) for kind in ("length", "force", "pressure")]
    units = (
        f"Lengths in {kinds[0]}, forces in {kinds[1]}, pressures in {kinds[2]}."
        if all(kinds)
        else ""
    )
    return table_of("Rows of force_indentation.csv", list(columns), rows, units)


def _bars(report: Report) -> list[Table]:
    budget = report.get("error_budget")
    rows = [one for one in budget if isinstance(one, Mapping)] if isinstance(budget, list) else []
    if not rows:
        return []
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[row.get(name, "") for name in names] for row in rows]
    return [table_of("Where the error bars come from", names, cells)]


def _provenance(report: Report) -> Table:
    """Which program, libraries and mesh made this, and what it took."""
    facts: Report = {"program": f"{PROGRAM} {report.get('version', '')}"}
    facts |= {name: report.get(name) for name in ("started", "finished", "ranks")} | {
        "unknowns": report.get("dofs")
    }
    facts |= {f"mesh {name}": value for name, value in _part(report, "mesh").items()} | _part(
        report, "versions"
    )
    facts |= {
        "PETSC_OPTIONS": report.get("PETSC_OPTIONS"),
        "seconds": sum(_part(report, "timings").values()) or None,
    }
    facts |= {"peak memory [MB]": report.get("peak_memory_MB")}
    rows = [[name, short(value)] for name, value in facts.items() if value is not None]
    return Table("Provenance", ["what", "value"], rows)


def short(value: Any) -> str:
    """A value as it is read, not to its last digit; nothing for what there is none of."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value) if value is not None else ""
    return "" if number != number or isinstance(value, bool) else f"{number:.6g}"


def refuse_foreign_crate(folder: Path) -> None:
    """UsageError where a crate would replace the metadata of somebody else."""
    if os.path.lexists(folder / CRATE) and not is_own_file(folder / CRATE):
        raise UsageError(f"{folder / CRATE} is there already and not of indent-sim", "move it away")


def write_crate(folder: Path, parts: Sequence[str]) -> None:
    """Write what an archive of research data reads of a result, a study or a fit: RO-Crate 1.1
    metadata as JSON-LD.

    parts: names of the files and folders in it that are the program's own; those that are there are
    listed. UsageError where a file with its name is somebody else's.
    """
    refuse_foreign_crate(folder)
    said = read_report(folder) or read_report(folder, STUDY) or read_report(folder, FIT)
    there = [name for name in sorted(parts) if (folder / name).exists() and name != CRATE]
    listed = [_in_crate(folder / name) for name in there]
    program = {
        "@id": "#program",
        "@type": "SoftwareApplication",
        "name": PROGRAM,
        "version": said.get("version", VERSION),
    }
    done: Entity = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": "simulation",
        "instrument": {"@id": "#program"},
    }
    done |= {"result": [{"@id": part["@id"]} for part in listed if part["@id"] != CONFIG]}
    done |= {"object": [{"@id": CONFIG}]} if CONFIG in there else {}
    times = {"startTime": said.get("started"), "endTime": said.get("finished")}
    done |= {name: value for name, value in times.items() if value}
    root: Entity = {
        "@id": "./",
        "@type": "Dataset",
        "name": str(said.get("title") or folder.resolve().name),
    }
    root |= {
        "description": f"Simulated indentation by {PROGRAM}",
        "hasPart": [{"@id": part["@id"]} for part in listed],
    }
    root |= {"datePublished": said["finished"]} if said.get("finished") else {}
    about: Entity = {
        "@id": CRATE,
        "@type": "CreativeWork",
        "name": CRATE_SIGN,
        "about": {"@id": "./"},
        "conformsTo": {"@id": CRATE_PROFILE},
    }
    graph = [about, root | {"mentions": {"@id": "#run"}}, *listed, done, program]
    try:
        write_atomically(
            folder / CRATE,
            to_json({"@context": f"{CRATE_PROFILE}/context", "@graph": graph}) + "\n",
        )
    except OSError as error:
        raise unwritable(folder / CRATE, error) from error


def _in_crate(path: Path) -> Entity:
    """A file or a folder of a crate."""
    if path.is_dir():
        return {"@id": f"{path.name}/", "@type": "Dataset", "name": path.name}
    kind = FORMATS.get(path.suffix, "application/octet-stream")
    size = str(path.stat().st_size)
    return {
        "@id": path.name,
        "@type": "File",
        "name": path.name,
        "encodingFormat": kind,
        "contentSize": size,
    }
