"""Planned run: a config with its scene and predicted cost, before anything is solved."""

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
from indent_sim.process.installation import installed_solver_packages
from indent_sim.scene.plan import Plan
from indent_sim.scene.scene import Scene, resolve, start_mesher
from indent_sim.scene.solver_choices import needs_mesh


@dataclass(frozen=True)
class PlannedRun:
    """Config and resolved scene of a run that has not started; depths are in the user's units."""

    config: Config = field(repr=False)
    scene: Scene = field(repr=False)

    @classmethod
    def resolve(cls, config: Config) -> Self:
        """Resolve a config; raise ConfigError if the scene is invalid or needs too much memory."""
        return cls(config, resolve(config))

    def add_estimation_cost(self, error_bars: bool = False) -> Self:
        """Return this run with the time and memory of all auxiliary runs of the error estimate."""
        if not (error_bars or self.scene.plan.resolution):
            return self
        from indent_sim.run.error_estimation.predicted_cost import predict_total_cost

        return replace(self, scene=predict_total_cost(self.scene, error_bars))

    def study_seconds(self, error_bars: bool = False) -> float:
        """Return the expected processor time [s] of the run, excluding the import of libraries."""
        from indent_sim.run.error_estimation.predicted_cost import study_seconds

        return study_seconds(self.scene, error_bars)

    @property
    def plan(self) -> Plan:
        """Plan of the run: decisions with their reasons, model warnings, predictions."""
        return self.scene.plan

    @property
    def depths(self) -> list[float]:
        """Depth of every row; the expected depth if forces are prescribed."""
        return [delta * self.scene.physics.scales.depth for delta in self.scene.physics.deltas]

    @property
    def has_prescribed_forces(self) -> bool:
        """True if the load path prescribes forces."""
        return self.scene.physics.path.control == "force"

    @property
    def accepts_any_depth(self) -> bool:
        """True if theory or condensation gives forces at any depths, without a load path."""
        return not self.scene.is_meshed or self.scene.solver.method == "condensed"

    @property
    def modulus(self) -> float:
        """Young's modulus of the material that the tip touches [user's units]."""
        return self.scene.physics.material.constants.E * self.scene.physics.scales.pressure

    @property
    def identity(self) -> str:
        """Hash of problem, discretisation, history and experiment, but not of titles and output."""
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
        """Stiffness epsilon_n or gamma of the contact law, divided by E*/h_contact; may be None."""
        law = self.scene.physics.contact
        return law.stiffness / self._stiffness_unit if hasattr(law, "stiffness") else None

    @property
    def _stiffness_unit(self) -> float:
        """Nondimensional stiffness E*/h_contact, the unit of the contact law's stiffness."""
        return self.scene.physics.material.E_star / self.scene.sizes.h_contact


def plan_with_cost(config: Config, error_bars: bool = False) -> PlannedRun:
    """Plan a run with its auxiliary runs; if the config has errors, raise them all together."""
    try:
        return PlannedRun.resolve(config).add_estimation_cost(error_bars)
    except ConfigError as error:
        raise collect_scene_errors(error, config) from None


def collect_scene_errors(first: ConfigError, config: Config) -> ConfigError:
    """Return a ConfigError with the first and all further errors of a scene.

    With an imported mesh only the first error is returned, since the mesh file is read only once.
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
        if not isinstance(config.body, MeshFromFile) and installed_solver_packages():
            start_mesher()
    return True
