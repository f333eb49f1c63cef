"""Remedies for a load path that ended early, and the depth that the path reaches with each.

At finite strain Newton's method may fail near the edge of a tip because too few elements lie around
the edge, or because they are too distorted. A larger edge radius or other element sizes may help,
but it is not known in advance which. All trials together use at most as many Newton iterations as
the run itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.load_path import LoadPath
from indent_sim.model.state import State
from indent_sim.model.tips import FlatPunch
from indent_sim.process.errors import IndentSimError
from indent_sim.run.measured_constants import LEAST_ROUNDING
from indent_sim.scene.scene import Scene

SolveStates = Callable[[Scene], Iterator[State]]


@dataclass(frozen=True)
class Remedy:
    """Key of the scene, its changed value [user's units], and the config with this value."""

    key: str
    value: float
    config: Config


def has_remedies(scene: Scene) -> bool:
    """True if remedies are tried for a scene.

    Remedies exist for two-dimensional meshes at finite strain, prescribed depths and no history.
    """
    physics = scene.physics
    is_two_dimensional = (
        scene.is_meshed and physics.domain.dim == 2 and scene.sizes.refinements is None
    )
    is_finite_strain = not physics.small_strain and physics.gap == "current"
    return (
        is_two_dimensional
        and is_finite_strain
        and physics.path.control == "depth"
        and not physics.path.times
    )


def remedies(config: Config, scene: Scene) -> list[Remedy]:
    """Return the remedies in order: larger edge radii, smaller elements, larger elements."""
    remedies_found = [
        Remedy("indenter.edge_radius", rho, _set_edge_radius(config, rho))
        for rho in _edge_radii(config, scene)
    ]
    h_contact = scene.sizes.h_contact * scene.physics.scales.length
    for factor in (0.5, 2.0):
        h = float(f"{factor * h_contact:.3g}")
        remedies_found.append(Remedy("mesh.h_contact", h, _set_element_size(config, h)))
    return remedies_found


def _edge_radii(config: Config, scene: Scene) -> list[float]:
    """Return larger edge radii: about twice the given one, and that of a hemispherical end."""
    tip = config.indenter
    if (
        not isinstance(tip, FlatPunch)
        or scene.physics.is_compressed
        or tip.edge_radius >= tip.radius
    ):
        return []
    larger_radius = min(max(2 * tip.edge_radius, LEAST_ROUNDING * tip.radius), tip.radius)
    return list(dict.fromkeys([float(f"{larger_radius:.3g}"), tip.radius]))


def _set_edge_radius(config: Config, edge_radius: float) -> Config:
    """Return the config with another edge radius."""
    tip: Any = config.indenter
    # An element size that was given for a sharp edge may not suit a rounded one.
    mesh = replace(config.mesh, h_edge=None)
    return config.model_copy(
        update={"indenter": replace(tip, edge_radius=edge_radius), "mesh": mesh}
    )


def _set_element_size(config: Config, h_contact: float) -> Config:
    """Return the config with another element size in the contact."""
    mesh = replace(
        config.mesh, h_contact=h_contact, h_axis=None, h_edge=None, h_corner=None, h_far="auto"
    )
    return config.model_copy(update={"accuracy": None, "mesh": mesh})


def try_remedies(
    remedies_found: list[Remedy],
    step: int,
    iterations_left: int,
    resolve: Callable[[Config], Scene],
    solve_states: SolveStates,
) -> str:
    """Return a text on the depth that the path reaches with each remedy, up to the first success.

    Parameters
    ----------
    remedies_found
        The remedies, in order.
    step
        The step that did not converge, counted from 1.
    iterations_left
        Newton iterations that all trials together may use; no trial begins beyond this number.
    resolve
        Returns the scene of a config.
    solve_states
        Solves a scene and yields its states.
    """
    reports: list[str] = []
    for remedy in remedies_found:
        if iterations_left <= 0:
            break
        try:
            scene = _truncate_path(resolve(remedy.config), step)
        except IndentSimError:
            continue  # the scene does not allow this value
        last: State | None = None
        for state in solve_states(scene):
            iterations_left -= state.newton_iterations
            if state.converged:
                last = state
            if not state.converged or iterations_left <= 0:
                break
        run = f"with {remedy.key}: {remedy.value:g} the run"
        if last is not None and last.step == step:
            reports.append(
                f"{run} reaches delta = {last.delta:.6g}, where the force is {last.force:.6g}"
            )
            break
        end = f"ends after delta = {last.delta:.6g}" if last else "fails at the first row"
        reports.append(f"{run} {end}")
    return f"; tried: {'; '.join(reports)}" if reports else ""


def _truncate_path(scene: Scene, step: int) -> Scene:
    """Return the scene with only the first `step` rows of its path."""
    values = scene.physics.path.values[:step]
    return scene.replace_physics(path=LoadPath("depth", values), deltas=values)
