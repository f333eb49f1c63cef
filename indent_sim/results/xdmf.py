"""fields.xdmf and fields/ for ParaView, readable after a kill at any moment.

fields/ holds the mesh and every kept state in an HDF5 file each, made in memory and written aside
and renamed: the HDF5 library itself takes a full disk very badly. fields.xdmf names a state once
its file is there. Where all states are kept each is added to it in one write before the tags that
close it, so that the bytes written grow with their number. tip.xdmf is the same for the rigid tip,
a mesh of its own: its points at first touch, and how far it has come down.
"""

from __future__ import annotations

import html
import io
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import (
    FIELDS_FOLDER,
    Keep,
    append_whole,
    content,
    field_files,
    write_atomically,
)

TOPOLOGY_TYPES = {2: "Polyline", 3: "Triangle", 4: "Tetrahedron"}
Kind = tuple[
    str, str, tuple[int, ...]
]  # where the values of an array are, what each is, and its shape
Kinds = dict[str, Kind]
OF_TIP: Kinds = {"displacement": ("Node", "Vector", (3,))}
ARRAYS = OF_TIP | {"pressure": ("Node", "Scalar", ()), "stress": ("Cell", "Tensor", (9,))}
ARRAYS |= {"von_mises": ("Cell", "Scalar", ()), "principal_stresses": ("Cell", "Vector", (3,))}
ARRAYS |= dict.fromkeys(("J", "energy_density"), ("Cell", "Scalar", ()))
# Where the tip drags on the surface; where there is fluid in the pores; of gels
MORE_ARRAYS: Kinds = dict.fromkeys(("shear", "pore_pressure"), ("Node", "Scalar", ()))
MORE_ARRAYS |= dict.fromkeys(("fluid_content", "swelling"), ("Cell", "Scalar", ()))
MORE_ARRAYS |= {
    "nodal_stress": ("Node", "Tensor", (9,)),
    "nodal_von_mises": ("Node", "Scalar", ()),
}  # on request
LASTING_ARRAYS: Kinds = {"region": ("Cell", "Scalar", ())}  # beside the mesh
XDMF = "fields.xdmf"
TIP = "tip.xdmf"
MESH = "mesh.h5"
OLD = "fields.h5"
GRID = re.compile(
    r'<Grid Name="step (?P<step>\d{1,9})".*?<Time Value="(?P<time>[^"]*)".*?'
    r'Name="delta" Value="(?P<delta>[^"]*)".*?</Grid>\n',
    re.DOTALL,
)
XDMF_HEAD = '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n<Domain>\n'
COLLECTION = '<Grid Name="indent-sim" GridType="Collection" CollectionType="Temporal">\n'
BLANKS = str.maketrans(
    {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)  # which an attribute would not keep
TAIL = "</Grid>\n</Domain>\n</Xdmf>\n"


@dataclass(frozen=True)
class _Kept:
    """A state in the files: its step, depth, and XDMF of body and tip."""

    step: int
    delta: float
    time: float
    texts: dict[str, str]


class FieldWriter:
    """A growing time series of the fields of `ARRAYS` on one mesh, and of the tip above it.

    body: points (n, 2) or (n, 3) [length], two columns being (x, z), cells (m, 3) or (m, 4) of
    their numbers, regions (m,), and the tip. All states are kept, or the deepest and the last. The
    time of a state is its own where time passes, a last digit later where two have one, its depth
    where depths only grow, else its step. With `done` the states of the first so many steps that
    are there stay (`continued`), unless the files are missing, damaged or of another mesh: then
    they begin anew. arrays: what each state has; told: what the files say of all of them, units and
    regions.
    """

    def __init__(
        self,
        directory: Path,
        *body: Any,
        keep: Keep = "last",
        done: int | None = None,
        arrays: Kinds = ARRAYS,
        told: Mapping[str, str] | None = None,
    ):
        self.directory = Path(directory)
        self._keep = keep
        self._arrays = arrays
        # beside the collection: whoever counts what is in it counts its states
        information = "".join(_information(name, value) for name, value in (told or {}).items())
        self._head = XDMF_HEAD + information + COLLECTION
        points, cells, regions, self._tip = body
        self._mesh = {
            "points": in_space(points),
            "cells": np.asarray(cells),
            "region": np.asarray(regions),
        }
        self._mesh |= {"tip_points": self._tip.points, "tip_cells": self._tip.cells}
        found = self._found(done) if done is not None else None
        self.continued = found is not None
        self._kept = found or []
        self._time = max((state.time for state in self._kept), default=-np.inf)  # of the last state
        if not self.continued:
            self._fields.mkdir(exist_ok=True)
            kinds = {
                name: "<f8" if values.dtype.kind == "f" else "<i8"
                for name, values in self._mesh.items()
            }
            mesh = {name: values.astype(kinds[name]) for name, values in self._mesh.items()}
            write_atomically(self._fields / MESH, _hdf5(mesh), sync=False)
            (self.directory / OLD).unlink(missing_ok=True)
        self._save()

    def write(
        self, step: int, delta: float, fields: Mapping[str, np.ndarray], t: float | None = None
    ) -> None:
        """Add one state: its fields by name, displacement (n, 2 or 3), and its time. OSError on a
        full disk.
        """
        values = {**fields, "displacement": in_space(fields["displacement"])}
        arrays = {
            name: np.reshape(values[name], self._shape(name)).astype("<f8") for name in self._arrays
        }
        arrays["tip_displacement"] = self._tip.at(delta).astype("<f8")
        write_atomically(self._fields / _file(step), _hdf5(arrays), sync=False)
        self._time = float(step) if t is None else max(t, np.nextafter(self._time, np.inf))
        state = self._state(step, delta, self._time)
        if self._keep == "all":
            for name, text in state.texts.items():
                append_whole(self.directory / name, text.encode(), sync=False, tail=TAIL.encode())
            return
        deepest = sorted(self._kept, key=lambda kept: kept.delta)[-1:]
        self._kept = [*(kept for kept in deepest if kept.delta > delta), state]
        self._save()

    @property
    def _fields(self) -> Path:
        return self.directory / FIELDS_FOLDER

    def _found(self, done: int) -> list[_Kept] | None:
        """The states up to step `done` in the files of an earlier run; None where they are of no
        use.
        """
        try:
            mesh = _arrays(self._fields / MESH)
            if not all(np.array_equal(mesh[name], values) for name, values in self._mesh.items()):
                return None
            grids = GRID.finditer(content(self.directory / XDMF).decode("utf-8"))
            said = (
                (int(grid["step"]), float(grid["delta"]), float(grid["time"])) for grid in grids
            )
            kept = [self._state(*one) for one in said if one[0] <= done]
            files = (
                _arrays(self._fields / _file(state.step)) for state in kept
            )  # one in memory at a time
            are_whole = all(
                file[name].shape == self._shape(name) for file in files for name in self._arrays
            )
            return kept if are_whole else None
        except Exception:  # HDF5 has an error for every way of being damaged
            return None

    def _shape(self, name: str) -> tuple[int, ...]:
        center, _, components = self._arrays[name]
        return (len(self._mesh["points" if center == "Node" else "cells"]), *components)

    def _state(self, step: int, delta: float, time: float) -> _Kept:
        body = self._grid(step, delta, time, "", self._arrays, LASTING_ARRAYS)
        return _Kept(
            step, delta, time, {XDMF: body, TIP: self._grid(step, delta, time, "tip_", OF_TIP, {})}
        )

    def _grid(
        self, step: int, delta: float, time: float, prefix: str, arrays: Kinds, lasting: Kinds
    ) -> str:
        """A state of the mesh whose arrays begin with a prefix."""
        points, cells = (self._mesh[f"{prefix}{name}"] for name in ("points", "cells"))
        counts = {"Node": len(points), "Cell": len(cells)}
        items = [
            _attribute(name, kind, counts, _file(step), prefix) for name, kind in arrays.items()
        ]
        items += [_attribute(name, kind, counts, MESH, "", "Int") for name, kind in lasting.items()]
        corners = cells.shape[1]
        many = f' NodesPerElement="{corners}"' if corners == 2 else ""
        head = f'<Grid Name="step {step}" GridType="Uniform">\n<Time Value="{time:.17g}"/>\n'
        head += f'<Information Name="delta" Value="{delta:.17g}"/>\n'
        topology = (
            f'<Topology TopologyType="{TOPOLOGY_TYPES[corners]}"{many} '
            f'NumberOfElements="{len(cells)}">'
        )
        topology += f"{_item(MESH, f'{prefix}cells', cells.shape, 'Int')}</Topology>\n"
        geometry = (
            "<Geometry "
            f'GeometryType="XYZ">{_item(MESH, f"{prefix}points", points.shape)}</Geometry>\n'
        )
        return "".join([head, topology, geometry, *items, "</Grid>\n"])

    def _save(self) -> None:
        """Name the states that are kept, and no others; then theirs may go."""
        for name in (XDMF, TIP):
            text = self._head + "".join(state.texts[name] for state in self._kept) + TAIL
            write_atomically(self.directory / name, text, sync=False)
        named = {MESH, *(_file(state.step) for state in self._kept)}
        for path in field_files(self._fields):
            if path.name not in named:
                path.unlink()


def lost_fields(folder: Path) -> list[str]:
    """The files of fields that a finished run left in its folder and that are missing or damaged
    now, by name.
    """
    text = _index(folder)
    steps = _named_steps(text)
    if not (steps and text.endswith(TAIL)):
        return [XDMF]
    wanted = {MESH: {"points", "cells"}} | {_file(step): set(ARRAYS) for step in steps}
    fields = folder / FIELDS_FOLDER
    return [
        f"{FIELDS_FOLDER}/{name}"
        for name, arrays in wanted.items()
        if not arrays <= _names(fields / name)
    ]


def kept_steps(folder: Path, rows: Collection[float]) -> list[int]:
    """The steps whose fields are in a result folder, of those that have rows: fields are written
    before their row.
    """
    return [step for step in _named_steps(_index(folder)) if step in rows]


def _index(folder: Path) -> str:
    """The text of fields.xdmf; "" where it cannot be read."""
    with suppress(OSError, ValueError):
        return content(folder / XDMF).decode("utf-8")
    return ""


def _named_steps(index: str) -> list[int]:
    return [int(grid["step"]) for grid in GRID.finditer(index)]


def read_fields(folder: Path, step: int) -> dict[str, np.ndarray]:
    """The mesh (points (n, 3) [length], cells, region) and the fields of a kept step; UsageError
    when damaged.
    """
    try:
        found = _arrays(folder / FIELDS_FOLDER / MESH) | _arrays(
            folder / FIELDS_FOLDER / _file(step)
        )
        counts = {"Node": len(found["points"]), "Cell": len(found["cells"])}
        some = {name: kind for name, kind in MORE_ARRAYS.items() if name in found}
        kinds = ARRAYS | LASTING_ARRAYS | some
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


def _information(name: str, value: str) -> str:
    return f"<Information Name={_quoted(name)} Value={_quoted(value)}/>\n"


def _quoted(text: str) -> str:
    """A value of an attribute. xml.sax would do, but loads what fetches pages from the internet."""
    return f'"{html.escape(text).translate(BLANKS)}"'


def _file(step: int) -> str:
    return f"step-{step}.h5"


def _attribute(
    name: str, kind: Kind, counts: Mapping[str, int], file: str, prefix: str, number: str = "Float"
) -> str:
    """An array of a file, in which its name has a prefix, as the values of a grid."""
    center, rank, components = kind
    head = f'<Attribute Name="{name}" Center="{center}" AttributeType="{rank}">'
    return (
        f"{head}{_item(file, prefix + name, (counts[center], *components), number)}</Attribute>\n"
    )


def _item(file: str, path: str, shape: tuple[int, ...], kind: str = "Float") -> str:
    dimensions = " ".join(str(n) for n in shape)
    form = f'DataType="{kind}" Precision="8" Format="HDF" Dimensions="{dimensions}"'
    return f"<DataItem {form}>{FIELDS_FOLDER}/{file}:/{path}</DataItem>"


def _hdf5(arrays: dict[str, np.ndarray]) -> bytes:
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return image.getvalue()


def _names(path: Path) -> set[str]:
    """The names of what an HDF5 file holds, none when it is damaged."""
    with suppress(Exception):  # HDF5 has an error for every way of being damaged
        return set(_arrays(path))
    return set()


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """What an HDF5 file holds; any exception when it is damaged."""
    import h5py

    with h5py.File(io.BytesIO(content(path)), "r") as file:
        return {name: values[()] for name, values in file.items()}
