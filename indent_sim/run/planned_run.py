"""Prospect of a run: what becomes of a config before anything is solved or written."""

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
from indent_sim.scene.choices import needs_mesh
from indent_sim.scene.scene import Plan, Scene, resolve, start_mesher


@dataclass(frozen=True)
class PlannedRun:
    """A config and the scene that it becomes. Depths are in the user's units."""

    config: Config = field(repr=False)
    scene: Scene = field(repr=False)

    @classmethod
    def resolve(cls, config: Config) -> Self:
        """The prospect of a config; ConfigError for a scene that cannot exist or that this machine
        cannot hold.
        """
        return cls(config, resolve(config))

    def add_estimation_cost(self, error_bars: bool = False) -> Self:
        """The same with seconds and memory of all that is solved for it, for `accuracy` and for
        error bars.
        """
        if not (error_bars or self.scene.plan.resolution):  # nothing is solved beside it
            return self
        from indent_sim.run.error_estimation.refinement import predict_total_cost

        return replace(self, scene=predict_total_cost(self.scene, error_bars))

    def study_seconds(self, error_bars: bool = False) -> float:
        """Processor time [s] to expect of the run in a process that has its libraries."""
        from indent_sim.run.error_estimation.refinement import study_seconds

        return study_seconds(self.scene, error_bars)

    @property
    def plan(self) -> Plan:
        """What is said of the run: choices with their reasons, doubts, predictions."""
        return self.scene.plan

    @property
    def depths(self) -> list[float]:
        """The depth of every row; to expect where forces are prescribed."""
        return [delta * self.scene.physics.scales.depth for delta in self.scene.physics.deltas]

    @property
    def has_prescribed_forces(self) -> bool:
        """Whether forces are prescribed."""
        return self.scene.physics.path.control == "force"

    @property
    def accepts_any_depth(self) -> bool:
        """Whether forces at any depths are found without a load path to them: by theory, or on a
        condensed body.
        """
        return not self.scene.is_meshed or self.scene.solver.method == "condensed"

    @property
    def modulus(self) -> float:
        """Young's modulus of what the tip touches, in the user's units."""
        return self.scene.physics.material.constants.E * self.scene.physics.scales.pressure

    @property
    def identity(self) -> str:
        """A name for physics, discretisation, history and experiment; titles and output have no
        part in it.
        """
        from indent_sim.results.writer import (
            to_json,
        )  # with the readers of results, which no plan of one scene needs

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
        """E*/h_contact in the user's units, of which the stiffness of a contact law is a multiple."""
        return self._stiffness_unit * self.scene.physics.scales.stiffness

    @property
    def stiffness(self) -> float | None:
        """epsilon_n or gamma in E*/h_contact; None for a method without one."""
        law = self.scene.physics.contact
        return law.stiffness / self._stiffness_unit if hasattr(law, "stiffness") else None

    @property
    def _stiffness_unit(self) -> float:
        return self.scene.physics.material.E_star / self.scene.sizes.h_contact


def plan_with_cost(config: Config, error_bars: bool = False) -> PlannedRun:
    """The prospect of a config, with all that is solved for it; ConfigError with everything that is
    wrong with it.
    """
    try:
        return PlannedRun.resolve(config).add_estimation_cost(error_bars)
    except ConfigError as error:
        raise collect_scene_errors(error, config) from None


def collect_scene_errors(first: ConfigError, config: Config) -> ConfigError:
    """An error of a scene, and those that it has without; a mesh file is read once, so there it
    stands alone.
    """
    is_of_file = isinstance(config.body, MeshFromFile)
    return locate_error(config, first) if is_of_file else collect_errors(first, config, resolve)


def start_mesher_if_needed(read: Callable[[], Config]) -> bool:
    """Fork the process that meshes, before MPI is up, unless theory solves what is read; whether it
    was.
    """
    with suppress(IndentSimError):  # what is wrong with the config is said later, by all ranks
        if not needs_mesh(read()):
            return False
    start_mesher()
    return True
