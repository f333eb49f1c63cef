"""The health of an installation: which parts are there, in which version, and whether they can be
used.
"""

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NEEDED_PACKAGES: tuple[str, ...] = (
    "numpy",
    "scipy",
    "pydantic",
    "yaml",
    "click",
    "rich",
    "h5py",
    "mpi4py",
    "petsc4py",
)
NEEDED_PACKAGES += ("ufl", "dolfinx", "gmsh")
MISSED = {"matplotlib": "pictures", "pint": "quantities with units in scenes", "jinja2": "reports"}
OPTIONAL = {name: f"no {lost} without it" for name, lost in MISSED.items()}
BLAS = {
    "openblas": "OpenBLAS",
    "mkl": "MKL",
    "blis": "BLIS",
    "atlas": "ATLAS",
    "accelerate": "Accelerate",
}


@dataclass(frozen=True)
class Check:
    """One finding: what was looked at, what was found, and a verdict: good | warning | broken."""

    name: str
    found: str
    verdict: str = "good"
    remedy: str = ""

    def __str__(self) -> str:
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.verdict:8} {self.name:12} {self.found}{remedy}"


def examine() -> list[Check]:
    """Look at everything a run needs, in the surroundings of a run."""
    surroundings = [_working_directory(), _guarded("JIT cache", _cache)]
    packages = [*map(_package, NEEDED_PACKAGES), *map(_package, OPTIONAL, OPTIONAL.values())]
    others: dict[str, Callable[[], Check]] = {
        "MPI": _mpi,
        "MUMPS": _mumps,
        "BLAS": _blas,
        "C compiler": _compiler,
    }
    return [_python(), *packages, *map(_guarded, others, others.values()), *surroundings]


def _working_directory() -> Check:
    """Where this process stands; libraries that cannot find it out would all look broken."""
    try:
        return Check("directory", os.getcwd())
    except OSError:
        os.chdir("/")
        return Check("directory", "it is gone", "broken", "change to a folder that is there")


def _python() -> Check:
    found = f"{platform.python_version()} at {sys.executable}"
    enough = sys.version_info >= (3, 11)
    return (
        Check("python", found)
        if enough
        else Check("python", found, "broken", "3.11 or later is needed")
    )


def _package(name: str, remedy: str | None = None) -> Check:
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        module: Any = importlib.import_module(name)
    except Exception as error:  # gmsh fails with OSError, petsc4py with its own
        verdict, remedy = ("broken", "run `make setup`") if remedy is None else ("warning", remedy)
        return Check(name, f"{type(error).__name__}: {error}".splitlines()[0], verdict, remedy)
    finally:
        signal.signal(signal.SIGINT, interrupt)  # importing gmsh takes it away
    return Check(name, f"{_version(name, module)} at {Path(module.__file__ or '?').parent}")


def _version(name: str, module: Any) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version({"ufl": "fenics-ufl"}.get(name, name))
    except PackageNotFoundError:
        return getattr(module, "__version__", "unknown version")


def _guarded(name: str, look: Callable[[], Check]) -> Check:
    try:
        return look()
    except Exception as error:
        return Check(name, f"{type(error).__name__}: {error}".splitlines()[0], "broken")


def _mpi() -> Check:
    MPI = importlib.import_module("mpi4py.MPI")
    return Check("MPI", re.split(r"[,\n]", MPI.Get_library_version())[0].strip())


def _mumps() -> Check:
    PETSc = importlib.import_module("petsc4py.PETSc")
    version = ".".join(map(str, PETSc.Sys.getVersion()))
    if PETSc.Sys.hasExternalPackage("mumps"):
        return Check("MUMPS", f"in PETSc {version}")
    return Check("MUMPS", f"not in PETSc {version}", "broken", "install a PETSc built with MUMPS")


def _blas() -> Check:
    """Which BLAS this process has loaded, read from its memory map."""
    importlib.import_module("numpy").dot([1.0], [1.0])
    maps = Path("/proc/self/maps")
    lines = maps.read_text().splitlines() if maps.exists() else []
    libraries = {line.split()[-1] for line in lines if ".so" in line}
    loaded = [
        str(Path(path).resolve()).lower()
        for path in libraries
        if re.search("blas|mkl|blis|atlas", path)
    ]
    names = {nice for word, nice in BLAS.items() if any(word in path for path in loaded)}
    threads = os.environ.get("OPENBLAS_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS") or "all"
    if names:
        return Check("BLAS", f"{', '.join(sorted(names))}, {threads} thread(s) per rank")
    if loaded:
        return Check(
            "BLAS",
            "reference BLAS",
            "warning",
            "3 to 10 times slower: install libopenblas0-pthread",
        )
    return Check("BLAS", "unknown", "warning")


def _compiler() -> Check:
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    found = shutil.which(command)
    return (
        Check("C compiler", found)
        if found
        else Check("C compiler", f"no {command}", "broken", "install gcc")
    )


def _cache() -> Check:
    from indent_sim.run.single_run import kernel_folder

    folder = kernel_folder()
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        with tempfile.TemporaryFile(dir=existing):
            return Check("JIT cache", str(folder))
    except OSError as error:
        return Check(
            "JIT cache",
            f"{folder}: {error.strerror}",
            "broken",
            "name a writable folder as its cache_dir",
        )
