"""AFM file -> measured curves, by the optional package afmformats: JPK, Asylum, NT-MDT, Optics11,
AFM workshop.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import BackendError
from indent_sim.results.measured.measurement import (
    INSTALL,
    SI,
    STIFFNESS_KEY,
    Measured,
    NoCurve,
    Uncalibrated,
)

SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series", ".ibw", ".h5", ".zip")
MAYBE = (".txt", ".csv", ".tab")  # text that may be an AFM's
HEIGHT_COLUMNS = ("height (measured)", "height (piezo)")
TIP_COLUMN = "tip position"
OF_RELAXATION = {1: "approach", 2: "hold", 3: "retract"}  # 0: a pause before it


def read_afm(path: Path, stiffness: float | None = None) -> list[Measured] | None:
    """The curves of an AFM file in SI units; None for text that is no AFM's.

    stiffness [N/m] of the cantilever, for a file that says none. NoCurve with the reason for a file
    that cannot be read, or that lacks what forces need; BackendError where the package is missing.
    """
    try:
        from afmformats import errors, formats
    except ImportError as error:
        if path.suffix.lower() in MAYBE:
            return None
        raise BackendError(
            f"{path} is an AFM file, and afmformats is missing ({error}); {INSTALL}"
        ) from error
    logging.getLogger("afmformats").setLevel(logging.CRITICAL)  # it logs whole tracebacks
    broken = (errors.AFMFileFormatError, errors.MissingMetaDataError)  # which are no Exception
    try:
        formats.get_recipe(path)
    except (*broken, Exception) as error:
        if path.suffix.lower() in MAYBE:
            return None
        raise NoCurve(f"no file that afmformats knows ({_words(error)})", str(path)) from None
    try:
        return [
            _curve(path, data, k) for k, data in enumerate(_data(formats, errors, path, stiffness))
        ]
    except errors.MissingMetaDataError as error:
        missing = ", ".join(sorted(error.meta_keys, reverse=True))
        raise Uncalibrated(f"lacks {missing}: {STIFFNESS_KEY}", str(path)) from None
    except NoCurve:
        raise
    except (*broken, Exception) as error:
        if path.suffix.lower() in MAYBE:
            return None
        raise NoCurve(f"afmformats cannot read it ({_words(error)})", str(path)) from None


def _data(formats: Any, errors: Any, path: Path, stiffness: float | None) -> list[Any]:
    """The data sets of a file, with the stiffness given where the file lacks it."""
    try:
        found = formats.load_data(path)
        for data in found:
            _ = "force" in data.columns and data["force"][:1]  # where it would miss them
        return list(found)
    except errors.MissingMetaDataError:
        if stiffness is None:
            raise
        return list(formats.load_data(path, meta_override={"spring constant": stiffness}))


def _curve(path: Path, data: Any, index: int) -> Measured:
    columns = set(data.columns)
    height = next((name for name in HEIGHT_COLUMNS if name in columns), None)
    if "force" not in columns or height is None:
        raise NoCurve(
            f"{path.name} has no {'force' if height else 'height'}, only "
            f"{', '.join(sorted(columns))}"
        )
    rows = _rows(data)
    order = np.concatenate([np.arange(len(data[height]))[where] for where in rows.values()])
    ends = np.cumsum([0, *(np.count_nonzero(where) for where in rows.values())]).tolist()
    parts = {name: slice(*ends[k : k + 2]) for k, name in enumerate(rows)}
    t = np.asarray(data["time"], dtype=float)[order] if "time" in columns else None
    name = f"{path.stem}-{index}" if index or path.suffix != ".jpk-force" else path.stem
    k = data.metadata.get("spring constant", None)
    stiffness = float(k) if k is not None and np.isfinite(k) and k > 0 else None
    z, force = (np.asarray(data[column], dtype=float)[order] for column in (height, "force"))
    delta = -np.asarray(data[TIP_COLUMN], dtype=float)[order] if TIP_COLUMN in columns else None
    known = np.isfinite(z) & np.isfinite(force)
    if not known.all():
        raise NoCurve(f"{np.count_nonzero(~known)} of {len(known)} rows lack a number")
    return Measured(name, force, delta, -z, t, stiffness, parts, SI)


def _rows(data: Any) -> dict[str, np.ndarray]:
    """The rows of each part: force-distance files have approach and retract, others number what
    they did.
    """
    segment = np.asarray(data["segment"]).astype(int)
    words = OF_RELAXATION if data.modality != "force-distance" else {0: "approach", 1: "retract"}
    found = {word: segment == number for number, word in words.items()}
    return {word: where for word, where in found.items() if where.any()}


def _words(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]
