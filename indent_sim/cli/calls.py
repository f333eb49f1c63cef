"""Commands as functions: scenes and studies from files or dictionaries, results as arrays."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indent_sim.config.scene_file import Overrides, SceneInput, is_study
from indent_sim.process.errors import UsageError
from indent_sim.results import compare as comparisons
from indent_sim.results import reader, result_files
from indent_sim.results.json_text import json_data
from indent_sim.results.reader import Results
from indent_sim.results.result_files import Report
from indent_sim.run import sensitivities as derivatives
from indent_sim.run.pipeline import config_of
from indent_sim.run.planned_run import plan_with_cost
from indent_sim.studies import curve_table, run_study, small_multiples, study_picture
from indent_sim.studies.finished_study import Study, read_study
from indent_sim.studies.study_plan import plan_study as plan_study

if TYPE_CHECKING:
    from indent_sim.fitting.curve_fit import ModelChoice
    from indent_sim.fitting.notebook import Curve, Fit
    from indent_sim.results.measured.measurement import CurvePart
    from indent_sim.results.pictures.figures import Axes, Figure

Result = Results | str | Path


def read(path: str | Path) -> Results | Study:
    """Read a result folder, a force table, a measured curve or the table of a study as arrays.

    Raises
    ------
    UsageError
        If the path contains none of these, or its content is damaged.
    """
    if result_files.folder_kind(Path(path)) == "study":
        return read_study(Path(path))
    return reader.read(path)


def plan(given: SceneInput, *, error_bars: bool = False) -> Report:
    """Return the plan of a scene, or the planned runs of a study, without solving anything.

    Parameters
    ----------
    given
        Scene or study: a file, a dictionary with its structure, or the config of a scene.
    error_bars
        Include the cost of the additional solutions of error estimates.

    Returns
    -------
    Report
        The object that `indent-sim plan --json` prints.
    """
    if (isinstance(given, Mapping) and is_study(given)) or (
        isinstance(given, str | Path) and _is_study_file(given)
    ):
        return json_data(plan_study(given, error_bars).as_json())
    return json_data(plan_with_cost(config_of(given), error_bars).plan.as_json())


def require(given: SceneInput, within: float = 0.01) -> Report:
    """Estimate how each effect changes the force, and recommend the cheapest sufficient model.

    Parameters
    ----------
    given
        Scene: a file, nested mappings shaped like a file, or a config.
    within
        Accepted relative error of the force, between 0 and 1.

    Returns
    -------
    Report
        The object that `indent-sim require --json` prints.
    """
    from indent_sim.run.model_selection import recommended_model

    return json_data(recommended_model.require(config_of(given), within).as_json())


def compare(
    first: Result,
    second: Result,
    rtol: comparisons.Tolerances = comparisons.DEFAULT_RTOL,
    columns: Sequence[str] | None = None,
) -> Report:
    """Compare two results or measured curves row by row.

    Parameters
    ----------
    first, second
        Results, or the paths of result folders, force tables or measured curves.
    rtol
        Relative tolerance of all columns, or a dictionary of tolerances by column.
    columns
        Columns to compare; by default depth, force, contact radius and the columns of `rtol`.

    Returns
    -------
    Report
        The object that `indent-sim compare --json` prints; `differences` is empty if they agree.
    """
    A, B = (result.path if isinstance(result, Results) else result for result in (first, second))
    return json_data(comparisons.compare(A, B, rtol, columns).as_json())


def fit(
    curve: Curve,
    scene: SceneInput,
    vary: Sequence[str] = ("material.E",),
    *,
    overrides: Overrides = (),
    segment: CurvePart = "approach",
    columns: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    sensitivity: str | None = None,
    contact_point: float | None = None,
    models: ModelChoice = "needed",
) -> Fit:
    """Fit parameters of a scene to one measured curve with unknown contact point and baseline.

    Parameters
    ----------
    curve
        File, whose first curve is used, a `MeasuredCurve`, or arrays (depth, force) in the units of
        the scene.
    scene
        The scene, or its document or file; or the file of a surrogate of the force, which then
        gives the forces.
    vary
        Keys of the parameters.
    overrides
        Values of keys of the scene, as in `load`. A key that varied in the study of a surrogate
        must be here or in `vary`.
    segment
        Part of the curve that is fitted.
    columns, units
        Columns of the file, such as ("z=1", "force=2"), or the titles or numbers of the columns of
        depth, force and time; units of a file without units.
    sensitivity
        Length per voltage of deflections in volts, such as 50 nm/V.
    contact_point
        Displacement at first contact, if it is known.
    models
        Fit alternative models only when needed, or all of them.

    Raises
    ------
    NotConverged
        If the curve does not determine the parameters.
    ConfigError
        If a key or the scene is invalid, or the surrogate is not that of such a scene.
    """
    from indent_sim.cli.fit_scene import scene_or_surrogate
    from indent_sim.fitting import notebook
    from indent_sim.fitting.curve_fit import FitRequest, keys_of_part
    from indent_sim.fitting.fit_folder import ReadOptions
    from indent_sim.fitting.inference.estimate import OriginOptions

    config, surrogate = scene_or_surrogate(scene, overrides, vary)
    origin = OriginOptions(contact_point)
    keys = keys_of_part(vary, segment)
    request = FitRequest(config, keys, segment, origin, models, surrogate=surrogate)
    return notebook.fit(curve, request, ReadOptions(tuple(columns), units, sensitivity))


def hardness(curve: str | Path, scene: SceneInput | None = None, **options: Any) -> Report:
    """Return hardness and modulus of a loading and unloading curve by Oliver and Pharr.

    Parameters
    ----------
    curve
        File of a measured curve, or folder or force table of a result.
    scene
        Scene with the tip, Poisson's ratio and frame of a measured curve.
    options
        Options of `indent-sim hardness`: epsilon, beta, top (two fractions of the largest force,
        (0.98, 0.4)), area, nu, tip, frame_compliance, drift, columns, units (by kind, "length" and
        "force").

    Returns
    -------
    Report
        The object that `indent-sim hardness --json` prints.

    Raises
    ------
    UsageError
        If the curve cannot be analysed, or an option is unknown.
    ConfigError
        If an option is not valid.
    """
    from indent_sim.run import hardness_analysis

    known = hardness_analysis.OPTIONS
    if unknown := [name for name in options if name not in known]:
        raise UsageError(f"hardness has no option {unknown[0]}; its options are {', '.join(known)}")
    # Quantities may be numbers or texts with a unit; beta and nu are numbers.
    settings: dict[str, Any] = {
        name: str(value)
        if isinstance(value, int | float | Path) and name not in ("beta", "nu")
        else value
        for name, value in options.items()
    }
    config = None if scene is None else config_of(scene)
    request = hardness_analysis.HardnessOptions(scene=config, **settings)
    return json_data(hardness_analysis.analyse(Path(curve), request).as_json())


def study(
    given: Mapping[str, Any] | str | Path,
    *,
    directory: str | Path | None = None,
    jobs: int = 1,
    resume: bool = False,
    overwrite: bool = False,
) -> Study:
    """Run a study and return its table.

    Parameters
    ----------
    given
        Study: a file, or a dictionary with its structure.
    directory
        Folder of the study. A study given as a dictionary without a folder uses a temporary folder,
        which is deleted together with the returned object.
    jobs
        Number of runs at the same time.
    resume
        Keep finished runs, including runs that are not part of the study.
    overwrite
        Replace finished runs in the folder that are not part of the study.

    Raises
    ------
    UsageError, ConfigError
        The study is not valid; raised before any run.
    NotConverged
        No run has a result.
    """
    if (
        directory is not None
        or not isinstance(given, Mapping)
        or (given.get("output") or {}).get("directory")
    ):
        folder_path = Path(directory) if directory else None
        return run_study.execute_study(
            given, output=folder_path, jobs=jobs, resume=resume, overwrite=overwrite
        )
    folder_path = Path(tempfile.mkdtemp(prefix="indent-sim-"))
    try:
        finished_study = run_study.execute_study(given, output=folder_path, jobs=jobs)
    except BaseException:
        shutil.rmtree(folder_path, ignore_errors=True)
        raise
    weakref.finalize(finished_study, shutil.rmtree, folder_path, ignore_errors=True)
    return finished_study


def plot(
    shown: Result | Study | Sequence[Result],
    what: str = "",
    *,
    ax: Axes | None = None,
    **options: Any,
) -> Figure:
    """Return the figure of results or of a study, which a notebook displays.

    Parameters
    ----------
    shown
        Results, or a study; or their folders.
    what
        Panels, separated by commas: force [default], time, pressure, pressure_x, pressure_y,
        profile, hardness, fields, film. For a study curves [default], or one of force, a, p_max and
        penetration over the varied keys.
    ax
        Axes of an existing figure, into which one panel of `what` is drawn; fields are drawn at
        one step, and curves of a study without panels over the varied numbers.
    options
        Options of `indent-sim plot`: fields, steps, units, width [mm], font [points], layout (rows,
        columns), letters "a", limits (low, high), zoom.

    Raises
    ------
    UsageError
        If the results do not contain a requested quantity, or `ax` is given with several panels.
    """
    from indent_sim.results.pictures import figures, panels

    if isinstance(shown, str | Path):
        shown = read(shown)
    if isinstance(shown, Study):
        if options:
            raise UsageError(
                f"the picture of a study has no option {next(iter(options))}",
                "leave the options out, or plot one run of the study",
            )
        return _plot_study(shown, what or "curves", ax)
    results = [shown] if isinstance(shown, Results) else shown
    runs = [item if isinstance(item, Results) else reader.read(item) for item in results]
    request = panels.plot_request(
        {"what": _split_words(what or "force")} | _normalize_options(options)
    )
    if ax is not None:
        panels.draw_into(ax, runs, request)
        return ax.figure
    with panels.requested_figure(runs, request) as figure:
        figures.apply_layout(figure)
        return figure


def _plot_study(shown: Study, panel: str, ax: Axes | None) -> Figure:
    """Return the figure of a study's curves, or of a column of its table."""
    from indent_sim.results.pictures import figures

    if panel not in ("curves", *small_multiples.PLOTTED_COLUMNS):
        columns = ", ".join(small_multiples.PLOTTED_COLUMNS)
        problem = f"a study is plotted as curves, or as one of {columns}"
        raise UsageError(f"{problem}; for other panels plot one run of the study")
    curve_groups = curve_table.group_folder_curves(
        shown.directory / result_files.RUNS, shown.rows, shown.keys
    )
    if not curve_groups.curves:
        raise UsageError(f"{shown.directory} has no finished run")
    if ax is None:
        with study_picture.requested_figure(curve_groups, panel, shown.title) as figure:
            figures.apply_layout(figure)
            return figure
    if panel == "curves":
        study_picture.draw_curves_into(ax, curve_groups)
    else:
        small_multiples.draw_column_into(ax, curve_groups, panel)
    return ax.figure


def _normalize_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a picture in the form in which the command line gives them.

    Raises UsageError for an unknown option.
    """
    plot_options = (
        "fields",
        "steps",
        "units",
        "width",
        "font",
        "layout",
        "letters",
        "limits",
        "zoom",
    )
    if unknown := [name for name in options if name not in plot_options]:
        raise UsageError(
            f"plot has no option {unknown[0]}; its options are {', '.join(plot_options)}"
        )
    as_lists = {
        name: (value,) if isinstance(value, int) else value for name, value in options.items()
    }
    return {
        name: _split_words(value) if name in ("fields", "steps") else options[name]
        for name, value in as_lists.items()
    }


def _split_words(words: str | Sequence[Any]) -> tuple[str, ...]:
    """Return the words of a text with commas, or the items of a sequence, as texts."""
    if isinstance(words, str):
        return tuple(word.strip() for word in words.split(","))
    return tuple(map(str, words))


def sensitivities(scene: SceneInput, keys: str | Sequence[str]) -> derivatives.Derivatives:
    """Return the derivatives dF/dkey of the force at every row of a scene.

    Parameters
    ----------
    scene
        Scene: a file, nested mappings shaped like a file, or a config.
    keys
        One or several dotted keys of numbers, e.g. "material.E".

    Returns
    -------
    Derivatives
        {key: {"value": [...], "error": [...]}} with one entry per row.
    """
    return derivatives.sensitivities(config_of(scene), [keys] if isinstance(keys, str) else keys)


def _is_study_file(path: str | Path) -> bool:
    """Return whether a YAML file contains a study."""
    from indent_sim.config.scene_file import read_document

    return is_study(read_document(path)[0])
