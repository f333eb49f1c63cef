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
from indent_sim.results.folder import content
from indent_sim.results.measured import afm_file, nanoscope_file
from indent_sim.results.measured.delimited_text import read_text
from indent_sim.results.measured.measurement import SI, Measured

METADATA = re.compile(r"# BEGIN METADATA\n(.*?)# END METADATA", re.DOTALL)  # of a .tab file
TEXT = (".csv", ".txt", ".tsv", ".dat", ".tab", ".asc")


def curve_files(path: Path) -> list[Path]:
    """The file itself, or the files of a folder that may hold curves, by name; UsageError where
    there is none.
    """
    if not path.is_dir():
        if not path.exists():
            raise UsageError(f"there is no curve {path}", file=str(path))
        return [path]
    found = [
        one
        for one in sorted(path.iterdir())
        if one.suffix.lower() in (*TEXT, *afm_file.SUFFIXES, *nanoscope_file.SUFFIXES)
    ]
    if not found:
        raise UsageError(
            f"{path} holds no file of curves", f"they end in {', '.join(TEXT)}", str(path)
        )
    return found


def read_measured(
    path: Path | str,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
    stiffness: float | None = None,
) -> list[Measured]:
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
        return nanoscope_file.read_nanoscope(path, stiffness)
    if suffix in (*afm_file.SUFFIXES, *afm_file.MAYBE) and not columns:
        _refuse_unreadable(path)
        found = afm_file.read_afm(path, stiffness)
        if found is not None:
            return found
    data = _content(path)
    if match := METADATA.search(data[:100_000].decode("latin-1").replace("\r", "")):
        curve = read_text(path, data, columns, SI | dict(given or {}))
        return [replace(curve, stiffness=_stiffness(match[1]))]
    return [read_text(path, data, columns, given)]


def _refuse_unreadable(path: Path) -> None:
    """UsageError for what is no file that can be opened: other packages' own words would stand for
    that.
    """
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError(errno.EINVAL, "not a regular file")
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


def _content(path: Path) -> bytes:
    try:
        return content(path)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> UsageError:
    return UsageError(
        f"cannot read {path}: {getattr(error, 'strerror', None) or error}", file=str(path)
    )


def _stiffness(metadata: str) -> float | None:
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
