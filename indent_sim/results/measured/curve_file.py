"""Reader of measured curves, which selects the reader for the format of a file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from indent_sim.process.errors import UsageError
from indent_sim.process.regular_files import open_regular_file
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.measured import afm_file, nanoscope_file
from indent_sim.results.measured.delimited_text import read_text_curve
from indent_sim.results.measured.measurement import SI, MeasuredCurve

TAB_METADATA = re.compile(r"# BEGIN METADATA\n(.*?)# END METADATA", re.DOTALL)


TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".tab", ".asc")


def curve_files(path: Path) -> list[Path]:
    """Return the file itself, or the files of a folder that may contain curves, sorted by name.

    Raises UsageError if there is no such file.
    """
    if not path.is_dir():
        if not path.exists():
            raise UsageError(f"there is no file {path}", file=str(path))
        return [path]
    suffixes = (*TEXT_SUFFIXES, *afm_file.SUFFIXES, *nanoscope_file.SUFFIXES)
    files = [
        file
        for file in sorted(path.iterdir())
        if file.suffix.lower() in suffixes or nanoscope_file.is_numbered_file(file)
    ]
    if not files:
        raise UsageError(
            f"the folder {path} contains no curve file",
            f"names of curve files end in {', '.join(TEXT_SUFFIXES)} or are those of AFM files",
            str(path),
        )
    return files


def read_curves(
    path: Path | str,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
    stiffness: float | None = None,
) -> Sequence[MeasuredCurve]:
    """Read the measured curves of a file, in the units that it gives.

    Those of a map are read one by one, when they are asked for.

    Parameters
    ----------
    path
        The file.
    columns
        Titles or numbers (from 1) of the columns of depth, force and time in a text file.
    given
        Units by kind, "length" and "force", for a text file without units.
    stiffness
        Spring constant of the cantilever [N/m], for an AFM file that contains none.

    Raises
    ------
    NoCurve
        If the file contains no curve; the message gives the reason. The sequence of a map raises it
        for a curve that is damaged.
    ConfigError
        A column of `columns` does not exist.
    UsageError
        The file cannot be read.
    BackendError
        The package that reads this format is missing.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    # The text that NanoScope exports begins with the same header.
    if suffix not in (*TEXT_SUFFIXES, *afm_file.SUFFIXES):
        _refuse_unreadable(path)
        if suffix in nanoscope_file.SUFFIXES or nanoscope_file.is_nanoscope_file(path):
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
    """Raise UsageError for a file that cannot be opened, before another package fails on it."""
    try:
        open_regular_file(path).close()
    except (OSError, ValueError) as error:
        raise _read_error(path, error) from None


def _read_content(path: Path) -> bytes:
    """Return the bytes of a file; raise UsageError if it cannot be read."""
    try:
        return read_regular_file(path)
    except (OSError, ValueError) as error:
        raise _read_error(path, error) from None


def _read_error(path: Path, error: Exception) -> UsageError:
    """Return the error for a file that cannot be read."""
    return UsageError(
        f"cannot read {path}: {getattr(error, 'strerror', None) or error}", file=str(path)
    )


def _spring_constant(metadata: str) -> float | None:
    """Return the spring constant [N/m] in the metadata of a .tab file, or None."""
    try:
        value = float(
            json.loads("\n".join(line.lstrip("#") for line in metadata.splitlines()))[
                "spring constant"
            ]
        )
    except (ValueError, KeyError, TypeError):
        return None
    return value if 0 < value < 1e30 else None
