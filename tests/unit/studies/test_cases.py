"""Cases of a study: which of them answer the same question."""

from __future__ import annotations

from pathlib import Path

import pytest

from indent_sim.process.errors import ConfigError
from indent_sim.studies import cases, study_file
from indent_sim.studies.reference.reference_solution import ReferenceSolution

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
    """Cases that differ in friction or adhesion answer other questions than in method or mesh."""
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  {varied}\n")
    found = cases.resolve_cases(study_file.read(study))[0]
    assert len({case.problem_key for case in found}) == questions


def test_another_experiment_is_another_run(tmp_path: Path) -> None:
    """Cases of other works of adhesion are other runs; equal cases share one."""
    study = tmp_path / "study.yaml"
    study.write_text(
        f"{SCENE}  experiment: [{{adhesion: {{work: 1.0e-3}}}}, {{adhesion: {{work: 2.0e-3}}}}, "
        "{adhesion: {work: 1.0e-3}}]\n"
    )
    first, second, third = cases.resolve_cases(study_file.read(study))[0]
    assert first.id == third.id != second.id
    assert len(cases.unique_cases([first, second, third])) == 2


@pytest.mark.parametrize(
    "varied",
    [
        "loading: [{history: [[0, 0], [1, 0.01]]}, {history: [[0, 0], [2, 0.01]]}]",
        "loading: [{history: [[0, 0], [1, 0.01]]}, {history: [[0, 0], [1, 0.01]], times: [0.5]}]",
        "material.relaxation: [{prony: [[0.5, 1]]}, {prony: [[0.5, 2]]}]\n  loading: "
        "[{history: [[0, 0], [1, 0.1]]}]",
    ],
)
def test_another_history_or_relaxation_is_another_run(varied: str, tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  {varied}\n")
    assert len(cases.unique_cases(cases.resolve_cases(study_file.read(study))[0])) == 2


def test_a_history_is_compared_with_nothing_by_depth(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(f"{SCENE}  loading: [{{history: [[0, 0], [1, 0.01]]}}]\ncompare_to: theory\n")
    read = study_file.read(study)
    with pytest.raises(ConfigError, match="passes a depth several times"):
        ReferenceSolution(read, cases.resolve_cases(read)[0])


SHARED = (
    "{body: {shape: layer, height: 1}, indenter: {shape: cone, half_angle: 70}, "
    "loading: {delta: 0.1}, material: {"
)
RELAXING = "model: linear_elastic, E: 1, nu: 0.3, relaxation: {prony: [[0.5, 1]]}}}"


@pytest.mark.parametrize(
    ("runs", "names"),
    [
        (
            "cases:\n  - {name: timed, scene: BODY, set: {loading: TIMED}}\n  - {name: "
            "still, scene: BODY}",
            ["case still"],
        ),
        (
            "base: BODY\nvary: {loading: [TIMED, {delta: 0.2}], body.height: [1, 2]}",
            ["loading {delta: 0.2}"],
        ),
        ("base: BODY\nvary: {body.height: [1, 2]}", []),
    ],
)
def test_an_error_says_of_which_run_it_is(runs: str, names: list[str], tmp_path: Path) -> None:
    """An error names the runs that have it where only some of the cases do."""
    study = tmp_path / "study.yaml"
    study.write_text(
        runs.replace("BODY", SHARED + RELAXING).replace("TIMED", "{history: [[0, 0], [1, 0.1]]}")
    )
    with pytest.raises(ConfigError) as told:
        cases.resolve_cases(study_file.read(study))
    (error,) = told.value.errors
    assert error.key == "material.relaxation" and all(name in error.problem for name in names)
    assert ("in the run of" in error.problem) == bool(names)


MIXED = """
base:
  units: {length: um, force: nN}
  body: {shape: layer, height: 10 um}
  material: {model: linear_elastic, E: 1 kPa, nu: 0.3}
  indenter: {shape: sphere, R: 5 um}
  loading: {delta: 0.1 um, steps: 1}
vary:
  material: [{model: linear_elastic, E: 2 kPa, nu: 0.3}]
  body.height: [5 um, 10000 nm, 0.05 um]
"""


def test_a_table_has_quantities_as_numbers_in_the_units_of_the_scene(tmp_path: Path) -> None:
    """Quantities stand in the table as numbers in the units of the scene, also of refused cases."""
    study = tmp_path / "study.yaml"
    study.write_text(f"{MIXED}tolerance: 0.01\n")
    found, refused = cases.resolve_cases(study_file.read(study))
    assert [case.table_values["body.height"] for case in found] == [5.0, 10.0]
    assert found[0].table_values["material"] == {
        "model": "linear_elastic",
        "E": pytest.approx(2.0),
        "nu": 0.3,
    }
    assert [one.table_values["body.height"] for one in refused] == [pytest.approx(0.05)]
    assert (
        found[0].name.startswith("material=") and "height=5_um" in found[0].name
    )  # a name says what was written


def test_one_impossible_combination_is_told_with_the_word_tolerance(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(MIXED)
    with pytest.raises(
        ConfigError,
        match=r"1 of 3 runs are invalid: with `tolerance` in the study they are failed rows",
    ):
        cases.resolve_cases(study_file.read(study))
    study.write_text(MIXED.replace("5 um, 10000 nm, ", ""))  # none can be
    with pytest.raises(ConfigError) as told:
        cases.resolve_cases(study_file.read(study))
    assert "tolerance" not in str(told.value)
