"""A file or a folder of measured curves -> curves, by whichever reader knows the file."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.measured import afm_file, nanoscope_file
from indent_sim.results.measured.delimited_text import read_text_curve
from indent_sim.results.measured.measurement import SI, MeasuredCurve

TAB_METADATA = re.compile(r"# BEGIN METADATA\n(.*?)# END METADATA", re.DOTALL)  # of a .tab file
TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".tab", ".asc")


def curve_files(path: Path) -> list[Path]:
    """The file itself, or the files of a folder that may hold curves, by name; UsageError where
    there is none.
    """
    if not path.is_dir():
        if not path.exists():
            raise UsageError(f"there is no curve {path}", file=str(path))
        return [path]
    files = [
        file
        for file in sorted(path.iterdir())
        if file.suffix.lower() in (*TEXT_SUFFIXES, *afm_file.SUFFIXES, *nanoscope_file.SUFFIXES)
    ]
    if not files:
        raise UsageError(
            f"{path} holds no file of curves", f"they end in {', '.join(TEXT_SUFFIXES)}", str(path)
        )
    return files


def read_curves(
    path: Path | str,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
    stiffness: float | None = None,
) -> list[MeasuredCurve]:
    """The measured curves of a file, in the units that it says, `given` for those that it does not.

    columns: depth, force and time by title or by number from 1, for text. stiffness [N/m] of the
    cantilever, for AFM files that lack it. NoCurve with the reason for what is no curve;
    ConfigError for a column that is not there; UsageError for a file that cannot be read;
    BackendError for an AFM file without the package that reads it.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in nanoscope_file.SUFFIXES:
        _refuse_unreadable(path)
        return nanoscope_file.read_nanoscope_file(path, stiffness)
    if suffix in (*afm_file.SUFFIXES, *afm_file.TEXT_SUFFIXES) and not columns:
        _refuse_unreadable(path)
        curves = afm_file.read_afm_file(path, stiffness)
        if curves is not None:
            return curves
    data = _read_content(path)
    if match := TAB_METADATA.search(data[:100_000].decode("latin-1").replace("\r", "")):
        curve = read_text_curve(path, data, columns, SI | dict(given or {}))
        return [replace(curve, stiffness=_spring_constant(match[1]))]
    return [read_text_curve(path, data, columns, given)]


def _refuse_unreadable(path: Path) -> None:
    """UsageError for what is no file that can be opened: other packages' own words would stand for
    that.
    """
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError(errno.EINVAL, "not a regular file")
    except (OSError, ValueError) as error:
        raise _read_error(path, error) from None


def _read_content(path: Path) -> bytes:
    try:
        return read_regular_file(path)
    except (OSError, ValueError) as error:
        raise _read_error(path, error) from None


def _read_error(path: Path, error: Exception) -> UsageError:
    return UsageError(
        f"cannot read {path}: {getattr(error, 'strerror', None) or error}", file=str(path)
    )


def _spring_constant(metadata: str) -> float | None:
    """The spring constant [N/m] of a .tab file's metadata."""
    try:
        value = float(
            json.loads("\n".join(line.lstrip("#") for line in metadata.splitlines()))[
                "spring constant"
            ]
        )
    except (ValueError, KeyError, TypeError):
        return None
    return value if 0 < value < 1e30 else None
