"""Row files of a study: rows and curves of many runs, appended to one HDF5 file per shard.

The datasets of a row file are contiguous and larger than their content. A row is written into
reserved space without changing the structure of the HDF5 file, so that the file can be opened even
if the process is killed while it writes. A row counts as complete if its checksum is right; its
curve and its texts are written before it.
"""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.process.file_locks import lock_file
from indent_sim.process.regular_files import open_descriptor, open_regular_file, write_at
from indent_sim.process.signals import defer_signals
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import temporary_path
from indent_sim.results.result_files import PROGRAM

ROWS_FOLDER = "rows"
# Names of the numbers and texts of a row, apart from its identity and its curve.
NUMBERS = (
    "steps_done",
    "force",
    "a",
    "p_max",
    "penetration",
    "stiffness",
    "dofs",
    "newton_iterations",
    "substeps",
    "cpu_resolve",
    "cpu_companions",
    "cpu_mesh",
    "cpu_assemble",
    "cpu_solve",
    "cpu_write",
    "cpu_s",
    "wall_s",
    "memory_MB",
    "peak_memory_MB",
    "stated_error",
)
WHOLE_NUMBERS = ("steps_done", "dofs", "newton_iterations", "substeps")
TEXTS = ("run", "status", "reason", "method", "warnings")
CURVE_COLUMNS = ("step", "delta", "force", "a", "force_error")
_ROW_TYPE = np.dtype(
    [
        ("settings", "<u8"),
        ("physics", "<u8"),
        ("exit_code", "<i4"),
        ("curve_rows", "<u4"),
        ("curve_start", "<u8"),
        *((name, "<f8") for name in NUMBERS),
        *((f"{name}_start", "<u8") for name in TEXTS),
        *((f"{name}_length", "<u4") for name in TEXTS),
        ("content_checksum", "<u4"),
        ("checksum", "<u4"),
    ]
)
_FIELDS = _ROW_TYPE.names or ()
_CURVE_TYPE = np.dtype((np.float64, (len(CURVE_COLUMNS),)))
_TYPES = {"rows": _ROW_TYPE, "curves": _CURVE_TYPE, "texts": np.dtype("u1")}
# Capacities of the datasets of a new file. A capacity is doubled when it is exhausted.
_FIRST_CAPACITIES = {"rows": 256, "curves": 4096, "texts": 65536}
# Largest length of a text of a row [bytes].
_MAX_TEXT_BYTES = 20_000
_LAYOUT = 1


@dataclass(frozen=True)
class RunRow:
    """Row of one run: its identity, its cells of the table and its curve.

    Attributes
    ----------
    settings
        Checksum of the scene's document with its settings, by which a row is found quickly.
    physics
        Checksum of the physics (`PlannedRun.identity`), 0 if the scene is invalid.
    cells
        Cells of the table by column: NUMBERS, TEXTS and exit_code; None where unknown.
    curve
        The columns CURVE_COLUMNS; (rows, columns).
    """

    settings: int
    physics: int
    cells: Mapping[str, Any]
    curve: np.ndarray


class RowFile:
    """Row file that is open for reading; incomplete rows are omitted."""

    def __init__(self, path: Path):
        self.path = path
        try:
            self._maps = _map_datasets(path)
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise UsageError(
                f"{path} is not a readable file of rows: {error}",
                "move it to another folder; --resume then computes its rows again",
                str(path),
            ) from None
        self.numbers = _complete_rows(self._maps["rows"])

    @property
    def is_finished(self) -> np.ndarray:
        """True for each complete row that need not be computed again."""
        rows = self._maps["rows"][self.numbers]
        is_finished = np.ones(len(rows), dtype=bool)
        for position in np.flatnonzero(rows["exit_code"]):
            cells = self.read(int(self.numbers[position])).cells
            is_finished[position] = not is_failure_of_machine(cells["exit_code"], cells["reason"])
        return is_finished

    def column(self, name: str) -> np.ndarray:
        """Return the values (rows,) of a column in all complete rows; NaN for empty cells."""
        return np.array(self._maps["rows"][name][self.numbers])

    def read(self, number: int) -> RunRow:
        """Return a complete row; raise UsageError if its curve or its texts are damaged."""
        record = self._maps["rows"][number].item()
        fields = dict(zip(_FIELDS, record, strict=True))
        start = fields["curve_start"]
        curve = np.array(self._maps["curves"][start : start + fields["curve_rows"]])
        texts = {name: self._text(fields, name) for name in TEXTS}
        if fields["content_checksum"] != _content_checksum(curve, texts.values()):
            raise UsageError(f"{self.path}: row {number + 1} is damaged", file=str(self.path))
        cells: dict[str, Any] = {name: _number_of(name, fields[name]) for name in NUMBERS}
        cells |= {name: text.decode("utf-8", "replace") or None for name, text in texts.items()}
        cells["reason"] = cells["reason"] or ""
        cells["warnings"] = cells["warnings"] or ""
        cells["exit_code"] = fields["exit_code"]
        return RunRow(fields["settings"], fields["physics"], cells, curve)

    def _text(self, fields: Mapping[str, Any], name: str) -> bytes:
        """Return a text that is stored for a row; empty if its position is outside the file."""
        start = fields[f"{name}_start"]
        return self._maps["texts"][start : start + fields[f"{name}_length"]].tobytes()


class RowWriter:
    """Writer of a row file, which holds a lock on the file; a context manager.

    Parameters
    ----------
    path
        The file, which is created if it does not exist.

    Raises
    ------
    UsageError
        Another process writes the file, or it is damaged.
    """

    def __init__(self, path: Path):
        self._path = path
        self._lock = open_descriptor(path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT)
        self._descriptor = -1
        self._offsets: dict[str, int] = {}
        self._capacities: dict[str, int] = {}
        self._used = dict.fromkeys(_TYPES, 0)
        # Positions in the file of texts that occur in many rows.
        self._text_places: dict[bytes, int] = {}

    def __enter__(self) -> Self:
        try:
            _lock_file(self._lock, self._path)
            if os.path.lexists(self._path):
                self._find_end()
            else:
                _create_file(self._path, _FIRST_CAPACITIES)
            self._open_file()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        try:
            os.fsync(self._descriptor)
            # The file is written again without the unused ends of its datasets.
            with suppress(OSError), defer_signals():
                self._move_to_new_file({name: max(1, size) for name, size in self._used.items()})
        finally:
            self._close()

    def append(self, row: RunRow) -> None:
        """Append a row; after this method has returned, the row survives a kill of the process."""
        with defer_signals():
            self._append_row(row)

    def _append_row(self, row: RunRow) -> None:
        """Append a row: first its curve and its texts, then the row itself."""
        curve = np.ascontiguousarray(row.curve, dtype=np.float64).reshape(-1, len(CURVE_COLUMNS))
        texts = {name: _text_bytes(row.cells.get(name)) for name in TEXTS}
        record = np.zeros(1, _ROW_TYPE)
        record["settings"] = row.settings
        record["physics"] = row.physics
        record["exit_code"] = row.cells["exit_code"]
        record["curve_rows"] = len(curve)
        record["curve_start"] = self._append("curves", curve)
        for name in NUMBERS:
            value = row.cells.get(name)
            record[name] = np.nan if value is None else value
        for name, text in texts.items():
            record[f"{name}_start"] = self._text_place(text)
            record[f"{name}_length"] = len(text)
        record["content_checksum"] = _content_checksum(curve, texts.values())
        record["checksum"] = _row_checksum(record.tobytes())
        self._append("rows", record)

    def sync(self) -> None:
        """Wait until all rows are on the disk."""
        os.fsync(self._descriptor)

    def _text_place(self, text: bytes) -> int:
        """Return the position of a text in the file; append the text if the file lacks it."""
        if text in self._text_places:
            return self._text_places[text]
        place = self._append("texts", np.frombuffer(text, np.uint8))
        # Largest number of texts whose positions are remembered. Repeated texts are words and
        # messages without numbers.
        max_remembered = 64
        if len(self._text_places) < max_remembered:
            self._text_places[text] = place
        return place

    def _append(self, name: str, values: np.ndarray) -> int:
        """Write values after the content of a dataset, and return the position of the first one."""
        start = self._used[name]
        end = start + len(values)
        if end > self._capacities[name]:
            self._move_to_new_file(self._capacities | {name: max(2 * self._capacities[name], end)})
        content = memoryview(values.tobytes())
        position = self._offsets[name] + start * _TYPES[name].itemsize
        while content:
            written = write_at(self._descriptor, content, position)
            content = content[written:]
            position = position + written
        self._used[name] = end
        return start

    def _find_end(self) -> None:
        """Find the ends of the datasets after the last complete row."""
        rows = RowFile(self._path)
        if not len(rows.numbers):
            return
        self._used["rows"] = int(rows.numbers[-1]) + 1
        self._used["curves"] = int((rows.column("curve_start") + rows.column("curve_rows")).max())
        self._used["texts"] = max(
            int((rows.column(f"{name}_start") + rows.column(f"{name}_length")).max())
            for name in TEXTS
        )

    def _open_file(self) -> None:
        """Open the file for writing, and find the positions of its datasets."""
        with open_regular_file(self._path, links=False) as stream:
            places = _dataset_places(stream)
        self._offsets = {name: place for name, (place, _) in places.items()}
        self._capacities = {name: capacity for name, (_, capacity) in places.items()}
        self._descriptor = open_descriptor(self._path, os.O_RDWR)

    def _move_to_new_file(self, capacities: Mapping[str, int]) -> None:
        """Replace the file by one with other capacities and the same content."""
        new_path = temporary_path(self._path)
        new_path.unlink(missing_ok=True)
        _create_file(new_path, capacities)
        with open(new_path, "r+b") as target:
            for name, (place, _) in _dataset_places(target).items():
                target.seek(place)
                for block in self._content(name):
                    target.write(block)
            target.flush()
            os.fsync(target.fileno())
        # Windows does not replace a file that is open.
        os.close(self._descriptor)
        self._descriptor = -1
        os.replace(new_path, self._path)
        self._open_file()

    def _content(self, name: str) -> Iterator[bytes]:
        """Yield the content of a dataset in blocks."""
        size = self._used[name] * _TYPES[name].itemsize
        # Size of a block [bytes].
        block_size = 1 << 22
        for start in range(0, size, block_size):
            length = min(block_size, size - start)
            os.lseek(self._descriptor, self._offsets[name] + start, os.SEEK_SET)
            yield os.read(self._descriptor, length)

    def _close(self) -> None:
        """Close the file and release its lock."""
        for descriptor in (self._descriptor, self._lock):
            if descriptor >= 0:
                os.close(descriptor)
        self._descriptor = self._lock = -1


class RowIndex:
    """Index of all rows of a study by their settings and by their physics.

    Of several rows with the same key the last finished one counts.
    """

    def __init__(self, folder: Path):
        self._files = [RowFile(path) for path in row_files(folder)]
        files = [np.full(len(file.numbers), i, np.int32) for i, file in enumerate(self._files)]
        self._file_of_row = _joined(files, np.int32)
        self._number_of_row = _joined([file.numbers for file in self._files], np.int64)
        self._is_finished = _joined([file.is_finished for file in self._files], bool)
        self._orders: dict[str, np.ndarray] = {}
        self._keys: dict[str, np.ndarray] = {}
        for name in ("settings", "physics"):
            keys = _joined([file.column(name) for file in self._files], np.uint64)
            order = np.lexsort((np.arange(len(keys)), self._is_finished, keys))
            self._orders[name] = order
            self._keys[name] = keys[order]

    def __len__(self) -> int:
        return len(self._number_of_row)

    def find(self, settings: int) -> RunRow | None:
        """Return the row with the given settings; None if there is no such row."""
        return self._find("settings", settings, is_finished=False)

    def find_finished(self, settings: int) -> bool:
        """Return whether a row with the given settings need not be computed again."""
        return self._position("settings", settings, is_finished=True) is not None

    def find_physics(self, physics: int) -> RunRow | None:
        """Return the row of a finished run with the same physics; None if there is no such row."""
        return self._find("physics", physics, is_finished=True)

    def settings_of(self, physics: int) -> set[int]:
        """Return the checksums of the settings of all rows with the given physics."""
        keys = self._keys["physics"]
        first, end = (np.searchsorted(keys, np.uint64(physics), side) for side in ("left", "right"))
        positions = self._orders["physics"][first:end]
        settings = (
            self._files[self._file_of_row[position]].read(int(self._number_of_row[position]))
            for position in positions
        )
        return {row.settings for row in settings}

    @property
    def physics(self) -> np.ndarray:
        """Checksums of the physics of all finished rows, sorted."""
        order = self._orders["physics"]
        return self._keys["physics"][self._is_finished[order]]

    def _find(self, name: str, key: int, is_finished: bool) -> RunRow | None:
        position = self._position(name, key, is_finished)
        if position is None:
            return None
        return self._files[self._file_of_row[position]].read(int(self._number_of_row[position]))

    def _position(self, name: str, key: int, is_finished: bool) -> int | None:
        """Return the position of the last row with a key; None if no row has the key."""
        keys = self._keys[name]
        end = int(np.searchsorted(keys, np.uint64(key), side="right"))
        if not end or keys[end - 1] != key:
            return None
        position = int(self._orders[name][end - 1])
        return position if self._is_finished[position] or not is_finished else None


def row_files(folder: Path) -> list[Path]:
    """Return the row files of a study's folder of rows."""
    return sorted(folder.glob("*-of-*.h5")) if folder.is_dir() else []


def is_failure_of_machine(exit_code: int, reason: str) -> bool:
    """Return whether a run was stopped from outside, or ran out of memory or disk space."""
    # Exit codes of processes that were ended by the signals HUP, INT, BUS, KILL, TERM and XCPU.
    machine_codes = {128 + number for number in (1, 2, 7, 9, 15, 24)}
    return exit_code in machine_codes or reason.startswith(("MemoryError", "cannot write results"))


def _joined(parts: Iterable[np.ndarray], dtype: Any) -> np.ndarray:
    """Return arrays joined into one array, which is empty for no arrays."""
    return np.concatenate([np.empty(0, dtype), *parts]).astype(dtype)


def _create_file(path: Path, capacities: Mapping[str, int]) -> None:
    """Create a file with empty datasets; it gets its final name only when it is complete."""
    import h5py

    new_path = path.with_name(f".{path.name}.empty")
    new_path.unlink(missing_ok=True)
    with h5py.File(new_path, "w") as file:
        file.attrs.update({"program": PROGRAM, "version": VERSION, "layout": _LAYOUT})
        file.attrs["columns of curves"] = ", ".join(CURVE_COLUMNS)
        file.attrs["rows without a checksum"] = "empty: the run has not ended"
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_layout(h5py.h5d.CONTIGUOUS)
        # The space is now reserved, and the structure of the file no longer changes.
        properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        for name, capacity in capacities.items():
            kind = _TYPES[name]
            space = h5py.h5s.create_simple((capacity, *kind.shape))
            h5py.h5d.create(
                file.id, name.encode(), h5py.h5t.py_create(kind.base), space, properties
            )
    os.replace(new_path, path)


def _dataset_places(stream: BinaryIO) -> dict[str, tuple[int, int]]:
    """Return the position in the file [bytes] and the capacity of each dataset of a row file."""
    import h5py

    # HDF5 reads the stream itself: another process may replace the file of this name meanwhile.
    with h5py.File(stream, "r") as file:
        if file.attrs.get("program") != PROGRAM or file.attrs.get("layout") != _LAYOUT:
            raise ValueError(
                "it was written by another program, or by another version of this program"
            )
        places = {}
        for name, kind in _TYPES.items():
            dataset = file[name]
            place = dataset.id.get_offset()
            if dataset.dtype != kind.base or dataset.shape[1:] != kind.shape or place is None:
                raise ValueError(f"its dataset {name} has another layout")
            places[name] = (int(place), int(dataset.shape[0]))
    size = os.fstat(stream.fileno()).st_size
    for name, (place, capacity) in places.items():
        if place + capacity * _TYPES[name].itemsize > size:
            raise ValueError("it is shorter than its datasets")
    return places


def _map_datasets(path: Path) -> dict[str, np.ndarray]:
    """Return the datasets of a row file, mapped into memory."""
    with open_regular_file(path, links=False) as stream:
        return {
            name: np.memmap(stream, _TYPES[name].base, "r", place, (capacity, *_TYPES[name].shape))
            for name, (place, capacity) in _dataset_places(stream).items()
        }


def _complete_rows(rows: np.ndarray) -> np.ndarray:
    """Return the numbers of the rows whose checksum is right."""
    complete: list[np.ndarray] = []
    # Number of rows whose checksums are computed at a time.
    block_size = 4096
    for start in range(0, len(rows), block_size):
        block = rows[start : start + block_size]
        content = memoryview(block.tobytes())
        size = _ROW_TYPE.itemsize
        checksums = np.zeros(len(block), np.uint32)
        for number in np.flatnonzero(block["checksum"]):
            checksums[number] = _row_checksum(content[number * size : (number + 1) * size])
        complete.append(start + np.flatnonzero((checksums > 0) & (checksums == block["checksum"])))
    return _joined(complete, np.int64)


def _row_checksum(row: bytes | memoryview) -> int:
    """Return the checksum of a row, which is never 0."""
    return zlib.crc32(row[: -_ROW_TYPE["checksum"].itemsize]) or 1


def _content_checksum(curve: np.ndarray, texts: Iterable[bytes]) -> int:
    """Return the checksum of the curve and the texts of a row."""
    return zlib.crc32(b"\0".join(texts), zlib.crc32(curve.tobytes()))


def _text_bytes(value: object) -> bytes:
    """Return a text of a row as bytes, without the end of a very long text."""
    return ("" if value is None else str(value)).encode("utf-8", "replace")[:_MAX_TEXT_BYTES]


def _number_of(name: str, value: float) -> float | int | None:
    """Return a number as it was before it was written to a row; None for an empty cell."""
    if not math.isfinite(value):
        return None
    return int(value) if name in WHOLE_NUMBERS else value


@contextmanager
def gather_lock(folder: Path) -> Iterator[None]:
    """Context manager in which this process alone merges the rows of a folder.

    Raises UsageError if another process merges them.
    """
    if not folder.is_dir():
        yield
        return
    path = folder / "gather.lock"
    descriptor = open_descriptor(path, os.O_RDWR | os.O_CREAT)
    try:
        _lock_file(descriptor, folder)
        yield
    finally:
        os.close(descriptor)


def _lock_file(descriptor: int, path: Path) -> None:
    """Lock a row file for its only writer."""
    try:
        lock_file(descriptor)
    except BlockingIOError:
        raise UsageError(
            f"{path} is in use by another process", "wait until it has ended", str(path)
        ) from None
