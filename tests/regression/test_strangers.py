"""Input from strangers: text is only text, foreign folders stay, damaged results are refused."""

from __future__ import annotations

import json
import os
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from made_results import TIP, TITLES, some_fields, write_run

from indent_sim import __version__
from indent_sim.cli import commands, output
from indent_sim.process.errors import UsageError, printable
from indent_sim.results import checkpoint, reader, writer
from indent_sim.results.field_writer import FieldWriter
from indent_sim.results.output_folder import OutputFolder
from indent_sim.results.previous_run import previous_run
from indent_sim.studies.study_folder import StudyFolder

CONFIG = "title: x\n"  # of `write_run`
SCENE = """\
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 3}
"""


def said(*words: str | Path) -> Any:
    return CliRunner().invoke(commands.program, [str(word) for word in words])


def content_of(place: Path) -> dict[str, Any]:
    """The bytes of every file below a folder, and its folders."""
    paths = sorted(place.rglob("*"))
    return {
        str(path.relative_to(place)): path.read_bytes() if path.is_file() else path.is_dir()
        for path in paths
    }


class TestText:
    @pytest.mark.parametrize("title", TITLES)
    def test_a_plan_shows_the_title_as_it_is(self, tmp_path, title):
        (tmp_path / "scene.yaml").write_text(
            SCENE
            + (
                f"title: {json.dumps(title, ensure_ascii=False)}\nunits: {{length: '[/x]', force: "
                f"$}}\n"
            )
        )
        shown = said("plan", tmp_path / "scene.yaml")
        assert (
            shown.exit_code == 0 and printable(title) in shown.stdout and "\x1b" not in shown.stdout
        )
        assert json.loads(said("plan", tmp_path / "scene.yaml", "--json").stdout)["title"] == title


class TestNotOurs:
    @pytest.mark.parametrize(
        "name", [".out.old", ".out.staging", "out/.old", "out/.staging", "out/.lock", "out"]
    )
    @pytest.mark.parametrize("kind", ["folder", "file", "link"])
    def test_what_a_user_has_there_stays(self, tmp_path, name, kind):
        (tmp_path / "mine").write_text("mine")
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        if kind == "folder":
            path.mkdir()
            (path / "force_indentation.csv").write_text("mine")
        elif kind == "file":
            path.write_text("mine")
        else:
            path.symlink_to(tmp_path / "mine")
        before = content_of(tmp_path)
        with pytest.raises(UsageError):
            OutputFolder(tmp_path / "out")
        assert content_of(tmp_path) == before

    def test_beside_a_result_too(self, tmp_path):
        write_run(tmp_path / "out")
        (tmp_path / ".out.old").mkdir()
        (tmp_path / ".out.old" / "notes").write_text("mine")
        before = content_of(tmp_path)
        with pytest.raises(UsageError, match=r"\.out\.old is the place of a temporary folder"):
            OutputFolder(tmp_path / "out")
        assert content_of(tmp_path) == before

    @pytest.mark.parametrize("name", ["runs/thesis/data.csv", "runs/notes", ".lock"])
    def test_a_folder_with_runs_of_somebody_is_no_study(self, tmp_path, name):
        path = tmp_path / "study" / name
        path.parent.mkdir(parents=True)
        path.write_text("mine")
        if name == ".lock":
            (tmp_path / "study" / "notes").write_text("mine")
        before = content_of(tmp_path)
        for resume in (False, True):
            with (
                pytest.raises(UsageError, match="not made by"),
                StudyFolder(tmp_path / "study", resume=resume),
            ):
                pass
        assert content_of(tmp_path) == before

    def test_in_a_study_only_results_are_replaced(self, tmp_path):
        place = tmp_path / "study"
        with StudyFolder(place, resume=False) as study:
            study.write_record()
            write_run(study.run_folder("a"))
        (place / "runs" / "a" / "notes").write_text("mine")
        (place / "runs" / "thesis").mkdir()
        (place / "runs" / "thesis" / "data.csv").write_text("mine")
        with StudyFolder(place, resume=False, overwrite=True, names=["b"]) as study:
            write_run(study.run_folder("b"))
            study.delete_other_runs()
        kept = {
            "study.json",
            ".lock",
            "runs",
            "runs/thesis",
            "runs/thesis/data.csv",
            "runs/a",
            "runs/a/notes",
            "runs/b",
        }
        assert {name for name in content_of(place) if not name.startswith("runs/b/")} == kept

    def test_a_picture_of_somebody_is_not_replaced_by_one_with_no_name(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        for name in ("A", "B"):
            write_run(tmp_path / name)
        Path("force_indentation.png").write_bytes(b"my own")
        refused = said("plot", "A", "B")
        assert refused.exit_code == 2 and "--output" in refused.stderr
        assert Path("force_indentation.png").read_bytes() == b"my own"
        assert (
            said("plot", "A", "B", "--output", "force_indentation.png").exit_code == 0
        )  # as ordered
        assert said("plot", "A", "B").exit_code == 0  # and now it is ours
        assert sorted(os.listdir()) == ["A", "B", "force_indentation.png"]

    @pytest.mark.parametrize(
        "name",
        ["force_indentation.csv", "surface.csv", "fields", "fields/step-1.h5", "run.json", ".lock"],
    )
    def test_nothing_is_written_through_a_link(self, tmp_path, name):
        write_run(tmp_path / "out")
        victim, path = tmp_path / "victim", tmp_path / "out" / name
        victim.write_bytes(path.read_bytes() if path.exists() else b"mine")
        before = victim.read_bytes()
        path.unlink(missing_ok=True)
        path.parent.mkdir(exist_ok=True)
        path.symlink_to(victim)
        with pytest.raises(UsageError):
            writer.ResultFolder(tmp_path / "out", CONFIG, resume=True).__enter__()
        assert victim.read_bytes() == before


def with_a_cell(out: Path, column: int, cell: str) -> None:
    """Write a result of three rows, in the second of which one cell is replaced."""
    write_run(out, 3)
    table = out / "force_indentation.csv"
    lines = [line.split(",") for line in table.read_text().splitlines()]
    lines[2][column] = cell
    table.write_text("".join(",".join(line) + "\n" for line in lines))


class TestDamaged:
    @pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "1e999", ""])
    @pytest.mark.parametrize("column", [1, 2, 3, 6])
    def test_a_resumed_run_keeps_no_row_that_is_no_result(self, tmp_path, cell, column):
        with_a_cell(tmp_path / "out", column, cell)
        found = previous_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.step for state in found.states] == [1]

    @pytest.mark.parametrize(
        ("rows", "deltas", "why"),
        [(3, [0.1, 0.2], "3 rows"), (2, [0.1, 0.3], "row 2 is not at the scene's depth")],
    )
    def test_rows_of_another_path_are_refused(self, tmp_path, rows, deltas, why):
        write_run(tmp_path / "out", rows)
        found = previous_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.delta for state in found.states][:2] == [0.1, 0.2]
        with pytest.raises(UsageError, match=why):
            found.check(deltas, len(deltas), tmp_path)

    @pytest.mark.parametrize(
        ("entry", "value"),
        [
            ("title", 3),
            ("units", ["m"]),
            ("center", "x"),
            ("theory", []),
            ("theory", {"name": 1}),
            ("warnings", "x"),
            ("plan", {"choices": {}}),
            ("rows", -1),
            ("rows", "2"),
            ("status", "fine"),
            ("accuracy", {"tried": [None]}),
            ("audit", {"force_against_reaction": "x"}),
            ("cpu_timings", {"mesh": None}),
            ("resumed_after", 3),
            (
                "theory",
                {
                    "name": "x",
                    "delta": 1,
                    "force": 1,
                    "force_deviation": 0,
                    "curve": {"delta": [1]},
                },
            ),
            ("peak_memory_MB", "1 GB"),
            ("exit_code", 1e99),
            ("stick", {"words": 3}),
            ("versions", "x"),
            ("finished", 3),
            ("plan", {"auto": [1]}),
            ("adhesion", {"tabor": []}),
            ("experiment", {"adhesion": {"pull_off": {"x": 1}}}),
            ("adhesion", {"pull_off": {"delta": 0.0, "force": -1.0, "error": "x"}}),
        ],
    )
    def test_an_entry_that_is_something_else_is_named(self, tmp_path, entry, value):
        write_run(tmp_path / "out")
        path = tmp_path / "out" / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {entry: value}))
        for refused in (reader.read, reader.read_run, lambda folder: previous_run(folder, CONFIG)):
            with pytest.raises(UsageError, match=rf"run\.json is damaged: {entry}"):
                refused(tmp_path / "out")
        for words in (("plot", "out"), ("compare", "out", "out"), ("report", "out")):
            done = CliRunner().invoke(
                commands.program, [*words[:1], *(str(tmp_path / word) for word in words[1:])]
            )
            assert done.exit_code == 2 and "Traceback" not in done.stderr

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "t,z,delta,force,a,branch\n",
            "delta,force\n0,1\n",
            "t,z,delta,force,a,branch\n0,0,x,0,0,hold\n",
            "t,z,delta,force,a,branch\n0,0,0\n",
            "\0\n",
            "t,z,delta,force,a,branch\n0,0,nan,0,0,hold\n",
        ],
    )
    def test_a_table_of_an_experiment_that_is_something_else(self, tmp_path, text):
        write_run(tmp_path / "out")
        (tmp_path / "out" / "experiment.csv").write_text(text)
        done = said("report", tmp_path / "out")
        assert (
            done.exit_code == 2
            and "experiment.csv" in done.stderr
            and "Traceback" not in done.stderr
        )

    def test_the_name_of_a_folder_may_be_any_bytes(self, tmp_path, capfdbinary):
        """In a strict locale the name of a folder that is no text is printed as its bytes.

        Python refuses to print it as text there.
        """
        place = os.fsencode(tmp_path) + b"/\xff\xfe"
        write_run(Path(os.fsdecode(place)))
        with (
            open(1, "w", encoding="utf-8", errors="strict", closefd=False) as strict,
            redirect_stdout(strict),
        ):
            output.print_stdout(os.fsdecode(place))
        assert capfdbinary.readouterr().out == place + b"\n"

    @pytest.mark.parametrize(
        "text",
        [
            b"",
            b"[]",
            b"3",
            b"{}",
            b'{"program": "other"}',
            b"\0" * 50,
            b"[" * 100_000,
            b'{"a":' * 100_000,
            b"{",
            b"\xff\xfe{",
            b'{"program": 9' + b"9" * 5000 + b"}",
            b'{"program": "indent-sim", "rows": NaN}',
        ],
    )
    def test_a_run_json_that_is_something_else(self, tmp_path, text):
        write_run(tmp_path / "out")
        (tmp_path / "out" / "run.json").write_bytes(text)
        for words in (("plot", "out"), ("compare", "out", "out")):
            done = CliRunner().invoke(
                commands.program, [*words[:1], *(str(tmp_path / word) for word in words[1:])]
            )
            assert (
                done.exit_code == 2
                and "run.json is damaged" in done.stderr
                and "Traceback" not in done.stderr
            )
        with pytest.raises(UsageError, match="damaged"):
            previous_run(tmp_path / "out", CONFIG)

    def test_a_run_json_that_is_a_folder_or_a_pipe(self, tmp_path):
        write_run(tmp_path / "out")
        path = tmp_path / "out" / "run.json"
        for make in (Path.mkdir, os.mkfifo):
            path.rmdir() if path.is_dir() else path.unlink()
            make(path)
            with pytest.raises(UsageError, match="damaged"):
                reader.read(tmp_path / "out")

    @pytest.mark.parametrize("cell", ["1_000", "0x1F", "1e3_0", "\u0661", "\uff11", "1 2", "1'000"])
    @pytest.mark.parametrize("column", [0, 1, 2, 4])
    def test_only_what_every_program_reads_is_a_number(self, tmp_path, cell, column):
        with_a_cell(tmp_path / "out", column, cell)
        with pytest.raises(UsageError, match=rf"line 3, column {column + 1} is not a number"):
            reader.read(tmp_path / "out")
        found = previous_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.step for state in found.states] == [1]

    def test_nothing_of_a_file_that_is_no_result_is_told(self, tmp_path):
        (tmp_path / "secret").write_text("step,delta,force,a\n1,2,3,password\n")
        with pytest.raises(UsageError, match="line 2, column 4 is not a number") as caught:
            reader.read(tmp_path / "secret")
        assert "password" not in str(caught.value)

    @pytest.mark.parametrize(
        ("code", "reason", "again"),
        [
            (137, "the process of the run was ended by the signal SIGKILL", True),
            (135, "", True),
            (143, "", True),
            (1, "MemoryError: ", True),
            (5, "cannot write results: No space left on device", True),
            (139, "SIGSEGV", False),
            (5, "step 3 of 4: not converged", False),
            (1, "KeyError: 'x'", False),
        ],
    )
    def test_a_run_that_the_machine_killed_is_tried_again(self, tmp_path, code, reason, again):
        with StudyFolder(tmp_path / "study", resume=False) as study:
            study.record_failure("x", code, reason)
            assert study.ended_results("x") is not None and study.is_finished("x") != again
            report = json.loads((study.run_folder("x") / "run.json").read_text())
            assert report["version"] == __version__

    def test_a_damaged_run_of_a_study_is_done_again(self, tmp_path):
        with StudyFolder(tmp_path / "study", resume=False) as study:
            write_run(study.run_folder("x"))
            assert study.is_finished("x")
            (study.run_folder("x") / "force_indentation.csv").write_bytes(
                np.random.default_rng(0).bytes(100)
            )
            assert not study.is_finished("x")

    @pytest.mark.parametrize("value", [float("nan"), float("inf")])
    def test_a_checkpoint_without_numbers_is_none(self, tmp_path, value):
        identity = {"mesh": "x"}
        for number, points in ((1.0, 1), (value, 0)):
            saved = checkpoint.Checkpoint(1, [(0.1, 0.0, [np.array([number])])])
            checkpoint.write(tmp_path / "checkpoint.h5", saved, identity)
            assert len(checkpoint.read(tmp_path / "checkpoint.h5", identity).equilibria) == points

    def test_fields_that_name_another_file_read_and_name_their_own(self, tmp_path):
        points, cells = np.eye(3)[:, :2], np.array([[0, 1, 2]])
        body = (points, cells, np.zeros(1), TIP)
        writer = FieldWriter(tmp_path, *body, keep="all")
        writer.write(1, 0.1, some_fields(1, 3, 1))
        path = tmp_path / "fields.xdmf"
        whole = path.read_text()
        path.write_text(whole.replace("fields/step-1.h5", "/etc/passwd"))
        assert (
            FieldWriter(tmp_path, *body, keep="all", done=1).is_continued
            and path.read_text() == whole
        )
        path.write_text(whole.replace("step 1", f"step {10**30}"))
        assert (
            FieldWriter(tmp_path, *body, keep="all", done=1).is_continued
            and "<Time" not in path.read_text()
        )
