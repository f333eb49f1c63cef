"""Where the points that come into contact during a step are taken to have touched the tip."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from indent_sim.model.contact import SlipReference


class FrictionalSurface(Protocol):
    """A surface with friction, whose new points of contact stick where they are told to."""

    def set_slip_reference(self, slip_reference: SlipReference) -> None:
        """At their places at the step's beginning (`implicit`), nowhere (`glue`), or on the way
        from there to the present state, the farther the later they touched (`mid`).
        """


def solve_with_slip_reference(
    surface: FrictionalSurface | None,
    slip_reference: SlipReference,
    solve: Callable[[], bool],
    first_solve: Callable[[], bool] | None = None,
) -> bool:
    """Solve a step with the anchor `implicit` or `glue`, or both ways of it: with `mid` new points
    stick on the way through the step that the first of two solves, `first_solve` if there is one, has
    found without friction for them. Without such a surface just solve.
    """
    if surface is None:
        return solve()
    if slip_reference == "mid":
        surface.set_slip_reference("glue")
        if not (first_solve or solve)():
            return False
    surface.set_slip_reference(slip_reference)
    return solve()
