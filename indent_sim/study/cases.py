"""Points of the grid -> Cases: every config checked and resolved, and its physics given a name, before any run."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from indent_sim.config.file import located, varied
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import inline
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.results.writer import to_json
from indent_sim.scene.scene import Scene, resolve
from indent_sim.study.file import StudyFile
from indent_sim.study.grid import Multiple, Point, Setting

MOST_TOLD = 20  # errors
LONGEST = 80  # letters of a run's name before its id
DISCRETE = ("mesh", "contact", "solver")  # sections that choose how a scene is solved, not which scene it is


@dataclass(frozen=True)
class Case:
    """One run of a study: a row of its table. `id` names the physics: equal ids are one run.

    `name`, of its folder, says what varies before that.
    """

    index: int
    values: dict[str, Any]
    config: Config = field(repr=False)
    scene: Scene = field(repr=False)
    id: str

    @property
    def words(self) -> str:
        """The varied keys in words."""
        return ", ".join(f"{key}={short(value)}" for key, value in self.values.items())

    @property
    def name(self) -> str:
        """As in E=2_method=penalty-3f2a...: the varied keys, as far as a file name holds them, and the id."""
        words = "_".join(f"{key.split('.')[-1]}={_in_a_name(value)}" for key, value in self.values.items())
        return f"{words[:LONGEST].lstrip('.-')}-{self.id}"

    @property
    def problem(self) -> str:
        """What is asked for, however it is solved: cases with equal problems have one answer."""
        asked = {key: value for key, value in self.values.items() if not _is_discrete(key)}
        physics = self.scene.physics
        surface = {"gap": physics.gap, "friction": physics.contact.friction, "adhesion": str(physics.contact.adhesion)}
        return inline(asked | surface | {"depth": self.depth, "control": physics.path.control})

    @property
    def depth(self) -> float:
        """The last depth, to expect where forces are prescribed, in the user's units."""
        return self.scene.physics.deltas[-1] * self.scene.physics.scales.depth

    @property
    def stiffness(self) -> float | None:
        """epsilon_n or gamma in E*/h_contact; None for a method without one."""
        law = self.scene.physics.contact
        return law.stiffness / stiffness_unit(self.scene) if hasattr(law, "stiffness") else None


@dataclass(frozen=True)
class Refusal:
    """A point that the program refuses before anything is run, and why: a row of a study with a tolerance."""

    index: int
    values: dict[str, Any]
    error: ConfigError


def of(study: StudyFile) -> list[Case]:
    """Every case of a study, in the order of its table. ConfigError when any of them cannot be run."""
    cases, refusals = sorted_out(study)
    if refusals:
        told = list({str(refusal.error): refusal.error for refusal in refusals}.values())[:MOST_TOLD]
        raise ConfigErrors(told) if len(told) > 1 else told[0]
    return cases


def sorted_out(study: StudyFile) -> tuple[list[Case], list[Refusal]]:
    """The cases of a study that can be run, and the points that cannot."""
    build = _Builder(study)
    cases: list[Case] = []
    refusals: list[Refusal] = []
    for index, point in enumerate(study.points()):
        try:
            cases.append(build(index, point))
        except ConfigError as error:
            refusals.append(Refusal(index, {key: value for key, value, _ in point}, error))
    return cases, refusals


def short(value: Any) -> str:
    """A value as it is read, not to its last digit."""
    return f"{value:.4g}" if isinstance(value, float) else inline(value)


def _in_a_name(value: Any) -> str:
    """A value as the name of a file may hold it."""
    return re.sub(r"[^A-Za-z0-9=.+-]+", "_", short(value)).strip("_")


def identity(scene: Scene) -> str:
    """A name for the physics, discretisation and experiment of a scene; titles and output have no part in it."""
    parts: tuple[Any, ...] = (scene.physics, scene.sizes, scene.solver, scene.plan.fineness)
    if scene.experiment is not None:
        parts = (*parts, scene.experiment)
    return hashlib.sha256(to_json(parts, indent=None).encode()).hexdigest()[:16]


def stiffness_unit(scene: Scene) -> float:
    """E*/h_contact in the scene's own units."""
    return scene.physics.material.E_star / scene.sizes.h_contact


class _Builder:
    """Makes cases; remembers the unit of stiffness of each body and mesh."""

    def __init__(self, study: StudyFile):
        self.study = study
        self._units: dict[str, float] = {}

    def __call__(self, index: int, point: Point) -> Case:
        if any(isinstance(value, Multiple) for _, value, _ in point):
            unit = self._unit(point)
            point = tuple((key, _times(value, unit), place) for key, value, place in point)
        config = self._config(point)
        scene = _resolved(config, point)
        return Case(index, {key: value for key, value, _ in point}, config, scene, identity(scene))

    def _config(self, point: Point) -> Config:
        return varied(self.study.base, self.study.source, (*self.study.common, *point))

    def _unit(self, point: Point) -> float:
        """E*/h_contact of the scene at a point, in the user's units."""
        others = tuple(setting for setting in point if setting[0].split(".")[0] != "contact")
        name = inline([[key, value] for key, value, _ in others])
        if name not in self._units:
            auto: Setting = ("contact", {"method": "auto"}, ("", None))
            scene = _resolved(self._config((*others, auto)), point)
            self._units[name] = stiffness_unit(scene) * scene.physics.scales.stiffness
        return self._units[name]


def _times(value: Any, unit: float) -> Any:
    return float(f"{value.factor * unit:.15g}") if isinstance(value, Multiple) else value


def _resolved(config: Config, point: Point) -> Scene:
    """The scene of a point; an error about a section says which value varied there, and where that stands."""
    try:
        return resolve(config)
    except ConfigError as error:
        section = error.key.split(".")[0]
        for key, value, (file, line) in point:
            if key.split(".")[0] == section:
                told = f"{error.problem} (with {key}={short(value)})"
                raise dataclasses.replace(error, problem=told, file=file, line=line) from None
        raise located(config, error) from None


def _is_discrete(key: str) -> bool:
    section = key.split(".")[0]
    return section in DISCRETE or key in ("accuracy", "material.formulation", "loading.steps")


def unique(cases: Iterable[Case]) -> list[Case]:
    """The cases that have to be run: the first of every id."""
    return list({case.id: case for case in reversed(list(cases))}.values())[::-1]


def sharded(cases: list[Case], shard: tuple[int, int] | None) -> list[Case]:
    """Every n-th case from the i-th on."""
    return cases if shard is None else cases[shard[0] - 1 :: shard[1]]
