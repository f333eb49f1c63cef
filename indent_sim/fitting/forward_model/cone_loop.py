"""Loading and unloading of a cone on a half-space that yields: one run for all depths.

A cone on a homogeneous half-space has no length but the depth, so that a loop to the depth h_max
has the dimensionless form

    loading    F = E c h^2,
    unloading  F = E c h_max^2 y(xi),   xi = s (h_max - h)/h_max,

where c, s = S h_max/F_max (S is the stiffness at the beginning of unloading) and the function y
depend on the ratio of Young's modulus to the yield stress, the hardening exponent, Poisson's ratio
and the half angle alone (Cheng & Cheng 1998, J. Appl. Phys. 84, 1284; Dao et al. 2001, Acta Mater.
49, 3899).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.parameter_grid import (
    NUMERICAL_ERRORS,
    ForwardModelUnavailable,
    ParameterGrid,
)
from indent_sim.fitting.forward_model.parameters import Parameter, number_at
from indent_sim.fitting.measured_constants import (
    LOOP_CURVATURE_ERROR,
    LOOP_LOG_STEP,
    LOOP_NODES,
    LOOP_STIFFNESS_ERROR,
)
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import states
from indent_sim.run.planned_run import PlannedRun

YIELD_STRESS_KEY = "material.plasticity.yield_stress"
HARDENING_KEY = "material.plasticity.hardening.n"
LOOP_KEYS = ("material.E", YIELD_STRESS_KEY, HARDENING_KEY)
# Range of E/yield_stress: below, elastic strains are too large for a metal, above, the first rows
# are the hardest to solve.
MODULUS_RATIOS = (8.0, 2000.0)
# Range of the hardening exponent, and step of its nodes.
HARDENING_RANGE = (0.0, 0.6)
HARDENING_STEP = 0.1
# Rows of loading; the force of a row is too small by a first-order error in the relative length of
# its increment, 1/k for row k, which is extrapolated to zero over the rows from FIRST_ROW on.
LOADING_ROWS = 20
FIRST_ROW = 5
# Rows of unloading, at these multiples of h_max/s from the deepest row; contact is lost at 1.1 to
# 1.3 of them.
UNLOADING_ROWS = (0.05, 0.15, 0.3, 0.5, 0.7, 0.9, 1.05, 1.2, 1.4)
# Fractions of the recovery xi_0 to the loss of contact at which y is tabulated.
RECOVERY_FRACTIONS = np.arange(1, 12) / 12.0


@dataclass(frozen=True)
class ConeLoop:
    """Dimensionless loop of a cone.

    Attributes
    ----------
    curvature
        c = F/(E h^2) of loading.
    stiffness
        s = S h_max/F_max at the beginning of unloading.
    recovery
        xi at which the force of unloading vanishes.
    forces
        y at RECOVERY_FRACTIONS of the recovery (11,).
    curvature_error, stiffness_error
        Relative errors of c and s.
    """

    curvature: float
    stiffness: float
    recovery: float
    forces: np.ndarray
    curvature_error: float = 0.0
    stiffness_error: float = 0.0

    def loading(self, E: float, h: np.ndarray) -> np.ndarray:
        """Return the forces (n,) of loading at depths h (n,)."""
        return np.asarray(E * self.curvature * np.maximum(h, 0.0) ** 2)

    def unloading(self, E: float, h: np.ndarray, h_max: float) -> np.ndarray:
        """Return the forces (n,) of unloading from h_max at depths h (n,)."""
        return self.unloading_with_stiffness(E, h, h_max)[0]

    def unloading_with_stiffness(
        self, E: float, h: np.ndarray, h_max: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces (n,) of unloading from h_max at depths h (n,), and dF/dh (n,)."""
        from scipy.interpolate import CubicSpline

        xi = self.stiffness * (h_max - h) / h_max
        fractions = np.concatenate([[0.0], RECOVERY_FRACTIONS, [1.0]])
        forces = np.concatenate([[1.0], self.forces, [0.0]])
        curve = CubicSpline(fractions, forces, bc_type=((1, -self.recovery), "not-a-knot"))
        fraction = np.clip(xi / self.recovery, 0.0, 1.0)
        y = curve(fraction)
        # Noise of the depth leads to samples beyond the deepest point.
        is_beyond = xi < 0
        is_in_contact = ~is_beyond & (y > 0.0) & (fraction < 1.0)
        F_max = E * self.curvature * h_max**2
        slope = np.where(is_beyond, 1.0, is_in_contact * -curve(fraction, 1) / self.recovery)
        y = np.where(is_beyond, 1.0 - xi, np.maximum(y, 0.0))
        return np.asarray(F_max * y), np.asarray(F_max * self.stiffness / h_max * slope)

    def depths_of(self, fractions: np.ndarray, h_max: float) -> np.ndarray:
        """Return the depths (n,) of unloading from h_max at fractions (n,) of the largest force."""
        depths = h_max * (1.0 - np.linspace(0.0, 1.0, 500) * self.recovery / self.stiffness)
        forces = self.unloading(1.0, depths, h_max)
        return np.interp(fractions, forces[::-1] / forces[0], depths[::-1])

    @property
    def packed(self) -> np.ndarray:
        """Numbers that are interpolated between loops, smooth in ln(E/yield_stress)."""
        logs = np.log([self.curvature, self.stiffness, self.recovery])
        return np.array([*logs, *self.forces, self.curvature_error, self.stiffness_error])

    @staticmethod
    def unpack(packed: np.ndarray) -> ConeLoop:
        """Return the loop that has the given numbers, which may be interpolated."""
        curvature, stiffness, recovery = np.exp(packed[:3]).tolist()
        errors = np.abs(packed[-2:]).tolist()
        return ConeLoop(curvature, stiffness, recovery, packed[3:-2], *errors)


@dataclass(frozen=True)
class Metal:
    """Young's modulus, yield stress [pressure] and hardening exponent of a material."""

    E: float
    yield_stress: float
    n: float

    @property
    def ratio(self) -> float:
        """Young's modulus over the yield stress."""
        return self.E / self.yield_stress


def metal_of(config: Config) -> Metal:
    """Return the constants of a scene's material, which must yield."""
    law = config.material
    assert law is not None and law.plasticity is not None
    hardening = law.plasticity.hardening
    n = float(hardening.n or 0.0) if hardening else 0.0
    return Metal(float(law.constants.E), float(law.plasticity.yield_stress), n)


PACKED_SIZE = 3 + len(RECOVERY_FRACTIONS) + 2


def refuse_other_scenes(config: Config, varied_keys: tuple[str, ...]) -> None:
    """Raise ConfigError unless the scene is a cone on a half-space that yields by a power law."""
    yielding_key = next(key for key, law in config.materials() if law.plasticity)
    plasticities = [law.plasticity for _, law in config.materials() if law.plasticity]
    problem = ""
    remedy = "leave plasticity out, and fit the beginning of unloading"
    if config.body.shape != "half_space" or config.body.layers or config.body.inclusions:
        problem = "a fit of a body that yields needs a homogeneous half-space"
    elif config.indenter.shape != "cone" or getattr(config.indenter, "tip_radius", False):
        problem = (
            "a fit of a body that yields needs a sharp cone, whose loops have the same shape at "
            "all depths; loops of spheres and pyramids are not tabulated"
        )
        remedy = (
            "replace a Berkovich or Vickers tip by the cone of equal cross-sections: half_angle "
            "70.3 or 70.2996 degrees"
        )
    elif config.tilt or config.contact.path_key:
        problem = "a fit of a body that yields needs an upright tip without friction or adhesion"
    elif any(law.creep for law in plasticities):
        problem = "a fit of a body that yields needs a flow stress that does not depend on the rate"
        remedy = "leave creep out"
    elif any(law.hardening and law.hardening.n is None for law in plasticities):
        problem = "a fit of a body that yields needs perfect plasticity or the power law n"
    if problem:
        raise ConfigError(f"{yielding_key}.plasticity", problem, remedy)
    for key in varied_keys:
        if key not in LOOP_KEYS:
            raise ConfigError(
                key, "is not determined by a loop", f"vary keys of {', '.join(LOOP_KEYS)}"
            )


class ConeLoopTable:
    """Load-unload loops as functions of E/yield_stress and the hardening exponent, from runs.

    Parameters
    ----------
    config
        The scene.
    depth
        Depth of the runs [length], to which sizes in `mesh` refer.
    varies_hardening
        Whether the exponent is varied.
    """

    def __init__(self, config: Config, depth: float, varies_hardening: bool):
        self.scene_metal = metal_of(config)
        E = self.scene_metal.E
        ratio_low, ratio_high = MODULUS_RATIOS
        yield_stress = Parameter(
            YIELD_STRESS_KEY,
            self.scene_metal.yield_stress,
            "shape",
            E / ratio_high,
            E / ratio_low,
            grid_step=LOOP_LOG_STEP,
        )
        hardening = Parameter(
            HARDENING_KEY, self.scene_metal.n, "shape", *HARDENING_RANGE, True, HARDENING_STEP
        )
        self._varies_hardening = varies_hardening
        self._grid = ParameterGrid(
            config,
            [yield_stress, hardening] if varies_hardening else [yield_stress],
            np.zeros(PACKED_SIZE),
            lambda scene: solve_cone_loop(scene, depth).packed,
            LOOP_NODES,
        )

    @property
    def run_count(self) -> int:
        """Number of runs that have been made for the table."""
        return self._grid.computed_nodes

    def loop(self, metal: Metal) -> ConeLoop:
        """Return the loop of a material; outside MODULUS_RATIOS, the loop of the nearest ratio."""
        theta = [math.log(self.scene_metal.E / metal.ratio)]
        return ConeLoop.unpack(
            self._grid.interpolate([*theta, metal.n] if self._varies_hardening else theta)
        )


def solve_cone_loop(config: Config, depth: float) -> ConeLoop:
    """Run a scene to a depth and back, and return its loop.

    Raises
    ------
    ForwardModelUnavailable
        If the run fails.
    """
    document: dict[str, Any] = to_mapping(config)
    document.pop("experiment", None)
    fractions = np.arange(1, LOADING_ROWS + 1) / LOADING_ROWS
    out = 1.0 - np.array(UNLOADING_ROWS) * _recovery_estimate(config)
    depths = [depth * float(fraction) for fraction in (*fractions, *out[out > 0])]
    document["loading"] = {"deltas": depths}
    try:
        rows = list(
            states(PlannedRun.resolve(config_from_mapping(document)).scene, with_surface=False)
        )
    except NUMERICAL_ERRORS as error:
        raise ForwardModelUnavailable(str(error)) from error
    if len(rows) < len(depths) or not rows[-1].converged:
        raise ForwardModelUnavailable(
            f"the loop of the scene failed: {rows[-1].reason if rows else 'no row'}"
        )
    columns = [(row.delta, row.force, row.unloading_stiffness) for row in rows]
    h, F, S = np.array(columns, dtype=float).T
    return loop_of_rows(h, F, S, metal_of(config).E)


def loop_of_rows(h: np.ndarray, F: np.ndarray, S: np.ndarray, E: float) -> ConeLoop:
    """Return the loop of depths, forces and unloading stiffnesses of the rows (m,) of a run.

    The first LOADING_ROWS rows are equal increments of loading, and the other rows are unloading.
    """
    k = np.arange(FIRST_ROW, LOADING_ROWS + 1)
    used = k - 1
    curvature, curvature_error = _extrapolate_increments(k, F[used] / h[used] ** 2)
    slope, slope_error = _extrapolate_increments(k, S[used] / h[used])
    top = LOADING_ROWS - 1
    xi = (h[top] - h[top:]) * S[top] / F[top]
    recovery, forces = _unloading(xi, F[top:] / F[top])
    return ConeLoop(
        curvature / E,
        slope / curvature,
        recovery,
        forces,
        math.hypot(LOOP_CURVATURE_ERROR, 2.0 * curvature_error),
        math.hypot(LOOP_STIFFNESS_ERROR, 2.0 * math.hypot(slope_error, curvature_error)),
    )


def _recovery_estimate(config: Config) -> float:
    """Return F_max/(S h_max) of a scene within some 20 %, from runs of a 70.3 degree cone.

    The estimate is used only to place the rows of unloading.
    """
    metal = metal_of(config)
    # Representative plastic strain 0.033 of this cone: Dao et al. (2001).
    ratio = metal.ratio / (1.0 + 0.033 * metal.ratio) ** metal.n
    tangent = math.tan(math.radians(number_at(config, "indenter.half_angle"))) / math.tan(
        math.radians(70.3)
    )
    # Fits of 0.228 at E/sigma_y = 33.3 and 0.102 at 100; an elastic cone has 0.5.
    return float(min(0.228 * (33.3 / ratio) ** 0.77 * tangent, 0.42))


def _extrapolate_increments(k: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Extrapolate values (m,) after k (m,) load increments to infinitely many increments.

    Return the limit and its relative error. A line in 1/k is fitted; the error is the standard
    deviation of its value at 1/k = 0.
    """
    coefficients, covariance = np.polyfit(1.0 / k, values, 1, cov=True)
    limit = float(coefficients[1])
    return limit, float(np.sqrt(covariance[1, 1])) / limit


def _unloading(xi: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the recovery, and the forces at the fractions RECOVERY_FRACTIONS of the recovery.

    They are interpolated from rows xi, y (m,).
    """
    from scipy.interpolate import CubicSpline

    in_contact = y > 1e-3
    xi = xi[in_contact]
    y = y[in_contact]
    if len(xi) < 5:
        raise ForwardModelUnavailable(
            "the simulated loop has too few rows of unloading that are in contact"
        )
    # Near the loss of contact the force is about the power 1.3 of the recovery that is left.
    power = 1.0 / 1.3
    left = y[-2:] ** power
    recovery = float(xi[-1] + left[1] * (xi[-1] - xi[-2]) / (left[0] - left[1]))
    curve = CubicSpline(
        np.append(xi, recovery), np.append(y, 0.0), bc_type=((1, -1.0), "not-a-knot")
    )
    return recovery, np.asarray(curve(RECOVERY_FRACTIONS * recovery))
