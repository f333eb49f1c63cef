"""Cases of a study, whose configs are checked and resolved before the first run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Any

from indent_sim.config.scene_file import (
    Quantities,
    config_with_settings,
    locate_error,
    quantities_of,
)
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import KeyPath, inline_yaml, key_path, short_yaml
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.run.planned_run import PlannedRun
from indent_sim.studies.parameter_values import ParameterPoint, Setting, StiffnessMultiple
from indent_sim.studies.study_file import RunRequest, StudyFile


@dataclass(frozen=True)
class Case:
    """Case of a study: one run and one row of its table.

    Attributes
    ----------
    index
        Index in the study, from 0.
    values
        The varied keys and their values.
    planned_run
        The resolved scene and its predicted cost.
    id
        Hash of the physics and the method. Cases with the same id are run once.
    """

    index: int
    values: dict[str, Any]
    planned_run: PlannedRun
    id: str

    @property
    def label(self) -> str:
        """Varied keys and their values as text."""
        return ", ".join(f"{key}={short_yaml(value)}" for key, value in self.values.items())

    @cached_property
    def table_values(self) -> dict[str, Any]:
        """Varied keys for the table, with quantities as numbers in the scene's units."""
        quantities = self.planned_run.config.source.quantities
        return {
            key: _convert_to_scene_units(value, key_path(key), quantities)
            for key, value in self.values.items()
        }

    @cached_property
    def name(self) -> str:
        """Name of the run's folder with varied keys and id, such as E=2_method=penalty-3f2a..."""
        value_texts = {
            key: re.sub(r"[^A-Za-z0-9=.+-]+", "_", short_yaml(value))
            for key, value in self.values.items()
        }
        text = "_".join(
            f"{key.split('.')[-1]}={word.strip('_')}" for key, word in value_texts.items()
        )
        # A file name may have 255 bytes; 80 letters of text leave enough space for the id.
        return f"{text[:80].lstrip('.-')}-{self.id}"

    @property
    def problem_key(self) -> str:
        """Text that identifies the mechanical problem, independent of method and mesh.

        Cases with the same problem have the same exact solution and may be compared.
        """
        # These sections and keys choose how a problem is solved; all others belong to the problem
        # itself.
        method_sections = ("mesh", "contact", "solver")
        method_keys = ("accuracy", "material.formulation", "loading.steps")
        names = (
            key
            for key in self.values
            if key.split(".")[0] not in method_sections and key not in method_keys
        )
        varied_values = {key: self.values[key] for key in names}
        physics = self.planned_run.scene.physics
        contact_values = {
            "gap": physics.gap,
            "friction": physics.contact.friction,
            "adhesion": str(physics.contact.adhesion),
        }
        return inline_yaml(
            varied_values
            | contact_values
            | {"depth": self.last_depth, "control": physics.path.control}
        )

    @property
    def last_depth(self) -> float:
        """The last depth (predicted if forces are prescribed), in the user's units."""
        return self.planned_run.depths[-1]


def _convert_to_scene_units(value: Any, path: KeyPath, quantities: Quantities) -> Any:
    """Return a value of a document with its quantities as numbers in the scene's units."""
    if path in quantities:
        return quantities[path][1]
    if isinstance(value, Mapping):
        return {
            key: _convert_to_scene_units(part, (*path, key), quantities)
            for key, part in value.items()
        }
    if isinstance(value, list):
        return [
            _convert_to_scene_units(part, (*path, index), quantities)
            for index, part in enumerate(value)
        ]
    return value


@dataclass(frozen=True)
class RejectedCase:
    """Point of a study that is not a valid scene; in a study with a tolerance a failed row.

    Attributes
    ----------
    index
        Index in the study, from 0.
    point
        The settings of the varied keys.
    labels
        Texts that identify the run instead of its settings, or None.
    error
        The error of the scene.
    quantities
        Quantities with a unit among the values; empty if one of these quantities is invalid.
    """

    index: int
    point: ParameterPoint
    labels: dict[str, Any] | None
    error: ConfigError
    quantities: Quantities = field(default_factory=dict)

    @property
    def table_values(self) -> dict[str, Any]:
        """Varied keys for the table, with quantities as numbers in the scene's units."""
        return {
            key: _convert_to_scene_units(value, key_path(key), self.quantities)
            for key, value in self.values.items()
        }

    @property
    def values(self) -> dict[str, Any]:
        """Varied keys and their values."""
        return {key: value for key, value, _ in self.point}

    @property
    def located_error(self) -> ConfigError:
        """Error of the scene, with the name of the run if file and line do not identify it."""
        labels_text = ", ".join(
            f"{key} {short_yaml(value)}" for key, value in (self.labels or self.values).items()
        )
        known_locations = [] if self.labels else [location for *_, location in self.point]
        errors = [
            error
            if (error.file, error.line) in known_locations
            else replace(error, problem=f"{error.problem} (in the run of {labels_text})")
            for error in self.error.errors
        ]
        return ConfigErrors.combine(errors)


def resolve_cases(study: StudyFile) -> tuple[list[Case], list[RejectedCase]]:
    """Return the cases of a study and its rejected cases.

    Raises
    ------
    ConfigError
        If a scene is invalid and the study has no tolerance.
    """
    cases, rejected_cases = validate_cases(study)
    if rejected_cases and study.tolerance is None:
        rejected_by_error: dict[str, list[RejectedCase]] = {}
        for rejected_case in rejected_cases:
            rejected_by_error.setdefault(str(rejected_case.error), []).append(rejected_case)
        case_count = len(cases) + len(rejected_cases)
        # Largest number of errors that are reported; more would hide the first ones on
        # the screen.
        max_reported_errors = 20
        # An error that all runs have belongs to the base scene; its message need not name a run.
        errors = [
            same_error_cases[0].error
            if len(same_error_cases) == case_count
            else same_error_cases[0].located_error
            for same_error_cases in rejected_by_error.values()
        ][:max_reported_errors]
        if cases and not study.named_cases:
            errors[-1] = _add_tolerance_hint(errors[-1], len(rejected_cases), case_count)
        raise ConfigErrors.combine(errors)
    return cases, rejected_cases


def _add_tolerance_hint(error: ConfigError, rejected_count: int, case_count: int) -> ConfigError:
    """Add a hint to the last error: in a study with a tolerance, invalid scenes are failed rows."""
    *other_errors, last_error = error.errors
    hint = (
        f"{rejected_count} of {case_count} runs are invalid: with `tolerance` in the study they "
        "are failed rows of its table"
    )
    remedy = f"{last_error.remedy}; {hint}" if last_error.remedy else hint
    return ConfigErrors.combine([*other_errors, replace(last_error, remedy=remedy)])


def validate_cases(
    study: StudyFile, limit: int | None = None
) -> tuple[list[Case], list[RejectedCase]]:
    """Return the valid cases of a study, or of its first `limit` points, and its rejected cases."""
    build_case = CaseBuilder(study.common_settings)
    cases: list[Case] = []
    rejected_cases: list[RejectedCase] = []
    for index, request in enumerate(islice(study.iterate_requests(), limit)):
        try:
            cases.append(build_case(index, request))
        except ConfigError as error:
            rejected_cases.append(
                RejectedCase(
                    index, request.point, request.labels, error, build_case.quantities(request)
                )
            )
    return cases, rejected_cases


class CaseBuilder:
    """Builder of cases; it caches the stiffness E*/h_contact of each body and mesh."""

    def __init__(self, common_settings: ParameterPoint):
        self._common_settings = common_settings
        self._stiffness_units: dict[str, float] = {}

    def __call__(self, index: int, request: RunRequest) -> Case:
        """Return the case of a requested run; raise ConfigError if its scene is invalid."""
        point = tuple(
            (key, self._resolve_multiple(value, request), location)
            for key, value, location in request.point
        )
        config = self._config(request, point)
        planned_run = _plan_run(config, point)
        labels = request.labels or {key: value for key, value, _ in point}
        return Case(index, labels, planned_run, planned_run.identity)

    def quantities(self, request: RunRequest) -> Quantities:
        """Return the quantities of a request in its scene's units; {} if a quantity is invalid."""
        try:
            return quantities_of(request.base, (*self._common_settings, *request.point))
        except ConfigError:
            return {}

    def _resolve_multiple(self, value: object, request: RunRequest) -> object:
        """Return a value, with a multiple of E*/h_contact converted to the user's units."""
        if isinstance(value, StiffnessMultiple):
            return float(f"{value.factor * self._stiffness_unit(request):.15g}")
        return value

    def _config(self, request: RunRequest, point: ParameterPoint) -> Config:
        """Return the config of a requested run with the settings of a point."""
        return config_with_settings(request.base, request.source, (*self._common_settings, *point))

    def _stiffness_unit(self, request: RunRequest) -> float:
        """Return E*/h_contact of a requested scene in the user's units."""
        other_settings = tuple(
            setting for setting in request.point if setting[0].split(".")[0] != "contact"
        )
        name = inline_yaml([[key, value] for key, value, _ in other_settings])
        if name not in self._stiffness_units:
            auto_contact: Setting = ("contact", {"method": "auto"}, ("", None))
            self._stiffness_units[name] = _plan_run(
                self._config(request, (*other_settings, auto_contact)), request.point
            ).stiffness_unit
        return self._stiffness_units[name]


def _plan_run(config: Config, point: ParameterPoint) -> PlannedRun:
    """Return the planned run of a config; its errors name the varied value that caused them."""
    try:
        return PlannedRun.resolve(config)
    except ConfigError as error:
        section = error.key.split(".")[0]
        for key, value, (file, line) in point:
            if key.split(".")[0] == section:
                problem = f"{error.problem} (with {key}={short_yaml(value)})"
                raise replace(error, problem=problem, file=file, line=line) from None
        raise locate_error(config, error) from None


def unique_cases(cases: Iterable[Case]) -> list[Case]:
    """Return the cases to run: the first case of every id."""
    return list({case.id: case for case in reversed(list(cases))}.values())[::-1]
