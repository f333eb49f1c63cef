"""PETSc options of a run: those of PETSC_OPTIONS take precedence over the program's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc


@contextmanager
def default_options(options: Mapping[str, Any], prefix: str = "") -> Iterator[None]:
    """Set PETSc options inside the block, unless the environment has set them.

    Parameters
    ----------
    options
        Values by their names.
    prefix
        Prefix of every name.
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
