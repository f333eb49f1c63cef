"""Which runs of a study answer the same question."""

from __future__ import annotations

from pathlib import Path

import pytest

from indent_sim.process.errors import ConfigError
from indent_sim.studies import cases, study_file
from indent_sim.studies.reference.truth import Truth

SCENE = """
base:
  body: {shape: cylinder, radius: 4.0, height: 1.0, base: fixed, sides: roller}
  material: {model: linear_elastic, E: 1.0, nu: 0.3}
  indenter: {shape: paraboloid, R: 1.0}
  loading: {delta: 0.01, steps: 1}
vary:
"""


@pytest.mark.parametrize(
    ("varied", "questions"),
    [
        ("contact: [{method: penalty}, {method: nitsche}]", 1),
        ("mesh.h_contact: [0.1, 0.05]", 1),
        ("contact.friction: [0, 0.3, stick]", 3),
        ("contact: [{method: auto}, {method: auto, friction: stick}]", 2),
        ("contact.gap: [reference, current]", 2),
    ],
)
def test_another_surface_is_another_question(varied: str, questions: int, tmp_path: Path) -> None:
    """A method or a mesh is another answer to the same one; friction changes what is asked."""
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  {varied}\n")
    found = cases.asked_for(study_file.read(study))[0]
    assert len({case.problem for case in found}) == questions


def test_another_experiment_is_another_run(tmp_path: Path) -> None:
    """On one curve: works differ in what they come to, so runs are not shared; equal ones are."""
    study = tmp_path / "study.yaml"
    study.write_text(
        f"{SCENE}  experiment: [{{adhesion: {{work: 1.0e-3}}}}, {{adhesion: {{work: 2.0e-3}}}}, "
        "{adhesion: {work: 1.0e-3}}]\n"
    )
    first, second, third = cases.asked_for(study_file.read(study))[0]
    assert first.id == third.id != second.id
    assert len(cases.unique([first, second, third])) == 2


@pytest.mark.parametrize(
    "varied",
    [
        "loading: [{history: [[0, 0], [1, 0.01]]}, {history: [[0, 0], [2, 0.01]]}]",
        "loading: [{history: [[0, 0], [1, 0.01]]}, {history: [[0, 0], [1, 0.01]], times: [0.5]}]",
        "material.relaxation: [{prony: [[0.5, 1]]}, {prony: [[0.5, 2]]}]\n  loading: [{history: [[0, 0], [1, 0.1]]}]",
    ],
)
def test_another_history_or_relaxation_is_another_run(varied: str, tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  {varied}\n")
    assert len(cases.unique(cases.asked_for(study_file.read(study))[0])) == 2


def test_a_history_is_compared_with_nothing_by_depth(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  loading: [{{history: [[0, 0], [1, 0.01]]}}]\ncompare_to: theory\n")
    read = study_file.read(study)
    with pytest.raises(ConfigError, match="passes one several times"):
        Truth(read, cases.asked_for(read)[0])


SHARED = "{body: {shape: layer, height: 1}, indenter: {shape: cone, half_angle: 70}, loading: {delta: 0.1}, material: {"
RELAXING = "model: linear_elastic, E: 1, nu: 0.3, relaxation: {prony: [[0.5, 1]]}}}"


@pytest.mark.parametrize(
    ("runs", "names"),
    [
        (
            "cases:\n  - {name: timed, scene: BODY, set: {loading: TIMED}}\n  - {name: still, scene: BODY}",
            ["case still"],
        ),
        ("base: BODY\nvary: {loading: [TIMED, {delta: 0.2}], body.height: [1, 2]}", ["loading {delta: 0.2}"]),
        ("base: BODY\nvary: {body.height: [1, 2]}", []),
    ],
)
def test_an_error_says_of_which_run_it_is(runs: str, names: list[str], tmp_path: Path) -> None:
    """Where it lies in what runs share, and only some of them have it."""
    study = tmp_path / "study.yaml"
    study.write_text(runs.replace("BODY", SHARED + RELAXING).replace("TIMED", "{history: [[0, 0], [1, 0.1]]}"))
    with pytest.raises(ConfigError) as told:
        cases.asked_for(study_file.read(study))
    (error,) = told.value.errors
    assert error.key == "material.relaxation" and all(name in error.problem for name in names)
    assert ("in the run of" in error.problem) == bool(names)
