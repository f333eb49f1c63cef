"""Elastic tables: force over depth of a scene at any values of its parameters, each solved once on
a lattice.

A table is the polynomial g of F = delta^p exp g(sqrt(delta/deepest)), a smooth function of depth
and parameters; between the nodes of a lattice its coefficients are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev

from indent_sim.config.scene_file import from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.scene_curve.lattice import NUMBERS, Lattice, NoTable
from indent_sim.fitting.scene_curve.parameters import Parameter
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.planned_run import PlannedRun
from indent_sim.run.solvers.elastic_curve import ElasticForces, elastic_forces, flat_punches

# depths at which a scene is solved, and of the polynomial through them: 5e-11 by theory
SOLVED_DEPTHS = 20
DEGREE = 12
SHALLOWEST_ROOT = 0.02  # of sqrt(delta/deepest): a power law below
# a contact of 5 % of the depth has few elements; degree of what a mesh adds to theory
ON_MESH = 0.2236
MESH_DEGREE = 5
NODES = 6  # of the lattice around a value: 2e-6 of the force at steps of 0.2
HALF = 0.5  # exponents of depth are multiples of it, up to SAME_EXPONENT, or as they are
SAME_EXPONENT = 0.02
# of the polynomials through flat punches
RADIUS_DEGREE = 12
LEAST_RADIUS = 0.02
NODE_ANGLES = np.pi * (np.arange(SOLVED_DEPTHS) + 0.5) / SOLVED_DEPTHS
S = 0.5 * (1 + SHALLOWEST_ROOT) - 0.5 * (1 - SHALLOWEST_ROOT) * np.cos(NODE_ANGLES)
DOMAIN = (SHALLOWEST_ROOT, 1.0)


@dataclass(frozen=True)
class ElasticTable:
    """The elastic curve of one scene: F = delta^power exp g(s), s = sqrt(delta/deepest), in the
    scene's units.

    coefficients (13,) of Chebyshev's polynomials of s; punches (4, 13) of ln delta_1, ln F_1, ln K,
    ln K' over ln a up to the radius `widest`, where adhesion asks for them; error: relative
    half-width of the force's error bar; radius [length]: of the contact at the deepest.
    """

    deepest: float
    power: float
    coefficients: np.ndarray
    punches: np.ndarray | None = None
    widest: float = 0.0
    error: float = 0.0
    radius: float = 0.0

    def force(self, delta: np.ndarray) -> np.ndarray:
        """The force [force] at depths [length] (n,), 0 out of contact; beyond the deepest it goes
        on as a power.
        """
        inside = np.maximum(delta, 1e-300)
        s = np.clip(np.sqrt(inside / self.deepest), *DOMAIN)
        g = np.polynomial.chebyshev.chebval(_unit(s), self.coefficients)
        return np.where(delta > 0, inside**self.power * np.exp(g), 0.0)


def _unit(s: np.ndarray) -> np.ndarray:
    """s on the interval of Chebyshev's polynomials."""
    return (2.0 * s - (DOMAIN[0] + DOMAIN[1])) / (DOMAIN[1] - DOMAIN[0])


class ElasticLattice:
    """The tables of a scene over its shape parameters.

    wants_punches: for an adhering tip. ConfigError where the scene as it stands cannot exist.
    """

    def __init__(
        self,
        config: Config,
        shape: Sequence[Parameter],
        deepest: float,
        wants_punches: bool = False,
    ):
        self.first = solved(config, deepest, wants_punches)

        def solve(scene: Config) -> np.ndarray:
            return _array(solved(scene, deepest, wants_punches, self.first.power))

        self._lattice = Lattice(config, shape, _array(self.first), solve, NODES)

    def at(self, theta: Sequence[float]) -> ElasticTable:
        """The table at coordinates of the shape parameters; NoTable where the scene has none."""
        if not self._lattice.shape:
            return self.first
        array = self._lattice.at(theta)
        coefficients = array[: DEGREE + 1]
        rest = array[DEGREE + 1 :]
        punches, widest = (
            (rest[:-1].reshape(4, -1), math.exp(rest[-1])) if len(rest) else (None, 0.0)
        )
        return replace(self.first, coefficients=coefficients, punches=punches, widest=widest)


def _array(table: ElasticTable) -> np.ndarray:
    """The numbers of a table that depend on its parameters."""
    rest = [] if table.punches is None else [*table.punches.ravel(), math.log(table.widest)]
    return np.array([*table.coefficients, *rest])


def elastic_prospect(config: Config, deepest: float) -> PlannedRun:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a
    depth, by a load path to the depths of a table; ConfigError where it cannot exist.
    """
    if config.contact.adhesion:
        raise ConfigError(
            "contact.adhesion", "a fit takes adhesion without range", "give experiment.adhesion"
        )
    document = _at_once(config)
    prospect = PlannedRun.resolve(
        from_mapping(document | {"loading": {"delta": float(deepest), "steps": 1}})
    )
    if prospect.accepts_any_depth:
        return prospect
    return PlannedRun.resolve(
        from_mapping(document | {"loading": {"deltas": [float(deepest * s * s) for s in S]}})
    )


def _at_once(config: Config) -> dict[str, Any]:
    """The sections of a scene without its experiment, of matter that does not relax and has no
    fluid.
    """
    document = to_mapping(config)
    document.pop("experiment", None)
    document.pop("drainage", None)
    for key, _ in config.materials():
        section: Any = document
        for part in key_path(key):
            section = section[part]
        section.pop("relaxation", None)
        section.pop("flow", None)
    return document


def at_once(config: Config, deepest: float) -> Config:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a
    depth.
    """
    return from_mapping(_at_once(config) | {"loading": {"delta": float(deepest)}})


def solved(
    config: Config, deepest: float, wants_punches: bool = False, power: float | None = None
) -> ElasticTable:
    """The table of a scene by its own solver: theory, a condensed body, or a load path.

    power: of the depth, where it is known. NoTable where there is no solution, ConfigError where
    there is no scene.
    """
    prospect = elastic_prospect(config, deepest)
    try:
        found = elastic_forces(prospect, deepest * S**2)
        table = (_of_mesh if prospect.scene.is_meshed else _of_theory)(found, deepest, power)
        punches, widest = _punches(prospect, deepest) if wants_punches else (None, 0.0)
    except (NotConverged, *NUMBERS) as error:
        raise NoTable(str(error)) from error
    return replace(table, punches=punches, widest=widest)


def _of_theory(found: ElasticForces, deepest: float, power: float | None) -> ElasticTable:
    depths = deepest * S**2
    power = _power(depths, found.forces) if power is None else power
    g = Chebyshev.fit(S, np.log(found.forces) - power * np.log(depths), DEGREE, domain=DOMAIN)
    return ElasticTable(deepest, power, g.coef, radius=found.contact_radius)


def _of_mesh(found: ElasticForces, deepest: float, power: float | None) -> ElasticTable:
    """The same where a mesh is solved: what it adds to theory is smoothed, and its error bar kept."""
    depths = deepest * S**2
    forces = found.forces
    base = found.theory_forces
    base = base if base is not None and (base > 0).all() else None
    used = (S >= ON_MESH) & (forces > 0)
    if np.count_nonzero(used) <= MESH_DEGREE:
        raise NoTable("the contact has too few elements: give a smaller mesh.h_contact")
    power = _power(depths[used], forces[used]) if power is None else power
    known = np.log(base) if base is not None else power * np.log(depths)
    ratio = Chebyshev.fit(S[used], np.log(forces[used]) - known[used], MESH_DEGREE)
    scatter = float(np.std(ratio(S[used]) - (np.log(forces[used]) - known[used])))
    added = np.where(S[used][0] > S, ratio(S[used][0]), ratio(S))
    g = Chebyshev.fit(S, known + added - power * np.log(depths), DEGREE, domain=DOMAIN)
    return ElasticTable(
        deepest, power, g.coef, error=math.hypot(scatter, found.error), radius=found.contact_radius
    )


def _power(depths: np.ndarray, forces: np.ndarray) -> float:
    """The exponent of depth at the shallowest points, a multiple of one half where it is nearly
    one.
    """
    slope = float(np.log(forces[1] / forces[0]) / np.log(depths[1] / depths[0]))
    nearest = HALF * round(slope / HALF)
    return nearest if abs(slope - nearest) < SAME_EXPONENT else slope


def _punches(prospect: PlannedRun, deepest: float) -> tuple[np.ndarray, float]:
    """ln delta_1, F_1, K, K' over ln a, in the scene's units, and the widest radius."""
    shares, columns, widest = flat_punches(prospect, deepest, LEAST_RADIUS)
    x = np.log(shares)
    logs = np.log(columns)
    fits = [
        Chebyshev.fit(x, values, RADIUS_DEGREE, domain=(math.log(LEAST_RADIUS), 0.0)).coef
        for values in logs
    ]
    return np.array(fits), widest
