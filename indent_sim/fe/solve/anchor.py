"""Where the points that come into contact during a step are taken to have touched the tip."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from indent_sim.model.contact import Anchor


class Anchored(Protocol):
    """A surface with friction, whose new points of contact stick where they are told to."""

    def hold_new(self, anchor: Anchor) -> None:
        """At their places at the step's beginning (`implicit`), nowhere (`glue`), or on the way
        from there to the present state, the farther the later they touched (`mid`).
        """


def anchored(
    surface: Anchored | None,
    anchor: Anchor,
    solve: Callable[[], bool],
    find: Callable[[], bool] | None = None,
) -> bool:
    """Solve a step with the anchor `implicit` or `glue`, or both ways of it: with `mid` new points
    stick on the way through the step that the first of two solves, `find` if there is one, has
    found without friction for them. Without such a surface just solve.
    """
    if surface is None:
        return solve()
    if anchor == "mid":
        surface.hold_new("glue")
        if not (find or solve)():
            return False
    surface.hold_new(anchor)
    return solve()
