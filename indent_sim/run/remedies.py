"""Remedies of a load path that ended too early: which were tried, and how far each came.

At finite strain a tip with an edge ends because few elements go around the edge, or because they
are stretched beyond what Newton's method can follow. A rounder edge and other elements are the two
ways out, and which one helps is not known before it is tried. All tries together cost no more
iterations than the run itself had spent.
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
from indent_sim.scene.scene import Scene

# Of the radius at which a tip's edge ends: the least rounding that is tried. Rods of the edge radii
# 1 and 0.99 R went to 4.75 R into neo-Hookean rubber, punches of 0.1 R to 1.3 R and of 0.001 R to a
# few per cent of R
LEAST_ROUNDING = 0.2
# times the elements in the contact
FINER = 0.5
COARSER = 2.0

SolveStates = Callable[[Scene], Iterator[State]]


@dataclass(frozen=True)
class Remedy:
    """A key of the scene with another value [user's units], and the scene with it."""

    key: str
    value: float
    config: Config


def has_remedies(scene: Scene) -> bool:
    """Whether remedies are tried for a scene: of a hyperelastic section, its gap at the deformed
    point, whose depths are prescribed without times.
    """
    physics = scene.physics
    is_section = scene.is_meshed and physics.domain.dim == 2 and scene.sizes.refinements is None
    is_finite = not physics.small_strain and physics.gap == "current"
    return is_section and is_finite and physics.path.control == "depth" and not physics.path.times


def remedies(config: Config, scene: Scene) -> list[Remedy]:
    """What may help, in the order in which it is tried: rounder edges, smaller elements, larger
    ones.
    """
    remedies_found = [
        Remedy("indenter.edge_radius", rho, _set_edge_radius(config, rho))
        for rho in _edge_radii(config, scene)
    ]
    h_contact = scene.sizes.h_contact * scene.physics.scales.length
    for factor in (FINER, COARSER):
        h = float(f"{factor * h_contact:.3g}")
        remedies_found.append(Remedy("mesh.h_contact", h, _set_element_size(config, h)))
    return remedies_found


def _edge_radii(config: Config, scene: Scene) -> list[float]:
    """Larger edge radii of a punch [user's lengths]: twice its own, at least LEAST_ROUNDING, and
    half a ball.
    """
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
    tip: Any = config.indenter
    mesh = replace(config.mesh, h_edge=None)  # of a sharp edge, which this one may not be
    return config.model_copy(
        update={"indenter": replace(tip, edge_radius=edge_radius), "mesh": mesh}
    )


def _set_element_size(config: Config, h_contact: float) -> Config:
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
    """How far the remedies came, in words, up to the first that comes to the step at which the run
    ended.

    Parameters
    ----------
    found
        The remedies, in order.
    step
        The step that was not reached, from 1.
    spent
        Iterations of Newton's method that all tries may take together; none begins beyond it.
    resolve, walk
        What makes a scene of a config, and its states of a scene.
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
        name = f"{remedy.key}: {remedy.value:g}"
        if last is not None and last.step == step:
            reports.append(
                f"{name} comes to delta = {last.delta:.6g} with the force {last.force:.6g}"
            )
            break
        end = f"ends after delta = {last.delta:.6g}" if last else "comes to no row"
        reports.append(f"{name} {end}")
    return f"; tried: {'; '.join(reports)}" if reports else ""


def _truncate_path(scene: Scene, step: int) -> Scene:
    """The scene with the first rows of its path alone."""
    values = scene.physics.path.values[:step]
    return scene.replace_physics(path=LoadPath("depth", values), deltas=values)
