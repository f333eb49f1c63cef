"""Base class of the terms of the virtual work.

A load or time increment advances the accepted state in one or two stages, each of which ends in an
equilibrium:

    begin_stage(stage), Newton's method, end_stage(stage)   for each stage,
    accept()                                                after the last stage.

If an increment fails, the state before its first stage is restored and `accept` is not called.
"""

from __future__ import annotations

import ufl
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe.terms.time_integration import Stage
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.mesh.reactions import SurfaceComponent


class Term:
    """Base class of the terms of the virtual work over one load or time increment.

    The defaults describe a term with a potential, without internal variables and without additional
    fields; subclasses override what differs.

    Attributes
    ----------
    energy : ufl.Form or None
        Contribution to the potential; None if the term has no potential.
    field_names : tuple of str
        Unknown fields that the term introduces in addition to the displacement.
    history : tuple of fem.Function
        Internal variables. They are stored with every state, are never extrapolated, and change
        in `accept` only.
    frozen : tuple of fem.Function
        Fields of the trial state that are no unknowns: they are held fixed while Newton's method
        runs and updated between its runs, like the multiplier of Uzawa's method.
    has_memory : bool
        Whether an equilibrium depends on the load path that leads to it.
    has_symmetric_tangent : bool
        Whether the tangent of the term is symmetric.
    is_bulk : bool
        Whether the term describes the body and not its contact with the tip.
    has_constant_tangent : bool
        Whether the tangent is the same at every state.
    has_membrane : bool
        Whether the term has a membrane stiffness, see `set_membrane_stiffness`.
    has_flow : bool
        Whether a time step needs the two stages of SDIRK2.
    couples_surfaces : bool
        Whether `add_tangent` couples dofs that no cell shares, so that the matrix gains entries.
    tangent_version : int
        Number that changes whenever something other than the state changes the tangent.
    """

    energy: ufl.Form = None
    field_names: tuple[str, ...] = ()
    history: tuple[fem.Function, ...] = ()
    frozen: tuple[fem.Function, ...] = ()
    has_memory = False
    has_symmetric_tangent = True
    is_bulk = False
    has_constant_tangent = False
    has_membrane = False
    has_flow = False
    couples_surfaces = False
    tangent_version = 0
    # Factors of the contact stiffness, see `set_continuation_factor` and `scale_contact_stiffness`
    _continuation_factor = 1.0
    _modulus_ratio = 1.0

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Return the virtual work along `now.test`, or None if `add_residual` assembles it."""
        return ufl.derivative(self.energy, now.function, now.test)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Return the derivative of the virtual work along `now.trial`, a UFL form or None."""
        work = self.virtual_work(now, before, dt)
        return None if work is None else ufl.derivative(work, now.function, now.trial)

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the part of the residual that is not a UFL form."""

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the part of the tangent that is not a UFL form."""

    def begin_stage(self, stage: Stage) -> None:
        """Prepare the stage from the internal variables of the accepted state."""

    def begin_solve(self) -> None:
        """Reset the data recorded during the previous solve."""

    def end_stage(self, stage: Stage) -> None:
        """Compute from the equilibrium of this stage the data that the next stage needs."""

    def accept(self) -> None:
        """Update the internal variables to the end of the increment."""

    def set_continuation_factor(self, factor: float) -> None:
        """Multiply the contact stiffness by a factor; 1 restores the stiffness of the law."""
        self._continuation_factor = factor
        self.scale_stiffness(self._continuation_factor * self._modulus_ratio)

    def set_membrane_stiffness(self, stiffness: float) -> None:
        """Set the shear modulus of a drop's surface membrane, divided by the surface tension."""

    def scale_contact_stiffness(self, modulus_ratio: float) -> None:
        """Scale the contact stiffness in proportion to the modulus of the body.

        Parameters
        ----------
        modulus_ratio : float
            Present plane-strain modulus of the body under the tip, divided by the initial one.
        """
        self._modulus_ratio = modulus_ratio
        self.scale_stiffness(self._continuation_factor * self._modulus_ratio)

    def scale_stiffness(self, factor: float) -> None:
        """Set the penalty stiffness to `factor` times its value in the contact law.

        Terms without a penalty ignore it.
        """

    def limit_curvature(self, *, is_limited: bool) -> None:
        """Switch the limit of the pressure in the tangent's curvature term on or off.

        Terms without a contact multiplier ignore it.
        """

    def force(self) -> float:
        """Virtual work per indentation depth [force], this rank's part in the model domain."""
        return 0.0

    def side_force(self, axis: int) -> float:
        """Horizontal force on the tip along an axis [force], this rank's part."""
        return 0.0

    def moment(self) -> float:
        """Moment of the vertical force on the tip [force length], this rank's part."""
        return 0.0

    def reactions(self) -> dict[SurfaceComponent, float]:
        """Reaction of each support that this term represents [force], this rank's part.

        The keys are those of `mesh.reactions.bearing_surfaces`; the values are forces of the
        support on the model domain.
        """
        return {}

    def dissipation(self) -> float:
        """Energy dissipated by friction in the current increment, this rank's part."""
        return 0.0

    def plastic_dissipation(self) -> float:
        """Energy dissipated by plastic flow since the undeformed state, this rank's part."""
        return 0.0

    def hold_plastic_flow(self, *, is_held: bool) -> None:
        """Suppress plastic flow, so that the body responds elastically, or allow it again."""
