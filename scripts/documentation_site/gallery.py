"""Gallery of the site: every scene of configs/ with the picture and the rows that it gives."""

from __future__ import annotations

import csv
import hashlib
import html
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

PATIENCE = 900  # s for one scene on a busy machine
# Packages on whose version pictures and rows depend, where they are installed.
PACKAGES = ("numpy", "scipy", "matplotlib", "fenics-dolfinx", "gmsh")
# Columns of the rows on a page, in this order, where a run has them.
COLUMNS = ("step", "t", "delta", "force", "a", "p_max")
MOST_ROWS = 12
# Panels of a run with fields; without fields `plot` chooses.
PANELS = "force,fields"


@dataclass(frozen=True)
class Scene:
    """A scene of configs/ with the folder of its picture `picture.png` and rows `rows.csv`."""

    name: str
    text: str
    folder: Path

    @property
    def document(self) -> dict[str, Any]:
        """The scene as dictionaries."""
        return dict(yaml.safe_load(self.text))

    @property
    def title(self) -> str:
        """The title of the scene."""
        return str(self.document["title"])

    @property
    def comment(self) -> str:
        """The comment at the top of the file, or below its title, on one line."""
        lines = [line for line in self.text.splitlines() if not line.startswith("title:")]
        words = []
        for line in lines:
            if not line.startswith("#"):
                break
            words.append(line.lstrip("# "))
        return " ".join(words)


def scenes(root: Path, cache: Path, names: Iterable[str]) -> list[Scene]:
    """Return the scenes of a checkout with their pictures; those of `names`, without names all.

    Parameters
    ----------
    root
        Folder with indent_sim and configs, which computes the scenes.
    cache
        Folder that keeps the pictures and rows of every scene, below a hash of the scene, of the
        sources of the program and of the versions of the libraries.
    names
        Names of files in configs/ without their ending.
    """
    files = sorted((root / "configs").glob("*.yaml"))
    wanted = set(names) or {file.stem for file in files}
    unknown = wanted - {file.stem for file in files}
    if unknown:
        raise SystemExit(f"make_site: no scene {', '.join(sorted(unknown))} in configs/")
    program = program_hash(root)
    return [scene_of(root, file, cache, program) for file in files if file.stem in wanted]


def program_hash(root: Path) -> str:
    """Return a hash of the sources of the program and of the versions of the libraries."""
    digest = hashlib.sha256()
    for file in sorted((root / "indent_sim").rglob("*.py")):
        digest.update(file.read_bytes())
    digest.update(PANELS.encode())
    for name in PACKAGES:
        digest.update(f"{name} {version_of(name)}".encode())
    return digest.hexdigest()


def version_of(package: str) -> str:
    """Return the version of a package; empty if it is not known to Python's package index."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def scene_of(root: Path, file: Path, cache: Path, program: str) -> Scene:
    """Return a scene with its folder in the cache, which is made if it is not there."""
    digest = hashlib.sha256(program.encode())
    # A scene may name a mesh file beside it, which has the same name.
    for part in sorted(file.parent.glob(f"{file.stem}.*")):
        digest.update(part.read_bytes())
    folder = cache / f"{file.stem}-{digest.hexdigest()[:16]}"
    if not folder.exists():
        compute(root, file, folder)
    return Scene(file.stem, file.read_text(encoding="utf-8"), folder)


def compute(root: Path, file: Path, folder: Path) -> None:
    """Run a scene and draw its picture; the folder appears when both are complete."""
    print(f"make_site: running {file.name}", flush=True)
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    result = unfinished / "run"
    program(root, "run", file, "--output", result, "--quiet", "--set", "output.plot=false")
    panels = ["--what", PANELS] if (result / "fields.xdmf").exists() else []
    size = ["--width", "180", "--dpi", "130"]
    program(root, "plot", result, *panels, *size, "--output", unfinished / "picture.png")
    shutil.copy(result / "force_indentation.csv", unfinished / "rows.csv")
    (unfinished / "panels").write_text(" ".join(panels))
    shutil.rmtree(result)
    unfinished.rename(folder)


def program(root: Path, *words: str | Path) -> None:
    """Run a command of a checkout; a failure ends the build."""
    command = [sys.executable, "-m", "indent_sim.cli.start", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(root), "MPLBACKEND": "agg"}
    done = subprocess.run(
        command, cwd=root, env=environment, capture_output=True, text=True, timeout=PATIENCE
    )
    if done.returncode:
        raise SystemExit(f"make_site: {' '.join(command)}\n{done.stderr}")


def write_pages(shown: list[Scene], source: Path) -> None:
    """Write gallery.md and a page for each scene into the source folder of a site."""
    folder = source / "gallery"
    (folder / "files").mkdir(parents=True)
    for scene in shown:
        shutil.copy(scene.folder / "picture.png", folder / "files" / f"gallery-{scene.name}.png")
        shutil.copy(scene.folder / "rows.csv", folder / "files" / f"{scene.name}.csv")
        (folder / f"{scene.name}.md").write_text(scene_page(scene), encoding="utf-8")
    listed = "\n".join(f"gallery/{scene.name}" for scene in shown)
    text = (
        "# Gallery\n\nEach picture is drawn from the scene on its page, by the program, when this "
        "site is built.\n\n"
        f"{cards(shown, '')}\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
    )
    (source / "gallery.md").write_text(text, encoding="utf-8")


def cards(shown: Iterable[Scene], to_root: str) -> str:
    """Return pictures with titles, each of which leads to the page of its scene, as HTML."""
    return "\n".join(
        [
            '<div class="gallery">',
            *(
                f'<a href="{to_root}gallery/{scene.name}.html">'
                f'<img src="{to_root}_images/gallery-{scene.name}.png" loading="lazy" alt="">'
                f"<span>{html.escape(scene.title)}</span></a>"
                for scene in shown
            ),
            "</div>",
        ]
    )


def scene_page(scene: Scene) -> str:
    """Return the page of a scene: picture, commands, scene file and rows."""
    panels = (scene.folder / "panels").read_text(encoding="utf-8")
    plot = f"indent-sim plot results/{scene.name} {panels}".strip()
    lines = [
        f"# {scene.title}\n",
        f"{scene.comment}\n" if scene.comment else "",
        f"![Picture of the scene](files/gallery-{scene.name}.png)\n",
        f"```sh\nindent-sim run configs/{scene.name}.yaml\n{plot}\n```\n",
        f"`configs/{scene.name}.yaml`:\n",
        f"```yaml\n{scene.text.rstrip()}\n```\n",
        f"## Rows\n\n{rows_table(scene)}\n",
        f"All columns and digits: [rows]({'files/' + scene.name + '.csv'}). The meaning of the "
        "columns is in [conventions](../conventions.md).\n",
    ]
    return "\n".join(line for line in lines if line)


def rows_table(scene: Scene) -> str:
    """Return the last rows of a run with its most important columns and their units."""
    with (scene.folder / "rows.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = [name for name in COLUMNS if name in rows[0]]
    table = [columns, ["---:"] * len(columns)]
    table += [[short(row[name]) for name in columns] for row in rows[-MOST_ROWS:]]
    text = "\n".join(f"| {' | '.join(cells)} |" for cells in table)
    units = scene.document.get("units")
    stated = ", ".join(f"{kind} in {unit}" for kind, unit in (units or {}).items())
    said = f"The last {MOST_ROWS} of {len(rows)} rows. " if len(rows) > MOST_ROWS else ""
    said += f"Units: {stated}." if stated else "The scene is without units."
    return f"{text}\n\n{said}"


def short(cell: str) -> str:
    """Return a number with six digits; an empty cell stays empty."""
    return f"{float(cell):.6g}" if cell else ""
