"""Reader of NanoScope files of Bruker: force curves, and force volumes as maps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from indent_sim.results.measured.measured_map import MeasuredMap, grid_places
from indent_sim.results.measured.measurement import (
    SI,
    STIFFNESS_KEY,
    MeasuredCurve,
    NoCurve,
    Uncalibrated,
)
from indent_sim.results.measured.peakforce_file import read_peakforce_file

# Usual suffixes of NanoScope files, which may also have others, such as .000.
SUFFIXES = (".spm", ".pfc")
BEGINNINGS = (b"\\*File list", b"\\*Force file list")
END = re.compile(rb"\\\*(?:Force f|F)ile list end")
SCAN, FORCE, FORCE_IMAGE, IMAGE = (
    "ciao scan list",
    "ciao force list",
    "ciao force image list",
    "ciao image list",
)
MAX_HEADER_BYTES = 4_000_000
NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"
# Value of a quantity in the header, such as V [Sens. DeflSens] (0.0003750000 V/LSB) 1.200000 V.
QUANTITY = re.compile(
    rf"V\s*(?:\[(?P<sensitivity>[^\]]*)\])?\s*(?:\((?P<step>{NUMBER}) V/LSB\))?"
    rf"\s*(?P<value>{NUMBER})\s*(?P<unit>\S*)\s*"
)
LENGTH_UNITS = {"nm": 1e-9, "~m": 1e-6, "um": 1e-6, "µm": 1e-6}
# Stored integers of 32 bits count steps of V/LSB multiplied by one of these factors. The header
# does not say by which.
STEP_FACTORS = (1.0, 1 / 256, 1 / 65536)
Section = dict[str, str]


def is_nanoscope_file(path: Path) -> bool:
    """Return whether a file is a binary NanoScope file, and not a text exported from one.

    Raises OSError if it cannot be read.
    """
    with path.open("rb") as file:
        if not file.read(max(map(len, BEGINNINGS))).startswith(BEGINNINGS):
            return False
        file.seek(0)
        # The header of a binary file ends with CTRL-Z and is filled with zeros, or is cut off.
        data = file.read(MAX_HEADER_BYTES)
    end = END.search(data)
    after = data[end.end() :].lstrip(b"\r\n") if end else b""
    return not after or after[:1] == b"\x1a" or b"\0" in after


def read_nanoscope_file(path: Path, stiffness: float | None = None) -> Sequence[MeasuredCurve]:
    """Return the curves of a NanoScope file in SI units; those of a volume are read one by one.

    Parameters
    ----------
    path
        The file.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Raises
    ------
    NoCurve
        If the file cannot be read or its deflections are impossible; the message gives the reason.
        For a volume, the returned sequence raises NoCurve when a damaged curve is read.
    BackendError
        If the file is a PeakForce capture, and the package that reads it is missing.
    """
    sections = _read_header(path)
    if _first(sections, SCAN).get("peakforce capture", "").lower() == "allow":
        return read_peakforce_file(path, stiffness)
    file = NanoscopeFile(path, sections, stiffness)
    return file.measured_map() if file.is_volume else [file.curve(0)]


class NanoscopeFile:
    """Curves of a NanoScope file, each of which is read when it is requested.

    The entry Deflection Sensitivity Correction of the header is the factor by which the sensitivity
    was multiplied when the spring constant was determined from thermal noise. The spring constant
    includes this factor. Deflections and forces do not, as in the exports of NanoScope Analysis.

    Parameters
    ----------
    path
        The file.
    sections
        Sections of its header, each with its title.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Raises
    ------
    NoCurve
        If the file has no deflections, or their scale is unknown.
    """

    def __init__(
        self, path: Path, sections: Sequence[tuple[str, Section]], stiffness: float | None = None
    ):
        self.path = path
        self._sections = sections
        self._image = self._deflection_image()
        self.is_volume = "volume" in _first(sections, SCAN).get("operating mode", "").lower()
        self.shape = self._grid_shape() if self.is_volume else (1, 1)
        self._points = self._points_of_segment()
        count = self.shape[0] * self.shape[1] * 2 * self._points
        self._offset, self._words = self._data_words(self._image, count)
        k = _number(self._image.get("spring constant", "")) or stiffness or 0.0
        volts, sensitivity = self._step(self._image, "z scale")
        if not k > 0 or not sensitivity:
            missing = "spring constant" if sensitivity else "sensitivity"
            raise Uncalibrated(f"lacks {missing}: {STIFFNESS_KEY}", str(path))
        self.stiffness = k
        self._step_factor = self._step_factor_by_trigger(volts)
        # Deflection [m] of one step of a stored integer, and displacement of the base [m] between
        # two points.
        self._deflection_step = volts * self._step_factor * sensitivity
        ramp = QUANTITY.fullmatch(self._image.get("ramp size", ""))
        if not ramp or not float(ramp["value"]) > 0:
            raise self._no_curve("no size of the ramp")
        self._ramp_volts = float(ramp["value"])
        self._z_step = self._ramp_volts * self._sensitivity(ramp["sensitivity"]) / self._points

    def curve(self, index: int) -> MeasuredCurve:
        """Return a curve in SI units, approach first.

        Raises NoCurve if it is damaged or has deflections that are impossible.
        """
        n = self._points
        stored = self._read_words(self._words, self._offset, index, 2 * n)
        # The approach is stored backwards from the turning point, the retraction in the order of
        # time.
        words = np.concatenate([stored[:n][::-1], stored[n:]])
        # Points at both ends that were not measured have the lowest representable number.
        measured = np.flatnonzero(words != np.iinfo(words.dtype).min)
        if not len(measured) or np.ptp(measured) + 1 != len(measured):
            raise self._no_curve(f"points of curve {index} are missing")
        rows = slice(int(measured[0]), int(measured[-1]) + 1)
        k = self.stiffness
        with np.errstate(all="ignore"):
            z = self._z_step * np.concatenate([np.arange(n), np.arange(n)[::-1]])[rows]
            deflection = self._deflection_step * words[rows]
            force = k * deflection
            travel = float(np.ptp(z))
            swing = float(np.ptp(deflection))
        # A deflection can exceed the travel of the base only by a snap-in. If the ratio of their
        # ranges exceeds this, the deflections are wrong.
        max_deflection_ratio = 1.5
        if not swing <= max_deflection_ratio * travel < np.inf or not np.isfinite(force).all():
            raise self._no_curve("the deflections exceed the travel of the base")
        turn = min(max(n - rows.start, 0), len(z))
        parts = {"approach": slice(0, turn), "retract": slice(turn, len(z))}
        name = f"{self.path.stem}-{index}" if self.is_volume else self.path.stem
        t = self._times()
        return MeasuredCurve(
            name,
            force,
            z=z,
            t=None if t is None else t[rows],
            stiffness=k,
            parts={part: place for part, place in parts.items() if place.start < place.stop},
            units=SI,
        )

    def measured_map(self) -> MeasuredMap:
        """Return the curves of a force volume as a map, with the image of the height if it exists.

        The rows of the grid are in the order of the file, and none of them is traversed backwards.
        """
        rows, columns = self.shape
        places = grid_places(np.arange(rows * columns), columns, False)
        image = self._height_image()
        return MeasuredMap(
            self.shape,
            _scan_size(image.get("scan size", "")),
            places,
            self.curve,
            self._height(image),
            self.stiffness,
        )

    def _deflection_image(self) -> Section:
        """Return the section of the force image of the deflection."""
        images = [section for title, section in self._sections if title == FORCE_IMAGE]
        named = [one for one in images if "deflection" in one.get("image data", "").lower()]
        if not images or not (named or len(images) == 1):
            raise self._no_curve("a NanoScope file without deflections of force curves")
        return (named or images)[0]

    def _grid_shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns of a force volume."""
        force = _first(self._sections, FORCE)
        image = self._height_image()
        columns = _count(force.get("force/line") or image.get("samps/line", ""))
        rows = _count(image.get("number of lines") or _first(self._sections, SCAN).get("lines", ""))
        if not rows or not columns:
            raise self._no_curve("the number of curves of the force volume is unknown")
        return rows, columns

    def _points_of_segment(self) -> int:
        """Return the number of points of the approach, which equals that of the retraction."""
        text = self._image.get("samps/line") or _first(self._sections, FORCE).get("samps/line", "")
        counts = {_count(word) for word in text.split()}
        if len(counts) != 1 or not (points := counts.pop()):
            raise self._no_curve(
                f"Samps/line is '{text}', but approach and retraction must have the same number of "
                "points, above 0"
            )
        return points

    def _data_words(self, image: Section, count: int) -> tuple[int, np.dtype]:
        """Return the position of the data of an image in the file, and the type of its integers."""
        offset = _count(image.get("data offset", ""))
        length = _count(image.get("data length", ""))
        if offset is None or length not in (2 * count, 4 * count):
            raise self._no_curve(f"{length} bytes are not {count} words of 16 or 32 bit")
        if offset + length > self.path.stat().st_size:
            raise self._no_curve(f"the file ends before the {length} bytes of its data")
        return offset, np.dtype("<i2" if length == 2 * count else "<i4")

    def _read_words(self, words: np.dtype, offset: int, index: int, count: int) -> np.ndarray:
        """Return the stored integers (count,) of one curve or image, called words in the header."""
        place = offset + index * count * words.itemsize
        try:
            data = np.fromfile(self.path, words, count, offset=place)
        except OSError as error:
            raise self._no_curve(f"cannot be read ({error})") from None
        if len(data) != count:
            raise self._no_curve(f"the file ends within curve {index}")
        return data

    def _step(self, image: Section, key: str) -> tuple[float, float]:
        """Return V/LSB of a quantity and its sensitivity [m/V], 0 if that is unknown."""
        quantity = QUANTITY.fullmatch(image.get(key, ""))
        if not quantity or not quantity["step"]:
            raise self._no_curve(f"no V/LSB of the {key}")
        return float(quantity["step"]), self._sensitivity(quantity["sensitivity"])

    def _sensitivity(self, name: str | None) -> float:
        """Return a sensitivity [m/V] by its name; 0 if it is missing or is not a length."""
        for _, section in self._sections:
            quantity = QUANTITY.fullmatch(section.get((name or "").lower(), ""))
            # A sensitivity of the deflection without a unit is in nm/V.
            if quantity and quantity["unit"] in ("nm/V", ""):
                return 1e-9 * float(quantity["value"])
        return 0.0

    def _step_factor_by_trigger(self, volts: float) -> float:
        """Return the factor of V/LSB, by comparison of the deflection with the trigger threshold.

        Parameters
        ----------
        volts
            V/LSB of the deflection.
        """
        if self._words.itemsize == 2:
            return 1.0
        force = _first(self._sections, FORCE)
        trigger = QUANTITY.fullmatch(force.get("trig threshold deflection", ""))
        mode = force.get("trigger mode", "").lower()
        problem = "the scale of its 32-bit deflections is unknown"
        if not trigger or not float(trigger["value"]) or mode == "off":
            raise self._no_curve(f"{problem}, since it has no trigger threshold")
        n = self._points
        curves = self.shape[0] * self.shape[1]
        turns = []
        # Number of curves of a map whose deflections are compared with the trigger threshold.
        compared_curves = 64
        for index in np.unique(np.linspace(0, curves - 1, compared_curves).astype(int)).tolist():
            approach = self._read_words(self._words, self._offset, index, 2 * n)[:n]
            approach = approach[approach != np.iinfo(approach.dtype).min]
            if len(approach):
                far = float(np.median(approach[-max(len(approach) // 4, 1) :]))
                turns.append(approach[0] - (far if mode != "absolute" else 0.0))
        turn = volts * abs(float(np.median(turns))) if turns else 0.0
        ratio = turn / abs(float(trigger["value"]))
        # Largest relative difference between the deflection at the turning point and the trigger
        # threshold.
        trigger_tolerance = 0.2
        for factor in STEP_FACTORS:
            if abs(ratio * factor - 1) <= trigger_tolerance:
                return factor
        raise self._no_curve(f"{problem}: they turn at {ratio:.3g} times the trigger threshold")

    def _times(self) -> np.ndarray | None:
        """Return the times (2 n,) [s] of the points of approach and retraction, None if unknown."""
        force = _first(self._sections, FORCE)
        rates = [_number(force.get(f"{way} vel.", "")) or 0.0 for way in ("forward", "reverse")]
        if not all(rate > 0 for rate in rates):
            return None
        durations = [self._ramp_volts / rate for rate in rates]
        begin = durations[0] + (_number(force.get("hold time", "")) or 0.0)
        n = self._points
        approach = np.linspace(0, durations[0], n, endpoint=False)
        retraction = begin + np.linspace(0, durations[1], n, endpoint=False)
        return np.concatenate([approach, retraction])

    def _height_image(self) -> Section:
        """Return the section of the image of the height; empty if there is none."""
        images = [section for title, section in self._sections if title == IMAGE]
        return next((one for one in images if "[height]" in one.get("image data", "").lower()), {})

    def _height(self, image: Section) -> np.ndarray | None:
        """Return the image of the height (rows, columns) [m], None if it is not readable."""
        count = self.shape[0] * self.shape[1]
        try:
            offset, words = self._data_words(image, count)
            volts, sensitivity = self._step(image, "z scale")
            # Integers of 32 bits have the same steps as those of the deflections.
            factor = self._step_factor if words.itemsize == self._words.itemsize else 1.0
            values = self._read_words(words, offset, 0, count)
        except NoCurve:
            return None
        return volts * factor * sensitivity * values.reshape(self.shape) if sensitivity else None

    def _no_curve(self, why: str) -> NoCurve:
        """Return a NoCurve error that names this file."""
        return NoCurve(why, str(self.path))


def _read_header(path: Path) -> list[tuple[str, Section]]:
    """Return the sections of a header, each with its title; raise NoCurve if there are none.

    Titles and keys are in lower case, keys without the number of their group.
    """
    with path.open("rb") as file:
        data = file.read(MAX_HEADER_BYTES)
    end = END.search(data)
    if not data.startswith(BEGINNINGS) or not end:
        raise NoCurve("not a NanoScope file", str(path))
    head = data[: end.start()]
    sections: list[tuple[str, Section]] = []
    for line in head.decode("latin-1").splitlines():
        text = line.strip()
        if text.startswith("\\*"):
            sections.append((text[2:].strip().lower(), {}))
        elif sections and text.startswith("\\"):
            key, _, value = text[1:].partition(": ")
            key = re.sub(r"^@?(?:\d+:)?", "", key).rstrip(":").strip().lower()
            sections[-1][1].setdefault(key, value.strip())
    return sections


def _first(sections: Sequence[tuple[str, Section]], title: str) -> Section:
    """Return the first section with a title; empty if there is none."""
    return next((section for name, section in sections if name == title), {})


def _scan_size(text: str) -> tuple[float, float] | None:
    """Return the lengths [m] along a column and along a row of a scan, such as 2 2 ~m."""
    found = re.fullmatch(rf"({NUMBER}) ({NUMBER}) (\S+)", text)
    if not found or found[3] not in LENGTH_UNITS:
        return None
    unit = LENGTH_UNITS[found[3]]
    along_row, along_column = (float(number) * unit for number in found.groups()[:2])
    return (along_column, along_row) if along_row > 0 and along_column > 0 else None


def _count(text: str) -> int | None:
    """Return the number in a text of at most ten digits; None for any other text."""
    return int(text) if re.fullmatch(r"\d{1,10}", text, re.ASCII) else None


def _number(text: str) -> float | None:
    """Return the number at the beginning of a text, None if there is none."""
    found = re.match(NUMBER, text)
    return float(found[0]) if found else None
