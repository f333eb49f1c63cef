"""Failure of a load path: where it ended, why, and what may help."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from indent_sim.fe.path.load_control import Pair
from indent_sim.model.materials import Gent
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.strain import Crushed

EVEN = "in shorter and shorter substeps too"


def failed_state(scene: Scene, step: int, value: float, iterations: int, last: Pair, started: float, failure: str,
                 crushed: Crushed | None = None) -> State:  # fmt: skip
    """The State that says that and why there is none at this depth or force.

    last: force and depth of the last equilibrium; crushed: where its J is smallest.
    """
    nan, D, F = float("nan"), scene.physics.scales.depth, scene.physics.scales.force
    wanted, place, delta = f"delta = {value * D:.6g}", f"delta = {last[1] * D:.6g}", value
    if scene.physics.path.control == "force":
        wanted, place, delta = f"force = {value * F:.6g}", f"{place}, force = {last[0] * F:.6g}", last[1]
    reason = (
        f"contact method {scene.physics.contact.method} did not converge at {wanted}: {failure}; the last equilibrium "
        f"found is at {place}{crushed.words(scene) if crushed else ''}{_limit(scene)}; {_advice(scene)} may help"
    )
    elapsed = time.perf_counter() - started
    return State(step, delta, nan, nan, nan, nan, nan, iterations, elapsed, converged=False, reason=reason)


def _limit(scene: Scene) -> str:
    law = scene.physics.material
    return f"; Gent's law has no strain beyond I1 - 3 = Jm = {law.Jm:g}" if isinstance(law, Gent) else ""


def _advice(scene: Scene) -> str:
    """What a user can change, the most promising first."""
    rounded = next((key for key in ("tip_radius", "edge_radius") if getattr(scene.physics.indenter, key, 0.0)), None)
    law: Any = scene.physics.contact
    ways = [
        *(["solver.linear: direct"] if scene.solver.linear == "iterative" else []),
        *(["contact.epsilon_t: auto"] if law.friction and law.epsilon_t != law.stiffness else []),
        *(["contact.friction: 5"] if scene.physics.contact.friction == "stick" else []),
        *(["a hyperelastic material"] if scene.physics.small_strain and scene.physics.gap == "current" else []),
        *([f"a larger indenter.{rounded}"] if rounded else []),
        *(["contact.method: augmented_lagrangian"] if scene.physics.contact.method != "augmented_lagrangian" else []),
        *(["nu slightly below 0.5"] if scene.physics.material.constants.nu == 0.5 else []),
        "another mesh.h_contact",
    ]
    return " or ".join(ways)
