"""Stand-ins for libraries of X and GL: the loader accepts them, and only these are replaced."""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import sys

import pytest

from indent_sim.mesh import display_libraries

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() not in display_libraries.ELF_MACHINES,
    reason="the format of the libraries is that of Linux",
)


def test_the_loader_finds_a_library_and_its_symbol(tmp_path):
    elf_machine = display_libraries.ELF_MACHINES[platform.machine()]
    path = tmp_path / "libstandin.so.7"
    path.write_bytes(display_libraries.library_bytes(path.name, elf_machine, "placeholder"))
    library = ctypes.CDLL(str(path))
    assert ctypes.cast(library.placeholder, ctypes.c_void_p).value == 1
    with pytest.raises(AttributeError):
        _ = library.another
    path.unlink()
    ctypes.CDLL("libstandin.so.7")  # found by its name, as a library that needs it finds it


def test_a_library_without_symbols(tmp_path):
    elf_machine = display_libraries.ELF_MACHINES[platform.machine()]
    path = tmp_path / "libempty.so.1"
    path.write_bytes(display_libraries.library_bytes(path.name, elf_machine))
    with pytest.raises(AttributeError):
        _ = ctypes.CDLL(str(path)).anything


def test_the_missing_library_is_read_off_the_error():
    """The text is that of the loader of glibc for a library that does not exist."""
    with pytest.raises(OSError, match="cannot open") as error:
        ctypes.CDLL("libdoes-not-exist.so.1")
    assert display_libraries.missing_library(error.value) == "libdoes-not-exist.so.1"
    assert display_libraries.missing_library(OSError("invalid ELF header")) == ""
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert display_libraries.missing_library(full) == ""
