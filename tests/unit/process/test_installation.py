"""The command that installs a missing part is one that works on the system at hand."""

from __future__ import annotations

import platform
import sys
from types import SimpleNamespace

import pytest

from indent_sim.process import installation


@pytest.fixture
def system(monkeypatch, tmp_path):
    """Function that makes this system another one, with an environment that pip has filled."""

    def become(kind: str, machine: str, python: tuple[int, int], glibc: str = "2.36") -> None:
        monkeypatch.setattr(sys, "prefix", str(tmp_path))
        monkeypatch.setattr(sys, "platform", kind)
        monkeypatch.setattr(sys, "version_info", (*python, 0))
        monkeypatch.setattr(platform, "machine", lambda: machine)
        monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", glibc))
        monkeypatch.setattr(installation, "_source_folder", lambda: "")

    return become


@pytest.mark.parametrize(
    ("kind", "machine", "python", "glibc", "command"),
    [
        ("linux", "x86_64", (3, 12), "2.34", "pip install 'indent-sim[solver]'"),
        ("linux", "x86_64", (3, 11), "2.36", "conda create "),
        ("linux", "x86_64", (3, 13), "2.31", "conda create "),
        ("linux", "aarch64", (3, 13), "2.36", "conda create "),
        ("darwin", "arm64", (3, 13), "", "conda create "),
        ("win32", "AMD64", (3, 13), "", "wsl --install"),
    ],
)
def test_the_solver_where_pypi_has_it_and_elsewhere(system, kind, machine, python, glibc, command):
    system(kind, machine, python, glibc)
    assert installation.solver_command().startswith(command)
    assert installation.solver_command() in installation.missing_solver_text()
    commands = [installation.program_command(), installation.afm_command()]
    extra = '"indent-sim[afm]"' if kind == "win32" else "'indent-sim[afm]'"
    assert commands == ["pip install indent-sim", f"pip install {extra}"]


def test_an_environment_of_conda_is_completed_by_conda(system, tmp_path):
    system("darwin", "arm64", (3, 13))
    (tmp_path / "conda-meta").mkdir()
    assert installation.solver_command().startswith("conda install -c conda-forge fenics-dolfinx")
    assert installation.compiler_command().startswith("conda install")


def test_only_the_environment_of_make_setup_is_mended_by_make_setup(system, tmp_path):
    system("linux", "x86_64", (3, 11))
    assert "make setup" not in installation.solver_command()
    (tmp_path / installation.SETUP_STAMP).write_text("")
    commands = installation.solver_command(), installation.program_command()
    assert commands == ("make setup", "make setup")
    assert installation.afm_command() == "make setup AFM=1"


def test_the_folder_from_which_pip_has_installed_is_named(system, monkeypatch, tmp_path):
    source_folder = installation._source_folder
    system("linux", "x86_64", (3, 13))
    record = f'{{"url": "{tmp_path.as_uri()}", "dir_info": {{}}}}'
    found = SimpleNamespace(read_text=lambda name: record)
    monkeypatch.setattr(installation, "distribution", lambda name: found)
    monkeypatch.setattr(installation, "_source_folder", source_folder)
    assert installation.solver_command() == f"pip install '{tmp_path}[solver]'"
