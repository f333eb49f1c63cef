"""Stress relaxation of an elastic law: Prony series and power law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from annotated_types import Ge, Gt, Len, Lt

from indent_sim.model.units import (
    TIME,
    UnitRow,
)

MAX_PRONY_TERMS = 100  # of a relaxation
Time = Annotated[float, Gt(0), TIME]
Fraction = Annotated[float, Ge(0), Lt(1)]
RelaxationTerm = Annotated[tuple[float, ...], Len(2, 2), UnitRow((None, TIME))]


@dataclass(frozen=True)
class PowerLaw:
    """E(t) = E (t/time)^-exponent."""

    exponent: Annotated[float, Gt(0), Lt(1)]
    time: Time


@dataclass(frozen=True)
class Relaxation:
    """G(t) of a law whose own constants are the instantaneous ones: `prony` terms [fraction, time],
    whose fractions sum below 1, or a power law. `of`: all moduli fall alike, nu stays what it is
    | shear: the bulk modulus stays what it is, and at finite strain too.
    """

    prony: Annotated[tuple[RelaxationTerm, ...], Len(1, MAX_PRONY_TERMS)] | None = None
    power_law: PowerLaw | None = None
    of: Literal["all", "shear"] = "all"


class PronySeries(NamedTuple):
    """G(t) = rest + sum fraction exp(-t/time) of a modulus, over that of the law's constants; times
    [time] > 0.
    """

    long_term: float
    fractions: tuple[float, ...]
    times: tuple[float, ...]
