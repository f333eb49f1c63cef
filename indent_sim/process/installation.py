"""Installation of the program, and the command that installs a missing part of it."""

from __future__ import annotations

import json
import platform
import shutil
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

# Packages that solve a scene on a mesh. Scenes and fits by theory do not need them.
SOLVER_PACKAGES = ("mpi4py", "petsc4py", "ufl", "dolfinx", "gmsh")
CONDA_PACKAGES = "fenics-dolfinx=0.11 'petsc=*=real*' python-gmsh mpich"
# File that scripts/setup writes into its virtual environment.
SETUP_STAMP = "indent-sim.stamp"
# First versions of Python and of glibc for which the solver is on PyPI.
SOLVER_PYTHON = (3, 12)
SOLVER_GLIBC = (2, 34)


def installed_solver_packages() -> list[str]:
    """Return the installed ones of SOLVER_PACKAGES, without importing them."""
    return [name for name in SOLVER_PACKAGES if _is_installed(name)]


def is_made_by_setup() -> bool:
    """Return whether scripts/setup has made this environment from Debian's packages."""
    return (Path(sys.prefix) / SETUP_STAMP).exists()


def program_command() -> str:
    """Return the command that installs the packages without which no command works."""
    return "make setup" if is_made_by_setup() else f"pip install {_requirement()}"


def afm_command() -> str:
    """Return the command that installs the readers of AFM files."""
    return "make setup AFM=1" if is_made_by_setup() else f"pip install {_requirement('afm')}"


def solver_command() -> str:
    """Return the command that installs the solver of scenes on a mesh on this system."""
    if is_made_by_setup():
        return "make setup"
    if sys.platform == "win32":
        # The folder of the program has another name in this Linux, so that the package is named
        # instead.
        return "wsl --install, and in its Linux: pip install 'indent-sim[solver]'"
    if (Path(sys.prefix) / "conda-meta").is_dir():
        return f"conda install -c conda-forge {CONDA_PACKAGES}"
    if _has_solver_wheel():
        return f"pip install {_requirement('solver')}"
    return (
        f"conda create -n indent-sim -c conda-forge {CONDA_PACKAGES} pip && "
        f"conda run -n indent-sim pip install {_requirement()}"
    )


def compiler_command() -> str:
    """Return the command that installs a C compiler and the header files of Python and of C."""
    if (Path(sys.prefix) / "conda-meta").is_dir():
        return "conda install -c conda-forge c-compiler"
    if sys.platform == "darwin":
        return "xcode-select --install"
    if shutil.which("dnf"):
        return "dnf install gcc glibc-devel python3-devel (as root)"
    return "apt-get install gcc libc6-dev python3-dev (as root)"


def missing_solver_text() -> str:
    """Return a sentence for a scene that needs the solver, which is not installed."""
    return (
        "a scene on a mesh needs the solver, DOLFINx, which is not installed; this line installs "
        f"it: {solver_command()}"
    )


def _is_installed(name: str) -> bool:
    with suppress(ImportError, ValueError):
        return find_spec(name) is not None
    return False


def _has_solver_wheel() -> bool:
    """Return whether PyPI has the solver for this system and this Python."""
    library, version = platform.libc_ver()
    return (
        sys.platform == "linux"
        and platform.machine() == "x86_64"
        and sys.version_info >= SOLVER_PYTHON
        and library == "glibc"
        and tuple(int(part) for part in version.split(".")[:2]) >= SOLVER_GLIBC
    )


def _requirement(extra: str = "") -> str:
    """Return the argument of `pip install` for this program: its name, or the folder it is from."""
    bracket = f"[{extra}]" if extra else ""
    requirement = f"{_source_folder() or 'indent-sim'}{bracket}"
    # The shell of Windows knows no other quotation marks.
    quote = '"' if sys.platform == "win32" else "'"
    return f"{quote}{requirement}{quote}" if bracket or " " in requirement else requirement


def _source_folder() -> str:
    """Return the source folder from which pip installed the program; "" if it was downloaded."""
    from urllib.request import url2pathname

    try:
        record = distribution("indent-sim").read_text("direct_url.json")
    except PackageNotFoundError:
        return ""
    address = urlsplit(json.loads(record or "{}").get("url", ""))
    folder = url2pathname(unquote(address.path))
    return folder if address.scheme == "file" and Path(folder).is_dir() else ""
