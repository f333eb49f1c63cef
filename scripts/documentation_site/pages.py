"""Sources of the site: the pages of docs/ with links that lead to the places of the site."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import yaml

CODE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)#\s])")
# Pages at the root of the repository and their names on the site.
ROOT_PAGES = {
    "CHANGELOG.md": "changes.md",
    "CONTRIBUTING.md": "contributing.md",
}
# Parts of the repository from which the site is made.
PARTS = ("docs", "configs", "indent_sim", "README.md", "CITATION.cff", "LICENSE", *ROOT_PAGES)
NAVIGATION = Path(__file__).with_name("navigation.yaml")
GALLERY_MARK = "<!-- gallery -->"


def write_sources(root: Path, source: Path) -> None:
    """Write all pages of a checkout but the gallery into a new folder.

    Links between pages stay as they are; those to other files of the repository lead to copies of
    the files.
    """
    shutil.copytree(root / "docs" / "images", source / "images")
    for page in sorted((root / "docs").rglob("*.md")):
        copy_page(root, page, source, page.relative_to(root / "docs"))
    for name, site_name in ROOT_PAGES.items():
        copy_page(root, root / name, source, Path(site_name))
    if not (source / "index.md").exists():
        copy_page(root, root / "README.md", source, Path("index.md"))
    decisions = sorted(page.stem for page in (source / "decisions").glob("*.md"))
    text = "# Decisions\n\nReasons for what is not obvious.\n\n```{toctree}\n:maxdepth: 1\n\n"
    text += "\n".join(decisions) + "\n```\n"
    (source / "decisions" / "index.md").write_text(text, encoding="utf-8")


def copy_page(root: Path, page: Path, source: Path, name: Path) -> None:
    """Copy a page to its place on the site, with its links."""
    target = source / name
    to_root = "../" * (len(name.parts) - 1)

    def moved(match: re.Match[str]) -> str:
        """Return where a link of the page leads on the site."""
        link = match[1]
        if re.match(r"\w+:", link):
            return link
        file = (page.parent / link).resolve().relative_to(root.resolve())
        return to_root + site_place(root, file, source)

    parts = CODE.split(page.read_text(encoding="utf-8"))
    # Every second part is code.
    parts[::2] = [LINK.sub(moved, part) for part in parts[::2]]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("".join(parts), encoding="utf-8")


def site_place(root: Path, file: Path, source: Path) -> str:
    """Return the place of a file of the repository on the site, and copy it if it is no page."""
    name = file.as_posix()
    if name in ROOT_PAGES:
        return ROOT_PAGES[name]
    if name == "README.md":
        return "index.md"
    if name == "docs/decisions":
        return "decisions/index.md"
    if name.startswith("docs/"):
        return name.removeprefix("docs/")
    copy = source / "files" / file
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(root / file, copy)
    return f"files/{name}"


def add_navigation(source: Path, home_cards: str) -> None:
    """Add the sections of the navigation, and some pictures, to the home page."""
    home = source / "index.md"
    text = home.read_text(encoding="utf-8").replace(GALLERY_MARK, home_cards)
    sections = yaml.safe_load(NAVIGATION.read_text(encoding="utf-8"))
    for caption, names in sections.items():
        there = [name for name in names if (source / f"{name}.md").exists()]
        listed = "\n".join(there)
        text += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{listed}\n```\n"
    home.write_text(text, encoding="utf-8")


def link_scenes(source: Path, names: list[str]) -> None:
    """Let the list of shipped scenes lead to their pages in the gallery."""
    page = source / "scenes.md"
    text = page.read_text(encoding="utf-8")
    for name in names:
        text = text.replace(
            f"| `configs/{name}.yaml` |", f"| [`configs/{name}.yaml`](gallery/{name}.md) |"
        )
    page.write_text(text, encoding="utf-8")
