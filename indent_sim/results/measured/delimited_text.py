"""Delimited text -> a measured curve: any separator, decimal comma, header or none, units in
titles.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.config.quantities import size_of
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import (
    DIMENSIONS,
    Measured,
    NoCurve,
    parts_by_name,
    parts_of,
)

HEAD_LINES = 2000  # in which the first line of numbers is looked for
LONGEST_LINE = 100_000  # letters
# letters that are taken apart at once: as lists of cells they fill some hundred megabytes
BLOCK_LETTERS = 1_000_000
MOST_UNKNOWN = 0.5  # share of rows that may lack depth or force
LARGEST_MEASURED = 1e100  # of a measurement, whatever its unit
TITLES = {
    "delta": (
        "delta",
        "indentation",
        "depth",
        "indentation depth",
        "penetration",
        "tip position",
        "δ",
    ),
    "z": ("z", "height", "height (measured)", "piezo", "stage", "displacement"),
    "force": ("force", "load", "f", "p"),
    "t": ("t", "time"),
    "part": ("segment", "branch", "part", "phase"),
}
FALLING = (
    "height",
    "height (measured)",
    "tip position",
)  # of the tip above the body: they fall on the way in
WITHOUT_HEADER = {2: ("delta", "force")}
UNIT_AT_END = re.compile(
    r"^(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]|[ _,/]\s*(?P<bare>[a-zA-Zµμ]{1,3}))$"
)
Cells = list[str]


@dataclass(frozen=True)
class _Layout:
    """How a text is written: separator (None: blanks), decimal sign, titles (none without a
    header), first row.
    """

    separator: str | None
    decimal: str
    titles: tuple[str, ...]
    first: int
    width: int

    def cells(self, line: str) -> Cells:
        """The cells of a line."""
        return [cell.strip().strip("\"'") for cell in line.split(self.separator)]

    def number(self, cell: str) -> float:
        """The number in a cell; ValueError where it is none."""
        if "_" in cell:
            raise ValueError(cell)
        return float(cell.replace(self.decimal, ".") if self.decimal == "," else cell)

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return True


def read_text(
    path: Path,
    data: bytes,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
) -> Measured:
    """The curve of a text table, in its own units; `columns` [depth, force, time] by title or
    number from 1.

    NoCurve for what is no table of numbers, with the reason and the line; ConfigError for columns
    that are not there.
    """
    text = _decoded(data)
    layout = _layout(text)
    chosen = _chosen(layout, columns, str(path))
    units = {kind: (given or {}).get(kind, "") for kind in set(DIMENSIONS.values())}
    for column, index in chosen.items():
        if (
            column in DIMENSIONS
            and layout.titles
            and (unit := _title(layout.titles[index], DIMENSIONS[column])[1])
        ):
            units[DIMENSIONS[column]] = unit
    numbers = {name: index for name, index in chosen.items() if name != "part"}
    table = _table(text, layout, list(numbers.values()))
    values = {name: table[:, i] for i, name in enumerate(numbers)}
    words = _words(text, layout, chosen["part"]) if "part" in chosen else None
    values, words, notes = _known(values, words)
    for name in numbers:
        if layout.titles and _title(layout.titles[numbers[name]], "length")[0] in FALLING:
            values[name] = -values[name]
    values, note = _rising(values)
    way = values.get("delta", values.get("z"))
    assert way is not None
    parts = parts_by_name(words) if words is not None else parts_of(way)
    return Measured(path.stem, parts=parts, units=units, notes=(*notes, *note), **values)  # type: ignore[arg-type]


def _decoded(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return _plain(data.decode("utf-16"))
        except UnicodeDecodeError:
            raise NoCurve("neither text nor a known AFM file") from None
    if b"\0" in data[:100_000]:
        raise NoCurve("neither text nor a known AFM file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return _plain(text)


def _plain(text: str) -> str:
    """The text with lines that end in one way, and with the minus that a computer reads."""
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return text.replace("\N{MINUS SIGN}", "-")


def _layout(text: str) -> _Layout:
    """Separator and decimal sign by the line in the middle; the header ends before the first line
    of numbers.
    """
    if not text.strip():
        raise NoCurve("the file is empty")
    middle = _middle(text)
    separator = next((sign for sign in ("\t", ";") if sign in middle), None)
    if separator is None and "," in middle and not _is_decimal(middle):
        separator = ","
    decimal = "," if separator != "," and "," in middle else "."
    shape = _Layout(separator, decimal, (), 0, 0)
    width = len(shape.cells(middle))
    head = text[: HEAD_LINES * 200].split("\n")[:HEAD_LINES]
    first = next((k for k, line in enumerate(head) if _is_row(shape, line, width)), None)
    if first is None:
        raise NoCurve("no line of numbers")
    return _Layout(separator, decimal, _titles(shape, head[:first], width), first, width)


def _middle(text: str) -> str:
    """The line in the middle of the text that is not blank nor a comment."""
    begin = text.rfind("\n", 0, len(text) // 2) + 1
    for start in (begin, 0):
        for line in text[start : start + 10 * LONGEST_LINE].split("\n"):
            if line.strip() and line.lstrip()[0] not in "#%":
                if len(line) > LONGEST_LINE:
                    raise NoCurve(f"a line of more than {LONGEST_LINE} letters")
                return line.strip()
    raise NoCurve("no line of numbers")


def _is_decimal(line: str) -> bool:
    """Whether the commas of a line stand in numbers between blanks: 0,1 2,5."""
    cells = line.split()
    return len(cells) > 1 and all(
        re.fullmatch(r"[-+]?\d*,?\d+(?:[eE][-+]?\d+)?", cell) for cell in cells
    )


def _is_row(shape: _Layout, line: str, width: int) -> bool:
    """Whether most cells of a line are numbers, and it has the width of the others."""
    cells = shape.cells(line.strip())
    if len(cells) != width or line.lstrip()[:1] in ("#", "%", ""):
        return False
    return sum(shape.is_number(cell) for cell in cells) >= max(1, (width + 1) // 2)


def _titles(shape: _Layout, head: Sequence[str], width: int) -> tuple[str, ...]:
    """Titles of the last line before the numbers; a line of units below them is joined to them."""
    lines = [line.strip().lstrip("#% ").strip() for line in head]
    rows = [cells for line in lines if line and len(cells := shape.cells(line)) == width]
    if not rows or not lines or shape.cells(lines[-1]) != rows[-1]:
        return ()
    *above, last = rows
    is_comment = next(line for line in reversed(head) if line.strip()).lstrip()[0] in "#%"
    if (
        is_comment and width in WITHOUT_HEADER and not any(map(_is_title, last))
    ):  # words about something else
        return ()
    units = [cell.strip("[]()") for cell in last]
    if above and any(units) and all(not unit or _is_unit(unit) for unit in units):
        return tuple(
            f"{name} [{unit}]" if unit else name
            for name, unit in zip(above[-1], units, strict=True)
        )
    return tuple(last)


def _is_title(cell: str) -> bool:
    """Whether a cell names a column of a curve, or has a unit of one."""
    names = {_title(cell, kind) for kind in ("length", "force", "time")}
    return any(unit for _, unit in names) or any(
        name in known for name, _ in names for known in TITLES.values()
    )


def _is_unit(text: str) -> bool:
    return any(_has_kind(text, kind) for kind in ("length", "force", "time"))


def _has_kind(unit: str, kind: str) -> bool:
    try:
        return size_of(unit, kind) > 0
    except ConfigError:
        return False


def _title(title: str, kind: str) -> tuple[str, str]:
    """Name in small letters and unit of a title such as Force [nN], force (nN), Force nN; ""
    without one.
    """
    match = UNIT_AT_END.match(title.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and _has_kind(unit, kind):
        return match["name"].strip().lower(), unit.replace("μ", "µ")
    return title.strip().lower(), ""


def _chosen(layout: _Layout, asked: Sequence[str] | None, file: str) -> dict[str, int]:
    """The places of delta, z, force, t and part."""
    if asked:
        return {
            name: _place(layout, word, file)
            for name, word in zip(("delta", "force", "t"), asked, strict=False)
        }
    if not layout.titles:
        if layout.width not in WITHOUT_HEADER:
            what = "1 column" if layout.width == 1 else f"{layout.width} columns without a header"
            raise NoCurve(f"{what}: say which with --columns DEPTH,FORCE")
        return {name: place for place, name in enumerate(WITHOUT_HEADER[layout.width])}
    found: dict[str, int] = {}
    for name, known in TITLES.items():
        kind = DIMENSIONS.get(name, "")
        titles = [
            _title(title, kind)[0] if kind else title.strip().lower() for title in layout.titles
        ]
        places = [titles.index(word) for word in known if word in titles]
        if places:
            found[name] = places[0]
    if not found:
        found = _by_units(layout)
    if "force" not in found or not {"delta", "z"} & found.keys():
        missing = "force" if "force" not in found else "depth"
        raise NoCurve(
            f"no column of {missing} among {', '.join(layout.titles)[:200]}: say it with --columns"
        )
    return found


def _by_units(layout: _Layout) -> dict[str, int]:
    """The only column of a length as depth and the only one of a force, whatever their titles are
    in.
    """
    found = {}
    for name in ("delta", "force", "t"):
        places = [k for k, title in enumerate(layout.titles) if _title(title, DIMENSIONS[name])[1]]
        if len(places) == 1:
            found[name] = places[0]
    return found


def _place(layout: _Layout, word: str, file: str) -> int:
    """The place of a column by its title, with or without its unit, or by its number from 1."""
    titles = [title.strip().lower() for title in layout.titles]
    bare = [
        _title(title, kind)[0] for kind in ("length", "force", "time") for title in layout.titles
    ]
    for names in (titles, bare):
        if word.strip().lower() in names:
            return names.index(word.strip().lower()) % len(titles)
    if word.isdecimal() and 1 <= int(word) <= layout.width:
        return int(word) - 1
    there = ", ".join(layout.titles) if layout.titles else f"columns 1 to {layout.width}"
    raise ConfigError("--columns", f"there is no column '{word}'", f"there are {there}", file)


def _table(text: str, layout: _Layout, places: Sequence[int]) -> np.ndarray:
    """The numbers (n, columns) of some columns; NoCurve names the first line that has none."""
    blocks = (_numbers(number, block, layout, places) for number, block in _blocks(text, layout))
    return np.concatenate([np.empty((0, len(places))), *blocks])


def _blocks(text: str, layout: _Layout) -> Iterator[tuple[int, str]]:
    """Pieces of whole lines below the titles, each with the number of its first line."""
    begin = 0
    number = layout.first + 1
    for _ in range(layout.first):
        begin = text.index("\n", begin) + 1
    while begin < len(text):
        end = text.find("\n", begin + BLOCK_LETTERS) + 1 or len(text)
        yield number, text[begin:end]
        number += text.count("\n", begin, end)
        begin = end


def _numbers(number: int, block: str, layout: _Layout, places: Sequence[int]) -> np.ndarray:
    """The numbers of a block that begins at line `number`."""
    rows = block.replace(",", ".") if layout.decimal == "," else block
    comments = ["#", "%"] if "%" in block else "#"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            how = {"delimiter": layout.separator, "comments": comments, "ndmin": 2}
            found = np.loadtxt(io.StringIO(rows), usecols=places, **how)  # type: ignore[call-overload]
    except (ValueError, IndexError):
        return _slow_numbers(number, block, layout, places)
    return found.reshape(-1, len(places))  # type: ignore[no-any-return]


def _slow_numbers(number: int, block: str, layout: _Layout, places: Sequence[int]) -> np.ndarray:
    """The same line by line, where cells are empty or in quotes; NoCurve with the line that is
    wrong.
    """
    rows = []
    for at, cells in _rows(number, block, layout):
        if len(cells) <= max(places):
            raise NoCurve(f"line {at} has {len(cells)} cells, others {layout.width}")
        try:
            rows.append([layout.number(cells[i]) if cells[i] else np.nan for i in places])
        except ValueError:
            wrong = next(i for i in places if cells[i] and not layout.is_number(cells[i]))
            raise NoCurve(
                f"line {at}, column {wrong + 1}: '{cells[wrong][:40]}' is no number"
            ) from None
    return np.array(rows, dtype=float).reshape(-1, len(places))


def _rows(number: int, block: str, layout: _Layout) -> Iterator[tuple[int, Cells]]:
    """Line numbers and cells of the lines of a block that are neither blank nor comments."""
    for at, line in enumerate(block.split("\n"), start=number):
        if line.strip() and line.lstrip()[0] not in "#%":
            yield at, layout.cells(line.strip(" ") if layout.separator else line.strip())


def _words(text: str, layout: _Layout, place: int) -> np.ndarray:
    """The cells of a column of words, one a row: few words of many rows, each kept once."""
    known: dict[str, int] = {}
    rows = (
        cells
        for number, block in _blocks(text, layout)
        for _, cells in _rows(number, block, layout)
    )
    words = (cells[place] if len(cells) > place else "" for cells in rows)
    codes = np.fromiter((known.setdefault(word, len(known)) for word in words), dtype=np.int64)
    return np.array(list(known), dtype=object)[codes]


def _known(
    values: dict[str, np.ndarray], words: np.ndarray | None
) -> tuple[dict[str, np.ndarray], np.ndarray | None, tuple[str, ...]]:
    """The rows that have every number; NoCurve where more than half of them have not."""
    columns = np.column_stack(list(values.values()))
    if not len(columns):
        raise NoCurve("no line of numbers")
    known = np.isfinite(columns).all(axis=1) & (np.abs(columns) < LARGEST_MEASURED).all(axis=1)
    lost = int(np.count_nonzero(~known))
    if lost > MOST_UNKNOWN * len(known):
        raise NoCurve(f"{lost} of {len(known)} rows lack a number")
    if words is not None and len(words) != len(known):
        raise NoCurve("the column of parts has another length than the others")
    notes = (f"{lost} rows that lack a number are left out",) if lost else ()
    kept = {name: np.ascontiguousarray(column[known]) for name, column in values.items()}
    return kept, None if words is None else words[known], notes


def _rising(values: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """A way of the base that grows towards the body: turned round where the largest force stands at
    its low end.
    """
    if "z" not in values or "delta" in values or len(values["z"]) < 2:
        return values, ()
    z = values["z"]
    at = int(np.argmax(values["force"]))
    low = float(z.min())
    high = float(z.max())
    if z[at] - low >= high - z[at]:
        return values, ()
    return values | {"z": -z}, ("z falls towards the body: its sign is turned",)
