"""Writer of fields.xdmf, tip.xdmf and fields/ for ParaView, readable after a kill at any time.

fields/ holds the mesh and every kept state in one HDF5 file each. A file is created in memory,
written under a temporary name and renamed, because the HDF5 library does not recover from a full
disk. fields.xdmf refers to a state as soon as the file of the state exists. If all states are kept,
each state is inserted before the closing tags in one write, so that the total number of written
bytes is proportional to the number of states. tip.xdmf describes the tip on a separate mesh: points
at first contact, and displacement, which deforms a soft tip.
"""

from __future__ import annotations

import html
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.results.atomic_files import append_atomically, read_regular_file, write_atomically
from indent_sim.results.field_arrays import (
    ARRAYS,
    FIELDS_MESH_FILE,
    GRID_PATTERN,
    MESH_ARRAYS,
    TIP_ARRAYS,
    XDMF_FILE,
    XDMF_TAIL,
    ArrayLayout,
    ArrayLayouts,
    read_arrays,
    step_file,
    vectors_in_3d,
)
from indent_sim.results.result_files import (
    FIELDS_FOLDER,
    OLD_FIELDS_FILE,
    KeptStates,
    field_files,
)

TIP_XDMF_FILE = "tip.xdmf"


@dataclass(frozen=True)
class _StoredState:
    """State that the files contain: step, depth, time, and the XDMF text of each file."""

    step: int
    delta: float
    time: float
    texts: dict[str, str]


class FieldWriter:
    """Writer of a time series of fields on one mesh, and of the tip above it.

    A state is stored at its time, or at the number of its step if the scene has no times. If two
    states have the same time, the next larger floating-point number is stored for the later state.

    Parameters
    ----------
    directory
        The result folder.
    body
        points (n, 2) or (n, 3) [length], where two columns are (x, z); cells (m, 3) or (m, 4),
        numbers of points; regions (m,); and the tip as a `TipGeometry`.
    keep
        "all" for all states, "last" for the deepest and the last state.
    done
        Number of completed steps of a previous run, whose states are kept (`is_continued`). If
        their files are missing, damaged or of another mesh, or if `done` is None, a new series is
        begun.
    arrays
        The arrays of each state.
    information
        Information that the files contain: units and names of regions.
    """

    def __init__(
        self,
        directory: Path,
        *body: Any,
        keep: KeptStates = "last",
        done: int | None = None,
        arrays: ArrayLayouts = ARRAYS,
        information: Mapping[str, str] | None = None,
    ):
        self.directory = Path(directory)
        self._keep = keep
        self._arrays = arrays
        # The information precedes the collection, because readers count the collection's entries
        # to find the number of states.
        items = (information or {}).items()
        elements = "".join(_information_xml(name, value) for name, value in items)
        head = '<?xml version="1.0"?>\n<Xdmf Version="3.0">\n<Domain>\n'
        collection = '<Grid Name="indent-sim" GridType="Collection" CollectionType="Temporal">\n'
        self._index_head = head + elements + collection
        points, cells, regions, self._tip = body
        self._mesh = {
            "points": vectors_in_3d(points),
            "cells": np.asarray(cells),
            "region": np.asarray(regions),
        }
        self._mesh |= {"tip_points": self._tip.points, "tip_cells": self._tip.cells}
        stored_states = self._find_stored_states(done) if done is not None else None
        self.is_continued = stored_states is not None
        self._stored_states = stored_states or []
        self._last_time = max((state.time for state in self._stored_states), default=-np.inf)
        if not self.is_continued:
            self._fields_folder.mkdir(exist_ok=True)
            kinds = {
                name: "<f8" if values.dtype.kind == "f" else "<i8"
                for name, values in self._mesh.items()
            }
            mesh = {name: values.astype(kinds[name]) for name, values in self._mesh.items()}
            write_atomically(self._fields_folder / FIELDS_MESH_FILE, _hdf5_bytes(mesh), sync=False)
            (self.directory / OLD_FIELDS_FILE).unlink(missing_ok=True)
        self._write_index()

    def write(
        self,
        step: int,
        delta: float,
        fields: Mapping[str, np.ndarray],
        t: float | None = None,
        slide: float = 0.0,
    ) -> None:
        """Add one state.

        Parameters
        ----------
        step
            Number of the row of the state.
        delta
            Indentation depth [length].
        fields
            Values by name; the displacement is (n, 2) or (n, 3). `tip_lift` is the displacement of
            the points of a soft tip towards its holder [length].
        t
            Time of the state; if it is None, the step is used as the time.
        slide
            Horizontal displacement of the tip [length].

        Raises
        ------
        OSError
            The disk is full.
        """
        values = {**fields, "displacement": vectors_in_3d(fields["displacement"])}
        arrays = {
            name: np.reshape(values[name], self._array_shape(name)).astype("<f8")
            for name in self._arrays
        }
        lift = fields.get("tip_lift", 0.0)
        arrays["tip_displacement"] = self._tip.displacement(delta, slide, lift).astype("<f8")
        write_atomically(self._fields_folder / step_file(step), _hdf5_bytes(arrays), sync=False)
        self._last_time = (
            float(step) if t is None else max(t, np.nextafter(self._last_time, np.inf))
        )
        state = self._stored_state(step, delta, self._last_time)
        if self._keep == "all":
            for name, text in state.texts.items():
                append_atomically(
                    self.directory / name, text.encode(), sync=False, tail=XDMF_TAIL.encode()
                )
            return
        deepest = sorted(self._stored_states, key=lambda stored: stored.delta)[-1:]
        self._stored_states = [*(stored for stored in deepest if stored.delta > delta), state]
        self._write_index()

    @property
    def _fields_folder(self) -> Path:
        return self.directory / FIELDS_FOLDER

    def _find_stored_states(self, done: int) -> list[_StoredState] | None:
        """Return the states of a previous run up to step `done`; None if they are unusable."""
        try:
            mesh = read_arrays(self._fields_folder / FIELDS_MESH_FILE)
            if not all(np.array_equal(mesh[name], values) for name, values in self._mesh.items()):
                return None
            grids = GRID_PATTERN.finditer(
                read_regular_file(self.directory / XDMF_FILE).decode("utf-8")
            )
            grid_values = (
                (int(grid["step"]), float(grid["delta"]), float(grid["time"])) for grid in grids
            )
            stored_states = [
                self._stored_state(*state_values)
                for state_values in grid_values
                if state_values[0] <= done
            ]
            # The generator keeps only one file in memory at a time.
            files = (
                read_arrays(self._fields_folder / step_file(state.step)) for state in stored_states
            )
            are_whole = all(
                file[name].shape == self._array_shape(name)
                for file in files
                for name in self._arrays
            )
            return stored_states if are_whole else None
        except Exception:  # h5py raises many types of errors for damaged files.
            return None

    def _array_shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array of a state."""
        center, _, components = self._arrays[name]
        return (len(self._mesh["points" if center == "Node" else "cells"]), *components)

    def _stored_state(self, step: int, delta: float, time: float) -> _StoredState:
        """Return a state with its XDMF texts of body and tip."""
        body = self._grid_xml(step, delta, time, "", self._arrays, MESH_ARRAYS)
        return _StoredState(
            step,
            delta,
            time,
            {
                XDMF_FILE: body,
                TIP_XDMF_FILE: self._grid_xml(step, delta, time, "tip_", TIP_ARRAYS, {}),
            },
        )

    def _grid_xml(
        self,
        step: int,
        delta: float,
        time: float,
        prefix: str,
        arrays: ArrayLayouts,
        mesh_arrays: ArrayLayouts,
    ) -> str:
        """Return the XDMF grid of a state on the mesh of the body, or of the tip ("tip_")."""
        points, cells = (self._mesh[f"{prefix}{name}"] for name in ("points", "cells"))
        counts = {"Node": len(points), "Cell": len(cells)}
        items = [
            _attribute_xml(name, kind, counts, step_file(step), prefix)
            for name, kind in arrays.items()
        ]
        items += [
            _attribute_xml(name, kind, counts, FIELDS_MESH_FILE, "", "Int")
            for name, kind in mesh_arrays.items()
        ]
        corners = cells.shape[1]
        node_count = f' NodesPerElement="{corners}"' if corners == 2 else ""
        head = f'<Grid Name="step {step}" GridType="Uniform">\n<Time Value="{time:.17g}"/>\n'
        head += f'<Information Name="delta" Value="{delta:.17g}"/>\n'
        topology_types = {2: "Polyline", 3: "Triangle", 4: "Tetrahedron"}
        topology = (
            f'<Topology TopologyType="{topology_types[corners]}"{node_count} '
            f'NumberOfElements="{len(cells)}">'
        )
        topology += (
            f"{_data_item_xml(FIELDS_MESH_FILE, f'{prefix}cells', cells.shape, 'Int')}</Topology>\n"
        )
        point_item = _data_item_xml(FIELDS_MESH_FILE, f"{prefix}points", points.shape)
        geometry = f'<Geometry GeometryType="XYZ">{point_item}</Geometry>\n'
        return "".join([head, topology, geometry, *items, "</Grid>\n"])

    def _write_index(self) -> None:
        """Write the XDMF files of the kept states, and then delete the files of other states."""
        for name in (XDMF_FILE, TIP_XDMF_FILE):
            text = (
                self._index_head
                + "".join(state.texts[name] for state in self._stored_states)
                + XDMF_TAIL
            )
            write_atomically(self.directory / name, text, sync=False)
        needed_files = {FIELDS_MESH_FILE, *(step_file(state.step) for state in self._stored_states)}
        for path in field_files(self._fields_folder):
            if path.name not in needed_files:
                path.unlink()


def _information_xml(name: str, value: str) -> str:
    """Return an XDMF element with a name and a value."""
    return f"<Information Name={_quote_attribute(name)} Value={_quote_attribute(value)}/>\n"


def _quote_attribute(text: str) -> str:
    """Quote a value of an XML attribute; xml.sax would import modules for internet access."""
    # XML readers turn unescaped line ends and tabs of an attribute into blanks.
    blank_escapes = str.maketrans({"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})
    return f'"{html.escape(text).translate(blank_escapes)}"'


def _attribute_xml(
    name: str,
    kind: ArrayLayout,
    counts: Mapping[str, int],
    file: str,
    prefix: str,
    number: str = "Float",
) -> str:
    """Return the XDMF element of an array, whose name in its HDF5 file has a prefix."""
    center, rank, components = kind
    head = f'<Attribute Name="{name}" Center="{center}" AttributeType="{rank}">'
    item = _data_item_xml(file, prefix + name, (counts[center], *components), number)
    return f"{head}{item}</Attribute>\n"


def _data_item_xml(file: str, path: str, shape: tuple[int, ...], kind: str = "Float") -> str:
    """Return the XDMF element that refers to the data of an array in an HDF5 file."""
    dimensions = " ".join(str(n) for n in shape)
    form = f'DataType="{kind}" Precision="8" Format="HDF" Dimensions="{dimensions}"'
    return f"<DataItem {form}>{FIELDS_FOLDER}/{file}:/{path}</DataItem>"


def _hdf5_bytes(arrays: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of an HDF5 file with these arrays."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return buffer.getvalue()
