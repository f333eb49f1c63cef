"""Cache of compiled kernels, in which one process compiles at a time.

FFCx creates a .c file when it begins to compile a kernel and a .c.cached file when it has finished.
A process that finds only the .c file waits ten seconds and fails, even if the compiling process was
killed. In this module a process compiles while it holds a file lock, which the operating system
releases even if the process is killed. A kernel that is incomplete while the lock is free was
abandoned and is compiled again.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
import ufl
from cffi import VerificationError
from dolfinx import fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from ufl.domain import extract_unique_domain

from indent_sim.fe import compat
from indent_sim.process.errors import BackendError
from indent_sim.process.file_locks import lock_file

LOCK = "lock"
logger = logging.getLogger("indent_sim")


def compile_form(form: ufl.Form) -> fem.Form:
    """Compile a form (collective)."""
    with _exclusive_cache(form.ufl_domain().ufl_cargo().comm):
        return fem.form(form, **compat.jit_options())


def compile_expression(expression: ufl.core.expr.Expr, points: np.ndarray) -> fem.Expression:
    """Compile an expression for points of the reference element (collective)."""
    with _exclusive_cache(extract_unique_domain(expression).ufl_cargo().comm):
        return fem.Expression(expression, points, **compat.jit_options())


def create_function_space(mesh: Mesh, element: compat.Element) -> fem.FunctionSpace:
    """Create the function space of an element, and compile its kernels (collective)."""
    with _exclusive_cache(mesh.comm):
        return compat.function_space(mesh, element)


@contextmanager
def _exclusive_cache(comm: MPI.Comm) -> Iterator[None]:
    """Context manager that keeps other processes from compiling kernels.

    Only rank 0 holds the lock, because dolfinx compiles on rank 0 before the other ranks look for
    the kernel.

    Raises
    ------
    BackendError
        If the kernel cannot be compiled or stored.
    """
    folder = compat.kernel_folder()
    try:
        if comm.rank > 0:
            yield
            return
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / LOCK, "w") as lock:
            _acquire(lock, folder)
            _remove_incomplete_kernels(folder)
            last_change = folder.stat().st_mtime_ns
            with _silence_compiler():
                yield
            if folder.stat().st_mtime_ns != last_change:
                _log_once("compiling kernels (first run only)")
    except (VerificationError, RuntimeError) as error:
        # dolfinx raises RuntimeError if rank 0 has failed.
        if isinstance(error, RuntimeError) and "Failed just-in-time" not in str(error):
            raise
        raise BackendError(
            f"kernels cannot be compiled: {' '.join(str(error).split())}; `indent-sim doctor` "
            "lists what is missing"
        ) from error
    except ImportError as error:
        raise BackendError(
            f"a compiled kernel cannot be loaded ({error}); delete the folder {folder}"
        ) from error
    except OSError as error:
        raise BackendError(
            f"cannot store compiled kernels in {folder}: {error.strerror or error}"
        ) from error


def _acquire(lock: IO[Any], folder: Path) -> None:
    """Acquire the file lock; if the file system has no locks, continue without a lock."""
    try:
        lock_file(lock.fileno())
    except BlockingIOError:
        _log_once(f"waiting for another process that compiles kernels in {folder}")
        lock_file(lock.fileno(), wait=True)


def _remove_incomplete_kernels(folder: Path) -> None:
    """Remove kernels whose compilation was interrupted, so that FFCx compiles them again."""
    names = set(os.listdir(folder))
    for name in names:
        if name.endswith(".c") and f"{name}.cached" not in names:
            (folder / name).unlink(missing_ok=True)


@contextmanager
def _silence_compiler() -> Iterator[None]:
    """Suppress the command lines that setuptools logs with level INFO."""
    previous_level = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(previous_level)


@cache
def _log_once(message: str) -> None:
    logger.info(message)
