"""Slip reference: the point of the tip from which the slip of a new contact point is counted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from indent_sim.model.contact import SlipReference


class FrictionalSurface(Protocol):
    """Surface with friction whose slip reference can be set."""

    def set_slip_reference(self, slip_reference: SlipReference) -> None:
        """Set the slip reference of points that come into contact during the increment.

        `implicit` counts slip from the position at the beginning of the increment; with `glue` new
        points carry no traction in this increment. `mid` counts slip from a position between those
        at the beginning and at the end of the increment; the later a point comes into contact, the
        closer this position is to the end.
        """


def solve_with_slip_reference(
    surface: FrictionalSurface | None,
    slip_reference: SlipReference,
    solve: Callable[[], bool],
    first_solve: Callable[[], bool] | None = None,
) -> bool:
    """Solve one increment with a slip reference; return whether it converged.

    With `mid` it is solved twice: first without friction at new contact points, then with the slip
    of these points counted from the position at which they touched in the first pass.

    Parameters
    ----------
    surface
        The frictional surface; None for a frictionless contact, which is solved once.
    slip_reference
        The slip reference.
    solve
        Function that solves the increment.
    first_solve
        Function that solves the first of two passes; `solve` if None.
    """
    if surface is None:
        return solve()
    if slip_reference == "mid":
        surface.set_slip_reference("glue")
        if not (first_solve or solve)():
            return False
    surface.set_slip_reference(slip_reference)
    return solve()
