"""Cache of compiled kernels: locks against other processes, and removal of incomplete entries.

FFCx claims an entry by creating its .c file and marks it complete by a .c.cached file. A process
that finds the first without the second waits ten seconds for another process and gives up. Here, a
process that compiles an entry holds a lock on a file beside it. Others wait as long as that takes,
and the operating system releases the lock when the process ends, however it does. An entry without
a lock, of another program, is abandoned if its files have not changed for some time.
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

# Time [s] after its last change at which an incomplete entry without a lock is abandoned; to
# compile an entry takes a few seconds
STALE_AFTER = 30.0
# Time [s] between two checks of an entry that another process compiles
POLLING_INTERVAL = 0.1
logger = logging.getLogger("indent_sim")
# Functions of FFCx that this module replaces, with their first parameters
EXPECTED_FFCX_FUNCTIONS = {
    "get_cached_module": ("module_name", "object_names", "cache_dir", "timeout"),
    "_compile_objects": ("decl", "ufl_objects", "object_names", "module_name"),
}
_ffcx_lookup: Callable[..., Any]
_ffcx_compile: Callable[..., Any]
_logged_messages: set[str] = set()
# Modules that this process has loaded; FFCx would list the whole cache at each look-up
_loaded_modules: dict[tuple[Any, ...], Any] = {}
# Entries that this process compiles, with their locks
_claimed_entries: dict[Path, int | None] = {}


def lock_ffcx_cache() -> bool:
    """Make FFCx use `find_cached_module` and `compile_kernels`; repeated calls have no effect.

    Both replace private functions of FFCx. If a version of FFCx does not have them, or has them
    with other parameters, a message is logged and FFCx is not changed.

    Returns
    -------
    bool
        Whether FFCx uses the functions of this module.
    """
    global _ffcx_lookup, _ffcx_compile
    if getattr(jit, "get_cached_module", None) is find_cached_module:
        return True
    if not all(
        _has_parameters(getattr(jit, name, None), parameters)
        for name, parameters in EXPECTED_FFCX_FUNCTIONS.items()
    ):
        _log_once(
            "this version of FFCx does not allow the kernel cache to be locked: runs that compile "
            "kernels at the same time may fail and have to be repeated"
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
    """Convert the error of dolfinx about a failed compilation into BackendError on every rank."""
    try:
        yield
    except RuntimeError as error:
        # The message by which dolfinx informs the other ranks of a failure on rank 0
        if "Failed just-in-time compilation" not in str(error):
            raise
        raise BackendError(str(error)) from error


def find_cached_module(module_name: str, object_names: Any, cache_dir: Any, timeout: int) -> Any:
    """Look up a compiled module, in place of FFCx's `get_cached_module`.

    Incomplete entries are looked up by one process at a time. An abandoned entry is removed and
    compiled again, and so is one whose library is truncated after a full disk or a power failure,
    because loading it would end the process.

    Parameters
    ----------
    module_name, object_names, cache_dir, timeout
        As in FFCx.

    Returns
    -------
    tuple
        Objects and module, or (None, None) if this process has to compile them.

    Raises
    ------
    BackendError
        If the cache cannot be written.
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
            f"cannot store compiled kernels in {entry.parent}: {error.strerror or error}"
        ) from error
    module = _ffcx_lookup(module_name, object_names, cache_dir, timeout)
    if module[0] is not None:
        _release_lock(lock)
        return module
    _claimed_entries[entry] = lock
    _log_once("compiling kernels (first run only)")
    return module


def _acquire_lock(entry: Path) -> int | None:
    """Wait for the lock of an entry; None if the file system has no locks."""
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
    """Wait until an entry without a lock is complete, removed or abandoned (STALE_AFTER)."""
    last_stats = _file_stats(entry)
    last_change = time.monotonic()
    while _is_unfinished(entry) and time.monotonic() < last_change + STALE_AFTER:
        _log_once(
            f"waiting for another program that compiles {entry}, until {STALE_AFTER:g} s after its "
            "last change"
        )
        time.sleep(POLLING_INTERVAL)
        if (now := _file_stats(entry)) != last_stats:
            last_stats = now
            last_change = time.monotonic()


def _file_stats(entry: Path) -> dict[str, tuple[int, int]]:
    """Size and modification time of every file of an entry."""
    with suppress(FileNotFoundError):
        files = ((file.name, file.stat()) for file in entry.parent.glob(f"{entry.stem}*"))
        return {name: (stats.st_size, stats.st_mtime_ns) for name, stats in files}
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
    """Compile kernels by FFCx, and release the lock of their entry.

    The parameters are those of FFCx's `_compile_objects`.

    Raises
    ------
    BackendError
        If the compiler fails.
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
    """Suppress the compiler's command lines in the root logger.

    Setuptools writes them there and lowers its level. A root logger without a handler would get one
    with the first line, and print everything on stderr from then on.
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
    """Return whether the level of a log record is above INFO."""
    return record.levelno > logging.INFO


def _is_complete(entry: Path) -> bool:
    """Return whether an entry is marked as complete and its library exists and is not truncated.

    The library of an entry that is not marked may still be being linked.
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
    """Return whether an ELF library is as long as its header requires."""
    try:
        with library.open("rb") as file:
            head = file.read(64)
            size = file.seek(0, 2)
    except OSError:
        return True  # loading it reports the error
    if len(head) < 64:
        return False
    table, entry, entries = (
        *struct.unpack_from("Q", head, 0x28),
        *struct.unpack_from("HH", head, 0x3A),
    )
    return size >= table + entry * entries


@atexit.register
def _release_claims() -> None:
    """Release the entries whose compilation failed or was interrupted."""
    while _claimed_entries:
        entry, lock = _claimed_entries.popitem()
        if _is_unfinished(entry):
            entry.unlink(missing_ok=True)
        _release_lock(lock)
