"""Fits of maps from the shell and from Python: files, images, pictures, reports, refusals."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import jpk_files
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from indent_sim import fit_map
from indent_sim.cli import commands
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.map_folder import read_map
from indent_sim.fitting.map_pixel import fit_pixel
from indent_sim.results.map_images import read_image

SIZE = 10
POINTS = 240
STIFFNESS = 1e3 * jpk_files.STIFFNESS  # nN/um
SCENE = {
    "units": {"length": "um", "force": "nN"},
    "body": {"shape": "layer", "height": 4.0},
    "material": {"model": "linear_elastic", "E": 2.0, "nu": 0.5},
    "indenter": {"shape": "sphere", "R": 5.0},
    "loading": {"delta": 0.5},
    "experiment": {"cantilever": {"stiffness": STIFFNESS}},
}
TRUE_MODULI = np.where(np.add.outer(np.arange(SIZE), np.arange(SIZE)) < SIZE, 2.0, 5.0)
DEAD = (3, 4)


def true_curves() -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n,) [um] and forces (rows, columns, n) [nN] with 1 % of white noise."""
    model = ForwardModel(config_from_mapping(SCENE), ["material.E"], 1.2)
    z = np.linspace(-1.5, 1.0, POINTS)
    draw = np.random.default_rng(4)
    force = model(np.log(TRUE_MODULI.reshape(-1, 1)), z).reshape(SIZE, SIZE, POINTS)
    force[DEAD] = 0.0
    return z, force + 0.05 * draw.standard_normal(force.shape) + 0.02 * z


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a JPK map, a scene, and the fit of the map."""
    folder = tmp_path_factory.mktemp("map")
    z, force = true_curves()
    grid = jpk_files.Grid(SIZE, SIZE, 2e-5, 1e-5, back_and_forth=False)
    jpk_files.write_map(folder / "cells.jpk-force-map", 1e-6 * z, 1e-9 * force, grid)
    (folder / "scene.yaml").write_text(yaml.safe_dump(SCENE))
    done = fit(folder, "--output", str(folder / "fit"))
    assert done.exit_code == 0, done.output
    return folder


def fit(folder: Path, *options: str):  # type: ignore[no-untyped-def]
    """Call `indent-sim fit` with the map."""
    return CliRunner().invoke(
        commands.program,
        [
            "fit",
            str(folder / "cells.jpk-force-map"),
            "--scene",
            str(folder / "scene.yaml"),
            "--vary",
            "material.E",
            *options,
        ],
    )


def test_moduli_of_the_pixels(folder: Path) -> None:
    """Rows and columns are those of the file, and 95 % of the intervals contain the truth."""
    with h5py.File(folder / "fit" / "map.h5") as file:
        value = file["material.E"][:]
        low = file["material.E_low"][:]
        high = file["material.E_high"][:]
        reason = file["reason"]
        assert file.attrs["reasons"][reason[DEAD]].startswith("no contact")
    is_dead = np.zeros((SIZE, SIZE), dtype=bool)
    is_dead[DEAD] = True
    np.testing.assert_array_equal(np.isnan(value), is_dead)
    # A half width is some 2 %: moduli of 2 and 5 cannot be confused.
    np.testing.assert_allclose(value[~is_dead], TRUE_MODULI[~is_dead], rtol=0.1)
    inside = (low < TRUE_MODULI) & (high > TRUE_MODULI)
    # Fewer than 88 of 99 happen once in 500 by chance.
    assert np.count_nonzero(inside) >= 88


def test_tables_and_images_have_the_same_numbers(folder: Path) -> None:
    """map.csv in units of the scene, .gsf and .tif in SI units with the size of the map."""
    fitted = read_map(folder / "fit")
    with open(folder / "fit" / "map.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == SIZE * SIZE
    values = [float(row["material.E"] or "nan") for row in rows]
    np.testing.assert_allclose(values, fitted.value.ravel(), rtol=1e-6)
    assert float(rows[1]["x"]) == pytest.approx(3e-6) and float(rows[1]["y"]) == pytest.approx(5e-7)
    for name in ("E.gsf", "E.tif"):
        image = read_image(folder / "fit" / name)
        # Images have single precision.
        np.testing.assert_allclose(image, 1e3 * fitted.value, rtol=1e-6)
    header = (folder / "fit" / "E.gsf").read_bytes()[:200]
    assert b"XReal = 2e-05\n" in header and b"ZUnits = Pa\n" in header
    report = json.loads((folder / "fit" / "fit.json").read_text())
    assert report["map"]["fitted"] == SIZE * SIZE - 1
    assert sum(report["map"]["refused"].values()) == 1
    assert 40 <= report["map"]["sample"]["curves"] <= 48


def test_map_is_drawn_and_reported(folder: Path) -> None:
    result = folder / "fit"
    assert (result / "map.png").stat().st_size > 20_000
    for panels in ("modulus", "cause,histogram"):
        drawn = CliRunner().invoke(commands.program, ["plot", str(result), "--what", panels])
        assert drawn.exit_code == 0, drawn.output
        assert Path(drawn.output.strip()).stat().st_size > 10_000
    refused = CliRunner().invoke(commands.program, ["plot", str(result), "--what", "force"])
    assert refused.exit_code == 2 and "modulus" in refused.stderr
    told = CliRunner().invoke(commands.program, ["report", str(result), "--crate"])
    assert told.exit_code == 0, told.output
    crate = json.loads((result / "ro-crate-metadata.json").read_text())
    parts = {entity["@id"] for entity in crate["@graph"]}
    assert {"map.h5", "map.csv", "E.gsf", "E.tif", "height.gsf", "height.tif"} <= parts
    assert "curves: 99 fitted" in Path(told.output.strip()).read_text()


def test_arrays_give_the_same_map(folder: Path) -> None:
    """Arrays in a notebook, with depths and without a spring."""
    scene = {name: section for name, section in SCENE.items() if name != "experiment"}
    z, _ = true_curves()
    model = ForwardModel(config_from_mapping(scene), ["material.E"], 1.0)
    force = model(np.log(TRUE_MODULI.reshape(-1, 1)), 0.5 * z).reshape(SIZE, SIZE, POINTS)
    force = force + 0.05 * np.random.default_rng(2).standard_normal(force.shape)
    fitted = fit_map((0.5 * z, force), scene)
    np.testing.assert_allclose(fitted.value, TRUE_MODULI, rtol=0.1)
    [panel] = fitted.figure("modulus").axes
    assert len(panel.child_axes) == 1  # the colour bar
    same = fit_map((0.5 * z, force), scene, thickness=np.full((SIZE, SIZE), 4.0))
    # Splines between thicknesses and the steps of their table change the force by 0.1 %.
    np.testing.assert_allclose(same.value, fitted.value, rtol=2e-3)


def test_thickness_of_each_pixel_changes_its_modulus(folder: Path) -> None:
    """A file of thicknesses: a pixel that is taken for thicker needs a larger modulus."""
    thickness = np.full((SIZE, SIZE), 4.0)
    thickness[:5] = 8.0
    np.savetxt(folder / "thickness.csv", thickness, delimiter=",")
    done = fit(
        folder,
        "--thickness",
        str(folder / "thickness.csv"),
        "--output",
        str(folder / "thick"),
    )
    assert done.exit_code == 0, done.output
    reference = read_map(folder / "fit").value
    ratio = read_map(folder / "thick").value / reference
    assert np.nanmin(ratio[:5]) > 1.05
    np.testing.assert_allclose(np.nanmedian(ratio[5:]), 1.0, atol=5e-3)


def test_thickness_above_a_tilted_base(tmp_path: Path) -> None:
    """Gel on a tilted glass that is bare in two columns: thickness and modulus, from one map."""
    z, _ = true_curves()
    rows, columns = np.mgrid[:SIZE, :SIZE]
    base = 0.01 * rows - 0.02 * columns
    thickness = np.where(columns < 2, 0.0, 2.0 + 0.2 * columns)
    draw = np.random.default_rng(5)
    curves = []
    for place in np.ndindex(SIZE, SIZE):
        height = float(thickness[place])
        scene = SCENE | {"body": {"shape": "layer", "height": height or 4.0}}
        model = ForwardModel(config_from_mapping(scene), ["material.E"], 1.2)
        force = model(np.log([2.0]), z) if height else STIFFNESS * np.maximum(z, 0.0)
        force = force + 0.05 * draw.standard_normal(POINTS)
        # The base of the cantilever moves less far to a higher surface.
        curves.append(
            [jpk_files.measured("extend", 1e-6 * (z - base[place] - height), 1e-9 * force)]
        )
    grid = jpk_files.Grid(SIZE, SIZE, 1e-5, 1e-5, back_and_forth=False)
    files = jpk_files.members(curves, "force-scan-map", grid)
    jpk_files.write(tmp_path / "cells.jpk-force-map", files)
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(SCENE))
    done = fit(tmp_path, "--thickness", "base", "--output", str(tmp_path / "fit"))
    assert done.exit_code == 0, done.output
    found = read_map(tmp_path / "fit")
    assert found.thickness is not None
    is_base = thickness == 0
    assert {found.reasons[code] for code in found.reason[is_base]} == {
        "the bare substrate: the tip does not indent it"
    }
    # Contact points have standard deviations of some 0.003 um, and the modulus of 1.5 %.
    np.testing.assert_allclose(found.thickness[~is_base], thickness[~is_base], atol=0.02)
    # Without the second pass the thinnest gel is found 0.04 um too thin.
    assert np.mean((found.thickness - thickness)[:, 2]) == pytest.approx(0.0, abs=0.004)
    assert np.nanmedian(found.value) == pytest.approx(2.0, rel=0.01)
    covered = (found.low < 2.0) & (found.high > 2.0)
    assert np.mean(covered[~is_base]) > 0.85


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        (("--vary", "body.height"), 3, "a map varies one modulus"),
        (("--thickness", "no.csv"), 2, "cannot be read"),
        (("--thickness", "base"), 2, "the plane of the substrate cannot be fitted"),
        (("--thickness", "height:soft"), 3, "body.height"),
        (("--grid", "3x3"), 2, "files"),
        (("--map", "--segment", "retract"), 2, "approach"),
        (("--level", "0"), 2, "the baselines of a map are fitted"),
        (("--no-map", "--thickness", "height"), 2, "--thickness"),
        (("--no-map", "--rows", "0:2"), 2, "--rows"),
        (("--rows", "0:11"), 2, "rows 0:10"),
        (("--rows", "2:2"), 2, "A < B"),
        (("--rows", "0:3"), 2, "fewer than 64 curves"),
    ],
)
def test_options_that_do_not_fit_are_refused(folder: Path, options, code: int, word: str) -> None:  # type: ignore[no-untyped-def]
    refused = fit(folder, *options, "--output", str(folder / "refused"))
    assert refused.exit_code == code, refused.output
    assert word in refused.stderr
    assert not (folder / "refused" / "fit.json").exists()


def test_processes_and_rows_do_not_change_numbers(folder: Path) -> None:
    """Two processes give the same bits; rows that are left out have no value."""
    done = fit(folder, "--jobs", "2", "--rows", "2:10", "--output", str(folder / "rows"))
    assert done.exit_code == 0, done.output
    done = fit(folder, "--rows", "2:10", "--output", str(folder / "rows of one process"))
    assert done.exit_code == 0, done.output
    together, alone = (read_map(folder / name) for name in ("rows", "rows of one process"))
    for name in ("value", "low", "high", "height", "reason"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name))
    assert (together.reason[:2] == -1).all() and np.isnan(together.value[:2]).all()
    # Fewer baselines give another noise; a half width is 2 %.
    whole = read_map(folder / "fit").value
    np.testing.assert_allclose(together.value[2:], whole[2:], rtol=0.02)


# It kills itself before or after the COUNT-th file that is replaced, with blocks of 16 curves.
KILLED_FIT = """
import os, signal, sys
from indent_sim.fitting import map_fit
from indent_sim.cli import commands

map_fit.BLOCK_SIZE = 16
count, moment, *words = sys.argv[1:]
replace = os.replace
left = int(count)

def replace_and_die(*paths):
    global left
    left -= 1
    if not left and moment == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*paths)
    if not left:
        os.kill(os.getpid(), signal.SIGKILL)

os.replace = replace_and_die
commands.program(words)
"""


def killed_fit(folder: Path, count: int, moment: str) -> subprocess.CompletedProcess[str]:
    """Fit the map in a process that is killed at its COUNT-th file, if it writes so many."""
    words = ["fit", "cells.jpk-force-map", "--scene", "scene.yaml", "--vary", "material.E"]
    words += ["--thickness", "height"]
    return subprocess.run(
        [sys.executable, "-c", KILLED_FIT, str(count), moment, *words, "--output", "killed"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def plot_in_blocks(folder: Path) -> subprocess.CompletedProcess[str]:
    """Plot the killed map in a process with the same blocks."""
    return subprocess.run(
        [sys.executable, "-c", KILLED_FIT, "1000000", "never", "plot", "killed"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def test_a_killed_map_is_continued(folder: Path) -> None:
    """Kills lose no finished block and change no bit; the noise is that of the first call.

    Meanwhile the picture has the curves of the blocks that are finished.
    """
    target = folder / "killed"
    stages = np.zeros(7, dtype=int)
    # The first files are fit.json and the blocks of the first pass; then come those of two more
    # passes, the sample with two files for each curve, and the results.
    for count, moment in (
        (1, "before"),
        (5, "before"),
        (9, "after"),
        (20, "after"),
        (30, "before"),
    ):
        ended = killed_fit(folder, count, moment)
        assert ended.returncode == -signal.SIGKILL, ended.stderr
        if (target / "progress.h5").exists():
            with h5py.File(target / "progress.h5") as file:
                reached = file["stages"][:].astype(int)
            assert (reached >= stages).all()
            stages = reached
        drawn = plot_in_blocks(folder)
        assert drawn.returncode == (0 if (stages == 3).any() else 2), drawn.stderr
        if (stages > 0).any() and (stages < 3).all():
            assert "no curve has an interval yet" in drawn.stderr
    assert (stages == 3).all()
    ended = killed_fit(folder, 10**6, "never")
    assert ended.returncode == 0, ended.stderr
    assert "100 of 100 curves were fitted by an earlier call" in ended.stderr
    shutil.move(target, folder / "continued")
    assert killed_fit(folder, 10**6, "never").returncode == 0
    with h5py.File(folder / "continued" / "map.h5") as one, h5py.File(target / "map.h5") as other:
        assert set(one) == set(other)
        for name in one:
            np.testing.assert_array_equal(one[name][:], other[name][:], err_msg=name)
    # Neither the file of the progress nor an incomplete file is left.
    names = {path.name for path in (folder / "continued").iterdir()}
    assert names == {path.name for path in target.iterdir()}
    assert not [name for name in names if name.endswith(".new") or name.startswith("progress")]
    # A call for a finished map does nothing.
    again = killed_fit(folder, 1, "before")
    assert again.returncode == 0 and "finished by an earlier call" in again.stderr


def test_curve_of_a_pixel_is_drawn_with_its_fit(folder: Path) -> None:
    """Also of a pixel that was refused; without the file of the map it is refused clearly."""

    def plot(place: str, fit_folder: Path = folder / "fit"):  # type: ignore[no-untyped-def]
        return CliRunner().invoke(commands.program, ["plot", str(fit_folder), "--pixel", place])

    pixel = fit_pixel(folder / "fit", 7, 8)
    parameter = pixel.fit.entry["parameters"]["material.E"]
    assert parameter["low"] < TRUE_MODULI[7, 8] < parameter["high"]
    assert parameter["value"] == pytest.approx(read_map(folder / "fit").value[7, 8], rel=0.02)
    for place in ("7,8", f"{DEAD[0]},{DEAD[1]}"):
        drawn = plot(place)
        assert drawn.exit_code == 0, drawn.output
        assert Path(drawn.output.strip()).stat().st_size > 10_000
    outside = plot("10,0")
    assert outside.exit_code == 2 and "rows 0 to 9" in outside.stderr
    assert plot("7").exit_code == 2
    moved = folder / "moved"
    shutil.move(folder / "cells.jpk-force-map", moved)
    try:
        missing = plot("7,8")
        assert missing.exit_code == 2 and "does not exist any more" in missing.stderr
    finally:
        shutil.move(moved, folder / "cells.jpk-force-map")


def test_units_stand_beside_the_tables(folder: Path) -> None:
    units = json.loads((folder / "fit" / "fit.json").read_text())["units"]
    assert units["material.E"] == "nN/um²" and units["slope"] == "nN/um"
    assert units["contact_point"] == "um" and units["rms_percent"] == "%"
    with h5py.File(folder / "fit" / "map.h5") as file:
        assert file["material.E_low"].attrs["unit"] == "nN/um²"
        assert "unit" not in file["p_shape"].attrs


def test_a_folder_of_curves_ends_with_a_summary(tmp_path: Path) -> None:
    """How many curves were fitted, and the median and the middle half of the modulus."""
    z, force = true_curves()
    scene = {name: section for name, section in SCENE.items() if name != "units"}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    (tmp_path / "curves").mkdir()
    for k, place in enumerate(((0, 0), (0, 1), DEAD)):
        table = np.column_stack([z, force[place]])
        np.savetxt(
            tmp_path / "curves" / f"{k}.csv", table, delimiter=",", header="z,force", comments=""
        )
    done = CliRunner().invoke(
        commands.program,
        [
            *("fit", str(tmp_path / "curves"), "--scene", str(tmp_path / "scene.yaml")),
            *("--vary", "material.E", "--output", str(tmp_path / "out")),
        ],
    )
    assert done.exit_code == 0, done.output
    assert "3 curves: 2 fitted, 1 refused: no contact" in done.stderr
    assert "in the median" in done.stderr
