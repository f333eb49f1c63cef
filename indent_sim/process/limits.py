"""Resource limits of a process: memory, open files, threads and space for temporary files.

If a limit is too low, MPI, gmsh and PETSc abort or hang without a message. Therefore a run checks
the limits before it loads them. If resources are exhausted later, the exception is converted to an
expected failure.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from indent_sim.process.errors import BackendError, IndentSimError, NotConverged, UsageError
from indent_sim.process.operating_system import lower_limit, soft_limit
from indent_sim.process.usage import address_space

DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


def require_resources() -> None:
    """Check that the limits of this process allow a run.

    Raises
    ------
    BackendError
        If a limit is too low even for the smallest run.
    NotConverged
        If the disk of the temporary files is full.
    UsageError
        If the working directory has been removed.
    """
    try:
        os.getcwd()
    except OSError as error:
        raise UsageError(
            "the working directory no longer exists", "change to an existing folder"
        ) from error
    # A small run was observed to have up to 32 files open at a time.
    min_open_files = 48
    # Open MPI and the linear algebra were observed to start 15 processes and threads.
    min_tasks = 20
    # The libraries alone were observed to use 700 MB of address space [bytes].
    min_address_space = 800e6
    _require_limit("open files", "ulimit -n", "NOFILE", min_open_files)
    _require_limit("MB of memory", "ulimit -v", "AS", min_address_space / 1e6, 1e6)
    _require_limit("processes and threads", "ulimit -u", "NPROC", min_tasks)
    folder = Path(os.environ.get("TMPDIR") or "/tmp")
    if not folder.is_dir():
        return  # The libraries create a missing folder, or use another one.
    # This module is imported here because commands without a run do not need it.
    import tempfile

    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            # Open MPI writes the files of its session into this folder; 1 MB suffices for them.
            file.write(bytes(2**20))
            file.flush()
    except OSError as error:
        kind = NotConverged if error.errno in DISK_FULL_ERRORS else BackendError
        raise kind(
            f"cannot write temporary files in {folder}: {error.strerror}; set TMPDIR to another "
            "folder"
        ) from error


def _require_limit(
    resource_name: str, command: str, limit: str, required: float, unit: float = 1.0
) -> None:
    """Raise BackendError if a limit is below `required`; the shell `command` raises the limit."""
    allowed = soft_limit(limit) / unit
    if allowed < required:
        raise BackendError(
            f"only {allowed:.0f} {resource_name} are allowed ({command}); a run needs at "
            f"least {required:.0f}"
        )


def limit_resources(seconds: float, memory: float) -> None:
    """Limit the CPU time and the memory of this process, where the system supports it.

    When the time is used up, SIGXCPU ends the process. When the memory is used up, MemoryError is
    raised or a library aborts the process. Windows limits neither, macOS only the time.

    Parameters
    ----------
    seconds
        Total CPU time [s].
    memory
        Memory in addition to the memory already in use [bytes].
    """
    lower_limit("CPU", math.ceil(seconds))
    if used := address_space():
        lower_limit("AS", int(used + memory))


def write_error(target: object, error: OSError) -> IndentSimError:
    """Return the error to raise if a file or folder cannot be written.

    The error is NotConverged if the disk is full, otherwise UsageError. `target` is the path or a
    description of the file.
    """
    kind = NotConverged if error.errno in DISK_FULL_ERRORS else UsageError
    return kind(f"cannot write {target}: {error.strerror or error}")


@contextmanager
def translate_resource_errors() -> Iterator[None]:
    """Context manager that converts errors of exhausted resources to expected failures.

    Resources are memory, open files and disk space. An error of PETSc is also converted if
    PETSC_OPTIONS of the environment may be its cause.
    """
    try:
        yield
    except (MemoryError, OSError, RuntimeError) as error:
        if (resource_error := _resource_error(error)) is None:
            raise
        raise resource_error from error


def _resource_error(error: BaseException) -> IndentSimError | None:
    """Return the expected failure that replaces an exception; None for other exceptions."""
    # Parts of the messages of petsc4py if PETSc or MUMPS has too little memory.
    out_of_memory_signs = ("error code 55\n", "PetscMalloc", "INFOG(1)=-13")
    is_memory = isinstance(error, MemoryError) or any(
        sign in str(error) for sign in out_of_memory_signs
    )
    number = errno.ENOMEM if is_memory else getattr(error, "errno", None)
    place = f" {name}" if (name := getattr(error, "filename", None)) else ""
    match number:
        case errno.ENOMEM:
            return NotConverged(
                "the memory available to this process is exhausted; use a coarser mesh"
            )
        case errno.EMFILE | errno.ENFILE:
            return BackendError(f"too many open files{place} (ulimit -n)")
        case errno.ENOSPC | errno.EDQUOT:
            return NotConverged(f"cannot write{place}: {os.strerror(number)}")
    options = os.environ.get("PETSC_OPTIONS")
    # Without options from the environment, an error of PETSc is a bug of this program.
    if options and "PETSc" in type(error).__module__ + str(error):
        reason = str(error).strip().splitlines()[-1].removeprefix("[0] ")
        return BackendError(
            f"PETSc stopped with PETSC_OPTIONS={options!r} in the environment: {reason}; try "
            "without these options"
        )
    return None
