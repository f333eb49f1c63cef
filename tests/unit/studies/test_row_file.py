"""Row files of a study: what was appended is read, however the writer ended."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from indent_sim.process.errors import UsageError
from indent_sim.studies.row_file import RowFile, RowIndex, RowWriter, RunRow, row_files


def row_of(number: int, exit_code: int = 0, reason: str = "") -> RunRow:
    """A row that is different for every number, with a curve of 1 to 4 rows."""
    cells = {
        "exit_code": exit_code,
        "status": "failed" if exit_code else "done",
        "reason": reason,
        "run": f"E={number}-{number:016x}",
        "method": "theory",
        "warnings": f"warning {number % 3}",
        "force": number / 7,
        "steps_done": number,
        "a": None,
    }
    return RunRow(number, number + 5, cells, np.full((1 + number % 4, 5), number / 3))


def write(path: Path, numbers: range) -> None:
    with RowWriter(path) as writer:
        for number in numbers:
            writer.append(row_of(number))


def check(index: RowIndex, number: int) -> None:
    """The row of a number is the one that was written, to the last digit."""
    found, expected = index.find(number), row_of(number)
    assert found is not None
    assert {name: found.cells[name] for name in expected.cells} == expected.cells
    assert np.array_equal(found.curve, expected.curve)


def test_rows_are_read_as_they_were_written(tmp_path):
    """600 rows: the capacity of a new file is exceeded twice."""
    write(tmp_path / "1-of-1.h5", range(600))
    write(tmp_path / "1-of-1.h5", range(600, 610))
    index = RowIndex(tmp_path)
    assert len(index) == 610
    for number in range(610):
        check(index, number)
    assert index.find(610) is None
    assert index.find_physics(12).settings == 7
    assert index.settings_of(12) == {7}


def test_any_hdf5_reader_reads_it(tmp_path):
    write(tmp_path / "1-of-1.h5", range(10))
    with h5py.File(tmp_path / "1-of-1.h5") as file:
        assert file["rows"]["force"].tolist() == [number / 7 for number in range(10)]
        assert file["curves"].shape == (sum(1 + number % 4 for number in range(10)), 5)


def test_killed_at_any_write(tmp_path, monkeypatch):
    """Each write of a row may be cut at any byte: the file opens, the row is there or not.

    The write is cut in the middle and the writer is dropped without its end, as by SIGKILL.
    """
    path = tmp_path / "rows" / "1-of-1.h5"
    path.parent.mkdir()
    write(path, range(3))
    true_write = os.pwrite
    for allowed in range(0, 700, 23):
        copy = tmp_path / f"{allowed}" / "1-of-1.h5"
        copy.parent.mkdir()
        shutil.copy(path, copy)
        left = allowed

        def cut_write(descriptor, content, position):
            nonlocal left
            count = min(left, len(content))
            left -= count
            true_write(descriptor, bytes(content)[:count], position)
            if count < len(content):
                raise KeyboardInterrupt
            return count

        writer = RowWriter(copy).__enter__()
        monkeypatch.setattr(os, "pwrite", cut_write)
        is_cut = False
        try:
            writer.append(row_of(3))
        except KeyboardInterrupt:
            is_cut = True
        monkeypatch.setattr(os, "pwrite", true_write)
        writer._close()
        index = RowIndex(copy.parent)
        assert len(index) == 3 + (not is_cut)
        write(copy, range(3 + (not is_cut), 6))
        index = RowIndex(copy.parent)
        assert len(index) == 6
        for number in range(6):
            check(index, number)


def test_an_unfinished_replacement_is_ignored(tmp_path):
    """A kill while the file is replaced leaves a file of another name beside it."""
    path = tmp_path / "1-of-1.h5"
    write(path, range(3))
    (tmp_path / ".1-of-1.h5.new").write_bytes(b"unfinished")
    (tmp_path / ".1-of-1.h5.new.empty").write_bytes(b"unfinished")
    write(path, range(3, 300))
    assert row_files(tmp_path) == [path]
    assert len(RowIndex(tmp_path)) == 300


def test_a_damaged_row_counts_as_none(tmp_path):
    path = tmp_path / "1-of-1.h5"
    write(path, range(5))
    with h5py.File(path) as file:
        place = file["rows"].id.get_offset() + 2 * file["rows"].dtype.itemsize + 40
        curve_place = file["curves"].id.get_offset()
    with open(path, "r+b") as stream:
        stream.seek(place)
        stream.write(b"\xff")
        stream.seek(curve_place)
        stream.write(b"\xff")
    file = RowFile(path)
    assert file.numbers.tolist() == [0, 1, 3, 4]
    with pytest.raises(UsageError, match="row 1 is damaged"):
        file.read(0)


def test_the_last_finished_row_counts(tmp_path):
    """A run that the machine killed is repeated; its later row counts, in whichever shard."""
    with RowWriter(tmp_path / "1-of-2.h5") as writer:
        writer.append(row_of(1))
    with RowWriter(tmp_path / "2-of-2.h5") as writer:
        writer.append(row_of(1, 137, "killed"))
        writer.append(row_of(2, 137, "killed"))
        writer.append(row_of(3, 5, "no equilibrium"))
    index = RowIndex(tmp_path)
    assert index.find(1).cells["exit_code"] == 0
    assert [index.find_finished(number) for number in (1, 2, 3, 4)] == [True, False, True, False]


def test_a_second_writer_is_refused(tmp_path):
    with (
        RowWriter(tmp_path / "1-of-1.h5"),
        pytest.raises(UsageError, match="another process"),
        RowWriter(tmp_path / "1-of-1.h5"),
    ):
        pass


@pytest.mark.parametrize("content", [b"", b"text", b"\x89HDF\r\n\x1a\n" + bytes(500)])
def test_another_file_is_refused(tmp_path, content):
    path = tmp_path / "1-of-1.h5"
    path.write_bytes(content)
    with pytest.raises(UsageError, match="not a readable file of rows"):
        RowIndex(tmp_path)
    with pytest.raises(UsageError), RowWriter(path):
        pass
    assert path.read_bytes() == content


def test_a_shortened_file_is_refused(tmp_path):
    path = tmp_path / "1-of-1.h5"
    write(path, range(50))
    os.truncate(path, 5000)
    with pytest.raises(UsageError, match="not a readable file of rows"):
        RowIndex(tmp_path)
