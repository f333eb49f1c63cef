"""Equilibrium: the interface of a body that finds its state at a depth and can be put back, for
`Walk`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.reactions import SurfaceComponent, reactions_of_whole_body
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class SolverStatistics:
    """Linear solves, and iterations of these, None where none is iterative; equilibria that were
    found, stages of steps in time among them, and changes of what a tip seals.
    """

    newton: int
    krylov: int | None = None
    stages: int = 0
    seal_changes: int = 0

    def __sub__(self, earlier: SolverStatistics) -> SolverStatistics:
        krylov = (
            None if self.krylov is None or earlier.krylov is None else self.krylov - earlier.krylov
        )
        stages = self.stages - earlier.stages
        switches = self.seal_changes - earlier.seal_changes
        return SolverStatistics(self.newton - earlier.newton, krylov, stages, switches)


class Equilibrium(Protocol):
    """A body under the tip: the whole mesh, or condensed to its contact surface. A step is `solve`,
    after `predict` or not, and `accept`; `restore` takes back what was not accepted.
    """

    scene: Scene
    has_memory: bool  # whether an equilibrium depends on the path to it

    @property
    def observed_body(self) -> Any:
        """The body at the present state, whose fields, surface table and numbers can be read off."""

    @property
    def statistics(self) -> SolverStatistics:
        """What was solved so far."""

    @property
    def failure(self) -> str:
        """Why the last solve did not succeed."""

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""

    def tighten_tolerance(self) -> float:
        """Converge as far as round-off lets, and say how well a force can be met then, relative.
        What jumps with the depth stands still from here on, until `is_settled` is asked.
        """

    def is_seal_consistent(self) -> bool:
        """Whether what stood still while a force was searched for fits the state that was found;
        else it does from here on, and the force is to be searched for again.
        """
        return True

    def extrapolate(self, depth: float, earlier: Sequence[Any]) -> None:
        """Take the unknowns that earlier snapshots lead to expect at a depth as the present ones."""

    def solve(self, depth: float, dt: float = 0.0) -> bool:
        """Find the equilibrium at a depth, `dt` [time] after the last accepted one, from the
        present unknowns; where it fails they are as they were.
        """

    def relax_to_stable_state(self, depth: float, dt: float = 0.0) -> bool:
        """Find where a body that adheres comes to rest at a depth, let go of in the present state,
        and what it is `dt` [time] later; else as `solve`.
        """
        return False

    def accept(self) -> float:
        """Take the present equilibrium as the one that the next step sets out from; what was lost
        in this [energy].
        """

    def snapshot(self) -> Any:
        """A copy of the state that was accepted last, with its depth."""

    def restore(self, state: Any) -> None:
        """Make a snapshot the present state, and the one that was accepted last."""

    def pack(self, state: Any) -> list[np.ndarray]:
        """A snapshot as arrays, for a checkpoint; none where it is not worth keeping."""
        return []

    def unpack(self, depth: float, arrays: Sequence[np.ndarray], t: float = 0.0) -> Any:
        """The snapshot of packed arrays at a depth and a time; None where they are none of this
        body.
        """
        return None

    def state_values(self) -> dict[str, Any]:
        """What a State says of the present equilibrium, by the names of its fields."""


def state_reactions(
    part: ModelDomain, support_reactions: Mapping[SurfaceComponent, float]
) -> dict[str, Any]:
    """What a State says of reactions [force]: the z-reaction of the whole body's supports, and that
    of each support.

    borne: what the supports of the modelled part bear.
    """
    vertical = sum(
        force for (_, component), force in support_reactions.items() if component == part.dim - 1
    )
    return {
        "reaction": part.symmetry_factor * vertical,
        "reactions": reactions_of_whole_body(part, support_reactions),
    }
