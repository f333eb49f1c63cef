"""Fits of files: entries, tables and pictures, continued folders, and what is refused."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import jpk_files
import numpy as np
import pytest
from measurements import N, drawn, measured

import indent_sim
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.curve_fit import FitRequest
from indent_sim.fitting.fit_folder import CurveFits, ReadOptions, fit_curves
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.inference.noise import WHITE
from indent_sim.process.errors import ConfigError, NotConverged, UsageError

SCENE = {
    "units": {"length": "um", "force": "nN"},
    "body": {"shape": "half_space"},
    "material": {"model": "linear_elastic", "E": "1 kPa", "nu": 0.5},
    "indenter": {"shape": "paraboloid", "R": "5 um"},
    "loading": {"delta": "0.5 um"},
    "output": {"plot": False},
}
REQUEST = FitRequest(config_from_mapping(SCENE), ("material.E",))
X = np.linspace(-1, 1, N)
FORCES = ForwardModel(REQUEST.config, ["material.E"], 1.3)


def write(path: Path, E: float = 2.0, seed: int = 0) -> Path:
    """Write a curve in nm and pN with a decimal comma."""
    force = measured(FORCES, [np.log(E)], X, drawn(WHITE, N, np.random.default_rng(seed)), c=0.1)
    rows = "".join(f"{1e3 * x:.5f};{1e3 * f:.5f}\n" for x, f in zip(X, force, strict=True))
    path.write_text("depth [nm];force [pN]\n" + rows.replace(".", ","))
    return path


def fitted(paths: list[Path], folder: Path, request: FitRequest = REQUEST, **how) -> CurveFits:  # type: ignore[no-untyped-def]
    """Fit some files into a folder."""
    return fit_curves(paths, request, folder, **how)


@pytest.fixture
def curves(tmp_path: Path) -> Path:
    """A folder of three curves and three files without a usable curve."""
    folder = tmp_path / "curves"
    folder.mkdir()
    for k, E in enumerate((1.0, 2.0, 4.0)):
        write(folder / f"c{k}.csv", E, k)
    (folder / "empty.csv").write_text("")
    (folder / "short.csv").write_text("depth [um],force [nN]\n1,2\n2,3\n3,4\n")
    (folder / "absurd.csv").write_text(
        "delta,force\n" + "".join(f"{k}e99,{k * k}e90\n" for k in range(1, 60))
    )
    return folder


def test_every_curve_has_an_entry_and_a_row(curves, tmp_path):
    fits = fitted([curves], tmp_path / "fit")
    by_name = {entry["curve"]: entry for entry in fits.entries}
    assert list(by_name) == ["absurd", "c0", "c1", "c2", "empty", "short"] and fits.exit_code == 0
    for name, E in (("c0", 1.0), ("c1", 2.0), ("c2", 4.0)):
        stated = by_name[name]["parameters"]["material.E"]
        assert stated["low"] < E < stated["high"] and stated["high"] < 1.1 * stated["low"]
        assert by_name[name]["contact_point"]["value"] == pytest.approx(0.1, abs=0.05)
        assert by_name[name]["hertz"]["percent"] == pytest.approx(
            0.0, abs=0.1
        )  # it is a half-space
        assert by_name[name]["window"][-1]["upper"] == 1.0 and by_name[name]["identifiable"]
    assert by_name["short"]["reason"] == "3 points"
    assert by_name["empty"]["reason"] == "not a curve: the file is empty"
    assert by_name["absurd"]["status"] == "refused"
    rows = list(csv.DictReader((tmp_path / "fit" / "fit.csv").open()))
    assert [row["curve"] for row in rows] == list(by_name) and float(
        rows[1]["material.E"]
    ) == pytest.approx(1.0, 0.05)
    table = np.genfromtxt(tmp_path / "fit" / "curves" / "c1.csv", delimiter=",", names=True)
    np.testing.assert_allclose(
        table["force"] - table["fit"], table["residual"], atol=1e-8
    )  # of ten digits
    said = json.loads((tmp_path / "fit" / "fit.json").read_text())
    assert said["status"] == "done" and said["exit_code"] == 0 and len(said["curves"]) == 6
    assert not list((tmp_path / "fit").glob("*.png"))


def test_a_folder_goes_on_with_what_is_new_or_changed(curves, tmp_path):
    fitted([curves], tmp_path / "fit")
    before = json.loads((tmp_path / "fit" / "fit.json").read_text())["curves"]
    write(curves / "c1.csv", 3.0)
    write(curves / "c9.csv", 3.0)
    told: list[str] = []
    after = fitted([curves], tmp_path / "fit", tell=told.append).entries
    assert len(told) == 3 and "c1" in told[0] and "c9" in told[1]
    assert "7 curves: 4 fitted, 3 refused" in told[2]
    assert [entry for entry in after if entry["curve"] not in ("c1", "c9")] == [
        entry for entry in before if entry["curve"] != "c1"
    ]


def test_another_scene_or_a_foreign_folder_is_refused(curves, tmp_path):
    fitted([curves / "c0.csv"], tmp_path / "fit")
    with pytest.raises(UsageError, match="contains the fit of another scene"):
        fitted([curves / "c0.csv"], tmp_path / "fit", replace(REQUEST, curve_part="all"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years")
    with pytest.raises(UsageError, match="was not made by indent-sim"):
        fitted([curves / "c0.csv"], tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
    with pytest.raises(UsageError, match="there is no file"):
        fitted([tmp_path / "nothing.csv"], tmp_path / "new")
    with pytest.raises(ConfigError, match="is not a number of the scene"):
        fitted([curves / "c0.csv"], tmp_path / "new", replace(REQUEST, varied_keys=("material.Q",)))
    with pytest.raises(ConfigError, match="there is no column 'x'"):
        fitted([curves / "c0.csv"], tmp_path / "other", reading=ReadOptions(("x", "force")))
    assert not (tmp_path / "new").exists() and not (tmp_path / "other").exists()


def test_curves_of_one_name_have_rows_of_their_own(curves, tmp_path):
    (tmp_path / "more").mkdir()
    write(tmp_path / "more" / "c0.csv")
    fits = fitted(
        [curves / "c0.csv", tmp_path / "more" / "c0.csv", curves / "c0.csv"], tmp_path / "fit"
    )
    assert [entry["curve"] for entry in fits.entries] == ["c0", "c0.csv", "c0-2"]


def test_a_damaged_curve_of_a_map_is_its_own_reason(tmp_path):
    delta = np.linspace(-1e-6, 0.5e-6, N)
    draw = np.random.default_rng(0)
    hertz = 4 / 3 * 2e3 / 0.75 * np.sqrt(5e-6) * np.maximum(delta, 0.0) ** 1.5
    force = hertz + 0.01 * hertz.max() * draw.standard_normal(N)
    curve = [jpk_files.measured("extend", delta + hertz / jpk_files.STIFFNESS, force)]
    files = jpk_files.members([curve, curve, curve], kind="force-scan-map")
    del files["index/1/segments/0/channels/vDeflection.dat"]
    path = jpk_files.write(tmp_path / "gel.jpk-force-map", files)
    damaged, *good = sorted(
        fitted([path], tmp_path / "fit").entries, key=lambda entry: entry["status"] == "done"
    )
    assert damaged["curve"] == "gel-1"
    assert damaged["reason"].endswith("vDeflection.dat is missing")
    assert [entry["curve"] for entry in good] == ["gel-0", "gel-2"]
    for entry in good:
        stated = entry["parameters"]["material.E"]
        assert stated["low"] < 2.0 < stated["high"] < 1.2 * stated["low"]


def test_a_curve_deeper_than_the_body_is_its_reason(tmp_path):
    body = config_from_mapping(
        SCENE | {"body": {"shape": "layer", "height": "0.4 um"}, "loading": {"delta": "0.1 um"}}
    )
    fits = fitted([write(tmp_path / "c.csv")], tmp_path / "fit", replace(REQUEST, config=body))
    assert fits.exit_code == 5 and fits.entries[0]["reason"].startswith(
        "the scene is not valid at a depth of"
    )


def test_the_fit_of_a_notebook(tmp_path):
    found = indent_sim.fit(write(tmp_path / "c.csv"), SCENE, vary=["material.E"])
    assert (
        found.parameters["material.E"].low < 2.0 < found.parameters["material.E"].high
        and found.explained
    )
    force = FORCES(np.array([0.0]), X)
    arrays = indent_sim.fit((X, force + 1e-3 * np.sin(1e3 * X)), SCENE)
    assert arrays.parameters["material.E"].value == pytest.approx(1.0, rel=1e-3)
    with pytest.raises(NotConverged, match="no contact"):
        indent_sim.fit((X, np.zeros(N)), SCENE)


def test_depths_in_another_unit_are_told() -> None:
    """Depths of 240 radii are warned of, and depths of a billionth of a radius refused."""
    x = np.linspace(-0.3, 0.6, 400)
    force = 1e-3 * np.maximum(x, 0.0) ** 1.5
    force = force + 1e-6 * np.random.default_rng(0).standard_normal(400)
    document = {
        "body": {"shape": "half_space"},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.5},
        "indenter": {"shape": "paraboloid", "R": 2.5e-3},
        "loading": {"delta": 1e-3},
    }
    deep = indent_sim.fit((x, force), document)
    assert "240 times the radius" in " ".join(deep.entry["warnings"])
    assert "a thousand" in " ".join(deep.entry["warnings"])
    document["indenter"] = {"shape": "paraboloid", "R": 2.5}
    assert not indent_sim.fit((x, force), document).entry["warnings"]
    with pytest.raises(NotConverged, match="unit of the file or of the scene"):
        indent_sim.fit((1e-6 * x, force), document)


def test_names_of_files_that_no_table_could_have(tmp_path: Path) -> None:
    """A name of 255 bytes, one that is not UTF-8, and a file that needs another package."""
    folder = tmp_path / "curves"
    folder.mkdir()
    write(folder / f"{'long' * 62}x.txt")
    write(folder / b"\xff\xfe.txt".decode("utf-8", "surrogateescape"))
    write(folder / "plain.txt")
    for _ in range(2):
        fits = fitted([folder], tmp_path / "fit")
        assert [entry["status"] for entry in fits.entries] == ["done"] * 3
        assert len(list((tmp_path / "fit" / "curves").iterdir())) == 3
