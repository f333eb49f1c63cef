"""Slices of the proofs: together all tests, each once; every commit has one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SLICE_OF_COMMIT = ROOT / "scripts" / "slice_of_commit"


def collected(*options: str) -> subprocess.CompletedProcess[str]:
    """What pytest collects in a small folder of tests."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        *options,
        "tests/unit/process",
    ]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def names(*options: str) -> list[str]:
    return [line for line in collected(*options).stdout.splitlines() if "::" in line]


def test_slices_are_all_tests_each_once() -> None:
    parts = [names("--slice", f"{k}/3") for k in (1, 2, 3)]
    assert sorted(name for part in parts for name in part) == sorted(names())
    assert all(parts)


@pytest.mark.parametrize("wrong", ["0/12", "13/12", "3", "a/b", "1/0"])
def test_a_slice_that_is_none_is_refused(wrong: str) -> None:
    done = collected("--slice", wrong)
    assert done.returncode == 4
    assert "is no slice K/N" in done.stderr


def git(folder: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", *who, "-C", str(folder), *words], check=True, capture_output=True)


def slice_of(folder: Path) -> int:
    """The slice, out of twelve, of what is checked out in a folder."""
    script = folder / "scripts" / "slice_of_commit"
    script.parent.mkdir(exist_ok=True)
    script.write_bytes(SLICE_OF_COMMIT.read_bytes())
    script.chmod(0o755)
    said = subprocess.run([script, "12"], capture_output=True, text=True, check=True).stdout
    slice_, slices = map(int, said.split("/"))
    assert 1 <= slice_ <= slices == 12
    return slice_


def test_commits_one_after_another_have_every_slice(tmp_path: Path) -> None:
    """Twelve commits one after another have all twelve slices.

    A merge of a branch with several commits counts as one.
    """
    git(tmp_path, "init", "-q", "-b", "main")
    found = []
    for k in range(12):
        if k == 5:
            git(tmp_path, "checkout", "-q", "-b", "side")
            for name in "ab":
                git(tmp_path, "commit", "-q", "--allow-empty", "-m", name)
            git(tmp_path, "checkout", "-q", "main")
            git(tmp_path, "merge", "-q", "--no-ff", "-m", "merged", "side")
        else:
            git(tmp_path, "commit", "-q", "--allow-empty", "-m", str(k))
        found.append(slice_of(tmp_path))
    assert sorted(found) == [*range(1, 13)]


def test_shallow_clones_and_sources_without_a_repository_have_a_slice(tmp_path: Path) -> None:
    """Shallow clones have a slice by the name of their commit, the same in every such clone.

    They do not know the number of the commit. Sources without a repository have a slice too.
    """
    whole, shallow, plain = (tmp_path / name for name in ("whole", "shallow", "plain"))
    whole.mkdir()
    git(whole, "init", "-q")
    for name in "abc":
        git(whole, "commit", "-q", "--allow-empty", "-m", name)
    git(tmp_path, "clone", "-q", "--depth", "1", whole.as_uri(), str(shallow))
    plain.mkdir()
    assert slice_of(whole) == 4
    again = tmp_path / "again"
    git(tmp_path, "clone", "-q", "--depth", "2", whole.as_uri(), str(again))
    assert slice_of(shallow) == slice_of(again)
    slice_of(plain)
