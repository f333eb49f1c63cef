"""Mesh files: points, cells and named groups, read by meshio.

Mesh files are treated as untrusted. A file is opened for reading only, references to files outside
its folder are not followed, and meshio reads it in a child process with limits of time and memory
that follow from its length. Every failure of meshio is reported as an error of the file.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from indent_sim.process.child_process import ProcessCrash, call_in_child
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, MeshFileError
from indent_sim.process.limits import limit_resources

T = TypeVar("T")
Meshio = Any  # A mesh of meshio, which is imported only when a file is read.
READERS = {  # Module of meshio by file extension.
    ".msh": "gmsh",
    ".xdmf": "xdmf",
    ".vtu": "vtu",
    ".inp": "abaqus",
}
# Largest length of files with binary arrays, of gmsh and HDF5: some ten million cells.
MAX_MESH_BYTES = 2 * 10**9
# Limits of CPU time [s] and memory [bytes] for reading: a constant, and an amount per byte.
READING_SECONDS = (10.0, 3e-6)
READING_MEMORY = (500e6, 100.0)
# Names of the cells, by their dimension.
CELL_KINDS = {1: "lines", 2: "triangles", 3: "tetrahedra"}
CELL_VERTICES = {"line": 2, "triangle": 3, "tetra": 4, "line3": 2, "triangle6": 3, "tetra10": 4}
VTK_EDGES = {  # Edges with midside nodes by the number of vertices, in the order of VTK.
    2: [(0, 1)],
    3: [(0, 1), (1, 2), (2, 0)],
    4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}
ELSET = re.compile(r",\s*elset\s*=\s*([^,]*)", re.IGNORECASE)


@dataclass(frozen=True)
class MeshFile:
    """Contents of a mesh file.

    Attributes
    ----------
    points
        Coordinates (n, 3) [length].
    cells
        Point numbers (m, dim + 1) of the simplices of each dimension.
    groups
        Indices of the simplices of each group, keyed by name and dimension.
    point_sets
        Indices of the points of each named set.
    midside_nodes
        Midside nodes of a quadratic mesh: point numbers (k, 2) of the ends of their edges, and
        point numbers (k,) of the nodes.
    """

    points: np.ndarray
    cells: Mapping[int, np.ndarray]
    groups: Mapping[str, Mapping[int, np.ndarray]]
    point_sets: Mapping[str, np.ndarray]
    midside_nodes: tuple[np.ndarray, np.ndarray]

    @property
    def names_text(self) -> str:
        """Names of the groups and point sets in the file, for messages."""
        names = sorted({*self.groups, *self.point_sets})
        # Largest number of names of a file that a message lists.
        max_names = 12
        listed_names = _quote(", ".join(names[:max_names])) + (
            " and more" if len(names) > max_names else ""
        )
        return f"the file has {listed_names}" if names else "the file has no named groups"


@dataclass(frozen=True)
class MeshFileVersion:
    """Version of a mesh file, identified by its inode and its time of modification.

    Attributes
    ----------
    path
        Path of the file.
    name
        Name of the file in the scene, for messages.
    size
        Length [bytes].
    modification
        Inode and time of modification [ns].
    """

    path: Path
    name: str
    size: int
    modification: tuple[int, int]


def find_mesh_file(folder: str, file: str) -> MeshFileVersion:
    """Return the current version of a mesh file below the folder of the scene.

    Raises
    ------
    ConfigError
        If the file cannot be read, lies outside the folder, is too long or of unknown format.
    """
    path = Path(folder or ".") / file
    base_folder = os.path.realpath(folder or ".")
    if os.path.commonpath([base_folder, os.path.realpath(path)]) != base_folder:
        problem = f"'{file}' leads out of the scene's folder through a link"
        raise ConfigError("body.file", problem, "copy the file into the scene's folder")
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "not a regular file")
        with open(path, "rb"):
            pass
    except (OSError, ValueError) as error:
        problem = f"cannot read the mesh '{file}': {getattr(error, 'strerror', None) or error}"
        remedy = "the path is relative to the folder of the scene file"
        raise ConfigError("body.file", problem, remedy) from None
    # Largest length of files that are parsed as text, in several times as much memory: some
    # million cells.
    max_text_bytes = 2 * 10**8
    max_bytes = MAX_MESH_BYTES if path.suffix.lower() == ".msh" else max_text_bytes
    if status.st_size > max_bytes:
        remedy = "coarsen the mesh"
        if max_bytes != MAX_MESH_BYTES:
            remedy += ", or write it as .msh, or as .xdmf with its arrays in HDF5"
        raise mesh_file_error(f"'{file}' is longer than {max_bytes} bytes", remedy)
    if path.suffix.lower() not in READERS:
        problem = f"'{file}' has no known file extension"
        raise ConfigError("body.file", problem, f"its name must end in one of {', '.join(READERS)}")
    return MeshFileVersion(path, file, status.st_size, (status.st_ino, status.st_mtime_ns))


def read_mesh_file(version: MeshFileVersion, convert: Callable[[MeshFile], T]) -> T:
    """Read a mesh file and convert its contents in a separate process.

    Parameters
    ----------
    version : MeshFileVersion
        The file to read.
    convert : callable
        Function that is called with the contents of the file in that process; it is pickled.

    Returns
    -------
    object
        The result of `convert`.

    Raises
    ------
    MeshFileError
        If the file is not a mesh, or reading exceeds the limits of time or memory.
    BackendError
        If meshio is missing or no process can be started.
    """
    try:
        return call_in_child(_read_and_convert, version, convert)
    except (ProcessCrash, MemoryError) as failure:
        cause = (
            f"its reader {failure}" if isinstance(failure, ProcessCrash) else "it needs more memory"
        )
        (seconds, seconds_per_byte) = READING_SECONDS
        (memory, memory_per_byte) = READING_MEMORY
        limits = (
            f"reading may take {seconds:g} s and {memory / 1e6:g} MB, plus "
            f"{seconds_per_byte * 1e6:g} s and {memory_per_byte:g} MB for each MB of the file"
        )
        raise mesh_file_error(
            f"'{version.name}' is not a mesh that can be read: {cause}", limits
        ) from None
    except OSError as error:
        raise BackendError(
            f"cannot start a process to read '{version.name}': {error.strerror or error}"
        ) from error


def _limit_reader(size: int) -> None:
    """Limit time and memory of this process to amounts sufficient for reading `size` bytes."""
    limit_resources(
        *(base + per_byte * size for base, per_byte in (READING_SECONDS, READING_MEMORY))
    )


def mesh_file_error(problem: str, remedy: str = "", key: str = "body.file") -> ConfigError:
    """Return a MeshFileError if the key is `body.file`, a ConfigError for any other key."""
    return (MeshFileError if key == "body.file" else ConfigError)(key, problem, remedy)


def named_simplices(file: MeshFile, name: str, dim: int, key: str) -> np.ndarray:
    """Return the indices of the simplices of a dimension that belong to a named group.

    Parameters
    ----------
    file : MeshFile
        Contents of the file.
    name : str
        Name of the group.
    dim : int
        Dimension of the simplices.
    key : str
        Key of the scene file that requests the group, for messages.

    Returns
    -------
    numpy.ndarray
        Indices into the simplices of this dimension.

    Raises
    ------
    ConfigError
        If there is no such group, or it has no simplices of this dimension.
    """
    if name not in file.groups:
        raise mesh_file_error(f"the file has no group '{name}'", file.names_text, key)
    if dim not in file.groups[name]:
        kinds = " and ".join(CELL_KINDS[group_dim] for group_dim in sorted(file.groups[name]))
        raise mesh_file_error(
            f"'{name}' is a group of {kinds}, but {CELL_KINDS[dim]} are needed here",
            file.names_text,
            key,
        )
    return file.groups[name][dim]


def _quote(text: str) -> str:
    """Return a text from a file, truncated to 200 letters."""
    max_letters = 200
    return text if len(text) <= max_letters else f"{text[:max_letters]}..."


def format_midpoint(corners: np.ndarray) -> str:
    """Format the centroid of a simplex, given by its corners (n, dim), for a message."""
    return f"({', '.join(f'{x:.4g}' for x in corners.mean(axis=0))})"


def _read_and_convert(version: MeshFileVersion, convert: Callable[[MeshFile], T]) -> T:
    """Check and read a file, and convert its contents, in a process with limited resources."""
    try:
        reader = import_module(f"meshio.{READERS[version.path.suffix.lower()]}").read
    except ImportError as missing:
        raise BackendError(
            f"a body from a file needs meshio ({missing}); run scripts/setup"
        ) from missing
    _limit_reader(version.size)
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
    except Exception as failure:  # Readers of meshio raise exceptions of any type.
        message = str(failure) or "it is empty or truncated"
        if isinstance(failure, KeyError):
            # The missing key of this KeyError may be the number of a cell type.
            message = f"it contains an unknown keyword or cell type, {failure}"
        problem = f"'{version.name}' is not a mesh that can be read: {_quote(message)}"
        raise mesh_file_error(problem, "write it again, for example in gmsh's format 4.1") from None
    return convert(mesh)


def _refuse_foreign_references(version: MeshFileVersion) -> None:
    """Raise MeshFileError if an XDMF file refers to data other than HDF5 files in its folder.

    The limits of the reader include the lengths of these files.
    """
    # Only XDMF files need an XML parser.
    from xml.etree import ElementTree

    sizes = {"": version.size}
    file = version.name
    # The reader of meshio treats elements of any name as a DataItem.
    for item in ElementTree.parse(version.path).iter():
        if item.get("Format", "XML") == "XML":
            continue
        name, _, dataset_path = (item.text or "").strip().partition(":")
        data_file = version.path.parent / name
        if item.get("Format") != "HDF" or "/" in name or "\\" in name or data_file.is_symlink():
            raise mesh_file_error(
                f"'{file}' refers to data in '{_quote(name)}'",
                "the data must be in an HDF5 file in the same folder",
            )
        if not data_file.is_file() or data_file.stat().st_size > MAX_MESH_BYTES:
            raise mesh_file_error(
                f"'{file}' refers to data in '{_quote(name)}', which is missing or too long"
            )
        _refuse_external_data(data_file, dataset_path, file)
        sizes[name] = data_file.stat().st_size
    _limit_reader(sum(sizes.values()))


def _refuse_external_data(path: Path, dataset_path: str, file: str) -> None:
    """Raise MeshFileError if a data set is not an array of numbers inside this HDF5 file.

    HDF5 can refer to any other file by soft and external links, external storage and virtual data
    sets.
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
                f"'{file}' refers to data in '{_quote(dataset_path)}', which are stored "
                f"outside of '{path.name}'"
            )
        if dataset.dtype.kind not in "fiu":
            raise mesh_file_error(
                f"'{file}' refers to data in '{_quote(dataset_path)}' of '{path.name}', which "
                "are not real numbers"
            )


def _refuse_ambiguous_abaqus(version: MeshFileVersion) -> None:
    """Raise MeshFileError for an Abaqus file that meshio would read incorrectly.

    meshio opens included files, keeps only the last of several node lists, and assigns an ELSET to
    the wrong cells if some element lists have none.
    """
    with open(version.path, encoding="utf-8") as file:
        lines = [line for line in file if not line[:1].isdigit() and not line.startswith("**")]
    # These are keywords as the reader of meshio finds them.
    keywords = [line.partition(",")[0].strip().replace("*", "").upper() for line in lines]
    element_sets = [
        ELSET.findall(line.strip())
        for line, keyword in zip(lines, keywords, strict=True)
        if keyword == "ELEMENT"
    ]
    if "INCLUDE" in keywords:
        raise mesh_file_error(
            f"'{version.name}' includes another file", "write the whole mesh into one file"
        )
    has_ambiguous_sets = any(element_sets) and len({*map(str, element_sets)} - {"[]"}) < len(
        element_sets
    )
    if keywords.count("NODE") > 1 or has_ambiguous_sets:
        problem = (
            f"'{version.name}' has several lists of nodes, or *ELEMENT blocks without an "
            "ELSET of their own"
        )
        raise mesh_file_error(problem, "write it as one part, and name groups of cells by *ELSET")


def _refuse_several_vtu_pieces(version: MeshFileVersion) -> None:
    """Raise MeshFileError for a file of several pieces, of which meshio reads only the last."""
    if version.path.read_bytes().count(b"<Piece") > 1:
        raise mesh_file_error(f"'{version.name}' has several pieces", "write the mesh as one piece")


def _checked_points(mesh: Meshio, file: str) -> np.ndarray:
    """Return the points (n, 3) of a meshio mesh; raise MeshFileError unless they are numbers."""
    points = np.asarray(mesh.points)
    if (
        points.ndim != 2
        or len(points) == 0
        or points.shape[1] not in (2, 3)
        or points.dtype.kind not in "fiu"
    ):
        raise mesh_file_error(
            f"'{file}' has no points, or points without two or three real coordinates"
        )
    # Largest coordinate in a file: volumes, which are cubes of lengths, and their inverses do not
    # overflow.
    largest_coordinate = 1e30
    if not (np.abs(points := points.astype(float)) < largest_coordinate).all():
        raise mesh_file_error(
            f"'{file}' has coordinates that are not finite or exceed {largest_coordinate:g}"
        )
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def _mesh_file_of(mesh: Meshio, file: str) -> MeshFile:
    """Return the contents of a meshio mesh; raise MeshFileError if it is malformed."""
    points = _checked_points(mesh, file)
    cells: dict[int, list[np.ndarray]] = {}
    edges: list[np.ndarray] = [np.empty((0, 2), dtype=np.int64)]
    midside_nodes: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    block_offsets = []
    for block in mesh.cells:
        if block.type == "vertex" or len(block.data) == 0:
            block_offsets.append((0, 0))
            continue
        if block.type not in CELL_VERTICES:
            problem = f"'{file}' has cells of the type {block.type}"
            raise mesh_file_error(problem, "mesh it with triangles or tetrahedra, of order 1 or 2")
        n = CELL_VERTICES[block.type]
        data = np.asarray(block.data)
        if (
            data.dtype.kind not in "iu"
            or data.ndim != 2
            or data.shape[1] not in (n, n + len(VTK_EDGES[n]))
        ):
            raise mesh_file_error(f"'{file}' has cells whose corners are not indices of points")
        if (data := data.astype(np.int64)).min() < 0 or data.max() >= len(points):
            raise mesh_file_error(
                f"'{file}' has cells with corners that are not points of the file"
            )
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
    simplices = {dim: np.concatenate(dim_blocks) for dim, dim_blocks in cells.items()}
    point_sets = {name: np.asarray(indices) for name, indices in mesh.point_sets.items()}
    all_midside_nodes = (np.concatenate(edges), np.concatenate(midside_nodes))
    return MeshFile(points, simplices, groups, point_sets, all_midside_nodes)


def _named_groups(mesh: Meshio) -> Iterator[tuple[str, int, np.ndarray]]:
    """Generate the named groups of cells: name, number of the cell block, indices in the block.

    Groups are the cell sets of the file and gmsh's physical groups. An integer array of cell data
    `name` defines the groups `name=3` of cells with the value 3, and so on, and `name` of all cells
    with a non-zero value.
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
    # Entities of gmsh's geometry are not named; physical groups with names have been generated.
    ignored_arrays = ("gmsh:geometrical", "gmsh:physical" if mesh.field_data else "")
    # An integer array of cell data with more values than this numbers the cells; it does not
    # name groups of them.
    max_labels = 1000
    for name, blocks in mesh.cell_data.items():
        if name in ignored_arrays:
            continue
        for block, values in enumerate(map(np.asarray, blocks)):
            if values.ndim == 1 and np.issubdtype(values.dtype, np.integer):
                yield name, block, np.flatnonzero(values)
                labels = np.unique(values)
                yield from (
                    (f"{name}={label}", block, np.flatnonzero(values == label))
                    for label in labels[:max_labels]
                )
