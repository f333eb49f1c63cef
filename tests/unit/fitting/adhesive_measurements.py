"""Synthetic measurements with adhesion (JKR), by theory and not by the forward model of the fits.

A curve approaches without force, snaps in at first touch, follows the stable branch to the deepest
point and back, with another work of adhesion, until the instability dF/d(delta) = -k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from measurements import HALF_SPACE, LAYER, scene
from scipy.interpolate import CubicSpline

from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.elastic_load_curve import plan_elastic_run
from indent_sim.fitting.forward_model.forward_model import APPROACH, ForwardModel
from indent_sim.fitting.forward_model.parameters import ADHESION_WORK_KEY, RETRACT_WORK_KEY
from indent_sim.fitting.inference.estimate import (
    CLEAR_SNAP_DEVIATIONS,
    CurveModel,
    Samples,
)
from indent_sim.results.measured.measurement import MeasuredCurve
from indent_sim.theory.punches import LayerPunches

KEYS = ("material.E", ADHESION_WORK_KEY)
KEYS_OF_BOTH = (*KEYS, RETRACT_WORK_KEY)
NU = 0.45
Z_END = 0.1  # displacement of the base from first touch to the deepest point
POINTS = 300
RETRACT_FACTOR = 1.5  # work of the retraction over that of the approach
STIFFNESS = 0.5
# Bodies and springs of the curves, under a paraboloid of R = 1 on a body with E = 1.
GROUPS = {
    "half-space": (HALF_SPACE, None),
    "half-space, cantilever": (HALF_SPACE, STIFFNESS),
    "layer": (LAYER, None),
    "layer, cantilever": (LAYER, STIFFNESS),
}


def group_scene(group: str, E: float = 1.0, work: float = 1.0) -> Config:
    """Return the scene of a group with a modulus and a work of adhesion."""
    body, stiffness = GROUPS[group]
    spring = {} if stiffness is None else {"cantilever": {"stiffness": stiffness}}
    config = scene(body, nu=NU, experiment={"adhesion": {"work": work}, **spring})
    material = config.material
    return config.model_copy(update={"material": type(material)(E=E, nu=NU)})


@dataclass(frozen=True)
class AdhesiveCurve:
    """Curves of a group with E = 1 whose snap-in is a given fraction of the largest force.

    Attributes
    ----------
    group : str
        One of GROUPS.
    snap_fraction : float
        Force at snap-in over the largest force.
    growth : float
        Exponent of the contact radius to which the works are proportional.
    """

    group: str
    snap_fraction: float
    growth: float = 0.0

    @property
    def compliance(self) -> float:
        """Compliance of the spring."""
        stiffness = GROUPS[self.group][1]
        return 0.0 if stiffness is None else 1.0 / stiffness

    @cached_property
    def _punches(self) -> np.ndarray:
        """Radius a, depth and force without adhesion, K and dK/da of flat punches (5, m)."""
        E_star = 1.0 / (1.0 - NU**2)
        a = np.geomspace(1e-3, 1.2, 4000)
        if GROUPS[self.group][0] is HALF_SPACE:
            # Hertz (1882) and Boussinesq (1885).
            return np.array(
                [
                    a,
                    a**2,
                    4.0 / 3.0 * E_star * a**3,
                    2.0 * E_star * a,
                    np.full(a.size, 2.0 * E_star),
                ]
            )
        planned = plan_elastic_run(scene(LAYER, nu=NU), 0.3).scene
        punches = LayerPunches(planned.plan.theory.contact)
        L, F = planned.physics.scales.length, planned.physics.scales.force
        a = np.geomspace(3e-3, 0.9 * punches.max_radius, 200)
        rows = [punches.punch_of_radius(float(radius)) for radius in a]
        columns = np.array(
            [(p.a, p.delta, p.force, p.stiffness, p.stiffness_slope) for p in rows]
        ).T
        # The logarithms are smooth; lines between 4000 radii are exact to 1e-5 of the force.
        log_radii = np.linspace(math.log(a[0]), math.log(a[-1]), 4000)
        columns = np.exp(CubicSpline(np.log(a), np.log(columns), axis=1)(log_radii))
        return columns * np.array([L, L, F, F / L, F / L**2])[:, None]

    def branch(self, work: float) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement of the base and force along the stable branch."""
        a, delta, force, stiffness, slope = self._punches
        # A contact radius of the deepest point, about.
        grown_work = work * (a / math.sqrt(Z_END)) ** self.growth
        q = np.sqrt(4.0 * np.pi * a * grown_work / slope)
        force = force - stiffness * q
        z = delta - q + self.compliance * force
        first = int(np.argmin(z[: np.flatnonzero(np.diff(z) <= 0)[-1] + 2]))
        return z[first:], force[first:]

    @cached_property
    def work(self) -> float:
        """Work of adhesion of the approach."""
        low, high = 1e-7, 0.1
        for _ in range(60):
            work = math.sqrt(low * high)
            z, force = self.branch(work)
            touch, end = np.interp([0.0, Z_END], z, force)
            is_strong = end <= 0.0 or -touch / end > self.snap_fraction
            low, high = (low, work) if is_strong else (work, high)
        return math.sqrt(low * high)

    @property
    def truth(self) -> dict[str, float]:
        """True values of the fitted keys."""
        return dict(zip(KEYS_OF_BOTH, (1.0, self.work, RETRACT_FACTOR * self.work), strict=True))

    def displacements(self) -> np.ndarray:
        """Return the displacements from first touch of approach and retraction (2, POINTS)."""
        z = np.linspace(-Z_END, Z_END, POINTS)
        return np.array([z, z[::-1]])

    def forces(self, z: np.ndarray) -> np.ndarray:
        """Return the forces of approach and retraction at displacements (2, n) from first touch."""
        approach = np.where(z[0] >= 0.0, np.interp(z[0], *self.branch(self.work)), 0.0)
        displacement, force = self.branch(RETRACT_FACTOR * self.work)
        retract = np.where(z[1] >= displacement[0], np.interp(z[1], displacement, force), 0.0)
        return np.array([approach, retract])

    def measured(self, noise: np.ndarray, contact_point: float) -> MeasuredCurve:
        """Return a curve on a tilted baseline.

        Parameters
        ----------
        noise : ndarray, shape (2, POINTS)
            Noise over the largest force.
        contact_point : float
            Displacement at first touch.
        """
        z = self.displacements()
        force = self.forces(z - contact_point)
        force = force + force[0].max() * (noise + 0.3 + 0.05 * z / Z_END)
        x = z.ravel()
        parts = {"approach": slice(0, POINTS), "retract": slice(POINTS, 2 * POINTS)}
        is_depth = GROUPS[self.group][1] is None
        return MeasuredCurve(
            "made up",
            force.ravel(),
            x if is_depth else None,
            None if is_depth else x,
            parts=parts,
        )

    def cramer_rao(self, noise_level: float) -> float:
        """Return the Cramer-Rao bound of the deviation of ln E, by the approach in white noise.

        Work, contact point and baseline are unknown. A clear snap-in tells the contact point to the
        distance of two samples.
        """
        forward_model = ForwardModel(group_scene(self.group, work=self.work), KEYS, 3.0 * Z_END)
        x = self.displacements()[0]
        branch = np.where(x >= 0.0, APPROACH, -APPROACH)
        model = CurveModel(forward_model, Samples(x, np.zeros(POINTS), branch=branch))
        p = np.array([*forward_model.initial_coordinates, 0.0, 0.0, 0.0])
        J = model.jacobian(p)
        force = model.contact_force(p)
        deviation = noise_level * float(force.max())
        information = J.T @ J / deviation**2
        if self.snap_fraction > CLEAR_SNAP_DEVIATIONS * noise_level:
            information[2, 2] += 12.0 / model.sample_spacing**2
        return math.sqrt(float(np.linalg.inv(information)[0, 0]))
