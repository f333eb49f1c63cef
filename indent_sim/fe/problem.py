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
from indent_sim.fe.discrete_body import Body, Moment
from indent_sim.fe.terms.term import Stage, Term, flowing_stages
from indent_sim.mesh.reactions import Surface
from indent_sim.model.units import rounded


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
    softer: float = 1.0


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
        self._residual = fem.form(_sum(term.work(*self._step(term)) for term in self.terms))
        self._energy = fem.form(_sum(term.energy for term in self.terms))
        self.b = compat.create_vector(self._residual, body.unknowns.space)
        self.frozen = [
            function for term in self.terms for function in term.frozen
        ]  # of the present guess
        self.histories = [
            function for term in self.terms for function in term.history
        ]  # what is remembered
        self._vectors = [self.x, *(compat.vector(function) for function in self.frozen)]
        self.has_symmetric_tangent = all(term.has_symmetric_tangent for term in self.terms)
        self.has_memory = any(term.has_memory for term in self.terms)
        self.flows = any(term.flows for term in self.terms)
        self._softer = 1.0

    @property
    def keeps_tangent(self) -> bool:
        """Whether the tangent of a step is that of the next one as long as the contact is: where
        fluid flows in a linear body without friction.
        """
        return self.flows and self.scene.physics.is_linear and self.law.is_conservative

    def _step(self, term: Term) -> tuple[Moment, Moment, fem.Constant]:
        """The step as a term sees it: now, before and dt; `before` only of a term that remembers."""
        return self.body.now, self.body.before if term.has_memory else self.body.now, self.body.dt

    @cached_property
    def _tangent(self) -> fem.Form:
        return fem.form(_sum(term.tangent(*self._step(term)) for term in self.terms))

    def create_tangent(self) -> PETSc.Mat:
        """The matrix that `assemble_tangent` fills."""
        return fem_petsc.create_matrix(self._tangent)

    @property
    def depth(self) -> float:
        """The present depth delta [length]."""
        return float(self.delta.value)

    @cached_property
    def row_weights(self) -> np.ndarray:
        """Factors that turn the rows of each field (force, volume, length) into forces, for
        measuring residuals.
        """
        weights = np.ones(self.unknowns.owned)
        for name, field in self.unknowns.kinds.items():
            places = self.unknowns.places(name)
            weights[places[places < self.unknowns.owned]] = field.weight
        return weights

    @property
    def setting(self) -> tuple[float, ...]:
        """What the tangent depends on beside the state: where it is the same an old tangent is
        near.
        """
        return rounded(float(self.body.dt.value)), *(term.setting for term in self.terms)

    def soften(self, factor: float) -> None:
        """Multiply the stiffness of the contact law; 1 makes it the law's own again."""
        for term in self.terms:
            term.soften(factor)

    @property
    def can_firm(self) -> bool:
        """Whether a term can hold more firmly what little holds."""
        return any(term.can_firm for term in self.terms)

    def firm(self, firmness: float) -> None:
        """Hold the surface of a drop by so much of its tension in its plane, see
        `terms.surface_tension`.
        """
        for term in self.terms:
            term.firm(firmness)

    def follow(self, softer: float) -> None:
        """Make contact as stiff as a body of so many times the modulus of the first moment has it."""
        self._softer = softer
        for term in self.terms:
            term.follow(softer)

    def begin_solve(self) -> None:
        """Forget what the last solve has remembered, and give what is held its values."""
        self.body.impose()
        for term in self.terms:
            term.begin_solve()

    def assemble_residual(self, b: PETSc.Vec) -> None:
        """dPi at the current solution, reactions included."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._residual)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        for term in self.terms:
            term.add_residual(b)

    def assemble_tangent(self, A: PETSc.Mat) -> None:
        """d(dPi) at the current solution, with identity rows for the constrained dofs."""
        A.zeroEntries()
        fem_petsc.assemble_matrix(A, self._tangent, self.body.bcs)
        A.assemble(PETSc.Mat.AssemblyType.FLUSH)
        for term in self.terms:
            term.add_tangent(A)
        A.assemble()

    def stages(self, dt: float) -> list[Stage]:
        """The stages of a step of `dt` [time]."""
        return flowing_stages(dt) if dt and self.flows else [Stage(dt, dt)]

    def begin(self, stage: Stage) -> None:
        """Set out on a stage."""
        self.body.begin(stage.dt, stage.passed)
        for term in self.terms:
            term.begin(stage)

    def end(self, stage: Stage) -> None:
        """The stage's equilibrium is found."""
        for term in self.terms:
            term.end(stage)

    def accept(self) -> None:
        """The step is done: the present state becomes the one that the next step sets out from."""
        for term in self.terms:
            term.accept()
        self.body.accept()

    def guess(self) -> list[PETSc.Vec]:
        """Copies of the unknowns, and of what is frozen while they are found."""
        return [vector.copy() for vector in self._vectors]

    def take(self, guess: Sequence[PETSc.Vec]) -> None:
        """Make copies of unknowns, or a combination of such, the present ones; what is remembered
        stays.
        """
        for vector, values in zip(self._vectors, guess, strict=True):
            values.copy(vector)
            vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def snapshot(self) -> Snapshot:
        """The present state, just accepted."""
        remembered = tuple(function.x.array.copy() for function in self.histories)
        return Snapshot(
            self.depth, tuple(self.guess()), remembered, float(self.body.now.t.value), self._softer
        )

    def restore(self, state: Snapshot) -> None:
        """Make a state the present one, and the one that was accepted last."""
        self.delta.value = state.depth
        self.body.now.t.value = state.t
        self.take(state.unknowns)
        for function, values in zip(self.histories, state.history, strict=True):
            function.x.array[:] = values
        self.body.accept()
        self.begin(Stage(0.0))  # no time has passed since
        self.follow(state.softer)

    def is_admissible(self) -> bool:
        """Whether J > 0, and any other limit of the law is kept, at every quadrature point: the
        energy is a number. Residual and tangent do not show it: the derivative of ln J is as
        good for J < 0.
        """
        return self.scene.physics.small_strain or bool(np.isfinite(self.energy()))

    def force(self) -> float:
        """Virtual work of pressing deeper, dPi/d(delta), of the whole body."""
        return self.whole(sum(term.force() for term in self.terms))

    def side_force(self, axis: int) -> float:
        """Force on the tip along a horizontal axis, of the whole body; across a mirror plane it is
        the part's.
        """
        return self.whole(sum(term.side_force(axis) for term in self.terms))

    def dissipation(self) -> float:
        """What is lost on the way to the present state from the last accepted one, in the whole
        body.
        """
        return self.whole(sum(term.dissipation() for term in self.terms))

    def energy(self) -> float:
        """Pi of the whole body: strain plus contact energy."""
        return self.whole(fem.assemble_scalar(self._energy))

    def whole(self, mine: float) -> float:
        """A number of the whole body by this rank's share of the modelled part (collective)."""
        return float(self.scene.physics.part.copies * self.comm.allreduce(mine, op=MPI.SUM))

    def reactions(self) -> tuple[dict[Surface, float], float]:
        """The force of each support on the modelled part [force], and the largest reaction of the
        pins that only remove rigid modes, of the whole body (collective).
        """
        self.assemble_residual(self.b)
        values = self.b.array_r
        body = self.body
        mine = {of: float(share @ values[dofs]) for of, (dofs, share) in body.bearing.items()}
        for term in self.terms:
            mine |= term.reactions()
        borne = {of: self.comm.allreduce(force, op=MPI.SUM) for of, force in mine.items()}
        stray = self.comm.allreduce(float(np.abs(values[body.pinned]).max(initial=0.0)), op=MPI.MAX)
        return borne, self.scene.physics.part.copies * stray


def _sum(forms: Iterable[ufl.Form]) -> ufl.Form:
    return reduce(add, (form for form in forms if form is not None))
