"""Pixel of a fitted map: its curve, fitted anew with all tests of single curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.fitting import fit_picture
from indent_sim.fitting.curve_fit import (
    CurveFit,
    FitRequest,
    convert_to_scene_units,
    fit_curve,
    format_interval,
)
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import replace_numbers
from indent_sim.fitting.inference.model_assessment import Interval
from indent_sim.fitting.map_folder import read_map
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_scene import HEIGHT_KEY
from indent_sim.fitting.map_source import request_of_record, source_of_record
from indent_sim.process.errors import UsageError
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve


@dataclass(frozen=True)
class MapPixel:
    """Curve of a pixel, in units of the scene, with the settings of its fit and the result.

    `map_result` is a text with the result of the pixel in the map.
    """

    curve: MeasuredCurve
    request: FitRequest
    fit: CurveFit
    map_result: str

    def draw(self, path: Path) -> None:
        """Draw the curve with its fit into a file; a curve that was not fitted is drawn alone."""
        if self.fit.plotted is not None:
            fit_picture.draw_curve(self.fit, self.request.config, path, self.map_result)
        else:
            fit_picture.draw_rejected_curve(
                self.curve, self.fit, self.request.config, path, self.map_result
            )


def fit_pixel(folder: Path, row: int, column: int) -> MapPixel:
    """Fit the curve of a pixel of a map with all tests of single curves.

    Parameters
    ----------
    folder
        Folder of a fitted map.
    row, column
        The pixel, counted from 0 in the order of the scan.

    Raises
    ------
    UsageError
        If the map has no such pixel, or its files are missing or have changed.
    """
    map_fit = read_map(folder)
    rows, columns = map_fit.value.shape
    if not (row < rows and column < columns):
        raise UsageError(
            f"--pixel {row},{column}: the map has the rows 0 to {rows - 1} and the columns 0 to "
            f"{columns - 1}"
        )
    if "source" not in map_fit.entry:
        raise UsageError(
            f"{folder} does not state from which file its curves were read",
            "fit the map again",
            str(folder),
        )
    source = source_of_record(map_fit.entry["source"])
    request = _request_of_pixel(map_fit.entry["request"], map_fit, row, column)
    curves = source.open(request)
    index = curves.index_of(row, column)
    if index is None:
        raise UsageError(f"--pixel {row},{column}: no curve was fitted at this place")
    try:
        curve = curves[index]
    except NoCurve as error:
        raise UsageError(f"--pixel {row},{column}: {error}") from None
    curve = replace(curve, name=f"row {row}, column {column} of {source.paths[0].name}")
    curve = convert_to_scene_units(curve, request.config)
    fit = fit_curve(curve, request, ForwardModelCache())
    return MapPixel(curve, request, fit, _map_result(map_fit, request, row, column))


def _request_of_pixel(
    record: Mapping[str, Any], map_fit: MapFit, row: int, column: int
) -> FitRequest:
    """Return the settings of the fit of a pixel, with its thickness."""
    request = request_of_record(record)
    if map_fit.thickness is None or not np.isfinite(map_fit.thickness[row, column]):
        return request
    thickness = float(map_fit.thickness[row, column])
    return replace(request, config=replace_numbers(request.config, {HEIGHT_KEY: thickness}))


def _map_result(map_fit: MapFit, request: FitRequest, row: int, column: int) -> str:
    """Return the interval of a pixel in the map, or the reason for which it was refused."""
    if reason := int(map_fit.reason[row, column]):
        return f"in the map: {map_fit.reasons[reason]}"
    interval = Interval(
        *(float(image[row, column]) for image in (map_fit.value, map_fit.low, map_fit.high))
    )
    return f"in the map: {format_interval(map_fit.key, request.config, interval)}"
