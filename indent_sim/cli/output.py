"""Output of commands: results on stdout as text or JSON, messages and failures on stderr."""

from __future__ import annotations

import os
import traceback
from contextlib import suppress
from typing import Any, Literal, NoReturn

import click

from indent_sim.process import errors
from indent_sim.process.errors import ConfigError, IndentSimError, UsageError, printable

# Format of the result on stdout.
OutputFormat = Literal["text", "json"]
# Key of the output format in click's context. It is json if --json was given, also to a command
# that has no such option.
FORMAT_KEY = "indent_sim.output_format"


def exit_with_usage_error(error: click.ClickException, output_format: OutputFormat) -> NoReturn:
    """Exit as click does after an invalid option, with a JSON object if requested."""
    if output_format == "json":
        print_failure(error, error.exit_code, UsageError.__name__)
    error.show()
    raise click.exceptions.Exit(error.exit_code) from error


def report_failure(error: BaseException) -> int:
    """Print a failure to stderr and, with --json, to stdout; return the exit code."""
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
    """Print a value as JSON to stdout."""
    from indent_sim.results.json_text import to_json

    print_stdout(to_json(value))


def print_done(entries: dict[str, Any]) -> None:
    """Print the JSON object of a command that succeeded."""
    print_json({"status": "done", "exit_code": 0} | entries)


def print_failure(error: BaseException, code: int, kind: str) -> None:
    """Print the JSON object of a command that failed, with its partial result if there is one.

    `code` is the exit code of the command, `kind` the type of the error.
    """
    status = "interrupted" if code > 128 else "failed"
    failure = {
        "status": status,
        "exit_code": code,
        "error": error_as_json(error, kind),
        **getattr(error, "partial_result", {}),
    }
    if isinstance(error, errors.ConfigErrors):
        failure["errors"] = [error_as_json(part, kind) for part in error.errors]
    # If the object cannot be written, e.g. to a full disk, the exit code still reports the failure.
    with suppress(errors.NotConverged):
        print_json(failure)


def error_as_json(error: BaseException, kind: str) -> dict[str, Any]:
    """Return an error for JSON: type, message, and, if known, position and remedy."""
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
    """Print to stdout; a closed pipe is ignored, a full disk is an error."""
    try:
        with suppress(UnicodeEncodeError):
            return click.echo(text)
        # The name of a folder may contain bytes that are not UTF-8.
        click.echo(os.fsencode(text))
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            raise errors.NotConverged(
                f"cannot write to stdout: {error.strerror or error}"
            ) from error


def print_stderr(text: str) -> None:
    """Print to stderr; a closed pipe and a full disk are ignored.

    Control characters, which file names and titles may contain, are printed in escaped form.
    """
    try:
        click.echo(printable(text, line_breaks=True), err=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
