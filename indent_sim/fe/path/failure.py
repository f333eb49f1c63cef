"""Failed increments of a load path: the place, the cause and possible remedies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from indent_sim.fe.path.load_control import ForceDepth
from indent_sim.model.hyperelasticity import Gent
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.inverted_elements import InvertedElements


def failed_state(
    scene: Scene,
    step: int,
    value: float,
    last_equilibrium: ForceDepth,
    cause: str,
    inverted: InvertedElements | None,
    cost: tuple[int, float],
) -> State:
    """Return the State of a depth or force at which no equilibrium was found.

    Parameters
    ----------
    scene, step, value
        The scene, the number of the row and its prescribed depth or force.
    last_equilibrium
        Force and depth of the last equilibrium.
    cause
        Reason why the solution failed.
    inverted
        Points with the smallest J and the largest stretch of the last equilibrium; None if J > 0
        everywhere.
    cost
        Newton iterations and time since the beginning of the run [s].
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
    reason = (
        f"contact method {method} did not converge at {target}: {cause}; the last "
        f"equilibrium found is at {last_place}"
    )
    if inverted:
        reason += inverted.message(scene)
    if isinstance(law, Gent):
        reason += f"; Gent's law allows no strain beyond I1 - 3 = Jm = {law.Jm:g}"
    if scene.physics.creasing_message:
        reason += f"; {scene.physics.creasing_message}: less swelling helps"
    reason += _advice(scene)
    return State(step, delta, nan, nan, nan, nan, nan, *cost, converged=False, reason=reason)


def _advice(scene: Scene) -> str:
    """Return the end of the message, which names changes of the scene that may help."""
    rounding_key = next(
        (key for key in ("tip_radius", "edge_radius") if getattr(scene.physics.indenter, key, 0.0)),
        None,
    )
    law: Any = scene.physics.contact
    is_drop = scene.physics.is_drop
    remedies: list[str] = []
    if scene.solver.linear == "iterative":
        remedies.append("solver.linear: direct")
    remedies += law.remedies
    if scene.physics.small_strain and scene.physics.gap == "current":
        remedies.append("a hyperelastic material")
    if rounding_key:
        remedies.append(f"a larger indenter.{rounding_key}")
    if scene.physics.contact.method != "augmented_lagrangian":
        remedies.append("contact.method: augmented_lagrangian")
    if scene.physics.material.constants.nu == 0.5 and not is_drop:
        remedies.append("nu slightly below 0.5")
    if is_drop:
        remedies.append(f"a larger shear modulus: gamma/(mu R) is {scene.physics.drop_number:.2g}")
    if not law.may_snap_through:  # a different mesh has never helped where a tip snaps
        remedies.append("another mesh.h_contact")
    return f"; {' or '.join(remedies)} may help" if remedies else ""
