"""Experiment: adhesion without range, instrument, oscillations, and calibration uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from annotated_types import Ge, Gt, Len

from indent_sim.model.relaxation import Fraction
from indent_sim.model.units import ADHESION, Length, Scales, Unit

Work = Annotated[float, Gt(0), ADHESION]
Frequency = Annotated[float, Gt(0), Unit("1/time")]
SpringConstant = Annotated[float, Gt(0), Unit("force/length")]
Compliance = Annotated[float, Ge(0), Unit("length/force")]


@dataclass(frozen=True)
class JKRAdhesion:
    """Adhesion without range (JKR), defined by the work of adhesion.

    A range is only used to compute the parameters of Tabor and Maugis. `base_work` is the work of
    adhesion between a body that rests on a flat and this flat; `work` is that between tip and body.
    """

    work: Work
    range: Length | None = None
    base_work: Work | None = None


@dataclass(frozen=True)
class Cantilever:
    """Cantilever spring that holds the tip; the base moves by z = delta + force/stiffness."""

    stiffness: SpringConstant


@dataclass(frozen=True)
class Frame:
    """Compliance of the instrument's frame: z = delta + compliance force."""

    compliance: Compliance


@dataclass(frozen=True)
class Calibration:
    """Relative uncertainties of the cantilever's stiffness and of the tip's radius."""

    stiffness: Fraction = 0.0
    R: Fraction = 0.0


@dataclass(frozen=True)
class Experiment:
    """Instrument and conditions of the measurement of a frictionless contact with a linear body.

    Every part is optional. `frequencies` [cycles per time] are the frequencies of small
    oscillations about the end of the history, or about the deepest point of `loading`.
    """

    adhesion: JKRAdhesion | None = None
    cantilever: Cantilever | None = None
    frame: Frame | None = None
    frequencies: Annotated[tuple[Frequency, ...], Len(1, 10_000)] | None = None
    calibration: Calibration | None = None

    @property
    def compliance(self) -> float:
        """Total compliance (z - delta)/force [length/force] of cantilever and frame."""
        spring = 1.0 / self.cantilever.stiffness if self.cantilever else 0.0
        return spring + (self.frame.compliance if self.frame else 0.0)

    def nondimensionalize(self, scales: Scales) -> Experiment:
        """Return the same experiment divided by the scales; times do not change."""
        stiffness = scales.force / scales.depth
        adhesion = self.adhesion and scales.nondimensionalize(self.adhesion)
        cantilever = self.cantilever and Cantilever(self.cantilever.stiffness / stiffness)
        frame = self.frame and Frame(self.frame.compliance * stiffness)
        return replace(self, adhesion=adhesion, cantilever=cantilever, frame=frame)
