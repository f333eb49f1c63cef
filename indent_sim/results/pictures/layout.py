"""Layout of panels in one grid by the widths of the numbers along their axes.

matplotlib's own layout measures every number several times, which is half of the cost of a picture. The widths of
digits are known, and so is how much room stands around a panel of curves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

# Over the font size, of DejaVu Sans: widths of a digit and of what is narrower or wider, and the height of a line
DIGIT_WIDTH, OTHER_WIDTHS, LINE_HEIGHT = 0.64, {".": 0.32, "\N{MINUS SIGN}": 0.84, "\N{MULTIPLICATION SIGN}": 0.84}, 1.2
TICK, BEFORE_NAME, BELOW_TITLE = 7.0, 4.0, 6.0  # points: from an axis to its numbers, to its name, and to a title
APART = 0.6  # font sizes between two numbers along an axis
MOST_BINS = 9  # of an axis
EDGE, RIGHT_OF_IT = 0.06, 0.15  # inches: around a figure, and to the right of a panel
GUESS, LEAST_PANEL, POINT = 0.6, 0.2, 1 / 72  # inches: around a panel without numbers yet, of a panel at least; a point


@dataclass(frozen=True)
class _Around:
    """Inches that numbers, names and titles take around a panel."""

    left: float = 0.0
    right: float = 0.0
    below: float = 0.0
    above: float = 0.0


def is_plain(figure: Any) -> bool:
    """Whether a figure has panels of one grid alone, with numbers along straight axes to the left and below, or none.

    Others are matplotlib's to lay out: maps and bars of colours, parts of figures, words along axes.
    """
    if figure.subfigs or not all(map(_is_plain, figure.axes)):
        return False
    return len({id(axes.get_subplotspec().get_gridspec()) for axes in figure.axes}) == 1


def _is_plain(axes: Any) -> bool:
    from matplotlib.ticker import AutoLocator, ScalarFormatter

    spec = axes.get_subplotspec() if hasattr(axes, "get_subplotspec") else None  # a bar of colours has none
    if spec is None or spec.get_gridspec() is not spec.get_topmost_subplotspec().get_gridspec():
        return False
    along = (axes.xaxis, axes.yaxis) if axes.axison else ()
    is_numbered = all(
        type(one.get_major_locator()) is AutoLocator and isinstance(one.get_major_formatter(), ScalarFormatter)
        for one in along
    )
    return axes.get_aspect() == "auto" and is_numbered and axes.get_label() != "<colorbar>"


def place(figure: Any, rect: Sequence[float]) -> None:
    """Give the panels of a plain figure their places in a part of it (left, below, width, height as shares), and every
    axis numbers that stay apart, which are those that will be drawn."""
    panels = list(figure.axes)
    _put(figure, rect, [(axes, _Around(GUESS, GUESS, GUESS, 0.0)) for axes in panels])
    around = [(axes, _with_numbers(axes) if axes.axison else _Around(above=EDGE)) for axes in panels]
    _put(figure, rect, around)
    for axes, one in around:
        if axes.axison:
            _put_names(axes, one)


def _put(figure: Any, rect: Sequence[float], panels: Sequence[tuple[Any, _Around]]) -> None:
    """Places in a grid whose columns and rows leave room for the most that stands around one of their panels."""
    (wide, high), grid = figure.get_size_inches(), panels[0][0].get_gridspec()
    spans = [(axes.get_subplotspec(), one) for axes, one in panels]
    left = _most(grid.ncols, ((spec.colspan.start, one.left) for spec, one in spans))
    right = _most(grid.ncols, ((spec.colspan.stop - 1, one.right) for spec, one in spans))
    above = _most(grid.nrows, ((spec.rowspan.start, one.above) for spec, one in spans))
    below = _most(grid.nrows, ((spec.rowspan.stop - 1, one.below) for spec, one in spans))
    across = _edges(rect[2] * wide - 2 * EDGE, left, right, grid.get_width_ratios())
    down = _edges(rect[3] * high - 2 * EDGE, above, below, grid.get_height_ratios())
    x, top = rect[0] * wide + EDGE, (rect[1] + rect[3]) * high - EDGE
    for axes, _ in panels:
        spec = axes.get_subplotspec()
        begin, end = _from_to(across, spec.colspan)
        upper, lower = _from_to(down, spec.rowspan)
        axes.set_position(((x + begin) / wide, (top - lower) / high, (end - begin) / wide, (lower - upper) / high))


def _from_to(edges: Sequence[tuple[float, float]], span: range) -> tuple[float, float]:
    """Begin and end of a panel, which may span cells that have no room for one."""
    begin, end = edges[span.start][0], edges[span.stop - 1][1]
    return begin, max(end, begin + LEAST_PANEL)


def _most(count: int, sizes: Iterable[tuple[int, float]]) -> list[float]:
    """The largest size at each of so many places."""
    found = [0.0] * count
    for place, size in sizes:
        found[place] = max(found[place], size)
    return found


def _edges(
    room: float, before: Sequence[float], after: Sequence[float], ratios: Sequence[float]
) -> list[tuple[float, float]]:
    """Begin and end of panels one after another in cells that share the room as their ratios say; a legend has all of
    its cell."""
    ends = np.cumsum(ratios) / sum(ratios) * room
    begins = [0.0, *ends[:-1]]
    return [
        (float(begin + ahead), float(end - behind))
        for begin, end, ahead, behind in zip(begins, ends, before, after, strict=True)
    ]


def _with_numbers(axes: Any) -> _Around:
    """What stands around a panel once its axes have their numbers."""
    wide, high = axes.get_position().size * axes.figure.get_size_inches()
    along = _numbered(axes.xaxis, lambda text, size: _width(text, size) + APART * size * POINT, wide)
    upward = _numbered(axes.yaxis, lambda _, size: LINE_HEIGHT * size * POINT, high)
    size = _size(axes.xaxis)
    left = TICK * POINT + max((_width(text, _size(axes.yaxis)) for text in upward), default=0.0)
    below = (TICK + LINE_HEIGHT * size) * POINT
    titles = [axes.get_title(loc=side) for side in ("left", "center", "right")]
    lines = max(text.count("\n") + 1 if text else 0 for text in titles) + bool(axes.yaxis.offsetText.get_text())
    name, line = BEFORE_NAME * POINT, LINE_HEIGHT * size * POINT
    power = line if axes.xaxis.offsetText.get_text() else 0.0
    return _Around(
        left + name + _lines(axes.yaxis.label),
        max(RIGHT_OF_IT, 0.5 * max((_width(text, size) for text in along), default=0.0)),
        below + name + max(_lines(axes.xaxis.label), power),
        BELOW_TITLE * POINT + lines * line if lines else 0.5 * size * POINT,
    )


def _numbered(along: Any, room: Callable[[str, float], float], length: float) -> list[str]:
    """The numbers of an axis of a length [inches], as many as have room; they are settled from here on."""
    from matplotlib.ticker import FixedFormatter, FixedLocator

    locator, formatter, size = along.get_major_locator(), along.get_major_formatter(), _size(along)
    low, high = sorted(along.get_view_interval())
    rounding = 1e-9 * (high - low)
    for bins in range(along.get_tick_space(), 0, -1):
        locator.set_params(nbins=min(bins, MOST_BINS))
        ticks = [tick for tick in locator() if low - rounding <= tick <= high + rounding]
        texts = formatter.format_ticks(ticks)
        step = length * (ticks[1] - ticks[0]) / (high - low) if len(ticks) > 1 else np.inf
        if all((room(one, size) + room(other, size)) / 2 <= step for one, other in pairwise(texts)):
            break
    settled = FixedFormatter(texts)
    settled.set_offset_string(formatter.get_offset())
    along.set_major_locator(FixedLocator(ticks))
    along.set_major_formatter(settled)
    along.offsetText.set_text(settled.get_offset())
    return list(texts)


def _put_names(axes: Any, around: _Around) -> None:
    """The names of both axes beside their numbers: matplotlib would measure these again to find their places."""
    wide, high = axes.get_position().size * axes.figure.get_size_inches()
    axes.yaxis.set_label_coords(-(around.left - _lines(axes.yaxis.label)) / wide, 0.5)
    axes.xaxis.set_label_coords(0.5, -((TICK + LINE_HEIGHT * _size(axes.xaxis) + BEFORE_NAME) * POINT) / high)


def _size(along: Any) -> float:
    """The font size of the numbers of an axis [points]."""
    return float(along._get_tick_label_size(along.axis_name))


def _lines(text: Any) -> float:
    """The height of the lines of a text [inches]."""
    said = text.get_text()
    return LINE_HEIGHT * text.get_fontsize() * POINT * (said.count("\n") + 1) if said else 0.0


def _width(text: str, size: float) -> float:
    """The width of a number [inches] in a font size [points]."""
    return sum(OTHER_WIDTHS.get(letter, DIGIT_WIDTH) for letter in text) * size * POINT
