"""Reader of the fields of a result folder."""

from __future__ import annotations

import os
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.field_arrays import (
    ARRAYS,
    FIELDS_MESH_FILE,
    GRID_PATTERN,
    MESH_ARRAYS,
    OPTIONAL_ARRAYS,
    XDMF_FILE,
    XDMF_TAIL,
    read_arrays,
    step_file,
)
from indent_sim.results.result_files import FIELDS_FOLDER


def missing_field_files(folder: Path) -> list[str]:
    """Return the names of the field files of a finished run that are missing or damaged."""
    text = _read_index(folder)
    steps = _indexed_steps(text)
    if not (steps and text.endswith(XDMF_TAIL)):
        return [XDMF_FILE]
    needed_arrays = {FIELDS_MESH_FILE: {"points", "cells"}} | {
        step_file(step): set(ARRAYS) for step in steps
    }
    fields = folder / FIELDS_FOLDER
    return [
        f"{FIELDS_FOLDER}/{name}"
        for name, arrays in needed_arrays.items()
        if not arrays <= _array_names(fields / name)
    ]


def steps_with_fields(folder: Path, rows: Collection[float]) -> list[int]:
    """Return the steps in `rows` whose fields are in a result folder.

    Fields are written before the row of their step; fields of a step without a row are ignored.
    """
    return [step for step in _indexed_steps(_read_index(folder)) if step in rows]


def _read_index(folder: Path) -> str:
    """Return the text of fields.xdmf; "" if it cannot be read."""
    with suppress(OSError, ValueError):
        return read_regular_file(folder / XDMF_FILE).decode("utf-8")
    return ""


def _indexed_steps(index: str) -> list[int]:
    """Return the steps that are named in the text of fields.xdmf."""
    return [int(grid["step"]) for grid in GRID_PATTERN.finditer(index)]


def read_fields(folder: str | os.PathLike[str], step: int) -> dict[str, np.ndarray]:
    """Read the mesh and the fields of a step.

    Parameters
    ----------
    folder
        The result folder.
    step
        A step of `steps_with_fields`.

    Returns
    -------
    dict
        points (n, 3) [length], cells (m, corners), region (m,), and the fields by name with one row
        per point or per cell, see `field_arrays`.

    Raises
    ------
    UsageError
        If the files are missing or damaged.
    """
    folder = Path(folder)
    try:
        arrays = read_arrays(folder / FIELDS_FOLDER / FIELDS_MESH_FILE) | read_arrays(
            folder / FIELDS_FOLDER / step_file(step)
        )
        counts = {"Node": len(arrays["points"]), "Cell": len(arrays["cells"])}
        optional_layouts = {name: kind for name, kind in OPTIONAL_ARRAYS.items() if name in arrays}
        kinds = ARRAYS | MESH_ARRAYS | optional_layouts
        if all(arrays[name].shape == (counts[kinds[name][0]], *kinds[name][2]) for name in kinds):
            return arrays
        raise ValueError("the sizes of the arrays do not match")
    except Exception as error:  # h5py raises many types of errors for damaged files.
        raise UsageError(f"the fields of step {step} in {folder} cannot be read: {error}") from None


def _array_names(path: Path) -> set[str]:
    """Return the names of the arrays in an HDF5 file; empty if it is damaged."""
    with suppress(Exception):  # h5py raises many types of errors for damaged files.
        return set(read_arrays(path))
    return set()
