"""PETSc's options of a run: the program's defaults, the user's `solver.petsc` over them, and whom to blame."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

from indent_sim.fe import compat
from indent_sim.process.errors import ConfigError

PREFIX = "indent_sim_"
DIRECT = ("lu", "cholesky")
FACTORISATION = {"ksp_type": "preonly", "pc_factor_mat_solver_type": "mumps"}


def install(user: Mapping[str, Any], *, symmetric: bool, line_search: str = "basic") -> None:
    """Put the options of one solver into PETSc's database, in place of those of the solver before.

    The factorisation's defaults are left out where the user's `pc_type` is none: they would clash with it.
    """
    database = PETSc.Options(PREFIX)
    for name in list(database.getAll()):
        database.delValue(name)
    kind = {"pc_type": "cholesky" if halves(user, symmetric) else "lu"}
    direct = user.get("pc_type", "lu") in DIRECT
    defaults = {"snes_linesearch_type": line_search} | (kind | FACTORISATION if direct else {})
    for name, value in (defaults | dict(user)).items():
        database.setValue(name, value)


def halves(user: Mapping[str, Any], symmetric: bool) -> bool:
    """Whether L D L^T takes the place of L U by default: half the work, but not every package has a pivoted one."""
    return symmetric and "pc_type" not in user and "pc_factor_mat_solver_type" not in user


def refuse_unused(user: Mapping[str, Any]) -> None:
    """ConfigError for an option that PETSc never asked for: a typing error, or no effect here."""
    for name in compat.unused_options(PREFIX, user):
        raise ConfigError(f"solver.petsc.{name}", "PETSc did not use this option", "check its name")


@contextmanager
def blamed(user: Mapping[str, Any]) -> Iterator[None]:
    """What PETSc refuses inside the block is the fault of the user's options, where there are any."""
    try:
        yield
    except PETSc.Error as error:
        if not user:
            raise
        given = ", ".join(
            f"{name}: {str(value).lower() if isinstance(value, bool) else value}" for name, value in user.items()
        )
        raise ConfigError("solver.petsc", f"PETSc cannot work with {{{given}}}", in_brief(error)) from error


def in_brief(error: PETSc.Error) -> str:
    """The last thing PETSc said, which names the reason, without its call stack and its links."""
    lines = [re.sub(r"^\[\d+\]\s*", "", line).strip() for line in str(error).splitlines()]
    said = [line for line in lines if line and not re.search(r"\(\) (line \d+ in|at) |^See https?:|^error code", line)]
    return f"PETSc says: {said[-1]}" if said else f"PETSc error code {error.ierr}"
