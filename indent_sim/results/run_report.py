"""Report of a run: sentences, tables and pictures of its result folder."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from indent_sim.model.symbols import ADHESION_SYMBOLS
from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.field_reader import read_fields, steps_with_fields
from indent_sim.results.html_report import Picture, Table, render_page, thinned_table, value_text
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
from indent_sim.results.result_files import CONFIG, PROGRAM, Report
from indent_sim.results.tables import EXPERIMENT

CAPTIONS = {
    "force": "Force over depth",
    "pressure": "Pressure on the surface at the largest force",
    "profile": "Deformed surface and tip",
    "fields": "Von Mises stress in the deformed body",
    "pore_pressure": "Pore pressure above the pressure of the bath",
    "film": "Von Mises stress",
    "plastic_strain": "Plastic zone: equivalent plastic strain",
    "swelling": "Swelling: volume relative to the dry gel",
}


def run_page(folder: Path) -> str:
    """Return the HTML page of a result; raise UsageError if the folder has no result."""
    results = read_run(folder)
    report = results.report
    if not report:
        raise UsageError(f"{folder} has no result of {PROGRAM}: there is no run.json")
    failure = ""
    if report.get("status") not in ("done", "running"):
        status = report.get("status", "unknown")
        failure = f"{status}: {report.get('reason') or 'no reason given'}"
    tables = [
        _force_row_table(results),
        *_experiment_tables(results),
        _choice_table(report),
        *_error_budget_tables(report),
        _audit_table(report),
        _provenance_table(report),
    ]
    sentences = [
        *_theory_sentences(results),
        *_hertz_sentences(results),
        *_tension_sentences(results),
        *_no_slip_sentences(report),
        *_largest_pull_sentences(results),
        *_pull_off_sentences(results),
    ]
    scene = ""
    with suppress(OSError, ValueError):
        scene = read_regular_file(folder / CONFIG).decode("utf-8")
    return render_page(
        title=report.get("title") or folder.resolve().name,
        subtitle=_page_subtitle(report),
        failure=failure,
        tables=[table for table in tables if table.rows],
        pictures=_run_pictures(results),
        warnings=report.get("warnings", []),
        numbers=_key_numbers(results),
        said=sentences,
        scene=scene,
        chosen=", ".join(report.get("plan", {}).get("auto", [])) or "nothing",
    )


def _page_subtitle(report: Report) -> str:
    """Return kinematics, method, number of rows, version and time of a run in one line."""
    parts = [
        plan_choice(report, "kinematics"),
        report.get("method"),
        f"{report.get('rows', 0)} rows",
        f"{PROGRAM} {report.get('version', '')}",
        report.get("finished", report.get("started", "")),
    ]
    return "  ·  ".join(str(part).replace("_", " ") for part in parts if part)


def _choice_table(report: Report) -> Table:
    """Return the table of the program's choices and their reasons."""
    rows = [
        [
            str(choice.get("key", "")),
            value_text(choice.get("value", "")),
            str(choice.get("why", "")),
        ]
        for choice in report.get("plan", {}).get("choices", [])
    ]
    return Table("Choices and their reasons", ["what", "choice", "why"], rows)


def _audit_table(report: Report) -> Table:
    """Return the table of checks of the solution."""
    rows = [
        [name.replace("_", " "), value_text(value)]
        for name, value in _report_section(report, "audit").items()
    ]
    note = (
        "force against reaction: largest relative difference between the contact force and the "
        "reactions of the supports; a row is rejected if it exceeds 1e-8."
    )
    return Table("Checks of the solution", ["what", "value"], rows, note)


def _key_numbers(results: Results) -> list[tuple[str, str]]:
    """Return names and values of the quantities in the most important row.

    The most important row is that of the largest depth, or in a history the row of the largest
    force (the last row if all forces are 0).
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
        number = f"{float(column(results[name][deepest])):.4g}"
        numbers.append((column.name, f"{number}{error_text} {printed_unit(column.unit)}".strip()))
    peak = results.table.get("p_max", unknown)[deepest]
    if np.isfinite(peak):
        numbers.append(
            ("largest pressure", scaled_axis("pressure", [results], peak, "p").value_text(peak))
        )
    return numbers


def _theory_sentences(results: Results) -> list[str]:
    """Return sentences that compare the run with the reference theory and with usual formulas."""
    theory = _report_section(results.report, "theory")
    time = _report_section(results.report, "time")
    if time:
        words = time.get("words") or ""
        method_sentence = (
            f"History solved by {time.get('method', 'its elastic curve')}: {time.get('why', '')}."
        )
        return [method_sentence, *([f"{words[:1].upper()}{words[1:]}."] if words else [])]
    onset_sentences = _onset_sentences(results)
    if not theory:
        return [*onset_sentences, "There is no reference theory for this scene."]
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
    if "stiffness_deviation" in theory:
        lines.append(
            f"{theory['name']}: unloading stiffness {theory['stiffness']:.5g}; this run "
            f"{theory['stiffness_deviation']:+.2%}."
        )
    for formula in filter(None, [theory.get("half_space"), *theory.get("formulas", [])]):
        deviation_text = (
            f"{abs(formula['deviation']):.1%} "
            f"{'below' if formula['deviation'] < 0 else 'above'} this run"
        )
        lines.append(
            f"{formula['name']}: {computed} {formula[computed]:.5g} {unit}, {deviation_text}."
        )
    return onset_sentences + lines


def _onset_sentences(results: Results) -> list[str]:
    """Return a sentence on the depth from which a body yields; empty if it is not known."""
    onset = _report_section(results.report, "onset_of_yield")
    if not onset or onset["delta"] == 0:
        return []
    depth = f"{onset['delta']:.4g} {_unit_text(results, 'length')}".rstrip()
    force = f"{onset['force']:.4g} {_unit_text(results, 'force')}".rstrip()
    outcome = "this run has yielded" if onset["passed"] else "this run is elastic"
    return [f"Onset of yield (Hertz and von Mises): depth {depth}, force {force}; {outcome}."]


def _no_slip_sentences(report: Report) -> list[str]:
    """Return a sentence on the change of the force if the surface could not slip on the tip."""
    words = _report_section(report, "stick").get("words")
    return [f"{words[:1].upper()}{words[1:]}."] if words else []


def _hertz_sentences(results: Results) -> list[str]:
    """Return a sentence on the modulus by a Hertz fit of the curve."""
    fit = results.report.get("hertz")
    if not fit:
        return []
    modulus = scaled_axis("pressure", [results], fit["E"], "E").value_text(fit["E"])
    return [
        f"A Hertz fit of this curve gives E = {modulus} ({fit['percent']:+.3g} "
        f"%{fit.get('against', '')})."
    ]


def _tension_sentences(results: Results) -> list[str]:
    """Return a sentence on the length gamma/E* below which surface tension dominates."""
    expected = _report_section(results.report, "plan", "prediction")
    length = expected.get("elastocapillary_length")
    a = expected.get("a")
    if not length:
        return []
    ratio_text = f", {length / a:.2g} of the expected contact radius" if a else ""
    return [
        f"Elastocapillary length gamma/E*: {length:.4g} {_unit_text(results, 'length')}".rstrip()
        + f"{ratio_text}."
    ]


def _largest_pull_sentences(results: Results) -> list[str]:
    """Return sentences on the pull-off force, or on the largest tensile force of a row.

    A second sentence gives the predicted values.
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
    beforehand = f"Expected before the run: {', '.join(numbers)}."
    pull_off = adhesion.get("pull_off")
    strongest = pull_off or largest_pull
    force_text = f"{strongest['force']:.5g}{labels['force']}"
    depth_text = f"at delta {strongest['delta']:.5g}{labels['length']}"
    if not pull_off:
        return [f"Largest tensile force: {force_text} {depth_text}.", beforehand]
    error_text = "with an unknown error"
    if (error := pull_off.get("error")) is not None:
        error_text = f"within {error:.2g}{labels['force']} on this mesh"
    pull_off_text = f"force {force_text} {depth_text}, searched between rows, {error_text}"
    return [f"Pull-off: {pull_off_text}.", beforehand]


def _pull_off_sentences(results: Results) -> list[str]:
    """Return sentences on the pull-off points of an adhesive tip under each type of control."""
    force = _unit_text(results, "force")
    length = _unit_text(results, "length")
    sentences = []
    for control, point in _report_section(
        results.report, "experiment", "adhesion", "pull_off"
    ).items():
        place = f"force {point['force']:.5g} {force} at delta {point['delta']:.5g} {length}"
        sentences.append(f"Pull-off under {control.replace('_', ' ')}: {place}.")
    adhesion = _report_section(results.report, "experiment", "adhesion")
    if words := adhesion.get("words"):
        sentences.append(f"{words[0].upper()}{words[1:]}.")
    return sentences


def _report_section(report: Report, *names: str) -> Report:
    """Return a nested section of run.json, found by its keys from the top; empty if missing."""
    for name in names:
        report = report.get(name) or {}
    return report


def _unit_text(results: Results, kind: str) -> str:
    """Return the printed unit of a kind of quantity."""
    return printed_unit(unit_label(kind, _report_section(results.report, "units")))


def _experiment_tables(results: Results) -> list[Table]:
    """Return the table of experiment.csv, if there is one."""
    if not (results.path / EXPERIMENT).exists():
        return []
    columns = read_history(results.path)
    return [
        thinned_table(
            f"Rows of {EXPERIMENT}", list(columns), list(zip(*columns.values(), strict=True))
        )
    ]


def _run_pictures(results: Results) -> list[Picture]:
    """Return the pictures that can be drawn from the rows and fields of a result."""
    steps = steps_with_fields(results.path, results["step"])
    in_time = is_time_stepped(results.report) and len(results) > 0
    pictures = [_history_picture(results)] if in_time else []
    panel_kinds = ["force"] if len(results) and not in_time else []
    panel_kinds += ["pressure", "profile"] if largest_force_step(results) is not None else []
    panel_kinds += ["fields"] if steps else []
    # A width of 110 mm is readable on a small screen.
    for panel_kind in panel_kinds:
        drawing = partial(panels.draw, [results], PlotRequest((panel_kind,), width=110.0))
        pictures.append(Picture(figures.svg_element(drawing), CAPTIONS[panel_kind]))
    if steps and "plastic_strain" in read_fields(results.path, steps[-1]):
        request = PlotRequest(("fields",), ("plastic_strain",), width=110.0)
        drawing = partial(panels.draw, [results], request)
        pictures.append(Picture(figures.svg_element(drawing), CAPTIONS["plastic_strain"]))
    if in_time and len(steps) == len(results):
        pictures += [_film_picture(results, name) for name in _film_fields(results, steps[-1])]
    if experiment.has_elastic_curve(results.path, results.report):
        caption = (
            "Force, depth and displacement of the base over time, or along the branches of an "
            "equilibrium curve; force over the contact radius, or derived quantities over time"
        )
        pictures.append(
            Picture(
                figures.svg_element(partial(experiment.draw, results.path)),
                caption,
                broad=True,
            )
        )
    return pictures


def _history_picture(results: Results) -> Picture:
    """Return the picture of a history in time."""
    is_broad = len(history.panel_names(results)) > 1
    caption = "Quantities that change in time, and the force over a depth that changes"
    return Picture(figures.svg_element(partial(history.draw, results)), caption, is_broad)


def _film_fields(results: Results, step: int) -> list[str]:
    """Return the fields drawn over time: pore pressure and swelling, or von Mises stress."""
    fields = read_fields(results.path, step)
    return [name for name in ("pore_pressure", "swelling") if name in fields] or ["von_mises"]


def _film_picture(results: Results, name: str) -> Picture:
    """Return a picture of one field at several times."""
    drawing = partial(panels.draw, [results], PlotRequest(("film",), (name,), width=240.0))
    words = f"{CAPTIONS.get(name, CAPTIONS['film'])}, at times of the history"
    return Picture(figures.svg_element(drawing), words, broad=True)


def _force_row_table(results: Results) -> Table:
    """Return the table of the rows of force_indentation.csv."""
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
    """Return the table of the parts of the error bars, if there is one."""
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
    return [thinned_table("Parts of the error bars", names, cells)]


def _provenance_table(report: Report) -> Table:
    """Return the table of program, libraries, mesh, time and memory."""
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
