"""Text for a terminal: progress, plans, comparisons and lists."""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from typing import TYPE_CHECKING, Any

from indent_sim.process.errors import printable
from indent_sim.process.usage import ProgressEstimate

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.fitting.curve_requirements import CurveRequirements
    from indent_sim.fitting.design import Design
    from indent_sim.fitting.inference.model_assessment import Interval
    from indent_sim.results.compare import Comparison
    from indent_sim.run.hardness_analysis import Hardness
    from indent_sim.run.model_selection.effects import Effect
    from indent_sim.run.model_selection.recommended_model import Requirements
    from indent_sim.run.pipeline import Outcome
    from indent_sim.run.planned_run import PlannedRun
    from indent_sim.run.single_run import Progress
    from indent_sim.run.tip_calibration import TipCalibration
    from indent_sim.run.work_and_loops import HysteresisLoop
    from indent_sim.studies.study_plan import StudyPlan


# Report of a run, or a section of it.
Report = dict[str, Any]


@contextmanager
def show_progress(print_line: Callable[[str], None], config: Config) -> Iterator[Progress]:
    """Yield a function that shows progress after every row: by a bar on a terminal, or by lines.

    Parameters
    ----------
    print_line
        Prints a line of the log, to stderr.
    config
        Config of the scene, for the units of the rows.
    """
    estimate = ProgressEstimate()
    is_flat = "plane_strain" in (config.mesh.symmetry, getattr(config.body, "kinematics", ""))
    units = _row_units(vars(config.units), is_flat or config.body.shape == "strip")
    if not sys.stderr.isatty():
        yield lambda state, step, total: _log_progress(
            print_line,
            state.summary(units),
            f"{state.newton_iterations} iteration{'s' * (state.newton_iterations != 1)}",
            step,
            total,
            estimate,
        )
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.BarColumn(), bars.MofNCompleteColumn(), bars.TextColumn("{task.description}"))
    with bars.Progress(*columns, bars.TimeElapsedColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task("building the model", total=None)
        yield lambda state, step, total: bar.update(
            task,
            completed=step,
            total=total,
            description=f"{state.summary(units)}  {estimate.record_step(total - step)[1]}",
        )


def _row_units(units: Mapping[str, str], is_flat: bool) -> dict[str, str]:
    """Return the units of time, depth, force and contact radius that the scene has.

    Forces in plane strain (`is_flat`) are per unit length.
    """
    length = units.get("length", "")
    force = units.get("force", "")
    if is_flat and force and length:
        force = f"{force}/{length}"
    lengths = dict.fromkeys(("delta", "a", "x"), length)
    return {"t": "s" if length else "", "force": force} | lengths


def conclusion_lines(outcome: Outcome) -> list[str]:
    """Return the last lines of a run: theory, pictures, warnings and its last row."""
    report = outcome.report
    lines = []
    rows = len(outcome.states)
    resumed_rows = outcome.resumed_after
    if resumed_rows and resumed_rows == rows:
        lines.append(f"nothing left to compute: all {rows} rows existed already")
    elif resumed_rows:
        lines.append(f"resumed: {resumed_rows} of the {rows} rows existed already")
    lines += [*_error_estimate_lines(outcome), *_theory_lines(report)]
    if fit := report.get("hertz"):
        modulus_error = f"{fit['percent']:+.3g} %{fit.get('against', '')}"
        lines.append(f"a Hertz fit of this curve gives E = {fit['E']:.4g} ({modulus_error})")
    lines += _section_sentence(_report_section(report, "stick"))
    units = _report_units(report)
    lines += [
        *_largest_pull_lines(_report_section(report, "adhesion"), units),
        *_experiment_lines(_report_section(report, "experiment"), units),
    ]
    if "time" in report:
        lines.append(f"history solved by {report['time']['method']}: {report['time']['why']}")
    pictures = (outcome.directory / name for name in ("force_indentation.png", "experiment.png"))
    lines += [f"picture: {picture}" for picture in pictures if picture.exists()]
    return lines + warning_lines(outcome) + _final_row_lines(outcome)


def _theory_lines(report: Report) -> list[str]:
    """Return the lines of the reference theory and of usual formulas for half-space and film."""
    theory = _report_section(report, "theory")
    lines = []
    if theory and report.get("method") == "theory":
        lines.append(f"solved by theory: {theory['why']}")
    elif theory:
        lines.append(_theory_line(theory, _computed_quantity_name(report, theory)))
    if "stiffness_deviation" in theory:
        lines.append(
            f"{theory['name']}: unloading stiffness {theory['stiffness']:.6g}; this run "
            f"{theory['stiffness_deviation']:+.3%}"
        )
    lines += _onset_lines(report)
    if half_space := theory.get("half_space"):
        side = "below" if half_space["deviation"] < 0 else "above"
        prescribed, computed = _prescribed_and_computed(theory)
        deviation_text = f"{abs(half_space['deviation']):.2%} {side} this run"
        lines.append(
            f"{half_space['name']}, half-space, at {prescribed} {theory[prescribed]:.6g}: "
            f"{computed} {half_space[computed]:.6g}, {deviation_text}"
        )
    if theory.get("formulas"):
        prescribed, computed = _prescribed_and_computed(theory)
        formula_texts = (
            f"{formula['name']} {formula[computed]:.6g} ({formula['deviation']:+.3%})"
            for formula in theory["formulas"]
        )
        kind = "block" if theory["name"].endswith("compression") else "film"
        lines.append(
            f"{kind} formulas at {prescribed} {theory[prescribed]:.6g}: "
            f"{computed} {', '.join(formula_texts)}"
        )
    return lines


def _onset_lines(report: Report) -> list[str]:
    """Return the line of the onset of yield; empty if it is not known."""
    onset = _report_section(report, "onset_of_yield")
    if not onset or onset["delta"] == 0:
        return []
    units = _report_units(report)
    place = f"depth {_quantity_text(onset['delta'], units['delta'])}"
    place += f", force {_quantity_text(onset['force'], units['force'])}"
    outcome = "this run has yielded" if onset["passed"] else "this run is elastic"
    return [f"onset of yield (Hertz and von Mises): {place}; {outcome}"]


def _final_row_lines(outcome: Outcome) -> list[str]:
    """Return lines on the last row and, after unloading, on hysteresis and largest force."""
    from indent_sim.run.summary import row_of_interest
    from indent_sim.run.work_and_loops import hysteresis_loop

    states = outcome.states
    report = outcome.report
    if not states:
        return []
    units = _report_units(report)
    last_row_line = f"step {states[-1].step}: {states[-1].summary(units)}"
    largest_force_row = row_of_interest(states, report.get("control") == "force")
    if largest_force_row is states[-1]:
        return [last_row_line]
    loses_work = (
        any(state.t is not None or state.dissipation for state in states) or "adhesion" in report
    )
    # An elastic body unloads along its loading curve, so that its loop is only numerical error.
    loop = hysteresis_loop(states) if loses_work else None
    return [
        last_row_line,
        *_hysteresis_lines(loop, units),
        f"largest force, step {largest_force_row.step}: {largest_force_row.summary(units)}",
    ]


def _report_units(report: Report) -> dict[str, str]:
    """Return the units of time, depth, force and contact radius in the rows of a run."""
    return _row_units(_mapping_of(report.get("units") or {}), _is_plane_strain(report))


def _is_plane_strain(report: Report) -> bool:
    """Return whether forces are per unit length."""
    choices = map(_mapping_of, _report_section(report, "plan").get("choices") or [])
    return any(
        choice["key"] == "kinematics" and choice["value"] == "plane_strain" for choice in choices
    )


def _mapping_of(part: Any) -> Mapping[str, Any]:
    """Return a section of a report as a mapping; sections from run.json are mappings already."""
    return part if isinstance(part, Mapping) else vars(part)


def _hysteresis_lines(loop: HysteresisLoop | None, units: Mapping[str, str]) -> list[str]:
    """Return the line of the hysteresis loop of a path with unloading."""
    if loop is None:
        return []
    unit = f"{units['force']} {units['delta']}".strip()
    area_text = f"hysteresis loop: area {loop.area:.4g} ± {loop.error:.1g} {unit}".rstrip()
    percent_text = f"{100 * loop.area / loop.loading_work:.3g} % of the work of loading"
    range_text = ""
    if loop.end_depth is not None:
        range_text = f", at depths above {loop.end_depth:.4g} {units['delta']}".rstrip()
        range_text += ", where the path ends in contact"
    return [f"{area_text}, {percent_text}{range_text}"]


def warning_lines(outcome: Outcome) -> list[str]:
    """Return the warnings of a run, one line each."""
    return [f"warning: {warning}" for warning in outcome.report.get("warnings", [])]


def _report_section(report: Report, name: str) -> Report:
    """Return a section of a report; empty if the report has no such section."""
    return report.get(name) or {}


def _section_sentence(part: Report) -> list[str]:
    """Return the sentence of a section of a report as a list; empty if it has no sentence."""
    return [words] if (words := part.get("words")) else []


def _largest_pull_lines(report: Report, units: Mapping[str, str]) -> list[str]:
    """Return the line with the pull-off force and the values that theory predicts for it.

    If it was not searched for between the rows, the largest tensile force of a row is given
    instead. `units` maps force and delta to their units.
    """
    largest_pull = report.get("largest_pull")
    if largest_pull is None:
        return []
    from indent_sim.run.summary import expected_pull_offs

    force_text = _quantity_text(largest_pull["force"], units["force"])
    delta_text = _quantity_text(largest_pull["delta"], units["delta"])
    line = f"largest tensile force: {force_text} at delta {delta_text}, step {largest_pull['step']}"
    if pull_off := report.get("pull_off"):
        force_text = _quantity_text(pull_off["force"], units["force"])
        force_text += f" {_error_text(pull_off['error'], units['force'])}"
        delta_text = _quantity_text(pull_off["delta"], units["delta"])
        line = f"pull-off, searched between rows: force {force_text} at delta {delta_text}"
    expected_texts = [
        f"; {words} {_quantity_text(force, units['force'])}"
        for words, force in expected_pull_offs(report)
    ]
    return ["".join([line, *expected_texts])]


def _quantity_text(value: float, unit: str) -> str:
    """Return a number with six digits and its unit; only the number without a unit."""
    return f"{value:.6g} {unit}".rstrip()


def _error_text(error: float | None, unit: str) -> str:
    """Return the error of a number with a unit as a text."""
    return "± an unknown error" if error is None else f"± {error:.2g} {unit}".rstrip()


def _experiment_lines(report: Report, units: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of an experiment: pull-off, events of the cantilever, calibration.

    `units` maps force and delta to their units.
    """

    def place_text(point: Mapping[str, float]) -> str:
        force_text = _quantity_text(point["force"], units["force"])
        return f"force {force_text}, delta {_quantity_text(point['delta'], units['delta'])}"

    adhesion = _report_section(report, "adhesion")
    for control, point in _report_section(adhesion, "pull_off").items():
        words = control.replace("_", " ")
        yield f"pull-off under {words}: {place_text(point)}"
    if "words" in adhesion:
        yield adhesion["words"]
    for event, point in _report_section(report, "cantilever").items():
        if point:
            z_text = _quantity_text(point["z"], units["delta"])
            yield f"{event.replace('_', ' ')} at z {z_text}: {place_text(point)}"
    if "calibration" in report:
        force = report["calibration"]["force"]
        modulus = report["calibration"]["modulus"]
        yield (
            f"calibration: relative uncertainty {force:.3g} of the force, {modulus:.3g} of a "
            "fitted modulus"
        )


def plan_text(planned_run: PlannedRun, width: int = 120) -> str:
    """Return the plan of a run as text: every choice with its reason, and predictions.

    Parameters
    ----------
    planned_run
        Scene with its plan and cost.
    width
        Number of columns of the text.
    """
    from rich.table import Table

    # Rich would interpret brackets in plain strings as markup.
    from rich.text import Text

    plan = planned_run.plan
    title = Text(printable(plan.title)) if plan.title else None
    choices = Table("what", "choice", "why", title=title, title_justify="left", box=None)
    for choice in plan.choices:
        choices.add_row(
            *(Text(printable(word)) for word in (choice.key, _value_text(choice.value), choice.why))
        )
    expected = Table("expected", "", box=None)
    for name, value in plan.prediction.items():
        expected.add_row(*(Text(word) for word in (name.replace("_", " "), _value_text(value))))
    # Labels of the characteristic times of a time-dependent scene.
    time_labels = {
        "way_in": "loading",
        "history": "history",
        "contact": "a^2/D",
        "height": "H^2/D",
        "element": "h_contact^2/D",
        "relaxation": "longest relaxation",
    }
    for name, value in (plan.time.times if plan.time else {}).items():
        expected.add_row(*(Text(word) for word in (time_labels[name], _value_text(value))))
    return _render(width, choices, "", expected)


def requirements_text(requirements: Requirements, width: int = 120) -> str:
    """Return the effects of a scene, largest first, and the recommended scene, as a text.

    `width` is the number of columns of the text.
    """
    from rich.table import Table
    from rich.text import Text

    from indent_sim.config.strict_yaml import dump

    table = Table("effect", "change of the force", "source", "matters", box=None)
    for effect in sorted(
        requirements.effects, key=lambda effect: (effect.max_change == inf, -effect.max_change)
    ):
        if effect.is_possible:
            cells = (
                effect.name.replace("_", " "),
                _effect_text(effect),
                effect.source,
                effect.needs,
            )
            table.add_row(*(Text(printable(cell)) for cell in cells))
    absent_names = ", ".join(
        effect.name.replace("_", " ") for effect in requirements.effects if not effect.is_possible
    )
    absent = f"\nnot in this scene: {absent_names}" if absent_names else ""
    effects_text = f"{_render(width, table)}{absent}"
    return f"{effects_text}\n\n{requirements.words}\n\n{dump(requirements.config)}".rstrip()


def curve_requirements_text(requirements: CurveRequirements, width: int = 120) -> str:
    """Return text on the agreement of a scene and other models with a curve.

    The model requirements of the scene are included.

    `width` is the number of columns of the text.
    """
    from indent_sim.fitting.curve_fit import INTERVAL_KEYS, format_value
    from indent_sim.fitting.inference.model_assessment import Interval

    key = requirements.key
    config = requirements.config
    contradictions = " and ".join(requirements.entry["cause"])

    def model_row(
        name: str, verdict: str, model: Mapping[str, Any], parameters: Mapping[str, float]
    ) -> list[str]:
        interval = Interval(*(model[end] for end in INTERVAL_KEYS))
        value, low, high = (
            format_value(key, config, model[end], interval) for end in INTERVAL_KEYS
        )
        parameter_text = ", ".join(
            f"{parameter} = {format_value(parameter, config, number)}"
            for parameter, number in parameters.items()
        )
        return [name, value, f"{low} to {high}", verdict, parameter_text]

    verdict = f"contradicted by {contradictions}" if contradictions else "explains the curve"
    rows = [
        ["model", key, "95 %", "", ""],
        model_row("the scene's", verdict, vars(requirements.modulus), {}),
    ]
    rows += [
        model_row(model["name"], model["verdict"], model, model["parameters"])
        for model in requirements.models
    ]
    return "\n\n".join(
        [
            requirements.entry["words"],
            _align_columns(rows, "<"),
            requirements_text(requirements.requirements, width),
        ]
    )


def design_text(design: Design) -> str:
    """Return the intervals of the parameters expected from a planned measurement as text.

    The text also tells which parameters are correlated.
    """
    rows = [
        ["", *design.parameters],
        ["scene as given", *_interval_texts(design.parameters, design.config)],
    ]
    for improvement in design.helps:
        change = ", ".join(
            f"{key} = {_value_text(value)}" for key, value in improvement.change.items()
        )
        cells = _interval_texts(improvement.parameters, design.config) or [
            f"not possible: {improvement.reason}"
        ]
        rows.append([change, *cells, *[""] * (len(design.parameters) - len(cells))])
    noise = f"{design.points} points, noise {design.noise:.3g} of a force of {design.force:.4g}"
    return "\n".join(
        [_align_columns(rows, "<"), "", f"{noise} at a depth of {design.depth:.4g}", design.words]
    )


def hardness_text(result: Hardness) -> str:
    """Return hardness, modulus and the other quantities of an indentation test as a table."""
    from indent_sim.run.hardness_analysis import QUANTITIES

    rows = [
        [name, _number_with_error(value, result.errors[name]), result.units[name], meaning]
        for name, (_, meaning) in QUANTITIES.items()
        if (value := result.values[name]) is not None
    ]
    lines = [
        _align_columns(rows, "<"),
        "",
        "The numbers after ± are half-widths of 95 % intervals from the scatter of the samples; "
        "they include neither errors of the area function, the frame compliance and the zero "
        "point, nor the error due to pile-up.",
        *(f"{name}: {words}" for name, words in result.assumptions.items()),
    ]
    if result.truth:
        truth_rows = [["", "formula", "run", "formula/run"]]
        truth_rows += [
            [
                name,
                _value_text(result.values[name]),
                _value_text(truth["value"]),
                f"{truth['ratio']:.4f}",
            ]
            for name, truth in result.truth.items()
        ]
        lines += ["", _align_columns(truth_rows, "<")]
        lines += [result.formula_error] if result.formula_error else []
    return "\n".join(lines)


def calibration_text(calibration: TipCalibration) -> str:
    """Return depths and areas of the curves of a calibration as a table, and the assumptions."""
    unit = calibration.unit
    rows = [["curve", f"h_c [{unit}]", f"A_p [{unit}^2]", "function/A_p"]]
    rows += [
        [name, f"{h:.5g}", f"{A:.5g}", f"{fitted / A:.4f}"]
        for name, h, A, fitted in zip(
            calibration.curves, calibration.h_c, calibration.A_p, calibration.fitted, strict=True
        )
    ]
    return "\n".join(
        [
            _align_columns(rows, "<"),
            "",
            f"A_p = {calibration.formula}, with a scatter of {calibration.scatter:.2%}",
            *(f"{name}: {words}" for name, words in calibration.assumptions.items()),
        ]
    )


def _number_with_error(value: float, error: float | None) -> str:
    """Return a number with the digits that are significant given its error, and the error."""
    # Five digits are shown of a number whose error is unknown or smaller than them.
    if error is None or error < 1e-5 * abs(value):
        return f"{value:.5g}"
    digits = max(2, 2 + math.floor(math.log10(abs(value) / error))) if value else 2
    return f"{value:.{min(digits, 6)}g} ± {error:.1g}"


def _interval_texts(parameters: Mapping[str, Interval], config: Config) -> list[str]:
    """Return intervals with their units, and half widths in per cent."""
    from indent_sim.fitting.curve_fit import format_value

    def interval_text(key: str, interval: Interval) -> str:
        # A parameter is not determined if the upper end of its interval is at least this multiple
        # of the lower end.
        unknown_ratio = 100.0
        # The lower end of an interval may be zero.
        if not interval.high < unknown_ratio * max(interval.low, 1e-300):
            return "not determined"
        half_width_text = ""
        if interval.value:
            percent = 50 * (interval.high - interval.low) / interval.value
            half_width_text = f" (±{percent:.2g} %)"
        low_text = format_value(key, config, interval.low, interval)
        high_text = format_value(key, config, interval.high, interval)
        return f"{low_text} to {high_text}{half_width_text}"

    return [interval_text(key, interval) for key, interval in parameters.items()]


def _effect_text(effect: Effect) -> str:
    """Return the effect on the force as a number or a range."""
    if effect.low is None or effect.high is None:
        return "" if effect.needs else "not known"
    range_text = f"{_percent_text(effect.low)} to {_percent_text(effect.high)} %"
    if effect.percent is None:
        return range_text
    percent_text = f"{_percent_text(effect.percent)} %"
    return f"{percent_text} ({range_text})" if effect.low < effect.high else percent_text


def _percent_text(percent: float) -> str:
    """Return a percentage, as a whole number if it is large."""
    # Percentages from this one on are printed as whole numbers, without an exponent.
    whole_percent = 99.5
    return f"{percent:+.2g}" if abs(percent) < whole_percent else f"{percent:+.0f}"


def study_plan_text(planned: StudyPlan) -> str:
    """Return the runs of a study, one line each, and their total cost."""
    names = ["index", *planned.keys, "method", "force", "dofs", "memory_MB", "seconds", "warnings"]
    # The texts of the warnings are in the output of --json.
    counted_rows = [row | {"warnings": len(row["warnings"])} for row in planned.rows]
    rows = [
        ["" if row[name] is None else _value_text(row[name]) for name in names]
        for row in counted_rows
    ]
    lines = [
        _align_columns([names, *rows]),
        "",
        f"{len(rows)} runs, compared with {planned.compared_with}",
    ]
    if planned.point_count:
        lines[-1] = f"these are the first of {planned.point_count} runs without result folders"
    if planned.same:
        lines[-1] += f"; {planned.same} points have the same scene as another point"
    lines.append(
        f"about {planned.seconds:.2g} s of processor time; --jobs N performs N runs at the same "
        "time"
    )
    title_lines = [printable(planned.title)] if planned.title else []
    return "\n".join([*title_lines, *lines, *planned.refused])


def scoreboard_text(rows: Sequence[Report]) -> str:
    """Return lines with published, exact and computed values, and which of them are wrong."""
    from indent_sim.studies.reference.scoreboard import verdict_text

    names = ("published", "exact", "ours", "our_error")
    heads = [name.replace("_", " ") for name in names]
    lines = [["case", "", *heads, "difference", "wrong value"]]
    for row in rows:
        numbers = ["" if row[name] is None else _value_text(row[name]) for name in names]
        difference_text = (
            "" if row["difference"] is None else f"{round(row['difference'], 6):+.3g} %"
        )
        lines.append([row["case"], row["quantity"], *numbers, difference_text, verdict_text(row)])
    return _align_columns(lines, "<")


def comparison_text(comparison: Comparison) -> str:
    """Return a table of two results, and the largest relative difference of every column."""
    names = list(comparison.pairs)
    head = [comparison.matched_by, *(f"{name} {side}" for name in names for side in "AB")]
    rows = [
        [
            f"{step:.10g}",
            *(f"{value:.10g}" for name in names for value in comparison.pairs[name][i]),
        ]
        for i, step in enumerate(comparison.row_keys)
    ]
    other_table_lines = [
        f"{name}, {len(table.row_keys)} rows: {_worst_difference_text(table)}"
        for name, table in comparison.other_tables.items()
    ]
    return "\n".join(
        [
            _align_columns([head, *rows]),
            _worst_difference_text(comparison),
            *_interpolation_lines(comparison),
            *other_table_lines,
        ]
    )


def _interpolation_lines(comparison: Comparison) -> list[str]:
    """Return lines on the interpolated result, its error, and the force differences."""
    if comparison.interpolation is None:
        return []
    path, error = comparison.interpolation
    abscissa = "time" if comparison.matched_by == "t" else "depth"
    error_text = f"with an error of {100 * error:.2g} % of the largest force"
    lines = [f"{path} interpolated in {abscissa}, {error_text}"]
    if residual := comparison.residual:
        largest = residual["percent_largest"]
        rms = residual["percent_rms"]
        lines.append(
            f"forces differ by at most {largest:.3g} % of the largest force, by {rms:.3g} % rms"
        )
    return lines


def _worst_difference_text(comparison: Comparison) -> str:
    """Return the largest relative difference of every compared column."""
    columns = ", ".join(
        f"{name} {value:.3g}" for name, value in comparison.max_relative_difference.items()
    )
    return f"largest relative difference: {columns or 'no column compared'}"


def section_text(section: str) -> str:
    """Return the alternatives of a section of the scene file with parameters and units."""
    from indent_sim.config.json_schema import section_alternatives

    lines = []
    for choice, summary, keys in section_alternatives(section):
        lines.append(f"  {choice}: {summary}")
        if keys:
            rows = [[f"      {name}", *columns] for name, *columns in keys]
            lines.append(_align_columns(rows, "<"))
    return "\n".join(lines)


def _log_progress(
    print_line: Callable[[str], None],
    row: str,
    iterations: str,
    step: int,
    total: int,
    estimate: ProgressEstimate,
) -> None:
    """Print a line of a log with the time of the step and the time left."""
    # Largest number of progress lines in a log.
    max_log_lines = 200
    # The interval is rounded up.
    interval = -(-total // max_log_lines)
    step_seconds, remaining_text = estimate.record_step(total - step)
    if step % interval == 0 or step in (1, total):
        seconds = f"{step_seconds:.1f} s"
        print_line(
            f"step {step}/{total}  {row}  {iterations}  {seconds}  {remaining_text}".rstrip()
        )


def _error_estimate_lines(outcome: Outcome) -> list[str]:
    """Return a line with the largest relative error estimate of the force."""
    states_with_error = (state for state in outcome.states if state.force_error and state.force)
    relative_errors = [
        ((state.force_error or 0.0) / abs(state.force), state.step) for state in states_with_error
    ]
    if not relative_errors:
        return []
    largest, step = max(relative_errors)
    return [f"estimated relative error of the force: at most {largest:.2g} (step {step})"]


def _computed_quantity_name(report: Report, theory: Report) -> str:
    """Return the name of the quantity that theory computed; in plane strain a force per length."""
    from indent_sim.results.json_text import json_data
    from indent_sim.results.pictures.axes import plan_choice

    _, computed = _prescribed_and_computed(theory)
    plan = json_data(_report_section(report, "plan"))
    is_flat = plan_choice({"plan": plan}, "kinematics") == "plane_strain"
    return "force per length" if computed == "force" and is_flat else computed


def _theory_line(theory: Report, quantity: str) -> str:
    """Return a line with the value of `quantity` by theory, and the run's deviation from it."""
    exactness = "exact for this body" if theory.get("exact") else theory.get("why", "")
    prescribed, computed = _prescribed_and_computed(theory)
    deviation = f"{theory[f'{computed}_deviation']:+.3%}"
    run_text = f"{quantity} {theory[computed]:.6g}; this run {deviation} ({exactness})"
    return f"{theory['name']} at {prescribed} {theory[prescribed]:.6g}: {run_text}"


def _prescribed_and_computed(theory: Report) -> tuple[str, str]:
    """Return the names of the prescribed quantity and of the quantity that theory computed."""
    return ("force", "delta") if "delta_deviation" in theory else ("delta", "force")


def _value_text(value: Any) -> str:
    """Return a value as a text, a float with six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _align_columns(rows: list[list[str]], side: str = ">") -> str:
    """Return rows of cells as lines with columns of equal width, aligned to a side (< or >)."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(f"{cell:{side}{width}}" for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


def _render(width: int, *parts: Any) -> str:
    """Return tables and texts of the package rich as one text of the given width."""
    from rich.console import Console

    text = io.StringIO()
    console = Console(
        file=text, width=width, force_terminal=sys.stdout.isatty(), highlight=False, emoji=False
    )
    for part in parts:
        console.print(part)
    return "\n".join(line.rstrip() for line in text.getvalue().rstrip().splitlines())


def row_counts_text(counts: Mapping[str, int]) -> str:
    """Return the numbers of rows of a study by their status."""
    parts = [f"{counts['done']} of {counts['total']} runs done"]
    parts += [f"{counts[name]} {name}" for name in ("failed", "pending") if counts[name]]
    if counts["left_out"]:
        parts.append(f"{counts['left_out']} points left out by `where`")
    return ", ".join(parts)
