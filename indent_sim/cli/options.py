"""Types, parsers and texts of the options of commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class NumberInRange(click.FloatRange):
    """Type of an option: a number in a range, but not NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number of a text."""
        number: float = super().convert(value, param, ctx)
        if number != number:
            self.fail(f"'{value}' is not a number.", param, ctx)
        return number


PATH = click.Path(path_type=Path)
FRACTION = NumberInRange(0, 1, min_open=True, max_open=True)


def complete_keys(ctx: click.Context, option: click.Parameter, typed_text: str) -> list[str]:
    """Return the keys of a scene that begin with the typed text, for completion in a shell."""
    from indent_sim.config.schema import file_order, sections

    keys = {
        f"{section}.{name}="
        for section, kinds in sections().items()
        for kind in kinds
        for name in file_order(kind)
    }
    return sorted(key for key in keys if key.startswith(typed_text))


def complete_fields(ctx: click.Context, option: click.Parameter, typed_text: str) -> list[str]:
    """Return field names that complete the text after its last comma."""
    from indent_sim.results.pictures.fields import FIELDS

    before, comma, word = typed_text.rpartition(",")
    return [f"{before}{comma}{name}" for name in FIELDS if name.startswith(word)]


set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=complete_keys,
    help="Replace one key, e.g. contact.method=penalty.",
)


def parse_shard(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return the two numbers of a shard "I/N"."""
    if text is None:
        return None
    index, slash, count = text.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise click.BadParameter(f"'{text}' is not I/N with 1 <= I <= N, for example 2/8")
    return int(index), int(count)


def parse_words(ctx: click.Context, option: click.Parameter, text: str | None) -> tuple[str, ...]:
    """Return words separated by commas."""
    words = tuple(word.strip() for word in text.split(",")) if text is not None else ()
    if not all(words):
        raise click.BadParameter(f"'{text}' contains an empty word")
    return words


def parse_pairs(ctx: click.Context, option: click.Parameter, text: str | None) -> dict[str, str]:
    """Return NAME=VALUE pairs separated by commas."""
    pairs = [word.partition("=") for word in parse_words(ctx, option, text)]
    if wrong := next(
        (name for name, equals, value in pairs if not (name.strip() and equals and value.strip())),
        None,
    ):
        raise click.BadParameter(f"'{wrong}' is not NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in pairs}


def parse_layout(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return the two numbers of ROWSxCOLUMNS."""
    if text is None:
        return None
    rows, x, columns = text.lower().partition("x")
    if not (x and rows.isdecimal() and columns.isdecimal() and int(rows) and int(columns)):
        raise click.BadParameter(f"'{text}' is not ROWSxCOLUMNS, for example 1x3")
    return int(rows), int(columns)


def parse_pixel(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return the two numbers of ROW,COLUMN."""
    if text is None:
        return None
    row, comma, column = text.partition(",")
    if not (comma and row.isdecimal() and column.isdecimal()):
        raise click.BadParameter(f"'{text}' is not ROW,COLUMN, for example 12,40")
    return int(row), int(column)


def parse_rows(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    """Return the two numbers of a text A:B, the second of which is larger."""
    if text is None:
        return None
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise click.BadParameter(f"'{text}' is not A:B with A < B, for example 0:32")
    return int(first), int(end)


def parse_limits(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """Return the two numbers of a text A:B."""
    if text is None:
        return None
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise click.BadParameter(f"'{text}' is not A:B, for example 0:250") from None
    return low, high


def parse_top(
    ctx: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """Return two fractions from a text A:B in per cent, the larger one first."""
    limits = parse_limits(ctx, option, text)
    if limits is None:
        return None
    low, high = sorted(limits)
    # Smaller numbers are probably meant as fractions.
    if not (1 <= low < high <= 100):
        raise click.BadParameter(
            f"'{text}' is not A:B in per cent of the largest force, for example 98:40"
        )
    return high / 100, low / 100


def parse_zoom(ctx: click.Context, option: click.Parameter, text: str | None) -> float | None:
    """Return the zoom in contact radii; infinity for "all"."""
    if text is None:
        return None
    try:
        radii = float("inf") if text == "all" else float(text)
    except ValueError:
        radii = -1.0
    if not radii > 0:
        raise click.BadParameter(f"'{text}' is neither a number > 0 nor 'all'")
    return radii


def parse_tolerances(ctx: click.Context, option: click.Parameter, text: str) -> dict[str, float]:
    """Return tolerances by column; the key "" is for all columns that are not named."""
    tolerances: dict[str, float] = {}
    for word in parse_words(ctx, option, text):
        name, _, value = word.rpartition("=")
        try:
            tolerances[name.strip()] = tolerance = float(value)
        except ValueError:
            raise click.BadParameter(f"'{word}' is neither a number nor COLUMN=NUMBER") from None
        if not 0 <= tolerance <= 1:
            raise click.BadParameter(f"'{word}' is not in the range from 0 to 1")
    return tolerances


columns_option = click.option(
    "--columns",
    callback=parse_words,
    metavar="ROLE=COLUMN,...|DEPTH,FORCE[,TIME]",
    help="Columns, by title or by number from 1, e.g. z=1,deflection=2,time=4,segment=5; a "
    "minus before the column reverses the sign of its numbers. Roles: depth, z, "
    "separation, force, deflection, time, segment.",
)
sensitivity_option = click.option(
    "--sensitivity",
    metavar="X",
    help="Deflection per detector signal of a text file whose deflection is in volts or amperes, "
    "e.g. '50 nm/V' [from its header].",
)
units_option = click.option(
    "--units",
    callback=parse_pairs,
    help="Units of the columns of a file that does not state them, e.g. length=m,force=N.",
)
quiet_option = click.option(
    "--quiet",
    "verbosity",
    flag_value="warnings",
    default="all",
    help="Print only warnings and errors to stderr, no progress.",
)
json_option = click.option(
    "--json", "output_format", flag_value="json", default="text", help="Print one JSON object."
)
