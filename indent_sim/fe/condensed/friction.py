"""Friction on a condensed body: the equations of `fe.terms.friction` in the nodal forces alone.

X = [F, T_1, ..] are the nodal forces pushing down and those along the horizontal axes, u = C X their displacements:

    F = int p N,   T_k = int t_k N,   p_hat = lam - epsilon_n g,   t_hat_k = tau_k - epsilon_t s_k,
    lam = M^-1 F,   tau_k = M_k^-1 T_k,

with M the mass matrix of the whole contact surface, M_k that of its nodes whose displacement along axis k is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu

from indent_sim.fe.observe.surface import shapes
from indent_sim.fe.terms.friction import AT_ONCE, CLOSING, TOUCHED

TOLERANCE = 1e-12  # of the residual, relative to the nodal forces; a dense solve leaves less
STALLED = 1e-10  # and where round-off leaves no more
ITERATIONS = 50
PATIENCE = 3  # iterations that may come no nearer than one before


@dataclass(frozen=True)
class Rest:
    """An equilibrium to set out from: displacements down and along the surface (1 + axes, nodes) [length], lam
    (nodes,) [pressure], depth [length]."""

    u: np.ndarray
    lam: np.ndarray
    depth: float


@dataclass(frozen=True)
class Trial:
    """p_hat (facets, points) and t_hat (axes, facets, points) [pressure], where something holds the surface, and the
    gap [length] at the step's beginning, below zero where the surface was in contact."""

    p_hat: np.ndarray
    t_hat: np.ndarray
    holds: np.ndarray
    opening: np.ndarray


class CondensedFriction:
    """What the tangential forces add to a `CondensedContact`: its Newton, its history and its work."""

    def __init__(self, contact: Any):
        """contact: the `CondensedContact` that these are the tangential forces of."""
        self._law = contact.law
        self._contact, self._compliance = contact, contact.compliance
        self._n, axes = contact.compliance.size, len(contact.compliance.held)
        self._old = Rest(np.zeros((1 + axes, self._n)), np.zeros(self._n), 0.0)
        self._depth = 0.0  # of the last solve
        self.stick_where_it_was()

    # ---- history -------------------------------------------------------------------------------------------------

    def depart(self, depth: float) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        self._old = Rest(self._displacements(), self._contact.lam[self._contact.places], depth)

    def stick_where_it_was(self) -> None:
        """What comes into contact sticks where it was at the step's beginning: `implicit`."""
        self._start, self._widest, self._holds_new = self._old.u[1:], 1.0, True

    def let_new_slip(self) -> None:
        """What comes into contact slips freely: `glue`."""
        self.stick_where_it_was()
        self._holds_new = False

    def stick_on_the_way(self) -> None:
        """What comes into contact sticks on its way from the step's beginning to the present state: `mid`."""
        trial = self._present(self._contact.quadrature, self._depth)
        self._widest = float(trial.opening[trial.p_hat > 0].max(initial=0.0)) or 1.0
        self._start, self._holds_new = self._displacements()[1:], True

    def _displacements(self) -> np.ndarray:
        return (self._compliance.whole @ self._contact.forces.ravel()).reshape(-1, self._n)

    # ---- Newton --------------------------------------------------------------------------------------------------

    def newton(self, delta: float, softer: float) -> bool:
        """Semismooth Newton on X = [int p N, int t N] from the present forces, `softer` times both stiffnesses."""
        contact, self._depth = self._contact, delta
        N, W, _ = contact.quadrature
        D = self._responses - softer * self._stiffnesses * self._compliance.whole
        X: np.ndarray = contact.forces.ravel()
        nothing = contact.nothing(lambda F: np.abs(F).max(initial=0.0))
        residuals, seen = list[float](), list[bytes]()
        for _ in range(ITERATIONS):
            trial = self._trial(D @ X, contact.quadrature, delta, softer)
            load = self._loads(trial, N, W)
            residual, least = np.abs(X - load).max(initial=0.0), min(residuals, default=np.inf)
            allowed = STALLED if residual >= least else TOLERANCE
            if residual <= allowed * np.abs(load).max(initial=0.0) + nothing:
                contact.forces = load.reshape(-1, self._n)
                return True
            is_back = (regions := self._regions(trial)) in seen[:-1]
            if residual >= least and (is_back or residuals.index(least) < len(residuals) - PATIENCE):
                return False  # it goes round in a circle, or comes no nearer
            residuals, seen = [*residuals, residual], [*seen, regions]
            X = X + self._step(X - load, self._slopes(trial) * W, N, D)
            contact.iterations += 1
        return False

    @cached_property
    def _stiffnesses(self) -> np.ndarray:
        """epsilon_n and epsilon_t, each for the rows of its forces (rows, 1)."""
        rows = [self._law.epsilon_t] * (len(self._compliance.whole) - self._n)
        return np.array([self._law.stiffness] * self._n + rows)[:, None]

    @cached_property
    def _responses(self) -> np.ndarray:
        """M^-1 and every M_k^-1 between the candidates, block by block [1/area]."""
        places, whole = self._contact.places, np.zeros_like(self._compliance.whole)
        unit = np.eye(self._n)
        for k, project in enumerate([self._contact.projected, *self._projections]):
            block = slice(k * self._n, (k + 1) * self._n)
            whole[block, block] = project(unit)[places]
        return whole

    @cached_property
    def _projections(self) -> list[Any]:
        """tau_k = M_k^-1 T_k on the whole surface for forces on the candidates, for each axis."""
        return [self._projection(held) for held in self._compliance.held]

    def _projection(self, held: np.ndarray) -> Any:
        free = diags(1.0 - held)
        factor = splu((free @ self._contact.mass @ free + diags(1.0 * held)).tocsc())

        def project(T: np.ndarray) -> np.ndarray:
            whole = np.zeros((len(held), *T.shape[1:]))
            whole[self._contact.places] = T
            whole[held] = 0.0
            return np.asarray(factor.solve(whole))

        return project

    def _trial(self, nodal: np.ndarray, rule: Any, delta: float, softer: float = 1.0) -> Trial:
        """The trial tractions at points (see `CondensedContact.quadrature`) of the nodal values D X."""
        N, _, height = rule
        epsilon_n, epsilon_t = softer * self._law.stiffness, softer * self._law.epsilon_t
        old, nodes = self._old, self._contact.nodes
        p_hat, *t_hat = (values[nodes] @ N.T for values in nodal.reshape(-1, self._n))
        p_hat = p_hat - epsilon_n * (height - delta)
        before = old.u[0] - old.lam / self._law.stiffness
        opening = before[nodes] @ N.T + height - old.depth
        is_new = opening > AT_ONCE * abs(delta - old.depth)
        way = is_new * TOUCHED * np.clip(opening / self._widest, 0.0, 1.0) ** CLOSING
        places = [was[nodes] @ N.T + way * ((at - was)[nodes] @ N.T)
                  for at, was in zip(self._start, old.u[1:], strict=True)]  # fmt: skip
        holds = (p_hat > 0) & (self._holds_new | ~is_new)
        return Trial(p_hat, np.array(t_hat) + epsilon_t * np.array(places), holds, opening)

    def _bound(self, trial: Trial) -> Any:
        """friction p [pressure], infinite for stick."""
        if self._law.friction == "stick":
            return np.inf
        return self._law.friction * np.maximum(trial.p_hat, 0.0)

    def _tractions(self, trial: Trial) -> np.ndarray:
        """t (axes, facets, points) [pressure]."""
        length, bound = _length(trial.t_hat), self._bound(trial)
        slipping = np.where(length > bound, bound / length, 1.0)
        return np.asarray(np.where(trial.holds, slipping, 0.0) * trial.t_hat)

    def _regions(self, trial: Trial) -> bytes:
        """Where the surface is in contact, and where it slips and to which side."""
        slips = _length(trial.t_hat) > self._bound(trial)
        return (trial.p_hat > 0).tobytes() + (slips * np.sign(trial.t_hat)).tobytes()

    def _loads(self, trial: Trial, N: np.ndarray, W: np.ndarray) -> np.ndarray:
        """The nodal forces of the tractions; none where a displacement is held, which they could not change."""
        contact, p = self._contact, np.maximum(trial.p_hat, 0.0)
        loads = np.array([contact.vector((W * q) @ N) for q in (p, *self._tractions(trial))])
        loads[1:][self._held] = 0.0
        return loads.ravel()

    @cached_property
    def _held(self) -> np.ndarray:
        return self._compliance.held[:, self._contact.places]

    def _slopes(self, trial: Trial) -> np.ndarray:
        """d(p, t)/d(p_hat, t_hat) (1 + axes, 1 + axes, facets, points)."""
        m = 1 + len(trial.t_hat)
        slopes = np.zeros((m, m, *trial.p_hat.shape))
        slopes[0, 0] = trial.p_hat > 0
        length, bound = _length(trial.t_hat), self._bound(trial)
        along, slips = trial.t_hat / length, length > bound
        share = np.where(slips, bound / length, 1.0)
        for i, k in np.ndindex(m - 1, m - 1):
            slopes[1 + i, 1 + k] = trial.holds * share * ((i == k) - slips * along[i] * along[k])
        if self._law.friction != "stick":
            slopes[1:, 0] = trial.holds * slips * self._law.friction * along
        return slopes

    def _step(self, residual: np.ndarray, weights: np.ndarray, N: np.ndarray, D: np.ndarray) -> np.ndarray:
        """-(I - A D)^-1 residual, A from `weights` as those of `_slopes`; without contact a row is the identity's."""
        nodes, m = self._contact.nodes, len(weights)
        touched = np.flatnonzero(weights[0, 0].any(axis=1))
        pairs = N[:, :, None] * N[:, None, :]
        local = np.einsum("abfp,pij->abfij", weights[:, :, touched], pairs)
        at = nodes[touched]
        block = np.arange(m) * self._n
        i = block[:, None, None, None, None] + at[:, :, None]
        j = block[None, :, None, None, None] + at[:, None, :]
        i, j = (np.broadcast_to(index, local.shape).ravel() for index in (i, j))
        rows = np.setdiff1d((block[:, None] + np.unique(at)).ravel(), self._n + np.flatnonzero(self._held))
        place = np.full(m * self._n, -1)
        place[rows] = np.arange(len(rows))
        kept = (place[i] >= 0) & (place[j] >= 0)
        A = csr_matrix((local.ravel()[kept], (place[i[kept]], place[j[kept]])), shape=(len(rows),) * 2)
        among = D[np.ix_(rows, rows)]
        step = -residual
        step[rows] += A @ (D[rows] @ step - among @ step[rows])
        step[rows] = np.linalg.solve(np.eye(len(rows)) - A @ among, step[rows])
        return step

    # ---- what is observed ----------------------------------------------------------------------------------------

    def tau(self) -> np.ndarray:
        """tau (axes, nodes of the whole surface) [pressure]."""
        forces = self._contact.forces[1:]
        return np.array([project(T) for project, T in zip(self._projections, forces, strict=True)])

    def room_at(self, points: np.ndarray, delta: float) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks."""
        rule = shapes(points), *self._contact.rule(points, np.ones(len(points)))
        trial = self._present(rule, delta)
        return np.asarray(self._bound(trial) - _length(trial.t_hat))

    def dissipation(self, delta: float) -> float:
        """What slip turns into heat in the step to the present state [energy], of the modelled part:
        int t . (t_hat - t)/epsilon_t with friction (p + p_old)/2 in place of friction p."""
        if self._law.friction == "stick":
            return 0.0
        _, W, _ = rule = self._contact.quadrature
        trial = self._present(rule, delta)
        t = self._tractions(trial)
        before = self._law.stiffness * np.maximum(-trial.opening, 0.0)
        slips = (trial.p_hat > 0) & (_length(trial.t_hat) > self._bound(trial))
        share = np.where(slips, (trial.p_hat + before) / (2 * np.where(slips, trial.p_hat, 1.0)), 0.0)
        rubbed = (t * (trial.t_hat - t)).sum(axis=0) / self._law.epsilon_t
        return float((W * share * rubbed).sum())

    def _present(self, rule: Any, delta: float) -> Trial:
        u, lam = self._displacements(), self._contact.lam[self._contact.places]
        p_hat = lam - self._law.stiffness * u[0]
        t_hat = self.tau()[:, self._contact.places] - self._law.epsilon_t * u[1:]
        return self._trial(np.array([p_hat, *t_hat]), rule, delta)


def _length(t_hat: np.ndarray) -> np.ndarray:
    """|t_hat| [pressure], above zero."""
    return np.sqrt((t_hat**2).sum(axis=0) + np.finfo(float).tiny)
