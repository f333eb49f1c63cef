"""Checks of unloading after the last depth or force."""

from __future__ import annotations

from collections.abc import Iterator

from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.loading import Loading
from indent_sim.process.errors import ConfigError

KEY = "loading.unload"


def unload_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors of `loading.unload`: its end, and parts of the scene that exclude it."""
    unload = config.loading.unload
    if unload is None:
        return
    for applies, problem, remedy in _rejections(config):
        if applies:
            yield ConfigError(KEY, problem, remedy)
            return
    last_value = _last_value(config.loading)
    if last_value is not None and unload.to >= last_value:
        yield ConfigError(
            f"{KEY}.to",
            f"is {unload.to:g}, but unloading begins at {last_value:g}",
            "use a smaller value, or 0 to unload until contact is lost",
        )


def _last_value(loading: Loading) -> float | None:
    """Return the last prescribed depth or force, at which unloading begins."""
    values = loading.deltas or loading.forces or (loading.delta or loading.force,)
    return values[-1]


def _rejections(config: SceneSections) -> Iterator[tuple[bool, str, str]]:
    """Yield whether unloading is rejected, with the text of the problem and the remedy."""
    loading = config.loading
    yield (
        loading.prescribed_history is not None,
        "begins after the last of deltas or forces, but this scene prescribes a history in time",
        "write unloading as the end of the history, for example [[0, 0], [1, 0.5], [2, 0]]",
    )
    yield (
        loading.slide is not None,
        (
            "cannot be combined with loading.slide: both follow the last of the prescribed depths "
            "or forces"
        ),
        "leave one of them out",
    )
    yield (
        bool(config.contact.adhesion or (config.experiment and config.experiment.adhesion)),
        "ends where the force has become zero, but with adhesion the tip is pulled off",
        "write unloading as loading.deltas that end below 0",
    )
    yield (
        config.experiment is not None,
        (
            "cannot be combined with the section experiment, which is computed from the curve of "
            "force over depth"
        ),
        "leave experiment or loading.unload out",
    )
    yield (
        config.map is not None,
        "cannot be combined with the section map, whose curves are forces over the depth",
        "leave loading.unload out",
    )
    last_value = _last_value(loading)
    yield (
        last_value is not None and last_value <= 0,
        "begins at the last depth or force, which is not above 0",
        "let the depths or forces end above 0",
    )
