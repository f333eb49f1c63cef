"""Failed increments of a load path: the place, the cause and possible remedies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import Gent
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

if TYPE_CHECKING:
    from indent_sim.fe.terms.inverted_elements import InvertedElements


class LastEquilibrium(NamedTuple):
    """The last equilibrium before a failed increment.

    Attributes
    ----------
    force, delta
        Force [force] and depth [length].
    t
        Time [time]; 0 for a body that does not change in time.
    slide
        Horizontal displacement of the tip [length].
    """

    force: float
    delta: float
    t: float = 0.0
    slide: float = 0.0


def failed_state(
    scene: Scene,
    step: int,
    value: float,
    last_equilibrium: LastEquilibrium,
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
        Force, depth, time and slide of the last equilibrium.
    cause
        Reason why the solution failed.
    inverted
        Points with the smallest J and the largest stretch of the last equilibrium; None if no
        element is inverted.
    cost
        Newton iterations and time since the beginning of the run [s].
    """
    nan = float("nan")
    D = scene.physics.scales.depth
    F = scene.physics.scales.force
    target = f"delta = {value * D:.6g}"
    last_place = f"delta = {last_equilibrium.delta * D:.6g}"
    delta = value
    if scene.physics.path.control == "force":
        target = f"force = {value * F:.6g}"
        last_place = f"{last_place}, force = {last_equilibrium.force * F:.6g}"
        delta = last_equilibrium.delta
    t = None
    if scene.physics.path.start_time is not None:
        t = scene.physics.path.times[step - 1]
        target = f"t = {t:.6g}, {target}"
        last_place = f"t = {last_equilibrium.t:.6g}, {last_place}"
    slide = None
    if scene.physics.slides:
        L = scene.physics.scales.length
        slide = scene.physics.path.slide(step)
        target = f"{target}, x = {slide * L:.6g}"
        last_place = f"{last_place}, x = {last_equilibrium.slide * L:.6g}"
    law = scene.physics.material
    method = scene.physics.contact.method
    reason = (
        f"contact method {method} did not converge at {target}: {cause}; the last "
        f"equilibrium found is at {last_place}"
    )
    if inverted:
        reason += inverted.message(scene) + _solvent_text(scene, inverted)
    if scene.physics.is_swelling and last_equilibrium.force == 0:
        reason += "; the tip does not touch the gel there"
    if isinstance(law, Gent):
        reason += f"; Gent's law allows no strain beyond I1 - 3 = Jm = {law.Jm:g}"
    if scene.physics.creasing_message:
        reason += f"; {scene.physics.creasing_message}: less swelling helps"
    if scene.physics.demixing_message:
        reason += f"; {scene.physics.demixing_message}"
    reason += _advice(scene)
    missing = (nan,) * 5
    return State(step, delta, *missing, *cost, t=t, x=slide, converged=False, reason=reason)


def _solvent_text(scene: Scene, inverted: InvertedElements) -> str:
    """Return a text on the solvent left in a gel at the smallest J; "" if no gel shrinks."""
    law = scene.physics.material
    if not (isinstance(law, Gel) and scene.physics.is_swelling and inverted.J < 1):
        return ""
    solvent = (law.swelling_ratio(inverted.J) - 1) / (law.swelling_ratio(1.0) - 1)
    return f"; where J is smallest, the gel has {100 * solvent:.2g} % of its solvent left"


def _advice(scene: Scene) -> str:
    """Return the end of the message on a failure: changes of the scene that may help."""
    rounding_key = next(
        (key for key in ("tip_radius", "edge_radius") if getattr(scene.physics.indenter, key, 0.0)),
        None,
    )
    law: Any = scene.physics.contact
    is_drop = scene.physics.is_drop
    remedies: list[str] = []
    if scene.physics.slides:
        remedies.append("more loading.slide.steps")
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
    return f"; {' or '.join(remedies)} may help" if remedies else ""
