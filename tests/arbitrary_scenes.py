"""Scenes and studies with arbitrary values, and the checks of a command that gets one."""

from __future__ import annotations

import copy
import dataclasses
import os
import signal
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from indent_sim.cli import commands
from indent_sim.config import schema
from indent_sim.config.key_types import field_types, types_by_tag
from indent_sim.config.strict_yaml import dump, parse
from indent_sim.studies import study_file as study_file

ROOT = Path(__file__).resolve().parents[1]
FUZZ = settings(deadline=None, database=None, suppress_health_check=list(HealthCheck))
BRIEF = settings(FUZZ, derandomize=True)
SCENES = [
    parse(path.read_text("utf-8"))[0] for path in sorted((ROOT / "configs").glob("**/*.yaml"))
]
STUDIES = [document | {"base": SCENES[0]} for document in SCENES if "vary" in document]
SCENES = [document for document in SCENES if "body" in document]
POWERS = (st.integers(-17, 17) | st.integers(-3, 3) | st.integers(-323, 308)).map(
    lambda n: float(f"1e{n}")
)
EDGES = st.sampled_from(
    [
        0,
        -0.0,
        1,
        -1,
        2,
        64,
        90,
        89.9999999,
        0.5,
        0.49,
        0.4999999999,
        -0.999999,
        1 / 3,
        10**80,
        5e-324,
        1.7976931348623157e308,
    ]
)
NUMBERS = st.one_of(
    EDGES,
    POWERS,
    POWERS.map(lambda x: -x),
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(1e-3, 1e3),
)
WORDS = st.sampled_from(
    ["auto", "none", "all", "free", "roller", "fixed", "newton", "", "Ä ß 漢字 🙂", "a" * 10_000]
)
LISTS = st.lists(NUMBERS, max_size=5) | st.integers(0, 20_000).map(lambda n: [0.01] * n)
FITTING = st.sampled_from(
    [[[0, 0], [1, 0.5]], [2.0, 2.0, 1.0], [1.0], [1.0, 0.5], "roller", "auto", 0.3, "mixed"]
)
MAPPINGS = st.dictionaries(st.text(max_size=4), NUMBERS, max_size=2)
VALUES = st.one_of(
    NUMBERS,
    NUMBERS,
    NUMBERS,
    WORDS,
    LISTS,
    st.lists(LISTS, max_size=4),
    st.none(),
    st.booleans(),
    st.text(max_size=8),
    MAPPINGS,
)
SPACINGS = {"spacing": st.sampled_from(["log", 3]), "unit": st.just("E*/h_contact")}
ENDS = st.fixed_dictionaries(
    {"from": NUMBERS, "to": NUMBERS, "count": st.integers(-1, 5) | NUMBERS}, optional=SPACINGS
)
SOME = st.floats(1e-3, 1.0)
PIECE = {
    "thickness": SOME,
    "shape": st.sampled_from(["ball", "cylinder", "box"]),
    "radius": SOME,
    "height": SOME,
    "center": st.tuples(st.sampled_from([0.0, 1.0]), st.just(0.0), st.floats(-1.0, 0.0)).map(list),
    "size": st.lists(SOME, min_size=3, max_size=3),
    "material": st.sampled_from(
        [{"model": "linear_elastic", "E": 2, "nu": 0.3}, {"model": "gent"}]
    ),
}
KEPT = st.fixed_dictionaries({key: PIECE[key] for key in ("shape", "center", "radius", "material")})
PIECES = (
    KEPT
    | st.fixed_dictionaries({}, optional={key: values | VALUES for key, values in PIECE.items()})
    | VALUES
)
LENGTHS = (
    "R",
    "radius",
    "height",
    "width",
    "delta",
    "h_contact",
    "h_far",
    "edge_radius",
    "tip_radius",
)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fail within a block that takes longer."""

    def late(number: int, frame: Any) -> None:
        raise AssertionError(f"still at it after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def numbers_in(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of all numbers of a document."""
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers_in(part, (*path, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


def get(document: Any, path: tuple) -> Any:
    """Value at a path."""
    for key in path:
        document = document[key]
    return document


def put(document: Any, path: tuple, value: Any) -> None:
    """Replace the value at a path."""
    get(document, path[:-1])[path[-1]] = value


def number(draw: Any, document: dict[str, Any]) -> None:
    """Replace a number by one of any size, or shift it by powers of ten."""
    if paths := sorted(numbers_in(document), key=str):
        path = draw(st.sampled_from(paths))
        put(
            document,
            path,
            get(document, path) * draw(POWERS) if draw(st.booleans()) else draw(NUMBERS),
        )


def key(draw: Any, document: dict[str, Any]) -> None:
    """Put any value under an allowed key."""
    name = draw(st.sampled_from(sorted(schema.sections())))
    here = document.setdefault(name, {})
    keys = schema.allowed_keys_at((name,), document)
    if isinstance(here, dict) and keys:
        here[draw(st.sampled_from(keys))] = draw(VALUES)


def kind(draw: Any, document: dict[str, Any]) -> None:
    """Replace a section by another kind with its required keys and some of its optional ones."""
    name, tag = draw(st.sampled_from(sorted(schema.section_tags().items())))
    kinds = types_by_tag(field_types(schema.Config)[name], tag)
    chosen = draw(st.sampled_from(sorted(kinds)))
    document[name] = {}
    for field in dataclasses.fields(kinds[chosen]):
        if field.default is dataclasses.MISSING or draw(st.integers(0, 3)) == 0:
            document[name][field.name] = draw(
                st.one_of(st.floats(1e-3, 1e3), POWERS, FITTING, VALUES)
            )
    document[name][tag] = chosen


def pieces(draw: Any, document: dict[str, Any]) -> None:
    """Put in layers or inclusions, valid ones or with any value under their keys."""
    if isinstance(body := document.setdefault("body", {}), dict):
        body[draw(st.sampled_from(["layers", "inclusions"]))] = draw(
            st.lists(PIECES, max_size=4) | VALUES
        )


def section(draw: Any, document: dict[str, Any]) -> None:
    """Replace a section by that of another scene, or remove it."""
    other = draw(st.sampled_from(SCENES))
    name = draw(st.sampled_from(sorted(set(other) | set(document))))
    if name in other:
        document[name] = copy.deepcopy(other[name])
    else:
        document.pop(name, None)


def units(draw: Any, document: dict[str, Any]) -> None:
    """Multiply all lengths by a power of ten."""
    factor = draw(POWERS)
    for path in list(numbers_in(document)):
        if path[-1] in LENGTHS:
            put(document, path, get(document, path) * factor)


@st.composite
def scenes(draw: Any) -> dict[str, Any]:
    """A shipped scene with one to four changes."""
    document = copy.deepcopy(draw(st.sampled_from(SCENES)))
    changes = st.sampled_from([number, number, key, kind, pieces, section, units])
    for change in draw(st.lists(changes, min_size=1, max_size=4)):
        change(draw, document)
    return document


@st.composite
def studies(draw: Any) -> dict[str, Any]:
    """A shipped study with one to three changes."""
    document = copy.deepcopy(draw(st.sampled_from(STUDIES)))
    for _ in range(draw(st.integers(1, 3))):
        place = draw(
            st.sampled_from(["vary", "vary", "set", "compare_to", "base", "output", "number"])
        )
        if place == "number":
            number(draw, document)
        elif place == "vary":
            names = st.sampled_from(
                ["material.nu", "indenter.R", "mesh.order", "contact.epsilon_n", "zip", "contact"]
            )
            document["vary"] = draw(
                st.dictionaries(names, ENDS | st.lists(VALUES, max_size=3) | VALUES, max_size=3)
            )
        else:
            document[place] = draw(VALUES)
    return document


def ended(
    verb: str, document: dict[str, Any], *words: str, codes: tuple[int, ...], wait: float
) -> Result:
    """Run a command in an empty folder and assert how it ends.

    The exit code is one of `codes`, an exit code other than 0 comes with a message, nothing looks
    like a bug, and no file is left behind that the command may not leave.
    """
    with tempfile.TemporaryDirectory() as place, within(wait), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # arithmetic gone wrong
        scene = Path(place, "scene.yaml")
        scene.write_text(dump(document), encoding="utf-8", errors="surrogatepass")
        done = CliRunner().invoke(commands.program, [verb, str(scene), *words])
        left = set(os.listdir(place)) - {"scene.yaml"}
    assert done.exit_code in codes and "Traceback" not in done.stderr, done.stderr
    assert done.stderr or done.exit_code == 0
    assert left <= ({"out"} if verb == "run" and done.exit_code != 3 else set()), left
    return done
