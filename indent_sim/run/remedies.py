"""Remedies for a load path that ended early, and how far the path goes with each.

At finite strain Newton's method may fail near the edge of a tip because too few elements lie around
the edge, or because these elements are too distorted. A larger edge radius or other element sizes
may help; which of them helps is not known in advance. If the tip slides and no point slips, a point
that leaves the contact loses a finite shear traction at once. The surface springs back, may touch
again, and then no set of nodes in contact is an equilibrium; Coulomb friction, whose shear vanishes
with the pressure, has none of this. All trials together do at most as much work as the run itself:
Newton iterations times unknowns.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.contact import MAX_FRICTION
from indent_sim.model.state import State
from indent_sim.model.tips import FlatPunch
from indent_sim.process.errors import IndentSimError
from indent_sim.run.measured_constants import LEAST_ROUNDING
from indent_sim.scene.scene import Scene

log = logging.getLogger("indent_sim")

SolveStates = Callable[[Scene], Iterator[State]]


@dataclass(frozen=True)
class Remedy:
    """Keys of the scene with their changed values [user's units], and the changed config."""

    values: dict[str, float]
    config: Config

    @property
    def text(self) -> str:
        """The keys and values as text."""
        return " and ".join(f"{key}: {value:g}" for key, value in self.values.items())


def has_remedies(scene: Scene) -> bool:
    """True if remedies are tried for a scene.

    Remedies exist for two-dimensional meshes at finite strain, and for prescribed depths or for
    bodies that change in time; and for tips that slide and stick at a prescribed depth.
    """
    physics = scene.physics
    is_two_dimensional = (
        scene.is_meshed and physics.domain.dim == 2 and scene.sizes.refinements is None
    )
    is_finite_strain = not physics.small_strain and physics.gap == "current"
    return (
        is_two_dimensional
        and (is_finite_strain or _slides_and_sticks(scene))
        and (physics.path.control == "depth" or physics.is_time_dependent)
    )


def _slides_and_sticks(scene: Scene) -> bool:
    """True if the tip slides sideways and no point in contact may slip."""
    return scene.physics.slides and scene.physics.contact.is_bonded


def remedies(config: Config, scene: Scene) -> list[Remedy]:
    """Return the remedies in order: larger edge radii, smaller elements, larger elements.

    If the tip slides and sticks, the only remedy is the largest friction.
    """
    if _slides_and_sticks(scene):
        return [Remedy({"contact.friction": MAX_FRICTION}, _set_friction(config, MAX_FRICTION))]
    remedies_found = [
        Remedy({"indenter.edge_radius": rho}, _set_edge_radius(config, rho))
        for rho in _edge_radii(config, scene)
    ]
    sizes = {"h_contact": scene.sizes.h_contact}
    if scene.sizes.h_film:
        # With a given h_contact the elements at drained faces are small only if h_film is given.
        sizes["h_film"] = min(scene.sizes.h_film, scene.sizes.h_contact)
    for factor in (0.5, 2.0):
        values = {
            name: float(f"{factor * size * scene.physics.scales.length:.3g}")
            for name, size in sizes.items()
        }
        keys = {f"mesh.{name}": value for name, value in values.items()}
        remedies_found.append(Remedy(keys, _set_element_sizes(config, values)))
    return remedies_found


def _edge_radii(config: Config, scene: Scene) -> list[float]:
    """Return larger edge radii: about twice the given radius, and that of a hemispherical end."""
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


def _set_friction(config: Config, friction: float) -> Config:
    """Return the config with another coefficient of friction."""
    law: Any = config.contact
    return config.model_copy(update={"contact": replace(law, friction=friction)})


def _set_element_sizes(config: Config, sizes: dict[str, float]) -> Config:
    """Return the config with other element sizes in the contact and at drained faces."""
    defaults: dict[str, Any] = dict.fromkeys(("h_axis", "h_edge", "h_corner", "h_film"))
    mesh = replace(config.mesh, **defaults | {"h_far": "auto"} | sizes)
    return config.model_copy(update={"accuracy": None, "mesh": mesh})


def try_remedies(
    remedies_found: list[Remedy],
    failed: State,
    iterations_left: float,
    dofs: float,
    resolve: Callable[[Config], Scene],
    solve_states: SolveStates,
) -> str:
    """Return a text on how far the path goes with each remedy, up to the first success.

    Parameters
    ----------
    remedies_found
        The remedies, in order.
    failed
        The row that did not converge.
    iterations_left
        Limit of the work of all trials together, as a number of Newton iterations on the mesh of
        the run; no trial begins after it is reached.
    dofs
        Predicted number of unknowns of the run.
    resolve
        Function that returns the scene of a config.
    solve_states
        Function that solves a scene and yields its states.
    """
    reports: list[str] = []
    for remedy in remedies_found:
        if iterations_left <= 0:
            break
        try:
            scene = _truncate_path(resolve(remedy.config), failed)
        except IndentSimError:
            continue  # the scene does not allow this value
        log.info("the path ended early; trying %s", remedy.text)
        last: State | None = None
        for state in solve_states(scene):
            iterations_left -= state.newton_iterations * scene.cost.dofs / dofs
            if state.converged:
                last = state
            if not state.converged or iterations_left <= 0:
                break
        run = f"with {remedy.text} the run"
        if last is not None and last.step == len(scene.physics.path.values):
            reports.append(f"{run} reaches {_place(last)}, where the force is {last.force:.6g}")
            break
        end = f"ends after {_place(last)}" if last else "fails at the first row"
        reports.append(f"{run} {end}")
    return f"; tried: {'; '.join(reports)}" if reports else ""


def _place(state: State) -> str:
    """Return the depth of a row, and its time and slide if it has them, as text."""
    time_text = f"t = {state.t:.6g}, " if state.t is not None else ""
    slide_text = f", x = {state.x:.6g}" if state.x is not None else ""
    return f"{time_text}delta = {state.delta:.6g}{slide_text}"


def _truncate_path(scene: Scene, failed: State) -> Scene:
    """Return the scene with its path up to the row that did not converge.

    Another mesh may have other time steps, and with them other rows; the path then ends with the
    first row that is not earlier.
    """
    path = scene.physics.path
    count = failed.step
    if failed.t is not None:
        later_steps = (step for step, t in enumerate(path.times, start=1) if t >= failed.t)
        count = max(next(later_steps, len(path.times)), 1)
    return scene.replace_physics(path=path.first_rows(count), deltas=scene.physics.deltas[:count])
