"""What films beside drained faces cost the force on the elements of a run, from one undrained
equilibrium.

At once nothing has drained, and the pressure p of the fluid at the drained faces is known from the
run's own mesh. What elements there then lose too much is known, too (`scene.boundary_films`), and
what that takes from the force follows by reciprocity:

    dF(row) = 1/2 d/ddelta sum_i p_i^2 A_i E(h_i)/M

over the vertices i of drained faces, with elements of the height h_i and the area A_i each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.scene import boundary_films
from indent_sim.scene.boundary_films import PathRow
from indent_sim.scene.problem_setup import is_undrained_incompressible
from indent_sim.scene.scene import Scene

SECOND_DEPTH_FRACTION = 0.95  # of the largest depth or force: the second equilibrium, for the slope


@dataclass(frozen=True)
class FilmError:
    """The error that films leave in the force of each row [force].

    heights, losses: at each vertex of a drained face the height of its elements [length], and the
    force [force/length] that is lost per `excess_length` at the largest value of the history. All
    without units, but for the force.
    """

    rows: Sequence[PathRow]
    diffusivity: float
    element_heights: np.ndarray
    force_losses: np.ndarray
    is_draining_column: bool = False

    def force_error(self, state: State, coarser: float = 1.0) -> float:
        """Of a row's force, at its depth [force]; on elements that are so many times as large."""
        row = self.rows[state.step - 1]
        heights = coarser * self.element_heights
        if self.is_draining_column:
            return self._column_error(row, state, heights)
        return float(self.force_losses @ row.excess_length(heights, self.diffusivity))

    def _column_error(self, row: PathRow, state: State, heights: np.ndarray) -> float:
        """Of a column that gives way by what has drained alone: the share of that length which is
        too much.
        """
        drained = row.drained_length(self.diffusivity)
        excess = float(np.max(row.excess_length(heights, self.diffusivity), initial=0.0))
        return abs(state.force) * excess / drained if drained else 0.0


def estimate_film_error(
    scene: Scene, follow: Callable[[Scene], Sequence[State]]
) -> FilmError | None:
    """The errors of films in a scene's rows; None where there are none: no fluid, or a gel that its
    bath swells.

    `follow` solves a scene. Where the undrained body finds no equilibrium, the errors are NaN.
    """
    physics = scene.physics
    if not _has_films(scene):
        return None
    rows = boundary_films.path_rows(physics.path)
    D = boundary_films.smallest_diffusivity(physics)
    sudden_scene = sudden_load_scene(scene)
    if sudden_scene is None:
        face_sizes = [film.h for film in scene.sizes.drained_faces] or [scene.sizes.h_contact]
        return FilmError(rows, D, np.array(face_sizes), np.empty(0), is_draining_column=True)
    states = [state for state in follow(sudden_scene) if state.converged]
    drained_vertices = [state.drained for state in states]
    if len(drained_vertices) < 2 or any(vertices is None for vertices in drained_vertices):
        return FilmError(rows, D, np.ones(1), np.array([nan]))
    (heights, lower_loss), (_, upper_loss) = (
        vertices.T for vertices in drained_vertices if vertices is not None
    )
    depth_difference = (states[1].delta - states[0].delta) / physics.scales.depth
    losses = (
        physics.domain.symmetry_factor
        * (upper_loss - lower_loss)
        / (2 * depth_difference)
        * boundary_films.largest_inverse_modulus(physics)
        * physics.scales.force
    )
    return FilmError(rows, D, heights, losses)


def _has_films(scene: Scene) -> bool:
    """Whether films beside drained faces cost something: not those of a gel that its bath swells."""
    physics = scene.physics
    path = scene.physics.path
    return (
        bool(physics.permeable_regions)
        and not physics.is_swelling
        and path.start_time is not None
        and max(path.values) > 0
    )


def sudden_load_scene(scene: Scene) -> Scene | None:
    """The scene whose largest depth or force comes at once, in two steps, which tells what films
    cost; None where nothing is asked of it: without films, or of a column that has no undrained
    equilibrium.
    """
    path = scene.physics.path
    if not _has_films(scene) or is_undrained_incompressible(scene.physics):
        return None
    largest = max(path.values)
    deepest = max(scene.physics.deltas)
    sudden_path = LoadPath(
        path.control,
        (SECOND_DEPTH_FRACTION * largest, largest),
        times=(path.start_time or 0.0,) * 2,
        branches=("approach",) * 2,
        start_time=path.start_time,
    )
    return scene.replace_physics(
        path=sudden_path, deltas=(SECOND_DEPTH_FRACTION * deepest, deepest)
    )
