"""Wheel and source distribution: built, installed by pip into an empty environment, and run there.

The environment has neither Debian's packages nor the sources. The tests are skipped where pip
reaches no package index.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from command_line import ROOT

LAYER = """
title: Thin gel on glass
units: {length: um, force: nN}
body: {shape: layer, height: 8 um}
material: {model: linear_elastic, E: 1 kPa, nu: 0.5}
indenter: {shape: sphere, R: 5 um}
loading: {delta: 1.5 um}
experiment: {cantilever: {stiffness: 0.06 N/m}}
"""
BUILD = """
from setuptools import build_meta
build_meta.build_sdist("dist")
build_meta.build_wheel("dist")
"""
PATIENCE = 900  # s, for a busy machine and a slow network


def ran(*words: str | Path, cwd: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command without the packages of this checkout, and assert its exit code."""
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        list(map(str, words)),
        cwd=cwd,
        env=variables,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a copy of the sources, and with a wheel and a source distribution in dist/."""
    folder = tmp_path_factory.mktemp("build")
    tools = folder / "tools"
    ran(sys.executable, "-m", "venv", tools, cwd=folder)
    pip = [tools / "bin" / "pip", "install", "--quiet", "setuptools>=77"]
    installed = subprocess.run(pip, capture_output=True, text=True, timeout=PATIENCE)
    if installed.returncode:
        pytest.skip(f"pip reaches no package index: {installed.stderr.splitlines()[-1]}")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "indent_sim", folder / "sources" / "indent_sim", ignore=ignored)
    for name in ("pyproject.toml", "LICENSE", "README.md"):
        shutil.copy(ROOT / name, folder / "sources" / name)
    ran(tools / "bin" / "python", "-c", BUILD, cwd=folder / "sources")
    return folder


def test_a_wheel_from_the_source_distribution_has_the_same_files(built: Path) -> None:
    dist = built / "sources" / "dist"
    (archive,) = dist.glob("*.tar.gz")
    shutil.unpack_archive(archive, built / "unpacked")
    (sources,) = (built / "unpacked").iterdir()
    ran(built / "tools" / "bin" / "python", "-c", BUILD, cwd=sources)
    wheels = [next(folder.glob("*.whl")) for folder in (dist, sources / "dist")]
    names = [sorted(zipfile.ZipFile(wheel).namelist()) for wheel in wheels]
    assert names[0] == names[1]
    files = (ROOT / "indent_sim").rglob("*")
    wanted = {str(file.relative_to(ROOT)) for file in files if "__pycache__" not in file.parts}
    packed = {path for path in wanted if (ROOT / path).is_file()}
    assert packed <= set(names[0])


def test_the_wheel_works_in_an_empty_environment(built: Path, tmp_path: Path) -> None:
    """Theory gives the force of this checkout, and a fit the interval with the true modulus."""
    ran(sys.executable, "-m", "venv", "venv", cwd=tmp_path)
    (wheel,) = (built / "sources" / "dist").glob("*.whl")
    programs = tmp_path / "venv" / "bin"
    ran(programs / "pip", "install", "--quiet", wheel, cwd=tmp_path)
    program = programs / "indent-sim"
    (tmp_path / "scene.yaml").write_text(LAYER)
    ran(program, "run", "scene.yaml", "--output", "run", cwd=tmp_path)
    here = [sys.executable, "-m", "indent_sim.cli.start", "run", "scene.yaml", "--output", "here"]
    search = {"PYTHONPATH": str(ROOT)}
    subprocess.run(here, cwd=tmp_path, env=os.environ | search, check=True, capture_output=True)
    # Other versions of numpy and scipy add in another order.
    ran(program, "compare", "run", "here", "--rtol", "1e-12", cwd=tmp_path)
    shutil.copy(ROOT / "configs" / "curves" / "thin_gel.csv", tmp_path)
    words = ("fit", "thin_gel.csv", "--scene", "scene.yaml", "--vary", "material.E")
    told = ran(program, *words, "--json", cwd=tmp_path).stdout
    parameter = json.loads(told)["curves"][0]["parameters"]["material.E"]
    assert parameter["low"] < 3.2 < parameter["high"]
    doctor = ran(program, "doctor", cwd=tmp_path).stdout
    assert "solver       not installed" in doctor and "make setup" not in doctor
    hertz = ran(program, "run", ROOT / "configs" / "hertz.yaml", cwd=tmp_path, code=7)
    assert "this line installs it: " in hertz.stderr and "make setup" not in hertz.stderr
