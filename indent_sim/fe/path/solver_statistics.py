"""Solver statistics: numbers of linear systems and iterations since the beginning of a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SolverStatistics:
    """Solver statistics since the beginning of a run.

    Attributes
    ----------
    newton
        Linear systems solved, one per Newton iteration.
    krylov
        Krylov iterations; None with a direct solver.
    stages
        Number of equilibria found, including the stages of time steps.
    seal_changes
        Number of changes of the contact seal.
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
