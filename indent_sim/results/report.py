"""Report of a result: one HTML file that needs nothing beside it, neither network nor other files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.model.symbols import ADHERENCE
from indent_sim.process.errors import UsageError
from indent_sim.process.version import VERSION
from indent_sim.results.folder import CONFIG, PROGRAM, content, write_atomically
from indent_sim.results.pictures import canvas, experiment, panels
from indent_sim.results.pictures.axes import axis, choice, in_print, scaled, unit_of
from indent_sim.results.pictures.panels import Wish
from indent_sim.results.pictures.pressure import strongest_step
from indent_sim.results.reader import Results, read_run
from indent_sim.results.tables import EXPERIMENT
from indent_sim.results.xdmf import kept_steps

MOST_ROWS = 100  # of a table; more are thinned
DIGITS = 6
WIDE = 110.0  # mm: what stays readable on a screen 400 pixels wide
CAPTIONS = {"force": "Force over depth", "pressure": "Pressure on the surface at the largest force",
            "profile": "Deformed surface and tip", "fields": "Von Mises stress in the deformed body"}  # fmt: skip
OF_EXPERIMENT = "The experiment: force over depth and the way of the base; over contact radius, or what follows in time"
NAME = "report.html"
FORMATS = (".html", ".htm")


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
    """Write a page into a file; UsageError when that cannot be."""
    try:
        write_atomically(path, text)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror or error}") from error


def of_run(folder: Path) -> str:
    """The page of one result."""
    results = read_run(folder)
    report = results.report
    if not report:
        raise UsageError(f"{folder} holds no result of {PROGRAM}: there is no run.json")
    failed = report.get("status") not in ("done", "running")
    tables = [_rows(results), *_experiment(results), _choices(report), *_bars(report), _audit(report),
              _provenance(report)]  # fmt: skip
    return page(
        title=report.get("title") or folder.resolve().name,
        subtitle=_subtitle(results),
        failure=f"{report['status']}: {report.get('reason') or 'no reason given'}" if failed else "",
        numbers=_numbers(results),
        said=[*_theory(results), *_hertz(results), *_stick(report), *_largest_pull(results), *_pull_off(results)],
        pictures=[*_pictures(results), *_picture_of_experiment(folder)],
        warnings=report.get("warnings", []),
        tables=[table for table in tables if table.rows],
        scene=_scene(folder),
        chosen=", ".join(report.get("plan", {}).get("auto", [])) or "nothing",
    )


def page(**parts: Any) -> str:
    """The page of its parts; whatever is text stays text."""
    from jinja2 import Environment, StrictUndefined

    source = (files("indent_sim.results") / "report.html").read_text(encoding="utf-8")
    template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True).from_string(source)
    text = template.render(program=PROGRAM, version=VERSION, **parts)
    return "".join(sign for sign in text if sign in "\n\t" or sign >= " ") + "\n"  # no control characters


def _subtitle(results: Results) -> str:
    report = results.report
    parts = [choice(report, "kinematics"), report.get("method"), f"{report.get('rows', 0)} rows",
             f"{PROGRAM} {report.get('version', '')}", report.get("finished", report.get("started", ""))]  # fmt: skip
    return "  ·  ".join(str(part).replace("_", " ") for part in parts if part)


def _numbers(results: Results) -> list[tuple[str, str]]:
    """The deepest row in words."""
    if not len(results):
        return []
    deepest = int(np.argmax(results["delta"]))
    found = []
    for name in ("delta", "force", "a"):
        along = axis(name, [results])
        error = results.table.get(f"{name}_error", np.full(len(results), np.nan))[deepest]
        bar = f" ± {float(along(error)):.2g}" if np.isfinite(error) else ""
        found.append((along.name, f"{float(along(results[name][deepest])):.4g}{bar} {in_print(along.unit)}".strip()))
    peak = results.table.get("p_max", np.full(len(results), np.nan))[deepest]
    if np.isfinite(peak):
        found.append(("largest pressure", scaled("pressure", [results], np.array([peak]), "p").said(peak)))
    return found


def _theory(results: Results) -> list[str]:
    """What theory and the usual formulas say beside the run."""
    theory = results.report.get("theory") or {}
    if not theory:
        return ["No theory is known for this scene."]
    asked = "delta" if "delta_deviation" in theory else "force"
    units, kind = results.report.get("units") or {}, {"delta": "length", "force": "force"}[asked]
    unit = in_print(unit_of(kind, units))
    lines = []
    if f"{asked}_deviation" in theory and results.report.get("method") != "theory":
        exact = "exact for this body" if theory.get("exact") else theory.get("why", "")
        beside = f"this run {theory[f'{asked}_deviation']:+.2%}{f' ({exact})' if exact else ''}"
        lines.append(f"{theory['name']}: {asked} {theory[asked]:.5g} {unit}; {beside}.")
    for formula in filter(None, [theory.get("half_space"), *theory.get("formulas", [])]):
        beside = f"{abs(formula['deviation']):.1%} {'below' if formula['deviation'] < 0 else 'above'} this run"
        lines.append(f"{formula['name']}: {asked} {formula[asked]:.5g} {unit}, {beside}.")
    return lines


def _hertz(results: Results) -> list[str]:
    """What a fit of the half-space formula to the curve reads."""
    fit = results.report.get("hertz")
    modulus = scaled("pressure", [results], np.array([fit["E"]]), "E").said(fit["E"]) if fit else ""
    return [f"A Hertz fit of this curve reads E = {modulus} ({fit['percent']:+.3g} %)."] if fit else []


def _largest_pull(results: Results) -> list[str]:
    """The largest pull of the rows of a tip that adheres with a range, and what is known of it beforehand."""
    known = results.report.get("adhesion") or {}
    pulled = known.get("largest_pull")
    if not pulled:
        return []
    units = results.report.get("units") or {}
    labels = {"1": ""} | {kind: f" {in_print(unit_of(kind, units))}".rstrip() for kind in ("force", "length")}
    numbers = [f"{symbol.meaning} {known[symbol.name]:.4g}{labels[symbol.dimension]}" for symbol in ADHERENCE
               if known.get(symbol.name) is not None]  # fmt: skip
    place = f"force {pulled['force']:.5g}{labels['force']} at delta {pulled['delta']:.5g}{labels['length']}"
    return [f"Largest pull: {place}.", f"Beforehand: {', '.join(numbers)}."]


def _stick(report: Mapping[str, Any]) -> list[str]:
    """What no slip would change."""
    stick = report.get("stick")
    return [f"{stick['words'][:1].upper()}{stick['words'][1:]}."] if stick else []


def _pull_off(results: Results) -> list[str]:
    """Where a tip that adheres comes off."""
    pulled = ((results.report.get("experiment") or {}).get("adhesion") or {}).get("pull_off") or {}
    units = results.report.get("units") or {}
    force, length = (in_print(unit_of(kind, units)) for kind in ("force", "length"))
    return [f"Pull-off under {how.replace('_', ' ')}: force {found['force']:.5g} {force} "
            f"at delta {found['delta']:.5g} {length}." for how, found in pulled.items()]  # fmt: skip


def _picture_of_experiment(folder: Path) -> list[Picture]:
    if not (folder / EXPERIMENT).exists():
        return []
    return [Picture(canvas.element(partial(experiment.draw, folder)), OF_EXPERIMENT, broad=True)]


def _experiment(results: Results) -> list[Table]:
    """The rows of experiment.csv."""
    path = results.path / EXPERIMENT
    rows = list(csv.reader(io.StringIO(content(path).decode("utf-8")))) if path.exists() else []
    if len(rows) < 2:
        return []
    kept = thinned(rows[1:])
    cells = [[short(cell) for cell in row] for row in kept]
    return [Table(f"Rows of {EXPERIMENT}", rows[0], cells, told(rows[1:], kept), True)]


def _pictures(results: Results) -> list[Picture]:
    """What there is to draw of a result."""
    touched = strongest_step(results) is not None
    there = {"force": len(results) > 0, "pressure": touched, "profile": touched,
             "fields": bool(kept_steps(results.path))}  # fmt: skip
    return [Picture(canvas.element(partial(panels.draw, [results], Wish((what,), width=WIDE))), CAPTIONS[what])
            for what, is_there in there.items() if is_there]  # fmt: skip


def _rows(results: Results) -> Table:
    names = [name for name in results.table if name != "wall_s"]
    every = list(range(len(results)))
    kept = thinned(every)
    rows = [[short(results.table[name][i]) for name in names] for i in kept]
    return Table("Rows of force_indentation.csv", names, rows, told(every, kept) + _unit_words(results), True)


def _unit_words(results: Results) -> str:
    units = results.report.get("units") or {}
    kinds = [in_print(unit_of(kind, units)) for kind in ("length", "force", "pressure")]
    return f"Lengths in {kinds[0]}, forces in {kinds[1]}, pressures in {kinds[2]}." if all(kinds) else ""


def thinned(rows: Sequence[Any]) -> Sequence[Any]:
    """At most MOST_ROWS of them, the first and the last among them."""
    places = np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(int)
    return [rows[i] for i in places]


def told(rows: Sequence[Any], kept: Sequence[Any]) -> str:
    """That rows were left out, in words."""
    return f"{len(kept)} of {len(rows)} rows. " if len(kept) < len(rows) else ""


def _choices(report: Mapping[str, Any]) -> Table:
    choices = report.get("plan", {}).get("choices", [])
    rows = [[str(one.get("key", "")), short(one.get("value", "")), str(one.get("why", ""))] for one in choices]
    return Table("Choices and their reasons", ["what", "choice", "why"], rows)


def _bars(report: Mapping[str, Any]) -> list[Table]:
    """The parts of the error bar at every step."""
    budget = report.get("error_budget")
    rows = [one for one in budget if isinstance(one, Mapping)] if isinstance(budget, list) else []
    if not rows:
        return []
    names = list(dict.fromkeys(name for row in rows for name in row))
    kept = thinned(rows)
    cells = [[short(row.get(name, "")) for name in names] for row in kept]
    return [Table("Where the error bars come from", names, cells, told(rows, kept), True)]


def _audit(report: Mapping[str, Any]) -> Table:
    audit = report.get("audit") or {}
    words = "The contact force against the supports' reactions, relative, at its worst; from 1e-8 on a row is refused."
    rows = [[name.replace("_", " "), short(value)] for name, value in audit.items()]
    return Table("Audit", ["what", "value"], rows, words)


def _provenance(report: Mapping[str, Any]) -> Table:
    """Which program, libraries and mesh made this, and what it took."""
    mesh = report.get("mesh") or {}
    facts = {"program": f"{PROGRAM} {report.get('version', '')}", "started": report.get("started"),
             "finished": report.get("finished"), "ranks": report.get("ranks"), "unknowns": report.get("dofs"),
             **{f"mesh {name}": value for name, value in mesh.items()},
             **{name: value for name, value in (report.get("versions") or {}).items()},
             "seconds": sum((report.get("timings") or {}).values()) or None,
             "peak memory [MB]": report.get("peak_memory_MB")}  # fmt: skip
    rows = [[name, short(value)] for name, value in facts.items() if value is not None]
    return Table("Provenance", ["what", "value"], rows)


def _scene(folder: Path) -> str:
    try:
        return content(folder / CONFIG).decode("utf-8")
    except (OSError, ValueError):
        return ""


def short(value: Any) -> str:
    """A value as it is read, not to its last digit; nothing for what there is none of."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return str(value) if value is not None else ""
    return "" if number != number or isinstance(value, bool) else f"{number:.{DIGITS}g}"
