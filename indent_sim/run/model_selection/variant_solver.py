"""Solver of the variants of a scene with a cache of their results."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from indent_sim.config.scene_sections import MeshSettings
from indent_sim.config.schema import Config
from indent_sim.model.contact import AutoContact
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.state import State
from indent_sim.process.errors import (
    BackendError,
    ConfigError,
    IndentSimError,
    NotConverged,
    SolverMissing,
)
from indent_sim.run.history_on_curve import HistoryResult, evaluate_with_units
from indent_sim.run.model_selection.variants import replace_sections
from indent_sim.run.pipeline import condense, states
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.solution import SOLUTION_ERRORS

# Reason why a variant is not solved without the solver of scenes on a mesh.
NEEDS_MESH = "it needs a mesh, and the solver is not installed"

T = TypeVar("T")


class VariantSolver:
    """Solver of the variants of a scene.

    Every variant is solved once, by theory if it is exact, otherwise on a mesh. Two configs that
    resolve to the same problem are one variant. A variant that cannot be solved raises NotConverged
    at every request.
    """

    def __init__(self) -> None:
        self._results: dict[str, Any] = {}

    def force(self, config: Config) -> float:
        """Return the force of an elastic variant at its last row [force]."""
        if isinstance(config.body, MeshFromFile) and config.body.kinematics == "3d":
            raise NotConverged("a three-dimensional mesh cannot be replaced by an axisymmetric one")
        last_row = self.rows(config)[-1]
        if not last_row.converged:
            raise NotConverged("the solution of this variant did not converge")
        return last_row.force

    def rows(self, config: Config) -> list[State]:
        """Return the rows of a variant; the last one is not converged if the path ended early.

        Raises
        ------
        NotConverged
            If the run would take too long.
        """
        return self._solve_variant("rows", config, _solve_path)

    def history(self, config: Config) -> HistoryResult:
        """Return the rows and the report of the history of a variant, on its elastic load curve."""
        return self._solve_variant("history", config, _evaluate_history)

    def theory_scene(self, config: Config) -> Scene | None:
        """Return the variant as a scene that is solved by theory; None if theory is not exact."""
        if not is_fully_automatic(config):
            return None

        def resolve_by_theory() -> Scene | None:
            """Return the scene if the method "theory" accepts it."""
            by_theory = replace(config.solver, method="theory")
            with suppress(ConfigError):
                return resolve(replace_sections(config, solver=by_theory))
            return None

        return self._compute_once(f"theory {config!r}", resolve_by_theory)

    def _solve_variant(self, kind: str, config: Config, solve: Callable[[Scene], T]) -> T:
        """Return `solve(scene)` for a variant, such as its states or history, from the cache."""

        def solve_scene() -> T:
            """Return the result of the resolved variant."""
            scene = self.theory_scene(config) or resolve(config)
            # Parts of a resolved scene on which its solution depends.
            problem_parts = (
                "physics",
                "sizes",
                "solver",
                "experiment",
                "history_on_curve",
                "relaxation",
            )
            problem = " ".join(repr(getattr(scene, part)) for part in problem_parts)
            return self._compute_once(f"{kind} {problem}", lambda: solve(scene))

        return self._compute_once(f"{kind} {config!r}", solve_scene)

    def _compute_once(self, key: str, compute: Callable[[], T]) -> T:
        """Return the result of `compute`, which is called once for each key.

        Failures of `compute` are stored as well, and raised as NotConverged. A BackendError is
        raised as it is, unless the solver is not installed at all.
        """
        if key not in self._results:
            try:
                self._results[key] = compute()
            except SolverMissing:
                self._results[key] = NotConverged(NEEDS_MESH)
            except BackendError:
                raise
            except (IndentSimError, *SOLUTION_ERRORS) as error:
                message = " ".join(str(error).split())
                self._results[key] = NotConverged(message or type(error).__name__)
        result: T | NotConverged = self._results[key]
        if isinstance(result, NotConverged):
            raise NotConverged(str(result))
        return result


def _solve_path(scene: Scene) -> list[State]:
    """Return the rows of a scene; raise NotConverged if the solution would take too long."""
    seconds = scene.plan.prediction.get("seconds", 0.0)
    # Longest run of a variant in time, and of an elastic one in three dimensions [s]: a table of
    # effects should not take more than a few minutes.
    max_seconds_in_time = 600.0
    max_seconds_3d = 120.0
    if scene.physics.is_time_dependent:
        if seconds > max_seconds_in_time:
            raise NotConverged(
                f"the run would take about {seconds:.2g} s and is skipped; run the scene and its "
                "elastic limiting cases yourself"
            )
    elif scene.is_meshed and scene.physics.domain.dim == 3 and seconds > max_seconds_3d:
        raise NotConverged(
            f"a run in three dimensions would take about {seconds:.2g} s; run the scene with and "
            "without the effect instead"
        )
    return list(states(scene, with_surface=False))


def _evaluate_history(scene: Scene) -> HistoryResult:
    """Return the history of a scene on its elastic load curve."""
    return evaluate_with_units(scene, condense(scene).equilibrium if scene.is_meshed else None)


def is_fully_automatic(config: Config) -> bool:
    """True if the program chooses the contact law and the mesh."""
    return isinstance(config.contact, AutoContact) and config.mesh == MeshSettings()
