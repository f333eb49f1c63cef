"""What comes from a stranger: text that is only text, folders that are not ours, results that are damaged."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from test_plots import a_result
from test_results import TIP, some_fields, write_run

from indent_sim import __version__
from indent_sim.cli import commands
from indent_sim.process.errors import UsageError, printable
from indent_sim.results import checkpoint, reader, writer
from indent_sim.results.folder import Claim
from indent_sim.results.pictures import canvas, forces
from indent_sim.results.reader import earlier_run
from indent_sim.results.xdmf import FieldWriter
from indent_sim.study import picture
from indent_sim.study.folder import StudyFolder

TITLES = ["[/x] [kPa]", "$\\frac{1$", "two $ signs $", r"\$", "_hidden", "\x1b[2J\x07", "a\nb", "\u202etfel", "ä 漢 🙂"]
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
    """Every file below a folder, and every folder."""
    paths = sorted(place.rglob("*"))
    return {str(path.relative_to(place)): path.read_bytes() if path.is_file() else path.is_dir() for path in paths}


class TestText:
    @pytest.mark.parametrize("title", TITLES)
    def test_a_plan_shows_the_title_as_it_is(self, tmp_path, title):
        (tmp_path / "scene.yaml").write_text(
            SCENE + f"title: {json.dumps(title, ensure_ascii=False)}\nunits: {{length: '[/x]', force: $}}\n"
        )
        shown = said("plan", tmp_path / "scene.yaml")
        assert shown.exit_code == 0 and printable(title) in shown.stdout and "\x1b" not in shown.stdout
        assert json.loads(said("plan", tmp_path / "scene.yaml", "--json").stdout)["title"] == title

    @pytest.mark.parametrize("title", TITLES[:6:2])
    def test_a_picture_shows_it_too(self, tmp_path, monkeypatch, title):
        monkeypatch.setitem(canvas.STYLE, "svg.fonttype", "none")
        run = a_result(title=title, units={"length": title, "force": title})
        forces.overlay([run, a_result(title="another", units=run.report["units"])], tmp_path / "two.svg")
        forces.force_indentation(run, tmp_path / "one.svg")
        for name in ("one", "two"):
            text = (tmp_path / f"{name}.svg").read_text()
            escaped = printable(title).replace("&", "&amp;")
            assert escaped in text, name

    def test_and_that_of_a_study(self, tmp_path):
        costs = {"cpu_s": 1.0, "status": "done", "index": 1, "run": "x", "dofs": 10}
        rows = [costs | {"contact.method": title, "force_error_vs": 0.01 * (1 + n), "cpu_s": 1.0 + n, "method": title}
                for n, title in enumerate(TITLES[:6])]  # fmt: skip
        picture.draw(rows, ["contact.method"], "$\\frac{", "$x", tmp_path / "study.png")
        assert (tmp_path / "study.png").stat().st_size > 5000

    @pytest.mark.parametrize("name", ["one.png", "one.svg", "one.pdf"])
    def test_a_letter_that_the_font_lacks_is_no_warning(self, tmp_path, name):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            forces.force_indentation(a_result(title="細胞"), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5000

    def test_latex_is_not_started(self, tmp_path):
        import matplotlib

        with matplotlib.rc_context({"text.usetex": True}):
            forces.force_indentation(a_result(title=r"\input{/etc/passwd}"), tmp_path / "one.png")


class TestNotOurs:
    @pytest.mark.parametrize("name", [".out.old", ".out.staging", "out/.old", "out/.staging", "out/.lock", "out"])
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
            Claim(tmp_path / "out")
        assert content_of(tmp_path) == before

    def test_beside_a_result_too(self, tmp_path):
        write_run(tmp_path / "out")
        (tmp_path / ".out.old").mkdir()
        (tmp_path / ".out.old" / "notes").write_text("mine")
        before = content_of(tmp_path)
        with pytest.raises(UsageError, match=r"\.out\.old is in the way"):
            Claim(tmp_path / "out")
        assert content_of(tmp_path) == before

    @pytest.mark.parametrize("name", ["runs/thesis/data.csv", "runs/notes", ".runs.old/notes", ".lock"])
    def test_a_folder_with_runs_of_somebody_is_no_study(self, tmp_path, name):
        path = tmp_path / "study" / name
        path.parent.mkdir(parents=True)
        path.write_text("mine")
        if name == ".lock":
            (tmp_path / "study" / "notes").write_text("mine")
        before = content_of(tmp_path)
        for resume in (False, True):
            with pytest.raises(UsageError, match="not made by"), StudyFolder(tmp_path / "study", resume=resume):
                pass
        assert content_of(tmp_path) == before

    def test_in_a_study_only_results_are_replaced(self, tmp_path):
        place = tmp_path / "study"
        with StudyFolder(place, resume=False) as study:
            study.write_record()
            write_run(study.run("a"))
        (place / "runs" / "a" / "notes").write_text("mine")
        (place / "runs" / "thesis").mkdir()
        (place / "runs" / "thesis" / "data.csv").write_text("mine")
        with StudyFolder(place, resume=False) as study:
            write_run(study.run("b"))
            study.forget_old()
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
        assert said("plot", "A", "B", "--output", "force_indentation.png").exit_code == 0  # as ordered
        assert said("plot", "A", "B").exit_code == 0  # and now it is ours
        assert sorted(os.listdir()) == ["A", "B", "force_indentation.png"]

    @pytest.mark.parametrize(
        "name", ["force_indentation.csv", "surface.csv", "fields", "fields/step-1.h5", "run.json", ".lock"]
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
    """A result of three rows, in the second of which a cell says something else."""
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
        found = earlier_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.step for state in found.states] == [1]

    @pytest.mark.parametrize(
        ("rows", "deltas", "why"), [(3, [0.1, 0.2], "3 rows"), (2, [0.1, 0.3], "row 2 is not at the scene's depth")]
    )
    def test_rows_of_another_path_are_refused(self, tmp_path, rows, deltas, why):
        write_run(tmp_path / "out", rows)
        found = earlier_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.delta for state in found.states][:2] == [0.1, 0.2]
        with pytest.raises(UsageError, match=why):
            found.check(deltas, len(deltas), tmp_path)

    @pytest.mark.parametrize(
        ("entry", "value"),
        [("title", 3), ("units", ["m"]), ("center", "x"), ("theory", []), ("theory", {"name": 1}), ("warnings", "x"),
         ("plan", {"choices": {}}), ("rows", -1), ("rows", "2"), ("status", "fine"), ("accuracy", {"tried": [None]}),
         ("audit", {"force_against_reaction": "x"}), ("cpu_timings", {"mesh": None}), ("resumed_after", 3),
         ("theory", {"name": "x", "delta": 1, "force": 1, "force_deviation": 0, "curve": {"delta": [1]}}),
         ("peak_memory_MB", "1 GB"), ("exit_code", 1e99)],
    )  # fmt: skip
    def test_an_entry_that_is_something_else_is_named(self, tmp_path, entry, value):
        write_run(tmp_path / "out")
        path = tmp_path / "out" / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {entry: value}))
        for refused in (reader.read, reader.read_run, lambda folder: earlier_run(folder, CONFIG)):
            with pytest.raises(UsageError, match=rf"run\.json is damaged: {entry}"):
                refused(tmp_path / "out")
        for words in (("plot", "out"), ("compare", "out", "out")):
            done = CliRunner().invoke(commands.program, [*words[:1], *(str(tmp_path / word) for word in words[1:])])
            assert done.exit_code == 2 and "Traceback" not in done.stderr

    @pytest.mark.parametrize(
        "text",
        [b"", b"[]", b"3", b"{}", b'{"program": "other"}', b"\0" * 50, b"[" * 100_000, b'{"a":' * 100_000, b"{",
         b"\xff\xfe{", b'{"program": 9' + b"9" * 5000 + b"}", b'{"program": "indent-sim", "rows": NaN}'],
    )  # fmt: skip
    def test_a_run_json_that_is_something_else(self, tmp_path, text):
        write_run(tmp_path / "out")
        (tmp_path / "out" / "run.json").write_bytes(text)
        for words in (("plot", "out"), ("compare", "out", "out")):
            done = CliRunner().invoke(commands.program, [*words[:1], *(str(tmp_path / word) for word in words[1:])])
            assert done.exit_code == 2 and "run.json is damaged" in done.stderr and "Traceback" not in done.stderr
        with pytest.raises(UsageError, match="damaged"):
            earlier_run(tmp_path / "out", CONFIG)

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
        found = earlier_run(tmp_path / "out", CONFIG)
        assert found is not None and [state.step for state in found.states] == [1]

    def test_nothing_of_a_file_that_is_no_result_is_told(self, tmp_path):
        (tmp_path / "secret").write_text("step,delta,force,a\n1,2,3,password\n")
        with pytest.raises(UsageError, match="line 2, column 4 is not a number") as caught:
            reader.read(tmp_path / "secret")
        assert "password" not in str(caught.value)

    @pytest.mark.parametrize(
        ("code", "reason", "again"),
        [(137, "the process of the run died of SIGKILL", True), (135, "", True), (143, "", True),
         (1, "MemoryError: ", True), (5, "cannot write results: No space left on device", True),
         (139, "SIGSEGV", False), (5, "step 3 of 4: not converged", False), (1, "KeyError: 'x'", False)],
    )  # fmt: skip
    def test_a_run_that_the_machine_killed_is_tried_again(self, tmp_path, code, reason, again):
        with StudyFolder(tmp_path / "study", resume=False) as study:
            study.fail("x", code, reason)
            assert study.has_ended("x") and study.is_finished("x") != again
            report = json.loads((study.run("x") / "run.json").read_text())
            assert report["version"] == __version__

    def test_a_damaged_run_of_a_study_is_done_again(self, tmp_path):
        with StudyFolder(tmp_path / "study", resume=False) as study:
            write_run(study.run("x"))
            assert study.is_finished("x")
            (study.run("x") / "force_indentation.csv").write_bytes(np.random.default_rng(0).bytes(100))
            assert not study.is_finished("x")

    @pytest.mark.parametrize("value", [float("nan"), float("inf")])
    def test_a_checkpoint_without_numbers_is_none(self, tmp_path, value):
        identity = {"mesh": "x"}
        for number, points in ((1.0, 1), (value, 0)):
            saved = checkpoint.Checkpoint(1, [(0.1, [np.array([number])])])
            checkpoint.write(tmp_path / "checkpoint.h5", saved, identity)
            assert len(checkpoint.read(tmp_path / "checkpoint.h5", identity).points) == points

    def test_fields_that_name_another_file_read_and_name_their_own(self, tmp_path):
        points, cells = np.eye(3)[:, :2], np.array([[0, 1, 2]])
        body = (points, cells, np.zeros(1), TIP)
        writer = FieldWriter(tmp_path, *body, keep_all=True)
        writer.write(1, 0.1, some_fields(1, 3, 1))
        path = tmp_path / "fields.xdmf"
        whole = path.read_text()
        path.write_text(whole.replace("fields/step-1.h5", "/etc/passwd"))
        assert FieldWriter(tmp_path, *body, keep_all=True, done=1).continued and path.read_text() == whole
        path.write_text(whole.replace("step 1", f"step {10**30}"))
        assert FieldWriter(tmp_path, *body, keep_all=True, done=1).continued and "<Time" not in path.read_text()
