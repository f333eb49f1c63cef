"""Internal variables depend neither on guesses, nor on failed increments, nor on interruptions.

For every path-dependent scene the rows are the same with and without extrapolation, after an
increment that was tried and dropped, and resumed from a checkpoint or from rest. With friction a
divided increment is another path: its rows are compared with those of a path that contains the
points of division.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import pytest
from dolfinx import fem
from scenes import PENALTY, meshed, scene

from indent_sim.fe import solver
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.problem import Problem, Snapshot
from indent_sim.fe.solve.newton import Newton
from indent_sim.fe.terms.scene_terms import additional_fields, bulk_terms, contact_terms
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.model.load_path import LoadPath
from indent_sim.scene.scene import Scene

COARSE = {"h_contact": 0.05, "h_far": 0.4}
LAYER = {"shape": "cylinder", "radius": 1.5, "height": 1.0, "base": "fixed", "sides": "roller"}
RUBBER = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
METAL = {"model": "hencky", "E": 1.0, "nu": 0.3, "plasticity": {"yield_stress": 2e-2, "n": 0.1}}
IN_AND_OUT = (0.015, 0.03, 0.022, 0.025)
IN_AND_ON = (0.015, 0.03, 0.045)
PULLED = (0.04, -0.06, 0.02)  # snaps in, and holds on where the body is open on the way in
STOPPED = 2  # rows of a run that was stopped
# of a row, of the largest force: Newton's tolerance is 1e-10 of a residual, and slip is a
# difference
SAME = 1e-7

FRICTION = {"method": "augmented_lagrangian", "friction": 0.3}
STICKY = {"adhesion": {"work": 1e-2, "range": 2e-2}}
SCENES: dict[str, tuple[tuple[float, ...], dict[str, Any]]] = {
    "friction, condensed": (IN_AND_OUT, {"contact": FRICTION, "solver": {"method": "condensed"}}),
    "friction": (IN_AND_OUT, {"contact": FRICTION, "solver": {"method": "newton"}}),
    "friction by a penalty": (IN_AND_OUT, {"contact": PENALTY | {"friction": 0.3}}),
    "stick, finite strain": (
        IN_AND_OUT,
        {"contact": FRICTION | {"friction": "stick"}, "material": RUBBER},
    ),
    "metal": (IN_AND_OUT, {"material": METAL}),
    "adhesion": (
        PULLED,
        {"contact": STICKY},
    ),
}


class Hindered:
    """An equilibrium without extrapolation, or one that fails at a depth until another is tried."""

    def __init__(self, equilibrium: Any, is_guessed: bool = True, refused: float | None = None):
        self._equilibrium, self._is_guessed, self._refused = equilibrium, is_guessed, refused
        self._tries, self._depth = 0, 0.0
        self.accepted: list[float] = []  # depths
        self.guessed: list[tuple[float, ...]] = []  # a depth, and those that it was predicted from

    def __getattr__(self, name: str) -> Any:
        return getattr(self._equilibrium, name)

    def extrapolate(self, depth: float, earlier: Sequence[Any]) -> None:
        self.guessed.append((depth, *(state.depth for state in earlier)))
        if self._is_guessed:
            self._equilibrium.extrapolate(depth, earlier)

    def solve(self, depth: float, dt: float = 0.0, slide: float = 0.0) -> bool:
        """Solve, and refuse one depth after it was solved: its state must leave no trace."""
        if self._tries and depth != self._refused:
            self._refused = None
        self._depth, is_found = depth, self._equilibrium.solve(depth, dt)
        self._tries += depth == self._refused
        return is_found and depth != self._refused

    def relax_to_stable_state(self, depth: float, dt: float = 0.0) -> bool:
        self._depth = depth
        return depth != self._refused and self._equilibrium.relax_to_stable_state(depth, dt)

    def accept(self) -> float:
        self.accepted.append(self._depth)
        return self._equilibrium.accept()


@cache
def the_scene(name: str) -> tuple[Scene, Any]:
    """A path-dependent scene and its mesh."""
    path, sections = SCENES[name]
    base = scene(LAYER, mesh=COARSE, **sections, loading={"deltas": list(path)})
    assert base.physics.is_path_dependent
    return base, meshed(base)


def fresh(name: str, **hindered: Any) -> Hindered:
    return Hindered(solver.create_equilibrium(*the_scene(name)), **hindered)


def walked(
    walk: solver.LoadStepper, depths: Sequence[float], done: int = 0, until: int | None = None
) -> list[Any]:
    """Rows of depths after the first `done`, up to `until`."""
    path = LoadPath("depth", tuple(depths[:until]))
    rows = list(walk.states(path, lambda step: False, done))
    assert all(row.converged for row in rows)
    return rows


@cache
def undisturbed(name: str) -> list[Any]:
    """Rows of an unhindered walk, in which the path dependence of the unloading is visible."""
    rows, turn = walked(solver.LoadStepper(fresh(name)), SCENES[name][0]), turned(name)
    (on_the_way_in,) = walked(solver.LoadStepper(fresh(name)), [rows[turn].delta])
    assert abs(on_the_way_in.force / rows[turn].force - 1) > 1e-4
    return rows


def turned(name: str) -> int:
    """Index of the first row of the unloading."""
    path = SCENES[name][0]
    return next(k for k, (before, depth) in enumerate(pairwise(path), start=1) if depth < before)


def assert_same(found: Sequence[Any], expected: Sequence[Any]) -> None:
    """Assert equal force, radius and dissipation, depth by depth, to Newton's tolerance."""
    size = max(abs(row.force) for row in expected)
    for one, other in zip(found, expected, strict=True):
        assert one.delta == other.delta
        assert one.force == pytest.approx(other.force, rel=SAME, abs=SAME * size)
        assert one.a == pytest.approx(other.a, rel=1e-4, abs=1e-9)
        if one.dissipation is not None:
            assert one.dissipation == pytest.approx(
                other.dissipation, rel=1e-4, abs=SAME * size * abs(one.delta)
            )


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.verify] * (name == "adhesion")) for name in SCENES],
)
def test_a_guess_is_not_remembered(name: str) -> None:
    assert_same(
        walked(solver.LoadStepper(fresh(name, is_guessed=False)), SCENES[name][0]),
        undisturbed(name),
    )


@pytest.mark.parametrize("name", SCENES)
def test_a_step_that_failed_is_not_remembered(name: str) -> None:
    """A path with a divided increment has the rows of a path with those points as rows."""
    path, turn = SCENES[name][0], turned(name)
    hindered = fresh(name, refused=path[turn])
    cut = walked(solver.LoadStepper(hindered), path)
    assert cut[turn].substeps > undisturbed(name)[turn].substeps
    begin, end = (hindered.accepted.index(depth) for depth in path[turn - 1 : turn + 1])
    parts = hindered.accepted[begin + 1 : end]
    asked = walked(solver.LoadStepper(fresh(name)), [*path[:turn], *parts, *path[turn:]])
    assert_same(cut[:turn], asked[:turn])
    assert_same(cut[turn + 1 :], asked[turn + len(parts) + 1 :])
    assert cut[turn].force == pytest.approx(asked[turn + len(parts)].force, rel=SAME)


@pytest.mark.parametrize(
    ("name", "origin"),
    [
        pytest.param(
            name, origin, marks=[pytest.mark.verify] * ((name, origin) == ("adhesion", "rest"))
        )
        for name in SCENES
        for origin in ("checkpoint", "rest")
    ],
)
def test_a_resumed_run_remembers_the_same(name: str, origin: str) -> None:
    path = SCENES[name][0]
    stopped = solver.LoadStepper(fresh(name))
    before = walked(stopped, path, until=STOPPED)
    goes_on = solver.LoadStepper(fresh(name))
    kept = stopped.points if origin == "checkpoint" else []  # of a condensed body there are none
    assert goes_on.resume(kept, [] if kept else [(depth, 0.0) for depth in path[:STOPPED]])
    assert_same([*before, *walked(goes_on, path, done=STOPPED)], undisturbed(name))


@pytest.mark.parametrize("name", [name for name in SCENES if name not in ("adhesion", "metal")])
@pytest.mark.parametrize("origin", ["checkpoint", "rest"])
def test_a_resumed_run_guesses_as_an_undisturbed_one(name: str, origin: str) -> None:
    """A resumed run makes the same initial guesses as an undisturbed one.

    From another guess Newton's method may fail, the increment is cut, and the result of a
    path-dependent contact changes.
    """
    whole, first, second = fresh(name), fresh(name), fresh(name)
    walked(solver.LoadStepper(whole), IN_AND_ON)
    stopped, goes_on = solver.LoadStepper(first), solver.LoadStepper(second)
    walked(stopped, IN_AND_ON, until=STOPPED)
    kept = stopped.points if origin == "checkpoint" else []  # of a condensed body there are none
    assert goes_on.resume(kept, [] if kept else [(depth, 0.0) for depth in IN_AND_ON[:STOPPED]])
    second.guessed.clear()
    walked(goes_on, IN_AND_ON, done=STOPPED)
    assert first.guessed + second.guessed == whole.guessed and second.guessed


# ---- time


class Maxwell(Term):
    """A foundation of springs in series with dashpots, under the base.

    The traction is -k (u - q) [pressure] with c dq/dt = k (u - q), by backward Euler. The internal
    variable q is the displacement of the dashpots.
    """

    has_memory = True

    def __init__(self, body: Body, k: float, c: float):
        """Set k [pressure/length] and c [pressure time/length]."""
        self._body, self._k, self._c = body, fem.Constant(body.mesh, k), fem.Constant(body.mesh, c)
        self._q = fem.Function(body.unknowns.collapsed_space("u"))
        self.history = (self._q,)

    def _gone(self, q: Any, u: Any, share: Any) -> Any:
        """Displacement of the dashpots at the end of an increment; share: k dt/c."""
        return (q + share * u) / (1 + share)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> Any:
        u, way = now.fields["u"], self._body.unknowns.split_fields(now.test)["u"]
        stretch = u - self._gone(self._q, u, self._k * dt / self._c)
        return self._body.surface_integral(
            "base", self._k * sum(stretch[i] * way[i] for i in range(len(way)))
        )

    def accept(self) -> None:
        u = self._body.local_array()[self._body.unknowns.dofs("u")]
        share = float(self._k.value) * float(self._body.dt.value) / float(self._c.value)
        self._q.x.array[:] = self._gone(self._q.x.array, u, share)


HISTORY = [
    (0.02, 0.5),
    (0.05, 0.5),
    (0.05, 0.5),
    (0.05, 1.0),
    (0.03, 0.5),
    (0.03, 2.0),
]  # depth, and the time to it


class Relaxing:
    """A body on rollers and a Maxwell foundation under the tip, increment by increment."""

    def __init__(self) -> None:
        base = scene(
            LAYER | {"base": "roller", "sides": "free"},
            mesh=COARSE,
            loading={"delta": 0.05},
            solver={"method": "newton"},
        )
        body = Body(base, meshed(base), additional_fields(base))
        matter = bulk_terms(body)
        self.problem = Problem(
            body,
            [*matter, *contact_terms(body, matter.strain_energies[0]), Maxwell(body, 10.0, 10.0)],
        )
        self.newton = Newton(self.problem)
        self.problem.accept()
        self.before = [self.problem.snapshot()]

    def step(self, depth: float, dt: float, is_guessed: bool = True) -> None:
        """Solve an increment, extrapolated or from the last state, without accepting it."""
        (stage,) = self.problem.stages(dt)
        self.problem.begin_stage(stage)
        self.problem.delta.value = depth
        if is_guessed and len(self.before) > 1:
            self.problem.set_trial_state(
                [2 * b - a for a, b in zip(*(s.unknowns for s in self.before[-2:]), strict=True)]
            )
        assert self.newton.solve(), self.newton.failure
        self.problem.end_stage(stage)

    def rows(
        self, history: Sequence[tuple[float, float]], is_guessed: bool = True
    ) -> Iterator[float]:
        """Forces after every increment."""
        for depth, dt in history:
            self.step(depth, dt, is_guessed)
            yield self.problem.force()
            self.problem.accept()
            self.before.append(self.problem.snapshot())

    def set_out_from(self, state: Snapshot) -> None:
        self.problem.restore(state)
        self.before = [state]


@cache
def relaxed() -> tuple[float, ...]:
    """Forces of HISTORY, which fall during the hold."""
    forces = tuple(Relaxing().rows(HISTORY))
    in_hold = forces[1:4]
    assert all(after < before - 1e-4 * before for before, after in pairwise(in_hold))
    return forces


def test_a_relaxing_body_does_not_remember_a_guess() -> None:
    assert list(Relaxing().rows(HISTORY, is_guessed=False)) == pytest.approx(relaxed(), rel=SAME)


def test_a_relaxing_body_does_not_remember_a_step_that_failed() -> None:
    """A failed increment leaves no trace in a ramp, a hold and an unloading.

    The state before is restored, and two halves follow.
    """
    for failing in (1, 3, 4):
        (was, _), (depth, dt) = HISTORY[failing - 1], HISTORY[failing]
        halves = [((was + depth) / 2, dt / 2), (depth, dt / 2)]
        asked = [*HISTORY[:failing], *halves, *HISTORY[failing + 1 :]]
        body = Relaxing()
        found = list(body.rows(asked[:failing]))
        body.step(depth, dt)
        body.problem.restore(body.before[-1])
        assert [*found, *body.rows(asked[failing:])] == pytest.approx(
            list(Relaxing().rows(asked)), rel=SAME
        )


def test_a_relaxing_body_goes_on_from_what_was_kept() -> None:
    stopped, goes_on = Relaxing(), Relaxing()
    before = list(stopped.rows(HISTORY[:4]))
    goes_on.set_out_from(stopped.before[-1])
    assert [*before, *goes_on.rows(HISTORY[4:])] == pytest.approx(relaxed(), rel=SAME)
