"""Any text given as a scene is a valid Config, or ends in a ConfigError.

A valid Config survives writing and reading.
"""

from __future__ import annotations

import copy
import math
import random
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from indent_sim.config import schema
from indent_sim.config.scene_file import config_from_mapping, load, loads, to_mapping, to_yaml
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import dump, parse
from indent_sim.process.errors import ConfigError, UsageError, printable
from indent_sim.scene.scene import resolve
from indent_sim.studies import study_file as study_file

BRIEF = settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)

SCENE = """\
title: fuzz
body: {shape: box, size: [1.0, 2.0, 1.5], sides: {x_min: roller}}
material: {model: linear_elastic, E: 1e-6, nu: 0.3}
indenter: {shape: cone, half_angle: 70, center: [0.5, 1.0]}
contact: {method: penalty, epsilon_n: auto}
loading: {deltas: [0.1, -0.1]}
solver: {rtol: 1e-10}
"""

WORDS = sorted(
    {
        name
        for kinds in schema.sections().values()
        for kind in kinds
        for name in schema.file_order(kind)
    }
    | {
        "center",
        "auto",
        "free",
        "cylinder",
        "penalty",
        "sphere",
        "on",
        ".nan",
        "1e-6",
        "~",
        "*a",
        "&a",
        "!!a",
    }
)
SIGNS = [*": \n-[]{},#'\"|>%@\t?", "\n  ", ": ", "- ", "0", "-1", "---\n", "\x00", "\ud800"]
PIECES = st.sampled_from([*WORDS, *SIGNS])
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(WORDS),
)
VALUES = st.recursive(
    SCALARS,
    lambda v: st.lists(v, max_size=3) | st.dictionaries(st.sampled_from(WORDS), v, max_size=3),
)
POSITIVE = st.floats(1e-7, 1e7)  # lengths of one scene: their ratios are limited
SIDES = st.floats(1e-2, 1e2)
LENGTHS = POSITIVE | POSITIVE.map(lambda x: -x) | st.sampled_from([0.0, -0.0])
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def outcome(text: str, overrides: tuple[str, ...] = ()) -> None:
    """Assert that a text is a config that round-trips, or a ConfigError with a message."""
    try:
        config = loads(text, "scene.yaml", overrides)
    except ConfigError as error:
        assert error.exit_code == 3 and error.problem and str(error)
    else:
        same(config)


def same(config: Config) -> None:
    """Assert that writing and reading changes nothing."""
    assert loads(to_yaml(config)) == config
    assert config_from_mapping(to_mapping(config)) == config


@BRIEF
@given(st.text())
def test_any_text(text):
    outcome(text)


@BRIEF
@given(st.lists(PIECES, max_size=40))
def test_text_of_yaml_pieces(pieces):
    outcome("".join(pieces))


@BRIEF
@given(st.binary(max_size=60), st.integers(0, len(SCENE)))
def test_any_bytes_inside_a_scene(tmp_path, junk, at):
    path = tmp_path / "scene.yaml"
    path.write_bytes(SCENE[:at].encode() + junk + SCENE[at:].encode())
    try:
        same(load(path))
    except ConfigError as error:
        assert error.file == str(path)


@BRIEF
@given(st.integers(0, len(SCENE)), st.integers(0, 12), st.lists(PIECES, max_size=4))
def test_a_scene_with_a_hole_filled(start, length, pieces):
    outcome(SCENE[:start] + "".join(pieces) + SCENE[start + length :])


@BRIEF
@given(st.data(), VALUES)
def test_a_scene_with_one_other_value(data, value):
    document = parse(SCENE)[0]
    section = data.draw(st.sampled_from(sorted(document)))
    keys = schema.allowed_keys_at((section,), document)
    if keys and data.draw(st.booleans()):
        document[section][data.draw(st.sampled_from(keys))] = value
    else:
        document[section] = value
    try:
        same(config_from_mapping(document))
    except ConfigError as error:
        assert error.problem


@BRIEF
@given(
    st.sampled_from(["body.sides", "loading", "title", "contact", ""]), st.lists(PIECES, max_size=6)
)
def test_any_override(key, pieces):
    outcome(SCENE, (f"{key}={''.join(pieces)}",))


@BRIEF
@given(st.recursive(st.text() | FINITE | st.integers(-(10**30), 10**30) | st.booleans(), st.lists))
def test_what_is_dumped_is_parsed(value):
    text = dump({"section": {"key": value}, "other": value})
    try:
        found = parse(text)[0]
    except ConfigError as error:
        assert "no file can have" in str(error)
    else:
        assert found == {"section": {"key": value}, "other": value}


@BRIEF
@given(st.tuples(SIDES, SIDES, SIDES), st.lists(LENGTHS, min_size=1, max_size=5), FINITE, FINITE)
def test_numbers_come_back_to_the_last_digit(size, deltas, x, y):
    document: dict[str, Any] = parse(SCENE)[0]
    document["body"]["size"], document["indenter"]["center"] = list(size), [x, y]
    document["loading"] = {"deltas": deltas}
    config = loads(to_yaml(config_from_mapping(document)))
    assert (
        config.body.size == size
        and config.loading.deltas == tuple(deltas)
        and config.center == (x, y)
    )
    assert [math.copysign(1, found) for found in config.center] == [
        math.copysign(1, x),
        math.copysign(1, y),
    ]


# ---- documents with several mistakes

SCENES: list[dict[str, Any]] = [
    parse(SCENE)[0],
    parse("""\
units: {length: um, force: nN}
body: {shape: cylinder, radius: 3, height: 1,
       layers: [{thickness: 0.4, material: {model: neo_hookean, E: 2, nu: 0.4}}, {thickness: 0.6}],
       inclusions: [{shape: ball, center: [0, 0, -0.7], radius: 0.1,
       material: {model: linear_elastic, E: 1, nu: 0.2}}]}
material: {model: linear_elastic, E: 1 kPa, nu: 0.3}
indenter: {shape: sphere, R: 2.5 um}
contact: {method: active_set, friction: 0.2}
loading: {forces: [0.001, 0.002]}
mesh: {h_contact: 0.05, h_far: 0.4}
""")[0],
    parse("""\
body: {shape: half_space}
material: {model: linear_elastic, E: 1, nu: 0.5, relaxation: {prony: [[0.3, 1]]}}
indenter: {shape: flat_punch, radius: 1}
loading: {history: [[0, 0], [1, 0.1], [2, 0.1]], times: [0.5, 2]}
experiment: {cantilever: {stiffness: 5}, frequencies: [1]}
accuracy: 0.01
""")[0],
]
NUMBERS = [
    0,
    -0.0,
    -1,
    1,
    0.5,
    1e-320,
    1e308,
    -1e308,
    10**30,
    10**399,
    5e-324,
    3.0000000000000004,
    2**53 + 1,
]
TEXTS = [
    "",
    " ",
    "\u221e",
    "\uff11\uff12",
    "1 kg",
    "2,5 mm",
    "1e400 um",
    "-3 um",
    "0 nN",
    "auto",
    "Auto",
    "a" * 5000,
    "\u202e1",
    "caf\u00e9",
    "cafe\u0301",
    "\U0001f642",
    "1e-6",
    ".nan",
    "0x1F",
    "1_000",
    "[",
    "{",
    "\x85",
    "~",
    "on",
]
PARTS = [
    "body",
    "material",
    "E",
    "layers",
    "[0]",
    "[1]",
    "[99999999999]",
    "a",
    "\u00e9",
    "vary",
    "loading",
    "deltas",
]
Path_ = tuple[Any, ...]


def places(value: Any, path: Path_ = ()) -> list[Path_]:
    """Paths of all parts of a document but the whole."""
    parts = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [place for key, part in parts for place in ((*path, key), *places(part, (*path, key)))]


def junk(rng: random.Random, depth: int = 0) -> Any:
    """A value that belongs hardly anywhere."""
    kind = rng.randrange(8 if depth < 3 else 4)
    if kind < 4:
        return rng.choice([NUMBERS, TEXTS, WORDS, [None, True, False]][kind])
    if kind < 6:
        count = rng.choice([0, 1, 2, 3, 1000 if depth == 0 else 4])
        # A thousand lists of lists are 1e7 places, most of a minute for `places`.
        below = depth + 1 if count < 1000 else 3
        return [junk(rng, below) for _ in range(count)]
    if kind == 6:
        return {rng.choice(WORDS + TEXTS): junk(rng, depth + 1) for _ in range(rng.randrange(4))}
    return deep(rng.choice([5, 19, 21, 150]))


def deep(levels: int) -> Any:
    """A nested list of so many levels."""
    return [deep(levels - 1)] if levels else 1


def misspelt(rng: random.Random, word: Any) -> Any:
    """A word with one letter too few, too many, or of the other case."""
    if not isinstance(word, str) or not word:
        return word
    at = rng.randrange(len(word))
    return rng.choice(
        [word[:at] + word[at + 1 :], word[:at] + word[at] + word[at:], word.swapcase(), f"{word} "]
    )


def mutated(rng: random.Random, document: Any) -> Any:
    """A document with a change in one place."""
    *above, last = rng.choice(places(document))
    section = document
    for part in above:
        section = section[part]
    kind = rng.randrange(6)
    if kind < 2:
        section[last] = junk(rng)
    elif kind == 2:
        section[last] = misspelt(rng, section[last])
    elif kind == 3 and isinstance(section, dict):
        section[misspelt(rng, last)] = section.pop(last)
    elif kind == 4:
        del section[last]
    elif isinstance(section, dict):
        section[rng.choice([*WORDS, *TEXTS, *SCENES[1]])] = junk(rng)
    else:
        filling, copies = junk(rng), rng.choice([1, 50])
        is_small = len(places(document)) < 2000 and len(places([filling])) < 200
        section += [filling] * (copies if is_small else 1)  # 50 of 50 of 50 would fill the memory
    return document


def override(rng: random.Random) -> str:
    """Random words for --set."""
    parts = rng.choices(PARTS, k=rng.choice([1, 2, 3, 4, 21, 5000]))
    key = rng.choice(
        [
            ".".join(parts).replace(".[", "["),
            *map(".".join, [("mesh", "h_far"), ("material", "nu")]),
        ]
    )
    return f"{key}{rng.choice(['=', '=', '=', ''])}{dump({'x': junk(rng)})[3:].strip()}"


def how_it_ends(seed: int, place: Path) -> int:
    """The exit code of a random scene or study with one to four mistakes.

    Its errors must be sentences.
    """
    rng = random.Random(seed)
    document = copy.deepcopy(rng.choice(SCENES))
    is_study = rng.random() < 0.2
    if is_study:
        varied = {"material.nu": [0.1, 0.2], "indenter.R": {"from": 1, "to": 2, "count": 3}}
        document = {
            "base": document,
            "vary": varied,
            "set": {"solver.rtol": 1e-9},
            "tolerance": 0.1,
        }
    for _ in range(rng.choice([1, 2, 3, 4])):
        document = mutated(rng, document) if places(document) else document
    (place / "scene.yaml").write_text(dump(document), "utf-8", errors="surrogatepass")
    try:
        if is_study:
            study_file.read(place / "scene.yaml").grid_points()
        else:
            config = load(
                place / "scene.yaml", [override(rng) for _ in range(rng.choice([0, 0, 0, 1, 3]))]
            )
            same(config)
            if rng.random() < 0.25:  # the dearer half of a plan
                resolve(config)
    except (ConfigError, UsageError) as error:
        told = str(error).splitlines()
        assert len(set(told)) == len(told) <= 60 and all(map(str.strip, told)), (seed, told)
        assert all(printable(line) == line and len(line) < 20_000 for line in told), seed
        return error.exit_code
    return 0


def ends(seeds: range, place: Path) -> Counter[int]:
    return Counter(how_it_ends(seed, place) for seed in seeds)


def test_several_mistakes(tmp_path):
    """Scenes with up to four mistakes are read or refused with sentences.

    `make stress` tries eighteen hundred of them.
    """
    counts = ends(range(75), tmp_path)
    assert set(counts) <= {0, 2, 3} and counts[0] > 2


@pytest.mark.stress
@pytest.mark.parametrize("part", range(6))
def test_hundreds_with_mistakes(tmp_path, part):
    counts = ends(range(1000 + 300 * part, 1300 + 300 * part), tmp_path)
    print(part, dict(counts))
    assert set(counts) <= {0, 2, 3}
