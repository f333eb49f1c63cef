"""Error of the force due to unresolved drainage films (boundary layers) at drained faces.

The error follows from one undrained equilibrium on the mesh of the run. At the moment of loading
nothing has drained, and the fluid pressure p at the drained faces is known from this mesh. The
elements at these faces lose too much fluid by a known amount (`scene.boundary_films`), and
reciprocity gives its effect on the force:

    dF(row) = 1/2 d/ddelta sum_i p_i^2 A_i E(h_i)/M

The sum extends over the vertices i of drained faces, with the height h_i and the area A_i of their
elements, the excess E of the drained length (`PathRow.excess_length`) and the modulus M
(`boundary_films.largest_inverse_modulus`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.scene import boundary_films
from indent_sim.scene.path_rows import PathRow, path_rows
from indent_sim.scene.problem_definition import is_undrained_incompressible
from indent_sim.scene.scene import Scene


@dataclass(frozen=True)
class FilmError:
    """Error of the force of each row due to drainage films [force].

    A drainage film is the thin drained layer at a drained face shortly after a change of the load.

    All attributes except `force_losses` are nondimensional.

    Attributes
    ----------
    rows
        Loading history up to each row.
    diffusivity
        Smallest diffusivity of the body.
    element_heights
        Height of the elements at each vertex of a drained face [length].
    force_losses
        Loss of force per `excess_length` at each vertex, at the largest value of the history
        [force/length].
    is_draining_column
        True if the body deforms only by drainage.
    """

    rows: Sequence[PathRow]
    diffusivity: float
    element_heights: np.ndarray
    force_losses: np.ndarray
    is_draining_column: bool = False

    def force_error(self, state: State, coarser: float = 1.0) -> float:
        """Return the error of a row's force [force] on elements `coarser` times as large."""
        row = self.rows[state.step - 1]
        heights = coarser * self.element_heights
        if self.is_draining_column:
            return self._column_error(row, state, heights)
        return float(self.force_losses @ row.excess_length(heights, self.diffusivity))

    def _column_error(self, row: PathRow, state: State, heights: np.ndarray) -> float:
        """Return the error of the force on a column that deforms only because fluid drains."""
        drained = row.drained_length(self.diffusivity)
        excess = float(np.max(row.excess_length(heights, self.diffusivity), initial=0.0))
        return abs(state.force) * excess / drained if drained else 0.0


def estimate_film_error(
    scene: Scene, follow: Callable[[Scene], Sequence[State]]
) -> FilmError | None:
    """Estimate the film errors of a scene's rows.

    Parameters
    ----------
    scene
        The scene of the run.
    follow
        Function that solves a scene and returns its states.

    Returns
    -------
    FilmError or None
        None if there are no films, or if they belong to a gel that swells in its bath. The errors
        are NaN if the undrained body has no equilibrium.
    """
    physics = scene.physics
    if not _has_films(scene):
        return None
    rows = path_rows(physics.path)
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
    """True if drainage films cause an error. The films of a gel that swells in its bath do not."""
    physics = scene.physics
    path = scene.physics.path
    return (
        bool(physics.permeable_regions)
        and not physics.is_swelling
        and path.start_time is not None
        and max(path.values) > 0
    )


def sudden_load_scene(scene: Scene) -> Scene | None:
    """Return the scene with its largest depth or force applied at once, in two steps.

    The result is None without films, and for a column that has no undrained equilibrium.
    """
    path = scene.physics.path
    if not _has_films(scene) or is_undrained_incompressible(scene.physics):
        return None
    largest = max(path.values)
    deepest = max(scene.physics.deltas)
    # Depth or force of a second equilibrium, relative to the largest, from which the slope follows.
    second_fraction = 0.95
    sudden_path = LoadPath(
        path.control,
        (second_fraction * largest, largest),
        times=(path.start_time or 0.0,) * 2,
        branches=("approach",) * 2,
        start_time=path.start_time,
    )
    return scene.replace_physics(path=sudden_path, deltas=(second_fraction * deepest, deepest))
