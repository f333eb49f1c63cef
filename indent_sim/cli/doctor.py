"""Checks of the installation: its parts, their versions, and whether they work."""

from __future__ import annotations

import importlib
import os
import platform
import re
import shlex
import shutil
import signal
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indent_sim.process.installation import (
    SOLVER_PACKAGES,
    compiler_command,
    installed_solver_packages,
    is_made_by_setup,
    program_command,
    solver_command,
)

# Packages without which no command works.
NEEDED_PACKAGES: tuple[str, ...] = ("numpy", "scipy", "pydantic", "yaml", "click", "rich")
# Features by the optional package that they need.
OPTIONAL_FEATURES = {
    "matplotlib": "pictures",
    "pint": "quantities with units in scenes",
    "jinja2": "reports",
    "h5py": "fields, checkpoints, and fits of maps",
}
# Modules by which a run imports a package, if their name differs from that of the package.
IMPORTED_MODULES = {"gmsh": "indent_sim.mesh.loaded_gmsh"}


@dataclass(frozen=True)
class HealthCheck:
    """Result of one check: name, finding, and verdict "good", "warning" or "broken"."""

    name: str
    found: str
    verdict: str = "good"
    remedy: str = ""

    def __str__(self) -> str:
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.verdict:8} {self.name:12} {self.found}{remedy}"


def check_installation() -> list[HealthCheck]:
    """Check all parts of the installation that a run needs."""
    working_directory = _check_working_directory()
    optional = [
        _check_package(name, "warning", f"no {feature} without it: {program_command()}")
        for name, feature in OPTIONAL_FEATURES.items()
    ]
    return [
        _check_python(),
        *(_check_package(name, "broken", program_command()) for name in NEEDED_PACKAGES),
        *optional,
        _run_check("BLAS", _check_blas),
        *_check_solver(),
        working_directory,
    ]


def _check_solver() -> list[HealthCheck]:
    """Check all parts of the solver of scenes on a mesh; one finding if it is not installed."""
    if not installed_solver_packages():
        return [
            HealthCheck(
                "solver",
                "not installed; theory, fits by theory and pictures work, scenes on a mesh do not",
                "broken" if is_made_by_setup() else "warning",
                f"this line installs it: {solver_command()}",
            )
        ]
    # The MPI library of PyPI is found only after this import; other installations do not have it.
    with suppress(ImportError):
        importlib.import_module("dolfinx_solver")
    library_checks: dict[str, Callable[[], HealthCheck]] = {
        "MPI": _check_mpi,
        "MUMPS": _check_mumps,
        "C compiler": _check_compiler,
        "Python.h": _check_header_files,
        "JIT cache": _check_kernel_cache,
    }
    return [
        *(_check_package(name, "broken", solver_command()) for name in SOLVER_PACKAGES),
        *map(_run_check, library_checks, library_checks.values()),
    ]


def _check_working_directory() -> HealthCheck:
    """Check that the working directory exists, which is needed for importing libraries."""
    try:
        return HealthCheck("directory", os.getcwd())
    except OSError:
        os.chdir("/")
        return HealthCheck(
            "directory", "the working directory was deleted", "broken", "change to another folder"
        )


def _check_python() -> HealthCheck:
    """Check the version of Python."""
    version_text = f"{platform.python_version()} at {sys.executable}"
    is_recent_enough = sys.version_info >= (3, 11)
    if is_recent_enough:
        return HealthCheck("python", version_text)
    return HealthCheck("python", version_text, "broken", "3.11 or later is needed")


def _check_package(name: str, verdict: str, remedy: str) -> HealthCheck:
    """Check that a package can be imported; verdict and remedy apply if it is missing."""
    interrupt_handler = signal.getsignal(signal.SIGINT)
    try:
        imported = importlib.import_module(IMPORTED_MODULES.get(name, name))
    except Exception as error:
        # A missing library is an OSError of gmsh and an exception of its own type of petsc4py.
        return HealthCheck(
            name, f"{type(error).__name__}: {error}".splitlines()[0], verdict, remedy
        )
    finally:
        # The import of gmsh replaces the handler.
        signal.signal(signal.SIGINT, interrupt_handler)
    module: Any = getattr(imported, name) if name in IMPORTED_MODULES else imported
    return HealthCheck(
        name, f"{_package_version(name, module)} at {Path(module.__file__ or '?').parent}"
    )


def _package_version(name: str, module: Any) -> str:
    """Return the version of an installed package."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version({"ufl": "fenics-ufl"}.get(name, name))
    except PackageNotFoundError:
        return getattr(module, "__version__", "unknown version")


def _run_check(name: str, check: Callable[[], HealthCheck]) -> HealthCheck:
    """Run one check; an exception means that this part of the installation is broken."""
    try:
        return check()
    except Exception as error:
        return HealthCheck(name, f"{type(error).__name__}: {error}".splitlines()[0], "broken")


def _check_mpi() -> HealthCheck:
    """Check that MPI can be loaded."""
    MPI = importlib.import_module("mpi4py.MPI")
    return HealthCheck("MPI", re.split(r"[,\n]", MPI.Get_library_version())[0].strip())


def _check_mumps() -> HealthCheck:
    """Check that PETSc has the direct solver MUMPS."""
    PETSc = importlib.import_module("petsc4py.PETSc")
    version = ".".join(map(str, PETSc.Sys.getVersion()))
    if PETSc.Sys.hasExternalPackage("mumps"):
        return HealthCheck("MUMPS", f"in PETSc {version}")
    return HealthCheck(
        "MUMPS", f"not in PETSc {version}", "broken", "install a PETSc built with MUMPS"
    )


def _check_blas() -> HealthCheck:
    """Check which BLAS this process has loaded, as shown by its memory map."""
    importlib.import_module("numpy").dot([1.0], [1.0])
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.exists() else []
    libraries = {line.split()[-1] for line in lines if ".so" in line}
    loaded = [
        str(Path(path).resolve()).lower()
        for path in libraries
        if re.search("blas|mkl|blis|atlas", path)
    ]
    # Names of BLAS libraries by a word of their file names.
    blas_names = {
        "openblas": "OpenBLAS",
        "mkl": "MKL",
        "blis": "BLIS",
        "atlas": "ATLAS",
        "accelerate": "Accelerate",
    }
    names = {name for word, name in blas_names.items() if any(word in path for path in loaded)}
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS") or "all"
    if names:
        return HealthCheck("BLAS", f"{', '.join(sorted(names))}, {threads} thread(s) per rank")
    if loaded:
        return HealthCheck(
            "BLAS",
            "reference BLAS",
            "warning",
            "runs are 3 to 10 times slower with this library; as root: apt-get install "
            "libopenblas0-pthread",
        )
    return HealthCheck("BLAS", "unknown", "warning")


def _check_compiler() -> HealthCheck:
    """Check that the C compiler, which compiles the kernels of the forms, is installed."""
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    compiler_path = shutil.which(command)
    if compiler_path:
        return HealthCheck("C compiler", compiler_path)
    return HealthCheck("C compiler", f"no {command}", "broken", compiler_command())


def _check_header_files() -> HealthCheck:
    """Check that the header files of Python are installed, which every kernel includes."""
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if header.exists():
        return HealthCheck("Python.h", str(header.parent))
    return HealthCheck("Python.h", f"not in {header.parent}", "broken", compiler_command())


def _check_kernel_cache() -> HealthCheck:
    """Check that compiled kernels can be written to their folder."""
    from indent_sim.run.single_run import kernel_folder

    folder = kernel_folder()
    existing_folder = next(parent for parent in (folder, *folder.parents) if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=existing_folder):
            return HealthCheck("JIT cache", str(folder))
    except OSError as error:
        return HealthCheck(
            "JIT cache",
            f"{folder}: {error.strerror}",
            "broken",
            "set cache_dir of dolfinx_jit_options.json to a writable folder",
        )
