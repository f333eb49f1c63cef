"""The last equilibria of a run in one small file, from which `--resume` goes on.

The file is never needed: without it, or with one that is damaged or of another mesh, the last depth
is walked to once more from rest. It is made in memory and written in one rename, for the HDF5
library takes a full disk badly.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from indent_sim.results.atomic_files import read_regular_file, write_atomically
from indent_sim.results.result_files import Report

CHECKPOINT = "checkpoint.h5"
SavedEquilibrium = tuple[
    float, float, Sequence[np.ndarray]
]  # depth, time, and the vectors that make the state there
SavedEquilibria = Sequence[SavedEquilibrium]


@dataclass(frozen=True)
class Checkpoint:
    """What a run needs to go on, in the solver's own units.

    Attributes
    ----------
    step
        Number of rows that were done.
    points
        Equilibria of the load path, oldest first.
    pull_off_points
        Equilibria around the row that pulls most, by their numbers, between which the pull-off is
        searched for.
    """

    step: int = 0
    equilibria: SavedEquilibria = ()
    pull_off_points: Mapping[int, SavedEquilibrium] = field(default_factory=dict)

    def arrays(self) -> Iterator[np.ndarray]:
        """Yield all arrays of the checkpoint, in one order: depths, times and unknowns."""
        for delta, t, vectors in self.equilibria:
            yield np.array([delta, t])
            yield from vectors
        for number, (delta, t, vectors) in sorted(self.pull_off_points.items()):
            yield np.array([number, delta, t])
            yield from vectors

    def checksum(self) -> int:
        """Return the CRC-32 of all depths, times and unknowns, by which a damaged file is
        recognised.
        """
        total = 0
        for values in self.arrays():
            total = zlib.crc32(np.ascontiguousarray(values).tobytes(), total)
        return total


def write(path: Path, saved: Checkpoint, identity: Report) -> None:
    """Replace the file; `identity` says to which mesh and numbering the vectors belong. OSError on
    a full disk.
    """
    import h5py

    buffer = io.BytesIO()
    identity_text = json.dumps(identity, sort_keys=True)
    groups = {f"point/{n}": point for n, point in enumerate(saved.equilibria)}
    groups |= {f"pull_off/{number}": point for number, point in saved.pull_off_points.items()}
    with h5py.File(buffer, "w") as file:
        file.attrs.update(step=saved.step, identity=identity_text, checksum=saved.checksum())
        for name, (depth, t, vectors) in groups.items():
            group = file.create_group(name)
            group.attrs.update(delta=depth, t=t)
            for k, vector in enumerate(vectors):
                group[str(k)] = vector
    write_atomically(path, buffer.getvalue(), sync=False)


def read(path: Path, identity: Report) -> Checkpoint:
    """What was saved for this mesh and numbering; an empty checkpoint when there is none, or a
    damaged one.
    """
    import h5py

    def point(group: h5py.Group) -> SavedEquilibrium:
        vectors = [group[str(k)][()] for k in range(len(group))]
        return float(group.attrs["delta"]), float(group.attrs["t"]), vectors

    try:
        with h5py.File(io.BytesIO(read_regular_file(path)), "r") as file:
            equilibria = [point(file[f"point/{n}"]) for n in range(len(file["point"]))]
            pulls = {
                int(number): point(group) for number, group in file.get("pull_off", {}).items()
            }
            saved = Checkpoint(int(file.attrs["step"]), equilibria, pulls)
            identity_text = json.dumps(identity, sort_keys=True)
            is_ours = (
                int(file.attrs["checksum"]) == saved.checksum()
                and file.attrs["identity"] == identity_text
            )
            is_finite = all(np.isfinite(values).all() for values in saved.arrays())
            return saved if is_ours and is_finite else Checkpoint()
    except Exception:  # HDF5 has an error for every way of being damaged
        return Checkpoint()
