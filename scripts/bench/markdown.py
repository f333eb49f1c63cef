"""Numbers and tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "".join(f"| {' | '.join(line)} |\n" for line in (head, ["---"] * len(head), *lines))


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with this many digits, without an exponent; empty for None."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):.15g}"


def percent(value: float | None) -> str:
    """Return a relative error in per cent with two digits and its sign; empty for None."""
    return "" if value is None else f"{float(f'{100 * value:.2g}'):+g} %"


def size(value: float | None) -> str:
    """Return the absolute value of a relative error in per cent with two digits."""
    return "" if value is None else percent(abs(value)).lstrip("+")
