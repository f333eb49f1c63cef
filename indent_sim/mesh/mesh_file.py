"""A mesh file -> points, cells and their names; read by meshio, which is loaded where a scene has
such a body alone.

A file comes from a stranger: it is opened for reading only, nothing that it refers to is followed
out of its folder, and it is read in a forked process whose time and memory follow from its length.
What that stumbles over is its error.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from io import StringIO
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, MeshFileError
from indent_sim.process.limits import limit_resources
from indent_sim.process.ranks import is_parallel

T = TypeVar("T")
Meshio = Any  # a mesh of meshio, which is loaded where a file is read alone
Reader = Callable[[Path], Meshio]
READERS = {
    ".msh": "gmsh",
    ".xdmf": "xdmf",
    ".vtu": "vtu",
    ".inp": "abaqus",
}  # ending -> module of meshio
MAX_MESH_BYTES = (
    2 * 10**9
)  # of a file whose arrays are read as they are, HDF5 and gmsh's: some ten millions of cells
MAX_TEXT_BYTES = (
    2 * 10**8
)  # of one that is taken apart, in some times as much memory: some millions
# CPU time and bytes that reading may take, and more for each byte read
READING_SECONDS = (10.0, 3e-6)
READING_MEMORY = (500e6, 100.0)
CELL_VERTICES = {"line": 2, "triangle": 3, "tetra": 4, "line3": 2, "triangle6": 3, "tetra10": 4}
VTK_EDGES = {
    2: [(0, 1)],
    3: [(0, 1), (1, 2), (2, 0)],
    4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}  # as in VTK
ELSET = re.compile(r",\s*elset\s*=\s*([^,]*)", re.IGNORECASE)
MAX_LABELS = 1000  # of numbers at cells: more are a count of the cells, not names
# that a message lists, and of what it cites
MAX_LISTED_NAMES = 12
MAX_QUOTED_LETTERS = 200
LARGEST_COORDINATE = 1e30  # length of the file; its cube and that of its inverse are numbers too


@dataclass(frozen=True)
class MeshFile:
    """What a file holds: points (n, 3) [length], simplices (m, dim + 1) by their dimension, and who
    has which name.

    groups: name -> dimension -> indices of simplices. corners: name -> indices of points. middles:
    the midside nodes of a quadratic mesh, edges (k, 2) by their points and the place (k,) of the
    node on each.
    """

    points: np.ndarray
    cells: Mapping[int, np.ndarray]
    groups: Mapping[str, Mapping[int, np.ndarray]]
    point_sets: Mapping[str, np.ndarray]
    midside_nodes: tuple[np.ndarray, np.ndarray]

    @property
    def names_text(self) -> str:
        """The names in it, in words."""
        names = sorted({*self.groups, *self.point_sets})
        listed_names = _quote(", ".join(names[:MAX_LISTED_NAMES])) + (
            " and more" if len(names) > MAX_LISTED_NAMES else ""
        )
        return f"the file has {listed_names}" if names else "the file has no names"


@dataclass(frozen=True)
class MeshFileVersion:
    """A version of a mesh file."""

    path: Path
    name: str
    size: int  # [bytes]
    modification: tuple[int, int]


def find_mesh_file(folder: str, file: str) -> MeshFileVersion:
    """A mesh file below a folder, that of the scene; ConfigError for what is none."""
    path = Path(folder or ".") / file
    base_folder = os.path.realpath(folder or ".")
    if os.path.commonpath([base_folder, os.path.realpath(path)]) != base_folder:
        problem = f"'{file}' leads out of the scene's folder through a link"
        raise ConfigError("body.file", problem, "copy the file beside the scene")
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "not a regular file")
        with open(path, "rb"):
            pass
    except (OSError, ValueError) as error:
        problem = f"cannot read the mesh '{file}': {getattr(error, 'strerror', None) or error}"
        raise ConfigError("body.file", problem, "it is looked for beside the scene file") from None
    max_bytes = MAX_MESH_BYTES if path.suffix.lower() == ".msh" else MAX_TEXT_BYTES
    if status.st_size > max_bytes:
        advice = (
            ""
            if max_bytes == MAX_MESH_BYTES
            else ", or write it as .msh, or as .xdmf with HDF5 beside it"
        )
        raise mesh_file_error(
            f"'{file}' is longer than {max_bytes} bytes", f"coarsen the mesh{advice}"
        )
    if path.suffix.lower() not in READERS:
        raise ConfigError(
            "body.file",
            f"'{file}' is of no known kind",
            f"it must end in one of {', '.join(READERS)}",
        )
    return MeshFileVersion(path, file, status.st_size, (status.st_ino, status.st_mtime_ns))


def read_mesh_file(version: MeshFileVersion, convert: Callable[[MeshFile], T]) -> T:
    """What a function makes of the mesh in a file, all of it in a process of its own; MeshFileError
    for what is no mesh or needs more time or memory than its length allows.
    """
    from indent_sim.process.forked_process import (
        ProcessCrash,
        call_in_fork,
    )  # with processes, which no other body needs

    try:
        reader = import_module(f"meshio.{READERS[version.path.suffix.lower()]}").read
    except ImportError as import_error:
        raise BackendError(
            f"a body from a file needs meshio ({import_error}); run scripts/setup"
        ) from import_error
    try:
        return call_in_fork(
            partial(_read_and_convert, reader, version, convert),
            partial(_limit_reader, version.size),
            is_parallel(),
        )
    except (ProcessCrash, MemoryError) as failure:
        cause = (
            f"its reader {failure}" if isinstance(failure, ProcessCrash) else "it needs more memory"
        )
        (seconds, seconds_per_byte) = READING_SECONDS
        (memory, memory_per_byte) = READING_MEMORY
        limits = (
            f"it may take {seconds:g} s and {memory / 1e6:g} MB, and {seconds_per_byte * 1e6:g} s and {memory_per_byte:g} "
            "MB more for each MB"
        )
        raise mesh_file_error(
            f"'{version.name}' is not a mesh that can be read: {cause}", limits
        ) from None
    except OSError as error:
        raise BackendError(
            f"no process to read '{version.name}' in: {error.strerror or error}"
        ) from error


def _limit_reader(size: int) -> None:
    limit_resources(
        *(base + per_byte * size for base, per_byte in (READING_SECONDS, READING_MEMORY))
    )


def mesh_file_error(problem: str, remedy: str = "", key: str = "body.file") -> ConfigError:
    """The error of a mesh file that is no body, or that is not what another key says of it."""
    return (MeshFileError if key == "body.file" else ConfigError)(key, problem, remedy)


def _quote(text: str) -> str:
    """What a file says, at most some letters of it."""
    return text if len(text) <= MAX_QUOTED_LETTERS else f"{text[:MAX_QUOTED_LETTERS]}..."


def format_midpoint(corners: np.ndarray) -> str:
    """The middle of a simplex (n, dim), for a message."""
    return f"({', '.join(f'{x:.4g}' for x in corners.mean(axis=0))})"


def _read_and_convert(
    reader: Reader, version: MeshFileVersion, convert: Callable[[MeshFile], T]
) -> T:
    """What `read` gives, in the forked process."""
    check = {
        ".xdmf": _refuse_foreign_references,
        ".inp": _refuse_ambiguous_abaqus,
        ".vtu": _refuse_several_vtu_pieces,
    }.get(version.path.suffix.lower())
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), np.errstate(all="ignore"):
            if check:
                check(version)
            mesh = _mesh_file_of(reader(version.path), version.name)
    except (IndentSimError, MemoryError):
        raise
    except Exception as failure:  # readers raise whatever they stumble over
        is_unknown_key = isinstance(failure, KeyError)  # the number of a kind of cell, say
        message = (
            f"its reader does not know {failure}"
            if is_unknown_key
            else str(failure) or "it is empty or cut short"
        )
        problem = f"'{version.name}' is not a mesh that can be read: {_quote(message)}"
        raise mesh_file_error(problem, "write it anew, as gmsh 4.1, say") from None
    return convert(mesh)


def _refuse_foreign_references(version: MeshFileVersion) -> None:
    """An XDMF file may name others for its numbers: plain names beside it, and real files, alone,
    which count too.
    """
    from xml.etree import ElementTree  # of no use to other files

    sizes = {"": version.size}
    file = version.name
    for item in ElementTree.parse(
        version.path
    ).iter():  # its reader takes any element for a DataItem
        if item.get("Format", "XML") == "XML":
            continue
        name, _, dataset_path = (item.text or "").strip().partition(":")
        data_file = version.path.parent / name
        if item.get("Format") != "HDF" or "/" in name or "\\" in name or data_file.is_symlink():
            raise mesh_file_error(
                f"'{file}' takes its numbers from '{_quote(name)}'",
                "HDF5 beside it alone is followed",
            )
        if not data_file.is_file() or data_file.stat().st_size > MAX_MESH_BYTES:
            raise mesh_file_error(
                f"'{file}' takes its numbers from '{_quote(name)}', which is missing or too long"
            )
        _refuse_external_data(data_file, dataset_path, file)
        sizes[name] = data_file.stat().st_size
    _limit_reader(sum(sizes.values()))


def _refuse_external_data(path: Path, dataset_path: str, file: str) -> None:
    """HDF5 may keep numbers in any file at all: no link but hard ones on the way, no other storage,
    only numbers.
    """
    import h5py

    with h5py.File(path) as store:
        links = accumulate(dataset_path.strip("/").split("/"), "{}/{}".format)
        is_internal = all(
            isinstance(store.get(link, getlink=True), h5py.HardLink) for link in links
        )
        dataset = store[dataset_path] if is_internal else None
        if not isinstance(dataset, h5py.Dataset) or dataset.external or dataset.is_virtual:
            raise mesh_file_error(
                f"'{file}' takes its numbers from '{_quote(dataset_path)}', which are not in "
                f"'{path.name}' itself"
            )
        if dataset.dtype.kind not in "fiu":
            raise mesh_file_error(
                f"'{file}' takes its numbers from '{_quote(dataset_path)}' of '{path.name}', which are "
                "not real"
            )


def _refuse_ambiguous_abaqus(version: MeshFileVersion) -> None:
    """Its reader follows INCLUDE, keeps the last of several lists of nodes, and mistakes whose
    cells an ELSET names.
    """
    with open(version.path, encoding="utf-8") as file:
        lines = [line for line in file if not line[:1].isdigit() and not line.startswith("**")]
    keywords = [
        line.partition(",")[0].strip().replace("*", "").upper() for line in lines
    ]  # as it takes them
    element_sets = [
        ELSET.findall(line.strip())
        for line, keyword in zip(lines, keywords, strict=True)
        if keyword == "ELEMENT"
    ]
    if "INCLUDE" in keywords:
        raise mesh_file_error(
            f"'{version.name}' includes another file", "put all of the mesh into one"
        )
    if keywords.count("NODE") > 1 or (
        any(element_sets) and len({*map(str, element_sets)} - {"[]"}) < len(element_sets)
    ):
        problem = (
            f"'{version.name}' has several lists of nodes, or *ELEMENT with and without an "
            "ELSET of their own"
        )
        raise mesh_file_error(problem, "write it as one part, and name cells by *ELSET")


def _refuse_several_vtu_pieces(version: MeshFileVersion) -> None:
    if (
        version.path.read_bytes().count(b"<Piece") > 1
    ):  # its reader takes the cells of the last one alone
        raise mesh_file_error(f"'{version.name}' has several pieces", "write the mesh as one")


def _mesh_file_of(mesh: Meshio, file: str) -> MeshFile:
    """What meshio has read, by the dimension of the simplices."""
    points = np.asarray(mesh.points)
    if (
        points.ndim != 2
        or len(points) == 0
        or points.shape[1] not in (2, 3)
        or points.dtype.kind not in "fiu"
    ):
        raise mesh_file_error(
            f"'{file}' has no points, or some without two or three real coordinates"
        )
    if not (np.abs(points := points.astype(float)) < LARGEST_COORDINATE).all():
        raise mesh_file_error(
            f"'{file}' has coordinates that are no numbers, or beyond {LARGEST_COORDINATE:g}"
        )
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    cells: dict[int, list[np.ndarray]] = {}
    edges: list[np.ndarray] = [np.empty((0, 2), dtype=np.int64)]
    midside_nodes: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    block_offsets = []
    for block in mesh.cells:
        if block.type == "vertex" or len(block.data) == 0:
            block_offsets.append((0, 0))
            continue
        if block.type not in CELL_VERTICES:
            problem = f"'{file}' has cells of the kind {block.type}"
            raise mesh_file_error(problem, "mesh it with triangles or tetrahedra, of order 1 or 2")
        n = CELL_VERTICES[block.type]
        data = np.asarray(block.data)
        if (
            data.dtype.kind not in "iu"
            or data.ndim != 2
            or data.shape[1] not in (n, n + len(VTK_EDGES[n]))
        ):
            raise mesh_file_error(f"'{file}' has cells whose corners are no numbers of points")
        if (data := data.astype(np.int64)).min() < 0 or data.max() >= len(points):
            raise mesh_file_error(f"'{file}' has cells with corners that are no points of it")
        dim_blocks = cells.setdefault(n - 1, [])
        block_offsets.append((n - 1, sum(map(len, dim_blocks))))
        dim_blocks.append(data[:, :n])
        if data.shape[1] > n:
            edges += [data[:, list(pair)] for pair in VTK_EDGES[n]]
            midside_nodes += [data[:, n + k] for k in range(len(VTK_EDGES[n]))]
    groups: dict[str, dict[int, np.ndarray]] = {}
    for name, block, indices in _named_groups(mesh):
        dim, offset = block_offsets[block]
        if dim and len(indices):
            group = groups.setdefault(name, {})
            group[dim] = np.union1d(group.get(dim, indices[:0]), offset + indices)
    simplices = {dim: np.concatenate(dim_parts) for dim, dim_parts in cells.items()}
    corners = {name: np.asarray(point_indices) for name, point_indices in mesh.point_sets.items()}
    return MeshFile(
        points, simplices, groups, corners, (np.concatenate(edges), np.concatenate(midside_nodes))
    )


def _named_groups(mesh: Meshio) -> Iterator[tuple[str, int, np.ndarray]]:
    """(name, block, indices in it) of groups, cell sets, numbers at cells: `array=3` where 3,
    `array` where not 0.
    """
    for name, sets in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            block_indices = (
                (block, indices) for block, indices in enumerate(sets) if indices is not None
            )
            yield from (
                (name, block, np.asarray(indices, dtype=np.int64))
                for block, indices in block_indices
            )
    for name, (tag, dim) in mesh.field_data.items():
        for block, tags in enumerate(mesh.cell_data.get("gmsh:physical", ())):
            if CELL_VERTICES.get(mesh.cells[block].type, 0) == dim + 1:
                yield name, block, np.flatnonzero(np.asarray(tags) == tag)
    ignored = (
        "gmsh:geometrical",
        "gmsh:physical" if mesh.field_data else "",
    )  # named above, or the drawing's own
    for name, blocks in mesh.cell_data.items():
        for block, values in enumerate(map(np.asarray, blocks)):
            if values.ndim == 1 and np.issubdtype(values.dtype, np.integer) and name not in ignored:
                yield name, block, np.flatnonzero(values)
                labels = np.unique(values)
                yield from (
                    (f"{name}={label}", block, np.flatnonzero(values == label))
                    for label in labels[:MAX_LABELS]
                )
