"""Unions of the elastic laws, each of which is a frozen dataclass with its constants."""

from __future__ import annotations

from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import (
    ArrudaBoyce,
    Fung,
    Gent,
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
)
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic

Material = (
    LinearElastic
    | TransverselyIsotropic
    | NeoHookean
    | Hencky
    | MooneyRivlin
    | Yeoh
    | Ogden
    | Gent
    | Fung
    | ArrudaBoyce
    | Gel
)
# Laws whose energy separates into a shear and a volumetric part, so that shear may relax alone.
ShearRelaxingLaw = LinearElastic | Hencky | MooneyRivlin | Yeoh | Ogden | Gent | Fung | ArrudaBoyce
# Laws of a soft tip.
TipLaw = (
    LinearElastic | NeoHookean | Hencky | MooneyRivlin | Yeoh | Ogden | Gent | Fung | ArrudaBoyce
)
# Laws that may have `plasticity`.
YieldingLaw = LinearElastic | Hencky
