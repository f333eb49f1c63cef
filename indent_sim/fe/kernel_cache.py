"""The cache of compiled kernels: say when it is filled, by whom, and clear what a killed run left
half-written in it.

FFCx claims an entry by creating its .c file and marks it done by a .c.cached file; who finds the
first without the second waits ten seconds for another process and gives up. Here who looks for an
unfinished entry holds a lock on a file beside it until it is compiled: the others wait as long as
that takes, and the kernel lets go of it when the process ends, however it does. An entry of a
program that knows no such lock is told by its age, on the clock of who waits.
"""

from __future__ import annotations

import atexit
import fcntl
import inspect
import logging
import os
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

from cffi import VerificationError
from ffcx.codegeneration import jit

from indent_sim.process.errors import BackendError

# s without a change in an unfinished entry that nobody has locked; compiling one takes a few
STALE_AFTER = 30.0
POLLING_INTERVAL = 0.1  # s between two looks at an entry that is waited for
logger = logging.getLogger("indent_sim")
EXPECTED_FFCX_FUNCTIONS = {
    "get_cached_module": ("module_name", "object_names", "cache_dir", "timeout"),
    "_compile_objects": ("decl", "ufl_objects", "object_names", "module_name"),
}  # of FFCx: parameters
_ffcx_lookup: Callable[..., Any]
_ffcx_compile: Callable[..., Any]
_logged_messages: set[str] = set()
_loaded_modules: dict[
    tuple[Any, ...], Any
] = {}  # what this process has found: to look again is to list the whole cache
_claimed_entries: dict[Path, int | None] = {}  # entries this process has begun, and their locks


def lock_ffcx_cache() -> bool:
    """Let FFCx go through `lookup` and `compile_kernels`; call before the first form, and more
    often at will. Both take the place of functions that FFCx does not promise to keep: where one
    is missing, or has other parameters, that is said and everything is left to FFCx (False).
    """
    global _ffcx_lookup, _ffcx_compile
    if getattr(jit, "get_cached_module", None) is find_cached_module:
        return True
    if not all(
        _has_parameters(getattr(jit, name, None), parameters)
        for name, parameters in EXPECTED_FFCX_FUNCTIONS.items()
    ):
        _log_once(
            "FFCx keeps kernels in another way than is known here: runs that compile at once "
            "may have to be repeated"
        )
        return False
    _ffcx_lookup, _ffcx_compile = (getattr(jit, name) for name in EXPECTED_FFCX_FUNCTIONS)
    jit.get_cached_module = find_cached_module
    jit._compile_objects = compile_kernels
    return True


def _has_parameters(function: Any, parameters: tuple[str, ...]) -> bool:
    return (
        callable(function)
        and tuple(inspect.signature(function).parameters)[: len(parameters)] == parameters
    )


@contextmanager
def translate_compiler_errors() -> Iterator[None]:
    """Turn what dolfinx makes of a compiler that fails on rank 0 into BackendError on every rank."""
    try:
        yield
    except RuntimeError as error:
        if "Failed just-in-time compilation" not in str(error):  # so dolfinx tells the other ranks
            raise
        raise BackendError(str(error)) from error


def find_cached_module(module_name: str, object_names: Any, cache_dir: Any, timeout: int) -> Any:
    """FFCx's own look-up, for unfinished entries by one process at a time, so that it need not wait
    for any. An entry that nobody works on is removed, and compiled anew, and so is one whose
    library a full disk or a power failure has cut off: to load it would end the process.
    """
    entry = Path(cache_dir) / f"{module_name}.c"
    key = entry, *object_names
    if key in _loaded_modules:
        return _loaded_modules[key]
    if _is_complete(entry):
        return _loaded_modules.setdefault(
            key, _ffcx_lookup(module_name, object_names, cache_dir, timeout)
        )
    _release_claims()
    try:
        was_locked = entry.with_suffix(".lock").exists()
        lock = _acquire_lock(entry)
        if lock is None or not was_locked:
            _wait_for_unlocked_entry(entry)
        if not _is_complete(entry):
            for name in (f"{entry.stem}{ending}" for ending in ("*so", ".c.cached", ".c")):
                for file in entry.parent.glob(name):
                    file.unlink(missing_ok=True)
    except OSError as error:
        raise BackendError(
            f"cannot keep kernels in {entry.parent}: {error.strerror or error}"
        ) from error
    module = _ffcx_lookup(module_name, object_names, cache_dir, timeout)
    if module[0] is not None:
        _release_lock(lock)
        return module
    _claimed_entries[entry] = lock
    _log_once("compiling kernels (first run only)")
    return module


def _acquire_lock(entry: Path) -> int | None:
    """The lock of an entry, waited for; None where the file system has no locks."""
    entry.parent.mkdir(parents=True, exist_ok=True)
    lock = os.open(entry.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o666)
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            _log_once(
                f"waiting for another process that compiles the same kernels in {entry.parent}"
            )
            time.sleep(POLLING_INTERVAL)
        except OSError:
            os.close(lock)
            return None


def _release_lock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _wait_for_unlocked_entry(entry: Path) -> None:
    """Wait until an entry without a lock is finished, gone, or has not changed for STALE seconds."""
    last_stats = _file_stats(entry)
    last_change = time.monotonic()
    while _is_unfinished(entry) and time.monotonic() < last_change + STALE_AFTER:
        _log_once(
            f"waiting for another program that compiles {entry}, or left it; for {STALE_AFTER:g} s "
            "after its last change"
        )
        time.sleep(POLLING_INTERVAL)
        if (now := _file_stats(entry)) != last_stats:
            last_stats = now
            last_change = time.monotonic()


def _file_stats(entry: Path) -> dict[str, tuple[int, int]]:
    """Size and date of every file of an entry; only whether they change is of interest."""
    with suppress(FileNotFoundError):
        files = ((file.name, file.stat()) for file in entry.parent.glob(f"{entry.stem}*"))
        return {name: (found.st_size, found.st_mtime_ns) for name, found in files}
    return {}


def _log_once(message: str) -> None:
    if message not in _logged_messages:
        _logged_messages.add(message)
        logger.info(message)


def compile_kernels(
    declaration: Any,
    objects: Any,
    names: Any,
    module: str,
    options: Any,
    cache: Any,
    *more: Any,
    **named: Any,
) -> Any:
    """FFCx's own compilation, after which others may have the entry; BackendError when the compiler
    fails.
    """
    try:
        with _silence_compiler_log():
            compiled = _ffcx_compile(
                declaration, objects, names, module, options, cache, *more, **named
            )
    except (VerificationError, OSError) as error:
        reason = " ".join(str(error).split())
        raise BackendError(
            f"kernels cannot be compiled: {reason}; `indent-sim doctor` says what is missing"
        ) from error
    _release_lock(_claimed_entries.pop(Path(cache) / f"{module}.c", None))
    return compiled


@contextmanager
def _silence_compiler_log() -> Iterator[None]:
    """Keep the command lines of the compiler out of the log of whoever calls.

    Setuptools writes them to the root logger, whose level it lowers. Without a handler the root
    logger gets one with the first line, which prints everything on stderr from then on.
    """
    root = logging.getLogger()
    level = root.level
    silent = logging.NullHandler()
    root.addHandler(silent)
    root.addFilter(_is_warning)
    try:
        yield
    finally:
        root.removeFilter(_is_warning)
        root.removeHandler(silent)
        root.setLevel(level)


def _is_warning(record: logging.LogRecord) -> bool:
    """Whether a log record is more than information."""
    return record.levelno > logging.INFO


def _is_complete(entry: Path) -> bool:
    """Whether an entry is finished, and its library there and not cut off; before that its linker
    may be at it.
    """
    if not entry.with_suffix(".c.cached").exists():
        return False
    libraries = [
        file for ending in EXTENSION_SUFFIXES if (file := entry.with_suffix(ending)).exists()
    ]
    return bool(libraries) and all(map(_has_full_length, libraries))


def _is_unfinished(entry: Path) -> bool:
    return entry.exists() and not entry.with_suffix(".c.cached").exists()


def _has_full_length(library: Path) -> bool:
    """Whether an ELF library is as long as its header says: its table of sections comes last."""
    try:
        with library.open("rb") as file:
            head = file.read(64)
            size = file.seek(0, 2)
    except OSError:
        return True  # to be told of by who loads it
    if len(head) < 64:
        return False
    table, entry, entries = (
        *struct.unpack_from("Q", head, 0x28),
        *struct.unpack_from("HH", head, 0x3A),
    )
    return size >= table + entry * entries


@atexit.register
def _release_claims() -> None:
    """Let others have the entries whose compilation failed or was interrupted."""
    while _claimed_entries:
        entry, lock = _claimed_entries.popitem()
        if _is_unfinished(entry):
            entry.unlink(missing_ok=True)
        _release_lock(lock)
