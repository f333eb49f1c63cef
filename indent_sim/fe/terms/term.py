"""Term: a part of the virtual work over one step, with what it remembers of the steps before.

A step leads from the state that was accepted last to a new one in one stage or two, each an
equilibrium of its own:

    begin(stage), Newton, end(stage)   for each stage;   accept() after the last one, or back to
    before the first.
"""

from __future__ import annotations

from dataclasses import dataclass

import ufl
from dolfinx import fem
from petsc4py import PETSc

from indent_sim.fe.discrete_body import TimeLevel
from indent_sim.mesh.reactions import SurfaceComponent


@dataclass(frozen=True)
class Stage:
    """A part of a step: backward Euler over `dt` [time], to the share `end` of the step, `passed`
    [time] after its begin. It sets out from before + share (one - before), with the result `one`
    of the stage before.
    """

    dt: float
    elapsed: float = 0.0
    end_fraction: float = 1.0
    extrapolation_factor: float = 0.0


SDIRK2_GAMMA = (
    1 - 0.5**0.5
)  # of SDIRK2, which is L-stable and of second order with it (Alexander 1977)


def sdirk2_stages(dt: float) -> list[Stage]:
    """The two stages of SDIRK2 for a step of `dt` [time]."""
    first_dt = SDIRK2_GAMMA * dt
    extrapolation_factor = (1 - SDIRK2_GAMMA) / SDIRK2_GAMMA
    return [
        Stage(first_dt, first_dt, end_fraction=SDIRK2_GAMMA),
        Stage(first_dt, dt, extrapolation_factor=extrapolation_factor),
    ]


class Term:
    """A part of the virtual work.

    What a term does not have it does not say: these are the answers of a plain energy.

    energy: its share of the potential, a UFL form, or None. fields: the names of the fields that
    came with it. history: functions that carry what it remembers beside the unknowns; they are kept
    with every state, never extrapolated, and change in `accept` alone. frozen: functions of the
    present guess that Newton does not solve for. has_memory: whether an equilibrium depends on the
    path to it. setting: changes with what the tangent depends on beside the state.
    """

    energy: ufl.Form = None
    field_names: tuple[str, ...] = ()
    history: tuple[fem.Function, ...] = ()
    frozen: tuple[fem.Function, ...] = ()
    has_memory = False
    has_symmetric_tangent = True
    is_bulk = False  # whether it is there without the tip
    has_constant_tangent = False  # whether its tangent is the same at every state
    has_membrane = False  # whether it can hold more firmly what little holds
    has_flow = False  # whether a step in time takes two stages
    tangent_version = 0
    _continuation_factor = 1.0  # by Newton's method, on its way to an equilibrium: see `soften`
    _modulus_ratio = 1.0  # as what the tip touches is now: see `follow`

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """The virtual work along now.test, a UFL form; None of a term that adds its rows itself."""
        return ufl.derivative(self.energy, now.function, now.test)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """The derivative of the virtual work along now.trial."""
        work = self.virtual_work(now, before, dt)
        return None if work is None else ufl.derivative(work, now.function, now.trial)

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add rows that no form has."""

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add their derivatives."""

    def begin_stage(self, stage: Stage) -> None:
        """Set out on a stage."""

    def begin_solve(self) -> None:
        """Forget what the last Newton iteration has remembered."""

    def end_stage(self, stage: Stage) -> None:
        """The stage's equilibrium is found."""

    def accept(self) -> None:
        """The step is done: what is remembered moves on."""

    def set_continuation_factor(self, factor: float) -> None:
        """Multiply the stiffness of contact; 1 makes it the law's own again."""
        self._continuation_factor = factor
        self.scale_stiffness(self._continuation_factor * self._modulus_ratio)

    def set_membrane_stiffness(self, stiffness: float) -> None:
        """Hold the surface of a drop by so much of its tension in its plane."""

    def follow_modulus(self, modulus_ratio: float) -> None:
        """Let the stiffness of contact follow the modulus of what the tip touches: that of the
        moment is so many times that of the first moment.
        """
        self._modulus_ratio = modulus_ratio
        self.scale_stiffness(self._continuation_factor * self._modulus_ratio)

    def scale_stiffness(self, factor: float) -> None:
        """Set the penalty stiffness to `factor` times that of the contact law; terms without a
        penalty ignore it.
        """

    def force(self) -> float:
        """The virtual work of pressing deeper [force], this rank's share of the modelled part."""
        return 0.0

    def side_force(self, axis: int) -> float:
        """Force on the tip along a horizontal axis [force], this rank's share of the modelled part."""
        return 0.0

    def reactions(self) -> dict[SurfaceComponent, float]:
        """Forces on the body [force] of a support that this term stands for, by
        `mesh.reactions.bearing_surfaces`: this rank's share on the modelled part.
        """
        return {}

    def dissipation(self) -> float:
        """What is lost in the step to the present state [energy], this rank's share of the modelled
        part.
        """
        return 0.0
