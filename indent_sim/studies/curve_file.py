"""File of the curves of many runs: curves.h5, or curves.csv if there are few."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import isnan
from pathlib import Path

import numpy as np

from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import temporary_path, write_atomically
from indent_sim.results.result_files import PROGRAM
from indent_sim.studies import study_folder, study_table
from indent_sim.studies.row_file import CURVE_COLUMNS
from indent_sim.studies.study_table import Row

# Index of a row of study.csv, and its curve; (rows, CURVE_COLUMNS).
RowWithCurve = tuple[Row, np.ndarray]


class CurveWriter:
    """Writer of curves.h5, or of curves.csv if there are few rows."""

    def __init__(self, directory: Path):
        import h5py

        self._path = directory / study_folder.CURVES_HDF5
        self._csv_path = directory / study_folder.CURVES
        self._new_path = temporary_path(self._path)
        self._new_path.unlink(missing_ok=True)
        self._file = h5py.File(self._new_path, "w")
        self._file.attrs.update({"program": PROGRAM, "version": VERSION})
        self._file.attrs["index"] = "number of the run in study.csv"
        self._blocks: list[np.ndarray] = []
        self._collected = 0
        self._total = 0

    def append(self, index: int, curve: np.ndarray) -> None:
        """Append the curve of a run."""
        if not len(curve):
            return
        self._blocks.append(np.column_stack([np.full(len(curve), float(index)), curve]))
        self._collected += len(curve)
        # Rows of curves that are collected before they are written.
        block_size = 1 << 16
        if self._collected >= block_size:
            self._flush()

    def finish(self, keys: Sequence[str], rows: Callable[[], Iterator[RowWithCurve]]) -> None:
        """Give curves.h5 its final name, or write curves.csv instead."""
        self._flush()
        self._file.close()
        # With more rows in all curves together, curves.h5 is written instead of curves.csv.
        max_csv_curve_rows = 100_000
        if self._total > max_csv_curve_rows:
            self._new_path.replace(self._path)
            self._csv_path.unlink(missing_ok=True)
            return
        self._new_path.unlink()
        write_atomically(self._csv_path, _csv_lines(keys, rows()))
        self._path.unlink(missing_ok=True)

    def abandon(self) -> None:
        """Delete an unfinished file."""
        # On a full disk the file cannot be closed.
        with suppress(OSError, RuntimeError):
            self._file.close()
        self._new_path.unlink(missing_ok=True)

    def _flush(self) -> None:
        """Write the collected rows."""
        if not self._blocks:
            return
        block = np.concatenate(self._blocks)
        end = self._total + len(block)
        for name, column in zip(("index", *CURVE_COLUMNS), block.T, strict=True):
            if name not in self._file:
                kind = "<i8" if name in ("index", "step") else "<f8"
                chunks = (1 << 16,)
                self._file.create_dataset(
                    name, (0,), kind, maxshape=(None,), chunks=chunks, compression=1, shuffle=True
                )
            self._file[name].resize((end,))
            self._file[name][self._total :] = column
        self._total = end
        self._blocks.clear()
        self._collected = 0


def read_curves(folder: Path, runs: Mapping[int, str]) -> list[np.ndarray]:
    """Read the depths and forces of some runs; each array is (rows, 2).

    Parameters
    ----------
    folder
        Folder of the study.
    runs
        Names of the runs by their numbers in study.csv.
    """
    if (folder / study_folder.CURVES_HDF5).exists():
        return _read_hdf5(folder / study_folder.CURVES_HDF5, runs)
    curves: dict[str, list[list[float]]] = {}
    names = set(runs.values())
    with open(folder / study_folder.CURVES, encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            if row["run"] in names:
                curves.setdefault(row["run"], []).append([float(row["delta"]), float(row["force"])])
    return [np.array(curve) for curve in curves.values()]


def _read_hdf5(path: Path, runs: Mapping[int, str]) -> list[np.ndarray]:
    """Read the depths and forces of some runs from curves.h5."""
    import h5py

    chosen = np.array(sorted(runs))
    parts = []
    with h5py.File(path, "r") as file:
        # Rows that are read at a time.
        block_size = 1 << 20
        for start in range(0, len(file["index"]), block_size):
            block = slice(start, start + block_size)
            index = file["index"][block]
            is_chosen = np.isin(index, chosen)
            columns = [index, file["delta"][block], file["force"][block]]
            parts.append(np.column_stack(columns)[is_chosen])
    rows = np.concatenate(parts)
    places = np.flatnonzero(np.diff(rows[:, 0])) + 1
    return [curve[:, 1:] for curve in np.split(rows, places)]


def _csv_lines(keys: Sequence[str], rows: Iterator[RowWithCurve]) -> Iterator[str]:
    """Yield the lines of curves.csv."""
    columns = ("run", *keys)
    yield ",".join((*columns, *CURVE_COLUMNS)) + "\n"
    for row, curve in rows:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        values = [study_table.cell_text(row[name]) for name in columns]
        for numbers in curve:
            cells = ["" if isnan(number) else repr(float(number)) for number in numbers[1:]]
            writer.writerow([*values, int(numbers[0]), *cells])
        yield text.getvalue()
