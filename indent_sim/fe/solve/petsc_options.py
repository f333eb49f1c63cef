"""PETSc options of a run; PETSC_OPTIONS takes precedence over the program's defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc


@contextmanager
def default_options(options: Mapping[str, Any], prefix: str = "") -> Iterator[None]:
    """Context manager that sets PETSc options, except those that PETSC_OPTIONS sets.

    Parameters
    ----------
    options
        Option values by name.
    prefix
        Prefix of every option name.
    """
    database = PETSc.Options(prefix)
    added_names = [name for name in options if not database.hasName(name)]
    for name in added_names:
        database.setValue(name, options[name])
    try:
        yield
    finally:
        for name in added_names:
            database.delValue(name)
