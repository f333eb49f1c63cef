"""What a new run may take the place of: rows of the same config file, a finished run of the same
scene alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import load_older, to_mapping
from indent_sim.config.strict_yaml import inline, leaves, parse
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.folder import CONFIG, Report, content, has_rows, is_of_file, read_report

ENDED = (0, 6)  # exit codes of runs that have all their rows; 6: but not as accurate as asked for
NO_PART_OF_IT = (
    "title",
    "output.directory",
    "output.plot",
)  # keys that change neither numbers nor what is kept
MOST_TOLD = 5  # differences that a message names
NOT_GIVEN = "not given"

Difference = tuple[str, str, str]  # dotted key, what it was, and what it is now, in words


def is_finished(report: Report) -> bool:
    """Whether the run of a run.json came to its last row."""
    return report.get("status") in ("done", "failed") and report.get("exit_code") in ENDED


def refuse_to_lose(folder: Path, config_yaml: str, report: Report) -> None:
    """Refuse to replace the rows of another config file, or a finished run of another scene.

    Parameters
    ----------
    folder
        The result folder that the new run is to have.
    config_yaml
        The resolved scene of the new run.
    report
        What run.json will say of the new run: `asked` and `plan.auto` are looked at.

    Raises
    ------
    UsageError
        It names what differs, and an `--output` that is free.
    """
    if not has_rows(folder):
        return
    theirs = read_report(folder)
    remedy = f"choose another --output, such as {free_name(folder)}, or replace it with --overwrite"
    if not is_of_file(theirs, report, folder):
        file = theirs["asked"]["config"]
        raise UsageError(
            f"{folder} holds the run of another config file, {file}", remedy, str(folder)
        )
    if not is_finished(theirs):
        return
    differ = differences(folder, theirs, config_yaml, report)
    if differ:
        told = ", ".join(f"{key} was {old} and is {new}" for key, old, new in differ[:MOST_TOLD])
        more = len(differ) - MOST_TOLD
        told += f", and {more} more" if more > 0 else ""
        raise UsageError(
            f"{folder} holds the finished run of another scene: {told}", remedy, str(folder)
        )


def differences(folder: Path, theirs: Report, config_yaml: str, ours: Report) -> list[Difference]:
    """What the scene of a finished run and that of a new one differ in.

    Keys that both left to the program do not count: what it chose may follow from another key, or
    from its version. Error bars count where the new run would have none.

    Parameters
    ----------
    folder, theirs
        The folder of the finished run, and its run.json.
    config_yaml, ours
        The resolved scene of the new run, and what its run.json will say.
    """
    scene = _scene_in(folder)
    if not scene:
        return []
    there = dict(leaves(scene))
    here = dict(leaves(parse(config_yaml, "")[0]))
    chosen = _auto(theirs) & _auto(ours)
    asked_there = _asked(theirs)
    asked_here = _asked(ours)
    there["accuracy"] = asked_there.get("accuracy")
    here["accuracy"] = asked_here.get("accuracy")
    found = []
    for key in {**there, **here}:
        known = key in chosen or key.partition("[")[0] in chosen or key in NO_PART_OF_IT
        if not known and there.get(key) != here.get(key):
            found.append((key, _words(there, key), _words(here, key)))
    if asked_there.get("error_bars") and not (asked_here.get("error_bars") or here["accuracy"]):
        found.append(("--error-bars", "given", NOT_GIVEN))
    return found


def free_name(folder: Path) -> Path:
    """A path beside a folder that nothing has: its name with the first free number from 2 on."""
    number = 2
    while (beside := folder.with_name(f"{folder.name}-{number}")).exists():
        number += 1
    return beside


def _scene_in(folder: Path) -> Mapping[str, Any]:
    """The scene of a finished run as this version would write it; as it stands where this version
    cannot read it.

    Empty where config.yaml is missing or damaged: nobody can tell what the rows are of, and running
    the scene again is what mends such a folder.
    """
    try:
        return to_mapping(load_older(folder / CONFIG))
    except (ConfigError, UsageError):
        pass
    try:
        found = parse(content(folder / CONFIG).decode("utf-8", "replace"), "")[0]
    except (ConfigError, OSError):
        return {}
    return found if isinstance(found, dict) else {}


def _auto(report: Report) -> set[str]:
    """The keys that a run left to the program."""
    return set((report.get("plan") or {}).get("auto") or ())


def _asked(report: Report) -> Mapping[str, Any]:
    """What a run was asked for beside its scene."""
    asked = report.get("asked")
    return asked if isinstance(asked, dict) else {}


def _words(values: Mapping[str, Any], key: str) -> str:
    """The value of a key as YAML, cut where it is long."""
    if values.get(key) is None:
        return NOT_GIVEN
    text = inline(values[key])
    return text if len(text) <= 60 else f"{text[:57]}..."
