"""Numbers and tables as the page shows them."""

from __future__ import annotations

from collections.abc import Sequence


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    return "".join(f"| {' | '.join(line)} |\n" for line in (head, ["---"] * len(head), *lines))


def number(value: float | None, digits: int = 3) -> str:
    """A number to some digits, never as 1e+03; nothing for None."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):.15g}"


def percent(value: float | None) -> str:
    """A relative error in percent to two digits, with its sign; nothing for None."""
    return "" if value is None else f"{float(f'{100 * value:.2g}'):+g} %"


def size(value: float | None) -> str:
    """The size of a relative error in percent to two digits."""
    return "" if value is None else percent(abs(value)).lstrip("+")
