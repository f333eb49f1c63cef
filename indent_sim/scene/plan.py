"""Plan: what a scene says of its simulation before it runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from indent_sim.scene.choices import Choice
from indent_sim.scene.model_warnings import (
    ModelWarning,
)
from indent_sim.scene.no_slip_effect import (
    NoSlipEffect,
)
from indent_sim.scene.predictions import ExpectedAdhesion
from indent_sim.scene.resolution import MeshResolution
from indent_sim.scene.time_prediction import TimePrediction
from indent_sim.theory.no_slip import FrictionCorrection
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.schema import Units
    from indent_sim.theory.adhesion import Jkr


@dataclass(frozen=True)
class Plan:
    """What is said of a simulation before it runs: names, theory, choices with their reasons,
    doubts, predictions.
    """

    title: str
    units: Units
    theory: Theory | None = field(repr=False)
    resolution: MeshResolution | None  # where `accuracy` chose the sizes
    choices: tuple[Choice, ...]
    model_warnings: tuple[ModelWarning, ...]
    prediction: dict[str, float]  # in the user's units
    stick: NoSlipEffect | None = (
        None  # what no slip would change; None where there is friction, or nothing is known
    )
    friction: FrictionCorrection | None = (
        None  # what it changes of theory's contact, where that is known
    )
    adhesion: ExpectedAdhesion | None = None  # of a tip that adheres
    jkr: Jkr | None = field(default=None, repr=False)  # the same tip without range, without units
    time: TimePrediction | None = None  # of a scene that is followed in time

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the model or the mesh is a poor one for what is asked, a sentence each."""
        return tuple(doubt.message for doubt in self.model_warnings if doubt.message)

    def as_json(self) -> dict[str, Any]:
        """The plan as one JSON object."""
        parts = (
            "title",
            "units",
            "choices",
            "prediction",
            "stick",
            "friction",
            "adhesion",
            "warnings",
        )
        return {name: getattr(self, name) for name in parts} | {
            "time": self.time.report if self.time else None
        }
