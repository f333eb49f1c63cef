"""Protection of finished results against being overwritten by a new run.

A run may replace unfinished results of the same config file, and finished results of the same
scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import load_result_config, to_mapping
from indent_sim.config.strict_yaml import inline_yaml, leaf_values, parse
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.result_files import (
    CONFIG,
    Report,
    has_rows,
    is_same_config_file,
    read_report,
)

MAX_DIFFERENCES = 5  # Largest number of differences in a message.


def is_finished(report: Report) -> bool:
    """Return whether the run that wrote a run.json has computed all rows."""
    # Exit codes of runs that have all their rows; 6 means that the required accuracy was missed.
    complete_exit_codes = (0, 6)
    return (
        report.get("status") in ("done", "failed")
        and report.get("exit_code") in complete_exit_codes
    )


def refuse_overwrite(folder: Path, config_yaml: str, report: Report) -> None:
    """Refuse to overwrite results of another config file, or a finished run of another scene.

    Parameters
    ----------
    folder
        The result folder of the new run.
    config_yaml
        The resolved scene of the new run.
    report
        The run.json of the new run; only its entries `asked` and `plan.auto` are used.

    Raises
    ------
    UsageError
        If results would be overwritten; the message names the differences and an unused folder.
    """
    if not has_rows(folder):
        return
    old_report = read_report(folder)
    free_folder = free_folder_name(folder)
    remedy = f"choose another --output, such as {free_folder}, or replace it with --overwrite"
    if not is_same_config_file(old_report, report, folder):
        file = old_report["asked"]["config"]
        raise UsageError(
            f"{folder} contains the run of another config file, {file}", remedy, str(folder)
        )
    if not is_finished(old_report):
        return
    differences = scene_differences(folder, old_report, config_yaml, report)
    if differences:
        difference_text = ", ".join(differences[:MAX_DIFFERENCES])
        remaining = len(differences) - MAX_DIFFERENCES
        difference_text += f", and {remaining} more" if remaining > 0 else ""
        raise UsageError(
            f"{folder} contains the finished run of another scene: {difference_text}",
            remedy,
            str(folder),
        )


def scene_differences(
    folder: Path, old_report: Report, config_yaml: str, new_report: Report
) -> list[str]:
    """Return texts on the differences between the scenes of a finished and a new run.

    Keys that both runs left at auto are ignored, since their values may depend on another key or on
    the program's version. Error bars of the old run count as a difference if the new run would have
    none.

    Parameters
    ----------
    folder, old_report
        The folder of the finished run, and its run.json.
    config_yaml, new_report
        The resolved scene of the new run, and its run.json.

    Returns
    -------
    list of str
        A clause for each difference, such as "material.E was 1.0 and is 2.0".
    """
    scene = _read_scene(folder)
    if not scene:
        return []
    old_values = dict(leaf_values(scene))
    new_values = dict(leaf_values(parse(config_yaml, "")[0]))
    automatic_keys = _automatic_keys(old_report) & _automatic_keys(new_report)
    old_options = _requested_options(old_report)
    new_options = _requested_options(new_report)
    old_values["accuracy"] = old_options.get("accuracy")
    new_values["accuracy"] = new_options.get("accuracy")
    differences = []
    # These keys change neither the numbers nor the selection of the written numbers.
    ignored_keys = ("title", "output.directory", "output.plot")
    for key in {**old_values, **new_values}:
        is_ignored = (
            key in automatic_keys or key.partition("[")[0] in automatic_keys or key in ignored_keys
        )
        if not is_ignored and old_values.get(key) != new_values.get(key):
            differences.append(_difference_clause(key, old_values.get(key), new_values.get(key)))
    if old_options.get("error_bars") and not (
        new_options.get("error_bars") or new_values["accuracy"]
    ):
        differences.append("it has error bars, but the new run has no --error-bars")
    return differences


def free_folder_name(folder: Path) -> Path:
    """Return an unused path beside a folder: its name with the first free number from 2 on."""
    number = 2
    while (candidate := folder.with_name(f"{folder.name}-{number}")).exists():
        number += 1
    return candidate


def _read_scene(folder: Path) -> Mapping[str, Any]:
    """Return the scene of a finished run with the keys of this version.

    A scene that this version cannot read is returned unchanged. The result is empty if config.yaml
    is missing or damaged; a new run then replaces the folder.
    """
    try:
        return to_mapping(load_result_config(folder / CONFIG))
    except (ConfigError, UsageError):
        pass
    try:
        document = parse(read_regular_file(folder / CONFIG).decode("utf-8", "replace"), "")[0]
    except (ConfigError, OSError):
        return {}
    return document if isinstance(document, dict) else {}


def _automatic_keys(report: Report) -> set[str]:
    """Return the keys that were auto in the scene of a run."""
    return set((report.get("plan") or {}).get("auto") or ())


def _requested_options(report: Report) -> Mapping[str, Any]:
    """Return the command-line options of a run."""
    options = report.get("asked")
    return options if isinstance(options, dict) else {}


def _difference_clause(key: str, old: Any, new: Any) -> str:
    """Return a clause on the values of a key in two scenes; the value of a missing key is None."""
    if old is None:
        return f"{key} was missing and is {_value_text(new)}"
    if new is None:
        return f"{key} was {_value_text(old)} and is missing now"
    return f"{key} was {_value_text(old)} and is {_value_text(new)}"


def _value_text(value: Any) -> str:
    """Return a value as YAML, shortened to 60 characters."""
    text = inline_yaml(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
