"""The equilibrium of a whole body at a depth, by the scene's contact method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
from mpi4py import MPI

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.observe import measure
from indent_sim.fe.observe.fields import WholeBody
from indent_sim.fe.path.equilibrium import Effort, reactions
from indent_sim.fe.problem import Problem, Snapshot
from indent_sim.fe.solve.algorithms import algorithm_of, come_to_rest
from indent_sim.fe.solve.newton import Newton, finest, stages
from indent_sim.fe.solve.numbering import Numbering
from indent_sim.fe.solve.prediction import expected, shares
from indent_sim.fe.terms.contact.multiplier import stiffness_scale
from indent_sim.fe.terms.contact.traction import Traction
from indent_sim.fe.terms.scene_terms import Matter, Touch, matter_of, touch_of
from indent_sim.fe.terms.term import Stage
from indent_sim.model.loading import LoadPath
from indent_sim.model.tips import deepest_inside

MOST_SETS = 6  # of vertices under a tip that seals, in one stage
# Depths that are tried for the force of a stage between, and how near it is: rows do not tell then where they set out
MOST_BETWEEN, BETWEEN = 8, 1e-9
INSIDE_OUT = 0.2  # of the contact radius; the singular edge of a punch has J < 0 in 0.003 of it, which no force feels


class BodyEquilibrium:
    """A problem on the whole mesh and the algorithm that solves it; see `path.Equilibrium`."""

    def __init__(self, body: Body):
        self.matter = matter = matter_of(body)
        self.touch = touch = touch_of(body, matter.strains[0])
        self.problem = problem = Problem(body, [*matter, *touch])
        self.observed = SolvedBody(body, matter, touch)
        self.scene = scene = body.scene
        self.has_memory = problem.has_memory
        self.newton = Newton(problem)
        self._stages = 0  # found so far
        self._leading: Sequence[Snapshot] = ()  # states that lead on to what is solved next
        self._forces = None if problem.law.may_snap else _forces_over_time(scene.physics.path)
        self._rise = 0.0  # of the force over depth, at the last stage between
        self._algorithm = self._with_valve(algorithm_of(self.newton, touch))
        self.snapshot, self.restore = problem.snapshot, problem.restore
        self._a = scene.plan.prediction["a"] / scene.physics.scales.length
        self._largest_inside_out = INSIDE_OUT * self._a
        self._deepest = deepest_inside(scene.physics.indenter)
        if problem.law.multiplier == "stress":  # other zeros of Nitsche's residual lie about an element deep in the tip
            self._deepest = min(self._deepest, scene.sizes.h_contact / 2)

    @property
    def effort(self) -> Effort:
        """What was solved so far; no iterations of linear solves where systems are factored."""
        valve = self.matter.valve
        switches = valve.setting if valve else 0
        return Effort(self.newton.iterations, self.newton.krylov_iterations, self._stages, switches)

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

    def sharpen(self) -> float:
        """Converge as far as round-off lets, and say how well a force can be met then, relative. The vertices that the
        tip seals stand still from here on, until `is_settled` is asked: with them the force would jump."""
        if self.matter.valve:
            self.matter.valve.hold()
        self.newton.rtol = min(self.newton.rtol, finest(self.problem))
        return 10 * finest(self.problem)

    def is_settled(self) -> bool:
        """Whether the tip seals the surface where it touches it; else it does from here on."""
        valve = self.matter.valve
        return valve is None or not valve.look(measure.touching(self.observed))

    def accept(self) -> float:
        """Take the present equilibrium as the one that the next step sets out from; what was lost in this [energy]."""
        lost = self.problem.dissipation()
        self.problem.accept()
        self.newton.accept()
        return lost

    def solve(self, depth: float, dt: float = 0.0) -> bool:
        """True when converged to a state that a body can have, in every stage; else the unknowns are as they were."""
        began, before = self.problem.body.before_depth, self.problem.guess()
        leading, self._leading = self._leading, ()
        for stage in self.problem.stages(dt):
            is_last = stage.end == 1.0
            if leading and dt:
                self._guess(began + stage.end * (depth - began), leading)
            self.problem.begin(stage)
            if not (self._find(depth, self._algorithm) if is_last else self._between(began, depth, stage.end)):
                self.problem.take(before)
                return False
            self.problem.end(stage)
            self._stages += 1
        return True

    def _between(self, began: float, depth: float, share: float) -> bool:
        """True when found before the end of a step, at the share of it: where the depth is straight in time, or where
        forces are prescribed, the force. A depth that goes with the root of time, as after a sudden force, is not."""
        delta, tried = began + share * (depth - began), list[tuple[float, float]]()
        asked = self._forces(float(self.problem.body.now.t.value)) if self._forces else 0.0
        if not self._find(delta, self._algorithm):
            return False
        if asked <= 0:
            return True
        for _ in range(MOST_BETWEEN):
            missing = asked - self.force
            if abs(missing) <= BETWEEN * asked:
                return True
            tried = [*tried[-1:], (missing, delta)]
            if len(tried) > 1 and (rise := (tried[0][0] - missing) / (delta - tried[0][1])) > 0:
                self._rise = rise
            rise = self._rise or 2 * self.scene.physics.material.E_star * self._a
            delta += missing / rise
            if not self._find(delta, self._algorithm):
                break
        return self._find(began + share * (depth - began), self._algorithm)

    def _with_valve(self, algorithm: Callable[[], bool]) -> Callable[[], bool]:
        """The algorithm with the surface sealed where that very equilibrium touches the tip: found, looked at, found
        again, until nothing changes."""
        valve = self.matter.valve
        if valve is None:
            return algorithm

        def find() -> bool:
            for _ in range(0 if valve.is_held else MOST_SETS - 1):
                if not algorithm():
                    return False
                if self.is_settled():
                    return True
            return algorithm()

        return find

    def settle(self, depth: float, dt: float = 0.0) -> bool:
        """True when found where the body comes to rest at a depth, let go of in the present state, and then what `dt`
        makes of that; else as `solve`. A snap takes no time."""
        drag, at_once = self.touch.drag, Stage(0.0)
        assert drag
        self.problem.begin(at_once)
        if not self._find(depth, lambda: come_to_rest(self.newton, drag)):
            return False
        self.problem.end(at_once)
        return dt == 0 or self.solve(depth, dt)

    def _find(self, depth: float, algorithm: Callable[[], bool]) -> bool:
        before, self.problem.delta.value = self.problem.guess(), depth
        self._follow(depth)
        if not algorithm():
            return False
        if why := self._why_impossible():
            self.newton.failure = why
            self.problem.take(before)
        return not why

    def _follow(self, depth: float) -> None:
        """Let the contact be as stiff as what the tip touches is at a depth, at this moment."""
        below = self.matter.strains[0]
        below.expect(self.problem.body.before_depth, depth)
        self.problem.follow(below.E_star / self.scene.physics.material.E_star)

    def _why_impossible(self) -> str:
        if not self.problem.is_admissible():
            return "Newton ends in a state with J <= 0, or beyond the law's limit"
        if self.problem.law.may_snap and not self.newton.is_stable:
            return "Newton ends in a state that is not stable"
        if self.scene.physics.gap == "reference":
            return ""
        if measure.penetration(self.observed) > self._deepest:
            return "Newton ends where the tip has passed through the surface"
        if self.scene.physics.small_strain and self.observed.inside_out() > self._largest_inside_out:
            return "the linear body turns inside out (J < 0), and only a hyperelastic one has a deformed surface then"
        return ""

    @cached_property
    def _numbering(self) -> list[list[Numbering]]:
        """For each array of a state the numbering of each of its fields: the unknowns, what is frozen, the history."""
        unknowns, problem = self.problem.unknowns, self.problem
        whole = [Numbering(unknowns.own_space(name), unknowns.places(name)) for name in unknowns.names]
        beside = [*problem.frozen, *problem.histories]
        return [whole, *([Numbering(f.function_space, np.arange(len(f.x.array)))] for f in beside)]

    @property
    def _softens(self) -> bool:
        """Whether the modulus of what the tip touches changes with time."""
        return self.scene.physics.part.regions[0].relaxing is not None

    def pack(self, state: Snapshot) -> list[np.ndarray]:
        """A state as arrays on rank 0, for a checkpoint, in an order that does not know the ranks (collective)."""
        arrays = [*(vector.array_r for vector in state.unknowns), *state.history]
        pairs = zip(arrays, self._numbering, strict=True)
        packed = [field.gathered(values) for values, fields in pairs for field in fields]
        return [*packed, np.array([state.softer])] if self._softens else packed

    def unpack(self, depth: float, arrays: Sequence[np.ndarray], t: float = 0.0) -> Snapshot | None:
        """The state of packed arrays, which all ranks have (collective); None when they are none of this problem."""
        state, numbering = replace(self.snapshot(), depth=depth, t=t), self._numbering
        shapes: list[tuple[int, ...]] = [field.shape for fields in numbering for field in fields]
        shapes += [(1,)] if self._softens else []
        if [np.shape(values) for values in arrays] != shapes:
            return None
        if self._softens:
            *arrays, softer = arrays
            state = replace(state, softer=float(softer[0]))
        rest = iter(arrays)
        for values, fields in zip([*(v.array for v in state.unknowns), *state.history], numbering, strict=True):
            for field in fields:
                field.scatter(next(rest), values)
        return state

    def predict(self, depth: float, earlier: Sequence[Snapshot]) -> None:
        """Take the unknowns that earlier states lead to expect at a depth as the present ones; in the next `solve` at
        the depth of each of its stages."""
        self._leading = earlier
        self._guess(depth, earlier)

    def _guess(self, depth: float, earlier: Sequence[Snapshot]) -> None:
        depths = [state.depth for state in earlier]
        trial = self._expected(earlier[-2:], depth) if self._foresees else None
        guess = [vector.duplicate() for vector in earlier[-1].unknowns]
        for k, vector in enumerate(guess):
            vector.set(0.0)
            vector.maxpy(shares(depths, depth), [state.unknowns[k] for state in earlier])
        self.problem.delta.value = depth
        self.problem.take(guess)
        if trial is not None:  # the multiplier changes where the guess is in contact and this is not, or the reverse
            assert isinstance(self.touch.pressure, Traction)
            (lam, gap), stiffness = self._contact_at_nodes(), stiffness_scale(self.scene)
            agrees = (lam > stiffness * gap) == (trial > 0)
            self.touch.pressure.field.fill(np.where(agrees, lam, trial + stiffness * gap))

    @cached_property
    def _foresees(self) -> bool:
        """Whether lam can say what is in contact next: not by another stiffness, nor with attraction in the gap."""
        law = self.scene.physics.contact
        return law.multiplier == "unknown" and not law.may_snap and not stages(law, self.scene)

    def _expected(self, earlier: Sequence[Snapshot], depth: float) -> np.ndarray:
        trials = []
        for state in earlier:
            self.problem.delta.value = state.depth
            self.problem.take(state.unknowns)
            lam, gap = self._contact_at_nodes()
            trials.append(lam - stiffness_scale(self.scene) * gap)
        largest = self.problem.comm.allreduce(max(trial.max(initial=0.0) for trial in trials), op=MPI.MAX)
        return expected(trials, [state.depth for state in earlier], depth, largest)

    def _contact_at_nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """lam [pressure] and gap [length] at the nodes of the contact surface's facets (facets, nodes)."""
        points = self.observed.trace.node_points()
        return self.touch.pressure.multiplier_at(points), measure.gap(self.observed, points)

    @property
    def reaction_norm(self) -> float:
        """Euclidean norm of the nodal support reactions at the present equilibrium [force].

        It is that of the whole body: the norm of the modelled part times the number of its copies.
        """
        return self.scene.physics.part.copies * self.newton.reaction_norm

    def numbers(self) -> dict[str, Any]:
        """Force, contact, energy and reactions of the present equilibrium."""
        energy = nan if self.scene.physics.relaxing else self.problem.energy()  # what relaxes has stored none
        numbers: dict[str, Any] = {"force": self.force, "energy": energy}
        borne, numbers["stray_reaction"] = self.problem.reactions()
        numbers |= reactions(self.scene.physics.part, borne)
        for name, axis in self.scene.physics.sideways.items():
            numbers[f"side_force_{name}"] = self.problem.side_force(axis)
        body = self.problem.body
        numbers["intrusion"] = measure.intrusion(self.observed, body.skin, body.local_array())
        numbers |= self._of_fluid()
        return numbers | measure.contact(self.observed)

    def _of_fluid(self) -> dict[str, Any]:
        """What has left the whole body or moved in it, what is neither there nor gone, and the largest pressure; of a
        sudden step what its drained faces are about to lose."""
        flow, valve, comm = self.matter.flow, self.matter.valve, self.problem.comm
        if flow is None or valve is None:
            return {}
        content = flow.content()
        shares = (valve.outflow(), content.sum(), np.abs(content).sum())
        left, kept, moved = (self.problem.whole(float(mine)) for mine in shares)
        largest = comm.allreduce(flow.largest(), op=MPI.MAX)
        found = {"outflow": left, "moved": moved, "unbalanced": abs(left + kept), "pore_pressure_max": largest}
        is_sudden = float(self.problem.body.dt.value) == 0
        return found | ({"drained": valve.drained()} if is_sudden else {})


class SolvedBody(WholeBody):
    """The whole body at the present solution, for measurements, the surface table and the fields."""

    def __init__(self, body: Body, matter: Matter, touch: Touch):
        super().__init__(body, matter.strains, touch.friction, matter.flow)
        self.multiplier_at, self.pressure_at = touch.pressure.multiplier_at, touch.pressure.pressure_at
        self._delta = body.now.delta

    @property
    def depth(self) -> float:
        """delta [length]."""
        return float(self._delta.value)

    def inside_out(self) -> float:
        """Size [length] of the region in which J < 0 (collective)."""
        return max(strain.inside_out() for strain in self.strains)


def _forces_over_time(path: LoadPath) -> Callable[[float], float] | None:
    """The force that is asked for [force] at a time since the path's begin; None of a path that asks for none."""
    if path.control == "depth" or path.begin is None:
        return None
    forces, times = zip(*(place for step in range(1, len(path.values) + 1) for place in path.leg(step)), strict=True)
    return lambda t: float(np.interp(t, times, forces))
