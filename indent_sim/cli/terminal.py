"""Text for a terminal: progress, plans, comparisons and lists."""

from __future__ import annotations

import io
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
    from indent_sim.run.model_selection.effects import Effect
    from indent_sim.run.model_selection.recommended_model import Requirements
    from indent_sim.run.planned_run import PlannedRun
    from indent_sim.run.simulate import Outcome
    from indent_sim.run.single_run import Progress
    from indent_sim.run.summary import HysteresisLoop
    from indent_sim.studies import StudyPlan

TIMES_IN_WORDS = {  # of a scene that is followed in time, in words
    "way_in": "way in",
    "history": "history",
    "contact": "a^2/D",
    "height": "H^2/D",
    "element": "h_contact^2/D",
    "relaxation": "longest relaxation",
}
NOT_KNOWN = 100.0  # high over low, from which on an interval says nothing
WHOLE = 99.5  # per cent, from which on they are said without powers of ten
LINES = 200  # most progress lines in a log

Report = dict[str, Any]  # of a run, or a part of one


@contextmanager
def progress(tell: Callable[[str], None], config: Config) -> Iterator[Progress]:
    """A function to call with every state: a bar on a terminal, plain lines in a log (stderr)."""
    pace = ProgressEstimate()
    is_flat = "plane_strain" in (config.mesh.symmetry, getattr(config.body, "kinematics", ""))
    units = _units_of_rows(vars(config.units), is_flat or config.body.shape == "strip")
    if not sys.stderr.isatty():
        yield lambda state, step, total: _log(
            tell, state.summary(units), f"{state.newton_iterations} iterations", step, total, pace
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
            description=f"{state.summary(units)}  {pace.record_step(total - step)[1]}",
        )


def _units_of_rows(units: Mapping[str, str], is_flat: bool) -> dict[str, str]:
    """The units of time, depth, force and contact radius, as far as the scene has units; in plane
    strain forces are per length.
    """
    length = units.get("length", "")
    force = units.get("force", "")
    line = f"{force}/{length}" if is_flat and force and length else force
    return {"t": "s" if length else "", "delta": length, "a": length, "force": line}


def conclusion(outcome: Outcome) -> list[str]:
    """The last lines of a run: theory beside it, the picture, the warnings, and the row that it was
    made for.
    """
    report = outcome.report
    theory = _part(outcome.report, "theory")
    lines = []
    rows = len(outcome.states)
    before = outcome.resumed_after
    if before:
        some = f"resumed: {before} of the {rows} rows were there"
        lines.append(
            f"nothing left to compute: all {rows} rows were there" if before == rows else some
        )
    lines += _error(outcome)
    if theory:
        told = _theory(theory, _asked_in_words(report, theory))
        lines.append(
            told if report.get("method") != "theory" else f"solved by theory: {theory['why']}"
        )
    if closed := theory.get("half_space"):
        side = "below" if closed["deviation"] < 0 else "above"
        given, asked = _given_and_asked(theory)
        beside = f"{asked} {closed[asked]:.6g}, {abs(closed['deviation']):.2%} {side} this run"
        lines.append(f"{closed['name']}, half-space, at {given} {theory[given]:.6g}: {beside}")
    if theory.get("formulas"):
        given, asked = _given_and_asked(theory)
        said = (
            f"{one['name']} {one[asked]:.6g} ({one['deviation']:+.3%})"
            for one in theory["formulas"]
        )
        kind = "block" if theory["name"].endswith("compression") else "film"
        lines.append(f"{kind} formulas at {given} {theory[given]:.6g}: {asked} {', '.join(said)}")
    if fit := report.get("hertz"):
        read = f"{fit['percent']:+.3g} %{fit.get('against', '')}"
        lines.append(f"a Hertz fit of this curve reads E = {fit['E']:.4g} ({read})")
    lines += _words(_part(report, "stick"))
    lines += [*_largest_pull(_part(report, "adhesion")), *_experiment(_part(report, "experiment"))]
    if "time" in report:
        lines.append(f"in time by {report['time']['method']}: {report['time']['why']}")
    pictures = (outcome.directory / name for name in ("force_indentation.png", "experiment.png"))
    lines += [f"picture: {picture}" for picture in pictures if picture.exists()]
    return lines + warnings(outcome) + _answer(outcome)


def _answer(outcome: Outcome) -> list[str]:
    """What a run was made for: its last row, of a path that goes back or lasts also its loop and
    its largest force.
    """
    from indent_sim.run.summary import hysteresis_loop, row_of_interest

    states = outcome.states
    report = outcome.report
    if not states:
        return []
    units = _units_of_rows(_entries(report.get("units") or {}), _is_flat(report))
    last = f"step {states[-1].step}: {states[-1].summary(units)}"
    top = row_of_interest(states, report.get("control") == "force")
    if top is states[-1]:
        return [last]
    loses_work = (
        any(state.t is not None or state.dissipation for state in states) or "adhesion" in report
    )
    loop = (
        hysteresis_loop(states) if loses_work else None
    )  # an elastic body comes back along the way in
    return [last, *_loop(loop, units), f"largest force, step {top.step}: {top.summary(units)}"]


def _is_flat(report: Report) -> bool:
    """Whether forces are per length."""
    choices = map(_entries, _part(report, "plan").get("choices") or [])
    return any(one["key"] == "kinematics" and one["value"] == "plane_strain" for one in choices)


def _entries(part: Any) -> Mapping[str, Any]:
    """A part of a report as a mapping: of a run that was there before it was read from run.json."""
    return part if isinstance(part, Mapping) else vars(part)


def _loop(found: HysteresisLoop | None, units: Mapping[str, str]) -> list[str]:
    """The loop of a path that comes back, in words."""
    if found is None:
        return []
    unit = f"{units['force']} {units['delta']}".strip()
    said = f"loop of force over depth: area {found.area:.4g} ± {found.error:.1g} {unit}".rstrip()
    open_end = "" if found.is_closed else ", not closed: the tip still pushes"
    return [f"{said}, {100 * found.area / found.way_in:.3g} % of the work of the way in{open_end}"]


def warnings(outcome: Outcome) -> list[str]:
    """What a run warns of, a line each."""
    return [f"warning: {warning}" for warning in outcome.report.get("warnings", [])]


def _part(report: Report, name: str) -> Report:
    """A section of a report, empty where there is none."""
    return report.get(name) or {}


def _words(part: Report) -> list[str]:
    """The sentence that a part of a report has of itself, if it has one."""
    return [words] if (words := part.get("words")) else []


def _largest_pull(report: Report) -> list[str]:
    """The pull-off, or where that is not known the largest pull of the rows; and what is known of
    it beforehand.
    """
    pulled = report.get("largest_pull")
    if pulled is None:
        return []
    from indent_sim.run.summary import expected_pull_offs

    line = (
        f"largest pull: force {pulled['force']:.6g} at delta {pulled['delta']:.6g}, step "
        f"{pulled['step']}"
    )
    if found := report.get("pull_off"):
        force = f"force {found['force']:.6g} {_within(found['error'])}"
        line = f"pull-off, searched between rows: {force} at delta {found['delta']:.6g}"
    beside = [f"; {words} {force:.6g}" for words, force in expected_pull_offs(report)]
    return ["".join([line, *beside])]


def _within(error: float | None) -> str:
    """An error behind a number, in words."""
    return "± an unknown error" if error is None else f"± {error:.2g}"


def _experiment(report: Report) -> Iterator[str]:
    """What an experiment came to: where the tip comes off, and how the history was followed."""
    for how, found in _part(_part(report, "adhesion"), "pull_off").items():
        words = how.replace("_", " ")
        yield f"pull-off under {words}: force {found['force']:.6g} at delta {found['delta']:.6g}"
    for when, found in _part(report, "cantilever").items():
        if found:
            said = f"force {found['force']:.6g}, delta {found['delta']:.6g}"
            yield f"{when.replace('_', ' ')} at z {found['z']:.6g}: {said}"
    if "calibration" in report:
        force = report["calibration"]["force"]
        modulus = report["calibration"]["modulus"]
        yield (
            f"calibration: the force is known to {force:.3g} of it, a fitted modulus to "
            f"{modulus:.3g}"
        )


def plan(prospect: PlannedRun, width: int = 120) -> str:
    """The plan of a run: every choice with its reason, and what to expect."""
    from rich.table import Table
    from rich.text import Text  # rather than words, in which brackets are markup

    planned = prospect.plan
    title = Text(printable(planned.title)) if planned.title else None
    choices = Table("what", "choice", "why", title=title, title_justify="left", box=None)
    for choice in planned.choices:
        choices.add_row(
            *(Text(printable(word)) for word in (choice.key, _shown(choice.value), choice.why))
        )
    expected = Table("expected", "", box=None)
    for name, value in planned.prediction.items():
        expected.add_row(*(Text(word) for word in (name.replace("_", " "), _shown(value))))
    for name, value in (planned.time.times if planned.time else {}).items():
        expected.add_row(*(Text(word) for word in (TIMES_IN_WORDS[name], _shown(value))))
    return _rendered(width, choices, "", expected)


def requirements(found: Requirements, width: int = 120) -> str:
    """What a scene requires: its effects by their size, what to model, and that model as a scene."""
    from rich.table import Table
    from rich.text import Text

    from indent_sim.config.strict_yaml import dump

    table = Table("effect", "of the force", "from", "matters", box=None)
    for effect in sorted(
        found.effects, key=lambda effect: (effect.max_change == inf, -effect.max_change)
    ):
        if effect.is_possible:
            words = (effect.name.replace("_", " "), _change(effect), effect.source, effect.needs)
            table.add_row(*(Text(printable(word)) for word in words))
    rest = ", ".join(
        effect.name.replace("_", " ") for effect in found.effects if not effect.is_possible
    )
    absent = f"\nnot in this scene: {rest}" if rest else ""
    return f"{_rendered(width, table)}{absent}\n\n{found.words}\n\n{dump(found.config)}".rstrip()


def curve_requirements(found: CurveRequirements, width: int = 120) -> str:
    """What a curve says of the scene and of other models beside it, and what the scene requires at
    its depth.
    """
    from indent_sim.fitting.curve_fit import INTERVAL_KEYS, format_value
    from indent_sim.fitting.inference.model_assessment import Interval

    key = found.key
    config = found.config
    against = " and ".join(found.entry["cause"])

    def row(
        name: str, verdict: str, one: Mapping[str, Any], added: Mapping[str, float]
    ) -> list[str]:
        stated = Interval(*(one[end] for end in INTERVAL_KEYS))
        value, low, high = (format_value(key, config, one[end], stated) for end in INTERVAL_KEYS)
        beside = ", ".join(
            f"{other} = {format_value(other, config, number)}" for other, number in added.items()
        )
        return [name, value, f"{low} to {high}", verdict, beside]

    verdict = f"contradicted by {against}" if against else "explains the curve"
    rows = [["model", key, "95 %", "", ""], row("the scene's", verdict, vars(found.modulus), {})]
    rows += [row(one["name"], one["verdict"], one, one["parameters"]) for one in found.models]
    return "\n\n".join(
        [found.entry["words"], _aligned(rows, "<"), requirements(found.requirements, width)]
    )


def design(found: Design) -> str:
    """What a measurement would tell: its intervals as the scene stands and with every change, and
    what is tied.
    """
    rows = [["", *found.parameters], ["as it stands", *_intervals(found.parameters, found.config)]]
    for one in found.helps:
        change = ", ".join(f"{key} = {_shown(value)}" for key, value in one.change.items())
        told = _intervals(one.parameters, found.config) or [f"cannot be: {one.reason}"]
        rows.append([change, *told, *[""] * (len(found.parameters) - len(told))])
    noise = f"{found.points} points, noise {found.noise:.3g} of a force of {found.force:.4g}"
    return "\n".join(
        [_aligned(rows, "<"), "", f"{noise} at a depth of {found.depth:.4g}", found.words]
    )


def _intervals(parameters: Mapping[str, Interval], config: Config) -> list[str]:
    """Intervals with their units, and half widths in per cent."""
    from indent_sim.fitting.curve_fit import format_value

    def told(key: str, one: Interval) -> str:
        if not one.high < NOT_KNOWN * max(one.low, 1e-300):
            return "not known"
        half = f" (±{50 * (one.high - one.low) / one.value:.2g} %)" if one.value else ""
        return f"{format_value(key, config, one.low, one)} to {format_value(key, config, one.high, one)}{half}"

    return [told(key, one) for key, one in parameters.items()]


def _change(effect: Effect) -> str:
    """What an effect does to the force, as a number or a range."""
    if effect.low is None or effect.high is None:
        return "" if effect.needs else "not known"
    between = f"{_signed(effect.low)} to {_signed(effect.high)} %"
    if effect.percent is None:
        return between
    return f"{_signed(effect.percent)} %" + (f" ({between})" if effect.low < effect.high else "")


def _signed(percent: float) -> str:
    return f"{percent:+.2g}" if abs(percent) < WHOLE else f"{percent:+.0f}"


def study_plan(planned: StudyPlan) -> str:
    """The runs of a study, a line each, and what they cost together."""
    names = ["index", *planned.keys, "method", "force", "dofs", "memory_MB", "seconds", "warnings"]
    counted = [
        row | {"warnings": len(row["warnings"])} for row in planned.rows
    ]  # --json has their words
    rows = [["" if row[name] is None else _shown(row[name]) for name in names] for row in counted]
    lines = [
        _aligned([names, *rows]),
        "",
        f"{len(rows)} runs, compared with {planned.compared_with}",
    ]
    if planned.same:
        lines[-1] += f"; {planned.same} points ask for the same as another"
    lines.append(
        f"about {planned.seconds:.2g} s of the processor, one after another; --jobs N "
        "does N at a time"
    )
    return "\n".join(
        [*([printable(planned.title)] if planned.title else []), *lines, *planned.refused]
    )


def scoreboard(rows: Sequence[Report]) -> str:
    """Published values beside exact ones and ours, a line each, and who is off by more than is
    claimed.
    """
    from indent_sim.studies.reference.scoreboard import verdict_text

    names = ("published", "exact", "ours", "our_error")
    head = ["case", "", *(name.replace("_", " ") for name in names), "difference", "who is wrong"]
    lines = [head]
    for row in rows:
        numbers = ["" if row[name] is None else _shown(row[name]) for name in names]
        apart = "" if row["difference"] is None else f"{round(row['difference'], 6):+.3g} %"
        lines.append([row["case"], row["quantity"], *numbers, apart, verdict_text(row)])
    return _aligned(lines, "<")


def comparison(found: Comparison) -> str:
    """Two results side by side, row by row, and the largest relative difference of every column."""
    names = list(found.pairs)
    head = [found.matched_by, *(f"{name} {side}" for name in names for side in "AB")]
    rows = [
        [f"{step:.10g}", *(f"{value:.10g}" for name in names for value in found.pairs[name][i])]
        for i, step in enumerate(found.row_keys)
    ]
    beside = [
        f"{name}, {len(table.row_keys)} rows: {_worst(table)}"
        for name, table in found.other_tables.items()
    ]
    return "\n".join([_aligned([head, *rows]), _worst(found), *_interpolated(found), *beside])


def _interpolated(found: Comparison) -> list[str]:
    """Which of the two was interpolated, what that costs, and how far the forces lie apart."""
    if found.interpolation is None:
        return []
    path, error = found.interpolation
    along = "time" if found.matched_by == "t" else "depth"
    said = [f"{path} interpolated in {along}, to {100 * error:.2g} % of the largest force"]
    if apart := found.residual:
        largest = apart["percent_largest"]
        rms = apart["percent_rms"]
        said.append(f"forces apart by {largest:.3g} % of the largest at most, {rms:.3g} % rms")
    return said


def _worst(found: Comparison) -> str:
    columns = ", ".join(
        f"{name} {value:.3g}" for name, value in found.max_relative_difference.items()
    )
    return f"largest relative difference: {columns or 'no column compared'}"


def listed(section: str) -> str:
    """What may stand in a section of the scene file: names, first lines of docs, parameters, units."""
    from indent_sim.config.json_schema import section_alternatives

    lines = []
    for choice, words, keys in section_alternatives(section):
        rows = [[f"      {name}", *rest] for name, *rest in keys]
        lines += [f"  {choice}: {words}", *([_aligned(rows, "<")] if rows else [])]
    return "\n".join(lines)


def _log(
    tell: Callable[[str], None],
    row: str,
    effort: str,
    step: int,
    total: int,
    pace: ProgressEstimate,
) -> None:
    """A line with the step's own time, and what is left."""
    every = -(-total // LINES)
    (own, left) = pace.record_step(total - step)
    if step % every == 0 or step in (1, total):
        tell(f"step {step}/{total}  {row}  {effort}  {own:.1f} s  {left}".rstrip())


def _error(outcome: Outcome) -> list[str]:
    """The widest error bar, relative to its force."""
    known = (state for state in outcome.states if state.force_error and state.force)
    bars = [((state.force_error or 0.0) / abs(state.force), state.step) for state in known]
    worst, step = max(bars, default=(0.0, 0))
    return (
        [f"estimated error of the force: at most {worst:.2g} of it (step {step})"] if bars else []
    )


def _asked_in_words(report: Report, theory: Report) -> str:
    """What theory was asked for, in words; of a strip the force is one per length."""
    from indent_sim.results.pictures.axes import plan_choice
    from indent_sim.results.writer import json_data

    _, asked = _given_and_asked(theory)
    is_flat = (
        plan_choice({"plan": json_data(_part(report, "plan"))}, "kinematics") == "plane_strain"
    )
    return "force per length" if asked == "force" and is_flat else asked


def _theory(theory: Report, words: str) -> str:
    exact = "exact for this body" if theory.get("exact") else theory.get("why", "")
    given, asked = _given_and_asked(theory)
    beside = f"{words} {theory[asked]:.6g}; this run {theory[f'{asked}_deviation']:+.3%} ({exact})"
    return f"{theory['name']} at {given} {theory[given]:.6g}: {beside}"


def _given_and_asked(theory: Report) -> tuple[str, str]:
    """What the path prescribes, and what theory was asked for beside the run."""
    return ("force", "delta") if "delta_deviation" in theory else ("delta", "force")


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _aligned(rows: list[list[str]], side: str = ">") -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(f"{cell:{side}{width}}" for cell, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


def _rendered(width: int, *parts: Any) -> str:
    from rich.console import Console

    text = io.StringIO()
    console = Console(
        file=text, width=width, force_terminal=sys.stdout.isatty(), highlight=False, emoji=False
    )
    for part in parts:
        console.print(part)
    return "\n".join(line.rstrip() for line in text.getvalue().rstrip().splitlines())
