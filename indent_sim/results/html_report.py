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
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.output_folder import (
    CONFIG,
    CRATE,
    CRATE_SIGNATURE,
    FIT,
    PROGRAM,
    STUDY,
    Report,
    is_own_file,
    read_regular_file,
    read_report,
    write_atomically,
)
from indent_sim.results.pictures import experiment, figures, history, panels
from indent_sim.results.pictures.axes import (
    axis_of_column,
    plan_choice,
    printed_unit,
    scaled_axis,
    time_text,
    unit_label,
)
from indent_sim.results.pictures.history import is_time_stepped
from indent_sim.results.pictures.panels import PlotRequest
from indent_sim.results.pictures.pressure import largest_force_step
from indent_sim.results.reader import Results, read_history, read_run
from indent_sim.results.tables import EXPERIMENT
from indent_sim.results.writer import to_json
from indent_sim.results.xdmf import read_fields, steps_with_fields

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")  # in a sentence
MAX_TABLE_ROWS = 100  # of a table; more are thinned
AUDIT_NOTE = (
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
REPORT_FILE = "report.html"
CrateEntity = dict[str, Any]  # of a crate, as JSON-LD has it
CRATE_PROFILE = "https://w3id.org/ro/crate/1.1"
MEDIA_TYPES = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".png": "image/png",
}
MEDIA_TYPES |= {
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
        raise write_error(path, error) from error


def run_page(folder: Path) -> str:
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
    audit_rows = [
        [name.replace("_", " "), value_text(value)]
        for name, value in _report_section(report, "audit").items()
    ]
    audit = Table("Audit", ["what", "value"], audit_rows, AUDIT_NOTE)
    plan_choices = report.get("plan", {}).get("choices", [])
    reasons = [
        [
            str(decision.get("key", "")),
            value_text(decision.get("value", "")),
            str(decision.get("why", "")),
        ]
        for decision in plan_choices
    ]
    choices = Table("Choices and their reasons", ["what", "choice", "why"], reasons)
    tables = [
        _force_row_table(results),
        *_experiment_tables(results),
        choices,
        *_error_budget_tables(report),
        audit,
        _provenance_table(report),
    ]
    words = _report_section(report, "stick").get("words")
    stick_sentences = [f"{words[:1].upper()}{words[1:]}."] if words else []
    sentences = [
        *_theory_sentences(results),
        *_hertz_sentences(results),
        *_tension_sentences(results),
        *stick_sentences,
        *_largest_pull_sentences(results),
        *_pull_off_sentences(results),
    ]
    automatic_keys = ", ".join(report.get("plan", {}).get("auto", [])) or "nothing"
    scene = ""
    with suppress(OSError, ValueError):
        scene = read_regular_file(folder / CONFIG).decode("utf-8")
    text_parts = {
        "numbers": _key_numbers(results),
        "said": sentences,
        "scene": scene,
        "chosen": automatic_keys,
    }
    picture_parts = {"pictures": _run_pictures(results), "warnings": report.get("warnings", [])}
    title = report.get("title") or folder.resolve().name
    shown_tables = [table for table in tables if table.rows]
    parts = [
        plan_choice(report, "kinematics"),
        report.get("method"),
        f"{report.get('rows', 0)} rows",
    ]
    parts += [
        f"{PROGRAM} {report.get('version', '')}",
        report.get("finished", report.get("started", "")),
    ]
    subtitle = "  ·  ".join(str(part).replace("_", " ") for part in parts if part)
    return render_page(
        title=title,
        subtitle=subtitle,
        failure=failure,
        tables=shown_tables,
        **picture_parts,
        **text_parts,
    )


def render_page(**parts: Any) -> str:
    """The page of its parts; whatever is text stays text.

    What only a run has may be missing, and a picture of nothing is left out.
    """
    from jinja2 import Environment, StrictUndefined

    parts = {"numbers": [], "said": [], "scene": "", "chosen": ""} | parts
    parts["pictures"] = [picture for picture in parts.get("pictures", ()) if picture.svg]
    parts["warnings"] = merge_similar_warnings(parts.get("warnings", ()))
    source = (files("indent_sim.results") / "report.html").read_text(encoding="utf-8")
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True
    ).from_string(source)
    text = template.render(program=PROGRAM, version=VERSION, **parts)
    return (
        "".join(sign for sign in text if sign in "\n\t" or sign >= " ") + "\n"
    )  # no control characters


def merge_similar_warnings(warnings: Sequence[str]) -> list[str]:
    """Warnings that differ in nothing but their numbers as one line each, with the range of every
    number.
    """
    similar_lines: dict[str, list[str]] = {}
    for line in dict.fromkeys(warnings):
        similar_lines.setdefault(NUMBER.sub("#", line), []).append(line)
    return [
        lines[0] if len(lines) == 1 else _merge_lines(lines) for lines in similar_lines.values()
    ]


def _merge_lines(lines: Sequence[str]) -> str:
    """Lines that are alike as one."""
    numbers = [
        sorted(set(column), key=float) for column in zip(*map(NUMBER.findall, lines), strict=True)
    ]
    ranges = (
        column[0] if len(column) == 1 else f"{column[0]} to {column[-1]}" for column in numbers
    )
    return f"{NUMBER.sub(lambda _: next(ranges), lines[0])} ({len(lines)} such warnings)"


def _key_numbers(results: Results) -> list[tuple[str, str]]:
    """The deepest row in words, where time passes that of the largest force, or the last one
    without any.
    """
    if not len(results):
        return []
    deepest = int(np.nanargmax(results["delta"]))
    numbers = []
    unknown = np.full(len(results), np.nan)
    if "t" in results.table:
        force = np.nan_to_num(results["force"])
        deepest = int(np.argmax(force)) if force.any() else len(force) - 1
        numbers.append(("time t", time_text(results, float(results["t"][deepest]))))
    for name in ("delta", "force", "a"):
        column = axis_of_column(name, [results])
        error = results.table.get(f"{name}_error", unknown)[deepest]
        error_text = f" ± {float(column(error)):.2g}" if np.isfinite(error) else ""
        numbers.append(
            (
                column.name,
                f"{float(column(results[name][deepest])):.4g}{error_text} {printed_unit(column.unit)}".strip(),
            )
        )
    peak = results.table.get("p_max", unknown)[deepest]
    if np.isfinite(peak):
        numbers.append(
            ("largest pressure", scaled_axis("pressure", [results], peak, "p").value_text(peak))
        )
    return numbers


def _theory_sentences(results: Results) -> list[str]:
    """What theory and the usual formulas say beside the run."""
    theory = _report_section(results.report, "theory")
    time = _report_section(results.report, "time")
    if time:
        words = time.get("words") or ""
        method_sentence = (
            f"In time by {time.get('method', 'its elastic curve')}: {time.get('why', '')}."
        )
        return [method_sentence, *([f"{words[:1].upper()}{words[1:]}."] if words else [])]
    if not theory:
        return ["No theory is known for this scene."]
    computed = "delta" if "delta_deviation" in theory else "force"
    unit = _unit_text(results, {"delta": "length", "force": "force"}[computed])
    lines = []
    if f"{computed}_deviation" in theory and results.report.get("method") != "theory":
        exact = "exact for this body" if theory.get("exact") else theory.get("why", "")
        deviation_text = (
            f"this run {theory[f'{computed}_deviation']:+.2%}{f' ({exact})' if exact else ''}"
        )
        lines.append(
            f"{theory['name']}: {computed} {theory[computed]:.5g} {unit}; {deviation_text}."
        )
    for formula in filter(None, [theory.get("half_space"), *theory.get("formulas", [])]):
        deviation_text = (
            f"{abs(formula['deviation']):.1%} "
            f"{'below' if formula['deviation'] < 0 else 'above'} this run"
        )
        lines.append(
            f"{formula['name']}: {computed} {formula[computed]:.5g} {unit}, {deviation_text}."
        )
    return lines


def _hertz_sentences(results: Results) -> list[str]:
    """What a fit of the half-space formula to the curve reads."""
    fit = results.report.get("hertz")
    if not fit:
        return []
    modulus = scaled_axis("pressure", [results], fit["E"], "E").value_text(fit["E"])
    return [
        f"A Hertz fit of this curve reads E = {modulus} ({fit['percent']:+.3g} "
        f"%{fit.get('against', '')})."
    ]


def _tension_sentences(results: Results) -> list[str]:
    """The length below which surface tension holds more of the force than the body does, beside the
    contact.
    """
    expected = _report_section(results.report, "plan", "prediction")
    length = expected.get("elastocapillary_length")
    a = expected.get("a")
    if not length:
        return []
    ratio_text = f", {length / a:.2g} of the contact radius to expect" if a else ""
    return [
        f"Elastocapillary length gamma/E*: {length:.4g} {_unit_text(results, 'length')}".rstrip()
        + f"{ratio_text}."
    ]


def _largest_pull_sentences(results: Results) -> list[str]:
    """The pull-off of a tip that adheres with a range, or the largest pull of its rows; what is
    known beforehand.
    """
    adhesion = _report_section(results.report, "adhesion")
    largest_pull = adhesion.get("largest_pull")
    if not largest_pull:
        return []
    labels = {"1": ""} | {
        kind: f" {_unit_text(results, kind)}".rstrip() for kind in ("force", "length")
    }
    symbols = [symbol for symbol in ADHESION_SYMBOLS if adhesion.get(symbol.name) is not None]
    numbers = [
        f"{symbol.meaning} {adhesion[symbol.name]:.4g}{labels[symbol.dimension]}"
        for symbol in symbols
    ]
    beforehand = f"Beforehand: {', '.join(numbers)}."
    pull_off = adhesion.get("pull_off")
    strongest = pull_off or largest_pull
    place = f"force {strongest['force']:.5g}{labels['force']}"
    place += f" at delta {strongest['delta']:.5g}{labels['length']}"
    if not pull_off:
        return [f"Largest pull: {place}.", beforehand]
    error_text = "with an unknown error"
    if (error := pull_off.get("error")) is not None:
        error_text = f"within {error:.2g}{labels['force']} on this mesh"
    return [f"Pull-off: {place}, searched between rows, {error_text}.", beforehand]


def _pull_off_sentences(results: Results) -> list[str]:
    """Where a tip that adheres comes off."""
    force = _unit_text(results, "force")
    length = _unit_text(results, "length")
    sentences = []
    for control, point in _report_section(
        results.report, "experiment", "adhesion", "pull_off"
    ).items():
        place = f"force {point['force']:.5g} {force} at delta {point['delta']:.5g} {length}"
        sentences.append(f"Pull-off under {control.replace('_', ' ')}: {place}.")
    return sentences


def _report_section(report: Report, *names: str) -> Report:
    """A mapping in run.json, by the names of those that it is in; empty where there is none."""
    for name in names:
        report = report.get(name) or {}
    return report


def _unit_text(results: Results, kind: str) -> str:
    return printed_unit(unit_label(kind, _report_section(results.report, "units")))


def _experiment_tables(results: Results) -> list[Table]:
    if not (results.path / EXPERIMENT).exists():
        return []
    columns = read_history(results.path)
    return [
        thinned_table(
            f"Rows of {EXPERIMENT}", list(columns), list(zip(*columns.values(), strict=True))
        )
    ]


def thinned_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[object]], words: str = ""
) -> Table:
    """A table of numbers with at most MOST_ROWS of its rows, the first and the last among them."""
    kept_rows = np.linspace(0, len(rows) - 1, min(MAX_TABLE_ROWS, len(rows))).round().astype(int)
    kept = f"{len(kept_rows)} of {len(rows)} rows. " if len(kept_rows) < len(rows) else ""
    return Table(
        title, head, [[value_text(cell) for cell in rows[i]] for i in kept_rows], kept + words, True
    )


def _run_pictures(results: Results) -> list[Picture]:
    kept = steps_with_fields(results.path, results["step"])
    in_time = is_time_stepped(results.report) and len(results) > 0
    pictures = [_history_picture(results)] if in_time else []
    panel_kinds = ["force"] if len(results) and not in_time else []
    panel_kinds += ["pressure", "profile"] if largest_force_step(results) is not None else []
    panel_kinds += ["fields"] if kept else []
    for panel_kind in panel_kinds:
        drawing = partial(
            panels.draw, [results], PlotRequest((panel_kind,), width=110.0)
        )  # mm: readable on a small screen
        pictures.append(Picture(figures.svg_element(drawing), CAPTIONS[panel_kind]))
    if in_time and len(kept) == len(results):
        pictures += [_film_picture(results, name) for name in _film_fields(results, kept[-1])]
    if experiment.has_elastic_curve(results.path, results.report):
        pictures.append(
            Picture(
                figures.svg_element(partial(experiment.draw, results.path)),
                EXPERIMENT_CAPTION,
                broad=True,
            )
        )
    return pictures


def _history_picture(results: Results) -> Picture:
    is_broad = len(history.panel_names(results)) > 1
    return Picture(figures.svg_element(partial(history.draw, results)), HISTORY_CAPTION, is_broad)


def _film_fields(results: Results, step: int) -> list[str]:
    """The fields that tell most of a body in time: of its fluid and its swelling, else the stress."""
    fields = read_fields(results.path, step)
    return [name for name in ("pore_pressure", "swelling") if name in fields] or ["von_mises"]


def _film_picture(results: Results, name: str) -> Picture:
    drawing = partial(panels.draw, [results], PlotRequest(("film",), (name,), width=240.0))  # mm
    words = f"{CAPTIONS.get(name, CAPTIONS['film'])}, at times of the history"
    return Picture(figures.svg_element(drawing), words, broad=True)


def _force_row_table(results: Results) -> Table:
    columns = {name: column for name, column in results.table.items() if name != "wall_s"}
    rows = list(zip(*columns.values(), strict=True))
    kinds = [_unit_text(results, kind) for kind in ("length", "force", "pressure")]
    units = (
        f"Lengths in {kinds[0]}, forces in {kinds[1]}, pressures in {kinds[2]}."
        if all(kinds)
        else ""
    )
    return thinned_table("Rows of force_indentation.csv", list(columns), rows, units)


def _error_budget_tables(report: Report) -> list[Table]:
    budget = report.get("error_budget")
    rows = (
        [entry for entry in budget if isinstance(entry, Mapping)]
        if isinstance(budget, list)
        else []
    )
    if not rows:
        return []
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[row.get(name, "") for name in names] for row in rows]
    return [thinned_table("Where the error bars come from", names, cells)]


def _provenance_table(report: Report) -> Table:
    """Which program, libraries and mesh made this, and what it took."""
    facts: Report = {"program": f"{PROGRAM} {report.get('version', '')}"}
    facts |= {name: report.get(name) for name in ("started", "finished", "ranks")} | {
        "unknowns": report.get("dofs")
    }
    facts |= {
        f"mesh {name}": value for name, value in _report_section(report, "mesh").items()
    } | _report_section(report, "versions")
    facts |= {
        "PETSC_OPTIONS": report.get("PETSC_OPTIONS"),
        "seconds": sum(_report_section(report, "timings").values()) or None,
    }
    facts |= {"peak memory [MB]": report.get("peak_memory_MB")}
    rows = [[name, value_text(value)] for name, value in facts.items() if value is not None]
    return Table("Provenance", ["what", "value"], rows)


def value_text(value: Any) -> str:
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
    report = read_report(folder) or read_report(folder, STUDY) or read_report(folder, FIT)
    existing = [name for name in sorted(parts) if (folder / name).exists() and name != CRATE]
    part_entities = [_crate_entity(folder / name) for name in existing]
    program = {
        "@id": "#program",
        "@type": "SoftwareApplication",
        "name": PROGRAM,
        "version": report.get("version", VERSION),
    }
    action: CrateEntity = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": "simulation",
        "instrument": {"@id": "#program"},
    }
    action |= {"result": [{"@id": part["@id"]} for part in part_entities if part["@id"] != CONFIG]}
    action |= {"object": [{"@id": CONFIG}]} if CONFIG in existing else {}
    times = {"startTime": report.get("started"), "endTime": report.get("finished")}
    action |= {name: value for name, value in times.items() if value}
    root: CrateEntity = {
        "@id": "./",
        "@type": "Dataset",
        "name": str(report.get("title") or folder.resolve().name),
    }
    root |= {
        "description": f"Simulated indentation by {PROGRAM}",
        "hasPart": [{"@id": part["@id"]} for part in part_entities],
    }
    root |= {"datePublished": report["finished"]} if report.get("finished") else {}
    descriptor: CrateEntity = {
        "@id": CRATE,
        "@type": "CreativeWork",
        "name": CRATE_SIGNATURE,
        "about": {"@id": "./"},
        "conformsTo": {"@id": CRATE_PROFILE},
    }
    graph = [descriptor, root | {"mentions": {"@id": "#run"}}, *part_entities, action, program]
    try:
        write_atomically(
            folder / CRATE,
            to_json({"@context": f"{CRATE_PROFILE}/context", "@graph": graph}) + "\n",
        )
    except OSError as error:
        raise write_error(folder / CRATE, error) from error


def _crate_entity(path: Path) -> CrateEntity:
    """A file or a folder of a crate."""
    if path.is_dir():
        return {"@id": f"{path.name}/", "@type": "Dataset", "name": path.name}
    kind = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    size = str(path.stat().st_size)
    return {
        "@id": path.name,
        "@type": "File",
        "name": path.name,
        "encodingFormat": kind,
        "contentSize": size,
    }
