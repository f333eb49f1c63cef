"""Images of maps for other programs: Gwyddion (.gsf) and ImageJ or Fiji (.tif)."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from indent_sim.results.atomic_files import read_regular_file

# Lengths of units in which ImageJ expects the width of a pixel.
MICROMETRE = 1e-6


def gwyddion_field(
    values: np.ndarray, size: tuple[float, float] | None, title: str, unit: str
) -> bytes:
    """Return an image as a Gwyddion Simple Field 1.0, with NaN for missing values.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Values; the first row is the lowest one of the image.
    size : tuple of float, optional
        Height and width of the scanned area [m].
    title : str
        Name of the quantity.
    unit : str
        SI unit of the quantity.
    """
    rows, columns = values.shape
    header = {"XRes": columns, "YRes": rows, "Title": title}
    if size is not None:
        header |= {"XReal": repr(size[1]), "YReal": repr(size[0]), "XYUnits": "m"}
    if unit:
        header["ZUnits"] = unit
    lines = "".join(f"{name} = {value}\n" for name, value in header.items())
    text = f"Gwyddion Simple Field 1.0\n{lines}".encode()
    # One to four zero bytes end the header at a multiple of four bytes.
    return text + bytes(4 - len(text) % 4) + values[::-1].astype("<f4").tobytes()


def tiff_image(values: np.ndarray, size: tuple[float, float] | None, unit: str) -> bytes:
    """Return an image of 32-bit floating-point numbers as TIFF, with pixel sizes for ImageJ.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Values, NaN for missing ones; the first row is the lowest one of the image.
    size : tuple of float, optional
        Height and width of the scanned area [m].
    unit : str
        Unit of the values, kept in the description.
    """
    from PIL import Image, TiffImagePlugin

    description = f"ImageJ=1.53\nunit=micron\nvalues={unit}\n"
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[TiffImagePlugin.IMAGEDESCRIPTION] = description
    if size is not None:
        rows, columns = values.shape
        tags[TiffImagePlugin.X_RESOLUTION] = columns / size[1] * MICROMETRE
        tags[TiffImagePlugin.Y_RESOLUTION] = rows / size[0] * MICROMETRE
        tags[TiffImagePlugin.RESOLUTION_UNIT] = 1
    data = io.BytesIO()
    image = Image.fromarray(np.ascontiguousarray(values[::-1], dtype=np.float32))
    image.save(data, format="TIFF", tiffinfo=tags)
    return data.getvalue()


def read_image(path: Path) -> np.ndarray:
    """Return the numbers (rows, columns) of a .gsf, .tif or text file, the lowest row first.

    The rows of a text file are in the order of the map. Raises OSError or ValueError if the file
    cannot be read.
    """
    data = read_regular_file(path)
    suffix = path.suffix.lower()
    if suffix == ".gsf":
        return _read_gwyddion_field(data)
    if suffix in (".tif", ".tiff"):
        from PIL import Image

        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image, dtype=float)[::-1]
    text = data.decode("utf-8", "replace").replace(";", " ").replace(",", " ")
    return np.loadtxt(io.StringIO(text), ndmin=2)


def _read_gwyddion_field(data: bytes) -> np.ndarray:
    header = dict(
        line.split(" = ", 1)
        for line in data[:10_000].split(b"\0", 1)[0].decode("utf-8", "replace").splitlines()
        if " = " in line
    )
    rows = int(header["YRes"])
    columns = int(header["XRes"])
    start = data.index(b"\0")
    start += 4 - start % 4
    values = np.frombuffer(data, dtype="<f4", count=rows * columns, offset=start)
    return values.reshape(rows, columns)[::-1].astype(float)
