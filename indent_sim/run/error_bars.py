"""Error bars of the force, and what no slip would change, from companion runs.

The bars come from coarser meshes and a softer penalty.

Two meshes in the ratio q, whose sizes near and far, growth and edge sizes go together, give forces F_c and F that are
off by about q^rate to one (`accuracy.fading`), so F is off by |F_c - F| / (q^rate - 1). Which elements touch changes
from step to step and makes the difference jump, even through zero. So there are two companions, hence two differences,
and the neighbouring steps are asked too: the largest of all that counts, times SAFETY. The two coarser meshes are there
for the accidents, not for the trend: many errors fade faster from them to the run than q^rate, by up to q^HASTE more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import isnan
from typing import Literal

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.contact import Anchor, AugmentedLagrangian, Friction, Nitsche, Penalty
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.process.usage import machine_memory
from indent_sim.scene.corners import POWER
from indent_sim.scene.cost import MOST_CANDIDATES, Work, candidates, cost
from indent_sim.scene.expected import NEARLY_STICK, Stick, pulling_rim
from indent_sim.scene.fineness import BLUNT, EASING, RATE, STEEPEST, fading
from indent_sim.scene.scene import Scene

RATIOS = (1.6, 2.56)  # of the sizes of the two companions to those of the run
SAFETY = {2: 3.0, 3: 2.2}  # by dim: the contact edge crosses many elements in three dimensions, and jumps less
CORNERED = 1.2  # times as much where the mesh also shrinks towards corners: two errors that may cancel on one mesh
LAYERED = 2.0  # times as much in a body of layers: a stiff one bends far beyond the contact, where elements are large
HASTE = 1.0  # added to the rate for what two coarser meshes say
LEAST_GAIN = 0.25  # of a coarser mesh's error over the finer one's, less one, where both are too coarse to say
ALIKE = 0.2  # of a step's force: what a step beside it must have to say something of it
TELLTALE = 4.0  # elements in the contact radius that a second companion needs to know a radius and a pressure
KINK = 1.8  # how the force converges where a tip's corner lies in an element, measured
# and at a punch's edge that elements do not meet: with Nitsche's method, since no body's stress has that pressure, and
# where the edge is rounded and contact ends somewhere in its narrow arc, measured
AT_EDGE = 1.2
READING = 0.05  # of the element where the contact ends: so well is its radius read off
FORCELESS = 1e-6  # of the largest force: a step with less has none that an accuracy could be asked of


@dataclass(frozen=True)
class Trend:
    """How the error of a number falls with the elements in the contact radius, as n^-rate, and the safety of what two
    meshes say of it."""

    rate: float
    safety: float

    def fading(self, n: float) -> float:
        """How the error falls with n elements in the contact radius, up to a factor; see `fineness.fading`."""
        return float((n**4 + BLUNT**4) ** (-self.rate / 4))


# Measured like those of the force, on 260 random layers between frictionless walls at sizes of all kinds
RADIUS, PEAK = Trend(1.0, 0.5), Trend(2.0, 2.2)

Curve = dict[int, State]


@dataclass(frozen=True)
class Companion:
    """A run of the same scene on a mesh whose sizes are `ratio` times as large; `scene`: that of this mesh."""

    ratio: float
    states: Sequence[State]
    scene: Scene | None = field(default=None, repr=False)

    @property
    def curve(self) -> Curve:
        """The state of every step that was reached."""
        return _curve(self.states)


@dataclass(frozen=True)
class Budget:
    """What makes up the half-width of a step's error bar [force]: mesh, penalty stiffness, the finite body that stands
    for a half-space, and with friction the steps of the path; `theory` is how far the force is from that of a theory
    that is exact for this body."""

    step: int
    discretisation: float
    enforcement: float
    truncation: float
    theory: float = 0.0
    path: float = 0.0

    @property
    def estimated(self) -> float:
        """The sum of the parts [force]."""
        return self.discretisation + self.enforcement + self.truncation + self.path

    @property
    def total(self) -> float:
        """The half-width [force]: the sum of the parts, but never less than what exact theory knows to be wrong."""
        return self.theory if self.theory > self.estimated else self.estimated


def coarser(scene: Scene, ratio: float) -> Scene:
    """The same scene on a mesh whose sizes are that much larger, near and far alike."""
    sizes = scene.sizes
    height = scene.physics.part.height
    fine = min(ratio * sizes.h_contact, height)
    axis = sizes.h_axis and min(ratio * sizes.h_axis, fine)
    edge = sizes.h_edge and min(ratio**RATE * sizes.h_edge, fine)
    corner = sizes.h_corner and min(ratio ** (RATE / POWER) * sizes.h_corner, fine)
    growth = ratio**EASING
    larger = replace(
        sizes, h_contact=fine, h_far=max(ratio * sizes.h_far, fine), grading=min(growth * sizes.grading, STEEPEST),
        patch=sizes.patch + 2 * (fine - sizes.h_contact), h_edge=edge, h_axis=axis, h_corner=corner,
        inclusions=tuple((inclusion, min(ratio ** (RATE / 2) * h, inclusion.thinnest))
                         for inclusion, h in sizes.inclusions),
    )  # fmt: skip
    return replace(scene.with_physics(wall_stiffness=scene.physics.wall_stiffness / ratio), sizes=larger)


def beside(scene: Scene, earlier: Sequence[Scene]) -> list[tuple[float, Scene]]:
    """The scenes of two companions, the finest first, and the ratios of their sizes to those of this scene: `earlier`
    attempts at it, and coarser meshes than the first of those."""
    if (level := scene.sizes.refinements) is not None:
        return [(2.0 ** (level - other), _refined(scene, other)) for other in _levels_beside(level)]
    ratios = [other.sizes.h_contact / scene.sizes.h_contact for other in earlier]
    base, begin = (earlier[-1], ratios[-1]) if earlier else (scene, 1.0)
    coarse = [(begin * ratio, coarser(base, ratio)) for ratio in RATIOS]
    return [*zip(ratios, earlier, strict=True), *coarse][: len(RATIOS)]


def _levels_beside(level: int) -> list[int]:
    """How often a mesh from a file is refined for the companions: less, or once where none is coarser than the file."""
    return [other for other in (level - 1, level - 2) if other >= 0] or [level + 1]


def _refined(scene: Scene, refinements: int) -> Scene:
    """The same scene on the same file, refined that often."""
    sizes, ratio = scene.sizes, 2.0 ** ((scene.sizes.refinements or 0) - refinements)
    h, edge = sizes.h_contact, sizes.h_edge
    other = replace(sizes, h_contact=ratio * h, h_far=ratio * sizes.h_far, h_edge=edge and ratio * edge,
                    patch=sizes.patch + 2 * (ratio - 1) * h, refinements=refinements)  # fmt: skip
    return replace(scene, sizes=other)


def softer(scene: Scene) -> Scene:
    """The same scene with half the penalty stiffness."""
    law = scene.physics.contact
    assert isinstance(law, Penalty)
    tangential = law.epsilon_t if law.epsilon_t == "auto" else law.epsilon_t / 2
    return scene.with_physics(contact=replace(law, epsilon_n=law.stiffness / 2, epsilon_t=tangential))


# The error of a path over what steps half as long change of it. Where new contact sticks where its step began, that
# error falls as steps^-0.7. Where it sticks on its way it falls as it may, mostly faster: 5 times the largest change
# beside a row holds 98 % of the rows of 1 to 10 steps against those of 160, and 96 % of first rows (72 paths:
# half-spaces and layers, stick and Coulomb's law, paraboloids and cones). Half of what lies between the anchor's two
# ends holds 93 %, and is three times as wide at the first row of a half-space that sticks.
HALVED: dict[Anchor, float] = {"implicit": 2.6, "mid": 5.0}


@dataclass(frozen=True)
class Ways:
    """The path of a scene with friction in its own steps and in steps half as long, and the error of the first over
    their difference."""

    own: Curve
    finer: Curve
    factor: float

    def error(self, state: State, name: str) -> float:
        """The error of a number of a step; NaN where a path has no such step."""
        said = _spread(self.finer, self.own, state, name)
        return float("nan") if any(map(isnan, said)) else self.factor * max(said)


def ways(run: Companion, follow: Callable[[Scene], Sequence[State]]) -> Ways | None:
    """What the steps of a path with friction may cost, by a run and steps half as long; None without friction."""
    if run.scene is None or not run.scene.physics.has_friction:
        return None
    physics = run.scene.physics
    path = LoadPath(physics.path.control, _halved(physics.path.values))
    finer = follow(run.scene.with_physics(path=path, deltas=_halved(physics.deltas)))
    kept = [replace(state, step=state.step // 2) for state in finer if state.step % 2 == 0]
    return Ways(run.curve, _curve(kept), HALVED[physics.anchor])


STICK_STEPS = {2: 10, 3: 4}  # by dim: new contact sticks on the way through each, to 0.05 % and 0.15 % of the force


def sticks(run: Companion, follow: Callable[[Scene], Sequence[State]]) -> Stick | None:
    """What pure stick instead of no friction would change of the deepest force of a run or a companion, on its mesh:
    with the anchor `mid`, between its two ends.

    None where there is no such number: friction or adhesion already, no contact, a body that may slide away, or a run
    that fails.
    """
    smooth = _smooth(run.scene) if run.scene else None
    deepest = max((state.delta for state in run.curve.values()), default=0.0)
    if smooth is None or deepest <= 0:
        return None
    depth = deepest / smooth.physics.scales.depth
    forces = [_last_force(follow(_to(smooth, depth, 1)))]
    rough = _rough(smooth)
    for anchor in ANCHORS:
        forces.append(_last_force(follow(_to(rough, depth, STICK_STEPS[rough.physics.part.dim], anchor))))
    if not forces[0] > 0 or any(map(isnan, forces)):
        return None
    changes = [100 * (force / forces[0] - 1) for force in forces[1:]]
    return Stick(changes[0], min(changes), max(changes), SOLVED)


ANCHORS: tuple[Anchor, ...] = ("mid", "implicit", "glue")
SOLVED = "solved beside this run"


def _smooth(scene: Scene) -> Scene | None:
    """The same frictionless scene with a law that may have friction; None for one that may not."""
    physics = scene.physics
    if physics.has_memory or physics.part.pins:
        return None
    if scene.solver.linear == "iterative":
        factored = _factored(scene)
        return _smooth(factored) if factored else None
    law = physics.contact
    if not isinstance(law, AugmentedLagrangian):
        law = AugmentedLagrangian(epsilon_n=physics.material.E_star / scene.sizes.typical)
    return scene.with_physics(contact=law)


def _factored(scene: Scene) -> Scene | None:
    """The same scene for a solver that knows friction; None where that does not fit this machine."""
    physics, part = scene.physics, scene.physics.part
    is_linear = physics.small_strain and physics.gap == "reference"
    is_small = candidates(scene.sizes, part) * part.dim <= MOST_CANDIDATES
    method: Literal["condensed", "newton"] = "condensed" if is_linear and is_small else "newton"
    mixed = any(region.formulation == "mixed" for region in part.regions)
    work = Work(method, "direct", mixed, STICK_STEPS[part.dim], nonlinear=True, rough=True)
    if cost(scene.sizes, part, work).memory > machine_memory():
        return None
    return replace(scene, solver=replace(scene.solver, method=method, linear="direct"))


def _rough(scene: Scene) -> Scene:
    """A frictionless scene whose surface sticks, on the whole body where a compliance along it would be too large."""
    law, part = scene.physics.contact, scene.physics.part
    assert isinstance(law, AugmentedLagrangian)
    would_pull = pulling_rim(scene.physics.indenter, part.regions[0].material.constants.nu, scene.sizes, part.dim)
    friction: Friction = NEARLY_STICK if would_pull else "stick"
    is_large = candidates(scene.sizes, part) * part.dim > MOST_CANDIDATES
    solver = replace(scene.solver, method="newton") if is_large else scene.solver
    sticking = scene.with_physics(contact=replace(law, friction=friction, epsilon_t=law.epsilon_n))
    return replace(sticking, solver=solver)


def _to(scene: Scene, depth: float, steps: int, anchor: Anchor = "implicit") -> Scene:
    """The same scene on its way to a depth in equal steps."""
    depths = tuple(float(part) for part in np.linspace(0.0, depth, steps + 1)[1:])
    return scene.with_physics(path=LoadPath("depth", depths), deltas=depths, anchor=anchor)


def _last_force(states: Sequence[State]) -> float:
    """The force of the last state; NaN where it was not reached."""
    return states[-1].force if states and states[-1].converged else float("nan")


def _halved(values: Sequence[float]) -> tuple[float, ...]:
    """The values of a path, and between each and the one before the mean of the two."""
    return tuple(part for before, value in pairwise((0.0, *values)) for part in ((before + value) / 2, value))


class ErrorBars:
    """Judges one step after another against the companions' curves, the finest companion first.

    Where forces are prescribed and depths found, the error of the force is that at the row's depth, and the error of
    the depth what the curve makes of it.
    """

    def __init__(self, scene: Scene, companions: Sequence[Companion], soft: Sequence[State] | None = None,
                 ways: Ways | None = None):  # fmt: skip
        self.budgets: list[Budget] = []
        self.companions = companions
        self._truncation = sum(doubt.force_error for doubt in scene.plan.doubts if doubt.key == "truncation")
        self._sizes, self._scales = scene.sizes, scene.physics.scales
        self._uncornered = replace(scene.sizes, corners=())  # a wall beside the contact says nothing of its elements
        self._is_layered = len(scene.physics.part.regions) > 1
        self._is_nitsche = isinstance(scene.physics.contact, Nitsche)
        self._is_rounded = getattr(scene.physics.indenter, "edge_radius", 0.0) > 0
        self._theory = scene.exact_theory
        self._finds_depths = scene.physics.path.control == "force"
        self._dim, self._creases = scene.physics.part.kinematics.dim, scene.physics.indenter.creases()
        self._coarser = [companion.curve for companion in companions]
        self._ways = ways
        self._soft = None if soft is None else Companion(1.0, soft).curve
        beside = companions[0].scene or scene
        self._stiffer = 1.0  # than its companion, whose penalty may be that of an earlier attempt
        own, theirs = scene.physics.contact, beside.physics.contact
        if isinstance(own, Penalty) and isinstance(theirs, Penalty):
            self._stiffer = own.stiffness / theirs.stiffness
        self._run: Curve = {}

    def judged(self, state: State) -> State:
        """The state with its error bars; NaN where the companions have no such step."""
        self._run[state.step] = state
        size = abs(state.force)
        budget = Budget(state.step, self._discretisation(state), self._enforcement(state.step) * size,
                        self._truncation * size, self._from_theory(state), self._path(state, "force"))  # fmt: skip
        if self._missed(state):
            budget = Budget(state.step, self._beyond(state, "force"), 0.0, 0.0, budget.theory)
        self.budgets.append(budget)
        depth = self._depth_error(state, budget.total) if self._finds_depths else None
        return replace(state, force_error=budget.total, a_error=self._beside_force(state, "a", RADIUS),
                       p_max_error=self._beside_force(state, "p_max", PEAK), delta_error=depth)  # fmt: skip

    def _path(self, state: State, name: str) -> float:
        """What the steps of the path may cost a number, in a force of the depth that prescribed forces have found."""
        if self._ways is None:
            return 0.0
        if name == "force" and self._finds_depths:
            return self._ways.error(state, "delta") * self._slope(state) if state.delta > 0 else 0.0
        return self._ways.error(state, name)

    def _missed(self, state: State) -> bool:
        """Whether the tip is pressed in so little that no point of the mesh notices."""
        return state.delta > 0 and state.force == 0

    def _beyond(self, state: State, name: str) -> float:
        """A number of the shallowest contact that a companion has at this depth or deeper: what grows with the depth is
        less here. NaN where there is none."""
        deeper = [other for curve in self._coarser for other in curve.values()
                  if other.delta >= state.delta and other.force > 0]  # fmt: skip
        return float(getattr(min(deeper, key=lambda other: other.delta), name)) if deeper else float("nan")

    def _depth_error(self, state: State, force_error: float) -> float:
        """The error of a depth found for a force: the force's over dF/ddelta."""
        slope = self._slope(state) if state.delta else 0.0
        return force_error / slope if slope > 0 else force_error

    def _slope(self, state: State) -> float:
        """dF/ddelta, of the first companion."""
        companion = self._coarser[0]
        return _exponent(companion.get(state.step, state), companion) * state.force / state.delta

    def _beside_force(self, state: State, name: str, trend: Trend) -> float:
        """The error of a or p_max: what the meshes say, for a at least how well it is read off, and the share of the
        force's that a penalty or a finite body has."""
        if self._missed(state):
            return self._beyond(state, name)
        value = abs(getattr(state, name))
        said = self._said(state, name, trend)
        if name == "a" and value > 0:
            said = max(said, READING * value / self._elements(value)) if said == said else said
        of_path = self._path(state, name)
        return said + self._soft_difference(state.step, name) + self._truncation * value + of_path

    def _said(self, state: State, name: str, trend: Trend) -> float:
        """What two meshes say of a number of this step, or of the steps beside it in proportion; the worst counts."""
        n = self._elements(state.a)
        curves, ratios = [self._run, *self._coarser], [1.0, *(companion.ratio for companion in self.companions)]
        errors = [trend.fading(n / ratio) for ratio in ratios]
        safety = trend.safety * (LAYERED if self._is_layered and name == "p_max" else 1.0)
        said = []
        for k, (fine, coarse) in enumerate(pairwise(curves)):
            share = max(abs(errors[k + 1] - errors[k]) / errors[0], LEAST_GAIN) * ratios[k] ** HASTE
            if k == 0 or n >= TELLTALE * ratios[k + 1]:
                said += [safety / share * found for found in _spread(fine, coarse, state, name)]
        return float("nan") if any(map(isnan, said)) else max(said)

    def _soft_difference(self, step: int, name: str) -> float:
        """What a penalty takes from a number, which is as linear in 1/epsilon_n."""
        if self._soft is None:
            return 0.0
        own, soft = self._coarser[0].get(step), self._soft.get(step)
        if own is None or soft is None:
            return float("nan")
        return abs(getattr(own, name) - getattr(soft, name)) / self._stiffer

    def _discretisation(self, state: State) -> float:
        """SAFETY times what two meshes say of this step, or of the steps beside it in proportion; the worst counts.

        Where a step beside it has fewer elements in its contact, its error is larger by what `fading` says.
        """
        curves, ratios = [self._run, *self._coarser], [1.0, *(companion.ratio for companion in self.companions)]
        errors = [self._error(state.a, ratio) for ratio in ratios]
        safety = SAFETY[self._dim] * (CORNERED if self._sizes.h_corner else 1.0)
        safety *= LAYERED if self._is_layered else 1.0
        said = []
        for k, (fine, coarse) in enumerate(pairwise(curves)):
            share = max(abs(errors[k + 1] - errors[k]) / errors[0], LEAST_GAIN) * ratios[k] ** HASTE
            said += [safety / share * difference for difference in self._differences(fine, coarse, state)]
        return float("nan") if any(map(isnan, said)) else max(said)

    def _differences(self, fine: Curve, coarse: Curve, state: State) -> list[float]:
        """|F_coarse - F_fine| of a step, NaN when it is missing, and of the steps beside it, scaled to its force."""
        F, step, error = abs(state.force), state.step, self._error(state.a)
        beside = [
            _difference(fine, coarse, k) * F / abs(fine[k].force) * min(error / self._error(fine[k].a), 1.0)
            for k in (step - 1, step + 1)
            if k in fine and k in coarse and abs(fine[k].force) > ALIKE * F
        ]
        return [_difference(fine, coarse, step), *beside]

    def _error(self, a: float, ratio: float = 1.0) -> float:
        """The error of a force with the contact radius a on a mesh of sizes larger by a ratio, up to a factor."""
        n, slow = self._elements(a, self._uncornered) / ratio, self._slow_rate(a)
        return n**-slow if slow and n > 0 else fading(n)

    def _slow_rate(self, a: float) -> float | None:
        """The rate at which the force converges where not the elements in the contact radius rule it; None: they do."""
        if self._sizes.ruled_by_corners:
            return POWER
        if self._sizes.edge is not None:
            is_missed = self._sizes.refinements is not None  # by the elements of a mesh from a file
            return AT_EDGE if self._is_nitsche or self._is_rounded or is_missed else None
        return KINK if self._is_kinked(a) else None

    def _is_kinked(self, a: float) -> bool:
        """Whether the pressure is infinite at a corner of the tip somewhere within the contact, inside an element."""
        r = a / self._scales.length
        return any(0 < at <= r and width < self._sizes.at(np.array(at), np.array(0.0)) for at, width in self._creases)

    def _elements(self, a: float, sizes: Sizes | None = None) -> float:
        """Elements in a contact radius."""
        r = np.array(a / self._scales.length)
        return float(r / (sizes or self._sizes).at(r, np.zeros(())))

    def _from_theory(self, state: State) -> float:
        """|F - F_theory| where theory is exact for the body [force]; 0 where it is not, or ends before this depth."""
        if self._theory is None or state.delta <= 0:
            return 0.0
        solution = self._theory.at(state.delta / self._scales.depth)
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _enforcement(self, step: int) -> float:
        """The relative error of a penalty, whose 1/force is linear in 1/epsilon_n from stiff to soft; the companion
        says it of its own stiffness."""
        if self._soft is None:
            return 0.0
        own, soft = self._coarser[0].get(step), self._soft.get(step)
        if own is None or soft is None:
            return float("nan")
        low = force_at(soft, own.delta, self._soft)
        if own.force == low:
            return 0.0
        inverse = 2 - own.force / low if low else -1.0
        return abs(1 / inverse - 1) / self._stiffer if inverse > 0 else float("inf")


class TheoryBars:
    """The error bars of a scene that theory solves: its own stated error, of every number.

    Where its tip would have to pull, contact radius and pressure are not known at all.
    """

    companions: Sequence[Companion] = ()

    def __init__(self, scene: Scene):
        assert scene.plan.theory is not None
        self.budgets: list[Budget] = []
        self._error, self._finds_depths = scene.plan.theory.error, scene.physics.path.control == "force"
        self._of_contact = 1.0 if scene.plan.theory.pull else self._error

    def judged(self, state: State) -> State:
        """The state with its error bars."""
        error = self._error
        self.budgets.append(Budget(state.step, 0.0, 0.0, 0.0, theory=error * abs(state.force)))
        return replace(state, force_error=error * abs(state.force), a_error=self._of_contact * state.a,
                       p_max_error=self._of_contact * state.p_max,
                       delta_error=error * abs(state.delta) if self._finds_depths else None)  # fmt: skip


Bars = ErrorBars | TheoryBars


def _curve(states: Sequence[State]) -> Curve:
    return {state.step: state for state in states if state.converged}


def _spread(fine: Curve, coarse: Curve, state: State, name: str) -> list[float]:
    """The difference of a number of a step between two meshes or paths, NaN when one has no such step, and those of the
    steps beside it, scaled to its size."""

    def difference(k: int) -> float:
        return abs(getattr(coarse[k], name) - getattr(fine[k], name)) if k in fine and k in coarse else float("nan")

    value = abs(getattr(state, name))
    beside = [
        difference(k) * value / abs(getattr(fine[k], name))
        for k in (state.step - 1, state.step + 1)
        if value > 0 and k in fine and k in coarse and fine[k].force > ALIKE * abs(state.force)
    ]
    return [difference(state.step), *(found for found in beside if found == found)]


def _difference(fine: Curve, coarse: Curve, step: int) -> float:
    if step not in fine or step not in coarse:
        return float("nan")
    return abs(force_at(coarse[step], fine[step].delta, coarse) - fine[step].force)


def force_at(state: State, delta: float, curve: Curve) -> float:
    """The force of a curve at a depth near one of its states: force (delta/its depth)^m, m the slope of their logs.

    At the state's own depth it is the state's force, to the last digit.
    """
    if state.delta == delta or state.delta <= 0 or delta <= 0:
        return state.force
    return float(state.force * (delta / state.delta) ** _exponent(state, curve))


def _exponent(state: State, curve: Curve) -> float:
    """dlnF/dlndelta between the states beside one; that of a paraboloid where there are none."""
    beside = [curve[k] for k in (state.step - 1, state.step, state.step + 1) if k in curve]
    first, last = min(beside, key=lambda s: s.delta), max(beside, key=lambda s: s.delta)
    if first.force <= 0 or first.delta <= 0 or last.delta <= first.delta:
        return 1.5
    return float(np.log(last.force / first.force) / np.log(last.delta / first.delta))
