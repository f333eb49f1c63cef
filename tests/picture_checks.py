"""Checks of pictures: overlapping or cut words, nameless axes, and legends that mislead.

A legend misleads where lines look alike, or where it has more names than anyone reads.
"""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text

MOST_NAMES = 12  # in a legend
TOUCH = 1.0  # pixels that two boxes may share, for they are those of the letters' largest height


def faults(figure: Any) -> list[str]:
    """The faults of a laid-out figure, in words."""
    figure.draw_without_rendering()
    unseen = _unseen(figure)
    words = [text for text in figure.findobj(Text) if _is_seen(text) and id(text) not in unseen]
    boxes = [(text.get_text(), text.get_window_extent()) for text in words]
    found = [
        f"{one!r} lies on {other!r}"
        for (one, a), (other, b) in combinations(boxes, 2)
        if _overlap(a, b)
    ]
    edge = figure.bbox
    found += [
        f"{one!r} goes beyond the edge"
        for one, box in boxes
        if box.x0 < edge.x0 - 1
        or box.y0 < edge.y0 - 1
        or box.x1 > edge.x1 + 1
        or box.y1 > edge.y1 + 1
    ]
    panels = [axes for axes in figure.axes if axes.axison and axes.get_visible()]
    found += [
        f"{text.get_text()!r} lies on the panel of another"
        for text, (_, box) in zip(words, boxes, strict=True)
        for axes in panels
        if text.axes is not None
        and text.axes is not axes
        and _overlap(box, axes.get_window_extent())
    ]
    curves = [
        axes for axes in panels if axes.get_aspect() == "auto"
    ]  # maps of one body are told by their bars
    named = [(axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) for axes in curves]
    found += [
        f"two panels of {one}"
        for one, other in combinations(named, 2)
        if one == other and all(one[:2])
    ]
    for axes in figure.axes:
        for along in (axes.xaxis, axes.yaxis):
            labels = [] if not axes.axison else [tick.label1 for tick in _ticks_in_view(along)]
            numbers = [label for label in labels if label.get_visible() and label.get_text()]
            is_bar = axes.get_label() == "<colorbar>"  # whose other axis has no numbers
            if numbers and not (is_bar or along.get_label_text() or _names_itself(numbers)):
                found.append(f"an axis with {[label.get_text() for label in numbers]} has no name")
    return [*found, *(fault for legend in figure.findobj(Legend) for fault in _of_legend(legend))]


def _of_legend(legend: Any) -> list[str]:
    """Names of a legend that look alike, and too many of them."""
    names = [text.get_text() for text in legend.get_texts()]
    found = [f"a legend of {len(names)} names"] if len(names) > MOST_NAMES else []
    handles = (
        legend.legend_handles if hasattr(legend, "legend_handles") else legend.legendHandles
    )  # matplotlib < 3.7
    looks = [(_look(handle), name) for handle, name in zip(handles, names, strict=True)]
    return found + [
        f"{one!r} looks as {other!r}"
        for (a, one), (b, other) in combinations(looks, 2)
        if a == b is not None
    ]


def _look(handle: Any) -> object:
    """What distinguishes a line of a legend; None for anything else."""
    if not isinstance(handle, Line2D):
        return None
    dashes = handle._unscaled_dash_pattern if handle.get_linestyle() != "None" else None
    return (
        to_hex(handle.get_color()),
        str(handle.get_marker()),
        str(dashes),
        str(handle.get_markerfacecolor()),
    )


def _is_seen(text: Any) -> bool:
    hidden = text.axes is not None and not text.axes.get_visible()
    return bool(not hidden and text.get_visible() and text.get_text().strip())


def _unseen(figure: Any) -> set[int]:
    """Ids of texts that are never drawn.

    They are numbers beyond the ends of an axis, and all along axes that are switched off.
    """
    found: set[int] = set()
    for axes in figure.findobj(Axes):  # bars of colours inside a panel too
        for along in (axes.xaxis, axes.yaxis):
            ticks = [*along.get_major_ticks(), *along.get_minor_ticks()]
            drawn = _ticks_in_view(along) if axes.axison and axes.get_visible() else []
            found |= {
                id(label)
                for tick in ticks
                if tick not in drawn
                for label in (tick.label1, tick.label2)
            }
            if not axes.axison:
                found |= {id(along.label), id(along.offsetText)}
    return found


def _ticks_in_view(along: Any) -> list[Any]:
    """Ticks between the ends of an axis; matplotlib draws no others."""
    place = along.get_transform().transform  # the logarithm on a logarithmic axis
    low, high = sorted(place(along.get_view_interval()))
    rounding = 1e-9 * (high - low)
    ticks = [*along.get_major_ticks(), *along.get_minor_ticks()]
    return [tick for tick in ticks if low - rounding <= place(tick.get_loc()) <= high + rounding]


def _names_itself(numbers: list[Any]) -> bool:
    """Whether the labels along an axis are words; powers of ten are none."""
    return any(
        character.isalpha()
        for label in numbers
        for character in re.sub(r"\\\w+|e", "", label.get_text())
    )


def _overlap(a: Any, b: Any) -> bool:
    wide, high = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
    return bool(wide > TOUCH and high > TOUCH)
