"""Reader of measured curves, which selects the reader for the format of a file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from indent_sim.process.errors import UsageError
from indent_sim.process.regular_files import open_regular_file
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.measured import afm_file, nanoscope_file
from indent_sim.results.measured.measurement import SI, MeasuredCurve
from indent_sim.results.measured.text_curve import read_text_curves

TAB_METADATA = re.compile(rb"# BEGIN METADATA\s.*?# END METADATA", re.DOTALL)
# Line of a .tab file with titles and the first row of numbers behind them, as afmformats writes it.
GLUED_TITLES = re.compile(rb"(# END METADATA\s+#\s+# (?:[^\t\r\n]*\t)*?[a-z() ]*[a-z)])(?=-?\d)")

MAX_METADATA_BYTES = 100_000
TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".tab", ".asc", ".itx")


def curve_files(path: Path) -> list[Path]:
    """Return the given file, or the files of a folder that may contain curves, sorted by name.

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
        if file.suffix.lower() in suffixes or _is_nanoscope_file(file)
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
    sensitivity: str | None = None,
) -> Sequence[MeasuredCurve]:
    """Read the measured curves of a file, in the units that it gives.

    The curves of a map are read one by one, when they are requested.

    Parameters
    ----------
    path
        The file.
    columns
        Columns of a text file: ROLE=COLUMN, or titles or numbers (from 1) of the columns of depth,
        force and time.
    given
        Units by kind, "length", "force", "time" and "deflection", for a text file without units.
    stiffness
        Spring constant of the cantilever [N/m], for an AFM file that contains none, and for the
        deflections in a text file.
    sensitivity
        Length per voltage such as 50 nm/V, for the deflections in a text file.

    Raises
    ------
    NoCurve
        If the file contains no curve; the message gives the reason. For a map, the returned
        sequence raises NoCurve when a damaged curve is read.
    ConfigError
        A column of `columns` does not exist.
    UsageError
        The file cannot be read.
    BackendError
        The package that reads this format is missing.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    _refuse_unreadable(path)
    if suffix in nanoscope_file.SUFFIXES or nanoscope_file.is_nanoscope_file(path):
        return nanoscope_file.read_nanoscope_file(path, stiffness)
    if suffix in afm_file.SUFFIXES:
        return afm_file.read_afm_file(path, stiffness)
    data = _read_content(path)
    if TAB_METADATA.search(data, 0, MAX_METADATA_BYTES):
        given = SI | dict(given or {})
        data = GLUED_TITLES.sub(rb"\1\n", data[:MAX_METADATA_BYTES]) + data[MAX_METADATA_BYTES:]
    return read_text_curves(path, data, columns, given, stiffness, sensitivity)


def _is_nanoscope_file(file: Path) -> bool:
    """Return whether an entry of a folder is a file of NanoScope, by its content."""
    try:
        return file.is_file() and nanoscope_file.is_nanoscope_file(file)
    except OSError:
        return False


def _refuse_unreadable(path: Path) -> None:
    """Raise UsageError for a file that cannot be opened, before another package reads it."""
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
