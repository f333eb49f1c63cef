"""A cap or ball with skins under a tip, by finite elements of high degree on curved cells.

The cap stands on z = -H. About the center of its ball, at the distance e = R - H below the base,
its surface is the sphere of radius R. Columns of cells are at equal shares s of the angle from the
axis to the base. Rows are at radii that are graded towards the surface and end at the skins' faces;
below the last sphere, cells converge to the middle of the base, which is at rest. Columns are
graded towards the edge of the contact, where a row of nodes stands, and that of the base. Within
the contact u_z is given; elsewhere on the surface, and along it, there is no traction: traction and
gap are vertical, as with `gap: reference`. The force on the edge's node is 0, which fixes the
depth. As the force is stationary there, it is known better than the depth.

A ball (of height 2 R) has its cells about its center instead; `fixed` is the lower half of its
surface.

Displacements are of degree p on Gauss-Lobatto points, the cells isoparametric, integrals by p + 2
Gauss points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre
from scipy.sparse.linalg import splu

Layer = tuple[float, tuple[float, float]]  # thickness (any of the core), (E, nu)
Nucleus = tuple[
    tuple[float, float], tuple[float, float]
]  # semi-axes across and along the axis, (E, nu)
GRADED = 0.2  # of one cell to the next towards an edge
FINEST = 4  # such cells towards the contact's edge
DEGREE = 7


@dataclass(frozen=True)
class Contact:
    """Way of the tip, force and radius of a contact."""

    delta: float
    force: float
    a: float


def contact(
    a: float,
    R: float,
    height: float,
    layers: Sequence[Layer],
    tip: Callable[[np.ndarray], np.ndarray],
    base: str = "fixed",
    degree: int = DEGREE,
    nucleus: Nucleus | None = None,
) -> Contact:
    """The contact of radius a on a cap of a ball of radius R, or on the ball.

    `layers` are thickness and (E, nu) from the surface inwards, the core last; `tip` is its height
    over the distance from the axis; the nucleus is in the middle of a ball, or of the base of half
    a ball.
    """
    cells = _Cells(a, R, height, [thickness for thickness, _ in layers[:-1]], degree, nucleus)
    K = cells.stiffness([matter for _, matter in layers] + ([nucleus[1]] if nucleus else []))
    x, z = cells.nodes.T
    on_base, on_axis = cells.base, np.isclose(x, 0, atol=1e-9 * R)
    touched = cells.surface[cells.surface_s <= cells.s_edge * (1 + 1e-12)]
    edge = cells.surface[np.argmin(np.abs(cells.surface_s - cells.s_edge))]
    held = np.zeros((len(x), 2), dtype=bool)
    held[on_axis, 0] = held[on_base, 1] = True
    if base == "fixed":
        held[on_base, 0] = True
    held[touched, 1] = held[cells.unused] = True
    given = np.zeros((2, len(x), 2))
    given[0, touched, 1], given[1, touched, 1] = -1.0, tip(x[touched]) - z[touched]
    free, values = ~held.ravel(), given.reshape(2, -1).T
    moved = values.copy()
    moved[free] = splu(K[free][:, free].tocsc()).solve(-(K[free][:, ~free] @ values[~free]))
    unit, shape = (
        -(K @ moved).reshape(len(x), 2, 2)[touched, 1].T
    )  # forces down on the contact's nodes
    at_edge = np.flatnonzero(touched == edge)[0]
    delta = -shape[at_edge] / unit[at_edge]
    nodal = delta * unit + shape
    return Contact(float(delta), float(nodal.sum()), a)


class _Cells:
    """Nodes and cells between the surface and the middle of the base."""

    def __init__(
        self,
        a: float,
        R: float,
        height: float,
        thicknesses: Sequence[float],
        degree: int,
        nucleus: Nucleus | None,
    ):
        self.degree, e, is_ball = degree, R - height, height == 2 * R
        widest = np.pi if is_ball else np.arccos(e / R)
        self.s_edge = float(np.arcsin(a / R) / widest)
        end = 0.5 if is_ball else 1.0  # where what is held begins
        columns = _graded(0.0, self.s_edge, FINEST, at_end=True)
        columns += _graded(self.s_edge, min(2 * self.s_edge, end), FINEST, at_start=True)[1:]
        if columns[-1] < end:
            columns += _filled(columns[-1], end, columns[-1] / 2)[1:]
        if is_ball:
            columns += _graded(end, 1.0, FINEST, at_start=True)[1:]
        faces = np.cumsum(thicknesses)
        room = R if is_ball else R - abs(e)
        deepest = max([*faces, min(2 * a, 0.7 * room)])
        assert deepest < room, "a skin is too thick for these cells"
        scales = [a * GRADED**k for k in range(FINEST)]
        depths = sorted({0.0, *faces, deepest, *(d for d in (2 * a, *scales) if d < deepest)})
        depths = [
            d
            for d, after in zip(depths, [*depths[1:], np.inf], strict=True)
            if after - d > 0.02 * after or d in faces
        ]
        self.row_layer = [
            int(np.searchsorted(faces, d + 1e-12 * R, side="right")) for d in depths[:-1]
        ]
        below = [0.0, 0.35, 1.0]  # shares of the way from the middle of the base to the last sphere
        xi = _lobatto(degree)
        s = _points(columns, xi)
        down = _points(depths, xi)
        rho, share = R - down[:, None], s[None, :]
        theta = share * (np.pi if is_ball else np.arccos(e / rho))
        upper = np.stack([rho * np.sin(theta), rho * np.cos(theta) - R], axis=-1)
        eta = _points(below[::-1], xi)[1:]
        middle = np.array([0.0, -R if is_ball else -height])
        around, ring, matter = [], upper[-1], len(thicknesses)
        if nucleus:
            (across, along), way = (
                nucleus[0],
                (ring - middle) / np.linalg.norm(ring - middle, axis=1)[:, None],
            )
            face = middle + way / np.hypot(way[:, :1] / across, way[:, 1:] / along)
            shares = _points([0.0, 0.5, 1.0], xi)[1:, None, None]
            around, ring, matter = [(1 - shares) * ring + shares * face], face, matter + 1
            self.row_layer += [len(thicknesses)] * 2
        lower = middle + eta[:, None, None] * (ring - middle)
        grid = np.concatenate([upper, *around, lower])
        self.row_layer += [matter] * (len(below) - 1)
        self.shape = grid.shape[:2]
        self.nodes = grid.reshape(-1, 2)
        self.nodes[np.abs(self.nodes[:, 0]) < 1e-12 * R, 0] = 0.0
        self.surface, self.surface_s = np.arange(self.shape[1]), s
        self.numbers = np.arange(len(self.nodes)).reshape(self.shape)
        self.unused = self.numbers[-1, 1:].copy()  # all in the middle, which is one node
        self.numbers[-1] = self.numbers[-1, 0]
        below_all = np.isclose(self.nodes[:, 1], -height, atol=1e-9 * R)
        self.base = self.surface[s >= 0.5 * (1 - 1e-12)] if is_ball else np.flatnonzero(below_all)
        self.n_columns = len(columns) - 1

    def stiffness(self, matters: Sequence[tuple[float, float]]) -> sp.csr_matrix:
        """Stiffness of all displacements, integrated over the whole circle.

        They are u_r and u_z, node by node.
        """
        p = self.degree
        at, weights = legendre.leggauss(p + 2)
        N, D = _lagrange(_lobatto(p), at)
        value = np.einsum("ai,bj->abij", N, N).reshape(len(at) ** 2, -1)
        slope = np.stack([np.einsum("ai,bj->abij", D, N), np.einsum("ai,bj->abij", N, D)]).reshape(
            2, len(at) ** 2, -1
        )
        w = np.outer(weights, weights).ravel()
        rows, columns, entries = [], [], []
        for row, layer in enumerate(self.row_layer):
            C = _stiffness(*matters[layer])
            for column in range(self.n_columns):
                mine = self.numbers[
                    row * p : (row + 1) * p + 1, column * p : (column + 1) * p + 1
                ].ravel()
                X = self.nodes[mine]
                J = np.einsum("kqi,id->qkd", slope, X)
                G = np.einsum("qdk,kqi->qdi", np.linalg.inv(J), slope)
                r = value @ X[:, 0]
                B = np.zeros((len(w), 4, len(mine), 2))
                B[:, 0, :, 0], B[:, 1, :, 1] = G[:, 0], G[:, 1]
                B[:, 2, :, 0] = value / r[:, None]
                B[:, 3, :, 0], B[:, 3, :, 1] = G[:, 1], G[:, 0]
                B = B.reshape(len(w), 4, -1)
                scale = 2 * np.pi * r * w * np.abs(np.linalg.det(J))
                CB = np.einsum("ce,qej->qcj", C, B) * scale[:, None, None]
                entries.append(np.tensordot(B, CB, axes=([0, 1], [0, 1])).ravel())
                dofs = (2 * mine[:, None] + [0, 1]).ravel()
                rows.append(np.repeat(dofs, len(dofs)))
                columns.append(np.tile(dofs, len(dofs)))
        size = 2 * len(self.nodes)
        found = (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns)))
        return sp.coo_matrix(found, shape=(size, size)).tocsr()


def _stiffness(E: float, nu: float) -> np.ndarray:
    """Elasticity matrix for (e_rr, e_zz, e_tt, 2 e_rz)."""
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    C = np.diag([2 * mu, 2 * mu, 2 * mu, mu])
    C[:3, :3] += lam
    return C


def _lobatto(p: int) -> np.ndarray:
    """The p + 1 Gauss-Lobatto points on -1..1."""
    inner = legendre.Legendre.basis(p).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def _lagrange(nodes: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes (points, nodes) of the polynomials that are 1 at one node."""
    V = np.linalg.inv(legendre.legvander(nodes, len(nodes) - 1))
    slopes = np.stack([legendre.Legendre.basis(k).deriv()(at) for k in range(len(nodes))], axis=1)
    return legendre.legvander(at, len(nodes) - 1) @ V, slopes @ V


def _graded(
    start: float, end: float, count: int, at_start: bool = False, at_end: bool = False
) -> list[float]:
    """Ends of cells from start to end that shrink by the factor GRADED towards one end."""
    shares = [0.0, *(GRADED**k for k in range(count, -1, -1))]
    if at_start:
        return [start + (end - start) * share for share in shares]
    assert at_end
    return [end - (end - start) * share for share in reversed(shares)]


def _filled(start: float, end: float, size: float) -> list[float]:
    """Ends of cells from start to end: growing by 2 from `size`, graded towards the end."""
    found = [start]
    while found[-1] + 2 * size < end - 0.25 * (end - start):
        found.append(found[-1] + size)
        size *= 2
    left = end - found[-1]
    return found + [end - left * GRADED**k for k in range(1, 4)] + [end]


def _points(ends: Sequence[float], xi: np.ndarray) -> np.ndarray:
    """The nodes of cells one after the other, shared ends once."""
    parts = [lo + (hi - lo) * (xi + 1) / 2 for lo, hi in pairwise(ends)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
