"""Friction on a condensed body: the equations of `fe.terms.contact.friction` in the nodal forces
alone.

X = [F, T_1, ..] are the nodal forces pushing down and those along the horizontal axes, u = C X
their displacements:

    F = int p N,   T_k = int t_k N,   p_hat = lam - epsilon_n g,   t_hat_k = tau_k - epsilon_t s_k,
    lam = M^-1 F,   tau_k = M_k^-1 T_k,

with M the mass matrix of the whole contact surface, M_k that of its nodes whose displacement along
axis k is free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import diags
from scipy.sparse.linalg import splu

from indent_sim.fe.observe.surface import shapes
from indent_sim.model.contact import (
    Anchor,
    CoulombPoint,
    heat_of_leaving,
    is_new_contact,
    passed_gap,
    way_gone,
)

Rule = tuple[np.ndarray, np.ndarray, np.ndarray]  # see `CondensedContact.quadrature`

NODAL_FORCE_TOLERANCE = (
    1e-12  # of the residual, relative to the nodal forces; a dense solve leaves less
)
STALLED = 1e-10  # and where round-off leaves no more
MOST_FRICTION_ITERATIONS = 50


@dataclass(frozen=True)
class Rest:
    """An equilibrium to set out from: u (1 + axes, nodes) down and along [length], lam (nodes,)
    [pressure], depth.
    """

    u: np.ndarray
    lam: np.ndarray
    depth: float


@dataclass(frozen=True)
class Trial(CoulombPoint):
    """p and t_hat (axes, facets, points) at points of the surface, and p_hat (facets, points)
    [pressure]; where something `holds` the surface; the gap [length] at the step's beginning,
    below zero where the surface was in contact; `passed`: the gap that closed or opened during
    the step, 0 where none did.
    """

    t_hat: np.ndarray
    p_hat: np.ndarray
    holds: np.ndarray
    opening: np.ndarray
    passed: np.ndarray

    @property
    def slips(self) -> np.ndarray:
        """Where the traction is beyond the bound."""
        return np.asarray(self.room < 0)

    @property
    def t(self) -> np.ndarray:
        """The traction (axes, facets, points) [pressure]."""
        return np.asarray(self.holds * self.share * self.t_hat)


class CondensedFriction:
    """What the tangential forces add to a `CondensedContact`: its Newton, its history and its work."""

    def __init__(self, contact: Any):
        """contact: the `CondensedContact` that these are the tangential forces of."""
        self._law = contact.law
        self._contact = contact
        self._compliance = contact.compliance
        self._n = contact.compliance.size
        axes = len(contact.compliance.held)
        self._held = contact.compliance.held[:, contact.places]
        self._old = Rest(np.zeros((1 + axes, self._n)), np.zeros(self._n), 0.0)
        self.hold_new("implicit")

    def depart(self) -> None:
        """Take the present equilibrium as the one that the next step sets out from."""
        self._old = Rest(
            self._displacements(), self._contact.lam[self._contact.places], self._contact.depth
        )

    def hold_new(self, anchor: Anchor) -> None:
        """Say where what comes into contact sticks; see `solve.anchor`."""
        self._holds_new = anchor != "glue"
        self._start = self._old.u[1:]
        self._widest = 1.0
        if anchor == "mid":
            self._find_widest()
            self._start = self._displacements()[1:]

    def _find_widest(self) -> None:
        self._widest = float(self._present(self._contact.quadrature).passed.max(initial=0.0)) or 1.0

    def _displacements(self) -> np.ndarray:
        return (self._compliance.whole @ self._contact.forces.ravel()).reshape(-1, self._n)

    def newton(self, softer: float) -> bool:
        """Semismooth Newton on X = [int p N, int t N] from the present forces, `softer` times both
        stiffnesses.
        """
        contact = self._contact
        stiffnesses = np.repeat(
            [self._law.stiffness, self._law.epsilon_t], [self._n, len(self._held) * self._n]
        )
        D = self._responses - softer * stiffnesses[:, None] * self._compliance.whole
        X: np.ndarray = contact.forces.ravel()
        nothing = contact.nothing(lambda F: np.abs(F).max(initial=0.0))
        residuals = list[float]()
        seen = list[bytes]()
        for _ in range(MOST_FRICTION_ITERATIONS):
            trial = self._trial(D @ X, contact.quadrature, softer)
            load = self._loads(trial)
            residual = np.abs(X - load).max(initial=0.0)
            least = min(residuals, default=np.inf)
            if not np.isfinite(residual):
                return False
            allowed = STALLED if residual >= least else NODAL_FORCE_TOLERANCE
            if residual <= allowed * np.abs(load).max(initial=0.0) + nothing:
                contact.forces = load.reshape(-1, self._n)
                return True
            is_back = (regions := self._regions(trial)) in seen[:-1]
            if residual >= least and (is_back or residuals.index(least) < len(residuals) - 3):
                return False  # it goes round in a circle, or has come no nearer in three iterations
            residuals = [*residuals, residual]
            seen = [*seen, regions]
            X = X + contact.newton_step(X - load, self._slopes(trial), D, self._held)
            contact.iterations += 1
        return False

    @cached_property
    def _responses(self) -> np.ndarray:
        """M^-1 and every M_k^-1 between the candidates, block by block [1/area]."""
        places = self._contact.places
        whole = np.zeros_like(self._compliance.whole)
        unit = np.eye(self._n)
        for k, project in enumerate([self._contact.projected, *self._projections]):
            block = slice(k * self._n, (k + 1) * self._n)
            whole[block, block] = project(unit)[places]
        return whole

    @cached_property
    def _projections(self) -> list[Callable[[np.ndarray], np.ndarray]]:
        """tau_k = M_k^-1 T_k on the whole surface for forces on the candidates, for each axis."""
        return list(map(self._projection, self._compliance.held))

    def _projection(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        free = diags(1.0 - held)
        factor = splu((free @ self._contact.mass @ free + diags(1.0 * held)).tocsc())

        def project(T: np.ndarray) -> np.ndarray:
            whole = np.zeros((len(held), *T.shape[1:]))
            whole[self._contact.places] = T
            whole[held] = 0.0
            return np.asarray(factor.solve(whole))

        return project

    def _trial(self, nodal: np.ndarray, rule: Rule, softer: float = 1.0) -> Trial:
        (N, _, height) = rule
        depth = self._contact.depth
        epsilon_n = softer * self._law.stiffness
        epsilon_t = softer * self._law.epsilon_t
        old = self._old
        nodes = self._contact.nodes
        p_hat, *t_hat = (values[nodes] @ N.T for values in nodal.reshape(-1, self._n))
        p_hat = p_hat - epsilon_n * (height - depth)
        before = old.u[0] - old.lam / self._law.stiffness
        opening = before[nodes] @ N.T + height - old.depth
        is_new = is_new_contact(opening, depth - old.depth)
        passed = np.asarray(passed_gap(opening, is_new, p_hat, epsilon_n))
        way = way_gone(passed, self._widest)
        starts = zip(self._start, old.u[1:], strict=True)
        places = [was[nodes] @ N.T + way * ((at - was)[nodes] @ N.T) for at, was in starts]
        holds = (p_hat > 0) & (self._holds_new | (is_new == 0))
        t_hat = np.array(t_hat) + epsilon_t * np.array(places)
        return Trial(
            self._law.friction, np.maximum(p_hat, 0.0), t_hat, p_hat, holds, opening, passed
        )

    def _regions(self, trial: Trial) -> bytes:
        return (trial.p_hat > 0).tobytes() + (trial.slips * np.sign(trial.t_hat)).tobytes()

    def _loads(self, trial: Trial) -> np.ndarray:
        """The nodal forces of the tractions; none where a displacement is held, which they could
        not change.
        """
        N, W, _ = self._contact.quadrature
        loads = np.array([self._contact.vector((W * q) @ N) for q in (trial.p, *trial.t)])
        loads[1:][self._held] = 0.0
        return loads.ravel()

    def _slopes(self, trial: Trial) -> np.ndarray:
        """d(p, t)/d(p_hat, t_hat) (1 + axes, 1 + axes, facets, points)."""
        m = 1 + len(trial.t_hat)
        slopes = np.zeros((m, m, *trial.p_hat.shape))
        slopes[0, 0] = trial.p_hat > 0
        along = trial.t_hat / trial.size
        for i, k in np.ndindex(m - 1, m - 1):
            slopes[1 + i, 1 + k] = (
                trial.holds * trial.share * ((i == k) - trial.slips * along[i] * along[k])
            )
        if not self._law.is_bonded:
            slopes[1:, 0] = trial.holds * trial.slips * self._law.friction * along
        return slopes

    def tau(self) -> np.ndarray:
        """tau (axes, nodes of the whole surface) [pressure]."""
        forces = self._contact.forces[1:]
        return np.array([project(T) for project, T in zip(self._projections, forces, strict=True)])

    def room_at(self, points: np.ndarray) -> np.ndarray:
        """friction p - |t_hat| (facets, points) [pressure], >= 0 where the surface sticks."""
        return np.asarray(
            self._present((shapes(points), *self._contact.rule(points, np.ones(len(points))))).room
        )

    def shear_at(self, points: np.ndarray) -> np.ndarray:
        """tau (facets, points, axes) [pressure]."""
        nodal = self.tau()[:, self._contact.places].T
        return self._compliance.trace.values(nodal[self._contact.nodes], points)

    def dissipation(self) -> float:
        """What slip turns into heat in the step to the present state [energy], of the modelled
        part.
        """
        law = self._law
        (N, W, _) = self._contact.quadrature
        if law.is_bonded:
            return 0.0
        if is_implicit := self._contact.scene.physics.anchor == "implicit":
            self._find_widest()
        trial = self._present(self._contact.quadrature)
        moved = (self._displacements()[1:] - self._old.u[1:])[:, self._contact.nodes] @ N.T
        way = way_gone(trial.passed, self._widest)
        before = law.stiffness * np.maximum(-trial.opening, 0.0)
        heat = trial.heat(
            trial.t, (trial.t_hat - trial.t) / law.epsilon_t + is_implicit * way * moved, before
        )
        left = heat_of_leaving(law.friction, before, moved, way)
        return float((W * (heat + is_implicit * (trial.p_hat <= 0) * left)).sum())

    def _present(self, rule: Rule) -> Trial:
        u = self._displacements()
        lam = self._contact.lam[self._contact.places]
        p_hat = lam - self._law.stiffness * u[0]
        t_hat = self.tau()[:, self._contact.places] - self._law.epsilon_t * u[1:]
        return self._trial(np.array([p_hat, *t_hat]), rule)
