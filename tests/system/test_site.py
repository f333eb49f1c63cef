"""The site of the documentation builds without a warning, and its gallery is what the scenes give.

Ten scenes are enough for the gallery; those without a long path are chosen.
"""

from __future__ import annotations

import csv
import functools
import html
import http.server
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from command_line import ROOT

from indent_sim import read

SCENES = (
    "cone",
    "flat_punch",
    "half_space",
    "hertz",
    "plane_strain",
    "profile",
    "rounded_punch",
    "sphere",
    "tense_gel",
    "wide_layer",
)
PATIENCE = 1200  # s, for a busy machine
PHONE = 390  # pixels
# Widths of all pages, each of which is shown in a frame as wide as a telephone.
WIDTHS = """<!doctype html><body><pre id="found"></pre><script>
(async () => {
  const wide = [];
  for (const page of PAGES) {
    const frame = document.createElement("iframe");
    frame.width = WIDTH;
    frame.src = page;
    document.body.append(frame);
    await new Promise((loaded) => { frame.onload = loaded; });
    const width = frame.contentDocument.documentElement.scrollWidth;
    if (width > WIDTH) wide.push(page + " " + width);
    frame.remove();
  }
  document.getElementById("found").textContent = "wide:" + JSON.stringify(wide);
})();
</script>"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a site of this checkout with ten scenes in its gallery."""
    missing = [name for name in ("sphinx", "myst_parser", "furo") if not installed(name)]
    if missing:
        pytest.skip(f"{missing[0]} is not installed: SITE=1 scripts/setup")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(ROOT / "scripts" / "make_site"), "--folder", str(folder)]
    command += ["--no-releases", "--scenes", ",".join(SCENES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "html" / "now"


def installed(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


def test_the_site_has_home_search_reference_and_gallery(site: Path) -> None:
    home = (site / "index.html").read_text(encoding="utf-8")
    assert "Which command do I need?" in home and "gallery/hertz.html" in home
    assert (site / "searchindex.js").stat().st_size > 100_000
    functions = (site / "api.html").read_text(encoding="utf-8")
    assert 'id="simulate"' in functions
    theory = (site / "theory.html").read_text(encoding="utf-8")
    half = r"<mfrac[^>]*>\s*<mn>1</mn>\s*<mn>2</mn>\s*</mfrac>"  # LaTeX: \tfrac12
    assert re.search(half, theory)
    assert not re.search(r"<mfrac[^>]*>\s*<mn>12</mn>", theory)
    pages = [file.read_text(encoding="utf-8") for file in site.rglob("*.html")]
    assert not any(re.search(r'<(script|link|img)[^>]*(src|href)="https?:', page) for page in pages)


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_of_the_gallery_gives_the_rows_and_the_picture_beside_it(
    site: Path, name: str, tmp_path: Path
) -> None:
    """The scene that a reader copies from the page gives its rows, and its commands its picture.

    The rows are equal to rounding: one installation has made both. Pixels of a picture are equal,
    because matplotlib draws the same numbers in the same way.
    """
    page = (site / "gallery" / f"{name}.html").read_text(encoding="utf-8")
    shell, scene = (code_of(block) for block in re.findall(r"<pre>(.*?)</pre>", page, re.S)[:2])
    assert shell.splitlines()[0] == f"indent-sim run configs/{name}.yaml"
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / f"{name}.yaml").write_text(scene, encoding="utf-8")
    for command in shell.splitlines():
        words = [sys.executable, "-m", "indent_sim.cli.start", *command.split()[1:]]
        size = ["--width", "180", "--dpi", "130", "--output", "picture.png"]
        words += size if command.startswith("indent-sim plot") else []
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, timeout=PATIENCE)
    (file,) = (site / "_downloads").rglob(f"{name}.csv")
    with file.open(newline="", encoding="utf-8") as rows:
        shown = list(csv.DictReader(rows))
    result = read(tmp_path / "results" / name)
    for column in ("delta", "force"):
        expected = [float(row[column]) for row in shown]
        np.testing.assert_allclose(result[column], expected, rtol=1e-12)
    picture = site / "_images" / f"gallery-{name}.png"
    assert picture.read_bytes() == (tmp_path / "picture.png").read_bytes()


def code_of(block: str) -> str:
    """Text of a block of code in a page."""
    return html.unescape(re.sub(r"<[^>]*>", "", block))


def test_no_page_is_wider_than_a_telephone(site: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium")
    if browser is None:
        pytest.skip("chromium is not installed")
    names = [str(file.relative_to(site)) for file in sorted(site.rglob("*.html"))]
    page = WIDTHS.replace("PAGES", json.dumps(names)).replace("WIDTH", str(PHONE))
    (site / "widths.html").write_text(page, encoding="utf-8")

    class Quiet(http.server.SimpleHTTPRequestHandler):
        """Server of files without messages."""

        def log_message(self, *words: object) -> None:
            """Write nothing."""

    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Quiet, directory=str(site))
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_address[1]}/widths.html"
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    command += ["--virtual-time-budget=120000", f"--user-data-dir={tmp_path}", address]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    server.shutdown()
    (site / "widths.html").unlink()
    found = re.search(r">wide:(.*?)</pre>", done.stdout)
    assert found, done.stderr
    assert json.loads(html.unescape(found[1])) == []
