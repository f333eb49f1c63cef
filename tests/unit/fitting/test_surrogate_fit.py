"""Fits whose forces come from the surrogate of a study, against fits with its scene."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from measurements import N, drawn, measured
from surrogate_tables import study_with_table

import indent_sim
from indent_sim.cli.commands import fit
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.forward_model.elastic_load_curve import ElasticLoadCurveGrid
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.forward_model.parameters import parameters_of
from indent_sim.fitting.forward_model.surrogate_load_curves import SurrogateLoadCurves
from indent_sim.fitting.inference.noise import Noise
from indent_sim.process.errors import ConfigError, IndentSimError, NotConverged, UsageError
from indent_sim.studies.surrogate import read_surrogate, write_surrogate
from indent_sim.studies.surrogate_fit import fit_surrogate

HEIGHT = "body.height"
DEEPEST = 0.6
SCENE = {
    "body": {"shape": "layer", "height": 2.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.45},
    "indenter": {"shape": "sphere", "R": 1.0},
    "loading": {"delta": 0.1, "steps": 1},
    "solver": {"method": "theory"},
}
# The measured scene, of another size and with units and a spring.
UNITS = {"length": "um", "force": "nN"}
EXPERIMENT = {"cantilever": {"stiffness": 60.0}}
MEASURED = SCENE | {
    "units": UNITS,
    "body": {"shape": "layer", "height": 8.0},
    "indenter": {"shape": "sphere", "R": 5.0},
    "experiment": EXPERIMENT,
}
SETTINGS = (
    "units={length: um, force: nN}",
    "indenter.R=5 um",
    "experiment={cantilever: {stiffness: 0.06 N/m}}",
)


HEIGHT_SET = ("--set", "body.height=8 um")


@pytest.fixture(scope="module")
def surrogate_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Surrogate of a sphere on layers of different thicknesses, by theory."""
    folder = tmp_path_factory.mktemp("study")
    config = config_from_mapping(SCENE)
    curves = ElasticLoadCurveGrid(config, parameters_of(config, [HEIGHT], DEEPEST), DEEPEST)

    def force(keys: dict[str, float]) -> float:
        curve = curves.load_curve([math.log(keys[HEIGHT])])
        return float(curve.force(np.array([keys["loading.delta"]]))[0])

    vary = {
        HEIGHT: {"from": 0.8, "to": 6, "spacing": "log"},
        "loading.delta": {"from": 0.002, "to": DEEPEST, "spacing": "log"},
    }
    study = study_with_table(folder, force, 160, base=SCENE, vary=vary)
    path = folder / "surrogate-force.json"
    write_surrogate(fit_surrogate(study, folder, "force"), path)
    return path


def write_curve(path: Path, height: float = 8.0) -> Path:
    """Write a curve of E = 2 with noise, up to a displacement of 1.6."""
    body = {"body": {"shape": "layer", "height": height}}
    model = ForwardModel(config_from_mapping(MEASURED | body), ["material.E"], 2.0)
    x = np.linspace(-1.0, 1.6, N)
    noise = drawn(Noise(), N, np.random.default_rng(1))
    force = measured(model, [math.log(2.0)], x, noise, c=0.1)
    rows = "".join(f"{a:.6f},{f:.6f}\n" for a, f in zip(x, force, strict=True))
    path.write_text("z [um],force [nN]\n" + rows)
    return path


def fitted(curve: Path, scene: Path, folder: Path, *words: str) -> dict[str, Any]:
    """Return the entry of a fit by the command line."""
    settings = [word for text in SETTINGS for word in ("--set", text)]
    common = ["--scene", str(scene), "--output", str(folder), "--set", "output.plot=false"]
    fit.main([str(curve), *common, *settings, *words, "--quiet"], standalone_mode=False)
    entry: dict[str, Any] = json.loads((folder / "fit.json").read_text())["curves"][0]
    return entry


def changed(path: Path, folder: Path, **parts: Any) -> Path:
    """Return the file of a surrogate with other parts."""
    other = folder / "changed.json"
    other.write_text(json.dumps(json.loads(path.read_text()) | parts))
    return other


@pytest.mark.parametrize("keys", [("material.E",), ("material.E", HEIGHT)])
def test_values_are_those_of_the_scene(surrogate_path, tmp_path, keys):
    """Value and ends of the interval differ by less than a tenth of the half width."""
    curve = write_curve(tmp_path / "curve.csv")
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(MEASURED))
    vary = [word for key in keys for word in ("--vary", key)]
    height = [] if HEIGHT in keys else ["--set", "body.height=8 um"]
    by_scene = fitted(curve, scene, tmp_path / "a", *vary)
    by_table = fitted(curve, surrogate_path, tmp_path / "b", *vary, *height)
    for key in keys:
        expected = by_scene["parameters"][key]
        half_width = (expected["high"] - expected["low"]) / 2
        for name in ("value", "low", "high"):
            assert abs(by_table["parameters"][key][name] - expected[name]) < half_width / 10
    assert by_scene["model_error"] == 0
    assert any("come from a surrogate" in line for line in by_table["warnings"])


def test_python_gives_the_result_of_the_command(surrogate_path, tmp_path):
    """`indent_sim.fit` with the file of a surrogate, and values of keys as `load` accepts them."""
    curve = write_curve(tmp_path / "curve.csv")
    by_command = fitted(curve, surrogate_path, tmp_path / "a", "--vary", "material.E", *HEIGHT_SET)
    texts = (*SETTINGS, "body.height=8 um")
    values = {"units": UNITS, "indenter.R": 5.0, "experiment": EXPERIMENT, HEIGHT: 8.0}
    for overrides in (texts, values):
        found = indent_sim.fit(curve, surrogate_path, overrides=overrides)
        assert found.entry["model_error"] == by_command["model_error"]
        expected = by_command["parameters"]["material.E"]
        interval = found.parameters["material.E"]
        numbers = [interval.value, interval.low, interval.high]
        assert numbers == [expected[name] for name in ("value", "low", "high")]
    with pytest.raises(ConfigError, match=r"body\.height.*has no value"):
        indent_sim.fit(curve, str(surrogate_path), overrides=SETTINGS)
    with pytest.raises(ConfigError, match="did not vary"):
        indent_sim.fit(curve, surrogate_path, ["material.nu"], overrides=texts)


def test_relaxation_of_all_moduli_is_that_of_a_fit_with_the_scene(surrogate_path, tmp_path):
    """The relaxation multiplies the elastic curve, whatever gives that curve."""
    curve = write_curve(tmp_path / "curve.csv")
    path = tmp_path / "curve.csv"
    lines = path.read_text().splitlines()
    timed = [f"{line},{0.01 * k:.3f}" for k, line in enumerate(lines[1:])]
    path.write_text("\n".join([lines[0] + ",time [s]", *timed]) + "\n")
    relaxation = {"prony": [[0.4, 0.5]]}
    loading = {"history": [[0, 0], [3, 1]]}
    scene = tmp_path / "scene.yaml"
    material = SCENE["material"] | {"relaxation": relaxation}
    scene.write_text(json.dumps(MEASURED | {"material": material, "loading": loading}))
    by_scene = fitted(curve, scene, tmp_path / "a", "--vary", "material.E")
    settings = {"material.relaxation": relaxation, "loading": loading, "body.height": 8}
    words = [w for key, part in settings.items() for w in ("--set", f"{key}={json.dumps(part)}")]
    by_table = fitted(curve, surrogate_path, tmp_path / "b", "--vary", "material.E", *words)
    expected = by_scene["parameters"]["material.E"]
    half_width = (expected["high"] - expected["low"]) / 2
    found = by_table["parameters"]["material.E"]
    assert expected["value"] > 2.2  # the relaxed curve is that of a stiffer body
    for name in ("value", "low", "high"):
        assert abs(found[name] - expected[name]) < half_width / 10


def test_the_error_is_that_of_the_surrogate_and_enters_the_interval(surrogate_path, tmp_path):
    """A stated error of 20 % widens the interval of E by 20 % of E in quadrature."""
    curve = write_curve(tmp_path / "curve.csv")
    words = ("--vary", "material.E", "--set", "body.height=8 um")
    narrow = fitted(curve, surrogate_path, tmp_path / "a", *words)
    error = json.loads(surrogate_path.read_text())["error"]
    # The continuation to small depths adds in quadrature.
    assert error["error"] <= narrow["model_error"] < error["error"] + 1e-3
    wrong = changed(surrogate_path, tmp_path, error=error | {"error": 0.2})
    wide = fitted(curve, wrong, tmp_path / "b", *words)
    assert wide["model_error"] == pytest.approx(0.2, rel=1e-3)
    widths = [
        math.log(
            entry["parameters"]["material.E"]["high"] / entry["parameters"]["material.E"]["low"]
        )
        for entry in (narrow, wide)
    ]
    # At least one standard deviation of the error on each side.
    assert widths[1] > 0.4 > 2 * widths[0]
    assert any("error of the surrogate is 20 %" in line for line in wide["warnings"])


def test_the_continued_curve_is_within_its_error(surrogate_path):
    """Also where the range begins at a fifth of the depth: against theory at all depths."""
    surrogate = read_surrogate(surrogate_path)
    for height, deepest in ((0.8, 0.011), (1.0, 0.5), (5.0, 0.02)):
        config = config_from_mapping(SCENE | {"body": {"shape": "layer", "height": height}})
        depths = deepest * np.linspace(0.001, 1, 200)
        exact = ElasticLoadCurveGrid(config, (), deepest).scene_curve.force(depths)
        curves = SurrogateLoadCurves(surrogate, config, (), deepest)
        difference = np.abs(curves.scene_curve.force(depths) - exact).max() / exact[-1]
        # The error of the surrogate is a quantile, which the worst depth may exceed.
        assert difference < curves.relative_error(()) + surrogate.error["largest"]


def test_a_body_outside_the_range_is_refused(surrogate_path, tmp_path):
    """A layer of 60 um is thicker than 6 R = 30 um, where the surrogate ends."""
    curve = write_curve(tmp_path / "curve.csv", height=60.0)
    words = ("--vary", "material.E", "--set")
    with pytest.raises(NotConverged, match="outside the range of the surrogate"):
        fitted(curve, surrogate_path, tmp_path / "a", *words, "body.height=60 um")
    with pytest.raises(NotConverged, match="outside the range of the surrogate"):
        fitted(curve, surrogate_path, tmp_path / "b", *words, "body.height=20 um", "--vary", HEIGHT)


@pytest.mark.parametrize(
    ("words", "kind", "message"),
    [
        ((), ConfigError, "body.height.*has no value"),
        (
            ("--set", "material.nu=0.3", "--set", "body.height=8 um"),
            ConfigError,
            "material.nu.*0.45 in all runs",
        ),
        (
            ("--set", "contact.friction=0.3", "--set", "body.height=8 um"),
            ConfigError,
            "contact.friction",
        ),
        (
            ("--set", "experiment.adhesion={work: 1 mN/m}", "--set", "body.height=8 um"),
            ConfigError,
            "flat punches",
        ),
        (("--vary", "material.nu", "--set", "body.height=8 um"), ConfigError, "did not vary"),
    ],
)
def test_what_the_surrogate_does_not_know_is_refused(
    surrogate_path, tmp_path, words, kind, message
):
    curve = write_curve(tmp_path / "curve.csv")
    with pytest.raises(kind, match=message) as caught:
        fitted(curve, surrogate_path, tmp_path / "a", "--vary", "material.E", *words)
    assert caught.value.exit_code == 3


def test_foreign_files_are_refused(surrogate_path, tmp_path):
    curve = write_curve(tmp_path / "curve.csv")
    old = json.loads(surrogate_path.read_text())
    del old["scene"]
    (tmp_path / "old.json").write_text(json.dumps(old))
    with pytest.raises(UsageError, match="has no entry 'scene'"):
        fitted(curve, tmp_path / "old.json", tmp_path / "a", "--vary", "material.E")
    radius = changed(surrogate_path, tmp_path, column="a")
    with pytest.raises(ConfigError, match="another column"):
        fitted(curve, radius, tmp_path / "a", "--vary", "material.E", "--vary", HEIGHT)
    foreign = tmp_path / "rows.h5"
    with h5py.File(foreign, "w") as file:
        file["force"] = np.arange(9.0)
    with pytest.raises(IndentSimError) as caught:
        fitted(curve, foreign, tmp_path / "a", "--vary", "material.E")
    assert caught.value.exit_code in (2, 3)
    assert not (tmp_path / "a").exists()
