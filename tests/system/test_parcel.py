"""Objects between two processes: what is large lies in a file without a name, what is small in the
pipe.
"""

from __future__ import annotations

from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from indent_sim.process import ipc


def passed(value: Any, mapped: bool) -> Any:
    """A value that was sent and received."""
    here, there = Pipe()
    ipc.send(here, value, mapped)
    return ipc.receive(there)


VALUE = {
    "points": np.arange(7.0).reshape(7, 1),
    "regions": np.arange(5, dtype=np.int32),
    "none": np.empty((0, 3)),
    "turned": np.arange(6).reshape(2, 3).T,
    "every other": np.arange(9)[::2],
    "words": ["a", None],
}


@pytest.mark.parametrize("mapped", [False, True])
def test_what_arrives_is_what_was_sent(mapped: bool) -> None:
    found = passed(VALUE, mapped)
    assert found.keys() == VALUE.keys() and found["words"] == VALUE["words"]
    for name in VALUE.keys() - {"words"}:
        assert np.array_equal(found[name], VALUE[name]) and found[name].dtype == VALUE[name].dtype


def test_a_mapped_array_goes_through_no_pipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """8 MB would fill the buffer of the pipe, which nobody empties here, and wait for ever; the
    file has no name.
    """
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    found = passed(np.ones(10**6), mapped=True)
    assert found.sum() == 10**6 and not found.flags.writeable
    assert not list(tmp_path.iterdir())


def test_a_file_without_room_is_an_error_and_leaves_the_pipe_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tempfile.tempdir", "/dev/full/none")
    here, there = Pipe()
    with pytest.raises(OSError):
        ipc.send(here, np.ones(10), mapped=True)
    ipc.send(here, "words", mapped=True)
    assert ipc.receive(there) == "words"
