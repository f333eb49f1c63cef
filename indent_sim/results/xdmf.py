"""fields.xdmf and fields/ for ParaView, readable after a kill at any moment.

fields/ holds the mesh and every kept state in an HDF5 file each, made in memory and written aside and renamed: the HDF5
library itself takes a full disk very badly. fields.xdmf names a state once its file is there. Where all states are kept
each is added to it in one write before the tags that close it, so that the bytes written grow with their number.
tip.xdmf is the same for the rigid tip, a mesh of its own: its points at first touch, and how far it has come down.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import FIELDS, append_whole, content, field_files, write_atomically
from indent_sim.results.outline import Outline

CELLS = {2: "Polyline", 3: "Triangle", 4: "Tetrahedron"}
Kinds = dict[str, tuple[str, str, tuple[int, ...]]]  # where the values of an array are, what each is, and its shape
ARRAYS: Kinds = {
    "displacement": ("Node", "Vector", (3,)),
    "pressure": ("Node", "Scalar", ()),
    "stress": ("Cell", "Tensor", (9,)),
    "von_mises": ("Cell", "Scalar", ()),
    "principal_stresses": ("Cell", "Vector", (3,)),
    "J": ("Cell", "Scalar", ()),
    "energy_density": ("Cell", "Scalar", ()),
}
OF_FRICTION: Kinds = {"shear": ("Node", "Scalar", ())}  # where the tip drags on the surface
LASTING: Kinds = {"region": ("Cell", "Scalar", ())}  # beside the mesh
OF_TIP: Kinds = {"displacement": ("Node", "Vector", (3,))}
XDMF, TIP, MESH, OLD = "fields.xdmf", "tip.xdmf", "mesh.h5", "fields.h5"
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
    """A state in the files: its step, depth, and XDMF of body and tip."""

    step: int
    delta: float
    texts: dict[str, str]


class FieldWriter:
    """A growing time series of the fields of `ARRAYS` on one mesh, and of the tip above it.

    points (n, 2) or (n, 3) [length], two columns being (x, z); cells (m, 3) or (m, 4) vertex numbers; regions (m,). All
    states are kept, or the deepest and the last. The time of a state is its step: depths may go back.
    With `done` the states of the first so many steps that are there stay (`continued`), unless the files are
    missing, damaged or of another mesh: then they begin anew. With friction there is the shear of the contact surface.
    """

    def __init__(self, directory: Path, points: np.ndarray, cells: np.ndarray, regions: np.ndarray, tip: Outline, *,
                 keep_all: bool = False, done: int | None = None, friction: bool = False):  # fmt: skip
        self.directory = Path(directory)
        self._all = keep_all
        self._arrays = ARRAYS | (OF_FRICTION if friction else {})
        self._mesh = {"points": in_space(points), "cells": np.asarray(cells), "region": np.asarray(regions),
                      "tip_points": tip.points, "tip_cells": tip.cells}  # fmt: skip
        self._tip = tip
        found = self._found(done) if done is not None else None
        self.continued = found is not None
        self._kept = found or []
        if not self.continued:
            self._begin()
        self._save()

    def write(self, step: int, delta: float, fields: Mapping[str, np.ndarray]) -> None:
        """Add one state: its fields by name, displacement (n, 2 or 3). OSError on a full disk."""
        values = {**fields, "displacement": in_space(fields["displacement"])}
        arrays = {name: np.reshape(values[name], self._shape(name)).astype("<f8") for name in self._arrays}
        arrays["tip_displacement"] = self._tip.at(delta).astype("<f8")
        write_atomically(self._fields / _file(step), _hdf5(arrays), sync=False)
        state = self._state(step, delta)
        if self._all:
            for name, text in state.texts.items():
                append_whole(self.directory / name, text.encode(), sync=False, tail=TAIL.encode())
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
        kinds = {"f": "<f8"}
        mesh = {name: values.astype(kinds.get(values.dtype.kind, "<i8")) for name, values in self._mesh.items()}
        write_atomically(self._fields / MESH, _hdf5(mesh), sync=False)
        (self.directory / OLD).unlink(missing_ok=True)

    def _found(self, done: int) -> list[_Kept] | None:
        """The states up to step `done` in the files of an earlier run; None where they are of no use."""
        try:
            mesh = _arrays(self._fields / MESH)
            if not all(np.array_equal(mesh[name], values) for name, values in self._mesh.items()):
                return None
            grids = GRID.finditer(content(self.directory / XDMF).decode("utf-8"))
            kept = [self._state(int(grid["step"]), float(grid["delta"])) for grid in grids if int(grid["step"]) <= done]
            return kept if all(self._is_whole(state.step) for state in kept) else None
        except Exception:  # HDF5 has an error for every way of being damaged
            return None

    def _is_whole(self, step: int) -> bool:
        arrays = _arrays(self._fields / _file(step))
        return all(arrays[name].shape == self._shape(name) for name in self._arrays)

    def _shape(self, name: str) -> tuple[int, ...]:
        center, _, components = self._arrays[name]
        return (len(self._mesh["points" if center == "Node" else "cells"]), *components)

    def _state(self, step: int, delta: float) -> _Kept:
        body, tip = self._grid(step, delta, "", self._arrays, LASTING), self._grid(step, delta, "tip_", OF_TIP, {})
        return _Kept(step, delta, {XDMF: body, TIP: tip})

    def _grid(self, step: int, delta: float, prefix: str, arrays: Kinds, lasting: Kinds) -> str:
        """A state of the mesh whose arrays begin with a prefix."""
        points, cells = (self._mesh[f"{prefix}{name}"] for name in ("points", "cells"))
        counts = {"Node": len(points), "Cell": len(cells)}
        items = [_attribute(_file(step), f"{prefix}{name}", name, kind, counts) for name, kind in arrays.items()]
        items += [_attribute(MESH, name, name, kind, counts, "Int") for name, kind in lasting.items()]
        corners = cells.shape[1]
        many = f' NodesPerElement="{corners}"' if corners == 2 else ""
        return (
            f'<Grid Name="step {step}" GridType="Uniform">\n<Time Value="{step}"/>\n'
            f'<Information Name="delta" Value="{delta:.17g}"/>\n'
            f'<Topology TopologyType="{CELLS[corners]}"{many} NumberOfElements="{len(cells)}">'
            f"{_item(MESH, f'{prefix}cells', cells.shape, 'Int')}</Topology>\n"
            f'<Geometry GeometryType="XYZ">{_item(MESH, f"{prefix}points", points.shape)}</Geometry>\n'
            f"{''.join(items)}</Grid>\n"
        )

    def _save(self) -> None:
        """Name the states that are kept, and no others; then theirs may go."""
        for name in (XDMF, TIP):
            text = HEAD + "".join(state.texts[name] for state in self._kept) + TAIL
            write_atomically(self.directory / name, text, sync=False)
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


def kept_steps(folder: Path) -> dict[int, float]:
    """The steps whose fields are in a result folder, with their depths [length]; none without fields."""
    try:
        text = content(folder / XDMF).decode("utf-8")
        return {int(grid["step"]): float(grid["delta"]) for grid in GRID.finditer(text)}
    except (OSError, ValueError):
        return {}


def read_fields(folder: Path, step: int) -> dict[str, np.ndarray]:
    """The mesh (points (n, 3) [length], cells, region) and the fields of a kept step; UsageError when damaged."""
    try:
        found = _arrays(folder / FIELDS / MESH) | _arrays(folder / FIELDS / _file(step))
        counts = {"Node": len(found["points"]), "Cell": len(found["cells"])}
        kinds = ARRAYS | LASTING | {name: kind for name, kind in OF_FRICTION.items() if name in found}
        if all(found[name].shape == (counts[kinds[name][0]], *kinds[name][2]) for name in kinds):
            return found
        raise ValueError("its arrays do not belong together")
    except Exception as error:  # HDF5 has an error for every way of being damaged
        raise UsageError(f"the fields of step {step} in {folder} cannot be read: {error}") from None


def in_space(vectors: np.ndarray) -> np.ndarray:
    """(n, 2) vectors of the (x, z) plane as (n, 3); (n, 3) as they are."""
    vectors = np.asarray(vectors, dtype=float)
    if vectors.shape[1] == 3:
        return vectors
    return np.column_stack([vectors[:, 0], np.zeros(len(vectors)), vectors[:, 1]])


def _file(step: int) -> str:
    return f"step-{step}.h5"


def _attribute(file: str, array: str, name: str, kind: tuple[str, str, tuple[int, ...]], counts: Mapping[str, int],
               number: str = "Float") -> str:  # fmt: skip
    """An array of a file as the values of a grid."""
    center, rank, components = kind
    head = f'<Attribute Name="{name}" Center="{center}" AttributeType="{rank}">'
    return f"{head}{_item(file, array, (counts[center], *components), number)}</Attribute>\n"


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
