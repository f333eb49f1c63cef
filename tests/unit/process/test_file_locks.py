"""Locks of files, and files that are opened only if they are regular."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from indent_sim.process import file_locks
from indent_sim.process.file_locks import lock_file, release_lock
from indent_sim.process.regular_files import open_descriptor, open_regular_file, write_at


def opened(path: Path) -> int:
    return open_descriptor(path, os.O_RDWR | os.O_CREAT)


def test_one_exclusive_lock_or_several_shared_ones(tmp_path):
    first, second = (opened(tmp_path / "lock") for _ in range(2))
    lock_file(first)
    with pytest.raises(BlockingIOError):
        lock_file(second)
    os.close(first)
    lock_file(second, shared=True)
    third = opened(tmp_path / "lock")
    lock_file(third, shared=True)
    with pytest.raises(BlockingIOError):
        lock_file(third)
    os.close(second)
    os.close(third)


@pytest.mark.parametrize("error", [OSError("no locks"), ImportError("no module fcntl")])
def test_without_locks_the_program_continues(tmp_path, monkeypatch, error):
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(file_locks, "_system_lock", fail)
    descriptor = opened(tmp_path / "lock")
    lock_file(descriptor)
    os.close(descriptor)


@pytest.mark.parametrize("open_files_can_move", [True, False])
def test_a_lock_is_released_and_its_file_deleted(tmp_path, monkeypatch, open_files_can_move):
    """The file is deleted before its descriptor is closed, or after it where it must be."""
    monkeypatch.setattr(file_locks, "OPEN_FILES_CAN_MOVE", open_files_can_move)
    descriptor = opened(tmp_path / "lock")
    was_open = []

    def delete() -> None:
        was_open.append(Path(f"/proc/self/fd/{descriptor}").exists())
        (tmp_path / "lock").unlink()

    release_lock(descriptor, delete)
    assert was_open == [open_files_can_move] and not (tmp_path / "lock").exists()
    with pytest.raises(OSError):
        os.fstat(descriptor)


def test_only_regular_files_are_read(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    os.mkfifo(tmp_path / "pipe")
    with open_regular_file(tmp_path / "link") as file:
        assert file.read() == b"content"
    with pytest.raises(OSError):
        open_regular_file(tmp_path / "link", links=False)
    with pytest.raises(OSError, match="not a regular file"):
        open_regular_file(tmp_path / "pipe")  # and does not wait for a writer
    with pytest.raises(IsADirectoryError):
        open_regular_file(tmp_path)


def test_a_link_is_refused_where_the_system_has_no_flag_for_it(tmp_path, monkeypatch):
    monkeypatch.setattr("indent_sim.process.regular_files._NO_LINK", 0)
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    with pytest.raises(OSError, match="link"):
        open_descriptor(tmp_path / "link", os.O_RDONLY)


def test_bytes_are_written_at_a_position(tmp_path):
    descriptor = opened(tmp_path / "file")
    assert write_at(descriptor, b"abcdef", 0) == 6
    assert write_at(descriptor, b"XY", 2) == 2
    os.close(descriptor)
    assert (tmp_path / "file").read_bytes() == b"abXYef"
