"""The command line: its output, its exit codes, and the files it leaves."""

from __future__ import annotations

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from command_line import command, environment

from indent_sim.cli import commands, doctor
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.strict_yaml import parse
from indent_sim.process.errors import (
    BackendError,
    ConfigError,
    MeshError,
    NotConverged,
    UsageError,
    VerificationError,
)
from indent_sim.process.signals import Interrupted
from indent_sim.results.reader import read
from indent_sim.run.pipeline import simulate
from indent_sim.run.single_run import SingleRun

SCENE = """\
title: A coarse one
body: {shape: cylinder, radius: 1.0, height: 1.0, sides: roller}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 3}
mesh: {h_contact: 0.03, h_far: 0.5}
"""
THEORY = """\
body: {shape: half_space}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 3}
"""

Run = Callable[..., Result]


@pytest.fixture
def indent_sim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A function that runs a command in this process, in an empty directory with scene.yaml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    return lambda *words: CliRunner().invoke(commands.program, [str(word) for word in words])


@pytest.fixture
def theory_run(indent_sim: Run, tmp_path: Path) -> Path:
    """The directory of a scene that theory solves, and of its result `out`."""
    (tmp_path / "scene.yaml").write_text(THEORY)
    assert indent_sim("run", "scene.yaml", "--output", "out").exit_code == 0
    return tmp_path


def left(folder: Path) -> set[str]:
    """Names of the entries of a folder beside the scene."""
    return {entry.name for entry in folder.iterdir()} - {"scene.yaml"}


def content_of(folder: Path) -> dict[Path, bytes]:
    """The bytes of all files below a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@contextmanager
def long_run(folder: Path, rows: int) -> Iterator[subprocess.Popen[str]]:
    """A run of many steps in a process of its own, given once its first rows are there."""
    (folder / "scene.yaml").write_text(SCENE.replace("steps: 3", "steps: 100000"))
    words = command("run", "scene.yaml", "--output", "out")
    table = folder / "out" / "force_indentation.csv"
    with subprocess.Popen(
        words,
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            deadline = time.monotonic() + 120
            while not table.exists() or table.read_text().count("\n") <= rows:
                assert process.poll() is None and time.monotonic() < deadline
                time.sleep(0.05)
            yield process
        finally:
            process.kill()


class TestWithoutARun:
    def test_start_up_is_lean(self):
        heavy = "{'numpy', 'rich', 'mpi4py', 'pydantic', 'matplotlib', 'dolfinx'}"
        script = f"import sys, indent_sim.cli.commands; sys.exit(bool({heavy} & set(sys.modules)))"
        assert subprocess.run([sys.executable, "-c", script], env=environment()).returncode == 0

    @pytest.mark.parametrize("number", [4, 5, 8, 20, 60, 120, 250])
    def test_ctrl_c_while_it_loads_is_no_traceback(self, number: int) -> None:
        """Ctrl-C during any import of the program ends it without a traceback.

        The first three modules are the package, `cli` and `start`, in which Python's own handler
        ends before that of the program begins.
        """
        script = (
            "import os, signal, sys\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "imports = []\n"
            "def interrupt(event, values):\n"
            "    if event == 'import' and not values[0].startswith('encodings'):\n"
            "        imports.append(values[0])\n"
            f"        if len(imports) == {number}:\n"
            "            os.kill(os.getpid(), signal.SIGINT)\n"
            "sys.addaudithook(interrupt)\n"
            "from indent_sim.cli.start import main\n"
            "assert {*imports[:3]} == {'indent_sim', 'indent_sim.cli', 'indent_sim.cli.start'}\n"
            "sys.argv = ['indent-sim', 'plan', 'no_such_file.yaml']\n"
            "main()\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", script], env=environment(), capture_output=True, text=True
        )
        assert done.returncode in (-signal.SIGINT, 128 + signal.SIGINT), done.stderr
        assert "Traceback" not in done.stderr

    def test_help_names_every_command(self, indent_sim):
        help_text = indent_sim("--help").stdout
        assert all(
            name in help_text
            for name in ("run", "plan", "compare", "plot", "list", "schema", "doctor")
        )

    def test_module_is_the_command(self):
        from indent_sim import __version__

        command = [sys.executable, "-m", "indent_sim", "--version"]
        assert __version__ in subprocess.run(command, capture_output=True, text=True).stdout

    def test_version(self, indent_sim):
        from indent_sim import __version__

        assert __version__ in indent_sim("--version").stdout

    @pytest.mark.parametrize(
        ("kind", "word"),
        [
            ("materials", "linear_elastic"),
            ("indenters", "half_angle"),
            ("contact", "epsilon_n"),
            ("bodies", "strip"),
        ],
    )
    def test_list(self, indent_sim, kind, word):
        one, everything = indent_sim("list", kind), indent_sim("list")
        assert one.exit_code == 0 and word in one.stdout and word in everything.stdout

    def test_schema_is_json(self, indent_sim):
        assert "indenter" in json.loads(indent_sim("schema").stdout)["properties"]

    def test_plan_says_why_and_writes_nothing(self, indent_sim, tmp_path):
        shown, data = indent_sim("plan", "scene.yaml"), indent_sim("plan", "scene.yaml", "--json")
        plan = json.loads(data.stdout)
        assert shown.exit_code == data.exit_code == 0 and left(tmp_path) == set()
        assert {choice["key"] for choice in plan["choices"]} >= {
            "symmetry",
            "contact.gap",
            "mesh.h_contact",
        }
        assert all(choice["why"] and choice["key"] in shown.stdout for choice in plan["choices"])
        assert plan["prediction"]["force"] == pytest.approx(1.608e-3, rel=0.01)

    def test_set_reaches_the_plan(self, indent_sim):
        plan = json.loads(
            indent_sim("plan", "scene.yaml", "--set", "mesh.h_contact=0.02", "--json").stdout
        )
        assert next(
            c["value"] for c in plan["choices"] if c["key"] == "mesh.h_contact"
        ) == pytest.approx(0.02)

    def test_doctor_is_content_here(self, indent_sim):
        found = indent_sim("doctor", "--json")
        assert found.exit_code == 0, found.stdout
        assert {check["name"] for check in json.loads(found.stdout)["checks"]} >= {
            "dolfinx",
            "MUMPS",
            "gmsh",
            "BLAS",
        }

    def test_doctor_leaves_ctrl_c_alone(self, indent_sim):
        """`doctor` restores the handler of SIGINT, which importing gmsh resets."""
        before = signal.getsignal(signal.SIGINT)
        for name in ("gmsh", "indent_sim.mesh.loaded_gmsh"):
            sys.modules.pop(name, None)
        indent_sim("doctor")
        assert signal.getsignal(signal.SIGINT) == before

    def test_doctor_names_the_cache_that_runs_use(self, tmp_path):
        (tmp_path / "dolfinx").mkdir()
        for name in ("dolfinx_jit_parameters.json", "dolfinx_jit_options.json"):
            (tmp_path / "dolfinx" / name).write_text(
                json.dumps({"cache_dir": str(tmp_path / "elsewhere")})
            )
        done = subprocess.run(
            command("doctor"),
            env=environment() | {"XDG_CONFIG_HOME": str(tmp_path)},
            text=True,
            capture_output=True,
            cwd=tmp_path,
        )
        assert done.returncode == 0 and f"JIT cache    {tmp_path / 'elsewhere'}" in done.stdout

    def test_doctor_without_a_working_directory(self, tmp_path):
        """Without a working directory `doctor` says that this alone is broken.

        A run ends with a message about it.
        """
        gone = tmp_path / "gone"
        for words in ("doctor", "--json"), ("run", str(tmp_path / "scene.yaml")):
            line = f"mkdir {gone}; cd {gone}; rmdir {gone}; exec {shlex.join(command(*words))}"
            done = subprocess.run(
                ["bash", "-c", line], env=environment(), capture_output=True, text=True
            )
            if words[0] == "doctor":
                found = json.loads(done.stdout)
                broken = [check for check in found["checks"] if check["verdict"] == "broken"]
                assert done.returncode == 7 and [check["name"] for check in broken] == ["directory"]
            else:
                assert (
                    done.returncode == 2
                    and "working directory no longer exists; change" in done.stderr
                )

    def test_doctor_tells_what_is_broken(self, indent_sim, monkeypatch):
        monkeypatch.setattr(doctor, "NEEDED_PACKAGES", ("numpy", "no_such_package"))
        found = indent_sim("doctor")
        assert (
            found.exit_code == 7
            and "no_such_package" in found.stderr
            and "ModuleNotFound" in found.stdout
        )

    def test_nobody_listening_is_no_bug(self):
        with subprocess.Popen(
            command("schema"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
        ) as process:
            assert process.stdout and process.stderr
            process.stdout.close()
            assert process.stderr.read() == b""
            assert process.wait(30) == 0


class TestRefusals:
    """Exit codes 2 and 3: nothing is created."""

    @pytest.mark.parametrize(
        "words",
        [
            ("dance",),
            ("run",),
            ("run", "scene.yaml", "--bogus"),
            ("run", "missing.yaml"),
            ("run", "."),
            ("run", "scene.yaml", "--output", "scene.yaml"),
            ("run", "scene.yaml", "--output", "scene.yaml/out"),
            ("plan", "missing.yaml"),
            ("compare", "missing", "scene.yaml"),
            ("compare", "scene.yaml", "scene.yaml", "--rtol", "nan"),
            ("plot", "missing"),
            ("plot",),
            ("list", "tips"),
        ],
    )
    def test_usage(self, indent_sim, tmp_path, words):
        done = indent_sim(*words)
        assert done.exit_code == 2 and done.stderr and "Traceback" not in done.stderr
        assert done.stdout == "" and left(tmp_path) == set()

    @pytest.mark.parametrize(
        ("before", "after", "line", "key"),
        [
            (SCENE, "", 1, ""),
            ("mesh: {", "mesh: [", 6, ""),
            ("mesh:", "indenter:", 6, "indenter"),
            ("R: 1.0", "r: 1.0", 4, "indenter.r"),
            ("nu: 0.3", "nu: 0.7", 3, "material.nu"),
        ],
        ids=["empty", "no YAML", "key given twice", "unknown key", "out of range"],
    )
    @pytest.mark.parametrize("verb", ["run", "plan"])
    def test_malformed_scenes(self, indent_sim, tmp_path, verb, before, after, line, key):
        """A malformed scene ends with exit code 3 and a message with its line and key.

        These are a few of the scenes of tests/unit/config/test_malformed.py, which tries each of
        them.
        """
        assert before in SCENE
        (tmp_path / "scene.yaml").write_text(SCENE.replace(before, after))
        done = indent_sim(verb, "scene.yaml")
        assert done.exit_code == 3 and left(tmp_path) == set()
        assert f"scene.yaml:{line}" in done.stderr and key in done.stderr and done.stdout == ""

    @pytest.mark.parametrize(
        ("override", "said"),
        [
            ("indenter.r=3", "did you mean 'R'"),
            ("loading.delta=2", "beyond the body's thickness"),
            ("mesh.h_contact=1e-9", "machine has"),
        ],
    )
    def test_scenes_that_cannot_be(self, indent_sim, tmp_path, override, said):
        done = indent_sim("run", "scene.yaml", "--set", override)
        assert done.exit_code == 3 and said in done.stderr and left(tmp_path) == set()

    def test_a_foreign_folder(self, indent_sim, tmp_path):
        (tmp_path / "theirs").mkdir()
        (tmp_path / "theirs" / "thesis.tex").write_text("")
        done = indent_sim("run", "scene.yaml", "--output", "theirs")
        assert (
            done.exit_code == 2
            and left(tmp_path) == {"theirs"}
            and left(tmp_path / "theirs") == {"thesis.tex"}
        )

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
    def test_an_unwritable_folder(self, indent_sim, tmp_path):
        (tmp_path / "closed").mkdir(mode=0o500)
        done = indent_sim("run", "scene.yaml", "--output", "closed/out")
        assert done.exit_code == 2 and left(tmp_path / "closed") == set()


class TestJson:
    """With --json there is one object on stdout, however the command ends."""

    @pytest.mark.parametrize(
        ("words", "code", "kind"),
        [
            (("run", "nowhere.yaml", "--json"), 2, "UsageError"),
            (("run", "--json"), 2, "UsageError"),
            (("run", "scene.yaml", "--json", "--bogus"), 2, "UsageError"),
            (("--bogus", "plan", "scene.yaml", "--json"), 2, "UsageError"),
            (("frobnicate", "--json"), 2, "UsageError"),
            (("compare", "scene.yaml", "scene.yaml", "--json"), 2, "UsageError"),
            (("list", "nothing", "--json"), 2, "UsageError"),
            (("study", "scene.yaml", "--json"), 3, "ConfigError"),
            (("plan", "scene.yaml", "--json", "--set", "body.radius=-1"), 3, "ConfigError"),
            (("run", "scene.yaml", "--json", "--set", "indenter.R=x"), 3, "ConfigError"),
        ],
    )
    def test_refusals(self, indent_sim, words, code, kind):
        ended = indent_sim(*words)
        told = json.loads(ended.stdout)
        assert (ended.exit_code, told["exit_code"], told["status"]) == (
            code,
            code,
            "failed",
        ) and ended.stderr
        assert told["error"].keys() == {"type", "message", "file", "line", "key", "remedy"}
        assert told["error"]["type"] == kind and told["error"]["message"]

    def test_what_cannot_be_read_is_named(self, indent_sim):
        for words, file in (
            (("plan", "none.yaml"), "none.yaml"),
            (("compare", "none.csv", "none.csv"), "none.csv"),
        ):
            told = json.loads(indent_sim(*words, "--json").stdout)
            assert (told["exit_code"], told["error"]["file"]) == (2, file)

    def test_what_another_config_has_is_at_its_line(self, indent_sim, theory_run):
        (theory_run / "scene.yaml").write_text(THEORY.replace("nu: 0.3", "nu: 0.2"))
        told = json.loads(
            indent_sim("run", "scene.yaml", "--output", "out", "--resume", "--json").stdout
        )
        error = told["error"]
        assert (told["exit_code"], error["file"], error["line"], error["key"]) == (
            3,
            "scene.yaml",
            2,
            "material.nu",
        )
        assert (
            "'nu: 0.3' there, 'nu: 0.2' here" in error["message"] and "--output" in error["remedy"]
        )

    @pytest.mark.parametrize("lost", ["config.yaml", "force_indentation.csv"])
    def test_a_result_that_lost_a_file_says_what_to_do(self, indent_sim, theory_run, lost):
        """A result without one of its files names the file and a remedy that works."""
        (theory_run / "out" / lost).unlink()
        told = json.loads(
            indent_sim("run", "scene.yaml", "--output", "out", "--resume", "--json").stdout
        )
        assert (
            told["exit_code"] == 2 and told["error"]["message"] == f"out has run.json but no {lost}"
        )
        assert "without --resume" in told["error"]["remedy"]
        assert indent_sim("run", "scene.yaml", "--output", "out").exit_code == 0
        assert indent_sim("plot", "out").exit_code == 0

    def test_a_damaged_run_json_says_what_to_do(self, indent_sim, theory_run):
        (theory_run / "out" / "run.json").write_text("{")
        told = json.loads(
            indent_sim("run", "scene.yaml", "--output", "out", "--resume", "--json").stdout
        )
        assert (told["exit_code"], told["error"]["file"]) == (2, "out/run.json")
        assert told["error"]["remedy"].startswith("delete the folder")

    def test_a_study_has_no_curve_of_its_own(self, indent_sim, theory_run):
        (theory_run / "study.yaml").write_text("base: scene.yaml\nvary: {material.E: [1.0, 2.0]}\n")
        assert indent_sim("study", "study.yaml", "--output", "all").exit_code == 0
        ended = indent_sim("compare", "all", "all")
        assert (
            ended.exit_code == 2
            and "all contains a study" in ended.stderr
            and "all/runs/NAME" in ended.stderr
        )
        assert indent_sim("plot", *sorted((theory_run / "all" / "runs").iterdir())).exit_code == 0

    def test_a_fresh_run_reports_what_a_resumed_one_does(self, indent_sim, theory_run):
        fresh, resumed = (
            json.loads(
                indent_sim("run", "scene.yaml", "--output", "new", "--resume", "--json").stdout
            )
            for _ in range(2)
        )
        assert (
            list(fresh["report"]) == list(resumed["report"])
            and fresh["report"] == resumed["report"]
        )
        writers = {
            "program",
            "version",
            "status",
            "rows",
            "started",
            "finished",
            "reason",
            "exit_code",
        }
        assert writers <= fresh["report"].keys()

    def test_a_config_error_is_at_its_line(self, indent_sim, tmp_path):
        (tmp_path / "scene.yaml").write_text(
            SCENE.replace("R: 1.0", "r: 1.0").replace("nu: 0.3", "nu: 0.7")
        )
        told = json.loads(indent_sim("plan", "scene.yaml", "--json").stdout)
        assert [(error["key"], error["line"]) for error in told["errors"]] == [
            ("material.nu", 3),
            ("indenter.r", 4),
        ]
        assert told["error"] == told["errors"][0] and told["error"]["file"] == "scene.yaml"
        assert told["error"]["message"] == "must be > -1 and <= 0.5, got 0.7"

    @pytest.mark.parametrize(
        ("error", "code", "status"),
        [
            (MeshError("no mesh"), 4, "failed"),
            (NotConverged("no way"), 5, "failed"),
            (VerificationError("not so"), 6, "failed"),
            (BackendError("gone"), 7, "failed"),
            (KeyError("a bug"), 1, "failed"),
            (Interrupted(signal.SIGTERM), 143, "interrupted"),
        ],
        ids=str,
    )
    def test_failures_signals_and_bugs(self, indent_sim, monkeypatch, error, code, status):
        def fails(*args, **options):
            raise error

        monkeypatch.setattr("indent_sim.run.pipeline.simulate", fails)
        ended = indent_sim("run", "scene.yaml", "--json")
        told = json.loads(ended.stdout)
        assert (ended.exit_code, told["exit_code"], told["status"]) == (code, code, status)
        assert told["error"]["type"] == type(error).__name__ and told["error"]["message"] == str(
            error
        )
        assert ("Traceback" in ended.stderr) == (code == 1)

    def test_doctor_says_both(self, indent_sim, monkeypatch):
        monkeypatch.setattr(doctor, "NEEDED_PACKAGES", ("no_such_package",))
        told = json.loads(indent_sim("doctor", "--json").stdout)
        assert (
            told["exit_code"] == 7
            and told["checks"]
            and "no_such_package" in told["error"]["message"]
        )

    def test_success_says_so_too(self, indent_sim):
        for words in (("plan", "scene.yaml", "--json"), ("doctor", "--json")):
            told = json.loads(indent_sim(*words).stdout)
            assert (told["status"], told["exit_code"]) == ("done", 0)

    def test_without_json_nothing_is_printed(self, indent_sim):
        assert indent_sim("run", "nowhere.yaml").stdout == ""


class TestEndings:
    @pytest.mark.parametrize(
        ("error", "code"),
        [
            (UsageError("x"), 2),
            (ConfigError("a.b", "x"), 3),
            (MeshError("x"), 4),
            (NotConverged("x"), 5),
            (VerificationError("x"), 6),
            (BackendError("x"), 7),
            (KeyboardInterrupt(), 130),
            (ZeroDivisionError("x"), 1),
        ],
    )
    def test_every_failure_has_its_exit_code(self, indent_sim, monkeypatch, error, code):
        def fail(*args, **options):
            raise error

        monkeypatch.setattr("indent_sim.run.pipeline.simulate", fail)
        done = indent_sim("run", "scene.yaml")
        assert done.exit_code == code and done.stdout == "" and done.stderr
        assert ("Traceback" in done.stderr) == (code == 1)

    def test_a_swallowed_signal_is_not_forgotten(self, indent_sim, monkeypatch):
        """A signal ends a run also where a library turns its exception into another."""

        def swallow(*args, **options):
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(1)
            except BaseException as error:
                raise ImportError("initialization failed") from error

        monkeypatch.setattr("indent_sim.run.pipeline.simulate", swallow)
        assert indent_sim("run", "scene.yaml").exit_code == 143

    @pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
    def test_a_stopped_run_keeps_its_rows(self, tmp_path, number, code):
        with long_run(tmp_path, rows=2) as process:
            process.send_signal(number)
            out, err = process.communicate(timeout=60)
        assert process.returncode == code and out == "" and "Traceback" not in err
        done = read(tmp_path / "out")
        assert done.report["status"] == "interrupted" and done.report["exit_code"] == code
        assert len(done) == done.report["rows"] >= 2
        assert f"{len(done)} rows" in err and left(tmp_path) == {"out"}
        assert not (tmp_path / "out" / ".lock").exists()


class TestRuns:
    def test_a_run_prints_its_folder_and_tells_its_story(self, indent_sim, tmp_path):
        done = indent_sim("run", "scene.yaml")
        assert done.exit_code == 0, done.stderr
        assert done.stdout == "results/scene\n"
        assert all(
            word in done.stderr for word in ("step 1/3", "step 3/3", "theory", "Hertz", "picture")
        )
        folder = tmp_path / "results" / "scene"
        expected = {
            "force_indentation.csv",
            "surface.csv",
            "fields.xdmf",
            "tip.xdmf",
            "fields",
            "config.yaml",
            "run.json",
        }
        assert left(folder) == expected | {"force_indentation.png"}
        assert read(folder).report["exit_code"] == 0

    def test_the_written_config_reproduces_the_run(self, indent_sim, tmp_path):
        assert indent_sim("run", "scene.yaml", "--output", "A").exit_code == 0
        (tmp_path / "again.yaml").write_text((tmp_path / "A" / "config.yaml").read_text())
        assert indent_sim("run", "again.yaml", "--output", "B").exit_code == 0
        assert indent_sim("compare", "A", "B", "--rtol", "1e-12").exit_code == 0

    def test_json_is_one_object(self, indent_sim, tmp_path):
        done = indent_sim("run", "scene.yaml", "--json", "--output", tmp_path / "deep" / "out")
        said = json.loads(done.stdout)
        table = read(Path(said["directory"]))
        assert [row["force"] for row in said["rows"]] == table["force"].tolist()
        assert said["report"]["theory"]["force"] == pytest.approx(table["force"][-1], rel=0.02)

    def test_the_folder_of_the_config_is_used(self, indent_sim, tmp_path):
        done = indent_sim(
            "run", "scene.yaml", "--set", "output.directory=here", "--set", "output.plot=false"
        )
        assert done.stdout == "here\n" and "force_indentation.png" not in left(tmp_path / "here")

    def test_a_second_run_replaces_the_first(self, indent_sim, tmp_path):
        for steps in (3, 2):
            words = ("--set", f"loading.steps={steps}", "--overwrite")
            assert indent_sim("run", "scene.yaml", *words).exit_code == 0
        assert len(read(tmp_path / "results" / "scene")) == 2 and left(tmp_path / "results") == {
            "scene"
        }

    def test_a_run_into_a_folder_in_use_is_refused(self, indent_sim, tmp_path):
        with long_run(tmp_path, rows=1):
            done = indent_sim("run", "scene.yaml", "--output", "out")
        assert done.exit_code == 2 and "in use" in done.stderr

    def test_a_killed_run_leaves_readable_files_and_a_free_folder(self, indent_sim, tmp_path):
        with long_run(tmp_path, rows=3) as process:
            process.kill()
            process.wait()
        assert (
            len(read(tmp_path / "out")) >= 3
            and read(tmp_path / "out").report["status"] == "running"
        )
        (tmp_path / "scene.yaml").write_text(SCENE)
        assert indent_sim("run", "scene.yaml", "--output", "out").exit_code == 0
        assert len(read(tmp_path / "out")) == 3


class TestAnotherConfigFile:
    """Rows of another config file are only replaced with --overwrite.

    The path of the config file is in run.json.
    """

    @pytest.fixture
    def again(self, indent_sim: Run, theory_run: Path) -> Callable[..., int]:
        """A function that runs a scene into a folder once more and returns the exit code.

        A refusal must leave everything as it was.
        """
        (theory_run / "b.yaml").write_text(THEORY)

        def run(*words: str) -> int:
            before = content_of(theory_run)
            done = indent_sim("run", *words)
            assert done.exit_code in (0, 2), done.stderr
            is_refused = "another config file" in done.stderr or "another scene" in done.stderr
            assert (done.exit_code == 2) == (is_refused and "--overwrite" in done.stderr)
            assert (content_of(theory_run) == before) == (done.exit_code == 2)
            return done.exit_code

        return run

    def test_it_is_refused_and_replaced_when_asked_for(self, again, theory_run):
        assert read(theory_run / "out").report["asked"]["config"] == str(theory_run / "scene.yaml")
        assert again("b.yaml", "--output", "out") == 2
        assert again("b.yaml", "--output", "out", "--overwrite") == 0
        assert again("scene.yaml", "--output", "out") == 2

    def test_the_same_file_replaces_its_run_however_it_is_named(
        self, again, theory_run, monkeypatch
    ):
        (theory_run / "link.yaml").symlink_to("scene.yaml")
        (theory_run / "deep").mkdir()
        assert again("link.yaml", "--output", str(theory_run / "out")) == 0
        monkeypatch.chdir(theory_run / "deep")
        assert (
            again("../scene.yaml", "--output", "../out") == 0
            and again("../b.yaml", "--output", "../out") == 2
        )

    @pytest.mark.parametrize("copied", [False, True])
    def test_a_file_and_its_result_that_moved_together(self, again, theory_run, tmp_path, copied):
        place = tmp_path / "moved"
        place.mkdir()
        for name in ("scene.yaml", "out", "b.yaml"):
            if copied:
                subprocess.run(["cp", "-r", theory_run / name, place], check=True)
            else:
                (theory_run / name).rename(place / name)
        assert again("moved/b.yaml", "--output", "moved/out") == 2
        assert again("moved/scene.yaml", "--output", "moved/out") == 0

    def test_what_names_no_file_is_replaced(self, again, theory_run):
        """A result that names no config file is replaced if its scene is the same.

        Such results are those of an older version, of a notebook, and those without rows.
        """
        report = theory_run / "out" / "run.json"
        known = json.loads(report.read_text())
        report.write_text(
            json.dumps({name: value for name, value in known.items() if name != "asked"})
        )
        assert again("b.yaml", "--output", "out") == 0
        simulate(config_from_mapping(parse(THEORY)[0]), directory=theory_run / "out")
        assert again("scene.yaml", "--output", "out") == 0
        table = theory_run / "out" / "force_indentation.csv"
        table.write_text(table.read_text().splitlines()[0] + "\n")
        assert again("b.yaml", "--output", "out") == 0

    def test_runs_of_a_study_know_no_file(self, indent_sim, theory_run):
        """The base of a study may move, as its runs are identified by their physics."""
        (theory_run / "study.yaml").write_text("base: scene.yaml\nvary: {material.E: [1.0, 2.0]}\n")
        assert indent_sim("study", "study.yaml", "--output", "all").exit_code == 0
        (theory_run / "study.yaml").write_text("base: b.yaml\nvary: {material.E: [1.0, 2.0]}\n")
        (theory_run / "b.yaml").write_text(THEORY)
        assert indent_sim("study", "study.yaml", "--output", "all").exit_code == 0


class TestAnotherScene:
    """A finished run is replaced by a finished one of the same scene; --overwrite allows any."""

    def test_it_is_refused_with_what_differs_and_where_to_go(self, indent_sim, theory_run):
        before = content_of(theory_run)
        words = (
            "run",
            "scene.yaml",
            "--output",
            "out",
            "--set",
            "material.E=2",
            "--set",
            "loading.steps=2",
        )
        done = indent_sim(*words)
        assert done.exit_code == 2 and content_of(theory_run) == before
        said = (
            "out contains the finished run of another scene: material.E was 1.0 and is 2.0, "
            "loading.steps was 3 and is 2"
        )
        assert (
            said in done.stderr
            and "--output, such as out-2, or replace it with --overwrite" in done.stderr
        )
        error = json.loads(indent_sim(*words, "--json").stdout)["error"]
        assert error["message"].endswith(said.partition("out")[2]) and "out-2" in error["remedy"]
        assert indent_sim(*words, "--overwrite").exit_code == 0
        assert len(read(theory_run / "out")) == 2 and not (theory_run / "out-2").exists()

    @pytest.mark.parametrize(
        ("words", "code"),
        [
            (("title=another",), 0),
            (("output.plot=false",), 0),
            (("contact.method=auto",), 0),
            (("material.E=1.0",), 0),
            (("contact.method=penalty",), 2),
            (("accuracy=0.1",), 2),
            (("material.nu=0.31",), 2),
            (("indenter={shape: cone, half_angle: 70}",), 2),
        ],
    )
    def test_what_counts_as_another_scene(self, indent_sim, theory_run, words, code):
        """Every key that changes numbers or what is kept makes another scene.

        That also holds for a key that was left to the program before.
        """
        sets = [word for one in words for word in ("--set", one)]
        assert indent_sim("run", "scene.yaml", "--output", "out", *sets).exit_code == code

    def test_error_bars_are_not_lost(self, indent_sim, theory_run):
        words = ("run", "scene.yaml", "--output", "out")
        assert indent_sim(*words, "--error-bars").exit_code == 0
        done = indent_sim(*words)
        assert done.exit_code == 2
        assert (
            "of another scene: it has error bars, but the new run has no --error-bars"
            in done.stderr
        )

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ((), ("accuracy=0.1",), "accuracy was missing and is 0.1;"),
            (("accuracy=0.1",), (), "accuracy was 0.1 and is missing now;"),
            ((), ("indenter.R=2.0",), "indenter.R was 1.0 and is 2.0;"),
            (
                (),
                ("indenter={shape: cone, half_angle: 70}",),
                "indenter.R was 1.0 and is missing now",
            ),
        ],
    )
    def test_differences_are_sentences(self, indent_sim, old, new, said):
        """A key is in both scenes, or missing from one of them."""
        Path("scene.yaml").write_text(THEORY)
        old_sets, new_sets = (
            [word for setting in settings for word in ("--set", setting)] for settings in (old, new)
        )
        words = ("run", "scene.yaml", "--output", "out")
        assert indent_sim(*words, *old_sets).exit_code == 0
        done = indent_sim(*words, *new_sets)
        assert done.exit_code == 2 and said in done.stderr, done.stderr

    def test_a_run_that_was_not_finished_is_replaced(self, indent_sim, theory_run):
        """A run that failed or was stopped is replaced by another scene without --overwrite."""
        report = theory_run / "out" / "run.json"
        said = json.loads(report.read_text())
        for status, code in (("failed", 5), ("interrupted", 130), ("running", None)):
            report.write_text(json.dumps(said | {"status": status, "exit_code": code}))
            E = {"failed": 2, "interrupted": 3, "running": 4}[status]
            assert (
                indent_sim(
                    "run", "scene.yaml", "--output", "out", "--set", f"material.E={E}"
                ).exit_code
                == 0
            )

    def test_one_that_missed_its_accuracy_is_finished(self, indent_sim, theory_run):
        report = theory_run / "out" / "run.json"
        said = json.loads(report.read_text())
        report.write_text(json.dumps(said | {"status": "failed", "exit_code": 6}))
        assert (
            indent_sim("run", "scene.yaml", "--output", "out", "--set", "material.E=2").exit_code
            == 2
        )

    def test_a_run_that_fails_leaves_the_finished_one(self, indent_sim, theory_run, monkeypatch):
        """A run that fails or is stopped after its first rows leaves the finished run unchanged."""
        before = content_of(theory_run)
        solve_path = SingleRun.solve_path
        for end, code in ((NotConverged("no way"), 5), (KeyboardInterrupt(), 130)):

            def ends(run, progress, end=end):
                def stop(*_):
                    raise end

                solve_path(run, stop)

            with monkeypatch.context() as patched:
                patched.setattr(SingleRun, "solve_path", ends)
                done = indent_sim("run", "scene.yaml", "--output", "out")
            assert done.exit_code == code and "the finished run in out is unchanged" in done.stderr
            assert content_of(theory_run) == before

    def test_in_a_notebook(self, theory_run):
        scene = config_from_mapping(parse(THEORY)[0])
        other = config_from_mapping(parse(THEORY.replace("E: 1.0", "E: 2.0"))[0])
        simulate(scene, directory=theory_run / "here")
        with pytest.raises(UsageError, match=r"another scene: material.E was 1.0 and is 2.0"):
            simulate(other, directory=theory_run / "here")
        simulate(other, directory=theory_run / "here", overwrite=True)
        assert read(theory_run / "here")["force"][-1] == pytest.approx(
            2 * read(theory_run / "out")["force"][-1]
        )

    def test_in_a_study(self, indent_sim, theory_run):
        (theory_run / "study.yaml").write_text("base: scene.yaml\nvary: {material.E: [1.0, 2.0]}\n")
        assert indent_sim("study", "study.yaml", "--output", "all").exit_code == 0
        (theory_run / "study.yaml").write_text("base: scene.yaml\nvary: {material.E: [1.0, 3.0]}\n")
        before = content_of(theory_run)
        done = indent_sim("study", "study.yaml", "--output", "all")
        assert done.exit_code == 2 and content_of(theory_run) == before
        assert (
            "1 finished run that this study does not include: E=2" in done.stderr
            and "all-2" in done.stderr
        )
        assert indent_sim("study", "study.yaml", "--output", "all", "--resume").exit_code == 0
        assert len(list((theory_run / "all" / "runs").iterdir())) == 3
        assert indent_sim("study", "study.yaml", "--output", "all", "--overwrite").exit_code == 0
        assert len(list((theory_run / "all" / "runs").iterdir())) == 2


class TestFilesOfOthers:
    """Files of others in a result folder stay, also under names that the program uses."""

    def test_a_report_stays(self, indent_sim, theory_run):
        (theory_run / "out" / "report.html").write_text("<html>mine</html>")
        assert indent_sim("run", "scene.yaml", "--output", "out").exit_code == 0
        assert indent_sim("report", "out").exit_code == 2
        assert (theory_run / "out" / "report.html").read_text() == "<html>mine</html>"
        (theory_run / "out" / "report.html").unlink()
        assert (
            indent_sim("report", "out").exit_code == 0
            and indent_sim("report", "out").exit_code == 0
        )
        assert indent_sim("run", "scene.yaml", "--output", "out").exit_code == 0
        assert not (theory_run / "out" / "report.html").exists()  # of the run before

    @pytest.mark.parametrize("name", ["force_indentation.png", "experiment.png", "experiment.csv"])
    def test_what_a_run_would_write_over_is_refused_first(self, indent_sim, theory_run, name):
        (theory_run / "out" / name).write_text("mine")
        before = {path: path.read_bytes() for path in theory_run.rglob("*") if path.is_file()}
        for more in ((), ("--overwrite",)):
            done = indent_sim("run", "scene.yaml", "--output", "out", *more)
            assert done.exit_code == 2 and f"{name} was not made by indent-sim" in done.stderr
        assert before == {
            path: path.read_bytes() for path in theory_run.rglob("*") if path.is_file()
        }

    def test_a_scene_that_does_not_fit_on_the_disk_leaves_nothing(
        self, indent_sim, tmp_path, monkeypatch
    ):
        def full(descriptor: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", full)
        done = indent_sim("init", "gel")
        assert done.exit_code == 5 and "No space left" in done.stderr and not left(tmp_path)


class TestCompareAndPlot:
    @pytest.fixture
    def tables(self, indent_sim, tmp_path):
        head = "step,delta,force,a\n"
        for name, text in (
            ("A", "1,0.1,1,0.2\n2,0.2,3,0.3\n"),
            ("B", "1,0.1,1.01,0.2\n2,0.2,3,0.3\n"),
        ):
            (tmp_path / f"{name}.csv").write_text(head + text)
        (tmp_path / "C.csv").write_text(head + "1,0.1,1,0.2\n")
        return indent_sim

    @pytest.mark.parametrize(
        ("words", "code"),
        [(("A", "A"), 0), (("A", "B"), 6), (("A", "B", "--rtol", "0.02"), 0), (("A", "C"), 6)],
    )
    def test_compare(self, tables, tmp_path, words, code):
        done = tables("compare", *(f"{word}.csv" if word in "ABC" else word for word in words))
        assert done.exit_code == code and "force A" in done.stdout
        assert left(tmp_path) == {"A.csv", "B.csv", "C.csv"}

    @pytest.mark.parametrize(
        ("rtol", "code", "worst"),
        [("force=0.02", 0, 0.0099), ("a=0.5", 6, 0.0099), ("1e-3,force=0.02", 0, 0.0099)],
    )
    def test_compare_as_json(self, tables, rtol, code, worst):
        done = tables("compare", "A.csv", "B.csv", "--rtol", rtol, "--json")
        told = json.loads(done.stdout)
        assert done.exit_code == told["exit_code"] == code and told["worst"][
            "force"
        ] == pytest.approx(worst, rel=1e-2)
        assert told["rows"][0]["force"] == [1.0, 1.01] and bool(told["differences"]) == bool(code)

    @pytest.mark.parametrize("rtol", ["", "force", "force=x", "force=2", "1e-3,,a=1"])
    def test_tolerances_that_are_none(self, tables, rtol):
        assert tables("compare", "A.csv", "B.csv", "--rtol", rtol).exit_code == 2

    def test_plot(self, tables, tmp_path):
        assert tables("plot", "A.csv", "B.csv").stdout == "force_indentation.png\n"
        assert tables("plot", "A.csv", "--output", "one.svg").exit_code == 0
        assert left(tmp_path) >= {"force_indentation.png", "one.svg"}
        assert tables("plot", "A.csv", "--output", "one.bmp").exit_code == 2
        assert tables("plot", "A.csv", "--output", "nowhere/one.png").exit_code == 2


ALONE = """
import sys
from mpi4py import MPI
from indent_sim.cli import commands
from indent_sim.process import ranks
from indent_sim.process.errors import NotConverged
ranks.RANK_TIMEOUT = 0.5
comm = MPI.COMM_WORLD
with commands.abort_all_ranks_together(comm):
    if comm.rank == 1:
        raise {error}
    comm.Barrier()
"""


class TestRanks:
    def test_a_config_error_is_told_once_and_ends_all(self, mpirun, tmp_path):
        (tmp_path / "scene.yaml").write_text(SCENE.replace("R: 1.0", "r: 1.0"))
        done = mpirun(3, "-m", "indent_sim.cli.commands", "run", "scene.yaml")
        assert done.returncode == 3 and done.stderr.count("did you mean 'R'") == 1
        assert done.stdout == "" and left(tmp_path) == set()

    @pytest.mark.parametrize(
        ("error", "code", "said"),
        [("ZeroDivisionError('x')", 1, "Traceback"), ("NotConverged('alone')", 5, "alone")],
    )
    def test_a_rank_that_fails_alone_ends_all(self, mpirun, error, code, said):
        done = mpirun(2, "-c", ALONE.format(error=error))
        assert done.returncode == code and said in done.stderr

    def test_the_folder_is_printed_once(self, mpirun, tmp_path):
        (tmp_path / "scene.yaml").write_text(SCENE)
        done = mpirun(2, "-m", "indent_sim.cli.commands", "run", "scene.yaml")
        assert done.returncode == 0 and done.stdout == "results/scene\n"
        assert (
            done.stderr.count("step 1/3") == 1
            and read(tmp_path / "results" / "scene").report["ranks"] == 2
        )


def test_what_accuracy_cannot_reach_is_kept_but_not_to_be_resumed(indent_sim: Run) -> None:
    """Rows that miss the accuracy are kept, and --resume is not suggested.

    It would end the same.
    """
    soft = (
        "contact.method=penalty",
        "contact.epsilon_n=300",
        "accuracy=0.01",
        "mesh.h_contact=auto",
        "mesh.h_far=auto",
    )
    result = indent_sim(
        "run", "scene.yaml", *(word for setting in soft for word in ("--set", setting))
    )
    assert result.exit_code == 6
    assert "3 rows computed before are kept" in result.stderr and "--resume" not in result.stderr
