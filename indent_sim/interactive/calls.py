"""The commands as functions: scenes and studies as files or dictionaries, numbers and figures back."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from indent_sim.config.scene_file import is_study, load
from indent_sim.config.schema import Config
from indent_sim.interactive import sensitivities as derivatives
from indent_sim.results import compare as comparisons
from indent_sim.results import folder, reader
from indent_sim.results.folder import Report
from indent_sim.results.reader import Results
from indent_sim.run.accuracy import foreseen
from indent_sim.scene.scene import Scene, resolve
from indent_sim.studies import conduct
from indent_sim.studies import plan as plan_study
from indent_sim.studies.conduct import Study

Given = Config | Mapping[str, Any] | str | Path  # a scene, or the file or dictionary that says it
Result = Results | str | Path


def read(path: str | Path) -> Results | Study:
    """A result folder, a force table or a measured curve, columns as arrays; the folder of a study as its table.

    UsageError when there is none, or it is damaged.
    """
    return conduct.read_back(Path(path)) if folder.held(Path(path)) == "study" else reader.read(path)


def plan(given: Given, *, error_bars: bool = False) -> Report:
    """What would be modelled, and why; of a study its runs and their cost: the object of `indent-sim plan --json`."""
    if (isinstance(given, Mapping) and is_study(given)) or (isinstance(given, str | Path) and _holds_study(given)):
        return plan_study(given, error_bars).as_json()
    scene = resolve(config_of(given))
    return (foreseen(scene, error_bars) if error_bars or scene.plan.fineness else scene).plan.as_json()


def require(given: Given, within: float = 0.01) -> Report:
    """Which effects matter, in per cent, and the cheapest model within a relative tolerance of the force: the object of
    `indent-sim require --json`."""
    from indent_sim.run.requirements import cheapest

    return cheapest.require(config_of(given), within).as_json()


def compare(
    first: Result,
    second: Result,
    rtol: comparisons.Tolerances = comparisons.RTOL,
    columns: Sequence[str] | None = None,
) -> Report:
    """Two results or measured curves row by row: the object of `indent-sim compare --json`; `differences` is empty
    where they agree."""
    paths = (one.path if isinstance(one, Results) else one for one in (first, second))
    return comparisons.compare(*paths, rtol, columns).as_json()


def study(
    given: Mapping[str, Any] | str | Path, *, directory: str | Path | None = None, jobs: int = 1, resume: bool = False
) -> Study:
    """Do a study and give its table. Of a dictionary without a directory the runs are kept as long as the result is.

    UsageError, ConfigError (before any run), NotConverged when no run at all gave a result.
    """
    place = Path(directory) if directory is not None else None
    temporary = place is None and isinstance(given, Mapping) and not (given.get("output") or {}).get("directory")
    if temporary:
        place = Path(tempfile.mkdtemp(prefix="indent-sim-"))
    try:
        found = conduct.carry_out(given, output=place, jobs=jobs, resume=resume)
    except BaseException:
        if temporary and place is not None:
            shutil.rmtree(place, ignore_errors=True)
        raise
    if temporary:
        weakref.finalize(found, shutil.rmtree, place, ignore_errors=True)
    return found


def sensitivities(scene: Given, keys: str | Sequence[str]) -> derivatives.Derivatives:
    """dF/dkey at every row of a scene: {key: {value: [...], error: [...]}}, see `interactive.sensitivities`."""
    return derivatives.sensitivities(config_of(scene), [keys] if isinstance(keys, str) else keys)


def config_of(given: Given) -> Config:
    """The config of a scene, however it is given."""
    if isinstance(given, Scene):
        raise TypeError("give what `load` gives, not what `resolve` made of it")
    return given if isinstance(given, Config) else load(given)


def _holds_study(path: str | Path) -> bool:
    from indent_sim.config.scene_file import read_document

    return is_study(read_document(path)[0])
