"""Small scenes with arbitrary values are run to their end or refused in words."""

from __future__ import annotations

import tempfile
from contextlib import suppress
from typing import Any

import pytest
from arbitrary_scenes import BRIEF, FUZZ, ended, scenes
from hypothesis import given, settings

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

# Seconds for one run that is planned to take 3 s; a difficult path is cut into many increments
RUN_WAIT = 240.0
AFFORDABLE = {
    "dofs": 8_000,
    "seconds": 3.0,
}  # at most, in the plan of a scene that is run; theory has no mesh


def run(document: dict[str, Any]) -> bool:
    """Run a scene of few steps if it is small enough, and return whether it was."""
    with suppress(ConfigError):
        if isinstance(document.get("loading"), dict) and {"delta", "force"} & set(
            document["loading"]
        ):
            document["loading"]["steps"] = 2
        document.pop("output", None)
        scene = resolve(config_from_mapping(document))
        planned = scene.plan.prediction
        if len(scene.physics.deltas) <= 5 and all(
            planned.get(k, 0) <= most for k, most in AFFORDABLE.items()
        ):
            out = ("--output", "out", "--set", "output.plot=false")
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(tempfile.mkdtemp())
                ended("run", document, *out, codes=(0, 3, 4, 5, 6), wait=RUN_WAIT)
            return True
    return False


def test_some_scenes_are_run():
    ran = []

    @settings(BRIEF, max_examples=200)
    @given(scenes())
    def some(document):
        if len(ran) < 4 and run(document):
            ran.append(document)

    some()
    assert len(ran) == 4


@pytest.mark.stress
@settings(FUZZ, max_examples=40)
@given(scenes())
def test_runs_of_forty_scenes(document):
    run(document)
