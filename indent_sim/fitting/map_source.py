"""Source of a map: the files of its curves, with which the fit of one pixel is repeated later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.curve_fit import FitRequest, cantilever_stiffness_si
from indent_sim.fitting.fit_folder import ReadOptions
from indent_sim.fitting.inference.estimate import OriginOptions
from indent_sim.fitting.inference.pooled_noise import MIN_BASELINES
from indent_sim.process.errors import UsageError
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve


@dataclass(frozen=True)
class MapSource:
    """Files of a map, and how they are read.

    Attributes
    ----------
    paths
        Files and folders of curves.
    reading
        Options for reading the files.
    grid
        Numbers of rows and columns, if the files of a folder in the order of their names are a map.
    rows
        First row that is fitted, and the row after the last fitted row; None for all rows.
    """

    paths: tuple[Path, ...]
    reading: ReadOptions = field(default_factory=ReadOptions)
    grid: tuple[int, int] | None = None
    rows: tuple[int, int] | None = None

    def record(self) -> dict[str, Any]:
        """Return the source as data for JSON, with the properties by which a change is detected.

        Paths are absolute.
        """
        files = [file for path in self.paths for file in curve_files(path)]
        states = [file.stat() for file in files]
        return {
            "paths": [str(path.absolute()) for path in self.paths],
            "columns": list(self.reading.columns),
            "units": dict(self.reading.units or {}),
            "grid": self.grid,
            "rows": self.rows,
            "files": len(files),
            "bytes": sum(state.st_size for state in states),
            "modified": max(state.st_mtime_ns for state in states),
        }

    def open(self, request: FitRequest) -> MeasuredMap:
        """Return the map.

        Raises
        ------
        UsageError
            If the files are not a map, or if the map lacks the requested rows.
        """
        curves = find_map(self, request, True)
        assert curves is not None
        return curves


def source_of_record(record: Mapping[str, Any]) -> MapSource:
    """Return the source from its description, which `MapSource.record` made.

    Raises
    ------
    UsageError
        If a file is missing or has changed.
    """
    grid = record["grid"]
    rows = record["rows"]
    source = MapSource(
        tuple(map(Path, record["paths"])),
        ReadOptions(tuple(record["columns"]), record["units"] or None),
        (grid[0], grid[1]) if grid else None,
        (rows[0], rows[1]) if rows else None,
    )
    remedy = "put the files back, or fit the map again"
    for path in source.paths:
        if not path.exists():
            raise UsageError(
                f"{path}, to which the map was fitted, does not exist any more", remedy, str(path)
            )
    if source.record()["bytes"] != record["bytes"]:
        name = source.paths[0]
        raise UsageError(
            f"{name} has another size than the file to which the map was fitted", remedy, str(name)
        )
    return source


def request_of_record(record: Mapping[str, Any]) -> FitRequest:
    """Return the settings of a fit that `request_identity` has described."""
    return FitRequest(
        config_from_mapping(record["scene"]),
        tuple(record["vary"]),
        record["part"],
        OriginOptions(**record["origin"]),
        record["models"],
    )


def find_map(source: MapSource, request: FitRequest, choice: bool | None) -> MeasuredMap | None:
    """Return the map that is to be fitted; None if curves are to be fitted one by one.

    Parameters
    ----------
    source
        Files of the curves.
    request
        Settings of the fit.
    choice
        True for a map, False for single curves, None for a map if a file contains enough curves.

    Raises
    ------
    UsageError
        If a map is requested and the files contain no map, or a map without the requested rows.
    """
    if request.curve_part != "approach":
        if choice or source.grid is not None:
            raise UsageError(
                f"--segment {request.curve_part}: a map is fitted to the approach of its curves",
                "leave --segment out, or fit curve by curve with --no-map",
            )
        return None
    if choice is False:
        return None
    curves = _read_map(source, request, choice)
    if curves is not None:
        return curves if source.rows is None else _select_rows(curves, source.rows)
    if choice:
        raise UsageError(
            "--map: no file with a grid of curves", "give one map file, or a folder with --grid"
        )
    return None


def _read_map(source: MapSource, request: FitRequest, choice: bool | None) -> MeasuredMap | None:
    """Return the map in the files; None if the files contain no map.

    With `choice`, the option --map, an unreadable file raises NoCurve, and a map may have any size.
    """
    reading = source.reading
    if source.grid is not None:
        files = [file for path in source.paths for file in curve_files(path)]
        stiffness = cantilever_stiffness_si(request.config)
        return _map_of_files(files, source.grid, reading, stiffness)
    if len(source.paths) != 1 or not source.paths[0].is_file():
        return None
    try:
        curves = read_curves(
            source.paths[0],
            reading.columns or None,
            reading.units,
            cantilever_stiffness_si(request.config),
            reading.sensitivity,
        )
    except NoCurve:
        if choice:
            raise
        return None
    is_map = isinstance(curves, MeasuredMap) and (choice or len(curves) >= MIN_BASELINES)
    return curves if is_map and isinstance(curves, MeasuredMap) else None


def _select_rows(curves: MeasuredMap, rows: tuple[int, int]) -> MeasuredMap:
    """Return the map restricted to the curves of some rows."""
    if rows[1] > curves.shape[0]:
        raise UsageError(
            f"--rows {rows[0]}:{rows[1]}: the map has the rows 0:{curves.shape[0]}",
            "the number after the colon is the first row that is left out",
        )
    return curves.select_rows(*rows)


@dataclass(frozen=True)
class _CurveFiles:
    """Files of the curves of a map, one for each curve, and the scene's spring constant [N/m]."""

    files: Sequence[Path]
    reading: ReadOptions
    stiffness: float | None

    def read(self, index: int) -> MeasuredCurve:
        """Return the curve of a file."""
        reading = self.reading
        return read_curves(
            self.files[index],
            reading.columns or None,
            reading.units,
            self.stiffness,
            reading.sensitivity,
        )[0]


def _map_of_files(
    files: Sequence[Path], grid: tuple[int, int], reading: ReadOptions, stiffness: float | None
) -> MeasuredMap:
    """Return the map whose curves are the files, row by row."""
    rows, columns = grid
    if len(files) != rows * columns:
        raise UsageError(f"--grid {rows}x{columns}: there are {len(files)} files")
    places = np.column_stack(np.divmod(np.arange(len(files)), columns))
    return MeasuredMap(grid, None, places, _CurveFiles(files, reading, stiffness).read)


def named_curve(curves: MeasuredMap, index: int) -> MeasuredCurve:
    """Return a curve with its place as its name; raise NoCurve if it is damaged."""
    row, column = curves.place(index)
    return replace(curves[index], name=f"row {row} column {column}")
