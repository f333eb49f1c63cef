"""Whatever text comes in: a valid Config that survives writing and reading, or a ConfigError."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from indent_sim.config import schema
from indent_sim.config.file import from_mapping, load, loads, to_mapping, to_yaml
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import dump, parse
from indent_sim.process.errors import ConfigError

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
solver: {petsc: {ksp_type: cg}}
"""

WORDS = sorted(
    {name for kinds in schema.sections().values() for kind in kinds for name in schema.file_order(kind)}
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
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.sampled_from(WORDS))
VALUES = st.recursive(
    SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(st.sampled_from(WORDS), v, max_size=3)
)
POSITIVE = st.floats(1e-7, 1e7)  # lengths of one scene: their ratios are limited
SIDES = st.floats(1e-2, 1e2)
LENGTHS = POSITIVE | POSITIVE.map(lambda x: -x) | st.sampled_from([0.0, -0.0])
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def outcome(text: str, overrides: tuple[str, ...] = ()) -> None:
    """Lets nothing pass but a config that round-trips, or a ConfigError that says something."""
    try:
        config = loads(text, "scene.yaml", overrides)
    except ConfigError as error:
        assert error.exit_code == 3 and error.problem and str(error)
    else:
        same(config)


def same(config: Config) -> None:
    """Writing and reading changes nothing."""
    assert loads(to_yaml(config)) == config
    assert from_mapping(to_mapping(config)) == config


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
    keys = schema.keys_at((section,), document)
    if keys and data.draw(st.booleans()):
        document[section][data.draw(st.sampled_from(keys))] = value
    else:
        document[section] = value
    try:
        same(from_mapping(document))
    except ConfigError as error:
        assert error.problem


@BRIEF
@given(st.sampled_from(["body.sides", "loading", "title", "contact", ""]), st.lists(PIECES, max_size=6))
def test_any_override(key, pieces):
    outcome(SCENE, (f"{key}={''.join(pieces)}",))


@BRIEF
@given(st.recursive(st.text() | FINITE | st.integers(-(10**30), 10**30) | st.booleans(), st.lists))
def test_what_is_dumped_is_parsed(value):
    text = dump({"section": {"key": value}, "other": value})
    try:
        found = parse(text)[0]
    except ConfigError as error:
        assert "no file can hold" in str(error)
    else:
        assert found == {"section": {"key": value}, "other": value}


@BRIEF
@given(st.tuples(SIDES, SIDES, SIDES), st.lists(LENGTHS, min_size=1, max_size=5), FINITE, FINITE)
def test_numbers_come_back_to_the_last_digit(size, deltas, x, y):
    document: dict[str, Any] = parse(SCENE)[0]
    document["body"]["size"], document["indenter"]["center"] = list(size), [x, y]
    document["loading"] = {"deltas": deltas}
    config = loads(to_yaml(from_mapping(document)))
    assert config.body.size == size and config.loading.deltas == tuple(deltas) and config.center == (x, y)
    assert [math.copysign(1, found) for found in config.center] == [math.copysign(1, x), math.copysign(1, y)]
