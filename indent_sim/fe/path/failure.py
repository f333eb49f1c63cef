"""Failure of a load path: where it ended, why, and what may help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from indent_sim.fe.path.load_control import ForceDepth
from indent_sim.model.hyperelasticity import Gent
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.strain_energy import InvertedElements


def failed_state(
    scene: Scene,
    step: int,
    value: float,
    last_equilibrium: ForceDepth,
    cause: str,
    inverted: InvertedElements | None,
    cost: tuple[int, float],
) -> State:
    """The State that says that and why there is none at this depth or force. last: force and depth
    of the last equilibrium; crushed: where its J is smallest; spent: iterations and seconds.
    """
    nan = float("nan")
    D = scene.physics.scales.depth
    F = scene.physics.scales.force
    target = f"delta = {value * D:.6g}"
    last_place = f"delta = {last_equilibrium[1] * D:.6g}"
    delta = value
    if scene.physics.path.control == "force":
        target = f"force = {value * F:.6g}"
        last_place = f"{last_place}, force = {last_equilibrium[0] * F:.6g}"
        delta = last_equilibrium[1]
    law = scene.physics.material
    method = scene.physics.contact.method
    limit = (
        f"; Gent's law has no strain beyond I1 - 3 = Jm = {law.Jm:g}"
        if isinstance(law, Gent)
        else ""
    )
    discontinuities = (
        f"; {scene.physics.creasing_message}: less swelling helps"
        if scene.physics.creasing_message
        else ""
    )
    reason = (
        f"contact method {method} did not converge at {target}: {cause}; the last "
        f"equilibrium found is at {last_place}"
    )
    reason += (
        f"{inverted.message(scene) if inverted else ''}{limit}{discontinuities}{_advice(scene)}"
    )
    return State(step, delta, nan, nan, nan, nan, nan, *cost, converged=False, reason=reason)


def _advice(scene: Scene) -> str:
    rounding_key = next(
        (key for key in ("tip_radius", "edge_radius") if getattr(scene.physics.indenter, key, 0.0)),
        None,
    )
    law: Any = scene.physics.contact
    is_drop = scene.physics.is_drop
    remedies = [
        *(["solver.linear: direct"] if scene.solver.linear == "iterative" else []),
        *law.remedies,
        *(
            ["a hyperelastic material"]
            if scene.physics.small_strain and scene.physics.gap == "current"
            else []
        ),
        *([f"a larger indenter.{rounding_key}"] if rounding_key else []),
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
            ["another mesh.h_contact"] if not law.may_snap_through else []
        ),  # where a tip snaps that never helped
    ]
    return f"; {' or '.join(remedies)} may help" if remedies else ""
