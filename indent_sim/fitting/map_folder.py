"""Folder of a map: map.h5, map.csv, images, a picture, and fit.json with a sample of curves."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.quantities import si_factor
from indent_sim.fitting import fit_table
from indent_sim.fitting.curve_fit import CurveFit, FitRequest, quantity_kind, request_identity
from indent_sim.fitting.fit_folder import (
    FIT_TABLE,
    MAP_FIELDS,
    MAP_PICTURE,
    MAP_TABLE,
    PICTURES,
    open_locked,
    tell_cost,
)
from indent_sim.fitting.inference.pooled_noise import PooledNoise
from indent_sim.fitting.map_estimate import ReportLine, fit_map
from indent_sim.fitting.map_fit import FITTED, REASONS
from indent_sim.fitting.map_progress import MapProgress
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_source import MapSource
from indent_sim.fitting.map_thickness import parse_thickness, thickness_of_scene
from indent_sim.process.errors import ConfigError, NotConverged, UsageError
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import json_data, to_json
from indent_sim.results.map_arrays import hdf5_bytes, read_hdf5_file, require_hdf5
from indent_sim.results.map_images import gwyddion_field, tiff_image
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.result_files import FIT, PROGRAM, read_report


def fit_map_folder(
    curves: MeasuredMap,
    source: MapSource,
    request: FitRequest,
    directory: Path,
    thickness: str | None = None,
    jobs: int = 1,
    tell: ReportLine = lambda line: None,
) -> MapFit:
    """Fit a map into a folder, or continue the fit of an earlier call.

    See `fit_map` and `require_hdf5` for errors.

    Parameters
    ----------
    curves
        The map.
    source
        Files of the map.
    request
        Scene and settings of the fit.
    directory
        Folder of the fit.
    thickness
        Thickness of the pixels, see `parse_thickness`.
    jobs
        Number of processes that fit blocks of curves.
    tell
        Function that is called with each line of progress.
    """
    require_hdf5("the fit of a map")
    pixel_thickness = thickness_of_scene(request.config)
    if thickness:
        pixel_thickness = parse_thickness(thickness, request, curves.shape)
    options = {"thickness": thickness, "grid": source.grid, "rows": source.rows}
    identity = dict(request_identity(request)) | {"map": options}
    header = {"request": identity, "source": source.record() | _file_state(thickness)}
    with open_locked(directory, identity):
        progress = MapProgress(directory, header)
        finished = _finished_map(directory, header)
        if finished is not None:
            progress.remove()
            tell(f"finished by an earlier call: {finished.words}")
            return finished
        tell_cost(request, tell)
        try:
            map_fit, sample = fit_map(curves, request, pixel_thickness, jobs, progress, tell)
            map_fit = replace(map_fit, entry=map_fit.entry | header)
            write_map(map_fit, sample, request, directory)
        except (ConfigError, UsageError):
            with suppress(OSError):
                progress.discard()
            raise
        except BaseException:
            progress.interrupt()
            raise
        progress.remove()
    tell(map_fit.words)
    for warning in map_fit.entry["warnings"]:
        tell(f"  warning: {warning}")
    return map_fit


def _file_state(thickness: str | None) -> dict[str, Any]:
    """Return the properties of a file of thicknesses, by which a change is detected."""
    path = Path(thickness or "")
    if not path.is_file():
        return {}
    state = path.stat()
    return {"thickness": [state.st_size, state.st_mtime_ns]}


def _finished_map(directory: Path, header: Mapping[str, Any]) -> MapFit | None:
    """Return the map of an earlier call that has fitted the same files; None without such a map."""
    report = read_report(directory, FIT)
    is_same = report.get("source") == json_data(header["source"])
    if not is_same or report.get("status") not in ("done", "failed") or "map" not in report:
        return None
    with suppress(UsageError):
        return read_map(directory)
    return None


def write_map(
    map_fit: MapFit, sample: list[CurveFit], request: FitRequest, directory: Path
) -> None:
    """Write the files of a map into the folder of a fit.

    Raises
    ------
    UsageError
        If the folder cannot be written.
    """
    quantities = {
        map_fit.key: map_fit.value,
        f"{map_fit.key}_low": map_fit.low,
        f"{map_fit.key}_high": map_fit.high,
        "statistical_low": map_fit.statistical_low,
        "statistical_high": map_fit.statistical_high,
        "height": map_fit.height,
        **({} if map_fit.thickness is None else {"thickness": map_fit.thickness}),
        **map_fit.pixels,
        "explained": map_fit.explained,
    }
    try:
        attributes: dict[str, Any] = {
            "key": map_fit.key,
            "program": f"{PROGRAM} {VERSION}",
            "reasons": REASONS,
        }
        if map_fit.size is not None:
            attributes |= {"size_m": map_fit.size}
        arrays = quantities | {"reason": map_fit.reason.astype(np.int8)}
        columns = (*quantities, *fit_table.fit_columns(request.varied_keys))
        units = fit_table.column_units(columns, request.varied_keys, request.config)
        write_atomically(directory / MAP_FIELDS, hdf5_bytes(arrays, attributes, units))
        write_atomically(directory / MAP_TABLE, _table(map_fit, quantities))
        for name, values, kind in (
            (
                map_fit.key.rpartition(".")[2],
                map_fit.value,
                quantity_kind(request.config, map_fit.key),
            ),
            ("height", map_fit.height, "length"),
        ):
            unit, factor = _si_unit(request, kind)
            data = values * factor
            write_atomically(
                directory / f"{name}.gsf", gwyddion_field(data, map_fit.size, name, unit)
            )
            write_atomically(directory / f"{name}.tif", tiff_image(data, map_fit.size, unit))
        entries = [fit.entry for fit in sample]
        write_atomically(
            directory / FIT_TABLE, fit_table.table_of_fits(entries, request.varied_keys)
        )
        if request.config.output.plot:
            _draw(map_fit, sample, request, directory)
        status = "done" if map_fit.entry["map"]["fitted"] else "failed"
        code = 0 if status == "done" else NotConverged.exit_code
        header = {"program": PROGRAM, "version": VERSION, "status": status, "exit_code": code}
        write_atomically(directory / FIT, to_json(header | {"units": units} | map_fit.entry) + "\n")
    except OSError as error:
        raise write_error(directory, error) from error


def _draw(map_fit: MapFit, sample: list[CurveFit], request: FitRequest, directory: Path) -> None:
    from indent_sim.fitting import fit_picture, map_picture

    map_picture.draw_map(map_fit, request.config, directory / MAP_PICTURE)
    (directory / PICTURES).mkdir(exist_ok=True)
    # Pictures of the sampled curves take longer than the fit of a small map.
    max_pictures = 12
    plotted = [fit for fit in sample if fit.plotted is not None]
    for fit in plotted[:: max(1, len(plotted) // max_pictures)]:
        fit_picture.draw_curve(fit, request.config, directory / PICTURES / f"{fit.name}.png")


def _si_unit(request: FitRequest, kind: str | None) -> tuple[str, float]:
    """Return the SI unit of a quantity and the factor to it; "" and 1 for a scene without units."""
    units = request.config.units
    if kind is None or not units.length or not (units.force or kind == "length"):
        return "", 1.0
    length = si_factor(units.length, "length")
    if kind == "length":
        return "m", length
    return "Pa", si_factor(units.force, "force") / length**2


def _table(map_fit: MapFit, quantities: dict[str, np.ndarray]) -> str:
    """Return map.csv: a row for each pixel."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [name for name in quantities if name != "explained"]
    writer.writerow(["row", "column", "x", "y", "status", "reason", "explained", *names])
    rows, columns = map_fit.value.shape
    spacing = (
        (math.nan, math.nan)
        if map_fit.size is None
        else (map_fit.size[0] / rows, map_fit.size[1] / columns)
    )
    for row, column in np.ndindex(rows, columns):
        code = int(map_fit.reason[row, column])
        is_fitted = code == FITTED
        reason = REASONS[code] if code >= 0 else "no curve"
        explained = bool(map_fit.explained[row, column] == 1.0)
        cells = [
            row,
            column,
            _cell((column + 0.5) * spacing[1]),
            _cell((row + 0.5) * spacing[0]),
            "done" if is_fitted else "refused",
            reason,
            str(explained).lower() if is_fitted else "",
        ]
        writer.writerow([*cells, *(_cell(float(quantities[name][row, column])) for name in names)])
    return text.getvalue()


def _cell(value: float) -> str:
    return f"{value:.7g}" if math.isfinite(value) else ""


def has_ended(report: Mapping[str, Any]) -> bool:
    """Return False if fit.json is that of a map whose fit is running, interrupted or killed."""
    is_running = report.get("status") in ("running", "interrupted")
    return not (is_running and "source" in report)


def read_map(folder: Path) -> MapFit:
    """Return the map of a folder; raise UsageError if it has no readable map."""
    entry = read_report(folder, FIT)
    if not has_ended(entry):
        raise UsageError(
            f"{folder}: the fit of this map has not ended",
            "call `indent-sim fit` again with the same options, which continues it",
        )
    try:
        arrays, attributes = read_hdf5_file(folder / MAP_FIELDS)
        key = str(attributes["key"])
        size = attributes.get("size_m")
        noise = PooledNoise.from_record(entry["map"]["noise"])
        return MapFit(
            key,
            arrays.pop(key),
            arrays.pop(f"{key}_low"),
            arrays.pop(f"{key}_high"),
            arrays.pop("statistical_low"),
            arrays.pop("statistical_high"),
            arrays.pop("explained"),
            arrays.pop("reason").astype(int),
            arrays.pop("height"),
            arrays.pop("thickness", None),
            arrays,
            None if size is None else (float(size[0]), float(size[1])),
            noise,
            entry,
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{folder} contains no readable map: {type(error).__name__} {error}"
        ) from None
