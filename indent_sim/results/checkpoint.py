"""The last equilibria of a run in one small file, from which `--resume` goes on.

The file is never needed: without it, or with one that is damaged or of another mesh, the last depth is walked to
once more from rest. It is made in memory and written in one rename, for the HDF5 library takes a full disk badly.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.results.folder import Report, content, write_atomically

CHECKPOINT = "checkpoint.h5"
Points = Sequence[tuple[float, float, Sequence[np.ndarray]]]  # depth, time, and the vectors that make the state there


@dataclass(frozen=True)
class Checkpoint:
    """Points of the load path, oldest first, in the solver's own units; `step` rows were done then."""

    step: int = 0
    points: Points = ()


def write(path: Path, saved: Checkpoint, identity: Report) -> None:
    """Replace the file; `identity` says to which mesh and numbering the vectors belong. OSError on a full disk."""
    import h5py

    image, owner = io.BytesIO(), json.dumps(identity, sort_keys=True)
    with h5py.File(image, "w") as file:
        file.attrs.update(step=saved.step, identity=owner, checksum=_checksum(saved.points))
        for n, (depth, t, vectors) in enumerate(saved.points):
            group = file.create_group(f"point/{n}")
            group.attrs.update(delta=depth, t=t)
            for k, vector in enumerate(vectors):
                group[str(k)] = vector
    write_atomically(path, image.getvalue(), sync=False)


def read(path: Path, identity: Report) -> Checkpoint:
    """What was saved for this mesh and numbering; an empty checkpoint when there is none, or a damaged one."""
    import h5py

    try:
        with h5py.File(io.BytesIO(content(path)), "r") as file:
            groups = [file[f"point/{n}"] for n in range(len(file["point"]))]
            places = [(float(g.attrs["delta"]), float(g.attrs["t"])) for g in groups]
            vectors = [[g[str(k)][()] for k in range(len(g))] for g in groups]
            points = [(*place, own) for place, own in zip(places, vectors, strict=True)]
            owner = json.dumps(identity, sort_keys=True)
            intact = int(file.attrs["checksum"]) == _checksum(points) and file.attrs["identity"] == owner
            parts = (part for *place, vectors in points for part in (*place, *vectors))
            intact = intact and all(np.isfinite(part).all() for part in parts)
            return Checkpoint(int(file.attrs["step"]), points) if intact else Checkpoint()
    except Exception:  # HDF5 has an error for every way of being damaged
        return Checkpoint()


def _checksum(points: Points) -> int:
    total = 0
    for *place, vectors in points:
        for values in (np.array(place), *vectors):
            total = zlib.crc32(np.ascontiguousarray(values).tobytes(), total)
    return total
