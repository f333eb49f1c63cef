"""Random curve files that are broken, absurd or unusual, and the right outcome of each."""

from __future__ import annotations

import gzip
import io
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

MODULUS, RADIUS = 1.0, 5.0  # kPa, um: of a paraboloid on a half-space of nu 0.5, force in nN
DONE = ""  # the reason of a curve that is fitted
UNREADABLE = "not a curve: "


@dataclass(frozen=True)
class Hostile:
    """A file: its name, its bytes, and the beginning of the reason for which it is refused.

    The reason is DONE where the file holds a curve, and None where either may be right.
    """

    name: str
    data: bytes
    reason: str | None


def curve(draw: np.random.Generator, n: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Depths [um] and forces [nN] with one per cent of noise, first touch at 0."""
    x = np.linspace(-0.6, 0.6, n)
    force = 4 / 3 * MODULUS / 0.75 * np.sqrt(RADIUS) * np.maximum(x, 0.0) ** 1.5
    return x, force + 0.01 * force.max() * draw.standard_normal(n) + draw.uniform(-0.2, 0.2)


def text(
    columns: tuple[np.ndarray, ...],
    separator: str = ",",
    head: str = "delta,force\n",
    end: str = "\n",
) -> str:
    """A table of numbers."""
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return head + "".join(separator.join(f"{value:.7g}" for value in row) + end for row in rows)


def hostile(draw: np.random.Generator) -> Iterator[Hostile]:
    """One file of every kind."""
    for kinds in (_written_otherwise, _no_text, _no_numbers, _no_curve, _damaged):
        for name, (data, reason) in kinds(draw).items():
            suffix = "" if "." in name else ".csv"
            yield Hostile(name + suffix, data.encode() if isinstance(data, str) else data, reason)


def _written_otherwise(draw: np.random.Generator) -> dict[str, tuple[str | bytes, str | None]]:
    """Curves in unusual formats."""
    x, F = curve(draw)
    plain, blanks = text((x, F)), text((x, F), " ", "# depth force\n")
    german = text((x, F), ";", "Tiefe [µm];Kraft [nN]\n")
    numbered = text((np.arange(len(x)), x, F), "\t", "row\tdepth (um)\tload (nN)\n")
    half = len(x) // 2
    return {
        "plain": (plain, DONE),
        "decimal commas": (german.replace(".", ","), DONE),
        "commas between blanks": (text((x, F), "  ", "").replace(".", ","), DONE),
        "blanks": (blanks, DONE),
        "latin": (german.encode("latin-1"), DONE),
        "utf-16": (german.encode("utf-16"), DONE),
        "marked": (("\ufeff" + german).encode(), DONE),
        "windows": (plain.replace("\n", "\r\n"), DONE),
        "old mac": (plain.replace("\n", "\r"), DONE),
        "in quotes": (text((x, F), '";"', '"delta";"force"\n"', '"\n"')[:-1], DONE),
        "numbered rows": (numbered, DONE),
        "metres and newtons": (text((1e-6 * x, 1e-9 * F), ",", "delta [m],force [N]\n"), DONE),
        "percent comments": ("% of March\n% an instrument\n" + text((x, F), " ", ""), DONE),
        "long head": ("".join(f"# {k}: {k}\n" for k in range(1000)) + plain, DONE),
        "no line end": (plain.rstrip("\n"), DONE),
        "holes": (plain.replace("\n0", "\n,\n0", 3), DONE),
        "comments inside": (
            text((x[:half], F[:half])) + "# pause\n\n" + text((x[half:], F[half:]), head=""),
            DONE,
        ),
        "some nan": (text((np.where(np.arange(len(x)) % 7 == 3, np.nan, x), F)), DONE),
        "there and back": (text((np.r_[x, x[::-1]], np.r_[F, F[::-1]])), DONE),
        "backwards": (text((x[::-1], F[::-1])), DONE),
        "minus of a typesetter": (plain.replace("-", "\N{MINUS SIGN}"), DONE),
        "shuffled columns": (text((F, x), ",", "force,delta\n"), DONE),
        "upper case": (text((x, F), "\t", "DEPTH [UM]\tFORCE [NN]\n"), None),
        "three columns.csv": (text((x, F, F), ",", ""), UNREADABLE + "3 columns without a header"),
    }


def _no_text(draw: np.random.Generator) -> dict[str, tuple[str | bytes, str | None]]:
    """Bytes of something else under the name of a curve."""
    plain = text(curve(draw)).encode()
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("curve.csv", plain)
    noise = draw.integers(0, 256, 5000, dtype=np.uint8).tobytes()
    files = {
        "noise": noise,
        "packed": gzip.compress(plain),
        "picture": b"\x89PNG\r\n\x1a\n" + noise,
    }
    files |= {"zeros": bytes(4000), "archive": archive.getvalue(), "pdf": b"%PDF-1.7\n" + noise}
    files |= {
        "utf-32": plain.decode().encode("utf-32"),
        "utf-16 unmarked": plain.decode().encode("utf-16-le"),
    }
    files |= {"half a letter": b"\xff\xfe1\x00,\x002\x00\n", "numbers": curve(draw)[1].tobytes()}
    return {name: (data, UNREADABLE) for name, data in files.items()}


def _no_numbers(draw: np.random.Generator) -> dict[str, tuple[str | bytes, str | None]]:
    """Text that is no table of two columns of numbers."""
    x, F = curve(draw)
    plain = text((x, F))
    lines = plain.splitlines()
    ragged = [
        ",".join([line, *["1"] * int(draw.integers(0, 4))][: int(draw.integers(1, 4))])
        for line in lines
    ]
    bad = int(draw.integers(50, 250))
    one_word = "\n".join([*lines[:bad], "0.1,a lot", *lines[bad:]])
    files: dict[str, str] = {
        "empty": "",
        "blank": " \n\t\n \n",
        "header only": "delta,force\n",
        "words": "to be,or not\n" * 60,
        "one column": text((F,), head="force\n"),
        "one bare column": text((F,), head=""),
        "one word": one_word,
        "no force": text((x, F), ",", "delta,width\n"),
        "no depth": text((x, F), ",", "colour,force\n"),
        "ragged rows": "\n".join(["delta,force", *(line.split(",")[0] for line in ragged)]),
        "json": '{"delta": [0, 1], "force": [0, 1]}',
        "xml": "<a>\n<b/>\n</a>\n",
        "quotes": '"\n' * 60,
        "separators": ",,,,\n" * 60,
        "one line": ",".join(lines),
        "long line": "1," * 200_000,
        "underscores": text((x, F)).replace(".", "_"),
        "hexadecimal": "delta,force\n" + "0x1,0x2\n" * 60,
        "all nan": "delta,force\n" + "nan,nan\n" * 60,
        "all inf": "delta,force\n" + "inf,-inf\n" * 60,
        "mostly holes": "delta,force\n" + "1,\n" * 60 + "1,2\n" * 40,
        "hash": "#\n" * 60,
        "formulas": "delta,force\n" + "=A1,=B1\n" * 60,
        "tab of blanks.tab": "\t\t\t\n" * 60,
        "metadata.tab": "# BEGIN METADATA\n# {broken\n# END METADATA\n#\n",
        "page": "<!DOCTYPE html><p>1,2</p>",
    }
    return {name: (data, UNREADABLE) for name, data in files.items()}


def _no_curve(draw: np.random.Generator) -> dict[str, tuple[str | bytes, str | None]]:
    """Numbers without a contact."""
    x, F = curve(draw)
    n, zero = len(x), np.zeros(len(x))
    noise = draw.standard_normal(n)
    few = slice(140, 160)
    step = int(draw.integers(100, 200))
    files: dict[str, tuple[np.ndarray, np.ndarray, str | None]] = {
        "constant": (x, zero + 1.5, "no contact"),
        "noise alone": (x, noise, "no contact"),
        "one depth": (zero + 0.1, F, "no contact: the depth"),
        "one point often": (zero, zero, "no contact: the depth"),
        "few points": (x[few], F[few], "20 points"),
        "saturated": (x, np.minimum(F, 0.3 * F.max()), "saturated"),
        "turned": (x, -F, "no contact"),
        "waves": (x, np.sin(200 * x), None),
        "beyond numbers": (1e200 * x, 1e300 * F, UNREADABLE),
        "near the largest": (1e90 * x, 1e90 * F, None),
        "smallest": (1e-300 * x, 1e-300 * F, None),
        "no baseline": (x[x > 0.3], F[x > 0.3], None),
        "a cliff": (x, 1.0 * (np.arange(n) > step), None),
        "one spike": (x, noise + 1e6 * (np.arange(n) == step), None),
        "spikes": (x, F + 1e3 * (draw.random(n) < 0.02), None),
        "two levels": (x, np.round(F / F.max()), None),
        "all at random": (draw.standard_normal(n), draw.standard_normal(n), None),
        "random order": (*(one[draw.permutation(n)] for one in (x,)), F, None),
        "huge depth": (1e6 * x, F, None),
        "every depth twice": (np.repeat(x[::2], 2), F, None),
        "tension only": (x, -np.abs(noise) - 1, None),
    }
    return {name: (text((depth, force)), reason) for name, (depth, force, reason) in files.items()}


def _damaged(draw: np.random.Generator) -> dict[str, tuple[str | bytes, str | None]]:
    """Good files that were cut, spliced or sprinkled, and false files of instruments."""
    good = text(curve(draw), ";", "depth [um];force [nN]\n").encode()

    def sprinkled() -> bytes:
        data = bytearray(good)
        for place in draw.integers(0, len(data), int(draw.integers(1, 30))):
            data[place] = int(draw.integers(0, 256))
        return bytes(data)

    def spliced() -> bytes:
        begin, end = sorted(draw.integers(0, len(good), 2).tolist())
        return good[:end] + good[begin:]

    ways: dict[str, Callable[[], bytes]] = {
        "cut": lambda: good[: int(draw.integers(1, len(good)))],
        "spliced": spliced,
        "sprinkled": sprinkled,
        "begins late": lambda: good[int(draw.integers(1, len(good))) :],
        "twice": lambda: good + good,
    }
    files: dict[str, tuple[str | bytes, str | None]] = {
        name: (way(), None) for name, way in ways.items()
    }
    for suffix in ("jpk-force", "ibw", "h5", "spm", "zip"):
        files[f"no instrument's.{suffix}"] = (
            draw.integers(0, 256, 3000, dtype=np.uint8).tobytes(),
            UNREADABLE,
        )
    return files
