"""Arrays of a map in an HDF5 file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import BackendError
from indent_sim.process.installation import afm_command


def require_hdf5(result: str) -> None:
    """Raise BackendError if the package that writes HDF5 files is missing.

    `result` is the name of the file or result to be written, for the message.
    """
    try:
        import h5py  # noqa: F401
    except ImportError as error:
        raise BackendError(
            f"{result} is written by h5py, which is missing ({error}); this line installs "
            f"it: {afm_command()}"
        ) from error


def hdf5_bytes(
    arrays: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    is_compressed: bool = True,
) -> bytes:
    """Return the bytes of a file with a dataset for each array, and attributes.

    A dataset whose unit is known has it as its attribute `unit`.
    """
    import h5py

    data = io.BytesIO()
    with h5py.File(data, "w") as file:
        for name, values in arrays.items():
            filters = {"compression": "gzip", "shuffle": True} if is_compressed else {}
            dataset = file.create_dataset(name, data=values, **filters)
            if units and name in units:
                dataset.attrs["unit"] = units[name]
        for name, value in attributes.items():
            file.attrs[name] = list(value) if isinstance(value, tuple) else value
    return data.getvalue()


def read_hdf5_file(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return arrays and attributes of a file; raise OSError if it cannot be read."""
    import h5py

    with h5py.File(path) as file:
        return {name: np.asarray(data) for name, data in file.items()}, dict(file.attrs)
