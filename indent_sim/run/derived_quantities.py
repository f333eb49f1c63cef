"""Derived quantities of a row: stiffness, contact area and modulus of a half-space fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from math import nan
from typing import Any

from indent_sim.model.state import State
from indent_sim.run.run_output import OptionalOutput
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.scene.tip_theories import theory_tip_shape
from indent_sim.theory.contacts_in_series import ContactsInSeries
from indent_sim.theory.punches import FittedPunches, LayerPunches, Punches, contact_radius
from indent_sim.theory.solution import SOLUTION_ERRORS

# The equilibrium of `fe` that has just been solved; `fe` is loaded only to solve a mesh.
Equilibrium = Any
# Punches of both contacts of a body that rests on a flat, `fe.condensed.flat_punches.BothContacts`.
BothContacts = Any


class DerivedQuantities:
    """Computes the derived quantities of successive states, all nondimensional.

    The stiffness is the tangent dF/ddelta. For a solution by theory and for a condensed
    axisymmetric body, it is computed as the stiffness of a flat punch with the contact radius,
    because the tangent on a mesh jumps by a per cent whenever a new point comes into contact. For a
    body that yields, it is the tangent at the beginning of unloading.

    Parameters
    ----------
    scene
        The scene.
    equilibrium
        Equilibrium of the body at the current state; None without a mesh.
    optional_output
        Evaluates the quantities; a failure is reported and does not stop the run.
    """

    def __init__(
        self,
        scene: Scene,
        equilibrium: Equilibrium = None,
        optional_output: OptionalOutput | None = None,
    ):
        self.scene = scene
        self._equilibrium = equilibrium
        self._optional_output = optional_output or OptionalOutput()
        self._condensed_to = -1  # number of surface nodes for which `_punches` was computed
        self._punches: Punches | None = None

    def complete_state(self, state: State) -> State:
        """Return the state with its stiffness, area and E_hertz; undefined quantities are NaN.

        For a body that yields these are the unloading stiffness, the contact area and the hardness.
        """
        if not state.converged:
            return state
        krylov_before = self._krylov_iterations
        stiffness = self._optional_output("stiffness", lambda: self._stiffness(state), nan)
        area = self._optional_output(
            "area", lambda: self.scene.physics.domain.kinematics.contact_area(state.a), nan
        )
        if self.scene.physics.yields:
            values = {"unloading_stiffness": stiffness, "contact_area": area}
            values["hardness"] = state.force / area if area > 0 else nan
        else:
            E_hertz = self._optional_output("E_hertz", lambda: self._hertz_modulus(state), nan)
            values = {"stiffness": stiffness, "area": area, "E_hertz": E_hertz}
        if self.scene.physics.path.unloading:
            values["residual_depth"] = self._residual_depth(state)
        if state.krylov_iterations is not None:
            values["krylov_iterations"] = (
                state.krylov_iterations + self._krylov_iterations - krylov_before
            )
        return State(**vars(state) | values)

    @property
    def _krylov_iterations(self) -> int:
        """Krylov iterations of the body so far."""
        return (self._equilibrium.statistics.krylov or 0) if self._equilibrium else 0

    def _hertz_modulus(self, state: State) -> float:
        """Return the modulus with which the half-space formula gives the force of the state.

        The modulus is NaN if the force is zero or there is no formula.
        """
        physics = self.scene.physics
        # The force of the state is round-off if a force of zero is prescribed.
        if physics.path.control == "force" and physics.path.values[state.step - 1] == 0:
            return nan
        (force,) = hertz_forces(self.scene, [state.delta]) if state.force > 0 else [None]
        return physics.material.constants.E * state.force / force if force else nan

    def _residual_depth(self, state: State) -> float:
        """Return the depth of the last row of unloading [length]; NaN unless its force is zero."""
        physics = self.scene.physics
        assert physics.path.unloading
        # Round-off of the force, relative to that of a contact with a strain of about 1.
        force_roundoff = 1e-12
        a = self.scene.plan.prediction["a"] / physics.scales.length
        largest_force = physics.contact_modulus * a ** (physics.scales.dim - 1)
        has_let_go = state.force <= force_roundoff * largest_force
        return state.delta if has_let_go and state.step == physics.path.unloading.last else nan

    def _stiffness(self, state: State) -> float:
        """Return dF/ddelta at the state; NaN if it depends on the direction or rate of loading."""
        if state.stiffness is not None:
            return state.stiffness
        physics = self.scene.physics
        # With creep it is the stiffness of a sudden unloading, in which nothing flows.
        if physics.has_friction or (physics.is_time_dependent and not physics.yields):
            return nan
        if self.scene.plan.adhesion is None and (state.delta <= 0 or state.force <= 0):
            return 0.0
        if self._equilibrium is None:
            return nan
        if (
            self.scene.solver.method == "condensed"
            and physics.domain.kinematics.name == "axisymmetric"
        ):
            with suppress(*SOLUTION_ERRORS):
                nodes = self._equilibrium.contact.compliance.size
                if self._punches is None or nodes != self._condensed_to:
                    self._punches = punches_of(self.scene, self._equilibrium)
                    self._condensed_to = nodes
                return self._punches.punch_of_radius(
                    contact_radius(self._punches, state.delta, state.a)
                ).stiffness
        return float(self._equilibrium.stiffness)


def punches_of(scene: Scene, equilibrium: Equilibrium = None) -> Punches:
    """Return flat punches of every radius on a linear axisymmetric body.

    The punches are solved by theory or by static condensation.

    Raises
    ------
    ValueError
        If the contact does not grow with the load, the theory does not include the shape of the
        tip, or the contact has too few elements.
    """
    theory = scene.plan.theory
    physics = scene.physics
    if not scene.is_meshed and theory is not None:
        return LayerPunches(theory.contact)  # type: ignore[arg-type]
    shape = theory.contact.tip if theory else theory_tip_shape(physics.indenter)
    if (
        shape is None
        or shape.punch_radius is not None
        or physics.domain.kinematics.name != "axisymmetric"
    ):
        raise ValueError("the contact is not a circle that grows with the load")
    if physics.domain.rests_on_flat:
        raise ValueError("the body has two contacts, each with a radius of its own")
    a, K, P = equilibrium.punches()
    return FittedPunches(a, K, P, shape, physics.contact_modulus)


def fit_both_contacts(scene: Scene, both_contacts: BothContacts) -> tuple[Punches, Punches]:
    """Return the flat punches of tip and flat on a body that rests on the flat.

    Parameters
    ----------
    scene
        The scene.
    both_contacts
        The punches on the mesh.

    Raises
    ------
    ValueError
        If there is no theory of two contacts, or if one of them has too few elements.
    """
    theory = scene.plan.theory
    if theory is None or not isinstance(theory.contact, ContactsInSeries):
        raise ValueError(
            "no theory describes the contacts of this body with the tip and with the flat"
        )
    a, K, P = both_contacts.upper
    physics = scene.physics
    upper = FittedPunches(a, K, P, theory.contact.upper.tip, physics.contact_modulus)
    a, K, P = both_contacts.lower
    return upper, FittedPunches(a, K, P, theory.contact.lower.tip, physics.material.E_star)


def hertz_forces(scene: Scene, deltas: Iterable[float]) -> list[float | None]:
    """Return the nondimensional forces at depths by the half-space formula of the tip.

    A force is None if there is no formula. If the body has mirror images, the forces include only
    the part that acts on the body itself.
    """
    physics = scene.physics
    if physics.scales.dim == 2:
        return [None for _ in deltas]
    tip = relative_tip(physics.indenter, physics.body)
    E_star = physics.material.E_star
    formulas = (half_space_force(tip, delta, E_star) for delta in deltas)
    return [formula[1] / physics.mirror_multiplicity if formula else None for formula in formulas]


def hertz_fit(scene: Scene, states: Sequence[State]) -> dict[str, Any] | None:
    """Fit the half-space formula to the rows of a run by least squares.

    Returns
    -------
    dict or None
        `E`: the modulus [user's units]; `percent`: the difference from the modulus of the material
        below the tip; `against`: the name of this material if there are several. None with adhesion
        or yield, or if there is no formula or no contact.
    """
    if scene.plan.adhesion or scene.physics.yields:
        return None
    D = scene.physics.scales.depth
    F = scene.physics.scales.force
    unit_forces = hertz_forces(scene, (state.delta / D for state in states))
    points = [
        (state.force / F, force) for state, force in zip(states, unit_forces, strict=True) if force
    ]
    total = sum(force**2 for _, force in points)
    if not total:
        return None
    ratio = sum(run_force * force for run_force, force in points) / total
    percent = 100 * (ratio - 1)
    E = scene.physics.material.constants.E * scene.physics.scales.pressure
    touched, *other_regions = scene.physics.domain.regions
    modulus_text = f", against E = {E:.4g} of {touched.name}" if other_regions else ""
    return {
        "E": ratio * E,
        "percent": percent if abs(percent) >= 1e-6 else 0.0,
        "against": modulus_text,
    }
