"""Copies of material laws, tips and contact laws with UFL constants in place of numbers."""

from __future__ import annotations

import dataclasses
from typing import Any

from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh


def symbolic_copy(item: Any, mesh: dolfinx_mesh.Mesh) -> Any:
    """Copy a dataclass with every float replaced by a `fem.Constant`, also in nested fields.

    A changed value then needs no new compiled kernel. Integers are kept, because the formula
    depends on them (e.g. the number of faces of a pyramid).
    """

    def symbolic_value(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(symbolic_value, value))
        if dataclasses.is_dataclass(value):
            return symbolic_copy(value, mesh)
        return fem.Constant(mesh, value) if isinstance(value, float) else value

    return dataclasses.replace(
        item, **{f.name: symbolic_value(getattr(item, f.name)) for f in dataclasses.fields(item)}
    )
