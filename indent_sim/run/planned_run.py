"""Planned run: the scene that a config becomes, before anything is solved or written."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Self

from indent_sim.config.scene_file import collect_errors, locate_error
from indent_sim.config.schema import Config
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.process.errors import ConfigError, IndentSimError
from indent_sim.scene.plan import Plan
from indent_sim.scene.scene import Scene, resolve, start_mesher
from indent_sim.scene.solver_choices import needs_mesh


@dataclass(frozen=True)
class PlannedRun:
    """A config and its resolved scene; depths are in the user's units."""

    config: Config = field(repr=False)
    scene: Scene = field(repr=False)

    @classmethod
    def resolve(cls, config: Config) -> Self:
        """Resolve a config; ConfigError for a scene that cannot exist or exceeds this machine."""
        return cls(config, resolve(config))

    def add_estimation_cost(self, error_bars: bool = False) -> Self:
        """Add the time and memory of all auxiliary runs of the error estimate."""
        if not (error_bars or self.scene.plan.resolution):
            return self
        from indent_sim.run.error_estimation.predicted_cost import predict_total_cost

        return replace(self, scene=predict_total_cost(self.scene, error_bars))

    def study_seconds(self, error_bars: bool = False) -> float:
        """Expected processor time [s] of the run in a process whose libraries are loaded."""
        from indent_sim.run.error_estimation.predicted_cost import study_seconds

        return study_seconds(self.scene, error_bars)

    @property
    def plan(self) -> Plan:
        """The plan of the run: decisions with their reasons, model warnings, predictions."""
        return self.scene.plan

    @property
    def depths(self) -> list[float]:
        """The depth of every row; the expected one where forces are prescribed."""
        return [delta * self.scene.physics.scales.depth for delta in self.scene.physics.deltas]

    @property
    def has_prescribed_forces(self) -> bool:
        """True if the load path prescribes forces."""
        return self.scene.physics.path.control == "force"

    @property
    def accepts_any_depth(self) -> bool:
        """True if forces at any depths follow without a load path: by theory or condensation."""
        return not self.scene.is_meshed or self.scene.solver.method == "condensed"

    @property
    def modulus(self) -> float:
        """Young's modulus of the material that the tip touches [user's units]."""
        return self.scene.physics.material.constants.E * self.scene.physics.scales.pressure

    @property
    def identity(self) -> str:
        """Hash of problem, discretisation, history and experiment, without titles and output."""
        # Imported here since it loads the readers of results, which no plan needs.
        from indent_sim.results.json_text import to_json

        scene = self.scene
        parts = [scene.physics, scene.sizes, scene.solver, scene.plan.resolution]
        parts += [
            part
            for part in (scene.experiment, scene.history_on_curve, scene.relaxation)
            if part is not None
        ]
        return hashlib.sha256(to_json(parts, indent=None).encode()).hexdigest()[:16]

    @property
    def stiffness_unit(self) -> float:
        """E*/h_contact in the user's units, the unit of the stiffness of a contact law."""
        return self._stiffness_unit * self.scene.physics.scales.stiffness

    @property
    def stiffness(self) -> float | None:
        """Stiffness epsilon_n or gamma of the contact law over E*/h_contact; None without one."""
        law = self.scene.physics.contact
        return law.stiffness / self._stiffness_unit if hasattr(law, "stiffness") else None

    @property
    def _stiffness_unit(self) -> float:
        """Stiffness E*/h_contact, to which that of the contact law is relative."""
        return self.scene.physics.material.E_star / self.scene.sizes.h_contact


def plan_with_cost(config: Config, error_bars: bool = False) -> PlannedRun:
    """Plan a run with its auxiliary runs; ConfigError with all errors of the config."""
    try:
        return PlannedRun.resolve(config).add_estimation_cost(error_bars)
    except ConfigError as error:
        raise collect_scene_errors(error, config) from None


def collect_scene_errors(first: ConfigError, config: Config) -> ConfigError:
    """Collect further errors of a scene beside the first one.

    With an imported mesh the first one is returned alone, since the mesh file is read only once.
    """
    is_of_file = isinstance(config.body, MeshFromFile)
    return locate_error(config, first) if is_of_file else collect_errors(first, config, resolve)


def start_mesher_if_needed(read: Callable[[], Config]) -> bool:
    """Start the mesher process if gmsh meshes the scene; return False if theory solves it."""
    # Errors of the config are reported later, by all ranks.
    with suppress(IndentSimError):
        config = read()
        if not needs_mesh(config):
            return False
        if not isinstance(config.body, MeshFromFile):
            start_mesher()
    return True
