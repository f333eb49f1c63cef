"""Refine until the estimated error of the force is what `accuracy` asks for, or say why not."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_bars import FORCELESS, RATIOS, Bars, Budget, Companion
from indent_sim.scene.fineness import MOST, RATE, Fineness, target_of
from indent_sim.scene.scene import Scene

ATTEMPTS = 6
LEAST, GREATEST = 1.3, 2.5  # how much finer a next mesh is
AIM = 1.1  # and how much finer than the estimate says

Resolve = Callable[[float | None], Scene]  # the scene with so many elements in a contact radius
log = logging.getLogger("indent_sim")


@dataclass
class Attempt:
    """A scene on one of the meshes on the way to its accuracy."""

    scene: Scene
    tried: tuple[float, ...] = ()  # elements in the contact radius of the attempts before, in turn
    companions: Sequence[Companion] = ()  # the last of those as companions of this one; none: it makes its own
    missed: str = ""  # why it is not accurate enough; "" when it is
    following: Attempt | None = None  # what to try then; None: nothing may help

    def judge(self, resolve: Resolve, states: Sequence[State], bars: Bars) -> None:
        """Find whether an error bar is wider than the scene's accuracy allows, and what to try then."""
        found, worst = worst_of(states, bars.budgets)
        fineness = self.scene.plan.fineness
        if fineness is None or worst is None or found <= fineness.target:
            return
        tried = (*self.tried, fineness.n)
        finer, end = _finer(resolve, fineness, found, worst, _from_rest(states, bars.budgets), len(tried))
        if finer is not None and finer.plan.fineness is not None:
            end = f"refining to {finer.plan.fineness.n:.3g} elements in the contact radius"
            ratio = self.scene.sizes.h_contact / finer.sizes.h_contact
            last = [Companion(1.0, states, self.scene), *bars.companions][: len(RATIOS)]
            self.following = Attempt(finer, tried, [replace(one, ratio=one.ratio * ratio) for one in last])
        self.missed = (f"accuracy not reached: the error at step {worst.step} is estimated as {found:.2g} of the "
                       f"force, {fineness.target:g} is asked for; {end}")  # fmt: skip


def attempts(resolve: Resolve, elements: float | None = None, tried: Sequence[float] = ()) -> Iterator[Attempt]:
    """A scene, and finer and finer ones while the last is judged not to be accurate enough.

    A resumed run begins with the `elements` in the contact radius of its last attempt; `tried` are those before.
    """
    attempt: Attempt | None = Attempt(resolve(elements), tuple(tried))
    while attempt is not None:
        yield attempt
        if attempt.following is not None:
            log.info(attempt.missed)
        attempt = attempt.following


def unjudged(scene: Scene, states: Sequence[State], bars: Bars) -> list[str]:
    """What to say of steps whose error bar is wider than the scene's accuracy allows, but that are not held to it."""
    floor, fineness = _floor(states), scene.plan.fineness
    if fineness is None:
        return []
    wide = [state.step for state, budget in zip(states, bars.budgets, strict=True)
            if abs(state.force) <= floor and not budget.total <= fineness.target * abs(state.force)]  # fmt: skip
    said = f"accuracy is not asked of steps with less than {FORCELESS:g} of the largest force"
    return [f"{said}: of {', '.join(map(str, wide[:5]))}{' and more' if len(wide) > 5 else ''}"] if wide else []


def _floor(states: Sequence[State]) -> float:
    """The force up to which a step has none that an accuracy could be asked of."""
    return FORCELESS * max((abs(state.force) for state in states), default=0.0)


def worst_of(states: Sequence[State], budgets: Sequence[Budget]) -> tuple[float, Budget | None]:
    """The largest error bar relative to its force, of all steps that have a force, and its budget."""
    floor = _floor(states)
    bars = [(budget.total / abs(state.force), budget)
            for state, budget in zip(states, budgets, strict=True) if abs(state.force) > floor]  # fmt: skip
    unknown = [(float("inf"), budget) for relative, budget in bars if relative != relative]
    return max(unknown or bars, key=lambda bar: bar[0], default=(0.0, None))


def _finer(
    resolve: Resolve, fineness: Fineness, found: float, worst: Budget, from_rest: float, attempts: int
) -> tuple[Scene | None, str]:
    """The next scene, or why there is none; `from_rest`: what the path costs the first row."""
    allowed = fineness.target * worst.total / found
    if worst.enforcement >= allowed and fineness.stiffness_given:
        return None, f"the penalty's epsilon_n alone costs {found * worst.enforcement / worst.total:.2g}"
    if worst.path >= allowed:
        return None, f"the steps of the path alone cost {found * worst.path / worst.total:.2g}: " + (
            "more of them may help" if from_rest < fineness.target else
            f"{from_rest:.2g} at the first row, which is one step from rest however many there are")  # fmt: skip
    if worst.truncation >= allowed:
        return None, "the finite body that stands for the half-space costs more"
    if attempts >= ATTEMPTS:
        return None, f"{attempts} attempts were not enough"
    other = worst.truncation + worst.path
    room = (allowed - other) / (worst.total - other)
    factor = 2.0 if fineness.refinements else min(max(AIM * room ** (-1 / RATE), LEAST), GREATEST)
    if fineness.n * factor > MOST:
        return None, f"more than {MOST:g} elements in the contact radius would be needed"
    try:
        return resolve(fineness.n * factor), ""
    except ConfigError as limit:
        return None, f"the next mesh is beyond this machine ({limit.problem})"


def _from_rest(states: Sequence[State], budgets: Sequence[Budget]) -> float:
    """What the path costs the first row that has a force, relative to it."""
    floor = _floor(states)
    costs = (budget.path / abs(state.force) for state, budget in zip(states, budgets, strict=True)
             if abs(state.force) > floor)  # fmt: skip
    return next(costs, 0.0)


def entry(config: Config, fineness: Fineness | None, tried: Sequence[float]) -> dict[str, Any] | None:
    """What run.json says of the accuracy: what was asked for, and of a mesh the elements in a contact radius, now and
    before; None where nothing was asked for."""
    target = target_of(config.accuracy)
    if target is None or fineness is None:
        return None if target is None else {"target": target}
    return {"target": target, "elements": fineness.n, "tried": list(tried)}


def refuse_other_bars(before: Mapping[str, Any], config: Config, with_bars: bool, folder: Path) -> None:
    """ConfigError when the run of a folder, by its run.json, asked for other error bars than the one to resume it."""
    if before and with_bars and "error_budget" not in before:
        raise ConfigError("", f"{folder} holds a run without error bars", "leave --resume out to replace it")
    asked = (before.get("accuracy") or {}).get("target")
    if before and asked != target_of(config.accuracy):
        there, here = (f"accuracy {one:g}" if one else "no accuracy" for one in (asked, target_of(config.accuracy)))
        raise ConfigError("accuracy", f"{folder} holds a run with {there}, this one has {here}",
                          "leave --resume out to replace it")  # fmt: skip
