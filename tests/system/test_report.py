"""Reports: one valid HTML file with nothing outside of it, whatever text a stranger put into the result."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import html5lib
import numpy as np
import pytest
from click.testing import CliRunner
from test_plots import a_result

from indent_sim.cli import commands
from indent_sim.config.file import load
from indent_sim.run.chain import simulate

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
BY_THEORY = """\
title: {title}
units: {{length: um, force: nN}}
body: {{shape: layer, height: 10 um}}
material: {{model: linear_elastic, E: 1 kPa, nu: 0.3}}
indenter: {{shape: sphere, R: 5 um}}
loading: {{delta: 0.5 um, steps: {steps}}}
"""


def written(folder: Path, title: str = "A layer", steps: int = 5) -> Path:
    """The report of a scene that theory solves."""
    (folder / "scene.yaml").write_text(BY_THEORY.format(title=title, steps=steps))
    simulate(load(folder / "scene.yaml"), directory=folder / "out")
    done = CliRunner().invoke(commands.program, ["report", str(folder / "out")])
    assert done.exit_code == 0 and done.stdout.strip() == str(folder / "out" / "report.html"), done.stderr
    return folder / "out" / "report.html"


class Outside(HTMLParser):
    """What a page would load from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag, attrs) -> None:
        if tag in ("script", "link", "iframe", "object", "embed", "base", "form"):
            self.found.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "srcset", "data") and not (value or "").startswith(("#", "data:")):
                self.found.append(f"{tag} {name}={value}")


def check(page: Path) -> str:
    """A page that stands alone: valid HTML 5, below 2 MB, no name twice, nothing loaded."""
    text = page.read_text(encoding="utf-8")
    html5lib.HTMLParser(strict=True).parse(text)
    outside = Outside()
    outside.feed(text)
    assert outside.found == [] and "http" not in re.sub(r"<pre>.*?</pre>", "", text, flags=re.DOTALL)
    assert not re.search(r"url\((?!#)", text) and "@import" not in text
    names = re.findall(r'\bid="([^"]*)"', text)
    assert len(names) == len(set(names)) and {f"#{name}" for name in names} >= set(re.findall(r"url\((#[^)]*)\)", text))
    assert len(text.encode()) < 2_000_000
    return text


def test_the_report_of_a_run(tmp_path):
    text = check(written(tmp_path))
    words = ("A layer", "depth δ", "0.5 µm", "Rows of force_indentation.csv", "Choices and their reasons", "Provenance",
             "given as 1 kPa", "model: linear_elastic", "Sneddon", "What to keep in mind")  # fmt: skip
    assert [word for word in words if word not in text] == []
    assert text.count("<svg") == 3


def test_the_report_of_an_experiment(tmp_path):
    scene = Path(__file__).parents[2] / "configs" / "sticky_gel.yaml"
    for words in (["run", str(scene), "--output", str(tmp_path / "gel"), "--quiet"], ["report", str(tmp_path / "gel")]):
        assert CliRunner().invoke(commands.program, words).exit_code == 0
    text = check(tmp_path / "gel" / "report.html")
    words = ("A Hertz fit of this curve reads E = 10.79", "Pull-off under depth control", "Rows of experiment.csv")
    assert [word for word in words if word not in text] == [] and "<img" not in text
    assert text.count("<svg") == 4 and ">time t<" in text


def test_text_of_strangers_stays_text(tmp_path):
    text = check(written(tmp_path, title="'<script>alert(1)</script> $x$ & {{ 7*7 }} \\x1b'"))
    assert "&lt;script&gt;" in text and "<script" not in text and "49" not in re.search(r"<h1>.*</h1>", text)[0]  # type: ignore[index]


def test_many_rows_are_thinned(tmp_path):
    text = check(written(tmp_path, steps=500))
    assert "100 of 500 rows" in text and ">500<" in text


def test_nothing_to_report(tmp_path):
    for place in (tmp_path, tmp_path / "nowhere"):
        assert CliRunner().invoke(commands.program, ["report", str(place)]).exit_code == 2
    assert not list(tmp_path.iterdir())
    page = written(tmp_path)
    assert (
        CliRunner()
        .invoke(commands.program, ["report", str(page.parent), "--output", str(tmp_path / "no" / "x.html")])
        .exit_code
        == 2
    )


@pytest.mark.parametrize("damage", [
    ("study.csv", None), ("study.csv", "a,b\n1,2,3\n"), ("study.csv", "\xff"), ("study.json", "[]"),
    ("study.json", "{"),
])  # fmt: skip
def test_a_damaged_study_is_told(tmp_path, damage):
    name, text = damage
    (tmp_path / "study.json").write_text('{"program": "indent-sim", "keys": ["a"]}')
    (tmp_path / "study.csv").write_text("index,run,a,status\n1,x,2,done\n")
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_bytes(text.encode("latin-1"))
    done = CliRunner().invoke(commands.program, ["report", str(tmp_path)])
    assert done.exit_code == 2 and "no study that can be read" in done.stderr
    assert not (tmp_path / "report.html").exists()


def test_a_failed_run_says_so_first(tmp_path):
    page = written(tmp_path)
    report = json.loads((page.parent / "run.json").read_text())
    (page.parent / "run.json").write_text(
        json.dumps(report | {"status": "failed", "reason": "step 6: no", "exit_code": 5})
    )
    assert CliRunner().invoke(commands.program, ["report", str(page.parent)]).exit_code == 0
    assert '<p class="bad">failed: step 6: no</p>' in check(page)


def test_a_study(tmp_path):
    (tmp_path / "scene.yaml").write_text(BY_THEORY.format(title="A layer", steps=3))
    (tmp_path / "study.yaml").write_text(
        "base: scene.yaml\nvary: {body.height: [5, 10, 20], material.nu: [0.3, 0.5]}\n"
    )
    invoke = CliRunner().invoke
    assert (
        invoke(commands.program, ["study", str(tmp_path / "study.yaml"), "--output", str(tmp_path / "out")]).exit_code
        == 0
    )
    done = invoke(commands.program, ["report", str(tmp_path / "out"), "--output", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.stderr
    text = check(tmp_path / "page.html")
    assert "6 of 6 runs done" in text and "compared with" not in text and "height=5_nu=0.3-" in text
    assert text.count("<svg") == 1 and "<img" not in text
    words = (">depth δ [µm]<", ">force F [nN]<", ">height 5, nu 0.3<", ">height<", ">last force F [nN]<")
    assert [word for word in words if word not in text] == []


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("width", [400, 1200])
def test_in_a_browser_nothing_stands_out_of_the_page(tmp_path, width):
    """As wide as the window, whatever its width: what does not fit scrolls in its own box."""
    page = written(tmp_path)
    widths = "[...document.querySelectorAll('svg')].map(s => s.getBoundingClientRect().width)"
    script = f"document.title = document.documentElement.scrollWidth + ' ' + Math.min(...{widths})"
    (tmp_path / "probe.html").write_text(page.read_text().replace("</body>", f"<script>{script}</script></body>"))
    told = 'onload="document.title = this.contentDocument.title"'
    frame = f'<iframe src="probe.html" width="{width}" height="900" {told}></iframe>'
    (tmp_path / "frame.html").write_text(f"<!DOCTYPE html><title>x</title>{frame}")
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files",
               "--virtual-time-budget=3000", "--dump-dom", f"file://{tmp_path}/frame.html"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    title = re.search(r"<title>(\d+) ([\d.]+)</title>", done.stdout)
    assert title, done.stdout + done.stderr
    assert int(title[1]) <= width and float(title[2]) > 0.7 * min(width, 500)


def test_numbers_in_the_page_are_those_of_the_table():
    """The deepest row, not the last: after unloading that is empty."""
    from indent_sim.results.report import _numbers

    result = a_result(units={"length": "m", "force": "N"})
    result.table["force"][-1], result.table["delta"][-1] = 0.0, 0.0
    assert dict(_numbers(result))["depth δ"] == "40 µm"
    assert np.isclose(float(dict(_numbers(result))["force F"].split()[0]), 1e3 * (4e-5) ** 1.5 * 1e6, rtol=1e-3)
