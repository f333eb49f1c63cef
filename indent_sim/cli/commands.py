"""Commands of the command line, and the only module that ends the process or uses COMM_WORLD.

The result is printed to stdout, everything else to stderr. Under MPI only rank 0 prints, and all
ranks end with the same exit code. Commands import large modules themselves, so that a command loads
only what it needs.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from indent_sim.cli import terminal
from indent_sim.cli.options import (
    FRACTION,
    PATH,
    NumberInRange,
    columns_option,
    complete_fields,
    json_option,
    parse_layout,
    parse_limits,
    parse_pairs,
    parse_pixel,
    parse_rows,
    parse_shard,
    parse_tolerances,
    parse_top,
    parse_words,
    parse_zoom,
    quiet_option,
    sensitivity_option,
    set_option,
    units_option,
)
from indent_sim.cli.output import (
    FORMAT_KEY,
    OutputFormat,
    exit_with_usage_error,
    print_done,
    print_json,
    print_stderr,
    print_stdout,
    report_failure,
)
from indent_sim.process import errors
from indent_sim.process.errors import ConfigError, IndentSimError, UsageError
from indent_sim.process.limits import require_resources, translate_resource_errors, write_error
from indent_sim.process.ranks import FailureConsensus, SerialComm
from indent_sim.process.signals import raise_on_signals, raise_pending_signal
from indent_sim.process.version import VERSION

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.fitting.curve_fit import FitRequest
    from indent_sim.fitting.fit_folder import CurveFits, ReadOptions
    from indent_sim.fitting.map_result import MapFit
    from indent_sim.results.reader import Results
    from indent_sim.run.pipeline import Outcome
    from indent_sim.studies.surrogate import Surrogate

# Messages on stderr, and the log level of the program's own logger for each.
Verbosity = Literal["all", "warnings"]
LOG_LEVELS = {"all": logging.INFO, "warnings": logging.WARNING}
# Sections of a scene, by the argument of `list`.
LISTED_SECTIONS = {
    "materials": "material",
    "indenters": "indenter",
    "contact": "contact",
    "bodies": "body",
}
TEMPLATES = ("cell", "gel", "film", "nanoindentation", "rubber", "study")


class Program(click.Group):
    """Command group that converts failures of the program to a message and an exit code."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the program with one BLAS thread and without pydantic plugins.

        Settings of the environment take precedence. The defaults must be set before numpy and
        pydantic are imported; pydantic would search every installed package for plugins.
        """
        # Numbers of BLAS threads. Several threads slow systems of these sizes down.
        thread_variables = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        for name in (*thread_variables, "PYDANTIC_DISABLE_PLUGINS"):
            os.environ.setdefault(name, "1")
        _open_closed_streams()
        return super().main(*args, **options)

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> click.Context:
        """Parse the options of the program; a usage error is text, or JSON with --json."""
        options = args[: args.index("--")] if "--" in args else args
        output_format: OutputFormat = "json" if "--json" in options else "text"
        try:
            ctx = super().make_context(info_name, args, *rest, **extra)
        except click.ClickException as error:
            exit_with_usage_error(error, output_format)
        ctx.meta[FORMAT_KEY] = output_format
        return ctx

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; print a message for an expected failure, a traceback for any other."""
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
    """Open /dev/null in place of closed stdin, stdout and stderr, which libraries need."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="indent-sim")
def program() -> None:
    """Simulate the indentation of soft bodies by rigid tips."""


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option("--output", type=PATH, help="Result folder [results/<CONFIG's stem>].")
@click.option(
    "--resume",
    is_flag=True,
    help="Continue an interrupted run; a finished run is left as it is.",
)
@click.option(
    "--overwrite",
    is_flag=True,
    help=(
        "Replace a run in the folder that belongs to another CONFIG, or a finished run of "
        "another scene."
    ),
)
@click.option(
    "--error-bars", is_flag=True, help="Estimate the error of every force by a coarser mesh."
)
@quiet_option
@json_option
def run(
    config: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    verbosity: Verbosity,
    output_format: OutputFormat,
    **options: bool,
) -> None:
    """Simulate one scene; also under mpirun. Prints the result folder."""
    with raise_on_signals():
        require_resources()
        from indent_sim.config.scene_file import load
        from indent_sim.process.ranks import run_on_root

        load_config = cache(partial(load, config, overrides))
        comm = _world_communicator() if _start_mesher(load_config) else SerialComm()
    with abort_all_ranks_together(comm), raise_on_signals(comm.rank):
        settings = comm.bcast(run_on_root(comm, load_config))
        directory = output or Path(settings.output.directory or Path("results") / config.stem)
        outcome = _simulate(settings, comm, directory, verbosity, **options)
    if comm.rank == 0:
        _print_conclusion(outcome, output_format, verbosity)


@program.command()
@click.argument("file", metavar="STUDY", type=PATH)
@click.option("--resume", is_flag=True, help="Keep finished runs and perform the others.")
@click.option(
    "--overwrite",
    is_flag=True,
    help="Also replace finished runs in the folder that do not belong to STUDY.",
)
@click.option(
    "--shard",
    callback=parse_shard,
    metavar="I/N",
    help="Perform only every N-th run, beginning with the I-th, and write no table.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1000),
    default=1,
    metavar="N",
    help="Number of runs at the same time [1].",
)
@click.option(
    "--gather",
    is_flag=True,
    help="Write the table of the existing runs, without computing any run.",
)
@click.option(
    "--only",
    metavar="NAME",
    help="Perform one run with a result folder, given by its name or number in study.csv.",
)
@click.option(
    "--surrogate",
    metavar="COLUMN",
    help="Fit a column (force, a or p_max) of the finished study by a function of the varied "
    "keys, and state the error of this surrogate.",
)
@click.option(
    "--within",
    type=click.FloatRange(0, 1, min_open=True),
    metavar="X",
    help="Largest permitted relative error of the surrogate.",
)
@click.option("--output", type=PATH, help="Folder of the study [results/<STUDY's stem>].")
@quiet_option
@json_option
def study(
    file: Path,
    only: str | None,
    surrogate: str | None,
    within: float | None,
    verbosity: Verbosity,
    output_format: OutputFormat,
    **options: Any,
) -> None:
    """Run a scene with varied keys and tabulate errors and costs. Prints the study folder."""
    _refuse_parallel_run()
    require_resources()
    from indent_sim import studies

    if within is not None and surrogate is None:
        raise UsageError("--within is the error of a surrogate", "give --surrogate COLUMN, too")
    if only is not None and surrogate is not None:
        raise UsageError("--only and --surrogate exclude each other")
    if only is not None:
        return _make_run_of_study(file, only, options, verbosity, output_format)
    if surrogate is not None:
        return _make_surrogate(file, surrogate, within, options, verbosity, output_format)

    print_progress = print_stderr if verbosity == "all" else _discard_line
    with _quiet_libraries(LOG_LEVELS[verbosity]), raise_on_signals():
        finished_study = studies.execute_study(file, tell=print_progress, **options)
    if output_format == "json":
        print_done(studies.as_json(finished_study))
    else:
        print_stdout(str(finished_study.directory))
    if verbosity == "all":
        if finished_study.scoreboard:
            print_stderr(terminal.scoreboard_text(finished_study.scoreboard))
        for line in (*finished_study.notes, *finished_study.recommendations):
            print_stderr(line)
    if finished_study.counts and verbosity == "all":
        print_stderr(terminal.row_counts_text(finished_study.counts))
    if finished_study.failures:
        print_stderr(
            f"{len(finished_study.failures)} of {len(finished_study.rows)} runs failed; "
            "the table gives the reasons"
        )


def _make_run_of_study(
    file: Path,
    name: str,
    options: Mapping[str, Any],
    verbosity: Verbosity,
    output_format: OutputFormat,
) -> None:
    """Make one run of a study with its result folder, and print the folder."""
    _refuse_options_of_runs("--only", options)
    from indent_sim import studies

    with _quiet_libraries(LOG_LEVELS[verbosity]), raise_on_signals():
        folder = studies.execute_run(file, name, output=options["output"])
    if output_format == "json":
        print_done({"directory": str(folder)})
    else:
        print_stdout(str(folder))


def _make_surrogate(
    file: Path,
    column: str,
    within: float | None,
    options: Mapping[str, Any],
    verbosity: Verbosity,
    output_format: OutputFormat,
) -> None:
    """Fit a surrogate to a finished study, and print its file."""
    _refuse_options_of_runs("--surrogate", options)
    from indent_sim import studies

    made = studies.make_surrogate(file, column, within=within, output=options["output"])
    if output_format == "json":
        print_done(made.as_json())
    else:
        print_stdout(str(made.path))
    if verbosity == "all":
        for line in made.notes:
            print_stderr(line)


def _refuse_options_of_runs(option: str, options: Mapping[str, Any]) -> None:
    """Raise UsageError if an option is combined with options for all runs of a study."""
    given = [key for key in ("resume", "overwrite", "shard", "gather") if options[key]]
    given += ["jobs"] if options["jobs"] > 1 else []
    if given:
        raise UsageError(f"{option} cannot be combined with --{given[0]}")


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option(
    "--error-bars", is_flag=True, help="Include the cost of the error estimates of `run`."
)
@json_option
def plan(
    config: Path, overrides: tuple[str, ...], error_bars: bool, output_format: OutputFormat
) -> None:
    """Show the model of a scene with reasons, or the runs of a study.

    Also predicts the cost. Writes nothing.
    """
    if _is_study(config):
        return _plan_study(config, overrides, error_bars, output_format)
    from indent_sim.config.scene_file import load
    from indent_sim.run.planned_run import plan_with_cost

    planned = plan_with_cost(load(config, overrides), error_bars)
    if output_format == "json":
        return print_done(planned.plan.as_json())
    print_stdout(terminal.plan_text(planned, _terminal_width()))
    for line in planned.scene.notes:
        print_stdout(line)
    for warning in planned.plan.warnings:
        print_stderr(f"warning: {warning}")


@program.command()
@click.argument("config", type=PATH)
@set_option
@click.option(
    "--within",
    type=FRACTION,
    default=0.01,
    show_default=True,
    help="Accepted relative error of the force.",
)
@click.option(
    "--curve",
    metavar="FILE",
    type=PATH,
    help="Measured curve, from which the depth and the modulus are taken.",
)
@columns_option
@units_option
@sensitivity_option
@json_option
def require(
    config: Path,
    overrides: tuple[str, ...],
    within: float,
    curve: Path | None,
    output_format: OutputFormat,
    **reading_options: Any,
) -> None:
    """Show the effects on the force and the cheapest sufficient model. Writes nothing.

    Effects are in per cent of the force; the model is a scene that can be run. With --curve, the
    effects at the depth of a measured curve are shown, and other models are fitted to this curve:
    the output states which of them is needed, which is not excluded, and the modulus that each
    would give.
    """
    _refuse_parallel_run()
    require_resources()
    from indent_sim.config.scene_file import load
    from indent_sim.run.model_selection import recommended_model

    if curve is None and any(reading_options.values()):
        raise UsageError("--columns, --units and --sensitivity require --curve FILE")
    with _quiet_libraries(logging.ERROR), raise_on_signals():
        if curve is not None:
            scene_config = load(config, overrides)
            return _print_curve_requirements(
                scene_config, curve, within, reading_options, output_format
            )
        requirements = recommended_model.require(load(config, overrides), within)
    if output_format == "json":
        print_done(requirements.as_json())
    else:
        print_stdout(terminal.requirements_text(requirements, _terminal_width()))


def _print_curve_requirements(
    config: Config,
    curve: Path,
    within: float,
    reading_options: dict[str, Any],
    output_format: OutputFormat,
) -> None:
    """Print the requirements of a scene for a measured curve."""
    from indent_sim.fitting.curve_requirements import require_for_curve

    requirements = require_for_curve(config, curve, within, _reading_options(reading_options))
    if output_format == "json":
        print_done(requirements.as_json())
    else:
        print_stdout(terminal.curve_requirements_text(requirements, _terminal_width()))


@program.command()
@click.argument("curves", metavar="CURVE_OR_FOLDER...", nargs=-1, type=PATH)
@click.option(
    "--scene",
    type=PATH,
    help="Scene used as the model; its loading is ignored. Or the surrogate of the force of a "
    "study, which gives the forces without solving a scene; --set gives the values of its keys.",
)
@click.option(
    "--design",
    "design_scene",
    metavar="SCENE",
    type=PATH,
    help=(
        "Before a measurement: print the intervals that a fit of the keys to a curve of this "
        "scene would give; needs --noise."
    ),
)
@click.option(
    "--noise",
    type=NumberInRange(0, 1, min_open=True),
    metavar="X",
    help="With --design: standard deviation of the force divided by the largest force.",
)
@click.option(
    "--points",
    type=click.IntRange(30, 100_000),
    metavar="N",
    help="With --design: number of points of the curve [300].",
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
@sensitivity_option
@click.option(
    "--segment",
    type=click.Choice(("approach", "hold", "retract", "both", "all")),
    default="approach",
    show_default=True,
    help="Part of the curve that is fitted; hold means approach and hold, both means "
    "approach and retraction.",
)
@click.option(
    "--other-tip",
    "other_tips",
    multiple=True,
    metavar="KEY=VALUE",
    help="Tip of the second curve, e.g. indenter.half_angle=50: the loops of a body that yields, "
    "one for each tip, are fitted together. Once for each further curve.",
)
@click.option(
    "--contact-point",
    type=NumberInRange(),
    metavar="X",
    help="Position of first contact in the depth or z column of the file [fitted].",
)
@click.option(
    "--no-slope",
    "baseline",
    flag_value="level",
    default="tilted",
    help="Fit a constant baseline, without a slope.",
)
@click.option(
    "--level",
    type=NumberInRange(),
    metavar="X",
    help="Constant force out of contact, in the unit of the scene [fitted; 0 if the curve "
    "begins in contact].",
)
@click.option(
    "--models",
    flag_value="all",
    default="needed",
    help="Fit the alternative models to every curve, even if the scene explains it; in a map "
    "only to the sample of curves that are fitted one by one.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1000),
    default=1,
    metavar="N",
    help="Number of curves, or of blocks of curves of a map, that are fitted at the same time [1].",
)
@click.option(
    "--map/--no-map",
    "as_map",
    default=None,
    help="Fit the curves of a grid together as a map, or one by one [together from 64 curves on].",
)
@click.option(
    "--thickness",
    metavar="FILE|height[:MEAN]|base",
    help="With a map: thickness of each pixel. FILE is a .gsf, .tif or text file. With "
    "height it follows from the height at zero force above a flat base, and MEAN is the "
    "median thickness [body.height]. With base it is the height above a plane that is "
    "fitted to the pixels on the bare substrate.",
)
@click.option(
    "--grid",
    callback=parse_layout,
    metavar="ROWSxCOLUMNS",
    help="Take the files, in the order of their names, as the pixels of a map, row by row.",
)
@click.option(
    "--rows",
    callback=parse_rows,
    metavar="A:B",
    help="With a map: fit only the rows A to B - 1, counted from 0 in the order of the scan [all].",
)
@click.option("--output", type=PATH, help="Folder of the fit [results/fit-<CURVE's stem>].")
@quiet_option
@json_option
def fit(
    curves: tuple[Path, ...],
    verbosity: Verbosity,
    output_format: OutputFormat,
    overrides: tuple[str, ...],
    **options: Any,
) -> None:
    """Fit parameters of a scene to measured curves, and print the result folder.

    Curves are text tables of any kind, or AFM files.

    Contact point and baseline are always fitted as well. A second call with the same folder
    continues with the curves that have no result. With --design, before a measurement, the command
    prints the intervals that a curve of the scene would give, and the changes of the experiment
    that would narrow them.
    """
    _refuse_parallel_run()
    require_resources()
    from indent_sim.config.scene_file import load

    scene, design_scene, noise, points = (
        options.pop(name) for name in ("scene", "design_scene", "noise", "points")
    )
    _refuse_mixed_options(curves, scene, design_scene, noise, points)
    if design_scene and options["other_tips"]:
        raise UsageError(
            "--design takes no --other-tip",
            "with material.plasticity.hardening.n among the keys it tells what a second cone adds",
        )
    if design_scene:
        with _quiet_libraries(LOG_LEVELS[verbosity]), raise_on_signals():
            config = load(design_scene, overrides)
            # Number of points of the curve of `fit --design`, unless --points is given.
            design_points = 300
            return _print_design(
                config, options["keys"], noise, points or design_points, output_format
            )
    output = options.pop("output") or Path("results") / f"fit-{curves[0].resolve().stem}"
    with _quiet_libraries(LOG_LEVELS[verbosity]), raise_on_signals():
        from indent_sim.cli.fit_scene import scene_or_surrogate

        config, surrogate = scene_or_surrogate(scene, overrides, options["keys"])
        print_progress = print_stderr if verbosity == "all" else _discard_line
        map_fit = _fit_map(curves, config, surrogate, output, print_progress, **options)
        if map_fit is not None:
            return _print_map(map_fit, output, output_format)
        fits = _fit_curves(curves, config, surrogate, output, print_progress, **options)
    if fits.exit_code:
        failure = errors.NotConverged(
            f"no curve could be fitted; reason for the first one: {fits.entries[0]['reason']}"
        )
        failure.partial_result = fits.as_json()
        raise failure
    if output_format == "json":
        print_done({"directory": output} | fits.as_json())
    else:
        print_stdout(str(output))


def _refuse_mixed_options(
    curves: tuple[Path, ...],
    scene: Path | None,
    design_scene: Path | None,
    noise: float | None,
    points: int | None,
) -> None:
    """Raise UsageError unless there are curves and a scene, or a design and its noise."""
    if design_scene and (curves or scene):
        raise UsageError(
            "--design SCENE takes no curves and no --scene", "fit CURVE --scene SCENE fits curves"
        )
    if design_scene and noise is None:
        raise UsageError(
            "--design needs --noise X",
            "X is the standard deviation of the force divided by the largest force, e.g. 0.01",
        )
    if not design_scene and (noise is not None or points is not None):
        raise UsageError(
            "--noise and --points require --design", "a fit estimates the noise from the curve"
        )
    if not design_scene and not (curves and scene):
        raise UsageError(
            "fit needs CURVE_OR_FOLDER... and --scene SCENE",
            "or --design SCENE before a measurement",
        )


def _print_design(
    config: Config, keys: tuple[str, ...], noise: float, points: int, output_format: OutputFormat
) -> None:
    """Print the parameter intervals that are expected from a measurement of a scene."""
    from indent_sim.fitting import design

    measurement_design = design.design_measurement(config, keys, noise, points)
    if output_format == "json":
        print_done(measurement_design.as_json())
    else:
        print_stdout(terminal.design_text(measurement_design))


def _discard_line(line: str) -> None:
    """Discard a progress line."""


def _fit_map(
    curves: tuple[Path, ...],
    config: Config,
    surrogate: Surrogate | None,
    output: Path,
    print_progress: Callable[[str], None],
    **options: Any,
) -> MapFit | None:
    """Fit a map with the options of the command line; return None if the curves are no map."""
    from indent_sim.fitting import map_folder, map_source
    from indent_sim.fitting.joint_fit import scenes_of_tips

    request = _fit_request(config, surrogate, options)
    if request.other_tips:
        # They need --segment both, of which no map is fitted.
        scenes_of_tips(request)
    reading = _reading_options(options)
    source = map_source.MapSource(curves, reading, options["grid"], options["rows"])
    measured_map = map_source.find_map(source, request, options["as_map"])
    if measured_map is not None and surrogate is not None:
        raise UsageError(
            "--scene SURROGATE: a map is fitted by solutions of its scene",
            "give the scene, or --no-map to fit curve by curve with the surrogate",
        )
    if measured_map is None:
        if wrong := [name for name in ("thickness", "rows") if options[name]]:
            raise UsageError(f"--{wrong[0]} applies only to a map", "leave it out, or add --map")
        return None
    if options["level"] is not None:
        raise UsageError(
            "--level cannot be used: the baselines of a map are fitted",
            "leave --level out, or fit curve by curve with --no-map",
        )
    return map_folder.fit_map_folder(
        measured_map,
        source,
        request,
        output,
        options["thickness"],
        options["jobs"],
        print_progress,
    )


def _print_map(map_fit: MapFit, output: Path, output_format: OutputFormat) -> None:
    """Print the folder of a map; raise NotConverged if no curve was fitted."""
    if not map_fit.entry["map"]["fitted"]:
        raise errors.NotConverged(f"no curve of the map could be fitted: {map_fit.words}")
    if output_format == "json":
        print_done({"directory": output} | map_fit.entry)
    else:
        print_stdout(str(output))


def _fit_request(
    config: Config, surrogate: Surrogate | None, options: Mapping[str, Any]
) -> FitRequest:
    """Return the settings of a fit from the options of the command line."""
    from indent_sim.fitting.curve_fit import FitRequest, keys_of_part
    from indent_sim.fitting.inference.estimate import OriginOptions

    level = options["level"]
    has_slope = options["baseline"] == "tilted" and level is None
    origin = OriginOptions(options["contact_point"], has_slope, level)
    keys = keys_of_part(options["keys"], options["segment"])
    return FitRequest(
        config,
        keys,
        options["segment"],
        origin,
        options["models"],
        options["other_tips"],
        surrogate,
    )


def _fit_curves(
    curves: tuple[Path, ...],
    config: Config,
    surrogate: Surrogate | None,
    output: Path,
    print_progress: Callable[[str], None],
    **options: Any,
) -> CurveFits:
    """Fit curves with the options of the command line."""
    from indent_sim.fitting import fit_folder

    reading = _reading_options(options)
    request = _fit_request(config, surrogate, options)
    return fit_folder.fit_curves(curves, request, output, reading, options["jobs"], print_progress)


def _reading_options(options: Mapping[str, Any]) -> ReadOptions:
    """Return the options for reading curve files from the command-line options."""
    from indent_sim.fitting.fit_folder import ReadOptions
    from indent_sim.results.measured.column_roles import check_requested
    from indent_sim.results.measured.header_calibration import parse_sensitivity

    units = options["units"]
    check_requested(options["columns"])
    kinds = ("length", "force", "time", "deflection")
    if wrong := [kind for kind in units if kind not in kinds]:
        raise UsageError(f"--units {wrong[0]}: choose among length, force, time and deflection")
    if options["sensitivity"] is not None:
        parse_sensitivity(options["sensitivity"])
    return ReadOptions(options["columns"], units, options["sensitivity"])


# Options of the analysis of unloading curves.
epsilon_option = click.option(
    "--epsilon",
    metavar="NUMBER|m",
    default="0.75",
    show_default=True,
    help="Factor epsilon of F_max/S in the contact depth; with m it is the value that "
    "belongs to the fitted exponent.",
)
beta_option = click.option(
    "--beta",
    type=NumberInRange(0.5, 2),
    default=1.0,
    show_default=True,
    help="Factor beta by which the stiffness of a contact that is not circular is larger.",
)
top_option = click.option(
    "--top",
    callback=parse_top,
    metavar="A:B",
    help="Part of unloading that is fitted, in per cent of the largest force [98:40].",
)
frame_compliance_option = click.option(
    "--frame-compliance",
    metavar="NUMBER",
    help="Compliance of the frame, e.g. '0.3 nm/mN'; the deflection of the frame is "
    "subtracted from the depth.",
)
drift_option = click.option(
    "--drift",
    metavar="NUMBER|hold",
    help="Rate of the thermal drift, e.g. '0.05 nm/s', which is subtracted from the depth; "
    "with hold the rate is measured in a hold at 2 to 30 % of the largest force.",
)


@program.command()
@click.argument("curve", metavar="CURVE_OR_RESULT", type=PATH)
@click.option(
    "--scene",
    type=PATH,
    help="Scene from which the tip, the frame and nu of a measured curve are taken.",
)
@click.option(
    "--area",
    metavar="FILE|berkovich|vickers|ANGLE",
    help="Area function: a file with a table of contact depth and area, the name of an ideal "
    "tip, or the half angle of a cone [the tip of the scene, otherwise berkovich].",
)
@epsilon_option
@beta_option
@top_option
@click.option("--nu", type=float, help="Poisson's ratio of the sample [that of the scene, or 0.3].")
@click.option(
    "--tip",
    metavar="diamond|rigid|E,NU",
    help="Young's modulus and Poisson's ratio of the tip, e.g. '400 GPa,0.25' [diamond; for "
    "the result of a run: rigid].",
)
@frame_compliance_option
@drift_option
@columns_option
@units_option
@json_option
def hardness(
    curve: Path,
    scene: Path | None,
    top: tuple[float, float] | None,
    columns: tuple[str, ...],
    units: dict[str, str],
    output_format: OutputFormat,
    **options: Any,
) -> None:
    """Determine hardness and modulus from unloading (Oliver and Pharr). Writes nothing.

    The method is that of ISO 14577. The curve is a file with loading and unloading, or the result
    of a run; for a result, the true contact area and modulus are printed beside those of the
    formulas.
    """
    from indent_sim.config.scene_file import load
    from indent_sim.run import hardness_analysis

    reading = _reading_options({"columns": columns, "units": units, "sensitivity": None})
    request = hardness_analysis.HardnessOptions(
        scene=load(scene) if scene else None,
        top=top or hardness_analysis.DEFAULT_TOP,
        columns=reading.columns,
        units=reading.units,
        **options,
    )
    result = hardness_analysis.analyse(curve, request)
    if output_format == "json":
        return print_done(result.as_json())
    print_stdout(terminal.hardness_text(result))
    for warning in result.warnings:
        print_stderr(f"warning: {warning}")


@program.command()
@click.argument("curves", metavar="CURVE...", nargs=-1, required=True, type=PATH)
@click.option(
    "--sample",
    metavar="E,NU",
    default="72 GPa,0.17",
    show_default=True,
    help="Young's modulus and Poisson's ratio of the sample, by default those of fused silica.",
)
@click.option(
    "--tip",
    metavar="diamond|rigid|E,NU",
    help="Young's modulus and Poisson's ratio of the tip, e.g. '400 GPa,0.25' [diamond].",
)
@epsilon_option
@beta_option
@top_option
@frame_compliance_option
@drift_option
@columns_option
@units_option
@click.option(
    "--output",
    type=PATH,
    required=True,
    help="New file for the table of the area function, which `hardness --area` reads.",
)
@json_option
def calibrate(
    curves: tuple[Path, ...],
    sample: str,
    top: tuple[float, float] | None,
    columns: tuple[str, ...],
    units: dict[str, str],
    output: Path,
    output_format: OutputFormat,
    **options: Any,
) -> None:
    """Determine the area function of a tip from curves of a sample of known modulus.

    The modulus and the contact stiffness of unloading give the contact area of each curve.

    The curves, three or more, have different depths. Give epsilon, beta, frame and drift as they
    are given to `hardness` later.
    """
    from indent_sim.run import hardness_analysis, tip_calibration

    reading = _reading_options({"columns": columns, "units": units, "sensitivity": None})
    request = hardness_analysis.HardnessOptions(
        top=top or hardness_analysis.DEFAULT_TOP,
        columns=reading.columns,
        units=reading.units,
        **options,
    )
    calibration = tip_calibration.calibrate_tip(curves, sample, request)
    try:
        tip_calibration.write_table(calibration, output)
    except OSError as error:
        raise write_error(output, error) from error
    if output_format == "json":
        return print_done({"output": output, **calibration.as_json()})
    print_stdout(terminal.calibration_text(calibration))
    for warning in calibration.warnings:
        print_stderr(f"warning: {warning}")
    print_stdout(str(output))


@program.command()
@click.argument("first", metavar="A", type=PATH)
@click.argument("second", metavar="B", type=PATH)
@click.option(
    "--rtol",
    callback=parse_tolerances,
    metavar="X|COLUMN=X,...",
    default="1e-6",
    show_default=True,
    help="Relative tolerance of all columns, or of single columns, e.g. force=1e-3,a=2e-2.",
)
@click.option(
    "--columns",
    callback=parse_words,
    help="Columns to compare [delta, force, a and the columns that --rtol names].",
)
@json_option
def compare(
    first: Path,
    second: Path,
    rtol: dict[str, float],
    columns: tuple[str, ...],
    output_format: OutputFormat,
) -> None:
    """Compare two results row by row. Exit code 6 if they differ.

    Each of the two may be a measured curve instead of a result. Rows are matched by step, or by
    depth if a table has no steps; if the depths differ, the curve with more rows is interpolated.
    Tables of experiments are compared as well, with rows matched by number.
    """
    from indent_sim.results import compare

    comparison = compare.compare(first, second, rtol, columns or None)
    if output_format == "text":
        print_stdout(terminal.comparison_text(comparison))
    try:
        comparison.check()
    except errors.VerificationError as error:
        error.partial_result = comparison.as_json()
        raise
    if output_format == "json":
        print_done(comparison.as_json())


@program.command()
@click.argument("paths", metavar="RESULT_OR_CURVE...|STUDY", nargs=-1, required=True, type=PATH)
@click.option(
    "--what",
    callback=parse_words,
    help="Panels, separated by commas: force, time, pressure, pressure_x, pressure_y, profile, "
    "hardness, fields, film; for a study one of curves, force, a, p_max, penetration; for a fitted "
    "map modulus, height, interval, cause, histogram.",
)
@click.option(
    "--field",
    "fields",
    callback=parse_words,
    shell_complete=complete_fields,
    help="Fields, separated by commas [von_mises].",
)
@click.option(
    "--steps",
    callback=parse_words,
    help="Steps separated by commas, or last, or all [default: the step of the largest force].",
)
@click.option(
    "--units",
    callback=parse_pairs,
    help="Units of the axes, e.g. length=nm,force=pN,pressure=kPa.",
)
@click.option(
    "--width", type=NumberInRange(30, 1000), metavar="MM", help="Width of the picture in mm."
)
@click.option(
    "--layout",
    callback=parse_layout,
    metavar="ROWSxCOLUMNS",
    help="Arrangement of the panels, e.g. 1x3.",
)
@click.option("--letters", flag_value="a", default="", help="Label the panels (a), (b), ...")
@click.option(
    "--dpi",
    type=NumberInRange(20, 2400),
    metavar="N",
    help="Resolution in dots per inch [160; for a PDF 300].",
)
@click.option(
    "--limits",
    callback=parse_limits,
    metavar="A:B",
    help="Range of the colours of a field or of a pressure, in the unit of the picture.",
)
@click.option(
    "--zoom",
    callback=parse_zoom,
    metavar="X|all",
    help="Half width of the view of a field in contact radii, or 'all' for the whole body.",
)
@click.option(
    "--pixel",
    callback=parse_pixel,
    metavar="ROW,COLUMN",
    help="Draw the curve of one pixel of a fitted map with its fit; rows and columns are "
    "counted from 0.",
)
@click.option(
    "--font-size", "font", type=NumberInRange(4, 40), metavar="PT", help="Font size in points [10]."
)
@click.option(
    "--output",
    type=PATH,
    help="File to write: a picture .png, .svg or .pdf, or the force curve .tab.",
)
def plot(paths: tuple[Path, ...], output: Path | None, **given_options: Any) -> None:
    """Plot finished results and measured curves together, or a study.

    Prints the picture's path.

    Without --what: force, contact radius and pressure of one result, force and contact radius of
    several; for time-dependent bodies, quantities over time; for a study, its curves.

    pressure_x and pressure_y are the pressure on a line through the tip's axis.

    For a study, force, a, p_max and penetration are plotted over the varied keys: over two numbers
    as a map, the penetration over epsilon_n if that is varied.

    Fields: von_mises, principal_1, principal_2, principal_3, sigma_xx (sigma_rr of an axisymmetric
    body), sigma_yy, sigma_zz, sigma_xz, J, energy_density, displacement; with pore fluid
    pore_pressure and fluid_content; for gels swelling; for bodies that yield plastic_strain. A film
    shows several states of one field side by side, spread over the load path.
    """
    from indent_sim.results import reader
    from indent_sim.results.pictures import figures, panels
    from indent_sim.results.result_files import folder_kind

    options = {name: value for name, value in given_options.items() if value}
    if any(path.is_dir() and folder_kind(path) == "study" for path in paths):
        return _plot_study(paths, output, options)
    if len(paths) == 1 and paths[0].is_dir() and folder_kind(paths[0]) == "fit":
        return _plot_map(paths[0], output, options)
    if "pixel" in options:
        raise UsageError(
            "--pixel applies only to the folder of a fitted map", "give one such folder"
        )
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


def _plot_map(folder: Path, output: Path | None, options: dict[str, Any]) -> None:
    """Plot panels of a fitted map."""
    from indent_sim.config.scene_file import config_from_mapping
    from indent_sim.fitting import map_picture, unfinished_map
    from indent_sim.results.pictures import figures

    if unused_options := [name for name in options if name not in ("what", "dpi", "pixel")]:
        raise UsageError(
            f"the picture of a map has no option {unused_options[0]}",
            "its options are --what, --pixel, --dpi and --output",
        )
    if "pixel" in options:
        return _plot_pixel(folder, output, options)
    map_fit = unfinished_map.read_fitted_curves(folder)
    panels = options.get("what", ())
    if output is None:
        output = folder / f"{'-'.join(panels) or 'map'}.png"
        figures.refuse_foreign_picture(output)
    config = config_from_mapping(map_fit.entry["request"]["scene"])
    try:
        map_picture.draw_map(map_fit, config, output, panels, options.get("dpi"))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


def _plot_pixel(folder: Path, output: Path | None, options: dict[str, Any]) -> None:
    """Plot the curve of a pixel of a fitted map with its fit."""
    from indent_sim.fitting import map_pixel
    from indent_sim.results.pictures import figures

    if unused_options := [name for name in options if name != "pixel"]:
        raise UsageError(
            f"--pixel has no option {unused_options[0]}",
            "--pixel can be combined with --output only",
        )
    row, column = options["pixel"]
    if output is None:
        output = folder / f"pixel-{row}-{column}.png"
        figures.refuse_foreign_picture(output)
    pixel = map_pixel.fit_pixel(folder, row, column)
    try:
        pixel.draw(output)
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


def _plot_study(paths: Sequence[Path], output: Path | None, options: dict[str, Any]) -> None:
    """Plot the curves of a study, or a column of its table over the varied keys."""
    from indent_sim.results.pictures import figures
    from indent_sim.results.result_files import RUNS
    from indent_sim.studies import (
        curve_table,
        many_runs,
        small_multiples,
        study_picture,
        study_report,
    )

    if len(paths) > 1:
        raise UsageError(
            "a study cannot be plotted together with other results",
            "give one study, or only folders of runs",
        )
    # Options of `plot` that apply to pictures of a study.
    study_plot_options = ("what", "dpi")
    if unused_options := [name for name in options if name not in study_plot_options]:
        raise UsageError(
            f"the picture of a study has no option {unused_options[0]}",
            "its options are --what, --dpi and --output",
        )
    folder = paths[0]
    panel, *further_panels = options.get("what", ("curves",))
    if further_panels or panel not in ("curves", *small_multiples.PLOTTED_COLUMNS):
        raise UsageError(
            f"--what of a study must be one of curves, {', '.join(small_multiples.PLOTTED_COLUMNS)}"
        )
    if many_runs.is_row_study(folder):
        return _plot_row_study(folder, panel, output, options)
    record, rows = study_report.read_study_folder(folder)
    curve_groups = curve_table.group_folder_curves(folder / RUNS, rows, record["keys"])
    if not curve_groups.curves:
        raise UsageError(f"{folder} has no finished run")
    title = str(record.get("title") or folder.resolve().name)
    if output is None:
        output = folder / f"{panel}.png"
        figures.refuse_foreign_picture(output)
    try:
        with study_picture.requested_figure(curve_groups, panel, title) as figure:
            figures.save(figure, output, options.get("dpi"))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


def _plot_row_study(
    folder: Path, panel: str, output: Path | None, options: Mapping[str, Any]
) -> None:
    """Plot the curves of a study without result folders, or a column over the varied keys."""
    from indent_sim.process.limits import write_error
    from indent_sim.results.pictures import figures
    from indent_sim.studies import many_runs_picture

    if output is None:
        output = folder / f"{panel}.png"
        figures.refuse_foreign_picture(output)
    try:
        many_runs_picture.draw_panel(folder, panel, output, options.get("dpi"))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


def _write_tab(runs: list[Results], options: dict[str, Any], output: Path) -> None:
    """Write the force curve of a result as a .tab file."""
    from indent_sim.results.atomic_files import write_atomically
    from indent_sim.results.measured.tab_file import tab_text

    if options or len(runs) > 1:
        raise UsageError(
            f"{output}: a .tab file contains the force curve of one result",
            "give one result, and no options of pictures",
        )
    try:
        write_atomically(output, tab_text(runs[0]))
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


@program.command()
@click.argument("folder", metavar="RESULT|STUDY|FIT", type=PATH)
@click.option(
    "--output", type=PATH, help="File to write, .html or .htm [report.html in the folder]."
)
@click.option(
    "--crate",
    flag_value="crate",
    default="",
    help="Write ro-crate-metadata.json for archives, too.",
)
def report(folder: Path, output: Path | None, crate: Literal["", "crate"]) -> None:
    """Write an HTML report of a result, a study or a fit. Prints the report's path.

    One file contains the scene, pictures, errors and provenance.
    """
    from indent_sim.results import html_report, research_crate
    from indent_sim.results.result_files import REPORT_PAGE, is_own_file

    if not folder.is_dir():
        raise UsageError(f"{folder} is not the folder of a result, a study or a fit")
    if output is None:
        output = folder / REPORT_PAGE
        if os.path.lexists(output) and not is_own_file(output):
            raise UsageError(
                f"{output} exists and is not a report of indent-sim",
                "choose another name with --output",
            )
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{output}: the name of a report must end in .html or .htm")
    if crate:
        research_crate.refuse_foreign_crate(folder)
    html_report.write(_report_page(folder), output)
    if crate:
        research_crate.write_crate(folder, _own_file_names(folder))
    print_stdout(str(output))


def _own_file_names(folder: Path) -> Sequence[str]:
    """Return the names of this program's files in a folder of results, a study or a fit."""
    from indent_sim.results.result_files import FIELDS_FOLDER, RESULT_FILES, folder_kind

    match folder_kind(folder):
        case "study":
            from indent_sim.studies.study_folder import STUDY_FILES

            return STUDY_FILES
        case "fit":
            from indent_sim.fitting.fit_folder import fit_files

            return fit_files(folder)
    return (*RESULT_FILES, FIELDS_FOLDER)


def _report_page(folder: Path) -> str:
    """Return the HTML report of a folder."""
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

    The file scene.schema.json, with which editors check and complete scenes, is written too if the
    folder has none.
    """
    from importlib.resources import files

    from indent_sim.config.json_schema import json_schema
    from indent_sim.results.atomic_files import write_atomically
    from indent_sim.results.json_text import to_json

    output = output or Path(f"{kind}.yaml")
    if os.path.lexists(output):
        raise UsageError(
            f"{output} exists already and is not replaced", "choose another name with --output"
        )
    template = files("indent_sim.cli") / "templates" / f"{kind}.yaml"
    try:
        write_atomically(output, template.read_bytes())
        # Name of the schema that `init` writes beside a scene, whose first line refers to it.
        schema_file = "scene.schema.json"
        schema_path = output.parent / schema_file
        if kind != "study" and not os.path.lexists(schema_path):
            write_atomically(schema_path, to_json(json_schema()) + "\n")
    except OSError as error:
        raise write_error(output, error) from error
    print_stdout(str(output))


@program.command("list")
@click.argument("kind", type=click.Choice(list(LISTED_SECTIONS)), required=False)
def list_(kind: str | None) -> None:
    """List the possible parts of a scene, with their parameters and units."""
    kinds = [kind] if kind else list(LISTED_SECTIONS)
    print_stdout(
        "\n\n".join(f"{name}\n{terminal.section_text(LISTED_SECTIONS[name])}" for name in kinds)
    )


@program.command()
def schema() -> None:
    """Print the JSON Schema of the scene file, for editors."""
    from indent_sim.config.json_schema import json_schema

    print_json(json_schema())


@program.command()
@json_option
def doctor(output_format: OutputFormat) -> None:
    """Check the installation. Exit code 7 if a needed part is missing or broken."""
    from indent_sim.cli import doctor as health

    checks = health.check_installation()
    broken = [check.name for check in checks if check.verdict == "broken"]
    if output_format == "text":
        print_stdout("\n".join(map(str, checks)))
    if broken:
        error = errors.BackendError(f"missing or broken: {', '.join(broken)}")
        error.partial_result = {"checks": checks}
        raise error
    if output_format == "json":
        print_done({"checks": checks})


def main() -> None:
    """Run the program as a console script."""
    program(prog_name="indent-sim")


def _start_mesher(load_config: Callable[[], Config]) -> bool:
    """Start the mesher process on rank 0, before MPI is imported; return whether MPI is needed.

    A scene that is solved by theory on a single rank needs no mesher and no MPI.
    """
    from indent_sim.process.ranks import is_parallel, is_root
    from indent_sim.run.planned_run import start_mesher_if_needed

    return not is_root() or start_mesher_if_needed(load_config) or is_parallel()


def _world_communicator() -> Any:
    """Start MPI and return the communicator of all ranks."""
    from indent_sim.run.pipeline import mpi

    return mpi().COMM_WORLD


def _refuse_parallel_run() -> None:
    """Raise UsageError under mpirun for commands that run on one rank."""
    from indent_sim.process.ranks import is_parallel

    if is_parallel():
        with abort_all_ranks_together(_world_communicator()):
            raise UsageError(
                "this command runs on one rank only",
                "start it without mpirun; a study can be split with --shard",
            )


@contextmanager
def abort_all_ranks_together(comm: Any) -> Iterator[None]:
    """End all ranks with the same exit code if one fails, and print one message.

    The message is from rank 0, or, if rank 0 does not fail, from the rank that fails. A rank that
    fails alone, by a bug or a signal, aborts all ranks.
    """
    consensus = FailureConsensus(comm)
    try:
        yield
    except BaseException as error:
        if comm.size == 1:
            raise
        is_interrupted = isinstance(error, KeyboardInterrupt)
        # The message comes first, because mpirun may kill this process at any time.
        code = getattr(error, "exit_code", 1) if comm.rank else report_failure(error)
        # After an interrupt rank 0 does not wait for the others: its files are closed, and it ends
        # all ranks.
        if (
            (comm.rank or not is_interrupted)
            and consensus.all_ranks_failed()
            and not is_interrupted
        ):
            raise click.exceptions.Exit(code) from error
        comm.Abort(report_failure(error) if comm.rank else code)


def _simulate(
    settings: Config, comm: Any, directory: Path, verbosity: Verbosity, **options: Any
) -> Outcome:
    """Simulate a scene with progress on stderr; print the result folder after a failure."""
    from indent_sim.run.pipeline import simulate as simulate

    progress_context: AbstractContextManager[Any] = nullcontext()
    if comm.rank == 0 and verbosity == "all":
        progress_context = terminal.show_progress(print_stderr, settings)
    log_level = logging.ERROR if comm.rank else LOG_LEVELS[verbosity]
    try:
        with progress_context as show_progress, _quiet_libraries(log_level):

            def handle_row(state: Any, step: int, total: int) -> None:
                raise_pending_signal()
                if show_progress is not None:
                    show_progress(state, step, total)

            return simulate(settings, comm, directory=directory, progress=handle_row, **options)
    except (IndentSimError, KeyboardInterrupt) as error:
        # Errors of usage and config are raised before anything is computed.
        if comm.rank == 0 and not isinstance(error, UsageError | ConfigError):
            _report_kept_rows(directory, error)
        raise


@contextmanager
def _quiet_libraries(level: int) -> Iterator[None]:
    """Print messages of the program from a level on, and warnings of libraries, to stderr."""
    own_logger = logging.getLogger("indent_sim")
    root_logger = logging.getLogger()
    own_handler = StderrHandler(logging.INFO)
    library_handler = StderrHandler(logging.WARNING)
    old_settings = own_logger.level, own_logger.propagate
    own_logger.setLevel(level)
    own_logger.propagate = False
    own_logger.addHandler(own_handler)
    # A library that calls `logging.info` would install a handler that prints all messages.
    root_logger.addHandler(library_handler)
    try:
        yield
    finally:
        root_logger.removeHandler(library_handler)
        own_logger.removeHandler(own_handler)
        own_logger.level, own_logger.propagate = old_settings


class StderrHandler(logging.Handler):
    """Log handler that prints to stderr; messages of libraries begin with the library's name."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        logger_name = "" if record.name == "indent_sim" else f"{record.name}: "
        print_stderr(f"{logger_name}{record.getMessage()}")


def _report_kept_rows(directory: Path, error: BaseException) -> None:
    """Print the folder of a failed run's rows, or that an earlier finished run is unchanged."""
    from indent_sim.results.result_files import read_report

    report = read_report(directory)
    if report.get("status") == "done":
        print_stderr(f"the finished run in {directory} is unchanged")
    if report.get("status") in ("failed", "interrupted") and report.get("rows"):
        can_resume = not isinstance(error, errors.VerificationError)
        resume_hint = "; --resume continues from there" if can_resume else ""
        print_stderr(f"{report['rows']} rows computed before are kept in {directory}{resume_hint}")


def _print_conclusion(outcome: Outcome, output_format: OutputFormat, verbosity: Verbosity) -> None:
    """Print the result of a run to stdout, and final remarks or only warnings to stderr."""
    from indent_sim.results.reader import has_reactions, rows_of
    from indent_sim.results.result_files import read_report

    if output_format == "json":
        # run.json also has the entries of the writer, such as the status and the files.
        report = read_report(outcome.directory) | outcome.report
        rows = rows_of(outcome.states, has_reactions(outcome.directory))
        print_done({"directory": outcome.directory, "rows": rows, "report": report})
    else:
        print_stdout(str(outcome.directory))
    lines_of = terminal.conclusion_lines if verbosity == "all" else terminal.warning_lines
    for line in lines_of(outcome):
        print_stderr(line)


def _is_study(path: Path) -> bool:
    """Return whether a file contains a study; False if it cannot be read.

    The error is then reported when the file is read as a scene.
    """
    from indent_sim.config.scene_file import is_study, read_document

    with suppress(IndentSimError):
        return is_study(read_document(path)[0])
    return False


def _plan_study(
    path: Path, overrides: tuple[str, ...], error_bars: bool, output_format: OutputFormat
) -> None:
    """Print the runs of a study and their cost."""
    if overrides:
        raise UsageError(
            "--set applies only to a scene", "in a study, give the keys in its section set"
        )
    from indent_sim import studies

    planned = studies.plan_study(path, error_bars)
    if output_format == "json":
        print_done(planned.as_json())
    else:
        print_stdout(terminal.study_plan_text(planned))
    for line in planned.notes:
        print_stderr(line)


def _terminal_width() -> int:
    """Return the number of columns of the terminal; 120 if stdout is not a terminal."""
    import shutil

    return shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 120


if __name__ == "__main__":
    main()
