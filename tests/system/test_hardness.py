"""`indent-sim hardness`: its page, measured and simulated curves, and files that are refused."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Callable
from math import pi
from pathlib import Path

import hostile_curves
import numpy as np
import pytest
from click.testing import CliRunner, Result
from documented_commands import BLOCK, ROOT
from indentation_loops import FUSED_SILICA, loop

import indent_sim
from indent_sim.cli import commands
from indent_sim.process.errors import UsageError

Run = Callable[..., Result]
SCENE = """\
units: {{length: um, force: mN}}
body: {body}
material: {{model: linear_elastic, E: 72 GPa, nu: 0.17}}
indenter: {tip}
loading:
  deltas: [0.01, 0.02, 0.03, 0.04, 0.039, 0.038, 0.037, 0.036, 0.034, 0.032, 0.03, 0.028, 0.02, 0]
output: {{plot: false}}
"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A function that runs a command of the program in an empty directory."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(commands.program, [str(word) for word in words])


def test_the_page_prints_what_the_commands_print(run: Run, tmp_path: Path) -> None:
    """Each line of a text block of docs/hardness.md is printed by the command before it."""
    os.symlink(ROOT / "configs", tmp_path / "configs")
    page = (ROOT / "docs" / "hardness.md").read_text(encoding="utf-8")
    printed = ""
    shown = 0
    for kind, text in BLOCK.findall(page):
        if kind == "text":
            lines = [line for line in text.splitlines() if line not in printed.splitlines()]
            assert not lines, printed
            shown += 1
            continue
        for line in text.splitlines():
            words = [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', line)]
            done = run(*words[1:])
            assert done.exit_code == 0, done.stderr
            printed = done.stdout
    assert shown == 2


def simulated(run: Run, tip: str, body: str = "{shape: half_space}") -> dict:
    """Run a scene of theory with unloading, and return the object of `hardness --json`."""
    Path("scene.yaml").write_text(SCENE.format(tip=tip, body=body))
    assert run("run", "scene.yaml", "--output", "out", "--overwrite", "--quiet").exit_code == 0
    done = run("hardness", "out", "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


def test_a_cone_shows_the_error_of_the_usual_epsilon(run: Run) -> None:
    """The contact depth of an elastic cone is 2/pi h; 0.75 gives h (1 - 0.75/2).

    The area is 0.9638 and the modulus 1/sqrt(0.9638) of the true one. Theory is exact to 1e-8.
    """
    found = simulated(run, "{shape: cone, half_angle: 70.3}")
    area = (0.625 * pi / 2) ** 2
    ratios = {name: part["ratio"] for name, part in found["truth"].items()}
    wanted = {"A_p": area, "H_IT": 1 / area, "S": 1.0, "E_r": area**-0.5, "E_IT": area**-0.5}
    assert ratios == pytest.approx(wanted, rel=1e-6)
    assert found["values"]["m"] == pytest.approx(2, rel=1e-6)
    assert abs(found["values"]["eta_IT"] - 100) < found["errors"]["eta_IT"]
    exact = run("hardness", "out", "--epsilon", "m", "--json")
    ratios = {name: part["ratio"] for name, part in json.loads(exact.stdout)["truth"].items()}
    assert ratios == pytest.approx(dict.fromkeys(wanted, 1.0), rel=1e-6)
    of_table = run("hardness", "out/force_indentation.csv", "--json")
    assert json.loads(of_table.stdout)["values"] == found["values"]


@pytest.mark.parametrize("tip", ["paraboloid, R: 1", "flat_punch, radius: 1"])
def test_a_paraboloid_and_a_punch(run: Run, tip: str) -> None:
    """0.75 is exact for a paraboloid; the area of a punch does not depend on the contact depth."""
    found = simulated(run, f"{{shape: {tip}}}")
    ratios = [part["ratio"] for part in found["truth"].values()]
    assert len(ratios) == 5 and ratios == pytest.approx([1.0] * 5, rel=1e-6)


def test_a_thin_layer_shows_the_error_of_the_half_space(run: Run) -> None:
    """On a layer as thick as the contact is wide the formulas give a larger modulus."""
    found = simulated(run, "{shape: paraboloid, R: 1}", "{shape: layer, height: 0.3}")
    assert found["truth"]["E_IT"]["ratio"] > 1.2
    assert found["truth"]["E_IT"]["value"] == pytest.approx(72)


def test_results_that_have_no_such_contact_are_refused(run: Run) -> None:
    Path("scene.yaml").write_text(
        SCENE.format(tip="{shape: paraboloid, R: 1}", body="{shape: half_space}").replace(
            "0.039, 0.038, 0.037, 0.036, 0.034, 0.032, 0.03, 0.028, 0.02, 0", "0.05"
        )
    )
    assert run("run", "scene.yaml", "--output", "out", "--quiet").exit_code == 0
    done = run("hardness", "out")
    assert done.exit_code == 2 and "no unloading" in done.stderr
    assert run("hardness", "out", "--columns", "1,2").exit_code == 2
    done = run("hardness", ".")
    assert done.exit_code == 2 and "name the folder of a result" in done.stderr


def test_json_and_python_agree(run: Run) -> None:
    Path("test.txt").write_text(loop(FUSED_SILICA).table())
    words = ("test.txt", "--nu", "0.17", "--frame-compliance", "0.01 nm/mN", "--top", "95:30")
    shown = json.loads(run("hardness", *words, "--json").stdout)
    assert (shown.pop("status"), shown.pop("exit_code")) == ("done", 0)
    options = {"nu": 0.17, "frame_compliance": "0.01 nm/mN", "top": (0.95, 0.3)}
    assert indent_sim.hardness("test.txt", **options) == shown
    assert shown["values"].keys() == shown["errors"].keys() == shown["units"].keys()
    text = run("hardness", *words).stdout
    assert all(name in text for name in shown["values"])
    with pytest.raises(UsageError, match="has no option color"):
        indent_sim.hardness("test.txt", color="red")


HYSITRON = (
    "Wed Mar 13 2019\nNumber of Points = 500\n\nDepth (nm)\tLoad (\u00b5N)\tTime (s)\tLoad (V)\n"
)
AGILENT = "Segment\tDisplacement Into Surface\tLoad On Sample\tTime On Sample\tStiffness\tModulus\n"
ANTON_PAAR = "Sample : FS\n\nTime [s]\tPd [nm]\tFn [mN]\tSegment\n"
FISCHER = "Fischerscope\nF\th\tt\nmN\t\u00b5m\ts\n"
# Text exports: head, and a row of time [s], depth [nm] and force [mN].
EXPORTS: dict[str, tuple[str, Callable[..., str]]] = {
    "Hysitron": (HYSITRON, lambda t, h, F: f"{h:.4f}\t{1e3 * F:.4f}\t{t:.3f}\t{F:.5f}"),
    "Agilent": (
        AGILENT + "\tnm\tmN\ts\tN/m\tGPa\n",
        lambda t, h, F: f"Load Segment\t{h:.4f}\t{F:.6f}\t{t:.3f}\t1000\t70",
    ),
    "Anton Paar": (ANTON_PAAR, lambda t, h, F: f"{t:.3f}\t{h:.4f}\t{F:.6f}\t0"),
    "Fischer": (FISCHER, lambda t, h, F: f"{F:.6f}\t{1e-3 * h:.7f}\t{t:.3f}".replace(".", ",")),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_text_of_instruments_is_read(run: Run, name: str) -> None:
    """E and H of a loop in the layout and the units of an instrument's text file."""
    head, row = EXPORTS[name]
    made = loop(FUSED_SILICA)
    rows = [row(*values) for values in zip(made.t, made.h, made.F, strict=True)]
    Path("export.txt").write_text("\n".join([head + rows[0], *rows[1:], ""]), encoding="latin-1")
    done = run("hardness", "export.txt", "--nu", "0.17", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    GPa = {"GPa": 1.0, "MPa": 1e3}[found["units"]["E_IT"]]
    assert found["values"]["E_IT"] == pytest.approx(72 * GPa, rel=2e-3)
    assert found["values"]["H_IT"] == pytest.approx(9.3 * GPa, rel=2e-3)


DAMAGE: dict[str, tuple[Callable[[np.ndarray, np.ndarray], tuple], str]] = {
    "no unloading": (lambda h, F: (h[:300], F[:300]), "the curve has no unloading"),
    "negative forces": (lambda h, F: (h, -F), "the largest force is 0"),
    "no force": (lambda h, F: (h, 0 * F), "the largest force is 0"),
    "all NaN": (lambda h, F: (h, np.nan * F), "lack a number"),
    "negative depths": (lambda h, F: (-h, F), "must be positive"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_loops_are_refused(run: Run, name: str) -> None:
    change, problem = DAMAGE[name]
    made = loop(FUSED_SILICA)
    rows = [f"{h},{F}" for h, F in zip(*change(made.h, made.F), strict=True)]
    Path("test.csv").write_text("\n".join(["depth [nm],load [mN]", *rows, ""]))
    done = run("hardness", "test.csv")
    assert done.exit_code == 2 and problem in done.stderr, done.stderr


def test_damage_that_leaves_a_number_is_inside_the_error(run: Run) -> None:
    """Noise of 5 % of the force at the top, and unloading alone."""
    made = loop(FUSED_SILICA)
    draw = np.random.default_rng(0)
    for name in ("noise", "unloading only"):
        rows = slice(None) if name == "noise" else slice(299, None)
        noise = 0.05 * draw.standard_normal(len(made.F)) if name == "noise" else 0.0 * made.F
        table = zip(made.h[rows], (made.F + 10 * noise)[rows], strict=True)
        lines = [f"{h},{F}" for h, F in table]
        Path("test.csv").write_text("\n".join(["depth [nm],load [mN]", *lines, ""]))
        done = run("hardness", "test.csv", "--nu", "0.17", "--json")
        found = json.loads(done.stdout)
        E = found["values"]["E_IT"]
        error = found["errors"]["E_IT"]
        assert abs(E - 72) < max(1.5 * error, 0.1), (name, E, error)


def test_a_tip_is_calibrated(run: Run) -> None:
    """The table of `calibrate` is an area function; an ideal tip gives that of the ideal tip."""
    for k, F_max in enumerate((1.0, 3.0, 10.0, 30.0)):
        Path(f"fs{k}.txt").write_text(loop(FUSED_SILICA, F_max=F_max).table())
    files = [f"fs{k}.txt" for k in range(4)]
    done = run("calibrate", *files, "--output", "area.csv")
    assert done.exit_code == 0, done.stderr
    assert "24.49" in done.stdout and "area.csv" in done.stdout
    words = ("--area", "area.csv", "--nu", "0.17", "--json")
    values = json.loads(run("hardness", "fs1.txt", *words).stdout)["values"]
    assert values["A_p"] == pytest.approx(24.494 * values["h_c"] ** 2, rel=2e-3)
    again = run("calibrate", *files, "--output", "area.csv", "--json")
    assert again.exit_code == 3 and "is not replaced" in again.stderr
    shown = json.loads(run("calibrate", *files, "--output", "b.csv", "--json").stdout)
    assert shown["scatter"] < 1e-3 and len(shown["curves"]) == 4
    few = run("calibrate", "fs0.txt", "--output", "c.csv")
    assert few.exit_code == 2 and "at least 3" in few.stderr


@pytest.mark.parametrize(
    ("words", "code", "problem"),
    [
        (("--top", "0.98:0.4"), 2, "not A:B in per cent"),
        (("--top", "half"), 2, "not A:B"),
        (("--beta", "0"), 2, "not in the range"),
        (("--nu", "0.7"), 3, "--nu"),
        (("--area", "round"), 3, "--area"),
        (("--area", "70 nm"), 3, "--area"),
        (("--tip", "steel"), 3, "--tip"),
        (("--drift", "1 nm"), 3, "--drift"),
        (("--frame-compliance", "nan"), 3, "--frame-compliance"),
        (("--columns", "1"), 3, "--columns"),
        (("--units", "mass=kg"), 2, "--units mass"),
        (("--scene", "nothing.yaml"), 2, "nothing.yaml"),
    ],
)
def test_wrong_options_have_the_exit_codes_of_the_page(
    run: Run, words: tuple[str, ...], code: int, problem: str
) -> None:
    Path("test.txt").write_text(loop(FUSED_SILICA).table())
    done = run("hardness", "test.txt", *words, "--json")
    assert done.exit_code == code and problem in done.stderr and "Traceback" not in done.stderr
    assert json.loads(done.stdout)["exit_code"] == code


def test_hostile_files_end_with_a_reason(run: Run) -> None:
    """Files of every broken kind are refused in one line; approaches have no unloading."""
    outcomes = set()
    for file in hostile_curves.hostile(np.random.default_rng(0)):
        path = Path(file.name)
        path.write_bytes(file.data)
        done = run("hardness", path)
        outcomes.add(done.exit_code)
        assert done.exit_code in (0, 2, 3, 7), (file.name, done.stderr)
        assert "Traceback" not in done.stderr, (file.name, done.stderr)
        assert done.stdout or done.stderr.strip()
    assert 2 in outcomes


def test_random_damage_ends_with_a_number_or_a_reason(run: Run) -> None:
    """Rows lost, repeated, shuffled, and cells overwritten, in thirty draws."""
    draw = np.random.default_rng(7)
    lines = loop(FUSED_SILICA).table().splitlines()
    for _ in range(30):
        rows = np.sort(draw.integers(1, len(lines), draw.integers(3, 600)))
        if draw.random() < 0.3:
            draw.shuffle(rows)
        damaged = [lines[0], *(lines[row] for row in rows)]
        for row in draw.integers(1, len(damaged), draw.integers(0, 5)):
            damaged[row] = draw.choice(["0,0,0", "1,1e9,5", "1,-5,1e-9", "1,nan,3", "1,2,-1e20"])
        Path("test.txt").write_text("\n".join([*damaged, ""]))
        done = run("hardness", "test.txt", "--json")
        assert done.exit_code in (0, 2), done.stderr
        assert "Traceback" not in done.stderr
        found = json.loads(done.stdout)
        if found["status"] == "done":
            assert found["values"]["H_IT"] > 0 and 0.9 < found["values"]["m"] < 2.6


METAL_SCENE = """
title: A metal
units: {length: um, force: mN}
body: {shape: cylinder, radius: 6.0, height: 6.0}
material: {model: hencky, E: 70.0, nu: 0.3, plasticity: {yield_stress: 0.28}}
indenter: {shape: cone, half_angle: 70.3}
loading: {delta: 0.5, steps: 4, unload: {to: 0, rows: 6}}
mesh: {h_contact: 0.3}
"""


def test_the_loop_of_a_metal(run: Run) -> None:
    """The truth is that of the columns of a body that yields; pictures show loop and imprint."""
    Path("metal.yaml").write_text(METAL_SCENE)
    assert run("run", "metal.yaml", "--output", "metal").exit_code == 0
    shown = json.loads(run("hardness", "metal", "--json").stdout)
    with open("metal/force_indentation.csv", newline="") as stream:
        table = list(csv.DictReader(stream))
    top = table[3]
    assert "area" not in top and "stiffness" not in top
    truth = {name: entry["value"] for name, entry in shown["truth"].items()}
    assert truth["A_p"] == pytest.approx(float(top["contact_area"]))
    assert truth["S"] == pytest.approx(float(top["unloading_stiffness"]))
    assert truth["H_IT"] == pytest.approx(float(top["hardness"]))
    assert truth["E_IT"] == 70.0
    # A metal without hardening piles up: the area by the formula is too small.
    assert shown["values"]["h_p"] == pytest.approx(float(table[-1]["residual_depth"]))
    assert shown["truth"]["A_p"]["ratio"] < 0.9 < 1.1 < shown["truth"]["H_IT"]["ratio"]
    assert "the contact area" in shown["formula_error"]
    assert "% too small" in shown["formula_error"]
    assert shown["formula_error"] in run("hardness", "metal").stdout
    drawn = run("plot", "metal", "--what", "hardness,profile,force", "--output", "metal.png")
    assert drawn.exit_code == 0 and Path("metal.png").stat().st_size > 10_000


def test_an_elastic_body_has_no_panel_of_hardness(run: Run) -> None:
    elastic = METAL_SCENE.replace(", plasticity: {yield_stress: 0.28}", "")
    Path("elastic.yaml").write_text(elastic)
    assert run("run", "elastic.yaml", "--output", "elastic").exit_code == 0
    done = run("plot", "elastic", "--what", "hardness")
    assert done.exit_code == 2 and "its body does not yield" in done.stderr
