"""Rows of a previous run in a result folder, from which `--resume` continues."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import load, to_yaml
from indent_sim.config.schema import REMOVED_KEYS
from indent_sim.config.strict_yaml import KeyPath, inline_yaml, key_text, leaf_values, parse
from indent_sim.model.state import SLIDE_COLUMNS, STATE_COLUMNS, State
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results import result_files, tables
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.field_reader import missing_field_files
from indent_sim.results.reader import OPTIONAL_COLUMNS, RUN_AGAIN_REMEDY, read
from indent_sim.results.report_schema import checked_report
from indent_sim.results.result_files import CONFIG, REPORT, TABLE, KeptStates, Report, has_rows
from indent_sim.results.tables import SURFACE, parse_state


@dataclass(frozen=True)
class PreviousRun:
    """Rows of a previous run, and the length of their part of the force table.

    Attributes
    ----------
    states
        One state per complete row, in order.
    columns
        Columns of the force table.
    table_bytes
        Length of the table up to the last complete row [bytes].
    report
        The run.json of the previous run.
    """

    states: tuple[State, ...]
    columns: tuple[str, ...]
    table_bytes: int
    report: Report

    def check(self, deltas: Sequence[float] | None, steps: int, folder: Path) -> None:
        """Check that the rows belong to a load path.

        Parameters
        ----------
        deltas
            Prescribed depths [length], or None if they are not prescribed.
        steps
            Number of steps of the load path.
        folder
            The result folder, for the message.

        Raises
        ------
        UsageError
            If there are more rows than steps, or a row is at another depth.
        """
        table = str(folder / TABLE)
        problems = []
        if len(self.states) > steps:
            problems.append(f" has {len(self.states)} rows, but the scene has {steps} steps")
        # Depths within this relative tolerance are the same.
        same_depth_rtol = 1e-9
        for state, delta in zip(self.states, deltas or (), strict=False):
            if not math.isclose(state.delta, delta, rel_tol=same_depth_rtol, abs_tol=0):
                problems.append(f": row {state.step} is not at the scene's depth")
        if problems:
            raise UsageError(f"{table}{problems[0]}: it is damaged", RUN_AGAIN_REMEDY, table)


def resumable_report(folder: Path) -> Report:
    """Return the run.json of a run that `--resume` can continue; empty if it has no rows."""
    report = checked_report(folder)
    return report if report and (has_rows(folder) or report.get("rows")) else {}


def previous_run(
    folder: Path, config_yaml: str, report: Report | None = None
) -> PreviousRun | None:
    """Read the previous run of a config in a folder.

    Parameters
    ----------
    folder
        The result folder.
    config_yaml
        The resolved scene of the new run.
    report
        The run.json of the new run, in which `plan.auto` lists the keys that were auto.

    Returns
    -------
    PreviousRun or None
        None if the folder has no rows.

    Raises
    ------
    ConfigError
        If the folder contains a run of another config.
    UsageError
        If the rows cannot be read.
    """
    old_report = resumable_report(folder)
    if not old_report:
        return None
    try:
        result_files.refuse_links(folder)
        automatic_keys = set.intersection(
            *(
                set((run_report.get("plan") or {}).get("auto") or ())
                for run_report in (report or {}, old_report)
            )
        )
        _refuse_other_config(
            folder, _current_config_yaml(folder / CONFIG), config_yaml, automatic_keys
        )
        unknown = ("energy",) if old_report.get("method") == "theory" else ()
        return PreviousRun(*_read_rows(folder / TABLE, unknown), old_report)
    except FileNotFoundError as error:
        raise UsageError(
            f"{folder} has {REPORT} but no {Path(error.filename).name}",
            RUN_AGAIN_REMEDY,
            str(folder),
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{folder} contains a {CONFIG} or {TABLE} that is not text",
            RUN_AGAIN_REMEDY,
            str(folder),
        ) from error
    except OSError as error:
        raise UsageError(
            f"cannot read {folder}: {error.strerror or error}", RUN_AGAIN_REMEDY, str(folder)
        ) from error


def missing_files(folder: Path, surface: KeptStates, fields: KeptStates) -> list[str]:
    """Return the names of the files of a finished run that are missing or damaged.

    Parameters
    ----------
    folder
        The result folder.
    surface, fields
        States that the run keeps in surface.csv and in the fields.
    """
    missing = missing_field_files(folder) if fields != "none" else []
    with suppress(UsageError):
        if surface == "none":
            return missing
        results = read(folder)
        if results["step"][-1] in results.surface.get("step", ()):
            return missing
    return [*missing, SURFACE]


def _current_config_yaml(path: Path) -> str:
    """Return the config of a result with all keys of this version, new keys at their defaults.

    A config that the present version cannot read is returned unchanged. UnicodeDecodeError is
    raised if the file is not text.
    """
    text = read_regular_file(path).decode("utf-8")
    try:
        return to_yaml(load(path))
    except (ConfigError, UsageError):
        return text


def _contains_key(document: Any, path: KeyPath) -> bool:
    """Return whether a document, which may be damaged, has an entry at a path."""
    for part in path:
        if not isinstance(document, Mapping) or part not in document:
            return False
        document = document[part]
    return True


def _refuse_other_config(
    folder: Path, old_yaml: str, new_yaml: str, automatic_keys: Collection[str]
) -> None:
    """Raise ConfigError, with the first key that differs, if two configs differ.

    A key that was auto in both runs (`automatic_keys`) is named only if no other key differs.
    """
    if old_yaml == new_yaml:
        return
    documents = [parse(text, str(folder / CONFIG))[0] for text in (old_yaml, new_yaml)]
    old_values, new_values = (dict(leaf_values(document)) for document in documents)
    for path, (problem, remedy) in REMOVED_KEYS.items():
        if _contains_key(documents[0], path):
            remedy_text = f"give --overwrite in place of --resume to replace it; {remedy}"
            raise ConfigError(
                key_text(path), f"{problem}; {folder} contains a run with this key", remedy_text
            )
    differing_keys = [
        key for key in {**new_values, **old_values} if old_values.get(key) != new_values.get(key)
    ]
    key = min(
        differing_keys,
        key=lambda key: key in automatic_keys or key.partition("[")[0] in automatic_keys,
        default="",
    )
    name = key.rpartition(".")[2]
    values_and_places = ((old_values, "there"), (new_values, "here"))
    difference_text = ", ".join(
        f"'{name}: {inline_yaml(values[key])}' {where}"
        for values, where in values_and_places
        if key in values
    )
    difference_text = difference_text or "its keys are in another order"
    problem = f"{folder} contains a run of another config ({difference_text})"
    remedy = (
        "use the scene and the --set options of that run, or another --output, or give --overwrite "
        "in place of --resume to replace it"
    )
    raise ConfigError(key, problem, remedy)


def _read_rows(
    path: Path, unknown: Sequence[str]
) -> tuple[tuple[State, ...], tuple[str, ...], int]:
    """Read the complete rows of a force table; return states, columns and their length [bytes]."""
    lines = read_regular_file(path).split(b"\n")[:-1]  # A line without a newline is incomplete.
    if not lines:
        return (), STATE_COLUMNS, 0
    names = tuple(lines[0].decode().split(","))
    columns = tuple(name for name in names if name not in ("t", *SLIDE_COLUMNS))
    has_known_columns = columns[: len(STATE_COLUMNS)] == STATE_COLUMNS and set(names) <= {
        *STATE_COLUMNS,
        *OPTIONAL_COLUMNS,
    }
    if not has_known_columns or names != tables.order_columns(names):
        raise UsageError(
            f"{path} has other columns than this version writes", RUN_AGAIN_REMEDY, str(path)
        )
    states: list[State] = []
    size = len(lines[0]) + 1
    for line in lines[1:]:
        state = parse_state(names, line, unknown)
        if state is None or state.step != len(states) + 1:
            break
        states.append(state)
        size += len(line) + 1
    return tuple(states), names, size
