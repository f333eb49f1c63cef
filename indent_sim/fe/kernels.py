"""The cache of compiled kernels: say when it is filled, and clear what a killed run left half-written in it.

FFCx claims an entry by creating its .c file and marks it done by a .c.cached file; who finds the first without the
second waits for another process to finish. A process that was killed never does: its entry is told by its age.
One that is interrupted takes its claim back when it ends.
"""

from __future__ import annotations

import atexit
import logging
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from cffi import VerificationError
from ffcx.codegeneration import jit

from indent_sim.errors import BackendError

STALE = 30.0  # s without a change in an unfinished entry; compiling one takes a few
logger = logging.getLogger("indent_sim")
FAILED = "Failed just-in-time compilation"  # so dolfinx tells the other ranks
_found: Callable[..., Any] = jit.get_cached_module
_compiled: Callable[..., Any] = jit._compile_objects
_told: set[str] = set()
_claimed: set[Path] = set()


def watch_the_cache() -> None:
    """Let FFCx go through `lookup` and `compile_kernels`; call before the first form, and more often at will."""
    jit.get_cached_module = lookup
    jit._compile_objects = compile_kernels


@contextmanager
def compiling() -> Iterator[None]:
    """Turn what dolfinx makes of a compiler that fails on rank 0 into BackendError on every rank."""
    try:
        yield
    except RuntimeError as error:
        if FAILED not in str(error):
            raise
        raise BackendError(str(error)) from error


def lookup(module_name: str, object_names: Any, cache_dir: Any, timeout: int) -> Any:
    """FFCx's own look-up; an unfinished entry that nobody works on is removed, and compiled anew, and so is one whose
    library a full disk or a power failure has cut off: to load it would end the process."""
    entry = Path(cache_dir) / f"{module_name}.c"
    is_finished = entry.with_suffix(".c.cached").exists()  # before that, the linker of another process may be at it
    if is_finished and not all(_is_whole(entry.with_suffix(ending)) for ending in EXTENSION_SUFFIXES):
        for suffix in ("*so", ".c.cached", ".c"):
            for file in entry.parent.glob(f"{module_name}{suffix}"):
                file.unlink(missing_ok=True)
    while True:
        if _age(entry) > STALE:
            entry.unlink(missing_ok=True)
        try:
            found = _found(module_name, object_names, cache_dir, timeout)
        except TimeoutError:
            if _age(entry) > 0.0:  # somebody may still be at it; it ends when done or stale
                continue
            raise
        if found[0] is None:
            _claimed.add(entry)
        if found[0] is None and not _told:
            _told.add("compiling")
            logger.info("compiling kernels (first run only)")
        return found


def compile_kernels(
    declaration: Any, objects: Any, names: Any, module: str, options: Any, cache: Any, *more: Any, **named: Any
) -> Any:
    """FFCx's own compilation; BackendError when the compiler fails."""
    try:
        return _compiled(declaration, objects, names, module, options, cache, *more, **named)
    except (VerificationError, OSError) as error:
        reason = " ".join(str(error).split())
        raise BackendError(f"kernels cannot be compiled: {reason}; `indent-sim doctor` says what is missing") from error


def _is_whole(library: Path) -> bool:
    """Whether an ELF library is as long as its header says: its table of sections comes last."""
    try:
        with library.open("rb") as file:
            head, size = file.read(64), file.seek(0, 2)
    except OSError:
        return True  # to be told of by who loads it
    if len(head) < 64:
        return False
    table, entry, entries = *struct.unpack_from("Q", head, 0x28), *struct.unpack_from("HH", head, 0x3A)
    return size >= table + entry * entries


@atexit.register
def _give_claims_back() -> None:
    for entry in _claimed:
        if _age(entry) > 0.0:
            entry.unlink(missing_ok=True)


def _age(entry: Path) -> float:
    """Seconds since anything of an unfinished entry changed; 0 for one that is finished or not there."""
    if entry.with_suffix(".c.cached").exists() or not entry.exists():
        return 0.0
    times = [file.stat().st_mtime for file in entry.parent.glob(f"{entry.stem}*")]
    return max(time.time() - max(times), 1e-3)
