"""What scripts/make_foreign_curves_page asks of fits, on made entries.

Some of the entries keep the promise and some break it.
"""

from __future__ import annotations

import runpy
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SAYS = "echo a warning >&2; echo ' ERROR: no such release' >&2; echo a note >&2; exit 1"  # like pip


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "scripts" / "make_foreign_curves_page"))


def entry(
    explained: bool, low: float = 1.0, high: float = 2.0, window: float = 1.5
) -> dict[str, Any]:
    part = {"material.E": window, "material.E_low": 0.9 * window, "material.E_high": 1.1 * window}
    stated = {"value": 1.5, "low": low, "high": high}
    found = {"curve": "a", "status": "done", "reason": "", "explained": explained, "window": [part]}
    return found | {"parameters": {"material.E": stated}}


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (entry(True), None),
        (entry(True, window=2.1), None),  # its interval reaches the stated one
        (entry(True, window=2.5), "explained, but a window's interval misses"),
        (entry(False), None),
        (entry(False, window=2.1), "lacks a window's value"),
        ({"curve": "a", "status": "refused", "reason": "2 points"}, None),
        ({"curve": "a", "status": "refused", "reason": ""}, "no reason"),
    ],
)
def test_a_promise_that_is_broken_is_named(script, made, said):
    wrong = script["broken_promises"]({"of": [made]})
    assert len(wrong) == (said is not None) and all(said in words for words in wrong)


def test_nine_of_ten_made_curves_must_hold_the_truth(script):
    """At least 36 of 40 made curves must have the truth inside their interval.

    A refused curve counts as one that has not. nN/um^2 is kPa.
    """
    right, wrong = entry(True, 6.2, 6.3), {"status": "refused"}
    assert script["softmech_wrong"]([right] * 36 + [wrong] * 4) == []
    assert len(script["softmech_wrong"]([right] * 35 + [wrong] * 5)) == 1


def test_a_reason_fits_into_a_cell(script):
    assert script["one_line"]("no\nfile | of  ours") == "no file \\| of ours"
    assert script["outcome"]({"status": "refused", "reason": "not a curve: x"}) == "unreadable"


def git(folder: Path, *words: str) -> str:
    known = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b"]
    return subprocess.run(
        [*known, *words], check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="no git")
def test_a_file_that_a_repository_lacks_is_named_with_the_reason(script, tmp_path, monkeypatch):
    copy = tmp_path / "data" / "PyFMReader"
    (copy / "tests").mkdir(parents=True)
    for name in ("a.spm", "b.spm", "test_a.py"):
        (copy / "tests" / name).write_text(name)
    git(copy, "init", "--quiet")
    git(copy, "add", ".")
    git(copy, "commit", "--quiet", "-m", "files")
    lost = git(copy, "rev-parse", "HEAD:tests/b.spm")
    (copy / ".git" / "objects" / lost[:2] / lost[2:]).unlink()
    monkeypatch.setitem(
        script["COMMITS"], "PyFMReader", ("a/b", git(copy, "rev-parse", "HEAD"), "tests/")
    )
    monkeypatch.setitem(script["committed"].__globals__, "FOLDER", tmp_path)
    missing: dict[str, str] = {}
    folder = script["committed"]("PyFMReader", tmp_path / "data", missing)
    assert [one.name for one in folder.iterdir()] == ["a.spm"] and list(missing) == [
        "PyFMReader/b.spm"
    ]
    said = "was not available: it is missing in the repository from local copies"
    assert said in script["outcomes"]({}, missing)


def test_a_program_that_cannot_be_had_is_a_reason_on_the_page(script):
    missing: dict[str, str] = {}
    assert script["had"]("nanite", missing, lambda: script["called"]("sh", "-c", SAYS)) is None
    assert missing["nanite"] == "sh: ERROR: no such release"
    assert script["had"]("git", missing, lambda: script["called"]("/no such program")) is None
    assert missing["git"] == "/no such program: No such file or directory"
    assert "| nanite | all |" in script["outcomes"]({}, missing)
    assert "Not measured: nanite was not available (sh: " in script["lacking"]("nanite", missing)
    assert "| nanite |  |" in script["summary"]({}, missing)


def test_a_file_without_an_entry_is_named(script, tmp_path):
    (tmp_path / "a.csv").touch()
    (tmp_path / "b.csv").touch()
    assert script["skipped"](tmp_path, [{"source": {"file": "/elsewhere/a.csv"}}]) == ["b.csv"]
