"""Result folders: their files, what they replace, and what a kill at any moment leaves."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import signal
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_results import (
    BODY,
    CELLS,
    FILES,
    POINTS,
    REGIONS,
    THIRD,
    a_state,
    names,
    some_fields,
    write_run,
)

from indent_sim.model.state import DERIVED_COLUMNS, ERROR_COLUMNS, STATE_COLUMNS
from indent_sim.model.tips import Sphere
from indent_sim.process.errors import (
    ConfigError,
    MeshError,
    NotConverged,
    UsageError,
    VerificationError,
)
from indent_sim.process.signals import defer_signals
from indent_sim.results import atomic_files, field_reader, output_folder, result_files, tables
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.compare import compare
from indent_sim.results.field_arrays import ARRAYS
from indent_sim.results.field_writer import FieldWriter
from indent_sim.results.json_text import to_json
from indent_sim.results.previous_run import previous_run
from indent_sim.results.reader import read, rows_of
from indent_sim.results.tip_geometry import tip_mesh
from indent_sim.results.writer import ResultFolder


class TestFiles:
    def test_a_run_leaves_its_files_and_nothing_else(self, tmp_path):
        write_run(tmp_path / "deep" / "run")
        assert names(tmp_path / "deep") == {"run"}
        assert names(tmp_path / "deep" / "run") == FILES

    def test_numbers_come_back_to_the_last_digit(self, tmp_path):
        write_run(tmp_path / "run")
        table = read(tmp_path / "run")
        assert list(table.table) == [*STATE_COLUMNS, *DERIVED_COLUMNS]
        assert table["force"].tolist() == [THIRD, THIRD * 2]
        assert table.report["status"] == "done" and table.report["exit_code"] == 0
        assert table.report["rows"] == 2

    def test_steps_and_iterations_are_written_as_integers(self, tmp_path):
        write_run(tmp_path / "run")
        row = (tmp_path / "run" / "force_indentation.csv").read_text().splitlines()[1].split(",")
        assert row[0] == "1" and row[7] == "4"

    def test_errors_have_columns_only_where_they_are_estimated(self, tmp_path):
        with ResultFolder(tmp_path / "run", "", columns=("force_error", "a_error")) as run:
            run.append(a_state(1, force_error=1e-3, a_error=2e-3))
            run.append(a_state(2))
        found = read(tmp_path / "run")
        assert list(found.table) == [*STATE_COLUMNS, *DERIVED_COLUMNS, "force_error", "a_error"]
        assert found["force_error"][0] == 1e-3 and found["a_error"][0] == 2e-3
        assert np.isnan(found["force_error"][1]) and np.isnan(found["a_error"][1])

    def test_a_number_that_there_is_none_of_is_an_empty_cell_and_a_null(self, tmp_path):
        states = [a_state(1, p_max=math.nan), a_state(2)]
        with ResultFolder(tmp_path / "run", "", columns=("force_error",)) as run:
            for state in states:
                run.append(state)
        rows = [
            line.split(",")
            for line in (tmp_path / "run" / "force_indentation.csv").read_text().splitlines()
        ]
        place = rows[0].index("p_max")
        assert (rows[1][place], rows[1][-1]) == ("", "") and float(rows[2][place]) == 1.5
        assert json.loads(to_json(rows_of(states)))[0]["p_max"] is None

    def test_fields_of_a_step_without_a_row_are_not_shown(self, tmp_path):
        """Fields without a row, as a run killed between the two leaves them, are not shown."""
        with ResultFolder(tmp_path / "run", "") as run:
            run.open_fields(*BODY, keep="all")
            for step in (1, 2):
                run.write_fields(a_state(step), some_fields(step))
                run.append(a_state(step))
            run.write_fields(a_state(3), some_fields(3))
        assert kept_steps(tmp_path / "run") == [1, 2, 3]
        assert field_reader.steps_with_fields(tmp_path / "run", read(tmp_path / "run")["step"]) == [
            1,
            2,
        ]

    @pytest.mark.parametrize("empty", ["u", "gap", "pressure"])
    def test_a_surface_with_empty_cells_is_read(self, tmp_path, empty):
        """Empty cells of a surface table are read as NaN.

        Theory has no u_x, there is no gap beyond the end of a tip, and the pressure is infinite
        under a sharp edge.
        """
        state = a_state(1)
        values = getattr(state.surface, empty).copy()
        values.flat[0] = math.nan
        with ResultFolder(tmp_path / "run", "") as run:
            run.append(replace(state, surface=replace(state.surface, **{empty: values})))
        column = read(tmp_path / "run").surface[{"u": "u_x"}.get(empty, empty)]
        assert np.isnan(column).tolist() == [True, False]

    @pytest.mark.parametrize("empty", ["p_max", *ERROR_COLUMNS])
    def test_a_row_with_an_empty_cell_is_resumed(self, tmp_path, empty):
        """A row with an empty p_max or error, as under a cone, is resumed."""
        values = {name: 0.1 for name in ERROR_COLUMNS} | {empty: float("nan")}
        with ResultFolder(tmp_path / "out", "title: x\n", columns=ERROR_COLUMNS) as run:
            run.append(a_state(1, **values))
        found = previous_run(tmp_path / "out", "title: x\n")
        assert (
            found is not None
            and len(found.states) == 1
            and np.isnan(getattr(found.states[0], empty))
        )

    def test_a_table_of_fewer_errors_goes_on_with_its_own_columns(self, tmp_path):
        """A table of an older version, with fewer error columns, is continued as it is."""
        with (
            suppress(NotConverged),
            ResultFolder(tmp_path / "run", "", columns=("force_error",)) as run,
        ):
            run.append(a_state(1, force_error=1e-3, p_max=math.nan))
            raise NotConverged("")
        with ResultFolder(
            tmp_path / "run", "", columns=("force_error", "a_error"), resume=True
        ) as run:
            assert run.previous_run.states[0].force_error == 1e-3 and np.isnan(
                run.previous_run.states[0].p_max
            )
            run.append(a_state(2, force_error=2e-3, a_error=1.0))
        found = read(tmp_path / "run")
        assert list(found.table) == [*STATE_COLUMNS, *DERIVED_COLUMNS, "force_error"]
        assert found["force_error"].tolist() == [1e-3, 2e-3]

    @pytest.mark.parametrize(("keep", "steps"), [("last", [2, 2]), ("all", [1, 1, 2, 2])])
    def test_the_surface_of_the_last_or_of_all_states(self, tmp_path, keep, steps):
        write_run(tmp_path / "run", surface=keep)
        surface = read(tmp_path / "run").surface
        assert list(surface) == list(tables.SURFACE_HEADER)
        assert surface["step"].tolist() == steps
        assert surface["pressure"][0] == THIRD

    def test_no_surface_when_none_is_wanted(self, tmp_path):
        write_run(tmp_path / "run", surface="none")
        assert names(tmp_path / "run") == FILES - {"surface.csv"}

    def test_a_state_that_did_not_converge_is_no_row(self, tmp_path):
        with (
            pytest.raises(ValueError, match="not converged"),
            ResultFolder(tmp_path / "run", "") as run,
        ):
            run.append(a_state(1, converged=False))

    def test_run_json_is_strict(self):
        lists = {"b": [np.inf, np.int64(3)], "c": np.array([1.0]), "e": (True,)}
        value = {"a": np.float64("nan"), "d": Path("x"), **lists}
        plain = json.loads(to_json(value), parse_constant=lambda word: pytest.fail(word))
        assert plain == {"a": None, "b": [None, 3], "c": [1.0], "d": "x", "e": [True]}

    def test_run_json_follows_every_row(self, tmp_path):
        with ResultFolder(tmp_path / "run", "", report={"dofs": 5}) as run:
            run.append(a_state(1))
            report = json.loads((tmp_path / "run" / "run.json").read_text())
            assert report["status"] == "running" and report["rows"] == 1 and report["dofs"] == 5


class TestPlace:
    def test_the_folder_appears_with_the_first_row(self, tmp_path):
        with ResultFolder(tmp_path / "run", "") as run:
            assert not (tmp_path / "run").exists()
            run.append(a_state(1))
            assert (tmp_path / "run" / "force_indentation.csv").read_text().count("\n") == 2
            assert run.path == tmp_path / "run"

    def test_the_old_run_stays_until_the_first_new_row(self, tmp_path):
        write_run(tmp_path / "run", 3)
        with ResultFolder(tmp_path / "run", "") as run:
            assert len(read(tmp_path / "run")) == 3
            run.append(a_state(1))
            assert len(read(tmp_path / "run")) == 1
        assert names(tmp_path) == {"run"}

    def test_what_the_user_put_into_an_old_run_stays(self, tmp_path):
        write_run(tmp_path / "run")
        (tmp_path / "run" / "thoughts.txt").write_text("mine")
        write_run(tmp_path / "run")
        assert names(tmp_path / "run") == FILES | {"thoughts.txt"}

    def test_a_foreign_folder_is_refused_and_untouched(self, tmp_path):
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "run.json").write_text('{"program": "another"}')
        with pytest.raises(UsageError, match="not made by"):
            write_run(tmp_path / "run")
        assert names(tmp_path) == {"run"} and names(tmp_path / "run") == {"run.json"}

    def test_a_file_or_a_dead_link_is_refused(self, tmp_path):
        (tmp_path / "file").write_text("")
        (tmp_path / "link").symlink_to(tmp_path / "nowhere")
        for place in ("file", "link", "file/run"):
            with pytest.raises(UsageError):
                write_run(tmp_path / place)
        assert names(tmp_path) == {"file", "link"}

    @pytest.mark.parametrize("name", ["x" * 300, "x" * 250, "x/" * 2100, "loop", "loop/run"])
    def test_names_too_long_and_links_in_a_circle_are_refused(self, tmp_path, name):
        (tmp_path / "loop").symlink_to("loop")
        with pytest.raises(UsageError):
            write_run(tmp_path / name)
        assert names(tmp_path) == {"loop"}

    @pytest.mark.parametrize("name", ["x" * 240, "two words", "q'u\"o`t$e", "ü 漢字\n🙂", "-v"])
    def test_odd_names_are_names(self, tmp_path, name):
        for steps in (3, 2):
            write_run(tmp_path / name, steps)
            assert len(read(tmp_path / name)) == steps
        assert names(tmp_path) == {name}

    def test_a_result_inside_a_result(self, tmp_path):
        """A result and another one inside it can each be replaced without harm to the other."""
        for place, steps in (("run", 3), ("run/inner", 2), ("run", 4), ("run/inner", 1)):
            write_run(tmp_path / place, steps)
        assert len(read(tmp_path / "run")) == 4 and len(read(tmp_path / "run" / "inner")) == 1
        assert names(tmp_path / "run") == FILES | {"inner"} and names(tmp_path) == {"run"}

    def test_an_empty_folder_is_filled_also_through_a_link(self, tmp_path):
        (tmp_path / "real").mkdir()
        (tmp_path / "link").symlink_to(tmp_path / "real")
        write_run(tmp_path / "link")
        assert (tmp_path / "link").is_symlink() and names(tmp_path / "real") == FILES

    def test_the_working_directory_is_filled_not_exchanged(self, tmp_path, monkeypatch):
        (tmp_path / "here").mkdir()
        monkeypatch.chdir(tmp_path / "here")
        for steps in (3, 2):
            write_run(Path("."), steps)
            assert len(read(Path("."))) == steps
        assert set(os.listdir(".")) == FILES and names(tmp_path) == {"here"}

    @pytest.mark.parametrize("code", [errno.EBUSY, errno.EXDEV])
    def test_a_mounted_folder_is_filled_not_exchanged(self, tmp_path, monkeypatch, code):
        (tmp_path / "run").mkdir()
        rename = os.rename

        def refuse(source, to, **options):
            if tmp_path / "run" in (Path(source), Path(to)):
                raise OSError(code, os.strerror(code))
            rename(source, to, **options)

        monkeypatch.setattr(os, "rename", refuse)
        for steps in (3, 2):
            write_run(tmp_path / "run", steps)
            assert len(read(tmp_path / "run")) == steps
        assert names(tmp_path) == {"run"} and names(tmp_path / "run") == FILES

    def test_an_unwritable_parent_is_refused_before_anything_is_made(self, tmp_path, monkeypatch):
        monkeypatch.setattr(os, "access", lambda path, mode: False)
        with pytest.raises(UsageError, match="Permission denied"):
            write_run(tmp_path / "deep" / "run")
        assert not names(tmp_path)

    @pytest.mark.parametrize("inside", ["", "fields"])
    def test_a_folder_that_may_only_be_read_is_refused_and_untouched(
        self, tmp_path, monkeypatch, inside
    ):
        write_run(tmp_path / "run", 3)
        (tmp_path / "run" / "fields").mkdir()
        monkeypatch.setattr(
            os, "access", lambda path, mode: Path(path) != tmp_path / "run" / inside
        )
        for resume in (False, True):
            with pytest.raises(UsageError, match=r"cannot write .*run: Permission denied"):
                write_run(tmp_path / "run", resume=resume)
        assert names(tmp_path) == {"run"} and names(tmp_path / "run") == FILES | {"fields"}

    def test_an_unwritable_parent_of_a_writable_folder_is_fine(self, tmp_path, monkeypatch):
        (tmp_path / "run").mkdir()
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
        for steps in (3, 2):
            write_run(tmp_path / "run", steps)
            assert len(read(tmp_path / "run")) == steps
        assert names(tmp_path / "run") == FILES


class TestTwoRuns:
    def test_a_second_run_is_refused_before_and_after_the_first_row(self, tmp_path):
        with ResultFolder(tmp_path / "run", "") as run:
            for step in (1, 2):
                with pytest.raises(UsageError, match="in use"):
                    write_run(tmp_path / "run")
                run.append(a_state(step))
        assert len(read(tmp_path / "run")) == 2
        write_run(tmp_path / "run", 1)

    def test_a_folder_taken_meanwhile_is_not_replaced(self, tmp_path):
        with pytest.raises(UsageError), ResultFolder(tmp_path / "run", "") as run:
            (tmp_path / "run").mkdir()
            (tmp_path / "run" / "theirs").write_text("")
            run.append(a_state(1))
        assert names(tmp_path) == {"run"} and names(tmp_path / "run") == {"theirs"}


class TestEndings:
    @pytest.mark.parametrize("error", [UsageError("x"), ConfigError("a.b", "x")])
    def test_exit_2_and_3_leave_nothing(self, tmp_path, error):
        with pytest.raises(type(error)), ResultFolder(tmp_path / "deep" / "run", ""):
            raise error
        assert not names(tmp_path)

    @pytest.mark.parametrize(
        ("error", "status", "code"),
        [
            (MeshError("no mesh"), "failed", 4),
            (NotConverged("no step"), "failed", 5),
            (VerificationError("no balance"), "failed", 6),
            (ZeroDivisionError("bug"), "failed", 1),
            (KeyboardInterrupt(), "interrupted", 130),
        ],
    )
    @pytest.mark.parametrize("rows", [0, 2])
    def test_a_bad_end_is_told_and_the_rows_kept(self, tmp_path, error, status, code, rows):
        with pytest.raises(type(error)), ResultFolder(tmp_path / "run", "") as run:
            for step in range(1, rows + 1):
                run.append(a_state(step))
            raise error
        done = read(tmp_path / "run")
        assert (
            len(done) == rows
            and done.report["status"] == status
            and done.report["exit_code"] == code
        )
        assert done.report["reason"] and names(tmp_path) == {"run"}

    def test_a_run_without_rows_replaces_no_results(self, tmp_path):
        write_run(tmp_path / "run")
        with pytest.raises(MeshError), ResultFolder(tmp_path / "run", ""):
            raise MeshError("x")
        assert len(read(tmp_path / "run")) == 2 and names(tmp_path) == {"run"}

    def test_a_run_without_rows_replaces_another_without(self, tmp_path):
        for reason in ("first", "second"):
            with pytest.raises(MeshError), ResultFolder(tmp_path / "run", ""):
                raise MeshError(reason)
        assert read(tmp_path / "run").report["reason"] == "second"


class TestFullDisk:
    def test_a_row_that_does_not_fit_is_taken_back(self, tmp_path, monkeypatch):
        write_at = atomic_files.write_at
        with (
            pytest.raises(NotConverged, match="1 rows are kept"),
            ResultFolder(tmp_path / "run", "") as run,
        ):
            run.append(a_state(1))
            monkeypatch.setattr(
                atomic_files, "write_at", lambda file, data, at: write_at(file, data[:10], at)
            )
            run.append(a_state(2))
        text = (tmp_path / "run" / "force_indentation.csv").read_text()
        assert text.count("\n") == 2 and text.endswith("\n")
        assert read(tmp_path / "run").report["exit_code"] == 5

    def test_a_file_that_does_not_fit_leaves_the_old_one(self, tmp_path, monkeypatch):
        write_atomically(tmp_path / "file", "old")

        def full(descriptor):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            write_atomically(tmp_path / "file", "new")
        assert names(tmp_path) == {"file"} and (tmp_path / "file").read_text() == "old"

    def test_fields_that_do_not_fit_are_not_named(self, tmp_path, monkeypatch):
        """On a full disk fields.xdmf names no state that could not be written."""
        replace, write_at = os.replace, atomic_files.write_at

        def full(source, target):
            if Path(target).name == "step-2.h5":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            replace(source, target)

        monkeypatch.setattr(os, "replace", full)
        with (
            pytest.raises(NotConverged, match="No space"),
            ResultFolder(tmp_path / "run", "") as run,
        ):
            run.open_fields(*BODY, keep="all")
            for step in (1, 2):
                run.write_fields(a_state(step), some_fields(step))
                run.append(a_state(step))
        assert kept_steps(tmp_path / "run") == [1] and names(tmp_path / "run" / "fields") == {
            "mesh.h5",
            "step-1.h5",
        }
        writer = FieldWriter(tmp_path, *BODY, keep="all")
        writer.write(1, 0.1, some_fields(1))
        monkeypatch.setattr(
            atomic_files, "write_at", lambda file, data, at: write_at(file, data[:500], at)
        )
        with pytest.raises(OSError, match="No space"):
            writer.write(3, 0.1, some_fields(3))
        assert kept_steps(tmp_path) == [1]


class TestKills:
    @pytest.mark.parametrize("stop", range(6))
    @pytest.mark.parametrize("inside", [False, True])
    @pytest.mark.parametrize("earlier", [0, 3])
    def test_a_kill_amid_the_exchange_loses_neither(
        self, tmp_path, monkeypatch, stop, inside, earlier
    ):
        """A kill before any rename of the exchange leaves the old results or the new ones."""
        (tmp_path / "run").mkdir()
        if earlier:
            write_run(tmp_path / "run", earlier)
        if inside:
            monkeypatch.chdir(tmp_path / "run")

        class Kill(BaseException):
            pass

        left = [stop]

        def counted(rename):
            def one(*args, **options):
                left[0] -= 1
                if left[0] < 0:
                    raise Kill
                return rename(*args, **options)

            return one

        claim = output_folder.OutputFolder(tmp_path / "run")
        write_atomically(claim.path / "run.json", json.dumps({"program": "indent-sim"}))
        write_atomically(claim.path / "force_indentation.csv", "step,delta,force,a\n1,1,1,1\n")
        with monkeypatch.context() as patch:
            patch.setattr(output_folder.os, "rename", counted(os.rename))
            patch.setattr(output_folder.shutil, "move", counted(output_folder.shutil.move))
            with suppress(Kill):
                claim.rename_into_place()
        close_files_below(tmp_path)
        again = output_folder.OutputFolder(tmp_path / "run")
        rows = (
            len(read(tmp_path / "run")) if earlier or result_files.has_rows(tmp_path / "run") else 0
        )
        assert rows in (earlier, 1)
        again.abandon()
        assert names(tmp_path) == {"run"}

    def test_a_signal_waits_for_the_end_of_a_write(self):
        done, before = (
            False,
            signal.signal(signal.SIGINT, signal.default_int_handler),
        )  # not another test's
        try:
            with pytest.raises(KeyboardInterrupt), defer_signals():
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.01)
                done = True
        finally:
            signal.signal(signal.SIGINT, before)
        assert done


def close_files_below(folder: Path) -> None:
    """Close this process's files in a folder, as the kernel does when a process is killed."""
    for descriptor in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if descriptor.readlink().is_relative_to(folder):
                os.close(int(descriptor.name))


def kept_steps(folder: Path) -> list[int]:
    """Steps that fields.xdmf names, as meshio reads it."""
    import meshio

    with meshio.xdmf.TimeSeriesReader(folder / "fields.xdmf") as reader:
        reader.read_points_cells()
        return [int(reader.read_data(k)[0]) for k in range(reader.num_steps)]


def bytes_written() -> int:
    """Number of bytes that this process has written so far."""
    return int(re.findall(r"wchar: (\d+)", Path("/proc/self/io").read_text())[0])


class TestFields:
    @pytest.mark.parametrize(("keep", "kept"), [("all", [1, 2, 3]), ("last", [3])])
    def test_what_is_written_is_what_meshio_reads(self, tmp_path, keep, kept):
        import meshio

        writer = FieldWriter(tmp_path, *BODY, keep=keep)
        for step in (1, 2, 3):
            writer.write(step, 0.1 * step, some_fields(step))
        with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
            points, cells = reader.read_points_cells()
            assert np.array_equal(points[:, [0, 2]], POINTS) and not points[:, 1].any()
            assert cells[0].type == "triangle" and np.array_equal(cells[0].data, CELLS)
            for k, step in enumerate(kept):
                time_, nodal, cellwise = reader.read_data(k)
                fields = some_fields(step)
                assert time_ == step
                assert np.array_equal(nodal["displacement"][:, [0, 2]], fields["displacement"])
                assert np.array_equal(nodal["pressure"], fields["pressure"])
                for name in ("stress", "von_mises", "principal_stresses", "J", "energy_density"):
                    assert np.array_equal(
                        cellwise[name][0], fields[name].reshape(2, *ARRAYS[name][2])
                    ), name
                assert np.array_equal(cellwise["region"][0], REGIONS)
            assert reader.num_steps == len(kept)

    def test_tetrahedra(self, tmp_path):
        import meshio

        points = np.vstack([np.zeros(3), np.eye(3)])
        tip = tip_mesh(Sphere(R=1.0), (0.0, 0.0), 0.5, "three_dimensional", 1)
        writer = FieldWriter(tmp_path, points, np.array([[0, 1, 2, 3]]), np.zeros(1), tip)
        writer.write(1, 0.1, some_fields(1, 4, 1, 3) | {"displacement": points})
        with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
            points_read, cells = reader.read_points_cells()
            assert cells[0].type == "tetra" and np.array_equal(points_read, points)
            assert np.array_equal(reader.read_data(0)[1]["displacement"], points)

    @pytest.mark.parametrize("dim", [2, 3])
    def test_the_tip_is_a_second_mesh_that_comes_down(self, tmp_path, dim):
        """The tip is a second mesh that lies on a sphere of radius 1 at the depth of each state.

        Where half of the body is modelled, it moves by half of the approach.
        """
        import meshio

        kinematics, center = {2: ("plane_strain", (2.0,)), 3: ("three_dimensional", (2.0, -1.0))}[
            dim
        ]
        tip = tip_mesh(Sphere(R=1.0), center, 0.5, kinematics, 2)
        writer = FieldWriter(tmp_path, POINTS, CELLS, REGIONS, tip, keep="all")
        for step in (1, 2):
            writer.write(step, 0.1 * step, some_fields(step))
        with meshio.xdmf.TimeSeriesReader(tmp_path / "tip.xdmf") as reader:
            points, cells = reader.read_points_cells()
            assert cells[0].type == {2: "line", 3: "triangle"}[dim]
            for k, step in enumerate((1, 2)):
                down = reader.read_data(k)[1]["displacement"]
                assert down == pytest.approx(np.tile([0, 0, -0.05 * step], (len(points), 1)))
        middle = np.array([center[0], center[1] if dim == 3 else 0.0, 1.0])
        assert np.linalg.norm(points - middle, axis=1) == pytest.approx(1.0)

    @pytest.mark.parametrize("keep", ["all", "last"])
    def test_bytes_grow_with_the_states(self, tmp_path, keep):
        """The bytes written grow linearly with the states; 1.1 allows for longer step numbers."""
        writer, costs = FieldWriter(tmp_path, *BODY, keep=keep), []
        for first in (101, 201):  # steps of three digits
            before = bytes_written()
            for step in range(first, first + 100):
                writer.write(step, 0.1, some_fields(step))
            costs.append(bytes_written() - before)
        assert 0 < costs[1] < 1.1 * costs[0]
        assert len(kept_steps(tmp_path)) == (200 if keep == "all" else 1)

    def test_a_file_torn_amid_a_state_goes_on_with_those_before(self, tmp_path):
        writer = FieldWriter(tmp_path, *BODY, keep="all")
        for step in (1, 2, 3):
            writer.write(step, 0.1 * step, some_fields(step))
        text = (tmp_path / "fields.xdmf").read_text()
        (tmp_path / "fields.xdmf").write_text(text[: text.index("step 3") + 300])
        again = FieldWriter(tmp_path, *BODY, keep="all", done=2)
        assert again.is_continued and kept_steps(tmp_path) == [1, 2]
        assert names(tmp_path / "fields") == {"mesh.h5", "step-1.h5", "step-2.h5"}

    def test_one_file_of_the_version_before_is_replaced(self, tmp_path):
        write_run(tmp_path / "run")
        (tmp_path / "run" / "fields.h5").write_bytes(b"slots")
        with ResultFolder(tmp_path / "run", "title: x\n", resume=True) as run:
            run.open_fields(*BODY, keep="last")
        assert names(tmp_path / "run") == FILES | {"fields.xdmf", "tip.xdmf", "fields"}

    def test_a_new_run_takes_our_fields_and_leaves_others(self, tmp_path):
        with ResultFolder(tmp_path / "run", "") as run:
            run.open_fields(*BODY, keep="all")
            run.write_fields(a_state(1), some_fields(1))
            run.append(a_state(1))
        (tmp_path / "run" / "fields" / "mine.h5").write_text("mine")
        write_run(tmp_path / "run")
        assert names(tmp_path / "run") == FILES | {"fields"} and names(tmp_path) == {"run"}
        assert names(tmp_path / "run" / "fields") == {"mine.h5"}

    def test_fields_move_with_the_folder(self, tmp_path):
        with ResultFolder(tmp_path / "run", "") as run:
            run.open_fields(*BODY, keep="last")
            for step in (1, 2):
                run.write_fields(a_state(step), some_fields(step))
                run.append(a_state(step))
        assert names(tmp_path / "run") == FILES | {"fields.xdmf", "tip.xdmf", "fields"}
        assert kept_steps(tmp_path / "run") == [2]


class TestReading:
    def write(self, path: Path, text: str) -> Path:
        path.write_text(text)
        return path

    def test_a_torn_last_line_is_dropped(self, tmp_path):
        table = self.write(tmp_path / "a.csv", "step,delta,force,a\n1,0.1,2,0.5\n2,0.2,")
        assert len(read(table)) == 1

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "step,delta,force\n1,1,1\n",
            "step,delta,force,a\n1,2\n",
            "step,delta,force,a\n1,x,1,1\n",
            "step,delta,force,a\n1,1,1,1\n1,2,2,2\n",
        ],
    )
    def test_what_is_no_result_is_refused(self, tmp_path, text):
        with pytest.raises(UsageError):
            read(self.write(tmp_path / "a.csv", text))

    def test_nothing_there(self, tmp_path):
        for place in (tmp_path, tmp_path / "a.csv"):
            with pytest.raises(UsageError, match="cannot read"):
                read(place)


def test_a_measured_curve_is_read_as_it_is(tmp_path):
    """A table of depths and forces alone is read with numbered rows and no contact radius."""
    (tmp_path / "measured.csv").write_text("delta,force\n0.1,1\n0.2,3\n")
    found = read(tmp_path / "measured.csv")
    assert (
        found["step"].tolist() == [1, 2]
        and found["force"].tolist() == [1, 3]
        and np.isnan(found["a"]).all()
    )
    with pytest.raises(UsageError, match="no column of force among delta, width"):
        (tmp_path / "measured.csv").write_text("delta,width\n0.1,1\n")
        read(tmp_path / "measured.csv")


class TestCompare:
    HEADER = "step,delta,force,a\n"

    def pair(self, tmp_path, first: str, second: str, rtol: float = 1e-6):
        for name, text in (("A", first), ("B", second)):
            (tmp_path / name).write_text(self.HEADER + text)
        return compare(tmp_path / "A", tmp_path / "B", rtol)

    def test_equal_within_the_tolerance(self, tmp_path):
        same = self.pair(
            tmp_path, "1,0.1,2,0.5\n2,0.2,3,0.6\n", "2,0.2,3.000001,0.6\n1,0.1,2,0.5\n"
        )
        same.check()
        assert same.row_keys == (1, 2) and same.max_relative_difference["force"] == pytest.approx(
            3.3e-7, rel=0.1
        )

    @pytest.mark.parametrize(
        "units", [{"length": "um", "force": "N"}, {"length": "mm", "force": "mN"}]
    )
    def test_results_in_other_units_are_refused(self, tmp_path, units):
        """Results in other units are refused; a result without units is compared as it is."""
        for name, own in (("A", {"length": "mm", "force": "N"}), ("B", units), ("C", {})):
            write_run(tmp_path / name)
            report = json.loads((tmp_path / name / "run.json").read_text())
            (tmp_path / name / "run.json").write_text(json.dumps(report | {"units": own}))
        with pytest.raises(UsageError, match=r"A measures .* in (mm|N), .*B in (um|mN)"):
            compare(tmp_path / "A", tmp_path / "B")
        compare(tmp_path / "A", tmp_path / "C").check()

    @pytest.mark.parametrize(
        ("first", "second", "said"),
        [
            ("1,0.1,2,0.5\n", "1,0.1,2.01,0.5\n", "force"),
            ("1,0.1,2,0.5\n", "1,0.11,2,0.5\n", "delta"),
            ("1,0.1,2,nan\n", "1,0.1,2,0.5\n", "a nan"),
            ("1,0.1,2,\n", "1,0.1,2,0.5\n", "a nan"),
            ("1,0.1,2,0.5\n2,0.2,3,0.6\n", "1,0.1,2,0.5\n", "step 2 is only in"),
            ("", "", "no step in common"),
        ],
    )
    def test_what_differs_is_said(self, tmp_path, first, second, said):
        with pytest.raises(VerificationError, match=said):
            self.pair(tmp_path, first, second).check()

    def test_nothing_equals_nothing(self, tmp_path):
        self.pair(tmp_path, "1,0.1,2,\n2,0.2,3,0.6\n", "1,0.1,2,\n2,0.2,3,0.6\n").check()

    def test_nan_equals_nan_and_a_trace_of_force_is_zero(self, tmp_path):
        self.pair(
            tmp_path, "1,-0.1,0,nan\n2,0.2,3,nan\n", "1,-0.1,1e-17,nan\n2,0.2,3,nan\n"
        ).check()

    def test_every_column_has_its_own_tolerance(self, tmp_path):
        texts = "1,0.1,1.0,0.5\n", "1,0.1,1.0005,0.505\n"
        self.pair(tmp_path, *texts, rtol={"force": 1e-3, "a": 2e-2}).check()
        for rtol in ({"force": 1e-3}, {"a": 2e-2}, {"": 1e-3}):
            with pytest.raises(VerificationError):
                self.pair(tmp_path, *texts, rtol=rtol).check()
        assert compare(tmp_path / "A", tmp_path / "B", 1e-3, ["force"]).differences == ()
        with pytest.raises(UsageError, match="--rtol names a, which is not among"):
            compare(tmp_path / "A", tmp_path / "B", {"a": 1e-3}, ["force"])
        with pytest.raises(UsageError, match="no column 'p_max'"):
            compare(tmp_path / "A", tmp_path / "B", {"p_max": 1e-3})

    def test_tables_without_steps_are_matched_by_depth(self, tmp_path):
        """Tables without steps are matched by depth and by the order of equal depths."""
        (tmp_path / "A").write_text("delta,force\n0.1,1\n0.2,3\n0.1,0.9\n")
        (tmp_path / "B").write_text("force,delta\n3,0.2\n1,0.1000000000001\n0.9,0.1\n")
        found = compare(tmp_path / "A", tmp_path / "B")
        found.check()
        assert found.matched_by == "delta" and list(found.pairs) == ["delta", "force"]
        self.pair(tmp_path, "1,0.1,1,0.5\n2,0.3,3,0.6\n", "")
        (tmp_path / "B").write_text("delta,force\n0.1,1\n0.2,3\n")
        with pytest.raises(
            VerificationError, match=r"delta 0\.3 is only in .*A\ndelta 0\.2 is only in .*B"
        ):
            compare(tmp_path / "A", tmp_path / "B").check()

    def curve(self, n: int, head: str = "step,delta,force,a") -> str:
        """Table of n rows of F = delta^1.5 up to the depth 1."""
        depths = np.arange(1, n + 1) / n
        if not head.startswith("step"):
            return head + "\n" + "".join(f"{d:.15g},{d**1.5:.15g}\n" for d in depths)
        return (
            head
            + "\n"
            + "".join(
                f"{k},{d:.15g},{d**1.5:.15g},{d**0.5:.15g}\n" for k, d in enumerate(depths, 1)
            )
        )

    HISTORY = """\
step,t,delta,force,a,branch
1,0,0,0,0,approach
2,1,0.1,1,0.3,approach
3,2,0.2,2,0.4,approach
4,2,0.1,0.8,0.3,retract
5,3,0.1,0.6,0.3,hold
"""

    def test_histories_of_other_times_are_matched_by_time(self, tmp_path):
        """Histories are matched by time and interpolated by chords between their rows.

        At a jump the row after it counts; rows beyond the other history stay unmatched.
        """
        A, B = tmp_path / "A", tmp_path / "B"
        A.write_text(self.HISTORY)
        B.write_text(
            "step,t,delta,force,a,branch\n1,0.5,0.05,0.5,0.15,approach\n2,2,0.1,0.8,0.3,retract\n"
        )
        for one, other in ((A, B), (B, A)):
            found = compare(one, other)
            found.check()
            assert (
                found.matched_by == "t"
                and found.row_keys == (0.5, 2.0)
                and found.interpolation[0] == A
            )
        B.write_text(
            "step,t,delta,force,a,branch\n1,1,0.1,1,0.3,approach\n2,2,0.1,0.9,0.3,retract\n3,4,0,0,0,hold\n"
        )
        found = compare(A, B)
        assert found.interpolation is None  # every time is a row's
        assert [text.split(" differ")[0] for text in found.differences] == [
            f"t 4 is only in {B}",
            "t 2: force 0.8 and 0.9",
        ]
        B.write_text(self.HISTORY)
        assert compare(A, B).matched_by == "step"  # of the same times, as ever

    def test_a_history_of_an_earlier_version_is_compared_with_one_of_today(self, tmp_path):
        """A history in experiment.csv, as older versions wrote it, is compared with a newer one."""
        new, old = tmp_path / "new", tmp_path / "old"
        for result in (new, old):
            result.mkdir()
        (new / "force_indentation.csv").write_text(self.HISTORY)
        (old / "force_indentation.csv").write_text(self.HEADER + "1,0.1,1,0.3\n2,0.2,2,0.4\n")
        rows = [line.split(",")[1:] for line in self.HISTORY.splitlines()]
        (old / "experiment.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
        for pair in ((new, old), (old, new)):
            found = compare(*pair)
            found.check()
            assert found.matched_by == "step" and len(found.row_keys) == 5
        (old / "experiment.csv").write_text(
            "\n".join(",".join(row) for row in rows).replace("0.6", "0.5") + "\n"
        )
        assert compare(new, old).differences == ("step 5: force 0.6 and 0.5 differ by 0.17",)

    def test_rows_at_other_depths_are_interpolated(self, tmp_path):
        """Rows at other depths are interpolated: power laws exactly, and none beyond the range."""
        A, B = tmp_path / "A", tmp_path / "B"
        A.write_text(self.curve(20))
        B.write_text(self.curve(7))
        found = compare(A, B, 1e-9)
        assert (
            found.matched_by == "delta"
            and found.interpolation[0] == A
            and found.interpolation[1] < 1e-12
        )
        assert (
            len(found.row_keys) == 7
            and list(found.pairs) == ["force", "a"]
            and found.differences == ()
        )
        assert found.residual["percent_largest"] < 1e-8 and found.as_json()["interpolated"][
            "curve"
        ] == str(A)
        B.write_text(self.curve(7) + "8,1.5,2,1\n")
        assert compare(A, B, 1e-6).differences == (f"delta 1.5 is only in {B}",)

    def test_a_measured_curve_is_interpolated_by_chords(self, tmp_path):
        """The stated interpolation error is that of chords, h^2/8 times the second derivative."""
        A, B = tmp_path / "A.csv", tmp_path / "B"
        A.write_text(
            self.curve(400, "depth [nm],force [nN]")
        )  # B says no units: numbers as they stand
        B.write_text(self.curve(7))
        found = compare(A, B, 1e-3)
        assert found.differences == () and found.interpolation[0] == A
        assert 1e-6 < found.interpolation[1] < 1e-3
        assert found.max_relative_difference["force"] < 1e-3 and list(found.pairs) == ["force"]

    def test_the_residual_is_of_the_largest_force(self, tmp_path):
        found = self.pair(
            tmp_path,
            "1,0.1,2,0.5\n2,0.2,4,0.5\n3,0.3,8,0.5\n",
            "1,0.1,2,0.5\n2,0.2,4,0.5\n3,0.3,10,0.5\n",
        )
        assert found.residual == pytest.approx(
            {"percent_largest": 20.0, "percent_rms": 20 / 3**0.5}
        )
        assert found.interpolation is None

    ROWS = """\
t,z,delta,force,a,branch
,0.1,0.1,1,,approach
,0.1,0.1,1.1,,hold
,0.05,0.05,0,,retract
"""

    def test_experiments_are_matched_by_row(self, tmp_path):
        """Experiments are compared row by row, including words and empty cells."""
        first, second = tmp_path / "experiment.csv", tmp_path / "other.csv"
        first.write_text(self.ROWS)
        second.write_text(self.ROWS)
        found = compare(first, second, 0)
        found.check()
        assert found.matched_by == "row" and list(found.pairs) == ["t", "z", "delta", "force", "a"]
        for before, after, said in (
            ("hold", "retract", "row 2: branch hold and retract"),
            ("1.1", "1.2", "row 2: force 1.1 and 1.2"),
            ("\n,0.05,", "\n3,0.05,", "t nan and"),
            (",0.05,0.05,0,,retract\n", "", "row 3 is only in .*experiment.csv"),
        ):
            second.write_text(self.ROWS.replace(before, after))
            with pytest.raises(VerificationError, match=said):
                compare(first, second).check()
        second.write_text(self.ROWS.replace("hold", "retract"))
        compare(first, second, columns=["force"]).check()
        with pytest.raises(UsageError, match="branch, a column of words"):
            compare(first, second, {"branch": 0.1})
        with pytest.raises(UsageError, match=r"drawn as experiment\.png"):
            read(first)

    def test_results_are_equal_only_with_their_experiments(self, tmp_path):
        """The tables experiment.csv and dynamic.csv are compared where both results have them."""
        tables = {
            "force_indentation.csv": self.HEADER + "1,0.1,1,0.5\n",
            "experiment.csv": self.ROWS,
            "dynamic.csv": "frequency,storage,loss\n1,2,0.1\n",
        }
        A, B = tmp_path / "A", tmp_path / "B"
        for result in (A, B):
            result.mkdir()
            for name, text in tables.items():
                (result / name).write_text(text)
        same = compare(A, B)
        same.check()
        assert [(name, len(table.row_keys)) for name, table in same.other_tables.items()] == [
            ("experiment.csv", 3),
            ("dynamic.csv", 1),
        ]
        (B / "experiment.csv").write_text(self.ROWS.replace("1.1", "1.2"))
        (B / "dynamic.csv").write_text(tables["dynamic.csv"].replace("0.1", "0.2"))
        found = compare(A, B)
        assert [text.split(" differ")[0] for text in found.differences] == [
            "experiment.csv: row 2: force 1.1 and 1.2",
            "dynamic.csv: row 1: loss 0.1 and 0.2",
        ]
        compare(A, B, {"force": 0.1, "loss": 0.6}).check()
        compare(A, B, columns=["a"]).check()
        assert "dynamic.csv" not in compare(A, B, columns=["a"]).other_tables
        with pytest.raises(UsageError, match="no column 'shear'"):
            compare(A, B, columns=["shear"])
        (B / "experiment.csv").unlink()
        assert list(compare(A, B).other_tables) == ["dynamic.csv"]

    def test_without_tolerance_every_digit_counts(self, tmp_path):
        self.pair(tmp_path, "1,0.1,0.3,0\n", "1,0.1,0.3,0\n", rtol=0).check()
        with pytest.raises(VerificationError):
            self.pair(tmp_path, "1,0.1,0.3,0\n", "1,0.1,0.30000000000000004,0\n", rtol=0).check()


def test_the_time_of_a_state_is_its_own_where_time_passes(tmp_path: Path) -> None:
    """The second of two states at one time, at a jump, is written one last digit later."""
    points, cells = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]]), np.array([[0, 1, 2]])
    tip = tip_mesh(Sphere(R=1.0), (0.0,), 1.0, "axisymmetric", 1)
    fields = {"displacement": np.zeros((3, 2))}
    kinds = {"displacement": ARRAYS["displacement"]}

    def times(done: int | None, *states: tuple[int, float | None]) -> list[float]:
        writer = FieldWriter(
            tmp_path, points, cells, np.zeros(1), tip, keep="all", done=done, arrays=kinds
        )
        for step, t in states:
            writer.write(step, 0.1, fields, t)
        return [
            float(value)
            for value in re.findall(
                r'<Time Value="([^"]*)"', (tmp_path / "fields.xdmf").read_text()
            )
        ]

    assert times(None, (1, 0.5), (2, 0.5), (3, 2.0)) == [0.5, np.nextafter(0.5, 1.0), 2.0]
    assert times(2, (3, 0.5)) == [
        0.5,
        np.nextafter(0.5, 1.0),
        np.nextafter(np.nextafter(0.5, 1.0), 1.0),
    ]
    assert times(None, (1, None), (2, None)) == [1.0, 2.0]
