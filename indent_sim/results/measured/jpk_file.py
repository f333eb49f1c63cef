"""Reader of JPK files: zip archives of properties and binary channels, with one or many curves."""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.results.measured.measured_map import MeasuredMap, grid_places
from indent_sim.results.measured.measurement import (
    PART_WORDS,
    SI,
    STIFFNESS_KEY,
    MeasuredCurve,
    NoCurve,
    Uncalibrated,
)

SUFFIXES = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series")
# Channels of the measured height, the newest first. Other channels of heights contain the set value
# of the piezo.
MEASURED_HEIGHTS = ("measuredHeight", "capacitiveSensorHeight", "strainGaugeHeight")
PIEZO_HEIGHTS = ("height", "head-height")
DEFLECTION = "vDeflection"
ENCODINGS = {
    "signedshort": ">i2",
    "unsignedshort": ">u2",
    "signedinteger": ">i4",
    "unsignedinteger": ">u4",
    "signedlong": ">i8",
}
HEADER = "header.properties"
SHARED_DATA = "shared-data/header.properties"
FIRST_SEGMENT = re.compile(r"(?:index/(\d{1,9})/)?segments/0/segment-header\.properties", re.ASCII)
# Limits of the size of files of properties, of the points of a curve, and of other counts; a file
# beyond them counts as damaged.
MAX_PROPERTY_BYTES = 2_000_000
MAX_HEADER_BYTES = 10_000_000
MAX_POINTS = 10_000_000
MAX_SEGMENTS = 1000
MAX_PLACES = 10_000_000
MAX_CONVERSIONS = 20
# Exceptions of zipfile for archives that are damaged, encrypted or malicious.
ARCHIVE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    KeyError,
    OverflowError,
)
Properties = Mapping[str, str]


def read_jpk_file(path: Path, stiffness: float | None = None) -> Sequence[MeasuredCurve]:
    """Return the curves of a JPK file in SI units; those of a map are read one by one.

    Parameters
    ----------
    path
        The file.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Raises
    ------
    NoCurve
        If the file or its only curve cannot be read. For a map, the returned sequence raises
        NoCurve when a damaged curve is read.
    Uncalibrated
        If the first curve has no force.
    """
    file = JpkFile(path, stiffness)
    return file.measured_map() if file.numbers else [file.curve(0)]


@dataclass(frozen=True)
class _Segment:
    """Header of a segment: its folder, part of the curve, points, duration [s], properties."""

    folder: str
    part: str
    points: int
    duration: float
    properties: Properties


class JpkFile:
    """Curves of a JPK file, each of which is read when it is requested.

    Parameters
    ----------
    path
        The file.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Raises
    ------
    NoCurve
        If the file is not a zip archive or contains no curve.
    """

    def __init__(self, path: Path, stiffness: float | None = None):
        self.path = path
        self._given_stiffness = stiffness
        try:
            self._archive = zipfile.ZipFile(path)
        except ARCHIVE_ERRORS as error:
            raise self._no_curve(f"not a zip archive, as JPK files are ({error})") from None
        matches = [found for name in self._archive.namelist() if (found := _first_segment(name))]
        self.numbers = sorted(int(found[1]) for found in matches if found[1])
        if not matches:
            raise self._no_curve("a zip archive without a segment of a JPK curve")
        self._shared: dict[str, dict[str, str]] = {}
        if SHARED_DATA in self._archive.NameToInfo:
            for key, value in self.properties(SHARED_DATA).items():
                kind, _, rest = key.partition(".")
                number, _, name = rest.partition(".")
                self._shared.setdefault(f"{kind}.{number}", {})[name] = value

    def __reduce__(self) -> tuple[type[JpkFile], tuple[Path, float | None]]:
        """Pickle the path only: a process that receives the map opens the file itself."""
        return JpkFile, (self.path, self._given_stiffness)

    def __len__(self) -> int:
        return len(self.numbers) or 1

    def curve(self, index: int) -> MeasuredCurve:
        """Return a curve in SI units, from the beginning of its approach on.

        A segment of the style extend, pause or retract becomes the part approach, hold or retract
        of the curve; a segment with modulation becomes the part "modulation".

        Raises
        ------
        NoCurve
            If the curve is damaged or has no approach; the message gives the reason.
        Uncalibrated
            If the curve has no force.
        """
        segments = list(self._segments(f"index/{self.numbers[index]}/" if self.numbers else ""))
        styles = [segment.part for segment in segments]
        if "approach" not in styles:
            raise self._no_curve(f"no segment is an approach, only {', '.join(styles) or 'none'}")
        # A pause before the approach is not a part of the curve, but its duration counts.
        first = styles.index("approach")
        begin = sum(segment.duration for segment in segments[:first])
        segments = [segment for segment in segments[first:] if segment.points]
        heights: list[np.ndarray] = []
        forces: list[np.ndarray] = []
        times: list[np.ndarray] = []
        parts: dict[str, slice] = {}
        row = 0
        stiffness = None
        for segment in segments:
            heights.append(self._height(segment))
            force, stiffness = self._force(segment)
            forces.append(force)
            end = begin + segment.duration
            times.append(np.linspace(begin, end, segment.points, endpoint=False))
            begin = end
            rows = slice(row, row + segment.points)
            row = rows.stop
            # A pause after the retraction is not a hold.
            if segment.part == "hold" and "retract" in parts:
                continue
            earlier = parts.setdefault(segment.part, rows)
            if earlier.stop == rows.start:
                parts[segment.part] = slice(earlier.start, rows.stop)
        z = -np.concatenate([np.empty(0), *heights])
        force = np.concatenate([np.empty(0), *forces])
        is_complete = np.isfinite(z) & np.isfinite(force)
        if not is_complete.all():
            missing = np.count_nonzero(~is_complete)
            raise self._no_curve(f"{missing} of {len(is_complete)} rows lack a number")
        has_number = len(self) > 1 or self.path.suffix.lower() != SUFFIXES[0]
        name = f"{self.path.stem}-{index}" if has_number else self.path.stem
        is_timed = all(segment.duration > 0 for segment in segments)
        t = np.concatenate([np.empty(0), *times]) if is_timed else None
        return MeasuredCurve(name, force, z=z, t=t, stiffness=stiffness, parts=parts, units=SI)

    def measured_map(self) -> MeasuredMap:
        """Return the curves as a map; without a grid in the file they are one row.

        Raises Uncalibrated if the first curve has no force.
        """
        try:
            stiffness = self.curve(0).stiffness
        except Uncalibrated:
            raise
        except NoCurve:
            stiffness = self._given_stiffness
        numbers = np.array(self.numbers or [0])
        pattern = self._position_pattern()
        columns, rows = (_count(pattern.get(f"grid.{word}length", "")) or 0 for word in "ij")
        if numbers[-1] < rows * columns <= MAX_PLACES:
            shape = (rows, columns)
            places = grid_places(numbers, columns, pattern.get("back-and-forth") == "true")
            lengths = tuple(_finite(pattern.get(f"grid.{word}length", "")) or 0.0 for word in "vu")
        else:
            shape = (1, len(numbers))
            places = grid_places(np.arange(len(numbers)), len(numbers), False)
            lengths = ()
        is_sized = len(lengths) == 2 and min(lengths) > 0 and pattern.get("grid.unit.unit") == "m"
        size = (lengths[0], lengths[1]) if is_sized else None
        return MeasuredMap(shape, size, places, self.curve, stiffness=stiffness)

    def _position_pattern(self) -> dict[str, str]:
        """Return the properties of the grid of a map; empty if the file has no grid."""
        if HEADER not in self._archive.NameToInfo:
            return {}
        try:
            header = self.properties(HEADER)
        except NoCurve:
            return {}
        found = (key.partition(".position-pattern.") for key in header)
        return {name: header[f"{head}{dot}{name}"] for head, dot, name in found if name}

    def properties(self, name: str) -> dict[str, str]:
        """Return the properties in a member of the archive; raise NoCurve if it is missing."""
        data = self._read(name, MAX_PROPERTY_BYTES)
        lines = (line.strip() for line in data.decode("latin-1").split("\n"))
        pairs = (line.partition("=") for line in lines if line and line[0] not in "#!")
        return {key.strip(): value.strip() for key, _, value in pairs}

    def _segments(self, folder: str) -> Iterator[_Segment]:
        """Yield the headers of the segments of a curve, in the order of time."""
        points = 0
        size = 0
        for number in range(MAX_SEGMENTS):
            place = f"{folder}segments/{number}/"
            member = self._archive.NameToInfo.get(f"{place}segment-header.properties")
            if member is None:
                return
            size += member.file_size
            if size > MAX_HEADER_BYTES:
                raise self._no_curve(f"more than {MAX_HEADER_BYTES} bytes of headers of segments")
            own = self.properties(member.filename)
            header = self._resolved(own, "force-segment-header", "force-segment-header-info")
            style = header.get("settings.style") or header.get("settings.segment-settings.style")
            count = _count(header.get("num-points", ""))
            if not style or count is None:
                lacking = "number of points" if style else "style"
                raise self._no_curve(f"{place} has no {lacking}")
            points += count
            if points > MAX_POINTS:
                raise self._no_curve(f"more than {MAX_POINTS} points")
            duration = _finite(header.get("duration", "")) or 0.0
            part = PART_WORDS.get(style, style)
            yield _Segment(place, part, count, max(duration, 0.0), own)
        raise self._no_curve(f"more than {MAX_SEGMENTS} segments")

    def _resolved(self, own: Properties, head: str, kind: str) -> dict[str, str]:
        """Return the properties below `head`, including the shared data to which it refers."""
        names = {
            key[len(head) + 1 :]: value for key, value in own.items() if key.startswith(f"{head}.")
        }
        return names | self._shared.get(f"{kind}.{names.get(f'{kind}.*')}", {})

    def _channel(self, segment: _Segment, name: str) -> dict[str, str]:
        """Return the properties of a channel; empty if the segment has no such channel."""
        return self._resolved(segment.properties, f"channel.{name}", "lcd-info")

    def _height(self, segment: _Segment) -> np.ndarray:
        """Return the height of the base (n,) [m], measured if the file has it."""
        for name in (*MEASURED_HEIGHTS, *PIEZO_HEIGHTS):
            channel = self._channel(segment, name)
            if channel:
                slot = channel.get("conversion-set.conversions.default", "")
                return self._values(segment, name, channel, slot, "m")
        raise self._no_curve(f"{segment.folder} has no height")

    def _force(self, segment: _Segment) -> tuple[np.ndarray, float | None]:
        """Return forces (n,) [N] and the spring constant [N/m]."""
        channel = self._channel(segment, DEFLECTION)
        if not channel:
            raise self._no_curve(f"{segment.folder} has no {DEFLECTION}")
        sensitivity = _multiplier(channel, "distance")
        stiffness = _multiplier(channel, "force")
        if stiffness is not None and sensitivity is not None:
            return self._values(segment, DEFLECTION, channel, "force", "N"), stiffness
        if sensitivity is not None and self._given_stiffness is not None:
            deflection = self._values(segment, DEFLECTION, channel, "distance", "m")
            return self._given_stiffness * deflection, self._given_stiffness
        lacking = {
            "spring constant": stiffness or self._given_stiffness,
            "sensitivity": sensitivity,
        }
        names = ", ".join(name for name, value in lacking.items() if value is None)
        raise Uncalibrated(f"lacks {names}: {STIFFNESS_KEY}", str(self.path))

    def _values(
        self, segment: _Segment, name: str, channel: Properties, slot: str, unit: str
    ) -> np.ndarray:
        """Return the numbers of a channel (n,), converted by a slot that must have this unit.

        A slot is one of the conversions that the file defines for the channel.
        """
        encoder = "encoder." if "encoder.type" in channel else "data.encoder."
        encoding = channel.get(f"{encoder}type", "")
        if encoding not in ENCODINGS:
            raise self._no_curve(f"{name} has the unknown encoding '{encoding}'")
        base = channel.get("conversion-set.conversions.base", "")
        scalings: list[str] = []
        while slot != base:
            scalings.insert(0, f"conversion-set.conversion.{slot}.scaling.")
            slot = channel.get(f"conversion-set.conversion.{slot}.base-calibration-slot", base)
            if len(scalings) > MAX_CONVERSIONS:
                raise self._no_curve(f"the conversions of {name} refer to each other in a circle")
        scalings.insert(0, f"{encoder}scaling.")
        last_unit = channel.get(f"{scalings[-1]}unit.unit", channel.get(f"{scalings[-1]}unit", ""))
        if last_unit != unit:
            raise self._no_curve(f"{name} is in '{last_unit}' instead of {unit}")
        words = np.dtype(ENCODINGS[encoding])
        file = segment.folder + channel.get("data.file.name", f"channels/{name}.dat")
        data = self._read(file, segment.points * words.itemsize)
        if len(data) != segment.points * words.itemsize:
            count = len(data) // words.itemsize
            raise self._no_curve(f"{file} has {count} points instead of {segment.points}")
        values = np.frombuffer(data, words).astype(float)
        for scaling in scalings:
            factor = _finite(channel.get(f"{scaling}multiplier", ""))
            offset = _finite(channel.get(f"{scaling}offset", ""))
            if factor is None or offset is None:
                raise self._no_curve(f"{name} has no linear {scaling.rstrip('.')}")
            # The caller counts the rows that are not finite.
            with np.errstate(all="ignore"):
                values *= factor
                values += offset
        return values

    def _read(self, name: str, max_bytes: int) -> bytes:
        """Return the content of a member of the archive of at most `max_bytes` bytes."""
        try:
            member = self._archive.getinfo(name)
            if member.file_size > max_bytes:
                raise self._no_curve(f"{name} has {member.file_size} bytes, not {max_bytes}")
            # Only these methods can be unpacked with a limit of the size.
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise self._no_curve(f"{name} is compressed by an unknown method")
            with self._archive.open(member) as file:
                return file.read(member.file_size)
        except ARCHIVE_ERRORS as error:
            reason = "is missing" if isinstance(error, KeyError) else f"is damaged ({error})"
            raise self._no_curve(f"{name} {reason}") from None

    def _no_curve(self, why: str) -> NoCurve:
        """Return a NoCurve error that names this file."""
        return NoCurve(why, str(self.path))


def _first_segment(name: str) -> re.Match[str] | None:
    """Return the match of a member's name if it is the header of a curve's first segment.

    The result is None for every other member.
    """
    return FIRST_SEGMENT.fullmatch(name) if name.endswith("t-header.properties") else None


def _count(text: str) -> int | None:
    """Return the number in a text of at most nine digits; None for any other text."""
    return int(text) if re.fullmatch(r"\d{1,9}", text, re.ASCII) else None


def _finite(text: str) -> float | None:
    """Return the number in a text; None if the text is not a finite number."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _multiplier(channel: Properties, slot: str) -> float | None:
    """Return the factor of a conversion, None if it is not defined."""
    return _finite(channel.get(f"conversion-set.conversion.{slot}.scaling.multiplier", "")) or None
