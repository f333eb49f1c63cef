"""Writer of measured pages, each with the commit at which it was measured."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MEASURED = "The numbers on this page were measured"
COMMIT_SENTENCE = re.compile(rf"^{MEASURED} (?:at commit|from sources) .*\n\n", re.MULTILINE)


def measured_at(root: Path = ROOT) -> str:
    """Return a sentence that names the commit of the sources.

    Parameters
    ----------
    root : Path
        The folder of the sources.

    Returns
    -------
    str
        "The numbers on this page were measured at commit 1a2b3c4d." It also says if files outside
        docs/ differ from that commit, and if the sources are not in a repository.
    """
    commit = _git(root, "rev-parse", "--short=8", "HEAD")
    if commit is None:
        return f"{MEASURED} from sources without a repository."
    begin = f"{MEASURED} at commit {commit}"
    # Pages that were made before lie in docs/ and are no change of the sources.
    changes = _git(root, "status", "--porcelain", "--", ".", ":(exclude)docs")
    if changes:
        return f"{begin}, with changes that are not committed."
    return f"{begin}."


def write(page: Path, text: str, root: Path = ROOT) -> None:
    """Write a page with the sentence of `measured_at` below its title, and print its path.

    Parameters
    ----------
    page : Path
        The file.
    text : str
        Markdown that begins with a title. A sentence about an earlier commit is replaced.
    root : Path
        The folder of the sources.
    """
    title, rest = COMMIT_SENTENCE.sub("", text).split("\n\n", 1)
    page.write_text(f"{title}\n\n{measured_at(root)}\n\n{rest}", encoding="utf-8")
    print(page, flush=True)


def _git(root: Path, *arguments: str) -> str | None:
    """Return the output of a git command, or None if `root` is not the root of a repository."""
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else None
