"""The command line: the only place that ends the process or names COMM_WORLD.

stdout carries the result, everything else goes to stderr; under MPI rank 0 alone speaks and all ranks end
with the same exit code. Heavy imports wait inside the commands.
"""

from __future__ import annotations

import logging
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from indent_sim.process.errors import (
    BackendError,
    ConfigError,
    ConfigErrors,
    IndentSimError,
    NotConverged,
    UsageError,
    VerificationError,
    printable,
)
from indent_sim.process.limits import require_room, spent
from indent_sim.process.ranks import Alone, Meeting
from indent_sim.process.signals import check, stoppable
from indent_sim.process.version import VERSION

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.model.state import State
    from indent_sim.run.chain import Outcome
    from indent_sim.scene.scene import Scene


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # more only slow these sizes down
KINDS = {"materials": "material", "indenters": "indenter", "contact": "contact", "bodies": "body"}
TEMPLATES = ("cell", "gel", "film", "nanoindentation", "rubber", "study")
AS_JSON = "indent_sim.as_json"  # in click's context: whether --json was given, also where the command refuses it
DONE = {"status": "done", "exit_code": 0}  # first entries of a JSON object
BUG = "this is a bug in indent-sim; please report it with the traceback above"


class Program(click.Group):
    """The commands, with every way to end turned into its message and exit code."""

    def main(self, *args: Any, **options: Any) -> Any:
        """One BLAS thread unless the user says otherwise; must be said before numpy is loaded."""
        for name in THREADS:
            os.environ.setdefault(name, "1")
        _open_closed_streams()
        return super().main(*args, **options)

    def make_context(self, info_name: str | None, args: list[str], *rest: Any, **extra: Any) -> click.Context:
        """Read the words before the command."""
        as_json = "--json" in (args[: args.index("--")] if "--" in args else args)
        try:
            ctx = super().make_context(info_name, args, *rest, **extra)
        except click.ClickException as error:
            refuse(error, as_json)
        ctx.meta[AS_JSON] = as_json
        return ctx

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; expected failures speak for themselves, others leave a traceback."""
        try:
            with spent():
                return super().invoke(ctx)
        except click.ClickException as error:
            refuse(error, ctx.meta[AS_JSON])
        except (click.exceptions.Exit, click.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            ctx.exit(explain(error))


def _open_closed_streams() -> None:
    """Libraries take stdin, stdout and stderr for granted; one that the shell closed becomes /dev/null."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


def refuse(error: click.ClickException, as_json: bool) -> NoReturn:
    """End as click does after a word or option that is none, with a JSON object where one was asked for."""
    if as_json:
        say_failure(error, error.exit_code, UsageError.__name__)
    error.show()
    raise click.exceptions.Exit(error.exit_code) from error


def explain(error: BaseException) -> int:
    """Say why the program ends, on stderr and, with --json, in an object on stdout; returns the exit code."""
    code = getattr(error, "exit_code", 130 if isinstance(error, KeyboardInterrupt) else 1)
    if isinstance(error, KeyboardInterrupt):
        tell(str(error) or "interrupted")
    elif isinstance(error, IndentSimError):
        tell(str(error) if isinstance(error, ConfigError) else f"error: {error}")
    else:
        tell("".join(traceback.format_exception(error)) + BUG)
    ctx = click.get_current_context(silent=True)
    if ctx is not None and ctx.meta.get(AS_JSON):
        say_failure(error, code, type(error).__name__)
    return int(code)


def say_failure(error: BaseException, code: int, kind: str) -> None:
    """The JSON object of a command that failed; what it found before (`beside`) stands in it too."""
    from indent_sim.results.writer import to_json

    status = "interrupted" if code > 128 else "failed"
    found = {"status": status, "exit_code": code, "error": described(error, kind), **getattr(error, "beside", {})}
    if isinstance(error, ConfigErrors):
        found["errors"] = [described(one, kind) for one in error.errors]
    with suppress(NotConverged):  # a full disk: the exit code tells
        say(to_json(found))


def described(error: BaseException, kind: str) -> dict[str, Any]:
    """An error as JSON: type, message, and for one of config or usage where it is and what would be right, if known."""
    message = error.format_message() if isinstance(error, click.ClickException) else str(error)
    place: dict[str, Any] = dict.fromkeys(("file", "line", "key", "remedy"))
    if isinstance(error, ConfigError | UsageError):
        message = printable(error.problem)
        place = {name: getattr(error, name, None) or None for name in place}
    return {"type": kind.removesuffix("s") if kind == "ConfigErrors" else kind, "message": message, **place}


def say(text: str) -> None:
    """Print to stdout; that nobody listens any more is no error, that it is lost for lack of space is one."""
    try:
        click.echo(text)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            raise NotConverged(f"cannot write to stdout: {error.strerror or error}") from error


def tell(text: str) -> None:
    """Print to stderr; that nobody listens any more, or that it fills a disk, is no error.

    File names and titles are in it: what would control the terminal is shown, not sent.
    """
    try:
        click.echo(printable(text, line_breaks=True), err=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


class Number(click.FloatRange):
    """A number in a range; NaN, which compares with nothing, is in none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number of a word."""
        number: float = super().convert(value, param, ctx)
        return number if number == number else self.fail(f"'{value}' is not a number.", param, ctx)


set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace one key, e.g. contact.method=penalty.",
)


def _shard(ctx: click.Context, option: click.Parameter, text: str | None) -> tuple[int, int] | None:
    """I/N as two numbers."""
    if text is None:
        return None
    part, slash, parts = text.partition("/")
    if not (slash and part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise click.BadParameter(f"'{text}' is not I/N with 1 <= I <= N, for example 2/8")
    return int(part), int(parts)


def _words(ctx: click.Context, option: click.Parameter, text: str | None) -> tuple[str, ...]:
    """Words with commas between them."""
    words = tuple(word.strip() for word in (text or "").split(",")) if text is not None else ()
    if not all(words):
        raise click.BadParameter(f"'{text}' holds an empty word")
    return words


def _pairs(ctx: click.Context, option: click.Parameter, text: str | None) -> dict[str, str]:
    """NAME=VALUE with commas between them."""
    pairs = [word.partition("=") for word in _words(ctx, option, text)]
    if wrong := next((name for name, equals, value in pairs if not (name.strip() and equals and value.strip())), None):
        raise click.BadParameter(f"'{wrong}' is not NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _tolerances(ctx: click.Context, option: click.Parameter, text: str) -> dict[str, float]:
    """X for all columns, under "", and COLUMN=X for one."""
    found: dict[str, float] = {}
    for word in _words(ctx, option, text):
        name, _, value = word.rpartition("=")
        try:
            found[name.strip()] = tolerance = float(value)
        except ValueError:
            raise click.BadParameter(f"'{word}' is not a number, nor COLUMN=NUMBER") from None
        if not 0 <= tolerance <= 1:
            raise click.BadParameter(f"'{word}' is not in the range from 0 to 1")
    return found


quiet_option = click.option("--quiet", is_flag=True, help="Warnings and errors alone on stderr, no progress.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="indent-sim")
def program() -> None:
    """Press rigid indenters into soft bodies and report the force."""


@program.command()
@click.argument("config", type=click.Path(path_type=Path))
@set_option
@click.option("--output", type=click.Path(path_type=Path), help="Result folder [results/<CONFIG's stem>].")
@click.option("--resume", is_flag=True, help="Go on with a run that was stopped; a finished one stays as it is.")
@click.option("--error-bars", is_flag=True, help="Estimate the error of every force, from two coarser meshes.")
@quiet_option
@json_option
def run(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool, as_json: bool, **how: bool) -> None:
    """Simulate one scene; also under mpirun. Prints the result folder."""
    with stoppable():
        require_room()
        from indent_sim.config.file import load
        from indent_sim.process.ranks import on_root

        read = cache(partial(load, config, overrides))
        comm = _world() if _starts_mesher(read) else Alone()
    with together(comm), stoppable(comm.rank):
        settings = comm.bcast(on_root(comm, read))
        directory = output or Path(settings.output.directory or Path("results") / config.stem)
        outcome = _simulate(settings, comm, directory, quiet, **how)
    if comm.rank == 0:
        _conclude(outcome, as_json, quiet)


@program.command()
@click.argument("file", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("--resume", is_flag=True, help="Keep the runs that have ended, do the others.")
@click.option("--shard", callback=_shard, metavar="I/N", help="Do only every N-th run, from the I-th on; no table.")
@click.option("--jobs", type=click.IntRange(1, 1000), default=1, metavar="N", help="Runs at the same time [1].")
@click.option("--output", type=click.Path(path_type=Path), help="Folder of the study [results/<STUDY's stem>].")
@quiet_option
@json_option
def study(file: Path, quiet: bool, as_json: bool, **how: Any) -> None:
    """Vary one scene: many runs, one table of what accuracy costs. Prints the folder."""
    _refuse_ranks()
    require_room()
    from indent_sim import study as studies
    from indent_sim.results.writer import to_json

    with _quiet_libraries(_level(0, quiet)), stoppable():
        done = studies.carry_out(file, tell=(lambda line: None) if quiet else tell, **how)
    say(to_json(DONE | studies.as_json(done)) if as_json else str(done.directory))
    for line in () if quiet else (*done.notes, *done.recommendations):
        tell(line)
    if done.failures:
        tell(f"{len(done.failures)} of {len(done.rows)} runs failed; their rows say why")


@program.command()
@click.argument("config", type=click.Path(path_type=Path))
@set_option
@json_option
def plan(config: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Say what would be modelled, and why; of a study its runs and what they cost. Writes nothing."""
    if _is_study(config):
        return _plan_study(config, overrides, as_json)
    scene = _resolved(config, overrides)
    if as_json:
        from indent_sim.results.writer import to_json

        parts = ("title", "units", "choices", "prediction", "stick", "friction", "adhesion", "warnings")
        say(to_json(DONE | {name: getattr(scene.plan, name) for name in parts}))
        return
    from indent_sim.cli import terminal

    say(terminal.plan(scene, _width()))
    if scene.plan.stick and scene.plan.stick.is_telling:
        say(scene.plan.stick.words)
    if scene.plan.friction:
        from indent_sim.scene.expected import rubbed_words

        say(rubbed_words(scene.physics.contact.friction, scene.plan.friction))
    for warning in scene.plan.warnings:
        tell(f"warning: {warning}")


@program.command()
@click.argument("config", type=click.Path(path_type=Path))
@set_option
@click.option("--within", type=Number(0, 1, min_open=True, max_open=True), default=0.01, show_default=True,
              help="Relative error of the force that is accepted.")  # fmt: skip
@json_option
def require(config: Path, overrides: tuple[str, ...], within: float, as_json: bool) -> None:
    """Say what a scene requires: every effect in per cent of the force. Writes nothing.

    Ends with the cheapest model within the tolerance, as a scene that runs as it is.
    """
    _refuse_ranks()
    require_room()
    from indent_sim.config.file import load
    from indent_sim.results.writer import to_json
    from indent_sim.run.requirements import cheapest

    with _quiet_libraries(logging.ERROR), stoppable():
        found = cheapest.require(load(config, overrides), within)
    if as_json:
        return say(to_json(DONE | found.as_json()))
    from indent_sim.cli import terminal

    say(terminal.requirements(found, _width()))


@program.command()
@click.argument("first", metavar="A", type=click.Path(path_type=Path))
@click.argument("second", metavar="B", type=click.Path(path_type=Path))
@click.option("--rtol", callback=_tolerances, metavar="X|COLUMN=X,...", default="1e-6", show_default=True,
              help="Relative tolerance, of all columns or of each, e.g. force=1e-3,a=2e-2.")  # fmt: skip
@click.option("--columns", callback=_words, help="Columns to compare [delta,force,a and those of --rtol].")
@json_option
def compare(first: Path, second: Path, rtol: dict[str, float], columns: tuple[str, ...], as_json: bool) -> None:
    """Compare two results row by row. Exit code 6 when they differ.

    Rows are matched by step, or by depth where a table has no steps; those of an experiment, which of two results are
    compared as well, by number.
    """
    from indent_sim.cli import terminal
    from indent_sim.results import compare
    from indent_sim.results.writer import to_json

    comparison = compare.compare(first, second, rtol, columns or None)
    if not as_json:
        say(terminal.comparison(comparison))
    try:
        comparison.check()
    except VerificationError as different:
        different.beside = comparison.as_json()
        raise
    if as_json:
        say(to_json(DONE | comparison.as_json()))


@program.command()
@click.argument("paths", metavar="RESULT...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--what", callback=_words, help="Panels: force, pressure, profile, fields; several with commas.")
@click.option("--field", "fields", callback=_words, help="Fields, with commas [von_mises].")
@click.option("--steps", callback=_words, help="Steps with commas, last or all [that of the largest force].")
@click.option("--units", callback=_pairs, help="Units shown, e.g. length=nm,force=pN,pressure=kPa.")
@click.option("--width", type=Number(30, 1000), metavar="MM", help="Width of the picture in mm.")
@click.option("--font-size", "font", type=Number(4, 40), metavar="PT", help="Font size in points [10].")
@click.option("--output", type=click.Path(path_type=Path), help="Picture to write: .png, .svg or .pdf.")
def plot(paths: tuple[Path, ...], output: Path | None, **wish: Any) -> None:
    """Draw finished results over one another. Prints the picture's path.

    \b
    Without --what: force, contact radius and pressure of one result, force and contact radius of several.
    Fields: von_mises, principal_1, principal_2, principal_3, sigma_xx (of a body of revolution rr),
    sigma_yy, sigma_zz, sigma_xz, J, energy_density, displacement.
    """
    from indent_sim.results import reader
    from indent_sim.results.pictures import canvas, forces, panels

    given = {name: value for name, value in wish.items() if value}
    wanted = panels.wish(given) if given else None
    runs = [reader.read(path) for path in paths]
    if output is None:
        first = paths[0] if paths[0].is_dir() else paths[0].parent
        output = (first if len(paths) == 1 else Path()) / (wanted.name if wanted else canvas.PICTURE)
        canvas.refuse_foreign(output)
    try:
        panels.draw(runs, wanted, output) if wanted else forces.overlay(runs, output)
    except OSError as error:
        raise UsageError(f"cannot write {output}: {error.strerror or error}") from error
    say(str(output))


@program.command()
@click.argument("folder", metavar="RESULT|STUDY", type=click.Path(path_type=Path))
@click.option("--output", type=click.Path(path_type=Path), help="File to write, .html or .htm [report.html in it].")
def report(folder: Path, output: Path | None) -> None:
    """Write one HTML file about a result or a study: scene, choices, pictures, errors, provenance. Prints its path."""
    from indent_sim.results import report as reports
    from indent_sim.study import folder as studies
    from indent_sim.study.report import of_study

    if not folder.is_dir():
        raise UsageError(f"{folder} is no folder of a result or a study")
    output = output or folder / reports.NAME
    if output.suffix.lower() not in reports.FORMATS:
        raise UsageError(f"{output}: a report ends in {', '.join(reports.FORMATS)}")
    reports.write(of_study(folder) if (folder / studies.RECORD).exists() else reports.of_run(folder), output)
    say(str(output))


@program.command()
@click.argument("kind", type=click.Choice(TEMPLATES), default=TEMPLATES[0], metavar=f"[{'|'.join(TEMPLATES)}]")
@click.option("--output", type=click.Path(path_type=Path), help="File to write [KIND.yaml].")
def init(kind: str, output: Path | None) -> None:
    """Write a commented scene or study to start from. Prints the file's name."""
    from importlib.resources import files

    output = output or Path(f"{kind}.yaml")
    text = (files("indent_sim.cli") / "templates" / f"{kind}.yaml").read_text(encoding="utf-8")
    try:
        with open(output, "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise UsageError(f"{output} is there already and stays as it is; choose another name with --output") from None
    except OSError as error:
        raise UsageError(f"cannot write {output}: {error.strerror or error}") from error
    say(str(output))


@program.command("list")
@click.argument("kind", type=click.Choice(list(KINDS)), required=False)
def list_(kind: str | None) -> None:
    """What a scene can be made of, with parameters and units."""
    from indent_sim.cli import terminal

    kinds = [kind] if kind else list(KINDS)
    say("\n\n".join(f"{name}\n{terminal.alternatives(KINDS[name])}" for name in kinds))


@program.command()
def schema() -> None:
    """JSON Schema of the scene file, for editors."""
    from indent_sim.config.reference import json_schema
    from indent_sim.results.writer import to_json

    say(to_json(json_schema()))


@program.command()
@json_option
def doctor(as_json: bool) -> None:
    """Versions and health of the installation. Exit code 7 when something needed is broken."""
    from indent_sim.cli import doctor as health
    from indent_sim.results.writer import to_json

    checks = health.examine()
    broken = [check.name for check in checks if check.verdict == "broken"]
    if not as_json:
        say("\n".join(map(str, checks)))
    elif not broken:
        say(to_json(DONE | {"checks": checks}))
    if broken:
        error = BackendError(f"missing or broken: {', '.join(broken)}")
        error.beside = {"checks": checks}
        raise error


def main() -> None:
    """The console script."""
    program(prog_name="indent-sim")


# ---- one run, on all ranks ---------------------------------------------------------------------------------


def _starts_mesher(read: Callable[[], Config]) -> bool:
    """Fork the process that meshes on rank 0: before MPI is up, and gmsh starts while MPI and dolfinx do.

    Returns whether the others are to be met: not by a process without others whose scene theory solves. What is wrong
    with the config is said later, by all ranks.
    """
    from indent_sim.mesh import gmsh
    from indent_sim.process.ranks import is_first, is_one_of_several
    from indent_sim.scene.choices import needs_mesh

    with suppress(IndentSimError):
        if is_first() and not needs_mesh(read()):
            return is_one_of_several()
    if is_first():
        gmsh.start()
    return True


def _world() -> Any:
    from indent_sim.run.chain import mpi

    return mpi().COMM_WORLD


def _refuse_ranks() -> None:
    """A study forks its runs off, which a process that takes part in MPI must not do; so only mpirun is asked."""
    from indent_sim.process.ranks import is_one_of_several

    if is_one_of_several():
        with together(_world()):
            raise UsageError("a study runs on one rank; start it without mpirun, and split it with --shard")


@contextmanager
def together(comm: Any) -> Iterator[None]:
    """All ranks leave the block with the same exit code, and one says why: rank 0, or who fails where it does not.

    A rank that fails where the others do not (a bug, a signal) takes them all down.
    """
    meeting = Meeting(comm)
    try:
        yield
    except BaseException as error:
        if comm.size == 1:
            raise
        stopped = isinstance(error, KeyboardInterrupt)  # rank 0 closes its files and ends all
        code = getattr(error, "exit_code", 1) if comm.rank else explain(error)  # at once: mpirun kills
        if (comm.rank or not stopped) and meeting.all_arrive() and not stopped:
            raise click.exceptions.Exit(code) from error
        comm.Abort(explain(error) if comm.rank else code)


def _simulate(settings: Config, comm: Any, directory: Path, quiet: bool, **how: bool) -> Outcome:
    from indent_sim.cli import terminal
    from indent_sim.run.chain import simulate as simulate

    shown: Callable[..., Any] = terminal.progress if comm.rank == 0 and not quiet else terminal.silence
    try:
        with shown(tell) as show, _quiet_libraries(_level(comm.rank, quiet)):

            def follow(state: State, step: int, total: int) -> None:
                check()
                if show is not None:
                    show(state, step, total)

            return simulate(settings, comm, directory=directory, progress=follow, **how)
    except (IndentSimError, KeyboardInterrupt) as end:
        if comm.rank == 0 and not isinstance(end, UsageError | ConfigError):  # those refuse and compute nothing
            _name_partial(directory)
        raise


def _level(rank: int, quiet: bool) -> int:
    """How much of our own messages is told: rank 0 speaks for all."""
    return logging.ERROR if rank else logging.WARNING if quiet else logging.INFO


@contextmanager
def _quiet_libraries(level: int) -> Iterator[None]:
    """Our own messages and the warnings of others go to stderr; what compilers and their like say of their work not.

    Without a handler of the root logger, libraries that call `logging.info` would install one that prints it all.
    """
    ours, root = logging.getLogger("indent_sim"), logging.getLogger()
    told, warned = Teller(logging.INFO), Teller(logging.WARNING)
    before = ours.level, ours.propagate
    ours.setLevel(level)
    ours.propagate = False
    ours.addHandler(told)
    root.addHandler(warned)
    try:
        yield
    finally:
        root.removeHandler(warned)
        ours.removeHandler(told)
        ours.level, ours.propagate = before


class Teller(logging.Handler):
    """A logger's messages on stderr, those of libraries with their name."""

    def emit(self, record: logging.LogRecord) -> None:
        """Tell one message."""
        of = "" if record.name == "indent_sim" else f"{record.name}: "
        tell(f"{of}{record.getMessage()}")


def _name_partial(directory: Path) -> None:
    """Where the rows of a run that failed are."""
    from indent_sim.results.folder import read_report

    if (report := read_report(directory)).get("status") in ("failed", "interrupted") and report.get("rows"):
        again = "" if report["exit_code"] == VerificationError.exit_code else "; --resume goes on from them"
        tell(f"{report['rows']} rows computed before are kept in {directory}{again}")


def _conclude(outcome: Outcome, as_json: bool, quiet: bool) -> None:
    from indent_sim.cli import terminal
    from indent_sim.results.folder import read_report
    from indent_sim.results.reader import rows_of
    from indent_sim.results.writer import to_json

    if as_json:
        rows, written = rows_of(outcome.states), read_report(outcome.directory)  # with the entries of the writer
        say(to_json(DONE | {"directory": outcome.directory, "rows": rows, "report": written | outcome.report}))
    else:
        say(str(outcome.directory))
    for line in terminal.warnings(outcome) if quiet else terminal.conclusion(outcome):
        tell(line)


def _is_study(path: Path) -> bool:
    """Whether a file holds a study; False for what cannot be read, which is told when it is read as a scene."""
    from indent_sim.config.file import OF_A_STUDY, read_document

    with suppress(IndentSimError):
        return read_document(path)[0].keys() >= OF_A_STUDY
    return False


def _plan_study(path: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    if overrides:
        raise UsageError("--set belongs to a scene; a study has set: in its file")
    from indent_sim import study as studies
    from indent_sim.cli import terminal
    from indent_sim.results.writer import to_json

    planned = studies.plan(path)
    say(to_json(DONE | planned.as_json()) if as_json else terminal.study_plan(planned))
    for line in planned.notes:
        tell(line)


def _resolved(config: Path, overrides: tuple[str, ...]) -> Scene:
    from indent_sim.config.file import load, located
    from indent_sim.scene.scene import resolve

    settings = load(config, overrides)
    try:
        return resolve(settings)
    except ConfigError as error:
        raise located(settings, error) from None


def _width() -> int:
    """Columns of the terminal; enough for whole lines when there is none."""
    import shutil

    return shutil.get_terminal_size((120, 24)).columns if sys.stdout.isatty() else 120


if __name__ == "__main__":
    main()
