"""Generated pages with measurements state their commit; `make pages` knows all of them."""

from __future__ import annotations

import runpy
import subprocess
from pathlib import Path

import generated_page

ROOT = Path(__file__).resolve().parents[2]
TEXT = "# A title\n\nWords.\n"


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    return subprocess.run(
        ["git", *who, "-C", str(folder), *words], check=True, capture_output=True, text=True
    ).stdout


def test_a_page_says_at_which_commit_it_was_measured(tmp_path: Path) -> None:
    """A page states once at which commit it was measured, however often it is written.

    Changes of pages themselves do not count; those of anything else do.
    """
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    generated_page.write(page, TEXT, tmp_path)
    measured = "The numbers on this page were measured"
    sources = f"{measured} from sources without a repository."
    assert page.read_text() == f"# A title\n\n{sources}\n\nWords.\n"
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-q", "-m", "a")
    commit = git(tmp_path, "rev-parse", "HEAD")[:8]
    generated_page.write(page, page.read_text(), tmp_path)
    generated_page.write(page, page.read_text(), tmp_path)
    assert page.read_text() == f"# A title\n\n{measured} at commit {commit}.\n\nWords.\n"
    (tmp_path / "program.py").write_text("")
    generated_page.write(page, page.read_text(), tmp_path)
    said = f"{measured} at commit {commit}, with changes that are not committed."
    assert page.read_text() == f"# A title\n\n{said}\n\nWords.\n"


def test_every_page_has_a_script_that_writes_it() -> None:
    pages = runpy.run_path(str(ROOT / "scripts" / "make_pages"))["PAGES"]
    assert len(pages) == 13
    for name, (script, *_) in pages.items():
        assert (ROOT / "docs" / f"{name}.md").exists()
        place = ROOT / "scripts" / script
        text = (place / "__main__.py" if place.is_dir() else place).read_text(encoding="utf-8")
        assert f'"{name}.md"' in text and "write(PAGE, " in text
