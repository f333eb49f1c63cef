"""Scenes and studies with arbitrary values are planned, run or refused in words.

None ends as a bug or takes long.
"""

from __future__ import annotations

import tempfile
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from arbitrary_scenes import (
    BRIEF,
    FUZZ,
    ended,
    scenes,
    studies,
    within,
)
from hypothesis import given, settings

from indent_sim.config.strict_yaml import dump
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.studies import study_file as study_file

WAIT = 20.0  # s of wall time for one plan: the slowest takes 1 s, on a machine that may be busy


def plan(document: dict[str, Any]) -> None:
    """Assert that a plan is numbers, none of them nan, or the message of exit code 3."""
    done = ended("plan", document, codes=(0, 3), wait=WAIT)
    assert (done.exit_code == 0) == bool(done.stdout)
    assert not {"nan", "inf"} & set(done.stdout.replace(",", " ").split())


def read_study(document: dict[str, Any]) -> None:
    """Assert that a study gives grid points, or the message of exit code 2 or 3.

    The scenes of its points are tried elsewhere.
    """
    with tempfile.TemporaryDirectory() as place, within(WAIT), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        path = Path(place, "STUDY.yaml")
        path.write_text(dump(document), encoding="utf-8", errors="surrogatepass")
        with suppress(ConfigError, UsageError):
            assert study_file.read(path).grid_points()


@settings(BRIEF, max_examples=60)  # and six hundred in `make stress`
@given(scenes())
def test_any_scene(document):
    plan(document)


@settings(BRIEF, max_examples=100)
@given(studies())
def test_any_study(document):
    read_study(document)


@pytest.mark.stress
@settings(FUZZ, max_examples=600)
@given(scenes())
def test_hundreds_of_scenes(document):
    plan(document)


@pytest.mark.stress
@settings(FUZZ, max_examples=400)
@given(studies())
def test_hundreds_of_studies(document):
    read_study(document)
