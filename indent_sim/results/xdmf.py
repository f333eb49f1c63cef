"""fields.xdmf + fields.h5 for ParaView, readable after a kill at any moment.

The HDF5 file is made once, complete and in one rename, with a slot for every state to come; a state then only
fills raw bytes of its slot, which cannot hurt the file's structure, and is named in the XDMF file, which is
replaced whole. Slots not filled are holes and take no disk space.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.results.folder import content, write_atomically

CELLS = {3: "Triangle", 4: "Tetrahedron"}
ARRAYS: dict[str, tuple[str, str, tuple[int, ...]]] = {
    "displacement": ("Node", "Vector", (3,)),
    "stress": ("Cell", "Tensor", (9,)),
    "pressure": ("Node", "Scalar", ()),
}
H5, XDMF = "fields.h5", "fields.xdmf"
GRID = re.compile(
    r'<Grid Name="step (?P<step>\d+)".*?Name="delta" Value="(?P<delta>[^"]*)".*?:/state/(?P<slot>\d+)/.*?</Grid>\n',
    re.DOTALL,
)
SLOTS = 3  # for the deepest and the last state, and the one that is being written
HEADERS = 4096  # bytes of metadata a slot, generously


@dataclass(frozen=True)
class _Kept:
    """A state in the files: its slot, depth and XDMF."""

    slot: int
    delta: float
    text: str


class FieldWriter:
    """A growing time series of displacement [length], stress and pressure [pressure] on one mesh.

    points (n, 2) or (n, 3) [length], two columns being (x, z); cells (m, 3) or (m, 4) vertex numbers. `slots`
    states are kept, or with None the deepest and the last. The time of a state is its step: depths may go back.
    With `done` the states of the first so many steps that are there stay (`continued`), unless the files are
    missing, damaged or of another mesh: then they begin anew.
    """

    def __init__(self, directory: Path, points: np.ndarray, cells: np.ndarray, slots: int | None = None,
                 done: int | None = None):  # fmt: skip
        self.directory = Path(directory)
        self._all = slots is not None
        self._slots = slots or SLOTS
        self._kept: list[_Kept] = []
        points, cells = in_space(points), np.asarray(cells)
        self._counts = {"Node": len(points), "Cell": len(cells)}
        self._shape = np.shape(cells)
        found = self._find(points, cells, done) if done is not None else None
        self.continued = found is not None
        self._offsets = found or self._create(points, cells)
        self._file = os.open(self.directory / H5, os.O_WRONLY)
        self._save()

    def write(
        self, step: int, delta: float, displacement: np.ndarray, stress: np.ndarray, pressure: np.ndarray
    ) -> None:
        """Add one state: displacement (n, 2 or 3), stress (m, 3, 3), pressure (n,)."""
        slot = self._free_slot()
        values = {"displacement": in_space(displacement), "stress": stress, "pressure": pressure}
        for name, value in values.items():
            data = np.ascontiguousarray(value, dtype="<f8").reshape(self._array_shape(name))
            _fill(self._file, data.tobytes(), self._offsets[slot][name])
        if not self._all:
            deepest = sorted(self._kept, key=lambda kept: kept.delta)[-1:]
            self._kept = [kept for kept in deepest if kept.delta > delta]
        self._kept.append(_Kept(slot, delta, self._grid(slot, step, delta)))
        self._save()

    def _free_slot(self) -> int:
        """A slot that no state in the XDMF file names; where all are kept the next one."""
        first = self._kept[-1].slot + 1 if self._all and self._kept else 0
        taken = {kept.slot for kept in self._kept}
        for slot in range(first, self._slots):
            if slot not in taken:
                return slot
        raise ValueError(f"all {self._slots} slots of {H5} are taken")

    def close(self) -> None:
        """Let the files go; no state can be added after."""
        with suppress(OSError):
            os.close(self._file)

    def _create(self, points: np.ndarray, cells: np.ndarray) -> list[dict[str, int]]:
        """Make the HDF5 file; returns where each array of each slot begins [bytes]."""
        import h5py

        temporary = self.directory / f".{H5}.new"
        temporary.unlink(missing_ok=True)  # of a run that was killed, or a link to somewhere else
        _refuse_full_disk(temporary, points.nbytes + cells.nbytes + HEADERS * (self._slots + 16))
        with h5py.File(temporary, "w") as file:
            file["mesh/points"] = points.astype("<f8")
            file["mesh/cells"] = cells.astype("<i8")
            offsets = [{name: self._allocate(file, slot, name) for name in ARRAYS} for slot in range(self._slots)]
        os.replace(temporary, self.directory / H5)
        return offsets

    def _find(self, points: np.ndarray, cells: np.ndarray, done: int) -> list[dict[str, int]] | None:
        """Offsets in the files of an earlier run, whose states up to step `done` are taken over; None without them."""
        import h5py

        try:
            grids = GRID.finditer(content(self.directory / XDMF).decode("utf-8"))
            kept = [_Kept(int(found["slot"]), float(found["delta"]), found[0]) for found in grids
                    if int(found["step"]) <= done]  # fmt: skip
            if any(state.slot >= self._slots for state in kept):
                return None
            with h5py.File(self.directory / H5, "r") as file:
                if not (np.array_equal(file["mesh/points"], points) and np.array_equal(file["mesh/cells"], cells)):
                    return None
                states = [file[f"state/{slot}"] for slot in range(self._slots)]
                if any(state[name].shape != self._array_shape(name) for state in states for name in ARRAYS):
                    return None
                offsets = [{name: int(state[name].id.get_offset()) for name in ARRAYS} for state in states]
        except Exception:  # HDF5 has an error for every way of being damaged
            return None
        self._kept = kept
        return offsets

    def _allocate(self, file, slot: int, name: str) -> int:  # type: ignore[no-untyped-def]
        """The offset of an empty, contiguous array whose place in the file is fixed from now on."""
        import h5py

        layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        layout.set_layout(h5py.h5d.CONTIGUOUS)
        layout.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        layout.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        space = h5py.h5s.create_simple(self._array_shape(name))
        group = file.require_group(f"state/{slot}")
        dataset = h5py.h5d.create(group.id, name.encode(), h5py.h5t.IEEE_F64LE, space, dcpl=layout)
        return int(dataset.get_offset())

    def _array_shape(self, name: str) -> tuple[int, ...]:
        center, _, components = ARRAYS[name]
        return (self._counts[center], *components)

    def _grid(self, slot: int, step: int, delta: float) -> str:
        attributes = "".join(
            f'<Attribute Name="{name}" Center="{center}" AttributeType="{kind}">'
            f"{_item(f'state/{slot}/{name}', self._array_shape(name))}</Attribute>\n"
            for name, (center, kind, _) in ARRAYS.items()
        )
        return (
            f'<Grid Name="step {step}" GridType="Uniform">\n<Time Value="{step}"/>\n'
            f'<Information Name="delta" Value="{delta:.17g}"/>\n{self._mesh()}{attributes}</Grid>\n'
        )

    def _mesh(self) -> str:
        cells, corners = self._shape
        return (
            f'<Topology TopologyType="{CELLS[corners]}" NumberOfElements="{cells}">'
            f"{_item('mesh/cells', (cells, corners), 'Int')}</Topology>\n"
            f'<Geometry GeometryType="XYZ">{_item("mesh/points", (self._counts["Node"], 3))}</Geometry>\n'
        )

    def _save(self) -> None:
        text = (
            '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n<Domain>\n'
            '<Grid Name="indent-sim" GridType="Collection" CollectionType="Temporal">\n'
            + "".join(kept.text for kept in self._kept)
            + "</Grid>\n</Domain>\n</Xdmf>\n"
        )
        write_atomically(self.directory / XDMF, text, sync=False)


def in_space(vectors: np.ndarray) -> np.ndarray:
    """(n, 2) vectors of the (x, z) plane as (n, 3); (n, 3) as they are."""
    vectors = np.asarray(vectors, dtype=float)
    if vectors.shape[1] == 3:
        return vectors
    return np.column_stack([vectors[:, 0], np.zeros(len(vectors)), vectors[:, 1]])


def _item(path: str, shape: tuple[int, ...], kind: str = "Float") -> str:
    dimensions = " ".join(str(n) for n in shape)
    form = f'DataType="{kind}" Precision="8" Format="HDF" Dimensions="{dimensions}"'
    return f"<DataItem {form}>{H5}:/{path}</DataItem>"


def _refuse_full_disk(path: Path, size: int) -> None:
    """OSError when `size` bytes do not fit: the HDF5 library itself takes a full disk very badly."""
    try:
        with open(path, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    finally:
        path.unlink(missing_ok=True)


def _fill(descriptor: int, data: bytes, offset: int) -> None:
    """Write all bytes at an offset, however many calls it takes; a full disk raises OSError."""
    view = memoryview(data)
    while view:
        done = os.pwrite(descriptor, view, offset)
        view, offset = view[done:], offset + done
