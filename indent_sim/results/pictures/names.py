"""Names of several results in one picture: titles, or the settings that differ."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indent_sim.process.errors import ConfigError
from indent_sim.results.folder import CONFIG, content

if TYPE_CHECKING:
    from indent_sim.results.reader import Results


SILENT = ("title", "units", "output")  # sections that say nothing of the physics
MOST_LETTERS = 48  # of a name


def in_order(name: str) -> list[tuple[float, str]]:
    """Sorts names by the numbers in them, as numbers."""
    parts = re.split(r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)", name)
    return [(float(part), "") if i % 2 else (0.0, part) for i, part in enumerate(parts)]


def names_of(runs: Sequence[Results]) -> list[str]:
    """Short names: titles where they differ, else the keys of the configs that do, else the folders' own."""
    titles = [run.report.get("title", "") for run in runs]
    if all(titles) and len(set(titles)) == len(titles) and len(titles) > 1:
        return titles
    settings = _differences(runs)
    if all(settings) and len(set(settings)) == len(settings):
        return settings
    folders = [run.path.resolve() for run in runs]
    names = [folder.name for folder in folders]
    return names if len(set(names)) == len(names) else [str(run.path) for run in runs]


def _differences(runs: Sequence[Results]) -> list[str]:
    """What was given differently, as in "nu 0.3, method penalty"; empty where a config is missing."""
    configs = [config_of(run.path) for run in runs]
    if not all(configs):
        return [""] * len(runs)
    chosen = {key for run in runs for key in run.report.get("plan", {}).get("auto", [])}
    keys = list(dict.fromkeys(key for config in configs for key in config))
    keys = [key for key in keys if key not in chosen and key.split(".")[0] not in SILENT]
    told = [key for key in keys if len({str(config.get(key)) for config in configs}) > 1]
    return [_setting(config, told) for config in configs]


def config_of(folder: Path) -> dict[str, Any]:
    """The resolved config of a result folder by dotted key; empty where there is none to read."""
    from indent_sim.config import strict_yaml

    try:
        sections, _ = strict_yaml.parse(content(folder / CONFIG).decode("utf-8"))
    except (OSError, ValueError, ConfigError):
        return {}
    return dict(_flat(sections)) if isinstance(sections, dict) else {}


def _flat(section: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in section.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _setting(config: Mapping[str, Any], keys: Sequence[str]) -> str:
    parts = []
    for key in keys:
        value, name = config.get(key), key.rpartition(".")[2]
        if value is not None:
            parts.append(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}")
    text = ", ".join(parts)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"
