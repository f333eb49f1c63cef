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
from indent_sim.process.limits import confine
from indent_sim.process.ranks import is_one_of_several

T = TypeVar("T")
Meshio = Any  # a mesh of meshio, which is loaded where a file is read alone
Reader = Callable[[Path], Meshio]
READERS = {
    ".msh": "gmsh",
    ".xdmf": "xdmf",
    ".vtu": "vtu",
    ".inp": "abaqus",
}  # ending -> module of meshio
MOST_MESH_BYTES = (
    2 * 10**9
)  # of a file whose arrays are read as they are, HDF5 and gmsh's: some ten millions of cells
MOST_TEXT = 2 * 10**8  # of one that is taken apart, in some times as much memory: some millions
# CPU time and bytes that reading may take, and more for each byte read
SECONDS = (10.0, 3e-6)
READING_MEMORY = (500e6, 100.0)
CELL_VERTICES = {"line": 2, "triangle": 3, "tetra": 4, "line3": 2, "triangle6": 3, "tetra10": 4}
VTK_EDGES = {
    2: [(0, 1)],
    3: [(0, 1), (1, 2), (2, 0)],
    4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}  # as in VTK
ELSET = re.compile(r",\s*elset\s*=\s*([^,]*)", re.IGNORECASE)
MOST_KINDS = 1000  # of numbers at cells: more are a count of the cells, not names
# that a message lists, and of what it cites
MOST_NAMES = 12
MOST_CITED_LETTERS = 200
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
    corners: Mapping[str, np.ndarray]
    middles: tuple[np.ndarray, np.ndarray]

    @property
    def names(self) -> str:
        """The names in it, in words."""
        found = sorted({*self.groups, *self.corners})
        shown = _cited(", ".join(found[:MOST_NAMES])) + (
            " and more" if len(found) > MOST_NAMES else ""
        )
        return f"the file has {shown}" if found else "the file has no names"


@dataclass(frozen=True)
class Found:
    """A version of a mesh file."""

    path: Path
    name: str
    size: int  # [bytes]
    changed: tuple[int, int]


def find(folder: str, file: str) -> Found:
    """A mesh file below a folder, that of the scene; ConfigError for what is none."""
    path = Path(folder or ".") / file
    here = os.path.realpath(folder or ".")
    if os.path.commonpath([here, os.path.realpath(path)]) != here:
        problem = f"'{file}' leads out of the scene's folder through a link"
        raise ConfigError("body.file", problem, "copy the file beside the scene")
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise OSError(0, "not a regular file")
        with open(path, "rb"):
            pass
    except (OSError, ValueError) as error:
        problem = f"cannot read the mesh '{file}': {getattr(error, 'strerror', None) or error}"
        raise ConfigError("body.file", problem, "it is looked for beside the scene file") from None
    most = MOST_MESH_BYTES if path.suffix.lower() == ".msh" else MOST_TEXT
    if about.st_size > most:
        better = (
            ""
            if most == MOST_MESH_BYTES
            else ", or write it as .msh, or as .xdmf with HDF5 beside it"
        )
        raise refused(f"'{file}' is longer than {most} bytes", f"coarsen the mesh{better}")
    if path.suffix.lower() not in READERS:
        raise ConfigError(
            "body.file",
            f"'{file}' is of no known kind",
            f"it must end in one of {', '.join(READERS)}",
        )
    return Found(path, file, about.st_size, (about.st_ino, about.st_mtime_ns))


def read(found: Found, made: Callable[[MeshFile], T]) -> T:
    """What a function makes of the mesh in a file, all of it in a process of its own; MeshFileError
    for what is no mesh or needs more time or memory than its length allows.
    """
    from indent_sim.process.forked import Crash, once  # with processes, which no other body needs

    try:
        reader = import_module(f"meshio.{READERS[found.path.suffix.lower()]}").read
    except ImportError as missing:
        raise BackendError(
            f"a body from a file needs meshio ({missing}); run scripts/setup"
        ) from missing
    try:
        return once(
            partial(_made, reader, found, made), partial(_confine, found.size), is_one_of_several()
        )
    except (Crash, MemoryError) as failure:
        how = f"its reader {failure}" if isinstance(failure, Crash) else "it needs more memory"
        (s, more_s) = SECONDS
        (b, more_b) = READING_MEMORY
        limits = (
            f"it may take {s:g} s and {b / 1e6:g} MB, and {more_s * 1e6:g} s and {more_b:g} "
            "MB more for each MB"
        )
        raise refused(f"'{found.name}' is not a mesh that can be read: {how}", limits) from None
    except OSError as error:
        raise BackendError(
            f"no process to read '{found.name}' in: {error.strerror or error}"
        ) from error


def _confine(size: int) -> None:
    confine(*(first + more * size for first, more in (SECONDS, READING_MEMORY)))


def refused(problem: str, remedy: str = "", key: str = "body.file") -> ConfigError:
    """The error of a mesh file that is no body, or that is not what another key says of it."""
    return (MeshFileError if key == "body.file" else ConfigError)(key, problem, remedy)


def _cited(words: str) -> str:
    """What a file says, at most some letters of it."""
    return words if len(words) <= MOST_CITED_LETTERS else f"{words[:MOST_CITED_LETTERS]}..."


def place_of(corners: np.ndarray) -> str:
    """The middle of a simplex (n, dim), for a message."""
    return f"({', '.join(f'{x:.4g}' for x in corners.mean(axis=0))})"


def _made(reader: Reader, found: Found, made: Callable[[MeshFile], T]) -> T:
    """What `read` gives, in the forked process."""
    refuse = {".xdmf": _refuse_references, ".inp": _refuse_parts, ".vtu": _refuse_pieces}.get(
        found.path.suffix.lower()
    )
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), np.errstate(all="ignore"):
            if refuse:
                refuse(found)
            mesh = _taken(reader(found.path), found.name)
    except (IndentSimError, MemoryError):
        raise
    except Exception as failure:  # readers raise whatever they stumble over
        is_unknown = isinstance(failure, KeyError)  # the number of a kind of cell, say
        words = (
            f"its reader does not know {failure}"
            if is_unknown
            else str(failure) or "it is empty or cut short"
        )
        problem = f"'{found.name}' is not a mesh that can be read: {_cited(words)}"
        raise refused(problem, "write it anew, as gmsh 4.1, say") from None
    return made(mesh)


def _refuse_references(found: Found) -> None:
    """An XDMF file may name others for its numbers: plain names beside it, and real files, alone,
    which count too.
    """
    from xml.etree import ElementTree  # of no use to other files

    sizes = {"": found.size}
    file = found.name
    for item in ElementTree.parse(found.path).iter():  # its reader takes any element for a DataItem
        if item.get("Format", "XML") == "XML":
            continue
        name, _, inside = (item.text or "").strip().partition(":")
        beside = found.path.parent / name
        if item.get("Format") != "HDF" or "/" in name or "\\" in name or beside.is_symlink():
            raise refused(
                f"'{file}' takes its numbers from '{_cited(name)}'",
                "HDF5 beside it alone is followed",
            )
        if not beside.is_file() or beside.stat().st_size > MOST_MESH_BYTES:
            raise refused(
                f"'{file}' takes its numbers from '{_cited(name)}', which is missing or too long"
            )
        _refuse_elsewhere(beside, inside, file)
        sizes[name] = beside.stat().st_size
    _confine(sum(sizes.values()))


def _refuse_elsewhere(path: Path, inside: str, file: str) -> None:
    """HDF5 may keep numbers in any file at all: no link but hard ones on the way, no other storage,
    only numbers.
    """
    import h5py

    with h5py.File(path) as store:
        links = accumulate(inside.strip("/").split("/"), "{}/{}".format)
        is_here = all(isinstance(store.get(link, getlink=True), h5py.HardLink) for link in links)
        found = store[inside] if is_here else None
        if not isinstance(found, h5py.Dataset) or found.external or found.is_virtual:
            raise refused(
                f"'{file}' takes its numbers from '{_cited(inside)}', which are not in "
                f"'{path.name}' itself"
            )
        if found.dtype.kind not in "fiu":
            raise refused(
                f"'{file}' takes its numbers from '{_cited(inside)}' of '{path.name}', which are "
                "not real"
            )


def _refuse_parts(found: Found) -> None:
    """Its reader follows INCLUDE, keeps the last of several lists of nodes, and mistakes whose
    cells an ELSET names.
    """
    with open(found.path, encoding="utf-8") as file:
        lines = [line for line in file if not line[:1].isdigit() and not line.startswith("**")]
    words = [
        line.partition(",")[0].strip().replace("*", "").upper() for line in lines
    ]  # as it takes them
    sets = [
        ELSET.findall(line.strip())
        for line, word in zip(lines, words, strict=True)
        if word == "ELEMENT"
    ]
    if "INCLUDE" in words:
        raise refused(f"'{found.name}' includes another file", "put all of the mesh into one")
    if words.count("NODE") > 1 or (any(sets) and len({*map(str, sets)} - {"[]"}) < len(sets)):
        problem = (
            f"'{found.name}' has several lists of nodes, or *ELEMENT with and without an "
            "ELSET of their own"
        )
        raise refused(problem, "write it as one part, and name cells by *ELSET")


def _refuse_pieces(found: Found) -> None:
    if (
        found.path.read_bytes().count(b"<Piece") > 1
    ):  # its reader takes the cells of the last one alone
        raise refused(f"'{found.name}' has several pieces", "write the mesh as one")


def _taken(mesh: Meshio, file: str) -> MeshFile:
    """What meshio has read, by the dimension of the simplices."""
    points = np.asarray(mesh.points)
    if (
        points.ndim != 2
        or len(points) == 0
        or points.shape[1] not in (2, 3)
        or points.dtype.kind not in "fiu"
    ):
        raise refused(f"'{file}' has no points, or some without two or three real coordinates")
    if not (np.abs(points := points.astype(float)) < LARGEST_COORDINATE).all():
        raise refused(
            f"'{file}' has coordinates that are no numbers, or beyond {LARGEST_COORDINATE:g}"
        )
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    cells: dict[int, list[np.ndarray]] = {}
    edges: list[np.ndarray] = [np.empty((0, 2), dtype=np.int64)]
    middles: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    where = []
    for block in mesh.cells:
        if block.type == "vertex" or len(block.data) == 0:
            where.append((0, 0))
            continue
        if block.type not in CELL_VERTICES:
            words = f"'{file}' has cells of the kind {block.type}"
            raise refused(words, "mesh it with triangles or tetrahedra, of order 1 or 2")
        n = CELL_VERTICES[block.type]
        data = np.asarray(block.data)
        if (
            data.dtype.kind not in "iu"
            or data.ndim != 2
            or data.shape[1] not in (n, n + len(VTK_EDGES[n]))
        ):
            raise refused(f"'{file}' has cells whose corners are no numbers of points")
        if (data := data.astype(np.int64)).min() < 0 or data.max() >= len(points):
            raise refused(f"'{file}' has cells with corners that are no points of it")
        known = cells.setdefault(n - 1, [])
        where.append((n - 1, sum(map(len, known))))
        known.append(data[:, :n])
        if data.shape[1] > n:
            edges += [data[:, list(pair)] for pair in VTK_EDGES[n]]
            middles += [data[:, n + k] for k in range(len(VTK_EDGES[n]))]
    groups: dict[str, dict[int, np.ndarray]] = {}
    for name, block, indices in _named(mesh):
        dim, begin = where[block]
        if dim and len(indices):
            group = groups.setdefault(name, {})
            group[dim] = np.union1d(group.get(dim, indices[:0]), begin + indices)
    simplices = {dim: np.concatenate(parts) for dim, parts in cells.items()}
    corners = {name: np.asarray(found) for name, found in mesh.point_sets.items()}
    return MeshFile(
        points, simplices, groups, corners, (np.concatenate(edges), np.concatenate(middles))
    )


def _named(mesh: Meshio) -> Iterator[tuple[str, int, np.ndarray]]:
    """(name, block, indices in it) of groups, cell sets, numbers at cells: `array=3` where 3,
    `array` where not 0.
    """
    for name, sets in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            there = ((block, found) for block, found in enumerate(sets) if found is not None)
            yield from ((name, block, np.asarray(found, dtype=np.int64)) for block, found in there)
    for name, (tag, dim) in mesh.field_data.items():
        for block, tags in enumerate(mesh.cell_data.get("gmsh:physical", ())):
            if CELL_VERTICES.get(mesh.cells[block].type, 0) == dim + 1:
                yield name, block, np.flatnonzero(np.asarray(tags) == tag)
    without = (
        "gmsh:geometrical",
        "gmsh:physical" if mesh.field_data else "",
    )  # named above, or the drawing's own
    for name, blocks in mesh.cell_data.items():
        for block, values in enumerate(map(np.asarray, blocks)):
            if values.ndim == 1 and np.issubdtype(values.dtype, np.integer) and name not in without:
                yield name, block, np.flatnonzero(values)
                kinds = np.unique(values)
                yield from (
                    (f"{name}={kind}", block, np.flatnonzero(values == kind))
                    for kind in kinds[:MOST_KINDS]
                )
