"""Writes the pages that scripts measure, each with the commit that it was measured at."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SAID = re.compile(r"^Measured (?:at commit|from sources) .*\n\n", re.MULTILINE)


def measured_at(root: Path = ROOT) -> str:
    """The commit of the sources, in a sentence.

    Parameters
    ----------
    root : Path
        The folder of the sources.

    Returns
    -------
    str
        "Measured at commit 1a2b3c4d.", or that files beside docs/ are not as in that commit, or that there is none.
    """
    commit = _git(root, "rev-parse", "--short=8", "HEAD")
    if commit is None:
        return "Measured from sources without a repository."
    changed = _git(
        root, "status", "--porcelain", "--", ".", ":(exclude)docs"
    )  # pages made before are there
    return (
        f"Measured at commit {commit}{', with changes that are not committed' if changed else ''}."
    )


def write(page: Path, text: str, root: Path = ROOT) -> None:
    """Write a page, below its title the commit that it was measured at, and say so.

    Parameters
    ----------
    page : Path
        The file.
    text : str
        Markdown that begins with a title; what it says of another commit is replaced.
    root : Path
        The folder of the sources.
    """
    title, rest = SAID.sub("", text).split("\n\n", 1)
    page.write_text(f"{title}\n\n{measured_at(root)}\n\n{rest}", encoding="utf-8")
    print(page, flush=True)


def _git(root: Path, *words: str) -> str | None:
    """What git says of the sources themselves, None where they are no repository."""
    if not (root / ".git").exists():
        return None
    done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else None
