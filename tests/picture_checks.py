"""What may not be in a picture: words over words, words beyond the edge, axes without a name."""

from __future__ import annotations

from itertools import combinations
from typing import Any

from matplotlib.text import Text

TOUCH = 1.0  # pixels that two boxes may share, for they are those of the letters' largest height


def faults(figure: Any) -> list[str]:
    """What is wrong with a laid-out figure, in words."""
    figure.draw_without_rendering()
    renderer = figure._get_renderer()
    unseen = _unseen(figure)
    words = [text for text in figure.findobj(Text) if _is_seen(text) and id(text) not in unseen]
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in words]
    found = [f"{one!r} lies on {other!r}" for (one, a), (other, b) in combinations(boxes, 2) if _overlap(a, b)]
    edge = figure.bbox
    found += [
        f"{one!r} goes beyond the edge"
        for one, box in boxes
        if box.x0 < edge.x0 - 1 or box.y0 < edge.y0 - 1 or box.x1 > edge.x1 + 1 or box.y1 > edge.y1 + 1
    ]
    panels = [axes for axes in figure.axes if axes.axison and axes.get_visible()]
    found += [
        f"{text.get_text()!r} lies on the panel of another"
        for text, (_, box) in zip(words, boxes, strict=True)
        for axes in panels
        if text.axes is not None and text.axes is not axes and _overlap(box, axes.get_window_extent(renderer))
    ]
    for axes in figure.axes:
        for along in (axes.xaxis, axes.yaxis):
            labels = [] if not axes.axison else [tick.label1 for tick in along._update_ticks()]
            numbers = [label for label in labels if label.get_visible() and label.get_text()]
            is_bar = axes.get_label() == "<colorbar>"  # whose other axis has no numbers
            if numbers and not (is_bar or along.get_label_text() or _names_itself(numbers)):
                found.append(f"an axis with {[label.get_text() for label in numbers]} has no name")
    return found


def _is_seen(text: Any) -> bool:
    hidden = text.axes is not None and not text.axes.get_visible()
    return bool(not hidden and text.get_visible() and text.get_text().strip())


def _unseen(figure: Any) -> set[int]:
    """What is never drawn: numbers beyond the ends of an axis, and all that stands along axes that are switched off."""
    found: set[int] = set()
    for axes in figure.axes:
        for along in (axes.xaxis, axes.yaxis):
            ticks = [*along.get_major_ticks(), *along.get_minor_ticks()]
            drawn = along._update_ticks() if axes.axison and axes.get_visible() else []
            found |= {id(label) for tick in ticks if tick not in drawn for label in (tick.label1, tick.label2)}
            if not axes.axison:
                found |= {id(along.label), id(along.offsetText)}
    return found


def _names_itself(numbers: list[Any]) -> bool:
    """Whether what stands along an axis are words."""
    return any(character.isalpha() for label in numbers for character in label.get_text().replace("e", ""))


def _overlap(a: Any, b: Any) -> bool:
    wide, high = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
    return bool(wide > TOUCH and high > TOUCH)
