"""STUDY.yaml -> StudyFile: which scene, which keys are varied over which values, what the forces
are compared with.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.config.messages import closest
from indent_sim.config.scene_file import OF_A_STUDY, Place, plain, read_document
from indent_sim.config.schema import Source, keys_at, outside
from indent_sim.config.strict_yaml import MAX_DEPTH, KeyPath, key_path, key_text
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError
from indent_sim.studies.points import LARGEST_RANGE_END, MOST_RUNS, Block, Point, points, read_block
from indent_sim.studies.reference.published import Exact, Published, read_exact, read_published

Document = dict[str, Any]  # as YAML says it
KEYS = ("title", "base", "set", "vary", "cases", "compare_to", "tolerance", "output")
UNNAMED = "study"  # what stands for the file of a study that has none
OF_A_CASE = ("name", "scene", "set", "published", "exact")
CASE = "case"  # column of the names of cases, where a study has them instead of varied keys
SCENE = {
    "body",
    "material",
    "indenter",
    "contact",
    "loading",
    "mesh",
    "solver",
    "accuracy",
}  # of a scene alone
QUIET = {
    "fields": "none",
    "surface": "none",
    "plot": False,
}  # what runs of a study write unless told otherwise


@dataclass(frozen=True)
class Member:
    """A case of a study's `cases`: a scene of its own, and what is published of it; `place`: where
    it stands.
    """

    name: str
    base: Document
    source: Source
    point: Point
    published: Published | None
    exact: Exact | None
    place: Place


@dataclass(frozen=True)
class Wanted:
    """A run that a study asks for: the scene's document, where its keys stand, and the settings
    that change it.

    named: what the table calls it; None where its settings do.
    """

    base: Document
    source: Source
    point: Point
    named: dict[str, Any] | None = None


@dataclass(frozen=True)
class StudyFile:
    """A study as its file says it; nothing of it is tried on the scene yet.

    base: the scene's document, and `source` where each of its keys stands; common: settings of
    every run; compare_to: "theory", "finest", a force, or the path of a result; tolerance: of the
    force, for a verdict on every row and with rows for what the program refuses to run (None: no
    verdicts, and everything must be runnable).
    """

    path: Path
    title: str
    base: Document
    source: Source
    common: Point
    blocks: tuple[Block, ...]
    compare_to: str | float | Path
    compare_place: Place
    tolerance: float | None
    directory: Path
    members: tuple[Member, ...] = ()  # instead of base and blocks

    @property
    def keys(self) -> tuple[str, ...]:
        """Every varied key once, in the order of the file."""
        return (
            (CASE,)
            if self.members
            else tuple(dict.fromkeys(key for block in self.blocks for key in block.keys))
        )

    def wanted(self) -> list[Wanted]:
        """The runs in the order of study.csv."""
        grid = [Wanted(self.base, self.source, point) for point in self.points()]
        return grid + [
            Wanted(one.base, one.source, one.point, {CASE: one.name}) for one in self.members
        ]

    def points(self) -> list[Point]:
        """The grid in the order of study.csv: the last key of a block varies fastest, block after
        block.
        """
        return [point for block in self.blocks for point in points(block)]


def read(given: Path | str | Mapping[str, Any]) -> StudyFile:
    """The study of a file, or of mappings shaped like one, whose paths count from the working
    directory.

    UsageError when it cannot be read, ConfigError for anything wrong in it.
    """
    path = Path(UNNAMED) if isinstance(given, Mapping) else Path(given)
    document, source = (
        (plain(given), Source()) if isinstance(given, Mapping) else read_document(path)
    )
    if not (OF_A_STUDY | {"cases"}) & document.keys() and set(document) & SCENE:
        problem = "this is a scene, not a study"
        remedy = f"indent-sim run {path}"
        raise ConfigError(
            "", problem, remedy, *source.place((next(key for key in document if key in SCENE),))
        )
    if unknown := [key for key in document if key not in KEYS]:
        raise ConfigErrors.of([_unknown(key, source) for key in unknown])
    reader = _StudyReader(path, document, source)
    if "cases" in document:
        return reader.of_cases()
    base, where = reader.base()
    if not isinstance(title := document.get("title", ""), str):
        raise reader.error(("title",), "must be a text")
    title = title or str(base.get("title") or path.stem)
    runs = (reader.common(), reader.blocks())
    compared = (reader.compared(), reader.place(("compare_to",)))
    return StudyFile(
        path, title, base, where, *runs, *compared, reader.tolerance(), reader.directory()
    )


def _unknown(key: str, source: Source) -> ConfigError:
    match = closest(key, KEYS)
    problem = f"unknown key, did you mean '{match}'?" if match else "unknown key"
    remedy = (
        "it belongs in the base scene, or in set"
        if key in keys_at((), {})
        else f"valid here: {', '.join(KEYS)}"
    )
    file, line = source.place((key,))
    return ConfigError(key, problem, "" if match else remedy, file, line)


class _StudyReader:
    """Reads the keys of one study document; its errors know their lines."""

    def __init__(self, path: Path, document: Document, source: Source):
        self.path = path
        self.document = document
        self.source = source
        self.place = source.place

    def error(self, keys: KeyPath, problem: str, remedy: str = "") -> ConfigError:
        return ConfigError(key_text(keys), problem, remedy, *self.place(keys))

    def base(self) -> tuple[Document, Source]:
        """The scene's document and where its keys stand, in a file of its own or written out here."""
        return self.scene(self.document.get("base"), ("base",))

    def scene(self, given: Any, at: KeyPath) -> tuple[Document, Source]:
        """A scene given as the path of its file, or written out."""
        if isinstance(given, str) and given:
            return self.scene_of(self.path.parent / given, at)
        if not isinstance(given, dict):
            problem = "missing" if given is None else "is no scene"
            raise self.error(at, problem, "give the path of a scene file, or the scene itself")
        size = len(at)
        inside = {
            keys[size:]: place for keys, place in self.source.places.items() if keys[:size] == at
        }
        return given, Source(self.source.name, inside)

    def scene_of(self, path: Path, at: KeyPath) -> tuple[Document, Source]:
        """The document of another file; of one that is no scene nothing is told, for studies come
        from strangers.
        """
        no_scene = self.error(
            at, f"{path} is no scene file", "give the path of a scene, or the scene itself"
        )
        try:
            if path.suffix not in (".yaml", ".yml", ".json") or (
                path.exists() and not path.is_file()
            ):
                raise no_scene
            document, source = read_document(path)
        except (UsageError, OSError, ValueError) as error:
            raise self.error(at, str(error)) from None
        except ConfigError as error:
            raise dataclasses.replace(error, key="") from None
        if not isinstance(document.get("body"), dict):
            raise no_scene
        return document, source

    def of_cases(self) -> StudyFile:
        """The study of `cases`, each a scene of its own."""
        for key in ("base", "vary", "compare_to", "tolerance"):
            if key in self.document:
                raise self.error(
                    (key,),
                    "does not go with cases",
                    "a case has its scene, set, published and exact",
                )
        given = self.document["cases"]
        if not isinstance(given, list) or not given:
            raise self.error(
                ("cases",), "must be a list of cases", f"each has {', '.join(OF_A_CASE)}"
            )
        if len(given) > MOST_RUNS:
            raise self.error(("cases",), f"more than {MOST_RUNS} runs")
        members = tuple(self.member(one, ("cases", index)) for index, one in enumerate(given))
        self.check_names(members)
        title = self.document.get("title", "") or self.path.stem
        if not isinstance(title, str):
            raise self.error(("title",), "must be a text")
        compared = ("finest", self.place(("cases",)))
        return StudyFile(
            self.path, title, {}, self.source, (), (), *compared, None, self.directory(), members
        )

    def member(self, given: Any, at: KeyPath) -> Member:
        """One of the cases."""
        if not isinstance(given, dict):
            raise self.error(at, "must be a section of keys", f"it has {', '.join(OF_A_CASE)}")
        if unknown := [key for key in given if key not in OF_A_CASE]:
            match = closest(unknown[0], OF_A_CASE)
            problem = f"unknown key, did you mean '{match}'?" if match else "unknown key"
            raise self.error(
                (*at, unknown[0]), problem, "" if match else f"valid here: {', '.join(OF_A_CASE)}"
            )
        if not isinstance(name := given.get("name"), str) or not name.strip():
            raise self.error((*at, "name"), "must be a text", "what the table calls the case")
        base, source = self.scene(given.get("scene"), (*at, "scene"))
        point = (*self.common(), *self.settings_of(given.get("set", {}), (*at, "set")))
        try:
            published = (
                read_published(given["published"], (*at, "published"))
                if "published" in given
                else None
            )
            exact = read_exact(given["exact"], (*at, "exact")) if "exact" in given else None
        except ConfigError as error:
            raise self.error(key_path(error.key), error.problem, error.remedy) from None
        if exact and not published:
            raise self.error(
                (*at, "exact"), "belongs to a published value", "add published, or leave it out"
            )
        return Member(name, base, source, point, published, exact, self.place((*at, "published")))

    def settings_of(self, given: Any, at: KeyPath) -> Point:
        """The settings of a case, which stand over those of all."""
        if not isinstance(given, dict):
            raise self.error(at, "must be a section of keys")
        for key in given:
            self.check_key((*at, key), key)
        return tuple((key, value, self.place((*at, key))) for key, value in given.items())

    def check_names(self, members: tuple[Member, ...]) -> None:
        """Names once, and those of cases that hold exact values known."""
        names = tuple(member.name for member in members)
        for index, member in enumerate(members):
            if member.name in names[:index]:
                raise self.error(
                    ("cases", index, "name"), f"{member.name} is there twice", "give each its own"
                )
            if member.exact and member.exact.case and member.exact.case not in names:
                near = closest(member.exact.case, names)
                hint = f"did you mean '{near}'?" if near else "give the name of a case"
                raise self.error(("cases", index, "exact", "case"), "there is no such case", hint)
        self.check_circles(members)

    def check_circles(self, members: tuple[Member, ...]) -> None:
        """ConfigError for a case whose exact value is its own, or comes back to it by way of
        others.
        """
        exact = {
            member.name: member.exact.case
            for member in members
            if member.exact and member.exact.case
        }
        for index, member in enumerate(members):
            way = [member.name]
            while (following := exact.get(way[-1])) and following not in way:
                way.append(following)
            if following == member.name:
                told = " by ".join([*way, member.name])
                problem = f"is known by itself: {told}" if len(way) > 1 else "names its own case"
                remedy = "an exact value is that of a second method"
                raise self.error(("cases", index, "exact", "case"), problem, remedy)

    def common(self) -> Point:
        """The settings of every run: the study's quiet output, then `output`, then `set`."""
        output = self.section("output")
        here = self.place(("output",))
        quiet = {f"output.{key}": (value, here) for key, value in QUIET.items()}
        named = {
            f"output.{k}": (v, self.place(("output", k)))
            for k, v in output.items()
            if k != "directory"
        }
        chosen = {
            key: (value, self.place(("set", key))) for key, value in self.section("set").items()
        }
        for key in chosen:
            self.check_key(("set", key), key)
        self.check_apart(list(chosen), ("set",))
        return tuple(
            (key, value, place) for key, (value, place) in (quiet | named | chosen).items()
        )

    def section(self, key: str) -> Document:
        value = self.document.get(key, {})
        if not isinstance(value, dict):
            raise self.error((key,), "must be a section of keys")
        return value

    def blocks(self) -> tuple[Block, ...]:
        """The grids of `vary`: one, or a list of them that follow one another."""
        vary = self.document.get("vary")
        if not vary:
            raise self.error(
                ("vary",),
                "says nothing to vary",
                "give keys and values, e.g. material.nu: [0.2, 0.3]",
            )
        listed = isinstance(vary, list)
        parts = list(enumerate(vary)) if isinstance(vary, list) else [(0, vary)]
        blocks = []
        for index, part in parts:
            keys: KeyPath = ("vary", index) if listed else ("vary",)
            if not isinstance(part, dict) or not set(part) - {"zip"}:
                raise self.error(keys, "must be keys and values, e.g. material.nu: [0.2, 0.3]")
            varied = [key for key in part if key != "zip"]
            for key in varied:
                self.check_key((*keys, key), key)
            self.check_apart(varied, keys)
            blocks.append(read_block(part, keys, self.source))
            if sum(block.size for block in blocks) > MOST_RUNS:
                raise self.error(keys, f"more than {MOST_RUNS} runs")
        return tuple(blocks)

    def check_apart(self, given: list[str], keys: KeyPath) -> None:
        """No section beside a key inside it, here or in `set`: one of the two would be lost."""
        written = {key: ("set", key) for key in self.section("set")} | {
            key: (*keys, key) for key in given
        }
        for whole in given:
            for part in [key for key in written if key.startswith(f"{whole}.")]:
                problem = f"contradicts {whole}, which is given as a whole"
                raise self.error(written[part], problem, "give one of the two")

    def check_key(self, keys: KeyPath, key: str) -> None:
        if not key or key != key_text(key_path(key)) or len(key_path(key)) > MAX_DEPTH:
            raise self.error(keys, "is no key", "write it with dots, e.g. mesh.h_far")
        if key.split(".")[0] in ("title", "units", "output"):
            raise self.error(
                keys,
                "does not change the physics",
                f"a study has one {key.split('.')[0]} of its own",
            )

    def compared(self) -> str | float | Path:
        """What the forces are compared with ["finest"]."""
        wanted = self.document.get("compare_to", "finest")
        if type(wanted) in (int, float) and 0 < abs(wanted) <= LARGEST_RANGE_END:
            return float(wanted)
        if isinstance(wanted, str) and wanted in ("theory", "finest"):
            return wanted
        if (
            isinstance(wanted, str) and wanted and os.path.exists(self.path.parent / wanted)
        ):  # whatever the name
            return self.path.parent / wanted
        problem = f"is neither theory nor finest, nor a force, nor a result: {wanted!r}"
        raise self.error(("compare_to",), problem, "a path counts from the study's folder")

    def tolerance(self) -> float | None:
        """The relative error of the force that is still right; None without."""
        wanted = self.document.get("tolerance")
        if wanted is None:
            return None
        if isinstance(wanted, bool) or not isinstance(wanted, (int, float)) or not 0 < wanted < 1:
            raise self.error(
                ("tolerance",), "must be a number between 0 and 1", "0.01 is 1 % of the force"
            )
        return float(wanted)

    def directory(self) -> Path:
        """Where the study goes [results/<stem of the file>], relative to the working directory."""
        directory = self.section("output").get("directory", f"results/{self.path.stem}")
        if not isinstance(directory, str) or not directory:
            raise self.error(("output", "directory"), "must be the path of a folder")
        if problem := outside(directory):
            raise self.error(
                ("output", "directory"), problem, "choose any other folder with --output"
            )
        return Path(directory)
