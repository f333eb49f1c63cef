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

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import (
    DIMENSIONS,
    MeasuredCurve,
    NoCurve,
    curve_parts,
    curve_parts_by_name,
)

HEAD_LINES = 2000  # in which the first line of numbers is looked for
MAX_LINE_CHARACTERS = 100_000  # letters
# letters that are taken apart at once: as lists of cells they fill some hundred megabytes
BLOCK_CHARACTERS = 1_000_000
MAX_INVALID_FRACTION = 0.5  # share of rows that may lack depth or force
LARGEST_MEASURED = 1e100  # of a measurement, whatever its unit
COLUMN_TITLES = {
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
HEIGHT_TITLES = (
    "height",
    "height (measured)",
    "tip position",
)  # of the tip above the body: they fall on the way in
DEFAULT_COLUMNS = {2: ("delta", "force")}
UNIT_AT_END = re.compile(
    r"^(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]|[ _,/]\s*(?P<bare>[a-zA-Zµμ]{1,3}))$"
)
Cells = list[str]


@dataclass(frozen=True)
class _TextLayout:
    """How a text is written: separator (None: blanks), decimal sign, titles (none without a
    header), first row.
    """

    separator: str | None
    decimal: str
    titles: tuple[str, ...]
    first_row: int
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


def read_text_curve(
    path: Path,
    data: bytes,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
) -> MeasuredCurve:
    """The curve of a text table, in its own units; `columns` [depth, force, time] by title or
    number from 1.

    NoCurve for what is no table of numbers, with the reason and the line; ConfigError for columns
    that are not there.
    """
    text = _decode(data)
    layout = _detect_layout(text)
    column_indices = _find_columns(layout, columns, str(path))
    units = {kind: (given or {}).get(kind, "") for kind in set(DIMENSIONS.values())}
    for column, index in column_indices.items():
        if (
            column in DIMENSIONS
            and layout.titles
            and (unit := _split_title(layout.titles[index], DIMENSIONS[column])[1])
        ):
            units[DIMENSIONS[column]] = unit
    numbers = {name: index for name, index in column_indices.items() if name != "part"}
    table = _read_numbers(text, layout, list(numbers.values()))
    values = {name: table[:, i] for i, name in enumerate(numbers)}
    words = _read_words(text, layout, column_indices["part"]) if "part" in column_indices else None
    values, words, notes = _complete_rows(values, words)
    for name in numbers:
        if (
            layout.titles
            and _split_title(layout.titles[numbers[name]], "length")[0] in HEIGHT_TITLES
        ):
            values[name] = -values[name]
    values, note = _orient_base_path(values)
    abscissa = values.get("delta", values.get("z"))
    assert abscissa is not None
    parts = curve_parts_by_name(words) if words is not None else curve_parts(abscissa)
    return MeasuredCurve(path.stem, parts=parts, units=units, notes=(*notes, *note), **values)  # type: ignore[arg-type]


def _decode(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return _normalize_text(data.decode("utf-16"))
        except UnicodeDecodeError:
            raise NoCurve("neither text nor a known AFM file") from None
    if b"\0" in data[:100_000]:
        raise NoCurve("neither text nor a known AFM file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return _normalize_text(text)


def _normalize_text(text: str) -> str:
    """The text with lines that end in one way, and with the minus that a computer reads."""
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return text.replace("\N{MINUS SIGN}", "-")


def _detect_layout(text: str) -> _TextLayout:
    """Separator and decimal sign by the line in the middle; the header ends before the first line
    of numbers.
    """
    if not text.strip():
        raise NoCurve("the file is empty")
    middle = _middle_line(text)
    separator = next((sign for sign in ("\t", ";") if sign in middle), None)
    if separator is None and "," in middle and not _has_decimal_commas(middle):
        separator = ","
    decimal = "," if separator != "," and "," in middle else "."
    shape = _TextLayout(separator, decimal, (), 0, 0)
    width = len(shape.cells(middle))
    head = text[: HEAD_LINES * 200].split("\n")[:HEAD_LINES]
    first = next((k for k, line in enumerate(head) if _is_number_row(shape, line, width)), None)
    if first is None:
        raise NoCurve("no line of numbers")
    return _TextLayout(separator, decimal, _read_titles(shape, head[:first], width), first, width)


def _middle_line(text: str) -> str:
    """The line in the middle of the text that is not blank nor a comment."""
    begin = text.rfind("\n", 0, len(text) // 2) + 1
    for start in (begin, 0):
        for line in text[start : start + 10 * MAX_LINE_CHARACTERS].split("\n"):
            if line.strip() and line.lstrip()[0] not in "#%":
                if len(line) > MAX_LINE_CHARACTERS:
                    raise NoCurve(f"a line of more than {MAX_LINE_CHARACTERS} letters")
                return line.strip()
    raise NoCurve("no line of numbers")


def _has_decimal_commas(line: str) -> bool:
    """Whether the commas of a line stand in numbers between blanks: 0,1 2,5."""
    cells = line.split()
    return len(cells) > 1 and all(
        re.fullmatch(r"[-+]?\d*,?\d+(?:[eE][-+]?\d+)?", cell) for cell in cells
    )


def _is_number_row(shape: _TextLayout, line: str, width: int) -> bool:
    """Whether most cells of a line are numbers, and it has the width of the others."""
    cells = shape.cells(line.strip())
    if len(cells) != width or line.lstrip()[:1] in ("#", "%", ""):
        return False
    return sum(shape.is_number(cell) for cell in cells) >= max(1, (width + 1) // 2)


def _read_titles(shape: _TextLayout, head: Sequence[str], width: int) -> tuple[str, ...]:
    """Titles of the last line before the numbers; a line of units below them is joined to them."""
    lines = [line.strip().lstrip("#% ").strip() for line in head]
    rows = [cells for line in lines if line and len(cells := shape.cells(line)) == width]
    if not rows or not lines or shape.cells(lines[-1]) != rows[-1]:
        return ()
    *above, last = rows
    is_comment = next(line for line in reversed(head) if line.strip()).lstrip()[0] in "#%"
    if (
        is_comment and width in DEFAULT_COLUMNS and not any(map(_is_column_title, last))
    ):  # words about something else
        return ()
    units = [cell.strip("[]()") for cell in last]
    if above and any(units) and all(not unit or _is_unit(unit) for unit in units):
        return tuple(
            f"{name} [{unit}]" if unit else name
            for name, unit in zip(above[-1], units, strict=True)
        )
    return tuple(last)


def _is_column_title(cell: str) -> bool:
    """Whether a cell names a column of a curve, or has a unit of one."""
    names = {_split_title(cell, kind) for kind in ("length", "force", "time")}
    return any(unit for _, unit in names) or any(
        name in titles for name, _ in names for titles in COLUMN_TITLES.values()
    )


def _is_unit(text: str) -> bool:
    return any(_is_unit_of(text, kind) for kind in ("length", "force", "time"))


def _is_unit_of(unit: str, kind: str) -> bool:
    try:
        return si_factor(unit, kind) > 0
    except ConfigError:
        return False


def _split_title(title: str, kind: str) -> tuple[str, str]:
    """Name in small letters and unit of a title such as Force [nN], force (nN), Force nN; ""
    without one.
    """
    match = UNIT_AT_END.match(title.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and _is_unit_of(unit, kind):
        return match["name"].strip().lower(), unit.replace("μ", "µ")
    return title.strip().lower(), ""


def _find_columns(
    layout: _TextLayout, requested: Sequence[str] | None, file: str
) -> dict[str, int]:
    """The places of delta, z, force, t and part."""
    if requested:
        return {
            name: _column_index(layout, word, file)
            for name, word in zip(("delta", "force", "t"), requested, strict=False)
        }
    if not layout.titles:
        if layout.width not in DEFAULT_COLUMNS:
            column_count = (
                "1 column" if layout.width == 1 else f"{layout.width} columns without a header"
            )
            raise NoCurve(f"{column_count}: say which with --columns DEPTH,FORCE")
        return {name: place for place, name in enumerate(DEFAULT_COLUMNS[layout.width])}
    columns: dict[str, int] = {}
    for name, known_titles in COLUMN_TITLES.items():
        kind = DIMENSIONS.get(name, "")
        titles = [
            _split_title(title, kind)[0] if kind else title.strip().lower()
            for title in layout.titles
        ]
        places = [titles.index(word) for word in known_titles if word in titles]
        if places:
            columns[name] = places[0]
    if not columns:
        columns = _columns_by_unit(layout)
    if "force" not in columns or not {"delta", "z"} & columns.keys():
        missing = "force" if "force" not in columns else "depth"
        raise NoCurve(
            f"no column of {missing} among {', '.join(layout.titles)[:200]}: say it with --columns"
        )
    return columns


def _columns_by_unit(layout: _TextLayout) -> dict[str, int]:
    """The only column of a length as depth and the only one of a force, whatever their titles are
    in.
    """
    columns = {}
    for name in ("delta", "force", "t"):
        places = [
            k for k, title in enumerate(layout.titles) if _split_title(title, DIMENSIONS[name])[1]
        ]
        if len(places) == 1:
            columns[name] = places[0]
    return columns


def _column_index(layout: _TextLayout, word: str, file: str) -> int:
    """The place of a column by its title, with or without its unit, or by its number from 1."""
    titles = [title.strip().lower() for title in layout.titles]
    unitless_titles = [
        _split_title(title, kind)[0]
        for kind in ("length", "force", "time")
        for title in layout.titles
    ]
    for names in (titles, unitless_titles):
        if word.strip().lower() in names:
            return names.index(word.strip().lower()) % len(titles)
    if word.isdecimal() and 1 <= int(word) <= layout.width:
        return int(word) - 1
    available = ", ".join(layout.titles) if layout.titles else f"columns 1 to {layout.width}"
    raise ConfigError("--columns", f"there is no column '{word}'", f"there are {available}", file)


def _read_numbers(text: str, layout: _TextLayout, places: Sequence[int]) -> np.ndarray:
    """The numbers (n, columns) of some columns; NoCurve names the first line that has none."""
    blocks = (
        _parse_block(number, block, layout, places) for number, block in _line_blocks(text, layout)
    )
    return np.concatenate([np.empty((0, len(places))), *blocks])


def _line_blocks(text: str, layout: _TextLayout) -> Iterator[tuple[int, str]]:
    """Pieces of whole lines below the titles, each with the number of its first line."""
    begin = 0
    number = layout.first_row + 1
    for _ in range(layout.first_row):
        begin = text.index("\n", begin) + 1
    while begin < len(text):
        end = text.find("\n", begin + BLOCK_CHARACTERS) + 1 or len(text)
        yield number, text[begin:end]
        number += text.count("\n", begin, end)
        begin = end


def _parse_block(number: int, block: str, layout: _TextLayout, places: Sequence[int]) -> np.ndarray:
    """The numbers of a block that begins at line `number`."""
    rows = block.replace(",", ".") if layout.decimal == "," else block
    comments = ["#", "%"] if "%" in block else "#"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            options = {"delimiter": layout.separator, "comments": comments, "ndmin": 2}
            numbers = np.loadtxt(io.StringIO(rows), usecols=places, **options)  # type: ignore[call-overload]
    except (ValueError, IndexError):
        return _parse_block_lines(number, block, layout, places)
    return numbers.reshape(-1, len(places))  # type: ignore[no-any-return]


def _parse_block_lines(
    number: int, block: str, layout: _TextLayout, places: Sequence[int]
) -> np.ndarray:
    """The same line by line, where cells are empty or in quotes; NoCurve with the line that is
    wrong.
    """
    rows = []
    for line_number, cells in _cell_rows(number, block, layout):
        if len(cells) <= max(places):
            raise NoCurve(f"line {line_number} has {len(cells)} cells, others {layout.width}")
        try:
            rows.append([layout.number(cells[i]) if cells[i] else np.nan for i in places])
        except ValueError:
            bad_column = next(i for i in places if cells[i] and not layout.is_number(cells[i]))
            raise NoCurve(
                f"line {line_number}, column {bad_column + 1}: '{cells[bad_column][:40]}' is no number"
            ) from None
    return np.array(rows, dtype=float).reshape(-1, len(places))


def _cell_rows(number: int, block: str, layout: _TextLayout) -> Iterator[tuple[int, Cells]]:
    """Line numbers and cells of the lines of a block that are neither blank nor comments."""
    for line_number, line in enumerate(block.split("\n"), start=number):
        if line.strip() and line.lstrip()[0] not in "#%":
            yield line_number, layout.cells(line.strip(" ") if layout.separator else line.strip())


def _read_words(text: str, layout: _TextLayout, place: int) -> np.ndarray:
    """The cells of a column of words, one a row: few words of many rows, each kept once."""
    word_codes: dict[str, int] = {}
    rows = (
        cells
        for number, block in _line_blocks(text, layout)
        for _, cells in _cell_rows(number, block, layout)
    )
    words = (cells[place] if len(cells) > place else "" for cells in rows)
    codes = np.fromiter(
        (word_codes.setdefault(word, len(word_codes)) for word in words), dtype=np.int64
    )
    return np.array(list(word_codes), dtype=object)[codes]


def _complete_rows(
    values: dict[str, np.ndarray], words: np.ndarray | None
) -> tuple[dict[str, np.ndarray], np.ndarray | None, tuple[str, ...]]:
    """The rows that have every number; NoCurve where more than half of them have not."""
    columns = np.column_stack(list(values.values()))
    if not len(columns):
        raise NoCurve("no line of numbers")
    is_complete = np.isfinite(columns).all(axis=1) & (np.abs(columns) < LARGEST_MEASURED).all(
        axis=1
    )
    invalid_count = int(np.count_nonzero(~is_complete))
    if invalid_count > MAX_INVALID_FRACTION * len(is_complete):
        raise NoCurve(f"{invalid_count} of {len(is_complete)} rows lack a number")
    if words is not None and len(words) != len(is_complete):
        raise NoCurve("the column of parts has another length than the others")
    notes = (f"{invalid_count} rows that lack a number are left out",) if invalid_count else ()
    kept = {name: np.ascontiguousarray(column[is_complete]) for name, column in values.items()}
    return kept, None if words is None else words[is_complete], notes


def _orient_base_path(
    values: dict[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """A way of the base that grows towards the body: turned round where the largest force stands at
    its low end.
    """
    if "z" not in values or "delta" in values or len(values["z"]) < 2:
        return values, ()
    z = values["z"]
    largest_force_row = int(np.argmax(values["force"]))
    low = float(z.min())
    high = float(z.max())
    if z[largest_force_row] - low >= high - z[largest_force_row]:
        return values, ()
    return values | {"z": -z}, ("z falls towards the body: its sign is turned",)
