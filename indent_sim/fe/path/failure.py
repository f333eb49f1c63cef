"""Failure of a load path: where it ended, why, and what may help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from indent_sim.fe.path.load_control import Pair
from indent_sim.model.materials import Gent
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.strain import Crushed


def failed_state(
    scene: Scene,
    step: int,
    value: float,
    last: Pair,
    why: str,
    crushed: Crushed | None,
    spent: tuple[int, float],
) -> State:
    """The State that says that and why there is none at this depth or force. last: force and depth
    of the last equilibrium; crushed: where its J is smallest; spent: iterations and seconds.
    """
    nan = float("nan")
    D = scene.physics.scales.depth
    F = scene.physics.scales.force
    wanted = f"delta = {value * D:.6g}"
    place = f"delta = {last[1] * D:.6g}"
    delta = value
    if scene.physics.path.control == "force":
        wanted = f"force = {value * F:.6g}"
        place = f"{place}, force = {last[0] * F:.6g}"
        delta = last[1]
    law = scene.physics.material
    method = scene.physics.contact.method
    limit = (
        f"; Gent's law has no strain beyond I1 - 3 = Jm = {law.Jm:g}"
        if isinstance(law, Gent)
        else ""
    )
    creases = f"; {scene.physics.creases}: less swelling helps" if scene.physics.creases else ""
    reason = (
        f"contact method {method} did not converge at {wanted}: {why}; the last "
        f"equilibrium found is at {place}"
    )
    reason += f"{crushed.words(scene) if crushed else ''}{limit}{creases}{_advice(scene)}"
    return State(step, delta, nan, nan, nan, nan, nan, *spent, converged=False, reason=reason)


def _advice(scene: Scene) -> str:
    rounded = next(
        (key for key in ("tip_radius", "edge_radius") if getattr(scene.physics.indenter, key, 0.0)),
        None,
    )
    law: Any = scene.physics.contact
    is_drop = scene.physics.is_drop
    ways = [
        *(["solver.linear: direct"] if scene.solver.linear == "iterative" else []),
        *law.remedies,
        *(
            ["a hyperelastic material"]
            if scene.physics.small_strain and scene.physics.gap == "current"
            else []
        ),
        *([f"a larger indenter.{rounded}"] if rounded else []),
        *(
            ["contact.method: augmented_lagrangian"]
            if scene.physics.contact.method != "augmented_lagrangian"
            else []
        ),
        *(
            ["nu slightly below 0.5"]
            if scene.physics.material.constants.nu == 0.5 and not is_drop
            else []
        ),
        *(
            [f"more shear modulus: gamma/(mu R) is {scene.physics.drop_number:.2g}"]
            if is_drop
            else []
        ),
        *(
            ["another mesh.h_contact"] if not law.may_snap else []
        ),  # where a tip snaps that never helped
    ]
    return f"; {' or '.join(ways)} may help" if ways else ""
