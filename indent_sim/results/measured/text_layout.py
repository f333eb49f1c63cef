"""Layout of a text table: separator, decimal sign, thousands mark, titles, and its header."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from indent_sim.results.measured.column_titles import (
    ColumnTitle,
    is_known_name,
    is_unit_text,
    parse_title,
    unit_and_kind,
)
from indent_sim.results.measured.measurement import NoCurve

COMMENT_SIGNS = "#%"
# Lines of the header that JPK's software writes above the table of a segment.
JPK_LINE = re.compile(r"(columns|fancyNames|units):\s*(.*)")
# Words that are separated by blanks, or enclosed in quotes.
WORDS = re.compile(r'"([^"]*)"|(\S+)')
PLAIN_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf(?:inity)?)")
# Largest length of a line, and largest number of columns, of the table of a curve.
MAX_LINE_LENGTH = 100_000
MAX_COLUMNS = 1000
# Number of lines in which the first line of numbers is searched.
MAX_HEAD_LINES = 4000
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
    thousands
        Mark between groups of three digits, or "".
    titles
        Column titles; empty without a header.
    first_row
        Index of the first line of numbers.
    width
        Number of columns.
    title_line
        Line of the titles, "" if there is none.
    head
        Lines above the numbers.
    has_margin
        Whether the rows begin with a separator.
    other_titles
        Line of titles above the numbers with another number of cells; "" if there is none.
    notes
        Sentences about assumptions.
    """

    separator: str | None
    decimal: str = "."
    thousands: str = ""
    titles: tuple[ColumnTitle, ...] = ()
    first_row: int = 0
    width: int = 0
    title_line: str = ""
    head: tuple[str, ...] = ()
    has_margin: bool = False
    other_titles: str = ""
    notes: tuple[str, ...] = ()

    def cells(self, line: str) -> Cells:
        """Split a line into cells, without blanks and quotes."""
        if self.separator is None:
            return [cell.strip("\"'") for cell in line.split()]
        line = line.strip(" ")
        if self.has_margin:
            line = line.removeprefix(self.separator)
        if '"' in line:
            try:
                (cells,) = csv.reader([line], delimiter=self.separator, skipinitialspace=True)
            except (csv.Error, ValueError):
                cells = line.split(self.separator)
        else:
            cells = line.split(self.separator)
        return [cell.strip().strip("\"'") for cell in cells]

    def number(self, cell: str) -> float:
        """Return the number in a cell; raise ValueError if there is none."""
        if "_" in cell:
            raise ValueError(cell)
        if self.thousands and self.thousands in cell:
            whole, sign, fraction = cell.partition(self.decimal)
            if not _is_grouped(whole, self.thousands):
                raise ValueError(cell)
            cell = whole.replace(self.thousands, "") + sign + fraction
        return float(cell.replace(",", ".") if self.decimal == "," else cell)

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number."""
        try:
            self.number(cell)
        except ValueError:
            return False
        return True


def detect_layout(text: str) -> TextLayout:
    """Detect the layout of a text table; raise NoCurve if it has no line of numbers.

    Separator and signs are found from lines in the middle of the text, which are likely to contain
    numbers. The header ends before the first line that has numbers in the same columns.
    """
    if not text.strip():
        raise NoCurve("the file is empty")
    lines = list(_middle_lines(text))
    middle = next((line for line in lines if _is_mainly_numbers(line)), lines[0] if lines else "")
    if not middle:
        raise NoCurve("no line of numbers")
    separator = _separator(middle)
    layout = TextLayout(separator)
    width = len(layout.cells(middle))
    numbers = [line for line in lines if _is_mainly_numbers(line)]
    similar = [line for line in numbers if len(layout.cells(line)) == width]
    if separator is not None and all(line.startswith(separator) for line in similar):
        layout = replace(layout, has_margin=True)
    layout = _apply_signs(layout, similar)
    cells = layout.cells(middle)
    if len(cells) > MAX_COLUMNS:
        raise NoCurve(f"{len(cells)} columns: not the table of a curve")
    layout = replace(layout, width=len(cells))
    numeric_columns = [k for k, cell in enumerate(cells) if layout.is_number(cell)]
    head = text[: MAX_HEAD_LINES * 200].split("\n")[:MAX_HEAD_LINES]
    first = next(
        (k for k, line in enumerate(head) if _is_number_row(layout, line, numeric_columns)), None
    )
    if first is None or not numeric_columns:
        raise NoCurve("no line of numbers")
    layout = replace(layout, first_row=first, head=tuple(head[:first]))
    titles, title_line = _read_titles(layout)
    other_titles = "" if titles else _other_titles(layout)
    return replace(layout, titles=titles, title_line=title_line, other_titles=other_titles)


def is_comment(line: str) -> bool:
    """Return whether a line is a comment."""
    return line.lstrip()[:1] in tuple(COMMENT_SIGNS)


def _middle_lines(text: str) -> Iterator[str]:
    """Yield the lines, except blank lines and comments, from the middle on, then from the start.

    Raises NoCurve if a line is too long for a table.
    """
    begin = text.rfind("\n", 0, len(text) // 2) + 1
    # Number of lines of the table from which the decimal sign is found.
    sampled_lines = 300
    for start in (begin, 0):
        count = 0
        for line in text[start : start + 10 * MAX_LINE_LENGTH].split("\n"):
            if not line.strip() or is_comment(line):
                continue
            if len(line) > MAX_LINE_LENGTH:
                raise NoCurve(f"a line has more than {MAX_LINE_LENGTH} characters")
            yield line
            count += 1
            if count == sampled_lines:
                break


def _separator(line: str) -> str | None:
    """Return the character between the cells of a line of numbers, None for blanks."""
    for sign in ("\t", ";"):
        if sign in line.strip(" "):
            return sign
    return "," if "," in line and not _has_decimal_commas(line) else None


def _has_decimal_commas(line: str) -> bool:
    """Return whether commas are decimal signs of numbers between blanks, as in 0,1 2,5."""
    cells = line.split()
    return len(cells) > 1 and all(
        re.fullmatch(r"[-+]?\d*,?\d+(?:[eE][-+]?\d+)?", cell) for cell in cells
    )


def _is_mainly_numbers(line: str) -> bool:
    """Return whether half of the cells of a line or more are numbers with any signs."""
    cells = [cell for cell in TextLayout(_separator(line)).cells(line) if cell]
    plain = [re.sub(r"(?<=\d)[.,](?=\d)", "", cell) for cell in cells]
    numbers = sum(bool(PLAIN_NUMBER.fullmatch(cell.lower())) for cell in plain)
    return numbers > 0 and 2 * numbers >= len(cells)


def _apply_signs(layout: TextLayout, lines: Sequence[str]) -> TextLayout:
    """Return the layout with the decimal sign and the thousands mark that some lines use.

    The last one of two different signs in a number is the decimal sign; a sign that occurs twice is
    the thousands mark.
    """
    marks: Counter[str] = Counter()
    for line in lines:
        for cell in layout.cells(line):
            if re.fullmatch(r"[-+]?[\d.,]*\d[\d.,]*(?:[eE][-+]?\d+)?", cell):
                marks.update(_signs_of_number(cell))
    if marks["1.2,3"] or marks["1.2.3"]:
        if marks["1,2.3"] or marks["1,2,3"]:
            raise NoCurve("some numbers have a decimal point and others a decimal comma")
        return replace(layout, decimal=",", thousands=".")
    if marks["1,2.3"] or marks["1,2,3"]:
        return replace(layout, thousands=",")
    if not (marks["1,2"] or marks["1,234"]):
        return layout
    if marks["1.2"] or marks["1.234"]:
        # Commas are thousands marks if each of them is followed by three digits.
        if marks["1,2"]:
            raise NoCurve("some numbers have a decimal point and others a decimal comma")
        return replace(layout, thousands=",")
    notes = () if marks["1,2"] else ("a comma before three digits is read as a decimal sign",)
    return replace(layout, decimal=",", notes=notes)


def _signs_of_number(cell: str) -> list[str]:
    """Return the patterns in a number that determine the decimal sign; an integer has none."""
    digits = re.sub(r"[eE].*", "", cell)
    signs = re.sub(r"[^.,]", "", digits)
    if not signs:
        return []
    sign = signs[0]
    if len(set(signs)) == 2:
        whole = digits.rpartition(signs[-1])[0]
        form = "1.2,3" if signs[-1] == "," else "1,2.3"
        return [form] if _is_grouped(whole, sign) else []
    if len(signs) > 1:
        return [f"1{sign}2{sign}3"] if _is_grouped(digits, sign) else []
    is_group = digits.lstrip("+-")[:1] != "0" and _is_grouped(digits, sign)
    return [f"1{sign}234" if is_group else f"1{sign}2"]


def _is_grouped(whole: str, mark: str) -> bool:
    """Return whether digits are in groups of three."""
    return bool(re.fullmatch(rf"[-+]?\d{{1,3}}(?:{re.escape(mark)}\d{{3}})+", whole))


def _is_number_row(layout: TextLayout, line: str, numeric_columns: Sequence[int]) -> bool:
    """Return whether a line has the table's width, and numbers in the numeric columns."""
    if not line.strip() or is_comment(line):
        return False
    cells = layout.cells(line)
    if len(cells) != layout.width:
        return False
    numbers = [layout.is_number(cells[k]) for k in numeric_columns]
    is_blank = [not cells[k] for k in numeric_columns]
    return any(numbers) and all(a or b for a, b in zip(numbers, is_blank, strict=True))


def _read_titles(layout: TextLayout) -> tuple[tuple[ColumnTitle, ...], str]:
    """Return the titles above the numbers and their line; empty if there are none.

    Between titles and numbers there may be blank lines, one or two lines of units, and a line that
    marks the end of the header.
    """
    if (titles := _jpk_titles(layout)) is not None:
        return titles
    units: Cells = []
    skipped = 0
    last_unit_line = ""
    # Number of lines above the numbers in which titles are searched.
    max_title_lines = 60
    for line in reversed(layout.head[-max_title_lines:]):
        # A separator at the beginning belongs to an empty first cell.
        text = line.strip(" \r").lstrip(COMMENT_SIGNS).strip(" ")
        if not text.strip():
            continue
        cells = _title_cells(layout, text)
        if cells is None:
            skipped += 1
            # Largest number of lines between the titles and the numbers.
            if skipped > 3:
                break
            continue
        if not any(cells):
            continue
        if all(map(is_unit_text, cells)):
            if not any(unit_and_kind(cell.strip("[]() "))[1] for cell in units):
                units = cells
                last_unit_line = line
            continue
        if (is_comment(line) or skipped) and not any(map(_is_column_title, cells)):
            skipped += 1
            continue
        return _join_titles(cells, units), line
    if units:
        return _join_titles([""] * len(units), units), last_unit_line
    return (), ""


def _other_titles(layout: TextLayout) -> str:
    """Return the last line above the numbers if its cells are titles of other columns, else ""."""
    line = next((line for line in reversed(layout.head) if line.strip()), "")
    if is_comment(line) or len(line) > MAX_LINE_LENGTH:
        return ""
    cells = [cell for cell in layout.cells(line) if cell]
    return line.strip() if len(cells) > 1 and any(map(_is_column_title, cells)) else ""


def _jpk_titles(layout: TextLayout) -> tuple[tuple[ColumnTitle, ...], str] | None:
    """Return the titles in the header of a JPK export, None if there are none."""
    lines = {}
    for line in layout.head:
        if is_comment(line) and (match := JPK_LINE.match(line.lstrip(COMMENT_SIGNS + " "))):
            lines[match[1]] = [a or b for a, b in WORDS.findall(match[2])]
    rows = [cells for cells in lines.values() if len(cells) == layout.width]
    if "columns" not in lines or not rows:
        return None
    names = lines.get("fancyNames", lines["columns"])
    if len(names) != layout.width:
        names = lines["columns"]
    units = lines.get("units", [])
    if len(names) != layout.width:
        return None
    return _join_titles(names, units if len(units) == layout.width else []), ""


def _join_titles(names: Cells, units: Cells) -> tuple[ColumnTitle, ...]:
    """Return titles with the units of a line below them."""
    titles = []
    for k, name in enumerate(names):
        title = parse_title(name)
        unit, kind = unit_and_kind(units[k].strip("[]() ")) if units else ("", "")
        if kind:
            title = replace(title, unit=unit, kind=kind, unknown_unit="")
        elif units and (word := units[k].strip("[]() ")) and not is_unit_text(word):
            title = replace(title, unknown_unit=word)
        titles.append(replace(title, text=title.text or f"[{unit}]"))
    return tuple(titles)


def _title_cells(layout: TextLayout, text: str) -> Cells | None:
    """Return the cells of a line of titles; None unless there is one cell for each column."""
    # Words that Igor writes before the names of the columns.
    text = re.sub(r"^WAVES(?:/\w)*\s+", "", re.sub(" {3,}", "  ", text[:MAX_LINE_LENGTH]))
    splits = [layout.cells(text)]
    if layout.separator is None:
        splits += [
            [cell.strip() for cell in re.split(r"\t|\s{2,}", text)],
            [a or b for a, b in WORDS.findall(text)],
            re.sub(r"\s+(?=[\[(])", "_", text).split(),
        ]
    for cells in splits:
        while len(cells) > layout.width and not cells[-1]:
            cells = cells[:-1]
        if 1 < len(cells) == layout.width - 1 and layout.separator is not None:
            cells = [*cells, ""]
        if len(cells) == layout.width:
            return cells
    return None


def _is_column_title(cell: str) -> bool:
    """Return whether a cell names a quantity of a curve or contains a unit of such a quantity."""
    title = parse_title(cell)
    return bool(title.kind) or is_known_name(title.name)
