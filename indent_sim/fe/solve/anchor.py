"""Where the points that come into contact during a step are taken to have touched the tip."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class Anchored(Protocol):
    """A surface with friction, whose new points of contact stick where they are told to."""

    def stick_where_it_was(self) -> None:
        """At their places at the step's beginning."""

    def let_new_slip(self) -> None:
        """Nowhere."""

    def stick_on_the_way(self) -> None:
        """On the way from there to the present state, the farther the later they touched."""


def anchored(surface: Anchored, anchor: str, solve: Callable[[], bool], find: Callable[[], bool] | None = None) -> bool:
    """Solve a step with the anchor `implicit` or `glue`, or both ways of it: with `mid` new points stick on the way
    through the step that the first of two solves, `find` if there is one, has found without friction for them."""
    if anchor == "implicit":
        surface.stick_where_it_was()
        return solve()
    surface.let_new_slip()
    if anchor == "glue":
        return solve()
    if not (find or solve)():
        return False
    surface.stick_on_the_way()
    return solve()
