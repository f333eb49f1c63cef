"""Maps of curves: their places, and how little of them is read."""

from __future__ import annotations

import itertools
import tracemalloc
from pathlib import Path

import jpk_files
import numpy as np
import pytest
from jpk_files import segment

from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.measured_map import MeasuredMap, grid_places
from indent_sim.results.measured.measurement import NoCurve, Uncalibrated

GRID = jpk_files.Grid(3, 2, 9e-6, 4e-6, True)


def jpk_map(folder: Path, count: int = 6, grid: jpk_files.Grid | None = GRID, **layout):  # type: ignore[no-untyped-def]
    """Read a map whose curves have 4, 5, 6, ... points in their approach."""
    curves = [[segment("extend", 4 + k)] for k in range(count)]
    layout = {"kind": "force-scan-map", "grid": grid} | layout
    path = folder / "gel.jpk-force-map"
    found = read_curves(jpk_files.write(path, jpk_files.members(curves, **layout)))
    assert isinstance(found, MeasuredMap)
    return found


def test_odd_rows_run_backwards(tmp_path):
    found = jpk_map(tmp_path)
    assert found.shape == (2, 3)
    assert found.size == (4e-6, 9e-6)
    assert [found.place(k) for k in range(6)] == [(0, 0), (0, 1), (0, 2), (1, 2), (1, 1), (1, 0)]
    assert found.stiffness == jpk_files.STIFFNESS
    assert found.units["length"] == "m"
    assert found.height is None
    points = found.image(np.array([len(curve) for curve in found]))
    assert points.tolist() == [[4, 5, 6], [9, 8, 7]]


def test_rows_of_quantitative_images_run_forwards(tmp_path):
    grid = jpk_files.Grid(3, 2, 9e-6, 4e-6, False)
    found = jpk_map(tmp_path, grid=grid, kind="quantitative-imaging-map")
    assert [found.place(k) for k in (2, 3, 5)] == [(0, 2), (1, 0), (1, 2)]


def test_places_without_a_curve(tmp_path):
    found = jpk_map(tmp_path, count=2, numbers=(1, 3))
    assert len(found) == 2
    assert [found.place(0), found.place(1)] == [(0, 1), (1, 2)]
    points = found.image(np.array([1.0, 2.0]))
    assert np.array_equal(points, [[np.nan, 1, np.nan], [np.nan, np.nan, 2]], equal_nan=True)


@pytest.mark.parametrize("columns", [0, -3, 1, 2.5, "x", 10**7])
def test_without_a_possible_grid_the_curves_are_one_row(tmp_path, columns):
    for grid in (None, jpk_files.Grid(columns, 2, 1e-6, 1e-6, True)):
        found = jpk_map(tmp_path, grid=grid)
        assert found.shape == (1, 6)
        assert found.size is None
        assert found.place(5) == (0, 5)


def test_a_sequence(tmp_path):
    found = jpk_map(tmp_path)
    assert [len(curve) for curve in found[1:3]] == [5, 6]
    assert len(found[-1]) == len(found.curve(5)) == 9
    assert [curve.name for curve in itertools.islice(found, 2)] == ["gel-0", "gel-1"]
    with pytest.raises(IndexError):
        found[6]


def test_a_map_without_calibration_is_refused_at_once(tmp_path):
    with pytest.raises(Uncalibrated, match="lacks spring constant"):
        jpk_map(tmp_path, spring=None)


def test_a_damaged_first_curve_does_not_hide_the_others(tmp_path):
    files = jpk_files.members([[segment("extend", 5)]] * 2, kind="force-scan-map")
    files["index/0/segments/0/channels/vDeflection.dat"] = b""
    found = read_curves(jpk_files.write(tmp_path / "m.jpk-force-map", files))
    with pytest.raises(NoCurve):
        found[0]
    assert len(found[1]) == 5


def test_curves_are_not_kept(tmp_path):
    count, points = 30, 100_000
    curves = [[segment("extend", points)]] * count
    files = jpk_files.members(curves, kind="force-scan-map")
    path = jpk_files.write(tmp_path / "m.jpk-force-map", files)
    tracemalloc.start()
    assert sum(len(curve) for curve in read_curves(path)) == count * points
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Three columns of a curve have 2.4 MB, all curves 72 MB.
    assert peak < 15e6


def test_places_of_a_path():
    places = grid_places(np.arange(4), 2, True)
    assert places.tolist() == [[0, 0], [0, 1], [1, 1], [1, 0]]
