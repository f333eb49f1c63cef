"""Study files (YAML): base scene, varied keys with their values, reference of the forces."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.config.messages import closest_match
from indent_sim.config.path_checks import directory_problem
from indent_sim.config.scene_file import (
    STUDY_SECTIONS,
    SourceLocation,
    plain_document,
    read_document,
)
from indent_sim.config.scene_sections import Source
from indent_sim.config.schema import allowed_keys_at
from indent_sim.config.strict_yaml import MAX_DEPTH, KeyPath, key_path, key_text
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError
from indent_sim.studies.condition import (
    MAX_CONDITIONS,
    Condition,
    ConditionError,
    parse_condition,
)
from indent_sim.studies.parameter_points import (
    LARGEST_RANGE_END,
    MAX_RUNS,
    ParameterBlock,
    grid_points,
    read_block,
)
from indent_sim.studies.parameter_values import ParameterPoint
from indent_sim.studies.reference.published import (
    ExactValue,
    PublishedValue,
    read_exact,
    read_published,
)
from indent_sim.studies.sample import Sample, read_sample
from indent_sim.studies.scene_numbers import SceneNumbers

# YAML document as parsed.
Document = dict[str, Any]
STUDY_KEYS = (
    "title",
    "base",
    "set",
    "vary",
    "sample",
    "where",
    "cases",
    "compare_to",
    "tolerance",
    "output",
)
# Runs that get a result folder; "auto" means all runs of a study of up to MAX_AUTO_FOLDERS runs.
RUN_FOLDERS = ("auto", "all", "failed", "none")
MAX_AUTO_FOLDERS = 1000
# Largest number of runs with a folder each.
MAX_FOLDERS = 100_000
CASE_KEYS = ("name", "scene", "set", "published", "exact")
# Column of the names of cases, in a study without varied keys.
CASE_COLUMN = "case"


@dataclass(frozen=True)
class NamedCase:
    """Entry of a study's `cases`: a scene, optionally with a published and an exact value.

    Attributes
    ----------
    name
        Name of the case in the table.
    base, source
        Document of the scene, and file and line of each of its keys.
    point
        Settings that change the scene.
    published, exact
        The published and the exact value.
    published_location
        File and line of `published`, for error messages.
    """

    name: str
    base: Document
    source: Source
    point: ParameterPoint
    published: PublishedValue | None
    exact: ExactValue | None
    published_location: SourceLocation


@dataclass(frozen=True)
class RunRequest:
    """Requested run of a study: a scene document and the settings that change it.

    Attributes
    ----------
    base, source
        Document of the scene, and file and line of each of its keys.
    point
        Settings that change the scene.
    labels
        Texts that identify the run in the table; None if the settings identify the run.
    """

    base: Document
    source: Source
    point: ParameterPoint
    labels: dict[str, Any] | None = None


@dataclass(frozen=True)
class StudyFile:
    """Content of a study file, before any setting is applied to the scene.

    Attributes
    ----------
    path, title
        File and title of the study.
    base, source
        Document of the scene, and file and line of each of its keys.
    common_settings
        Settings of every run.
    blocks
        Grids of the varied keys, which are run in sequence.
    compare_to, compare_to_location
        Reference of the forces: "theory", "finest", a force, or the path of a result; file and line
        of this key.
    tolerance
        Relative error of the force up to which a row is "right". With a tolerance every row has a
        verdict, and invalid scenes are rows; without a tolerance (None) all scenes must be valid.
    directory
        Folder of the study.
    named_cases
        Cases with their own scenes, instead of `base` and `blocks`.
    run_folders
        The runs that get a result folder: one of RUN_FOLDERS.
    conditions
        Conditions that every point must fulfil; other points are left out.
    """

    path: Path
    title: str
    base: Document
    source: Source
    common_settings: ParameterPoint
    blocks: tuple[ParameterBlock, ...]
    compare_to: str | float | Path
    compare_to_location: SourceLocation
    tolerance: float | None
    directory: Path
    named_cases: tuple[NamedCase, ...] = ()
    run_folders: str = "auto"
    conditions: tuple[Condition, ...] = ()

    @property
    def point_count(self) -> int:
        """Number of points, including those that the conditions leave out."""
        return sum(block.size for block in self.blocks) + len(self.named_cases)

    @property
    def keeps_all_runs(self) -> bool:
        """True if every run has a result folder; otherwise a row without a folder is sufficient."""
        if self.run_folders != "auto":
            return self.run_folders == "all"
        needs_results = self.is_compared or bool(self.named_cases)
        return needs_results or self.point_count <= MAX_AUTO_FOLDERS

    @property
    def is_compared(self) -> bool:
        """True if the study itself requests a comparison of its forces."""
        return self.compare_to != "finest" or self.tolerance is not None

    @property
    def keys(self) -> tuple[str, ...]:
        """Varied keys in the order of the file, without repetitions."""
        if self.named_cases:
            return (CASE_COLUMN,)
        return tuple(dict.fromkeys(key for block in self.blocks for key in block.keys))

    def run_requests(self) -> list[RunRequest]:
        """Return the runs in the order of study.csv."""
        return list(self.iterate_requests())

    def iterate_requests(self) -> Iterator[RunRequest]:
        """Yield the runs in the order of study.csv."""
        for point in self.iterate_points():
            yield RunRequest(self.base, self.source, point)
        for named_case in self.named_cases:
            labels = {CASE_COLUMN: named_case.name}
            yield RunRequest(named_case.base, named_case.source, named_case.point, labels)

    def grid_points(self) -> list[ParameterPoint]:
        """Return the points of all blocks; within a block the last key varies fastest."""
        return list(self.iterate_points())

    def iterate_points(self) -> Iterator[ParameterPoint]:
        """Yield the points of all blocks that fulfil the conditions."""
        numbers = SceneNumbers(self.base, self.source, self.common_settings)
        for point in itertools.chain.from_iterable(map(grid_points, self.blocks)):
            if all(numbers.fulfil(condition, point) for condition in self.conditions):
                yield point

    def left_out_count(self) -> int:
        """Return the number of points that the conditions leave out."""
        if not self.conditions:
            return 0
        return self.point_count - sum(1 for _ in self.iterate_points())


def read(study_input: Path | str | Mapping[str, Any]) -> StudyFile:
    """Read a study from a file, or from a dictionary with the same structure.

    Parameters
    ----------
    study_input
        Path of the study file, or the study as a dictionary; paths in a dictionary are relative to
        the working directory.

    Raises
    ------
    UsageError
        The file cannot be read.
    ConfigError
        The study has an error; the message has file and line.
    """
    if isinstance(study_input, Mapping):
        # Name in place of the path of a study that is given as a dictionary.
        path = Path("study")
        document = plain_document(study_input)
        source = Source()
    else:
        path = Path(study_input)
        document, source = read_document(path)
    # These keys occur in a scene but not in a study.
    scene_keys = {
        "body",
        "material",
        "indenter",
        "contact",
        "loading",
        "mesh",
        "solver",
        "accuracy",
    }
    if not (STUDY_SECTIONS | {"cases"}) & document.keys() and set(document) & scene_keys:
        problem = "this is a scene, not a study"
        remedy = f"indent-sim run {path}"
        raise ConfigError(
            "",
            problem,
            remedy,
            *source.location((next(key for key in document if key in scene_keys),)),
        )
    if unknown := [key for key in document if key not in STUDY_KEYS]:
        raise ConfigErrors.combine([_unknown_key_error(key, source) for key in unknown])
    reader = _StudyReader(path, document, source)
    if "cases" in document:
        return reader.read_named_cases()
    base, key_locations = reader.read_base()
    if not isinstance(title := document.get("title", ""), str):
        raise reader.config_error(("title",), "must be a text")
    title = title or str(base.get("title") or path.stem)
    settings_and_blocks = (reader.read_common_settings(), reader.read_blocks())
    reference = (reader.read_compare_to(), reader.location(("compare_to",)))
    study = StudyFile(
        path,
        title,
        base,
        key_locations,
        *settings_and_blocks,
        *reference,
        reader.read_tolerance(),
        reader.read_directory(),
        run_folders=reader.read_run_folders(),
        conditions=reader.read_conditions(),
    )
    reader.check_run_folders(study)
    if study.conditions and next(study.iterate_points(), None) is None:
        raise reader.config_error(("where",), "leaves out all points of the study")
    return study


def _unknown_key_error(key: str, source: Source) -> ConfigError:
    """Return the ConfigError for an unknown key of a study."""
    match = closest_match(key, STUDY_KEYS)
    problem = f"unknown key, did you mean '{match}'?" if match else "unknown key"
    remedy = (
        "it belongs in the base scene, or in the section `set`"
        if key in allowed_keys_at((), {})
        else f"valid here: {', '.join(STUDY_KEYS)}"
    )
    file, line = source.location((key,))
    return ConfigError(key, problem, "" if match else remedy, file, line)


class _StudyReader:
    """Reader of the keys of one study document, with file and line in errors."""

    def __init__(self, path: Path, document: Document, source: Source):
        self.path = path
        self.document = document
        self.source = source
        self.location = source.location

    def config_error(self, keys: KeyPath, problem: str, remedy: str = "") -> ConfigError:
        """Return the ConfigError for a key, with its file and line."""
        return ConfigError(key_text(keys), problem, remedy, *self.location(keys))

    def read_base(self) -> tuple[Document, Source]:
        """Return the document of the base scene and the location of each of its keys."""
        return self.read_scene(self.document.get("base"), ("base",))

    def read_scene(self, raw_scene: Any, section_keys: KeyPath) -> tuple[Document, Source]:
        """Return a scene that is given as a path or written out in the study."""
        if isinstance(raw_scene, str) and raw_scene:
            return self.read_scene_file(self.path.parent / raw_scene, section_keys)
        if not isinstance(raw_scene, dict):
            problem = "missing" if raw_scene is None else "is not a scene"
            raise self.config_error(
                section_keys, problem, "give the path of a scene file, or the scene itself"
            )
        prefix_length = len(section_keys)
        inner_places = {
            keys[prefix_length:]: location
            for keys, location in self.source.locations.items()
            if keys[:prefix_length] == section_keys
        }
        return raw_scene, Source(self.source.name, inner_places)

    def read_scene_file(self, path: Path, section_keys: KeyPath) -> tuple[Document, Source]:
        """Return the document of a scene file.

        If the file is not a scene, the error does not show its content, because an untrusted study
        could name any file of this machine.
        """
        no_scene = self.config_error(
            section_keys,
            f"{path} is not a scene file",
            "give the path of a scene, or the scene itself",
        )
        try:
            if path.suffix not in (".yaml", ".yml", ".json") or (
                path.exists() and not path.is_file()
            ):
                raise no_scene
            document, source = read_document(path)
        except (UsageError, OSError, ValueError) as error:
            raise self.config_error(section_keys, str(error)) from None
        except ConfigError as error:
            raise dataclasses.replace(error, key="") from None
        if not isinstance(document.get("body"), dict):
            raise no_scene
        return document, source

    def read_named_cases(self) -> StudyFile:
        """Return a study of `cases`, each of which has its own scene."""
        for key in ("base", "vary", "sample", "where", "compare_to", "tolerance"):
            if key in self.document:
                raise self.config_error(
                    (key,),
                    "cannot be combined with `cases`",
                    "each case has its own scene, set, published and exact",
                )
        raw_cases = self.document["cases"]
        if not isinstance(raw_cases, list) or not raw_cases:
            raise self.config_error(
                ("cases",),
                "must be a list of cases",
                f"the keys of a case are {', '.join(CASE_KEYS)}",
            )
        if len(raw_cases) > MAX_FOLDERS:
            raise self.config_error(("cases",), f"more than {MAX_FOLDERS} runs")
        named_cases = tuple(
            self.read_named_case(raw_case, ("cases", index))
            for index, raw_case in enumerate(raw_cases)
        )
        self.check_names(named_cases)
        title = self.document.get("title", "") or self.path.stem
        if not isinstance(title, str):
            raise self.config_error(("title",), "must be a text")
        reference = ("finest", self.location(("cases",)))
        return StudyFile(
            self.path,
            title,
            {},
            self.source,
            (),
            (),
            *reference,
            None,
            self.read_directory(),
            named_cases,
        )

    def read_named_case(self, raw_case: Any, case_keys: KeyPath) -> NamedCase:
        """Read one entry of `cases`; raise ConfigError if it is not a section with known keys."""
        if not isinstance(raw_case, dict):
            raise self.config_error(
                case_keys,
                "must be a mapping of keys to values",
                f"its keys are {', '.join(CASE_KEYS)}",
            )
        if unknown := [key for key in raw_case if key not in CASE_KEYS]:
            match = closest_match(unknown[0], CASE_KEYS)
            problem = f"unknown key, did you mean '{match}'?" if match else "unknown key"
            raise self.config_error(
                (*case_keys, unknown[0]),
                problem,
                "" if match else f"valid here: {', '.join(CASE_KEYS)}",
            )
        if not isinstance(name := raw_case.get("name"), str) or not name.strip():
            raise self.config_error(
                (*case_keys, "name"), "must be a text", "it identifies the case in the table"
            )
        base, source = self.read_scene(raw_case.get("scene"), (*case_keys, "scene"))
        point = (
            *self.read_common_settings(),
            *self.read_settings(raw_case.get("set", {}), (*case_keys, "set")),
        )
        try:
            published = (
                read_published(raw_case["published"], (*case_keys, "published"))
                if "published" in raw_case
                else None
            )
            exact = (
                read_exact(raw_case["exact"], (*case_keys, "exact"))
                if "exact" in raw_case
                else None
            )
        except ConfigError as error:
            raise self.config_error(key_path(error.key), error.problem, error.remedy) from None
        if exact and not published:
            raise self.config_error(
                (*case_keys, "exact"),
                "is allowed only with a published value",
                "add `published`, or leave this key out",
            )
        return NamedCase(
            name, base, source, point, published, exact, self.location((*case_keys, "published"))
        )

    def read_settings(self, raw_settings: Any, section_keys: KeyPath) -> ParameterPoint:
        """Return the settings of a case, which override the common settings."""
        if not isinstance(raw_settings, dict):
            raise self.config_error(section_keys, "must be a mapping of keys to values")
        for key in raw_settings:
            self.check_key((*section_keys, key), key)
        return tuple(
            (key, value, self.location((*section_keys, key))) for key, value in raw_settings.items()
        )

    def check_names(self, named_cases: tuple[NamedCase, ...]) -> None:
        """Raise ConfigError if a name is used twice or an exact value refers to an unknown case."""
        names = tuple(named_case.name for named_case in named_cases)
        for index, named_case in enumerate(named_cases):
            if named_case.name in names[:index]:
                raise self.config_error(
                    ("cases", index, "name"),
                    f"two cases have the name {named_case.name}",
                    "give each case its own name",
                )
            if named_case.exact and named_case.exact.case and named_case.exact.case not in names:
                closest_name = closest_match(named_case.exact.case, names)
                hint = (
                    f"did you mean '{closest_name}'?" if closest_name else "give the name of a case"
                )
                raise self.config_error(
                    ("cases", index, "exact", "case"), "there is no case of this name", hint
                )
        self.check_circular_references(named_cases)

    def check_circular_references(self, named_cases: tuple[NamedCase, ...]) -> None:
        """Raise ConfigError if the exact value of a case depends on the case itself."""
        exact = {
            named_case.name: named_case.exact.case
            for named_case in named_cases
            if named_case.exact and named_case.exact.case
        }
        for index, named_case in enumerate(named_cases):
            chain = [named_case.name]
            while (next_name := exact.get(chain[-1])) and next_name not in chain:
                chain.append(next_name)
            if next_name == named_case.name:
                chain_text = " -> ".join([*chain, named_case.name])
                problem = (
                    f"circular reference: {chain_text}"
                    if len(chain) > 1
                    else "refers to its own case"
                )
                remedy = "an exact value must be obtained by a second, independent method"
                raise self.config_error(("cases", index, "exact", "case"), problem, remedy)

    def read_common_settings(self) -> ParameterPoint:
        """Return the settings of every run: the default output, then `output`, then `set`."""
        output = self.read_section("output")
        output_location = self.location(("output",))
        # Runs of a study write little output unless the study asks for more.
        quiet_output = {
            "fields": "none",
            "surface": "none",
            "plot": False,
        }
        quiet = {f"output.{key}": (value, output_location) for key, value in quiet_output.items()}
        output_settings = {
            f"output.{key}": (value, self.location(("output", key)))
            for key, value in output.items()
            if key not in ("directory", "runs")
        }
        set_settings = {
            key: (value, self.location(("set", key)))
            for key, value in self.read_section("set").items()
        }
        for key in set_settings:
            self.check_key(("set", key), key)
        self.check_overlaps(list(set_settings), ("set",))
        return tuple(
            (key, value, location)
            for key, (value, location) in (quiet | output_settings | set_settings).items()
        )

    def read_section(self, key: str) -> Document:
        """Return a section of the study; {} if it is not given."""
        value = self.document.get(key, {})
        if not isinstance(value, dict):
            raise self.config_error((key,), "must be a mapping of keys to values")
        return value

    def read_blocks(self) -> tuple[ParameterBlock, ...]:
        """Return the grids of `vary`: one grid, or a list of grids that are run in sequence."""
        vary = self.document.get("vary")
        if not vary:
            raise self.config_error(
                ("vary",),
                "has no key to vary",
                "give keys and values, e.g. material.nu: [0.2, 0.3]",
            )
        is_list = isinstance(vary, list)
        parts = list(enumerate(vary)) if isinstance(vary, list) else [(0, vary)]
        blocks = []
        sample = self.read_sample()
        for index, part in parts:
            keys: KeyPath = ("vary", index) if is_list else ("vary",)
            if not isinstance(part, dict) or not set(part) - {"zip"}:
                raise self.config_error(
                    keys, "must be a mapping of keys to values, e.g. material.nu: [0.2, 0.3]"
                )
            varied_keys = [key for key in part if key != "zip"]
            for key in varied_keys:
                self.check_key((*keys, key), key)
            self.check_overlaps(varied_keys, keys)
            blocks.append(read_block(part, keys, self.source, sample))
            if sum(block.size for block in blocks) > MAX_RUNS:
                raise self.config_error(keys, f"more than {MAX_RUNS} runs")
        if sample and not any(block.sample for block in blocks):
            raise self.config_error(
                ("vary",),
                "a sample needs at least one range; there is none",
                "give ranges {from, to, spacing}, or leave out `sample`",
            )
        return tuple(blocks)

    def read_sample(self) -> Sample | None:
        """Return the sample of the study without its ranges; None if the study is not sampled."""
        if "sample" not in self.document:
            return None
        return read_sample(self.read_section("sample"), self.source)

    def read_conditions(self) -> tuple[Condition, ...]:
        """Return the conditions of `where`: one text, or a list of texts."""
        given = self.document.get("where", [])
        texts = [given] if isinstance(given, str) else given
        if not isinstance(texts, list) or len(texts) > MAX_CONDITIONS:
            raise self.config_error(
                ("where",), f"must be a text, or a list of at most {MAX_CONDITIONS} texts"
            )
        conditions = []
        for index, text in enumerate(texts):
            keys: KeyPath = ("where", index) if isinstance(given, list) else ("where",)
            example = 'for example "indenter.R < body.height"'
            if not isinstance(text, str):
                raise self.config_error(keys, "must be a text", example)
            try:
                conditions.append(parse_condition(text))
            except ConditionError as error:
                raise self.config_error(keys, str(error), example) from None
        return tuple(conditions)

    def read_run_folders(self) -> str:
        """Return the runs that get a result folder, one of RUN_FOLDERS."""
        folders = self.read_section("output").get("runs", "auto")
        if folders not in RUN_FOLDERS:
            raise self.config_error(("output", "runs"), f"must be one of {', '.join(RUN_FOLDERS)}")
        return str(folders)

    def check_run_folders(self, study: StudyFile) -> None:
        """Raise ConfigError if a study without result folders requests something that needs one."""
        if study.keeps_all_runs:
            if study.point_count > MAX_FOLDERS:
                raise self.config_error(
                    ("output", "runs"),
                    f"{study.point_count} runs cannot have a folder each: {MAX_FOLDERS} can",
                    "write output.runs: failed or none, and leave out compare_to and tolerance",
                )
            return
        needs_results = [key for key in ("compare_to", "tolerance") if key in self.document]
        if needs_results:
            raise self.config_error(
                (needs_results[0],), "needs the results of all runs", "set output.runs: all"
            )

    def check_overlaps(self, given_keys: list[str], keys: KeyPath) -> None:
        """Raise ConfigError if a section and a key inside it are both set."""
        paths = {key: ("set", key) for key in self.read_section("set")} | {
            key: (*keys, key) for key in given_keys
        }
        for section_key in given_keys:
            for inner_key in [key for key in paths if key.startswith(f"{section_key}.")]:
                problem = f"contradicts {section_key}, which is set as a whole section"
                raise self.config_error(paths[inner_key], problem, "give only one of the two")

    def check_key(self, keys: KeyPath, key: str) -> None:
        """Raise ConfigError if a text is not a scene key that a study may set."""
        if not key or key != key_text(key_path(key)) or len(key_path(key)) > MAX_DEPTH:
            raise self.config_error(keys, "is not a key", "write it with dots, e.g. mesh.h_far")
        if key.split(".")[0] in ("title", "units", "output"):
            raise self.config_error(
                keys,
                "does not change the physics",
                f"set the study's own {key.split('.')[0]} at the top level of its file",
            )

    def read_compare_to(self) -> str | float | Path:
        """Return the reference with which the forces are compared; by default "finest"."""
        compare_to = self.document.get("compare_to", "finest")
        if type(compare_to) in (int, float) and 0 < abs(compare_to) <= LARGEST_RANGE_END:
            return float(compare_to)
        if isinstance(compare_to, str) and compare_to in ("theory", "finest"):
            return compare_to
        if (
            isinstance(compare_to, str)
            and compare_to
            and os.path.exists(self.path.parent / compare_to)
        ):
            return self.path.parent / compare_to
        problem = f"is not 'theory', 'finest', a force or the path of a result: {compare_to!r}"
        raise self.config_error(
            ("compare_to",), problem, "a path is relative to the folder of the study file"
        )

    def read_tolerance(self) -> float | None:
        """Return the tolerance, the largest relative force error of a "right" row; may be None."""
        tolerance = self.document.get("tolerance")
        if tolerance is None:
            return None
        if (
            isinstance(tolerance, bool)
            or not isinstance(tolerance, (int, float))
            or not 0 < tolerance < 1
        ):
            raise self.config_error(
                ("tolerance",), "must be a number between 0 and 1", "0.01 is 1 % of the force"
            )
        return float(tolerance)

    def read_directory(self) -> Path:
        """Return the study's folder as a relative path; by default results/<stem of the file>."""
        directory = self.read_section("output").get("directory", f"results/{self.path.stem}")
        if not isinstance(directory, str) or not directory:
            raise self.config_error(("output", "directory"), "must be the path of a folder")
        if problem := directory_problem(directory):
            raise self.config_error(
                ("output", "directory"), problem, "choose any other folder with --output"
            )
        return Path(directory)
