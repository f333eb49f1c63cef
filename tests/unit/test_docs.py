"""The documentation is true: generated pages are current, links lead somewhere, named configs
exist.
"""

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
    written = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert written == pages()[name], "run scripts/reference_pages.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_lead_somewhere(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    targets = [
        target.split("#")[0] for target in LINK.findall(text) if not re.match(r"\w+:|#", target)
    ]
    assert [target for target in targets if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_anchors_exist(page):
    links = [
        link for link in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))) if "#" in link
    ]
    places = [link.split("#") for link in links if not re.match(r"\w+:", link)]
    headed = [(page.parent / target if target else page, anchor) for target, anchor in places]
    assert [anchor for target, anchor in headed if anchor not in anchors(target)] == []


def anchors(page: Path) -> set[str]:
    """The names of a page's headings in links."""
    headings = re.findall(r"^#+ +(.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_configs_exist(page):
    named = CONFIG.findall(page.read_text(encoding="utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_curve_of_the_tutorial_is_what_its_script_makes():
    """To the last digit but one: the sums of another numpy may round otherwise."""
    script = runpy.run_path(str(ROOT / "scripts" / "make_example_curve"))
    shipped, made = (
        np.loadtxt(io.StringIO(text), delimiter=",", skiprows=2)
        for text in (
            (ROOT / "configs" / "curves" / "thin_gel.csv").read_text(encoding="utf-8"),
            script["text"](),
        )
    )
    np.testing.assert_allclose(made, shipped, atol=2e-3)
