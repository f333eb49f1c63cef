"""Checkpoint file (HDF5) with the last equilibria of a run, for `--resume`.

The file is optional: if it is missing, damaged or belongs to another mesh, the last depth is solved
again from the undeformed body. The file is created in memory, written and renamed, because the HDF5
library does not recover from a full disk.
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
# Depth, time, and the vectors of unknowns and internal variables of an equilibrium.
SavedEquilibrium = tuple[float, float, Sequence[np.ndarray]]
SavedEquilibria = Sequence[SavedEquilibrium]


@dataclass(frozen=True)
class Checkpoint:
    """Equilibria from which a run can continue, nondimensional.

    Attributes
    ----------
    step
        Number of completed rows.
    equilibria
        Equilibria of the load path, oldest first.
    pull_off_points
        Equilibria around the row with the largest tensile force, by step; the pull-off force is
        searched between them.
    """

    step: int = 0
    equilibria: SavedEquilibria = ()
    pull_off_points: Mapping[int, SavedEquilibrium] = field(default_factory=dict)

    def arrays(self) -> Iterator[np.ndarray]:
        """Yield all arrays of the checkpoint in a fixed order: depths, times and unknowns."""
        for delta, t, vectors in self.equilibria:
            yield np.array([delta, t])
            yield from vectors
        for number, (delta, t, vectors) in sorted(self.pull_off_points.items()):
            yield np.array([number, delta, t])
            yield from vectors

    def checksum(self) -> int:
        """Return the CRC-32 of all depths, times and unknowns, to detect a damaged file."""
        total = 0
        for values in self.arrays():
            total = zlib.crc32(np.ascontiguousarray(values).tobytes(), total)
        return total


def write(path: Path, saved: Checkpoint, identity: Report) -> None:
    """Write the checkpoint file and replace an earlier one.

    Parameters
    ----------
    path
        The file.
    saved
        The checkpoint to be written.
    identity
        Entries that identify the mesh and the numbering of the unknowns.

    Raises
    ------
    OSError
        The disk is full.
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
    """Return the checkpoint saved for this mesh and numbering.

    The checkpoint is empty if the file is missing, damaged or belongs to another mesh.
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
    except Exception:  # h5py raises many types of errors for damaged files.
        return Checkpoint()
