"""Refine until the estimated error of the force is what `accuracy` asks for, or say why not."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.config.schema import Config
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError, VerificationError
from indent_sim.run.error_bars import FORCELESS, RATIOS, Budget, Companion, ErrorBars
from indent_sim.scene.fineness import MOST, RATE, Fineness, target_of
from indent_sim.scene.scene import Scene

ATTEMPTS = 6
LEAST, GREATEST = 1.3, 2.5  # how much finer a next mesh is
AIM = 1.1  # and how much finer than the estimate says

Result = TypeVar("Result")
Resolve = Callable[[float | None], Scene]  # the scene with so many elements in a contact radius
log = logging.getLogger("indent_sim")


class AccuracyNotReached(VerificationError):
    """The error bar is wider than `accuracy` allows.

    `finer` is the scene to try next, if there is one; `companions` the last runs as companions of this one.
    """

    def __init__(self, message: str, finer: Scene | None, companions: Sequence[Companion]):
        super().__init__(message)
        self.finer, self.companions = finer, companions


def pursue(resolve: Resolve, attempt: Callable[[Scene, Sequence[Companion]], Result]) -> Result:
    """Attempt a scene, and finer and finer ones until one is accurate enough; each run is the next one's companion.

    Without `accuracy` in the config it is one attempt.
    """
    scene: Scene = resolve(None)
    companions: Sequence[Companion] = ()
    while True:
        try:
            return attempt(scene, companions)
        except AccuracyNotReached as miss:
            if miss.finer is None:
                raise
            log.info(str(miss))
            finer = scene.sizes.h_contact / miss.finer.sizes.h_contact
            companions = [companion.beside(finer) for companion in miss.companions]
            scene = miss.finer


def check(resolve: Resolve, scene: Scene, states: Sequence[State], bars: ErrorBars, attempts: int) -> None:
    """AccuracyNotReached when an error bar is wider than the scene's accuracy allows."""
    fineness = scene.fineness
    if fineness is None:
        return
    found, worst = worst_of(states, bars.budgets)
    if found <= fineness.target or worst is None:
        return
    said = f"accuracy not reached: the error at step {worst.step} is estimated as {found:.2g} of the force, "
    said += f"{fineness.target:g} is asked for"
    finer, why = _finer(resolve, fineness, found, worst, attempts)
    end = f"refining to {finer.fineness.n:.3g} elements in the contact radius" if finer and finer.fineness else why
    raise AccuracyNotReached(f"{said}; {end}", finer, [Companion(1.0, states, scene), *bars.companions][: len(RATIOS)])


def unjudged(scene: Scene, states: Sequence[State], bars: ErrorBars) -> list[str]:
    """What to say of steps whose error bar is wider than the scene's accuracy allows, but that are not held to it."""
    floor, fineness = _floor(states), scene.fineness
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
    resolve: Resolve, fineness: Fineness, found: float, worst: Budget, attempts: int
) -> tuple[Scene | None, str]:
    """The next scene, or why there is none."""
    allowed = fineness.target * worst.total / found
    if worst.enforcement >= allowed and fineness.stiffness_given:
        return None, f"the penalty's epsilon_n alone costs {found * worst.enforcement / worst.total:.2g}"
    if worst.truncation >= allowed:
        return None, "the finite body that stands for the half-space costs more"
    if attempts >= ATTEMPTS:
        return None, f"{attempts} attempts were not enough"
    room = (allowed - worst.truncation) / (worst.total - worst.truncation)
    factor = min(max(AIM * room ** (-1 / RATE), LEAST), GREATEST)
    if fineness.n * factor > MOST:
        return None, f"more than {MOST:g} elements in the contact radius would be needed"
    try:
        return resolve(fineness.n * factor), ""
    except ConfigError as limit:
        return None, f"the next mesh is beyond this machine ({limit.problem})"


def entry(fineness: Fineness, tried: Sequence[float]) -> dict[str, Any]:
    """What run.json says of the accuracy: what was asked for, the elements in a contact radius, now and before."""
    return {"target": fineness.target, "elements": fineness.n, "tried": list(tried)}


def refuse_other_bars(before: Mapping[str, Any], config: Config, with_bars: bool, folder: Path) -> None:
    """ConfigError when the run of a folder, by its run.json, asked for other error bars than the one to resume it."""
    if before and with_bars and "error_budget" not in before:
        raise ConfigError("", f"{folder} holds a run without error bars", "leave --resume out to replace it")
    asked = (before.get("accuracy") or {}).get("target")
    if before and asked != target_of(config.accuracy):
        there, here = (f"accuracy {one:g}" if one else "no accuracy" for one in (asked, target_of(config.accuracy)))
        raise ConfigError("accuracy", f"{folder} holds a run with {there}, this one has {here}",
                          "leave --resume out to replace it")  # fmt: skip
