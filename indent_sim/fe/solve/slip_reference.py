"""Slip reference: the place on the tip from which the slip of a new contact point is counted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from indent_sim.model.contact import SlipReference


class FrictionalSurface(Protocol):
    """A surface with friction, whose new contact points stick where its slip reference says."""

    def set_slip_reference(self, slip_reference: SlipReference) -> None:
        """Set the slip reference of points that come into contact during the increment.

        With `implicit` they stick at their place at the beginning of the increment, with `glue`
        they do not stick at all. With `mid` they stick at a place between the beginning and the
        present state, which is the nearer to the present state the later they touched.
        """


def solve_with_slip_reference(
    surface: FrictionalSurface | None,
    slip_reference: SlipReference,
    solve: Callable[[], bool],
    first_solve: Callable[[], bool] | None = None,
) -> bool:
    """Solve one increment with a slip reference; return whether it converged.

    With `mid` it is solved twice: first frictionless for points that newly come into contact, then
    with their slip counted from the place at which the first pass found that they touched.

    Parameters
    ----------
    surface
        The frictional surface; None for a contact without one, which is just solved.
    slip_reference
        The slip reference.
    solve
        Solves the increment.
    first_solve
        Solves the first of two passes; `solve` if None.
    """
    if surface is None:
        return solve()
    if slip_reference == "mid":
        surface.set_slip_reference("glue")
        if not (first_solve or solve)():
            return False
    surface.set_slip_reference(slip_reference)
    return solve()
