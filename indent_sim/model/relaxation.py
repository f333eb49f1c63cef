"""Stress relaxation of an elastic law: Prony series and power law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from annotated_types import Ge, Gt, Len, Lt

from indent_sim.model.units import (
    TIME,
    UnitRow,
)

Time = Annotated[float, Gt(0), TIME]
Fraction = Annotated[float, Ge(0), Lt(1)]
RelaxationTerm = Annotated[tuple[float, ...], Len(2, 2), UnitRow((None, TIME))]


@dataclass(frozen=True)
class PowerLaw:
    """Power-law relaxation of Young's modulus, E(t) = E (t/time)^-exponent."""

    exponent: Annotated[float, Gt(0), Lt(1)]
    time: Time


@dataclass(frozen=True)
class Relaxation:
    """Stress relaxation of an elastic law with instantaneous constants.

    The relaxation is given by `prony` terms [fraction, time], whose fractions sum to less than 1,
    or by a power law. With `of` "all", all moduli relax by one factor at constant nu; with "shear",
    the shear modulus relaxes at constant bulk modulus, at small and at finite strain.
    """

    prony: Annotated[tuple[RelaxationTerm, ...], Len(1, 100)] | None = None
    power_law: PowerLaw | None = None
    of: Literal["all", "shear"] = "all"


class PronySeries(NamedTuple):
    """Relaxation function G(t)/G(0) = long_term + sum fraction exp(-t/time) of a modulus.

    G(0) is the instantaneous modulus; the times [time] are > 0.
    """

    long_term: float
    fractions: tuple[float, ...]
    times: tuple[float, ...]
