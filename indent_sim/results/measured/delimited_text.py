"""Numbers of delimited text: any separator, decimal point or comma, and lines between the rows."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from indent_sim.results.measured.measurement import NoCurve
from indent_sim.results.measured.text_layout import (
    MAX_LINE_LENGTH,
    Cells,
    TextLayout,
    is_comment,
)

# Digits in groups of three that are separated by narrow or non-breaking spaces or apostrophes.
GROUPED_DIGITS = re.compile("(?<=\\d)[\u00a0\u2009\u202f'\u2019](?=\\d{3}(?!\\d))")
SEGMENT_COMMENT = re.compile(r"^[#%]+\s*segment\w*\s*[:=]\s*\"?(?P<word>[^\W\d]\w*)", re.IGNORECASE)
SEGMENT_COMMENTS = re.compile(SEGMENT_COMMENT.pattern, re.IGNORECASE | re.MULTILINE)
# Largest number of lines without numbers below the titles of a table.
MAX_MARKS = 20_000


@dataclass(frozen=True)
class TextRows:
    """Rows of a text table.

    Attributes
    ----------
    numbers
        Numbers (rows, columns) of the requested columns; NaN for an empty cell.
    words
        Words (rows,) of one column, or None.
    marks
        Lines without numbers, each with the number of rows above it.
    """

    numbers: np.ndarray
    words: np.ndarray | None
    marks: tuple[tuple[int, str], ...]


def decode(data: bytes) -> str:
    """Decode a text file in UTF-16, UTF-8 or Latin-1; raise NoCurve for a binary file."""
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


def read_rows(
    text: str, layout: TextLayout, columns: Sequence[int], word_column: int | None
) -> TextRows:
    """Return the rows of a table; raise NoCurve with the number of a line that is invalid."""
    reader = _RowReader(text, layout, columns)
    blocks = [reader.parse(number, block) for number, block in _line_blocks(text, layout)]
    numbers = np.concatenate([np.empty((0, len(columns))), *blocks])
    words = None
    if word_column is not None:
        words = _read_words(text, layout, word_column, reader)
        if len(words) != len(numbers):
            raise NoCurve("the column of segments and the others have different lengths")
    return TextRows(numbers, words, tuple(reader.marks))


def _normalize_text(text: str) -> str:
    """Return the text with newlines as line ends, ASCII minus signs, and whole numbers."""
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    text = text.replace("\N{MINUS SIGN}", "-")
    # A minus sign or a space of UTF-8 that was decoded as Latin-1.
    text = text.replace("\u00c2\u00b5", "\u00b5") if "\u00c2\u00b5" in text else text
    if any(mark in text for mark in "\u00a0\u2009\u202f'\u2019"):
        return GROUPED_DIGITS.sub("", text)
    return text


def _line_blocks(text: str, layout: TextLayout) -> Iterator[tuple[int, str]]:
    """Yield blocks of whole lines below the titles, each with the number of its first line."""
    begin = 0
    number = layout.first_row + 1
    for _ in range(layout.first_row):
        begin = text.index("\n", begin) + 1
    # Number of characters that are parsed at once; as lists of cells they take some hundred
    # megabytes.
    block_characters = 1_000_000
    while begin < len(text):
        end = text.find("\n", begin + block_characters) + 1 or len(text)
        yield number, text[begin:end]
        number += text.count("\n", begin, end)
        begin = end


class _RowReader:
    """Parser of the blocks of a table, which counts the rows and keeps the marks."""

    def __init__(self, text: str, layout: TextLayout, columns: Sequence[int]):
        self.layout = layout
        self.columns = list(columns)
        self.marks: list[tuple[int, str]] = []
        self.count = 0
        self.is_repeated = bool(layout.title_line) and (
            text.startswith(f"{layout.title_line}\n") + text.count(f"\n{layout.title_line}\n") > 1
        )
        has_segments = bool(SEGMENT_COMMENTS.search(text))
        is_unusual = bool(layout.thousands) or layout.has_margin
        self.is_plain = not (self.is_repeated or has_segments or is_unusual)

    def parse(self, number: int, block: str) -> np.ndarray:
        """Return the numbers (rows, columns) of a block that begins at line `number`."""
        rows = self._parse_plain(block) if self.is_plain and '"' not in block else None
        if rows is None:
            rows = self._parse_lines(number, block)
        self.count += len(rows)
        return rows

    def lines(self, number: int, block: str) -> Iterator[tuple[int, Cells | None, str]]:
        """Yield number, cells and text of the lines that are not blank; a mark has no cells."""
        for line_number, line in enumerate(block.split("\n"), start=number):
            if not line.strip():
                continue
            if len(line) > MAX_LINE_LENGTH:
                raise NoCurve(f"line {line_number} has more than {MAX_LINE_LENGTH} characters")
            if is_comment(line):
                if SEGMENT_COMMENT.match(line.strip()):
                    yield line_number, None, line
                continue
            cells = self.layout.cells(line)
            yield line_number, None if self._is_mark(cells) else cells, line

    def _parse_plain(self, block: str) -> np.ndarray | None:
        """Return the numbers of a block of numbers and comments only; None for any other block."""
        layout = self.layout
        rows = block.replace(",", ".") if layout.decimal == "," else block
        comments = ["#", "%"] if "%" in block else "#"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                options = {"delimiter": layout.separator, "comments": comments, "ndmin": 2}
                numbers = np.loadtxt(  # type: ignore[call-overload]
                    io.StringIO(rows), usecols=self.columns, **options
                )
        except (ValueError, IndexError):
            return None
        return numbers.reshape(-1, len(self.columns))  # type: ignore[no-any-return]

    def _parse_lines(self, number: int, block: str) -> np.ndarray:
        """Parse a block line by line; raise NoCurve with the number of an invalid line."""
        layout = self.layout
        rows: list[list[float]] = []
        for line_number, cells, line in self.lines(number, block):
            if cells is None:
                self.marks.append((self.count + len(rows), line.strip()))
                if len(self.marks) > MAX_MARKS:
                    raise NoCurve(f"more than {MAX_MARKS} lines without numbers below the titles")
                continue
            if len(cells) <= max(self.columns):
                raise NoCurve(
                    f"line {line_number} has {len(cells)} cells, the other lines {layout.width}"
                )
            try:
                rows.append([layout.number(cells[i]) if cells[i] else np.nan for i in self.columns])
            except ValueError:
                bad_column = next(
                    i for i in self.columns if cells[i] and not layout.is_number(cells[i])
                )
                place = f"line {line_number}, column {bad_column + 1}"
                raise NoCurve(f"{place}: '{cells[bad_column][:40]}' is not a number") from None
        return np.array(rows, dtype=float).reshape(-1, len(self.columns))

    def _is_mark(self, cells: Cells) -> bool:
        """Return whether a line contains words between rows and is not a row of the table."""
        filled = [cell for cell in cells if cell]
        numbers = sum(map(self.layout.is_number, filled))
        if self.is_repeated:
            # In the header of a further table the number of cells is arbitrary.
            needed = [cells[i] if i < len(cells) else "" for i in self.columns]
            return len(cells) != self.layout.width or not all(
                self.layout.is_number(cell) or not cell for cell in needed
            )
        return bool(filled) and not numbers


def _read_words(text: str, layout: TextLayout, column: int, reader: _RowReader) -> np.ndarray:
    """Return a column of words (rows,); equal words share one string to save memory."""
    word_codes: dict[str, int] = {}
    rows = (
        cells
        for number, block in _line_blocks(text, layout)
        for _, cells, _ in reader.lines(number, block)
        if cells is not None
    )
    words = (cells[column] if len(cells) > column else "" for cells in rows)
    codes = np.fromiter(
        (word_codes.setdefault(word, len(word_codes)) for word in words), dtype=np.int64
    )
    return np.array(list(word_codes), dtype=object)[codes]
