"""Points of the grid -> Cases: every config checked and resolved, and its physics given a name,
before any run.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from indent_sim.config.scene_file import Quantities, located, quantities_of, varied
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import KeyPath, inline, key_path, short
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.run.planned_run import PlannedRun
from indent_sim.studies.points import Multiple, Point, Setting
from indent_sim.studies.study_file import StudyFile, Wanted

DISCRETE = (
    "mesh",
    "contact",
    "solver",
)  # sections that choose how a scene is solved, not which scene it is
MOST_TOLD = 20  # errors of one study
HOW = ("accuracy", "material.formulation", "loading.steps")  # keys that do


@dataclass(frozen=True)
class Case:
    """One run of a study: a row of its table. `id` names the physics: equal ids are one run.

    `name`, of its folder, says what varies before that.
    """

    index: int
    values: dict[str, Any]
    prospect: PlannedRun
    id: str

    @property
    def words(self) -> str:
        """The varied keys in words."""
        return ", ".join(f"{key}={short(value)}" for key, value in self.values.items())

    @cached_property
    def numbers(self) -> dict[str, Any]:
        """The varied keys as a table has them: a quantity with a unit as a number in the scene's
        units.
        """
        quantities = self.prospect.config.source.quantities
        return {
            key: _in_scene_units(value, key_path(key), quantities)
            for key, value in self.values.items()
        }

    @cached_property
    def name(self) -> str:
        """As in E=2_method=penalty-3f2a...: the varied keys, as far as a file name holds them, and
        the id.
        """
        said = {
            key: re.sub(r"[^A-Za-z0-9=.+-]+", "_", short(value))
            for key, value in self.values.items()
        }
        words = "_".join(f"{key.split('.')[-1]}={word.strip('_')}" for key, word in said.items())
        return f"{words[:80].lstrip('.-')}-{self.id}"  # letters

    @property
    def problem(self) -> str:
        """What is asked for, however it is solved: cases with equal problems have one answer."""
        names = (key for key in self.values if key.split(".")[0] not in DISCRETE and key not in HOW)
        asked = {key: self.values[key] for key in names}
        physics = self.prospect.scene.physics
        surface = {
            "gap": physics.gap,
            "friction": physics.contact.friction,
            "adhesion": str(physics.contact.adhesion),
        }
        return inline(asked | surface | {"depth": self.depth, "control": physics.path.control})

    @property
    def depth(self) -> float:
        """The last depth, to expect where forces are prescribed, in the user's units."""
        return self.prospect.depths[-1]


def _in_scene_units(value: Any, path: KeyPath, quantities: Quantities) -> Any:
    """A value of a document with every quantity in it as the number that it stands for in the
    scene.
    """
    if path in quantities:
        return quantities[path][1]
    if isinstance(value, Mapping):
        return {key: _in_scene_units(part, (*path, key), quantities) for key, part in value.items()}
    if isinstance(value, list):
        return [
            _in_scene_units(part, (*path, index), quantities) for index, part in enumerate(value)
        ]
    return value


@dataclass(frozen=True)
class Refusal:
    """A point that the program refuses before anything is run, and why: a row of a study with a
    tolerance.
    """

    index: int
    point: Point
    named: dict[str, Any] | None
    error: ConfigError
    quantities: Quantities = field(default_factory=dict)

    @property
    def numbers(self) -> dict[str, Any]:
        """The varied keys as a table has them: a quantity with a unit as a number in the scene's
        units.
        """
        return {
            key: _in_scene_units(value, key_path(key), self.quantities)
            for key, value in self.values.items()
        }

    @property
    def values(self) -> dict[str, Any]:
        """The varied keys."""
        return {key: value for key, value, _ in self.point}

    @property
    def told(self) -> ConfigError:
        """The error, and of which run it is where the place that it names does not say."""
        words = ", ".join(
            f"{key} {short(value)}" for key, value in (self.named or self.values).items()
        )
        known = [] if self.named else [place for *_, place in self.point]
        said = [
            one
            if (one.file, one.line) in known
            else replace(one, problem=f"{one.problem} (in the run of {words})")
            for one in self.error.errors
        ]
        return ConfigErrors.of(said)


def asked_for(study: StudyFile) -> tuple[list[Case], list[Refusal]]:
    """The cases of a study, and with a tolerance those refused; without, ConfigError when any
    cannot be run.
    """
    cases, refusals = sorted_out(study)
    if refusals and study.tolerance is None:
        told: dict[str, list[Refusal]] = {}
        for refusal in refusals:
            told.setdefault(str(refusal.error), []).append(refusal)
        of_all = len(cases) + len(
            refusals
        )  # what is wrong with every run is wrong with what they share
        errors = [one[0].error if len(one) == of_all else one[0].told for one in told.values()][
            :MOST_TOLD
        ]
        if cases and not study.members:
            errors[-1] = _with_a_way_out(errors[-1], len(refusals), of_all)
        raise ConfigErrors.of(errors)
    return cases, refusals


def _with_a_way_out(error: ConfigError, refused: int, of_all: int) -> ConfigError:
    """The last of the errors of a study, some of whose runs are possible: what lets it go on
    without the others.
    """
    *others, last = error.errors
    way = (
        f"{refused} of {of_all} runs cannot be: with `tolerance` in the study they are "
        "rows that failed"
    )
    remedy = f"{last.remedy}; {way}" if last.remedy else way
    return ConfigErrors.of([*others, replace(last, remedy=remedy)])


def sorted_out(study: StudyFile) -> tuple[list[Case], list[Refusal]]:
    """The cases of a study that can be run, and the points that cannot."""
    build = _Builder(study.common)
    cases: list[Case] = []
    refusals: list[Refusal] = []
    for index, wanted in enumerate(study.wanted()):
        try:
            cases.append(build(index, wanted))
        except ConfigError as error:
            refusals.append(
                Refusal(index, wanted.point, wanted.named, error, build.quantities(wanted))
            )
    return cases, refusals


class _Builder:
    """Makes cases; remembers the unit of stiffness of each body and mesh."""

    def __init__(self, common: Point):
        self._common = common
        self._units: dict[str, float] = {}

    def __call__(self, index: int, wanted: Wanted) -> Case:
        point = tuple(
            (key, self._number(value, wanted), place) for key, value, place in wanted.point
        )
        config = self._config(wanted, point)
        prospect = _prospect(config, point)
        named = wanted.named or {key: value for key, value, _ in point}
        return Case(index, named, prospect, prospect.identity)

    def quantities(self, wanted: Wanted) -> Quantities:
        """What the quantities of a point are in its scene's units; none where one is no quantity."""
        try:
            return quantities_of(wanted.base, (*self._common, *wanted.point))
        except ConfigError:
            return {}

    def _number(self, value: object, wanted: Wanted) -> object:
        """A value at a point, a multiple of E*/h_contact in the user's units."""
        return (
            float(f"{value.factor * self._unit(wanted):.15g}")
            if isinstance(value, Multiple)
            else value
        )

    def _config(self, wanted: Wanted, point: Point) -> Config:
        return varied(wanted.base, wanted.source, (*self._common, *point))

    def _unit(self, wanted: Wanted) -> float:
        """E*/h_contact of the scene at a point, in the user's units."""
        others = tuple(setting for setting in wanted.point if setting[0].split(".")[0] != "contact")
        name = inline([[key, value] for key, value, _ in others])
        if name not in self._units:
            auto: Setting = ("contact", {"method": "auto"}, ("", None))
            self._units[name] = _prospect(
                self._config(wanted, (*others, auto)), wanted.point
            ).stiffness_unit
        return self._units[name]


def _prospect(config: Config, point: Point) -> PlannedRun:
    """The prospect of a point; an error about a section says which value varied there, and where
    that stands.
    """
    try:
        return PlannedRun.resolve(config)
    except ConfigError as error:
        section = error.key.split(".")[0]
        for key, value, (file, line) in point:
            if key.split(".")[0] == section:
                told = f"{error.problem} (with {key}={short(value)})"
                raise replace(error, problem=told, file=file, line=line) from None
        raise located(config, error) from None


def unique(cases: Iterable[Case]) -> list[Case]:
    """The cases that have to be run: the first of every id."""
    return list({case.id: case for case in reversed(list(cases))}.values())[::-1]
