"""`indent-sim fit`, and measured curves in the other commands: output, files and refusals."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import html_page
import numpy as np
import pytest
from click.testing import CliRunner, Result
from nanoscope_files import PEAKFORCE_CAPTURE

import indent_sim
from indent_sim.cli import commands
from indent_sim.process.installation import afm_command
from indent_sim.results.pictures import figures, forces
from indent_sim.results.reader import read

SCENE = """\
units: {length: um, force: nN}
body: {shape: half_space}
material: {model: linear_elastic, E: 1 kPa, nu: 0.5}
indenter: {shape: paraboloid, R: 5 um}
loading: {delta: 0.5 um, steps: 5}
"""
STUDY = """\
base: scene.yaml
vary: {material.E: [1 kPa, 2 kPa]}
compare_to: curves/c2.csv
"""
Command = Callable[..., Result]


def hertz(depth: np.ndarray, E: float) -> np.ndarray:
    """Force [nN] of a paraboloid of 5 um at depths [um], nu = 0.5."""
    return 4 / 3 * E / 0.75 * np.sqrt(5) * np.maximum(depth, 0) ** 1.5


def write(path: Path, E: float, first: float = -1.0) -> None:
    """Write a curve in nm and pN with a tenth of a per cent of noise and first touch at 0."""
    x = np.linspace(first, 0.6, 400)
    force = hertz(x, E) + 1e-3 * hertz(x, E).max() * np.random.default_rng(1).standard_normal(400)
    rows = "".join(f"{1e3 * a:.6f};{1e3 * b:.6f}\n" for a, b in zip(x, force, strict=True))
    path.write_text("Depth [nm];Load [pN]\n" + rows)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """A function that runs a command in a folder with scene.yaml and curves/."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "study.yaml").write_text(STUDY)
    (tmp_path / "curves").mkdir()
    for E in (1, 2, 4):
        write(tmp_path / "curves" / f"c{E}.csv", E)
    return lambda *words: CliRunner().invoke(commands.program, [str(word) for word in words])


FIT = ("fit", "curves", "--scene", "scene.yaml", "--vary", "material.E")


def test_a_folder_of_curves_in_two_processes(command, tmp_path):
    done = command(*FIT, "--jobs", 2, "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == found["exit_code"] == 0 and found["directory"] == "results/fit-curves"
    for entry, E in zip(found["curves"], (1, 2, 4), strict=True):
        stated = entry["parameters"]["material.E"]
        assert entry["curve"] == f"c{E}" and stated["value"] == pytest.approx(
            E, rel=0.01
        )  # five deviations
    folder = tmp_path / "results" / "fit-curves"
    assert {path.name for path in folder.iterdir()} == {
        ".lock",
        "fit.json",
        "fit.csv",
        "fit.png",
        "curves",
        "pictures",
    }
    assert {path.stem for path in (folder / "pictures").iterdir()} == {"c1", "c2", "c4"}
    again = command(*FIT)
    assert again.exit_code == 0 and "c1" not in again.output
    refused = command("run", "scene.yaml", "--output", folder)
    assert refused.exit_code == 2 and "holds a fit" in refused.output


@pytest.mark.parametrize(
    "words, code, said",
    [
        (("--vary", "material.Q"), 3, "material.Q: is not a number of the scene"),
        (("--columns", "x,force"), 3, "there is no column 'x'"),
        (("--columns", "a"), 3, "has 1 columns"),
        (("--columns", "z=1,weight=2"), 3, "there is no role 'weight'"),
        (("--sensitivity", "50"), 3, "'50' is not a length divided by a voltage"),
        (("--level", "none"), 2, "--level"),
        (("--units", "mass=kg"), 2, "--units mass"),
        (("--segment", "back"), 2, "'back' is not one of"),
        (("--scene", "nothing.yaml"), 2, "cannot read the config"),
        (("--set", "material.E=-1"), 3, "material.E"),
    ],
)
def test_wrong_words_change_nothing(command, tmp_path, words, code, said):
    before = sorted(tmp_path.rglob("*"))
    done = command(*FIT, *words, "--output", "new")
    assert done.exit_code == code and said in done.output
    assert sorted(tmp_path.rglob("*")) == before


def test_no_curve_at_all_is_exit_5(command, tmp_path):
    (tmp_path / "short.csv").write_text("delta,force\n1,2\n2,3\n")
    done = command("fit", "short.csv", "--scene", "scene.yaml", "--vary", "material.E", "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == found["exit_code"] == 5 and found["curves"][0]["reason"] == "2 points"
    missing = command("fit", "nothing.csv", "--scene", "scene.yaml", "--vary", "material.E")
    assert missing.exit_code == 2 and "there is no file nothing.csv" in missing.output


@pytest.mark.parametrize(
    "package, name, data",
    [("afmformats", "curve.ibw", b"PK"), ("pyfmreader", "curve.pfc", PEAKFORCE_CAPTURE)],
)
def test_an_afm_file_without_its_reader_is_exit_7(
    command, tmp_path, monkeypatch, package, name, data
):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    (tmp_path / name).write_bytes(data)
    done = command("fit", name, "--scene", "scene.yaml", "--vary", "material.E")
    assert done.exit_code == 7 and afm_command() in done.output


def test_a_design_says_what_a_measurement_would_tell(command, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    words = ("fit", "--design", "scene.yaml", "--vary", "material.E", "--noise", 0.01)
    found = json.loads(command(*words, "--json").stdout)
    stated = found["parameters"]["material.E"]
    assert found["exit_code"] == 0 and stated["low"] < stated["value"] == 1.0 < stated["high"]
    assert (
        found["tied"] == {"material.E": 1.0}
        and 0.1 <= found["baseline"] <= 1.5
        and found["points"] == 300
    )
    assert [set(one["change"]) for one in found["helps"]] == [
        {"loading.delta"},
        {"indenter.R"},
        {"indenter.R"},
    ]
    told = command(*words, "--points", 1200).stdout
    assert (
        "scene as given" in told and "1200 points, noise" in told and "loading.delta = 1 " in told
    )
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "words, code, said",
    [
        (("--design", "scene.yaml"), 2, "needs --noise"),
        (("--noise", "0.01"), 2, "require --design"),
        ((), 2, "needs CURVE_OR_FOLDER"),
        (("--design", "scene.yaml", "--noise", "0"), 2, "is not in the range"),
        (("curves", "--design", "scene.yaml", "--noise", "0.01"), 2, "takes no curves"),
        (("--design", "nothing.yaml", "--noise", "0.01"), 2, "cannot read the config"),
        (
            ("--design", "scene.yaml", "--noise", "0.01", "--vary", "loading.delta"),
            3,
            "loading.delta: cannot be determined from a measured curve",
        ),
        (
            ("--design", "scene.yaml", "--noise", "0.01", "--set", "loading.delta=-1"),
            3,
            "loading.delta",
        ),
    ],
)
def test_a_design_with_wrong_words(command, words, code, said):
    done = command("fit", "--vary", "material.E", *words)
    assert done.exit_code == code and said in done.output, done.output


def test_what_a_scene_requires_for_a_curve(command, tmp_path):
    """`require --curve` says the same as for the scene with the curve's modulus and depth.

    It also names the models of the curve's fit.
    """
    words = ("require", "scene.yaml", "--curve", "curves/c2.csv")
    found = json.loads(command(*words, "--json").stdout)
    curve = found["curve"]
    stated = curve["parameters"]["material.E"]
    assert stated["low"] < 2 < stated["high"] and curve["depth"] == pytest.approx(0.6, abs=0.01)
    there = (
        "--set",
        f"material.E={stated['value']!r}",
        "--set",
        f"loading.delta={curve['depth']!r}",
    )
    assert (
        found["effects"]
        == json.loads(command("require", "scene.yaml", *there, "--json").stdout)["effects"]
    )
    models = {one["name"]: one for one in found["models"]}
    assert set(models) == {"thickness", "adhesion", "tip"} and {
        one["verdict"] for one in found["models"]
    } == {"not excluded"}
    assert models["thickness"]["low"] < 2 and "body.height" in models["thickness"]["parameters"]


@pytest.mark.parametrize(
    "words, code, said",
    [
        (("--curve", "short.csv"), 5, "short.csv: 2 points"),
        (("--curve", "nothing.csv"), 2, "cannot read nothing.csv"),
        (("--columns", "a,b"), 2, "require --curve"),
        (("--curve", "short.csv", "--columns", "x,y"), 3, "no column 'x'"),
        (("--curve", "short.csv", "--set", "material.E=-1"), 3, "material.E"),
    ],
)
def test_a_curve_that_requires_nothing(command, tmp_path, words, code, said):
    (tmp_path / "short.csv").write_text("delta,force\n1,2\n2,3\n")
    done = command("require", "scene.yaml", *words)
    assert done.exit_code == code and said in done.output, done.output


def test_a_way_without_a_spring_is_warned_of(command, tmp_path):
    text = (tmp_path / "curves" / "c2.csv").read_text().replace("Depth [nm]", "z [nm]")
    (tmp_path / "way.csv").write_text(text)
    done = command(
        "fit", "way.csv", "--scene", "scene.yaml", "--vary", "material.E", "--output", "way"
    )
    assert done.exit_code == 0 and "warning: no spring is known" in done.stderr


def test_results_and_curves_side_by_side(command, tmp_path):
    write(tmp_path / "pressed.csv", 2, first=0.0)
    assert (
        command("run", "scene.yaml", "--set", "material.E=2 kPa", "--output", "two").exit_code == 0
    )
    done = command("compare", "two", "pressed.csv", "--rtol", "force=0.05", "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == 0 and found["interpolated"]["curve"] == "pressed.csv"
    assert (
        found["residual"]["percent_largest"] < 0.5
    )  # noise of a tenth of a per cent, four deviations
    told = command("compare", "pressed.csv", "two", "--rtol", "force=0.05")
    assert told.exit_code == 0 and "pressed.csv interpolated in depth" in told.stdout
    assert command("compare", "two", "curves/c4.csv", "--rtol", "0.05").exit_code == 6


def test_a_picture_of_a_result_and_a_curve_has_their_units_and_no_empty_panel(
    command, tmp_path, monkeypatch
):
    assert command("run", "scene.yaml", "--output", "one").exit_code == 0
    figures = []
    monkeypatch.setattr(forces, "save", lambda figure, path: figures.append(figure))
    both = [read(tmp_path / "one"), read(tmp_path / "curves" / "c1.csv")]
    forces.draw_overlay(both, tmp_path / "both.png")
    forces.draw_overlay(both[1:], tmp_path / "alone.png")
    labels = [
        [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()] for figure in figures
    ]
    assert labels == [["force F [nN]", "contact radius a [µm]"], ["force F [pN]"]]
    x = next(
        line.get_xdata() for line in figures[0].axes[0].get_lines() if len(line.get_xdata()) == 400
    )
    assert x[-1] == pytest.approx(0.6, rel=1e-6)  # um, as the scene


def test_a_tab_file_is_fitted_as_what_it_was(command, tmp_path):
    assert (
        command("run", "scene.yaml", "--set", "loading.steps=60", "--output", "one").exit_code == 0
    )
    assert command("plot", "one", "--output", "one.tab").stdout == "one.tab\n"
    done = command(
        "fit",
        "one.tab",
        "--scene",
        "scene.yaml",
        "--vary",
        "material.E",
        "--set",
        "output.plot=false",
        "--json",
    )
    stated = json.loads(done.stdout)["curves"][0]["parameters"]["material.E"]
    assert stated["value"] == pytest.approx(1.0, rel=1e-5)  # 13 digits, a table of 1e-7
    assert command("plot", "one", "curves/c1.csv", "--output", "two.tab").exit_code == 2


def test_a_study_compared_with_a_measured_curve(command, tmp_path):
    done = command("study", "study.yaml", "--output", "study", "--json")
    rows = json.loads(done.stdout)["rows"]
    assert done.exit_code == 0, done.output
    off = [row["force_error_vs"] for row in rows]
    assert off[0] == pytest.approx(-0.5, abs=0.01) and off[1] == pytest.approx(
        0.0, abs=0.01
    )  # noise of 0.1 %


def test_the_report_of_a_fit_is_one_page_by_itself(command, tmp_path):
    (tmp_path / "curves" / "short.csv").write_text("delta,force\n1,2\n2,3\n")
    assert command(*FIT, "--set", "title=<b>gel</b>", "--output", "out").exit_code == 0
    assert command("report", "out").stdout == "out/report.html\n"
    text = (tmp_path / "out" / "report.html").read_text()
    html_page.check(text)
    assert "<b>gel" not in text and "&lt;b&gt;gel" in text
    told = (
        "scene.yaml fitted to 4 curves",
        "3 of 4 curves fitted",
        "short: refused, 2 points",
        "Rows of fit.csv",
    )
    for words in (*told, "c2: E = 2.0", "title: "):
        assert words in text, words
    assert text.count("<svg") == 4
    again = command(*FIT, "--set", "title=<b>gel</b>", "--output", "out")
    assert again.exit_code == 0 and command("report", "out", "--output", "page.html").exit_code == 0


def test_the_report_of_one_curve_has_its_windows_and_models(command, tmp_path):
    """The report of a curve that stiffens with depth shows windows and other models.

    The stiffening is like that over a substrate. The picture is drawn from the curve's table.
    """
    table = np.loadtxt(tmp_path / "curves" / "c2.csv", delimiter=";", skiprows=1)
    table[:, 1] *= 1 + 0.8 * np.maximum(table[:, 0] / 600, 0)
    np.savetxt(
        tmp_path / "stiff.csv", table, delimiter=";", header="Depth [nm];Load [pN]", comments=""
    )
    assert command("fit", "stiff.csv", *FIT[2:], "--output", "one").exit_code == 0
    assert command("report", "one").exit_code == 0
    text = (tmp_path / "one" / "report.html").read_text()
    html_page.check(text)
    named = json.loads((tmp_path / "one" / "fit.json").read_text())["curves"][0]["cause"]
    assert {"thickness", "tip"} & set(named)
    assert all(f"{name} instead" in text for name in named if name in ("thickness", "tip"))
    assert (
        "Fits to a part of the depth" in text and "Other models" in text and text.count("<svg") == 1
    )


@pytest.mark.parametrize(
    "damage",
    [{}, {"curves": 3}, {"curves": [{"status": "done"}]}, {"request": {"scene": {"body": 1}}}],
)
def test_a_damaged_fit_has_no_report(command, tmp_path, damage):
    assert command("fit", "curves/c1.csv", *FIT[2:], "--output", "out").exit_code == 0
    path = tmp_path / "out" / "fit.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | damage if damage else {"program": record["program"]}))
    done = command("report", "out")
    assert done.exit_code == 2 and "out contains no readable fit" in done.output, done.output


def test_the_figure_of_a_notebook(command, tmp_path):
    found = indent_sim.fit(
        tmp_path / "curves" / "c2.csv", tmp_path / "scene.yaml", vary=["material.E"]
    )
    figure = found.figure()
    assert len(figure.axes) == 3
    with figures.new_figure():
        figures.save(figure, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
