"""Names of several results in one picture: their titles, or the settings that differ."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from indent_sim.config import strict_yaml
from indent_sim.config.strict_yaml import short_yaml
from indent_sim.process.errors import ConfigError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.reader import Results
from indent_sim.results.result_files import CONFIG, Report


def natural_sort_key(name: str) -> list[tuple[float, str]]:
    """Return a sort key that orders the numbers within names by value."""
    parts = re.split(r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)", name)
    return [(float(part), "") if i % 2 else (0.0, part) for i, part in enumerate(parts)]


def run_names(runs: Sequence[Results]) -> list[str]:
    """Return short names: titles if they differ, otherwise differing settings or folder names."""
    titles = [run.report.get("title", "") for run in runs]
    if all(titles) and len(set(titles)) == len(titles) and len(titles) > 1:
        return titles
    settings = _differing_settings(runs)
    if all(settings) and len(set(settings)) == len(settings):
        return settings
    names = [run.path.resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run.path) for run in runs]


def _differing_settings(runs: Sequence[Results]) -> list[str]:
    """Return differing settings such as "nu 0.3, method penalty"; empty if configs are missing."""
    configs = [config_by_key(run.path) for run in runs]
    if not all(configs):
        return [""] * len(runs)
    chosen = {key for run in runs for key in run.report.get("plan", {}).get("auto", [])}
    keys = list(dict.fromkeys(key for config in configs for key in config))
    keys = [
        key
        for key in keys
        if key not in chosen and key.split(".")[0] not in ("title", "units", "output")
    ]
    differing_keys = [key for key in keys if len({str(config.get(key)) for config in configs}) > 1]
    settings = [
        [(key.rpartition(".")[2], config.get(key)) for key in differing_keys] for config in configs
    ]
    words = [
        ", ".join(f"{name} {short_yaml(value)}" for name, value in pairs if value is not None)
        for pairs in settings
    ]
    # Longer names are shortened.
    max_letters = 48
    return [text if len(text) <= max_letters else f"{text[: max_letters - 1]}…" for text in words]


def config_by_key(folder: Path) -> Report:
    """Return the resolved config of a result folder by dotted key; empty if it cannot be read."""
    try:
        sections, _ = strict_yaml.parse(read_regular_file(folder / CONFIG).decode("utf-8"))
    except (OSError, ValueError, ConfigError):
        return {}
    return dict(_flatten(sections)) if isinstance(sections, dict) else {}


def _flatten(section: Report, above: str = "") -> Iterator[tuple[str, object]]:
    """Yield dotted keys and values of nested sections."""
    for key, value in section.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
