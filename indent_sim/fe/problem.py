"""The discrete problem: residual, tangent and state of a sum of terms of the virtual work.

    Pi(u, q, lam; delta) = int psi dOmega + int potential(g, lam) dGamma

is the potential of the displacement u, the pressure fields q and the contact multiplier lam at the
depth delta. The residual is its first variation, the tangent its second variation, and the force
its derivative with respect to delta. The terms are implemented in `fe.terms`. A term without a
potential, such as friction, adds its virtual work to the residual.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_form
from indent_sim.fe.terms.term import Term
from indent_sim.fe.terms.time_integration import Stage, sdirk2_stages
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.mesh.reactions import SurfaceComponent
from indent_sim.model.units import round_length


@dataclass(frozen=True)
class Snapshot:
    """Unknowns and internal variables of an equilibrium.

    Attributes
    ----------
    depth : float
        Indentation depth delta [length].
    unknowns : tuple of PETSc.Vec
        Solution vector and the functions that are fixed during Newton's method; all these unknowns
        may be extrapolated and interpolated.
    history : tuple of ndarray
        Internal variables of the terms, which must not be extrapolated.
    t : float
        Time [time].
    modulus_ratio : float
        Modulus by which the contact stiffness was scaled, divided by the initial modulus.
    slide : float
        Horizontal displacement of the tip from where it was pressed in [length].
    """

    depth: float
    unknowns: tuple[PETSc.Vec, ...]
    history: tuple[np.ndarray, ...] = ()
    t: float = 0.0
    modulus_ratio: float = 1.0
    slide: float = 0.0


class Problem:
    """Discrete problem: the sum of the terms of the virtual work of a body.

    Attributes
    ----------
    frozen : list of fem.Function
        Functions of the current iterate that are fixed during Newton's method.
    histories : list of fem.Function
        Internal variables of all terms.
    """

    def __init__(self, body: Body, terms: Iterable[Term]):
        self.body = body
        self.terms = list(terms)
        self.scene = body.scene
        self.law = body.scene.physics.contact
        self.mesh = body.mesh
        self.comm = body.comm
        self.unknowns = body.unknowns
        self.x = body.x
        self.delta = body.now.delta
        self._residual_form = compile_form(
            _sum_forms(term.virtual_work(*self._time_levels(term)) for term in self.terms)
        )
        self._energy_form = compile_form(_sum_forms(term.energy for term in self.terms))
        self.b = compat.create_vector(self._residual_form, body.unknowns.space)
        self.frozen = [function for term in self.terms for function in term.frozen]
        self.histories = [function for term in self.terms for function in term.history]
        self._vectors = [self.x, *(compat.petsc_vector(function) for function in self.frozen)]
        self.has_symmetric_tangent = all(term.has_symmetric_tangent for term in self.terms)
        self.has_memory = any(term.has_memory for term in self.terms)
        self.has_flow = any(term.has_flow for term in self.terms)
        self._modulus_ratio = 1.0

    @property
    def can_reuse_tangent(self) -> bool:
        """True if the tangent may be reused from step to step while the contact does not change.

        The conditions are fluid flow, a linear body and a frictionless contact.
        """
        return self.has_flow and self.scene.physics.is_linear and self.law.is_conservative

    def _time_levels(self, term: Term) -> tuple[TimeLevel, TimeLevel, fem.Constant]:
        """Return the arguments of a term's forms: current and accepted time level, and time step.

        For a path-independent term the current level is returned twice, so that `Body.before` need
        not be created.
        """
        before = self.body.before if term.has_memory else self.body.now
        return self.body.now, before, self.body.dt

    @cached_property
    def _tangent_form(self) -> fem.Form:
        return compile_form(
            _sum_forms(term.tangent(*self._time_levels(term)) for term in self.terms)
        )

    def create_tangent(self) -> PETSc.Mat:
        """Create the matrix that `assemble_tangent` fills."""
        matrix = fem_petsc.create_matrix(self._tangent_form)
        if any(term.couples_surfaces for term in self.terms):
            # The pattern of the forms is that of cells; PETSc adds further entries as they come.
            matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        return matrix

    @property
    def depth(self) -> float:
        """Current indentation depth delta [length]."""
        return float(self.delta.value)

    @cached_property
    def row_weights(self) -> np.ndarray:
        """Factors (owned dofs,) that convert the residual of each field into forces.

        The residuals of the fields have different units (force, volume, length), and their common
        norm needs one unit.
        """
        weights = np.ones(self.unknowns.owned_count)
        for name, field in self.unknowns.fields_by_name.items():
            dofs = self.unknowns.dofs(name)
            weights[dofs[dofs < self.unknowns.owned_count]] = field.weight
        return weights

    @property
    def tangent_parameters(self) -> tuple[float, ...]:
        """Quantities on which the tangent depends, other than the state.

        While they are unchanged, an earlier tangent is a good preconditioner.
        """
        return round_length(float(self.body.dt.value)), *(
            term.tangent_version for term in self.terms
        )

    def set_continuation_factor(self, factor: float) -> None:
        """Multiply the contact stiffness by a factor; 1 restores the stiffness of the law."""
        for term in self.terms:
            term.set_continuation_factor(factor)

    def limit_curvature(self, *, is_limited: bool) -> None:
        """Switch the limit of the pressure in the tangent's curvature term on or off.

        The limit is needed far from equilibrium; see `terms.contact.traction.Traction.tangent`.
        """
        for term in self.terms:
            term.limit_curvature(is_limited=is_limited)

    @property
    def has_membrane(self) -> bool:
        """True if a term has a membrane stiffness; see `set_membrane_stiffness`."""
        return any(term.has_membrane for term in self.terms)

    def set_membrane_stiffness(self, stiffness: float) -> None:
        """Set the shear modulus of a drop's surface membrane, divided by the surface tension.

        See `terms.surface_tension`.
        """
        for term in self.terms:
            term.set_membrane_stiffness(stiffness)

    def scale_contact_stiffness(self, modulus_ratio: float) -> None:
        """Scale the contact stiffness by the ratio of the body's current to its initial modulus."""
        self._modulus_ratio = modulus_ratio
        for term in self.terms:
            term.scale_contact_stiffness(modulus_ratio)

    def begin_solve(self) -> None:
        """Set the prescribed values and reset the data that terms record during a solve."""
        self.body.apply_prescribed_values()
        for term in self.terms:
            term.begin_solve()

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """Assemble the residual at the present solution; constrained rows of `b` are reactions."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual_form)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        for term in self.terms:
            term.add_residual(b)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """Assemble the tangent at the current solution, with identity rows for constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent_form, self.body.bcs)
        A.assemble(PETSc.Mat.AssemblyType.FLUSH)
        for term in self.terms:
            term.add_tangent(A)
        A.assemble()

    def stages(self, dt: float) -> list[Stage]:
        """Return the stages of a step of length `dt` [time]: two with flow (SDIRK2), else one."""
        return sdirk2_stages(dt) if dt and self.has_flow else [Stage(dt, dt)]

    def begin_stage(self, stage: Stage) -> None:
        """Prepare all terms for a stage."""
        self.body.begin_stage(stage.dt, stage.elapsed)
        for term in self.terms:
            term.begin_stage(stage)

    def end_stage(self, stage: Stage) -> None:
        """Let all terms update their data from the equilibrium of a stage."""
        for term in self.terms:
            term.end_stage(stage)

    def accept(self) -> None:
        """Make the current state the accepted state, from which the next increment starts."""
        for term in self.terms:
            term.accept()
        self.body.accept()

    def trial_state(self) -> list[PETSc.Vec]:
        """Return copies of the solution vector and of the functions in `frozen`."""
        return [vector.copy() for vector in self._vectors]

    def set_trial_state(self, trial_state: Sequence[PETSc.Vec]) -> None:
        """Set the unknowns to a trial state or a combination of several.

        Internal variables do not change.
        """
        for vector, values in zip(self._vectors, trial_state, strict=True):
            values.copy(vector)
            vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def snapshot(self) -> Snapshot:
        """Copy the current state, which must have been accepted."""
        internal_variables = tuple(function.x.array.copy() for function in self.histories)
        return Snapshot(
            self.depth,
            tuple(self.trial_state()),
            internal_variables,
            float(self.body.now.t.value),
            self._modulus_ratio,
            self.body.slide,
        )

    def restore(self, state: Snapshot) -> None:
        """Make a snapshot both the current and the accepted state."""
        self.delta.value = state.depth
        self.body.now.t.value = state.t
        self.body.slide_tip(state.slide)
        self.set_trial_state(state.unknowns)
        for function, values in zip(self.histories, state.history, strict=True):
            function.x.array[:] = values
        self.body.accept()
        self.begin_stage(Stage(0.0))
        self.scale_contact_stiffness(state.modulus_ratio)

    def is_admissible(self) -> bool:
        """Return whether J > 0 and the limits of the elastic law hold at all quadrature points.

        J is the volume ratio det F. The energy is finite only under these conditions. Residual and
        tangent do not reveal a violation, because the derivative of ln J is finite also for J < 0.
        """
        return self.scene.physics.small_strain or bool(np.isfinite(self.energy()))

    def force(self) -> float:
        """Force of the whole body, dPi/d(delta) [force]; > 0 if the tip is pushed in."""
        return self.sum_over_body(sum(term.force() for term in self.terms))

    def side_force(self, axis: int) -> float:
        """Force on the tip along a horizontal axis [force], times the symmetry factor.

        Normal to a mirror plane it differs from the force of the whole body, which is zero by
        symmetry.
        """
        return self.sum_over_body(sum(term.side_force(axis) for term in self.terms))

    def hold_plastic_flow(self, *, is_held: bool) -> None:
        """Suppress plastic flow in all terms, or allow it again."""
        for term in self.terms:
            term.hold_plastic_flow(is_held=is_held)

    def plastic_dissipation(self) -> float:
        """Energy dissipated by plastic flow in the whole body so far [energy]."""
        return self.sum_over_body(sum(term.plastic_dissipation() for term in self.terms))

    def moment(self) -> float:
        """Moment of the vertical force of the whole body on the tip [force length]."""
        return self.sum_over_body(sum(term.moment() for term in self.terms))

    def dissipation(self) -> float:
        """Energy dissipated by friction in the current increment, of the whole body [energy]."""
        return self.sum_over_body(sum(term.dissipation() for term in self.terms))

    def energy(self) -> float:
        """Potential Pi of the whole body: strain energy plus contact energy [energy]."""
        return self.sum_over_body(fem.assemble_scalar(self._energy_form))

    def sum_over_body(self, local_value: float) -> float:
        """Sum a value over all ranks and multiply it by the symmetry factor (collective)."""
        return float(
            self.scene.physics.domain.symmetry_factor * self.comm.allreduce(local_value, op=MPI.SUM)
        )

    def reactions(self) -> tuple[dict[SurfaceComponent, float], float]:
        """Support forces and pin reaction at the current state (collective).

        Returns
        -------
        support_reactions : dict
            Force of each support on the model domain, by surface and axis [force].
        pin_reaction : float
            Largest reaction of the pins that remove rigid body modes [force], times the symmetry
            factor; zero in equilibrium.
        """
        self.assemble_residual(self.b)
        values = self.b.array_r
        body = self.body
        local_reactions = {
            support: float(share @ values[dofs])
            for support, (dofs, share) in body.support_shares.items()
        }
        for term in self.terms:
            local_reactions |= term.reactions()
        support_reactions = {
            support: self.comm.allreduce(force, op=MPI.SUM)
            for support, force in local_reactions.items()
        }
        pin_reaction = self.comm.allreduce(
            float(np.abs(values[body.pin_dofs]).max(initial=0.0)), op=MPI.MAX
        )
        return support_reactions, self.scene.physics.domain.symmetry_factor * pin_reaction


def _sum_forms(forms: Iterable[ufl.Form]) -> ufl.Form:
    return reduce(add, (form for form in forms if form is not None))
