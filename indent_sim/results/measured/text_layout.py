"""Layout of a text table: separator, decimal sign, titles with their units, and its columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import DIMENSIONS, NoCurve

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
# These columns are heights above the body: they decrease while the tip moves inwards.
HEIGHT_TITLES = ("height", "height (measured)", "tip position")
DEFAULT_COLUMNS = {2: ("delta", "force")}
UNIT_AT_END = re.compile(
    r"^(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]|[ _,/]\s*(?P<bare>[a-zA-Zµμ]{1,3}))$"
)
Cells = list[str]


@dataclass(frozen=True)
class TextLayout:
    """Layout of a text table.

    Attributes
    ----------
    separator
        Character between cells; None for blanks.
    decimal
        Decimal sign, "." or ",".
    titles
        Column titles; empty without a header.
    first_row
        Index of the first line of numbers.
    width
        Number of columns.
    """

    separator: str | None
    decimal: str
    titles: tuple[str, ...]
    first_row: int
    width: int

    def cells(self, line: str) -> Cells:
        """Split a line into cells, without blanks and quotes."""
        return [cell.strip().strip("\"'") for cell in line.split(self.separator)]

    def number(self, cell: str) -> float:
        """Return the number in a cell; raise ValueError if there is none."""
        if "_" in cell:
            raise ValueError(cell)
        return float(cell.replace(self.decimal, ".") if self.decimal == "," else cell)

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return True


def detect_layout(text: str) -> TextLayout:
    """Detect the layout of a text table; raise NoCurve if it has no line of numbers.

    Separator and decimal sign are those of the line in the middle, which is likely to hold numbers;
    the header ends before the first line of numbers.
    """
    if not text.strip():
        raise NoCurve("the file is empty")
    middle = _middle_line(text)
    separator = next((sign for sign in ("\t", ";") if sign in middle), None)
    if separator is None and "," in middle and not _has_decimal_commas(middle):
        separator = ","
    decimal = "," if separator != "," and "," in middle else "."
    headless = TextLayout(separator, decimal, (), 0, 0)
    width = len(headless.cells(middle))
    # The first line of numbers is searched in these lines.
    max_lines = 2000
    head = text[: max_lines * 200].split("\n")[:max_lines]
    first = next((k for k, line in enumerate(head) if _is_number_row(headless, line, width)), None)
    if first is None:
        raise NoCurve("no line of numbers")
    return TextLayout(separator, decimal, _read_titles(headless, head[:first], width), first, width)


def _middle_line(text: str) -> str:
    """Return the first line from the middle on that is neither blank nor a comment."""
    begin = text.rfind("\n", 0, len(text) // 2) + 1
    # A longer line does not belong to a table of a curve.
    max_characters = 100_000
    for start in (begin, 0):
        for line in text[start : start + 10 * max_characters].split("\n"):
            if line.strip() and line.lstrip()[0] not in "#%":
                if len(line) > max_characters:
                    raise NoCurve(f"a line has more than {max_characters} characters")
                return line.strip()
    raise NoCurve("no line of numbers")


def _has_decimal_commas(line: str) -> bool:
    """Return whether commas are decimal signs of numbers between blanks, as in 0,1 2,5."""
    cells = line.split()
    return len(cells) > 1 and all(
        re.fullmatch(r"[-+]?\d*,?\d+(?:[eE][-+]?\d+)?", cell) for cell in cells
    )


def _is_number_row(layout: TextLayout, line: str, width: int) -> bool:
    """Return whether a line has the table's width, and numbers in at least half of its cells."""
    cells = layout.cells(line.strip())
    if len(cells) != width or line.lstrip()[:1] in ("#", "%", ""):
        return False
    return sum(layout.is_number(cell) for cell in cells) >= max(1, (width + 1) // 2)


def _read_titles(layout: TextLayout, head: Sequence[str], width: int) -> tuple[str, ...]:
    """Return the titles in the last line before the numbers.

    If this line contains units, it is joined with the titles above it.
    """
    lines = [line.strip().lstrip("#% ").strip() for line in head]
    rows = [cells for line in lines if line and len(cells := layout.cells(line)) == width]
    if not rows or not lines or layout.cells(lines[-1]) != rows[-1]:
        return ()
    *above, last = rows
    is_comment = next(line for line in reversed(head) if line.strip()).lstrip()[0] in "#%"
    # A comment whose words name no quantity of a curve is not a line of titles.
    if is_comment and width in DEFAULT_COLUMNS and not any(map(_is_column_title, last)):
        return ()
    units = [cell.strip("[]()") for cell in last]
    if above and any(units) and all(not unit or _is_unit(unit) for unit in units):
        return tuple(
            f"{name} [{unit}]" if unit else name
            for name, unit in zip(above[-1], units, strict=True)
        )
    return tuple(last)


def _is_column_title(cell: str) -> bool:
    """Return whether a cell names a quantity of a curve or contains a unit of such a quantity."""
    names = {split_title(cell, kind) for kind in ("length", "force", "time")}
    return any(unit for _, unit in names) or any(
        name in titles for name, _ in names for titles in COLUMN_TITLES.values()
    )


def _is_unit(text: str) -> bool:
    """Return whether a text is a unit of length, force or time."""
    return any(_is_unit_of(text, kind) for kind in ("length", "force", "time"))


def _is_unit_of(unit: str, kind: str) -> bool:
    """Return whether a text is a unit of this kind."""
    try:
        return si_factor(unit, kind) > 0
    except ConfigError:
        return False


def split_title(title: str, kind: str) -> tuple[str, str]:
    """Split a title such as Force [nN], force (nN) or Force nN into name and unit.

    The name is in lower case. The unit is "" if the title has no unit of this kind.
    """
    match = UNIT_AT_END.match(title.strip())
    unit = match and (match["unit"] or match["bare"])
    if match and unit and _is_unit_of(unit, kind):
        return match["name"].strip().lower(), unit.replace("μ", "µ")
    return title.strip().lower(), ""


def find_columns(layout: TextLayout, requested: Sequence[str] | None, file: str) -> dict[str, int]:
    """Return the column indices of delta, z, force, t and part, as far as the table has them.

    Parameters
    ----------
    layout
        Layout of the table.
    requested
        Titles or numbers (from 1) of depth, force and time that the user has given.
    file
        Name of the file, for messages.

    Raises
    ------
    NoCurve
        If there is no column of force or of depth.
    ConfigError
        If a requested column does not exist.
    """
    if requested:
        return {
            name: _column_index(layout, word, file)
            for name, word in zip(("delta", "force", "t"), requested, strict=False)
        }
    if not layout.titles:
        if layout.width not in DEFAULT_COLUMNS:
            if layout.width == 1:
                raise NoCurve("only one column, but a curve needs columns of depth and force")
            raise NoCurve(
                f"{layout.width} columns without a header: give the numbers of the columns of "
                "depth and force with --columns, e.g. --columns 1,2"
            )
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
            f"no column of {missing} among {', '.join(layout.titles)[:200]}: "
            "give the titles of the columns with --columns DEPTH,FORCE"
        )
    return columns


def _columns_by_unit(layout: TextLayout) -> dict[str, int]:
    """Return the columns of depth, force and time that are recognized by their units.

    A column is recognized if it is the only one whose unit has the wanted dimension. This works for
    titles in any language.
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
    """Return the index of a column by its title, with or without unit, or by its number from 1."""
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
