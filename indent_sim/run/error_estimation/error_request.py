"""Error estimates that a run was requested to compute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.process.errors import ConfigError


@dataclass(frozen=True)
class ErrorRequest:
    """Error estimates that are requested for a run: error bars, an accuracy, or both."""

    error_bars: bool
    accuracy: float | None

    @property
    def has_error_bars(self) -> bool:
        """True if rows have error estimates."""
        return self.error_bars or self.accuracy is not None


def error_request_of(report: Mapping[str, Any]) -> ErrorRequest:
    """Return the error estimates that were requested for the run that a run.json describes.

    A run.json of an older version does not state them; they follow from its other entries.
    """
    target = (report.get("accuracy") or {}).get("target")
    telltale_keys = {"stick"} if target else {"stick", "error_budget"}
    request = {"error_bars": bool(telltale_keys & report.keys()), "accuracy": target} | report.get(
        "asked", {}
    )
    return ErrorRequest(request["error_bars"], request["accuracy"])


def check_same_request(previous: ErrorRequest, request: ErrorRequest, folder: Path) -> None:
    """Raise ConfigError if a run cannot be resumed because other error estimates were requested."""
    if request.has_error_bars and not previous.has_error_bars:
        raise ConfigError(
            "",
            f"{folder} contains a run without error bars",
            "give --overwrite in place of --resume to replace it",
        )
    if previous.accuracy != request.accuracy:
        old_text, new_text = (
            f"accuracy {accuracy:g}" if accuracy else "no accuracy"
            for accuracy in (previous.accuracy, request.accuracy)
        )
        problem = f"{folder} contains a run with {old_text}, this one has {new_text}"
        raise ConfigError(
            "accuracy", problem, "give --overwrite in place of --resume to replace it"
        )
