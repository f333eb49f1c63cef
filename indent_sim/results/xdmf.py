"""fields.xdmf and fields/ for ParaView, readable after a kill at any moment.

fields/ holds the mesh and every kept state in an HDF5 file each, made in memory and written aside and renamed: the HDF5
library itself takes a full disk very badly. fields.xdmf names a state once its file is there. Where all states are kept
each is added to it in one write before the tags that close it, so that the bytes written grow with their number.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.results.folder import FIELDS, append_whole, content, field_files, write_atomically

CELLS = {3: "Triangle", 4: "Tetrahedron"}
ARRAYS: dict[str, tuple[str, str, tuple[int, ...]]] = {
    "displacement": ("Node", "Vector", (3,)),
    "stress": ("Cell", "Tensor", (9,)),
    "pressure": ("Node", "Scalar", ()),
}
XDMF, MESH, OLD = "fields.xdmf", "mesh.h5", "fields.h5"
GRID = re.compile(
    r'<Grid Name="step (?P<step>\d{1,9})".*?Name="delta" Value="(?P<delta>[^"]*)".*?</Grid>\n', re.DOTALL
)
HEAD = (
    '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n<Domain>\n'
    '<Grid Name="indent-sim" GridType="Collection" CollectionType="Temporal">\n'
)
TAIL = "</Grid>\n</Domain>\n</Xdmf>\n"


@dataclass(frozen=True)
class _Kept:
    """A state in the files: its step, depth and XDMF."""

    step: int
    delta: float
    text: str


class FieldWriter:
    """A growing time series of displacement [length], stress and pressure [pressure] on one mesh.

    points (n, 2) or (n, 3) [length], two columns being (x, z); cells (m, 3) or (m, 4) vertex numbers. All states are
    kept, or the deepest and the last. The time of a state is its step: depths may go back.
    With `done` the states of the first so many steps that are there stay (`continued`), unless the files are
    missing, damaged or of another mesh: then they begin anew.
    """

    def __init__(self, directory: Path, points: np.ndarray, cells: np.ndarray, *, keep_all: bool = False,
                 done: int | None = None):  # fmt: skip
        self.directory = Path(directory)
        self._all = keep_all
        self._points, self._cells = in_space(points), np.asarray(cells)
        self._counts = {"Node": len(self._points), "Cell": len(self._cells)}
        found = self._found(done) if done is not None else None
        self.continued = found is not None
        self._kept = found or []
        if not self.continued:
            self._begin()
        self._save()

    def write(
        self, step: int, delta: float, displacement: np.ndarray, stress: np.ndarray, pressure: np.ndarray
    ) -> None:
        """Add one state: displacement (n, 2 or 3), stress (m, 3, 3), pressure (n,). OSError on a full disk."""
        values = {"displacement": in_space(displacement), "stress": stress, "pressure": pressure}
        arrays = {name: np.reshape(value, self._shape(name)).astype("<f8") for name, value in values.items()}
        write_atomically(self._fields / _file(step), _hdf5(arrays), sync=False)
        state = self._state(step, delta)
        if self._all:
            append_whole(self.directory / XDMF, state.text.encode(), sync=False, tail=TAIL.encode())
            return
        deepest = sorted(self._kept, key=lambda kept: kept.delta)[-1:]
        self._kept = [*(kept for kept in deepest if kept.delta > delta), state]
        self._save()

    @property
    def _fields(self) -> Path:
        return self.directory / FIELDS

    def _begin(self) -> None:
        """The mesh in a folder that has no state."""
        self._fields.mkdir(exist_ok=True)
        mesh = {"points": self._points.astype("<f8"), "cells": self._cells.astype("<i8")}
        write_atomically(self._fields / MESH, _hdf5(mesh), sync=False)
        (self.directory / OLD).unlink(missing_ok=True)

    def _found(self, done: int) -> list[_Kept] | None:
        """The states up to step `done` in the files of an earlier run; None where they are of no use."""
        try:
            mesh = _arrays(self._fields / MESH)
            if not (np.array_equal(mesh["points"], self._points) and np.array_equal(mesh["cells"], self._cells)):
                return None
            grids = GRID.finditer(content(self.directory / XDMF).decode("utf-8"))
            kept = [self._state(int(grid["step"]), float(grid["delta"])) for grid in grids if int(grid["step"]) <= done]
            return kept if all(self._is_whole(state.step) for state in kept) else None
        except Exception:  # HDF5 has an error for every way of being damaged
            return None

    def _is_whole(self, step: int) -> bool:
        arrays = _arrays(self._fields / _file(step))
        return all(arrays[name].shape == self._shape(name) for name in ARRAYS)

    def _shape(self, name: str) -> tuple[int, ...]:
        center, _, components = ARRAYS[name]
        return (self._counts[center], *components)

    def _state(self, step: int, delta: float) -> _Kept:
        attributes = "".join(
            f'<Attribute Name="{name}" Center="{center}" AttributeType="{kind}">'
            f"{_item(_file(step), name, self._shape(name))}</Attribute>\n"
            for name, (center, kind, _) in ARRAYS.items()
        )
        head = f'<Grid Name="step {step}" GridType="Uniform">\n<Time Value="{step}"/>\n'
        depth = f'<Information Name="delta" Value="{delta:.17g}"/>\n'
        return _Kept(step, delta, f"{head}{depth}{self._mesh()}{attributes}</Grid>\n")

    def _mesh(self) -> str:
        cells, corners = self._cells.shape
        return (
            f'<Topology TopologyType="{CELLS[corners]}" NumberOfElements="{cells}">'
            f"{_item(MESH, 'cells', (cells, corners), 'Int')}</Topology>\n"
            f'<Geometry GeometryType="XYZ">{_item(MESH, "points", self._points.shape)}</Geometry>\n'
        )

    def _save(self) -> None:
        """Name the states that are kept, and no others; then theirs may go."""
        text = HEAD + "".join(state.text for state in self._kept) + TAIL
        write_atomically(self.directory / XDMF, text, sync=False)
        named = {MESH, *(_file(state.step) for state in self._kept)}
        for path in field_files(self._fields):
            if path.name not in named:
                path.unlink()


def lost_fields(folder: Path) -> list[str]:
    """The files of fields that a finished run left in its folder and that are missing or damaged now, by name."""
    try:
        text = content(folder / XDMF).decode("utf-8")
    except (OSError, ValueError):
        return [XDMF]
    steps = [int(grid["step"]) for grid in GRID.finditer(text)]
    if not (steps and text.endswith(TAIL)):
        return [XDMF]
    wanted = {MESH: {"points", "cells"}} | {_file(step): set(ARRAYS) for step in steps}
    return [f"{FIELDS}/{name}" for name, arrays in wanted.items() if not arrays <= _names(folder / FIELDS / name)]


def in_space(vectors: np.ndarray) -> np.ndarray:
    """(n, 2) vectors of the (x, z) plane as (n, 3); (n, 3) as they are."""
    vectors = np.asarray(vectors, dtype=float)
    if vectors.shape[1] == 3:
        return vectors
    return np.column_stack([vectors[:, 0], np.zeros(len(vectors)), vectors[:, 1]])


def _file(step: int) -> str:
    return f"step-{step}.h5"


def _item(file: str, path: str, shape: tuple[int, ...], kind: str = "Float") -> str:
    dimensions = " ".join(str(n) for n in shape)
    form = f'DataType="{kind}" Precision="8" Format="HDF" Dimensions="{dimensions}"'
    return f"<DataItem {form}>{FIELDS}/{file}:/{path}</DataItem>"


def _hdf5(arrays: dict[str, np.ndarray]) -> bytes:
    """The bytes of an HDF5 file."""
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return image.getvalue()


def _names(path: Path) -> set[str]:
    """The names of what an HDF5 file holds, none when it is damaged."""
    try:
        return set(_arrays(path))
    except Exception:  # HDF5 has an error for every way of being damaged
        return set()


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """What an HDF5 file holds; any exception when it is damaged."""
    import h5py

    with h5py.File(io.BytesIO(content(path)), "r") as file:
        return {name: values[()] for name, values in file.items()}
