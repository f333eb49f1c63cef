"""Interface of a body whose equilibrium at a depth can be solved and restored.

`LoadStepper` uses this interface. `fe.solve` implements it for the whole mesh, and `fe.condensed`
for a body condensed to its contact surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from indent_sim.fe.path.solver_statistics import SolverStatistics
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.reactions import SurfaceComponent, reactions_of_whole_body
from indent_sim.scene.scene import Scene


class Equilibrium(Protocol):
    """Body under the tip whose equilibrium is solved increment by increment.

    An increment consists of `extrapolate` (optional), `solve` and `accept`; `restore` returns to an
    earlier accepted state. The body is the whole mesh, or condensed to its contact surface.
    """

    scene: Scene
    has_memory: bool  # whether an equilibrium depends on the load path to it

    @property
    def observed_body(self) -> Any:
        """The body in its present state, for the evaluation of fields and results."""

    @property
    def statistics(self) -> SolverStatistics:
        """Solver statistics since the beginning."""

    @property
    def failure(self) -> str:
        """Reason why the last solve did not converge."""

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""

    def tighten_tolerance(self) -> float:
        """Tighten the tolerance to round-off; return the resulting relative error of a force.

        The contact seal, which changes discontinuously with the depth, is frozen until
        `is_seal_consistent` is called.
        """

    def is_seal_consistent(self) -> bool:
        """Return whether the frozen contact seal agrees with the computed contact.

        If it does not, the seal is updated, and the search for the force must be repeated.
        """
        return True

    def extrapolate(self, depth: float, earlier: Sequence[Any]) -> None:
        """Set the unknowns to an extrapolation of earlier snapshots to the given depth."""

    def solve(self, depth: float, dt: float = 0.0, slide: float = 0.0) -> bool:
        """Solve for the equilibrium at a depth, starting from the present unknowns.

        Parameters
        ----------
        depth
            Indentation depth [length].
        dt
            Time since the last accepted equilibrium [time].
        slide
            Horizontal displacement of the tip from where it was pressed in [length].

        Returns
        -------
        bool
            True if the solution converged; otherwise the unknowns are restored.
        """

    def relax_to_stable_state(self, depth: float, dt: float = 0.0) -> bool:
        """Find the stable state to which the present state relaxes at a given depth.

        Dynamic relaxation is followed by a time step of length `dt`. Parameters and return value
        are the same as for `solve`.
        """
        return False

    def accept(self) -> float:
        """Accept the present equilibrium as the start of the next increment.

        Returns
        -------
        float
            Energy dissipated in this increment [energy].
        """

    def snapshot(self) -> Any:
        """Return a copy of the last accepted state with its depth."""

    def restore(self, state: Any) -> None:
        """Set the present and the last accepted state to a snapshot."""

    def pack(self, state: Any) -> list[np.ndarray]:
        """Return a snapshot as arrays for a checkpoint; [] if solving again is cheaper."""
        return []

    def unpack(self, depth: float, arrays: Sequence[np.ndarray], t: float = 0.0) -> Any:
        """Return the snapshot stored in packed arrays; None if the arrays do not fit this body."""
        return None

    def state_values(self) -> dict[str, Any]:
        """Return the results of the present equilibrium, keyed by the field names of `State`."""


def moment_values(moment: float, force: float) -> dict[str, float]:
    """Return the moment on the tip and the place of the resultant force, keyed as in `State`.

    Parameters
    ----------
    moment
        Moment of the vertical force about the tip's center [force length].
    force
        Vertical force [force].
    """
    return {"moment": moment, "x_contact": moment / force if force > 0 else 0.0}


def lateral_imbalance(
    scene: Scene, support_reactions: Mapping[SurfaceComponent, float], push: float
) -> dict[str, float]:
    """Return `lateral_imbalance`, the absolute resultant force on the body along the slide [force].

    It is 0 in equilibrium. The mapping is empty if the tip does not slide.

    Parameters
    ----------
    scene
        The scene.
    support_reactions
        Reactions of the supports on the model domain [force].
    push
        Force of the whole body on the tip along the slide [force].
    """
    physics = scene.physics
    if not physics.slides:
        return {}
    reaction = sum(
        force
        for (_, component), force in support_reactions.items()
        if component == physics.track.axis
    )
    return {"lateral_imbalance": abs(physics.domain.symmetry_factor * reaction - push)}


def state_reactions(
    part: ModelDomain, support_reactions: Mapping[SurfaceComponent, float]
) -> dict[str, Any]:
    """Return the reactions [force] of a `State`: their sum along z, and that of each support.

    Parameters
    ----------
    part
        The model domain.
    support_reactions
        Reactions of its supports [force].
    """
    vertical = sum(
        force for (_, component), force in support_reactions.items() if component == part.dim - 1
    )
    return {
        "reaction": part.symmetry_factor * vertical,
        "reactions": reactions_of_whole_body(part, support_reactions),
    }
