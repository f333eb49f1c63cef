"""What an experiment adds to the elastic curve of a linear body: adhesion, rate, the instrument and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

from annotated_types import Ge, Gt, Len, Lt

from indent_sim.model.units import ADHESION, FORCE, LENGTH, TIME, Length, Scales, Unit, UnitRow

MOST_POINTS, MOST_TERMS, MOST_FREQUENCIES = 10_000, 100, 10_000

Work = Annotated[float, Gt(0), ADHESION]
Time = Annotated[float, Gt(0), TIME]
Frequency = Annotated[float, Gt(0), Unit("1/time")]
SpringConstant = Annotated[float, Gt(0), Unit("force/length")]
Compliance = Annotated[float, Ge(0), Unit("length/force")]
Fraction = Annotated[float, Ge(0), Lt(1)]
Term = Annotated[tuple[float, ...], Len(2, 2), UnitRow((None, TIME))]
Way = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, LENGTH))]
Pull = Annotated[tuple[float, ...], Len(2, 2), UnitRow((TIME, FORCE))]


@dataclass(frozen=True)
class JKRAdhesion:
    """The JKR limit of an attraction with this work; `range` for its Tabor and Maugis numbers alone."""

    work: Work
    range: Length | None = None


@dataclass(frozen=True)
class PowerLaw:
    """E(t) = E (t/time)^-exponent."""

    exponent: Annotated[float, Gt(0), Lt(1)]
    time: Time


@dataclass(frozen=True)
class Relaxation:
    """E(t) of the whole body at constant nu, `material.E` being the instantaneous one: `prony` terms [fraction, time],
    whose fractions sum below 1, or a power law."""

    prony: Annotated[tuple[Term, ...], Len(1, MOST_TERMS)] | None = None
    power_law: PowerLaw | None = None


@dataclass(frozen=True)
class Cantilever:
    """The spring that holds the tip: z = delta + force/stiffness is the way of its base."""

    stiffness: SpringConstant


@dataclass(frozen=True)
class Frame:
    """What gives way beside the body: z = delta + compliance force."""

    compliance: Compliance


@dataclass(frozen=True)
class Calibration:
    """Relative uncertainties of the cantilever's stiffness and of the tip's radius."""

    stiffness: Fraction = 0.0
    R: Fraction = 0.0


@dataclass(frozen=True)
class Experiment:
    """Exact transforms of the frictionless curve of a linear body, each part optional.

    `history`: [t, delta], with a cantilever or a frame [t, z]; `force_history`: [t, force]; straight between the
    points, two equal times are a jump; before the first point the body is at rest. `frequencies` [cycles per time]: of
    small oscillations about the end of the history, or about the deepest point of `loading`.
    """

    adhesion: JKRAdhesion | None = None
    relaxation: Relaxation | None = None
    history: Annotated[tuple[Way, ...], Len(2, MOST_POINTS)] | None = None
    force_history: Annotated[tuple[Pull, ...], Len(2, MOST_POINTS)] | None = None
    cantilever: Cantilever | None = None
    frame: Frame | None = None
    frequencies: Annotated[tuple[Frequency, ...], Len(1, MOST_FREQUENCIES)] | None = None
    calibration: Calibration | None = None

    @property
    def points(self) -> tuple[tuple[float, ...], ...]:
        """The history of depths, ways or forces; empty without one."""
        return self.history or self.force_history or ()

    @property
    def is_stepped(self) -> bool:
        """Whether a relaxing body is followed step by step: forces or springs, or a tip that comes back."""
        values = [value for _, value in self.points]
        steps = [after - before for before, after in pairwise(values)]
        falls = [k for k, step in enumerate(steps) if step < 0]
        comes_back = bool(falls) and any(step > 0 for step in steps[falls[0] :])
        return self.relaxation is not None and (bool(self.force_history) or self.compliance > 0 or comes_back)

    @property
    def compliance(self) -> float:
        """(z - delta)/force [length/force] of cantilever and frame together."""
        spring = 1.0 / self.cantilever.stiffness if self.cantilever else 0.0
        return spring + (self.frame.compliance if self.frame else 0.0)

    def without_units(self, scales: Scales) -> Experiment:
        """The same experiment of the user's numbers in units of the scales: ways are depths; times stay."""
        ways, forces, stiffness = scales.depth, scales.force, scales.force / scales.depth
        adhesion = self.adhesion and scales.scaled(self.adhesion)
        history = self.history and tuple((t, way / ways) for t, way in self.history)
        pulls = self.force_history and tuple((t, force / forces) for t, force in self.force_history)
        held = self.cantilever and Cantilever(self.cantilever.stiffness / stiffness)
        frame = self.frame and Frame(self.frame.compliance * stiffness)
        return replace(self, adhesion=adhesion, history=history, force_history=pulls, cantilever=held, frame=frame)
