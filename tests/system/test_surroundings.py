"""The program gives the same numbers however it is started, or one clear message."""

from __future__ import annotations

import json
import os
import shlex
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import ROOT, environment

from indent_sim.results.reader import Results, read

SCENE = """\
title: "Größe ν 漢字"
body: {shape: cylinder, radius: 1.0, height: 1.0, sides: roller}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 2}
mesh: {h_contact: 0.05, h_far: 0.5}
output: {plot: false}
"""
PROGRAM = shlex.join([sys.executable, "-m", "indent_sim.cli.commands"])
NUMBERS = ("delta", "force", "a", "p_max", "energy")
SAME = 1e-9  # round-off: another order of sums, seen through a matrix whose condition is below 1e6


def shell(place: Path, line: str, **variables: str | None) -> subprocess.CompletedProcess[str]:
    """Run a line of bash in which $indent_sim is the program.

    A variable that is None is unset.
    """
    known = environment() | {"indent_sim": PROGRAM} | variables
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"],
        cwd=place,
        capture_output=True,
        text=True,
        env={name: value for name, value in known.items() if value is not None},
        errors="surrogateescape",
        timeout=300,
    )


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    return tmp_path


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The result of an ordinary run of the scene."""
    place = tmp_path_factory.mktemp("plain")
    (place / "scene.yaml").write_text(SCENE, encoding="utf-8")
    assert shell(place, "$indent_sim run scene.yaml --output out").returncode == 0
    return read(place / "out")


def same(found: Results, expected: Results) -> None:
    assert found.report["status"] == "done" and len(found) == len(expected)
    for name in NUMBERS:
        np.testing.assert_allclose(found[name], expected[name], rtol=SAME, err_msg=name)


class TestNumbers:
    @pytest.mark.parametrize(
        "variables",
        [
            {
                "LC_ALL": "C",
                "PYTHONUTF8": "0",
                "PYTHONCOERCECLOCALE": "0",
                "TERM": None,
                "COLUMNS": "x",
            },
            {"LC_ALL": "de_DE.ISO-8859-1", "LC_NUMERIC": "de_DE", "PYTHONHASHSEED": "7"},
            {
                "OMP_NUM_THREADS": "2",
                "OPENBLAS_NUM_THREADS": "2",
                "PYTHONHASHSEED": "0",
                "PYTHONOPTIMIZE": "1",
            },
        ],
        ids=["C", "German", "two threads"],
    )
    def test_variables_of_the_environment(self, place, plain, variables):
        name = "Ergebnis ü 'q\" $x"
        done = shell(place, f"$indent_sim run scene.yaml --output {shlex.quote(name)}", **variables)
        assert done.returncode == 0, done.stderr
        same(read(place / name), plain)
        again = shell(
            place,
            f"$indent_sim run scene.yaml --output {shlex.quote(name)} --resume --json",
            **variables,
        )
        assert (
            again.returncode == 0 and json.loads(again.stdout)["report"]["title"] == "Größe ν 漢字"
        )

    def test_another_working_directory_and_a_strict_umask(self, place, plain):
        (place / "elsewhere").mkdir()
        done = shell(
            place / "elsewhere", "umask 077; $indent_sim run ../scene.yaml --output ../here/out"
        )
        assert done.returncode == 0 and done.stdout == "../here/out\n", done.stderr
        same(read(place / "here" / "out"), plain)
        files = [file for file in (place / "here" / "out").rglob("*") if file.is_file()]
        assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}

    def test_a_file_name_that_is_no_text(self, place, plain):
        done = shell(place, r"$indent_sim run scene.yaml --output $'b\xffd'")
        assert done.returncode == 0 and done.stdout == "b\udcffd\n", done.stderr
        same(read(place / "b\udcffd"), plain)


class TestStreams:
    @pytest.mark.parametrize(
        ("line", "code"),
        [
            ("$indent_sim run scene.yaml --output out <&- >&- 2>&-", 0),
            ("$indent_sim run scene.yaml --output out 2>&1 | head -c 0", 0),
            ("$indent_sim run scene.yaml --output out 2>/dev/full", 0),
            ("$indent_sim run scene.yaml --output out >/dev/full", 5),
        ],
    )
    def test_a_run(self, place, plain, line, code):
        done = shell(place, line)
        assert done.returncode == code and "Traceback" not in done.stderr
        assert ("cannot write to stdout: No space left" in done.stderr) == (code == 5)
        same(read(place / "out"), plain)

    @pytest.mark.parametrize(
        ("line", "code"),
        [
            ("plan scene.yaml <&- >&- 2>&-", 0),
            ("schema | head -c 0", 0),
            ("plan scene.yaml >/dev/full", 5),
        ],
    )
    def test_other_commands(self, place, line, code):
        done = shell(place, f"$indent_sim {line}")
        assert done.returncode == code and "Traceback" not in done.stderr


class TestHome:
    """Compiled kernels and settings of dolfinx are in the home folder, if there is one."""

    @pytest.mark.parametrize(
        "variables",
        [
            {"HOME": "/dev/null"},
            {"HOME": "/proc/nobody", "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": "/dev/null/x"},
        ],
        ids=["no folder", "not writable"],
    )
    def test_without_one_there_is_another_place(self, place, plain, variables):
        nowhere: dict[str, str | None] = {"XDG_CACHE_HOME": None, "XDG_CONFIG_HOME": None}
        done = shell(place, "$indent_sim run scene.yaml --output out", **nowhere | variables)
        assert done.returncode == 0 and "kernels are kept in" in done.stderr, done.stderr
        same(read(place / "out"), plain)
        assert {entry.name for entry in place.iterdir()} == {"scene.yaml", "out"}

    def test_a_compiler_that_fails_is_named(self, place):
        cold = {"XDG_CACHE_HOME": str(place / "cache"), "CC": "/bin/false"}
        done = shell(place, "$indent_sim run scene.yaml --output out", **cold)
        assert done.returncode == 7 and "kernels cannot be compiled: CompileError" in done.stderr
        assert "Traceback" not in done.stderr

    def test_a_run_goes_on_after_an_interrupted_compilation(self, place, plain):
        cold = {"XDG_CACHE_HOME": str(place / "cache")}
        words = [
            sys.executable,
            "-m",
            "indent_sim.cli.commands",
            "run",
            "scene.yaml",
            "--output",
            "out",
        ]
        with subprocess.Popen(
            words, cwd=place, env=environment() | cold, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stderr
            while "compiling kernels" not in process.stderr.readline():
                assert process.poll() is None
            process.terminate()
            assert process.wait(60) == 143
        done = shell(place, "$indent_sim run scene.yaml --output out", **cold)
        assert done.returncode == 0, done.stderr
        same(read(place / "out"), plain)


class TestLimits:
    """Limits at which MPI or gmsh would end without a word, or hang."""

    @pytest.mark.parametrize("limit", ["-n 16", "-v 100000", "-v 300000", "-v 600000"])
    def test_too_narrow(self, place, limit):
        done = shell(place, f"ulimit {limit}; $indent_sim run scene.yaml --output out")
        assert (
            done.returncode == 7
            and f"(ulimit {limit[:2]})" in done.stderr
            and "Traceback" not in done.stderr
        )
        assert os.listdir(place) == ["scene.yaml"]

    def test_too_few_processes(self, place):
        """A limit of processes ends the run with a message, where Open MPI would say nothing.

        The run is that of a user to whom the limit applies.
        """
        if os.geteuid() != 0 or shell(place, "setpriv --reuid=65534 true").returncode != 0:
            pytest.skip("only root may become somebody else")
        line = f"ulimit -u 6; exec {PROGRAM} run scene.yaml --output out"
        done = shell(place, f"exec setpriv --reuid=65534 bash -c {shlex.quote(line)}")
        assert (
            done.returncode == 7 and "(ulimit -u)" in done.stderr and "Traceback" not in done.stderr
        ), done.stderr
        assert os.listdir(place) == ["scene.yaml"]

    def test_no_room_for_temporary_files(self, place):
        """A full /tmp ends the run with a message."""
        fill = (
            "mount -t tmpfs -o size=16k tmpfs /tmp; head -c 20k /dev/zero > /tmp/full; cd -P "
            "/proc/self/fd/9"
        )
        line = (
            "exec 9<.; unshare -m bash -c "
            f"{shlex.quote(fill + ' && $indent_sim run scene.yaml --output out')}"
        )
        if os.geteuid() != 0 or shell(place, "unshare -m true").returncode != 0:
            pytest.skip("only root may mount another /tmp")
        done = shell(place, line)
        assert (
            done.returncode == 5
            and "cannot write temporary files in /tmp: No space left" in done.stderr
        ), done.stderr
        assert "Traceback" not in done.stderr


def test_two_runs_at_once_into_one_folder(place, plain):
    """Of two runs into one folder at once one is done and the other refused."""
    words = [
        sys.executable,
        "-m",
        "indent_sim.cli.commands",
        "run",
        "scene.yaml",
        "--output",
        "out",
    ]
    pair = [
        subprocess.Popen(words, cwd=place, env=environment(), stderr=subprocess.PIPE, text=True)
        for _ in "ab"
    ]
    told = [process.communicate(timeout=120)[1] for process in pair]
    codes = [process.returncode for process in pair]
    assert sorted(codes) in ([0, 2], [0, 0]), (
        told
    )  # two zeros: the first was done before the second began
    assert all(
        "in use by another run" in text for text, code in zip(told, codes, strict=True) if code == 2
    )
    same(read(place / "out"), plain)
    assert os.listdir(ROOT) and {entry.name for entry in place.iterdir()} == {"scene.yaml", "out"}


def test_petsc_options_of_the_environment_are_the_users(place, plain):
    said = "-ksp_monitor ascii:residuals.txt -log_view ascii:times.txt"
    done = shell(
        place,
        "$indent_sim run scene.yaml --output out --set solver.method=newton",
        PETSC_OPTIONS=said,
    )
    assert done.returncode == 0 and done.stdout == "out\n", done.stderr
    assert "KSP Residual norm" in (place / "residuals.txt").read_text()
    assert "KSPSolve" in (place / "times.txt").read_text()
    found = read(place / "out")
    np.testing.assert_allclose(
        found["force"], plain["force"], rtol=1e-8
    )  # the residual of Newton's method: 1e-9
    assert found.report["PETSC_OPTIONS"] == said and "PETSC_OPTIONS" not in plain.report


def test_settings_that_lie_beside_a_scene_are_not_read(place, plain):
    """Settings of libraries beside a scene are not read.

    Whoever sends a folder with a scene could send these too, and they would run commands at the
    first import.
    """
    for name in ("petscrc", ".petscrc"):
        (place / name).write_text("-log_view ascii:x\n-ksp_type python\n")
    wrapper = json.dumps(
        {"cffi_extra_compile_args": ["-wrapper", "touch,PWNED"], "cache_dir": str(place / "cache")}
    )
    for name in ("dolfinx_jit_parameters.json", "dolfinx_jit_options.json"):
        (place / name).write_text(wrapper)
    for name in ("ffcx_parameters.json", "ffcx_options.json"):
        (place / name).write_text('{"scalar_type": "float"}')
    (place / "matplotlibrc").write_text("text.usetex: True\nsavefig.directory: /\nfigure.dpi: 1\n")
    before = set(os.listdir(place))
    done = shell(place, "$indent_sim run scene.yaml --output out --set output.plot=true")
    assert done.returncode == 0, done.stderr
    same(read(place / "out"), plain)
    assert set(os.listdir(place)) == before | {"out"}
