"""The command line: the only place that ends the process or names COMM_WORLD.

stdout carries the result, everything else goes to stderr; under MPI rank 0 alone speaks and all
ranks end with the same exit code. Heavy imports wait inside the commands.
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import click

from indent_sim.cli import terminal
from indent_sim.process import errors
from indent_sim.process.errors import ConfigError, IndentSimError, UsageError, printable
from indent_sim.process.limits import require_resources, translate_resource_errors, write_error
from indent_sim.process.ranks import FailureConsensus, SerialComm
from indent_sim.process.signals import raise_on_signals, raise_pending_signal
from indent_sim.process.version import VERSION

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.fitting.fit_folder import CurveFits, ReadOptions
    from indent_sim.results.reader import Results
    from indent_sim.run.pipeline import Outcome

OutputFormat = Literal["text", "json"]  # of what stdout gets
Verbosity = Literal["all", "warnings"]  # on stderr
LOG_LEVELS = {"all": logging.INFO, "warnings": logging.WARNING}  # of our own messages
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)  # more only slow these sizes down
LISTED_SECTIONS = {
    "materials": "material",
    "indenters": "indenter",
    "contact": "contact",
    "bodies": "body",
}
TEMPLATES = ("cell", "gel", "film", "nanoindentation", "rubber", "study")
SCHEMA_FILE = "scene.schema.json"  # beside a scene of `init`, whose first line names it
ROWS_WITHOUT_GC = 50  # rows of a run, before there is garbage to speak of
# in click's context: json where --json was given, also where the command refuses it
FORMAT_KEY = "indent_sim.form"


class Program(click.Group):
    """Command group that turns every end of the program into a message and an exit code."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Set one BLAS thread and no pydantic plugins, unless the environment sets them.

        This has to happen before numpy and pydantic are imported; pydantic would search every
        installed package for plugins.
        """
        for name in (*THREAD_VARIABLES, "PYDANTIC_DISABLE_PLUGINS"):
            os.environ.setdefault(name, "1")
        _open_closed_streams()
        return super().main(*args, **options)

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> click.Context:
        """Read the options before the command."""
        form: OutputFormat = (
            "json" if "--json" in (args[: args.index("--")] if "--" in args else args) else "text"
        )
        try:
            ctx = super().make_context(info_name, args, *rest, **extra)
        except click.ClickException as error:
            exit_with_usage_error(error, form)
        ctx.meta[FORMAT_KEY] = form
        return ctx

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; expected failures print a message, others a traceback."""
        try:
            if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
                signal.signal(signal.SIGINT, signal.default_int_handler)
            with translate_resource_errors():
                return super().invoke(ctx)
        except click.ClickException as error:
            exit_with_usage_error(error, ctx.meta[FORMAT_KEY])
        except (click.exceptions.Exit, click.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            ctx.exit(report_failure(error))


def _open_closed_streams() -> None:
    """Open /dev/null for each of stdin, stdout and stderr that is closed.

    Libraries need all three.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def exit_with_usage_error(error: click.ClickException, form: OutputFormat) -> NoReturn:
    """Exit like click after an invalid option, with a JSON object if one was requested."""
    if form == "json":
        print_failure(error, error.exit_code, UsageError.__name__)
    error.show()
    raise click.exceptions.Exit(error.exit_code) from error


def report_failure(error: BaseException) -> int:
    """Print the failure to stderr and, with --json, to stdout; return the exit code."""
    code = getattr(error, "exit_code", 130 if isinstance(error, KeyboardInterrupt) else 1)
    if isinstance(error, KeyboardInterrupt):
        print_stderr(str(error) or "interrupted")
    elif isinstance(error, IndentSimError):
        print_stderr(str(error) if isinstance(error, ConfigError) else f"error: {error}")
    else:
        trace = "".join(traceback.format_exception(error))
        print_stderr(
            f"{trace}this is a bug in indent-sim; please report it with the traceback above"
        )
    ctx = click.get_current_context(silent=True)
    if ctx is not None and ctx.meta.get(FORMAT_KEY) == "json":
        print_failure(error, code, type(error).__name__)
    return int(code)


def print_json(value: Any) -> None:
    """Print as JSON to stdout."""
    from indent_sim.results.json_text import to_json

    print_stdout(to_json(value))


def print_done(entries: dict[str, Any]) -> None:
    """Print the JSON object of a command that succeeded."""
    print_json({"status": "done", "exit_code": 0} | entries)


def print_failure(error: BaseException, code: int, kind: str) -> None:
    """Print the JSON object of a command that failed, with its partial result if there is one."""
    status = "interrupted" if code > 128 else "failed"
    failure = {
        "status": status,
        "exit_code": code,
        "error": error_as_json(error, kind),
        **getattr(error, "partial_result", {}),
    }
    if isinstance(error, errors.ConfigErrors):
        failure["errors"] = [error_as_json(part, kind) for part in error.errors]
    with suppress(errors.NotConverged):  # a full disk: the exit code tells
        print_json(failure)


def error_as_json(error: BaseException, kind: str) -> dict[str, Any]:
    """Return an error as JSON: type, message, and where known position and remedy."""
    message = error.format_message() if isinstance(error, click.ClickException) else str(error)
    location: dict[str, Any] = dict.fromkeys(("file", "line", "key", "remedy"))
    if isinstance(error, ConfigError | UsageError):
        message = printable(error.problem)
        location = {name: getattr(error, name, None) or None for name in location}
    return {
        "type": kind.removesuffix("s") if kind == "ConfigErrors" else kind,
        "message": message,
        **location,
    }


def print_stdout(text: str) -> None:
    """Print to stdout; a closed pipe is no error, a full disk is one."""
    try:
        with suppress(UnicodeEncodeError):
            return click.echo(text)
        click.echo(os.fsencode(text))  # the name of a folder may be any bytes
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            raise errors.NotConverged(
                f"cannot write to stdout: {error.strerror or error}"
            ) from error


def print_stderr(text: str) -> None:
    """Print to stderr; that nobody listens any more, or that it fills a disk, is no error.

    File names and titles are in it: what would control the terminal is shown, not sent.
    """
    try:
        click.echo(printable(text, line_breaks=True), err=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


class NumberInRange(click.FloatRange):
    """Number in a range; NaN is in none."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number of a text."""
        number: float = super().convert(value, param, ctx)
        return number if number == number else self.fail(f"'{value}' is not a number.", param, ctx)


PATH = click.Path(path_type=Path)
FRACTION = NumberInRange(0, 1, min_open=True, max_open=True)
OVERWRITE_HELP = (
    "Replace what the folder holds: another CONFIG's run, or a finished run of another scene."
)
SET_HELP = "Replace one key, e.g. contact.method=penalty."


def _complete_keys(ctx: click.Context, option: click.Parameter, typed_text: str) -> list[str]:
    """Return the keys of a scene that begin with the typed text, for completion in a shell."""
    from indent_sim.config.schema import file_order, sections

    kinds = sections()
    keys = {
        f"{section}.{name}="
        for section in kinds
        for kind in kinds[section]
        for name in file_order(kind)
    }
    return sorted(key for key in keys if key.startswith(typed_text))


def _complete_fields(ctx: click.Context, option: click.Parameter, typed_text: str) -> list[str]:
    """Return field names that complete the text after its last comma."""
    from indent_sim.results.pictures.fields import FIELDS

    before, comma, word = typed_text.rpartition(",")
    return [f"{before}{comma}{name}" for name in FIELDS if name.startswith(word)]


SET_ATTRIBUTES: dict[str, Any] = {
    "multiple": True,
    "metavar": "KEY=VALUE",
    "shell_complete": _complete_keys,
    "help": SET_HELP,
}
set_option = click.option("--set", "overrides", **SET_ATTRIBUTES)


def _parse_shard(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return I/N as two numbers."""
    if text is None:
        return None
    index, slash, count = text.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise click.BadParameter(f"'{text}' is not I/N with 1 <= I <= N, for example 2/8")
    return int(index), int(count)


def _parse_words(ctx: click.Context, option: click.Parameter, text: str | None) -> tuple[str, ...]:
    """Return words separated by commas."""
    words = tuple(word.strip() for word in (text or "").split(",")) if text is not None else ()
    if not all(words):
        raise click.BadParameter(f"'{text}' holds an empty word")
    return words


def _parse_pairs(ctx: click.Context, option: click.Parameter, text: str | None) -> dict[str, str]:
    """Return NAME=VALUE pairs separated by commas."""
    pairs = [word.partition("=") for word in _parse_words(ctx, option, text)]
    if wrong := next(
        (name for name, equals, value in pairs if not (name.strip() and equals and value.strip())),
        None,
    ):
        raise click.BadParameter(f"'{wrong}' is not NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _parse_layout(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return ROWSxCOLUMNS as two numbers."""
    if text is None:
        return None
    rows, x, columns = text.lower().partition("x")
    if not (x and rows.isdecimal() and columns.isdecimal() and int(rows) and int(columns)):
        raise click.BadParameter(f"'{text}' is not ROWSxCOLUMNS, for example 1x3")
    return int(rows), int(columns)


def _parse_limits(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """Return A:B as two numbers."""
    if text is None:
        return None
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise click.BadParameter(f"'{text}' is not A:B, for example 0:250") from None
    return low, high


def _parse_zoom(ctx: click.Context, option: click.Parameter, text: str | None) -> float | None:
    """Return the zoom in contact radii; infinity for "all"."""
    try:
        radii = None if text is None else float("inf") if text == "all" else float(text)
    except ValueError:
        radii = -1.0
    if radii is not None and not radii > 0:
        raise click.BadParameter(f"'{text}' is neither a number > 0 nor all")
    return radii


def _parse_tolerances(ctx: click.Context, option: click.Parameter, text: str) -> dict[str, float]:
    """Return tolerances by column: X for all, under "", and COLUMN=X for one."""
    tolerances: dict[str, float] = {}
    for word in _parse_words(ctx, option, text):
        name, _, value = word.rpartition("=")
        try:
            tolerances[name.strip()] = tolerance = float(value)
        except ValueError:
            raise click.BadParameter(f"'{word}' is not a number, nor COLUMN=NUMBER") from None
        if not 0 <= tolerance <= 1:
            raise click.BadParameter(f"'{word}' is not in the range from 0 to 1")
    return tolerances


WHAT_HELP = (
    "Panels, with commas: force, time, pressure, pressure_x, pressure_y, profile, "
    "fields, film; of a study one of "
    "curves, force, a, p_max, penetration."
)
LIMITS_HELP = "Ends of the colours of a field, and of pressures, in the unit shown."
SEGMENTS = ("approach", "hold", "retract", "all")  # of a measured curve
SEGMENT_HELP = "Part of the curve; hold: up to its end."
DESIGN_HELP = (
    "Before a measurement: what a curve of this scene would tell of the keys; needs --noise."
)
NOISE_HELP = "With --design: deviation of a sample's force over the largest force."
DESIGN_POINTS = 300
WITHIN_HELP = "Relative error of the force that is accepted."
COLUMNS_HELP = "Columns, by title or number from 1."
columns_option = click.option(
    "--columns", callback=_parse_words, metavar="DEPTH,FORCE[,TIME]", help=COLUMNS_HELP
)
UNITS_HELP = "Units where a file says none, e.g. length=m,force=N."
units_option = click.option("--units", callback=_parse_pairs, help=UNITS_HELP)
QUIET_HELP = "Warnings and errors alone on stderr, no progress."
quiet_option = click.option(
    "--quiet", "told", flag_value="warnings", default="all", help=QUIET_HELP
)
json_option = click.option(
    "--json", "form", flag_value="json", default="text", help="Print one JSON object."
)
RTOL_HELP = "Relative tolerance, of all columns or of each, e.g. force=1e-3,a=2e-2."
TOLERANCE_FORM = "X|COLUMN=X,..."


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="indent-sim")
def program() -> None:
    """Press rigid indenters into soft bodies and report the force."""


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option("--output", type=PATH, help="Result folder [results/<CONFIG's stem>].")
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with a run that was stopped; a finished one stays as it is.",
)
@click.option("--overwrite", is_flag=True, help=OVERWRITE_HELP)
@click.option(
    "--error-bars", is_flag=True, help="Estimate the error of every force, from a coarser mesh."
)
@quiet_option
@json_option
def run(
    config: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    told: Verbosity,
    form: OutputFormat,
    **how: bool,
) -> None:
    """Simulate one scene; also under mpirun. Prints the result folder."""
    with _pause_garbage_collector():
        with raise_on_signals():
            require_resources()
            from indent_sim.config.scene_file import load
            from indent_sim.process.ranks import run_on_root

            read = cache(partial(load, config, overrides))
            comm = _world_communicator() if _start_mesher(read) else SerialComm()
        with abort_all_ranks_together(comm), raise_on_signals(comm.rank):
            settings = comm.bcast(run_on_root(comm, read))
            directory = output or Path(settings.output.directory or Path("results") / config.stem)
            outcome = _simulate(settings, comm, directory, told, **how)
        if comm.rank == 0:
            _print_conclusion(outcome, form, told)


@program.command()
@click.argument("file", metavar="STUDY", type=PATH)
@click.option("--resume", is_flag=True, help="Keep the runs that have ended, do the others.")
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace finished runs in the folder that STUDY does not ask for.",
)
@click.option(
    "--shard",
    callback=_parse_shard,
    metavar="I/N",
    help="Do only every N-th run, from the I-th on; no table.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1000),
    default=1,
    metavar="N",
    help="Runs at the same time [1].",
)
@click.option("--output", type=PATH, help="Folder of the study [results/<STUDY's stem>].")
@quiet_option
@json_option
def study(file: Path, told: Verbosity, form: OutputFormat, **how: Any) -> None:
    """Vary one scene: many runs, one table of what accuracy costs. Prints the folder."""
    _refuse_parallel_run()
    require_resources()
    from indent_sim import studies

    with _quiet_libraries(LOG_LEVELS[told]), raise_on_signals():
        finished_study = studies.execute_study(
            file, tell=print_stderr if told == "all" else (lambda line: None), **how
        )
    print_done(studies.as_json(finished_study)) if form == "json" else print_stdout(
        str(finished_study.directory)
    )
    scoreboard_lines = (
        [terminal.scoreboard_text(finished_study.scoreboard)] if finished_study.scoreboard else []
    )
    for line in (
        (*scoreboard_lines, *finished_study.notes, *finished_study.recommendations)
        if told == "all"
        else ()
    ):
        print_stderr(line)
    if finished_study.failures:
        print_stderr(
            f"{len(finished_study.failures)} of {len(finished_study.rows)} runs failed; "
            "the table has their reasons"
        )


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option(
    "--error-bars", is_flag=True, help="Count what `run --error-bars` solves beside a scene."
)
@json_option
def plan(config: Path, overrides: tuple[str, ...], error_bars: bool, form: OutputFormat) -> None:
    """Say what would be modelled, and why; of a study its runs and what they cost.

    Writes nothing.
    """
    if _is_study(config):
        return _plan_study(config, overrides, error_bars, form)
    from indent_sim.config.scene_file import load
    from indent_sim.run.planned_run import plan_with_cost

    planned = plan_with_cost(load(config, overrides), error_bars)
    if form == "json":
        return print_done(planned.plan.as_json())
    print_stdout(terminal.plan_text(planned, _terminal_width()))
    for line in planned.scene.notes:
        print_stdout(line)
    for warning in planned.plan.warnings:
        print_stderr(f"warning: {warning}")


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option("--within", type=FRACTION, default=0.01, show_default=True, help=WITHIN_HELP)
@click.option(
    "--curve", metavar="FILE", type=PATH, help="Measured curve that says depth and modulus."
)
@columns_option
@units_option
@json_option
def require(
    config: Path,
    overrides: tuple[str, ...],
    within: float,
    curve: Path | None,
    form: OutputFormat,
    **read: Any,
) -> None:
    """Say what a scene requires: every effect in per cent of the force. Writes nothing.

    Ends with the cheapest model within the tolerance, as a scene that runs as it is. With --curve
    at the depth of a measurement, with the other models of that curve: which is needed, which is
    not excluded and what it would give.
    """
    _refuse_parallel_run()
    require_resources()
    from indent_sim.config.scene_file import load
    from indent_sim.run.model_selection import recommended_model

    if curve is None and any(read.values()):
        raise UsageError("--columns and --units belong to --curve FILE")
    with _quiet_libraries(logging.ERROR), raise_on_signals():
        if curve is not None:
            return _print_curve_requirements(load(config, overrides), curve, within, read, form)
        requirements = recommended_model.require(load(config, overrides), within)
    print_done(requirements.as_json()) if form == "json" else print_stdout(
        terminal.requirements_text(requirements, _terminal_width())
    )


def _print_curve_requirements(
    config: Config, curve: Path, within: float, read: dict[str, Any], form: OutputFormat
) -> None:
    """Print the requirements of a scene for a measured curve."""
    from indent_sim.fitting.curve_requirements import require_for_curve

    requirements = require_for_curve(config, curve, within, _reading_options(**read))
    print_done(requirements.as_json()) if form == "json" else print_stdout(
        terminal.curve_requirements_text(requirements, _terminal_width())
    )


@program.command()
@click.argument("curves", metavar="CURVE_OR_FOLDER...", nargs=-1, type=PATH)
@click.option("--scene", type=PATH, help="Scene that is the model; its loading does not matter.")
@click.option("--design", "designed", metavar="SCENE", type=PATH, help=DESIGN_HELP)
@click.option("--noise", type=NumberInRange(0, 1, min_open=True), metavar="X", help=NOISE_HELP)
@click.option(
    "--points",
    type=click.IntRange(30, 100_000),
    metavar="N",
    help="With --design: points of the curve [300].",
)
@click.option(
    "--vary",
    "keys",
    required=True,
    multiple=True,
    metavar="KEY",
    help="Key to fit, e.g. material.E.",
)
@set_option
@columns_option
@units_option
@click.option(
    "--segment",
    type=click.Choice(SEGMENTS),
    default="approach",
    show_default=True,
    help=SEGMENT_HELP,
)
@click.option(
    "--contact-point",
    type=NumberInRange(),
    metavar="X",
    help="Depth of first touch, where it is known.",
)
@click.option(
    "--no-slope", "baseline", flag_value="level", default="tilted", help="The baseline is level."
)
@click.option(
    "--models", flag_value="all", default="needed", help="Ask other models of every curve."
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1000),
    default=1,
    metavar="N",
    help="Curves at the same time [1].",
)
@click.option("--output", type=PATH, help="Folder of the fit [results/fit-<CURVE's stem>].")
@quiet_option
@json_option
def fit(
    curves: tuple[Path, ...],
    told: Verbosity,
    form: OutputFormat,
    overrides: tuple[str, ...],
    **how: Any,
) -> None:
    """Fit keys of a scene to measured curves: text tables of any kind, AFM files.

    Prints the folder.

    Contact point and baseline are always unknown. A call with the same folder goes on with the
    curves that lack a row. With --design nothing is measured yet: the intervals that a curve of the
    scene would give, and what would help.
    """
    _refuse_parallel_run()
    require_resources()
    from indent_sim.config.scene_file import load

    scene, designed, noise, points = (
        how.pop(name) for name in ("scene", "designed", "noise", "points")
    )
    _refuse_mixed_options(curves, scene, designed, noise, points)
    if designed:
        with _quiet_libraries(LOG_LEVELS[told]), raise_on_signals():
            return _print_design(
                load(designed, overrides), how["keys"], noise, points or DESIGN_POINTS, form
            )
    output = how.pop("output") or Path("results") / f"fit-{curves[0].resolve().stem}"
    with _quiet_libraries(LOG_LEVELS[told]), raise_on_signals():
        fits = _fit_curves(
            curves,
            load(scene, overrides),
            output,
            print_stderr if told == "all" else _discard_line,
            **how,
        )
    if fits.exit_code:
        failure = errors.NotConverged(
            f"no curve was fitted; the first: {fits.entries[0]['reason']}"
        )
        failure.partial_result = fits.as_json()
        raise failure
    print_done({"directory": output} | fits.as_json()) if form == "json" else print_stdout(
        str(output)
    )


def _refuse_mixed_options(
    curves: tuple[Path, ...],
    scene: Path | None,
    designed: Path | None,
    noise: float | None,
    points: int | None,
) -> None:
    """Raise UsageError unless there are curves and a scene, or a design and its noise."""
    if designed and (curves or scene):
        raise UsageError(
            "--design SCENE takes no curves and no --scene", "fit CURVE --scene SCENE fits curves"
        )
    if designed and noise is None:
        raise UsageError(
            "--design needs --noise X", "X is the noise of a force over the largest one, e.g. 0.01"
        )
    if not designed and (noise is not None or points is not None):
        raise UsageError(
            "--noise and --points belong to --design", "a fit finds the noise of a curve"
        )
    if not designed and not (curves and scene):
        raise UsageError(
            "fit needs CURVE_OR_FOLDER... and --scene SCENE",
            "or --design SCENE before a measurement",
        )


def _print_design(
    config: Config, keys: tuple[str, ...], noise: float, points: int, form: OutputFormat
) -> None:
    """Print the intervals to expect from a measurement of a scene."""
    from indent_sim.fitting import design

    measurement_design = design.design_measurement(config, keys, noise, points)
    print_done(measurement_design.as_json()) if form == "json" else print_stdout(
        terminal.design_text(measurement_design)
    )


def _discard_line(line: str) -> None:
    """Discard a progress line."""


def _fit_curves(
    curves: tuple[Path, ...],
    config: Config,
    output: Path,
    say_line: Callable[[str], None],
    **how: Any,
) -> CurveFits:
    """Return the fits of some curves with the options of the command line."""
    from indent_sim.fitting import fit_folder
    from indent_sim.fitting.curve_fit import FitRequest
    from indent_sim.fitting.inference.estimate import OriginOptions

    reading = _reading_options(how["columns"], how["units"])
    origin = OriginOptions(how["contact_point"], how["baseline"] == "tilted")
    request = FitRequest(config, how["keys"], how["segment"], origin, how["models"])
    return fit_folder.fit_curves(curves, request, output, reading, how["jobs"], say_line)


def _reading_options(columns: tuple[str, ...], units: dict[str, str]) -> ReadOptions:
    """Return the options for reading curve files from those of the command line."""
    from indent_sim.fitting.fit_folder import ReadOptions

    if columns and not 2 <= len(columns) <= 3:
        raise ConfigError(
            "--columns", f"names {len(columns)} columns", "give DEPTH,FORCE or DEPTH,FORCE,TIME"
        )
    if wrong := [kind for kind in units if kind not in ("length", "force", "time")]:
        raise UsageError(f"--units {wrong[0]}: there are length, force, time")
    return ReadOptions(columns, units)


@program.command()
@click.argument("first", metavar="A", type=PATH)
@click.argument("second", metavar="B", type=PATH)
@click.option(
    "--rtol",
    callback=_parse_tolerances,
    metavar=TOLERANCE_FORM,
    default="1e-6",
    show_default=True,
    help=RTOL_HELP,
)
@click.option(
    "--columns",
    callback=_parse_words,
    help="Columns to compare [delta,force,a and those of --rtol].",
)
@json_option
def compare(
    first: Path, second: Path, rtol: dict[str, float], columns: tuple[str, ...], form: OutputFormat
) -> None:
    """Compare two results row by row. Exit code 6 when they differ.

    A or B may be a measured curve. Rows are matched by step, or by depth where a table has no
    steps; where depths differ the curve with more rows is interpolated. Those of an experiment,
    which of two results are compared as well, are matched by number.
    """
    from indent_sim.results import compare

    comparison = compare.compare(first, second, rtol, columns or None)
    if form == "text":
        print_stdout(terminal.comparison_text(comparison))
    try:
        comparison.check()
    except errors.VerificationError as different:
        different.partial_result = comparison.as_json()
        raise
    if form == "json":
        print_done(comparison.as_json())


@program.command()
@click.argument("paths", metavar="RESULT_OR_CURVE...|STUDY", nargs=-1, required=True, type=PATH)
@click.option("--what", callback=_parse_words, help=WHAT_HELP)
@click.option(
    "--field",
    "fields",
    callback=_parse_words,
    shell_complete=_complete_fields,
    help="Fields, with commas [von_mises].",
)
@click.option(
    "--steps",
    callback=_parse_words,
    help="Steps with commas, last or all [that of the largest force].",
)
@click.option(
    "--units", callback=_parse_pairs, help="Units shown, e.g. length=nm,force=pN,pressure=kPa."
)
@click.option(
    "--width", type=NumberInRange(30, 1000), metavar="MM", help="Width of the picture in mm."
)
@click.option(
    "--layout",
    callback=_parse_layout,
    metavar="ROWSxCOLUMNS",
    help="All panels in rows and columns, e.g. 1x3.",
)
@click.option("--letters", flag_value="a", default="", help="Name the panels (a), (b), ...")
@click.option(
    "--dpi",
    type=NumberInRange(20, 2400),
    metavar="N",
    help="Points to the inch [160; of a PDF 300].",
)
@click.option("--limits", callback=_parse_limits, metavar="A:B", help=LIMITS_HELP)
@click.option(
    "--zoom",
    callback=_parse_zoom,
    metavar="X|all",
    help="Contact radii around the tip, or the whole body.",
)
@click.option(
    "--font-size", "font", type=NumberInRange(4, 40), metavar="PT", help="Font size in points [10]."
)
@click.option(
    "--output", type=PATH, help="Picture to write: .png, .svg or .pdf; or the force curve: .tab."
)
def plot(paths: tuple[Path, ...], output: Path | None, **wish: Any) -> None:
    """Draw finished results and measured curves over one another, or a study.

    Prints the picture's path.

    \b Without --what: force, contact radius and pressure of one result, force and contact radius of
    several; of a body followed in time what changes over the time; of a study its curves.
    pressure_x and pressure_y are the pressure on a line through the tip's axis. Of a study force,
    a, p_max and penetration are drawn over what varies, over two numbers as a map, the penetration
    over epsilon_n where that varies. Fields: von_mises, principal_1, principal_2, principal_3,
    sigma_xx (of a body of revolution rr), sigma_yy, sigma_zz, sigma_xz, J, energy_density,
    displacement; with fluid pore_pressure, fluid_content; of gels swelling. A film shows states of
    one side by side, spread over the path.
    """
    from indent_sim.results import reader
    from indent_sim.results.pictures import figures, panels
    from indent_sim.results.result_files import folder_kind

    options = {name: value for name, value in wish.items() if value}
    if any(path.is_dir() and folder_kind(path) == "study" for path in paths):
        return _plot_study(paths, output, options)
    request = panels.plot_request(options) if options else None
    runs = [reader.read(path) for path in paths]
    if output is not None and output.suffix.lower() == ".tab":
        return _write_tab(runs, options, output)
    if output is None:
        first = paths[0] if paths[0].is_dir() else paths[0].parent
        output = (first if len(paths) == 1 else Path()) / (
            request.file_name if request else figures.FORCE_PICTURE
        )
        figures.refuse_foreign_picture(output)
    try:
        panels.draw(runs, request, output) if request else panels.draw_results(runs, output)
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


STUDY_PLOT_OPTIONS = ("what", "dpi")  # options of a picture that one of a study heeds


def _plot_study(paths: Sequence[Path], output: Path | None, options: dict[str, Any]) -> None:
    """Draw the curves of a study, or a column of its table over the varied keys."""
    from indent_sim.results.pictures import figures
    from indent_sim.results.result_files import RUNS
    from indent_sim.studies import curve_table, small_multiples, study_picture, study_report

    if len(paths) > 1:
        raise UsageError("a study is drawn by itself", "name one study, or folders of runs alone")
    if unused_options := [name for name in options if name not in STUDY_PLOT_OPTIONS]:
        raise UsageError(
            f"the picture of a study heeds no {unused_options[0]}",
            "there are --what, --dpi and --output",
        )
    folder = paths[0]
    (panel, *further_panels) = options.get("what", ("curves",))
    if further_panels or panel not in ("curves", *small_multiples.PLOTTED_COLUMNS):
        raise UsageError(
            f"--what of a study is one of curves, {', '.join(small_multiples.PLOTTED_COLUMNS)}"
        )
    record, rows = study_report.read_study_folder(folder)
    curve_groups = curve_table.group_folder_curves(folder / RUNS, rows, record["keys"])
    if not curve_groups.curves:
        raise UsageError(f"{folder} has no run that is done")
    title = str(record.get("title") or folder.resolve().name)
    if output is None:
        output = folder / f"{panel}.png"
        figures.refuse_foreign_picture(output)
    figure_context = study_picture.curves_figure(curve_groups, title)
    if panel != "curves":
        figure_context = small_multiples.column_figure(curve_groups, panel, title)
    try:
        with figure_context as figure:
            figures.save(figure, output, options.get("dpi"))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


def _write_tab(runs: list[Results], options: dict[str, Any], output: Path) -> None:
    """Write the force curve of a result as a .tab file."""
    from indent_sim.results.atomic_files import write_atomically
    from indent_sim.results.measured.tab_file import tab_text

    if options or len(runs) > 1:
        raise UsageError(
            f"{output}: a .tab file holds the force curve of one result",
            "leave the other options out",
        )
    try:
        write_atomically(output, tab_text(runs[0]))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


@program.command()
@click.argument("folder", metavar="RESULT|STUDY|FIT", type=PATH)
@click.option("--output", type=PATH, help="File to write, .html or .htm [report.html in it].")
@click.option(
    "--crate",
    "beside",
    flag_value="crate",
    default="",
    help="Write ro-crate-metadata.json for archives, too.",
)
def report(folder: Path, output: Path | None, beside: Literal["", "crate"]) -> None:
    """Write one HTML file about a result, a study or a fit: scene, pictures, errors, provenance.
    Prints its path.
    """
    from indent_sim.results import html_report, research_crate
    from indent_sim.results.result_files import is_own_file

    if not folder.is_dir():
        raise UsageError(f"{folder} is no folder of a result, a study or a fit")
    if output is None:
        output = folder / html_report.REPORT_FILE
        if os.path.lexists(output) and not is_own_file(output):
            raise UsageError(
                f"{output} is there already and no report of indent-sim",
                "choose another name: --output",
            )
    if output.suffix.lower() not in html_report.REPORT_FORMATS:
        raise UsageError(f"{output}: a report ends in {', '.join(html_report.REPORT_FORMATS)}")
    if beside:
        research_crate.refuse_foreign_crate(folder)
    html_report.write(_report_page(folder), output)
    if beside:
        research_crate.write_crate(folder, _own_file_names(folder))
    print_stdout(str(output))


def _own_file_names(folder: Path) -> Sequence[str]:
    """Return the names of the program's own files in a folder of this kind."""
    from indent_sim.results.result_files import FIELDS_FOLDER, RESULT_FILES, folder_kind

    match folder_kind(folder):
        case "study":
            from indent_sim.studies.study_folder import STUDY_FILES

            return STUDY_FILES
        case "fit":
            from indent_sim.fitting.fit_folder import FIT_FILES

            return FIT_FILES
    return (*RESULT_FILES, FIELDS_FOLDER)


def _report_page(folder: Path) -> str:
    """Return the report of a folder."""
    from indent_sim.results import run_report
    from indent_sim.results.result_files import folder_kind

    match folder_kind(folder):
        case "study":
            from indent_sim.studies.study_report import study_page

            return study_page(folder)
        case "fit":
            from indent_sim.fitting.fit_report import fit_page

            return fit_page(folder)
    return run_report.run_page(folder)


@program.command()
@click.argument(
    "kind", type=click.Choice(TEMPLATES), default=TEMPLATES[0], metavar=f"[{'|'.join(TEMPLATES)}]"
)
@click.option("--output", type=PATH, help="File to write [KIND.yaml].")
def init(kind: str, output: Path | None) -> None:
    """Write a commented scene or study to start from. Prints the file's name.

    Beside a scene goes scene.schema.json, by which editors check and complete it, unless there is
    one.
    """
    from importlib.resources import files

    from indent_sim.config.json_schema import json_schema
    from indent_sim.results.atomic_files import write_atomically
    from indent_sim.results.json_text import to_json

    output = output or Path(f"{kind}.yaml")
    if os.path.lexists(output):
        raise UsageError(
            f"{output} is there already and stays as it is; choose another name with --output"
        )
    try:
        write_atomically(
            output, (files("indent_sim.cli") / "templates" / f"{kind}.yaml").read_bytes()
        )
        schema_path = output.parent / SCHEMA_FILE
        if kind != "study" and not os.path.lexists(schema_path):
            write_atomically(schema_path, to_json(json_schema()) + "\n")
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


@program.command("list")
@click.argument("kind", type=click.Choice(list(LISTED_SECTIONS)), required=False)
def list_(kind: str | None) -> None:
    """What a scene can be made of, with parameters and units."""
    kinds = [kind] if kind else list(LISTED_SECTIONS)
    print_stdout(
        "\n\n".join(f"{name}\n{terminal.section_text(LISTED_SECTIONS[name])}" for name in kinds)
    )


@program.command()
def schema() -> None:
    """JSON Schema of the scene file, for editors."""
    from indent_sim.config.json_schema import json_schema

    print_json(json_schema())


@program.command()
@json_option
def doctor(form: OutputFormat) -> None:
    """Versions and health of the installation. Exit code 7 when something needed is broken."""
    from indent_sim.cli import doctor as health

    checks = health.check_installation()
    broken = [check.name for check in checks if check.verdict == "broken"]
    if form == "text":
        print_stdout("\n".join(map(str, checks)))
    if broken:
        error = errors.BackendError(f"missing or broken: {', '.join(broken)}")
        error.partial_result = {"checks": checks}
        raise error
    if form == "json":
        print_done({"checks": checks})


def main() -> None:
    """Run the program as a console script."""
    program(prog_name="indent-sim")


# ---- one run, on all ranks
# ---------------------------------------------------------------------------------


def _start_mesher(read: Callable[[], Config]) -> bool:
    """Fork the process that meshes on rank 0, before MPI starts, unless theory solves the scene.

    Returns whether there are several ranks.
    """
    from indent_sim.process.ranks import is_parallel, is_root
    from indent_sim.run.planned_run import start_mesher_if_needed

    return not is_root() or start_mesher_if_needed(read) or is_parallel()


@contextmanager
def _pause_garbage_collector() -> Iterator[None]:
    """Disable the cyclic garbage collector while libraries are imported.

    They create a hundred thousand objects, none of them garbage; the search takes 5 % of the time
    of a small run. A run of many rows enables it again.
    """
    gc.unfreeze()  # what an earlier command of this process set aside
    gc.disable()
    try:
        yield
    finally:
        # else what was made in the meantime would be searched at once, and most processes end here
        gc.freeze()
        gc.enable()


def _world_communicator() -> Any:
    from indent_sim.run.pipeline import mpi

    return mpi().COMM_WORLD


def _refuse_parallel_run() -> None:
    """Raise UsageError under mpirun for commands that fork processes.

    A process that takes part in MPI must not fork; therefore the environment of mpirun is examined,
    and MPI is not started.
    """
    from indent_sim.process.ranks import is_parallel

    if is_parallel():
        with abort_all_ranks_together(_world_communicator()):
            raise UsageError(
                "a study runs on one rank; start it without mpirun, and split it with --shard"
            )


@contextmanager
def abort_all_ranks_together(comm: Any) -> Iterator[None]:
    """All ranks leave the block with the same exit code, and one says why: rank 0, or who fails
    where it does not.

    A rank that fails where the others do not (a bug, a signal) takes them all down.
    """
    consensus = FailureConsensus(comm)
    try:
        yield
    except BaseException as error:
        if comm.size == 1:
            raise
        is_interrupted = isinstance(
            error, KeyboardInterrupt
        )  # rank 0 closes its files and ends all
        code = (
            getattr(error, "exit_code", 1) if comm.rank else report_failure(error)
        )  # at once: mpirun kills
        if (
            (comm.rank or not is_interrupted)
            and consensus.all_ranks_failed()
            and not is_interrupted
        ):
            raise click.exceptions.Exit(code) from error
        comm.Abort(report_failure(error) if comm.rank else code)


def _simulate(settings: Config, comm: Any, directory: Path, told: Verbosity, **how: Any) -> Outcome:
    from indent_sim.run.pipeline import simulate as simulate

    progress_context: AbstractContextManager[Any] = nullcontext()
    if comm.rank == 0 and told == "all":
        progress_context = terminal.show_progress(print_stderr, settings)
    try:
        with (
            progress_context as show_progress,
            _quiet_libraries(logging.ERROR if comm.rank else LOG_LEVELS[told]),
        ):  # rank 0 speaks for all

            def follow(*row: Any) -> None:
                raise_pending_signal()
                if (
                    row[1] >= ROWS_WITHOUT_GC
                ):  # the step: at once where a run goes on from a later row
                    gc.enable()
                if show_progress is not None:
                    show_progress(*row)

            return simulate(settings, comm, directory=directory, progress=follow, **how)
    except (IndentSimError, KeyboardInterrupt) as end:
        if comm.rank == 0 and not isinstance(
            end, UsageError | ConfigError
        ):  # those refuse and compute nothing
            _report_kept_rows(directory, end)
        raise


@contextmanager
def _quiet_libraries(level: int) -> Iterator[None]:
    """Show messages and warnings on stderr, except those of compilers."""
    own_logger = logging.getLogger("indent_sim")
    root_logger = logging.getLogger()
    own_handler = StderrHandler(logging.INFO)
    library_handler = StderrHandler(logging.WARNING)
    old_settings = own_logger.level, own_logger.propagate
    own_logger.setLevel(level)
    own_logger.propagate = False
    own_logger.addHandler(own_handler)
    root_logger.addHandler(
        library_handler
    )  # without one, libraries that call `logging.info` would install theirs, which prints all
    try:
        yield
    finally:
        root_logger.removeHandler(library_handler)
        own_logger.removeHandler(own_handler)
        own_logger.level, own_logger.propagate = old_settings


class StderrHandler(logging.Handler):
    """Log handler that prints to stderr, for libraries with their name."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        logger_name = "" if record.name == "indent_sim" else f"{record.name}: "
        print_stderr(f"{logger_name}{record.getMessage()}")


def _report_kept_rows(directory: Path, end: BaseException) -> None:
    """Print where the rows of a failed run are, or that a finished one is still there."""
    from indent_sim.results.result_files import read_report

    report = read_report(directory)
    if report.get("status") == "done":
        print_stderr(f"the finished run in {directory} is as it was")
    if report.get("status") in ("failed", "interrupted") and report.get("rows"):
        resume_hint = (
            "" if isinstance(end, errors.VerificationError) else "; --resume goes on from them"
        )
        print_stderr(f"{report['rows']} rows computed before are kept in {directory}{resume_hint}")


def _print_conclusion(outcome: Outcome, form: OutputFormat, told: Verbosity) -> None:
    from indent_sim.results.reader import has_reactions, rows_of
    from indent_sim.results.result_files import read_report

    if form == "json":
        report_entries = read_report(outcome.directory)  # with the entries of the writer
        rows = rows_of(outcome.states, has_reactions(outcome.directory))
        print_done(
            {
                "directory": outcome.directory,
                "rows": rows,
                "report": report_entries | outcome.report,
            }
        )
    else:
        print_stdout(str(outcome.directory))
    for line in (
        terminal.conclusion_lines(outcome) if told == "all" else terminal.warning_lines(outcome)
    ):
        print_stderr(line)


def _is_study(path: Path) -> bool:
    """Return whether a file contains a study; False if it cannot be read.

    Reading it as a scene reports why.
    """
    from indent_sim.config.scene_file import is_study, read_document

    with suppress(IndentSimError):
        return is_study(read_document(path)[0])
    return False


def _plan_study(
    path: Path, overrides: tuple[str, ...], error_bars: bool, form: OutputFormat
) -> None:
    if overrides:
        raise UsageError("--set belongs to a scene; a study has set: in its file")
    from indent_sim import studies

    planned = studies.plan_study(path, error_bars)
    print_done(planned.as_json()) if form == "json" else print_stdout(
        terminal.study_plan_text(planned)
    )
    for line in planned.notes:
        print_stderr(line)


def _terminal_width() -> int:
    """Return the columns of the terminal; without one enough for whole lines."""
    import shutil

    return shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 120


if __name__ == "__main__":
    main()
