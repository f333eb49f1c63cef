"""JPK files as their makers lay them out, with numbers that a test knows."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

STIFFNESS = 0.0223
SENSITIVITY = 9.12e-8
# Factor and offset of the encoder of each channel, then of its conversions.
HEIGHT_SCALINGS = ((-7.77e-14, -2.84e-5), (1.0, 1e-4))
PIEZO_SCALINGS = ((2.33e-8, 50.0), (-1e-6, 1e-4), (0.7, 0.0))
DEFLECTION_SCALINGS = ((5.55e-9, -5.3e-4), (SENSITIVITY, 0.0), (STIFFNESS, 0.0))


@dataclass(frozen=True)
class Segment:
    """Numbers as they are stored: heights and deflections (n,), 32 bit."""

    style: str
    heights: np.ndarray
    deflections: np.ndarray
    duration: float = 1.0


@dataclass(frozen=True)
class Grid:
    """Grid of a map: columns, rows, their lengths [m], and whether odd rows run backwards."""

    columns: int
    rows: int
    width: float
    height: float
    back_and_forth: bool


def segment(style: str, n: int, seed: int = 0, duration: float = 1.0) -> Segment:
    """Return a segment of random numbers."""
    draw = np.random.default_rng([seed, n])
    numbers = draw.integers(-(2**31), 2**31, (2, n), dtype=np.int32)
    return Segment(style, numbers[0], numbers[1], duration)


def measured(style: str, z: np.ndarray, force: np.ndarray) -> Segment:
    """Return a segment of displacements of the base [m] and forces [N] (n,), as it is stored."""
    (height_factor, height_offset), (_, nominal_offset) = HEIGHT_SCALINGS
    (volt_factor, volt_offset), _, _ = DEFLECTION_SCALINGS
    heights = (-z - nominal_offset - height_offset) / height_factor
    volts = (force / (STIFFNESS * SENSITIVITY) - volt_offset) / volt_factor
    return Segment(style, np.rint(heights).astype(np.int64), np.rint(volts).astype(np.int64))


def write_map(path: Path, z: np.ndarray, force: np.ndarray, grid: Grid) -> Path:
    """Write a map of displacements of the base (n,) [m] and forces (rows, columns, n) [N]."""
    curves = [
        [measured("extend", z, values), measured("retract", z[::-8], values[::-8])]
        for values in force.reshape(-1, len(z))
    ]
    return write(path, members(curves, "force-scan-map", grid))


def scaled(numbers: np.ndarray, scalings: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return stored numbers (n,) after linear conversions, one after the other."""
    values = numbers.astype(float)
    for factor, offset in scalings:
        values = values * factor + offset
    return values


def members(
    curves: Sequence[Sequence[Segment]],
    kind: str = "force-scan-series",
    grid: Grid | None = None,
    height: str = "measuredHeight",
    numbers: Sequence[int] | None = None,
    is_old: bool = False,
    spring: float | None = STIFFNESS,
    sensitivity: float | None = SENSITIVITY,
) -> dict[str, bytes]:
    """Return the members of the archive of a JPK file.

    Parameters
    ----------
    curves
        Segments of each curve.
    kind
        Type of the file: force-scan-series (one curve), force-scan-map, quantitative-imaging-map.
    grid
        Positions of the curves of a map.
    height
        Channel of the measured height; "height" for a file that has the piezo's only.
    numbers
        Numbers of the curves of a map; by default they are counted from 0.
    is_old
        Whether the file has version 0.12: 16 bit, and no shared data.
    spring, sensitivity
        Calibration, in N/m and m/V; None if it is lacking.
    """
    channels = _channels(height, spring, sensitivity)
    files = {"header.properties": _header(kind, grid)}
    shared: dict[str, str] = {}
    for index, name in enumerate(channels):
        shared |= {f"lcd-info.{index}.{key}": value for key, value in channels[name].items()}
    styles = sorted({one.style for curve in curves for one in curve})
    for index, style in enumerate(styles):
        shared[f"force-segment-header-info.{index}.settings.style"] = style
    if not is_old:
        files["shared-data/header.properties"] = _text(shared)
    for index, curve in enumerate(curves):
        number = index if numbers is None else numbers[index]
        folder = "" if kind == "force-scan-series" else f"index/{number}/"
        files[f"{folder}header.properties"] = _header(kind, grid)
        for place, one in enumerate(curve):
            header = {
                "force-segment-header.time-stamp": r"2016-06-15 15\:56\:49.959 +0200",
                "force-segment-header.duration": str(one.duration),
                "force-segment-header.num-points": str(len(one.heights)),
                "channels.list": " ".join(channels),
            }
            if is_old:
                header["force-segment-header.settings.style"] = one.style
            else:
                header["force-segment-header.force-segment-header-info.*"] = str(
                    styles.index(one.style)
                )
            for column, (name, properties) in enumerate(channels.items()):
                header[f"channel.{name}.data.file.name"] = f"channels/{name}.dat"
                if is_old:
                    old = {
                        f"data.{key}" if "encoder" in key else key: value
                        for key, value in properties.items()
                    }
                    old["data.encoder.type"] = "signedshort"
                    header |= {f"channel.{name}.{key}": value for key, value in old.items()}
                else:
                    header[f"channel.{name}.lcd-info.*"] = str(column)
                values = one.deflections if name == "vDeflection" else one.heights
                path = f"{folder}segments/{place}/channels/{name}.dat"
                files[path] = values.astype(">i2" if is_old else ">i4").tobytes()
            files[f"{folder}segments/{place}/segment-header.properties"] = _text(header)
    return files


def write(path: Path, files: Mapping[str, bytes]) -> Path:
    """Write the archive of a JPK file."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def _channels(
    height: str, spring: float | None, sensitivity: float | None
) -> dict[str, dict[str, str]]:
    """Return the properties of the channels by their names."""
    piezo = _channel(PIEZO_SCALINGS, ("V", "m", "m"), ("volts", "nominal", "calibrated"))
    deflection = _channel(DEFLECTION_SCALINGS, ("V", "m", "N"), ("volts", "distance", "force"))
    for name, value in (("force", spring), ("distance", sensitivity)):
        if value is None:
            prefix = f"conversion-set.conversion.{name}."
            deflection = {k: v for k, v in deflection.items() if not k.startswith(prefix)}
            deflection[f"{prefix}defined"] = "false"
    channels = {"height": piezo, "vDeflection": deflection}
    if height != "height":
        channels[height] = _channel(HEIGHT_SCALINGS, ("m", "m"), ("absolute", "nominal"))
    return channels


def _channel(
    scalings: Sequence[tuple[float, float]], units: Sequence[str], slots: Sequence[str]
) -> dict[str, str]:
    """Return the properties of a channel: its encoder, and a conversion to each slot."""
    properties = {
        "type": "integer-data",
        "conversion-set.conversions.base": slots[0],
        "conversion-set.conversions.default": slots[-1],
        "encoder.type": "signedinteger",
    }
    for index, (slot, unit, (factor, offset)) in enumerate(
        zip(slots, units, scalings, strict=True)
    ):
        head = f"conversion-set.conversion.{slot}."
        place = f"{head}scaling." if index else "encoder.scaling."
        properties |= {
            f"{place}multiplier": repr(factor),
            f"{place}offset": repr(offset),
            f"{place}unit.unit": unit,
        }
        if index:
            properties[f"{head}base-calibration-slot"] = slots[index - 1]
    return properties


def _header(kind: str, grid: Grid | None) -> bytes:
    """Return the header of a file."""
    header = {"type": kind, "file-format-version": "2.0"}
    if grid:
        pattern = {
            "type": "grid-position-pattern",
            "back-and-forth": str(grid.back_and_forth).lower(),
            "grid.ilength": str(grid.columns),
            "grid.jlength": str(grid.rows),
            "grid.ulength": repr(grid.width),
            "grid.vlength": repr(grid.height),
            "grid.unit.unit": "m",
        }
        header |= {f"{kind}.position-pattern.{key}": value for key, value in pattern.items()}
    return _text(header)


def _text(properties: Mapping[str, str]) -> bytes:
    """Return properties as text."""
    lines = [f"{key}={value}" for key, value in properties.items()]
    return "\n".join(["#Wed Jun 15 15:56:51 CEST 2016", *lines, ""]).encode("latin-1")
