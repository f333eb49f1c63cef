"""The strain energy of a material whose shear stress relaxes, while its bulk modulus does not.

With S = 2 mu dev eps and the strain eps, or at finite strain S = J^(2/3) F^-1 dpsi_shear/dF and
J^(-2/3) C/2 in its place (Simo 1987), the shear stress of G(t) = rest + sum g_k exp(-t/tau_k) is

    (rest + sum g_k) S - sum g_k A_k,    tau_k dA_k/dt = S - A_k.

Over a stage of length dt that sets out from S*, A_k*, with x = dt/tau_k,

    A_k = c_A A_k* + c_S S* + (1 - c_A - c_S) S,
    c_A = e^-x, c_S = (1 - e^-x)/x - e^-x    (S is straight in time; exact where it stands still)
    c_A = 1/(1 + x), c_S = 0                 (a stage of backward Euler, where fluid flows),

so that the stage has a potential, psi_shear (rest + sum g_k (c_A + c_S)) + h : eps + volume, in
which only a number and the tensor h = -sum g_k (c_A A_k* + c_S S*) change from one to the next. A_k
and S are kept at the points of the quadrature. Source: Simo (1987), Comput. Methods Appl. Mech.
Eng. 60, 153.

The share of the elastic shear stress that is left is ((rest + sum g_k) S - sum g_k A_k) : S/(S :
S), summed over these points, which are close together where the tip presses. The contact is as
stiff, and its edge is read off, as an elastic body of that share of the shear modulus has it: with
the modulus of the first moment `a` was 60 % too small where 1e-4 of it is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import VOLUME_DEGREE, Body
from indent_sim.fe.terms.strain import Strain
from indent_sim.fe.terms.term import Stage
from indent_sim.mesh.modelled_part import Region
from indent_sim.model.materials import Material, Relaxable

# Components of a symmetric tensor that a model has: those of (r, theta, z) or (x, y, z) with no
# shear along the second
COMPONENTS = {
    2: ((0, 0), (1, 1), (2, 2), (0, 2)),
    3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)),
}


class Relaxing(Strain):
    """The virtual work of a region whose `relaxing` says how its shear stress falls.

    `energy` is the potential of the stage, which no elastic body has stored; psi [pressure] is what
    stays stored when all has relaxed.
    """

    has_memory = True

    def __init__(self, body: Body, region: Region):
        assert region.relaxing
        self._rest, self._g, self._tau = region.relaxing.rest, *map(np.array, region.relaxing[1:])
        dim = body.body_mesh.dim
        degree = VOLUME_DEGREE[body.body_mesh.dim]
        self._points, self._weights = compat.quadrature(compat.CELL_NAMES[dim], degree)
        width = len(COMPONENTS[dim])
        space = compat.function_space(body.mesh, compat.at_quadrature(dim, degree, width))
        means = compat.function_space(body.mesh, compat.in_cells(dim, width))
        self._stiffness, self._share_at_rest = (
            fem.Constant(body.mesh, share) for share in (1.0, self._rest)
        )
        self._found: list[np.ndarray] = []  # S and the A_k at the end of the last stage
        self._if_held = (
            1.0  # share of the shear stress that a stage leaves where the strain stands still
        )
        self._h = fem.Function(space)
        self._mean_h = fem.Function(means)
        self._start, *self._relaxed = (
            fem.Function(space) for _ in range(1 + len(self._g))
        )  # S*, and the A_k
        self.history = (self._start, *self._relaxed)
        super().__init__(body, region)
        self.is_constant = False  # it changes with the length of a step
        self._places = compat.cell_dofs(space.dofmap)[self.cells]
        self.begin(Stage(0.0))

    def _densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """The potential of a stage, with h at the points of the quadrature, and with its mean in a
        cell.
        """
        assert isinstance(material, Relaxable)
        shear, theta = material.split(H)
        # the meaning of q stays the same while the shear relaxes: it is the one of the body that
        # has relaxed
        volume = (
            theta**2 / (2 * material.inverse_bulk_modulus)
            if q is None
            else material.mixed_volume(H, theta, q, self._share_at_rest)
        )
        P = ufl.diff(shear, H)
        self._S = (
            P
            if material.small_strain
            else ufl.exp(2 * theta / 3) * ufl.inv(ufl.Identity(3) + H) * P
        )
        self.psi = self._rest * shear + volume
        elastic = self._stiffness * shear + volume
        with_h, with_mean = (
            elastic + _work_of(_symmetric(h), material, H, theta) for h in (self._h, self._mean_h)
        )
        return with_h, with_mean

    @cached_property
    def _of_points(self) -> fem.Expression:
        dim = self.body.body_mesh.dim
        return fem.Expression(
            ufl.as_vector([self._S[i, j] for i, j in COMPONENTS[dim]]), self._points
        )

    def _shear_stress(self) -> np.ndarray:
        """S at the points of the quadrature, as the local array of a function; 0 outside the
        region.
        """
        values: np.ndarray = np.zeros_like(self._h.x.array)
        width = self._h.function_space.dofmap.index_map_bs
        found = compat.evaluate(self._of_points, self.body.mesh, self.cells)
        values.reshape(-1, width)[self._places] = found.reshape(*self._places.shape, width)
        return values

    def begin(self, stage: Stage) -> None:
        """Set out from S* and from A_k*, which lies beyond the first of two stages for the second."""
        olds = [A.x.array for A in self._relaxed]
        ones = self._found[1:] if self._found and stage.share else olds
        self._from = [old + stage.share * (one - old) for old, one in zip(olds, ones, strict=True)]
        self._kept, self._followed = _shares(stage, self._tau)
        self._stiffness.value = self._rest + self._g @ (self._kept + self._followed)
        self._h.x.array[:] = -(self._g @ self._followed) * self._start.x.array
        for weight, A in zip(self._g * self._kept, self._from, strict=True):
            self._h.x.array[:] -= weight * A
        self._take_means()
        self._found = []
        self._if_held = self._share_left(self._start.x.array, self._at_the_end(self._start.x.array))
        self.E_star = self._E_star_of(self._if_held)

    def expect(self, began: float, depth: float) -> None:
        """Take the modulus between that of a strain that stands still and that of a further step,
        by the share of the depth that is new: nothing is solved twice for it, and in a hold it
        is exact.
        """
        new = abs(depth - began)
        old = abs(began)
        if new + old > 0:
            share = (self._if_held * old + float(self._stiffness.value) * new) / (new + old)
            self.E_star = self._E_star_of(share)

    def _share_left(self, S: np.ndarray, relaxed: Sequence[np.ndarray]) -> float:
        """((rest + sum g_k) S - sum g_k A_k) : S/(S : S) over all points of the quadrature
        (collective); where nothing is strained that of a further step.

        Parameters
        ----------
        S : ndarray
            Elastic shear stress, as the local array of a function [pressure].
        relaxed : sequence of ndarray
            The A_k, likewise.
        """
        left = (self._rest + sum(self._g)) * S - sum(
            g * A for g, A in zip(self._g, relaxed, strict=True)
        )
        pairs = COMPONENTS[self.body.body_mesh.dim]
        twice = np.array(
            [1.0 if i == j else 2.0 for i, j in pairs]
        )  # a shear stands for two components
        owned = self._places  # the points of this rank's own cells
        pressed, kept = (values.reshape(-1, len(pairs))[owned] for values in (S, left))
        mine = np.array([np.sum(twice * kept * pressed), np.sum(twice * pressed * pressed)])
        work, size = self.body.comm.allreduce(mine)
        return float(work / size) if size > 0 else float(self._stiffness.value)

    def _E_star_of(self, share: float) -> float:
        """E* [pressure] of an elastic body of a share of the shear modulus, no less than when all
        has relaxed.
        """
        return self.region.material.softened(max(share, self._rest)).E_star

    def _take_means(self) -> None:
        """The mean of h in every cell, by which a stress can be read off anywhere in it."""
        width = self._mean_h.function_space.dofmap.index_map_bs
        here = self._h.x.array.reshape(-1, width)[self._places]
        cells = compat.cell_dofs(self._mean_h.function_space.dofmap)[self.cells, 0]
        self._mean_h.x.array.reshape(-1, width)[cells] = np.tensordot(
            self._weights, here, (0, 1)
        ) / sum(self._weights)

    def end(self, stage: Stage) -> None:
        """Find S and the A_k at the end of the stage."""
        S = self._shear_stress()
        self._found = [S, *self._at_the_end(S)]
        self.E_star = self._E_star_of(self._share_left(S, self._found[1:]))

    def _at_the_end(self, S: np.ndarray) -> list[np.ndarray]:
        """The A_k at the end of the stage, where it leads to S."""
        follows = zip(self._kept, self._followed, self._from, strict=True)
        return [a * A + b * self._start.x.array + (1 - a - b) * S for a, b, A in follows]

    def accept(self) -> None:
        """S and the A_k at the end of the step are those that the next one sets out from."""
        if not self._found:
            S = self._shear_stress()
            self._found = [S, *self._at_the_end(S)]
        for function, values in zip(self.history, self._found, strict=True):
            function.x.array[:] = values


def _symmetric(h: fem.Function) -> Expr:
    """The tensor (3, 3) of its components."""
    pairs = COMPONENTS[h.function_space.mesh.topology.dim]
    number = {pair: k for k, pair in enumerate(pairs)} | {
        (j, i): k for k, (i, j) in enumerate(pairs)
    }
    return ufl.as_tensor(
        [[h[number[i, j]] if (i, j) in number else 0.0 for j in range(3)] for i in range(3)]
    )


def _work_of(h: Expr, material: Relaxable, H: Expr, theta: Expr) -> Expr:
    """h : eps, or h : J^(-2/3) C/2 by way of scalars, through which all derivatives can pass."""
    if material.small_strain:
        return ufl.inner(h, ufl.sym(H))
    F = ufl.Identity(3) + H
    return ufl.exp(-2 * theta / 3) * ufl.variable(ufl.inner(h, F.T * F) / 2)


def _shares(stage: Stage, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """c_A and c_S of every term."""
    x = stage.dt / tau
    if stage.end < 1.0 or stage.share:
        return 1 / (1 + x), 0.0 * x
    kept = np.exp(-x)
    return kept, np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0) - kept
