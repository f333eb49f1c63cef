"""What an earlier run left in its folder, and from where a run may go on (`--resume`).

The row is the commit: rows count up to the first one that is torn, and what other files say of later steps
does not count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.errors import ConfigError, UsageError
from indent_sim.folder import CONFIG, REPORT, TABLE, content, refuse_links
from indent_sim.reader import checked_report
from indent_sim.state import COLUMNS, ERRORS, State
from indent_sim.tables import state_of

SAME_DEPTH = 1e-9  # relative
OF_THE_WRITER = {"program", "version", "status", "exit_code", "reason", "rows", "started", "finished"}


@dataclass(frozen=True)
class Earlier:
    """The rows of an earlier run, its table's columns, the length that holds them [bytes], and its run.json."""

    states: tuple[State, ...]
    columns: tuple[str, ...]
    size: int
    report: dict[str, Any]

    def check(self, deltas: Sequence[float] | None, steps: int, folder: Path) -> None:
        """UsageError when these are not rows of a path of so many steps, to these depths where they are prescribed."""
        if len(self.states) > steps:
            raise UsageError(f"{folder / TABLE} has {len(self.states)} rows, the scene {steps} steps: it is damaged")
        for state, delta in zip(self.states, deltas or (), strict=False):
            if not math.isclose(state.delta, delta, rel_tol=SAME_DEPTH, abs_tol=0):
                raise UsageError(f"{folder / TABLE}: row {state.step} is not at the scene's depth: it is damaged")

    def finished(self, steps: int) -> bool:
        """Whether that run came to its end."""
        return self.report.get("status") == "done" and len(self.states) == steps

    @property
    def worst_audit(self) -> float:
        """The audit of the earlier rows; 0 when that run could not say."""
        return float((self.report.get("audit") or {}).get("force_against_reaction") or 0.0)

    @property
    def entries(self) -> dict[str, Any]:
        """What the run put into run.json beside the writer's own entries; `resumed_after` grows by one."""
        own = {name: value for name, value in self.report.items() if name not in OF_THE_WRITER}
        return own | {"resumed_after": [*own.get("resumed_after", []), len(self.states)]}


def earlier_run(folder: Path, config_yaml: str) -> Earlier | None:
    """The run of this config in a folder; None when the folder holds no run.

    Raises ConfigError when it holds a run of another config, UsageError when its rows cannot be understood.
    """
    report = checked_report(folder)
    if not report:
        return None
    try:
        refuse_links(folder)
        _refuse_other(folder, content(folder / CONFIG).decode("utf-8"), config_yaml)
        return Earlier(*_rows(folder / TABLE), report)
    except (FileNotFoundError, UnicodeDecodeError) as error:
        raise UsageError(f"{folder} has {REPORT} but not all that belongs to it: {error}") from error
    except OSError as error:
        raise UsageError(f"cannot read {folder}: {error.strerror or error}") from error


def _refuse_other(folder: Path, theirs: str, ours: str) -> None:
    if theirs == ours:
        return
    there, here = ([line.strip() for line in text.splitlines()] for text in (theirs, ours))
    news = [f"'{line[:80]}' {where}" for where, one, other in (("there", there, here), ("here", here, there))
            for line in [line for line in one if line not in other][:1]]  # fmt: skip
    raise ConfigError(
        "",
        f"{folder} holds a run of another config ({', '.join(news) or 'the same lines in another order'})",
        "give the same scene and --set as then, or another --output, or leave --resume out to replace it",
    )


def _rows(path: Path) -> tuple[tuple[State, ...], tuple[str, ...], int]:
    lines = content(path).split(b"\n")[:-1]  # what has no newline was torn
    if not lines:
        return (), COLUMNS, 0
    names = tuple(lines[0].decode().split(","))
    if names[: len(COLUMNS)] != COLUMNS or not set(names[len(COLUMNS) :]) <= set(ERRORS):
        raise UsageError(f"{path} has other columns than this version writes")
    states: list[State] = []
    size = len(lines[0]) + 1
    for line in lines[1:]:
        state = state_of(names, line)
        if state is None or state.step != len(states) + 1:
            break
        states.append(state)
        size += len(line) + 1
    return tuple(states), names, size
