"""Values of a wrong shape, such as a list in place of a number, at every key."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest

from indent_sim.config import key_types, schema
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError

SCENE: dict[str, dict[str, Any]] = {
    "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01},
}
SHAPES: list[Any] = [{}, {"a": 1}, [], [{}], [[]], None, 1, "word"]
SECTIONS = {
    (section, kind)
    for section, kinds in schema.sections().items()
    for kind in kinds
    if section != "layers"
}


@pytest.mark.parametrize("section", sorted({section for section, _ in SECTIONS}))
def test_a_value_of_another_shape_is_an_error_in_words(section: str) -> None:
    """A value of any other shape is accepted or is a ConfigError, and never another exception."""
    for _, kind in (one for one in SECTIONS if one[0] == section):
        tags = {
            name: schema.default_of(kind, name)
            for name in key_types.field_names(kind)
            if name in schema.TAG_KEYS
        }
        for name in key_types.field_names(kind):
            for value in SHAPES:
                said = SCENE.get(section, {}) | tags | {name: value}
                with suppress(ConfigError):
                    config_from_mapping(SCENE | {section: said})


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({}, "drainage.tip.conductance: missing; give a number > 0"),
        ({"a": 1}, "drainage.tip.a: unknown key; valid here: conductance"),
        ({"conductance": -1}, "drainage.tip.conductance: must be > 0, got -1"),
        ([], r"drainage.tip: must be drained or sealed or a section, got \[\]"),
    ],
)
def test_a_section_in_place_of_a_word_is_told_as_a_section(value: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config_from_mapping(SCENE | {"drainage": {"tip": value}})
