"""The documentation is true: pages are current, links and named files exist, versions agree."""

from __future__ import annotations

import io
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml
from reference_pages import pages

from indent_sim.process.version import VERSION

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)")
# Folder and name, as in configs/hertz.yaml, scripts/setup or fe/problem.py.
NAMED_PATH = re.compile(r"(?<![\w./-])(?:[\w.-]+/)+[\w.-]*\w")
# Where named files are: in the repository, or in the package. `results` is the folder of a user.
FOLDERS = {"configs", "docs", "indent_sim", "scripts", "tests"}
PACKAGES = {path.parent.name for path in ROOT.glob("indent_sim/*/__init__.py")} - {"results"}
# A file of another program.
NOT_OURS = {"tools/synthetic.py"}
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


def test_named_files_exist():
    """Every path that the documentation names exists.

    Paths are relative to the repository, to the package or to the page; `.py` may be missing.
    """
    missing = [
        (page, name)
        for page in PAGES
        for name in named_paths(page)
        if not any(
            (folder / f"{name}{end}").exists()
            for folder in (ROOT, ROOT / "indent_sim", page.parent)
            for end in ("", ".py")
        )
    ]
    assert missing == []


def named_paths(page: Path) -> set[str]:
    """Paths in the text of a page that are names of our own files and folders."""
    names = set(NAMED_PATH.findall(page.read_text(encoding="utf-8"))) - NOT_OURS
    return {
        name for name in names if name.endswith(".py") or name.split("/")[0] in FOLDERS | PACKAGES
    }


def test_all_places_state_one_version():
    """A release is dated in CITATION.cff and CHANGELOG.md alike."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, released = re.findall(r"^## (.*)$", changelog, re.MULTILINE)[:2]
    assert project["version"] == citation["version"] == VERSION
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text(encoding="utf-8")
    assert f'set version = "{VERSION}"' in recipe
    assert unreleased == "Unreleased"
    assert released == f"{VERSION} ({citation['date-released']})"


def test_the_paper_cites_what_its_bibliography_has():
    """Every citation has an entry with a DOI, every entry is cited, and every figure exists."""
    paper = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
    entries = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8").split("\n@")
    keys = {re.search(r"\{(\w+),", entry)[1] for entry in entries}
    assert keys == set(re.findall(r"@(\w+)[\];]", paper))
    assert all("doi={10." in entry for entry in entries)
    figures = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", paper)
    assert figures
    assert all((ROOT / "paper" / figure).exists() for figure in figures)


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


def test_the_curve_of_fused_silica_is_what_its_script_makes():
    """The shipped test of fused silica is what `scripts/make_example_loop` makes.

    The tolerance is a unit of the last digit, which may be rounded differently.
    """
    script = runpy.run_path(str(ROOT / "scripts" / "make_example_loop"))
    file = ROOT / "configs" / "curves" / "fused_silica.csv"
    shipped = np.loadtxt(file, delimiter=",", skiprows=2)
    made = np.loadtxt(io.StringIO(script["text"]()), delimiter=",", skiprows=2)
    np.testing.assert_allclose(made, shipped, atol=1.1e-3)
