"""Small bodies as mesh files written by meshio: triangles of sections, tetrahedra of boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np

SIX = [
    (0, 1, 3, 7),
    (0, 1, 7, 5),
    (0, 5, 7, 4),
    (0, 3, 2, 7),
    (0, 2, 6, 7),
    (0, 6, 4, 7),
]  # of a cube, around 0-7


def section(width: float = 2.0, height: float = 1.0, n: int = 8, m: int = 4) -> dict[str, Any]:
    """The triangles of a rectangle, and its named sides.

    Its top is at z = 0 and its left side on the axis.
    """
    x, z = np.linspace(0, width, n + 1), np.linspace(-height, 0, m + 1)
    points = np.array([(a, b, 0.0) for b in z for a in x])
    index = np.arange((n + 1) * (m + 1)).reshape(m + 1, n + 1)
    a, b, c, d = (
        index[:-1, :-1].ravel(),
        index[:-1, 1:].ravel(),
        index[1:, 1:].ravel(),
        index[1:, :-1].ravel(),
    )
    cells = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    sides = {"top": index[-1], "bottom": index[0], "wall": index[:, -1]}
    facets = {name: np.column_stack([row[:-1], row[1:]]) for name, row in sides.items()}
    return {
        "points": points,
        "cells": cells,
        "facets": facets,
        "regions": {"gel": np.arange(len(cells))},
    }


def block(size: float = 2.0, height: float = 1.0, n: int = 4, m: int = 3) -> dict[str, Any]:
    """Tetrahedra of a box about the axis x = y = 0 with its top at z = 0, and its named faces."""
    x, z = np.linspace(-size / 2, size / 2, n + 1), np.linspace(-height, 0, m + 1)
    points = np.array([(a, b, c) for c in z for b in x for a in x])
    index = np.arange(len(points)).reshape(m + 1, n + 1, n + 1)
    corners = [
        index[k : m + k, j : n + j, i : n + i].ravel()
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    cells = np.concatenate(
        [np.column_stack([corners[c] for c in tetrahedron]) for tetrahedron in SIX]
    )
    outer = np.concatenate([np.delete(cells, k, axis=1) for k in range(4)])
    ends = {
        "top": (2, 0.0),
        "bottom": (2, -height),
        "wall": (0, size / 2),
        "far_wall": (1, size / 2),
    }
    on = {
        name: (np.abs(points[:, axis] - at) < 1e-12)[outer].all(axis=1)
        for name, (axis, at) in ends.items()
    }
    return {
        "points": points,
        "cells": cells,
        "facets": {name: outer[rows] for name, rows in on.items()},
        "regions": {"gel": np.arange(len(cells))},
    }


def write(path: Path, body: dict[str, Any], **options: Any) -> Path:
    """Write a body into a file of any kind.

    .msh gets physical groups, .inp sets, and other kinds numbers named `part`.
    """
    dim = body["cells"].shape[1] - 1
    facet, cell = {2: ("line", "triangle"), 3: ("triangle", "tetra")}[dim]
    tags = {name: k + 1 for k, name in enumerate([*body["facets"], *body["regions"]])}
    number = np.zeros(len(body["cells"]), dtype=np.int32)
    for name, cells in body["regions"].items():
        number[cells] = tags[name]
    blocks = [(facet, facets) for facets in body["facets"].values()] + [(cell, body["cells"])]
    numbers = [
        np.full(len(rows), tags[name], dtype=np.int32) for name, rows in body["facets"].items()
    ] + [number]
    fields = {
        name: np.array([tag, dim if name in body["regions"] else dim - 1])
        for name, tag in tags.items()
    }
    if path.suffix == ".msh":
        data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        mesh = meshio.Mesh(body["points"], blocks, cell_data=data, field_data=fields)
        mesh.write(path, file_format="gmsh22", **options)
    elif path.suffix == ".inp":
        sets = {
            name: [np.flatnonzero(found == tag) for found in numbers] for name, tag in tags.items()
        }
        meshio.Mesh(body["points"], blocks, cell_sets=sets).write(path)
    else:
        merged = {}
        for (kind, rows), found in zip(blocks, numbers, strict=True):
            merged.setdefault(kind, []).append((rows, found))
        joined = [
            (kind, np.concatenate([rows for rows, _ in parts])) for kind, parts in merged.items()
        ]
        part = [np.concatenate([found for _, found in parts]) for parts in merged.values()]
        meshio.Mesh(body["points"], joined, cell_data={"part": part}).write(path, **options)
    return path
