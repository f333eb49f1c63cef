"""Reader of AFM files of JPK and, by the optional package afmformats, of other makers.

The other makers are Asylum and AFM workshop.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import BackendError
from indent_sim.process.installation import afm_command
from indent_sim.results.measured import jpk_file
from indent_sim.results.measured.measurement import (
    SI,
    STIFFNESS_KEY,
    MeasuredCurve,
    NoCurve,
    Uncalibrated,
)

SUFFIXES = (*jpk_file.SUFFIXES, ".ibw", ".h5", ".zip")


def read_afm_file(path: Path, stiffness: float | None = None) -> Sequence[MeasuredCurve]:
    """Read the curves of an AFM file, in SI units.

    Parameters
    ----------
    path
        The file.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Returns
    -------
    sequence of MeasuredCurve
        The curves; those of a map of JPK are read one by one.

    Raises
    ------
    NoCurve
        If the file cannot be read, or lacks data needed for forces; the message gives the reason.
    BackendError
        If the package that reads this format is missing.
    """
    if path.suffix.lower() in jpk_file.SUFFIXES:
        return jpk_file.read_jpk_file(path, stiffness)
    try:
        from afmformats import errors, formats
    except ImportError as error:
        raise BackendError(
            f"{path} is an AFM file, and afmformats is missing ({error}); this line installs it: "
            f"{afm_command()}"
        ) from error
    # afmformats logs whole tracebacks at lower levels.
    logging.getLogger("afmformats").setLevel(logging.CRITICAL)
    # These errors derive from BaseException, not from Exception.
    broken = (errors.AFMFileFormatError, errors.MissingMetaDataError)
    try:
        formats.get_recipe(path)
    except (*broken, Exception) as error:
        raise NoCurve(f"afmformats cannot read it ({_error_text(error)})", str(path)) from None
    try:
        return [
            _measured_curve(path, data, k)
            for k, data in enumerate(_load_data_sets(formats, errors, path, stiffness))
        ]
    except errors.MissingMetaDataError as error:
        missing = ", ".join(sorted(error.meta_keys, reverse=True))
        raise Uncalibrated(f"lacks {missing}: {STIFFNESS_KEY}", str(path)) from None
    except NoCurve:
        raise
    except (*broken, Exception) as error:
        raise NoCurve(f"afmformats cannot read it ({_error_text(error)})", str(path)) from None


def _load_data_sets(formats: Any, errors: Any, path: Path, stiffness: float | None) -> list[Any]:
    """Return the data sets of a file; the given stiffness is used if the file has none."""
    try:
        data_sets = formats.load_data(path)
        for data in data_sets:
            # Columns are computed on access: a missing spring constant is reported only here.
            _ = "force" in data.columns and data["force"][:1]
        return list(data_sets)
    except errors.MissingMetaDataError:
        if stiffness is None:
            raise
        return list(formats.load_data(path, meta_override={"spring constant": stiffness}))


def _measured_curve(path: Path, data: Any, index: int) -> MeasuredCurve:
    """Return a data set as a curve: its rows ordered approach, hold, retract."""
    columns = set(data.columns)
    height_columns = ("height (measured)", "height (piezo)")
    height = next((name for name in height_columns if name in columns), None)
    if "force" not in columns or height is None:
        raise NoCurve(
            f"{path.name} has no {'force' if height else 'height'}, only "
            f"{', '.join(sorted(columns))}"
        )
    rows = _segment_rows(data)
    order = np.concatenate([np.arange(len(data[height]))[where] for where in rows.values()])
    ends = np.cumsum([0, *(np.count_nonzero(where) for where in rows.values())]).tolist()
    parts = {name: slice(*ends[k : k + 2]) for k, name in enumerate(rows)}
    t = np.asarray(data["time"], dtype=float)[order] if "time" in columns else None
    name = f"{path.stem}-{index}"
    k = data.metadata.get("spring constant", None)
    stiffness = float(k) if k is not None and np.isfinite(k) and k > 0 else None
    z, force = (np.asarray(data[column], dtype=float)[order] for column in (height, "force"))
    tip_column = "tip position"
    delta = -np.asarray(data[tip_column], dtype=float)[order] if tip_column in columns else None
    is_complete = np.isfinite(z) & np.isfinite(force)
    if not is_complete.all():
        raise NoCurve(f"{np.count_nonzero(~is_complete)} of {len(is_complete)} rows lack a number")
    return MeasuredCurve(name, force, delta, -z, t, stiffness, parts, SI)


def _segment_rows(data: Any) -> dict[str, np.ndarray]:
    """Return a mask of the rows of each part of a curve.

    The numbers of the segments depend on the kind of the measurement.
    """
    segment = np.asarray(data["segment"]).astype(int)
    known_segments = {
        "force-distance": {0: "approach", 1: "retract"},
        "creep-compliance": {0: "approach", 1: "hold", 2: "retract"},
    }
    # Segment 0 of a stress relaxation measurement is a pause before the approach.
    relaxation_segments = {1: "approach", 2: "hold", 3: "retract"}
    segment_names = known_segments.get(data.modality, relaxation_segments)
    rows_by_part = {word: segment == number for number, word in segment_names.items()}
    return {word: where for word, where in rows_by_part.items() if where.any()}


def _error_text(error: BaseException) -> str:
    """Return an error of another package in one line of at most 200 characters."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]
