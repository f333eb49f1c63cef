"""Solver statistics: how many systems and iterations the equilibria of a run took."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SolverStatistics:
    """Counts since the beginning of a run.

    Attributes
    ----------
    newton
        Linear systems solved, one per Newton iteration.
    krylov
        Krylov iterations; None with a direct solver.
    stages
        Equilibria found, stages of time steps included.
    seal_changes
        Changes of the contact seal.
    """

    newton: int
    krylov: int | None = None
    stages: int = 0
    seal_changes: int = 0

    def __sub__(self, earlier: SolverStatistics) -> SolverStatistics:
        krylov = (
            None if self.krylov is None or earlier.krylov is None else self.krylov - earlier.krylov
        )
        return SolverStatistics(
            self.newton - earlier.newton,
            krylov,
            self.stages - earlier.stages,
            self.seal_changes - earlier.seal_changes,
        )
