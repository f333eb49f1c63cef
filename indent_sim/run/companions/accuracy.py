"""Refine until the estimated error of the force is what `accuracy` asks for, or say why not."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.contact import ActiveSet, Penalty
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.companions.companion import Companion, beside, on_finer_mesh, on_its_mesh
from indent_sim.run.companions.drained_film import at_once
from indent_sim.run.companions.error_bars import Bars, Budget
from indent_sim.run.companions.sticking import bearer, sticking
from indent_sim.scene.cost import (
    SECONDS_PER_RUN,
    SECONDS_PER_THEORY_RUN,
    START_SECONDS,
    THEORY_SECONDS,
    Cost,
)
from indent_sim.scene.resolution import (
    MAX_ELEMENTS,
    ORDER_OF_CONVERGENCE,
    MeshResolution,
    target_error,
)
from indent_sim.scene.scene import Scene

ATTEMPTS = 6
FORCELESS = (
    1e-6  # of the largest force: a step with less has none that an accuracy could be asked of
)
# how much finer a next mesh is
LEAST_REFINEMENT = 1.3
GREATEST = 2.5
AIM = 1.1  # and how much finer than the estimate says
# The error bar to expect of a body that drains is about DRAINING n^-DRAINING_RATE, with n elements
# in the contact radius: the fluid's pressure has a corner where the tip's seal ends. SMEARED_EDGE:
# where that edge comes to lie within elements that are sealed in part. Measured on a punch and a
# ball, n = 5 to 56
DRAINING = 0.04
SMEARED_EDGE = 0.16
DRAINING_RATE = 1.3

Resolve = Callable[[float | None], Scene]  # the scene with so many elements in a contact radius
log = logging.getLogger("indent_sim")


@dataclass
class Attempt:
    """A scene on one of the meshes on the way to its accuracy."""

    scene: Scene
    tried: tuple[float, ...] = ()  # elements in the contact radius of the attempts before, in turn
    companion: Companion | None = (
        None  # the last of those as that of this one; None: it makes its own
    )
    missed: str = ""  # why it is not accurate enough; "" when it is
    following: Attempt | None = None  # what to try then; None: nothing may help

    def judge(self, resolve: Resolve, states: Sequence[State], bars: Bars) -> None:
        """Find whether an error bar is wider than the scene's accuracy allows, and what to try
        then.
        """
        shares = [
            (budget.total / force, budget) for force, budget in _pushing(states, bars.budgets)
        ]
        unknown = [(inf, budget) for share, budget in shares if share != share]
        error, worst = max(unknown or shares, key=lambda one: one[0], default=(0.0, None))
        fineness = self.scene.plan.resolution
        if fineness is None or worst is None or error <= fineness.target:
            return
        tried = (*self.tried, fineness.n)
        from_rest = next(
            (budget.path / force for force, budget in _pushing(states, bars.budgets)), 0.0
        )
        finer, end = _finer(resolve, fineness, error, worst, from_rest, len(tried))
        if finer is not None and finer.plan.resolution is not None:
            end = f"refining to {finer.plan.resolution.n:.3g} elements in the contact radius"
            ratio = self.scene.sizes.h_contact / finer.sizes.h_contact
            self.following = Attempt(finer, tried, Companion(ratio, states, self.scene))
        self.missed = (
            f"accuracy not reached: the error at step {worst.step} is estimated as "
            f"{error:.2g} of the force"
        )
        self.missed += f", {fineness.target:g} is asked for; {end}"


def attempts(
    resolve: Resolve, elements: float | None = None, tried: Sequence[float] = ()
) -> Iterator[Attempt]:
    """A scene, and finer and finer ones while the last is judged not to be accurate enough.

    A resumed run begins with the `elements` in the contact radius of its last attempt; `tried` are
    those before.
    """
    attempt: Attempt | None = Attempt(resolve(elements), tuple(tried))
    while attempt is not None:
        yield attempt
        if attempt.following is not None:
            log.info(attempt.missed)
        attempt = attempt.following


def foreseen(scene: Scene, error_bars: bool = False) -> Scene:
    """The scene with the seconds and the memory of its whole run predicted; error_bars: asked for
    beside `accuracy`.
    """
    if not scene.is_meshed or not (error_bars or scene.plan.resolution):
        return scene
    beside = _beside(scene, error_bars)
    seconds = scene.cost.seconds + sum(
        cost.seconds - START_SECONDS + SECONDS_PER_RUN for cost in beside
    )
    memory = max(cost.memory for cost in (scene.cost, *beside))
    prediction = scene.plan.prediction | {
        "memory_MB": round(memory / 1e6),
        "seconds": float(f"{seconds:.2g}"),
    }
    return replace(scene, plan=replace(scene.plan, prediction=prediction))


def seconds_in_study(scene: Scene, error_bars: bool = False) -> float:
    """Processor time [s] to expect of a run in a process that has its libraries, as `cpu_s` of
    study.csv counts it.
    """
    if not scene.is_meshed:
        return (
            float(scene.plan.prediction.get("seconds", THEORY_SECONDS))
            - THEORY_SECONDS
            + SECONDS_PER_THEORY_RUN
        )
    beside = _beside(scene, error_bars) if error_bars or scene.plan.resolution else []
    return sum(cost.seconds - START_SECONDS + SECONDS_PER_RUN for cost in (scene.cost, *beside))


def _beside(scene: Scene, error_bars: bool) -> list[Cost]:
    """What each scene costs that is solved beside this one for its error bars, or before it for its
    accuracy.
    """
    meshes = [scene, *(on_finer_mesh(scene, ratio) for ratio in _ratios_foreseen(scene))]
    others = companions_of(scene, error_bars)
    for coarse, fine in pairwise(meshes):
        others += [fine, *on_its_mesh(coarse), *_undrained(fine)]
    return [other.cost for other in others]


def companions_of(scene: Scene, no_slip: bool) -> list[Scene]:
    """All scenes that a run solves beside its first attempt: for its error bars, and for what stick
    would change.
    """
    ratio, coarse = beside(scene)
    where = bearer(Companion(1.0, (), scene), Companion(ratio, (), coarse)).scene or scene
    with_stick = sticking(where, max(scene.physics.deltas)) if no_slip else []
    return [coarse, *on_its_mesh(coarse), *_undrained(scene), *with_stick]


def _undrained(scene: Scene) -> list[Scene]:
    """The scene on its own mesh that tells what films beside drained faces cost, if there are any."""
    undrained = at_once(scene)
    return [] if undrained is None else [undrained]


def _ratios_foreseen(scene: Scene) -> list[float]:
    """How much finer than the first the further meshes on the way to a scene's accuracy will be, in
    turn.
    """
    physics = scene.physics
    fineness = scene.plan.resolution
    if fineness is None:
        return []
    if physics.permeable_regions and physics.drainage.tip == "sealed":
        is_smeared = scene.sizes.h_edge is None and not isinstance(physics.contact, ActiveSet)
        ratios = [1.0]
        error = SMEARED_EDGE if is_smeared else DRAINING
        while (bar := error * (ratios[-1] * fineness.n) ** -DRAINING_RATE) > fineness.target:
            ratios.append(ratios[-1] * _refinement(fineness.target / bar))
        if len(ratios) > 1:
            return ratios[1:ATTEMPTS]
    # the first mesh meets most accuracies, but leaves no room for what the steps of a path with
    # friction or a stiff penalty cost, and one from a file has the sizes that it has
    is_refined = (
        physics.has_friction,
        isinstance(physics.contact, Penalty),
        scene.sizes.refinements is not None,
    )
    return [LEAST_REFINEMENT] if any(is_refined) else []


def _refinement(room: float) -> float:
    """How much finer a next mesh is whose error is to be `room` times that of this one."""
    return float(min(max(AIM * room ** (-1 / ORDER_OF_CONVERGENCE), LEAST_REFINEMENT), GREATEST))


def unjudged(scene: Scene, states: Sequence[State], bars: Bars) -> list[str]:
    """What to say of steps whose error bar is wider than the scene's accuracy allows, but that are
    not held to it.
    """
    floor = _floor(states)
    fineness = scene.plan.resolution
    if fineness is None:
        return []
    forceless = [
        (state, bar)
        for state, bar in zip(states, bars.budgets, strict=True)
        if abs(state.force) <= floor
    ]
    wide = [
        str(state.step)
        for state, bar in forceless
        if not bar.total <= fineness.target * abs(state.force)
    ]
    said = f"accuracy is not asked of steps with less than {FORCELESS:g} of the largest force"
    return (
        [f"{said}: of {', '.join(wide[:5])}{' and more' if len(wide) > 5 else ''}"] if wide else []
    )


def _floor(states: Sequence[State]) -> float:
    """The force up to which a step has none that an accuracy could be asked of."""
    return FORCELESS * max((abs(state.force) for state in states), default=0.0)


def _pushing(states: Sequence[State], budgets: Sequence[Budget]) -> Iterator[tuple[float, Budget]]:
    """The size of the force of every step that has one, with its budget."""
    floor = _floor(states)
    forces = (abs(state.force) for state in states)
    return ((force, budget) for force, budget in zip(forces, budgets, strict=True) if force > floor)


def _finer(
    resolve: Resolve,
    fineness: MeshResolution,
    error: float,
    worst: Budget,
    from_rest: float,
    attempts: int,
) -> tuple[Scene | None, str]:
    """The next scene, or why there is none; `from_rest`: what the path costs the first row."""
    allowed = fineness.target * worst.total / error
    if worst.enforcement >= allowed and fineness.stiffness_given:
        return (
            None,
            f"the penalty's epsilon_n alone costs {error * worst.enforcement / worst.total:.2g}",
        )
    if worst.path >= allowed:
        helps = (
            f"{from_rest:.2g} at the first row, which is one step from rest however many there are"
        )
        helps = "more of them may help" if from_rest < fineness.target else helps
        return (
            None,
            f"the steps of the path alone cost {error * worst.path / worst.total:.2g}: {helps}",
        )
    if worst.time >= allowed:
        return (
            None,
            f"the steps in time alone cost {error * worst.time / worst.total:.2g}: a larger "
            "loading.per_doubling",
        )
    if worst.truncation >= allowed:
        return (
            None,
            "the finite body that stands for the half-space, or flat facets for a curved "
            "surface, cost more",
        )
    if attempts >= ATTEMPTS:
        return None, f"{attempts} attempts were not enough"
    other = worst.truncation + worst.path + worst.time
    room = (allowed - other) / (worst.total - other)
    factor = 2.0 if fineness.refinements else _refinement(room)
    if fineness.n * factor > MAX_ELEMENTS:
        return None, f"more than {MAX_ELEMENTS:g} elements in the contact radius would be needed"
    try:
        return resolve(fineness.n * factor), ""
    except ConfigError as limit:
        return None, f"the next mesh is beyond this machine ({limit.problem})"


def entry(
    config: Config, fineness: MeshResolution | None, tried: Sequence[float]
) -> dict[str, Any] | None:
    """What run.json says of the accuracy: what was asked for, and of a mesh the elements in a
    contact radius, now and before; None where nothing was asked for.
    """
    target = target_error(config.accuracy)
    of_mesh = {"elements": fineness.n, "tried": list(tried)} if fineness else {}
    return None if target is None else {"target": target} | of_mesh


@dataclass(frozen=True)
class Asked:
    """What a run was asked for beside its rows: error bars, and how small they are to be."""

    error_bars: bool
    accuracy: float | None

    @property
    def bars(self) -> bool:
        """Whether there are error bars."""
        return self.error_bars or self.accuracy is not None


def asked_in(report: Mapping[str, Any]) -> Asked:
    """What the run of a run.json was asked for; those of older versions say it by what they have."""
    target = (report.get("accuracy") or {}).get("target")
    telling = {"stick"} if target else {"stick", "error_budget"}
    said = {"error_bars": bool(telling & report.keys()), "accuracy": target} | report.get(
        "asked", {}
    )
    return Asked(said["error_bars"], said["accuracy"])


def refuse_other_bars(before: Asked, asked: Asked, folder: Path) -> None:
    """ConfigError when the run of a folder was asked for other error bars than the one to resume
    it.
    """
    if asked.bars and not before.bars:
        raise ConfigError(
            "", f"{folder} holds a run without error bars", "leave --resume out to replace it"
        )
    if before.accuracy != asked.accuracy:
        there, here = (
            f"accuracy {one:g}" if one else "no accuracy"
            for one in (before.accuracy, asked.accuracy)
        )
        problem = f"{folder} holds a run with {there}, this one has {here}"
        raise ConfigError("accuracy", problem, "leave --resume out to replace it")
