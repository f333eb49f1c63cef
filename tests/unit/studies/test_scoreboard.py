"""Published values in a study: the keys of its file, and wrong value; nothing is solved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from indent_sim.process.errors import ConfigError
from indent_sim.results.reader import Results
from indent_sim.studies import cases, study_file
from indent_sim.studies.reference import scoreboard

SCENE = """\
    scene:
      body: {shape: half_space}
      material: {model: linear_elastic, E: 1.0, nu: 0.3}
      indenter: {shape: paraboloid, R: 1.0}
      loading: {deltas: [0.005, 0.01]}
      solver: {method: condensed}
"""
HERTZ = 4 / 3 / 0.91 * 0.01**1.5  # its force at the last row
PUBLISHED = "{quantity: force, value: 1.4652e-3, claims: exact, within: 1.0e-4, source: Hertz 1882}"


CIRCLE = "    exact: {case: B, by: x}\n" + "".join(
    f"  - name: {name}\n{SCENE}    published: {PUBLISHED}\n    exact: {{case: {other}, by: x}}\n"
    for name, other in (("B", "C"), ("C", "Hertz"))
)


def study(
    folder: Path, published: str = PUBLISHED, more: str = "", scene: str = SCENE
) -> study_file.StudyFile:
    path = folder / "study.yaml"
    path.write_text(f"cases:\n  - name: Hertz\n{scene}    published: {published}\n{more}")
    return study_file.read(path)


def board(found: study_file.StudyFile, **columns: list[float]) -> list[scoreboard.Row]:
    """Scoreboard in which the first case has found these columns and the others nothing."""
    asked = cases.resolve_cases(found)[0]
    scoreboard.check_published_rows(found.named_cases, asked)
    table = {name: np.array(values) for name, values in columns.items()}
    done = {asked[0].id: Results(Path("run"), table, {"status": "done"})} if columns else {}
    return scoreboard.rows(found.named_cases, asked, done)


def found(force: float, error: float = 1e-6) -> dict[str, list[float]]:
    return {
        "step": [1, 2],
        "delta": [0.005, 0.01],
        "force": [force / 8**0.5, force],
        "force_error": [error, error],
    }


@pytest.mark.parametrize(
    ("published", "ours", "wrong"),
    [
        (HERTZ, HERTZ + 5e-7, "nobody"),
        (1.01 * HERTZ, HERTZ + 5e-7, "published"),
        (HERTZ, HERTZ + 5e-6, "ours"),
        (1.01 * HERTZ, HERTZ + 5e-6, "both"),
    ],
)
def test_who_is_wrong_is_judged_by_theory_of_the_same_body(
    published: float, ours: float, wrong: str, tmp_path: Path
) -> None:
    """Theory of the same body decides wrong value, by the stated errors of both.

    The source claims 1e-4, and the run's error bar is 1e-6.
    """
    (row,) = board(study(tmp_path, PUBLISHED.replace("1.4652e-3", repr(published))), **found(ours))
    assert row["wrong"] == wrong and row["exact"] == pytest.approx(HERTZ, rel=1e-9)
    assert row["exact_by"] == "half-space theory" and row["our_error"] == 1e-6
    assert row["difference"] == pytest.approx(100 * (published / HERTZ - 1), abs=1e-7)


def test_a_row_is_found_by_its_depth(tmp_path: Path) -> None:
    published = PUBLISHED.replace(
        "value: 1.4652e-3", f"at: {{delta: 0.005}}, value: {HERTZ / 8**0.5}"
    )
    (row,) = board(study(tmp_path, published), **found(HERTZ))
    assert row["ours"] == pytest.approx(HERTZ / 8**0.5) == row["exact"]


def test_where_forces_are_prescribed_theory_is_asked_at_the_force(tmp_path: Path) -> None:
    """With a prescribed force, the exact p_max is that of Hertz at the force, not at the depth.

    Reference: p_max = 2 E* a/(pi R) with a^3 = 3 F R/(4 E*).
    """
    scene = SCENE.replace("deltas: [0.005, 0.01]", "force: 1.0e-3, steps: 1")
    a = (0.75e-3 * 0.91) ** (1 / 3)
    said = "{quantity: p_max, value: 0.06, claims: elements, within: 0.5, source: nobody}"
    columns = {
        "step": [1.0],
        "delta": [0.5],
        "force": [1e-3],
        "p_max": [0.06],
        "p_max_error": [0.01],
    }
    (row,) = board(study(tmp_path, said, scene=scene), **columns)
    assert row["exact"] == pytest.approx(2 * a / 0.91 / np.pi, rel=1e-7)  # theory is good to 1e-8


def test_a_source_that_claims_no_accuracy_is_not_judged(tmp_path: Path) -> None:
    (row,) = board(
        study(tmp_path, "{quantity: force, value: 2.0e-3, claims: fit, source: x}"), **found(HERTZ)
    )
    assert row["wrong"] == "nobody" and "no accuracy claimed" in scoreboard.verdict_text(row)


def test_a_number_may_be_the_exact_one(tmp_path: Path) -> None:
    (row,) = board(
        study(tmp_path, more="    exact: {value: 2.0e-3, by: a closed form}\n"), **found(HERTZ)
    )
    assert (row["exact"], row["exact_by"], row["wrong"]) == (2e-3, "a closed form", "both")


def test_a_run_that_failed_is_judged_by_nobody(tmp_path: Path) -> None:
    (row,) = board(study(tmp_path))
    assert row["ours"] is None and scoreboard.verdict_text(row) == "the run failed"


def test_rows_are_read_back_as_they_were(tmp_path: Path) -> None:
    (row,) = board(study(tmp_path), **found(HERTZ))
    cells = {name: "" if value is None else str(value) for name, value in row.items()}
    assert scoreboard.read_row(cells) == row


@pytest.mark.parametrize(
    ("published", "more", "message"),
    [
        (
            PUBLISHED.replace("force", "forse"),
            "",
            r":9: cases\[0\].published.quantity: .*did you mean 'force'",
        ),
        (
            PUBLISHED.replace("exact", "true"),
            "",
            r":9: cases\[0\].published.claims: must be exact, fit or elements",
        ),
        (
            PUBLISHED.replace("1.0e-4", "2"),
            "",
            r":9: cases\[0\].published.within: must be between 0 and 1",
        ),
        (PUBLISHED.replace("value", "number"), "", r":9: cases\[0\].published.number: unknown key"),
        (
            PUBLISHED.replace(", source: Hertz 1882", ""),
            "",
            r":9: cases\[0\].published.source: missing",
        ),
        (
            PUBLISHED.replace("value", "at: {depth: 1}, value"),
            "",
            r":9: cases\[0\].published.at: must name one row",
        ),
        (
            PUBLISHED.replace("value", "at: {delta: 0.02}, value"),
            "",
            r":9: published.at: .*has no row with delta 0.02",
        ),
        (
            PUBLISHED,
            "    exact: {by: x}\n",
            r":10: cases\[0\].exact: must have either value or case",
        ),
        (
            PUBLISHED,
            "    exact: {case: Hart, by: x}\n",
            r":10: cases\[0\].exact.case: there is no case of this name",
        ),
        (
            PUBLISHED,
            f"  - name: Hertz\n{SCENE}",
            r":10: cases\[1\].name: two cases have the name Hertz",
        ),
        (
            PUBLISHED,
            "    exact: {value: 0, by: x}\n",
            r":10: cases\[0\].exact.value: must not be 0",
        ),
        (
            PUBLISHED,
            "    exact: {case: Hertz, by: x}\n",
            r":10: cases\[0\].exact.case: refers to its own case",
        ),
        (
            PUBLISHED,
            CIRCLE,
            r":10: cases\[0\].exact.case: circular reference: Hertz -> B -> C -> Hertz",
        ),
        (PUBLISHED, "base: hertz.yaml\n", r":10: base: cannot be combined with `cases`"),
        (PUBLISHED, "    sett: {}\n", r":10: cases\[0\].sett: unknown key, did you mean 'set'"),
    ],
)
def test_a_mistake_is_told_with_its_line_and_key(
    published: str, more: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=message):
        board(study(tmp_path, published, more))


ROW_THAT_PULLS = {"step": 2, "delta": 0.01, "force": -3.9}


@pytest.mark.parametrize(
    ("report", "bar"),
    [
        (
            {"experiment": {"adhesion": {"pull_off": {"force_control": {"force": -4.0}}}}},
            4.0 * 0.02,
        ),
        ({"adhesion": {"largest_pull": ROW_THAT_PULLS | {"force": -4.0}, "pull_off": None}}, 0.04),
        (
            {
                "adhesion": {
                    "largest_pull": ROW_THAT_PULLS,
                    "pull_off": {"force": -4.0, "error": 0.003},
                }
            },
            0.043,
        ),
        (
            {
                "adhesion": {
                    "largest_pull": ROW_THAT_PULLS,
                    "pull_off": {"force": -4.0, "error": None},
                }
            },
            None,
        ),
    ],
    ids=["without range", "of a row", "between rows", "between rows, not known how well"],
)
def test_a_pull_off_has_the_bar_of_what_it_is_found_from(
    report: dict, bar: float | None, tmp_path: Path
) -> None:
    """The error bar of a pull-off is that of the curve, row or search it is found from."""
    study_of = study(tmp_path, "{quantity: pull_off, value: -4.0, claims: fit, source: nobody}")
    asked = cases.resolve_cases(study_of)[0]
    row = report.get("adhesion", {}).get("largest_pull", {"force": -4.0})
    table = {"step": [1, 2], "delta": [0.005, 0.01], "force": [1.0, row["force"]]}
    table["force_error"] = [0.02, -0.01 * row["force"]]
    columns = {name: np.array(values) for name, values in table.items()}
    done = {asked[0].id: Results(Path("run"), columns, {"status": "done"} | report)}
    (row,) = scoreboard.rows(study_of.named_cases, asked, done)
    assert row["ours"] == -4.0
    assert row["our_error"] == (bar if bar is None else pytest.approx(bar, rel=1e-12))
