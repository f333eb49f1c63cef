"""TODO."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import DIMENSIONS, NoCurve

HEAD_LINES = 2000  # in which the first line of numbers is looked for
MAX_LINE_CHARACTERS = 100_000  # letters
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
class TextLayout:
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


def detect_layout(text: str) -> TextLayout:
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
    shape = TextLayout(separator, decimal, (), 0, 0)
    width = len(shape.cells(middle))
    head = text[: HEAD_LINES * 200].split("\n")[:HEAD_LINES]
    first = next((k for k, line in enumerate(head) if _is_number_row(shape, line, width)), None)
    if first is None:
        raise NoCurve("no line of numbers")
    return TextLayout(separator, decimal, _read_titles(shape, head[:first], width), first, width)


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


def _is_number_row(shape: TextLayout, line: str, width: int) -> bool:
    """Whether most cells of a line are numbers, and it has the width of the others."""
    cells = shape.cells(line.strip())
    if len(cells) != width or line.lstrip()[:1] in ("#", "%", ""):
        return False
    return sum(shape.is_number(cell) for cell in cells) >= max(1, (width + 1) // 2)


def _read_titles(shape: TextLayout, head: Sequence[str], width: int) -> tuple[str, ...]:
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
    names = {split_title(cell, kind) for kind in ("length", "force", "time")}
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


def split_title(title: str, kind: str) -> tuple[str, str]:
    """Name in small letters and unit of a title such as Force [nN], force (nN), Force nN; ""
    without one.
    """
    match = UNIT_AT_END.match(title.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and _is_unit_of(unit, kind):
        return match["name"].strip().lower(), unit.replace("μ", "µ")
    return title.strip().lower(), ""


def find_columns(layout: TextLayout, requested: Sequence[str] | None, file: str) -> dict[str, int]:
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
            split_title(title, kind)[0] if kind else title.strip().lower()
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


def _columns_by_unit(layout: TextLayout) -> dict[str, int]:
    """The only column of a length as depth and the only one of a force, whatever their titles are
    in.
    """
    columns = {}
    for name in ("delta", "force", "t"):
        places = [
            k for k, title in enumerate(layout.titles) if split_title(title, DIMENSIONS[name])[1]
        ]
        if len(places) == 1:
            columns[name] = places[0]
    return columns


def _column_index(layout: TextLayout, word: str, file: str) -> int:
    """The place of a column by its title, with or without its unit, or by its number from 1."""
    titles = [title.strip().lower() for title in layout.titles]
    unitless_titles = [
        split_title(title, kind)[0]
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
