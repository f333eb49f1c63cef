"""The documentation is true: generated pages are current, and links and named configs exist."""

from __future__ import annotations

import io
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from reference_pages import pages

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)")
CONFIG = re.compile(r"\bconfigs/[\w./-]*\w")
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", pages())
def test_generated_pages_are_current(name):
    """A generated page is what `scripts/reference_pages.py` writes."""
    written = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert written == pages()[name], "run scripts/reference_pages.py"


def links_of(page: Path) -> list[tuple[Path, str]]:
    """File and anchor of every link of a page to a file of the repository or to its headings."""
    targets = LINK.findall(CODE.sub("", page.read_text(encoding="utf-8")))
    parts = [target.partition("#") for target in targets if not re.match(r"\w+:", target)]
    return [(page.parent / name if name else page, anchor) for name, _, anchor in parts]


def anchors(page: Path) -> set[str]:
    """Anchors of a page: its headings as they are named in links."""
    headings = re.findall(r"^#+ +(.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings
    }


def test_relative_links_lead_somewhere():
    """Every relative link of the documentation leads to a file or folder."""
    dead = [(page, file) for page in PAGES for file, _ in links_of(page) if not file.exists()]
    assert dead == []


def test_anchors_exist():
    """Every anchor in a link of the documentation is a heading of the page it leads to."""
    dead = [
        (page, file, anchor)
        for page in PAGES
        for file, anchor in links_of(page)
        if anchor and anchor not in anchors(file)
    ]
    assert dead == []


def test_named_configs_exist():
    """Every path in configs/ that the documentation names exists."""
    missing = [
        (page, name)
        for page in PAGES
        for name in CONFIG.findall(page.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    ]
    assert missing == []


def test_the_curve_of_the_tutorial_is_what_its_script_makes():
    """The shipped curve of the tutorial is what `scripts/make_example_curve` makes.

    The tolerance is two units of the force's last digit, because sums round differently in another
    version of numpy.
    """
    script = runpy.run_path(str(ROOT / "scripts" / "make_example_curve"))
    file = ROOT / "configs" / "curves" / "thin_gel.csv"
    shipped = np.loadtxt(file, delimiter=",", skiprows=2)
    made = np.loadtxt(io.StringIO(script["text"]()), delimiter=",", skiprows=2)
    np.testing.assert_allclose(made, shipped, atol=2e-3)
