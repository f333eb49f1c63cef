"""Terms of the virtual work -> their sum, its tangent, and the steps that lead from one state to
the next.

    Pi(u, q, lam; delta) = int psi dOmega + int potential(g, lam) dGamma

residual = dPi, tangent = d(dPi), force = dPi/d(delta). Nothing here knows mechanics: the terms do.
A term without a potential, as friction, adds its virtual work to dPi.
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
from indent_sim.fe.discrete_body import Body, TimeLevel
from indent_sim.fe.terms.term import Stage, Term, sdirk2_stages
from indent_sim.mesh.reactions import SurfaceComponent
from indent_sim.model.units import round_length


@dataclass(frozen=True)
class Snapshot:
    """A state: the unknowns, which may be extrapolated and blended, and what the terms remember,
    which may not.

    softer: the modulus that the contact was as stiff as, over that of the first moment.
    """

    depth: float
    unknowns: tuple[PETSc.Vec, ...]
    history: tuple[np.ndarray, ...] = ()
    t: float = 0.0
    modulus_ratio: float = 1.0


class Problem:
    """The sum of terms of the virtual work of a body."""

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
        self._residual_form = fem.form(
            _sum_forms(term.virtual_work(*self._time_levels(term)) for term in self.terms)
        )
        self._energy_form = fem.form(_sum_forms(term.energy for term in self.terms))
        self.b = compat.create_vector(self._residual_form, body.unknowns.space)
        self.frozen = [
            function for term in self.terms for function in term.frozen
        ]  # of the present guess
        self.histories = [
            function for term in self.terms for function in term.history
        ]  # what is remembered
        self._vectors = [self.x, *(compat.petsc_vector(function) for function in self.frozen)]
        self.has_symmetric_tangent = all(term.has_symmetric_tangent for term in self.terms)
        self.has_memory = any(term.has_memory for term in self.terms)
        self.has_flow = any(term.has_flow for term in self.terms)
        self._modulus_ratio = 1.0

    @property
    def can_reuse_tangent(self) -> bool:
        """Whether the tangent of a step is that of the next one as long as the contact is: where
        fluid flows in a linear body without friction.
        """
        return self.has_flow and self.scene.physics.is_linear and self.law.is_conservative

    def _time_levels(self, term: Term) -> tuple[TimeLevel, TimeLevel, fem.Constant]:
        """The step as a term sees it: now, before and dt; `before` only of a term that remembers."""
        return self.body.now, self.body.before if term.has_memory else self.body.now, self.body.dt

    @cached_property
    def _tangent_form(self) -> fem.Form:
        return fem.form(_sum_forms(term.tangent(*self._time_levels(term)) for term in self.terms))

    def create_tangent(self) -> PETSc.Mat:
        """The matrix that `assemble_tangent` fills."""
        return fem_petsc.create_matrix(self._tangent_form)

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return float(self.delta.value)

    @cached_property
    def row_weights(self) -> np.ndarray:
        """Factors that turn the rows of each field (force, volume, length) into forces, for
        measuring residuals.
        """
        weights = np.ones(self.unknowns.owned_count)
        for name, field in self.unknowns.fields_by_name.items():
            dofs = self.unknowns.dofs(name)
            weights[dofs[dofs < self.unknowns.owned_count]] = field.weight
        return weights

    @property
    def tangent_parameters(self) -> tuple[float, ...]:
        """What the tangent depends on beside the state: where it is the same an old tangent is
        near.
        """
        return round_length(float(self.body.dt.value)), *(
            term.tangent_version for term in self.terms
        )

    def set_continuation_factor(self, factor: float) -> None:
        """Multiply the stiffness of the contact law; 1 makes it the law's own again."""
        for term in self.terms:
            term.set_continuation_factor(factor)

    @property
    def has_membrane(self) -> bool:
        """Whether a term can hold more firmly what little holds."""
        return any(term.has_membrane for term in self.terms)

    def set_membrane_stiffness(self, stiffness: float) -> None:
        """Hold the surface of a drop by so much of its tension in its plane, see
        `terms.surface_tension`.
        """
        for term in self.terms:
            term.set_membrane_stiffness(stiffness)

    def follow_modulus(self, modulus_ratio: float) -> None:
        """Make contact as stiff as a body of so many times the modulus of the first moment has it."""
        self._modulus_ratio = modulus_ratio
        for term in self.terms:
            term.follow_modulus(modulus_ratio)

    def begin_solve(self) -> None:
        """Forget what the last solve has remembered, and give what is held its values."""
        self.body.apply_prescribed_values()
        for term in self.terms:
            term.begin_solve()

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """dPi at the current solution, reactions included."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual_form)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        for term in self.terms:
            term.add_residual(b)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """d(dPi) at the current solution, with identity rows for the constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent_form, self.body.bcs)
        A.assemble(PETSc.Mat.AssemblyType.FLUSH)
        for term in self.terms:
            term.add_tangent(A)
        A.assemble()

    def stages(self, dt: float) -> list[Stage]:
        """The stages of a step of `dt` [time]."""
        return sdirk2_stages(dt) if dt and self.has_flow else [Stage(dt, dt)]

    def begin_stage(self, stage: Stage) -> None:
        """Set out on a stage."""
        self.body.begin_stage(stage.dt, stage.elapsed)
        for term in self.terms:
            term.begin_stage(stage)

    def end_stage(self, stage: Stage) -> None:
        """The stage's equilibrium is found."""
        for term in self.terms:
            term.end_stage(stage)

    def accept(self) -> None:
        """The step is done: the present state becomes the one that the next step sets out from."""
        for term in self.terms:
            term.accept()
        self.body.accept()

    def trial_state(self) -> list[PETSc.Vec]:
        """Copies of the unknowns, and of what is frozen while they are found."""
        return [vector.copy() for vector in self._vectors]

    def set_trial_state(self, trial_state: Sequence[PETSc.Vec]) -> None:
        """Make copies of unknowns, or a combination of such, the present ones; what is remembered
        stays.
        """
        for vector, values in zip(self._vectors, trial_state, strict=True):
            values.copy(vector)
            vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def snapshot(self) -> Snapshot:
        """The present state, just accepted."""
        internal_variables = tuple(function.x.array.copy() for function in self.histories)
        return Snapshot(
            self.depth,
            tuple(self.trial_state()),
            internal_variables,
            float(self.body.now.t.value),
            self._modulus_ratio,
        )

    def restore(self, state: Snapshot) -> None:
        """Make a state the present one, and the one that was accepted last."""
        self.delta.value = state.depth
        self.body.now.t.value = state.t
        self.set_trial_state(state.unknowns)
        for function, values in zip(self.histories, state.history, strict=True):
            function.x.array[:] = values
        self.body.accept()
        self.begin_stage(Stage(0.0))  # no time has passed since
        self.follow_modulus(state.modulus_ratio)

    def is_admissible(self) -> bool:
        """Whether J > 0, and any other limit of the law is kept, at every quadrature point: the
        energy is a number. Residual and tangent do not show it: the derivative of ln J is as
        good for J < 0.
        """
        return self.scene.physics.small_strain or bool(np.isfinite(self.energy()))

    def force(self) -> float:
        """Virtual work of pressing deeper, dPi/d(delta), of the whole body."""
        return self.sum_over_body(sum(term.force() for term in self.terms))

    def side_force(self, axis: int) -> float:
        """Force on the tip along a horizontal axis, of the whole body; across a mirror plane it is
        the part's.
        """
        return self.sum_over_body(sum(term.side_force(axis) for term in self.terms))

    def dissipation(self) -> float:
        """What is lost on the way to the present state from the last accepted one, in the whole
        body.
        """
        return self.sum_over_body(sum(term.dissipation() for term in self.terms))

    def energy(self) -> float:
        """Pi of the whole body: strain plus contact energy."""
        return self.sum_over_body(fem.assemble_scalar(self._energy_form))

    def sum_over_body(self, local_value: float) -> float:
        """A number of the whole body by this rank's share of the modelled part (collective)."""
        return float(
            self.scene.physics.domain.symmetry_factor * self.comm.allreduce(local_value, op=MPI.SUM)
        )

    def reactions(self) -> tuple[dict[SurfaceComponent, float], float]:
        """The force of each support on the modelled part [force], and the largest reaction of the
        pins that only remove rigid modes, of the whole body (collective).
        """
        self.assemble_residual(self.b)
        values = self.b.array_r
        body = self.body
        local_reactions = {
            of: float(share @ values[dofs]) for of, (dofs, share) in body.support_shares.items()
        }
        for term in self.terms:
            local_reactions |= term.reactions()
        support_reactions = {
            of: self.comm.allreduce(force, op=MPI.SUM) for of, force in local_reactions.items()
        }
        pin_reaction = self.comm.allreduce(
            float(np.abs(values[body.pin_dofs]).max(initial=0.0)), op=MPI.MAX
        )
        return support_reactions, self.scene.physics.domain.symmetry_factor * pin_reaction


def _sum_forms(forms: Iterable[ufl.Form]) -> ufl.Form:
    return reduce(add, (form for form in forms if form is not None))
