"""Reports: one valid HTML file that needs nothing else, whatever text a result contains."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import html_page
import pytest
from click.testing import CliRunner

from indent_sim.cli import commands
from indent_sim.config.scene_file import load
from indent_sim.results import html_report
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate
from indent_sim.studies.study_report import study_page

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
BY_THEORY = """\
title: {title}
units: {{length: um, force: nN}}
body: {{shape: layer, height: 10 um}}
material: {{model: linear_elastic, E: 1 kPa, nu: 0.3}}
indenter: {{shape: sphere, R: 5 um}}
loading: {{delta: 0.5 um, steps: {steps}}}
"""


def written(
    folder: Path, title: str = "A layer", steps: int = 5, given: tuple[str, ...] = ()
) -> Path:
    """The report of a scene that theory solves; `given` replaces values of it."""
    (folder / "scene.yaml").write_text(BY_THEORY.format(title=title, steps=steps))
    simulate(load(folder / "scene.yaml", given), directory=folder / "out")
    done = CliRunner().invoke(commands.program, ["report", str(folder / "out")])
    assert done.exit_code == 0 and done.stdout.strip() == str(folder / "out" / "report.html"), (
        done.stderr
    )
    return folder / "out" / "report.html"


def check(page: Path) -> str:
    """The text of a page, asserted to be self-contained."""
    text = page.read_text(encoding="utf-8")
    html_page.check(text)
    return text


def test_the_report_of_a_run(tmp_path):
    text = check(written(tmp_path))
    words = (
        "A layer",
        "depth δ",
        "0.5 µm",
        "Rows of force_indentation.csv",
        "Choices and their reasons",
        "Provenance",
        "given as 1 kPa",
        "model: linear_elastic",
        "Sneddon",
        "Warnings",
    )
    assert [word for word in words if word not in text] == []
    assert text.count("<svg") == 3


def test_the_report_of_a_surface_under_tension(tmp_path):
    """The report states gamma/E*: 1.5 um of 2 mN/m on E* = 1 kPa/(1 - 0.25)."""
    given = ("body={shape: half_space, surface_tension: 2 mN/m}", "material.nu=0.5")
    text = check(written(tmp_path, given=given))
    assert (
        "Elastocapillary length gamma/E*: 1.5 µm, " in text
        and "of the expected contact radius." in text
    )


def test_the_report_of_an_experiment(tmp_path):
    scene = Path(__file__).parents[2] / "configs" / "sticky_gel.yaml"
    for words in (
        ["run", str(scene), "--output", str(tmp_path / "gel"), "--quiet"],
        ["report", str(tmp_path / "gel")],
    ):
        assert CliRunner().invoke(commands.program, words).exit_code == 0
    text = check(tmp_path / "gel" / "report.html")
    words = ("History solved by JKR", "Pull-off under depth control", "calibration_error")
    assert [word for word in words if word not in text] == [] and "<img" not in text
    assert text.count("<svg") == 2 and ">time t [s]<" in text


def test_text_of_strangers_stays_text(tmp_path):
    text = check(written(tmp_path, title="'<script>alert(1)</script> $x$ & {{ 7*7 }} \\x1b'"))
    assert (
        "&lt;script&gt;" in text
        and "<script" not in text
        and "49" not in re.search(r"<h1>.*</h1>", text)[0]
    )  # type: ignore[index]


def test_many_rows_are_thinned(tmp_path):
    text = check(written(tmp_path, steps=500))
    assert "100 of 500 rows" in text and ">500<" in text


def test_a_crate_lists_the_files_of_a_result(tmp_path):
    """An RO-Crate 1.1 has an entity for every file of a result, and for the program.

    It replaces no file of a user, and a new run removes ours.
    """
    folder = written(tmp_path).parent
    crate = folder / "ro-crate-metadata.json"
    assert CliRunner().invoke(commands.program, ["report", str(folder), "--crate"]).exit_code == 0
    found = json.loads(crate.read_text())
    entities = {entity["@id"]: entity for entity in found["@graph"]}
    assert found["@context"] == "https://w3id.org/ro/crate/1.1/context"
    assert entities[crate.name]["about"] == {"@id": "./"} and entities["./"]["name"] == "A layer"
    parts = {part["@id"] for part in entities["./"]["hasPart"]}
    assert (
        {"run.json", "config.yaml", "force_indentation.csv", "report.html"}
        <= parts
        <= entities.keys()
    )
    assert entities["run.json"]["contentSize"] == str((folder / "run.json").stat().st_size)
    assert (
        entities["#run"]["object"] == [{"@id": "config.yaml"}]
        and entities["#program"]["name"] == "indent-sim"
    )
    simulate(load(tmp_path / "scene.yaml"), directory=folder)
    assert not crate.exists()
    crate.write_text("mine")
    done = CliRunner().invoke(commands.program, ["report", str(folder), "--crate"])
    assert (
        done.exit_code == 2
        and crate.read_text() == "mine"
        and "was not made by indent-sim" in done.stderr
    )


def test_nothing_to_report(tmp_path):
    for place in (tmp_path, tmp_path / "nowhere"):
        assert CliRunner().invoke(commands.program, ["report", str(place)]).exit_code == 2
    assert not list(tmp_path.iterdir())
    page = written(tmp_path)
    assert (
        CliRunner()
        .invoke(
            commands.program,
            ["report", str(page.parent), "--output", str(tmp_path / "no" / "x.html")],
        )
        .exit_code
        == 2
    )


def test_a_report_replaces_nothing_but_pages(tmp_path):
    folder = written(tmp_path).parent
    for name in ("../scene.yaml", "force_indentation.csv", "new", "new.pdf"):
        before = (folder / name).read_bytes() if (folder / name).exists() else None
        done = CliRunner().invoke(
            commands.program, ["report", str(folder), "--output", str(folder / name)]
        )
        assert done.exit_code == 2
        assert "the name of a report must end in .html or .htm" in done.output
        assert before == ((folder / name).read_bytes() if (folder / name).exists() else None)
    words = ["report", str(folder), "--output", str(tmp_path / "a.HTM")]
    assert CliRunner().invoke(commands.program, words).exit_code == 0


@pytest.mark.parametrize(
    "damage",
    [
        ("study.csv", None),
        ("study.csv", "a,b\n1,2,3\n"),
        ("study.csv", "\xff"),
        ("study.json", "[]"),
        ("study.json", "{"),
        ("study.json", '{"program": "indent-sim", "keys": ["b"]}'),
        (
            "study.csv",
            "index,run,a,status,method,force_error_vs,cpu_s\n1,x,2,done,theory,little,1\n",
        ),
    ],
)
def test_a_damaged_study_is_told(tmp_path, damage):
    name, text = damage
    (tmp_path / "study.json").write_text('{"program": "indent-sim", "keys": ["a"]}')
    (tmp_path / "study.csv").write_text(
        "index,run,a,status,method,force_error_vs,cpu_s\n1,x,2,done,theory,,1\n"
    )
    assert "1 of 1 runs done" in study_page(tmp_path)
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_bytes(text.encode("latin-1"))
    done = CliRunner().invoke(commands.program, ["report", str(tmp_path)])
    assert done.exit_code == 2 and re.search("no readable study|has no result", done.stderr)
    assert not (tmp_path / "report.html").exists()


def test_a_failed_run_says_so_first(tmp_path):
    page = written(tmp_path)
    report = json.loads((page.parent / "run.json").read_text())
    (page.parent / "run.json").write_text(
        json.dumps(report | {"status": "failed", "reason": "step 6: no", "exit_code": 5})
    )
    assert CliRunner().invoke(commands.program, ["report", str(page.parent)]).exit_code == 0
    assert '<p class="bad">failed: step 6: no</p>' in check(page)


def a_study(folder: Path) -> Path:
    """The report of six runs of a scene that theory solves."""
    (folder / "scene.yaml").write_text(BY_THEORY.format(title="A layer", steps=3))
    vary = "{body.height: [5, 10, 20], material.E: [1 kPa, 2 kPa]}"
    (folder / "study.yaml").write_text(f"base: scene.yaml\nvary: {vary}\n")
    out = str(folder / "out")
    for words in (["study", str(folder / "study.yaml"), "--output", out], ["report", out]):
        done = CliRunner().invoke(commands.program, words)
        assert done.exit_code == 0, done.stderr
    return folder / "out" / "report.html"


def test_a_study(tmp_path):
    text = check(a_study(tmp_path))
    assert (
        "6 of 6 runs done" in text and "compared with" not in text and "height=5_E=1_kPa-" in text
    )
    assert text.count("<svg") == 1 and "<img" not in text
    words = (
        ">depth δ [µm]<",
        ">force F [nN]<",
        ">height 5, E 1<",
        ">height [µm]<",
        ">E [nN/µm²]<",
        ">last force F [nN]<",
    )
    assert [word for word in words if word not in text] == []


def test_a_study_whose_runs_are_gone_is_still_told(tmp_path):
    page = a_study(tmp_path)
    shutil.rmtree(page.parent / "runs")
    assert CliRunner().invoke(commands.program, ["report", str(page.parent)]).exit_code == 0
    text = check(page)
    assert "6 of 6 runs done" in text and "<svg" not in text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("width", [400, 1200])
@pytest.mark.parametrize("make", [written, a_study], ids=["run", "study"])
def test_in_a_browser_nothing_stands_out_of_the_page(tmp_path, make, width):
    """In a browser a page is as wide as its window, and its letters are at least 6 px high.

    What does not fit scrolls in its own box. 6 px are left where a picture 110 mm wide is shrunk to
    a window of 400 px.
    """
    page = make(tmp_path)
    each = "[...document.querySelectorAll('{}')].map(s => s.getBoundingClientRect().{})"
    wide, high = each.format("svg", "width"), each.format("svg text", "height")
    told = (
        f"document.documentElement.scrollWidth + ' ' + Math.min(...{wide}) + ' ' + "
        f"Math.min(...{high})"
    )
    script = f"<script>document.title = {told}</script></body>"
    (tmp_path / "probe.html").write_text(page.read_text().replace("</body>", script))
    on_load = 'onload="document.title = this.contentDocument.title"'
    frame = f'<iframe src="probe.html" width="{width}" height="900" {on_load}></iframe>'
    (tmp_path / "frame.html").write_text(f"<!DOCTYPE html><title>x</title>{frame}")
    command = [
        str(CHROMIUM),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--allow-file-access-from-files",
        "--virtual-time-budget=3000",
        "--dump-dom",
        f"file://{tmp_path}/frame.html",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    title = re.search(r"<title>(\d+) ([\d.]+) ([\d.]+)</title>", done.stdout)
    assert title, done.stdout + done.stderr
    assert (
        int(title[1]) <= width and float(title[2]) > 0.7 * min(width, 500) and float(title[3]) > 6
    )


def test_numbers_in_the_page_are_those_of_the_table(tmp_path):
    """The numbers at the top of a page are those of the deepest row, not of the last one."""
    page = written(tmp_path, given=("loading={deltas: [0.2 um, 0.4 um, 0.0]}",))
    deepest = read(tmp_path / "out").table["force"][1]
    numbers = dict(re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", page.read_text("utf-8")))
    assert numbers["depth δ"] == "0.4 µm"
    force, unit = numbers["force F"].split()
    assert float(force) * {"pN": 1e-3, "nN": 1.0}[unit] == pytest.approx(deepest, rel=1e-3)


def test_alike_warnings_are_one_line_with_a_range() -> None:
    """Forty warnings that differ in their numbers alone are one line with a range.

    Warnings of different words stay apart.
    """
    words = "only {:g} elements in the contact radius: the force may be wrong by about {}e-2 %"
    said = [words.format(n / 10, n) for n in range(5, 45)]
    other = ["the contact comes close to the edge of the body", "depth is 12% of the thickness"]
    assert html_report.merge_similar_warnings([*said, *other, *said]) == [
        "only 0.5 to 4.4 elements in the contact radius: the force may be wrong by about "
        "5e-2 to 44e-2 % "
        "(40 such warnings)",
        *other,
    ]
