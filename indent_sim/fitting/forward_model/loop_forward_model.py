"""Forward model of a body that yields: loading and unloading of a cone on a half-space."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.cone_loop import (
    HARDENING_KEY,
    HARDENING_RANGE,
    MODULUS_RATIOS,
    YIELD_STRESS_KEY,
    ConeLoop,
    ConeLoopTable,
    Metal,
    refuse_other_scenes,
)
from indent_sim.fitting.forward_model.forward_model import RETRACT, ForwardModel, curves_of_batch
from indent_sim.fitting.forward_model.measured_path_forces import MeasuredPath
from indent_sim.fitting.measured_constants import LOOP_RECOVERY_ERROR


class LoopForwardModel(ForwardModel):
    """Force of a cone on a body that yields, in loading and unloading.

    The displacement of the base at which unloading begins is given by `turned_at`; without a spring
    it is the depth. Parameters are Young's modulus, yield stress and hardening exponent.

    Raises
    ------
    ConfigError
        If the scene is not a cone on a half-space, or a key is none of these parameters.
    """

    def __init__(self, config: Config, varied_keys: Sequence[str], max_depth: float):
        refuse_other_scenes(config, tuple(varied_keys))
        super().__init__(config, varied_keys, max_depth)
        self._turn: np.ndarray = np.array(max_depth)

    def _tabulate(self, measured_path: MeasuredPath | None) -> None:
        """Prepare the table of loops."""
        # No modulus scales the force alone.
        self.parameters = tuple(replace(parameter, role="shape") for parameter in self.parameters)
        self.table = ConeLoopTable(self.config, self.max_depth, HARDENING_KEY in self.varied_keys)

    @property
    def follows_loop(self) -> bool:
        """True: the forces of unloading and of loading are different."""
        return True

    @property
    def has_analytic_derivatives(self) -> bool:
        """False, because the derivatives are computed by central differences."""
        return False

    @property
    def is_batchable(self) -> bool:
        """False: forces of several curves are computed one by one."""
        return False

    def copy_for_depth(self, max_depth: float) -> LoopForwardModel:
        """Return a copy of the model for another largest depth, which needs no run."""
        model = copy.copy(self)
        model.max_depth = max_depth
        model.pivot_depth = max_depth
        return model

    def turned_at(self, depth: np.ndarray) -> LoopForwardModel:
        """Return a copy whose unloading begins at a displacement of the base [length] (...)."""
        model = copy.copy(self)
        model._turn = np.asarray(depth)
        return model

    @property
    def relative_error(self) -> float:
        """Relative error of the force of loading."""
        return self.loop(self.initial_coordinates)[1].curvature_error

    def metal(self, theta: np.ndarray) -> Metal:
        """Return the material at transformed parameters (k,)."""
        values = {
            parameter.key: parameter.value(float(x))
            for parameter, x in zip(self.parameters, theta, strict=True)
        }
        scene = self.table.scene_metal
        return Metal(
            values.get("material.E", scene.E),
            values.get(YIELD_STRESS_KEY, scene.yield_stress),
            values.get(HARDENING_KEY, scene.n),
        )

    def loop(self, theta: np.ndarray) -> tuple[float, ConeLoop]:
        """Return Young's modulus [pressure] and the loop at transformed parameters (k,)."""
        metal = self.metal(theta)
        return metal.E, self.table.loop(metal)

    def __call__(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        t: np.ndarray | None = None,
        branch: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the forces (..., n) at displacements of the base x (..., n).

        Without `branch`, all forces are those of loading.
        """
        if theta.ndim > 1:
            turns = np.broadcast_to(self._turn, len(theta))
            return np.stack(
                [
                    self.turned_at(turn)(one, row, t, branches)
                    for (one, row, branches), turn in zip(
                        curves_of_batch(theta, x, branch), turns, strict=True
                    )
                ]
            )
        E, loop = self.loop(theta)
        loading = self._loading(E, loop, x)
        if branch is None:
            return loading
        is_unloading = np.abs(branch) == RETRACT
        return np.where(is_unloading, self._unloading(E, loop, x), loading)

    def _loading(self, E: float, loop: ConeLoop, x: np.ndarray) -> np.ndarray:
        """Return the forces (n,) of loading at displacements of the base of the spring (n,).

        The depth h is the positive root of x = h + compliance F(h) with F proportional to h^2.
        """
        stiffening = 4.0 * self.experiment.compliance * E * loop.curvature * np.maximum(x, 0.0)
        return loop.loading(E, 2.0 * x / (1.0 + np.sqrt(1.0 + stiffening)))

    def _unloading(self, E: float, loop: ConeLoop, x: np.ndarray) -> np.ndarray:
        """Return the forces (n,) of unloading at displacements of the base of the spring (n,)."""
        turn = self._turn.reshape(-1)[:1]
        if not turn[0] > 0:
            return np.zeros(x.shape)
        compliance = self.experiment.compliance
        h_max = float(turn[0] - compliance * self._loading(E, loop, turn)[0])
        if not compliance:
            return loop.unloading(E, x, h_max)
        return self._solve_spring_balance(
            x, compliance, lambda h: loop.unloading_with_stiffness(E, h, h_max)
        )

    def linearize(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        t: np.ndarray | None,
        branch: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces, and their derivatives by theta and by a shift of the curve."""
        if theta.ndim > 1:
            turns = np.broadcast_to(self._turn, len(theta))
            parts = [
                self.turned_at(turn).linearize(one, row, t, branches)
                for (one, row, branches), turn in zip(
                    curves_of_batch(theta, x, branch), turns, strict=True
                )
            ]
            forces, derivatives = zip(*parts, strict=True)
            return np.stack(forces), np.stack(derivatives)
        step = 1e-5 * self.max_depth
        # A shift of the contact point moves the depth of turning as well.
        low = self.turned_at(self._turn - step)(theta, x - step, t, branch)
        high = self.turned_at(self._turn + step)(theta, x + step, t, branch)
        by_theta = self._difference_quotients(theta, x, t, branch)[:-1]
        return self(theta, x, t, branch), np.vstack([by_theta, (low - high) / (2.0 * step)])

    def force_without_spring(self, theta: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the force of loading over depth."""
        E, loop = self.loop(theta)
        return lambda delta: loop.loading(E, delta)

    def time_step_error(self, theta: np.ndarray, x: np.ndarray, t: np.ndarray | None) -> np.ndarray:
        """Return zeros (n,), because the force does not depend on time."""
        return np.zeros(len(x))

    def unloading_errors(self, theta: np.ndarray, x: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """Return the errors (2, n) of the force due to errors of stiffness and recovery."""
        E, loop = self.loop(theta)
        step = 1e-3
        force = self._unloading(E, loop, x)
        changes = [
            (replace(loop, stiffness=loop.stiffness * (1.0 + step)), loop.stiffness_error),
            (replace(loop, recovery=loop.recovery * (1.0 + step)), LOOP_RECOVERY_ERROR),
        ]
        errors = [
            (self._unloading(E, changed, x) - force) * error / step for changed, error in changes
        ]
        return np.where(branch == RETRACT, np.array(errors), 0.0)

    def coordinates_of(self, curvature: float, stiffness: float | None) -> np.ndarray:
        """Return transformed parameters with a given loading curve and unloading stiffness.

        Parameters
        ----------
        curvature
            F/h^2 of loading [pressure].
        stiffness
            S h_max/F_max; None without unloading.
        """
        theta = self.initial_coordinates
        keys = self.varied_keys
        scaled = [k for k, key in enumerate(keys) if key in ("material.E", YIELD_STRESS_KEY)]
        rounds = 6
        for _ in range(rounds):
            E, loop = self.loop(theta)
            if len(scaled) == 2 and stiffness is not None:
                # s grows about as the power 0.85 of E/yield_stress. The result is an initial guess.
                log_ratio = math.log(stiffness / loop.stiffness) / 0.85
                theta[keys.index(YIELD_STRESS_KEY)] -= log_ratio
                E, loop = self.loop(theta)
                theta[scaled] += math.log(curvature / (E * loop.curvature))
                continue
            log_curvature = math.log(curvature / (E * loop.curvature))
            if scaled:
                # C grows about as the root of either pressure.
                theta[scaled] += log_curvature / 0.5 / len(scaled)
            elif HARDENING_KEY in keys:
                k = keys.index(HARDENING_KEY)
                theta[k] = float(np.clip(theta[k] + log_curvature, *HARDENING_RANGE))
        return theta

    @property
    def ratio_bounds(self) -> tuple[float, float]:
        """Range of E/yield_stress in which loops are tabulated."""
        return MODULUS_RATIOS
