"""NanoScope files as Bruker lays them out, with numbers that a test knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

STIFFNESS = 0.1332
# nm/V, and V of one step.
SENSITIVITY = 27.39
VOLTS = 0.000375
Z_SENSITIVITY = 13.203
RAMP_VOLTS = 151.4807
TRIGGER = 1.2
HEIGHT_VOLTS = 0.006713765
# Header of a PeakForce capture, which another package reads.
PEAKFORCE_CAPTURE = (
    b"\\*File list\r\n\\*Ciao scan list\r\n\\PeakForce Capture: Allow\r\n\\*File list end\r\n"
)


def deflections(shape: tuple[int, int], n: int, seed: int = 0) -> np.ndarray:
    """Return volts (curves, 2, n) of approach and retraction in the order of time.

    The tip turns at the trigger, give or take a few per cent.
    """
    draw = np.random.default_rng(seed)
    x = np.linspace(-1.0, 1.0, n)
    rise = TRIGGER * np.maximum(x, 0.0) ** 1.5
    curves = [
        [rise * (1 + 0.02 * draw.standard_normal()), 0.9 * rise[::-1]]
        for _ in range(np.prod(shape))
    ]
    return np.array(curves) + 0.002 * draw.standard_normal((len(curves), 2, n)) - 0.3


def stored(volts: np.ndarray, bits: int, factor: float) -> np.ndarray:
    """Return deflections (curves, 2, n) as words; the approach begins at the turn."""
    words = np.rint(volts / (VOLTS * factor)).astype(f"<i{bits // 8}")
    words[:, 0] = words[:, 0, ::-1]
    return words


def write(
    path: Path,
    words: np.ndarray,
    shape: tuple[int, int] | None = None,
    height: np.ndarray | None = None,
    changes: dict[str, str] | None = None,
) -> Path:
    """Write a file.

    Parameters
    ----------
    path
        The file.
    words
        Deflections (curves, 2, n) as they are stored.
    shape
        Rows and columns of a force volume; None for a single curve.
    height
        Image of the height (rows, columns) as it is stored.
    changes
        Texts of the header that are replaced.
    """
    rows, columns = shape or (256, 256)
    n = words.shape[2]
    offset = 8192
    image_offset = offset + words.nbytes
    lines = [
        r"\*Force file list",
        r"\Version: 0x0920B046",
        r"\Data length: 8192",
        r"\*Scanner list",
        rf"\@Sens. Zsens: V {Z_SENSITIVITY:.5f} nm/V",
        r"\*Ciao scan list",
        rf"\Operating mode: {'Force Volume' if shape else 'Force'}",
        rf"\Lines: {rows}",
        r"\PeakForce Capture: Never",
        rf"\@Sens. DeflSens: V {SENSITIVITY:.5f} ",
        r"\*Ciao force list",
        r"\Forward vel.: 302.9614",
        r"\Reverse vel.: 151.4807",
        r"\Trigger mode: Relative",
        r"\Hold Time: 0.25",
        rf"\force/line: {columns}",
        rf"\@4:Trig Threshold Deflection: V [Sens. DeflSens] ({VOLTS:.10f} V/LSB) {TRIGGER:.6f} V",
        r"\@4:Ramp Size Zsweep: V [Sens. Zsens] (\Data length V/LSB) 151.4807 V",
        r"\*Ciao force image list",
        rf"\Data offset: {offset}",
        rf"\Data length: {words.nbytes}",
        r"\Bytes/pixel: 2",
        rf"\Samps/line: {n} {n}",
        rf"\Spring Constant: {STIFFNESS}",
        r'\@4:Image Data: S [DeflectionError] "Deflection Error"',
        rf"\@4:Z scale: V [Sens. DeflSens] ({VOLTS:.10f} V/LSB) 2.500000 V",
        rf"\@4:Ramp Size: V [Sens. Zsens] (0.006713765 V/LSB) {RAMP_VOLTS} V",
    ]
    if shape:
        lines += [
            r"\*Ciao image list",
            rf"\Data offset: {image_offset}",
            rf"\Data length: {height.nbytes if height is not None else 0}",
            rf"\Samps/line: {columns}",
            rf"\Number of lines: {rows}",
            r"\Scan Size: 2 1.5 ~m",
            r'\@2:Image Data: S [Height] "Height"',
            rf"\@2:Z scale: V [Sens. Zsens] ({HEIGHT_VOLTS} V/LSB) 439.9933 V",
        ]
    text = "\r\n".join([*lines, r"\*File list end", ""])
    for old, new in (changes or {}).items():
        assert old in text
        text = text.replace(old, new)
    head = (text.encode("latin-1") + b"\x1a").ljust(offset, b"\0")
    image = b"" if height is None else height.tobytes()
    path.write_bytes(head + words.tobytes() + image)
    return path
