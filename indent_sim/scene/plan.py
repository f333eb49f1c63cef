"""Plan: the theory, choices, warnings and predictions of a simulation before it runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from indent_sim.scene.choices import Choice
from indent_sim.scene.model_warnings import ModelWarning
from indent_sim.scene.no_slip_effect import NoSlipEffect
from indent_sim.scene.predictions import ExpectedAdhesion
from indent_sim.scene.resolution import MeshResolution
from indent_sim.scene.time_prediction import TimePrediction
from indent_sim.theory.no_slip import FrictionCorrection
from indent_sim.theory.theory import Theory

if TYPE_CHECKING:
    from indent_sim.config.scene_sections import Units
    from indent_sim.scene.yielding_contact import YieldingContact
    from indent_sim.theory.adhesion import Jkr


@dataclass(frozen=True)
class Plan:
    """Information about a simulation before it runs.

    Attributes
    ----------
    resolution : MeshResolution or None
        The mesh resolution, if the key `accuracy` determined the element sizes.
    prediction : dict
        Predicted results and cost by name, in the user's units.
    stick : NoSlipEffect or None
        Change of the force if the surface could not slip; None with friction, or if unknown.
    friction : FrictionCorrection or None
        Effect of friction on the contact of the reference theory, if it is known.
    adhesion : ExpectedAdhesion or None
        Cohesive zone and pull-off force of an adhesive tip.
    jkr : Jkr or None
        The nondimensional JKR contact of the same tip.
    time : TimePrediction or None
        Characteristic times and elastic limiting cases of a scene with a history.
    yielding : YieldingContact or None
        Expected contact of a body whose first layer yields.
    """

    title: str
    units: Units
    theory: Theory | None = field(repr=False)
    resolution: MeshResolution | None
    choices: tuple[Choice, ...]
    model_warnings: tuple[ModelWarning, ...]
    prediction: dict[str, float]
    stick: NoSlipEffect | None = None
    friction: FrictionCorrection | None = None
    adhesion: ExpectedAdhesion | None = None
    jkr: Jkr | None = field(default=None, repr=False)
    time: TimePrediction | None = None
    yielding: YieldingContact | None = field(default=None, repr=False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return the messages of all model warnings that have a message."""
        return tuple(warning.message for warning in self.model_warnings if warning.message)

    def as_json(self) -> dict[str, Any]:
        """Return the plan as an object for JSON."""
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
