"""Error bars of the force, and what no slip would change, from companion runs.

The bars come from coarser meshes and a softer penalty.

Two meshes in the ratio q, whose sizes near and far, growth and edge sizes go together, give forces F_c and F that are
off by about q^rate to one (`accuracy.fading`), so F is off by |F_c - F| / (q^rate - 1). Which elements touch changes
from step to step and makes the difference jump, even through zero. So there are two companions, hence two differences,
and the neighbouring steps are asked too: the largest of all that counts, times SAFETY. The two coarser meshes are there
for the accidents, not for the trend: many errors fade faster from them to the run than q^rate, by up to q^HASTE more.
All of these may be small by accident, so no bar is narrower than a share of the error that its elements let expect.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from math import inf, isnan, nan
from typing import Any, Literal

import numpy as np

from indent_sim.model.contact import Anchor, AugmentedLagrangian, Friction, Nitsche, Penalty
from indent_sim.model.loading import LoadPath
from indent_sim.model.state import State
from indent_sim.process.usage import machine_memory
from indent_sim.run.companions.drained_film import DrainedFilm
from indent_sim.scene import fineness
from indent_sim.scene.corners import POWER
from indent_sim.scene.cost import MOST_CANDIDATES, Work, candidates, cost
from indent_sim.scene.doubts import PER_DEPTH
from indent_sim.scene.expected import NEARLY_STICK, Stick, pulling_rim
from indent_sim.scene.fineness import BLUNT, BLUNT_NESTED, CONSTANT, fading
from indent_sim.scene.scene import Scene

RATIOS = (1.6, 2.56)  # of the sizes of the two companions to those of the run
SAFETY = {2: 3.0, 3: 2.2}  # by dim: the contact edge crosses many elements in three dimensions, and jumps less
CORNERED = 1.2  # times as much where the mesh also shrinks towards corners: two errors that may cancel on one mesh
LAYERED = 2.0  # times as much in a body of layers: a stiff one bends far beyond the contact, where elements are large
HASTE = 1.0  # added to the rate for what two coarser meshes say
LEAST_GAIN = 0.25  # of a coarser mesh's error over the finer one's, less one, where both are too coarse to say
COMPARABLE_FORCE = 0.2  # of a step's force: what a step beside it must have to say something of it
TELLTALE = 4.0  # elements in the contact radius that a second companion needs to know a radius and a pressure
KINK = 1.8  # how the force converges where a tip's corner lies in an element, measured
# and at a punch's edge that elements do not meet: with Nitsche's method, since no body's stress has that pressure, and
# where the edge is rounded and contact ends somewhere in its narrow arc, measured
AT_EDGE = 1.2
# Of the error bar that `fineness` expects of the elements in a contact radius, the least: errors are 0.1 of that in the
# median, and in 97 % of the rows less than 0.16 to 0.25 (60 caps and balls, 5 and 13 elements). Half as much in the
# median on meshes from files (30 sections), whose uniform refinement leaves less
LEAST_ERROR_SHARE, LEAST_REFINED = 0.15, 0.1
# Of E* times the angle at which flat facets meet, the error of a pressure where they stand for a curved surface: 0.5 to
# 0.75 on a dome of three to fourteen facets, under which pressures gather at corners
FACETED = 0.8
FORCELESS = 1e-6  # of the largest force: a step with less has none that an accuracy could be asked of


@dataclass(frozen=True)
class Trend:
    """How the error of a number falls with the elements in the contact radius, as n^-rate, the safety of what two
    meshes say of it, and the least error of one element, relative."""

    rate: float
    safety: float
    least: float

    def fading(self, n: float) -> float:
        """How the error falls with n elements in the contact radius, up to a factor; see `fineness.fading`."""
        return float((n**4 + BLUNT**4) ** (-self.rate / 4))


# Measured like those of the force, on 260 random layers between frictionless walls at sizes of all kinds. A radius is
# read off to 0.065 of the element where the contact ends; pressures on which two meshes agree by accident are off by
# 0.04 to 0.07 n^-2.
RADIUS = Trend(1.0, 0.5, 0.065)
# Of p_max: nodes that came into contact in different steps keep different shears, and their pressures differ by 2 % of
# the largest at most; on 80 random scenes in 1, 4 and 16 steps one differed by more than its bars without this
ROUGH = 0.015
TENSED = 0.11  # of the last element, to which a radius is read off where the pressure ends with a step, on 120 rows
# Of p_max of a contact that a swelling gel closes, times n^-2: up to 58, 33, 18, 11, 5 and 2 % too large with n = 3.1,
# 3.5, 3.8, 5.3, 7.5 and 9.5 elements in the contact radius (four scenes); two meshes agree better by accident
CLOSED_BY_SWELLING = 5.5
TRENDS = {"a": RADIUS, "p_max": Trend(2.0, 2.2, 0.06), "stick_radius": RADIUS, "dissipation": RADIUS}

Curve = dict[int, State]
States = Sequence[State]


@dataclass(frozen=True)
class Companion:
    """A run of the same scene on a mesh whose sizes are `ratio` times as large; `scene`: that of this mesh."""

    ratio: float
    states: States
    scene: Scene | None = field(default=None, repr=False)

    @property
    def curve(self) -> Curve:
        """The state of every step that was reached."""
        return _curve(self.states)


@dataclass(frozen=True)
class Budget:
    """What makes up the half-width of a step's error bar [force]: mesh, penalty stiffness, the finite body that stands
    for a half-space or flat facets for a curved surface (`truncation`), with friction the steps of the path, of a body
    that evolves the steps in time, and of one that drains the films beside its drained faces; `theory` is how far the
    force is from that of a theory that is exact for this body."""

    step: int
    discretisation: float
    enforcement: float
    truncation: float
    theory: float = 0.0
    path: float = 0.0
    time: float = 0.0
    film: float = 0.0

    @property
    def estimated(self) -> float:
        """The sum of the parts [force]."""
        return self.discretisation + self.enforcement + self.truncation + self.path + self.time + self.film

    @property
    def total(self) -> float:
        """The half-width [force]: the sum of the parts, but never less than what exact theory knows to be wrong."""
        return self.theory if self.theory > self.estimated else self.estimated


def coarser(scene: Scene, ratio: float) -> Scene:
    """The same scene on a mesh whose sizes are that much larger, near and far alike."""
    sizes = fineness.coarser(scene.sizes, ratio, scene.physics.part.height)
    return replace(scene.with_physics(wall_stiffness=scene.physics.wall_stiffness / ratio), sizes=sizes)


def beside(scene: Scene, earlier: Sequence[Scene]) -> list[tuple[float, Scene]]:
    """The scenes of two companions, the finest first, and the ratios of their sizes to those of this scene: `earlier`
    attempts at it, and coarser meshes than the first of those."""
    if (level := scene.sizes.refinements) is not None:
        levels = [other for other in (level - 1, level - 2) if other >= 0] or [level + 1]  # if none is coarser, finer
        return [(2.0 ** (level - other), _refined(scene, other)) for other in levels]
    ratios = [other.sizes.h_contact / scene.sizes.h_contact for other in earlier]
    base, begin = (earlier[-1], ratios[-1]) if earlier else (scene, 1.0)
    coarse = [(begin * ratio, coarser(base, ratio)) for ratio in RATIOS]
    return [*zip(ratios, earlier, strict=True), *coarse][: len(RATIOS)]


def _refined(scene: Scene, refinements: int) -> Scene:
    """The same scene on the same file, refined that often."""
    return replace(scene, sizes=fineness.refined(scene.sizes, refinements))


def softer(scene: Scene) -> Scene | None:
    """The same scene with half the penalty stiffness; None without a penalty."""
    law = scene.physics.contact
    if not isinstance(law, Penalty):
        return None
    tangential = law.epsilon_t if law.epsilon_t == "auto" else law.epsilon_t / 2
    return scene.with_physics(contact=replace(law, epsilon_n=law.stiffness / 2, epsilon_t=tangential))


# The error of a path over what steps half as long change of it. Where new contact sticks where its step began, that
# error falls as steps^-0.7. Where it sticks on its way it falls as it may, mostly faster: 5 times the largest change
# beside a row holds 98 % of the rows of 1 to 10 steps against those of 160, and 96 % of first rows (72 paths:
# half-spaces and layers, stick and Coulomb's law, paraboloids and cones). Half of what lies between the anchor's two
# ends holds 93 %, and is three times as wide at the first row of a half-space that sticks.
HALVED: dict[Anchor, float] = {"implicit": 2.6, "mid": 5.0}
# Of a body that evolves: of second order where the contact stands still, of first where the tip seals what it comes to
HALVED_IN_TIME = 2.0
# Of the stick radius, times the share of it or of the contact radius that a step adds or takes; of the dissipation, all
# of which a long step may have made up, times its square; and of a step's work, where next to nothing slips. With half
# of the dissipation alone bars held 99 % of 1048 rows of 46 random scenes in 1, 4 and 16 steps against 96 on a finer
# mesh.
UNSEEN = {"stick_radius": 0.5, "dissipation": 1.0}
LEAST_SLIP = 3e-6


@dataclass(frozen=True)
class Ways:
    """The path of a scene with friction, or of a body that evolves, in its own steps and in steps half as long, and the
    error of the first over their difference."""

    own: Curve
    finer: Curve
    factor: float

    def error(self, state: State, name: str) -> float:
        """The error of a number of a step; NaN where a path has no such step."""
        return self.factor * float(np.max(_spread(self.finer, self.own, state, name)))  # NaN where one is


def in_half_steps(scene: Scene) -> Scene | None:
    """The same scene in steps half as long; None where the path does not matter, nor time."""
    physics = scene.physics
    if not physics.takes_steps:
        return None
    return scene.with_physics(path=physics.path.halved(), deltas=_halved(physics.deltas))


def ways(run: Companion, follow: Callable[[Scene], States]) -> Ways | None:
    """What the steps of a path may cost, by a run and steps half as long; None where it does not matter."""
    finer = in_half_steps(run.scene) if run.scene else None
    if run.scene is None or finer is None:
        return None
    finer_states = follow(finer)
    kept = [
        replace(last, step=last.step // 2, dissipation=(first.dissipation or 0.0) + (last.dissipation or 0.0))
        for first, last in zip(finer_states[::2], finer_states[1::2], strict=False)
    ]
    physics = run.scene.physics
    rough = HALVED[physics.anchor] if physics.has_friction else 0.0
    return Ways(run.curve, _curve(kept), max(rough, HALVED_IN_TIME if physics.evolves else 0.0))


ANCHORS: tuple[Anchor, ...] = ("mid", "implicit", "glue")
STICK_STEPS = {2: 10, 3: 4}  # by dim: new contact sticks on the way through each, to 0.05 % and 0.15 % of the force


def sticks(run: Companion, follow: Callable[[Scene], States]) -> Stick | None:
    """What pure stick instead of no friction would change of the deepest force of a run or a companion, on its mesh:
    with the anchor `mid`, between its two ends.

    None where there is no such number: friction or adhesion already, no contact, a body that may slide away, or a run
    that fails.
    """
    deepest = max((state.delta for state in run.curve.values()), default=0.0)
    if run.scene is None:
        return None
    followed = map(follow, sticking(run.scene, deepest / run.scene.physics.scales.depth))
    forces = [one[-1].force if one and one[-1].converged else nan for one in followed]
    if not forces or not forces[0] > 0 or any(map(isnan, forces)):
        return None
    changes = [100 * (force / forces[0] - 1) for force in forces[1:]]
    return Stick(changes[0], min(changes), max(changes), "solved beside this run")


def sticking(scene: Scene, depth: float) -> list[Scene]:
    """The scenes that tell what stick would change of a scene's force at a depth: without friction, and with each
    anchor; none where there is no such number."""
    smooth = _smooth(scene) if depth > 0 else None
    if smooth is None:
        return []
    rough, steps = _rough(smooth), STICK_STEPS[scene.physics.part.dim]
    return [_to(smooth, depth, 1), *(_to(rough, depth, steps, anchor) for anchor in ANCHORS)]


def bearer(run: Companion, companions: Sequence[Companion]) -> Companion:
    """The one on whose mesh stick is solved: the run itself, in three dimensions its finest companion."""
    return companions[0] if companions and run.scene and run.scene.physics.part.dim == 3 else run


def companions_of(scene: Scene, no_slip: bool) -> list[Scene]:
    """All scenes that a run solves beside its first attempt: for its error bars, and for what stick would change."""
    coarse = [Companion(ratio, (), other) for ratio, other in beside(scene, [])]
    where = bearer(Companion(1.0, (), scene), coarse).scene or scene
    meshes = [one.scene or scene for one in coarse]
    beside_it = sticking(where, max(scene.physics.deltas)) if no_slip else []
    return [*meshes, *on_first(meshes[0]), *beside_it]


def on_first(companion: Scene) -> list[Scene]:
    """What is solved beside the finest companion, on its mesh."""
    return [other for other in (softer(companion), in_half_steps(companion)) if other is not None]


def on_finer_mesh(scene: Scene, ratio: float) -> Scene:
    """The same scene on a mesh whose sizes are that much smaller, or halved where it is from a file."""
    level = scene.sizes.refinements
    return coarser(scene, 1 / ratio) if level is None else _refined(scene, level + 1)


def _smooth(scene: Scene) -> Scene | None:
    """The same frictionless scene with a law that may have friction; None for one that may not."""
    physics = scene.physics
    if physics.takes_path or physics.part.pins:
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
    bound: Friction = NEARLY_STICK if would_pull else "stick"
    is_large = candidates(scene.sizes, part) * part.dim > MOST_CANDIDATES
    solver = replace(scene.solver, method="newton") if is_large else scene.solver
    return replace(scene.with_physics(contact=replace(law, friction=bound, epsilon_t=law.epsilon_n)), solver=solver)


def _to(scene: Scene, depth: float, steps: int, anchor: Anchor = "implicit") -> Scene:
    """The same scene on its way to a depth in equal steps."""
    depths = tuple(float(part) for part in np.linspace(0.0, depth, steps + 1)[1:])
    return scene.with_physics(path=LoadPath("depth", depths), deltas=depths, anchor=anchor)


def _halved(values: Sequence[float]) -> tuple[float, ...]:
    """The values of a path, and between each and the one before the mean of the two."""
    return tuple(part for before, value in pairwise((0.0, *values)) for part in ((before + value) / 2, value))


class ErrorBars:
    """Judges one step after another against the companions' curves, the finest companion first.

    Where forces are prescribed and depths found, the error of the force is that at the row's depth, and the error of
    the depth what the curve makes of it.
    """

    def __init__(
        self,
        scene: Scene,
        companions: Sequence[Companion],
        soft: States | None = None,
        ways: Ways | None = None,
        film: DrainedFilm | None = None,
    ):
        self.budgets: list[Budget] = []
        self.companions, self._ways, self._film = companions, ways, film
        self._coarser = [companion.curve for companion in companions]
        self._soft = None if soft is None else _curve(soft)
        self._run: Curve = {}
        self._pairs = list(pairwise([self._run, *self._coarser]))  # of meshes and the next coarser ones
        self._ratios = [1.0, *(companion.ratio for companion in companions)]  # of sizes to those of the run
        self._scene, self._physics, self._sizes = scene, scene.physics, scene.sizes
        self._scales, part = scene.physics.scales, scene.physics.part
        self._is_layered, self._finds_depths = len(part.regions) > 1, scene.physics.path.control == "force"
        self._truncation = sum(doubt.force_error for doubt in scene.plan.doubts if doubt.key == "truncation")
        near = scene.physics.center, scene.sizes.a, scene.sizes.refinements or 0
        self._sag, turn = part.sag(*near), part.turn(*near)
        self._ridged = FACETED * scene.physics.material.E_star * turn * self._scales.pressure
        own, theirs = scene.physics.contact, (companions[0].scene or scene).physics.contact
        self._stiffer = 1.0  # than its companion, whose penalty may be that of an earlier attempt
        if isinstance(own, Penalty) and isinstance(theirs, Penalty):
            self._stiffer = own.stiffness / theirs.stiffness

    def judged(self, state: State) -> State:
        """The state with its error bars; NaN where the companions have no such step."""
        self._run[state.step] = state
        force, theory = abs(state.force), self._from_theory(state)
        if self._missed(state):
            budget = Budget(state.step, self._beyond(state, "force"), 0.0, 0.0, theory)
        else:
            enforced, shape = self._enforcement(state.step) * force, self._misshapen(state) * force
            mesh, path = self._discretisation(state), self._path(state, "force")
            of_path = {"time" if self._physics.evolves else "path": path}
            of_path |= {"film": self._film.error(state)} if self._film else {}
            budget = Budget(state.step, mesh, enforced, shape, theory, **of_path)
        self.budgets.append(budget)
        slope = self._slope(state) if self._finds_depths else 0.0
        depth = (budget.total / slope if slope > 0 else budget.total) if self._finds_depths else None
        known = (name for name in TRENDS if getattr(state, name) is not None)
        beside: dict[str, Any] = {f"{name}_error": self._beside_force(state, name) for name in known}
        return replace(state, force_error=budget.total, delta_error=depth, **beside)

    def _path(self, state: State, name: str) -> float:
        """What the steps of the path may cost a number, in a force of the depth that prescribed forces have found."""
        if self._ways is None:
            return 0.0
        if name == "force" and self._finds_depths:
            return self._ways.error(state, "delta") * self._slope(state)
        unseen = self._unseen(state, name) if self._physics.contact.slips else 0.0
        return self._ways.error(state, name) + unseen

    def _unseen(self, state: State, name: str) -> float:
        """What halves of a step that is long beside its contact may not show of where and how far the surface slips."""
        before, value = self._run.get(state.step - 1), getattr(state, name)
        a, stick, depth, force = _of_slip(before)
        moved, work = _share(a, state.a), (state.force + force) / 2 * (state.delta - depth)
        match name:
            case "stick_radius":
                narrow = self._unresolved(value) if state.a > 0 else 0.0
                return UNSEEN[name] * max(moved, _share(stick, value)) * value + narrow
            case "dissipation":
                return UNSEEN[name] * moved**2 * value + LEAST_SLIP * abs(work)
        return 0.0

    def _unresolved(self, stick: float) -> float:
        """What an element may not show of a place that sticks and is narrower than itself [length]."""
        r = stick / self._scales.length
        return max(self._sizes.on_surface(r) - r, 0.0) / 2 * self._scales.length

    def _missed(self, state: State) -> bool:
        """Whether the tip is pressed in so little that no point of the mesh notices."""
        return state.delta > 0 and state.force == 0 and not self._physics.evolves

    def _beyond(self, state: State, name: str) -> float:
        """A number of the shallowest contact of a companion from this depth on, where what grows with it is more."""
        others = chain.from_iterable(curve.values() for curve in self._coarser)
        deeper = (other for other in others if other.delta >= state.delta and other.force > 0)
        shallowest = min(deeper, key=lambda other: other.delta, default=None)
        return float(getattr(shallowest, name)) if shallowest else nan

    def _slope(self, state: State) -> float:
        """dF/ddelta, of the first companion; of a body that evolves at its time: a paraboloid's power of the depth, or
        that of the contact on a half-space, whichever is more."""
        if self._physics.evolves:
            of_contact = self._physics.material.E_star * self._scales.pressure
            of_contact *= 2 * state.a if self._scales.dim == 3 else 1.0
            return max(of_contact, PER_DEPTH * state.force / state.delta if state.delta > 0 else 0.0)
        if state.delta <= 0:
            return 0.0
        companion = self._coarser[0]
        return _exponent(companion.get(state.step, state), companion) * state.force / state.delta

    def _beside_force(self, state: State, name: str) -> float:
        """The error of a number beside the force: what the meshes say, and what a penalty or a finite body adds."""
        if self._missed(state):
            return self._beyond(state, name)
        value = abs(getattr(state, name))
        beside = self._soft_difference(state.step, name) + self._misshapen(state) * value + self._path(state, name)
        ridged = self._ridged if name == "p_max" and value > 0 else 0.0
        rough = ROUGH * value if name == "p_max" and self._physics.has_friction else 0.0
        return self._said(state, name) + beside + ridged + rough

    def _misshapen(self, state: State) -> float:
        """The relative error of a body that stands for a half-space, or of facets by which a tip is less deep."""
        faceted = PER_DEPTH * self._sag * self._scales.depth / state.delta if state.delta > 0 else 0.0
        return self._truncation + faceted

    def _said(self, state: State, name: str) -> float:
        """What two meshes say of a number of this step, or of the steps beside it in proportion; the worst counts."""
        L, trend = self._scales.length, TRENDS[name]
        n = self._sizes.elements(state.a / L)
        errors = [trend.fading(n / ratio) for ratio in self._ratios]
        said = [_spread(fine, coarse, state, name) for fine, coarse in self._pairs]
        safety = trend.safety * (LAYERED if self._is_layered and name == "p_max" else 1.0)
        tensed = name == "a" and self._physics.surface_tension
        least = TENSED if tensed else trend.least
        if name == "p_max" and self._physics.is_closed_by_swelling(state.delta / self._scales.depth, state.a / L):
            least = CLOSED_BY_SWELLING
        least *= trend.fading(n) * abs(getattr(state, name))
        return self._worst(errors, said, safety, least, n / TELLTALE)

    def _worst(
        self, errors: list[float], said: list[list[float]], safety: float, least: float, coarsest: float = inf
    ) -> float:
        """The largest error by what pairs of meshes `said`, at least `least`; `errors` of the meshes up to a factor."""
        ratios, errors_said = self._ratios, []
        for k, differences in enumerate(said):
            share = max(abs(errors[k + 1] - errors[k]) / errors[0], LEAST_GAIN) * ratios[k] ** HASTE
            if k == 0 or ratios[k + 1] <= coarsest:
                errors_said += [safety / share * difference for difference in differences]
        return max(float(np.max(errors_said)), least)  # NaN where one is

    def _soft_difference(self, step: int, name: str) -> float:
        """What a penalty takes from a number, which is as linear in 1/epsilon_n."""
        if self._soft is None:
            return 0.0
        own, soft = self._coarser[0].get(step), self._soft.get(step)
        return abs(getattr(own, name) - getattr(soft, name)) / self._stiffer if own and soft else nan

    def _discretisation(self, state: State) -> float:
        """SAFETY times what two meshes say of this step, or of the steps beside it in proportion; the worst counts."""
        sizes, dim, is_meshed = self._sizes, self._physics.part.dim, self._sizes.refinements is None
        safety = SAFETY[dim] * (CORNERED if sizes.h_corner else 1.0)
        safety *= LAYERED if self._is_layered else 1.0
        chosen = replace(sizes, corners=(), edge=None)  # as the elements were chosen from the accuracy
        least = LEAST_ERROR_SHARE if is_meshed else LEAST_REFINED
        least *= CONSTANT[dim] * fading(chosen.elements(state.a / self._scales.length)) * abs(state.force)
        errors = [self._error(state.a, ratio) for ratio in self._ratios]
        said = [self._differences(fine, coarse, state) for fine, coarse in self._pairs]
        return self._worst(errors, said, safety, least)

    def _differences(self, fine: Curve, coarse: Curve, state: State) -> list[float]:
        """|F_coarse - F_fine| of a step, NaN when it is missing, and of the steps beside it, scaled to its force."""
        F, step, error = abs(state.force), state.step, self._error(state.a)
        steps = [k for k in (step - 1, step + 1) if k in fine and k in coarse]
        like = {k: fine[k] for k in steps if abs(fine[k].force) > COMPARABLE_FORCE * F}
        scales = {k: F / abs(one.force) * min(error / self._error(one.a), 1.0) for k, one in like.items()}
        return [self._of_step(fine, coarse, k) * scale for k, scale in ({step: 1.0} | scales).items()]

    def _of_step(self, fine: Curve, coarse: Curve, step: int) -> float:
        """|F_coarse - F_fine| of a step, at one depth."""
        if self._physics.evolves and step in fine and step in coarse:  # no other row is on its curve
            further = abs(coarse[step].delta - fine[step].delta)
            return abs(coarse[step].force - fine[step].force) + further * self._slope(fine[step])
        return _difference(fine, coarse, step)

    def _error(self, a: float, ratio: float = 1.0) -> float:
        """The error of a force with the contact radius a on a mesh of sizes larger by a ratio, up to a factor."""
        bare = replace(self._sizes, corners=())  # a wall beside the contact says nothing of its elements
        n, slow = bare.elements(a / self._scales.length) / ratio, self._slow_rate(a)
        blunt = BLUNT if self._sizes.refinements is None else BLUNT_NESTED
        return n**-slow if slow and n > 0 else fading(n, blunt)

    def _slow_rate(self, a: float) -> float | None:
        """The rate at which the force converges where not the elements in the contact radius rule it; None: they do."""
        sizes, tip = self._sizes, self._physics.indenter
        if sizes.ruled_by_corners:
            return POWER
        if sizes.edge is not None:
            is_missed = sizes.refinements is not None  # by the elements of a mesh from a file
            is_rounded = getattr(tip, "edge_radius", 0.0) > 0
            return AT_EDGE if isinstance(self._physics.contact, Nitsche) or is_rounded or is_missed else None
        r = a / self._scales.length  # is the pressure infinite at a corner of the tip within it, inside an element?
        kinks = (0 < at <= r and width < sizes.at(np.array(at), np.array(0.0)) for at, width in tip.creases())
        return KINK if any(kinks) else None

    def _from_theory(self, state: State) -> float:
        """|F - F_theory| where theory is exact for the body [force]; 0 where it is not, or ends before this depth."""
        theory = self._scene.exact_theory
        solution = theory.at(state.delta / self._scales.depth) if theory and state.delta > 0 else None
        return abs(state.force - solution.force * self._scales.force) if solution else 0.0

    def _enforcement(self, step: int) -> float:
        """The relative error of a penalty, whose 1/force is linear in 1/epsilon_n from stiff to soft."""
        if self._soft is None:
            return 0.0
        own, soft = self._coarser[0].get(step), self._soft.get(step)
        if own is None or soft is None:
            return nan
        low = force_at(soft, own.delta, self._soft)
        if own.force == low:
            return 0.0
        inverse = 2 - own.force / low if low else -1.0
        return abs(1 / inverse - 1) / self._stiffer if inverse > 0 else inf


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
        force, contact = self._error * abs(state.force), self._of_contact
        self.budgets.append(Budget(state.step, 0.0, 0.0, 0.0, theory=force))
        depth = self._error * abs(state.delta) if self._finds_depths else None
        found = replace(state, a_error=contact * state.a, p_max_error=contact * state.p_max)
        return replace(found, force_error=force, delta_error=depth)


Bars = ErrorBars | TheoryBars


def _of_slip(state: State | None) -> tuple[float, float, float, float]:
    """Contact radius, stick radius, depth and force; nothing at rest."""
    if state is None:
        return 0.0, 0.0, 0.0, 0.0
    return state.a, state.stick_radius or 0.0, state.delta, state.force


def _share(before: float, after: float) -> float:
    """How much of the larger of two lengths a step adds or takes."""
    return abs(after - before) / (max(before, after) or 1.0)


def _curve(states: States) -> Curve:
    return {state.step: state for state in states if state.converged}


def _spread(fine: Curve, coarse: Curve, state: State, name: str) -> list[float]:
    """The difference of a number of a step between two meshes or paths, NaN without it, and of the steps beside it."""

    def difference(k: int) -> float:
        return abs(getattr(coarse[k], name) - getattr(fine[k], name)) if k in fine and k in coarse else nan

    value, least = abs(getattr(state, name)), COMPARABLE_FORCE * abs(state.force)
    beside = [k for k in (state.step - 1, state.step + 1) if k in fine and k in coarse and fine[k].force > least]
    sizes = {k: getattr(fine[k], name) for k in beside}
    scaled = [difference(k) * value / abs(size) for k, size in sizes.items() if value * size]
    return [difference(state.step), *(found for found in scaled if found == found)]


def _difference(fine: Curve, coarse: Curve, step: int) -> float:
    if step not in fine or step not in coarse:
        return nan
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
