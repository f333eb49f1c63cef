"""Import of gmsh on Linux machines without the display libraries of X and GL.

The gmsh of PyPI is linked against the libraries of its graphical window, which meshing never calls,
and cannot be loaded without them. Each missing one is replaced by an empty library of the same
name.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any

# Libraries that draw windows; no other library is ever replaced.
DISPLAY_LIBRARIES = frozenset(
    f"lib{name}"
    for name in (
        "GLU.so.1",
        "GL.so.1",
        "OpenGL.so.0",
        "GLX.so.0",
        "X11.so.6",
        "Xext.so.6",
        "Xrender.so.1",
        "Xcursor.so.1",
        "Xfixes.so.3",
        "Xft.so.2",
        "Xinerama.so.1",
        "fontconfig.so.1",
    )
)
# Machine numbers of the ELF format.
ELF_MACHINES = {"x86_64": 62, "aarch64": 183}


def import_gmsh() -> Any:
    """Import gmsh and return the module.

    Raises
    ------
    ImportError
        If gmsh is not installed.
    OSError
        If a library that it needs is missing and cannot be replaced.
    """
    attempts: set[str] = set()
    while True:
        try:
            import gmsh
        except OSError as error:
            name = missing_library(error) or _unresolved_library(error)
            if name in attempts or not _can_be_mended(name):
                raise
            attempts.add(name)
            if name in DISPLAY_LIBRARIES:
                _load_library(name, ctypes.RTLD_LOCAL)
            else:
                _load_lazily(name)
        else:
            return gmsh


def missing_library(error: OSError) -> str:
    """Return the file name of the library that an error reports as missing; empty if none is."""
    found = re.match(r"(\S+): cannot open shared object file", str(error))
    return found[1] if found else ""


def _unresolved_library(error: OSError) -> str:
    """Return the path of a gmsh that lacks functions of the display; empty for other errors."""
    found = re.match(r"(\S*libgmsh\S*): undefined symbol", str(error))
    return found[1] if found else ""


def _can_be_mended(name: str) -> bool:
    """Return whether a library can be replaced, or loaded without the display functions."""
    return (
        (name in DISPLAY_LIBRARIES or "libgmsh" in name)
        and sys.platform == "linux"
        and sys.byteorder == "little"
        and platform.machine() in ELF_MACHINES
    )


def _load_lazily(path: str) -> None:
    """Load a library so that its functions are looked up only when they are called.

    ctypes looks up all functions at once.

    The few functions whose addresses the library needs at once are defined as addresses that cannot
    be called.
    """
    load = ctypes.CDLL(None).dlopen
    load.argtypes = ctypes.c_char_p, ctypes.c_int
    load.restype = ctypes.c_void_p
    error_text = ctypes.CDLL(None).dlerror
    error_text.restype = ctypes.c_char_p
    defined: set[str] = set()
    while not load(os.fsencode(path), os.RTLD_LAZY):
        found = re.search(r"undefined symbol: (\w+)", (error_text() or b"").decode())
        # The import that follows reports any other error.
        if not found or found[1] in defined:
            return
        defined.add(found[1])
        _load_library(f"lib{found[1]}.so", os.RTLD_GLOBAL, found[1])


def _load_library(name: str, mode: int, function: str = "") -> None:
    """Load an almost empty library, to which later requests of its name then refer."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(library_bytes(name, ELF_MACHINES[platform.machine()], function))
        ctypes.CDLL(str(path), mode)


def library_bytes(name: str, machine: int, function: str = "") -> bytes:
    """Return the bytes of a shared library (64-bit ELF) that defines at most one symbol.

    Parameters
    ----------
    name
        Name by which other libraries refer to it (DT_SONAME).
    machine
        Number of the processor's architecture in the ELF format.
    function
        Name of a symbol that the library defines.
    """
    header_size = 64
    segment_size = 56
    section_size = 64
    symbol_size = 24
    tag_size = 16
    names = [text.encode() + b"\0" for text in ("", name, function)]
    strings = b"".join(names)
    # The first symbol of every table is empty. The address 1 of the other one (global, absolute)
    # differs from that of a missing function, 0.
    global_symbol = 0x10
    absolute = 0xFFF1
    address = 1
    symbols = bytes(symbol_size) + struct.pack(
        "<I2BH2Q", len(names[0] + names[1]), global_symbol, 0, absolute, address, 0
    )
    # One bucket with the second symbol, after which there is no other.
    symbol_hashes = struct.pack("<6I", 1, 2, 1 if function else 0, 0, 0, 0)
    symbols_at = header_size + 3 * segment_size
    hashes_at = symbols_at + len(symbols)
    tags_at = hashes_at + len(symbol_hashes)
    # DT_HASH, DT_SYMTAB, DT_SYMENT, DT_STRSZ, DT_SONAME, DT_STRTAB and DT_NULL.
    strings_at = tags_at + 7 * tag_size
    tags = struct.pack(
        "<14Q",
        *(4, hashes_at, 6, symbols_at, 11, symbol_size),
        *(10, len(strings), 14, len(names[0]), 5, strings_at, 0, 0),
    )
    size = strings_at + len(strings)
    read_write = 6
    largest_page = 2**16
    segments = b"".join(
        struct.pack("<2I6Q", kind, read_write, start, start, start, length, length, alignment)
        for kind, start, length, alignment in (
            (1, 0, size, largest_page),  # PT_LOAD
            (2, tags_at, len(tags), 8),  # PT_DYNAMIC
            (0x6474E551, 0, 0, 16),  # PT_GNU_STACK, without which the stack would be executable
        )
    )
    little_endian_64_bit = b"\x7fELF\x02\x01\x01" + bytes(9)
    shared_object = 3
    version = 1
    header = struct.pack(
        "<16s2HI3QI6H",
        little_endian_64_bit,
        *(shared_object, machine, version, 0, header_size, 0, 0),
        *(header_size, segment_size, 3, section_size, 0, 0),
    )
    return header + segments + symbols + symbol_hashes + tags + strings
