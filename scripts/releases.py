"""Commits of the releases, for pages and sites that are made of several of them."""

from __future__ import annotations

import subprocess
from pathlib import Path

from generated_page import ROOT

# The first release has no page docs/index.md; its site has neither gallery nor task table.
RELEASES = {"1.0.0": "91015029"}


def extract(commit: str, folder: Path, *parts: str) -> None:
    """Write parts of a commit, files or folders, into a new folder."""
    command = ["git", "-C", str(ROOT), "archive", commit, *parts]
    archive = subprocess.run(command, check=True, capture_output=True).stdout
    folder.mkdir(parents=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)


def last_commit(*parts: str) -> str:
    """Return the short name of the last commit that changed one of the parts."""
    command = ["git", "-C", str(ROOT), "log", "-1", "--abbrev=8", "--format=%h", "--", *parts]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
