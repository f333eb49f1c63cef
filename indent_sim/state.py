"""What the solver knows at one requested depth: the row of the result table and what stands behind it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

COLUMNS = ("step", "delta", "force", "a", "p_max", "penetration", "energy", "newton_iterations", "wall_s")


@dataclass(frozen=True)
class Surface:
    """The contact surface at one state: reference coordinates, displacement, gap and pressure, one entry a point.

    x, y [length] (axisymmetric: x = r, y = 0; strip: y = 0); u (n, 3) [length]; gap [length] >= 0 open;
    pressure [pressure] >= 0.
    """

    x: np.ndarray
    y: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    pressure: np.ndarray


@dataclass(frozen=True)
class State:
    """One converged (or failed) load step of the whole body, in the units of the scene it belongs to.

    force [pressure length^2] > 0 pushing (per unit length in plane strain), a [length] contact radius, p_max
    [pressure], penetration [length] the largest <-g> over the contact quadrature points, energy
    [pressure length^3] strain plus penalty energy, reaction the z-reaction of all constrained dofs.
    """

    step: int
    delta: float
    force: float
    a: float
    p_max: float
    penetration: float
    energy: float
    newton_iterations: int
    wall_s: float
    reaction: float = float("nan")
    stray_reaction: float = 0.0
    substeps: int = 1
    converged: bool = True
    reason: str = ""
    force_error: float | None = None
    surface: Surface | None = field(default=None, repr=False, compare=False)

    @property
    def audit(self) -> float:
        """|force - reaction| relative to the larger of the two; 0 out of contact."""
        size = max(abs(self.force), abs(self.reaction))
        return abs(self.force - self.reaction) / size if size > 0 else 0.0
