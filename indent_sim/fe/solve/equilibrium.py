"""The equilibrium of a whole body at a depth, by the scene's contact method."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe.observe import measure
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import linear
from indent_sim.fe.solve.algorithms import ALGORITHMS, with_friction
from indent_sim.fe.solve.newton import Newton, finest, stages
from indent_sim.fe.solve.numbering import Numbering
from indent_sim.fe.solve.prediction import expected, shares
from indent_sim.fe.terms.strain import Crushed
from indent_sim.fe.terms.traction import Traction
from indent_sim.model.state import Surface
from indent_sim.model.tips import deepest_inside

INSIDE_OUT = 0.2  # of the contact radius; the singular edge of a punch has J < 0 in 0.003 of it, which no force feels


class BodyEquilibrium:
    """A problem on the whole mesh and the algorithm that solves it; see `path.Equilibrium`."""

    def __init__(self, problem: Problem):
        self.problem = self.observed = problem
        self.scene, self.dofs = problem.scene, problem.body.active_dofs
        self.has_memory = problem.scene.physics.has_memory
        self.newton = Newton(problem)
        self._algorithm = with_friction(self.newton, ALGORITHMS[problem.law.multiplier](self.newton))
        scene = problem.scene
        self._largest_inside_out = INSIDE_OUT * scene.plan.prediction["a"] / scene.physics.scales.length
        self._deepest = deepest_inside(scene.physics.indenter)
        if problem.law.multiplier == "stress":  # other zeros of Nitsche's residual lie about an element deep in the tip
            self._deepest = min(self._deepest, scene.sizes.h_contact / 2)

    @property
    def depth(self) -> float:
        """delta [length]."""
        return self.problem.depth

    @depth.setter
    def depth(self, delta: float) -> None:
        self.problem.delta.value = delta

    @property
    def iterations(self) -> int:
        """Linear solves so far."""
        return self.newton.iterations

    @property
    def krylov_iterations(self) -> int | None:
        """Iterations of these linear solves so far; None where systems are factored."""
        return self.newton.krylov_iterations

    @property
    def failure(self) -> str:
        """Why the last solve did not converge."""
        return self.newton.failure

    @property
    def force(self) -> float:
        """Force of the whole body on the tip [force]."""
        return self.problem.force()

    @property
    def stiffness(self) -> float:
        """dF/ddelta of the whole body at the present equilibrium, by its tangent (collective)."""
        return self.newton.stiffness()

    @property
    def force_tolerance(self) -> float:
        """How well a force can be met, relative."""
        return 10 * finest(self.problem)

    def sharpen(self) -> None:
        """Converge as far as round-off lets, so that a force can be met to `force_tolerance`."""
        self.newton.rtol = min(self.newton.rtol, finest(self.problem))

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        self.problem.depart()

    @property
    def dissipation(self) -> float:
        """What friction dissipates on the way to the present equilibrium from the one before [energy]."""
        return self.problem.dissipation()

    def solve(self, depth: float) -> bool:
        """True when converged to a state that a body can have; else the problem's state is as it was."""
        before, self.depth = self.snapshot(), depth
        if not self._algorithm():
            return False
        self.newton.failure = self._why_impossible()
        if self.newton.failure:
            self.problem.restore(before)
        return not self.newton.failure

    def _why_impossible(self) -> str:
        """Why a body cannot have the present state; "" when it can."""
        if not self.problem.is_admissible():
            return "Newton ends in a state with J <= 0, or beyond the law's limit"
        if self.scene.physics.gap == "reference":
            return ""
        if measure.penetration(self.problem) > self._deepest:
            return "Newton ends where the tip has passed through the surface"
        if self.scene.physics.small_strain and self.problem.inside_out() > self._largest_inside_out:
            return "the linear body turns inside out (J < 0), and only a hyperelastic one has a deformed surface then"
        return ""

    def snapshot(self) -> list[PETSc.Vec]:
        """Copies of everything that makes a state."""
        return self.problem.snapshot()

    def restore(self, state: Sequence[PETSc.Vec], depth: float) -> None:
        """Put a state back."""
        self.depth = depth
        self.problem.restore(list(state))

    @cached_property
    def _numbering(self) -> list[list[Numbering]]:
        """For each vector of a state the numbering of each of its fields."""
        unknowns, contact = self.problem.unknowns, self.problem.contact
        whole = [Numbering(unknowns.own_space(name), unknowns.places(name)) for name in unknowns.names]
        if not contact.vectors:
            return [whole]
        assert isinstance(contact, Traction)
        frozen = contact.field.lam
        return [whole, [Numbering(frozen.function_space, np.arange(len(frozen.x.array)))]]

    def pack(self, state: Sequence[PETSc.Vec]) -> list[np.ndarray]:
        """A state as arrays on rank 0, for a checkpoint, in an order that does not know the ranks (collective)."""
        return [field.gathered(vector.array_r) for vector, fields in zip(state, self._numbering, strict=True)
                for field in fields]  # fmt: skip

    def unpack(self, arrays: Sequence[np.ndarray]) -> list[PETSc.Vec]:
        """The state of packed arrays, which all ranks have (collective).

        Empty when they are none of this problem, whatever they say of themselves.
        """
        state, numbering = self.snapshot(), self._numbering
        if [np.shape(values) for values in arrays] != [field.shape for fields in numbering for field in fields]:
            return []
        rest = iter(arrays)
        for vector, fields in zip(state, numbering, strict=True):
            for field in fields:
                field.scatter(next(rest), vector.array)
        return state

    def predict(self, depth: float, earlier: Sequence[tuple[float, Sequence[PETSc.Vec]]]) -> None:
        """Take what the states at earlier depths lead to expect at this one as the present state."""
        depths, states = zip(*earlier, strict=True)
        trial = self._expected(earlier[-2:], depth) if self._foresees else None
        guess = [vector.duplicate() for vector in states[-1]]
        for k, vector in enumerate(guess):
            vector.set(0.0)
            vector.maxpy(shares(depths, depth), [state[k] for state in states])
        self.restore(guess, depth)
        if trial is not None:
            self._correct_edge(trial)

    def _correct_edge(self, trial: np.ndarray) -> None:
        """Change the multiplier where the present state is in contact and a trial pressure is not, or the reverse."""
        contact, stiffness = self.problem.contact, self.problem.stiffness_scale
        assert isinstance(contact, Traction)
        lam, gap = self._contact_at_nodes()
        agrees = (lam > stiffness * gap) == (trial > 0)
        contact.field.fill(np.where(agrees, lam, trial + stiffness * gap))

    @cached_property
    def _foresees(self) -> bool:
        """Whether the multiplier of the next solve can say what is in contact: not where that begins with another
        stiffness, nor where a tip's attraction acts in the gap."""
        law = self.scene.physics.contact
        return law.multiplier == "unknown" and not law.adhesion and not stages(law, self.scene)

    def _expected(self, earlier: Sequence[tuple[float, Sequence[PETSc.Vec]]], depth: float) -> np.ndarray:
        """The trial pressure to expect at a depth from those of two states (facets, nodes)."""
        trials = []
        for before, state in earlier:
            self.restore(state, before)
            lam, gap = self._contact_at_nodes()
            trials.append(lam - self.problem.stiffness_scale * gap)
        largest = self.problem.comm.allreduce(max(trial.max(initial=0.0) for trial in trials), op=MPI.MAX)
        return expected(trials, [before for before, _ in earlier], depth, largest)

    def _contact_at_nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """lam [pressure] and gap [length] at the nodes of the contact surface's facets (facets, nodes)."""
        points = self.problem.trace.node_points()
        return self.problem.multiplier_at(points), measure.gap(self.problem, points)

    def numbers(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
        reaction, stray = self.problem.reactions()
        axes = self.scene.physics.sideways  # 0.0 + -0.0 is 0.0
        sideways = {f"side_force_{name}": 0.0 + float(self.problem.thrust()[axis]) for name, axis in axes.items()}
        return {"force": self.force, "energy": self.problem.energy(), "reaction": reaction, "stray_reaction": stray,
                **sideways, **measure.contact(self.problem)}  # fmt: skip

    def surface(self) -> Surface | None:
        """The surface table on rank 0, None on the others."""
        return measure.surface(self.problem)

    def crushed(self) -> Crushed | None:
        """Where the body is compressed most; None at small strain."""
        return self.problem.least_volume_ratio()

    def recover(self) -> None:
        """The fields are the state's own."""

    def refuse_unused_options(self) -> None:
        """ConfigError for a `solver.petsc` option that PETSc never asked for: a typing error, or no effect here."""
        linear.refuse_unused(self.scene.solver.petsc)
