"""`run --resume` goes on to the same curve, whatever stopped a run, and leaves foreign files."""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result
from made_results import BODY, some_fields
from mpi4py import MPI
from resumed_runs import CONDENSED, HYPERELASTIC, SCENE, kept_fields, same_numbers

from indent_sim.cli import commands
from indent_sim.config.scene_file import load
from indent_sim.fe.path import load_stepping
from indent_sim.fe.path.load_stepping import LoadStepper
from indent_sim.fe.path.pull_off import PullPoint
from indent_sim.model.load_path import LoadPath
from indent_sim.results import result_files
from indent_sim.results.field_writer import FieldWriter
from indent_sim.results.reader import read
from indent_sim.results.result_scene import scene_of
from indent_sim.run import pipeline, single_run
from indent_sim.run.run_output import RunOutput

ROOT = Path(__file__).resolve().parents[2]
FORCES = "forces: [0.01, 0.03, 0.06, 0.02, 0, 0.04, 0.05]"
UP_AND_DOWN = "deltas: [0.03, 0.06, 0.09, 0.12, 0.05, -0.01, 0.04, 0.08]"
# snaps in, holds on, lets go and snaps in again
STICKY = "deltas: [-0.15, 0.05, -0.06, -0.09, -0.2, 0.0]"
SOME = 7  # rows of a run that was stopped

# A run that kills itself at the n-th time it opens for writing, renames, removes or cuts a file of
# the result folder
SELF_KILLING = """
import os, signal, sys
from pathlib import Path
left, here = int(sys.argv.pop(1)), str(Path.cwd())
def watch(event, args):
    global left
    if event == "open" and not (isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR)):
        return
    changes = ("open", "os.rename", "os.remove", "os.truncate")
    if event in changes and str(args[0]).startswith((here, "out", ".out")):
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(watch)
from indent_sim.cli.commands import main
main()
"""

Resume = Callable[..., Result]


@pytest.fixture
def indent_sim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Resume:
    """A function that calls `run scene.yaml --output out` with more words, in this process."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(HYPERELASTIC)
    return lambda *words: CliRunner().invoke(
        commands.program, ["run", "scene.yaml", "--output", "out", *words]
    )


def interrupt(
    place: Path, rows: int = SOME, error: type[BaseException] = KeyboardInterrupt
) -> list[bytes]:
    """Run place/scene.yaml into place/out and stop it after some rows.

    Returns the lines of its table.
    """

    def stop(state, step, total):
        if step == rows:
            raise error

    with pytest.raises(error):
        pipeline.simulate(
            load(place / "scene.yaml"), MPI.COMM_SELF, directory=place / "out", progress=stop
        )
    lines = (place / "out" / "force_indentation.csv").read_bytes().splitlines(keepends=True)
    assert len(lines) == rows + 1
    return lines


def snapshot(place: Path) -> dict[str, tuple[bytes, int]]:
    return {
        str(path.relative_to(place)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in place.rglob("*")
        if path.is_file()
    }


def adhering(material: str, loading: str) -> str:
    """A scene of a tip that adheres."""
    method = "augmented_lagrangian, adhesion: {work: 1.0e-2, range: 2.5e-2}"
    scene = SCENE.format(material=f"model: {material}", method=method, loading=loading)
    return scene.replace("h_contact: 0.12", "h_contact: 0.08")


def same_pull_off(out: Path, expected: Path) -> None:
    """Assert that two folders have the same largest pull after the same search.

    Its depth is known less, as forces hardly differ there.
    """
    found, wanted = (read(place).report["adhesion"]["pull_off"] for place in (out, expected))
    assert (found is None) == (wanted is None) == (read(expected).report["control"] == "force")
    if found is not None:
        assert found["force"] == pytest.approx(wanted["force"], rel=1e-8)
        assert found["delta"] == pytest.approx(wanted["delta"], rel=1e-4)
        assert found["equilibria"] == wanted["equilibria"]


def stopped_at(equilibrium: int) -> Callable:
    """A search for the largest pull that is stopped at one of its equilibria."""
    find = load_stepping.find_largest_pull
    tried = 0

    def stopped(before, lowest, after, solve_between, tolerance):
        def solve(*given):
            nonlocal tried
            tried += 1
            if tried == equilibrium:
                raise KeyboardInterrupt
            return solve_between(*given)

        return find(before, lowest, after, solve, tolerance)

    return stopped


@pytest.fixture
def interrupt_and_resume(
    indent_sim: Resume, undisturbed: Callable[[str], Path], tmp_path: Path
) -> Callable[..., None]:
    """A function that stops a scene after some rows, resumes it, and compares it with a whole run.

    It is resumed with or without its checkpoint.
    """

    def both(scene: str, rows: int, forget: bool, rtol: float = 1e-8) -> None:
        (tmp_path / "scene.yaml").write_text(scene)
        interrupt(tmp_path, rows)
        if forget:
            (tmp_path / "out" / "checkpoint.h5").unlink()
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(scene), rtol)

    return both


class TestKilled:
    @pytest.mark.parametrize(
        ("scene", "moments"),
        [(HYPERELASTIC, (3, 17, 6, 48)), (CONDENSED, (38, 33))],
        ids=["newton", "condensed"],
    )
    def test_a_run_killed_again_and_again(self, indent_sim, undisturbed, tmp_path, scene, moments):
        (tmp_path / "scene.yaml").write_text(scene)
        words = ["run", "scene.yaml", "--output", "out", "--resume"]
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        rows = [0]
        for moment in moments:
            killed = subprocess.run(
                [sys.executable, "-c", SELF_KILLING, str(moment), *words],
                env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
                capture_output=True,
            )
            assert killed.returncode == -signal.SIGKILL, killed.stderr
            rows.append(len(read(tmp_path / "out")) if (tmp_path / "out").exists() else 0)
        assert rows == sorted(rows) and 0 < rows[-1] < 15, rows
        before = read(tmp_path / "out")
        done = indent_sim("--resume")
        assert done.exit_code == 0 and f"resumed: {rows[-1]} of the 15 rows" in done.stderr
        same_numbers(tmp_path / "out", undisturbed(scene))
        after = read(tmp_path / "out")
        for column in after.table:
            assert np.array_equal(after[column][: rows[-1]], before[column])

    @pytest.mark.parametrize(
        ("method", "rows", "forget"),
        [("uzawa", 4, False), ("active_set", 6, True), ("penalty", 5, False)],
    )
    def test_any_path_by_any_method(self, interrupt_and_resume, method, rows, forget):
        scene = SCENE.format(material="model: neo_hookean", method=method, loading=UP_AND_DOWN)
        interrupt_and_resume(scene, rows, forget, 1e-7 if method == "uzawa" else 1e-8)

    @pytest.mark.parametrize(
        ("material", "friction", "loading", "rows", "forget"),
        [
            ("neo_hookean", "0.3", UP_AND_DOWN, 5, False),
            ("neo_hookean", "0.3", UP_AND_DOWN, 6, True),
            ("linear_elastic", "0.3", UP_AND_DOWN, 5, False),
            ("neo_hookean", "0.3", FORCES, 4, False),
            ("linear_elastic", "0.3", FORCES, 5, False),
            ("neo_hookean", "stick", UP_AND_DOWN, 2, False),
        ],
    )
    def test_a_path_with_friction(
        self, interrupt_and_resume, material, friction, loading, rows, forget
    ):
        """A path with friction goes on with the memory of the surface.

        It is in the checkpoint, or found again on the same path from rest.
        """
        method = f"augmented_lagrangian, friction: {friction}"
        scene = SCENE.format(material=f"model: {material}", method=method, loading=loading)
        interrupt_and_resume(scene, rows, forget)

    @pytest.mark.parametrize(
        ("material", "loading", "rows", "forget"),
        [
            ("neo_hookean", STICKY, 3, False),
            ("neo_hookean", STICKY, 4, True),
            ("linear_elastic", STICKY, 5, False),
            ("linear_elastic", "forces: [0, 0.01, -0.02, 0.015]", 2, False),
        ],
    )
    def test_a_path_with_adhesion(
        self, interrupt_and_resume, undisturbed, tmp_path, material, loading, rows, forget
    ):
        """A path with adhesion goes on in the same of two stable states.

        The state, and the rows around the largest pull, are in the checkpoint, or found again on
        the same path from far away.
        """
        scene = adhering(material, loading)
        interrupt_and_resume(scene, rows, forget)
        same_pull_off(tmp_path / "out", undisturbed(scene))

    @pytest.mark.parametrize("forget", [False, True])
    def test_a_search_for_the_largest_pull(
        self, indent_sim, undisturbed, tmp_path, monkeypatch, forget
    ):
        """A run stopped in its search for the largest pull is resumed from an early row or none.

        All its rows are there.
        """
        scene = adhering("linear_elastic", STICKY)
        (tmp_path / "scene.yaml").write_text(scene)
        interrupt(tmp_path, 3)
        early = (tmp_path / "out" / "checkpoint.h5").read_bytes()
        with monkeypatch.context() as patch:
            patch.setattr(load_stepping, "find_largest_pull", stopped_at(2))
            with pytest.raises(KeyboardInterrupt):
                pipeline.simulate(
                    load(tmp_path / "scene.yaml"),
                    MPI.COMM_SELF,
                    directory=tmp_path / "out",
                    resume=True,
                )
        stopped = read(tmp_path / "out")
        assert len(stopped) == 6 and stopped.report["status"] == "interrupted"
        (tmp_path / "out" / "checkpoint.h5").write_bytes(early)
        if forget:
            (tmp_path / "out" / "checkpoint.h5").unlink()
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(scene))
        same_pull_off(tmp_path / "out", undisturbed(scene))

    def test_a_search_that_fails_leaves_the_rows(self, indent_sim, tmp_path, monkeypatch):
        """A failed search leaves the rows, a reason, and the row that pulls most."""
        (tmp_path / "scene.yaml").write_text(adhering("linear_elastic", STICKY))
        find = load_stepping.find_largest_pull

        def lost(begin, end, delta):
            return PullPoint(delta, 0.0, math.inf, a=0.0)

        def failing(before, lowest, after, solve_between, tolerance):
            return find(before, lowest, after, lost, tolerance)

        monkeypatch.setattr(load_stepping, "find_largest_pull", failing)
        done = indent_sim()
        adhesion = read(tmp_path / "out").report["adhesion"]
        assert done.exit_code == 0 and adhesion["largest_pull"]["force"] < 0
        assert adhesion["pull_off"] is None
        assert (
            "pull-off is missing: no equilibrium was found at a depth that the tip has passed"
            in done.stderr
        )
        assert "largest tensile force:" in done.stderr

    @pytest.mark.parametrize(
        ("material", "rows", "forget"),
        [("neo_hookean", 5, False), ("neo_hookean", 3, True), ("linear_elastic", 4, False)],
    )
    def test_prescribed_forces(self, interrupt_and_resume, tmp_path, material, rows, forget):
        """A path of prescribed forces is resumed to the same rows.

        A force is met within 1e-10, and its depth is known as well, whatever was known of the
        curve.
        """
        scene = SCENE.format(
            material=f"model: {material}", method="augmented_lagrangian", loading=FORCES
        )
        interrupt_and_resume(scene, rows, forget)
        assert read(tmp_path / "out").report["control"] == "force"


class TestCheckpoint:
    def test_with_it_the_run_goes_on_as_if_nothing_had_been(
        self, indent_sim, undisturbed, tmp_path
    ):
        interrupt(tmp_path)
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC), 1e-13)
        expected = read(undisturbed(HYPERELASTIC))
        assert np.array_equal(
            read(tmp_path / "out")["newton_iterations"], expected["newton_iterations"]
        )

    @pytest.mark.parametrize("harm", ["missing", "cut", "flipped", "of another mesh", "old"])
    def test_without_it_the_way_is_found_again(
        self, indent_sim, undisturbed, tmp_path, monkeypatch, harm
    ):
        file = tmp_path / "out" / "checkpoint.h5"
        if harm == "old":  # as after a kill: the one written at the first row
            monkeypatch.setattr(RunOutput, "save_checkpoint", lambda *_: None)
            interrupt(tmp_path, 3)
            monkeypatch.undo()
            monkeypatch.chdir(tmp_path)
            monkeypatch.setattr(LoadStepper, "states", failing_at(5))
            assert indent_sim("--resume").exit_code == 5
            monkeypatch.undo()
            monkeypatch.chdir(tmp_path)
            old = file.read_bytes()
            interrupt(tmp_path)
            file.write_bytes(old)
        else:
            interrupt(tmp_path)
            content = bytearray(file.read_bytes())
            content[-900] ^= 0xFF
            if harm == "missing":
                file.unlink()
            elif harm == "cut":
                file.write_bytes(content[: len(content) // 2])
            elif harm == "flipped":
                file.write_bytes(content)
            else:
                with h5py.File(file, "r+") as opened:
                    opened.attrs["identity"] = opened.attrs["identity"].replace("dofs", "sfod")
                report = tmp_path / "out" / "run.json"
                report.write_text(report.read_text().replace('"hash": "', '"hash": "0'))
        done = indent_sim("--resume")
        assert done.exit_code == 0 and ("computed on another mesh" in done.stderr) == (
            harm == "of another mesh"
        )
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC))
        assert read(tmp_path / "out").report["resumed_after"][-1] == SOME


def failing_at(step: int) -> Callable:
    """`LoadStepper.states` of a scene that has no equilibrium at a step."""
    states = LoadStepper.states

    def fail(self, *args):
        for state in states(self, *args):
            if state.step == step:
                object.__setattr__(state, "converged", False)
            yield state

    return fail


class TestStopped:
    def test_not_converged(self, indent_sim, undisturbed, tmp_path, monkeypatch):
        with monkeypatch.context() as patch:
            patch.setattr(LoadStepper, "states", failing_at(SOME + 1))
            failed = indent_sim()
            again = indent_sim("--resume")
        assert failed.exit_code == again.exit_code == 5 and "--resume continues" in again.stderr
        assert len(read(tmp_path / "out")) == SOME
        assert (
            indent_sim("--resume", "--set", "solver.max_iterations=99").exit_code == 3
        )  # another config
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC))

    def test_a_full_disk(self, indent_sim, undisturbed, tmp_path, monkeypatch):
        def full(*args, **options):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        interrupt(tmp_path)
        with monkeypatch.context() as patch:
            patch.setattr("indent_sim.results.writer.append_atomically", full)
            patch.setattr("indent_sim.results.writer.write_atomically", full)
            failed = indent_sim("--resume")
        assert (
            failed.exit_code == 5
            and "No space left" in failed.stderr
            and len(read(tmp_path / "out")) == SOME
        )
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC))

    def test_torn_files(self, indent_sim, undisturbed, tmp_path):
        """Half rows, rows of unfinished steps and leftovers of writes are repaired by --resume."""
        lines = interrupt(tmp_path)
        out = tmp_path / "out"
        (out / "force_indentation.csv").write_bytes(b"".join(lines[:SOME]) + lines[SOME][:20])
        with open(out / "surface.csv", "a") as table:
            table.write("8,0.1,0,0,")
        (out / ".run.json.new").write_text("{")
        (out / "mine.txt").write_text("notes")
        assert indent_sim("--resume").exit_code == 0
        assert (out / "mine.txt").read_text() == "notes"
        (out / "mine.txt").unlink()
        same_numbers(out, undisturbed(HYPERELASTIC))
        assert read(out).report["resumed_after"] == [SOME - 1]

    def test_every_row_was_there(self, indent_sim, undisturbed, tmp_path):
        interrupt(tmp_path, 15)
        assert indent_sim("--resume").exit_code == 0
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC))

    @pytest.mark.parametrize("lost", ["mesh.h5", "step-2.h5"])
    def test_lost_fields_begin_anew(self, indent_sim, tmp_path, lost):
        interrupt(tmp_path)
        (tmp_path / "out" / "fields" / lost).write_bytes(b"no HDF5")
        done = indent_sim("--resume")
        assert done.exit_code == 0 and f"fields of steps 1 to {SOME} are missing" in done.stderr
        assert (tmp_path / "out" / "fields.xdmf").read_text().count("<Time") == 15 - SOME

    def test_on_two_ranks(self, mpirun, undisturbed, tmp_path):
        (tmp_path / "scene.yaml").write_text(HYPERELASTIC)
        interrupt(tmp_path)
        done = mpirun(
            2, "-m", "indent_sim.cli.commands", "run", "scene.yaml", "--output", "out", "--resume"
        )
        assert done.returncode == 0, done.stderr
        found, expected = read(tmp_path / "out"), read(undisturbed(HYPERELASTIC))
        for column in ("step", "delta", "force", "a", "p_max", "energy"):
            np.testing.assert_allclose(found[column], expected[column], rtol=1e-8, err_msg=column)


class TestTheDeepestAndTheLast:
    """`last` keeps two states after unloading, as the last alone would be empty."""

    scene = SCENE.format(
        material="model: linear_elastic", method="augmented_lagrangian", loading=UP_AND_DOWN
    ).replace("fields: all, surface: all", "fields: last, surface: last")

    @pytest.mark.parametrize("rows", [2, 4, 6])
    def test_a_run_that_was_stopped_keeps_what_others_keep(
        self, indent_sim, undisturbed, tmp_path, rows
    ):
        (tmp_path / "scene.yaml").write_text(self.scene)
        interrupt(tmp_path, rows)
        wanted = {min(rows, 4), rows}
        assert (
            set(kept_fields(tmp_path / "out"))
            == set(read(tmp_path / "out").surface["step"])
            == wanted
        )
        assert indent_sim("--resume").exit_code == 0
        found, expected = read(tmp_path / "out"), read(undisturbed(self.scene))
        for column, values in expected.surface.items():
            np.testing.assert_allclose(found.surface[column], values, atol=1e-9, err_msg=column)
        ours, theirs = kept_fields(found.path), kept_fields(expected.path)
        assert list(ours) == list(theirs) == list(dict.fromkeys(found.surface["step"])) == [4, 8]
        for step, arrays in theirs.items():
            for name, values in arrays.items():
                np.testing.assert_allclose(ours[step][name], values, atol=1e-9, err_msg=name)
            largest = found["p_max"][
                step - 1
            ]  # the fields show the nodes: the largest is at one or beside it
            assert arrays["pressure"].max() == pytest.approx(largest, rel=0.1)

    def test_a_path_that_only_goes_in_keeps_one(self, tmp_path):
        (tmp_path / "scene.yaml").write_text(
            self.scene.replace(UP_AND_DOWN, "delta: 0.08, steps: 3")
        )
        pipeline.simulate(load(tmp_path / "scene.yaml"), MPI.COMM_SELF, directory=tmp_path / "out")
        assert (
            set(kept_fields(tmp_path / "out")) == set(read(tmp_path / "out").surface["step"]) == {3}
        )

    def test_two_states_stay_whatever_the_path(self, tmp_path):
        """On a random path up and down the deepest and the last fields are kept unchanged."""
        chance = np.random.default_rng(1)
        writer = FieldWriter(tmp_path, *BODY)
        deltas = chance.uniform(size=20)
        for step, delta in enumerate(deltas, start=1):
            writer.write(step, delta, some_fields(1) | {"pressure": np.full(4, step)})
            kept = kept_fields(tmp_path)
            assert set(kept) == {1 + int(deltas[:step].argmax()), step}
            assert all((arrays["pressure"] == named).all() for named, arrays in kept.items())
            assert len(os.listdir(tmp_path / "fields")) == 1 + len(kept)


@pytest.mark.parametrize(
    ("values", "kept"),
    [
        ((1, 2, 3), {3}),
        ((1, 3, 2), {2, 3}),
        ((3, 3, 1, 3, 0), {2, 4, 5}),
        ((3, 1, 2, 1), {1, 4}),
        ((2,), {1}),
        ((1, 0, 2, 0, 3), {1, 3, 5}),
    ],
)
def test_the_steps_worth_keeping(values, kept):
    assert LoadPath("depth", values).retained_rows == kept


class TestNothingToGoOnWith:
    def test_no_folder_yet(self, indent_sim, undisturbed, tmp_path):
        done = indent_sim("--resume")
        assert done.exit_code == 0 and "resumed" not in done.stderr
        same_numbers(tmp_path / "out", undisturbed(HYPERELASTIC))

    def test_no_row_yet(self, indent_sim, tmp_path, monkeypatch):
        with monkeypatch.context() as patch:
            patch.setattr(LoadStepper, "states", failing_at(1))
            assert indent_sim().exit_code == 5 and (tmp_path / "out" / "run.json").exists()
        assert indent_sim("--resume").exit_code == 0 and len(read(tmp_path / "out")) == 15

    @pytest.mark.parametrize("asked", [("--error-bars",), ("--set", "accuracy=0.01")])
    @pytest.mark.parametrize("where", ["companions", "run"])
    def test_stopped_before_the_first_row_with_error_bars(
        self, indent_sim, tmp_path, monkeypatch, asked, where
    ):
        """A run with error bars that was stopped before its first row is resumed.

        It is stopped while companions run, before anything says that there will be error bars, or
        after.
        """

        def stop(*args, **options):
            raise KeyboardInterrupt

        scene = HYPERELASTIC.replace("neo_hookean", "linear_elastic").replace(
            "steps: 15", "steps: 2"
        )
        mesh = "mesh: {h_contact: 0.12, h_far: 0.6}\n"
        (tmp_path / "scene.yaml").write_text(scene.replace(mesh, "") if "--set" in asked else scene)
        with monkeypatch.context() as patch:
            if where == "companions":
                patch.setattr(pipeline, "states", stop)
            else:
                patch.setattr(single_run.SingleRun, "solve_path", stop)
            assert indent_sim(*asked).exit_code == 130
        assert result_files.read_report(tmp_path / "out")["rows"] == 0
        done = indent_sim("--resume", *asked)
        assert done.exit_code == 0, done.stderr
        assert all(state > 0 for state in read(tmp_path / "out")["force_error"])

    def test_a_row_without_error_bars_is_not_gone_on_with(self, indent_sim, tmp_path):
        interrupt(tmp_path, 1)
        done = indent_sim("--resume", "--error-bars")
        assert done.exit_code == 3 and "a run without error bars" in done.stderr

    def test_a_finished_run_stays_as_it_is(self, indent_sim, tmp_path):
        assert indent_sim().exit_code == 0
        before = snapshot(tmp_path)
        done = indent_sim("--resume")
        assert (
            done.exit_code == 0
            and done.stdout == "out\n"
            and "nothing left to compute" in done.stderr
        )
        said = json.loads(indent_sim("--resume", "--json").stdout)
        assert len(said["rows"]) == 15 and said["report"]["status"] == "done"
        assert snapshot(tmp_path) == before

    def test_what_a_finished_run_has_lost_since_is_said(self, indent_sim, tmp_path):
        assert indent_sim().exit_code == 0
        for file in ("fields.xdmf", "fields/mesh.h5", "fields/step-9.h5", "surface.csv"):
            path = tmp_path / "out" / file
            data = path.read_bytes()
            for harm in (b"", data[:200], data[:-200] if file.endswith("h5") else b"junk", None):
                path.unlink() if harm is None else path.write_bytes(harm)
                before = snapshot(tmp_path)
                done = indent_sim("--resume")
                assert (
                    done.exit_code == 0
                    and f"warning: {file}: missing or damaged; run again" in done.stderr
                )
                assert snapshot(tmp_path) == before
            path.write_bytes(data)
        assert "since" not in indent_sim("--resume").stderr

    @pytest.mark.parametrize(
        "override", ["loading.steps=20", "material.nu=0.31", "output.fields=last"]
    )
    def test_another_config_is_refused(self, indent_sim, tmp_path, override):
        interrupt(tmp_path)
        before = snapshot(tmp_path)
        done = indent_sim("--resume", "--set", override)
        key, value = override.split(".", 1)[1].split("=")
        assert done.exit_code == 3 and f"'{key}: {value}' here" in done.stderr and done.stdout == ""
        assert "kept" not in done.stderr and snapshot(tmp_path) == before

    @pytest.mark.parametrize("options", ["{}", "{mat_mumps_icntl_14: 60}"])
    def test_a_folder_of_a_version_that_had_solver_petsc(self, indent_sim, tmp_path, options):
        """A folder with `solver.petsc` is read as before, but not resumed.

        The refusal names the key.
        """
        assert indent_sim().exit_code == 0
        config = tmp_path / "out" / "config.yaml"
        usual = scene_of(tmp_path / "out")
        config.write_text(config.read_text().replace("solver:\n", f"solver:\n  petsc: {options}\n"))
        before = snapshot(tmp_path)
        done = indent_sim("--resume", "--json")
        error = json.loads(done.stdout)["error"]
        assert (
            done.exit_code == 3
            and error["key"] == "solver.petsc"
            and "was removed" in error["message"]
        )
        assert (
            "give --overwrite in place of --resume" in error["remedy"]
            and "PETSC_OPTIONS" in error["remedy"]
        )
        assert snapshot(tmp_path) == before and scene_of(tmp_path / "out") == usual is not None
        for words in (
            ["compare", "out", "out"],
            ["plot", "out", "--what", "force,fields"],
            ["report", "out"],
        ):
            done = CliRunner().invoke(commands.program, words)
            assert done.exit_code == 0, done.stderr

    def test_a_foreign_folder_is_refused(self, indent_sim, tmp_path):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "thesis.tex").write_text("")
        before = snapshot(tmp_path)
        assert indent_sim("--resume").exit_code == 2 and snapshot(tmp_path) == before

    def test_a_folder_in_use_is_refused(self, indent_sim, tmp_path):
        interrupt(tmp_path)
        with open(tmp_path / "out" / result_files.LOCK, "w") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            before = snapshot(tmp_path)
            done = indent_sim("--resume")
        assert done.exit_code == 2 and "in use" in done.stderr and snapshot(tmp_path) == before


def test_the_last_fields_stay_until_the_next(tmp_path):
    """With `fields: last` the named fields exist at any moment, also for a run that is resumed."""
    for step in (1, 2, 3):
        writer = FieldWriter(tmp_path, *BODY, done=step - 1 if step > 1 else None)
        assert writer.is_continued == (step > 1)
        before = (tmp_path / "fields.xdmf").read_text()
        assert step == 1 or f"step {step - 1}" in before
        writer.write(step, 0.1, some_fields(4))
        assert set(kept_fields(tmp_path)) == {step}
