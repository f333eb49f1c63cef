"""Equilibrium: the interface of a body that finds its state at a depth and can be put back, for `Walk`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from indent_sim.model.state import Surface
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.strain import Crushed


class Equilibrium(Protocol):
    """A body under the tip at `depth`: the whole mesh, or condensed to its contact surface."""

    scene: Scene
    depth: float  # delta [length]
    dofs: int  # unknowns of the body
    observed: Any  # what `observe.Fields` and the surface table are read off
    has_memory: bool  # whether an equilibrium depends on the path to it

    @property
    def iterations(self) -> int:
        """Linear solves so far."""

    @property
    def krylov_iterations(self) -> int | None:
        """Iterations of these linear solves so far; None where none is iterative."""

    @property
    def failure(self) -> str:
        """Why the last solve did not succeed."""

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""

    @property
    def force_tolerance(self) -> float:
        """How well a force can be met, relative."""

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent (collective)."""

    def sharpen(self) -> None:
        """Converge as far as round-off lets, so that a force can be met to `force_tolerance`."""

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from; nothing without memory."""

    @property
    def dissipation(self) -> float:
        """What friction dissipates on the way to the present equilibrium from the one before [energy]."""

    def solve(self, depth: float) -> bool:
        """Find the equilibrium at a depth from the present state; where it fails the state is as it was."""

    def snapshot(self) -> Any:
        """A copy of the state, without its depth."""

    def restore(self, state: Any, depth: float) -> None:
        """Put a state back."""

    def pack(self, state: Any) -> list[np.ndarray]:
        """A state as arrays, for a checkpoint; none where it is not worth keeping."""

    def unpack(self, arrays: Sequence[np.ndarray]) -> Any:
        """The state of packed arrays."""

    def predict(self, depth: float, earlier: Sequence[tuple[float, Any]]) -> None:
        """Take what the states at earlier depths lead to expect at this one as the present state."""

    def numbers(self) -> dict[str, Any]:
        """What a State says of the present equilibrium, by the names of its fields."""

    def surface(self) -> Surface | None:
        """The surface table on rank 0, None on the others."""

    def crushed(self) -> Crushed | None:
        """Where the body is compressed most; None at small strain."""

    def recover(self) -> None:
        """Make the fields of `observed` those of the present state."""

    def refuse_unused_options(self) -> None:
        """ConfigError for a `solver.petsc` option that PETSc never asked for."""
