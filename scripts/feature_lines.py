#!/usr/bin/env python3
"""Counts the lines that features have added to the package, by git: a Markdown table.

usage: python scripts/feature_lines.py

A feature is a list of commits, chosen by their subjects. Counted are the lines that they added to
and deleted from `indent_sim` and `tests`; a commit with several features counts for the first one.
The files of a feature are those that its commits created. Commits that only reword texts, and later
changes of these lines by other commits, are not counted.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Decisions and commits of each feature.
FEATURES = {
    "soft tips (64)": ("c1eb9479 8ffcdc59 21d8ae99 e586c558 20535cd3 a38fc5ae 3acac5cf d785ef6b"),
    "tilted tips (69)": "c195c09e 81896aaf c970cce5 a085e699",
    "tips that slide, also in time (70, 75)": (
        "18530ffd 8478e93b 4e3bbe6a bd346ed4 c33677a3 024bb28e 492c3baa c5945c19 83340915 "
        "dab0b4e8 e84de5d0 0673b349 a3101aa3 999971c0"
    ),
    "bodies at rest on a flat (71, 79, 80)": (
        "6cc11a08 6d1b6437 0265c808 1e64849b a09be140 df9dc763 6936525f"
    ),
    "two bodies at finite strain (76)": (
        "445bf8bf 8d5eb863 67bd5e50 c760a450 e2c826fc e1165636 c690936e"
    ),
}


def git(*arguments: str) -> str:
    """Return the output of a git command in this repository."""
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def changed_lines(commit: str, folder: str) -> tuple[int, int]:
    """Return the numbers of lines that a commit added to and deleted from a folder."""
    added = deleted = 0
    for line in git("show", "--numstat", "--format=", commit, "--", folder).splitlines():
        plus, minus, _ = line.split("\t")
        if plus != "-":
            added += int(plus)
            deleted += int(minus)
    return added, deleted


def own_lines(commits: Sequence[str]) -> int:
    """Return the present number of lines of the package's files that the commits created."""
    options = ("show", "--diff-filter=A", "--name-only", "--format=")
    names = {
        name for commit in commits for name in git(*options, commit, "--", "indent_sim").split()
    }
    paths = [ROOT / name for name in sorted(names) if name.endswith(".py")]
    return sum(len(path.read_text().splitlines()) for path in paths if path.exists())


def main() -> None:
    """Print the table."""
    print("| feature (decisions) | package | net | its own files today | tests, net |")
    print("|---|--:|--:|--:|--:|")
    sums = [0] * 5
    for feature, hashes in FEATURES.items():
        commits = hashes.split()
        counts = []
        for folder in ("indent_sim", "tests"):
            pairs = [changed_lines(commit, folder) for commit in commits]
            counts += [sum(added for added, _ in pairs), sum(deleted for _, deleted in pairs)]
        added, deleted, tests_added, tests_deleted = counts
        row = [added, deleted, added - deleted, own_lines(commits), tests_added - tests_deleted]
        sums = [total + number for total, number in zip(sums, row, strict=True)]
        print("| {} | +{} -{} | {} | {} | {} |".format(feature, *row))
    print("| sum | +{} -{} | {} | {} | {} |".format(*sums))


if __name__ == "__main__":
    main()
