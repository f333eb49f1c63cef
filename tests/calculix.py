"""Scenes of a cylinder that yields as decks of CalculiX, and the forces that it computes.

CalculiX (`ccx`, Dhondt) is a finite-element program that shares nothing with this one. With NLGEOM
its law `*PLASTIC` is von Mises plasticity with a multiplicative split and a compressible
neo-Hookean elastic part (Simo), in place of Hencky's: stresses differ by the order of the elastic
strains, yield_stress/E. Elements are axisymmetric quadrilaterals of eight nodes on a tensor grid.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians, sin
from pathlib import Path

import numpy as np

# CalculiX replaces an axisymmetric body by a wedge of 2 degrees with plane faces.
WEDGES = 2 * pi / sin(radians(2))


@dataclass(frozen=True)
class Metal:
    """Elastic constants, yield stress, and modulus of linear hardening [pressure]."""

    E: float
    nu: float
    yield_stress: float
    hardening: float

    @property
    def cards(self) -> str:
        """Cards of the material of the set BODY."""
        strain = 2.0
        stress = self.yield_stress + self.hardening * strain
        return (
            "*MATERIAL,NAME=METAL\n*ELASTIC\n"
            f"{self.E},{self.nu}\n*PLASTIC\n{self.yield_stress},0.\n{stress},{strain}\n"
            "*SOLID SECTION,ELSET=BODY,MATERIAL=METAL\n"
        )


class _Quadrilaterals:
    """Mesh of eight-node quadrilaterals on a grid of points with midpoints.

    Attributes
    ----------
    number : ndarray
        Number of the node at each point of the grid, 0 in the middle of elements.
    nodes, elements : str
        Data lines of the cards *NODE and *ELEMENT.
    """

    def __init__(self, r: np.ndarray, z: np.ndarray, node_offset: int, element_offset: int) -> None:
        """`r`, `z` are the coordinates of the grid; the second index grows counterclockwise."""
        i, j = np.indices(r.shape)
        is_node = (i % 2 == 0) | (j % 2 == 0)
        self.number = np.where(is_node, node_offset + np.cumsum(is_node).reshape(r.shape), 0)
        self.nodes = "".join(
            f"{number},{a:.12g},{b:.12g}\n"
            for number, a, b in zip(self.number[is_node], r[is_node], z[is_node], strict=True)
        )
        corners = [(i, j) for i in range(0, r.shape[0] - 1, 2) for j in range(0, r.shape[1] - 1, 2)]
        steps = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
        self.elements = "".join(
            f"{element_offset + k + 1},"
            + ",".join(str(self.number[i + di, j + dj]) for di, dj in steps)
            + "\n"
            for k, (i, j) in enumerate(corners)
        )
        self.rows = (r.shape[1] - 1) // 2
        self.columns = (r.shape[0] - 1) // 2


def _with_midpoints(ends: np.ndarray) -> np.ndarray:
    """Return the ends of elements with their midpoints between them."""
    return np.insert(ends, range(1, len(ends)), (ends[1:] + ends[:-1]) / 2)


def _node_set(name: str, numbers: np.ndarray) -> str:
    """Return the card of a set of nodes."""
    return f"*NSET,NSET={name}\n" + "".join(f"{k},\n" for k in numbers.ravel() if k)


def _step(increments: int, motion: str, reaction_set: str) -> str:
    """Return the cards of a load step in equal increments."""
    part = 1 / increments
    return (
        f"*STEP,NLGEOM,INC=1000\n*STATIC\n{part},1.,1e-6,{part}\n*BOUNDARY\n{motion}"
        f"*NODE PRINT,NSET={reaction_set},TOTALS=ONLY,FREQUENCY=1\nRF\n*END STEP\n"
    )


def plate_deck(metal: Metal, n: int, delta: float, increments: int, *, is_bonded: bool) -> str:
    """Return the deck of a cylinder of radius 1/2 and height 1 below a frictionless plate.

    Parameters
    ----------
    metal
        Material.
    n
        Number of elements in the radius.
    delta
        Depth of the plate [length].
    increments
        Number of load increments.
    is_bonded
        True if the base is bonded, False if it slides without friction.
    """
    r = _with_midpoints(np.linspace(0.0, 0.5, n + 1))
    z = _with_midpoints(np.linspace(-1.0, 0.0, 2 * n + 1))
    body = _Quadrilaterals(*np.meshgrid(r, z, indexing="ij"), 0, 0)
    return (
        f"*NODE,NSET=ALL\n{body.nodes}*ELEMENT,TYPE=CAX8,ELSET=BODY\n{body.elements}"
        + _node_set("AXIS", body.number[0])
        + _node_set("BASE", body.number[:, 0])
        + _node_set("TOP", body.number[:, -1])
        + metal.cards
        + f"*BOUNDARY\nAXIS,1,1\nBASE,{1 if is_bonded else 2},2\n"
        + _step(increments, f"TOP,2,2,{-delta}\n", "TOP")
    )


def sphere_deck(
    metal: Metal, h: float, delta: float, increments: int, size: float, stiffness: float
) -> str:
    """Return the deck of a sphere of radius 1 on a bonded cylinder.

    All nodes of the sphere are moved, so that it is rigid. Contact is by a penalty.

    Parameters
    ----------
    metal
        Material.
    h
        Element size up to the radius 0.3; it then grows by a quarter from element to element.
    delta
        Depth of the sphere [length].
    increments
        Number of load increments.
    size
        Radius and height of the cylinder [length].
    stiffness
        Contact pressure per penetration [pressure/length].
    """
    x = _graded(h, 0.3, size)
    r, depth = np.meshgrid(x, x[::-1], indexing="ij")
    body = _Quadrilaterals(r, -depth, 0, 0)
    tip_elements = round(0.4 / h * 1.5)
    angle, radius = np.meshgrid(
        np.arcsin(0.4) * np.linspace(0, 1, 2 * tip_elements + 1),
        np.array([1.0, 0.95, 0.9]),
        indexing="ij",
    )
    count = body.rows * body.columns
    tip = _Quadrilaterals(
        radius * np.sin(angle), 1 - radius * np.cos(angle), int(body.number.max()), count
    )
    top_faces = [(k + 1) * body.rows for k in range(body.columns)]
    tip_faces = [count + k + 1 for k in range(tip.columns * tip.rows)]
    return (
        f"*NODE,NSET=ALL\n{body.nodes}{tip.nodes}"
        f"*ELEMENT,TYPE=CAX8,ELSET=BODY\n{body.elements}"
        f"*ELEMENT,TYPE=CAX8,ELSET=TIP\n{tip.elements}"
        + _node_set("AXIS", body.number[0])
        + _node_set("BASE", body.number[:, 0])
        + _node_set("SPHERE", tip.number)
        + _surface("BODYTOP", top_faces, "S3")
        + _surface("TIPFACE", tip_faces, "S1")
        + metal.cards
        + f"*MATERIAL,NAME=TIP\n*ELASTIC\n{metal.E},0.3\n*SOLID SECTION,ELSET=TIP,MATERIAL=TIP\n"
        + "*SURFACE INTERACTION,NAME=HARD\n*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR\n"
        + f"{stiffness},1e-3\n*CONTACT PAIR,INTERACTION=HARD,TYPE=SURFACE TO SURFACE\n"
        + "BODYTOP,TIPFACE\n*BOUNDARY\nAXIS,1,1\nBASE,1,2\n"
        + _step(increments, f"SPHERE,1,1,0.\nSPHERE,2,2,{-delta}\n", "BASE")
    )


def _surface(name: str, elements: Sequence[int], face: str) -> str:
    """Return the card of a surface of elements."""
    return f"*SURFACE,NAME={name},TYPE=ELEMENT\n" + "".join(f"{k},{face}\n" for k in elements)


def _graded(h: float, fine: float, length: float) -> np.ndarray:
    """Return grid lines with midpoints: of the distance h up to `fine`, then growing."""
    fine_part = np.linspace(0.0, fine, round(fine / h) + 1)
    lengths = [1.25 * h]
    while sum(lengths) < length - fine:
        lengths.append(1.25 * lengths[-1])
    coarse_part = np.cumsum(lengths) * (length - fine) / sum(lengths)
    return _with_midpoints(np.concatenate([fine_part, fine + coarse_part]))


def solve(folder: Path, deck: str) -> np.ndarray:
    """Return the force of every increment [force], which CalculiX computes in a folder."""
    (folder / "deck.inp").write_text(deck, encoding="ascii")
    done = subprocess.run(
        ["ccx", "deck"],
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=1800,
    )
    lines = (folder / "deck.dat").read_text(encoding="ascii").splitlines()
    totals = [
        (float(line.split()[-1]), lines[k + 2].split())
        for k, line in enumerate(lines)
        if "total force" in line
    ]
    if not totals or abs(totals[-1][0] - 1) > 1e-6:
        raise RuntimeError(f"CalculiX did not reach the end of the load:\n{done.stdout[-2000:]}")
    return np.array([abs(float(force[1])) * WEDGES for _, force in totals])
