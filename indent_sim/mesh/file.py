"""A mesh file -> points, cells and their names; read by meshio, which is loaded where a scene has such a body alone.

A file comes from a stranger: it is opened for reading only, nothing that it refers to is followed out of its folder,
and whatever its reader stumbles over is an error of the scene.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from io import StringIO
from itertools import accumulate
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from indent_sim.process.errors import BackendError, ConfigError

READERS = {".msh": "gmsh", ".xdmf": "xdmf", ".vtu": "vtu", ".inp": "abaqus"}  # ending -> module of meshio
MOST_BYTES = 2 * 10**9  # of a file whose arrays are read as they are, HDF5 and gmsh's: some ten millions of cells
MOST_TEXT = 2 * 10**8  # of one that is taken apart, in some times as much memory: some millions
MOST_PACKED = 2 * 10**8  # of an array in less than a PACKED part of that: a few bytes may unfold to fill the memory
PACKED = 100
VERTICES = {"line": 2, "triangle": 3, "tetra": 4, "line3": 2, "triangle6": 3, "tetra10": 4}
DIMENSION = {2: 1, 3: 2, 4: 3}  # of a simplex, by its vertices
EDGES = {2: [(0, 1)], 3: [(0, 1), (1, 2), (2, 0)], 4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]}  # as in VTK
IGNORED = {"vertex"}
INCLUDE = re.compile(rb"^\s*\*\s*include\b", re.IGNORECASE | re.MULTILINE)
MOST_KINDS = 1000  # of numbers at cells: more are a count of the cells, not names
MOST_NAMES = 12  # that a message lists


@dataclass(frozen=True)
class MeshFile:
    """What a file holds: points (n, 3) [length], simplices (m, dim + 1) by their dimension, and who has which name.

    groups: name -> dimension -> indices of simplices. corners: name -> indices of points. middles: the midside nodes of
    a quadratic mesh, edges (k, 2) by their points and the place (k,) of the node on each.
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
        shown = ", ".join(found[:MOST_NAMES]) + (" and more" if len(found) > MOST_NAMES else "")
        return f"the file has {shown}" if found else "the file has no names"


def read(folder: str, file: str) -> MeshFile:
    """The mesh in a file below a folder, that of the scene; ConfigError for one that cannot be read."""
    path = Path(folder or ".") / file
    _refuse_outside(Path(folder or "."), path, file)
    about = _opened(path, file)
    return _read(path, file, (about.st_ino, about.st_size, about.st_mtime_ns))


def refused(problem: str, remedy: str = "", key: str = "body.file") -> ConfigError:
    """The error of a mesh that is no body."""
    return ConfigError(key, problem, remedy)


def place_of(corners: np.ndarray) -> str:
    """The middle of a simplex (n, dim), for a message."""
    return f"({', '.join(f'{x:.4g}' for x in corners.mean(axis=0))})"


def _refuse_outside(folder: Path, path: Path, file: str) -> None:
    """Nothing but what lies in the scene's folder or below, links followed."""
    here = os.path.realpath(folder)
    if os.path.commonpath([here, os.path.realpath(path)]) != here:
        raise refused(f"'{file}' leads out of the scene's folder through a link", "copy the file beside the scene")


def _opened(path: Path, file: str) -> os.stat_result:
    """That a file is there, regular, readable and not too long."""
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise OSError(0, "not a regular file")
        with open(path, "rb"):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise refused(f"cannot read the mesh '{file}': {reason}", "it is looked for beside the scene file") from None
    most = MOST_BYTES if path.suffix.lower() == ".msh" else MOST_TEXT
    if about.st_size > most:
        better = "" if most == MOST_BYTES else ", or write it as .msh, or as .xdmf with HDF5 beside it"
        raise refused(f"'{file}' is longer than {most} bytes", f"coarsen the mesh{better}")
    if path.suffix.lower() not in READERS:
        raise refused(f"'{file}' is of no known kind", f"it must end in one of {', '.join(READERS)}")
    return about


@lru_cache(maxsize=1)
def _read(path: Path, file: str, version: tuple[int, ...]) -> MeshFile:
    """The mesh of this version of a file, read once however often the scene is resolved."""
    kind = READERS[path.suffix.lower()]
    {"xdmf": _refuse_references, "abaqus": _refuse_includes}.get(kind, lambda path, file: None)(path, file)
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), np.errstate(all="ignore"):
            found = _reader(kind)(path)
    except BackendError:
        raise
    except Exception as failure:  # readers raise whatever they stumble over
        is_unknown = isinstance(failure, KeyError)  # the number of a kind of cell, say
        words = f"its reader does not know {failure}" if is_unknown else str(failure) or "it is empty or cut short"
        raise refused(f"'{file}' is not a mesh that can be read: {words}", "write it anew, as gmsh 4.1 say") from None
    return _taken(found, file)


def _reader(kind: str) -> Callable[[Path], Any]:
    try:
        reader: Callable[[Path], Any] = import_module(f"meshio.{kind}").read
    except ImportError as missing:
        raise BackendError(f"a body from a file needs meshio ({missing}); run scripts/setup") from missing
    return reader


def _refuse_references(path: Path, file: str) -> None:
    """An XDMF file may name others for its numbers: plain names beside it, and real files, alone."""
    try:
        items = list(ElementTree.parse(path).iter("DataItem"))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise refused(f"'{file}' is not a mesh that can be read: {error}") from None
    for item in items:
        if item.get("Format", "XML") == "XML":
            continue
        name, _, inside = (item.text or "").strip().partition(":")
        beside = path.parent / name
        if item.get("Format") != "HDF" or "/" in name or "\\" in name or beside.is_symlink():
            raise refused(f"'{file}' takes its numbers from '{name}'", "one HDF5 file beside it is followed, no other")
        if not beside.is_file() or beside.stat().st_size > MOST_BYTES:
            raise refused(f"'{file}' takes its numbers from '{name}', which is missing or too long")
        _refuse_elsewhere(beside, inside, file)


def _refuse_elsewhere(path: Path, inside: str, file: str) -> None:
    """An HDF5 file may keep a dataset's numbers in any file at all, or unfold a few bytes to fill the memory."""
    import h5py

    try:
        with h5py.File(path) as store:
            links = accumulate(inside.strip("/").split("/"), "{}/{}".format)
            leads_out = any(isinstance(store.get(link, getlink=True), h5py.ExternalLink) for link in links)
            found = None if leads_out else store[inside]
            if leads_out or not isinstance(found, h5py.Dataset) or found.external or found.is_virtual:
                raise refused(f"'{file}' takes its numbers from '{inside}', which are not in '{path.name}' itself")
            most = min(MOST_BYTES, max(MOST_PACKED, PACKED * found.id.get_storage_size()))
            if found.nbytes > most:
                raise refused(f"'{file}' takes its numbers from '{inside}', which is longer than {most} bytes")
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise refused(f"'{file}' is not a mesh that can be read: {error}") from None


def _refuse_includes(path: Path, file: str) -> None:
    if INCLUDE.search(path.read_bytes()):
        raise refused(f"'{file}' includes another file", "put all of the mesh into one")


def _taken(mesh: Any, file: str) -> MeshFile:
    """What meshio has read, by the dimension of the simplices."""
    points = np.asarray(mesh.points, dtype=float)
    if points.ndim != 2 or len(points) == 0 or not np.isfinite(points).all():
        raise refused(f"'{file}' has no points, or some that are no numbers")
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    cells: dict[int, list[np.ndarray]] = {}
    edges: list[np.ndarray] = [np.empty((0, 2), dtype=np.int64)]
    middles: list[np.ndarray] = [np.empty(0, dtype=np.int64)]
    where = []
    for block in mesh.cells:
        if block.type in IGNORED or len(block.data) == 0:
            where.append((0, 0))
            continue
        if block.type not in VERTICES:
            raise refused(f"'{file}' has cells of the kind {block.type}", "mesh it with triangles or tetrahedra, of "
                          "order 1 or 2")  # fmt: skip
        n, data = VERTICES[block.type], np.asarray(block.data, dtype=np.int64)
        if data.min() < 0 or data.max() >= len(points):
            raise refused(f"'{file}' has cells with corners that are no points of it")
        known = cells.setdefault(DIMENSION[n], [])
        where.append((DIMENSION[n], sum(map(len, known))))
        known.append(data[:, :n])
        if data.shape[1] > n:
            edges += [data[:, list(pair)] for pair in EDGES[n]]
            middles += [data[:, n + k] for k in range(len(EDGES[n]))]
    groups: dict[str, dict[int, np.ndarray]] = {}
    for name, block, indices in _named(mesh):
        dim, begin = where[block]
        if dim and len(indices):
            group = groups.setdefault(name, {})
            group[dim] = np.union1d(group.get(dim, indices[:0]), begin + indices)
    return MeshFile(points, {dim: np.concatenate(parts) for dim, parts in cells.items()}, groups,
                    {name: np.asarray(found) for name, found in mesh.point_sets.items()},
                    (np.concatenate(edges), np.concatenate(middles)))  # fmt: skip


def _named(mesh: Any) -> Iterator[tuple[str, int, np.ndarray]]:
    """(name, block, indices in it) of physical groups, of cell sets, and of whole numbers at cells.

    Where a file gives its cells numbers but no names, `array=3` is the name of those that have a 3 in `array`, and
    `array` of those that have anything but a zero.
    """
    for name, sets in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            yield from ((name, block, np.asarray(found, dtype=np.int64)) for block, found in enumerate(sets)
                        if found is not None)  # fmt: skip
    for name, (tag, dim) in mesh.field_data.items():
        for block, tags in enumerate(mesh.cell_data.get("gmsh:physical", ())):
            if VERTICES.get(mesh.cells[block].type, 0) == dim + 1:
                yield name, block, np.flatnonzero(np.asarray(tags) == tag)
    without = ("gmsh:geometrical", "gmsh:physical" if mesh.field_data else "")  # named above, or the drawing's own
    for name, blocks in mesh.cell_data.items():
        for block, values in enumerate(map(np.asarray, blocks)):
            if values.ndim == 1 and np.issubdtype(values.dtype, np.integer) and name not in without:
                yield name, block, np.flatnonzero(values)
                kinds = np.unique(values)
                yield from ((f"{name}={kind}", block, np.flatnonzero(values == kind)) for kind in kinds[:MOST_KINDS])
