"""Reader of delimited text: any separator, decimal point or comma, with or without a header."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from indent_sim.results.measured.measurement import (
    DIMENSIONS,
    MeasuredCurve,
    NoCurve,
    curve_parts,
    curve_parts_by_name,
)
from indent_sim.results.measured.text_layout import (
    HEIGHT_TITLES,
    Cells,
    TextLayout,
    detect_layout,
    find_columns,
    split_title,
)


def read_text_curve(
    path: Path,
    data: bytes,
    columns: Sequence[str] | None = None,
    given: Mapping[str, str] | None = None,
) -> MeasuredCurve:
    """Read the curve of a text table, in its own units.

    Parameters
    ----------
    path
        The file; the curve gets its name.
    data
        Its content.
    columns
        Titles or numbers (from 1) of the columns of depth, force and time; by default they are
        found by their titles or units.
    given
        Units by kind, "length", "force" and "time", for columns whose titles have none.

    Raises
    ------
    NoCurve
        If the file is not a table of numbers; the message gives the reason and the line.
    ConfigError
        A column of `columns` does not exist.
    """
    text = _decode(data)
    layout = detect_layout(text)
    column_indices = find_columns(layout, columns, str(path))
    units = {kind: (given or {}).get(kind, "") for kind in set(DIMENSIONS.values())}
    for column, index in column_indices.items():
        if (
            column in DIMENSIONS
            and layout.titles
            and (unit := split_title(layout.titles[index], DIMENSIONS[column])[1])
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
            and split_title(layout.titles[numbers[name]], "length")[0] in HEIGHT_TITLES
        ):
            values[name] = -values[name]
    values, note = _orient_base_path(values)
    abscissa = values.get("delta", values.get("z"))
    assert abscissa is not None
    parts = curve_parts_by_name(words) if words is not None else curve_parts(abscissa)
    notes = (*notes, *note)
    return MeasuredCurve(
        path.stem,
        parts=parts,
        units=units,
        notes=notes,
        **values,  # type: ignore[arg-type]
    )


def _decode(data: bytes) -> str:
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


def _normalize_text(text: str) -> str:
    """Return the text with newlines as line ends, and with ASCII minus signs."""
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return text.replace("\N{MINUS SIGN}", "-")


def _read_numbers(text: str, layout: TextLayout, column_indices: Sequence[int]) -> np.ndarray:
    """Return the numbers (rows, columns) of some columns; NoCurve names an invalid line."""
    blocks = (
        _parse_block(number, block, layout, column_indices)
        for number, block in _line_blocks(text, layout)
    )
    return np.concatenate([np.empty((0, len(column_indices))), *blocks])


def _line_blocks(text: str, layout: TextLayout) -> Iterator[tuple[int, str]]:
    """Yield blocks of whole lines below the titles, each with the number of its first line."""
    begin = 0
    number = layout.first_row + 1
    for _ in range(layout.first_row):
        begin = text.index("\n", begin) + 1
    # So many characters are parsed at once: as lists of cells they take some hundred
    # megabytes.
    block_characters = 1_000_000
    while begin < len(text):
        end = text.find("\n", begin + block_characters) + 1 or len(text)
        yield number, text[begin:end]
        number += text.count("\n", begin, end)
        begin = end


def _parse_block(
    number: int, block: str, layout: TextLayout, column_indices: Sequence[int]
) -> np.ndarray:
    """Return the numbers (rows, columns) of a block that begins at line `number`."""
    rows = block.replace(",", ".") if layout.decimal == "," else block
    comments = ["#", "%"] if "%" in block else "#"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            options = {"delimiter": layout.separator, "comments": comments, "ndmin": 2}
            numbers = np.loadtxt(  # type: ignore[call-overload]
                io.StringIO(rows), usecols=column_indices, **options
            )
    except (ValueError, IndexError):
        return _parse_block_lines(number, block, layout, column_indices)
    return numbers.reshape(-1, len(column_indices))  # type: ignore[no-any-return]


def _parse_block_lines(
    number: int, block: str, layout: TextLayout, column_indices: Sequence[int]
) -> np.ndarray:
    """Parse a block with empty or quoted cells line by line; NoCurve names an invalid line."""
    rows = []
    for line_number, cells in _cell_rows(number, block, layout):
        if len(cells) <= max(column_indices):
            raise NoCurve(
                f"line {line_number} has {len(cells)} cells, the other lines {layout.width}"
            )
        try:
            rows.append([layout.number(cells[i]) if cells[i] else np.nan for i in column_indices])
        except ValueError:
            bad_column = next(
                i for i in column_indices if cells[i] and not layout.is_number(cells[i])
            )
            place = f"line {line_number}, column {bad_column + 1}"
            raise NoCurve(f"{place}: '{cells[bad_column][:40]}' is not a number") from None
    return np.array(rows, dtype=float).reshape(-1, len(column_indices))


def _cell_rows(number: int, block: str, layout: TextLayout) -> Iterator[tuple[int, Cells]]:
    """Yield line numbers and cells of the lines of a block that are neither blank nor comments."""
    for line_number, line in enumerate(block.split("\n"), start=number):
        if line.strip() and line.lstrip()[0] not in "#%":
            yield line_number, layout.cells(line.strip(" ") if layout.separator else line.strip())


def _read_words(text: str, layout: TextLayout, column_index: int) -> np.ndarray:
    """Return a column of words (rows,); equal words share one string to save memory."""
    word_codes: dict[str, int] = {}
    rows = (
        cells
        for number, block in _line_blocks(text, layout)
        for _, cells in _cell_rows(number, block, layout)
    )
    words = (cells[column_index] if len(cells) > column_index else "" for cells in rows)
    codes = np.fromiter(
        (word_codes.setdefault(word, len(word_codes)) for word in words), dtype=np.int64
    )
    return np.array(list(word_codes), dtype=object)[codes]


def _complete_rows(
    values: dict[str, np.ndarray], words: np.ndarray | None
) -> tuple[dict[str, np.ndarray], np.ndarray | None, tuple[str, ...]]:
    """Return the rows without missing numbers, and notes about the rows that are left out.

    Raises NoCurve if more than half of the rows are incomplete.
    """
    columns = np.column_stack(list(values.values()))
    if not len(columns):
        raise NoCurve("no line of numbers")
    # A larger number is no measurement, whatever its unit.
    largest_measured = 1e100
    is_complete = np.isfinite(columns).all(axis=1) & (np.abs(columns) < largest_measured).all(
        axis=1
    )
    invalid_count = int(np.count_nonzero(~is_complete))
    # No more than this fraction of the rows may lack a number.
    max_invalid_fraction = 0.5
    if invalid_count > max_invalid_fraction * len(is_complete):
        raise NoCurve(f"{invalid_count} of {len(is_complete)} rows lack a number")
    if words is not None and len(words) != len(is_complete):
        raise NoCurve("the column of parts and the others have different lengths")
    notes = (f"{invalid_count} rows that lack a number are left out",) if invalid_count else ()
    complete_columns = {
        name: np.ascontiguousarray(column[is_complete]) for name, column in values.items()
    }
    return complete_columns, None if words is None else words[is_complete], notes


def _orient_base_path(
    values: dict[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return z increasing towards the body, and a note if its sign was reversed.

    The sign is reversed if the largest force is measured at the small values of z.
    """
    if "z" not in values or "delta" in values or len(values["z"]) < 2:
        return values, ()
    z = values["z"]
    largest_force_row = int(np.argmax(values["force"]))
    low = float(z.min())
    high = float(z.max())
    if z[largest_force_row] - low >= high - z[largest_force_row]:
        return values, ()
    return values | {"z": -z}, ("z decreases towards the body: its sign is reversed",)
