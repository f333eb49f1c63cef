"""PETSc's options of a run: those of the environment, PETSC_OPTIONS, stand over the program's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc


@contextmanager
def defaults(options: Mapping[str, Any], prefix: str = "") -> Iterator[None]:
    """Options that PETSc finds inside the block, where the environment says nothing of them;
    prefix: before each.
    """
    database = PETSc.Options(prefix)
    ours = [name for name in options if not database.hasName(name)]
    for name in ours:
        database.setValue(name, options[name])
    try:
        yield
    finally:
        for name in ours:
            database.delValue(name)
