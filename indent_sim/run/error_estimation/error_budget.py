"""Error budget of a row, and the grid convergence index."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import acosh

# Empirical constant of the error estimate; docs/accuracy.md gives coverage and width of the error
# bars without it.
SAFETY_FACTOR = 3.0  # Roache's factor of safety for two meshes


@dataclass(frozen=True)
class ErrorBudget:
    """Parts of the error estimate of a row's force [force].

    Attributes
    ----------
    step
        The row.
    discretisation
        Error due to the mesh.
    enforcement
        Error due to the penalty stiffness.
    truncation
        Error due to a finite body in place of a half-space, or to flat facets in place of a curved
        surface.
    theory
        Distance from a theory that is exact for this body.
    path
        Error due to the load increments with friction.
    time
        Error due to the time steps of a time-dependent body.
    film
        Error due to drainage films: thin drained layers at drained faces that the mesh does not
        resolve.
    bath
        Error due to the ramp that replaces a sudden change of the bath.
    """

    step: int
    discretisation: float = 0.0
    enforcement: float = 0.0
    truncation: float = 0.0
    theory: float = 0.0
    path: float = 0.0
    time: float = 0.0
    film: float = 0.0
    bath: float = 0.0

    @property
    def parts(self) -> dict[str, float]:
        """The parts that are estimated, by name; their sum is `estimated`."""
        return {
            name: value for name, value in asdict(self).items() if name not in ("step", "theory")
        }

    @property
    def estimated(self) -> float:
        """Sum of the parts [force]."""
        return sum(self.parts.values())

    @property
    def total(self) -> float:
        """Error estimate [force]: sum of the parts, at least the distance from exact theory."""
        return self.theory if self.theory > self.estimated else self.estimated


def grid_convergence_index(difference: float, ratio: float, rate: float) -> float:
    """Return Roache's grid convergence index, SAFETY_FACTOR * difference/|ratio^rate - 1|.

    Parameters
    ----------
    difference
        Change of a result [any unit] if sizes (or steps) are multiplied by `ratio`.
    ratio
        Grid refinement ratio; below 1 if the other mesh is finer.
    rate
        Order of convergence: the error falls as h^rate.
    """
    return SAFETY_FACTOR * difference / abs(ratio**rate - 1)


def ridge_pressure(turn: float, refinements: int) -> float:
    """Return the largest excess pressure at the edges of a faceted surface, divided by E*.

    Under a tip that is flat at the edge, two facets that meet at the angle theta act as a cone of
    the slope theta/2, whose pressure grows as E* theta/4 * arccosh(l/r) towards the edge (Sneddon
    1965, Int. J. Eng. Sci. 3, 47; Johnson, Contact Mechanics, 5.2). l is the length of a facet. No
    pressure is evaluated nearer to the edge than a quarter of an element, which gives the largest
    value. On meshes of caps under balls and plates, refined one to three times, p_max was too large
    by 0.57 to 0.67, 0.67 to 0.72 and 0.83 to 0.87 times E* theta; the formula gives 0.69, 0.87 and
    1.04.

    Parameters
    ----------
    turn
        The angle theta [radians]; 0 without facets.
    refinements
        Number of uniform refinements of each facet.
    """
    return turn / 4 * acosh(4.0 * 2.0**refinements)
